//! Depth formats of the outside world, made into depth images.
//!
//! | format | function |
//! |---|---|
//! | `u16` bytes of either order, in any unit | [`u16_bytes`] |
//! | Android DEPTH16: 13 bits of millimetres, 3 of confidence | [`depth16`] |
//! | `f32` metres | [`metres`] |
//! | disparity, z = f b / (d + doffs) | [`disparity`] |
//! | projective (z-buffer) depth | [`projective`] |
//! | a camera's own: packed bits, planes, nibbles, by their V4L2 names | [`format`], [`packed`], [`planes`] |
//! | Kinect v1 disparity | [`kinect`] |
//!
//! Each writes caller memory, reads each pixel once, needs no scratch, and reports how many pixels became readings, how
//! many were holes already, and how many depths did not fit the output's unit (those become holes too: nothing is clamped
//! to a wrong depth). The camera's own formats unpack to raw codes; what a code means is the device's matter, so they have
//! no report unless they hold depth.

pub mod format;
pub mod kinect;
pub mod packed;
pub mod planes;

use core::fmt;

use crate::ground::image::{ImageView, ImageViewMut};
use crate::sensing::depth::{DepthSample, DepthUnit, confidence};

/// What became of the pixels; the three counts add up to the number of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DecodeReport {
    /// Pixels with a reading.
    pub valid: usize,
    /// Pixels that had no reading to begin with.
    pub holes: usize,
    /// Readings that the output's unit can't hold (too far or too near); written as holes.
    pub out_of_range: usize,
}

/// Why a depth image could not be decoded.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum DecodeError {
    /// The bytes end before the image does.
    TooShort {
        /// Bytes needed.
        needed: usize,
        /// Bytes given.
        got: usize,
    },
    /// A row of bytes is shorter than a row of pixels.
    StrideBelowRow {
        /// Bytes from row to row.
        stride: usize,
        /// Bytes a row of pixels needs.
        row: usize,
    },
    /// Input and output differ in size.
    SizeMismatch {
        /// Input width and height.
        input: (usize, usize),
        /// Output width and height.
        output: (usize, usize),
    },
    /// A constant of the conversion is not usable.
    BadConstant {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f32,
    },
}

impl fmt::Display for DecodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooShort { needed, got } => {
                write!(f, "depth data cut off: {needed} bytes needed, {got} given")
            }
            Self::StrideBelowRow { stride, row } => {
                write!(f, "row stride of {stride} bytes is below the {row} bytes of a row of pixels")
            }
            Self::SizeMismatch { input, output } => write!(
                f,
                "depth input is {}x{}, output {}x{}; they must be the same",
                input.0, input.1, output.0, output.1
            ),
            Self::BadConstant { name, value } => {
                write!(f, "{name} = {value} is not usable: it must be finite, and positive unless it is an offset")
            }
        }
    }
}

impl core::error::Error for DecodeError {}

/// Order of the bytes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ByteOrder {
    /// Least significant byte first (nearly every sensor).
    #[default]
    Little,
    /// Most significant byte first (PGM, PNG, Matroska `b16g`).
    Big,
}

/// Reads `u16` pixels from bytes whose rows start `stride` bytes apart; 65535 becomes 0.
///
/// # Errors
/// [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`].
///
/// ```
/// use isobath::ground::image::Image;
/// use isobath::sensing::depth::decode::{u16_bytes, ByteOrder};
/// let mut depth = Image::<u16, 2, 1>::filled(0);
/// let report = u16_bytes(&[0x03, 0xe8, 0xff, 0xff], 4, ByteOrder::Big, &mut depth.view_mut())?;
/// assert_eq!(depth.as_slice(), &[1000, 0]);
/// assert_eq!((report.valid, report.holes), (1, 1));
/// # Ok::<(), isobath::sensing::depth::decode::DecodeError>(())
/// ```
pub fn u16_bytes(
    bytes: &[u8],
    stride: usize,
    order: ByteOrder,
    out: &mut ImageViewMut<'_, u16>,
) -> Result<DecodeReport, DecodeError> {
    let (width, height) = out.size();
    let mut valid = 0;
    for (y, line) in lines(bytes, stride, width.saturating_mul(2), height)?.enumerate() {
        let pixels = out.row_mut(y);
        let (pairs, _) = line.as_chunks::<2>();
        match order {
            ByteOrder::Little => valid += copy_row(pixels, pairs, u16::from_le_bytes),
            ByteOrder::Big => valid += copy_row(pixels, pairs, u16::from_be_bytes),
        }
    }
    Ok(DecodeReport { valid, holes: width * height - valid, out_of_range: 0 })
}

