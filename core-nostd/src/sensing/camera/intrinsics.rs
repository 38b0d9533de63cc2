//! The pinhole camera: pixels to rays and back (DepthLab Eq. 1 and the camera half of Eq. 3).
//!
//! u = fx x / z + cx, v = fy y / z + cy, pixel centres at integers. Depth is `z`, along the principal axis; the length of
//! the ray is `range`. The two differ by 15 % at 30 degrees, so they never share a name here.
//!
//! Cost: a handful of multiplications, one or two divisions. Error: pixel -> point -> pixel under 1e-4 px for images up to
//! 1024 wide (it scales with width), point -> pixel -> point under 1e-6 relative, both over 0.1 to 20 m (held by tests).

use core::fmt;

use glam::{Vec2, Vec3};

use crate::ground::math;

/// Pinhole intrinsics in pixels. A negative `fy` (y up) is legal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
}

/// Intrinsics that no camera can have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntrinsicsError {
    /// The value at fault: "fx", "fy", "cx" or "cy".
    pub name: &'static str,
    /// What it was.
    pub value: f32,
}

impl fmt::Display for IntrinsicsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "camera intrinsics: {} = {} is not usable; focal lengths must be finite and at least 1e-3 px in size, principal points finite and below 1e6 px",
            self.name, self.value
        )
    }
}

impl core::error::Error for IntrinsicsError {}

impl Intrinsics {
    /// From focal lengths and principal point in pixels.
    ///
    /// # Errors
    /// [`IntrinsicsError`] when a value is not finite, a focal length is below 1e-3 px or above 1e7 px in size, or a
    /// principal point is beyond 1e6 px: within these bounds no conversion of a finite point overflows.
    pub const fn new(fx: f32, fy: f32, cx: f32, cy: f32) -> Result<Self, IntrinsicsError> {
        if !(fx.abs() >= 1e-3 && fx.abs() <= 1e7) {
            return Err(IntrinsicsError { name: "fx", value: fx });
        }
        if !(fy.abs() >= 1e-3 && fy.abs() <= 1e7) {
            return Err(IntrinsicsError { name: "fy", value: fy });
        }
        // Negated, so that NaN fails too.
        if !(cx.abs() <= 1e6) {
            return Err(IntrinsicsError { name: "cx", value: cx });
        }
        if !(cy.abs() <= 1e6) {
            return Err(IntrinsicsError { name: "cy", value: cy });
        }
        Ok(Self { fx, fy, cx, cy })
    }

    /// From a full horizontal field of view in radians, square pixels, principal point in the middle.
    ///
    /// # Errors
    /// [`IntrinsicsError`] when the angle or the size gives no usable focal length.
    pub fn from_fov(horizontal: f32, width: usize, height: usize) -> Result<Self, IntrinsicsError> {
        let f = 0.5 * width as f32 / math::tan(0.5 * horizontal);
        if !(f > 0.0) {
            return Err(IntrinsicsError { name: "fx", value: f });
        }
        Self::new(f, f, 0.5 * width as f32 - 0.5, 0.5 * height as f32 - 0.5)
    }

    /// Horizontal focal length in pixels.
    #[must_use]
    pub const fn fx(&self) -> f32 {
        self.fx
    }

    /// Vertical focal length in pixels; negative when camera y points up.
    #[must_use]
    pub const fn fy(&self) -> f32 {
        self.fy
    }

    /// Principal point, x in pixels.
    #[must_use]
    pub const fn cx(&self) -> f32 {
        self.cx
    }

    /// Principal point, y in pixels.
    #[must_use]
    pub const fn cy(&self) -> f32 {
        self.cy
    }

    /// The ray through a pixel, scaled so that its z is 1: multiply by depth to get the point.
    #[inline]
    #[must_use]
    pub fn ray(&self, pixel: Vec2) -> Vec3 {
        Vec3::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy, 1.0)
    }

    /// The camera-space point (metres) at depth `z` metres behind a pixel. DepthLab Eq. 1.
    ///
    /// ```
    /// use glam::{vec2, vec3};
    /// use isobath::sensing::camera::Intrinsics;
    /// let k = Intrinsics::new(500.0, 500.0, 319.5, 239.5)?;
    /// let p = k.unproject(vec2(569.5, 239.5), 2.0);
    /// assert_eq!(p, vec3(1.0, 0.0, 2.0));
    /// assert_eq!(k.project(p), Some(vec2(569.5, 239.5)));
    /// # Ok::<(), isobath::sensing::camera::intrinsics::IntrinsicsError>(())
    /// ```
    #[inline]
    #[must_use]
    pub fn unproject(&self, pixel: Vec2, z: f32) -> Vec3 {
        Vec3::new((pixel.x - self.cx) * z / self.fx, (pixel.y - self.cy) * z / self.fy, z)
    }

    /// The camera-space point at distance `range` metres along the pixel's ray.
    #[must_use]
    pub fn unproject_range(&self, pixel: Vec2, range: f32) -> Vec3 {
        self.unproject(pixel, self.z_from_range(pixel, range))
    }

    /// Depth along the axis from the length of the ray.
    #[must_use]
    pub fn z_from_range(&self, pixel: Vec2, range: f32) -> f32 {
        range / self.ray(pixel).length()
    }

    /// Length of the ray from depth along the axis.
    #[must_use]
    pub fn range_from_z(&self, pixel: Vec2, z: f32) -> f32 {
        z * self.ray(pixel).length()
    }

    /// The pixel (fractional) that sees a camera-space point; `None` when it is not in front of the camera or not finite.
    /// The pixel may lie outside the image: see [`pixel_index`].
    #[inline]
    #[must_use]
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        if !(point.z > 0.0) {
            return None;
        }
        // The quotient first: the product overflows for points beyond 1e34 m that are seen all the same.
        let pixel = Vec2::new(self.fx * (point.x / point.z) + self.cx, self.fy * (point.y / point.z) + self.cy);
        pixel.is_finite().then_some(pixel)
    }

    /// The intrinsics of the image cut out at `(x, y)`.
    #[must_use]
    pub fn cropped(&self, x: f32, y: f32) -> Self {
        Self { cx: self.cx - x, cy: self.cy - y, ..*self }
    }

    /// The intrinsics of the image resized by `sx` and `sy`; pixel centres are at integers, so the principal point
    /// moves by half pixels: c' = s (c + 1/2) - 1/2.
    ///
    /// # Errors
    /// [`IntrinsicsError`] when the result is out of bounds.
    pub fn resized(&self, sx: f32, sy: f32) -> Result<Self, IntrinsicsError> {
        Self::new(self.fx * sx, self.fy * sy, sx * (self.cx + 0.5) - 0.5, sy * (self.cy + 0.5) - 0.5)
    }
}

