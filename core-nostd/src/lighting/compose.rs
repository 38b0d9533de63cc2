//! Near over far: the environment map (LitAR 4.4), and of it only what changed.
//!
//! The near field's picture lies over the far field's map by its coverage, in linear light. Where the picture's finest level has another size
//! than the map, a map pixel is the mean of the picture's pixels under it, so levels finer than the map smooth edges.

use super::far::extrapolate::FarMap;
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
        columns: core::ops::Range<usize>,
        out: &mut ImageViewMut<'_, C>,
    ) {
        let width = self.map.0;
        let Some(to) = out.row_mut(y).get_mut(columns.clone()) else { return };
        if self.taps == 1 && self.picture.width() == width {
            let over = self.picture.row(self.row_of(y, 0)).get(columns.clone()).unwrap_or_default();
            // Where nothing shines through, what is behind need not be known.
            let mut blended = None;
            let mut x = 0;
            while x < over.len() {
                let whole = over.iter().skip(x).take_while(|p| p[3] == 255).count();
                let (Some(now), Some(from)) = (to.get_mut(x..x + whole), over.get(x..x + whole)) else { break };
                for (to, [r, g, b, _]) in now.iter_mut().zip(from) {
                    *to = C::of_linear([*r, *g, *b].linear());
                }
                x += whole;
                let rest = over.iter().skip(x).take_while(|p| p[3] != 255).count();
                if rest == 0 {
                    break;
                }
                let blended = blended.get_or_insert_with(|| far.blended(y, self.map.1));
                let mut pixels = to.iter_mut().zip(over).skip(x).take(rest);
                far.columns(blended, columns.start + x..columns.start + x + rest, width, |_, light| {
                    if let Some((to, over)) = pixels.next() {
                        *to = C::of_linear(lay(*over, light));
                    }
                });
                x += rest;
            }
            return;
        }
        // Eight pixels at a time: what of the picture lies over them, and, unless that is all, what is behind.
        let mut rows: [&[[u8; 4]]; MOST_TAPS] = [&[]; MOST_TAPS];
        for (tap, row) in rows.iter_mut().enumerate().take(self.taps) {
            *row = self.picture.row(self.row_of(y, tap));
        }
        let rows = rows.get(..self.taps).unwrap_or_default();
        let whole = 255.0 * (self.taps * self.taps) as f32;
        let mut blended = None;
        for (block, to) in to.chunks_mut(LANES).enumerate() {
            let first = columns.start + block * LANES;
            let mut over = [([0.0_f32; 3], 0.0_f32); LANES];
            for (x, over) in (first..).zip(over.iter_mut().take(to.len())) {
                *over = self.under(rows, x);
            }
            let over = over.get(..to.len()).unwrap_or_default();
            let mut pixels = to.iter_mut().zip(over);
            if over.iter().all(|(_, cover)| *cover >= whole) {
                for (to, (sum, _)) in pixels {
                    *to = C::of_linear(sum.map(|v| v * (1.0 / whole)));
                }
                continue;
            }
            let blended = blended.get_or_insert_with(|| far.blended(y, self.map.1));
            far.columns(blended, first..first + over.len(), width, |_, light| {
                let Some((to, (sum, cover))) = pixels.next() else { return };
                let rest = 1.0 - cover * (1.0 / whole);
                let mut mixed = light;
                for (mixed, sum) in mixed.iter_mut().zip(sum) {
                    *mixed = sum * (1.0 / whole) + rest * *mixed;
                }
                *to = C::of_linear(mixed);
            });
        }
    }

    /// The picture's light under a map pixel, times its coverage, and the coverage: sums over the taps.
    #[inline(always)]
    fn under(&self, rows: &[&[[u8; 4]]], x: usize) -> ([f32; 3], f32) {
        let (mut sum, mut cover) = ([0.0_f32; 3], 0.0_f32);
        for tap in 0..self.taps {
            // The tap's middle, in picture columns: 32 bits of fraction.
            let column = ((((x * self.taps + tap) * 2 + 1) as u64 * self.across) >> 32) as usize;
            for row in rows {
                let [r, g, b, a] = row.get(column).copied().unwrap_or_default();
                let a = f32::from(a);
                cover += a;
                for (sum, v) in sum.iter_mut().zip([r, g, b].linear()) {
                    *sum += a * v;
                }
            }
        }
        (sum, cover)
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
