use std::vec;
use std::vec::Vec;

use glam::{Quat, Vec3};
use proptest::prelude::*;

use super::*;
use crate::ground::image::ImageView;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::DepthUnit;
use crate::skipping::pyramid::cells_needed;

struct Rng(u64);

impl Rng {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 16) as u32
    }
    fn unit(&mut self) -> f32 {
        (self.next() >> 8) as f32 / (1 << 24) as f32
    }
    fn within(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.unit()
    }
}

/// Slanted planes with blocks in front, holes and noise, as the seed says.
fn scene(rng: &mut Rng, w: usize, h: usize) -> Vec<u16> {
    let (base, gx, gy) = (rng.within(800.0, 4000.0), rng.within(-20.0, 20.0), rng.within(-20.0, 20.0));
    let noise = [0.0, 3.0, 2000.0][rng.next() as usize % 3];
    let hole_odds = [0, 0, 40, 5][rng.next() as usize % 4];
    let mut data: Vec<u16> = (0..w * h)
        .map(|i| {
            let (x, y) = ((i % w) as f32 - w as f32 / 2.0, (i / w) as f32 - h as f32 / 2.0);
            (base + gx * x + gy * y + rng.within(-noise, noise)).clamp(200.0, 60_000.0) as u16
        })
        .collect();
    for _ in 0..rng.next() % 5 {
        let (bx, by) = (rng.next() as usize % w, rng.next() as usize % h);
        let (bw, bh) = (1 + rng.next() as usize % w, 1 + rng.next() as usize % h);
        let z = if rng.next().is_multiple_of(3) { 0 } else { rng.within(300.0, 3000.0) as u16 };
        for y in by..(by + bh).min(h) {
            for x in bx..(bx + bw).min(w) {
                data[y * w + x] = z;
            }
        }
    }
    if hole_odds > 0 {
        for v in &mut data {
            if rng.next().is_multiple_of(hole_odds) {
                *v = [0, u16::MAX][rng.next() as usize % 2];
            }
        }
    }
    data
}

/// Rays of every kind: through the view, along the axis, from the camera's centre, along pixel edges, hopeless ones.
fn any_ray(rng: &mut Rng) -> Ray {
    let target = Vec3::new(rng.within(-1.5, 1.5), rng.within(-1.5, 1.5), rng.within(0.2, 6.0));
    let mut origin = Vec3::new(rng.within(-2.0, 2.0), rng.within(-2.0, 2.0), rng.within(-1.0, 6.0));
    let mut direction = target - origin;
    match rng.next() % 10 {
        0 => origin = Vec3::ZERO,
        1 => direction = Vec3::Z,
        2 => direction = Vec3::NEG_Z,
        3 => direction = -origin,
        4 => direction = Vec3::new(direction.x, 0.0, 0.0),
        5 => direction = Vec3::new(0.0, direction.y, direction.z),
        6 => origin *= 1e4,
        7 => direction.z = 0.0,
        _ => {}
    }
    if rng.next().is_multiple_of(4) {
        origin = (origin * 4.0).round() / 4.0;
    }
    Ray::new(origin, direction).unwrap_or_else(|| Ray::new(origin, Vec3::X).unwrap())
}

