//! Equirectangular maps: the whole sphere of directions as an image, twice as wide as high.
//!
//! The first row is up (+y), the middle column looks along -z, columns run to the right for someone who stands inside:
//! u = 1/2 + atan2(x, -z) / 2 pi, v = acos(y / r) / pi; pixel (i, j) is centred on ((i + 1/2) / W, (j + 1/2) / H) and column W is column 0. It is the
//! convention of Radiance and Blender; worlds with another way up are turned first ([`MapFrame`]).
//!
//! Angles are by a polynomial of our own, 5e-7 rad at most (a pixel of a map 16,384 wide is 4e-4), the same bits on all
//! targets, plain arithmetic that vectorises.

use glam::{Mat3, Quat, Vec2, Vec3};

use crate::ground::math;
use crate::sensing::camera::Pose;

/// The angle of the vector (`cos`, `sin`) in turns, -1/2 to 1/2; 0 when both are 0.
#[inline(always)]
pub(crate) fn turns_of(sin: f32, cos: f32) -> f32 {
    let half = half_turn(sin.abs(), cos);
    f32::from_bits(half.to_bits() | (sin.to_bits() & SIGN))
}

const SIGN: u32 = 1 << 31;

/// The same for `sin` of 0 or more: 0 to 1/2.
#[inline(always)]
pub(crate) fn half_turn(s: f32, cos: f32) -> f32 {
    let c = cos.abs();
    let steep = s > c;
    let (small, large) = if steep { (c, s) } else { (s, c) };
    let t = small / (large + f32::MIN_POSITIVE);
    let q = t * t;
    let p = -0.005_348_269_3 + q * 0.001_084_127_8;
    let p = 0.012_672_491 + q * p;
    let p = -0.021_061_512 + q * p;
    let p = 0.031_525_116 + q * p;
    let p = -0.053_026_238 + q * p;
    let octant = t * (0.159_154_32 + q * p);
    let quarter = if steep { 0.25 - octant } else { octant };
    // 1/2 less it where the cosine is negative, by bits: what compares and blends costs twice as much.
    let sign = cos.to_bits() & SIGN;
    let base = f32::from_bits(((sign as i32) >> 31) as u32 & 0.5_f32.to_bits());
    base + f32::from_bits(quarter.to_bits() ^ sign)
}

/// Where a direction of any length lies in a map: u in 0 to 1 (1 is 0 again), v in 0 to 1. v is 0, and u any, for no direction.
///
/// ```
/// use isobath::glam::{vec2, vec3};
/// use isobath::lighting::equirect::{direction_of_uv, uv_of_direction};
/// assert_eq!(uv_of_direction(vec3(0.0, 0.0, -3.0)), vec2(0.5, 0.5));
/// assert!((direction_of_uv(vec2(0.75, 0.5)) - vec3(1.0, 0.0, 0.0)).length() < 1e-6);
/// ```
#[inline(always)]
#[must_use]
pub fn uv_of_direction(d: Vec3) -> Vec2 {
    let s = d.x * d.x + d.z * d.z;
    Vec2::new(0.5 + turns_of(d.x, -d.z), 2.0 * half_turn(s * math::inv_sqrt_fast(s), d.y))
}

/// The unit direction at (u, v) of a map.
#[must_use]
pub fn direction_of_uv(uv: Vec2) -> Vec3 {
    let (lon, polar) = (core::f32::consts::TAU * (uv.x - 0.5), core::f32::consts::PI * uv.y);
    let r = math::sin(polar);
    Vec3::new(math::sin(lon) * r, math::cos(polar), -math::cos(lon) * r)
}

/// The unit direction of a pixel's centre, of a map of `width` x `height`.
#[must_use]
pub fn direction_of_pixel(x: usize, y: usize, (width, height): (usize, usize)) -> Vec3 {
    direction_of_uv(Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32))
}

/// The pixel of a map of `width` x `height` that holds (u, v); the last row for v = 1, the first column for u = 1. `None` of an empty map
/// or of NaN.
#[inline(always)]
#[must_use]
pub fn pixel_of_uv(uv: Vec2, (width, height): (usize, usize)) -> Option<(usize, usize)> {
    if width == 0 || height == 0 || !(uv.x + uv.y).is_finite() {
        return None;
    }
    let (x, y) = ((uv.x * width as f32) as usize, (uv.y * height as f32) as usize);
    Some((if x >= width { 0 } else { x }, y.min(height - 1)))
}

/// How a map lies in the world: where it is seen from, and which ways are its up and its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapFrame {
    /// The place the map is seen from, in the world, metres.
    pub at: Vec3,
    /// Turns the world's directions into the map's: +y up, -z in the middle. The identity for worlds with y up.
    pub rotation: Quat,
}

