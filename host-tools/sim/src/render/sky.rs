//! What is seen where nothing is: one colour, a gradient, or an HDR panorama. And the panorama's own convention.
//!
//! Equirectangular images here have their first row up (+y) and their middle column towards -z; columns run to the right
//! for someone who stands inside: u = 1/2 + atan2(x, -z) / 2 pi, v = acos(y) / pi, pixel (i, j) is centred on
//! ((i + 1/2) / W, (j + 1/2) / H).

use std::path::Path;
use std::sync::Arc;

use crate::error::SimError;
use crate::maths::{Rotation, V3, v3};

/// A linear RGB image, row after row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LinearImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear radiance, red green blue.
    pub pixels: Vec<[f32; 3]>,
}

/// The surroundings.
#[derive(Debug, Clone)]
pub(crate) enum Sky {
    Constant(V3),
    Gradient { top: V3, horizon: V3, bottom: V3 },
    Hdr { image: Arc<LinearImage>, turn: Rotation, scale: f64 },
}

/// The direction (unit) of an equirectangular position, u and v in 0 to 1.
#[must_use]
pub fn direction_of_equirect(u: f64, v: f64) -> V3 {
    let (sin_lon, cos_lon) = libm::sincos(std::f64::consts::TAU * (u - 0.5));
    let (sin_polar, cos_polar) = libm::sincos(std::f64::consts::PI * v);
    v3(sin_lon * sin_polar, cos_polar, -cos_lon * sin_polar)
}

/// The equirectangular position, u in [0, 1) and v in [0, 1], of a direction of any length.
#[must_use]
pub fn equirect_of_direction(d: V3) -> (f64, f64) {
    let d = d.unit_or_up();
    let u = 0.5 + libm::atan2(d.x, -d.z) / std::f64::consts::TAU;
    (if u >= 1.0 { 0.0 } else { u }, libm::acos(d.y.clamp(-1.0, 1.0)) / std::f64::consts::PI)
}

impl LinearImage {
    /// An image of one colour.
    #[must_use]
    pub fn filled(width: usize, height: usize, colour: [f32; 3]) -> Self {
        Self { width, height, pixels: vec![colour; width * height] }
    }

    /// The pixel, black outside.
    #[must_use]
    pub fn get(&self, x: usize, y: usize) -> [f32; 3] {
        if x < self.width { self.pixels.get(y * self.width + x).copied().unwrap_or_default() } else { [0.0; 3] }
    }

    /// As an equirectangular map: the colour seen in a direction, bilinear, closed at the seam.
    #[must_use]
    pub fn towards(&self, direction: V3) -> V3 {
        let (u, v) = equirect_of_direction(direction);
        let (w, h) = (self.width, self.height);
        if w == 0 || h == 0 {
            return V3::ZERO;
        }
        let (x, y) = (u * w as f64 - 0.5, (v * h as f64 - 0.5).clamp(0.0, h as f64 - 1.0));
        let (x0, y0) = (libm::floor(x), libm::floor(y));
        let (fx, fy) = (x - x0, y - y0);
        let column = |x: f64| (x.rem_euclid(w as f64)) as usize % w;
        let (xa, xb) = (column(x0), column(x0 + 1.0));
        let (ya, yb) = (y0 as usize, (y0 as usize + 1).min(h - 1));
        let at = |x, y| V3::from(self.get(x, y).map(f64::from));
        at(xa, ya).lerp(at(xb, ya), fx).lerp(at(xa, yb).lerp(at(xb, yb), fx), fy)
    }
}

impl Sky {
    pub(crate) fn hdr(path: &Path, turn: f64, scale: f64) -> Result<Self, SimError> {
        let image = read_linear(path)?;
        Ok(Self::Hdr { image: Arc::new(image), turn: Rotation::from_yaw_pitch_roll(turn, 0.0, 0.0), scale })
    }

    pub(crate) fn radiance(&self, direction: V3) -> V3 {
        match self {
            Self::Constant(c) => *c,
            Self::Gradient { top, horizon, bottom } => {
                let y = direction.unit_or_up().y;
                // Quickly from the horizon, slowly towards the pole, as skies do.
                if y >= 0.0 { horizon.lerp(*top, y.sqrt()) } else { horizon.lerp(*bottom, (-y).sqrt()) }
            }
            Self::Hdr { image, turn, scale } => image.towards(turn.undo(direction)) * *scale,
        }
    }
}

/// Reads an image file as linear colour: Radiance .hdr and `OpenEXR` .exr as they are, PNG and JPEG through the sRGB curve. What
/// is negative or no number is black.
///
/// # Errors
/// [`SimError`] when the file can't be read or is no image.
pub fn read_linear(path: &Path) -> Result<LinearImage, SimError> {
    let reader = image::ImageReader::open(path).map_err(SimError::read(path))?;
    let reader = reader.with_guessed_format().map_err(SimError::read(path))?;
    let decoded = reader.decode().map_err(|e| SimError::Format {
        path: path.into(),
        what: e.to_string(),
        hint: "surroundings and textures are .hdr, .exr, .png or .jpg files",
    })?;
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let pixels = match decoded {
        image::DynamicImage::ImageRgb32F(_) | image::DynamicImage::ImageRgba32F(_) => {
            // Comparing, not `max`: which zero that gives is the machine's choice.
            decoded
                .to_rgb32f()
                .pixels()
                .map(|p| p.0.map(|v| if v > 0.0 && v < f32::INFINITY { v } else { 0.0 }))
                .collect()
        }
        other => other.to_rgb8().pixels().map(|p| p.0.map(super::srgb::decode)).collect(),
    };
    Ok(LinearImage { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_round_trip_and_the_middle_is_forward() {
        let d = direction_of_equirect(0.5, 0.5);
        assert!((d - v3(0.0, 0.0, -1.0)).length() < 1e-15);
        assert!((direction_of_equirect(0.75, 0.5) - v3(1.0, 0.0, 0.0)).length() < 1e-15, "right of the middle is +x");
        for i in 0..32 {
            for j in 0..16 {
                let (u, v) = ((f64::from(i) + 0.5) / 32.0, (f64::from(j) + 0.5) / 16.0);
                let (u2, v2) = equirect_of_direction(direction_of_equirect(u, v) * 3.0);
                assert!((u - u2).abs() < 1e-14 && (v - v2).abs() < 1e-14);
            }
        }
        for d in [V3::UP, -V3::UP, v3(0.0, 0.0, 1.0), v3(-0.0, 0.0, 1.0), V3::ZERO] {
            let (u, v) = equirect_of_direction(d);
            assert!((0.0..1.0).contains(&u) && (0.0..=1.0).contains(&v));
        }
    }

    #[test]
    fn lookups_meet_pixel_centres_and_close_the_seam() {
        let mut image = LinearImage::filled(8, 4, [0.0; 3]);
        for (i, p) in image.pixels.iter_mut().enumerate() {
            *p = [i as f32; 3];
        }
        for y in 0..4 {
            for x in 0..8 {
                let d = direction_of_equirect((x as f64 + 0.5) / 8.0, (y as f64 + 0.5) / 4.0);
                assert!((image.towards(d).x - f64::from(image.get(x, y)[0])).abs() < 1e-12);
            }
        }
        let seam = image.towards(direction_of_equirect(0.0, 0.375));
        assert!((seam.x - 0.5 * (8.0 + 15.0)).abs() < 1e-9, "{seam:?}");
    }
}
