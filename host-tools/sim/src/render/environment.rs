//! The ground truth of lighting: what is seen from a point in every direction, as an equirectangular map of linear radiance.

use rayon::prelude::*;

use super::sky::{LinearImage, direction_of_equirect};
use super::{BOUNCES, Memory, NEAR, trace};
use crate::maths::V3;
use crate::scene::World;
use crate::shape::Ray;

/// The map at a place (metres), `width` x `width / 2`, each pixel the mean of `samples` x `samples` directions evenly within it.
pub(crate) fn map(world: &World<'_>, at: V3, width: usize, samples: u32) -> LinearImage {
    let height = width / 2;
    let mut image = LinearImage::filled(width, height, [0.0; 3]);
    let samples = samples.max(1);
    let n = f64::from(samples);
    image.pixels.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        let mut memory = Memory::new(world);
        for (x, pixel) in row.iter_mut().enumerate() {
            let mut sum = V3::ZERO;
            for i in 0..samples * samples {
                let u = (x as f64 + (f64::from(i % samples) + 0.5) / n) / width as f64;
                let v = (y as f64 + (f64::from(i / samples) + 0.5) / n) / height as f64;
                let ray = Ray { origin: at, direction: direction_of_equirect(u, v) };
                sum += trace(world, &ray, NEAR, BOUNCES, &mut memory);
            }
            *pixel = (sum / (n * n)).to_f32();
        }
    });
    image
}
