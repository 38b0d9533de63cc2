//! Normals of every pixel, adaptive to noise.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::W;
use isobath_footprint::isobath::localized::normals::adaptive::{AdaptiveParams, rows, scratch_len};
use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let mut scratch = [0.0; scratch_len(W)];
    let done = rows(frame, &AdaptiveParams::default(), &mut scratch, |_, n| {
        black_box((n.x, n.y, n.z));
    });
    black_box(done.is_ok());
});
