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
    Clock, ClockEstimate, ClockEvent, Deadline, DepthSource, DeviceClock, DeviceTicks, Gap, GapCause, HostNanos,
    Outcome, OwnedFrame, SourceError, SourceInfo, StreamStats,
};

use crate::colour::ColourView;
use crate::decode::Decoder;
use crate::meta::{MetaStream, Record};
use crate::queue::Failure;
use crate::stream::{Event, Frame, Stream};
use crate::sys::{FourCc, V4l2Sys};

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
        if !self.started
            && let Err(error) = self.start()
        {
            // Who asks again at once must not keep a core busy with it.
            self.depth.rest(&*self.clock, deadline);
            return Err(error);
        }
        loop {
            let seen = match self.depth.next(&*self.clock, deadline) {
                Ok(Event::Frame(seen)) => seen,
                Ok(Event::TimedOut) => return Ok(Outcome::TimedOut),
                Ok(Event::Recovered(gap @ Gap { cause: GapCause::Overrun, .. })) => return Ok(Outcome::Recovered(gap)),
                Ok(Event::Recovered(gap)) => {
                    if let Some(meta) = &mut self.meta {
                        meta.restarted();
                    }
                    self.counter.reset();
                    self.counted_at = None;
                    return Ok(Outcome::Recovered(gap));
                }
                Err(failure) => {
                    if failure.errno.is_gone() {
                        // Nothing of a lost device is kept mapped; its error is told already.
                        let _ = self.end();
                    }
                    return Err(self.place.error(failure));
                }
            };
            let record = self.meta.as_mut().and_then(|meta| meta.of(seen.buffer.sequence));
            let (time, event) = self.learn(&seen, record);
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
            let now = self.clock.now();
            let arrival = seen.stamp.unwrap_or(now);
            self.depth.waited(now.saturating_since(arrival));
            frame.time = time.unwrap_or(arrival).timestamp();
            frame.sequence = seen.number;
            frame.straighten(&self.camera);
            if event == ClockEvent::Jump {
                frame.notes.push("the camera's clock jumped: its times were carried on by the host's".into());
            }
            self.collect_colour();
            if let Some(colour) = &self.colour {
                colour.view.colour(frame, arrival);
            }
            return Ok(Outcome::Frame);
        }
    }
}
