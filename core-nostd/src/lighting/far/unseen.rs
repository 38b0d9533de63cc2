//! What stands where nobody looked: a guess from the directions that were seen.
//!
//! The paper starts every anchor from the ambient reading and leaves it there. A room's light, though, is more like what was seen beside an unseen
//! direction than like the mean of all: so an anchor that was never seen holds the mean of those that were, each counting ((1 + cos a) / 2)^8 at an angle a
//! (half at 33 degrees), and the ambient reading as half an anchor straight ahead. What that is worth, in decibels of maps and balls, is in `isobath bench lighting`. It is still a
//! guess: it counts 1/64 beside what was seen when anchors are blended, and the first sample replaces it.
//!
//! The kernel is wide, so what was seen is first gathered in 64 cells, each with a mean direction of its own: 64 terms a guess at most instead of 1280. A
//! guess is put down only when it has moved by a sixteenth, so that maps need not follow every frame in directions that are guesses.
//!
//! Memory: 2 KiB of stack. Cost: a term a cell that was seen and direction that was not, 32 x 640 of them at most or so: 50 us on a desktop core; nothing once all are
//! seen.

use super::{FarField, difference};
use crate::ground::lanes::{LANES, Lanes, vectorised};
use crate::lighting::equirect::turns_of;
use crate::lighting::lattice::Lattice;

/// The light of directions never seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unseen {
    /// A guess from the directions that were seen.
    #[default]
    Guess,
    /// The ambient reading: the paper's form.
    Ambient,
}

/// Bands of height and sectors of longitude.
const SIDE: usize = 8;
const CELLS: usize = SIDE * SIDE;
/// What the ambient reading counts, in anchors straight ahead.
const PRIOR: f32 = 0.5;
/// A guess is put down when it differs by more than this part from what stands.
const STEP: f32 = 1.0 / 16.0;

/// What was seen, gathered: eight cells a block.
struct Cells([Block; CELLS / LANES]);

#[derive(Clone, Copy)]
struct Block {
    /// Sums of directions, in [`Cells::close`] made half a unit long.
    direction: [Lanes; 3],
    colour: [Lanes; 3],
    anchors: Lanes,
}

impl Block {
    const EMPTY: Self = Self { direction: [Lanes::ZERO; 3], colour: [Lanes::ZERO; 3], anchors: Lanes::ZERO };

    /// A cell's seven numbers.
    fn cell(&mut self, cell: usize) -> impl Iterator<Item = &mut f32> {
        let planes = self.direction.iter_mut().chain(&mut self.colour).chain([&mut self.anchors]);
        planes.filter_map(move |plane| plane.0.get_mut(cell % LANES))
    }
}

impl Cells {
    const EMPTY: Self = Self([Block::EMPTY; CELLS / LANES]);

    fn add(&mut self, [x, y, z]: [f32; 3], [r, g, b]: [f32; 3]) {
        let band = ((0.5 + 0.5 * y) * SIDE as f32) as usize;
        let sector = ((0.5 + turns_of(x, -z)) * SIDE as f32) as usize;
        let cell = band.min(SIDE - 1) * SIDE + sector.min(SIDE - 1);
        if let Some(block) = self.0.get_mut(cell / LANES) {
            block.cell(cell).zip([x, y, z, r, g, b, 1.0]).for_each(|(sum, v)| *sum += v);
        }
    }

    /// Moves the cells that hold anything to the front. The blocks that hold them.
    fn close(&mut self) -> &[Block] {
        let mut used = 0;
        for cell in 0..CELLS {
            let Some(block) = self.0.get_mut(cell / LANES) else { break };
            let mut values = [0.0; 7];
            values.iter_mut().zip(block.cell(cell)).for_each(|(to, v)| *to = core::mem::take(v));
            let [x, y, z, .., anchors] = &mut values;
            if *anchors == 0.0 {
                continue;
            }
            let norm = 0.5 * crate::ground::math::inv_sqrt_fast(*x * *x + *y * *y + *z * *z + f32::MIN_POSITIVE);
            (*x, *y, *z) = (*x * norm, *y * norm, *z * norm);
            if let Some(block) = self.0.get_mut(used / LANES) {
                block.cell(used).zip(values).for_each(|(to, v)| *to = v);
            }
            used += 1;
        }
        self.0.get(..used.div_ceil(LANES)).unwrap_or_default()
    }
}

/// The guess in a direction.
#[inline(always)]
fn guess(blocks: &[Block], [x, y, z]: [f32; 3], ambient: [f32; 3]) -> [f32; 3] {
    let mut sums = [Lanes::ZERO; 4];
    for Block { direction: [xs, ys, zs], colour: [reds, greens, blues], anchors } in blocks {
        let half = *xs * x + *ys * y + *zs * z + Lanes::splat(0.5);
        let square = half * half;
        let fourth = square * square;
        let weight = fourth * fourth;
        for (sum, part) in sums.iter_mut().zip([reds, greens, blues, anchors]) {
            *sum += weight * *part;
        }
    }
    let [red, green, blue, anchors] = sums.map(Lanes::sum);
    let norm = 1.0 / (anchors + PRIOR);
    let [r, g, b] = ambient.map(|v| v * PRIOR);
    [(red + r) * norm, (green + g) * norm, (blue + b) * norm]
}

