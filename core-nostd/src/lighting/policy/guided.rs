//! Guided bootstrapped movement: where to look so that the light from behind is known.
//!
//! LitAR, section 4.3.1 and Fig. 6. A user looks at the object; the light that makes it shine comes largely from behind the
//! user, which nobody looks at. So, once, the user is asked to turn round: to the opposite of the object's viewing direction,
//! and from there some steps (30 degrees) to the left, right, up and down; one, three, five or nine directions.
//!
//! ```text
//! object viewing direction   v = unit(object - viewer)
//! guide direction            f = -v,  right r = unit(f x up),  u = r x f
//! direction of (yaw, pitch)  cos pitch (cos yaw f + sin yaw r) + sin pitch u
//! ```
//!
//! The paper does not say about which axes its spherical angles turn. Here it is the guide direction's own frame, not the
//! world's: a step is a step however steeply the user looks down on the object (within the upper and lower row of three it is
//! 26 degrees), and none runs over the pole.
//!
//! A direction is done when a frame's optical axis came within the tolerance (half a step unless given) *and* the frame sees
//! it. Colour there, not depth, is what the far field wants, so holes do not matter.
//!
//! Memory: 136 bytes, no buffers. Cost: a call is at most nine projections or nine arc tangents. Error: directions are unit vectors to 2e-7;
//! angles are good to 1e-6 radians.

use core::f32::consts::{FRAC_PI_2, FRAC_PI_3};
use core::fmt;

use glam::Vec3;

use crate::ground::geometry::unit;
use crate::ground::math;
use crate::sensing::camera::intrinsics::pixel_index;
use crate::sensing::camera::{Intrinsics, Pose};

/// How many directions to look in: the paper's grids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Directions {
    /// Straight back.
    One,
    /// Back, and one step to either side.
    Three,
    /// Back, one step to either side, one step up and one down.
    #[default]
    Five,
    /// Three by three.
    Nine,
}

impl Directions {
    /// The grid's places (yaw to the right, pitch upwards) in steps: the first `count` are this grid.
    const STEPS: [(i8, i8); 9] = [(0, 0), (-1, 0), (1, 0), (0, 1), (0, -1), (-1, 1), (1, 1), (-1, -1), (1, -1)];

    /// How many there are.
    #[must_use]
    pub const fn count(self) -> usize {
        match self {
            Self::One => 1,
            Self::Three => 3,
            Self::Five => 5,
            Self::Nine => 9,
        }
    }

    /// The grid of so many directions; `None` unless 1, 3, 5 or 9.
    #[must_use]
    pub const fn of_count(count: usize) -> Option<Self> {
        match count {
            1 => Some(Self::One),
            3 => Some(Self::Three),
            5 => Some(Self::Five),
            9 => Some(Self::Nine),
            _ => None,
        }
    }
}

/// What to ask of the user.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuideParams {
    /// How many directions. Default five.
    pub directions: Directions,
    /// Angle from one direction to the next, radians, from 0.01 to pi / 3. Default 30 degrees, the paper's.
    pub step: f32,
    /// How near (radians, above 0, at most pi / 2) a frame's optical axis must come to a direction. Default: half a step.
    pub tolerance: Option<f32>,
}

impl GuideParams {
    /// The paper's step, five directions.
    pub const DEFAULT: Self =
        Self { directions: Directions::Five, step: core::f32::consts::FRAC_PI_6, tolerance: None };
}

impl Default for GuideParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Why there is nothing to guide to.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum GuideError {
    /// A parameter is out of its range.
    Parameter {
        /// The field at fault.
        name: &'static str,
        /// What it was.
        value: f32,
    },
    /// The viewer stands in the object, or a position is not finite: there is no viewing direction.
    NoDirection,
    /// Up has no length, is not finite, or is within 0.5 degrees of the viewing direction: there is no left and right.
    NoUp,
}

impl fmt::Display for GuideError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Parameter { name, value } => write!(
                f,
                "guided movement: {name} = {value} is not usable; step must be 0.01 to pi / 3 rad, tolerance above 0 and at most pi / 2"
            ),
            Self::NoDirection => write!(
                f,
                "guided movement: viewer and object give no direction; they must be finite and apart from each other"
            ),
            Self::NoUp => write!(
                f,
                "guided movement: up gives no left and right; it must be finite, not zero and not along the view; looking straight down, give the camera's own up"
            ),
        }
    }
}

impl core::error::Error for GuideError {}

/// Where to look next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// There.
    Look(Turn),
    /// Nowhere: every direction is done.
    Done,
}

