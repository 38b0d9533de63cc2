//! Bytes of what a caller of the core lends it, by image size, and of the state it keeps.

use isobath::glam::Vec3;
use isobath::lighting::far::FarField;
use isobath::lighting::far::extrapolate::FarMap;
use isobath::lighting::far::harmonics::Harmonics;
use isobath::lighting::policy::guided::Guide;
use isobath::lighting::policy::motion::AutoCapture;
use isobath::localized::avatar::Avatar;
use isobath::localized::height_map::HeightCell;
use isobath::localized::hit::Hit;
use isobath::localized::normals::{adaptive, dense};
use isobath::localized::one_euro::OneEuro;
use isobath::localized::particles::ParticlePool;
use isobath::localized::placement::Placement;
use isobath::localized::plane::PlaneSum;
use isobath::localized::planner::Node;
use isobath::localized::reticle::Reticle;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath::skipping::tiles::{Tile, tiles_needed};

use crate::lighting::{LightMemory, TinyNear, TinySession};
use crate::memory::Memory;

const fn image<const W: usize, const H: usize>(names: [&'static str; 5]) -> [(&'static str, usize); 5] {
    [
        (names[0], size_of::<isobath::sensing::depth::DepthArray<W, H>>()),
        (names[1], 2 * W * H + tiles_needed(W, H) * size_of::<Tile>()),
        (names[2], cells_needed(W, H) * size_of::<Cell<u16>>()),
        (names[3], dense::scratch_len(W) * size_of::<f32>()),
        (names[4], adaptive::scratch_len(W) * size_of::<f32>()),
    ]
}

macro_rules! sized {
    ($w:literal, $h:literal, $size:literal) => {
        image::<$w, $h>([
            concat!("depth-at-", $size),
            concat!("tile-map-at-", $size),
            concat!("pyramid-at-", $size),
            concat!("normals-scratch-at-", $size),
            concat!("adaptive-scratch-at-", $size),
        ])
    };
}

/// What depends on the image's size.
pub const SIZED: [[(&str, usize); 5]; 4] =
    [sized!(80, 60, "80x60"), sized!(160, 120, "160x120"), sized!(320, 240, "320x240"), sized!(640, 480, "640x480")];

/// What does not. The localized job is what its budget names: depth, pyramid, hits, places, map, planner, path; the tile map and
/// the normals around the cursor are beside it. The light is all of it: what key frames are decoded into, both fields, the map, the session's handle.
pub const FIXED: [(&str, usize); 24] = [
    ("localized-job", localized()),
    ("localized-job-with-tiles-and-normals", size_of::<Memory>()),
    ("height-map-64x64", 64 * 64 * size_of::<HeightCell>()),
    ("planner-64x64", 64 * 64 * size_of::<Node>()),
    ("height-cell", size_of::<HeightCell>()),
    ("planner-node", size_of::<Node>()),
    ("frame", size_of::<DepthFrame<'_>>()),
    ("pyramid-handle", size_of::<Pyramid<'_>>()),
    ("hit", size_of::<Hit>()),
    ("placement", size_of::<Placement>()),
    ("plane-sum", size_of::<PlaneSum>()),
    ("particles-64", size_of::<ParticlePool<64>>()),
    ("avatar", size_of::<Avatar>()),
    ("reticle", size_of::<Reticle>()),
    ("one-euro-vector", size_of::<OneEuro<Vec3>>()),
    ("lighting-tiny", size_of::<LightMemory>() + size_of::<TinySession<'_>>()),
    ("lighting-session", size_of::<TinySession<'_>>()),
    ("near-field-tiny", size_of::<TinyNear>()),
    ("far-field", size_of::<FarField<1280>>()),
    ("far-map-64x32", size_of::<FarMap<64, 32>>()),
    ("far-map-128x64", size_of::<FarMap<128, 64>>()),
    ("harmonics", size_of::<Harmonics>()),
    ("auto-capture", size_of::<AutoCapture>()),
    ("guide", size_of::<Guide>()),
];

const fn localized() -> usize {
    let memory = Memory::NEW;
    size_of_val(&memory.depth)
        + size_of_val(&memory.pyramid)
        + size_of_val(&memory.hits)
        + size_of_val(&memory.places)
        + size_of_val(&memory.cells)
        + size_of_val(&memory.nodes)
        + size_of_val(&memory.path)
}
