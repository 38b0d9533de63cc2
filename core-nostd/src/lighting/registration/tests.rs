use std::boxed::Box;
use std::vec;
use std::vec::Vec;

use glam::{Mat3, Quat, vec3};
use proptest::prelude::*;

use super::associate::{Cells, Gates, Sums, add_row};
use super::*;
use crate::ground::image::ImageView;
use crate::sensing::camera::Intrinsics;
use crate::sensing::depth::DepthUnit;

const SIZE: (usize, usize) = (160, 120);
const UNIT: DepthUnit = DepthUnit::TENTH_MILLIMETRE;

fn camera() -> Intrinsics {
    Intrinsics::new(130.0, 130.0, 79.5, 59.5).unwrap()
}

/// What there is to see.
#[derive(Clone, Copy)]
enum Thing {
    /// n · p = d.
    Plane([f64; 3], f64),
    Sphere([f64; 3], f64),
}
use Thing::{Plane, Sphere};

/// Floor 1.1 m below the camera and two walls, with a ball in the corner.
const CORNER: &[Thing] = &[
    Plane([0.0, 1.0, 0.0], 1.1),
    Plane([0.6, 0.0, 0.8], 3.2),
    Plane([-0.8, 0.0, 0.6], 2.6),
    Sphere([0.2, 0.9, 2.4], 0.5),
];

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Depth along the axis of every pixel, in double precision; 0 where nothing is.
fn render(things: &[Thing], pose: &Pose) -> Vec<u16> {
    let m = Mat3::from_quat(pose.rotation());
    let axes = [m.x_axis, m.y_axis, m.z_axis].map(|a| a.to_array().map(f64::from));
    let eye = pose.translation().to_array().map(f64::from);
    let k = camera();
    let mut out = Vec::new();
    for y in 0..SIZE.1 {
        for x in 0..SIZE.0 {
            let (rx, ry) = ((x as f64 - f64::from(k.cx())) / 130.0, (y as f64 - f64::from(k.cy())) / 130.0);
            let ray: [f64; 3] = core::array::from_fn(|i| axes[0][i] * rx + axes[1][i] * ry + axes[2][i]);
            let hit = things.iter().filter_map(|thing| match *thing {
                Plane(n, d) => Some((d - dot(n, eye)) / dot(n, ray)).filter(|t| *t > 0.0),
                Sphere(c, r) => {
                    let o: [f64; 3] = core::array::from_fn(|i| eye[i] - c[i]);
                    let (a, b, c) = (dot(ray, ray), dot(o, ray), dot(o, o) - r * r);
                    let root = b * b - a * c;
                    (root > 0.0).then(|| (-b - root.sqrt()) / a).filter(|t| *t > 0.0)
                }
            });
            let z = hit.fold(f64::INFINITY, f64::min);
            out.push(if z < 6.5 { (z * 1e4).round() as u16 } else { 0 });
        }
    }
    out
}

fn frame<'a>(depth: &'a [u16], pose: &Pose) -> DepthFrame<'a> {
    DepthFrame::new(ImageView::new(depth, SIZE.0, SIZE.1).unwrap(), UNIT, camera()).with_pose(*pose)
}

fn turned(axis: Vec3, angle: f32, at: Vec3) -> Pose {
    Pose::new(Quat::from_axis_angle(axis.try_normalize().unwrap(), angle), at).unwrap()
}

/// `pose`, wrongly tracked: the camera turned and shifted.
fn drifted(pose: &Pose, axis: Vec3, angle: f32, shift: Vec3) -> Pose {
    let turn = turned(axis, angle, Vec3::ZERO).rotation();
    Pose::new(turn * pose.rotation(), pose.translation() + shift).unwrap()
}

/// Metres and radians.
fn error(pose: &Pose, truth: &Pose) -> (f32, f32) {
    let d = pose.relative_to(truth);
    let r = d.rotation();
    (d.translation().length(), 2.0 * Vec3::new(r.x, r.y, r.z).length())
}

