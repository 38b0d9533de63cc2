//! Hostile input to the localized answers: frames of every shape and number, points that are none, parameters out of range.
//! Each gives its documented "nothing" or its error; none panics.

use isobath::glam::{Quat, Vec2, Vec3};
use isobath::ground::geometry::{OrientedBox, Ray};
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::localized::avatar::{Avatar, AvatarError, AvatarParams, AvatarState};
use isobath::localized::collision::{CollisionParams, Verdict, box_points, vote};
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapError, HeightMapParams};
use isobath::localized::hit::{HitOutcome, HitParams, hit_test};
use isobath::localized::measure::{self, PatchError, PatchParams};
use isobath::localized::normals::adaptive::{self, AdaptiveParams, BlockSize};
use isobath::localized::normals::dense::{self, DenseError};
use isobath::localized::normals::{NormalMethod, NormalParams, normal_at};
use isobath::localized::one_euro::{OneEuro, OneEuroParams};
use isobath::localized::particles::{ParticleParams, ParticlePool};
use isobath::localized::placement::search::{SearchParams, find_place};
use isobath::localized::placement::{NoPlace, PlaceParams, Spot, place};
use isobath::localized::plane::ground::{GroundParams, dominant_plane, estimate_ground};
use isobath::localized::planner::{Node, Plan, Planner, Walker, path_changed};
use isobath::localized::raycast::{RayOutcome, RayParams, cast};
use isobath::localized::reflect::{Bounce, ReflectParams, reflect};
use isobath::localized::reticle::{Reticle, ReticleHit, ReticleParams, ReticleState};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::depth::{DepthUnit, HolePolicy};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

const NAN: f32 = f32::NAN;
const INF: f32 = f32::INFINITY;

/// Sizes that images come in when something went wrong upstream, and the largest that are legal.
const SHAPES: [(usize, usize); 9] =
    [(0, 0), (0, 9), (9, 0), (1, 1), (1, 9), (9, 1), (17, 13), (65_535, 1), (1, 65_535)];

/// Depth values that are none, and a few that are.
const DEPTHS: [f32; 10] = [NAN, INF, f32::NEG_INFINITY, 0.0, -0.0, -1.0, f32::MAX, f32::MIN_POSITIVE, 1e-40, 1.5];

/// Points and directions that are none.
const POINTS: [Vec3; 6] = [
    Vec3::NAN,
    Vec3::INFINITY,
    Vec3::NEG_INFINITY,
    Vec3::splat(f32::MAX),
    Vec3::new(0.0, NAN, 1.0),
    Vec3::new(INF, 0.0, -INF),
];

fn plain() -> Intrinsics {
    Intrinsics::new(120.0, 120.0, 8.0, 6.0).unwrap()
}

/// Calls `ask` with a frame and its pyramid for each shape, with no reading at all and with bad numbers among good ones.
fn each_frame(ask: impl Fn(&DepthFrame<'_, f32>, &Pyramid<'_, f32>, bool)) {
    for (width, height) in SHAPES {
        for empty in [true, false] {
            let values = if empty { &DEPTHS[..9] } else { &DEPTHS[..] };
            let depth: Vec<f32> = values.iter().copied().cycle().take(width * height).collect();
            let view = ImageView::new(&depth, width, height).unwrap();
            let mut cells = vec![Cell::EMPTY; cells_needed(width, height)];
            let pyramid = Pyramid::build(view, &mut cells).unwrap();
            ask(&DepthFrame::new(view, DepthUnit::METRE, plain()), &pyramid, empty);
        }
    }
}

/// Pixels in the middle, at the ends and outside of an image.
fn pixels((width, height): (usize, usize)) -> [(usize, usize); 5] {
    [(width / 2, height / 2), (width, 0), (0, height), (usize::MAX, 0), (usize::MAX, usize::MAX)]
}

