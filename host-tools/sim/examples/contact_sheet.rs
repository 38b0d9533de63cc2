//! Writes one PNG a scene, colour, depth and normals side by side: `cargo run --release -p isobath-sim --example contact_sheet -- OUT [SCENE] [WIDTH]`.

use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use isobath_sim::{NAMES, Rigid, Scene, SimCamera};

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

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let out = PathBuf::from(args.next().ok_or("give a folder")?);
    let only = args.next().filter(|s| s != "all");
    let width: usize = args.next().map_or(Ok(640), |w| w.parse())?;
    std::fs::create_dir_all(&out)?;
    for name in NAMES.iter().filter(|n| only.as_deref().is_none_or(|o| o == **n)) {
        let scene = Scene::open(name)?;
        let camera = SimCamera::from_fov(width, width * 3 / 4, 1.1)?;
        let pose = Rigid::looking_at(scene.view().eye, scene.view().target);
        let start = Instant::now();
        let (truth, colour) = scene.render(1.4, &camera, &pose);
        let seconds = start.elapsed().as_secs_f64();
        let rgb = scene.to_srgb(&colour);
        let (low, high) =
            truth.z.iter().filter(|z| **z > 0.0).fold((f64::MAX, 0.0_f64), |(l, h), &z| (l.min(z), h.max(z)));
        println!("{name}: {seconds:.3} s, depth {low:.2} to {high:.2} m, {} segments", scene.segments().len());
        let mut sheet = image::RgbImage::new(3 * width as u32, (width * 3 / 4) as u32);
        for (i, &z) in truth.z.iter().enumerate() {
            let (x, y) = ((i % width) as u32, (i / width) as u32);
            sheet.put_pixel(x, y, image::Rgb(rgb[i]));
            let shade =
                if z > 0.0 { turbo((1.0 / z - 1.0 / high) / (1.0 / low - 1.0 / high).max(1e-9)) } else { [0; 3] };
            sheet.put_pixel(x + width as u32, y, image::Rgb(shade));
            let [nx, ny, nz] = truth.normals[i];
            let shade = [nx, -ny, -nz].map(|v| ((0.5 + 0.5 * v) * 255.0) as u8);
            sheet.put_pixel(x + 2 * width as u32, y, image::Rgb(if z > 0.0 { shade } else { [0; 3] }));
        }
        sheet.save(out.join(format!("{name}.png")))?;
    }
    Ok(())
}
