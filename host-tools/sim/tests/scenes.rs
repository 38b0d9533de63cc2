//! Depth and normals against closed forms; every named scene renders; broken scene files are refused with a clear word.

use std::path::Path;

use isobath_sim::{GroundTruth, NAMES, Rigid, Scene, SimCamera, V3, v3};

fn camera() -> SimCamera {
    SimCamera::from_fov(64, 48, 1.1).unwrap()
}

fn look(name: &str) -> (Scene, Rigid, GroundTruth) {
    let scene = Scene::open(name).unwrap();
    let pose = Rigid::looking_at(scene.view().eye, scene.view().target);
    let truth = scene.render_geometry(0.0, &scene.camera(64, 48).unwrap(), &pose);
    (scene, pose, truth)
}

#[test]
fn planes_are_exact_to_a_nanometre() {
    // (scene, segment, a point of the plane, its normal)
    let planes = [
        ("wall", "wall", v3(0.0, 0.0, -2.0), v3(0.0, 0.0, 1.0)),
        ("tilted", "plane", v3(0.0, 1.5, -2.0), v3(0.5, 0.5, 0.5_f64.sqrt())),
        ("corner", "floor", V3::ZERO, V3::UP),
        ("corner", "back wall", v3(0.0, 0.0, -2.0), v3(0.0, 0.0, 1.0)),
        ("corner", "left wall", v3(-2.0, 0.0, 0.0), v3(1.0, 0.0, 0.0)),
        ("living-room", "floor", V3::ZERO, V3::UP),
    ];
    for (name, segment, point, normal) in planes {
        let (scene, pose, truth) = look(name);
        let id = scene.segments().iter().position(|s| s == segment).unwrap() as u16 + 1;
        let k = camera();
        let (mut seen, mut worst) = (0, 0.0_f64);
        for i in 0..truth.z.len() {
            if truth.segments[i] != id {
                continue;
            }
            seen += 1;
            // The oracle: pixel to ray to plane, by the textbook.
            let (x, y) = ((i % 64) as f64, (i / 64) as f64);
            let ray = v3((x - k.cx) / k.fx, (y - k.cy) / k.fy, 1.0);
            let n = pose.rotation.undo(normal);
            let z = n.dot(pose.undo_point(point)) / n.dot(ray);
            worst = worst.max((truth.z[i] - z).abs());
            assert!((truth.z[i] - z).abs() < 1e-9, "{name} {segment}: {} {z}", truth.z[i]);
            let got = V3::from(truth.normals[i].map(f64::from));
            assert!((got - n).length() < 1e-7, "{name} {segment}: {got:?} {n:?}");
            assert!(got.dot(ray) < 0.0, "normals face the camera");
        }
        println!("{name} {segment}: {seen} pixels, off by at most {worst:e} m");
        assert!(seen > 100, "{name} {segment}: {seen} pixels");
    }
}

#[test]
fn spheres_are_exact() {
    let (scene, pose, truth) = look("sphere");
    let id = scene.segments().iter().position(|s| s == "sphere").unwrap() as u16 + 1;
    let (k, centre) = (camera(), v3(0.0, 0.5, -2.0));
    let mut seen = 0;
    for i in (0..truth.z.len()).filter(|&i| truth.segments[i] == id) {
        seen += 1;
        let ray = k.ray((i % 64) as f64, (i / 64) as f64).unwrap();
        let p = pose.point(ray * truth.z[i]);
        assert!(((p - centre).length() - 0.5).abs() < 1e-12);
        let n = pose.rotation.undo((p - centre) * 2.0);
        assert!((n - V3::from(truth.normals[i].map(f64::from))).length() < 1e-7);
    }
    assert!(seen > 300);
}

