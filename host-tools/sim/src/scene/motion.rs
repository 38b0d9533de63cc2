//! How groups move: smoothly from key to key (3 s² - 2 s³: it starts and stops without a jerk), then hold, or begin again.

use super::file::{AfterFile, KeyFile};
use crate::maths::{Rigid, Rotation, V3};

/// A group's place over time.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    pub(super) base: Rigid,
    pub(super) keys: Vec<KeyFile>,
    pub(super) repeat: bool,
}

/// Yaw, pitch, roll in degrees.
pub(super) fn turned([yaw, pitch, roll]: [f64; 3]) -> Rotation {
    let r = std::f64::consts::PI / 180.0;
    Rotation::from_yaw_pitch_roll(yaw * r, pitch * r, roll * r)
}

impl Motion {
    pub(super) fn new(base: Rigid, keys: Vec<KeyFile>, after: AfterFile) -> Self {
        Self { base, keys, repeat: after == AfterFile::Repeat }
    }

    /// The group's place at a time in seconds.
    pub(super) fn at(&self, time: f64) -> Rigid {
        let (Some(first), Some(last)) = (self.keys.first(), self.keys.last()) else { return self.base };
        let span = last.time - first.time;
        let time = if self.repeat && span > 0.0 {
            let turns = libm::floor((time - first.time) / span);
            time - turns * span
        } else {
            time
        };
        let after = self.keys.partition_point(|k| k.time <= time);
        let b = self.keys.get(after).unwrap_or(last);
        let a = after.checked_sub(1).and_then(|i| self.keys.get(i)).unwrap_or(first);
        let s = if b.time > a.time { ((time - a.time) / (b.time - a.time)).clamp(0.0, 1.0) } else { 0.0 };
        let s = s * s * (3.0 - 2.0 * s);
        let mix = |p: [f64; 3], q: [f64; 3]| V3::from(p).lerp(q.into(), s);
        let moved = Rigid { rotation: turned(mix(a.turn, b.turn).into()), translation: mix(a.shift, b.shift) };
        self.base.then(&moved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_met_and_ends_held_or_repeated() {
        let key = |time: f64, x: f64| KeyFile { time, shift: [x, 0.0, 0.0], turn: [0.0; 3] };
        let keys = vec![key(1.0, 0.0), key(2.0, 4.0), key(4.0, 0.0)];
        let x = |m: &Motion, t: f64| m.at(t).translation.x;
        let hold = Motion::new(Rigid::IDENTITY, keys.clone(), AfterFile::Hold);
        assert_eq!(
            [x(&hold, 0.0), x(&hold, 1.0), x(&hold, 1.5), x(&hold, 2.0), x(&hold, 9.0)],
            [0.0, 0.0, 2.0, 4.0, 0.0]
        );
        let again = Motion::new(Rigid::IDENTITY, keys, AfterFile::Repeat);
        assert_eq!(x(&again, 4.5), 2.0);
        assert_eq!(x(&again, 1.5 + 3.0 * 7.0), 2.0);
    }
}
