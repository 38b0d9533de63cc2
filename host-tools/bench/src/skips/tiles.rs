//! Dense normals over a sequence: all of them in every frame, or those of the tiles that changed.
//!
//! On exact depth the two are equal to the last bit. With noise a still tile keeps the normals of an earlier frame, which differ
//! from those that this frame would give by what the noise makes of either; neither is the better. So the bound there is on
//! what matters, the mean error against the truth: a test holds that of skipping to 2 % above that of computing everything.
//! Recordings have no truth; their differences are shown.
//!
//! Time is that of a frame in the middle of the sequence, the tile map's own update included. Frames run to the end and back
//! again, so that no jump from last to first is measured.

use std::hint::black_box;

use isobath::ground::image::ImageViewMut;
use isobath::localized::normals::NormalParams;
use isobath::localized::normals::dense::{planes, scratch_len, update};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::Work;
use isobath::skipping::tiles::{TILE, Tile, TileMap, tiles_needed};
use isobath_sim::GroundTruth;

use crate::input::degrees_between;
use crate::measure::{Effort, alternating};
use crate::report::{Change, Skip};
use crate::row::{Method, Score};
use crate::sequence::{Depths, Sequence};

/// The exact method: the one that looks at most a tile around.
const PARAMS: NormalParams =
    NormalParams { method: isobath::localized::normals::NormalMethod::Exact, radius: 0, max_step: None };

/// Dense normals over a sequence, in full and by tiles.
pub(crate) fn normals(sequence: &Sequence, effort: &Effort) -> Skip {
    match &sequence.depth {
        Depths::U16(depth) => of(sequence, depth, effort),
        Depths::F32(depth) => of(sequence, depth, effort),
    }
}

fn of<D: DepthSample>(sequence: &Sequence, depth: &[Vec<D>], effort: &Effort) -> Skip {
    let frames: Vec<DepthFrame<'_, D>> = depth.iter().map(|d| sequence.frame(d)).collect();
    let Found { work, answers, different, change } = judge(sequence, &frames);
    let (w, h) = sequence.size;
    let noise = &sequence.noise;
    let none = || Score { errors: Vec::new() };
    let pixels = frames.len().saturating_sub(1) * w * h;

    let (mut scratch, mut images, mut way) = (vec![0.0; scratch_len(w)], Images::new(w, h), Shuttle::new(frames.len()));
    let full = || {
        for i in way.pass() {
            let [x, y, z] = &mut images.views();
            black_box(planes(&frames[i], &PARAMS, &mut scratch, [x, y, z], None)).ok();
        }
    };

    let (mut scratch, mut images, mut way) = (vec![0.0; scratch_len(w)], Images::new(w, h), Shuttle::new(frames.len()));
    let mut memory = Memory::new(w, h);
    let mut map = memory.map();
    let skipping = || {
        for i in way.pass() {
            map.update(&frames[i], noise);
            let [x, y, z] = &mut images.views();
            black_box(update(&frames[i], &map, &PARAMS, &mut scratch, [x, y, z])).ok();
        }
    };

    let (mut memory, mut way) = (Memory::new(w, h), Shuttle::new(frames.len()));
    let mut map = memory.map();
    let tiles = || way.pass().for_each(|i| _ = black_box(map.update(&frames[i], noise)));

    let mut methods = [
        Method::new("full", pixels, full, none),
        Method::new("skipping", pixels, skipping, none),
        Method::new("tile map", pixels, tiles, none),
    ];
    let times = alternating(&mut methods, effort);
    Skip {
        feature: "dense normals, tiles",
        scene: sequence.name.clone(),
        kind: Some(sequence.kind),
        sensor: sequence.sensor,
        size: sequence.size,
        unit: "pixel",
        skipped: f64::from(work.skipped_share()),
        full: times[0],
        skipping: times[1],
        summary: Some(times[2]),
        queries: answers,
        different,
        exact: sequence.is_exact(),
        change: Some(change),
    }
}

/// What came out of the comparison, first frame left out: there everything is new.
struct Found {
    work: Work,
    /// Pixels of all frames, and those of them whose answers differ.
    answers: usize,
    different: usize,
    change: Change,
}