/// The rows of an image in bytes: `row` bytes each at least, `stride` from one to the next.
fn lines(bytes: &[u8], stride: usize, row: usize, height: usize) -> Result<impl Iterator<Item = &[u8]>, DecodeError> {
    if stride < row {
        return Err(DecodeError::StrideBelowRow { stride, row });
    }
    let height = if row == 0 { 0 } else { height };
    let needed = match height.checked_sub(1) {
        None => 0,
        Some(gaps) => gaps.saturating_mul(stride).saturating_add(row),
    };
    if bytes.len() < needed {
        return Err(DecodeError::TooShort { needed, got: bytes.len() });
    }
    Ok(bytes.chunks(stride.max(1)).take(height))
}

/// Pixels whose valid ones are counted in 16 bits, as many lanes as the pixels have: counting in a `usize` costs more than copying.
const COUNTED: usize = 64;

#[inline(always)]
fn copy_row(out: &mut [u16], pairs: &[[u8; 2]], read: impl Fn([u8; 2]) -> u16) -> usize {
    let mut valid = 0_usize;
    for (out, pairs) in out.chunks_mut(COUNTED).zip(pairs.chunks(COUNTED)) {
        let mut here = 0_u16;
        for (pixel, pair) in out.iter_mut().zip(pairs) {
            let value = read(*pair);
            let ok = value.is_valid();
            *pixel = if ok { value } else { 0 };
            here += u16::from(ok);
        }
        valid += usize::from(here);
    }
    valid
}

/// Splits Android DEPTH16 into millimetres (low 13 bits) and confidence (high 3 bits, see [`confidence::from_depth16`]).
/// A confidence image, when given, must have the same size. Unit of the output: [`DepthUnit::MILLIMETRE`].
///
/// # Errors
/// [`DecodeError::SizeMismatch`].
pub fn depth16(
    raw: ImageView<'_, u16>,
    depth: &mut ImageViewMut<'_, u16>,
    mut sure: Option<&mut ImageViewMut<'_, u8>>,
) -> Result<DecodeReport, DecodeError> {
    same_size(raw.size(), depth.size())?;
    if let Some(sure) = &sure {
        same_size(raw.size(), sure.size())?;
    }
    let mut valid = 0;
    for y in 0..raw.height() {
        for (pixel, &value) in depth.row_mut(y).iter_mut().zip(raw.row(y)) {
            *pixel = value & 0x1fff;
            valid += usize::from(*pixel != 0);
        }
        if let Some(sure) = &mut sure {
            for (pixel, &value) in sure.row_mut(y).iter_mut().zip(raw.row(y)) {
                *pixel = if value & 0x1fff == 0 { 0 } else { confidence::from_depth16((value >> 13) as u8) };
            }
        }
    }
    Ok(DecodeReport { valid, holes: raw.width() * raw.height() - valid, out_of_range: 0 })
}

/// Converts `f32` metres into `unit`; NaN, infinite, zero and negative values become holes.
///
/// # Errors
/// [`DecodeError::SizeMismatch`].
pub fn metres<D: DepthSample>(
    raw: ImageView<'_, f32>,
    unit: DepthUnit,
    out: &mut ImageViewMut<'_, D>,
) -> Result<DecodeReport, DecodeError> {
    convert(raw, unit, out, |z| z)
}

/// The constants that turn disparity into depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disparity {
    /// Focal length in pixels (of the image the disparity is measured in).
    pub focal: f32,
    /// Distance between the two cameras in metres.
    pub baseline: f32,
    /// Difference of the principal points' x in pixels, added to each disparity (Middlebury's `doffs`).
    pub offset: f32,
    /// Pixels of disparity per step of the input (1 for `f32` pixels; 1/16 for OpenCV's fixed point; 1/8 for Kinect).
    pub scale: f32,
}

impl Disparity {
    /// Depth in metres of a raw disparity; 0 when it is not a number or not in front of the cameras.
    #[inline]
    #[must_use]
    pub fn z(&self, raw: f32) -> f32 {
        let d = raw * self.scale + self.offset;
        // An infinite disparity is how Middlebury marks "unknown": not "infinitely near".
        if d > 0.0 && d < f32::INFINITY { self.focal * self.baseline / d } else { 0.0 }
    }

