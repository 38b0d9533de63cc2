//! Whole frames of one node, one after the other, within a deadline.
//!
//! The queue says whose a buffer is; here it is decided what a buffer is worth, and what to do when there is none. A buffer is a whole frame if the kernel
//! did not flag it (`V4L2_BUF_FLAG_ERROR`: since Linux 6.14 uvcvideo hands broken frames over instead of dropping them) and holds as many bytes as its
//! format needs. Everything else is counted and given back, so that delivered and lost frames add up to the span of the kernel's numbers.
//!
//! What can stall must not spin: an unplugged camera makes `poll` return at once, for ever (librealsense kept a core busy with it until 2026). So an
//! error of `poll` is followed by one attempt to take a buffer, whose error tells; a gone device is final; a failing link is restarted, with pauses that
//! double from 2 ms to half a second and end with the deadline. Between two frames there are at most a few calls, and then a pause.

use std::time::Duration;

use isobath_source::stats::{SequenceGaps, Step};
use isobath_source::{BackPressure, Clock, Deadline, Gap, GapCause, HostNanos, StreamStats, TickCounter};

use crate::queue::{CaptureQueue, Failure, Held, Taken, uninterrupted};
use crate::sys::{Buffer, CLOCK_MONOTONIC, Errno, FLAG_ERROR, FLAGS_CLOCK, Format, Kind, V4l2Sys};

/// Looks at a node that says "ready" and gives nothing, before it is left alone for a while.
const EMPTY_LOOKS: u32 = 4;
/// The longest pause between attempts to restart a link.
const LONGEST: Duration = Duration::from_millis(500);
/// After a buffer that came back empty, because a transfer failed, the next frame is waited for this long: uvcvideo does not send a failed transfer
/// again, and when all have failed (an endpoint that halted), nothing ever comes.
const GRACE: Duration = Duration::from_millis(500);
/// The longest pause after useless buffers.
const IDLE: Duration = Duration::from_millis(20);
/// Restarts without a frame after which everything is given back and asked for anew.
const RESTARTS: u32 = 4;

/// What waiting for a frame gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A whole frame; its buffer is the program's until the next call.
    Frame(Frame),
    /// The deadline passed.
    TimedOut,
    /// The stream broke, and runs again; or, for the policy that wants every frame, some are missing before the next.
    Recovered(Gap),
}

/// A whole frame's buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// The buffer.
    pub buffer: Buffer,
    /// When the kernel saw it, by the monotonic clock; `None` when the driver stamps by another.
    pub stamp: Option<HostNanos>,
    /// The kernel's number, unwrapped, and carried on over restarts.
    pub number: u64,
}

/// What a buffer is worth.
enum Worth {
    Whole {
        lost: u64,
    },
    Nothing,
    /// Given back empty, because a transfer failed.
    Cancelled,
}

/// A node that streams.
#[derive(Debug)]
pub struct Stream<S> {
    sys: S,
    kind: Kind,
    format: Format,
    /// Bytes a whole frame has at least.
    need: usize,
    policy: BackPressure,
    queue: Option<CaptureQueue>,
    gaps: SequenceGaps,
    numbers: TickCounter,
    /// Added to the kernel's numbers since the last restart.
    base: u64,
    last_number: Option<u64>,
    stats: StreamStats,
    /// The frame that the caller looks at.
    current: Option<Buffer>,
    /// A frame to give with the next call, after the gap before it was told.
    pending: Option<Buffer>,
    /// Who owns what is unknown: restart before anything else.
    broken: Option<Failure>,
    /// When a buffer came back empty, if no whole frame came since.
    cancelled: Option<HostNanos>,
    /// Failures since the last whole frame.
    failures: u32,
    gone: Option<Failure>,
}

/// The kernel's stamp of a buffer, if it is one of the monotonic clock.
#[must_use]
pub fn stamp(buffer: &Buffer) -> Option<HostNanos> {
    let time = HostNanos::from_parts(buffer.seconds, buffer.micros.checked_mul(1000)?)?;
    (buffer.flags & FLAGS_CLOCK == CLOCK_MONOTONIC && time.0 > 0).then_some(time)
}

/// Waits a while, and no longer than the deadline.
fn rest(sys: &mut impl V4l2Sys, clock: &dyn Clock, deadline: Deadline, time: Duration) {
    let time = deadline.remaining(clock.now()).map_or(time, |left| left.min(time));
    if time > Duration::ZERO {
        sys.pause(time);
    }
}

