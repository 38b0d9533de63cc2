//! Small time-of-flight arrays as isobath frames: ST's VL53L5CX, VL53L7CX and VL53L8CX see 8 x 8 or 4 x 4 zones, and an image of 8 x 8
//! pixels is an image. [`zones`] turns what the sensor reports into depth and confidence; everything else is the core's.
//!
//! # What the numbers are
//!
//! * *Distance* is the depth `z` along the sensor's axis, not the length of the ray: the chip converts. An ST employee says so
//!   of the VL53L5CX (community.st.com, "what does `distance_mm` exactly mean": a wall seen squarely at 1 m reads 1 m in every zone), and
//!   the `vl53-8x8` driver's documentation of all three. ST's user manual (UM2884) was not to be had here, so it is a parameter:
//!   [`Distance::Radial`] for sensors and firmware that report the ray's length. In the corner zone of 45 x 45
//!   degrees the two differ by 12 %.
//! * *Status*: 5 is a complete range, 9 one whose echo merges with another's, 6 one without a check for wrap-around (the first after
//!   start). ST's driver header says "5 & 9 means ranging OK"; its manuals give 6 and 9 a confidence of 50 %. See [`Accept`].
//! * *Zone order*: row by row, but the lens turns the picture over, and then it matters how the board is mounted: see [`Order`].
//! * *Field of view*: 45 x 45 degrees (VL53L5CX, VL53L8CX), 60 x 60 (VL53L7CX), between the outer edges of the outermost zones
//!   ([`FOV_45`], [`FOV_60`], [`pinhole`]). It is nominal: a few degrees more or less between units and with the cover glass.
//!   The zones are taken as equal squares of the image plane, as the detector's are. Were they equal in angle, their directions
//!   would be off by at most 0.5 degrees.
//!
//! # What eight pixels can't do
//!
//! Every answer of the core takes such a frame as it is. Neighbouring zones see points far apart, though: a zone is 5.6 degrees wide,
//! 10 cm at 1 m. Planes stay exact, edges do not, and a ray that ends in an outermost zone of a slanted surface ends on that zone's
//! own depth, not on the plane. The height map wants cells no smaller than the zones' spacing on the floor, or it has gaps.
//!
//! Memory: none beyond the caller's images (192 bytes at 8 x 8). Cost: a pass over the zones. Error: none for z; a ray's length is
//! rounded to the nearest step of z.
#![no_std]
#![forbid(unsafe_code)]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable)
)]

use core::fmt;

use isobath::glam::Vec2;
use isobath::ground::image::ImageViewMut;
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::camera::intrinsics::IntrinsicsError;
use isobath::sensing::depth::confidence::FULL;

#[cfg(feature = "vl53-8x8")]
mod driver;
#[cfg(feature = "vl53-8x8")]
pub use driver::results;

/// Full field of view of the VL53L5CX and VL53L8CX along each side, radians (45 degrees).
pub const FOV_45: f32 = core::f32::consts::FRAC_PI_4;

/// Full field of view of the VL53L7CX along each side, radians (60 degrees).
pub const FOV_60: f32 = core::f32::consts::FRAC_PI_3;

/// What a reported distance measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Distance {
    /// The depth along the sensor's axis: what these sensors report.
    #[default]
    Perpendicular,
    /// The length of the ray through the zone's middle.
    Radial,
}

/// Which readings are believed, by their status; the others become holes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Accept {
    /// Status 5 alone.
    Complete,
    /// 5 and 9, which ST calls "ranging OK".
    #[default]
    Ranging,
    /// 5, 9 and 6, whose distance may be a multiple of the sensor's range off.
    Unchecked,
}

impl Accept {
    /// Confidence of a status, 0 to 255; 0: not believed.
    #[must_use]
    pub const fn confidence(self, status: u8) -> u8 {
        match (status, self) {
            (5, _) => FULL,
            (9, Self::Ranging | Self::Unchecked) | (6, Self::Unchecked) => 128,
            _ => 0,
        }
    }
}

/// How the zones lie in the image (x right, y down, as the camera looks): first transposed, then mirrored and flipped.
///
/// Hold a hand before one side of the sensor and see which zones shorten; nothing else is sure of a board's mounting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Order {
    /// Columns become rows: the board is turned by a quarter (with one of the others), or the driver counts the other way.
    pub transposed: bool,
    /// Left and right are exchanged.
    pub mirrored: bool,
    /// Top and bottom are exchanged.
    pub flipped: bool,
}

impl Order {
    /// Zone 0 is the image's top left.
    pub const AS_LISTED: Self = Self { transposed: false, mirrored: false, flipped: false };
    /// Zone 0 is the image's top right, as `SparkFun`'s examples print it for their boards ("decreasing x to reflect reality").
    pub const UPRIGHT: Self = Self { transposed: false, mirrored: true, flipped: false };
    /// [`Self::UPRIGHT`] with the board upside down.
    pub const UPSIDE_DOWN: Self = Self { transposed: false, mirrored: false, flipped: true };

    /// The pixel of a zone in an array of `side` x `side`.
    const fn pixel(self, zone: usize, side: usize) -> (usize, usize) {
        let (x, y) = (zone % side, zone / side);
        let (x, y) = if self.transposed { (y, x) } else { (x, y) };
        let last = side - 1;
        (if self.mirrored { last - x } else { x }, if self.flipped { last - y } else { y })
    }
}

/// How zones become pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ZoneParams {
    /// What distances measure. Default [`Distance::Perpendicular`].
    pub distance: Distance,
    /// How the zones lie. Default [`Order::UPRIGHT`].
    pub order: Order,
    /// Which readings are believed. Default [`Accept::Ranging`].
    pub accept: Accept,
    /// Targets that the driver reports for each zone, 1 or more (1 to 4 in ST's); the first of each is taken, which the
    /// sensor's target order decides. Default 1.
    pub targets: usize,
}

