//! Step 1: a plane of inverse depth for every block, and whether the noise explains what is left.

use super::Context;
use crate::ground::lanes::{LANES, Lanes, VECTORS};
use crate::localized::normals::exact::{HOLE, REAL, inverse};
use crate::sensing::depth::DepthSample;

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
        for field in self.fields() {
            field.fill(0.0);
        }
    }

    fn fields(&mut self) -> [&mut [f32]; BLOCK_FIELDS] {
        [self.n, self.x, self.y, self.xx, self.xy, self.yy, self.c, self.a, self.b, self.q]
    }

    /// Adds to one block's raw sums.
    fn add(&mut self, i: usize, v: [f32; BLOCK_FIELDS]) {
        for (field, value) in self.fields().into_iter().zip(v) {
            if let Some(cell) = field.get_mut(i) {
                *cell += value;
            }
        }
    }

    /// Eight blocks from `start`, field by field.
    #[inline(always)]
    pub(super) fn lanes(&self, start: usize) -> [Lanes; BLOCK_FIELDS] {
        [
            Lanes::load(self.n, start),
            Lanes::load(self.x, start),
            Lanes::load(self.y, start),
            Lanes::load(self.xx, start),
            Lanes::load(self.xy, start),
            Lanes::load(self.yy, start),
            Lanes::load(self.c, start),
            Lanes::load(self.a, start),
            Lanes::load(self.b, start),
            Lanes::load(self.q, start),
        ]
    }
}

/// Sums the `row`th row of blocks and fits each.
pub(super) fn fill<D: DepthSample, const B: usize>(
    context: &Context<'_, '_, D>,
    row: usize,
    references: &mut [f32],
    out: &mut BlockRow<'_>,
) {
    out.clear();
    let depth = context.frame.depth();
    let rows: [&[D]; B] = core::array::from_fn(|j| depth.row(row * B + j));
    let half = (B as f32 - 1.0) / 2.0;
    set_references::<D, B>(context, row, references);
    for first in (0..context.width).step_by(LANES) {
        // Eight columns: two blocks, one, or half of one.
        let reference: [f32; LANES] =
            core::array::from_fn(|i| references.get((first + i) / B + 1).copied().unwrap_or(0.0));
        let reference = Lanes(reference);
        let [mut w, mut yw, mut ww, mut worst] = [Lanes::ZERO; 4];
        for (j, line) in rows.iter().enumerate() {
            let dy = j as i32 as f32 - half;
            let value = read(line, first);
            worst = worst.max(value);
            let d = value - reference;
            w += d;
            yw += d * dy;
            ww += d * d;
        }
        if worst.below(Lanes::splat(REAL)).all() {
            // Without holes the moments of position are known.
            let n = Lanes::splat(B as f32);
            let yy = Lanes::splat((B * (B * B - 1)) as f32 / 12.0);
            add_columns::<B>(out, first, [n, Lanes::ZERO, yy, w, yw, ww]);
            continue;
        }
        let [mut n, mut y, mut yy, mut w, mut yw, mut ww] = [Lanes::ZERO; 6];
        for (j, line) in rows.iter().enumerate() {
            let dy = j as i32 as f32 - half;
            let value = read(line, first);
            let real = value.below(Lanes::splat(REAL));
            let d = (value - reference) * real;
            n += real;
            y += real * dy;
            yy += real * (dy * dy);
            w += d;
            yw += d * dy;
            ww += d * d;
        }
        add_columns::<B>(out, first, [n, y, yy, w, yw, ww]);
    }
    for start in (1..=context.across).step_by(LANES) {
        let reference = Lanes::load(references, start);
        if VECTORS { solve(B, context, out, start, reference) } else { solve_apart(B, context, out, start, reference) }
    }
}

/// Eight inverse depths of a line from column `first`; holes beyond its end.
#[inline(always)]
pub(super) fn read<D: DepthSample>(line: &[D], first: usize) -> Lanes {
    let rest = line.get(first..).unwrap_or(&[]);
    let mut out = [HOLE; LANES];
    match rest.first_chunk::<LANES>() {
        // The same loop twice: of known length here, which the compiler turns into vectors.
        Some(values) => out.iter_mut().zip(values).for_each(|(w, &value)| *w = inverse(value)),
        None => out.iter_mut().zip(rest).for_each(|(w, &value)| *w = inverse(value)),
    }
    Lanes(out)
}

