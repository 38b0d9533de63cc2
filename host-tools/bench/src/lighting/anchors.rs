//! Extrapolation between anchors: the sum over all of them, the 32 nearest as in the paper, and the grid that ships.

use isobath::glam::Vec3;
use isobath::ground::image::ImageViewMut;
use isobath::ground::units::Timestamp;
use isobath::lighting::far::extrapolate::{FarMap, nearest_anchors};
use isobath::lighting::far::{FarField, FarParams};
use isobath::lighting::lattice::Lattice;
use isobath_sim::{LinearImage, v3};

use super::report::Line;
use crate::BenchError;
use crate::measure::{Effort, alternating};
use crate::row::{Method, Score};

const N: usize = 1280;
/// The map that times are of.
const MAP: (usize, usize) = (512, 256);
/// Directions of which forms that cost the same everywhere are asked.
const ASKED: usize = 512;

/// The paper's table: the 32 anchors nearest to each pixel of a 1024 x 512 map, 2 bytes each.
const LISTED: usize = 32;

/// A scene's light on all anchors.
fn lit(map: &LinearImage) -> FarField<N> {
    let mut far = FarField::<N>::new(FarParams::default(), [0.0; 3]);
    for i in 0..N {
        let d = Lattice::<N>::direction(i);
        let c = map.towards(v3(f64::from(d.x), f64::from(d.y), f64::from(d.z)));
        far.sample(d, [c.x as f32, c.y as f32, c.z as f32], 1.0, Timestamp::ZERO);
    }
    far
}

/// Independent random colours: the hardest there is.
fn random(seed: u64) -> FarField<N> {
    let mut far = FarField::<N>::new(FarParams::default(), [0.0; 3]);
    let mut state = seed as u32;
    for i in 0..N {
        let colour = [(); 3].map(|()| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        });
        far.sample(Lattice::<N>::direction(i), colour, 1.0, Timestamp::ZERO);
    }
    far
}

/// Of linear light, 1 being the peak, over all directions alike; and the largest difference.
fn against<'a>(exact: &'a [[f32; 3]], found: impl Iterator<Item = [f32; 3]> + 'a) -> [f64; 2] {
    let (mut sum, mut n, mut worst) = (0.0, 0.0, 0.0_f64);
    for (a, b) in exact.iter().flatten().zip(found.flatten()) {
        let off = f64::from((a - b).abs());
        (sum, n, worst) = (sum + off * off, n + 1.0, worst.max(off));
    }
    [-10.0 * (sum / n).max(1e-12).log10(), worst]
}

