//! Normals of every pixel, one row at a time.
//!
//! The caller gets each row as soon as it is done, as four plain slices (structure of arrays): nothing the size of an
//! image is stored unless the caller stores it. The row loop is plain arithmetic on slices of one length, which the compiler
//! vectorises on every target.

use core::fmt;

use super::{NormalMethod, NormalParams, exact, facing, normal_at};
use crate::ground::image::ImageViewMut;
use crate::ground::lanes::{VECTORS, vectorised};
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;
use crate::skipping::tiles::{TILE, TileMap};

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
}

/// What one row of normals rests on; NaN where there is none.
#[derive(Debug, Clone, Copy)]
pub struct FitRow<'a> {
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

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

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
    walk::<D, false>(frame, params, whole(frame), scratch, |y, normals, _| each(y, normals))
}

/// As [`rows`], with what each normal rests on: `each(y, normals, fit)`. Costs a quarter more.
///
/// # Errors
/// [`DenseError::Scratch`].
pub fn rows_with_fit<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    params: &NormalParams,
    scratch: &mut [f32],
    each: impl FnMut(usize, NormalRow<'_>, FitRow<'_>),
) -> Result<Work, DenseError> {
    walk::<D, true>(frame, params, whole(frame), scratch, each)
}

fn whole<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Region {
    let (width, height) = frame.size();
    Region { x: 0, y: 0, width, height }
}

/// As [`rows`], for a part of the image only: the same normals, bit for bit, of the pixels in `part` (what of it lies outside
/// the image is left out). Rows are as long as the part is wide. Needs [`scratch_len`] of the part's width.
///
/// # Errors
/// [`DenseError::Scratch`].
pub fn region<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    params: &NormalParams,
    part: Region,
    scratch: &mut [f32],
    mut each: impl FnMut(usize, NormalRow<'_>),
) -> Result<Work, DenseError> {
    walk::<D, false>(frame, params, part, scratch, |y, normals, _| each(y, normals))
}

/// Every form's loop over rows; residual and support only where `FIT`.
fn walk<D: DepthSample, const FIT: bool>(
    frame: &DepthFrame<'_, D>,
    params: &NormalParams,
    part: Region,
    scratch: &mut [f32],
    mut each: impl FnMut(usize, NormalRow<'_>, FitRow<'_>),
) -> Result<Work, DenseError> {
    let (image_width, image_height) = frame.size();
    let width = part.width.min(image_width.saturating_sub(part.x));
    let height = part.height.min(image_height.saturating_sub(part.y));
    let part = Region { width, height, ..part };
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
    let mut ring = Ring::new(inverse_rows, padded);
    if cross {
        // The two rows above the part and its first two; the third comes with the first step.
        for y in 0..2 * PAD {
            ring.push(frame, part.x, (part.y + y).checked_sub(PAD));
        }
    }
    let readings = |y: usize| {
        let line = frame.depth().row(y).get(part.x..part.x + width).unwrap_or(&[]);
        line.iter().map(|v| u32::from(v.is_valid())).sum::<u32>()
    };
    for y in part.y..part.y + height {
        let valid = if cross {
            vectorised(
                #[inline(always)]
                || {
                    ring.push(frame, part.x, Some(y + PAD));
                    if VECTORS || FIT {
                        cross_row::<D, FIT>(frame, part.x, y, &ring.window(), &mut out);
                        None
                    } else {
                        Some(cross_row_in_registers(frame, part.x, y, &ring.window(), &mut out))
                    }
                },
            )
        } else {
            point_row(frame, params, part.x, y, &mut out);
            None
        };
        let valid = valid.unwrap_or_else(|| readings(y));
        work += Work { done: valid, skipped: width as u32 - valid };
        each(y, out.normals(), out.fit());
    }
    Ok(work)
}

