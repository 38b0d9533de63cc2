//! Real recordings and published renderings beside the project (`../shared/data`, or the folder named by `ISOBATH_DATA`): used
//! where they are, and missed by nobody where not. In all of them the camera moves.

use std::path::{Path, PathBuf};

use isobath::sensing::depth::noise::DepthNoise;
use isobath_recording::{OpenOptions, open};
use isobath_source::{Deadline, DepthPixels, Outcome, OwnedFrame};

use crate::sequence::{Depths, Kind, Sequence};

/// Where a recording's depth images are and what they were seen with: millimetres all, as their READMEs say.
struct Recording {
    name: &'static str,
    /// Of the depth images, below the data folder.
    folder: &'static str,
    /// What their names end in.
    ending: &'static str,
    /// Focal length and principal point, pixels.
    camera: [f32; 3],
    sensor: &'static str,
    noise: DepthNoise,
}

const ALL: [Recording; 3] = [
    Recording {
        name: "align3d",
        folder: "align3d_ilrgbd/sample1",
        ending: "_depth.png",
        camera: [544.473, 320.0, 240.0],
        sensor: "Xtion",
        noise: DepthNoise::KINECT,
    },
    Recording {
        name: "redwood",
        folder: "open3d_redwood_rgbd/depth",
        ending: ".png",
        camera: [525.0, 319.5, 239.5],
        sensor: "its noise",
        noise: DepthNoise::KINECT,
    },
    Recording {
        name: "icl",
        folder: "icl_livingroom1_micro/depth",
        ending: ".png",
        camera: [525.0, 319.5, 239.5],
        sensor: "1 mm steps",
        noise: DepthNoise::NONE,
    },
];

/// Where the data would be.
pub(crate) fn root() -> PathBuf {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    std::env::var_os("ISOBATH_DATA").map_or_else(beside, PathBuf::from)
}

/// The first frames of every recording that is there, and a word on each that is not.
pub(crate) fn sequences(frames: usize) -> (Vec<Sequence>, Vec<String>) {
    let root = root();
    let (mut found, mut missed) = (Vec::new(), Vec::new());
    for recording in &ALL {
        match read(recording, &root.join(recording.folder), frames) {
            Ok(sequence) => found.push(sequence),
            Err(why) => missed.push(format!("{} left out: {why}", recording.name)),
        }
    }
    (found, missed)
}

fn read(recording: &Recording, folder: &Path, frames: usize) -> Result<Sequence, String> {
    let list = std::fs::read_dir(folder).map_err(|_| format!("no folder {}", folder.display()))?;
    let ends = |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().ends_with(recording.ending));
    let mut paths: Vec<PathBuf> = list.filter_map(|entry| Some(entry.ok()?.path())).filter(ends).collect();
    paths.sort();
    let mut options = OpenOptions { colour: false, ..OpenOptions::default() };
    let [f, cx, cy] = recording.camera;
    (options.set.fx, options.set.fy, options.set.cx, options.set.cy) = (Some(f), Some(f), Some(cx), Some(cy));
    options.set.depth.unit = Some(0.001);
    let (mut frame, mut depth) = (OwnedFrame::new(), Vec::new());
    for path in paths.iter().take(frames) {
        let read = open(path, &options).and_then(|mut image| image.next_into(&mut frame, Deadline::NEVER));
        if read.map_err(|e| e.to_string())? != Outcome::Frame {
            return Err(format!("{} gave no frame", path.display()));
        }
        let DepthPixels::U16(pixels) = frame.depth() else { return Err(format!("{} is not u16", path.display())) };
        depth.push(pixels.clone());
    }
    let size = frame.size();
    if depth.len() < 2 || depth.iter().any(|d| d.len() != size.0 * size.1) {
        return Err(format!("{} holds no two images of one size", folder.display()));
    }
    Ok(Sequence {
        name: recording.name.to_owned(),
        kind: Kind::Full,
        sensor: recording.sensor,
        size,
        unit: frame.unit,
        intrinsics: frame.intrinsics,
        noise: recording.noise,
        depth: Depths::U16(depth),
        truth: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_said() {
        let why = read(&ALL[0], Path::new("/no/such/folder"), 2).unwrap_err();
        assert!(why.contains("/no/such/folder"), "{why}");
        let (found, missed) = sequences(2);
        assert_eq!(found.len() + missed.len(), ALL.len());
        assert!(found.iter().all(|s| s.size == (640, 480) && !s.is_exact()));
    }
}
