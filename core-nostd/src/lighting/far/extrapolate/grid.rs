//! The far field as a small map that follows changes.

use core::ops::Range;

use super::{kernel, reach, squarings};
use crate::ground::lanes::{LANES, Lanes, vectorised};
use crate::ground::math;
use crate::lighting::far::FarField;
use crate::lighting::lattice::Lattice;

/// Columns of the grid, rounded up, over which interpolation reaches.
const REACH: usize = 3;
/// Stale blocks of a row are the bits of a `u32`.
const MOST_COLUMNS: usize = 32 * LANES;

/// What an update did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FarMapReport {
    /// Anchors whose change was taken in.
    pub anchors: usize,
    /// Blocks of eight grid points that were computed anew.
    pub computed: usize,
    /// Blocks that no changed anchor reaches.
    pub skipped: usize,
}

/// Extrapolation on an equirectangular grid of `COLUMNS` x `ROWS`, from which maps of any size are interpolated.
///
/// The kernel's half width is 6 degrees, so its sum is smooth: on a grid of 2.8 degrees (128 x 64), bicubic interpolation (Catmull-Rom) gives the sum over all
/// anchors to 66 dB for anchors of independent random colours, 73 and more for scenes; 64 x 32 gives 46 and 53. Grid points are computed from the
/// anchors within 20 degrees, eight at a time, and only where an anchor changed: the grid is a function of the anchors alone, however it came about, to
/// the bit (held by a test). A uniform sphere stays uniform to 1e-6.
///
/// `COLUMNS` is a multiple of 8 up to 256; what is beyond stays black.
///
/// Memory: 12 bytes a grid point: 98 KiB for 128 x 64, 25 KiB for 64 x 32. No table but the lattice's. Cost: see `isobath bench`.
///
/// ```
/// use isobath::glam::Vec3;
/// use isobath::ground::{image::ImageViewMut, units::Timestamp};
/// use isobath::lighting::far::{FarField, FarParams, extrapolate::FarMap};
/// use isobath::lighting::lattice::Lattice;
/// let mut far = FarField::<1280>::new(FarParams::default(), [0.2; 3]);
/// let mut map = FarMap::<64, 32>::new();
/// for anchor in 0..1280 {
///     far.sample(Lattice::<1280>::direction(anchor), [0.1; 3], 1.0, Timestamp::ZERO);
/// }
/// assert_eq!(map.update(&mut far).anchors, 1280);
/// far.sample(Vec3::Y, [5.0; 3], 1.0, Timestamp::ZERO);
/// let report = map.update(&mut far);
/// assert_eq!(report.anchors, 1);
/// assert!(report.computed < report.skipped / 4);
/// let mut pixels = [[0_u8; 3]; 32 * 16];
/// map.render(&mut ImageViewMut::new(&mut pixels, 32, 16)?);
/// assert!(pixels[0] > pixels[511]);
/// # Ok::<(), isobath::ground::image::ImageError>(())
/// ```
#[derive(Debug, Clone)]
pub struct FarMap<const COLUMNS: usize = 128, const ROWS: usize = 64> {
    /// Red, green, blue.
    pub(super) planes: [[[f32; COLUMNS]; ROWS]; 3],
    /// Of the columns' longitudes, for the kernel.
    sin: [f32; COLUMNS],
    cos: [f32; COLUMNS],
    /// Sine and cosine of the blocks' middles.
    middles: [(f32, f32); MOST_COLUMNS / LANES],
    /// Blocks computed anew since [`Self::settle`], a bit each.
    fresh: [u32; ROWS],
    ready: bool,
}

impl<const COLUMNS: usize, const ROWS: usize> Default for FarMap<COLUMNS, ROWS> {
    fn default() -> Self {
        Self::new()
    }
}

/// One row's geometry.
#[derive(Clone, Copy)]
struct Row {
    sin: f32,
    cos: f32,
    /// Cosine, at a block's middle, from which on the block is in an anchor's reach.
    near: f32,
    /// Heights of the anchors that may reach it.
    heights: (f32, f32),
}

