//! The arithmetic of one tile: eight rows of eight values.
//!
//! Each quantity is an array of 64 numbers and each step one plain loop over arrays, which the compiler turns into vectors; sums
//! lay halves upon each other. (Eight running sums a quantity, kept from row to row, ended up in scalars: 48 instead of 32
//! instructions a pixel.) Where the image ends inside a tile, the rest are holes: they add nothing to any sum.

use super::TILE;
use crate::ground::image::ImageView;
use crate::ground::regression::Sums;
use crate::sensing::depth::{DepthSample, DepthUnit};

/// One number a pixel, row by row.
type Numbers = [f32; TILE * TILE];

/// The values of a tile.
pub(super) struct Block<D>([[D; TILE]; TILE]);

/// How a tile's readings differ from those of another frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Differences {
    /// Readings in the one frame and in the other, added.
    pub(super) readings: f32,
    /// Pixels with a reading in both.
    pub(super) both: f32,
    /// Of those: depth before, metres, added.
    pub(super) z: f32,
    /// And now less before, metres: added, squares added, the largest without its sign.
    pub(super) sum: f32,
    pub(super) squares: f32,
    pub(super) largest: f32,
}

impl Differences {
    /// Pixels that have a reading in one frame only.
    pub(super) fn flips(&self) -> f32 {
        self.readings - 2.0 * self.both
    }
}

impl<D: DepthSample> Block<D> {
    /// Without a reading.
    pub(super) const EMPTY: Self = Self([[D::HOLE; TILE]; TILE]);

    /// Takes the tile in column `tx`, row `ty` of an image's tiles. In place, as returning it copies it once more.
    #[inline(always)]
    pub(super) fn load(&mut self, image: ImageView<'_, D>, tx: usize, ty: usize) {
        for (j, row) in self.0.iter_mut().enumerate() {
            let source = image.row(ty * TILE + j).get(tx * TILE..).unwrap_or(&[]);
            if let Some(whole) = source.first_chunk() {
                *row = *whole;
            } else {
                *row = [D::HOLE; TILE];
                row.iter_mut().zip(source).for_each(|(cell, value)| *cell = *value);
            }
        }
    }

    /// Whether no value differs. NaN differs from itself: then, [`Self::differences`] tell.
    #[inline(always)]
    pub(super) fn equals(&self, other: &Self) -> bool {
        self.0.iter().zip(&other.0).all(|(a, b)| {
            // Without a branch a value, so that a row is compared at once.
            a.iter().zip(b).fold(true, |equal, (a, b)| equal & (a == b))
        })
    }

    /// One number a value, row by row: one loop over all, so that the compiler takes several at a time.
    #[inline(always)]
    fn numbers(&self, f: impl Fn(D) -> f32) -> [f32; TILE * TILE] {
        let mut out = [0.0; TILE * TILE];
        for (number, &value) in out.iter_mut().zip(self.0.as_flattened()) {
            *number = f(value);
        }
        out
    }

    /// Whether there is a reading.
    #[inline(always)]
    pub(super) fn has_readings(&self) -> bool {
        self.0.iter().any(|row| row.iter().fold(false, |any, v| any | v.is_valid()))
    }

    /// Against the same tile of an earlier frame.
    #[inline(always)]
    pub(super) fn differences(&self, before: &Self, unit: DepthUnit) -> Differences {
        let (now, before) = (self.numbers(|v| v.metres(unit)), before.numbers(|v| v.metres(unit)));
        let squares_and_largest = |d: &Numbers| {
            let largest = fold(&each(d, d, |d, _| d.abs()), |a, b| if a > b { a } else { b });
            (total(&each(d, d, |a, b| a * b)), largest)
        };
        // The usual tile has no hole, and needs a third of the work less.
        if least(&now) > 0.0 && least(&before) > 0.0 {
            let d = each(&now, &before, |a, b| a - b);
            let (squares, largest) = squares_and_largest(&d);
            let n = (TILE * TILE) as f32;
            return Differences { readings: 2.0 * n, both: n, z: total(&before), sum: total(&d), squares, largest };
        }
        let both = each(&now, &before, |a, b| if (a > 0.0) & (b > 0.0) { 1.0 } else { 0.0 });
        let d = each(&each(&now, &before, |a, b| a - b), &both, |d, both| d * both);
        let (squares, largest) = squares_and_largest(&d);
        Differences {
            readings: total(&each(&now, &before, |a, b| {
                (if a > 0.0 { 1.0 } else { 0.0 }) + if b > 0.0 { 1.0 } else { 0.0 }
            })),
            both: total(&both),
            z: total(&each(&before, &both, |b, both| b * both)),
            sum: total(&d),
            squares,
            largest,
        }
    }

