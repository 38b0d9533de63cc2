//! Opening a recording, and making frames of its files.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::ImageDecoder;
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::sensing::depth::decode::{self, ByteOrder, DecodeError, DecodeReport};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath_source::{Deadline, DepthSource, Outcome, OwnedFrame, Recording, SourceError, SourceInfo};

use crate::calibration::{Calibration, Known, Meaning};
use crate::camera_file::{CameraFile, Format};
use crate::files::{in_file, read_image, read_text};
use crate::layout::{Entry, Listing, PoseFrom, recognise};
use crate::parse::{
    MAX_PIXELS, MAX_SIDE, ParseError, RawImage, RawPixels, check_png_data, checked_pixels, decode_depth_png, parse_npy,
    parse_pgm,
};
use crate::store::Input;
use crate::{bag, mcap, stream};

/// How to open a recording.
///
/// ```
/// use isobath_recording::{CameraFile, OpenOptions};
/// let mut options = OpenOptions::default();
/// options.set.fx = Some(525.0); // wins over camera.toml
/// options.set.depth.unit = Some(0.001);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct OpenOptions {
    /// The camera file. By default `camera.toml` in the folder; for a single image `NAME.camera.toml` beside `NAME.png`, or else
    /// `camera.toml`. Paths in it are relative to the recording.
    pub camera: Option<PathBuf>,
    /// Values given by hand; they win over those of the camera file.
    pub set: CameraFile,
    /// Whether to read colour images. Default true.
    pub colour: bool,
    /// TUM RGB-D: how far apart in time images and poses of one frame may be, seconds. Default 0.02.
    pub association: f64,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { camera: None, set: CameraFile::default(), colour: true, association: 0.02 }
    }
}

/// Images tried at opening, when the first ones are broken.
const PROBES: usize = 8;

/// Opens a recording: a folder of one of the layouts above, or a single depth image.
///
/// ```no_run
/// use isobath_recording::{open, OpenOptions};
/// use isobath_source::{Deadline, Outcome, OwnedFrame, with_frame};
/// # fn main() -> Result<(), isobath_source::SourceError> {
/// let mut recording = open("recordings/desk".as_ref(), &OpenOptions::default())?;
/// let mut frame = OwnedFrame::new();
/// while recording.next_into(&mut frame, Deadline::NEVER)? == Outcome::Frame {
///     let z = with_frame!(frame, |f| f.z(320, 240));
///     println!("frame {}: {z} m ahead", frame.sequence);
/// }
/// # Ok(()) }
/// ```
///
/// # Errors
/// [`SourceError`]: no such path, no known layout, a broken list or camera.toml, values that are missing or contradict the
/// images. Images after the first are judged when they are read.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Recording>, SourceError> {
    let known = known(path, options)?;
    if is_messages(path) {
        let options = OpenOptions { set: known.values, ..options.clone() };
        return Ok(Box::new(stream::open(Input::open(path)?, &options)?));
    }
    let Listing { kind, mut entries, mut notes } = recognise(path, &known.values, options.association)?;
    if !options.colour {
        entries.iter_mut().for_each(|e| e.colour = None);
    }

    // One image tells the size and the number type; any will do, so that one broken file does not hide the others.
    let mut bytes = Vec::new();
    let mut first_error = None;
    let probe = entries.iter().take(PROBES).find_map(|entry| {
        let image = load(&entry.depth, &known, &mut bytes);
        image.map_err(|e| first_error.get_or_insert(e).is_terminal()).ok().map(|image| (image, entry))
    });
    let calibration = match (probe, first_error) {
        (Some((image, entry)), _) => known.complete(&image, &entry.depth)?,
        (None, Some(error)) => return Err(error),
        (None, None) => {
            return Err(SourceError::Unsupported {
                path: path.into(),
                what: "has no frames".into(),
                hint: "check it".into(),
            });
        }
    };
    if !calibration.camera.distortion.is_none() {
        notes.push(
            "depth is straightened by the lens model; so is colour of the same size, other colour is left as it is"
                .into(),
        );
    }
    let info = SourceInfo {
        kind: kind.into(),
        path: path.into(),
        size: Some(calibration.size),
        intrinsics: calibration.camera.intrinsics,
        up: calibration.up,
        has_colour: entries.iter().any(|e| e.colour.is_some()),
        has_poses: entries.iter().any(|e| !matches!(e.pose, PoseFrom::Nowhere)),
        notes,
    };
    Ok(Box::new(FileRecording { info, entries, known, calibration, next: 0, bytes }))
}