impl<const COLUMNS: usize, const ROWS: usize> FarMap<COLUMNS, ROWS> {
    /// Black until the first [`Self::update`].
    #[must_use]
    pub const fn new() -> Self {
        Self {
            planes: [[[0.0; COLUMNS]; ROWS]; 3],
            sin: [0.0; COLUMNS],
            cos: [0.0; COLUMNS],
            middles: [(0.0, 0.0); MOST_COLUMNS / LANES],
            fresh: [0; ROWS],
            ready: false,
        }
    }

    const BLOCKS: usize = if COLUMNS < MOST_COLUMNS { COLUMNS / LANES } else { MOST_COLUMNS / LANES };

    fn row(y: usize, reach: f32) -> Row {
        let polar = (y as f32 + 0.5) / ROWS as f32 * core::f32::consts::PI;
        let (sin, cos) = (math::sin(polar), math::cos(polar));
        let half_block = 0.5 * (LANES - 1) as f32 * core::f32::consts::TAU / COLUMNS as f32;
        let wide = reach + half_block * sin;
        let top = if polar > wide { math::cos(polar - wide) } else { 1.0 };
        let bottom = if polar + wide < core::f32::consts::PI { math::cos(polar + wide) } else { -1.0 };
        Row { sin, cos, near: math::cos(wide), heights: (bottom, top) }
    }

    /// The grid's row, and whether it is seen across a pole: beyond one lies the row as far from it, on the other side.
    pub(super) fn over_poles(row: isize) -> (Option<usize>, bool) {
        let rows = ROWS as isize;
        let (row, across) = match row {
            r if r < 0 => (-1 - r, true),
            r if r >= rows => (2 * rows - 1 - r, true),
            r => (r, false),
        };
        (usize::try_from(row).ok(), across)
    }

    /// Which blocks of a row an anchor reaches, a bit each.
    fn blocks(&self, row: &Row, [x, y, z]: [f32; 3]) -> u32 {
        let (a, s, c) = (y * row.cos, x * row.sin, -z * row.sin);
        let mut bits = 0;
        for (block, (sin, cos)) in self.middles.iter().enumerate().take(Self::BLOCKS) {
            bits |= u32::from(a + s * sin + c * cos >= row.near) << block;
        }
        bits
    }

    /// Takes in the anchors that changed, guesses of what was never seen included.
    pub fn update<const N: usize>(&mut self, far: &mut FarField<N>) -> FarMapReport {
        let power = squarings(N);
        let reach = reach(power);
        let first = !self.ready;
        if first {
            self.ready = true;
            for (u, (sin, cos)) in self.sin.iter_mut().zip(&mut self.cos).enumerate() {
                let lon = core::f32::consts::TAU * ((u as f32 + 0.5) / COLUMNS as f32 - 0.5);
                (*sin, *cos) = (math::sin(lon), math::cos(lon));
            }
            for (block, middle) in self.middles.iter_mut().enumerate() {
                let lon = core::f32::consts::TAU * (((block * LANES + LANES / 2) as f32) / COLUMNS as f32 - 0.5);
                *middle = (math::sin(lon), math::cos(lon));
            }
        }
        far.guess_unseen();
        let mut report = FarMapReport::default();
        let all = if Self::BLOCKS == 32 { u32::MAX } else { (1 << Self::BLOCKS) - 1 };
        let rows: [Row; ROWS] = core::array::from_fn(|y| Self::row(y, reach));
        let mut stale = [if first { all } else { 0 }; ROWS];
        far.take_changed(|anchor| {
            report.anchors += 1;
            if first {
                return;
            }
            let direction = Lattice::<N>::direction(anchor).to_array();
            for (row, stale) in rows.iter().zip(&mut stale) {
                if *stale != all && direction[1] >= row.heights.0 && direction[1] <= row.heights.1 {
                    *stale |= self.blocks(row, direction);
                }
            }
        });
        for (fresh, stale) in self.fresh.iter_mut().zip(&stale) {
            *fresh |= *stale;
        }
        for (y, (&stale, row)) in stale.iter().zip(&rows).enumerate() {
            report.computed += stale.count_ones() as usize;
            report.skipped += Self::BLOCKS - stale.count_ones() as usize;
            if stale != 0 {
                vectorised(|| self.compute(far, y, stale, row));
            }
        }
        report
    }