/// Registers views of things from true poses, tracked as given; the first stays.
fn register<const N: usize>(things: &[Thing], truth: &[Pose; N], tracked: &[Pose; N]) -> [ViewReport; N] {
    let mut memory = vec![0.0; N * scratch_len(SIZE.0, SIZE.1)];
    let mut registration = Registration::<N>::new(&mut memory, RegistrationParams::default());
    for (i, (pose, seen)) in truth.iter().zip(tracked).enumerate() {
        let depth = render(things, pose);
        registration.set(i, &frame(&depth, seen), &DepthNoise::NONE).unwrap();
    }
    registration.start(&[0]).unwrap();
    assert_eq!(registration.step(usize::MAX), Progress::Done);
    core::array::from_fn(|i| registration.report(i).unwrap())
}

fn pair() -> [Pose; 2] {
    [Pose::IDENTITY, turned(vec3(0.2, 1.0, 0.1), 0.2, vec3(-0.3, 0.1, 0.2))]
}

#[test]
fn a_drifted_view_of_a_corner_comes_back() {
    let truth = pair();
    for (axis, shift) in [
        (Vec3::X, vec3(0.05, 0.0, 0.0)),
        (Vec3::Y, vec3(0.0, 0.0, -0.05)),
        (Vec3::Z, vec3(0.0, -0.05, 0.0)),
        (vec3(-1.0, -1.0, 0.5), vec3(-0.03, 0.03, 0.03)),
    ] {
        let tracked = [truth[0], drifted(&truth[1], axis, 0.087, shift)];
        let [still, report] = register(CORNER, &truth, &tracked);
        assert_eq!((still.outcome, still.pose), (Outcome::Fixed, truth[0]));
        let (shift, turn) = error(&report.pose, &truth[1]);
        assert_eq!((report.outcome, report.unknown), (Outcome::Registered, 0), "{report:?}");
        assert!(shift < 5e-4 && turn < 3e-4, "{shift} m, {turn} rad");
        assert!(report.rms < 1e-3 && report.inliers > 0.9 && report.matched > 500, "{report:?}");
        assert!(report.unknown_directions().is_empty() && report.directions[0].information > 0.01);
    }
}

/// What of a correction moves the camera at right angles to `normal`, and turns it about `normal`.
fn along(report: &ViewReport, normal: Vec3) -> (f32, f32) {
    let shift = report.pose.translation() - report.tracked.translation();
    let turn = crate::ground::rotation::way(report.tracked.rotation(), report.pose.rotation());
    ((shift - normal * shift.dot(normal)).length(), turn.dot(normal).abs())
}

#[test]
fn along_a_single_plane_nothing_is_corrected() {
    let normal = vec3(0.0, 0.6, 0.8);
    let wall = [Plane([0.0, 0.6, 0.8], 2.0)];
    let truth = pair();
    let tracked = [truth[0], drifted(&truth[1], vec3(1.0, 1.0, 1.0), 0.06, vec3(0.03, 0.02, -0.03))];
    let [_, report] = register(&wall, &truth, &tracked);
    assert_eq!((report.outcome, report.unknown), (Outcome::Degenerate, 3), "{report:?}");
    let (shift, turn) = along(&report, normal);
    assert!(shift < 1e-3 && turn < 1e-3, "corrected by {shift} m in the plane and {turn} rad about its normal");
    // What the plane does tell is right: it lies where the other view sees it.
    for pixel in [(20.0, 20.0), (140.0, 20.0), (80.0, 100.0)] {
        let ray = camera().ray(pixel.into());
        let t = (2.0 - normal.dot(truth[1].translation())) / normal.dot(truth[1].direction_to_world(ray));
        assert!((normal.dot(report.pose.to_world(ray * t)) - 2.0).abs() < 1e-3);
    }
    for direction in report.unknown_directions() {
        assert!(direction.shift.dot(normal).abs() < 0.02, "{direction:?}");
        assert!(direction.turn.cross(normal).length() < 0.02, "{direction:?}");
    }
}

