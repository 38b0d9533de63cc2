//! A source that fails on purpose: what happens to cameras in the field, at chosen rates, the same for the same seed.
//!
//! The fault of each call is drawn by a 64-bit generator (`SplitMix64`; Steele, Lea, Flood 2014), so a test that fails can be repeated. Frames
//! that a fault takes away are counted as what they are: the statistics still add up.

use crate::clock::Deadline;
use crate::error::{LinkKind, SourceError};
use crate::frame::OwnedFrame;
use crate::source::{DepthSource, Gap, GapCause, Outcome, SourceInfo};
use crate::stats::StreamStats;

/// How often what fails; chances are of one call, 0 to 1, drawn in this order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faults {
    /// The same seed fails the same way. Default 1.
    pub seed: u64,
    /// Chance that nothing comes within the deadline.
    pub timeout: f32,
    /// Chance that the device loses a frame: the next one comes, its number tells.
    pub lost: f32,
    /// Chance that a frame comes broken: [`SourceError::Corrupt`].
    pub corrupt: f32,
    /// Chance that the link fails: [`SourceError::Link`].
    pub link: f32,
    /// Chance that the stream breaks, loses a frame, and goes on: [`Outcome::Recovered`].
    pub gap: f32,
    /// Frames until the device is unplugged, for good.
    pub unplug_after: Option<u64>,
}

impl Default for Faults {
    fn default() -> Self {
        Self { seed: 1, timeout: 0.0, lost: 0.0, corrupt: 0.0, link: 0.0, gap: 0.0, unplug_after: None }
    }
}

impl Faults {
    /// A bad day: one call in five fails somehow.
    #[must_use]
    pub fn rough(seed: u64) -> Self {
        Self { seed, timeout: 0.05, lost: 0.05, corrupt: 0.04, link: 0.03, gap: 0.03, unplug_after: None }
    }
}

/// A source that fails on purpose.
#[derive(Debug)]
pub struct FaultInjector<S> {
    inner: S,
    faults: Faults,
    random: u64,
    own: StreamStats,
}

impl<S: DepthSource> FaultInjector<S> {
    /// Around a source.
    #[must_use]
    pub fn new(inner: S, faults: Faults) -> Self {
        Self { inner, faults, random: faults.seed, own: StreamStats::default() }
    }

    /// The source inside.
    pub fn into_inner(self) -> S {
        self.inner
    }

    /// The next number, evenly from 0 to 1.
    fn draw(&mut self) -> f32 {
        self.random = self.random.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.random;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1_u64 << 24) as f32
    }

    fn gone(&self) -> SourceError {
        SourceError::Disconnected { device: self.inner.info().path.display().to_string() }
    }
}

impl<S: DepthSource> DepthSource for FaultInjector<S> {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn start(&mut self) -> Result<(), SourceError> {
        self.inner.start()
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.inner.stop()
    }

    fn stats(&self) -> StreamStats {
        let (own, mut all) = (&self.own, self.inner.stats());
        all.delivered = own.delivered;
        all.dropped_by_device += own.dropped_by_device;
        all.dropped_by_system += own.dropped_by_system;
        all.corrupt += own.corrupt;
        all.recoveries += own.recoveries;
        all
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
        let taken = self.own.delivered + self.own.lost();
        if self.faults.unplug_after.is_some_and(|n| taken >= n) {
            return Err(self.gone());
        }
        if self.draw() < self.faults.timeout {
            return Ok(Outcome::TimedOut);
        }
        if self.draw() < self.faults.link {
            let path = self.inner.info().path.clone();
            return Err(SourceError::Link { path, kind: LinkKind::Io, doing: "injecting a fault", error: None });
        }
        let lost = self.draw() < self.faults.lost;
        let corrupt = self.draw() < self.faults.corrupt;
        let gap = self.draw() < self.faults.gap;
        let outcome = self.inner.next_into(frame, deadline)?;
        if outcome != Outcome::Frame {
            return Ok(outcome);
        }
        if corrupt {
            self.own.corrupt += 1;
            return Err(SourceError::Corrupt { what: "a depth frame (injected fault)", got: 0, want: 1 });
        }
        if gap {
            self.own.dropped_by_system += 1;
            self.own.recoveries += 1;
            return Ok(Outcome::Recovered(Gap { cause: GapCause::Link, lost: Some(1) }));
        }
        if lost {
            self.own.dropped_by_device += 1;
            let outcome = self.inner.next_into(frame, deadline)?;
            if outcome != Outcome::Frame {
                return Ok(outcome);
            }
        }
        self.own.delivered += 1;
        Ok(Outcome::Frame)
    }
}