    /// All that was computed is drawn: [`changed_columns`](super::super::super::compose::compose_changes) are none until the next update.
    pub fn settle(&mut self) {
        self.fresh = [0; ROWS];
    }

    /// Runs of columns of a map row that may have changed since [`Self::settle`].
    pub(crate) fn changed_columns(
        &self,
        y: usize,
        (width, height): (usize, usize),
        mut tell: impl FnMut(Range<usize>),
    ) {
        // Four grid rows are blended, those around the row's middle.
        let first = (y as f32 + 0.5) / height.max(1) as f32 * ROWS as f32 - 1.5;
        let half = (Self::BLOCKS / 2) as u32;
        let all = if Self::BLOCKS == 32 { u64::from(u32::MAX) } else { (1 << Self::BLOCKS) - 1 };
        let mut fresh = 0_u64;
        for k in 0..4 {
            let (row, across) = Self::over_poles(math::floor(first) as isize + k);
            let bits = u64::from(row.and_then(|r| self.fresh.get(r)).copied().unwrap_or_default());
            // Half a block more when blocks are odd in number: both that it falls on.
            let turned = (bits << half | bits >> (Self::BLOCKS as u32 - half)) & all;
            let again = if Self::BLOCKS % 2 == 1 { (turned << 1 | turned >> (Self::BLOCKS - 1)) & all } else { turned };
            fresh |= if across { turned | again } else { bits };
        }
        // A column of the grid is felt two and a half columns away, around the seam too.
        // Where the map is narrower than the grid, a pixel may end one run and begin the next: it is told once.
        let mut told = 0;
        let mut tell = |run: Range<usize>| {
            let from = (run.start * width / COLUMNS.max(1)).max(told);
            told = (run.end * width).div_ceil(COLUMNS.max(1)).max(from);
            tell(from..told);
        };
        let last = Self::BLOCKS.saturating_sub(1);
        let mut held = if fresh >> last & 1 == 1 { 0..REACH } else { 0..0 };
        let mut add = |from: usize, to: usize| {
            if from <= held.end {
                held.end = held.end.max(to);
            } else {
                let run = core::mem::replace(&mut held, from..to);
                if !run.is_empty() {
                    tell(run);
                }
            }
        };
        let mut block = 0;
        while block < Self::BLOCKS {
            let run = (fresh >> block).trailing_ones() as usize;
            if run > 0 {
                add((block * LANES).saturating_sub(REACH), ((block + run) * LANES + REACH).min(COLUMNS));
            }
            block += run.max(1);
        }
        if fresh & 1 == 1 {
            add(COLUMNS.saturating_sub(REACH), COLUMNS);
        }
        if !held.is_empty() {
            tell(held);
        }
    }

