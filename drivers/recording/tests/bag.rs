//! ROS 1 bags: a small one made here, and RealSense's own where it is (`../shared/data/librealsense_bag`).

use std::path::Path;

use isobath::glam::Vec3;
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuSample;
use isobath_recording::{OpenOptions, open, open_bytes, open_imu};
use isobath_source::{Deadline, DepthPixels, ImuOutcome, ImuSource as _, Outcome, OwnedFrame, Recording};
use proptest::prelude::*;

fn next(r: &mut dyn Recording) -> OwnedFrame {
    let mut frame = OwnedFrame::new();
    assert_eq!(r.next_into(&mut frame, Deadline::NEVER).unwrap(), Outcome::Frame);
    frame
}

fn prefixed(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header: Vec<u8> =
        fields.iter().flat_map(|(name, value)| prefixed(&[name.as_bytes(), b"=", value].concat())).collect();
    [prefixed(&header), prefixed(data)].concat()
}

/// Little-endian numbers one after the other.
macro_rules! packed {
    ($($value:expr),* $(,)?) => { [$($value.to_le_bytes().to_vec()),*].concat() };
}

fn header(sec: u32, nsec: u32, frame: &str) -> Vec<u8> {
    [packed!(1_u32, sec, nsec), prefixed(frame.as_bytes())].concat()
}

fn image(sec: u32, encoding: &str, (w, h): (u32, u32), bytes: u32, data: &[u8]) -> Vec<u8> {
    let body = [packed!(h, w), prefixed(encoding.as_bytes()), vec![0], packed!(w * bytes), prefixed(data)].concat();
    [header(sec, 500, "optical"), body].concat()
}

fn camera(w: u32, h: u32) -> Vec<u8> {
    let k: Vec<u8> = [50.0, 0.0, 1.5, 0.0, 51.0, 0.5, 0.0, 0.0, 1.0_f64].iter().flat_map(|v| v.to_le_bytes()).collect();
    [header(0, 0, "optical"), packed!(h, w), prefixed(b"plumb_bob"), packed!(0_u32), k, vec![0; 9 * 8 + 12 * 8 + 25]]
        .concat()
}

fn transform(parent: &str, child: &str, x: f64) -> Vec<u8> {
    let rest = packed!(x, 0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64, 1.0_f64);
    [packed!(1_u32), header(1, 0, parent), prefixed(child.as_bytes()), rest].concat()
}

/// Topic, type, seconds, content.
type Message<'a> = (&'a str, &'a str, u32, Vec<u8>);

/// A bag of one chunk.
fn bag(messages: &[Message<'_>], lz4: bool, indexed: bool) -> Vec<u8> {
    let mut chunk = Vec::new();
    let mut index = Vec::new();
    for (i, (topic, kind, sec, data)) in messages.iter().enumerate() {
        let id = (i as u32).to_le_bytes();
        let about = [("topic", topic.as_bytes()), ("type", kind.as_bytes())];
        let about: Vec<u8> =
            about.iter().flat_map(|(name, value)| prefixed(&[name.as_bytes(), b"=", value].concat())).collect();
        chunk.extend(record(&[("op", &[7]), ("conn", &id), ("topic", topic.as_bytes())], &about));
        let time = packed!(*sec, 0_u32);
        let at = chunk.len() as u32;
        chunk.extend(record(&[("op", &[2]), ("conn", &id), ("time", &time)], data));
        let entry = packed!(*sec, 0_u32, at);
        index.extend(record(
            &[("op", &[4]), ("ver", &packed!(1_u32)), ("conn", &id), ("count", &packed!(1_u32))],
            &entry,
        ));
    }
    let (compression, data) = if lz4 {
        let mut e = lz4_flex::frame::FrameEncoder::new(Vec::new());
        std::io::Write::write_all(&mut e, &chunk).unwrap();
        ("lz4", e.finish().unwrap())
    } else {
        ("none", chunk.clone())
    };
    let mut file = b"#ROSBAG V2.0\n".to_vec();
    file.extend(record(&[("op", &[3]), ("index_pos", &[0; 8])], &[b' '; 100]));
    let size = packed!(chunk.len() as u32);
    file.extend(record(&[("op", &[5]), ("compression", compression.as_bytes()), ("size", &size)], &data));
    if indexed {
        file.extend(index);
    }
    file
}

fn realsense_like() -> Vec<Message<'static>> {
    vec![
        ("/device_0/sensor_0/option/Depth Units/value", "std_msgs/Float32", 0, packed!(0.0001_f32)),
        ("/device_0/sensor_0/Depth_0/info/camera_info", "sensor_msgs/CameraInfo", 0, camera(2, 1)),
        ("/device_0/sensor_0/Depth_0/image/data", "sensor_msgs/Image", 5, image(5, "mono16", (2, 1), 2, &[1, 0, 0, 2])),
        (
            "/device_0/sensor_1/Color_0/image/data",
            "sensor_msgs/Image",
            5,
            image(5, "rgb8", (2, 1), 3, &[1, 2, 3, 4, 5, 6]),
        ),
        ("/device_0/sensor_0/Infrared_1/image/data", "sensor_msgs/Image", 5, image(5, "mono16", (2, 1), 2, &[9; 4])),
        ("/tf", "tf/tfMessage", 5, transform("map", "optical", 0.5)),
        ("/device_0/info", "diagnostic_msgs/KeyValue", 5, vec![0; 8]),
    ]
}

