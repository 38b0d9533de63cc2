//! The far field: light from every direction, as colours of anchors on the unit sphere (LitAR 4.2.2, "unit-sphere point cloud").
//!
//! What the camera sees away from the object needs no geometry: a frame of 32 x 24 colours, turned by the camera's rotation, is put onto the
//! nearest of `N` anchors ([`Lattice`]). An anchor holds the running mean of its samples, whose weight is capped and fades with age, so that a change in the scene
//! wins; until it is seen it holds a guess from what was seen around it. Two things are better than printed: a sample whose depth is known is put where it
//! is seen from the map's place, not where the camera sees it (parallax), and directions that were seen count 64 times those that were
//! not when anchors are blended, so that guesses don't bleed into what is known.
//!
//! | file | idea |
//! |---|---|
//! | here | the anchors' state, and one sample |
//! | [`observe`] | a frame's samples |
//! | [`unseen`] | what stands where nobody looked |
//! | [`extrapolate`] | colours between anchors: exact sums, and a map that follows changes |
//! | [`harmonics`] | the same light as nine coefficients, a main direction, an ambient |
//!
//! Memory: 24 bytes an anchor, 30,760 for 1280; the lattice's table is 15,360 bytes of constants. Cost: about 30 ns a sample.

pub mod extrapolate;
pub mod harmonics;
pub mod observe;
pub mod unseen;

pub use unseen::Unseen;

use super::lattice::Lattice;
use crate::ground::math;
use crate::ground::units::Timestamp;

/// How anchors remember. `FarParams::default()` follows a scene within a second or two and averages some five frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FarParams {
    /// Largest weight of what an anchor knows, in samples; the next sample moves it by one part of so many. At least 1. Default 32.
    pub cap: f32,
    /// Seconds in which the weight of what is known halves; infinite: never. Above 0. Default 10.
    pub half_life: f32,
    /// An anchor is *changed* when its colour moved by this part of itself since a map last took it. 0 or more. Default 1/256.
    pub threshold: f32,
    /// What stands where nobody looked. Default [`Unseen::Guess`].
    pub unseen: Unseen,
}

impl FarParams {
    /// As [`Self::default`].
    pub const DEFAULT: Self = Self { cap: 32.0, half_life: 10.0, threshold: 1.0 / 256.0, unseen: Unseen::Guess };
}

impl Default for FarParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl FarParams {
    /// Each at its nearest bound.
    const fn in_range(self) -> Self {
        Self {
            cap: math::clamp(self.cap, 1.0, 1e6),
            half_life: if self.half_life > 0.001 { self.half_life } else { 0.001 },
            threshold: if self.threshold > 0.0 { self.threshold } else { 0.0 },
            unseen: self.unseen,
        }
    }
}

/// What came of some samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FarReport {
    /// Samples put onto anchors.
    pub samples: usize,
    /// Samples without a finite colour of 0 or more (above 1e6 it is taken for 1e6), or without a direction.
    pub rejected: usize,
    /// Anchors that became [changed](FarParams::threshold) by them.
    pub changed: usize,
}

/// `N` anchors and their colours.
///
/// ```
/// use isobath::ground::units::Timestamp;
/// use isobath::glam::Vec3;
/// use isobath::lighting::far::{FarField, FarParams};
/// let mut far = FarField::<1280>::new(FarParams::default(), [0.2, 0.2, 0.2]);
/// assert!(far.sample(Vec3::Y, [1.0, 0.9, 0.8], 1.0, Timestamp::ZERO));
/// assert_eq!(far.colour(0), [1.0, 0.9, 0.8]); // anchor 0 is the highest
/// assert_eq!(far.seen(), 1);
/// assert!(size_of_val(&far) <= 32 * 1024);
/// ```
#[derive(Debug, Clone)]
pub struct FarField<const N: usize = 1280> {
    params: FarParams,
    ambient: [f32; 3],
    /// Time of the first sample, from which anchors count.
    epoch: Option<Timestamp>,
    colour: [[f32; 3]; N],
    /// Samples, 0 before the first.
    weight: [f32; N],
    /// Milliseconds from the epoch to the last sample.
    last: [u32; N],
    /// How far the colour moved since a map took it, as a part of itself.
    moved: [f32; N],
    /// What was seen has changed since guesses were made.
    stale: bool,
}

