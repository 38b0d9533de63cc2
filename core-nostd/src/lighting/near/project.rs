//! A view's points onto its layer: a distance buffer that remembers which pixel won.
//!
//! A cell holds, from the top bit down, the distance from the map's place in equal steps and the number of the view's pixel: the least value is
//! the nearest point, of two as near the one that comes first in the view. So the order of points does not matter, and a layer is merged, reduced and coloured
//! later by this number alone. With views of 2^20 pixels a step is 0.4 mm of a 2 m cube, with smaller views less.
//!
//! Where a view is much finer than the layer, every second or fourth point in both directions is enough ([`NearParams::thin`](super::NearParams)): decided
//! for each run of a row by its point nearest to the map's vertical axis.
//!
//! Thirty-two points at a time: no square roots, no arc functions, no branches but "none of these is inside".

use super::NOWHERE;
use super::view::View;
use crate::ground::lanes::vectorised;
use crate::ground::math;
use crate::lighting::equirect::{MapFrame, half_turn, turns_of};
use glam::{Vec2, Vec3};

/// A cell without points.
pub(super) const EMPTY: u32 = u32::MAX;
/// Nearer than this (metres, squared) a point has no direction to speak of.
const NO_DIRECTION: f32 = 1e-8;

/// The geometry of a layer.
pub(super) struct Layer {
    /// Width and height.
    pub(super) size: (usize, usize),
    /// Half the boundary's side, metres.
    pub(super) half_side: f32,
    /// Bits of a cell that say which pixel.
    pub(super) pixel_bits: u32,
    /// Points may be so many pixels apart.
    pub(super) thin: f32,
}

/// What a projection did.
pub(super) struct Projected {
    /// Points looked at that are inside the boundary.
    pub(super) inside: usize,
    /// Pixels not looked at, as their neighbours are close enough to one another.
    pub(super) skipped: usize,
    /// First and last cell written.
    pub(super) span: (usize, usize),
}

/// Points worked on at a time: long enough for loops to be vectorised, short enough to skip what is outside.
const RUN: usize = 32;
/// Runs in a row for which it is remembered how far apart points may be.
const RUNS: usize = 64;

/// Points in a row of the view.
struct Run {
    /// From the map's place, map's axes.
    p: [[f32; RUN]; 3],
    /// 1 inside the boundary, else 0.
    within: [u32; RUN],
    /// Squared distances from the map's place.
    square: [f32; RUN],
    /// 1 / distance from the vertical axis, then where in the layer; beyond its end for what is outside.
    axis: [f32; RUN],
    cell: [u32; RUN],
    /// What is to be held there.
    key: [u32; RUN],
}

impl Layer {
    /// Distance steps in a metre.
    pub(super) fn steps(&self) -> f32 {
        let most = EMPTY >> self.pixel_bits;
        // The farthest point is in a corner.
        (most - 1) as f32 / (self.half_side * 1.733)
    }

    /// Projects a view's depth onto the cells.
    pub(super) fn project(&self, view: &View, depth: &[u16], map: &MapFrame, cells: &mut [u32]) -> Projected {
        vectorised(|| self.rows(view, depth, map, cells))
    }