/// Opens an MCAP file or a bag that is in memory. `name` is what errors call it.
///
/// # Errors
/// As [`open`].
pub fn open_bytes(bytes: Vec<u8>, name: &str, options: &OpenOptions) -> Result<Box<dyn Recording>, SourceError> {
    Ok(Box::new(stream::open(Input::of_bytes(bytes, name), options)?))
}

/// Whether a file begins as MCAP or as a ROS 1 bag, or is called so.
#[must_use]
pub fn is_messages(path: &Path) -> bool {
    let mut head = [0; 16];
    let read = std::fs::File::open(path).and_then(|mut f| std::io::Read::read(&mut f, &mut head));
    let head = head.get(..read.unwrap_or(0)).unwrap_or(&[]);
    let called = path.extension().is_some_and(|e| e == "mcap" || e == "bag");
    head.starts_with(mcap::MAGIC) || head.starts_with(bag::MAGIC) || (called && path.is_file())
}

/// The values of the camera file and of the caller.
fn known(path: &Path, options: &OpenOptions) -> Result<Known, SourceError> {
    let beside = path.parent().unwrap_or(Path::new(""));
    let (file, found) = match &options.camera {
        Some(given) => (given.clone(), true),
        None if path.is_dir() => {
            let file = path.join("camera.toml");
            let found = file.is_file();
            (file, found)
        }
        None => {
            let own = path.with_extension("camera.toml");
            let file = if own.is_file() { own } else { beside.join("camera.toml") };
            let found = file.is_file();
            (file, found)
        }
    };
    let from_file =
        if found { CameraFile::parse(&read_text(&file)?).map_err(in_file(&file))? } else { CameraFile::default() };
    let values = options.set.clone().or(from_file);
    values.check().map_err(|e| SourceError::Config { path: file.clone(), what: e.what, hint: e.hint })?;
    Ok(Known { values, path: file, found })
}

/// Reads a depth image of any kind, recognised by its first bytes.
fn load(path: &Path, known: &Known, bytes: &mut Vec<u8>) -> Result<RawImage, SourceError> {
    read_image(path, bytes)?;
    let at = in_file(path);
    if bytes.starts_with(b"\x89PNG") || bytes.starts_with(b"P5") {
        let mut image =
            if bytes.starts_with(b"P5") { parse_pgm(bytes) } else { decode_depth_png(bytes) }.map_err(at)?;
        // Both are big-endian by definition; some writers did not know.
        if known.byte_order() == Some(ByteOrder::Little) {
            image.swap_bytes();
        }
        return Ok(image);
    }
    if bytes.starts_with(b"\x93NUMPY") {
        return parse_npy(bytes).map(RawImage::from).map_err(at);
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    match extension.as_str() {
        "bin" | "raw" | "depth16" => {
            let (width, height, format) = known.headerless(path)?;
            let order = known.byte_order().unwrap_or_default();
            match format {
                Format::U16 | Format::Depth16 => RawImage::from_u16_bytes(bytes, width, height, order),
                Format::F32 | Format::Disparity | Format::Projective => {
                    RawImage::from_f32_bytes(bytes, width, height, order)
                }
            }
            .map_err(at)
        }
        "png" | "pgm" | "npy" => Err(SourceError::Format {
            path: path.into(),
            line: None,
            what: format!("does not begin as a {extension} file"),
            hint: "it is damaged, empty, or of another kind".into(),
        }),
        _ => Err(SourceError::Unsupported {
            path: path.into(),
            what: "is no depth image that is known here".into(),
            hint: "16-bit PNG or PGM, NPY, and headerless .bin or .raw are read; .npz is a zip of NPY files: unpack it"
                .into(),
        }),
    }
}

/// A recording made of files.
#[derive(Debug)]
struct FileRecording {
    info: SourceInfo,
    entries: Vec<Entry>,
    known: Known,
    calibration: Calibration,
    next: usize,
    bytes: Vec<u8>,
}

impl Recording for FileRecording {
    fn len(&self) -> usize {
        self.entries.len()
    }

    fn position(&self) -> usize {
        self.next
    }

    fn set_position(&mut self, index: usize) {
        self.next = index;
    }
}

impl DepthSource for FileRecording {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, _: Deadline) -> Result<Outcome, SourceError> {
        let Some(entry) = self.entries.get(self.next) else {
            return Ok(Outcome::EndOfStream);
        };
        // First, so that a broken frame is passed over by the next call.
        let sequence = self.next as u64;
        self.next += 1;

        frame.clear();
        let c = &self.calibration;
        let image = load(&entry.depth, &self.known, &mut self.bytes)?;
        decode_into(image, c, frame).map_err(|(what, hint)| SourceError::Format {
            path: entry.depth.clone(),
            line: None,
            what,
            hint: hint.into(),
        })?;
        frame.time = entry.time;
        frame.sequence = sequence;
        frame.notes.extend_from_slice(&entry.notes);
        if let Some(path) = &entry.colour
            && let Err(e) = load_colour(path, &mut self.bytes, frame)
        {
            // Depth answers without colour; whoever wants colour reads the note.
            frame.clear_colour();
            frame.notes.push(format!("no colour: {e}"));
        }
        if let Some(limits) = c.limits {
            frame.apply_limits(limits);
        }
        frame.straighten(&c.camera);
        match entry.pose.read().map(|raw| raw.map(|raw| raw.pose(c.convention, c.direction))) {
            Ok(None) => {}
            Ok(Some(Ok(pose))) => frame.pose = Some(pose),
            Ok(Some(Err(e))) => frame.notes.push(format!("no pose: {e}")),
            Err(e) => frame.notes.push(format!("no pose: {e}")),
        }
        Ok(Outcome::Frame)
    }
}

