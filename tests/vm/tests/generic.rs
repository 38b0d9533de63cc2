//! Depth cameras of no maker, read through the kernel's camera driver.

use std::path::Path;

use isobath_vm::guest::{camera_modules, first_video_node, read_by_v4l2_ctl};
use isobath_vm::pattern;
use isobath_vm::profiles::generic::Generic;
use isobath_vm::usb::{Plugged, Speed};
use isobath_vm::uvc::Transport;

/// The numbers of frames read by a program that is not ours. Any wrong pixel fails.
fn numbers(node: &Path, (width, height): (usize, usize), count: usize) -> Vec<u64> {
    let bytes = read_by_v4l2_ctl(node, "Z16 ", (width, height), count);
    let pixels: Vec<u16> = bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    let frames = pixels.chunks(width * height);
    frames.map(|frame| pattern::recognise(frame, width).expect("every pixel is right")).collect()
}

fn pixels_are_right(serial: &str, speed: Speed, transport: Transport) {
    camera_modules();
    let camera = Plugged::new(Generic::new(serial, speed, transport, &[(640, 480), (320, 240)])).unwrap();
    let node = first_video_node(serial);
    for size in [(640, 480), (320, 240)] {
        let numbers = numbers(&node, size, 5);
        assert_eq!(numbers.len(), 5);
        assert!(numbers.is_sorted(), "{numbers:?}");
        assert_eq!(camera.device().stream().size(), size);
    }
}

#[test]
fn bulk_high_speed() {
    pixels_are_right("bulk-hs", Speed::High, Transport::Bulk { payload: 16384 });
}

#[test]
fn bulk_whole_frames_high_speed() {
    pixels_are_right("whole-hs", Speed::High, Transport::BulkWhole);
}

#[test]
fn bulk_super_speed() {
    pixels_are_right("bulk-ss", Speed::Super, Transport::Bulk { payload: 16384 });
}

#[test]
fn isochronous_high_speed() {
    pixels_are_right("iso-hs", Speed::High, Transport::Isochronous { packets: 3 });
}

#[test]
fn isochronous_super_speed() {
    pixels_are_right("iso-ss", Speed::Super, Transport::Isochronous { packets: 3 });
}
