//! Ten thousand frames at thirty a second, in the guest's time: five and a half minutes of a camera, with its clock wrapping, faults now and
//! then, and no byte more memory at the end than near the beginning.

use std::time::{Duration, Instant};

use isobath_source::{BackPressure, DepthSource, OwnedFrame};
use isobath_v4l2::OpenOptions;
use isobath_vm::guest::{camera_modules, first_video_node, open_files, resident_kb};
use isobath_vm::profiles::generic::Generic;
use isobath_vm::usb::{Plugged, Speed};
use isobath_vm::uvc::{Fault, Transport};
use isobath_vm::watch::{Seen, WAIT, next};

const FRAMES: u64 = 10_000;
/// As large as a headset's image, and small enough for 10,000 of them.
const SIZE: (u16, u16) = (160, 120);

#[test]
fn ten_thousand_frames_at_thirty_a_second() {
    camera_modules();
    let mut device = Generic::new("soak", Speed::Super, Transport::BulkWhole, &[SIZE]);
    // One frame in 500 is cut off, and one is marked.
    let faults = (500..FRAMES).step_by(500);
    device.stream().faults.extend(faults.clone().map(|frame| (frame, Fault::Truncated(1000))));
    device.stream().faults.extend(faults.map(|frame| (frame + 7, Fault::Marked)));
    let camera = Plugged::new(device).unwrap();
    let mut options = OpenOptions { policy: BackPressure::Queue(4), ..OpenOptions::default() };
    let [fx, fy, cx, cy] = [130.0, 130.0, 79.5, 59.5].map(Some);
    (options.set.fx, options.set.fy, options.set.cx, options.set.cy) = (fx, fy, cx, cy);
    options.set.depth.unit = Some(0.001);
    let mut source = isobath_v4l2::open(&first_video_node("soak"), &options).unwrap();
    let mut frame = OwnedFrame::new();
    let (mut given, mut last, mut memory, start) = (0u64, None, 0, Instant::now());
    while last < Some(FRAMES - 1) {
        match next(&mut *source, &mut frame, WAIT) {
            Seen::Frame(Some(number)) => {
                assert!(last < Some(number), "frame {number} after {last:?}");
                assert!(number % 500 != 0 || number == 0, "frame {number} was cut off");
                last = Some(number);
                given += 1;
            }
            other => panic!("{other:?} after frame {last:?}"),
        }
        if given == 1000 {
            memory = resident_kb();
        }
    }
    let (took, more) = (start.elapsed(), resident_kb().saturating_sub(memory));
    let stats = source.stats();
    println!("{given} frames in {took:?}; {more} kB more resident than after 1000; {stats:?}");
    assert_eq!(stats.delivered, given);
    // Whole frames may be lost where the guest's processor was busy; hardly any are.
    assert!(given > FRAMES - 40 - 100, "{given}");
    assert!(stats.dropped_by_system >= 38, "{stats:?}");
    let due = Duration::from_micros(33_333) * FRAMES as u32;
    assert!(took > due - Duration::from_secs(2) && took < due + Duration::from_secs(20), "{took:?} for {due:?}");
    // The allocator may touch a page or two that it had.
    assert!(more <= 64, "{more} kB");
    drop(source);
    drop(camera);
}

/// Opening and closing leaves nothing behind.
#[test]
fn fifty_openings_leave_nothing_open() {
    camera_modules();
    let _camera = Plugged::new(Generic::new("again", Speed::Super, Transport::BulkWhole, &[SIZE])).unwrap();
    let node = first_video_node("again");
    let mut options = OpenOptions::default();
    let [fx, fy, cx, cy] = [130.0, 130.0, 79.5, 59.5].map(Some);
    (options.set.fx, options.set.fy, options.set.cx, options.set.cy) = (fx, fy, cx, cy);
    options.set.depth.unit = Some(0.001);
    let (mut frame, mut before) = (OwnedFrame::new(), (0, 0));
    for round in 0..50 {
        let mut source = isobath_v4l2::open(&node, &options).unwrap();
        assert!(matches!(next(&mut *source, &mut frame, WAIT), Seen::Frame(Some(_))));
        drop(source);
        if round == 4 {
            before = (open_files(), resident_kb());
        }
    }
    assert_eq!(open_files(), before.0);
    assert!(resident_kb() <= before.1 + 64, "{} kB after {} kB", resident_kb(), before.1);
}
