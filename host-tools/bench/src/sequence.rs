//! Frames in a row: of scenes that stand still, change slowly, or change everywhere.

use std::sync::Arc;

use isobath::ground::image::ImageView;
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath_sim::{CameraPath, GroundTruth, SimOptions, Simulation};

use crate::BenchError;
use crate::input::{Depth, Sensor};

/// How much changes from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Nothing.
    Static,
    /// One thing moves, the camera stands still.
    Slow,
    /// The camera moves.
    Full,
}

impl Kind {
    /// In a word.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Slow => "slow",
            Self::Full => "full",
        }
    }
}

/// The depth of every frame.
#[derive(Debug, Clone)]
pub(crate) enum Depths {
    U16(Vec<Vec<u16>>),
    F32(Vec<Vec<f32>>),
}

/// Frames of one camera, at least two.
#[derive(Debug, Clone)]
pub(crate) struct Sequence {
    /// Scene or recording.
    pub(crate) name: String,
    pub(crate) kind: Kind,
    /// What it was seen with, in a word or two.
    pub(crate) sensor: &'static str,
    pub(crate) size: (usize, usize),
    pub(crate) unit: DepthUnit,
    pub(crate) intrinsics: Intrinsics,
    /// What the tile map is told of the noise.
    pub(crate) noise: DepthNoise,
    pub(crate) depth: Depths,
    /// What the frames truly show; empty for recordings.
    pub(crate) truth: Vec<Arc<GroundTruth>>,
}

impl Sequence {
    /// A frame over its depth.
    pub(crate) fn frame<'a, D: DepthSample>(&self, depth: &'a [D]) -> DepthFrame<'a, D> {
        let view = ImageView::new(depth, self.size.0, self.size.1);
        let view = view.unwrap_or_else(|_| unreachable!("one value a pixel"));
        DepthFrame::new(view, self.unit, self.intrinsics)
    }

    /// Whether what is kept must be what would be computed, to the last bit: float depth, and no noise admitted.
    pub(crate) fn is_exact(&self) -> bool {
        matches!(self.depth, Depths::F32(_)) && self.noise == DepthNoise::NONE
    }
}

/// Scene, way of the camera, kind. In the door's room a door opens and a box slides past.
const SIMULATED: [(&str, CameraPath, Kind); 3] = [
    ("living-room", CameraPath::Still, Kind::Static),
    ("door", CameraPath::Still, Kind::Slow),
    ("living-room", CameraPath::Walk, Kind::Full),
];

/// Simulated sequences at 30 frames a second, each with exact depth and with a Kinect's noise.
pub(crate) fn simulated(size: (usize, usize), frames: usize, seed: u64) -> Result<Vec<Sequence>, BenchError> {
    let mut all = Vec::new();
    for (scene, path, kind) in SIMULATED {
        let options = SimOptions { size, frames, path, colour: false, seed, ..SimOptions::default() };
        let simulation = Simulation::open(scene, options)?;
        let camera = *simulation.depth_camera();
        let truth: Vec<Arc<GroundTruth>> = if kind == Kind::Static {
            let always = Arc::new(simulation.frame(0).truth);
            vec![always; frames]
        } else {
            simulation.iter().map(|f| Arc::new(f.truth)).collect()
        };
        let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32);
        for sensor in [Sensor::Exact, Sensor::Kinect] {
            let depth = truth.iter().zip(0..).filter_map(|(t, i)| match sensor.sense(t, &camera, seed, i) {
                Depth::F32(depth) => Some(depth),
                // Neither of the two sensors gives it.
                Depth::U16(_) => None,
            });
            all.push(Sequence {
                name: scene.to_owned(),
                kind,
                sensor: sensor.label(),
                size,
                unit: DepthUnit::METRE,
                intrinsics: Intrinsics::new(fx, fy, cx, cy)?,
                noise: sensor.noise(),
                depth: Depths::F32(depth.collect()),
                truth: truth.clone(),
            });
        }
    }
    Ok(all)
}
