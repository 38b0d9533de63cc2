//! One sensor of IIO: what its attributes say, its buffer, its scans.

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use isobath::glam::{Mat3, Vec3};
use isobath::wire::device::iio::{ChannelType, layout, realsense};
use isobath_source::SourceError;
use isobath_source::permission::Subsystem;

use crate::stamps::Stamps;
use crate::sysfs::{Found, Root, read, write};

/// Scans that the kernel keeps for us.
const KERNEL_SCANS: usize = 128;
/// Scans that are read at once.
const AT_ONCE: usize = 64;

/// Whose numbers are to be read in another way than the kernel says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Quirk {
    /// As the kernel says.
    #[default]
    None,
    /// RealSense's motion module, firmware 5.16 and later: its own scales.
    RealSense,
    /// RealSense's motion module with older firmware: its own scales, and the gyroscope's values in 16 bits.
    RealSenseBefore516,
}

/// A vector's three channels.
#[derive(Debug, Clone, Copy)]
struct Triple {
    kinds: [ChannelType; 3],
    at: [usize; 3],
    scale: [f32; 3],
    offset: [f32; 3],
    mount: Mat3,
}

impl Triple {
    fn value(&self, scan: &[u8]) -> Option<Vec3> {
        let mut v = [0.0; 3];
        for (i, v) in v.iter_mut().enumerate() {
            let raw = self.kinds[i].value(scan.get(self.at[i]..)?, 0)?;
            *v = (raw as f32 + self.offset[i]) * self.scale[i];
        }
        Some(self.mount * Vec3::from_array(v))
    }
}

/// What a scan holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scan {
    /// Nanoseconds, of the clock that the driver uses.
    pub stamp: i64,
    /// Angular rate, rad/s.
    pub rate: Option<Vec3>,
    /// Specific force, m/s².
    pub force: Option<Vec3>,
    /// Magnetic field, microtesla.
    pub field: Option<Vec3>,
}

/// A sensor whose buffer is on; it is switched off when this is dropped.
#[derive(Debug)]
pub struct Device {
    found: Found,
    node: PathBuf,
    file: File,
    scan: usize,
    stamp_at: usize,
    gyroscope: Option<Triple>,
    accelerometer: Option<Triple>,
    magnetometer: Option<Triple>,
    buffer: Vec<u8>,
    filled: usize,
    stamps: Stamps,
    /// What a user should know.
    pub(crate) notes: Vec<String>,
    /// Readings a second, when the driver tells.
    pub(crate) rate_hz: f32,
}

/// One channel of the scan.
struct Channel {
    name: String,
    index: u32,
    kind: ChannelType,
}

impl Device {
    /// Switches a sensor's channels and buffer on.
    ///
    /// # Errors
    /// [`SourceError`]: attributes that may not be written, are missing, or make no sense; a sensor that is in use.
    pub fn start(root: &Root, found: &Found, quirk: Quirk, rate_hz: Option<f32>) -> Result<Self, SourceError> {
        let dir = &found.path;
        let node = root.dev.join(dir.file_name().unwrap_or_default());
        let failed = |path: &Path, doing, e| SourceError::device(path, doing, Subsystem::Iio, found.usb, e);
        let set = |name: &str, value: &str, doing| {
            let path = dir.join(name);
            write(&path, value).map_err(|e| failed(&path, doing, e))
        };
        let mut notes = Vec::new();
        // First, as only one program can: a sensor that another one reads is not touched.
        let open =
            OpenOptions::new().read(true).custom_flags(rustix::fs::OFlags::NONBLOCK.bits().cast_signed()).open(&node);
        let file = open.map_err(|e| SourceError::open_device(&node, Subsystem::Iio, found.usb, e))?;
        // Left on by a program that died.
        set("buffer/enable", "0", "switching its buffer off")?;
        if let Some(rate) = rate_hz {
            set_rate(dir, rate, &mut notes);
        }
        for kind in
            ["accel", "anglvel", "magn"].iter().filter(|k| dir.join(format!("scan_elements/in_{k}_x_en")).exists())
        {
            for axis in ["x", "y", "z"] {
                set(&format!("scan_elements/in_{kind}_{axis}_en"), "1", "switching a channel on")?;
            }
        }
        set("scan_elements/in_timestamp_en", "1", "switching time stamps on")?;
        // Old kernels have one clock.
        if write(&dir.join("current_timestamp_clock"), "monotonic").is_err() {
            notes.push("the driver's clock can't be chosen: times are mapped".to_owned());
        }
        choose_trigger(found, &mut notes);
        set("buffer/length", &KERNEL_SCANS.to_string(), "setting its buffer's length")?;

        let channels = channels(dir).map_err(|e| failed(dir, "reading its channels", e))?;
        let kinds: Vec<ChannelType> = channels.iter().map(|c| c.kind).collect();
        let mut offsets = vec![0; kinds.len()];
        let scan = layout(&kinds, &mut offsets).map_err(|e| strange(dir, &e.to_string()))?;
        let place = |name: &str| channels.iter().position(|c| c.name == name).map(|i| (kinds[i], offsets[i]));
        let (stamp, stamp_at) = place("in_timestamp").ok_or_else(|| strange(dir, "it has no time stamps"))?;
        if stamp != ChannelType::TIMESTAMP {
            return Err(strange(dir, &format!("its time stamps are {stamp}, not {}", ChannelType::TIMESTAMP)));
        }
        let triple = |kind: &str| -> Result<Option<Triple>, SourceError> {
            let axes = ["x", "y", "z"].map(|axis| place(&format!("in_{kind}_{axis}")));
            let [Some(x), Some(y), Some(z)] = axes else { return Ok(None) };
            let mut triple = Triple {
                kinds: [x.0, y.0, z.0],
                at: [x.1, y.1, z.1],
                scale: number(dir, kind, "scale", 1.0)?,
                offset: number(dir, kind, "offset", 0.0)?,
                mount: mount(dir, kind)?,
            };
            apply(quirk, kind, &mut triple);
            Ok(Some(triple))
        };
        let (gyroscope, accelerometer, mut magnetometer) = (triple("anglvel")?, triple("accel")?, triple("magn")?);
        if let Some(triple) = &mut magnetometer {
            // The kernel counts in gauss.
            triple.scale = triple.scale.map(|scale| scale * 100.0);
        }
        let rate_hz = rate(dir);
        set("buffer/enable", "1", "switching its buffer on")?;
        Ok(Self {
            found: found.clone(),
            node,
            file,
            scan,
            stamp_at,
            gyroscope,
            accelerometer,
            magnetometer,
            buffer: vec![0; scan * AT_ONCE],
            filled: 0,
            stamps: Stamps::default(),
            notes,
            rate_hz,
        })
    }

