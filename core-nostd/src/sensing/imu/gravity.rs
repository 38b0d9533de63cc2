//! Which way is up, how surely, and in whose frame.
//!
//! Ground estimation, height maps, the planner's maps, placement and the lighting maps all take `up` as an argument: in the world that the frame's pose
//! leads to. An inertial sensor knows up in its own frame. Between the two lie how it is mounted (sensor to camera, a constant of the device) and the pose:
//!
//! | the device has | give as pose | give as `up` |
//! |---|---|---|
//! | a tracker (poses in some world) | its pose | [`Gravity::in_world`] of that pose |
//! | nothing but the inertial sensor | [`camera_pose`] of the filter's orientation: no position, but level | [`Vec3::Z`], the filter's own |
//! | no use for poses (one frame at a time) | none: the camera's frame is the world | [`Gravity::in_camera`] |
//!
//! The floor below the camera, from one frame and the filter's gravity:
//!
//! ```
//! use isobath::glam::{Quat, Vec3, vec3};
//! use isobath::ground::image::Image;
//! use isobath::ground::units::Timestamp;
//! use isobath::localized::plane::ground::{GroundParams, estimate_ground};
//! use isobath::sensing::camera::Intrinsics;
//! use isobath::sensing::depth::DepthUnit;
//! use isobath::sensing::frame::DepthFrame;
//! use isobath::sensing::imu::vqf::{Vqf, VqfParams};
//! use isobath::sensing::imu::ImuSample;
//!
//! // The sensor's axes in the camera's: here its x points right, its y up, its z back, as on many phones.
//! let mounting = Quat::from_rotation_x(core::f32::consts::PI);
//! // The camera looks down by 40 degrees, from 1.4 m above a floor.
//! let up = vec3(0.0, -(0.6981_f32.cos()), -(0.6981_f32.sin()));
//!
//! // Readings come from the sensor's interrupt.
//! let mut filter = Vqf::new(VqfParams::DEFAULT)?;
//! for i in 0..600 {
//!     let force = mounting.inverse() * up * 9.81;
//!     filter.update(&ImuSample { time: Timestamp::from_nanos(i * 5_000_000), rate: Vec3::ZERO, force, field: None });
//! }
//!
//! // A frame arrives.
//! let camera = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
//! let mut depth = Image::<u16, 160, 120>::filled(0);
//! for (i, pixel) in depth.as_mut_slice().iter_mut().enumerate() {
//!     let ray = vec3(((i % 160) as f32 - 79.5) / 120.0, ((i / 160) as f32 - 59.5) / 120.0, 1.0);
//!     *pixel = if ray.dot(up) < -0.2 { (-1400.0 / ray.dot(up)) as u16 } else { 0 };
//! }
//! let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, camera);
//! let gravity = filter.gravity().ok_or("no reading yet")?;
//! let found = estimate_ground(&frame, gravity.in_camera(mounting), &GroundParams::DEFAULT)?;
//! assert!((found.fit.plane.offset().abs() - 1.4).abs() < 0.01 && found.tilt < 0.01);
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```
//!
//! Memory: 16 bytes. Cost: a turned vector or two. Error: [`Gravity::sigma`].

use glam::{Quat, Vec3};

use crate::ground::rotation::{product, rotate, unit};
use crate::sensing::camera::Pose;

/// The direction against gravity, and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gravity {
    /// Up in the sensor's frame, unit length.
    pub up: Vec3,
    /// Standard deviation of its direction, radians: root sum of squares of
    ///
    /// - the accelerometer's own offset ([`VqfParams::force_error`](super::vqf::VqfParams::force_error));
    /// - the drift that an unknown gyroscope bias makes while the low-pass lags (its standard deviation times the time constant);
    /// - what the low-pass lets through of the device's motion: its mean square distance from its own mean over four time constants;
    /// - in the first time constant (3 s), 0.1 radians, fading.
    ///
    /// On the BROAD recordings and in a simulated hand the true error is 0.5 to 1.5 times this in the root mean square; a test holds that. A steady acceleration of many seconds (a train
    /// that starts) is not in it: no inertial sensor can tell it from a tilt.
    pub sigma: f32,
}

impl Gravity {
    /// Up in the camera's frame. `mounting`, unit length, turns the sensor's axes into the camera's (x right, y down, z forward); identity when the readings went through an
    /// [`ImuCalibration`](super::ImuCalibration) that does so.
    #[must_use]
    pub fn in_camera(&self, mounting: Quat) -> Vec3 {
        rotate(mounting, self.up)
    }

    /// Up in the world that `pose` (camera-to-world, of the same moment) leads to.
    #[must_use]
    pub fn in_world(&self, mounting: Quat, pose: &Pose) -> Vec3 {
        pose.direction_to_world(self.in_camera(mounting))
    }
}

/// The camera's pose when only its orientation is known: camera-to-world with z up, position zero. `orientation` is the filter's
/// ([`Vqf::orientation`](super::Vqf::orientation) or [`orientation_north`](super::Vqf::orientation_north)), `mounting` as for [`Gravity::in_camera`]. The identity where they are no rotations.
#[must_use]
pub fn camera_pose(orientation: Quat, mounting: Quat) -> Pose {
    Pose::new(unit(product(orientation, mounting.conjugate())), Vec3::ZERO).unwrap_or(Pose::IDENTITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_three_ways_agree(a in proptest::array::uniform4(-1.0_f32..1.0), m in proptest::array::uniform4(-1.0_f32..1.0)) {
            let (orientation, mounting) = (unit(Quat::from_array(a)), unit(Quat::from_array(m)));
            let gravity = Gravity { up: orientation.inverse() * Vec3::Z, sigma: 0.0 };
            let pose = camera_pose(orientation, mounting);
            prop_assert!((gravity.in_world(mounting, &pose) - Vec3::Z).length() < 1e-5);
            prop_assert!((pose.direction_to_camera(Vec3::Z) - gravity.in_camera(mounting)).length() < 1e-5);
        }
    }

    #[test]
    fn what_is_no_rotation_gives_the_identity() {
        assert_eq!(camera_pose(Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0), Quat::IDENTITY), Pose::IDENTITY);
    }
}