#[test]
fn along_an_edge_of_two_planes_nothing_is_corrected() {
    let things = [Plane([0.0, 1.0, 0.0], 0.8), Plane([0.0, 0.0, 1.0], 3.0)];
    let truth = pair();
    let tracked = [truth[0], drifted(&truth[1], Vec3::X, 0.04, vec3(0.04, 0.02, -0.03))];
    let [_, report] = register(&things, &truth, &tracked);
    assert_eq!((report.outcome, report.unknown), (Outcome::Degenerate, 1), "{report:?}");
    let [direction] = report.unknown_directions() else { panic!() };
    assert!(direction.shift.x.abs() > 0.99 && direction.turn.length() < 0.02, "{direction:?}");
    let left = report.pose.translation() - truth[1].translation();
    assert!((left.x - 0.04).abs() < 4e-3 && left.y.abs() < 1e-3 && left.z.abs() < 1e-3, "{left}");
    let (_, turn) = error(&report.pose, &truth[1]);
    assert!(turn < 1e-3, "{turn}");
}

#[test]
fn a_lone_ball_tells_no_turn_about_its_middle() {
    let things = [Sphere([0.0, 0.0, 2.0], 0.9)];
    let truth = [Pose::IDENTITY, Pose::new(Quat::IDENTITY, vec3(0.1, 0.0, 0.0)).unwrap()];
    let tracked = [truth[0], drifted(&truth[1], Vec3::Y, 0.01, vec3(0.02, 0.02, -0.02))];
    let [_, report] = register(&things, &truth, &tracked);
    assert_eq!((report.outcome, report.unknown), (Outcome::Degenerate, 3), "{report:?}");
    let middle = report.pose.to_world(truth[1].to_camera(vec3(0.0, 0.0, 2.0)));
    assert!((middle - vec3(0.0, 0.0, 2.0)).length() < 3e-3, "{middle}");
}

#[test]
fn views_in_a_ring_agree_all_together_and_far_from_the_origin() {
    for far in [Vec3::ZERO, vec3(9000.0, -3000.0, 7000.0)] {
        let poses = [0.0, 0.15, 0.3, -0.15, -0.3]
            .map(|a: f32| turned(vec3(0.1, 1.0, 0.0), a, vec3(-a, 0.1 * a, 0.2 * a.abs())));
        let mut seed = 0.0_f32;
        let tracked = poses.map(|p| {
            seed += 1.0;
            let v = |k: f32| vec3((seed * k).sin(), (seed * 2.0 * k).cos(), (seed * 3.0 * k).sin());
            let drift = if seed == 1.0 { 0.0 } else { 1.0 };
            let p = drifted(&p, v(1.0), 0.07 * drift, v(2.0) * (0.03 * drift));
            Pose::new(p.rotation(), p.translation() + far).unwrap()
        });
        let reports = register(CORNER, &poses, &tracked);
        for (report, truth) in reports.iter().zip(&poses).skip(1) {
            // World coordinates are multiples of a millimetre out there.
            let from = |p: &Pose| p.relative_to(&tracked[0]);
            let (shift, turn) = error(&from(&report.pose), &truth.relative_to(&poses[0]));
            let most = if far == Vec3::ZERO { 5e-4 } else { 2e-3 };
            assert!(report.outcome == Outcome::Registered && shift < most && turn < 4e-4, "{shift} {turn} {report:?}");
        }
    }
}

