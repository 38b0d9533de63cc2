//! The sRGB curve without a power per pixel: the 255 linear values at which the byte changes, searched.

use std::sync::OnceLock;

/// The curve, 0 to 1 on both sides.
fn to_linear(v: f64) -> f64 {
    if v <= 0.040_45 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) }
}

/// The byte of a linear value; rounds to nearest in sRGB, clamps, and takes NaN for black.
pub(crate) fn encode(linear: f32) -> u8 {
    static STEPS: OnceLock<[f32; 255]> = OnceLock::new();
    let steps = STEPS.get_or_init(|| std::array::from_fn(|i| to_linear((i as f64 + 0.5) / 255.0) as f32));
    steps.partition_point(|&s| s < linear) as u8
}

/// The linear value of a byte.
pub(crate) fn decode(byte: u8) -> f32 {
    static VALUES: OnceLock<[f32; 256]> = OnceLock::new();
    let values = VALUES.get_or_init(|| std::array::from_fn(|i| to_linear(i as f64 / 255.0) as f32));
    values.get(usize::from(byte)).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_returns_to_itself() {
        for b in 0..=255 {
            assert_eq!(encode(decode(b)), b);
        }
        assert_eq!([encode(-1.0), encode(f32::NAN), encode(9.0), encode(f32::INFINITY)], [0, 0, 255, 255]);
    }
}
