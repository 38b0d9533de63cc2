//! Stages that treat each pixel on its own.

use rayon::prelude::*;

use super::Sensed;
use crate::maths::V3;
use crate::random::Random;
use crate::render::GroundTruth;
use crate::render::camera::SimCamera;

/// What is no depth becomes a hole.
fn valid(z: f64) -> f64 {
    if z > 0.0 && z < f64::INFINITY { z } else { 0.0 }
}

/// Applies a function to every reading.
pub(super) fn each(z: &mut [f64], f: impl Fn(f64) -> f64 + Sync) {
    z.par_iter_mut().with_min_len(4096).filter(|z| **z > 0.0).for_each(|z| *z = valid(f(*z)));
}

/// Normal noise.
pub(super) fn noise(z: &mut [f64], [constant, linear, quadratic]: [f64; 3], random: Random) {
    z.par_iter_mut().with_min_len(4096).enumerate().filter(|(_, z)| **z > 0.0).for_each(|(i, z)| {
        let sigma = constant + *z * (linear + *z * quadratic);
        *z = valid(*z + sigma * random.normal(i as u64));
    });
}

/// Returned light: cos / z², half confidence where a surface seen straight on at 4 m would be.
const HALF_LIGHT: f64 = 1.0 / 16.0;

pub(super) fn confidence(sensed: &mut Sensed, truth: &GroundTruth, camera: &SimCamera) {
    let before = sensed.confidence.take();
    let mut out = vec![0_u8; sensed.z.len()];
    for (i, c) in out.iter_mut().enumerate() {
        let (x, y) = (i % truth.width.max(1), i / truth.width.max(1));
        let (Some(ray), Some(normal), Some(&z)) =
            (camera.ray(x as f64, y as f64), truth.normals.get(i), truth.z.get(i))
        else {
            continue;
        };
        let cosine = -ray.dot(V3::from(normal.map(f64::from))) / ray.length();
        let light = if z > 0.0 { cosine.max(0.0) / (z * z) } else { 0.0 };
        let own = 255.0 * light / (light + HALF_LIGHT);
        // Never more than an earlier stage left.
        let most = before.as_ref().and_then(|b| b.get(i)).copied().unwrap_or(255);
        *c = (libm::round(own) as u8).min(most);
    }
    sensed.confidence = Some(out);
}

/// Frames in which the band crosses the image once.
const ROLL: u64 = 16;
/// Height of the band, as a part of the image's.
const BAND: f64 = 0.25;

pub(super) fn rolling(sensed: &mut Sensed, width: usize, frame: u64, random: Random) {
    let n = sensed.z.len();
    let height = n.checked_div(width).unwrap_or(0).max(1);
    let confidence = sensed.confidence.get_or_insert_with(|| vec![255; n]);
    let centre = (frame % ROLL) as f64 / ROLL as f64;
    for (i, (z, c)) in sensed.z.iter_mut().zip(confidence).enumerate() {
        let y = (i / width.max(1)) as f64 / height as f64;
        // The distance to the band's middle, around the image's end.
        let away = (y - centre).abs();
        let away = away.min(1.0 - away) / (0.5 * BAND);
        if away < 1.0 && *z > 0.0 {
            let depth = 1.0 - away * away;
            *c = (f64::from(*c) * (1.0 - 0.8 * depth)) as u8;
            // As much again as a time-of-flight sensor's own noise.
            *z = valid(*z + depth * (0.002 + 0.005 * *z) * random.normal(i as u64));
        }
    }
}
