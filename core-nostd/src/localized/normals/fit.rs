//! The wide fit: least squares of inverse depth over the pixels around a point that lie on its surface.

use glam::Vec3;

use super::{NormalEstimate, facing};
use crate::ground::math;
use crate::localized::normals::exact::inverse;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// Sums of a two-variable least-squares fit, coordinates and values relative to the centre.
#[derive(Default)]
struct Sums {
    n: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    w: f32,
    xw: f32,
    yw: f32,
    ww: f32,
}

/// Inverse depth relative to the centre's: value at the centre, slopes, RMS residual.
#[derive(Clone, Copy)]
struct Fit {
    c: f32,
    a: f32,
    b: f32,
    rms: f32,
    n: f32,
}

impl Sums {
    fn add(&mut self, x: f32, y: f32, w: f32) {
        self.n += 1.0;
        self.x += x;
        self.y += y;
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
        self.w += w;
        self.xw += x * w;
        self.yw += y * w;
        self.ww += w * w;
    }

    /// `None` when the points do not span a plane.
    fn solve(&self) -> Option<Fit> {
        let n = self.n;
        if n < 3.0 {
            return None;
        }
        let (mx, my, mw) = (self.x / n, self.y / n, self.w / n);
        let xx = self.xx - n * mx * mx;
        let xy = self.xy - n * mx * my;
        let yy = self.yy - n * my * my;
        let xw = self.xw - n * mx * mw;
        let yw = self.yw - n * my * mw;
        let ww = self.ww - n * mw * mw;
        let det = xx * yy - xy * xy;
        // Integer pixel coordinates: a determinant below 1 means a line (exact zero, but for rounding).
        if det < 0.5 {
            return None;
        }
        let a = (xw * yy - yw * xy) / det;
        let b = (yw * xx - xw * xy) / det;
        let squares = (ww - a * xw - b * yw).max(0.0);
        Some(Fit { c: mw - a * mx - b * my, a, b, rms: math::sqrt(squares / n), n })
    }
}

/// Two passes: first the pixels within `max_step` of the centre's depth per pixel of distance, then those within 2.5
/// standard deviations of the first fit, so that what the coarse rule let in across an edge drops out.
pub(super) fn at<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    radius: u8,
    max_step: f32,
) -> Option<NormalEstimate> {
    let depth = frame.depth();
    let centre = inverse(depth.get(x, y)?);
    let r = usize::from(radius);
    let (x0, y0) = (x.saturating_sub(r), y.saturating_sub(r));
    let window = depth.crop(x0, y0, x + r + 1 - x0, y + r + 1 - y0);
    let offset = (x0 as f32 - x as f32, y0 as f32 - y as f32);
    let gather = |keep: &dyn Fn(f32, f32, f32) -> bool| {
        let mut sums = Sums::default();
        for (j, row) in window.rows().enumerate() {
            let dy = offset.1 + j as f32;
            for (i, &value) in row.iter().enumerate() {
                let dx = offset.0 + i as f32;
                // Relative to the centre, in parts of it: small numbers, so the sums lose nothing.
                let w = inverse(value) / centre - 1.0;
                // False for holes: they are NaN.
                if keep(dx, dy, w) {
                    sums.add(dx, dy, w);
                }
            }
        }
        sums.solve()
    };
    let mut fit = gather(&|dx, dy, w| w.abs() <= max_step * dx.abs().max(dy.abs()).max(1.0))?;
    for _ in 0..2 {
        // Rounding alone leaves this much even on a perfect plane.
        let limit = 2.5 * fit.rms + 2e-6;
        let Fit { c, a, b, .. } = fit;
        match gather(&|dx, dy, w| (w - c - a * dx - b * dy).abs() <= limit) {
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
