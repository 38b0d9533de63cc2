//! Which files make a recording, and in which order: one file here for each layout.
//!
//! A layout finds files and says what belongs together; it reads lists and trajectories, never images.

mod numbered;
mod seven_scenes;
mod single;
mod tum;

use std::path::{Component, Path, PathBuf};

use isobath::ground::units::Timestamp;
use isobath_source::SourceError;

use crate::camera_file::CameraFile;
use crate::files::{in_file, read_text};
use crate::parse::{RawPose, parse_pose_matrix};

/// Where a frame's pose comes from.
#[derive(Debug, Clone, Default)]
pub(crate) enum PoseFrom {
    #[default]
    Nowhere,
    Numbers(RawPose),
    File(PathBuf),
}

impl PoseFrom {
    /// The numbers, when there are any.
    pub(crate) fn read(&self) -> Result<Option<RawPose>, SourceError> {
        match self {
            Self::Nowhere => Ok(None),
            Self::Numbers(pose) => Ok(Some(*pose)),
            Self::File(path) => parse_pose_matrix(&read_text(path)?).map(Some).map_err(in_file(path)),
        }
    }
}

/// The files of one frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Entry {
    pub(crate) depth: PathBuf,
    pub(crate) colour: Option<PathBuf>,
    pub(crate) pose: PoseFrom,
    pub(crate) time: Timestamp,
    pub(crate) notes: Vec<String>,
}

/// The files of a recording.
#[derive(Debug, Default)]
pub(crate) struct Listing {
    pub(crate) kind: &'static str,
    pub(crate) entries: Vec<Entry>,
    pub(crate) notes: Vec<String>,
}

/// Finds out which layout `path` has, and lists its frames.
pub(crate) fn recognise(path: &Path, values: &CameraFile, association: f64) -> Result<Listing, SourceError> {
    let meta = path.metadata().map_err(|e| SourceError::io(path, e))?;
    if !meta.is_dir() {
        let folder = path.parent().unwrap_or(Path::new(""));
        return Ok(single::list(path, folder, values));
    }
    let depth = path.join(values.depth.path.as_deref().unwrap_or(Path::new("depth")));
    // `[depth] file = "depth.png"`: a folder that holds one frame.
    if values.depth.path.is_some() && depth.is_file() {
        return Ok(single::list(&depth, path, values));
    }
    let listing = if path.join("depth.txt").is_file() {
        tum::list(path, values, association)?
    } else if depth.is_dir() {
        numbered::list(path, &depth, values)?
    } else {
        match seven_scenes::list(path, values)? {
            Some(listing) => listing,
            None => {
                return Err(SourceError::Unsupported {
                    path: path.into(),
                    what: "is a folder of no known layout".into(),
                    hint: "a recording has depth.txt (TUM RGB-D), or frame-000000.depth.png (7-Scenes), or a folder \
                           depth/ (Open3D, plain); depth.path in camera.toml may name another folder; a single image is opened by its own path"
                        .into(),
                });
            }
        }
    };
    if listing.entries.is_empty() {
        return Err(SourceError::Unsupported {
            path: path.into(),
            what: format!("looks like a {}, but has no frames", listing.kind),
            hint: "check that it was unpacked completely".into(),
        });
    }
    Ok(listing)
}

/// The files of a folder with one of these extensions, as (number in the name, path), in order of number, then name.
fn numbered_files(folder: &Path, extensions: &[&str]) -> Result<Vec<(Option<u64>, PathBuf)>, SourceError> {
    let io = |e| SourceError::io(folder, e);
    let mut files = Vec::new();
    for entry in folder.read_dir().map_err(io)? {
        let path = entry.map_err(io)?.path();
        let known = path
            .extension()
            .and_then(|e| e.to_str())
            .is_some_and(|e| extensions.iter().any(|known| known.eq_ignore_ascii_case(e)));
        // Hidden files are other programs' (macOS leaves `._name` beside each file it packs).
        let hidden = path.file_name().and_then(|n| n.to_str()).is_none_or(|n| n.starts_with('.'));
        if known && !hidden && path.is_file() {
            files.push((number_in(&path), path));
        }
    }
    files.sort();
    Ok(files)
}

/// The last number in a file's name without its extension.
fn number_in(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?;
    let digits = |c: char| c.is_ascii_digit();
    let end = stem.rfind(digits)? + 1;
    let start = stem.get(..end)?.rfind(|c| !digits(c)).map_or(0, |i| i + 1);
    // A first byte of a longer character can't be cut: `rfind` gives where it starts, so look for the digits' own start.
    let start = (start..end).find(|&i| stem.as_bytes().get(i).is_some_and(u8::is_ascii_digit))?;
    stem.get(start..end)?.parse().ok()
}

/// When a frame was taken, in a recording without times: `index` frames after the first.
fn time_of(index: u64, frame_rate: Option<f64>) -> Timestamp {
    Timestamp::from_seconds(index as f64 / frame_rate.unwrap_or(DEFAULT_FRAME_RATE)).unwrap_or_default()
}

/// Frames a second where nothing says otherwise.
const DEFAULT_FRAME_RATE: f64 = 30.0;

fn time_note(values: &CameraFile) -> Option<String> {
    values.frame_rate.is_none().then(|| {
        format!("no times in this layout: {DEFAULT_FRAME_RATE} frames a second assumed (frame_rate in camera.toml)")
    })
}

/// A path that a list in the recording names: it must stay inside the recording.
fn inside(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = Path::new(name);
    name.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)).then(|| folder.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names() {
        for (name, number) in [
            ("00005.png", Some(5)),
            ("frame_00025_depth.png", Some(25)),
            ("a1b22é.pgm", Some(22)),
            ("é7.pgm", Some(7)),
            ("depth.png", None),
            ("99999999999999999999999.png", None),
        ] {
            assert_eq!(number_in(Path::new(name)), number, "{name}");
        }
    }

    #[test]
    fn lists_stay_inside() {
        let folder = Path::new("/data");
        assert_eq!(inside(folder, "./depth/1.png"), Some(folder.join("./depth/1.png")));
        assert_eq!(inside(folder, "../secret"), None);
        assert_eq!(inside(folder, "/etc/passwd"), None);
    }
}
