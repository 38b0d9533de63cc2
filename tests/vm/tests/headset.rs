//! A headset with firmware of our own, over USB without a kernel driver.

use std::time::{Duration, Instant};

use isobath::glam::Vec3;
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuSample;
use isobath::wire::bulk::Encoding;
use isobath_source::{Deadline, DepthSource, GapCause, ImuOutcome, ImuSource, OwnedFrame, SystemClock};
use isobath_usb::bulk::{Bulk, CLASS};
use isobath_usb::link::Options;
use isobath_usb::live::{self, LibUsb};
use isobath_vm::gadget::Gadget;
use isobath_vm::guest::{modprobe, processor_time, wait_for};
use isobath_vm::profiles::headset::{Fault, Headset, IMU_HZ, PINHOLE, SIZE, UNIT_M, reading};
use isobath_vm::usb::{Plugged, Speed};
use isobath_vm::watch::{Seen, WAIT, next, numbers, until_frames};

fn plug(serial: &str, speed: Speed) -> Plugged<Headset> {
    modprobe(&["vhci-hcd"]);
    Plugged::new(Headset::new(serial, (0xfff0, 0x0002), CLASS, speed)).unwrap()
}

/// Opens it once the kernel has it.
fn open(serial: &str, reconnect: bool) -> Bulk<LibUsb> {
    wait_for("the headset", || live::bulk(Some(serial), Options { reconnect }).ok())
}

/// What a headset that says all of itself gives.
fn answers_are_right(source: &mut Bulk<LibUsb>) {
    let mut frame = OwnedFrame::new();
    for _ in 0..5 {
        let seen = next(source, &mut frame, WAIT);
        assert!(matches!(seen, Seen::Frame(Some(_))), "{seen:?}");
        let k = frame.intrinsics;
        assert_eq!(([k.fx(), k.fy(), k.cx(), k.cy()], frame.unit.metres(), frame.size()), (PINHOLE, UNIT_M, SIZE));
    }
}

#[test]
fn depth_is_right_at_both_speeds_and_in_both_encodings() {
    for (serial, speed, encoding) in [
        ("headset-hs", Speed::High, Encoding::Raw),
        ("headset-ss", Speed::Super, Encoding::Raw),
        ("headset-rvl", Speed::High, Encoding::Rvl),
    ] {
        let device = plug(serial, speed);
        device.device().encoding = encoding;
        answers_are_right(&mut open(serial, false));
    }
}

/// The same firmware behind a controller of the kernel's own, which gives the endpoint another address.
#[test]
fn depth_is_right_from_a_gadget() {
    modprobe(&["dummy_hcd is_super_speed=1", "libcomposite", "usb_f_fs"]);
    let gadget = Gadget::bind(Headset::new("gadget", (0xfff0, 0x0003), CLASS, Speed::Super)).unwrap();
    let mut source = open("gadget", false);
    answers_are_right(&mut source);
    drop(gadget);
    let seen = until_frames(&mut source, 20);
    assert!(matches!(seen.last(), Some(Seen::Gone(_))), "{seen:?}");
}

/// Readings come in order, none missing, with the device's spacing; depth asked for meanwhile loses none.
#[test]
fn inertial_readings_are_right_and_complete() {
    let _device = plug("headset-imu", Speed::High);
    let mut source = open("headset-imu", false);
    let empty = ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None };
    let (mut read, mut samples, mut frame) = (Vec::new(), [empty; 64], OwnedFrame::new());
    while read.len() < 400 {
        if read.len() % 3 == 0 {
            let seen = next(&mut source, &mut frame, WAIT);
            assert!(matches!(seen, Seen::Frame(Some(_))), "{seen:?}");
        }
        match source.read(&mut samples, Deadline::after(&SystemClock, WAIT)).unwrap() {
            ImuOutcome::Samples(n) => read.extend_from_slice(&samples[..n]),
            other => panic!("{other:?} after {} readings", read.len()),
        }
    }
    let first = (read[0].rate.y / 0.001).round() as u64;
    for (sample, number) in read.iter().zip(first..) {
        assert_eq!((sample.rate, sample.force), reading(number), "reading {number}");
    }
    let steps = read.windows(2).map(|w| w[1].time.as_nanos() - w[0].time.as_nanos());
    let period = 1_000_000_000 / IMU_HZ as i64;
    assert!(steps.clone().all(|step| step > 0), "{:?}", steps.collect::<Vec<_>>());
    assert!((steps.sum::<i64>() / 399 - period).abs() < period / 50);
}

