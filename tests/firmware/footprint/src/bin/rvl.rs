//! Decoding RVL.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::sensing::depth::DepthArray;
use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::isobath::wire::rvl;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let mut depth = DepthArray::<16, 16>::filled(0);
    black_box(rvl::decode(black_box(&[0; 64]), &mut depth.view_mut()).is_ok());
    black_box((depth, frame.world_point(black_box(80), 60)));
});
