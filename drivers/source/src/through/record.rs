//! A source whose frames somebody else sees too: a recorder, a counter, a preview.

use crate::clock::Deadline;
use crate::error::SourceError;
use crate::frame::OwnedFrame;
use crate::source::{DepthSource, Gap, Outcome, SourceInfo};
use crate::stats::StreamStats;

/// Who sees each frame on its way to the caller.
pub trait FrameSink {
    /// A frame passes.
    ///
    /// # Errors
    /// Whatever keeps the sink from taking it. The frame still reaches the caller; the error does too, with the next call.
    fn frame(&mut self, frame: &OwnedFrame) -> Result<(), SourceError>;

    /// The stream broke and goes on.
    ///
    /// # Errors
    /// As [`Self::frame`].
    fn gap(&mut self, gap: Gap) -> Result<(), SourceError> {
        let _ = gap;
        Ok(())
    }

    /// The stream stopped, or ended: what is buffered should be written.
    ///
    /// # Errors
    /// As [`Self::frame`], but from [`DepthSource::stop`].
    fn finish(&mut self) -> Result<(), SourceError> {
        Ok(())
    }
}

impl<F: FnMut(&OwnedFrame) -> Result<(), SourceError>> FrameSink for F {
    fn frame(&mut self, frame: &OwnedFrame) -> Result<(), SourceError> {
        self(frame)
    }
}

/// A source that shows its frames to a sink.
#[derive(Debug)]
pub struct Recorded<S, K> {
    inner: S,
    sink: K,
    failed: Option<SourceError>,
}

impl<S: DepthSource, K: FrameSink> Recorded<S, K> {
    /// Shows the frames of `inner` to `sink`.
    #[must_use]
    pub const fn new(inner: S, sink: K) -> Self {
        Self { inner, sink, failed: None }
    }

    /// The sink.
    pub const fn sink(&mut self) -> &mut K {
        &mut self.sink
    }

    /// Source and sink.
    pub fn into_parts(self) -> (S, K) {
        (self.inner, self.sink)
    }
}

impl<S: DepthSource, K: FrameSink> DepthSource for Recorded<S, K> {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn start(&mut self) -> Result<(), SourceError> {
        self.inner.start()
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let finished = self.sink.finish();
        self.inner.stop()?;
        finished.and(self.failed.take().map_or(Ok(()), Err))
    }

    fn stats(&self) -> StreamStats {
        self.inner.stats()
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
        if let Some(error) = self.failed.take() {
            return Err(error);
        }
        let outcome = self.inner.next_into(frame, deadline)?;
        self.failed = match outcome {
            Outcome::Frame => self.sink.frame(frame).err(),
            Outcome::Recovered(gap) => self.sink.gap(gap).err(),
            Outcome::EndOfStream => self.sink.finish().err(),
            Outcome::TimedOut => None,
        };
        Ok(outcome)
    }
}
