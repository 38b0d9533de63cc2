//! How large an error to expect of a reading: the error bar's source.
//!
//! sigma(z) = constant + linear z + quadratic z^2, and for integer depth the unit's rounding (unit / sqrt 12) added in squares.
//! Triangulating sensors (structured light, stereo) grow with z^2, time of flight roughly with z.

use crate::ground::math;
use crate::sensing::depth::{DepthSample, DepthUnit};

/// Standard deviation of depth as a polynomial of depth.
///
/// ```
/// use isobath::sensing::depth::{noise::DepthNoise, DepthUnit};
/// let sigma = DepthNoise::KINECT.sigma::<u16>(2.0, DepthUnit::MILLIMETRE);
/// assert!((sigma - 0.0057).abs() < 1e-4); // 5.7 mm at 2 m
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthNoise {
    /// Metres.
    pub constant: f32,
    /// Metres per metre.
    pub linear: f32,
    /// Metres per metre squared.
    pub quadratic: f32,
}

impl DepthNoise {
    /// No noise but the unit's rounding.
    pub const NONE: Self = Self { constant: 0.0, linear: 0.0, quadratic: 0.0 };
    /// Structured light as in Kinect v1: 1.425e-3 z^2 (Khoshelham and Elberink 2012, doi 10.3390/s120201437).
    pub const KINECT: Self = Self { constant: 0.0, linear: 0.0, quadratic: 1.425e-3 };
    /// A typical phone or headset time-of-flight sensor: 2 mm and 0.5 % of depth.
    pub const TIME_OF_FLIGHT: Self = Self { constant: 0.002, linear: 0.005, quadratic: 0.0 };

    /// Standard deviation in metres at depth `z` metres, of depth held as `D` in `unit`.
    #[must_use]
    pub fn sigma<D: DepthSample>(&self, z: f32, unit: DepthUnit) -> f32 {
        math::sqrt(self.variance::<D>(z, unit))
    }

    /// The square of [`Self::sigma`], metres squared; plain arithmetic, for loops.
    #[inline(always)]
    #[must_use]
    pub fn variance<D: DepthSample>(&self, z: f32, unit: DepthUnit) -> f32 {
        let model = self.constant + z * (self.linear + z * self.quadratic);
        let rounding = unit.metres() * D::ROUNDING;
        model * model + rounding * rounding
    }

    /// Variance of inverse depth around `w`, both in inverse units (1 / value): dw = w² dz / unit; never below what `f32`
    /// itself rounds. Plain arithmetic, for loops.
    #[inline(always)]
    #[must_use]
    pub(crate) fn inverse_variance<D: DepthSample>(&self, w: f32, unit: DepthUnit) -> f32 {
        let per_metre = w * w / unit.metres();
        let floor = 3e-7 * w;
        self.variance::<D>(unit.metres() / w, unit) * per_metre * per_metre + floor * floor
    }
}

impl Default for DepthNoise {
    /// [`Self::KINECT`]: the cautious choice when the sensor is unknown.
    fn default() -> Self {
        Self::KINECT
    }
}
