//! A depth frame as a grid of small planes: what is left of it for registration.
//!
//! On a plane inverse depth is linear in pixel coordinates, so a cell of C x C pixels is one regression, and its plane is three
//! numbers: N with N · P = 1 for all its points P (camera frame, 1/metres). The cell's point is ray / (N · ray), its normal
//! N / |N|. A cell whose pixels lie on no plane (an edge), that is mostly holes or seen at a grazing angle is (0, 0, 0).

use glam::Vec3;

use crate::ground::lanes::{LANES, Lanes};
use crate::ground::math;
use crate::ground::regression::{Regression, Sums};
use crate::sensing::depth::DepthSample;
use crate::sensing::depth::noise::DepthNoise;
use crate::sensing::frame::DepthFrame;

/// A cell's pixels may stray from its plane by this share of its width: spheres pass, steps don't.
const FLATNESS: f32 = 0.1;
/// Cosine of the steepest incidence of a cell in use: 80 degrees.
const GRAZING: f32 = 0.17;

/// How the cells of one view lie in its image, and how exact they are. Plain numbers, for loops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    /// Side of a cell, pixels; a power of two.
    pub(super) cell: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) fx: f32,
    pub(super) fy: f32,
    pub(super) cx: f32,
    pub(super) cy: f32,
    /// Variance of a reading at z metres: (constant + linear z + quadratic z²)² + rounding.
    noise: DepthNoise,
    rounding: f32,
}

/// Rows between those that are read.
const fn row_step(cell: usize) -> usize {
    if cell >= 16 { cell / 8 } else { 1 }
}

impl Grid {
    pub(super) const EMPTY: Self = Self {
        cell: 1,
        columns: 0,
        rows: 0,
        fx: 1.0,
        fy: 1.0,
        cx: 0.0,
        cy: 0.0,
        noise: DepthNoise::NONE,
        rounding: 0.0,
    };

    pub(super) fn new<D: DepthSample>(frame: &DepthFrame<'_, D>, cell: usize, noise: &DepthNoise) -> Self {
        let (k, (width, height)) = (frame.intrinsics(), frame.size());
        let cell = cell.max(1);
        let step = frame.unit().metres() * D::ROUNDING;
        Self {
            cell,
            columns: width / cell,
            rows: height / cell,
            fx: k.fx(),
            fy: k.fy(),
            cx: k.cx(),
            cy: k.cy(),
            noise: *noise,
            rounding: step * step,
        }
    }

    /// Standard deviation of a cell's normal at the depth that the image has on average, radians; 0 for an image without readings.
    pub(super) fn normal_sigma<D: DepthSample>(&self, frame: &DepthFrame<'_, D>) -> f32 {
        let (width, height) = frame.size();
        let (mut sum, mut n) = (0.0, 0.0);
        for i in 0..16 {
            let row = frame.depth().row((2 * i + 1) * height / 32);
            for v in row.iter().skip(width / 32).step_by((width / 16).max(1)).filter(|v| v.is_valid()) {
                sum += v.metres(frame.unit());
                n += 1.0;
            }
        }
        if n == 0.0 {
            return 0.0;
        }
        let z = sum / n;
        let [variance, ..] = self.variance(Lanes::splat(z)).0;
        let wide = z * self.cell as f32 / self.fx.abs();
        math::sqrt(12.0 * variance / self.samples().max(1) as f32) / wide
    }

    /// Whether these can be the cells of this frame.
    pub(super) fn is_of<D: DepthSample>(&self, frame: &DepthFrame<'_, D>) -> bool {
        *self == Self::new(frame, self.cell, &self.noise)
    }

    pub(super) const fn cells(&self) -> usize {
        self.columns * self.rows
    }

    /// Pixel coordinate of the middle of the cell in this column or row.
    #[inline(always)]
    pub(super) fn middle(&self, index: usize) -> f32 {
        (index * self.cell) as f32 + 0.5 * (self.cell as f32 - 1.0)
    }

    /// Readings in a cell without holes.
    pub(super) const fn samples(&self) -> usize {
        self.cell * (self.cell / row_step(self.cell))
    }

    /// Variance of one reading at `z` metres, metres squared.
    #[inline(always)]
    pub(super) fn variance(&self, z: Lanes) -> Lanes {
        let n = &self.noise;
        let model = (z * n.quadratic + Lanes::splat(n.linear)) * z + Lanes::splat(n.constant);
        model * model + Lanes::splat(self.rounding)
    }
}

/// Sums over a view's cells.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Extent {
    /// Cells that hold a plane.
    pub(super) count: u32,
    /// Sum of their points, camera frame.
    pub(super) first: Vec3,
    /// Sum of their squared distances from the camera.
    pub(super) second: f32,
}

/// Fits the cells of grid row `row`; writes one value a cell into each of the three rows.
pub(super) fn fit_row<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    grid: &Grid,
    row: usize,
    [nx, ny, nz]: [&mut [f32]; 3],
    extent: &mut Extent,
) {
    for (column, ((nx, ny), nz)) in nx.iter_mut().zip(ny).zip(nz).enumerate() {
        let plane = fit(frame, grid, column, row).unwrap_or(Vec3::ZERO);
        (*nx, *ny, *nz) = (plane.x, plane.y, plane.z);
        if plane != Vec3::ZERO {
            let ray = ray(grid, column, row);
            let point = ray / plane.dot(ray);
            extent.count += 1;
            extent.first += point;
            extent.second += point.length_squared();
        }
    }
}

