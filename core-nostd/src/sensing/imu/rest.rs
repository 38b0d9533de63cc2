//! Lies it still? And what does the gyroscope say while it does: its bias.
//!
//! The rest detection of VQF (Laidig and Seel 2023, section 3.5.1), usable alone. Rate and force are smoothed over half a second
//! ([`RestParams::smoothing`]); while neither is farther from its smoothed value than a threshold, and the smoothed rate is no faster than a bias can
//! be, a clock runs; at 1.5 s it is rest, and what the smoothed gyroscope then reads is its bias.
//!
//! [`RestBias`] is what a firmware with no use for an orientation runs: the detector and one scalar Kalman filter for the three axes (their variances
//! are the same at rest). It knows nothing while the device moves; [`Vqf`](super::Vqf) goes on learning then.
//!
//! Turning slower than the limit, evenly and about one axis (a turntable, a lift with a curve), looks like rest to any inertial sensor.
//!
//! Memory: detector 160 bytes at most, [`RestBias`] 256, held by a test. Cost: about 150 operations a reading. Error: of a bias
//! far from the one held, 2 % are left 1.5 s after rest is seen, 0.3 % after 10 s (the paper's parameters); then the sensor's noise averaged over half a second; a property test holds
//! 4e-4 rad/s.

use glam::Vec3;

use super::lowpass::{Gains, LowPass};
use super::step::{Stamps, Step};
use super::{ImuError, ImuSample, in_range, positive};
use crate::ground::math;

const DEGREE: f32 = core::f32::consts::PI / 180.0;

/// What counts as rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestParams {
    /// Seconds that it must last, above 0. Default 1.5.
    pub min_time: f32,
    /// Time constant of the smoothing, seconds, above 0. Default 0.5.
    pub smoothing: f32,
    /// The rate's distance from its smoothed value that is motion, rad/s, above 0. Default 2 degrees/s.
    pub max_rate: f32,
    /// The force's distance from its smoothed value that is motion, m/s^2, above 0. Default 0.5.
    pub max_force: f32,
    /// Largest bias of an axis, rad/s, above 0: a faster smoothed rate is motion. Default 2 degrees/s, as the paper's; cheap sensors before a first
    /// calibration may need 5 to 10.
    pub max_bias: f32,
}

impl RestParams {
    /// The paper's.
    pub const DEFAULT: Self =
        Self { min_time: 1.5, smoothing: 0.5, max_rate: 2.0 * DEGREE, max_force: 0.5, max_bias: 2.0 * DEGREE };

    pub(super) fn check(&self) -> Result<(), ImuError> {
        positive("min_time", self.min_time)?;
        positive("smoothing", self.smoothing)?;
        positive("max_rate", self.max_rate)?;
        positive("max_force", self.max_force)?;
        in_range("max_bias", self.max_bias, f32::MIN_POSITIVE, 10.0)
    }
}

impl Default for RestParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Sees whether a device lies still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestDetector {
    params: RestParams,
    filter: LowPass<8>,
    gains: Gains,
    rate: Vec3,
    still: f32,
}

impl RestDetector {
    /// A detector that has seen nothing.
    ///
    /// # Errors
    /// [`ImuError`] when a parameter is out of its range.
    pub fn new(params: RestParams) -> Result<Self, ImuError> {
        params.check()?;
        Ok(Self::of(params))
    }

    pub(super) const fn of(params: RestParams) -> Self {
        Self { params, filter: LowPass::NEW, gains: Gains::NONE, rate: Vec3::ZERO, still: 0.0 }
    }

    /// Takes a reading, `period` seconds (0 for the first) after the one before; says whether it is rest. A period that is no number of seconds from 0 on, or a reading
    /// that [`ImuSample::is_usable`] refuses, starts it anew.
    pub fn update(&mut self, rate: Vec3, force: Vec3, period: f32) -> bool {
        let sample = ImuSample { time: crate::ground::units::Timestamp::ZERO, rate, force, field: None };
        if !(period >= 0.0 && period.is_finite() && sample.is_usable()) {
            self.restart();
            return false;
        }
        self.step(rate, force, period)
    }

