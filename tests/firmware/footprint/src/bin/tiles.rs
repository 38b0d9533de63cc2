//! The tile map.
#![no_std]
#![no_main]

use core::hint::black_box;

use isobath_footprint::isobath::sensing::depth::DepthArray;
use isobath_footprint::isobath::sensing::depth::noise::DepthNoise;
use isobath_footprint::isobath::sensing::frame::DepthFrame;
use isobath_footprint::isobath::skipping::tiles::{Tile, TileMap, tiles_needed};
use isobath_footprint::{H, W};

isobath_footprint::capability!(|frame: &DepthFrame<'_>| {
    let (mut reference, mut tiles) = (DepthArray::<W, H>::filled(0), [Tile::ZERO; tiles_needed(W, H)]);
    if let Ok(mut map) = TileMap::new(black_box(&mut reference).view_mut(), &mut tiles) {
        black_box(map.update(frame, &DepthNoise::KINECT));
    }
});
