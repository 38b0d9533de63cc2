//! The One-Euro filter: how to still a jittering value without making it lag.
//!
//! Casiez, Roussel, Vogel 2012, "1€ Filter" (doi 10.1145/2207676.2208639), which DepthLab uses to calm its avatar. A
//! first-order low-pass whose cutoff grows with speed: slow motion is smoothed, fast motion is followed.
//!
//! ```text
//! dx     = (x - x^prev) / Te                      0 for the first sample
//! dx^    = dx^prev + a(dcutoff) (dx - dx^prev)
//! cutoff = mincutoff + beta |dx^|
//! x^     = x^prev + a(cutoff) (x - x^prev)        a(fc) = 1 / (1 + tau / Te), tau = 1 / (2 pi fc)
//! ```
//!
//! One filter for three signals: `f32`; [`Vec3`], where |dx^| is the length of the velocity, so the result does not depend
//! on the axes; [`Quat`], where dx is the angular velocity (rad/s) of the shorter way and the last line a step along it.
//!
//! Memory: 48 bytes for `f32`, 72 for `Vec3`, at most 96 for `Quat` (glam aligns it to 16 on hosts), parameters included. Cost: about 10 operations, plus 4
//! trigonometric calls for `Quat`. Error against the formula in `f64`: under 1e-5 of the largest value, held by a test.
//!
//! # Time
//!
//! | step since the last sample | what happens |
//! |---|---|
//! | forward | the formula with the true Te, so a changing frame rate keeps its cutoff in Hz |
//! | none | the held value is returned and nothing changes: the formula's limit, a = 0 |
//! | backward | starts again from the sample: the source was restarted, old state means nothing |
//! | above [`OneEuroParams::max_gap`] | starts again from the sample |
//!
//! # Far values and fast sensors
//!
//! At 1 kHz a cutoff of 1 Hz takes 0.6 % of the way at a time. Ten kilometres from the origin, where `f32` steps are 1 mm, that
//! is lost to rounding until the way is 8 cm: a plain filter sticks there. What a step loses is therefore kept and added to
//! the next (not for [`Quat`], which sticks within 6e-8 / a radians: 1e-5 at 1 kHz).
//!
//! A sample that is not finite is left out: the held value is returned and nothing changes.

use core::f32::consts::TAU;
use core::fmt;

use glam::{Quat, Vec3};

use crate::ground::rotation;
use crate::ground::units::Timestamp;

/// The three numbers of the paper, and when to start anew.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneEuroParams {
    /// Cutoff at rest, Hz, above 0. Default 1. Lower: stiller and slower.
    pub min_cutoff: f32,
    /// Cutoff gained per unit of speed (Hz per m/s, or per rad/s), 0 or more. Default 0: tune to the signal's unit. Higher:
    /// less lag in motion.
    pub beta: f32,
    /// Cutoff of the speed estimate, Hz, above 0. Default 1, the paper's fixed value.
    pub derivative_cutoff: f32,
    /// Longest silence in seconds after which old state still counts, above 0 (infinite is legal: the plain formula).
    /// Default 1.
    pub max_gap: f32,
}

impl OneEuroParams {
    /// The paper's starting point for tuning.
    pub const DEFAULT: Self = Self { min_cutoff: 1.0, beta: 0.0, derivative_cutoff: 1.0, max_gap: 1.0 };
}

impl Default for OneEuroParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A parameter out of its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneEuroError {
    /// The field at fault.
    pub name: &'static str,
    /// What it was.
    pub value: f32,
}

impl fmt::Display for OneEuroError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "One-Euro filter: {} = {} is not usable; cutoffs (Hz) must be above 0 and finite, beta 0 or more and finite, max_gap (s) above 0",
            self.name, self.value
        )
    }
}

impl core::error::Error for OneEuroError {}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for glam::Vec3 {}
    impl Sealed for glam::Quat {}
}

/// What the filter can smooth: `f32`, [`Vec3`] and [`Quat`].
pub trait Signal: Copy + fmt::Debug + PartialEq + sealed::Sealed {
    /// Its rate of change: units, or radians about each axis, per second.
    type Rate: Copy + fmt::Debug + PartialEq;
    /// No change.
    const STILL: Self::Rate;

