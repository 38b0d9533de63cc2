//! DepthLab's Algorithm 1, repaired: mean depth slopes over a square, weak perspective.

use glam::Vec3;

use super::{MAX_RADIUS, NormalEstimate, NormalParams};
use crate::ground::math;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// Single-point form; the dense form calls it for every pixel.
///
/// As printed, Algorithm 1 divides 0/0 on a wall (its "distance" is unsigned and zero differences are skipped), swaps x and
/// y, and is not of unit length; here d is the signed D(q) - D(p), only readings count, a neighbour beyond `max_step` of the
/// centre's depth is dropped (the published code's rule), and each count is guarded on its own.
pub(super) fn at<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    params: &NormalParams,
) -> Option<NormalEstimate> {
    let z = frame.z(x, y);
    if z <= 0.0 {
        return None;
    }
    let r = if params.radius == 0 { 2 } else { i32::from(params.radius.min(MAX_RADIUS)) };
    let max_step = params.max_step.unwrap_or(0.2) * z;
    let depth = frame.depth();
    let (xi, yi) = (i32::try_from(x).ok()?, i32::try_from(y).ok()?);
    let neighbours = || {
        (-r..=r).flat_map(move |dy| (-r..=r).map(move |dx| (dx, dy))).filter(|&d| d != (0, 0)).filter_map(|(dx, dy)| {
            let q = depth.get_signed(xi + dx, yi + dy)?.metres(frame.unit());
            (q > 0.0 && (q - z).abs() <= max_step).then_some((dx as f32, dy as f32, q - z))
        })
    };
    let (mut sum_x, mut sum_y, mut count_x, mut count_y, mut support) = (0.0, 0.0, 0_u16, 0_u16, 1_u16);
    for (dx, dy, d) in neighbours() {
        support += 1;
        if dx != 0.0 {
            sum_x += d / dx;
            count_x += 1;
        }
        if dy != 0.0 {
            sum_y += d / dy;
            count_y += 1;
        }
    }
    if count_x == 0 || count_y == 0 {
        return None;
    }
    let (zx, zy) = (sum_x / f32::from(count_x), sum_y / f32::from(count_y));
    let k = frame.intrinsics();
    let normal = Vec3::new(zx * k.fx() / z, zy * k.fy() / z, -1.0).try_normalize()?;
    let mut squares = 0.0;
    for (dx, dy, d) in neighbours() {
        let e = d - zx * dx - zy * dy;
        squares += e * e;
    }
    Some(NormalEstimate { normal, support, residual: math::sqrt(squares / f32::from(support)) })
}
