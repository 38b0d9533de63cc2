//! Normals of every pixel, one row at a time.
//!
//! The caller gets each row as soon as it is done, as four plain slices (structure of arrays): nothing the size of an
//! image is stored unless the caller stores it. The row loop is plain arithmetic on slices of one length, which the compiler
//! vectorises on every target.

use core::fmt;

use super::{NormalMethod, NormalParams, exact, facing, normal_at};
use crate::ground::image::ImageViewMut;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;

/// Rows of inverse depth kept: the centre and two either side.
const ROWS: usize = 5;
/// Pixels of padding at either end of a row, holes all.
const PAD: usize = 2;
/// Rows handed out: three components, residual, support.
const OUTPUTS: usize = 5;

/// Floats of scratch that [`rows`] needs for images of this width.
///
/// ```
/// use isobath::localized::normals::dense::scratch_len;
/// assert_eq!(scratch_len(160), 5 * 164 + 5 * 160);
/// ```
#[must_use]
pub const fn scratch_len(width: usize) -> usize {
    width.saturating_add(2 * PAD).saturating_mul(ROWS).saturating_add(width.saturating_mul(OUTPUTS))
}

/// One row of normals in the camera frame; NaN where there is none.
#[derive(Debug, Clone, Copy)]
pub struct NormalRow<'a> {
    /// Component to the right.
    pub x: &'a [f32],
    /// Component down.
    pub y: &'a [f32],
    /// Component forward; negative, as normals face the camera (except past grazing view angles, where perspective allows
    /// a small positive one).
    pub z: &'a [f32],
    /// RMS deviation of the readings from the fitted surface, metres; NaN where there is no normal.
    pub residual: &'a [f32],
    /// Readings it rests on, the centre included (a whole number, as float so that the row loop stays in vectors); NaN
    /// where there is no normal.
    pub support: &'a [f32],
}

/// Why there are no dense normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DenseError {
    /// The scratch slice is too short.
    Scratch {
        /// Floats needed ([`scratch_len`]).
        needed: usize,
        /// Floats given.
        got: usize,
    },
    /// An output plane is not of the depth image's size.
    Size {
        /// Depth width and height.
        depth: (usize, usize),
        /// The plane's.
        output: (usize, usize),
    },
}

impl fmt::Display for DenseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scratch { needed, got } => write!(f, "dense normals need {needed} floats of scratch, got {got}"),
            Self::Size { depth, output } => write!(
                f,
                "normals output is {}x{}, depth {}x{}; they must be the same",
                output.0, output.1, depth.0, depth.1
            ),
        }
    }
}

impl core::error::Error for DenseError {}

/// Estimates every normal and hands each row, top to bottom, to `each(y, row)`. Returns pixels done (those with a reading)
/// and skipped (those without).
///
/// # Errors
/// [`DenseError::Scratch`].
pub fn rows<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    params: &NormalParams,
    scratch: &mut [f32],
    mut each: impl FnMut(usize, NormalRow<'_>),
) -> Result<Work, DenseError> {
    let (width, height) = frame.size();
    let needed = scratch_len(width);
    let got = scratch.len();
    let Some(scratch) = scratch.get_mut(..needed) else {
        return Err(DenseError::Scratch { needed, got });
    };
    if width == 0 || height == 0 {
        return Ok(Work::default());
    }
    let padded = width + 2 * PAD;
    let Some((inverse_rows, outputs)) = scratch.split_at_mut_checked(ROWS * padded) else {
        return Err(DenseError::Scratch { needed, got });
    };
    let mut out = Outputs::split(outputs, width);
    let mut work = Work::default();
    let cross = params.method == NormalMethod::Exact && params.radius == 0;
    if !cross {
        for y in 0..height {
            point_row(frame, params, y, &mut out, &mut work);
            each(y, out.as_row());
        }
        return Ok(work);
    }
    let mut ring = Ring::new(inverse_rows, padded);
    // Before the first row: two rows of holes, then the first two of the image.
    for y in 0..PAD {
        ring.push(frame, y, &mut work);
    }
    for y in 0..height {
        ring.push(frame, y + PAD, &mut work);
        cross_row(frame, y, &ring.window(), &mut out);
        each(y, out.as_row());
    }
    Ok(work)
}

/// As [`rows`], written into three planes (and a plane of residuals when given) of the depth image's size.
///
/// # Errors
/// [`DenseError`] when scratch is short or a plane differs in size.
pub fn planes<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    params: &NormalParams,
    scratch: &mut [f32],
    [x, y, z]: [&mut ImageViewMut<'_, f32>; 3],
    mut residual: Option<&mut ImageViewMut<'_, f32>>,
) -> Result<Work, DenseError> {
    let sizes = [x.size(), y.size(), z.size(), residual.as_ref().map_or(frame.size(), |r| r.size())];
    if let Some(&output) = sizes.iter().find(|&&s| s != frame.size()) {
        return Err(DenseError::Size { depth: frame.size(), output });
    }
    rows(frame, params, scratch, |row, n| {
        x.row_mut(row).copy_from_slice(n.x);
        y.row_mut(row).copy_from_slice(n.y);
        z.row_mut(row).copy_from_slice(n.z);
        if let Some(residual) = &mut residual {
            residual.row_mut(row).copy_from_slice(n.residual);
        }
    })
}

type OutputPixel<'a> = ((((&'a mut f32, &'a mut f32), &'a mut f32), &'a mut f32), &'a mut f32);

