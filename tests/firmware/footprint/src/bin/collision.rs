//! Collision by majority vote.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::{Quat, Vec3};
use isobath_footprint::isobath::ground::geometry::OrientedBox;
use isobath_footprint::isobath::localized::collision::{CollisionParams, vote};
use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let object = OrientedBox { centre: black_box(Vec3::Z), half: Vec3::ONE, rotation: Quat::IDENTITY };
    black_box(vote(frame, object.corners(), &CollisionParams::default()));
});