#[test]
fn a_bag_is_read_packed_or_not_indexed_or_not() {
    for (lz4, indexed) in [(false, true), (true, true), (true, false), (false, false)] {
        let mut r = open_bytes(bag(&realsense_like(), lz4, indexed), "t.bag", &OpenOptions::default()).unwrap();
        assert_eq!((r.len(), r.info().kind.as_str()), (1, "RealSense recording (ROS 1 bag)"));
        let f = next(r.as_mut());
        assert_eq!(f.depth(), &DepthPixels::U16(vec![1, 512]));
        assert!((f.unit.metres() - 0.0001).abs() < 1e-9, "its own option says the unit");
        assert_eq!((f.intrinsics.fx(), f.intrinsics.fy(), f.intrinsics.cx()), (50.0, 51.0, 1.5));
        assert_eq!(f.colour().unwrap().rows().next().unwrap(), [[1, 2, 3], [4, 5, 6]]);
        assert_eq!(f.time, Timestamp::from_nanos(5_000_000_500));
        assert_eq!(f.pose.unwrap().translation(), Vec3::new(0.5, 0.0, 0.0));
    }
}

#[test]
fn what_cannot_be_read_is_said() {
    let mut bytes = bag(&realsense_like(), false, true);
    let at = bytes.windows(16).position(|w| w == b"compression=none").unwrap();
    bytes[at + 12..at + 16].copy_from_slice(b"bzip");
    let error = open_bytes(bytes, "t.bag", &OpenOptions::default()).err().unwrap().to_string();
    assert!(error.contains("rosbag decompress"), "{error}");
    let error = open_bytes(b"#ROSBAG V2.0\n".to_vec(), "t.bag", &OpenOptions::default()).err().unwrap().to_string();
    assert!(error.contains("no depth images"), "{error}");
}

fn imu(sec: u32, rate: [f64; 3], force: [f64; 3]) -> Vec<u8> {
    let numbers = |v: &[f64]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    [
        header(sec, 0, "imu"),
        numbers(&[0.0; 13]),
        numbers(&rate),
        numbers(&[0.0; 9]),
        numbers(&force),
        numbers(&[0.0; 9]),
    ]
    .concat()
}

#[test]
fn two_halves_of_an_inertial_sensor_are_joined() {
    const GYRO: &str = "/device_0/sensor_2/Gyro_0/imu/data";
    const ACCEL: &str = "/device_0/sensor_2/Accel_0/imu/data";
    let kind = "sensor_msgs/Imu";
    let mut messages: Vec<Message<'_>> =
        (0..6).map(|i| (GYRO, kind, i, imu(i, [f64::from(i), 0.0, 0.0], [0.0; 3]))).collect();
    messages.extend([0, 4].map(|i| (ACCEL, kind, i, imu(i, [0.0; 3], [0.0, f64::from(i), 9.5]))));
    let file = tempfile::NamedTempFile::with_suffix(".bag").unwrap();
    std::fs::write(file.path(), bag(&messages, true, true)).unwrap();
    let mut readings = open_imu(file.path()).unwrap().expect("readings");
    assert_eq!((readings.len(), readings.info().rate_hz, readings.has_field()), (6, 1.0, false));
    assert!(readings.info().notes[0].contains("Accel_0"), "{:?}", readings.info().notes);
    let empty = ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None };
    let mut out = [empty; 8];
    assert_eq!(readings.read(&mut out, Deadline::NEVER).unwrap(), ImuOutcome::Samples(6));
    // The gyroscope leads; each reading takes the nearest acceleration, the earlier of two as near.
    let forces: Vec<f32> = out[..6].iter().map(|s| s.force.y).collect();
    assert_eq!(forces, [0.0, 0.0, 0.0, 4.0, 4.0, 4.0]);
    assert_eq!((out[5].rate.x, out[5].force.z, out[5].time), (5.0, 9.5, Timestamp::from_nanos(5_000_000_000)));
    // What has none says so, and is no error.
    std::fs::write(file.path(), bag(&realsense_like(), true, true)).unwrap();
    assert!(open_imu(file.path()).unwrap().is_none());
}