/// Added to a colour's size before changes are compared with it: changes of what is all but black aren't seen.
const DARK: f32 = 0.02;
/// What a direction that was never seen counts beside one that was.
pub(crate) const UNSEEN: f32 = 1.0 / 64.0;

impl<const N: usize> FarField<N> {
    /// No anchor seen: all hold the ambient light (linear; negative and what is not finite are 0). Parameters out of range take their
    /// nearest bound.
    #[must_use]
    pub const fn new(params: FarParams, ambient: [f32; 3]) -> Self {
        let [r, g, b] = ambient;
        let ambient = [light(r), light(g), light(b)];
        Self {
            params: params.in_range(),
            ambient,
            epoch: None,
            colour: [ambient; N],
            weight: [0.0; N],
            last: [0; N],
            moved: [f32::INFINITY; N],
            stale: false,
        }
    }

    /// Zero from end to end, for a `static` that is to lie in `.bss`: [`Self::new`] there would keep 30 KiB of flash for its first values. It remembers
    /// nothing until [`Self::restart`].
    pub const ZERO: Self = Self {
        params: FarParams { cap: 0.0, half_life: 0.0, threshold: 0.0, unseen: Unseen::Ambient },
        ambient: [0.0; 3],
        epoch: None,
        colour: [[0.0; 3]; N],
        weight: [0.0; N],
        last: [0; N],
        moved: [0.0; N],
        stale: false,
    };

    /// Forgets everything: from here on as [`Self::new`], in place.
    ///
    /// ```
    /// use isobath::glam::Vec3;
    /// use isobath::ground::units::Timestamp;
    /// use isobath::lighting::far::{FarField, FarParams};
    /// let mut far = FarField::<1280>::ZERO;
    /// far.restart(FarParams::default(), [0.2; 3]);
    /// far.sample(Vec3::Y, [9.0; 3], 1.0, Timestamp::ZERO);
    /// far.restart(FarParams::default(), [0.3; 3]);
    /// assert_eq!((far.seen(), far.colour(0)), (0, [0.3; 3]));
    /// ```
    pub fn restart(&mut self, params: FarParams, ambient: [f32; 3]) {
        self.params = params.in_range();
        self.ambient = ambient.map(light);
        self.epoch = None;
        self.colour.fill(self.ambient);
        self.weight.fill(0.0);
        self.last.fill(0);
        self.moved.fill(f32::INFINITY);
        self.stale = false;
    }

    /// A new reading of the ambient light: anchors never seen take it, or guesses heed it.
    pub fn set_ambient(&mut self, ambient: [f32; 3]) {
        self.ambient = ambient.map(light);
        if self.params.unseen == Unseen::Guess && self.epoch.is_some() {
            self.stale = true;
            return;
        }
        for ((colour, weight), moved) in self.colour.iter_mut().zip(&self.weight).zip(&mut self.moved) {
            if *weight == 0.0 {
                *moved += difference(*colour, self.ambient);
                *colour = self.ambient;
            }
        }
    }

    /// The reading of the ambient light.
    #[must_use]
    pub const fn ambient(&self) -> [f32; 3] {
        self.ambient
    }

    /// An anchor's colour; ambient beyond the last.
    #[inline]
    #[must_use]
    pub fn colour(&self, anchor: usize) -> [f32; 3] {
        self.colour.get(anchor).copied().unwrap_or(self.ambient)
    }

    /// Samples that an anchor's colour is worth, up to the cap; 0: never seen.
    #[inline]
    #[must_use]
    pub fn weight(&self, anchor: usize) -> f32 {
        self.weight.get(anchor).copied().unwrap_or_default()
    }

