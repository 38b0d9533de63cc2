//! Kinect v1: our driver over USB, and the kernel's own as a witness and as a V4L2 camera.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use isobath_source::{DepthPixels, DepthSource, GapCause, OwnedFrame};
use isobath_usb::kinect1::Kinect1;
use isobath_usb::link::Options;
use isobath_usb::live::{self, LibUsb};
use isobath_vm::guest::{first_video_node, modprobe, processor_time, read_by_v4l2_ctl, unload, wait_for};
use isobath_vm::profiles::kinect::{Fault, GEOMETRY, Kinect, SIZE, disparity, millimetres};
use isobath_vm::usb::Plugged;
use isobath_vm::watch::{Seen, WAIT, next};

fn plug(serial: &str, prepare: impl FnOnce(&mut Kinect)) -> Plugged<Kinect> {
    modprobe(&["vhci-hcd"]);
    let mut device = Kinect::new(serial);
    prepare(&mut device);
    Plugged::new(device).unwrap()
}

fn open(serial: &str, reconnect: bool) -> Kinect1<LibUsb> {
    wait_for("the Kinect", || live::kinect1(Some(serial), Options { reconnect }).ok())
}

/// The number of a frame, not long before `near`, whose every pixel is the millimetres of its disparity.
fn number(frame: &OwnedFrame, near: u64) -> Option<u64> {
    let DepthPixels::U16(pixels) = frame.depth() else { return None };
    // A depth beyond 65 m does not fit, and is none.
    let table: Vec<f64> = (0..2048).map(|code| millimetres(code).filter(|mm| *mm < 65_000.0).unwrap_or(0.0)).collect();
    let (width, _) = SIZE;
    let is_right = |number: u64| {
        pixels.iter().enumerate().all(|(i, depth)| {
            let code = disparity(i % width, i / width, number);
            (f64::from(*depth) - table[usize::from(code)]).abs() <= 0.51
        })
    };
    (near.saturating_sub(100)..near + 3).find(|number| is_right(*number))
}

/// Reads frames; their numbers and whatever else came.
fn read(device: &Plugged<Kinect>, source: &mut dyn DepthSource, count: usize) -> (Vec<u64>, Vec<Seen>) {
    let (mut frame, mut numbers, mut others) = (OwnedFrame::new(), Vec::new(), Vec::new());
    while numbers.len() < count && others.len() < 50 {
        match next(source, &mut frame, WAIT) {
            Seen::Frame(_) => {
                let near = device.device().next_frame();
                numbers.push(number(&frame, near).unwrap_or_else(|| panic!("wrong pixels near frame {near}")));
            }
            gone @ Seen::Gone(_) => {
                others.push(gone);
                break;
            }
            other => others.push(other),
        }
    }
    assert!(numbers.windows(2).all(|w| w[0] < w[1]), "{numbers:?}");
    (numbers, others)
}

#[test]
fn depth_is_in_millimetres_by_the_devices_own_constants() {
    let device = plug("kinect", |_| {});
    let mut source = open("kinect", false);
    let (numbers, others) = read(&device, &mut source, 5);
    assert!(numbers.len() == 5 && others.is_empty(), "{numbers:?} {others:?}");
    let mut frame = OwnedFrame::new();
    assert!(matches!(next(&mut source, &mut frame, WAIT), Seen::Frame(_)));
    let k = frame.intrinsics;
    let focal = GEOMETRY.1 / (2.0 * GEOMETRY.2);
    assert!((k.fx() - focal).abs() < 0.01 && (k.fy() - focal).abs() < 0.01, "{k:?}");
    assert!((frame.unit.metres() - 0.001).abs() < 1e-9);
    drop(source);
    assert!(!device.device().is_streaming(), "depth was switched off");
}

/// Frames with a packet missing, for whatever reason, are counted and never given.
#[test]
fn lost_packets_break_their_frame_and_no_other() {
    let device = plug("kinect-loss", |_| {});
    let mut source = open("kinect-loss", false);
    read(&device, &mut source, 2);
    let first = device.device().next_frame() + 2;
    let faults = [
        (first, Fault::Lost(BTreeSet::from([100]))),
        (first + 2, Fault::Skipped(BTreeSet::from([7, 8, 9]))),
        (first + 4, Fault::Cut(50, 300)),
        (first + 6, Fault::Lost(BTreeSet::from([0]))),
        (first + 8, Fault::Lost(BTreeSet::from([241]))),
    ];
    device.device().faults.extend(faults.clone());
    let (numbers, others) = read(&device, &mut source, 10);
    assert!(others.is_empty(), "{others:?}");
    for (frame, fault) in faults {
        assert!(!numbers.contains(&frame), "{fault:?} in frame {frame}: {numbers:?}");
        assert!(numbers.contains(&(frame + 1)) || numbers.last() < Some(&(frame + 1)), "{numbers:?}");
    }
    let stats = source.stats();
    assert!(stats.corrupt >= 3, "{stats:?}");
}

#[test]
fn a_device_that_does_not_tell_its_geometry_is_opened_with_a_note() {
    let device = plug("kinect-mute", |device| device.knows_geometry = false);
    let source = open("kinect-mute", false);
    assert!(!source.info().notes.is_empty(), "{:?}", source.info());
    drop(device);
}

