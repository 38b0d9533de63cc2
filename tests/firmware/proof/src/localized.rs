//! The localized answers in the image. A feature joins here when it lands on main: its memory in [`Memory`], its call in
//! [`exercise`], inputs through `black_box`, outputs into the sum.

use core::hint::black_box;

use isobath::glam::{Quat, Vec2, Vec3};
use isobath::ground::geometry::{OrientedBox, Ray};
use isobath::ground::units::Timestamp;
use isobath::localized::collision::{CollisionParams, Verdict, box_points, vote};
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::normals::{NormalParams, dense, normal_at};
use isobath::localized::one_euro::{OneEuro, OneEuroParams};
use isobath::localized::particles::{ParticleParams, ParticlePool};
use isobath::localized::plane::ground::{GroundParams, estimate_ground};
use isobath::localized::raycast::{RayParams, cast};
use isobath::localized::reflect::{Bounce, ReflectParams, reflect};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::Pyramid;

use crate::W;

/// Scratch and outputs of the answers.
pub(crate) struct Memory {
    normals: [f32; dense::scratch_len(W)],
    bounces: [Bounce; 4],
}

impl Memory {
    pub(crate) const NEW: Self = Self { normals: [0.0; dense::scratch_len(W)], bounces: [Bounce::EMPTY; 4] };
}

/// Each answer once; a number made from all of them, so that none is removed.
pub(crate) fn exercise(frame: &DepthFrame<'_>, pyramid: &Pyramid<'_>, ray: Vec3, memory: &mut Memory) -> usize {
    let mut sum = 0;
    let mut add = |answered: bool| sum += usize::from(answered);

    // Normals, of a point and of every pixel, by both methods.
    for params in [NormalParams::default(), NormalParams::POINT, NormalParams::PAPER].map(black_box) {
        add(normal_at(frame, black_box(80), black_box(60), &params).is_some());
        let facing = dense::rows(frame, &params, &mut memory.normals, |_, row| {
            black_box((row.x, row.y, row.z, row.residual));
        });
        add(facing.is_ok());
    }

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

    // NEXT, as they land on main: placement, measure, reticle, height_map, planner, avatar.
    sum
}
