//! What can go wrong with a source: what happened, where, and what to do about it.
//!
//! Errors fall into four groups, and a program treats each in one way:
//!
//! | group | errors | what a program does |
//! |---|---|---|
//! | the caller's | `Config`, `MissingCalibration`, `Unsupported`, `OutOfRange`, `Permission` | show it: it says which value to give, or which right |
//! | this frame's | `Io`, `Format`, `Corrupt` | show or count it, ask for the next frame |
//! | for now | `Busy`, `Link`, `LeaseLimit`: [`SourceError::is_retryable`] | try again, after a while or after what it says |
//! | the end | `Disconnected`: [`SourceError::is_terminal`] | stop |
//!
//! A timeout is no error: see [`Outcome::TimedOut`](crate::Outcome::TimedOut). Every number that the system or the device gave is kept
//! ([`SourceError::errno`], [`LinkKind::Unknown`]): what is not understood is shown, not dropped.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::permission::{Subsystem, group_of, hint};

/// How a link to a device failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum LinkKind {
    /// An endpoint stalled, or a transfer was refused (EPIPE).
    Stall,
    /// Bytes came damaged, or not by the protocol (EPROTO, EILSEQ).
    Protocol,
    /// The device sent more than there was room for (EOVERFLOW).
    Overflow,
    /// The device did not answer in its time (ETIMEDOUT).
    NoAnswer,
    /// The bus has no room for one more stream (ENOSPC).
    NoBandwidth,
    /// The system says "input/output error" and no more (EIO).
    Io,
    /// Whatever else: the system's or the device's number.
    Unknown(i32),
}

impl LinkKind {
    /// What to do about it.
    #[must_use]
    pub const fn advice(self) -> &'static str {
        match self {
            Self::Stall => "if it comes again, unplug the device and plug it in",
            Self::Protocol | Self::Io => "check cable and port: a short cable, straight into the computer",
            Self::Overflow => "choose a smaller size or frame rate",
            Self::NoAnswer => "if it comes again, unplug the device and plug it in; its firmware may hang",
            Self::NoBandwidth => {
                "stop other cameras on this bus, use another port, or choose a smaller size or frame rate"
            }
            Self::Unknown(_) => "if it comes again, report the number",
        }
    }
}

