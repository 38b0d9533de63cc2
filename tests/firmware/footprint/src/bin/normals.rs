//! Exact normals of every pixel.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::W;
use isobath_footprint::isobath::localized::normals::{NormalParams, dense};
use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let mut scratch = [0.0; dense::scratch_len(W)];
    let done = dense::rows(frame, &NormalParams::default(), &mut scratch, |_, n| {
        black_box((n.x, n.y, n.z));
    });
    black_box(done.is_ok());
});
