//! What is written reads back as what was simulated; the same seed gives the same bytes.

use std::path::Path;

use isobath_recording::{OpenOptions, open};
use isobath_sim::{
    CameraPath, ImuModel, LinearImage, NAMES, PoseNoise, Scene, SimOptions, SimSource, Simulation, V3, orbit_stations,
    read_linear, write_linear, write_recording,
};
use isobath_source::{Deadline, DepthSource, Outcome, OwnedFrame, Recording, SourceError};

fn small(sensor: &str) -> SimOptions {
    SimOptions { size: (48, 36), frames: 3, sensor: sensor.parse().unwrap(), environment: 0, ..SimOptions::default() }
}

/// Frame by frame: the folder as `isobath_recording` reads it against the source.
fn compare(scene: &str, options: &SimOptions, folder: &Path) {
    let mut steps = Vec::new();
    let summary = write_recording(&Scene::open(scene).unwrap(), options, folder, |a, b| steps.push((a, b))).unwrap();
    let last = summary.frames + summary.environment_maps;
    assert_eq!(steps.last(), Some(&(last, last)));
    let mut files = open(folder, &OpenOptions::default()).unwrap();
    let mut source = SimSource::open(&format!("sim:{scene}"), options.clone()).unwrap();
    assert_eq!(files.len(), source.len());
    assert_eq!(files.info().up, source.info().up);
    let (mut a, mut b) = (OwnedFrame::new(), OwnedFrame::new());
    for i in 0..source.len() {
        assert_eq!(files.next_into(&mut a, Deadline::NEVER).unwrap(), Outcome::Frame);
        assert_eq!(source.next_into(&mut b, Deadline::NEVER).unwrap(), Outcome::Frame);
        assert!(a.notes.is_empty(), "{:?}", a.notes);
        assert_eq!(a.depth(), b.depth(), "{scene} frame {i}");
        assert_eq!((a.unit, a.intrinsics, a.time), (b.unit, b.intrinsics, b.time));
        let (p, q) = (a.pose.unwrap(), b.pose.unwrap());
        assert!((p.translation() - q.translation()).length() < 1e-6);
        assert!(p.rotation().dot(q.rotation()).abs() > 1.0 - 1e-6);
        let (c, d) = (a.colour(), b.colour());
        assert_eq!(c.is_some(), options.colour);
        if let (Some(c), Some(d)) = (c, d) {
            assert!(c.rows().flatten().eq(d.rows().flatten()));
        }
    }
    assert_eq!(files.next_into(&mut a, Deadline::NEVER).unwrap(), Outcome::EndOfStream);
}

#[test]
fn folders_read_back_as_simulated() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    compare("living-room", &small("kinect"), &at("plain"));
    let noisy = SimOptions {
        unit: Some(0.001),
        colour_size: Some((96, 54)),
        pose_noise: PoseNoise::PHONE,
        imu: ImuModel::PHONE,
        seed: 9,
        ..small("tof+rolling")
    };
    compare("door", &noisy, &at("noisy"));
    assert!(at("noisy/confidence/000002.png").is_file() && at("noisy/reported.txt").is_file());
    let lens = SimOptions { lens: [-0.2, 0.05, 0.001, -0.0005, 0.0, 0.0, 0.0, 0.0], ..small("quantised:0.002") };
    compare("desk", &lens, &at("lens"));
    compare("corner", &SimOptions { colour: false, ..small("stereo") }, &at("no-colour"));
    compare("living-room", &SimOptions { path: CameraPath::Stations, frames: 5, ..small("kinect") }, &at("stations"));
    assert!(!at("stations/imu.csv").is_file(), "jumps have no IMU");
}

