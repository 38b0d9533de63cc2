//! The Fibonacci lattice: N directions, spread evenly over the sphere, and which of them is nearest.
//!
//! Anchor i is at height y = 1 - (2 i + 1) / N and longitude 2 pi frac(i / golden ratio), so anchors lie in order of height and two
//! that are neighbours on the sphere differ by a Fibonacci number. The half step keeps them off the poles (with 2 i / (N - 1) two sit on the poles, where
//! the sum of kernels is 10 % too high). Mean spacing: sqrt(4 pi / N), 5.7 degrees at 1280.
//!
//! *Nearest*: from a guess (closed form: Keinert et al. 2015, "Spherical Fibonacci Mapping", reduced to the row of the
//! direction's height) walk to the nearest neighbour until none is nearer. On a Delaunay triangulation such a walk ends at the nearest point of all (Bose
//! and Morin 2004), and the differences tried contain the triangulation's edges: equal to a search of all anchors, held by a test for many N.
//!
//! Memory: 12 N bytes of constants, made by the compiler (15,360 for 1280). Cost: about 25 dot products a step, two or three steps.

use glam::Vec3;

use super::equirect::turns_of;
use crate::ground::math;

/// `N` even directions.
#[derive(Debug, Clone, Copy)]
pub struct Lattice<const N: usize>;

/// 2^32 / golden ratio: what one anchor is turned on from the one before, in 2^-32 turns.
const GOLDEN: u32 = 2_654_435_769;

/// Differences of neighbours: Fibonacci numbers, enough for a million anchors.
const STEPS: [usize; 16] = [1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233, 377, 610, 987, 1597];
/// Around the poles neighbours differ by other numbers too; so many anchors there are all tried.
const POLAR: usize = 16;

impl<const N: usize> Lattice<N> {
    /// Unit vectors, y from 1 down to -1.
    pub const DIRECTIONS: [[f32; 3]; N] = directions();

    /// The direction of an anchor; straight up beyond the last.
    #[inline]
    #[must_use]
    pub fn direction(anchor: usize) -> Vec3 {
        const { &Self::DIRECTIONS }.get(anchor).copied().map_or(Vec3::Y, Vec3::from_array)
    }

    /// The anchor nearest to a direction (of any length); the lower of two as near. `None` without anchors, and for a direction that is zero
    /// or not finite.
    ///
    /// ```
    /// use isobath::glam::vec3;
    /// use isobath::lighting::lattice::Lattice;
    /// let anchor = Lattice::<1280>::nearest(vec3(0.0, 2.0, 0.1)).unwrap();
    /// assert!(Lattice::<1280>::direction(anchor).angle_between(vec3(0.0, 2.0, 0.1)) < 0.07);
    /// ```
    #[must_use]
    pub fn nearest(direction: Vec3) -> Option<usize> {
        let direction = crate::ground::geometry::unit(direction)?;
        Self::nearest_from(direction, Self::guess(direction))
    }

    /// As [`Self::nearest`] of a unit vector, when it is known to be near an anchor: that of the pixel beside.
    #[must_use]
    pub fn nearest_from(direction: Vec3, anchor: usize) -> Option<usize> {
        let table = const { &Self::DIRECTIONS };
        let d = direction.to_array();
        let cosine = |i: usize| {
            let [x, y, z] = table.get(i).copied().unwrap_or([f32::NAN; 3]);
            x * d[0] + y * d[1] + z * d[2]
        };
        let mut best = (cosine(anchor.min(N.checked_sub(1)?)), anchor.min(N - 1));
        if !best.0.is_finite() {
            return None;
        }
        let nearer = |best: (f32, usize), i: usize| {
            let c = cosine(i);
            if c > best.0 || (c == best.0 && i < best.1) { (c, i) } else { best }
        };
        // The differences of the nearest neighbours at the direction's height are tried alone until they lead no further, then all neighbours' where that is.
        let few = Self::close_steps(direction.y).get(1..4).unwrap_or_default();
        let mut steps = few;
        // A walk gets nearer with every step, and stands still twice at most: it can't come to an anchor again.
        for _ in 0..2 * N {
            let from = best.1;
            for step in steps {
                best = nearer(nearer(best, from.wrapping_sub(*step)), from + step);
            }
            if best.1 != from {
                steps = few;
                continue;
            }
            if steps.len() == few.len() {
                steps = Self::close_steps(table.get(from).map_or(0.0, |[_, y, _]| *y));
                continue;
            }
            if from < POLAR {
                best = (0..POLAR).fold(best, nearer);
            }
            if from + POLAR >= N {
                best = (N.saturating_sub(POLAR)..N).fold(best, nearer);
            }
            if best.1 == from {
                break;
            }
            steps = few;
        }
        Some(best.1)
    }

