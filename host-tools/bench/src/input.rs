//! A simulated frame, what a sensor makes of it, and the truth.

use std::sync::Arc;

use isobath::glam::Vec3;
use isobath::ground::image::ImageView;
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath_sim::{GroundTruth, Rigid, Scene, SensorModel, SimCamera, Stage, V3, core_pose};

use crate::BenchError;

/// What depth is measured with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensor {
    /// Exact depth, `f32` metres.
    Exact,
    /// Exact depth in whole millimetres, `u16`.
    Millimetres,
    /// Normal noise of 1.425e-3 z² metres (Khoshelham and Elberink 2012), `f32` metres.
    Kinect,
}

impl Sensor {
    /// Every one.
    pub const ALL: &'static [Self] = &[Self::Exact, Self::Millimetres, Self::Kinect];

    /// In a word or two.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Exact => "exact depth",
            Self::Millimetres => "1 mm steps",
            Self::Kinect => "Kinect noise",
        }
    }

    /// What a feature is told of its noise.
    #[must_use]
    pub const fn noise(self) -> DepthNoise {
        match self {
            Self::Exact | Self::Millimetres => DepthNoise::NONE,
            Self::Kinect => DepthNoise::KINECT,
        }
    }

    /// What it makes of the truth, in frame `frame` of a sequence.
    #[must_use]
    pub fn sense(self, truth: &GroundTruth, camera: &SimCamera, seed: u64, frame: u64) -> Depth {
        let metres = |z: &[f64]| Depth::F32(z.iter().map(|&z| z as f32).collect());
        match self {
            Self::Exact => metres(&truth.z),
            Self::Millimetres => {
                Depth::U16(truth.z.iter().map(|&z| u16::from_metres(z as f32, DepthUnit::MILLIMETRE)).collect())
            }
            Self::Kinect => {
                let noise = Stage::Noise { constant: 0.0, linear: 0.0, quadratic: 1.425e-3 };
                metres(&SensorModel { stages: vec![noise] }.sense(truth, camera, seed, frame).z)
            }
        }
    }
}

/// Depth as the sensor gives it.
#[derive(Debug, Clone, PartialEq)]
pub enum Depth {
    /// Millimetres.
    U16(Vec<u16>),
    /// Metres.
    F32(Vec<f32>),
}

/// A frame with its truth.
#[derive(Debug, Clone)]
pub struct Input {
    /// The scene, for those who need more truth than the frame's.
    pub scene: Arc<Scene>,
    /// What it is seen with.
    pub sensor: Sensor,
    /// Exact z depth and normals of every pixel.
    pub truth: Arc<GroundTruth>,
    /// As the sensor gives it.
    pub depth: Depth,
    /// The camera, in the simulator's words.
    pub camera: SimCamera,
    /// Where it stands, in the simulator's words.
    pub place: Rigid,
    /// The camera, in the core's words.
    pub intrinsics: Intrinsics,
    /// Where it stands, in the core's words.
    pub pose: Pose,
    /// Of noise and of the questions asked.
    pub seed: u64,
    /// Whether methods leave their whole answer in memory, as other libraries do, where they could hand it over row by row.
    pub keep: bool,
}

/// Runs an expression with `$frame` as the input's [`DepthFrame`], whichever type its depth has.
macro_rules! on_frame {
    ($input:expr, $frame:ident => $body:expr) => {
        match &$input.depth {
            $crate::input::Depth::U16(depth) => {
                let $frame = $input.frame_of(depth, isobath::sensing::depth::DepthUnit::MILLIMETRE);
                $body
            }
            $crate::input::Depth::F32(depth) => {
                let $frame = $input.frame_of(depth, isobath::sensing::depth::DepthUnit::METRE);
                $body
            }
        }
    };
}
pub(crate) use on_frame;

impl Input {
    /// A named scene from its usual place.
    ///
    /// # Errors
    /// [`BenchError`]: no such scene, or an impossible size.
    pub fn new(scene: &str, sensor: Sensor, (width, height): (usize, usize), seed: u64) -> Result<Self, BenchError> {
        let scene = Scene::open(scene)?;
        let camera = scene.camera(width, height)?;
        let place = Rigid::looking_at(scene.view().eye, scene.view().target);
        let truth = scene.render_geometry(0.0, &camera, &place);
        let intrinsics = Intrinsics::new(camera.fx as f32, camera.fy as f32, camera.cx as f32, camera.cy as f32)?;
        let pose = core_pose(&place).unwrap_or(Pose::IDENTITY);
        let (scene, truth) = (Arc::new(scene), Arc::new(truth));
        let depth = Depth::F32(Vec::new());
        let input = Self { scene, sensor, truth, depth, camera, place, intrinsics, pose, seed, keep: false };
        Ok(input.sensed_by(sensor))
    }

    /// The same view with another sensor.
    #[must_use]
    pub fn sensed_by(&self, sensor: Sensor) -> Self {
        let depth = sensor.sense(&self.truth, &self.camera, self.seed, 0);
        Self { sensor, depth, ..self.clone() }
    }

