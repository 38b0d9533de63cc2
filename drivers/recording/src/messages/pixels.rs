//! From the bytes of an image message to a frame's depth, colour and confidence.
//!
//! Depth is `16UC1` (or `mono16`), millimetres by ROS's REP 118 unless the recording says otherwise, or `32FC1`, metres; `compressedDepth`
//! is a PNG behind twelve bytes, holding either millimetres or, of metres, inverse depth in steps. Colour is `rgb8`, `bgr8`, `rgba8`,
//! `bgra8`, `mono8`, JPEG or PNG.

use isobath::sensing::depth::DepthUnit;
use isobath_source::OwnedFrame;

use super::Image;
use crate::parse::{ParseError, RawPixels, checked_pixels, decode_depth_png};
use crate::reader::decode_colour;

/// What a depth image's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Numbers {
    /// 16-bit steps.
    U16,
    /// Floating point.
    F32,
}

/// Whether an encoding can be depth.
pub(crate) fn is_depth(encoding: &str) -> bool {
    matches!(encoding, "16UC1" | "mono16" | "32FC1") || encoding.contains("compressedDepth")
}

/// Whether an encoding is colour that is read.
pub(crate) fn is_colour(encoding: &str) -> bool {
    let compressed = ["jpeg", "jpg", "png"].iter().any(|kind| encoding.contains(kind));
    channels(encoding).is_some_and(|(bytes, _)| bytes > 1) || (compressed && !encoding.contains("compressedDepth"))
}

/// Bytes a pixel, and which of them are red, green and blue.
fn channels(encoding: &str) -> Option<(usize, [usize; 3])> {
    Some(match encoding {
        "rgb8" => (3, [0, 1, 2]),
        "bgr8" | "8UC3" => (3, [2, 1, 0]),
        "rgba8" => (4, [0, 1, 2]),
        "bgra8" | "8UC4" => (4, [2, 1, 0]),
        "mono8" | "8UC1" => (1, [0, 0, 0]),
        _ => return None,
    })
}

/// The image's rows, each of `width * bytes` bytes.
fn rows<'a>(image: &'a Image<'_>, bytes: usize) -> Result<impl Iterator<Item = &'a [u8]>, ParseError> {
    let (width, height) = (image.width as usize, image.height as usize);
    checked_pixels(width, height)?;
    let row = width * bytes;
    let step = if image.step == 0 { row } else { image.step as usize };
    let needed = step.checked_mul(height - 1).and_then(|n| n.checked_add(row));
    if step < row || needed.is_none_or(|n| n > image.data.len()) {
        return Err(ParseError::new(
            format!(
                "an image of {width}x{height} {} with rows of {step} bytes holds {} bytes",
                image.encoding,
                image.data.len()
            ),
            "the file is damaged: copy it again",
        ));
    }
    Ok(image.data.chunks(step.max(1)).take(height).map(move |r| r.get(..row).unwrap_or(&[])))
}

/// Fills the frame's depth and unit. With `restore`, metres become the `u16` steps that they were written from.
pub(crate) fn depth_into(
    image: &Image<'_>,
    restore: Option<DepthUnit>,
    frame: &mut OwnedFrame,
) -> Result<Numbers, ParseError> {
    let (width, height) = (image.width as usize, image.height as usize);
    match image.encoding.as_ref() {
        "16UC1" | "mono16" => {
            let rows = rows(image, 2)?;
            frame.unit = DepthUnit::MILLIMETRE;
            let out = frame.depth_u16_mut(width, height);
            for (out, row) in out.chunks_mut(width).zip(rows) {
                for (out, b) in out.iter_mut().zip(row.as_chunks().0) {
                    *out = if image.big_endian { u16::from_be_bytes(*b) } else { u16::from_le_bytes(*b) };
                }
            }
            Ok(Numbers::U16)
        }
        "32FC1" => {
            let values = |b: &[u8; 4]| if image.big_endian { f32::from_be_bytes(*b) } else { f32::from_le_bytes(*b) };
            let rows = rows(image, 4)?;
            if let Some(unit) = restore {
                frame.unit = unit;
                let out = frame.depth_u16_mut(width, height);
                for (out, row) in out.chunks_mut(width).zip(rows) {
                    for (out, b) in out.iter_mut().zip(row.as_chunks().0) {
                        *out = steps(values(b), unit);
                    }
                }
                return Ok(Numbers::U16);
            }
            frame.unit = DepthUnit::METRE;
            let out = frame.depth_f32_mut(width, height);
            for (out, row) in out.chunks_mut(width).zip(rows) {
                for (out, b) in out.iter_mut().zip(row.as_chunks().0) {
                    *out = values(b);
                }
            }
            Ok(Numbers::F32)
        }
        other if other.contains("compressedDepth") => compressed_depth(image, frame),
        other => Err(ParseError::new(
            format!("depth in {other:?} is not read"),
            "16UC1, mono16, 32FC1 and compressedDepth PNG are",
        )),
    }
}

/// The `u16` step that [`metres`] was given.
fn steps(z: f32, unit: DepthUnit) -> u16 {
    // The quotient is within 0.01 of the whole number it was, for all 65535 of them; NaN becomes 0, infinity 65535.
    (z / unit.metres()).round() as u16
}

/// A `u16` step as metres that [`steps`] turns back: the hole 0 is NaN and the hole 65535 infinite, as REP 118 has it.
pub(crate) fn metres(step: u16, unit: DepthUnit) -> f32 {
    match step {
        0 => f32::NAN,
        u16::MAX => f32::INFINITY,
        v => f32::from(v) * unit.metres(),
    }
}