    /// Differences of neighbours at a height: five Fibonacci numbers around sqrt(pi N (1 - y^2) / sqrt(5)), at which the distance of two anchors so many
    /// apart is least (Swinbank and Purser 2006).
    #[inline(always)]
    fn close_steps(y: f32) -> &'static [usize] {
        let square = 1.405 * N as f32 * (1.0 - y * y);
        // F(k + 1) F(k): where one number is as good as the next.
        let k = STEPS.windows(2).take_while(|pair| matches!(pair, [a, b] if ((a * b) as f32) < square)).count();
        let first = k.saturating_sub(2).min(STEPS.len() - 5);
        STEPS.get(first..first + 5).unwrap_or(&STEPS)
    }

    /// An anchor near a unit vector: of those at about its height, one at about its longitude.
    fn guess(direction: Vec3) -> usize {
        let n = N as f32;
        let row = (1.0 - direction.y) * 0.5 * n - 0.5;
        // In 2^-32 turns, which wrap by themselves.
        let turns = (turns_of(direction.x, -direction.z) * 4_294_967_296.0) as i64 as u32;
        // Anchors i and i + F are F / golden ratio turns apart: nearly none where F is a Fibonacci number. The best of the few rows
        // around is within a few steps.
        let mut best = (u32::MAX, 0);
        for k in -8..=8 {
            let i = math::clamp(row + k as f32 + 0.5, 0.0, n - 1.0) as usize;
            let off = turns.wrapping_sub((i as u32).wrapping_mul(GOLDEN)) as i32;
            if off.unsigned_abs() < best.0 {
                best = (off.unsigned_abs(), i);
            }
        }
        best.1
    }
}

/// The lattice's directions, for the compiler: longitudes by turning a pair (cosine, sine) on by the golden angle.
#[expect(clippy::indexing_slicing, reason = "run by the compiler, where a fault is an error")]
const fn directions<const N: usize>() -> [[f32; 3]; N] {
    const COS: f64 = -0.737_368_878_078_319_9;
    const SIN: f64 = -0.675_490_294_261_523_6;
    let mut table = [[0.0; 3]; N];
    let (mut c, mut s) = (1.0, 0.0);
    let mut i = 0;
    while i < N {
        let y = 1.0 - (2 * i + 1) as f64 / N as f64;
        let r = square_root(1.0 - y * y);
        table[i] = [(r * s) as f32, y as f32, (-r * c) as f32];
        (c, s) = (c * COS - s * SIN, s * COS + c * SIN);
        i += 1;
    }
    table
}

/// Square root of 0 to 1, for the compiler: Newton's steps from above.
const fn square_root(x: f64) -> f64 {
    let mut root = 1.0;
    let mut i = 0;
    while i < 40 {
        root = 0.5 * (root + x / root);
        i += 1;
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn brute<const N: usize>(d: Vec3) -> Option<usize> {
        let cosines: Vec<f32> = Lattice::<N>::DIRECTIONS.iter().map(|p| p[0] * d.x + p[1] * d.y + p[2] * d.z).collect();
        let best = cosines.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        cosines.iter().position(|&c| c == best)
    }

    fn same_as_a_search<const N: usize>(d: Vec3, from: usize) {
        let d = d.try_normalize().unwrap();
        assert_eq!(Lattice::<N>::nearest_from(d, from), brute::<N>(d), "of {N} near {d}, from {from}");
        let unit = crate::ground::geometry::unit(d).unwrap();
        assert_eq!(Lattice::<N>::nearest(d), brute::<N>(unit), "of {N} near {d}");
    }

    #[test]
    fn a_thousand_and_more_directions_of_every_lattice() {
        // Another spiral, much finer: all over the sphere, poles included.
        for &[x, y, z] in &Lattice::<20_011>::DIRECTIONS {
            let d = Vec3::new(x, y, z);
            let from = ((y * 7777.7).abs() as usize) % 1280;
            same_as_a_search::<1280>(d, from);
            if (x * 1000.0) as i32 % 7 == 0 {
                same_as_a_search::<1>(d, from);
                same_as_a_search::<2>(d, from);
                same_as_a_search::<7>(d, from);
                same_as_a_search::<30>(d, from);
                same_as_a_search::<64>(d, from);
                same_as_a_search::<321>(d, from);
                same_as_a_search::<5120>(d, from);
            }
        }
        assert_eq!(Lattice::<0>::nearest(Vec3::X), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]
        #[test]
        fn nearest_is_that_of_a_search(x in -1.0_f32..1.0, y in -1.0_f32..1.0, z in -1.0_f32..1.0, from in 0_usize..1280) {
            prop_assume!(Vec3::new(x, y, z).length() > 0.01);
            same_as_a_search::<1280>(Vec3::new(x, y, z), from);
            // And close to a pole.
            same_as_a_search::<1280>(Vec3::new(x * 0.1, y.signum(), z * 0.1), from);
        }
    }

    #[test]
    fn directions_are_even_and_unit() {
        let all = &Lattice::<1280>::DIRECTIONS;
        let mut sum = Vec3::ZERO;
        for (i, d) in all.iter().enumerate() {
            let turns = i as f64 * 0.618_033_988_749_894_8;
            let (y, a) = (1.0 - (2 * i + 1) as f64 / 1280.0, core::f64::consts::TAU * (turns - libm::floor(turns)));
            let r = libm::sqrt(1.0 - y * y);
            for (got, exact) in d.iter().zip([r * libm::sin(a), y, -r * libm::cos(a)]) {
                assert!((f64::from(*got) - exact).abs() < 7e-8);
            }
            sum += Vec3::from_array(*d);
        }
        assert!(sum.length() < 0.1 * 1280.0 / 100.0, "{sum}");
    }

    #[test]
    fn what_is_no_direction_has_no_anchor() {
        for d in [Vec3::ZERO, Vec3::NAN, Vec3::new(f32::INFINITY, 0.0, 0.0)] {
            assert_eq!(Lattice::<1280>::nearest(d), None);
            assert_eq!(Lattice::<1280>::nearest_from(d * f32::NAN, 3), None);
        }
    }
}
