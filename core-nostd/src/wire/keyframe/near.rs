//! A near frame: depth and colour of what is around the object, and where they were seen from.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 30 | 28 | pose, camera-to-world: quaternion x y z w, position in metres, `f32` |
//! | 58 | 16 | fx, fy, cx, cy of the rectangle sent, `f32` pixels |
//! | 74 | 4 | metres per step of depth, `f32` |
//! | 78 | 4 | width and height of the rectangle, `u16` |
//! | 82 | 4 | its left and top in the frame that it was cut from, `u16` |
//! | 86 | 1 | 0: no colour; else the colour error plus 1 |
//! | 87 | 4 | pixels with a reading |
//! | 91 | 4 | bytes of depth |
//! | 95 | | depth, [RVL](crate::wire::rvl) |
//! | | | colour, to the CRC: Y of each pixel with a reading, row by row; then Cb and Cr by turns, of each 2 x 2 pixels with one (see the source, `planes.rs`) |
//!
//! Pixels outside the boundary, of too little confidence, or without a reading are holes there and have no colour. The
//! smallest rectangle that holds the others is sent, with intrinsics of its own, so that whoever decodes it has a
//! frame like any other, only smaller. Colour is resampled to the depth image's grid, the nearest pixel, as the paper does:
//! what colour the image had beside depth, or between its pixels, is not sent.
//!
//! Memory: an eighth of a byte a pixel, at the end of the caller's slice, says which pixels are kept; no other. Cost: one
//! pass with a rotation, then RVL's, then two for colour.

use glam::Vec3;

use super::bytes::Take;
use super::planes;
use super::{
    FRAME_BYTES, Header, KeyFrameError, MOST_PIXELS, NEAR, begin, put_intrinsics, take_intrinsics, take_pose, take_size,
};
use crate::ground::image::{ImageView, ImageViewMut};
use crate::ground::rotation::rotate;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::{DepthSample, DepthUnit};
use crate::sensing::frame::DepthFrame;
use crate::wire::rvl;

/// A cube, its sides along the world's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Boundary {
    /// Its middle: the object's position, world, metres; finite.
    pub centre: Vec3,
    /// Half its side, metres, above 0. The paper: 1.
    pub half: f32,
}

/// What to send of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearOptions {
    /// Whose it is. Default 0.
    pub session: u32,
    /// The view that it replaces. Default 0.
    pub view: u16,
    /// The near field; `None` (the default) sends every reading.
    pub boundary: Option<Boundary>,
    /// Least confidence, 0 to 255, of a pixel that is sent. Default 0; without a confidence image every pixel is certain.
    pub min_confidence: u8,
    /// Metres per step that depth is sent in. `None`, the default: the frame's own for `u16`, which loses nothing; a millimetre for
    /// `f32`. What it cannot hold becomes a hole.
    pub unit: Option<DepthUnit>,
    /// How far Y, Cb and Cr may be off, 0 to 15: 0 sends what 4:2:0 leaves exactly. Default 1.
    pub colour_error: u8,
    /// Whether to send colour, when there is some. Default true.
    pub colour: bool,
}

impl NearOptions {
    /// Everything, to one step of colour.
    pub const DEFAULT: Self =
        Self { session: 0, view: 0, boundary: None, min_confidence: 0, unit: None, colour_error: 1, colour: true };
}

impl Default for NearOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Largest colour error.
pub(super) const MOST_ERROR: u8 = 15;

/// Bytes before depth, and the CRC.
const OWN_BYTES: usize = FRAME_BYTES + 65;

/// Bytes that suffice to encode any frame of this size, the map of what is kept included.
///
/// ```
/// use isobath::wire::keyframe::near_most_bytes;
/// assert_eq!(near_most_bytes(256, 192), 301_172);
/// ```
#[must_use]
pub const fn near_most_bytes(width: usize, height: usize) -> usize {
    let depth = rvl::most_bytes(width.saturating_mul(height));
    let colour = planes::most_bytes(width, height);
    let kept = width.div_ceil(8).saturating_mul(height);
    OWN_BYTES.saturating_add(depth).saturating_add(colour).saturating_add(kept)
}

/// Which pixels are sent: a bit each, rows begin with a byte.
struct Kept<'a> {
    bits: &'a [u8],
    stride: usize,
}

