//! From rays to pictures: exact depth, normals and segments, and colour by direct light with shadows.
//!
//! One ray through each pixel's centre, z = 1, so that the ray's parameter is z depth itself. Colour is the sum of what lights
//! give (diffuse, with shadows), the scene's ambient light, what the surface emits, and for mirrors what they reflect. Light that
//! bounces between diffuse surfaces is not followed: ambient light stands for it.
//!
//! Rows are shared out to threads; no result depends on how.

pub(crate) mod ball;
pub(crate) mod camera;
pub(crate) mod environment;
pub(crate) mod light;
pub(crate) mod sky;
pub(crate) mod srgb;
pub(crate) mod surface;

use rayon::prelude::*;

use crate::maths::{Rigid, V3};
use crate::scene::{Hit, World};
use crate::shape::Ray;
use camera::SimCamera;
use sky::LinearImage;

/// Nothing nearer than this is seen, in lengths of the ray's direction (metres of depth for camera rays).
const NEAR: f64 = 1e-4;
/// Mirrors within mirrors.
const BOUNCES: u32 = 3;

/// What a camera sees, without error: one value a pixel, row after row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GroundTruth {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// z depth, metres; 0 where nothing is.
    pub z: Vec<f64>,
    /// Geometric normals, unit, in the camera's frame, facing the camera; 0 0 0 where nothing is.
    pub normals: Vec<[f32; 3]>,
    /// Segment ids ([`crate::Scene::segments`]); 0 where nothing is.
    pub segments: Vec<u16>,
}

impl GroundTruth {
    /// Depth rounded to `f32` metres.
    #[must_use]
    pub fn depth_f32(&self) -> Vec<f32> {
        self.z.iter().map(|&z| z as f32).collect()
    }
}

/// What is remembered from pixel to pixel of a row: the last object that shadowed each light.
struct Memory {
    shadows: Vec<Option<u32>>,
}

impl Memory {
    fn new(world: &World<'_>) -> Self {
        Self { shadows: vec![None; world.scene.lights.len()] }
    }
}

/// The ray of a camera's pixel in the world, z = 1; `None` where the lens sees nothing.
fn pixel_ray(camera: &SimCamera, pose: &Rigid, x: f64, y: f64) -> Option<Ray> {
    let d = camera.ray(x, y)?;
    Some(Ray { origin: pose.translation, direction: pose.rotation.apply(d) })
}

/// Depth, normals and segments; and colour through the same rays when asked.
pub(crate) fn see(
    world: &World<'_>,
    camera: &SimCamera,
    pose: &Rigid,
    colour: bool,
) -> (GroundTruth, Option<LinearImage>) {
    let (width, height) = (camera.width, camera.height);
    let n = width * height;
    let mut truth = GroundTruth { width, height, z: vec![0.0; n], normals: vec![[0.0; 3]; n], segments: vec![0; n] };
    let mut image = LinearImage::filled(width, height, [0.0; 3]);
    let rows = truth
        .z
        .par_chunks_mut(width.max(1))
        .zip(truth.normals.par_chunks_mut(width.max(1)))
        .zip(truth.segments.par_chunks_mut(width.max(1)))
        .zip(image.pixels.par_chunks_mut(width.max(1)))
        .enumerate();
    rows.for_each(|(y, (((z, normals), segments), colours))| {
        let mut memory = Memory::new(world);
        for x in 0..width {
            let Some(ray) = pixel_ray(camera, pose, x as f64, y as f64) else { continue };
            let hit = world.first(&ray, NEAR, f64::INFINITY);
            if let Some(hit) = &hit {
                z[x] = hit.t;
                normals[x] = pose.rotation.undo(hit.normal).to_f32();
                segments[x] = hit.segment;
            }
            if colour {
                colours[x] = seen(world, &ray, hit, BOUNCES, &mut memory).to_f32();
            }
        }
    });
    (truth, colour.then_some(image))
}

/// Colour alone, the mean of `samples` x `samples` rays a pixel.
pub(crate) fn colour(world: &World<'_>, camera: &SimCamera, pose: &Rigid, samples: u32) -> LinearImage {
    let mut image = LinearImage::filled(camera.width, camera.height, [0.0; 3]);
    let n = f64::from(samples.max(1));
    image.pixels.par_chunks_mut(camera.width.max(1)).enumerate().for_each(|(y, row)| {
        let mut memory = Memory::new(world);
        for (x, pixel) in row.iter_mut().enumerate() {
            let mut sum = V3::ZERO;
            for i in 0..samples.max(1) * samples.max(1) {
                let dx = (f64::from(i % samples.max(1)) + 0.5) / n - 0.5;
                let dy = (f64::from(i / samples.max(1)) + 0.5) / n - 0.5;
                if let Some(ray) = pixel_ray(camera, pose, x as f64 + dx, y as f64 + dy) {
                    sum += trace(world, &ray, NEAR, BOUNCES, &mut memory);
                }
            }
            *pixel = (sum / (n * n)).to_f32();
        }
    });
    image
}

/// Radiance along a ray.
fn trace(world: &World<'_>, ray: &Ray, near: f64, bounces: u32, memory: &mut Memory) -> V3 {
    let hit = world.first(ray, near, f64::INFINITY);
    seen(world, ray, hit, bounces, memory)
}

/// Radiance along a ray whose first hit is known.
fn seen(world: &World<'_>, ray: &Ray, hit: Option<Hit>, bounces: u32, memory: &mut Memory) -> V3 {
    let scene = world.scene;
    let Some(hit) = hit else { return scene.sky.radiance(ray.direction) };
    let Some(material) = scene.materials.get(hit.material as usize) else { return V3::ZERO };
    let emitted = if hit.front { material.emission } else { V3::ZERO };
    let mut irradiance = V3::ZERO;
    if material.mirror < 1.0 {
        for (light, last) in scene.lights.iter().zip(&mut memory.shadows) {
            irradiance += light.irradiance(world, hit.point, hit.normal, last);
        }
    }
    let ambient = scene.ambient[1].lerp(scene.ambient[0], 0.5 + 0.5 * hit.normal.y);
    let diffuse = material.albedo(hit.local, hit.uv).times(irradiance * std::f64::consts::FRAC_1_PI + ambient);
    if material.mirror == 0.0 || bounces == 0 {
        return emitted + diffuse * (1.0 - material.mirror);
    }
    let d = ray.direction;
    let reflected =
        Ray { origin: hit.point + hit.normal * 1e-6, direction: d - hit.normal * (2.0 * d.dot(hit.normal)) };
    let mirrored = trace(world, &reflected, 0.0, bounces - 1, memory);
    emitted + diffuse * (1.0 - material.mirror) + mirrored * material.mirror
}
