//! A long run of random faults: a hundred thousand frames, ten seeds; what must hold then holds always.

mod kernel;

use std::time::Duration;

use isobath_source::{BackPressure, Clock, Deadline, DepthPixels, DepthSource, Outcome, OwnedFrame};
use isobath_v4l2::sys::Errno;
use isobath_v4l2::{OpenOptions, open_with};
use kernel::{Act, Call, Kernel, NodeScript, pixel};

const SIZE: (u32, u32) = (8, 4);

struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % n
    }
}

fn soak(seed: u64, policy: BackPressure, frames: u64) {
    let kernel = Kernel::new("/dev/video0", NodeScript::video(b"Z16 ", SIZE));
    let mut options = OpenOptions { size: Some(SIZE), policy, ..OpenOptions::default() };
    options.roots.sys = "/nowhere".into();
    let set = &mut options.set;
    (set.fx, set.fy, set.cx, set.cy) = (Some(10.0), Some(10.0), Some(4.0), Some(2.0));
    set.depth.unit = Some(0.001);
    let mut camera = open_with(&kernel, Box::new(kernel.clone()), "/dev/video0".as_ref(), &options).unwrap();
    let mut random = Random(seed);
    let mut frame = OwnedFrame::new();
    let (mut got, mut last, mut failures, mut recovered, mut errors) = (0_u64, None, 0, 0_u64, 0_u64);
    // The numbers of this run of the stream that were delivered, for "once".
    while kernel.world().counter < frames as u32 {
        if random.below(4) == 0 {
            let full = SIZE.0 * SIZE.1 * 2;
            let acts = match random.below(12) {
                0 => vec![Act::Silence(random.below(200))],
                1 => vec![Act::Skip(random.below(5) as u32)],
                2 => vec![Act::Flagged(random.below(u64::from(full) + 1) as u32)],
                3 => vec![Act::Short(random.below(u64::from(full)) as u32)],
                4 => vec![Act::Cancel],
                5 => vec![Act::Whole, Act::Flagged(full), Act::Whole],
                _ => vec![Act::Whole; 3],
            };
            kernel.world().script.extend(acts);
        }
        if random.below(25) == 0 {
            let calls = [Call::Dequeue, Call::Queue, Call::Poll, Call::StreamOn, Call::StreamOff, Call::Dequeue];
            let errnos = [Errno::EINTR, Errno::EIO, Errno::EAGAIN, Errno::EPIPE, Errno(71)];
            let call = calls[random.below(6) as usize];
            let errno = errnos[random.below(5) as usize];
            kernel.fail(call, random.below(6) as u32, errno);
            failures += 1;
        }
        if random.below(50) == 0 {
            kernel.world().false_ready = random.below(12) as u32;
        }
        if random.below(3000) == 0 {
            // Some planned failure may hit the stop: it stops all the same.
            let _ = camera.stop();
            assert_eq!(kernel.world().mappings, 0);
        }
        let before = kernel.now();
        let wait = Duration::from_millis(random.below(60));
        let outcome = camera.next_into(&mut frame, Deadline::after(&kernel, wait));
        let took = kernel.now().saturating_since(before);
        assert!(took <= wait, "{took:?} of {wait:?}");
        match outcome {
            Ok(Outcome::Frame) => {
                got += 1;
                assert!(last < Some(frame.sequence), "{last:?} before {}", frame.sequence);
                last = Some(frame.sequence);
                let DepthPixels::U16(values) = frame.depth() else { panic!("16 bits were sent") };
                let n = (0..65_000).find(|n| pixel(0, 0, *n) == values[0]).expect("a frame that was drawn");
                for (i, v) in values.iter().enumerate() {
                    assert_eq!(
                        *v,
                        pixel(i as u32 % SIZE.0, i as u32 / SIZE.0, n),
                        "a frame that is whole is one frame"
                    );
                }
            }
            Ok(Outcome::TimedOut) => {}
            Ok(Outcome::Recovered(_)) => recovered += 1,
            Ok(other) => panic!("{other:?}"),
            Err(e) => {
                assert!(!e.is_terminal(), "{e}");
                errors += 1;
            }
        }
        assert_eq!(camera.stats().delivered, got);
    }
    let _ = camera.stop();
    let stats = camera.stats();
    assert!(got > frames / 4 && failures > 100 && stats.recoveries > 20, "the soak was wet: {stats:?}");
    assert!(recovered >= stats.recoveries && errors < got / 20, "{recovered} {errors} {stats:?}");
    assert!(stats.span() <= frames + 10, "no frame is in two counts: {stats:?}");
    kernel.check();
}

#[test]
fn a_hundred_thousand_frames_with_random_faults() {
    for seed in 0..4 {
        soak(seed, BackPressure::Latest, 12_000);
        soak(100 + seed, BackPressure::Queue(3), 12_000);
        soak(200 + seed, BackPressure::Every, 12_000);
    }
}
