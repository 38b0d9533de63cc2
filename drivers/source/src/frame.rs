//! A frame that owns its pixels, filled again and again by a source.
//!
//! Depth stays as the source has it, `u16` steps or `f32`; [`OwnedFrame::view`] borrows it as the core's frame type without
//! converting, and [`with_frame!`](crate::with_frame) or [`FrameVisitor`] runs one generic piece of code on either. Buffers keep their
//! capacity: a source whose frames keep their size allocates for the first one only. Depth, confidence and colour can't
//! disagree about sizes, because the frame hands out its buffers already sized.
//!
//! ```
//! use isobath::sensing::depth::DepthUnit;
//! use isobath_source::{OwnedFrame, with_frame};
//! let mut frame = OwnedFrame::new();
//! frame.depth_u16_mut(2, 1).copy_from_slice(&[1500, 0]);
//! frame.unit = DepthUnit::MILLIMETRE;
//! let nearest = with_frame!(frame, |f| f.z(0, 0));
//! assert!((nearest - 1.5).abs() < 1e-6);
//! ```

use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::rectify::rectify;
use isobath::sensing::camera::{Camera, Intrinsics, Pose};
use isobath::sensing::depth::confidence::{Limits, apply_limits};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;

/// The values of a depth image, row after row, in the source's own number type.
#[derive(Debug, Clone, PartialEq)]
pub enum DepthPixels {
    /// Steps of the frame's unit; 0 (and 65535) is "no reading".
    U16(Vec<u16>),
    /// Steps of the frame's unit (usually 1 m); 0, negative, NaN and infinite are "no reading".
    F32(Vec<f32>),
}

/// An RGB image.
#[derive(Debug, Clone, PartialEq, Default)]
struct Colour {
    pixels: Vec<[u8; 3]>,
    width: usize,
    height: usize,
    present: bool,
}

/// One frame, owning its memory.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnedFrame {
    depth: DepthPixels,
    width: usize,
    height: usize,
    confidence: Vec<u8>,
    has_confidence: bool,
    colour: Colour,
    spare: Spare,
    /// Metres per step of the depth values.
    pub unit: DepthUnit,
    /// The pinhole through which depth was seen.
    pub intrinsics: Intrinsics,
    /// Camera-to-world, when known.
    pub pose: Option<Pose>,
    /// Time of exposure, in the source's own epoch.
    pub time: Timestamp,
    /// The frame's number in its stream, from 0.
    pub sequence: u64,
    /// What a user should know about this frame: a pose that is not one, a colour image that can't be read.
    pub notes: Vec<String>,
}

/// Memory for copies, kept from frame to frame. It is no part of what a frame is.
#[derive(Debug, Clone, Default)]
struct Spare {
    u16: Vec<u16>,
    f32: Vec<f32>,
    u8: Vec<u8>,
    rgb: Vec<[u8; 3]>,
}