impl fmt::Display for LinkKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stall => "a transfer stalled",
            Self::Protocol => "bytes came damaged",
            Self::Overflow => "the device sent more than fits",
            Self::NoAnswer => "the device did not answer",
            Self::NoBandwidth => "the bus has no bandwidth left",
            Self::Io => "input/output error",
            Self::Unknown(code) => return write!(f, "error number {code}"),
        })
    }
}

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
    /// This user may not use the device.
    #[error("{}: {error}; {hint}", path.display())]
    Permission {
        /// The device.
        path: PathBuf,
        /// What the system said.
        #[source]
        error: io::Error,
        /// The group to join, and the udev line to add.
        hint: String,
    },
    /// Somebody else uses the device.
    #[error("{}: {error}; {hint}", path.display())]
    Busy {
        /// The device.
        path: PathBuf,
        /// What the system said.
        #[source]
        error: io::Error,
        /// Whom to ask.
        hint: String,
    },
    /// The way to the device failed. The source starts its stream anew with the next call.
    #[error("{}: {kind} ({doing}); {}", path.display(), kind.advice())]
    Link {
        /// The device.
        path: PathBuf,
        /// How.
        kind: LinkKind,
        /// What was being done.
        doing: &'static str,
        /// What the system said, where it did.
        #[source]
        error: Option<io::Error>,
    },
    /// What came is not a whole frame, or not an answer. Numbers only, so that it costs no memory where frames are read.
    #[error("{what}: {got} bytes came, {want} were needed; it is counted, ask for the next one")]
    Corrupt {
        /// What it should have been.
        what: &'static str,
        /// Bytes, or what else is counted, that came.
        got: u64,
        /// What was needed.
        want: u64,
    },
    /// As many frames are held as may be at once; the stream would starve.
    #[error("{limit} frames are held, which is all that may be; give one back first")]
    LeaseLimit {
        /// Frames that may be held.
        limit: usize,
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

    /// Whether the same call may succeed later, with nothing changed but time or what is held.
    #[must_use]
    pub const fn is_retryable(&self) -> bool {
        matches!(self, Self::Busy { .. } | Self::Link { .. } | Self::Corrupt { .. } | Self::LeaseLimit { .. })
    }

    /// The system's error number, where the system was who refused.
    #[must_use]
    pub fn errno(&self) -> Option<i32> {
        match self {
            Self::Io { error, .. } | Self::Permission { error, .. } | Self::Busy { error, .. } => error.raw_os_error(),
            Self::Link { error, .. } => error.as_ref()?.raw_os_error(),
            _ => None,
        }
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

    /// The system's refusal of something `doing` with the open device `path`, sorted by its number: gone, not permitted, in use, a failing link, or
    /// anything else as it is. `usb` is the device's vendor and product number.
    #[must_use]
    pub fn device(
        path: &Path,
        doing: &'static str,
        subsystem: Subsystem,
        usb: Option<(u16, u16)>,
        error: io::Error,
    ) -> Self {
        // Linux's numbers; the drivers for devices are for Linux.
        const ENOENT: i32 = 2;
        const EIO: i32 = 5;
        const ENXIO: i32 = 6;
        const EPERM: i32 = 1;
        const EACCES: i32 = 13;
        const EBUSY: i32 = 16;
        const ENODEV: i32 = 19;
        const ENOSPC: i32 = 28;
        const EPIPE: i32 = 32;
        const EPROTO: i32 = 71;
        const EOVERFLOW: i32 = 75;
        const EILSEQ: i32 = 84;
        const ESHUTDOWN: i32 = 108;
        const ETIMEDOUT: i32 = 110;
        let link = |kind, error| Self::Link { path: path.into(), kind, doing, error: Some(error) };
        match error.raw_os_error() {
            Some(ENODEV | ENXIO | ENOENT | ESHUTDOWN) => Self::Disconnected { device: path.display().to_string() },
            Some(EACCES | EPERM) => {
                let hint = hint(subsystem, group_of(path).as_deref(), usb);
                Self::Permission { path: path.into(), error, hint }
            }
            Some(EBUSY) => {
                let hint = format!("another program uses it: fuser -v {} says which", path.display());
                Self::Busy { path: path.into(), error, hint }
            }
            Some(EPIPE) => link(LinkKind::Stall, error),
            Some(EPROTO | EILSEQ) => link(LinkKind::Protocol, error),
            Some(EOVERFLOW) => link(LinkKind::Overflow, error),
            Some(ETIMEDOUT) => link(LinkKind::NoAnswer, error),
            Some(ENOSPC) => link(LinkKind::NoBandwidth, error),
            Some(EIO) => link(LinkKind::Io, error),
            _ => Self::Io { path: path.into(), error, hint: format!("it happened while {doing}") },
        }
    }

    /// The system's refusal to open the device `path`: as [`Self::device`], but a node that is not there is a wrong path, not a lost device.
    #[must_use]
    pub fn open_device(path: &Path, subsystem: Subsystem, usb: Option<(u16, u16)>, error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::NotFound {
            let hint =
                "check the path and that the device is plugged in; isobath devices lists what is there".to_owned();
            return Self::Io { path: path.into(), error, hint };
        }
        Self::device(path, "opening it", subsystem, usb, error)
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

    #[test]
    fn every_number_of_the_system_has_its_group() {
        let path = Path::new("/dev/video7");
        let of = |errno| {
            let error = io::Error::from_raw_os_error(errno);
            SourceError::device(path, "taking a buffer", Subsystem::Video4Linux, Some((0x8086, 0x0b07)), error)
        };
        for errno in 1..134 {
            let e = of(errno);
            let text = e.to_string();
            assert!(text.starts_with("/dev/video7") && text.contains("; "), "{errno}: {text}");
            match errno {
                2 | 6 | 19 | 108 => assert!(e.is_terminal() && !e.is_retryable(), "{errno}"),
                1 | 13 => assert!(matches!(e, SourceError::Permission { .. }) && text.contains("idVendor"), "{errno}"),
                16 => assert!(matches!(e, SourceError::Busy { .. }) && e.is_retryable()),
                5 | 28 | 32 | 71 | 75 | 84 | 110 => {
                    assert!(matches!(e, SourceError::Link { .. }) && e.is_retryable(), "{errno}");
                }
                _ => assert!(matches!(e, SourceError::Io { .. }) && !e.is_retryable(), "{errno}"),
            }
            assert_eq!(e.errno(), (!e.is_terminal()).then_some(errno), "the number is kept");
        }
        let gone = io::Error::from_raw_os_error(2);
        assert!(!SourceError::open_device(path, Subsystem::Video4Linux, None, gone).is_terminal());
    }

    #[test]
    fn unknown_codes_are_kept_and_shown() {
        let kind = LinkKind::Unknown(-7);
        let e = SourceError::Link { path: "usb:1-2".into(), kind, doing: "reading a register", error: None };
        assert_eq!(
            e.to_string(),
            "usb:1-2: error number -7 (reading a register); if it comes again, report the number"
        );
        assert_eq!(e.errno(), None);
        let e = SourceError::Corrupt { what: "a depth frame", got: 5, want: 9 };
        assert!(e.is_retryable() && !e.is_terminal());
        assert!(SourceError::LeaseLimit { limit: 2 }.is_retryable());
    }
}
