//! A camera with a depth sensor on its way through a scene: any frame, with its truth, in any order.

use std::sync::Arc;

use rayon::prelude::*;

use crate::error::SimError;
use crate::maths::{Rigid, V3};
use crate::path::imu::{ImuModel, ImuSample, imu_samples};
use crate::path::tracking::{PoseNoise, reported};
use crate::path::{CameraPath, Trajectory, orbit_stations};
use crate::render::camera::SimCamera;
use crate::render::sky::LinearImage;
use crate::render::{self, GroundTruth};
use crate::scene::Scene;
use crate::sensor::SensorModel;

/// How to look at a scene. `SimOptions::default()` is a walk with an exact sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct SimOptions {
    /// Width and height of depth images. Default 640x480.
    pub size: (usize, usize),
    /// Width and height of colour images, of which depth covers the middle; those of depth unless given.
    pub colour_size: Option<(usize, usize)>,
    /// Full horizontal field of view of the depth camera, radians. `None`: the scene's own camera ([`Scene::camera`]), which for
    /// most is 1.1 (63 degrees).
    pub field_of_view: Option<f64>,
    /// Lens of both cameras, OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6. Default none.
    pub lens: [f64; 8],
    /// Frames there are. Default 30.
    pub frames: usize,
    /// Frames a second. Default 30.
    pub frame_rate: f64,
    /// The camera's way. Default [`CameraPath::Auto`].
    pub path: CameraPath,
    /// Which of the scene's places orbits circle; its first unless given.
    pub place: Option<String>,
    /// What the sensor does to depth. Default nothing.
    pub sensor: SensorModel,
    /// Metres per step of `u16` depth. `None`: `f32` metres where the sensor is exact, and where it is not, the scene's own step or
    /// 1/5000 m.
    pub unit: Option<f64>,
    /// Errors of reported poses. Default none.
    pub pose_noise: PoseNoise,
    /// The inertial sensor. Default exact, 200 Hz.
    pub imu: ImuModel,
    /// Colour is the mean of this many squared rays a pixel. Default 1.
    pub samples: u32,
    /// Whether frames have colour. Default true.
    pub colour: bool,
    /// Columns of the environment maps that [`crate::write_recording`] writes, one for each place; 0: none. Default 512.
    pub environment: usize,
    /// The same seed gives the same bytes. Default 0.
    pub seed: u64,
}

impl Default for SimOptions {
    fn default() -> Self {
        Self {
            size: (640, 480),
            colour_size: None,
            field_of_view: None,
            lens: [0.0; 8],
            frames: 30,
            frame_rate: 30.0,
            path: CameraPath::Auto,
            place: None,
            sensor: SensorModel::default(),
            unit: None,
            pose_noise: PoseNoise::NONE,
            imu: ImuModel::EXACT,
            samples: 1,
            colour: true,
            environment: 512,
            seed: 0,
        }
    }
}

/// The step of the TUM data set, metres, as readers hold it.
pub(crate) const TUM_UNIT: f64 = 0.000_2_f32 as f64;

/// One frame and its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct SimFrame {
    /// Its number, from 0.
    pub index: usize,
    /// Nanoseconds since frame 0.
    pub time: i64,
    /// Where the camera is: camera-to-world.
    pub pose: Rigid,
    /// Where its tracker says it is.
    pub reported_pose: Rigid,
    /// Exact depth, normals and segments, through the depth camera's lens.
    pub truth: GroundTruth,
    /// z depth as sensed, metres, not yet rounded to the unit; 0 in holes.
    pub depth: Vec<f64>,
    /// Confidence, when the sensor tells: 0 to 255.
    pub confidence: Option<Vec<u8>>,
    /// Linear colour, as the colour camera sees it; no pixels when colour is off.
    pub radiance: LinearImage,
}

impl SimFrame {
    /// Sensed depth in `u16` steps of `unit` metres; 0 in holes and beyond 65534 steps.
    #[must_use]
    pub fn depth_u16(&self, unit: f64) -> Vec<u16> {
        let steps = |z: f64| {
            let n = libm::round(z / unit);
            if (1.0..65_535.0).contains(&n) { n as u16 } else { 0 }
        };
        self.depth.iter().map(|&z| steps(z)).collect()
    }

