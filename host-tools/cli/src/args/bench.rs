//! What is measured.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::values::size;

/// What is measured.
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\n  isobath bench --quick\n  isobath bench --filter normals --size 640x480\n  \
    isobath bench --filter normals --peers\n  isobath bench lighting --quick\n\n\
    Times are the thread's own processor time, nanoseconds, of the best of several\nrounds in turn. The report's folder gets bench.html \
    (plots), bench.csv and\nbench.json. Other libraries run in processes of their own, one core each."
)]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    pub(crate) only: Option<BenchOnly>,

    /// Only what has this in its name; may be given several times
    #[arg(long, value_name = "NAME")]
    pub(crate) filter: Vec<String>,

    /// Three scenes, one small size: under a minute
    #[arg(long)]
    pub(crate) quick: bool,

    /// One image size in place of the usual ones
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<(usize, usize)>,

    /// Of the noise and of the questions asked: the same seed asks the same
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,

    /// Beside other libraries (OpenCV, Open3D, PCL, librealsense) on the same frames; `cargo xtask peers` makes them, in
    /// target/peers, which is where they are looked for when no folder is named
    #[arg(long, value_name = "PEERS", num_args = 0..=1, default_missing_value = "target/peers")]
    pub(crate) peers: Option<PathBuf>,

    /// Folder for the report
    #[arg(long, value_name = "DIR", default_value = "out/bench")]
    pub(crate) out: PathBuf,
}

/// What has a bench of its own.
#[derive(Debug, Subcommand)]
pub(crate) enum BenchOnly {
    /// Environment maps and balls against the truth, as in the lighting paper's evaluation
    Lighting(BenchLightingArgs),
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  isobath bench lighting --quick
  isobath bench lighting --out out/lighting

In sim:living-room, 72 observers around each of ten places: one frame that sees
the place, nine that look away. PSNR and SSIM of the map and of three balls, for
all presets, a 360-degree capture and single fields; views, directions, rules and
drift one by one; times of all components; photographed HDR panoramas where
../shared/data/hdri_polyhaven (or $ISOBATH_DATA) has them. About ten minutes on
two cores. Writes lighting.html (plots), lighting.csv, lighting.json.")]
pub(crate) struct BenchLightingArgs {
    /// Two places, two observers each: half a minute
    #[arg(long)]
    pub(crate) quick: bool,

    /// Of drift and random colours
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,

    /// Folder for the report
    #[arg(long, value_name = "DIR", default_value = "out/bench")]
    pub(crate) out: PathBuf,
}