/// `compressed_depth_image_transport`: i32 format, f32 a, f32 b, then a 16-bit PNG.
fn compressed_depth(image: &Image<'_>, frame: &mut OwnedFrame) -> Result<Numbers, ParseError> {
    let Some((head, png)) = image.data.split_at_checked(12) else { return Err(super::cut_off()) };
    let &[_, a, b] = head.as_chunks::<4>().0 else { return Err(super::cut_off()) };
    if !png.starts_with(b"\x89PNG") {
        return Err(ParseError::new(
            format!("compressed depth {:?} is not PNG", image.encoding),
            "record with `format: png`, which is that transport's default",
        ));
    }
    let decoded = decode_depth_png(png)?;
    let RawPixels::U16(values) = decoded.pixels else {
        return Err(ParseError::new("compressed depth holds no whole numbers", "the file is damaged: copy it again"));
    };
    let (width, height) = (decoded.width, decoded.height);
    if image.encoding.starts_with("32FC1") {
        let (a, b) = (f32::from_le_bytes(a), f32::from_le_bytes(b));
        frame.unit = DepthUnit::METRE;
        for (out, v) in frame.depth_f32_mut(width, height).iter_mut().zip(values) {
            *out = if v == 0 { f32::NAN } else { a / (f32::from(v) - b) };
        }
        return Ok(Numbers::F32);
    }
    frame.unit = DepthUnit::MILLIMETRE;
    frame.depth_u16_mut(width, height).copy_from_slice(&values);
    Ok(Numbers::U16)
}

/// Fills the frame's colour.
pub(crate) fn colour_into(image: &Image<'_>, frame: &mut OwnedFrame) -> Result<(), ParseError> {
    let Some((bytes, [r, g, b])) = channels(&image.encoding) else {
        if is_colour(&image.encoding) {
            return decode_colour(&image.data, frame);
        }
        return Err(ParseError::new(
            format!("colour in {:?} is not read", image.encoding),
            "rgb8, bgr8, rgba8, bgra8, mono8, JPEG and PNG are",
        ));
    };
    let rows = rows(image, bytes)?;
    let (width, height) = (image.width as usize, image.height as usize);
    let out = frame.colour_mut(width, height);
    for (out, row) in out.chunks_mut(width).zip(rows) {
        for (out, pixel) in out.iter_mut().zip(row.chunks_exact(bytes)) {
            *out = [r, g, b].map(|c| pixel.get(c).copied().unwrap_or(0));
        }
    }
    Ok(())
}

/// Fills the frame's confidence, whose size must be depth's.
pub(crate) fn confidence_into(image: &Image<'_>, frame: &mut OwnedFrame) -> Result<(), ParseError> {
    let size = (image.width as usize, image.height as usize);
    if size != frame.size() || !matches!(image.encoding.as_ref(), "mono8" | "8UC1") {
        return Err(ParseError::new(
            format!("confidence of {}x{} {} does not fit", size.0, size.1, image.encoding),
            "it must be mono8 of depth's size",
        ));
    }
    let rows = rows(image, 1)?;
    for (out, row) in frame.confidence_mut().chunks_mut(size.0).zip(rows) {
        out.copy_from_slice(row);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::borrow::Cow;

    proptest! {
        // What the writer relies on, for every unit there can be.
        #[test]
        fn every_step_of_every_unit_comes_back(unit in 1e-6_f32..60.0, from in 0_u16..=65_000) {
            let unit = DepthUnit::new(unit).unwrap();
            for v in (from..=from.saturating_add(536)).chain([0, 1, 65_534, 65_535]) {
                prop_assert_eq!(steps(metres(v, unit), unit), v);
            }
        }
    }

    fn image(encoding: &str, width: u32, height: u32, step: u32, data: &[u8]) -> Image<'static> {
        Image {
            width,
            height,
            step,
            encoding: Cow::Owned(encoding.into()),
            data: Cow::Owned(data.into()),
            ..Image::default()
        }
    }

    #[test]
    fn padded_rows_and_byte_orders_are_read() {
        let mut frame = OwnedFrame::new();
        let mut i = image("16UC1", 2, 2, 5, &[1, 0, 2, 0, 9, 3, 0, 4, 1]);
        assert_eq!(depth_into(&i, None, &mut frame), Ok(Numbers::U16));
        assert_eq!(frame.depth(), &isobath_source::DepthPixels::U16(vec![1, 2, 3, 260]));
        i.big_endian = true;
        depth_into(&i, None, &mut frame).unwrap();
        assert_eq!(frame.depth(), &isobath_source::DepthPixels::U16(vec![256, 512, 768, 1025]));
        colour_into(&image("bgr8", 1, 1, 0, &[1, 2, 3]), &mut frame).unwrap();
        assert_eq!(frame.colour().unwrap().rows().next().unwrap(), [[3, 2, 1]]);
    }

    #[test]
    fn images_that_cannot_be_are_refused() {
        let mut frame = OwnedFrame::new();
        for (encoding, w, h, step) in [
            ("16UC1", 2, 2, 3),
            ("16UC1", 2, 3, 4),
            ("32FC1", 2, 2, 0),
            ("16UC1", u32::MAX, u32::MAX, u32::MAX),
            ("16UC1", 0, 1, 0),
        ] {
            assert!(depth_into(&image(encoding, w, h, step, &[0; 9]), None, &mut frame).is_err(), "{encoding} {w} {h}");
        }
        assert!(depth_into(&image("16UC1; compressedDepth png", 0, 0, 0, &[0; 40]), None, &mut frame).is_err());
        assert!(colour_into(&image("yuv422", 1, 1, 2, &[0; 2]), &mut frame).unwrap_err().hint.contains("rgb8"));
    }
}
