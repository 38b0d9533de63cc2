//! Folders of numbered images: `depth/`, beside it `color/`, `colour/`, `image/` or `rgb/`, and poses in `trajectory.log`
//! (Open3D) or `pose.txt` or `poses.txt` (one a line).
//!
//! Which pose belongs to which image: as many poses as images are in the images' order. Otherwise poses are of all frames and
//! images of some (Open3D's samples keep every fifth), and the number in the image's name says which: the first of a
//! pose's three numbers in `trajectory.log`, the line counted from 0 in a list.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use isobath_source::SourceError;

use crate::camera_file::CameraFile;
use crate::files::{in_file, read_text};
use crate::parse::{RawPose, parse_pose_list, parse_trajectory_log};

use super::{Entry, Listing, PoseFrom, numbered_files, time_note, time_of};

const DEPTH: [&str; 4] = ["png", "pgm", "npy", "bin"];
const COLOUR: [&str; 5] = ["png", "jpg", "jpeg", "ppm", "pnm"];

pub(super) fn list(folder: &Path, depth: &Path, values: &CameraFile) -> Result<Listing, SourceError> {
    let mut notes: Vec<String> = time_note(values).into_iter().collect();
    let depth = numbered_files(depth, &DEPTH)?;
    let colour = match colour_folder(folder, values) {
        Some(colour) => numbered_files(&colour, &COLOUR)?,
        None => Vec::new(),
    };
    let by_stem: BTreeMap<_, _> = colour.iter().filter_map(|(_, p)| Some((p.file_stem()?, p))).collect();
    let by_number: BTreeMap<_, _> = colour.iter().filter_map(|(n, p)| Some(((*n)?, p))).collect();

    let poses = pose_file(folder, values);
    let poses = match &poses {
        Some(path) => read_poses(path)?,
        None => Vec::new(),
    };
    let in_order = poses.len() == depth.len();
    let by_id: BTreeMap<u64, RawPose> = poses.iter().copied().collect();
    if !in_order && !poses.is_empty() {
        notes.push(format!(
            "{} poses for {} images: each image takes the pose of the number in its name",
            poses.len(),
            depth.len()
        ));
    }

    let first = depth.first().and_then(|(n, _)| *n).unwrap_or(0);
    let mut entries = Vec::with_capacity(depth.len());
    for (index, (number, path)) in depth.into_iter().enumerate() {
        let mut entry = Entry { depth: path, ..Entry::default() };
        entry.time = time_of(number.map_or(index as u64, |n| n.saturating_sub(first)), values.frame_rate);
        let same_stem = entry.depth.file_stem().and_then(|stem| by_stem.get(stem));
        match same_stem.or_else(|| by_number.get(&number?)) {
            Some(colour) => entry.colour = Some(colour.to_path_buf()),
            None if !colour.is_empty() => entry.notes.push("no colour image has this name or number".into()),
            None => {}
        }
        let pose = if in_order { poses.get(index).map(|(_, pose)| pose) } else { number.and_then(|n| by_id.get(&n)) };
        match pose {
            Some(pose) => entry.pose = PoseFrom::Numbers(*pose),
            None if !poses.is_empty() => entry.notes.push("no pose has this image's number".into()),
            None => {}
        }
        entries.push(entry);
    }
    Ok(Listing { kind: "folder of numbered images", entries, notes })
}

fn colour_folder(folder: &Path, values: &CameraFile) -> Option<PathBuf> {
    match &values.colour.path {
        Some(given) => Some(folder.join(given)),
        None => ["color", "colour", "image", "rgb"].map(|name| folder.join(name)).into_iter().find(|p| p.is_dir()),
    }
}

fn pose_file(folder: &Path, values: &CameraFile) -> Option<PathBuf> {
    match &values.pose.path {
        Some(given) => Some(folder.join(given)),
        None => {
            ["trajectory.log", "pose.txt", "poses.txt"].map(|name| folder.join(name)).into_iter().find(|p| p.is_file())
        }
    }
}

/// Poses with the number of their frame.
fn read_poses(path: &Path) -> Result<Vec<(u64, RawPose)>, SourceError> {
    let text = read_text(path)?;
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("log")) {
        parse_trajectory_log(&text).map_err(in_file(path))
    } else {
        Ok((0..).zip(parse_pose_list(&text).map_err(in_file(path))?).collect())
    }
}
