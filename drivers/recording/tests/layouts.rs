//! The layouts, on recordings of a few pixels written here: what is found, what is missing, what is broken.

use std::fs;
use std::path::Path;

use isobath::glam::Vec3;
use isobath_recording::parse::{NpySlice, write_npy};
use isobath_recording::{Format, OpenOptions, open};
use isobath_source::{Deadline, Outcome, OwnedFrame, Recording, SourceError};

const CAMERA: &str = "fx = 4\nfy = 4\ncx = 1.5\ncy = 1\n[depth]\nunit = 0.001\n";
const IDENTITY: &str = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";

fn png(path: &Path, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), 4, 3);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
}

/// 4 x 3 pixels of one value.
fn depth_png(path: &Path, value: u16) {
    png(path, png::ColorType::Grayscale, png::BitDepth::Sixteen, &value.to_be_bytes().repeat(12));
}

fn colour_png(path: &Path, value: u8) {
    png(path, png::ColorType::Rgb, png::BitDepth::Eight, &[value; 36]);
}

fn next(recording: &mut dyn Recording) -> Result<Option<OwnedFrame>, SourceError> {
    let mut frame = OwnedFrame::new();
    Ok((recording.next_into(&mut frame, Deadline::NEVER)? == Outcome::Frame).then_some(frame))
}

fn error(path: &Path, options: &OpenOptions) -> SourceError {
    open(path, options).err().expect("must be refused")
}

#[test]
fn seven_scenes_with_lost_tracking() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("camera.toml"), CAMERA).unwrap();
    for i in 0..4 {
        depth_png(&at(&format!("frame-00000{i}.depth.png")), [1000, 65535, 3000, 4000][i]);
    }
    colour_png(&at("frame-000000.color.png"), 7);
    fs::write(at("frame-000001.color.png"), b"not an image").unwrap();
    fs::write(at("frame-000000.pose.txt"), IDENTITY).unwrap();
    fs::write(at("frame-000001.pose.txt"), "nan 0 0 0\n".repeat(4)).unwrap();
    fs::write(at("frame-000002.pose.txt"), "what\n").unwrap();
    fs::write(at("._frame-000009.depth.png"), b"a Mac was here").unwrap();

    let mut recording = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!((recording.info().kind.as_str(), recording.len()), ("7-Scenes folder", 4));
    let f = next(recording.as_mut()).unwrap().unwrap();
    assert_eq!((f.z(0, 0), f.valid_pixels(), f.notes.len()), (1.0, 12, 0));
    assert!(f.pose.is_some());
    assert_eq!(f.view_u16().unwrap().colour_at(3, 2), Some([7; 3]));
    let f = next(recording.as_mut()).unwrap().unwrap();
    assert_eq!(f.valid_pixels(), 0, "65535 is no reading");
    assert!(f.pose.is_none() && f.colour().is_none() && f.notes.len() == 2, "{:?}", f.notes);
    let f = next(recording.as_mut()).unwrap().unwrap();
    assert!(f.notes[0].contains("frame-000002.pose.txt:1"), "{:?}", f.notes);
    let f = next(recording.as_mut()).unwrap().unwrap();
    assert!(f.pose.is_none() && f.notes.is_empty(), "a pose that is not there is no fault");
    assert!(next(recording.as_mut()).unwrap().is_none() && next(recording.as_mut()).unwrap().is_none());
}

#[test]
fn what_is_missing_is_named_with_an_example() {
    let dir = tempfile::tempdir().unwrap();
    depth_png(&dir.path().join("depth/1.png"), 1000);
    let e = error(dir.path(), &OpenOptions::default());
    let text = e.to_string();
    let SourceError::MissingCalibration { needed, .. } = e else { panic!("{e}") };
    assert_eq!(needed, ["fx", "fy", "cx", "cy", "depth.unit"]);
    for word in ["camera.toml", "fx = 525.0", "unit = 0.001", "--intrinsics", "--unit"] {
        assert!(text.contains(word), "{text}");
    }
    // By hand it opens; values given by hand win over the file's.
    let mut o = OpenOptions::default();
    (o.set.fx, o.set.fy, o.set.cx, o.set.cy) = (Some(4.0), Some(4.0), Some(1.5), Some(1.0));
    o.set.depth.unit = Some(0.01);
    assert_eq!(next(open(dir.path(), &o).unwrap().as_mut()).unwrap().unwrap().z(0, 0), 10.0);
    fs::write(dir.path().join("camera.toml"), CAMERA).unwrap();
    assert_eq!(next(open(dir.path(), &o).unwrap().as_mut()).unwrap().unwrap().z(0, 0), 10.0);
    assert_eq!(next(open(dir.path(), &OpenOptions::default()).unwrap().as_mut()).unwrap().unwrap().z(0, 0), 1.0);

    // A file without a header also needs a size and a format.
    let bin = dir.path().join("raw/a.bin");
    fs::create_dir(dir.path().join("raw")).unwrap();
    fs::write(&bin, [0; 24]).unwrap();
    let SourceError::MissingCalibration { needed, .. } = error(&bin, &OpenOptions::default()) else {
        panic!("missing")
    };
    assert_eq!(needed, ["width", "height", "depth.format", "fx, fy, cx, cy"]);
    (o.set.width, o.set.height, o.set.depth.format) = (Some(4), Some(3), Some(Format::U16));
    assert!(open(&bin, &o).is_ok());
    o.set.width = Some(5);
    assert!(error(&bin, &o).to_string().contains("a.bin: 5x3 values of 2 bytes are 30 bytes, the file has 24"));
}

