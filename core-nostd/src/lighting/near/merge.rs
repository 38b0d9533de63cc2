//! Layers and levels into the picture (LitAR 4.4.1, multi-resolution projection).
//!
//! The paper projects all points once for each level, scales the levels to the finest and takes the nearest point of each pixel. Levels that divide one
//! another make that one projection and minima: a coarse pixel's nearest point is the nearest of the fine pixels in it. Strip by strip, as high as a
//! coarsest pixel; a point is a layer's cell and, in a slice of its own so that loops over either are vectorised, the view whose layer it is.

use super::project::EMPTY;
use super::{NOWHERE, NearField, seam};
use crate::ground::lanes::{LANES, vectorised};
use crate::lighting::preset::{MOST_LEVELS, Preset};

/// A level's part of a strip.
#[derive(Clone, Copy, Default)]
struct Part {
    /// Where it begins in either half of the scratch.
    start: usize,
    width: usize,
    rows: usize,
}

/// The parts of a strip, finest first.
struct Parts {
    list: [Part; MOST_LEVELS],
    count: usize,
}

impl Parts {
    fn of(preset: &Preset) -> Self {
        let count = preset.levels.iter().take_while(|w| **w > 0).count();
        let coarsest = preset.levels.get(count.saturating_sub(1)).copied().unwrap_or(1).max(1);
        let mut start = 0;
        let list = preset.levels.map(|width| {
            let part = Part { start, width, rows: width / coarsest };
            start += part.width * part.rows;
            part
        });
        Self { list, count }
    }

    fn finest(&self) -> Part {
        self.list.first().copied().unwrap_or_default()
    }

    /// A level and the finer one before it.
    fn pair(&self, level: usize) -> Option<(Part, Part)> {
        Some((*self.list.get(level.checked_sub(1)?)?, *self.list.get(level)?))
    }
}

/// One half of the scratch, cut at two levels.
fn cut(half: &mut [u32], fine: Part, coarse: Part) -> (&mut [u32], &mut [u32]) {
    let (before, after) = half.split_at_mut_checked(coarse.start).unwrap_or_default();
    let coarse = after.get_mut(..coarse.width * coarse.rows).unwrap_or_default();
    (before.get_mut(fine.start..).unwrap_or_default(), coarse)
}

