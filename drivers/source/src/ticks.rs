//! What a device's counter says, once it no longer wraps.
//!
//! A camera stamps its frames with a counter of 2^n steps: 32 bits of microseconds start again every 71.6 minutes, and drivers that forget it send
//! time backwards (librealsense issue 11320). [`TickCounter`] undoes the wrap: of all values that the counter may stand for, it takes the one
//! nearest to what is expected. Without an expectation that is the nearest to the last value, so readings may come out of order by up to half
//! the counter's range; with one (from the host's clock) any silence may lie between two readings.
//!
//! Memory: 24 bytes. Cost: a subtraction and a mask. Error: none, as long as the expectation is right to half the counter's range.

/// Steps of a device's own clock or frame counter, unwrapped. What a step lasts is the device's affair: [`ClockMap`](crate::ClockMap) makes time of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct DeviceTicks(pub u64);

/// Unwraps a counter of 2^n steps.
///
/// ```
/// use isobath_source::{DeviceTicks, TickCounter};
/// let mut pts = TickCounter::new(32);
/// assert_eq!(pts.unwrap(4_294_967_290), DeviceTicks(4_294_967_290));
/// assert_eq!(pts.unwrap(4), DeviceTicks(4_294_967_300)); // 2^32 + 4
/// assert_eq!(pts.unwrap(4_294_967_295), DeviceTicks(4_294_967_295)); // late, and earlier
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TickCounter {
    mask: u64,
    last: Option<u64>,
}

impl TickCounter {
    /// For a counter of this many bits, 1 to 64 (brought within).
    #[must_use]
    pub const fn new(bits: u32) -> Self {
        let bits = if bits < 1 {
            1
        } else if bits > 64 {
            64
        } else {
            bits
        };
        Self { mask: u64::MAX >> (64 - bits), last: None }
    }

    /// The unwrapped value of a reading: the one nearest to the last reading's. The first is taken as it is.
    pub fn unwrap(&mut self, raw: u64) -> DeviceTicks {
        match self.last {
            Some(last) => self.unwrap_near(raw, DeviceTicks(last)),
            None => self.unwrap_near(raw, DeviceTicks(raw & self.mask)),
        }
    }

    /// The unwrapped value of a reading: the one nearest to `expected`, never below zero and never above 2^64.
    pub fn unwrap_near(&mut self, raw: u64, expected: DeviceTicks) -> DeviceTicks {
        let ahead = raw.wrapping_sub(expected.0) & self.mask;
        let behind = self.mask.wrapping_sub(ahead).wrapping_add(1); // 2^n - ahead; 0 stands for 2^64
        let forward = expected.0.checked_add(ahead);
        let backward = if behind == 0 { None } else { expected.0.checked_sub(behind) };
        let value = match (forward, backward) {
            (Some(f), Some(b)) => {
                if ahead <= behind {
                    f
                } else {
                    b
                }
            }
            (Some(f), None) => f,
            (None, Some(b)) => b,
            (None, None) => expected.0,
        };
        self.last = Some(value);
        DeviceTicks(value)
    }

    /// The last value given.
    #[must_use]
    pub fn last(&self) -> Option<DeviceTicks> {
        self.last.map(DeviceTicks)
    }

    /// Forgets the past: the next reading is the first.
    pub const fn reset(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// True times that never jump by half the range come back from their low bits.
        #[test]
        fn unwraps_what_was_wrapped(bits in 2_u32..=64, start: u32, steps in prop::collection::vec(any::<i64>(), 1..60)) {
            let mask = u64::MAX >> (64 - bits);
            let mut counter = TickCounter::new(bits);
            let mut truth = u64::from(start) & mask;
            prop_assert_eq!(counter.unwrap(truth), DeviceTicks(truth));
            for step in steps {
                let reach = i64::try_from(mask / 2).unwrap().max(1);
                let step = step % reach;
                let Some(next) = truth.checked_add_signed(step) else { continue };
                truth = next;
                prop_assert_eq!(counter.unwrap(truth & mask).0, truth);
            }
        }

        /// With an expectation, any silence may lie between, and the answer has the reading's low bits.
        #[test]
        fn lands_near_what_is_expected(bits in 1_u32..=64, raw: u64, expected: u64) {
            let mask = u64::MAX >> (64 - bits);
            let mut counter = TickCounter::new(bits);
            let got = counter.unwrap_near(raw, DeviceTicks(expected));
            prop_assert_eq!(got.0 & mask, raw & mask);
            let best = got.0.abs_diff(expected);
            // Neighbours a whole range away are no nearer.
            if let Some(range) = mask.checked_add(1) {
                for other in [got.0.checked_add(range), got.0.checked_sub(range)].into_iter().flatten() {
                    prop_assert!(other.abs_diff(expected) >= best);
                }
            }
        }
    }

    #[test]
    fn widths_out_of_range_are_brought_within() {
        assert_eq!(TickCounter::new(0), TickCounter::new(1));
        assert_eq!(TickCounter::new(99), TickCounter::new(64));
        let mut all = TickCounter::new(64);
        assert_eq!((all.unwrap(u64::MAX), all.unwrap(0)), (DeviceTicks(u64::MAX), DeviceTicks(0)));
        all.reset();
        assert_eq!(all.last(), None);
    }
}
