//! Writing a simulation as a recording: the folder layout of the TUM RGB-D data set, which `isobath_recording::open` reads, and the
//! ground truth beside it. The README lists the files.

use std::fmt::Write as _;
use std::fs;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use image::{ImageBuffer, ImageEncoder, Luma, Rgb};
use isobath_recording::parse::{NpySlice, write_npy};
use rayon::prelude::*;

use crate::error::SimError;
use crate::maths::Rigid;
use crate::render::sky::LinearImage;
use crate::scene::Scene;
use crate::simulation::{SimFrame, SimOptions, Simulation};

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// Frames.
    pub frames: usize,
    /// Environment maps.
    pub environment_maps: usize,
    /// IMU readings.
    pub imu_samples: usize,
    /// Where everything is.
    pub folder: PathBuf,
}

/// Simulates a scene and writes all frames into a folder, which is made when it is not there. `progress` is told (done, total) after each
/// frame and each environment map. Files of the same names are written over.
///
/// ```no_run
/// use isobath_sim::{Scene, SimOptions, write_recording};
/// let options = SimOptions { frames: 60, sensor: "kinect".parse()?, seed: 1, ..SimOptions::default() };
/// let summary = write_recording(&Scene::open("living-room")?, &options, "out/living-room".as_ref(), |done, total| {
///     eprintln!("{done} of {total}");
/// })?;
/// println!("{} frames in {}", summary.frames, summary.folder.display());
/// # Ok::<(), isobath_sim::SimError>(())
/// ```
///
/// # Errors
/// [`SimError`]: options that can't be, or a file that can't be written.
pub fn write_recording(
    scene: &Scene,
    options: &SimOptions,
    folder: &Path,
    mut progress: impl FnMut(usize, usize),
) -> Result<Summary, SimError> {
    let simulation = Simulation::new(std::sync::Arc::new(scene.clone()), options.clone())?;
    for name in ["depth", "rgb", "truth", "confidence", "truth/environment"] {
        let wanted = match name {
            "rgb" => options.colour,
            "confidence" => false,
            "truth/environment" => options.environment >= 2 && !scene.places().is_empty(),
            _ => true,
        };
        if wanted {
            make(&folder.join(name))?;
        }
    }
    let places: Vec<_> = if options.environment >= 2 { scene.places().iter().collect() } else { Vec::new() };
    let total = simulation.len() + places.len();

    let mut lists = Lists::default();
    for (done, frame) in simulation.iter().enumerate() {
        write_frame(&simulation, &frame, folder)?;
        lists.add(&frame, options.colour);
        progress(done + 1, total);
    }
    for (done, (place, at)) in places.iter().enumerate() {
        let map = scene.environment_map(0.0, **at, options.environment, 2);
        let stem = folder.join("truth/environment").join(place.replace(|c: char| !c.is_ascii_alphanumeric(), "-"));
        for ending in ["exr", "npy"] {
            write_linear(&map, &stem.with_extension(ending))?;
        }
        progress(simulation.len() + done + 1, total);
    }

    put(&folder.join("depth.txt"), &lists.depth)?;
    if options.colour {
        put(&folder.join("rgb.txt"), &lists.colour)?;
    }
    put(&folder.join("groundtruth.txt"), &lists.truth)?;
    if !options.pose_noise.is_none() {
        put(&folder.join("reported.txt"), &lists.reported)?;
    }
    let imu = simulation.imu();
    let mut text = String::from("time_ns,force_x,force_y,force_z,rate_x,rate_y,rate_z\n");
    for s in &imu {
        let (f, r) = (s.force, s.rate);
        let _ = writeln!(text, "{},{},{},{},{},{},{}", s.time, f.x, f.y, f.z, r.x, r.y, r.z);
    }
    if !imu.is_empty() {
        put(&folder.join("imu.csv"), &text)?;
    }
    put(&folder.join("camera.toml"), &camera_file(&simulation))?;
    let mut text = String::from("# segment id, name\n0 nothing\n");
    for (i, name) in scene.segments().iter().enumerate() {
        let _ = writeln!(text, "{} {name}", i + 1);
    }
    put(&folder.join("truth/segments.txt"), &text)?;
    let mut text = String::from(
        "# place: x y z in metres; environment maps are truth/environment/PLACE.exr and .npy, at time 0\n",
    );
    for (name, p) in scene.places() {
        let _ = writeln!(text, "{name}: {} {} {}", p.x, p.y, p.z);
    }
    put(&folder.join("truth/places.txt"), &text)?;
    Ok(Summary {
        frames: simulation.len(),
        environment_maps: places.len(),
        imu_samples: imu.len(),
        folder: folder.to_owned(),
    })
}

