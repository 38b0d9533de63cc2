//! One row of cells of one view against another view: projective association and the sums of point-to-plane least squares.

use glam::{Quat, Vec3};

use super::cells::Grid;
use crate::ground::lanes::{LANES, Lanes, vectorised};
use crate::ground::math;
use crate::ground::rotation::rotate;

/// Bins of [`Sums::histogram`], an eighth of a standard deviation each.
pub(super) const BINS: usize = 32;

/// Which pairs count, and how much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gates {
    /// Largest distance from the plane, metres.
    pub(super) distance: f32,
    /// Cosine of the largest angle between the normals.
    pub(super) cosine: f32,
    /// Standard deviation that residuals have beside the sensor's noise, metres: misalignment.
    pub(super) scale: f32,
}

/// Sums over pairs of one source and one target view, in the target's camera frame. The unknown is (rotation, translation)
/// of the source, and each residual r = n · (p - q) has the row J = (p x n, n).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sums {
    /// Upper triangle of the sum of w times J transposed times J, row after row.
    pub(super) h: [f64; 21],
    /// Sum w r J.
    pub(super) g: [f64; 6],
    /// Sum w.
    pub(super) weight: f64,
    /// Sum of squared residuals of those within 3 standard deviations, metres squared.
    pub(super) squares: f64,
    /// Sum w times the variance of the target's normal, radians squared.
    pub(super) spread: f64,
    /// Source cells that land on a cell of the target.
    pub(super) seen: u32,
    /// Of these, with matching normals and within the distance.
    pub(super) matched: u32,
    /// Of these, within 3 standard deviations.
    pub(super) inliers: u32,
    /// Matched ones by the size of their residual in standard deviations.
    pub(super) histogram: [u32; BINS],
}

impl Sums {
    pub(super) const ZERO: Self = Self {
        h: [0.0; 21],
        g: [0.0; 6],
        weight: 0.0,
        squares: 0.0,
        spread: 0.0,
        seen: 0,
        matched: 0,
        inliers: 0,
        histogram: [0; BINS],
    };

    /// Median of the residuals' sizes in standard deviations, times 1.4826: 1 when they are normal with the deviation they
    /// were weighed with.
    pub(super) fn deviation(&self) -> f32 {
        let mut left = self.matched as f32 * 0.5;
        for (i, &n) in self.histogram.iter().enumerate() {
            if n as f32 >= left && n > 0 {
                return 1.4826 / 8.0 * (i as f32 + left / n as f32);
            }
            left -= n as f32;
        }
        1.4826 / 8.0 * BINS as f32
    }
}

/// A view's cells, borrowed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cells<'a> {
    pub(super) grid: &'a Grid,
    pub(super) nx: &'a [f32],
    pub(super) ny: &'a [f32],
    pub(super) nz: &'a [f32],
}

/// Three coordinates of eight points.
type Triple = [Lanes; 3];

#[inline(always)]
fn dot(a: Triple, b: Triple) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn strided(slice: &[f32], stride: usize) -> Lanes {
    let mut out = [0.0; LANES];
    for (o, v) in out.iter_mut().zip(slice.iter().step_by(stride)) {
        *o = *v;
    }
    Lanes(out)
}

/// Turns and moves from source to target camera.
#[derive(Debug, Clone, Copy)]
struct Motion {
    columns: [Vec3; 3],
    translation: Vec3,
}

impl Motion {
    #[inline(always)]
    fn turn(&self, v: Triple) -> Triple {
        let [x, y, z] = self.columns;
        [
            v[0] * x.x + v[1] * y.x + v[2] * z.x,
            v[0] * x.y + v[1] * y.y + v[2] * z.y,
            v[0] * x.z + v[1] * y.z + v[2] * z.z,
        ]
    }

    #[inline(always)]
    fn apply(&self, v: Triple) -> Triple {
        let [x, y, z] = self.turn(v);
        let t = self.translation;
        [x + Lanes::splat(t.x), y + Lanes::splat(t.y), z + Lanes::splat(t.z)]
    }
}

