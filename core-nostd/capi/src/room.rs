//! Does this box collide, and where does it stand? See the core's `collision` and `placement`.

use isobath::glam;
use isobath::localized::collision::{CollisionParams, Verdict as CoreVerdict, box_points, vote};
use isobath::localized::placement::{Facing, NoPlace, PlaceParams, Spot, Stand, place};

use crate::check::{Plain, answer, read, read_or};
use crate::context::{Context, View};
use crate::status::Status;
use crate::types::{Box3, Holes, Vec3};

/// How isobath_vote votes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoteParams {
    /// Up in the world, any length but 0: tells the box's sides from its top. Default 0 1 0.
    pub up: Vec3,
    /// How far behind a reading a point still counts as visible, metres. Default 0.12.
    pub tolerance: f32,
    /// Share of hidden votes from which the box is blocked, 0 to 1. Default 0.5.
    pub threshold: f32,
    /// Share of the points that must vote, 0 to 1. Default 0.5.
    pub min_voters: f32,
    /// An isobath_holes: what a pixel without a reading votes. Default unknown: nothing.
    pub holes: i32,
}

// SAFETY: `repr(C)`, numbers of four bytes alone.
unsafe impl Plain for VoteParams {}

impl VoteParams {
    fn standard() -> Self {
        let CollisionParams { tolerance, threshold, min_voters, .. } = CollisionParams::default();
        let up = Vec3 { x: 0.0, y: 1.0, z: 0.0 };
        Self { up, tolerance, threshold, min_voters, holes: Holes::Unknown as i32 }
    }
}

/// Whether there is room.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Enough of the box would be visible.
    Free = 0,
    /// Enough of it would be hidden in or behind what is there.
    Blocked = 1,
    /// Too few of its points could be judged.
    Unknown = 2,
}

/// The answer of isobath_vote: a verdict and the thirteen votes it rests on.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vote {
    /// The answer.
    pub verdict: Verdict,
    /// Points in front of the reading, or behind it within the tolerance.
    pub visible: u32,
    /// Points further behind the reading.
    pub hidden: u32,
    /// Points on pixels without a reading.
    pub holes: u32,
    /// Points outside the image.
    pub outside: u32,
    /// Points not in front of the camera.
    pub behind_camera: u32,
}

/// Writes the defaults.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_vote_defaults(params: *mut VoteParams) -> Status {
    // SAFETY: promised by the caller.
    unsafe { answer(params, || Ok(VoteParams::standard())) }
}

/// Does a box collide with what is seen? By majority of its corners, middle and sides. `params`: null for the defaults.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_vote(
    context: *const Context,
    object: *const Box3,
    params: *const VoteParams,
    verdict: *mut Vote,
) -> Status {
    let ask = || {
        // SAFETY: promised by the caller.
        let (context, object, params) =
            unsafe { (View::open(context)?, read(object)?, read_or(params, VoteParams::standard())?) };
        let (frame, object) = (context.frame()?, object.core()?);
        let VoteParams { up, tolerance, threshold, min_voters, holes } = params;
        let holes = Holes::policy(holes)?;
        let up = glam::Vec3::from(up);
        let share = |n: f32| (0.0..=1.0).contains(&n);
        if !(tolerance >= 0.0 && share(threshold) && share(min_voters) && up.is_finite()) || up == glam::Vec3::ZERO {
            return Err(Status::ErrorParameter);
        }
        let params = CollisionParams { tolerance, threshold, min_voters, holes };
        let found = vote(&frame, box_points(&object, up), &params);
        let verdict = match found.verdict {
            CoreVerdict::Free => Verdict::Free,
            CoreVerdict::Blocked => Verdict::Blocked,
            CoreVerdict::Unknown => Verdict::Unknown,
        };
        let tally = found.tally;
        Ok(Vote {
            verdict,
            visible: tally.visible,
            hidden: tally.hidden,
            holes: tally.holes,
            outside: tally.outside,
            behind_camera: tally.behind_camera,
        })
    };
    // SAFETY: promised by the caller.
    unsafe { answer(verdict, ask) }
}

/// What place isobath_place looks for.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaceWish {
    /// Half of the box's width, height and depth, metres, 0.0005 to 500. No default.
    pub half: Vec3,
    /// Up in the world, any length but 0. Default 0 1 0.
    pub up: Vec3,
    /// Where the box's z axis looks, a world direction; 0 0 0, the default: towards the camera.
    pub facing: Vec3,
    /// 0, the default: it lies flat on its support; 1: it stands straight up, whatever the support's tilt.
    pub upright: i32,
    /// Largest angle between the support's normal and up, radians. Default 0.17.
    pub max_tilt: f32,
    /// Largest RMS distance of the support's readings from its plane, metres. Default 0.015.
    pub max_roughness: f32,
    /// Least share of the footprint that lies on the support, 0 to 1. Default 0.8.
    pub min_coverage: f32,
    /// What rises above the support by less is part of it, metres. Default 0.02.
    pub clearance: f32,
    /// Largest share of the box's pixels that may hold something in or before it, 0 to 1. Default 0.
    pub max_hidden: f32,
    /// Largest share of the box's pixels that may be holes, 0 to 1. Default 0.2.
    pub max_unknown: f32,
    /// An isobath_holes. Default unknown: counted against max_unknown.
    pub holes: i32,
}

// SAFETY: `repr(C)`, numbers of four bytes alone.
unsafe impl Plain for PlaceWish {}