#[test]
fn every_named_scene_is_furnished() {
    for name in NAMES {
        let (scene, pose, truth) = look(name);
        assert_eq!(scene.name(), *name);
        assert!(!scene.about().is_empty() && !scene.places().is_empty(), "{name}");
        let holes = truth.z.iter().filter(|&&z| z == 0.0).count();
        // Bodies in empty space have empty space around them.
        let most = if name.starts_with("facets") { 9 } else { 2 };
        assert!(holes < truth.z.len() * most / 10, "{name}: {holes} holes");
        for i in 0..truth.z.len() {
            let n = V3::from(truth.normals[i].map(f64::from)).length();
            let there = truth.z[i] > 0.0;
            assert!(truth.z[i].is_finite() && there == (truth.segments[i] > 0));
            assert!(if there { (n - 1.0).abs() < 1e-6 } else { n == 0.0 });
        }
        let colour = scene.render_colour(0.0, &scene.camera(64, 48).unwrap(), &pose, 1);
        let mean = colour.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3.0 * 64.0 * 48.0);
        assert!(mean * scene.exposure() > 0.05 && mean * scene.exposure() < 2.0, "{name}: mean {mean}");
        assert!(colour.pixels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    }
    assert!(Scene::open("living-room").unwrap().segments().len() > 25);
    assert_eq!(Scene::open("living-room").unwrap().places().len(), 10);
}

#[test]
fn only_the_door_moves() {
    for name in NAMES {
        let (scene, pose, truth) = look(name);
        let later = scene.render_geometry(2.0, &scene.camera(64, 48).unwrap(), &pose);
        assert_eq!(scene.moves(), *name == "door");
        assert_eq!(truth != later, *name == "door", "{name}");
    }
    let (scene, pose, truth) = look("door");
    assert_eq!(truth, scene.render_geometry(6.0, &scene.camera(64, 48).unwrap(), &pose), "it repeats after 6 s");
}

#[test]
fn an_environment_map_agrees_with_a_camera() {
    let scene = Scene::open("desk").unwrap();
    let at = scene.places()["desk top"];
    let map = scene.environment_map(0.0, at, 256, 2);
    assert_eq!((map.width, map.height), (256, 128));
    let forward = Rigid::looking_at(at, at + v3(0.3, 0.2, -1.0));
    let picture = scene.render_colour(0.0, &camera(), &forward, 2);
    let mut close = 0;
    for y in 0..48 {
        for x in 0..64 {
            let d = forward.rotation.apply(camera().ray(x as f64, y as f64).unwrap());
            let (a, b) = (map.towards(d), V3::from(picture.get(x, y).map(f64::from)));
            close += usize::from((a - b).length() < 0.05 + 0.1 * b.length());
        }
    }
    assert!(close > 64 * 48 * 85 / 100, "{close}");
}

