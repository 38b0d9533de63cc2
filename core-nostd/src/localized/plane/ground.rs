//! The ground, or a dominant plane, of one frame.
//!
//! 1. Every n-th pixel gets a slope from its neighbours about 0.1 m away. Where inverse depth does not run straight through
//!    the three (it does on a plane), there is an edge and the pixel is left out.
//! 2. Level pixels vote for their height along *up* with the area (m²) they see, so that a near table does not outvote a
//!    far floor by being near. 256 bins on the stack, from the camera downwards.
//! 3. The ground is the *lowest* peak of enough area; a dominant plane the *largest* (of equals, the lowest). Up unknown: the votes first go for a direction
//!    within 45 degrees of a hint.
//! 4. Three rounds of least squares over the points near the plane, the band shrinking with the residual.
//!
//! Nothing is random: equal frames give equal answers.
//!
//! Memory: 1 kB of stack for heights, 2 kB more for directions. Cost: 5 depth reads a sample and 3 more a refinement,
//! 4800 samples by default. Error: on a noise-free floor under 1 mm and 0.1 degrees; with Kinect noise see the tests.

use core::fmt;

use glam::{Vec2, Vec3};

use super::PlaneEstimate;
use super::local::LocalSum;
use crate::ground::geometry::{Plane, unit};
use crate::ground::math;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;

/// Bins of the height histogram.
const BINS: usize = 256;
/// A peak is a bin and this many neighbours on each side: noise and a tilted *up* spread a floor over several.
const SIDE: usize = 2;
/// Share of its depth by which a pixel may lie off the straight line (in inverse depth) between its neighbours: four
/// standard deviations of a Kinect at 4 m.
const STRAIGHT: f32 = 0.03;
/// Cells of the direction histogram along each axis.
const DIRECTIONS: usize = 16;

/// What counts as ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundParams {
    /// Largest angle between a pixel's normal and up, radians, 0 to π/2. Default 0.44 (25°): noise included.
    pub max_angle: f32,
    /// Height of a bin, metres, above 0; the histogram reaches 256 of them below the camera. Default 0.02 (5.1 m).
    pub bin: f32,
    /// Least seen area of a surface, m². Default 0.1.
    pub min_area: f32,
    /// Least share of the largest peak's area, 0 to 1. Default 0.2: lower and a stray reflection below the floor is ground,
    /// higher and a strip of floor behind a large table isn't.
    pub min_share: f32,
    /// Pixels looked at, at most (about). Default 4800.
    pub max_samples: u32,
    /// Half the distance over which slope is measured, metres on the surface facing the camera. Default 0.1.
    pub reach: f32,
}

impl GroundParams {
    /// For rooms and a headset or phone.
    pub const DEFAULT: Self =
        Self { max_angle: 0.44, bin: 0.02, min_area: 0.1, min_share: 0.2, max_samples: 4800, reach: 0.1 };

    fn check(&self) -> Result<(), NoGround> {
        let ok = self.max_angle >= 0.0
            && self.max_angle <= core::f32::consts::FRAC_PI_2
            && self.bin > 0.0
            && self.bin.is_finite()
            && self.min_area >= 0.0
            && self.min_share >= 0.0
            && self.max_samples > 0
            && self.reach > 0.0;
        if ok { Ok(()) } else { Err(NoGround::BadParams) }
    }
}

impl Default for GroundParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A plane found in a frame, in world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundEstimate {
    /// The plane, normal on the up side, with its error bars (points taken as independent).
    pub fit: PlaneEstimate,
    /// Angle between the plane's normal and the up (or hint) it was asked with, radians.
    pub tilt: f32,
    /// Seen area that voted for it, m².
    pub area: f32,
    /// Pixels looked at (`done`) and left out (`skipped`).
    pub work: Work,
}

/// Why there is no ground.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum NoGround {
    /// Up (or the hint) has no direction.
    BadUp,
    /// A parameter is out of its documented range.
    BadParams,
    /// No pixel looked at has a reading and a slope.
    NoReadings,
    /// Nothing level is large enough.
    TooSmall {
        /// The largest level area seen, m².
        area: f32,
    },
    /// The points found give no plane near the direction asked for.
    NotFlat,
}

impl fmt::Display for NoGround {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadUp => write!(f, "the up direction has no length or is not finite"),
            Self::BadParams => write!(f, "a ground parameter is out of range; see GroundParams"),
            Self::NoReadings => write!(f, "no depth reading with a measurable slope in the frame"),
            Self::TooSmall { area } => {
                write!(f, "the largest level surface covers {area:.2} m², too little for ground")
            }
            Self::NotFlat => write!(f, "the level points found do not form a plane"),
        }
    }
}

