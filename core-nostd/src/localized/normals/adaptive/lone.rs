//! The fit of pixels that lie on no window (thin things, small curved ones, far clutter): a plane through the 7 x 7 pixels that
//! can be of the same surface.

use super::blocks::read;
use super::{Context, cross};
use crate::ground::lanes::{LANES, Lanes};
use crate::ground::math;
use crate::ground::regression::Sums;
use crate::localized::normals::exact::{self, REAL};
use crate::sensing::depth::DepthSample;

/// Pixels to each side.
const RADIUS: usize = 3;
/// A pixel this many standard deviations off is of another surface...
const GATE: f32 = 4.0;
/// ...unless a surface that leans this much (tangent of the angle to the image) explains it.
const LEAN: f32 = 4.0;
/// What the slopes are drawn to zero with, in pixels squared: a line of pixels has no slope across, and is taken to face the
/// camera there.
const RIDGE: f32 = 0.5;
/// Where the cross of neighbours alone is predicted to be off by less, radians (17 degrees), it is taken: it does not blur, and
/// what lies on no window is small.
const SHARP: f32 = 0.3;
/// No direction is off by more, in the mean over directions that face the camera, radians.
const WORST: f32 = 1.0;

/// Normal and its predicted error, radians; NaN where there are too few neighbours.
pub(super) fn fit<D: DepthSample>(context: &Context<'_, '_, D>, x: usize, y: usize) -> [f32; 4] {
    let frame = context.frame;
    let k = frame.intrinsics();
    let (fx, fy) = (k.fx(), k.fy());
    let centre = frame.depth().row(y).get(x).map_or(exact::HOLE, |&v| exact::inverse(v));
    if centre >= REAL {
        return [f32::NAN; 4];
    }
    let variance = context.noise.inverse_variance::<D>(centre, frame.unit());
    let cross = cross::predict(&context.noise, frame, frame.unit().metres() / centre);
    if cross < SHARP
        && let Some(e) = exact::at(frame, x, y)
    {
        return [e.normal.x, e.normal.y, e.normal.z, cross];
    }
    let Sums { n, x: mx, y: my, w: mw, xx, xy, yy, xw, yw, ww } =
        gather(context, x, y, centre, GATE * math::sqrt(variance), LEAN * centre / cross::focal(k));
    if n < 3.0 {
        return [f32::NAN; 4];
    }
    let inv = 1.0 / n;
    let (xx, xy, yy) = (xx - mx * mx * inv + RIDGE, xy - mx * my * inv, yy - my * my * inv + RIDGE);
    let (xw, yw) = (xw - mx * mw * inv, yw - my * mw * inv);
    let inv_det = 1.0 / (xx * yy - xy * xy);
    let a = (xw * yy - yw * xy) * inv_det;
    let b = (yw * xx - xw * xy) * inv_det;
    let c = centre + (mw - a * mx - b * my) * inv;
    let (dx, dy) = (x as f32 - k.cx(), y as f32 - k.cy());
    let (nx, ny, nz) = (-fx * a, -fy * b, a * dx + b * dy - c);
    let inv_length = math::inv_sqrt(nx * nx + ny * ny + nz * nz);
    // What the plane leaves may be more than noise: curvature, an edge let in.
    let left = (ww - mw * mw * inv - a * xw - b * yw) / (n - 3.0).max(1.0);
    let variance = if left > variance { left } else { variance };
    let spread = variance * inv_det * (yy * (fx * fx) + xx * (fy * fy));
    let sigma = math::sqrt(spread) * inv_length;
    [nx * inv_length, ny * inv_length, nz * inv_length, if sigma < WORST { sigma } else { WORST }]
}

/// Sums over the pixels let in; coordinates and values relative to the centre's. One row of the window is one vector.
#[inline(always)]
fn gather<D: DepthSample>(
    context: &Context<'_, '_, D>,
    x: usize,
    y: usize,
    centre: f32,
    noise: f32,
    lean: f32,
) -> Sums {
    let first = x.saturating_sub(RADIUS);
    let dx = Lanes::index() + Lanes::splat(first as f32 - x as f32);
    let across = dx.map(f32::abs);
    let inside = across.below(Lanes::splat(RADIUS as f32 + 0.5));
    let [mut n, mut y1, mut yy, mut w, mut yw, mut ww] = [Lanes::ZERO; 6];
    const { assert!(2 * RADIUS < LANES) };
    for row in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(context.height) {
        let dy = row as f32 - y as f32;
        let far = across.map(|d| if d > dy.abs() { d } else { dy.abs() });
        let d = read(context.frame.depth().row(row), first) - Lanes::splat(centre);
        let keep = d.map(f32::abs).below(far * lean + Lanes::splat(noise)) * inside;
        let d = d.select(keep, Lanes::ZERO);
        n += keep;
        y1 += keep * dy;
        yy += keep * (dy * dy);
        w += d;
        yw += d * dy;
        ww += d * d;
    }
    let nx = n * dx;
    Sums {
        n: n.sum(),
        x: nx.sum(),
        y: y1.sum(),
        w: w.sum(),
        xx: (nx * dx).sum(),
        xy: (y1 * dx).sum(),
        yy: yy.sum(),
        xw: (w * dx).sum(),
        yw: yw.sum(),
        ww: ww.sum(),
    }
}