#[test]
fn ground_truth_lies_beside_the_recording() {
    let dir = tempfile::tempdir().unwrap();
    let options = SimOptions { environment: 32, frames: 2, ..small("kinect") };
    let summary = write_recording(&Scene::open("living-room").unwrap(), &options, dir.path(), |_, _| {}).unwrap();
    assert_eq!((summary.frames, summary.environment_maps), (2, 10));
    let simulation = Simulation::open("living-room", options).unwrap();
    let frame = simulation.frame(1);
    let read =
        |name: &str| isobath_recording::parse::parse_npy(&std::fs::read(dir.path().join(name)).unwrap()).unwrap();
    let depth = read("truth/depth-000001.npy");
    assert_eq!((depth.width, depth.height), (48, 36));
    assert_eq!(depth.data, isobath_recording::parse::NpyData::F32(frame.truth.depth_f32()));
    let normals = std::fs::read(dir.path().join("truth/normals-000001.npy")).unwrap();
    assert!(String::from_utf8_lossy(&normals[..128]).contains("(36, 48, 3)") && normals.len() == 128 + 36 * 48 * 12);
    let segments = image::open(dir.path().join("truth/segments-000001.png")).unwrap().to_luma16();
    assert_eq!(segments.as_raw(), &frame.truth.segments);
    let names = std::fs::read_to_string(dir.path().join("truth/segments.txt")).unwrap();
    assert!(names.lines().count() == simulation.scene().segments().len() + 2 && names.contains(" sofa\n"));
    let map = read_linear(&dir.path().join("truth/environment/table.exr")).unwrap();
    assert_eq!(map, simulation.scene().environment_map(0.0, simulation.scene().places()["table"], 32, 2));
    assert_eq!(read_linear(&dir.path().join("truth/radiance-000001.exr")).unwrap(), frame.radiance);
    let imu = std::fs::read_to_string(dir.path().join("imu.csv")).unwrap();
    assert_eq!(imu.lines().count(), 1 + 7, "33 ms at 200 Hz, and the header");
}

#[test]
fn linear_images_survive_their_files() {
    let dir = tempfile::tempdir().unwrap();
    let mut image = LinearImage::filled(19, 7, [0.0; 3]);
    for (i, p) in image.pixels.iter_mut().enumerate() {
        *p = [i as f32 * 0.01, 1000.0 / (1.0 + i as f32), 0.5];
    }
    for ending in ["exr", "hdr", "npy"] {
        write_linear(&image, &dir.path().join("a").with_extension(ending)).unwrap();
    }
    assert_eq!(read_linear(&dir.path().join("a.exr")).unwrap(), image, "to the last bit");
    let npy = std::fs::read(dir.path().join("a.npy")).unwrap();
    assert!(String::from_utf8_lossy(&npy[..128]).contains("(7, 19, 3)") && npy.len() == 128 + 7 * 19 * 12);
    assert!(write_linear(&image, &dir.path().join("a.png")).unwrap_err().to_string().contains(".exr"));
    let back = read_linear(&dir.path().join("a.hdr")).unwrap();
    for (a, b) in image.pixels.iter().zip(&back.pixels) {
        let most = a.iter().copied().fold(0.0, f32::max);
        assert!((0..3).all(|i| (a[i] - b[i]).abs() <= most / 128.0), "{a:?} {b:?}");
    }
}

#[test]
fn sources_seek_and_end_like_recordings() {
    let mut source = SimSource::open("sphere", small("none")).unwrap();
    let (mut first, mut again) = (OwnedFrame::new(), OwnedFrame::new());
    assert_eq!(source.next_into(&mut first, Deadline::NEVER).unwrap(), Outcome::Frame);
    assert!(first.view_f32().is_some(), "exact depth is f32 metres");
    source.seek(3).unwrap();
    assert_eq!(source.next_into(&mut again, Deadline::NEVER).unwrap(), Outcome::EndOfStream);
    assert!(matches!(source.seek(4), Err(SourceError::OutOfRange { asked: 4, len: 3 })));
    source.seek(0).unwrap();
    assert_eq!(source.next_into(&mut again, Deadline::NEVER).unwrap(), Outcome::Frame);
    assert_eq!(first, again);
}

