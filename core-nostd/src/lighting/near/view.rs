//! A frame brought to a view's size.
//!
//! Depth decides where a view looks: its pixels are the depth image's, or, where colour is finer and there is room, finer ones.
//! Larger frames are brought down: depth by the nearest pixel, so that nothing is put between two surfaces; colour by the mean, in linear light, of what the pixel
//! covers. Between the pixels of a coarse depth image depth is bilinear where the four around agree to 3 %, else the nearest.

use core::fmt;

use glam::Vec2;

use crate::ground::colour::Colour;
use crate::ground::image::ImageView;
use crate::sensing::camera::crop::CropMap;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::{DepthSample, DepthUnit};
use crate::sensing::frame::DepthFrame;

/// One view: where it was taken, and how its pixels are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// The caller's name for it.
    pub id: u32,
    /// Camera-to-world.
    pub pose: Pose,
    /// Of its own pixels.
    pub intrinsics: Intrinsics,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Metres per step of its depth.
    pub unit: DepthUnit,
    /// Its pixels per depth pixel of the frame.
    pub scale: f32,
    /// When it came, in views.
    pub(super) tick: u32,
}

/// Why a frame is no view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ViewError {
    /// The frame has no colour image.
    NoColour,
    /// The frame has no pose.
    NoPose,
    /// The frame's pixels, brought to the view's size, would have no usable intrinsics.
    Intrinsics,
}

impl fmt::Display for ViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoColour => write!(f, "a near view needs colour; the frame has depth alone"),
            Self::NoPose => write!(f, "a near view needs the camera's pose"),
            Self::Intrinsics => {
                write!(f, "the frame can't be brought to the view's size: its focal length would be out of bounds")
            }
        }
    }
}

impl core::error::Error for ViewError {}

impl View {
    /// How a frame is read into at most `size` pixels.
    pub(super) fn of<D: DepthSample>(
        frame: &DepthFrame<'_, D>,
        id: u32,
        size: (usize, usize),
    ) -> Result<Self, ViewError> {
        let (_, crop) = frame.colour().ok_or(ViewError::NoColour)?;
        let pose = frame.pose().ok_or(ViewError::NoPose)?;
        let (width, height) = frame.size();
        let finer = if crop.scale() > 0.0 { (1.0 / crop.scale()).max(1.0) } else { 1.0 };
        let fit = (size.0 as f32 / width.max(1) as f32).min(size.1 as f32 / height.max(1) as f32);
        let scale = fit.min(finer);
        let brought = |n: usize, most: usize| ((n as f32 * scale + 0.5) as usize).clamp(1, most.max(1));
        Ok(Self {
            id,
            pose,
            intrinsics: frame.intrinsics().resized(scale, scale).map_err(|_| ViewError::Intrinsics)?,
            width: brought(width, size.0),
            height: brought(height, size.1),
            unit: if D::ROUNDING > 0.0 { frame.unit() } else { DepthUnit::TENTH_MILLIMETRE },
            scale,
            tick: 0,
        })
    }

    /// Reads the frame. How many pixels have a confident depth, and how many an unsure one.
    pub(super) fn take<D: DepthSample>(
        &self,
        frame: &DepthFrame<'_, D>,
        least: u8,
        depth: &mut [u16],
        colour: &mut [[u8; 3]],
    ) -> (usize, usize) {
        let Some((source, crop)) = frame.colour() else { return (0, 0) };
        let copied = self.scale == 1.0;
        let (mut points, mut unsure) = (0, 0);
        let width = self.width.max(1);
        let rows = depth.chunks_mut(width).zip(colour.chunks_mut(width));
        for (y, (depth, colour)) in rows.enumerate() {
            if copied {
                D::row_in_steps(frame.depth().row(y), frame.unit(), self.unit, depth);
            } else {
                for (x, to) in depth.iter_mut().enumerate() {
                    *to = depth_at(frame, self.in_frame(x, y)).in_steps(frame.unit(), self.unit);
                }
            }
            if let Some(confidence) = frame.confidence() {
                for (x, to) in depth.iter_mut().enumerate() {
                    let p = self.in_frame(x, y) + 0.5;
                    if *to != 0 && confidence.get(p.x as usize, p.y as usize).unwrap_or_default() < least {
                        *to = 0;
                        unsure += 1;
                    }
                }
            }
            points += depth.iter().filter(|d| **d != 0).count();
            let row = source.row(y);
            if copied && source.size() == frame.size() && row.len() == colour.len() {
                colour.copy_from_slice(row);
            } else {
                for (x, to) in colour.iter_mut().enumerate() {
                    *to = self.colour_of(&source, &crop, x, y);
                }
            }
        }
        (points, unsure)
    }

    /// A pixel's place in the frame's depth image.
    fn in_frame(&self, x: usize, y: usize) -> Vec2 {
        (Vec2::new(x as f32, y as f32) + 0.5) / self.scale - 0.5
    }

    /// Mean colour of what a pixel covers.
    fn colour_of(&self, source: &ImageView<'_, [u8; 3]>, crop: &CropMap, x: usize, y: usize) -> [u8; 3] {
        // Colour pixels along the side of one of ours.
        let side = 1.0 / (crop.scale() * self.scale);
        let Some(middle) = crop.colour_from_depth(self.in_frame(x, y)) else { return [0; 3] };
        let taps = ((side + 0.25) as usize).clamp(1, 8);
        if taps == 1 {
            let p = middle + 0.5;
            return source.get(p.x as usize, p.y as usize).unwrap_or_default();
        }
        let corner = middle + 0.5 - side * 0.5;
        let (mut sum, mut n) = ([0.0; 3], 0.0_f32);
        for j in 0..taps {
            for i in 0..taps {
                let p = corner + (Vec2::new(i as f32, j as f32) + 0.5) * (side / taps as f32);
                if let Some(pixel) = source.get(p.x as usize, p.y as usize) {
                    n += 1.0;
                    for (sum, v) in sum.iter_mut().zip(pixel.linear()) {
                        *sum += v;
                    }
                }
            }
        }
        <[u8; 3]>::of_linear(sum.map(|s| s / n.max(1.0)))
    }
}

/// Depth between pixels: bilinear where the four around agree, else the nearest's.
fn depth_at<D: DepthSample>(frame: &DepthFrame<'_, D>, p: Vec2) -> D {
    let nearest = (p + 0.5).max(Vec2::ZERO);
    let own = frame.depth().get(nearest.x as usize, nearest.y as usize).unwrap_or(D::HOLE);
    let (x0, y0) = (crate::ground::math::floor(p.x), crate::ground::math::floor(p.y));
    if x0 < 0.0 || y0 < 0.0 || !own.is_valid() {
        return own;
    }
    let t = p - Vec2::new(x0, y0);
    // On a pixel, as when the frame is brought down by a whole number: that pixel.
    if t.x < 1e-3 && t.y < 1e-3 {
        return own;
    }
    let at = |i, j| frame.z(x0 as usize + i, y0 as usize + j);
    let (a, b, c, d) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
    let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
    if !(low > 0.0 && high < 1.03 * low) {
        return own;
    }
    let (top, bottom) = (a + t.x * (b - a), c + t.x * (d - c));
    D::from_metres(top + t.y * (bottom - top), frame.unit())
}