impl NearField<'_> {
    /// Makes the picture from the layers as they are. The rows that may differ from before, first and one past the last.
    pub fn merge(&mut self) -> (usize, usize) {
        let (width, height) = self.preset.finest();
        let parts = Parts::of(&self.preset);
        let rows = parts.finest().rows.max(1);
        let (first, last) = self.spans.iter().fold(NOWHERE, |a, s| (a.0.min(s.0), a.1.max(s.1)));
        // Whole strips around what there is; and what there was must go.
        let strips =
            if first > last { (0, 0) } else { (first / (width * rows).max(1), last / (width * rows).max(1) + 1) };
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
        let bits = self.pixel_bits();
        // No distance is above what is left of a cell's bits: beyond it the margin lets nothing through.
        let farther = 1.0 + self.params.margin;
        for strip in strips.0..strips.1 {
            let points = parts.finest().width * parts.finest().rows;
            self.gather(strip * points, points);
            let half = self.memory.strip.len() / 2;
            let Some((keys, views)) = self.memory.strip.split_at_mut_checked(half) else { continue };
            for (fine, coarse) in (1..parts.count).filter_map(|level| parts.pair(level)) {
                reduce(cut(keys, fine, coarse), cut(views, fine, coarse), fine.width, coarse.width);
            }
            for (fine, coarse) in (1..parts.count).rev().filter_map(|level| parts.pair(level)) {
                resolve(cut(keys, fine, coarse), cut(views, fine, coarse), fine.width, coarse.width, bits, farther);
            }
            self.paint(strip * points, points);
        }
        let picture = self.memory.picture.get_mut(..width * height).unwrap_or_default();
        seam::fade(picture, width, drawn, self.params.seam);
        changed
    }

    /// The nearest of all layers, for some pixels of the finest level.
    fn gather(&mut self, from: usize, points: usize) {
        let half = self.memory.strip.len() / 2;
        let Some((keys, views)) = self.memory.strip.split_at_mut_checked(half) else { return };
        let (keys, views) = (keys.get_mut(..points).unwrap_or_default(), views.get_mut(..points).unwrap_or_default());
        let pixels = self.preset.level_pixels();
        let mut first = true;
        for (slot, span) in self.spans.iter().enumerate() {
            if span.0 >= from + points || span.1 < from {
                continue;
            }
            let layer = self.memory.layers.get(slot * pixels + from..(slot + 1) * pixels).unwrap_or_default();
            if let (true, Some(layer)) = (core::mem::take(&mut first), layer.get(..keys.len())) {
                keys.copy_from_slice(layer);
                views.fill(slot as u32);
                continue;
            }
            vectorised(|| {
                for ((key, view), cell) in keys.iter_mut().zip(views.iter_mut()).zip(layer) {
                    let nearer = *cell < *key;
                    *key = if nearer { *cell } else { *key };
                    *view = if nearer { slot as u32 } else { *view };
                }
            });
        }
        if first {
            keys.fill(EMPTY);
            views.fill(0);
        }
    }

    /// Colours of the finest level's points.
    fn paint(&mut self, from: usize, points: usize) {
        let pixels = self.preset.view_pixels();
        let mask = (1_u32 << self.pixel_bits()) - 1;
        let half = self.memory.strip.len() / 2;
        let (keys, views) = self.memory.strip.split_at_checked(half).unwrap_or_default();
        let picture = self.memory.picture.get_mut(from..).unwrap_or_default();
        // Much of the sphere is empty: eight pixels at a time.
        let (keys, views) = (keys.get(..points).unwrap_or_default(), views.get(..points).unwrap_or_default());
        let colours = &*self.memory.colour;
        for (out, (keys, views)) in picture.chunks_mut(LANES).zip(keys.chunks(LANES).zip(views.chunks(LANES))) {
            if keys.iter().fold(EMPTY, |all, key| all & key) == EMPTY {
                out.fill([0; 4]);
                continue;
            }
            for (out, (key, view)) in out.iter_mut().zip(keys.iter().zip(views)) {
                let at = *view as usize * pixels + (key & mask) as usize;
                *out = match colours.get(at) {
                    Some([r, g, b]) if *key != EMPTY => [*r, *g, *b, 255],
                    _ => [0; 4],
                };
            }
        }
    }
}

/// A level's points from those of the finer one: `keys` and `views` of both, finer first.
fn reduce(keys: (&mut [u32], &mut [u32]), views: (&mut [u32], &mut [u32]), fine: usize, coarse: usize) {
    // Levels of no columns are none; slices are not cut into pieces of nothing.
    let (fine, coarse) = (fine.max(1), coarse.max(1));
    match fine / coarse {
        2 => reduce_by::<2>(keys, views, fine, coarse),
        3 => reduce_by::<3>(keys, views, fine, coarse),
        4 => reduce_by::<4>(keys, views, fine, coarse),
        ratio => {
            let (ratio, (fine_keys, keys), (fine_views, views)) = (ratio.max(1), keys, views);
            let block = (fine * ratio).max(1);
            let blocks = fine_keys.chunks(block).zip(fine_views.chunks(block));
            for ((keys, views), (fine_keys, fine_views)) in
                keys.chunks_mut(coarse).zip(views.chunks_mut(coarse)).zip(blocks)
            {
                keys.fill(EMPTY);
                for (fine_keys, fine_views) in fine_keys.chunks(fine).zip(fine_views.chunks(fine)) {
                    let blocks = fine_keys.chunks(ratio).zip(fine_views.chunks(ratio));
                    for ((key, view), (keys, views)) in keys.iter_mut().zip(views.iter_mut()).zip(blocks) {
                        nearest(key, view, keys, views);
                    }
                }
            }
        }
    }
}

