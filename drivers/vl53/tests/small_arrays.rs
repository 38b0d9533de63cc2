//! 8 x 8 and 4 x 4 frames go through the core as any frame does: nothing in it knows how small they are. Exact planes give exact
//! answers.

use isobath::glam::{Quat, Vec2, Vec3, vec2, vec3};
use isobath::ground::geometry::{OrientedBox, Ray};
use isobath::ground::image::ImageView;
use isobath::localized::collision::{CollisionParams, Verdict, vote};
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::hit::{HitOutcome, HitParams, hit_test};
use isobath::localized::normals::adaptive::{self, AdaptiveParams};
use isobath::localized::normals::{NormalParams, dense, normal_at};
use isobath::localized::placement::{PlaceParams, Spot, place};
use isobath::localized::planner::{Node, Plan, Planner, Walker};
use isobath::localized::raycast::{RayParams, cast};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::{DepthArray, DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_vl53::{FOV_45, ZoneParams, pinhole, zones};

/// A wall seen squarely at 1 m: what every zone of a real sensor reports.
fn wall<const N: usize>() -> (DepthArray<N, N>, Intrinsics) {
    let (distances, statuses) = (vec![1000_i16; N * N], vec![5_u8; N * N]);
    let k = pinhole(FOV_45, N).unwrap();
    let mut depth = DepthArray::filled(0);
    let report = zones(&distances, &statuses, &ZoneParams::default(), &k, &mut depth.view_mut(), None).unwrap();
    assert_eq!(report.valid, N * N);
    (depth, k)
}

fn squarely_at_a_wall<const N: usize>() {
    let (depth, k) = wall::<N>();
    let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, k);
    let middle = 0.5 * N as f32 - 0.5;

    // Every zone: depth 1 m to the last bit, and it faces us exactly.
    for (x, y) in (0..N).flat_map(|y| (0..N).map(move |x| (x, y))) {
        for params in [NormalParams::default(), NormalParams::POINT, NormalParams::PAPER] {
            let normal = normal_at(&frame, x, y, &params).unwrap_or_else(|| panic!("{N}: no normal at {x},{y}"));
            assert!((normal.normal - Vec3::NEG_Z).length() < 1e-6, "{N}: {x},{y}: {:?}", normal.normal);
        }
        let at = vec2(x as f32, y as f32);
        let HitOutcome::Hit(hit) = hit_test(&frame, at, &HitParams::default()) else { panic!("{x},{y}") };
        assert_eq!((hit.z, hit.pixel), (1.0, (x, y)));
        assert!((hit.camera_point - k.ray(at)).length() < 1e-6);
    }
    // The corners of the field of view: 45 degrees from edge to edge.
    let edge = hit_test(&frame, vec2(-0.5, middle), &HitParams::default());
    let edge = edge.hit().unwrap().camera_point;
    assert!((edge.x / edge.z + (0.5 * FOV_45).tan()).abs() < 1e-6, "{edge}");
    assert_eq!(hit_test(&frame, vec2(N as f32 - 0.49, 0.0), &HitParams::default()), HitOutcome::OutsideView);

    // Dense, all rows.
    let mut scratch = vec![0.0; dense::scratch_len(N)];
    let mut rows = 0;
    dense::rows_with_fit(&frame, &NormalParams::default(), &mut scratch, |_, row, _| {
        assert!(row.z.iter().take(N).all(|z| (z + 1.0).abs() < 1e-6));
        rows += 1;
    })
    .unwrap();
    assert_eq!(rows, N);
    let mut scratch = vec![0.0; adaptive::scratch_len(N)];
    adaptive::rows(&frame, &AdaptiveParams::default(), &mut scratch, |_, row| {
        assert!(row.z.iter().take(N).all(|z| (z + 1.0).abs() < 1e-4), "{:?}", row.z);
    })
    .unwrap();

    // Pyramid and rays, with and without.
    let mut cells = vec![Cell::EMPTY; cells_needed(N, N)];
    let pyramid = Pyramid::build(depth.view(), &mut cells).unwrap();
    assert_eq!(pyramid.whole(), Cell { min: 1000, max: 1000, holes: 0 });
    for to in [vec3(0.0, 0.0, 1.0), vec3(0.3, -0.2, 1.0), vec3(-0.1, 0.37, 1.0)] {
        let ray = Ray::new(Vec3::ZERO, to).unwrap();
        let with = cast(&frame, Some(&pyramid), &ray, &RayParams::default());
        assert_eq!(with.outcome, cast(&frame, None, &ray, &RayParams::default()).outcome);
        assert!((with.hit().unwrap().point - to).length() < 1e-6);
    }

    // Room before the wall, none in it, and nobody knows beside the view.
    let verdict = |centre| {
        let object = OrientedBox { centre, half: Vec3::splat(0.05), rotation: Quat::IDENTITY };
        vote(&frame, object.corners(), &CollisionParams::default()).verdict
    };
    assert_eq!(verdict(vec3(0.0, 0.0, 0.7)), Verdict::Free);
    assert_eq!(verdict(vec3(0.0, 0.0, 1.3)), Verdict::Blocked);
    assert_eq!(verdict(vec3(2.0, 0.0, 0.7)), Verdict::Unknown);

    // A box stands on it, when it is a table seen from above.
    let spot = Spot::Pixel(N / 2, N / 2);
    let table = place(&frame, Some(&pyramid), spot, &PlaceParams::new(Vec3::splat(0.2), Vec3::NEG_Z)).outcome.unwrap();
    assert!((table.pose.centre.z - 0.9).abs() < 1e-6 && table.coverage == 1.0 && table.flatness < 1e-6);
}

