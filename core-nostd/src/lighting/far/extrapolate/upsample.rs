//! From the grid to a map of any size: bicubic (Catmull-Rom), closed at the seam and over the poles.

use core::cell::Cell;
use core::ops::Range;

use super::grid::FarMap;
use crate::ground::colour::Colour;
use crate::ground::image::ImageViewMut;
use crate::ground::lanes::{LANES, Lanes, VECTORS};
use crate::ground::math;

/// A grid row blended for one map row.
pub(crate) struct Blended<const COLUMNS: usize>([[f32; COLUMNS]; 3]);

/// Of four neighbours, at 0 <= t < 1 between the middle two: the cubic.
#[inline(always)]
fn cubic([a, b, c, d]: [f32; 4], t: f32) -> f32 {
    let (first, third) = (0.5 * (c - a), 0.5 * (d - a) + 1.5 * (b - c));
    let second = a - 2.5 * b + 2.0 * c - 0.5 * d;
    b + t * (first + t * (second + t * third))
}

/// Those of eight pixels that are asked for, into a row that begins at column `start`.
#[inline(always)]
pub(crate) fn put<C: Copy>(row: &[Cell<C>], start: usize, eight: Eight, pixels: [C; LANES]) {
    let to = row.get(eight.from - start..eight.end - start).unwrap_or_default();
    for (to, pixel) in to.iter().zip(pixels.get(eight.lanes()).unwrap_or_default()) {
        to.set(*pixel);
    }
}

impl<const COLUMNS: usize, const ROWS: usize> FarMap<COLUMNS, ROWS> {
    /// Draws the whole map, of any size; a view of no pixels is left alone.
    pub fn render<C: Colour>(&self, out: &mut ImageViewMut<'_, C>) {
        let (width, height) = out.size();
        for y in 0..height {
            let to = Cell::from_mut(out.row_mut(y)).as_slice_of_cells();
            Self::eights(
                0..width,
                width,
                || self.blended(y, height),
                |_| true,
                |eight, [r, g, b]| {
                    let mut lit = [[0.0; 3]; LANES];
                    for (lit, ((r, g), b)) in lit.iter_mut().zip(r.0.iter().zip(&g.0).zip(&b.0)) {
                        *lit = [*r, *g, *b];
                    }
                    put(to, 0, eight, lit.map(C::of_linear));
                },
            );
        }
    }

    /// The light from a unit direction in the map's axes.
    #[must_use]
    pub fn towards(&self, direction: glam::Vec3) -> [f32; 3] {
        // The middle of a map as fine as `f32` tells columns apart.
        const FINE: usize = 1 << 16;
        let uv = crate::lighting::equirect::uv_of_direction(direction);
        let Some((x, y)) = crate::lighting::equirect::pixel_of_uv(uv, (FINE, FINE)) else { return [0.0; 3] };
        self.blended(y, FINE).at(x, FINE)
    }

    /// The grid's rows around a map row, blended.
    pub(crate) fn blended(&self, y: usize, height: usize) -> Blended<COLUMNS> {
        let at = (y as f32 + 0.5) / height as f32 * ROWS as f32 - 0.5;
        let first = math::floor(at);
        let t = at - first;
        let weights = [
            t * (-0.5 + t * (1.0 - 0.5 * t)),
            1.0 + t * t * (1.5 * t - 2.5),
            t * (0.5 + t * (2.0 - 1.5 * t)),
            t * t * (0.5 * t - 0.5),
        ];
        let mut out = Blended([[0.0; COLUMNS]; 3]);
        for (k, weight) in (-1..=2).zip(weights) {
            let (row, turned) = Self::over_poles(first as isize + k);
            for (plane, out) in self.planes.iter().zip(&mut out.0) {
                let Some(row) = row.and_then(|r| plane.get(r)) else { continue };
                // Across the pole, the row's halves change places.
                let (left, right) = row.split_at(if turned { COLUMNS / 2 } else { 0 });
                let (first, second) = out.split_at_mut(right.len().min(COLUMNS));
                for (out, part) in [(first, right), (second, left)] {
                    for (out, v) in out.iter_mut().zip(part) {
                        *out += weight * v;
                    }
                }
            }
        }
        out
    }

