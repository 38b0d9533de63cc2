//! Pixel formats by name: which bytes a row takes, and one call that unpacks any of them.
//!
//! A `FourCC` never tells the unit, what "no reading" is, whether a number is depth along the axis, a range or a disparity: that is the device's
//! profile. It tells how bits lie, which is all that is here.

use core::fmt;

use super::{ByteOrder, DecodeError, lines, packed, u16_bytes};
use crate::ground::image::ImageViewMut;

/// How the pixels of an image lie in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// Depth in 16 bits, little-endian.
    Z16,
    /// Grey, or depth, in 16 bits, little-endian.
    Y16,
    /// Grey, or depth, in 16 bits, big-endian.
    Y16Be,
    /// 10 bits in words of 16.
    Y10,
    /// 12 bits in words of 16.
    Y12,
    /// 14 bits in words of 16.
    Y14,
    /// 10 bits without gaps: Kinect v1's disparity through the kernel's driver.
    Y10b,
    /// 11 bits without gaps: Kinect v1 over USB. It has no `FourCC`.
    Kinect11,
    /// Two cameras' 12 bits in 3 bytes.
    Y12i,
    /// Infrared plane and depth plane, one behind the other.
    Inzi,
    /// Confidence in 4 bits.
    Cnf4,
}

impl Format {
    /// Those with a `FourCC`.
    const NAMED: [(Self, [u8; 4]); 10] = [
        (Self::Z16, *b"Z16 "),
        (Self::Y16, *b"Y16 "),
        // Linux marks big-endian variants by the uppermost bit.
        (Self::Y16Be, [b'Y', b'1', b'6', b' ' | 0x80]),
        (Self::Y10, *b"Y10 "),
        (Self::Y12, *b"Y12 "),
        (Self::Y14, *b"Y14 "),
        (Self::Y10b, *b"Y10B"),
        (Self::Y12i, *b"Y12I"),
        (Self::Inzi, *b"INZI"),
        (Self::Cnf4, *b"CNF4"),
    ];

    /// From V4L2's `FourCC`, in the order of its bytes; `None` for formats that are not here.
    ///
    /// ```
    /// use isobath::sensing::depth::decode::format::Format;
    /// assert_eq!(Format::from_fourcc(*b"Z16 "), Some(Format::Z16));
    /// assert_eq!(Format::from_fourcc(*b"MJPG"), None);
    /// ```
    #[must_use]
    pub fn from_fourcc(fourcc: [u8; 4]) -> Option<Self> {
        Self::NAMED.iter().find(|(_, name)| *name == fourcc).map(|(format, _)| *format)
    }

    /// V4L2's `FourCC`, if it has one.
    #[must_use]
    pub fn fourcc(self) -> Option<[u8; 4]> {
        Self::NAMED.iter().find(|(format, _)| *format == self).map(|(_, name)| *name)
    }

    /// Bits a pixel: for [`Self::Y12i`] of both cameras, for [`Self::Inzi`] of one plane.
    #[must_use]
    pub const fn bits(self) -> usize {
        match self {
            Self::Z16 | Self::Y16 | Self::Y16Be | Self::Y10 | Self::Y12 | Self::Y14 | Self::Inzi => 16,
            Self::Y10b => 10,
            Self::Kinect11 => 11,
            Self::Y12i => 24,
            Self::Cnf4 => 4,
        }
    }

    /// Bytes of a row without padding; of [`Self::Inzi`] of a row of one plane. Saturates.
    #[must_use]
    pub const fn row_bytes(self, width: usize) -> usize {
        packed::packed_row(width, self.bits())
    }

    /// Bytes of an image whose rows start `stride` bytes apart, the padding behind the last row not counted. Saturates.
    #[must_use]
    pub const fn image_bytes(self, width: usize, height: usize, stride: usize) -> usize {
        let rows = match self {
            Self::Inzi => height.saturating_mul(2),
            _ => height,
        };
        match rows.checked_sub(1) {
            Some(gaps) if width > 0 => gaps.saturating_mul(stride).saturating_add(self.row_bytes(width)),
            _ => 0,
        }
    }

