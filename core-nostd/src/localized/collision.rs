//! Does this object collide with the real scene? Majority vote (DepthLab, "Collision-aware Placement").
//!
//! A handful of points stands for the object. Each is projected to the depth image: it is *hidden* when it lies behind the
//! reading there by more than a tolerance, *visible* otherwise. When enough of the votes are hidden the object collides.
//!
//! Points in holes, outside the view or behind the camera do not vote ([`CollisionParams::holes`] can make holes vote), and
//! with too few voters the answer is [`Verdict::Unknown`]: the published code answers "free" when it knows nothing.
//!
//! Memory: none. Cost: one projection and one depth value a point. Error: none beyond the depth's own; the tolerance is
//! there to swallow it.

use glam::Vec3;

use crate::ground::geometry::OrientedBox;
use crate::ground::rotation::{rotate, rotate_back};
use crate::sensing::depth::{DepthSample, HolePolicy};
use crate::sensing::frame::DepthFrame;

/// How votes are taken and counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionParams {
    /// How far behind a reading a point may lie and still count as visible, metres along the optical axis. Default 0.12
    /// (the paper's); at least 0.
    pub tolerance: f32,
    /// Share of hidden votes from which the object is blocked. Default 0.5 (a tie blocks); 0 to 1. At 0 one hidden vote
    /// blocks.
    pub threshold: f32,
    /// Share of all points that must vote, 0 to 1. Default 0.5. One voter is always needed.
    pub min_voters: f32,
    /// What a hole votes. Default [`HolePolicy::Unknown`]: nothing. `Solid`: hidden. `Free`: visible.
    pub holes: HolePolicy,
}

impl Default for CollisionParams {
    fn default() -> Self {
        Self { tolerance: 0.12, threshold: 0.5, min_voters: 0.5, holes: HolePolicy::Unknown }
    }
}

/// Whether there is room for the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// Enough of it would be visible.
    Free,
    /// Enough of it would be hidden in or behind what is there.
    Blocked,
    /// Too few points could be judged.
    Unknown,
}

/// What was found at each point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// In front of the reading, or behind it within the tolerance.
    pub visible: u32,
    /// Behind the reading by more than the tolerance.
    pub hidden: u32,
    /// On a pixel without a reading.
    pub holes: u32,
    /// Outside the image, or not a finite point.
    pub outside: u32,
    /// Not in front of the camera.
    pub behind_camera: u32,
}

/// A verdict and the votes it rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Collision {
    /// The answer.
    pub verdict: Verdict,
    /// What was found at the points.
    pub tally: Tally,
}

/// What the camera knows about one world point (metres); every point of [`vote`] is judged by this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sight {
    Visible,
    Hidden,
    Hole,
    Outside,
    BehindCamera,
}

fn sight<D: DepthSample>(frame: &DepthFrame<'_, D>, point: Vec3, tolerance: f32) -> Sight {
    let p = frame.pose_or_identity().to_camera(point);
    if !p.is_finite() {
        return Sight::Outside;
    }
    if !(p.z > 0.0) {
        return Sight::BehindCamera;
    }
    let Some((x, y)) = frame.pixel_of(p) else { return Sight::Outside };
    let z = frame.z(x, y);
    if z == 0.0 {
        Sight::Hole
    } else if p.z > z + tolerance {
        Sight::Hidden
    } else {
        Sight::Visible
    }
}

/// The vote of any world points (metres).
///
/// ```
/// use glam::{vec3, Quat};
/// use isobath::ground::geometry::OrientedBox;
/// use isobath::localized::collision::{vote, CollisionParams, Verdict};
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// static WALL: DepthArray<160, 120> = DepthArray::filled(2000);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let frame = DepthFrame::new(WALL.view(), DepthUnit::MILLIMETRE, k);
/// let at = |z| {
///     let object = OrientedBox { centre: vec3(0.0, 0.0, z), half: vec3(0.1, 0.1, 0.1), rotation: Quat::IDENTITY };
///     vote(&frame, object.corners(), &CollisionParams::default()).verdict
/// };
/// assert_eq!(at(1.5), Verdict::Free);
/// assert_eq!(at(2.2), Verdict::Blocked); // in the wall
/// assert_eq!(at(-1.0), Verdict::Unknown); // behind the camera
/// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
/// ```
#[must_use]
pub fn vote<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    points: impl IntoIterator<Item = Vec3>,
    params: &CollisionParams,
) -> Collision {
    let mut tally = Tally::default();
    let tolerance = params.tolerance.max(0.0);
    for point in points {
        let count = match sight(frame, point, tolerance) {
            Sight::Visible => &mut tally.visible,
            Sight::Hidden => &mut tally.hidden,
            Sight::Hole => &mut tally.holes,
            Sight::Outside => &mut tally.outside,
            Sight::BehindCamera => &mut tally.behind_camera,
        };
        *count = count.saturating_add(1);
    }
    Collision { verdict: verdict(&tally, params), tally }
}

