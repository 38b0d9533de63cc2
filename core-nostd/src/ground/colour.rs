//! Colours: linear radiance, and the three forms in which pixels hold it.
//!
//! Light adds up in linear radiance alone, so every kernel works on `[f32; 3]`: red, green, blue with the primaries of sRGB; 1 is
//! what a camera's byte 255 means. A pixel is any [`Colour`]: `[f32; 3]` (12 bytes), [`Rgb9e5`] (4 bytes, high dynamic range), or
//! `[u8; 3]` (sRGB as cameras give it; above 1 it saturates).
//!
//! Tables: decoding 1,024 bytes, encoding 2,692 bytes, made by the compiler. Error: a decoded byte is the nearest `f32` but for
//! 1 ulp; an encoded one is exact: the byte whose interval holds the number. Cost of encoding: two loads and no branch.

use super::math;

/// A pixel that holds a colour.
pub trait Colour: Copy {
    /// The colour, linear.
    fn linear(self) -> [f32; 3];
    /// The nearest pixel to a linear colour. Negative and NaN are 0.
    fn of_linear(linear: [f32; 3]) -> Self;
    /// The nearest pixel to a camera's bytes (sRGB).
    #[inline(always)]
    fn of_srgb(bytes: [u8; 3]) -> Self {
        Self::of_linear(bytes.linear())
    }
}

impl Colour for [f32; 3] {
    #[inline(always)]
    fn linear(self) -> [f32; 3] {
        self
    }

    #[inline(always)]
    fn of_linear(linear: [f32; 3]) -> Self {
        linear
    }
}

impl Colour for [u8; 3] {
    #[inline(always)]
    fn linear(self) -> [f32; 3] {
        self.map(decode_srgb)
    }

    #[inline(always)]
    fn of_linear(linear: [f32; 3]) -> Self {
        linear.map(encode_srgb)
    }

    #[inline(always)]
    fn of_srgb(bytes: [u8; 3]) -> Self {
        bytes
    }
}

/// Three mantissas of 9 bits under one exponent of 5 (OpenGL `RGB9_E5`, `EXT_texture_shared_exponent`): 4 bytes of colour
/// from 6e-8 to 65,408, to 1/512 of the largest channel.
///
/// ```
/// use isobath::ground::colour::{Colour, Rgb9e5};
/// let lamp = Rgb9e5::of_linear([1200.0, 800.0, 0.5]);
/// assert_eq!(lamp.linear(), [1200.0, 800.0, 0.0]); // steps of 4 at that brightness
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(transparent)]
pub struct Rgb9e5(pub u32);

impl Rgb9e5 {
    const MANTISSA: i32 = 9;
    const BIAS: i32 = 15;
    /// The largest channel that is held.
    pub const MAX: f32 = 65_408.0;
}

/// 2 to the power `e`, for `e` in -126 to 127.
const fn power_of_two(e: i32) -> f32 {
    f32::from_bits(((e + 127) as u32) << 23)
}

impl Colour for Rgb9e5 {
    #[inline]
    fn linear(self) -> [f32; 3] {
        let scale = power_of_two((self.0 >> 27) as i32 - Self::BIAS - Self::MANTISSA);
        [self.0 & 511, self.0 >> 9 & 511, self.0 >> 18 & 511].map(|m| m as f32 * scale)
    }

    #[inline]
    fn of_linear(linear: [f32; 3]) -> Self {
        let [r, g, b] = linear.map(|v| math::clamp(if v > 0.0 { v } else { 0.0 }, 0.0, Self::MAX));
        let largest = r.max(g).max(b);
        let floor_log = ((largest.to_bits() >> 23) as i32 - 127).max(-Self::BIAS - 1);
        let mut exponent = floor_log + 1 + Self::BIAS;
        // Rounding up may need one more bit.
        let scaled = |e: i32| power_of_two(Self::MANTISSA + Self::BIAS - e);
        if (largest * scaled(exponent) + 0.5) as u32 == 512 {
            exponent += 1;
        }
        let [r, g, b] = [r, g, b].map(|v| (v * scaled(exponent) + 0.5) as u32);
        Self((exponent as u32) << 27 | b << 18 | g << 9 | r)
    }
}

/// The linear value of an sRGB byte (IEC 61966-2-1), 0 to 1.
#[inline(always)]
#[must_use]
pub fn decode_srgb(byte: u8) -> f32 {
    DECODED.get(usize::from(byte)).copied().unwrap_or_default()
}

/// The sRGB byte of a linear value; 0 for what is negative or NaN, 255 above 1.
#[inline(always)]
#[must_use]
pub fn encode_srgb(linear: f32) -> u8 {
    // NaN is below nothing, and becomes the least.
    let v = if linear > SMALLEST { linear } else { SMALLEST };
    let v = if v < 1.0 { v } else { LARGEST };
    let bin = ((v.to_bits() - SMALLEST.to_bits()) >> BIN_SHIFT) as usize;
    let code = FIRST.get(bin).copied().unwrap_or_default();
    let next = STARTS.get(usize::from(code) + 1).copied().unwrap_or_default();
    code + u8::from(v >= next)
}

