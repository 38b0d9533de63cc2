//! How long a frame with all its ground truth takes: `cargo run --release -p isobath-sim --example speed -- [SCENE] [FRAMES] [WxH] [SENSOR]`.

use std::error::Error;
use std::time::Instant;

use isobath_sim::{NAMES, SimOptions, Simulation};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let text = |i: usize, default: &str| args.get(i).cloned().unwrap_or_else(|| default.to_owned());
    let (scene, frames) = (text(0, "all"), text(1, "4").parse()?);
    let size = text(2, "640x480");
    let (w, h) = size.split_once('x').ok_or("give a size like 640x480")?;
    for name in NAMES.iter().filter(|n| scene == "all" || **n == scene) {
        let options = SimOptions {
            size: (w.parse()?, h.parse()?),
            frames,
            sensor: text(3, "kinect").parse()?,
            ..SimOptions::default()
        };
        let simulation = Simulation::open(name, options)?;
        // The best frame: what others do on this machine can only add.
        let mut best = f64::INFINITY;
        let start = Instant::now();
        for i in 0..frames {
            let from = Instant::now();
            let frame = simulation.frame(i);
            std::hint::black_box(simulation.rgb(&frame));
            best = best.min(from.elapsed().as_secs_f64());
        }
        let mean = start.elapsed().as_secs_f64() / frames as f64;
        println!("{name}: {:.2} frames/s ({:.0} ms mean, {:.0} ms best)", 1.0 / mean, mean * 1e3, best * 1e3);
    }
    Ok(())
}
