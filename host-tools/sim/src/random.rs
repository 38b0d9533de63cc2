//! Random numbers by counting: a number is a function of (seed, stream, index), so that it does not depend on the order
//! in which threads ask, and is the same on every machine.
//!
//! The mixing is the finaliser of `SplitMix64` (Steele, Lea, Flood, OOPSLA 2014), once per word of the key.

/// The numbers of one stream of one seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Random {
    key: u64,
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Random {
    /// From a seed.
    pub(crate) const fn new(seed: u64) -> Self {
        Self { key: mix(seed.wrapping_add(GOLDEN)) }
    }

    /// An independent stream: one per purpose, frame, or stage.
    pub(crate) const fn stream(self, index: u64) -> Self {
        Self { key: mix(self.key ^ index.wrapping_mul(GOLDEN).wrapping_add(0x2545_f491_4f6c_dd1d)) }
    }

    /// 64 random bits.
    #[inline]
    pub(crate) const fn bits(self, index: u64) -> u64 {
        mix(self.key.wrapping_add(index.wrapping_add(1).wrapping_mul(GOLDEN)))
    }

    /// In (0, 1).
    #[inline]
    pub(crate) const fn unit(self, index: u64) -> f64 {
        // 52 bits and a half: neither 0 nor 1.
        ((self.bits(index) >> 12) as f64 + 0.5) * (1.0 / 4_503_599_627_370_496.0)
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller), in `index` of its own numbering.
    pub(crate) fn normal(self, index: u64) -> f64 {
        let radius = (-2.0 * libm::log(self.unit(2 * index))).sqrt();
        radius * libm::cos(std::f64::consts::TAU * self.unit(2 * index + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_and_independence() {
        let r = Random::new(7).stream(3);
        let n = 100_000;
        let (mut sum, mut squares, mut lagged) = (0.0, 0.0, 0.0);
        for i in 0..n {
            let v = r.normal(i);
            sum += v;
            squares += v * v;
            lagged += v * r.normal(i + 1);
        }
        let n = n as f64;
        assert!((sum / n).abs() < 0.015 && (squares / n - 1.0).abs() < 0.02 && (lagged / n).abs() < 0.015);
        assert_ne!(Random::new(1).bits(0), Random::new(2).bits(0));
        assert_ne!(r.stream(0).bits(0), r.stream(1).bits(0));
        assert!(Random::new(0).unit(0) > 0.0);
    }

    #[test]
    fn the_numbers_never_change() {
        // Computed apart, in Python.
        assert_eq!(Random::new(42).stream(1).bits(5), 0xe0fc1a21935c2747);
    }
}
