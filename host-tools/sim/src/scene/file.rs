//! The text form of a scene: TOML, unknown keys refused. The crate's README is its reference.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Deserialize;

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SceneFile {
    pub(crate) about: String,
    pub(crate) view: ViewFile,
    #[serde(default = "one")]
    pub(crate) exposure: f64,
    /// Metres per step of 16-bit depth, where the usual 1/5000 m would not reach.
    #[serde(default)]
    pub(crate) unit: Option<f64>,
    #[serde(default)]
    pub(crate) ambient: AmbientFile,
    #[serde(default)]
    pub(crate) surroundings: SurroundingsFile,
    #[serde(default)]
    pub(crate) places: BTreeMap<String, [f64; 3]>,
    #[serde(default)]
    pub(crate) materials: BTreeMap<String, MaterialFile>,
    #[serde(default)]
    pub(crate) groups: BTreeMap<String, GroupFile>,
    #[serde(default)]
    pub(crate) object: Vec<ObjectFile>,
    #[serde(default)]
    pub(crate) light: Vec<LightFile>,
}

const fn one() -> f64 {
    1.0
}

/// Where the camera stands by default.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ViewFile {
    pub(crate) eye: [f64; 3],
    pub(crate) target: [f64; 3],
    /// Half-axes of the ellipse that `walk` follows, metres along world x and z.
    #[serde(default = "roam")]
    pub(crate) roam: [f64; 2],
    #[serde(default)]
    pub(crate) camera: Option<CameraFile>,
}

/// The camera that a scene is meant for; all in pixels of the image size that it names.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CameraFile {
    pub(crate) size: [u32; 2],
    pub(crate) focal: [f64; 2],
    pub(crate) centre: [f64; 2],
}

const fn roam() -> [f64; 2] {
    [0.3, 0.3]
}

/// Light from everywhere, so that shadows are not black: on surfaces that face up, and down.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AmbientFile {
    pub(crate) up: [f64; 3],
    pub(crate) down: [f64; 3],
}

impl Default for AmbientFile {
    fn default() -> Self {
        Self { up: [0.25; 3], down: [0.15; 3] }
    }
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum SurroundingsFile {
    Constant([f64; 3]),
    Gradient {
        top: [f64; 3],
        horizon: [f64; 3],
        bottom: [f64; 3],
    },
    Hdr {
        file: PathBuf,
        #[serde(default)]
        turn: f64,
        #[serde(default = "one")]
        scale: f64,
    },
}

impl Default for SurroundingsFile {
    fn default() -> Self {
        Self::Constant([0.0; 3])
    }
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MaterialFile {
    #[serde(default = "grey")]
    pub(crate) colour: [f64; 3],
    #[serde(default)]
    pub(crate) pattern: Option<PatternFile>,
    #[serde(default)]
    pub(crate) mirror: f64,
    #[serde(default)]
    pub(crate) emission: [f64; 3],
}

const fn grey() -> [f64; 3] {
    [0.6; 3]
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum PatternFile {
    /// Cubes of two colours.
    Checker { colour: [f64; 3], size: f64 },
    /// Boards along local x (or z), each a little lighter or darker, with dark joints.
    Boards { width: f64, length: f64, variation: f64 },
    /// Smooth random blotches.
    Speckle { colour: [f64; 3], size: f64 },
    /// An image, stretched over the shape's texture coordinates, `repeat` times.
    Image {
        file: PathBuf,
        #[serde(default = "once")]
        repeat: [f64; 2],
    },
}

const fn once() -> [f64; 2] {
    [1.0; 2]
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GroupFile {
    #[serde(default)]
    pub(crate) at: [f64; 3],
    #[serde(default)]
    pub(crate) turn: [f64; 3],
    #[serde(default)]
    pub(crate) keys: Vec<KeyFile>,
    #[serde(default)]
    pub(crate) after: AfterFile,
}

/// Where a group is at a time, on top of its own place.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct KeyFile {
    pub(crate) time: f64,
    #[serde(default)]
    pub(crate) shift: [f64; 3],
    #[serde(default)]
    pub(crate) turn: [f64; 3],
}

/// What happens after the last key.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum AfterFile {
    #[default]
    Hold,
    Repeat,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ObjectFile {
    pub(crate) name: String,
    pub(crate) shape: ShapeFile,
    #[serde(default)]
    pub(crate) at: [f64; 3],
    #[serde(default)]
    pub(crate) turn: [f64; 3],
    pub(crate) material: String,
    #[serde(default)]
    pub(crate) group: Option<String>,
    #[serde(default)]
    pub(crate) segment: Option<String>,
    #[serde(default = "yes")]
    pub(crate) shadow: bool,
}

const fn yes() -> bool {
    true
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum ShapeFile {
    Plane {
        normal: [f64; 3],
    },
    Rectangle {
        size: [f64; 2],
    },
    Box {
        size: [f64; 3],
    },
    Sphere {
        radius: f64,
    },
    Cylinder {
        radius: f64,
        height: f64,
    },
    Capsule {
        radius: f64,
        height: f64,
    },
    Waves {
        size: [f64; 2],
        waves: Vec<WaveFile>,
    },
    /// All faces touch a ball; regular unless there is a seed.
    Polyhedron {
        radius: f64,
        faces: u32,
        #[serde(default)]
        seed: Option<u64>,
    },
    TorusKnot {
        radius: f64,
        tube: f64,
        /// Times around the axis, times through the hole.
        winds: [u32; 2],
        /// Rings along the tube, sides around it.
        facets: [u32; 2],
    },
    Icosphere {
        radius: f64,
        /// 20 x 4^level facets.
        level: u32,
        #[serde(default)]
        roughness: f64,
        #[serde(default)]
        seed: u64,
    },
    Mesh {
        file: PathBuf,
        #[serde(default = "one")]
        scale: f64,
    },
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct WaveFile {
    pub(crate) amplitude: f64,
    pub(crate) length: f64,
    /// Degrees from local x towards local z.
    #[serde(default)]
    pub(crate) direction: f64,
    /// Degrees.
    #[serde(default)]
    pub(crate) phase: f64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum LightFile {
    /// Radiant intensity (radiance times square metres).
    Point { at: [f64; 3], intensity: [f64; 3] },
    /// From a direction; irradiance on a surface that faces it.
    Sun { from: [f64; 3], irradiance: [f64; 3] },
    /// A rectangle that shines to its +z side but is not seen; samples x samples rays.
    Area {
        at: [f64; 3],
        #[serde(default)]
        turn: [f64; 3],
        size: [f64; 2],
        radiance: [f64; 3],
        #[serde(default = "two")]
        samples: u8,
    },
}

const fn two() -> u8 {
    2
}
