//! The delay between the gyroscope's stamps and the camera's, from how fast both turn.
//!
//! Two sensors on one device stamp by two clocks, or by one clock at two points of their pipelines: exposure, filters, buses and queues put milliseconds between a
//! camera's stamp and a gyroscope's for the same moment (Kalibr's `timeshift_cam_imu`, VINS-Mono's `td`). How fast the device turns is seen by both, and does not
//! depend on how one is mounted on the other: the delay is the shift at which the two speeds agree best, by cross-correlation (Mair, Fleps, Suppa, Burschka
//! 2011, "Spatio-temporal initialization for IMU to camera registration").
//!
//! Between two poses of the camera stands an angle. It is compared with the gyroscope's integral over the same time, shifted: nothing is differentiated, and the frame
//! rate's blur is in both. The correlation coefficient at steps of a few milliseconds, then at an eighth of that about the best, then a parabola through three: well below
//! a step.
//!
//! A reading of the gyroscope is taken as its mean since the one before, as [`Vqf`](super::Vqf) takes it; the offset is the one that the filter wants. For a sensor that samples points it
//! therefore holds half a period more than the pure delay.
//!
//! | answer | when |
//! |---|---|
//! | [`OffsetEstimate`] | one clear peak; with its standard deviation, from the peak's sharpness and the correlation that is missing |
//! | [`NoOffset::NoMotion`] | the speed hardly changes: every shift agrees |
//! | [`NoOffset::Ambiguous`] | two shifts agree as well (waving evenly) |
//! | [`NoOffset::Uncorrelated`], [`NoOffset::AtEdge`], [`NoOffset::TooFew`] | not of one device; shifted by more than was looked for; not enough yet |
//!
//! Gyroscope bias of 0.01 rad/s moves the answer by less than a tenth of a millisecond in a lively motion; take it off first where it is more
//! ([`ImuCalibration`](super::ImuCalibration), [`Vqf::bias`](super::Vqf::bias)). The offset goes into
//! [`ImuCalibration::new`](super::ImuCalibration::new), which applies it.
//!
//! Memory: 24 bytes a reading and 32 a pose, in the type (G = 1024 and C = 128, five seconds of 200 Hz and 30 fps: 28 kB). Cost: shifts x (G + C), about 0.3 million operations, when asked. Error:
//! under 1 ms at 30 fps and 200 Hz with a lively motion; a property test holds that.

use core::fmt;

use glam::{Quat, Vec3};
use heapless::Deque;

use super::{ImuError, ImuSample, in_range, positive};
use crate::ground::math;
use crate::ground::rotation;
use crate::ground::units::Timestamp;

/// What is looked for, and what is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetParams {
    /// Largest offset looked for, seconds either way, above 0 to 1. Default 0.1.
    pub reach: f32,
    /// Coarse step, seconds, 0.0005 to 0.1. Default 0.005. At most 400 steps are taken: a finer step than that is coarsened.
    pub step: f32,
    /// Least intervals between poses that must overlap with readings, 8 or more. Default 45: a second and a half at 30 fps.
    pub min_intervals: u16,
    /// Least standard deviation of the camera's speed, rad/s, above 0. Default 0.15: a hand that looks around has 0.5.
    pub min_motion: f32,
    /// Least correlation coefficient, 0 to 1. Default 0.8.
    pub min_correlation: f32,
    /// A second peak whose coefficient is nearer to the first's than this makes it ambiguous, 0 to 1. Default 0.03.
    pub min_lead: f32,
    /// Readings, or poses, farther apart than this say nothing of what is between, seconds, 0.001 to 10. Default 0.15.
    pub max_gap: f32,
}

impl OffsetParams {
    /// For a camera of 15 to 60 frames a second and a gyroscope of 100 or more readings.
    pub const DEFAULT: Self = Self {
        reach: 0.1,
        step: 0.005,
        min_intervals: 45,
        min_motion: 0.15,
        min_correlation: 0.8,
        min_lead: 0.03,
        max_gap: 0.15,
    };

