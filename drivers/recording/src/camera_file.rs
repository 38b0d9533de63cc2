//! `camera.toml`: what the pixels of a recording mean. Nothing in it is guessed, so most of it is needed; all of it can be
//! given by hand instead ([`OpenOptions::set`](crate::OpenOptions::set) is the same type). The README is its reference.

use std::path::PathBuf;

use isobath::sensing::camera::Distortion;
use isobath::sensing::camera::convention::Convention;
use isobath::sensing::depth::decode::ByteOrder;
use serde::{Deserialize, Deserializer};

use crate::parse::ParseError;

/// What the numbers of a depth image are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// 16-bit steps of `unit`; 0 and 65535 are holes.
    U16,
    /// Android DEPTH16: 13 bits of millimetres, 3 of confidence.
    Depth16,
    /// Floating point, in steps of `unit` (1 m unless given); NaN, infinite, 0 and negative are holes.
    F32,
    /// Disparity in pixels: z = focal baseline / (disparity scale + offset).
    Disparity,
    /// A z-buffer, 0 (near) to 1 (far).
    Projective,
}

/// Which way a pose leads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// Camera points become world points: where the camera stands.
    #[default]
    CameraToWorld,
    /// World points become camera points ("extrinsics", "view matrix").
    WorldToCamera,
}

/// `[depth]`: what the values of depth images mean.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DepthSection {
    /// Folder of the depth images, or the one depth image; `depth` unless given. Also called `file`.
    #[serde(alias = "file")]
    pub path: Option<PathBuf>,
    /// What the numbers are; by the file's own type unless given. Headerless files need it.
    pub format: Option<Format>,
    /// Metres per step. For disparity and projective depth: keep the result as 16-bit steps of this, not as `f32` metres.
    pub unit: Option<f32>,
    /// Order of bytes, where it is not the file format's own.
    #[serde(deserialize_with = "byte_order")]
    pub byte_order: Option<ByteOrder>,
    /// Rows at the top that hold no depth.
    pub ignore_rows: Option<usize>,
    /// A stored value that means "no reading".
    pub background: Option<f32>,
    /// Nearest depth that is believed, metres.
    pub min_z: Option<f32>,
    /// Farthest depth that is believed, metres.
    pub max_z: Option<f32>,
    /// Least confidence that is believed, 0 to 255.
    pub min_confidence: Option<u8>,
    /// Disparity: focal length in pixels; `fx` unless given.
    pub focal: Option<f32>,
    /// Disparity: distance of the two cameras, metres.
    pub baseline: Option<f32>,
    /// Disparity: added to each, pixels; 0 unless given (Middlebury's doffs).
    pub offset: Option<f32>,
    /// Disparity: pixels per stored step; 1 unless given.
    pub scale: Option<f32>,
    /// Projective: near plane, metres.
    pub near: Option<f32>,
    /// Projective: far plane, metres; infinite unless given.
    pub far: Option<f32>,
}

/// `[colour]`: where colour images are.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ColourSection {
    /// Folder of the colour images, or the one image of a single depth image. Also called `file`.
    #[serde(alias = "file")]
    pub path: Option<PathBuf>,
}

/// `[pose]`: what the numbers of poses mean.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseSection {
    /// File of the poses. Also called `file`.
    #[serde(alias = "file")]
    pub path: Option<PathBuf>,
    /// Whose axes; OpenCV's unless given.
    #[serde(deserialize_with = "convention")]
    pub convention: Option<Convention>,
    /// Which way they lead; camera-to-world unless given.
    pub direction: Option<Direction>,
}

/// The content of `camera.toml`; every value may be missing.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraFile {
    /// Width of the depth image in pixels.
    pub width: Option<usize>,
    /// Height of the depth image in pixels.
    pub height: Option<usize>,
    /// Focal length in pixels, horizontal.
    pub fx: Option<f32>,
    /// Focal length in pixels, vertical; negative when y points up.
    pub fy: Option<f32>,
    /// Principal point in pixels (pixel centres are whole numbers), horizontal.
    pub cx: Option<f32>,
    /// Principal point in pixels, vertical.
    pub cy: Option<f32>,
    /// Lens coefficients in OpenCV's order: none, 4, 5 or 8.
    pub distortion: Option<Vec<f32>>,
    /// Which way is up in the world of the (converted) poses.
    pub up: Option<[f32; 3]>,
    /// Frames a second, for recordings without times; 30 unless given.
    pub frame_rate: Option<f64>,
    /// What depth values mean.
    pub depth: DepthSection,
    /// Where colour is. `[color]` is the same.
    #[serde(alias = "color")]
    pub colour: ColourSection,
    /// What poses mean.
    pub pose: PoseSection,
}