/// The way from where the device looks to a direction, in the device's own frame: what an arrow on its screen shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Which of [`Guide::directions`].
    pub index: usize,
    /// The direction in the world, unit length.
    pub direction: Vec3,
    /// Angle left between the optical axis and the direction, radians, 0 to pi.
    pub angle: f32,
    /// Left to turn to the right of the image, radians, -pi to pi; negative: to the left.
    pub yaw: f32,
    /// Left to turn to the top of the image after that, radians, -pi/2 to pi/2; negative: to the bottom.
    pub pitch: f32,
}

/// The directions to look in, and which of them were seen.
///
/// ```
/// use glam::{Vec3, vec3};
/// use isobath::lighting::policy::guided::{Guide, GuideParams, Next};
/// use isobath::sensing::camera::{Intrinsics, Pose};
/// let (eye, object) = (vec3(0.0, 1.6, 0.0), vec3(0.0, 1.0, -2.0));
/// let mut guide = Guide::new(object, eye, Vec3::Y, GuideParams::default())?;
/// let camera = Intrinsics::from_fov(1.1, 256, 192)?;
///
/// // The user looks at the object, and is told to turn round.
/// let pose = Pose::looking_at(eye, object, Vec3::Y).unwrap();
/// assert_eq!(guide.observe(&pose, &camera, (256, 192)), 0);
/// let Next::Look(turn) = guide.next(&pose) else { unreachable!() };
/// assert!(turn.angle > 2.5);
///
/// // Having looked at everything asked for, there is nothing left.
/// while let Next::Look(turn) = guide.next(&pose) {
///     let pose = Pose::looking_at(eye, eye + turn.direction, Vec3::Y).unwrap();
///     assert_eq!(guide.observe(&pose, &camera, (256, 192)), 1);
/// }
/// assert_eq!(guide.coverage(), 1.0);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guide {
    directions: [Vec3; 9],
    count: usize,
    done: u16,
    /// Cosine of the tolerance.
    least_cosine: f32,
}

impl Guide {
    /// For an object seen from a viewer's position (both world, metres), with the world's up (any length).
    ///
    /// # Errors
    /// [`GuideError`].
    pub fn new(object: Vec3, viewer: Vec3, up: Vec3, params: GuideParams) -> Result<Self, GuideError> {
        Self::around(viewer - object, up, params)
    }

    /// Around a guide direction of any length: the opposite of the object's viewing direction.
    ///
    /// # Errors
    /// [`GuideError`].
    pub fn around(direction: Vec3, up: Vec3, params: GuideParams) -> Result<Self, GuideError> {
        let GuideParams { directions, step, tolerance } = params;
        if !(0.01..=FRAC_PI_3).contains(&step) {
            return Err(GuideError::Parameter { name: "step", value: step });
        }
        let tolerance = tolerance.unwrap_or(0.5 * step);
        if !(tolerance > 0.0 && tolerance <= FRAC_PI_2) {
            return Err(GuideError::Parameter { name: "tolerance", value: tolerance });
        }
        let forward = unit(direction).ok_or(GuideError::NoDirection)?;
        let right = unit(up).map(|up| forward.cross(up)).filter(|r| r.length() > 0.009).and_then(unit);
        let right = right.ok_or(GuideError::NoUp)?;
        let above = right.cross(forward);
        let at = |(yaw, pitch): (i8, i8)| {
            let (yaw, pitch) = (f32::from(yaw) * step, f32::from(pitch) * step);
            let level = forward * math::cos(yaw) + right * math::sin(yaw);
            level * math::cos(pitch) + above * math::sin(pitch)
        };
        Ok(Self {
            directions: Directions::STEPS.map(at),
            count: directions.count(),
            done: 0,
            least_cosine: math::cos(tolerance),
        })
    }

    /// The directions, unit vectors in the world: straight back first.
    #[must_use]
    pub fn directions(&self) -> &[Vec3] {
        self.directions.get(..self.count).unwrap_or(&self.directions)
    }

    /// Whether a direction was seen; `false` for one that there is not.
    #[must_use]
    pub const fn is_done(&self, index: usize) -> bool {
        index < self.count && self.done >> index & 1 == 1
    }

    /// How many directions were seen.
    #[must_use]
    pub const fn done(&self) -> usize {
        self.done.count_ones() as usize
    }

    /// The fraction of directions that were seen, 0 to 1.
    #[must_use]
    pub fn coverage(&self) -> f32 {
        self.done() as f32 / self.count as f32
    }

