//! Which parts of the image need work at all? Tiles of 8 x 8 pixels: empty, unchanged within the sensor's noise, flat.
//!
//! A sensor that looks at a still room delivers the same depth again and again, and again differently: every pixel trembles.
//! The change test knows the noise ([`DepthNoise`]): a tile is *unchanged* when its differences from the reference are what
//! that noise explains, in their sum of squares (chi-square), in their mean, and in the largest one. The reference is
//! the depth the tile had when it last changed, not the last frame, so that a slow drift is noticed once it leaves the
//! noise. Without noise ([`DepthNoise::NONE`] and `f32` depth) unchanged means equal to the last bit, and then what is kept
//! for a tile is exactly what would be computed anew.
//!
//! Memory: the reference image (2 bytes a pixel for `u16`) and one byte a tile: 38.7 kB at 160 x 120. Cost a pixel (x86-64
//! baseline, one core): 0.5 ns where nothing changed to the last bit, 1.2 ns where only noise did, 2.3 ns where all is new. That
//! last is half of what dense normals cost: with a camera that moves all the time, computing everything is faster than
//! asking what changed (`isobath bench --filter skipping`). Sensitivity at 64 readings: a shift of the whole tile by 1 standard
//! deviation is seen; a still tile is taken for changed in about 1 of 2,000 frames (both held by tests).

mod block;

use core::fmt;

use crate::ground::image::ImageViewMut;
use crate::ground::regression::Sums;
use crate::sensing::depth::noise::DepthNoise;
use crate::sensing::depth::{DepthSample, DepthUnit};
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use block::Block;

/// Side of a tile, in pixels.
pub const TILE: usize = 8;

/// What is known of one tile. One byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Tile(u8);

impl Tile {
    /// A tile never looked at: changed, by definition.
    pub const NEW: Self = Self(Self::CHANGED);
    /// What a static is filled with: all zero, so that it costs no flash. [`TileMap::new`] overwrites it.
    pub const ZERO: Self = Self(0);
    const EMPTY: u8 = 1;
    const CHANGED: u8 = 2;
    const FLAT: u8 = 4;

    /// No reading in it.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 & Self::EMPTY != 0
    }

    /// Different from the reference beyond the noise, in the last update.
    #[must_use]
    pub const fn is_changed(self) -> bool {
        self.0 & Self::CHANGED != 0
    }

    /// Its readings lie on one plane within the noise.
    #[must_use]
    pub const fn is_flat(self) -> bool {
        self.0 & Self::FLAT != 0
    }
}

/// Tiles needed for an image of this size.
#[must_use]
pub const fn tiles_needed(width: usize, height: usize) -> usize {
    width.div_ceil(TILE).saturating_mul(height.div_ceil(TILE))
}

/// The tiles slice is too short.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TilesError {
    /// Tiles needed ([`tiles_needed`]).
    pub needed: usize,
    /// Tiles given.
    pub got: usize,
}

impl fmt::Display for TilesError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the tile map needs {} tiles of storage, got {}", self.needed, self.got)
    }
}

impl core::error::Error for TilesError {}

/// What an update found; empty, unchanged and changed add up to the number of tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TileReport {
    /// Tiles without a reading now, nor in the reference.
    pub empty: u32,
    /// Tiles with readings that are what they were, within the noise.
    pub unchanged: u32,
    /// Tiles that differ; their reference is now this frame.
    pub changed: u32,
    /// Of all tiles, those on one plane.
    pub flat: u32,
}

/// The tile map of a stream of frames of one size, in the caller's memory.
///
/// ```
/// use isobath::ground::image::Image;
/// use isobath::sensing::{camera::Intrinsics, depth::{noise::DepthNoise, DepthArray, DepthUnit}, frame::DepthFrame};
/// use isobath::skipping::tiles::{tiles_needed, Tile, TileMap};
/// let mut reference = DepthArray::<160, 120>::filled(0);
/// let mut tiles = [Tile::NEW; tiles_needed(160, 120)];
/// let mut map = TileMap::new(reference.view_mut(), &mut tiles)?;
/// let mut depth = DepthArray::<160, 120>::filled(2000);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let first = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, k);
/// assert_eq!(map.update(&first, &DepthNoise::KINECT).changed, 300); // nothing was known
/// depth.view_mut().set(20, 30, 1800); // something comes 20 cm nearer
/// let second = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, k);
/// let report = map.update(&second, &DepthNoise::KINECT);
/// assert_eq!((report.changed, report.unchanged), (1, 299));
/// assert!(map.tile(20 / 8, 30 / 8).is_changed());
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct TileMap<'a, D: DepthSample = u16> {
    reference: ImageViewMut<'a, D>,
    tiles: &'a mut [Tile],
    across: usize,
    down: usize,
}

