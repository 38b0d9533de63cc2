//! What is plugged in, what can be done with it, and what is missing, in words.

use std::fmt;
use std::path::PathBuf;

use isobath_source::permission::{Subsystem, group_of, hint};

use crate::open::{depth_format, formats};
use crate::profile::Family;
use crate::queue::uninterrupted;
use crate::sys::{FourCc, Kind, V4l2Open, V4l2Sys};
use crate::sysfs::Roots;

/// A node and what it is good for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceReport {
    /// Its path: what to write behind `v4l2:`.
    pub path: PathBuf,
    /// The camera's name.
    pub name: String,
    /// USB vendor and product number, where it is on USB.
    pub usb: Option<(u16, u16)>,
    /// The USB device's serial number.
    pub serial: Option<String>,
    /// Its pixel formats, by their letters.
    pub formats: Vec<String>,
    /// Whether it can be opened as a depth source.
    pub has_depth: bool,
    /// What can be done with it.
    pub can: Vec<String>,
    /// What is missing, and how to get it.
    pub missing: Vec<String>,
}

impl fmt::Display for DeviceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path.display(), self.name)?;
        if let Some((vendor, product)) = self.usb {
            write!(f, " ({vendor:04x}:{product:04x})")?;
        }
        let lines = self.can.iter().map(|l| ("can", l)).chain(self.missing.iter().map(|l| ("missing", l)));
        lines.into_iter().try_for_each(|(word, line)| write!(f, "\n  {word}: {line}"))
    }
}

/// Looks at every video node of the machine.
#[must_use]
pub fn devices_with<O: V4l2Open>(opener: &O, roots: &Roots) -> Vec<DeviceReport> {
    roots
        .nodes()
        .into_iter()
        .map(|node| {
            let usb = node.usb.as_ref().map(|u| (u.vendor, u.product));
            let family = Family::of(usb);
            let mut report = DeviceReport {
                path: node.path.clone(),
                name: match family {
                    Family::Generic => node.name.clone(),
                    known => known.name().to_owned(),
                },
                usb,
                serial: node.usb.as_ref().and_then(|u| u.serial.clone()),
                formats: Vec::new(),
                has_depth: false,
                can: Vec::new(),
                missing: Vec::new(),
            };
            let mut sys = match uninterrupted(|| opener.open(&node.path)) {
                Ok(sys) => sys,
                Err(errno) => {
                    let what = match errno.0 {
                        1 | 13 => format!(
                            "the right to open it: {}",
                            hint(Subsystem::Video4Linux, group_of(&node.path).as_deref(), usb)
                        ),
                        _ => format!("it can't be opened: {errno}"),
                    };
                    report.missing.push(what);
                    return report;
                }
            };
            let kind = match uninterrupted(|| sys.capability()) {
                Ok(cap) => cap.kind(),
                Err(errno) => {
                    report.missing.push(format!("it does not say what it is: {errno}"));
                    return report;
                }
            };
            let Some(kind) = kind else {
                report.missing.push("it captures nothing".into());
                return report;
            };
            let codes = formats(&mut sys, kind);
            report.formats = codes.iter().map(FourCc::to_string).collect();
            judge(&mut report, kind, &codes, family, node.usb.as_ref().and_then(|u| u.speed));
            report
        })
        .collect()
}

fn judge(report: &mut DeviceReport, kind: Kind, codes: &[FourCc], family: Family, speed: Option<u32>) {
    if kind == Kind::Meta {
        report.can.push(format!(
            "metadata of the images ({}); used by itself with the depth node",
            report.formats.join(", ")
        ));
        return;
    }
    let named = |code: &[u8; 4]| codes.contains(&FourCc(*code));
    let Some(pixels) = depth_format(codes, None) else {
        let colour = [b"YUYV", b"UYVY", b"MJPG"].into_iter().any(named);
        report.can.push(if colour {
            "colour; used by itself with a depth camera of the same device that knows its place".into()
        } else {
            format!("no depth: {}", report.formats.join(", "))
        });
        return;
    };
    report.has_depth = true;
    report.can.push(format!("depth as {pixels}: isobath run v4l2:{}", report.path.display()));
    match family {
        Family::RealSense(_) => report.can.push("unit, intrinsics, colour and times from the camera itself".into()),
        Family::Orbbec(_) => {
            report.can.push("the depth unit from the camera itself".into());
            report.missing.push("intrinsics: a camera.toml (--camera) or --intrinsics FX,FY,CX,CY".into());
        }
        Family::Generic => report.missing.push(
            "what the numbers mean: a camera.toml (--camera), or --intrinsics FX,FY,CX,CY and --unit METRES_PER_STEP"
                .into(),
        ),
    }
    if let (Family::RealSense(_), Some(speed @ ..5000)) = (family, speed) {
        report.missing.push(format!(
            "bandwidth: it is connected at {speed} Mbit/s, a USB 3 port and cable allow larger images and higher rates"
        ));
    }
}
