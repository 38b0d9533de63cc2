//! Is there a flat enough, large enough, free spot here for a box? Box placement as current headsets offer it; DepthLab's
//! collision-aware placement asks about a box that already has its place, this finds the place.
//!
//! 1. *Support*: a plane is fitted by least squares to the readings seen through a grid over the footprint, three times,
//!    each time leaving out what lies off the last plane. It must not tilt or deviate too much, and enough of the
//!    footprint's cells must lie on it ([`Placement::coverage`]): a table's edge or a hole in the data makes it too small.
//! 2. *Room*: for every pixel that looks through the box, either the reading lies beyond the box, or on the support, or
//!    the place is blocked: something is in the box, or stands before it and hides what is in it. The whole box must be in
//!    the view; pixels without a reading mean what [`PlaceParams::holes`] says.
//!
//! [`search`] tries many spots and keeps the best.
//!
//! Memory: none. Cost: 432 readings for the plane, 64 for the coverage, and each pixel of the box's projection once;
//! a [`Pyramid`] saves the pixels of tiles that lie wholly beyond the box, and changes no answer. About 30 µs on a desktop
//! core at 160 x 120, 5 ms for a search of 300 spots. Error: something
//! narrower than a pixel, or lower than [`PlaceParams::clearance`], is not seen.

pub mod search;
#[cfg(test)]
mod tests;

use core::fmt;

use glam::{Mat3, Quat, Vec2, Vec3};

use crate::ground::geometry::{OrientedBox, Plane};
use crate::ground::math;
use crate::ground::rotation::{rotate, rotate_back};
use crate::localized::normals::{NormalParams, normal_at};
use crate::localized::plane::{PlaneEstimate, PlaneSum};
use crate::sensing::depth::{DepthSample, HolePolicy};
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use crate::skipping::pyramid::{FINEST_TILE, Pyramid};

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

/// Samples across the footprint in each direction: for the plane, and for the coverage.
const FIT_GRID: usize = 12;
const COVER_GRID: usize = 8;

fn try_place<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pyramid: Option<&Pyramid<'_, D>>,
    spot: Spot,
    params: &PlaceParams,
    work: &mut Work,
) -> Result<Placement, NoPlace> {
    let size = params.size;
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
    let seen = frame.world_point(x, y).ok_or(NoPlace::NoSurface)?;
    let middle = match spot {
        Spot::World(point) if (point - seen).length() > reach => return Err(NoPlace::NoSurface),
        Spot::World(point) => point,
        Spot::Pixel(..) => seen,
    };
    let support = fit_support(frame, (x, y), middle, seen, up, reach, params, work)?;
    let plane = support.plane;
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
    let footprint = Footprint::new(frame, plane.project(middle), standing, params).ok_or(NoPlace::NoSurface)?;
    let clearance = params.clearance.max(3.0 * support.rms);
    let on_plane = |p: Vec3| plane.distance(p).abs() <= clearance;
    let covered = footprint.grid::<COVER_GRID>().filter(|p| {
        // The point of the plane under this cell of the footprint.
        read(frame, plane.project(*p), work).is_some_and(on_plane)
    });
    let coverage = covered.count() as f32 / (COVER_GRID * COVER_GRID) as f32;
    if !(coverage >= params.min_coverage) {
        return Err(NoPlace::TooSmall { coverage });
    }
    let pose = footprint.standing_on(&plane, size);
    check_room(frame, pyramid.filter(|p| p.size() == frame.size()), &pose, &plane, clearance, params, work)?;
    Ok(Placement { pose, plane, flatness: support.rms, tilt, coverage })
}

/// The reading in the direction of a world point, as a world point.
fn read<D: DepthSample>(frame: &DepthFrame<'_, D>, point: Vec3, work: &mut Work) -> Option<Vec3> {
    let (x, y) = frame.pixel_of_world(point)?;
    work.done = work.done.saturating_add(1);
    frame.world_point(x, y)
}

/// The plane of the readings under the footprint.
fn fit_support<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pixel: (usize, usize),
    middle: Vec3,
    seen: Vec3,
    up: Vec3,
    reach: f32,
    params: &PlaceParams,
    work: &mut Work,
) -> Result<PlaneEstimate, NoPlace> {
    let pose = frame.pose_or_identity();
    let normal = normal_at(frame, pixel.0, pixel.1, &NormalParams::POINT)
        .map_or(up, |estimate| pose.direction_to_world(estimate.normal));
    let mut plane = Plane::through(seen, normal).ok_or(NoPlace::NoSurface)?;
    // First what the local normal's error may leave off, then what noise may.
    let mut gate = 0.1 * reach + 2.0 * params.max_roughness;
    let mut fit = Err(NoPlace::NoSurface);
    // The foot of a post among the readings pulls the first plane off: each round lets less of it in.
    for _ in 0..5 {
        let footprint =
            Footprint::new(frame, plane.project(middle), plane.normal(), params).ok_or(NoPlace::NoSurface)?;
        let mut sum = PlaneSum::new();
        for point in footprint.grid::<FIT_GRID>() {
            if let Some(p) = read(frame, point, work).filter(|p| plane.distance(*p).abs() <= gate) {
                sum.add(p);
            }
        }
        let better = sum.fit(pose.translation() - seen).map_err(|_| NoPlace::NoSurface)?;
        plane = better.plane;
        // Hopeless already: a wall.
        if math::acos(plane.normal().dot(up)) > 2.0 * params.max_tilt + 0.3 {
            return Ok(better);
        }
        gate = gate.min((3.0 * better.rms).max(0.5 * params.max_roughness));
        fit = Ok(better);
    }
    fit
}