    /// The sensor.
    #[must_use]
    pub const fn found(&self) -> &Found {
        &self.found
    }

    /// To wait for scans on.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    /// Readings whose stamps were not usable.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.stamps.dropped()
    }

    /// Hands over the scans that are there, without waiting: how many came, usable or not.
    ///
    /// # Errors
    /// [`SourceError::Disconnected`] when the sensor is gone; [`SourceError`].
    pub fn scans(&mut self, mut take: impl FnMut(Scan)) -> Result<usize, SourceError> {
        let gone = || SourceError::Disconnected { device: self.node.display().to_string() };
        let place = self.buffer.get_mut(self.filled..).unwrap_or_default();
        let came = match self.file.read(place) {
            // A character device that ends has lost its sensor.
            Ok(0) => return Err(gone()),
            Ok(came) => came,
            Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => return Ok(0),
            Err(e) => {
                return Err(SourceError::device(&self.node, "reading scans", Subsystem::Iio, self.found.usb, e));
            }
        };
        self.filled += came;
        let whole = self.filled / self.scan;
        for scan in self.buffer.chunks_exact(self.scan).take(whole) {
            let stamp = scan.get(self.stamp_at..).and_then(|bytes| ChannelType::TIMESTAMP.value(bytes, 0));
            let Some(stamp) = stamp.filter(|t| self.stamps.usable(*t)) else { continue };
            let of = |triple: &Option<Triple>| triple.as_ref().and_then(|t| t.value(scan)).filter(|v| v.is_finite());
            let (rate, force) = (of(&self.gyroscope), of(&self.accelerometer));
            take(Scan { stamp, rate, force, field: of(&self.magnetometer) });
        }
        let used = whole * self.scan;
        self.buffer.copy_within(used..self.filled, 0);
        self.filled -= used;
        Ok(whole)
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // A sensor that is gone has no attribute any more.
        let _ = write(&self.found.path.join("buffer/enable"), "0");
    }
}

fn strange(dir: &Path, what: &str) -> SourceError {
    let hint = "its driver is not one that is understood; report what is in scan_elements/".to_owned();
    SourceError::Format { path: dir.to_path_buf(), line: None, what: what.to_owned(), hint }
}

/// The channels that are on, in the order of the scan.
fn channels(dir: &Path) -> io::Result<Vec<Channel>> {
    let elements = dir.join("scan_elements");
    let mut channels = Vec::new();
    for entry in std::fs::read_dir(&elements)? {
        let file = entry?.file_name();
        let Some(name) = file.to_str().and_then(|name| name.strip_suffix("_en")) else { continue };
        if read(&elements.join(&file))? != "1" {
            continue;
        }
        let attribute = |suffix: &str| read(&elements.join(format!("{name}_{suffix}")));
        let invalid = |what: String| io::Error::new(io::ErrorKind::InvalidData, what);
        let index = attribute("index")?.parse().map_err(|_| invalid(format!("the index of {name} is no number")))?;
        let kind = ChannelType::parse(&attribute("type")?).map_err(|e| invalid(format!("{name}: {e}")))?;
        channels.push(Channel { name: name.to_owned(), index, kind });
    }
    channels.sort_by_key(|c| c.index);
    Ok(channels)
}

