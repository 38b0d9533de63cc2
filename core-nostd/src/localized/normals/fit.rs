//! The wide fit: least squares of inverse depth over the pixels around a point that lie on its surface.
//!
//! 1.2 kB of stack. With vector units the sums run down the columns of a patch of fixed width, each column a lane; without,
//! column after column: the same sums in the same order, in registers, to the same bits. They are of distances from the last
//! plane, whose squares say at once whether a pixel belongs to it.

use glam::Vec3;

use super::{MAX_RADIUS, NormalEstimate, facing};
use crate::ground::lanes::VECTORS;
use crate::ground::math;
use crate::ground::regression::Sums;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// Side of the patch: the widest window, padded to whole vectors.
const SIDE: usize = (2 * MAX_RADIUS as usize + 1).next_multiple_of(8);

/// Inverse depth relative to the centre's (0 at the centre, NaN in holes and where no surface leads), so that the sums lose no
/// digits. Row by row; on targets without vector units column by column, which is how they are read there.
struct Patch {
    w: [[f32; SIDE]; SIDE],
    columns: usize,
    rows: usize,
    /// Pixels to the left of the centre, and above it.
    left: usize,
    above: usize,
}

/// Value at the centre and slopes, RMS residual, pixels.
#[derive(Clone, Copy)]
struct Fit {
    plane: (f32, f32, f32),
    rms: f32,
    n: f32,
}

/// Which pixels a fit is made of.
struct Rule {
    /// This plane (value at the centre, slopes) and the square of the largest distance from it.
    plane: (f32, f32, f32),
    squared: f32,
    /// At most this many pixels from the centre, the larger of across and down.
    within: usize,
}

/// How far from the centre's inverse depth (as a share of it) a pixel of its surface may be that lies `offset` pixels away.
#[inline(always)]
fn reach(max_step: f32, offset: f32) -> f32 {
    SLACK + max_step * math::max(offset.abs(), 1.0)
}

/// Offset in pixels of number `i` from number `of`.
#[inline(always)]
fn offset(i: usize, of: usize) -> f32 {
    (i as i32 - of as i32) as f32
}

impl Patch {
    /// No pixels. Padding is only ever read by vectors.
    fn new() -> Self {
        let padding = if VECTORS { f32::NAN } else { 0.0 };
        Self { w: [[padding; SIDE]; SIDE], columns: 0, rows: 0, left: 0, above: 0 }
    }

    /// The window around a pixel. In place: a kilobyte is not worth moving.
    fn gather<D: DepthSample>(
        &mut self,
        frame: &DepthFrame<'_, D>,
        x: usize,
        y: usize,
        radius: u8,
        max_step: f32,
    ) -> Option<()> {
        let depth = frame.depth();
        let centre = depth.get(x, y).filter(|v| v.is_valid())?.number();
        let r = usize::from(radius);
        let (x0, y0) = (x.saturating_sub(r), y.saturating_sub(r));
        let window = depth.crop(x0, y0, x + r + 1 - x0, y + r + 1 - y0);
        (self.columns, self.rows) = window.size();
        (self.left, self.above) = (x - x0, y - y0);
        // Not centre / number - 1: at f = 10,000 px neighbours differ in the fifth digit, and this difference is exact.
        let share = |value: D| (centre - value.number()) / value.number();
        // How far a pixel may be off goes with the larger of its distances across and down.
        let by_column: [f32; SIDE] =
            if VECTORS { core::array::from_fn(|i| reach(max_step, offset(i, self.left))) } else { [0.0; SIDE] };
        for (j, row) in window.rows().enumerate() {
            let by_row = reach(max_step, offset(j, self.above));
            if VECTORS {
                let line = self.w.get_mut(j)?;
                for (w, &value) in line.iter_mut().zip(row) {
                    if value.is_valid() {
                        *w = share(value);
                    }
                }
                for (w, &by_column) in line.iter_mut().zip(&by_column) {
                    *w = if w.abs() <= math::max(by_row, by_column) { *w } else { f32::NAN };
                }
            } else {
                for (i, (column, &value)) in self.w.iter_mut().zip(row).enumerate() {
                    let share = if value.is_valid() { share(value) } else { f32::NAN };
                    let reached = share.abs() <= by_row || share.abs() <= reach(max_step, offset(i, self.left));
                    *column.get_mut(j)? = if reached { share } else { f32::NAN };
                }
            }
        }
        Some(())
    }