fn any_params(rng: &mut Rng) -> RayParams {
    RayParams {
        max_distance: [20.0, 1.5, 0.0, f32::INFINITY][rng.next() as usize % 4],
        thickness: [0.3, 0.0, 0.05, f32::INFINITY][rng.next() as usize % 4],
        holes: [HolePolicy::Unknown, HolePolicy::Solid, HolePolicy::Free][rng.next() as usize % 3],
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    /// Bit for bit, on every field, and the work adds up.
    #[test]
    fn the_pyramid_changes_nothing(seed in 1_u64.., w in 1_usize..90, h in 1_usize..70) {
        let mut rng = Rng(seed);
        let data = scene(&mut rng, w, h);
        let float: Vec<f32> = data.iter().map(|&v| f32::from(v)).collect();
        let f = rng.within(20.0, 120.0);
        let fy = if rng.next().is_multiple_of(4) { -f } else { f };
        let k = Intrinsics::new(f, fy, w as f32 / 2.0 - 0.5, h as f32 / 2.0 - rng.within(0.0, 1.0)).unwrap();
        let pose = Pose::new(Quat::from_rotation_y(rng.within(-0.5, 0.5)), Vec3::new(0.1, 0.2, 0.3)).unwrap();
        let mut frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
        let mut frame_f = DepthFrame::new(ImageView::new(&float, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
        if rng.next().is_multiple_of(2) {
            (frame, frame_f) = (frame.with_pose(pose), frame_f.with_pose(pose));
        }
        let mut cells = vec![Cell::EMPTY; cells_needed(w, h)];
        let pyramid = Pyramid::build(frame.depth(), &mut cells).unwrap();
        for _ in 0..40 {
            let (ray, params) = (any_ray(&mut rng), any_params(&mut rng));
            let full = cast(&frame, None, &ray, &params);
            let fast = cast(&frame, Some(&pyramid), &ray, &params);
            prop_assert_eq!(full.outcome, fast.outcome, "{:?} {:?}", ray, params);
            prop_assert_eq!(full.work.done, fast.work.done + fast.work.skipped);
            prop_assert_eq!(full.work.skipped + full.tiles, 0);
            prop_assert!(full.work.done as usize <= w + h);
            prop_assert_eq!(finite(&full.outcome), true, "{:?}", full.outcome);
            // 65535 is a hole as u16 and a reading as f32.
            if !data.contains(&u16::MAX) {
                prop_assert_eq!(cast(&frame_f, None, &ray, &params), full);
            }
        }
    }
}

/// Rays that pass exactly through pixel corners: the order of tied crossings is the same for pixels and tiles.
#[test]
fn through_the_corners_of_pixels() {
    let mut rng = Rng(31);
    let k = Intrinsics::new(64.0, 64.0, -0.5, -0.5).unwrap();
    let mut skipped = 0;
    for _ in 0..300 {
        // Nothing near but single pixels at half a metre.
        let data: Vec<u16> = (0..64 * 64).map(|_| if rng.next().is_multiple_of(40) { 500 } else { 3000 }).collect();
        let frame = DepthFrame::new(ImageView::new(&data, 64, 64).unwrap(), DepthUnit::MILLIMETRE, k);
        let mut cells = vec![Cell::EMPTY; cells_needed(64, 64)];
        let pyramid = Pyramid::build(frame.depth(), &mut cells).unwrap();
        for (x, y) in [(1.0, 1.0), (1.0, 2.0), (2.0, 1.0), (1.0, 4.0), (4.0, 1.0), (1.0, 8.0), (8.0, 1.0)] {
            let there = Vec3::new(x, y, 0.0);
            let back = Ray::new(there / there.max_element() + Vec3::Z, -there).unwrap();
            for ray in [Ray::new(Vec3::Z, there).unwrap(), back] {
                let full = cast(&frame, None, &ray, &RayParams::default());
                let fast = cast(&frame, Some(&pyramid), &ray, &RayParams::default());
                assert_eq!(full.outcome, fast.outcome, "{ray:?}");
                assert_eq!(full.work.done, fast.work.done + fast.work.skipped);
                skipped += fast.work.skipped;
            }
        }
    }
    assert!(skipped > 10_000, "{skipped}");
}

fn finite(outcome: &RayOutcome) -> bool {
    match outcome {
        RayOutcome::Hit(h) => h.point.is_finite() && h.distance.is_finite() && h.z.is_finite() && h.z > 0.0,
        RayOutcome::HitOccluded { point, distance, .. } => point.is_finite() && distance.is_finite(),
        _ => true,
    }
}

fn f64s(v: Vec3) -> [f64; 3] {
    v.to_array().map(f64::from)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The inverse of a rotation, in f64: R^T v from the quaternion's matrix.
fn to_camera(q: Quat, v: [f64; 3]) -> [f64; 3] {
    let [x, y, z, w] = q.to_array().map(f64::from);
    let columns = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
        [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
        [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
    ];
    columns.map(|c| dot(c, v))
}

/// What the oracle says, and how far its nearest decision was from going the other way (metres, or metres along the ray).
struct Oracle {
    verdict: &'static str,
    distance: f64,
    pixel: (usize, usize),
    passed_behind: bool,
    margin: f64,
}

/// The same question in f64, another way: cut the ray with the pyramid of space behind *every* pixel, sort the pieces by
/// distance, then read the model's definition off them.
fn oracle(frame: &DepthFrame<'_>, ray: &Ray, params: &RayParams) -> Oracle {
    let k = frame.intrinsics();
    let pose = frame.pose_or_identity();
    let (position, origin) = (f64s(pose.translation()), f64s(ray.origin()));
    let o = to_camera(pose.rotation(), core::array::from_fn(|i| origin[i] - position[i]));
    let d = to_camera(pose.rotation(), f64s(ray.direction()));
    let (fx, fy, cx, cy) = (f64::from(k.fx()), f64::from(k.fy()), f64::from(k.cx()), f64::from(k.cy()));
    let (w, h) = frame.size();
    let clip = |x0: f64, x1: f64, y0: f64, y1: f64| {
        let (mut t0, mut t1) = (0.0_f64, f64::from(params.max_distance).min(1e6));
        let f = |p: [f64; 3]| {
            let (u, v) = (fx * p[0] + cx * p[2], fy * p[1] + cy * p[2]);
            [u - x0 * p[2], x1 * p[2] - u, v - y0 * p[2], y1 * p[2] - v]
        };
        let (mut a, b) = (f(o).to_vec(), f(d).to_vec());
        a.push(o[2] - 1e-3);
        for (a, b) in a.into_iter().zip(b.into_iter().chain([d[2]])) {
            if b > 0.0 {
                t0 = t0.max(-a / b);
            } else if b < 0.0 {
                t1 = t1.min(-a / b);
            } else if a < 0.0 {
                t1 = f64::NEG_INFINITY;
            }
        }
        (t0 < t1).then_some((t0, t1))
    };
    let mut pieces = vec![];
    for y in 0..h {
        for x in 0..w {
            let (xf, yf) = (x as f64, y as f64);
            if let Some((a, b)) = clip(xf - 0.5, xf + 0.5, yf - 0.5, yf + 0.5) {
                pieces.push((a, b, (x, y)));
            }
        }
    }
    pieces.sort_by(|a, b| a.partial_cmp(b).unwrap());
    let mut margin = f64::INFINITY;
    let mut out = Oracle { verdict: "outside", distance: 0.0, pixel: (0, 0), passed_behind: false, margin: 0.0 };
    let (mut front, mut known, mut behind, mut hole) = (false, false, None, false);
    let thickness = f64::from(params.thickness);
    let mut hit = None;
    for (a, b, pixel) in &pieces {
        margin = margin.min((b - a) * 0.05);
        let depth = f64::from(frame.z(pixel.0, pixel.1));
        let (za, zb) = (o[2] + a * d[2], o[2] + b * d[2]);
        if depth == 0.0 {
            match params.holes {
                HolePolicy::Solid => {
                    hit = Some((*a, *pixel));
                    break;
                }
                HolePolicy::Unknown => hole = true,
                HolePolicy::Free => {}
            }
            continue;
        }
        margin = margin.min((za - depth).abs()).min((zb - depth).abs());
        margin = margin.min((za - depth - thickness).abs()).min((zb - depth - thickness).abs());
        if za < depth && zb >= depth {
            hit = Some(((depth - o[2]) / d[2], *pixel));
            break;
        }
        if za >= depth && known && front && za - depth <= thickness {
            hit = Some((*a, *pixel));
            break;
        }
        if behind.is_none() && za >= depth {
            if za - depth > thickness {
                behind = Some((*a, *pixel));
            } else if zb - depth > thickness {
                behind = Some((*b, *pixel));
            }
        }
        (known, front) = (true, zb < depth);
    }
    if let Some((distance, pixel)) = hit {
        out = Oracle { verdict: "hit", distance, pixel, passed_behind: behind.is_some(), margin };
    } else if let Some((distance, pixel)) = behind {
        out = Oracle { verdict: "occluded", distance, pixel, passed_behind: true, margin };
    } else if hole {
        out.verdict = "no depth";
    } else if !pieces.is_empty() {
        out.verdict = "miss";
    }
    Oracle { margin, ..out }
}

#[test]
fn verdicts_are_those_of_an_independent_f64_oracle() {
    let mut rng = Rng(0x1234_5678_9abc_def1);
    let (mut compared, mut all) = (0, 0);
    let mut seen = std::collections::BTreeMap::new();
    for _ in 0..150 {
        let (w, h) = (8 + rng.next() as usize % 40, 8 + rng.next() as usize % 30);
        let data = scene(&mut rng, w, h);
        let f = rng.within(20.0, 60.0);
        let k = Intrinsics::new(f, f, w as f32 / 2.0 - 0.4, h as f32 / 2.0 - 0.7).unwrap();
        let pose = Pose::new(Quat::from_rotation_x(rng.within(-0.4, 0.4)), Vec3::new(0.1, -0.2, 0.3)).unwrap();
        let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::MILLIMETRE, k).with_pose(pose);
        for _ in 0..20 {
            let from = Vec3::new(rng.within(-1.0, 1.0), rng.within(-1.0, 1.0), rng.within(-0.5, 4.0));
            let to = Vec3::new(rng.within(-1.0, 1.0), rng.within(-1.0, 1.0), rng.within(0.5, 5.0));
            let ray = Ray::new(from, to - from).unwrap();
            let params = any_params(&mut rng);
            if params.max_distance == 0.0 {
                continue; // no piece has a length
            }
            let want = oracle(&frame, &ray, &params);
            all += 1;
            if want.margin < 1e-4 {
                continue;
            }
            compared += 1;
            *seen.entry(want.verdict).or_insert(0) += 1;
            let got = cast(&frame, None, &ray, &params);
            let context = std::format!("{ray:?} {params:?} {got:?} want {}", want.verdict);
            match got.outcome {
                RayOutcome::Hit(hit) => {
                    assert_eq!((want.verdict, want.pixel), ("hit", hit.pixel), "{context}");
                    assert_eq!(want.passed_behind, hit.passed_behind, "{context}");
                    // The refined point lies within a pixel and a half of the model's.
                    let z = frame.pose_or_identity().to_camera(hit.point).z;
                    assert!((z - hit.z).abs() < 1e-4 * z.max(1.0), "{context}");
                }
                RayOutcome::HitOccluded { pixel, distance, .. } => {
                    assert_eq!((want.verdict, want.pixel), ("occluded", pixel), "{context}");
                    // A pixel near the vanishing point holds many metres of ray.
                    let bound = 1e-4 + 1e-5 * want.distance * want.distance;
                    assert!((f64::from(distance) - want.distance).abs() < bound, "{context} {}", want.distance);
                }
                RayOutcome::Miss { .. } => assert_eq!(want.verdict, "miss", "{context}"),
                RayOutcome::NoDepth => assert_eq!(want.verdict, "no depth", "{context}"),
                RayOutcome::OutsideView => assert_eq!(want.verdict, "outside", "{context}"),
            }
        }
    }
    assert!(compared * 2 > all, "only {compared} of {all} rays were clear enough to compare");
    assert!(seen.len() == 5 && seen.values().all(|&n| n > 20), "{seen:?}");
}

const K: Intrinsics = match Intrinsics::new(120.0, 120.0, 79.5, 59.5) {
    Ok(k) => k,
    Err(_) => panic!(),
};

/// A 160 x 120 image of what `z` says about each pixel's ray (x/z, y/z), metres.
fn image(z: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    (0..160 * 120).map(|i| z(((i % 160) as f32 - 79.5) / 120.0, ((i / 160) as f32 - 59.5) / 120.0)).collect()
}

fn frame_of(data: &[f32]) -> DepthFrame<'_, f32> {
    DepthFrame::new(ImageView::new(data, 160, 120).unwrap(), DepthUnit::METRE, K)
}

#[test]
fn slanted_planes_are_hit_where_f64_says() {
    let mut rng = Rng(77);
    let (mut worst, mut hits) = (0.0_f64, 0);
    for _ in 0..200 {
        // n . p = c, never edge-on in the view.
        let n = Vec3::new(rng.within(-0.6, 0.6), rng.within(-0.6, 0.6), 1.0);
        let c = rng.within(0.8, 4.0);
        let data = image(|x, y| c / (n.x * x + n.y * y + n.z));
        let frame = frame_of(&data);
        for _ in 0..20 {
            let origin = Vec3::new(rng.within(-0.3, 0.3), rng.within(-0.3, 0.3), rng.within(-0.3, 0.3));
            let direction = Vec3::new(rng.within(-0.5, 0.5), rng.within(-0.4, 0.4), 1.0);
            let ray = Ray::new(origin, direction).unwrap();
            let (o, d, n) = (f64s(ray.origin()), f64s(ray.direction()), f64s(n));
            let want = (f64::from(c) - dot(n, o)) / dot(n, d);
            if let Some(hit) = cast(&frame, None, &ray, &RayParams::default()).hit() {
                // At the image's rim a pixel lacks a neighbour, and the plane a slope.
                if (1..159).contains(&hit.pixel.0) && (1..119).contains(&hit.pixel.1) {
                    hits += 1;
                    worst = worst.max((f64::from(hit.distance) - want).abs() / want);
                }
            }
        }
    }
    assert!(hits > 1000, "{hits}");
    assert!(worst < 1e-5, "worst relative error {worst} of {hits}");
}

/// A wall at 2 m with a box's face at 1 m on the right half.
fn step_edge() -> Vec<f32> {
    image(|x, _| if x > 0.0 { 1.0 } else { 2.0 })
}

#[test]
fn a_foreground_object_is_not_an_endless_wall() {
    // A post at 1 m, |x/z| < 0.1, before a wall at 3 m.
    let data = image(|x, _| if x.abs() < 0.1 { 1.0 } else { 3.0 });
    let frame = frame_of(&data);
    let ray = Ray::new(Vec3::new(-1.0, 0.01, 1.8), Vec3::new(1.0, 0.0, 0.4)).unwrap();
    let hit = *cast(&frame, None, &ray, &RayParams::default()).hit().unwrap();
    assert!(hit.passed_behind && (hit.z - 3.0).abs() < 1e-4, "{hit:?}");
    assert!((hit.point - Vec3::new(2.0, 0.01, 3.0)).length() < 1e-3, "{hit:?}");
    // The same, stopped while behind: something may have been hit, nothing is known.
    let short = RayParams { max_distance: 1.0, ..RayParams::default() };
    match cast(&frame, None, &ray, &short).outcome {
        RayOutcome::HitOccluded { point, pixel, .. } => {
            // It goes behind where x/z = -0.1.
            assert!((point.x / point.z + 0.1).abs() < 0.01, "{point}");
            assert_eq!(pixel.1, 60);
        }
        other => panic!("{other:?}"),
    }
    // A thicker post is hit at its edge.
    let thick = RayParams { thickness: 2.0, ..RayParams::default() };
    let hit = *cast(&frame, None, &ray, &thick).hit().unwrap();
    assert!(!hit.passed_behind && hit.z > 1.5 && hit.z < 2.5, "{hit:?}");
}

#[test]
fn the_side_of_a_step_is_hit_within_the_thickness_only() {
    let data = step_edge();
    let frame = frame_of(&data);
    let at = |z: f32| {
        let ray = Ray::new(Vec3::new(-0.3, 0.01, z), Vec3::X).unwrap();
        cast(&frame, None, &ray, &RayParams::default()).outcome
    };
    assert!(matches!(at(1.2), RayOutcome::Hit(h) if h.point.x.abs() < 1e-4 && h.pixel.0 == 80), "{:?}", at(1.2));
    assert!(matches!(at(1.5), RayOutcome::HitOccluded { point, .. } if point.x.abs() < 1e-4), "{:?}", at(1.5));
    assert_eq!(at(0.8), RayOutcome::Miss { left_view: true });
    // The other way, out of hiding: no hit.
    let out = Ray::new(Vec3::new(0.3, 0.01, 1.2), Vec3::NEG_X).unwrap();
    assert_eq!(cast(&frame, None, &out, &RayParams::default()).outcome, RayOutcome::Miss { left_view: true });
}

#[test]
fn rays_along_the_axis_and_at_the_camera() {
    let data = step_edge();
    let frame = frame_of(&data);
    let cast = |o: Vec3, d: Vec3| cast(&frame, None, &Ray::new(o, d).unwrap(), &RayParams::default());
    let ahead = cast(Vec3::ZERO, Vec3::new(0.001, 0.001, 1.0));
    assert!((ahead.hit().unwrap().z - 1.0).abs() < 1e-6);
    assert_eq!(ahead.work.done, 1, "through the camera's centre is one pixel");
    assert!((cast(Vec3::new(0.001, 0.001, -5.0), Vec3::Z).hit().unwrap().distance - 6.0).abs() < 1e-5);
    assert_eq!(cast(Vec3::new(0.001, 0.001, 0.9), Vec3::NEG_Z).outcome, RayOutcome::Miss { left_view: true });
    assert_eq!(cast(Vec3::new(0.0, 0.0, -0.1), Vec3::NEG_Z).outcome, RayOutcome::OutsideView);
    assert_eq!(cast(Vec3::new(9.0, 0.0, 1.0), Vec3::Y).outcome, RayOutcome::OutsideView);
    // From behind the wall towards the camera: out of hiding, no hit.
    assert!(matches!(cast(Vec3::new(0.01, 0.0, 5.0), Vec3::NEG_Z).outcome, RayOutcome::HitOccluded { .. }));
}

#[test]
fn holes_mean_what_the_policy_says() {
    let data = image(|x, _| if x > 0.0 { 0.0 } else { 2.0 });
    let frame = frame_of(&data);
    let at = |direction: Vec3, holes| {
        let ray = Ray::new(Vec3::new(-0.3, 0.01, 1.0), direction).unwrap();
        cast(&frame, None, &ray, &RayParams { holes, ..RayParams::default() }).outcome
    };
    assert_eq!(at(Vec3::X, HolePolicy::Unknown), RayOutcome::NoDepth);
    assert_eq!(at(Vec3::X, HolePolicy::Free), RayOutcome::Miss { left_view: true });
    assert!(matches!(at(Vec3::X, HolePolicy::Solid), RayOutcome::Hit(h) if h.from_hole && h.point.x.abs() < 1e-4));
    // Without a hole on the way the policy is not asked.
    for holes in [HolePolicy::Unknown, HolePolicy::Free, HolePolicy::Solid] {
        assert!(matches!(at(Vec3::Z, holes), RayOutcome::Hit(h) if !h.from_hole));
    }
}

#[test]
fn impossible_arguments_have_answers() {
    let ray = Ray::new(Vec3::new(0.0, 0.0, 0.1), Vec3::new(0.1, 0.2, 1.0)).unwrap();
    for (w, h) in [(0, 0), (0, 9), (9, 0), (1, 1), (1, 64), (64, 1)] {
        let data = vec![1000_u16; w * h];
        let k = Intrinsics::new(30.0, 30.0, w as f32 / 2.0, h as f32 / 2.0).unwrap();
        let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
        let mut cells = vec![Cell::EMPTY; cells_needed(w, h)];
        let pyramid = Pyramid::build(frame.depth(), &mut cells).unwrap();
        let cast = cast(&frame, Some(&pyramid), &ray, &RayParams::default());
        assert_eq!(cast.outcome == RayOutcome::OutsideView, w * h == 0, "{w}x{h} {cast:?}");
    }
    let data = step_edge();
    let frame = frame_of(&data);
    let mut cells = [Cell::EMPTY; cells_needed(8, 8)];
    let other = Pyramid::build(ImageView::new(&[1.0_f32; 64], 8, 8).unwrap(), &mut cells).unwrap();
    let want = cast(&frame, None, &ray, &RayParams::default());
    assert_eq!(cast(&frame, Some(&other), &ray, &RayParams::default()), want, "a foreign pyramid is ignored");
    let nan = RayParams { max_distance: f32::NAN, thickness: f32::NAN, ..RayParams::default() };
    assert_eq!(cast(&frame, None, &ray, &nan).outcome, RayOutcome::Miss { left_view: false });
    let far = RayParams { max_distance: f32::INFINITY, ..RayParams::default() };
    for scale in [1e-30, 1e10, 1e30, 3e38] {
        let ray = Ray::new(Vec3::new(-scale, 0.01, 1.0), Vec3::X).unwrap();
        assert!(finite(&cast(&frame, None, &ray, &far).outcome));
    }
}

/// How much of a long ray the pyramid saves in an open room.
#[test]
fn the_pyramid_saves_work() {
    let data = image(|x, y| {
        if y > 0.1 {
            1.2 / y
        } else if x > 0.2 && y > -0.1 {
            2.5
        } else {
            6.0
        }
    });
    let frame = frame_of(&data);
    let mut cells = vec![Cell::EMPTY; cells_needed(160, 120)];
    let pyramid = Pyramid::build(frame.depth(), &mut cells).unwrap();
    let mut rng = Rng(5);
    let (mut work, mut tiles) = (Work::default(), 0);
    for _ in 0..2000 {
        let origin = Vec3::new(rng.within(-0.6, 0.6), rng.within(-0.4, 0.4), rng.within(0.3, 1.5));
        let to = Vec3::new(rng.within(-2.0, 2.0), rng.within(-1.0, 1.0), rng.within(1.0, 6.0));
        let cast = cast(&frame, Some(&pyramid), &Ray::new(origin, to - origin).unwrap(), &RayParams::default());
        work += cast.work;
        tiles += cast.tiles;
    }
    std::println!("skipped {:.3} of pixels, {tiles} tiles for {work:?}", work.skipped_share());
    assert!(work.skipped_share() > 0.6 && tiles < work.skipped, "{work:?} {tiles}");
}