impl PartialEq for Spare {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

fn straighten<T: Copy>(pixels: &mut [T], bent: &mut Vec<T>, (w, h): (usize, usize), camera: &Camera, hole: T) {
    bent.clear();
    bent.extend_from_slice(pixels);
    if let (Ok(bent), Ok(mut out)) = (ImageView::new(bent, w, h), ImageViewMut::new(pixels, w, h)) {
        rectify(bent, camera, &camera.intrinsics, hole, &mut out);
    }
}

fn paint<'a, D: DepthSample>(
    rows: impl Iterator<Item = ((usize, &'a mut [[u8; 3]]), &'a [D])>,
    unit: DepthUnit,
    colour: &mut impl FnMut(f32, f32, f32) -> [u8; 3],
) {
    for ((y, out), depth) in rows {
        for ((x, out), d) in out.iter_mut().enumerate().zip(depth) {
            if d.is_valid() {
                *out = colour(x as f32, y as f32, d.metres(unit));
            }
        }
    }
}

/// What an empty frame carries until a source fills it.
const NO_CAMERA: Intrinsics = match Intrinsics::new(1.0, 1.0, 0.0, 0.0) {
    Ok(k) => k,
    Err(_) => panic!("evaluated by the compiler: a focal length of one pixel is legal"),
};

impl Default for OwnedFrame {
    fn default() -> Self {
        Self::new()
    }
}

impl OwnedFrame {
    /// A frame of no pixels, to be filled.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            depth: DepthPixels::U16(Vec::new()),
            width: 0,
            height: 0,
            confidence: Vec::new(),
            has_confidence: false,
            colour: Colour { pixels: Vec::new(), width: 0, height: 0, present: false },
            spare: Spare { u16: Vec::new(), f32: Vec::new(), u8: Vec::new(), rgb: Vec::new() },
            unit: DepthUnit::MILLIMETRE,
            intrinsics: NO_CAMERA,
            pose: None,
            time: Timestamp::ZERO,
            sequence: 0,
            notes: Vec::new(),
        }
    }

    /// Forgets everything but the memory: what a source does before filling the frame.
    pub fn clear(&mut self) {
        self.resize(0, 0);
        match &mut self.depth {
            DepthPixels::U16(v) => v.clear(),
            DepthPixels::F32(v) => v.clear(),
        }
        self.clear_colour();
        self.pose = None;
        self.time = Timestamp::ZERO;
        self.sequence = 0;
        self.notes.clear();
    }

    fn resize(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.clear_confidence();
    }

    /// Makes depth `u16` of this size, all holes, and lends it for writing. Confidence is forgotten.
    pub fn depth_u16_mut(&mut self, width: usize, height: usize) -> &mut [u16] {
        self.resize(width, height);
        if !matches!(self.depth, DepthPixels::U16(_)) {
            self.depth = DepthPixels::U16(Vec::new());
        }
        match &mut self.depth {
            DepthPixels::U16(v) => {
                v.clear();
                v.resize(width * height, u16::HOLE);
                v
            }
            DepthPixels::F32(_) => &mut [],
        }
    }

    /// Makes depth `f32` of this size, all holes, and lends it for writing. Confidence is forgotten.
    pub fn depth_f32_mut(&mut self, width: usize, height: usize) -> &mut [f32] {
        self.resize(width, height);
        if !matches!(self.depth, DepthPixels::F32(_)) {
            self.depth = DepthPixels::F32(Vec::new());
        }
        match &mut self.depth {
            DepthPixels::F32(v) => {
                v.clear();
                v.resize(width * height, f32::HOLE);
                v
            }
            DepthPixels::U16(_) => &mut [],
        }
    }

    /// Gives the frame confidence of the depth image's size, all 0, and lends it for writing: 0 (not at all) to 255 (certain).
    pub fn confidence_mut(&mut self) -> &mut [u8] {
        self.has_confidence = true;
        self.confidence.clear();
        self.confidence.resize(self.width * self.height, 0);
        &mut self.confidence
    }

    /// [`Self::depth_u16_mut`] and [`Self::confidence_mut`] at once, for sensors that give both in one value.
    pub fn depth_u16_and_confidence_mut(&mut self, width: usize, height: usize) -> (&mut [u16], &mut [u8]) {
        self.depth_u16_mut(width, height);
        self.confidence_mut();
        match &mut self.depth {
            DepthPixels::U16(v) => (v, &mut self.confidence),
            DepthPixels::F32(_) => (&mut [], &mut []),
        }
    }

    /// Turns readings outside `limits` into holes; returns how many.
    pub fn apply_limits(&mut self, limits: Limits) -> usize {
        let (w, h) = self.size();
        let sure = if self.has_confidence { ImageView::new(&self.confidence, w, h).ok() } else { None };
        let removed = match &mut self.depth {
            DepthPixels::U16(v) => {
                ImageViewMut::new(v, w, h).map(|mut v| apply_limits(&mut v, self.unit, sure, limits))
            }
            DepthPixels::F32(v) => {
                ImageViewMut::new(v, w, h).map(|mut v| apply_limits(&mut v, self.unit, sure, limits))
            }
        };
        removed.unwrap_or(0)
    }

    /// Removes the lens: depth, confidence, and colour of depth's size (which is taken to be registered to it) are seen through
    /// the pinhole of `camera` afterwards, which becomes [`Self::intrinsics`]. Nothing is interpolated. Copies each image once, into memory that the frame keeps.
    pub fn straighten(&mut self, camera: &Camera) {
        self.intrinsics = camera.intrinsics;
        if camera.distortion.is_none() {
            return;
        }
        let (w, h) = self.size();
        match &mut self.depth {
            DepthPixels::U16(v) => straighten(v, &mut self.spare.u16, (w, h), camera, u16::HOLE),
            DepthPixels::F32(v) => straighten(v, &mut self.spare.f32, (w, h), camera, f32::HOLE),
        }
        if self.has_confidence {
            straighten(&mut self.confidence, &mut self.spare.u8, (w, h), camera, 0);
        }
        let c = &mut self.colour;
        if c.present && (c.width, c.height) == (w, h) {
            straighten(&mut c.pixels, &mut self.spare.rgb, (w, h), camera, [0; 3]);
        }
    }

    /// The frame has no confidence image.
    pub const fn clear_confidence(&mut self) {
        self.has_confidence = false;
    }

    /// Gives the frame an RGB image of any size, all black, and lends it for writing.
    pub fn colour_mut(&mut self, width: usize, height: usize) -> &mut [[u8; 3]] {
        let pixels = &mut self.colour.pixels;
        pixels.clear();
        pixels.resize(width * height, [0; 3]);
        (self.colour.width, self.colour.height, self.colour.present) = (width, height, width * height > 0);
        pixels
    }

    /// Gives the frame a colour image of the depth image's size, of which each pixel is what `colour` says of the depth pixel's column, row and
    /// depth in metres; pixels without a reading are black. How a source sees another camera's colour from the depth camera's place.
    pub fn colour_of_points(&mut self, mut colour: impl FnMut(f32, f32, f32) -> [u8; 3]) {
        let (width, height, unit) = (self.width, self.height, self.unit);
        self.colour_mut(width, height);
        if width == 0 {
            return;
        }
        let rows = self.colour.pixels.chunks_mut(width).enumerate();
        match &self.depth {
            DepthPixels::U16(v) => paint(rows.zip(v.chunks(width)), unit, &mut colour),
            DepthPixels::F32(v) => paint(rows.zip(v.chunks(width)), unit, &mut colour),
        }
    }

    /// The frame has no colour image.
    pub const fn clear_colour(&mut self) {
        self.colour.present = false;
    }

    /// Width and height of the depth image.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The depth values.
    #[must_use]
    pub const fn depth(&self) -> &DepthPixels {
        &self.depth
    }

    /// Confidence, 0 to 255 a pixel, of the depth image's size.
    #[must_use]
    pub fn confidence(&self) -> Option<ImageView<'_, u8>> {
        if self.has_confidence { ImageView::new(&self.confidence, self.width, self.height).ok() } else { None }
    }

    /// The RGB image.
    #[must_use]
    pub fn colour(&self) -> Option<ImageView<'_, [u8; 3]>> {
        let c = &self.colour;
        if c.present { ImageView::new(&c.pixels, c.width, c.height).ok() } else { None }
    }

    /// The depth values in metres at a pixel; 0 in holes and outside.
    #[must_use]
    pub fn z(&self, x: usize, y: usize) -> f32 {
        match self.view() {
            AnyFrame::U16(f) => f.z(x, y),
            AnyFrame::F32(f) => f.z(x, y),
        }
    }

    /// How many pixels have a reading.
    #[must_use]
    pub fn valid_pixels(&self) -> usize {
        match &self.depth {
            DepthPixels::U16(v) => v.iter().filter(|z| z.is_valid()).count(),
            DepthPixels::F32(v) => v.iter().filter(|z| z.metres(self.unit) > 0.0).count(),
        }
    }

    fn borrow<'a, D: DepthSample>(&'a self, pixels: &'a [D]) -> DepthFrame<'a, D> {
        // The buffers are sized by this type alone, so the views fit; an image of no pixels is what could not be otherwise.
        let depth = ImageView::new(pixels, self.width, self.height).unwrap_or(ImageView::EMPTY);
        let mut frame = DepthFrame::new(depth, self.unit, self.intrinsics).with_time(self.time, self.sequence);
        if let Some(confidence) = self.confidence() {
            frame = frame.with_confidence(confidence).unwrap_or(frame);
        }
        if let Some(colour) = self.colour() {
            frame = frame.with_colour(colour).unwrap_or(frame);
        }
        match self.pose {
            Some(pose) => frame.with_pose(pose),
            None => frame,
        }
    }

    /// The frame as the core sees it, in its own number type.
    #[must_use]
    pub fn view(&self) -> AnyFrame<'_> {
        match &self.depth {
            DepthPixels::U16(v) => AnyFrame::U16(self.borrow(v)),
            DepthPixels::F32(v) => AnyFrame::F32(self.borrow(v)),
        }
    }

    /// The frame when its depth is `u16`.
    #[must_use]
    pub fn view_u16(&self) -> Option<DepthFrame<'_, u16>> {
        match self.view() {
            AnyFrame::U16(frame) => Some(frame),
            AnyFrame::F32(_) => None,
        }
    }

    /// The frame when its depth is `f32`.
    #[must_use]
    pub fn view_f32(&self) -> Option<DepthFrame<'_, f32>> {
        match self.view() {
            AnyFrame::F32(frame) => Some(frame),
            AnyFrame::U16(_) => None,
        }
    }

    /// Runs generic code on the frame.
    pub fn visit<V: FrameVisitor>(&self, visitor: V) -> V::Output {
        match self.view() {
            AnyFrame::U16(frame) => visitor.visit(&frame),
            AnyFrame::F32(frame) => visitor.visit(&frame),
        }
    }
}

