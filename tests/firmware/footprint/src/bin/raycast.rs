//! Ray casting with the pyramid.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::Vec3;
use isobath_footprint::isobath::ground::geometry::Ray;
use isobath_footprint::isobath::localized::raycast::{RayParams, cast};
use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_footprint::{H, W};

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let mut cells = [Cell { min: 0, max: 0, holes: 0 }; cells_needed(W, H)];
    let pyramid = Pyramid::build(frame.depth(), &mut cells).ok();
    if let Some(ray) = Ray::new(black_box(Vec3::ZERO), black_box(Vec3::Z)) {
        black_box(cast(frame, pyramid.as_ref(), &ray, &RayParams::default()));
    }
});
