//! The simulated camera: the core's pinhole and lens model in `f64`, and the colour camera around a depth camera's crop.

use crate::error::SimError;
use crate::maths::{V3, v3};

/// A pinhole with a lens in front, in `f64`: pixel centres at whole numbers, OpenCV's order of coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimCamera {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length in pixels, horizontal.
    pub fx: f64,
    /// Focal length in pixels, vertical.
    pub fy: f64,
    /// Principal point in pixels, horizontal.
    pub cx: f64,
    /// Principal point in pixels, vertical.
    pub cy: f64,
    /// k1 k2 p1 p2 k3 k4 k5 k6 (zeros: none).
    pub lens: [f64; 8],
}

/// 64 megapixels.
const MOST_PIXELS: usize = 64 << 20;

impl SimCamera {
    /// Square pixels, principal point in the middle, from the full horizontal field of view in radians.
    ///
    /// # Errors
    /// [`SimError::Option`] for an angle outside (0, 3) or an unusable size.
    pub fn from_fov(width: usize, height: usize, horizontal: f64) -> Result<Self, SimError> {
        if !(horizontal > 0.0 && horizontal < 3.0) {
            return Err(SimError::option(format!(
                "a field of view of {horizontal} rad is not usable; give more than 0 and less than 3 (171 degrees)"
            )));
        }
        let (w, h) = (width as f64, height as f64);
        let f = 0.5 * w / libm::tan(0.5 * horizontal);
        let camera =
            Self { width, height, fx: f, fy: f, cx: 0.5 * w - 0.5, cy: 0.5 * h - 0.5, lens: [0.0; 8] }.in_f32();
        camera.check().map(|()| camera)
    }

    /// The same camera with images of another size: scaled to the width; rows are left out or added evenly above and below.
    ///
    /// # Errors
    /// [`SimError::Option`] for an unusable size.
    pub fn scaled_to(&self, width: usize, height: usize) -> Result<Self, SimError> {
        let s = width as f64 / self.width as f64;
        let cy = (self.cy + 0.5 - 0.5 * self.height as f64) * s + 0.5 * height as f64 - 0.5;
        let cx = (self.cx + 0.5) * s - 0.5;
        let camera = Self { width, height, fx: self.fx * s, fy: self.fy * s, cx, cy, lens: self.lens }.in_f32();
        camera.check().map(|()| camera)
    }

    /// Rounded to f32, so that what a recording says is exactly what was simulated.
    pub(crate) fn in_f32(self) -> Self {
        let round = |v: f64| f64::from(v as f32);
        Self { fx: round(self.fx), fy: round(self.fy), cx: round(self.cx), cy: round(self.cy), ..self }
    }

    /// Whether the numbers are those of a camera.
    pub(crate) fn check(&self) -> Result<(), SimError> {
        let n = self.width.saturating_mul(self.height);
        if n == 0 || n > MOST_PIXELS {
            return Err(SimError::option(format!(
                "an image of {}x{} can't be simulated; give 1 to {} megapixels",
                self.width,
                self.height,
                MOST_PIXELS >> 20
            )));
        }
        let focal = |f: f64| f.abs() >= 1e-3 && f.abs() <= 1e7;
        let fits = focal(self.fx) && focal(self.fy) && self.cx.abs() <= 1e6 && self.cy.abs() <= 1e6;
        if !fits || !self.lens.iter().all(|k| k.is_finite()) {
            return Err(SimError::option(format!(
                "the camera fx {} fy {} cx {} cy {} lens {:?} is not usable; focal lengths are 1e-3 to 1e7 px, all numbers finite",
                self.fx, self.fy, self.cx, self.cy, self.lens
            )));
        }
        Ok(())
    }

    /// The same without its lens.
    #[must_use]
    pub const fn pinhole(self) -> Self {
        Self { lens: [0.0; 8], ..self }
    }

    /// The colour camera of another size whose middle this depth camera sees, as the core's `CropMap::centred` has it.
    #[must_use]
    pub fn colour_around(&self, width: usize, height: usize) -> Self {
        let (wc, hc, wd, hd) = (width as f64, height as f64, self.width as f64, self.height as f64);
        let s = (wd / wc).max(hd / hc);
        let offset = |d: f64, c: f64| 0.5 * (d - s * c) + 0.5 * s - 0.5;
        Self {
            width,
            height,
            fx: self.fx / s,
            fy: self.fy / s,
            cx: (self.cx - offset(wd, wc)) / s,
            cy: (self.cy - offset(hd, hc)) / s,
            lens: self.lens,
        }
    }

