//! Messages of robots' recordings: images, camera calibrations, transforms, poses and inertial readings, in the four forms that
//! MCAP and bag files hold them in.
//!
//! | file | idea |
//! |---|---|
//! | `ros` | ROS 2's CDR and ROS 1's own packing: the same fields in the same order, packed differently |
//! | `foxglove` | Foxglove's schemas in protobuf and in JSON |
//! | `write` | ROS 2 messages written, and their definitions, without which no reader knows the fields |
//! | `pixels` | from the bytes of an image to depth, colour, confidence |
//!
//! All are pure functions of bytes. None panics; none allocates more than a small multiple of the bytes it was given, or of an image
//! of [`MAX_PIXELS`](crate::parse::MAX_PIXELS). Errors are [`ParseError`]s. Sources: the `.msg` files of `common_interfaces` and
//! `geometry2`; OMG's CDR (plain, version 1); `foxglove-sdk/schemas`.

mod foxglove;
pub(crate) mod pixels;
mod ros;
pub(crate) mod write;

use std::borrow::Cow;

use isobath::ground::units::Timestamp;

use crate::parse::ParseError;

/// What a message says, by the name of its schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `sensor_msgs/Image`, `foxglove.RawImage`.
    Image,
    /// `sensor_msgs/CompressedImage`, `foxglove.CompressedImage`.
    CompressedImage,
    /// `sensor_msgs/CameraInfo`, `foxglove.CameraCalibration`.
    CameraInfo,
    /// `tf2_msgs/TFMessage`, `tf/tfMessage`, `foxglove.FrameTransforms`.
    Transforms,
    /// `geometry_msgs/TransformStamped`, `foxglove.FrameTransform`.
    Transform,
    /// `geometry_msgs/Transform`: RealSense's recordings, once a sensor, without names.
    BareTransform,
    /// `geometry_msgs/PoseStamped`, `foxglove.PoseInFrame`.
    Pose,
    /// `sensor_msgs/Imu`.
    Imu,
    /// `sensor_msgs/MagneticField`.
    MagneticField,
    /// `std_msgs/Float32`: RealSense's options.
    Number,
}

impl Kind {
    /// By the schema's name: `sensor_msgs/msg/Image` (ROS 2), `sensor_msgs/Image` (ROS 1), `foxglove.RawImage`.
    #[must_use]
    pub fn of(schema: &str) -> Option<Self> {
        Some(match schema.replace("/msg/", "/").as_str() {
            "sensor_msgs/Image" | "foxglove.RawImage" => Self::Image,
            "sensor_msgs/CompressedImage" | "foxglove.CompressedImage" => Self::CompressedImage,
            "sensor_msgs/CameraInfo" | "foxglove.CameraCalibration" => Self::CameraInfo,
            "tf2_msgs/TFMessage" | "tf/tfMessage" | "foxglove.FrameTransforms" => Self::Transforms,
            "geometry_msgs/TransformStamped" | "foxglove.FrameTransform" => Self::Transform,
            "geometry_msgs/Transform" => Self::BareTransform,
            "geometry_msgs/PoseStamped" | "foxglove.PoseInFrame" => Self::Pose,
            "sensor_msgs/Imu" => Self::Imu,
            "sensor_msgs/MagneticField" => Self::MagneticField,
            "std_msgs/Float32" => Self::Number,
            _ => return None,
        })
    }
}

/// How a message's fields are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// ROS 2: CDR, either byte order.
    Cdr,
    /// ROS 1.
    Ros1,
    /// Protocol buffers (Foxglove's schemas).
    Protobuf,
    /// JSON (Foxglove's schemas).
    Json,
}

impl Encoding {
    /// By MCAP's name of a channel's message encoding.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        Some(match name {
            "cdr" => Self::Cdr,
            "ros1" => Self::Ros1,
            "protobuf" => Self::Protobuf,
            "json" => Self::Json,
            _ => return None,
        })
    }
}

/// An image as it was sent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Image<'a> {
    /// Time of exposure.
    pub stamp: Timestamp,
    /// Name of the camera's coordinate frame.
    pub frame: Cow<'a, str>,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Such as `16UC1`, `rgb8`; of a compressed image, its format.
    pub encoding: Cow<'a, str>,
    /// Order of the bytes of a value.
    pub big_endian: bool,
    /// Bytes from row to row; 0 for a compressed image.
    pub step: u32,
    /// Rows, or a compressed file.
    pub data: Cow<'a, [u8]>,
}

/// A camera's calibration.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CameraInfo {
    /// Time it holds for.
    pub stamp: Timestamp,
    /// Name of the camera's coordinate frame.
    pub frame: String,
    /// Of the images it was calibrated on, pixels; 0 when not said.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Such as `plumb_bob`.
    pub model: String,
    /// Lens coefficients, `OpenCV`'s order.
    pub d: Vec<f64>,
    /// Pinhole matrix, row by row.
    pub k: [f64; 9],
}

/// Where one coordinate frame stands in another.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Transform {
    /// Time it holds for.
    pub stamp: Timestamp,
    /// The frame that it leads into.
    pub parent: String,
    /// The frame whose place it is.
    pub child: String,
    /// Metres.
    pub translation: [f64; 3],
    /// Quaternion x y z w.
    pub rotation: [f64; 4],
}

/// One reading of one instrument.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Imu {
    /// Time of the reading.
    pub stamp: Timestamp,
    /// Angular rate, rad/s.
    pub rate: [f64; 3],
    /// Specific force, m/s^2.
    pub force: [f64; 3],
}

/// A message.
#[derive(Debug, Clone, PartialEq)]
pub enum Message<'a> {
    /// Also a compressed one.
    Image(Image<'a>),
    /// Calibration.
    CameraInfo(CameraInfo),
    /// Also a pose: its child has no name.
    Transforms(Vec<Transform>),
    /// Gyroscope and accelerometer.
    Imu(Imu),
    /// Magnetic field, tesla.
    MagneticField(Timestamp, [f64; 3]),
    /// A number.
    Number(f32),
}

/// Reads a message.
///
/// # Errors
/// [`ParseError`]: cut off, lengths that can't be, text that is no text; a pair of kind and encoding that does not exist.
pub fn decode(kind: Kind, encoding: Encoding, bytes: &[u8]) -> Result<Message<'_>, ParseError> {
    match encoding {
        Encoding::Cdr | Encoding::Ros1 => ros::decode(kind, encoding, bytes),
        Encoding::Protobuf => foxglove::decode_protobuf(kind, bytes),
        Encoding::Json => foxglove::decode_json(kind, bytes),
    }
}

/// Seconds and nanoseconds as one number, saturating.
fn stamp(seconds: i64, nanos: i64) -> Timestamp {
    Timestamp::from_nanos(seconds.saturating_mul(1_000_000_000).saturating_add(nanos))
}

fn cut_off() -> ParseError {
    ParseError::new("a message is cut off", "the file is damaged: copy it again")
}