impl Kept<'_> {
    fn get(&self, x: usize, y: usize) -> bool {
        self.bits.get(y * self.stride + x / 8).is_some_and(|b| b >> (x % 8) & 1 == 1)
    }
}

/// The smallest rectangle, and what is in it.
#[derive(Clone, Copy)]
struct Extent {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
    count: u32,
}

/// Which part of a frame's row is near: the point of column x at depth z is `z (start + x step) + origin`, from the cube's middle.
struct Cube {
    step: Vec3,
    start: Vec3,
    origin: Vec3,
    half: f32,
}

impl Cube {
    fn of_row(boundary: Boundary, pose: &Pose, k: &Intrinsics, y: usize) -> Self {
        let q = pose.rotation();
        Self {
            step: rotate(q, Vec3::X) / k.fx(),
            start: rotate(q, Vec3::new(-k.cx() / k.fx(), (y as f32 - k.cy()) / k.fy(), 1.0)),
            origin: pose.translation() - boundary.centre,
            half: boundary.half,
        }
    }

    #[inline(always)]
    fn holds(&self, x: usize, z: f32) -> bool {
        let x = x as f32;
        let off = |start: f32, step: f32, origin: f32| (z * (start + x * step) + origin).abs();
        (off(self.start.x, self.step.x, self.origin.x) <= self.half)
            & (off(self.start.y, self.step.y, self.origin.y) <= self.half)
            & (off(self.start.z, self.step.z, self.origin.z) <= self.half)
    }
}

/// Marks the pixels to send; `None` when there are none.
fn mark<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pose: &Pose,
    options: &NearOptions,
    unit: DepthUnit,
    bits: &mut [u8],
) -> Option<Extent> {
    let stride = frame.size().0.div_ceil(8);
    let mut extent = Extent { left: usize::MAX, top: usize::MAX, right: 0, bottom: 0, count: 0 };
    bits.fill(0);
    for (y, (row, marks)) in frame.depth().rows().zip(bits.chunks_exact_mut(stride.max(1))).enumerate() {
        let cube = options.boundary.map(|b| Cube::of_row(b, pose, frame.intrinsics(), y));
        let sure = frame.confidence().map_or(&[] as &[u8], |c| c.row(y));
        let mut sure = sure.iter().copied();
        for (eight, (values, mark)) in row.chunks(8).zip(marks).enumerate() {
            for (bit, value) in values.iter().enumerate() {
                let sure = sure.next().unwrap_or(u8::MAX) >= options.min_confidence;
                let z = value.metres(frame.unit());
                let x = 8 * eight + bit;
                let near = cube.as_ref().is_none_or(|c| c.holds(x, z));
                *mark |= u8::from(near & sure && u16::from_metres(z, unit) > 0) << bit;
            }
            if *mark > 0 {
                extent.left = extent.left.min(8 * eight + mark.trailing_zeros() as usize);
                extent.right = extent.right.max(8 * eight + 7 - mark.leading_zeros() as usize);
                extent.top = extent.top.min(y);
                extent.bottom = y;
                extent.count += mark.count_ones();
            }
        }
    }
    (extent.count > 0).then_some(extent)
}