    /// Sums over what lies within the rule's tolerance of its plane, of the distance from it. Down the columns, row by row, every
    /// column a lane.
    fn by_rows(&self, rule: &Rule) -> Sums {
        let &Rule { plane: (c, a, b), squared, within } = rule;
        let dx: [f32; SIDE] = core::array::from_fn(|i| offset(i, self.left));
        // Too far aside: NaN, from which everything is too far.
        let centre: [f32; SIDE] = dx.map(|dx| if dx.abs() <= within as f32 { c + a * dx } else { f32::NAN });
        let mut lanes = [[0.0_f32; SIDE]; 6];
        let (first, last) = (self.above.saturating_sub(within), (self.above + within + 1).min(self.rows));
        for (j, line) in self.w.iter().enumerate().take(last).skip(first) {
            let dy = offset(j, self.above);
            let tilt = b * dy;
            let [n, y, yy, w, yw, ww] = &mut lanes;
            for i in 0..SIDE {
                #[expect(clippy::indexing_slicing, reason = "i < SIDE, the length of every array here; checks vanish")]
                {
                    let off = line[i] - centre[i] - tilt;
                    // False for NaN: holes and padding drop out.
                    let keep = off * off <= squared;
                    let one = if keep { 1.0 } else { 0.0 };
                    let off = if keep { off } else { 0.0 };
                    n[i] += one;
                    y[i] += one * dy;
                    yy[i] += one * (dy * dy);
                    w[i] += off;
                    yw[i] += off * dy;
                    ww[i] += off * off;
                }
            }
        }
        let [cn, cy, cyy, cw, cyw, cww] = &lanes;
        let total = |column: &[f32; SIDE]| column.iter().fold(0.0, |sum, v| sum + v);
        let moment = |column: &[f32; SIDE]| column.iter().zip(&dx).fold(0.0, |sum, (v, dx)| sum + v * dx);
        Sums {
            n: total(cn),
            x: moment(cn),
            y: total(cy),
            w: total(cw),
            xx: cn.iter().zip(&dx).fold(0.0, |sum, (n, dx)| sum + n * (dx * dx)),
            xy: moment(cy),
            yy: total(cyy),
            xw: moment(cw),
            yw: total(cyw),
            ww: total(cww),
        }
    }

    /// The same sums in the same order, one column after the other, in registers. Nearly everything is let in: the moments of
    /// position are those of the whole column less what is left out (whole numbers, so in any order the same).
    fn by_columns(&self, rule: &Rule) -> Sums {
        let &Rule { plane: (c, a, b), squared, within } = rule;
        let (first, last) = (self.above.saturating_sub(within), (self.above + within + 1).min(self.rows));
        // What is the same in every column: the offset and the plane's rise.
        let mut lines = [[0.0; 2]; SIDE];
        let lines = lines.get_mut(first..last).unwrap_or_default();
        let (mut all_y, mut all_yy) = (0.0, 0.0);
        for (j, line) in lines.iter_mut().enumerate() {
            let dy = offset(j + first, self.above);
            *line = [dy, b * dy];
            all_y += dy;
            all_yy += dy * dy;
        }
        let all = lines.len() as f32;
        let mut sums = Sums::default();
        let (left, right) = (self.left.saturating_sub(within), (self.left + within + 1).min(self.columns));
        for (i, column) in self.w.iter().enumerate().take(right).skip(left) {
            let dx = offset(i, self.left);
            let centre = c + a * dx;
            let (mut n, mut y, mut yy) = (all, all_y, all_yy);
            let (mut w, mut yw, mut ww) = (0.0, 0.0, 0.0);
            for (&value, &mut [dy, tilt]) in column.get(first..last).unwrap_or(&[]).iter().zip(&mut *lines) {
                let off = value - centre - tilt;
                let square = off * off;
                if square <= squared {
                    w += off;
                    yw += off * dy;
                    ww += square;
                } else {
                    n -= 1.0;
                    y -= dy;
                    yy -= dy * dy;
                }
            }
            sums.n += n;
            sums.x += n * dx;
            sums.y += y;
            sums.w += w;
            sums.xx += n * (dx * dx);
            sums.xy += y * dx;
            sums.yy += yy;
            sums.xw += w * dx;
            sums.yw += yw;
            sums.ww += ww;
        }
        sums
    }

