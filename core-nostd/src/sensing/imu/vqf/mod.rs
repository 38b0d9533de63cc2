//! VQF: the orientation of an inertial sensor, from gyroscope and accelerometer, and from a magnetometer where there is one.
//!
//! D. Laidig, T. Seel, "VQF: Highly accurate IMU orientation estimation with bias estimation and magnetic disturbance rejection", Information Fusion 91
//! (2023) 187-204 (doi 10.1016/j.inffus.2022.10.014, arXiv 2203.17024), with all of its parts:
//!
//! | part | what it does |
//! |---|---|
//! | strapdown integration | the gyroscope, bias taken off, turns a frame that stands still but for drift |
//! | inclination | the force, turned into that frame, is gravity plus motion; a low-pass over 3 s **there** leaves gravity however the sensor turns; the frame is levelled by it |
//! | heading | the field in the levelled frame turns it to north, a separate angle, so that a magnet never tilts the horizon |
//! | bias | a Kalman filter learns it at rest, and in motion from the inclination's corrections |
//! | rejection | fields unlike the reference are left out |
//!
//! The frame that comes out has z up; with a magnetometer y is magnetic north (so x is east), without one the direction of x is whatever it was at the start and
//! drifts.
//!
//! # What differs from the paper, and why
//!
//! - All in `f32`. The low-pass has another form (the same transfer function) that keeps its digits; see `lowpass.rs`. Implementations keep theirs in `f64`.
//! - Periods come from the stamps of the readings, so jitter and single lost readings are integrated rightly; see [`Step`] for gaps and clocks that start
//!   anew: the orientation is kept, gravity is averaged anew, and bias is trusted less.
//! - A reading of the gyroscope is its mean since the one before (as sensors give it that average over their period), so sums of rate times period are exact angles; that
//!   turns about different axes do not add up is made good to second order from the reading before (Bortz 1971; Miller 1983: a twelfth of the cross product).
//! - Turns of a step below 0.5 rad use the Taylor series of sine and cosine, exact to `f32` rounding; the quaternion is brought back to length 1 by one Newton step.
//! - The Kalman filter takes its three measurements one after the other: the same estimate, no matrix inverse.
//! - [`Vqf::gravity`] has an uncertainty; the paper gives none. See [`Gravity::sigma`].
//!
//! Memory: 800 bytes at most, parameters included, held by a test. Cost: 1400 instructions a reading, 1900 with a field (x86-64, counted). Error, on two recordings of the authors'
//! BROAD set with an optical truth: see the README's figures; `cargo test -p isobath-tests --test imu -- --nocapture` prints them.

mod bias;
mod heading;

use glam::{Quat, Vec3};

pub use self::heading::MagneticParams;

use self::bias::Bias;
use self::heading::Heading;
use super::gravity::Gravity;
use super::lowpass::{Gains, LowPass};
use super::rest::{RestDetector, RestParams};
use super::step::{Stamps, Step};
use super::{ImuError, ImuSample, STANDARD_GRAVITY, in_range, positive};
use crate::ground::math;
use crate::ground::rotation::{product, rotate, rotate_back};
use crate::ground::units::Timestamp;

const DEGREE: f32 = core::f32::consts::PI / 180.0;

/// The paper's parameters, in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VqfParams {
    /// Time constant of gravity's low-pass, seconds, above 0. Default 3. Shorter follows tilts that the gyroscope misses, longer bears more shaking.
    pub time: f32,
    /// Whether bias is learnt in motion. Default true.
    pub motion_bias: bool,
    /// Whether bias is learnt at rest. Default true.
    pub rest_bias: bool,
    /// Standard deviation of the bias at first, rad/s, above 0. Default 0.5 degrees/s.
    pub bias_start: f32,
    /// Time in which an unobserved bias goes from certain to 0.1 degrees/s, seconds, above 0. Default 100.
    pub bias_time: f32,
    /// Standard deviation that motion leaves in the end, rad/s, above 0. Default 0.1 degrees/s.
    pub bias_motion: f32,
    /// How much less is learnt about the vertical in motion: 1e-10 to 1. Default 1e-4.
    pub bias_vertical: f32,
    /// Standard deviation that rest leaves in the end, rad/s, above 0. Default 0.03 degrees/s.
    pub bias_rest: f32,
    /// What counts as rest; its [`RestParams::max_bias`] bounds the bias altogether.
    pub rest: RestParams,
    /// How a magnetometer is believed.
    pub magnetic: MagneticParams,
    /// Longest silence that is integrated over, seconds, 1e-6 to 10. Default 0.2.
    pub max_gap: f32,
    /// Standard deviation of the accelerometer's own offset on each axis, m/s^2, 0 or more: it bounds how well gravity can be known. Default 0.05 (5 thousandths of g, a
    /// calibrated sensor; 0.3 for one that is not).
    pub force_error: f32,
}

