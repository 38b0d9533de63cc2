//! Sources around sources: what goes in comes out, and the counts add up.

mod common;

use std::sync::{Arc, Mutex};
use std::time::Duration;

use common::Numbers;
use isobath_source::{
    BackPressure, Clock, Deadline, DepthSource, FaultInjector, Faults, FrameSink, Gap, HostNanos, Outcome, OwnedFrame,
    Pumped, Recorded, SourceError, SystemClock, Tracer, digest,
};
use proptest::prelude::*;

fn soon() -> Deadline {
    // Long enough that only a hang reaches it.
    Deadline::after(&SystemClock, Duration::from_secs(20))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn injected_faults_are_counted_once(seed: u64, len in 1_u64..400, unplug in prop::option::of(0_u64..300)) {
        let run = |log: &mut Vec<String>| {
            let faults = Faults { unplug_after: unplug, ..Faults::rough(seed) };
            let mut source = FaultInjector::new(Numbers::new(len), faults);
            let mut frame = OwnedFrame::new();
            let (mut frames, mut calls, mut last) = (0, 0, None);
            loop {
                calls += 1;
                assert!(calls < 20 * len + 1000, "a fault must not be for ever");
                match source.next_into(&mut frame, Deadline::NEVER) {
                    Ok(Outcome::Frame) => {
                        assert!(last < Some(frame.sequence), "in order");
                        last = Some(frame.sequence);
                        frames += 1;
                    }
                    Ok(Outcome::EndOfStream) => break,
                    Ok(other) => log.push(format!("{other:?}")),
                    Err(e) if e.is_terminal() => {
                        assert!(unplug.is_some());
                        break;
                    }
                    Err(e) => {
                        assert!(e.is_retryable());
                        log.push(e.to_string());
                    }
                }
            }
            let stats = source.stats();
            assert_eq!(stats.delivered, frames);
            assert_eq!(stats.span(), source.into_inner().next, "{stats:?}");
            frames
        };
        let (mut a, mut b) = (Vec::new(), Vec::new());
        prop_assert_eq!(run(&mut a), run(&mut b));
        prop_assert_eq!(a, b, "the same seed fails the same way");
    }
}

#[derive(Debug, Default)]
struct Seen {
    frames: Vec<u64>,
    gaps: usize,
    finished: usize,
    fail_at: Option<u64>,
}

impl FrameSink for Seen {
    fn frame(&mut self, frame: &OwnedFrame) -> Result<(), SourceError> {
        if self.fail_at == Some(frame.sequence) {
            return Err(SourceError::io("full.mcap", std::io::Error::from_raw_os_error(28)));
        }
        self.frames.push(frame.sequence);
        Ok(())
    }

    fn gap(&mut self, _: Gap) -> Result<(), SourceError> {
        self.gaps += 1;
        Ok(())
    }

    fn finish(&mut self) -> Result<(), SourceError> {
        self.finished += 1;
        Ok(())
    }
}

#[test]
fn a_recorder_sees_what_the_caller_sees() {
    let faults = Faults { gap: 0.3, seed: 5, ..Faults::default() };
    let sink = Seen { fail_at: Some(20), ..Seen::default() };
    let mut source = Recorded::new(FaultInjector::new(Numbers::new(60), faults), sink);
    source.start().unwrap();
    let mut frame = OwnedFrame::new();
    let (mut frames, mut gaps, mut errors) = (Vec::new(), 0, 0);
    loop {
        match source.next_into(&mut frame, Deadline::NEVER) {
            Ok(Outcome::Frame) => frames.push(frame.sequence),
            Ok(Outcome::Recovered(_)) => gaps += 1,
            Ok(Outcome::EndOfStream) => break,
            Ok(other) => panic!("{other:?}"),
            Err(e) => {
                assert_eq!(e.errno(), Some(28));
                errors += 1;
            }
        }
    }
    source.stop().unwrap();
    let (_, seen) = source.into_parts();
    let lost = usize::from(frames.contains(&20));
    assert_eq!((errors, lost), (1, 1), "the caller has the frame that the sink refused, and the error");
    frames.retain(|&n| n != 20);
    assert_eq!((seen.frames, seen.gaps, seen.finished), (frames, gaps, 2));
    assert!(gaps > 0);
}

