//! Min/max depth pyramid: the nearest and farthest reading, and the number of holes, of square tiles of 4, 8, 16, ...
//! pixels. A ray that stays in front of a tile's nearest reading can't hit anything in it.
//!
//! Memory: one [`Cell`] (6 bytes for `u16` depth, 12 for `f32`) per tile of every level, about a twelfth of the pixels:
//! 9.7 kB at 160 x 120, 154 kB at 640 x 480 ([`cells_needed`] says exactly). Cost: each pixel is read once, about 0.4 ns
//! with vector units. Exact: no rounding anywhere.

use core::fmt;

use crate::ground::image::ImageView;
use crate::ground::lanes::VECTORS;
use crate::sensing::depth::DepthSample;

/// Side of the finest tiles, in pixels.
pub const FINEST_TILE: usize = 4;

/// Levels at most: tiles up to 131,072 pixels wide.
pub const MAX_LEVELS: usize = 16;

/// What is known of one tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell<D: DepthSample> {
    /// The nearest reading; [`DepthSample::ABOVE_ALL`] when there is none.
    pub min: D,
    /// The farthest reading; [`DepthSample::HOLE`] when there is none.
    pub max: D,
    /// Pixels without a reading, saturating at 65535.
    pub holes: u16,
}

impl<D: DepthSample> Cell<D> {
    /// A tile of no pixels: what storage is filled with before the first build.
    pub const EMPTY: Self = Self { min: D::ABOVE_ALL, max: D::HOLE, holes: 0 };

    /// Whether there is any reading.
    #[must_use]
    pub fn has_readings(&self) -> bool {
        self.max.is_valid()
    }

    fn merge(&mut self, other: &Self) {
        if other.min < self.min {
            self.min = other.min;
        }
        if other.max > self.max {
            self.max = other.max;
        }
        self.holes = self.holes.saturating_add(other.holes);
    }
}

/// The storage is too small for the image, or the image too large.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PyramidError {
    /// Cells needed ([`cells_needed`]).
    pub needed: usize,
    /// Cells given.
    pub got: usize,
}

impl fmt::Display for PyramidError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the depth pyramid needs {} cells of storage, got {}", self.needed, self.got)
    }
}

impl core::error::Error for PyramidError {}

/// Cells needed for an image of this size; 0 for an empty image, `usize::MAX` for one beyond 131,072 pixels a side.
///
/// ```
/// use isobath::skipping::pyramid::{cells_needed, Cell};
/// const CELLS: usize = cells_needed(160, 120);
/// static STORAGE: [Cell<u16>; CELLS] = [Cell::EMPTY; CELLS];
/// assert_eq!(CELLS, 1609);
/// assert_eq!(size_of_val(&STORAGE), 1609 * 6);
/// ```
#[must_use]
pub const fn cells_needed(width: usize, height: usize) -> usize {
    if width == 0 || height == 0 {
        return 0;
    }
    let most = FINEST_TILE << (MAX_LEVELS - 1);
    if width > most || height > most {
        return usize::MAX;
    }
    let (mut w, mut h) = (width.div_ceil(FINEST_TILE), height.div_ceil(FINEST_TILE));
    let mut cells = w * h;
    while w > 1 || h > 1 {
        w = w.div_ceil(2);
        h = h.div_ceil(2);
        cells += w * h;
    }
    cells
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Level {
    start: u32,
    width: u32,
    height: u32,
}

/// Where [`Pyramid::build`] puts each level, and how many there are. (It keeps its own count: built from this table, whose sizes the
/// compiler does not see through, it takes 3 to 20 % longer.)
fn levels_of(width: usize, height: usize) -> ([Level; MAX_LEVELS], usize) {
    let mut levels = [Level::default(); MAX_LEVELS];
    if width == 0 || height == 0 {
        return (levels, 0);
    }
    let (mut w, mut h) = (width.div_ceil(FINEST_TILE), height.div_ceil(FINEST_TILE));
    let (mut start, mut count) = (0, 0);
    for level in &mut levels {
        *level = Level { start: start as u32, width: w as u32, height: h as u32 };
        count += 1;
        if w == 1 && h == 1 {
            break;
        }
        start += w * h;
        w = w.div_ceil(2);
        h = h.div_ceil(2);
    }
    (levels, count)
}

/// The pyramid of one depth image, in the caller's storage.
#[derive(Debug, Clone, Copy)]
pub struct Pyramid<'a, D: DepthSample = u16> {
    cells: &'a [Cell<D>],
    levels: [Level; MAX_LEVELS],
    count: usize,
    size: (usize, usize),
}

