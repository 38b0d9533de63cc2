//! The traits that every source implements: live cameras, recordings, simulated scenes.

use std::path::PathBuf;

use isobath::glam::Vec3;
use isobath::sensing::camera::Intrinsics;

use crate::clock::Deadline;
use crate::error::SourceError;
use crate::frame::OwnedFrame;
use crate::stats::StreamStats;

/// What came of asking for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
#[must_use]
pub enum Outcome {
    /// The frame is filled.
    Frame,
    /// There are no more frames; the frame is left as it was. Asking again gives the same answer.
    EndOfStream,
    /// The deadline passed first; the frame is left as it was. The stream is unharmed: ask again.
    TimedOut,
    /// The stream broke and goes on; the frame is left as it was. Ask again for the first frame after the gap.
    Recovered(Gap),
}

/// A hole in a stream that is whole again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// What broke it.
    pub cause: GapCause,
    /// Frames that did not come, when the device's or the kernel's counters tell.
    pub lost: Option<u64>,
}

/// Why frames are missing from a stream that goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum GapCause {
    /// The link failed (a stalled endpoint, lost packets, an input-output error) and the stream was started again.
    Link,
    /// The device was unplugged and is back.
    Replugged,
    /// The device's clock or counter jumped: it was reset.
    Reset,
    /// The caller was slower than the device: see [`BackPressure::Every`](crate::BackPressure::Every).
    Overrun,
}

/// What a source is, and what it will give.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceInfo {
    /// The kind, in a few words: "TUM RGB-D folder", "Intel RealSense D435".
    pub kind: String,
    /// Where it was opened.
    pub path: PathBuf,
    /// Width and height of the depth images, when known before the first frame.
    pub size: Option<(usize, usize)>,
    /// The depth camera's pinhole; a frame's own intrinsics are what counts.
    pub intrinsics: Intrinsics,
    /// Which way is up in the world of the poses (unit length), when known.
    pub up: Option<Vec3>,
    /// Whether frames may carry colour.
    pub has_colour: bool,
    /// Whether frames may carry poses.
    pub has_poses: bool,
    /// What a user should know: what was assumed, what is missing.
    pub notes: Vec<String>,
}

/// A stream of depth frames. Object-safe: programs hold a `Box<dyn DepthSource>`.
pub trait DepthSource {
    /// What the source is.
    fn info(&self) -> &SourceInfo;

    /// Begins to deliver, with every buffer made; [`Self::next_into`] allocates nothing after this once `frame` has its size. Recordings
    /// need no start, and a live source that was not started starts with the first frame asked for. Starting twice changes nothing.
    ///
    /// # Errors
    /// [`SourceError`]: the device is busy, gone, or refuses the format.
    fn start(&mut self) -> Result<(), SourceError> {
        Ok(())
    }

    /// Ends the stream and gives the device's buffers back. Stopping twice changes nothing; [`Self::start`] starts anew.
    ///
    /// # Errors
    /// [`SourceError`]; the stream is stopped all the same.
    fn stop(&mut self) -> Result<(), SourceError> {
        Ok(())
    }

    /// What became of the frames so far. Sources that can't lose frames say so with zeros.
    fn stats(&self) -> StreamStats {
        StreamStats::default()
    }

    /// Fills `frame` with the next one, waiting until `deadline` at most. Buffers in `frame` are reused.
    ///
    /// # Errors
    /// [`SourceError`]; unless it [is terminal](SourceError::is_terminal), the next call goes on with the next frame. After an
    /// error the content of `frame` is unspecified.
    fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError>;
}

/// A source that ends and can be read in any order.
pub trait Recording: DepthSource {
    /// Frames there are.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The frame that the next call of [`DepthSource::next_into`] gives, counted from 0; [`Self::len`] at the end.
    fn position(&self) -> usize;

    /// Makes `index` (from 0) the next frame; `len()` is the end.
    ///
    /// # Errors
    /// [`SourceError::OutOfRange`] beyond the end; the position is kept.
    fn seek(&mut self, index: usize) -> Result<(), SourceError> {
        let len = self.len();
        if index > len {
            return Err(SourceError::OutOfRange { asked: index, len });
        }
        self.set_position(index);
        Ok(())
    }

    /// What [`Self::seek`] does once `index` is known to be at most [`Self::len`].
    fn set_position(&mut self, index: usize);
}

/// A source behind a pointer is a source.
macro_rules! pointer {
    ($pointer:ty) => {
        impl<S: DepthSource + ?Sized> DepthSource for $pointer {
            fn info(&self) -> &SourceInfo {
                (**self).info()
            }

            fn start(&mut self) -> Result<(), SourceError> {
                (**self).start()
            }

            fn stop(&mut self) -> Result<(), SourceError> {
                (**self).stop()
            }

            fn stats(&self) -> StreamStats {
                (**self).stats()
            }

            fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
                (**self).next_into(frame, deadline)
            }
        }
    };
}

pointer!(Box<S>);
pointer!(&mut S);
