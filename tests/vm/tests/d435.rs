//! A camera like Intel's D435i: what it says of itself, depth, colour, clock, motion.

use std::path::{Path, PathBuf};
use std::time::Duration;

use isobath::glam::Vec3;
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuSample;
use isobath_imu::device::Quirk;
use isobath_source::{BackPressure, DepthSource, ImuOutcome, ImuSource, OwnedFrame, SourceError, SystemClock};
use isobath_v4l2::OpenOptions;
use isobath_vm::guest::{camera_modules, iio_device, motion_modules, uvc_knows_the_d435, video_nodes, wait_for};
use isobath_vm::hid::Sensor;
use isobath_vm::profiles::d435::{D435, tables};
use isobath_vm::usb::{Plugged, Speed};
use isobath_vm::uvc::Fault;
use isobath_vm::watch::{Seen, WAIT, next, numbers, until_frames};

/// A camera that was prepared, and its depth node. Nodes: depth, its metadata, colour, its metadata.
fn plug(serial: &str, prepare: impl FnOnce(&mut D435)) -> (Plugged<D435>, PathBuf) {
    camera_modules();
    let mut camera = D435::new(serial, Speed::Super);
    prepare(&mut camera);
    let camera = Plugged::new(camera).unwrap();
    let nodes = wait_for("four nodes", || Some(video_nodes(serial)).filter(|nodes| nodes.len() == 4));
    (camera, nodes[0].clone())
}

fn try_open(node: &Path, size: (u16, u16)) -> Result<Box<dyn DepthSource + Send>, SourceError> {
    let size = Some((size.0.into(), size.1.into()));
    let options = OpenOptions { size, policy: BackPressure::Queue(6), colour: false, ..OpenOptions::default() };
    isobath_v4l2::open(node, &options)
}

fn open(node: &Path, size: (u16, u16)) -> Box<dyn DepthSource + Send> {
    try_open(node, size).unwrap_or_else(|error| panic!("{}: {error}", node.display()))
}

/// Reads one frame; its number, its unit, its pinhole.
fn one(source: &mut dyn DepthSource) -> (u64, f32, [f32; 4]) {
    let mut frame = OwnedFrame::new();
    let seen = next(source, &mut frame, WAIT);
    let k = frame.intrinsics;
    let number = seen.number().unwrap_or_else(|| panic!("{seen:?}"));
    (number, frame.unit.metres(), [k.fx(), k.fy(), k.cx(), k.cy()])
}

const NO_READING: ImuSample = ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None };

fn close(a: [f32; 4], b: [f32; 4]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3)
}

#[test]
fn every_size_has_its_own_pinhole_from_the_cameras_table() {
    let (_camera, node) = plug("d435-table", |_| {});
    for size in [(640, 480), (848, 480), (424, 240)] {
        let mut source = open(&node, size);
        let (_, unit, pinhole) = one(&mut *source);
        assert!((unit - 0.001).abs() < 1e-9, "{unit}");
        assert!(close(pinhole, tables::pinhole(size.0, size.1)), "{size:?}: {pinhole:?}");
        assert!(source.info().kind.contains("5.12.7.100") && source.info().kind.contains("817312070155"));
    }
}

#[test]
fn newer_firmwares_list_wins_and_the_unit_is_the_cameras() {
    let list = [600.5, 601.25, 319.75, 241.5];
    let (_camera, node) = plug("d435-list", |camera| {
        let mut settings = camera.settings.lock().unwrap();
        settings.resolutions = vec![(848, 480, [1.0, 2.0, 3.0, 4.0]), (640, 480, list)];
        settings.unit_um = Some(100);
    });
    let (_, unit, pinhole) = one(&mut *open(&node, (640, 480)));
    assert!((unit - 0.0001).abs() < 1e-9 && close(pinhole, list), "{unit} {pinhole:?}");
}

#[test]
fn without_advanced_mode_the_unit_is_the_models_and_a_note_says_so() {
    let (_camera, node) = plug("d435-basic", |camera| camera.settings.lock().unwrap().unit_um = None);
    let mut source = open(&node, (640, 480));
    assert!((one(&mut *source).1 - 0.001).abs() < 1e-9);
    assert!(source.info().notes.iter().any(|note| note.contains("unit")), "{:?}", source.info().notes);
}