#[test]
fn a_wall_seen_squarely_is_exact_in_every_answer() {
    squarely_at_a_wall::<8>();
    squarely_at_a_wall::<4>();
}

/// A tilted plane in `f32` depth: exact to rounding. In whole millimetres: to what rounding to them does.
fn tilted<D: DepthSample, const N: usize>(unit: DepthUnit, within: f32) {
    let k = pinhole(FOV_45, N).unwrap();
    let (normal, distance) = (vec3(0.4, -0.3, -1.0).normalize_or_zero(), 1.0);
    let z = |at: Vec2| -distance / normal.dot(k.ray(at));
    let data: Vec<D> = (0..N * N).map(|i| D::from_metres(z(vec2((i % N) as f32, (i / N) as f32)), unit)).collect();
    let frame = DepthFrame::new(ImageView::new(&data, N, N).unwrap(), unit, k);
    for (x, y) in (0..N).flat_map(|y| (0..N).map(move |x| (x, y))) {
        for params in [NormalParams::default(), NormalParams::POINT] {
            let found = normal_at(&frame, x, y, &params).unwrap_or_else(|| panic!("{N}: {x},{y}"));
            let off = (found.normal - normal).length();
            assert!(off < within, "{N}: {x},{y}: off by {off}");
        }
    }
    for at in [vec2(1.2, 1.7), vec2(0.0, 2.0), vec2(N as f32 - 0.6, 0.4)] {
        let hit = *hit_test(&frame, at, &HitParams::default()).hit().unwrap();
        assert!((hit.z - z(at)).abs() < within, "{N}: {at}: {} against {}", hit.z, z(at));
        let hit = cast(&frame, None, &Ray::new(Vec3::ZERO, k.ray(at)).unwrap(), &RayParams::default());
        let off = (hit.hit().unwrap().point - k.ray(at) * z(at)).length();
        // A ray's hit is moved onto the plane of both neighbours; outermost zones have one, whose slope here is far above what
        // a ray believes from one: there the hit is on the zone's own patch, half a zone's change of depth off at most.
        let (x, y) = hit.hit().unwrap().pixel;
        let inside = (1..N - 1).contains(&x) && (1..N - 1).contains(&y);
        assert!(off < if inside { 4.0 * within } else { 0.1 }, "{N}: {at}: off by {off} m");
    }
}

#[test]
fn a_tilted_plane_is_exact_to_rounding() {
    tilted::<f32, 8>(DepthUnit::METRE, 4e-6);
    tilted::<f32, 4>(DepthUnit::METRE, 4e-6);
    tilted::<u16, 8>(DepthUnit::MILLIMETRE, 0.02);
    tilted::<u16, 4>(DepthUnit::MILLIMETRE, 0.02);
}

/// From 1.5 m above a floor, straight down: a map, and a way over it.
#[test]
fn sixty_four_readings_make_a_floor_to_walk_on() {
    let data = [1500_u16; 64];
    let pose = Pose::looking_at(Vec3::Y * 1.5, Vec3::ZERO, Vec3::NEG_Z).unwrap();
    let frame =
        DepthFrame::new(ImageView::new(&data, 8, 8).unwrap(), DepthUnit::MILLIMETRE, pinhole(FOV_45, 8).unwrap());
    let grid = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::NEG_Z, 0.15, 8, 8).unwrap();
    let mut cells = [HeightCell::UNKNOWN; 64];
    let mut map = HeightMap::new(grid, &mut cells, HeightMapParams::DEFAULT).unwrap();
    assert_eq!(map.integrate(&frame.with_pose(pose)).used, 64);
    assert!(map.cells().iter().all(|c| c.is_known() && c.mean.abs() < 1e-6), "a reading for every cell");
    let (mut nodes, mut way) = ([Node::EMPTY; 64], [Vec3::ZERO; 4]);
    let (from, to) = (vec3(-0.4, 0.0, 0.4), vec3(0.4, 0.0, -0.3));
    let plan = Planner::new(&mut nodes).plan(&map, &Walker::DEFAULT, from, to, &mut way).unwrap();
    assert!(matches!(plan, Plan::Found(path) if path.points == 2), "{plan:?}");
}

/// Zones without a reading are holes, and no answer makes anything of them.
#[test]
fn holes_stay_holes() {
    let (mut depth, k) = wall::<4>();
    depth.view_mut().set(1, 1, 0);
    let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, k);
    assert_eq!(hit_test(&frame, vec2(1.0, 1.0), &HitParams::default()), HitOutcome::NoDepth { pixel: (1, 1) });
    assert!(normal_at(&frame, 1, 1, &NormalParams::default()).is_none());
    assert!(normal_at(&frame, 2, 1, &NormalParams::default()).is_some());
    let none = DepthArray::<8, 8>::filled(0);
    let frame = DepthFrame::new(none.view(), DepthUnit::MILLIMETRE, pinhole(FOV_45, 8).unwrap());
    let object = OrientedBox { centre: Vec3::Z, half: Vec3::splat(0.1), rotation: Quat::IDENTITY };
    assert_eq!(vote(&frame, object.corners(), &CollisionParams::default()).verdict, Verdict::Unknown);
}