/// A number a channel, from its own attribute or the one that all three share.
fn number(dir: &Path, kind: &str, what: &str, otherwise: f32) -> Result<[f32; 3], SourceError> {
    let mut values = [otherwise; 3];
    for (value, axis) in values.iter_mut().zip(["x", "y", "z"]) {
        let names = [format!("in_{kind}_{axis}_{what}"), format!("in_{kind}_{what}")];
        let Some(text) = names.iter().find_map(|name| read(&dir.join(name)).ok()) else { continue };
        let parsed = text.parse::<f32>().ok().filter(|v| v.is_finite());
        *value = parsed.ok_or_else(|| strange(dir, &format!("{} is \"{text}\", not a number", names[1])))?;
    }
    Ok(values)
}

/// How the sensor is mounted: rows separated by semicolons.
fn mount(dir: &Path, kind: &str) -> Result<Mat3, SourceError> {
    let names = [format!("in_{kind}_mount_matrix"), "in_mount_matrix".to_owned(), "mount_matrix".to_owned()];
    let Some(text) = names.iter().find_map(|name| read(&dir.join(name)).ok()) else { return Ok(Mat3::IDENTITY) };
    parse_mount(&text).ok_or_else(|| strange(dir, &format!("its mount matrix is \"{text}\", not nine numbers")))
}

/// `"1, 0, 0; 0, 1, 0; 0, 0, 1"`, row by row.
fn parse_mount(text: &str) -> Option<Mat3> {
    let mut values = text.split([',', ';']).map(|v| v.trim().parse::<f32>().ok().filter(|v| v.is_finite()));
    let mut rows = [0.0; 9];
    for value in &mut rows {
        *value = values.next()??;
    }
    values.next().is_none().then(|| Mat3::from_cols_array(&rows).transpose())
}

fn apply(quirk: Quirk, kind: &str, triple: &mut Triple) {
    let scale = match (quirk, kind) {
        (Quirk::None, _) | (_, "magn") => return,
        (_, "accel") => realsense::ACCEL,
        (Quirk::RealSense, _) => realsense::GYRO,
        (Quirk::RealSenseBefore516, _) => {
            triple.kinds = triple.kinds.map(realsense::low_16);
            realsense::GYRO_BEFORE_5_16
        }
    };
    (triple.scale, triple.offset) = ([scale; 3], [0.0; 3]);
}

/// The attributes that may hold the rate.
const RATES: [&str; 3] = ["sampling_frequency", "in_anglvel_sampling_frequency", "in_accel_sampling_frequency"];

fn rate(dir: &Path) -> f32 {
    let rates = ["buffer/sampling_frequency"].into_iter().chain(RATES);
    let number = |name: &str| read(&dir.join(name)).ok()?.parse::<f32>().ok().filter(|v| v.is_finite());
    rates.into_iter().find_map(number).unwrap_or(0.0)
}

fn set_rate(dir: &Path, rate: f32, notes: &mut Vec<String>) {
    let there = RATES.iter().filter(|name| dir.join(name).exists());
    let set = there.filter(|name| write(&dir.join(name), &rate.to_string()).is_ok()).count();
    if set == 0 {
        notes.push(format!("the rate can't be set to {rate} Hz: the driver's own is kept"));
    }
}

/// Sensors without a trigger give no scans; HID sensors have one of their own name.
fn choose_trigger(found: &Found, notes: &mut Vec<String>) {
    let path = found.path.join("trigger/current_trigger");
    let Ok(now) = read(&path) else { return };
    if !now.is_empty() {
        return;
    }
    let number = found.path.file_name().and_then(|n| n.to_str()).map(|n| n.trim_start_matches("iio:device"));
    let own = format!("{}-dev{}", found.name, number.unwrap_or("0"));
    if write(&path, &own).is_err() {
        notes.push(format!("{} has no trigger, and {own} is none: without one no readings come", found.name));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mount_matrices_are_row_by_row() {
        let m = parse_mount("0, 1, 0; -1, 0, 0; 0, 0, 1").unwrap();
        assert_eq!(m * Vec3::new(2.0, 3.0, 4.0), Vec3::new(3.0, -2.0, 4.0));
        for bad in ["", "1,2,3", "1, 0, 0; 0, 1, 0; 0, 0, x", "1,0,0;0,1,0;0,0,1;0", "1,0,0;0,1,0;0,0,inf"] {
            assert!(parse_mount(bad).is_none(), "{bad}");
        }
    }
}
