//! Depth without loss in about half the bytes: RVL, runs of holes and readings, differences in nibbles.
//!
//! Andrew Wilson's codec ("Fast Lossless Depth Image Compression", ISS 2017), in his byte order, so that streams of other
//! implementations (Kinect, ROS `compressedDepth`) are read and theirs read ours. Per image: how many holes (zeros), how many
//! readings, the readings as differences from the one before, zigzagged; and so on until the pixels are used up. A number is
//! three bits a nibble, low ones first, the fourth bit says that more follow; eight nibbles make a little-endian 32-bit
//! word, first nibble on top.
//!
//! Memory: none. Cost: one pass, no arithmetic but shifts and additions; a noise-free room at 160 x 120 takes a quarter of its
//! raw bytes, a noisy one half. Exact: every `u16` comes back, 65535 included. A stream that is cut off or lies about its
//! runs is an error, never a wrong read; the pixels before the fault are decoded, those from there on are left alone.

use core::fmt;

use crate::ground::image::{ImageView, ImageViewMut};

/// Why there is no image, or no stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum RvlError {
    /// The output slice is full before the image ends ([`most_bytes`] always suffices).
    Full {
        /// Bytes there are.
        got: usize,
    },
    /// The stream ends before the image does.
    CutOff {
        /// Bytes there are.
        got: usize,
    },
    /// A run is empty or longer than the image, or a value is no 16-bit reading: not RVL, or of another size.
    Corrupt,
}

impl fmt::Display for RvlError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full { got } => write!(f, "RVL: {got} bytes of output are too few for this image; see most_bytes"),
            Self::CutOff { got } => write!(f, "RVL: the image goes on after the {got} bytes given"),
            Self::Corrupt => write!(f, "RVL: not a depth image of this size"),
        }
    }
}

impl core::error::Error for RvlError {}

/// Bytes of a word.
const WORD: usize = 4;
/// Nibbles of a word.
const NIBBLES: u32 = 8;

/// Bytes that no stream of so many pixels exceeds: six nibbles for the largest difference, and the lengths of two runs.
///
/// ```
/// assert_eq!(isobath::wire::rvl::most_bytes(160 * 120), 57_616);
/// ```
#[must_use]
pub const fn most_bytes(pixels: usize) -> usize {
    pixels.saturating_mul(3).saturating_add(16)
}

/// Nibbles into words.
struct Writer<'a> {
    out: &'a mut [u8],
    at: usize,
    word: u32,
    held: u32,
}

impl Writer<'_> {
    fn number(&mut self, mut value: u32) -> Result<(), RvlError> {
        loop {
            let more = u32::from(value > 7) << 3;
            self.word = self.word << 4 | (value & 7) | more;
            self.held += 1;
            if self.held == NIBBLES {
                self.flush()?;
            }
            value >>= 3;
            if more == 0 {
                return Ok(());
            }
        }
    }

    /// Writes the word begun, padded with zeros.
    fn flush(&mut self) -> Result<(), RvlError> {
        let got = self.out.len();
        let place = self.out.get_mut(self.at..).and_then(|rest| rest.first_chunk_mut::<WORD>());
        let place = place.ok_or(RvlError::Full { got })?;
        *place = (self.word << (4 * (NIBBLES - self.held))).to_le_bytes();
        self.at += WORD;
        (self.word, self.held) = (0, 0);
        Ok(())
    }
}

/// Writes an image as RVL; how many bytes it took, a multiple of four.
///
/// # Errors
/// [`RvlError::Full`].
///
/// ```
/// use isobath::sensing::depth::DepthArray;
/// use isobath::wire::rvl;
/// let depth = DepthArray::<160, 120>::filled(1500);
/// let mut bytes = [0; rvl::most_bytes(160 * 120)];
/// let used = rvl::encode(depth.view(), &mut bytes)?;
/// assert_eq!(used, 9_608); // a nibble a pixel: the differences are 0
/// let mut back = DepthArray::<160, 120>::filled(0);
/// assert_eq!(rvl::decode(&bytes[..used], &mut back.view_mut())?, used);
/// assert_eq!(back, depth);
/// # Ok::<(), rvl::RvlError>(())
/// ```
pub fn encode(depth: ImageView<'_, u16>, out: &mut [u8]) -> Result<usize, RvlError> {
    encode_pixels(depth.rows().flatten().copied(), depth.rows().flatten().copied(), out)
}

/// As [`encode`], of pixels that are made on the way, twice over: two pairs of eyes on the same image, one that counts the run
/// and one that writes it.
pub(crate) fn encode_pixels(
    mut ahead: impl Iterator<Item = u16>,
    mut pixels: impl Iterator<Item = u16>,
    out: &mut [u8],
) -> Result<usize, RvlError> {
    let mut writer = Writer { out, at: 0, word: 0, held: 0 };
    let mut previous = 0_i32;
    let mut next = ahead.next();
    while next.is_some() {
        let mut run = |holes: bool| {
            let mut length = 0_u32;
            while next.is_some_and(|v| (v == 0) == holes) {
                length += 1;
                next = ahead.next();
            }
            length
        };
        let (holes, readings) = (run(true), run(false));
        writer.number(holes)?;
        writer.number(readings)?;
        for value in pixels.by_ref().skip(holes as usize).take(readings as usize) {
            let step = i32::from(value) - previous;
            writer.number((step << 1 ^ step >> 31) as u32)?;
            previous = i32::from(value);
        }
    }
    if writer.held > 0 {
        writer.flush()?;
    }
    Ok(writer.at)
}

/// Words into nibbles.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    word: u32,
    left: u32,
}

