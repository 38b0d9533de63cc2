//! Step 2: each block joins the neighbours that lie on its plane, and the joint plane becomes a normal.

use super::blocks::{BLOCK_FIELDS, BlockRow};
use crate::ground::lanes::{LANES, Lanes, VECTORS};
use crate::sensing::camera::Intrinsics;

/// Numbers kept per window.
pub(super) const WINDOW_FIELDS: usize = 7;

/// One row of windows, one per block, with an empty one at either end.
pub(super) struct WindowRow<'a> {
    /// The plane: value in the block's middle, slopes.
    pub(super) c: &'a mut [f32],
    pub(super) a: &'a mut [f32],
    pub(super) b: &'a mut [f32],
    /// Predicted RMS error of the direction, radians.
    pub(super) sigma: &'a mut [f32],
    /// How far from the plane a pixel may lie and still belong to it; negative where there is no window.
    pub(super) reach: &'a mut [f32],
    /// 1 where the block to the right, and the one below, lie on the same surface; else 0.
    pub(super) right: &'a mut [f32],
    pub(super) below: &'a mut [f32],
}

impl<'a> WindowRow<'a> {
    pub(super) fn new(storage: &'a mut [f32], cells: usize) -> Self {
        let mut parts = storage.chunks_mut(cells.max(1));
        let mut next = || parts.next().unwrap_or_default();
        let mut row =
            Self { c: next(), a: next(), b: next(), sigma: next(), reach: next(), right: next(), below: next() };
        row.clear();
        row
    }

    pub(super) fn clear(&mut self) {
        self.reach.fill(-1.0);
        self.right.fill(0.0);
        self.below.fill(0.0);
    }

    fn fields(&mut self) -> [&mut [f32]; WINDOW_FIELDS] {
        [self.c, self.a, self.b, self.sigma, self.reach, self.right, self.below]
    }
}

/// Sums of the joint fit of eight blocks, each relative to its block's own plane and middle: n, x, y, xx, xy, yy, r, xr,
/// yr, with r the residual against that plane.
type Joint = [Lanes; 9];
/// Eight blocks, field by field.
type Blocks = [Lanes; BLOCK_FIELDS];

/// Pixels farther than this many standard deviations from a plane do not belong to it.
const REACH: f32 = 3.5;

/// Adds to each block `i` the block `j` whose middle is (dx, dy) pixels away, when its plane agrees with i's: half way
/// between the two within 3 standard deviations, and in slope within 4. Returns where it does.
#[inline(always)]
fn add(block: usize, joint: &mut Joint, i: &Blocks, j: &Blocks, dx: f32, dy: f32) -> Lanes {
    let per_slope = 12.0 / ((block * block - 1) as f32);
    let value_gate = 9.0 * (1.0 + 0.25 * per_slope * (dx * dx + dy * dy));
    let slope_gate = 16.0 * per_slope;
    let [_, _, _, _, _, _, ci, ai, bi, qi] = *i;
    let [n, x, y, xx, xy, yy, cj, aj, bj, qj] = *j;
    let dc = cj - ci - ai * dx - bi * dy;
    let (da, db) = (aj - ai, bj - bi);
    let half_way = dc - (da * dx + db * dy) * 0.5;
    let q = qi + qj;
    let m = (half_way * half_way).below(q * value_gate) * (da * da + db * db).below(q * slope_gate);
    let (n, x, y) = (m * n, m * x, m * y);
    let (xx, xy, yy) = (m * xx, m * xy, m * yy);
    // Block j's readings relative to plane i, by way of plane j.
    let r = dc * n + da * x + db * y;
    let sums = [
        n,
        x + n * dx,
        y + n * dy,
        xx + (x * 2.0 + n * dx) * dx,
        xy + y * dx + x * dy + n * (dx * dy),
        yy + (y * 2.0 + n * dy) * dy,
        r,
        r * dx + dc * x + da * xx + db * xy,
        r * dy + dc * y + da * xy + db * yy,
    ];
    for (total, sum) in joint.iter_mut().zip(sums) {
        *total += sum;
    }
    m
}

