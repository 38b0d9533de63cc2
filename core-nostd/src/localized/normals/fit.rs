//! The wide fit: least squares of inverse depth over the pixels around a point that lie on its surface.
//!
//! 1.5 kB of stack. Sums run down the columns of a patch of fixed width, each column a lane: they vectorise without
//! reordering anything the compiler may not reorder. Without vector units, column after column: the same sums in registers.

use glam::Vec3;

use super::{MAX_RADIUS, NormalEstimate, facing};
use crate::ground::lanes::VECTORS;
use crate::ground::math;
use crate::ground::regression::Sums;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

const ROWS: usize = 2 * MAX_RADIUS as usize + 1;
/// The widest row, padded to whole vectors.
const COLUMNS: usize = ROWS.next_multiple_of(8);

/// Inverse depth relative to the centre's (0 at the centre, NaN in holes), so that the sums lose no digits.
struct Patch {
    w: [[f32; COLUMNS]; ROWS],
    rows: usize,
    /// Offset of the first pixel from the centre.
    dx: f32,
    dy: f32,
}

/// Value at the centre, slopes, RMS residual, pixels.
#[derive(Clone, Copy)]
struct Fit {
    c: f32,
    a: f32,
    b: f32,
    rms: f32,
    n: f32,
}

impl Patch {
    fn gather<D: DepthSample>(frame: &DepthFrame<'_, D>, x: usize, y: usize, radius: u8) -> Option<Self> {
        let depth = frame.depth();
        let centre = depth.get(x, y).filter(|v| v.is_valid())?.number();
        let r = usize::from(radius);
        let (x0, y0) = (x.saturating_sub(r), y.saturating_sub(r));
        let window = depth.crop(x0, y0, x + r + 1 - x0, y + r + 1 - y0);
        let mut patch = Self {
            w: [[f32::NAN; COLUMNS]; ROWS],
            rows: window.height(),
            dx: x0 as f32 - x as f32,
            dy: y0 as f32 - y as f32,
        };
        for (line, row) in patch.w.iter_mut().zip(window.rows()) {
            for (w, &value) in line.iter_mut().zip(row) {
                if value.is_valid() {
                    // Not centre / number - 1: at f = 10,000 px neighbours differ in the fifth digit, and this
                    // difference is exact.
                    *w = (centre - value.number()) / value.number();
                }
            }
        }
        Some(patch)
    }

    /// Sums down the columns, row by row, every column a lane: n, y, y², w, y w, w².
    fn by_rows(&self, rule: &Rule, dx: &[f32; COLUMNS]) -> [[f32; COLUMNS]; 6] {
        let &Rule { plane: (c, a, b), tolerance, max_step, within } = rule;
        let centre: [f32; COLUMNS] = dx.map(|dx| c + a * dx);
        let mut lanes = [[0.0_f32; COLUMNS]; 6];
        for (j, line) in self.w.iter().take(self.rows).enumerate() {
            let dy = self.dy + j as f32;
            if dy.abs() > within {
                continue;
            }
            let tilt = b * dy;
            let far = dy.abs().max(1.0);
            let [n, y, yy, w, yw, ww] = &mut lanes;
            for i in 0..COLUMNS {
                #[expect(
                    clippy::indexing_slicing,
                    reason = "i < COLUMNS, the length of every array here; checks vanish"
                )]
                {
                    let value = line[i];
                    let distance = if dx[i].abs() > far { dx[i].abs() } else { far };
                    // False for NaN: holes and padding drop out.
                    let keep = ((value - centre[i] - tilt).abs() <= tolerance)
                        & (value.abs() <= SLACK + max_step * distance)
                        & (distance <= within);
                    let one = if keep { 1.0 } else { 0.0 };
                    let value = if keep { value } else { 0.0 };
                    n[i] += one;
                    y[i] += one * dy;
                    yy[i] += one * dy * dy;
                    w[i] += value;
                    yw[i] += value * dy;
                    ww[i] += value * value;
                }
            }
        }
        lanes
    }

    /// The same sums in the same order, one column after the other: six registers instead of 96 words of memory.
    fn by_columns(&self, rule: &Rule, dx: &[f32; COLUMNS]) -> [[f32; COLUMNS]; 6] {
        let &Rule { plane: (c, a, b), tolerance, max_step, within } = rule;
        let mut lanes = [[0.0_f32; COLUMNS]; 6];
        let reach = |offset: f32| SLACK + max_step * if offset.abs() > 1.0 { offset.abs() } else { 1.0 };
        // What is the same in every column: the offset, the plane's rise, the offset's square, how far a value may be off.
        let rows: [[f32; 4]; ROWS] = core::array::from_fn(|j| {
            let dy = self.dy + j as f32;
            [dy, b * dy, dy * dy, reach(dy)]
        });
        let near = |&[dy, ..]: &[f32; 4]| dy.abs() <= within;
        let first = rows.iter().position(near).unwrap_or(ROWS);
        let count = rows.iter().take(self.rows).skip(first).take_while(|row| near(row)).count();
        let rows = rows.get(first..first + count).unwrap_or(&[]);
        let values = self.w.as_flattened().get(first * COLUMNS..).unwrap_or(&[]);
        let [n, y, yy, w, yw, ww] = &mut lanes;
        let sums = n.iter_mut().zip(y).zip(yy).zip(w).zip(yw).zip(ww);
        for (i, (&dx, (((((n, y), yy), w), yw), ww))) in dx.iter().zip(sums).enumerate() {
            if !(dx.abs() <= within && 1.0 <= within) {
                continue;
            }
            let (centre, by_column) = (c + a * dx, reach(dx));
            // In registers until the column is done.
            let mut sum = [0.0_f32; 6];
            for (&value, &[dy, tilt, square, by_row]) in values.iter().skip(i).step_by(COLUMNS).zip(rows) {
                if !((value - centre - tilt).abs() <= tolerance) {
                    continue;
                }
                // The larger distance allows more.
                if value.abs() <= by_column || value.abs() <= by_row {
                    sum[0] += 1.0;
                    sum[1] += dy;
                    sum[2] += square;
                    sum[3] += value;
                    sum[4] += value * dy;
                    sum[5] += value * value;
                }
            }
            [*n, *y, *yy, *w, *yw, *ww] = sum;
        }
        lanes
    }

    /// Least squares over the pixels that `rule` lets in; `None` when they do not span a plane.
    fn solve(&self, rule: &Rule) -> Option<Fit> {
        let dx: [f32; COLUMNS] = core::array::from_fn(|i| self.dx + i as f32);
        let lanes = if VECTORS { self.by_rows(rule, &dx) } else { self.by_columns(rule, &dx) };
        let [cn, cy, cyy, cw, cyw, cww] = &lanes;
        let total = |column: &[f32; COLUMNS]| column.iter().sum::<f32>();
        let moment = |column: &[f32; COLUMNS]| column.iter().zip(&dx).map(|(v, dx)| v * dx).sum::<f32>();
        let sums = Sums {
            n: total(cn),
            x: moment(cn),
            y: total(cy),
            w: total(cw),
            xx: cn.iter().zip(&dx).map(|(n, dx)| n * dx * dx).sum::<f32>(),
            xy: moment(cy),
            yy: total(cyy),
            xw: moment(cw),
            yw: total(cyw),
            ww: total(cww),
        };
        let plane = sums.solve()?;
        // Three numbers were fitted: n - 3 are left to tell the noise.
        let rms = math::sqrt(plane.squares / (sums.n - 3.0).max(1.0));
        Some(Fit { c: plane.c, a: plane.a, b: plane.b, rms, n: sums.n })
    }
}