impl core::error::Error for NoGround {}

/// The ground: the lowest level surface of enough area. `up` is in world coordinates, any length.
///
/// # Errors
/// [`NoGround`] with the reason.
///
/// ```
/// use glam::Vec3;
/// use isobath::localized::plane::ground::{estimate_ground, GroundParams, NoGround};
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// // A wall, seen square on: nothing level.
/// let wall = DepthArray::<64, 48>::filled(2000);
/// let frame = DepthFrame::new(wall.view(), DepthUnit::MILLIMETRE, Intrinsics::new(50.0, 50.0, 31.5, 23.5)?);
/// let up = Vec3::NEG_Y; // no pose: the world is the camera frame, y down
/// assert!(matches!(estimate_ground(&frame, up, &GroundParams::DEFAULT), Err(NoGround::TooSmall { .. })));
/// // Asked for what faces the camera, it is found.
/// let facing = isobath::localized::plane::ground::dominant_plane(&frame, Vec3::NEG_Z, &GroundParams::DEFAULT)?;
/// assert!((facing.fit.plane.offset() + 2.0).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn estimate_ground<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    up: Vec3,
    params: &GroundParams,
) -> Result<GroundEstimate, NoGround> {
    params.check()?;
    let up = frame.pose_or_identity().direction_to_camera(unit(up).ok_or(NoGround::BadUp)?);
    let sampler = Sampler::new(frame, params);
    let mut work = Work::default();
    let peak = sampler.height_peak(up, Choice::Lowest, &mut work)?;
    sampler.refine(up, peak, work)
}

/// The plane of largest seen area whose normal is within 45 degrees of `hint` (world, any length).
///
/// # Errors
/// [`NoGround`] with the reason.
pub fn dominant_plane<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    hint: Vec3,
    params: &GroundParams,
) -> Result<GroundEstimate, NoGround> {
    params.check()?;
    let hint = unit(hint).ok_or(NoGround::BadUp)?;
    let sampler = Sampler::new(frame, params);
    let mut work = Work::default();
    let up = sampler.direction_peak(frame.pose_or_identity().direction_to_camera(hint), &mut work)?;
    let peak = sampler.height_peak(up, Choice::Largest, &mut work)?;
    let found = sampler.refine(up, peak, work)?;
    Ok(GroundEstimate { tilt: math::acos(found.fit.plane.normal().dot(hint)), ..found })
}

#[derive(Clone, Copy, PartialEq)]
enum Choice {
    Lowest,
    Largest,
}

struct Peak {
    height: f32,
    area: f32,
}

/// A pixel that lies on something smooth: point and normal in the camera's frame, area seen (m²).
struct Facet {
    point: Vec3,
    normal: Vec3,
    area: f32,
}

/// Works in the camera's frame: world points far from the origin are rounded.
struct Sampler<'f, 'a, D: DepthSample> {
    frame: &'f DepthFrame<'a, D>,
    params: &'f GroundParams,
    step: usize,
}

impl<'f, 'a, D: DepthSample> Sampler<'f, 'a, D> {
    fn new(frame: &'f DepthFrame<'a, D>, params: &'f GroundParams) -> Self {
        let (w, h) = frame.size();
        let pixels = w as f32 * h as f32;
        let step = math::ceil(math::sqrt(pixels / params.max_samples as f32)).max(1.0) as usize;
        Self { frame, params, step }
    }

    fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + use<D> {
        let ((w, h), step) = (self.frame.size(), self.step.max(1));
        (step / 2..h).step_by(step).flat_map(move |y| (step / 2..w).step_by(step).map(move |x| (x, y)))
    }

    fn facet(&self, x: usize, y: usize) -> Option<Facet> {
        let k = self.frame.intrinsics();
        let z = self.frame.z(x, y);
        if !(z > 0.0) {
            return None;
        }
        let step = |f: f32| (self.params.reach * f.abs() / z).clamp(2.0, 32.0) as usize;
        let (sx, sy) = (step(k.fx()), step(k.fy()));
        let (left, right) = (self.frame.z(x.checked_sub(sx)?, y), self.frame.z(x + sx, y));
        let (above, below) = (self.frame.z(x, y.checked_sub(sy)?), self.frame.z(x, y + sy));
        let straight = |a: f32, b: f32| a > 0.0 && b > 0.0 && (0.5 * z * (1.0 / a + 1.0 / b) - 1.0).abs() < STRAIGHT;
        if !straight(left, right) || !straight(above, below) {
            return None;
        }
        let at = |x: usize, y: usize, z: f32| k.unproject(Vec2::new(x as f32, y as f32), z);
        let across = at(x + sx, y, right) - at(x - sx, y, left);
        let down = at(x, y + sy, below) - at(x, y - sy, above);
        let normal = across.cross(down).try_normalize()?;
        let point = at(x, y, z);
        let facing = normal.dot(point) / z;
        let normal = if facing > 0.0 { -normal } else { normal };
        // A pixel sees z²/(fx fy) square to the axis; slanted surfaces more, up to where noise decides.
        let area = z * z / (k.fx() * k.fy()).abs() / facing.abs().max(0.1) * (self.step * self.step) as f32;
        Some(Facet { point, normal, area })
    }

