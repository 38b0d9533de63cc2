//! Where does a ray go after it bounces? Laser beams, rolling balls, mirror images (DepthLab, "Other use cases").
//!
//! Each leg is a ray cast; at its hit the normal of the surface turns it, r = d - 2 (n · d) n. (The code published with the
//! paper blends directions instead; that is no mirror.) The next leg starts a little off the surface, so that it does not
//! hit where it starts.
//!
//! Memory: the caller's slice of [`Bounce`]s. Cost: one ray cast and one normal a bounce. Error: the normal's, twice: one
//! degree of it turns the reflected ray by two.

use glam::Vec3;

use crate::ground::geometry::Ray;
use crate::localized::normals::{NormalParams, normal_at};
use crate::localized::raycast::{RayHit, RayOutcome, RayParams, cast};
use crate::sensing::camera::Pose;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use crate::skipping::pyramid::Pyramid;

/// How a ray is reflected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReflectParams {
    /// How each leg is cast; its `max_distance` holds for each leg alone.
    pub ray: RayParams,
    /// How normals are estimated. Default [`NormalParams::POINT`]: a reflection doubles the normal's error.
    pub normals: NormalParams,
    /// How far off the surface, along its normal, the next leg starts, metres. Default 0.02; 0 to 1.
    pub offset: f32,
}

impl Default for ReflectParams {
    fn default() -> Self {
        Self { ray: RayParams::default(), normals: NormalParams::POINT, offset: 0.02 }
    }
}

/// One reflection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounce {
    /// What the incoming leg hit.
    pub hit: RayHit,
    /// Unit normal in the world, facing the camera.
    pub normal: Vec3,
    /// Unit direction of the outgoing leg in the world.
    pub direction: Vec3,
}

impl Bounce {
    /// No bounce: what a slice is filled with beforehand.
    pub const EMPTY: Self = Self {
        hit: RayHit { point: Vec3::ZERO, distance: 0.0, pixel: (0, 0), z: 0.0, passed_behind: false, from_hole: false },
        normal: Vec3::ZERO,
        direction: Vec3::ZERO,
    };
}

/// Why the path ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PathEnd {
    /// The slice of bounces is full; the last leg was not cast.
    Limit,
    /// The last leg hit nothing, left the view, or what it passed is not known: never [`RayOutcome::Hit`].
    Open(RayOutcome),
    /// The last leg hit where there is no normal: in a hole taken as solid, or beside one.
    NoNormal(RayHit),
    /// The last leg hit a surface from its back, as the side of a step may be: which way it goes on is not known.
    BackFace(RayHit),
}

/// A reflected path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflection {
    /// Bounces written to the slice.
    pub bounces: usize,
    /// Why there are no more.
    pub end: PathEnd,
    /// The last leg: from the last bounce (or the start) on.
    pub last: Ray,
    /// Pixels visited and skipped by the ray casts.
    pub work: Work,
}

/// The mirror image of a direction at a surface: d - 2 (n · d) n. `normal` must be of unit length.
///
/// ```
/// # use glam::{vec3, Vec3};
/// use isobath::localized::reflect::mirror;
/// assert_eq!(mirror(vec3(1.0, -1.0, 0.0), Vec3::Y), vec3(1.0, 1.0, 0.0));
/// ```
#[must_use]
pub fn mirror(direction: Vec3, normal: Vec3) -> Vec3 {
    direction - normal * (2.0 * normal.dot(direction))
}