impl<S: V4l2Sys> Stream<S> {
    /// A stream of the format that was granted. A frame with fewer than `need` bytes is not whole.
    pub fn new(sys: S, kind: Kind, format: Format, need: usize, policy: BackPressure) -> Self {
        Self {
            sys,
            kind,
            format,
            need,
            policy,
            queue: None,
            gaps: SequenceGaps::default(),
            numbers: TickCounter::new(32),
            base: 0,
            last_number: None,
            stats: StreamStats::default(),
            current: None,
            pending: None,
            broken: None,
            cancelled: None,
            failures: 0,
            gone: None,
        }
    }

    /// The node.
    pub const fn sys(&mut self) -> &mut S {
        &mut self.sys
    }

    /// The format that was granted.
    #[must_use]
    pub const fn format(&self) -> &Format {
        &self.format
    }

    /// What became of the frames. Delivered are those that were not [spoilt](Self::spoil).
    #[must_use]
    pub const fn stats(&self) -> StreamStats {
        self.stats
    }

    /// Whether it runs.
    #[must_use]
    pub const fn is_running(&self) -> bool {
        self.queue.is_some()
    }

    /// Starts, unless it runs.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn start(&mut self) -> Result<(), Failure> {
        if let Some(failure) = self.gone {
            return Err(failure);
        }
        if self.queue.is_none() {
            let count = self.policy.pool() as u32;
            match CaptureQueue::start(&mut self.sys, self.kind, self.format.count, count) {
                Ok(queue) => self.queue = Some(queue),
                Err(failure) => return Err(self.failed(failure)),
            }
            self.begin_numbers();
        }
        Ok(())
    }

    /// The kernel counts from 0 again: later frames get later numbers all the same.
    fn begin_numbers(&mut self) {
        self.gaps.reset();
        self.numbers.reset();
        self.base = self.last_number.map_or(0, |n| n + 1);
        self.forget_pending();
        (self.current, self.broken, self.cancelled) = (None, None, None);
    }

    /// Notes that the device is gone, if that is what a failure says.
    fn failed(&mut self, failure: Failure) -> Failure {
        if failure.errno.is_gone() {
            self.gone = Some(failure);
            // Mappings outlive a device; they are given back now.
            let _ = self.stop();
        }
        failure
    }

    /// A frame that was counted in the span and is given to nobody.
    fn forget_pending(&mut self) {
        if self.pending.take().is_some() {
            self.stats.dropped_by_policy += 1;
        }
    }

    /// Stops, and gives everything back. Stopping twice changes nothing.
    ///
    /// # Errors
    /// [`Failure`]; it is stopped all the same.
    pub fn stop(&mut self) -> Result<(), Failure> {
        self.forget_pending();
        (self.current, self.broken) = (None, None);
        self.queue.take().map_or(Ok(()), |mut queue| queue.stop(&mut self.sys))
    }

    /// The bytes of a plane of the frame that was given last; nothing when there is none.
    #[must_use]
    pub fn bytes(&self, plane: usize) -> &[u8] {
        match (&self.queue, &self.current) {
            (Some(queue), Some(buffer)) => queue.bytes(&self.sys, buffer, plane),
            _ => &[],
        }
    }

    /// How many frames may be held, when that many are.
    #[must_use]
    pub fn lease_limit_reached(&self) -> Option<usize> {
        self.queue.as_ref().filter(|q| !q.can_hold()).map(CaptureQueue::lease_limit)
    }

    /// Holds the frame that was given last: it is not given back with the next call. `None` when there is none, or too many are held.
    pub fn hold(&mut self) -> Option<(Held, Buffer)> {
        let buffer = self.current?;
        let held = self.queue.as_mut()?.hold(buffer.index)?;
        self.current = None;
        Some((held, buffer))
    }

    /// The bytes of a plane of a held frame; none once its stream was stopped.
    #[must_use]
    pub fn held_bytes(&self, held: &Held, buffer: &Buffer, plane: usize) -> &[u8] {
        self.queue.as_ref().map_or(&[], |queue| queue.held_bytes(&self.sys, held, buffer, plane))
    }

    /// Gives a held frame back to the kernel; one of a stream that was stopped is nobody's.
    pub fn give_back(&mut self, held: Held) {
        if let Some(queue) = &mut self.queue
            && let Err(failure) = queue.give_back(&mut self.sys, held)
            && self.broken.is_none()
        {
            self.broken = Some(failure);
        }
    }

    /// The last frame turned out to be broken: it counts as corrupt, not as delivered.
    pub const fn spoil(&mut self) {
        self.stats.delivered = self.stats.delivered.saturating_sub(1);
        self.stats.corrupt += 1;
    }

    /// Frames that the device's own counter misses beyond the kernel's.
    pub const fn lost_by_device(&mut self, frames: u64) {
        self.stats.dropped_by_device += frames;
    }

    /// Notes how long the last frame waited.
    pub fn waited(&mut self, latency: Duration) {
        self.stats.waited(latency);
    }

    /// Waits after a failure: 2 ms after the first, twice as long after each, half a second at most, and no longer than the deadline.
    pub fn rest(&mut self, clock: &dyn Clock, deadline: Deadline) {
        let pause = Duration::from_millis(2 << self.failures.min(9));
        rest(&mut self.sys, clock, deadline, pause.min(LONGEST));
    }

    /// Gives the frame that the caller looked at back to the kernel.
    pub fn release(&mut self) {
        if let Some(buffer) = self.current.take() {
            self.give(buffer.index);
        }
    }

    /// A failure is left for the next call: it goes the way of all failures there.
    fn give(&mut self, index: u32) {
        if self.broken.is_none()
            && let Some(queue) = &mut self.queue
            && let Err(failure) = queue.give(&mut self.sys, index)
        {
            self.broken = Some(failure);
        }
    }

    /// Waits for the next whole frame, until `deadline` at most. A stream that does not run is started. The buffer of the last frame is given back.
    ///
    /// # Errors
    /// [`Failure`]: the device is gone (for good), or the link failed and could not be restarted; then the next call tries again.
    pub fn next(&mut self, clock: &dyn Clock, deadline: Deadline) -> Result<Event, Failure> {
        if self.queue.is_none() && self.failures > 0 && self.gone.is_none() {
            self.rest(clock, deadline);
        }
        if let Err(failure) = self.start() {
            self.failures = self.failures.saturating_add(1);
            return Err(failure);
        }
        self.release();
        if let Some(buffer) = self.pending.take() {
            return Ok(self.deliver(buffer));
        }
        // The newest whole frame so far, when only that one is wanted.
        let mut best: Option<Buffer> = None;
        let (mut useless, mut empty, mut after_error, mut pause) = (0, 0, false, Duration::from_millis(1));
        loop {
            if let Some(failure) = self.broken {
                // A frame in hand comes first: the restart waits for the next call.
                return match best {
                    Some(buffer) => Ok(self.deliver(buffer)),
                    None => self.recover(failure, clock, deadline),
                };
            }
            let Some(queue) = &mut self.queue else { return Ok(Event::TimedOut) };
            let pool = queue.len() as u32;
            match queue.take(&mut self.sys) {
                Ok(Taken::Buffer(buffer)) => {
                    (empty, after_error) = (0, false);
                    let worth = self.judge(&buffer);
                    match worth {
                        Worth::Whole { lost } => {
                            (self.failures, self.cancelled) = (0, None);
                            if let Some(old) = best.replace(buffer) {
                                self.stats.dropped_by_policy += 1;
                                self.give(old.index);
                            }
                            useless += 1;
                            if self.policy == BackPressure::Every && lost > 0 {
                                self.pending = best;
                                return Ok(Event::Recovered(Gap { cause: GapCause::Overrun, lost: Some(lost) }));
                            }
                            // As many as there are buffers at most: a camera may fill them as fast as they are looked through.
                            if self.policy != BackPressure::Latest || useless >= pool {
                                return Ok(self.deliver(buffer));
                            }
                        }
                        Worth::Nothing | Worth::Cancelled => {
                            if matches!(worth, Worth::Cancelled) {
                                self.cancelled.get_or_insert(clock.now());
                            }
                            self.give(buffer.index);
                            useless += 1;
                            if useless > pool && best.is_none() {
                                // Broken buffers as fast as they are given back.
                                rest(&mut self.sys, clock, deadline, pause);
                                pause = (pause * 2).min(IDLE);
                                if deadline.has_passed(clock.now()) {
                                    return Ok(Event::TimedOut);
                                }
                            }
                        }
                    }
                    continue;
                }
                Ok(Taken::Nothing) => {}
                Err(failure) if failure.errno.is_gone() && best.is_none() => return Err(self.failed(failure)),
                Err(failure) => {
                    self.broken = Some(failure);
                    continue;
                }
            }
            if let Some(buffer) = best {
                return Ok(self.deliver(buffer));
            }
            if after_error {
                // It said "error" and had none to tell: it does not stream.
                self.broken =
                    Some(Failure { doing: "waiting for a frame (the stream stands still)", errno: Errno::EIO });
                continue;
            }
            if empty >= EMPTY_LOOKS {
                rest(&mut self.sys, clock, deadline, pause);
                pause = (pause * 2).min(IDLE);
            }
            let left = deadline.remaining(clock.now());
            let grace = self.cancelled.map(|at| GRACE.saturating_sub(clock.now().saturating_since(at)));
            if grace == Some(Duration::ZERO) {
                self.broken = Some(Failure { doing: "waiting for a frame (a transfer failed)", errno: Errno::EPIPE });
                continue;
            }
            if left == Some(Duration::ZERO) {
                return Ok(Event::TimedOut);
            }
            let sys = &mut self.sys;
            // Interruptions shorten the wait: what is left is computed anew for each.
            match uninterrupted(|| sys.poll([deadline.remaining(clock.now()), grace].into_iter().flatten().min())) {
                Ok(ready) => {
                    empty += u32::from(ready.readable);
                    after_error = ready.error && !ready.readable;
                }
                Err(errno) => {
                    let failure = Failure { doing: "waiting for a frame", errno };
                    if errno.is_gone() {
                        return Err(self.failed(failure));
                    }
                    self.broken = Some(failure);
                }
            }
        }
    }

    fn deliver(&mut self, buffer: Buffer) -> Event {
        self.current = Some(buffer);
        self.stats.delivered += 1;
        let number = self.base + self.numbers.unwrap(buffer.sequence.into()).0;
        // A driver that does not count gives every frame the same number.
        let number = self.last_number.map_or(number, |last| number.max(last + 1));
        self.last_number = Some(number);
        Event::Frame(Frame { buffer, stamp: stamp(&buffer), number })
    }

    /// Counts a buffer.
    fn judge(&mut self, buffer: &Buffer) -> Worth {
        let (plane, flagged) = (buffer.planes[0], buffer.flags & FLAG_ERROR != 0);
        let used = plane.used.saturating_sub(plane.data_offset) as usize;
        // What uvcvideo gives back after a failed transfer: flagged, empty, without time and number.
        if flagged && used == 0 && (buffer.seconds, buffer.micros) == (0, 0) {
            self.stats.cancelled += 1;
            return Worth::Cancelled;
        }
        let lost = match self.gaps.next(buffer.sequence) {
            Step::On { lost } => lost,
            Step::Back if flagged => {
                self.stats.cancelled += 1;
                return Worth::Cancelled;
            }
            Step::Back => {
                self.gaps = SequenceGaps::after(buffer.sequence);
                self.numbers.reset();
                self.base = self.last_number.map_or(0, |n| n + 1);
                0
            }
        };
        self.stats.dropped_by_system += lost;
        if flagged {
            self.stats.corrupt += 1;
            Worth::Nothing
        } else if used < self.need {
            self.stats.short += 1;
            Worth::Nothing
        } else {
            Worth::Whole { lost }
        }
    }

    /// Restarts a failed link, after a pause if it did not help the last time.
    fn recover(&mut self, failure: Failure, clock: &dyn Clock, deadline: Deadline) -> Result<Event, Failure> {
        if failure.errno.is_gone() {
            return Err(self.failed(failure));
        }
        self.failures = self.failures.saturating_add(1);
        if self.failures > 1 {
            self.rest(clock, deadline);
        }
        let Some(queue) = &mut self.queue else { return Err(failure) };
        match queue.restart(&mut self.sys) {
            Ok(()) => {
                self.stats.recoveries += 1;
                self.begin_numbers();
                Ok(Event::Recovered(Gap { cause: GapCause::Link, lost: None }))
            }
            Err(next) if next.errno.is_gone() => Err(self.failed(next)),
            Err(next) => {
                if self.failures >= RESTARTS {
                    // The next call asks for everything anew.
                    let _ = self.stop();
                } else {
                    self.broken = Some(next);
                }
                Err(next)
            }
        }
    }
}
