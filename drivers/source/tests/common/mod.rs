//! A source whose frames and faults are known.

#![allow(dead_code, reason = "each test uses its part")]

use isobath::ground::units::Timestamp;
use isobath::sensing::camera::Intrinsics;
use isobath_source::{Deadline, DepthSource, Outcome, OwnedFrame, SourceError, SourceInfo, StreamStats};

/// Gives `len` frames of 8 x 6 pixels, whose every value is the frame's number, and counts them.
#[derive(Debug)]
pub(crate) struct Numbers {
    info: SourceInfo,
    pub(crate) len: u64,
    pub(crate) next: u64,
    /// The frame before which the device is unplugged.
    pub(crate) unplugged_at: Option<u64>,
    pub(crate) panics_at: Option<u64>,
    pub(crate) running: bool,
    /// How long a frame takes.
    pub(crate) pace: std::time::Duration,
}

impl Numbers {
    pub(crate) fn new(len: u64) -> Self {
        let info = SourceInfo {
            kind: "numbers".into(),
            path: "numbers".into(),
            size: Some((8, 6)),
            intrinsics: Intrinsics::new(8.0, 8.0, 4.0, 3.0).unwrap(),
            up: None,
            has_colour: false,
            has_poses: false,
            notes: Vec::new(),
        };
        Self {
            info,
            len,
            next: 0,
            unplugged_at: None,
            panics_at: None,
            running: false,
            pace: std::time::Duration::ZERO,
        }
    }
}

impl DepthSource for Numbers {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), SourceError> {
        self.running = true;
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.running = false;
        Ok(())
    }

    fn stats(&self) -> StreamStats {
        StreamStats { delivered: self.next, ..StreamStats::default() }
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, _: Deadline) -> Result<Outcome, SourceError> {
        if self.unplugged_at == Some(self.next) {
            return Err(SourceError::Disconnected { device: "numbers".into() });
        }
        assert!(self.panics_at != Some(self.next), "a source with a bug");
        if self.next == self.len {
            return Ok(Outcome::EndOfStream);
        }
        std::thread::sleep(self.pace);
        frame.clear();
        frame.depth_u16_mut(8, 6).fill((self.next as u16).wrapping_add(1));
        frame.sequence = self.next;
        frame.time = Timestamp::from_nanos(self.next as i64 * 33_000_000);
        frame.intrinsics = self.info.intrinsics;
        self.next += 1;
        Ok(Outcome::Frame)
    }
}
