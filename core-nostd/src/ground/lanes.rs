//! Eight numbers at a time, in plain safe Rust.
//!
//! Each operation is a loop over two arrays of eight, which the compiler turns into vector instructions on every target that
//! has them, and which is correct on those that have not. For kernels whose loops the compiler does not vectorise by
//! itself (many arrays, gathered operands). Comparisons give 1 or 0, so that selecting is multiplying.

use core::ops::{Add, AddAssign, Mul, Neg, Sub};

/// Runs a kernel, compiled twice with the feature `simd`: for the target's baseline, and on x86 for AVX2, which it runs on where
/// the machine has it. The same source in the same order, nothing fused: the same bits. Without the feature, as on devices,
/// this is the call itself. What `kernel` calls must be `#[inline(always)]` to be compiled along.
#[inline(always)]
pub(crate) fn vectorised<R>(kernel: impl FnOnce() -> R) -> R {
    #[cfg(all(feature = "simd", any(target_arch = "x86", target_arch = "x86_64")))]
    if let Some(avx2) = fearless_simd::Level::new().as_avx2() {
        return fearless_simd::Simd::vectorize(avx2, kernel);
    }
    kernel()
}

/// Whether the target computes several numbers at a time. 32-bit Arm here means Cortex-M, where a loop over lanes keeps its sums in
/// memory and pays a load and a store for each: kernels take another way through the same sums there, to the same bits.
pub(crate) const VECTORS: bool = !cfg!(target_arch = "arm");

/// Numbers in a [`Lanes`].
pub(crate) const LANES: usize = 8;

/// Eight `f32`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub(crate) struct Lanes(pub(crate) [f32; LANES]);

impl Lanes {
    pub(crate) const ZERO: Self = Self([0.0; LANES]);

    #[inline(always)]
    pub(crate) const fn splat(v: f32) -> Self {
        Self([v; LANES])
    }

    /// 0, 1, 2, ... 7.
    #[inline(always)]
    pub(crate) const fn index() -> Self {
        Self([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    }

    /// Eight values from `start`; zeros where the slice ends before.
    #[inline(always)]
    pub(crate) fn load(slice: &[f32], start: usize) -> Self {
        Self(slice.get(start..).and_then(|rest| rest.first_chunk()).copied().unwrap_or([0.0; LANES]))
    }

    /// Writes eight values from `start`; nothing where the slice ends before.
    #[inline(always)]
    pub(crate) fn store(self, slice: &mut [f32], start: usize) {
        if let Some(cells) = slice.get_mut(start..).and_then(|rest| rest.first_chunk_mut()) {
            *cells = self.0;
        }
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for (a, b) in out.iter_mut().zip(other.0) {
            *a = f(*a, b);
        }
        Self(out)
    }

    #[inline(always)]
    pub(crate) fn map(self, f: impl Fn(f32) -> f32) -> Self {
        let mut out = self.0;
        for a in &mut out {
            *a = f(*a);
        }
        Self(out)
    }

    /// 1 where `self` is below `other`, else (and where either is NaN) 0.
    #[inline(always)]
    pub(crate) fn below(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { 1.0 } else { 0.0 })
    }

    /// `self` where `mask` is 1, `other` where it is 0.
    #[inline(always)]
    pub(crate) fn select(self, mask: Self, other: Self) -> Self {
        let mut out = self.0;
        for ((a, m), b) in out.iter_mut().zip(mask.0).zip(other.0) {
            *a = if m != 0.0 { *a } else { b };
        }
        Self(out)
    }

    #[inline(always)]
    pub(crate) fn recip(self) -> Self {
        self.map(|v| 1.0 / v)
    }

    /// As [`inv_sqrt`](super::math::inv_sqrt).
    #[inline(always)]
    pub(crate) fn inv_sqrt(self) -> Self {
        self.map(super::math::inv_sqrt)
    }

    /// As [`inv_sqrt_fast`](super::math::inv_sqrt_fast).
    #[inline(always)]
    pub(crate) fn inv_sqrt_fast(self) -> Self {
        self.map(super::math::inv_sqrt_fast)
    }

    /// The larger of each two.
    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    /// Whether none is 0 (of a mask: all 1).
    #[inline(always)]
    pub(crate) fn all(self) -> bool {
        self.0.iter().fold(u32::MAX, |all, v| all & v.to_bits()) != 0
    }

    /// Whether any is not 0.
    #[inline(always)]
    pub(crate) fn any(self) -> bool {
        self.0.iter().fold(0, |all, v| all | v.to_bits()) != 0
    }

    #[inline(always)]
    pub(crate) fn sum(self) -> f32 {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Mul<f32> for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: f32) -> Self {
        self.map(|a| a * other)
    }
}

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}