impl Reader<'_> {
    #[inline(always)]
    fn nibble(&mut self) -> Result<u32, RvlError> {
        if self.left == 0 {
            let word = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<WORD>());
            self.word = u32::from_le_bytes(*word.ok_or(RvlError::CutOff { got: self.bytes.len() })?);
            self.at += WORD;
            self.left = NIBBLES;
        }
        let nibble = self.word >> 28;
        self.word <<= 4;
        self.left -= 1;
        Ok(nibble)
    }

    #[inline(always)]
    fn number(&mut self) -> Result<u32, RvlError> {
        let mut nibble = self.nibble()?;
        let mut value = nibble & 7;
        let mut shift = 3;
        while nibble & 8 != 0 {
            if shift >= 30 {
                return Err(RvlError::Corrupt);
            }
            nibble = self.nibble()?;
            value |= (nibble & 7) << shift;
            shift += 3;
        }
        Ok(value)
    }
}

/// Reads an image of the output's size; how many bytes it took.
///
/// # Errors
/// [`RvlError::CutOff`], [`RvlError::Corrupt`].
pub fn decode(bytes: &[u8], out: &mut ImageViewMut<'_, u16>) -> Result<usize, RvlError> {
    let (width, height) = out.size();
    let mut reader = Reader { bytes, at: 0, word: 0, left: 0 };
    let mut pixels = width.saturating_mul(height);
    let (mut holes, mut readings, mut previous) = (0_usize, 0_usize, 0_i32);
    for y in 0..height {
        let mut row = out.row_mut(y);
        while !row.is_empty() {
            if holes + readings == 0 {
                (holes, readings) = (reader.number()? as usize, reader.number()? as usize);
                let run = holes.saturating_add(readings);
                pixels = pixels.checked_sub(run).filter(|_| run > 0).ok_or(RvlError::Corrupt)?;
            }
            // A run may go on in the next row.
            let (now, rest) = row.split_at_mut_checked(holes.min(row.len())).unwrap_or_default();
            now.fill(0);
            holes -= now.len();
            let (now, rest) = rest.split_at_mut_checked(readings.min(rest.len())).unwrap_or_default();
            readings -= now.len();
            for value in now {
                let zigzag = reader.number()?;
                previous = previous.wrapping_add((zigzag >> 1) as i32 ^ -((zigzag & 1) as i32));
                *value = u16::try_from(previous).ok().filter(|v| *v > 0).ok_or(RvlError::Corrupt)?;
            }
            row = rest;
        }
    }
    Ok(reader.at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    fn encoded(values: &[u16], width: usize, height: usize) -> Vec<u8> {
        let mut bytes = vec![0; most_bytes(values.len())];
        let used = encode(ImageView::new(values, width, height).unwrap(), &mut bytes).unwrap();
        bytes.truncate(used);
        bytes
    }

    #[test]
    fn the_bytes_are_wilsons() {
        // One hole, two readings: 1, 2, zigzag 2000 = 0b11_111_010_000, zigzag of -1 = 1; nibbles 1 2 8 A F 3 1 0.
        assert_eq!(encoded(&[0, 1000, 999], 3, 1), 0x128a_f310_u32.to_le_bytes());
        assert_eq!(encoded(&[], 0, 0), []);
        // Four holes, no reading.
        assert_eq!(encoded(&[0; 4], 2, 2), 0x4000_0000_u32.to_le_bytes());
    }

    #[test]
    fn what_lies_is_refused() {
        let mut image = [7_u16; 12];
        let mut read = |bytes: &[u8]| decode(bytes, &mut ImageViewMut::new(&mut image, 4, 3).unwrap());
        assert_eq!(read(&[]), Err(RvlError::CutOff { got: 0 }));
        // Both runs empty; a run of thirteen; a number without end; a reading of 0.
        for word in [0x0000_0000_u32, 0xd150_0000, 0xffff_ffff, 0x0c00_0000] {
            let bytes = [word.to_le_bytes(), [0xff; 4]].concat();
            assert!(matches!(read(&bytes), Err(RvlError::Corrupt)), "{word:08x}");
        }
        let mut short = [0; 4];
        let noise = [1_u16, 65_535, 1, 65_535];
        let view = ImageView::new(&noise, 2, 2).unwrap();
        assert_eq!(encode(view, &mut short), Err(RvlError::Full { got: 4 }));
    }

    proptest! {
        #[test]
        fn every_image_comes_back(
            width in 0_usize..40,
            height in 0_usize..12,
            gap in 0_usize..3,
            seed in any::<u32>(),
            hole in 0_u32..8,
        ) {
            let stride = width + gap;
            let mut s = seed | 1;
            let mut next = || { s ^= s << 13; s ^= s >> 17; s ^= s << 5; s };
            let values: Vec<u16> = (0..stride * height)
                .map(|_| if next() % 8 < hole { 0 } else if seed % 2 == 0 { next() as u16 } else { 1000 + (next() % 9) as u16 })
                .collect();
            let view = ImageView::with_stride(&values, width, height, stride).unwrap();
            let mut bytes = vec![0; most_bytes(width * height)];
            let used = encode(view, &mut bytes).unwrap();
            let mut back = vec![3_u16; stride * height];
            let mut out = ImageViewMut::with_stride(&mut back, width, height, stride).unwrap();
            prop_assert_eq!(decode(&bytes, &mut out), Ok(used));
            for (row, want) in out.as_view().rows().zip(view.rows()) {
                prop_assert_eq!(row, want);
            }
            // Without its last word it ends too early.
            if let Some(cut) = used.checked_sub(WORD) {
                prop_assert_eq!(decode(&bytes[..cut], &mut out), Err(RvlError::CutOff { got: cut }));
            }
        }
    }
}
