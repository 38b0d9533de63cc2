//! Dense normals for real sensors: planes as wide as the noise asks for, that stop at edges and holes.
//!
//! On a noisy sensor a 3 x 3 normal is a coin toss (57 degrees off at 1.5 m on a Kinect), and a wider square window blurs
//! edges and costs its area. This estimator fits inverse depth, whose noise a structured-light sensor makes the same
//! everywhere, in three steps:
//!
//! 1. *Blocks* (`blocks`): least-squares planes of 4 x 4, 8 x 8 or 16 x 16 pixels from running sums. A block whose residual is more
//!    than the noise explains holds an edge and is not used.
//! 2. *Windows* (`windows`): each block joins those of its eight neighbours whose planes agree with its own within
//!    the noise (in value half way between them, and in slope): up to 3 x 3 blocks, cut at edges, creases and holes.
//! 3. *Pixels* (`pixels`): a pixel takes its block's window when it lies on that plane within the noise, else the best of
//!    the neighbours': pixels beside an edge go to their own side, whichever block they fall in. Slopes run smoothly from
//!    window to window of the same surface. What lies on none (thin things) is fitted on its own (`lone`).
//!
//! Block sums cost the same whatever the block, so the window's width is free. Each normal comes with its predicted error.
//! Depth without noise needs none of this: there the automatic choice is the exact method's cross.
//!
//! Memory: [`scratch_len`] floats, a few rows (51 kB at 640 pixels of width, 15 kB at 160, whatever the block size). Cost and error:
//! see the README's figures and `cargo bench`.

mod blocks;
mod cross;
mod lone;
mod pixels;
#[cfg(test)]
mod tests;
mod windows;

use super::dense::DenseError;
use crate::ground::lanes::{LANES, vectorised};
use crate::ground::math;
use crate::sensing::depth::DepthSample;
use crate::sensing::depth::noise::DepthNoise;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use blocks::{BLOCK_FIELDS, BlockRow};
use pixels::{BEND_FIELDS, Bends};
use windows::{WINDOW_FIELDS, WindowRow};

/// Side of the blocks, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum BlockSize {
    /// From the noise at the image's mean depth: the smallest that keeps the predicted error low (under 0.1 degrees for
    /// [`Self::One`], 1 for [`Self::Four`], 4 for [`Self::Eight`]).
    #[default]
    Auto,
    /// No blocks: the cross of five pixels of the exact method, for depth without noise.
    One,
    /// 4 x 4: windows up to 12 pixels, for millimetre sensors.
    Four,
    /// 8 x 8: windows up to 24 pixels, for structured light and stereo.
    Eight,
    /// 16 x 16: windows up to 48 pixels, for coarse or far sensing.
    Sixteen,
}

/// Parameters of the adaptive estimator.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AdaptiveParams {
    /// The sensor's noise; rounding to the unit is added for integer depth. Default [`DepthNoise::KINECT`].
    pub noise: DepthNoise,
    /// Block size. Default automatic.
    pub block: BlockSize,
}

/// One row of normals in the camera frame; NaN where there is none.
#[derive(Debug, Clone, Copy)]
pub struct AdaptiveRow<'a> {
    /// Component to the right.
    pub x: &'a [f32],
    /// Component down.
    pub y: &'a [f32],
    /// Component forward.
    pub z: &'a [f32],
    /// Predicted RMS error of the direction, radians.
    pub sigma: &'a [f32],
}

/// Floats of scratch that [`rows`] needs for images of this width, whatever the block size.
///
/// ```
/// use isobath::localized::normals::adaptive::scratch_len;
/// assert_eq!([160, 640].map(|width| scratch_len(width) * 4), [14_688, 51_168]); // bytes
/// ```
#[must_use]
pub const fn scratch_len(width: usize) -> usize {
    // The 4 x 4 case needs the most.
    scratch_for(width, 4)
}

const ROWS: usize = 3;
const OUTPUTS: usize = 4;

/// Cells of a row of blocks: one empty at either end, and room for the last vector.
const fn cells(across: usize) -> usize {
    across.saturating_add(2 + LANES)
}

const fn scratch_for(width: usize, block: usize) -> usize {
    let blocks = cells(width.div_ceil(block));
    let padded = width.saturating_add(LANES);
    let fields = 1 + BEND_FIELDS + ROWS * (BLOCK_FIELDS + WINDOW_FIELDS);
    padded.saturating_mul(OUTPUTS).saturating_add(blocks.saturating_mul(fields))
}

/// Estimates every normal and hands each row, top to bottom, to `each(y, row)`. Returns pixels done (with a reading) and
/// skipped (without).
///
/// # Errors
/// [`DenseError::Scratch`].
///
/// ```
/// use isobath::localized::normals::adaptive::{rows, scratch_len, AdaptiveParams};
/// use isobath::sensing::{camera::Intrinsics, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// let wall = DepthArray::<160, 120>::filled(2000);
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let frame = DepthFrame::new(wall.view(), DepthUnit::MILLIMETRE, k);
/// let mut scratch = [0.0; scratch_len(160)];
/// rows(&frame, &AdaptiveParams::default(), &mut scratch, |_, row| {
///     assert!(row.z.iter().all(|&z| (z + 1.0).abs() < 1e-6)); // faces the camera
/// })?;
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
pub fn rows<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    params: &AdaptiveParams,
    scratch: &mut [f32],
    each: impl FnMut(usize, AdaptiveRow<'_>),
) -> Result<Work, DenseError> {
    let needed = scratch_len(frame.size().0);
    let got = scratch.len();
    let Some(scratch) = scratch.get_mut(..needed) else {
        return Err(DenseError::Scratch { needed, got });
    };
    Ok(match resolve(frame, params) {
        BlockSize::One => cross::rows(frame, &params.noise, scratch, each)?,
        BlockSize::Four => run::<D, 4>(frame, &params.noise, scratch, each),
        BlockSize::Auto | BlockSize::Eight => run::<D, 8>(frame, &params.noise, scratch, each),
        BlockSize::Sixteen => run::<D, 16>(frame, &params.noise, scratch, each),
    })
}

