//! One frame as arrays: normals, points.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::FrameArgs;
use super::values::points_file;

/// How normals are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Method {
    /// From inverse depth, choosing the side of an edge that a pixel belongs to: exact on planes
    Exact,
    /// The DepthLab paper's Algorithm 1, to compare with
    Paper,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  isobath normals data/motorcycle --out normals.npy --png normals.png

The array is height x width x 3, f32: unit normals in the camera frame
(x right, y down, z forward), facing the camera, NaN where there is none.")]
pub(crate) struct NormalsArgs {
    #[command(flatten)]
    pub(crate) of: FrameArgs,

    /// Method
    #[arg(long, value_enum, default_value_t = Method::Exact)]
    pub(crate) method: Method,

    /// Fit over (2N+1)x(2N+1) pixels: smoother on noisy sensors, slower. 0: the method's own least
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=7))]
    pub(crate) radius: u8,

    /// NumPy file to write
    #[arg(long, value_name = "F.npy", required_unless_present = "png")]
    pub(crate) out: Option<PathBuf>,

    /// Picture to write: x as red, up as green, towards the camera as blue
    #[arg(long, value_name = "F.png")]
    pub(crate) png: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  isobath points data/motorcycle --out motorcycle.ply
  isobath points scans/kitchen --frame 12 --world --out frame12.npy

PLY: binary, one vertex a reading, with colour when the frame has it.
NPY: height x width x 3, f32 metres, NaN in holes.")]
pub(crate) struct PointsArgs {
    #[command(flatten)]
    pub(crate) of: FrameArgs,

    /// In the world instead of the camera frame (the frame needs a pose)
    #[arg(long)]
    pub(crate) world: bool,

    /// File to write: .ply or .npy
    #[arg(long, value_name = "F.ply|F.npy", value_parser = points_file)]
    pub(crate) out: PathBuf,
}
