//! The localized answers in the image. A feature joins here when it lands on main: its memory in [`Memory`], its call in
//! [`exercise`], inputs through `black_box`, outputs into the sum.

use core::hint::black_box;

use isobath::glam::{Quat, Vec2, Vec3};
use isobath::ground::geometry::{OrientedBox, Ray};
use isobath::ground::image::Image;
use isobath::ground::units::Timestamp;
use isobath::localized::avatar::{Avatar, AvatarParams};
use isobath::localized::collision::{CollisionParams, Verdict, box_points, vote};
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::measure::{self, PatchParams, measure_point};
use isobath::localized::normals::adaptive::{self, AdaptiveParams};
use isobath::localized::normals::{NormalParams, dense, normal_at};
use isobath::localized::one_euro::{OneEuro, OneEuroParams};
use isobath::localized::particles::{ParticleParams, ParticlePool};
use isobath::localized::placement::search::{SearchParams, find_place};
use isobath::localized::placement::{PlaceParams, Placement, Spot, place};
use isobath::localized::plane::ground::{GroundParams, estimate_ground};
use isobath::localized::planner::{Node, Plan, Planner, Replan, Walker};
use isobath::localized::raycast::{RayParams, cast};
use isobath::localized::reflect::{Bounce, ReflectParams, reflect};
use isobath::localized::reticle::{Reticle, ReticleHit, ReticleParams, ReticleState};
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::Pyramid;

use crate::{H, W};

/// Cells of the map along each side.
const SIDE: usize = 64;

/// Scratch and outputs of the answers.
pub(crate) struct Memory {
    normals: [f32; dense::scratch_len(W)],
    planes: [Image<f32, W, H>; 3],
    adaptive: [f32; adaptive::scratch_len(W)],
    bounces: [Bounce; 4],
    places: [Option<Placement>; 4],
    heights: [HeightCell; SIDE * SIDE],
    nodes: [Node; SIDE * SIDE],
    corners: [Vec3; 32],
}

impl Memory {
    pub(crate) const NEW: Self = Self {
        normals: [0.0; dense::scratch_len(W)],
        planes: [const { Image::filled(0.0) }; 3],
        adaptive: [0.0; adaptive::scratch_len(W)],
        bounces: [Bounce::EMPTY; 4],
        places: [None; 4],
        heights: [HeightCell::UNKNOWN; SIDE * SIDE],
        nodes: [Node::EMPTY; SIDE * SIDE],
        corners: [Vec3::ZERO; 32],
    };
}