    /// Unpacks the image of one code a pixel: depth of [`Self::Inzi`], the camera in the low bits of [`Self::Y12i`], levels 0 to 15 of
    /// [`Self::Cnf4`]. 65535, the code of a saturated converter, becomes 0 where all 16 bits are used.
    ///
    /// # Errors
    /// [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`].
    pub fn codes(self, bytes: &[u8], stride: usize, out: &mut ImageViewMut<'_, u16>) -> Result<(), DecodeError> {
        match self {
            Self::Z16 | Self::Y16 => u16_bytes(bytes, stride, ByteOrder::Little, out).map(drop),
            Self::Y16Be => u16_bytes(bytes, stride, ByteOrder::Big, out).map(drop),
            Self::Y10 => packed::low_bits(bytes, stride, 10, out),
            Self::Y12 => packed::low_bits(bytes, stride, 12, out),
            Self::Y14 => packed::low_bits(bytes, stride, 14, out),
            Self::Y10b => packed::y10b(bytes, stride, out),
            Self::Kinect11 => packed::kinect11(bytes, stride, out),
            Self::Inzi => super::planes::inzi(bytes, stride, out, None).map(drop),
            Self::Y12i | Self::Cnf4 => {
                let (width, height) = out.size();
                for (y, line) in lines(bytes, stride, self.row_bytes(width), height)?.enumerate() {
                    let at = |i: usize| u16::from(line.get(i).copied().unwrap_or(0));
                    for (x, pixel) in out.row_mut(y).iter_mut().enumerate() {
                        *pixel = match self {
                            Self::Cnf4 => at(x / 2) >> (4 * (x % 2)) & 15,
                            _ => at(3 * x) | (at(3 * x + 1) & 15) << 8,
                        };
                    }
                }
                Ok(())
            }
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.fourcc() {
            // The bit of big-endian formats is no character.
            Some([a, b, c, d]) => {
                let big = if d >= 0x80 { "-BE" } else { "" };
                for byte in [a, b, c, d & 0x7f] {
                    if byte != b' ' {
                        write!(f, "{}", char::from(byte))?;
                    }
                }
                f.write_str(big)
            }
            None => f.write_str("Kinect 11 bit"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::format;
    use std::vec;

    #[test]
    fn names_come_back() {
        for (format, name) in Format::NAMED {
            assert_eq!(Format::from_fourcc(name), Some(format));
            assert_eq!(format.fourcc(), Some(name));
        }
        assert_eq!(format!("{} {} {}", Format::Z16, Format::Y16Be, Format::Kinect11), "Z16 Y16-BE Kinect 11 bit");
    }

    #[test]
    fn exactly_the_bytes_said_are_needed() {
        let all = Format::NAMED.iter().map(|(format, _)| *format).chain([Format::Kinect11]);
        for format in all {
            for (width, height) in [(0, 0), (1, 1), (7, 3), (8, 2), (640, 2)] {
                let stride = format.row_bytes(width) + 3;
                let needed = format.image_bytes(width, height, stride);
                let bytes = vec![0xff; needed];
                let mut out = vec![0; width * height];
                let mut view = ImageViewMut::new(&mut out, width, height).unwrap();
                assert_eq!(format.codes(&bytes, stride, &mut view), Ok(()), "{format}");
                if needed > 0 {
                    let short = format.codes(&bytes[1..], stride, &mut view);
                    assert_eq!(
                        short,
                        Err(DecodeError::TooShort { needed, got: needed - 1 }),
                        "{format} {width}x{height}"
                    );
                }
                let most = if format.bits() == 16 { 0 } else { (1_u16 << format.bits().min(12)) - 1 };
                let most = match format {
                    Format::Y10 | Format::Y12 | Format::Y14 => out.first().copied().unwrap_or(0),
                    _ => most,
                };
                assert!(out.iter().all(|v| *v == most), "{format}: {out:?}");
            }
        }
        assert_eq!(Format::Kinect11.image_bytes(640, 480, 880), 422_400);
        assert_eq!(Format::Z16.image_bytes(usize::MAX, usize::MAX, usize::MAX), usize::MAX);
    }
}