/// Share of the centre's inverse depth that noise alone may move a neighbour by: twice a Kinect's at 8 m.
const SLACK: f32 = 0.02;
/// Tangent of the steepest surface (against the line of sight) that is followed by default: 80 degrees.
const STEEPEST: f32 = 5.67;

/// Which pixels a fit is made of.
struct Rule {
    /// Within `tolerance` of this plane (value at the centre, slopes).
    plane: (f32, f32, f32),
    tolerance: f32,
    /// Within this of the centre's value, per pixel of distance, besides [`SLACK`].
    max_step: f32,
    /// At most this many pixels from the centre, the larger of across and down.
    within: f32,
}

/// First the 5 x 5 pixels around the centre that are reached by steps of `max_step`; then, of the whole window, those within
/// three standard deviations of the first plane; and once more. The first plane is small so that it stays on the
/// centre's side of an edge.
pub(super) fn at<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    x: usize,
    y: usize,
    radius: u8,
    max_step: Option<f32>,
) -> Option<NormalEstimate> {
    let k = frame.intrinsics();
    let max_step = max_step.unwrap_or(STEEPEST / k.fx().abs().min(k.fy().abs()));
    // Less than nothing is nothing.
    let max_step = if max_step < 0.0 { 0.0 } else { max_step };
    let patch = Patch::gather(frame, x, y, radius.min(MAX_RADIUS))?;
    let mut rule = Rule { plane: (0.0, 0.0, 0.0), tolerance: f32::INFINITY, max_step, within: 2.0 };
    let mut fit = patch.solve(&rule)?;
    rule.within = f32::from(radius);
    for _ in 0..2 {
        rule.plane = (fit.c, fit.a, fit.b);
        // Rounding alone leaves 2e-6 even on a perfect plane.
        rule.tolerance = 3.0 * fit.rms + 2e-6;
        match patch.solve(&rule) {
            Some(better) => fit = better,
            None => break,
        }
    }
    let (dx, dy) = (x as f32 - k.cx(), y as f32 - k.cy());
    let normal = Vec3::from(facing(1.0 + fit.c, fit.a, fit.b, dx, dy, k.fx(), k.fy()));
    let z = frame.z(x, y);
    // A plane at infinity (1 + c = 0) has no direction.
    ((normal.length_squared() - 1.0).abs() < 1e-3).then_some(NormalEstimate {
        normal,
        support: fit.n as u16,
        residual: fit.rms * z,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Devices without vector units sum in the other order of loops: the same bits.
        #[test]
        fn both_ways_give_the_same_sums(
            values in proptest::array::uniform32(-0.1_f32..0.1),
            holes in any::<u32>(),
            plane in proptest::array::uniform3(-0.02_f32..0.02),
            (rows, within) in (1..=ROWS, 1_u8..8),
            (dx, dy) in (-7_i8..=0, -7_i8..=0),
        ) {
            let w = core::array::from_fn(|j| core::array::from_fn(|i| {
                let k = (j * 5 + i * 3) % 32;
                if holes >> k & 1 == 1 { f32::NAN } else { values[k] }
            }));
            let patch = Patch { w, rows, dx: dx.into(), dy: dy.into() };
            let [c, a, b] = plane;
            let columns = core::array::from_fn(|i| patch.dx + i as f32);
            for tolerance in [f32::INFINITY, 0.05] {
                let rule = Rule { plane: (c, a, b), tolerance, max_step: 0.02, within: within.into() };
                prop_assert_eq!(patch.by_rows(&rule, &columns), patch.by_columns(&rule, &columns));
            }
        }
    }
}
