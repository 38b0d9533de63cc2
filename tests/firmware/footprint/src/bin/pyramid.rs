//! The min/max pyramid.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_footprint::{H, W};

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let mut cells = [Cell { min: 0, max: 0, holes: 0 }; cells_needed(W, H)];
    let pyramid = Pyramid::build(frame.depth(), &mut cells).ok();
    black_box(pyramid.map(|p| p.whole()));
});