    fn check(&self) -> Result<(), ImuError> {
        in_range("reach", self.reach, 1e-3, 1.0)?;
        in_range("step", self.step, 5e-4, 0.1)?;
        in_range("min_intervals", f32::from(self.min_intervals), 8.0, f32::MAX)?;
        positive("min_motion", self.min_motion)?;
        in_range("min_correlation", self.min_correlation, 0.0, 1.0)?;
        in_range("min_lead", self.min_lead, 0.0, 1.0)?;
        in_range("max_gap", self.max_gap, 1e-3, 10.0)
    }
}

impl Default for OffsetParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The offset found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetEstimate {
    /// To be added to the gyroscope's stamps so that they are the camera's, nanoseconds.
    pub nanos: i64,
    /// Its standard deviation, seconds: of errors that are independent from frame to frame.
    pub sigma: f32,
    /// Correlation coefficient there, -1 to 1.
    pub correlation: f32,
    /// The coefficient at the next best peak, -1 where there is none.
    pub runner_up: f32,
    /// Intervals between poses that counted.
    pub intervals: u16,
}

/// Why there is no offset.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum NoOffset {
    /// So few intervals between poses have readings for each shift.
    TooFew {
        /// That many.
        intervals: u16,
    },
    /// The camera's speed changes too little.
    NoMotion {
        /// Its standard deviation, rad/s.
        spread: f32,
    },
    /// The two speeds are alike at no shift.
    Uncorrelated {
        /// The best coefficient.
        correlation: f32,
    },
    /// They are most alike at the end of what was looked for.
    AtEdge {
        /// That end, nanoseconds.
        nanos: i64,
    },
    /// They are as alike at another shift.
    Ambiguous {
        /// The best, nanoseconds, and its coefficient.
        first: (i64, f32),
        /// The other.
        second: (i64, f32),
    },
}

impl fmt::Display for NoOffset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFew { intervals } => {
                write!(f, "only {intervals} intervals between poses have gyroscope readings; record longer")
            }
            Self::NoMotion { spread } => {
                write!(f, "the camera's speed varies by {spread:.3} rad/s only; turn the device back and forth")
            }
            Self::Uncorrelated { correlation } => write!(
                f,
                "the gyroscope and the camera do not turn alike (correlation {correlation:.2}); are they on one device, in one epoch?"
            ),
            Self::AtEdge { nanos } => write!(
                f,
                "the offset seems to be {:.0} ms or more; raise OffsetParams::reach, or bring the clocks into one epoch",
                *nanos as f64 * 1e-6
            ),
            Self::Ambiguous { first, second } => write!(
                f,
                "{:.1} ms and {:.1} ms fit alike ({:.3}, {:.3}); move less evenly",
                first.0 as f64 * 1e-6,
                second.0 as f64 * 1e-6,
                first.1,
                second.1
            ),
        }
    }
}

impl core::error::Error for NoOffset {}

/// A camera's orientation at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Look {
    time: Timestamp,
    rotation: Quat,
}

/// A gyroscope's reading.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Rate {
    time: Timestamp,
    rate: Vec3,
}

/// Sums of a correlation.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    n: u16,
    a: f64,
    b: f64,
    aa: f64,
    bb: f64,
    ab: f64,
}

impl Sums {
    fn add(&mut self, a: f32, b: f32) {
        let (a, b) = (f64::from(a), f64::from(b));
        self.n = self.n.saturating_add(1);
        self.a += a;
        self.b += b;
        self.aa += a * a;
        self.bb += b * b;
        self.ab += a * b;
    }