struct Outputs<'a> {
    x: &'a mut [f32],
    y: &'a mut [f32],
    z: &'a mut [f32],
    residual: &'a mut [f32],
    support: &'a mut [f32],
}

impl<'a> Outputs<'a> {
    fn split(all: &'a mut [f32], width: usize) -> Self {
        let (x, rest) = all.split_at_mut_checked(width).unwrap_or_default();
        let (y, rest) = rest.split_at_mut_checked(width).unwrap_or_default();
        let (z, rest) = rest.split_at_mut_checked(width).unwrap_or_default();
        let (residual, support) = rest.split_at_mut_checked(width).unwrap_or_default();
        Self { x, y, z, residual, support }
    }

    /// The outputs of each pixel: ((((x, y), z), residual), support).
    fn pixels(&mut self) -> impl Iterator<Item = OutputPixel<'_>> {
        let normal = self.x.iter_mut().zip(self.y.iter_mut()).zip(self.z.iter_mut());
        normal.zip(self.residual.iter_mut()).zip(self.support.iter_mut())
    }

    fn as_row(&self) -> NormalRow<'_> {
        NormalRow { x: self.x, y: self.y, z: self.z, residual: self.residual, support: self.support }
    }
}

/// The last five padded rows of inverse depth; the oldest is overwritten by the next.
struct Ring<'a> {
    rows: [&'a mut [f32]; ROWS],
}

impl<'a> Ring<'a> {
    fn new(storage: &'a mut [f32], padded: usize) -> Self {
        storage.fill(exact::HOLE);
        let mut chunks = storage.chunks_mut(padded.max(1));
        Self { rows: core::array::from_fn(|_| chunks.next().unwrap_or_default()) }
    }

    /// Drops the oldest row and adds image row `y` (holes below the image).
    fn push<D: DepthSample>(&mut self, frame: &DepthFrame<'_, D>, y: usize, work: &mut Work) {
        self.rows.rotate_left(1);
        let Some(row) = self.rows.last_mut() else { return };
        let source = frame.depth().row(y);
        if source.is_empty() {
            row.fill(exact::HOLE);
            return;
        }
        let mut valid = 0_u32;
        if let Some(inner) = row.get_mut(PAD..) {
            for (w, &value) in inner.iter_mut().zip(source) {
                *w = exact::inverse(value);
                valid += u32::from(value.is_valid());
            }
        }
        work.done += valid;
        work.skipped += source.len() as u32 - valid;
    }

    fn window(&self) -> [&[f32]; ROWS] {
        let [a, b, c, d, e] = &self.rows;
        [a, b, c, d, e]
    }
}

/// The exact kernel along one row.
fn cross_row<D: DepthSample>(frame: &DepthFrame<'_, D>, y: usize, window: &[&[f32]; ROWS], out: &mut Outputs<'_>) {
    let k = frame.intrinsics();
    let unit = frame.unit().metres();
    let (fx, fy, cx) = (k.fx(), k.fy(), k.cx());
    let dy = y as f32 - k.cy();
    let n = out.x.len();
    let [up2, up1, line, down1, down2] = *window;
    let cut = |row| cut(row, PAD, n);
    let (up2, up1, c, down1, down2) = (cut(up2), cut(up1), cut(line), cut(down1), cut(down2));
    let (l2, l1, r1, r2) = (self::cut(line, 0, n), self::cut(line, 1, n), self::cut(line, 3, n), self::cut(line, 4, n));
    let taps = l2.iter().zip(l1).zip(c).zip(r1).zip(r2).zip(up2).zip(up1).zip(down1).zip(down2);
    for (i, (((((((((&l2, &l1), &c), &r1), &r2), &u2), &u1), &d1), &d2), ((((nx, ny), nz), res), support))) in
        taps.zip(out.pixels()).enumerate()
    {
        let h = exact::slope(l2, l1, c, r1, r2);
        let v = exact::slope(u2, u1, c, d1, d2);
        // `as i32`: the conversion from 64-bit integers has no vector form.
        let [x, y, z] = facing(c, h.value, v.value, i as i32 as f32 - cx, dy, fx, fy);
        let real = exact::is_real(c, h, v);
        // All bits set is a NaN: one operation where a select takes three.
        let hole = if real { 0 } else { u32::MAX };
        let mask = |v: f32| f32::from_bits(v.to_bits() | hole);
        *nx = mask(x);
        *ny = mask(y);
        *nz = mask(z);
        *res = mask(exact::residual(c, h.curvature, v.curvature, unit));
        *support = mask(1.0 + h.taps + v.taps);
    }
}

/// `n` values of a padded row, from `from`; every row is `n + 2 PAD` long, so the cut always succeeds.
fn cut(row: &[f32], from: usize, n: usize) -> &[f32] {
    row.get(from..).and_then(|rest| rest.get(..n)).unwrap_or(&[])
}

/// The other methods, pixel by pixel.
fn point_row<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    params: &NormalParams,
    y: usize,
    out: &mut Outputs<'_>,
    work: &mut Work,
) {
    for (x, ((((nx, ny), nz), residual), support)) in out.pixels().enumerate() {
        ([*nx, *ny, *nz], *residual, *support) = match normal_at(frame, x, y, params) {
            Some(e) => (e.normal.to_array(), e.residual, f32::from(e.support)),
            None => ([f32::NAN; 3], f32::NAN, f32::NAN),
        };
        if frame.depth().get(x, y).is_some_and(DepthSample::is_valid) {
            work.done += 1;
        } else {
            work.skipped += 1;
        }
    }
}
