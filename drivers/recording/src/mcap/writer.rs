//! Frames and inertial readings into an MCAP file, as ROS 2 messages, so that Foxglove, `ros2 bag` and everything else that reads those
//! opens it.
//!
//! | topic | message |
//! |---|---|
//! | `/camera/depth/image_rect_raw` | `sensor_msgs/msg/Image`, `16UC1` millimetres or `32FC1` metres |
//! | `/camera/depth/camera_info`, `/camera/color/camera_info` | `sensor_msgs/msg/CameraInfo`, with every frame |
//! | `/camera/color/image_raw` | `rgb8` |
//! | `/camera/confidence/image_raw` | `mono8`, 0 to 255 |
//! | `/tf` | `tf2_msgs/msg/TFMessage`: the depth camera in `world` |
//! | `/imu`, `/magnetic_field` | `sensor_msgs/msg/Imu`, `sensor_msgs/msg/MagneticField` |
//!
//! A message's stamp is the time of exposure, in the source's epoch; its log time is when the frame arrived.
//!
//! **Nothing is lost.** ROS knows two units of depth. Steps of exactly 1 mm are written as they are. Steps of any other unit
//! are written as `f32` metres, and the metadata record `isobath.depth` says the unit, from which the reader gives back the
//! very steps: all 65,536, for every unit (a property test has it). `f32` metres are written as they are; `f32` of another
//! unit is converted, and comes back as metres (one rounding).
//!
//! **Crashes.** A chunk is written whole, at 4 MiB or after a second, whichever is first; what a killed recorder leaves opens up to the last
//! of them. **Memory**: that chunk, one message, and 200 bytes for each chunk written. **Cost**: a copy and a checksum of every byte.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use isobath::glam::Vec3;
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::camera::crop::CropMap;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::imu::ImuSample;
use isobath_source::{Clock as _, DepthPixels, FrameSink, OwnedFrame, SourceError, SystemClock};
use mcap::McapError;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::{NoSeek, WriteOptions, Writer};

use crate::messages::pixels::{Numbers, metres};
use crate::messages::write::{self as ros, Cdr};
use crate::stream::{DEPTH_METADATA, WORLD};

/// A chunk is written when it has this many bytes, or spans this many nanoseconds.
const CHUNK_BYTES: u64 = 4 << 20;
const CHUNK_NANOS: u64 = 1_000_000_000;

/// The depth camera's coordinate frame: x right, y down, z forward.
const CAMERA: &str = "camera_depth_optical_frame";
const IMU_FRAME: &str = "imu";

/// What is known of a recording before its first frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct McapOptions {
    /// What was recorded, in words; written into the file.
    pub source: String,
    /// Which way is up in the world of the poses, when known.
    pub up: Option<Vec3>,
}

/// The streams of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Topic {
    Depth,
    DepthInfo,
    Colour,
    ColourInfo,
    Confidence,
    Tf,
    Imu,
    Field,
}

impl Topic {
    /// Name, schema, definition.
    const fn is(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Self::Depth => ("/camera/depth/image_rect_raw", "sensor_msgs/msg/Image", ros::IMAGE),
            Self::DepthInfo => ("/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", ros::CAMERA_INFO),
            Self::Colour => ("/camera/color/image_raw", "sensor_msgs/msg/Image", ros::IMAGE),
            Self::ColourInfo => ("/camera/color/camera_info", "sensor_msgs/msg/CameraInfo", ros::CAMERA_INFO),
            Self::Confidence => ("/camera/confidence/image_raw", "sensor_msgs/msg/Image", ros::IMAGE),
            Self::Tf => ("/tf", "tf2_msgs/msg/TFMessage", ros::TF_MESSAGE),
            Self::Imu => ("/imu", "sensor_msgs/msg/Imu", ros::IMU),
            Self::Field => ("/magnetic_field", "sensor_msgs/msg/MagneticField", ros::MAGNETIC_FIELD),
        }
    }
}

/// What a recorder has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct McapReport {
    /// Frames in the file.
    pub frames: u64,
    /// Inertial readings in the file.
    pub imu_samples: u64,
    /// Frames that came while it was paused.
    pub paused_frames: u64,
}

/// Writes frames and inertial readings into an MCAP file.
///
/// ```
/// use isobath_recording::{McapOptions, McapWriter};
/// use isobath_source::OwnedFrame;
/// let mut frame = OwnedFrame::new();
/// frame.depth_u16_mut(2, 1).copy_from_slice(&[1500, 0]);
/// let mut file = Vec::new();
/// let mut writer = McapWriter::new(&mut file, "memory", McapOptions::default())?;
/// writer.frame(&frame, 0)?;
/// assert_eq!(writer.finish()?.frames, 1);
/// # Ok::<(), isobath_source::SourceError>(())
/// ```
pub struct McapWriter<W: Write = File> {
    writer: Writer<NoSeek<W>>,
    path: PathBuf,
    options: McapOptions,
    channels: BTreeMap<Topic, u16>,
    cdr: Cdr,
    /// What the file's metadata says of depth; known with the first frame.
    depth: Option<(Numbers, DepthUnit)>,
    /// Log time of the first message of the open chunk.
    chunk_began: Option<u64>,
    paused: bool,
    done: McapReport,
}