    /// Sensed depth rounded to `f32` metres; 0 in holes.
    #[must_use]
    pub fn depth_f32(&self) -> Vec<f32> {
        self.depth.iter().map(|&z| z as f32).collect()
    }
}

/// A scene, a way through it, and a sensor.
///
/// ```
/// use isobath_sim::{SimOptions, Simulation};
/// let options = SimOptions { size: (64, 48), frames: 2, sensor: "kinect".parse()?, ..SimOptions::default() };
/// let simulation = Simulation::open("living-room", options)?;
/// for frame in simulation.iter() {
///     assert!(frame.depth[20 * 64 + 30] > 1.0 && frame.truth.segments[20 * 64 + 30] > 0);
/// }
/// # Ok::<(), isobath_sim::SimError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Simulation {
    scene: Arc<Scene>,
    options: SimOptions,
    depth_camera: SimCamera,
    colour_camera: SimCamera,
    way: Way,
}

#[derive(Debug, Clone)]
enum Way {
    Smooth(Box<Trajectory>),
    Stations(Vec<Rigid>),
}

impl Simulation {
    /// A named scene, or one in a `.toml` file.
    ///
    /// # Errors
    /// Those of [`Scene::open`] and [`Self::new`].
    pub fn open(scene: &str, options: SimOptions) -> Result<Self, SimError> {
        Self::new(Arc::new(Scene::open(scene)?), options)
    }

    /// From a scene.
    ///
    /// # Errors
    /// [`SimError::Option`] for a size, rate, unit, camera or place that can't be.
    pub fn new(scene: Arc<Scene>, options: SimOptions) -> Result<Self, SimError> {
        let (width, height) = options.size;
        let mut depth_camera = match options.field_of_view {
            Some(angle) => SimCamera::from_fov(width, height, angle)?,
            None => scene.camera(width, height)?,
        };
        depth_camera.lens = options.lens;
        depth_camera.check()?;
        let (colour_width, colour_height) = options.colour_size.unwrap_or(options.size);
        if colour_width == 0 || colour_height == 0 {
            return Err(SimError::option("colour images have no pixels; leave their size out, or turn colour off"));
        }
        let colour_camera = depth_camera.colour_around(colour_width, colour_height);
        colour_camera.check()?;
        if !(options.frame_rate > 0.0 && options.frame_rate <= 1e6) {
            return Err(SimError::option(format!(
                "{} frames a second can't be simulated; give more than 0, at most a million",
                options.frame_rate
            )));
        }
        if options.samples == 0 || options.samples > 16 {
            return Err(SimError::option(format!("{} samples; give 1 to 16", options.samples)));
        }
        if let Some(unit) = options.unit
            && !(1e-6..=10.0).contains(&unit)
        {
            return Err(SimError::option(format!(
                "a depth unit of {unit} m is not usable; millimetres are 0.001, the TUM data set's steps 0.0002"
            )));
        }
        if options.environment > 8192 {
            return Err(SimError::option(format!(
                "environment maps {} wide are too large; give at most 8192 columns",
                options.environment
            )));
        }
        let place = place(&scene, options.place.as_deref())?;
        let view = scene.view();
        let still = Trajectory::still(view.eye, view.target);
        let way = match options.path {
            CameraPath::Auto if scene.moves() => Way::Smooth(Box::new(still)),
            CameraPath::Still => Way::Smooth(Box::new(still)),
            CameraPath::Auto | CameraPath::Walk => Way::Smooth(Box::new(Trajectory::walk(view))),
            CameraPath::Shake => Way::Smooth(Box::new(Trajectory::shake(view.eye, view.target))),
            CameraPath::Orbit => Way::Smooth(Box::new(Trajectory::orbit(place, 0.3 * 1.7, 0.8 * 1.7, 8.0, 0.0))),
            CameraPath::Stations => Way::Stations(orbit_stations(place)),
        };
        Ok(Self { scene, options, depth_camera, colour_camera, way })
    }

