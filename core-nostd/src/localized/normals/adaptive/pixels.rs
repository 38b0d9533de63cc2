//! Step 3: each pixel takes the window whose plane it lies on.

use super::blocks::read_line;
use super::windows::WindowRow;
use super::{AdaptiveRow, Context};
use crate::ground::math;
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
    line: &mut [f32],
    outputs: &mut [f32],
    work: &mut Work,
    each: &mut impl FnMut(usize, AdaptiveRow<'_>),
) {
    let width = context.width;
    let (x, rest) = outputs.split_at_mut_checked(width).unwrap_or_default();
    let (y, rest) = rest.split_at_mut_checked(width).unwrap_or_default();
    let (z, sigma) = rest.split_at_mut_checked(width).unwrap_or_default();
    let [_, middle, _] = windows;
    for j in (0..B).take_while(|j| row * B + j < context.height) {
        let py = row * B + j;
        let dy = j as f32 - (B as f32 - 1.0) / 2.0;
        read_line(context, py, line);
        let outs = x.chunks_mut(B).zip(y.chunks_mut(B)).zip(z.chunks_mut(B)).zip(sigma.chunks_mut(B));
        for (i, (w, (((x, y), z), sigma))) in line.as_chunks::<B>().0.iter().zip(outs).enumerate() {
            let at = i + 1;
            let value = |field: &[f32]| field.get(at).copied().unwrap_or(-1.0);
            let (c, a, reach) = (value(middle.c) + value(middle.b) * dy, value(middle.a), value(middle.reach));
            // How many readings there are, and how many lie on the block's own plane.
            let (mut real, mut on) = (0_u32, 0_u32);
            for (k, &w) in w.iter().enumerate() {
                let dx = k as i32 as f32 - (B as f32 - 1.0) / 2.0;
                let is_real = w < 1e20;
                real += u32::from(is_real);
                on += u32::from(is_real & ((c + a * dx - w).abs() <= reach));
            }
            work.done += real;
            if real == on {
                let fields =
                    [(x, value(middle.nx)), (y, value(middle.ny)), (z, value(middle.nz)), (sigma, value(middle.sigma))];
                if real as usize == B {
                    for (out, v) in fields {
                        out.fill(v);
                    }
                } else {
                    for (out, v) in fields {
                        for (out, &w) in out.iter_mut().zip(w) {
                            *out = if w < 1e20 { v } else { f32::NAN };
                        }
                    }
                }
                continue;
            }
            for ((((k, &w), x), y), (z, sigma)) in w.iter().enumerate().zip(x).zip(y).zip(z.iter_mut().zip(sigma)) {
                let px = i * B + k;
                [*x, *y, *z, *sigma] = if w < 1e20 {
                    choose::<B>(windows, at, k, dy, w).unwrap_or_else(|| lone(context, px, py))
                } else {
                    [f32::NAN; 4]
                };
            }
        }
        each(py, AdaptiveRow { x, y, z, sigma });
    }
}

/// The window whose plane is nearest to the pixel, of the block's own and its neighbours', within reach; the own first.
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
    if residual(middle, at, 0.0, 0.0).is_some() {
        return take(middle, at);
    }
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
