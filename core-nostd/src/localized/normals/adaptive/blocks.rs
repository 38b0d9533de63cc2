//! Step 1: a plane of inverse depth for every block, and whether the noise explains what is left.

use super::Context;
use crate::localized::normals::exact::{HOLE, inverse};
use crate::sensing::depth::DepthSample;

/// Sums kept per column while a row of blocks is read, and the block's reference value.
pub(super) const COLUMN_SUMS: usize = 7;
/// Numbers kept per block.
pub(super) const BLOCK_FIELDS: usize = 10;

/// One row of blocks, with an empty block at either end. Coordinates are relative to the block's middle.
///
/// The moments of inverse depth are not kept: least squares makes the residual orthogonal to 1, x and y, so they follow
/// from the plane and the moments of position.
pub(super) struct BlockRow<'a> {
    /// Readings; 0 for a block that is empty or holds an edge.
    pub(super) n: &'a mut [f32],
    pub(super) x: &'a mut [f32],
    pub(super) y: &'a mut [f32],
    pub(super) xx: &'a mut [f32],
    pub(super) xy: &'a mut [f32],
    pub(super) yy: &'a mut [f32],
    /// The plane: value in the middle, slopes.
    pub(super) c: &'a mut [f32],
    pub(super) a: &'a mut [f32],
    pub(super) b: &'a mut [f32],
    /// Variance of the block's mean: noise variance over n.
    pub(super) q: &'a mut [f32],
}

impl<'a> BlockRow<'a> {
    pub(super) fn new(storage: &'a mut [f32], cells: usize) -> Self {
        let mut parts = storage.chunks_mut(cells.max(1));
        let mut next = || parts.next().unwrap_or_default();
        Self {
            n: next(),
            x: next(),
            y: next(),
            xx: next(),
            xy: next(),
            yy: next(),
            c: next(),
            a: next(),
            b: next(),
            q: next(),
        }
    }

    pub(super) fn clear(&mut self) {
        for field in [
            &mut self.n,
            &mut self.x,
            &mut self.y,
            &mut self.xx,
            &mut self.xy,
            &mut self.yy,
            &mut self.c,
            &mut self.a,
            &mut self.b,
            &mut self.q,
        ] {
            field.fill(0.0);
        }
    }

    fn set(&mut self, i: usize, v: [f32; BLOCK_FIELDS]) {
        let fields: [&mut [f32]; BLOCK_FIELDS] =
            [self.n, self.x, self.y, self.xx, self.xy, self.yy, self.c, self.a, self.b, self.q];
        for (field, value) in fields.into_iter().zip(v) {
            if let Some(cell) = field.get_mut(i) {
                *cell = value;
            }
        }
    }
}

/// Reads image row `y` as inverse depth into `line`; pixels outside the image are holes.
pub(super) fn read_line<D: DepthSample>(context: &Context<'_, '_, D>, y: usize, line: &mut [f32]) {
    let source = context.frame.depth().row(y);
    let (inside, outside) = line.split_at_mut_checked(source.len()).unwrap_or_default();
    for (w, &value) in inside.iter_mut().zip(source) {
        *w = inverse(value);
    }
    outside.fill(HOLE);
}