/// Two views share a corner, and with the first, which stays, only a wall: they are well known beside each other, but not in the
/// world.
#[test]
fn who_is_known_only_beside_the_unknown_is_not_known() {
    let truth = pair();
    let wall = render(&[Plane([0.0, 0.0, 1.0], 2.0)], &truth[0]);
    let corner = render(CORNER, &truth[1]);
    let mut memory = vec![0.0; 3 * scratch_len(SIZE.0, SIZE.1)];
    let mut registration = Registration::<3>::new(&mut memory, RegistrationParams::default());
    registration.set(0, &frame(&wall, &truth[0]), &DepthNoise::NONE).unwrap();
    let mut both = corner.clone();
    // The wall in the upper half, the corner in the lower.
    let wall_there = render(&[Plane([0.0, 0.0, 1.0], 2.0)], &truth[1]);
    both[..160 * 60].copy_from_slice(&wall_there[..160 * 60]);
    for slot in [1, 2] {
        let tracked = drifted(&truth[1], Vec3::Y, 0.01 * slot as f32, vec3(0.01, 0.0, 0.0));
        registration.set(slot, &frame(&both, &tracked), &DepthNoise::NONE).unwrap();
    }
    registration.start(&[0]).unwrap();
    assert_eq!(registration.step(usize::MAX), Progress::Done);
    for slot in [1, 2] {
        let report = registration.report(slot).unwrap();
        assert_eq!((report.outcome, report.unknown), (Outcome::Degenerate, 3), "{slot} {report:?}");
    }
}

#[test]
fn what_sees_nothing_in_common_stays() {
    let truth = [Pose::IDENTITY, turned(Vec3::Y, 3.1, Vec3::ZERO)];
    let things = [CORNER, &[Plane([0.0, 0.0, -1.0], 2.0)]].concat();
    let tracked = [truth[0], drifted(&truth[1], Vec3::Y, 0.02, Vec3::ZERO)];
    let [_, report] = register(&things, &truth, &tracked);
    assert_eq!((report.outcome, report.pose), (Outcome::NoOverlap, tracked[1]), "{report:?}");
    assert!(!report.outcome.is_corrected());
}

