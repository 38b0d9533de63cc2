//! Pixels as a file holds them, before anybody knows what they mean.

use isobath::sensing::depth::decode::ByteOrder;

use super::{ParseError, checked_pixels};

/// Values of an image, row after row.
#[derive(Debug, Clone, PartialEq)]
pub enum RawPixels {
    /// 16-bit whole numbers.
    U16(Vec<u16>),
    /// 32-bit floating-point numbers.
    F32(Vec<f32>),
}

/// An image whose values have no meaning yet.
#[derive(Debug, Clone, PartialEq)]
pub struct RawImage {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values.
    pub pixels: RawPixels,
}

impl RawImage {
    /// Bare 16-bit values, no header.
    ///
    /// # Errors
    /// [`ParseError`] unless `bytes` holds exactly `width * height` of them.
    pub fn from_u16_bytes(bytes: &[u8], width: usize, height: usize, order: ByteOrder) -> Result<Self, ParseError> {
        let (values, rest) = bytes.as_chunks::<2>();
        exact(width, height, 2, bytes.len(), rest)?;
        let read = match order {
            ByteOrder::Little => u16::from_le_bytes,
            ByteOrder::Big => u16::from_be_bytes,
        };
        Ok(Self { width, height, pixels: RawPixels::U16(values.iter().map(|&v| read(v)).collect()) })
    }

    /// Bare 32-bit floating-point values, no header.
    ///
    /// # Errors
    /// [`ParseError`] unless `bytes` holds exactly `width * height` of them.
    pub fn from_f32_bytes(bytes: &[u8], width: usize, height: usize, order: ByteOrder) -> Result<Self, ParseError> {
        let (values, rest) = bytes.as_chunks::<4>();
        exact(width, height, 4, bytes.len(), rest)?;
        let read = match order {
            ByteOrder::Little => f32::from_le_bytes,
            ByteOrder::Big => f32::from_be_bytes,
        };
        Ok(Self { width, height, pixels: RawPixels::F32(values.iter().map(|&v| read(v)).collect()) })
    }

    /// Exchanges the bytes of 16-bit values: for files whose writer had the order wrong.
    pub fn swap_bytes(&mut self) {
        if let RawPixels::U16(values) = &mut self.pixels {
            for v in values {
                *v = v.swap_bytes();
            }
        }
    }
}

fn exact(width: usize, height: usize, each: usize, got: usize, rest: &[u8]) -> Result<(), ParseError> {
    let needed = checked_pixels(width, height)? * each;
    if needed == got && rest.is_empty() {
        return Ok(());
    }
    Err(ParseError::new(
        format!("{width}x{height} values of {each} bytes are {needed} bytes, the file has {got}"),
        if got < needed {
            "it is cut off, or the size or format given is wrong"
        } else {
            "check the size and the format given"
        },
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bare_values_must_fill_the_size_exactly() {
        let two = RawImage::from_u16_bytes(&[1, 2, 3, 4], 2, 1, ByteOrder::Big).unwrap();
        assert_eq!(two.pixels, RawPixels::U16(vec![0x0102, 0x0304]));
        for (w, h, bytes) in [(2, 1, 3), (2, 1, 5), (0, 4, 0), (usize::MAX, 2, 4), (1 << 20, 1 << 20, 0)] {
            assert!(RawImage::from_u16_bytes(&vec![0; bytes], w, h, ByteOrder::Little).is_err(), "{w}x{h}");
            assert!(RawImage::from_f32_bytes(&vec![0; bytes], w, h, ByteOrder::Little).is_err(), "{w}x{h}");
        }
        let f = RawImage::from_f32_bytes(&1.5_f32.to_be_bytes(), 1, 1, ByteOrder::Big).unwrap();
        assert_eq!(f.pixels, RawPixels::F32(vec![1.5]));
    }
}