#[test]
fn normals_of_every_shape() {
    let methods = [NormalMethod::Exact, NormalMethod::Paper];
    let rows = methods.map(|method| [(0, None), (3, Some(NAN)), (1, Some(-1.0))].map(|p| (method, p)));
    each_frame(|frame, _, empty| {
        let (width, height) = frame.size();
        for &(method, (radius, max_step)) in rows.as_flattened() {
            let params = NormalParams { method, radius, max_step };
            for (x, y) in pixels((width, height)) {
                let got = normal_at(frame, x, y, &params);
                assert!(got.is_none_or(|e| frame.z(x, y) > 0.0 && (e.normal.length() - 1.0).abs() < 1e-3), "{got:?}");
            }
            // A wide fit of each pixel of a long line would take seconds.
            if radius > 0 && width * height > 1000 {
                continue;
            }
            let mut scratch = vec![0.0; dense::scratch_len(width)];
            let work = dense::rows(frame, &params, &mut scratch, |_, row| assert_eq!(row.x.len(), width)).unwrap();
            assert_eq!((work.done + work.skipped) as usize, width * height);
            assert!(!empty || work.done == 0);
        }
        for block in [BlockSize::Auto, BlockSize::Four, BlockSize::Eight, BlockSize::Sixteen] {
            let needed = adaptive::scratch_len(width);
            let mut scratch = vec![NAN; needed];
            let params = AdaptiveParams { block, ..AdaptiveParams::default() };
            let work = adaptive::rows(frame, &params, &mut scratch, |_, _| {}).unwrap();
            assert_eq!((work.done + work.skipped) as usize, width * height);
            let short = adaptive::rows(frame, &params, &mut scratch[1..], |_, _| {});
            assert_eq!(short, Err(DenseError::Scratch { needed, got: needed - 1 }));
        }
    });
}

#[test]
fn hits_and_measures_of_every_shape() {
    each_frame(|frame, _, empty| {
        let (width, height) = frame.size();
        for at in [Vec2::NAN, Vec2::INFINITY, Vec2::splat(-1.0), Vec2::new(width as f32, 0.0), Vec2::splat(f32::MAX)] {
            assert_eq!(hit_test(frame, at, &HitParams::default()), HitOutcome::OutsideView, "{at}");
        }
        for (x, y) in pixels((width, height)) {
            let inside = x < width && y < height;
            for noise in [DepthNoise::KINECT, DepthNoise { constant: NAN, linear: -1.0, quadratic: INF }] {
                let seen = measure::measure_point(frame, x, y, &noise);
                assert_eq!(seen.is_some(), frame.z(x, y) > 0.0);
                for (radius, max_jump) in [(0, 0.1), (u16::MAX, 0.1), (2, NAN), (2, INF), (2, -1.0)] {
                    if radius > 100 && width * height > 1000 {
                        continue;
                    }
                    let got = measure::patch(frame, x, y, &noise, &PatchParams { radius, max_jump });
                    match got {
                        Err(PatchError::OutsideView) => assert!(!inside),
                        Err(PatchError::NoDepth) => assert!(inside && (empty || frame.z(x, y) == 0.0)),
                        // One reading in ten, never three that span a plane on a line of pixels.
                        _ => assert!(inside && !empty, "{got:?}"),
                    }
                }
            }
        }
    });
}

#[test]
fn rays_collisions_and_weather_of_every_shape() {
    let good = Ray::new(Vec3::NEG_Z, Vec3::Z).unwrap();
    each_frame(|frame, pyramid, empty| {
        for holes in [HolePolicy::Unknown, HolePolicy::Free] {
            for (max_distance, thickness) in
                [(5.0, 0.1), (NAN, 0.1), (-1.0, 0.1), (INF, INF), (5.0, NAN), (f32::MAX, -1.0)]
            {
                let params = RayParams { max_distance, thickness, holes };
                let outcome = cast(frame, Some(pyramid), &good, &params).outcome;
                assert!(!empty || !matches!(outcome, RayOutcome::Hit(_)), "{outcome:?}");
                let mut bounces = [Bounce::EMPTY; 2];
                let params = ReflectParams { ray: params, offset: NAN, ..ReflectParams::default() };
                assert!(reflect(frame, Some(pyramid), &good, &params, &mut bounces).bounces <= 2);
                assert_eq!(reflect(frame, None, &good, &params, &mut []).bounces, 0);
            }
        }
        for point in POINTS {
            let object = OrientedBox { centre: point, half: point, rotation: Quat::from_xyzw(NAN, 0.0, 0.0, 0.0) };
            let got = vote(frame, box_points(&object, point), &CollisionParams::default());
            assert_eq!(got.verdict, Verdict::Unknown, "{point}");
            let mut rain = ParticlePool::<4>::new(0);
            for dt in [0.03, NAN, INF, -1.0] {
                let report = rain.step(frame, Some(pyramid), &ParticleParams::rain(object, point), dt);
                assert_eq!(report.hits, 0, "{point} {dt}");
            }
            assert!(estimate_ground(frame, point, &GroundParams::default()).is_err(), "{point}");
            assert!(!empty || dominant_plane(frame, point, &GroundParams::default()).is_err(), "{point}");
        }
        assert!(!empty || estimate_ground(frame, Vec3::Y, &GroundParams::default()).is_err());
    });
}