#[test]
fn a_broken_image_costs_one_frame() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("camera.toml"), CAMERA).unwrap();
    for i in 1..=3 {
        depth_png(&dir.path().join(format!("depth/{i}.png")), 1000 * i);
    }
    let broken = dir.path().join("depth/1.png");
    let bytes = fs::read(&broken).unwrap();
    fs::write(&broken, &bytes[..bytes.len() / 2]).unwrap();
    let mut recording = open(dir.path(), &OpenOptions::default()).unwrap();
    let e = next(recording.as_mut()).unwrap_err();
    assert!(!e.is_terminal() && e.to_string().contains("1.png"), "{e}");
    assert_eq!(next(recording.as_mut()).unwrap().unwrap().z(0, 0), 2.0);
    assert_eq!(next(recording.as_mut()).unwrap().unwrap().sequence, 2);
    // When none can be read, that is the answer.
    fs::write(dir.path().join("depth/2.png"), b"").unwrap();
    fs::remove_file(dir.path().join("depth/3.png")).unwrap();
    assert!(error(dir.path(), &OpenOptions::default()).to_string().contains("1.png"));
}

#[test]
fn contradictions_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    depth_png(&dir.path().join("depth/1.png"), 1000);
    let camera = dir.path().join("camera.toml");
    for (text, word) in [
        (format!("width = 8\n{CAMERA}"), "8x3"),
        (CAMERA.replace("unit", "format = 'f32'\nunit"), "floating point"),
        (CAMERA.replace("fx = 4", "fx = 0"), "fx"),
        (CAMERA.replace("unit = 0.001", "format = 'disparity'"), "depth.baseline"),
        (CAMERA.replace("unit", "units"), "camera.toml:6"),
    ] {
        fs::write(&camera, &text).unwrap();
        let e = error(dir.path(), &OpenOptions::default()).to_string();
        assert!(e.contains(word), "{text}: {e}");
    }
    let empty = tempfile::tempdir().unwrap();
    assert!(matches!(error(empty.path(), &OpenOptions::default()), SourceError::Unsupported { .. }));
    assert!(matches!(error(&empty.path().join("nothing"), &OpenOptions::default()), SourceError::Io { .. }));
    fs::create_dir(empty.path().join("depth")).unwrap();
    assert!(error(empty.path(), &OpenOptions::default()).to_string().contains("no frames"));
}

#[test]
fn tum_lists_associate_and_stay_inside() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("camera.toml"), CAMERA).unwrap();
    for i in [1, 2] {
        depth_png(&at(&format!("depth/{i}.png")), 1000 * i);
        colour_png(&at(&format!("rgb/{i}.png")), i as u8);
    }
    fs::write(at("depth.txt"), "# t f\n2.0 depth/2.png\n1.0 depth/1.png\n").unwrap();
    fs::write(at("rgb.txt"), "1.015 rgb/1.png\n2.5 rgb/2.png\n").unwrap();
    fs::write(at("groundtruth.txt"), "0.99 9 0 0 0 0 0 1\n0.999 1 2 3 0 0 0 1\n2.021 0 0 0 0 0 0 1\n").unwrap();
    let mut recording = open(dir.path(), &OpenOptions::default()).unwrap();
    let f = next(recording.as_mut()).unwrap().unwrap();
    assert_eq!((f.z(0, 0), f.pose.unwrap().translation()), (1.0, Vec3::new(1.0, 2.0, 3.0)), "in order of time");
    assert!(f.colour().is_some());
    let f = next(recording.as_mut()).unwrap().unwrap();
    assert!(f.pose.is_none() && f.colour().is_none() && f.notes.len() == 2, "{:?}", f.notes);
    let wide = OpenOptions { association: 0.6, colour: false, ..OpenOptions::default() };
    let mut recording = open(dir.path(), &wide).unwrap();
    recording.seek(1).unwrap();
    let f = next(recording.as_mut()).unwrap().unwrap();
    assert!(f.pose.is_some() && f.colour().is_none() && f.notes.is_empty());

    fs::write(at("depth.txt"), "1.0 ../../etc/passwd\n").unwrap();
    let e = error(dir.path(), &OpenOptions::default()).to_string();
    assert!(e.contains("depth.txt:1") && e.contains("outside"), "{e}");
    fs::write(at("depth.txt"), [0xff, 0xfe, 0x00]).unwrap();
    assert!(error(dir.path(), &OpenOptions::default()).to_string().contains("not text"));
}