    /// A row's light at some columns of a map `width` wide, eight at a time: of each eight that begin at a multiple of eight the caller is told
    /// which are asked for, and may say that it needs none. A pixel is the same to the bit whichever columns are asked for.
    #[inline(always)]
    pub(crate) fn eights(
        columns: Range<usize>,
        width: usize,
        row: impl FnMut() -> Blended<COLUMNS>,
        needed: impl FnMut(Eight) -> bool,
        tell: impl FnMut(Eight, [Lanes; 3]),
    ) {
        // Where each column of the grid is 8, 4 or 2 pixels, weights are the same in all eights; which is code for nothing where eight numbers are not computed at
        // once.
        match (width / COLUMNS.max(1), width % COLUMNS.max(1)) {
            _ if !VECTORS => Self::each(columns, row, needed, tell, width),
            (8, 0) => Self::each(columns, row, needed, tell, Steady::<8>::new()),
            (4, 0) => Self::each(columns, row, needed, tell, Steady::<4>::new()),
            (2, 0) => Self::each(columns, row, needed, tell, Steady::<2>::new()),
            _ => Self::each(columns, row, needed, tell, width),
        }
    }

    #[inline(always)]
    fn each(
        columns: Range<usize>,
        mut row: impl FnMut() -> Blended<COLUMNS>,
        mut needed: impl FnMut(Eight) -> bool,
        mut tell: impl FnMut(Eight, [Lanes; 3]),
        between: impl Between<COLUMNS>,
    ) {
        let mut blended = None;
        let mut x = columns.start;
        while x < columns.end {
            let first = x - x % LANES;
            let end = (first + LANES).min(columns.end);
            let eight = Eight { first, from: x, end };
            if needed(eight) {
                tell(eight, between.light(blended.get_or_insert_with(&mut row), first));
            }
            x = end;
        }
    }
}

/// Eight pixels of a row, and which of them are asked for.
#[derive(Clone, Copy)]
pub(crate) struct Eight {
    /// The first of the eight, a multiple of eight.
    pub(crate) first: usize,
    /// The first and one past the last that are asked for.
    pub(crate) from: usize,
    pub(crate) end: usize,
}

impl Eight {
    /// Those asked for, from 0 to 8.
    #[inline(always)]
    pub(crate) const fn lanes(self) -> Range<usize> {
        self.from - self.first..self.end - self.first
    }
}

/// How pixels lie between columns of the grid.
trait Between<const COLUMNS: usize> {
    /// The light of the eight pixels from `first` on.
    fn light(&self, row: &Blended<COLUMNS>, first: usize) -> [Lanes; 3];
}

/// Each column of the grid is `EACH` pixels: for each of eight of them, the weights of the column itself and two on either side.
struct Steady<const EACH: usize>([Lanes; 5]);

impl<const EACH: usize> Steady<EACH> {
    fn new() -> Self {
        let weights = |k: usize| {
            Lanes(core::array::from_fn(|i| {
                let at = ((i % EACH) as f32 + 0.5) / EACH as f32;
                let one = |n: usize| if n == k { 1.0 } else { 0.0 };
                // Left of the column's middle, between the one before and it; right of it, between it and the next.
                if at < 0.5 {
                    cubic([one(0), one(1), one(2), one(3)], at + 0.5)
                } else {
                    cubic([one(1), one(2), one(3), one(4)], at - 0.5)
                }
            }))
        };
        Self([weights(0), weights(1), weights(2), weights(3), weights(4)])
    }
}

