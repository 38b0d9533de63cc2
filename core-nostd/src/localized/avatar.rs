//! How does the paper's avatar hover over the scene?
//!
//! DepthLab, "Avatar Path Planning": the character moves parallel to the ground towards its target; a ray is cast from the
//! top of the character down along gravity; where it hits is the new position; the One-Euro filter calms the result. It
//! climbs whatever is in the way and lower than itself: the paper's avatar hovers over the statue. What should be walked
//! around is the [`planner`](crate::localized::planner)'s to say; its corners make good targets.
//!
//! Where the ray hits nothing (a hole, behind a surface, outside the view), the avatar keeps its height and says so: it is
//! never dropped to a made-up ground.
//!
//! Memory: at most 200 bytes. Cost: one ray cast a step and one filter. Error: that of the ray cast, plus the filter's lag
//! (at rest 1 / (2 pi mincutoff) seconds: 0.16 s by default).

use core::fmt;

use glam::Vec3;

use crate::ground::geometry::Ray;
use crate::ground::math;
use crate::ground::units::Timestamp;
use crate::localized::one_euro::{OneEuro, OneEuroError, OneEuroParams};
use crate::localized::raycast::{RayOutcome, RayParams, cast};
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use crate::skipping::pyramid::Pyramid;

/// Size, pace and calm of an avatar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AvatarParams {
    /// From feet to top, metres, above 0: what is lower is climbed. Default 0.5.
    pub height: f32,
    /// How far below its feet the ground is looked for, metres, 0 or more. Default 3.
    pub drop: f32,
    /// Speed parallel to the ground, metres a second, 0 or more. Default 0.5.
    pub speed: f32,
    /// Longest time that one step makes up for, seconds, above 0: after a pause it walks on, it doesn't leap. Default 0.1.
    pub longest_step: f32,
    /// Within this distance of the target, parallel to the ground, it has arrived; metres, 0 or more. Default 0.01.
    pub arrival: f32,
    /// Thickness and holes of the ray; its length is `height + drop`, whatever is said here.
    pub ray: RayParams,
    /// Calms position. Default: mincutoff 1 Hz, beta 2 Hz a m/s.
    pub filter: OneEuroParams,
}

impl Default for AvatarParams {
    fn default() -> Self {
        Self {
            height: 0.5,
            drop: 3.0,
            speed: 0.5,
            longest_step: 0.1,
            arrival: 0.01,
            ray: RayParams::default(),
            filter: OneEuroParams { beta: 2.0, ..OneEuroParams::DEFAULT },
        }
    }
}

/// An avatar that can't be.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum AvatarError {
    /// The place is not finite.
    BadPlace,
    /// Up has no direction.
    BadUp,
    /// A parameter is out of its documented range.
    BadParam {
        /// The field at fault.
        name: &'static str,
        /// What it was.
        value: f32,
    },
    /// The filter's parameters are out of range.
    Filter(OneEuroError),
}

impl fmt::Display for AvatarError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadPlace => write!(f, "avatar: the place is not finite"),
            Self::BadUp => write!(f, "avatar: up has no length or is not finite"),
            Self::BadParam { name, value } => write!(f, "avatar: {name} = {value} is out of range; see AvatarParams"),
            Self::Filter(e) => write!(f, "avatar: {e}"),
        }
    }
}

impl core::error::Error for AvatarError {}

/// What the avatar stands on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AvatarState {
    /// The ray met a surface.
    OnSurface {
        /// The pixel that sees it.
        pixel: (usize, usize),
        /// The surface is a hole that [`RayParams::holes`] takes as solid.
        from_hole: bool,
    },
    /// No surface could be seen below: the last height is held.
    Hovering {
        /// What became of the ray; never a hit.
        reason: RayOutcome,
        /// Seconds since it last stood on something, or since its first step when it never did.
        held: f32,
    },
    /// The target is not finite: it stays where it is.
    NoTarget,
}

/// One step's answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AvatarStep {
    /// Where to draw the feet: filtered, world, metres.
    pub position: Vec3,
    /// Where the feet are before filtering.
    pub raw: Vec3,
    /// What it stands on.
    pub state: AvatarState,
    /// It is above or below the target.
    pub arrived: bool,
    /// The ray's pixels.
    pub work: Work,
}

