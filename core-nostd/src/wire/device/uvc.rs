//! USB video: the header before each payload, and how Linux hands headers to programs.
//!
//! A payload header (UVC 1.5, section 2.4.3.3) is its length, its flags, and, as the flags say, the time stamp of the frame (PTS) and a pair of
//! device and bus time (SCR); makers put their own blocks behind. On a metadata node Linux gives, a payload, `u64` host nanoseconds, `u16` bus
//! frame number, and the header (`struct uvc_meta_buf`, formats `UVCH`, `D4XX` and, with the blocks of Microsoft's extension, `UVCM`). Those
//! blocks are `u32` id, `u32` size with these eight bytes, and the rest.
//!
//! Times are 32 bits of a clock of the device's and wrap (a microsecond's in 71.6 minutes): who maps clocks unwraps.
//!
//! Memory: none. Cost: nothing.

use crate::wire::malformed::{Bytes, Malformed};

/// Bytes before the header in a metadata buffer.
const META_PREFIX: usize = 10;

/// A payload's header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PayloadHeader {
    /// The flags as they came.
    pub flags: u8,
    /// When the frame was begun, in ticks of the device's clock.
    pub pts: Option<u32>,
    /// When this payload was sent: the device's clock, and the bus's frame number (11 bits) at that time.
    pub scr: Option<(u32, u16)>,
}

impl PayloadHeader {
    /// Alternates from frame to frame.
    pub const FRAME_ID: u8 = 1;
    /// The last payload of its frame.
    pub const END_OF_FRAME: u8 = 1 << 1;
    /// There is a PTS.
    const PTS: u8 = 1 << 2;
    /// There is an SCR.
    const SCR: u8 = 1 << 3;
    /// A still image.
    pub const STILL: u8 = 1 << 5;
    /// The device had an error with this frame.
    pub const ERROR: u8 = 1 << 6;

    /// Reads the header at the start of a payload; the makers' blocks behind it; the header's length, where the pixels begin.
    ///
    /// # Errors
    /// [`Malformed`]: cut off, or shorter than its flags say.
    ///
    /// ```
    /// use isobath::wire::device::uvc::PayloadHeader;
    /// let (header, blocks, length) = PayloadHeader::parse(&[6, 0x86, 0x40, 0x42, 0x0f, 0x00, 0xaa])?;
    /// assert_eq!((header.pts, blocks, length), (Some(1_000_000), &[][..], 6));
    /// # Ok::<(), isobath::wire::malformed::Malformed>(())
    /// ```
    pub fn parse(payload: &[u8]) -> Result<(Self, &[u8], usize), Malformed> {
        let length = usize::from(Bytes::new("UVC payload header", payload).u8(0)?);
        let header = Bytes::new("UVC payload header", payload).slice(0, length)?;
        let read = Bytes::new("UVC payload header", header);
        let flags = read.u8(1)?;
        let mut at = 2;
        let mut pts = None;
        if flags & Self::PTS != 0 {
            pts = Some(read.u32(at)?);
            at += 4;
        }
        let mut scr = None;
        if flags & Self::SCR != 0 {
            // The upper five bits are reserved.
            scr = Some((read.u32(at)?, read.u16(at + 4)? & 0x7ff));
            at += 6;
        }
        Ok((Self { flags, pts, scr }, header.get(at..).unwrap_or_default(), length))
    }

    /// Whether the device had an error with this frame.
    #[must_use]
    pub const fn is_error(&self) -> bool {
        self.flags & Self::ERROR != 0
    }
}

/// One payload's entry of a metadata buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Meta<'a> {
    /// The host's monotonic clock when the payload came, nanoseconds (the kernel's, unless it was told to use another).
    pub host_nanos: u64,
    /// The bus's frame number then.
    pub sof: u16,
    /// The payload's header.
    pub header: PayloadHeader,
    /// The makers' blocks.
    pub blocks: &'a [u8],
}

/// The entries of a metadata buffer (`UVCH`, `D4XX`, `UVCM`), as far as it was used. An entry that is cut off or contradicts itself is an error, and
/// the last.
pub fn metadata(buffer: &[u8]) -> impl Iterator<Item = Result<Meta<'_>, Malformed>> {
    let mut rest = buffer;
    core::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let read = Bytes::new("UVC metadata", rest);
        let entry = (|| {
            let (header, blocks, length) = PayloadHeader::parse(rest.get(META_PREFIX..).unwrap_or_default())?;
            let meta = Meta { host_nanos: read.u64(0)?, sof: read.u16(8)?, header, blocks };
            Ok((meta, rest.get(META_PREFIX + length..).unwrap_or_default()))
        })();
        match entry {
            Ok((meta, behind)) => {
                rest = behind;
                Some(Ok(meta))
            }
            Err(error) => {
                rest = &[];
                Some(Err(error))
            }
        }
    })
}

/// A maker's block: `body` is what follows id and size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block<'a> {
    /// Whose and which: below 0x80000000 Microsoft's, from there the maker's.
    pub id: u32,
    /// What it says.
    pub body: &'a [u8],
}

