//! A frame as it lies in flash: depth compressed ([`isobath::wire::rvl`]), camera and pose as numbers.

use isobath::glam::{Quat, Vec3};
use isobath::sensing::camera::{Intrinsics, Pose};

/// Where a frame was seen from, and with which camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Focal lengths and principal point, pixels.
    pub camera: [f32; 4],
    /// Camera-to-world rotation, x y z w.
    pub rotation: [f32; 4],
    /// The camera's place in the world, metres.
    pub place: [f32; 3],
}

impl View {
    /// As the core's types; `None` when they refuse the numbers.
    #[must_use]
    pub fn read(&self) -> Option<(Intrinsics, Pose)> {
        let [fx, fy, cx, cy] = self.camera;
        let pose = Pose::new(Quat::from_array(self.rotation), Vec3::from(self.place)).ok()?;
        Some((Intrinsics::new(fx, fy, cx, cy).ok()?, pose))
    }
}

/// One frame of the stream.
#[derive(Debug, Clone, Copy)]
pub struct Packed<'a> {
    /// Millimetres, [`W`](crate::W) x [`H`](crate::H), as RVL.
    pub depth: &'a [u8],
    /// The camera.
    pub view: View,
}
