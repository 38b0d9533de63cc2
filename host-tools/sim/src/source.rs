//! A simulated scene as a depth source, so that a program reads `sim:living-room` as it reads a camera or a recording.

use std::path::PathBuf;

use isobath::glam::{Quat, Vec3};
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::rectify::rectify;
use isobath::sensing::camera::{Camera, Distortion, Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath_source::{Deadline, DepthSource, Outcome, OwnedFrame, Recording, SourceError, SourceInfo};

use crate::error::SimError;
use crate::maths::{Rigid, V3};
use crate::render::camera::SimCamera;
use crate::simulation::{SimOptions, Simulation};

/// A simulation read frame by frame. Depth is `f32` metres where the sensor is exact and no unit was asked for, `u16` otherwise; the
/// pose is the reported one; a lens is straightened, as recordings' readers do.
///
/// ```
/// use isobath_sim::{SimOptions, SimSource};
/// use isobath_source::{Deadline, DepthSource, Outcome, OwnedFrame};
/// let options = SimOptions { size: (32, 24), path: isobath_sim::CameraPath::Still, ..SimOptions::default() };
/// let mut source = SimSource::open("wall", options)?;
/// let mut frame = OwnedFrame::new();
/// assert_eq!(source.next_into(&mut frame, Deadline::NEVER)?, Outcome::Frame);
/// assert!((frame.z(16, 12) - 2.0).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct SimSource {
    simulation: Simulation,
    info: SourceInfo,
    intrinsics: Intrinsics,
    unit: Option<DepthUnit>,
    next: usize,
}

/// The core's intrinsics.
pub(crate) fn intrinsics(camera: &SimCamera) -> Result<Intrinsics, SimError> {
    Intrinsics::new(camera.fx as f32, camera.fy as f32, camera.cx as f32, camera.cy as f32)
        .map_err(|e| SimError::option(e.to_string()))
}

/// The core's vector, rounded to `f32`.
#[must_use]
pub fn core_vec3(v: V3) -> Vec3 {
    Vec3::from(v.to_f32())
}

/// The core's pose, rounded to `f32`; `None` for one that is not finite.
#[must_use]
pub fn core_pose(pose: &Rigid) -> Option<Pose> {
    let [x, y, z, w] = pose.rotation.quaternion().map(|v| v as f32);
    Pose::new(Quat::from_xyzw(x, y, z, w), core_vec3(pose.translation)).ok()
}

impl SimSource {
    /// Opens a named scene, or one in a `.toml` file; `sim:` before it is left out.
    ///
    /// # Errors
    /// Those of [`Simulation::open`].
    pub fn open(scene: &str, options: SimOptions) -> Result<Self, SimError> {
        Self::new(Simulation::open(scene.strip_prefix("sim:").unwrap_or(scene), options)?)
    }

    /// From a simulation.
    ///
    /// # Errors
    /// [`SimError::Option`] when camera or unit don't fit the core's types.
    pub fn new(simulation: Simulation) -> Result<Self, SimError> {
        let options = simulation.options();
        let intrinsics = intrinsics(simulation.depth_camera())?;
        let unit = (options.unit.is_some() || !options.sensor.is_none()).then(|| simulation.unit());
        let unit = unit.map(|u| DepthUnit::new(u as f32)).transpose().map_err(|e| SimError::option(e.to_string()))?;
        let mut notes = vec![simulation.scene().about().to_owned(), format!("sensor: {}", options.sensor)];
        if options.lens != [0.0; 8] {
            notes.push("depth and colour are straightened by the lens model".into());
        }
        let info = SourceInfo {
            kind: "simulated scene".into(),
            path: PathBuf::from(format!("sim:{}", simulation.scene().name())),
            size: Some(options.size),
            intrinsics,
            up: Some(Vec3::Y),
            has_colour: options.colour,
            has_poses: true,
            notes,
        };
        Ok(Self { simulation, info, intrinsics, unit, next: 0 })
    }

    /// The simulation, for its ground truth: frame n of the source is its frame n.
    #[must_use]
    pub const fn simulation(&self) -> &Simulation {
        &self.simulation
    }
}

/// Straightens an image in place: pixels that the lens does not show get `hole`.
fn straighten<T: Copy>(pixels: &mut [T], camera: &SimCamera, hole: T) {
    let (Ok(intrinsics), true) = (intrinsics(camera), camera.lens != [0.0; 8]) else { return };
    let distortion = Distortion::Brown8(camera.lens.map(|k| k as f32));
    let seen = pixels.to_vec();
    let (Ok(from), Ok(mut to)) =
        (ImageView::new(&seen, camera.width, camera.height), ImageViewMut::new(pixels, camera.width, camera.height))
    else {
        return;
    };
    rectify(from, &Camera { intrinsics, distortion }, &intrinsics, hole, &mut to);
}

impl DepthSource for SimSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, _deadline: Deadline) -> Result<Outcome, SourceError> {
        if self.next >= self.simulation.len() {
            return Ok(Outcome::EndOfStream);
        }
        let sim = self.simulation.frame(self.next);
        let camera = *self.simulation.depth_camera();
        frame.clear();
        match self.unit {
            Some(unit) => {
                frame.unit = unit;
                let out = frame.depth_u16_mut(camera.width, camera.height);
                out.copy_from_slice(&sim.depth_u16(f64::from(unit.metres())));
                straighten(out, &camera, 0);
            }
            None => {
                frame.unit = DepthUnit::METRE;
                let out = frame.depth_f32_mut(camera.width, camera.height);
                out.copy_from_slice(&sim.depth_f32());
                straighten(out, &camera, 0.0);
            }
        }
        if let Some(confidence) = &sim.confidence {
            let out = frame.confidence_mut();
            out.copy_from_slice(confidence);
            straighten(out, &camera, 0);
        }
        if self.simulation.options().colour {
            let colour = *self.simulation.colour_camera();
            let out = frame.colour_mut(colour.width, colour.height);
            out.copy_from_slice(&self.simulation.rgb(&sim));
            straighten(out, &colour, [0; 3]);
        }
        frame.intrinsics = self.intrinsics;
        frame.pose = core_pose(&sim.reported_pose);
        frame.time = Timestamp::from_nanos(sim.time);
        frame.sequence = self.next as u64;
        self.next += 1;
        Ok(Outcome::Frame)
    }
}

impl Recording for SimSource {
    fn len(&self) -> usize {
        self.simulation.len()
    }

    fn position(&self) -> usize {
        self.next
    }

    fn set_position(&mut self, index: usize) {
        self.next = index;
    }
}