impl MapFrame {
    /// Of a world with y up, its middle along -z.
    #[must_use]
    pub const fn at(at: Vec3) -> Self {
        Self { at, rotation: Quat::IDENTITY }
    }

    /// Of a world with any up; the middle is any of the directions across it. `None` when `up` is zero or not finite.
    #[must_use]
    pub fn with_up(at: Vec3, up: Vec3) -> Option<Self> {
        let up = crate::ground::geometry::unit(up)?;
        at.is_finite().then_some(Self { at, rotation: Quat::from_rotation_arc(up, Vec3::Y) })
    }

    /// A world direction in the map's axes.
    #[inline]
    #[must_use]
    pub fn direction(&self, world: Vec3) -> Vec3 {
        crate::ground::rotation::rotate(self.rotation, world)
    }

    /// Camera axes into the map's: rows of the matrix that turns, and where the camera is from the map's place (both in the map's axes).
    pub(crate) fn of_camera(&self, camera: &Pose) -> (Mat3, Vec3) {
        let turn = crate::ground::rotation::product(self.rotation, camera.rotation());
        let column = |axis| crate::ground::rotation::rotate(turn, axis);
        let matrix = Mat3::from_cols(column(Vec3::X), column(Vec3::Y), column(Vec3::Z));
        (matrix, self.direction(camera.translation() - self.at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn turns_are_those_of_the_arc_tangent() {
        let mut worst = 0.0_f64;
        for i in 0..200_000 {
            let a = (f64::from(i) / 200_000.0 - 0.5) * core::f64::consts::TAU;
            for length in [1e-12, 0.3, 7.0, 1e12] {
                let (s, c) = ((length * libm::sin(a)) as f32, (length * libm::cos(a)) as f32);
                let exact = libm::atan2(f64::from(s), f64::from(c)) / core::f64::consts::TAU;
                worst = worst.max((f64::from(turns_of(s, c)) - exact).abs());
            }
        }
        assert!(worst * core::f64::consts::TAU < 5e-7, "{:e} rad", worst * core::f64::consts::TAU);
        assert_eq!(turns_of(0.0, 0.0), 0.0);
        assert!(turns_of(f32::NAN, 1.0).is_nan() && turns_of(1.0, f32::NAN).is_nan());
        assert_eq!([turns_of(1.0, 0.0), turns_of(-1.0, 0.0), turns_of(0.0, -1.0)], [0.25, -0.25, 0.5]);
    }

    proptest! {
        #[test]
        fn there_and_back(u in 0.0_f32..1.0, v in 0.0005_f32..0.9995) {
            let d = direction_of_uv(Vec2::new(u, v));
            let back = uv_of_direction(d * 3.0);
            let across = (back.x - u - math::round(back.x - u)).abs() * libm::sinf(core::f32::consts::PI * v);
            prop_assert!(across < 2e-7 && (back.y - v).abs() < 3e-7, "{} {} -> {}", u, v, back);
        }
    }

    #[test]
    fn poles_the_seam_and_nothing() {
        assert_eq!(uv_of_direction(Vec3::Y).y, 0.0);
        assert_eq!(uv_of_direction(-Vec3::Y).y, 1.0);
        assert_eq!(uv_of_direction(Vec3::ZERO).y, 0.0);
        assert_eq!(pixel_of_uv(uv_of_direction(Vec3::new(0.0, 0.0, 1.0)), (8, 4)), Some((0, 2)));
        assert_eq!(pixel_of_uv(Vec2::new(1.0, 1.0), (8, 4)), Some((0, 3)));
        assert_eq!(pixel_of_uv(Vec2::NAN, (8, 4)), None);
        assert_eq!(pixel_of_uv(Vec2::ZERO, (0, 4)), None);
        for y in 0..4 {
            for x in 0..8 {
                assert_eq!(pixel_of_uv(uv_of_direction(direction_of_pixel(x, y, (8, 4))), (8, 4)), Some((x, y)));
            }
        }
    }

    #[test]
    fn a_world_with_another_up() {
        let frame = MapFrame::with_up(Vec3::ZERO, Vec3::new(0.0, -2.0, 0.0)).unwrap();
        assert!((frame.direction(Vec3::new(0.0, -1.0, 0.0)) - Vec3::Y).length() < 1e-6);
        assert_eq!(MapFrame::with_up(Vec3::ZERO, Vec3::ZERO), None);
        assert_eq!(MapFrame::with_up(Vec3::NAN, Vec3::Y), None);
    }
}