/// The text files of the layout.
struct Lists {
    depth: String,
    colour: String,
    truth: String,
    reported: String,
}

impl Default for Lists {
    fn default() -> Self {
        let poses = "# time tx ty tz qx qy qz qw (camera to world)\n";
        Self {
            depth: "# time file\n".into(),
            colour: "# time file\n".into(),
            truth: poses.into(),
            reported: poses.into(),
        }
    }
}

impl Lists {
    fn add(&mut self, frame: &SimFrame, colour: bool) {
        // All nine digits, so that nanoseconds survive.
        let time = format!("{}.{:09}", frame.time / 1_000_000_000, frame.time % 1_000_000_000);
        let name = format!("{:06}.png", frame.index);
        let _ = writeln!(self.depth, "{time} depth/{name}");
        if colour {
            let _ = writeln!(self.colour, "{time} rgb/{name}");
        }
        let line = |pose: &Rigid| {
            let (t, [x, y, z, w]) = (pose.translation, pose.rotation.quaternion());
            format!("{time} {} {} {} {x} {y} {z} {w}\n", t.x, t.y, t.z)
        };
        self.truth += &line(&frame.pose);
        self.reported += &line(&frame.reported_pose);
    }
}

fn camera_file(simulation: &Simulation) -> String {
    let (k, o) = (simulation.depth_camera(), simulation.options());
    let lens = if o.lens == [0.0; 8] { String::new() } else { format!("distortion = {:?}\n", o.lens) };
    let pose = if o.pose_noise.is_none() { "" } else { "\n[pose]\npath = \"reported.txt\"\n" };
    // camera.toml holds f32: its shortest texts, so that they read back as simulated.
    format!(
        "# {}: {}\n# sensor {}, seed {}\nwidth = {}\nheight = {}\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\n{lens}up = [0.0, 1.0, 0.0]\n\
         frame_rate = {:?}\n\n[depth]\nformat = \"u16\"\nunit = {:?}\n{pose}",
        simulation.scene().name(),
        simulation.scene().about(),
        o.sensor,
        o.seed,
        k.width,
        k.height,
        k.fx as f32,
        k.fy as f32,
        k.cx as f32,
        k.cy as f32,
        o.frame_rate,
        simulation.unit() as f32,
    )
}