impl<'a, D: DepthSample> TileMap<'a, D> {
    /// A map that knows nothing: the first update finds every tile changed. `reference` gives the size of the frames to
    /// come; what it holds is overwritten.
    ///
    /// # Errors
    /// [`TilesError`] when `tiles` is shorter than [`tiles_needed`].
    pub fn new(mut reference: ImageViewMut<'a, D>, tiles: &'a mut [Tile]) -> Result<Self, TilesError> {
        let (width, height) = reference.size();
        let needed = tiles_needed(width, height);
        let got = tiles.len();
        let Some(tiles) = tiles.get_mut(..needed) else {
            return Err(TilesError { needed, got });
        };
        reference.fill(D::HOLE);
        tiles.fill(Tile::NEW);
        Ok(Self { reference, tiles, across: width.div_ceil(TILE), down: height.div_ceil(TILE) })
    }

    /// Tiles across and down.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        (self.across, self.down)
    }

    /// One tile; [`Tile::NEW`] outside.
    #[must_use]
    pub fn tile(&self, x: usize, y: usize) -> Tile {
        if x >= self.across {
            return Tile::NEW;
        }
        self.tiles.get(y * self.across + x).copied().unwrap_or(Tile::NEW)
    }

    /// Whether the tile or one of its eight neighbours changed: whether an answer that looks up to [`TILE`] pixels around
    /// each pixel of the tile is out of date.
    #[must_use]
    pub fn is_stale(&self, x: usize, y: usize) -> bool {
        let (x0, x1) = (x.saturating_sub(1), (x + 2).min(self.across));
        let (y0, y1) = (y.saturating_sub(1), (y + 2).min(self.down));
        (y0..y1).any(|y| {
            let row = self.tiles.get(y * self.across + x0..y * self.across + x1).unwrap_or(&[]);
            row.iter().any(|tile| tile.is_changed())
        })
    }

    /// Compares the frame with the reference, tile by tile, and takes changed tiles into the reference. A frame of another
    /// size than the reference changes everything and is not kept.
    pub fn update(&mut self, frame: &DepthFrame<'_, D>, noise: &DepthNoise) -> TileReport {
        let mut report = TileReport::default();
        if frame.size() != self.reference.size() {
            self.tiles.fill(Tile::NEW);
            report.changed = self.tiles.len() as u32;
            return report;
        }
        let (mut now, mut before) = (Block::EMPTY, Block::EMPTY);
        for ty in 0..self.down {
            for tx in 0..self.across {
                now.load(frame.depth(), tx, ty);
                before.load(self.reference.as_view(), tx, ty);
                let verdict = compare(&now, &before, frame.unit(), noise);
                let index = ty * self.across + tx;
                let Some(tile) = self.tiles.get_mut(index) else { continue };
                let flags = match verdict {
                    Verdict::Empty => {
                        report.empty += 1;
                        Tile::EMPTY
                    }
                    Verdict::Same => {
                        report.unchanged += 1;
                        tile.0 & !Tile::CHANGED
                    }
                    Verdict::Changed => {
                        report.changed += 1;
                        Tile::CHANGED | self.adopt(&now, frame.unit(), noise, tx, ty)
                    }
                };
                if let Some(tile) = self.tiles.get_mut(index) {
                    *tile = Tile(flags);
                    report.flat += u32::from(tile.is_flat());
                }
            }
        }
        report
    }

    /// Tiles to do and tiles that can be left as they were, for an answer that looks at most [`TILE`] pixels around.
    #[must_use]
    pub fn work(&self) -> Work {
        if !self.tiles.iter().any(|tile| tile.is_changed()) {
            return Work { done: 0, skipped: self.tiles.len() as u32 };
        }
        let stale = (0..self.down).flat_map(|y| (0..self.across).map(move |x| (x, y)));
        let done = stale.filter(|&(x, y)| self.is_stale(x, y)).count() as u32;
        Work { done, skipped: self.tiles.len() as u32 - done }
    }

    /// Takes the tile into the reference; returns its flags.
    fn adopt(&mut self, now: &Block<D>, unit: DepthUnit, noise: &DepthNoise, tx: usize, ty: usize) -> u8 {
        for (j, row) in now.rows().enumerate() {
            let kept = self.reference.row_mut(ty * TILE + j).get_mut(tx * TILE..).unwrap_or_default();
            match kept.first_chunk_mut() {
                Some(whole) => *whole = *row,
                None => kept.iter_mut().zip(row).for_each(|(cell, value)| *cell = *value),
            }
        }
        let Some((sums, first)) = now.plane() else {
            return Tile::EMPTY;
        };
        let variance = noise.inverse_variance::<D>(first + sums.w / sums.n, unit);
        if is_plane_within(&sums, variance) { Tile::FLAT } else { 0 }
    }
}

