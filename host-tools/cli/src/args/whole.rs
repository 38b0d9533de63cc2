//! Whole recordings: looked at, described, simulated.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::SourceArgs;
use super::values::{numbers, size};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  isobath run data/motorcycle
  isobath run scans/kitchen --out /tmp/kitchen --max-z 6
  isobath run scan.png --intrinsics 525,525,319.5,239.5 --unit 0.0002

Writes DIR/report.html (one file that needs nothing else) and DIR/report.json
(what --json prints). Each frame: depth pyramid, normals, ground plane, reticle
at the centre, rays from a hand, a chair and a stool at 32 taps, height map,
path across the scene. All memory is taken before the first frame; times are
wall clock on one core.")]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) source: SourceArgs,

    /// Where the report goes [default: out/<name of SRC>]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,

    /// Only this many frames
    #[arg(long, value_name = "N")]
    pub(crate) frames: Option<usize>,

    /// Times each frame is worked through, so that a time means something [default: 15 for one frame, 1 for several]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) repeat: Option<u32>,

    /// The frame whose pictures the report shows, from 0 [default: the last]
    #[arg(long, value_name = "N")]
    pub(crate) show: Option<usize>,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  isobath info data/motorcycle --json")]
pub(crate) struct InfoArgs {
    #[command(flatten)]
    pub(crate) source: SourceArgs,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  isobath sim living-room --frames 60 --sensor kinect --seed 1 --out out/living
  isobath run out/living
  isobath run sim:living-room@kinect        the same without files

  isobath sim living-room --path stations --place table --frames 72 --environment 1024
  isobath sim desk --path shake --tracking phone --imu phone --colour-size 1280x720

Named scenes: wall, tilted, sphere, corner, stairs, desk, living-room, corridor,
door (something moves), facets-easy, facets-medium, facets-hard (far away, in no
particular unit: for normals against flat facets). Sensors: none, kinect, kinect-full, stereo, tof, or stages joined by +,
such as quantised:0.001+range:0.3..5; host-tools/sim/README.md tells of each.

Writes a TUM RGB-D folder with camera.toml and imu.csv, and beside it truth/:
exact depth and normals (NPY), linear colour (EXR), segments, and environment
maps (EXR, NPY). The same seed gives the same bytes on every machine.")]
pub(crate) struct SimArgs {
    /// A named scene, or a scene file (.toml)
    #[arg(value_name = "SCENE")]
    pub(crate) scene: String,

    /// Where the recording goes [default: out/SCENE]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,

    /// How many frames, at 30 a second
    #[arg(long, value_name = "N", default_value_t = 30)]
    pub(crate) frames: usize,

    /// Size of the depth and colour images
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "640x480")]
    pub(crate) size: (usize, usize),

    /// What the sensor does to depth
    #[arg(long, value_name = "MODEL", default_value = "none")]
    pub(crate) sensor: String,

    /// Seed of all that is random
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,

    /// Columns of the environment maps, one for each named place of the scene; 0: none
    #[arg(long, value_name = "N", default_value_t = 512)]
    pub(crate) environment: usize,

    /// An environment map of this point too, metres; may be given several times
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    pub(crate) probe: Vec<[f32; 3]>,

    /// The camera's way: auto (walk, or static where something moves), static, walk, shake, orbit, or stations, the lighting
    /// paper's 72 places around --place
    #[arg(long, value_name = "PATH", default_value = "auto")]
    pub(crate) path: String,

    /// Which of the scene's places orbit and stations go around [default: its first]
    #[arg(long, value_name = "PLACE")]
    pub(crate) place: Option<String>,

    /// How well the camera's poses are known: with phone they tremble and drift
    #[arg(long, value_enum, default_value_t = Quality::Exact)]
    pub(crate) tracking: Quality,

    /// How good the inertial sensor is: phone has bias, noise and a bias that wanders
    #[arg(long, value_enum, default_value_t = Quality::Exact)]
    pub(crate) imu: Quality,

    /// Size of the colour images, when it is another; depth covers their middle
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) colour_size: Option<(usize, usize)>,

    /// Lens of both cameras, in OpenCV's order
    #[arg(long, value_name = "K1,K2,P1,P2,K3,K4,K5,K6", value_parser = numbers::<8>, allow_hyphen_values = true)]
    pub(crate) lens: Option<[f32; 8]>,

    /// Horizontal field of view of the depth camera, degrees [default: the scene's own camera, for most 63]
    #[arg(long, value_name = "DEG")]
    pub(crate) fov: Option<f64>,

    /// Metres per step of the depth images [default: 0.0002, or the scene's own]
    #[arg(long, value_name = "METRES")]
    pub(crate) unit: Option<f64>,
}

/// Whether a simulated instrument errs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Quality {
    /// Not at all
    Exact,
    /// As a phone's does
    Phone,
}
