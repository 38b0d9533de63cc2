//! A far frame: a small picture of a direction, for the far field.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 30 | 1 | which component of the quaternion is left out, 0 to 3 for x y z w |
//! | 31 | 6 | the other three, `i16`, 32767 for 1 / sqrt 2; the one left out is positive |
//! | 37 | 16 | fx, fy, cx, cy of the picture, `f32` pixels |
//! | 53 | 2 | its width and height, a byte each |
//! | 55 | 1 | the colour error |
//! | 56 | | colour, to the CRC, as in [`near`](super::near) |
//!
//! The camera's position is left out, as in the paper: all is at distance one. The picture covers all of the colour image. Each of its pixels
//! is the mean of the *light* of the pixels that it covers, taken as sRGB, and not of their codes: a lamp in 1 % of the pixels
//! counts for 1 % of the light, which the mean of codes makes a quarter of. (The paper takes one pixel of them.)
//!
//! Memory: three bytes a pixel of the picture, at the end of the caller's slice; the tables of [`colour`](crate::ground::colour). Cost: one pass over the colour image.
//! Error: rotation to 0.005 degrees; the mean to half a code of 255; colour as in [`near`](super::near).

use core::f32::consts::FRAC_1_SQRT_2;

use glam::Quat;

use super::bytes::{Put, Take};
use super::near::MOST_ERROR;
use super::planes;
use super::{FAR, FRAME_BYTES, Header, KeyFrameError, begin, put_intrinsics, take_intrinsics};
use crate::ground::colour::Colour;
use crate::ground::image::{ImageView, ImageViewMut};
use crate::ground::{math, rotation};
use crate::sensing::camera::Intrinsics;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// What to send of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FarOptions {
    /// Whose it is. Default 0.
    pub session: u32,
    /// The view that it replaces. Default 0.
    pub view: u16,
    /// Width and height of the picture, 1 to 255. Default 32 x 24.
    pub size: (u8, u8),
    /// How far Y, Cb and Cr may be off, 0 to 15. Default 1.
    pub colour_error: u8,
}

impl FarOptions {
    /// 32 x 24, to one step of colour.
    pub const DEFAULT: Self = Self { session: 0, view: 0, size: (32, 24), colour_error: 1 };
}

impl Default for FarOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Bytes before colour, and the CRC.
const OWN_BYTES: usize = FRAME_BYTES + 26;

/// Bytes that suffice to encode any picture of this size, the picture itself included.
///
/// ```
/// use isobath::wire::keyframe::far_most_bytes;
/// assert_eq!(far_most_bytes(32, 24), 4669);
/// ```
#[must_use]
pub const fn far_most_bytes(width: usize, height: usize) -> usize {
    let picture = width.saturating_mul(height).saturating_mul(3);
    OWN_BYTES.saturating_add(planes::most_bytes(width, height)).saturating_add(picture)
}

