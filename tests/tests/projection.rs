//! Pixels to points and back, against the pinhole and Brown-Conrady formulas in `f64`: 640 x 480, 0.1 to 20 m.

use glam::{DVec2, DVec3, Vec2, Vec3};
use isobath::sensing::camera::{Camera, Distortion, Intrinsics};
use proptest::prelude::*;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
/// Pixels.
const PIXEL_BOUND: f64 = 1e-4;
/// Of the point's distance from the camera.
const RELATIVE_BOUND: f64 = 1e-6;
/// Pixels, through a lens and back: Newton's method in `f32` on normalised coordinates, times the focal length.
const LENS_PIXEL_BOUND: f64 = 2e-4;
/// Of the point's distance, through a lens and back.
const LENS_RELATIVE_BOUND: f64 = 1e-6;

/// fx, fy, cx, cy: Kinect, a y-up renderer (ICL-NUIM), a phone's wide and a narrow lens.
const CAMERAS: [[f32; 4]; 4] = [
    [525.0, 525.0, 319.5, 239.5],
    [481.2, -480.0, 319.5, 239.5],
    [388.7, 389.1, 322.13, 236.87],
    [1216.5, 1214.9, 301.4, 251.9],
];

/// Kinect v1 colour, a wide rational lens of Azure Kinect's shape, a mild barrel.
const LENSES: [[f32; 8]; 3] = [
    [0.2624, -0.9531, -0.0054, 0.0026, 1.1633, 0.0, 0.0, 0.0],
    [2.5, 1.4, 0.0003, -0.0002, 0.08, 2.83, 2.1, 0.38],
    [-0.28, 0.07, 0.0002, 0.000_02, 0.0, 0.0, 0.0, 0.0],
];

fn camera(k: [f32; 4]) -> Intrinsics {
    Intrinsics::new(k[0], k[1], k[2], k[3]).unwrap()
}

fn unproject_f64(k: [f32; 4], pixel: Vec2, z: f32) -> DVec3 {
    let [fx, fy, cx, cy] = k.map(f64::from);
    let z = f64::from(z);
    DVec3::new((f64::from(pixel.x) - cx) * z / fx, (f64::from(pixel.y) - cy) * z / fy, z)
}

/// The pixel that sees a point, the lens's formula as OpenCV prints it.
fn project_f64(k: [f32; 4], lens: [f32; 8], point: Vec3) -> DVec2 {
    let [fx, fy, cx, cy] = k.map(f64::from);
    let [k1, k2, p1, p2, k3, k4, k5, k6] = lens.map(f64::from);
    let p = point.as_dvec3();
    let (x, y) = (p.x / p.z, p.y / p.z);
    let r2 = x * x + y * y;
    let s = (1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3)) / (1.0 + k4 * r2 + k5 * r2.powi(2) + k6 * r2.powi(3));
    let xd = x * s + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let yd = y * s + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    DVec2::new(fx * xd + cx, fy * yd + cy)
}

/// The largest errors seen.
#[derive(Debug, Default)]
struct Worst {
    pixel: f64,
    relative: f64,
}

impl Worst {
    fn pixel(&mut self, got: Vec2, want: DVec2) {
        self.pixel = self.pixel.max((got.as_dvec2() - want).length());
    }

    fn relative(&mut self, got: Vec3, want: DVec3) {
        self.relative = self.relative.max((got.as_dvec3() - want).length() / want.length());
    }
}

/// Depths from 0.1 to 20 m, evenly in the logarithm.
fn depths(count: u16) -> impl Iterator<Item = f32> {
    (0..count).map(move |i| (0.1 * 200_f64.powf(f64::from(i) / f64::from(count - 1))) as f32)
}

