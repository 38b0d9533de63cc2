//! IIO over a fake sysfs: what is written into it, what comes out of its pipes, and what happens when they end.

#![cfg(unix)]

mod common;

use std::path::Path;
use std::time::Duration;

use common::{ACCEL, GYRO, TIMESTAMP, Tree, channels, hid_scan, now, send};
use isobath::glam::Vec3;
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuSample;
use isobath_imu::device::Quirk;
use isobath_imu::{IioImu, Options, open};
use isobath_source::{Deadline, ImuOutcome, ImuSource, SourceError, SystemClock};

/// A name and its text.
type Pair = (&'static str, &'static str);

const HID: &str = "le:s16/32>>0";

fn soon() -> Deadline {
    Deadline::after(&SystemClock, Duration::from_millis(30))
}

fn read(imu: &mut IioImu) -> Vec<ImuSample> {
    let empty = ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None };
    let mut out = [empty; 50];
    match imu.read(&mut out, soon()).unwrap() {
        ImuOutcome::Samples(n) => out[..n].to_vec(),
        ImuOutcome::TimedOut => Vec::new(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_pair_of_hid_sensors() {
    let tree = Tree::new();
    let usb = Some(("1209", "3-1"));
    let accel_attributes = [("in_accel_scale", "0.01\n"), ("in_accel_offset", "5\n"), ("sampling_frequency", "100\n")];
    // Its neighbour on another port comes first in the list and is not its partner.
    let _other = tree.sensor(0, "accel_3d", Some(("1209", "9-9")), &channels(ACCEL, HID), &accel_attributes);
    let mut accel = tree.sensor(1, "accel_3d", usb, &channels(ACCEL, HID), &accel_attributes);
    let gyro_attributes = [
        ("in_anglvel_scale", "0.001\n\0"),
        ("in_anglvel_mount_matrix", "0, 1, 0; -1, 0, 0; 0, 0, 1\n"),
        ("sampling_frequency", "200\n"),
    ];
    let mut gyro = tree.sensor(2, "gyro_3d", usb, &channels(GYRO, HID), &gyro_attributes);

    let mut imu = open(None, &Options { rate_hz: Some(400.0), ..tree.options() }).unwrap();
    assert_eq!((imu.info().kind.as_str(), imu.info().rate_hz), ("gyro_3d + accel_3d (IIO)", 400.0));
    for (sensor, kind) in [("iio:device1", "accel"), ("iio:device2", "anglvel")] {
        let get = |name: &str| tree.get(sensor, name);
        for axis in ["x", "y", "z"] {
            assert_eq!(get(&format!("scan_elements/in_{kind}_{axis}_en")), "1");
        }
        assert_eq!((get("scan_elements/in_timestamp_en"), get("buffer/enable")), ("1".to_owned(), "1".to_owned()));
        assert_eq!(get("current_timestamp_clock"), "monotonic");
    }
    assert_eq!(tree.get("iio:device2", "trigger/current_trigger"), "gyro_3d-dev2");
    assert_eq!(tree.get("iio:device0", "buffer/enable").trim(), "0");

    let t = now();
    assert!(read(&mut imu).is_empty(), "nothing came");
    send(&mut accel, &hid_scan([0, 0, 970], t));
    send(&mut gyro, &hid_scan([1, -2, 3], t));
    send(&mut gyro, &hid_scan([10, 20, -30], t + 5_000_000));
    let got = read(&mut imu);
    assert_eq!(got.len(), 1, "the second waits for the accelerometer");
    assert!((got[0].rate - Vec3::new(-0.002, -0.001, 0.003)).length() < 1e-7, "mounted: {}", got[0].rate);
    assert!((got[0].force - Vec3::new(0.05, 0.05, 9.75)).length() < 1e-5, "offset, then scale: {}", got[0].force);
    assert_eq!(got[0].time.as_nanos(), t, "the host's own clock is kept");
    // In two pieces.
    let scan = hid_scan([100, 0, 970], t + 10_000_000);
    send(&mut accel, &scan[..7]);
    assert!(read(&mut imu).is_empty());
    send(&mut accel, &scan[7..]);
    let got = read(&mut imu);
    assert!((got[0].force.x - 0.55).abs() < 1e-4, "half way: {}", got[0].force);
    drop(imu);
    assert_eq!(tree.get("iio:device1", "buffer/enable"), "0");
    assert_eq!(tree.get("iio:device2", "buffer/enable"), "0");
}

#[test]
fn one_sensor_with_both_by_its_name() {
    let tree = Tree::new();
    let kinds: Vec<(&str, &str)> =
        GYRO.iter().chain(&ACCEL).map(|name| (*name, "be:s12/16>>4")).chain([TIMESTAMP]).collect();
    let attributes = [("in_anglvel_scale", "0.5"), ("in_accel_x_scale", "2"), ("in_accel_scale", "1")];
    let mut pipe = tree.sensor(0, "bmi160", None, &kinds, &attributes);
    let mut imu = open(Some(Path::new("iio:device0")), &tree.options()).unwrap();
    let t = now();
    let mut scan = Vec::new();
    for v in [-2_i16, 4, 6, -8, 10, 12] {
        scan.extend((v << 4 | 0xf).to_be_bytes());
    }
    scan.extend([0xee; 4]);
    scan.extend(t.to_le_bytes());
    send(&mut pipe, &scan);
    let got = read(&mut imu);
    assert_eq!((got[0].rate, got[0].force), (Vec3::new(-1.0, 2.0, 3.0), Vec3::new(-16.0, 10.0, 12.0)));
    assert_eq!(got[0].time.as_nanos(), t);
}

#[test]
fn a_magnetometer_of_the_same_device_joins() {
    let tree = Tree::new();
    let usb = Some(("1209", "3-1"));
    let magn = ["magn_x", "magn_y", "magn_z"];
    let mut accel = tree.sensor(0, "accel_3d", usb, &channels(ACCEL, HID), &[]);
    let mut gyro = tree.sensor(1, "gyro_3d", usb, &channels(GYRO, HID), &[]);
    let mut field = tree.sensor(2, "magn_3d", usb, &channels(magn, HID), &[("in_magn_scale", "0.001")]);
    let _other = tree.sensor(3, "magn_3d", Some(("1209", "3-2")), &channels(magn, HID), &[]);
    let mut imu = open(None, &tree.options()).unwrap();
    assert_eq!(imu.info().kind, "gyro_3d + accel_3d + magn_3d (IIO)");
    let t = now();
    send(&mut field, &hid_scan([200, 0, -400], t - 1_000_000));
    send(&mut accel, &hid_scan([0, 0, 10], t));
    send(&mut gyro, &hid_scan([1, 2, 3], t));
    let got = read(&mut imu)[0];
    // A thousandth of a gauss is a tenth of a microtesla.
    assert!((got.field.unwrap() - Vec3::new(20.0, 0.0, -40.0)).length() < 1e-4, "{:?}", got.field);
    drop(imu);
    assert_eq!(tree.get("iio:device2", "buffer/enable"), "0");
    // One that only knows the field is no inertial sensor.
    let e = open(Some(Path::new("iio:device3")), &tree.options()).unwrap_err();
    assert!(e.to_string().contains("neither rate nor force"), "{e}");
}

#[test]
fn realsense_has_scales_of_its_own() {
    let of = |quirk| {
        let tree = Tree::new();
        let usb = Some(("8086", "2-1"));
        let kind = "le:s32/32>>0";
        let mut accel = tree.sensor(0, "accel_3d", usb, &channels(ACCEL, kind), &[("in_accel_scale", "77")]);
        let mut gyro = tree.sensor(1, "gyro_3d", usb, &channels(GYRO, kind), &[("in_anglvel_scale", "77")]);
        let mut imu = open(None, &Options { quirk, ..tree.options() }).unwrap();
        let t = now();
        send(&mut accel, &hid_scan([0, 0, 0], t)); // replaced below: whole cells
        let cells = |v: [i32; 3], t: i64| {
            let mut scan: Vec<u8> = v.iter().flat_map(|v| v.to_le_bytes()).collect();
            scan.extend([0; 4]);
            scan.extend(t.to_le_bytes());
            scan
        };
        send(&mut accel, &cells([0, -1000, 0], t + 1));
        send(&mut gyro, &cells([0x0001_fff6, 0, 0], t + 1));
        let noted = imu.info().notes.iter().any(|note| note.contains("5.16"));
        let got = read(&mut imu)[0];
        (got.rate.x, got.force.y, noted)
    };
    let (rate, force, noted) = of(None);
    assert!((force + 9.806_65).abs() < 1e-4 && noted);
    assert!((rate - 131_062.0 * 1e-4_f32.to_radians()).abs() < 1e-4, "{rate}");
    let (rate, force, noted) = of(Some(Quirk::RealSenseBefore516));
    assert!((rate + 1_f32.to_radians()).abs() < 1e-6, "ten tenths of a degree, negative: {rate}");
    assert!((force + 9.806_65).abs() < 1e-4 && !noted, "{force} {noted}");
    assert_eq!(of(Some(Quirk::None)).1, -77_000.0);
}

#[test]
fn a_clock_of_its_own_is_mapped_and_odd_stamps_are_dropped() {
    let tree = Tree::new();
    let kinds: Vec<(&str, &str)> = GYRO.iter().chain(&ACCEL).map(|n| (*n, "le:s16/16>>0")).chain([TIMESTAMP]).collect();
    let mut pipe = tree.sensor(0, "x", None, &kinds, &[]);
    let mut imu = open(None, &tree.options()).unwrap();
    let far = 3_000_000_000_000_000;
    let mut scan = |stamp: i64| {
        let mut scan = vec![1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 0, 0, 0, 0, 0];
        scan.extend(stamp.to_le_bytes());
        send(&mut pipe, &scan);
    };
    let before = now();
    for stamp in [far, far + 5_000_000, 1_700_000_000_000_000_000, far + 10_000_000, far + 10_000_000] {
        scan(stamp);
    }
    let got = read(&mut imu);
    let times: Vec<i64> = got.iter().map(|s| s.time.as_nanos()).collect();
    assert_eq!(times.len(), 3, "{times:?}");
    assert_eq!(imu.lost(), 2);
    assert!(times.windows(2).all(|two| two[0] < two[1]), "{times:?}");
    assert!(times.iter().all(|t| (before - 1_000_000_000..now() + 1_000_000_000).contains(t)), "{times:?}");
}

#[test]
fn a_backlog_of_two_sensors_is_no_jump() {
    let tree = Tree::new();
    let usb = Some(("1209", "3-1"));
    let mut accel = tree.sensor(0, "accel_3d", usb, &channels(ACCEL, HID), &[]);
    let mut gyro = tree.sensor(1, "gyro_3d", usb, &channels(GYRO, HID), &[]);
    let mut imu = open(None, &tree.options()).unwrap();
    // Half a second of both, of a clock of their own, before anybody reads.
    let far = 9_000_000_000_000_000;
    for i in 0..100 {
        send(&mut gyro, &hid_scan([i, 0, 0], far + i64::from(i) * 5_000_000));
        send(&mut accel, &hid_scan([0, i, 0], far + i64::from(i) * 5_000_000 - 1));
    }
    let mut all = Vec::new();
    for _ in 0..10 {
        all.extend(read(&mut imu));
    }
    let rates: Vec<f32> = all.iter().map(|s| s.rate.x).collect();
    assert!(all.len() == 99 || all.len() == 100, "{} lost, {rates:?}", imu.lost());
    for (i, sample) in all.iter().enumerate() {
        assert_eq!(sample.rate.x, i as f32);
        assert!((sample.force.y - i as f32).abs() < 0.01, "{i}: {}", sample.force);
    }
}

#[test]
fn a_sensor_that_is_gone_is_an_end() {
    let tree = Tree::new();
    let kinds: Vec<(&str, &str)> = GYRO.iter().chain(&ACCEL).map(|n| (*n, "le:s16/16>>0")).chain([TIMESTAMP]).collect();
    let pipe = tree.sensor(0, "x", None, &kinds, &[]);
    let mut imu = open(None, &tree.options()).unwrap();
    drop(pipe);
    let mut out = [ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None }; 4];
    for _ in 0..3 {
        let e = imu.read(&mut out, Deadline::NEVER).unwrap_err();
        assert!(e.is_terminal(), "{e}");
    }
}

#[test]
fn what_can_not_be_opened_says_why() {
    let error = |tree: &Tree, path: Option<&str>| open(path.map(Path::new), &tree.options()).unwrap_err();
    let tree = Tree::new();
    let e = error(&tree, None);
    assert!(matches!(e, SourceError::Unsupported { .. }) && e.to_string().contains("no gyroscope"), "{e}");
    let _alone = tree.sensor(0, "gyro", None, &channels(GYRO, HID), &[]);
    assert!(error(&tree, None).to_string().contains("there is no other"));
    assert!(error(&tree, Some("iio:device7")).to_string().contains("no inertial sensor"));

    let both =
        |kind: &'static str| -> Vec<(&str, &str)> { GYRO.iter().chain(&ACCEL).map(move |n| (*n, kind)).collect() };
    let cases: [(Vec<Pair>, &[Pair], &str); 5] = [
        ([both("le:s17/16>>0"), vec![TIMESTAMP]].concat(), &[], "IIO channel type"),
        ([both(HID), vec![("timestamp", "le:s32/32>>0")]].concat(), &[], "time stamps"),
        ([both(HID), vec![TIMESTAMP]].concat(), &[("in_accel_scale", "much")], "not a number"),
        ([both(HID), vec![TIMESTAMP]].concat(), &[("in_mount_matrix", "1, 2")], "mount matrix"),
        ([both(HID), vec![TIMESTAMP]].concat(), &[("scan_elements/in_accel_x_index", "first")], "no number"),
    ];
    for (kinds, attributes, says) in cases {
        let tree = Tree::new();
        let _pipe = tree.sensor(0, "x", None, &kinds, attributes);
        let e = error(&tree, None);
        assert!(e.to_string().contains(says), "{e}");
        assert_eq!(tree.get("iio:device0", "buffer/enable"), "0", "nothing is left running");
    }
    // No time stamps at all.
    let tree = Tree::new();
    let _pipe = tree.sensor(0, "x", None, &both(HID), &[]);
    assert!(error(&tree, None).to_string().contains("in_timestamp_en"));
}
