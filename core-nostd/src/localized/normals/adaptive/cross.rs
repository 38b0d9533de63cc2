//! Depth without noise: the exact method, and the error that is left.

use super::AdaptiveRow;
use crate::ground::math;
use crate::localized::normals::NormalParams;
use crate::localized::normals::dense::{self, DenseError};
use crate::sensing::camera::Intrinsics;
use crate::sensing::depth::DepthSample;
use crate::sensing::depth::noise::DepthNoise;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;

/// The exact method's rows with the predicted error beside them.
pub(super) fn rows<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    noise: &DepthNoise,
    scratch: &mut [f32],
    mut each: impl FnMut(usize, AdaptiveRow<'_>),
) -> Result<Work, DenseError> {
    let (sigma, scratch) = scratch.split_at_mut_checked(frame.size().0).unwrap_or_default();
    dense::rows(frame, &NormalParams::default(), scratch, |y, n| {
        for ((sigma, &value), x) in sigma.iter_mut().zip(frame.depth().row(y)).zip(n.x) {
            let predicted = predict(noise, frame, value.metres(frame.unit()));
            *sigma = if x.is_nan() { f32::NAN } else { predicted };
        }
        each(y, AdaptiveRow { x: n.x, y: n.y, z: n.z, sigma });
    })
}

/// Predicted error of a cross at depth `z` metres: a slope from one pixel either side has half a pixel's variance, and the
/// direction has two slopes. Relative to its value inverse depth is off by as much as depth.
#[inline(always)]
pub(super) fn predict<D: DepthSample>(noise: &DepthNoise, frame: &DepthFrame<'_, D>, z: f32) -> f32 {
    // What `f32` rounds of z is the floor. An inverse square root is plain arithmetic; a square root is a call.
    let variance = noise.variance::<D>(z, frame.unit()) + 9e-14 * z * z;
    focal(frame.intrinsics()) * variance * math::inv_sqrt_fast(variance) / z
}

/// One focal length for both axes, pixels.
#[inline(always)]
pub(super) fn focal(k: &Intrinsics) -> f32 {
    0.5 * (k.fx().abs() + k.fy().abs())
}