impl VqfParams {
    /// The paper's.
    pub const DEFAULT: Self = Self {
        time: 3.0,
        motion_bias: true,
        rest_bias: true,
        bias_start: 0.5 * DEGREE,
        bias_time: 100.0,
        bias_motion: 0.1 * DEGREE,
        bias_vertical: 1e-4,
        bias_rest: 0.03 * DEGREE,
        rest: RestParams::DEFAULT,
        magnetic: MagneticParams::DEFAULT,
        max_gap: 0.2,
        force_error: 0.05,
    };

    fn check(&self) -> Result<(), ImuError> {
        positive("time", self.time)?;
        in_range("bias_start", self.bias_start, 1e-6, 10.0)?;
        positive("bias_time", self.bias_time)?;
        in_range("bias_motion", self.bias_motion, 1e-6, 10.0)?;
        in_range("bias_vertical", self.bias_vertical, 1e-10, 1.0)?;
        in_range("bias_rest", self.bias_rest, 1e-6, 10.0)?;
        in_range("max_gap", self.max_gap, 1e-6, 10.0)?;
        in_range("force_error", self.force_error, 0.0, 100.0)?;
        self.rest.check()?;
        self.magnetic.check()
    }
}

impl Default for VqfParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What a period makes of the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Noise {
    /// Growth of the bias's variance in a period, rad^2/s^2.
    wander: f32,
    /// Variance of a measurement in motion, horizontal; and at rest.
    motion: f32,
    rest: f32,
}

/// The filter.
///
/// ```
/// use isobath::glam::{Vec3, vec3};
/// use isobath::ground::units::Timestamp;
/// use isobath::sensing::imu::vqf::{Vqf, VqfParams};
/// use isobath::sensing::imu::{ImuSample, Step};
///
/// let mut filter = Vqf::new(VqfParams::DEFAULT)?;
/// // Held still, tilted by 30 degrees about x.
/// let force = vec3(0.0, 9.81 * 0.5, 9.81 * 0.866);
/// for i in 0..400 {
///     let step = filter.update(&ImuSample { time: Timestamp::from_nanos(i * 5_000_000), rate: Vec3::ZERO, force, field: None });
///     assert!(step.is_used());
/// }
/// let gravity = filter.gravity().expect("there were readings");
/// assert!(gravity.up.angle_between(force) < 1e-3);
/// // A reading that is none changes nothing.
/// let broken = ImuSample { time: Timestamp::ZERO, rate: vec3(f32::NAN, 0.0, 0.0), force, field: None };
/// assert_eq!(filter.update(&broken), Step::Refused);
/// # Ok::<(), isobath::sensing::imu::ImuError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vqf {
    params: VqfParams,
    stamps: Stamps,
    /// The rate of the last reading, bias included.
    rate: Vec3,
    /// From the sensor to the frame that the gyroscope alone holds; and from there to the levelled one.
    turned: Quat,
    level: Quat,
    rest: RestDetector,
    gains: Gains,
    noise: Noise,
    /// The force in the gyroscope's frame, m/s^2.
    force: LowPass<4>,
    /// The rotation matrix to the levelled frame by rows, and the horizontal part of the bias turned by it.
    rows: LowPass<12>,
    bias: Bias,
    heading: Heading,
    /// Gravity's low-pass, averaged over four times as long; and its mean square distance from that, across gravity, m^2/s^4: what it lets
    /// through of motion.
    slow: Option<Vec3>,
    shake: f32,
    /// The stamp of the last reading used.
    time: Option<Timestamp>,
}

