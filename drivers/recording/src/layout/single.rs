//! One depth image, with its colour image where `colour.path` names one.

use std::path::Path;

use crate::camera_file::CameraFile;

use super::{Entry, Listing};

pub(super) fn list(path: &Path, folder: &Path, values: &CameraFile) -> Listing {
    let entry = Entry {
        depth: path.into(),
        colour: values.colour.path.as_ref().map(|colour| folder.join(colour)),
        ..Entry::default()
    };
    Listing { kind: "single depth image", entries: vec![entry], notes: Vec::new() }
}
