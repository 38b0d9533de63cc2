//! What is behind this pixel, which way does it face, what does this ray hit? See the core's `hit`, `normals` and `raycast`.

use isobath::glam;
use isobath::ground::geometry::Ray;
use isobath::localized::hit::{HitOutcome as CoreHit, HitParams, hit_test};
use isobath::localized::normals::{MAX_RADIUS, NormalParams, normal_at};
use isobath::localized::raycast::{RayOutcome as CoreRay, RayParams, cast};

use crate::check::{answer, read};
use crate::context::{Context, View};
use crate::status::Status;
use crate::types::{Holes, Vec3};

/// What a hit test found.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HitOutcome {
    /// A surface.
    Hit = 0,
    /// The pixel has no reading.
    NoDepth = 1,
    /// The position is outside the depth image.
    OutsideView = 2,
}

/// The answer of isobath_hit_test. Without a hit everything is 0 but the outcome, the time and, in a hole, the pixel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// What was found.
    pub outcome: HitOutcome,
    /// 1 when `normal` is one.
    pub has_normal: u32,
    /// Column of the reading.
    pub pixel_x: u32,
    /// Row of the reading.
    pub pixel_y: u32,
    /// Where, in the world, metres.
    pub point: Vec3,
    /// The same in the camera's frame, metres.
    pub camera_point: Vec3,
    /// In the world, unit length, facing the camera.
    pub normal: Vec3,
    /// Depth along the camera's axis, metres.
    pub z: f32,
    /// Length of the ray from the camera, metres.
    pub range: f32,
    /// One standard deviation of `z`, metres (isobath_set_noise).
    pub sigma_z: f32,
    /// Readings that the normal rests on.
    pub normal_support: u32,
    /// RMS distance of those readings from the fitted surface, metres.
    pub normal_residual: f32,
    /// Always 0.
    pub reserved: u32,
    /// Of the frame, as pushed, nanoseconds.
    pub time_ns: i64,
}

/// What is behind a position of the depth image? `x`, `y`: pixels, fractions count, centres at integers.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_hit_test(context: *const Context, x: f32, y: f32, hit: *mut Hit) -> Status {
    let test = || {
        // SAFETY: promised by the caller.
        let context = unsafe { View::open(context)? };
        let frame = context.frame()?;
        let params = HitParams { noise: context.header.depth_noise(), ..HitParams::default() };
        let none = Vec3::default();
        let empty = Hit {
            outcome: HitOutcome::OutsideView,
            has_normal: 0,
            pixel_x: 0,
            pixel_y: 0,
            point: none,
            camera_point: none,
            normal: none,
            z: 0.0,
            range: 0.0,
            sigma_z: 0.0,
            normal_support: 0,
            normal_residual: 0.0,
            reserved: 0,
            time_ns: frame.time().as_nanos(),
        };
        Ok(match hit_test(&frame, glam::Vec2::new(x, y), &params) {
            CoreHit::OutsideView => empty,
            CoreHit::NoDepth { pixel: (x, y) } => {
                Hit { outcome: HitOutcome::NoDepth, pixel_x: x as u32, pixel_y: y as u32, ..empty }
            }
            CoreHit::Hit(hit) => Hit {
                outcome: HitOutcome::Hit,
                has_normal: u32::from(hit.normal.is_some()),
                pixel_x: hit.pixel.0 as u32,
                pixel_y: hit.pixel.1 as u32,
                point: hit.point.into(),
                camera_point: hit.camera_point.into(),
                normal: hit.normal.map_or(none, Vec3::from),
                z: hit.z,
                range: hit.range,
                sigma_z: hit.sigma_z,
                normal_support: hit.estimate.map_or(0, |e| u32::from(e.support)),
                normal_residual: hit.estimate.map_or(0.0, |e| e.residual),
                ..empty
            },
        })
    };
    // SAFETY: promised by the caller.
    unsafe { answer(hit, test) }
}

/// What is known of a pixel's normal.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NormalOutcome {
    /// A normal.
    Found = 0,
    /// The pixel has no reading.
    NoDepth = 1,
    /// Too few of its neighbours have readings on the same surface.
    NoNormal = 2,
    /// The pixel is outside the depth image.
    OutsideView = 3,
}

/// The answer of isobath_normal; without a normal, 0 but for the outcome.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normal {
    /// What was found.
    pub outcome: NormalOutcome,
    /// Readings it rests on.
    pub support: u32,
    /// Unit length, in the world, facing the camera.
    pub normal: Vec3,
    /// The same in the camera's frame.
    pub camera_normal: Vec3,
    /// RMS distance of the readings from the fitted surface, metres.
    pub residual: f32,
}

