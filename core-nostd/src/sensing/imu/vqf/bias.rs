//! The gyroscope's bias, by a Kalman filter that learns at rest and in motion (Laidig and Seel 2023, section 3.5).
//!
//! At rest the smoothed gyroscope reads the bias on all three axes. In motion, the correction that gravity demands of the inclination is the bias
//! as it would be seen in the horizontal axes of the earth's frame, delayed as gravity is by its low-pass; so the rotation
//! and the rotated estimate go through the same low-pass, and the difference is a measurement. About the vertical nothing is seen; a measurement of
//! zero with a variance ten thousand times as large keeps that axis from growing.
//!
//! The paper inverts a 3x3 matrix. The three measurement errors are independent, so the axes are taken one after the other here: the same estimate with three
//! divisions, and a symmetric matrix of six numbers.

use glam::Vec3;

use crate::ground::math;

/// Bias (rad/s) and its covariance (rad^2/s^2): xx, xy, xz, yy, yz, zz.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bias {
    pub(super) value: Vec3,
    covariance: [f32; 6],
}

impl Bias {
    pub(super) const fn new(value: Vec3, variance: f32) -> Self {
        Self { value, covariance: [variance, 0.0, 0.0, variance, 0.0, variance] }
    }

    /// Time passes: each variance that is below `limit` grows.
    #[inline]
    pub(super) fn wander(&mut self, by: f32, limit: f32) {
        let [xx, _, _, yy, _, zz] = &mut self.covariance;
        for v in [xx, yy, zz] {
            if *v < limit {
                *v = math::min(*v + by, limit);
            }
        }
    }

    /// Learns from R b = y with rows R, the differences y - R b before this call, and the variances of their errors, each above 0.
    #[inline]
    pub(super) fn learn(&mut self, rows: [Vec3; 3], off: [f32; 3], noise: [f32; 3]) {
        let before = self.value;
        for ((row, off), noise) in rows.into_iter().zip(off).zip(noise) {
            let [xx, xy, xz, yy, yz, zz] = self.covariance;
            let pr = Vec3::new(
                xx * row.x + xy * row.y + xz * row.z,
                xy * row.x + yy * row.y + yz * row.z,
                xz * row.x + yz * row.y + zz * row.z,
            );
            let gain = pr / (row.dot(pr) + noise);
            self.value += gain * (off - row.dot(self.value - before));
            self.covariance = [
                math::max(xx - gain.x * pr.x, 0.0),
                xy - gain.x * pr.y,
                xz - gain.x * pr.z,
                math::max(yy - gain.y * pr.y, 0.0),
                yz - gain.y * pr.z,
                math::max(zz - gain.z * pr.z, 0.0),
            ];
        }
    }

    /// Standard deviation on the axis known worst, rad/s: an upper bound by the rows of the covariance, as in the reference implementation.
    pub(super) fn sigma(&self) -> f32 {
        let [xx, xy, xz, yy, yz, zz] = self.covariance;
        let rows = [xx.abs() + xy.abs() + xz.abs(), xy.abs() + yy.abs() + yz.abs(), xz.abs() + yz.abs() + zz.abs()];
        math::sqrt(rows.into_iter().fold(0.0, math::max))
    }
}
