//! The kernel's own virtual camera, whose driver makes errors on request: dropped frames, broken buffers, failing calls, a camera that goes away.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use isobath_source::{BackPressure, DepthSource, OwnedFrame, SourceError};
use isobath_v4l2::OpenOptions;
use isobath_v4l2::sys::FourCc;
use isobath_vm::guest::{modprobe, text, unload, wait_for};
use isobath_vm::watch::{Seen, WAIT, next};

/// A fresh pair of cameras, the second with planes; the first error of a test is no other test's.
struct Vivid {
    single: PathBuf,
    planes: PathBuf,
}

impl Vivid {
    fn new() -> Self {
        modprobe(&["vivid n_devs=2 node_types=0x1,0x1 multiplanar=1,2"]);
        let node = |name: &str| -> PathBuf {
            wait_for(name, || {
                let nodes = std::fs::read_dir("/sys/class/video4linux").ok()?.flatten();
                let mut found = nodes.filter(|n| text(n.path().join("name")).as_deref() == Some(name));
                let node = PathBuf::from("/dev").join(found.next()?.file_name());
                node.exists().then_some(node)
            })
        };
        Self { single: node("vivid-000-vid-cap"), planes: node("vivid-001-vid-cap") }
    }

    /// Sets a control of the first camera.
    fn set(&self, control: &str) {
        let status = Command::new("v4l2-ctl").arg("-d").arg(&self.single).args(["-c", control]).status();
        assert!(status.is_ok_and(|s| s.success()), "{control}");
    }

    fn try_open(&self) -> Result<Box<dyn DepthSource + Send>, SourceError> {
        isobath_v4l2::open(&self.single, &options())
    }

    fn open(&self) -> Box<dyn DepthSource + Send> {
        self.try_open().unwrap()
    }
}

impl Drop for Vivid {
    fn drop(&mut self) {
        unload("vivid");
    }
}

fn options() -> OpenOptions {
    let mut options = OpenOptions {
        size: Some((640, 360)),
        format: Some(FourCc(*b"Y16 ")),
        policy: BackPressure::Queue(4),
        ..OpenOptions::default()
    };
    let [fx, fy, cx, cy] = [500.0, 500.0, 319.5, 179.5].map(Some);
    (options.set.fx, options.set.fy, options.set.cx, options.set.cy) = (fx, fy, cx, cy);
    options.set.depth.unit = Some(0.0001);
    options
}

/// Asks so often; what came. The picture is not ours, so frames have no number.
fn ask(source: &mut dyn DepthSource, times: usize) -> Vec<Seen> {
    let mut frame = OwnedFrame::new();
    let mut seen = Vec::new();
    for _ in 0..times {
        seen.push(next(source, &mut frame, WAIT));
        if matches!(seen.last(), Some(Seen::Frame(_))) {
            assert_eq!(frame.size(), (640, 360));
        }
    }
    seen
}

fn frames(seen: &[Seen]) -> usize {
    seen.iter().filter(|s| matches!(s, Seen::Frame(_))).count()
}

#[test]
fn depth_by_a_format_that_may_be_depth() {
    let vivid = Vivid::new();
    let mut source = vivid.open();
    let seen = ask(&mut *source, 5);
    assert_eq!(frames(&seen), 5, "{seen:?}");
}

/// The driver answers `Z16 ` with another format, and calls that success.
#[test]
fn a_format_that_the_camera_does_not_have_is_refused() {
    let vivid = Vivid::new();
    let asked = OpenOptions { format: Some(FourCc(*b"Z16 ")), ..options() };
    let error = isobath_v4l2::open(&vivid.single, &asked).err().map(|e| e.to_string());
    assert!(error.as_ref().is_some_and(|e| e.contains("Z16")), "{error:?}");
}

#[test]
fn a_camera_with_planes_is_read() {
    let vivid = Vivid::new();
    let mut source = isobath_v4l2::open(&vivid.planes, &options()).unwrap();
    let seen = ask(&mut *source, 5);
    assert_eq!(frames(&seen), 5, "{seen:?}");
}

#[test]
fn dropped_frames_are_counted() {
    let vivid = Vivid::new();
    let mut source = vivid.open();
    vivid.set("percentage_of_dropped_buffers=50");
    let seen = ask(&mut *source, 20);
    let stats = source.stats();
    assert!(frames(&seen) == 20 && stats.dropped_by_system >= 5, "{stats:?}");
}

#[test]
fn a_broken_buffer_is_counted_and_not_given() {
    let vivid = Vivid::new();
    let mut source = vivid.open();
    ask(&mut *source, 2);
    vivid.set("inject_v4l2_buf_flag_error=1");
    let seen = ask(&mut *source, 6);
    let stats = source.stats();
    assert!(frames(&seen) >= 5 && stats.corrupt + stats.cancelled >= 1, "{stats:?} {seen:?}");
}

#[test]
fn calls_that_fail_are_told_and_the_next_try_may_work() {
    let vivid = Vivid::new();
    for control in ["inject_vidioc_reqbufs_error=1", "inject_vidioc_qbuf_error=1", "inject_vidioc_streamon_error=1"] {
        vivid.set(control);
        let mut source = vivid.open();
        let error = source.start().expect_err(control);
        assert!(!error.is_terminal(), "{control}: {error}");
        let seen = ask(&mut *source, 4);
        assert!(frames(&seen) >= 3, "{control}: {seen:?}");
    }
}

#[test]
fn a_fatal_error_of_the_stream_is_recovered_from() {
    let vivid = Vivid::new();
    let mut source = vivid.open();
    ask(&mut *source, 2);
    vivid.set("inject_fatal_streaming_error=1");
    let seen = ask(&mut *source, 8);
    assert!(seen.iter().any(|s| matches!(s, Seen::Gap(_))), "{seen:?}");
    assert!(matches!(seen.last(), Some(Seen::Frame(_))), "{seen:?}");
    assert_eq!(source.stats().recoveries, 1, "{:?}", source.stats());
}

#[test]
fn a_camera_that_goes_away_is_gone() {
    let vivid = Vivid::new();
    let mut source = vivid.open();
    ask(&mut *source, 2);
    vivid.set("disconnect=1");
    let seen = ask(&mut *source, 8);
    let gone = seen.iter().filter(|s| matches!(s, Seen::Gone(time) if *time < Duration::from_secs(3))).count();
    assert!(gone >= 3 && matches!(seen.last(), Some(Seen::Gone(_))), "{seen:?}");
}
