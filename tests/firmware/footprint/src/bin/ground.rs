//! Finding the ground.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::Vec3;
use isobath_footprint::isobath::localized::plane::ground::{GroundParams, estimate_ground};
use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    black_box(estimate_ground(frame, black_box(Vec3::Y), &GroundParams::default()).is_ok());
});
