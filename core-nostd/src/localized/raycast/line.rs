//! The projected ray: a straight line over the image along which u, v and 1/z are linear in one parameter, *progress*.
//!
//! The line is measured from its far end (progress 0 there, -1 at the start of a ray that recedes, 1 at the end of one
//! that approaches): 1/z is then a sum of two positive numbers and keeps its relative precision from 1 mm to infinity.
//!
//! Everything that decides about pixels is a monotone function of floats computed directly from integers, so tiles and
//! pixels agree to the last bit: do not rearrange.

use glam::Vec3;

use crate::ground::geometry::Ray;
use crate::ground::math;
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// Nothing is seen nearer than this, metres.
const NEAR: f32 = 1e-3;
/// Rays are not followed farther than this, metres.
const FARTHEST: f32 = 1e6;

/// One image axis of the line.
#[derive(Clone, Copy)]
struct Axis {
    /// Position at progress 0, in pixels, with pixel k spanning k to k + 1.
    base: f32,
    /// Position where the line starts. No boundary beyond it is crossed before: its crossing rounds to the start exactly.
    first: f32,
    /// Pixels per unit of progress.
    step: f32,
    /// Pixels of the image along this axis.
    len: usize,
}

impl Axis {
    /// Progress at which the line crosses boundary `k`. Monotone in `k`, since subtraction and division round monotonely.
    fn crossing(&self, k: usize) -> f32 {
        if self.step == 0.0 { f32::INFINITY } else { (k as f32 - self.base) / self.step }
    }

    /// The tile that holds a pixel: first and one past the last pixel.
    fn span(&self, pixel: usize, tile: usize) -> (usize, usize) {
        // A tile's side is a power of two.
        let from = pixel & !(tile - 1);
        (from, (from + tile).min(self.len))
    }

    /// Progress at which the line leaves a span.
    fn exit(&self, span: (usize, usize)) -> f32 {
        self.crossing(if self.step > 0.0 { span.1 } else { span.0 })
    }

    /// The pixel after leaving a span; `None` outside the image.
    fn after(&self, span: (usize, usize)) -> Option<usize> {
        if self.step > 0.0 { Some(span.1).filter(|&k| k < self.len) } else { span.0.checked_sub(1) }
    }

    /// The pixel, within a span, that the line is in when `limit` is reached: past all crossings below the limit (and
    /// those at it, when `inclusive`), starting from `pixel`.
    fn advance(&self, pixel: usize, span: (usize, usize), limit: f32, inclusive: bool) -> usize {
        let crossed = |k: usize| {
            let at = self.crossing(k);
            if inclusive { at <= limit } else { at < limit }
        };
        // A guess by multiplication, put right by the very comparisons that a walk pixel by pixel makes.
        let guess = (self.base + limit * self.step) as usize;
        let last = span.1.saturating_sub(1);
        if self.step > 0.0 {
            let mut at = guess.min(last).max(pixel);
            while at > pixel && !crossed(at) {
                at -= 1;
            }
            while at < last && crossed(at + 1) {
                at += 1;
            }
            at
        } else if self.step < 0.0 {
            let mut at = guess.min(pixel).max(span.0);
            while at < pixel && !crossed(at + 1) {
                at += 1;
            }
            while at > span.0 && crossed(at) {
                at -= 1;
            }
            at
        } else {
            pixel
        }
    }
}

/// Where the line leaves the square tile that holds a pixel.
pub(super) struct Exit {
    columns: (usize, usize),
    rows: (usize, usize),
    /// Progress there, or at the line's end when it ends in the tile.
    pub(super) progress: f32,
    /// Through which side; `None` when the line ends in the tile.
    side: Option<Side>,
}

#[derive(Clone, Copy, PartialEq)]
enum Side {
    Column,
    Row,
}

impl Exit {
    /// The line ends in the tile.
    pub(super) const fn ends(&self) -> bool {
        self.side.is_none()
    }
}

/// The visible part of a ray.
pub(super) struct Line {
    u: Axis,
    v: Axis,
    /// Progress at the start: -1 for a ray that recedes, 0 for one that approaches.
    pub(super) start: f32,
    /// Progress at the end: `start + 1`.
    pub(super) end: f32,
    /// 1/z at progress 0, the far end, 1/metres.
    inverse_z: f32,
    /// What 1/z gains towards the near end; not negative.
    inverse_z_span: f32,
    /// Distance along the ray at the near end, and from there to the far end (negative when the ray approaches), metres.
    distance: f32,
    distance_span: f32,
    /// The ray goes on where the line ends.
    pub(super) left_view: bool,
}

