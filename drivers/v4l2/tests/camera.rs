//! A generic camera on the scripted kernel: every fault that the specification names, and what the program makes of it.

mod kernel;

use std::time::Duration;

use isobath_source::{
    BackPressure, Clock, Deadline, DepthPixels, DepthSource, GapCause, Outcome, OwnedFrame, SourceError,
};
use isobath_v4l2::sys::{Errno, FourCc, Kind, V4l2Sys as _};
use isobath_v4l2::{OpenOptions, V4l2Source, open_with};
use kernel::{Act, Call, FakeSys, Kernel, NodeScript, pixel};

const SIZE: (u32, u32) = (16, 12);

fn options(policy: BackPressure) -> OpenOptions {
    let mut options = OpenOptions { size: Some(SIZE), policy, ..OpenOptions::default() };
    options.roots.sys = "/nowhere".into();
    let set = &mut options.set;
    (set.fx, set.fy, set.cx, set.cy) = (Some(10.0), Some(10.0), Some(7.5), Some(5.5));
    set.depth.unit = Some(0.001);
    options
}

fn kernel() -> Kernel {
    Kernel::new("/dev/video0", NodeScript::video(b"Z16 ", SIZE))
}

fn open(kernel: &Kernel, policy: BackPressure) -> V4l2Source<FakeSys> {
    open_with(kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options(policy)).unwrap()
}

fn script(acts: impl IntoIterator<Item = Act>) -> Kernel {
    kernel().with(|w| {
        w.script = acts.into_iter().collect();
        w.endless = false;
    })
}

fn soon(kernel: &Kernel) -> Deadline {
    Deadline::after(kernel, Duration::from_millis(200))
}

/// Reads until the device is silent; what came, in words.
fn story(kernel: &Kernel, camera: &mut V4l2Source<FakeSys>) -> Vec<String> {
    let mut frame = OwnedFrame::new();
    let mut told = Vec::new();
    for _ in 0..500 {
        match camera.next_into(&mut frame, soon(kernel)) {
            Ok(Outcome::Frame) => {
                whole(&frame);
                told.push(format!("frame {}", frame.sequence));
            }
            Ok(Outcome::TimedOut) => {
                told.push("timeout".into());
                if kernel.world().script.is_empty() {
                    break;
                }
            }
            Ok(Outcome::Recovered(gap)) => told.push(format!("recovered {:?} {:?}", gap.cause, gap.lost)),
            Ok(other) => told.push(format!("{other:?}")),
            Err(e) => {
                let last = e.is_terminal();
                told.push(if last { "gone".into() } else { format!("error {:?}", e.errno()) });
                if last {
                    break;
                }
            }
        }
    }
    told
}

/// The frame's pixels are those that one number drew, everywhere.
fn whole(frame: &OwnedFrame) -> u32 {
    let DepthPixels::U16(values) = frame.depth() else { panic!("16 bits were sent") };
    assert_eq!(frame.size(), (SIZE.0 as usize, SIZE.1 as usize));
    let matching = (0..70_000)
        .find(|n| pixel(0, 0, *n) == values[0] && pixel(SIZE.0 - 1, SIZE.1 - 1, *n) == values[values.len() - 1]);
    let n = matching.expect("a frame that was drawn");
    for (i, v) in values.iter().enumerate() {
        let (x, y) = (i as u32 % SIZE.0, i as u32 / SIZE.0);
        assert_eq!(*v, pixel(x, y, n), "pixel {x},{y} of frame {n}");
    }
    n
}

fn finish(kernel: &Kernel, mut camera: V4l2Source<FakeSys>) {
    camera.stop().unwrap();
    camera.stop().unwrap();
    kernel.check();
}

#[test]
fn frames_come_with_their_pixels_time_and_number() {
    let kernel = kernel();
    let mut camera = open(&kernel, BackPressure::Queue(4));
    let mut frame = OwnedFrame::new();
    for n in 0..50 {
        assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
        assert_eq!((frame.sequence, whole(&frame)), (n, n as u32));
        let age = kernel.now().timestamp().as_nanos() - frame.time.as_nanos();
        assert!((0..40_000_000).contains(&age), "stamped by the kernel's clock: {age} ns ago");
        assert!((frame.unit.metres() - 0.001).abs() < 1e-9 && (frame.intrinsics.fx() - 10.0).abs() < 1e-6);
    }
    assert_eq!((camera.stats().delivered, camera.stats().lost()), (50, 0));
    finish(&kernel, camera);
}