#[test]
fn conventions_and_directions_of_poses() {
    let dir = tempfile::tempdir().unwrap();
    depth_png(&dir.path().join("depth/1.png"), 1000);
    fs::write(dir.path().join("pose.txt"), "1 2 3 0 0 0 1\n").unwrap();
    for (convention, direction, origin, forward) in [
        ("opencv", "camera-to-world", Vec3::new(1.0, 2.0, 3.0), Vec3::Z),
        ("opencv", "world-to-camera", Vec3::new(-1.0, -2.0, -3.0), Vec3::Z),
        ("opengl", "camera-to-world", Vec3::new(1.0, 2.0, 3.0), Vec3::NEG_Z),
        ("unity", "camera-to-world", Vec3::new(1.0, 2.0, -3.0), Vec3::NEG_Z),
    ] {
        let text = format!("{CAMERA}[pose]\nconvention = '{convention}'\ndirection = '{direction}'\n");
        fs::write(dir.path().join("camera.toml"), text).unwrap();
        let pose = next(open(dir.path(), &OpenOptions::default()).unwrap().as_mut()).unwrap().unwrap().pose.unwrap();
        assert!((pose.translation() - origin).length() < 1e-6, "{convention} {direction}");
        assert!((pose.direction_to_world(Vec3::Z) - forward).length() < 1e-6, "{convention} {direction}");
    }
}

#[test]
fn npy_projective_and_limits() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("z.npy");
    let write = |values: &[f32]| {
        let mut out = Vec::new();
        write_npy(&mut out, &[1, values.len()], NpySlice::F32(values)).unwrap();
        fs::write(&path, out).unwrap();
    };
    let camera = |depth: &str| {
        fs::write(dir.path().join("z.camera.toml"), format!("fx = 4\nfy = 4\ncx = 1.5\ncy = 1\n[depth]\n{depth}"))
            .unwrap();
        next(open(&path, &OpenOptions::default()).unwrap().as_mut()).unwrap().unwrap()
    };
    write(&[1.5, f32::NAN, -1.0, f32::INFINITY, 20.0]);
    let f = camera("max_z = 10\n");
    assert_eq!((f.view_f32().unwrap().z(0, 0), f.valid_pixels()), (1.5, 1));
    write(&[0.0, 0.5, 1.0]);
    let f = camera("format = 'projective'\nnear = 0.1\n");
    assert_eq!([0, 1, 2].map(|x| f.z(x, 0)), [0.1, 0.2, 0.0]);
    let f = camera("format = 'projective'\nnear = 0.1\nunit = 0.000002\n");
    assert!(f.view_u16().is_some() && f.z(1, 0) == 0.0 && f.notes[0].contains("do not fit"), "{:?}", f.notes);
}

#[test]
fn a_lens_is_removed_on_load() {
    let dir = tempfile::tempdir().unwrap();
    depth_png(&dir.path().join("depth/1.png"), 1000);
    let bent = CAMERA.replace("[depth]", "distortion = [4, 0, 0, 0, 0]\n[depth]");
    fs::write(dir.path().join("camera.toml"), bent).unwrap();
    let mut recording = open(dir.path(), &OpenOptions::default()).unwrap();
    assert!(recording.info().notes.iter().any(|n| n.contains("straightened")));
    let f = next(recording.as_mut()).unwrap().unwrap();
    // x/z = -0.125 moves by 0.03 px, 0.375 by 0.84 px: out of the image, which no pixel saw.
    assert_eq!((f.z(1, 1), f.z(3, 1)), (1.0, 0.0));
}

#[test]
fn the_frame_that_the_project_carries() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/motorcycle");
    let f = next(open(&folder, &OpenOptions::default()).unwrap().as_mut()).unwrap().unwrap();
    assert_eq!(f.size(), (741, 500));
    assert_eq!(f.colour().unwrap().size(), (741, 500));
    let holes = 1.0 - f.valid_pixels() as f32 / (741.0 * 500.0);
    assert!((holes - 0.073).abs() < 0.001, "{holes}");
}
