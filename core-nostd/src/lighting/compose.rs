//! Near over far: the environment map (LitAR 4.4), and of it only what changed.
//!
//! The near field's picture lies over the far field's map by its coverage, in linear light. Where the picture's finest level has another size
//! than the map, a map pixel is the mean of the picture's pixels under it, so levels finer than the map smooth edges.

use core::cell::Cell;
use core::ops::Range;

use super::far::extrapolate::{Eight, FarMap, put};
use super::near::NearField;
use crate::ground::colour::Colour;
use crate::ground::image::{ImageView, ImageViewMut};
use crate::ground::lanes::LANES;

/// What a drawing of the map did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ComposeReport {
    /// Map pixels written.
    pub written: usize,
    /// Map pixels that could not have changed.
    pub skipped: usize,
}

/// Draws the whole map.
pub fn compose<C: Colour, const COLUMNS: usize, const ROWS: usize>(
    near: &NearField<'_>,
    far: &FarMap<COLUMNS, ROWS>,
    out: &mut ImageViewMut<'_, C>,
) -> ComposeReport {
    let (width, height) = out.size();
    let over = Over::new(near.picture(), (width, height));
    for y in 0..height {
        over.draw(far, y, 0..width, out);
    }
    ComposeReport { written: width * height, skipped: 0 }
}

/// Draws what changed: all of the picture's rows `rows` (of [`NearField::merge`]), elsewhere the blocks that the far map computed anew since
/// [`FarMap::settle`].
pub fn compose_changes<C: Colour, const COLUMNS: usize, const ROWS: usize>(
    near: &NearField<'_>,
    rows: (usize, usize),
    far: &FarMap<COLUMNS, ROWS>,
    out: &mut ImageViewMut<'_, C>,
) -> ComposeReport {
    let (width, height) = out.size();
    let over = Over::new(near.picture(), (width, height));
    let mut report = ComposeReport::default();
    for y in 0..height {
        let changed = over.rows_under(y);
        if changed.0 < rows.1 && rows.0 < changed.1 {
            over.draw(far, y, 0..width, out);
            report.written += width;
            continue;
        }
        let mut written = 0;
        far.changed_columns(y, (width, height), |columns| {
            written += columns.len();
            over.draw(far, y, columns, out);
        });
        report.written += written;
        report.skipped += width.saturating_sub(written);
    }
    report
}

/// The picture, laid over a map of another size.
struct Over<'a> {
    picture: ImageView<'a, [u8; 4]>,
    map: (usize, usize),
    /// Picture pixels read for a map pixel, along each side.
    taps: usize,
    /// Picture columns per half a tap, times 2^32.
    across: u64,
}

/// Picture pixels read for a map pixel, along each side, at most.
const MOST_TAPS: usize = 4;

impl<'a> Over<'a> {
    fn new(picture: ImageView<'a, [u8; 4]>, map: (usize, usize)) -> Self {
        let taps = picture.width().div_ceil(map.0.max(1)).clamp(1, MOST_TAPS);
        let across = ((picture.width() as u64) << 32) / (2 * taps * map.0).max(1) as u64;
        Self { picture, map, taps, across }
    }

    /// Picture rows that a map row reads: first, one past the last.
    fn rows_under(&self, y: usize) -> (usize, usize) {
        (self.row_of(y, 0), self.row_of(y, self.taps - 1) + 1)
    }

    /// The picture row that a map row's tap reads.
    fn row_of(&self, y: usize, tap: usize) -> usize {
        ((y * self.taps + tap) * 2 + 1) * self.picture.height() / (2 * self.taps * self.map.1).max(1)
    }

