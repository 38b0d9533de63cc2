//! The time from one reading to the next, from the stamps alone.
//!
//! Sensors that promise 200 readings a second send 197, skip some when a bus is busy, repeat one after a hiccup, and start their clocks anew
//! when they are plugged in again. A filter that multiplies by a constant period integrates the wrong angle in each of these cases; here
//! the period is what the stamps say, and what no period can be made of is named.
//!
//! Memory: 16 bytes. Cost: a subtraction of integers. Error: the difference is exact to `f32` rounding.

use crate::ground::units::Timestamp;

/// What became of a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Step {
    /// The first: something to start from, nothing to integrate over.
    First,
    /// This many seconds after the one before.
    Forward(f32),
    /// So many seconds after the one before that what happened between is not known. It was taken as a new start; what changes slowly
    /// (orientation, bias) is kept, with less trust.
    Gap(f32),
    /// Its stamp is before that of the last one: the source's clock started anew. Taken as a new start, as after a gap.
    Backward,
    /// It has the stamp of the one before. Left out.
    Repeated,
    /// It is no reading: not finite, or beyond what sensors measure. Left out.
    Refused,
}

impl Step {
    /// Whether the reading was used.
    #[must_use]
    pub const fn is_used(&self) -> bool {
        !matches!(self, Self::Repeated | Self::Refused)
    }
}

/// The stamp of the last reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stamps {
    last: Option<Timestamp>,
}

impl Stamps {
    pub(super) const NEW: Self = Self { last: None };

    /// The step to a reading; longer than `max_gap` seconds is a gap.
    pub(super) fn step(&mut self, time: Timestamp, max_gap: f32) -> Step {
        let step = match self.last {
            None => Step::First,
            Some(last) if time < last => Step::Backward,
            Some(last) if time == last => return Step::Repeated,
            Some(last) => {
                let seconds = time.seconds_since(last);
                if seconds <= max_gap { Step::Forward(seconds) } else { Step::Gap(seconds) }
            }
        };
        self.last = Some(time);
        step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_case_is_named() {
        let mut stamps = Stamps::NEW;
        let mut step = |nanos| stamps.step(Timestamp::from_nanos(nanos), 0.1);
        assert_eq!(step(7_000_000_000_000_000_000), Step::First);
        assert_eq!(step(7_000_000_000_005_000_000), Step::Forward(0.005));
        assert_eq!(step(7_000_000_000_005_000_000), Step::Repeated);
        assert_eq!(step(7_000_000_000_105_000_000), Step::Forward(0.1));
        assert_eq!(step(7_000_000_001_105_000_000), Step::Gap(1.0));
        assert_eq!(step(5), Step::Backward);
        assert_eq!(step(6), Step::Forward(1e-9));
        assert!(matches!(step(i64::MAX), Step::Gap(s) if s > 9e9));
        assert_eq!(step(i64::MIN), Step::Backward);
        assert!(!Step::Repeated.is_used() && Step::Gap(1.0).is_used());
    }
}