    fn height_peak(&self, up: Vec3, choice: Choice, work: &mut Work) -> Result<Peak, NoGround> {
        let level = math::cos(self.params.max_angle);
        let mut bins = [0.0_f32; BINS];
        let mut any = false;
        for (x, y) in self.pixels() {
            work.done = work.done.saturating_add(1);
            let Some(facet) = self.facet(x, y) else { continue };
            any = true;
            if facet.normal.dot(up) < level {
                continue;
            }
            // A surface that faces up and is seen lies below the camera.
            let bin = -up.dot(facet.point) / self.params.bin;
            if bin >= 0.0
                && let Some(cell) = bins.get_mut(bin as usize)
            {
                *cell += facet.area;
            }
        }
        let (w, h) = self.frame.size();
        let all = w.saturating_mul(h).min(u32::MAX as usize) as u32;
        work.skipped = all.saturating_sub(work.done);
        if !any {
            return Err(NoGround::NoReadings);
        }
        let sum = |i: usize| -> f32 {
            bins.get(i.saturating_sub(SIDE)..(i + SIDE + 1).min(BINS)).unwrap_or(&[]).iter().sum()
        };
        // From the lowest bin up; a peak must beat what is above it and all before it until it starts to fall.
        let largest = (0..BINS).map(sum).fold(0.0, f32::max);
        let needed = self.params.min_area.max(self.params.min_share * largest);
        if !(largest >= self.params.min_area && largest > 0.0) {
            return Err(NoGround::TooSmall { area: largest });
        }
        let mut best: Option<(usize, f32)> = None;
        for i in (0..BINS).rev() {
            let area = sum(i);
            match (choice, best) {
                (_, None) if area >= needed => best = Some((i, area)),
                // Climb to this surface's own top, and no further than its width, or a step would hide the floor below.
                (Choice::Lowest, Some((top, most))) if area > most && top - i <= SIDE => best = Some((i, area)),
                (Choice::Largest, Some((_, most))) if area > most => best = Some((i, area)),
                _ => {}
            }
        }
        let (i, area) = best.ok_or(NoGround::TooSmall { area: largest })?;
        // The window's mean height, finer than a bin.
        let (mut weight, mut mean) = (0.0, 0.0);
        for (j, &a) in bins.iter().enumerate().take((i + SIDE + 1).min(BINS)).skip(i.saturating_sub(SIDE)) {
            weight += a;
            mean += a * (j as f32 + 0.5);
        }
        Ok(Peak { height: -mean / weight * self.params.bin, area })
    }

    fn direction_peak(&self, hint: Vec3, work: &mut Work) -> Result<Vec3, NoGround> {
        let (a, b) = hint.any_orthonormal_pair();
        let cos45 = core::f32::consts::FRAC_1_SQRT_2;
        // The cone's normals, seen along the hint, fill a disc of radius sin 45°.
        let cell = |n: Vec3| -> Option<(usize, usize)> {
            if n.dot(hint) < cos45 {
                return None;
            }
            let scale =
                |v: f32| ((v / cos45 * 0.5 + 0.5) * DIRECTIONS as f32).clamp(0.0, DIRECTIONS as f32 - 1.0) as usize;
            Some((scale(n.dot(a)), scale(n.dot(b))))
        };
        let mut votes = [[0.0_f32; DIRECTIONS]; DIRECTIONS];
        let mut any = false;
        for (x, y) in self.pixels() {
            work.done = work.done.saturating_add(1);
            let Some(facet) = self.facet(x, y) else { continue };
            any = true;
            if let Some((i, j)) = cell(facet.normal)
                && let Some(v) = votes.get_mut(j).and_then(|row| row.get_mut(i))
            {
                *v += facet.area;
            }
        }
        if !any {
            return Err(NoGround::NoReadings);
        }
        let around = |i: usize, j: usize| -> f32 {
            let rows = votes.iter().take(j + 2).skip(j.saturating_sub(1));
            rows.flat_map(|row| row.iter().take(i + 2).skip(i.saturating_sub(1))).sum()
        };
        let mut best = ((0, 0), 0.0);
        for (i, j) in (0..DIRECTIONS).flat_map(|j| (0..DIRECTIONS).map(move |i| (i, j))) {
            let area = around(i, j);
            if area > best.1 {
                best = ((i, j), area);
            }
        }
        let ((i, j), area) = best;
        if !(area > 0.0) {
            return Err(NoGround::TooSmall { area });
        }
        let mut mean = Vec3::ZERO;
        for (x, y) in self.pixels() {
            let Some(facet) = self.facet(x, y) else { continue };
            if cell(facet.normal).is_some_and(|(u, v)| u.abs_diff(i) <= 1 && v.abs_diff(j) <= 1) {
                mean += facet.normal * facet.area;
            }
        }
        mean.try_normalize().ok_or(NoGround::NotFlat)
    }

