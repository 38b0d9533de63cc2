//! The host's clock, and how long a caller is willing to wait.
//!
//! A frame's [`Timestamp`] counts from an epoch that its source chose: a camera's power-on, a
//! recording's first frame. The host's time is another clock, so it is another type, and nothing converts one into the
//! other silently: [`ClockMap`](crate::ClockMap) does, and says how well. [`Clock`] is a trait so that a test can drive a live
//! source's timeouts without waiting.
//!
//! On Linux the host's clock is `CLOCK_MONOTONIC`, which is what the kernel stamps video buffers, input events and (when told so) inertial
//! readings with: all of them are [`HostNanos`] that can be compared. It stands still while the machine sleeps.

use std::time::Duration;

use isobath::ground::units::Timestamp;

/// Nanoseconds of the host's monotonic clock: on Unix of `CLOCK_MONOTONIC` (since boot, on Linux), elsewhere since the process's first
/// reading of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct HostNanos(pub u64);

impl HostNanos {
    /// This time moved later, saturating at the end of the clock (584 years).
    #[must_use]
    pub fn saturating_add(self, wait: Duration) -> Self {
        Self(self.0.saturating_add(u64::try_from(wait.as_nanos()).unwrap_or(u64::MAX)))
    }

    /// From seconds and the rest, as the kernel stamps; `None` for times before the clock's beginning, and beyond its end.
    #[must_use]
    pub fn from_parts(seconds: i64, nanos: i64) -> Option<Self> {
        let seconds = u64::try_from(seconds).ok()?.checked_mul(1_000_000_000)?;
        seconds.checked_add(u64::try_from(nanos).ok()?).map(Self)
    }

    /// How much later than `earlier`; nothing when it is not.
    #[must_use]
    pub const fn saturating_since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// As a frame's time stamp whose epoch is this clock's; what all live sources of one machine share.
    #[must_use]
    pub fn timestamp(self) -> Timestamp {
        Timestamp::from_nanos(i64::try_from(self.0).unwrap_or(i64::MAX))
    }
}

/// A monotonic clock.
pub trait Clock {
    /// The time now; never earlier than the last answer.
    fn now(&self) -> HostNanos;
}

/// The operating system's monotonic clock.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

#[cfg(unix)]
impl Clock for SystemClock {
    fn now(&self) -> HostNanos {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        HostNanos::from_parts(now.tv_sec, now.tv_nsec).unwrap_or_default()
    }
}

#[cfg(not(unix))]
impl Clock for SystemClock {
    fn now(&self) -> HostNanos {
        static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
        HostNanos::default().saturating_add(START.get_or_init(std::time::Instant::now).elapsed())
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

    /// How long there is left: nothing when it has passed, `None` when it never does.
    #[must_use]
    pub fn remaining(self, now: HostNanos) -> Option<Duration> {
        self.0.map(|at| at.saturating_since(now))
    }

    /// The time it passes at.
    #[must_use]
    pub const fn time(self) -> Option<HostNanos> {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn the_clock_is_the_kernels() {
        // /proc/uptime counts sleep, the monotonic clock does not: the clock can't be ahead of it (read after, 10 ms steps).
        let now = SystemClock.now();
        let uptime = std::fs::read_to_string("/proc/uptime").unwrap();
        let seconds: f64 = uptime.split(' ').next().unwrap().parse().unwrap();
        assert!(now.0 as f64 * 1e-9 <= seconds + 0.02, "{now:?} against {seconds} s of uptime");
        assert!(SystemClock.now() >= now && now.0 > 0);
    }

    #[test]
    fn stamps_of_the_kernel_are_host_times() {
        assert_eq!(HostNanos::from_parts(3, 5_000), Some(HostNanos(3_000_005_000)));
        for (s, n) in [(-1, 0), (0, -1), (i64::MAX, 0), (18_446_744_073, 999_999_999)] {
            assert_eq!(HostNanos::from_parts(s, n), None, "{s} s {n} ns");
        }
        assert_eq!(HostNanos(7).timestamp().as_nanos(), 7);
        assert_eq!(HostNanos(u64::MAX).timestamp().as_nanos(), i64::MAX);
        assert_eq!(Deadline::at(HostNanos(9)).remaining(HostNanos(4)), Some(Duration::from_nanos(5)));
        assert_eq!(Deadline::at(HostNanos(9)).remaining(HostNanos(14)), Some(Duration::ZERO));
        assert_eq!(Deadline::NEVER.remaining(HostNanos(14)), None);
    }
}
