//! Where what lies in a context's block:
//!
//! ```text
//! header | height cells (16 bytes each) | planner nodes (8) | depth (2 a pixel) | pyramid (6 a tile)
//! ```
//!
//! 160 x 120 with a map of 64 x 64 cells takes 146,528 bytes (48,224 without the map); a test holds these figures and the header's
//! macro `ISOBATH_CONTEXT_BYTES`, which says the same at compile time.

use core::mem::{align_of, size_of};

use isobath::localized::height_map::HeightCell;
use isobath::localized::planner::Node;
use isobath::skipping::pyramid::{Cell, cells_needed};

use crate::context::Header;

/// What a context's memory must be aligned to, bytes.
pub const ISOBATH_ALIGNMENT: usize = 8;

/// Longest side of a depth image, pixels.
pub const ISOBATH_MAX_SIDE: u32 = 8192;

/// Most cells of a map: columns x rows.
pub const ISOBATH_MAX_CELLS: u32 = 16_777_216;

/// Bytes of a context without image and map.
pub const ISOBATH_HEADER_BYTES: usize = 168;

const _: () = assert!(size_of::<Header>() == ISOBATH_HEADER_BYTES, "the header's macro counts on this size");
const _: () = assert!(align_of::<Header>() <= ISOBATH_ALIGNMENT, "the block's alignment is the header's");
const _: () = assert!(size_of::<HeightCell>() == 16 && align_of::<HeightCell>() == 4, "the macro counts 16 bytes");
const _: () = assert!(size_of::<Node>() == 8 && align_of::<Node>() == 4, "the macro counts 8 bytes");
const _: () = assert!(size_of::<Cell<u16>>() == 6 && align_of::<Cell<u16>>() == 2, "the macro counts 6 bytes");

/// Offsets from the block's start, bytes, and numbers of elements. Every part follows one of no smaller alignment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Layout {
    pub(crate) map_cells: usize,
    pub(crate) pixels: usize,
    pub(crate) tiles: usize,
    pub(crate) heights: usize,
    pub(crate) nodes: usize,
    pub(crate) depth: usize,
    pub(crate) pyramid: usize,
    pub(crate) bytes: usize,
}

impl Layout {
    /// For an image and a map (0 x 0: none); `None` when a size is not allowed or does not fit in this machine's memory.
    pub(crate) fn new(width: u32, height: u32, columns: u32, rows: u32) -> Option<Self> {
        let side = |n: u32| (1..=ISOBATH_MAX_SIDE).contains(&n);
        let cells = u64::from(columns) * u64::from(rows);
        // Both or neither: a map of no cells is a mistake.
        let map = (columns == 0) == (rows == 0) && cells <= u64::from(ISOBATH_MAX_CELLS);
        if !side(width) || !side(height) || !map {
            return None;
        }
        let map_cells = usize::try_from(cells).ok()?;
        let pixels = (width as usize).checked_mul(height as usize)?;
        let tiles = cells_needed(width as usize, height as usize);
        let heights = ISOBATH_HEADER_BYTES;
        let nodes = heights.checked_add(map_cells.checked_mul(size_of::<HeightCell>())?)?;
        let depth = nodes.checked_add(map_cells.checked_mul(size_of::<Node>())?)?;
        let pyramid = depth.checked_add(pixels.checked_mul(size_of::<u16>())?)?;
        let end = pyramid.checked_add(tiles.checked_mul(size_of::<Cell<u16>>())?)?;
        let bytes = end.checked_next_multiple_of(ISOBATH_ALIGNMENT)?;
        // What a slice may span at most.
        (isize::try_from(bytes).is_ok()).then_some(Self {
            map_cells,
            pixels,
            tiles,
            heights,
            nodes,
            depth,
            pyramid,
            bytes,
        })
    }
}

/// Bytes of memory a context takes, for an image of `width` x `height` pixels and a map of `columns` x `rows` cells (0 and 0:
/// without map, and so without paths); 0 when a size is not allowed. ISOBATH_CONTEXT_BYTES says the same at compile time.
#[unsafe(no_mangle)]
// SAFETY: the prefix `isobath_` is this library's; nothing else defines the name.
pub extern "C" fn isobath_context_size(width: u32, height: u32, columns: u32, rows: u32) -> usize {
    Layout::new(width, height, columns, rows).map_or(0, |layout| layout.bytes)
}
