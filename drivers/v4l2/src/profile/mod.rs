//! What a camera's numbers mean: by the device itself where it says so, by a calibration file where not.
//!
//! A `FourCC` never tells the unit, the pinhole, or how fast the device's clock runs. Makers' cameras have it in their memory, each behind its own
//! protocol; which protocol is decided by vendor and product number alone (Orbbec's cameras use RealSense's extension unit GUID). Every
//! other camera is *generic*: everything that turns pixels into metres comes from the caller, and what is missing is an error that names it.
//!
//! | module | cameras | from the device |
//! |---|---|---|
//! | [`realsense`] | Intel RealSense D400 | unit, intrinsics of the resolution, colour camera and its place, clock, frame counter |
//! | [`orbbec`] | Orbbec Gemini, Astra 2 (UVC) | unit |

pub mod orbbec;
pub mod realsense;

use std::path::Path;
use std::time::Duration;

use isobath::sensing::camera::{Camera, Distortion, Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::confidence::Limits;
use isobath::sensing::depth::decode::Disparity;
use isobath_recording::{CameraFile, Format};
use isobath_source::SourceError;

use crate::decode::Meaning;
use crate::queue::uninterrupted;
use crate::sys::{Errno, Query, SysResult, V4l2Sys};

/// What a device says of itself, as far as it does.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Facts {
    /// Model, serial number, firmware, in words; empty when not known.
    pub kind: String,
    /// Metres a step.
    pub unit: Option<DepthUnit>,
    /// The depth camera's pinhole at the size that was granted; depth is rectified.
    pub intrinsics: Option<Intrinsics>,
    /// Steps a second of the device's clock in the metadata.
    pub clock_hz: Option<f64>,
    /// What the colour camera's calibration says.
    pub colour: Option<ColourFacts>,
    /// What a user should know.
    pub notes: Vec<String>,
}

/// A colour camera beside the depth camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourFacts {
    /// Its calibration table: the pinhole depends on the size.
    pub table: isobath::wire::device::d4xx::tables::ColourTable,
    /// Its place in the depth camera's frame.
    pub pose: Pose,
}

/// Which protocol a camera speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Intel RealSense D400.
    RealSense(realsense::Model),
    /// Orbbec with a UVC interface.
    Orbbec(orbbec::Model),
    /// Any other.
    Generic,
}

impl Family {
    /// By USB vendor and product number.
    #[must_use]
    pub fn of(usb: Option<(u16, u16)>) -> Self {
        usb.and_then(|usb| realsense::Model::of(usb).map(Self::RealSense).or(orbbec::Model::of(usb).map(Self::Orbbec)))
            .unwrap_or(Self::Generic)
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::RealSense(model) => model.name,
            Self::Orbbec(model) => model.name,
            Self::Generic => "depth camera",
        }
    }
}

/// Attempts of one request to an extension unit.
const ATTEMPTS: u32 = 6;

/// A request to an extension unit's control. Cameras are busy now and then: what passes is tried again, six times in 0.3 s.
///
/// # Errors
/// The kernel's number.
pub fn control(sys: &mut impl V4l2Sys, unit: u8, selector: u8, query: Query, data: &mut [u8]) -> SysResult<()> {
    let mut pause = Duration::from_millis(10);
    for _ in 1..ATTEMPTS {
        match uninterrupted(|| sys.extension(unit, selector, query, data)) {
            Err(Errno::EIO | Errno::EAGAIN | Errno::EBUSY) => sys.pause(pause),
            result => return result,
        }
        pause *= 2;
    }
    uninterrupted(|| sys.extension(unit, selector, query, data))
}

/// What turns codes into metres and pixels into rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// What the codes are.
    pub meaning: Meaning,
    /// The depth camera.
    pub camera: Camera,
    /// Which readings are believed.
    pub limits: Option<Limits>,
}