    /// Takes a frame that was captured (its pose, its colour camera and that image's width and height): which directions does
    /// it settle? How many were new.
    pub fn observe(&mut self, pose: &Pose, camera: &Intrinsics, size: (usize, usize)) -> usize {
        let axis = pose.direction_to_world(Vec3::Z);
        let mut seen = 0_u16;
        for (index, &direction) in self.directions().iter().enumerate() {
            // A tolerance of half a degree is 4e-5 below a cosine of 1, where f32 steps are 6e-8: fine enough.
            let near = axis.dot(direction) >= self.least_cosine;
            let pixel = camera.project(pose.direction_to_camera(direction));
            if near && pixel.and_then(|p| pixel_index(p, size)).is_some() {
                seen |= 1 << index;
            }
        }
        let new = seen & !self.done;
        self.done |= new;
        new.count_ones() as usize
    }

    /// The undone direction that is nearest to where the device looks now. Of equally near ones the earlier in
    /// [`Self::directions`].
    #[must_use]
    pub fn next(&self, pose: &Pose) -> Next {
        let mut best: Option<Turn> = None;
        for (index, &direction) in self.directions().iter().enumerate().filter(|(i, _)| !self.is_done(*i)) {
            let turn = turn_to(index, direction, pose);
            if best.is_none_or(|b| turn.angle < b.angle) {
                best = Some(turn);
            }
        }
        best.map_or(Next::Done, Next::Look)
    }

    /// Every direction with the way there, and whether it was seen: for a page that draws them all.
    pub fn turns(&self, pose: &Pose) -> impl Iterator<Item = (Turn, bool)> {
        let each = self.directions().iter().enumerate();
        each.map(|(index, &direction)| (turn_to(index, direction, pose), self.is_done(index)))
    }

    /// Forgets what was seen.
    pub const fn reset(&mut self) {
        self.done = 0;
    }
}

