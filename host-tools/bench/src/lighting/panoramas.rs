//! Real light: the far field from perspective crops of photographed HDR panoramas (Poly Haven), where they lie beside the project.

use std::path::Path;

use isobath::glam::{Quat, Vec3};
use isobath::ground::colour::Colour;
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::ground::units::Timestamp;
use isobath::lighting::equirect::{MapFrame, direction_of_pixel};
use isobath::lighting::far::extrapolate::FarMap;
use isobath::lighting::far::{FarField, FarParams};
use isobath::lighting::lattice::Lattice;
use isobath::sensing::camera::Intrinsics;
use isobath_sim::{Ball, LinearImage, Rigid, V3, core_pose, covers, read_linear, render_ball, v3};

use super::Plan;
use super::report::Line;
use super::score::{psnr, shrunk, solid_angle};
use super::sights::{FIELD, guided, in_parallel};
use crate::{BenchError, recordings};

/// Maps are compared at this size.
const MAP: (usize, usize) = (128, 64);
/// A far frame's size, and rays a pixel along each side.
const FRAME: (usize, usize) = (32, 24);
const RAYS: usize = 4;

/// Lines for each number of directions; and what was left out.
pub(super) fn measure(plan: &Plan, tell: &mut dyn FnMut(&str)) -> Result<(Vec<Line>, Vec<String>), BenchError> {
    let folder = recordings::root().join("hdri_polyhaven");
    let Ok(list) = std::fs::read_dir(&folder) else {
        return Ok((Vec::new(), vec![format!("HDR panoramas left out: no folder {}", folder.display())]));
    };
    let hdr = |path: &std::path::PathBuf| path.extension().is_some_and(|e| e == "hdr");
    let mut paths: Vec<_> = list.filter_map(|entry| Some(entry.ok()?.path())).filter(hdr).collect();
    paths.sort();
    paths.truncate(plan.panoramas);
    tell(&format!("lighting: {} HDR panoramas", paths.len()));
    let lines = in_parallel(paths.len(), |i| match paths.get(i) {
        Some(path) => of(path),
        None => Ok(Vec::new()),
    })?;
    Ok((lines.into_iter().flatten().collect(), Vec::new()))
}

fn of(path: &Path) -> Result<Vec<Line>, BenchError> {
    let panorama = exposed(read_linear(path)?);
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let reduced = shrunk(&panorama, MAP.0);
    let blurred = blurred(&shrunk(&panorama, 2 * MAP.0));
    // Of someone who looks slightly down at an object.
    let nine = guided(V3::ZERO, v3(0.0, -0.5, -1.0))?;
    let mut lines = Vec::new();
    for views in [nine, around()] {
        let mut far = FarField::<1280>::new(FarParams::default(), mean(&reduced));
        for view in &views {
            shoot(&panorama, view, &mut far)?;
        }
        let mut grid = Box::new(FarMap::<128, 64>::new());
        grid.update(&mut far);
        let mut pixels = vec![[0.0_f32; 3]; MAP.0 * MAP.1];
        grid.render(&mut ImageViewMut::new(&mut pixels, MAP.0, MAP.1).map_err(BenchError::core)?);
        let seen = |i: usize| {
            let d = direction_of_pixel(i % MAP.0, i / MAP.0, MAP);
            Lattice::<1280>::nearest(d).is_some_and(|anchor| far.weight(anchor) > 0.0)
        };
        let compare =
            |truth: &LinearImage, all: bool| {
                let pairs = pixels.iter().zip(&truth.pixels).enumerate().filter(|(i, _)| all || seen(*i));
                psnr(pairs.map(|(i, (a, b))| {
                    (<[u8; 3]>::of_linear(*a), <[u8; 3]>::of_linear(*b), solid_angle(i / MAP.0, MAP.1))
                }))
            };
        let share = 100.0 * far.seen() as f64 / 1280.0;
        let map = LinearImage { width: MAP.0, height: MAP.1, pixels: pixels.clone() };
        let numbers = vec![
            share,
            compare(&blurred, true),
            compare(&blurred, false),
            compare(&reduced, true),
            compare(&reduced, false),
            diffuse(&map, &reduced),
        ];
        lines.push(Line::new(&format!("{name}, {} directions", views.len()), numbers));
    }
    Ok(lines)
}

/// PSNR of a matt ball.
fn diffuse(map: &LinearImage, truth: &LinearImage) -> f64 {
    const SIDE: usize = 32;
    let view = Rigid::looking_at(v3(0.0, 0.0, 1.0), V3::ZERO);
    let [a, b] = [map, truth].map(|map| render_ball(map, Ball::Diffuse, &view, SIDE));
    let on = |i: &usize| covers(i % SIDE, i / SIDE, SIDE);
    let bytes = |image: &LinearImage, i: usize| <[u8; 3]>::of_linear(image.get(i % SIDE, i / SIDE));
    psnr((0..SIDE * SIDE).filter(on).map(|i| (bytes(&a, i), bytes(&b, i), 1.0)))
}

