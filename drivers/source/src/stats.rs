//! What became of a stream's frames, in numbers that add up.

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
}