#[test]
fn pinhole_round_trips_at_every_pixel() {
    let mut worst = Worst::default();
    for k in CAMERAS {
        let c = camera(k);
        for z in depths(23) {
            for (x, y) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
                let pixel = Vec2::new(x as f32, y as f32);
                let point = c.unproject(pixel, z);
                worst.relative(point, unproject_f64(k, pixel, z));
                let back = c.project(point).unwrap();
                worst.pixel(back, pixel.as_dvec2());
                worst.pixel(back, project_f64(k, [0.0; 8], point));
                worst.relative(c.unproject(back, z), point.as_dvec3());
            }
        }
    }
    println!("pinhole: {worst:?}");
    assert!(worst.pixel < PIXEL_BOUND && worst.relative < RELATIVE_BOUND, "{worst:?}");
}

/// Whether the lens model is one-to-one out to this pixel: a fit is not, beyond the image it was made for.
fn inside_model(c: &Camera, pixel: Vec2) -> bool {
    c.ray(pixel).is_some_and(|ray| ray.truncate().length() < 0.8)
}

#[test]
fn lenses_round_trip() {
    let mut worst = Worst::default();
    let (mut asked, mut answered) = (0_u32, 0_u32);
    for (k, lens) in CAMERAS.into_iter().flat_map(|k| LENSES.map(|lens| (k, lens))) {
        let c = Camera { intrinsics: camera(k), distortion: Distortion::Brown8(lens) };
        for (x, y) in (0..HEIGHT).step_by(7).flat_map(|y| (0..WIDTH).step_by(7).map(move |x| (x, y))) {
            let pixel = Vec2::new(x as f32, y as f32);
            asked += 1;
            if !inside_model(&c, pixel) {
                continue;
            }
            answered += 1;
            for z in depths(7) {
                let point = c.unproject(pixel, z).unwrap();
                let back = c.project(point).unwrap();
                worst.pixel(back, pixel.as_dvec2());
                worst.pixel(back, project_f64(k, lens, point));
                worst.relative(c.unproject(back, z).unwrap(), point.as_dvec3());
            }
        }
    }
    println!("lenses: {worst:?}, {answered} of {asked} pixels have a ray");
    assert!(worst.pixel < LENS_PIXEL_BOUND && worst.relative < LENS_RELATIVE_BOUND, "{worst:?}");
    assert!(answered * 10 > asked * 9, "{answered} of {asked}");
}

#[test]
fn z_and_range_are_each_others_inverse() {
    let mut worst: f64 = 0.0;
    for k in CAMERAS {
        let c = camera(k);
        for z in depths(11) {
            for (x, y) in [(0.0, 0.0), (639.0, 0.0), (0.0, 479.0), (639.0, 479.0), (320.0, 240.0)] {
                let pixel = Vec2::new(x, y);
                let range = c.range_from_z(pixel, z);
                let want = unproject_f64(k, pixel, z).length();
                worst = worst.max((f64::from(range) - want).abs() / want);
                worst = worst.max(f64::from((c.z_from_range(pixel, range) - z).abs() / z));
            }
        }
    }
    assert!(worst < RELATIVE_BOUND, "{worst}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn any_camera_any_fraction_of_a_pixel(
        fx in 150.0_f32..1500.0, ratio in 0.9_f32..1.1, up in any::<bool>(), cx in 200.0_f32..440.0, cy in 150.0_f32..330.0,
        x in -0.5_f32..639.5, y in -0.5_f32..479.5, z in 0.1_f32..20.0,
    ) {
        let k = [fx, if up { -fx * ratio } else { fx * ratio }, cx, cy];
        let c = camera(k);
        let pixel = Vec2::new(x, y);
        let point = c.unproject(pixel, z);
        let back = c.project(point).unwrap();
        let mut worst = Worst::default();
        worst.relative(point, unproject_f64(k, pixel, z));
        worst.pixel(back, pixel.as_dvec2());
        worst.pixel(back, project_f64(k, [0.0; 8], point));
        worst.relative(c.unproject(back, z), point.as_dvec3());
        prop_assert!(worst.pixel < PIXEL_BOUND && worst.relative < RELATIVE_BOUND, "{worst:?}");
    }
}