/// The avatar.
///
/// ```
/// use glam::vec3;
/// use isobath::ground::units::Timestamp;
/// use isobath::localized::avatar::{Avatar, AvatarParams, AvatarState};
/// use isobath::sensing::{camera::{Intrinsics, Pose}, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// // A floor seen from 2 m above.
/// let depth = DepthArray::<160, 120>::filled(2000);
/// let pose = Pose::looking_at(vec3(0.0, 2.0, 0.0), vec3(0.0, 0.0, 0.0), glam::Vec3::NEG_Z).unwrap();
/// let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, Intrinsics::new(120.0, 120.0, 79.5, 59.5)?).with_pose(pose);
/// let mut avatar = Avatar::new(vec3(0.0, 0.3, 0.0), glam::Vec3::Y, AvatarParams::default())?;
/// let step = avatar.step(&frame, None, vec3(0.5, 0.0, 0.0), Timestamp::ZERO);
/// assert!(matches!(step.state, AvatarState::OnSurface { .. }));
/// assert!(step.position.y.abs() < 1e-4); // it was 0.3 m above the floor
/// let step = avatar.step(&frame, None, vec3(0.5, 0.0, 0.0), Timestamp::from_nanos(100_000_000));
/// assert!((step.raw.x - 0.05).abs() < 1e-4); // 0.1 s at 0.5 m/s
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Avatar {
    params: AvatarParams,
    up: Vec3,
    place: Vec3,
    filter: OneEuro<Vec3>,
    time: Option<Timestamp>,
    /// When it last stood on something (or first stepped).
    stood: Timestamp,
}

impl Avatar {
    /// An avatar with its feet at `place` (world, metres); `up` against gravity, world, any length.
    ///
    /// # Errors
    /// [`AvatarError`] when the place, up or a parameter is out of range.
    pub fn new(place: Vec3, up: Vec3, params: AvatarParams) -> Result<Self, AvatarError> {
        let check = |name, value: f32, positive: bool| {
            let ok = value.is_finite() && value >= 0.0 && !(positive && value == 0.0);
            if ok { Ok(()) } else { Err(AvatarError::BadParam { name, value }) }
        };
        check("height", params.height, true)?;
        check("drop", params.drop, false)?;
        check("speed", params.speed, false)?;
        check("longest_step", params.longest_step, true)?;
        check("arrival", params.arrival, false)?;
        if !place.is_finite() {
            return Err(AvatarError::BadPlace);
        }
        let up = up.try_normalize().ok_or(AvatarError::BadUp)?;
        let filter = OneEuro::new(params.filter).map_err(AvatarError::Filter)?;
        Ok(Self { params, up, place, filter, time: None, stood: Timestamp::ZERO })
    }

    /// Moves towards `target` (world; its height doesn't matter) for the time that passed since the last step (none at the
    /// first, nor when time stands or runs backward), and finds the surface there. The pyramid, if any, must be the frame's.
    pub fn step<D: DepthSample>(
        &mut self,
        frame: &DepthFrame<'_, D>,
        pyramid: Option<&Pyramid<'_, D>>,
        target: Vec3,
        time: Timestamp,
    ) -> AvatarStep {
        let p = &self.params;
        if self.time.is_none_or(|last| time < last) {
            self.stood = time;
        }
        let dt = math::clamp(self.time.map_or(0.0, |last| time.seconds_since(last)), 0.0, p.longest_step);
        self.time = Some(time);

        let way = target - self.place;
        let flat = way - self.up * way.dot(self.up);
        let distance = flat.length();
        // Squares overflow long before the numbers do: beyond that there is no usable target either.
        if !distance.is_finite() {
            let position = self.filter.filter(self.place, time);
            let (raw, state, work) = (self.place, AvatarState::NoTarget, Work::default());
            return AvatarStep { position, raw, state, arrived: false, work };
        }
        let reach = p.speed * dt;
        let moved = if distance <= reach { flat } else { flat * (reach / distance) };
        self.place += moved;

        let mut work = Work::default();
        let params = RayParams { max_distance: p.height + p.drop, ..p.ray };
        let outcome = match Ray::new(self.place + self.up * p.height, -self.up) {
            Some(ray) => {
                let answer = cast(frame, pyramid, &ray, &params);
                work = answer.work;
                answer.outcome
            }
            None => RayOutcome::OutsideView,
        };
        let state = match outcome {
            RayOutcome::Hit(hit) => {
                // Only the height is taken: rounding of the hit must not push it aside.
                self.place += self.up * (hit.point - self.place).dot(self.up);
                self.stood = time;
                AvatarState::OnSurface { pixel: hit.pixel, from_hole: hit.from_hole }
            }
            reason => AvatarState::Hovering { reason, held: time.seconds_since(self.stood) },
        };
        AvatarStep {
            position: self.filter.filter(self.place, time),
            raw: self.place,
            state,
            arrived: distance - moved.length() <= p.arrival,
            work,
        }
    }