#[test]
fn compressed_depth_is_read() {
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, 2, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_image_data(&[0x03, 0xe8, 0, 0]).unwrap();
    for (format, z) in [("16UC1; compressedDepth png", 1.0_f32), ("32FC1; compressedDepth", 2.0)] {
        // Of metres: z = a / (step - b).
        let data = [packed!(0_i32, 1998.0_f32, 1.0_f32), png.clone()].concat();
        let image = [header(5, 0, "optical"), prefixed(format.as_bytes()), prefixed(&data)].concat();
        let messages = vec![
            ("/camera/depth/image/compressedDepth", "sensor_msgs/CompressedImage", 5, image),
            ("/camera/depth/camera_info", "sensor_msgs/CameraInfo", 5, camera(2, 1)),
        ];
        let mut r = open_bytes(bag(&messages, false, true), "t.bag", &OpenOptions::default()).unwrap();
        let f = next(r.as_mut());
        assert!((f.z(0, 0) - z).abs() < 1e-6 && f.z(1, 0) == 0.0 && f.size() == (2, 1), "{format}: {}", f.z(0, 0));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn damaged_bags_give_an_answer(at in 0.0_f64..1.0, flip in any::<u8>(), cut in 0.0_f64..1.0, lz4 in any::<bool>()) {
        let mut bytes = bag(&realsense_like(), lz4, flip & 1 == 0);
        let at = (at * bytes.len() as f64) as usize;
        bytes[at] ^= flip;
        bytes.truncate(((cut + 0.3) * bytes.len() as f64) as usize);
        if let Ok(mut r) = open_bytes(bytes, "damaged", &OpenOptions::default()) {
            let mut f = OwnedFrame::new();
            for _ in 0..r.len() {
                let _ = r.next_into(&mut f, Deadline::NEVER);
            }
        }
    }
}

#[test]
fn a_realsense_recording_gives_what_others_decoded_from_it() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/librealsense_bag");
    if !folder.is_dir() {
        println!("skipped: no shared data (librealsense_bag)");
        return;
    }
    // Its one colour image was exposed 0.1 s before its first depth image.
    let options = OpenOptions { association: 0.1, ..OpenOptions::default() };
    let mut r = open(&folder.join("single_depth_color_640x480.bag"), &options).unwrap();
    assert_eq!((r.len(), r.info().size), (2, Some((640, 480))));
    let f = next(r.as_mut());
    assert!((f.intrinsics.fx() - 390.431_46).abs() < 1e-4 && (f.intrinsics.cy() - 242.187_35).abs() < 1e-4);
    assert_eq!(f.time, Timestamp::from_nanos(360_815_089_000));
    assert_eq!(f.unit.metres(), 0.001);
    let png = image::open(folder.join("decoded/depth.png")).unwrap().into_luma16();
    let frames = [f, next(r.as_mut())];
    let same = |f: &OwnedFrame| matches!(f.depth(), DepthPixels::U16(v) if v.iter().eq(png.as_raw()));
    assert!(frames.iter().any(same), "one of the frames is the one decoded");
    let png = image::open(folder.join("decoded/color.png")).unwrap().into_rgb8();
    let colour = frames.iter().find_map(|f| f.colour()).expect("colour");
    assert!(colour.rows().flatten().flatten().eq(png.as_raw()), "colour");
    assert!(r.info().notes.iter().any(|n| n.contains("mm from depth's")), "{:?}", r.info().notes);
}
