//! The parsers: pure functions from bytes or text to values, for the readers, the tests and the fuzz targets alike.
//!
//! None of them panics, and none allocates more than a small multiple of what it was given, or of [`MAX_PIXELS`]. What they
//! refuse, they refuse with a [`ParseError`]: the line where there is one, what is wrong, what to do.

mod imu_csv;
mod npy;
mod pgm;
mod png16;
mod pose;
mod raw;
mod trajectory;
mod tum;

pub use crate::camera_file::CameraFile;
pub use imu_csv::parse_imu_csv;
pub use npy::{NpyArray, NpyData, NpySlice, parse_npy, write_npy};
pub use pgm::parse_pgm;
pub(crate) use png16::check_png_data;
pub use png16::decode_depth_png;
pub use pose::{RawPose, parse_pose_list, parse_pose_matrix};
pub use raw::{RawImage, RawPixels};
pub use trajectory::parse_trajectory_log;
pub use tum::{TumLine, parse_tum_list, parse_tum_poses};

/// The largest image that is read: 64 megapixels.
pub const MAX_PIXELS: usize = 64 << 20;

/// The longest side of an image that is read, pixels.
pub const MAX_SIDE: usize = 1 << 16;

/// Why bytes or text are not what they should be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}{what}; {hint}", line.map_or_else(String::new, |n| format!("line {n}: ")))]
pub struct ParseError {
    /// The line of a text, from 1.
    pub line: Option<usize>,
    /// What is wrong.
    pub what: String,
    /// What to do.
    pub hint: String,
}

impl ParseError {
    pub(crate) fn new(what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { line: None, what: what.into(), hint: hint.into() }
    }

    pub(crate) fn at(line: usize, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { line: Some(line), what: what.into(), hint: hint.into() }
    }
}

/// A size that can be read: not empty, at most [`MAX_PIXELS`], no side longer than [`MAX_SIDE`]; its pixel count.
pub(crate) fn checked_pixels(width: usize, height: usize) -> Result<usize, ParseError> {
    match width.checked_mul(height) {
        Some(0) => Err(ParseError::new(format!("the image is {width}x{height}: it has no pixels"), "write it again")),
        Some(n) if n <= MAX_PIXELS && width <= MAX_SIDE && height <= MAX_SIDE => Ok(n),
        _ => Err(ParseError::new(
            format!(
                "the image says it is {width}x{height}, more than {} megapixels or than {MAX_SIDE} along a side",
                MAX_PIXELS >> 20
            ),
            "the header is probably damaged; cut the image up if it is not",
        )),
    }
}

/// Text for an error message: short, on one line, quoted.
pub(crate) fn quoted(text: &str) -> String {
    let short: String = text.chars().take(40).collect();
    format!("{short:?}{}", if short.len() < text.len() { "..." } else { "" })
}

/// The lines of a list that say something: number from 1 and text, without comment lines (`#`) and empty ones.
pub(crate) fn content_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    text.lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// The numbers of a line, separated by blanks, commas or semicolons.
pub(crate) fn numbers(line: usize, text: &str) -> Result<Vec<f64>, ParseError> {
    text.split([' ', '\t', ',', ';'])
        .filter(|word| !word.is_empty())
        .map(|word| {
            word.parse().map_err(|_| {
                ParseError::at(line, format!("{} is not a number", quoted(word)), "numbers are like -1.25 or 3e-4")
            })
        })
        .collect()
}
