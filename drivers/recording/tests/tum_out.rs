//! TUM out and in again.

use isobath::glam::{Quat, Vec3};
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::imu::ImuSample;
use isobath_recording::{OpenOptions, TumOptions, TumWriter, open, open_imu};
use isobath_source::{Deadline, DepthPixels, ImuOutcome, ImuSource as _, Outcome, OwnedFrame};
use proptest::prelude::*;

fn frame(values: &[u16], unit: f32, index: i64) -> OwnedFrame {
    let mut f = OwnedFrame::new();
    f.depth_u16_mut(values.len(), 1).copy_from_slice(values);
    f.colour_mut(2, 2).fill([index as u8, 2, 3]);
    f.unit = DepthUnit::new(unit).unwrap();
    f.intrinsics = Intrinsics::new(525.3, -525.1, 319.5, 239.25).unwrap();
    f.pose = Some(Pose::new(Quat::from_rotation_x(0.3), Vec3::new(0.1, index as f32, -7.5)).unwrap());
    f.time = Timestamp::from_nanos(1_341_841_278_842_700_001 + index * 33_333_333);
    f
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn whole_steps_come_back_exactly(values in prop::collection::vec(0_u16..13_106, 1..20), finer in 0_usize..3) {
        let (unit, per_step) = [(0.0002_f32, 1), (0.001, 5), (0.0004, 2)][finer];
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("out");
        let mut w = TumWriter::create(&folder, TumOptions { up: Some(Vec3::Y), ..TumOptions::default() }).unwrap();
        let frames: Vec<_> = (0..2).map(|i| frame(&values, unit, i)).collect();
        for f in &frames {
            w.frame(f).unwrap();
        }
        let report = w.finish().unwrap();
        prop_assert!(report.is_lossless() && report.notes.is_empty(), "{report:?}");

        let mut r = open(&folder, &OpenOptions::default()).unwrap();
        prop_assert_eq!((r.len(), r.info().up), (2, Some(Vec3::Y)));
        let mut read = OwnedFrame::new();
        for f in &frames {
            prop_assert_eq!(r.next_into(&mut read, Deadline::NEVER).unwrap(), Outcome::Frame);
            let steps: Vec<u16> = values.iter().map(|v| v * per_step).collect();
            prop_assert_eq!(read.depth(), &DepthPixels::U16(steps));
            prop_assert_eq!(read.unit, DepthUnit::new(0.0002).unwrap());
            prop_assert_eq!((read.time, read.intrinsics), (f.time, f.intrinsics));
            prop_assert_eq!(read.colour().unwrap().rows().next(), f.colour().unwrap().rows().next());
            prop_assert!((read.pose.unwrap().translation() - f.pose.unwrap().translation()).length() < 1e-6);
        }
    }
}

#[test]
fn what_is_lost_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let mut w = TumWriter::create(dir.path(), TumOptions::default()).unwrap();
    // 0.1 mm: odd numbers are half a step; 1 of them rounds up to a step, not down to a hole.
    w.frame(&frame(&[0, 1, 2, 3, 65_535], 0.0001, 0)).unwrap();
    w.frame(&frame(&[0, 13_106, 13_107, 20_000, 65_535], 0.001, 1)).unwrap();
    let mut other = frame(&[1; 5], 0.001, 2);
    other.intrinsics = Intrinsics::new(1.0, 1.0, 0.0, 0.0).unwrap();
    other.confidence_mut();
    w.frame(&other).unwrap();
    assert!(w.frame(&frame(&[1; 4], 0.001, 3)).is_err(), "another size");
    let sample =
        ImuSample { time: Timestamp::from_nanos(-5), rate: Vec3::X * 0.1, force: Vec3::Y * -9.8, field: Some(Vec3::Z) };
    w.imu(&sample).unwrap();
    let report = w.finish().unwrap();
    assert_eq!((report.frames, report.imu_samples, report.rounded, report.too_far), (3, 1, 2, 2));
    let notes = report.notes.join("\n");
    for word in ["rounded", "beyond 13.1 m", "confidence", "magnetic", "intrinsics change"] {
        assert!(notes.contains(word), "{word}: {notes}");
    }
    let mut read = OwnedFrame::new();
    let mut r = open(dir.path(), &OpenOptions::default()).unwrap();
    let _ = r.next_into(&mut read, Deadline::NEVER).unwrap();
    assert_eq!(read.depth(), &DepthPixels::U16(vec![0, 1, 1, 2, 0]));
    let error = TumWriter::create(dir.path(), TumOptions::default()).unwrap_err();
    assert!(error.to_string().contains("never overwritten"), "{error}");

    let mut imu = open_imu(dir.path()).unwrap().expect("imu.csv");
    let mut out = [sample; 4];
    assert_eq!(imu.read(&mut out, Deadline::NEVER).unwrap(), ImuOutcome::Samples(1));
    assert_eq!(out[0], ImuSample { field: None, ..sample });
    assert_eq!(imu.read(&mut out, Deadline::NEVER).unwrap(), ImuOutcome::EndOfStream);
    std::fs::write(dir.path().join("imu.csv"), "a\n1,2,3\n").unwrap();
    assert!(open_imu(dir.path()).unwrap_err().to_string().contains("imu.csv:2"));
}