impl PlaceWish {
    fn standard() -> Self {
        let core = PlaceParams::new(glam::Vec3::ZERO, glam::Vec3::Y);
        Self {
            half: Vec3::default(),
            up: core.up.into(),
            facing: Vec3::default(),
            upright: 0,
            max_tilt: core.max_tilt,
            max_roughness: core.max_roughness,
            min_coverage: core.min_coverage,
            clearance: core.clearance,
            max_hidden: core.max_hidden,
            max_unknown: core.max_unknown,
            holes: Holes::Unknown as i32,
        }
    }

    fn core(&self) -> Result<PlaceParams, Status> {
        let facing = glam::Vec3::from(self.facing);
        let limits =
            [self.max_tilt, self.max_roughness, self.min_coverage, self.clearance, self.max_hidden, self.max_unknown];
        if !(limits.iter().all(|n| *n >= 0.0) && facing.is_finite()) {
            return Err(Status::ErrorParameter);
        }
        Ok(PlaceParams {
            size: glam::Vec3::from(self.half) * 2.0,
            up: self.up.into(),
            facing: if facing == glam::Vec3::ZERO { Facing::Camera } else { Facing::Along(facing) },
            stand: match self.upright {
                0 => Stand::OnSurface,
                1 => Stand::Upright,
                _ => return Err(Status::ErrorParameter),
            },
            max_tilt: self.max_tilt,
            max_roughness: self.max_roughness,
            min_coverage: self.min_coverage,
            clearance: self.clearance,
            max_hidden: self.max_hidden,
            max_unknown: self.max_unknown,
            holes: Holes::policy(self.holes)?,
        })
    }
}

/// Whether there is a place.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlaceOutcome {
    /// There is.
    Found = 0,
    /// The spot, or a corner of the box, is not in the view.
    OutsideView = 1,
    /// No surface is seen there, or too little of it.
    NoSurface = 2,
    /// The surface is too steep: see `tilt`.
    TooSteep = 3,
    /// The surface is too rough: see `flatness`.
    TooRough = 4,
    /// The surface ends, or is not seen, within the footprint: see `coverage`.
    TooSmall = 5,
    /// Something is in the box, or hides part of it: see `hidden`.
    Blocked = 6,
    /// Too many of the box's pixels have no reading: see `unknown`.
    Unknown = 7,
    /// Another reason, which this interface does not know yet.
    Other = 8,
}

/// The answer of isobath_place; what does not apply is 0.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Whether there is a place, or why not.
    pub outcome: PlaceOutcome,
    /// Found: the box in the world, y up, z facing, standing on its support.
    pub pose: Box3,
    /// Found: the support's normal in the world, up.
    pub plane_normal: Vec3,
    /// Found: a point of the support, world, metres.
    pub plane_point: Vec3,
    /// RMS distance of the support's readings from its plane, metres.
    pub flatness: f32,
    /// Angle between the support's normal and up, radians.
    pub tilt: f32,
    /// Share of the footprint that lies on the support, 0 to 1.
    pub coverage: f32,
    /// Share of the box's pixels that hold something in or before it, 0 to 1.
    pub hidden: f32,
    /// Share of the box's pixels without a reading, 0 to 1.
    pub unknown: f32,
}

/// Writes the defaults; set `half` afterwards.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_place_defaults(wish: *mut PlaceWish) -> Status {
    // SAFETY: promised by the caller.
    unsafe { answer(wish, || Ok(PlaceWish::standard())) }
}

/// Does a box fit on the surface seen at a pixel, and how does it stand there?
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_place(
    context: *const Context,
    x: u32,
    y: u32,
    wish: *const PlaceWish,
    found: *mut Place,
) -> Status {
    let find = || {
        // SAFETY: promised by the caller.
        let (context, wish) = unsafe { (View::open(context)?, read(wish)?) };
        let (frame, pyramid, wish) = (context.frame()?, context.pyramid()?, wish.core()?);
        let nothing = Place {
            outcome: PlaceOutcome::Other,
            pose: Box3 {
                centre: Vec3::default(),
                half: Vec3::default(),
                rotation: glam::Quat::from_xyzw(0.0, 0.0, 0.0, 0.0).into(),
            },
            plane_normal: Vec3::default(),
            plane_point: Vec3::default(),
            flatness: 0.0,
            tilt: 0.0,
            coverage: 0.0,
            hidden: 0.0,
            unknown: 0.0,
        };
        let because = |outcome| Place { outcome, ..nothing };
        Ok(match place(&frame, Some(&pyramid), Spot::Pixel(x as usize, y as usize), &wish).outcome {
            Ok(found) => Place {
                pose: found.pose.into(),
                plane_normal: found.plane.normal().into(),
                plane_point: found.plane.anchor().into(),
                flatness: found.flatness,
                tilt: found.tilt,
                coverage: found.coverage,
                ..because(PlaceOutcome::Found)
            },
            Err(NoPlace::BadSize | NoPlace::BadUp) => return Err(Status::ErrorParameter),
            Err(NoPlace::OutsideView) => because(PlaceOutcome::OutsideView),
            Err(NoPlace::NoSurface) => because(PlaceOutcome::NoSurface),
            Err(NoPlace::TooSteep { tilt }) => Place { tilt, ..because(PlaceOutcome::TooSteep) },
            Err(NoPlace::TooRough { flatness }) => Place { flatness, ..because(PlaceOutcome::TooRough) },
            Err(NoPlace::TooSmall { coverage }) => Place { coverage, ..because(PlaceOutcome::TooSmall) },
            Err(NoPlace::Blocked { hidden }) => Place { hidden, ..because(PlaceOutcome::Blocked) },
            Err(NoPlace::Unknown { holes }) => Place { unknown: holes, ..because(PlaceOutcome::Unknown) },
            // The core may learn more reasons.
            Err(_) => nothing,
        })
    };
    // SAFETY: promised by the caller.
    unsafe { answer(found, find) }
}