/// Writes a far frame; how many bytes it took.
///
/// # Errors
/// [`KeyFrameError::NoPose`], [`KeyFrameError::NoColour`], [`KeyFrameError::Full`], [`KeyFrameError::Field`] for an option out of its range
/// or a camera that has none at this size.
///
/// ```
/// use glam::{Quat, Vec3};
/// use isobath::ground::image::Image;
/// use isobath::sensing::camera::{Intrinsics, Pose};
/// use isobath::sensing::depth::{DepthArray, DepthUnit};
/// use isobath::sensing::frame::DepthFrame;
/// use isobath::wire::keyframe::{FarOptions, KeyFrame, encode_far, far_most_bytes};
/// let (depth, colour) = (DepthArray::<64, 48>::filled(0), Image::<[u8; 3], 128, 96>::filled([10, 80, 200]));
/// let pose = Pose::new(Quat::from_xyzw(0.0, 0.6, 0.0, 0.8), Vec3::ZERO)?;
/// let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, Intrinsics::new(60.0, 60.0, 31.5, 23.5)?)
///     .with_colour(colour.view())?
///     .with_pose(pose);
/// let mut message = [0; far_most_bytes(32, 24)];
/// let used = encode_far(&frame, &FarOptions::default(), &mut message)?;
/// assert!(used < 250); // the paper: 1,189
///
/// let KeyFrame::Far(far) = KeyFrame::decode(&message[..used])? else { panic!("no far frame") };
/// assert!(far.rotation().angle_between(pose.rotation()) < 1e-4);
/// assert_eq!(far.intrinsics().fx(), 30.0);
/// let mut picture = Image::<[u8; 3], 32, 24>::filled([0; 3]);
/// far.colour_into(&mut picture.view_mut())?;
/// assert!(picture.as_slice().iter().all(|p| p[2].abs_diff(200) < 5));
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
pub fn encode_far<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    options: &FarOptions,
    out: &mut [u8],
) -> Result<usize, KeyFrameError> {
    let pose = frame.pose().ok_or(KeyFrameError::NoPose)?;
    let (image, map) = frame.colour().ok_or(KeyFrameError::NoColour)?;
    let field = |what| KeyFrameError::Field { what, at: 0 };
    if options.size.0 == 0 || options.size.1 == 0 {
        return Err(field("the picture's size"));
    }
    if options.colour_error > MOST_ERROR {
        return Err(field("the colour error"));
    }
    let size = (usize::from(options.size.0), usize::from(options.size.1));
    let k = map.colour_intrinsics(frame.intrinsics());
    let (sx, sy) = (size.0 as f32 / image.width() as f32, size.1 as f32 / image.height() as f32);
    let k = k.and_then(|k| k.resized(sx, sy)).map_err(|_| field("the camera at the picture's size"))?;

    let header =
        Header { session: options.session, sequence: frame.sequence(), time: frame.time(), view: options.view };
    let got = out.len();
    let split = got.checked_sub(size.0 * size.1 * 3).and_then(|at| out.split_at_mut_checked(at));
    let (message, picture) = split.ok_or(KeyFrameError::Full { got })?;
    let (picture, _) = picture.as_chunks_mut::<3>();
    for (index, pixel) in picture.iter_mut().enumerate() {
        *pixel = mean(image, size, index % size.0, index / size.0);
    }
    let picture = ImageView::new(picture, size.0, size.1).map_err(|_| KeyFrameError::Full { got })?;
    let full = |e: KeyFrameError| if let KeyFrameError::Full { .. } = e { KeyFrameError::Full { got } } else { e };
    let mut write = || {
        let mut put = begin(message, FAR, header)?;
        put_rotation(&mut put, pose.rotation())?;
        put_intrinsics(&mut put, &k)?;
        put.bytes(&[options.size.0, options.size.1, options.colour_error])?;
        let used = planes::encode(size, |x, y| picture.get(x, y), options.colour_error, put.rest())?;
        put.skip(used);
        put.seal()
    };
    write().map_err(full)
}

/// The part of `0..whole` that cell `index` of `cells` covers; at least one.
fn span(index: usize, cells: usize, whole: usize) -> (usize, usize) {
    // In 64 bits: no image is too wide for the product.
    let at = |index: usize| (index as u64 * whole as u64 / cells as u64) as usize;
    let start = at(index);
    (start, at(index + 1).max(start + 1))
}

/// The mean light of a cell.
fn mean(image: ImageView<'_, [u8; 3]>, size: (usize, usize), x: usize, y: usize) -> [u8; 3] {
    let (left, right) = span(x, size.0, image.width());
    let (top, bottom) = span(y, size.1, image.height());
    let mut sums = [0.0_f32; 3];
    for y in top..bottom {
        // Row by row, so that no sum gets much larger than what is added.
        let mut row = [0.0_f32; 3];
        for pixel in image.row(y).get(left..right).unwrap_or_default() {
            for (sum, v) in row.iter_mut().zip(pixel.linear()) {
                *sum += v;
            }
        }
        for (sum, row) in sums.iter_mut().zip(row) {
            *sum += row;
        }
    }
    let count = ((right - left) * (bottom - top)) as f32;
    Colour::of_linear(sums.map(|sum| sum / count))
}

/// 32767 for the largest that three of four components can be.
const SCALE: f32 = 32_767.0 / FRAC_1_SQRT_2;

fn put_rotation(put: &mut Put<'_>, q: Quat) -> Result<(), KeyFrameError> {
    let q = q.to_array();
    let mut largest = (0, 0.0_f32);
    for (i, v) in q.into_iter().enumerate() {
        if v.abs() > largest.1.abs() {
            largest = (i, v);
        }
    }
    let sign = if largest.1 < 0.0 { -1.0 } else { 1.0 };
    put.u8(largest.0 as u8)?;
    for (_, v) in q.into_iter().enumerate().filter(|(i, _)| *i != largest.0) {
        put.bytes(&(math::round(v * sign * SCALE) as i16).to_le_bytes())?;
    }
    Ok(())
}

