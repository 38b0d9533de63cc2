//! The frame alone: what the others are compared with.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    black_box(frame.world_point(black_box(80), 60));
});
