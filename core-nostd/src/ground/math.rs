//! The math façade: every function that `core` lacks, in one place.
//!
//! `libm` on every target, the host included, so that a host test tests what the device computes, bit for bit (no fused
//! multiply-add is ever introduced behind our back). Accuracy of the functions here: at most 1.1 ulp (CRAFT measurements).
//!
//! Pixel loops do not call [`sqrt`]: an out-of-line call stops the compiler from vectorising. They use [`inv_sqrt`], which
//! is plain arithmetic that vectorises on every target.

/// Square root; NaN for negative input. Correctly rounded.
#[inline]
#[must_use]
pub fn sqrt(x: f32) -> f32 {
    libm::sqrtf(x)
}

/// Square root in double precision.
#[inline]
#[must_use]
pub fn sqrt_f64(x: f64) -> f64 {
    libm::sqrt(x)
}

/// `1 / sqrt(x)` by the bit-shift estimate and three Newton steps: at most 3 ulp for normal positive `x`.
///
/// NaN in gives NaN out; zero, infinite and negative input give a meaningless (but defined) number: guard before the call.
#[inline(always)]
#[must_use]
pub fn inv_sqrt(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5f37_5a86_u32.wrapping_sub(x.to_bits() >> 1));
    y *= 1.5 - half * y * y;
    y *= 1.5 - half * y * y;
    // The last step in residual form, so that rounding of the large terms cancels.
    y + y * (0.5 - half * y * y)
}

/// `1 / sqrt(x)` to 8e-7 relative, in two steps: the first with constants tuned for the least error (Moroz et al. 2018,
/// "Fast calculation of inverse square root with the use of magic constant"), the second Newton's. For directions, whose
/// length may be off in the seventh digit; else [`inv_sqrt`], whose limits it shares.
#[inline(always)]
#[must_use]
pub fn inv_sqrt_fast(x: f32) -> f32 {
    let y = f32::from_bits(0x5f1f_fff9_u32.wrapping_sub(x.to_bits() >> 1));
    let y = y * (0.703_952_25 * (2.389_244_6 - x * y * y));
    y + y * (0.5 - 0.5 * x * y * y)
}

/// Sine of an angle in radians.
#[inline]
#[must_use]
pub fn sin(x: f32) -> f32 {
    libm::sinf(x)
}

/// Cosine of an angle in radians.
#[inline]
#[must_use]
pub fn cos(x: f32) -> f32 {
    libm::cosf(x)
}

/// Tangent of an angle in radians.
#[inline]
#[must_use]
pub fn tan(x: f32) -> f32 {
    libm::tanf(x)
}

/// Angle of the vector (x, y) in radians, in (-π, π].
#[inline]
#[must_use]
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// Arc cosine in radians; the argument is clamped to [-1, 1], so a dot product of unit vectors can't give NaN.
#[inline]
#[must_use]
pub fn acos(x: f32) -> f32 {
    libm::acosf(x.clamp(-1.0, 1.0))
}

/// `x` held between two bounds; NaN stays NaN. When the bounds cross it is the lower one: `f32::clamp` panics there, and
/// where the compiler can't see that they don't cross, it links that panic.
#[inline(always)]
#[must_use]
pub const fn clamp(x: f32, low: f32, high: f32) -> f32 {
    if x < low || high < low {
        low
    } else if x > high {
        high
    } else {
        x
    }
}

/// The larger of two; `b` when one is NaN. A comparison, where `f32::max` is a call on targets without an instruction for it.
#[inline(always)]
#[must_use]
pub const fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller of two; `b` when one is NaN. As [`max`].
#[inline(always)]
#[must_use]
pub const fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// e to the power `x`.
#[inline]
#[must_use]
pub fn exp(x: f32) -> f32 {
    libm::expf(x)
}

/// e to the power `x`, less 1: keeps its digits where `exp(x) - 1` cancels.
#[inline]
#[must_use]
pub fn exp_m1(x: f32) -> f32 {
    libm::expm1f(x)
}

/// Largest integer not above `x`.
#[inline]
#[must_use]
pub fn floor(x: f32) -> f32 {
    libm::floorf(x)
}

/// Smallest integer not below `x`.
#[inline]
#[must_use]
pub fn ceil(x: f32) -> f32 {
    libm::ceilf(x)
}

/// Nearest integer, halves away from zero.
#[inline]
#[must_use]
pub fn round(x: f32) -> f32 {
    libm::roundf(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clamp_takes_any_bounds() {
        assert_eq!([-1.0, 0.5, 2.0, f32::INFINITY].map(|x| clamp(x, 0.0, 1.0)), [0.0, 0.5, 1.0, 1.0]);
        assert!(clamp(f32::NAN, 0.0, 1.0).is_nan());
        assert_eq!(clamp(0.5, 1.0, 0.0), 1.0);
        assert_eq!(clamp(0.5, f32::NAN, f32::NAN), 0.5);
    }

    #[test]
    fn inv_sqrt_is_within_three_ulp_of_the_f64_value() {
        let mut worst = 0.0_f64;
        // Every 97th normal positive f32 bit pattern: all exponents, all mantissa regions.
        for bits in (0x0080_0000_u32..0x7f80_0000).step_by(97) {
            let x = f32::from_bits(bits);
            let exact = 1.0 / f64::from(x).sqrt();
            let ulp = exact * f64::from(f32::EPSILON);
            worst = worst.max(((f64::from(inv_sqrt(x)) - exact) / ulp).abs());
        }
        assert!(worst <= 3.0, "worst error {worst} ulp");
    }

    #[test]
    fn fast_inv_sqrt_is_within_its_bound() {
        let mut worst = 0.0_f64;
        for bits in (0x0080_0000_u32..0x7f80_0000).step_by(97) {
            let x = f32::from_bits(bits);
            worst = worst.max((f64::from(inv_sqrt_fast(x)) * f64::from(x).sqrt() - 1.0).abs());
        }
        assert!(worst <= 8e-7, "worst relative error {worst:e}");
    }

    #[test]
    fn acos_of_rounded_unit_dot_products_is_a_number() {
        assert_eq!(acos(1.000_000_1), 0.0);
        assert!((acos(-1.000_000_1) - core::f32::consts::PI).abs() < 1e-6);
        assert!(acos(f32::NAN).is_nan());
    }
}