/// [`add`] as a call. Without vectors eight lanes are eight times the code: written out nine times, it was 60 kB of flash.
#[inline(never)]
fn add_apart(block: usize, joint: &mut Joint, i: &Blocks, j: &Blocks, dx: f32, dy: f32) -> Lanes {
    add(block, joint, i, j, dx, dy)
}

/// Joins the windows of the middle row, of blocks of side `B`: with vectors compiled for each side, without for all together.
pub(super) fn join<const B: usize>(
    k: &Intrinsics,
    across: usize,
    row: usize,
    blocks: [&BlockRow<'_>; 3],
    out: &mut WindowRow<'_>,
) {
    if VECTORS { join_of(B, k, across, row, blocks, out) } else { join_any(B, k, across, row, blocks, out) }
}

#[inline(never)]
fn join_any(
    block: usize,
    k: &Intrinsics,
    across: usize,
    row: usize,
    blocks: [&BlockRow<'_>; 3],
    out: &mut WindowRow<'_>,
) {
    join_of(block, k, across, row, blocks, out);
}

#[inline(always)]
fn join_of(
    block: usize,
    k: &Intrinsics,
    across: usize,
    row: usize,
    [above, middle, below]: [&BlockRow<'_>; 3],
    out: &mut WindowRow<'_>,
) {
    out.clear();
    let (fx, fy) = (k.fx(), k.fy());
    let side = block as f32;
    let half = (side - 1.0) / 2.0;
    let dy = row as f32 * side + half - k.cy();
    let one = Lanes::splat(1.0);
    for start in (1..=across).step_by(LANES) {
        let own = middle.lanes(start);
        let mut joint: Joint = [Lanes::ZERO; 9];
        let mut next = |line: &BlockRow<'_>, at, ox, oy| {
            let other = line.lanes(at);
            if VECTORS {
                add(block, &mut joint, &own, &other, ox, oy)
            } else {
                add_apart(block, &mut joint, &own, &other, ox, oy)
            }
        };
        next(above, start - 1, -side, -side);
        next(above, start, 0.0, -side);
        next(above, start + 1, side, -side);
        next(middle, start - 1, -side, 0.0);
        next(middle, start, 0.0, 0.0);
        let to_right = next(middle, start + 1, side, 0.0);
        next(below, start - 1, -side, side);
        let to_below = next(below, start, 0.0, side);
        next(below, start + 1, side, side);
        let [own_n, _, _, _, _, _, c, a, b, q] = own;
        let [n, x, y, xx, xy, yy, r, xr, yr] = joint;
        let real = Lanes::ZERO.below(own_n);
        let inv = n.select(real, one).recip();
        let (mx, my, mr) = (x * inv, y * inv, r * inv);
        let (xx, xy, yy) = (xx - x * mx, xy - x * my, yy - y * my);
        let (xr, yr) = (xr - x * mr, yr - y * mr);
        let inv_det = (xx * yy - xy * xy).select(real, one).recip();
        let da = (xr * yy - yr * xy) * inv_det;
        let db = (yr * xx - xr * xy) * inv_det;
        let (a, b) = (a + da, b + db);
        let c = c + mr - da * mx - db * my;
        let dx = Lanes::index() * side + Lanes::splat((start - 1) as f32 * side + half - k.cx());
        // The length that `facing` divides by.
        let (nx, ny, nz) = (a * -fx, b * -fy, a * dx + b * dy - c);
        let inv_length = (nx * nx + ny * ny + nz * nz).inv_sqrt();
        // The slopes' covariance is variance / det times (yy, xx): carried to the direction, f times that.
        let variance = q * own_n;
        let spread = variance * inv_det * (yy * (fx * fx) + xx * (fy * fy));
        // Slopes interpolated towards a window beside are better than either's (measured: a tenth for each direction).
        let interpolated = one - (to_right + to_below) * 0.1;
        let sigma = spread * spread.inv_sqrt() * inv_length * interpolated;
        let reach = (variance * variance.inv_sqrt() * REACH).select(real, Lanes::splat(-1.0));
        let fields = [c, a, b, sigma, reach, to_right, to_below];
        for (field, lanes) in out.fields().into_iter().zip(fields) {
            lanes.store(field, start);
        }
    }
    // The last eight may reach past the row's end.
    if let Some(beyond) = out.reach.get_mut(across + 1..) {
        beyond.fill(-1.0);
    }
}
