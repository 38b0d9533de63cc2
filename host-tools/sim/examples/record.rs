//! Writes a simulated recording: `cargo run --release -p isobath-sim --example record -- SCENE OUT [FRAMES] [SENSOR]`.

use std::error::Error;
use std::time::Instant;

use isobath_sim::{Scene, SimOptions, write_recording};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [scene, out, rest @ ..] = args.as_slice() else { return Err("give a scene and a folder".into()) };
    let frames = rest.first().map_or(Ok(10), |n| n.parse())?;
    let sensor = rest.get(1).map_or("kinect", String::as_str).parse()?;
    let options = SimOptions { frames, sensor, ..SimOptions::default() };
    let start = Instant::now();
    let summary = write_recording(&Scene::open(scene)?, &options, out.as_ref(), |done, total| {
        eprintln!("{done} of {total}, {:.1} s", start.elapsed().as_secs_f64());
    })?;
    println!("{summary:?}");
    Ok(())
}
