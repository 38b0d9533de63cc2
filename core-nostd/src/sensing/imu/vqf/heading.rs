//! The heading, from a magnetometer that is not to be believed blindly (Laidig and Seel 2023, sections 3.4 and 3.6).
//!
//! The field in the levelled frame points north, give or take; the angle to north follows it by a first-order filter. Iron and currents
//! bend the field: a reading counts as undisturbed while the field's norm and dip are near those of a reference, which itself follows slowly; while disturbed, the
//! heading is the gyroscope's, for up to a minute. A new field that stays the same while the device turns becomes the reference.

use core::f32::consts::{PI, TAU};

use glam::Vec3;

use super::super::lowpass::{Gains, LowPass};
use super::super::step::{Stamps, Step};
use super::super::{ImuError, in_range, positive};
use crate::ground::math;
use crate::ground::units::Timestamp;

const DEGREE: f32 = PI / 180.0;

/// How a magnetometer is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagneticParams {
    /// Time constant of the heading, seconds, above 0. Default 9.
    pub time: f32,
    /// Whether disturbed readings are left out. Default true.
    pub reject: bool,
    /// Time constant that norm and dip are smoothed with, seconds, above 0. Default 0.05.
    pub smoothing: f32,
    /// Time constant of the reference, seconds, above 0. Default 20.
    pub reference_time: f32,
    /// Share of the reference's norm that a field may be off, above 0. Default 0.1.
    pub max_norm: f32,
    /// Angle that a field's dip may be off, radians, above 0. Default 10 degrees.
    pub max_dip: f32,
    /// Seconds of turning after which a new field is accepted, 0 or more. Default 20.
    pub new_time: f32,
    /// The same for the first field ever, seconds, 0 or more. Default 5.
    pub first_time: f32,
    /// What counts as turning, rad/s, 0 or more. Default 20 degrees/s.
    pub new_rate: f32,
    /// Seconds that a field must be near the reference to be undisturbed, 0 or more. Default 0.5.
    pub undisturbed_time: f32,
    /// Longest time for which disturbed readings are left out altogether, seconds, 0 or more. Default 60.
    pub longest_rejection: f32,
    /// Beyond that time they count this many times less; and the time is made up for this many times faster. 1 or more. Default 2.
    pub rejection_factor: f32,
    /// Longest silence of the magnetometer after which it goes on, seconds, 1e-6 to 3600. Default 1.
    pub max_gap: f32,
}

impl MagneticParams {
    /// The paper's.
    pub const DEFAULT: Self = Self {
        time: 9.0,
        reject: true,
        smoothing: 0.05,
        reference_time: 20.0,
        max_norm: 0.1,
        max_dip: 10.0 * DEGREE,
        new_time: 20.0,
        first_time: 5.0,
        new_rate: 20.0 * DEGREE,
        undisturbed_time: 0.5,
        longest_rejection: 60.0,
        rejection_factor: 2.0,
        max_gap: 1.0,
    };

    pub(super) fn check(&self) -> Result<(), ImuError> {
        let seconds = [
            ("time", self.time),
            ("smoothing", self.smoothing),
            ("reference_time", self.reference_time),
            ("max_norm", self.max_norm),
            ("max_dip", self.max_dip),
        ];
        for (name, value) in seconds {
            positive(name, value)?;
        }
        let from_zero = [
            ("new_time", self.new_time),
            ("first_time", self.first_time),
            ("new_rate", self.new_rate),
            ("undisturbed_time", self.undisturbed_time),
            ("longest_rejection", self.longest_rejection),
        ];
        for (name, value) in from_zero {
            in_range(name, value, 0.0, f32::MAX)?;
        }
        in_range("max_gap", self.max_gap, 1e-6, 3600.0)?;
        in_range("rejection_factor", self.rejection_factor, 1.0, f32::MAX)
    }
}

impl Default for MagneticParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A field as it is recognised: norm (microtesla) and dip (radians below the horizon).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Field {
    norm: f32,
    dip: f32,
}

impl Field {
    const NONE: Self = Self { norm: 0.0, dip: 0.0 };

    fn is_near(self, other: Self, p: &MagneticParams) -> bool {
        (self.norm - other.norm).abs() < p.max_norm * other.norm && (self.dip - other.dip).abs() < p.max_dip
    }

    fn follow(&mut self, other: Self, gain: f32) {
        self.norm += gain * (other.norm - self.norm);
        self.dip += gain * (other.dip - self.dip);
    }
}