    /// As [`Self::update`], of what is known to be usable.
    #[inline]
    pub(super) fn step(&mut self, rate: Vec3, force: Vec3, period: f32) -> bool {
        let p = &self.params;
        self.gains.follow(period, p.smoothing);
        let input = [rate.x, rate.y, rate.z, 0.0, force.x, force.y, force.z, 0.0];
        let [x, y, z, _, fx, fy, fz, _] = self.filter.step(&input, &self.gains, p.smoothing);
        self.rate = Vec3::new(x, y, z);
        let moves = (rate - self.rate).length_squared() >= p.max_rate * p.max_rate
            || (force - Vec3::new(fx, fy, fz)).length_squared() >= p.max_force * p.max_force
            || !super::within(self.rate, p.max_bias);
        self.still = if moves { 0.0 } else { math::min(self.still + period, p.min_time) };
        self.is_at_rest()
    }

    /// Whether it lies still.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.still >= self.params.min_time
    }

    /// The smoothed rate, rad/s: at rest, the gyroscope's bias.
    #[must_use]
    pub const fn rate(&self) -> Vec3 {
        self.rate
    }

    /// Forgets what it saw: what comes next is far from what was.
    pub const fn restart(&mut self) {
        self.filter = LowPass::NEW;
        self.still = 0.0;
    }
}

/// The gyroscope's bias, learnt at rest alone.
///
/// ```
/// use isobath::glam::vec3;
/// use isobath::ground::units::Timestamp;
/// use isobath::sensing::imu::ImuSample;
/// use isobath::sensing::imu::rest::{RestBias, RestParams};
/// let mut bias = RestBias::new(RestParams::DEFAULT)?;
/// for i in 0..1200 {
///     let time = Timestamp::from_nanos(i * 5_000_000);
///     let noise = if i % 2 == 0 { 0.002 } else { -0.002 };
///     bias.update(&ImuSample { time, rate: vec3(0.01 + noise, 0.0, -0.02), force: vec3(0.0, 9.8, 0.0), field: None });
/// }
/// assert!(bias.is_at_rest());
/// assert!((bias.bias() - vec3(0.01, 0.0, -0.02)).length() < 3e-4);
/// # Ok::<(), isobath::sensing::imu::ImuError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestBias {
    detector: RestDetector,
    stamps: Stamps,
    bias: Vec3,
    variance: f32,
}

impl RestBias {
    /// Longest silence after which the detector goes on, seconds.
    const MAX_GAP: f32 = 0.2;
    /// What a bias is at first: standard deviation 0.5 degrees/s, the paper's.
    const START: f32 = 0.25 * DEGREE * DEGREE;
    /// How fast it wanders, rad^2/s^2 a second: from nothing to 0.1 degrees/s in 100 s, the paper's.
    const WANDER: f32 = 0.01 * DEGREE * DEGREE / 100.0;
    /// What a rest tells in the end: 0.03 degrees/s, the paper's.
    const REST: f32 = 0.0009 * DEGREE * DEGREE;

    /// An estimator that knows nothing.
    ///
    /// # Errors
    /// [`ImuError`] when a parameter is out of its range.
    pub fn new(params: RestParams) -> Result<Self, ImuError> {
        let detector = RestDetector::new(params)?;
        Ok(Self { detector, stamps: Stamps::NEW, bias: Vec3::ZERO, variance: Self::START })
    }

    /// Takes a reading; says what became of it.
    pub fn update(&mut self, sample: &ImuSample) -> Step {
        if !sample.is_usable() {
            return Step::Refused;
        }
        let step = self.stamps.step(sample.time, Self::MAX_GAP);
        match step {
            Step::Repeated | Step::Refused => {}
            Step::Forward(period) => {
                self.variance = math::min(self.variance + Self::WANDER * period, Self::START);
                if self.detector.step(sample.rate, sample.force, period) {
                    let wander = Self::WANDER * period;
                    let noise = if wander > 0.0 { Self::REST * Self::REST / wander + Self::REST } else { Self::START };
                    let gain = self.variance / (self.variance + noise);
                    self.bias += (self.detector.rate() - self.bias) * gain;
                    self.variance -= gain * self.variance;
                }
            }
            Step::First | Step::Gap(_) | Step::Backward => {
                if let Step::Gap(seconds) = step {
                    self.variance = math::min(self.variance + Self::WANDER * seconds, Self::START);
                }
                self.detector.restart();
                self.detector.step(sample.rate, sample.force, 0.0);
            }
        }
        step
    }

    /// The bias, rad/s: to be subtracted from readings. Zero before the first rest.
    #[must_use]
    pub const fn bias(&self) -> Vec3 {
        self.bias
    }

    /// Standard deviation of the bias on each axis, rad/s.
    #[must_use]
    pub fn sigma(&self) -> f32 {
        math::sqrt(self.variance)
    }

    /// Whether it lies still.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.detector.is_at_rest()
    }
}