    /// The same with a trajectory of one's own.
    #[must_use]
    pub fn along(self, trajectory: Trajectory) -> Self {
        Self { way: Way::Smooth(Box::new(trajectory)), ..self }
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What was asked for.
    #[must_use]
    pub const fn options(&self) -> &SimOptions {
        &self.options
    }

    /// The depth camera, lens included.
    #[must_use]
    pub const fn depth_camera(&self) -> &SimCamera {
        &self.depth_camera
    }

    /// The colour camera, lens included.
    #[must_use]
    pub const fn colour_camera(&self) -> &SimCamera {
        &self.colour_camera
    }

    /// Frames there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.options.frames
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.options.frames == 0
    }

    /// Nanoseconds of a frame since frame 0.
    #[must_use]
    pub fn time(&self, index: usize) -> i64 {
        libm::round(index as f64 * 1e9 / self.options.frame_rate) as i64
    }

    /// Where the camera is in a frame: camera-to-world.
    #[must_use]
    pub fn pose(&self, index: usize) -> Rigid {
        match &self.way {
            Way::Smooth(t) => t.at(self.time(index) as f64 * 1e-9).pose,
            Way::Stations(stations) => stations.get(index % stations.len().max(1)).copied().unwrap_or(Rigid::IDENTITY),
        }
    }

    /// The smooth trajectory, when there is one.
    #[must_use]
    pub const fn trajectory(&self) -> Option<&Trajectory> {
        match &self.way {
            Way::Smooth(t) => Some(t),
            Way::Stations(_) => None,
        }
    }

    /// The IMU's readings from the first frame to the last; none for [`CameraPath::Stations`].
    #[must_use]
    pub fn imu(&self) -> Vec<ImuSample> {
        let seconds = self.time(self.len().saturating_sub(1)) as f64 * 1e-9;
        self.trajectory().map_or_else(Vec::new, |t| imu_samples(t, &self.options.imu, self.options.seed, seconds))
    }

    /// A frame, by its number from 0; also beyond [`Self::len`].
    #[must_use]
    pub fn frame(&self, index: usize) -> SimFrame {
        let time = self.time(index);
        let pose = self.pose(index);
        let world = self.scene.at(time as f64 * 1e-9);
        let shared = self.depth_camera == self.colour_camera && self.options.samples == 1;
        let (truth, colour) = render::see(&world, &self.depth_camera, &pose, self.options.colour && shared);
        let radiance = match colour {
            Some(image) => image,
            None if self.options.colour => render::colour(&world, &self.colour_camera, &pose, self.options.samples),
            None => LinearImage::default(),
        };
        let sensed = self.options.sensor.sense(&truth, &self.depth_camera, self.options.seed, index as u64);
        let step = 1.0 / self.options.frame_rate;
        let reported_pose = reported(&pose, &self.options.pose_noise, self.options.seed, index as u64, step);
        SimFrame { index, time, pose, reported_pose, truth, depth: sensed.z, confidence: sensed.confidence, radiance }
    }

    /// Metres per step of `u16` depth, as written and as [`crate::SimSource`] gives it: a number that `f32` holds.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.options.unit.or(self.scene.unit).map_or(TUM_UNIT, |u| f64::from(u as f32))
    }

    /// A frame's linear colour as sRGB bytes at the scene's exposure.
    #[must_use]
    pub fn rgb(&self, frame: &SimFrame) -> Vec<[u8; 3]> {
        let e = self.scene.exposure() as f32;
        let pixels = frame.radiance.pixels.par_iter().with_min_len(4096);
        pixels.map(|p| p.map(|v| render::srgb::encode(v * e))).collect()
    }

    /// All frames, first to last.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = SimFrame> + '_ {
        (0..self.len()).map(|i| self.frame(i))
    }
}

/// The named place, or the scene's first, or what it is looked at.
fn place(scene: &Scene, name: Option<&str>) -> Result<V3, SimError> {
    let Some(name) = name else {
        return Ok(scene.places().values().next().copied().unwrap_or(scene.view().target));
    };
    scene.places().get(name).copied().ok_or_else(|| {
        let known: Vec<&str> = scene.places().keys().map(String::as_str).collect();
        SimError::option(format!("{} has no place {name:?}; its places are {}", scene.name(), known.join(", ")))
    })
}
