//! The wide fit: least squares of inverse depth over the pixels around a point that lie on its surface.
//!
//! 960 bytes of stack. Sums run in four lanes over rows padded to whole lanes, so that they vectorise without reordering
//! anything the compiler may not reorder.

use glam::Vec3;

use super::exact::inverse;
use super::{MAX_RADIUS, NormalEstimate, facing};
use crate::ground::math;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

const LANES: usize = 4;
/// Chunks of four that hold the widest row.
const CHUNKS: usize = (2 * MAX_RADIUS as usize + 1).div_ceil(LANES);
const ROWS: usize = 2 * MAX_RADIUS as usize + 1;

/// Inverse depth relative to the centre's (0 at the centre, NaN in holes), so that the sums lose no digits.
struct Patch {
    w: [[[f32; LANES]; CHUNKS]; ROWS],
    rows: usize,
    chunks: usize,
    /// Offset of the first pixel from the centre.
    dx: f32,
    dy: f32,
}

/// Value at the centre, slopes, RMS residual, pixels.
#[derive(Clone, Copy)]
struct Fit {
    c: f32,
    a: f32,
    b: f32,
    rms: f32,
    n: f32,
}

impl Patch {
    fn gather<D: DepthSample>(frame: &DepthFrame<'_, D>, x: usize, y: usize, radius: u8) -> Option<Self> {
        let depth = frame.depth();
        let centre = depth.get(x, y).filter(|v| v.is_valid())?.number();
        let r = usize::from(radius);
        let (x0, y0) = (x.saturating_sub(r), y.saturating_sub(r));
        let window = depth.crop(x0, y0, x + r + 1 - x0, y + r + 1 - y0);
        let mut patch = Self {
            w: [[[f32::NAN; LANES]; CHUNKS]; ROWS],
            rows: window.height(),
            chunks: window.width().div_ceil(LANES),
            dx: x0 as f32 - x as f32,
            dy: y0 as f32 - y as f32,
        };
        for (line, row) in patch.w.iter_mut().zip(window.rows()) {
            for (w, &value) in line.as_flattened_mut().iter_mut().zip(row) {
                if value.is_valid() {
                    *w = inverse(value) * centre - 1.0;
                }
            }
        }
        Some(patch)
    }

    /// Least squares over the pixels within `base + per_pixel * distance` of the plane (c, a, b); `None` when they do not
    /// span a plane.
    fn solve(&self, (c, a, b): (f32, f32, f32), base: f32, per_pixel: f32) -> Option<Fit> {
        let (mut n, mut x, mut y, mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut w, mut xw, mut yw, mut ww) = (0.0, 0.0, 0.0, 0.0);
        for (j, line) in self.w.iter().take(self.rows).enumerate() {
            let dy = self.dy + j as f32;
            let mut sums = [[0.0_f32; LANES]; 6];
            for (i, chunk) in line.iter().take(self.chunks).enumerate() {
                let from = self.dx + (LANES * i) as f32;
                let [s0, sx, sxx, sw, sxw, sww] = &mut sums;
                for lane in 0..LANES {
                    // Constant bounds: the checks vanish.
                    #[expect(clippy::indexing_slicing, reason = "lane < LANES, the length of every array here")]
                    {
                        let dx = from + lane as f32;
                        let value = chunk[lane];
                        let distance = if dx.abs() > dy.abs() { dx.abs() } else { dy.abs() };
                        let distance = if distance > 1.0 { distance } else { 1.0 };
                        // False for NaN: holes and padding drop out.
                        let keep = (value - c - a * dx - b * dy).abs() <= base + per_pixel * distance;
                        let one = if keep { 1.0 } else { 0.0 };
                        let value = if keep { value } else { 0.0 };
                        s0[lane] += one;
                        sx[lane] += one * dx;
                        sxx[lane] += one * dx * dx;
                        sw[lane] += value;
                        sxw[lane] += value * dx;
                        sww[lane] += value * value;
                    }
                }
            }
            let [s0, sx, sxx, sw, sxw, sww] = sums.map(|[p, q, r, s]| (p + q) + (r + s));
            n += s0;
            x += sx;
            y += s0 * dy;
            xx += sxx;
            xy += sx * dy;
            yy += s0 * dy * dy;
            w += sw;
            xw += sxw;
            yw += sw * dy;
            ww += sww;
        }
        if n < 3.0 {
            return None;
        }
        let (mx, my, mw) = (x / n, y / n, w / n);
        let (xx, xy, yy) = (xx - n * mx * mx, xy - n * mx * my, yy - n * my * my);
        let (xw, yw, ww) = (xw - n * mx * mw, yw - n * my * mw, ww - n * mw * mw);
        let det = xx * yy - xy * xy;
        // Pixel coordinates are integers: below this the pixels lie on a line (zero, but for rounding).
        if det < 0.5 {
            return None;
        }
        let a = (xw * yy - yw * xy) / det;
        let b = (yw * xx - xw * xy) / det;
        let squares = (ww - a * xw - b * yw).max(0.0);
        Some(Fit { c: mw - a * mx - b * my, a, b, rms: math::sqrt(squares / n), n })
    }
}

/// First the pixels within `max_step` of the centre's depth per pixel of distance, then twice those within 2.5 standard
/// deviations of the last fit, so that what the coarse rule let in across an edge drops out.
pub(super) fn at<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    radius: u8,
    max_step: f32,
) -> Option<NormalEstimate> {
    let patch = Patch::gather(frame, x, y, radius.min(MAX_RADIUS))?;
    let mut fit = patch.solve((0.0, 0.0, 0.0), 0.0, max_step)?;
    for _ in 0..2 {
        // Rounding alone leaves 2e-6 even on a perfect plane.
        match patch.solve((fit.c, fit.a, fit.b), 2.5 * fit.rms + 2e-6, 0.0) {
            Some(better) => fit = better,
            None => break,
        }
    }
    let k = frame.intrinsics();
    let (dx, dy) = (x as f32 - k.cx(), y as f32 - k.cy());
    let normal = Vec3::from(facing(1.0 + fit.c, fit.a, fit.b, dx, dy, k.fx(), k.fy()));
    let z = frame.z(x, y);
    normal.is_finite().then_some(NormalEstimate { normal, support: fit.n as u16, residual: fit.rms * z })
}