/// Which way does the surface at a pixel face? `radius`: pixels around it that are fitted, 0 (five pixels, exact on clean depth)
/// to 7; 5 suits single points of a real sensor.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_normal(
    context: *const Context,
    x: u32,
    y: u32,
    radius: u32,
    normal: *mut Normal,
) -> Status {
    let find = || {
        // SAFETY: promised by the caller.
        let context = unsafe { View::open(context)? };
        let frame = context.frame()?;
        if radius > u32::from(MAX_RADIUS) {
            return Err(Status::ErrorParameter);
        }
        let params = NormalParams { radius: radius as u8, ..NormalParams::default() };
        let (x, y) = (x as usize, y as usize);
        let none = Vec3::default();
        let nothing = |outcome| Normal { outcome, support: 0, normal: none, camera_normal: none, residual: 0.0 };
        if x >= frame.size().0 || y >= frame.size().1 {
            return Ok(nothing(NormalOutcome::OutsideView));
        }
        if frame.z(x, y) == 0.0 {
            return Ok(nothing(NormalOutcome::NoDepth));
        }
        Ok(normal_at(&frame, x, y, &params).map_or(nothing(NormalOutcome::NoNormal), |e| Normal {
            outcome: NormalOutcome::Found,
            support: u32::from(e.support),
            normal: frame.pose_or_identity().direction_to_world(e.normal).into(),
            camera_normal: e.normal.into(),
            residual: e.residual,
        }))
    };
    // SAFETY: promised by the caller.
    unsafe { answer(normal, find) }
}

/// What became of a ray.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayOutcome {
    /// It hit a surface that the camera sees.
    Hit = 0,
    /// It went behind a surface, and may have hit something there; the point is where it was first behind.
    HitOccluded = 1,
    /// It stayed in front of everything seen.
    Miss = 2,
    /// It passed a hole, and hit nothing that is known.
    NoDepth = 3,
    /// It never was in the view.
    OutsideView = 4,
}

/// The answer of isobath_ray_cast; what does not apply is 0.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// What became of it.
    pub outcome: RayOutcome,
    /// Where, in the world, metres.
    pub point: Vec3,
    /// Metres from the ray's origin.
    pub distance: f32,
    /// Column of the pixel.
    pub pixel_x: u32,
    /// Row of the pixel.
    pub pixel_y: u32,
    /// Depth of the point along the camera's axis, metres.
    pub z: f32,
    /// Hit: 1 when it went behind another surface before.
    pub passed_behind: u32,
    /// Hit: 1 when the pixel is a hole taken as solid.
    pub from_hole: u32,
    /// Miss: 1 when it left the view before its end.
    pub left_view: u32,
}

/// What does a ray hit? `origin`: world, metres. `direction`: world, any length but 0. `max_distance`: metres, default choice 20.
/// `holes`: an isobath_holes.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_ray_cast(
    context: *const Context,
    origin: *const Vec3,
    direction: *const Vec3,
    max_distance: f32,
    holes: i32,
    hit: *mut RayHit,
) -> Status {
    let find = || {
        // SAFETY: promised by the caller.
        let (context, origin, direction) = unsafe { (View::open(context)?, read(origin)?, read(direction)?) };
        let (frame, pyramid) = (context.frame()?, context.pyramid()?);
        let holes = Holes::policy(holes)?;
        let ray = Ray::new(origin.into(), direction.into()).ok_or(Status::ErrorParameter)?;
        if !(max_distance >= 0.0) {
            return Err(Status::ErrorParameter);
        }
        let params = RayParams { max_distance, holes, ..RayParams::default() };
        let none = RayHit {
            outcome: RayOutcome::OutsideView,
            point: Vec3::default(),
            distance: 0.0,
            pixel_x: 0,
            pixel_y: 0,
            z: 0.0,
            passed_behind: 0,
            from_hole: 0,
            left_view: 0,
        };
        Ok(match cast(&frame, Some(&pyramid), &ray, &params).outcome {
            CoreRay::Hit(hit) => RayHit {
                outcome: RayOutcome::Hit,
                point: hit.point.into(),
                distance: hit.distance,
                pixel_x: hit.pixel.0 as u32,
                pixel_y: hit.pixel.1 as u32,
                z: hit.z,
                passed_behind: hit.passed_behind.into(),
                from_hole: hit.from_hole.into(),
                left_view: 0,
            },
            CoreRay::HitOccluded { point, pixel, distance } => RayHit {
                outcome: RayOutcome::HitOccluded,
                point: point.into(),
                distance,
                pixel_x: pixel.0 as u32,
                pixel_y: pixel.1 as u32,
                ..none
            },
            CoreRay::Miss { left_view } => RayHit { outcome: RayOutcome::Miss, left_view: left_view.into(), ..none },
            CoreRay::NoDepth => RayHit { outcome: RayOutcome::NoDepth, ..none },
            CoreRay::OutsideView => none,
        })
    };
    // SAFETY: promised by the caller.
    unsafe { answer(hit, find) }
}
