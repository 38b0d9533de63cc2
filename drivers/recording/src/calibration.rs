//! From what `camera.toml` and the command line say, to what a reader needs; and the error that says what is missing.

use std::path::{Path, PathBuf};

use isobath::glam::Vec3;
use isobath::sensing::camera::convention::Convention;
use isobath::sensing::camera::{Camera, Distortion, Intrinsics};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::confidence::Limits;
use isobath::sensing::depth::decode::{ByteOrder, Disparity, Projective};
use isobath_source::SourceError;

use crate::camera_file::{CameraFile, Direction, Format};
use crate::parse::{RawImage, RawPixels};

/// Which number type depth images are stored in, decided once for the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Meaning {
    U16(DepthUnit),
    Depth16,
    F32(DepthUnit),
    /// `Some` unit: to be kept as `u16`.
    Disparity(Disparity, Option<DepthUnit>),
    Projective(Projective, Option<DepthUnit>),
}

/// What is known before the first image is read.
#[derive(Debug)]
pub(crate) struct Known {
    /// The merged, checked values.
    pub(crate) values: CameraFile,
    /// The camera.toml that was read, or the one that should be written.
    pub(crate) path: PathBuf,
    /// Whether it was there.
    pub(crate) found: bool,
}

/// Everything that a reader needs to make frames of files.
#[derive(Debug)]
pub(crate) struct Calibration {
    pub(crate) camera: Camera,
    pub(crate) size: (usize, usize),
    pub(crate) meaning: Meaning,
    pub(crate) ignore_rows: usize,
    pub(crate) background: Option<f32>,
    pub(crate) limits: Option<Limits>,
    pub(crate) convention: Convention,
    pub(crate) direction: Direction,
    pub(crate) up: Option<Vec3>,
}

impl Known {
    pub(crate) fn byte_order(&self) -> Option<ByteOrder> {
        self.values.depth.byte_order
    }

    /// Size and number type of files that have no header.
    pub(crate) fn headerless(&self, path: &Path) -> Result<(usize, usize, Format), SourceError> {
        let v = &self.values;
        match (v.width, v.height, v.depth.format) {
            (Some(width), Some(height), Some(format)) => Ok((width, height, format)),
            (width, height, format) => Err(self.missing(
                path,
                &[
                    ("width", width.is_none()),
                    ("height", height.is_none()),
                    ("depth.format", format.is_none()),
                    ("fx, fy, cx, cy", v.fx.or(v.fy).or(v.cx).or(v.cy).is_none()),
                ],
            )),
        }
    }

