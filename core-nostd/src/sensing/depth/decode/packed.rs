//! Codes of 10, 11 and 12 bits, packed without gaps or into words of 16 bits.
//!
//! | V4L2 | bytes | function |
//! |---|---|---|
//! | `Y10B` | 4 pixels in 5 bytes, most significant bit first | [`y10b`] |
//! | none (Kinect v1 over USB) | 8 pixels in 11 bytes, most significant bit first | [`kinect11`] |
//! | `Y10 `, `Y12 `, `Y14 ` | a pixel in 2 bytes, little-endian, upper bits zero | [`low_bits`] |
//! | `Y12I` | a pixel of each of two cameras in 3 bytes, little-endian | [`y12i`] |
//!
//! (Linux, `Documentation/userspace-api/media/v4l/pixfmt-yuv-luma.rst` and `pixfmt-y12i.rst`; the 11-bit form as libfreenect reads it.) Each row
//! begins at a byte. What a code means (grey, disparity, nothing) is the device's matter: codes come out as they are.
//!
//! Memory: none. Cost: whole groups of pixels are shifted out of one or two words of 64 bits: at most 1.5 ns a pixel, see `isobath bench
//! --filter unpack`. Exact: each equals a reader that takes one bit at a time, which the tests hold.

use super::{DecodeError, lines};
use crate::ground::image::ImageViewMut;

/// Unpacks `Y10B` into codes from 0 to 1023. A row takes `(10 * width + 7) / 8` bytes.
///
/// # Errors
/// [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`].
///
/// ```
/// use isobath::ground::image::Image;
/// use isobath::sensing::depth::decode::packed::y10b;
/// let mut codes = Image::<u16, 4, 1>::filled(0);
/// y10b(&[0x00, 0x50, 0x0f, 0xfc, 0x01], 5, &mut codes.view_mut())?;
/// assert_eq!(codes.as_slice(), &[1, 256, 1023, 1]);
/// # Ok::<(), isobath::sensing::depth::decode::DecodeError>(())
/// ```
pub fn y10b(bytes: &[u8], stride: usize, out: &mut ImageViewMut<'_, u16>) -> Result<(), DecodeError> {
    unpack::<10, 5, 4>(bytes, stride, out, |group| {
        let [a, b, c, d, e] = *group;
        let v = u64::from_be_bytes([0, 0, 0, a, b, c, d, e]);
        [v >> 30, v >> 20, v >> 10, v].map(|code| code as u16 & 0x3ff)
    })
}

/// Unpacks the 11-bit codes of Kinect v1, 0 to 2047, of which 2047 means nothing. A row takes `(11 * width + 7) / 8` bytes.
/// [`kinect`](super::kinect) makes depth of them.
///
/// # Errors
/// [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`].
pub fn kinect11(bytes: &[u8], stride: usize, out: &mut ImageViewMut<'_, u16>) -> Result<(), DecodeError> {
    unpack::<11, 11, 8>(bytes, stride, out, kinect11_group)
}

/// Eight codes: five are whole in the first eight bytes, three in the last eight.
#[inline(always)]
pub(super) fn kinect11_group(group: &[u8; 11]) -> [u16; 8] {
    let [a, b, c, d, e, f, g, h, i, j, k] = *group;
    let first = u64::from_be_bytes([a, b, c, d, e, f, g, h]);
    let last = u64::from_be_bytes([d, e, f, g, h, i, j, k]);
    [first >> 53, first >> 42, first >> 31, first >> 20, first >> 9, last >> 22, last >> 11, last]
        .map(|code| code as u16 & 0x7ff)
}

/// Reads little-endian words of 16 bits and keeps the lowest `bits` (1 to 16) of each: what the others hold is not the pixel's.
///
/// # Errors
/// [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`]; [`DecodeError::BadConstant`] for other numbers of bits.
pub fn low_bits(bytes: &[u8], stride: usize, bits: u32, out: &mut ImageViewMut<'_, u16>) -> Result<(), DecodeError> {
    if !(1..=16).contains(&bits) {
        return Err(DecodeError::BadConstant { name: "bits a pixel", value: bits as f32 });
    }
    let mask = u16::MAX >> (16 - bits);
    let (width, height) = out.size();
    for (y, line) in lines(bytes, stride, width.saturating_mul(2), height)?.enumerate() {
        for (pixel, pair) in out.row_mut(y).iter_mut().zip(line.as_chunks::<2>().0) {
            *pixel = u16::from_le_bytes(*pair) & mask;
        }
    }
    Ok(())
}

