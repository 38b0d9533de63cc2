//! Layers and levels into the picture (LitAR 4.4.1, multi-resolution projection).
//!
//! The paper projects all points once for each level, scales the levels to the finest and takes the nearest point of each pixel. Levels that divide one another
//! make that one projection and minima: a coarse pixel's nearest point is the nearest of the fine pixels in it. Strip by strip, as high as a coarsest pixel.

use super::{NOWHERE, NearField, project, seam};
use crate::lighting::preset::MOST_LEVELS;

/// The nearest point of a pixel: a layer's cell, and the view whose layer it is.
type Point = (u32, u8);
const NONE: Point = (project::EMPTY, 0);

/// A level's part of a strip.
#[derive(Clone, Copy, Default)]
struct Part {
    /// Where it begins in the scratch.
    start: usize,
    width: usize,
    rows: usize,
}

impl NearField<'_> {
    /// Makes the picture from the layers as they are. The rows that may differ from before, first and one past the last.
    pub fn merge(&mut self) -> (usize, usize) {
        let (width, height) = self.preset.finest();
        let (parts, count) = self.parts();
        let rows = parts.first().map_or(0, |p| p.rows).max(1);
        let (first, last) = self.spans.iter().fold(NOWHERE, |a, s| (a.0.min(s.0), a.1.max(s.1)));
        // Whole strips around what there is; and what there was must go.
        let strips = if first > last { (0, 0) } else { (first / width / rows, last / width / rows + 1) };
        let drawn = (strips.0 * rows, (strips.1 * rows).min(height));
        let before = core::mem::replace(&mut self.drawn, drawn);
        let changed = match (before.0 < before.1, drawn.0 < drawn.1) {
            (true, true) => (before.0.min(drawn.0), before.1.max(drawn.1)),
            (true, false) => before,
            _ => drawn,
        };
        for y in (changed.0..drawn.0.min(changed.1)).chain(drawn.1.max(changed.0)..changed.1) {
            if let Some(row) = self.memory.picture.get_mut(y * width..(y + 1) * width) {
                row.fill([0; 4]);
            }
        }
        for strip in strips.0..strips.1 {
            self.gather(strip, &parts, width);
            for level in 1..count {
                self.reduce(&parts, level);
            }
            for level in (1..count).rev() {
                self.resolve(&parts, level);
            }
            self.paint(strip, &parts, width);
        }
        let picture = self.memory.picture.get_mut(..width * height).unwrap_or_default();
        seam::fade(picture, width, drawn, self.params.seam);
        changed
    }

    fn parts(&self) -> ([Part; MOST_LEVELS], usize) {
        let levels = self.preset.levels;
        let count = levels.iter().take_while(|w| **w > 0).count();
        let coarsest = levels.get(count.saturating_sub(1)).copied().unwrap_or(1).max(1);
        let mut start = 0;
        let parts = levels.map(|width| {
            let part = Part { start, width, rows: width / coarsest };
            start += part.width * part.rows;
            part
        });
        (parts, count)
    }

    /// The nearest of all layers, for the finest level's part of a strip.
    fn gather(&mut self, strip: usize, parts: &[Part; MOST_LEVELS], width: usize) {
        let [finest, ..] = *parts;
        let n = finest.width * finest.rows;
        let Some(points) = self.memory.strip.get_mut(..n) else { return };
        points.fill(NONE);
        let (from, pixels) = (strip * n, self.preset.level_pixels());
        let _ = width;
        for (slot, span) in self.spans.iter().enumerate() {
            if span.0 >= from + n || span.1 < from {
                continue;
            }
            let cells = self.memory.layers.get(slot * pixels..(slot + 1) * pixels).unwrap_or_default();
            for (point, cell) in points.iter_mut().zip(cells.get(from..).unwrap_or_default()) {
                if *cell < point.0 {
                    *point = (*cell, slot as u8);
                }
            }
        }
    }

    /// A level's pixels from those of the finer one.
    fn reduce(&mut self, parts: &[Part; MOST_LEVELS], level: usize) {
        let Some((&[fine, coarse], scratch)) =
            parts.get(level - 1..).and_then(|p| p.first_chunk()).zip(Some(&mut *self.memory.strip))
        else {
            return;
        };
        let Some((fine_points, rest)) =
            scratch.get_mut(fine.start..).and_then(|s| s.split_at_mut_checked(coarse.start - fine.start))
        else {
            return;
        };
        let ratio = fine.width / coarse.width;
        let coarse_rows = rest.chunks_mut(coarse.width).take(coarse.rows);
        for (row, fine_rows) in coarse_rows.zip(fine_points.chunks(fine.width * ratio)) {
            row.fill(NONE);
            for fine_row in fine_rows.chunks(fine.width) {
                for (point, block) in row.iter_mut().zip(fine_row.chunks(ratio)) {
                    for p in block {
                        if p.0 < point.0 {
                            *point = *p;
                        }
                    }
                }
            }
        }
    }

    /// A level's points before the finer level's, where those are none or farther by the margin.
    fn resolve(&mut self, parts: &[Part; MOST_LEVELS], level: usize) {
        let Some((&[fine, coarse], scratch)) =
            parts.get(level - 1..).and_then(|p| p.first_chunk()).zip(Some(&mut *self.memory.strip))
        else {
            return;
        };
        let Some((fine_points, rest)) =
            scratch.get_mut(fine.start..).and_then(|s| s.split_at_mut_checked(coarse.start - fine.start))
        else {
            return;
        };
        let bits = usize::BITS - (self.preset.view_pixels() - 1).leading_zeros();
        let farther = 1.0 + self.params.margin;
        let ratio = fine.width / coarse.width;
        let fine_rows = fine_points.chunks_mut(fine.width * ratio).take(coarse.rows);
        for (fine_rows, row) in fine_rows.zip(rest.chunks(coarse.width)) {
            for fine_row in fine_rows.chunks_mut(fine.width) {
                for (block, above) in fine_row.chunks_mut(ratio).zip(row) {
                    if above.0 == project::EMPTY {
                        continue;
                    }
                    // In steps of distance; what is nearer than this stays.
                    let limit = ((above.0 >> bits) as f32 * farther) as u32;
                    for point in block {
                        if point.0 == project::EMPTY || point.0 >> bits > limit {
                            *point = *above;
                        }
                    }
                }
            }
        }
    }

    /// Colours of the finest level's points.
    fn paint(&mut self, strip: usize, parts: &[Part; MOST_LEVELS], width: usize) {
        let [finest, ..] = *parts;
        let (n, pixels) = (finest.width * finest.rows, self.preset.view_pixels());
        let mask = (1_u32 << (usize::BITS - (pixels - 1).leading_zeros())) - 1;
        let points = self.memory.strip.get(..n).unwrap_or_default();
        let _ = width;
        let picture = self.memory.picture.get_mut(strip * n..).unwrap_or_default();
        for (out, (cell, slot)) in picture.iter_mut().zip(points) {
            *out = if *cell == project::EMPTY {
                [0; 4]
            } else {
                let at = usize::from(*slot) * pixels + (cell & mask) as usize;
                let [r, g, b] = self.memory.colour.get(at).copied().unwrap_or_default();
                [r, g, b, 255]
            };
        }
    }
}