    /// The ray through a pixel, z = 1; `None` where the lens model has no inverse.
    #[must_use]
    pub fn ray(&self, x: f64, y: f64) -> Option<V3> {
        let d = [(x - self.cx) / self.fx, (y - self.cy) / self.fy];
        if self.lens == [0.0; 8] {
            return Some(v3(d[0], d[1], 1.0));
        }
        let mut n = d;
        for _ in 0..50 {
            let (value, [a, b, c, e]) = self.distorted(n);
            let (rx, ry) = (value[0] - d[0], value[1] - d[1]);
            let det = a * e - b * c;
            if !(det > 1e-9) {
                return None;
            }
            let step = [(e * rx - b * ry) / det, (a * ry - c * rx) / det];
            let length = (step[0] * step[0] + step[1] * step[1]).sqrt();
            let shorten = if length > 0.5 { 0.5 / length } else { 1.0 };
            n = [n[0] - step[0] * shorten, n[1] - step[1] * shorten];
            if length < 1e-14 * (1.0 + n[0].abs() + n[1].abs()) {
                return Some(v3(n[0], n[1], 1.0));
            }
        }
        // Newton's steps ended in rounding, or wandered: only what maps back is an answer.
        let (value, _) = self.distorted(n);
        ((value[0] - d[0]).abs() + (value[1] - d[1]).abs() < 1e-12).then(|| v3(n[0], n[1], 1.0))
    }

    /// The pixel that sees a camera-space point; `None` behind the camera.
    #[must_use]
    pub fn project(&self, p: V3) -> Option<[f64; 2]> {
        if !(p.z > 0.0) {
            return None;
        }
        let n = [p.x / p.z, p.y / p.z];
        let d = if self.lens == [0.0; 8] { n } else { self.distorted(n).0 };
        Some([self.fx * d[0] + self.cx, self.fy * d[1] + self.cy])
    }

    /// The core's model (its `distortion` module): the point, and [dx'/dx, dx'/dy, dy'/dx, dy'/dy].
    fn distorted(&self, [x, y]: [f64; 2]) -> ([f64; 2], [f64; 4]) {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.lens;
        let r2 = x * x + y * y;
        let top = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let bottom = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let s = top / bottom;
        let top_d = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let bottom_d = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
        let ds = (top_d - s * bottom_d) / bottom;
        let value =
            [x * s + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * s + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y];
        let cross = 2.0 * x * y * ds + 2.0 * (p1 * x + p2 * y);
        let xx = s + 2.0 * x * x * ds + 2.0 * p1 * y + 6.0 * p2 * x;
        let yy = s + 2.0 * y * y * ds + 6.0 * p1 * y + 2.0 * p2 * x;
        (value, [xx, cross, cross, yy])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_and_pixels_are_each_others_inverse() {
        let mut camera = SimCamera::from_fov(640, 480, 1.1).unwrap();
        for lens in [
            [0.0; 8],
            [0.2624, -0.9531, -0.0054, 0.0026, 1.1633, 0.0, 0.0, 0.0],
            [2.5, 1.4, 0.0003, -0.0002, 0.08, 2.83, 2.1, 0.38],
        ] {
            camera.lens = lens;
            for (x, y) in [(0.0, 0.0), (639.0, 0.0), (320.0, 200.0), (17.0, 450.0)] {
                let [px, py] = camera.project(camera.ray(x, y).unwrap() * 2.0).unwrap();
                assert!((px - x).abs() < 1e-9 && (py - y).abs() < 1e-9, "{lens:?} {x} {y}: {px} {py}");
            }
        }
        camera.lens = [-0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        camera.fx = 100.0;
        assert!(camera.ray(640.0, 240.0).is_none(), "beyond the fold");
    }

    #[test]
    fn scaled_cameras_see_the_same_through_the_same_part_of_the_image() {
        let camera =
            SimCamera { width: 640, height: 480, fx: 1400.0, fy: 1380.0, cx: 349.5, cy: 249.5, lens: [0.0; 8] };
        assert_eq!(camera.scaled_to(640, 480).unwrap(), camera);
        let (small, low) = (camera.scaled_to(160, 120).unwrap(), camera.scaled_to(640, 240).unwrap());
        for p in [v3(0.1, -0.05, 1.3), v3(-0.2, 0.1, 2.0)] {
            let [[x, y], [sx, sy], [lx, ly]] = [camera, small, low].map(|c| c.project(p).unwrap());
            assert!((sx + 0.5 - (x + 0.5) / 4.0).abs() < 1e-4 && (sy + 0.5 - (y + 0.5) / 4.0).abs() < 1e-4);
            assert!((lx - x).abs() < 1e-4 && (ly + 120.0 - y).abs() < 1e-4);
        }
    }

    #[test]
    fn colour_and_depth_correspond_as_the_core_says() {
        use isobath::glam::vec2;
        use isobath::sensing::camera::crop::CropMap;
        let depth = SimCamera::from_fov(160, 90, 1.1).unwrap();
        let colour = depth.colour_around(640, 480);
        let map = CropMap::centred((640, 480), (160, 90)).unwrap();
        let p = v3(0.1, -0.05, 1.3);
        let (c, d) = (colour.project(p).unwrap(), depth.project(p).unwrap());
        let mapped = map.depth_from_colour(vec2(c[0] as f32, c[1] as f32)).unwrap();
        assert!((mapped - vec2(d[0] as f32, d[1] as f32)).length() < 1e-4);
    }

    #[test]
    fn impossible_cameras_are_refused() {
        assert!(SimCamera::from_fov(0, 480, 1.0).is_err());
        assert!(SimCamera::from_fov(usize::MAX, 2, 1.0).is_err());
        assert!(SimCamera::from_fov(64, 48, f64::NAN).is_err());
        assert!(SimCamera::from_fov(64, 48, 3.2).is_err());
    }
}
