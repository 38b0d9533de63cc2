//! Time in integer nanoseconds: the core reads no clock, time is always an argument.
//!
//! Lengths are plain `f32` metres and angles plain `f32` radians throughout the crate; names and docs say so. Time alone
//! gets a type, because `f32` seconds since boot lose the millisecond after three hours.

/// A point in time: nanoseconds since an epoch that the source chooses (often boot, or the Unix epoch).
///
/// ```
/// use isobath::ground::units::Timestamp;
/// let a = Timestamp::from_nanos(1_000_000_000);
/// let b = Timestamp::from_seconds(1.5).unwrap();
/// assert_eq!(b.seconds_since(a), 0.5);
/// assert_eq!(a.seconds_since(b), -0.5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Timestamp(i64);

impl Timestamp {
    /// The epoch itself.
    pub const ZERO: Self = Self(0);

    /// From nanoseconds since the source's epoch.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// From seconds since the epoch, as text formats give it; `None` when not finite or beyond ±292 years.
    #[must_use]
    pub fn from_seconds(seconds: f64) -> Option<Self> {
        let nanos = seconds * 1e9;
        // i64::MAX as f64 rounds up to 2^63, which is out of range: hence the strict bound.
        (nanos.abs() < 9.223_372_036_854_775e18).then(|| Self(libm::round(nanos) as i64))
    }

    /// Nanoseconds since the source's epoch.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Seconds from `earlier` to `self`, negative when `earlier` is later. The difference is taken in integers, so it is
    /// exact to `f32` rounding however far the epoch is.
    #[must_use]
    pub const fn seconds_since(self, earlier: Self) -> f32 {
        (self.0.saturating_sub(earlier.0) as f64 * 1e-9) as f32
    }

    /// `self` moved by `nanos`, saturating at the ends.
    #[must_use]
    pub const fn saturating_add_nanos(self, nanos: i64) -> Self {
        Self(self.0.saturating_add(nanos))
    }
}
