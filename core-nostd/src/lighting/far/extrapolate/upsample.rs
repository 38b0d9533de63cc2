//! From the grid to a map of any size: bicubic (Catmull-Rom), closed at the seam and over the poles.

use core::ops::Range;

use super::grid::FarMap;
use crate::ground::colour::Colour;
use crate::ground::image::ImageViewMut;
use crate::ground::lanes::{LANES, Lanes};
use crate::ground::math;

/// A grid row blended for one map row.
pub(crate) struct Blended<const COLUMNS: usize>([[f32; COLUMNS]; 3]);

/// Of four neighbours and 0 <= t < 1 between the middle two: the cubic's coefficients.
#[inline(always)]
fn cubic([a, b, c, d]: [f32; 4]) -> [f32; 4] {
    [b, 0.5 * (c - a), a - 2.5 * b + 2.0 * c - 0.5 * d, 0.5 * (d - a) + 1.5 * (b - c)]
}

impl<const COLUMNS: usize, const ROWS: usize> FarMap<COLUMNS, ROWS> {
    /// Draws the whole map, of any size; a view of no pixels is left alone.
    pub fn render<C: Colour>(&self, out: &mut ImageViewMut<'_, C>) {
        let (width, height) = out.size();
        for y in 0..height {
            let row = self.blended(y, height);
            self.columns(&row, 0..width, width, |x, light| {
                out.set(x, y, C::of_linear(light));
            });
        }
    }

    /// The light from a unit direction in the map's axes.
    #[must_use]
    pub fn towards(&self, direction: glam::Vec3) -> [f32; 3] {
        // The middle of a map as fine as `f32` tells columns apart.
        const FINE: usize = 1 << 16;
        let uv = crate::lighting::equirect::uv_of_direction(direction);
        let Some((x, y)) = crate::lighting::equirect::pixel_of_uv(uv, (FINE, FINE)) else { return [0.0; 3] };
        let mut found = [0.0; 3];
        self.columns(&self.blended(y, FINE), x..x + 1, FINE, |_, light| found = light);
        found
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

    /// Columns of a map `width` wide in runs of at most [`LANES`] that lie between the same two columns of the grid: the first, how many, and
    /// where in the blended row.
    #[inline(always)]
    pub(crate) fn runs(columns: Range<usize>, width: usize, mut tell: impl FnMut(usize, usize, Place)) {
        let step = COLUMNS as f32 / width.max(1) as f32;
        let each = width as f32 / COLUMNS.max(1) as f32;
        let mut x = columns.start;
        // In columns and two more: the four neighbours begin one before, and it stays above 0. Of `x` alone, so that a pixel is the same to the bit
        // whichever run it is in.
        let place = |x: usize| (x as f32 + 0.5) * step + 0.5;
        while x < columns.end {
            let cell = place(x) as usize;
            // As many as stay below the next column: eight or fewer.
            let next = (cell + 1) as f32;
            let most = LANES.min(columns.end - x);
            let mut n = (((next - place(x)) * each) as usize + 1).min(most);
            while n > 1 && place(x + n - 1) >= next {
                n -= 1;
            }
            while n < most && place(x + n) < next {
                n += 1;
            }
            tell(x, n, Place { cell, first: x as f32 + 0.5, step });
            x += n;
        }
    }

    /// A row's light at some columns of a map `width` wide, told in order.
    #[inline(always)]
    pub(crate) fn columns(
        &self,
        row: &Blended<COLUMNS>,
        columns: Range<usize>,
        width: usize,
        mut tell: impl FnMut(usize, [f32; 3]),
    ) {
        Self::runs(columns, width, |x, n, place| {
            let [r, g, b] = row.light(place);
            for (i, ((r, g), b)) in r.0.iter().zip(g.0).zip(b.0).take(n).enumerate() {
                tell(x + i, [*r, g, b]);
            }
        });
    }
}

/// Where some map pixels lie in a blended row.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// First of the four columns, and two more.
    cell: usize,
    /// The first pixel's middle.
    first: f32,
    /// From pixel to pixel.
    step: f32,
}

impl<const COLUMNS: usize> Blended<COLUMNS> {
    /// Four columns from the one two before `cell`, around the seam.
    #[inline(always)]
    fn four(plane: &[f32; COLUMNS], cell: usize) -> [f32; 4] {
        if let Some(four) = cell.checked_sub(2).and_then(|first| plane.get(first..)?.first_chunk()) {
            return *four;
        }
        let first = cell + COLUMNS.saturating_sub(2);
        [first, first + 1, first + 2, first + 3].map(|i| plane.get(i % COLUMNS.max(1)).copied().unwrap_or_default())
    }

    /// The light of eight pixels from a place on: red, green, blue.
    #[inline(always)]
    pub(crate) fn light(&self, place: Place) -> [Lanes; 3] {
        let t = ((Lanes::splat(place.first) + Lanes::index()) * place.step + Lanes::splat(0.5))
            - Lanes::splat(place.cell as f32);
        let mut out = [Lanes::ZERO; 3];
        for (out, plane) in out.iter_mut().zip(&self.0) {
            let [a, b, c, d] = cubic(Self::four(plane, place.cell)).map(Lanes::splat);
            *out = (a + t * (b + t * (c + t * d))).max(Lanes::ZERO);
        }
        out
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
