//! One depth frame: the pixels and everything needed to read them, borrowed.
//!
//! A frame is built once, checked once, and passed by reference to every algorithm. It owns nothing: on firmware it views
//! statics, on the desktop `Vec`s. Depth is pinhole; a distorted sensor is straightened first
//! ([`rectify`](crate::sensing::camera::rectify)).

use core::fmt;

use glam::{Vec2, Vec3};

use crate::ground::image::ImageView;
use crate::ground::units::Timestamp;
use crate::sensing::camera::crop::CropMap;
use crate::sensing::camera::intrinsics::pixel_index;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::{DepthSample, DepthUnit};

/// One view of the world.
///
/// ```
/// use glam::vec2;
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// static DEPTH: DepthArray<160, 120> = DepthArray::filled(1500);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let frame = DepthFrame::new(DEPTH.view(), DepthUnit::MILLIMETRE, k);
/// assert!((frame.z(80, 60) - 1.5).abs() < 1e-6);
/// assert_eq!(frame.z(160, 60), 0.0); // outside: no reading
/// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct DepthFrame<'a, D: DepthSample = u16> {
    depth: ImageView<'a, D>,
    unit: DepthUnit,
    intrinsics: Intrinsics,
    confidence: Option<ImageView<'a, u8>>,
    colour: Option<(ImageView<'a, [u8; 3]>, CropMap)>,
    pose: Option<Pose>,
    time: Timestamp,
    sequence: u64,
}

/// Two images that belong to one frame do not fit each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameError {
    /// The confidence image is not of the depth image's size.
    ConfidenceSize {
        /// Depth width and height.
        depth: (usize, usize),
        /// Confidence width and height.
        confidence: (usize, usize),
    },
    /// The colour or the depth image has no pixels.
    EmptyColour,
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ConfidenceSize { depth, confidence } => write!(
                f,
                "confidence is {}x{} but depth {}x{}; they must be the same",
                confidence.0, confidence.1, depth.0, depth.1
            ),
            Self::EmptyColour => write!(f, "a colour image can only join a depth image when both have pixels"),
        }
    }
}

impl core::error::Error for FrameError {}

impl<'a, D: DepthSample> DepthFrame<'a, D> {
    /// A frame of depth alone: no confidence, colour or pose, time zero.
    #[must_use]
    pub const fn new(depth: ImageView<'a, D>, unit: DepthUnit, intrinsics: Intrinsics) -> Self {
        Self { depth, unit, intrinsics, confidence: None, colour: None, pose: None, time: Timestamp::ZERO, sequence: 0 }
    }

    /// With a confidence image, 0 to 255 a pixel.
    ///
    /// # Errors
    /// [`FrameError::ConfidenceSize`] unless it has the depth image's size.
    pub fn with_confidence(self, confidence: ImageView<'a, u8>) -> Result<Self, FrameError> {
        if confidence.size() != self.depth.size() {
            return Err(FrameError::ConfidenceSize { depth: self.depth.size(), confidence: confidence.size() });
        }
        Ok(Self { confidence: Some(confidence), ..self })
    }

    /// With an RGB image of any size, of which depth covers the middle ([`CropMap::centred`]).
    ///
    /// # Errors
    /// [`FrameError::EmptyColour`] when either image is empty.
    pub fn with_colour(self, colour: ImageView<'a, [u8; 3]>) -> Result<Self, FrameError> {
        let map = CropMap::centred(colour.size(), self.depth.size()).ok_or(FrameError::EmptyColour)?;
        Ok(Self { colour: Some((colour, map)), ..self })
    }

    /// With the camera's pose, camera-to-world.
    #[must_use]
    pub const fn with_pose(self, pose: Pose) -> Self {
        Self { pose: Some(pose), ..self }
    }

    /// With the time of exposure and the frame's number.
    #[must_use]
    pub const fn with_time(self, time: Timestamp, sequence: u64) -> Self {
        Self { time, sequence, ..self }
    }

    /// The depth image, in [`Self::unit`].
    #[must_use]
    pub const fn depth(&self) -> ImageView<'a, D> {
        self.depth
    }

    /// Metres per step of the depth image.
    #[must_use]
    pub const fn unit(&self) -> DepthUnit {
        self.unit
    }

    /// The pinhole through which depth was seen.
    #[must_use]
    pub const fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// Confidence, 0 to 255 a pixel, of the depth image's size.
    #[must_use]
    pub const fn confidence(&self) -> Option<ImageView<'a, u8>> {
        self.confidence
    }

    /// Colour, and how its pixels map to depth's.
    #[must_use]
    pub const fn colour(&self) -> Option<(ImageView<'a, [u8; 3]>, CropMap)> {
        self.colour
    }

    /// Camera-to-world, when known.
    #[must_use]
    pub const fn pose(&self) -> Option<Pose> {
        self.pose
    }

    /// Camera-to-world, or the identity: without a pose, the world is the camera frame.
    #[must_use]
    pub fn pose_or_identity(&self) -> Pose {
        self.pose.unwrap_or(Pose::IDENTITY)
    }

    /// Time of exposure.
    #[must_use]
    pub const fn time(&self) -> Timestamp {
        self.time
    }

    /// The frame's number in its stream.
    #[must_use]
    pub const fn sequence(&self) -> u64 {
        self.sequence
    }

    /// Width and height of the depth image.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        self.depth.size()
    }

    /// Depth in metres at a pixel; 0 outside the image and in holes.
    #[inline]
    #[must_use]
    pub fn z(&self, x: usize, y: usize) -> f32 {
        self.depth.get(x, y).map_or(0.0, |v| v.metres(self.unit))
    }

    /// The camera-space point (metres) of a pixel; `None` outside the image and in holes. DepthLab Eq. 1.
    #[must_use]
    pub fn point(&self, x: usize, y: usize) -> Option<Vec3> {
        let z = self.z(x, y);
        (z > 0.0).then(|| self.intrinsics.unproject(Vec2::new(x as f32, y as f32), z))
    }

    /// The world point (metres) of a pixel; `None` outside the image and in holes. DepthLab Eq. 2.
    #[must_use]
    pub fn world_point(&self, x: usize, y: usize) -> Option<Vec3> {
        self.point(x, y).map(|p| self.pose_or_identity().to_world(p))
    }

    /// The pixel that sees a camera-space point; `None` when it is behind the camera or outside the image.
    #[inline]
    #[must_use]
    pub fn pixel_of(&self, point: Vec3) -> Option<(usize, usize)> {
        self.intrinsics.project(point).and_then(|p| pixel_index(p, self.size()))
    }

    /// The pixel that sees a world point (metres); `None` when it is behind the camera or outside the image. DepthLab Eq. 3.
    #[must_use]
    pub fn pixel_of_world(&self, point: Vec3) -> Option<(usize, usize)> {
        self.pixel_of(self.pose_or_identity().to_camera(point))
    }

    /// Colour of a depth pixel, nearest; `None` without a colour image or outside it.
    #[must_use]
    pub fn colour_at(&self, x: usize, y: usize) -> Option<[u8; 3]> {
        let (colour, map) = self.colour?;
        let p = map.colour_from_depth(Vec2::new(x as f32, y as f32))?;
        let (cx, cy) = pixel_index(p, colour.size())?;
        colour.get(cx, cy)
    }
}
