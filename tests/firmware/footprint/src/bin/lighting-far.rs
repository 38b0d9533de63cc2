//! Light from afar: anchors, the map that follows them, harmonics.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::Vec3;
use isobath_footprint::isobath::ground::image::{Image, ImageViewMut};
use isobath_footprint::isobath::lighting::equirect::MapFrame;
use isobath_footprint::isobath::lighting::far::extrapolate::FarMap;
use isobath_footprint::isobath::lighting::far::observe::FarSampling;
use isobath_footprint::isobath::lighting::far::{FarField, FarParams};
use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::{H, W};

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    static COLOUR: Image<[u8; 3], W, H> = Image::filled([0; 3]);
    let mut far = FarField::<1280>::ZERO;
    far.restart(FarParams::default(), black_box([0.2; 3]));
    let mut grid = FarMap::<64, 32>::new();
    let mut map = [[0_u8; 3]; 96 * 48];
    let Ok(frame) = frame.with_colour(black_box(&COLOUR).view()) else { return };
    black_box(far.add_frame(&frame, &MapFrame::at(black_box(Vec3::Z)), &FarSampling::default()).is_ok());
    black_box(grid.update(&mut far));
    if let Ok(mut map) = ImageViewMut::new(&mut map, 96, 48) {
        grid.render(&mut map);
    }
    black_box(map);
    let harmonics = far.harmonics();
    black_box((harmonics.main_light(), harmonics.ambient()));
});
