//! Rain: particles that meet surfaces.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::{Quat, Vec3};
use isobath_footprint::isobath::ground::geometry::OrientedBox;
use isobath_footprint::isobath::localized::particles::{ParticleParams, ParticlePool};
use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_footprint::{H, W};

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let mut cells = [Cell { min: 0, max: 0, holes: 0 }; cells_needed(W, H)];
    let pyramid = Pyramid::build(frame.depth(), &mut cells).ok();
    let cloud = OrientedBox { centre: black_box(Vec3::Z), half: Vec3::ONE, rotation: Quat::IDENTITY };
    let mut rain = ParticlePool::<64>::new(black_box(1));
    black_box(rain.step(frame, pyramid.as_ref(), &ParticleParams::rain(cloud, Vec3::NEG_Y), black_box(0.03)));
});
