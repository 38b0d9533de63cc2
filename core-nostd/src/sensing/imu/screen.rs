//! Which of four ways a screen is held, from gravity, without flicker.
//!
//! Which side of the picture is up is the angle of *up* in the plane of the picture. Held at 45 degrees either answer is right, and a hand trembles: the
//! answer changes only when another side is nearer by [`ScreenParams::hysteresis`]. Lying flat there is no such angle; the answer stays what it was.
//!
//! Memory: 12 bytes. Cost: a root, 10 operations.

use glam::Vec3;

use super::{ImuError, in_range};
use crate::ground::math;

/// How far the picture must be turned for its content to stand upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Up is the picture's top (camera -y).
    Upright,
    /// Up is the picture's right side (camera +x): the device was turned a quarter to the left, the content turns a quarter to the right.
    Right,
    /// Up is the picture's bottom.
    UpsideDown,
    /// Up is the picture's left side.
    Left,
}

/// When the answer changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenParams {
    /// Radians beyond the diagonal that another side must be nearer, 0 to 0.7. Default 0.26 (15 degrees).
    pub hysteresis: f32,
    /// Least angle between the picture's axis and the vertical at which there is an answer, radians, 0 to 1.5. Default 0.44 (25 degrees).
    pub flat: f32,
}

impl ScreenParams {
    /// For a device in a hand.
    pub const DEFAULT: Self = Self { hysteresis: 0.26, flat: 0.44 };
}

impl Default for ScreenParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Holds the answer.
///
/// ```
/// use isobath::glam::vec3;
/// use isobath::sensing::imu::screen::{ScreenParams, ScreenTurn, Turn};
/// let mut screen = ScreenTurn::new(ScreenParams::DEFAULT)?;
/// // Up in the camera's frame (x right, y down): Gravity::in_camera.
/// assert_eq!(screen.update(vec3(0.1, -0.9, 0.3)), Turn::Upright);
/// assert_eq!(screen.update(vec3(0.75, -0.66, 0.0)), Turn::Upright, "just beyond the diagonal");
/// assert_eq!(screen.update(vec3(0.95, -0.3, 0.0)), Turn::Right);
/// assert_eq!(screen.update(vec3(0.1, -0.1, -0.99)), Turn::Right, "flat on a table");
/// # Ok::<(), isobath::sensing::imu::ImuError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenTurn {
    /// Sine of `flat`; cosine of 45 degrees and the hysteresis.
    least: f32,
    leave: f32,
    held: Turn,
}

impl ScreenTurn {
    /// Upright, until told otherwise.
    ///
    /// # Errors
    /// [`ImuError`] when a parameter is out of its range.
    pub fn new(params: ScreenParams) -> Result<Self, ImuError> {
        in_range("hysteresis", params.hysteresis, 0.0, 0.7)?;
        in_range("flat", params.flat, 0.0, 1.5)?;
        let leave = math::cos(core::f32::consts::FRAC_PI_4 + params.hysteresis);
        Ok(Self { least: math::sin(params.flat), leave, held: Turn::Upright })
    }

    /// Takes up in the camera's frame (any length; one that is not finite or zero changes nothing); gives the answer.
    pub fn update(&mut self, up: Vec3) -> Turn {
        let Vec3 { x, y, .. } = up;
        let across = math::sqrt(x * x + y * y);
        if across > self.least * up.length() && across.is_finite() {
            let along = match self.held {
                Turn::Upright => -y,
                Turn::Right => x,
                Turn::UpsideDown => y,
                Turn::Left => -x,
            };
            if along < self.leave * across {
                self.held = match (x.abs() > y.abs(), x > 0.0, y > 0.0) {
                    (true, true, _) => Turn::Right,
                    (true, false, _) => Turn::Left,
                    (false, _, true) => Turn::UpsideDown,
                    (false, _, false) => Turn::Upright,
                };
            }
        }
        self.held
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(degrees: f32) -> Vec3 {
        let a = degrees.to_radians();
        Vec3::new(a.sin(), -a.cos(), 0.3)
    }

    #[test]
    fn a_full_turn_changes_four_times_late_by_the_hysteresis() {
        for way in [1.0, -1.0] {
            let mut screen = ScreenTurn::new(ScreenParams::DEFAULT).unwrap();
            let mut changes = std::vec::Vec::new();
            let mut last = Turn::Upright;
            for tenth in 0..3600 {
                let turn = screen.update(at(way * tenth as f32 / 10.0));
                if turn != last {
                    changes.push((tenth as f32 / 10.0, turn));
                    last = turn;
                }
            }
            let late = ScreenParams::DEFAULT.hysteresis.to_degrees();
            for (i, (angle, _)) in changes.iter().enumerate() {
                assert!((angle - (45.0 + late + 90.0 * i as f32)).abs() < 0.2, "{changes:?}");
            }
            let order = if way > 0.0 {
                [Turn::Right, Turn::UpsideDown, Turn::Left]
            } else {
                [Turn::Left, Turn::UpsideDown, Turn::Right]
            };
            assert_eq!(changes.iter().map(|c| c.1).collect::<std::vec::Vec<_>>()[..3], order);
        }
    }

    #[test]
    fn trembling_at_the_diagonal_does_not_flicker() {
        let mut screen = ScreenTurn::new(ScreenParams::DEFAULT).unwrap();
        for i in 0..100 {
            assert_eq!(screen.update(at(if i % 2 == 0 { 40.0 } else { 55.0 })), Turn::Upright);
        }
    }

    #[test]
    fn nothing_changes_without_a_direction() {
        let mut screen = ScreenTurn::new(ScreenParams::DEFAULT).unwrap();
        screen.update(at(90.0));
        for up in [Vec3::ZERO, Vec3::NAN, Vec3::Z, Vec3::splat(f32::INFINITY), Vec3::splat(f32::MAX), Vec3::NEG_Z] {
            assert_eq!(screen.update(up), Turn::Right);
        }
        assert!(ScreenTurn::new(ScreenParams { hysteresis: 1.0, flat: 0.4 }).is_err());
        assert!(ScreenTurn::new(ScreenParams { hysteresis: 0.1, flat: f32::NAN }).is_err());
    }
}
