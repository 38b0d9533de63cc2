//! A camera as a depth source: its streams, its calibration and its clock, together.
//!
//! The time of a frame is the middle of its exposure by the host's monotonic clock where the camera's metadata tells (device time stamp less half the
//! exposure, mapped by [`DeviceClock`]); otherwise the time of arrival, which is later by exposure, read-out and transfer.

use std::path::PathBuf;

use isobath::sensing::camera::Camera;
use isobath::wire::device::d4xx::metadata::FrameInfo;
use isobath_source::permission::Subsystem;
use isobath_source::stats::{SequenceGaps, Step};
use isobath_source::{
    Clock, ClockEstimate, ClockEvent, Deadline, DepthSource, DeviceClock, DeviceTicks, GapCause, HostNanos, Outcome,
    OwnedFrame, SourceError, SourceInfo, StreamStats,
};

use crate::colour::ColourView;
use crate::decode::Decoder;
use crate::meta::{MetaStream, Record};
use crate::queue::{Failure, Held};
use crate::stream::{Event, Frame, Stream};
use crate::sys::{Buffer, Format, FourCc, V4l2Sys};

/// Buffers of metadata: more than of images, so that none is missed.
const META_BUFFERS: u32 = 8;

/// A node, in error messages.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    pub(crate) path: PathBuf,
    pub(crate) usb: Option<(u16, u16)>,
}

impl Place {
    pub(crate) fn error(&self, failure: Failure) -> SourceError {
        let (doing, error) = (failure.doing, failure.errno.into());
        SourceError::device(&self.path, doing, Subsystem::Video4Linux, self.usb, error)
    }
}

/// The colour stream and its view.
#[derive(Debug)]
pub(crate) struct Colour<S> {
    pub(crate) stream: Stream<S>,
    pub(crate) view: ColourView,
}

/// A frame as the driver wrote it, held by its reader.
#[derive(Debug, PartialEq, Eq)]
#[must_use = "give it back, or the stream has one buffer less"]
pub struct RawFrame {
    held: Held,
    buffer: Buffer,
    /// Its time, as a frame's.
    pub time: HostNanos,
    /// Its number, as a frame's.
    pub sequence: u64,
}

/// A frame that waits in its buffer.
#[derive(Debug, Clone, Copy)]
struct Seen {
    number: u64,
    time: HostNanos,
    arrival: HostNanos,
    jumped: bool,
}

enum Waited {
    Frame(Seen),
    Other(Outcome),
}

/// A depth camera of Video4Linux.
pub struct V4l2Source<S> {
    pub(crate) info: SourceInfo,
    pub(crate) place: Place,
    pub(crate) clock: Box<dyn Clock + Send>,
    pub(crate) depth: Stream<S>,
    pub(crate) decoder: Decoder,
    pub(crate) camera: Camera,
    pub(crate) meta: Option<MetaStream<S>>,
    pub(crate) colour: Option<Colour<S>>,
    pub(crate) device_clock: Option<DeviceClock>,
    /// The device's own count, and the kernel's number it was last seen with.
    pub(crate) counter: SequenceGaps,
    pub(crate) counted_at: Option<u64>,
    pub(crate) last_info: Option<FrameInfo>,
    pub(crate) started: bool,
    pub(crate) last_time: HostNanos,
}

impl<S: std::fmt::Debug> std::fmt::Debug for V4l2Source<S> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("V4l2Source").field("info", &self.info).field("depth", &self.depth).finish_non_exhaustive()
    }
}

impl<S: V4l2Sys> V4l2Source<S> {
    /// What the metadata of the last frame said; `None` without metadata.
    #[must_use]
    pub const fn last_info(&self) -> Option<&FrameInfo> {
        self.last_info.as_ref()
    }

    /// What is known of the camera's clock against the host's; `None` without metadata.
    #[must_use]
    pub fn clock_estimate(&self) -> Option<ClockEstimate> {
        self.device_clock.as_ref()?.estimate()
    }

    /// The colour camera: its pinhole, its place in the depth camera's frame, its image size; `None` when it is not read.
    #[must_use]
    pub fn colour_view(&self) -> Option<&ColourView> {
        self.colour.as_ref().map(|c| &c.view)
    }