    /// The sample made usable; `None` when it can't be.
    fn sane(self) -> Option<Self>;
    /// The way from `self` to `to`.
    fn way(self, to: Self) -> Self::Rate;
    /// `self` moved by a step, and what of the step rounding left undone.
    fn moved(self, step: Self::Rate) -> (Self, Self::Rate);
    /// `from + share (scale way - from)`.
    fn blend(from: Self::Rate, way: Self::Rate, scale: f32, share: f32) -> Self::Rate;
    /// `a + share b`.
    fn add_scaled(a: Self::Rate, b: Self::Rate, share: f32) -> Self::Rate;
    /// How much a rate is.
    fn size(rate: Self::Rate) -> f32;
}

/// Signals that add up: the way is the difference.
macro_rules! additive {
    ($signal:ty, still: $still:expr, size: $size:ident) => {
        impl Signal for $signal {
            type Rate = Self;
            const STILL: Self = $still;

            fn sane(self) -> Option<Self> {
                self.is_finite().then_some(self)
            }
            fn way(self, to: Self) -> Self {
                to - self
            }
            fn moved(self, step: Self) -> (Self, Self) {
                let there = self + step;
                (there, step - (there - self))
            }
            fn blend(from: Self, way: Self, scale: f32, share: f32) -> Self {
                from + (way * scale - from) * share
            }
            fn add_scaled(a: Self, b: Self, share: f32) -> Self {
                a + b * share
            }
            fn size(rate: Self) -> f32 {
                rate.$size()
            }
        }
    };
}

additive!(f32, still: 0.0, size: abs);
additive!(Vec3, still: Self::ZERO, size: length);

impl Signal for Quat {
    type Rate = Vec3;
    const STILL: Vec3 = Vec3::ZERO;

    fn sane(self) -> Option<Self> {
        let length = rotation::length(self);
        // Also refuses NaN; a quaternion far from unit length is no orientation.
        ((length - 1.0).abs() <= 0.1).then(|| rotation::unit(self))
    }
    fn way(self, to: Self) -> Vec3 {
        rotation::way(self, to)
    }
    fn moved(self, step: Vec3) -> (Self, Vec3) {
        (rotation::turned(self, step), Vec3::ZERO)
    }
    fn blend(from: Vec3, way: Vec3, scale: f32, share: f32) -> Vec3 {
        <Vec3 as Signal>::blend(from, way, scale, share)
    }
    fn add_scaled(a: Vec3, b: Vec3, share: f32) -> Vec3 {
        a + b * share
    }
    fn size(rate: Vec3) -> f32 {
        rate.length()
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct State<T: Signal> {
    value: T,
    /// What rounding has left out of `value` so far.
    rest: T::Rate,
    rate: T::Rate,
    time: Timestamp,
}

/// The filter of one signal.
///
/// ```
/// use isobath::ground::units::Timestamp;
/// use isobath::localized::one_euro::{OneEuro, OneEuroParams};
/// let mut filter = OneEuro::<f32>::new(OneEuroParams { min_cutoff: 1.0, beta: 0.0, ..Default::default() })?;
/// assert_eq!(filter.filter(1.0, Timestamp::from_nanos(0)), 1.0);
/// // 1 / (1 + tau / Te) with tau = 1 / 2 pi, Te = 0.1 s: 38.6 % of the step.
/// let x = filter.filter(2.0, Timestamp::from_nanos(100_000_000));
/// assert!((x - 1.3859).abs() < 1e-3);
/// # Ok::<(), isobath::localized::one_euro::OneEuroError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneEuro<T: Signal> {
    params: OneEuroParams,
    state: Option<State<T>>,
}

impl<T: Signal> OneEuro<T> {
    /// A filter that has seen nothing.
    ///
    /// # Errors
    /// [`OneEuroError`] when a parameter is out of its range.
    pub const fn new(params: OneEuroParams) -> Result<Self, OneEuroError> {
        // Negated, so that NaN fails too.
        if !(params.min_cutoff > 0.0 && params.min_cutoff.is_finite()) {
            return Err(OneEuroError { name: "min_cutoff", value: params.min_cutoff });
        }
        if !(params.beta >= 0.0 && params.beta.is_finite()) {
            return Err(OneEuroError { name: "beta", value: params.beta });
        }
        if !(params.derivative_cutoff > 0.0 && params.derivative_cutoff.is_finite()) {
            return Err(OneEuroError { name: "derivative_cutoff", value: params.derivative_cutoff });
        }
        if !(params.max_gap > 0.0) {
            return Err(OneEuroError { name: "max_gap", value: params.max_gap });
        }
        Ok(Self { params, state: None })
    }