/// Lane-wise sums of one row.
struct Row {
    h: [Lanes; 21],
    g: [Lanes; 6],
    weight: Lanes,
    squares: Lanes,
    spread: Lanes,
    seen: Lanes,
    matched: Lanes,
    inliers: Lanes,
}

/// Adds every `stride`th cell of row `row` of the source to the sums. `rotation` and `translation` take points of the source's camera
/// frame to the target's.
pub(super) fn add_row(
    source: Cells<'_>,
    target: Cells<'_>,
    rotation: Quat,
    translation: Vec3,
    row: usize,
    stride: usize,
    gates: &Gates,
    sums: &mut Sums,
) {
    vectorised(
        #[inline(always)]
        || add_row_with(source, target, rotation, translation, row, stride, gates, sums),
    );
}

#[inline(always)]
fn add_row_with(
    source: Cells<'_>,
    target: Cells<'_>,
    rotation: Quat,
    translation: Vec3,
    row: usize,
    stride: usize,
    gates: &Gates,
    sums: &mut Sums,
) {
    let motion = Motion { columns: [Vec3::X, Vec3::Y, Vec3::Z].map(|e| rotate(rotation, e)), translation };
    let (from, to) = (source.grid, target.grid);
    let start = row * from.columns;
    let line = |v| -> &[f32] {
        let v: &[f32] = v;
        v.get(start..).and_then(|v| v.get(..from.columns)).unwrap_or(&[])
    };
    let (nx, ny, nz) = (line(source.nx), line(source.ny), line(source.nz));
    let stride = stride.max(1);
    let ray_y = Lanes::splat((from.middle(row) - from.cy) / from.fy);
    let per_pixel = Lanes::splat(1.0 / to.cell as f32);
    let (columns, rows) = (to.columns as f32, to.rows as f32);
    let (from_count, to_count) = (1.0 / from.samples().max(1) as f32, 1.0 / to.samples().max(1) as f32);
    // Variance of a cell's slope is 12 / (n C²) times that of its readings, and fx makes it one of the normal.
    let to_slope = 12.0 * to_count * to.fx * to.fx / (to.cell * to.cell) as f32;
    let mut acc = Row {
        h: [Lanes::ZERO; 21],
        g: [Lanes::ZERO; 6],
        weight: Lanes::ZERO,
        squares: Lanes::ZERO,
        spread: Lanes::ZERO,
        seen: Lanes::ZERO,
        matched: Lanes::ZERO,
        inliers: Lanes::ZERO,
    };
    let one = Lanes::splat(1.0);
    let tiny = Lanes::splat(1e-12);
    let mut column = stride / 2;
    while column < from.columns {
        let tail = |v: &[f32]| strided(v.get(column..).unwrap_or(&[]), stride);
        let plane = [tail(nx), tail(ny), tail(nz)];
        let first = (from.middle(column) - from.cx) / from.fx;
        let ray = [Lanes::index() * (from.cell as f32 * stride as f32 / from.fx) + Lanes::splat(first), ray_y, one];
        column += LANES * stride;
        // The source's points, and where the target would see them.
        let size = dot(plane, plane);
        let some = tiny.below(size);
        if !some.any() {
            continue;
        }
        let z = dot(plane, ray).recip();
        let inverse_size = size.inv_sqrt();
        let p = motion.apply([ray[0] * z, ray[1] * z, z]);
        let n = motion.turn(plane);
        let depth = p[2].recip();
        let u = (p[0] * depth * to.fx + Lanes::splat(to.cx + 0.5)) * per_pixel;
        let v = (p[1] * depth * to.fy + Lanes::splat(to.cy + 0.5)) * per_pixel;
        // What is there.
        let mut there = [[0.0_f32; LANES]; 3];
        let [mut tx, mut ty, mut tz] = there;
        for k in 0..LANES {
            let at = |lanes: &Lanes| lanes.0.get(k).copied().unwrap_or(0.0);
            let (u, v) = (at(&u), at(&v));
            if at(&some) != 0.0 && at(&p[2]) > 0.0 && u >= 0.0 && v >= 0.0 && u < columns && v < rows {
                let index = v as usize * to.columns + u as usize;
                let get = |slice: &[f32]| slice.get(index).copied().unwrap_or(0.0);
                if let (Some(x), Some(y), Some(z)) = (tx.get_mut(k), ty.get_mut(k), tz.get_mut(k)) {
                    (*x, *y, *z) = (get(target.nx), get(target.ny), get(target.nz));
                }
            }
        }
        there = [tx, ty, tz];
        let facing = there.map(Lanes);
        let t_size = dot(facing, facing);
        let seen = tiny.below(t_size);
        if !seen.any() {
            continue;
        }
        // Where nothing is, whatever is computed is multiplied by a zero: it must only be finite.
        let t_size = t_size.select(seen, one);
        let t_inverse = t_size.inv_sqrt();
        let normal = facing.map(|c| c * t_inverse);
        let r = (dot(facing, p) - one) * t_inverse;
        let agree = dot(n, normal) * inverse_size;
        let near = r.map(f32::abs).below(Lanes::splat(gates.distance));
        let alike = Lanes::splat(gates.cosine).below(agree);
        let matched = seen * near * alike;
        // Variance of the residual: of a reading's z, by how much that moves it along the normal, shared by the cell's readings.
        // Both planes have distance 1 / |N| from their cameras, and a share e of depth moves them by e / |N|.
        let (z, z_there) = (z.select(matched, one), p[2].select(matched, one));
        let share = from.variance(z) * from_count * inverse_size * inverse_size * (z * z).recip();
        let (var_there, z2) = (to.variance(z_there), (z_there * z_there).recip());
        let share_there = var_there * to_count * t_inverse * t_inverse * z2;
        let variance =
            (share + share_there).select(matched, Lanes::ZERO) + Lanes::splat(gates.scale * gates.scale + 1e-8);
        let precision = variance.recip();
        let r = r.select(matched, Lanes::ZERO);
        let squared = r * r * precision;
        // Tukey's biweight, zero from 4.685 standard deviations on.
        let left = one - squared * (1.0 / (4.685 * 4.685));
        let left = left.select(Lanes::ZERO.below(left), Lanes::ZERO);
        let weight = precision * left * left * matched;
        let inlier = squared.below(Lanes::splat(9.0)) * matched;
        let p = p.map(|c| c.select(matched, Lanes::ZERO));
        let normal = normal.map(|c| c.select(matched, Lanes::ZERO));
        let j = [
            p[1] * normal[2] - p[2] * normal[1],
            p[2] * normal[0] - p[0] * normal[2],
            p[0] * normal[1] - p[1] * normal[0],
            normal[0],
            normal[1],
            normal[2],
        ];
        let mut cells = acc.h.iter_mut();
        let mut rest = j.iter();
        for g in &mut acc.g {
            let tail = rest.clone();
            let Some(&a) = rest.next() else { break };
            let wa = a * weight;
            *g += wa * r;
            for (&b, h) in tail.zip(&mut cells) {
                *h += wa * b;
            }
        }
        acc.weight += weight;
        acc.squares += r * r * inlier;
        let normal_variance = (var_there * z2 * z2 * t_inverse * t_inverse).select(matched, Lanes::ZERO) * to_slope;
        acc.spread += normal_variance * weight;
        acc.seen += seen;
        acc.matched += matched;
        acc.inliers += inlier;
        for (s, m) in squared.0.into_iter().zip(matched.0) {
            let bin = (math::inv_sqrt(s + 1e-20) * s * 8.0) as usize;
            if let Some(n) = sums.histogram.get_mut(bin)
                && m != 0.0
            {
                *n += 1;
            }
        }
    }
    for (sum, lanes) in sums.h.iter_mut().zip(acc.h).chain(sums.g.iter_mut().zip(acc.g)) {
        *sum += f64::from(lanes.sum());
    }
    sums.weight += f64::from(acc.weight.sum());
    sums.squares += f64::from(acc.squares.sum());
    sums.spread += f64::from(acc.spread.sum());
    sums.seen += acc.seen.sum() as u32;
    sums.matched += acc.matched.sum() as u32;
    sums.inliers += acc.inliers.sum() as u32;
}
