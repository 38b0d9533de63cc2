//! Lens distortion: Brown-Conrady with 5 or 8 coefficients, OpenCV's order and meaning.
//!
//! x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) + 2 p1 x y + p2 (r² + 2 x²), y' alike with p1 and p2
//! exchanged (Brown 1966; OpenCV `calib3d`). The inverse is Newton's method on the full two-variable map with its exact
//! Jacobian; where the lens model folds over itself there is no inverse, and the answer is `None`, not a wrong ray.
//!
//! The algorithms of this crate see pinhole depth: a distorted sensor is straightened once, by
//! [`rectify`](crate::sensing::camera::rectify).

use glam::{Vec2, Vec3};

use crate::sensing::camera::Intrinsics;

/// A lens model, in normalised coordinates (x/z, y/z).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Distortion {
    /// A perfect pinhole.
    #[default]
    None,
    /// k1, k2, p1, p2, k3.
    Brown5([f32; 5]),
    /// k1, k2, p1, p2, k3, k4, k5, k6 (rational).
    Brown8([f32; 8]),
}

/// Newton steps tried; real lenses need 3 to 5.
const MAX_STEPS: usize = 20;

impl Distortion {
    /// Coefficients in the common order, missing ones zero.
    const fn coefficients(&self) -> [f32; 8] {
        match *self {
            Self::None => [0.0; 8],
            Self::Brown5([k1, k2, p1, p2, k3]) => [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0],
            Self::Brown8(k) => k,
        }
    }

    /// Whether the model changes nothing.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.coefficients().iter().all(|&k| k == 0.0)
    }

    /// From a list of 0, 4, 5 or 8 coefficients (as calibration files give them); `None` for any other length or for
    /// numbers that are not finite.
    #[must_use]
    pub fn from_slice(k: &[f32]) -> Option<Self> {
        if !k.iter().all(|v| v.is_finite()) {
            return None;
        }
        match *k {
            [] => Some(Self::None),
            [k1, k2, p1, p2] => Some(Self::Brown5([k1, k2, p1, p2, 0.0])),
            [k1, k2, p1, p2, k3] => Some(Self::Brown5([k1, k2, p1, p2, k3])),
            [k1, k2, p1, p2, k3, k4, k5, k6] => Some(Self::Brown8([k1, k2, p1, p2, k3, k4, k5, k6])),
            _ => None,
        }
    }

    /// Where the lens puts a ray: normalised in, normalised out.
    #[must_use]
    pub fn distort(&self, n: Vec2) -> Vec2 {
        match self {
            Self::None => n,
            _ => self.with_jacobian(n).0,
        }
    }

    /// The ray that the lens puts at `d`; `None` when there is none (the model folds, or `d` is not finite).
    #[must_use]
    pub fn undistort(&self, d: Vec2) -> Option<Vec2> {
        if matches!(self, Self::None) {
            return d.is_finite().then_some(d);
        }
        let mut n = d;
        let mut previous = f32::INFINITY;
        for _ in 0..MAX_STEPS {
            let (value, [a, b, c, e]) = self.with_jacobian(n);
            let residual = value - d;
            let det = a * e - b * c;
            // Positive on the branch that holds the image centre; past the fold it changes sign.
            if !(det > 1e-6) {
                return None;
            }
            let step = Vec2::new(e * residual.x - b * residual.y, a * residual.y - c * residual.x) / det;
            // A long first step on a strong lens can jump over the fold: never more than half a unit at a time.
            let n_next = n - step.clamp_length_max(0.5);
            // Near the solution each step is the square of the last, until rounding: a small step that no longer shrinks
            // is rounding.
            let length = step.length() / (1.0 + n.length());
            if length <= 1e-7 || (length < 1e-5 && length > 0.5 * previous) {
                return n_next.is_finite().then_some(n_next);
            }
            previous = length;
            n = n_next;
        }
        None
    }

    /// The distorted point and its derivatives [dx'/dx, dx'/dy, dy'/dx, dy'/dy].
    fn with_jacobian(&self, n: Vec2) -> (Vec2, [f32; 4]) {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.coefficients();
        let (x, y) = (n.x, n.y);
        let r2 = x * x + y * y;
        let top = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let bottom = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let s = top / bottom;
        // ds/d(r2)
        let top_d = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let bottom_d = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
        let ds = (top_d - s * bottom_d) / bottom;
        let value = Vec2::new(
            x * s + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * s + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * x * y * ds + 2.0 * (p1 * x + p2 * y);
        let xx = s + 2.0 * x * x * ds + 2.0 * p1 * y + 6.0 * p2 * x;
        let yy = s + 2.0 * y * y * ds + 6.0 * p1 * y + 2.0 * p2 * x;
        (value, [xx, cross, cross, yy])
    }
}