/// What a tile is against its reference.
#[inline(always)]
fn compare<D: DepthSample>(now: &Block<D>, before: &Block<D>, unit: DepthUnit, noise: &DepthNoise) -> Verdict {
    // The cheapest question first: still scenes without noise end here.
    if now.equals(before) {
        return if now.has_readings() { Verdict::Same } else { Verdict::Empty };
    }
    let d = now.differences(before, unit);
    let n = d.both;
    if d.readings == 0.0 {
        return Verdict::Empty;
    }
    if d.largest == 0.0 && d.flips() == 0.0 {
        return Verdict::Same;
    }
    // Sensors lose and find single pixels at edges all the time: one in eight may, where there is noise at all.
    let variance = 2.0 * noise.variance::<D>(d.z / n.max(1.0), unit);
    let noisy = variance > 0.0;
    if d.flips() > if noisy { 0.125 * n } else { 0.0 } || n == 0.0 {
        return Verdict::Changed;
    }
    let calm = d.squares / variance - n;
    let explained = noisy
        && (calm <= 0.0 || calm * calm <= 16.0 * 2.0 * n)
        && d.sum * d.sum <= 16.0 * n * variance
        && d.largest * d.largest <= 25.0 * variance;
    if explained { Verdict::Same } else { Verdict::Changed }
}

#[derive(Clone, Copy, PartialEq)]
enum Verdict {
    Empty,
    Same,
    Changed,
}

