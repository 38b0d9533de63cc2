//! Step 2: each block joins the neighbours that lie on its plane, and the joint plane becomes a normal.

use super::Context;
use super::blocks::BlockRow;
use crate::ground::math;
use crate::sensing::depth::DepthSample;

/// Numbers kept per window.
pub(super) const WINDOW_FIELDS: usize = 8;

/// One row of windows, one per block, with an empty one at either end.
pub(super) struct WindowRow<'a> {
    /// The plane: value in the block's middle, slopes.
    pub(super) c: &'a mut [f32],
    pub(super) a: &'a mut [f32],
    pub(super) b: &'a mut [f32],
    /// Unit normal.
    pub(super) nx: &'a mut [f32],
    pub(super) ny: &'a mut [f32],
    pub(super) nz: &'a mut [f32],
    /// Predicted RMS error of the direction, radians.
    pub(super) sigma: &'a mut [f32],
    /// How far from the plane a pixel may lie and still belong to it; negative where there is no window.
    pub(super) reach: &'a mut [f32],
}

impl<'a> WindowRow<'a> {
    pub(super) fn new(storage: &'a mut [f32], cells: usize) -> Self {
        let mut parts = storage.chunks_mut(cells.max(1));
        let mut next = || parts.next().unwrap_or_default();
        let mut row =
            Self { c: next(), a: next(), b: next(), nx: next(), ny: next(), nz: next(), sigma: next(), reach: next() };
        row.clear();
        row
    }

    pub(super) fn clear(&mut self) {
        self.reach.fill(-1.0);
    }
}

/// Sums of the joint fit, relative to the block's own plane and middle.
#[derive(Clone, Copy, Default)]
struct Joint {
    n: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    r: f32,
    xr: f32,
    yr: f32,
}

/// Pixels farther than this many standard deviations from a plane do not belong to it.
const REACH: f32 = 3.5;

/// One block's numbers.
#[derive(Clone, Copy)]
struct Block {
    n: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    c: f32,
    a: f32,
    b: f32,
    q: f32,
}

impl BlockRow<'_> {
    #[inline(always)]
    fn get(&self, i: usize) -> Option<Block> {
        Some(Block {
            n: *self.n.get(i)?,
            x: *self.x.get(i)?,
            y: *self.y.get(i)?,
            xx: *self.xx.get(i)?,
            xy: *self.xy.get(i)?,
            yy: *self.yy.get(i)?,
            c: *self.c.get(i)?,
            a: *self.a.get(i)?,
            b: *self.b.get(i)?,
            q: *self.q.get(i)?,
        })
    }
}

impl Joint {
    /// Adds block `j`, whose middle is (dx, dy) pixels away, when its plane agrees with block `i`'s: half way between the two
    /// within 3 standard deviations, and in slope within 4.
    #[inline(always)]
    fn add<const B: usize>(&mut self, i: &Block, j: &Block, dx: f32, dy: f32) {
        let per_slope = 12.0 / ((B * B - 1) as f32);
        let dc = j.c - i.c - i.a * dx - i.b * dy;
        let (da, db) = (j.a - i.a, j.b - i.b);
        let half_way = dc - 0.5 * (da * dx + db * dy);
        let q = i.q + j.q;
        let value_agrees = half_way * half_way < 9.0 * q * (1.0 + 0.25 * per_slope * (dx * dx + dy * dy));
        let slope_agrees = da * da + db * db < 16.0 * q * per_slope;
        let m = if value_agrees & slope_agrees { 1.0 } else { 0.0 };
        let n = m * j.n;
        let (x, y) = (m * j.x, m * j.y);
        let (xx, xy, yy) = (m * j.xx, m * j.xy, m * j.yy);
        // Block j's readings relative to plane i, by way of plane j.
        let r = dc * n + da * x + db * y;
        self.n += n;
        self.x += x + n * dx;
        self.y += y + n * dy;
        self.xx += xx + dx * (2.0 * x + n * dx);
        self.xy += xy + dx * y + dy * x + n * dx * dy;
        self.yy += yy + dy * (2.0 * y + n * dy);
        self.r += r;
        self.xr += dx * r + dc * x + da * xx + db * xy;
        self.yr += dy * r + dc * y + da * xy + db * yy;
    }
}

/// Joins the windows of the middle row.
pub(super) fn join<D: DepthSample, const B: usize>(
    context: &Context<'_, '_, D>,
    row: usize,
    [above, middle, below]: [&BlockRow<'_>; 3],
    out: &mut WindowRow<'_>,
) {
    out.clear();
    let k = context.frame.intrinsics();
    let side = B as f32;
    let half = (side - 1.0) / 2.0;
    let dy = row as f32 * side + half - k.cy();
    for i in 1..=context.across {
        let Some(own) = middle.get(i).filter(|b| b.n > 0.0) else { continue };
        let mut joint = Joint::default();
        for (line, oy) in [(above, -side), (middle, 0.0), (below, side)] {
            for (at, ox) in [(i - 1, -side), (i, 0.0), (i + 1, side)] {
                if let Some(other) = line.get(at) {
                    joint.add::<B>(&own, &other, ox, oy);
                }
            }
        }
        let inv = 1.0 / joint.n;
        let (mx, my, mr) = (joint.x * inv, joint.y * inv, joint.r * inv);
        let (xx, xy, yy) = (joint.xx - joint.x * mx, joint.xy - joint.x * my, joint.yy - joint.y * my);
        let (xr, yr) = (joint.xr - joint.x * mr, joint.yr - joint.y * mr);
        let inv_det = 1.0 / (xx * yy - xy * xy);
        let da = (xr * yy - yr * xy) * inv_det;
        let db = (yr * xx - xr * xy) * inv_det;
        let (a, b) = (own.a + da, own.b + db);
        let c = own.c + mr - da * mx - db * my;
        let dx = (i - 1) as f32 * side + half - k.cx();
        let [nx, ny, nz] = super::super::facing(c, a, b, dx, dy, k.fx(), k.fy());
        // Error of the slopes, carried to the direction: the larger of its parts is f da against the vector's length.
        let variance = own.q * own.n;
        let length = -nz_length(c, a, b, dx, dy, k.fx(), k.fy());
        let spread = variance * inv_det * (k.fx() * k.fx() * yy + k.fy() * k.fy() * xx);
        let sigma = math::sqrt(spread.max(0.0)) / length.max(f32::MIN_POSITIVE);
        for (field, value) in [
            (&mut *out.c, c),
            (&mut *out.a, a),
            (&mut *out.b, b),
            (&mut *out.nx, nx),
            (&mut *out.ny, ny),
            (&mut *out.nz, nz),
            (&mut *out.sigma, sigma),
            (&mut *out.reach, REACH * math::sqrt(variance)),
        ] {
            if let Some(cell) = field.get_mut(i) {
                *cell = value;
            }
        }
    }
}

/// Minus the length of the unnormalised normal.
fn nz_length(c: f32, a: f32, b: f32, dx: f32, dy: f32, fx: f32, fy: f32) -> f32 {
    let nz = a * dx + b * dy - c;
    -math::sqrt(fx * a * fx * a + fy * b * fy * b + nz * nz)
}
