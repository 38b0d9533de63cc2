//! Renders the frames, compresses them, runs the job on them, and writes all of it down as Rust.
//!
//! The job runs here on the host: what it says is what the images are held to.

use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::{env, fs};

use isobath::glam::Vec3;
use isobath::ground::image::ImageView;
use isobath::wire::rvl;
use isobath_firmware_job::others::{self, Scratch};
use isobath_firmware_job::{Answers, H, Job, Memory, Packed, Unmeasured, View, W};
use isobath_sim::{CameraPath, SimFrame, SimOptions, Simulation};

/// Frames walking (a fifth of a second apart), and frames standing (in which only the noise changes).
const WALKING: usize = 4;
const STANDING: usize = 2;

/// The numbers, written down.
#[derive(Default)]
struct Written(Vec<u32>);

impl Answers for Written {
    fn number(&mut self, _: &'static str, value: f32) {
        self.0.push(value.to_bits());
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("no OUT_DIR")?);
    let mut scenes = String::new();
    let mut memory = Box::new(Memory::NEW);
    let mut last = None;
    let mut index = 0;
    {
        let mut job = Job::new(&mut memory, CENTRE).map_err(|_| "the job refuses its memory")?;
        for (path, frames) in [(CameraPath::Walk, WALKING), (CameraPath::Still, STANDING)] {
            let simulation = room(path, frames)?;
            for frame in simulation.iter() {
                let (bytes, view) = pack(&simulation, &frame)?;
                let mut said = Written::default();
                let packed = Packed { depth: &bytes, view };
                job.frame(&packed, &mut Unmeasured, &mut said).map_err(|_| "the job refuses a frame")?;
                fs::write(out.join(format!("{index}.rvl")), &bytes)?;
                writeln!(
                    scenes,
                    "    Scene {{\n        frame: Packed {{ depth: include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{index}.rvl\")), \
                     view: {view:?} }},\n        answers: &{:?},\n    }},",
                    said.0
                )?;
                last = Some((bytes, view));
                index += 1;
            }
        }
    }
    let (bytes, view) = last.ok_or("no frames")?;
    let mut said = Written::default();
    let mut scratch = Box::new(Scratch::NEW);
    let packed = Packed { depth: &bytes, view };
    others::measure(&packed, &mut memory, &mut scratch, &mut Unmeasured, &mut said)
        .map_err(|_| "the last frame is refused")?;
    let text = format!(
        "/// The frames, in order.\npub static SCENES: [Scene; {index}] = [\n{scenes}];\n\n\
         /// What the host's run of the other capabilities says of the last frame.\npub static OTHERS: &[u32] = &{:?};\n\n\
         /// Middle of the height map, world, metres.\npub const CENTRE: [f32; 3] = {:?};\n",
        said.0,
        CENTRE.to_array()
    );
    fs::write(out.join("stream.rs"), text)?;
    Ok(())
}

/// Between the viewer and the table of the living room.
const CENTRE: Vec3 = Vec3::new(0.6, 0.0, -0.2);

fn room(path: CameraPath, frames: usize) -> Result<Simulation, Box<dyn Error>> {
    let options = SimOptions {
        size: (W, H),
        frames,
        frame_rate: 5.0,
        path,
        sensor: "kinect".parse()?,
        unit: Some(0.001),
        colour: false,
        seed: 4,
        ..SimOptions::default()
    };
    Ok(Simulation::open("living-room", options)?)
}

fn pack(simulation: &Simulation, frame: &SimFrame) -> Result<(Vec<u8>, View), Box<dyn Error>> {
    let depth = frame.depth_u16(0.001);
    let mut bytes = vec![0; rvl::most_bytes(depth.len())];
    let used = rvl::encode(ImageView::new(&depth, W, H)?, &mut bytes)?;
    bytes.truncate(used);
    let k = simulation.depth_camera();
    let view = View {
        camera: [k.fx, k.fy, k.cx, k.cy].map(|v| v as f32),
        rotation: frame.pose.rotation.quaternion().map(|v| v as f32),
        place: frame.pose.translation.to_f32(),
    };
    Ok((bytes, view))
}
