//! Anchor extrapolation: light between the anchors (LitAR 4.4.2, Eq. 1).
//!
//! The paper prints `c = (2 / N) sum max(p . n, 0)^w c_j`, which gives back 1 / (w + 1) of the light: for anchors all of one colour, 0.8 % of it at w = 128. Here the
//! sum is divided by its weights, so a uniform sphere stays uniform. w is 128 for 1280 anchors and in proportion for others (a power of two, so that
//! powering is squaring), and an anchor that was never seen counts 1/64.
//!
//! | form | where | cost of a 1024 x 512 map | error |
//! |---|---|---|---|
//! | all anchors | [`FarField::sum_all`] | 1280 terms a pixel | the definition |
//! | the 32 nearest (the paper's) | [`nearest_anchors`], [`FarField::sum_listed`] | 32 terms a pixel, a table of 32 MiB | 0.14 % of the weight left out |
//! | band-limited, incremental: the one to use | [`FarMap`] | a grid of 128 x 64 where anchors changed, then 12 terms a pixel | docs of [`FarMap`] |

mod grid;
mod upsample;

use glam::Vec3;

pub use grid::{FarMap, FarMapReport};
pub(crate) use upsample::{Eight, put};

use super::FarField;
use crate::ground::math;
use crate::lighting::lattice::Lattice;

/// Of `N` anchors: how often the cosine is squared. 7 (a power of 128) for 1280, in proportion to the anchors, so that the kernel is as wide as
/// they are apart.
#[must_use]
pub const fn squarings(anchors: usize) -> u32 {
    match (anchors / 10).checked_ilog2() {
        Some(power) if power > 2 => power,
        _ => 2,
    }
}

/// max(cosine, 0) to the power 2^squarings.
#[inline(always)]
pub(crate) fn kernel(cosine: f32, squarings: u32) -> f32 {
    let mut w = if cosine > 0.0 { cosine } else { 0.0 };
    for _ in 0..squarings {
        w *= w;
    }
    w
}

/// The `K` anchors nearest to a unit direction, nearest first; of fewer than `K` anchors, the last repeats. For tables of them.
#[must_use]
pub fn nearest_anchors<const N: usize, const K: usize>(direction: Vec3) -> [u16; K] {
    let mut list = [(f32::NEG_INFINITY, 0_u16); K];
    for (i, p) in Lattice::<N>::DIRECTIONS.iter().enumerate().take(usize::from(u16::MAX)) {
        let mut next = (Vec3::from_array(*p).dot(direction), i as u16);
        if list.last().is_none_or(|last| next.0 <= last.0) {
            continue;
        }
        for place in &mut list {
            if next.0 > place.0 {
                core::mem::swap(&mut next, place);
            }
        }
    }
    list.map(|(_, i)| i)
}

impl<const N: usize> FarField<N> {
    /// The light from a unit direction (map's axes) by the sum over all anchors: the definition that other forms are measured
    /// against. Cost: 1280 terms.
    ///
    /// ```
    /// use isobath::glam::Vec3;
    /// use isobath::lighting::far::{FarField, FarParams};
    /// let far = FarField::<1280>::new(FarParams::default(), [0.25, 0.5, 1.0]);
    /// let [r, g, b] = far.sum_all(Vec3::X);
    /// assert!((r - 0.25).abs() < 1e-5 && (g - 0.5).abs() < 1e-5 && (b - 1.0).abs() < 1e-5);
    /// ```
    #[must_use]
    pub fn sum_all(&self, direction: Vec3) -> [f32; 3] {
        self.sum(direction, 0..N)
    }

    /// The same over some anchors: those of [`nearest_anchors`].
    #[must_use]
    pub fn sum_listed(&self, direction: Vec3, anchors: &[u16]) -> [f32; 3] {
        self.sum(direction, anchors.iter().copied().map(usize::from))
    }

    fn sum(&self, direction: Vec3, anchors: impl Iterator<Item = usize>) -> [f32; 3] {
        let (mut sum, mut weights) = ([0.0_f32; 3], 0.0_f32);
        for anchor in anchors {
            let w = kernel(Lattice::<N>::direction(anchor).dot(direction), squarings(N)) * self.trust(anchor);
            weights += w;
            for (sum, c) in sum.iter_mut().zip(self.colour(anchor)) {
                *sum += w * c;
            }
        }
        if weights > 0.0 { sum.map(|s| s / weights) } else { self.ambient() }
    }
}

/// The cosine below which an anchor is left out: it would count 3.5e-4 of one straight ahead (20 degrees at a power of 128).
pub(crate) fn reach(squarings: u32) -> f32 {
    math::acos(math::exp(-7.96 / (1_u32 << squarings.min(31)) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::units::Timestamp;
    use crate::lighting::far::FarParams;

    #[test]
    fn powers_follow_the_anchors() {
        assert_eq!([0, 20, 64, 320, 640, 1280, 2560].map(squarings), [2, 2, 2, 5, 6, 7, 8]);
        assert_eq!(kernel(-0.5, 7), 0.0);
        assert!((f64::from(kernel(0.97, 7)) / libm::pow(f64::from(0.97_f32), 128.0) - 1.0).abs() < 1e-5);
        assert!((reach(7).to_degrees() - 20.0).abs() < 0.3, "{}", reach(7).to_degrees());
    }

    #[test]
    fn lists_hold_the_nearest() {
        let d = crate::ground::geometry::unit(Vec3::new(0.3, -0.5, 0.9)).unwrap();
        let list = nearest_anchors::<1280, 32>(d);
        assert_eq!(usize::from(list[0]), Lattice::<1280>::nearest(d).unwrap());
        let cosine = |i: u16| Lattice::<1280>::direction(usize::from(i)).dot(d);
        assert!(list.windows(2).all(|w| cosine(w[0]) >= cosine(w[1])));
        let nearer = (0..1280).filter(|&i| cosine(i) > cosine(list[31])).count();
        assert_eq!(nearer, 31);
    }

    #[test]
    fn thirty_two_are_nearly_all() {
        let mut far = FarField::<1280>::new(FarParams::default(), [0.0; 3]);
        for i in 0..1280 {
            far.sample(Lattice::<1280>::direction(i), [(i % 7) as f32, (i % 2) as f32, 1.0], 1.0, Timestamp::ZERO);
        }
        for i in 0..200 {
            let d = Lattice::<200>::direction(i);
            let (all, some) = (far.sum_all(d), far.sum_listed(d, &nearest_anchors::<1280, 32>(d)));
            for (a, s) in all.iter().zip(some) {
                assert!((a - s).abs() < 7.0 * 0.005, "{all:?} {some:?}");
            }
            assert!((all[2] - 1.0).abs() < 1e-5);
        }
    }
}