    /// Standard deviation of the camera's speed, and the coefficient.
    fn done(&self) -> (f32, f32) {
        let n = f64::from(self.n.max(1));
        let (va, vb) = (self.aa / n - self.a / n * (self.a / n), self.bb / n - self.b / n * (self.b / n));
        let cov = self.ab / n - self.a / n * (self.b / n);
        let both = math::sqrt_f64((va * vb).max(0.0));
        let r = if both > 1e-12 { cov / both } else { 0.0 };
        (math::sqrt_f64(va.max(0.0)) as f32, r as f32)
    }
}

/// Holds the last G readings and C poses; says the offset when asked.
///
/// ```
/// use isobath::glam::{Quat, Vec3};
/// use isobath::ground::units::Timestamp;
/// use isobath::sensing::imu::ImuSample;
/// use isobath::sensing::imu::offset::{OffsetParams, TimeOffset};
///
/// // A device that turns about z, faster and slower; its gyroscope's stamps are 12 ms late.
/// let angle = |t: f32| 0.5 * (3.1 * t).sin() + 0.2 * (8.3 * t + 1.0).sin();
/// let mut offset = TimeOffset::<1024, 128>::new(OffsetParams::DEFAULT)?;
/// for i in 0..800 {
///     let time = Timestamp::from_nanos(i * 5_000_000 + 12_000_000);
///     let t = i as f32 * 0.005;
///     let rate = Vec3::Z * (angle(t) - angle(t - 0.005)) / 0.005;
///     offset.imu(&ImuSample { time, rate, force: Vec3::ZERO, field: None });
/// }
/// for i in 0..120 {
///     offset.camera(Quat::from_rotation_z(angle(i as f32 / 30.0)), Timestamp::from_nanos(i * 1_000_000_000 / 30));
/// }
/// let found = offset.estimate()?;
/// assert!((found.nanos + 12_000_000).abs() < 200_000);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct TimeOffset<const G: usize, const C: usize> {
    params: OffsetParams,
    rates: Deque<Rate, G>,
    looks: Deque<Look, C>,
}

impl<const G: usize, const C: usize> TimeOffset<G, C> {
    /// An estimator that has seen nothing.
    ///
    /// # Errors
    /// [`ImuError`] when a parameter is out of its range.
    pub fn new(params: OffsetParams) -> Result<Self, ImuError> {
        const { assert!(G > 1 && C > 1, "an interval needs two readings and two poses") };
        params.check()?;
        Ok(Self { params, rates: Deque::new(), looks: Deque::new() })
    }

    /// Takes a reading of the gyroscope; the oldest goes when there is no room. One that is none is left out; a clock that runs backward empties the buffer.
    pub fn imu(&mut self, sample: &ImuSample) {
        if !sample.is_usable() || self.rates.back().is_some_and(|last| sample.time == last.time) {
            return;
        }
        if self.rates.back().is_some_and(|last| sample.time < last.time) {
            self.rates.clear();
        }
        if self.rates.is_full() {
            self.rates.pop_front();
        }
        let _ = self.rates.push_back(Rate { time: sample.time, rate: sample.rate });
    }

    /// Takes the camera's orientation (camera-to-world, unit length) at a time; as [`Self::imu`] otherwise.
    pub fn camera(&mut self, rotation: Quat, time: Timestamp) {
        let length = rotation::length(rotation);
        if !(0.99..=1.01).contains(&length) || self.looks.back().is_some_and(|last| time == last.time) {
            return;
        }
        if self.looks.back().is_some_and(|last| time < last.time) {
            self.looks.clear();
        }
        if self.looks.is_full() {
            self.looks.pop_front();
        }
        let _ = self.looks.push_back(Look { time, rotation });
    }

    /// Forgets what it saw.
    pub fn clear(&mut self) {
        self.rates.clear();
        self.looks.clear();
    }