    /// The format of the metadata; `None` without.
    #[must_use]
    pub fn metadata_format(&self) -> Option<FourCc> {
        self.meta.as_ref().map(MetaStream::format)
    }

    /// The depth node's system, for tests.
    #[doc(hidden)]
    pub const fn sys(&mut self) -> &mut S {
        self.depth.sys()
    }

    fn begin(&mut self) -> Result<(), Failure> {
        if self.started {
            return Ok(());
        }
        if let Some(meta) = &mut self.meta
            && let Err(failure) = meta.start(META_BUFFERS)
        {
            // Images come without.
            self.info.notes.push(format!("no metadata: {} ({})", failure.errno, failure.doing));
            self.meta = None;
        }
        self.counter.reset();
        self.counted_at = None;
        self.depth.start()?;
        if let Some(colour) = &mut self.colour
            && let Err(failure) = colour.stream.start()
        {
            self.info.notes.push(format!("no colour: {} ({})", failure.errno, failure.doing));
            self.colour = None;
            self.info.has_colour = false;
        }
        self.started = true;
        Ok(())
    }

    fn end(&mut self) -> Result<(), Failure> {
        self.started = false;
        let mut result = self.depth.stop();
        if let Some(meta) = &mut self.meta {
            result = result.and(meta.stop());
        }
        if let Some(colour) = &mut self.colour {
            result = result.and(colour.stream.stop());
            colour.view.forget();
        }
        result
    }

    /// The time of a frame, and what it teaches about the clocks and the device's losses. `None` for the time where only the arrival is known.
    fn learn(&mut self, frame: &Frame, record: Option<Record>) -> (Option<HostNanos>, ClockEvent) {
        self.last_info = record.map(|r| r.info);
        let Some(record) = record else { return (None, ClockEvent::Steady) };
        if let Some(count) = record.info.frame_counter {
            match self.counter.next(count) {
                Step::On { lost } => {
                    // What the kernel saw missing is in its own count already.
                    let kernel = self.counted_at.map_or(0, |at| frame.number.saturating_sub(at + 1));
                    self.depth.lost_by_device(lost.saturating_sub(kernel));
                }
                Step::Back => self.counter = SequenceGaps::after(count),
            }
            self.counted_at = Some(frame.number);
        }
        let (Some(clock), Some(pts)) = (&mut self.device_clock, record.pts) else { return (None, ClockEvent::Steady) };
        let arrival = if record.arrival.0 > 0 { record.arrival } else { frame.stamp.unwrap_or_default() };
        if arrival.0 == 0 {
            return (None, ClockEvent::Steady);
        }
        let (ticks, event) = clock.observe(pts.into(), arrival);
        let half = u64::from(record.info.exposure.unwrap_or(0)) / 2;
        (clock.to_host(DeviceTicks(ticks.0.saturating_sub(half))), event)
    }

    /// The next frame as the driver wrote it, to hold: nothing is copied or decoded, and its memory stays as it is until it is [given
    /// back](Self::give_back). There is one exactly when the outcome is [`Outcome::Frame`].
    ///
    /// # Errors
    /// [`SourceError::LeaseLimit`] when all buffers but two are held: the stream would starve. Else as [`DepthSource::next_into`].
    pub fn lease(&mut self, deadline: Deadline) -> Result<(Outcome, Option<RawFrame>), SourceError> {
        if let Some(limit) = self.depth.lease_limit_reached() {
            return Err(SourceError::LeaseLimit { limit });
        }
        let seen = match self.wait(deadline)? {
            Waited::Frame(seen) => seen,
            Waited::Other(outcome) => return Ok((outcome, None)),
        };
        let raw =
            self.depth.hold().map(|(held, buffer)| RawFrame { held, buffer, time: seen.time, sequence: seen.number });
        let outcome = if raw.is_some() { Outcome::Frame } else { Outcome::TimedOut };
        Ok((outcome, raw))
    }

    /// The bytes of a held frame, in the format of [`Self::raw_format`]; none once the stream was stopped.
    #[must_use]
    pub fn raw_bytes(&self, frame: &RawFrame) -> &[u8] {
        self.depth.held_bytes(&frame.held, &frame.buffer, 0)
    }

