//! Nothing is allocated once a camera runs: counted over a thousand frames, straightened for a lens, on the scripted kernel (without metadata or colour).
//!
//! A program of its own, without a harness: its allocator counts the whole process. The scripted kernel allocates where Linux would not; what it takes is counted
//! apart, by a flag that it raises while it works.

#![allow(unsafe_code, reason = "a counting global allocator can't be written without")]

#[path = "../../source/tests/common/counting.rs"]
mod counting;
mod kernel;

use std::sync::atomic::Ordering;
use std::time::Duration;

use counting::ALLOCATIONS;
use isobath_source::{BackPressure, Deadline, DepthSource, Outcome, OwnedFrame};
use isobath_v4l2::{OpenOptions, open_with};
use kernel::{Kernel, NodeScript};

/// What the scripted kernel takes does not count.
fn counts() -> bool {
    !kernel::WORKING.load(Ordering::SeqCst)
}

fn main() {
    for policy in [BackPressure::Latest, BackPressure::Queue(4), BackPressure::Every] {
        let kernel = Kernel::new("/dev/video0", NodeScript::video(b"Z16 ", (64, 48)));
        let mut options = OpenOptions { size: Some((64, 48)), policy, ..OpenOptions::default() };
        options.roots.sys = "/nowhere".into();
        let set = &mut options.set;
        (set.fx, set.fy, set.cx, set.cy) = (Some(60.0), Some(60.0), Some(31.5), Some(23.5));
        set.depth.unit = Some(0.001);
        // A lens too, which is straightened.
        set.distortion = Some(vec![0.1, -0.05, 0.001, 0.001]);
        let mut camera = open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options).unwrap();
        let mut frame = OwnedFrame::new();
        camera.start().unwrap();
        let (mut frames, mut before) = (0, 0);
        while frames < 1005 {
            if frames == 5 {
                before = ALLOCATIONS.load(Ordering::SeqCst);
            }
            let outcome = camera.next_into(&mut frame, Deadline::after(&kernel, Duration::from_millis(100)));
            frames += usize::from(outcome.is_ok_and(|o| o == Outcome::Frame));
        }
        assert_eq!(ALLOCATIONS.load(Ordering::SeqCst) - before, 0, "{policy:?}");
        camera.stop().unwrap();
        kernel.check();
    }
    let before = ALLOCATIONS.load(Ordering::SeqCst);
    drop(std::hint::black_box(vec![0_u8; 100]));
    assert!(ALLOCATIONS.load(Ordering::SeqCst) > before, "the counter counts");
}
