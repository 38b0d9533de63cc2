//! Which way does the surface face? Normals from depth (DepthLab, "Computing Normal Vectors", Algorithm 1, and better).
//!
//! Two methods, each dense (every pixel, row by row) and for a single point, from the same kernel:
//!
//! * [`NormalMethod::Exact`] (the default). On a plane, *inverse* depth is linear in pixel coordinates, 1/z = a u + b v + c,
//!   with normal ~ (fx a, fy b, c + cx a + cy b). The kernel takes a and b per pixel from the side of least curvature, out
//!   of three pixels to the left, around, or to the right (above, around, below): an edge on one side does not reach the
//!   estimate. Exact on planes at any tilt, anywhere in the image, up to `f32` rounding (held by tests: 0.05 degrees at
//!   75 degrees of tilt; measured worst: 0.02).
//! * [`NormalMethod::Paper`]. Algorithm 1, repaired (signed differences, invalid neighbours skipped, each count guarded, x
//!   and y not swapped, unit length). Its weak perspective is 8 degrees off at 30 pixels from the centre on a 45 degree plane
//!   at f = 120; it is here to compare with.
//!
//! Normals are in the camera frame, unit length, facing the camera. A pixel without a reading has no normal. On noisy
//! sensors a single point wants a wider fit: [`NormalParams::radius`] adds a two-variable least-squares fit of inverse depth
//! over the pixels that belong to the same surface.
//!
//! Memory: none for single points; dense, [`dense::scratch_len`] floats (6.5 kB at 160 pixels of width). Cost at radius 0: about
//! 3 ns a pixel dense (x86-64 baseline, one core; 2 with AVX2), 40 ns for a single point; 0.7 µs for a single 11 x 11 fit.

pub mod adaptive;
pub mod dense;
mod exact;
mod fit;
mod paper;

use glam::Vec3;

use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// How a normal is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum NormalMethod {
    /// From inverse depth, choosing sides: exact on planes.
    #[default]
    Exact,
    /// DepthLab's Algorithm 1, repaired.
    Paper,
}

/// Parameters of normal estimation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalParams {
    /// Method. Default exact.
    pub method: NormalMethod,
    /// Pixels around the centre that are fitted. Exact: 0 (default) takes the five-pixel cross alone; 1 to
    /// [`MAX_RADIUS`] adds the least-squares fit over (2 radius + 1)² pixels. Paper: its r, 1 to [`MAX_RADIUS`], 0 means the paper's 2.
    pub radius: u8,
    /// A neighbour that differs from the centre by more than this share belongs to another surface. Exact fit: of inverse
    /// depth, per pixel of distance; default what a surface at 80 degrees to the line of sight changes by. Paper: of depth,
    /// at any distance; default 0.2 (the published code's value). `None`, the default, takes those.
    pub max_step: Option<f32>,
}

/// Largest [`NormalParams::radius`].
pub const MAX_RADIUS: u8 = 7;

impl Default for NormalParams {
    fn default() -> Self {
        Self { method: NormalMethod::Exact, radius: 0, max_step: None }
    }
}

impl NormalParams {
    /// For single points on a real sensor: the exact method fitted over 11 x 11 pixels. About 0.7 µs.
    pub const POINT: Self = Self { method: NormalMethod::Exact, radius: 5, max_step: None };
    /// The paper's Algorithm 1.
    pub const PAPER: Self = Self { method: NormalMethod::Paper, radius: 2, max_step: None };
}

/// A normal and how far to trust it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalEstimate {
    /// Unit normal in the camera frame, facing the camera.
    pub normal: Vec3,
    /// Readings it rests on, the centre included: 3 to 5 for the cross, up to (2 radius + 1)² for the fit.
    pub support: u16,
    /// RMS distance of those readings from the fitted surface along z, in metres (for the cross: from straight lines).
    pub residual: f32,
}

/// The normal at pixel `(x, y)`; `None` outside the image, in a hole, or where too few neighbours have readings.
///
/// ```
/// use isobath::localized::normals::{normal_at, NormalParams};
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// let wall = DepthArray::<160, 120>::filled(2000);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let frame = DepthFrame::new(wall.view(), DepthUnit::MILLIMETRE, k);
/// let estimate = normal_at(&frame, 10, 100, &NormalParams::default()).unwrap();
/// assert!((estimate.normal - glam::Vec3::NEG_Z).length() < 1e-6); // faces the camera
/// assert_eq!(estimate.residual, 0.0);
/// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
/// ```
#[must_use]
pub fn normal_at<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    params: &NormalParams,
) -> Option<NormalEstimate> {
    if x >= frame.size().0 || y >= frame.size().1 {
        return None;
    }
    match params.method {
        NormalMethod::Exact if params.radius > 0 => {
            // Where the fit finds no plane, the cross may still find one (a thin strip).
            fit::at(frame, x, y, params.radius, params.max_step).or_else(|| exact::at(frame, x, y))
        }
        NormalMethod::Exact => exact::at(frame, x, y),
        NormalMethod::Paper => paper::at(frame, x, y, params),
    }
}

/// Turns the gradient (a, b) of inverse depth at offset (x - cx, y - cy) into a unit normal facing the camera; NaN in, NaN out.
///
/// n ~ -(fx a, fy b, w - a (x - cx) - b (y - cy)): the bracket's product with the viewing ray is w > 0, so minus it faces us.
#[inline(always)]
fn facing(w: f32, a: f32, b: f32, dx: f32, dy: f32, fx: f32, fy: f32) -> [f32; 3] {
    let nx = -fx * a;
    let ny = -fy * b;
    let nz = a * dx + b * dy - w;
    let scale = crate::ground::math::inv_sqrt_fast(nx * nx + ny * ny + nz * nz);
    [nx * scale, ny * scale, nz * scale]
}

#[cfg(test)]
mod tests;
