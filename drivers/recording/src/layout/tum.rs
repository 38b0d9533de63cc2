//! TUM RGB-D (Sturm et al., IROS 2012): `depth.txt` and `rgb.txt` list images with their times, `groundtruth.txt` poses. Depth
//! leads; colour and pose are those nearest in time, when near enough. The data set's own `associate.py` does alike.

use std::path::Path;

use isobath::ground::units::Timestamp;
use isobath_source::SourceError;

use crate::camera_file::CameraFile;
use crate::files::{in_file, read_text};
use crate::parse::{TumLine, parse_tum_list, parse_tum_poses};

use super::{Entry, Listing, PoseFrom, inside};

pub(super) fn list(folder: &Path, values: &CameraFile, association: f64) -> Result<Listing, SourceError> {
    let mut notes = Vec::new();
    let depth_path = folder.join("depth.txt");
    let depth_text = read_text(&depth_path)?;
    let depth = sorted_list(&depth_path, &depth_text)?;

    let colour_path = folder.join("rgb.txt");
    let colour_text = if colour_path.is_file() { read_text(&colour_path)? } else { String::new() };
    let colour = sorted_list(&colour_path, &colour_text)?;

    let pose_path = folder.join(values.pose.path.as_deref().unwrap_or(Path::new("groundtruth.txt")));
    let poses = if pose_path.is_file() {
        let mut poses = parse_tum_poses(&read_text(&pose_path)?).map_err(in_file(&pose_path))?;
        poses.sort_by_key(|(time, _)| *time);
        poses
    } else {
        notes.push(format!("no poses: {} is not there", pose_path.display()));
        Vec::new()
    };

    let within = Timestamp::from_seconds(association.abs()).map_or(i64::MAX, Timestamp::as_nanos);
    let mut entries = Vec::with_capacity(depth.len());
    for line in depth {
        let mut entry = Entry { depth: located(folder, &depth_path, &line)?, time: line.time, ..Entry::default() };
        if let Some(found) = nearest(&colour, |c| c.time, line.time, within) {
            entry.colour = Some(located(folder, &colour_path, found)?);
        } else if !colour.is_empty() {
            entry.notes.push(format!("no colour: rgb.txt has no image within {association} s"));
        }
        if let Some((_, pose)) = nearest(&poses, |p| p.0, line.time, within) {
            entry.pose = PoseFrom::Numbers(*pose);
        } else if !poses.is_empty() {
            entry.notes.push(format!("no pose: {} has none within {association} s", pose_path.display()));
        }
        entries.push(entry);
    }
    Ok(Listing { kind: "TUM RGB-D folder", entries, notes })
}

fn sorted_list<'a>(path: &Path, text: &'a str) -> Result<Vec<TumLine<'a>>, SourceError> {
    let mut list = parse_tum_list(text).map_err(in_file(path))?;
    list.sort_by_key(|line| line.time);
    Ok(list)
}

fn located(folder: &Path, list: &Path, line: &TumLine<'_>) -> Result<std::path::PathBuf, SourceError> {
    inside(folder, line.rest).ok_or_else(|| SourceError::Format {
        path: list.into(),
        line: Some(line.line),
        what: format!("{:?} is outside the recording", line.rest),
        hint: "paths are relative to the list, without ..".into(),
    })
}

/// The item nearest to `time` in a list sorted by time, at most `within` nanoseconds away; the earlier of two as near.
fn nearest<T>(sorted: &[T], time_of: impl Fn(&T) -> Timestamp, time: Timestamp, within: i64) -> Option<&T> {
    let distance = |item: &T| time_of(item).as_nanos().saturating_sub(time.as_nanos()).saturating_abs();
    let after = sorted.partition_point(|item| time_of(item) < time);
    let candidates = sorted.get(after.saturating_sub(1)..sorted.len().min(after + 1)).unwrap_or(&[]);
    candidates.iter().min_by_key(|item| distance(item)).filter(|item| distance(item) <= within)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_in_time_is_found_when_near_enough() {
        let times = [10, 20, 40].map(Timestamp::from_nanos);
        let at = |t, within| nearest(&times, |t| *t, Timestamp::from_nanos(t), within).map(|t| t.as_nanos());
        assert_eq!(at(0, 10), Some(10));
        assert_eq!(at(0, 9), None);
        assert_eq!(at(15, 9), Some(10));
        assert_eq!(at(31, 9), Some(40));
        assert_eq!(at(49, 9), Some(40));
        assert_eq!(at(i64::MIN, i64::MAX - 1), None);
        assert_eq!(nearest(&[] as &[Timestamp], |t| *t, Timestamp::ZERO, i64::MAX), None);
    }
}
