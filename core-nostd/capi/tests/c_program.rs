//! C programs, compiled with warnings as errors and linked to the static library as firmware links it: `answers.c` must print what
//! the Rust API answers, bit for bit; `hostile.c` must get a code for every bad call. Where there is a C++ compiler, as C++ too.
//!
//! `ISOBATH_SANITIZE=1` (the suite `c-interface`) adds gcc's address and undefined-behaviour sanitizers.

use std::env;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use isobath::glam::{Quat, Vec2, Vec3, vec3};
use isobath::ground::geometry::{OrientedBox, Ray};
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::localized::collision::{CollisionParams, box_points, vote};
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::hit::{HitOutcome, HitParams, hit_test};
use isobath::localized::normals::{NormalParams, normal_at};
use isobath::localized::placement::{NoPlace, PlaceParams, Spot, place};
use isobath::localized::planner::{Node, Plan, Planner, Walker};
use isobath::localized::raycast::{RayOutcome, RayParams, cast};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::depth::{DepthUnit, HolePolicy};
use isobath::sensing::frame::DepthFrame;
use isobath_capi::memory::isobath_context_size;

/// The static library, made once for all tests of this file; in a target folder of its own, since the one of the `cargo test`
/// that runs us may be locked.
fn library() -> &'static Path {
    static LIBRARY: OnceLock<PathBuf> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("c-library");
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args(["rustc", "--quiet", "--package", "isobath-capi", "--profile", "c-library"]);
        cargo.args(["--features", "panic-handler", "--crate-type", "staticlib", "--target-dir"]).arg(&target);
        for (name, _) in
            env::vars().filter(|(name, _)| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST"))
        {
            cargo.env_remove(name);
        }
        let status = cargo.current_dir(env!("CARGO_MANIFEST_DIR")).status().expect("cargo starts");
        assert!(status.success(), "the static library does not build");
        target.join("c-library/libisobath_capi.a")
    })
}

/// Compiles and runs a program; what it printed. `None` when the compiler is not there.
fn run(compiler: &str, language: &[&str], program: &str) -> Option<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let out =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{program}-{}", language.concat().replace(['=', '+'], "")));
    let mut cc = Command::new(compiler);
    cc.args(language).args(["-Wall", "-Wextra", "-Werror", "-pedantic", "-g", "-I"]).arg(root.join("include"));
    if env::var_os("ISOBATH_SANITIZE").is_some() {
        cc.args(["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]);
    }
    cc.arg("-o").arg(&out).arg(root.join("tests/c").join(program).with_extension("c"));
    // The library is no source, whatever `-x` said before.
    cc.args(["-x", "none"]).arg(library());
    let compiled = cc.output().ok()?;
    assert!(compiled.status.success(), "{compiler} on {program}: {}", String::from_utf8_lossy(&compiled.stderr));
    let ran = Command::new(&out).output().expect("the program starts");
    let printed = String::from_utf8_lossy(&ran.stdout).into_owned();
    assert!(ran.status.success(), "{program}: {}\n{printed}{}", ran.status, String::from_utf8_lossy(&ran.stderr));
    Some(printed)
}

fn run_as_c_and_cpp(program: &str) -> Vec<String> {
    let cc = env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let cxx = env::var("CXX").unwrap_or_else(|_| "c++".to_owned());
    let c = run(&cc, &["-x", "c", "-std=c11"], program).expect("a C compiler: see CONTRIBUTING.md");
    let cpp = run(&cxx, &["-x", "c++", "-std=c++14"], program);
    if cpp.is_none() {
        eprintln!("no C++ compiler: {program} was not tried as C++");
    }
    std::iter::once(c).chain(cpp).collect()
}

#[test]
fn bad_calls_get_codes() {
    for printed in run_as_c_and_cpp("hostile") {
        assert_eq!(printed, "0 failures\n");
    }
}

#[test]
fn c_gets_the_answers_that_rust_gets() {
    let want = rust_answers();
    for printed in run_as_c_and_cpp("answers") {
        for (number, (got, want)) in printed.lines().zip(want.lines()).enumerate() {
            assert_eq!(got, want, "line {}", number + 1);
        }
        assert_eq!(printed.lines().count(), want.lines().count());
    }
    // The scenes show enough different outcomes that the comparison is not one of empty answers.
    let shown = "hit 0 1 2, normal 0 1 3, ray 0 1 2 3 4, vote 0 1 2, place 0 1 2 3 5, ground 0 2, path 0 2 4 6 8";
    for group in shown.split(", ") {
        let (question, outcomes) = group.split_once(' ').expect("a question and its outcomes");
        for outcome in outcomes.split(' ') {
            assert!(
                want.contains(&format!("\n{question} {outcome} ")),
                "{question} {outcome} is not among the answers"
            );
        }
    }
}

/// As the example's comments say, and as its reader will do it.
#[test]
fn the_example_works() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("firmware");
    let cc = env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let compiled = Command::new(cc)
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I"])
        .arg(root.join("include"))
        .arg("-o")
        .arg(&out)
        .arg(root.join("examples/firmware.c"))
        .arg(library())
        .output()
        .expect("a C compiler: see CONTRIBUTING.md");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let ran = Command::new(&out).output().expect("the example starts");
    assert!(ran.status.success());
    let printed = String::from_utf8_lossy(&ran.stdout);
    for line in ["floor 1.", "free", "the way has"] {
        assert!(printed.contains(line), "{printed}");
    }
}

