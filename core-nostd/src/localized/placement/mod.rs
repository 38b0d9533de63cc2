//! Is there a flat enough, large enough, free spot here for a box? Box placement as current headsets offer it; DepthLab's
//! collision-aware placement asks about a box that already has its place, this finds the place.
//!
//! 1. *Support*: a plane is fitted by least squares to the readings seen through a grid over the footprint, up to seven
//!    times, each time leaving out what lies off the last plane. It must not tilt or deviate too much, and enough of the
//!    footprint's cells must lie on it ([`Placement::coverage`]): a table's edge or a hole in the data makes it too small.
//! 2. *Room*: for every pixel that looks through the box, either the reading lies beyond the box, or on the support, or
//!    the place is blocked: something is in the box, or stands before it and hides what is in it. The whole box must be in
//!    the view; pixels without a reading mean what [`PlaceParams::holes`] says.
//!
//! [`search`] tries many spots and keeps the best.
//!
//! Memory: none. Cost: 180 to 684 readings for the plane, 64 for the coverage, and each pixel of the box's projection once;
//! a [`Pyramid`] saves the pixels of tiles that lie wholly beyond the box, and changes no answer. About 30 µs on a desktop
//! core at 160 x 120, 5 ms for a search of 300 spots. Error: something
//! narrower than a pixel, or lower than [`PlaceParams::clearance`], is not seen.

mod room;
pub mod search;
mod support;
#[cfg(test)]
mod tests;

use core::fmt;

use glam::{Mat3, Quat, Vec3};

use crate::ground::geometry::{OrientedBox, Plane};
use crate::ground::math;
use crate::ground::rotation::rotate;
use crate::sensing::depth::{DepthSample, HolePolicy};
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use crate::skipping::pyramid::Pyramid;

/// Which way the box's own z axis looks.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Facing {
    /// Towards the camera.
    #[default]
    Camera,
    /// Along a world direction of any length; its part along the box's up axis does not matter.
    Along(Vec3),
}

/// Which way the box's own y axis points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Stand {
    /// Along the support's normal: it lies flat on what it stands on.
    #[default]
    OnSurface,
    /// Straight up; on a tilted support it touches with an edge or a corner.
    Upright,
}

/// What place is wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaceParams {
    /// The box along its own axes, metres: width, height, depth. 1e-3 to 1e3.
    pub size: Vec3,
    /// Which way is up in the world; any length but zero.
    pub up: Vec3,
    /// Default towards the camera.
    pub facing: Facing,
    /// Default on the surface.
    pub stand: Stand,
    /// Largest angle between the support's normal and up, radians. Default 0.17 (10 degrees).
    pub max_tilt: f32,
    /// Largest RMS distance of the support's readings from its plane, metres. Default 0.015.
    pub max_roughness: f32,
    /// Least share of the footprint that must lie on the support, 0 to 1. Default 0.8.
    pub min_coverage: f32,
    /// What rises above the support by less than this is part of it, metres. Default 0.02; three times the measured
    /// roughness when that is more.
    pub clearance: f32,
    /// Largest share of the box's pixels that may hold something in or before the box, 0 to 1. Default 0: none. Sensors
    /// with flying pixels at edges want 0.02.
    pub max_hidden: f32,
    /// Largest share of the box's pixels that may be holes under [`HolePolicy::Unknown`], 0 to 1. Default 0.2.
    pub max_unknown: f32,
    /// What a hole means. Default [`HolePolicy::Unknown`]: counted by itself. `Solid`: as something in the box. `Free`: as
    /// nothing. To the coverage a hole never is support.
    pub holes: HolePolicy,
}

impl PlaceParams {
    /// For a box of a size (metres) in a world with an up direction.
    #[must_use]
    pub const fn new(size: Vec3, up: Vec3) -> Self {
        Self {
            size,
            up,
            facing: Facing::Camera,
            stand: Stand::OnSurface,
            max_tilt: 0.17,
            max_roughness: 0.015,
            min_coverage: 0.8,
            clearance: 0.02,
            max_hidden: 0.0,
            max_unknown: 0.2,
            holes: HolePolicy::Unknown,
        }
    }
}