impl Default for ZoneParams {
    fn default() -> Self {
        Self { distance: Distance::Perpendicular, order: Order::UPRIGHT, accept: Accept::Ranging, targets: 1 }
    }
}

/// What became of the zones; the three counts add up to their number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ZoneReport {
    /// Zones with a reading.
    pub valid: usize,
    /// Zones whose status is not believed.
    pub refused: usize,
    /// Zones with a believed status and a distance of 0 or less.
    pub out_of_range: usize,
}

/// Why zones could not become an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ZoneError {
    /// The depth image is not square.
    NotSquare {
        /// Its width and height.
        size: (usize, usize),
    },
    /// The confidence image is not of the depth image's size.
    ConfidenceSize {
        /// Its width and height.
        size: (usize, usize),
    },
    /// Fewer distances or statuses than zones times targets, or no target a zone.
    TooFew {
        /// Needed; `usize::MAX` when no number would do.
        needed: usize,
        /// Given: the lesser of both.
        got: usize,
    },
}

impl fmt::Display for ZoneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotSquare { size } => {
                write!(f, "the depth image is {}x{}; zones make a square, 4x4 or 8x8", size.0, size.1)
            }
            Self::ConfidenceSize { size } => {
                write!(f, "the confidence image is {}x{}; it must be of the depth image's size", size.0, size.1)
            }
            Self::TooFew { needed, got } => {
                write!(f, "{got} distances or statuses given; zones times targets (1 or more) make {needed}")
            }
        }
    }
}

impl core::error::Error for ZoneError {}

/// The pinhole of an array of `side` x `side` zones that sees `fov` radians along each side.
///
/// # Errors
/// [`IntrinsicsError`] when the angle is not between 0 and π.
pub fn pinhole(fov: f32, side: usize) -> Result<Intrinsics, IntrinsicsError> {
    Intrinsics::from_fov(fov, side, side)
}

/// Writes the zones of one measurement, as the sensor numbers them, into a depth image of `side` x `side` pixels, and their
/// confidence beside it. Depth is in the distances' own unit: millimetres, or quarters of them in the driver's raw format.
///
/// `k` is the array's [`pinhole`]; only [`Distance::Radial`] looks at it.
///
/// # Errors
/// [`ZoneError`] when sizes do not fit; the images are then left alone.
///
/// ```
/// use isobath::glam::vec2;
/// use isobath::ground::image::Image;
/// use isobath::localized::hit::{HitParams, hit_test};
/// use isobath::sensing::depth::{DepthArray, DepthUnit};
/// use isobath::sensing::frame::DepthFrame;
/// use isobath_vl53::{FOV_45, ZoneParams, pinhole, zones};
/// let (distance_mm, mut status) = ([1200_i16; 64], [5_u8; 64]);
/// status[0] = 255; // no target in the zone that sees the top right corner
/// let k = pinhole(FOV_45, 8)?;
/// let mut depth = DepthArray::<8, 8>::filled(0);
/// let mut sure = Image::<u8, 8, 8>::filled(0);
/// let report =
///     zones(&distance_mm, &status, &ZoneParams::default(), &k, &mut depth.view_mut(), Some(&mut sure.view_mut()))?;
/// assert_eq!((report.valid, report.refused), (63, 1));
/// let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, k).with_confidence(sure.view())?;
/// assert_eq!(frame.z(7, 0), 0.0);
/// let hit = hit_test(&frame, vec2(3.5, 3.5), &HitParams::default());
/// assert!((hit.hit().unwrap().range - 1.2).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn zones(
    distances: &[i16],
    statuses: &[u8],
    params: &ZoneParams,
    k: &Intrinsics,
    depth: &mut ImageViewMut<'_, u16>,
    mut confidence: Option<&mut ImageViewMut<'_, u8>>,
) -> Result<ZoneReport, ZoneError> {
    let (side, height) = depth.size();
    if side != height {
        return Err(ZoneError::NotSquare { size: (side, height) });
    }
    if let Some(size) = confidence.as_ref().map(|c| c.size()).filter(|size| *size != (side, side)) {
        return Err(ZoneError::ConfidenceSize { size });
    }
    let needed = side.checked_mul(side).and_then(|n| n.checked_mul(params.targets)).unwrap_or(usize::MAX);
    let got = distances.len().min(statuses.len());
    if params.targets == 0 || needed > got {
        return Err(ZoneError::TooFew { needed: if params.targets == 0 { usize::MAX } else { needed }, got });
    }
    let mut report = ZoneReport::default();
    let firsts = distances.iter().zip(statuses).step_by(params.targets).take(side * side);
    for (zone, (&distance, &status)) in firsts.enumerate() {
        let (x, y) = params.order.pixel(zone, side);
        let sure = params.accept.confidence(status);
        let steps = u16::try_from(distance).unwrap_or(0);
        let z = match params.distance {
            Distance::Perpendicular => steps,
            Distance::Radial => (k.z_from_range(Vec2::new(x as f32, y as f32), f32::from(steps)) + 0.5) as u16,
        };
        let count = match (sure > 0, z > 0) {
            (false, _) => &mut report.refused,
            (true, false) => &mut report.out_of_range,
            (true, true) => &mut report.valid,
        };
        *count += 1;
        let believed = sure > 0 && z > 0;
        depth.set(x, y, if believed { z } else { 0 });
        if let Some(confidence) = &mut confidence {
            confidence.set(x, y, if believed { sure } else { 0 });
        }
    }
    Ok(report)
}

#[cfg(test)]
mod tests;