/// So that the middle brightness (the logarithm's mean) is 18 % of white, as a camera exposes.
fn exposed(map: LinearImage) -> LinearImage {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (i, p) in map.pixels.iter().enumerate() {
        let solid = solid_angle(i / map.width, map.height);
        let luminance = 0.2126 * f64::from(p[0]) + 0.7152 * f64::from(p[1]) + 0.0722 * f64::from(p[2]);
        sum += solid * luminance.max(1e-6).ln();
        weights += solid;
    }
    let scale = (0.18 / (sum / weights).exp()) as f32;
    LinearImage { pixels: map.pixels.iter().map(|p| p.map(|v| v * scale)).collect(), ..map }
}

fn mean(map: &LinearImage) -> [f32; 3] {
    shrunk(map, 1).get(0, 0)
}

/// 26 directions: those of a cube's faces, edges and corners.
fn around() -> Vec<Rigid> {
    let all = (0..27).map(|i| v3(f64::from(i % 3 - 1), f64::from(i / 3 % 3 - 1), f64::from(i / 9 - 1)));
    all.filter(|d| d.length() > 0.5).map(|d| Rigid::looking_at(V3::ZERO, d)).collect()
}

/// A far frame of the panorama, onto the anchors.
fn shoot(panorama: &LinearImage, view: &Rigid, far: &mut FarField<1280>) -> Result<(), BenchError> {
    let k = Intrinsics::from_fov(FIELD as f32, FRAME.0, FRAME.1)?;
    let pose = core_pose(view).unwrap_or_default();
    let mut pixels = vec![[0.0_f32; 3]; FRAME.0 * FRAME.1];
    for (i, pixel) in pixels.iter_mut().enumerate() {
        for ray in 0..RAYS * RAYS {
            let at = |i: usize, ray: usize| (i as f32 - 0.5) + (ray as f32 + 0.5) / RAYS as f32;
            let uv = glam::vec2(at(i % FRAME.0, ray % RAYS), at(i / FRAME.0, ray / RAYS));
            let d = pose.direction_to_world(k.ray(uv));
            let c = panorama.towards(v3(f64::from(d.x), f64::from(d.y), f64::from(d.z)));
            for (sum, v) in pixel.iter_mut().zip([c.x, c.y, c.z]) {
                *sum += v as f32 / (RAYS * RAYS) as f32;
            }
        }
    }
    let image = ImageView::new(&pixels, FRAME.0, FRAME.1).map_err(BenchError::core)?;
    far.add_image(image, &k, &pose, &MapFrame { at: Vec3::ZERO, rotation: Quat::IDENTITY }, Timestamp::ZERO);
    Ok(())
}

/// A map under the anchors' own kernel, the cosine to the power of 128: what no far field can be sharper than.
fn blurred(map: &LinearImage) -> LinearImage {
    // Beyond 25 degrees the kernel is below 1e-5.
    const REACH: f32 = 0.906;
    let directions: Vec<(Vec3, f32)> = (0..map.width * map.height)
        .map(|i| {
            let solid = solid_angle(i / map.width, map.height);
            (direction_of_pixel(i % map.width, i / map.width, (map.width, map.height)), solid as f32)
        })
        .collect();
    let mut out = LinearImage::filled(MAP.0, MAP.1, [0.0; 3]);
    let rows = map.height / MAP.1;
    for (i, pixel) in out.pixels.iter_mut().enumerate() {
        let d = direction_of_pixel(i % MAP.0, i / MAP.0, MAP);
        // Rows within the reach.
        let near = (25.0 / 180.0 * map.height as f32) as usize + 1;
        let middle = i / MAP.0 * rows;
        let from = middle.saturating_sub(near) * map.width;
        let to = ((middle + near + rows) * map.width).min(directions.len());
        let (mut sum, mut weights) = ([0.0_f32; 3], 0.0_f32);
        let (near, colours) = (directions.get(from..to), map.pixels.get(from..to));
        for ((p, solid), colour) in near.unwrap_or_default().iter().zip(colours.unwrap_or_default()) {
            let cosine = p.dot(d);
            if cosine > REACH {
                let weight = (0..7).fold(cosine, |w, _| w * w) * solid;
                weights += weight;
                for (sum, v) in sum.iter_mut().zip(colour) {
                    *sum += weight * v;
                }
            }
        }
        *pixel = sum.map(|s| s / weights.max(f32::MIN_POSITIVE));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_sky_comes_back_from_26_directions() {
        let sky = exposed(LinearImage::filled(256, 128, [5.0; 3]));
        assert!((sky.pixels[0][1] - 0.18).abs() < 1e-4);
        assert!(blurred(&sky).pixels.iter().all(|p| (p[0] - 0.18).abs() < 1e-4));
        let mut far = FarField::<1280>::new(FarParams::default(), [0.0; 3]);
        let views = around();
        assert_eq!(views.len(), 26);
        for view in &views {
            shoot(&sky, view, &mut far).unwrap();
        }
        assert_eq!(far.seen(), 1280, "they cover everything");
        assert!((0..1280).all(|i| (far.colour(i)[0] - 0.18).abs() < 1e-4));
        assert!(diffuse(&sky, &sky) > 99.0);
    }
}
