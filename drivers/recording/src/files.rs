//! Reading files whole, with a bound, and errors that name them.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use isobath_source::SourceError;

use crate::parse::{MAX_PIXELS, ParseError};

/// The largest image file: 64 megapixels of eight bytes, and a header.
const MAX_IMAGE_BYTES: u64 = MAX_PIXELS as u64 * 8 + (64 << 10);
/// The longest list, trajectory or camera.toml.
const MAX_TEXT_BYTES: u64 = 64 << 20;

/// Reads a whole image file into `buffer`.
pub(crate) fn read_image(path: &Path, buffer: &mut Vec<u8>) -> Result<(), SourceError> {
    buffer.clear();
    read(path, MAX_IMAGE_BYTES, buffer)
}

/// Reads a whole text file.
pub(crate) fn read_text(path: &Path) -> Result<String, SourceError> {
    let mut bytes = Vec::new();
    read(path, MAX_TEXT_BYTES, &mut bytes)?;
    String::from_utf8(bytes).map_err(|_| SourceError::Format {
        path: path.into(),
        line: None,
        what: "is not text (UTF-8)".into(),
        hint: "check that it is the file it should be".into(),
    })
}

fn read(path: &Path, limit: u64, buffer: &mut Vec<u8>) -> Result<(), SourceError> {
    let io = |e| SourceError::io(path, e);
    let file = File::open(path).map_err(io)?;
    // Devices and pipes may never end, directories have no content.
    if !file.metadata().map_err(io)?.is_file() {
        return Err(SourceError::Unsupported {
            path: path.into(),
            what: "is not a regular file".into(),
            hint: "recordings are files and folders".into(),
        });
    }
    file.take(limit + 1).read_to_end(buffer).map_err(io)?;
    if buffer.len() as u64 > limit {
        return Err(SourceError::Format {
            path: path.into(),
            line: None,
            what: format!("is longer than {limit} bytes"),
            hint: "it is not what it seems, or needs to be cut up".into(),
        });
    }
    Ok(())
}

/// A parser's error, in this file.
pub(crate) fn in_file(path: &Path) -> impl Fn(ParseError) -> SourceError {
    move |e| SourceError::Format { path: path.into(), line: e.line, what: e.what, hint: e.hint }
}
