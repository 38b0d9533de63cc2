//! Depth from 16-bit grey PNG, the form of most recordings.

use std::io::Cursor;

use isobath::sensing::depth::decode::ByteOrder;

use super::{MAX_PIXELS, ParseError, RawImage, checked_pixels};

/// Bytes the decoder may take: the pixels themselves and its tables.
const DECODER_LIMIT: usize = MAX_PIXELS * 2 + (16 << 20);

/// Reads a 16-bit grey PNG.
///
/// # Errors
/// [`ParseError`] for other kinds of PNG (8-bit and colour images are pictures of depth, not depth), impossible sizes, and
/// files damaged or cut off.
pub fn decode_depth_png(bytes: &[u8]) -> Result<RawImage, ParseError> {
    let broken =
        |e: png::DecodingError| ParseError::new(format!("not readable as PNG: {e}"), "copy or export the file again");
    let limits = png::Limits { bytes: DECODER_LIMIT };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(png::Transformations::IDENTITY);
    // Neither is looked at; both may be compressed bombs.
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let mut reader = decoder.read_info().map_err(broken)?;
    let info = reader.info();
    let (width, height) = (info.width as usize, info.height as usize);
    if (info.color_type, info.bit_depth) != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        return Err(ParseError::new(
            format!("holds {:?} of {} bits, not grey of 16 bits", info.color_type, info.bit_depth as u8),
            "8-bit and colour images are pictures of depth: export depth itself, as 16-bit grey",
        ));
    }
    let needed = checked_pixels(width, height)? * 2;
    check_png_data(bytes, needed as u64)?;
    let mut data = vec![0; needed];
    reader.next_frame(&mut data).map_err(broken)?;
    RawImage::from_u16_bytes(&data, width, height, ByteOrder::Big)
}

/// Deflate makes at most 258 bytes of two bits.
const MOST_INFLATION: u64 = 258 * 4;

/// Refuses a PNG whose compressed data can't hold `needed` bytes of pixels, before memory and time are spent on them: the
/// decoder fills rows of the declared width, of each interlace pass, before it finds that nothing comes.
pub(crate) fn check_png_data(bytes: &[u8], needed: u64) -> Result<(), ParseError> {
    let mut held = 0_u64;
    let mut rest = bytes.get(8..).unwrap_or(&[]);
    while let Some((&[a, b, c, d, ref kind @ ..], body)) = rest.split_first_chunk::<8>() {
        let len = u32::from_be_bytes([a, b, c, d]) as usize;
        if kind == b"IDAT" {
            held += len.min(body.len()) as u64;
        }
        // Past the chunk and its checksum.
        rest = body.get(len.saturating_add(4)..).unwrap_or(&[]);
    }
    if needed > held.saturating_mul(MOST_INFLATION) {
        return Err(ParseError::new(
            format!("cut off: {held} bytes of compressed data can't hold {needed} bytes of pixels"),
            "copy or export the file again",
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse::RawPixels;

    fn encode(width: u32, height: u32, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, width, height);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        out
    }

    #[test]
    fn sixteen_bits_of_grey_and_nothing_else() {
        let good = encode(2, 1, png::ColorType::Grayscale, png::BitDepth::Sixteen, &[3, 0xe8, 0xff, 0xff]);
        assert_eq!(decode_depth_png(&good).unwrap().pixels, RawPixels::U16(vec![1000, 65535]));
        let eight = encode(2, 1, png::ColorType::Grayscale, png::BitDepth::Eight, &[3, 4]);
        assert!(decode_depth_png(&eight).unwrap_err().what.contains("8 bits"));
        let rgb = encode(1, 1, png::ColorType::Rgb, png::BitDepth::Eight, &[3, 4, 5]);
        assert!(decode_depth_png(&rgb).is_err());
        // Cut off anywhere before the pixels end, it is refused; it never panics.
        for cut in 0..good.len() - 12 {
            let _ = decode_depth_png(&good[..cut]);
        }
        assert!(decode_depth_png(&good[..good.len() / 2]).is_err());
        assert!(decode_depth_png(b"").is_err());
    }

    #[test]
    fn a_header_that_promises_too_much_is_refused() {
        let mut bytes = encode(1, 1, png::ColorType::Grayscale, png::BitDepth::Sixteen, &[0, 1]);
        bytes[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]); // 65536 x 65536
        assert!(decode_depth_png(&bytes).is_err());
    }

    #[test]
    fn data_that_cannot_hold_the_pixels_is_refused_before_it_is_decoded() {
        // A real image of zeros compresses as well as anything can.
        let real = encode(1024, 1024, png::ColorType::Grayscale, png::BitDepth::Sixteen, &vec![0; 2 << 20]);
        assert!(decode_depth_png(&real).is_ok(), "{} bytes", real.len());
        for (width, height, interlaced) in
            [(8192_u32, 8192_u32, 0), (65_536, 1024, 1), (1024, 65_536, 1), (65_535, 1, 1)]
        {
            let mut bytes = encode(1, 1, png::ColorType::Grayscale, png::BitDepth::Sixteen, &[0, 1]);
            bytes[16..20].copy_from_slice(&width.to_be_bytes());
            bytes[20..24].copy_from_slice(&height.to_be_bytes());
            bytes[28] = interlaced;
            let sum = crc(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&sum.to_be_bytes());
            let error = decode_depth_png(&bytes).unwrap_err();
            assert!(error.what.starts_with("cut off"), "{width}x{height}: {error}");
        }
    }

    /// The checksum of a PNG chunk.
    fn crc(bytes: &[u8]) -> u32 {
        let mut crc = flate2::Crc::new();
        crc.update(bytes);
        crc.sum()
    }
}