/// Brings the planes of an earlier frame up to date: only the tiles that changed since, and their neighbours, are computed
/// anew ([`TileMap`]); the others keep what they hold, and tiles without a reading are never written: let the planes begin as
/// NaN, or begin with [`planes`]. Where more than two thirds of the tiles are out of date everything is computed, which is
/// faster then. With [`DepthNoise::NONE`](crate::sensing::depth::noise::DepthNoise::NONE)
/// and `f32` depth the planes then equal a full computation to the last bit; with noise, what is kept differs from what
/// would be computed by what the noise of the one frame against the other makes of it. Work is counted in pixels.
///
/// Only the exact method with radius 0 looks at most two pixels around; other parameters compute everything.
///
/// # Errors
/// [`DenseError`] when scratch is short ([`scratch_len`] of the image's width) or a plane differs in size.
pub fn update<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    tiles: &TileMap<'_, D>,
    params: &NormalParams,
    scratch: &mut [f32],
    [x, y, z]: [&mut ImageViewMut<'_, f32>; 3],
) -> Result<Work, DenseError> {
    let (width, height) = frame.size();
    check_sizes(frame.size(), [x.size(), y.size(), z.size()])?;
    let (across, down) = tiles.size();
    let fits = across == width.div_ceil(TILE) && down == height.div_ceil(TILE);
    let mostly = tiles.work().skipped_share() < 1.0 / 3.0;
    if !fits || mostly || params.method != NormalMethod::Exact || params.radius > 0 {
        return planes(frame, params, scratch, [x, y, z], None);
    }
    let mut done = 0;
    for ty in 0..down {
        let mut tx = 0;
        while tx < across {
            let first = tx;
            while tx < across && tiles.is_stale(tx, ty) {
                tx += 1;
            }
            if tx > first {
                let part = Region { x: first * TILE, y: ty * TILE, width: (tx - first) * TILE, height: TILE };
                let work = region(frame, params, part, scratch, |row, n| {
                    copy(x.row_mut(row), part.x, n.x);
                    copy(y.row_mut(row), part.x, n.y);
                    copy(z.row_mut(row), part.x, n.z);
                })?;
                done += work.done;
            }
            tx += 1;
        }
    }
    Ok(Work { done, skipped: (width * height) as u32 - done })
}

/// Copies `values` into the row from column `from`, as far as there is room.
fn copy(row: &mut [f32], from: usize, values: &[f32]) {
    for (cell, value) in row.iter_mut().skip(from).zip(values) {
        *cell = *value;
    }
}

fn check_sizes<const N: usize>(depth: (usize, usize), outputs: [(usize, usize); N]) -> Result<(), DenseError> {
    match outputs.into_iter().find(|&size| size != depth) {
        Some(output) => Err(DenseError::Size { depth, output }),
        None => Ok(()),
    }
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
    let residual_size = residual.as_ref().map_or(frame.size(), |r| r.size());
    check_sizes(frame.size(), [x.size(), y.size(), z.size(), residual_size])?;
    let mut store = |row, n: NormalRow<'_>| {
        copy(x.row_mut(row), 0, n.x);
        copy(y.row_mut(row), 0, n.y);
        copy(z.row_mut(row), 0, n.z);
    };
    match &mut residual {
        None => rows(frame, params, scratch, store),
        Some(residual) => rows_with_fit(frame, params, scratch, |row, normals, fit| {
            store(row, normals);
            copy(residual.row_mut(row), 0, fit.residual);
        }),
    }
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

    fn normals(&self) -> NormalRow<'_> {
        NormalRow { x: self.x, y: self.y, z: self.z }
    }

    fn fit(&self) -> FitRow<'_> {
        FitRow { residual: self.residual, support: self.support }
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

    /// Drops the oldest row and adds image row `y` from two columns before `x` on (holes outside the image).
    #[inline(always)]
    fn push<D: DepthSample>(&mut self, frame: &DepthFrame<'_, D>, x: usize, y: Option<usize>) {
        self.rows.rotate_left(1);
        let Some(row) = self.rows.last_mut() else { return };
        let source = y.map_or(&[] as &[D], |y| frame.depth().row(y));
        // Columns before the image: both at x = 0, one at x = 1.
        let before = PAD.saturating_sub(x);
        let source = source.get(x.saturating_sub(PAD)..).unwrap_or(&[]);
        let (outside, rest) = row.split_at_mut_checked(before).unwrap_or_default();
        outside.fill(exact::HOLE);
        let (inside, beyond) = rest.split_at_mut_checked(source.len().min(rest.len())).unwrap_or_default();
        for (w, &value) in inside.iter_mut().zip(source) {
            *w = exact::inverse(value);
        }
        beyond.fill(exact::HOLE);
    }

    fn window(&self) -> [&[f32]; ROWS] {
        let [a, b, c, d, e] = &self.rows;
        [a, b, c, d, e]
    }
}