    /// Pixels of the frame.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.truth.z.len()
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.truth.width, self.truth.height)
    }

    /// Sensed depth in metres, 0 in holes.
    pub fn metres(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.pixels()).map(|i| match &self.depth {
            Depth::U16(d) => f64::from(d[i].metres(DepthUnit::MILLIMETRE)),
            Depth::F32(d) => f64::from(d[i].metres(DepthUnit::METRE)),
        })
    }

    /// The frame over some depth of its size.
    pub(crate) fn frame_of<'a, D: DepthSample>(&self, depth: &'a [D], unit: DepthUnit) -> DepthFrame<'a, D> {
        let (width, height) = self.size();
        let view = ImageView::new(depth, width, height).unwrap_or_else(|_| unreachable!("one value a pixel"));
        DepthFrame::new(view, unit, self.intrinsics).with_pose(self.pose)
    }

    /// The true world point of a pixel; `None` where nothing is.
    #[must_use]
    pub fn true_point(&self, x: usize, y: usize) -> Option<V3> {
        let z = self.truth.z[y * self.truth.width + x];
        let ray = self.camera.ray(x as f64, y as f64)?;
        (z > 0.0).then(|| self.place.point(ray * z))
    }

    /// The true normal of a pixel, camera frame; `None` where nothing is.
    #[must_use]
    pub fn true_normal(&self, x: usize, y: usize) -> Option<[f64; 3]> {
        let i = y * self.truth.width + x;
        (self.truth.z[i] > 0.0).then(|| self.truth.normals[i].map(f64::from))
    }

    /// Whether the camera truly sees a world point: it is in the view, and nothing stands more than `slack` metres before it.
    #[must_use]
    pub fn sees(&self, point: V3, slack: f64) -> bool {
        let p = self.place.undo_point(point);
        let Some([x, y]) = self.camera.project(p) else { return false };
        let (w, h) = self.size();
        let (x, y) = (x.round(), y.round());
        if !(x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64) {
            return false;
        }
        let z = self.truth.z[y as usize * w + x as usize];
        z == 0.0 || p.z <= z + slack
    }

    /// How far from `origin` the scene truly is along a unit direction, metres.
    #[must_use]
    pub fn probe(&self, origin: V3, direction: V3) -> Option<f64> {
        let eye = SimCamera { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, lens: [0.0; 8] };
        let place = Rigid::looking_at(origin, origin + direction);
        self.scene.render_geometry(0.0, &eye, &place).z.first().copied().filter(|&z| z > 0.0)
    }

    /// `n` different pixels with a true surface, spread by chance, always the same.
    #[must_use]
    pub fn some_pixels(&self, n: usize) -> Vec<(usize, usize)> {
        let mut random = Random::new(self.seed ^ 0x5eed);
        let (w, h) = self.size();
        let pixels = (0..20 * n).map(|_| (random.below(w), random.below(h)));
        pixels.filter(|&(x, y)| self.truth.z[y * w + x] > 0.0).take(n).collect()
    }
}

pub use isobath_sim::core_vec3 as vec3;

/// The core's vector in the simulator's.
#[must_use]
pub fn v3(v: Vec3) -> V3 {
    V3::from(v.to_array().map(f64::from))
}

/// Angle between two directions, degrees.
#[must_use]
pub fn degrees_between(a: [f64; 3], b: [f64; 3]) -> f64 {
    let (a, b) = (V3::from(a), V3::from(b));
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// The mean; NaN of nothing.
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The value in the middle; NaN of nothing.
#[must_use]
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Random numbers from a seed (`SplitMix64`).
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// From a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 64 random bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In (0, 1).
    pub fn unit(&mut self) -> f64 {
        ((self.bits() >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
    }

    /// 0 to `n` - 1 (0 when n is 0).
    pub fn below(&mut self, n: usize) -> usize {
        (self.unit() * n as f64) as usize
    }

    /// In (low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A wall without a reading in its upper half.
    pub(crate) fn half_a_wall() -> Input {
        let input = Input::new("wall", Sensor::Exact, (64, 48), 1).unwrap();
        let mut truth = GroundTruth::clone(&input.truth);
        truth.z[..64 * 24].fill(0.0);
        Input { truth: Arc::new(truth), ..input }.sensed_by(Sensor::Exact)
    }

    #[test]
    fn the_frame_and_the_truth_agree() {
        let input = Input::new("corner", Sensor::Exact, (64, 48), 1).unwrap();
        on_frame!(input, frame => {
            for (x, y) in input.some_pixels(100) {
                let off = (v3(frame.world_point(x, y).unwrap()) - input.true_point(x, y).unwrap()).length();
                assert!(off < 1e-5, "{off}");
                assert!(input.sees(input.true_point(x, y).unwrap(), 1e-6));
            }
        });
    }

    #[test]
    fn probes_find_what_the_camera_sees() {
        let input = Input::new("living-room", Sensor::Exact, (64, 48), 1).unwrap();
        for (x, y) in input.some_pixels(20) {
            let to = input.true_point(x, y).unwrap() - input.place.translation;
            let found = input.probe(input.place.translation, to.unit().unwrap()).unwrap();
            assert!((found - to.length()).abs() < 1e-6, "{found} {}", to.length());
        }
    }

    #[test]
    fn sensors_do_what_they_say() {
        let exact = Input::new("wall", Sensor::Exact, (64, 48), 1).unwrap();
        let noisy: Vec<f64> = exact.sensed_by(Sensor::Kinect).metres().map(|z| z - 2.0).collect();
        let sigma = mean(&noisy.iter().map(|e| e * e).collect::<Vec<_>>()).sqrt();
        assert!((sigma / (1.425e-3 * 4.0) - 1.0).abs() < 0.05, "{sigma}");
        assert_eq!(exact.sensed_by(Sensor::Kinect).depth, exact.sensed_by(Sensor::Kinect).depth, "the same seed");
        assert!(exact.sensed_by(Sensor::Millimetres).metres().all(|z| (z - 2.0).abs() < 1e-6));
    }
}
