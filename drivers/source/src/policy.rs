//! What happens to frames that come faster than they are taken.
//!
//! A live view wants the newest frame and never an old one; a recorder wants every frame and would rather wait. Who decides it silently is wrong
//! half of the time, so the caller says it. Whatever is lost is counted ([`StreamStats`](crate::StreamStats)), and under which name tells why.
//!
//! A stream has a fixed pool of buffers. Whoever holds frames (a *lease*) takes them out of it; all of them held, nothing can arrive any more, and a camera
//! that waits for a free buffer looks like one that hangs (librealsense issues 9501, 2845, 802). So at most the pool less two may be held, and
//! asking for one more is [`SourceError::LeaseLimit`](crate::SourceError::LeaseLimit), at once.

/// Which frames a slow caller gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum BackPressure {
    /// The newest; older ones that wait are dropped and counted as `dropped_by_policy`.
    #[default]
    Latest,
    /// The oldest first; up to this many wait (brought within 2 to 30). When they do and more come, it is the newest that are lost, and counted as
    /// `dropped_by_system`.
    Queue(usize),
    /// As a queue of 14, and each loss is told where it happened: [`Outcome::Recovered`](crate::Outcome::Recovered) with
    /// [`GapCause::Overrun`](crate::GapCause::Overrun).
    Every,
}

impl BackPressure {
    /// Buffers a stream of this policy has: 4 to 32.
    #[must_use]
    pub const fn pool(self) -> usize {
        match self {
            Self::Latest => 4,
            Self::Queue(n) => {
                if n < 2 {
                    4
                } else if n > 30 {
                    32
                } else {
                    n + 2
                }
            }
            Self::Every => 16,
        }
    }

    /// Frames that may be held at once from a pool of this many: all but two, so that one can be filled while the next is queued.
    #[must_use]
    pub const fn lease_limit(pool: usize) -> usize {
        pool.saturating_sub(2)
    }
}
