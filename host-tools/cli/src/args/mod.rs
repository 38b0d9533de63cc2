//! The command line: what can be asked, how, with examples. clap turns this into `--help`, completions and exit code 2.
//!
//! | file | idea |
//! |---|---|
//! | `source` | what is read, and what the files don't say themselves |
//! | `record` | recordings made and converted; what is plugged in |
//! | `whole` | whole recordings: looked at, described, simulated |
//! | `pixels` | one frame as arrays: normals, points |
//! | `questions` | one frame, one question: hit, ray, distance, room, way |
//! | `light` | the light of a place |
//! | `bench` | what is measured |
//! | `values` | numbers, points, sizes and file names from words |

mod bench;
mod light;
mod pixels;
mod questions;
mod record;
mod source;
mod values;
mod whole;

use clap::{Parser, Subcommand};

pub(crate) use bench::{BenchArgs, BenchLightingArgs, BenchOnly};
pub(crate) use light::{EnvmapArgs, LightArgs, PresetName, ProbeArgs};
pub(crate) use pixels::{Method, NormalsArgs, PointsArgs};
pub(crate) use questions::{FindPlaceArgs, HitArgs, MeasureArgs, PathArgs, PlaceArgs, RaycastArgs};
pub(crate) use record::{ConvertArgs, DevicesArgs, HowMuchArgs, RecordArgs};
pub(crate) use source::{FrameArgs, SourceArgs};
pub(crate) use whole::{InfoArgs, Quality, RunArgs, SimArgs};

const AFTER: &str = "\
Start here:
  isobath run data/motorcycle    look at everything, write a report
  isobath hit data/motorcycle --pixel 370,250
  isobath help run               everything about one command

Lengths are metres; angles on the command line are degrees. Pixels count from
the top left, pixel centres at whole numbers. The camera frame is x right,
y down, z forward; depth `z` is along the axis, `range` the length of the ray.
Points and directions are in the world: the camera frame itself when the
recording has no poses.

With --json, lengths are metres (names end in _m), angles radians (_rad), times
nanoseconds (_ns); points are [x, y, z]. host-tools/cli/README.md names every
field.

Exit codes: 0 fine, 1 failed, 2 the command line was wrong. An answer such as
`no depth there` is an answer: 0.";

/// Depth cameras turned into answers: is this solid, which way does it face, does the object fit, how does one walk there
#[derive(Debug, Parser)]
#[command(name = "isobath", version, after_help = AFTER, propagate_version = true, max_term_width = 80)]
pub(crate) struct Cli {
    /// Answer as JSON, for machines (lengths in metres: names end in `_m`); errors too, on stderr
    #[arg(long, global = true)]
    pub(crate) json: bool,

    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The main job: every frame through every answer, into a report that a person can look at
    Run(RunArgs),
    /// What is in a recording: frames, size, camera, poses, readings
    Info(InfoArgs),
    /// What a camera sees, or any other source gives, into an MCAP file
    Record(RecordArgs),
    /// A recording in another form: an MCAP file, or a TUM RGB-D folder
    Convert(ConvertArgs),
    /// What is plugged in, what can be done with it, and what is missing
    Devices(DevicesArgs),
    /// A simulated recording with its ground truth
    Sim(SimArgs),
    /// The surface normal of every pixel, as an array or a picture
    Normals(NormalsArgs),
    /// Every pixel as a 3D point
    Points(PointsArgs),
    /// What is behind a pixel: point, normal, distance, error bar
    Hit(HitArgs),
    /// Where a ray meets the scene
    Raycast(RaycastArgs),
    /// The distance between two pixels' points, with its error bar
    Measure(MeasureArgs),
    /// Does a box at this place collide with the scene?
    Place(PlaceArgs),
    /// Where is there room for a box of this size?
    FindPlace(FindPlaceArgs),
    /// How to walk from one point to another, around what can't be climbed
    Path(PathArgs),
    /// The light that falls on a place, as an environment map
    Envmap(EnvmapArgs),
    /// The same light on a mirror, a glossy and a matt ball, and as nine coefficients
    Probe(ProbeArgs),
    /// Run time against error of all of these, measured here on simulated frames with known truth
    Bench(BenchArgs),
    /// Completions for your shell, on stdout
    #[command(
        after_help = "Examples:\n  isobath completions bash > ~/.local/share/bash-completion/completions/isobath\n  \
        isobath completions zsh > ~/.zfunc/_isobath\n  isobath completions fish > ~/.config/fish/completions/isobath.fish"
    )]
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn clap_agrees_with_itself() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_command_teaches_by_example() {
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains(&format!("isobath {}", command.get_name())), "{}", command.get_name());
        }
    }
}