/// The exact kernel along one row.
#[inline(always)]
fn cross_row<D: DepthSample, const FIT: bool>(
    frame: &DepthFrame<'_, D>,
    first: usize,
    y: usize,
    window: &[&[f32]; ROWS],
    out: &mut Outputs<'_>,
) {
    let k = frame.intrinsics();
    let unit = frame.unit().metres();
    let (fx, fy, cx) = (k.fx(), k.fy(), k.cx());
    let (turn_x, turn_y) = (exact::turn(fx), exact::turn(fy));
    let dy = y as f32 - k.cy();
    let first = first as i32;
    let n = out.x.len();
    let [up2, up1, line, down1, down2] = *window;
    let cut = |row| cut(row, PAD, n);
    let (up2, up1, c, down1, down2) = (cut(up2), cut(up1), cut(line), cut(down1), cut(down2));
    let (l2, l1, r1, r2) = (self::cut(line, 0, n), self::cut(line, 1, n), self::cut(line, 3, n), self::cut(line, 4, n));
    let taps = l2.iter().zip(l1).zip(c).zip(r1).zip(r2).zip(up2).zip(up1).zip(down1).zip(down2);
    for (i, (((((((((&l2, &l1), &c), &r1), &r2), &u2), &u1), &d1), &d2), ((((nx, ny), nz), res), support))) in
        taps.zip(out.pixels()).enumerate()
    {
        let h = exact::slope(l2, l1, c, r1, r2, turn_x);
        let v = exact::slope(u2, u1, c, d1, d2, turn_y);
        // `as i32`: the conversion from 64-bit integers has no vector form.
        let [x, y, z] = facing(c, h.value, v.value, (first + i as i32) as f32 - cx, dy, fx, fy);
        let real = exact::is_real(c, h, v);
        // All bits set is a NaN: one operation where a select takes three.
        let hole = if real { 0 } else { u32::MAX };
        let mask = |v: f32| f32::from_bits(v.to_bits() | hole);
        *nx = mask(x);
        *ny = mask(y);
        *nz = mask(z);
        if FIT {
            *res = mask(exact::residual(c, h.curvature, v.curvature, unit));
            *support = mask(1.0 + h.taps + v.taps);
        }
    }
}

/// As [`cross_row`], for targets without vector units, to the same bits: what one pixel knows of its row, the next one uses, and
/// holes are left at once. Returns the pixels with a reading.
fn cross_row_in_registers<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    first: usize,
    y: usize,
    window: &[&[f32]; ROWS],
    out: &mut Outputs<'_>,
) -> u32 {
    let k = frame.intrinsics();
    let (fx, fy, cx) = (k.fx(), k.fy(), k.cx());
    let (turn_x, turn_y) = (exact::turn(fx), exact::turn(fy));
    let dy = y as f32 - k.cy();
    let n = out.x.len();
    let [up2, up1, line, down1, down2] = *window;
    let (up2, up1, down1, down2) = (cut(up2, PAD, n), cut(up1, PAD, n), cut(down1, PAD, n), cut(down2, PAD, n));
    let [l2, l1, mut c, mut r1] = *line.first_chunk::<4>().unwrap_or(&[exact::HOLE; 4]);
    // First and second differences along the row, each computed once.
    let (mut l, mut r) = (c - l1, r1 - c);
    let (mut before, mut bend) = (l - (l1 - l2), r - l);
    let (mut column, mut done) = (first as f32, 0);
    let mut answer = |[r2, u2, u1, d1, d2]: [f32; 5]| {
        let (centre, left, right, bends) = (c, l, r, [before, bend, r2 - r1 - r]);
        (l, r, before, bend, c, r1) = (r, r2 - r1, bend, r2 - r1 - r, r1, r2);
        let dx = column - cx;
        column += 1.0;
        if !(centre < exact::REAL) {
            return NOTHING;
        }
        done += 1;
        let Some(h) = exact::slope_by_branches(left, right, bends, centre * turn_x) else { return NOTHING };
        let (above, below) = (centre - u1, d1 - centre);
        let bends = [above - (u1 - u2), below - above, (d2 - d1) - below];
        let Some(v) = exact::slope_by_branches(above, below, bends, centre * turn_y) else { return NOTHING };
        facing(centre, h, v, dx, dy, fx, fy)
    };
    let taps = cut(line, 4, n).iter().zip(up2).zip(up1).zip(down1).zip(down2);
    for (((((&r2, &u2), &u1), &d1), &d2), ((nx, ny), nz)) in
        taps.zip(out.x.iter_mut().zip(out.y.iter_mut()).zip(out.z.iter_mut()))
    {
        [*nx, *ny, *nz] = answer([r2, u2, u1, d1, d2]);
    }
    done
}