/// Every way in which the table can be wrong: the pinhole is asked for, never guessed.
#[test]
fn a_damaged_table_is_not_believed() {
    let (camera, node) = plug("d435-damage", |_| {});
    let whole = tables::coefficients();
    type Damage = (&'static str, fn(&mut Vec<u8>));
    let damages: [Damage; 4] = [
        ("a bit", |table| table[300] ^= 4),
        ("the checksum", |table| table[12] ^= 1),
        ("its length", |table| table[4..8].fill(0xff)),
        ("its end", |table| table.truncate(290)),
    ];
    for (what, damage) in damages {
        let mut table = whole.clone();
        damage(&mut table);
        camera.device().settings.lock().unwrap().tables.insert(tables::COEFFICIENTS, table);
        let error = try_open(&node, (640, 480)).err();
        assert!(matches!(error, Some(SourceError::MissingCalibration { .. })), "{what}: {error:?}");
    }
    // An answer that claims to be longer than its buffer.
    camera.device().settings.lock().unwrap().claimed_length = Some(4000);
    let error = try_open(&node, (640, 480)).err();
    assert!(matches!(error, Some(SourceError::MissingCalibration { .. })), "{error:?}");
}

/// A frame that the camera left out is known by its counter only: the kernel's numbers have no gap. The counter is in metadata that the kernel
/// has to be told to hand over.
#[test]
fn frames_that_the_camera_left_out_are_counted_as_its_own() {
    camera_modules();
    uvc_knows_the_d435(true);
    let (camera, node) = plug("d435-counter", |_| {});
    uvc_knows_the_d435(false);
    let mut source = open(&node, (424, 240));
    assert!(source.info().notes.iter().any(|n| n.contains("D4XX")), "{:?}", source.info().notes);
    let mut seen = until_frames(&mut *source, 3);
    let first = camera.device().stream().next_frame() + 2;
    camera.device().stream().faults.extend([(first, Fault::Skipped), (first + 1, Fault::Skipped)]);
    seen.extend(until_frames(&mut *source, 8));
    let numbers = numbers(&seen);
    assert!(!numbers.contains(&first) && !numbers.contains(&(first + 1)), "{numbers:?}");
    let stats = source.stats();
    assert_eq!(stats.dropped_by_device, 2, "{stats:?}");
    assert_eq!(stats.span(), numbers[numbers.len() - 1] - numbers[0] + 1, "{stats:?} {numbers:?}");
}

/// The camera's clock has 32 bits of microseconds. Where it wraps, times go on.
#[test]
fn times_go_on_where_the_cameras_clock_wraps() {
    // Wraps three seconds after it is plugged in.
    let (_camera, node) = plug("d435-wrap", |camera| camera.depth.stream.clock = u32::MAX - 3_000_000);
    let mut source = open(&node, (424, 240));
    let mut frame = OwnedFrame::new();
    let mut times: Vec<(u64, i64)> = Vec::new();
    while times.len() < 150 {
        match next(&mut *source, &mut frame, WAIT) {
            Seen::Frame(Some(number)) => times.push((number, frame.time.as_nanos())),
            Seen::Gap(_) => {}
            other => panic!("{other:?} after {} frames", times.len()),
        }
    }
    assert!(source.info().notes.iter().any(|n| n.contains("camera's clock (UVCH)")), "{:?}", source.info().notes);
    for pair in times.windows(2) {
        let (frames, nanos) = ((pair[1].0 - pair[0].0) as i64, pair[1].1 - pair[0].1);
        assert!(nanos > 0, "{pair:?}");
        // Once the clocks have been compared for a second, a frame's time is good to a fifth of the interval.
        if pair[0].0 > times[0].0 + 30 {
            assert!((nanos - frames * 33_333_300).abs() < 7_000_000, "{pair:?}");
        }
    }
}

/// Colour comes with depth, from the frame's time: its luma says where in the image a pixel was and in which frame.
#[test]
fn colour_comes_with_depth() {
    let (_camera, node) = plug("d435-colour", |_| {});
    let size = Some((640, 480));
    let mut source = isobath_v4l2::open(&node, &OpenOptions { size, ..OpenOptions::default() }).unwrap();
    assert!(source.info().has_colour, "{:?}", source.info().notes);
    let (mut frame, mut coloured) = (OwnedFrame::new(), 0);
    for _ in 0..12 {
        let seen = next(&mut *source, &mut frame, WAIT);
        assert!(matches!(seen, Seen::Frame(Some(_))), "{seen:?}");
        coloured += u32::from(frame.colour().is_some());
    }
    assert!(coloured >= 6, "{coloured} of 12 frames have colour");
}

/// Everything of the camera at once goes away in the middle of a frame.
#[test]
fn unplugged_with_depth_colour_and_motion_running() {
    motion_modules();
    let (camera, node) = plug("d435-pull", |_| {});
    let _ = iio_device("accel_3d");
    let _ = iio_device("gyro_3d");
    let mut motion = isobath_imu::open(None, &isobath_imu::Options::default()).unwrap();
    let size = Some((640, 480));
    let mut source = isobath_v4l2::open(&node, &OpenOptions { size, ..OpenOptions::default() }).unwrap();
    let mut seen = until_frames(&mut *source, 3);
    let last = camera.device().stream().next_frame() + 1;
    camera.device().stream().faults.insert(last, Fault::Unplug(200_000));
    seen.extend(until_frames(&mut *source, 50));
    assert!(matches!(seen.last(), Some(Seen::Gone(_))), "{seen:?}");
    assert!(numbers(&seen).iter().all(|n| *n < last));
    let mut samples = [NO_READING; 64];
    let error = loop {
        let deadline = isobath_source::Deadline::after(&SystemClock, Duration::from_secs(1));
        match motion.read(&mut samples, deadline) {
            Ok(ImuOutcome::Samples(_)) => {}
            Ok(other) => panic!("{other:?}"),
            Err(error) => break error,
        }
    };
    assert!(error.is_terminal(), "{error}");
}

/// What the simulated module feels, in SI units, to the last digit; with the kernel's scales and with those of Intel's own library.
#[test]
fn motion_is_in_si_units_and_signed() {
    motion_modules();
    camera_modules();
    for quirk in [Quirk::None, Quirk::RealSenseBefore516] {
        let camera = Plugged::new(D435::new("d435-motion", Speed::Super)).unwrap();
        let _ = iio_device("accel_3d");
        let _ = iio_device("gyro_3d");
        let options = isobath_imu::Options { quirk: Some(quirk), ..isobath_imu::Options::default() };
        let mut motion = isobath_imu::open(None, &options).unwrap();
        let mut samples = [NO_READING; 64];
        let mut read = Vec::new();
        while read.len() < 200 {
            let deadline = isobath_source::Deadline::after(&SystemClock, WAIT);
            match motion.read(&mut samples, deadline).unwrap() {
                ImuOutcome::Samples(n) => read.extend_from_slice(&samples[..n]),
                other => panic!("{other:?} after {} readings", read.len()),
            }
        }
        let (g, degree) = (9.806_65e-3, 0.1f32.to_radians());
        for sample in &read {
            // Steps: (counter, -990, 140) of force, (-3, counter, 7) of rate.
            let (force, rate) = (sample.force / g, sample.rate / degree);
            assert!((force.y + 990.0).abs() < 0.01 && (force.z - 140.0).abs() < 0.01, "{quirk:?} {force}");
            assert!((-0.01..=9.01).contains(&force.x), "{quirk:?} {force}");
            assert!((rate.x + 3.0).abs() < 0.01 && (rate.z - 7.0).abs() < 0.01, "{quirk:?} {rate}");
            assert!((rate.y - rate.y.round()).abs() < 0.01 && (0.0..10.0).contains(&rate.y.abs()), "{quirk:?} {rate}");
        }
        let steps: Vec<i64> = read.windows(2).map(|w| w[1].time.as_nanos() - w[0].time.as_nanos()).collect();
        assert!(steps.iter().all(|step| *step > 0), "{steps:?}");
        let mean = steps.iter().sum::<i64>() / steps.len() as i64;
        let period = (1e9 / f64::from(motion.info().rate_hz)) as i64;
        assert!((mean - period).abs() < period / 20, "mean {mean} ns for a period of {period} ns");
        assert!(camera.device().motion.sent(Sensor::Gyroscope) >= 200);
    }
}

#[test]
fn what_is_plugged_in_is_told() {
    let (_camera, node) = plug("d435-told", |_| {});
    let devices = isobath_v4l2::devices();
    let report = devices.iter().find(|d| d.path == node).unwrap();
    assert!(report.has_depth && report.usb == Some((0x8086, 0x0b3a)), "{report:?}");
    assert_eq!(report.serial.as_deref(), Some("d435-told"));
}