#[test]
fn a_timeout_harms_nothing_before_or_between_frames() {
    let kernel = script([Act::Silence(450), Act::Whole, Act::Whole, Act::Silence(300), Act::Whole]);
    let mut camera = open(&kernel, BackPressure::Queue(4));
    let told = story(&kernel, &mut camera);
    assert_eq!(told, ["timeout", "timeout", "frame 0", "frame 1", "timeout", "frame 2", "timeout"]);
    finish(&kernel, camera);
}

#[test]
fn the_deadline_is_kept_to_the_millisecond() {
    let kernel = script([]);
    let mut camera = open(&kernel, BackPressure::Latest);
    camera.start().unwrap();
    let mut frame = OwnedFrame::new();
    for ms in [0_u64, 1, 7, 500] {
        let before = kernel.now();
        let deadline = Deadline::after(&kernel, Duration::from_millis(ms));
        assert_eq!(camera.next_into(&mut frame, deadline).unwrap(), Outcome::TimedOut);
        let waited = kernel.now().saturating_since(before);
        assert_eq!(waited, Duration::from_millis(ms));
    }
    finish(&kernel, camera);
}

#[test]
fn broken_and_short_frames_are_never_given() {
    let full = SIZE.0 * SIZE.1 * 2;
    let kernel = script([
        Act::Whole,
        Act::Flagged(full),
        Act::Flagged(full / 3),
        Act::Short(full - 1),
        Act::Short(1),
        Act::Short(0),
        Act::Whole,
    ]);
    let mut camera = open(&kernel, BackPressure::Queue(8));
    assert_eq!(story(&kernel, &mut camera), ["frame 0", "frame 6", "timeout"]);
    let stats = camera.stats();
    assert_eq!((stats.delivered, stats.corrupt, stats.short, stats.span()), (2, 2, 3, 7), "{stats:?}");
    finish(&kernel, camera);
}

#[test]
fn gaps_are_counted_and_told_to_who_wants_every_frame() {
    let acts = || [Act::Whole, Act::Skip(3), Act::Whole, Act::Whole, Act::Skip(1), Act::Flagged(9), Act::Whole];
    let kernel = script(acts());
    let mut camera = open(&kernel, BackPressure::Queue(8));
    assert_eq!(story(&kernel, &mut camera), ["frame 0", "frame 4", "frame 5", "frame 8", "timeout"]);
    let stats = camera.stats();
    assert_eq!((stats.delivered, stats.dropped_by_system, stats.corrupt, stats.span()), (4, 4, 1, 9));
    finish(&kernel, camera);

    let kernel = script(acts());
    let mut camera = open(&kernel, BackPressure::Every);
    let told = story(&kernel, &mut camera);
    assert_eq!(told, ["frame 0", "recovered Overrun Some(3)", "frame 4", "frame 5", "frame 8", "timeout"]);
    assert_eq!(camera.stats().span(), 9);
    finish(&kernel, camera);
}

#[test]
fn the_newest_frame_wins_and_a_queue_keeps_the_oldest() {
    let slow = |policy| {
        let kernel = kernel();
        let mut camera = open(&kernel, policy);
        let mut frame = OwnedFrame::new();
        let mut seen = Vec::new();
        for _ in 0..5 {
            assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
            seen.push(u64::from(whole(&frame)));
            assert_eq!(frame.sequence, *seen.last().unwrap());
            // Three frames' time of computing.
            camera.sys().pause(Duration::from_millis(100));
        }
        let stats = camera.stats();
        assert_eq!(stats.span(), seen.last().unwrap() + 1, "{stats:?} {seen:?}");
        finish(&kernel, camera);
        (seen, stats)
    };
    let (seen, stats) = slow(BackPressure::Latest);
    assert!(seen.windows(2).all(|w| w[1] - w[0] >= 3), "{seen:?}");
    assert!(stats.dropped_by_policy > 6 && stats.dropped_by_system == 0, "{stats:?}");
    assert!(stats.max_latency < Duration::from_millis(34), "{stats:?}");
    let (seen, stats) = slow(BackPressure::Queue(20));
    assert_eq!((seen, stats.dropped_by_policy), (vec![0, 1, 2, 3, 4], 0));
    let (_, stats) = slow(BackPressure::Queue(2));
    assert!(stats.dropped_by_policy == 0, "{stats:?}");
}

