//! 7-Scenes (Shotton et al., CVPR 2013) and what follows it: `frame-000000.depth.png`, `.color.png`, `.pose.txt` in one folder.

use std::path::Path;

use isobath_source::SourceError;

use crate::camera_file::CameraFile;

use super::{Entry, Listing, PoseFrom, number_in, numbered_files, time_note, time_of};

/// The frames; `None` when no file is named like this.
pub(super) fn list(folder: &Path, values: &CameraFile) -> Result<Option<Listing>, SourceError> {
    let mut entries = Vec::new();
    let mut first = None;
    // Ordered by number: `frame-000012.depth` is the stem.
    for (_, depth) in numbered_files(folder, &["png"])? {
        let Some(base) = depth.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_suffix(".depth.png")) else {
            continue;
        };
        let number = number_in(Path::new(base)).unwrap_or(entries.len() as u64);
        let first = *first.get_or_insert(number);
        let beside = |end: &str| Some(folder.join(format!("{base}{end}"))).filter(|p| p.is_file());
        let colour = [".color.png", ".color.jpg", ".colour.png", ".rgb.png"].iter().find_map(|end| beside(end));
        let pose = beside(".pose.txt").map_or(PoseFrom::Nowhere, PoseFrom::File);
        let time = time_of(number.saturating_sub(first), values.frame_rate);
        entries.push(Entry { colour, pose, time, notes: Vec::new(), depth });
    }
    let notes = time_note(values).into_iter().collect();
    Ok((!entries.is_empty()).then_some(Listing { kind: "7-Scenes folder", entries, notes }))
}