    #[inline(always)]
    fn draw<C: Colour, const COLUMNS: usize, const ROWS: usize>(
        &self,
        far: &FarMap<COLUMNS, ROWS>,
        y: usize,
        columns: Range<usize>,
        out: &mut ImageViewMut<'_, C>,
    ) {
        let width = self.map.0;
        let Some(to) = out.row_mut(y).get_mut(columns.clone()) else { return };
        // Eight pixels at a time: at once where nothing shines through.
        let (start, to) = (columns.start, Cell::from_mut(to).as_slice_of_cells());
        let behind = || far.blended(y, self.map.1);
        if self.taps == 1 && self.picture.width() == width {
            let picture = self.picture.row(self.row_of(y, 0));
            let over = Cell::new([[0; 4]; LANES]);
            let needed = |eight: Eight| {
                let from = picture.get(eight.first..).unwrap_or_default();
                let mut pixels = [[0; 4]; LANES];
                match from.first_chunk() {
                    Some(eight) => pixels = *eight,
                    None => pixels.iter_mut().zip(from).for_each(|(to, from)| *to = *from),
                }
                over.set(pixels);
                let shines = pixels.iter().fold(255, |all, p| all & p[3]) != 255;
                if !shines {
                    put(to, start, eight, pixels.map(|[r, g, b, _]| C::of_srgb([r, g, b])));
                }
                shines
            };
            FarMap::<COLUMNS, ROWS>::eights(columns, width, behind, needed, |eight, [r, g, b]| {
                let mut lit = [[0.0; 3]; LANES];
                let light = r.0.iter().zip(&g.0).zip(&b.0);
                for ((lit, over), ((r, g), b)) in lit.iter_mut().zip(over.get()).zip(light) {
                    *lit = lay(over, [*r, *g, *b]);
                }
                put(to, start, eight, lit.map(C::of_linear));
            });
            return;
        }
        let mut rows: [&[[u8; 4]]; MOST_TAPS] = [&[]; MOST_TAPS];
        for (tap, row) in rows.iter_mut().enumerate().take(self.taps) {
            *row = self.picture.row(self.row_of(y, tap));
        }
        let rows = rows.get(..self.taps).unwrap_or_default();
        let norm = 1.0 / (255 * self.taps * self.taps) as f32;
        let over = Cell::new([[0.0_f32; 4]; LANES]);
        let needed = |eight: Eight| {
            let mut pixels = [[0.0_f32; 4]; LANES];
            for (x, pixel) in (eight.first..).zip(&mut pixels) {
                *pixel = self.under(rows, x, norm);
            }
            over.set(pixels);
            let shines = pixels.iter().any(|p| p[3] < 1.0 - 1e-6);
            if !shines {
                put(to, start, eight, pixels.map(|[r, g, b, _]| C::of_linear([r, g, b])));
            }
            shines
        };
        FarMap::<COLUMNS, ROWS>::eights(columns, width, behind, needed, |eight, [fr, fg, fb]| {
            let mut lit = [[0.0; 3]; LANES];
            let light = fr.0.iter().zip(&fg.0).zip(&fb.0);
            for ((lit, [r, g, b, cover]), ((fr, fg), fb)) in lit.iter_mut().zip(over.get()).zip(light) {
                let rest = 1.0 - cover;
                *lit = [r + rest * fr, g + rest * fg, b + rest * fb];
            }
            put(to, start, eight, lit.map(C::of_linear));
        });
    }

    /// The picture's mean light under a map pixel, times its coverage, and the coverage, 0 to 1.
    #[inline(always)]
    fn under(&self, rows: &[&[[u8; 4]]], x: usize, norm: f32) -> [f32; 4] {
        let mut sum = [0.0_f32; 4];
        for tap in 0..self.taps {
            // The tap's middle, in picture columns: 32 bits of fraction.
            let column = ((((x * self.taps + tap) * 2 + 1) as u64 * self.across) >> 32) as usize;
            for row in rows {
                let [r, g, b, a] = row.get(column).copied().unwrap_or_default();
                if a == 0 {
                    continue;
                }
                let part = f32::from(a) * norm;
                let [r, g, b] = [r, g, b].linear();
                for (sum, v) in sum.iter_mut().zip([r, g, b, 1.0]) {
                    *sum += part * v;
                }
            }
        }
        sum
    }
}

/// One pixel over the light from afar.
#[inline(always)]
pub(super) fn lay([r, g, b, a]: [u8; 4], [fr, fg, fb]: [f32; 3]) -> [f32; 3] {
    match a {
        0 => [fr, fg, fb],
        255 => [r, g, b].linear(),
        _ => {
            let part = f32::from(a) * (1.0 / 255.0);
            let [r, g, b] = [r, g, b].linear();
            [fr + part * (r - fr), fg + part * (g - fg), fb + part * (b - fb)]
        }
    }
}