/// The images of one frame, each on its own thread where there are some.
fn write_frame(simulation: &Simulation, frame: &SimFrame, folder: &Path) -> Result<(), SimError> {
    let number = format!("{:06}", frame.index);
    let (w, h) = (frame.truth.width as u32, frame.truth.height as u32);
    let truth = folder.join("truth");
    let depth = || {
        let path = folder.join("depth").join(&number).with_extension("png");
        gray16(&path, w, h, frame.depth_u16(simulation.unit()))
    };
    let colour = || {
        let pixels = simulation.rgb(frame);
        if pixels.is_empty() {
            return Ok(());
        }
        let (w, h) = (frame.radiance.width as u32, frame.radiance.height as u32);
        let bytes: Vec<u8> = pixels.into_iter().flatten().collect();
        let path = folder.join("rgb").join(&number).with_extension("png");
        ImageBuffer::<Rgb<u8>, _>::from_raw(w, h, bytes).map_or(Ok(()), |i| i.save(&path)).map_err(|e| failed(&path, e))
    };
    let confidence = || {
        let Some(c) = &frame.confidence else { return Ok(()) };
        make(&folder.join("confidence"))?;
        let path = folder.join("confidence").join(&number).with_extension("png");
        let image = ImageBuffer::<Luma<u8>, _>::from_raw(w, h, c.clone());
        image.map_or(Ok(()), |i| i.save(&path)).map_err(|e| failed(&path, e))
    };
    let segments = || gray16(&truth.join(format!("segments-{number}.png")), w, h, frame.truth.segments.clone());
    let shape = [h as usize, w as usize];
    let exact = || npy(&truth.join(format!("depth-{number}.npy")), &shape, &frame.truth.depth_f32());
    let normals = || {
        let flat: Vec<f32> = frame.truth.normals.iter().flatten().copied().collect();
        npy(&truth.join(format!("normals-{number}.npy")), &[shape[0], shape[1], 3], &flat)
    };
    let radiance = || {
        if frame.radiance.pixels.is_empty() {
            return Ok(());
        }
        write_linear(&frame.radiance, &truth.join(format!("radiance-{number}.exr")))
    };
    let jobs: [&(dyn Fn() -> Result<(), SimError> + Sync); 7] =
        [&depth, &colour, &confidence, &segments, &exact, &normals, &radiance];
    jobs.par_iter().map(|job| job()).collect()
}

fn gray16(path: &Path, w: u32, h: u32, pixels: Vec<u16>) -> Result<(), SimError> {
    let image = ImageBuffer::<Luma<u16>, _>::from_raw(w, h, pixels);
    image.map_or(Ok(()), |i| i.save(path)).map_err(|e| failed(path, e))
}

fn npy(path: &Path, shape: &[usize], data: &[f32]) -> Result<(), SimError> {
    let file = fs::File::create(path).map_err(write_error(path))?;
    write_npy(&mut BufWriter::new(file), shape, NpySlice::F32(data)).map_err(write_error(path))
}

/// Writes a linear image, in the format of the file's ending: `.exr` (`OpenEXR`) and `.npy` (rows, columns, 3) hold every bit of its
/// `f32`, `.hdr` (Radiance) 8 bits of each number.
///
/// # Errors
/// [`SimError`] when the file can't be written, or its ending is another.
pub fn write_linear(image: &LinearImage, path: &Path) -> Result<(), SimError> {
    let create = || Ok(BufWriter::new(fs::File::create(path).map_err(write_error(path))?));
    let (width, height) = (image.width, image.height);
    let flat = image.pixels.as_flattened();
    match path.extension().and_then(|e| e.to_str()) {
        Some("exr") => {
            let bytes: Vec<u8> = flat.iter().flat_map(|v| v.to_ne_bytes()).collect();
            image::codecs::openexr::OpenExrEncoder::new(create()?)
                .write_image(&bytes, width as u32, height as u32, image::ExtendedColorType::Rgb32F)
                .map_err(|e| failed(path, e))
        }
        Some("hdr") => {
            let pixels: Vec<Rgb<f32>> = image.pixels.iter().map(|p| Rgb(*p)).collect();
            image::codecs::hdr::HdrEncoder::new(create()?).encode(&pixels, width, height).map_err(|e| failed(path, e))
        }
        Some("npy") => npy(path, &[height, width, 3], flat),
        _ => Err(SimError::option(format!("{}: linear images are written as .exr, .hdr or .npy", path.display()))),
    }
}

fn put(path: &Path, text: &str) -> Result<(), SimError> {
    fs::write(path, text).map_err(write_error(path))
}

fn make(path: &Path) -> Result<(), SimError> {
    fs::create_dir_all(path).map_err(write_error(path))
}

fn write_error(path: &Path) -> impl FnOnce(std::io::Error) -> SimError {
    let path = path.to_owned();
    move |error| SimError::Io { path, error, hint: "check that the folder can be written and the disk has room" }
}

fn failed(path: &Path, error: image::ImageError) -> SimError {
    let error = match error {
        image::ImageError::IoError(e) => e,
        other => std::io::Error::other(other.to_string()),
    };
    write_error(path)(error)
}