fn byte_order<'de, D: Deserializer<'de>>(d: D) -> Result<Option<ByteOrder>, D::Error> {
    #[derive(Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Name {
        Little,
        Big,
    }
    Ok(Some(match Name::deserialize(d)? {
        Name::Little => ByteOrder::Little,
        Name::Big => ByteOrder::Big,
    }))
}

fn convention<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Convention>, D::Error> {
    #[derive(Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Name {
        OpenCv,
        OpenGl,
        Unity,
    }
    Ok(Some(match Name::deserialize(d)? {
        Name::OpenCv => Convention::OpenCv,
        Name::OpenGl => Convention::OpenGl,
        Name::Unity => Convention::Unity,
    }))
}

/// `first!(a, b; x, y;)`: each value of `a`, or else of `b`.
macro_rules! first {
    ($over:expr, $base:expr; $($field:ident),*; $($rest:tt)*) => {
        Self { $($field: $over.$field.or($base.$field),)* $($rest)* }
    };
}

impl DepthSection {
    fn or(self, base: Self) -> Self {
        first!(self, base; path, format, unit, byte_order, ignore_rows, background, min_z, max_z, min_confidence, focal,
            baseline, offset, scale, near, far;)
    }
}

impl ColourSection {
    fn or(self, base: Self) -> Self {
        first!(self, base; path;)
    }
}

impl PoseSection {
    fn or(self, base: Self) -> Self {
        first!(self, base; path, convention, direction;)
    }
}

impl CameraFile {
    /// These values, and those of `base` where these are missing.
    #[must_use]
    pub fn or(self, base: Self) -> Self {
        first!(self, base; width, height, fx, fy, cx, cy, distortion, up, frame_rate;
            depth: self.depth.or(base.depth), colour: self.colour.or(base.colour), pose: self.pose.or(base.pose))
    }

    /// Reads a `camera.toml`.
    ///
    /// ```
    /// use isobath_recording::parse::CameraFile;
    /// let file = CameraFile::parse("fx = 525\nfy = 525\ncx = 319.5\ncy = 239.5\n[depth]\nunit = 0.001\n").unwrap();
    /// assert_eq!(file.fx, Some(525.0));
    /// let e = CameraFile::parse("fx = 525\nfocal = 3\n").unwrap_err();
    /// assert_eq!(e.line, Some(2));
    /// ```
    ///
    /// # Errors
    /// [`ParseError`] with the line that is not TOML, that has an unknown key, or a value that can't be.
    pub fn parse(text: &str) -> Result<Self, ParseError> {
        let file: Self = toml::from_str(text).map_err(|e| ParseError {
            line: e.span().and_then(|span| text.get(..span.start)).map(|before| before.matches('\n').count() + 1),
            what: e.message().trim().replace('\n', " "),
            hint: "the keys are listed in the README of isobath-recording".into(),
        })?;
        file.check().map_err(|e| ParseError { line: line_of(text, e.key), what: e.what, hint: e.hint })?;
        Ok(file)
    }