/// Where a place is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Spot {
    /// On the surface seen at a pixel: column, row.
    Pixel(usize, usize),
    /// On the surface seen at a world point, metres; at most half the footprint's diagonal from it.
    World(Vec3),
}

/// A place for the box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// The box in the world: y up, z facing; it stands on the support.
    pub pose: OrientedBox,
    /// The support in the world, its normal up.
    pub plane: Plane,
    /// RMS distance of the support's readings from the plane, metres.
    pub flatness: f32,
    /// Angle between the support's normal and up, radians.
    pub tilt: f32,
    /// Share of the footprint that lies on the support, 0 to 1.
    pub coverage: f32,
}

/// Why there is no place.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum NoPlace {
    /// The size is not within 1e-3 to 1e3 m on every axis.
    BadSize,
    /// The up direction has no length or is not finite.
    BadUp,
    /// The spot, or a corner of the box, is not in the view.
    OutsideView,
    /// No surface is seen there, or too little of it to know its plane.
    NoSurface,
    /// The surface is too steep.
    TooSteep {
        /// Angle between its normal and up, radians.
        tilt: f32,
    },
    /// The surface is too rough.
    TooRough {
        /// RMS distance of readings from its plane, metres.
        flatness: f32,
    },
    /// The surface ends, or is not seen, within the footprint.
    TooSmall {
        /// Share of the footprint that lies on it, 0 to 1.
        coverage: f32,
    },
    /// Something is in the box, or hides part of it.
    Blocked {
        /// Share of the box's pixels where that is so, 0 to 1.
        hidden: f32,
    },
    /// Too many of the box's pixels have no reading.
    Unknown {
        /// Their share, 0 to 1.
        holes: f32,
    },
}

impl fmt::Display for NoPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f32| share * 100.0;
        match self {
            Self::BadSize => write!(f, "the box must measure 1 mm to 1 km along each axis"),
            Self::BadUp => write!(f, "the up direction has no length or is not finite"),
            Self::OutsideView => write!(f, "the box would not be wholly in the view"),
            Self::NoSurface => write!(f, "no surface is seen there"),
            Self::TooSteep { tilt } => write!(f, "the surface tilts by {:.1} degrees", tilt.to_degrees()),
            Self::TooRough { flatness } => write!(f, "the surface deviates by {flatness} m RMS from a plane"),
            Self::TooSmall { coverage } => {
                write!(f, "the surface is seen under only {:.0} % of the footprint", percent(*coverage))
            }
            Self::Blocked { hidden } => {
                write!(f, "something is in or before {:.0} % of the box's pixels", percent(*hidden))
            }
            Self::Unknown { holes } => write!(f, "{:.0} % of the box's pixels have no reading", percent(*holes)),
        }
    }
}

impl core::error::Error for NoPlace {}

/// The answer and its cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaceAnswer {
    /// The place, or why there is none.
    pub outcome: Result<Placement, NoPlace>,
    /// Pixels read, and pixels that the pyramid saved.
    pub work: Work,
}

/// Whether the box fits at a spot, and how it stands there. A pyramid of another size than the frame's is ignored; it must
/// have been built from this frame's depth.
///
/// ```
/// use glam::{vec3, Vec3};
/// use isobath::localized::placement::{place, PlaceParams, Spot};
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// // Looking at a table top from straight above: up is towards the camera.
/// static TABLE: DepthArray<160, 120> = DepthArray::filled(1000);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let frame = DepthFrame::new(TABLE.view(), DepthUnit::MILLIMETRE, k);
/// let params = PlaceParams::new(vec3(0.2, 0.1, 0.2), Vec3::NEG_Z);
/// let spot = place(&frame, None, Spot::Pixel(80, 60), &params).outcome?;
/// assert!((spot.pose.centre.z - 0.95).abs() < 1e-4); // half its height above the table
/// assert_eq!(spot.coverage, 1.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn place<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pyramid: Option<&Pyramid<'_, D>>,
    spot: Spot,
    params: &PlaceParams,
) -> PlaceAnswer {
    let mut work = Work::default();
    let outcome = try_place(frame, pyramid, spot, params, &mut work);
    PlaceAnswer { outcome, work }
}

