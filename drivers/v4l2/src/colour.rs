//! The colour camera beside the depth camera: its images, converted to RGB and seen from the depth camera's place.
//!
//! Colour has its own node, its own lens and its own clock tick. A frame takes the newest colour image whose time is within 50 ms of its own. Each depth
//! pixel's point is carried into the colour camera (its pose and pinhole from the device's calibration) and takes the nearest pixel there: the result
//! has the depth image's size, and pixels without depth are black. What the colour camera sees behind an edge of the depth camera's
//! view takes the edge's colour; there is no test for it.
//!
//! | format | converted by |
//! |---|---|
//! | `YUYV`, `UYVY` | BT.601, limited range, in 8-bit fixed point (as librealsense and Microsoft's "Recommended 8-Bit YUV Formats"); error at most 1 of 255 |
//! | `MJPG` | `zune-jpeg`, which allocates for each image |
//!
//! Cost: about 2.2 ns a pixel of YUYV, 9 ns a depth pixel in all (`cargo bench -p isobath-v4l2`). Memory: one colour image.

use isobath::glam::{Mat3, Vec3};
use isobath::sensing::camera::{Camera, Intrinsics, Pose};
use isobath_source::{HostNanos, OwnedFrame};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// How far apart depth and colour of one frame may be, nanoseconds: one and a half frames at 30 a second.
const APART: u64 = 50_000_000;

/// A form of colour images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Y0 U Y1 V.
    Yuyv,
    /// U Y0 V Y1.
    Uyvy,
    /// A JPEG image.
    Mjpg,
}

impl Form {
    /// From V4L2's letters; `None` for others.
    #[must_use]
    pub const fn of(fourcc: [u8; 4]) -> Option<Self> {
        match &fourcc {
            b"YUYV" => Some(Self::Yuyv),
            b"UYVY" => Some(Self::Uyvy),
            b"MJPG" => Some(Self::Mjpg),
            _ => None,
        }
    }

    /// Bytes a whole image has at least.
    #[must_use]
    pub const fn need(self, width: usize, height: usize, stride: usize) -> usize {
        match self {
            Self::Mjpg => 4,
            _ if height == 0 => 0,
            _ => (height - 1).saturating_mul(stride).saturating_add(width.saturating_mul(2)),
        }
    }
}

/// One pixel by BT.601, limited range.
fn rgb(y: u8, u: u8, v: u8) -> [u8; 3] {
    let (c, d, e) = (298 * (i32::from(y) - 16), i32::from(u) - 128, i32::from(v) - 128);
    [c + 409 * e, c - 100 * d - 208 * e, c + 516 * d].map(|v| ((v + 128) >> 8).clamp(0, 255) as u8)
}

/// Converts rows of `YUYV` or `UYVY` that start `stride` bytes apart; stops where bytes or pixels end. Two pixels share their colour.
pub fn from_yuv(bytes: &[u8], stride: usize, form: Form, width: usize, out: &mut [[u8; 3]]) {
    for (line, row) in bytes.chunks(stride.max(1)).zip(out.chunks_mut(width.max(1))) {
        for (four, pixels) in line.as_chunks::<4>().0.iter().zip(row.chunks_mut(2)) {
            let [y0, u, y1, v] = if form == Form::Uyvy { [four[1], four[0], four[3], four[2]] } else { *four };
            for (pixel, y) in pixels.iter_mut().zip([y0, y1]) {
                *pixel = rgb(y, u, v);
            }
        }
    }
}

/// Decodes a JPEG image of exactly this size.
///
/// # Errors
/// What is wrong with it, in words.
pub fn from_jpeg(bytes: &[u8], size: (usize, usize), out: &mut [[u8; 3]]) -> Result<(), String> {
    let options =
        DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB).set_max_width(size.0).set_max_height(size.1);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| e.to_string())?;
    if decoder.dimensions() != Some(size) {
        return Err(format!("is {:?}, not {size:?}", decoder.dimensions()));
    }
    decoder.decode_into(out.as_flattened_mut()).map_err(|e| e.to_string())
}

/// The newest colour image, and how to see it from the depth camera.
#[derive(Debug)]
pub struct ColourView {
    form: Form,
    size: (usize, usize),
    stride: usize,
    camera: Camera,
    /// The colour camera's place in the depth camera's frame.
    pose: Pose,
    image: Vec<[u8; 3]>,
    time: Option<HostNanos>,
    /// Images that could not be decoded.
    pub broken: u64,
}

impl ColourView {
    /// For images of this form, size in pixels and stride in bytes, from a camera of this calibration and place.
    #[must_use]
    pub fn new(form: Form, size: (usize, usize), stride: usize, camera: Camera, pose: Pose) -> Self {
        let image = vec![[0; 3]; size.0 * size.1];
        Self { form, size, stride, camera, pose, image, time: None, broken: 0 }
    }

    /// Width and height of the colour images.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The colour camera.
    #[must_use]
    pub const fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The colour camera's place in the depth camera's frame.
    #[must_use]
    pub const fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Takes an image that arrived at `time`.
    pub fn take(&mut self, bytes: &[u8], time: HostNanos) {
        let result = match self.form {
            Form::Mjpg => from_jpeg(bytes, self.size, &mut self.image),
            form => {
                from_yuv(bytes, self.stride, form, self.size.0, &mut self.image);
                Ok(())
            }
        };
        self.time = result.is_ok().then_some(time);
        self.broken += u64::from(result.is_err());
    }

    /// Forgets the image.
    pub const fn forget(&mut self) {
        self.time = None;
    }

    /// Colours a frame that arrived at `time`, if the image is of about that time.
    pub fn colour(&self, frame: &mut OwnedFrame, time: HostNanos) {
        match self.time {
            Some(own) if own.0.abs_diff(time.0) <= APART => self.register(frame),
            _ => frame.clear_colour(),
        }
    }

    fn register(&self, frame: &mut OwnedFrame) {
        let k: Intrinsics = frame.intrinsics;
        let to_colour = self.pose.inverse();
        let (turn, shift) = (Mat3::from_quat(to_colour.rotation()), to_colour.translation());
        let lens = (!self.camera.distortion.is_none()).then_some(&self.camera);
        let c = self.camera.intrinsics;
        let (w, h) = (self.size.0 as f32, self.size.1 as f32);
        let (scale_x, scale_y) = (1.0 / k.fx(), 1.0 / k.fy());
        frame.colour_of_points(|x, y, z| {
            let ray = Vec3::new((x - k.cx()) * scale_x, (y - k.cy()) * scale_y, 1.0);
            let p = turn * (ray * z) + shift;
            if !(p.z > 0.0) {
                return [0; 3];
            }
            let (u, v) = match lens {
                None => (c.fx() * p.x / p.z + c.cx(), c.fy() * p.y / p.z + c.cy()),
                Some(camera) => match camera.project(p) {
                    Some(at) => (at.x, at.y),
                    None => return [0; 3],
                },
            };
            let (u, v) = (u + 0.5, v + 0.5);
            if u >= 0.0 && v >= 0.0 && u < w && v < h {
                self.image.get(v as usize * self.size.0 + u as usize).copied().unwrap_or_default()
            } else {
                [0; 3]
            }
        });
    }
}