impl Vqf {
    /// A filter that has seen nothing.
    ///
    /// # Errors
    /// [`ImuError`] when a parameter is out of its range.
    pub fn new(params: VqfParams) -> Result<Self, ImuError> {
        params.check()?;
        Ok(Self {
            params,
            stamps: Stamps::NEW,
            rate: Vec3::ZERO,
            turned: Quat::IDENTITY,
            level: Quat::IDENTITY,
            rest: RestDetector::of(params.rest),
            gains: Gains::NONE,
            noise: Noise { wander: 0.0, motion: 1.0, rest: 1.0 },
            force: LowPass::NEW,
            rows: LowPass::NEW,
            bias: Bias::new(Vec3::ZERO, params.bias_start * params.bias_start),
            heading: Heading::new(&params.magnetic),
            shake: 0.0,
            slow: None,
            time: None,
        })
    }

    /// Takes a reading; says what became of it. Call it for each, in order.
    pub fn update(&mut self, sample: &ImuSample) -> Step {
        if !sample.is_usable() {
            return Step::Refused;
        }
        let step = self.stamps.step(sample.time, self.params.max_gap);
        match step {
            Step::Repeated | Step::Refused => return step,
            Step::Forward(period) => self.forward(sample, period),
            Step::First | Step::Gap(_) | Step::Backward => {
                let silence = if let Step::Gap(seconds) = step { seconds } else { 0.0 };
                self.start(sample, silence);
            }
        }
        (self.rate, self.time) = (sample.rate, Some(sample.time));
        if let Some(field) = sample.usable_field() {
            let field = rotate(self.orientation(), field);
            self.heading.update(field, sample.time, self.rest.rate().length(), &self.params.magnetic);
        }
        step
    }

    /// A first reading, or one after a silence.
    #[cold]
    fn start(&mut self, sample: &ImuSample, silence: f32) {
        self.rest.restart();
        self.force = LowPass::NEW;
        self.rows = LowPass::NEW;
        self.heading.restart();
        (self.shake, self.slow) = (0.0, None);
        let limit = self.params.bias_start * self.params.bias_start;
        self.bias.wander(math::min(self.wander_of(silence), limit), limit);
        self.rest.step(sample.rate, sample.force, 0.0);
        self.gains.follow(0.0, self.params.time);
        self.levelled(sample.force);
        self.feed_rows();
    }

    fn forward(&mut self, sample: &ImuSample, period: f32) {
        if period != self.gains.period() {
            self.gains.follow(period, self.params.time);
            self.noise = self.noise_of(period);
        }
        let at_rest = self.rest.step(sample.rate, sample.force, period) && self.params.rest_bias;
        let turn = (sample.rate - self.bias.value) * period;
        let before = (self.rate - self.bias.value) * period;
        self.turned = turned_by(self.turned, turn + before.cross(turn) * (1.0 / 12.0));
        let correction = self.levelled(sample.force);
        let (rows, smooth) = self.feed_rows();
        self.bias.wander(self.noise.wander, self.params.bias_start * self.params.bias_start);
        let limit = self.params.rest.max_bias;
        let held = |off: [f32; 3]| off.map(|x| math::clamp(x, -limit, limit));
        if at_rest {
            let off = self.rest.rate() - self.bias.value;
            self.bias.learn([Vec3::X, Vec3::Y, Vec3::Z], held(off.to_array()), [self.noise.rest; 3]);
        } else if self.params.motion_bias {
            let b = self.bias.value;
            let [x, y, z] = rows;
            let off =
                [smooth.0 - correction.y / period - x.dot(b), smooth.1 + correction.x / period - y.dot(b), -z.dot(b)];
            let Noise { motion, .. } = self.noise;
            self.bias.learn(rows, held(off), [motion, motion, motion / self.params.bias_vertical]);
        }
        self.bias.value = Vec3::from_array(held(self.bias.value.to_array()));
    }

