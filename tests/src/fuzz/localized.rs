//! The localized answers, all of one small frame of any numbers.

use arbitrary::{Arbitrary, Result, Unstructured};
use isobath::glam::Vec3;
use isobath::ground::geometry::{OrientedBox, Ray};
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::localized::collision::{CollisionParams, Verdict, box_points, capsule_points, vote};
use isobath::localized::hit::{HitOutcome, HitParams, hit_test};
use isobath::localized::normals::{NormalMethod, NormalParams, dense, normal_at};
use isobath::localized::one_euro::{OneEuro, OneEuroParams};
use isobath::localized::particles::{ParticleParams, ParticlePool};
use isobath::localized::plane::ground::{GroundParams, dominant_plane, estimate_ground};
use isobath::localized::raycast::{RayCast, RayParams, cast};
use isobath::localized::reflect::{Bounce, ReflectParams, reflect};
use isobath::sensing::camera::Pose;
use isobath::sensing::depth::{DepthSample, DepthUnit, HolePolicy};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

use super::sensing::intrinsics;
use super::{fill, number, quat, vec2, vec3, word};

pub(super) fn holes(u: &mut Unstructured<'_>) -> Result<HolePolicy> {
    Ok(*u.choose(&[HolePolicy::Unknown, HolePolicy::Solid, HolePolicy::Free])?)
}

pub(super) fn unit_length(n: Vec3) -> bool {
    (n.length() - 1.0).abs() < 1e-3
}

/// Depths at which the squares of inverse depth stay within `f32`. Beyond, a normal may lose its length, but not panic.
pub(super) fn on_earth(z: f32) -> bool {
    (1e-6..1e7).contains(&z)
}

