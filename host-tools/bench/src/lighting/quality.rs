//! Maps against the truth: ten places, the orbit's stations around each, and what is left out or done otherwise one by one.

use isobath::glam::{Quat, Vec3};
use isobath::ground::colour::Colour;
use isobath::lighting::Preset;
use isobath::lighting::far::Unseen;
use isobath::lighting::far::observe::FarSampling;
use isobath::lighting::near::NearParams;
use isobath::sensing::camera::Pose;
use isobath_sim::{LinearImage, Scene, V3, orbit_stations};

use super::Plan;
use super::reconstruct::{Recipe, reconstruct};
use super::score::{Quality, Truth};
use super::sights::{FAR, Sight, guided, in_parallel, panorama};
use crate::BenchError;

/// One map's quality.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    pub(super) table: &'static str,
    pub(super) row: &'static str,
    pub(super) place: String,
    pub(super) quality: Quality,
}

/// Tables, in their order.
pub(super) const WAYS: &str = "ways";
pub(super) const PRESETS: &str = "presets";
pub(super) const VIEWS: &str = "views";
pub(super) const DIRECTIONS: &str = "directions";
pub(super) const RULES: &str = "rules";
pub(super) const DRIFT: &str = "drift";

/// The rows that are set against each other place by place.
pub(super) const OURS: &str = "ours, medium";
pub(super) const CAPTURE: &str = "360 capture";

/// Stations that circle a place at one height and distance.
const CIRCLE: usize = 8;

/// Everything, place after place.
pub(super) fn measure(plan: &Plan, scene: &Scene, tell: &mut dyn FnMut(&str)) -> Result<Vec<Measured>, BenchError> {
    let mut all = Vec::new();
    let places: Vec<(&String, V3)> = scene.places().iter().map(|(name, at)| (name, *at)).take(plan.places).collect();
    for (i, (name, at)) in places.iter().enumerate() {
        tell(&format!("lighting: {name}, {} of {}, {} stations", i + 1, places.len(), plan.stations.len()));
        let orbit = orbit_stations(*at);
        // Balls are seen from the eight sides of the middle circle.
        let sides = orbit.iter().skip(4 * CIRCLE).take(CIRCLE).copied().collect();
        let truth = Truth::new(&panorama(scene, *at, 2), sides);
        let found = in_parallel(plan.stations.len(), |job| {
            let station = plan.stations.get(job).copied().unwrap_or_default();
            let mut bench = Bench { scene, at: *at, orbit: &orbit, station, truth: &truth, found: Vec::new() };
            bench.ways()?;
            if plan.few.contains(&station) {
                bench.ablations(plan.seed)?;
            }
            Ok(bench.found)
        })?;
        let named = found.into_iter().flatten().map(|(table, row, quality)| Measured {
            table,
            row,
            place: (*name).clone(),
            quality,
        });
        all.extend(named);
    }
    Ok(all)
}

/// One observer of one place.
struct Bench<'a> {
    scene: &'a Scene,
    at: V3,
    orbit: &'a [isobath_sim::Rigid],
    station: usize,
    truth: &'a Truth,
    found: Vec<(&'static str, &'static str, Quality)>,
}