#[test]
fn a_correction_beyond_the_limit_is_not_believed() {
    let truth = pair();
    let tracked = drifted(&truth[1], Vec3::Y, 0.05, Vec3::ZERO);
    let depth = truth.map(|p| render(CORNER, &p));
    let mut memory = vec![0.0; 2 * scratch_len(SIZE.0, SIZE.1)];
    let params = RegistrationParams { max_turn: 0.04, ..RegistrationParams::default() };
    let mut registration = Registration::<2>::new(&mut memory, params);
    registration.set(0, &frame(&depth[0], &truth[0]), &DepthNoise::NONE).unwrap();
    registration.set(1, &frame(&depth[1], &tracked), &DepthNoise::NONE).unwrap();
    registration.start(&[0]).unwrap();
    registration.step(usize::MAX);
    let report = registration.report(1).unwrap();
    assert_eq!((report.outcome, report.pose), (Outcome::TooFar, tracked));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn however_it_is_sliced_the_result_is_the_same(
        pixels in proptest::collection::vec(1_usize..4000, 1..8), cells in proptest::collection::vec(1_usize..2000, 1..8),
        axis in proptest::array::uniform3(-1.0_f32..1.0),
    ) {
        let truth = pair();
        let axis = Vec3::from(axis).try_normalize().unwrap_or(Vec3::X);
        let tracked = [truth[0], drifted(&truth[1], axis, 0.05, axis * 0.03)];
        let whole = register(CORNER, &truth, &tracked);
        let mut memory = vec![0.0; 2 * scratch_len(SIZE.0, SIZE.1)];
        let mut sliced = Registration::<2>::new(&mut memory, RegistrationParams::default());
        let mut budgets = pixels.iter().cycle();
        for (i, (pose, seen)) in truth.iter().zip(&tracked).enumerate() {
            let depth = render(CORNER, pose);
            let frame = frame(&depth, seen);
            sliced.begin(i, &frame, &DepthNoise::NONE).unwrap();
            while sliced.fill(i, &frame, *budgets.next().unwrap()).unwrap() == Progress::Working {}
        }
        sliced.start(&[0]).unwrap();
        let mut budgets = cells.iter().cycle();
        while sliced.step(*budgets.next().unwrap()) == Progress::Working {}
        for (i, want) in whole.iter().enumerate() {
            prop_assert_eq!(sliced.report(i).unwrap(), *want);
        }
    }

    /// The sums of a row against the definition, in double precision.
    #[test]
    fn sums_are_those_of_the_definition(
        axis in proptest::array::uniform3(-1.0_f32..1.0), angle in 0.0_f32..0.1, scale in 0.002_f32..0.2,
        stride in 1_usize..4, seed in 1_u32..,
    ) {
        let depth = render(CORNER, &Pose::IDENTITY);
        let frame = frame(&depth, &Pose::IDENTITY);
        let grid = Grid::new(&frame, 4, &DepthNoise::NONE);
        let mut planes = vec![0.0_f32; 3 * grid.cells()];
        let (nx, rest) = planes.split_at_mut(grid.cells());
        let (ny, nz) = rest.split_at_mut(grid.cells());
        for row in 0..grid.rows {
            let at = row * grid.columns;
            let lines = [part(nx, at, grid.columns), part(ny, at, grid.columns), part(nz, at, grid.columns)];
            fit_row(&frame, &grid, row, lines, &mut Extent::default());
        }
        let cells = Cells { grid: &grid, nx, ny, nz };
        let axis = Vec3::from(axis).try_normalize().unwrap_or(Vec3::X);
        let (rotation, translation) = (Quat::from_axis_angle(axis, angle), axis * (angle * 0.7));
        let gates = Gates { distance: 0.3, cosine: 0.8, scale };
        let row = seed as usize % grid.rows;
        let mut sums = Sums::ZERO;
        add_row(cells, cells, rotation, translation, row, stride, &gates, &mut sums);

        let n = |i: usize| [nx[i], ny[i], nz[i]].map(f64::from);
        let m = Mat3::from_quat(rotation);
        let turn = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.to_array().map(f64::from));
        let rotate = |v: [f64; 3]| -> [f64; 3] {
            core::array::from_fn(|i| turn[0][i] * v[0] + turn[1][i] * v[1] + turn[2][i] * v[2])
        };
        let (mut h, mut g, mut matched, mut seen) = ([0.0_f64; 21], [0.0_f64; 6], 0, 0);
        for column in (stride / 2..grid.columns).step_by(stride) {
            let middle = |i: usize| (4 * i) as f64 + 1.5;
            let ray = [(middle(column) - 79.5) / 130.0, (middle(row) - 59.5) / 130.0, 1.0];
            let from = n(row * grid.columns + column);
            if from == [0.0; 3] { continue; }
            let z = 1.0 / dot(from, ray);
            let mut p = rotate(ray.map(|c| c * z));
            for (p, t) in p.iter_mut().zip(translation.to_array()) { *p += f64::from(t); }
            let (u, v) = ((p[0] / p[2] * 130.0 + 80.0) / 4.0, (p[1] / p[2] * 130.0 + 60.0) / 4.0);
            if u < 0.0 || v < 0.0 || u >= grid.columns as f64 || v >= grid.rows as f64 { continue; }
            let to = n(v as usize * grid.columns + u as usize);
            if to == [0.0; 3] { continue; }
            seen += 1;
            let size = dot(to, to).sqrt();
            let normal = to.map(|c| c / size);
            let r = dot(normal, p) - 1.0 / size;
            if r.abs() >= 0.3 || dot(rotate(from), normal) / dot(from, from).sqrt() <= 0.8 { continue; }
            matched += 1;
            let step = 1e-4 * f64::from(u16::ROUNDING);
            let one = |z: f64, n: [f64; 3]| step * step / 16.0 / dot(n, n) / (z * z);
            let s2 = one(z, from) + one(p[2], to) + f64::from(scale).powi(2) + 1e-8;
            let w = (1.0 - r * r / s2 / 4.685_f64.powi(2)).max(0.0).powi(2) / s2;
            let c = [p[1] * normal[2] - p[2] * normal[1], p[2] * normal[0] - p[0] * normal[2],
                     p[0] * normal[1] - p[1] * normal[0]];
            let j = [c[0], c[1], c[2], normal[0], normal[1], normal[2]];
            let mut k = 0;
            for a in 0..6 {
                g[a] += w * r * j[a];
                for b in a..6 { h[k] += w * j[a] * j[b]; k += 1; }
            }
        }
        // A point on the border of a cell may fall to either side.
        prop_assume!(seen == sums.seen && matched == sums.matched);
        // Relative to the weight: residuals keep 1e-6 m, which at a scale of 2 mm is 1e-3 of a weight's slope.
        let size = 1e-9 + h.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        for (got, want) in sums.h.iter().zip(h) {
            prop_assert!((got - want).abs() < 2e-3 * size, "{got} {want} of {size}");
        }
        for (got, want) in sums.g.iter().zip(g) {
            prop_assert!((got - want).abs() < 2e-3 * size * f64::from(scale) + 2e-6 * size, "{got} {want} of {size}");
        }
    }

    #[test]
    fn any_image_and_any_camera_end_without_panic(
        bits in proptest::collection::vec(any::<u32>(), 64..256), width in 1_usize..70, f in -8.0_f32..8.0,
        floats in 0_usize..4000, position in proptest::array::uniform3(any::<f32>()),
        params in proptest::array::uniform6(any::<f32>()),
    ) {
        let [max_distance, max_angle, min_information, max_shift, max_turn, min_inliers] = params;
        let params =
            RegistrationParams { max_distance, max_angle, min_information, max_shift, max_turn, min_inliers };
        let height = width;
        let depth: Vec<f32> = (0..width * height).map(|i| f32::from_bits(bits[i * 7 % bits.len()])).collect();
        let near: Vec<u16> = (0..width * height).map(|i| bits[i * 5 % bits.len()] as u16).collect();
        let focal = 10.0_f32.powf(f).clamp(1e-3, 1e7);
        let k = Intrinsics::new(focal, -focal, 1e6, -1.0).unwrap();
        let pose = Pose::new(Quat::IDENTITY, Vec3::from(position)).unwrap_or(Pose::IDENTITY);
        let mut memory = vec![f32::NAN; floats];
        let mut registration = Registration::<3>::new(&mut memory, params);
        let view = ImageView::new(&depth, width, height).unwrap();
        let frame = DepthFrame::new(view, DepthUnit::METRE, k);
        let other = DepthFrame::new(ImageView::new(&near, width, height).unwrap(), UNIT, k);
        let noise = DepthNoise { constant: position[0], ..DepthNoise::KINECT };
        let _ = registration.set(0, &frame.with_pose(pose), &noise);
        let _ = registration.set(1, &other.with_pose(Pose::IDENTITY), &DepthNoise::NONE);
        let _ = registration.set(2, &other.with_pose(Pose::IDENTITY), &DepthNoise::NONE);
        let _ = registration.start(&[1, 7]);
        let mut steps = 0;
        while registration.step(2000) == Progress::Working {
            steps += 1;
            prop_assert!(steps < 10_000, "it ends");
        }
        for slot in 0..4 {
            if let Some(report) = registration.report(slot) {
                prop_assert!(report.pose.translation().is_finite() && report.pose.rotation().is_finite());
            }
        }
    }
}