    /// Takes the sample of a time and returns the filtered value; see the module for time that stands still, runs back or
    /// jumps. When nothing usable was ever seen, an unusable sample comes back as it is.
    pub fn filter(&mut self, sample: T, time: Timestamp) -> T {
        let Some(x) = sample.sane() else {
            return self.value().unwrap_or(sample);
        };
        let Some(last) = self.state else {
            return self.start(x, time);
        };
        let te = time.seconds_since(last.time);
        if te == 0.0 {
            return last.value;
        }
        if !(te > 0.0 && te <= self.params.max_gap) {
            return self.start(x, time);
        }
        // From where the value would be without rounding.
        let way = T::add_scaled(last.value.way(x), last.rest, -1.0);
        let rate = T::blend(last.rate, way, 1.0 / te, alpha(self.params.derivative_cutoff, te));
        let cutoff = self.params.min_cutoff + self.params.beta * T::size(rate);
        let (value, rest) = last.value.moved(T::add_scaled(last.rest, way, alpha(cutoff, te)));
        // Values at the end of f32's range overflow in the difference: begin anew rather than hold NaN for ever.
        let (Some(value), true) = (value.sane(), T::size(rate).is_finite()) else {
            return self.start(x, time);
        };
        self.state = Some(State { value, rest, rate, time });
        value
    }

    /// The last filtered value.
    #[must_use]
    pub fn value(&self) -> Option<T> {
        self.state.map(|s| s.value)
    }

    /// The time of the last sample that counted.
    #[must_use]
    pub fn time(&self) -> Option<Timestamp> {
        self.state.map(|s| s.time)
    }

    /// The smoothed rate of change: units (m, rad) per second.
    #[must_use]
    pub fn rate(&self) -> Option<T::Rate> {
        self.state.map(|s| s.rate)
    }

    /// The parameters.
    #[must_use]
    pub const fn params(&self) -> &OneEuroParams {
        &self.params
    }

    /// Forgets what it saw.
    pub const fn reset(&mut self) {
        self.state = None;
    }