impl<const EACH: usize, const COLUMNS: usize> Between<COLUMNS> for Steady<EACH> {
    #[inline(always)]
    fn light(&self, row: &Blended<COLUMNS>, first: usize) -> [Lanes; 3] {
        // Up to four columns, and two on either side.
        let column = first / EACH;
        row.0.each_ref().map(|plane| {
            let eight = column.checked_sub(2).and_then(|from| plane.get(from..)?.first_chunk::<LANES>()).copied();
            let eight = eight.unwrap_or_else(|| {
                let from = column + COLUMNS.saturating_sub(2);
                core::array::from_fn(|i| plane.get((from + i) % COLUMNS.max(1)).copied().unwrap_or_default())
            });
            let near = |k: usize| {
                let mut near = Lanes::ZERO;
                for (i, near) in near.0.iter_mut().enumerate() {
                    *near = eight.get(k + i / EACH).copied().unwrap_or_default();
                }
                near
            };
            let [a, b, c, d, e] = self.0;
            (near(0) * a + near(1) * b + near(2) * c + near(3) * d + near(4) * e).max(Lanes::ZERO)
        })
    }
}

/// Any width: pixel by pixel.
impl<const COLUMNS: usize> Between<COLUMNS> for usize {
    #[inline(always)]
    fn light(&self, row: &Blended<COLUMNS>, first: usize) -> [Lanes; 3] {
        let mut light = [Lanes::ZERO; 3];
        let [reds, greens, blues] = &mut light;
        for (x, ((r, g), b)) in (first..).zip(reds.0.iter_mut().zip(&mut greens.0).zip(&mut blues.0)) {
            [*r, *g, *b] = row.at(x, *self);
        }
        light
    }
}

impl<const COLUMNS: usize> Blended<COLUMNS> {
    /// The light of one pixel of a map `width` wide.
    #[inline(always)]
    fn at(&self, x: usize, width: usize) -> [f32; 3] {
        // In columns and two more: the four neighbours begin one before, and it stays above 0.
        let place = (x as f32 + 0.5) * (COLUMNS as f32 / width.max(1) as f32) + 0.5;
        let cell = place as usize;
        let t = place - cell as f32;
        self.0.each_ref().map(|plane| {
            let four = cell.checked_sub(2).and_then(|first| plane.get(first..)?.first_chunk::<4>()).copied();
            let four = four.unwrap_or_else(|| {
                let first = cell + COLUMNS.saturating_sub(2);
                [first, first + 1, first + 2, first + 3]
                    .map(|i| plane.get(i % COLUMNS.max(1)).copied().unwrap_or_default())
            });
            let v = cubic(four, t);
            if v > 0.0 { v } else { 0.0 }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::units::Timestamp;
    use crate::lighting::equirect::direction_of_pixel;
    use crate::lighting::far::{FarField, FarParams};
    use crate::lighting::lattice::Lattice;
    use std::boxed::Box;
    use std::vec;

    #[test]
    fn maps_of_any_size_are_close_to_the_sum() {
        // The hardest: neighbours that differ at random.
        let mut far = FarField::<1280>::new(FarParams::default(), [0.0; 3]);
        for i in 0..1280_u32 {
            let v = i.wrapping_mul(2_654_435_761) >> 8;
            far.sample(Lattice::<1280>::direction(i as usize), [v as f32 / 16_777_216.0; 3], 1.0, Timestamp::ZERO);
        }
        let mut map = Box::new(FarMap::<128, 64>::new());
        map.update(&mut far);
        for (width, height) in [(1, 1), (7, 5), (96, 48), (200, 100), (256, 128)] {
            let mut pixels = vec![[0.0_f32; 3]; width * height];
            map.render(&mut ImageViewMut::new(&mut pixels, width, height).unwrap());
            let mut squares = 0.0_f64;
            for (i, pixel) in pixels.iter().enumerate() {
                let exact = far.sum_all(direction_of_pixel(i % width, i / width, (width, height)));
                squares += f64::from(pixel[0] - exact[0]).powi(2);
            }
            let psnr = -10.0 * libm::log10(squares / (width * height) as f64);
            // Of a handful of pixels, one can be unlucky.
            let least = if width < 90 { 60.0 } else { 66.0 };
            assert!(psnr > least, "{width}x{height}: {psnr} dB");
        }
        let d = direction_of_pixel(30, 50, (97, 60));
        assert!((map.towards(d)[1] - far.sum_all(d)[1]).abs() < 2e-3);
        map.render(&mut ImageViewMut::<[u8; 3]>::new(&mut [], 0, 0).unwrap());
    }
}