fn take_rotation(take: &mut Take<'_>) -> Result<Quat, KeyFrameError> {
    let missing = usize::from(take.u8()?);
    let others = [take.i16()?, take.i16()?, take.i16()?].map(|v| f32::from(v) / SCALE);
    let rest = 1.0 - others.iter().map(|v| v * v).sum::<f32>();
    // The one left out is the largest: at least a half, to rounding.
    if missing > 3 || !(rest >= 0.24) {
        return Err(KeyFrameError::Field { what: "the rotation", at: take.at() });
    }
    let mut others = others.into_iter();
    let mut q = [math::sqrt(rest); 4];
    for (_, v) in q.iter_mut().enumerate().filter(|(i, _)| *i != missing) {
        *v = others.next().unwrap_or(0.0);
    }
    Ok(rotation::unit(Quat::from_array(q)))
}

/// A far frame, checked; it borrows the message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Far<'a> {
    header: Header,
    rotation: Quat,
    intrinsics: Intrinsics,
    size: (usize, usize),
    colour: &'a [u8],
    error: u8,
}

impl<'a> Far<'a> {
    pub(super) fn read(header: Header, mut take: Take<'a>) -> Result<Self, KeyFrameError> {
        let rotation = take_rotation(&mut take)?;
        let intrinsics = take_intrinsics(&mut take)?;
        let size = (usize::from(take.u8()?), usize::from(take.u8()?));
        if size.0 == 0 || size.1 == 0 {
            return Err(KeyFrameError::Field { what: "the picture's size", at: take.at() });
        }
        let error = take.u8()?;
        if error > MOST_ERROR {
            return Err(KeyFrameError::Field { what: "the colour error", at: take.at() });
        }
        Ok(Self { header, rotation, intrinsics, size, colour: take.rest(), error })
    }

    /// Session, sequence, time and view.
    #[must_use]
    pub const fn header(&self) -> Header {
        self.header
    }

    /// How the camera was turned: camera-to-world, unit length, good to 0.005 degrees.
    #[must_use]
    pub const fn rotation(&self) -> Quat {
        self.rotation
    }

    /// The picture's camera.
    #[must_use]
    pub const fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    /// Width and height of the picture, at most 255.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Decodes the picture.
    ///
    /// # Errors
    /// [`KeyFrameError::OtherImage`] when the image is not of [`Self::size`]; [`KeyFrameError::Colour`] when the stream is none (the
    /// image is then black).
    pub fn colour_into(&self, out: &mut ImageViewMut<'_, [u8; 3]>) -> Result<(), KeyFrameError> {
        if out.size() != self.size {
            return Err(KeyFrameError::OtherImage { size: self.size, got: out.size() });
        }
        planes::decode(self.colour, |_, _| true, self.error, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::colour::{decode_srgb as light, encode_srgb as code};
    use proptest::prelude::*;

    /// sRGB by its definition (IEC 61966-2-1), in double precision.
    fn exact_light(code: f64) -> f64 {
        let v = code / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    }
    fn exact_code(light: f64) -> f64 {
        255.0 * if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
    }

    #[test]
    fn the_mean_is_one_of_light() {
        assert!((0..=255).all(|v| code(light(v)) == v));
        let mut worst: f64 = 0.0;
        for (a, b) in (0..=255_u8).step_by(3).flat_map(|a| (0..=255_u8).step_by(5).map(move |b| (a, b))) {
            for share in 0..=10 {
                let share = share as f32 / 10.0;
                let got = code(light(a) * share + light(b) * (1.0 - share));
                let (a, b, share) = (f64::from(a), f64::from(b), f64::from(share));
                let want = exact_code(exact_light(a) * share + exact_light(b) * (1.0 - share));
                worst = worst.max((f64::from(got) - want).abs());
            }
        }
        std::println!("mean of light: off by at most {worst:.2} codes");
        assert!(worst < 0.51, "{worst}");
        assert_eq!(code(0.01), 25, "a lamp in 1 % of the pixels; the mean of codes is 3");
    }

    #[test]
    fn cells_cover_the_image_whatever_the_sizes() {
        for (cells, whole) in [(32, 256), (32, 100), (24, 7), (1, 1), (255, 1)] {
            let mut next = 0;
            for i in 0..cells {
                let (start, end) = span(i, cells, whole);
                assert!(start < end && end <= whole && start <= next);
                next = end;
            }
            assert_eq!(next, whole);
        }
    }

    proptest! {
        #[test]
        fn rotations_come_back(q in proptest::array::uniform4(-1.0_f32..1.0)) {
            let q = rotation::unit(Quat::from_array(q));
            let mut bytes = [0; 7];
            put_rotation(&mut Put::new(&mut bytes), q).unwrap();
            let back = take_rotation(&mut Take::new(&bytes)).unwrap();
            prop_assert!(rotation::way(q, back).length().to_degrees() < 0.005);
        }
    }
}