#[test]
fn places_of_every_shape() {
    let sizes = [Vec3::NAN, Vec3::INFINITY, Vec3::ZERO, Vec3::NEG_ONE, Vec3::new(1.0, 1e-4, 1.0), Vec3::splat(1e4)];
    each_frame(|frame, pyramid, empty| {
        let good = PlaceParams::new(Vec3::splat(0.1), Vec3::NEG_Z);
        let at = |spot, params: &PlaceParams| place(frame, Some(pyramid), spot, params).outcome;
        for (x, y) in pixels(frame.size()) {
            for size in sizes {
                assert_eq!(at(Spot::Pixel(x, y), &PlaceParams::new(size, Vec3::Y)), Err(NoPlace::BadSize), "{size}");
            }
            for up in [Vec3::NAN, Vec3::ZERO, Vec3::INFINITY] {
                assert_eq!(at(Spot::Pixel(x, y), &PlaceParams { up, ..good }), Err(NoPlace::BadUp), "{up}");
            }
            assert!(!empty || at(Spot::Pixel(x, y), &good).is_err());
        }
        for point in POINTS {
            assert_eq!(at(Spot::World(point), &good), Err(NoPlace::OutsideView), "{point}");
        }
        for (start, step) in [(None, None), (Some((usize::MAX, usize::MAX)), Some(0)), (Some((0, 0)), Some(usize::MAX))]
        {
            let search = SearchParams { start, step, max_tries: 30 };
            let report = find_place(frame, Some(pyramid), &good, &search, &mut [None; 2]);
            assert!(report.tried <= 30 && (!empty || report.found == 0), "{report:?}");
            assert_eq!(find_place(frame, None, &good, &search, &mut []).found, 0);
        }
    });
}

#[test]
fn maps_paths_and_avatars_of_every_shape() {
    let mut storage = [HeightCell::UNKNOWN; 64];
    let bad_axes = [(Vec3::NAN, Vec3::Y, Vec3::Z), (Vec3::ZERO, Vec3::ZERO, Vec3::Z), (Vec3::ZERO, Vec3::Y, Vec3::Y)];
    for (centre, up, forward) in bad_axes {
        assert_eq!(Grid::new(centre, up, forward, 0.1, 8, 8), Err(HeightMapError::BadAxes), "{centre} {up} {forward}");
    }
    for cell in [0.0, -1.0, NAN, INF, 1e-4, 1e4] {
        assert!(Grid::new(Vec3::ZERO, Vec3::Y, Vec3::Z, cell, 8, 8).is_err(), "{cell}");
    }
    for (width, depth) in [(usize::MAX, usize::MAX), (usize::MAX, 1), (0, usize::MAX), (1 << 13, 1 << 13)] {
        assert!(Grid::new(Vec3::ZERO, Vec3::Y, Vec3::Z, 0.1, width, depth).is_err(), "{width}x{depth}");
    }
    for (columns, rows) in [(0, 0), (0, 8), (8, 0), (1, 1), (1, 8), (8, 8)] {
        let grid = Grid::new(Vec3::Z, Vec3::NEG_Y, Vec3::Z, 0.5, columns, rows).unwrap();
        each_frame(|frame, pyramid, empty| {
            let mut storage = storage;
            let mut map = HeightMap::new(grid, &mut storage, HeightMapParams::DEFAULT).unwrap();
            let report = map.integrate(frame);
            let pixels = frame.size().0 * frame.size().1;
            assert_eq!((report.used + report.overhead + report.outside + report.holes) as usize, pixels);
            assert!(!empty || report.holes as usize == pixels);
            let mut nodes = [Node::EMPTY; 64];
            for point in POINTS {
                let plan = Planner::new(&mut nodes).plan(&map, &Walker::DEFAULT, point, Vec3::Z, &mut []);
                assert_eq!(plan, Ok(Plan::StartOutside), "{point}");
                assert!(path_changed(&map, &Walker::DEFAULT, &[point, Vec3::Z], 0), "{point}");
            }
            let mut avatar = Avatar::new(Vec3::Z, Vec3::NEG_Y, AvatarParams::default()).unwrap();
            for (i, target) in POINTS.into_iter().enumerate() {
                let time = Timestamp::from_nanos([0, i64::MAX, i64::MIN][i % 3]);
                let step = avatar.step(frame, Some(pyramid), target, time);
                assert_eq!(step.state, AvatarState::NoTarget, "{target}");
                assert!(step.position == Vec3::Z && step.raw == Vec3::Z, "{step:?}");
            }
        });
    }
    let grid = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::Z, 0.1, 9, 9).unwrap();
    let short = HeightMap::new(grid, &mut storage, HeightMapParams::DEFAULT).err();
    assert_eq!(short, Some(HeightMapError::CapacityExceeded { needed: 81, got: 64 }));
}