    /// The format of raw frames: letters, size, bytes a row.
    #[must_use]
    pub const fn raw_format(&self) -> &Format {
        self.depth.format()
    }

    /// Gives a held frame back to the driver. One that is not given back is missed by the stream until it is stopped.
    pub fn give_back(&mut self, frame: RawFrame) {
        self.depth.give_back(frame.held);
    }

    /// Waits for a frame, and learns what comes with it.
    fn wait(&mut self, deadline: Deadline) -> Result<Waited, SourceError> {
        if !self.started
            && let Err(error) = self.start()
        {
            // Who asks again at once must not keep a core busy with it.
            self.depth.rest(&*self.clock, deadline);
            return Err(error);
        }
        let frame = match self.depth.next(&*self.clock, deadline) {
            Ok(Event::Frame(frame)) => frame,
            Ok(Event::TimedOut) => return Ok(Waited::Other(Outcome::TimedOut)),
            Ok(Event::Recovered(gap)) => {
                if gap.cause != GapCause::Overrun {
                    // The kernel counts anew.
                    if let Some(meta) = &mut self.meta {
                        meta.restarted();
                    }
                    self.counter.reset();
                    self.counted_at = None;
                }
                return Ok(Waited::Other(Outcome::Recovered(gap)));
            }
            Err(failure) => {
                if failure.errno.is_gone() {
                    // Nothing of a lost device is kept mapped; its error is told already.
                    let _ = self.end();
                }
                return Err(self.place.error(failure));
            }
        };
        let record = self.meta.as_mut().and_then(|meta| meta.of(frame.buffer.sequence));
        let (time, event) = self.learn(&frame, record);
        let now = self.clock.now();
        let arrival = frame.stamp.unwrap_or(now);
        self.depth.waited(now.saturating_since(arrival));
        // Frames with metadata and without it are stamped by two rules; their order is the stream's all the same.
        let time = time.unwrap_or(arrival).max(self.last_time);
        self.last_time = time;
        Ok(Waited::Frame(Seen { number: frame.number, time, arrival, jumped: event == ClockEvent::Jump }))
    }

    /// Takes the colour image that is there, without waiting.
    fn collect_colour(&mut self) {
        let Some(colour) = &mut self.colour else { return };
        let now = self.clock.now();
        match colour.stream.next(&*self.clock, Deadline::at(HostNanos(0))) {
            Ok(Event::Frame(frame)) => {
                colour.view.take(colour.stream.bytes(0), frame.stamp.unwrap_or(now));
                colour.stream.release();
            }
            Ok(Event::TimedOut | Event::Recovered(_)) => {}
            // Depth goes on without; if the whole device is gone, depth will say so.
            Err(_) => {
                colour.view.forget();
                let _ = colour.stream.stop();
            }
        }
    }
}

impl<S: V4l2Sys> DepthSource for V4l2Source<S> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), SourceError> {
        let result = self.begin();
        if result.is_err() {
            // What was begun beside depth is undone; the first failure is the one to tell.
            let _ = self.end();
        }
        result.map_err(|failure| self.place.error(failure))
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.end().map_err(|failure| self.place.error(failure))
    }

    fn stats(&self) -> StreamStats {
        self.depth.stats()
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
        loop {
            let seen = match self.wait(deadline)? {
                Waited::Frame(seen) => seen,
                Waited::Other(outcome) => return Ok(outcome),
            };
            frame.clear();
            let decoded = self.decoder.decode(self.depth.bytes(0), frame);
            self.depth.release();
            if decoded.is_err() {
                self.depth.spoil();
                if deadline.has_passed(self.clock.now()) {
                    return Ok(Outcome::TimedOut);
                }
                continue;
            }
            frame.time = seen.time.timestamp();
            frame.sequence = seen.number;
            frame.straighten(&self.camera);
            if seen.jumped {
                frame.notes.push("the camera's clock jumped: its times were carried on by the host's".into());
            }
            self.collect_colour();
            if let Some(colour) = &self.colour {
                colour.view.colour(frame, seen.arrival);
            }
            return Ok(Outcome::Frame);
        }
    }
}