impl<W: Write> std::fmt::Debug for McapWriter<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("McapWriter").field("path", &self.path).field("done", &self.done).finish_non_exhaustive()
    }
}

impl McapWriter<File> {
    /// Makes a file, which must not be there yet.
    ///
    /// # Errors
    /// [`SourceError::Config`] when it is there; [`SourceError::Io`].
    pub fn create(path: &Path, options: McapOptions) -> Result<Self, SourceError> {
        if path.is_file() {
            return Err(SourceError::Config {
                path: path.into(),
                what: "is there already".into(),
                hint: "recordings are never overwritten: give another name, or remove it".into(),
            });
        }
        let file = File::create(path).map_err(|e| refused(path, e, McapReport::default()))?;
        Self::new(file, path, options)
    }
}

impl<W: Write> McapWriter<W> {
    /// Writes into `to`; `name` is what errors call it. Nothing is buffered beyond the chunk: `to` gets a few large writes a chunk.
    ///
    /// # Errors
    /// [`SourceError::Io`].
    pub fn new(to: W, name: impl Into<PathBuf>, options: McapOptions) -> Result<Self, SourceError> {
        let path = name.into();
        let writer = WriteOptions::new()
            .profile("ros2")
            .library(concat!("isobath ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            // A chunk is put together in memory and written whole: a crash never leaves half an index entry behind.
            .disable_seeking(true)
            .create(NoSeek::new(to))
            .map_err(|e| failed(&path, e, McapReport::default()))?;
        Ok(Self {
            writer,
            path,
            options,
            channels: BTreeMap::new(),
            cdr: Cdr::default(),
            depth: None,
            chunk_began: None,
            paused: false,
            done: McapReport::default(),
        })
    }

    /// What is in the file.
    #[must_use]
    pub const fn recorded(&self) -> McapReport {
        self.done
    }

    /// Takes no more frames and readings until [`Self::resume`]; what came before is written out.
    ///
    /// # Errors
    /// [`SourceError::Io`].
    pub fn pause(&mut self) -> Result<(), SourceError> {
        self.paused = true;
        self.flush()
    }

    /// Goes on after [`Self::pause`]. Times go on as the frames have them: the pause is a gap in them.
    pub const fn resume(&mut self) {
        self.paused = false;
    }

    /// Whether frames are passed over.
    #[must_use]
    pub const fn is_paused(&self) -> bool {
        self.paused
    }

    /// Writes out the open chunk, so that all until now survives a crash of this program.
    ///
    /// # Errors
    /// [`SourceError::Io`].
    pub fn flush(&mut self) -> Result<(), SourceError> {
        self.chunk_began = None;
        self.writer.flush().map_err(|e| failed(&self.path, e, self.done))
    }

    /// Adds a frame that arrived at `log_time`, nanoseconds of a clock that all calls share; for recordings the frame's own time.
    ///
    /// # Errors
    /// [`SourceError::Io`]: among others, the disk is full; what was written before is readable. [`SourceError::Config`]: the frame has no
    /// pixels, another unit or number type than the first one, or a time beyond ±68 years; the file can go on without it.
    pub fn frame(&mut self, frame: &OwnedFrame, log_time: u64) -> Result<(), SourceError> {
        if self.paused {
            self.done.paused_frames += 1;
            return Ok(());
        }
        let stamp = ros::stamp(frame.time).ok_or_else(|| self.bad_time())?;
        let numbers = match frame.depth() {
            DepthPixels::U16(_) => Numbers::U16,
            DepthPixels::F32(_) => Numbers::F32,
        };
        let size @ (width, height) = frame.size();
        if width * height == 0 {
            return Err(self.config(format!("frame {} has no pixels", frame.sequence), "leave it out"));
        }
        match self.depth {
            None => self.describe(numbers, frame.unit)?,
            Some(before) if before == (numbers, frame.unit) => {}
            Some((_, unit)) => {
                return Err(self.config(
                    format!(
                        "frame {} has steps of {} m or another number type; the file began with {} m",
                        frame.sequence,
                        frame.unit.metres(),
                        unit.metres()
                    ),
                    "a recording has one unit: begin another file",
                ));
            }
        }
        if self.chunk_began.is_some_and(|began| log_time.abs_diff(began) >= CHUNK_NANOS) {
            self.flush()?;
        }
        self.chunk_began.get_or_insert(log_time);
        let head = Stamps {
            sequence: frame.sequence as u32,
            log_time,
            publish_time: u64::try_from(frame.time.as_nanos()).unwrap_or(0),
        };

        let unit = frame.unit;
        let cdr = &mut self.cdr;
        match frame.depth() {
            DepthPixels::U16(v) if unit == DepthUnit::MILLIMETRE => {
                let pixels = |out: &mut Vec<u8>| out.extend(v.iter().flat_map(|v| v.to_le_bytes()));
                cdr.image_head(stamp, CAMERA, size, "16UC1", 2).data(v.len() * 2, pixels)
            }
            DepthPixels::U16(v) => {
                let pixels = |out: &mut Vec<u8>| out.extend(v.iter().flat_map(|&v| metres(v, unit).to_le_bytes()));
                cdr.image_head(stamp, CAMERA, size, "32FC1", 4).data(v.len() * 4, pixels)
            }
            DepthPixels::F32(v) if unit == DepthUnit::METRE => {
                let pixels = |out: &mut Vec<u8>| out.extend(v.iter().flat_map(|v| v.to_le_bytes()));
                cdr.image_head(stamp, CAMERA, size, "32FC1", 4).data(v.len() * 4, pixels)
            }
            DepthPixels::F32(v) => {
                let step = unit.metres();
                let pixels = |out: &mut Vec<u8>| out.extend(v.iter().flat_map(|v| (v * step).to_le_bytes()));
                cdr.image_head(stamp, CAMERA, size, "32FC1", 4).data(v.len() * 4, pixels)
            }
        };
        self.send(Topic::Depth, head)?;
        self.cdr.camera_info(stamp, CAMERA, size, &frame.intrinsics);
        self.send(Topic::DepthInfo, head)?;
        if let Some(colour) = frame.colour() {
            let size = colour.size();
            let pixels = |out: &mut Vec<u8>| out.extend(colour.rows().flatten().flatten());
            self.cdr.image_head(stamp, CAMERA, size, "rgb8", 3).data(size.0 * size.1 * 3, pixels);
            self.send(Topic::Colour, head)?;
            if let Some(k) = colour_camera(&frame.intrinsics, size, (width, height)) {
                self.cdr.camera_info(stamp, CAMERA, size, &k);
                self.send(Topic::ColourInfo, head)?;
            }
        }
        if let Some(confidence) = frame.confidence() {
            let pixels = |out: &mut Vec<u8>| out.extend(confidence.rows().flatten());
            self.cdr.image_head(stamp, CAMERA, size, "mono8", 1).data(width * height, pixels);
            self.send(Topic::Confidence, head)?;
        }
        if let Some(pose) = frame.pose {
            let (t, q) = (pose.translation().to_array(), pose.rotation().to_array());
            self.cdr.begin().u32(1).header(stamp, WORLD).text(CAMERA);
            self.cdr.f64s(t.map(f64::from)).f64s(q.map(f64::from));
            self.send(Topic::Tf, head)?;
        }
        self.done.frames += 1;
        Ok(())
    }

    /// Adds an inertial reading that arrived at `log_time`, nanoseconds of the clock that frames have.
    ///
    /// # Errors
    /// As [`Self::frame`].
    pub fn imu(&mut self, sample: &ImuSample, log_time: u64) -> Result<(), SourceError> {
        if self.paused {
            return Ok(());
        }
        let stamp = ros::stamp(sample.time).ok_or_else(|| self.bad_time())?;
        self.chunk_began.get_or_insert(log_time);
        let head = Stamps {
            sequence: self.done.imu_samples as u32,
            log_time,
            publish_time: u64::try_from(sample.time.as_nanos()).unwrap_or(0),
        };
        let cdr = self.cdr.begin().header(stamp, IMU_FRAME);
        // ROS's sign that there is no orientation: -1 in front of its covariance.
        cdr.f64s([0.0, 0.0, 0.0, 1.0]).f64s([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        cdr.f64s(sample.rate.to_array().map(f64::from)).f64s([0.0; 9]);
        cdr.f64s(sample.force.to_array().map(f64::from)).f64s([0.0; 9]);
        self.send(Topic::Imu, head)?;
        if let Some(field) = sample.field {
            // ROS wants tesla, not microtesla.
            let tesla = field.to_array().map(|v| f64::from(v) * 1e-6);
            self.cdr.begin().header(stamp, IMU_FRAME).f64s(tesla).f64s([0.0; 9]);
            self.send(Topic::Field, head)?;
        }
        self.done.imu_samples += 1;
        Ok(())
    }

    /// Writes the index and ends the file. (A writer that is dropped does so too, but can't tell of errors.)
    ///
    /// # Errors
    /// [`SourceError::Io`].
    pub fn finish(mut self) -> Result<McapReport, SourceError> {
        let done = self.done;
        self.writer.finish().map(|_| done).map_err(|e| failed(&self.path, e, done))
    }

    /// Writes what the numbers of depth mean.
    fn describe(&mut self, numbers: Numbers, unit: DepthUnit) -> Result<(), SourceError> {
        let (number, stored) = match numbers {
            Numbers::U16 if unit == DepthUnit::MILLIMETRE => ("u16", "16UC1 millimetres"),
            Numbers::U16 => ("u16", "32FC1 metres"),
            Numbers::F32 => ("f32", "32FC1 metres"),
        };
        let mut metadata: BTreeMap<String, String> = [
            ("topic", Topic::Depth.is().0.to_owned()),
            ("kind", "z".to_owned()),
            ("number", number.to_owned()),
            // Rust's shortest digits: the same f32 when read.
            ("unit_m", unit.metres().to_string()),
            ("stored", stored.to_owned()),
            ("invalid", if number == "u16" { "0, 65535".to_owned() } else { "0, negative, not finite".to_owned() }),
            ("source", self.options.source.clone()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into();
        if let Some(up) = self.options.up {
            metadata.insert("up".to_owned(), format!("{},{},{}", up.x, up.y, up.z));
        }
        let record = Metadata { name: DEPTH_METADATA.to_owned(), metadata };
        self.chunk_began = None;
        self.writer.write_metadata(&record).map_err(|e| failed(&self.path, e, self.done))?;
        self.depth = Some((numbers, unit));
        Ok(())
    }

    /// Writes the message that was put together.
    fn send(&mut self, topic: Topic, at: Stamps) -> Result<(), SourceError> {
        let failed = |e| failed(&self.path, e, self.done);
        let channel_id = match self.channels.get(&topic) {
            Some(id) => *id,
            None => {
                let (name, schema, definition) = topic.is();
                let schema = self.writer.add_schema(schema, "ros2msg", definition.as_bytes()).map_err(failed)?;
                let id = self.writer.add_channel(schema, name, "cdr", &BTreeMap::new()).map_err(failed)?;
                self.channels.insert(topic, id);
                id
            }
        };
        let Stamps { sequence, log_time, publish_time } = at;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time };
        self.writer.write_to_known_channel(&header, self.cdr.bytes()).map_err(failed)
    }

    fn config(&self, what: String, hint: &str) -> SourceError {
        SourceError::Config { path: self.path.clone(), what, hint: hint.into() }
    }

    fn bad_time(&self) -> SourceError {
        self.config(
            "a time is more than 68 years from its epoch, which ROS can't write".into(),
            "check the clock of the source",
        )
    }
}

/// As a sink of [`Recorded`](isobath_source::Recorded): frames arrive now, and [`finish`](FrameSink::finish) writes out what is open; the
/// file itself is ended by [`McapWriter::finish`], or by dropping it.
impl<W: Write> FrameSink for McapWriter<W> {
    fn frame(&mut self, frame: &OwnedFrame) -> Result<(), SourceError> {
        self.frame(frame, SystemClock.now().0)
    }

    fn finish(&mut self) -> Result<(), SourceError> {
        self.flush()
    }
}

#[derive(Debug, Clone, Copy)]
struct Stamps {
    sequence: u32,
    log_time: u64,
    publish_time: u64,
}

/// The pinhole of a colour image that covers depth's view, as a frame's does.
fn colour_camera(depth: &Intrinsics, colour: (usize, usize), size: (usize, usize)) -> Option<Intrinsics> {
    CropMap::centred(colour, size)?.colour_intrinsics(depth).ok()
}

fn failed(path: &Path, error: McapError, done: McapReport) -> SourceError {
    match error {
        McapError::Io(e) => refused(path, e, done),
        McapError::AttemptedWriteAfterFailure => refused(path, io::Error::other("an earlier write failed"), done),
        e => SourceError::Config {
            path: path.into(),
            what: format!("can't be written: {e}"),
            hint: "this is a fault of isobath: report it".into(),
        },
    }
}

fn refused(path: &Path, error: io::Error, done: McapReport) -> SourceError {
    let hint = match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            format!(
                "there is no room left; of the {} frames so far, all but the last second are in the file, which opens",
                done.frames
            )
        }
        io::ErrorKind::NotFound => "make its folder first".to_owned(),
        io::ErrorKind::PermissionDenied => "choose a folder that you may write into".to_owned(),
        _ => format!("check the medium; of the {} frames so far, all but the last second are in the file", done.frames),
    };
    SourceError::Io { path: path.into(), error, hint }
}