    fn start(&mut self, value: T, time: Timestamp) -> T {
        self.state = Some(State { value, rest: T::STILL, rate: T::STILL, time });
        value
    }
}

/// The share of a step that a low-pass of cutoff `cutoff` (Hz) takes in `te` seconds: 1 / (1 + tau / Te).
#[inline]
#[must_use]
pub fn alpha(cutoff: f32, te: f32) -> f32 {
    // The same quotient without the inner division; for a cutoff so high that it overflows, all of the step.
    let r = TAU * cutoff * te;
    if r.is_finite() { r / (1.0 + r) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::math;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// The paper's pseudo-code, letter by letter, in f64.
    struct Published {
        first: bool,
        mincutoff: f64,
        beta: f64,
        dcutoff: f64,
        xfilt: LowPass,
        dxfilt: LowPass,
    }
    struct LowPass {
        first: bool,
        hatxprev: f64,
    }
    impl LowPass {
        fn filter(&mut self, x: f64, alpha: f64) -> f64 {
            if self.first {
                self.first = false;
                self.hatxprev = x;
            }
            let hatx = alpha * x + (1.0 - alpha) * self.hatxprev;
            self.hatxprev = hatx;
            hatx
        }
    }
    impl Published {
        fn new(mincutoff: f64, beta: f64, dcutoff: f64) -> Self {
            let low = || LowPass { first: true, hatxprev: 0.0 };
            Self { first: true, mincutoff, beta, dcutoff, xfilt: low(), dxfilt: low() }
        }
        fn alpha(rate: f64, cutoff: f64) -> f64 {
            let tau = 1.0 / (2.0 * core::f64::consts::PI * cutoff);
            let te = 1.0 / rate;
            1.0 / (1.0 + tau / te)
        }
        fn filter(&mut self, x: f64, rate: f64) -> f64 {
            let dx = if self.first { 0.0 } else { (x - self.xfilt.hatxprev) * rate };
            self.first = false;
            let edx = self.dxfilt.filter(dx, Self::alpha(rate, self.dcutoff));
            let cutoff = self.mincutoff + self.beta * edx.abs();
            self.xfilt.filter(x, Self::alpha(rate, cutoff))
        }
    }

    fn params(min_cutoff: f32, beta: f32, derivative_cutoff: f32) -> OneEuroParams {
        OneEuroParams { min_cutoff, beta, derivative_cutoff, ..Default::default() }
    }

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(seconds).unwrap()
    }

    proptest! {
        #[test]
        fn equals_the_published_pseudo_code(
            p in (0.05_f32..10.0, 0.0_f32..5.0, 0.1_f32..5.0),
            // Speeds a tracker meets, up to 20 units a second either way. (f32 keeps seven digits of the value, 5e-7 here: over a
            // millisecond that is an error of 1e-3 a second in the rate, which moves the cutoff, and with a lag of some units
            // behind it up to 1e-4 in the value. 3e-5 was seen.)
            samples in proptest::collection::vec((-20.0_f32..20.0, 1_000_000_i64..500_000_000), 1..200),
        ) {
            let mut ours = OneEuro::new(params(p.0, p.1, p.2)).unwrap();
            let mut published = Published::new(p.0.into(), p.1.into(), p.2.into());
            // An epoch far away: time differences must not lose bits.
            let mut nanos = 1_700_000_000_000_000_000_i64;
            let mut x = 0.0_f32;
            for (speed, step) in samples {
                nanos += step;
                x = (x + speed * (step as f32 * 1e-9)).clamp(-10.0, 10.0);
                let want = published.filter(x.into(), 1e9 / step as f64);
                let got = ours.filter(x, Timestamp::from_nanos(nanos));
                prop_assert!((f64::from(got) - want).abs() < 1e-4, "{got} {want}");
            }
        }

        #[test]
        fn vectors_do_not_depend_on_the_axes(
            samples in proptest::collection::vec(proptest::array::uniform3(-3.0_f32..3.0), 1..50),
            turn in -3.0_f32..3.0,
        ) {
            let q = Quat::from_rotation_x(turn) * Quat::from_rotation_z(0.4);
            let mut plain = OneEuro::new(params(1.0, 0.5, 1.0)).unwrap();
            let mut turned = plain;
            for (i, s) in samples.iter().enumerate() {
                let s = Vec3::from(*s);
                let t = at(i as f64 / 30.0);
                let (a, b) = (plain.filter(s, t), turned.filter(q * s, t));
                prop_assert!((q * a - b).length() < 1e-4);
            }
        }

        #[test]
        fn hostile_input_keeps_the_state_finite(
            samples in proptest::collection::vec((any::<f32>(), any::<i64>()), 0..50),
            p in (any::<f32>(), any::<f32>(), any::<f32>(), any::<f32>()),
        ) {
            let p = OneEuroParams { min_cutoff: p.0.abs(), beta: p.1.abs(), derivative_cutoff: p.2.abs(), max_gap: p.3.abs() };
            if let (Ok(mut f), Ok(mut v), Ok(mut q)) = (OneEuro::new(p), OneEuro::new(p), OneEuro::new(p)) {
                for (x, t) in samples {
                    let t = Timestamp::from_nanos(t);
                    let _ = f.filter(x, t);
                    let _ = v.filter(Vec3::new(x, 1.0, -x), t);
                    let _ = q.filter(Quat::from_xyzw(x, 0.1, 0.2, 1.0), t);
                    prop_assert!(f.value().is_none_or(f32::is_finite));
                    prop_assert!(v.value().is_none_or(Vec3::is_finite));
                    prop_assert!(q.value().is_none_or(|q| q.is_finite() && q.is_normalized()));
                }
            }
        }
    }

    #[test]
    fn along_one_axis_a_vector_is_a_number_and_a_turn_an_angle() {
        let p = params(0.8, 0.7, 1.0);
        let (mut f, mut v, mut q) = (OneEuro::new(p).unwrap(), OneEuro::new(p).unwrap(), OneEuro::new(p).unwrap());
        for i in 0..100 {
            let x = math::sin(i as f32 * 0.21) * 0.9 + math::sin(i as f32 * 1.7) * 0.1;
            let t = at(f64::from(i) / 45.0);
            let a = f.filter(x, t);
            assert!((v.filter(Vec3::Y * x, t).y - a).abs() < 1e-6);
            // The other sign of the same orientation must change nothing.
            let sample = Quat::from_rotation_y(x) * if i % 3 == 0 { -1.0 } else { 1.0 };
            let angle = Quat::IDENTITY.way(q.filter(sample, t)).y;
            assert!((angle - a).abs() < 1e-5, "{angle} {a}");
        }
    }

    /// A 10 ms step of a low-pass is not ten 1 ms steps exactly (the paper's alpha is the backward Euler form), but the
    /// time constant must be the same: with the rate ignored, 90 Hz would settle three times faster than 30 Hz.
    #[test]
    fn the_answer_hardly_depends_on_the_frame_rate() {
        let after = |rate: u32| {
            let mut filter = OneEuro::new(params(0.5, 0.0, 1.0)).unwrap();
            let mut last = filter.filter(0.0, at(0.0));
            for i in 1..=rate / 2 {
                last = filter.filter(1.0, at(f64::from(i) / f64::from(rate)));
            }
            last
        };
        let exact = 1.0 - math::exp(-0.5 * TAU * 0.5);
        let answers: Vec<f32> = [30, 60, 90, 240].into_iter().map(after).collect();
        for a in &answers {
            assert!((a - exact).abs() < 0.02, "{answers:?} {exact}");
        }
        assert!((after(240) - exact).abs() < (after(30) - exact).abs());
    }

    #[test]
    fn time_that_stands_runs_back_or_jumps() {
        let mut f = OneEuro::new(params(1.0, 0.0, 1.0)).unwrap();
        assert!(f.filter(f32::NAN, at(0.0)).is_nan());
        f.filter(1.0, at(1.0));
        let b = f.filter(2.0, at(1.1));
        let before = f;
        assert_eq!(f.filter(100.0, at(1.1)), b, "no time, no change");
        assert_eq!(f.filter(f32::INFINITY, at(1.2)), b, "no number, no change");
        assert_eq!(f, before);
        assert_eq!(f.filter(5.0, at(0.5)), 5.0, "backward: anew");
        assert_eq!(f.rate(), Some(0.0));
        assert!(f.filter(6.0, at(1.5)) < 6.0, "exactly the gap still counts");
        assert_eq!(f.filter(7.0, at(2.6)), 7.0, "beyond the gap: anew");
        f.reset();
        assert_eq!(f.value(), None);
    }

    #[test]
    fn impossible_parameters_are_refused() {
        for (p, name) in [
            (params(0.0, 0.0, 1.0), "min_cutoff"),
            (params(f32::INFINITY, 0.0, 1.0), "min_cutoff"),
            (params(1.0, -1.0, 1.0), "beta"),
            (params(1.0, f32::NAN, 1.0), "beta"),
            (params(1.0, 0.0, 0.0), "derivative_cutoff"),
            (OneEuroParams { max_gap: f32::NAN, ..Default::default() }, "max_gap"),
        ] {
            assert_eq!(OneEuro::<f32>::new(p).unwrap_err().name, name);
        }
    }

    #[test]
    fn sizes_are_as_stated() {
        assert_eq!(size_of::<OneEuro<f32>>(), 48);
        assert!(size_of::<OneEuro<Vec3>>() <= 72);
        assert!(size_of::<OneEuro<Quat>>() <= 96);
    }
}