/// Writes a near frame; how many bytes it took. [`near_most_bytes`] always suffices; the bytes behind those used are scribbled on.
///
/// # Errors
/// [`KeyFrameError::NoPose`]; [`KeyFrameError::NothingNear`] when no pixel is to be sent; [`KeyFrameError::Full`];
/// [`KeyFrameError::TooLarge`]; [`KeyFrameError::Field`] for a colour error or boundary out of its range.
pub fn encode_near<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    options: &NearOptions,
    out: &mut [u8],
) -> Result<usize, KeyFrameError> {
    let pose = frame.pose().ok_or(KeyFrameError::NoPose)?;
    let (width, height) = frame.size();
    let most = usize::from(u16::MAX);
    if width > most || height > most || width.saturating_mul(height) > MOST_PIXELS {
        return Err(KeyFrameError::TooLarge { size: (width, height) });
    }
    if options.colour_error > MOST_ERROR {
        return Err(KeyFrameError::Field { what: "the colour error", at: 0 });
    }
    if options.boundary.is_some_and(|b| !(b.centre.is_finite() && b.half > 0.0)) {
        return Err(KeyFrameError::Field { what: "the boundary", at: 0 });
    }
    let own = if D::ROUNDING > 0.0 { frame.unit() } else { DepthUnit::MILLIMETRE };
    let unit = options.unit.unwrap_or(own);

    let got = out.len();
    let stride = width.div_ceil(8);
    let split = got.checked_sub(stride * height).and_then(|at| out.split_at_mut_checked(at));
    let (message, bits) = split.ok_or(KeyFrameError::Full { got })?;
    let extent = mark(frame, &pose, options, unit, bits).ok_or(KeyFrameError::NothingNear)?;
    let kept = Kept { bits, stride };
    let (left, top) = (extent.left, extent.top);
    let size = (extent.right - left + 1, extent.bottom - top + 1);

    let colour = frame.colour().filter(|_| options.colour);
    let header =
        Header { session: options.session, sequence: frame.sequence(), time: frame.time(), view: options.view };
    let full = |e: KeyFrameError| if let KeyFrameError::Full { .. } = e { KeyFrameError::Full { got } } else { e };
    let mut put = begin(message, NEAR, header).map_err(full)?;
    let write = |put: &mut super::Put<'_>| -> Result<(), KeyFrameError> {
        put.floats(&pose.rotation().to_array())?;
        put.floats(&pose.translation().to_array())?;
        put_intrinsics(put, &frame.intrinsics().cropped(left as f32, top as f32))?;
        put.floats(&[unit.metres()])?;
        for n in [size.0, size.1, left, top] {
            put.u16(n as u16)?;
        }
        put.u8(colour.map_or(0, |_| options.colour_error + 1))?;
        put.u32(extent.count)?;
        let length_at = put.at();
        put.u32(0)?;
        let pixels = || {
            let rows = (top..top + size.1).map(|y| (y, frame.depth().row(y).get(left..).unwrap_or_default()));
            let kept = &kept;
            rows.flat_map(move |(y, row)| {
                let row = row.get(..size.0).unwrap_or_default();
                row.iter().enumerate().map(move |(x, value)| {
                    if kept.get(left + x, y) { u16::from_metres(value.metres(frame.unit()), unit) } else { 0 }
                })
            })
        };
        let depth_bytes = rvl::encode_pixels(pixels(), pixels(), put.rest())?;
        put.skip(depth_bytes);
        put.amend(length_at, &(depth_bytes as u32).to_le_bytes());
        if let Some((image, map)) = colour {
            // Equal sizes map pixel to pixel.
            let same = image.size() == frame.size();
            let pixel = |x: usize, y: usize| {
                let (x, y) = (left + x, top + y);
                if !kept.get(x, y) {
                    return None;
                }
                let found = if same {
                    image.get(x, y)
                } else {
                    map.colour_from_depth(glam::Vec2::new(x as f32, y as f32))
                        .and_then(|p| crate::sensing::camera::intrinsics::pixel_index(p, image.size()))
                        .and_then(|(x, y)| image.get(x, y))
                };
                Some(found.unwrap_or_default())
            };
            let colour_bytes = planes::encode(size, pixel, options.colour_error, put.rest())?;
            put.skip(colour_bytes);
        }
        Ok(())
    };
    write(&mut put).map_err(full)?;
    put.seal().map_err(full)
}

/// A near frame, checked; it borrows the message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near<'a> {
    header: Header,
    pose: Pose,
    intrinsics: Intrinsics,
    unit: DepthUnit,
    size: (usize, usize),
    origin: (usize, usize),
    count: usize,
    depth: &'a [u8],
    colour: Option<(&'a [u8], u8)>,
}