    /// Anchors that were seen.
    #[must_use]
    pub fn seen(&self) -> usize {
        self.weight.iter().filter(|w| **w > 0.0).count()
    }

    /// When an anchor was last seen.
    #[must_use]
    pub fn last_seen(&self, anchor: usize) -> Option<Timestamp> {
        let ms = *self.last.get(anchor).filter(|_| self.weight(anchor) > 0.0)?;
        Some(self.epoch?.saturating_add_nanos(i64::from(ms) * 1_000_000))
    }

    /// One sample from a direction in the map's axes (any length), worth `weight` samples. False, and nothing done, when the colour is
    /// not finite and 0 or more, the weight not above 0, or the direction none.
    pub fn sample(&mut self, direction: glam::Vec3, colour: [f32; 3], weight: f32, time: Timestamp) -> bool {
        let Some(anchor) = Lattice::<N>::nearest(direction) else { return false };
        let now = self.now(time);
        self.put(anchor, colour, weight, now).is_some()
    }

    /// Milliseconds since the epoch, which is now if there was none.
    pub(crate) fn now(&mut self, time: Timestamp) -> u32 {
        let epoch = *self.epoch.get_or_insert(time);
        (time.as_nanos().saturating_sub(epoch.as_nanos()) / 1_000_000).clamp(0, i64::from(u32::MAX)) as u32
    }

    /// A sample of an anchor. Whether that made it changed; `None` when the sample is none.
    #[inline]
    pub(crate) fn put(&mut self, anchor: usize, sample: [f32; 3], worth: f32, now: u32) -> Option<bool> {
        let good = sample.iter().all(|c| *c >= 0.0 && *c < f32::INFINITY) && worth > 0.0 && worth < f32::INFINITY;
        let (colour, weight) = (self.colour.get_mut(anchor)?, self.weight.get_mut(anchor)?);
        let (last, moved) = (self.last.get_mut(anchor)?, self.moved.get_mut(anchor)?);
        if !good {
            return None;
        }
        // Time that runs backwards ages nothing.
        let age = now.saturating_sub(*last);
        let mut known = *weight;
        if age > 0 && self.params.half_life < f32::INFINITY {
            known *= math::exp(-core::f32::consts::LN_2 * (age as f32 * 0.001) / self.params.half_life);
        }
        let total = known + worth;
        let part = worth / total;
        let [r, g, b] = *colour;
        let [sr, sg, sb] = sample.map(light);
        let new = [r + part * (sr - r), g + part * (sg - g), b + part * (sb - b)];
        let before = *moved > self.params.threshold;
        *moved += if *weight == 0.0 { f32::INFINITY } else { difference(*colour, new) };
        *colour = new;
        // Seen once is seen: it never fades to nothing.
        *weight = math::clamp(total, f32::MIN_POSITIVE, self.params.cap);
        *last = now.max(*last);
        let changed = *moved > self.params.threshold;
        self.stale |= changed;
        Some(changed && !before)
    }

    /// What an anchor counts when colours are blended.
    #[inline]
    pub(crate) fn trust(&self, anchor: usize) -> f32 {
        if self.weight(anchor) > 0.0 { 1.0 } else { UNSEEN }
    }

    /// Anchors that changed, each told to `act` and then no longer changed.
    pub(crate) fn take_changed(&mut self, mut act: impl FnMut(usize)) {
        for (anchor, moved) in self.moved.iter_mut().enumerate() {
            if *moved > self.params.threshold {
                *moved = 0.0;
                act(anchor);
            }
        }
    }
}

/// The brightest that is told from brighter: a clear sky's sun is at 1e5.
const BRIGHTEST: f32 = 1e6;

/// 0 where it is no amount of light.
const fn light(v: f32) -> f32 {
    if v > 0.0 && v < f32::INFINITY { math::clamp(v, 0.0, BRIGHTEST) } else { 0.0 }
}

