//! Stages that look at a pixel's neighbours: what edges, occlusions and corners do.

use rayon::prelude::*;

use super::Sensed;
use crate::maths::V3;
use crate::random::Random;
use crate::render::GroundTruth;
use crate::render::camera::SimCamera;

/// Holes where a second eye sees something nearer. `scale` is focal length x baseline: disparity is `scale` / z pixels.
///
/// Along a row, a pixel x lands at x - d in the second image. With that eye to the right, it is hidden when some pixel further
/// right lands at or left of it; so one pass from the right with the least landing so far finds all. The left eye is the mirror image.
pub(super) fn occlusion(z: &mut [f64], truth: &GroundTruth, scale: f64) {
    let width = truth.width;
    z.par_chunks_mut(width.max(1)).zip(truth.z.par_chunks(width.max(1))).for_each(|(row, exact)| {
        let n = row.len();
        let mut least = f64::INFINITY;
        for k in 0..n {
            // In the mirror image for a left eye.
            let x = if scale >= 0.0 { n - 1 - k } else { k };
            let (Some(z), Some(&exact)) = (row.get_mut(x), exact.get(x)) else { continue };
            if exact <= 0.0 {
                continue;
            }
            let landing = (n - 1 - k) as f64 - scale.abs() / exact;
            // Half a pixel is what neighbours on one smooth surface may overlap.
            if landing > least + 0.5 || landing < -0.5 {
                *z = 0.0;
            }
            least = least.min(landing);
        }
    });
}

/// Depth steps larger than this part of depth are edges.
const STEP: f64 = 0.04;

/// The neighbours of a pixel in an image: left, right, up, down.
fn neighbours(i: usize, width: usize, len: usize) -> [Option<usize>; 4] {
    let x = i % width;
    [
        (x > 0).then(|| i - 1),
        (x + 1 < width).then_some(i + 1),
        i.checked_sub(width),
        Some(i + width).filter(|&j| j < len),
    ]
}

/// At edges, pixels collect light of both sides and report something between.
pub(super) fn flying(sensed: &mut Sensed, truth: &GroundTruth, share: f64, random: Random) {
    let (width, n) = (truth.width.max(1), truth.z.len());
    let confidence = sensed.confidence.get_or_insert_with(|| vec![255; n]);
    for (i, (z, c)) in sensed.z.iter_mut().zip(confidence).enumerate() {
        if *z <= 0.0 || random.unit(3 * i as u64) >= share {
            continue;
        }
        let own = truth.z.get(i).copied().unwrap_or(0.0);
        // Of the neighbours across an edge, one at random.
        let mut across = [0.0; 4];
        let mut count = 0;
        for j in neighbours(i, width, n).into_iter().flatten() {
            let other = truth.z.get(j).copied().unwrap_or(0.0);
            if other > 0.0 && (other - own).abs() > STEP * own.min(other) {
                across[count] = other;
                count += 1;
            }
        }
        if count > 0 {
            let other = across[(random.unit(3 * i as u64 + 1) * count as f64) as usize % count];
            // Mostly a little of the other side, seldom half.
            let part = random.unit(3 * i as u64 + 2);
            *z += (other - own) * 0.5 * part * part;
            *c /= 3;
        }
    }
}

/// Directions to look in for surfaces that light up this one.
const AROUND: [(i64, i64); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)];

/// Light that comes by way of a neighbouring surface has gone farther: depth grows by `strength` times the mean detour, weighted
/// with how much the two surfaces face each other. Zero on planes and on outer corners.
pub(super) fn multipath(z: &mut [f64], truth: &GroundTruth, camera: &SimCamera, strength: f64) {
    let (width, height) = (truth.width, truth.height);
    let reach = (width as i64 / 24).max(2);
    // Where each pixel's surface is, once.
    let points: Vec<V3> = (0..truth.z.len())
        .into_par_iter()
        .with_min_len(4096)
        .map(|i| {
            let ray = camera.ray((i % width.max(1)) as f64, (i / width.max(1)) as f64).unwrap_or(V3::ZERO);
            ray * truth.z.get(i).copied().unwrap_or(0.0)
        })
        .collect();
    z.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, z) in row.iter_mut().enumerate().filter(|(_, z)| **z > 0.0) {
            let at = |i: usize| Some((*points.get(i)?, V3::from(truth.normals.get(i)?.map(f64::from))));
            let Some((p, n)) = at(y * width + x) else { continue };
            let mut sum = 0.0;
            for step in [reach, reach / 2] {
                for (dx, dy) in AROUND {
                    let (nx, ny) = (x as i64 + dx * step, y as i64 + dy * step);
                    if nx < 0 || ny < 0 || nx >= width as i64 || ny >= height as i64 {
                        continue;
                    }
                    let Some((q, m)) = at(ny as usize * width + nx as usize) else { continue };
                    let d = q - p;
                    let length = d.length();
                    // Normals are rounded to f32: what faces less than that is a plane.
                    let (a, b) = (d.dot(n) / length, -d.dot(m) / length);
                    if q.z > 0.0 && a > 1e-5 && b > 1e-5 {
                        sum += a * b * length;
                    }
                }
            }
            *z += strength * sum / 16.0;
        }
    });
}
