//! Sensors as sysfs shows them.

use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Where the system keeps its devices.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Root {
    /// Directories of the sensors: `/sys/bus/iio/devices`.
    pub sysfs: PathBuf,
    /// Their nodes: `/dev`.
    pub dev: PathBuf,
}

impl Default for Root {
    fn default() -> Self {
        Self { sysfs: "/sys/bus/iio/devices".into(), dev: "/dev".into() }
    }
}

/// A sensor that can fill a buffer with scans.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// Its directory.
    pub path: PathBuf,
    /// Its name: "`accel_3d`", "bmi160".
    pub name: String,
    /// Whether it measures specific force.
    pub accelerometer: bool,
    /// Whether it measures angular rate.
    pub gyroscope: bool,
    /// Whether it measures the magnetic field.
    pub magnetometer: bool,
    /// Vendor and product number of the USB device it is a part of.
    pub usb: Option<(u16, u16)>,
}

/// An attribute without the white space and zero bytes around it (some drivers leave those).
///
/// # Errors
/// The system's.
pub fn read(path: &Path) -> io::Result<String> {
    let bytes = fs::read(path)?;
    Ok(String::from_utf8_lossy(&bytes).trim_matches(|c: char| c.is_whitespace() || c == '\0').to_owned())
}

/// Writes an attribute that is there.
///
/// # Errors
/// The system's.
pub fn write(path: &Path, value: &str) -> io::Result<()> {
    OpenOptions::new().write(true).truncate(true).open(path)?.write_all(value.as_bytes())
}

/// The directory of the USB device that a sensor is a part of.
#[must_use]
pub fn usb_parent(sensor: &Path) -> Option<PathBuf> {
    let real = fs::canonicalize(sensor).ok()?;
    real.ancestors().find(|dir| dir.join("idVendor").is_file()).map(Path::to_path_buf)
}

fn usb_numbers(sensor: &Path) -> Option<(u16, u16)> {
    let parent = usb_parent(sensor)?;
    let number = |name: &str| u16::from_str_radix(&read(&parent.join(name)).ok()?, 16).ok();
    Some((number("idVendor")?, number("idProduct")?))
}

/// What a directory is, if it is a sensor with a buffer.
#[must_use]
pub fn describe(path: &Path) -> Option<Found> {
    let axis = |kind: &str| path.join(format!("scan_elements/in_{kind}_x_en")).is_file();
    let (accelerometer, gyroscope, magnetometer) = (axis("accel"), axis("anglvel"), axis("magn"));
    if !accelerometer && !gyroscope && !magnetometer {
        return None;
    }
    let name = read(&path.join("name")).unwrap_or_default();
    Some(Found { path: path.to_path_buf(), name, accelerometer, gyroscope, magnetometer, usb: usb_numbers(path) })
}

/// Every sensor, in the order of the kernel's numbers; none where there is no such directory.
#[must_use]
pub fn list(root: &Root) -> Vec<Found> {
    let entries = fs::read_dir(&root.sysfs).into_iter().flatten().flatten();
    let number = |found: &Found| {
        let name = found.path.file_name()?.to_str()?;
        name.trim_start_matches("iio:device").parse::<u32>().ok()
    };
    let mut all: Vec<Found> = entries.filter_map(|entry| describe(&entry.path())).collect();
    all.sort_by_key(|found| (number(found), found.path.clone()));
    all
}

/// The sensor that belongs to another and fits: the one with which it shares the longest way from the root, which is a device that both are parts of.
#[must_use]
pub fn partner<'a>(of: &Found, all: &'a [Found], fits: impl Fn(&Found) -> bool) -> Option<&'a Found> {
    let mine = real(&of.path);
    let near = |f: &&Found| mine.components().zip(real(&f.path).components()).take_while(|(a, b)| a == b).count();
    // The first of the nearest ones.
    all.iter().filter(|f| f.path != of.path && fits(f)).rev().max_by_key(near)
}

/// Whether two sensors are parts of one device: of one USB device, or children of one directory that is not the system's list.
#[must_use]
pub fn together(a: &Found, b: &Found) -> bool {
    let parent = |f: &Found| real(&f.path).parent().map(Path::to_path_buf);
    match (usb_parent(&a.path), usb_parent(&b.path)) {
        (Some(a), Some(b)) => a == b,
        (None, None) => parent(a) == parent(b),
        _ => false,
    }
}

fn real(path: &Path) -> PathBuf {
    fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf())
}