/// The block size that [`BlockSize::Auto`] stands for on this frame.
#[must_use]
pub fn resolve<D: DepthSample>(frame: &DepthFrame<'_, D>, params: &AdaptiveParams) -> BlockSize {
    if params.block != BlockSize::Auto {
        return params.block;
    }
    // Mean depth of a coarse grid of readings.
    let (width, height) = frame.size();
    let (mut sum, mut n) = (0.0, 0.0);
    for gy in 0..8 {
        for gx in 0..8 {
            let z = frame.z((2 * gx + 1) * width / 16, (2 * gy + 1) * height / 16);
            if z > 0.0 {
                sum += z;
                n += 1.0;
            }
        }
    }
    if n == 0.0 {
        return BlockSize::Eight;
    }
    // A 3 x 3 window of blocks of side b holds n = 9 b² pixels of coordinate variance (9 b² - 1) / 12: against a single pixel's,
    // its slope's standard deviation is divided by the root of n times that.
    let cross = cross::predict(&params.noise, frame, sum / n);
    let error = |b: f32| cross / math::sqrt(9.0 * b * b * (9.0 * b * b - 1.0) / 12.0);
    const ONE_DEGREE: f32 = 0.017_45;
    if cross < 0.1 * ONE_DEGREE {
        BlockSize::One
    } else if error(4.0) < ONE_DEGREE {
        BlockSize::Four
    } else if error(8.0) < 4.0 * ONE_DEGREE {
        BlockSize::Eight
    } else {
        BlockSize::Sixteen
    }
}

/// What every step needs to know of the frame.
struct Context<'f, 'd, D: DepthSample> {
    frame: &'f DepthFrame<'d, D>,
    noise: DepthNoise,
    width: usize,
    height: usize,
    /// Blocks across.
    across: usize,
}

/// Block row k is summed, then the windows of row k - 1 are joined, then the pixels of row k - 2 are answered.
fn run<D: DepthSample, const B: usize>(
    frame: &DepthFrame<'_, D>,
    noise: &DepthNoise,
    scratch: &mut [f32],
    mut each: impl FnMut(usize, AdaptiveRow<'_>),
) -> Work {
    let (width, height) = frame.size();
    let across = width.div_ceil(B);
    let context = Context { frame, noise: *noise, width, height, across };
    let down = height.div_ceil(B);
    let padded = width.next_multiple_of(LANES);
    let (outputs, rest) = scratch.split_at_mut_checked(padded * OUTPUTS).unwrap_or_default();
    rest.fill(0.0);
    let cells = cells(across);
    let (references, rest) = rest.split_at_mut_checked(cells).unwrap_or_default();
    let (bends, rest) = rest.split_at_mut_checked(cells * BEND_FIELDS).unwrap_or_default();
    let mut bends = Bends::new(bends, cells);
    let (block_cells, window_cells) = rest.split_at_mut_checked(cells * ROWS * BLOCK_FIELDS).unwrap_or_default();
    let mut block_chunks = block_cells.chunks_mut((cells * BLOCK_FIELDS).max(1));
    let mut window_chunks = window_cells.chunks_mut((cells * WINDOW_FIELDS).max(1));
    let mut block_ring: [BlockRow<'_>; ROWS] =
        core::array::from_fn(|_| BlockRow::new(block_chunks.next().unwrap_or_default(), cells));
    let mut window_ring: [WindowRow<'_>; ROWS] =
        core::array::from_fn(|_| WindowRow::new(window_chunks.next().unwrap_or_default(), cells));
    let mut work = Work::default();
    if width == 0 || height == 0 {
        return work;
    }
    for step in 0..down + 2 {
        block_ring.rotate_left(1);
        let [above, middle, below] = &mut block_ring;
        if step < down {
            blocks::fill::<D, B>(&context, step, references, below);
        } else {
            below.clear();
        }
        window_ring.rotate_left(1);
        let [_, _, newest] = &mut window_ring;
        match step.checked_sub(1).filter(|&row| row < down) {
            Some(row) => windows::join::<B>(frame.intrinsics(), across, row, [above, middle, below], newest),
            None => newest.clear(),
        }
        if let Some(row) = step.checked_sub(2) {
            let [above, middle, below] = &window_ring;
            let windows = [above, middle, below];
            vectorised(
                #[inline(always)]
                || pixels::answer::<D, B>(&context, row, windows, &mut bends, outputs, &mut work, &mut each),
            );
        }
    }
    work.skipped = (width * height) as u32 - work.done;
    work
}
