//! Step 3: each pixel takes the window whose plane it lies on.

use super::blocks::{offsets, read};
use super::windows::WindowRow;
use super::{AdaptiveRow, Context};
use crate::ground::lanes::{LANES, Lanes};
use crate::ground::math;
use crate::localized::normals::exact::REAL;
use crate::localized::normals::{NormalParams, normal_at};
use crate::sensing::depth::DepthSample;
use crate::skipping::Work;

/// The fit of pixels that lie on no window: thin things, lone pixels.
const LONE: NormalParams = NormalParams { radius: 3, ..NormalParams::POINT };

/// Answers the rows of one row of blocks.
pub(super) fn answer<D: DepthSample, const B: usize>(
    context: &Context<'_, '_, D>,
    row: usize,
    windows: [&WindowRow<'_>; 3],
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
    let half = (B as f32 - 1.0) / 2.0;
    let mut done = Lanes::ZERO;
    for j in (0..B).take_while(|j| row * B + j < context.height) {
        let py = row * B + j;
        let dy = j as i32 as f32 - half;
        let line = context.frame.depth().row(py);
        for first in (0..width).step_by(LANES) {
            let field = |field: &[f32]| spread::<B>(field, first);
            let w = read(line, first);
            let real = w.below(Lanes::splat(REAL));
            done += real;
            let dx = offsets::<B>(first);
            let off = (field(middle.c) + field(middle.b) * dy + field(middle.a) * dx - w).map(f32::abs);
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
            masked(field(middle.nx)).store(x, first);
            masked(field(middle.ny)).store(y, first);
            masked(field(middle.nz)).store(z, first);
            masked(field(middle.sigma)).store(sigma, first);
            if missed.any() {
                for (k, (&w, &missed)) in w.0.iter().zip(&missed.0).enumerate() {
                    if missed != 0.0 {
                        let px = first + k;
                        let answer = choose::<B>(windows, px / B + 1, px % B, dy, w);
                        let answer = answer.unwrap_or_else(|| lone(context, px, py));
                        for (out, value) in [&mut *x, &mut *y, &mut *z, &mut *sigma].into_iter().zip(answer) {
                            if let Some(cell) = out.get_mut(px) {
                                *cell = value;
                            }
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
    let at = |block: usize| field.get(block + 1).copied().unwrap_or(-1.0);
    if B >= LANES {
        Lanes::splat(at(first / B))
    } else {
        // Two blocks of four.
        let (a, b) = (at(first / B), at(first / B + 1));
        Lanes([a, a, a, a, b, b, b, b])
    }
}

/// The window whose plane is nearest to the pixel, of the eight neighbours', within reach.
fn choose<const B: usize>(windows: [&WindowRow<'_>; 3], at: usize, k: usize, dy: f32, w: f32) -> Option<[f32; 4]> {
    let side = B as f32;
    let dx = k as f32 - (side - 1.0) / 2.0;
    let residual = |row: &WindowRow<'_>, i: usize, ox: f32, oy: f32| {
        let reach = *row.reach.get(i)?;
        let e = (*row.c.get(i)? + *row.a.get(i)? * (dx - ox) + *row.b.get(i)? * (dy - oy) - w).abs();
        (e <= reach).then_some(e)
    };
    let take =
        |row: &WindowRow<'_>, i: usize| Some([*row.nx.get(i)?, *row.ny.get(i)?, *row.nz.get(i)?, *row.sigma.get(i)?]);
    let [above, middle, below] = windows;
    let mut best = None;
    let mut least = f32::INFINITY;
    for (row, oy) in [(middle, 0.0), (above, -side), (below, side)] {
        for (i, ox) in [(at - 1, -side), (at, 0.0), (at + 1, side)] {
            if let Some(e) = residual(row, i, ox, oy).filter(|&e| e < least) {
                least = e;
                best = Some((row, i));
            }
        }
    }
    best.and_then(|(row, i)| take(row, i))
}

/// A pixel fitted on its own: by its cross where that is sure to 3 degrees, else over 7 x 7 pixels.
fn lone<D: DepthSample>(context: &Context<'_, '_, D>, x: usize, y: usize) -> [f32; 4] {
    let z = context.frame.z(x, y);
    let k = context.frame.intrinsics();
    let f = 0.5 * (k.fx().abs() + k.fy().abs());
    // Error of a slope of 1/z is sigma_z / z² over the root of its coordinates' squares; f z times that, on two axes, is the
    // direction's. The cross has a root of 2; a square of n readings one of n (n - 1) / 12.
    let one = core::f32::consts::SQRT_2 * f / z * context.noise.sigma::<D>(z, context.frame.unit());
    let cross = one * core::f32::consts::FRAC_1_SQRT_2;
    let params = if cross < 0.05 { NormalParams::default() } else { LONE };
    let Some(e) = normal_at(context.frame, x, y, &params) else {
        return [f32::NAN; 4];
    };
    let n = f32::from(e.support);
    let sigma = if params.radius == 0 { cross } else { one * math::inv_sqrt(n * (n - 1.0).max(1.0) / 12.0) };
    [e.normal.x, e.normal.y, e.normal.z, sigma]
}
