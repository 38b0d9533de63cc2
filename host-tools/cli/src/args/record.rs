//! Recordings made and converted; what is plugged in.

use std::path::PathBuf;

use clap::Args;

use super::SourceArgs;
use super::values::{mcap_file, positive, recording};

/// How much of a source is taken.
#[derive(Debug, Clone, Args)]
pub(crate) struct HowMuchArgs {
    /// Only this many frames
    #[arg(long, value_name = "N")]
    pub(crate) frames: Option<u64>,

    /// Only this long, by the frames' own times
    #[arg(long, value_name = "S", value_parser = positive)]
    pub(crate) seconds: Option<f32>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  isobath record v4l2:/dev/video0 --out desk.mcap --seconds 20
  isobath record usb:kinect --out desk.mcap --imu auto
  isobath run desk.mcap

Depth in the camera's own steps, to the bit; colour, confidence, intrinsics,
poses and inertial readings where the source has them. The file holds ROS 2
messages: Foxglove and `ros2 bag` open it. 640x480 at 30 Hz with colour takes
46 MB a second. A camera is recorded until --frames, --seconds or Ctrl-C. If the
program is killed or the computer fails, all but the last second can be read.
Nothing is overwritten.")]
pub(crate) struct RecordArgs {
    #[command(flatten)]
    pub(crate) source: SourceArgs,

    /// The file to write, .mcap
    #[arg(long, value_name = "F.mcap", value_parser = mcap_file)]
    pub(crate) out: PathBuf,

    #[command(flatten)]
    pub(crate) much: HowMuchArgs,

    /// Record this inertial sensor with the camera: iio:deviceN as `isobath devices` has it, or auto (the first)
    #[arg(long, value_name = "DEVICE", num_args = 0..=1, default_missing_value = "auto")]
    pub(crate) imu: Option<String>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  isobath convert realsense.bag --out desk.mcap
  isobath convert desk.mcap --out desk-tum
  isobath convert scans/kitchen --out kitchen.mcap --frames 100

MCAP keeps everything. A TUM RGB-D folder (depth/, rgb/, groundtruth.txt,
imu.csv, camera.toml) has 16-bit depth of 5000 steps a metre, up to 13.1 m:
what that rounds or cuts off is counted and said. Nothing is overwritten.")]
pub(crate) struct ConvertArgs {
    #[command(flatten)]
    pub(crate) source: SourceArgs,

    /// The file to write, .mcap, or the folder (TUM RGB-D)
    #[arg(long, value_name = "F.mcap|DIR", value_parser = recording)]
    pub(crate) out: PathBuf,

    #[command(flatten)]
    pub(crate) much: HowMuchArgs,

    /// Metres per step of a TUM folder's depth images [default: 0.0002, which TUM's tools expect]
    #[arg(long, value_name = "METRES", value_parser = positive)]
    pub(crate) step: Option<f32>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  isobath devices

Lists what the kernel knows: video nodes, depth cameras on USB, inertial
sensors; what SRC to give for each, and what is missing. Opens nothing unless
built with the feature `live`.")]
pub(crate) struct DevicesArgs {}
