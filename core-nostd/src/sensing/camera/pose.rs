//! Where the camera stands: a rigid camera-to-world transform (DepthLab Eq. 2; its inverse opens Eq. 3).

use core::fmt;

use glam::{Mat3, Mat4, Quat, Vec3};

use crate::ground::geometry::unit;
use crate::ground::rotation::{self, rotate, rotate_back};

/// Camera-to-world: rotation, then translation (metres). 28 bytes. Always rigid: it can't be built otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    rotation: Quat,
    translation: Vec3,
}

/// Why numbers are not a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum PoseError {
    /// A number is NaN or infinite.
    NotFinite,
    /// The quaternion's length is not 1 (to 1 %).
    NotUnitQuaternion {
        /// Its length.
        length: f32,
    },
    /// The 3 x 3 part is not a rotation: it scales, shears or mirrors (beyond 1 %).
    NotRotation {
        /// Its determinant (1 for a rotation, -1 for a mirror).
        determinant: f32,
    },
    /// The last row of the 4 x 4 matrix is not 0 0 0 1.
    NotAffine,
}

impl fmt::Display for PoseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => write!(f, "pose holds a number that is NaN or infinite"),
            Self::NotUnitQuaternion { length } => write!(
                f,
                "pose quaternion has length {length}, not 1; check the order of its components (isobath: x y z w)"
            ),
            Self::NotRotation { determinant } => write!(
                f,
                "pose matrix is not a rotation (determinant {determinant}); mirrored axes are a matter of convention, scale is not allowed"
            ),
            Self::NotAffine => write!(f, "pose matrix does not end in the row 0 0 0 1; it may be transposed"),
        }
    }
}

impl core::error::Error for PoseError {}

impl Pose {
    /// The camera frame is the world frame.
    pub const IDENTITY: Self = Self { rotation: Quat::IDENTITY, translation: Vec3::ZERO };

    /// From a rotation and the camera's position in the world (metres). The quaternion is normalised when within 1 % of
    /// unit length, as text files round it.
    ///
    /// # Errors
    /// [`PoseError`] when a number is not finite or the quaternion's length is not 1.
    pub fn new(rotation: Quat, translation: Vec3) -> Result<Self, PoseError> {
        if !rotation.is_finite() || !translation.is_finite() {
            return Err(PoseError::NotFinite);
        }
        let length = rotation::length(rotation);
        if !((length - 1.0).abs() <= 0.01) {
            return Err(PoseError::NotUnitQuaternion { length });
        }
        Ok(Self { rotation: rotation::unit(rotation), translation })
    }

    /// From a 4 x 4 camera-to-world matrix (column vectors; glam stores columns). Rounding up to 1 % is removed.
    ///
    /// # Errors
    /// [`PoseError`] when the matrix is not a rigid transform.
    pub fn from_matrix(m: Mat4) -> Result<Self, PoseError> {
        if !m.is_finite() {
            return Err(PoseError::NotFinite);
        }
        let last = m.row(3);
        if !(last.truncate().length() < 1e-3 && (last.w - 1.0).abs() < 1e-3) {
            return Err(PoseError::NotAffine);
        }
        let r = Mat3::from_mat4(m);
        let determinant = r.determinant();
        let gram = r.transpose() * r;
        let off =
            (gram.x_axis - Vec3::X).length() + (gram.y_axis - Vec3::Y).length() + (gram.z_axis - Vec3::Z).length();
        if !((determinant - 1.0).abs() <= 0.01 && off <= 0.03) {
            return Err(PoseError::NotRotation { determinant });
        }
        Self::new(Quat::from_mat3(&r), m.w_axis.truncate())
    }

    /// Looking from `eye` towards `target`, image top towards `up` (all world, metres); `None` when they leave no direction.
    #[must_use]
    pub fn looking_at(eye: Vec3, target: Vec3, up: Vec3) -> Option<Self> {
        let z = unit(target - eye)?;
        // Camera y points down.
        let x = unit(z.cross(up))?;
        let y = z.cross(x);
        Self::new(Quat::from_mat3(&Mat3::from_cols(x, y, z)), eye).ok()
    }

    /// Rotation, camera to world.
    #[must_use]
    pub const fn rotation(&self) -> Quat {
        self.rotation
    }

    /// The camera's position in the world, metres.
    #[must_use]
    pub const fn translation(&self) -> Vec3 {
        self.translation
    }

    /// As a 4 x 4 camera-to-world matrix.
    #[must_use]
    pub fn matrix(&self) -> Mat4 {
        Mat4::from_rotation_translation(self.rotation, self.translation)
    }

    /// A camera-space point in the world (Eq. 2).
    #[inline]
    #[must_use]
    pub fn to_world(&self, point: Vec3) -> Vec3 {
        rotate(self.rotation, point) + self.translation
    }

    /// A world point in camera space. The subtraction comes first, so a camera far from the origin costs no digits.
    #[inline]
    #[must_use]
    pub fn to_camera(&self, point: Vec3) -> Vec3 {
        rotate_back(self.rotation, point - self.translation)
    }

    /// A camera-space direction in the world.
    #[inline]
    #[must_use]
    pub fn direction_to_world(&self, direction: Vec3) -> Vec3 {
        rotate(self.rotation, direction)
    }