/// Offsets of eight columns from the middles of their blocks; `first` is a multiple of eight.
#[inline(always)]
pub(super) fn offsets<const B: usize>(first: usize) -> Lanes {
    let half = (B as f32 - 1.0) / 2.0;
    let within = Lanes(core::array::from_fn(|i| if B < LANES { (i % B) as f32 } else { i as f32 }));
    within + Lanes::splat(if B > LANES { (first % B) as f32 } else { 0.0 } - half)
}

/// Adds the sums of eight columns to their blocks: n, x, y, xx, xy, yy, w, xw, yw, ww.
#[inline(always)]
fn add_columns<const B: usize>(out: &mut BlockRow<'_>, first: usize, [n, y, yy, w, yw, ww]: [Lanes; 6]) {
    let dx = offsets::<B>(first);
    let nx = n * dx;
    let sums = [n, nx, y, nx * dx, y * dx, yy, w, w * dx, yw, ww];
    if B >= LANES {
        out.add(first / B + 1, sums.map(Lanes::sum));
    } else {
        // Two blocks of four.
        let block = first / B + 1;
        out.add(block, sums.map(|Lanes([a, b, c, d, ..])| (a + b) + (c + d)));
        out.add(block + 1, sums.map(|Lanes([.., a, b, c, d])| (a + b) + (c + d)));
    }
}

/// A value near each block's inverse depths, subtracted before summing so that squares keep their digits: the middle
/// pixel's, or any reading's.
fn set_references<D: DepthSample, const B: usize>(context: &Context<'_, '_, D>, row: usize, references: &mut [f32]) {
    let depth = context.frame.depth();
    for (i, cell) in references.iter_mut().skip(1).take(context.across).enumerate() {
        let middle = depth.get(i * B + B / 2, row * B + B / 2).filter(|v| v.is_valid());
        let any = || depth.crop(i * B, row * B, B, B).rows().flatten().copied().find(|v| v.is_valid());
        *cell = middle.or_else(any).map_or(0.0, inverse);
    }
}

/// [`solve`] as a call, for all sides of blocks together: without vectors eight lanes are eight times the code.
#[inline(never)]
fn solve_apart<D: DepthSample>(
    block: usize,
    context: &Context<'_, '_, D>,
    row: &mut BlockRow<'_>,
    start: usize,
    reference: Lanes,
) {
    solve(block, context, row, start, reference);
}

/// The planes of eight blocks from their sums, in place; a block whose readings are few, or whose residual is more than
/// noise, becomes empty.
#[inline(always)]
fn solve<D: DepthSample>(
    block: usize,
    context: &Context<'_, '_, D>,
    row: &mut BlockRow<'_>,
    start: usize,
    reference: Lanes,
) {
    let pixels = (block * block) as f32;
    let spread = (pixels - 1.0) / 12.0;
    let one = Lanes::splat(1.0);
    let [n, sx, sy, sxx, sxy, syy, sw, sxw, syw, sww] = row.lanes(start);
    // An empty block divides by 1; it is not kept.
    let inv = n.select(Lanes::ZERO.below(n), one).recip();
    let (mx, my, mw) = (sx * inv, sy * inv, sw * inv);
    let (xx, xy, yy) = (sxx - sx * mx, sxy - sx * my, syy - sy * my);
    let (xw, yw, ww) = (sxw - sx * mw, syw - sy * mw, sww - sw * mw);
    let det = xx * yy - xy * xy;
    // Pixels on one line have no plane; a thousandth of a full square's determinant is hardly one.
    let ns = n * spread;
    let solid = (ns * ns * 1e-3).below(det);
    let inv_det = det.select(solid, one).recip();
    let a = (xw * yy - yw * xy) * inv_det;
    let b = (yw * xx - xw * xy) * inv_det;
    let residual = ww - a * xw - b * yw;
    let mean = reference + mw;
    let variance = mean.map(|w| context.noise.inverse_variance::<D>(w, context.frame.unit()));
    // Chi-square has mean f and variance 2 f: three standard deviations above the mean.
    let freedom = n - Lanes::splat(3.0);
    let excess = (residual - variance * freedom).map(|e| e.max(0.0));
    let explained = (excess * excess).below(variance * variance * freedom * 18.0 + Lanes::splat(f32::MIN_POSITIVE));
    let enough = Lanes::splat(0.3 * pixels).below(n);
    let keep = solid * explained * enough;
    let c = mean - a * mx - b * my;
    let fields = [n, sx, sy, sxx, sxy, syy, c, a, b, variance * inv];
    for (field, value) in row.fields().into_iter().zip(fields) {
        // Selected, not multiplied: what is not kept may be NaN.
        value.select(keep, Lanes::ZERO).store(field, start);
    }
}
