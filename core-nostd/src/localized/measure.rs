//! How far, how high, how flat, and with which error?
//!
//! DepthLab lists "distance" and "measurement" among the uses of localized depth; it gives no error. Here every length is a
//! [`Measured`]: a value and its standard deviation, to first order from [`DepthNoise`]. A reading errs along its ray only:
//! the pixel is taken as exact, so sigma(point) = sigma(z) * range / z in the ray's direction. Readings err independently.
//!
//! Memory: no state; 28 bytes a point. Cost: a handful of operations, a patch of radius r fits two planes over (2r + 1)²
//! pixels. Error of the error bars: within 10 % of what repetition shows, held by a test.

use core::fmt;

use glam::{Vec2, Vec3};

use crate::ground::geometry::unit;
use crate::ground::math;
use crate::localized::plane::local::LocalSum;
use crate::localized::plane::{PlaneError, PlaneEstimate};
use crate::sensing::depth::DepthSample;
use crate::sensing::depth::noise::DepthNoise;
use crate::sensing::frame::DepthFrame;

/// A length and its error bar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Metres.
    pub value: f32,
    /// Standard deviation, metres.
    pub sigma: f32,
}

/// A world point with its error bar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredPoint {
    /// World point, metres.
    pub point: Vec3,
    /// Direction in which it errs: unit, world, away from the camera. Zero for a point without error.
    pub ray: Vec3,
    /// Standard deviation along it, metres.
    pub sigma: f32,
}

impl MeasuredPoint {
    /// A point that is known, such as a virtual object's.
    #[must_use]
    pub const fn exact(point: Vec3) -> Self {
        Self { point, ray: Vec3::ZERO, sigma: 0.0 }
    }
}

/// Distance from the camera to what a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraDistance {
    /// Along the optical axis.
    pub z: Measured,
    /// Along the ray.
    pub range: Measured,
}

/// The world point of a pixel; `None` outside the image and in holes.
#[must_use]
pub fn measure_point<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    noise: &DepthNoise,
) -> Option<MeasuredPoint> {
    let MeasuredPoint { point, ray, sigma } = in_camera(frame, x, y, noise)?;
    let pose = frame.pose_or_identity();
    Some(MeasuredPoint { point: pose.to_world(point), ray: pose.direction_to_world(ray), sigma })
}

/// As [`measure_point`], in the camera's frame.
fn in_camera<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    noise: &DepthNoise,
) -> Option<MeasuredPoint> {
    let distance = to_camera(frame, x, y, noise)?;
    let ray = frame.intrinsics().ray(Vec2::new(x as f32, y as f32)).try_normalize()?;
    Some(MeasuredPoint { point: frame.point(x, y)?, ray, sigma: distance.range.sigma })
}

/// The distance to what a pixel sees; `None` outside the image and in holes.
///
/// ```
/// use isobath::localized::measure::to_camera;
/// use isobath::sensing::{camera::Intrinsics, depth::{noise::DepthNoise, DepthArray, DepthUnit}, frame::DepthFrame};
/// let wall = DepthArray::<160, 120>::filled(2000);
/// let frame = DepthFrame::new(wall.view(), DepthUnit::MILLIMETRE, Intrinsics::new(100.0, 100.0, 60.0, 60.0)?);
/// let d = to_camera(&frame, 135, 60, &DepthNoise::KINECT).unwrap();
/// assert!((d.z.value - 2.0).abs() < 1e-6 && (d.range.value - 2.5).abs() < 1e-6);
/// assert!((d.range.sigma / d.z.sigma - 1.25).abs() < 1e-5);
/// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
/// ```
#[must_use]
pub fn to_camera<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    noise: &DepthNoise,
) -> Option<CameraDistance> {
    let z = frame.z(x, y);
    if !(z > 0.0) {
        return None;
    }
    let sigma = noise.sigma::<D>(z, frame.unit());
    let slant = frame.intrinsics().ray(Vec2::new(x as f32, y as f32)).length();
    Some(CameraDistance { z: Measured { value: z, sigma }, range: Measured { value: z * slant, sigma: sigma * slant } })
}

/// The distance between two points. Below the size of its own error bar it is biased upwards, as a length can't be negative.
#[must_use]
pub fn between(a: &MeasuredPoint, b: &MeasuredPoint) -> Measured {
    let d = b.point - a.point;
    let value = d.length();
    // Coinciding points have no direction: any may be the one in which they err.
    let along = |p: &MeasuredPoint| d.try_normalize().map_or(p.ray.length(), |e| e.dot(p.ray)) * p.sigma;
    let (sa, sb) = (along(a), along(b));
    Measured { value, sigma: math::sqrt(sa * sa + sb * sb) }
}

