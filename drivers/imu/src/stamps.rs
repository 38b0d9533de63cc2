//! Time stamps as drivers give them: mostly in order.
//!
//! A HID sensor whose own stamp is zero gets the kernel's real time for that one reading, fifty years ahead; drivers with a FIFO may give two readings one
//! stamp. A reading whose stamp is not later than the one before, or more than [`FAR`] off, is dropped; when [`PATIENCE`] in a row are
//! off, the clock itself has changed, and they count.

/// Nanoseconds that no two readings lie apart: 10 s.
pub const FAR: i64 = 10_000_000_000;
/// Readings in a row that make a new clock believable.
pub const PATIENCE: u32 = 3;

/// Watches one sensor's stamps.
#[derive(Debug, Clone, Copy, Default)]
pub struct Stamps {
    last: Option<i64>,
    odd: u32,
    dropped: u64,
}

impl Stamps {
    /// Whether a reading with this stamp, in nanoseconds, can be used.
    ///
    /// ```
    /// use isobath_imu::stamps::Stamps;
    /// let mut stamps = Stamps::default();
    /// let real_time = 1_700_000_000_000_000_000;
    /// let used = [1_000, 2_000, real_time, 3_000, 3_000, 4_000].map(|t| stamps.usable(t));
    /// assert_eq!(used, [true, true, false, true, false, true]);
    /// ```
    pub const fn usable(&mut self, stamp: i64) -> bool {
        let good = match self.last {
            None => true,
            Some(last) => {
                let step = stamp.saturating_sub(last);
                step > 0 && step <= FAR
            }
        };
        if good || self.odd + 1 >= PATIENCE {
            self.last = Some(stamp);
            self.odd = 0;
            return true;
        }
        self.odd += 1;
        self.dropped += 1;
        false
    }

    /// Readings dropped.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }
}