/// Each answer once; a number made from all of them, so that none is removed.
pub(crate) fn exercise(frame: &DepthFrame<'_>, pyramid: &Pyramid<'_>, ray: Vec3, memory: &mut Memory) -> usize {
    let mut sum = 0;
    let mut add = |answered: bool| sum += usize::from(answered);

    // Normals, of a point and of every pixel, by both methods.
    for params in [NormalParams::default(), NormalParams::POINT, NormalParams::PAPER].map(black_box) {
        add(normal_at(frame, black_box(80), black_box(60), &params).is_some());
        let facing = dense::rows_with_fit(frame, &params, &mut memory.normals, |_, row, fit| {
            black_box((row.x, row.y, row.z, fit.residual, fit.support));
        });
        add(facing.is_ok());
    }
    let [x, y, z] = &mut memory.planes;
    let planes = [&mut x.view_mut(), &mut y.view_mut(), &mut z.view_mut()];
    add(dense::planes(frame, &NormalParams::default(), &mut memory.normals, planes, None).is_ok());
    let noisy = adaptive::rows(frame, &AdaptiveParams::default(), &mut memory.adaptive, |_, row| {
        black_box((row.x, row.y, row.z, row.sigma));
    });
    add(noisy.is_ok());

    // What is behind this pixel? What does this ray hit? Where is the ground?
    add(hit_test(frame, black_box(Vec2::new(80.0, 60.0)), &HitParams::default()).hit().is_some());
    if let Some(ray) = Ray::new(frame.pose_or_identity().translation(), ray) {
        add(black_box(cast(frame, Some(pyramid), &ray, &RayParams::default())).work.done > 0);
        add(reflect(frame, Some(pyramid), &ray, &ReflectParams::default(), &mut memory.bounces).bounces > 0);
    }
    add(estimate_ground(frame, black_box(Vec3::Y), &GroundParams::default()).is_ok());

    // Does this box collide? Where does the rain land?
    let object = OrientedBox { centre: black_box(Vec3::Z), half: Vec3::splat(0.2), rotation: Quat::IDENTITY };
    let collision = vote(frame, box_points(&object, Vec3::Y), &CollisionParams::default());
    add(black_box(collision).verdict == Verdict::Free);
    let mut rain = ParticlePool::<64>::new(black_box(1));
    add(rain.step(frame, Some(pyramid), &ParticleParams::rain(object, Vec3::NEG_Y), black_box(0.03)).hits > 0);

    // A filtered point.
    if let Ok(mut filter) = OneEuro::<Vec3>::new(OneEuroParams::default()) {
        add(filter.filter(black_box(ray), Timestamp::from_nanos(black_box(1))).is_finite());
        add(filter.filter(black_box(ray), Timestamp::from_nanos(black_box(2))).is_finite());
    }

    // Where does the cursor lie? How far is it there, and how flat is it?
    let eye = frame.pose_or_identity();
    let hit = hit_test(frame, black_box(Vec2::new(70.0, 60.0)), &HitParams::default());
    let hit = hit.hit().map(|h| ReticleHit { point: h.point, normal: h.normal });
    if let Ok(mut reticle) = Reticle::new(ReticleParams::default()) {
        reticle.update(hit, &eye, Timestamp::from_nanos(black_box(1)));
        let state = reticle.update(hit, &eye, Timestamp::from_nanos(black_box(2)));
        add(matches!(black_box(state), ReticleState::Tracking(_)));
    }
    let noise = DepthNoise::KINECT;
    let flat = measure::patch(frame, black_box(80), black_box(60), &noise, &PatchParams::default());
    let ends = [measure_point(frame, black_box(80), 60, &noise), measure_point(frame, black_box(90), 60, &noise)];
    if let (Ok(flat), [Some(a), Some(b)]) = (flat, ends) {
        add(black_box(measure::between(&a, &b)).value > 0.0);
        add(black_box(measure::height_above(&a, &flat.fit)).sigma > 0.0);
    }

    // Where is there room for a box?
    let wanted = PlaceParams::new(black_box(Vec3::splat(0.4)), Vec3::Y);
    add(place(frame, Some(pyramid), Spot::Pixel(black_box(80), 60), &wanted).outcome.is_ok());
    add(find_place(frame, Some(pyramid), &wanted, &SearchParams::default(), &mut memory.places).found > 0);

    // How does one walk there? The map, the way around, and the paper's way over.
    let grid = Grid::new(black_box(Vec3::Z), Vec3::Y, Vec3::Z, 0.05, SIDE, SIDE);
    let map = grid.and_then(|grid| HeightMap::new(grid, &mut memory.heights, HeightMapParams::default()));
    if let Ok(mut map) = map {
        add(map.integrate(frame).used > 0);
        map.fade();
        let (start, goal) = (black_box(Vec3::Z), black_box(Vec3::new(0.5, 0.0, 1.5)));
        let mut planner = Planner::new(&mut memory.nodes);
        if let Ok(Plan::Found(path)) = planner.plan(&map, &Walker::default(), start, goal, &mut memory.corners) {
            add(map.set(black_box(20), 20, 0.0, 1.0));
            let again = planner.replan(&map, &Walker::default(), start, goal, &path, &mut memory.corners);
            add(matches!(again, Ok(Replan::Kept)));
        }
    }
    if let Ok(mut avatar) = Avatar::new(black_box(Vec3::Z), Vec3::Y, AvatarParams::default()) {
        let step = avatar.step(frame, Some(pyramid), black_box(Vec3::X), Timestamp::from_nanos(black_box(1)));
        add(black_box(step).arrived);
    }
    sum
}