    /// Turns the levelled frame so that smoothed gravity is its z; gives the direction that was there before. A force of zero (free fall, or no
    /// accelerometer) says nothing.
    fn levelled(&mut self, force: Vec3) -> Vec3 {
        let Self { params, gains, .. } = self;
        if force == Vec3::ZERO {
            return Vec3::Z;
        }
        let Vec3 { x, y, z } = rotate(self.turned, force);
        let [x, y, z, _] = self.force.step(&[x, y, z, 0.0], gains, params.time);
        let smooth = Vec3::new(x, y, z);
        let squared = smooth.length_squared();
        // In free fall there is no direction; below a thousandth of g there is none that is worth it.
        if !(squared > 1e-4) {
            return Vec3::Z;
        }
        let inverse = math::inv_sqrt_fast(squared);
        let share = math::min(gains.period() / (4.0 * params.time), 1.0);
        let slow = self.slow.unwrap_or(smooth);
        let slow = slow + (smooth - slow) * share;
        self.slow = Some(slow);
        let off = smooth - slow;
        let across = math::max(off.length_squared() - square(off.dot(smooth) * inverse), 0.0);
        self.shake += (across - self.shake) * share;
        let gravity = rotate(self.level, smooth * inverse);
        self.level = steadied(shortest_to_z(gravity), self.level);
        gravity
    }

    /// The low-pass over the rotation and over the bias as it is seen through it.
    fn feed_rows(&mut self) -> ([Vec3; 3], (f32, f32)) {
        let [x, y, z] = rows_of(self.orientation());
        let b = self.bias.value;
        let input = [x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z, x.dot(b), y.dot(b), 0.0];
        let [a, b, c, d, e, f, g, h, i, j, k, _] = self.rows.step(&input, &self.gains, self.params.time);
        ([Vec3::new(a, b, c), Vec3::new(d, e, f), Vec3::new(g, h, i)], (j, k))
    }

    fn wander_of(&self, seconds: f32) -> f32 {
        square(0.1 * DEGREE) * seconds / self.params.bias_time
    }

    fn noise_of(&self, period: f32) -> Noise {
        let wander = math::max(self.wander_of(period), 1e-30);
        let settled = |sigma: f32| {
            let variance = sigma * sigma;
            math::min(variance * variance / wander + variance, 1e20)
        };
        Noise { wander, motion: settled(self.params.bias_motion), rest: settled(self.params.bias_rest) }
    }

    /// From the sensor's frame to the levelled one (z up), without a magnetometer: its heading is as at the start, and drifts.
    #[must_use]
    pub fn orientation(&self) -> Quat {
        product(self.level, self.turned)
    }

    /// From the sensor's frame to x east, y (magnetic) north, z up; `None` before the first reading with a field.
    #[must_use]
    pub fn orientation_north(&self) -> Option<Quat> {
        self.heading.seen.then(|| {
            let half = 0.5 * self.heading.angle;
            product(Quat::from_xyzw(0.0, 0.0, math::sin(half), math::cos(half)), self.orientation())
        })
    }

    /// [`Self::orientation`] at another time near the last reading's, as a frame's: turned on at the last rate. `None` before the first reading and when
    /// `time` is farther from it than [`VqfParams::max_gap`].
    #[must_use]
    pub fn orientation_at(&self, time: Timestamp) -> Option<Quat> {
        let ahead = time.seconds_since(self.time?);
        let turn = (self.rate - self.bias.value) * ahead;
        (ahead.abs() <= self.params.max_gap).then(|| turned_by(self.orientation(), turn))
    }

    /// Which way is up in the sensor's frame, and how surely; `None` before the first reading.
    #[must_use]
    pub fn gravity(&self) -> Option<Gravity> {
        self.time.map(|_| Gravity { up: rotate_back(self.orientation(), Vec3::Z), sigma: self.inclination_sigma() })
    }

    /// Standard deviation of the inclination, radians; infinite before the first reading. See [`Gravity::sigma`].
    #[must_use]
    pub fn inclination_sigma(&self) -> f32 {
        if self.time.is_none() {
            return f32::INFINITY;
        }
        // On both level axes.
        let sensor = core::f32::consts::SQRT_2 * self.params.force_error / STANDARD_GRAVITY;
        // The low-pass lags by its time constant, in which an unknown bias turns the frame.
        let drift = self.bias.sigma() * self.params.time;
        // A first reading is off by a calm hand's 1 m/s^2; the mean forgets it.
        let start = 0.1 * (1.0 - math::min(self.force.settled(self.params.time), 1.0));
        let shake = self.shake / (STANDARD_GRAVITY * STANDARD_GRAVITY);
        math::sqrt(square(sensor) + square(drift) + square(start) + shake)
    }