/// Follows a world-space ray through at most `bounces.len()` reflections.
///
/// ```
/// use glam::{vec3, Vec3};
/// use isobath::ground::geometry::Ray;
/// use isobath::localized::reflect::{reflect, Bounce, ReflectParams};
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// static WALL: DepthArray<160, 120> = DepthArray::filled(2000);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let frame = DepthFrame::new(WALL.view(), DepthUnit::MILLIMETRE, k);
/// let ray = Ray::new(vec3(-0.5, 0.0, 1.5), vec3(1.0, 0.0, 1.0)).unwrap();
/// let mut bounces = [Bounce::EMPTY; 4];
/// let path = reflect(&frame, None, &ray, &ReflectParams::default(), &mut bounces);
/// assert_eq!(path.bounces, 1); // then it comes back and leaves the view
/// assert!((bounces[0].hit.point - vec3(0.0, 0.0, 2.0)).length() < 1e-3);
/// assert!((path.last.direction() - vec3(0.5, 0.0, -0.5).normalize_or_zero()).length() < 1e-3);
/// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
/// ```
#[must_use]
pub fn reflect<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pyramid: Option<&Pyramid<'_, D>>,
    ray: &Ray,
    params: &ReflectParams,
    bounces: &mut [Bounce],
) -> Reflection {
    let pose = frame.pose_or_identity();
    let mut path = Reflection { bounces: 0, end: PathEnd::Limit, last: *ray, work: Work::default() };
    // Legs are followed in the camera's frame: world points far from the origin are rounded, and legs would add it up.
    let local = frame.with_pose(Pose::IDENTITY);
    let Some(mut leg) = Ray::new(pose.to_camera(ray.origin()), pose.direction_to_camera(ray.direction())) else {
        path.end = PathEnd::Open(RayOutcome::OutsideView);
        return path;
    };
    let in_world = |hit: RayHit| RayHit { point: pose.to_world(hit.point), ..hit };
    let offset = if params.offset > 0.0 { params.offset.min(1.0) } else { 0.0 };
    for slot in bounces {
        let passed = cast(&local, pyramid, &leg, &params.ray);
        path.work += passed.work;
        let hit = match passed.outcome {
            RayOutcome::Hit(hit) => hit,
            RayOutcome::HitOccluded { point, pixel, distance } => {
                path.end = PathEnd::Open(RayOutcome::HitOccluded { point: pose.to_world(point), pixel, distance });
                return path;
            }
            open => {
                path.end = PathEnd::Open(open);
                return path;
            }
        };
        let Some(estimate) = normal_at(frame, hit.pixel.0, hit.pixel.1, &params.normals) else {
            path.end = PathEnd::NoNormal(in_world(hit));
            return path;
        };
        let (normal, incoming) = (estimate.normal, leg.direction());
        if !(normal.dot(incoming) < 0.0) {
            path.end = PathEnd::BackFace(in_world(hit));
            return path;
        }
        let next = Ray::new(hit.point + normal * offset, mirror(incoming, normal));
        let turned = next.and_then(|n| Ray::new(pose.to_world(n.origin()), pose.direction_to_world(n.direction())));
        let (Some(next), Some(world)) = (next, turned) else {
            path.end = PathEnd::NoNormal(in_world(hit));
            return path;
        };
        let normal = pose.direction_to_world(normal);
        *slot = Bounce { hit: in_world(hit), normal, direction: world.direction() };
        path.bounces += 1;
        (path.last, leg) = (world, next);
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::{Intrinsics, Pose};
    use crate::sensing::depth::{DepthUnit, HolePolicy};
    use glam::Quat;
    use std::vec::Vec;

    /// 160 x 120 pixels of what `z` says of each pixel's ray (x/z, y/z), metres.
    fn image(z: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        (0..160 * 120).map(|i| z(((i % 160) as f32 - 79.5) / 120.0, ((i / 160) as f32 - 59.5) / 120.0)).collect()
    }

    fn frame(data: &[f32]) -> DepthFrame<'_, f32> {
        let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5).unwrap();
        DepthFrame::new(ImageView::new(data, 160, 120).unwrap(), DepthUnit::METRE, k)
    }

    /// Two walls that meet at right angles before the camera, along x = 0 at z = 3: z = 3 - |x|.
    fn corner() -> Vec<f32> {
        image(|x, _| 3.0 / (1.0 + x.abs()))
    }

    #[test]
    fn a_corner_sends_light_back() {
        let data = corner();
        let pose = Pose::new(Quat::from_rotation_z(0.3), Vec3::new(1.0, 2.0, 3.0)).unwrap();
        for pose in [Pose::IDENTITY, pose] {
            let frame = frame(&data).with_pose(pose);
            let start = Vec3::new(0.3, 0.05, 1.0);
            let direction = Vec3::new(0.1, 0.02, 1.0);
            let ray = Ray::new(pose.to_world(start), pose.direction_to_world(direction)).unwrap();
            let mut bounces = [Bounce::EMPTY; 5];
            let path = reflect(&frame, None, &ray, &ReflectParams::default(), &mut bounces);
            assert_eq!(path.bounces, 2, "{path:?}");
            assert!(matches!(path.end, PathEnd::Open(RayOutcome::Miss { left_view: true })), "{path:?}");
            // Two mirrors at right angles turn x and z around and keep y.
            let out = pose.direction_to_camera(path.last.direction());
            let want = Vec3::new(-0.1, 0.02, -1.0).try_normalize().unwrap();
            assert!((out - want).length() < 1e-3, "{out} {want}");
            for b in &bounces[..2] {
                let p = pose.to_camera(b.hit.point);
                assert!((p.z - (3.0 - p.x.abs())).abs() < 1e-3, "{p}");
                assert!((b.normal.length() - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn it_says_why_it_stops() {
        let data = corner();
        let frame_of = frame(&data);
        let ray = Ray::new(Vec3::new(0.3, 0.05, 1.0), Vec3::Z).unwrap();
        let params = ReflectParams::default();
        assert_eq!(reflect(&frame_of, None, &ray, &params, &mut []).end, PathEnd::Limit);
        let one = reflect(&frame_of, None, &ray, &params, &mut [Bounce::EMPTY]);
        assert_eq!((one.bounces, one.end), (1, PathEnd::Limit));
        let away = Ray::new(Vec3::ZERO, Vec3::NEG_Z).unwrap();
        let none = reflect(&frame_of, None, &away, &params, &mut [Bounce::EMPTY]);
        assert_eq!((none.bounces, none.end), (0, PathEnd::Open(RayOutcome::OutsideView)));

        let holes = image(|_, _| 0.0);
        let solid = ReflectParams { ray: RayParams { holes: HolePolicy::Solid, ..params.ray }, ..params };
        let into = reflect(&frame(&holes), None, &ray, &solid, &mut [Bounce::EMPTY]);
        assert!(matches!(into.end, PathEnd::NoNormal(hit) if hit.from_hole), "{into:?}");

        // The side of a step, hit while flying away from the face that the camera sees there.
        let step = image(|x, _| if x > 0.0 { 1.0 } else { 2.0 });
        let sideways = Ray::new(Vec3::new(-0.3, 0.01, 1.1), Vec3::new(1.0, 0.0, -0.05)).unwrap();
        // The narrow estimate: the wide fit may reach across the edge.
        let narrow = ReflectParams { normals: NormalParams::default(), ..params };
        let thick = reflect(&frame(&step), None, &sideways, &narrow, &mut [Bounce::EMPTY]);
        assert!(matches!(thick.end, PathEnd::BackFace(_)), "{thick:?}");
    }

    #[test]
    fn hostile_offsets_do_no_harm() {
        let data = corner();
        let ray = Ray::new(Vec3::new(0.3, 0.05, 1.0), Vec3::Z).unwrap();
        for offset in [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e30] {
            let params = ReflectParams { offset, ..ReflectParams::default() };
            let mut bounces = [Bounce::EMPTY; 8];
            let path = reflect(&frame(&data), None, &ray, &params, &mut bounces);
            assert!(path.last.origin().is_finite() && path.bounces >= 1, "{offset}");
        }
    }

    #[test]
    fn mirroring_twice_is_nothing() {
        let n = Vec3::new(0.3, -0.5, 0.7).try_normalize().unwrap();
        let d = Vec3::new(0.1, 0.9, -0.4);
        assert!((mirror(mirror(d, n), n) - d).length() < 1e-6);
        assert!((mirror(d, n).length() - d.length()).abs() < 1e-6);
    }
}