impl Line {
    /// Clips the ray to the view; `None` when nothing is left.
    pub(super) fn new<D: DepthSample>(frame: &DepthFrame<'_, D>, ray: &Ray, max_distance: f32) -> Option<Self> {
        let (width, height) = frame.size();
        if width == 0 || height == 0 {
            return None;
        }
        let (w, h) = (width as f32, height as f32);
        let pose = frame.pose_or_identity();
        let (o, d) = (pose.to_camera(ray.origin()), pose.direction_to_camera(ray.direction()));
        let k = frame.intrinsics();
        // Positions and their rates of change, against each wall of the view: not negative inside.
        let walls = |p: Vec3| {
            let (left, top) = (k.fx() * p.x + (k.cx() + 0.5) * p.z, k.fy() * p.y + (k.cy() + 0.5) * p.z);
            [left, w * p.z - left, top, h * p.z - top, p.z]
        };
        let longest = if max_distance > 0.0 { max_distance.min(FARTHEST) } else { 0.0 };
        let (mut t0, mut t1) = (0.0_f32, longest);
        for (i, (at, rate)) in walls(o).into_iter().zip(walls(d)).enumerate() {
            let at = if i == 4 { at - NEAR } else { at };
            if !(at.is_finite() && rate.is_finite()) || (rate == 0.0 && at < 0.0) {
                return None;
            }
            if rate > 0.0 {
                t0 = t0.max(-at / rate);
            } else if rate < 0.0 {
                t1 = t1.min(-at / rate);
            }
        }
        // Also `None` for NaN.
        if !(t0 <= t1) {
            return None;
        }
        let project = |t: f32| {
            let p = o + d * t;
            let z = p.z.max(NEAR);
            let u = math::clamp(k.fx() * (p.x / z) + k.cx() + 0.5, 0.0, w);
            let v = math::clamp(k.fy() * (p.y / z) + k.cy() + 0.5, 0.0, h);
            (u, v, 1.0 / z)
        };
        let (first, last) = (project(t0), project(t1));
        let (step_u, step_v) = (last.0 - first.0, last.1 - first.1);
        let recedes = last.2 <= first.2;
        let (far, near, start) = if recedes { (last, first, -1.0) } else { (first, last, 0.0) };
        let line = Self {
            u: Axis { base: far.0, first: first.0, step: step_u, len: width },
            v: Axis { base: far.1, first: first.1, step: step_v, len: height },
            start,
            end: start + 1.0,
            inverse_z: far.2,
            inverse_z_span: near.2 - far.2,
            distance: if recedes { t0 } else { t1 },
            distance_span: if recedes { t1 - t0 } else { t0 - t1 },
            left_view: t1 < longest,
        };
        let numbers = [far.0, far.1, step_u, step_v, far.2, line.inverse_z_span];
        (far.2 > 0.0 && numbers.iter().all(|n| n.is_finite())).then_some(line)
    }

    /// 1/z in 1/metres. Monotone on the line.
    pub(super) fn inverse_z(&self, progress: f32) -> f32 {
        self.inverse_z + progress.abs() * self.inverse_z_span
    }

    /// Metres along the optical axis. Monotone on the line.
    pub(super) fn z(&self, progress: f32) -> f32 {
        1.0 / self.inverse_z(progress)
    }

    /// Change of 1/z per unit of progress, with its sign.
    pub(super) fn inverse_z_step(&self) -> f32 {
        if self.start < 0.0 { -self.inverse_z_span } else { self.inverse_z_span }
    }

    /// Where the line is at depth `z`; any number when it never is: clamp it.
    pub(super) fn progress_at(&self, z: f32) -> f32 {
        let progress = (1.0 / z - self.inverse_z) / self.inverse_z_step();
        if progress.is_nan() { self.start } else { progress }
    }

    /// Metres from the ray's origin. Counted from the near end: the far one may be a million metres away.
    pub(super) fn distance(&self, progress: f32) -> f32 {
        let share = (1.0 - progress.abs()) * self.inverse_z / self.inverse_z(progress);
        self.distance + share * self.distance_span
    }

    /// Pixels per unit of progress.
    pub(super) const fn step(&self) -> (f32, f32) {
        (self.u.step, self.v.step)
    }

    /// Position at a progress, in pixels from a pixel's centre.
    pub(super) fn offset(&self, progress: f32, pixel: (usize, usize)) -> (f32, f32) {
        let along = |axis: &Axis, pixel: usize| axis.base - (pixel as f32 + 0.5) + progress * axis.step;
        (along(&self.u, pixel.0), along(&self.v, pixel.1))
    }

    /// The pixel in which the line starts.
    pub(super) fn first_pixel(&self) -> (usize, usize) {
        let along = |axis: &Axis| (axis.first as usize).min(axis.len.saturating_sub(1));
        (along(&self.u), along(&self.v))
    }

    /// The end of the way through the tile (side a power of two) that holds a pixel. Crossings are taken in the order of
    /// their progress, a column before a row; those at or after the line's end are not taken.
    pub(super) fn exit(&self, at: (usize, usize), tile: usize) -> Exit {
        let (columns, rows) = (self.u.span(at.0, tile), self.v.span(at.1, tile));
        let (pu, pv) = (self.u.exit(columns), self.v.exit(rows));
        let (progress, side) = if !(pu < self.end || pv < self.end) {
            (self.end, None)
        } else if pu <= pv {
            (pu, Some(Side::Column))
        } else {
            (pv, Some(Side::Row))
        };
        Exit { columns, rows, progress, side }
    }

    /// The next pixel after an exit from a tile of one pixel; `None` when the line ends or leaves the image.
    pub(super) fn next(&self, at: (usize, usize), exit: &Exit) -> Option<(usize, usize)> {
        match exit.side? {
            Side::Column => Some((self.u.after(exit.columns)?, at.1)),
            Side::Row => Some((at.0, self.v.after(exit.rows)?)),
        }
    }

    /// As [`Self::next`] for a tile of any size, and how many of its pixels are passed.
    pub(super) fn leap(&self, at: (usize, usize), exit: &Exit) -> (Option<(usize, usize)>, u32) {
        let last = |axis: &Axis, span: (usize, usize)| if axis.step > 0.0 { span.1.saturating_sub(1) } else { span.0 };
        let column = match exit.side {
            Some(Side::Column) => last(&self.u, exit.columns),
            side => self.u.advance(at.0, exit.columns, exit.progress, side.is_some()),
        };
        let row = match exit.side {
            Some(Side::Row) => last(&self.v, exit.rows),
            _ => self.v.advance(at.1, exit.rows, exit.progress, false),
        };
        let pixels = 1 + column.abs_diff(at.0) + row.abs_diff(at.1);
        (self.next((column, row), exit), pixels as u32)
    }
}
