//! The host's clock, and how long a caller is willing to wait.
//!
//! A frame's [`Timestamp`](isobath::ground::units::Timestamp) counts from an epoch that its source chose: a camera's power-on, a
//! recording's first frame. The host's time is another clock, so it is another type, and nothing converts one into the
//! other silently. [`Clock`] is a trait so that a test can drive a live source's timeouts without waiting.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Nanoseconds of the host's monotonic clock, since the first reading of that clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct HostNanos(pub u64);

impl HostNanos {
    /// This time moved later, saturating at the end of the clock (584 years).
    #[must_use]
    pub fn saturating_add(self, wait: Duration) -> Self {
        Self(self.0.saturating_add(u64::try_from(wait.as_nanos()).unwrap_or(u64::MAX)))
    }
}

/// A monotonic clock.
pub trait Clock {
    /// The time now; never earlier than the last answer.
    fn now(&self) -> HostNanos;
}

/// The operating system's monotonic clock, counted from the process's first use of it.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now(&self) -> HostNanos {
        static START: OnceLock<Instant> = OnceLock::new();
        HostNanos::default().saturating_add(START.get_or_init(Instant::now).elapsed())
    }
}

/// Until when a call may wait. Recordings never wait.
///
/// ```
/// use std::time::Duration;
/// use isobath_source::{Clock, Deadline, HostNanos, SystemClock};
/// let soon = Deadline::after(&SystemClock, Duration::from_millis(100));
/// assert!(!soon.has_passed(SystemClock.now()));
/// assert!(Deadline::at(HostNanos(5)).has_passed(HostNanos(5)));
/// assert!(!Deadline::NEVER.has_passed(HostNanos(u64::MAX)));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Deadline(Option<HostNanos>);

impl Deadline {
    /// Wait for as long as it takes.
    pub const NEVER: Self = Self(None);

    /// Wait until this time.
    #[must_use]
    pub const fn at(time: HostNanos) -> Self {
        Self(Some(time))
    }

    /// Wait this long from now.
    #[must_use]
    pub fn after(clock: &dyn Clock, wait: Duration) -> Self {
        Self(Some(clock.now().saturating_add(wait)))
    }

    /// Whether the time is up.
    #[must_use]
    pub fn has_passed(self, now: HostNanos) -> bool {
        self.0.is_some_and(|at| now >= at)
    }
}
