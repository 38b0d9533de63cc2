//! Pictures of every scene, to look at: colour, depth, normals; depth as three sensors see it; the light at a place and balls in it.
//! `cargo run --release -p isobath-sim --example contact_sheet -- OUT [SCENE|all] [WIDTH]`.

use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use isobath_sim::{Ball, NAMES, Rigid, Scene, SensorModel, render_ball};

/// Google's Turbo, by its polynomial (Mikhailov 2019).
fn turbo(t: f64) -> [u8; 3] {
    let t = t.clamp(0.0, 1.0);
    let p = |c: [f64; 6]| {
        let v = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
        (v.clamp(0.0, 1.0) * 255.0) as u8
    };
    [
        p([0.135_721_38, 4.615_392_60, -42.660_322_58, 132.131_082_34, -152.942_393_96, 59.286_379_43]),
        p([0.091_402_61, 2.194_188_39, 4.842_966_58, -14.185_033_33, 4.277_298_57, 2.829_566_04]),
        p([0.106_673_30, 12.641_946_08, -60.582_048_36, 110.362_767_71, -89.903_109_12, 27.348_249_73]),
    ]
}

/// A picture as wide as several images side by side.
struct Sheet {
    image: image::RgbImage,
    next: u32,
}

impl Sheet {
    fn new(width: usize, height: usize) -> Self {
        Self { image: image::RgbImage::new(width as u32, height as u32), next: 0 }
    }

    /// Adds an image to the right of the last.
    fn add(&mut self, width: usize, pixels: impl IntoIterator<Item = [u8; 3]>) {
        for (i, p) in pixels.into_iter().enumerate() {
            let (x, y) = (self.next + (i % width) as u32, (i / width) as u32);
            if x < self.image.width() && y < self.image.height() {
                self.image.put_pixel(x, y, image::Rgb(p));
            }
        }
        self.next += width as u32;
    }
}

/// Depth as Turbo over inverse depth; holes black.
fn depth_colours(z: &[f64], low: f64, high: f64) -> impl Iterator<Item = [u8; 3]> + '_ {
    let span = (1.0 / low - 1.0 / high).max(1e-9);
    z.iter().map(move |&z| if z > 0.0 { turbo((1.0 / z - 1.0 / high) / span) } else { [0; 3] })
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let out = PathBuf::from(args.next().ok_or("give a folder")?);
    let only = args.next().filter(|s| s != "all");
    let width: usize = args.next().map_or(Ok(640), |w| w.parse())?;
    let height = width * 3 / 4;
    std::fs::create_dir_all(&out)?;
    for name in NAMES.iter().filter(|n| only.as_deref().is_none_or(|o| o == **n)) {
        let scene = Scene::open(name)?;
        let camera = scene.camera(width, height)?;
        let pose = Rigid::looking_at(scene.view().eye, scene.view().target);
        let start = Instant::now();
        let (truth, colour) = scene.render(1.4, &camera, &pose);
        let seconds = start.elapsed().as_secs_f64();
        let seen = truth.z.iter().copied().filter(|z| *z > 0.0);
        let (low, high) = seen.fold((f64::MAX, 0.0_f64), |(l, h), z| (l.min(z), h.max(z)));
        println!("{name}: {seconds:.3} s, depth {low:.2} to {high:.2} m, {} segments", scene.segments().len());

        let mut sheet = Sheet::new(3 * width, height);
        sheet.add(width, scene.to_srgb(&colour));
        sheet.add(width, depth_colours(&truth.z, low, high.min(20.0 * low)));
        let normals = truth.normals.iter().zip(&truth.z);
        sheet.add(
            width,
            normals.map(
                |([x, y, z], &d)| {
                    if d > 0.0 { [*x, -y, -z].map(|v| ((0.5 + 0.5 * v) * 255.0) as u8) } else { [0; 3] }
                },
            ),
        );
        sheet.image.save(out.join(format!("{name}.png")))?;

        let mut sheet = Sheet::new(3 * width, height);
        for sensor in ["kinect-full", "tof", "stereo"] {
            let sensed = sensor.parse::<SensorModel>()?.sense(&truth, &camera, 1, 3);
            sheet.add(width, depth_colours(&sensed.z, low, high.min(20.0 * low)));
        }
        sheet.image.save(out.join(format!("{name}-sensors.png")))?;

        let (place, at) = scene.places().iter().next().ok_or("the scene has no places")?;
        let map = scene.environment_map(1.4, *at, 512, 2);
        let mut sheet = Sheet::new(512 + 3 * 256, 256);
        sheet.add(512, scene.to_srgb(&map));
        for ball in [Ball::Mirror, Ball::Glossy, Ball::Diffuse] {
            sheet.add(256, scene.to_srgb(&render_ball(&map, ball, &Rigid::looking_at(scene.view().eye, *at), 256)));
        }
        sheet.image.save(out.join(format!("{name}-light-{}.png", place.replace(' ', "-"))))?;
    }
    Ok(())
}
