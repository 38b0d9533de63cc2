//! Frames as a TUM RGB-D folder: `depth/` of 16-bit PNG, `rgb/`, the lists `depth.txt` and `rgb.txt`, `groundtruth.txt`, and beside them
//! `camera.toml`, so that [`open`](crate::open) needs no options, and `imu.csv`.
//!
//! TUM's tools take depth to be 5000 steps a metre (0.2 mm, up to 13.1 m), so that is what is written unless [`TumOptions::step`] says
//! otherwise. A recording in steps of 0.2, 1 or 2 mm loses nothing; from other units depth is rounded to the nearest step, and what is
//! farther than 65,534 steps becomes a hole. [`TumReport`] counts both, and says what TUM has no place for. Times are
//! written to the nanosecond.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use isobath::glam::Vec3;
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::imu::ImuSample;
use isobath_source::{DepthPixels, OwnedFrame, SourceError};

/// How a folder is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TumOptions {
    /// Metres per step of the depth images. TUM's 1/5000 unless given.
    pub step: DepthUnit,
    /// Which way is up in the world of the poses, when known.
    pub up: Option<Vec3>,
}

impl Default for TumOptions {
    fn default() -> Self {
        // A legal unit: the fallback is never taken.
        Self { step: DepthUnit::new(0.0002).unwrap_or(DepthUnit::MILLIMETRE), up: None }
    }
}

/// What was written, and what was lost.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TumReport {
    /// Frames.
    pub frames: u64,
    /// Inertial readings.
    pub imu_samples: u64,
    /// Depth values that no step has, rounded to the nearest.
    pub rounded: u64,
    /// Depth values farther than the last step, which became holes.
    pub too_far: u64,
    /// What TUM has no place for.
    pub notes: Vec<String>,
}

impl TumReport {
    /// Whether depth reads back as it was.
    #[must_use]
    pub const fn is_lossless(&self) -> bool {
        self.rounded == 0 && self.too_far == 0
    }
}

/// Writes frames into a folder.
#[derive(Debug)]
pub struct TumWriter {
    folder: PathBuf,
    options: TumOptions,
    depth: List,
    rgb: Option<List>,
    poses: Option<List>,
    imu: Option<List>,
    camera: Option<((usize, usize), Intrinsics)>,
    bytes: Vec<u8>,
    report: TumReport,
}

/// A text file, line by line.
#[derive(Debug)]
struct List {
    path: PathBuf,
    file: BufWriter<File>,
}

impl List {
    fn create(path: PathBuf, first: &str) -> Result<Self, SourceError> {
        let file = File::create(&path).map_err(|e| SourceError::io(&path, e))?;
        let mut list = Self { file: BufWriter::new(file), path };
        list.line(first)?;
        Ok(list)
    }

    fn line(&mut self, line: &str) -> Result<(), SourceError> {
        writeln!(self.file, "{line}").map_err(|e| SourceError::io(&self.path, e))
    }
}

/// A list that is made when its first line comes.
fn later<'a>(slot: &'a mut Option<List>, path: &Path, first: &str) -> Result<&'a mut List, SourceError> {
    if slot.is_none() {
        *slot = Some(List::create(path.to_owned(), first)?);
    }
    slot.as_mut().ok_or_else(|| SourceError::io(path, std::io::ErrorKind::Other.into()))
}

