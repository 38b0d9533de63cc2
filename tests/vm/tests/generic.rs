//! Depth cameras of no maker, through the kernel's camera driver and ours: right pixels over every transport, and every fault that
//! a camera, a cable or a kernel can have.
//!
//! uvcvideo drops a broken frame and leaves a gap in its numbers; with its parameter `nodrop` (which is what newer kernels do) it hands the frame over
//! with an error flag. Both are tested.

use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use isobath_source::{DepthSource, OwnedFrame, SourceError};
use isobath_v4l2::OpenOptions;
use isobath_vm::guest::{
    camera_modules, first_video_node, processor_time, read_by_v4l2_ctl, uvc_hands_broken_frames_over, video_nodes,
    wait_for,
};
use isobath_vm::pattern;
use isobath_vm::profiles::generic::Generic;
use isobath_vm::profiles::orbbec::gemini_336;
use isobath_vm::usb::{Plugged, Speed};
use isobath_vm::uvc::{Fault, Transport};
use isobath_vm::watch::{Seen, next, numbers, until_frames};

const BULK: Transport = Transport::Bulk { payload: 16384 };
const ISOCHRONOUS: Transport = Transport::Isochronous { packets: 3 };
const SIZE: (u16, u16) = (320, 240);
const FRAME_BYTES: usize = 320 * 240 * 2;

/// The pinhole and unit of the calibration file.
const PINHOLE: [f32; 4] = [261.5, 262.25, 158.75, 121.5];
const UNIT: f32 = 0.000_25;

/// Opens a camera at a size, with the calibration above.
fn try_open(node: &Path, size: (u16, u16)) -> Result<Box<dyn DepthSource + Send>, SourceError> {
    let mut options = OpenOptions { size: Some((size.0.into(), size.1.into())), ..OpenOptions::default() };
    let [fx, fy, cx, cy] = PINHOLE.map(Some);
    (options.set.fx, options.set.fy, options.set.cx, options.set.cy) = (fx, fy, cx, cy);
    options.set.depth.unit = Some(UNIT);
    isobath_v4l2::open(node, &options)
}

fn open(node: &Path, size: (u16, u16)) -> Box<dyn DepthSource + Send> {
    try_open(node, size).unwrap_or_else(|error| panic!("{}: {error}", node.display()))
}

/// A camera with this serial number, and its node.
fn plug(serial: &str, speed: Speed, transport: Transport) -> (Plugged<Generic>, PathBuf) {
    camera_modules();
    let camera = Plugged::new(Generic::new(serial, speed, transport, &[SIZE, (640, 480)])).unwrap();
    let node = first_video_node(serial);
    (camera, node)
}

fn pixels_are_right(serial: &str, speed: Speed, transport: Transport) {
    let (camera, node) = plug(serial, speed, transport);
    for size in [SIZE, (640, 480)] {
        let mut source = open(&node, size);
        let mut frame = OwnedFrame::new();
        let mut seen = Vec::new();
        while seen.len() < 5 {
            seen.push(next(&mut *source, &mut frame, Duration::from_secs(2)));
            let k = frame.intrinsics;
            assert_eq!([k.fx(), k.fy(), k.cx(), k.cy()], PINHOLE);
            assert_eq!((frame.unit.metres(), frame.size()), (UNIT, (usize::from(size.0), usize::from(size.1))));
        }
        assert_eq!(numbers(&seen).len(), 5, "{seen:?}");
        drop(source);
        assert!(!camera.device().stream().is_streaming(), "the camera was told that nobody listens");
    }
}

#[test]
fn bulk_at_high_speed() {
    pixels_are_right("bulk-hs", Speed::High, BULK);
}

#[test]
fn whole_frames_over_bulk_at_high_speed() {
    pixels_are_right("whole-hs", Speed::High, Transport::BulkWhole);
}

#[test]
fn bulk_at_super_speed() {
    pixels_are_right("bulk-ss", Speed::Super, BULK);
}

#[test]
fn isochronous_at_high_speed() {
    pixels_are_right("iso-hs", Speed::High, ISOCHRONOUS);
}

#[test]
fn isochronous_at_super_speed() {
    pixels_are_right("iso-ss", Speed::Super, ISOCHRONOUS);
}

/// `v4l2-ctl` is not ours: it is the witness that the simulated camera sends what it should.
#[test]
fn another_program_reads_the_same_pixels() {
    let (_camera, node) = plug("witness", Speed::High, ISOCHRONOUS);
    let bytes = read_by_v4l2_ctl(&node, "Z16 ", (640, 480), 4);
    let pixels: Vec<u16> = bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    let numbers: Vec<_> = pixels.chunks(640 * 480).map(|frame| pattern::recognise(frame, 640)).collect();
    assert!(numbers.len() == 4 && numbers.iter().all(Option::is_some) && numbers.is_sorted(), "{numbers:?}");
}

