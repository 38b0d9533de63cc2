#![doc = include_str!("../README.md")]

mod error;
mod maths;
mod path;
mod random;
mod render;
mod scene;
pub mod sensor;
mod shape;
mod simulation;
mod source;
mod write;

pub use error::SimError;
pub use maths::{Rigid, Rotation, V3, v3};
pub use path::imu::{GRAVITY, ImuModel, ImuSample, imu_samples};
pub use path::tracking::PoseNoise;
pub use path::{CameraPath, Curve, Motion, Sine, Trajectory, orbit_stations};
pub use render::GroundTruth;
pub use render::ball::{Ball, covers, render_ball};
pub use render::camera::SimCamera;
pub use render::sky::{LinearImage, direction_of_equirect, equirect_of_direction, read_linear};
pub use scene::{NAMES, Scene, View};
pub use sensor::{SensorModel, Stage};
pub use simulation::{SimFrame, SimOptions, Simulation};
pub use source::{SimSource, core_pose, core_vec3};
pub use write::{Summary, write_linear, write_recording};

impl Scene {
    /// What a camera sees at a time (seconds): exact depth, normals, segments, and linear colour. `pose` is camera-to-world.
    #[must_use]
    pub fn render(&self, time: f64, camera: &SimCamera, pose: &Rigid) -> (GroundTruth, LinearImage) {
        let (truth, colour) = render::see(&self.at(time), camera, pose, true);
        (truth, colour.unwrap_or_default())
    }

    /// Exact depth, normals and segments alone: several times as fast.
    #[must_use]
    pub fn render_geometry(&self, time: f64, camera: &SimCamera, pose: &Rigid) -> GroundTruth {
        render::see(&self.at(time), camera, pose, false).0
    }

    /// Linear colour alone, the mean of `samples` x `samples` rays a pixel.
    #[must_use]
    pub fn render_colour(&self, time: f64, camera: &SimCamera, pose: &Rigid, samples: u32) -> LinearImage {
        render::colour(&self.at(time), camera, pose, samples)
    }

    /// The ground truth of lighting at a place: the equirectangular map ([`direction_of_equirect`]) of linear radiance,
    /// `width` x `width / 2`, each pixel the mean of `samples` x `samples` directions.
    #[must_use]
    pub fn environment_map(&self, time: f64, at: V3, width: usize, samples: u32) -> LinearImage {
        render::environment::map(&self.at(time), at, width, samples)
    }

    /// Linear colour as sRGB bytes at the scene's exposure.
    #[must_use]
    pub fn to_srgb(&self, image: &LinearImage) -> Vec<[u8; 3]> {
        let e = self.exposure() as f32;
        image.pixels.iter().map(|p| p.map(|v| render::srgb::encode(v * e))).collect()
    }
}