impl<const N: usize> FarField<N> {
    /// Guesses anew what was never seen, if what was seen has changed since. Frames and maps call it; who puts single samples and reads anchors may.
    pub fn guess_unseen(&mut self) {
        if core::mem::take(&mut self.stale) && self.params.unseen == Unseen::Guess {
            self.guess_anew();
        }
    }

    /// Once in a program, however many call it: it is large.
    #[inline(never)]
    fn guess_anew(&mut self) {
        if self.weight.contains(&0.0) {
            vectorised(|| self.guess_all());
        }
    }

    #[inline(always)]
    fn guess_all(&mut self) {
        let mut cells = Cells::EMPTY;
        for ((direction, colour), weight) in Lattice::<N>::DIRECTIONS.iter().zip(&self.colour).zip(&self.weight) {
            if *weight > 0.0 {
                cells.add(*direction, *colour);
            }
        }
        let blocks = cells.close();
        let anchors = self.colour.iter_mut().zip(&self.weight).zip(&mut self.moved);
        for (direction, ((colour, weight), moved)) in Lattice::<N>::DIRECTIONS.iter().zip(anchors) {
            if *weight > 0.0 {
                continue;
            }
            let guess = guess(blocks, *direction, self.ambient);
            let step = difference(*colour, guess);
            if step > STEP {
                *colour = guess;
                *moved += step;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::units::Timestamp;
    use crate::lighting::far::FarParams;
    use glam::Vec3;
    use proptest::prelude::*;

    /// The guess by its definition, in f64.
    fn exact(far: &FarField<1280>, seen: &[bool], at: usize) -> ([f64; 3], f64) {
        let d = Lattice::<1280>::direction(at);
        let mut sum = far.ambient().map(|v| f64::from(v * PRIOR));
        let mut weights = f64::from(PRIOR);
        for (i, _) in seen.iter().enumerate().filter(|(_, seen)| **seen) {
            let half = 0.5 + 0.5 * f64::from(Lattice::<1280>::direction(i).dot(d));
            let w = half.powi(8);
            weights += w;
            for (sum, c) in sum.iter_mut().zip(far.colour(i)) {
                *sum += w * f64::from(c);
            }
        }
        (sum.map(|s| s / weights), weights)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn guesses_are_means_of_what_is_around(x in -1.0_f32..1.0, y in -1.0_f32..1.0, z in -1.0_f32..1.0, wide in -0.9_f32..0.9, slope in 0.0_f32..1.0) {
            let axis = Vec3::new(x, y, z).try_normalize().unwrap_or(Vec3::X);
            let mut far = FarField::<1280>::new(FarParams::default(), [0.3, 0.2, 0.1]);
            let mut seen = [false; 1280];
            for (i, seen) in seen.iter_mut().enumerate() {
                let d = Lattice::<1280>::direction(i);
                if d.dot(axis) > wide {
                    *seen = far.sample(d, [1.0 + slope * d.x, 1.0 + slope * d.y, 2.0], 1.0, Timestamp::ZERO);
                }
            }
            far.guess_unseen();
            for (i, seen_here) in seen.iter().enumerate() {
                let ((want, weights), got) = (exact(&far, &seen, i), far.colour(i));
                // On the other side of all that was seen, where the kernel is steep, cells make the ambient reading count a little more.
                if weights < 20.0 * f64::from(PRIOR) {
                    continue;
                }
                for (want, got) in want.iter().zip(got) {
                    // Of lights from 0 to 2. Cells' means for their anchors, and a step that is too small to be put down.
                    prop_assert!(*seen_here || (f64::from(got) - want).abs() < 0.12, "{i}: {got} for {want}");
                }
            }
        }
    }

    #[test]
    fn what_is_seen_replaces_a_guess_and_the_paper_has_none() {
        let mut far = FarField::<1280>::new(FarParams::default(), [0.1; 3]);
        far.sample(Vec3::Y, [2.0; 3], 1.0, Timestamp::ZERO);
        far.guess_unseen();
        let near = Lattice::<1280>::nearest(Vec3::new(0.3, 1.0, 0.0)).unwrap();
        assert!(far.colour(near)[0] > 1.2 && far.weight(near) == 0.0, "{:?}", far.colour(near));
        assert!(far.colour(1279)[0] < 0.11, "nothing is known of the other side: {:?}", far.colour(1279));
        far.sample(Lattice::<1280>::direction(near), [0.5; 3], 1.0, Timestamp::ZERO);
        assert_eq!(far.colour(near), [0.5; 3]);

        let mut paper = FarField::<1280>::new(FarParams { unseen: Unseen::Ambient, ..FarParams::default() }, [0.1; 3]);
        paper.sample(Vec3::Y, [2.0; 3], 1.0, Timestamp::ZERO);
        paper.guess_unseen();
        assert_eq!(paper.colour(near), [0.1; 3]);
    }

    #[test]
    fn one_colour_seen_is_that_colour_around() {
        let mut far = FarField::<1280>::new(FarParams::default(), [0.0; 3]);
        for i in 0..640 {
            far.sample(Lattice::<1280>::direction(i), [1.0; 3], 1.0, Timestamp::ZERO);
        }
        far.guess_unseen();
        for i in 640..700 {
            assert!((far.colour(i)[0] - 1.0).abs() < 0.02, "{:?}", far.colour(i));
        }
        let mut none = FarField::<0>::new(FarParams::default(), [0.0; 3]);
        none.guess_unseen();
    }
}