fn try_place<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pyramid: Option<&Pyramid<'_, D>>,
    spot: Spot,
    params: &PlaceParams,
    work: &mut Work,
) -> Result<Placement, NoPlace> {
    let (size, pose) = (params.size, frame.pose_or_identity());
    // The least of numbers and a NaN is a number: asked by itself.
    if !(size.is_finite() && size.min_element() >= 1e-3 && size.max_element() <= 1e3) {
        return Err(NoPlace::BadSize);
    }
    let up = params.up.try_normalize().ok_or(NoPlace::BadUp)?;
    let reach = 0.5 * math::sqrt(size.x * size.x + size.z * size.z);
    let (x, y) = match spot {
        Spot::Pixel(x, y) => (x, y),
        Spot::World(point) => frame.pixel_of_world(point).ok_or(NoPlace::OutsideView)?,
    };
    if x >= frame.size().0 || y >= frame.size().1 {
        return Err(NoPlace::OutsideView);
    }
    // In the camera's frame, where readings are, until the box is placed.
    let seen = frame.point(x, y).ok_or(NoPlace::NoSurface)?;
    let middle = match spot {
        Spot::World(point) => pose.to_camera(point),
        Spot::Pixel(..) => seen,
    };
    if (middle - seen).length() > reach {
        return Err(NoPlace::NoSurface);
    }
    let up_seen = pose.direction_to_camera(up);
    let support = support::fit(frame, (x, y), middle, seen, up_seen, params, work)?;
    let plane = support.plane.transformed(pose.rotation(), pose.translation());
    let tilt = math::acos(plane.normal().dot(up));
    if !(tilt <= params.max_tilt) {
        return Err(NoPlace::TooSteep { tilt });
    }
    if !(support.rms <= params.max_roughness) {
        return Err(NoPlace::TooRough { flatness: support.rms });
    }
    let standing = match params.stand {
        Stand::OnSurface => plane.normal(),
        Stand::Upright => up,
    };
    let clearance = params.clearance.max(3.0 * support.rms);
    let coverage = support.coverage(frame, middle, pose.direction_to_camera(standing), clearance, params, work);
    let coverage = coverage.ok_or(NoPlace::NoSurface)?;
    if !(coverage >= params.min_coverage) {
        return Err(NoPlace::TooSmall { coverage });
    }
    let foot = pose.to_world(support.plane.project(middle));
    let footprint = Footprint::new(frame, foot, standing, params).ok_or(NoPlace::NoSurface)?;
    let stood = footprint.standing_on(&plane, size);
    let pyramid = pyramid.filter(|p| p.size() == frame.size());
    room::check(frame, pyramid, &stood, &support.plane, clearance, params, work)?;
    Ok(Placement { pose: stood, plane, flatness: support.rms, tilt, coverage })
}

/// A rectangle with its axes, in the world: the underside of the box.
struct Footprint {
    middle: Vec3,
    rotation: Quat,
    half: (f32, f32),
}

impl Footprint {
    fn new<D: DepthSample>(frame: &DepthFrame<'_, D>, middle: Vec3, up: Vec3, params: &PlaceParams) -> Option<Self> {
        let facing = match params.facing {
            Facing::Camera => frame.pose_or_identity().translation() - middle,
            Facing::Along(direction) => direction,
        };
        let flat = (facing - up * facing.dot(up)).try_normalize();
        // Seen from straight above, or asked to face up: any direction will do.
        let z = flat.unwrap_or_else(|| up.any_orthonormal_vector());
        let rotation = Quat::from_mat3(&Mat3::from_cols(up.cross(z), up, z));
        let half = (0.5 * params.size.x, 0.5 * params.size.z);
        (middle.is_finite() && rotation.is_finite()).then_some(Self { middle, rotation, half })
    }

    fn at(&self, x: f32, z: f32) -> Vec3 {
        self.middle + rotate(self.rotation, Vec3::new(x * self.half.0, 0.0, z * self.half.1))
    }

    /// The box whose lowest corner touches the plane.
    fn standing_on(&self, plane: &Plane, size: Vec3) -> OrientedBox {
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
        let lowest = corners.iter().fold(0.0_f32, |low, (x, z)| low.min(plane.distance(self.at(*x, *z))));
        let up = rotate(self.rotation, Vec3::Y);
        OrientedBox { centre: self.middle + up * (0.5 * size.y - lowest), half: 0.5 * size, rotation: self.rotation }
    }
}