#[test]
fn interruptions_and_storms_of_false_alarms_are_survived() {
    for call in [
        Call::Dequeue,
        Call::Queue,
        Call::Poll,
        Call::StreamOn,
        Call::RequestBuffers,
        Call::Map,
        Call::Capability,
        Call::Open,
    ] {
        let kernel = kernel();
        for after in [0, 1, 2, 5] {
            kernel.fail(call, after, Errno::EINTR);
        }
        let mut camera = open(&kernel, BackPressure::Queue(4));
        let mut frame = OwnedFrame::new();
        for n in 0..20 {
            assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
            assert_eq!(frame.sequence, n);
        }
        finish(&kernel, camera);
    }
    // A thousand times "ready" with nothing there: pauses, and the frame comes all the same.
    let kernel = kernel().with(|w| w.false_ready = 1000);
    let mut camera = open(&kernel, BackPressure::Queue(4));
    let mut frame = OwnedFrame::new();
    let mut outcomes = 0;
    while camera.next_into(&mut frame, soon(&kernel)).unwrap() != Outcome::Frame {
        outcomes += 1;
        assert!(outcomes < 200);
    }
    finish(&kernel, camera);
}

#[test]
fn a_failing_link_is_restarted_and_told() {
    for (call, errno) in [
        (Call::Dequeue, Errno::EIO),
        (Call::Dequeue, Errno::EPIPE),
        (Call::Queue, Errno::EIO),
        (Call::Poll, Errno::EIO),
        (Call::Dequeue, Errno(71)),
    ] {
        let kernel = kernel();
        let mut camera = open(&kernel, BackPressure::Queue(4));
        let mut frame = OwnedFrame::new();
        for _ in 0..3 {
            assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
        }
        kernel.fail(call, 0, errno);
        let (mut recovered, mut frames, mut last) = (0, 0, frame.sequence);
        for _ in 0..10 {
            match camera.next_into(&mut frame, soon(&kernel)).unwrap() {
                Outcome::Frame => {
                    assert!(frame.sequence > last, "numbers go on over a restart");
                    last = frame.sequence;
                    frames += 1;
                }
                Outcome::Recovered(gap) => {
                    assert_eq!((gap.cause, gap.lost), (GapCause::Link, None));
                    recovered += 1;
                }
                other => panic!("{call:?} {errno:?}: {other:?}"),
            }
        }
        assert_eq!((recovered, frames, camera.stats().recoveries), (1, 9, 1), "{call:?} {errno:?}");
        finish(&kernel, camera);
    }
}

#[test]
fn a_link_that_stays_broken_is_an_error_that_waits() {
    let kernel = kernel();
    let mut camera = open(&kernel, BackPressure::Latest);
    let mut frame = OwnedFrame::new();
    assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
    for after in 0..400 {
        kernel.fail(Call::Dequeue, after, Errno::EIO);
        kernel.fail(Call::StreamOn, after, Errno::EIO);
    }
    let before = kernel.now();
    let mut errors = 0;
    for _ in 0..20 {
        match camera.next_into(&mut frame, Deadline::after(&kernel, Duration::from_secs(1))) {
            Err(e) => {
                assert!(matches!(e, SourceError::Link { .. }) && e.is_retryable(), "{e}");
                errors += 1;
            }
            Ok(outcome) => assert_ne!(outcome, Outcome::Frame),
        }
    }
    let each = kernel.now().saturating_since(before) / 20;
    assert!(errors >= 10 && each > Duration::from_millis(100), "{errors} errors, {each:?} each");
    finish(&kernel, camera);
}

#[test]
fn cancelled_buffers_are_no_frames_and_no_gap() {
    let kernel =
        script([Act::Whole, Act::Whole, Act::Cancel, Act::Whole, Act::Cancel, Act::Cancel, Act::Whole, Act::Whole]);
    let mut camera = open(&kernel, BackPressure::Queue(2));
    let told = story(&kernel, &mut camera);
    assert_eq!(told, ["frame 0", "frame 1", "frame 2", "frame 3", "frame 4", "timeout"]);
    let stats = camera.stats();
    assert_eq!((stats.span(), stats.recoveries, stats.cancelled), (5, 0, 12), "{stats:?}");
    finish(&kernel, camera);
}

