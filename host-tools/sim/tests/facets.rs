//! The scenes of the 3F2N kind: flat facets, sharp edges, a long lens, depth in no particular unit. What is held is what the published
//! frames have (`shared/data/d2nt_3f2n_normals`, measured): 83,000 and 103,000 of 307,200 pixels on the object, depth 160 to 212, and of
//! the object's pixels 32 and 35 % beside an edge.

use std::path::Path;

use isobath::ground::image::ImageView;
use isobath::localized::normals::NormalParams;
use isobath::localized::normals::dense::{rows, scratch_len};
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::frame::DepthFrame;
use isobath_sim::{GroundTruth, Rigid, Scene, SimCamera, SimOptions, Simulation, V3};

const SIZE: (usize, usize) = (640, 480);

fn look(name: &str) -> (SimCamera, GroundTruth) {
    let scene = Scene::open(name).unwrap();
    let camera = scene.camera(SIZE.0, SIZE.1).unwrap();
    let pose = Rigid::looking_at(scene.view().eye, scene.view().target);
    (camera, scene.render_geometry(0.0, &camera, &pose))
}

fn normal(truth: &GroundTruth, i: usize) -> V3 {
    V3::from(truth.normals[i].map(f64::from))
}

/// Pairs of horizontal and vertical neighbours on the object.
fn pairs(truth: &GroundTruth) -> impl Iterator<Item = (usize, usize)> + '_ {
    let on = |i: usize| truth.z[i] > 0.0;
    let inner = move |i: usize| i % SIZE.0 + 1 < SIZE.0 && i / SIZE.0 + 1 < SIZE.1;
    (0..truth.z.len())
        .filter(move |&i| inner(i) && on(i))
        .flat_map(move |i| [(i, i + 1), (i, i + SIZE.0)].into_iter().filter(move |(_, j)| on(*j)))
}

#[test]
fn they_are_seen_as_the_published_frames_are_and_grow_harder() {
    let mut shares = Vec::new();
    for name in ["facets-easy", "facets-medium", "facets-hard"] {
        let (camera, truth) = look(name);
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (1400.0, 1380.0, 349.5, 249.5));
        let seen = truth.z.iter().filter(|z| **z > 0.0).count();
        let (low, high) =
            truth.z.iter().filter(|z| **z > 0.0).fold((f64::MAX, 0.0_f64), |(l, h), &z| (l.min(z), h.max(z)));
        let mut beside = vec![false; truth.z.len()];
        for (i, j) in pairs(&truth) {
            // Two degrees (the smooth ball turns by one a pixel), or another body.
            if (normal(&truth, i) - normal(&truth, j)).length() > 0.035 || truth.segments[i] != truth.segments[j] {
                (beside[i], beside[j]) = (true, true);
            }
        }
        let share = beside.iter().filter(|b| **b).count() as f64 / seen as f64;
        println!("{name}: {seen} pixels, depth {low:.1} to {high:.1}, {:.1} % beside an edge", 100.0 * share);
        assert!((70_000..140_000).contains(&seen) && low > 130.0 && high < 230.0, "{name}: {seen} {low} {high}");
        shares.push(share);
    }
    let [easy, medium, hard] = shares[..] else { panic!("three scenes") };
    assert!(easy < 0.12, "{easy}");
    assert!((0.25..0.50).contains(&medium), "{medium}");
    assert!(hard > 0.60, "{hard}");
}

#[test]
fn truth_is_flat_facets_to_the_last_bit() {
    for name in ["facets-medium", "facets-hard"] {
        let (camera, truth) = look(name);
        let at = |i: usize| camera.ray((i % SIZE.0) as f64, (i / SIZE.0) as f64).unwrap() * truth.z[i];
        let (mut flat, mut worst) = (0, 0.0_f64);
        for (i, j) in pairs(&truth) {
            // One facet has one normal: smooth shading would never repeat.
            if truth.normals[i] != truth.normals[j] {
                continue;
            }
            flat += 1;
            let d = at(j) - at(i);
            // The normal is rounded to f32, six parts in 1e8.
            worst = worst.max(d.dot(normal(&truth, i)).abs() / d.length());
        }
        println!("{name}: {flat} pairs on one facet, at most {worst:e} out of its plane");
        assert!(flat > 60_000 && worst < 1e-7, "{name}: {flat} {worst:e}");
    }
}