/// Sums the `row`th row of blocks and fits each.
pub(super) fn fill<D: DepthSample, const B: usize>(
    context: &Context<'_, '_, D>,
    row: usize,
    line: &mut [f32],
    sums: &mut [f32],
    out: &mut BlockRow<'_>,
) {
    sums.fill(0.0);
    let width = line.len();
    let mut parts = sums.chunks_mut(width.max(1));
    let mut part = || parts.next().unwrap_or_default();
    let (reference, n, y, yy, w, yw, ww) = (part(), part(), part(), part(), part(), part(), part());
    set_references::<D, B>(context, row, reference);
    for j in 0..B {
        read_line(context, row * B + j, line);
        let dy = j as f32 - (B as f32 - 1.0) / 2.0;
        let dyy = dy * dy;
        let cells =
            n.iter_mut().zip(y.iter_mut()).zip(yy.iter_mut()).zip(w.iter_mut()).zip(yw.iter_mut()).zip(ww.iter_mut());
        for ((((((n, y), yy), w), yw), ww), (&value, &reference)) in cells.zip(line.iter().zip(reference.iter())) {
            let real = value < 1e20;
            let one = if real { 1.0 } else { 0.0 };
            let d = if real { value - reference } else { 0.0 };
            *n += one;
            *y += one * dy;
            *yy += one * dyy;
            *w += d;
            *yw += d * dy;
            *ww += d * d;
        }
    }
    let columns = n.as_chunks::<B>().0.iter().zip(y.as_chunks::<B>().0).zip(yy.as_chunks::<B>().0);
    let columns = columns.zip(w.as_chunks::<B>().0).zip(yw.as_chunks::<B>().0).zip(ww.as_chunks::<B>().0);
    for (i, ((((((n, y), yy), w), yw), ww), reference)) in columns.zip(reference.as_chunks::<B>().0).enumerate() {
        let block = fit::<D, B>(context, [n, y, yy, w, yw, ww], reference.first().copied().unwrap_or(0.0));
        out.set(i + 1, block.unwrap_or([0.0; BLOCK_FIELDS]));
    }
}

/// A value near each block's inverse depths, subtracted before summing so that squares keep their digits: the middle
/// pixel's, or any reading's.
fn set_references<D: DepthSample, const B: usize>(context: &Context<'_, '_, D>, row: usize, reference: &mut [f32]) {
    let depth = context.frame.depth();
    for (i, cell) in reference.as_chunks_mut::<B>().0.iter_mut().enumerate() {
        let middle = depth.get(i * B + B / 2, row * B + B / 2).filter(|v| v.is_valid());
        let any = || depth.crop(i * B, row * B, B, B).rows().flatten().copied().find(|v| v.is_valid());
        *cell = [middle.or_else(any).map_or(0.0, inverse); B];
    }
}

/// The plane of one block from its column sums; `None` when readings are few or the residual is more than noise.
fn fit<D: DepthSample, const B: usize>(
    context: &Context<'_, '_, D>,
    [n, y, yy, w, yw, ww]: [&[f32; B]; 6],
    reference: f32,
) -> Option<[f32; BLOCK_FIELDS]> {
    let dx: [f32; B] = core::array::from_fn(|i| i as f32 - (B as f32 - 1.0) / 2.0);
    let total = |v: &[f32; B]| v.iter().sum::<f32>();
    let moment = |v: &[f32; B]| v.iter().zip(dx).map(|(v, dx)| v * dx).sum::<f32>();
    let count = total(n);
    if count < 0.3 * (B * B) as f32 {
        return None;
    }
    let (sx, sy) = (moment(n), total(y));
    let sxx = n.iter().zip(dx).map(|(n, dx)| n * dx * dx).sum::<f32>();
    let (sxy, syy) = (moment(y), total(yy));
    let (sw, sxw, syw, sww) = (total(w), moment(w), total(yw), total(ww));
    let inv = 1.0 / count;
    let (mx, my, mw) = (sx * inv, sy * inv, sw * inv);
    let (xx, xy, yy) = (sxx - sx * mx, sxy - sx * my, syy - sy * my);
    let (xw, yw, ww) = (sxw - sx * mw, syw - sy * mw, sww - sw * mw);
    let det = xx * yy - xy * xy;
    // Pixels on one line have no plane; this far from square (a tenth) one direction is hardly held.
    if det < 0.01 * (count * count) * ((B * B) as f32 / 12.0) * ((B * B) as f32 / 12.0) * 0.1 {
        return None;
    }
    let a = (xw * yy - yw * xy) / det;
    let b = (yw * xx - xw * xy) / det;
    let residual = ww - a * xw - b * yw;
    let variance = context.variance(reference + mw);
    let freedom = count - 3.0;
    // Three standard deviations of chi-square: mean f, variance 2 f.
    let slack = 3.0 * crate::ground::math::sqrt(2.0 * freedom);
    if residual > variance * (freedom + slack) {
        return None;
    }
    let c = reference + mw - a * mx - b * my;
    Some([count, sx, sy, sxx, sxy, syy, c, a, b, variance * inv])
}