/// Makes stored values into the frame's depth (and confidence).
fn decode_into(mut image: RawImage, c: &Calibration, frame: &mut OwnedFrame) -> Result<(), (String, &'static str)> {
    let (w, h) = (image.width, image.height);
    if (w, h) != c.size {
        return Err((
            format!("is {w}x{h}, the recording's depth images are {}x{}", c.size.0, c.size.1),
            "all images of a recording share one camera, hence one size",
        ));
    }
    let skipped = c.ignore_rows.saturating_mul(w);
    match &mut image.pixels {
        RawPixels::U16(v) => make_holes(v, 0, skipped, |v| c.background == Some(f32::from(v))),
        RawPixels::F32(v) => make_holes(v, f32::NAN, skipped, |v| c.background == Some(v)),
    }
    let converted = match (c.meaning, &image.pixels) {
        (Meaning::U16(unit), RawPixels::U16(v)) => {
            frame.unit = unit;
            keep(v, frame.depth_u16_mut(w, h));
            Ok(())
        }
        (Meaning::F32(unit), RawPixels::F32(v)) => {
            frame.unit = unit;
            keep(v, frame.depth_f32_mut(w, h));
            Ok(())
        }
        (Meaning::Depth16, RawPixels::U16(v)) => {
            frame.unit = DepthUnit::MILLIMETRE;
            let (depth, sure) = frame.depth_u16_and_confidence_mut(w, h);
            match (ImageView::new(v, w, h), ImageViewMut::new(depth, w, h), ImageViewMut::new(sure, w, h)) {
                (Ok(raw), Ok(mut depth), Ok(mut sure)) => decode::depth16(raw, &mut depth, Some(&mut sure)).map(drop),
                _ => Ok(()),
            }
        }
        (Meaning::Disparity(k, unit), RawPixels::U16(v)) => convert(FromDisparity(v, k), (w, h), unit, frame),
        (Meaning::Disparity(k, unit), RawPixels::F32(v)) => convert(FromDisparity(v, k), (w, h), unit, frame),
        (Meaning::Projective(planes, unit), RawPixels::F32(v)) => {
            convert(FromProjective(v, planes), (w, h), unit, frame)
        }
        _ => return Err(("holds another number type than the recording's first image".into(), "convert them alike")),
    };
    converted.map_err(|e| (e.to_string(), "check the constants in camera.toml"))
}

/// Turns the first `skipped` values and those that are background into `hole`.
fn make_holes<T: Copy>(values: &mut [T], hole: T, skipped: usize, is_background: impl Fn(T) -> bool) {
    for (i, v) in values.iter_mut().enumerate() {
        if i < skipped || is_background(*v) {
            *v = hole;
        }
    }
}