#[test]
fn wrong_calls_are_errors() {
    let depth = render(CORNER, &Pose::IDENTITY);
    let frame = frame(&depth, &Pose::IDENTITY);
    let mut memory = vec![0.0; 2 * scratch_len(SIZE.0, SIZE.1)];
    let mut two = Registration::<2>::new(&mut memory, RegistrationParams::default());
    assert_eq!(two.start(&[0]), Err(RegistrationError::NothingFixed));
    assert_eq!(two.set(2, &frame, &DepthNoise::NONE), Err(RegistrationError::Slot { slot: 2, slots: 2 }));
    let bare = DepthFrame::new(frame.depth(), UNIT, camera());
    assert_eq!(two.set(0, &bare, &DepthNoise::NONE), Err(RegistrationError::NoPose));
    two.begin(0, &frame, &DepthNoise::NONE).unwrap();
    assert_eq!(two.start(&[0]), Err(RegistrationError::NothingFixed), "not filled yet");
    let other = DepthFrame::new(frame.depth().crop(0, 0, 100, 100), UNIT, camera());
    assert_eq!(two.fill(0, &other, 1), Err(RegistrationError::OtherFrame));
    let empty = DepthFrame::new(ImageView::<u16>::EMPTY, UNIT, camera()).with_pose(Pose::IDENTITY);
    assert!(matches!(two.set(1, &empty, &DepthNoise::NONE), Err(RegistrationError::TooSmall { .. })));
    assert_eq!((two.step(1), two.report(0)), (Progress::Done, None));
    two.set(0, &frame, &DepthNoise::NONE).unwrap();
    two.start(&[0]).unwrap();
    two.step(usize::MAX);
    assert_eq!(two.report(0).map(|r| r.outcome), Some(Outcome::Fixed));
    assert_eq!(two.report(1), None);
    assert!(two.set_pose(0, Pose::IDENTITY) && !two.set_pose(1, Pose::IDENTITY));
    two.clear(0);
    assert_eq!(two.start(&[0]), Err(RegistrationError::NothingFixed));
    let mut none = Registration::<0>::new(&mut [], RegistrationParams::default());
    assert_eq!((none.step(1), none.start(&[])), (Progress::Done, Err(RegistrationError::NothingFixed)));
    for e in [RegistrationError::NoPose, RegistrationError::OtherFrame, RegistrationError::NothingFixed] {
        let e: Box<dyn core::error::Error> = Box::new(e);
        assert!(!std::format!("{e}").is_empty());
    }
}