#[test]
fn parameters_out_of_range() {
    for bad in [NAN, -1.0] {
        let walkers = [
            Walker { radius: bad, ..Walker::DEFAULT },
            Walker { max_step: bad, ..Walker::DEFAULT },
            Walker { max_slope: bad, ..Walker::DEFAULT },
            Walker { climb_cost: bad, ..Walker::DEFAULT },
        ];
        let grid = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::Z, 0.1, 0, 0).unwrap();
        let map = HeightMap::new(grid, &mut [], HeightMapParams::DEFAULT).unwrap();
        for walker in walkers {
            let plan = Planner::new(&mut []).plan(&map, &walker, Vec3::ZERO, Vec3::ZERO, &mut []);
            assert!(plan.is_err_and(|e| e.to_string().contains(e.name)), "{walker:?}");
            // Not asked to check, but not to panic either.
            assert!(path_changed(&map, &walker, &[Vec3::ZERO, Vec3::X], 0));
        }
        let heights = [
            HeightMapParams { clearance: bad, ..HeightMapParams::DEFAULT },
            HeightMapParams { reach: bad, ..HeightMapParams::DEFAULT },
            HeightMapParams { change: bad, ..HeightMapParams::DEFAULT },
            HeightMapParams { stride: 0, ..HeightMapParams::DEFAULT },
            HeightMapParams { max_support: 0, ..HeightMapParams::DEFAULT },
        ];
        for params in heights {
            assert!(HeightMap::new(grid, &mut [], params).is_err_and(|e| e == HeightMapError::BadParams), "{params:?}");
        }
        let avatars = [
            AvatarParams { height: bad, ..AvatarParams::default() },
            AvatarParams { drop: bad, ..AvatarParams::default() },
            AvatarParams { speed: bad, ..AvatarParams::default() },
            AvatarParams { longest_step: bad, ..AvatarParams::default() },
            AvatarParams { arrival: bad, ..AvatarParams::default() },
        ];
        for params in avatars {
            let got = Avatar::new(Vec3::ZERO, Vec3::Y, params);
            assert!(matches!(got, Err(AvatarError::BadParam { .. })), "{params:?}");
        }
        let cursors = [
            ReticleParams { turn_time: bad, ..ReticleParams::DEFAULT },
            ReticleParams { move_time: bad, ..ReticleParams::DEFAULT },
            ReticleParams { hold: bad, ..ReticleParams::DEFAULT },
        ];
        for params in cursors {
            assert!(Reticle::new(params).is_err_and(|e| e.to_string().contains(e.name)), "{params:?}");
        }
        assert!(OneEuro::<f32>::new(OneEuroParams { min_cutoff: bad, ..OneEuroParams::DEFAULT }).is_err());
    }
    assert_eq!(Avatar::new(Vec3::NAN, Vec3::Y, AvatarParams::default()), Err(AvatarError::BadPlace));
    assert_eq!(Avatar::new(Vec3::ZERO, Vec3::ZERO, AvatarParams::default()), Err(AvatarError::BadUp));
}

#[test]
fn cursors_on_points_that_are_none() {
    let mut reticle = Reticle::new(ReticleParams::DEFAULT).unwrap();
    for (i, point) in POINTS.into_iter().enumerate() {
        let time = Timestamp::from_nanos(i as i64);
        let got = reticle.update(Some(ReticleHit { point, normal: Some(Vec3::Y) }), &Pose::IDENTITY, time);
        assert_eq!(matches!(got, ReticleState::Lost), !point.is_finite(), "{point} {got:?}");
        reticle.reset();
    }
    for normal in POINTS {
        let hit = ReticleHit { point: Vec3::Z, normal: Some(normal) };
        let got = reticle.update(Some(hit), &Pose::IDENTITY, Timestamp::ZERO);
        let ReticleState::Tracking(pose) = got else { panic!("{normal} {got:?}") };
        assert!(pose.orientation.is_normalized(), "{normal} {pose:?}");
    }
}