/// How much two colours differ, as a part of the first's size.
#[inline]
fn difference([r, g, b]: [f32; 3], [nr, ng, nb]: [f32; 3]) -> f32 {
    ((nr - r).abs() + (ng - g).abs() + (nb - b).abs()) / (r + g + b + DARK)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(seconds).unwrap()
    }

    #[test]
    fn anchors_average_and_let_a_change_win() {
        let mut far = FarField::<64>::new(FarParams { half_life: f32::INFINITY, ..FarParams::default() }, [0.5; 3]);
        for i in 0..8 {
            assert!(far.sample(Vec3::X, [i as f32, 0.0, 7.0], 1.0, at(0.0)));
        }
        let anchor = Lattice::<64>::nearest(Vec3::X).unwrap();
        assert!((far.colour(anchor)[0] - 3.5).abs() < 1e-5 && (far.weight(anchor) - 8.0).abs() < 1e-5);
        for _ in 0..200 {
            far.sample(Vec3::X, [100.0, 0.0, 7.0], 1.0, at(0.0));
        }
        assert!(far.colour(anchor)[0] > 99.0 && far.weight(anchor) <= 32.0);
        assert_eq!(far.seen(), 1);
        assert_eq!(far.colour((anchor + 1) % 64), [0.5; 3]);
    }

    #[test]
    fn what_is_old_gives_way() {
        let mut far = FarField::<64>::new(FarParams::default(), [0.0; 3]);
        for _ in 0..32 {
            far.sample(Vec3::X, [1.0; 3], 1.0, at(0.0));
        }
        let anchor = Lattice::<64>::nearest(Vec3::X).unwrap();
        far.sample(Vec3::X, [0.0; 3], 1.0, at(50.0)); // five half lives: 32 samples are worth one
        assert!((far.colour(anchor)[0] - 0.5).abs() < 1e-3, "{:?}", far.colour(anchor));
        assert_eq!(far.last_seen(anchor), Some(at(50.0)));
        far.sample(Vec3::X, [0.0; 3], 1.0, at(20.0)); // out of order
        assert_eq!(far.last_seen(anchor), Some(at(50.0)));
    }

    #[test]
    fn what_is_no_light_is_refused() {
        let mut far = FarField::<64>::new(
            FarParams { cap: f32::NAN, half_life: f32::NAN, threshold: -1.0, ..FarParams::default() },
            [f32::NAN, -1.0, 2.0],
        );
        assert_eq!(far.ambient(), [0.0, 0.0, 2.0]);
        for (d, c, w) in [
            (Vec3::ZERO, [1.0; 3], 1.0),
            (Vec3::X, [f32::NAN, 0.0, 0.0], 1.0),
            (Vec3::X, [0.0, -1.0, 0.0], 1.0),
            (Vec3::X, [f32::INFINITY, 0.0, 0.0], 1.0),
            (Vec3::X, [1.0; 3], 0.0),
            (Vec3::X, [1.0; 3], f32::NAN),
        ] {
            assert!(!far.sample(d, c, w, at(0.0)));
        }
        assert_eq!(far.seen(), 0);
        assert!(!FarField::<0>::new(FarParams::default(), [0.0; 3]).sample(Vec3::X, [1.0; 3], 1.0, at(0.0)));
    }

    #[test]
    fn small_changes_add_up_until_they_count() {
        let mut far = FarField::<64>::new(
            FarParams { threshold: 0.1, unseen: Unseen::Ambient, ..FarParams::default() },
            [1.0; 3],
        );
        far.take_changed(|_| {});
        far.sample(Vec3::X, [1.0; 3], 1.0, at(0.0));
        let mut changed = 0;
        far.take_changed(|_| changed += 1);
        assert_eq!(changed, 1, "first sight counts");
        for i in 0..100 {
            far.sample(Vec3::X, [1.0 + 0.01 * i as f32; 3], 1.0, at(0.0));
            far.take_changed(|_| changed += 1);
        }
        assert!((3..9).contains(&changed), "{changed}");
        far.set_ambient([2.0; 3]);
        let mut changed = 0;
        far.take_changed(|_| changed += 1);
        assert_eq!(changed, 63);
    }
}