fn verdict(tally: &Tally, params: &CollisionParams) -> Verdict {
    let count = |n: u32| n as f32;
    let (mut visible, mut hidden) = (count(tally.visible), count(tally.hidden));
    let all = visible + hidden + count(tally.holes) + count(tally.outside) + count(tally.behind_camera);
    match params.holes {
        HolePolicy::Solid => hidden += count(tally.holes),
        HolePolicy::Free => visible += count(tally.holes),
        HolePolicy::Unknown => {}
    }
    let voters = visible + hidden;
    // Parameters that are not numbers lead to the cautious answer.
    if voters == 0.0 || !(voters >= params.min_voters * all) {
        Verdict::Unknown
    } else if hidden == 0.0 || hidden < params.threshold * voters {
        Verdict::Free
    } else {
        Verdict::Blocked
    }
}

/// Thirteen points of a box: its corners, its centre and the middles of its four upright faces. More robust than the
/// corners alone for a box that is larger than what it may collide with. `up` (any length) says which of the box's axes
/// stands: the one nearest to it.
///
/// ```
/// # use glam::{vec3, Quat, Vec3};
/// use isobath::ground::geometry::OrientedBox;
/// use isobath::localized::collision::box_points;
/// let cube = OrientedBox { centre: Vec3::ZERO, half: Vec3::ONE, rotation: Quat::IDENTITY };
/// let points = box_points(&cube, Vec3::Y);
/// assert_eq!(points[8], Vec3::ZERO);
/// assert_eq!(points[9], Vec3::NEG_X);
/// ```
#[must_use]
pub fn box_points(object: &OrientedBox, up: Vec3) -> [Vec3; 13] {
    let corners = object.corners();
    let local = (rotate_back(object.rotation, up)).abs();
    let (a, b) = if local.y >= local.x && local.y >= local.z {
        (Vec3::X, Vec3::Z)
    } else if local.z >= local.x {
        (Vec3::X, Vec3::Y)
    } else {
        (Vec3::Y, Vec3::Z)
    };
    let sides = [-a, a, -b, b];
    core::array::from_fn(|i| {
        let offset = i.checked_sub(9).and_then(|k| sides.get(k)).map_or(Vec3::ZERO, |s| *s * object.half);
        corners.get(i).copied().unwrap_or(object.centre + rotate(object.rotation, offset))
    })
}