#[test]
fn a_stream_that_stands_still_after_a_failed_transfer_is_started_again() {
    let kernel = script([Act::Whole, Act::Cancel, Act::Silence(2000), Act::Whole]);
    let mut camera = open(&kernel, BackPressure::Queue(2));
    let told = story(&kernel, &mut camera);
    let again = told.iter().position(|t| t == "recovered Link None").expect("it is told");
    assert!(told[1..again].iter().all(|t| t == "timeout") && again < 6, "half a second after it failed: {told:?}");
    assert_eq!(told.iter().filter(|t| t.starts_with("frame")).count(), 2, "{told:?}");
    assert_eq!((camera.stats().recoveries, camera.stats().cancelled), (1, 4));
    finish(&kernel, camera);
}

#[test]
fn a_driver_that_numbers_badly_loses_nothing() {
    let kernel = script([
        Act::Whole,
        Act::Whole,
        Act::Renumber(0),
        Act::Whole,
        Act::Renumber(0),
        Act::Whole,
        Act::Whole,
        Act::Renumber(u32::MAX),
        Act::Whole,
        Act::Whole,
    ]);
    let mut camera = open(&kernel, BackPressure::Queue(8));
    let told = story(&kernel, &mut camera);
    assert_eq!(told.iter().filter(|t| t.starts_with("frame")).count(), 7, "{told:?}");
    assert_eq!(camera.stats().delivered, 7);
    finish(&kernel, camera);
}

#[test]
fn an_unplugged_camera_is_gone_whenever_it_goes() {
    // While waiting.
    let kernel = script([Act::Whole, Act::Silence(50), Act::Unplug]);
    let mut camera = open(&kernel, BackPressure::Queue(4));
    assert_eq!(story(&kernel, &mut camera), ["frame 0", "gone"]);
    let mut frame = OwnedFrame::new();
    let calls = kernel.world().idle_calls;
    for _ in 0..1000 {
        assert!(camera.next_into(&mut frame, Deadline::NEVER).unwrap_err().is_terminal());
    }
    assert!(kernel.world().idle_calls <= calls + 1, "a lost device is not asked again");
    finish(&kernel, camera);

    // In each call.
    for call in [Call::Poll, Call::Queue, Call::Dequeue] {
        let kernel = self::kernel();
        let mut camera = open(&kernel, BackPressure::Latest);
        assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
        kernel.fail(call, 0, Errno::ENODEV);
        let mut outcome = camera.next_into(&mut frame, soon(&kernel));
        if matches!(outcome, Ok(Outcome::Frame)) {
            outcome = camera.next_into(&mut frame, soon(&kernel));
        }
        assert!(outcome.unwrap_err().is_terminal(), "{call:?}");
        finish(&kernel, camera);
    }
    for call in [Call::StreamOff, Call::Unmap, Call::RequestBuffers] {
        let kernel = self::kernel();
        let mut camera = open(&kernel, BackPressure::Latest);
        assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
        kernel.fail(call, 0, Errno::ENODEV);
        // Whatever says so: everything is given back.
        camera.stop().unwrap();
        drop(camera);
        let world = kernel.world();
        assert_eq!(world.mappings, 0, "{call:?}");
    }
}

#[test]
fn starting_fails_cleanly_at_every_step() {
    for call in [Call::RequestBuffers, Call::QueryBuffer, Call::Map, Call::Queue, Call::StreamOn] {
        for after in [0, 1, 3] {
            if after > 0 && matches!(call, Call::RequestBuffers | Call::StreamOn) {
                continue;
            }
            let kernel = kernel();
            let mut camera = open(&kernel, BackPressure::Latest);
            kernel.fail(call, after, Errno(28));
            let error = camera.start().unwrap_err();
            assert!(matches!(error, SourceError::Link { .. }) && error.to_string().contains("bandwidth"), "{error}");
            assert_eq!(kernel.world().mappings, 0, "{call:?} {after}");
            let mut frame = OwnedFrame::new();
            assert_eq!(
                camera.next_into(&mut frame, soon(&kernel)).unwrap(),
                Outcome::Frame,
                "{call:?}: the next try works"
            );
            finish(&kernel, camera);
        }
    }
    let kernel = kernel();
    kernel.fail(Call::SetFormat, 0, Errno::EBUSY);
    let error = open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options(BackPressure::Latest))
        .unwrap_err();
    assert!(matches!(error, SourceError::Busy { .. }) && error.errno() == Some(16), "{error}");
    kernel.fail(Call::Open, 0, Errno(13));
    let error = open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options(BackPressure::Latest))
        .unwrap_err();
    assert!(
        matches!(error, SourceError::Permission { .. }) && error.to_string().contains("SUBSYSTEM==\"video4linux\""),
        "{error}"
    );
    kernel.check();
}