    /// Completes the calibration, now that an image shows its size and number type.
    pub(crate) fn complete(&self, image: &RawImage, image_path: &Path) -> Result<Calibration, SourceError> {
        let v = &self.values;
        let d = &v.depth;
        let format = d.format.unwrap_or(match image.pixels {
            RawPixels::U16(_) => Format::U16,
            RawPixels::F32(_) => Format::F32,
        });
        let bad = |what: String, hint: &str| SourceError::Config { path: self.path.clone(), what, hint: hint.into() };

        let (Some(fx), Some(fy), Some(cx), Some(cy)) = (v.fx, v.fy, v.cx, v.cy) else {
            return Err(self.missing_of(image_path, format));
        };
        let unit = d.unit.map(DepthUnit::new).transpose().map_err(|e| bad(e.to_string(), "give metres per step"))?;
        let meaning = match format {
            Format::U16 => unit.map(Meaning::U16),
            Format::Depth16 => Some(Meaning::Depth16),
            Format::F32 => Some(Meaning::F32(unit.unwrap_or(DepthUnit::METRE))),
            Format::Disparity => d.baseline.map(|baseline| {
                let focal = d.focal.unwrap_or_else(|| fx.abs());
                let (offset, scale) = (d.offset.unwrap_or(0.0), d.scale.unwrap_or(1.0));
                Meaning::Disparity(Disparity { focal, baseline, offset, scale }, unit)
            }),
            Format::Projective => d.near.map(|near| {
                let far = d.far.unwrap_or(f32::INFINITY);
                Meaning::Projective(Projective { near, far }, unit)
            }),
        };
        let meaning = meaning.ok_or_else(|| self.missing_of(image_path, format))?;
        match (format, &image.pixels) {
            (Format::U16 | Format::Depth16, RawPixels::F32(_)) => {
                return Err(bad(
                    format!(
                        "depth.format says 16-bit whole numbers, but {} holds floating point",
                        image_path.display()
                    ),
                    "use format = \"f32\", \"disparity\" or \"projective\"",
                ));
            }
            (Format::F32 | Format::Projective, RawPixels::U16(_)) => {
                return Err(bad(
                    format!(
                        "depth.format says floating point, but {} holds 16-bit whole numbers",
                        image_path.display()
                    ),
                    "use format = \"u16\", \"depth16\" or \"disparity\"",
                ));
            }
            _ => {}
        }
        let intrinsics = Intrinsics::new(fx, fy, cx, cy).map_err(|e| bad(e.to_string(), "check the calibration"))?;
        let size = (image.width, image.height);
        let said = (v.width.unwrap_or(size.0), v.height.unwrap_or(size.1));
        if said != size {
            return Err(bad(
                format!("is for {}x{} images, but {} is {}x{}", said.0, said.1, image_path.display(), size.0, size.1),
                "fx, fy, cx and cy belong to one size: scale them, or correct width and height",
            ));
        }
        let default = Limits::default();
        let limits = Limits {
            min_z: d.min_z.unwrap_or(default.min_z),
            max_z: d.max_z.unwrap_or(default.max_z),
            min_confidence: d.min_confidence.unwrap_or(default.min_confidence),
        };
        Ok(Calibration {
            // Lengths were checked with the rest of the file.
            camera: Camera {
                intrinsics,
                distortion: v.distortion.as_deref().and_then(Distortion::from_slice).unwrap_or_default(),
            },
            size,
            meaning,
            ignore_rows: d.ignore_rows.unwrap_or(0),
            background: d.background,
            limits: (limits != default).then_some(limits),
            convention: v.pose.convention.unwrap_or_default(),
            direction: v.pose.direction.unwrap_or_default(),
            up: v.up.and_then(|up| Vec3::from(up).try_normalize()),
        })
    }

    fn missing_of(&self, recording: &Path, format: Format) -> SourceError {
        let v = &self.values;
        self.missing(
            recording,
            &[
                ("fx", v.fx.is_none()),
                ("fy", v.fy.is_none()),
                ("cx", v.cx.is_none()),
                ("cy", v.cy.is_none()),
                ("depth.unit", format == Format::U16 && v.depth.unit.is_none()),
                ("depth.baseline", format == Format::Disparity && v.depth.baseline.is_none()),
                ("depth.near", format == Format::Projective && v.depth.near.is_none()),
            ],
        )
    }

    fn missing(&self, recording: &Path, values: &[(&'static str, bool)]) -> SourceError {
        let file = self.path.display();
        let (verb, also) = if self.found { ("add them to", " of the whole file") } else { ("write them into", "") };
        SourceError::MissingCalibration {
            path: recording.into(),
            needed: values.iter().filter(|(_, missing)| *missing).map(|(name, _)| *name).collect(),
            hint: format!(
                "{verb} {file}; an example{also} (a Kinect; take your camera's own values):\n\n{EXAMPLE}\n\
                 or give them by hand: --intrinsics FX,FY,CX,CY --unit METRES_PER_STEP, and --size WxH for headerless files, whose depth.format stands in camera.toml"
            ),
        }
    }
}

const EXAMPLE: &str = "    width = 640          # of the depth image, pixels
    height = 480
    fx = 525.0           # focal lengths and principal point, pixels
    fy = 525.0
    cx = 319.5
    cy = 239.5

    [depth]
    format = \"u16\"       # u16, depth16, f32, disparity or projective
    unit = 0.001         # metres per step: 0.001 is millimetres, 0.0002 is TUM RGB-D
";