    /// The offset by what is held now.
    ///
    /// # Errors
    /// [`NoOffset`]: why there is none.
    pub fn estimate(&self) -> Result<OffsetEstimate, NoOffset> {
        let p = &self.params;
        let steps = (math::ceil(p.reach / p.step) as i32).clamp(1, 200);
        let step = (f64::from(p.reach) * 1e9 / f64::from(steps)) as i64;
        let mut best = Peak { at: 0, r: f32::NEG_INFINITY, n: 0, spread: 0.0 };
        let (mut fewest, mut edge) = (u16::MAX, true);
        for i in -steps..=steps {
            let sums = self.correlate(i64::from(i) * step);
            fewest = fewest.min(sums.n);
            let (spread, r) = sums.done();
            if r > best.r {
                best = Peak { at: i64::from(i) * step, r, n: sums.n, spread };
                edge = i.abs() == steps;
            }
        }
        if fewest < p.min_intervals {
            return Err(NoOffset::TooFew { intervals: fewest });
        }
        if !(best.spread >= p.min_motion) {
            return Err(NoOffset::NoMotion { spread: best.spread });
        }
        if !(best.r >= p.min_correlation) {
            return Err(NoOffset::Uncorrelated { correlation: best.r });
        }
        if edge {
            return Err(NoOffset::AtEdge { nanos: best.at });
        }
        let second = self.second(&best, steps, step);
        if let Some((at, r)) = second
            && best.r - r < p.min_lead
        {
            return Err(NoOffset::Ambiguous { first: (best.at, best.r), second: (at, r) });
        }
        let (nanos, r, sharpness) = self.refine(&best, step);
        // Least squares: the variance of a shift is the noise's, over that of the speed's slope, over the intervals.
        let missing = math::max(1.0 - r * r, 1e-7);
        let sigma = math::sqrt(missing / (math::max(sharpness, 1e-3) * f32::from(best.n.max(1))));
        let runner_up = second.map_or(-1.0, |s| s.1);
        Ok(OffsetEstimate { nanos, sigma, correlation: r, runner_up, intervals: best.n })
    }

    /// The highest local maximum elsewhere than at the best.
    fn second(&self, best: &Peak, steps: i32, step: i64) -> Option<(i64, f32)> {
        let mut found: Option<(i64, f32)> = None;
        let (mut before, mut here) = (f32::NEG_INFINITY, f32::NEG_INFINITY);
        for i in -steps..=steps + 1 {
            let next = if i <= steps { self.correlate(i64::from(i) * step).done().1 } else { f32::NEG_INFINITY };
            let at = i64::from(i - 1) * step;
            if i > -steps && here > before && here >= next && at != best.at && found.is_none_or(|f| here > f.1) {
                found = Some((at, here));
            }
            (before, here) = (here, next);
        }
        found
    }

    /// Steps of an eighth about the best, then the parabola: the shift, its coefficient, and how fast the coefficient falls, 1/s^2 (the negative second
    /// derivative).
    fn refine(&self, best: &Peak, step: i64) -> (i64, f32, f32) {
        let fine = (step / 8).max(1);
        let mut top = (best.at, best.r);
        for i in -8..=8_i64 {
            let at = best.at.saturating_add(i * fine);
            let r = self.correlate(at).done().1;
            if r > top.1 {
                top = (at, r);
            }
        }
        // The parabola over a whole step, not an eighth: above the rounding of the coefficients.
        let half = (step / 2).max(1);
        let [left, right] = [-half, half].map(|d| self.correlate(top.0.saturating_add(d)).done().1);
        let bend = left - 2.0 * top.1 + right;
        if !(bend < 0.0) {
            return (top.0, top.1, 0.0);
        }
        let shift = math::clamp(0.5 * (left - right) / bend, -0.5, 0.5);
        let seconds = half as f32 * 1e-9;
        let r = math::min(top.1 - 0.25 * (left - right) * shift, 1.0);
        (top.0.saturating_add((shift * half as f32) as i64), r, -bend / (seconds * seconds))
    }