    fn check(&self) -> Result<(), DecodeError> {
        for (name, value) in [("focal", self.focal), ("baseline", self.baseline), ("scale", self.scale)] {
            if !value.is_valid() {
                return Err(DecodeError::BadConstant { name, value });
            }
        }
        if self.offset.is_finite() {
            Ok(())
        } else {
            Err(DecodeError::BadConstant { name: "offset", value: self.offset })
        }
    }
}

/// Converts disparity (any number type that is exact in `f32`) into depth: z = focal * baseline / (disparity * scale + offset).
/// With `u16` input, 0 and 65535 are holes as everywhere.
///
/// # Errors
/// [`DecodeError::SizeMismatch`], [`DecodeError::BadConstant`].
///
/// ```
/// use isobath::ground::image::{Image, ImageView};
/// use isobath::sensing::depth::{decode::{disparity, Disparity}, DepthUnit};
/// let middlebury = Disparity { focal: 994.978, baseline: 0.193_001, offset: 31.086, scale: 1.0 };
/// let raw = [7.2_f32, f32::INFINITY];
/// let mut depth = Image::<u16, 2, 1>::filled(0);
/// disparity(ImageView::new(&raw, 2, 1)?, middlebury, DepthUnit::MILLIMETRE, &mut depth.view_mut())?;
/// assert_eq!(depth.as_slice(), &[5016, 0]);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
pub fn disparity<S: DepthSample, D: DepthSample>(
    raw: ImageView<'_, S>,
    constants: Disparity,
    unit: DepthUnit,
    out: &mut ImageViewMut<'_, D>,
) -> Result<DecodeReport, DecodeError> {
    constants.check()?;
    // `f32` zero disparity is legal (the offset makes it finite), negative too; only the sum must be positive.
    convert(raw, unit, out, |value: S| constants.z(S::number(value)))
}

/// The planes of a projective depth buffer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projective {
    /// Distance of the near plane in metres (buffer value 0).
    pub near: f32,
    /// Distance of the far plane in metres (buffer value 1); may be infinite.
    pub far: f32,
}

impl Projective {
    /// Depth in metres of a buffer value in [0, 1); 0 outside and on the far plane, where nothing was drawn.
    #[inline]
    #[must_use]
    pub fn z(&self, d: f32) -> f32 {
        if !(0.0..1.0).contains(&d) {
            return 0.0;
        }
        if self.far.is_finite() {
            // n f / (f - d (f - n)), divided through by f: far planes of 1e30 m do not overflow.
            self.near / (1.0 - d * (1.0 - self.near / self.far))
        } else {
            self.near / (1.0 - d)
        }
    }
}

/// Converts a projective depth buffer (OpenGL/Vulkan style window depth, 0 near to 1 far, OpenXR's depth layers): z = n f / (f - d (f - n)).
///
/// # Errors
/// [`DecodeError::SizeMismatch`], [`DecodeError::BadConstant`] unless 0 < near < far.
pub fn projective<D: DepthSample>(
    raw: ImageView<'_, f32>,
    planes: Projective,
    unit: DepthUnit,
    out: &mut ImageViewMut<'_, D>,
) -> Result<DecodeReport, DecodeError> {
    if !planes.near.is_valid() {
        return Err(DecodeError::BadConstant { name: "near", value: planes.near });
    }
    if planes.far.is_nan() || planes.far <= planes.near {
        return Err(DecodeError::BadConstant { name: "far", value: planes.far });
    }
    convert(raw, unit, out, |d| planes.z(d))
}

fn same_size(input: (usize, usize), output: (usize, usize)) -> Result<(), DecodeError> {
    if input == output { Ok(()) } else { Err(DecodeError::SizeMismatch { input, output }) }
}