impl<'a, D: DepthSample> Pyramid<'a, D> {
    /// Reads `depth` once and fills `storage`.
    ///
    /// # Errors
    /// [`PyramidError`] when `storage` is shorter than [`cells_needed`].
    ///
    /// ```
    /// use isobath::sensing::depth::DepthArray;
    /// use isobath::skipping::pyramid::{cells_needed, Cell, Pyramid};
    /// let mut depth = DepthArray::<160, 120>::filled(2000);
    /// depth.view_mut().set(3, 3, 500);
    /// let mut storage = [Cell::EMPTY; cells_needed(160, 120)];
    /// let pyramid = Pyramid::build(depth.view(), &mut storage)?;
    /// let corner = pyramid.cell(0, 0, 0).unwrap();
    /// assert_eq!((corner.min, corner.max), (500, 2000));
    /// # Ok::<(), isobath::skipping::pyramid::PyramidError>(())
    /// ```
    pub fn build(depth: ImageView<'_, D>, storage: &'a mut [Cell<D>]) -> Result<Self, PyramidError> {
        let (width, height) = depth.size();
        let needed = cells_needed(width, height);
        let got = storage.len();
        let Some(cells) = storage.get_mut(..needed) else {
            return Err(PyramidError { needed, got });
        };
        let mut levels = [Level::default(); MAX_LEVELS];
        let mut count = 0;
        if needed > 0 {
            let (mut w, mut h) = (width.div_ceil(FINEST_TILE), height.div_ceil(FINEST_TILE));
            let (mut below, mut rest) = cells.split_at_mut_checked(w * h).unwrap_or_default();
            let build = if VECTORS { build_finest } else { build_by_tiles };
            build(depth, below, w);
            let mut start = 0;
            for level in &mut levels {
                *level = Level { start: start as u32, width: w as u32, height: h as u32 };
                count += 1;
                if w == 1 && h == 1 {
                    break;
                }
                let (fine_w, fine_h) = (w, h);
                start += w * h;
                w = w.div_ceil(2);
                h = h.div_ceil(2);
                let (this, above) = rest.split_at_mut_checked(w * h).unwrap_or_default();
                reduce(below, fine_w, fine_h, this, w);
                below = this;
                rest = above;
            }
        }
        Ok(Self { cells, levels, count, size: (width, height) })
    }

    /// The pyramid that [`Self::build`] left in `storage`, for owners that can't keep its borrow between two calls (the C
    /// interface). Reads no cell: with other cells than that build's, skipping skips what it must not.
    ///
    /// # Errors
    /// [`PyramidError`] when `storage` is shorter than [`cells_needed`].
    pub fn resume(size: (usize, usize), storage: &'a [Cell<D>]) -> Result<Self, PyramidError> {
        let needed = cells_needed(size.0, size.1);
        let cells = storage.get(..needed).ok_or(PyramidError { needed, got: storage.len() })?;
        let (levels, count) = levels_of(size.0, size.1);
        Ok(Self { cells, levels, count, size })
    }

    /// Number of levels; 0 for an empty image. The last level is one cell.
    #[must_use]
    pub const fn levels(&self) -> usize {
        self.count
    }

    /// Width and height of the image it was built from.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Side of the tiles of a level, in pixels.
    #[must_use]
    pub const fn tile(level: usize) -> usize {
        FINEST_TILE << if level < MAX_LEVELS { level } else { MAX_LEVELS }
    }

    /// Tiles across and down at a level; (0, 0) beyond the last.
    #[must_use]
    pub fn level_size(&self, level: usize) -> (usize, usize) {
        self.levels.get(level).map_or((0, 0), |l| (l.width as usize, l.height as usize))
    }

    /// One tile; `None` outside.
    #[inline]
    #[must_use]
    pub fn cell(&self, level: usize, x: usize, y: usize) -> Option<Cell<D>> {
        let l = self.levels.get(level)?;
        if x >= l.width as usize || y >= l.height as usize {
            return None;
        }
        self.cells.get(l.start as usize + y * l.width as usize + x).copied()
    }

