//! Kernels that answer one question at a time: each is asked of many places, and the mean counts.

use std::hint::black_box;

use isobath::glam::{Quat, Vec3, vec2, vec3};
use isobath::ground::geometry::{OrientedBox, Ray};
use isobath::ground::units::Timestamp;
use isobath::localized::collision::{CollisionParams, Verdict, vote};
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::normals::{NormalParams, normal_at};
use isobath::localized::one_euro::{OneEuro, OneEuroParams};
use isobath::localized::particles::{ParticleParams, ParticlePool};
use isobath::localized::placement::{PlaceParams, Spot, place};
use isobath::localized::raycast::{RayParams, cast};
use isobath::sensing::imu::ImuSample;
use isobath::sensing::imu::vqf::{Vqf, VqfParams};
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

use crate::room::{HEIGHT, Room, WIDTH, pixels};
use crate::{Kernel, counted};

/// Places asked; particles.
const ASKED: usize = 1000;

const fn kernel(name: &'static str, unit: &'static str, run: fn()) -> Kernel {
    Kernel { name, answers: ASKED, unit, run }
}

pub(crate) const ALL: &[Kernel] = &[
    kernel("normal-at-cross", "normal", || normal(&NormalParams::default())),
    kernel("normal-at-11x11", "normal", || normal(&NormalParams::POINT)),
    kernel("hit-test", "hit", hits),
    kernel("ray-cast", "ray", || rays(false)),
    kernel("ray-cast-pyramid", "ray", || rays(true)),
    kernel("vote-box", "box", votes),
    kernel("place", "spot", || places(false)),
    kernel("place-pyramid", "spot", || places(true)),
    kernel("one-euro-vec3", "sample", one_euro),
    kernel("particles-step", "particle", particles),
    kernel("vqf", "reading", || vqf(false)),
    kernel("vqf-magnetometer", "reading", || vqf(true)),
];

fn normal(params: &NormalParams) {
    let room = Room::new();
    let frame = room.coarse();
    counted(|| {
        pixels(ASKED).filter_map(|(x, y)| normal_at(black_box(&frame), x, y, params)).map(|n| n.normal.z).sum::<f32>()
    });
}

fn hits() {
    let room = Room::new();
    let frame = room.coarse();
    let params = HitParams::default();
    counted(|| {
        let answers = pixels(ASKED).map(|(x, y)| hit_test(black_box(&frame), vec2(x as f32 + 0.3, y as f32), &params));
        answers.filter(|a| a.hit().is_some()).count()
    });
}

fn rays(skipping: bool) {
    let room = Room::new();
    let frame = room.coarse();
    let mut cells = vec![Cell::EMPTY; cells_needed(WIDTH, HEIGHT)];
    let pyramid = Pyramid::build(frame.depth(), &mut cells).ok().filter(|_| skipping);
    // From beside the camera, across the view, to a pixel's point.
    let origin = frame.pose_or_identity().to_world(vec3(-0.8, -0.3, 0.5));
    let targets = pixels(2 * ASKED).filter_map(|(x, y)| frame.world_point(x, y));
    let rays: Vec<Ray> = targets.filter_map(|p| Ray::new(origin, p - origin)).take(ASKED).collect();
    assert_eq!(rays.len(), ASKED, "as many as the count is divided by");
    counted(|| {
        let answers = rays.iter().map(|ray| cast(black_box(&frame), pyramid.as_ref(), ray, &RayParams::default()));
        answers.filter(|a| a.hit().is_some()).count()
    });
}

fn votes() {
    let room = Room::new();
    let frame = room.coarse();
    let params = CollisionParams::default();
    let boxes: Vec<OrientedBox> = (0..ASKED)
        .map(|i| {
            let (x, z) = (i % 25, i / 25);
            let centre = vec3((x as f32 - 12.0) * 0.1, 0.3, -0.5 - z as f32 * 0.1);
            OrientedBox { centre, half: Vec3::splat(0.2), rotation: Quat::IDENTITY }
        })
        .collect();
    counted(|| {
        let answers = boxes.iter().map(|b| vote(black_box(&frame), b.corners(), &params).verdict);
        answers.filter(|&v| v == Verdict::Blocked).count()
    });
}

fn places(skipping: bool) {
    let room = Room::new();
    let frame = room.coarse();
    let mut cells = vec![Cell::EMPTY; cells_needed(WIDTH, HEIGHT)];
    let pyramid = Pyramid::build(frame.depth(), &mut cells).ok().filter(|_| skipping);
    let params = PlaceParams::new(vec3(0.2, 0.3, 0.2), Vec3::Y);
    counted(|| {
        let answers =
            pixels(ASKED).map(|(x, y)| place(black_box(&frame), pyramid.as_ref(), Spot::Pixel(x, y), &params));
        answers.filter(|a| a.outcome.is_ok()).count()
    });
}

fn one_euro() {
    let params = OneEuroParams { beta: 0.5, ..OneEuroParams::DEFAULT };
    let mut filter = OneEuro::new(params).unwrap_or_else(|e| unreachable!("usable parameters: {e}"));
    // Walks in a circle, with a tremble.
    let samples: Vec<(Vec3, Timestamp)> = (0..ASKED)
        .map(|i| {
            let angle = i as f32 * 0.02;
            let point = vec3(angle.cos(), 0.01 * (i % 7) as f32, angle.sin());
            (point, Timestamp::from_nanos(i as i64 * 16_666_667))
        })
        .collect();
    counted(|| samples.iter().map(|&(p, t)| filter.filter(black_box(p), t).x).sum::<f32>());
}

/// One frame's step of rain that has been falling for a while.
fn particles() {
    let room = Room::new();
    let frame = room.coarse();
    let region = OrientedBox { centre: vec3(0.0, 1.0, -2.0), half: vec3(2.0, 1.5, 1.5), rotation: Quat::IDENTITY };
    let rain = ParticleParams::rain(region, Vec3::NEG_Y);
    let mut pool = ParticlePool::<ASKED>::new(42);
    let frame_time = 1.0 / 30.0;
    for _ in 0..30 {
        pool.step(&frame, None, &rain, frame_time);
    }
    counted(|| pool.step(black_box(&frame), None, &rain, frame_time).landed);
}

/// Five seconds of a turning, swaying sensor, after as many that gravity's low-pass starts with.
fn vqf(field: bool) {
    let reading = |i: i64| {
        let t = i as f32 * 0.005;
        ImuSample {
            time: Timestamp::from_nanos(i * 5_000_000),
            rate: vec3(0.5 * t.sin(), 0.7 * (1.3 * t).cos(), 0.2),
            force: vec3(0.5 * (2.1 * t).sin(), 0.4 * (1.7 * t).sin(), 9.8),
            field: field.then(|| vec3(20.0 * t.cos(), -20.0 * t.sin(), -40.0)),
        }
    };
    let readings: Vec<ImuSample> = (0..2 * ASKED as i64).map(reading).collect();
    let (first, second) = readings.split_at(ASKED);
    let mut filter = Vqf::new(VqfParams::DEFAULT).unwrap_or_else(|e| unreachable!("the defaults: {e}"));
    first.iter().for_each(|s| _ = filter.update(s));
    counted(|| {
        second.iter().for_each(|s| _ = black_box(filter.update(black_box(s))));
        filter.gravity()
    });
}