    /// Some blocks of a row, from the anchors around.
    #[inline(always)]
    fn compute<const N: usize>(&mut self, far: &FarField<N>, y: usize, stale: u32, row: &Row) {
        let power = squarings(N);
        // As wide as the grid and not as the widest: stack.
        let (mut reds, mut greens, mut blues) = ([0.0; COLUMNS], [0.0; COLUMNS], [0.0; COLUMNS]);
        let mut totals = [0.0; COLUMNS];
        // Anchors lie in order of height.
        let index = |height: f32| (1.0 - height) * 0.5 * N as f32 - 0.5;
        let (from, to) = (index(row.heights.1) as usize, (index(row.heights.0) as usize).saturating_add(2).min(N));
        for anchor in from..to {
            let direction = Lattice::<N>::direction(anchor).to_array();
            let mut hit = self.blocks(row, direction) & stale;
            if hit == 0 {
                continue;
            }
            let [x, y, z] = direction;
            let (a, s, c) = (Lanes::splat(y * row.cos), x * row.sin, -z * row.sin);
            let trust = far.trust(anchor);
            let [red, green, blue] = far.colour(anchor).map(|v| v * trust);
            while hit != 0 {
                let block = hit.trailing_zeros() as usize;
                hit &= hit - 1;
                let at = block * LANES;
                let (sin, cos) = (Lanes::load(&self.sin, at), Lanes::load(&self.cos, at));
                let w = (a + sin * s + cos * c).map(|d| kernel(d, power));
                (Lanes::load(&reds, at) + w * red).store(&mut reds, at);
                (Lanes::load(&greens, at) + w * green).store(&mut greens, at);
                (Lanes::load(&blues, at) + w * blue).store(&mut blues, at);
                (Lanes::load(&totals, at) + w * trust).store(&mut totals, at);
            }
        }
        let [red, green, blue] = &mut self.planes;
        let (Some(red), Some(green), Some(blue)) = (red.get_mut(y), green.get_mut(y), blue.get_mut(y)) else { return };
        for block in (0..Self::BLOCKS).filter(|block| stale >> block & 1 == 1) {
            let total = Lanes::load(&totals, block * LANES);
            let norm = total.map(|t| if t > 0.0 { 1.0 / t } else { 0.0 });
            let planes = [(&mut *red, &reds), (&mut *green, &greens), (&mut *blue, &blues)];
            for ((plane, sums), ambient) in planes.into_iter().zip(far.ambient()) {
                // Fewer anchors than reach each other leave gaps: ambient light there.
                let lit = (Lanes::load(sums, block * LANES) * norm).select(total, Lanes::splat(ambient));
                lit.store(plane, block * LANES);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::units::Timestamp;
    use crate::lighting::equirect::direction_of_pixel;
    use crate::lighting::far::FarParams;
    use glam::Vec3;
    use proptest::prelude::*;
    use std::boxed::Box;

    fn random_sphere(seed: u32) -> FarField<1280> {
        let mut far = FarField::<1280>::new(FarParams { threshold: 0.0, ..FarParams::default() }, [0.1; 3]);
        let mut state = seed;
        for i in 0..1280 {
            let mut next = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / 16_777_216.0
            };
            let colour = [next(), next(), next()];
            far.sample(Lattice::<1280>::direction(i), colour, 1.0, Timestamp::ZERO);
        }
        far
    }

    #[test]
    fn the_grid_is_the_sum_over_all_anchors() {
        let mut far = random_sphere(3);
        let mut map = Box::new(FarMap::<128, 64>::new());
        map.update(&mut far);
        let mut worst = 0.0_f32;
        for y in 0..64 {
            for x in 0..128 {
                let exact = far.sum_all(direction_of_pixel(x, y, (128, 64)));
                for (plane, exact) in map.planes.iter().zip(exact) {
                    worst = worst.max((plane[y][x] - exact).abs());
                }
            }
        }
        assert!(worst < 7e-4, "{worst}");
    }

    #[test]
    fn a_uniform_sphere_stays_uniform_and_few_anchors_leave_ambient() {
        let mut far = FarField::<1280>::new(FarParams::default(), [0.3, 0.6, 0.9]);
        let mut map = Box::new(FarMap::<128, 64>::new());
        map.update(&mut far);
        for (plane, exact) in map.planes.iter().zip([0.3_f32, 0.6, 0.9]) {
            assert!(plane.iter().flatten().all(|v| (v - exact).abs() < 1e-6));
        }
        let mut far = FarField::<1>::new(FarParams::default(), [0.5; 3]);
        far.sample(Vec3::X, [1.0; 3], 1.0, Timestamp::ZERO);
        let mut map = Box::new(FarMap::<32, 16>::new());
        map.update(&mut far);
        assert!(map.planes.iter().flatten().flatten().all(|v| *v == 0.5 || (*v - 1.0).abs() < 1e-6));
        let mut none = FarField::<0>::new(FarParams::default(), [0.5; 3]);
        map.update(&mut none);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn following_changes_gives_what_starting_anew_gives(seed in any::<u32>(), changes in prop::collection::vec((0_usize..1280, 0.0_f32..50.0), 1..40)) {
            let mut far = random_sphere(seed);
            let mut followed = Box::new(FarMap::<64, 32>::new());
            followed.update(&mut far);
            for (anchor, light) in changes {
                far.sample(Lattice::<1280>::direction(anchor), [light, 1.0, 0.0], 3.0, Timestamp::ZERO);
                let report = followed.update(&mut far);
                prop_assert!(report.computed + report.skipped == 8 * 32 && report.skipped > 0);
            }
            let mut anew = Box::new(FarMap::<64, 32>::new());
            anew.update(&mut far);
            prop_assert!(anew.planes == followed.planes);
        }
    }
}