/// What a scene file says that it should not, and a word that the complaint must hold.
const BROKEN: &[(&str, &str)] = &[
    ("", "missing field `about`"),
    ("about = 3", "invalid type"),
    ("about = \"\"\nview = { eye = [0,0,0], target = [0,0,0] }", "same point"),
    ("about = \"\"\nview = { eye = [nan,0,0], target = [0,0,1] }", "eye"),
    ("about = \"\"\nview = { eye = [0,0,0], target = [0,0,1] }\nfog = 1", "unknown field `fog`"),
    (
        "OK object = [{ name = \"a\", shape = { sphere = { radius = 1 } }, material = \"gold\" }]",
        "no material \"gold\"",
    ),
    (
        "OK object = [{ name = \"a\", shape = { sphere = { radius = -1 } }, material = \"m\" }]",
        "object \"a\": radius is -1",
    ),
    ("OK object = [{ name = \"a\", shape = { sphere = { radius = nan } }, material = \"m\" }]", "radius is NaN"),
    ("OK object = [{ name = \"a\", shape = { cone = { radius = 1 } }, material = \"m\" }]", "unknown variant `cone`"),
    ("OK object = [{ name = \"a\", shape = { box = { size = [1, 1] } }, material = \"m\" }]", "array"),
    ("OK object = [{ name = \"a\", shape = { box = { size = [1, inf, 1] } }, material = \"m\" }]", "size is inf"),
    ("OK object = [{ name = \"a\", shape = { plane = { normal = [0, 0, 0] } }, material = \"m\" }]", "direction"),
    (
        "OK object = [{ name = \"a\", shape = { capsule = { radius = 1, height = 1 } }, material = \"m\" }]",
        "both round ends",
    ),
    ("OK object = [{ name = \"a\", shape = { waves = { size = [1, 1], waves = [] } }, material = \"m\" }]", "0 waves"),
    ("OK object = [{ name = \"a\", shape = { mesh = { file = \"no.obj\" } }, material = \"m\" }]", "no.obj"),
    (
        "OK object = [{ name = \"a\", shape = { polyhedron = { radius = 1, faces = 7 } }, material = \"m\" }]",
        "4, 6, 8, 12 or 20",
    ),
    (
        "OK object = [{ name = \"a\", shape = { polyhedron = { radius = 1, faces = 4, seed = 3 } }, material = \"m\" }]",
        "another seed",
    ),
    (
        "OK object = [{ name = \"a\", shape = { torus_knot = { radius = 1, tube = 0.1, winds = [2, 0], facets = [9, 9] } }, material = \"m\" }]",
        "1 to 50",
    ),
    (
        "OK object = [{ name = \"a\", shape = { torus_knot = { radius = 1, tube = 0.1, winds = [2, 3], facets = [2, 9] } }, material = \"m\" }]",
        "rings and sides",
    ),
    ("OK object = [{ name = \"a\", shape = { icosphere = { radius = 1, level = 9 } }, material = \"m\" }]", "0 to 7"),
    ("OK unit = 0", "unit is 0"),
    (
        "OK object = [{ name = \"a\", shape = { sphere = { radius = 1 } }, material = \"m\", group = \"g\" }]",
        "no group \"g\"",
    ),
    (
        "OK object = [{ name = \"a\", shape = { sphere = { radius = 1 } }, material = \"m\", at = [1e300, 0, 0] }]",
        "1e300",
    ),
    ("OK light = [{ point = { at = [0, 0, 0], intensity = [-1, 0, 0] } }]", "light 1 (intensity)"),
    ("OK light = [{ area = { at = [0,0,0], size = [1,1], radiance = [1,1,1], samples = 200 } }]", "samples"),
    ("OK [groups.g]\nkeys = [{ time = 2 }, { time = 1 }]", "must grow"),
    ("OK [groups.g]\nkeys = [{ time = nan }]", "time"),
    ("OK [surroundings]\nhdr = { file = \"/nowhere.hdr\" }", "/nowhere.hdr"),
    ("OK [materials.x]\nmirror = 2", "mirror is 2"),
    ("OK [materials.x]\npattern = { checker = { colour = [0,0,0], size = 0 } }", "checker size"),
];

#[test]
fn broken_scenes_say_what_is_wrong() {
    for (text, word) in BROKEN {
        let head = "about = \"\"\nview = { eye = [0,0,0], target = [0,0,1] }\n";
        let text = text.strip_prefix("OK ").map_or((*text).to_owned(), |rest| {
            let materials = "\n[materials.m]\n";
            if rest.starts_with('[') {
                format!("{head}{materials}\n{rest}")
            } else {
                format!("{head}{rest}{materials}")
            }
        });
        let error = Scene::parse("mine.toml", &text, Path::new(".")).unwrap_err().to_string();
        assert!(error.contains(word), "{text}\n-> {error}\nshould hold {word:?}");
        assert!(error.contains("mine.toml") || error.contains("no.obj") || error.contains("nowhere"), "{error}");
    }
    let error = Scene::open("attic").unwrap_err().to_string();
    assert!(error.contains("attic") && error.contains("living-room"), "{error}");
    assert!(Scene::open("nowhere/attic.toml").unwrap_err().to_string().contains("attic.toml"));
}

