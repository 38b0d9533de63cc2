//! The exact method's kernel: slope of inverse depth from the side of least curvature.

use glam::Vec3;

use super::{NormalEstimate, facing};
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// Inverse depth of a hole: far above every real one, so that differences with it are never the smallest, and finite, so
/// that no comparison meets a NaN (which would cost a select each).
pub(super) const HOLE: f32 = 1e30;
/// Inverse depths and their differences below this are real.
pub(super) const REAL: f32 = 1e20;

/// Slope of inverse depth along one axis, and the second difference of the three pixels it was taken from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slope {
    /// Change of inverse depth per pixel; at least [`REAL`] in size when no neighbour has a reading.
    pub(super) value: f32,
    /// Size of the second difference of inverse depth; 0 when it was taken from two pixels.
    pub(super) curvature: f32,
    /// Readings besides the centre: 2, or 1 when it was taken from two pixels.
    pub(super) taps: f32,
}

/// The largest second difference, as a share of inverse depth, that three pixels on one surface have, at a focal length in
/// pixels: a surface faced head-on that turns by 45 degrees from one pixel to the next. More is an edge.
#[inline(always)]
pub(super) fn turn(focal: f32) -> f32 {
    1.0 / focal.abs()
}

/// Slope at the middle of five inverse depths in a line.
///
/// Three candidates: the last three, the middle three, the next three pixels. The one whose second difference is smallest
/// lies on one surface, and a parabola through it has this slope. Where all three cross an edge ([`turn`]), as on things two
/// pixels wide, the nearer neighbour alone tells.
#[inline(always)]
pub(super) fn slope(l2: f32, l1: f32, c: f32, r1: f32, r2: f32, turn: f32) -> Slope {
    let (l, r) = (c - l1, r1 - c);
    slope_of(l, r, [l - (l1 - l2), r - l, (r2 - r1) - r], c * turn)
}

/// As [`slope`], from the two first differences beside the middle, the three second differences around it, and the largest that
/// one surface has there.
#[inline(always)]
pub(super) fn slope_of(l: f32, r: f32, [before, mut bend, after]: [f32; 3], most: f32) -> Slope {
    bend = if before.abs() < bend.abs() { before } else { bend };
    let right = after.abs() < bend.abs();
    bend = if right { -after } else { bend };
    let base = if right { r } else { l };
    let pair = if l.abs() < r.abs() { l } else { r };
    let three = bend.abs() < most;
    Slope {
        value: if three { base + 0.5 * bend } else { pair },
        curvature: if three { bend.abs() } else { 0.0 },
        taps: if three { 2.0 } else { 1.0 },
    }
}

/// The value of [`slope_of`] alone, by branches that nearly always go one way, for targets where a select costs as much as a branch;
/// `None` when no neighbour has a reading.
#[inline(always)]
pub(super) fn slope_by_branches(l: f32, r: f32, [before, bend, after]: [f32; 3], most: f32) -> Option<f32> {
    let mut bend = bend;
    if before.abs() < bend.abs() {
        bend = before;
    }
    let mut base = l;
    if after.abs() < bend.abs() {
        bend = -after;
        base = r;
    }
    if bend.abs() < most {
        // No hole is among them: one makes a second difference of at least `HOLE`, and no focal length (at least 1e-3 px) and no
        // inverse depth (at most 1e12) makes `most` that large.
        return Some(base + 0.5 * bend);
    }
    seldom();
    let pair = if l.abs() < r.abs() { l } else { r };
    (pair.abs() < REAL).then_some(pair)
}

/// Where this is called is off the way: what follows is not computed where it is not wanted. `core::hint::cold_path`, which the
/// oldest compiler that the core takes has not.
#[cold]
#[inline]
const fn seldom() {}

/// Whether there is a normal: a reading at the centre and a neighbour on either axis.
#[inline(always)]
pub(super) fn is_real(c: f32, h: Slope, v: Slope) -> bool {
    (c < REAL) & (h.value.abs() < REAL) & (v.value.abs() < REAL)
}

/// Inverse of a depth value in its own units; [`HOLE`] for a hole. The unit cancels in the normal.
#[inline(always)]
pub(super) fn inverse<D: DepthSample>(value: D) -> f32 {
    if value.is_valid() { 1.0 / value.number() } else { HOLE }
}

/// The single-point form.
pub(super) fn at<D: DepthSample>(frame: &DepthFrame<'_, D>, x: usize, y: usize) -> Option<NormalEstimate> {
    let depth = frame.depth();
    let (xi, yi) = (i32::try_from(x).ok()?, i32::try_from(y).ok()?);
    let w = |dx: i32, dy: i32| depth.get_signed(xi + dx, yi + dy).map_or(HOLE, inverse);
    let c = w(0, 0);
    let k = frame.intrinsics();
    let h = slope(w(-2, 0), w(-1, 0), c, w(1, 0), w(2, 0), turn(k.fx()));
    let v = slope(w(0, -2), w(0, -1), c, w(0, 1), w(0, 2), turn(k.fy()));
    if !is_real(c, h, v) {
        return None;
    }
    let n = facing(c, h.value, v.value, x as f32 - k.cx(), y as f32 - k.cy(), k.fx(), k.fy());
    let normal = Vec3::from(n);
    normal.is_finite().then(|| NormalEstimate {
        normal,
        support: (1.0 + h.taps + v.taps) as u16,
        residual: residual(c, h.curvature, v.curvature, frame.unit().metres()),
    })
}

/// Deviation in metres from straight lines: the second difference of 1/z over sqrt 6 is the RMS deviation of three points
/// from a line, and dz = z² d(1/z).
#[inline(always)]
pub(super) fn residual(w: f32, horizontal: f32, vertical: f32, unit: f32) -> f32 {
    let larger = if horizontal > vertical { horizontal } else { vertical };
    larger * 0.408_248_3 / (w * w) * unit
}
