//! Step 3: each pixel takes the window whose plane it lies on, its slopes interpolated towards the windows beside.

use super::blocks::{offsets, read};
use super::windows::WindowRow;
use super::{AdaptiveRow, Context, lone};
use crate::ground::lanes::{LANES, Lanes};
use crate::localized::normals::exact::REAL;
use crate::localized::normals::facing;
use crate::sensing::depth::DepthSample;
use crate::skipping::Work;

/// Answers the rows of one row of blocks.
#[inline(always)]
pub(super) fn answer<D: DepthSample, const B: usize>(
    context: &Context<'_, '_, D>,
    row: usize,
    windows: [&WindowRow<'_>; 3],
    bends: &mut Bends<'_>,
    outputs: &mut [f32],
    work: &mut Work,
    each: &mut impl FnMut(usize, AdaptiveRow<'_>),
) {
    let width = context.width;
    // Padded, so that the last eight have room.
    let padded = width.next_multiple_of(LANES);
    let (x, rest) = outputs.split_at_mut_checked(padded).unwrap_or_default();
    let (y, rest) = rest.split_at_mut_checked(padded).unwrap_or_default();
    let (z, sigma) = rest.split_at_mut_checked(padded).unwrap_or_default();
    let [_, middle, _] = windows;
    let (cx, cy) = (context.frame.intrinsics().cx(), context.frame.intrinsics().cy());
    let (fx, fy) = (context.frame.intrinsics().fx(), context.frame.intrinsics().fy());
    bends.fill::<B>(context.across, windows);
    let half = (B as f32 - 1.0) / 2.0;
    let mut done = Lanes::ZERO;
    for j in (0..B).take_while(|j| row * B + j < context.height) {
        let py = row * B + j;
        let dy = j as i32 as f32 - half;
        let line = context.frame.depth().row(py);
        let along = if dy < 0.0 { &bends.up } else { &bends.down };
        for first in (0..width).step_by(LANES) {
            let field = |field: &[f32]| spread::<B>(field, first);
            let w = read(line, first);
            let real = w.below(Lanes::splat(REAL));
            done += real;
            let dx = offsets::<B>(first);
            let (a, b) = (field(middle.a), field(middle.b));
            let on = field(middle.c) + b * dy + a * dx;
            let off = (on - w).map(f32::abs);
            // `reach` is negative where there is no window: nothing lies on it.
            let missed = real * (Lanes::splat(1.0) - off.below(field(middle.reach)));
            // All bits set is a NaN: holes have no normal.
            let masked = |v: Lanes| {
                let mut out = v.0;
                for (v, real) in out.iter_mut().zip(real.0) {
                    *v = f32::from_bits(v.to_bits() | if real != 0.0 { 0 } else { u32::MAX });
                }
                Lanes(out)
            };
            let left = dx.below(Lanes::ZERO);
            let a = a + field(along.a) * dy + field(bends.left.a).select(left, field(bends.right.a)) * dx;
            let b = b + field(along.b) * dy + field(bends.left.b).select(left, field(bends.right.b)) * dx;
            let (nx, ny) = (a * -fx, b * -fy);
            let nz = a * (Lanes::index() + Lanes::splat(first as i32 as f32 - cx)) + b * (py as f32 - cy) - on;
            let scale = (nx * nx + ny * ny + nz * nz).inv_sqrt_fast();
            masked(nx * scale).store(x, first);
            masked(ny * scale).store(y, first);
            masked(nz * scale).store(z, first);
            masked(field(middle.sigma)).store(sigma, first);
            if missed.any() {
                let found = nearest::<B>(windows, first, dx, dy, w);
                for (k, (&found, _)) in found.0.iter().zip(&missed.0).enumerate().filter(|(_, (_, m))| **m != 0.0) {
                    let px = first + k;
                    let answer =
                        take::<D, B>(context, windows, (px, py), found).unwrap_or_else(|| lone::fit(context, px, py));
                    for (out, value) in [&mut *x, &mut *y, &mut *z, &mut *sigma].into_iter().zip(answer) {
                        if let Some(cell) = out.get_mut(px) {
                            *cell = value;
                        }
                    }
                }
            }
        }
        each(py, AdaptiveRow { x: part(x, width), y: part(y, width), z: part(z, width), sigma: part(sigma, width) });
    }
    work.done = work.done.saturating_add(done.sum() as u32);
}

fn part(v: &[f32], width: usize) -> &[f32] {
    v.get(..width).unwrap_or(&[])
}

/// One number a block, spread over eight columns from `first` on.
#[inline(always)]
fn spread<const B: usize>(field: &[f32], first: usize) -> Lanes {
    beside::<B>(field, first, 1)
}

/// The same of the blocks to the left (`which` 0), themselves (1), or to the right (2).
#[inline(always)]
fn beside<const B: usize>(field: &[f32], first: usize, which: usize) -> Lanes {
    let at = |block: usize| field.get(block + which).copied().unwrap_or(-1.0);
    if B >= LANES {
        Lanes::splat(at(first / B))
    } else {
        // Two blocks of four.
        let (a, b) = (at(first / B), at(first / B + 1));
        Lanes([a, a, a, a, b, b, b, b])
    }
}

/// Which of the nine windows around, row by row, has the plane nearest to each of eight pixels, within reach; -1 for none.
#[inline(always)]
fn nearest<const B: usize>(windows: [&WindowRow<'_>; 3], first: usize, dx: Lanes, dy: f32, w: Lanes) -> Lanes {
    let side = B as f32;
    let mut best = Lanes::splat(f32::INFINITY);
    let mut found = Lanes::splat(-1.0);
    for (j, row) in windows.into_iter().enumerate() {
        let dy = dy - (j as f32 - 1.0) * side;
        for i in 0..3 {
            let field = |field: &[f32]| beside::<B>(field, first, i);
            let dx = dx + Lanes::splat((1.0 - i as f32) * side);
            let off = (field(row.c) + field(row.b) * dy + field(row.a) * dx - w).map(f32::abs);
            let nearer = off.below(field(row.reach)) * off.below(best);
            best = off.select(nearer, best);
            found = Lanes::splat((3 * j + i) as f32).select(nearer, found);
        }
    }
    found
}

/// What a window's predicted error is multiplied by for a pixel of another block: one pixel's word that it belongs there, far
/// from the window's middle (measured: the error is 1.5 to 2 times the window's).
const DOUBT: f32 = 2.0;

/// Normal and predicted error of a pixel from one of the nine windows around its block, counted row by row.
#[inline(always)]
fn take<D: DepthSample, const B: usize>(
    context: &Context<'_, '_, D>,
    windows: [&WindowRow<'_>; 3],
    (px, py): (usize, usize),
    which: f32,
) -> Option<[f32; 4]> {
    if which < 0.0 {
        return None;
    }
    let (across, down) = (which as usize % 3, which as usize / 3);
    let row = windows.get(down)?;
    let i = px / B + across;
    let (a, b) = (*row.a.get(i)?, *row.b.get(i)?);
    let half = (B as f32 - 1.0) / 2.0;
    // From the middle of that block.
    let from = |p: usize, which: usize| (p % B) as f32 - half + (1.0 - which as f32) * B as f32;
    let on = *row.c.get(i)? + a * from(px, across) + b * from(py, down);
    let k = context.frame.intrinsics();
    let [x, y, z] = facing(on, a, b, px as f32 - k.cx(), py as f32 - k.cy(), k.fx(), k.fy());
    Some([x, y, z, DOUBT * *row.sigma.get(i)?])
}

/// How the slopes of a row of windows change per pixel towards each window beside, where it lies on the same surface: a
/// curved surface is smooth, not a mosaic of blocks.
pub(super) struct Bends<'a> {
    left: Bend<'a>,
    right: Bend<'a>,
    up: Bend<'a>,
    down: Bend<'a>,
}

/// Change of both slopes, per pixel in one direction.
struct Bend<'a> {
    a: &'a mut [f32],
    b: &'a mut [f32],
}

/// Numbers kept per block.
pub(super) const BEND_FIELDS: usize = 8;

impl<'a> Bends<'a> {
    pub(super) fn new(storage: &'a mut [f32], cells: usize) -> Self {
        let mut parts = storage.chunks_mut(cells.max(1));
        let mut next = || Bend { a: parts.next().unwrap_or_default(), b: parts.next().unwrap_or_default() };
        Self { left: next(), right: next(), up: next(), down: next() }
    }

    #[inline(always)]
    fn fill<const B: usize>(&mut self, across: usize, [above, middle, below]: [&WindowRow<'_>; 3]) {
        self.left.fill::<B>(across, middle, (middle, 0), (middle.right, 0), -1.0);
        self.right.fill::<B>(across, middle, (middle, 2), (middle.right, 1), 1.0);
        self.up.fill::<B>(across, middle, (above, 1), (above.below, 1), -1.0);
        self.down.fill::<B>(across, middle, (below, 1), (middle.below, 1), 1.0);
    }
}

impl Bend<'_> {
    /// Towards the windows of `other`, one block to the left (0), none (1), or one to the right (2); where linked.
    #[inline(always)]
    fn fill<const B: usize>(
        &mut self,
        across: usize,
        own: &WindowRow<'_>,
        (other, at): (&WindowRow<'_>, usize),
        (linked, link): (&[f32], usize),
        sign: f32,
    ) {
        let scale = sign / B as f32;
        for start in (1..=across).step_by(LANES) {
            let linked = Lanes::load(linked, start + link - 1) * scale;
            let change =
                |own: &[f32], other: &[f32]| (Lanes::load(other, start + at - 1) - Lanes::load(own, start)) * linked;
            change(own.a, other.a).store(self.a, start);
            change(own.b, other.b).store(self.b, start);
        }
    }
}