/// Seconds with nine places.
fn seconds(time: Timestamp) -> String {
    let nanos = time.as_nanos();
    let sign = if nanos < 0 { "-" } else { "" };
    let nanos = nanos.unsigned_abs();
    format!("{sign}{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000)
}

impl TumWriter {
    /// Makes the folder, which must not hold a recording yet.
    ///
    /// # Errors
    /// [`SourceError::Config`] when it does; [`SourceError::Io`].
    pub fn create(folder: &Path, options: TumOptions) -> Result<Self, SourceError> {
        if folder.join("depth.txt").exists() {
            return Err(SourceError::Config {
                path: folder.into(),
                what: "holds a recording already".into(),
                hint: "recordings are never overwritten: give another folder, or remove it".into(),
            });
        }
        let depth = folder.join("depth");
        fs::create_dir_all(&depth).map_err(|e| SourceError::io(&depth, e))?;
        let depth = List::create(folder.join("depth.txt"), "# time file")?;
        Ok(Self {
            folder: folder.into(),
            options,
            depth,
            rgb: None,
            poses: None,
            imu: None,
            camera: None,
            bytes: Vec::new(),
            report: TumReport::default(),
        })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// [`SourceError::Io`]; [`SourceError::Config`]: it has no pixels, or not the first one's size.
    pub fn frame(&mut self, frame: &OwnedFrame) -> Result<(), SourceError> {
        let size = frame.size();
        match self.camera {
            None if size.0 * size.1 > 0 => {
                self.camera = Some((size, frame.intrinsics));
                self.camera_file(size, &frame.intrinsics)?;
            }
            Some((first, k)) if first == size => {
                if k != frame.intrinsics {
                    self.note("the camera's intrinsics change: TUM has one camera, the first frame's is kept");
                }
            }
            _ => {
                return Err(SourceError::Config {
                    path: self.folder.clone(),
                    what: format!("frame {} is {}x{} pixels", frame.sequence, size.0, size.1),
                    hint: "all images of a TUM folder have one size, and pixels".into(),
                });
            }
        }
        let time = seconds(frame.time);
        let name = format!("{:06}.png", self.report.frames);
        let steps = Steps { ratio: f64::from(frame.unit.metres()) / f64::from(self.options.step.metres()) };
        self.bytes.clear();
        match frame.depth() {
            DepthPixels::U16(v) => steps.write(v, &mut self.bytes, &mut self.report),
            DepthPixels::F32(v) => steps.write(v, &mut self.bytes, &mut self.report),
        }
        png(
            &self.folder.join("depth").join(&name),
            size,
            png::ColorType::Grayscale,
            png::BitDepth::Sixteen,
            &self.bytes,
        )?;
        self.depth.line(&format!("{time} depth/{name}"))?;
        if let Some(colour) = frame.colour() {
            if self.rgb.is_none() {
                let folder = self.folder.join("rgb");
                fs::create_dir_all(&folder).map_err(|e| SourceError::io(&folder, e))?;
            }
            self.bytes.clear();
            self.bytes.extend(colour.rows().flatten().flatten());
            png(
                &self.folder.join("rgb").join(&name),
                colour.size(),
                png::ColorType::Rgb,
                png::BitDepth::Eight,
                &self.bytes,
            )?;
            later(&mut self.rgb, &self.folder.join("rgb.txt"), "# time file")?.line(&format!("{time} rgb/{name}"))?;
        }
        if frame.confidence().is_some() {
            self.note("confidence is not kept: TUM has no place for it (MCAP has)");
        }
        if let Some(pose) = frame.pose {
            let (t, q) = (pose.translation(), pose.rotation());
            let line = format!("{time} {:?} {:?} {:?} {:?} {:?} {:?} {:?}", t.x, t.y, t.z, q.x, q.y, q.z, q.w);
            let first = "# time tx ty tz qx qy qz qw (camera to world)";
            later(&mut self.poses, &self.folder.join("groundtruth.txt"), first)?.line(&line)?;
        }
        self.report.frames += 1;
        Ok(())
    }

    /// Adds an inertial reading.
    ///
    /// # Errors
    /// [`SourceError::Io`].
    pub fn imu(&mut self, sample: &ImuSample) -> Result<(), SourceError> {
        let (f, r) = (sample.force, sample.rate);
        let line = format!("{},{:?},{:?},{:?},{:?},{:?},{:?}", sample.time.as_nanos(), f.x, f.y, f.z, r.x, r.y, r.z);
        let first = "time_ns,force_x,force_y,force_z,rate_x,rate_y,rate_z";
        later(&mut self.imu, &self.folder.join("imu.csv"), first)?.line(&line)?;
        if sample.field.is_some() {
            self.note("the magnetic field is not kept: imu.csv has no place for it (MCAP has)");
        }
        self.report.imu_samples += 1;
        Ok(())
    }

    /// Writes out what is left, and tells what was lost.
    ///
    /// # Errors
    /// [`SourceError::Io`].
    pub fn finish(mut self) -> Result<TumReport, SourceError> {
        for list in [Some(self.depth), self.rgb, self.poses, self.imu].iter_mut().flatten() {
            list.file.flush().map_err(|e| SourceError::io(&list.path, e))?;
        }
        let (step, r) = (self.options.step.metres(), &mut self.report);
        if r.rounded > 0 {
            r.notes.push(format!("{} depth values were rounded to steps of {step} m (MCAP keeps them)", r.rounded));
        }
        if r.too_far > 0 {
            let far = 65_534.0 * step;
            r.notes.push(format!("{} depth values beyond {far:.1} m became holes (MCAP keeps them)", r.too_far));
        }
        Ok(self.report)
    }

    fn note(&mut self, note: &str) {
        if !self.report.notes.iter().any(|n| n == note) {
            self.report.notes.push(note.to_owned());
        }
    }

    fn camera_file(&self, (w, h): (usize, usize), k: &Intrinsics) -> Result<(), SourceError> {
        let path = self.folder.join("camera.toml");
        let up = self.options.up.map_or(String::new(), |u| format!("up = [{:?}, {:?}, {:?}]\n", u.x, u.y, u.z));
        let text = format!(
            "width = {w}\nheight = {h}\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\n{up}\n[depth]\nformat = \"u16\"\nunit = {:?}\n",
            k.fx(),
            k.fy(),
            k.cx(),
            k.cy(),
            self.options.step.metres()
        );
        fs::write(&path, text).map_err(|e| SourceError::io(&path, e))
    }
}

/// From the source's steps to those of the images.
struct Steps {
    ratio: f64,
}

impl Steps {
    /// Big-endian, as PNG has it.
    fn write<D: DepthSample + Into<f64>>(&self, values: &[D], out: &mut Vec<u8>, report: &mut TumReport) {
        for &value in values {
            let step = match value {
                _ if !value.is_valid() => 0,
                v => {
                    let exact = v.into() * self.ratio;
                    let step = exact.round();
                    if step > 65_534.0 {
                        report.too_far += 1;
                        0
                    } else {
                        // Units are f32: a whole number of steps is one up to their rounding. A depth that rounds to 0 is not a hole.
                        report.rounded += u64::from((exact - step).abs() > exact * 2.5e-7);
                        step.max(1.0) as u16
                    }
                }
            };
            out.extend_from_slice(&step.to_be_bytes());
        }
    }
}

fn png(
    path: &Path,
    (w, h): (usize, usize),
    colour: png::ColorType,
    depth: png::BitDepth,
    data: &[u8],
) -> Result<(), SourceError> {
    let file = File::create(path).map_err(|e| SourceError::io(path, e))?;
    let mut encoder = png::Encoder::new(BufWriter::new(file), w as u32, h as u32);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::Fast);
    let written = encoder.write_header().and_then(|mut w| w.write_image_data(data).and_then(|()| w.finish()));
    written.map_err(|e| match e {
        png::EncodingError::IoError(e) => SourceError::io(path, e),
        e => SourceError::Config {
            path: path.into(),
            what: e.to_string(),
            hint: "this is a fault of isobath: report it".into(),
        },
    })
}