#[test]
fn exact_faces_and_meshes_of_them_agree() {
    // A cube as a box, as six half-spaces, and as the triangles of a file.
    let dir = tempfile::tempdir().unwrap();
    let obj = "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
               f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    std::fs::write(dir.path().join("cube.obj"), obj).unwrap();
    let seen = [
        "box = { size = [20, 20, 20] }",
        "polyhedron = { faces = 6, radius = 10 }",
        "mesh = { file = \"cube.obj\", scale = 10 }",
    ]
    .map(|shape| {
        let text = format!(
            "about = \"a cube\"\nview = {{ eye = [60, 80, 150], target = [0, 0, 0] }}\n\
             object = [{{ name = \"cube\", shape = {{ {shape} }}, turn = [12, 34, 56], material = \"m\" }}]\n[materials.m]\n"
        );
        let scene = Scene::parse("cube", &text, Path::new(dir.path())).unwrap();
        let camera = SimCamera::from_fov(160, 120, 0.25).unwrap();
        scene.render_geometry(0.0, &camera, &Rigid::looking_at(scene.view().eye, scene.view().target))
    });
    let [cuboid, others @ ..] = &seen;
    assert!(cuboid.z.iter().filter(|z| **z > 0.0).count() > 4000);
    for other in others {
        for i in 0..cuboid.z.len() {
            assert!((cuboid.z[i] - other.z[i]).abs() < 1e-9, "{i}: {} {}", cuboid.z[i], other.z[i]);
            assert!((normal(cuboid, i) - normal(other, i)).length() < 1e-6);
        }
    }
}

#[test]
fn recordings_of_them_hold_their_whole_depth() {
    let simulation = Simulation::open("facets-hard", SimOptions { size: (160, 120), ..SimOptions::default() }).unwrap();
    assert!((simulation.unit() - 0.004).abs() < 1e-9, "steps of the scene's own");
    let frame = simulation.frame(3);
    for (steps, z) in frame.depth_u16(simulation.unit()).iter().zip(&frame.truth.z) {
        assert!((f64::from(*steps) * simulation.unit() - z).abs() <= 0.0021, "{steps} {z}");
    }
    let camera = simulation.depth_camera();
    assert_eq!((camera.fx, camera.fy, camera.cx), (350.0, 345.0, 87.0));
}

/// Mean and median angle in degrees between the core's normals and the truth, over the object's pixels.
fn errors(camera: &SimCamera, truth: &GroundTruth, params: &NormalParams) -> (f64, f64) {
    let depth = truth.depth_f32();
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32);
    let intrinsics = Intrinsics::new(fx, fy, cx, cy).unwrap();
    let frame = DepthFrame::new(ImageView::new(&depth, SIZE.0, SIZE.1).unwrap(), DepthUnit::METRE, intrinsics);
    let mut scratch = vec![0.0; scratch_len(SIZE.0)];
    let mut errors = Vec::new();
    rows(&frame, params, &mut scratch, |y, row| {
        for x in (0..SIZE.0).filter(|x| truth.z[y * SIZE.0 + x] > 0.0) {
            let (n, t) = (V3::from([row.x[x], row.y[x], row.z[x]].map(f64::from)), normal(truth, y * SIZE.0 + x));
            // No answer is as wrong as can be.
            let angle = libm::atan2(n.cross(t).length(), n.dot(t)).to_degrees();
            errors.push(if angle.is_finite() { angle } else { 180.0 });
        }
    })
    .unwrap();
    errors.sort_by(f64::total_cmp);
    (errors.iter().sum::<f64>() / errors.len() as f64, errors[errors.len() / 2])
}

#[test]
fn normals_can_be_compared_on_them() {
    let mut last = 0.0;
    for (name, most) in [("facets-easy", 0.08), ("facets-medium", 0.5), ("facets-hard", 2.3)] {
        let (camera, truth) = look(name);
        let (mean, median) = errors(&camera, &truth, &NormalParams::default());
        let (paper_mean, paper_median) = errors(&camera, &truth, &NormalParams::PAPER);
        println!("{name}: exact mean {mean:.3} median {median:.4}; paper {paper_mean:.2}, {paper_median:.2} degrees");
        assert!(mean < most && mean < paper_mean && mean > last, "{name}: {mean} {paper_mean}");
        last = mean;
    }
}