    /// The gyroscope's bias, rad/s.
    #[must_use]
    pub const fn bias(&self) -> Vec3 {
        self.bias.value
    }

    /// Standard deviation of the bias on the axis known worst, rad/s.
    #[must_use]
    pub fn bias_sigma(&self) -> f32 {
        self.bias.sigma()
    }

    /// Starts from a bias that was stored, with its standard deviation (held between 1e-6 rad/s and [`VqfParams::bias_start`]); one that is not finite is
    /// left out, one beyond [`RestParams::max_bias`] held there.
    pub fn set_bias(&mut self, bias: Vec3, sigma: f32) {
        let limit = self.params.rest.max_bias;
        if bias.is_finite() && sigma >= 0.0 {
            let value = Vec3::from_array(bias.to_array().map(|x| math::clamp(x, -limit, limit)));
            let sigma = math::clamp(sigma, 1e-6, self.params.bias_start);
            self.bias = Bias::new(value, sigma * sigma);
        }
    }

    /// Whether the device lies still.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.rest.is_at_rest()
    }

    /// Whether the magnetic field is unlike the reference, or there is no reference yet.
    #[must_use]
    pub const fn is_field_disturbed(&self) -> bool {
        self.heading.disturbed
    }
}

const fn square(x: f32) -> f32 {
    x * x
}

/// `q` after a turn by axis times angle (radians) in its own frame.
#[inline]
fn turned_by(q: Quat, turn: Vec3) -> Quat {
    let squared = 0.25 * turn.length_squared();
    let (sinc, cos) = if squared < 0.0625 {
        // Half the angle is below 1/4: what follows in the series is below 3e-9.
        (
            1.0 - squared * (1.0 / 6.0 - squared * (1.0 / 120.0 - squared * (1.0 / 5040.0))),
            1.0 - squared * (0.5 - squared * (1.0 / 24.0 - squared * (1.0 / 720.0))),
        )
    } else {
        let half = math::sqrt(squared);
        (math::sin(half) / half, math::cos(half))
    };
    let v = turn * (0.5 * sinc);
    let scale = newton(q);
    let q = Quat::from_xyzw(q.x * scale, q.y * scale, q.z * scale, q.w * scale);
    product(q, Quat::from_xyzw(v.x, v.y, v.z, cos))
}

/// `turn` after `q`, with what `q` has lost of its length given back.
#[inline]
fn steadied(turn: Quat, q: Quat) -> Quat {
    let scale = newton(q);
    product(turn, Quat::from_xyzw(q.x * scale, q.y * scale, q.z * scale, q.w * scale))
}

/// What brings a quaternion back to length 1 whose length is 1 but for rounding: one Newton step, no root. Taken from the quaternion before a product, so that
/// the two don't wait for each other; what the product rounds is left for the next.
#[inline]
fn newton(q: Quat) -> f32 {
    1.5 - 0.5 * (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
}

/// The shortest turn of a unit vector to z: (1 + z, y, -x, 0), made unit.
#[inline]
fn shortest_to_z(v: Vec3) -> Quat {
    let w = 1.0 + v.z;
    let squared = v.x * v.x + v.y * v.y + w * w;
    // Nearly always it is near z: then 1 / sqrt(4 (1 - e)) is a short series.
    let e = 1.0 - 0.25 * squared;
    let inverse = if e.abs() < 0.01 {
        0.5 + e * (0.25 + e * (0.1875 + e * 0.15625))
    } else if squared > 1e-10 {
        math::inv_sqrt(squared)
    } else {
        // Straight down: half a turn about any level axis.
        return Quat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    };
    Quat::from_xyzw(v.y * inverse, -v.x * inverse, 0.0, w * inverse)
}

/// The rows of a unit quaternion's rotation matrix.
#[inline]
fn rows_of(q: Quat) -> [Vec3; 3] {
    let [x, y, z, w] = q.to_array();
    [
        Vec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        Vec3::new(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        Vec3::new(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    ]
}

#[cfg(test)]
mod tests;
