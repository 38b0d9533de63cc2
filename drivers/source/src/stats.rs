//! What became of a stream's frames, in numbers that add up.

use std::time::Duration;

/// Counts since the start of a stream. Every frame that the device numbered is in exactly one of the counts, so that
/// [`Self::span`] is the span of the sequence numbers seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StreamStats {
    /// Frames given to the caller.
    pub delivered: u64,
    /// Whole frames that the back-pressure policy dropped: newer ones were there.
    pub dropped_by_policy: u64,
    /// Frames that the operating system lost: gaps of its sequence numbers.
    pub dropped_by_system: u64,
    /// Frames that the device lost before the operating system saw them: gaps of its own counter.
    pub dropped_by_device: u64,
    /// Frames that came marked as broken, or failed a check.
    pub corrupt: u64,
    /// Frames with fewer bytes than their format needs.
    pub short: u64,
    /// Times that the stream was started again after an error of the link.
    pub recoveries: u64,
    /// Buffers that the system gave back empty after an error of the link. They carry no number, so they are in no span.
    pub cancelled: u64,
    /// The longest that a frame waited from its arrival at the host until the caller had it; zero where arrivals are not known.
    pub max_latency: Duration,
}

impl StreamStats {
    /// Frames there were: delivered, and lost for whatever reason.
    #[must_use]
    pub const fn span(&self) -> u64 {
        self.delivered + self.lost()
    }

    /// Frames that the caller did not get.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.dropped_by_policy + self.dropped_by_system + self.dropped_by_device + self.corrupt + self.short
    }

    /// Notes how long a frame waited.
    pub fn waited(&mut self, latency: Duration) {
        self.max_latency = self.max_latency.max(latency);
    }
}

/// Finds gaps in a 32-bit sequence that wraps.
///
/// ```
/// use isobath_source::stats::{SequenceGaps, Step};
/// let mut gaps = SequenceGaps::default();
/// assert_eq!(gaps.next(4_294_967_294), Step::On { lost: 0 });
/// assert_eq!(gaps.next(1), Step::On { lost: 2 }); // 4294967295 and 0 did not come
/// assert_eq!(gaps.next(1), Step::Back);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SequenceGaps {
    last: Option<u32>,
}

/// What a sequence number said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// It is later than the one before; this many are missing between them.
    On {
        /// Numbers that did not come.
        lost: u64,
    },
    /// It is no later than the one before: the counter was set back, or the number means nothing. It is not remembered.
    Back,
}

impl SequenceGaps {
    /// Takes the next number. The first one of a stream begins it: nothing is missing before it.
    pub fn next(&mut self, sequence: u32) -> Step {
        let step = match self.last {
            None => Step::On { lost: 0 },
            // Half the range ahead, or else behind.
            Some(last) => match sequence.wrapping_sub(last) {
                0 | 0x8000_0000.. => return Step::Back,
                ahead => Step::On { lost: u64::from(ahead - 1) },
            },
        };
        self.last = Some(sequence);
        step
    }

    /// Starts with this number as the last one seen: the next expected is the one after it.
    #[must_use]
    pub const fn after(last: u32) -> Self {
        Self { last: Some(last) }
    }

    /// Forgets: the next number begins anew.
    pub const fn reset(&mut self) {
        self.last = None;
    }

    /// The last number taken.
    #[must_use]
    pub const fn last(&self) -> Option<u32> {
        self.last
    }
}
