//! The paper's avatar.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::Vec3;
use isobath_footprint::isobath::ground::units::Timestamp;
use isobath_footprint::isobath::localized::avatar::{Avatar, AvatarParams};
use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    if let Ok(mut avatar) = Avatar::new(black_box(Vec3::Z), Vec3::Y, AvatarParams::default()) {
        black_box(avatar.step(frame, None, black_box(Vec3::X), Timestamp::from_nanos(black_box(1))));
    }
});
