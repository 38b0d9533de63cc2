//! Key frames, written and read.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::ground::image::Image;
use isobath_footprint::isobath::sensing::depth::DepthArray;
use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::isobath::wire::keyframe::{FarOptions, KeyFrame, NearOptions, encode_far, encode_near};
use isobath_footprint::{H, W};

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    static COLOUR: Image<[u8; 3], W, H> = Image::filled([0; 3]);
    let mut bytes = [0; 4096];
    let Ok(frame) = frame.with_colour(black_box(&COLOUR).view()) else { return };
    black_box(encode_near(&frame, &NearOptions::default(), black_box(&mut bytes)).is_ok());
    black_box(encode_far(&frame, &FarOptions::default(), black_box(&mut bytes)).is_ok());
    let (mut depth, mut colour) = (DepthArray::<16, 16>::filled(0), Image::<[u8; 3], 16, 16>::filled([0; 3]));
    match KeyFrame::decode(black_box(&bytes)) {
        Ok(KeyFrame::Near(near)) => {
            black_box(near.depth_into(&mut depth.view_mut()).is_ok());
            black_box(near.colour_into(depth.view(), &mut colour.view_mut()).is_ok());
        }
        Ok(KeyFrame::Far(far)) => {
            black_box(far.colour_into(&mut colour.view_mut()).is_ok());
        }
        other => {
            black_box(other.is_ok());
        }
    }
    black_box((depth, colour));
});