#[derive(Debug, Clone, Copy)]
struct Stopped;

impl Clock for Stopped {
    fn now(&self) -> HostNanos {
        HostNanos(81_723_104_311_999)
    }
}

#[test]
fn a_trace_can_be_read() {
    let mut numbers = Numbers::new(2);
    numbers.unplugged_at = Some(1);
    let mut source = Tracer::new(numbers, Vec::new(), Stopped);
    let mut frame = OwnedFrame::new();
    source.start().unwrap();
    assert_eq!(source.next_into(&mut frame, Deadline::NEVER).unwrap(), Outcome::Frame);
    assert!(source.next_into(&mut frame, Deadline::NEVER).is_err());
    source.stop().unwrap();
    let (_, text, error) = source.into_parts();
    let text = String::from_utf8(text).unwrap();
    let lines: Vec<_> = text.lines().collect();
    assert!(error.is_none());
    assert_eq!(lines[0], "81723.104311 start ok");
    assert_eq!(lines[1], format!("81723.104311 frame 0 time 0.000000 8x6 digest {:016x}", digest(&frame)));
    assert!(lines[2].starts_with("81723.104311 error numbers is disconnected"), "{}", lines[2]);
    assert!(lines[3].contains("stop ok") && lines[3].contains("delivered: 1"), "{}", lines[3]);
}

#[test]
fn digests_tell_frames_apart() {
    let mut frame = OwnedFrame::new();
    frame.depth_u16_mut(5, 3).fill(700);
    let mut seen = std::collections::HashSet::from([digest(&frame)]);
    for i in 0..15 {
        frame.depth_u16_mut(5, 3).fill(700);
        frame.depth_u16_mut(5, 3)[i] = 701;
        assert!(seen.insert(digest(&frame)), "pixel {i}");
    }
    frame.depth_u16_mut(3, 5).fill(700);
    assert!(seen.insert(digest(&frame)), "its shape");
    frame.depth_f32_mut(5, 3).fill(700.0);
    assert!(seen.insert(digest(&frame)), "its type");
    frame.confidence_mut().fill(0);
    assert!(seen.insert(digest(&frame)));
    frame.colour_mut(5, 3).fill([1, 2, 3]);
    assert!(seen.insert(digest(&frame)));
}

#[test]
fn a_queue_loses_nothing_of_a_source_that_waits() {
    for policy in [BackPressure::Queue(3), BackPressure::Every] {
        let mut source = Pumped::new(Numbers::new(500), policy);
        let mut frame = OwnedFrame::new();
        for n in 0..500 {
            assert_eq!(source.next_into(&mut frame, soon()).unwrap(), Outcome::Frame);
            assert_eq!((frame.sequence, frame.z(7, 5)), (n, (n + 1) as f32 * 0.001));
        }
        assert_eq!(source.next_into(&mut frame, soon()).unwrap(), Outcome::EndOfStream);
        assert_eq!(source.next_into(&mut frame, soon()).unwrap(), Outcome::EndOfStream);
        let stats = source.stats();
        assert_eq!((stats.delivered, stats.lost()), (500, 0));
        source.stop().unwrap();
        source.stop().unwrap();
    }
}

#[test]
fn the_newest_wins_and_the_rest_is_counted() {
    let mut source = Pumped::new(Numbers::new(300), BackPressure::Latest);
    let mut frame = OwnedFrame::new();
    let (mut got, mut last) = (0, None);
    while source.next_into(&mut frame, soon()).unwrap() == Outcome::Frame {
        assert!(last < Some(frame.sequence));
        last = Some(frame.sequence);
        got += 1;
        std::thread::yield_now();
    }
    source.stop().unwrap();
    let stats = source.stats();
    assert_eq!((stats.delivered, stats.span(), last), (got, 300, Some(299)), "{stats:?}");
}

