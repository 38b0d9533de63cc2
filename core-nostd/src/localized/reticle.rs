//! How does the cursor lie on the surface? A pose that sticks to what is pointed at, turned along its normal.
//!
//! DepthLab's oriented reticle. Its published code keeps 75 % of the old orientation each frame, so it is twice as slow at
//! 30 frames a second as at 60; here a time constant takes the place of the share: kept = exp(-dt / T), and 75 % at 30
//! frames a second is T = (1/30) / ln(4/3) = 0.116 s.
//!
//! z points along the normal, x is the camera's right laid into the surface, so that the cursor's picture stays upright. On
//! a surface seen along its normal's side, where the camera's right has no shadow, the old x is kept.
//!
//! The hit is an argument ([`hit`](crate::localized::hit) gives it). Over holes the last good pose is held, with its age.
//!
//! Memory: at most 96 bytes of state. Cost: a few dozen operations and half a dozen trigonometric calls. Error: the answer at a time does
//! not depend on the frame rate (to 1e-5, held by a test).

use core::fmt;

use glam::{Mat3, Quat, Vec3};

use crate::ground::math;
use crate::ground::rotation::{rotate, turned, unit, way};
use crate::ground::units::Timestamp;
use crate::sensing::camera::Pose;

/// How fast it follows, and how long it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReticleParams {
    /// Time constant of the orientation, seconds, 0 or more (0: at once). Default 0.116: the published 75 % a frame at 30
    /// frames a second.
    pub turn_time: f32,
    /// Time constant of the position, seconds, 0 or more. Default 0, as published: the cursor stays where one points.
    pub move_time: f32,
    /// How long the last pose is held without a hit, seconds, 0 or more. Default 1.
    pub hold: f32,
}

impl ReticleParams {
    /// As published, at 30 frames a second.
    pub const DEFAULT: Self = Self { turn_time: 0.115_87, move_time: 0.0, hold: 1.0 };
}

impl Default for ReticleParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A parameter out of its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReticleError {
    /// The field at fault.
    pub name: &'static str,
    /// What it was.
    pub value: f32,
}

impl fmt::Display for ReticleError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "reticle: {} = {} must be 0 or more seconds", self.name, self.value)
    }
}

impl core::error::Error for ReticleError {}

/// What is pointed at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReticleHit {
    /// World point, metres.
    pub point: Vec3,
    /// Surface normal, world, any length; `None` when it could not be had (an edge): the old orientation stays.
    pub normal: Option<Vec3>,
}

/// Where the cursor is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReticlePose {
    /// World, metres.
    pub position: Vec3,
    /// Cursor to world: z along the normal, x to the right.
    pub orientation: Quat,
}

/// What the cursor does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ReticleState {
    /// It follows a hit.
    Tracking(ReticlePose),
    /// No hit now: the last pose.
    Holding {
        /// The last pose.
        pose: ReticlePose,
        /// Seconds since the last hit.
        age: f32,
    },
    /// No hit for too long, or never: nothing to draw.
    Lost,
}

/// The cursor.
///
/// ```
/// use glam::Vec3;
/// use isobath::ground::units::Timestamp;
/// use isobath::localized::reticle::{Reticle, ReticleHit, ReticleParams, ReticleState};
/// use isobath::sensing::camera::Pose;
/// let mut reticle = Reticle::new(ReticleParams::DEFAULT)?;
/// let hit = ReticleHit { point: Vec3::Z * 2.0, normal: Some(Vec3::NEG_Z) };
/// let ReticleState::Tracking(pose) = reticle.update(Some(hit), &Pose::IDENTITY, Timestamp::ZERO) else { panic!() };
/// assert!((pose.orientation * Vec3::Z - Vec3::NEG_Z).length() < 1e-6);
/// assert!((pose.orientation * Vec3::X - Vec3::X).length() < 1e-6);
/// let later = Timestamp::from_nanos(500_000_000);
/// assert_eq!(reticle.update(None, &Pose::IDENTITY, later), ReticleState::Holding { pose, age: 0.5 });
/// # Ok::<(), isobath::localized::reticle::ReticleError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reticle {
    params: ReticleParams,
    last: Option<(ReticlePose, Timestamp)>,
    /// What rounding has left out of the last position so far: at 10 km a step is 1 mm.
    rest: Vec3,
}

