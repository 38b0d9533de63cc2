//! What simulated cameras see: depth that is different at every pixel and in every frame, so that a row or a frame out of
//! place, a wrong stride, a swapped byte is a wrong pixel; with holes. The first pixel is the frame's number.

/// Depth steps of a pixel.
#[must_use]
pub const fn depth(x: usize, y: usize, frame: u64) -> u16 {
    let frame = frame as usize;
    if x == 0 && y == 0 {
        return (frame % 60_000) as u16 + 1;
    }
    if (x + 2 * y + frame).is_multiple_of(61) {
        return 0; // no reading
    }
    400 + ((3 * x + 101 * y + 17 * frame) % 7919) as u16
}

/// A whole frame, row after row.
#[must_use]
pub fn frame(width: usize, height: usize, frame: u64) -> Vec<u16> {
    (0..height).flat_map(|y| (0..width).map(move |x| depth(x, y, frame))).collect()
}

/// A whole frame as little-endian bytes: the content of a camera.
#[must_use]
pub fn bytes(width: usize, height: usize, number: u64) -> Vec<u8> {
    frame(width, height, number).into_iter().flat_map(u16::to_le_bytes).collect()
}

/// The number of the frame with these pixels, if every one of them is right.
#[must_use]
pub fn recognise(pixels: &[u16], width: usize) -> Option<u64> {
    let number = u64::from(pixels.first()?.checked_sub(1)?);
    (pixels == frame(width, pixels.len() / width.max(1), number)).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_recognised_and_a_damaged_one_is_not() {
        let mut pixels = frame(32, 16, 1234);
        assert_eq!(recognise(&pixels, 32), Some(1234));
        assert_eq!(recognise(&pixels, 16), None, "another stride");
        assert!(pixels.contains(&0), "it has holes");
        pixels[100] ^= 1;
        assert_eq!(recognise(&pixels, 32), None);
        assert_eq!(recognise(&[], 32), None);
    }
}