/// A rectangle with its axes: the underside of the box.
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

    /// The middles of N by N cells.
    fn grid<const N: usize>(&self) -> impl Iterator<Item = Vec3> + '_ {
        let place = |i: usize| (2 * i + 1) as f32 / N as f32 - 1.0;
        (0..N * N).map(move |i| self.at(place(i % N), place(i / N)))
    }

    /// The box whose lowest corner touches the plane.
    fn standing_on(&self, plane: &Plane, size: Vec3) -> OrientedBox {
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
        let lowest = corners.iter().fold(0.0_f32, |low, (x, z)| low.min(plane.distance(self.at(*x, *z))));
        let up = rotate(self.rotation, Vec3::Y);
        OrientedBox { centre: self.middle + up * (0.5 * size.y - lowest), half: 0.5 * size, rotation: self.rotation }
    }
}

/// Looks through every pixel of the box.
fn check_room<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pyramid: Option<&Pyramid<'_, D>>,
    room: &OrientedBox,
    plane: &Plane,
    clearance: f32,
    params: &PlaceParams,
    work: &mut Work,
) -> Result<(), NoPlace> {
    let pose = frame.pose_or_identity();
    let (mut low, mut high, mut farthest) = ((usize::MAX, usize::MAX), (0, 0), 0.0_f32);
    for corner in room.corners() {
        let corner = pose.to_camera(corner);
        let (x, y) = frame.pixel_of(corner).ok_or(NoPlace::OutsideView)?;
        low = (low.0.min(x), low.1.min(y));
        high = (high.0.max(x), high.1.max(y));
        farthest = farthest.max(corner.z);
    }
    // From here on in the box's own axes, in parts of its half size: the box is the cube from -1 to 1.
    let to_box = |v: Vec3| rotate_back(room.rotation, v) / room.half;
    let eye = to_box(pose.translation() - room.centre);
    // The ray of a pixel, and where it leaves the box.
    let through_box = |x: usize, y: usize| {
        let way = pose.direction_to_world(frame.intrinsics().ray(Vec2::new(x as f32, y as f32)));
        leaves_cube(eye, to_box(way)).map(|z| (way, z))
    };
    let tiles = || {
        let columns = low.0 / FINEST_TILE..=high.0 / FINEST_TILE;
        (low.1 / FINEST_TILE..=high.1 / FINEST_TILE).flat_map(move |y| columns.clone().map(move |x| (x, y)))
    };
    // The tile's pixels within the box's projection.
    let pixels = |(tx, ty): (usize, usize)| {
        let within = |tile: usize, low: usize, high: usize| {
            let first = tile * FINEST_TILE;
            first.max(low)..(first + FINEST_TILE).min(high + 1)
        };
        (within(tx, low.0, high.0), within(ty, low.1, high.1))
    };
    // No reading of the tile is nearer than the box's far end: nothing to see there.
    let beyond = |(tx, ty): (usize, usize)| {
        pyramid.and_then(|p| p.cell(0, tx, ty)).is_some_and(|cell| {
            let (near, far) = (cell.min.metres(frame.unit()), cell.max.metres(frame.unit()));
            cell.holes == 0 && near >= farthest && far > 0.0
        })
    };
    let (mut through, mut hidden, mut holes) = (0_u32, 0_u32, 0_u32);
    for tile in tiles() {
        let (columns, rows) = pixels(tile);
        let count = (columns.len() * rows.len()) as u32;
        if beyond(tile) {
            work.skipped = work.skipped.saturating_add(count);
            continue;
        }
        work.done = work.done.saturating_add(count);
        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
            let Some((way, leaves)) = through_box(x, y) else { continue };
            through += 1;
            let z = frame.z(x, y);
            if z == 0.0 {
                holes += 1;
            } else if z < leaves && plane.distance(pose.translation() + way * z) > clearance {
                hidden += 1;
            }
        }
    }
    // The shares are of all pixels; without anything hidden or unknown they are 0 however many there are.
    if through == 0 || hidden + holes > 0 {
        for tile in tiles().filter(|tile| beyond(*tile)) {
            let (columns, rows) = pixels(tile);
            let inside = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
            through += inside.filter(|(x, y)| through_box(*x, *y).is_some()).count() as u32;
        }
    }
    let share = |n: u32| if through > 0 { n as f32 / through as f32 } else { 0.0 };
    match params.holes {
        HolePolicy::Solid => hidden += holes,
        HolePolicy::Unknown if !(share(holes) <= params.max_unknown) => {
            return Err(NoPlace::Unknown { holes: share(holes) });
        }
        HolePolicy::Unknown | HolePolicy::Free => {}
    }
    // A box that no pixel looks through is smaller than a pixel: nothing is known of it.
    if through == 0 {
        return Err(NoPlace::Unknown { holes: 1.0 });
    }
    if share(hidden) <= params.max_hidden { Ok(()) } else { Err(NoPlace::Blocked { hidden: share(hidden) }) }
}

/// Where a ray from outside or inside leaves the cube from -1 to 1, in lengths of `way`; `None` when it misses.
fn leaves_cube(eye: Vec3, way: Vec3) -> Option<f32> {
    // A zero component gives infinities of the right sign; NaN only in the plane of a face, where either answer is right.
    let (a, b) = ((-Vec3::ONE - eye) / way, (Vec3::ONE - eye) / way);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    (leave > 0.0 && enter <= leave).then_some(leave)
}
