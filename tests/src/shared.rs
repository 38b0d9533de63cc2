//! Real recordings and ground truth beside the project (`../shared/data`), for tests that use them when they are there.

use std::path::PathBuf;

/// A folder of the shared data; `None`, said on standard output, where it is missing. A clone alone has none.
#[must_use]
pub fn folder(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")).join(name);
    if path.is_dir() {
        return Some(path);
    }
    println!("skipped: no shared data at {}", path.display());
    None
}
