//! What can go wrong with a source: what happened, where, and what to do about it.
//!
//! Errors fall into three groups, and a program treats each in one way:
//!
//! | group | errors | what a program does |
//! |---|---|---|
//! | the caller's | `Config`, `MissingCalibration`, `Unsupported`, `OutOfRange` | show it: it says which value to give |
//! | this frame's | `Io`, `Format` | show or count it, ask for the next frame |
//! | the end | `Disconnected` | stop: [`SourceError::is_terminal`] |
//!
//! A timeout is no error: see [`Outcome::TimedOut`](crate::Outcome::TimedOut).

use std::fmt;
use std::io;
use std::path::PathBuf;

/// Why a source could not be opened, or could not give a frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// The operating system refused; its error, with its number, is kept as the source.
    #[error("{}: {error}; {hint}", path.display())]
    Io {
        /// The file or device.
        path: PathBuf,
        /// What the system said.
        #[source]
        error: io::Error,
        /// What to do.
        hint: String,
    },
    /// A file's content is cut off, broken, or not of its format.
    #[error("{}{}: {what}; {hint}", path.display(), Line(*line))]
    Format {
        /// The file.
        path: PathBuf,
        /// The line of a text file, from 1.
        line: Option<usize>,
        /// What is wrong.
        what: String,
        /// What to do.
        hint: String,
    },
    /// A setting contradicts another one, or the data.
    #[error("{}: {what}; {hint}", path.display())]
    Config {
        /// The file the setting belongs to.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do.
        hint: String,
    },
    /// Values without which pixels can't become metres are not known, and are never guessed.
    #[error("{}: not known: {}; {hint}", path.display(), needed.join(", "))]
    MissingCalibration {
        /// The recording or device.
        path: PathBuf,
        /// The missing values.
        needed: Vec<&'static str>,
        /// How to give them, with an example to copy.
        hint: String,
    },
    /// The path or device is of no kind that this program reads.
    #[error("{}: {what}; {hint}", path.display())]
    Unsupported {
        /// What was asked for.
        path: PathBuf,
        /// Why not.
        what: String,
        /// What there is instead.
        hint: String,
    },
    /// A frame number beyond the recording's end.
    #[error("frame {asked} was asked for, the recording has {len} (counted from 0)")]
    OutOfRange {
        /// The frame asked for, from 0.
        asked: usize,
        /// Frames there are.
        len: usize,
    },
    /// The device is gone. No call on this source will succeed again.
    #[error("{device} is disconnected; plug it in and open it again")]
    Disconnected {
        /// Its name or path.
        device: String,
    },
}

impl SourceError {
    /// Whether the source will give no more frames: a loop over frames must end. After any other error the next call
    /// goes on with the next frame.
    #[must_use]
    pub const fn is_terminal(&self) -> bool {
        matches!(self, Self::Disconnected { .. })
    }

    /// The operating system's refusal to read `path`, with advice that fits its kind.
    #[must_use]
    pub fn io(path: impl Into<PathBuf>, error: io::Error) -> Self {
        let hint = match error.kind() {
            io::ErrorKind::NotFound => "check the path, and that the recording is complete",
            io::ErrorKind::PermissionDenied => "check who may read it (for cameras: the group that owns the device)",
            io::ErrorKind::UnexpectedEof => "the file is cut off: copy it again",
            _ => "check the medium it is on, and try again",
        };
        Self::Io { path: path.into(), error, hint: hint.to_owned() }
    }
}

/// `:12` for a line, nothing without one.
struct Line(Option<usize>);

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |line| write!(f, ":{line}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::error::Error;

    #[test]
    fn errors_say_where_what_and_what_to_do() {
        let e = SourceError::Format {
            path: "a/depth.txt".into(),
            line: Some(7),
            what: "no file name".into(),
            hint: "a line is: time file".into(),
        };
        assert_eq!(e.to_string(), "a/depth.txt:7: no file name; a line is: time file");
        assert!(!e.is_terminal());
        let e = SourceError::io("x.png", io::Error::from(io::ErrorKind::NotFound));
        assert!(e.source().is_some(), "the system's error is kept");
        assert!(e.to_string().starts_with("x.png: ") && e.to_string().contains("check the path"));
        assert!(SourceError::Disconnected { device: "/dev/video2".into() }.is_terminal());
    }
}