/// The blocks behind a header. One whose size is impossible is an error, and the last; fewer than eight bytes at the end are padding.
pub fn blocks(bytes: &[u8]) -> impl Iterator<Item = Result<Block<'_>, Malformed>> {
    let mut rest = bytes;
    let mut at = 0;
    core::iter::from_fn(move || {
        let read = Bytes::new("UVC metadata block", rest);
        let (Ok(id), Ok(size)) = (read.u32(0), read.u32(4)) else { return None };
        let length = usize::try_from(size).unwrap_or(usize::MAX);
        let body = rest.get(8..length);
        if let Some(body) = body {
            at += length;
            rest = rest.get(length..).unwrap_or_default();
            return Some(Ok(Block { id, body }));
        }
        rest = &[];
        Some(Err(Malformed::Field { what: "the size of a UVC metadata block", at: at + 4, got: size }))
    })
}

/// Id of Microsoft's block of capture statistics.
pub const CAPTURE_STATS: u32 = 3;

/// Exposure time in nanoseconds, if a block of capture statistics says it (`KSCAMERA_METADATA_CAPTURESTATS`, steps of 100 ns).
#[must_use]
pub fn exposure_nanos(block: &Block<'_>) -> Option<u64> {
    let read = Bytes::new("capture statistics", block.body);
    let known = block.id == CAPTURE_STATS && read.u32(0).ok()? & 1 != 0;
    known.then(|| read.u64(8).ok()?.checked_mul(100)).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn header(flags: u8, pts: u32, scr: (u32, u16), blocks: &[u8]) -> Vec<u8> {
        let mut bytes = std::vec![0, flags];
        if flags & 4 != 0 {
            bytes.extend(pts.to_le_bytes());
        }
        if flags & 8 != 0 {
            bytes.extend(scr.0.to_le_bytes());
            bytes.extend(scr.1.to_le_bytes());
        }
        bytes.extend(blocks);
        bytes[0] = bytes.len() as u8;
        bytes
    }

    proptest! {
        #[test]
        fn headers_come_back(
            flags in any::<u8>(), pts in any::<u32>(), stc in any::<u32>(), sof in 0_u16..2048,
            own in prop::collection::vec(any::<u8>(), 0..40), pixels in prop::collection::vec(any::<u8>(), 0..9),
            host in any::<u64>(),
        ) {
            let bytes = header(flags, pts, (stc, sof), &own);
            let payload = [&bytes[..], &pixels].concat();
            let (got, blocks, length) = PayloadHeader::parse(&payload).unwrap();
            prop_assert_eq!((got.flags, blocks, length), (flags, &own[..], bytes.len()));
            prop_assert_eq!(got.pts, (flags & 4 != 0).then_some(pts));
            prop_assert_eq!(got.scr, (flags & 8 != 0).then_some((stc, sof)));
            prop_assert_eq!(got.is_error(), flags & 64 != 0);
            // Cut off anywhere, it is refused.
            for cut in 0..bytes.len() {
                prop_assert!(PayloadHeader::parse(&bytes[..cut]).is_err());
            }
            // Two payloads in a metadata buffer.
            let entry = [&host.to_le_bytes()[..], &7_u16.to_le_bytes(), &bytes].concat();
            let buffer = [&entry[..], &entry].concat();
            let got: Vec<_> = metadata(&buffer).collect();
            prop_assert_eq!(got.len(), 2);
            for meta in got {
                let meta = meta.unwrap();
                prop_assert_eq!((meta.host_nanos, meta.sof, meta.blocks), (host, 7, &own[..]));
            }
            let cut: Vec<_> = metadata(&buffer[..buffer.len() - 1]).collect();
            prop_assert!(cut.len() == 2 && cut[0].is_ok() && cut[1].is_err());
        }

        #[test]
        fn blocks_come_back(bodies in prop::collection::vec((any::<u32>(), prop::collection::vec(any::<u8>(), 0..20)), 0..6)) {
            let mut bytes = Vec::new();
            for (id, body) in &bodies {
                bytes.extend(id.to_le_bytes());
                bytes.extend((body.len() as u32 + 8).to_le_bytes());
                bytes.extend(body);
            }
            bytes.extend([0; 7]);
            let got: Vec<_> = blocks(&bytes).map(|b| b.map(|b| (b.id, b.body.to_vec())).unwrap()).collect();
            prop_assert_eq!(got, bodies);
        }
    }

    #[test]
    fn impossible_sizes_end_the_blocks() {
        for size in [0_u32, 7, 17, u32::MAX] {
            let bytes = [&3_u32.to_le_bytes()[..], &size.to_le_bytes(), &[0; 8]].concat();
            let got: Vec<_> = blocks(&bytes).collect();
            assert_eq!(got, [Err(Malformed::Field { what: "the size of a UVC metadata block", at: 4, got: size })]);
        }
        // A header shorter than its flags say: no PTS fits in two bytes.
        assert!(PayloadHeader::parse(&[2, 4, 0, 0, 0, 0]).is_err());
        assert!(PayloadHeader::parse(&[0, 0]).is_err());
        assert!(PayloadHeader::parse(&[1, 0]).is_err());
    }

    #[test]
    fn capture_statistics_tell_the_exposure() {
        let mut body = [0_u8; 64];
        body[8..16].copy_from_slice(&333_330_u64.to_le_bytes());
        let id = CAPTURE_STATS;
        assert_eq!(exposure_nanos(&Block { id, body: &body }), None);
        body[0] = 1;
        assert_eq!(exposure_nanos(&Block { id, body: &body }), Some(33_333_000));
        assert_eq!(exposure_nanos(&Block { id: 4, body: &body }), None);
        assert_eq!(exposure_nanos(&Block { id, body: &body[..12] }), None);
    }
}
