//! One frame, one question.

use clap::Args;
use isobath::glam::{Vec2, Vec3};

use super::FrameArgs;
use super::values::{numbers, vec2, vec3};

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  isobath hit data/motorcycle --pixel 370,250

Answers: hit, no_depth, outside_view. The error bar is one standard deviation
of z under the Kinect's noise model, which grows with z squared.")]
pub(crate) struct HitArgs {
    #[command(flatten)]
    pub(crate) of: FrameArgs,

    /// The pixel; fractions are fine
    #[arg(long, value_name = "X,Y", value_parser = vec2, allow_hyphen_values = true)]
    pub(crate) pixel: Vec2,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  isobath raycast data/motorcycle --from 0,0,0 --dir 0.1,0.2,1
  isobath raycast scans/kitchen --frame 3 --world --from 1,0.5,2 --dir 0,-1,0

Answers: hit, hit_occluded (it goes behind a surface; what is there nobody
sees), miss, no_depth (it met holes alone), outside_view.")]
pub(crate) struct RaycastArgs {
    #[command(flatten)]
    pub(crate) of: FrameArgs,

    /// Where the ray starts, metres
    #[arg(long, value_name = "X,Y,Z", value_parser = vec3, allow_hyphen_values = true)]
    pub(crate) from: Vec3,

    /// Where it goes; any length
    #[arg(long, value_name = "X,Y,Z", value_parser = vec3, allow_hyphen_values = true)]
    pub(crate) dir: Vec3,

    /// --from, --dir and the answer are in the world; otherwise in the camera frame
    #[arg(long)]
    pub(crate) world: bool,

    /// How far to go, metres
    #[arg(long, value_name = "M", default_value_t = 20.0)]
    pub(crate) reach: f32,

    /// How thick surfaces are taken to be, metres: a ray that passes farther behind one is occluded, not stopped
    #[arg(long, value_name = "M")]
    pub(crate) thickness: Option<f32>,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  isobath measure data/motorcycle --pixels 200,250 520,260")]
pub(crate) struct MeasureArgs {
    #[command(flatten)]
    pub(crate) of: FrameArgs,

    /// The two pixels
    #[arg(long, value_names = ["X,Y", "X,Y"], num_args = 2, value_parser = vec2, allow_hyphen_values = true)]
    pub(crate) pixels: Vec<Vec2>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  isobath place data/motorcycle --box 0.4,0.5,2.2,0.5,0.9,0.5 --yaw 30

The box stands upright: SX and SZ are its sides along the ground, SY its
height. Its 13 points vote; those in holes or out of view don't.
Answers: free, blocked, unknown (too few can vote).")]
pub(crate) struct PlaceArgs {
    #[command(flatten)]
    pub(crate) of: FrameArgs,

    /// Its centre and its size, metres
    #[arg(
        long = "box",
        value_name = "CX,CY,CZ,SX,SY,SZ",
        value_parser = numbers::<6>,
        allow_hyphen_values = true
    )]
    pub(crate) cuboid: [f32; 6],

    /// Turned about `up` by this many degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    pub(crate) yaw: f32,
}

// Here `--size` is the box's, so the image's gets a longer name.
#[derive(Debug, Args)]
#[command(mut_arg("image_size", |arg| arg.long("image-size")), after_help = "\
Example:
  isobath find-place data/motorcycle --size 0.5,0.9,0.5

Tries pixels all over the image. A place is level, flat and wide enough, and
the whole box is in sight with nothing in it. Lists the best ones first.")]
pub(crate) struct FindPlaceArgs {
    #[command(flatten)]
    pub(crate) of: FrameArgs,

    /// Its size: along the ground, its height, along the ground; metres
    #[arg(long, value_name = "SX,SY,SZ", value_parser = vec3)]
    pub(crate) size: Vec3,

    /// At most this many places
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(crate) most: usize,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  isobath path data/motorcycle --from 0.15,0.54,2.17 --to -1,0.25,3.25

Points are put down onto the ground below them. What was never seen is not
walked on. Answers: path, no_path, start_ or goal_ outside, unknown, blocked.")]
pub(crate) struct PathArgs {
    #[command(flatten)]
    pub(crate) of: FrameArgs,

    /// Start, metres, world
    #[arg(long, value_name = "X,Y,Z", value_parser = vec3, allow_hyphen_values = true)]
    pub(crate) from: Vec3,

    /// Goal, metres, world
    #[arg(long, value_name = "X,Y,Z", value_parser = vec3, allow_hyphen_values = true)]
    pub(crate) to: Vec3,

    /// Use all frames up to --frame for the height map, not that one alone (the recording needs poses)
    #[arg(long)]
    pub(crate) all: bool,
}
