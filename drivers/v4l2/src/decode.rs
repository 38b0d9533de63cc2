//! From a buffer's bytes to the depth of a frame: which bits, and what the numbers mean.
//!
//! Depth in 16-bit steps is written straight into the frame, one pass over memory. Packed and disparity forms go through one image of codes, made at
//! the start. What no number tells (the unit, the value that means "nothing") is the profile's or the calibration file's, never a guess.

use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::sensing::depth::confidence::Limits;
use isobath::sensing::depth::decode::format::Format;
use isobath::sensing::depth::decode::{DecodeError, Disparity, depth16, disparity};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath_source::OwnedFrame;

/// What the codes of a depth image are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Meaning {
    /// Steps of a unit along the axis.
    Steps(DepthUnit),
    /// Disparity in pixels; as steps of a unit, or as metres without one.
    Disparity(Disparity, Option<DepthUnit>),
    /// Android's 13 bits of millimetres and 3 of confidence.
    Depth16,
}

/// Decodes the buffers of one stream.
#[derive(Debug)]
pub struct Decoder {
    format: Format,
    size: (usize, usize),
    stride: usize,
    /// What the codes are.
    pub meaning: Meaning,
    /// A code that means "nothing".
    pub nothing: Option<u16>,
    /// Rows at the top without depth.
    pub ignore_rows: usize,
    /// Which readings are believed.
    pub limits: Option<Limits>,
    codes: Vec<u16>,
}

/// Bytes from row to row: what the driver says, but for `INZI`, of which V4L2 counts both planes, and for drivers that say 0.
#[must_use]
pub fn stride(format: Format, width: usize, said: usize) -> usize {
    let row = format.row_bytes(width);
    match format {
        Format::Inzi => row,
        _ if said == 0 => row,
        _ => said,
    }
}

impl Decoder {
    /// For images of this format, size in pixels and stride in bytes.
    #[must_use]
    pub fn new(format: Format, size: (usize, usize), stride: usize, meaning: Meaning) -> Self {
        let codes = match meaning {
            Meaning::Steps(_) => 0,
            _ => size.0 * size.1,
        };
        let nothing = (format == Format::Y10b).then_some(1023);
        Self { format, size, stride, meaning, nothing, ignore_rows: 0, limits: None, codes: vec![0; codes] }
    }

    /// Bytes of a whole image.
    #[must_use]
    pub const fn need(&self) -> usize {
        self.format.image_bytes(self.size.0, self.size.1, self.stride)
    }

    /// Writes the depth (and confidence, where the format has it) of an image.
    ///
    /// # Errors
    /// [`DecodeError`]: too few bytes, or a stride below a row.
    pub fn decode(&mut self, bytes: &[u8], frame: &mut OwnedFrame) -> Result<(), DecodeError> {
        let (width, height) = self.size;
        let misfit = DecodeError::SizeMismatch { input: self.size, output: (0, 0) };
        match self.meaning {
            Meaning::Steps(unit) => {
                frame.unit = unit;
                let out = frame.depth_u16_mut(width, height);
                self.format.codes(bytes, self.stride, &mut view(out, self.size)?)?;
                make_holes(out, self.ignore_rows * width, self.nothing);
            }
            Meaning::Disparity(constants, unit) => {
                self.format.codes(bytes, self.stride, &mut view(&mut self.codes, self.size)?)?;
                make_holes(&mut self.codes, self.ignore_rows * width, self.nothing);
                let codes = ImageView::new(&self.codes, width, height).map_err(|_| misfit)?;
                frame.unit = unit.unwrap_or(DepthUnit::METRE);
                match unit {
                    Some(unit) => {
                        disparity(codes, constants, unit, &mut view(frame.depth_u16_mut(width, height), self.size)?)?
                    }
                    None => {
                        let out = frame.depth_f32_mut(width, height);
                        disparity(codes, constants, DepthUnit::METRE, &mut view(out, self.size)?)?
                    }
                };
            }
            Meaning::Depth16 => {
                self.format.codes(bytes, self.stride, &mut view(&mut self.codes, self.size)?)?;
                make_holes(&mut self.codes, self.ignore_rows * width, self.nothing);
                let codes = ImageView::new(&self.codes, width, height).map_err(|_| misfit)?;
                frame.unit = DepthUnit::MILLIMETRE;
                let (depth, sure) = frame.depth_u16_and_confidence_mut(width, height);
                depth16(codes, &mut view(depth, self.size)?, Some(&mut view(sure, self.size)?))?;
            }
        }
        if let Some(limits) = self.limits {
            frame.apply_limits(limits);
        }
        Ok(())
    }
}

fn view<T>(pixels: &mut [T], size: (usize, usize)) -> Result<ImageViewMut<'_, T>, DecodeError> {
    ImageViewMut::new(pixels, size.0, size.1).map_err(|_| DecodeError::SizeMismatch { input: size, output: (0, 0) })
}

/// Turns the first `skipped` codes, and those that mean nothing, into holes.
fn make_holes(codes: &mut [u16], skipped: usize, nothing: Option<u16>) {
    codes.iter_mut().take(skipped).for_each(|code| *code = u16::HOLE);
    if let Some(nothing) = nothing {
        codes.iter_mut().filter(|code| **code == nothing).for_each(|code| *code = u16::HOLE);
    }
}
