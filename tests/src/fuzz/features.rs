//! The features that build on the localized answers, all of one small frame of any numbers.

use arbitrary::{Arbitrary, Result, Unstructured};
use isobath::glam::{Quat, Vec3};
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::localized::avatar::{Avatar, AvatarParams, AvatarState};
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::measure::{self, PatchParams};
use isobath::localized::normals::adaptive::{self, AdaptiveParams, BlockSize};
use isobath::localized::placement::search::{SearchParams, find_place};
use isobath::localized::placement::{Facing, PlaceParams, Spot, Stand, place};
use isobath::localized::planner::{Node, Plan, Planner, Walker, path_changed};
use isobath::localized::reticle::{Reticle, ReticleHit, ReticleParams, ReticleState};
use isobath::sensing::camera::Pose;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

use super::localized::{holes, on_earth, unit_length};
use super::sensing::intrinsics;
use super::{fill, number, quat, vec3, word};

fn unit_quat(q: Quat) -> bool {
    (q.length() - 1.0).abs() < 1e-3
}

/// A parameter: as documented by default, or any number.
fn wild(u: &mut Unstructured<'_>, plain: f32) -> Result<f32> {
    if u.ratio(2, 3)? { Ok(plain) } else { number(u) }
}

/// Placement, measurement, cursor, map, planner, avatar, normals of noisy sensors; each held to what it promises.
fn all<D: DepthSample>(u: &mut Unstructured<'_>, next: impl Fn(&mut Unstructured<'_>) -> Result<D>) -> Result<()> {
    let (width, height) = (u.int_in_range(0..=40)?, u.int_in_range(0..=24)?);
    let k = intrinsics(u)?;
    let pose = Pose::new(quat(u)?, vec3(u)?).unwrap_or_default();
    let (up, a, b) = if bool::arbitrary(u)? { (Vec3::NEG_Y, vec3(u)?, vec3(u)?) } else { (vec3(u)?, Vec3::Z, Vec3::X) };
    let noise = DepthNoise { constant: wild(u, 0.001)?, linear: wild(u, 0.001)?, quadratic: wild(u, 0.001)? };
    let adaptive = AdaptiveParams {
        noise,
        block: *u.choose(&[BlockSize::Auto, BlockSize::Four, BlockSize::Eight, BlockSize::Sixteen])?,
    };
    let patch = PatchParams { radius: u.int_in_range(0..=7)?, max_jump: wild(u, 0.1)? };
    let wanted = PlaceParams {
        facing: if bool::arbitrary(u)? { Facing::Camera } else { Facing::Along(a) },
        stand: *u.choose(&[Stand::OnSurface, Stand::Upright])?,
        max_tilt: wild(u, 3.0)?,
        max_roughness: wild(u, 1.0)?,
        min_coverage: wild(u, 0.1)?,
        clearance: wild(u, 0.02)?,
        max_hidden: wild(u, 0.5)?,
        max_unknown: wild(u, 0.5)?,
        holes: holes(u)?,
        ..PlaceParams::new(if bool::arbitrary(u)? { Vec3::splat(0.05) } else { vec3(u)? }, up)
    };
    let search = SearchParams {
        start: if bool::arbitrary(u)? { Some((u.int_in_range(0..=50)?, usize::arbitrary(u)?)) } else { None },
        step: if bool::arbitrary(u)? { Some(u.int_in_range(0..=usize::MAX)?) } else { None },
        max_tries: u.int_in_range(0..=20)?,
    };
    let cursor = ReticleParams { turn_time: wild(u, 0.1)?, move_time: wild(u, 0.0)?, hold: wild(u, 1.0)? };
    let (cell, columns, rows) = (wild(u, 0.05)?, u.int_in_range(0..=16)?, u.int_in_range(0..=16)?);
    let heights = HeightMapParams {
        clearance: wild(u, 1.0)?,
        reach: wild(u, 3.0)?,
        stride: u.int_in_range(0..=3)?,
        max_support: u.int_in_range(0..=9)?,
        change: wild(u, 0.02)?,
    };
    let walker = Walker {
        radius: wild(u, 0.1)?,
        max_step: wild(u, 0.2)?,
        max_slope: wild(u, 0.6)?,
        climb_cost: wild(u, 1.0)?,
        unknown: holes(u)?,
    };
    let ghost = AvatarParams {
        height: wild(u, 0.5)?,
        drop: wild(u, 3.0)?,
        speed: wild(u, 0.5)?,
        longest_step: wild(u, 0.1)?,
        arrival: wild(u, 0.01)?,
        ..AvatarParams::default()
    };
    let times = [i64::arbitrary(u)?, i64::arbitrary(u)?, 0, 30_000_000].map(Timestamp::from_nanos);
    let values = fill(u, width * height, next)?;

    let depth = ImageView::new(&values, width, height).expect("as long as asked");
    let frame = DepthFrame::new(depth, DepthUnit::MILLIMETRE, k).with_pose(pose);
    let mut cells = vec![Cell::EMPTY; cells_needed(width, height)];
    let pyramid = Pyramid::build(depth, &mut cells).expect("as long as asked");
    let (x, y) = (width / 2, height / 2);

    // Normals of noisy sensors.
    let mut scratch = vec![0.0; adaptive::scratch_len(width)];
    let mut lines = 0;
    let work = adaptive::rows(&frame, &adaptive, &mut scratch, |_, row| {
        lines += usize::from(row.x.len() == width && row.sigma.len() == width);
        for ((x, y), z) in row.x.iter().zip(row.y).zip(row.z) {
            let n = Vec3::new(*x, *y, *z);
            assert!(
                n.is_nan()
                    || unit_length(n)
                    || values.iter().any(|&v| v.is_valid() && !on_earth(v.metres(frame.unit()))),
                "{n}"
            );
        }
    });
    let work = work.expect("as long as asked");
    assert_eq!((work.done + work.skipped) as usize, width * height);
    assert_eq!(work.done as usize, values.iter().filter(|v| v.is_valid()).count());
    assert_eq!(lines, if width == 0 { 0 } else { height });

    // Measurement.
    let ends = [measure::measure_point(&frame, x, y, &noise), measure::measure_point(&frame, 0, 0, &noise)];
    assert_eq!(ends[0].is_some(), measure::to_camera(&frame, x, y, &noise).is_some());
    let flat = measure::patch(&frame, x, y, &noise, &patch);
    if let [Some(a), Some(b)] = ends {
        let length = measure::between(&a, &b);
        assert!(!(length.value < 0.0) && !(length.sigma < 0.0), "{length:?}");
        if let Ok(flat) = &flat {
            assert!(!(measure::height_above(&a, &flat.fit).sigma < 0.0), "{flat:?}");
        }
    }
    if let Err(error) = flat {
        assert!(!error.to_string().is_empty());
    }

    // Placement: the pyramid changes no answer, and what is placed is in the world.
    for spot in [Spot::Pixel(x, y), Spot::Pixel(usize::MAX, 0), Spot::World(a)] {
        let (skipping, full) = (place(&frame, Some(&pyramid), spot, &wanted), place(&frame, None, spot, &wanted));
        assert_eq!(format!("{:?}", skipping.outcome), format!("{:?}", full.outcome));
        match full.outcome {
            Ok(found) => assert!(found.pose.centre.is_finite() && found.coverage <= 1.0, "{found:?}"),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    let mut best = [None; 3];
    let report = find_place(&frame, Some(&pyramid), &wanted, &search, &mut best);
    assert!(report.tried <= search.max_tries);
    assert_eq!(report.found, best.iter().take_while(|p| p.is_some()).count());

    // The cursor.
    match Reticle::new(cursor) {
        Ok(mut reticle) => {
            let hits = [
                Some(ReticleHit { point: a, normal: Some(b) }),
                None,
                Some(ReticleHit { point: b, normal: None }),
                frame.world_point(x, y).map(|point| ReticleHit { point, normal: Some(a) }),
            ];
            for (hit, time) in hits.into_iter().zip(times) {
                if let ReticleState::Tracking(pose) | ReticleState::Holding { pose, .. } =
                    reticle.update(hit, &frame.pose_or_identity(), time)
                {
                    assert!(pose.position.is_finite() && unit_quat(pose.orientation), "{pose:?}");
                }
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }

    // The map, and the ways over it.
    let mut storage = vec![HeightCell::UNKNOWN; columns * rows];
    let map = Grid::new(a, up, b, cell, columns, rows).and_then(|grid| HeightMap::new(grid, &mut storage, heights));
    match map {
        Ok(mut map) => {
            let seen = map.integrate(&frame);
            let read = seen.used + seen.overhead + seen.outside + seen.holes;
            assert_eq!(
                read as usize,
                width.div_ceil(heights.stride as usize) * height.div_ceil(heights.stride as usize)
            );
            let mut nodes = vec![Node::EMPTY; columns * rows];
            let mut points = [Vec3::ZERO; 5];
            let grid = *map.grid();
            for (start, goal) in [(grid.point_of(0, 0, 0.0), grid.point_of(columns / 2, rows / 2, 0.0)), (a, b)] {
                let plan = Planner::new(&mut nodes).plan(&map, &walker, start, goal, &mut points);
                match plan {
                    Ok(Plan::Found(path)) => {
                        assert!(path.points >= 1 && path.points <= points.len(), "{path:?}");
                        let old = points;
                        let again = Planner::new(&mut nodes).replan(&map, &walker, start, goal, &path, &mut points);
                        assert!(again.is_ok() && points == old, "{again:?}");
                    }
                    Ok(_) => {}
                    Err(error) => assert!(!error.to_string().is_empty()),
                }
                if walker.radius >= 0.0 {
                    let _ = path_changed(&map, &walker, &[start, goal, a], 0);
                }
                // Then as if the camera had shown it all, but for a wall.
                map.fade();
                for (column, row) in (0..columns).flat_map(|c| (0..rows).map(move |r| (c, r))) {
                    map.set(column, row, a.x, if column == 3 { b.y } else { a.x });
                }
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }

    // The paper's avatar.
    match Avatar::new(a, up, ghost) {
        Ok(mut avatar) => {
            for (target, time) in [a, b, up, Vec3::ZERO].into_iter().zip(times) {
                let step = avatar.step(&frame, Some(&pyramid), target, time);
                let lost = matches!(step.state, AvatarState::NoTarget);
                assert!(lost || !target.is_nan(), "{step:?}");
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    Ok(())
}

/// Every feature of one frame.
pub fn features(data: &[u8]) {
    let _ = all(&mut Unstructured::new(data), word);
    let _ = all(&mut Unstructured::new(data), number);
}