const W: usize = 96;
const H: usize = 72;
const CELLS: usize = 40;

fn wall(x: usize, y: usize) -> u16 {
    if (x * 7 + y * 13).is_multiple_of(31) {
        0
    } else if (40..56).contains(&x) && (30..44).contains(&y) {
        900
    } else {
        (1500 + 3 * x + 2 * y) as u16
    }
}

fn floor_from_above(x: usize, y: usize) -> u16 {
    if x.is_multiple_of(9) && y.is_multiple_of(8) {
        65_535
    } else if (32..40).contains(&y) && x < 60 {
        1500
    } else {
        2000
    }
}

fn image(pixel: fn(usize, usize) -> u16) -> Vec<u16> {
    (0..W * H).map(|i| pixel(i % W, i / W)).collect()
}

struct Lines(String);

impl Lines {
    fn word(&mut self, word: impl std::fmt::Display) -> &mut Self {
        if !self.0.is_empty() && !self.0.ends_with('\n') {
            self.0.push(' ');
        }
        write!(self.0, "{word}").expect("a string takes everything");
        self
    }

    fn floats(&mut self, floats: impl IntoIterator<Item = f32>) -> &mut Self {
        floats.into_iter().fold(self, |lines, f| lines.word(format_args!("{:08x}", f.to_bits())))
    }

    fn vec(&mut self, v: Vec3) -> &mut Self {
        self.floats(v.to_array())
    }

    fn end(&mut self) {
        self.0.push('\n');
    }
}

/// What `answers.c` asks, in its order, of the Rust API.
fn rust_answers() -> String {
    let mut lines = Lines(String::new());
    lines.word("version").word(env!("CARGO_PKG_VERSION")).end();
    lines.word("size").word(isobath_context_size(96, 72, 40, 40)).word(146_528).word(48_224).end();
    let k = Intrinsics::new(80.0, 81.0, 47.5, 35.5).unwrap();
    let time = Timestamp::from_nanos(1_234_567_890_123);
    let seen = image(wall);
    let wall = DepthFrame::new(ImageView::new(&seen, W, H).unwrap(), DepthUnit::MILLIMETRE, k).with_time(time, 0);
    let askew = Pose::new(Quat::from_xyzw(0.1, -0.2, 0.05, 0.974), vec3(1.5, -0.25, 3.0)).unwrap();
    hits(&mut lines, &wall.with_pose(askew), DepthNoise::KINECT);
    normals(&mut lines, &wall.with_pose(askew));
    hits(&mut lines, &wall.with_pose(askew), DepthNoise::TIME_OF_FLIGHT);
    hits(&mut lines, &wall, DepthNoise::TIME_OF_FLIGHT);
    rays(&mut lines, &wall);
    votes(&mut lines, &wall);
    places(&mut lines, &wall, Vec3::NEG_Z);

    let seen = image(floor_from_above);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let above = Pose::new(Quat::from_xyzw(half, 0.0, 0.0, half), vec3(0.0, 2.0, 0.0)).unwrap();
    let floor = DepthFrame::new(ImageView::new(&seen, W, H).unwrap(), DepthUnit::MILLIMETRE, k).with_pose(above);
    places(&mut lines, &floor, Vec3::Y);
    let grid = |centre| Grid::new(centre, Vec3::Y, Vec3::NEG_Z, 0.05, CELLS, CELLS).unwrap();
    let mut cells = vec![HeightCell::UNKNOWN; CELLS * CELLS];
    let mut map = HeightMap::new(grid(Vec3::ZERO), &mut cells, HeightMapParams::DEFAULT).unwrap();
    walks(&mut lines, &mut map, &floor);
    map.fade();
    map.restart(grid(vec3(0.2, 0.0, 0.1))).unwrap();
    walks(&mut lines, &mut map, &floor);
    lines.0
}