impl Reticle {
    /// A cursor that has seen nothing.
    ///
    /// # Errors
    /// [`ReticleError`] when a parameter is negative or NaN.
    pub const fn new(params: ReticleParams) -> Result<Self, ReticleError> {
        if !(params.turn_time >= 0.0) {
            return Err(ReticleError { name: "turn_time", value: params.turn_time });
        }
        if !(params.move_time >= 0.0) {
            return Err(ReticleError { name: "move_time", value: params.move_time });
        }
        if !(params.hold >= 0.0) {
            return Err(ReticleError { name: "hold", value: params.hold });
        }
        Ok(Self { params, last: None, rest: Vec3::ZERO })
    }

    /// Takes what is pointed at, if anything, from where the camera stands, at a time. A point that is not finite is no
    /// hit. After a hold that ran out, or when time runs backward, the cursor jumps to the next hit.
    pub fn update(&mut self, hit: Option<ReticleHit>, camera: &Pose, time: Timestamp) -> ReticleState {
        let age = |since: Timestamp| time.seconds_since(since);
        // Negative ages mean a restarted clock: what was is forgotten.
        self.last = self.last.filter(|&(_, since)| (0.0..=self.params.hold).contains(&age(since)));
        let Some(hit) = hit.filter(|h| h.point.is_finite()) else {
            return match self.last {
                Some((pose, since)) => ReticleState::Holding { pose, age: age(since) },
                None => ReticleState::Lost,
            };
        };
        let old = self.last.map(|(pose, _)| pose);
        let orientation = match (hit.normal.and_then(Vec3::try_normalize), old) {
            (None, Some(old)) => old.orientation,
            (None, None) => facing(camera.translation() - hit.point, camera, None),
            (Some(normal), old) => facing(normal, camera, old),
        };
        let (pose, rest) = match self.last {
            None => (ReticlePose { position: hit.point, orientation }, Vec3::ZERO),
            Some((old, since)) => {
                let gone = share(age(since), self.params.move_time);
                let missing = hit.point - old.position;
                let step = self.rest + (missing - self.rest) * gone;
                let position = if gone < 1.0 { old.position + step } else { hit.point };
                let turn = way(old.orientation, orientation) * share(age(since), self.params.turn_time);
                let pose = ReticlePose { position, orientation: turned(old.orientation, turn) };
                (pose, if gone < 1.0 { step - (position - old.position) } else { Vec3::ZERO })
            }
        };
        // Only astronomically distant points can overflow on the way: begin at the hit.
        let (pose, rest) = if pose.position.is_finite() && pose.orientation.is_finite() && rest.is_finite() {
            (pose, rest)
        } else {
            (ReticlePose { position: hit.point, orientation }, Vec3::ZERO)
        };
        self.rest = rest;
        self.last = Some((pose, time));
        ReticleState::Tracking(pose)
    }

    /// The parameters.
    #[must_use]
    pub const fn params(&self) -> &ReticleParams {
        &self.params
    }

    /// Forgets what it saw.
    pub const fn reset(&mut self) {
        self.last = None;
    }
}

/// Share of the way gone in `dt` seconds with a time constant.
fn share(dt: f32, constant: f32) -> f32 {
    // Not 1 - exp: at 10 kHz that loses four digits.
    if constant > 0.0 { -math::exp_m1(-dt / constant) } else { 1.0 }
}

