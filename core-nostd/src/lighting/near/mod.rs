//! The near field: the last few views around the object, and what of them is seen from its place (LitAR 4.2.1, 4.4.1).
//!
//! A view is kept as it came, organised: 16-bit depth and a colour for each pixel, 5 bytes a point (16 bits for each axis and a colour would be 9).
//! Seen from the map's place, each view gives one *layer*: the nearest point in every pixel of the finest level, 4 bytes that hold the
//! distance and which pixel of the view it is. A new view is projected once, alone; the others' layers are still good. Layers are merged, coarser levels are
//! minima of the finer ones, and what comes out is one picture with coverage.
//!
//! | file | idea |
//! |---|---|
//! | here | the store: which view goes where, which makes room |
//! | [`view`] | a frame brought to a view's size: confidence, holes, colours |
//! | `project` | a view's points onto its layer |
//! | `merge` | layers and levels into the picture |
//! | `seam` | coverage that fades towards its border |

mod merge;
mod project;
mod seam;
#[cfg(test)]
mod tests;
pub mod view;

use core::fmt;

use super::equirect::MapFrame;
use super::preset::{MOST_VIEWS, Preset, PresetError};
use super::registration::{Registration, RegistrationError};
use crate::ground::image::ImageView;
use crate::sensing::depth::DepthSample;
use crate::sensing::depth::noise::DepthNoise;
use crate::sensing::frame::DepthFrame;
use view::{View, ViewError};

/// What belongs to the near field, and how its points become a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearParams {
    /// Half the side of the boundary, a cube around the map's place along the map's axes, metres. Default 1.
    pub half_side: f32,
    /// Least confidence of a point, 0 to 255; frames without confidence pass. Default 128.
    pub confidence: u8,
    /// A coarser level's point is put before a finer level's only when it is nearer by this part of its distance: it closes gaps through which
    /// the background shows. 0 is the paper's rule, which lets every difference in distance through and so brings all down to the coarsest level's
    /// resolution. Default 0.5.
    pub margin: f32,
    /// Points of a view may be so many pixels of the finest level apart before all of them are needed; where they are closer by a factor of 2 or 4, every second or
    /// fourth will do. Saves up to half of the projection's time; surfaces that the camera sees at a grazing angle may get holes, which coarser levels close.
    /// 0: all points, always. At most 2. Default 0.
    pub thin: f32,
    /// Pixels of the finest level over which coverage fades towards its border; 0 is a hard edge. At most 255. Default 3.
    pub seam: u8,
}

impl Default for NearParams {
    fn default() -> Self {
        Self { half_side: 1.0, confidence: 128, margin: 0.5, thin: 0.0, seam: 3 }
    }
}

impl NearParams {
    /// The paper's rules.
    pub const PAPER: Self = Self { half_side: 1.0, confidence: 128, margin: 0.0, thin: 0.0, seam: 0 };
}

/// The memory of a near field, lent by the caller. Lengths in the words of [`Preset`].
#[derive(Debug, Default)]
pub struct NearMemory<'m> {
    /// `views * view_pixels`.
    pub depth: &'m mut [u16],
    /// `views * view_pixels`.
    pub colour: &'m mut [[u8; 3]],
    /// `views * level_pixels`.
    pub layers: &'m mut [u32],
    /// `level_pixels`.
    pub picture: &'m mut [[u8; 4]],
    /// `strip`.
    pub strip: &'m mut [u32],
}

/// The memory of a near field, owned: for statics, with the lengths of [`NearMemory`] as capacities.
#[derive(Debug)]
pub struct NearStorage<const POINTS: usize, const LAYERS: usize, const PICTURE: usize, const STRIP: usize> {
    depth: [u16; POINTS],
    colour: [[u8; 3]; POINTS],
    layers: [u32; LAYERS],
    picture: [[u8; 4]; PICTURE],
    strip: [u32; STRIP],
}

impl<const POINTS: usize, const LAYERS: usize, const PICTURE: usize, const STRIP: usize> Default
    for NearStorage<POINTS, LAYERS, PICTURE, STRIP>
{
    fn default() -> Self {
        Self::new()
    }
}

impl<const POINTS: usize, const LAYERS: usize, const PICTURE: usize, const STRIP: usize>
    NearStorage<POINTS, LAYERS, PICTURE, STRIP>
{
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            depth: [0; POINTS],
            colour: [[0; 3]; POINTS],
            layers: [0; LAYERS],
            picture: [[0; 4]; PICTURE],
            strip: [0; STRIP],
        }
    }

    /// Lent to a near field.
    pub const fn lend(&mut self) -> NearMemory<'_> {
        NearMemory {
            depth: &mut self.depth,
            colour: &mut self.colour,
            layers: &mut self.layers,
            picture: &mut self.picture,
            strip: &mut self.strip,
        }
    }
}