fn hits(lines: &mut Lines, frame: &DepthFrame<'_>, noise: DepthNoise) {
    for at in [(20.3, 10.4), (48.0, 36.0), (0.0, 0.0), (95.4, 71.4), (96.0, 3.0), (-0.6, 3.0)] {
        lines.word("hit");
        match hit_test(frame, Vec2::from(at), &HitParams { noise, ..HitParams::default() }) {
            HitOutcome::Hit(h) => {
                lines.word(0).word(u32::from(h.normal.is_some())).word(h.pixel.0).word(h.pixel.1);
                lines.vec(h.point).vec(h.camera_point).vec(h.normal.unwrap_or_default());
                lines.floats([h.z, h.range, h.sigma_z]).word(h.estimate.map_or(0, |e| e.support));
                lines.floats([h.estimate.map_or(0.0, |e| e.residual)]);
            }
            other => {
                let (code, (x, y)) = match other {
                    HitOutcome::NoDepth { pixel } => (1, pixel),
                    _ => (2, (0, 0)),
                };
                lines.word(code).word(0).word(x).word(y).floats([0.0; 12]).word(0).floats([0.0]);
            }
        }
        lines.word(frame.time().as_nanos()).end();
    }
}

fn normals(lines: &mut Lines, frame: &DepthFrame<'_>) {
    for (x, y, radius) in [(20, 10, 0), (20, 10, 5), (0, 0, 5), (39, 35, 2), (96, 0, 0), (47, 37, 7)] {
        let found = normal_at(frame, x, y, &NormalParams { radius, ..NormalParams::default() });
        let code = match found {
            Some(_) => 0,
            None if x >= W || y >= H => 3,
            None if frame.z(x, y) == 0.0 => 1,
            None => 2,
        };
        lines.word("normal").word(code).word(found.map_or(0, |e| e.support));
        let normal = found.map(|e| e.normal);
        lines.vec(normal.map_or(Vec3::ZERO, |n| frame.pose_or_identity().direction_to_world(n)));
        lines.vec(normal.unwrap_or_default()).floats([found.map_or(0.0, |e| e.residual)]).end();
    }
}

fn rays(lines: &mut Lines, frame: &DepthFrame<'_>) {
    for to in [(0.1, 0.2, 3.0), (-0.5, -0.3, 2.0), (0.0, 0.0, -1.0), (0.9, 0.0, 1.0), (0.3, 0.0, 2.0)] {
        for holes in [HolePolicy::Unknown, HolePolicy::Solid, HolePolicy::Free] {
            let ray = Ray::new(vec3(-0.3, 0.05, 0.1), Vec3::from(to)).unwrap();
            // Without a pyramid: C's has one, and the answer is the same.
            let outcome = cast(frame, None, &ray, &RayParams { holes, ..RayParams::default() }).outcome;
            let (code, point, distance, pixel, z, flags) = match outcome {
                RayOutcome::Hit(h) => (0, h.point, h.distance, h.pixel, h.z, [h.passed_behind, h.from_hole, false]),
                RayOutcome::HitOccluded { point, pixel, distance } => (1, point, distance, pixel, 0.0, [false; 3]),
                RayOutcome::Miss { left_view } => (2, Vec3::ZERO, 0.0, (0, 0), 0.0, [false, false, left_view]),
                RayOutcome::NoDepth => (3, Vec3::ZERO, 0.0, (0, 0), 0.0, [false; 3]),
                RayOutcome::OutsideView => (4, Vec3::ZERO, 0.0, (0, 0), 0.0, [false; 3]),
            };
            lines.word("ray").word(code).vec(point).floats([distance]).word(pixel.0).word(pixel.1).floats([z]);
            flags.map(u32::from).iter().fold(&mut *lines, |lines, flag| lines.word(flag)).end();
        }
    }
}

fn votes(lines: &mut Lines, frame: &DepthFrame<'_>) {
    for z in [0.5, 0.95, 1.4, 2.5, -1.0] {
        let turned = Pose::new(Quat::from_xyzw(0.0, 0.6, 0.0, 0.8), vec3(0.02, 0.01, z)).unwrap();
        let object =
            OrientedBox { centre: turned.translation(), half: vec3(0.1, 0.08, 0.1), rotation: turned.rotation() };
        let found = vote(frame, box_points(&object, Vec3::Y), &CollisionParams::default());
        let t = found.tally;
        lines.word("vote").word(found.verdict as u32).word(t.visible).word(t.hidden).word(t.holes);
        lines.word(t.outside).word(t.behind_camera).end();
    }
}

