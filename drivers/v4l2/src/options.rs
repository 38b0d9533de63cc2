//! How to open a camera, and what its calibration file says.

use std::path::PathBuf;

use isobath_recording::CameraFile;
use isobath_source::{BackPressure, SourceError};

use crate::sys::FourCc;
use crate::sysfs::Roots;

/// How to open a camera.
///
/// ```
/// use isobath_v4l2::OpenOptions;
/// let mut options = OpenOptions { size: Some((640, 480)), ..OpenOptions::default() };
/// options.set.depth.unit = Some(0.001); // wins over what camera file and camera say
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct OpenOptions {
    /// A file of the same form as a recording's `camera.toml`: what the camera does not say of itself.
    pub camera: Option<PathBuf>,
    /// Values given by hand; they win over those of the file, which win over those of the camera.
    pub set: CameraFile,
    /// Width and height in pixels. Default: the camera file's, else 848 x 480 or 640 x 480 where the camera has it, else what the camera is set to.
    pub size: Option<(u32, u32)>,
    /// Frames a second. Default 30; a camera that has no such rate takes its nearest.
    pub rate: u32,
    /// Pixel format. Default: the first of `Z16 `, `INZI`, `Y16 `, `Y16 -BE`, `Y14 `, `Y12 `, `Y10 `, `Y10B` that the node has.
    pub format: Option<FourCc>,
    /// Whether to read the colour camera too, where the device's calibration says how it stands to the depth camera. Default true.
    pub colour: bool,
    /// Which frames a slow caller gets. Default the newest.
    pub policy: BackPressure,
    /// The kernel's file trees.
    pub roots: Roots,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self {
            camera: None,
            set: CameraFile::default(),
            size: None,
            rate: 30,
            format: None,
            colour: true,
            policy: BackPressure::Latest,
            roots: Roots::default(),
        }
    }
}

impl OpenOptions {
    /// The values given by hand and by the file.
    pub(crate) fn values(&self) -> Result<CameraFile, SourceError> {
        let Some(path) = &self.camera else { return Ok(self.set.clone()) };
        let text = std::fs::read_to_string(path).map_err(|e| SourceError::io(path.clone(), e))?;
        let file = CameraFile::parse(&text).map_err(|e| SourceError::Format {
            path: path.clone(),
            line: e.line,
            what: e.what,
            hint: e.hint,
        })?;
        Ok(self.set.clone().or(file))
    }
}