    /// A world direction in camera space.
    #[inline]
    #[must_use]
    pub fn direction_to_camera(&self, direction: Vec3) -> Vec3 {
        rotate_back(self.rotation, direction)
    }

    /// World-to-camera, as a pose. Far from the origin its translation is rounded (0.5 mm an axis at 10 km):
    /// [`Self::to_camera`] and [`Self::relative_to`] subtract first and have no such error.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let [x, y, z] = rotation::rotate_back_exactly(self.rotation, self.translation);
        Self { rotation: self.rotation.conjugate(), translation: Vec3::new(-x as f32, -y as f32, -z as f32) }
    }

    /// This pose seen from `reference`: camera to reference camera. As `reference.inverse().compose(self)`, but exact to
    /// the distance between the two, not to their distance from the world's origin.
    ///
    /// ```
    /// use glam::{Quat, Vec3};
    /// use isobath::sensing::camera::Pose;
    /// let reference = Pose::new(Quat::from_xyzw(0.6, 0.0, 0.0, 0.8), Vec3::splat(10_000.0))?;
    /// let next = Pose::new(Quat::from_xyzw(0.6, 0.0, 0.0, 0.8), Vec3::splat(10_000.0) + Vec3::X)?;
    /// assert!((next.relative_to(&reference).translation() - Vec3::X).length() < 1e-6);
    /// # Ok::<(), isobath::sensing::camera::pose::PoseError>(())
    /// ```
    #[must_use]
    pub fn relative_to(&self, reference: &Self) -> Self {
        Self {
            rotation: rotation::unit(rotation::product(reference.rotation.conjugate(), self.rotation)),
            translation: reference.to_camera(self.translation),
        }
    }

    /// First `inner`, then `self`.
    #[must_use]
    pub fn compose(&self, inner: &Self) -> Self {
        Self {
            // Renormalised, so that long chains stay rigid.
            rotation: rotation::unit(rotation::product(self.rotation, inner.rotation)),
            translation: self.to_world(inner.translation),
        }
    }
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_not_rigid_is_refused() {
        let zero = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        assert_eq!(Pose::new(zero, Vec3::ZERO), Err(PoseError::NotUnitQuaternion { length: 0.0 }));
        assert_eq!(Pose::new(Quat::IDENTITY * 2.0, Vec3::ZERO), Err(PoseError::NotUnitQuaternion { length: 2.0 }));
        assert_eq!(Pose::new(Quat::IDENTITY, Vec3::NAN), Err(PoseError::NotFinite));
        assert!(Pose::new(Quat::IDENTITY * 1.005, Vec3::ZERO).is_ok(), "text rounding is forgiven");

        let mirror = Mat4::from_scale(Vec3::new(1.0, -1.0, 1.0));
        assert_eq!(Pose::from_matrix(mirror), Err(PoseError::NotRotation { determinant: -1.0 }));
        let shear = Mat4::from_cols_array(&[1., 0., 0., 0., 0.5, 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]);
        assert!(matches!(Pose::from_matrix(shear), Err(PoseError::NotRotation { .. })));
        let transposed = Mat4::from_translation(Vec3::ONE).transpose();
        assert_eq!(Pose::from_matrix(transposed), Err(PoseError::NotAffine));
        assert_eq!(Pose::from_matrix(Mat4::NAN), Err(PoseError::NotFinite));
    }

    #[test]
    fn looking_at_puts_the_target_on_the_axis() {
        let pose = Pose::looking_at(Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.0, 0.0, 3.0), Vec3::Z).unwrap();
        assert!((pose.to_camera(Vec3::new(1.0, 0.0, 3.0)) - Vec3::new(0.0, 0.0, 2.0)).length() < 1e-6);
        // World up is image up: negative camera y.
        assert!((pose.direction_to_camera(Vec3::Z) + Vec3::Y).length() < 1e-6);
        assert_eq!(Pose::looking_at(Vec3::ZERO, Vec3::ZERO, Vec3::Y), None);
        assert_eq!(Pose::looking_at(Vec3::ZERO, Vec3::Y, Vec3::Y), None);
    }

    proptest! {
        #[test]
        fn there_and_back(axis in proptest::array::uniform3(-1.0_f32..1.0), angle in -3.0_f32..3.0,
                          t in proptest::array::uniform3(-10.0_f32..10.0), p in proptest::array::uniform3(-10.0_f32..10.0)) {
            let axis = Vec3::from(axis).try_normalize().unwrap_or(Vec3::X);
            let pose = Pose::new(Quat::from_axis_angle(axis, angle), Vec3::from(t)).unwrap();
            let p = Vec3::from(p);
            prop_assert!((pose.to_camera(pose.to_world(p)) - p).length() < 2e-5);
            prop_assert!((pose.inverse().to_world(pose.to_world(p)) - p).length() < 2e-5);
            prop_assert!((pose.compose(&pose.inverse()).to_world(p) - p).length() < 2e-5);
            prop_assert!((Pose::from_matrix(pose.matrix()).unwrap().to_world(p) - pose.to_world(p)).length() < 2e-5);
        }
    }
}
