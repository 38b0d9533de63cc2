//! Measuring distances and flatness.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::localized::measure::{PatchParams, between, measure_point, patch};
use isobath_footprint::isobath::sensing::depth::noise::DepthNoise;
use isobath_footprint::isobath::sensing::frame::DepthFrame;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let noise = DepthNoise::KINECT;
    black_box(patch(frame, black_box(80), 60, &noise, &PatchParams::default()).is_ok());
    if let (Some(a), Some(b)) = (measure_point(frame, black_box(80), 60, &noise), measure_point(frame, 90, 60, &noise))
    {
        black_box(between(&a, &b));
    }
});