/// The angle to north and what is known of the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Heading {
    stamps: Stamps,
    filter: LowPass<2>,
    gains: Gains,
    /// Gains of the heading and of the reference for the gains' period.
    towards: f32,
    reference_gain: f32,
    /// From the levelled frame to north, radians, in [-pi, pi].
    pub(super) angle: f32,
    /// Least gain of the first readings: 1, 1/2, 1/3...; then 0.
    first: f32,
    reference: Field,
    undisturbed: f32,
    candidate: Field,
    candidate_time: f32,
    pub(super) disturbed: bool,
    rejected: f32,
    pub(super) seen: bool,
}

impl Heading {
    /// Knows nothing: until there is a reference the field is believed, less, from the start.
    pub(super) const fn new(p: &MagneticParams) -> Self {
        Self {
            stamps: Stamps::NEW,
            filter: LowPass::NEW,
            gains: Gains::NONE,
            towards: 0.0,
            reference_gain: 0.0,
            angle: 0.0,
            first: 1.0,
            reference: Field::NONE,
            undisturbed: 0.0,
            candidate: Field::NONE,
            candidate_time: 0.0,
            disturbed: true,
            rejected: p.longest_rejection,
            seen: false,
        }
    }

    /// The levelled frame has turned by an unknown angle: the next readings count as the first.
    pub(super) const fn restart(&mut self) {
        self.first = 1.0;
        self.filter = LowPass::NEW;
        self.undisturbed = 0.0;
        self.candidate_time = 0.0;
    }

    /// Takes a field in the levelled frame (microtesla); `turning` is how fast the device turns, rad/s, smoothed.
    pub(super) fn update(&mut self, field: Vec3, time: Timestamp, turning: f32, p: &MagneticParams) {
        let period = match self.stamps.step(time, p.max_gap) {
            Step::Forward(period) => period,
            Step::Repeated | Step::Refused => return,
            Step::First | Step::Gap(_) | Step::Backward => {
                self.filter = LowPass::NEW;
                self.undisturbed = 0.0;
                0.0
            }
        };
        if period != self.gains.period() {
            self.gains.follow(period, p.smoothing);
            self.towards = -math::exp_m1(-period / p.time);
            self.reference_gain = -math::exp_m1(-period / p.reference_time);
        }
        self.seen = true;
        if p.reject {
            self.judge(field, period, turning, p);
        }
        let off = wrapped(math::atan2(field.x, field.y) - self.angle);
        let gain = math::max(self.gain(period, p), self.least(period, p));
        self.angle = wrapped(self.angle + gain * off);
    }

    /// Is it disturbed; is there a new field?
    fn judge(&mut self, field: Vec3, period: f32, turning: f32, p: &MagneticParams) {
        let level = math::sqrt(field.x * field.x + field.y * field.y);
        let now = [field.length(), math::atan2(-field.z, level)];
        let [norm, dip] = self.filter.step(&now, &self.gains, p.smoothing);
        let now = Field { norm, dip };
        if now.is_near(self.reference, p) {
            self.undisturbed = math::min(self.undisturbed + period, p.undisturbed_time);
            if self.undisturbed >= p.undisturbed_time {
                self.disturbed = false;
                self.reference.follow(now, self.reference_gain);
            }
        } else {
            self.undisturbed = 0.0;
            self.disturbed = true;
        }
        if now.is_near(self.candidate, p) {
            if turning >= p.new_rate {
                self.candidate_time = math::min(self.candidate_time + period, math::max(p.new_time, p.first_time));
            }
            self.candidate.follow(now, self.reference_gain);
            let first = self.reference.norm == 0.0 && self.candidate_time >= p.first_time;
            if self.disturbed && (first || self.candidate_time >= p.new_time) {
                self.reference = self.candidate;
                self.disturbed = false;
                self.undisturbed = p.undisturbed_time;
            }
        } else {
            self.candidate_time = 0.0;
            self.candidate = now;
        }
    }

    /// How far the heading goes towards the field.
    fn gain(&mut self, period: f32, p: &MagneticParams) -> f32 {
        if !p.reject {
            self.towards
        } else if !self.disturbed {
            self.rejected = math::max(self.rejected - p.rejection_factor * period, 0.0);
            self.towards
        } else if self.rejected <= p.longest_rejection {
            self.rejected += period;
            0.0
        } else {
            self.towards / p.rejection_factor
        }
    }

    /// The first readings count as their mean, until they are as many as the filter would look back at.
    fn least(&mut self, period: f32, p: &MagneticParams) -> f32 {
        let least = self.first;
        if least > 0.0 {
            self.first = least / (least + 1.0);
            if self.first * p.time < period {
                self.first = 0.0;
            }
        }
        least
    }
}

/// An angle within three half turns, brought into [-pi, pi].
fn wrapped(angle: f32) -> f32 {
    if angle > PI {
        angle - TAU
    } else if angle < -PI {
        angle + TAU
    } else {
        angle
    }
}
