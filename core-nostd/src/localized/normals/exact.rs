//! The exact method's kernel: slope of inverse depth from the side of least curvature.

use glam::Vec3;

use super::{NormalEstimate, facing};
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// Slope of inverse depth along one axis, and the second difference of the three pixels it was taken from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slope {
    /// Change of inverse depth per pixel; NaN when no neighbour has a reading.
    pub(super) value: f32,
    /// Size of the second difference of inverse depth; 0 when only two pixels have readings; NaN with `value`.
    pub(super) curvature: f32,
}

/// Slope at the middle of five inverse depths in a line; NaN marks a hole.
///
/// Three candidates: the last three, the middle three, the next three pixels. The one whose second difference is smallest
/// lies on one surface. A comparison with NaN is false, so candidates with holes drop out by themselves.
#[inline(always)]
pub(super) fn slope(l2: f32, l1: f32, c: f32, r1: f32, r2: f32) -> Slope {
    let (ll, l, r, rr) = (l1 - l2, c - l1, r1 - c, r2 - r1);
    let (bend_l, bend_c, bend_r) = (l - ll, r - l, rr - r);
    // Two pixels only: straight by definition, but never preferred to three that agree.
    let pair = if l.is_nan() { r } else { l };
    let mut value = pair;
    let mut least = f32::INFINITY;
    let mut curvature = if pair.is_nan() { f32::NAN } else { 0.0 };
    let size = bend_c.abs();
    if size < least {
        (value, curvature, least) = (0.5 * (l + r), size, size);
    }
    let size = bend_l.abs();
    if size < least {
        (value, curvature, least) = (l + 0.5 * bend_l, size, size);
    }
    let size = bend_r.abs();
    if size < least {
        (value, curvature) = (r - 0.5 * bend_r, size);
    }
    Slope { value, curvature }
}

/// Inverse of a depth value in its own units; NaN for a hole. The unit cancels in the normal.
#[inline(always)]
pub(super) fn inverse<D: DepthSample>(value: D) -> f32 {
    if value.is_valid() { 1.0 / value.number() } else { f32::NAN }
}

/// The single-point form.
pub(super) fn at<D: DepthSample>(frame: &DepthFrame<'_, D>, x: usize, y: usize) -> Option<NormalEstimate> {
    let depth = frame.depth();
    let (xi, yi) = (i32::try_from(x).ok()?, i32::try_from(y).ok()?);
    let w = |dx: i32, dy: i32| depth.get_signed(xi + dx, yi + dy).map_or(f32::NAN, inverse);
    let c = w(0, 0);
    let h = slope(w(-2, 0), w(-1, 0), c, w(1, 0), w(2, 0));
    let v = slope(w(0, -2), w(0, -1), c, w(0, 1), w(0, 2));
    let k = frame.intrinsics();
    let n = facing(c, h.value, v.value, x as f32 - k.cx(), y as f32 - k.cy(), k.fx(), k.fy());
    let normal = Vec3::from(n);
    normal.is_finite().then(|| NormalEstimate {
        normal,
        support: 1 + taps(h) + taps(v),
        residual: residual(c, h.curvature, v.curvature, frame.unit().metres()),
    })
}

fn taps(s: Slope) -> u16 {
    // A pair has exactly no curvature; so may three pixels, which then claim one tap too few: the cautious side.
    if s.curvature > 0.0 { 2 } else { 1 }
}

/// Deviation in metres from straight lines: the second difference of 1/z over sqrt 6 is the RMS deviation of three points
/// from a line, and dz = z² d(1/z).
#[inline(always)]
pub(super) fn residual(w: f32, horizontal: f32, vertical: f32, unit: f32) -> f32 {
    let larger = if horizontal > vertical { horizontal } else { vertical };
    larger * 0.408_248_3 / (w * w) * unit
}