impl Bench<'_> {
    fn put(&mut self, table: &'static str, row: &'static str, map: &LinearImage) {
        self.found.push((table, row, self.truth.score(map, self.station % CIRCLE)));
    }

    fn pose(&self, station: usize) -> Result<isobath_sim::Rigid, BenchError> {
        self.orbit.get(station).copied().ok_or_else(|| BenchError::core(format!("there is no station {station}")))
    }

    /// The nine guided frames.
    fn away(&self) -> Result<Vec<Sight>, BenchError> {
        let observer = self.pose(self.station)?.translation;
        guided(observer, self.at)?.iter().map(|pose| Sight::new(self.scene, FAR, pose)).collect()
    }

    /// The paper's 6.2.2: one near view, nine guided frames; and what else one could do from there.
    fn ways(&mut self) -> Result<(), BenchError> {
        let pose = self.pose(self.station)?;
        let near = Sight::new(self.scene, Preset::MEDIUM.view, &pose)?;
        let away = self.away()?;
        let (views, far, ambient) = ([&near], away.iter().collect::<Vec<_>>(), near.ambient());
        let at = self.at;
        let map = |recipe: &Recipe| reconstruct(recipe, at, &views, &far, ambient);
        let medium = Recipe::new(Preset::MEDIUM);
        self.put(WAYS, OURS, &map(&medium)?);
        self.put(WAYS, "ours, low", &map(&Recipe::new(Preset::LOW))?);
        self.put(WAYS, "ours, tiny", &map(&Recipe::new(Preset::TINY))?);
        let hdr = panorama(self.scene, pose.translation, 1);
        // A camera's bytes, as all others here.
        let pixels = hdr.pixels.iter().map(|p| <[u8; 3]>::of_linear(*p).linear()).collect();
        self.put(WAYS, CAPTURE, &LinearImage { pixels, ..hdr });
        self.put(WAYS, "360 capture, HDR", &hdr);
        self.put(WAYS, "near only", &map(&Recipe { far_field: false, ..medium })?);
        self.put(WAYS, "far only", &map(&Recipe { near_field: false, ..medium })?);
        self.put(WAYS, "ambient only", &map(&Recipe { near_field: false, far_field: false, ..medium })?);
        Ok(())
    }

    /// One thing at a time.
    fn ablations(&mut self, seed: u64) -> Result<(), BenchError> {
        let at = self.at;
        let pose = self.pose(self.station)?;
        let away = self.away()?;
        let far: Vec<&Sight> = away.iter().collect();
        let fine = Sight::new(self.scene, Preset::HIGH.view, &pose)?;
        for (row, preset) in
            [("tiny", Preset::TINY), ("low", Preset::LOW), ("medium", Preset::MEDIUM), ("high", Preset::HIGH)]
        {
            let map = reconstruct(&Recipe::new(preset), at, &[&fine], &far, fine.ambient())?;
            self.put(PRESETS, row, &map);
        }

        // The circle's stations, nearest first: itself, one to each side, two...
        let low = Preset { views: 7, ..Preset::LOW };
        let first = self.station - self.station % CIRCLE;
        let circle: Vec<Sight> = [0, 1, 7, 2, 6, 3, 5]
            .iter()
            .map(|step| Sight::new(self.scene, low.view, &self.pose(first + (self.station + step) % CIRCLE)?))
            .collect::<Result<_, _>>()?;
        let [own, ..] = circle.as_slice() else { return Ok(()) };
        let ambient = own.ambient();
        let only_near = Recipe { far_field: false, ..Recipe::new(low) };
        for (row, n) in [("1 view", 1), ("3 views", 3), ("5 views", 5), ("7 views", 7)] {
            let views: Vec<&Sight> = circle.iter().take(n).collect();
            self.put(VIEWS, row, &reconstruct(&only_near, at, &views, &[], ambient)?);
        }

        let recipe = Recipe::new(low);
        for (row, n) in [("none", 0), ("1 direction", 1), ("3 directions", 3), ("5 directions", 5), ("9 directions", 9)]
        {
            let map = reconstruct(&recipe, at, &[own], far.get(..n).unwrap_or_default(), ambient)?;
            self.put(DIRECTIONS, row, &map);
        }

        let parallax = FarSampling { parallax: false, ..FarSampling::default() };
        let rules = [
            ("ours", recipe),
            ("any coarse point wins", Recipe { near: NearParams { margin: 0.0, ..NearParams::default() }, ..recipe }),
            ("hard seam", Recipe { near: NearParams { seam: 0, ..NearParams::default() }, ..recipe }),
            ("no parallax afar", Recipe { sampling: parallax, ..recipe }),
            (
                "all of the paper's",
                Recipe { near: NearParams::PAPER, sampling: parallax, unseen: Unseen::Ambient, ..recipe },
            ),
            ("unseen is ambient", Recipe { unseen: Unseen::Ambient, ..recipe }),
        ];
        for (row, recipe) in rules {
            self.put(RULES, row, &reconstruct(&recipe, at, &[own], &far, ambient)?);
        }

        let five: Vec<&Sight> = circle.iter().take(5).collect();
        self.put(DRIFT, "exact poses", &reconstruct(&recipe, at, &five, &far, ambient)?);
        let registered = Recipe { register: true, ..recipe };
        for (row, metres, degrees, recipe) in [
            ("2 cm, 2 degrees", 0.02, 2.0, recipe),
            ("2 cm, 2 degrees, registered", 0.02, 2.0, registered),
            ("5 cm, 5 degrees", 0.05, 5.0, recipe),
            ("5 cm, 5 degrees, registered", 0.05, 5.0, registered),
        ] {
            // The last view's pose is the world's: the earlier ones have drifted away from it.
            let moved: Vec<Sight> = (five.iter().zip(0_u64..))
                .map(|(sight, i)| match i {
                    0 => (*sight).clone(),
                    i => sight.moved(drifted(sight.pose, metres, degrees, seed ^ (self.station as u64) << 8 ^ i << 32)),
                })
                .collect();
            self.put(DRIFT, row, &reconstruct(&recipe, at, &moved.iter().collect::<Vec<_>>(), &far, ambient)?);
        }
        Ok(())
    }
}

/// A pose that is off by so much, in a direction and about an axis of the seed's choice; turned where the camera is.
pub(super) fn drifted(pose: Pose, metres: f32, degrees: f32, seed: u64) -> Pose {
    let mut state = seed;
    let mut direction = || {
        let mut next = || {
            // SplitMix64.
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (state ^ state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
            (z ^ z >> 31) as f64 / u64::MAX as f64
        };
        let (y, turn) = (2.0 * next() - 1.0, std::f64::consts::TAU * next());
        let across = (1.0 - y * y).max(0.0).sqrt();
        Vec3::new((across * turn.cos()) as f32, y as f32, (across * turn.sin()) as f32)
    };
    let (shift, axis) = (direction() * metres, direction());
    let turn = Quat::from_axis_angle(axis.normalize_or(Vec3::Y), degrees.to_radians());
    Pose::new(turn * pose.rotation(), pose.translation() + shift).unwrap_or(pose)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drift_is_as_large_as_said_and_repeats() {
        let pose = Pose::new(Quat::from_rotation_y(0.3), Vec3::new(1.0, 2.0, 3.0)).unwrap();
        for seed in 0..20 {
            let off = drifted(pose, 0.05, 5.0, seed);
            assert!((off.translation().distance(pose.translation()) - 0.05).abs() < 1e-6);
            assert!((off.rotation().angle_between(pose.rotation()).to_degrees() - 5.0).abs() < 0.01);
            assert_eq!(off, drifted(pose, 0.05, 5.0, seed));
        }
    }
}