fn convert<S: Copy, D: DepthSample>(
    raw: ImageView<'_, S>,
    unit: DepthUnit,
    out: &mut ImageViewMut<'_, D>,
    z: impl Fn(S) -> f32,
) -> Result<DecodeReport, DecodeError> {
    same_size(raw.size(), out.size())?;
    let mut report = DecodeReport::default();
    for y in 0..raw.height() {
        for (pixel, &value) in out.row_mut(y).iter_mut().zip(raw.row(y)) {
            let z = z(value);
            *pixel = D::from_metres(z, unit);
            if pixel.is_valid() {
                report.valid += 1;
            } else if z.is_valid() {
                report.out_of_range += 1;
            } else {
                report.holes += 1;
            }
        }
    }
    Ok(report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::image::Image;

    #[test]
    fn depth16_splits_every_value() {
        for raw in 0..=u16::MAX {
            let input = Image::<u16, 1, 1>::filled(raw);
            let mut mm = Image::<u16, 1, 1>::filled(9);
            let mut sure = Image::<u8, 1, 1>::filled(9);
            let report = depth16(input.view(), &mut mm.view_mut(), Some(&mut sure.view_mut())).unwrap();
            assert_eq!(mm.as_slice(), &[raw % 8192]);
            assert_eq!(report.valid, usize::from(raw % 8192 != 0));
            let want = match (raw % 8192, raw / 8192) {
                (0, _) => 0.0,
                (_, 0) => 1.0,
                (_, n) => f32::from(n - 1) / 7.0,
            };
            assert!((f32::from(sure.as_slice()[0]) / 255.0 - want).abs() <= 0.5 / 255.0 + 1e-6);
        }
    }

    #[test]
    fn bytes_that_end_early_are_refused() {
        let mut out = Image::<u16, 3, 2>::filled(0);
        let short = u16_bytes(&[0; 13], 8, ByteOrder::Little, &mut out.view_mut());
        assert_eq!(short.unwrap_err(), DecodeError::TooShort { needed: 14, got: 13 });
        let narrow = u16_bytes(&[0; 99], 5, ByteOrder::Little, &mut out.view_mut());
        assert_eq!(narrow.unwrap_err(), DecodeError::StrideBelowRow { stride: 5, row: 6 });
        let padded = [1, 0, 2, 0, 3, 0, 9, 9, 4, 0, 5, 0, 6, 0];
        u16_bytes(&padded, 8, ByteOrder::Little, &mut out.view_mut()).unwrap();
        assert_eq!(out.as_slice(), &[1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn projective_depth_inverts_the_projection() {
        for (near, far) in [(0.1_f32, 100.0_f32), (0.05, 8.0), (0.1, f32::INFINITY), (0.1, 1e30)] {
            for z in [0.2_f32, 1.0, 7.9] {
                let (n, f, zz) = (f64::from(near), f64::from(far), f64::from(z));
                let d = if far.is_finite() { f / (f - n) * (1.0 - n / zz) } else { 1.0 - n / zz };
                let got = Projective { near, far }.z(d as f32);
                // The buffer's own resolution: one ulp of d near 1 moves z by z^2/n * 6e-8.
                assert!((got - z).abs() < z * z / near * 2e-7, "{near} {far} {z} {got}");
            }
            assert_eq!(Projective { near, far }.z(1.0), 0.0);
            assert_eq!(Projective { near, far }.z(f32::NAN), 0.0);
        }
    }

    #[test]
    fn constants_are_checked() {
        let raw = Image::<f32, 1, 1>::filled(1.0);
        let mut out = Image::<u16, 1, 1>::filled(0);
        let good = Disparity { focal: 500.0, baseline: 0.1, offset: 0.0, scale: 1.0 };
        for bad in [
            Disparity { focal: 0.0, ..good },
            Disparity { baseline: f32::NAN, ..good },
            Disparity { offset: f32::INFINITY, ..good },
            Disparity { scale: -1.0, ..good },
        ] {
            assert!(disparity(raw.view(), bad, DepthUnit::MILLIMETRE, &mut out.view_mut()).is_err());
        }
        for (near, far) in [(0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (0.1, f32::NAN), (f32::INFINITY, f32::INFINITY)] {
            let planes = Projective { near, far };
            assert!(projective(raw.view(), planes, DepthUnit::MILLIMETRE, &mut out.view_mut()).is_err());
        }
    }

    #[test]
    fn what_does_not_fit_the_unit_is_counted() {
        let raw = Image::<f32, 4, 1>::from_rows([[1.0, 70.0, f32::NAN, -1.0]]);
        let mut out = Image::<u16, 4, 1>::filled(7);
        let report = metres(raw.view(), DepthUnit::MILLIMETRE, &mut out.view_mut()).unwrap();
        assert_eq!(report, DecodeReport { valid: 1, holes: 2, out_of_range: 1 });
        assert_eq!(out.as_slice(), &[1000, 0, 0, 0]);
    }
}
