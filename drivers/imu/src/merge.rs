//! Accelerometer readings at the gyroscope's times.
//!
//! The two have their own rates and phases (a D435i: 400 and 250 Hz), and a filter wants both at one time. The gyroscope's times are kept, as angular
//! rate is what is integrated; between two accelerometer readings the force is interpolated. So a reading waits until the accelerometer's next one,
//! 4 to 16 ms. A reading before the first of the accelerometer's is dropped, as is one between two that lie further apart than [`FARTHEST`]:
//! there is nothing to interpolate.
//!
//! A magnetometer's reading, where there is one, holds until the next, [`HELD`] at most.
//!
//! Memory: three rings of [`ROOM`] readings, made once. Error: of the interpolation (a vibration above half the accelerometer's rate is not seen).

use std::collections::VecDeque;

use isobath::glam::Vec3;

/// Readings of each sensor that are kept.
pub const ROOM: usize = 512;
/// Nanoseconds between two accelerometer readings beyond which nothing is interpolated: 200 ms.
pub const FARTHEST: i64 = 200_000_000;

/// Nanoseconds that a magnetometer's reading holds: 500 ms.
pub const HELD: i64 = 500_000_000;

/// Both, at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Merged {
    /// Nanoseconds, of the gyroscope's reading.
    pub time: i64,
    /// Angular rate, rad/s.
    pub rate: Vec3,
    /// Specific force, m/s².
    pub force: Vec3,
    /// Magnetic field, microtesla.
    pub field: Option<Vec3>,
}

/// A reading of one sensor: nanoseconds, and its vector.
type Reading = (i64, Vec3);

/// Puts the readings of two sensors together. Times of each must grow.
#[derive(Debug, Clone)]
pub struct Merger {
    rates: VecDeque<Reading>,
    forces: VecDeque<Reading>,
    fields: VecDeque<Reading>,
    lost: u64,
}

impl Default for Merger {
    fn default() -> Self {
        Self::new()
    }
}

impl Merger {
    /// Empty.
    #[must_use]
    pub fn new() -> Self {
        let room = || VecDeque::with_capacity(ROOM);
        Self { rates: room(), forces: room(), fields: room(), lost: 0 }
    }

    /// Takes a reading of the gyroscope, rad/s.
    pub fn rate(&mut self, time: i64, rate: Vec3) {
        if self.rates.len() == ROOM {
            self.rates.pop_front();
            self.lost += 1;
        }
        self.rates.push_back((time, rate));
    }

    /// Takes a reading of the accelerometer, m/s².
    pub fn force(&mut self, time: i64, force: Vec3) {
        if self.forces.len() == ROOM {
            self.forces.pop_front();
        }
        self.forces.push_back((time, force));
    }

    /// Takes a reading of the magnetometer, microtesla.
    pub fn field(&mut self, time: i64, field: Vec3) {
        if self.fields.len() == ROOM {
            self.fields.pop_front();
        }
        self.fields.push_back((time, field));
    }

    /// The field at a time, of which later ones follow.
    fn field_at(&mut self, time: i64) -> Option<Vec3> {
        while self.fields.get(1).is_some_and(|(t, _)| *t <= time) {
            self.fields.pop_front();
        }
        let &(at, field) = self.fields.front()?;
        (at <= time && time.saturating_sub(at) <= HELD).then_some(field)
    }

    /// The next reading of both. `None` until the accelerometer is as far as the gyroscope.
    pub fn pop(&mut self) -> Option<Merged> {
        loop {
            let &(time, rate) = self.rates.front()?;
            // The last reading of the accelerometer that is not later becomes the first.
            while self.forces.get(1).is_some_and(|(t, _)| *t <= time) {
                self.forces.pop_front();
            }
            let &(before, force) = self.forces.front()?;
            if before > time {
                self.drop_rate();
                continue;
            }
            if before == time {
                self.rates.pop_front();
                return Some(Merged { time, rate, force, field: self.field_at(time) });
            }
            let &(after, next) = self.forces.get(1)?;
            let (span, part) = (after.saturating_sub(before), time.saturating_sub(before));
            if span > FARTHEST {
                self.drop_rate();
                continue;
            }
            self.rates.pop_front();
            let force = force.lerp(next, (part as f64 / span as f64) as f32);
            return Some(Merged { time, rate, force, field: self.field_at(time) });
        }
    }

    fn drop_rate(&mut self) {
        self.rates.pop_front();
        self.lost += 1;
    }

    /// Gyroscope readings that were dropped.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// Forgets all readings.
    pub fn clear(&mut self) {
        self.rates.clear();
        self.forces.clear();
        self.fields.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn forces_are_interpolated_and_none_are_invented() {
        let mut m = Merger::new();
        m.rate(5, Vec3::X); // before the accelerometer began
        m.force(10, Vec3::ZERO);
        m.rate(12, Vec3::Y);
        m.rate(20, Vec3::Z);
        assert_eq!(m.pop(), None);
        m.force(20, Vec3::splat(10.0));
        m.field(11, Vec3::X);
        m.field(13, Vec3::NEG_X);
        let merged = |time, rate, force, field| Some(Merged { time, rate, force, field: Some(field) });
        assert_eq!(m.pop(), merged(12, Vec3::Y, Vec3::splat(2.0), Vec3::X));
        assert_eq!(m.pop(), merged(20, Vec3::Z, Vec3::splat(10.0), Vec3::NEG_X));
        assert_eq!((m.pop(), m.lost()), (None, 1));
        m.rate(30, Vec3::X);
        m.force(20 + FARTHEST + 1, Vec3::X);
        assert_eq!((m.pop(), m.lost()), (None, 2));
        m.force(14 + HELD, Vec3::X);
        m.rate(14 + HELD, Vec3::X);
        assert_eq!(m.pop().map(|m| m.field), Some(None), "a field of half a second ago is none");
    }

    proptest! {
        #[test]
        fn a_force_that_changes_evenly_comes_back_in_any_order(
            gyro in 1_i64..9_000_000, accel in 1_i64..9_000_000, phase in 0_i64..9_000_000, order in prop::collection::vec(any::<bool>(), 1..300),
        ) {
            // Force grows with time; what is interpolated is what it was.
            let force = |t: i64| Vec3::splat(t as f32 * 1e-7);
            let mut m = Merger::new();
            let (mut g, mut a) = (phase, 0);
            let mut seen = Vec::new();
            let mut asked = 0_u64;
            for turn in order {
                if turn {
                    m.rate(g, Vec3::splat(g as f32));
                    g += gyro;
                    asked += 1;
                } else {
                    m.force(a, force(a));
                    a += accel;
                }
                while let Some(Merged { time: t, rate, force: f, field }) = m.pop() {
                    prop_assert_eq!(field, None);
                    prop_assert_eq!(rate.x, t as f32);
                    prop_assert!((f - force(t)).length() < 1e-4 + 1e-5 * f.length(), "{} {}", f, force(t));
                    seen.push(t);
                }
            }
            prop_assert!(seen.windows(2).all(|two| two[0] < two[1]));
            prop_assert!(seen.len() as u64 + m.lost() <= asked);
        }
    }
}
