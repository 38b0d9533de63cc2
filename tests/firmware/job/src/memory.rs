//! All the memory of the job, as one type that a `static` holds. It is zero from end to end, so it lies in `.bss` and costs no flash.

use isobath::glam::Vec3;
use isobath::ground::image::Image;
use isobath::localized::height_map::HeightCell;
use isobath::localized::normals::dense;
use isobath::localized::placement::Placement;
use isobath::localized::planner::Node;
use isobath::sensing::depth::DepthArray;
use isobath::skipping::pyramid::{Cell, cells_needed};
use isobath::skipping::tiles::{Tile, tiles_needed};

/// Columns of the depth stream.
pub const W: usize = 160;
/// Rows of the depth stream.
pub const H: usize = 120;
/// Cells along each side of the height map: 3.2 m at 5 cm.
pub const SIDE: usize = 64;
/// Hit tests a frame.
pub const HITS: usize = 100;
/// Placements a frame.
pub const PLACES: usize = 20;
/// Columns and rows of the part of the image whose normals are asked for, around the cursor.
pub const ASKED: (usize, usize) = (48, 32);

/// A hit, as a device would keep it for who asked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// World, metres.
    pub point: Vec3,
    /// World, unit length; zero: none.
    pub normal: Vec3,
    /// One standard deviation along the camera's axis, metres; 0: no hit.
    pub sigma: f32,
}

impl Seen {
    /// No hit.
    pub const NOTHING: Self = Self { point: Vec3::ZERO, normal: Vec3::ZERO, sigma: 0.0 };
}

/// The memory. Sizes are in the generated `docs/footprint.md`.
#[derive(Debug)]
pub struct Memory {
    /// The frame that is worked on.
    pub depth: DepthArray<W, H>,
    /// What each tile looked like when it last changed.
    pub reference: DepthArray<W, H>,
    /// What changed.
    pub tiles: [Tile; tiles_needed(W, H)],
    /// Nearest and farthest readings.
    pub pyramid: [Cell<u16>; cells_needed(W, H)],
    /// Scratch of the normals around the cursor.
    pub scratch: [f32; dense::scratch_len(ASKED.0)],
    /// Normals around the cursor.
    pub normals: [Image<f32, { ASKED.0 }, { ASKED.1 }>; 3],
    /// Hits.
    pub hits: [Seen; HITS],
    /// Places.
    pub places: [Option<Placement>; PLACES],
    /// The height map.
    pub cells: [HeightCell; SIDE * SIDE],
    /// The planner's.
    pub nodes: [Node; SIDE * SIDE],
    /// The way, corner by corner.
    pub path: [Vec3; 32],
}

impl Memory {
    /// Zeros.
    pub const NEW: Self = Self {
        depth: Image::filled(0),
        reference: Image::filled(0),
        tiles: [Tile::ZERO; tiles_needed(W, H)],
        pyramid: [Cell { min: 0, max: 0, holes: 0 }; cells_needed(W, H)],
        scratch: [0.0; dense::scratch_len(ASKED.0)],
        normals: [const { Image::filled(0.0) }; 3],
        hits: [Seen::NOTHING; HITS],
        places: [None; PLACES],
        cells: [HeightCell::UNKNOWN; SIDE * SIDE],
        nodes: [Node::EMPTY; SIDE * SIDE],
        path: [Vec3::ZERO; 32],
    };
}