    /// Where the feet are before filtering, world, metres.
    #[must_use]
    pub const fn place(&self) -> Vec3 {
        self.place
    }

    /// The parameters.
    #[must_use]
    pub const fn params(&self) -> &AvatarParams {
        &self.params
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::geometry::Plane;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::{Intrinsics, Pose};
    use crate::sensing::depth::DepthUnit;
    use crate::skipping::pyramid::{Cell, cells_needed};
    use glam::{Vec2, vec3};
    use std::vec;
    use std::vec::Vec;

    const W: usize = 160;
    const H: usize = 120;

    fn pose() -> Pose {
        Pose::looking_at(vec3(0.0, 1.6, 0.2), vec3(0.0, 0.0, 2.0), Vec3::Y).unwrap()
    }

    fn camera() -> Intrinsics {
        Intrinsics::new(120.0, 120.0, 79.5, 59.5).unwrap()
    }

    /// A floor y = 0 and a block 0.3 m high, x within 0.25 and z between 1.8 and 2.2.
    fn scene() -> Vec<f32> {
        let floor = Plane::through(Vec3::ZERO, Vec3::Y).unwrap();
        let top = Plane::through(Vec3::Y * 0.3, Vec3::Y).unwrap();
        let front = Plane::through(Vec3::Z * 1.8, Vec3::NEG_Z).unwrap();
        (0..W * H)
            .map(|i| {
                let d = camera().ray(Vec2::new((i % W) as f32, (i / W) as f32));
                let ray = Ray::new(pose().translation(), pose().direction_to_world(d)).unwrap();
                let mut t = floor.intersect(&ray).unwrap_or(f32::INFINITY);
                for (plane, inside) in [(top, 1.8..2.2), (front, 1.79..1.81)] {
                    if let Some(s) = plane.intersect(&ray) {
                        let p = ray.at(s);
                        if p.x.abs() < 0.25 && inside.contains(&p.z) && p.y < 0.3001 {
                            t = t.min(s);
                        }
                    }
                }
                t / d.length()
            })
            .collect()
    }

    fn at(step: u32) -> Timestamp {
        Timestamp::from_nanos(i64::from(step) * 33_333_333)
    }

    #[test]
    fn it_hovers_over_the_block_and_comes_down_again() {
        let data = scene();
        let view = ImageView::new(&data, W, H).unwrap();
        let frame = DepthFrame::new(view, DepthUnit::METRE, camera()).with_pose(pose());
        let mut storage = vec![Cell::EMPTY; cells_needed(W, H)];
        let pyramid = Pyramid::build(view, &mut storage).unwrap();
        let mut avatar = Avatar::new(vec3(-0.7, 0.0, 2.0), Vec3::Y, AvatarParams::default()).unwrap();
        let mut plain = avatar;
        let (mut over, mut beside, mut last) = (0, 0, None);
        for i in 0..200 {
            let target = vec3(0.7, 9.0, 2.0);
            let step = avatar.step(&frame, Some(&pyramid), target, at(i));
            let without = plain.step(&frame, None, target, at(i));
            assert_eq!((step.position, step.state), (without.position, without.state), "the pyramid changes nothing");
            let (x, y) = (step.raw.x, step.raw.y);
            if x.abs() < 0.23 {
                assert!((y - 0.3).abs() < 0.01, "{i}: {step:?}");
                over += 1;
            // Nearer to the block its corner hides the ray's lower part: there the ray hits the side of a step.
            } else if x.abs() > 0.35 && matches!(step.state, AvatarState::OnSurface { .. }) {
                assert!(y.abs() < 0.01, "{i}: {step:?}");
                beside += 1;
            }
            assert!((step.raw.z - 2.0).abs() < 1e-5, "it keeps its line");
            if let Some(last) = last {
                assert!(step.position.distance(last) < 0.3, "filtered: no leap");
            }
            last = Some(step.position);
        }
        assert!(over > 20 && beside > 40, "{over} {beside}");
        let end = avatar.step(&frame, None, vec3(0.7, 0.0, 2.0), at(200));
        assert!(end.arrived && (end.position - vec3(0.7, 0.0, 2.0)).length() < 0.01, "{end:?}");
    }

    #[test]
    fn without_a_surface_it_holds_its_height_and_says_so() {
        let data = vec![0.0_f32; W * H];
        let frame = DepthFrame::new(ImageView::new(&data, W, H).unwrap(), DepthUnit::METRE, camera()).with_pose(pose());
        let mut avatar = Avatar::new(vec3(-0.5, 0.4, 2.0), Vec3::Y, AvatarParams::default()).unwrap();
        let target = vec3(0.5, 0.0, 2.0);
        avatar.step(&frame, None, target, at(0));
        let step = avatar.step(&frame, None, target, at(3));
        assert!(
            matches!(step.state, AvatarState::Hovering { reason: RayOutcome::NoDepth, held } if held > 0.09),
            "{step:?}"
        );
        assert!((step.raw - vec3(-0.45, 0.4, 2.0)).length() < 1e-5);
        // A long pause is not made up for, and time that runs back moves nothing.
        let step = avatar.step(&frame, None, target, at(300));
        assert!((step.raw.x + 0.4).abs() < 1e-5, "{step:?}");
        let back = avatar.step(&frame, None, target, at(2));
        assert_eq!(back.raw, step.raw);
        assert!(matches!(back.state, AvatarState::Hovering { held: 0.0, .. }));
    }

    #[test]
    fn hostile_input_is_answered() {
        let p = AvatarParams::default();
        assert_eq!(Avatar::new(Vec3::NAN, Vec3::Y, p).unwrap_err(), AvatarError::BadPlace);
        assert_eq!(Avatar::new(Vec3::ZERO, Vec3::ZERO, p).unwrap_err(), AvatarError::BadUp);
        for (bad, field) in [
            (AvatarParams { height: 0.0, ..p }, "height"),
            (AvatarParams { speed: f32::NAN, ..p }, "speed"),
            (AvatarParams { longest_step: 0.0, ..p }, "longest_step"),
        ] {
            let e = Avatar::new(Vec3::ZERO, Vec3::Y, bad).unwrap_err();
            assert!(matches!(e, AvatarError::BadParam { name, .. } if name == field), "{e}");
        }
        let filter = OneEuroParams { min_cutoff: 0.0, ..OneEuroParams::DEFAULT };
        assert!(matches!(Avatar::new(Vec3::ZERO, Vec3::Y, AvatarParams { filter, ..p }), Err(AvatarError::Filter(_))));
        let empty = DepthFrame::<u16>::new(ImageView::EMPTY, DepthUnit::MILLIMETRE, camera());
        let mut avatar = Avatar::new(Vec3::Z, Vec3::NEG_Y, p).unwrap();
        for (i, target) in [Vec3::NAN, Vec3::MAX, Vec3::ZERO, Vec3::Z, Vec3::INFINITY].into_iter().enumerate() {
            let step = avatar.step(&empty, None, target, at(i as u32));
            assert!(step.position.is_finite() && step.raw.is_finite());
            assert!(!matches!(step.state, AvatarState::OnSurface { .. }));
            assert_eq!(step.state == AvatarState::NoTarget, !target.length().is_finite(), "{target}");
        }
        assert!(size_of::<Avatar>() <= 200);
    }
}