impl<'a> Near<'a> {
    pub(super) fn read(header: Header, mut take: Take<'a>) -> Result<Self, KeyFrameError> {
        let pose = take_pose(&mut take)?;
        let intrinsics = take_intrinsics(&mut take)?;
        let unit = DepthUnit::new(take.f32()?);
        let unit = unit.map_err(|_| KeyFrameError::Field { what: "the depth unit", at: take.at() })?;
        let size = take_size(&mut take)?;
        let origin = (usize::from(take.u16()?), usize::from(take.u16()?));
        let error = match take.u8()? {
            code @ 0..=16 => code.checked_sub(1),
            _ => return Err(KeyFrameError::Field { what: "the colour error", at: take.at() }),
        };
        let count = take.u32()? as usize;
        if count == 0 || count > size.0 * size.1 {
            return Err(KeyFrameError::Field { what: "the number of pixels", at: take.at() });
        }
        let length = take.u32()? as usize;
        let depth = take.slice(length)?;
        let colour = error.map(|error| (take.rest(), error));
        if colour.is_none() && !take.rest().is_empty() {
            return Err(KeyFrameError::Field { what: "the length of depth", at: take.at() });
        }
        Ok(Self { header, pose, intrinsics, unit, size, origin, count, depth, colour })
    }

    /// Session, sequence, time and view.
    #[must_use]
    pub const fn header(&self) -> Header {
        self.header
    }

    /// Where the camera stood: camera-to-world.
    #[must_use]
    pub const fn pose(&self) -> Pose {
        self.pose
    }

    /// The camera of the rectangle sent.
    #[must_use]
    pub const fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    /// Metres per step of depth.
    #[must_use]
    pub const fn unit(&self) -> DepthUnit {
        self.unit
    }

    /// Width and height of the rectangle sent: of the images to decode into.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Left and top of the rectangle in the frame that it was cut from.
    #[must_use]
    pub const fn origin(&self) -> (usize, usize) {
        self.origin
    }

    /// How many pixels have a reading: the points that there will be.
    #[must_use]
    pub const fn readings(&self) -> usize {
        self.count
    }

    /// Whether there is colour.
    #[must_use]
    pub const fn has_colour(&self) -> bool {
        self.colour.is_some()
    }

    /// Bytes of the depth stream, and of colour's.
    #[must_use]
    pub fn stream_bytes(&self) -> (usize, usize) {
        (self.depth.len(), self.colour.map_or(0, |(bytes, _)| bytes.len()))
    }

    /// Decodes depth, in [`Self::unit`]; holes are 0. No loss.
    ///
    /// # Errors
    /// [`KeyFrameError::OtherImage`] when the image is not of [`Self::size`]; [`KeyFrameError::Depth`] when the stream is none,
    /// or [`KeyFrameError::Field`] when it is another than was announced; what is in the image then is unspecified.
    pub fn depth_into(&self, out: &mut ImageViewMut<'_, u16>) -> Result<(), KeyFrameError> {
        self.check_size(out.size())?;
        let used = rvl::decode(self.depth, out)?;
        if used != self.depth.len() || readings(out.as_view()) != self.count {
            return Err(KeyFrameError::Field { what: "the depth stream", at: OWN_BYTES });
        }
        Ok(())
    }

    /// Decodes colour where the depth image, as [`Self::depth_into`] decoded it, has a reading; black elsewhere.
    ///
    /// # Errors
    /// [`KeyFrameError::ColourLeftOut`]; [`KeyFrameError::OtherImage`] when either image is not of [`Self::size`] or depth has other
    /// readings; [`KeyFrameError::Colour`] when the stream is none (the image is then black).
    pub fn colour_into(
        &self,
        depth: ImageView<'_, u16>,
        out: &mut ImageViewMut<'_, [u8; 3]>,
    ) -> Result<(), KeyFrameError> {
        let (bytes, error) = self.colour.ok_or(KeyFrameError::ColourLeftOut)?;
        self.check_size(depth.size())?;
        self.check_size(out.size())?;
        if readings(depth) != self.count {
            return Err(KeyFrameError::OtherImage { size: self.size, got: depth.size() });
        }
        planes::decode(bytes, |x, y| depth.get(x, y).is_some_and(|v| v > 0), error, out)
    }

    const fn check_size(&self, got: (usize, usize)) -> Result<(), KeyFrameError> {
        if got.0 == self.size.0 && got.1 == self.size.1 {
            Ok(())
        } else {
            Err(KeyFrameError::OtherImage { size: self.size, got })
        }
    }
}

fn readings(depth: ImageView<'_, u16>) -> usize {
    depth.rows().map(|row| row.iter().filter(|v| **v > 0).count()).sum()
}
