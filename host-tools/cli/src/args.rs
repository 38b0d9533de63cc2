//! The command line: what can be asked, how, with examples. clap turns this into `--help`, completions and exit code 2.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use isobath::glam::{Vec2, Vec3};
use isobath::lighting::Preset;

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

/// What is read, and what the files don't say themselves.
#[derive(Debug, Clone, Args)]
pub(crate) struct SourceArgs {
    /// A recording's folder (TUM RGB-D, 7-Scenes, Open3D, or depth images with a camera.toml), or one depth image
    /// (16-bit PNG or PGM, NPY, Android DEPTH16 .bin), or a simulated scene: sim:SCENE, sim:SCENE@SENSOR (see `isobath sim`)
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

    /// Frame number, from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) frame: usize,
}

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

fn map_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("exr" | "hdr" | "png") => Ok(path),
        _ => Err("the name must end in .exr, .hdr or .png".to_owned()),
    }
}

fn png_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|e| e == "png") { Ok(path) } else { Err("the name must end in .png".to_owned()) }
}

fn numbers<const N: usize>(text: &str) -> Result<[f32; N], String> {
    let mut out = [0.0; N];
    let mut parts = text.split(',');
    for slot in &mut out {
        let part = parts.next().ok_or_else(|| format!("{N} numbers with commas between are needed"))?.trim();
        let value: f32 = part.parse().map_err(|_| format!("`{part}` is not a number"))?;
        if !value.is_finite() {
            return Err(format!("`{part}` is not a finite number"));
        }
        *slot = value;
    }
    match parts.next() {
        None => Ok(out),
        Some(_) => Err(format!("{N} numbers with commas between are needed, no more")),
    }
}

fn vec2(text: &str) -> Result<Vec2, String> {
    numbers::<2>(text).map(Vec2::from)
}

fn vec3(text: &str) -> Result<Vec3, String> {
    numbers::<3>(text).map(Vec3::from)
}

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

fn size(text: &str) -> Result<(usize, usize), String> {
    let side = |s: &str| s.trim().parse::<usize>().ok().filter(|n| (1..=65_535).contains(n));
    text.split_once(['x', 'X'])
        .and_then(|(w, h)| Some((side(w)?, side(h)?)))
        .ok_or_else(|| "width and height are needed, as in 640x480".to_owned())
}

fn points_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("ply" | "npy") => Ok(path),
        _ => Err("the name must end in .ply or .npy".to_owned()),
    }
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
    fn lists_and_sizes() {
        assert_eq!(vec3("1, -2,3.5"), Ok(Vec3::new(1.0, -2.0, 3.5)));
        assert!(vec3("1,2").is_err() && vec3("1,2,3,4").is_err() && vec3("1,2,x").is_err() && vec3("1,2,NaN").is_err());
        assert_eq!(size("640x480"), Ok((640, 480)));
        assert!(size("640").is_err() && size("0x3").is_err());
    }

    #[test]
    fn every_command_teaches_by_example() {
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains(&format!("isobath {}", command.get_name())), "{}", command.get_name());
        }
    }
}