/// Signed height of a point over a fitted plane, positive on the normal's side; point and plane taken as independent.
#[must_use]
pub fn height_above(point: &MeasuredPoint, ground: &PlaneEstimate) -> Measured {
    let own = ground.plane.normal().dot(point.ray) * point.sigma;
    let plane = ground.sigma_at(point.point);
    Measured { value: ground.plane.distance(point.point), sigma: math::sqrt(own * own + plane * plane) }
}

/// Which pixels around the middle belong to a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchParams {
    /// Half the window's side, pixels, 1 or more; the window is (2 radius + 1)² pixels. Default 5.
    pub radius: u16,
    /// Pixels further from the middle one's depth than this share of it are another surface, above 0. Default 0.1.
    pub max_jump: f32,
}

impl Default for PatchParams {
    fn default() -> Self {
        Self { radius: 5, max_jump: 0.1 }
    }
}

/// The plane of a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// In the world, normal towards the camera, with its error bars.
    pub fit: PlaneEstimate,
    /// The residual that noise alone would leave, metres; a [`PlaneEstimate::rms`] well above it says the patch is not flat.
    pub expected_rms: f32,
}

/// Why there is no patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PatchError {
    /// The middle pixel is a hole.
    NoDepth,
    /// The middle pixel is outside the image.
    OutsideView,
    /// The readings give no plane.
    NoPlane(PlaneError),
}

impl fmt::Display for PatchError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoDepth => write!(f, "the patch's middle pixel has no depth"),
            Self::OutsideView => write!(f, "the patch's middle pixel is outside the image"),
            Self::NoPlane(e) => write!(f, "the patch has no plane: {e}"),
        }
    }
}

impl core::error::Error for PatchError {}