/// The ray with z = 1 through the middle of a cell.
fn ray(grid: &Grid, column: usize, row: usize) -> Vec3 {
    Vec3::new((grid.middle(column) - grid.cx) / grid.fx, (grid.middle(row) - grid.cy) / grid.fy, 1.0)
}

/// The plane N of one cell, 1/metres; `None` when there is none.
fn fit<D: DepthSample>(frame: &DepthFrame<'_, D>, grid: &Grid, column: usize, row: usize) -> Option<Vec3> {
    let (x0, y0) = (column * grid.cell, row * grid.cell);
    let reference = reference(frame, grid, x0, y0)?;
    let sums = whole(frame, grid, x0, y0, reference).or_else(|| with_holes(frame, grid, x0, y0, reference))?;
    let Regression { c, a, b, squares } = sums.solve()?;
    let w = c + reference;
    let free = sums.n - 3.0;
    let stray = FLATNESS * w * grid.cell as f32 / grid.fx.abs();
    let most = 2.25 * grid.noise.inverse_variance::<D>(w, frame.unit()) + stray * stray;
    // Negated, so that NaN is refused too.
    if !(w > 0.0 && free > 0.0 && squares <= most * free) {
        return None;
    }
    let (dx, dy) = (grid.middle(column) - grid.cx, grid.middle(row) - grid.cy);
    let n = Vec3::new(grid.fx * a, grid.fy * b, w - a * dx - b * dy) / frame.unit().metres();
    let ray = ray(grid, column, row);
    let cosine = n.dot(ray) / (n.length() * ray.length());
    (n.is_finite() && cosine >= GRAZING).then_some(n)
}

/// Inverse depth of the reading nearest to the middle, by rows: what is subtracted from all, so that squares keep their digits.
fn reference<D: DepthSample>(frame: &DepthFrame<'_, D>, grid: &Grid, x0: usize, y0: usize) -> Option<f32> {
    let half = grid.cell / 2;
    let at = |y: usize| frame.depth().get(x0 + half, y0 + y).filter(|v| v.is_valid()).map(|v| 1.0 / v.number());
    at(half).or_else(|| (0..grid.cell).find_map(at))
}

/// Sums over a cell without holes; `None` when there is one.
fn whole<D: DepthSample>(frame: &DepthFrame<'_, D>, grid: &Grid, x0: usize, y0: usize, reference: f32) -> Option<Sums> {
    if !grid.cell.is_multiple_of(LANES) {
        return None;
    }
    let middle = 0.5 * (grid.cell as f32 - 1.0);
    let mut sums = Sums::default();
    let (mut m, mut my, mut myy) = (0.0, 0.0, 0.0);
    for y in (0..grid.cell).step_by(row_step(grid.cell)) {
        let dy = y as f32 - middle;
        (m, my, myy) = (m + 1.0, my + dy, myy + dy * dy);
    }
    for x in (0..grid.cell).step_by(LANES) {
        let dx = Lanes::index() + Lanes::splat(x as f32 - middle);
        let (mut w, mut yw, mut ww) = (Lanes::ZERO, Lanes::ZERO, Lanes::ZERO);
        for y in (0..grid.cell).step_by(row_step(grid.cell)) {
            let pixels: &[D; LANES] = frame.depth().row(y0 + y).get(x0 + x..)?.first_chunk()?;
            let d = Lanes(pixels.map(|v| if v.is_valid() { v.number() } else { f32::NAN })).recip()
                - Lanes::splat(reference);
            w += d;
            yw += d * (y as f32 - middle);
            ww += d * d;
        }
        sums.n += m * LANES as f32;
        sums.x += m * dx.sum();
        sums.y += my * LANES as f32;
        sums.xx += m * (dx * dx).sum();
        sums.xy += my * dx.sum();
        sums.yy += myy * LANES as f32;
        sums.w += w.sum();
        sums.xw += (w * dx).sum();
        sums.yw += yw.sum();
        sums.ww += ww.sum();
    }
    // Holes are NaN, and NaN stays.
    sums.ww.is_finite().then_some(sums)
}

/// Sums over the readings of a cell, one at a time; `None` when more than half are missing.
fn with_holes<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    grid: &Grid,
    x0: usize,
    y0: usize,
    reference: f32,
) -> Option<Sums> {
    let middle = 0.5 * (grid.cell as f32 - 1.0);
    let mut sums = Sums::default();
    for y in (0..grid.cell).step_by(row_step(grid.cell)) {
        let row = frame.depth().row(y0 + y).get(x0..).unwrap_or(&[]);
        for (x, v) in row.iter().take(grid.cell).enumerate().filter(|(_, v)| v.is_valid()) {
            sums.add(x as f32 - middle, y as f32 - middle, 1.0 / v.number() - reference);
        }
    }
    (2.0 * sums.n >= grid.samples() as f32).then_some(sums)
}