/// Half the memory: cells twice as wide, the same answer.
#[test]
fn less_memory_makes_larger_cells() {
    let truth = pair();
    let tracked = [truth[0], drifted(&truth[1], Vec3::Y, 0.05, vec3(0.03, 0.0, 0.02))];
    let mut memory = vec![0.0; scratch_len(SIZE.0, SIZE.1)];
    let mut registration = Registration::<2>::new(&mut memory, RegistrationParams::default());
    for (i, (pose, seen)) in truth.iter().zip(&tracked).enumerate() {
        let depth = render(CORNER, pose);
        registration.set(i, &frame(&depth, seen), &DepthNoise::NONE).unwrap();
    }
    registration.start(&[0]).unwrap();
    registration.step(usize::MAX);
    let report = registration.report(1).unwrap();
    let (shift, turn) = error(&report.pose, &truth[1]);
    assert!(report.outcome == Outcome::Registered && shift < 2e-3 && turn < 1e-3, "{shift} {turn} {report:?}");
}

#[test]
fn sizes_are_as_stated() {
    assert_eq!(scratch_len(1024, 768) * 4, 36 << 10);
    assert_eq!((scratch_len(640, 480), scratch_len(160, 120), scratch_len(0, 9)), (14_400, 3600, 0));
    let sizes = [size_of::<Registration<'_, 2>>(), size_of::<Registration<'_, 5>>(), size_of::<Registration<'_, 8>>()];
    // On 64 bits; a little less on devices.
    assert!(sizes[0] <= 7 << 10 && sizes[1] <= 19 << 10 && sizes[2] <= 37 << 10, "{sizes:?}");
}
