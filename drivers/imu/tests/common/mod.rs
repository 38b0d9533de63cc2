//! A fake sysfs with pipes for nodes.

#![allow(dead_code, unreachable_pub, reason = "each test program uses a part of it")]

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use isobath_imu::Options;
use isobath_imu::sysfs::Root;
use isobath_source::{Clock, SystemClock};
use rustix::fs::{CWD, FileType, Mode, mknodat};

/// Directories that look like the system's.
pub struct Tree {
    dir: tempfile::TempDir,
}

impl Tree {
    pub fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir_all(dir.path().join("devices")).unwrap();
        fs::create_dir_all(dir.path().join("dev")).unwrap();
        Self { dir }
    }

    pub fn options(&self) -> Options {
        let root = Root { sysfs: self.dir.path().join("devices"), dev: self.dir.path().join("dev") };
        Options { root, ..Options::default() }
    }

    pub fn path(&self) -> &Path {
        self.dir.path()
    }

    pub fn get(&self, sensor: &str, attribute: &str) -> String {
        fs::read_to_string(self.dir.path().join("devices").join(sensor).join(attribute)).unwrap()
    }

    /// A sensor, behind a USB device when it has a vendor, and the pipe that plays its node. `axes` are the channels' names without "in_", and
    /// their types.
    pub fn sensor(
        &self,
        number: usize,
        name: &str,
        usb: Option<(&str, &str)>,
        channels: &[(&str, &str)],
        attributes: &[(&str, &str)],
    ) -> File {
        let node = format!("iio:device{number}");
        let link = self.dir.path().join("devices").join(&node);
        let dir: PathBuf = match usb {
            None => link.clone(),
            Some((vendor, port)) => {
                let parent = self.dir.path().join("usb").join(port);
                fs::create_dir_all(&parent).unwrap();
                fs::write(parent.join("idVendor"), format!("{vendor}\n")).unwrap();
                fs::write(parent.join("idProduct"), "0b3a\n").unwrap();
                let real = parent.join(&node);
                fs::create_dir_all(&real).unwrap();
                std::os::unix::fs::symlink(&real, &link).unwrap();
                real
            }
        };
        for sub in ["scan_elements", "buffer", "trigger"] {
            fs::create_dir_all(dir.join(sub)).unwrap();
        }
        let put = |name: &str, text: &str| fs::write(dir.join(name), text).unwrap();
        put("name", &format!("{name}\n"));
        put("buffer/enable", "0\n");
        put("buffer/length", "2\n");
        put("trigger/current_trigger", "\n");
        put("current_timestamp_clock", "realtime\n");
        for (index, (channel, kind)) in channels.iter().enumerate() {
            put(&format!("scan_elements/in_{channel}_en"), "0\n");
            put(&format!("scan_elements/in_{channel}_index"), &format!("{index}\n"));
            put(&format!("scan_elements/in_{channel}_type"), &format!("{kind}\n"));
        }
        for (attribute, text) in attributes {
            put(attribute, text);
        }
        let node = self.dir.path().join("dev").join(node);
        mknodat(CWD, &node, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        // Both ends, so that opening does not wait; the reader comes later.
        let nonblock = rustix::fs::OFlags::NONBLOCK.bits() as i32;
        OpenOptions::new().read(true).write(true).custom_flags(nonblock).open(node).unwrap()
    }
}

pub const TIMESTAMP: (&str, &str) = ("timestamp", "le:s64/64>>0");

/// Channels of a vector, all of one type, and a time stamp.
pub fn channels<'a>(names: [&'a str; 3], kind: &'a str) -> Vec<(&'a str, &'a str)> {
    names.iter().map(|name| (*name, kind)).chain([TIMESTAMP]).collect()
}

pub const ACCEL: [&str; 3] = ["accel_x", "accel_y", "accel_z"];
pub const GYRO: [&str; 3] = ["anglvel_x", "anglvel_y", "anglvel_z"];

/// A scan of a HID sensor: 16 bits in cells of 32, the neighbour's value above them.
pub fn hid_scan(v: [i16; 3], stamp: i64) -> Vec<u8> {
    let mut scan = Vec::new();
    for v in v {
        scan.extend(v.to_le_bytes());
        scan.extend([0x5a, 0xa5]);
    }
    scan.extend([0; 4]);
    scan.extend(stamp.to_le_bytes());
    scan
}

pub fn send(pipe: &mut File, bytes: &[u8]) {
    pipe.write_all(bytes).unwrap();
}

pub fn now() -> i64 {
    SystemClock.now().timestamp().as_nanos()
}