/// A borrowed frame of either number type.
#[derive(Debug, Clone, Copy)]
pub enum AnyFrame<'a> {
    /// Depth in `u16` steps.
    U16(DepthFrame<'a, u16>),
    /// Depth in `f32`.
    F32(DepthFrame<'a, f32>),
}

/// A piece of code that takes a frame of any number type: a generic closure, which Rust has no other form for.
///
/// ```
/// use isobath::sensing::{depth::DepthSample, frame::DepthFrame};
/// use isobath_source::{FrameVisitor, OwnedFrame};
/// struct Nearest;
/// impl FrameVisitor for Nearest {
///     type Output = Option<f32>;
///     fn visit<D: DepthSample>(self, frame: &DepthFrame<'_, D>) -> Option<f32> {
///         let z = frame.depth().rows().flatten().map(|v| v.metres(frame.unit()));
///         z.filter(|&z| z > 0.0).min_by(f32::total_cmp)
///     }
/// }
/// let mut frame = OwnedFrame::new();
/// frame.depth_f32_mut(2, 1).copy_from_slice(&[2000.0, f32::NAN]); // millimetres, the default unit
/// assert_eq!(frame.visit(Nearest), Some(2.0));
/// ```
pub trait FrameVisitor {
    /// What it answers.
    type Output;

    /// Runs on the frame.
    fn visit<D: DepthSample>(self, frame: &DepthFrame<'_, D>) -> Self::Output;
}

/// Runs one expression on an [`OwnedFrame`], compiled once for `u16` depth and once for `f32`: `with_frame!(owned, |f| answer(f))`,
/// where `f` is a `&DepthFrame<'_, _>`. Both must give the same type.
#[macro_export]
macro_rules! with_frame {
    ($owned:expr, |$frame:ident| $body:expr) => {
        match $owned.view() {
            $crate::AnyFrame::U16(frame) => {
                let $frame = &frame;
                $body
            }
            $crate::AnyFrame::F32(frame) => {
                let $frame = &frame;
                $body
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_never_disagree_and_memory_is_kept() {
        let mut frame = OwnedFrame::new();
        frame.depth_u16_mut(4, 2).fill(1000);
        frame.confidence_mut().fill(9);
        frame.colour_mut(8, 8).fill([1, 2, 3]);
        frame.pose = Some(Pose::IDENTITY);
        let view = frame.view_u16().unwrap();
        assert_eq!(view.confidence().unwrap().size(), (4, 2));
        assert_eq!(view.colour_at(3, 1), Some([1, 2, 3]));
        assert!(view.pose().is_some() && frame.view_f32().is_none());
        assert_eq!(frame.valid_pixels(), 8);

        let DepthPixels::U16(before) = frame.depth() else { panic!("u16 was written") };
        let before = before.as_ptr();
        frame.clear();
        assert_eq!(frame.view_u16().unwrap().size(), (0, 0));
        frame.depth_u16_mut(2, 2).fill(5);
        assert!(frame.confidence().is_none() && frame.colour().is_none() && frame.pose.is_none());
        let DepthPixels::U16(after) = frame.depth() else { panic!("u16 was written") };
        assert_eq!(before, after.as_ptr(), "a smaller image fits the old memory");

        frame.depth_f32_mut(1, 1)[0] = 2.0;
        frame.unit = DepthUnit::METRE;
        assert_eq!(frame.view_f32().unwrap().z(0, 0), 2.0);
        assert_eq!(crate::with_frame!(frame, |f| f.size()), (1, 1));

        frame.depth_u16_mut(2, 2).copy_from_slice(&[1, 0, u16::MAX, 4]);
        frame.colour_of_points(|x, y, z| [x as u8, y as u8, z.round() as u8]);
        let colours: Vec<_> = frame.colour().unwrap().rows().flatten().copied().collect();
        assert_eq!(colours, [[0, 0, 1], [0; 3], [0; 3], [1, 1, 4]]);
    }
}