/// Copies readings; what is none becomes the one hole value.
fn keep<D: DepthSample>(values: &[D], out: &mut [D]) {
    for (out, &v) in out.iter_mut().zip(values) {
        *out = if v.is_valid() { v } else { D::HOLE };
    }
}

/// One of the core's conversions, for either number type of the result.
trait Conversion {
    fn run<D: DepthSample>(
        &self,
        size: (usize, usize),
        unit: DepthUnit,
        out: &mut ImageViewMut<'_, D>,
    ) -> Result<DecodeReport, DecodeError>;
}

struct FromDisparity<'a, S>(&'a [S], decode::Disparity);

impl<S: DepthSample> Conversion for FromDisparity<'_, S> {
    fn run<D: DepthSample>(
        &self,
        (w, h): (usize, usize),
        unit: DepthUnit,
        out: &mut ImageViewMut<'_, D>,
    ) -> Result<DecodeReport, DecodeError> {
        // A slice that does not fit is a size mismatch to the core.
        decode::disparity(ImageView::new(self.0, w, h).unwrap_or(ImageView::EMPTY), self.1, unit, out)
    }
}

struct FromProjective<'a>(&'a [f32], decode::Projective);

impl Conversion for FromProjective<'_> {
    fn run<D: DepthSample>(
        &self,
        (w, h): (usize, usize),
        unit: DepthUnit,
        out: &mut ImageViewMut<'_, D>,
    ) -> Result<DecodeReport, DecodeError> {
        decode::projective(ImageView::new(self.0, w, h).unwrap_or(ImageView::EMPTY), self.1, unit, out)
    }
}

/// Converts into `f32` metres, or into `u16` steps when a unit was chosen.
fn convert(
    conversion: impl Conversion,
    (w, h): (usize, usize),
    unit: Option<DepthUnit>,
    frame: &mut OwnedFrame,
) -> Result<(), DecodeError> {
    let misfit = DecodeError::SizeMismatch { input: (w, h), output: (0, 0) };
    frame.unit = unit.unwrap_or(DepthUnit::METRE);
    let report = if let Some(unit) = unit {
        let mut out = ImageViewMut::new(frame.depth_u16_mut(w, h), w, h).map_err(|_| misfit)?;
        conversion.run((w, h), unit, &mut out)?
    } else {
        let mut out = ImageViewMut::new(frame.depth_f32_mut(w, h), w, h).map_err(|_| misfit)?;
        conversion.run((w, h), DepthUnit::METRE, &mut out)?
    };
    if report.out_of_range > 0 {
        frame.notes.push(format!(
            "{} depths do not fit 16 bits of {} m: they are holes; choose another depth.unit, or none",
            report.out_of_range,
            frame.unit.metres()
        ));
    }
    Ok(())
}

/// Reads a colour image file.
fn load_colour(path: &Path, bytes: &mut Vec<u8>, frame: &mut OwnedFrame) -> Result<(), SourceError> {
    read_image(path, bytes)?;
    decode_colour(bytes, frame).map_err(in_file(path))
}

/// Decodes a colour image of any kind that the `image` crate knows, within bounds.
pub(crate) fn decode_colour(bytes: &[u8], frame: &mut OwnedFrame) -> Result<(), ParseError> {
    let unreadable =
        |e: image::ImageError| ParseError::new(format!("not readable as an image: {e}"), "PNG, JPEG and PNM are read");
    let mut reader = image::ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| unreadable(image::ImageError::IoError(e)))?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_SIDE as u32);
    limits.max_image_height = Some(MAX_SIDE as u32);
    limits.max_alloc = Some(MAX_PIXELS as u64 * 8);
    reader.limits(limits);
    // Sizes are checked before pixels are made: a small file may declare a huge image.
    let decoder = reader.into_decoder().map_err(unreadable)?;
    let (width, height) = decoder.dimensions();
    let pixels = checked_pixels(width as usize, height as usize)?;
    if bytes.starts_with(b"\x89PNG") {
        let bits = u64::from(decoder.original_color_type().bits_per_pixel());
        check_png_data(bytes, pixels as u64 * bits / 8)?;
    }
    let image = image::DynamicImage::from_decoder(decoder).map_err(unreadable)?.into_rgb8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let (pixels, _) = image.as_raw().as_chunks::<3>();
    frame.colour_mut(width, height).copy_from_slice(pixels);
    Ok(())
}