    /// The sums for a plane of inverse depth, offsets from the tile's middle, and the first reading's inverse, which is
    /// subtracted from all; `None` without a reading.
    #[inline(always)]
    pub(super) fn plane(&self) -> Option<(Sums, f32)> {
        let first = 1.0 / self.0.as_flattened().iter().find(|v| v.is_valid())?.number();
        let numbers = self.numbers(|v| if v.is_valid() { v.number() } else { 0.0 });
        let (x, y) = (X.as_flattened(), Y.as_flattened());
        let sum = |a: &[f32], b: &[f32]| total(&each(a, b, |a, b| a * b));
        let (inverse, pixels) = if least(&numbers) > 0.0 {
            (each(&numbers, &numbers, |v, _| 1.0 / v - first), WHOLE)
        } else {
            let valid = each(&numbers, &numbers, |v, _| if v > 0.0 { 1.0 } else { 0.0 });
            // 1 in place of a hole keeps the division finite.
            let inverse = each(&numbers, &valid, |v, valid| (1.0 / (v + (1.0 - valid)) - first) * valid);
            let (nx, ny) = (each(x, &valid, |x, valid| x * valid), each(y, &valid, |y, valid| y * valid));
            let n = total(&valid);
            let (xx, xy, yy) = (sum(&nx, x), sum(&nx, y), sum(&ny, y));
            (inverse, Sums { n, x: total(&nx), y: total(&ny), xx, xy, yy, ..WHOLE })
        };
        let (w, ww) = (total(&inverse), sum(&inverse, &inverse));
        Some((Sums { w, xw: sum(&inverse, x), yw: sum(&inverse, y), ww, ..pixels }, first))
    }

    /// Row by row.
    pub(super) fn rows(&self) -> impl Iterator<Item = &[D; TILE]> {
        self.0.iter()
    }
}

/// Offsets of a tile's pixels from its middle, in pixels.
const OFFSETS: [f32; TILE] = [-3.5, -2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 3.5];
const X: [[f32; TILE]; TILE] = [OFFSETS; TILE];
const Y: [[f32; TILE]; TILE] = {
    let [a, b, c, d, e, f, g, h] = OFFSETS;
    [[a; TILE], [b; TILE], [c; TILE], [d; TILE], [e; TILE], [f; TILE], [g; TILE], [h; TILE]]
};
/// The sums over a tile without a hole that depend on offsets alone: 8 times the squares of 3.5, 2.5, ... added.
const WHOLE: Sums = Sums { n: 64.0, x: 0.0, y: 0.0, w: 0.0, xx: 336.0, xy: 0.0, yy: 336.0, xw: 0.0, yw: 0.0, ww: 0.0 };

#[inline(always)]
fn each(a: &[f32], b: &[f32], f: impl Fn(f32, f32) -> f32) -> Numbers {
    let mut out = [0.0; TILE * TILE];
    for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
        *out = f(a, b);
    }
    out
}

/// The first half of the numbers, each with its like in the second.
#[inline(always)]
fn halves<const H: usize>(numbers: &[f32], f: impl Fn(f32, f32) -> f32) -> [f32; H] {
    let mut out = [0.0; H];
    let (first, second) = numbers.split_at_checked(H).unwrap_or_default();
    for ((out, &a), &b) in out.iter_mut().zip(first).zip(second) {
        *out = f(a, b);
    }
    out
}

