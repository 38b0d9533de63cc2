//! Renders the frames, compresses them, runs the job on them, and writes all of it down as Rust.
//!
//! The job runs here on the host: what it says is what the images are held to.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use isobath::glam::Vec3;
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::frame::DepthFrame;
use isobath::wire::keyframe::{FarOptions, NearOptions, encode_far, encode_near, near_most_bytes};
use isobath::wire::rvl;
use isobath_firmware_job::lighting::{self, TINY};
use isobath_firmware_job::others::{self, Scratch};
use isobath_firmware_job::{Answers, H, Job, LightMemory, Memory, Packed, Surroundings, Unmeasured, View, W};
use isobath_sim::{CameraPath, Rigid, SimFrame, SimOptions, Simulation};

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
    let light = light(&out)?;
    let text = format!(
        "/// The frames, in order.\npub static SCENES: [Scene; {index}] = [\n{scenes}];\n\n\
         /// What the host's run of the other capabilities says of the last frame.\npub static OTHERS: &[u32] = &{:?};\n\n\
         {light}\n\
         /// Middle of the height map, world, metres.\npub const CENTRE: [f32; 3] = {:?};\n",
        said.0,
        CENTRE.to_array()
    );
    fs::write(out.join("stream.rs"), text)?;
    Ok(())
}

/// The place on the living room's table, and what a person sees who walks around it: a near view, a picture of what is behind that
/// person, a near view from a sixth of a turn on. As key frames; and what the host says of the object's light.
fn light(out: &Path) -> Result<String, Box<dyn Error>> {
    let options = SimOptions {
        size: TINY.view,
        frames: 48,
        frame_rate: 6.0,
        path: CameraPath::Orbit,
        place: Some("table".into()),
        unit: Some(0.001),
        ..SimOptions::default()
    };
    let simulation = Simulation::open("living-room", options)?;
    let place = *simulation.scene().places().get("table").ok_or("the living room has no table")?;
    let (first, later) = (simulation.frame(0), simulation.frame(8));
    let eye = first.pose.translation;
    let behind = Rigid::looking_at(eye, eye + (eye - place));
    let behind_colour = simulation.scene().render_colour(0.0, simulation.depth_camera(), &behind, 1);
    let messages = [
        key_frame(&simulation, &first, 1, false)?,
        key_frame(&simulation, &SimFrame { pose: behind, radiance: behind_colour, ..first.clone() }, 2, true)?,
        key_frame(&simulation, &later, 3, false)?,
    ];
    let borrowed: Vec<&[u8]> = messages.iter().map(Vec::as_slice).collect();
    let mut memory = Box::new(LightMemory::NEW);
    let mut said = Written::default();
    let around = Surroundings { place: place.to_f32(), messages: &borrowed };
    lighting::measure(&around, &mut memory, &mut Unmeasured, &mut said).map_err(|_| "the light refuses a key frame")?;
    let mut list = String::new();
    for (i, message) in messages.iter().enumerate() {
        fs::write(out.join(format!("light-{i}.key")), message)?;
        write!(list, "include_bytes!(concat!(env!(\"OUT_DIR\"), \"/light-{i}.key\")), ")?;
    }
    Ok(format!(
        "/// Key frames around an object.\npub static LIGHT: Surroundings<'static> = Surroundings {{ place: {:?}, messages: &[{list}] }};\n\n\
         /// What the host says of its light.\npub static LIGHT_ANSWERS: &[u32] = &{:?};\n\n",
        around.place, said.0
    ))
}

/// A frame as a near key frame of all its pixels, or as a far one.
fn key_frame(simulation: &Simulation, frame: &SimFrame, view: u16, far: bool) -> Result<Vec<u8>, Box<dyn Error>> {
    let (depth, colour) = (frame.depth_u16(0.001), simulation.rgb(frame));
    let (width, height) = TINY.view;
    let (camera, pose) = view_of(simulation, frame).read().ok_or("the core refuses the camera")?;
    let frame = DepthFrame::new(ImageView::new(&depth, width, height)?, DepthUnit::MILLIMETRE, camera)
        .with_colour(ImageView::new(&colour, width, height)?)?
        .with_pose(pose)
        .with_time(Timestamp::from_nanos(frame.time), view.into());
    let mut bytes = vec![0; near_most_bytes(width, height)];
    let used = if far {
        encode_far(&frame, &FarOptions { view, ..FarOptions::DEFAULT }, &mut bytes)?
    } else {
        encode_near(&frame, &NearOptions { view, ..NearOptions::DEFAULT }, &mut bytes)?
    };
    bytes.truncate(used);
    Ok(bytes)
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
    Ok((bytes, view_of(simulation, frame)))
}

fn view_of(simulation: &Simulation, frame: &SimFrame) -> View {
    let k = simulation.depth_camera();
    View {
        camera: [k.fx, k.fy, k.cx, k.cy].map(|v| v as f32),
        rotation: frame.pose.rotation.quaternion().map(|v| v as f32),
        place: frame.pose.translation.to_f32(),
    }
}