/// No normal.
const NOTHING: [f32; 3] = [f32::from_bits(u32::MAX); 3];

/// `n` values of a padded row, from `from`; every row is `n + 2 PAD` long, so the cut always succeeds.
fn cut(row: &[f32], from: usize, n: usize) -> &[f32] {
    row.get(from..).and_then(|rest| rest.get(..n)).unwrap_or(&[])
}

/// The other methods, pixel by pixel.
fn point_row<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    params: &NormalParams,
    first: usize,
    y: usize,
    out: &mut Outputs<'_>,
) {
    for (i, ((((nx, ny), nz), residual), support)) in out.pixels().enumerate() {
        ([*nx, *ny, *nz], *residual, *support) = match normal_at(frame, first + i, y, params) {
            Some(e) => (e.normal.to_array(), e.residual, f32::from(e.support)),
            None => ([f32::NAN; 3], f32::NAN, f32::NAN),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::image::ImageView;
    use crate::sensing::camera::Intrinsics;
    use crate::sensing::depth::DepthUnit;
    use std::vec;
    use std::vec::Vec;

    /// Devices without vector units walk the row in another way: the same bits, holes and edges included.
    #[test]
    fn both_ways_along_a_row_give_the_same_normals() {
        let (w, h) = (61, 23);
        let depth: Vec<u16> = (0..w * h)
            .map(|i| match (i * 7919) % 31 {
                0 => 0,
                1 => 65_535,
                n if n < 6 => (2000 + n) as u16,
                n => (1000 + n + (i % w) * 9 + i / w * 5) as u16,
            })
            .collect();
        let k = Intrinsics::new(50.0, -52.0, 30.0, 11.0).unwrap();
        let frame = DepthFrame::new(ImageView::new(&depth, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
        let (mut rows, mut outputs) =
            (vec![0.0; ROWS * (w + 2 * PAD)], [vec![0.0; OUTPUTS * w], vec![0.0; OUTPUTS * w]]);
        let mut ring = Ring::new(&mut rows, w + 2 * PAD);
        (0..2 * PAD).for_each(|y| ring.push(&frame, 0, y.checked_sub(PAD)));
        for y in 0..h {
            ring.push(&frame, 0, Some(y + PAD));
            let [a, b] = &mut outputs;
            let (mut a, mut b) = (Outputs::split(a, w), Outputs::split(b, w));
            cross_row::<u16, false>(&frame, 0, y, &ring.window(), &mut a);
            let readings = cross_row_in_registers(&frame, 0, y, &ring.window(), &mut b);
            assert_eq!(readings as usize, frame.depth().row(y).iter().filter(|v| v.is_valid()).count());
            let bits = |o: &Outputs<'_>| [&*o.x, &*o.y, &*o.z].concat().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&a), bits(&b), "row {y}");
        }
    }
}
