//! What cameras see of a simulated scene: the observations of the lighting paper, rendered once and used by every row.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use isobath::glam::Vec3;
use isobath::ground::colour::Colour;
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::lighting::policy::guided::{Directions, Guide, GuideParams};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::frame::DepthFrame;
use isobath_sim::{LinearImage, Rigid, Scene, SimCamera, V3, core_pose, v3};

use crate::BenchError;
use crate::input::vec3;

/// Horizontal field of view of all cameras, radians: a phone's.
pub(super) const FIELD: f64 = 1.1;
/// Size of the frames taken by guided movement: four pixels for each of the 32 x 24 samples.
pub(super) const FAR: (usize, usize) = (64, 48);

/// A frame as a phone gives it: 16-bit depth (1/5000 m), 8-bit colour, a pose.
#[derive(Debug, Clone)]
pub(super) struct Sight {
    depth: Vec<u16>,
    rgb: Vec<[u8; 3]>,
    size: (usize, usize),
    intrinsics: Intrinsics,
    pub(super) pose: Pose,
}

impl Sight {
    /// Renders a view, one ray a pixel.
    pub(super) fn new(scene: &Scene, size: (usize, usize), pose: &Rigid) -> Result<Self, BenchError> {
        let camera = SimCamera::from_fov(size.0, size.1, FIELD)?;
        let (truth, colour) = scene.render(0.0, &camera, pose);
        let unit = f64::from(DepthUnit::TUM.metres());
        let depth = truth.z.iter().map(|z| Some((z / unit).round()).filter(|d| *d < 65_535.0).map_or(0, |d| d as u16));
        Ok(Self {
            depth: depth.collect(),
            rgb: scene.to_srgb(&colour),
            size,
            intrinsics: Intrinsics::from_fov(FIELD as f32, size.0, size.1)?,
            pose: core_pose(pose).unwrap_or_default(),
        })
    }

    /// As it came, at a time.
    pub(super) fn frame(&self, number: u64) -> Result<DepthFrame<'_>, BenchError> {
        let (w, h) = self.size;
        let depth = ImageView::new(&self.depth, w, h).map_err(BenchError::core)?;
        let colour = ImageView::new(&self.rgb, w, h).map_err(BenchError::core)?;
        let frame = DepthFrame::new(depth, DepthUnit::TUM, self.intrinsics).with_colour(colour);
        let time = Timestamp::from_nanos(i64::try_from(number).unwrap_or(0) * 33_333_333);
        Ok(frame.map_err(BenchError::core)?.with_pose(self.pose).with_time(time, number))
    }

    /// Its mean colour, linear: what a sensor of ambient light reads.
    pub(super) fn ambient(&self) -> [f32; 3] {
        let mut sum = [0.0_f64; 3];
        for pixel in &self.rgb {
            for (sum, v) in sum.iter_mut().zip(pixel.linear()) {
                *sum += f64::from(v);
            }
        }
        sum.map(|s| (s / self.rgb.len().max(1) as f64) as f32)
    }

    /// The same pixels, each `n` x `n` times: a large frame, for timing.
    pub(super) fn enlarged(&self, n: usize) -> Result<Self, BenchError> {
        fn enlarge<T: Copy>(pixels: &[T], (w, h): (usize, usize), n: usize) -> Vec<T> {
            (0..h * n * w * n).filter_map(|i| pixels.get(i / (w * n) / n * w + i % (w * n) / n).copied()).collect()
        }
        let size = (self.size.0 * n, self.size.1 * n);
        Ok(Self {
            depth: enlarge(&self.depth, self.size, n),
            rgb: enlarge(&self.rgb, self.size, n),
            size,
            intrinsics: Intrinsics::from_fov(FIELD as f32, size.0, size.1)?,
            pose: self.pose,
        })
    }

    /// The same at dusk.
    pub(super) fn darkened(&self) -> Self {
        Self { rgb: self.rgb.iter().map(|p| p.map(|v| v / 2)).collect(), ..self.clone() }
    }

    /// As a tracker that errs would have it.
    pub(super) fn moved(&self, pose: Pose) -> Self {
        Self { pose, ..self.clone() }
    }
}

/// Where guided movement has the user look: away from the object, straight back first; the first 1, 3, 5 or 9 are that many's. Cameras at the observer's place.
pub(super) fn guided(observer: V3, at: V3) -> Result<Vec<Rigid>, BenchError> {
    let params = GuideParams { directions: Directions::Nine, ..GuideParams::default() };
    let guide = Guide::new(vec3(at), vec3(observer), Vec3::Y, params).map_err(BenchError::core)?;
    let towards = |d: &Vec3| observer + v3(f64::from(d.x), f64::from(d.y), f64::from(d.z));
    Ok(guide.directions().iter().map(|d| Rigid::looking_at(observer, towards(d))).collect())
}

/// What is seen from a point in all directions, in parts of a camera's white.
pub(super) fn panorama(scene: &Scene, at: V3, samples: u32) -> LinearImage {
    let exposure = scene.exposure() as f32;
    let map = scene.environment_map(0.0, at, super::SIZE.0, samples);
    LinearImage { pixels: map.pixels.iter().map(|p| p.map(|v| v * exposure)).collect(), ..map }
}

/// The same jobs on all cores; results in the jobs' order, or the first error met.
pub(super) fn in_parallel<T: Send>(
    jobs: usize,
    work: impl Fn(usize) -> Result<T, BenchError> + Sync,
) -> Result<Vec<T>, BenchError> {
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, Result<T, BenchError>)>> = Mutex::new(Vec::new());
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(jobs.max(1));
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let job = next.fetch_add(1, Ordering::Relaxed);
                    if job >= jobs {
                        break;
                    }
                    let result = work(job);
                    if let Ok(mut done) = done.lock() {
                        done.push((job, result));
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|d| d.0);
    done.into_iter().map(|d| d.1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guided_movement_looks_away_and_a_grid_apart() {
        let (observer, at) = (v3(0.0, 1.4, 1.0), v3(0.0, 0.5, 0.0));
        let views = guided(observer, at).unwrap();
        assert_eq!(views.len(), 9);
        let ahead = |r: &Rigid| r.rotation.z;
        let back = (observer - at).unit_or_up();
        assert!((ahead(&views[0]) - back).length() < 1e-6);
        for (i, view) in views.iter().enumerate() {
            assert!(view.translation == observer && ahead(view).dot(back) > 0.7, "{i}");
        }
    }

    #[test]
    fn jobs_come_back_in_order() {
        assert_eq!(in_parallel(50, Ok).unwrap(), (0..50).collect::<Vec<_>>());
        assert!(in_parallel(0, Ok).unwrap().is_empty());
        let failed = in_parallel(5, |i| if i == 3 { Err(BenchError::core("x")) } else { Ok(i) });
        assert!(failed.is_err());
    }

    #[test]
    fn a_sight_is_a_frame() {
        let scene = Scene::open("wall").unwrap();
        let pose = Rigid::looking_at(v3(0.0, 1.0, 0.0), v3(0.0, 1.0, -1.0));
        let sight = Sight::new(&scene, (16, 12), &pose).unwrap();
        let frame = sight.frame(1).unwrap();
        assert!((frame.z(8, 6) - 2.0).abs() < 1e-3 && frame.pose().is_some());
        let large = sight.enlarged(2).unwrap();
        assert_eq!(large.frame(0).unwrap().size(), (32, 24));
        assert_eq!(large.rgb[33], sight.rgb[0]);
        assert!(sight.ambient().iter().all(|v| *v > 0.0 && *v < 1.0));
    }
}
