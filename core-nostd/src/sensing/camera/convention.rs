//! Other engines' axes, to and from ours (right-handed; camera x right, y down, z forward).
//!
//! | convention | camera axes | world | handedness |
//! |---|---|---|---|
//! | OpenCV, ROS optical, TUM, Open3D | x right, y down, z forward | any | right |
//! | OpenGL, ARKit, ARCore, OpenXR | x right, y up, z backward | y up | right |
//! | Unity | x right, y up, z forward | y up | left |
//!
//! An OpenGL world is right-handed already and is kept as it is: only the camera axes turn. A Unity world is mirrored
//! (z changes sign), because a left-handed frame can't be turned into a right-handed one.

use glam::{Mat3, Mat4, Vec3};

use crate::sensing::camera::pose::{Pose, PoseError};

/// Whose axes a pose or a point is given in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Convention {
    /// OpenCV, ROS optical frames, TUM RGB-D, Open3D: ours.
    #[default]
    OpenCv,
    /// OpenGL, ARKit, ARCore, OpenXR.
    OpenGl,
    /// Unity.
    Unity,
}

impl Convention {
    /// Signs that take camera axes of this convention to ours, and back.
    const fn camera_signs(self) -> Vec3 {
        match self {
            Self::OpenCv => Vec3::ONE,
            Self::OpenGl => Vec3::new(1.0, -1.0, -1.0),
            Self::Unity => Vec3::new(1.0, -1.0, 1.0),
        }
    }

    /// Signs that take world axes of this convention to a right-handed world, and back.
    const fn world_signs(self) -> Vec3 {
        match self {
            Self::OpenCv | Self::OpenGl => Vec3::ONE,
            Self::Unity => Vec3::new(1.0, 1.0, -1.0),
        }
    }

    /// A camera-space point or direction of this convention, in ours. The same function goes back.
    #[must_use]
    pub fn camera_point(self, p: Vec3) -> Vec3 {
        p * self.camera_signs()
    }

    /// A world point or direction of this convention, in our right-handed world. The same function goes back.
    #[must_use]
    pub fn world_point(self, p: Vec3) -> Vec3 {
        p * self.world_signs()
    }

    /// Which way is up in the (converted) world: +y for OpenGL and Unity; OpenCV worlds are often the first camera's frame, where
    /// it is -y.
    #[must_use]
    pub const fn usual_up(self) -> Vec3 {
        match self {
            Self::OpenCv => Vec3::NEG_Y,
            Self::OpenGl | Self::Unity => Vec3::Y,
        }
    }

    /// A camera-to-world matrix of this convention as a [`Pose`].
    ///
    /// # Errors
    /// [`PoseError`] when the matrix is not rigid.
    ///
    /// ```
    /// use glam::{Mat4, Vec3};
    /// use isobath::sensing::camera::convention::Convention;
    /// // An ARKit camera at the origin looks along -z of its world.
    /// let pose = Convention::OpenGl.pose_from_matrix(Mat4::IDENTITY)?;
    /// assert_eq!(pose.to_world(Vec3::Z), Vec3::NEG_Z);
    /// # Ok::<(), isobath::sensing::camera::pose::PoseError>(())
    /// ```
    pub fn pose_from_matrix(self, m: Mat4) -> Result<Pose, PoseError> {
        Pose::from_matrix(self.flip(m))
    }

    /// A [`Pose`] as the camera-to-world matrix of this convention.
    #[must_use]
    pub fn matrix_from_pose(self, pose: &Pose) -> Mat4 {
        self.flip(pose.matrix())
    }

    /// Both flips are their own inverse, so one function serves both ways.
    fn flip(self, m: Mat4) -> Mat4 {
        let world = Mat4::from_mat3(Mat3::from_diagonal(self.world_signs()));
        let camera = Mat4::from_mat3(Mat3::from_diagonal(self.camera_signs()));
        world * m * camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    #[test]
    fn round_trip_and_points_agree() {
        let pose = Pose::new(Quat::from_xyzw(0.1, -0.4, 0.3, 0.8).normalize(), Vec3::new(1.0, 2.0, 3.0)).unwrap();
        let p = Vec3::new(0.3, -0.2, 1.5);
        for c in [Convention::OpenCv, Convention::OpenGl, Convention::Unity] {
            let theirs = c.matrix_from_pose(&pose);
            let back = c.pose_from_matrix(theirs).unwrap();
            assert!((back.to_world(p) - pose.to_world(p)).length() < 1e-5, "{c:?}");
            // Their matrix on their camera point is their world point.
            let their_world = theirs.transform_point3(c.camera_point(p));
            assert!((c.world_point(their_world) - pose.to_world(p)).length() < 1e-5, "{c:?}");
        }
    }

    #[test]
    fn unity_cameras_look_along_plus_z() {
        let pose = Convention::Unity.pose_from_matrix(Mat4::IDENTITY).unwrap();
        // Forward is Unity +z, which is our world's -z; image down is world -y.
        assert_eq!(pose.to_world(Vec3::Z), Vec3::NEG_Z);
        assert_eq!(pose.to_world(Vec3::Y), Vec3::NEG_Y);
        assert!((pose.rotation().length() - 1.0).abs() < 1e-6);
    }
}