/// Why there is no near field, or a view was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NearError {
    /// The preset's sizes don't fit together.
    Preset(PresetError),
    /// A slice of [`NearMemory`] is too short.
    Memory {
        /// Its name.
        name: &'static str,
        /// Elements needed.
        needed: usize,
        /// Elements lent.
        got: usize,
    },
    /// The frame is no view.
    View(ViewError),
}

impl fmt::Display for NearError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Preset(e) => e.fmt(f),
            Self::Memory { name, needed, got } => {
                write!(f, "near field: {name} has {got} elements, the preset needs {needed}")
            }
            Self::View(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for NearError {}

impl From<ViewError> for NearError {
    fn from(e: ViewError) -> Self {
        Self::View(e)
    }
}

/// What became of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearReport {
    /// Where it lies, from 0.
    pub slot: usize,
    /// The view that made room, by its id.
    pub replaced: Option<u32>,
    /// Pixels with a confident depth.
    pub points: usize,
    /// Pixels with depth, but less confidence than asked for.
    pub unsure: usize,
    /// Points within the boundary, of those that were looked at.
    pub inside: usize,
    /// Pixels that were not looked at when the view was projected: their neighbours are close enough ([`NearParams::thin`]).
    pub skipped: usize,
    /// View pixels per frame pixel: below 1 where the frame was brought down, as it does not fit.
    pub scale: f32,
}

/// The last few views, and the picture they make.
#[derive(Debug)]
pub struct NearField<'m> {
    preset: Preset,
    params: NearParams,
    memory: NearMemory<'m>,
    views: [Option<View>; MOST_VIEWS],
    /// Of each view's layer, where it has points: first and last index.
    spans: [(usize, usize); MOST_VIEWS],
    /// Rows of the picture that the last merge wrote.
    drawn: (usize, usize),
    ticks: u32,
}

/// Nothing of a layer.
const NOWHERE: (usize, usize) = (usize::MAX, 0);

impl<'m> NearField<'m> {
    /// Without views. Parameters out of range take their nearest bound.
    ///
    /// # Errors
    /// [`NearError`] when the preset can't be or the memory is short.
    pub fn new(preset: Preset, params: NearParams, memory: NearMemory<'m>) -> Result<Self, NearError> {
        preset.check().map_err(NearError::Preset)?;
        let points = preset.views * preset.view_pixels();
        for (name, got, needed) in [
            ("depth", memory.depth.len(), points),
            ("colour", memory.colour.len(), points),
            ("layers", memory.layers.len(), preset.views * preset.level_pixels()),
            ("picture", memory.picture.len(), preset.level_pixels()),
            ("strip", memory.strip.len(), preset.strip()),
        ] {
            if got < needed {
                return Err(NearError::Memory { name, needed, got });
            }
        }
        let positive = |v: f32, otherwise: f32| if v > 0.0 && v < 1e6 { v } else { otherwise };
        let params = NearParams {
            half_side: positive(params.half_side, 1.0),
            margin: positive(params.margin, 0.0).min(1e3),
            thin: positive(params.thin, 0.0).min(2.0),
            ..params
        };
        memory.picture.fill([0; 4]);
        memory.layers.fill(project::EMPTY);
        Ok(Self {
            preset,
            params,
            memory,
            views: [None; MOST_VIEWS],
            spans: [NOWHERE; MOST_VIEWS],
            drawn: (0, 0),
            ticks: 0,
        })
    }

    /// Its sizes.
    #[must_use]
    pub const fn preset(&self) -> &Preset {
        &self.preset
    }

    /// Its rules.
    #[must_use]
    pub const fn params(&self) -> &NearParams {
        &self.params
    }

    /// Views there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.views.iter().flatten().count()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A view, by its slot.
    #[must_use]
    pub fn view(&self, slot: usize) -> Option<&View> {
        self.views.get(slot)?.as_ref()
    }

