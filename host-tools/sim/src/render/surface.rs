//! What surfaces look like: a diffuse colour under a pattern, a share of mirror, and light of their own.

use std::path::Path;
use std::sync::Arc;

use super::sky::{LinearImage, read_linear};
use crate::error::SimError;
use crate::maths::{V3, v3};
use crate::random::Random;

/// A material; colours are linear.
#[derive(Debug, Clone)]
pub(crate) struct Material {
    /// Diffuse reflectance, 0 to 1.
    pub(crate) colour: V3,
    pub(crate) pattern: Pattern,
    /// Share of light that is mirrored, 0 to 1.
    pub(crate) mirror: f64,
    /// Radiance of its own.
    pub(crate) emission: V3,
}

/// How a material's colour varies, in the object's own frame.
#[derive(Debug, Clone)]
pub(crate) enum Pattern {
    None,
    Checker { colour: V3, size: f64 },
    Boards { width: f64, length: f64, variation: f64 },
    Speckle { colour: V3, size: f64 },
    Image { image: Arc<LinearImage>, repeat: [f64; 2] },
}

/// A number in 0 to 1 that belongs to a cell of a grid.
fn cell(x: f64, y: f64, z: f64) -> f64 {
    let key = |v: f64| v as i64 as u64;
    Random::new(key(x)).stream(key(y)).unit(key(z))
}

/// Smooth random values: cells' numbers, blended.
fn blotches(p: V3) -> f64 {
    let base = v3(libm::floor(p.x), libm::floor(p.y), libm::floor(p.z));
    let f = p - base;
    let s = |t: f64| t * t * (3.0 - 2.0 * t);
    let (fx, fy, fz) = (s(f.x), s(f.y), s(f.z));
    let mut sum = 0.0;
    for i in 0..8_u32 {
        let bit = |n: u32| f64::from((i >> n) & 1);
        let share = |on: f64, f: f64| if on > 0.5 { f } else { 1.0 - f };
        let weight = share(bit(0), fx) * share(bit(1), fy) * share(bit(2), fz);
        sum += weight * cell(base.x + bit(0), base.y + bit(1), base.z + bit(2));
    }
    sum
}

impl Pattern {
    pub(crate) fn image(path: &Path, repeat: [f64; 2]) -> Result<Self, SimError> {
        Ok(Self::Image { image: Arc::new(read_linear(path)?), repeat })
    }
}

impl Material {
    /// Diffuse reflectance at a point of the object's own frame.
    pub(crate) fn albedo(&self, p: V3, uv: [f64; 2]) -> V3 {
        match &self.pattern {
            Pattern::None => self.colour,
            Pattern::Checker { colour, size } => {
                // A hair aside, so that faces that lie on cell borders don't flicker between two cells.
                let odd = |v: f64| libm::floor(v / size + 1e-6) as i64 & 1;
                if (odd(p.x) ^ odd(p.y) ^ odd(p.z)) == 0 { self.colour } else { *colour }
            }
            Pattern::Boards { width, length, variation } => {
                let row = libm::floor(p.z / width);
                let along = p.x / length + cell(row, 0.0, 7.0);
                let board = libm::floor(along);
                let (across, end) = (p.z / width - row, (along - board) * length);
                let joint = across * width < 0.003 || end < 0.003;
                let grain = blotches(v3(p.x * 3.0, row * 9.0, p.z * 60.0)) - 0.5;
                let tone = 1.0 + variation * (2.0 * cell(row, board, 1.0) - 1.0 + 0.7 * grain);
                self.colour * if joint { 0.45 } else { tone.max(0.0) }
            }
            Pattern::Speckle { colour, size } => {
                let t = 0.65 * blotches(p / *size) + 0.35 * blotches(p * (2.7 / size) + v3(17.0, 5.0, 11.0));
                self.colour.lerp(*colour, ((t - 0.3) * 2.5).clamp(0.0, 1.0))
            }
            Pattern::Image { image, repeat } => {
                let wrap = |v: f64, n: usize| ((v - libm::floor(v)) * n as f64) as usize;
                let (x, y) = (wrap(uv[0] * repeat[0], image.width), wrap(uv[1] * repeat[1], image.height));
                V3::from(image.get(x, y).map(f64::from)).times(self.colour)
            }
        }
    }
}