/// 2^-13: all below is byte 0.
const SMALLEST: f32 = 1.0 / 8192.0;
/// The number before 1, of byte 255.
const LARGEST: f32 = 1.0 - f32::EPSILON / 2.0;
/// Seven bits of mantissa choose a bin, which holds the start of at most one byte.
const BIN_SHIFT: u32 = 16;
const BINS: usize = 13 << 7;

static DECODED: [f32; 256] = decoded();
/// Where each byte's interval starts; nothing starts after the last.
static STARTS: [f32; 257] = starts();
/// The byte of each bin's start.
static FIRST: [u8; BINS] = first();

/// `x` to the power 2.4, for the compiler: x^2 times the fifth root of x^2, by Newton's steps from above.
const fn power_2_4(x: f64) -> f64 {
    let square = x * x;
    let mut root = 1.0;
    let mut i = 0;
    while i < 60 {
        root -= (root - square / (root * root * root * root)) / 5.0;
        i += 1;
    }
    square * root
}

/// The curve of sRGB, of 0 to 1.
const fn curve(v: f64) -> f64 {
    if v <= 0.040_45 { v / 12.92 } else { power_2_4((v + 0.055) / 1.055) }
}

#[expect(clippy::indexing_slicing, reason = "run by the compiler, where a fault is an error")]
const fn decoded() -> [f32; 256] {
    let mut table = [0.0; 256];
    let mut i = 0;
    while i < 256 {
        table[i] = curve(i as f64 / 255.0) as f32;
        i += 1;
    }
    table
}

#[expect(clippy::indexing_slicing, reason = "run by the compiler, where a fault is an error")]
const fn starts() -> [f32; 257] {
    let mut table = [0.0; 257];
    table[256] = f32::INFINITY;
    let mut i = 1;
    while i < 256 {
        table[i] = curve((i as f64 - 0.5) / 255.0) as f32;
        i += 1;
    }
    table
}

#[expect(clippy::indexing_slicing, reason = "run by the compiler, where a fault is an error")]
const fn first() -> [u8; BINS] {
    let starts = starts();
    let mut table = [0; BINS];
    let (mut bin, mut code) = (0, 0_u8);
    while bin < BINS {
        let from = f32::from_bits(SMALLEST.to_bits() + ((bin as u32) << BIN_SHIFT));
        while code < 255 && starts[code as usize + 1] <= from {
            code += 1;
        }
        table[bin] = code;
        bin += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exact(byte: u8) -> f64 {
        let v = f64::from(byte) / 255.0;
        if v <= 0.040_45 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) }
    }

    #[test]
    fn bytes_decode_to_the_nearest_number_and_back() {
        for byte in 0..=255 {
            let got = f64::from(decode_srgb(byte));
            assert!((got - exact(byte)).abs() <= 1.2e-7 * exact(byte), "{byte}: {got}");
            assert_eq!(encode_srgb(decode_srgb(byte)), byte);
        }
        assert_eq!([f32::NAN, -1.0, 0.0, 1e-9, 2.0, f32::INFINITY].map(encode_srgb), [0, 0, 0, 0, 255, 255]);
    }

    #[test]
    fn a_bin_holds_the_start_of_one_byte_at_most() {
        for (bin, first) in FIRST.iter().enumerate() {
            let last = f32::from_bits(SMALLEST.to_bits() + ((bin as u32 + 1) << BIN_SHIFT) - 1);
            assert!(STARTS[usize::from(*first).min(254) + 2] > last, "bin {bin}");
        }
        // Every start is the first number of its byte.
        for byte in 1..=255 {
            let start = STARTS[usize::from(byte)];
            assert_eq!([encode_srgb(start.next_down()), encode_srgb(start)], [byte - 1, byte]);
        }
    }

    proptest! {
        #[test]
        fn the_nearest_byte_is_found(x in 0.0_f64..1.1) {
            let v = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * libm::pow(x, 1.0 / 2.4) - 0.055 };
            let code = (v * 255.0).min(255.0);
            prop_assert!((f64::from(encode_srgb(x as f32)) - code).abs() <= 0.500_1);
        }

        #[test]
        fn shared_exponents_keep_a_512th_of_the_largest(r in 0.0_f32..70_000.0, g in 0.0_f32..300.0, b in 0.0_f32..1.0) {
            let got = Rgb9e5::of_linear([r, g, b]).linear();
            let largest = r.max(g).max(b).min(Rgb9e5::MAX);
            for (got, v) in got.into_iter().zip([r, g, b]) {
                prop_assert!((got - v.min(Rgb9e5::MAX)).abs() <= largest / 510.0, "{} for {}", got, v);
            }
        }
    }

    #[test]
    fn shared_exponents_take_anything() {
        assert_eq!(Rgb9e5::of_linear([f32::NAN, -1.0, 0.0]), Rgb9e5(0));
        assert_eq!(Rgb9e5::of_linear([f32::INFINITY; 3]).linear(), [Rgb9e5::MAX; 3]);
        assert_eq!(Rgb9e5::of_linear([1.0, 0.5, 0.25]).linear(), [1.0, 0.5, 0.25]);
        assert_eq!(Rgb9e5::of_linear([6e-8, 0.0, 0.0]).linear(), [5.960_464_5e-8, 0.0, 0.0]);
        // Rounds up into the next exponent.
        assert_eq!(Rgb9e5::of_linear([0.999_9, 0.0, 0.0]).linear(), [1.0, 0.0, 0.0]);
    }
}