fn judge<D: DepthSample>(sequence: &Sequence, frames: &[DepthFrame<'_, D>]) -> Found {
    let (w, h) = sequence.size;
    let mut scratch = vec![0.0; scratch_len(w)];
    let (mut skipping, mut full) = (Images::new(w, h), Images::new(w, h));
    let mut memory = Memory::new(w, h);
    let mut map = memory.map();
    let mut found = Found { work: Work::default(), answers: 0, different: 0, change: Change::default() };
    let (mut kept, mut wrong_full, mut wrong_skipping) = (Mean::default(), Mean::default(), Mean::default());
    for (i, frame) in frames.iter().enumerate() {
        map.update(frame, &sequence.noise);
        let [x, y, z] = &mut skipping.views();
        let work = update(frame, &map, &PARAMS, &mut scratch, [x, y, z]).unwrap_or_default();
        if i == 0 {
            continue;
        }
        let [x, y, z] = &mut full.views();
        planes(frame, &PARAMS, &mut scratch, [x, y, z], None).ok();
        found.work += work;
        found.answers += w * h;
        for pixel in 0..w * h {
            let (a, b) = (full.at(pixel), skipping.at(pixel));
            found.different += usize::from(!same(a, b));
            if !map.is_stale(pixel % w / TILE, pixel / w / TILE) {
                kept.add(degrees_between(a, b));
            }
            if let Some(truth) = sequence.truth.get(i).and_then(|truth| normal(truth, pixel)) {
                wrong_full.add(degrees_between(a, truth));
                wrong_skipping.add(degrees_between(b, truth));
            }
        }
    }
    found.change = Change {
        mean: kept.mean(),
        worst: kept.worst,
        error_full: wrong_full.mean(),
        error_skipping: wrong_skipping.mean(),
    };
    found
}

/// To the last bit; no answer is the same as no answer.
fn same(a: [f64; 3], b: [f64; 3]) -> bool {
    a.into_iter().zip(b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

fn normal(truth: &GroundTruth, pixel: usize) -> Option<[f64; 3]> {
    (truth.z[pixel] > 0.0).then(|| truth.normals[pixel].map(f64::from))
}

/// Of what is a number.
struct Mean {
    sum: f64,
    n: f64,
    worst: f64,
}

impl Default for Mean {
    fn default() -> Self {
        Self { sum: 0.0, n: 0.0, worst: f64::NAN }
    }
}

impl Mean {
    fn add(&mut self, value: f64) {
        if !value.is_nan() {
            self.sum += value;
            self.n += 1.0;
            // `max` takes the other of a number and NaN.
            self.worst = self.worst.max(value);
        }
    }

    fn mean(&self) -> f64 {
        self.sum / self.n
    }
}

/// Three planes of normals.
struct Images {
    planes: [Vec<f32>; 3],
    size: (usize, usize),
}

impl Images {
    /// Without an answer anywhere: what empty tiles, which no update touches, stay.
    fn new(width: usize, height: usize) -> Self {
        Self { planes: [(); 3].map(|()| vec![f32::NAN; width * height]), size: (width, height) }
    }

    fn views(&mut self) -> [ImageViewMut<'_, f32>; 3] {
        let (width, height) = self.size;
        let view =
            |plane| ImageViewMut::new(plane, width, height).unwrap_or_else(|_| unreachable!("one value a pixel"));
        self.planes.each_mut().map(|plane| view(plane.as_mut_slice()))
    }

    fn at(&self, pixel: usize) -> [f64; 3] {
        self.planes.each_ref().map(|plane| f64::from(plane[pixel]))
    }
}

/// A tile map's memory.
struct Memory<D> {
    reference: Vec<D>,
    tiles: Vec<Tile>,
    size: (usize, usize),
}

impl<D: DepthSample> Memory<D> {
    fn new(width: usize, height: usize) -> Self {
        let tiles = vec![Tile::NEW; tiles_needed(width, height)];
        Self { reference: vec![D::HOLE; width * height], tiles, size: (width, height) }
    }

    fn map(&mut self) -> TileMap<'_, D> {
        let reference = ImageViewMut::new(&mut self.reference, self.size.0, self.size.1);
        let reference = reference.unwrap_or_else(|_| unreachable!("one value a pixel"));
        TileMap::new(reference, &mut self.tiles).unwrap_or_else(|_| unreachable!("as many tiles as needed"))
    }
}

/// To the last frame, back to the first, and so on.
struct Shuttle {
    frames: usize,
    forward: bool,
}

impl Shuttle {
    const fn new(frames: usize) -> Self {
        Self { frames, forward: false }
    }

    /// The next way, without the frame where it begins.
    fn pass(&mut self) -> impl Iterator<Item = usize> + use<> {
        self.forward = !self.forward;
        let (last, forward) = (self.frames.saturating_sub(1), self.forward);
        (1..=last).map(move |i| if forward { i } else { last - i })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequence::{Kind, simulated};

    fn judged(sequence: &Sequence) -> Found {
        let Depths::F32(depth) = &sequence.depth else { panic!("simulated depth is f32") };
        let frames: Vec<_> = depth.iter().map(|d| sequence.frame(d)).collect();
        judge(sequence, &frames)
    }

    #[test]
    fn nothing_differs_on_exact_depth_and_nothing_is_lost_with_noise() {
        let mut skipped = Vec::new();
        for sequence in simulated((160, 120), 5, 3).unwrap() {
            let Found { work, answers, different, change } = judged(&sequence);
            let what = format!("{}, {}: {change:?}", sequence.kind.label(), sequence.sensor);
            println!("{what}, {different} of {answers}, {:.3}", work.skipped_share());
            assert_eq!(answers, 4 * 160 * 120);
            if sequence.is_exact() {
                assert_eq!(different, 0, "{what}");
                skipped.push(work.skipped_share());
            } else {
                let more = change.error_skipping / change.error_full - 1.0;
                assert!(more < 0.02, "{what}");
                assert!(more.abs() < 0.02 || sequence.kind != Kind::Static, "{what}");
            }
        }
        let [still, slow, full] = skipped[..] else { panic!("three exact sequences") };
        assert!(still == 1.0 && slow > 0.3 && full < slow, "{skipped:?}");
    }

    #[test]
    fn frames_run_to_and_fro() {
        let mut way = Shuttle::new(4);
        assert_eq!(way.pass().chain(way.pass()).collect::<Vec<_>>(), [1, 2, 3, 2, 1, 0]);
        assert_eq!(way.pass().next(), Some(1));
        assert_eq!(Shuttle::new(0).pass().count(), 0);
    }

    #[test]
    fn the_row_is_complete() {
        let effort = Effort { rounds: 2, batch: std::time::Duration::ZERO, longest: std::time::Duration::ZERO };
        let sequences = simulated((64, 48), 3, 1).unwrap();
        let skip = normals(&sequences[0], &effort);
        assert!(skip.exact && skip.different == 0 && skip.queries == 2 * 64 * 48 && skip.skipped == 1.0);
        assert!(skip.summary.is_some_and(|t| t.best > 0.0) && skip.speed_up() > 0.0);
    }
}