    fn refine(&self, up: Vec3, peak: Peak, work: Work) -> Result<GroundEstimate, NoGround> {
        let mut plane = Plane::through(up * peak.height, up).ok_or(NoGround::BadUp)?;
        let mut band = self.params.bin * (SIDE as f32 + 0.5);
        let mut fit = None;
        for _ in 0..3 {
            let mut sum = LocalSum::new(plane.normal());
            for (x, y) in self.pixels() {
                if let Some(p) = self.frame.point(x, y)
                    && plane.distance(p).abs() <= band
                {
                    sum.add(p);
                }
            }
            let found = sum.fit(up).map_err(|_| NoGround::NotFlat)?;
            plane = found.plane;
            // Three deviations keep 99.7 % of a Gaussian; the floor keeps quantised, noise-free depth alive.
            band = math::clamp(3.0 * found.rms, 0.25 * self.params.bin, 5.0 * self.params.bin);
            fit = Some(found);
        }
        let fit = fit.ok_or(NoGround::NotFlat)?;
        let tilt = math::acos(fit.plane.normal().dot(up));
        if !(tilt <= self.params.max_angle) {
            return Err(NoGround::NotFlat);
        }
        let fit = fit.transformed(&self.frame.pose_or_identity());
        Ok(GroundEstimate { fit, tilt, area: peak.area, work })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::geometry::Ray;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::{Intrinsics, Pose};
    use crate::sensing::depth::{DepthUnit, noise::DepthNoise};
    use std::vec::Vec;

    const W: usize = 160;
    const H: usize = 120;

    /// Depth of a floor y = 0 with a table top (height, from z to z, half width) and a wall at z = 4; world y up.
    fn scene(pose: &Pose, table: Option<(f32, f32, f32, f32)>, noise: Option<DepthNoise>, seed: u64) -> Vec<u16> {
        let k = camera();
        let mut s = seed | 1;
        let mut gauss = move || {
            let mut sum = 0.0;
            for _ in 0..12 {
                s ^= s << 13;
                s ^= s >> 7;
                s ^= s << 17;
                sum += (s >> 40) as f32 / 16_777_216.0;
            }
            sum - 6.0
        };
        (0..W * H)
            .map(|i| {
                let d = k.ray(Vec2::new((i % W) as f32, (i / W) as f32));
                let ray = Ray::new(pose.translation(), pose.direction_to_world(d)).unwrap();
                let mut t = f32::INFINITY;
                let floor = Plane::through(Vec3::ZERO, Vec3::Y).unwrap();
                let wall = Plane::through(Vec3::Z * 4.0, Vec3::NEG_Z).unwrap();
                for p in [floor, wall] {
                    t = t.min(p.intersect(&ray).unwrap_or(f32::INFINITY));
                }
                if let Some((height, z0, z1, half)) = table {
                    let top = Plane::through(Vec3::Y * height, Vec3::Y).unwrap();
                    if let Some(s) = top.intersect(&ray) {
                        let p = ray.at(s);
                        if p.z > z0 && p.z < z1 && p.x.abs() < half {
                            t = t.min(s);
                        }
                    }
                }
                let z = t / d.length();
                let sigma = noise.map_or(0.0, |n| n.sigma::<u16>(z, DepthUnit::MILLIMETRE));
                u16::from_metres(z + sigma * gauss(), DepthUnit::MILLIMETRE)
            })
            .collect()
    }

    fn camera() -> Intrinsics {
        Intrinsics::new(120.0, 120.0, 79.5, 59.5).unwrap()
    }

    fn pose() -> Pose {
        Pose::looking_at(Vec3::new(0.2, 1.5, 0.0), Vec3::new(0.0, 0.4, 2.5), Vec3::Y).unwrap()
    }

    fn frame<'a>(data: &'a [u16], pose: Pose) -> DepthFrame<'a> {
        DepthFrame::new(ImageView::new(data, W, H).unwrap(), DepthUnit::MILLIMETRE, camera()).with_pose(pose)
    }

    #[test]
    fn a_clean_floor_is_found_to_the_millimetre() {
        let data = scene(&pose(), None, None, 1);
        let g = estimate_ground(&frame(&data, pose()), Vec3::Y * 3.0, &GroundParams::DEFAULT).unwrap();
        assert!(g.fit.plane.offset().abs() < 1e-3, "{g:?}");
        assert!(g.tilt < 0.1_f32.to_radians(), "{g:?}");
        assert_eq!(g.work.done + g.work.skipped, (W * H) as u32);
    }

    #[test]
    fn a_noisy_floor_is_found_to_a_centimetre_and_half_a_degree() {
        for seed in 1..20 {
            let data = scene(&pose(), None, Some(DepthNoise::KINECT), seed);
            let g = estimate_ground(&frame(&data, pose()), Vec3::Y, &GroundParams::DEFAULT).unwrap();
            assert!(g.fit.plane.distance(Vec3::Z * 2.0).abs() < 0.01, "{g:?}");
            assert!(g.tilt < 0.5_f32.to_radians(), "{g:?}");
        }
    }

    /// The table takes far more pixels than the floor that is left: it must not become the ground.
    #[test]
    fn a_table_is_not_ground() {
        let data = scene(&pose(), Some((0.75, 0.4, 1.6, 0.9)), Some(DepthNoise::KINECT), 5);
        let f = frame(&data, pose());
        let g = estimate_ground(&f, Vec3::Y, &GroundParams::DEFAULT).unwrap();
        assert!(g.fit.plane.distance(Vec3::Z * 2.5).abs() < 0.015, "{g:?}");
        // Nothing but the table in view: then it is the best there is.
        let only = scene(&pose(), Some((0.75, -9.0, 9.0, 9.0)), None, 5);
        let g = estimate_ground(&frame(&only, pose()), Vec3::Y, &GroundParams::DEFAULT).unwrap();
        assert!((g.fit.plane.offset() - 0.75).abs() < 1e-3, "{g:?}");
    }

    #[test]
    fn with_a_hint_only_the_floor_is_still_found() {
        let data = scene(&pose(), None, Some(DepthNoise::KINECT), 3);
        let f = frame(&data, pose());
        for hint in [Vec3::Y, Vec3::new(0.4, 1.0, 0.4), Vec3::new(-0.5, 1.0, -0.3)] {
            let g = dominant_plane(&f, hint, &GroundParams::DEFAULT).unwrap();
            assert!(g.fit.plane.normal().dot(Vec3::Y) > 0.5_f32.to_radians().cos(), "{hint} {g:?}");
            assert!(g.fit.plane.distance(Vec3::Z * 2.0).abs() < 0.01, "{g:?}");
        }
        let wall = dominant_plane(&f, Vec3::NEG_Z, &GroundParams::DEFAULT).unwrap();
        assert!(wall.fit.plane.normal().dot(Vec3::NEG_Z) > 0.999, "{wall:?}");
    }

    #[test]
    fn hostile_frames_and_arguments_get_reasons() {
        let p = GroundParams::DEFAULT;
        for (w, h) in [(0, 0), (0, 5), (5, 0), (1, 90), (90, 1)] {
            let data: Vec<f32> = (0..w * h).map(|i| if i % 2 == 0 { f32::NAN } else { 1e30 }).collect();
            let f = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::METRE, camera());
            assert_eq!(estimate_ground(&f, Vec3::Y, &p), Err(NoGround::NoReadings));
            assert_eq!(dominant_plane(&f, Vec3::Y, &p), Err(NoGround::NoReadings));
        }
        let huge = [1e30_f32; 64 * 64];
        let f = DepthFrame::new(ImageView::new(&huge, 64, 64).unwrap(), DepthUnit::METRE, camera());
        assert!(estimate_ground(&f, Vec3::Y, &p).is_err());
        assert!(dominant_plane(&f, Vec3::Y, &p).is_err());
        assert_eq!(estimate_ground(&f, Vec3::ZERO, &p), Err(NoGround::BadUp));
        for bad in [
            GroundParams { bin: 0.0, ..p },
            GroundParams { bin: f32::NAN, ..p },
            GroundParams { max_samples: 0, ..p },
            GroundParams { max_angle: -1.0, ..p },
        ] {
            assert_eq!(estimate_ground(&f, Vec3::Y, &bad), Err(NoGround::BadParams));
        }
    }
}
