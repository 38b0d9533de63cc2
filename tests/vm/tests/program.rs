//! The program `isobath` on live cameras, from end to end: what it says of them, what it records, what it says when they go.

use std::path::Path;
use std::process::{Command, Output};

use isobath_source::{Deadline, DepthSource, Outcome, OwnedFrame};
use isobath_usb::bulk::CLASS;
use isobath_vm::guest::{camera_modules, modprobe, motion_modules, video_nodes, wait_for};
use isobath_vm::profiles::d435::{D435, tables};
use isobath_vm::profiles::headset::{Headset, PINHOLE, UNIT_M};
use isobath_vm::profiles::kinect::Kinect;
use isobath_vm::usb::{Plugged, Speed};
use isobath_vm::uvc::Fault;
use isobath_vm::watch::number;

fn isobath(arguments: &[&str]) -> Output {
    Command::new("isobath").args(arguments).output().expect("`cargo xtask vm` builds the program")
}

fn said(out: &Output) -> String {
    String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr)
}

/// The number of a field of the JSON that the program prints.
fn field(json: &str, name: &str) -> f64 {
    let at = json.find(&format!("\"{name}\":")).unwrap_or_else(|| panic!("no `{name}` in {json}"));
    let value = json[at..].split([':', ',', '\n', '}']).nth(1).unwrap_or_default();
    value.trim().parse().unwrap_or_else(|_| panic!("`{name}` is no number in {json}"))
}

/// The D435i, and what the program calls it.
fn plug(serial: &str) -> (Plugged<D435>, String) {
    camera_modules();
    motion_modules();
    let camera = Plugged::new(D435::new(serial, Speed::Super)).unwrap();
    let nodes = wait_for("four nodes", || Some(video_nodes(serial)).filter(|nodes| nodes.len() == 4));
    let source = format!("v4l2:{}", nodes[0].display());
    (camera, source)
}

#[test]
fn info_says_unit_size_and_pinhole_of_the_camera() {
    let (_camera, source) = plug("cli-info");
    let out = isobath(&["info", &source, "--json"]);
    assert!(out.status.success(), "{}", said(&out));
    let json = said(&out);
    let (width, height) = (field(&json, "width"), field(&json, "height"));
    let [fx, fy, cx, cy] = tables::pinhole(width as u16, height as u16).map(f64::from);
    for (name, expected) in [("fx", fx), ("fy", fy), ("cx", cx), ("cy", cy), ("unit_m", 0.001)] {
        assert!((field(&json, name) - expected).abs() < 1e-3 * expected, "{name}: {json}");
    }
}

#[test]
fn run_works_through_live_frames() {
    let (_camera, source) = plug("cli-run");
    let out = isobath(&["run", &source, "--frames", "2", "--out", "/tmp/run", "--json"]);
    assert!(out.status.success(), "{}", said(&out));
    assert!(Path::new("/tmp/run/report.html").is_file());
}

/// What is recorded is what the camera sent, to the last pixel.
#[test]
fn a_recording_holds_the_cameras_pixels() {
    let (_camera, source) = plug("cli-record");
    let out = isobath(&["record", &source, "--frames", "5", "--out", "/tmp/camera.mcap"]);
    assert!(out.status.success(), "{}", said(&out));
    let mut recording =
        isobath_recording::open(Path::new("/tmp/camera.mcap"), &isobath_recording::OpenOptions::default()).unwrap();
    let (mut frame, mut frames) = (OwnedFrame::new(), 0);
    while recording.next_into(&mut frame, Deadline::NEVER).unwrap() == Outcome::Frame {
        assert!(number(&frame).is_some(), "a wrong pixel in frame {frames}");
        frames += 1;
    }
    assert_eq!(frames, 5);
}

#[test]
fn devices_are_listed_with_what_can_be_done() {
    let (_camera, source) = plug("cli-devices");
    let _kinect = Plugged::new(Kinect::new("cli-kinect")).unwrap();
    let text = wait_for("both to be listed", || {
        let text = said(&isobath(&["devices"]));
        (text.contains("Kinect") && text.contains("RealSense")).then_some(text)
    });
    assert!(text.contains(&source) && text.contains("usb:kinect"), "{text}");
}

#[test]
fn a_headset_is_read_over_usb() {
    modprobe(&["vhci-hcd"]);
    let _device = Plugged::new(Headset::new("cli-headset", (0xfff0, 2), CLASS, Speed::High)).unwrap();
    let json = wait_for("the headset", || {
        let out = isobath(&["info", "usb:bulk", "--json"]);
        out.status.success().then(|| said(&out))
    });
    for (name, expected) in ["fx", "fy", "cx", "cy", "unit_m"].into_iter().zip(PINHOLE.into_iter().chain([UNIT_M])) {
        assert!((field(&json, name) - f64::from(expected)).abs() < 1e-3 * f64::from(expected), "{name}: {json}");
    }
}

/// The cable is pulled while the program records: it ends, says so, and what was recorded can be read.
#[test]
fn a_camera_that_goes_away_ends_a_recording_well() {
    let (camera, source) = plug("cli-pull");
    camera.device().stream().faults.insert(12, Fault::Unplug(100_000));
    let out = isobath(&["record", &source, "--frames", "500", "--out", "/tmp/pulled.mcap"]);
    let text = said(&out);
    assert!(text.contains("disconnected"), "{text}");
    let mut recording =
        isobath_recording::open(Path::new("/tmp/pulled.mcap"), &isobath_recording::OpenOptions::default()).unwrap();
    let (mut frame, mut frames) = (OwnedFrame::new(), 0);
    while recording.next_into(&mut frame, Deadline::NEVER).unwrap() == Outcome::Frame {
        assert!(number(&frame).is_some_and(|n| n < 12));
        frames += 1;
    }
    assert!(frames > 0, "{text}");
}
