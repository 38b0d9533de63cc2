//! What is read, and what the files don't say themselves.

use std::path::PathBuf;

use clap::Args;
use isobath::glam::Vec3;

use super::values::{numbers, size, vec3};

/// What is read, and what the files don't say themselves.
#[derive(Debug, Clone, Args)]
pub(crate) struct SourceArgs {
    /// A recording: an MCAP file or a ROS 1 bag, a folder (TUM RGB-D, 7-Scenes, Open3D, or depth images with a camera.toml), or one
    /// depth image (16-bit PNG or PGM, NPY, Android DEPTH16 .bin); or a camera: v4l2:/dev/videoN, usb:KIND (see `isobath
    /// devices`); or a simulated scene: sim:SCENE, sim:SCENE@SENSOR (see `isobath sim`). mcap:F and bag:F say what F is
    #[allow(clippy::doc_markdown, reason = "help text: what is between backticks is shown with them")]
    #[arg(value_name = "SRC")]
    pub(crate) src: PathBuf,

    /// Camera file to use instead of SRC's own camera.toml
    #[arg(long, value_name = "FILE", help_heading = "Camera", conflicts_with = "intrinsics")]
    pub(crate) camera: Option<PathBuf>,

    /// Focal lengths and principal point in pixels, by hand; a negative fy means y up
    #[arg(
        long,
        value_name = "FX,FY,CX,CY",
        value_parser = numbers::<4>,
        allow_hyphen_values = true,
        requires = "unit",
        help_heading = "Camera"
    )]
    pub(crate) intrinsics: Option<[f32; 4]>,

    /// Metres per step of the depth values (millimetres: 0.001, TUM: 0.0002, f32 metres: 1)
    #[arg(long, value_name = "METRES", help_heading = "Camera")]
    pub(crate) unit: Option<f32>,

    /// Size of raw depth images that don't state it (.bin)
    #[arg(id = "image_size", long = "size", value_name = "WxH", value_parser = size, help_heading = "Camera")]
    pub(crate) size: Option<(usize, usize)>,

    /// Which way is up in the world [default: the camera file's `up`, else the normal of the ground seen, else the top of the image]
    #[arg(long, value_name = "X,Y,Z", value_parser = vec3, allow_hyphen_values = true, help_heading = "Camera")]
    pub(crate) up: Option<Vec3>,

    /// Readings nearer than this are not believed, metres
    #[arg(long, value_name = "M", help_heading = "Readings")]
    pub(crate) min_z: Option<f32>,

    /// Readings farther than this are not believed, metres
    #[arg(long, value_name = "M", help_heading = "Readings")]
    pub(crate) max_z: Option<f32>,

    /// Readings less sure than this are not believed, 0 to 255
    #[arg(long, value_name = "0-255", help_heading = "Readings")]
    pub(crate) min_confidence: Option<u8>,
}

/// A source of which one frame is asked.
#[derive(Debug, Clone, Args)]
pub(crate) struct FrameArgs {
    #[command(flatten)]
    pub(crate) source: SourceArgs,

    /// Frame number, from 0; of a camera, so many frames are passed over
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) frame: usize,
}