/// The pixel whose square holds a fractional position, in an image of the given size; `None` outside.
#[inline]
#[must_use]
pub fn pixel_index(pixel: Vec2, size: (usize, usize)) -> Option<(usize, usize)> {
    let (x, y) = (pixel.x + 0.5, pixel.y + 0.5);
    // Also false for NaN.
    if x >= 0.0 && y >= 0.0 && x < size.0 as f32 && y < size.1 as f32 { Some((x as usize, y as usize)) } else { None }
}

/// Texture coordinates in (0, 1) of a pixel's centre, origin top left.
#[inline]
#[must_use]
pub fn uv_from_pixel(x: usize, y: usize, size: (usize, usize)) -> Vec2 {
    Vec2::new((x as f32 + 0.5) / size.0 as f32, (y as f32 + 0.5) / size.1 as f32)
}

/// The pixel at texture coordinates; `None` outside [0, 1). Returns every pixel to itself through [`uv_from_pixel`].
#[inline]
#[must_use]
pub fn pixel_from_uv(uv: Vec2, size: (usize, usize)) -> Option<(usize, usize)> {
    let (x, y) = (uv.x * size.0 as f32, uv.y * size.1 as f32);
    if x >= 0.0 && y >= 0.0 && x < size.0 as f32 && y < size.1 as f32 { Some((x as usize, y as usize)) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn uv_returns_every_pixel_to_itself() {
        for size in [1_usize, 2, 3, 120, 160, 240, 641, 1023, 65_535] {
            for i in 0..size {
                assert_eq!(pixel_from_uv(uv_from_pixel(i, 0, (size, 1)), (size, 1)), Some((i, 0)));
            }
        }
        for bad in [-1e-6, 1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(pixel_from_uv(Vec2::new(bad, 0.5), (10, 10)), None);
            assert_eq!(pixel_index(Vec2::new(bad * 10.0 + 5.0, 10.0), (10, 10)), None);
        }
    }

    #[test]
    fn impossible_cameras_are_refused() {
        for (fx, fy, cx, cy, name) in [
            (0.0, 1.0, 0.0, 0.0, "fx"),
            (f32::NAN, 1.0, 0.0, 0.0, "fx"),
            (1.0, f32::INFINITY, 0.0, 0.0, "fy"),
            (1.0, 1e-30, 0.0, 0.0, "fy"),
            (1.0, 1.0, f32::NAN, 0.0, "cx"),
            (1.0, 1.0, 0.0, f32::NEG_INFINITY, "cy"),
        ] {
            assert_eq!(Intrinsics::new(fx, fy, cx, cy).unwrap_err().name, name);
        }
        assert!(Intrinsics::new(481.2, -480.0, 319.5, 239.5).is_ok(), "y up is legal");
        assert!(Intrinsics::from_fov(0.0, 640, 480).is_err());
        assert!(Intrinsics::from_fov(1.2, 0, 0).is_err());
    }

    #[test]
    fn nothing_behind_the_camera_has_a_pixel() {
        let k = Intrinsics::new(500.0, 500.0, 320.0, 240.0).unwrap();
        for z in [0.0, -0.0, -1.0, f32::NAN, f32::NEG_INFINITY] {
            assert_eq!(k.project(Vec3::new(0.1, 0.1, z)), None);
        }
        assert_eq!(k.project(Vec3::new(f32::INFINITY, 0.0, 1.0)), None);
        assert_eq!(k.project(Vec3::new(1.0, 0.0, 1e-42)), None, "overflow is no pixel");
    }

    proptest! {
        #[test]
        fn resizing_commutes_with_projection(s in 0.1_f32..4.0, x in -0.5_f32..0.5, y in -0.5_f32..0.5) {
            let k = Intrinsics::new(500.0, 480.0, 319.5, 239.5).unwrap();
            let p = Vec3::new(x, y, 1.0);
            let a = k.project(p).unwrap();
            let b = k.resized(s, s).unwrap().project(p).unwrap();
            prop_assert!(((a + 0.5) * s - 0.5 - b).length() < 1e-3 * s.max(1.0));
        }
    }
}
