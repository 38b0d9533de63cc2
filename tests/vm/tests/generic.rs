//! Depth cameras of no maker, read through the kernel's camera driver.

use std::fs;
use std::path::Path;
use std::process::Command;

use isobath_vm::guest::{camera_modules, first_video_node};
use isobath_vm::pattern;
use isobath_vm::profiles::generic::Generic;
use isobath_vm::usb::{Plugged, Speed};
use isobath_vm::uvc::Transport;

/// Reads frames with `v4l2-ctl`, which is not ours: their numbers. Any wrong pixel fails.
fn read_by_v4l2_ctl(node: &Path, (width, height): (usize, usize), count: usize) -> Vec<u64> {
    let format = format!("--set-fmt-video=width={width},height={height},pixelformat=Z16 ");
    let out = Command::new("v4l2-ctl")
        .arg("-d")
        .arg(node)
        .args([&format, "--stream-mmap=4", &format!("--stream-count={count}"), "--stream-to=/tmp/frames"])
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let bytes = fs::read("/tmp/frames").unwrap();
    let pixels: Vec<u16> = bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    let frames = pixels.chunks(width * height);
    frames.map(|frame| pattern::recognise(frame, width).expect("every pixel is right")).collect()
}

fn pixels_are_right(serial: &str, speed: Speed, transport: Transport) {
    camera_modules();
    let camera = Plugged::new(Generic::new(serial, speed, transport, &[(640, 480), (320, 240)])).unwrap();
    let node = first_video_node(serial);
    for size in [(640, 480), (320, 240)] {
        let numbers = read_by_v4l2_ctl(&node, size, 5);
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