/// Whether the residual of the plane is what a variance of single values explains (chi-square, three standard
/// deviations). Fewer than 20 readings are no evidence.
fn is_plane_within(sums: &Sums, variance: f32) -> bool {
    let freedom = sums.n - 3.0;
    sums.n >= 20.0
        && sums.solve().is_some_and(|plane| {
            let excess = plane.squares - variance * freedom;
            excess <= 0.0 || excess * excess <= 18.0 * freedom * variance * variance
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::Intrinsics;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    struct Gauss(u64);

    impl Gauss {
        fn uniform(&mut self) -> f32 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 33) as f32 + 0.5) / (1_u64 << 31) as f32
        }
        fn next(&mut self) -> f32 {
            (-2.0 * self.uniform().ln()).sqrt() * (core::f32::consts::TAU * self.uniform()).cos()
        }
    }

    fn camera() -> Intrinsics {
        Intrinsics::new(500.0, 500.0, 79.5, 59.5).unwrap()
    }

    fn frame(data: &[f32], w: usize, h: usize) -> DepthFrame<'_, f32> {
        DepthFrame::new(ImageView::new(data, w, h).unwrap(), DepthUnit::METRE, camera())
    }

    /// Updates a fresh map with each image in turn; the last report.
    fn last_report(images: &[Vec<f32>], w: usize, h: usize, noise: &DepthNoise) -> TileReport {
        let mut reference = vec![0.0; w * h];
        let mut tiles = vec![Tile::NEW; tiles_needed(w, h)];
        let mut map = TileMap::new(ImageViewMut::new(&mut reference, w, h).unwrap(), &mut tiles).unwrap();
        images.iter().map(|image| map.update(&frame(image, w, h), noise)).last().unwrap()
    }

    fn noisy(z: f32, n: usize, gauss: &mut Gauss) -> Vec<f32> {
        (0..n).map(|_| z + 1.425e-3 * z * z * gauss.next()).collect()
    }

    #[test]
    fn a_still_noisy_room_is_unchanged_and_flat() {
        let (w, h) = (320, 240);
        let mut gauss = Gauss(3);
        let mut changed = 0;
        for _ in 0..20 {
            let images = [noisy(2.0, w * h, &mut gauss), noisy(2.0, w * h, &mut gauss)];
            let report = last_report(&images, w, h, &DepthNoise::KINECT);
            changed += report.changed;
            assert!(report.flat > 1180, "{report:?}");
        }
        std::println!("taken for changed: {changed} of {} still tiles", 20 * 1200);
        assert!(changed <= 20, "{changed} of 24,000");
    }

    #[test]
    fn a_shift_by_one_standard_deviation_is_seen() {
        let (w, h) = (320, 240);
        let mut gauss = Gauss(5);
        let z = 2.0;
        let images = [noisy(z, w * h, &mut gauss), noisy(z + 1.425e-3 * z * z, w * h, &mut gauss)];
        let report = last_report(&images, w, h, &DepthNoise::KINECT);
        assert!(report.changed > 1000, "{report:?}");
    }

    #[test]
    fn drift_slower_than_the_noise_is_seen_in_the_end() {
        // A tenth of a standard deviation a frame: no two frames differ, the first and the twentieth do.
        let (w, h) = (64, 64);
        let mut gauss = Gauss(7);
        let images: Vec<_> = (0..40).map(|i| noisy(2.0 + 5.7e-4 * i as f32, w * h, &mut gauss)).collect();
        let mut reference = vec![0.0; w * h];
        let mut tiles = vec![Tile::NEW; tiles_needed(w, h)];
        let mut map = TileMap::new(ImageViewMut::new(&mut reference, w, h).unwrap(), &mut tiles).unwrap();
        let mut seen = 0;
        for (i, image) in images.iter().enumerate() {
            let report = map.update(&frame(image, w, h), &DepthNoise::KINECT);
            seen += if i > 0 { report.changed } else { 0 };
        }
        assert!(seen >= 64, "each tile must change at least once on the way: {seen}");
    }

    #[test]
    fn without_noise_one_bit_is_a_change() {
        let image = vec![1.5_f32; 64];
        let mut other = image.clone();
        other[17] = f32::from_bits(other[17].to_bits() + 1);
        assert_eq!(last_report(&[image.clone(), image.clone()], 8, 8, &DepthNoise::NONE).unchanged, 1);
        assert_eq!(last_report(&[image.clone(), other], 8, 8, &DepthNoise::NONE).changed, 1);
        let mut hole = image.clone();
        hole[3] = f32::NAN;
        assert_eq!(last_report(&[image, hole], 8, 8, &DepthNoise::NONE).changed, 1);
    }

    #[test]
    fn empty_tiles_and_ragged_edges() {
        let (w, h) = (19, 9);
        let mut image = vec![0.0_f32; w * h];
        image[18] = 1.0;
        let report = last_report(&[image.clone(), image], w, h, &DepthNoise::KINECT);
        assert_eq!(report, TileReport { empty: 5, unchanged: 1, changed: 0, flat: 0 });
        let none = last_report(&[vec![]], 0, 5, &DepthNoise::KINECT);
        assert_eq!(none, TileReport::default());
    }

    #[test]
    fn storage_must_suffice_and_sizes_agree() {
        let mut reference = vec![0.0_f32; 256];
        let mut tiles = [Tile::NEW; 3];
        let view = ImageViewMut::new(&mut reference, 16, 16).unwrap();
        assert_eq!(TileMap::new(view, &mut tiles).unwrap_err(), TilesError { needed: 4, got: 3 });
        let mut tiles = [Tile::NEW; 4];
        let view = ImageViewMut::new(&mut reference, 16, 16).unwrap();
        let mut map = TileMap::new(view, &mut tiles).unwrap();
        let other = [1.0_f32; 64];
        assert_eq!(map.update(&frame(&other, 8, 8), &DepthNoise::NONE).changed, 4);
        assert!(map.is_stale(0, 0) && !map.is_stale(99, 99));
    }

    proptest! {
        #[test]
        fn tiles_add_up(w in 0_usize..50, h in 0_usize..50, seed in any::<u64>()) {
            let mut gauss = Gauss(seed);
            let mut image = || (0..w * h).map(|_| if gauss.uniform() < 0.3 { f32::NAN } else { 2.0 + gauss.next() }).collect::<Vec<f32>>();
            let report = last_report(&[image(), image()], w, h, &DepthNoise::KINECT);
            prop_assert_eq!((report.empty + report.unchanged + report.changed) as usize, tiles_needed(w, h));
        }
    }
}