/// z along `normal`; x along the camera's right, or else the old x, or else the camera's down, laid into the surface.
fn facing(normal: Vec3, camera: &Pose, old: Option<ReticlePose>) -> Quat {
    let z = normal.try_normalize().unwrap_or(camera.direction_to_world(Vec3::NEG_Z));
    let shadow = |v: Vec3| {
        let flat = v - z * z.dot(v);
        // Below a tenth the direction is mostly noise of the normal.
        if flat.length() > 0.1 { flat.try_normalize() } else { None }
    };
    let x = shadow(camera.direction_to_world(Vec3::X))
        .or_else(|| old.and_then(|o| shadow(rotate(o.orientation, Vec3::X))))
        .or_else(|| shadow(camera.direction_to_world(Vec3::Y)))
        .unwrap_or_else(|| z.any_orthonormal_vector());
    unit(Quat::from_mat3(&Mat3::from_cols(x, z.cross(x), z)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(seconds).unwrap()
    }

    fn hit(normal: Vec3) -> Option<ReticleHit> {
        Some(ReticleHit { point: Vec3::Z, normal: Some(normal) })
    }

    fn pose(state: ReticleState) -> ReticlePose {
        match state {
            ReticleState::Tracking(p) => p,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_frame_at_thirty_keeps_three_quarters() {
        let mut r = Reticle::new(ReticleParams::DEFAULT).unwrap();
        let (from, to) = (Vec3::NEG_Z, Vec3::new(0.0, -0.6, -0.8));
        r.update(hit(from), &Pose::IDENTITY, at(0.0));
        let now = pose(r.update(hit(to), &Pose::IDENTITY, at(1.0 / 30.0)));
        let left = (now.orientation * Vec3::Z).angle_between(to) / from.angle_between(to);
        assert!((left - 0.75).abs() < 1e-3, "{left}");
    }

    #[test]
    fn the_frame_rate_does_not_matter() {
        let run = |rate: u32| {
            let params = ReticleParams { move_time: 0.2, ..ReticleParams::DEFAULT };
            let mut r = Reticle::new(params).unwrap();
            r.update(hit(Vec3::NEG_Z), &Pose::IDENTITY, at(0.0));
            let target = ReticleHit { point: Vec3::new(1.0, 0.0, 2.0), normal: Some(Vec3::new(0.0, -1.0, -1.0)) };
            let mut last = r.update(None, &Pose::IDENTITY, at(0.0));
            for i in 1..=rate / 5 {
                last = r.update(Some(target), &Pose::IDENTITY, at(f64::from(i) / f64::from(rate)));
            }
            pose(last)
        };
        let (slow, fast) = (run(30), run(120));
        assert!((slow.position - fast.position).length() < 1e-5);
        assert!((slow.orientation * Vec3::Z - fast.orientation * Vec3::Z).length() < 1e-5);
    }

    #[test]
    fn it_holds_over_holes_and_lets_go() {
        let mut r = Reticle::new(ReticleParams::DEFAULT).unwrap();
        assert_eq!(r.update(None, &Pose::IDENTITY, at(0.0)), ReticleState::Lost);
        let first = pose(r.update(hit(Vec3::NEG_Z), &Pose::IDENTITY, at(1.0)));
        let nan = Some(ReticleHit { point: Vec3::NAN, normal: None });
        assert_eq!(r.update(nan, &Pose::IDENTITY, at(1.25)), ReticleState::Holding { pose: first, age: 0.25 });
        // A hit without normal moves it and leaves its orientation.
        let edge = Some(ReticleHit { point: Vec3::X, normal: None });
        let moved = pose(r.update(edge, &Pose::IDENTITY, at(1.5)));
        assert_eq!((moved.position, moved.orientation), (Vec3::X, first.orientation));
        assert!(matches!(r.update(None, &Pose::IDENTITY, at(2.5)), ReticleState::Holding { .. }));
        assert_eq!(r.update(None, &Pose::IDENTITY, at(2.6)), ReticleState::Lost);
        r.update(hit(Vec3::NEG_Z), &Pose::IDENTITY, at(3.0));
        assert_eq!(r.update(None, &Pose::IDENTITY, at(2.9)), ReticleState::Lost, "time ran backward");
        assert!(size_of::<Reticle>() <= 96);
        let bad = Reticle::new(ReticleParams { hold: f32::NAN, ..ReticleParams::DEFAULT });
        assert_eq!(bad.unwrap_err().name, "hold");
    }

    /// Where the camera's right has no shadow on the surface, small noise must not spin the cursor.
    #[test]
    fn x_is_kept_on_surfaces_that_face_sideways() {
        let mut r = Reticle::new(ReticleParams { turn_time: 0.0, ..ReticleParams::DEFAULT }).unwrap();
        let first = pose(r.update(hit(Vec3::new(1.0, 0.0, -0.3)), &Pose::IDENTITY, at(0.0))).orientation * Vec3::X;
        for i in 1..100 {
            let (s, c) = (math::sin(i as f32), math::cos(i as f32));
            let n = Vec3::new(1.0, 0.05 * s, 0.05 * c);
            let x = pose(r.update(hit(n), &Pose::IDENTITY, at(f64::from(i) * 0.03))).orientation * Vec3::X;
            assert!(x.dot(first) > 0.9, "{i}: {x} {first}");
        }
    }

    proptest! {
        #[test]
        fn any_input_gives_a_rigid_pose(
            hits in proptest::collection::vec((proptest::array::uniform3(any::<f32>()), proptest::array::uniform3(any::<f32>()), any::<i64>()), 0..30),
        ) {
            let mut r = Reticle::new(ReticleParams { move_time: 0.1, hold: f32::INFINITY, ..ReticleParams::DEFAULT }).unwrap();
            for (p, n, t) in hits {
                let h = ReticleHit { point: Vec3::from(p), normal: Some(Vec3::from(n)) };
                if let ReticleState::Tracking(p) = r.update(Some(h), &Pose::IDENTITY, Timestamp::from_nanos(t)) {
                    prop_assert!(p.position.is_finite() && p.orientation.is_normalized());
                }
            }
        }
    }
}