/// Completes what the device says by what the caller says, who wins.
///
/// # Errors
/// [`SourceError::MissingCalibration`] naming what neither says; [`SourceError::Config`] for values that can't be.
pub fn calibrate(
    facts: &Facts,
    values: &CameraFile,
    size: (u32, u32),
    path: &Path,
    file: Option<&Path>,
) -> Result<Calibration, SourceError> {
    let at = file.unwrap_or(path);
    let bad = |what: String, hint: &str| SourceError::Config { path: at.into(), what, hint: hint.into() };
    let said = (values.width.unwrap_or(size.0 as usize), values.height.unwrap_or(size.1 as usize));
    let by_hand = [values.fx, values.fy, values.cx, values.cy];
    if by_hand.iter().any(Option::is_some) && said != (size.0 as usize, size.1 as usize) {
        return Err(bad(
            format!("is for {}x{} images, but the camera gives {}x{}", said.0, said.1, size.0, size.1),
            "fx, fy, cx and cy belong to one size: ask for that size, or scale them",
        ));
    }
    let depth = &values.depth;
    let own = facts.intrinsics;
    let k = |given: Option<f32>, of: fn(&Intrinsics) -> f32| given.or(own.as_ref().map(of));
    let k = (
        k(values.fx, Intrinsics::fx),
        k(values.fy, Intrinsics::fy),
        k(values.cx, Intrinsics::cx),
        k(values.cy, Intrinsics::cy),
    );
    let unit = depth.unit.map(DepthUnit::new).transpose().map_err(|e| bad(e.to_string(), "give metres per step"))?;
    let format = depth.format.unwrap_or(Format::U16);
    let needs = [
        ("fx", k.0.is_none()),
        ("fy", k.1.is_none()),
        ("cx", k.2.is_none()),
        ("cy", k.3.is_none()),
        ("depth.unit", format == Format::U16 && unit.or(facts.unit).is_none()),
        ("depth.baseline", format == Format::Disparity && depth.baseline.is_none()),
    ];
    let missing: Vec<_> = needs.iter().filter(|(_, missing)| *missing).map(|(name, _)| *name).collect();
    let (Some(fx), Some(fy), Some(cx), Some(cy), true) = (k.0, k.1, k.2, k.3, missing.is_empty()) else {
        return Err(SourceError::MissingCalibration {
            path: path.into(),
            needed: missing,
            hint: "this camera does not say it: write a camera.toml as for recordings (width, height, fx, fy, cx, cy, and unit in [depth]) and give it with --camera, or give --intrinsics FX,FY,CX,CY and --unit METRES_PER_STEP".into(),
        });
    };
    let meaning = match format {
        Format::U16 => Meaning::Steps(unit.or(facts.unit).unwrap_or(DepthUnit::MILLIMETRE)),
        Format::Depth16 => Meaning::Depth16,
        Format::Disparity => {
            let (focal, baseline) = (depth.focal.unwrap_or_else(|| fx.abs()), depth.baseline.unwrap_or(0.0));
            let (offset, scale) = (depth.offset.unwrap_or(0.0), depth.scale.unwrap_or(1.0));
            Meaning::Disparity(Disparity { focal, baseline, offset, scale }, unit)
        }
        Format::F32 | Format::Projective => {
            return Err(bad(
                "depth.format is of floating point, but cameras of Video4Linux give whole numbers".into(),
                "use format = \"u16\", \"disparity\" or \"depth16\"",
            ));
        }
    };
    let intrinsics = Intrinsics::new(fx, fy, cx, cy).map_err(|e| bad(e.to_string(), "check the calibration"))?;
    let distortion = match &values.distortion {
        Some(list) => Distortion::from_slice(list).ok_or_else(|| {
            bad(format!("distortion = {list:?} can't be"), "a list of 0, 4, 5 or 8 finite numbers in OpenCV's order")
        })?,
        None => Distortion::default(),
    };
    let default = Limits::default();
    let limits = Limits {
        min_z: depth.min_z.unwrap_or(default.min_z),
        max_z: depth.max_z.unwrap_or(default.max_z),
        min_confidence: depth.min_confidence.unwrap_or(default.min_confidence),
    };
    Ok(Calibration {
        meaning,
        camera: Camera { intrinsics, distortion },
        limits: (limits != default).then_some(limits),
    })
}