    /// Least squares over the pixels that `rule` lets in; `None` when they do not span a plane.
    fn solve(&self, rule: &Rule) -> Option<Fit> {
        let sums = if VECTORS { self.by_rows(rule) } else { self.by_columns(rule) };
        let turn = sums.solve()?;
        let (c, a, b) = rule.plane;
        // Three numbers were fitted: n - 3 are left to tell the noise.
        let variance = turn.squares / math::max(sums.n - 3.0, 1.0);
        Some(Fit { plane: (c + turn.c, a + turn.a, b + turn.b), rms: variance * math::inv_sqrt(variance), n: sums.n })
    }
}

/// Share of the centre's inverse depth that noise alone may move a neighbour by: twice a Kinect's at 8 m.
const SLACK: f32 = 0.02;
/// Tangent of the steepest surface (against the line of sight) that is followed by default: 80 degrees.
const STEEPEST: f32 = 5.67;

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
    let max_step = max_step.unwrap_or(STEEPEST / math::min(k.fx().abs(), k.fy().abs()));
    // Less than nothing is nothing.
    let max_step = if max_step < 0.0 { 0.0 } else { max_step };
    let mut patch = Patch::new();
    patch.gather(frame, x, y, radius.min(MAX_RADIUS), max_step)?;
    let mut fit = patch.solve(&Rule { plane: (0.0, 0.0, 0.0), squared: f32::INFINITY, within: 2 })?;
    for _ in 0..2 {
        // Rounding alone leaves 2e-6 even on a perfect plane.
        let tolerance = 3.0 * fit.rms + 2e-6;
        let rule = Rule { plane: fit.plane, squared: tolerance * tolerance, within: radius.into() };
        match patch.solve(&rule) {
            Some(better) => fit = better,
            None => break,
        }
    }
    let (c, a, b) = fit.plane;
    let (dx, dy) = (x as f32 - k.cx(), y as f32 - k.cy());
    let normal = Vec3::from(facing(1.0 + c, a, b, dx, dy, k.fx(), k.fy()));
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
            (columns, rows, within) in (1..SIDE, 1..SIDE, 1_usize..8),
            (left, above) in (0_usize..8, 0_usize..8),
        ) {
            let value = |i: usize, j: usize| {
                let k = (j * 5 + i * 3) % 32;
                if i >= columns || j >= rows || holes >> k & 1 == 1 { f32::NAN } else { values[k] }
            };
            let w = core::array::from_fn(|j| core::array::from_fn(|i| value(i, j)));
            let turned = core::array::from_fn(|i| core::array::from_fn(|j| value(i, j)));
            let (a, b) = (Patch { w, columns, rows, left, above }, Patch { w: turned, columns, rows, left, above });
            for squared in [f32::INFINITY, 0.05 * 0.05] {
                let rule = Rule { plane: plane.into(), squared, within };
                prop_assert_eq!(a.by_rows(&rule), b.by_columns(&rule));
            }
        }
    }
}