    #[inline(always)]
    fn rows(&self, view: &View, depth: &[u16], map: &MapFrame, cells: &mut [u32]) -> Projected {
        let (turn, origin) = map.of_camera(&view.pose);
        let step = turn * Vec3::X / view.intrinsics.fx();
        let unit = view.unit.metres();
        // A point is `depth / focal` from its neighbour, and a pixel of the layer as wide as an angle times the distance.
        let focal = view.intrinsics.fx().min(view.intrinsics.fy());
        let wide = self.thin * core::f32::consts::TAU / self.size.0 as f32 * focal / unit;
        let wide = wide * wide;
        let mut done = Projected { inside: 0, skipped: 0, span: NOWHERE };
        let mut run = Run {
            p: [[0.0; RUN]; 3],
            within: [0; RUN],
            square: [0.0; RUN],
            axis: [0.0; RUN],
            cell: [0; RUN],
            key: [0; RUN],
        };
        let mut apart = [1_usize; RUNS];
        for (y, row) in depth.chunks(view.width.max(1)).enumerate() {
            let first = turn * view.intrinsics.ray(Vec2::new(0.0, y as f32));
            let mut number = (y * view.width) as u32;
            for (block, values) in row.chunks(RUN).enumerate() {
                let start = number;
                number += values.len() as u32;
                let known = apart.get(block).copied().unwrap_or(1).max(1);
                if y % known != 0 {
                    done.skipped += values.len();
                    continue;
                }
                let mut part = [0; RUN];
                let values = match values.first_chunk::<RUN>() {
                    Some(all) => all,
                    None => {
                        for (to, from) in part.iter_mut().zip(values) {
                            *to = *from;
                        }
                        &part
                    }
                };
                let ray = first + step * ((block * RUN) as f32);
                let count = self.points(&mut run, values, unit, origin, ray, step);
                if count == 0 {
                    if let Some(apart) = apart.get_mut(block) {
                        *apart = 1;
                    }
                    continue;
                }
                done.inside += count as usize;
                let stride = match apart.get_mut(block) {
                    Some(apart) => {
                        *apart = run.stride(values, wide).min(if y % 4 == 0 { 4 } else { 2 - y % 2 });
                        *apart
                    }
                    None => 1,
                };
                match stride {
                    4 => self.put::<{ RUN / 4 }>(&mut run, start, cells, &mut done),
                    2 => self.put::<{ RUN / 2 }>(&mut run, start, cells, &mut done),
                    _ => self.put::<RUN>(&mut run, start, cells, &mut done),
                }
            }
        }
        done
    }

    /// Points from the map's place, and which are inside; how many are.
    #[inline(always)]
    fn points(&self, run: &mut Run, depth: &[u16; RUN], unit: f32, origin: Vec3, first: Vec3, step: Vec3) -> u32 {
        let half = self.half_side;
        let [xs, ys, zs] = &mut run.p;
        let out = xs.iter_mut().zip(ys).zip(zs).zip(run.within.iter_mut().zip(&mut run.square));
        for (i, (d, (((x, y), z), (within, square)))) in depth.iter().zip(out).enumerate() {
            let depth = f32::from(*d) * unit;
            let along = i as f32;
            *x = origin.x + depth * (first.x + along * step.x);
            *y = origin.y + depth * (first.y + along * step.y);
            *z = origin.z + depth * (first.z + along * step.z);
            *square = *x * *x + *z * *z + *y * *y;
            let inside = (x.abs() <= half) & (y.abs() <= half) & (z.abs() <= half) & (*d != 0);
            *within = u32::from(inside);
        }
        run.within.iter().sum()
    }

    /// Every so many points, such that `COUNT` remain, into the layer.
    #[inline(always)]
    fn put<const COUNT: usize>(&self, run: &mut Run, number: u32, cells: &mut [u32], done: &mut Projected) {
        let stride = RUN / COUNT;
        if stride > 1 {
            run.thin::<COUNT>();
            done.skipped += RUN - COUNT;
        }
        self.address::<COUNT>(run, number, stride as u32);
        for (at, key) in run.cell.iter().zip(&run.key).take(COUNT) {
            if let Some(held) = cells.get_mut(*at as usize) {
                *held = if *key < *held { *key } else { *held };
                done.span = (done.span.0.min(*at as usize), done.span.1.max(*at as usize));
            }
        }
    }