#[test]
fn impossible_options_are_refused() {
    let base = small("none");
    for (options, word) in [
        (SimOptions { size: (0, 5), ..base.clone() }, "0x5"),
        (SimOptions { colour_size: Some((0, 0)), ..base.clone() }, "colour"),
        (SimOptions { field_of_view: Some(4.0), ..base.clone() }, "field of view"),
        (SimOptions { frame_rate: 0.0, ..base.clone() }, "frames a second"),
        (SimOptions { unit: Some(0.0), ..base.clone() }, "0.001"),
        (SimOptions { place: Some("attic".into()), ..base.clone() }, "its places are"),
        (SimOptions { samples: 0, ..base.clone() }, "1 to 16"),
        (SimOptions { lens: [f64::NAN; 8], ..base.clone() }, "finite"),
    ] {
        let error = Simulation::open("living-room", options).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
    let file = tempfile::NamedTempFile::new().unwrap();
    let error = write_recording(&Scene::open("wall").unwrap(), &base, file.path(), |_, _| {}).unwrap_err();
    assert!(error.to_string().contains("written"), "{error}");
}

#[test]
fn every_station_around_every_place_stands_free() {
    let scene = Scene::open("living-room").unwrap();
    let camera = isobath_sim::SimCamera::from_fov(16, 12, 1.1).unwrap();
    for (name, at) in scene.places() {
        for (i, pose) in orbit_stations(*at).iter().enumerate() {
            let truth = scene.render_geometry(0.0, &camera, pose);
            let mut z: Vec<f64> = truth.z.iter().copied().filter(|z| *z > 0.0).collect();
            z.sort_by(f64::total_cmp);
            assert!(z[z.len() / 2] > 0.35 && z[0] > 0.02, "{name} station {i}: {} {}", z[z.len() / 2], z[0]);
            let p = pose.translation;
            assert!(p.x.abs() < 2.6 && p.z.abs() < 2.3, "{name} station {i} is in a wall: {p:?}");
        }
    }
}

/// FNV-1a.
fn hash(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}

fn fingerprint(scene: &str, sensor: &str, path: CameraPath) -> u64 {
    let options = SimOptions { size: (32, 24), frames: 2, seed: 3, path, ..small(sensor) };
    let simulation = Simulation::open(scene, options).unwrap();
    let f = simulation.frame(1);
    let mut bytes: Vec<u8> = f.depth.iter().flat_map(|z| z.to_le_bytes()).collect();
    bytes.extend(f.confidence.iter().flatten());
    bytes.extend(simulation.rgb(&f).iter().flatten());
    bytes.extend(f.truth.normals.iter().flatten().flat_map(|n| n.to_le_bytes()));
    bytes.extend(f.truth.segments.iter().flat_map(|s| s.to_le_bytes()));
    for s in simulation.imu() {
        bytes.extend(<[f64; 3]>::from(s.force).iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(<[f64; 3]>::from(s.rate).iter().flat_map(|v| v.to_le_bytes()));
    }
    let map = simulation.scene().environment_map(0.1, V3::from([0.0, 1.0, 0.0]), 16, 1);
    bytes.extend(map.pixels.iter().flatten().flat_map(|v| v.to_le_bytes()));
    hash(bytes)
}

/// Bits that must not change from machine to machine. A change of scenes or models changes them: then they are printed, to be
/// copied here.
const GOLDEN: &[(&str, &str, u64)] = &[
    ("wall", "kinect", 0x3377_e45a_5d7f_f24e),
    ("tilted", "kinect", 0xb848_4a25_0581_d61e),
    ("sphere", "kinect", 0x3474_1538_4d7e_179e),
    ("corner", "kinect", 0x3cae_8114_b8f5_0131),
    ("stairs", "kinect", 0x4c14_fa13_3268_d048),
    ("desk", "kinect", 0xff4d_db45_650e_f995),
    ("living-room", "kinect", 0xdd03_6940_c44b_f793),
    ("corridor", "kinect", 0x6465_11ed_e48a_ffb7),
    ("door", "kinect", 0xdd0a_66b9_8b2b_d7c8),
    ("facets-easy", "kinect", 0x03b7_1e9a_b811_cf33),
    ("facets-medium", "kinect", 0x8108_ebba_f126_c04b),
    ("facets-hard", "kinect", 0x3b21_c01f_180b_2b5f),
    ("living-room", "none", 0xa6b0_ece8_38ea_2195),
    ("living-room", "kinect-full", 0x8697_aa75_0eea_aec4),
    ("living-room", "tof+rolling", 0x093f_aae1_b00c_2ec5),
    ("living-room", "stereo", 0x1bee_dd72_e209_733c),
    ("living-room", "quantised:0.001", 0x0f52_121a_d7bd_e6df),
];

#[test]
fn the_same_seed_gives_the_same_bytes_everywhere() {
    let mut seen = Vec::new();
    for scene in NAMES {
        seen.push((*scene, "kinect", fingerprint(scene, "kinect", CameraPath::Auto)));
    }
    for sensor in ["none", "kinect-full", "tof+rolling", "stereo", "quantised:0.001"] {
        seen.push(("living-room", sensor, fingerprint("living-room", sensor, CameraPath::Shake)));
    }
    assert_eq!(
        seen.first(),
        Some(&("wall", "kinect", fingerprint("wall", "kinect", CameraPath::Auto))),
        "twice the same"
    );
    let text: String = seen.iter().map(|(a, b, h)| format!("    (\"{a}\", \"{b}\", 0x{h:016x}),\n")).collect();
    assert_eq!(seen, GOLDEN, "\n{text}");
}

/// Every file of a folder, by its path within it, in order.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let (mut out, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_string_lossy().replace('\\', "/");
                out.push((name, std::fs::read(&path).unwrap()));
            }
        }
    }
    out.sort();
    out
}

