//! The light of a place: gathered from a recording, as a map or on balls.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use isobath::glam::Vec3;
use isobath::lighting::Preset;

use super::SourceArgs;
use super::values::{map_file, numbers, png_file, vec3};

/// How much of everything the light of a place is made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum PresetName {
    /// For devices: one view of 96x72, a map of 96x48, all in 256 KiB
    Tiny,
    /// Three views of 256x192, a map of 512x256
    Low,
    /// Four views of 512x384, a map of 512x256
    Medium,
    /// Five views of 1024x768, a map of 1024x512
    High,
}

impl PresetName {
    pub(crate) const fn preset(self) -> Preset {
        match self {
            Self::Tiny => Preset::TINY,
            Self::Low => Preset::LOW,
            Self::Medium => Preset::MEDIUM,
            Self::High => Preset::HIGH,
        }
    }

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Tiny => "tiny",
            Self::Low => "low",
            Self::Medium => "medium",
            Self::High => "high",
        }
    }
}

/// A place in a recording, and how its light is gathered. (Where it may be left out, `--at` is what tells.)
#[derive(Debug, Args)]
#[group(arg = "at")]
pub(crate) struct LightArgs {
    #[command(flatten)]
    pub(crate) source: SourceArgs,

    /// The place that the light falls on, metres, world
    #[arg(long, value_name = "X,Y,Z", value_parser = vec3, allow_hyphen_values = true, help_heading = "Light")]
    pub(crate) at: Vec3,

    /// How much of everything [default: low]
    #[arg(long, value_enum, help_heading = "Light")]
    pub(crate) preset: Option<PresetName>,

    /// Say which of so many directions away from the place were seen, and where to look next: 1, 3, 5 or 9
    #[arg(long, value_name = "N", help_heading = "Light")]
    pub(crate) guided: Option<usize>,

    /// Make the near views' poses agree by their surfaces (point-to-plane ICP), each time a view comes: against drift of the tracker
    #[arg(long, help_heading = "Light")]
    pub(crate) register: bool,

    /// Take every frame, also those that motion may have blurred and those with nothing new
    #[arg(long, help_heading = "Light")]
    pub(crate) all: bool,

    /// Light of directions never seen, linear, 1 is a camera's white [default: the mean of the first frame]
    #[arg(long, value_name = "R,G,B", value_parser = numbers::<3>, help_heading = "Light")]
    pub(crate) ambient: Option<[f32; 3]>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  isobath envmap sim:living-room --at=-0.35,0.53,-0.5 --out table.exr
  isobath envmap scans/kitchen --at 0,0.8,1.5 --preset high --out kitchen.hdr

Every frame of SRC is offered, in order; those are taken that are still (less
than 10 cm and 10 degrees within five frames) and show something new. Frames that
see the place are near views, all bring light from afar. SRC needs poses and colour. The map is
equirectangular: up in the first row, linear (EXR, HDR) or sRGB (PNG). Its
middle column looks along -z where y is up.")]
pub(crate) struct EnvmapArgs {
    #[command(flatten)]
    pub(crate) light: LightArgs,

    /// Where the map goes: .exr or .hdr (linear), .png (as a camera would show it)
    #[arg(long, value_name = "FILE", value_parser = map_file)]
    pub(crate) out: PathBuf,
}

// A map in a file needs neither a recording nor a place in it.
#[derive(Debug, Args)]
#[command(
    override_usage = "isobath probe <SRC> --at <X,Y,Z> [OPTIONS]\n       isobath probe --map <FILE> [OPTIONS]",
    mut_arg("src", |arg| arg.required(false).required_unless_present("map")),
    mut_arg("at", |arg| arg.required(false).required_unless_present("map")),
    after_help = "\
Examples:
  isobath probe sim:living-room --at=-0.35,0.53,-0.5 --out balls.png
  isobath probe --map table.exr --json

The picture shows a mirror, a glossy and a matt ball as the last camera sees
them (a map's: looking along -z). The coefficients are those of the real
spherical harmonics 1; y, z, x; xy, yz, 3z2-1, xz, x2-y2 in the map's axes."
)]
pub(crate) struct ProbeArgs {
    #[command(flatten)]
    pub(crate) light: Option<LightArgs>,

    /// Environment map in place of a recording: .exr, .hdr, .png or .jpg, twice as wide as high
    #[arg(long, value_name = "FILE", conflicts_with_all = ["src", "at"])]
    pub(crate) map: Option<PathBuf>,

    /// Where the picture of the balls goes, .png
    #[arg(long, value_name = "FILE", value_parser = png_file)]
    pub(crate) out: Option<PathBuf>,

    /// The light that is shown as white is 1 divided by this
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub(crate) exposure: f32,
}