    /// Compares the camera's angles with the gyroscope's integral, its stamps moved by `offset` nanoseconds.
    fn correlate(&self, offset: i64) -> Sums {
        let gap = self.params.max_gap;
        let mut sums = Sums::default();
        let mut integral = Integral::new(self.rates.iter(), offset);
        let mut before: Option<(&Look, Option<Vec3>)> = None;
        for look in &self.looks {
            let now = integral.until(look.time, gap);
            if let Some((last, Some(_))) = before
                && let Some(turned) = now
            {
                let seconds = look.time.seconds_since(last.time);
                if seconds <= gap && seconds > 0.0 {
                    let camera = rotation::way(last.rotation, look.rotation).length() / seconds;
                    sums.add(camera, turned.length() / seconds);
                }
            }
            before = Some((look, now));
        }
        sums
    }
}

/// A shift and how well it fits.
#[derive(Debug, Clone, Copy)]
struct Peak {
    at: i64,
    r: f32,
    n: u16,
    spread: f32,
}

/// The gyroscope's integral from one time to a later one, over and over.
struct Integral<'a, I: Iterator<Item = &'a Rate>> {
    rates: I,
    offset: i64,
    /// The readings on both sides of where it stands: the next is the mean rate since the last.
    last: Option<Timestamp>,
    next: Option<(Timestamp, Vec3)>,
    /// Where it stands.
    at: Option<Timestamp>,
}

