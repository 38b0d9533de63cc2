//! Images that travel together, and nibbles of confidence.
//!
//! | V4L2 | bytes | function |
//! |---|---|---|
//! | `INZI` | a plane of infrared in `Y10 `, then a plane of depth in `Z16 ` | [`inzi`] |
//! | `CNF4` | confidence, 4 bits a pixel; of each byte the low nibble first | [`cnf4`] |
//!
//! (Linux, `pixfmt-inzi.rst` and `pixfmt-cnf4.rst`.) Memory: none. Cost: one pass. Exact.

use super::{ByteOrder, DecodeError, DecodeReport, lines, packed, u16_bytes};
use crate::ground::image::ImageViewMut;
use crate::sensing::depth::confidence;

/// Splits `INZI`: depth, with its report, and, when asked for, infrared codes from 0 to 1023. The planes follow each other without a gap, the
/// rows in each start `stride` bytes apart: `2 * width` for every camera known (V4L2's `bytesperline` counts both planes and says
/// `4 * width`).
///
/// # Errors
/// [`DecodeError::SizeMismatch`] when the outputs differ; [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`].
pub fn inzi(
    bytes: &[u8],
    stride: usize,
    depth: &mut ImageViewMut<'_, u16>,
    infrared: Option<&mut ImageViewMut<'_, u16>>,
) -> Result<DecodeReport, DecodeError> {
    let (_, height) = depth.size();
    // The depth plane first: if it is there, so is the other.
    let plane = height.saturating_mul(stride);
    let report = match bytes.get(plane..) {
        Some(rest) => u16_bytes(rest, stride, ByteOrder::Little, depth),
        None => u16_bytes(&[], stride, ByteOrder::Little, depth),
    };
    let report = report.map_err(|e| match e {
        DecodeError::TooShort { needed, .. } => {
            DecodeError::TooShort { needed: needed.saturating_add(plane), got: bytes.len() }
        }
        e => e,
    })?;
    if let Some(infrared) = infrared {
        super::same_size(depth.size(), infrared.size())?;
        packed::low_bits(bytes, stride, 10, infrared)?;
    }
    Ok(report)
}

/// Widens `CNF4` to the crate's scale: 0 (not at all) to 255 (certain), in steps of 17. A row takes `(width + 1) / 2` bytes.
///
/// # Errors
/// [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`].
///
/// ```
/// use isobath::ground::image::Image;
/// use isobath::sensing::depth::decode::planes::cnf4;
/// let mut sure = Image::<u8, 3, 1>::filled(9);
/// cnf4(&[0xf0, 0x71], 2, &mut sure.view_mut())?;
/// assert_eq!(sure.as_slice(), &[0, 255, 17]);
/// # Ok::<(), isobath::sensing::depth::decode::DecodeError>(())
/// ```
pub fn cnf4(bytes: &[u8], stride: usize, out: &mut ImageViewMut<'_, u8>) -> Result<(), DecodeError> {
    let (width, height) = out.size();
    for (y, line) in lines(bytes, stride, width.div_ceil(2), height)?.enumerate() {
        let (pairs, last) = out.row_mut(y).as_chunks_mut::<2>();
        let odd = line.get(pairs.len());
        for (pair, byte) in pairs.iter_mut().zip(line) {
            *pair = [byte & 15, byte >> 4].map(|level| confidence::from_level(level, 15));
        }
        for (pixel, byte) in last.iter_mut().zip(odd) {
            *pixel = confidence::from_level(byte & 15, 15);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    proptest! {
        #[test]
        fn planes_come_apart(
            width in 1_usize..20,
            gap in 0_usize..4,
            words in prop::collection::vec((any::<u16>(), 0_u16..1024), 20 * 3),
            ask in any::<bool>(),
        ) {
            let (height, stride) = (3, 2 * width + gap);
            let mut bytes = vec![0xee_u8; 2 * height * stride];
            let at = |plane: usize, x: usize, y: usize| (plane * height + y) * stride + 2 * x;
            for y in 0..height {
                for x in 0..width {
                    let (z, ir) = words[y * width + x];
                    bytes[at(0, x, y)..][..2].copy_from_slice(&ir.to_le_bytes());
                    bytes[at(1, x, y)..][..2].copy_from_slice(&z.to_le_bytes());
                }
            }
            let (mut depth, mut infrared) = (vec![3; width * height], vec![3; width * height]);
            let mut d = ImageViewMut::new(&mut depth, width, height).unwrap();
            let mut i = ImageViewMut::new(&mut infrared, width, height).unwrap();
            let report = inzi(&bytes, stride, &mut d, ask.then_some(&mut i)).unwrap();
            prop_assert_eq!(report.valid + report.holes, width * height);
            let needed = (2 * height - 1) * stride + 2 * width;
            prop_assert_eq!(
                inzi(&bytes[..needed - 1], stride, &mut d, None),
                Err(DecodeError::TooShort { needed, got: needed - 1 })
            );
            for (k, (z, ir)) in words[..width * height].iter().enumerate() {
                prop_assert_eq!(depth[k], if *z == u16::MAX { 0 } else { *z });
                prop_assert_eq!(infrared[k], if ask { *ir } else { 3 });
            }
        }

        #[test]
        fn nibbles_come_apart(width in 1_usize..40, levels in prop::collection::vec(0_u8..16, 40 * 2), gap in 0_usize..3) {
            let (height, row) = (2, width.div_ceil(2));
            let stride = row + gap;
            let mut bytes = vec![0xcc_u8; stride * height];
            for (i, level) in levels[..width * height].iter().enumerate() {
                let (x, y) = (i % width, i / width);
                let (byte, shift) = (y * stride + x / 2, 4 * (x % 2));
                bytes[byte] = bytes[byte] & !(15 << shift) | level << shift;
            }
            let mut out = vec![1_u8; width * height];
            let mut view = ImageViewMut::new(&mut out, width, height).unwrap();
            cnf4(&bytes, stride, &mut view).unwrap();
            let want: Vec<u8> = levels[..width * height].iter().map(|n| n * 17).collect();
            prop_assert_eq!(cnf4(&bytes, row - 1, &mut view).is_err(), true);
            prop_assert_eq!(out, want);
        }
    }

    #[test]
    fn planes_that_are_not_there_are_an_error() {
        let mut out = [0_u16; 4];
        let mut view = ImageViewMut::new(&mut out, 2, 2).unwrap();
        assert_eq!(inzi(&[0; 7], 4, &mut view, None), Err(DecodeError::TooShort { needed: 16, got: 7 }));
        let mut other = [0_u16; 2];
        let mut other = ImageViewMut::new(&mut other, 2, 1).unwrap();
        let mismatch = inzi(&[0; 16], 4, &mut view, Some(&mut other));
        assert!(matches!(mismatch, Err(DecodeError::SizeMismatch { .. })));
    }
}