/// Of all text and uncompressed files of a folder with everything in it that errs; PNG and EXR are the same numbers, but their
/// bytes are their encoders' business.
const GOLDEN_FOLDER: u64 = 0xe46e_4731_2ba6_9c61;

#[test]
fn whole_folders_are_the_same_everywhere_and_on_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let options = SimOptions {
        unit: Some(0.001),
        colour_size: Some((64, 36)),
        lens: [-0.2, 0.05, 0.001, -0.0005, 0.0, 0.0, 0.0, 0.0],
        pose_noise: PoseNoise::PHONE,
        imu: ImuModel::PHONE,
        path: CameraPath::Shake,
        environment: 16,
        samples: 2,
        seed: 11,
        ..small("tof+rolling")
    };
    let scene = Scene::open("door").unwrap();
    let written = [1, 2, 5].map(|threads| {
        let folder = dir.path().join(threads.to_string());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write_recording(&scene, &options, &folder, |_, _| {})).unwrap();
        files(&folder)
    });
    assert!(written[0] == written[1] && written[0] == written[2], "threads change nothing");
    let names: Vec<&str> = written[0].iter().map(|(name, _)| name.as_str()).collect();
    for name in [
        "camera.toml",
        "confidence/000002.png",
        "depth/000000.png",
        "depth.txt",
        "groundtruth.txt",
        "imu.csv",
        "reported.txt",
        "rgb/000001.png",
        "truth/depth-000000.npy",
        "truth/environment/floor.exr",
        "truth/environment/floor.npy",
        "truth/normals-000001.npy",
        "truth/places.txt",
        "truth/radiance-000002.exr",
        "truth/segments-000000.png",
        "truth/segments.txt",
    ] {
        assert!(names.contains(&name), "{name} of {names:?}");
    }
    let plain = |name: &str| [".txt", ".csv", ".toml", ".npy"].iter().any(|ending| name.ends_with(ending));
    let bytes =
        written[0].iter().filter(|(name, _)| plain(name)).flat_map(|(name, bytes)| name.bytes().chain(bytes.clone()));
    let seen = hash(bytes);
    assert_eq!(seen, GOLDEN_FOLDER, "0x{seen:016x}");
    let other = dir.path().join("other");
    write_recording(&scene, &SimOptions { seed: 12, ..options }, &other, |_, _| {}).unwrap();
    let differ: Vec<String> =
        files(&other).into_iter().zip(&written[0]).filter(|(a, b)| a != *b).map(|((name, _), _)| name).collect();
    assert!(
        ["depth/000000.png", "imu.csv", "reported.txt"].iter().all(|n| differ.iter().any(|d| d == n)),
        "{differ:?}"
    );
    assert!(!differ.iter().any(|name| name.starts_with("truth/")), "truth has no seed: {differ:?}");
}
