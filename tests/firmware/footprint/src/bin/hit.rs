//! The hit test with fitted normal.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::Vec2;
use isobath_footprint::isobath::localized::hit::{HitParams, hit_test};
use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    black_box(hit_test(frame, black_box(Vec2::ONE), &HitParams::default()));
});