    /// A view's depth image, as kept.
    #[must_use]
    pub fn depth(&self, slot: usize) -> Option<ImageView<'_, u16>> {
        let view = self.view(slot)?;
        let n = self.preset.view_pixels();
        ImageView::new(self.memory.depth.get(slot * n..)?, view.width, view.height).ok()
    }

    /// A view's colours, as kept.
    #[must_use]
    pub fn colour(&self, slot: usize) -> Option<ImageView<'_, [u8; 3]>> {
        let view = self.view(slot)?;
        let n = self.preset.view_pixels();
        ImageView::new(self.memory.colour.get(slot * n..)?, view.width, view.height).ok()
    }

    /// A view as a frame of its own, with colour and pose: for [registration](super::registration), or to look at.
    #[must_use]
    pub fn frame(&self, slot: usize) -> Option<DepthFrame<'_, u16>> {
        let view = self.view(slot)?;
        let frame = DepthFrame::new(self.depth(slot)?, view.unit, view.intrinsics).with_pose(view.pose);
        Some(frame.with_colour(self.colour(slot)?).unwrap_or(frame))
    }

    /// Gives the views to a registration, each in its slot, as they are now (`V` is at least the preset's views).
    ///
    /// # Errors
    /// Those of [`Registration::set`].
    pub fn prepare<const V: usize>(
        &self,
        registration: &mut Registration<'_, V>,
        noise: &DepthNoise,
    ) -> Result<(), RegistrationError> {
        for slot in 0..self.preset.views {
            match self.frame(slot) {
                Some(frame) => registration.set(slot, &frame, noise)?,
                None => registration.clear(slot),
            }
        }
        Ok(())
    }

    /// Takes a frame: in place of the view of the same id, else into an empty slot, else in place of the view that was observed longest ago. The
    /// picture follows with [`Self::merge`].
    ///
    /// # Errors
    /// [`NearError::View`] for a frame without colour or pose; nothing is changed.
    pub fn insert<D: DepthSample>(
        &mut self,
        frame: &DepthFrame<'_, D>,
        id: u32,
        map: &MapFrame,
    ) -> Result<NearReport, NearError> {
        let mut view = View::of(frame, id, self.preset.view)?;
        self.ticks += 1;
        view.tick = self.ticks;
        let views = self.views.get(..self.preset.views).unwrap_or_default();
        let same = views.iter().position(|v| v.is_some_and(|v| v.id == id));
        let slot = same.or_else(|| views.iter().position(Option::is_none));
        let oldest =
            || (0..views.len()).min_by_key(|&i| views.get(i).and_then(|v| v.map(|v| v.tick))).unwrap_or_default();
        let slot = slot.unwrap_or_else(oldest);
        let replaced = self.view(slot).map(|v| v.id);
        let n = self.preset.view_pixels();
        let mut report = NearReport { slot, replaced, points: 0, unsure: 0, inside: 0, skipped: 0, scale: view.scale };
        let pixels = slot * n..slot * n + view.width * view.height;
        if let Some(depth) = self.memory.depth.get_mut(pixels.clone())
            && let Some(colour) = self.memory.colour.get_mut(pixels)
        {
            (report.points, report.unsure) = view.take(frame, self.params.confidence, depth, colour);
        }
        if let Some(place) = self.views.get_mut(slot) {
            *place = Some(view);
        }
        (report.inside, report.skipped) = self.project(slot, map);
        Ok(report)
    }

    /// A view's pose corrected (by registration), and its layer with it. False without such a view.
    pub fn correct(&mut self, slot: usize, pose: crate::sensing::camera::Pose, map: &MapFrame) -> bool {
        let Some(view) = self.views.get_mut(slot).and_then(Option::as_mut) else { return false };
        view.pose = pose;
        self.project(slot, map);
        true
    }

    /// All layers anew: when the map has moved.
    pub fn project_all(&mut self, map: &MapFrame) {
        for slot in 0..self.preset.views {
            self.project(slot, map);
        }
    }

    /// Forgets a view. False without one.
    pub fn remove(&mut self, slot: usize) -> bool {
        let was = self.views.get_mut(slot).and_then(Option::take).is_some();
        self.clear(slot);
        was
    }

    fn layer(&mut self, slot: usize) -> &mut [u32] {
        let n = self.preset.level_pixels();
        self.memory.layers.get_mut(slot * n..(slot + 1) * n).unwrap_or_default()
    }

    fn clear(&mut self, slot: usize) {
        let span = self.spans.get_mut(slot).map(|s| core::mem::replace(s, NOWHERE));
        if let Some((first, last)) = span
            && let Some(layer) = self.layer(slot).get_mut(first..=last)
        {
            layer.fill(project::EMPTY);
        }
    }

    /// Bits of a layer's value that say which pixel of the view it is.
    const fn pixel_bits(&self) -> u32 {
        usize::BITS - (self.preset.view_pixels() - 1).leading_zeros()
    }

    /// Projects a view onto its layer; the points inside the boundary, and those not looked at.
    fn project(&mut self, slot: usize, map: &MapFrame) -> (usize, usize) {
        self.clear(slot);
        let Some(view) = self.view(slot).copied() else { return (0, 0) };
        let n = self.preset.view_pixels();
        let layer = project::Layer {
            size: self.preset.finest(),
            half_side: self.params.half_side,
            pixel_bits: self.pixel_bits(),
            thin: self.params.thin,
        };
        let depth = self.memory.depth.get(slot * n..slot * n + view.width * view.height).unwrap_or_default();
        let m = self.preset.level_pixels();
        let cells = self.memory.layers.get_mut(slot * m..(slot + 1) * m).unwrap_or_default();
        let done = layer.project(&view, depth, map, cells);
        if let Some(place) = self.spans.get_mut(slot) {
            *place = done.span;
        }
        (done.inside, done.skipped)
    }

    /// The picture: sRGB as the cameras saw it, and coverage (0 none, 255 whole), at the finest level's size. As of the last [`Self::merge`].
    #[must_use]
    pub fn picture(&self) -> ImageView<'_, [u8; 4]> {
        let (width, height) = self.preset.finest();
        ImageView::new(self.memory.picture, width, height).unwrap_or(ImageView::EMPTY)
    }
}