/// What is damaged on its way is never given, and counted.
#[test]
fn damaged_messages_are_never_given() {
    let device = plug("headset-noise", Speed::High);
    let mut source = open("headset-noise", false);
    let mut seen = until_frames(&mut source, 2);
    let first = device.device().next_frame() + 2;
    let faults = [
        (first, Fault::Flipped(20_000)),
        (first + 2, Fault::Cut(20_000)),
        (first + 4, Fault::Noise(5000)),
        (first + 6, Fault::Skipped),
        (first + 8, Fault::Flipped(5)),
    ];
    device.device().faults.extend(faults);
    seen.extend(until_frames(&mut source, 14));
    let numbers = numbers(&seen);
    for (frame, fault) in faults {
        // Noise before a message harms nothing.
        assert_eq!(numbers.contains(&frame), matches!(fault, Fault::Noise(_)), "{fault:?}: {numbers:?}");
    }
    let stats = source.stats();
    assert_eq!(stats.span(), numbers[numbers.len() - 1] - numbers[0] + 1, "{stats:?} {numbers:?}");
}

#[test]
fn a_stall_is_cleared_and_told() {
    let device = plug("headset-stall", Speed::High);
    let mut source = open("headset-stall", false);
    let mut seen = until_frames(&mut source, 2);
    let stalled = device.device().next_frame() + 1;
    device.device().faults.insert(stalled, Fault::Halt(10_000));
    seen.extend(until_frames(&mut source, 5));
    let numbers = numbers(&seen);
    assert!(!numbers.contains(&stalled) && numbers.iter().any(|n| *n > stalled), "{seen:?}");
    assert!(seen.iter().any(|s| matches!(s, Seen::Gap(gap) if gap.cause == GapCause::Link)), "{seen:?}");
}

#[test]
fn silence_is_a_timeout_and_takes_no_processor() {
    let device = plug("headset-silence", Speed::High);
    let mut source = open("headset-silence", false);
    until_frames(&mut source, 2);
    let late = device.device().next_frame() + 1;
    device.device().faults.insert(late, Fault::Late(Duration::from_secs(8)));
    let (mut frame, mut waited, before) = (OwnedFrame::new(), Duration::ZERO, processor_time());
    let mut after = 0;
    while after < 3 {
        match next(&mut source, &mut frame, Duration::from_secs(1)) {
            Seen::TimedOut(time) => {
                assert!(time >= Duration::from_secs(1) && time < Duration::from_millis(1300), "{time:?}");
                waited += time;
            }
            Seen::Frame(Some(_)) => after += u32::from(!waited.is_zero()),
            other => panic!("{other:?}"),
        }
    }
    assert!(waited > Duration::from_secs(5), "{waited:?}");
    let took = processor_time() - before;
    assert!(took < waited / 4, "{took:?} of the processor for {waited:?} of waiting");
}

#[test]
fn unplugged_in_the_middle_of_a_frame_is_the_end() {
    let device = plug("headset-pull", Speed::High);
    let mut source = open("headset-pull", false);
    until_frames(&mut source, 2);
    let last = device.device().next_frame() + 1;
    device.device().faults.insert(last, Fault::Unplug(20_000));
    let seen = until_frames(&mut source, 50);
    assert!(numbers(&seen).iter().all(|n| *n < last));
    assert!(matches!(seen.last(), Some(Seen::Gone(time)) if *time < Duration::from_secs(2)), "{seen:?}");
    let (mut frame, before, start) = (OwnedFrame::new(), processor_time(), Instant::now());
    for _ in 0..100 {
        assert!(matches!(next(&mut source, &mut frame, Duration::from_secs(5)), Seen::Gone(_)));
    }
    assert!(start.elapsed() < Duration::from_secs(1) && processor_time() - before < Duration::from_secs(1));
}

/// Asked to, a source waits for its device to come back, and goes on.
#[test]
fn unplugged_and_plugged_in_again_it_goes_on() {
    let device = plug("headset-again", Speed::High);
    let mut source = open("headset-again", true);
    until_frames(&mut source, 2);
    let device = device.unplug().unwrap();
    let mut frame = OwnedFrame::new();
    let away = loop {
        match next(&mut source, &mut frame, Duration::from_secs(1)) {
            Seen::Frame(Some(_)) => {}
            other => break other,
        }
    };
    assert!(matches!(away, Seen::TimedOut(_)), "{away:?}");
    let device = Plugged::new(device).unwrap();
    let seen = until_frames(&mut source, 4);
    assert!(seen.iter().any(|s| matches!(s, Seen::Gap(gap) if gap.cause == GapCause::Replugged)), "{seen:?}");
    assert_eq!(seen.iter().filter(|s| s.number().is_some()).count(), 4, "{seen:?}");
    drop(device);
}
