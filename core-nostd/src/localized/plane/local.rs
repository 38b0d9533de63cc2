//! Plane sums for a device: near a plane that is roughly known, in `f32`.
//!
//! A Cortex-M4F has no `f64`: one point added to a [`PlaneSum`] takes it 1,300 instructions. Here the points are written in the rough
//! plane's own axes, from the first point on. Distances from the plane are then small numbers, and what rounding takes from their
//! products is small beside them, where in the camera's axes it is small beside the width of the floor squared. So `f32` products
//! do, summed 32 at a time and each sum added to an `f64`.
//!
//! Error: of points 4 m wide, within 0.01 rad of the rough plane, a normal within 1e-6 rad of [`PlaneSum`]'s and an rms within 1 µm of
//! its (held by a test); so who wants that fits twice. Memory: 168 bytes.

use glam::Vec3;

use super::eigen::Symmetric;
use super::{PlaneError, PlaneEstimate, PlaneSum};
use crate::ground::geometry::Plane;

/// Points whose products are summed in `f32`.
const BATCH: u32 = 32;

/// Below this share of the largest the second variance is rounding, and the points lie on a line.
const THIN: f64 = 1e-6;

pub(crate) struct LocalSum {
    axes: [Vec3; 3],
    origin: Vec3,
    batch: [f32; 9],
    waiting: u32,
    count: u32,
    sums: [f64; 9],
}

impl LocalSum {
    /// No points, near a plane of this unit normal.
    pub(crate) fn new(normal: Vec3) -> Self {
        let (a, b) = normal.any_orthonormal_pair();
        Self { axes: [a, b, normal], origin: Vec3::ZERO, batch: [0.0; 9], waiting: 0, count: 0, sums: [0.0; 9] }
    }

    /// Adds a finite point (metres).
    #[inline]
    pub(crate) fn add(&mut self, point: Vec3) {
        if self.count == 0 {
            self.origin = point;
        }
        let from = point - self.origin;
        let [x, y, z] = self.axes.map(|a| from.dot(a));
        for (sum, term) in self.batch.iter_mut().zip([x, y, z, x * x, y * y, z * z, x * y, x * z, y * z]) {
            *sum += term;
        }
        self.count = self.count.saturating_add(1);
        self.waiting += 1;
        if self.waiting == BATCH {
            self.gather();
        }
    }

    #[inline(never)]
    fn gather(&mut self) {
        for (sum, batch) in self.sums.iter_mut().zip(&mut self.batch) {
            *sum += f64::from(*batch);
            *batch = 0.0;
        }
        self.waiting = 0;
    }

    /// As [`PlaneSum::fit`].
    pub(crate) fn fit(mut self, side: Vec3) -> Result<PlaneEstimate, PlaneError> {
        self.gather();
        let [x, y, z, xx, yy, zz, xy, xz, yz] = self.sums;
        let sum = PlaneSum {
            reference: Vec3::ZERO,
            count: self.count,
            weight: f64::from(self.count),
            first: [x, y, z],
            second: Symmetric { xx, yy, zz, xy, xz, yz },
        };
        let fit = sum.fit_wider(Vec3::from(self.axes.map(|a| a.dot(side))), THIN)?;
        let [a, b, c] = self.axes;
        let turned = |v: Vec3| a * v.x + b * v.y + c * v.z;
        let centroid = self.origin + turned(fit.centroid);
        let normal = turned(fit.plane.normal());
        let plane = Plane::through(centroid, normal).ok_or(PlaneError::Collinear)?;
        Ok(PlaneEstimate { plane, centroid, axes: fit.axes.map(turned), ..fit })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, vec3};
    use proptest::prelude::*;

    proptest! {
        /// The same plane as the sums in `f64` give, wherever the rough plane is.
        #[test]
        fn as_good_as_double_precision(
            axis in proptest::array::uniform3(-1.0_f32..1.0), angle in -3.0_f32..3.0, lean in -0.01_f32..0.01,
            at in proptest::array::uniform3(-5.0_f32..5.0), seed in 1_u32.., n in 4_usize..3000, noise in 1e-3_f32..0.05,
        ) {
            let q = Quat::from_axis_angle(Vec3::from(axis).try_normalize().unwrap_or(Vec3::X), angle);
            let mut s = seed;
            let mut next = || { s ^= s << 13; s ^= s >> 17; s ^= s << 5; s as f32 / u32::MAX as f32 - 0.5 };
            let rough = q * vec3(lean, -lean, 1.0).normalize_or(Vec3::Z);
            let (mut sum, mut local) = (PlaneSum::new(), LocalSum::new(rough));
            for _ in 0..n {
                let p = Vec3::from(at) + q * vec3(4.0 * next(), 2.0 * next(), noise * next());
                sum.add(p);
                local.add(p);
            }
            // Few points may lie nearly on a line.
            let (Ok(want), Ok(got)) = (sum.fit(q * Vec3::Z), local.fit(q * Vec3::Z)) else { return Ok(()) };
            prop_assume!(want.spread[1] > 0.1 && want.rms > 1e-4);
            prop_assert!((want.plane.normal() - got.plane.normal()).length() < 1e-6, "{want:?} {got:?}");
            prop_assert!((want.rms - got.rms).abs() < 1e-6, "{want:?} {got:?}");
            prop_assert!((want.offset_sigma - got.offset_sigma).abs() < 1e-6);
            prop_assert!((want.centroid - got.centroid).length() < 3e-6);
            prop_assert!(want.plane.distance(got.centroid).abs() < 2e-6 && want.support == got.support);
            prop_assert!((want.spread[0] / got.spread[0] - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn lines_and_single_places_are_no_planes() {
        let mut line = LocalSum::new(Vec3::Y);
        assert_eq!(LocalSum::new(Vec3::Y).fit(Vec3::Y), Err(PlaneError::TooFew { got: 0 }));
        (0..100).for_each(|i| line.add(vec3(1.0, 2.0, 3.0) + vec3(0.3, -0.7, 0.11) * i as f32 * 0.01));
        assert_eq!(line.fit(Vec3::Y), Err(PlaneError::Collinear));
        let mut same = LocalSum::new(Vec3::Y);
        (0..50).for_each(|_| same.add(Vec3::ONE));
        assert_eq!(same.fit(Vec3::Y), Err(PlaneError::Collinear));
        let mut huge = LocalSum::new(Vec3::Y);
        [Vec3::ZERO, Vec3::MAX, Vec3::MIN, Vec3::X].into_iter().for_each(|p| huge.add(p));
        let _ = huge.fit(Vec3::Y);
        assert_eq!(size_of::<LocalSum>(), 168);
    }
}