#[test]
fn held_frames_keep_their_pixels_and_cannot_starve_the_stream() {
    let mut source = Pumped::new(Numbers::new(100), BackPressure::Queue(4));
    let mut held = Vec::new();
    for n in 0..4 {
        let (outcome, lease) = source.lease(soon()).unwrap();
        assert_eq!(outcome, Outcome::Frame);
        let lease = lease.unwrap();
        assert_eq!(lease.sequence, n);
        held.push(lease);
    }
    assert!(matches!(source.lease(soon()), Err(SourceError::LeaseLimit { limit: 4 })));
    // The stream goes on beside them.
    let mut frame = OwnedFrame::new();
    assert_eq!(source.next_into(&mut frame, soon()).unwrap(), Outcome::Frame);
    assert_eq!(frame.sequence, 4);
    held.remove(1);
    let (_, lease) = source.lease(soon()).unwrap();
    held.push(lease.unwrap());
    source.stop().unwrap();
    drop(source);
    let numbers: Vec<_> = held.iter().map(|f| (f.sequence, f.z(0, 0))).collect();
    assert_eq!(numbers, [(0, 0.001), (2, 0.003), (3, 0.004), (5, 0.006)], "they outlive the stream");
}

#[test]
fn an_unplugged_device_ends_the_thread_and_stays_gone() {
    let mut numbers = Numbers::new(9);
    numbers.unplugged_at = Some(3);
    let mut source = Pumped::new(numbers, BackPressure::Every);
    let mut frame = OwnedFrame::new();
    for _ in 0..3 {
        assert_eq!(source.next_into(&mut frame, soon()).unwrap(), Outcome::Frame);
    }
    for _ in 0..3 {
        assert!(source.next_into(&mut frame, soon()).unwrap_err().is_terminal());
    }
}

#[test]
fn a_source_that_panics_does_not_hang_its_reader() {
    let mut numbers = Numbers::new(9);
    numbers.panics_at = Some(1);
    let mut source = Pumped::new(numbers, BackPressure::Every);
    let mut frame = OwnedFrame::new();
    assert_eq!(source.next_into(&mut frame, soon()).unwrap(), Outcome::Frame);
    assert_eq!(source.next_into(&mut frame, Deadline::NEVER).unwrap(), Outcome::EndOfStream);
    assert!(
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| source.stop())).is_err(),
        "the panic is passed on"
    );
}

#[test]
fn a_slow_source_times_out_and_a_pump_can_be_started_again() {
    let mut numbers = Numbers::new(1000);
    numbers.pace = Duration::from_millis(30);
    let mut source = Pumped::new(numbers, BackPressure::Latest);
    let mut frame = OwnedFrame::new();
    let passed = Deadline::at(HostNanos(1));
    source.start().unwrap();
    assert_eq!(source.next_into(&mut frame, passed).unwrap(), Outcome::TimedOut);
    assert_eq!(source.next_into(&mut frame, soon()).unwrap(), Outcome::Frame);
    source.stop().unwrap();
    let before = frame.sequence;
    assert_eq!(source.next_into(&mut frame, soon()).unwrap(), Outcome::Frame);
    assert!(frame.sequence > before);
}

#[test]
fn wrappers_stack_and_box() {
    let lines = Arc::new(Mutex::new(0_u32));
    let count = Arc::clone(&lines);
    let boxed: Box<dyn DepthSource + Send> = Box::new(FaultInjector::new(Numbers::new(20), Faults::default()));
    let sink = move |_: &OwnedFrame| {
        *count.lock().unwrap() += 1;
        Ok(())
    };
    let mut source =
        Pumped::new(Recorded::new(Tracer::new(boxed, std::io::sink(), SystemClock), sink), BackPressure::Every);
    let mut frame = OwnedFrame::new();
    while source.next_into(&mut frame, soon()).unwrap() == Outcome::Frame {}
    assert_eq!((*lines.lock().unwrap(), source.stats().delivered), (20, 20));
}
