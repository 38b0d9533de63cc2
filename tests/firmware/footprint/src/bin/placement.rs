//! Placing a box, with the pyramid.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::Vec3;
use isobath_footprint::isobath::localized::placement::{PlaceParams, Spot, place};
use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_footprint::{H, W};

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let mut cells = [Cell { min: 0, max: 0, holes: 0 }; cells_needed(W, H)];
    let pyramid = Pyramid::build(frame.depth(), &mut cells).ok();
    let wanted = PlaceParams::new(black_box(Vec3::ONE), Vec3::Y);
    black_box(place(frame, pyramid.as_ref(), Spot::Pixel(black_box(80), 60), &wanted));
});