/// Frames that are broken on the way to the kernel: dropped by it, and known by the gap.
#[test]
fn broken_frames_that_the_kernel_drops_are_counted_and_never_given() {
    camera_modules();
    uvc_hands_broken_frames_over(false);
    for (serial, transport) in [("drop-bulk", BULK), ("drop-iso", ISOCHRONOUS)] {
        let (camera, node) = plug(serial, Speed::High, transport);
        let mut source = open(&node, SIZE);
        let mut seen = until_frames(&mut *source, 2);
        let first = camera.device().stream().next_frame() + 2;
        let lossy = if transport == ISOCHRONOUS { Fault::Lost(70_000) } else { Fault::Truncated(0) };
        let faults = [(first, Fault::Truncated(FRAME_BYTES / 3)), (first + 3, Fault::Marked), (first + 6, lossy)];
        camera.device().stream().faults.extend(faults);
        seen.extend(until_frames(&mut *source, 14));
        let numbers = numbers(&seen);
        for (frame, fault) in faults {
            assert!(!numbers.contains(&frame), "{serial}: frame {frame} had {fault:?}: {numbers:?}");
            assert!(numbers.contains(&(frame + 2)), "{serial}: the stream goes on: {numbers:?}");
        }
        let stats = source.stats();
        assert!(stats.lost() >= 3, "{stats:?}");
        assert_eq!(stats.delivered, 16);
        let span = numbers[numbers.len() - 1] - numbers[0] + 1;
        assert!(stats.span() >= span, "{stats:?} for a span of {span}");
    }
}

/// The same, where the kernel hands them over with an error flag.
#[test]
fn broken_frames_that_the_kernel_marks_are_counted_and_never_given() {
    camera_modules();
    uvc_hands_broken_frames_over(true);
    let (camera, node) = plug("marked", Speed::High, BULK);
    let mut source = open(&node, SIZE);
    let mut seen = until_frames(&mut *source, 2);
    let first = camera.device().stream().next_frame() + 2;
    let faults = [(first, Fault::Truncated(FRAME_BYTES / 3)), (first + 3, Fault::Marked)];
    camera.device().stream().faults.extend(faults);
    seen.extend(until_frames(&mut *source, 10));
    uvc_hands_broken_frames_over(false);
    let numbers = numbers(&seen);
    assert!(faults.iter().all(|(frame, _)| !numbers.contains(frame)), "{numbers:?}");
    let stats = source.stats();
    assert_eq!(stats.corrupt + stats.short, 2, "{stats:?}");
    assert_eq!(stats.delivered, 12);
}

/// An endpoint that halts: the stream has to be started again, and is.
#[test]
fn a_stall_is_recovered_from_and_told() {
    let (camera, node) = plug("stall", Speed::High, BULK);
    let mut source = open(&node, SIZE);
    let mut seen = until_frames(&mut *source, 3);
    let stalled = camera.device().stream().next_frame() + 1;
    camera.device().stream().faults.insert(stalled, Fault::Halt(FRAME_BYTES / 2));
    seen.extend(until_frames(&mut *source, 6));
    let numbers = numbers(&seen);
    assert!(!numbers.contains(&stalled) && numbers.iter().any(|n| *n > stalled), "{seen:?}, {:?}", source.stats());
    assert!(seen.iter().any(|s| matches!(s, Seen::Gap(_))), "{seen:?}");
    assert_eq!(source.stats().recoveries, 1, "{:?}", source.stats());
}

/// Nothing comes for ten seconds: that is no error, takes no processor, and ends at the deadline.
#[test]
fn silence_is_a_timeout() {
    let (camera, node) = plug("silence", Speed::High, BULK);
    let mut source = open(&node, SIZE);
    let mut seen = until_frames(&mut *source, 2);
    let late = camera.device().stream().next_frame() + 1;
    camera.device().stream().faults.insert(late, Fault::Late(Duration::from_secs(10)));
    let (mut frame, mut waited) = (OwnedFrame::new(), Duration::ZERO);
    let before = processor_time();
    for _ in 0..20 {
        let one = next(&mut *source, &mut frame, Duration::from_secs(1));
        if let Seen::TimedOut(time) = one {
            assert!(time >= Duration::from_secs(1) && time < Duration::from_millis(1300), "{time:?}");
            waited += time;
        }
        seen.push(one);
    }
    assert!(waited > Duration::from_secs(7), "{seen:?}");
    // The simulated camera's thread, which looks around a hundred times a second, is in this.
    let took = processor_time() - before;
    assert!(took < waited / 4, "{took:?} of the processor for {waited:?} of waiting");
    assert!(numbers(&seen).len() > 4, "then it goes on: {seen:?}");
}