/// Which camera of a stereo pair has the low 12 of `Y12I`'s 24 bits. Linux's documentation and the cameras' makers disagree, so it is the
/// device profile's to say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Y12iOrder {
    /// The left one, as Linux documents the format.
    LeftLow,
    /// The right one, as librealsense reads its own cameras.
    RightLow,
}

/// Splits `Y12I` into the images of the left and of the right camera, codes of 12 bits. A row takes `3 * width` bytes.
///
/// # Errors
/// [`DecodeError::SizeMismatch`] when the two outputs differ; [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`].
pub fn y12i(
    bytes: &[u8],
    stride: usize,
    order: Y12iOrder,
    left: &mut ImageViewMut<'_, u16>,
    right: &mut ImageViewMut<'_, u16>,
) -> Result<(), DecodeError> {
    super::same_size(left.size(), right.size())?;
    let (mut low, mut high) = match order {
        Y12iOrder::LeftLow => (left.reborrow(), right.reborrow()),
        Y12iOrder::RightLow => (right.reborrow(), left.reborrow()),
    };
    let (width, height) = low.size();
    for (y, line) in lines(bytes, stride, width.saturating_mul(3), height)?.enumerate() {
        let pixels = low.row_mut(y).iter_mut().zip(high.row_mut(y));
        for ((low, high), group) in pixels.zip(line.as_chunks::<3>().0) {
            let [a, b, c] = group.map(u16::from);
            *low = a | (b & 15) << 8;
            *high = b >> 4 | c << 4;
        }
    }
    Ok(())
}

/// Rows of codes, most significant bit first: groups of `N` codes in `G` bytes, then what is left of the row.
#[inline(always)]
fn unpack<const BITS: usize, const G: usize, const N: usize>(
    bytes: &[u8],
    stride: usize,
    out: &mut ImageViewMut<'_, u16>,
    group: impl Fn(&[u8; G]) -> [u16; N],
) -> Result<(), DecodeError> {
    let (width, height) = out.size();
    for (y, line) in lines(bytes, stride, packed_row(width, BITS), height)?.enumerate() {
        let (pixels, rest) = out.row_mut(y).as_chunks_mut::<N>();
        let (groups, _) = line.as_chunks::<G>();
        for (pixels, bytes) in pixels.iter_mut().zip(groups) {
            *pixels = group(bytes);
        }
        let from = width - rest.len();
        for (i, pixel) in rest.iter_mut().enumerate() {
            *pixel = code_at(line, (from + i) * BITS, BITS);
        }
    }
    Ok(())
}

/// Bytes of a row of codes.
pub(super) const fn packed_row(width: usize, bits: usize) -> usize {
    width.saturating_mul(bits).div_ceil(8)
}