fn turn_to(index: usize, direction: Vec3, pose: &Pose) -> Turn {
    let d = pose.direction_to_camera(direction);
    let level = math::sqrt(d.x * d.x + d.z * d.z);
    Turn {
        index,
        direction,
        angle: math::atan2(math::sqrt(d.x * d.x + d.y * d.y), d.z),
        yaw: math::atan2(d.x, d.z),
        // Camera y points down.
        pitch: math::atan2(-d.y, level),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::PI;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn guide(count: usize) -> Guide {
        let params = GuideParams { directions: Directions::of_count(count).unwrap(), ..Default::default() };
        Guide::new(Vec3::new(0.0, 0.0, -2.0), Vec3::ZERO, Vec3::Y, params).unwrap()
    }

    fn camera() -> Intrinsics {
        Intrinsics::from_fov(1.1, 256, 192).unwrap()
    }

    fn towards(direction: Vec3) -> Pose {
        Pose::looking_at(Vec3::ZERO, direction, Vec3::Y).unwrap()
    }

    #[test]
    fn the_grids_are_the_papers() {
        // The object lies along -z, so the guide direction is +z; looking there, right is -x.
        let degrees = |d: &Vec3| {
            let (yaw, pitch) = (math::atan2(-d.x, d.z), math::atan2(d.y, math::sqrt(d.x * d.x + d.z * d.z)));
            (math::round(yaw.to_degrees()) as i32, math::round(pitch.to_degrees()) as i32)
        };
        for count in [1, 3, 5, 9] {
            let guide = guide(count);
            let got: Vec<_> = guide.directions().iter().map(degrees).collect();
            let nine = [(0, 0), (-30, 0), (30, 0), (0, 30), (0, -30), (-30, 30), (30, 30), (-30, -30), (30, -30)];
            assert_eq!(got, nine[..count]);
            assert!(guide.directions().iter().all(|d| (d.length() - 1.0).abs() < 3e-7));
        }
        assert_eq!(Directions::of_count(4), None);
    }

    #[test]
    fn what_has_no_direction_is_refused() {
        let p = GuideParams::default();
        let new = |object, up, params| Guide::new(object, Vec3::ZERO, up, params).map(|_| ());
        assert_eq!(new(Vec3::ZERO, Vec3::Y, p), Err(GuideError::NoDirection));
        assert_eq!(new(Vec3::NAN, Vec3::Y, p), Err(GuideError::NoDirection));
        assert_eq!(new(Vec3::X, Vec3::ZERO, p), Err(GuideError::NoUp));
        assert_eq!(new(Vec3::X, Vec3::splat(f32::INFINITY), p), Err(GuideError::NoUp));
        assert_eq!(new(Vec3::Y * -1.5, Vec3::Y, p), Err(GuideError::NoUp));
        assert!(new(Vec3::new(0.1, -1.5, 0.0), Vec3::Y * 9.0, p).is_ok());
        for (step, tolerance, name) in [
            (0.0, None, "step"),
            (f32::NAN, None, "step"),
            (1.1, None, "step"),
            (0.5, Some(0.0), "tolerance"),
            (0.5, Some(f32::NAN), "tolerance"),
            (0.5, Some(2.0), "tolerance"),
        ] {
            let params = GuideParams { step, tolerance, ..p };
            assert!(matches!(new(Vec3::X, Vec3::Y, params), Err(GuideError::Parameter { name: n, .. }) if n == name));
        }
    }

    #[test]
    fn done_needs_the_axis_and_the_field() {
        let mut g = guide(5);
        let turned =
            |degrees: f32| towards(Vec3::new(-math::sin(degrees.to_radians()), 0.0, math::cos(degrees.to_radians())));
        // 14 degrees off the middle: that one alone. 16 degrees is nearer to the next.
        assert_eq!(g.observe(&turned(14.0), &camera(), (256, 192)), 1);
        assert!(g.is_done(0) && !g.is_done(2));
        assert_eq!(g.observe(&turned(16.0), &camera(), (256, 192)), 1);
        assert!(g.is_done(2));
        assert_eq!(g.observe(&turned(16.0), &camera(), (256, 192)), 0, "once is enough");
        assert!((g.coverage() - 0.4).abs() < 1e-6);
        g.reset();
        // A telephoto lens, 10 degrees across, does not see what is 14 degrees off its axis.
        let narrow = Intrinsics::from_fov(0.17, 256, 192).unwrap();
        assert_eq!(g.observe(&turned(14.0), &narrow, (256, 192)), 0);
        assert_eq!(g.observe(&turned(3.0), &narrow, (256, 192)), 1);
        assert!(!g.is_done(99));
    }

    #[test]
    fn arrows_point_where_to_turn() {
        let mut g = guide(5);
        assert_eq!(g.observe(&towards(Vec3::Z), &camera(), (256, 192)), 1);
        // Looking at the middle, all four others are 30 degrees away: one a side, up, down.
        let turns: Vec<_> = g.turns(&towards(Vec3::Z)).collect();
        let close = |a: f32, b: f32| (a - b).abs() < 1e-5;
        let step = PI / 6.0;
        assert!(turns[0].1 && close(turns[0].0.angle, 0.0));
        assert!(turns.iter().skip(1).all(|(t, done)| !done && close(t.angle, step)));
        assert!(close(turns[1].0.yaw, -step) && close(turns[2].0.yaw, step));
        assert!(close(turns[3].0.pitch, step) && close(turns[4].0.pitch, -step));
        // Someone who looks a little up is sent up.
        let Next::Look(turn) = g.next(&towards(Vec3::new(0.0, 0.1, 1.0))) else { panic!() };
        assert_eq!(turn.index, 3);
        assert!(turn.pitch > 0.0 && turn.yaw.abs() < 1e-5);
    }

    proptest! {
        /// However steep the view, from anywhere: turning by yaw, then pitch arrives; following the arrows ends.
        #[test]
        fn following_the_arrows_covers_everything(
            object in proptest::array::uniform3(-3.0_f32..3.0),
            look in proptest::array::uniform3(-1.0_f32..1.0),
            count in prop::sample::select(&[1_usize, 3, 5, 9][..]),
        ) {
            let params = GuideParams { directions: Directions::of_count(count).unwrap(), ..Default::default() };
            let Ok(mut guide) = Guide::new(Vec3::from(object), Vec3::ZERO, Vec3::Y, params) else { return Ok(()) };
            let Some(pose) = Pose::looking_at(Vec3::ZERO, Vec3::from(look), Vec3::Y) else { return Ok(()) };
            // Neighbours are a step apart, those of the upper and lower row 26 degrees: a frame that looks at one settles no other.
            for (i, a) in guide.directions().iter().enumerate() {
                for b in &guide.directions()[..i] {
                    prop_assert!(a.dot(*b) < 0.9);
                }
            }
            let mut pose = pose;
            for left in (0..count).rev() {
                let Next::Look(t) = guide.next(&pose) else { panic!("{left} left") };
                let d = Vec3::new(
                    math::cos(t.pitch) * math::sin(t.yaw), -math::sin(t.pitch), math::cos(t.pitch) * math::cos(t.yaw));
                let d = pose.direction_to_world(d);
                prop_assert!((d - t.direction).length() < 2e-5);
                // The camera may be rolled any way.
                let up = if d.y.abs() > 0.9 { Vec3::X } else { Vec3::Y };
                pose = Pose::looking_at(Vec3::ZERO, d, up).unwrap();
                prop_assert_eq!(guide.observe(&pose, &camera(), (256, 192)), 1);
            }
            prop_assert_eq!(guide.next(&pose), Next::Done);
            prop_assert_eq!(guide.coverage(), 1.0);
        }
    }

    #[test]
    fn its_size_is_as_stated() {
        assert!(size_of::<Guide>() <= 136);
    }
}
