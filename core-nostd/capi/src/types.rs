//! What crosses the border: plain structs, fixed widths, a unit on every number. The conventions are the core's: right-handed;
//! camera x right, y down, z forward; poses camera-to-world; pixel centres at integers; metres, radians, nanoseconds.
//!
//! Enums are given back as types and taken as `int32_t`: C lets any number into an enum.

use isobath::glam;
use isobath::ground::geometry::OrientedBox;
use isobath::sensing::camera::Pose as CorePose;
use isobath::sensing::depth::HolePolicy;

use crate::check::Plain;
use crate::status::Status;

/// A point in metres, or a direction.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vec3 {
    /// Camera: right.
    pub x: f32,
    /// Camera: down.
    pub y: f32,
    /// Camera: forward.
    pub z: f32,
}

impl From<glam::Vec3> for Vec3 {
    fn from(v: glam::Vec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<Vec3> for glam::Vec3 {
    fn from(v: Vec3) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

/// A rotation, unit length (to 1 %); none is 0 0 0 1.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quat {
    /// i
    pub x: f32,
    /// j
    pub y: f32,
    /// k
    pub z: f32,
    /// Real part.
    pub w: f32,
}

impl From<glam::Quat> for Quat {
    fn from(q: glam::Quat) -> Self {
        Self { x: q.x, y: q.y, z: q.z, w: q.w }
    }
}

/// The pinhole that depth was seen through, pixels. Depth of a distorted lens must be straightened first.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Horizontal focal length, pixels.
    pub fx: f32,
    /// Vertical focal length, pixels.
    pub fy: f32,
    /// Principal point from the first pixel's centre, pixels.
    pub cx: f32,
    /// Principal point from the first pixel's centre, pixels.
    pub cy: f32,
}

/// Where the camera stands: camera-to-world.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Camera axes to world axes.
    pub rotation: Quat,
    /// The camera in the world, metres.
    pub position: Vec3,
}

impl Pose {
    pub(crate) const IDENTITY: Self =
        Self { rotation: Quat { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }, position: Vec3 { x: 0.0, y: 0.0, z: 0.0 } };

    pub(crate) fn core(&self) -> Result<CorePose, Status> {
        let q = self.rotation;
        CorePose::new(glam::Quat::from_xyzw(q.x, q.y, q.z, q.w), self.position.into()).map_err(|_| Status::ErrorPose)
    }
}

/// What a pixel without a reading, or a cell that nobody saw, means.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Holes {
    /// Nothing is known there, and the answer says so.
    Unknown = 0,
    /// Something is there: the cautious choice.
    Solid = 1,
    /// Nothing is there.
    Free = 2,
}

impl Holes {
    pub(crate) const fn policy(number: i32) -> Result<HolePolicy, Status> {
        match number {
            0 => Ok(HolePolicy::Unknown),
            1 => Ok(HolePolicy::Solid),
            2 => Ok(HolePolicy::Free),
            _ => Err(Status::ErrorParameter),
        }
    }
}

/// A box in the world.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Box3 {
    /// Its middle, metres.
    pub centre: Vec3,
    /// Half its size along its own axes, metres; not negative.
    pub half: Vec3,
    /// Its axes to the world's.
    pub rotation: Quat,
}

impl Box3 {
    pub(crate) fn core(&self) -> Result<OrientedBox, Status> {
        let pose = Pose { rotation: self.rotation, position: self.centre }.core()?;
        let half = glam::Vec3::from(self.half);
        if !(half.min_element() >= 0.0 && half.is_finite()) {
            return Err(Status::ErrorParameter);
        }
        Ok(OrientedBox { centre: pose.translation(), half, rotation: pose.rotation() })
    }
}

impl From<OrientedBox> for Box3 {
    fn from(b: OrientedBox) -> Self {
        Self { centre: b.centre.into(), half: b.half.into(), rotation: b.rotation.into() }
    }
}

// SAFETY: `repr(C)` structs of `f32` alone: every bit pattern is a value, no padding.
unsafe impl Plain for Vec3 {}
// SAFETY: as above.
unsafe impl Plain for Quat {}
// SAFETY: as above.
unsafe impl Plain for Camera {}
// SAFETY: as above.
unsafe impl Plain for Pose {}
// SAFETY: as above.
unsafe impl Plain for Box3 {}