fn reduce_by<const RATIO: usize>(
    (fine_keys, keys): (&mut [u32], &mut [u32]),
    (fine_views, views): (&mut [u32], &mut [u32]),
    fine: usize,
    coarse: usize,
) {
    let (fine, coarse) = (fine.max(1), coarse.max(1));
    let block = (fine * RATIO).max(1);
    let blocks = fine_keys.chunks(block).zip(fine_views.chunks(block));
    for ((keys, views), (fine_keys, fine_views)) in keys.chunks_mut(coarse).zip(views.chunks_mut(coarse)).zip(blocks) {
        keys.fill(EMPTY);
        for (fine_keys, fine_views) in fine_keys.chunks(fine).zip(fine_views.chunks(fine)) {
            let blocks = fine_keys.as_chunks::<RATIO>().0.iter().zip(fine_views.as_chunks::<RATIO>().0);
            for ((key, view), (keys, views)) in keys.iter_mut().zip(views.iter_mut()).zip(blocks) {
                nearest(key, view, keys, views);
            }
        }
    }
}

/// The nearest of some points and the one held; of two as near, the one that is first.
#[inline(always)]
fn nearest(key: &mut u32, view: &mut u32, keys: &[u32], views: &[u32]) {
    for (k, v) in keys.iter().zip(views) {
        let nearer = *k < *key;
        *key = if nearer { *k } else { *key };
        *view = if nearer { *v } else { *view };
    }
}

/// A level's points before the finer level's, where those are none or farther by the margin: `keys` and `views` of both, finer first.
fn resolve(
    keys: (&mut [u32], &mut [u32]),
    views: (&mut [u32], &mut [u32]),
    fine: usize,
    coarse: usize,
    bits: u32,
    farther: f32,
) {
    let (fine, coarse) = (fine.max(1), coarse.max(1));
    let ratio = (fine / coarse).max(1);
    let fine_rows = keys.0.chunks_mut(fine).zip(views.0.chunks_mut(fine));
    for (y, (fine_keys, fine_views)) in fine_rows.enumerate() {
        let row = y / ratio * coarse;
        let (Some(keys), Some(views)) = (keys.1.get(row..row + coarse), views.1.get(row..row + coarse)) else { return };
        match ratio {
            2 => resolve_row::<2>(fine_keys, fine_views, keys, views, bits, farther),
            4 => resolve_row::<4>(fine_keys, fine_views, keys, views, bits, farther),
            _ => {
                let blocks = fine_keys.chunks_mut(ratio).zip(fine_views.chunks_mut(ratio));
                for ((fine_keys, fine_views), (key, view)) in blocks.zip(keys.iter().zip(views)) {
                    put_before(fine_keys, fine_views, *key, *view, bits, farther);
                }
            }
        }
    }
}

fn resolve_row<const RATIO: usize>(
    fine_keys: &mut [u32],
    fine_views: &mut [u32],
    keys: &[u32],
    views: &[u32],
    bits: u32,
    farther: f32,
) {
    let blocks = fine_keys.as_chunks_mut::<RATIO>().0.iter_mut().zip(fine_views.as_chunks_mut::<RATIO>().0);
    for ((fine_keys, fine_views), (key, view)) in blocks.zip(keys.iter().zip(views)) {
        put_before(fine_keys, fine_views, *key, *view, bits, farther);
    }
}

/// A coarse point before the fine ones that are none (none is the largest key) or farther by the margin.
#[inline(always)]
fn put_before(fine_keys: &mut [u32], fine_views: &mut [u32], key: u32, view: u32, bits: u32, farther: f32) {
    if key == EMPTY {
        return;
    }
    // In steps of distance; what is nearer than this stays. Steps are 12 bits and more: that many are exact in `f32` up to 2^24.
    let limit = ((key >> bits) as f32 * farther) as i32 as u32;
    for (fine_key, fine_view) in fine_keys.iter_mut().zip(fine_views) {
        let hidden = *fine_key == EMPTY || *fine_key >> bits > limit;
        *fine_key = if hidden { key } else { *fine_key };
        *fine_view = if hidden { view } else { *fine_view };
    }
}
