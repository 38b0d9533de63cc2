//! Nothing is allocated once a stream runs: counted, over a thousand frames through every wrapper.
//!
//! A program of its own, without a harness: its allocator counts the whole process.

#![allow(unsafe_code, reason = "a counting global allocator can't be written without")]

mod common;
#[path = "common/counting.rs"]
mod counting;

use std::sync::atomic::Ordering;

use common::Numbers;
use counting::ALLOCATIONS;
use isobath_source::{
    BackPressure, Deadline, DepthSource, FaultInjector, Faults, Outcome, OwnedFrame, Pumped, Recorded, SystemClock,
    Tracer,
};

/// All that is allocated counts.
fn counts() -> bool {
    true
}

/// Reads frames; the allocations that the last thousand took.
fn measure(source: &mut dyn DepthSource) -> usize {
    let mut frame = OwnedFrame::new();
    source.start().unwrap();
    let (mut frames, mut before) = (0, 0);
    while frames < 1100 {
        if frames == 100 {
            before = ALLOCATIONS.load(Ordering::SeqCst);
        }
        // Timeouts, gaps and broken frames come too; only what carries a path may allocate, and is not drawn.
        if let Ok(Outcome::Frame) = source.next_into(&mut frame, Deadline::NEVER) {
            frames += 1;
        }
    }
    ALLOCATIONS.load(Ordering::SeqCst) - before
}

fn main() {
    // The counter counts.
    let before = ALLOCATIONS.load(Ordering::SeqCst);
    drop(std::hint::black_box(vec![0_u8; 100]));
    assert!(ALLOCATIONS.load(Ordering::SeqCst) > before);

    let faults = Faults { link: 0.0, ..Faults::rough(3) };
    let mut digests = 0_u64;
    let sink = |frame: &OwnedFrame| {
        digests += frame.sequence;
        Ok(())
    };
    let inner = FaultInjector::new(Numbers::new(u64::MAX), faults);
    let mut stack = Recorded::new(Tracer::new(inner, std::io::sink(), SystemClock), sink);
    assert_eq!(measure(&mut stack), 0, "faults, trace and recorder");
    assert!(digests > 0);

    for policy in [BackPressure::Latest, BackPressure::Queue(5), BackPressure::Every] {
        let mut pumped = Pumped::new(Numbers::new(u64::MAX), policy);
        assert_eq!(measure(&mut pumped), 0, "{policy:?}");
        pumped.stop().unwrap();
    }
}