    /// Whether every value that is there can be.
    pub(crate) fn check(&self) -> Result<(), BadValue> {
        let bad = |key, value: String, hint: &str| {
            Err(BadValue { key, what: format!("{key} = {value} can't be"), hint: hint.into() })
        };
        let d = &self.depth;
        for (key, value) in [("width", self.width), ("height", self.height)] {
            if let Some(v @ (0 | 1_000_001..)) = value {
                return bad(key, v.to_string(), "sizes are pixels, 1 to 1000000");
            }
        }
        for (key, value) in
            [("unit", d.unit), ("focal", d.focal), ("baseline", d.baseline), ("scale", d.scale), ("near", d.near)]
        {
            if let Some(v) = value.filter(|v| !(v.is_normal() && *v > 0.0)) {
                return bad(
                    key,
                    v.to_string(),
                    "it must be a positive number (units and lengths are metres: 1 mm is 0.001)",
                );
            }
        }
        if let Some(v) = d.offset.filter(|v| !v.is_finite()) {
            return bad("offset", v.to_string(), "it must be a finite number of pixels");
        }
        for (key, value) in [("min_z", d.min_z), ("max_z", d.max_z)] {
            if let Some(v) = value.filter(|v| !(*v >= 0.0)) {
                return bad(key, v.to_string(), "depths are metres, not negative");
            }
        }
        if let (Some(near), Some(far)) = (d.near, d.far)
            && !(far > near)
        {
            return bad("far", far.to_string(), "it must be beyond near (inf is allowed)");
        }
        if let Some(v) = self.frame_rate.filter(|v| !(*v >= 1e-3 && *v <= 1e5)) {
            return bad("frame_rate", v.to_string(), "frames a second, 0.001 to 100000");
        }
        if let Some(v) = self.up.filter(|v| !(v.iter().map(|x| x * x).sum::<f32>().is_normal())) {
            return bad("up", format!("{v:?}"), "a direction like [0, -1, 0]");
        }
        if let Some(v) = self.distortion.as_ref().filter(|v| Distortion::from_slice(v).is_none()) {
            return bad(
                "distortion",
                format!("{v:?}"),
                "a list of 0, 4, 5 or 8 finite numbers in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6",
            );
        }
        Ok(())
    }
}

/// A value that can't be, and its key.
#[derive(Debug)]
pub(crate) struct BadValue {
    pub(crate) key: &'static str,
    pub(crate) what: String,
    pub(crate) hint: String,
}

/// The line that sets `key`.
fn line_of(text: &str, key: &str) -> Option<usize> {
    let sets = |line: &str| line.trim_start().strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='));
    text.lines().position(sets).map(|i| i + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn all_keys_are_read_and_given_values_win() {
        let text = "width = 4\nheight = 3\nfx = 1\nfy = -1\ncx = 0\ncy = 0\ndistortion = [0.1, 0, 0, 0, 0]\nup = [0, -1, 0]\nframe_rate = 15\n\
            [depth]\npath = 'd'\nformat = 'disparity'\nunit = 0.001\nbyte_order = 'big'\nignore_rows = 1\nbackground = 1.0\n\
            min_z = 0.1\nmax_z = 8\nmin_confidence = 100\nfocal = 1\nbaseline = 0.1\noffset = -3\nscale = 0.0625\nnear = 0.1\nfar = inf\n\
            [colour]\npath = 'c.png'\n[pose]\npath = 'p.txt'\nconvention = 'opengl'\ndirection = 'world-to-camera'\n";
        let file = CameraFile::parse(text).unwrap();
        assert_eq!(file.pose.convention, Some(Convention::OpenGl));
        assert_eq!(file.depth.far, Some(f32::INFINITY));
        let by_hand = CameraFile { fx: Some(9.0), ..CameraFile::default() };
        let both = by_hand.or(file.clone());
        assert_eq!((both.fx, both.depth.clone()), (Some(9.0), file.depth));
    }

    #[test]
    fn the_readme_is_right() {
        let (_, example) = include_str!("../README.md").split_once("```toml\n").unwrap();
        let file = CameraFile::parse(example.split("```").next().unwrap()).unwrap();
        assert_eq!((file.depth.near, file.colour.path), (Some(0.1), Some("rgb".into())));
    }

    #[test]
    fn errors_name_the_line() {
        for (text, line, word) in [
            ("fx = \n", 1, ""),
            ("\nfoo = 1\n", 2, "foo"),
            ("[depth]\nunit = 1\nformat = 'u17'\n", 3, "u17"),
            ("[depth]\nunit = -1\n", 2, "unit"),
            ("[depth]\nnear = 2\nfar = 1\n", 3, "far"),
            ("fx = 1\ndistortion = [1, 2]\n", 2, "distortion"),
            ("width = 0\n", 1, "width"),
            ("width = -5\n", 1, ""),
            ("up = [0, 0, 0]\n", 1, "up"),
            ("[pose]\nconvention = 'opencv '\n", 2, ""),
        ] {
            let e = CameraFile::parse(text).unwrap_err();
            assert_eq!(e.line, Some(line), "{text:?}: {e}");
            assert!(e.what.contains(word), "{text:?}: {e}");
        }
    }

    proptest! {
        #[test]
        fn any_text_gives_an_answer(text in "\\PC{0,80}") {
            let _ = CameraFile::parse(&text);
        }
    }
}