#[test]
fn strides_offsets_and_pages_are_not_pixels() {
    for (padding, kind, data_offset) in [(10, Kind::Video, 0), (0, Kind::Planes, 128), (64, Kind::Planes, 4000)] {
        let mut node = NodeScript::video(b"Z16 ", SIZE);
        (node.padding, node.kind, node.data_offset) = (padding, kind, data_offset);
        let kernel = Kernel::new("/dev/video0", node);
        let full = (SIZE.0 * 2 + padding) * SIZE.1;
        kernel.world().script = [Act::Whole, Act::Short(full - padding - 1), Act::Whole].into();
        kernel.world().endless = false;
        let mut camera = open(&kernel, BackPressure::Queue(4));
        assert_eq!(story(&kernel, &mut camera), ["frame 0", "frame 2", "timeout"]);
        assert_eq!(camera.stats().short, 1);
        finish(&kernel, camera);
    }
}

#[test]
fn the_format_granted_is_the_one_asked_for_or_none() {
    for grants in [(FourCc(*b"YUYV"), SIZE.0, SIZE.1), (FourCc(*b"Z16 "), 8, 6)] {
        let mut node = NodeScript::video(b"Z16 ", SIZE);
        node.grants = Some(grants);
        let kernel = Kernel::new("/dev/video0", node);
        let error =
            open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options(BackPressure::Latest))
                .unwrap_err();
        let text = error.to_string();
        assert!(
            matches!(error, SourceError::Unsupported { .. }) && text.contains("was granted") && text.contains("16x12"),
            "{text}"
        );
    }
    let kernel = Kernel::new("/dev/video0", NodeScript::video(b"YUYV", SIZE));
    let error = open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options(BackPressure::Latest))
        .unwrap_err();
    assert!(error.to_string().contains("YUYV"), "{error}");
}

#[test]
fn what_nobody_says_is_asked_for_by_name() {
    let kernel = kernel();
    let mut options = options(BackPressure::Latest);
    options.set.depth.unit = None;
    options.set.cx = None;
    let error = open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options).unwrap_err();
    let SourceError::MissingCalibration { needed, .. } = error else { panic!("{error}") };
    assert_eq!(needed, ["cx", "depth.unit"]);
}

#[test]
fn a_driver_that_stamps_by_another_clock_gets_the_time_of_arrival() {
    let kernel = kernel().with(|w| w.stamps = false);
    let mut camera = open(&kernel, BackPressure::Queue(4));
    let mut frame = OwnedFrame::new();
    for _ in 0..5 {
        assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
        assert_eq!(frame.time, kernel.now().timestamp());
    }
    finish(&kernel, camera);
}

#[test]
fn held_frames_stay_as_they_are_and_cannot_starve_the_stream() {
    let kernel = kernel();
    let mut camera = open(&kernel, BackPressure::Queue(3));
    let mut held = Vec::new();
    for n in 0..3 {
        let (outcome, raw) = camera.lease(soon(&kernel)).unwrap();
        assert_eq!(outcome, Outcome::Frame);
        let raw = raw.unwrap();
        assert_eq!(raw.sequence, n);
        held.push(raw);
    }
    assert!(matches!(camera.lease(soon(&kernel)), Err(SourceError::LeaseLimit { limit: 3 })));
    // The stream goes on through the two that are left, and over a restart.
    let mut frame = OwnedFrame::new();
    kernel.fail(Call::Dequeue, 2, Errno::EIO);
    let outcomes: Vec<_> = (0..10).map(|_| camera.next_into(&mut frame, soon(&kernel)).unwrap()).collect();
    assert_eq!(outcomes.iter().filter(|o| **o == Outcome::Frame).count(), 9, "{outcomes:?}");
    for (n, raw) in held.iter().enumerate() {
        let bytes = camera.raw_bytes(raw);
        assert_eq!(bytes.len() as u32, SIZE.0 * SIZE.1 * 2);
        assert_eq!(u16::from_le_bytes([bytes[2], bytes[3]]), pixel(1, 0, n as u32));
    }
    camera.give_back(held.remove(0));
    let (_, raw) = camera.lease(soon(&kernel)).unwrap();
    held.push(raw.unwrap());
    // Stopped, what is held is empty, and giving it back to the next stream gives nothing.
    camera.stop().unwrap();
    assert!(held.iter().all(|raw| camera.raw_bytes(raw).is_empty()));
    camera.start().unwrap();
    held.drain(..).for_each(|raw| camera.give_back(raw));
    for _ in 0..10 {
        assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
    }
    finish(&kernel, camera);
}