/// The cable is pulled in the middle of a frame: known at once, for good, and without a spinning core.
#[test]
fn unplugged_in_the_middle_of_a_frame_and_plugged_in_again() {
    for (serial, transport) in [("pull-bulk", BULK), ("pull-iso", ISOCHRONOUS)] {
        let (camera, node) = plug(serial, Speed::High, transport);
        let mut source = open(&node, SIZE);
        let mut seen = until_frames(&mut *source, 3);
        let last = camera.device().stream().next_frame() + 1;
        camera.device().stream().faults.insert(last, Fault::Unplug(FRAME_BYTES / 2));
        seen.extend(until_frames(&mut *source, 100));
        let numbers = numbers(&seen);
        assert!(numbers.iter().all(|n| *n < last), "{numbers:?}");
        let Some(Seen::Gone(time)) = seen.last() else { panic!("{serial}: {seen:?}") };
        assert!(*time < Duration::from_secs(2), "{time:?}");
        // Asked again and again, it says so again and again, at once.
        let (mut frame, before, start) = (OwnedFrame::new(), processor_time(), Instant::now());
        for _ in 0..100 {
            let again = next(&mut *source, &mut frame, Duration::from_secs(5));
            assert!(matches!(again, Seen::Gone(_)), "{again:?}");
        }
        assert!(start.elapsed() < Duration::from_secs(1) && processor_time() - before < Duration::from_secs(1));
        drop(source);
        wait_for("the node to go", || video_nodes(serial).is_empty().then_some(()));
        let camera = Plugged::new(camera.unplug().unwrap()).unwrap();
        let node = first_video_node(serial);
        let mut source = open(&node, SIZE);
        let again = until_frames(&mut *source, 3);
        assert!(self::numbers(&again)[0] > last, "{again:?}");
        drop(camera);
    }
}

/// A camera that grants another format than was asked for is refused, by its name, not misread.
#[test]
fn another_format_than_asked_for_is_refused() {
    let (camera, node) = plug("grants", Speed::High, BULK);
    camera.device().stream().grants = Some((1, 2));
    let error = try_open(&node, SIZE).and_then(|mut source| source.start()).expect_err("640x480 was granted");
    let text = error.to_string();
    assert!(text.contains("640") && text.contains("320"), "{text}");
}

/// Who may not open the camera is told what to do about it. Root may everything, so another user asks: this program, started anew.
#[test]
fn without_permission_it_is_said_how_to_get_it() {
    if let Some(node) = std::env::var_os(AS_NOBODY) {
        let error = try_open(Path::new(&node), SIZE).err();
        panic!("{}", error.map_or("it could be opened".into(), |error| error.to_string()));
    }
    let (_camera, node) = plug("locked", Speed::High, BULK);
    let out = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "without_permission_it_is_said_how_to_get_it"])
        .env(AS_NOBODY, &node)
        .uid(65534)
        .gid(65534)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&out.stdout);
    assert!(text.contains("udev") && text.contains(&*node.to_string_lossy()), "{text}");
}

/// The variable that tells this program to open a camera as a user who may not.
const AS_NOBODY: &str = "ISOBATH_VM_OPEN_AS_NOBODY";

/// An Orbbec camera says its unit, which its user may change; its pinhole comes from the caller.
#[test]
fn an_orbbec_says_its_unit() {
    camera_modules();
    let (device, unit) = gemini_336("orbbec", Speed::Super);
    let _camera = Plugged::new(device).unwrap();
    let node = first_video_node("orbbec");
    for millimetres in [0.5, 0.1] {
        *unit.lock().unwrap() = millimetres;
        let mut options = OpenOptions { size: Some((640, 480)), ..OpenOptions::default() };
        let [fx, fy, cx, cy] = PINHOLE.map(Some);
        (options.set.fx, options.set.fy, options.set.cx, options.set.cy) = (fx, fy, cx, cy);
        let mut source = isobath_v4l2::open(&node, &options).unwrap();
        let mut frame = OwnedFrame::new();
        assert!(matches!(next(&mut *source, &mut frame, Duration::from_secs(2)), Seen::Frame(Some(_))));
        assert!((frame.unit.metres() - millimetres * 1e-3).abs() < 1e-9, "{:?}", frame.unit);
        assert!(source.info().kind.contains("Gemini 336"), "{}", source.info().kind);
    }
}