/// All 64 numbers to one.
#[inline(always)]
fn fold(numbers: &Numbers, f: impl Fn(f32, f32) -> f32) -> f32 {
    let half: [f32; 32] = halves(numbers, &f);
    let half: [f32; 16] = halves(&half, &f);
    let half: [f32; 8] = halves(&half, &f);
    let half: [f32; 4] = halves(&half, &f);
    let [a, b]: [f32; 2] = halves(&half, &f);
    f(a, b)
}

/// The smallest.
#[inline(always)]
fn least(numbers: &Numbers) -> f32 {
    fold(numbers, |a, b| if a < b { a } else { b })
}

/// The sum.
#[inline(always)]
fn total(numbers: &Numbers) -> f32 {
    fold(numbers, |a, b| a + b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Values between 1 and 2, a share of them holes of every kind.
    fn image(seed: u64, n: usize, share: f32) -> Vec<f32> {
        let mut state = seed;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1_u64 << 24) as f32
        };
        let holes = [0.0, f32::NAN, -1.0, f32::INFINITY];
        (0..n).map(|i| if next() < share { holes[i % 4] } else { 1.0 + next() }).collect()
    }

    fn close(a: f32, b: f64) -> bool {
        (f64::from(a) - b).abs() <= 2e-6 * b.abs().max(1.0)
    }

    #[test]
    fn sums_are_those_of_single_values() {
        // A whole tile without holes and with them, and one that the image cuts short.
        agrees(0.0, 0);
        agrees(0.33, 0);
        agrees(0.33, 1);
    }

    /// Tile `t`, `t` of an image against sums in f64, value by value.
    fn agrees(share: f32, t: usize) {
        let (w, h) = (13, 14);
        let (now, before) = (image(1, w * h, share), image(2, w * h, share));
        let at = |image| {
            let mut block = Block::EMPTY;
            block.load(ImageView::new(image, w, h).unwrap(), t, t);
            block
        };
        let found = at(&now).differences(&at(&before), DepthUnit::METRE);
        let (plane, first) = at(&now).plane().unwrap();
        let [mut readings, mut both, mut z, mut sum, mut squares, mut largest] = [0.0_f64; 6];
        let mut sums = [0.0_f64; 10];
        let from = t * TILE;
        for y in from..h.min(from + TILE) {
            for x in from..w.min(from + TILE) {
                let (a, b) = (f64::from(now[y * w + x]), f64::from(before[y * w + x]));
                let (in_a, in_b) = (a > 0.0 && a < 3.0, b > 0.0 && b < 3.0);
                readings += f64::from(u8::from(in_a) + u8::from(in_b));
                if in_a && in_b {
                    both += 1.0;
                    z += b;
                    sum += a - b;
                    squares += (a - b) * (a - b);
                    largest = (a - b).abs().max(largest);
                }
                if in_a {
                    let (x, y, w) = ((x - from) as f64 - 3.5, (y - from) as f64 - 3.5, 1.0 / a - f64::from(first));
                    let terms = [1.0, x, y, w, x * x, x * y, y * y, x * w, y * w, w * w];
                    sums.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
                }
            }
        }
        let got = [found.readings, found.both, found.z, found.sum, found.squares, found.largest];
        for (got, want) in got.into_iter().zip([readings, both, z, sum, squares, largest]) {
            assert!(close(got, want), "{got} {want}");
        }
        assert_eq!(found.flips(), (readings - 2.0 * both) as f32);
        let s = plane;
        let got = [s.n, s.x, s.y, s.w, s.xx, s.xy, s.yy, s.xw, s.yw, s.ww];
        for (got, want) in got.into_iter().zip(sums) {
            assert!(close(got, want), "{got} {want}");
        }
    }

    #[test]
    fn a_tile_without_readings() {
        let holes = [f32::NAN, 0.0, -1.0, f32::INFINITY].repeat(16);
        let mut block = Block::EMPTY;
        block.load(ImageView::new(&holes, 8, 8).unwrap(), 0, 0);
        assert!(!block.has_readings() && block.plane().is_none() && !block.equals(&block));
        assert_eq!(block.differences(&block, DepthUnit::METRE).readings, 0.0);
    }
}