impl<'a, I: Iterator<Item = &'a Rate>> Integral<'a, I> {
    fn new(mut rates: I, offset: i64) -> Self {
        let last = None;
        let next = rates.next().map(|r| (r.time.saturating_add_nanos(offset), r.rate));
        Self { rates, offset, last, next, at: None }
    }

    fn advance(&mut self) {
        self.last = self.next.map(|n| n.0);
        self.next = self.rates.next().map(|r| (r.time.saturating_add_nanos(self.offset), r.rate));
    }

    /// From where it stood (see the call before) to `time`: `None` when readings do not reach there or leave a gap on the way. The first call only takes the place.
    fn until(&mut self, time: Timestamp, max_gap: f32) -> Option<Vec3> {
        let start = self.at;
        self.at = Some(time);
        let mut sum = Vec3::ZERO;
        let mut whole = true;
        // Readings before `time`: each ends a piece.
        while let Some((then, rate)) = self.next {
            if then > time {
                break;
            }
            if let Some(start) = start
                && then > start
            {
                match self.last {
                    Some(before) => {
                        whole &= then.seconds_since(before) <= max_gap;
                        let from = if before > start { before } else { start };
                        sum += rate * then.seconds_since(from);
                    }
                    None => whole = false,
                }
            }
            self.advance();
        }
        // The last piece, up to `time`.
        let (Some(last), Some(next)) = (self.last, self.next) else {
            // It ends exactly at the last reading, or the readings end before.
            return self.last.filter(|last| *last == time && whole).map(|_| sum);
        };
        whole &= next.0.seconds_since(last) <= max_gap;
        let from = start.map_or(time, |s| if last > s { last } else { s });
        sum += next.1 * time.seconds_since(from);
        whole.then_some(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::strategy::ValueTree;
    use std::vec::Vec;

    /// A motion by three angles of two sines each; its orientation in f64 by small steps.
    #[derive(Debug)]
    struct Motion {
        sines: [[(f64, f64, f64); 3]; 3],
    }

    impl Motion {
        fn rate(&self, t: f64) -> Vec3 {
            let r = self.sines.map(|axis| axis.iter().map(|(a, w, p)| a * (w * t + p).sin()).sum::<f64>());
            Vec3::new(r[0] as f32, r[1] as f32, r[2] as f32)
        }
    }

    fn lively() -> impl Strategy<Value = Motion> {
        let sine = (0.3_f64..1.0, 2.0_f64..9.0, 0.0_f64..6.3);
        proptest::array::uniform3(proptest::array::uniform3(sine)).prop_map(|sines| Motion { sines })
    }

    type Estimator = TimeOffset<1024, 128>;

    /// Four seconds; the gyroscope's stamps are `late`; noise of both.
    fn run(motion: &Motion, late: i64, gyro_noise: f32, look_noise: f32, seed: u64, mounting: Quat) -> Estimator {
        let mut state = seed | 1;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
        };
        let mut estimator = Estimator::new(OffsetParams::DEFAULT).unwrap();
        let mut q = Quat::IDENTITY;
        let frames: Vec<i64> = (0..125).map(|i| i * 1_000_000_000 / 30).collect();
        let mut next = 0;
        // Orientation by midpoints of 0.5 ms.
        for i in 0..8400_i64 {
            let t = i as f64 * 5e-4;
            let nanos = i * 500_000;
            if i % 10 == 0 {
                let noise = Vec3::new(random(), random(), random()) * gyro_noise;
                // The mean of the last 5 ms, by Simpson.
                let mean = (motion.rate(t - 0.005) + motion.rate(t - 0.0025) * 4.0 + motion.rate(t)) / 6.0;
                let rate = mean + noise;
                let time = Timestamp::from_nanos(nanos + late);
                estimator.imu(&ImuSample { time, rate, force: Vec3::ZERO, field: None });
            }
            if next < frames.len() && frames[next] < nanos + 500_000 {
                let within = (frames[next] - nanos) as f64 * 1e-9;
                let look = rotation::product(q, Quat::from_scaled_axis(motion.rate(t + within / 2.0) * within as f32));
                let noise = Vec3::new(random(), random(), random()) * look_noise;
                let look = rotation::product(rotation::product(look, Quat::from_scaled_axis(noise)), mounting);
                estimator.camera(look, Timestamp::from_nanos(frames[next]));
                next += 1;
            }
            q = rotation::unit(rotation::product(q, Quat::from_scaled_axis(motion.rate(t + 2.5e-4) * 5e-4)));
        }
        estimator
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn found_within_a_millisecond(motion in lively(), late in -80_000_000_i64..80_000_000, seed in any::<u64>()) {
            let mounting = Quat::from_xyzw(0.5, -0.5, 0.5, 0.5);
            let found = run(&motion, late, 0.01, 0.001, seed, mounting).estimate();
            match found {
                Ok(found) => {
                    prop_assert!((found.nanos + late).abs() < 1_000_000, "{:?} for {}", found, -late);
                    prop_assert!(found.sigma > 1e-6 && found.sigma < 2e-3, "{:?}", found);
                    prop_assert!(found.correlation > 0.95 && found.runner_up < found.correlation);
                }
                // Sines may repeat themselves within the reach; then it must say so rather than err.
                Err(NoOffset::Ambiguous { .. } | NoOffset::NoMotion { .. }) => {}
                Err(other) => prop_assert!(false, "{other}"),
            }
        }

        #[test]
        fn hostile_input_is_answered(
            calls in proptest::collection::vec((any::<bool>(), proptest::array::uniform4(any::<f32>()), any::<i64>(), any::<bool>()), 0..80),
            wild in any::<[f32; 4]>(),
        ) {
            let params = OffsetParams { reach: wild[0], step: wild[1], min_motion: wild[2], max_gap: wild[3], min_intervals: 8, ..OffsetParams::DEFAULT };
            let mut t = TimeOffset::<16, 8>::new(params).unwrap_or(TimeOffset::new(OffsetParams::DEFAULT).unwrap());
            let mut now = 0_i64;
            for (imu, v, at, step) in calls {
                now = if step { now.saturating_add(at.rem_euclid(30_000_000)) } else { at };
                let time = Timestamp::from_nanos(now);
                let [x, y, z, _] = v;
                if imu {
                    t.imu(&ImuSample { time, rate: Vec3::new(x, y, z), force: Vec3::ZERO, field: None });
                } else {
                    t.camera(rotation::unit(Quat::from_array(v)), time);
                }
            }
            if let Ok(e) = t.estimate() {
                prop_assert!(e.sigma.is_finite() && e.nanos.abs() <= 1_100_000_000);
            }
        }
    }

    #[test]
    fn most_lively_motions_are_answered_and_the_error_is_as_said() {
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let (mut answered, mut squares, mut worst) = (0, 0.0, 0.0_f64);
        for seed in 0..100 {
            let motion = lively().new_tree(&mut runner).unwrap().current();
            let late = (seed as i64 * 1_600_000) - 80_000_000;
            if let Ok(found) = run(&motion, late, 0.01, 0.001, seed, Quat::IDENTITY).estimate() {
                let off = (found.nanos + late) as f64 * 1e-9;
                worst = worst.max(off.abs());
                squares += (off / f64::from(found.sigma)).powi(2);
                answered += 1;
            }
        }
        let ratio = (squares / f64::from(answered)).sqrt();
        std::println!("answered {answered} of 100, worst {:.3} ms, error over sigma {ratio:.2}", worst * 1e3);
        assert!(answered >= 80 && worst < 1e-3 && (0.3..2.0).contains(&ratio));
    }

    #[test]
    fn what_tells_nothing_is_refused() {
        let still = Motion { sines: [[(0.0, 1.0, 0.0); 3]; 3] };
        let refused = |m: &Motion, late| run(m, late, 0.01, 0.001, 7, Quat::IDENTITY).estimate().unwrap_err();
        assert!(matches!(refused(&still, 0), NoOffset::NoMotion { .. }));
        // Turning evenly.
        let even = Motion {
            sines: [[(2.0, 0.0, 1.5), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)], [(0.0, 1.0, 0.0); 3], [(0.0, 1.0, 0.0); 3]],
        };
        assert!(matches!(refused(&even, 0), NoOffset::NoMotion { .. }));
        // Waving evenly at 8 Hz: the speed repeats 16 times a second.
        let wave = Motion {
            sines: [[(2.0, 50.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)], [(0.0, 1.0, 0.0); 3], [(0.0, 1.0, 0.0); 3]],
        };
        assert!(matches!(refused(&wave, 0), NoOffset::Ambiguous { .. }), "{:?}", refused(&wave, 0));
        // Off by more than is looked for.
        let slow = Motion {
            sines: [[(1.0, 2.0, 0.0), (0.6, 3.3, 1.0), (0.0, 1.0, 0.0)], [(0.4, 1.3, 0.5); 3], [(0.3, 2.1, 2.0); 3]],
        };
        assert!(
            matches!(refused(&slow, 130_000_000), NoOffset::AtEdge { .. } | NoOffset::Uncorrelated { .. }),
            "{:?}",
            refused(&slow, 130_000_000)
        );
        // Nothing, and two unlike motions.
        assert_eq!(Estimator::new(OffsetParams::DEFAULT).unwrap().estimate(), Err(NoOffset::TooFew { intervals: 0 }));
        let other = Motion {
            sines: [[(0.5, 7.0, 2.0), (0.9, 4.1, 4.0), (0.5, 8.5, 0.3)], [(0.7, 6.1, 3.5); 3], [(0.9, 5.1, 2.0); 3]],
        };
        let mut mixed = run(&slow, 0, 0.01, 0.001, 1, Quat::IDENTITY);
        mixed.looks = run(&other, 0, 0.01, 0.001, 1, Quat::IDENTITY).looks;
        assert!(matches!(mixed.estimate(), Err(NoOffset::Uncorrelated { .. })), "{:?}", mixed.estimate());
        mixed.clear();
        assert!(mixed.rates.is_empty() && mixed.looks.is_empty());
        for text in [
            NoOffset::TooFew { intervals: 3 },
            NoOffset::AtEdge { nanos: 100_000_000 },
            NoOffset::Ambiguous { first: (1, 0.9), second: (2, 0.9) },
        ] {
            assert!(std::format!("{text}").len() > 20);
        }
        assert!(Estimator::new(OffsetParams { reach: 2.0, ..OffsetParams::DEFAULT }).is_err());
    }
}