/// PSNR for a scene and for random colours, largest error of both, milliseconds of a map, bytes of tables.
pub(super) fn measure(scene: &LinearImage, seed: u64, effort: &Effort) -> Result<Vec<Line>, BenchError> {
    // Even directions.
    let asked: Vec<Vec3> = (0..ASKED).map(Lattice::<ASKED>::direction).collect();
    let lists: Vec<[u16; LISTED]> = asked.iter().map(|d| nearest_anchors::<N, LISTED>(*d)).collect();
    let mut fields = [lit(scene), random(seed)];
    let exact: Vec<Vec<[f32; 3]>> = fields.iter().map(|f| asked.iter().map(|d| f.sum_all(*d)).collect()).collect();
    let mut fine = Box::new(FarMap::<128, 64>::new());
    let mut coarse = Box::new(FarMap::<64, 32>::new());
    let mut errors = [[[0.0; 2]; 2]; 3];
    for (i, (field, exact)) in fields.iter_mut().zip(&exact).enumerate() {
        errors[0][i] = against(exact, asked.iter().zip(&lists).map(|(d, list)| field.sum_listed(*d, list)));
        let mut twin = field.clone();
        *fine = FarMap::new();
        fine.update(&mut twin);
        errors[1][i] = against(exact, asked.iter().map(|d| fine.towards(*d)));
        *coarse = FarMap::new();
        coarse.update(field);
        errors[2][i] = against(exact, asked.iter().map(|d| coarse.towards(*d)));
    }

    let [mut changing, field] = fields;
    let (mut anew, mut follows) = (field.clone(), field.clone());
    let _ = fine.update(&mut follows);
    let pixels = || vec![[0_u8; 3]; MAP.0 * MAP.1];
    let (mut out_fine, mut out_coarse, mut out_follows) = (pixels(), pixels(), pixels());
    let view = |pixels| ImageViewMut::new(pixels, MAP.0, MAP.1).map_err(BenchError::core);
    let (mut out_fine, mut out_coarse, mut out_follows) =
        (view(out_fine.as_mut_slice())?, view(out_coarse.as_mut_slice())?, view(out_follows.as_mut_slice())?);
    let mut grids = (Box::new(FarMap::<128, 64>::new()), Box::new(FarMap::<64, 32>::new()));
    let score = || Score::of([0.0]);
    let mut tick = 0_u32;
    let mut methods = [
        Method::new("all", ASKED, || asked.iter().for_each(|d| _ = std::hint::black_box(field.sum_all(*d))), score),
        Method::new(
            "listed",
            ASKED,
            || asked.iter().zip(&lists).for_each(|(d, l)| _ = std::hint::black_box(field.sum_listed(*d, l))),
            score,
        ),
        Method::new(
            "grid",
            MAP.0 * MAP.1,
            || {
                *grids.0 = FarMap::new();
                grids.0.update(&mut anew);
                grids.0.render(&mut out_fine);
            },
            score,
        ),
        Method::new(
            "small grid",
            MAP.0 * MAP.1,
            || {
                *grids.1 = FarMap::new();
                grids.1.update(&mut changing);
                grids.1.render(&mut out_coarse);
            },
            score,
        ),
        Method::new(
            "followed",
            MAP.0 * MAP.1,
            || {
                // A far frame's worth of anchors: a patch of the sky.
                tick += 1;
                for i in 600..660 {
                    let v = (i as u32 * 37 + tick * 11) % 97;
                    follows.sample(Lattice::<N>::direction(i), [v as f32 / 97.0; 3], 32.0, Timestamp::ZERO);
                }
                fine.update(&mut follows);
                fine.render(&mut out_follows);
            },
            score,
        ),
    ];
    let times = alternating(&mut methods, effort);
    let milliseconds = |i: usize| times.get(i).map_or(f64::NAN, |t| t.best * (MAP.0 * MAP.1) as f64 / 1e6);
    let kib = |bytes: usize| bytes as f64 / 1024.0;
    let lattice = kib(size_of::<[[f32; 3]; N]>());
    let line = |name: &str, errors: [[f64; 2]; 2], ms: f64, table: f64| {
        let [[scene, worst_a], [random, worst_b]] = errors;
        Line::new(name, vec![scene, random, worst_a.max(worst_b), ms, table])
    };
    let [listed, fine_errors, coarse_errors] = errors;
    Ok(vec![
        Line::new("all 1280 (the definition)", vec![f64::NAN, f64::NAN, 0.0, milliseconds(0), lattice]),
        line("32 nearest (the paper's)", listed, milliseconds(1), kib(1024 * 512 * LISTED * 2)),
        line("grid 128x64, anew", fine_errors, milliseconds(2), lattice + kib(size_of::<FarMap<128, 64>>())),
        line("grid 128x64, 60 changed", fine_errors, milliseconds(4), lattice + kib(size_of::<FarMap<128, 64>>())),
        line("grid 64x32, anew", coarse_errors, milliseconds(3), lattice + kib(size_of::<FarMap<64, 32>>())),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn the_grid_that_ships_is_close_to_the_sum() {
        let effort = Effort { rounds: 2, batch: Duration::ZERO, longest: Duration::from_millis(1) };
        let lines = measure(&LinearImage::filled(64, 32, [0.5, 0.2, 0.1]), 5, &effort).unwrap();
        assert_eq!(lines.len(), 5);
        let grid = &lines[2].cells;
        assert!(grid[0] > 90.0 && grid[1] > 60.0 && grid[2] < 0.01 && grid[3] > 0.0, "{grid:?}");
    }
}