/// A pinhole with a lens in front: what a calibration gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// The pinhole.
    pub intrinsics: Intrinsics,
    /// The lens.
    pub distortion: Distortion,
}

impl Camera {
    /// A camera without distortion.
    #[must_use]
    pub const fn pinhole(intrinsics: Intrinsics) -> Self {
        Self { intrinsics, distortion: Distortion::None }
    }

    /// The pixel that sees a camera-space point (metres); `None` when it is not in front of the camera.
    #[must_use]
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        if !(point.z > 0.0) {
            return None;
        }
        let d = self.distortion.distort(Vec2::new(point.x / point.z, point.y / point.z));
        self.intrinsics.project(d.extend(1.0))
    }

    /// The ray (z = 1) through a pixel of the distorted image; `None` where the lens model has no inverse.
    #[must_use]
    pub fn ray(&self, pixel: Vec2) -> Option<Vec3> {
        let d = self.intrinsics.ray(pixel);
        self.distortion.undistort(d.truncate()).map(|n| n.extend(1.0))
    }

    /// The camera-space point at depth `z` metres behind a pixel of the distorted image.
    #[must_use]
    pub fn unproject(&self, pixel: Vec2, z: f32) -> Option<Vec3> {
        self.ray(pixel).map(|ray| ray * z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The published formula in f64.
    fn oracle(k: [f32; 8], x: f64, y: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = k.map(f64::from);
        let r2 = x * x + y * y;
        let s =
            (1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3)) / (1.0 + k4 * r2 + k5 * r2.powi(2) + k6 * r2.powi(3));
        (x * s + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * s + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y)
    }

    /// Kinect v1 colour, a wide rational lens (Azure Kinect's shape), and a mild barrel.
    const LENSES: [[f32; 8]; 3] = [
        [0.2624, -0.9531, -0.0054, 0.0026, 1.1633, 0.0, 0.0, 0.0],
        [2.5, 1.4, 0.0003, -0.0002, 0.08, 2.83, 2.1, 0.38],
        [-0.28, 0.07, 0.0002, 0.00002, 0.0, 0.0, 0.0, 0.0],
    ];

    proptest! {
        #[test]
        fn matches_the_formula_and_inverts(which in 0_usize..3, x in -0.62_f32..0.62, y in -0.47_f32..0.47) {
            let k = LENSES[which];
            let lens = Distortion::Brown8(k);
            let d = lens.distort(Vec2::new(x, y));
            let (ox, oy) = oracle(k, f64::from(x), f64::from(y));
            prop_assert!((f64::from(d.x) - ox).abs() < 2e-6 && (f64::from(d.y) - oy).abs() < 2e-6);
            let back = lens.undistort(d).unwrap();
            // 1e-4 px at f = 520 px is 2e-7; the f32 rounding of d itself is 3e-8.
            prop_assert!((back - Vec2::new(x, y)).length() * 520.0 < 4e-4, "{back}");
        }

        #[test]
        fn any_numbers_give_an_answer(k in proptest::array::uniform8(proptest::num::f32::ANY),
                                      x in proptest::num::f32::ANY, y in proptest::num::f32::ANY) {
            let lens = Distortion::Brown8(k);
            let _ = lens.distort(Vec2::new(x, y));
            if let Some(n) = lens.undistort(Vec2::new(x, y)) {
                prop_assert!(n.is_finite());
            }
        }
    }

    #[test]
    fn beyond_the_fold_there_is_no_ray() {
        // r (1 - r²/2) peaks at r = sqrt(2/3) with 0.544: nothing is seen farther out than that.
        let lens = Distortion::Brown5([-0.5, 0.0, 0.0, 0.0, 0.0]);
        assert!(lens.undistort(Vec2::new(0.5, 0.0)).is_some());
        assert_eq!(lens.undistort(Vec2::new(0.6, 0.0)), None);
        assert_eq!(lens.undistort(Vec2::new(f32::NAN, 0.0)), None);
    }

    #[test]
    fn lists_of_the_usual_lengths_are_lenses() {
        assert_eq!(Distortion::from_slice(&[]), Some(Distortion::None));
        assert_eq!(Distortion::from_slice(&[0.1; 4]), Some(Distortion::Brown5([0.1, 0.1, 0.1, 0.1, 0.0])));
        assert!(Distortion::from_slice(&[0.1; 8]).is_some());
        assert_eq!(Distortion::from_slice(&[0.1; 3]), None);
        assert_eq!(Distortion::from_slice(&[f32::NAN; 5]), None);
        assert!(Distortion::Brown5([0.0; 5]).is_none());
    }
}