#[test]
fn unplugged_in_the_middle_of_a_frame_is_the_end() {
    let device = plug("kinect-pull", |_| {});
    let mut source = open("kinect-pull", false);
    read(&device, &mut source, 2);
    let last = device.device().next_frame() + 1;
    device.device().faults.insert(last, Fault::Unplug(120));
    let (numbers, others) = read(&device, &mut source, 50);
    assert!(numbers.iter().all(|n| *n < last), "{numbers:?}");
    assert!(matches!(others.last(), Some(Seen::Gone(time)) if *time < WAIT), "{others:?}");
    let (mut frame, before, start) = (OwnedFrame::new(), processor_time(), Instant::now());
    for _ in 0..100 {
        assert!(matches!(next(&mut source, &mut frame, Duration::from_secs(5)), Seen::Gone(_)));
    }
    assert!(start.elapsed() < Duration::from_secs(1) && processor_time() - before < Duration::from_secs(1));
}

#[test]
fn unplugged_and_plugged_in_again_it_goes_on() {
    let device = plug("kinect-again", |_| {});
    let mut source = open("kinect-again", true);
    read(&device, &mut source, 2);
    let mut device = device.unplug().unwrap();
    device.power_on();
    let mut frame = OwnedFrame::new();
    let away = loop {
        match next(&mut source, &mut frame, Duration::from_secs(1)) {
            Seen::Frame(_) => {}
            other => break other,
        }
    };
    assert!(matches!(away, Seen::TimedOut(_)), "{away:?}");
    let device = Plugged::new(device).unwrap();
    let (numbers, others) = read(&device, &mut source, 3);
    assert_eq!(numbers.len(), 3);
    assert!(others.iter().any(|s| matches!(s, Seen::Gap(gap) if gap.cause == GapCause::Replugged)), "{others:?}");
}

/// The kernel's driver takes the device first; ours takes it over, and another program's camera goes away.
#[test]
fn the_kernels_driver_is_detached() {
    modprobe(&["vhci-hcd", "gspca_kinect depth_mode=1"]);
    let device = plug("kinect-taken", |_| {});
    let node = first_video_node("kinect-taken");
    let mut source = open("kinect-taken", false);
    let (numbers, _) = read(&device, &mut source, 2);
    assert_eq!(numbers.len(), 2);
    assert!(!node.exists(), "{}", node.display());
    drop(source);
    drop(device);
    unload("gspca_kinect");
}

/// The kernel's driver knows ten of the eleven bits; it is a witness that the simulated device is a Kinect, and a camera for our V4L2 driver.
#[test]
fn the_kernels_driver_reads_it_and_so_do_we_through_it() {
    modprobe(&["vhci-hcd", "gspca_kinect depth_mode=1"]);
    let camera = plug("kinect-gspca", |_| {});
    let node = first_video_node("kinect-gspca");
    let bytes = read_by_v4l2_ctl(&node, "Y10B", SIZE, 3);
    assert!(!camera.device().is_streaming(), "it was switched off at the end");
    let (width, height) = SIZE;
    let frames = bytes.chunks(width * height * 10 / 8);
    assert_eq!(frames.len(), 3);
    for frame in frames {
        // Four pixels in five bytes, the highest bit first.
        let codes = frame.chunks_exact(5).flat_map(|b| {
            let bits = b.iter().fold(0u64, |bits, byte| bits << 8 | u64::from(*byte));
            [30, 20, 10, 0].map(|shift| (bits >> shift & 0x3ff) as u16)
        });
        assert!(is_codes(&codes.collect::<Vec<_>>()), "wrong pixels");
    }
    let mut options = isobath_v4l2::OpenOptions::default();
    let [fx, fy, cx, cy] = [575.8, 575.8, 319.5, 239.5].map(Some);
    (options.set.fx, options.set.fy, options.set.cx, options.set.cy) = (fx, fy, cx, cy);
    options.set.depth.unit = Some(0.001);
    let mut source = isobath_v4l2::open(&node, &options).unwrap();
    let mut frame = OwnedFrame::new();
    for _ in 0..3 {
        let seen = next(&mut *source, &mut frame, WAIT);
        assert!(matches!(seen, Seen::Frame(_)), "{seen:?}");
        let DepthPixels::U16(codes) = frame.depth() else { panic!("codes are whole numbers") };
        assert!(is_codes(codes), "wrong pixels");
    }
    drop(source);
    drop(camera);
    unload("gspca_kinect");
}

/// Whether these are the upper ten bits of a frame's disparities. The code for "nothing" may have become 0.
fn is_codes(codes: &[u16]) -> bool {
    let (width, height) = SIZE;
    let first = u64::from(codes[0].saturating_sub(200)) * 2;
    let is = |number: u64| {
        let expected = (0..height).flat_map(|y| (0..width).map(move |x| disparity(x, y, number) >> 1));
        codes.iter().zip(expected).all(|(got, expected)| *got == expected || (*got == 0 && expected == 1023))
    };
    codes.len() == width * height && (is(first) || is(first + 1))
}