/// Packs codes that one formula draws, as a format says.
fn packed(fourcc: FourCc, width: u32, height: u32, stride: u32, frame: u32) -> Vec<u8> {
    let codes = |bits: u32| move |x, y| pixel(x, y, frame) & ((1 << bits) - 1);
    let mut bytes = vec![0; (stride * height) as usize];
    let plane = (stride / 2 * height) as usize;
    for y in 0..height {
        for x in 0..width {
            let at = (y * stride + 2 * x) as usize;
            match &fourcc.0 {
                b"Y12 " => bytes[at..at + 2].copy_from_slice(&codes(12)(x, y).to_le_bytes()),
                b"INZI" => {
                    let at = plane + (y * stride / 2 + 2 * x) as usize;
                    bytes[at..at + 2].copy_from_slice(&pixel(x, y, frame).to_le_bytes());
                }
                b"Y10B" => {
                    for bit in 0..10 {
                        let place = x * 10 + bit;
                        let value = (codes(10)(x, y) >> (9 - bit)) as u8 & 1;
                        bytes[(y * stride + place / 8) as usize] |= value << (7 - place % 8);
                    }
                }
                _ => bytes[at..at + 2].copy_from_slice(&pixel(x, y, frame).to_be_bytes()),
            }
        }
    }
    bytes
}

#[test]
fn every_format_is_unpacked() {
    for (fourcc, bits) in [(*b"Y12 ", 12), (*b"INZI", 16), (*b"Y10B", 10), ([b'Y', b'1', b'6', b' ' | 0x80], 16)] {
        let kernel = Kernel::new("/dev/video0", NodeScript::video(&fourcc, SIZE)).with(|w| w.draw = packed);
        let mut camera = open(&kernel, BackPressure::Queue(4));
        let mut frame = OwnedFrame::new();
        for n in 0..3 {
            assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame, "{:?}", FourCc(fourcc));
            let DepthPixels::U16(values) = frame.depth() else { panic!("16 bits were sent") };
            for (i, v) in values.iter().enumerate() {
                let code = u32::from(pixel(i as u32 % SIZE.0, i as u32 / SIZE.0, n)) & ((1 << bits) - 1);
                // The last code of Kinect's ten bits means "nothing".
                let want = if bits == 10 && code == 1023 { 0 } else { code as u16 };
                assert_eq!(*v, want, "{:?} pixel {i}", FourCc(fourcc));
            }
        }
        finish(&kernel, camera);
    }
}

#[test]
fn disparity_becomes_metres_and_limits_hold() {
    let kernel = kernel();
    let mut options = options(BackPressure::Queue(4));
    let depth = &mut options.set.depth;
    depth.format = Some(isobath_recording::Format::Disparity);
    (depth.unit, depth.baseline, depth.focal, depth.scale) = (None, Some(0.05), Some(400.0), Some(0.125));
    (depth.min_z, depth.max_z) = (Some(0.1), Some(2.0));
    let mut camera = open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options).unwrap();
    let mut frame = OwnedFrame::new();
    assert_eq!(camera.next_into(&mut frame, soon(&kernel)).unwrap(), Outcome::Frame);
    for (x, y) in [(0, 0), (3, 7), (15, 11), (9, 2)] {
        let z = 400.0 * 0.05 / (f64::from(pixel(x, y, 0)) * 0.125);
        let want = if (0.1..=2.0).contains(&z) { z } else { 0.0 };
        assert!((f64::from(frame.z(x as usize, y as usize)) - want).abs() < 1e-5, "{x},{y}");
    }
    finish(&kernel, camera);
    // What no camera gives is refused before it is opened.
    options.set.depth.format = Some(isobath_recording::Format::F32);
    assert!(open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options).is_err());
}