/// Calls every answer on the frame that the bytes describe, and holds each to what its documentation promises of any input.
fn answers<D: DepthSample>(u: &mut Unstructured<'_>, next: impl Fn(&mut Unstructured<'_>) -> Result<D>) -> Result<()> {
    let (width, height) = (u.int_in_range(0..=40)?, u.int_in_range(0..=24)?);
    let unit =
        if u.ratio(1, 4)? { DepthUnit::new(number(u)?).unwrap_or(DepthUnit::TUM) } else { DepthUnit::MILLIMETRE };
    let k = intrinsics(u)?;
    let (turn, place) = (quat(u)?, vec3(u)?);
    let pose = Pose::new(turn, place).ok();
    let (at, a, b) = (vec2(u)?, vec3(u)?, vec3(u)?);
    let rays = RayParams { max_distance: number(u)?, thickness: number(u)?, holes: holes(u)? };
    let method = *u.choose(&[NormalMethod::Exact, NormalMethod::Paper])?;
    let max_step = if bool::arbitrary(u)? { Some(number(u)?) } else { None };
    let normals = NormalParams { method, radius: u.int_in_range(0..=9)?, max_step };
    let euro =
        OneEuroParams { min_cutoff: number(u)?, beta: number(u)?, derivative_cutoff: number(u)?, max_gap: number(u)? };
    let times = [i64::arbitrary(u)?, i64::arbitrary(u)?];
    let values = fill(u, width * height, next)?;

    let depth = ImageView::new(&values, width, height).expect("as long as asked");
    let frame = DepthFrame::new(depth, unit, k);
    let frame = pose.map_or(frame, |pose| frame.with_pose(pose));
    let mut cells = vec![Cell::EMPTY; cells_needed(width, height)];
    let pyramid = Pyramid::build(depth, &mut cells).expect("as long as asked");

    // Normals.
    let pixels = [(0, 0), (width / 2, height / 2), (width.saturating_sub(1), 0), (width, height), (usize::MAX, 0)];
    for (x, y) in pixels {
        if let Some(estimate) = normal_at(&frame, x, y, &normals) {
            assert!(depth.get(x, y).is_some_and(D::is_valid), "{estimate:?}");
            assert!(unit_length(estimate.normal) || !on_earth(frame.z(x, y)), "{estimate:?}");
        }
    }
    let mut scratch = vec![0.0; dense::scratch_len(width)];
    let mut rows = 0;
    let work = dense::rows(&frame, &normals, &mut scratch, |line, row| {
        rows += usize::from(row.x.len() == width);
        for (column, ((x, y), z)) in row.x.iter().zip(row.y).zip(row.z).enumerate() {
            let n = Vec3::new(*x, *y, *z);
            assert!(n.is_nan() || unit_length(n) || !on_earth(frame.z(column, line)), "{n}");
        }
    });
    let work = work.expect("as long as asked");
    assert_eq!((work.done + work.skipped) as usize, width * height);
    assert_eq!(rows, if width == 0 { 0 } else { height });

    // Hits.
    let params = HitParams { normal: Some(normals), ..HitParams::default() };
    if let HitOutcome::Hit(hit) = hit_test(&frame, at, &params) {
        assert!(hit.normal.is_none_or(unit_length) || !on_earth(hit.camera_point.z), "{hit:?}");
    }

    // Rays: skipping changes nothing, to the bit.
    if let Some(ray) = Ray::new(a, b) {
        let skipping = cast(&frame, Some(&pyramid), &ray, &rays);
        let full = cast(&frame, None, &ray, &rays);
        assert!(same(&skipping, &full), "{skipping:?} {full:?}");
        let mut bounces = [Bounce::EMPTY; 3];
        let params = ReflectParams { ray: rays, normals, offset: a.x };
        let path = reflect(&frame, Some(&pyramid), &ray, &params, &mut bounces);
        assert!(path.bounces <= bounces.len());
    }

    // Collisions: a verdict other than unknown has its voters.
    let object = OrientedBox { centre: a, half: b, rotation: turn };
    let votes =
        CollisionParams { tolerance: rays.thickness, threshold: a.x, min_voters: 3.0, ..CollisionParams::default() };
    let capsule = capsule_points(a, b, at.x);
    for collision in [vote(&frame, box_points(&object, b), &votes), vote(&frame, capsule, &votes)] {
        let tally = collision.tally;
        assert!(collision.verdict == Verdict::Unknown || tally.visible + tally.hidden >= 3, "{collision:?}");
        assert!(tally.visible + tally.hidden + tally.holes + tally.outside <= 14);
    }

    // Weather.
    let mut pool = ParticlePool::<8>::new(times[0] as u64);
    for params in [ParticleParams::rain(object, b), ParticleParams::snow(object, Vec3::Y)] {
        for dt in [0.03, at.y] {
            let report = pool.step(&frame, Some(&pyramid), &params, dt);
            assert!(report.falling + report.landed <= 8, "{report:?}");
        }
    }

    // Planes.
    for plane in
        [estimate_ground(&frame, a, &GroundParams::default()), dominant_plane(&frame, b, &GroundParams::default())]
    {
        match plane {
            Ok(found) => assert!(unit_length(found.fit.plane.normal()), "{found:?}"),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }

    // Filters.
    if let Ok(mut filter) = OneEuro::<Vec3>::new(euro) {
        for (sample, time) in [(a, times[0]), (b, times[1]), (a, times[0])] {
            let out = filter.filter(sample, Timestamp::from_nanos(time));
            assert!(out.is_finite() || !sample.is_finite() || !(a + b).is_finite() || !(a - b).is_finite(), "{out}");
        }
    }
    Ok(())
}

/// NaN equals NaN here: the same bits are the same answer.
fn same(a: &RayCast, b: &RayCast) -> bool {
    format!("{:?}", a.outcome) == format!("{:?}", b.outcome)
}

/// Every localized answer of one frame.
pub fn localized(data: &[u8]) {
    let _ = answers(&mut Unstructured::new(data), word);
    let _ = answers(&mut Unstructured::new(data), number);
}