    /// The whole image as one tile; [`Cell::EMPTY`] for an empty image.
    #[must_use]
    pub fn whole(&self) -> Cell<D> {
        self.cells.last().copied().unwrap_or(Cell::EMPTY)
    }
}

/// Tile by tile, its numbers in registers: for targets without vector units. Of a tile without a hole, which nearly every one is,
/// the two ends of the readings say so; only where they do not are the holes counted.
fn build_by_tiles<D: DepthSample>(depth: ImageView<'_, D>, out: &mut [Cell<D>], across: usize) {
    for (ty, line) in out.chunks_mut(across.max(1)).enumerate() {
        let rows: [_; FINEST_TILE] = core::array::from_fn(|j| depth.row(ty * FINEST_TILE + j));
        let [a, b, c, d] = rows.map(|row| row.as_chunks::<FINEST_TILE>().0);
        let whole = a.iter().zip(b).zip(c).zip(d).map(|(((a, b), c), d)| [a, b, c, d]);
        let mut done = 0;
        for (cell, tile) in line.iter_mut().zip(whole) {
            *cell = whole_tile(tile).unwrap_or_else(|| any_tile(tile.map(|row| row.as_slice())));
            done += 1;
        }
        // At the right and the lower border.
        for (tx, cell) in line.iter_mut().enumerate().skip(done) {
            *cell = any_tile(rows.map(|row| row.chunks(FINEST_TILE).nth(tx).unwrap_or(&[])));
        }
    }
}

/// A tile without a hole; `None` when there is one.
#[inline(always)]
fn whole_tile<D: DepthSample>(tile: [&[D; FINEST_TILE]; FINEST_TILE]) -> Option<Cell<D>> {
    let (mut low, mut high) = (i32::MAX, i32::MIN);
    for row in tile {
        for key in row.map(D::key) {
            low = low.min(key);
            high = high.max(key);
        }
    }
    (low >= D::KEYS.0 && high <= D::KEYS.1).then(|| Cell { min: D::from_key(low), max: D::from_key(high), holes: 0 })
}

/// Any tile, cut by the border or not.
#[inline(never)]
fn any_tile<D: DepthSample>(tile: [&[D]; FINEST_TILE]) -> Cell<D> {
    let Cell { mut min, mut max, mut holes } = Cell::EMPTY;
    for &v in tile.into_iter().flatten() {
        if v.is_valid() {
            min = if v < min { v } else { min };
            max = if v > max { v } else { max };
        } else {
            holes += 1;
        }
    }
    Cell { min, max, holes }
}

/// Columns worked on at a time: a multiple of the tile, small enough to stay in registers and the first cache.
const STRIP: usize = 64;

/// Down the columns first (vectorises), then across each tile.
fn build_finest<D: DepthSample>(depth: ImageView<'_, D>, out: &mut [Cell<D>], across: usize) {
    for (ty, line) in out.chunks_mut(across.max(1)).enumerate() {
        for (strip, cells) in line.chunks_mut(STRIP / FINEST_TILE).enumerate() {
            let x = strip * STRIP;
            let mut min = [D::ABOVE_ALL; STRIP];
            let mut max = [D::HOLE; STRIP];
            let mut holes = [0_u16; STRIP];
            for y in ty * FINEST_TILE..(ty + 1) * FINEST_TILE {
                let row = depth.row(y).get(x..).unwrap_or(&[]);
                for (((&v, lo), hi), n) in row.iter().zip(&mut min).zip(&mut max).zip(&mut holes) {
                    let ok = v.is_valid();
                    let (near, far) = if ok { (v, v) } else { (D::ABOVE_ALL, D::HOLE) };
                    *lo = if near < *lo { near } else { *lo };
                    *hi = if far > *hi { far } else { *hi };
                    *n += u16::from(!ok);
                }
            }
            let tiles = min.as_chunks::<FINEST_TILE>().0.iter().zip(max.as_chunks::<FINEST_TILE>().0);
            for ((cell, (lo, hi)), n) in cells.iter_mut().zip(tiles).zip(holes.as_chunks::<FINEST_TILE>().0) {
                *cell = Cell::EMPTY;
                for ((&min, &max), &holes) in lo.iter().zip(hi).zip(n) {
                    cell.merge(&Cell { min, max, holes });
                }
            }
        }
    }
}

