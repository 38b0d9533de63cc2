//! Confidence: how sure the sensor is of a pixel, from 0 (not at all) to 255 (certain), one byte a pixel.
//!
//! | sensor | its form | here |
//! |---|---|---|
//! | Android DEPTH16 | 3 bits: 0 = 100 %, 1 = 0 %, n = (n - 1) / 7 | [`from_depth16`] |
//! | ARCore raw depth | 0 to 255 | as it is |
//! | Apple LiDAR | low, medium, high (0, 1, 2) | [`from_level`]`(n, 2)` |
//! | RealSense INZI/CNF4 | 4 bits | [`from_level`]`(n, 15)` |
//!
//! Confidence is categorical for most sensors: select by it, never interpolate it.

use crate::ground::image::{ImageView, ImageViewMut};
use crate::sensing::depth::{DepthSample, DepthUnit};

/// Certain.
pub const FULL: u8 = 255;

/// From one of the levels 0 to `highest`; more than `highest` counts as `highest`, and `highest == 0` as certain.
#[must_use]
pub const fn from_level(level: u8, highest: u8) -> u8 {
    if highest == 0 || level >= highest {
        return FULL;
    }
    // Rounded to nearest, so that levels round-trip.
    ((level as u16 * 255 + highest as u16 / 2) / highest as u16) as u8
}

/// From the top three bits of a DEPTH16 value (Android `ImageFormat.DEPTH16`): 0 means 100 %, 1 means 0 %, n means (n - 1) / 7.
#[must_use]
pub const fn from_depth16(bits: u8) -> u8 {
    match bits & 7 {
        0 => FULL,
        n => from_level(n - 1, 7),
    }
}

/// Which pixels count as readings: a span of depths and a least confidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Nearest depth that is believed, in metres. Default 0.
    pub min_z: f32,
    /// Farthest depth that is believed, in metres (DepthLab: 8 m). Default infinite.
    pub max_z: f32,
    /// Least confidence that is believed, 0 to 255. Default 0.
    pub min_confidence: u8,
}

impl Default for Limits {
    fn default() -> Self {
        Self { min_z: 0.0, max_z: f32::INFINITY, min_confidence: 0 }
    }
}

/// Turns readings outside `limits` into holes, in place; returns how many. Pixels beyond the confidence image count as
/// certain. One pass, no memory.
pub fn apply_limits<D: DepthSample>(
    depth: &mut ImageViewMut<'_, D>,
    unit: DepthUnit,
    confidence: Option<ImageView<'_, u8>>,
    limits: Limits,
) -> usize {
    let mut removed = 0;
    for y in 0..depth.height() {
        let sure = confidence.map_or(&[] as &[u8], |c| c.row(y));
        let sure = sure.iter().copied().chain(core::iter::repeat(FULL));
        for (pixel, sure) in depth.row_mut(y).iter_mut().zip(sure) {
            let z = pixel.metres(unit);
            if z > 0.0 && !(z >= limits.min_z && z <= limits.max_z && sure >= limits.min_confidence) {
                *pixel = D::HOLE;
                removed += 1;
            }
        }
    }
    removed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::image::Image;

    #[test]
    fn levels_cover_the_byte() {
        assert_eq!([0, 1, 2, 3].map(|n| from_level(n, 2)), [0, 128, 255, 255]);
        assert_eq!([0, 1, 7, 15].map(|n| from_level(n, 15)), [0, 17, 119, 255]);
        assert_eq!([0, 1, 2, 4, 7].map(from_depth16), [255, 0, 36, 109, 219]);
    }

    #[test]
    fn limits_make_holes() {
        let mut depth = Image::<u16, 4, 1>::from_rows([[500, 1000, 9000, 0]]);
        let sure = Image::<u8, 4, 1>::from_rows([[255, 10, 255, 255]]);
        let limits = Limits { min_z: 0.1, max_z: 8.0, min_confidence: 128 };
        let n = apply_limits(&mut depth.view_mut(), DepthUnit::MILLIMETRE, Some(sure.view()), limits);
        assert_eq!(n, 2);
        assert_eq!(depth.as_slice(), &[500, 0, 0, 0]);
    }
}