/// Fourteen points of a capsule, the shape of a standing avatar: the two tips, and four points around each end and the
/// middle. `a` and `b` are the centres of the end spheres, all in metres.
///
/// ```
/// # use glam::{vec3, Vec3};
/// use isobath::localized::collision::capsule_points;
/// let points = capsule_points(vec3(0.0, 0.3, 2.0), vec3(0.0, 1.5, 2.0), 0.3);
/// assert!((points[0] - vec3(0.0, 0.0, 2.0)).length() < 1e-6); // the lower tip
/// assert!((points[1] - vec3(0.0, 1.8, 2.0)).length() < 1e-6);
/// ```
#[must_use]
pub fn capsule_points(a: Vec3, b: Vec3, radius: f32) -> [Vec3; 14] {
    let axis = (b - a).try_normalize().unwrap_or(Vec3::Y);
    let (u, v) = axis.any_orthonormal_pair();
    core::array::from_fn(|i| match i {
        0 => a - axis * radius,
        1 => b + axis * radius,
        _ => {
            let station = a.lerp(b, 0.5 * ((i - 2) / 4) as f32);
            let around = match i % 4 {
                0 => u,
                1 => v,
                2 => -u,
                _ => -v,
            };
            station + around * radius
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::{Intrinsics, Pose};
    use crate::sensing::depth::{DepthArray, DepthUnit};
    use glam::Quat;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    const K: Intrinsics = match Intrinsics::new(120.0, 120.0, 79.5, 59.5) {
        Ok(k) => k,
        Err(_) => panic!(),
    };

    /// A wall at 2 m whose left half is a hole.
    fn half_hole() -> DepthArray<160, 120> {
        let mut image = DepthArray::filled(2000);
        for y in 0..120 {
            image.view_mut().row_mut(y)[..80].fill(0);
        }
        image
    }

    fn frame(image: &DepthArray<160, 120>) -> DepthFrame<'_> {
        DepthFrame::new(image.view(), DepthUnit::MILLIMETRE, K)
    }

    #[test]
    fn the_tolerance_is_the_border() {
        let image = DepthArray::filled(2000);
        let frame = frame(&image);
        let at = |z: f32| vote(&frame, [Vec3::new(0.0, 0.0, z)], &CollisionParams::default()).verdict;
        assert_eq!(at(2.11), Verdict::Free);
        assert_eq!(at(2.13), Verdict::Blocked);
        let strict = CollisionParams { tolerance: 0.0, ..CollisionParams::default() };
        assert_eq!(vote(&frame, [Vec3::new(0.0, 0.0, 2.01)], &strict).verdict, Verdict::Blocked);
        let hostile = CollisionParams { tolerance: f32::NAN, ..CollisionParams::default() };
        assert_eq!(vote(&frame, [Vec3::new(0.0, 0.0, 2.01)], &hostile).verdict, Verdict::Blocked);
    }

    #[test]
    fn depth_is_compared_along_the_axis_not_along_the_ray() {
        let image = DepthArray::filled(2000);
        // 33 degrees off the axis: range 2.38 m, z 2.0 m.
        let point = Vec3::new(1.3, 0.0, 2.0);
        assert_eq!(vote(&frame(&image), [point], &CollisionParams::default()).tally.visible, 1);
    }

    #[test]
    fn nothing_known_is_never_free() {
        let image = half_hole();
        let frame = frame(&image);
        let left = Vec3::new(-0.3, 0.0, 1.0);
        let hole = |holes| vote(&frame, [left], &CollisionParams { holes, ..CollisionParams::default() }).verdict;
        assert_eq!(hole(HolePolicy::Unknown), Verdict::Unknown);
        assert_eq!(hole(HolePolicy::Solid), Verdict::Blocked);
        assert_eq!(hole(HolePolicy::Free), Verdict::Free);
        let params = CollisionParams::default();
        for points in [vec![], vec![Vec3::NAN], vec![Vec3::INFINITY], vec![Vec3::NEG_Z], vec![Vec3::new(9.0, 0.0, 1.0)]]
        {
            assert_eq!(vote(&frame, points, &params).verdict, Verdict::Unknown);
        }
        // One voter of three is too few by default, and enough when asked for.
        let points = [left, left, Vec3::new(0.3, 0.0, 1.0)];
        assert_eq!(vote(&frame, points, &params).verdict, Verdict::Unknown);
        let few = CollisionParams { min_voters: 0.3, ..params };
        assert_eq!(vote(&frame, points, &few).verdict, Verdict::Free);
        let hostile = CollisionParams { min_voters: f32::NAN, threshold: f32::NAN, ..params };
        assert_eq!(vote(&frame, points, &hostile).verdict, Verdict::Unknown);
        let none = CollisionParams { min_voters: -1.0, ..params };
        assert_eq!(vote(&frame, [left], &none).verdict, Verdict::Unknown, "one voter is always needed");
    }

    #[test]
    fn a_tie_blocks() {
        let image = DepthArray::filled(2000);
        let (front, back) = (Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.0, 0.0, 3.0));
        let vote = |points: &[Vec3], threshold| {
            let params = CollisionParams { threshold, ..CollisionParams::default() };
            vote(&frame(&image), points.iter().copied(), &params).verdict
        };
        assert_eq!(vote(&[front, back], 0.5), Verdict::Blocked);
        assert_eq!(vote(&[front, front, back], 0.5), Verdict::Free);
        assert_eq!(vote(&[front, front, back], 0.0), Verdict::Blocked);
        assert_eq!(vote(&[front, front], 0.0), Verdict::Free);
        assert_eq!(vote(&[front, back, back], 1.0), Verdict::Free);
        assert_eq!(vote(&[back, back], 1.0), Verdict::Blocked);
    }

    #[test]
    fn thin_and_empty_images() {
        for (w, h) in [(0, 0), (1, 0), (1, 50), (50, 1)] {
            let data = vec![1000_u16; w * h];
            let k = Intrinsics::new(10.0, 10.0, (w as f32 - 1.0) / 2.0, (h as f32 - 1.0) / 2.0).unwrap();
            let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
            let tally = vote(&frame, [Vec3::new(0.0, 0.0, 0.5)], &CollisionParams::default()).tally;
            assert_eq!(tally.outside, u32::from(w * h == 0), "{w}x{h} {tally:?}");
        }
    }

    #[test]
    fn sampled_points_lie_on_their_shapes() {
        let object = OrientedBox {
            centre: Vec3::new(1.0, 2.0, 3.0),
            half: Vec3::new(0.5, 0.25, 1.0),
            rotation: Quat::from_rotation_x(0.3),
        };
        for up in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ZERO, Vec3::NAN] {
            let points = box_points(&object, up);
            let sum = points.iter().fold(Vec3::ZERO, |s, p| s + *p) / 13.0;
            assert!((sum - object.centre).length() < 1e-5, "{up}");
            let standing = object.rotation * Vec3::Y;
            if up == Vec3::Y {
                assert!(points[9..].iter().all(|p| (*p - object.centre).dot(standing).abs() < 1e-6));
            }
        }
        let (a, b) = (Vec3::new(0.0, 1.0, 2.0), Vec3::new(0.5, 2.0, 2.0));
        let from_segment = |p: Vec3| {
            let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            (p - a.lerp(b, t)).length()
        };
        let points = capsule_points(a, b, 0.25);
        assert!(points.iter().all(|p| (from_segment(*p) - 0.25).abs() < 1e-5));
        let apart = |i: usize| points.iter().enumerate().all(|(j, p)| i == j || (*p - points[i]).length() > 0.1);
        assert!((0..14).all(apart), "no point twice");
        assert!(capsule_points(a, a, 0.25).iter().all(|p| ((*p - a).length() - 0.25).abs() < 1e-6));
    }

    proptest! {
        /// Every point lands in exactly one count, the one that f64 says.
        #[test]
        fn the_tally_is_the_sum_of_its_points(seed in any::<u64>(), angle in -0.5_f32..0.5) {
            let image = half_hole();
            let pose = Pose::new(Quat::from_rotation_y(angle), Vec3::new(0.5, 0.1, -0.2)).unwrap();
            let frame = frame(&image).with_pose(pose);
            let mut s = seed | 1;
            let mut next = || { s ^= s << 13; s ^= s >> 7; s ^= s << 17; ((s >> 40) as f32 / 16_777_216.0 - 0.5) * 8.0 };
            let points: Vec<Vec3> = (0..60).map(|_| Vec3::new(next(), next() * 0.5, next())).collect();
            let got = vote(&frame, points.iter().copied(), &CollisionParams::default()).tally;
            let mut want = Tally::default();
            let (sin, cos) = f64::from(angle).sin_cos();
            for p in &points {
                let q = [f64::from(p.x) - 0.5, f64::from(p.y) - 0.1, f64::from(p.z) + 0.2];
                let (x, z) = (cos * q[0] - sin * q[2], sin * q[0] + cos * q[2]);
                let (u, v) = (120.0 * x / z + 79.5, 120.0 * q[1] / z + 59.5);
                let away = |a: f64, b: f64| (a - b).abs() > 1e-3;
                prop_assume!(away(z, 0.0) && away(z, 2.12) && [-0.5, 79.5, 159.5].iter().all(|&e| away(u, e)));
                prop_assume!(away(v, -0.5) && away(v, 119.5));
                let inside = u > -0.5 && u < 159.5 && v > -0.5 && v < 119.5;
                match (z > 0.0, inside, u > 79.5, z > 2.12) {
                    (false, ..) => want.behind_camera += 1,
                    (_, false, ..) => want.outside += 1,
                    (_, _, false, _) => want.holes += 1,
                    (_, _, _, true) => want.hidden += 1,
                    _ => want.visible += 1,
                }
            }
            prop_assert_eq!(got, want);
        }
    }
}