#[test]
fn meshes_and_textures_come_from_files() {
    let dir = tempfile::tempdir().unwrap();
    // A unit square standing at z = 0, as two triangles.
    let obj = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";
    std::fs::write(dir.path().join("square.obj"), obj).unwrap();
    let mut texture = image::RgbImage::new(2, 2);
    texture.put_pixel(0, 0, image::Rgb([255, 0, 0]));
    texture.save(dir.path().join("texture.png")).unwrap();
    let text = r#"
        about = "a square"
        view = { eye = [0, 0, 3], target = [0, 0, 0] }
        ambient = { up = [1, 1, 1], down = [1, 1, 1] }
        object = [{ name = "square", shape = { mesh = { file = "square.obj", scale = 2.0 } }, material = "m", at = [0, 0, 0.5] }]
        [materials.m]
        colour = [1, 1, 1]
        pattern = { image = { file = "texture.png" } }
    "#;
    let scene = Scene::parse("square", text, dir.path()).unwrap();
    let pose = Rigid::looking_at(scene.view().eye, scene.view().target);
    let (truth, colour) = scene.render(0.0, &camera(), &pose);
    assert!(truth.z.iter().all(|&z| (z - 2.5).abs() < 1e-12));
    assert!(truth.normals.iter().all(|n| n[2] == -1.0));
    // Seen from the front, u grows to the right and v downwards: red is the upper left quarter.
    assert!(colour.get(10, 10)[0] > 0.9 && colour.get(50, 10)[0] < 0.1 && colour.get(10, 40)[0] < 0.1);
}

#[test]
fn hdr_surroundings_are_seen_where_they_lie() {
    let dir = tempfile::tempdir().unwrap();
    // Red ahead (-z), green to the right (+x), blue behind; white above.
    let mut sky = isobath_sim::LinearImage::filled(64, 32, [0.0; 3]);
    for (i, p) in sky.pixels.iter_mut().enumerate() {
        let (x, y) = (i % 64, i / 64);
        *p = match x {
            _ if y < 4 => [2.0; 3],
            24..40 => [4.0, 0.0, 0.0],
            40..56 => [0.0, 1.0, 0.0],
            0..8 | 56.. => [0.0, 0.0, 1.0],
            _ => [0.0; 3],
        };
    }
    for file in ["sky.hdr", "sky.exr"] {
        isobath_sim::write_linear(&sky, &dir.path().join(file)).unwrap();
        surroundings_lie_right(&sky, dir.path(), file);
    }
}

fn surroundings_lie_right(sky: &isobath_sim::LinearImage, folder: &Path, file: &str) {
    let scene = |turn: f64| {
        let text = format!(
            "about = \"sky\"\nview = {{ eye = [0, 0, 0], target = [0, 0, -1] }}\n\
             surroundings = {{ hdr = {{ file = \"{file}\", turn = {turn}, scale = 0.5 }} }}\n"
        );
        Scene::parse("sky", &text, folder).unwrap()
    };
    let seen = |turn: f64, target: V3| {
        let view = Rigid::looking_at(V3::ZERO, target);
        scene(turn).render_colour(0.0, &camera(), &view, 1).get(32, 24)
    };
    assert_eq!(seen(0.0, v3(0.0, 0.0, -1.0)), [2.0, 0.0, 0.0]);
    assert_eq!(seen(0.0, v3(1.0, 0.0, 0.0)), [0.0, 0.5, 0.0]);
    assert_eq!(seen(0.0, v3(0.0, 0.0, 1.0)), [0.0, 0.0, 0.5]);
    assert_eq!(seen(0.0, V3::UP), [1.0; 3]);
    // Turned by a right angle to the left, what was ahead is on the left.
    assert_eq!(seen(90.0, v3(-1.0, 0.0, 0.0)), [2.0, 0.0, 0.0]);
    let map = scene(0.0).environment_map(0.0, V3::ZERO, 64, 1);
    assert!(map.pixels.iter().zip(&sky.pixels).all(|(a, b)| (0..3).all(|i| (a[i] - 0.5 * b[i]).abs() < 0.02)));
}
