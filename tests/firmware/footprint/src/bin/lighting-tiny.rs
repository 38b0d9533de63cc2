//! A whole session of the preset `tiny`.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::glam::Vec3;
use isobath_footprint::isobath::ground::image::{Image, ImageViewMut};
use isobath_footprint::isobath::lighting::equirect::MapFrame;
use isobath_footprint::isobath::lighting::far::extrapolate::FarMap;
use isobath_footprint::isobath::lighting::far::{FarField, FarParams};
use isobath_footprint::isobath::lighting::near::{NearField, NearParams, NearStorage};
use isobath_footprint::isobath::lighting::{Preset, Session};
use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::{H, W};

const P: Preset = Preset::TINY;

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    static COLOUR: Image<[u8; 3], W, H> = Image::filled([0; 3]);
    let mut storage = NearStorage::<
        { P.views * P.view_pixels() },
        { P.views * P.level_pixels() },
        { P.level_pixels() },
        { P.strip() },
    >::new();
    let mut far = FarField::<1280>::ZERO;
    far.restart(FarParams::default(), black_box([0.2; 3]));
    let mut grid = FarMap::<64, 32>::new();
    let mut map = [[0_u8; 3]; P.map_pixels()];
    let Ok(frame) = frame.with_colour(black_box(&COLOUR).view()) else { return };
    let Ok(near) = NearField::new(P, NearParams::default(), storage.lend()) else { return };
    let mut session = Session::new(MapFrame::at(black_box(Vec3::Z)), near, &mut far, &mut grid);
    black_box(session.observe(&frame, black_box(1)).is_ok());
    if let Ok(mut map) = ImageViewMut::new(&mut map, P.map.0, P.map.1) {
        session.draw(&mut map);
    }
    let harmonics = session.far().harmonics();
    black_box((harmonics.main_light(), harmonics.ambient(), &map));
});