/// Each cell from the (up to) four below it.
fn reduce<D: DepthSample>(below: &[Cell<D>], fine_w: usize, fine_h: usize, out: &mut [Cell<D>], across: usize) {
    for (y, line) in out.chunks_mut(across.max(1)).enumerate() {
        for cell in line.iter_mut() {
            *cell = Cell::EMPTY;
        }
        for fy in (2 * y)..(2 * y + 2).min(fine_h) {
            let row = below.get(fy * fine_w..(fy + 1) * fine_w).unwrap_or(&[]);
            for (cell, pair) in line.iter_mut().zip(row.chunks(2)) {
                for fine in pair {
                    cell.merge(fine);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    fn brute<D: DepthSample>(depth: ImageView<'_, D>, x0: usize, y0: usize, tile: usize) -> Cell<D> {
        let mut cell = Cell::EMPTY;
        for row in depth.crop(x0, y0, tile, tile).rows() {
            for &v in row {
                if v.is_valid() {
                    cell.merge(&Cell { min: v, max: v, holes: 0 });
                } else {
                    cell.holes = cell.holes.saturating_add(1);
                }
            }
        }
        cell
    }

    fn every_cell_is_right<D: DepthSample>(data: &[D], w: usize, h: usize) {
        let depth = ImageView::new(data, w, h).unwrap();
        let mut storage = vec![Cell::EMPTY; cells_needed(w, h)];
        // The way of targets without vector units.
        let mut by_tiles = vec![Cell::EMPTY; w.div_ceil(FINEST_TILE) * h.div_ceil(FINEST_TILE)];
        build_by_tiles(depth, &mut by_tiles, w.div_ceil(FINEST_TILE));
        let pyramid = Pyramid::build(depth, &mut storage).unwrap();
        assert!(by_tiles == pyramid.cells[..by_tiles.len()]);
        assert_eq!(pyramid.size(), (w, h));
        for level in 0..pyramid.levels() {
            let (lw, lh) = pyramid.level_size(level);
            let tile = Pyramid::<D>::tile(level);
            for (x, y) in (0..lh).flat_map(|y| (0..lw).map(move |x| (x, y))) {
                let want = brute(depth, x * tile, y * tile, tile);
                assert_eq!(pyramid.cell(level, x, y), Some(want), "level {level} tile {x},{y}");
            }
            assert_eq!(pyramid.cell(level, lw, 0), None);
        }
        if w * h > 0 {
            assert_eq!(pyramid.level_size(pyramid.levels() - 1), (1, 1));
            assert_eq!(pyramid.whole(), brute(depth, 0, 0, w.max(h)));
        }
        let (levels, count) = (pyramid.levels, pyramid.count);
        let again = Pyramid::resume((w, h), &storage).unwrap();
        assert_eq!((again.levels, again.count, again.cells), (levels, count, &storage[..]));
    }

    #[test]
    fn odd_and_extreme_shapes() {
        for (w, h) in [(0, 0), (0, 7), (7, 0), (1, 1), (1, 33), (33, 1), (65_535, 1), (1, 65_535), (161, 119)] {
            let data: Vec<u16> = (0..w * h).map(|i| (i * 7919 % 65_536) as u16).collect();
            every_cell_is_right(&data, w, h);
        }
    }

    #[test]
    fn storage_must_suffice() {
        let data = [1_u16; 64];
        let depth = ImageView::new(&data, 8, 8).unwrap();
        let mut short = [Cell::EMPTY; 4];
        assert_eq!(Pyramid::build(depth, &mut short).unwrap_err(), PyramidError { needed: 5, got: 4 });
        assert_eq!(Pyramid::resume((8, 8), &short).unwrap_err(), PyramidError { needed: 5, got: 4 });
        assert_eq!(cells_needed(usize::MAX, 1), usize::MAX);
    }

    proptest! {
        #[test]
        fn matches_brute_force(w in 1_usize..150, h in 1_usize..40, seed in any::<u32>()) {
            let mut s = seed | 1;
            let mut next = || { s ^= s << 13; s ^= s >> 17; s ^= s << 5; s };
            let raw: Vec<u16> = (0..w * h).map(|_| match next() % 8 { 0 => 0, 1 => 65_535, _ => next() as u16 }).collect();
            every_cell_is_right(&raw, w, h);
            let float: Vec<f32> = raw.iter().map(|&v| match v { 0 => f32::NAN, 65_535 => f32::INFINITY, 1 => -1.0, v => f32::from(v) }).collect();
            every_cell_is_right(&float, w, h);
        }
    }
}