    /// Where the first `COUNT` points lie in the layer, and what they are there. In short loops: in one, the numbers don't fit into registers.
    #[inline(always)]
    fn address<const COUNT: usize>(&self, run: &mut Run, number: u32, stride: u32) {
        let (width, height) = (self.size.0 as i32, self.size.1 as i32);
        let (across, down) = (self.size.0 as f32, 2.0 * self.size.1 as f32);
        let (steps, bits) = (self.steps(), self.pixel_bits);
        let [xs, ys, zs] = &run.p;
        let (Some(xs), Some(ys), Some(zs)) = (front::<COUNT, _>(xs), front::<COUNT, _>(ys), front::<COUNT, _>(zs))
        else {
            return;
        };
        let (Some(within), Some(squares)) = (front::<COUNT, _>(&run.within), front::<COUNT, _>(&run.square)) else {
            return;
        };
        let (Some(axes), Some(cells)) = (run.axis.first_chunk_mut::<COUNT>(), run.cell.first_chunk_mut::<COUNT>())
        else {
            return;
        };
        let Some(keys) = run.key.first_chunk_mut::<COUNT>() else { return };
        for ((x, z), (axis, cell)) in xs.iter().zip(zs).zip(axes.iter_mut().zip(cells.iter_mut())) {
            let s = x * x + z * z;
            *axis = s * math::inv_sqrt_fast(s);
            let column = whole((0.5 + turns_of(*x, -*z)) * across);
            *cell = (if column >= width { 0 } else { column }) as u32;
        }
        let points = ys.iter().zip(axes.iter()).zip(within.iter().zip(squares));
        for (((y, axis), (within, square)), cell) in points.zip(cells.iter_mut()) {
            let line = whole(half_turn(*axis, *y) * down);
            let line = if line >= height { height - 1 } else { line };
            let good = (*within != 0) & (*square > NO_DIRECTION);
            let at = (line * width) as u32 + *cell;
            *cell = if good { at } else { u32::MAX };
        }
        let mut number = number;
        for (square, key) in squares.iter().zip(keys) {
            let distance = whole(square * math::inv_sqrt_fast(*square) * steps) as u32;
            *key = distance << bits | number;
            number += stride;
        }
    }
}

/// The first few.
#[inline(always)]
fn front<const COUNT: usize, T>(all: &[T; RUN]) -> Option<&[T; COUNT]> {
    all.first_chunk()
}

impl Run {
    /// How many points apart still leave no pixel without, 1, 2 or 4: by the point nearest to the map's vertical axis and the one farthest from the
    /// camera.
    #[inline(always)]
    fn stride(&self, depth: &[u16; RUN], wide: f32) -> usize {
        // Over all points: what is outside or no reading can but make it smaller.
        let (mut near, mut far) = ([f32::INFINITY; 8], [0_u16; 8]);
        let [xs, _, zs] = &self.p;
        let points = xs.as_chunks::<8>().0.iter().zip(zs.as_chunks::<8>().0);
        for ((xs, zs), depths) in points.zip(depth.as_chunks::<8>().0) {
            for (near, (x, z)) in near.iter_mut().zip(xs.iter().zip(zs)) {
                // From the vertical axis: towards the poles pixels are narrower.
                let square = x * x + z * z;
                *near = if square < *near { square } else { *near };
            }
            for (far, depth) in far.iter_mut().zip(depths) {
                *far = if *depth > *far { *depth } else { *far };
            }
        }
        let near = near.into_iter().fold(f32::INFINITY, |a, b| if b < a { b } else { a });
        let far = far.into_iter().fold(0, |a, b| if b > a { b } else { a });
        let far = f32::from(far) * f32::from(far);
        let room = wide * near;
        if room >= 16.0 * far {
            4
        } else if room >= 4.0 * far {
            2
        } else {
            1
        }
    }

    /// Moves every so many points to the front.
    #[inline(always)]
    #[expect(
        clippy::indexing_slicing,
        reason = "below RUN by the loop's bounds, which are constants: no check is left"
    )]
    fn thin<const COUNT: usize>(&mut self) {
        let stride = RUN / COUNT;
        for plane in self.p.iter_mut().chain([&mut self.square]) {
            for i in 1..COUNT {
                plane[i] = plane[i * stride];
            }
        }
        for i in 1..COUNT {
            self.within[i] = self.within[i * stride];
        }
    }
}

/// The pixel of a coordinate from 0 to 2^22: the whole number below it (of a whole number itself, it or the one below: the even one).
#[inline(always)]
fn whole(x: f32) -> i32 {
    // 3 * 2^22: there, a step of `f32` is 1.
    const SHIFT: f32 = 12_582_912.0;
    (x - 0.5 + SHIFT).to_bits() as i32 - SHIFT.to_bits() as i32
}