/// One code of at most 16 bits that begins at a bit of the row; what is outside the row is zeros.
fn code_at(line: &[u8], bit: usize, bits: usize) -> u16 {
    let byte = |i: usize| u32::from(line.get(bit / 8 + i).copied().unwrap_or(0));
    let word = byte(0) << 16 | byte(1) << 8 | byte(2);
    (word >> (24 - bit % 8 - bits) & ((1 << bits) - 1)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    type Unpack = fn(&[u8], usize, &mut ImageViewMut<'_, u16>) -> Result<(), DecodeError>;

    /// Packs codes into rows of `stride` bytes, one bit at a time, most significant first.
    fn pack(codes: &[u16], width: usize, bits: usize, stride: usize) -> Vec<u8> {
        let mut bytes = vec![0xa5_u8; codes.len().checked_div(width).unwrap_or(0) * stride];
        for (i, code) in codes.iter().enumerate() {
            for b in 0..bits {
                let at = (i % width) * bits + b;
                let (byte, mask) = ((i / width) * stride + at / 8, 0x80 >> (at % 8));
                let one = code >> (bits - 1 - b) & 1 == 1;
                bytes[byte] = if one { bytes[byte] | mask } else { bytes[byte] & !mask };
            }
        }
        bytes
    }

    proptest! {
        #[test]
        fn packed_codes_come_back(
            kinect in any::<bool>(),
            width in 1_usize..70,
            codes in prop::collection::vec(any::<u16>(), 70 * 4),
            gap in 0_usize..5,
            extra in 0_usize..3,
        ) {
            let (bits, unpack): (_, Unpack) = if kinect { (11, kinect11) } else { (10, y10b) };
            let height = 4;
            let codes: Vec<u16> = codes[..width * height].iter().map(|c| c & ((1 << bits) - 1)).collect();
            let row = (width * bits).div_ceil(8);
            let stride = row + gap;
            let bytes = pack(&codes, width, bits, stride);
            let out_stride = width + extra;
            let mut out = vec![9_u16; out_stride * height];
            let mut view = ImageViewMut::with_stride(&mut out, width, height, out_stride).unwrap();
            unpack(&bytes, stride, &mut view).unwrap();
            for (got, want) in view.as_view().rows().zip(codes.chunks(width)) {
                prop_assert_eq!(got, want);
            }
            // A byte less than the last row needs is an error, as is a stride below the row.
            let needed = (height - 1) * stride + row;
            prop_assert_eq!(
                unpack(&bytes[..needed - 1], stride, &mut view),
                Err(DecodeError::TooShort { needed, got: needed - 1 })
            );
            prop_assert_eq!(unpack(&bytes, row - 1, &mut view), Err(DecodeError::StrideBelowRow { stride: row - 1, row }));
        }

        #[test]
        fn stereo_codes_come_back(
            pixels in prop::collection::vec((0_u16..4096, 0_u16..4096), 1..40),
            right_low in any::<bool>(),
        ) {
            let order = if right_low { Y12iOrder::RightLow } else { Y12iOrder::LeftLow };
            let mut bytes = Vec::new();
            for &(left, right) in &pixels {
                let (low, high) = if right_low { (right, left) } else { (left, right) };
                bytes.extend(&(u32::from(low) | u32::from(high) << 12).to_le_bytes()[..3]);
            }
            let (mut left, mut right) = (vec![0; pixels.len()], vec![0; pixels.len()]);
            let mut l = ImageViewMut::new(&mut left, pixels.len(), 1).unwrap();
            let mut r = ImageViewMut::new(&mut right, pixels.len(), 1).unwrap();
            y12i(&bytes, bytes.len(), order, &mut l, &mut r).unwrap();
            for (i, want) in pixels.iter().enumerate() {
                prop_assert_eq!((left[i], right[i]), *want);
            }
        }

        #[test]
        fn low_bits_are_a_mask(words in prop::collection::vec(any::<u16>(), 1..60), bits in 1_u32..17) {
            let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
            let mut out = vec![0; words.len()];
            let mut view = ImageViewMut::new(&mut out, words.len(), 1).unwrap();
            low_bits(&bytes, bytes.len(), bits, &mut view).unwrap();
            for (got, word) in out.iter().zip(&words) {
                prop_assert_eq!(u32::from(*got), u32::from(*word) % (1 << bits));
            }
        }
    }

    #[test]
    fn other_numbers_of_bits_and_sizes_are_refused() {
        let (mut a, mut b) = ([0_u16; 2], [0_u16; 3]);
        let mut wide = ImageViewMut::new(&mut b, 3, 1).unwrap();
        let mut view = ImageViewMut::new(&mut a, 2, 1).unwrap();
        for bits in [0, 17, u32::MAX] {
            assert!(matches!(low_bits(&[0; 8], 4, bits, &mut view), Err(DecodeError::BadConstant { .. })));
        }
        let order = Y12iOrder::LeftLow;
        assert!(matches!(y12i(&[0; 9], 9, order, &mut view, &mut wide), Err(DecodeError::SizeMismatch { .. })));
        // No pixels need no bytes.
        let mut none = ImageViewMut::new(&mut [], 0, 5).unwrap();
        assert_eq!(y10b(&[], 0, &mut none), Ok(()));
    }
}
