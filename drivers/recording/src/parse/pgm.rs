//! Binary PGM (Netpbm P5) with 16-bit values, most significant byte first, as the Netpbm page says. Written by hand because
//! the header is four words, and because some writers have the bytes the other way round, which only the raw values show.

use isobath::sensing::depth::decode::ByteOrder;

use super::{ParseError, RawImage, checked_pixels, quoted};

/// Reads a 16-bit PGM. Bytes after the image are ignored, as Netpbm does.
///
/// ```
/// use isobath_recording::parse::{parse_pgm, RawPixels};
/// let image = parse_pgm(b"P5 # depth\n2 1 65535\n\x03\xe8\x00\x00").unwrap();
/// assert_eq!(image.pixels, RawPixels::U16(vec![1000, 0]));
/// ```
///
/// # Errors
/// [`ParseError`] for text and 8-bit PGM, damaged headers, impossible sizes, and files cut off.
pub fn parse_pgm(bytes: &[u8]) -> Result<RawImage, ParseError> {
    let mut at = 0;
    let magic = word(bytes, &mut at)?;
    if magic != "P5" {
        return Err(ParseError::new(
            format!("begins with {}, not with P5", quoted(magic)),
            "depth is read from binary PGM (P5) with 16 bits a pixel",
        ));
    }
    let (width, height, max) = (number(bytes, &mut at)?, number(bytes, &mut at)?, number(bytes, &mut at)?);
    if !(256..=65535).contains(&max) {
        return Err(ParseError::new(
            format!("the largest value is {max}: not a 16-bit PGM"),
            "depth needs 16 bits a pixel (largest value 256 to 65535)",
        ));
    }
    let needed = checked_pixels(width, height)? * 2;
    // Exactly one blank ends the header.
    let body = bytes.get(at + 1..).unwrap_or(&[]);
    match body.get(..needed) {
        Some(body) => RawImage::from_u16_bytes(body, width, height, ByteOrder::Big),
        None => Err(ParseError::new(
            format!("cut off: {width}x{height} values are {needed} bytes, {} are there", body.len()),
            "copy the file again",
        )),
    }
}

/// The next word of the header, past blanks and comments; `at` ends on the blank after it.
fn word<'a>(bytes: &'a [u8], at: &mut usize) -> Result<&'a str, ParseError> {
    let mut comment = false;
    while let Some(&b) = bytes.get(*at) {
        match b {
            b'#' => comment = true,
            b'\n' | b'\r' => comment = false,
            _ if comment || b.is_ascii_whitespace() => {}
            _ => break,
        }
        *at += 1;
    }
    let rest = bytes.get(*at..).unwrap_or(&[]);
    let len = rest.iter().take(32).position(u8::is_ascii_whitespace);
    let word = len.and_then(|n| rest.get(..n)).and_then(|w| core::str::from_utf8(w).ok()).filter(|w| !w.is_empty());
    let Some(word) = word else {
        return Err(ParseError::new(
            "the header is not that of a PGM, or is cut off",
            "it should begin like: P5 640 480 65535",
        ));
    };
    *at += word.len();
    Ok(word)
}

fn number(bytes: &[u8], at: &mut usize) -> Result<usize, ParseError> {
    let word = word(bytes, at)?;
    word.parse().map_err(|_| {
        ParseError::new(
            format!("{} in the header is not a size", quoted(word)),
            "it should begin like: P5 640 480 65535",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse::RawPixels;
    use proptest::prelude::*;

    #[test]
    fn headers_of_all_shapes() {
        for header in ["P5 1 2 65535 ", "P5\n# a\n1 #b\n 2\n65535\n", "P5\r\n1 2\r\n256\n"] {
            let bytes = [header.as_bytes(), &[0, 1, 2, 3]].concat();
            let image = parse_pgm(&bytes).unwrap();
            assert_eq!((image.width, image.height), (1, 2), "{header:?}");
            assert_eq!(image.pixels, RawPixels::U16(vec![1, 0x0203]));
        }
    }

    #[test]
    fn what_is_damaged_is_refused() {
        for bad in [
            "",
            "P5",
            "P5 ",
            "P2 1 1 65535 ab",
            "P5 1 1 255 a",
            "P5 1 1 65536 ab",
            "P5 0 1 65535 ",
            "P5 -1 1 65535 ab",
            "P5 1 1 65535 a",
            "P5 99999999999 99999999999 65535 ab",
            "P5 4294967296 4294967296 65535 ",
            "P5 # never ends",
        ] {
            assert!(parse_pgm(bad.as_bytes()).is_err(), "{bad:?}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_give_an_answer(tail in proptest::collection::vec(any::<u8>(), 0..64)) {
            let _ = parse_pgm(&tail);
            let _ = parse_pgm(&[b"P5 ", &tail[..]].concat());
        }
    }
}
