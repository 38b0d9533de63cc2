//! What comes with each frame of a RealSense D400: the blocks behind its UVC header (kernel format `D4XX`; on newer kernels `UVCM`).
//!
//! Each block says in flags which of its fields hold; what it does not say is `None` here. Two clocks matter: the header's PTS, microseconds of the
//! device's clock, wrapping; and, relative to it, the middle of the exposure.

use crate::wire::device::uvc::{self, Block};
use crate::wire::malformed::{Bytes, Malformed};

/// Id of the block of depth controls.
const DEPTH_CONTROL: u32 = 0x8000_0000;
/// Id of the block of times.
const CAPTURE_TIMING: u32 = 0x8000_0001;
/// Id of the block of settings.
const CONFIGURATION: u32 = 0x8000_0002;

/// What the blocks of one frame say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameInfo {
    /// The device's own count of frames.
    pub frame_counter: Option<u32>,
    /// From the start of the frame to its middle, microseconds.
    pub optical_time: Option<u32>,
    /// Read-out time, microseconds.
    pub readout: Option<u32>,
    /// Exposure, microseconds.
    pub exposure: Option<u32>,
    /// From frame to frame, microseconds.
    pub interval: Option<u32>,
    /// From the frame's start until it was ready to be sent, microseconds.
    pub latency: Option<u32>,
    /// Gain, in the camera's steps.
    pub gain: Option<u32>,
    /// Power of the laser, milliwatts as the maker counts them (0 to 360).
    pub laser_power: Option<u32>,
    /// Whether the emitter was on.
    pub emitter: Option<bool>,
    /// Width and height that the camera believes to send.
    pub size: Option<(u16, u16)>,
    /// Frames a second asked for.
    pub rate: Option<u16>,
    /// Whether depth and colour are exposed together.
    pub synchronised: Option<bool>,
}

impl FrameInfo {
    /// Reads the blocks behind a payload header ([`uvc::Meta::blocks`]); blocks of others are passed over.
    ///
    /// # Errors
    /// [`Malformed`]: a block of impossible size, or shorter than its layout.
    ///
    /// ```
    /// use isobath::wire::device::d4xx::metadata::FrameInfo;
    /// let mut timing = [0_u8; 40];
    /// timing[..8].copy_from_slice(&[1, 0, 0, 0x80, 40, 0, 0, 0]);
    /// timing[12] = 0b1001; // frame counter and exposure hold
    /// timing[16] = 77;
    /// timing[28] = 250;
    /// let info = FrameInfo::parse(&timing)?;
    /// assert_eq!((info.frame_counter, info.exposure, info.readout), (Some(77), Some(250), None));
    /// # Ok::<(), isobath::wire::malformed::Malformed>(())
    /// ```
    pub fn parse(blocks: &[u8]) -> Result<Self, Malformed> {
        let mut info = Self::default();
        for block in uvc::blocks(blocks) {
            info.add(&block?)?;
        }
        Ok(info)
    }

    fn add(&mut self, block: &Block<'_>) -> Result<(), Malformed> {
        let read = Bytes::new("RealSense frame metadata", block.body);
        // Version and flags lead each of them; a value is there when its flag is set.
        let word = |flag: u32, at: usize| match read.u32(4)? & flag {
            0 => Ok(None),
            _ => read.u32(at).map(Some),
        };
        let half = |flag: u32, at: usize| match read.u32(4)? & flag {
            0 => Ok(None),
            _ => read.u16(at).map(Some),
        };
        match block.id {
            CAPTURE_TIMING => {
                self.frame_counter = word(1, 8)?;
                self.optical_time = word(2, 12)?;
                self.readout = word(4, 16)?;
                self.exposure = word(8, 20)?.or(self.exposure);
                self.interval = word(16, 24)?;
                self.latency = word(32, 28)?;
            }
            DEPTH_CONTROL => {
                self.gain = word(1, 8)?;
                // Its exposure is the one asked for; the times' block has the one it was, and wins.
                self.exposure = self.exposure.or(word(2, 12)?);
                self.laser_power = word(4, 16)?;
                self.emitter = word(0x80, 48)?.map(|mode| mode & 0xff != 0);
            }
            CONFIGURATION => {
                self.size = half(0x10, 16)?.zip(half(0x20, 18)?);
                self.rate = half(0x40, 20)?;
                self.synchronised = half(0x80, 22)?.map(|trigger| trigger & 1 != 0);
            }
            uvc::CAPTURE_STATS => {
                let micros = uvc::exposure_nanos(block).and_then(|nanos| u32::try_from(nanos / 1000).ok());
                self.exposure = self.exposure.or(micros);
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn block(id: u32, size: u32, flags: u32, fields: &[(usize, u32)]) -> Vec<u8> {
        let mut bytes = std::vec![0; size as usize];
        bytes[..4].copy_from_slice(&id.to_le_bytes());
        bytes[4..8].copy_from_slice(&size.to_le_bytes());
        bytes[12..16].copy_from_slice(&flags.to_le_bytes());
        for (at, value) in fields {
            bytes[*at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
        bytes
    }

    fn frame() -> Vec<u8> {
        let timing = [(16, 1234), (20, 5000), (24, 7000), (28, 8500), (32, 33_333), (36, 900)];
        [
            block(CAPTURE_TIMING, 40, 0x3f, &timing),
            block(uvc::CAPTURE_STATS, 72, 0, &[]),
            block(DEPTH_CONTROL, 60, 0x1ff, &[(16, 16), (20, 9000), (24, 150), (56, 1)]),
            block(CONFIGURATION, 40, 0x7ff, &[(24, 848 | 480 << 16), (28, 30 | 1 << 16)]),
        ]
        .concat()
    }

    #[test]
    fn a_frame_is_read() {
        let info = FrameInfo::parse(&frame()).unwrap();
        let want = FrameInfo {
            frame_counter: Some(1234),
            optical_time: Some(5000),
            readout: Some(7000),
            exposure: Some(8500),
            interval: Some(33_333),
            latency: Some(900),
            gain: Some(16),
            laser_power: Some(150),
            emitter: Some(true),
            size: Some((848, 480)),
            rate: Some(30),
            synchronised: Some(true),
        };
        assert_eq!(info, want);
    }

    #[test]
    fn what_no_flag_vouches_for_is_not_said() {
        for (id, size) in [(CAPTURE_TIMING, 40), (DEPTH_CONTROL, 60), (CONFIGURATION, 40), (0x1234, 20)] {
            let bytes = block(id, size, 0, &[(16, u32::MAX)]);
            assert_eq!(FrameInfo::parse(&bytes), Ok(FrameInfo::default()));
        }
    }

    #[test]
    fn blocks_shorter_than_their_layout_are_refused() {
        let (timing, depth) = (block(CAPTURE_TIMING, 39, 0x3f, &[]), block(DEPTH_CONTROL, 58, 0x1ff, &[]));
        assert!(FrameInfo::parse(&timing).is_err() && FrameInfo::parse(&depth).is_err());
        let whole = frame();
        // Cut off within a block the rest is padding, or its size is impossible.
        for length in 0..whole.len() {
            let _ = FrameInfo::parse(&whole[..length]);
        }
    }
}