fn places(lines: &mut Lines, frame: &DepthFrame<'_>, up: Vec3) {
    let wish = PlaceParams::new(vec3(0.1, 0.15, 0.1) * 2.0, up);
    for (x, y) in [(70, 20), (30, 55), (48, 36), (2, 2), (70, 55), (200, 3), (0, 0)] {
        lines.word("place");
        match place(frame, None, Spot::Pixel(x, y), &wish).outcome {
            Ok(p) => {
                lines.word(0).vec(p.pose.centre).vec(p.pose.half).floats(p.pose.rotation.to_array());
                lines.vec(p.plane.normal()).vec(p.plane.anchor());
                lines.floats([p.flatness, p.tilt, p.coverage, 0.0, 0.0]);
            }
            Err(reason) => {
                let (code, shares) = match reason {
                    NoPlace::OutsideView => (1, [0.0; 5]),
                    NoPlace::NoSurface => (2, [0.0; 5]),
                    NoPlace::TooSteep { tilt } => (3, [0.0, tilt, 0.0, 0.0, 0.0]),
                    NoPlace::TooRough { flatness } => (4, [flatness, 0.0, 0.0, 0.0, 0.0]),
                    NoPlace::TooSmall { coverage } => (5, [0.0, 0.0, coverage, 0.0, 0.0]),
                    NoPlace::Blocked { hidden } => (6, [0.0, 0.0, 0.0, hidden, 0.0]),
                    NoPlace::Unknown { holes } => (7, [0.0, 0.0, 0.0, 0.0, holes]),
                    other => panic!("{other:?}"),
                };
                lines.word(code).floats([0.0; 16]).floats(shares);
            }
        }
        lines.end();
    }
}

fn walks(lines: &mut Lines, map: &mut HeightMap<'_>, frame: &DepthFrame<'_>) {
    let r = map.integrate(frame);
    lines.word("integrated").word(r.used).word(r.overhead).word(r.outside).word(r.holes).end();
    map.integrate(frame);
    for i in -3_i8..4 {
        let cell = map.cell_at(vec3(0.3 * f32::from(i), 7.0, 0.2 * f32::from(i)));
        let (code, cell) = match cell {
            None => (2, HeightCell::UNKNOWN),
            Some(cell) if cell.is_known() => (0, *cell),
            Some(_) => (1, HeightCell::UNKNOWN),
        };
        lines.word("ground").word(code).floats([cell.min, cell.max, cell.mean]).word(cell.support).end();
    }
    let walker = Walker { radius: 0.1, ..Walker::DEFAULT };
    let ways = [
        [-0.4, -0.5, -0.4, 0.5],
        [-0.4, -0.5, 0.3, -0.5],
        [0.5, -0.5, 0.5, 0.5],
        [5.0, 0.0, 0.0, 0.0],
        [0.0, -0.5, 0.97, 0.97],
        [0.0, 0.0, 0.5, 0.5],
    ];
    for [x0, z0, x1, z1] in ways {
        for capacity in [2, 16] {
            let mut points = vec![Vec3::ZERO; capacity];
            let mut nodes = vec![Node::EMPTY; CELLS * CELLS];
            let (from, to) = (vec3(x0, 0.0, z0), vec3(x1, 0.0, z1));
            let plan = Planner::new(&mut nodes).plan(map, &walker, from, to, &mut points).unwrap();
            let (code, count, needed, floats, expanded) = match plan {
                Plan::Found(p) => (0, p.points, p.points, [p.length, p.cost], p.expanded),
                Plan::NoPath { expanded } => (1, 0, 0, [0.0; 2], expanded),
                Plan::StartOutside => (2, 0, 0, [0.0; 2], 0),
                Plan::StartUnknown => (3, 0, 0, [0.0; 2], 0),
                Plan::StartBlocked => (4, 0, 0, [0.0; 2], 0),
                Plan::GoalOutside => (5, 0, 0, [0.0; 2], 0),
                Plan::GoalUnknown => (6, 0, 0, [0.0; 2], 0),
                Plan::GoalBlocked => (7, 0, 0, [0.0; 2], 0),
                Plan::PointsExceeded { needed, got } => (8, got, needed, [0.0; 2], 0),
                Plan::NodesExceeded { .. } => panic!("{plan:?}"),
            };
            lines.word("path").word(code).word(count).word(needed).floats(floats).word(expanded);
            points.iter().take(count).fold(&mut *lines, |lines, p| lines.vec(*p)).end();
        }
    }
}
