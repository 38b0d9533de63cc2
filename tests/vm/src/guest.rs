//! Inside the guest: loading modules, finding the nodes of a device, running programs.
//!
//! There is no `udev`: modules are loaded by name, and nodes come from the kernel's own `devtmpfs`. Waits are bounded by the guest's clock, which
//! counts instructions: a limit means the same on a busy machine.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// The longest that anything in the guest is waited for.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// Loads modules, with parameters after the name. A module that is loaded stays as it is.
///
/// # Panics
/// When one can't be loaded: the test has failed.
pub fn modprobe(modules: &[&str]) {
    for module in modules {
        let status = Command::new("modprobe").args(module.split(' ')).status();
        assert!(status.is_ok_and(|s| s.success()), "modprobe {module}");
    }
}

/// What a camera needs.
pub fn camera_modules() {
    modprobe(&["vhci-hcd", "uvcvideo"]);
}

/// Asks again and again, until there is an answer.
///
/// # Panics
/// When there is none within [`PATIENCE`]: the test has failed.
pub fn wait_for<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(answer) = ask() {
            return answer;
        }
        assert!(start.elapsed() < PATIENCE, "waited {PATIENCE:?} for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A text file's content without the white space around it.
#[must_use]
pub fn text(path: impl AsRef<Path>) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

/// The V4L2 nodes of the USB device with this serial number, in the order of their interfaces: `/dev/video0`, ...
#[must_use]
pub fn video_nodes(serial: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir("/sys/class/video4linux").into_iter().flatten().flatten();
    let mut found: Vec<(String, PathBuf)> = entries
        .filter_map(|entry| {
            let interface = entry.path().join("device").canonicalize().ok()?;
            (text(interface.parent()?.join("serial"))? == serial).then(|| {
                let name = entry.file_name().to_string_lossy().into_owned();
                (interface.to_string_lossy().into_owned() + &name, Path::new("/dev").join(name))
            })
        })
        .collect();
    found.sort();
    found.into_iter().map(|(_, node)| node).collect()
}

/// Waits for a device's first node.
#[must_use]
pub fn first_video_node(serial: &str) -> PathBuf {
    wait_for("the camera's node", || video_nodes(serial).into_iter().find(|node| node.exists()))
}

/// Memory that this process holds, kilobytes.
#[must_use]
pub fn resident_kb() -> u64 {
    let status = text("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// Reads `count` frames with `v4l2-ctl`, which is not ours, in the format of this four-letter code: their bytes, as the kernel gave them.
///
/// # Panics
/// When it fails: the test has failed.
#[must_use]
pub fn read_by_v4l2_ctl(node: &Path, code: &str, (width, height): (usize, usize), count: usize) -> Vec<u8> {
    let format = format!("--set-fmt-video=width={width},height={height},pixelformat={code}");
    let out = Command::new("v4l2-ctl")
        .arg("-d")
        .arg(node)
        .args([&format, "--stream-mmap=4", &format!("--stream-count={count}"), "--stream-to=/tmp/frames"])
        .output()
        .expect("v4l2-ctl is in the guest");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    fs::read("/tmp/frames").expect("v4l2-ctl wrote frames")
}

/// The folder of the industrial-IO device of this name: `accel_3d`.
#[must_use]
pub fn iio_device(name: &str) -> PathBuf {
    wait_for(name, || {
        let entries = fs::read_dir("/sys/bus/iio/devices").into_iter().flatten().flatten();
        let mut folders = entries.map(|entry| entry.path());
        folders.find(|path| text(path.join("name")).as_deref() == Some(name) && path.join("buffer").is_dir())
    })
}

/// What a sensor hub needs.
pub fn motion_modules() {
    modprobe(&["usbhid", "hid-generic", "hid-sensor-hub", "hid-sensor-accel-3d", "hid-sensor-gyro-3d"]);
}

/// Processor time that this process has taken.
#[must_use]
pub fn processor_time() -> Duration {
    // Fields 14 and 15 of the line, in hundredths of a second; the name before them is in parentheses and may hold anything.
    let stat = text("/proc/self/stat").unwrap_or_default();
    let after = stat.rsplit(')').next().unwrap_or_default();
    let ticks = after.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<u64>().ok());
    Duration::from_millis(10 * ticks.sum::<u64>())
}

/// Whether uvcvideo hands broken frames over, with an error flag, instead of dropping them.
///
/// # Panics
/// When the module is not loaded: the test has failed.
pub fn uvc_hands_broken_frames_over(on: bool) {
    let file = "/sys/module/uvcvideo/parameters/nodrop";
    fs::write(file, if on { "1" } else { "0" }).expect("uvcvideo is loaded");
}

/// Whether uvcvideo hands over all the metadata of a D435i, or (as its table of devices says before Linux 6.8) only the times of every
/// payload's header. The line is one that a user may write, too: the camera is treated as the one that the table has.
///
/// # Panics
/// When the module is not loaded: the test has failed.
pub fn uvc_knows_the_d435(on: bool) {
    let (file, line) = if on { ("new_id", "8086 0b3a 0e 8086 0b03") } else { ("remove_id", "8086 0b3a") };
    fs::write(Path::new("/sys/bus/usb/drivers/uvcvideo").join(file), line).expect("uvcvideo is loaded");
}

/// Unloads a module, once nobody uses it any more.
///
/// # Panics
/// When it stays in use: the test has failed.
pub fn unload(module: &str) {
    wait_for("a module to be unused", || {
        Command::new("rmmod").arg(module).status().is_ok_and(|s| s.success()).then_some(())
    });
}

/// Files that this process has open.
#[must_use]
pub fn open_files() -> usize {
    fs::read_dir("/proc/self/fd").map_or(0, Iterator::count)
}