/// Fits a plane to the surface around a pixel: once to all near readings, then to those within three residuals of it.
///
/// # Errors
/// [`PatchError`] when the middle has no depth or the readings give no plane.
pub fn patch<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    noise: &DepthNoise,
    params: &PatchParams,
) -> Result<Patch, PatchError> {
    let (w, h) = frame.size();
    if x >= w || y >= h {
        return Err(PatchError::OutsideView);
    }
    let z0 = frame.z(x, y);
    if !(z0 > 0.0) {
        return Err(PatchError::NoDepth);
    }
    let radius = usize::from(params.radius);
    let pixels = || {
        (y.saturating_sub(radius)..y.saturating_add(radius + 1).min(h))
            .flat_map(move |j| (x.saturating_sub(radius)..x.saturating_add(radius + 1).min(w)).map(move |i| (i, j)))
    };
    // All in the camera's frame, moved to the world at the end: world points far from the origin are rounded.
    let side = -frame.point(x, y).ok_or(PatchError::NoDepth)?;
    let near = |z: f32| (z - z0).abs() <= params.max_jump * z0;
    let mut sum = LocalSum::new(unit(side).ok_or(PatchError::NoDepth)?);
    for (i, j) in pixels().filter(|&(i, j)| near(frame.z(i, j))) {
        if let Some(p) = frame.point(i, j) {
            sum.add(p);
        }
    }
    let rough = sum.fit(side).map_err(PatchError::NoPlane)?;
    // Never narrower than the depth's own step, or a flat, quantised patch would lose half its points.
    let band = (3.0 * rough.rms).max(frame.unit().metres()).max(1e-5 * z0);
    let mut sum = LocalSum::new(rough.plane.normal());
    let (mut expected, mut used) = (0.0, 0.0);
    for (i, j) in pixels().filter(|&(i, j)| near(frame.z(i, j))) {
        let Some(m) = in_camera(frame, i, j, noise) else { continue };
        if rough.plane.distance(m.point).abs() <= band {
            sum.add(m.point);
            let off = rough.plane.normal().dot(m.ray) * m.sigma;
            expected += off * off;
            used += 1.0;
        }
    }
    let fit = sum.fit(side).map_err(PatchError::NoPlane)?;
    let fit = fit.transformed(&frame.pose_or_identity());
    Ok(Patch { fit, expected_rms: math::sqrt(expected / used) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::geometry::Plane;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::{Intrinsics, Pose};
    use crate::sensing::depth::DepthUnit;
    use std::vec;
    use std::vec::Vec;

    const NOISE: DepthNoise = DepthNoise::KINECT;

    fn gauss(s: &mut u64) -> f32 {
        let mut sum = 0.0;
        for _ in 0..12 {
            *s ^= *s << 13;
            *s ^= *s >> 7;
            *s ^= *s << 17;
            sum += (*s >> 40) as f32 / 16_777_216.0;
        }
        sum - 6.0
    }

    fn camera() -> Intrinsics {
        Intrinsics::new(60.0, 60.0, 31.5, 23.5).unwrap()
    }

    /// A slanted plane, seen with noise.
    fn depth(noisy: bool, s: &mut u64) -> Vec<f32> {
        let plane = Plane::through(Vec3::Z * 2.0, Vec3::new(0.3, -0.5, -1.0)).unwrap();
        (0..64 * 48)
            .map(|i| {
                let ray = camera().ray(Vec2::new((i % 64) as f32, (i / 64) as f32));
                let z = plane.offset() / plane.normal().dot(ray);
                if noisy { z + NOISE.sigma::<u16>(z, DepthUnit::MILLIMETRE) * gauss(s) } else { z }
            })
            .collect()
    }

    fn with<R>(data: &[f32], f: impl FnOnce(&DepthFrame<'_, f32>) -> R) -> R {
        let pose = Pose::looking_at(Vec3::new(1.0, 2.0, 3.0), Vec3::ZERO, Vec3::Y).unwrap();
        // Values in millimetres, so that the unit's rounding is that of the noise model.
        let data: Vec<f32> = data.iter().map(|z| z * 1000.0).collect();
        f(&DepthFrame::new(ImageView::new(&data, 64, 48).unwrap(), DepthUnit::MILLIMETRE, camera()).with_pose(pose))
    }

    #[test]
    fn error_bars_are_what_repetition_shows() {
        let mut s = 7;
        let ask = |f: &DepthFrame<'_, f32>| {
            let (a, b) = (measure_point(f, 10, 10, &NOISE).unwrap(), measure_point(f, 50, 40, &NOISE).unwrap());
            let ground = patch(f, 32, 20, &NOISE, &PatchParams { radius: 8, max_jump: 0.5 }).unwrap();
            [between(&a, &b), to_camera(f, 50, 40, &NOISE).unwrap().range, height_above(&b, &ground.fit)]
        };
        let clean = with(&depth(false, &mut s), ask);
        let mut spread = [(0.0_f64, 0.0_f64); 3];
        let reps = 1000;
        for _ in 0..reps {
            let seen = with(&depth(true, &mut s), ask);
            for ((v, m), t) in spread.iter_mut().zip(seen).zip(clean) {
                v.0 += f64::from(m.value - t.value).powi(2) / f64::from(reps);
                v.1 += f64::from(m.sigma) / f64::from(reps);
            }
        }
        for (seen, said) in spread {
            assert!((seen.sqrt() / said - 1.0).abs() < 0.1, "seen {}, said {said}", seen.sqrt());
        }
    }

    #[test]
    fn a_patch_ignores_what_lies_behind_it() {
        let mut s = 1;
        let mut data = depth(false, &mut s);
        let clean = with(&data, |f| patch(f, 32, 24, &NOISE, &PatchParams::default()).unwrap());
        assert!(clean.fit.rms < 1e-5 && clean.expected_rms > 0.003, "{clean:?}");
        for row in data.chunks_mut(64) {
            row[34..].fill(3.0);
        }
        let cut = with(&data, |f| patch(f, 32, 24, &NOISE, &PatchParams::default()).unwrap());
        assert!((cut.fit.plane.normal() - clean.fit.plane.normal()).length() < 1e-4);
        assert!(cut.fit.support < clean.fit.support);
    }

    #[test]
    fn exact_and_coinciding_points() {
        let a = MeasuredPoint::exact(Vec3::X);
        let b = MeasuredPoint { point: Vec3::X, ray: Vec3::Z, sigma: 0.03 };
        assert_eq!(between(&a, &b), Measured { value: 0.0, sigma: 0.03 });
        assert_eq!(between(&a, &MeasuredPoint::exact(Vec3::ZERO)), Measured { value: 1.0, sigma: 0.0 });
        // Across the ray a reading's error does not lengthen a distance to first order.
        let side = between(&MeasuredPoint::exact(Vec3::ZERO), &b);
        assert_eq!(side, Measured { value: 1.0, sigma: 0.0 });
    }

    #[test]
    fn hostile_frames_get_reasons() {
        let p = PatchParams { radius: u16::MAX, max_jump: f32::NAN };
        for (w, h) in [(0, 0), (1, 7), (7, 1)] {
            let data: Vec<f32> = vec![1.0; w * h];
            let f = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::METRE, camera());
            assert!(patch(&f, 0, 0, &NOISE, &p).is_err());
            assert!(patch(&f, 0, 0, &NOISE, &PatchParams::default()).is_err(), "a line has no plane");
            assert_eq!(patch(&f, usize::MAX, 0, &NOISE, &p), Err(PatchError::OutsideView));
            assert_eq!(measure_point(&f, 9, 9, &NOISE), None);
        }
        let holes = [f32::NAN; 9];
        let f = DepthFrame::new(ImageView::new(&holes, 3, 3).unwrap(), DepthUnit::METRE, camera());
        assert_eq!(patch(&f, 1, 1, &NOISE, &PatchParams::default()), Err(PatchError::NoDepth));
        assert_eq!(to_camera(&f, 1, 1, &NOISE), None);
    }
}
