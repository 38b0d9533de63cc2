//! A source that writes down what happens: a line of text for each call, for a report of a fault that comes once a week.
//!
//! ```text
//! 81723.104311 start ok
//! 81723.171022 frame 0 time 81723.140711 640x480 digest 5f3a9c0112d4e7b8
//! 81723.204391 timeout
//! 81723.271004 recovered Link lost 2
//! 81723.304377 error /dev/video2: a transfer stalled (taking a buffer); ...
//! ```
//!
//! The first column is the host's clock in seconds. A digest tells whether two runs gave the same pixels without storing them.

use std::io::Write;

use crate::clock::{Clock, Deadline, HostNanos};
use crate::error::SourceError;
use crate::frame::{DepthPixels, OwnedFrame};
use crate::source::{DepthSource, Outcome, SourceInfo};
use crate::stats::StreamStats;

/// A 64-bit digest of a frame's depth, confidence and colour, with their sizes: the same on every machine, and different for
/// frames that differ, but for one chance in 2^64. Not for secrets. About 0.3 ns a byte.
#[must_use]
pub fn digest(frame: &OwnedFrame) -> u64 {
    let (width, height) = frame.size();
    let mut state = mix(mix(0x243f_6a88_85a3_08d3, width as u64), height as u64);
    match frame.depth() {
        DepthPixels::U16(values) => {
            let (fours, rest) = values.as_chunks::<4>();
            for &[a, b, c, d] in fours {
                state = mix(state, u64::from(a) | u64::from(b) << 16 | u64::from(c) << 32 | u64::from(d) << 48);
            }
            state = rest.iter().fold(state, |s, &v| mix(s, u64::from(v)));
        }
        DepthPixels::F32(values) => state = values.iter().fold(state, |s, v| mix(s, u64::from(v.to_bits()))),
    }
    if let Some(confidence) = frame.confidence() {
        state = mix(state, 1);
        state = confidence.rows().flatten().fold(state, |s, &v| mix(s, u64::from(v)));
    }
    if let Some(colour) = frame.colour() {
        state = mix(mix(state, 2), colour.width() as u64);
        state = colour
            .rows()
            .flatten()
            .fold(state, |s, &[r, g, b]| mix(s, u64::from(r) | u64::from(g) << 8 | u64::from(b) << 16));
    }
    state
}

fn mix(state: u64, word: u64) -> u64 {
    let product = u128::from(state ^ word ^ 0x9e37_79b9_7f4a_7c15) * 0xd6e8_feb8_6659_fd93;
    (product >> 64) as u64 ^ (product as u64).rotate_left(23)
}

/// A source that writes a line for each call.
pub struct Tracer<S, W> {
    inner: S,
    out: W,
    clock: Box<dyn Clock + Send>,
    failed: Option<std::io::Error>,
}

impl<S: std::fmt::Debug, W> std::fmt::Debug for Tracer<S, W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tracer").field("inner", &self.inner).field("failed", &self.failed).finish_non_exhaustive()
    }
}

impl<S: DepthSource, W: Write> Tracer<S, W> {
    /// Writes the calls of `inner` to `out`, which should buffer.
    pub fn new(inner: S, out: W, clock: impl Clock + Send + 'static) -> Self {
        Self { inner, out, clock: Box::new(clock), failed: None }
    }

    /// Source and writer, and the first error of writing: a trace that can't be written stops itself, never the stream.
    pub fn into_parts(self) -> (S, W, Option<std::io::Error>) {
        (self.inner, self.out, self.failed)
    }

    fn line(&mut self, what: std::fmt::Arguments<'_>) {
        if self.failed.is_none() {
            let HostNanos(now) = self.clock.now();
            let (seconds, micros) = (now / 1_000_000_000, now / 1000 % 1_000_000);
            self.failed = writeln!(self.out, "{seconds}.{micros:06} {what}").err();
        }
    }
}

impl<S: DepthSource, W: Write> DepthSource for Tracer<S, W> {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn start(&mut self) -> Result<(), SourceError> {
        let result = self.inner.start();
        match &result {
            Ok(()) => self.line(format_args!("start ok")),
            Err(e) => self.line(format_args!("start error {e}")),
        }
        result
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let result = self.inner.stop();
        match &result {
            Ok(()) => self.line(format_args!("stop ok {:?}", self.inner.stats())),
            Err(e) => self.line(format_args!("stop error {e}")),
        }
        if self.failed.is_none() {
            self.failed = self.out.flush().err();
        }
        result
    }

    fn stats(&self) -> StreamStats {
        self.inner.stats()
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
        let result = self.inner.next_into(frame, deadline);
        match &result {
            Ok(Outcome::Frame) => {
                let ((width, height), time) = (frame.size(), frame.time.as_nanos());
                let (sign, time) = (if time < 0 { "-" } else { "" }, time.unsigned_abs());
                let (seconds, micros, digest) = (time / 1_000_000_000, time / 1000 % 1_000_000, digest(frame));
                let n = frame.sequence;
                self.line(format_args!(
                    "frame {n} time {sign}{seconds}.{micros:06} {width}x{height} digest {digest:016x}"
                ));
            }
            Ok(Outcome::TimedOut) => self.line(format_args!("timeout")),
            Ok(Outcome::EndOfStream) => self.line(format_args!("end")),
            Ok(Outcome::Recovered(gap)) => match gap.lost {
                Some(lost) => self.line(format_args!("recovered {:?} lost {lost}", gap.cause)),
                None => self.line(format_args!("recovered {:?} lost unknown", gap.cause)),
            },
            Err(e) => self.line(format_args!("error {e}")),
        }
        result
    }
}
