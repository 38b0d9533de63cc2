//! A view's points onto its layer: a distance buffer that remembers which pixel won.
//!
//! A cell holds, from the top bit down, the distance from the map's place in equal steps and the number of the view's pixel: the least value is
//! the nearest point, of two as near the one that comes first in the view. So the order of points does not matter, and a layer is merged, reduced and coloured
//! later by this number alone. With views of 2^20 pixels a step is 0.4 mm of a 2 m cube, with smaller views less.
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
}

/// Points worked on at a time: long enough for loops to be vectorised, short enough to skip what is outside.
const RUN: usize = 32;

/// Points in a row of the view.
struct Run {
    /// From the map's place, map's axes.
    p: [[f32; RUN]; 3],
    /// 1 inside the boundary, else 0.
    within: [u32; RUN],
    /// Where in the layer; beyond its end for what is outside.
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

    /// Projects. The number of points inside the boundary, and the first and last cell written.
    pub(super) fn project(
        &self,
        view: &View,
        depth: &[u16],
        map: &MapFrame,
        cells: &mut [u32],
    ) -> (usize, (usize, usize)) {
        vectorised(|| self.rows(view, depth, map, cells))
    }

    #[inline(always)]
    fn rows(&self, view: &View, depth: &[u16], map: &MapFrame, cells: &mut [u32]) -> (usize, (usize, usize)) {
        let (turn, origin) = map.from_camera(&view.pose);
        let step = turn * Vec3::X / view.intrinsics.fx();
        let unit = view.unit.metres();
        let (mut inside, mut span) = (0, NOWHERE);
        let mut run = Run { p: [[0.0; RUN]; 3], within: [0; RUN], cell: [0; RUN], key: [0; RUN] };
        for (y, row) in depth.chunks(view.width.max(1)).enumerate() {
            let first = turn * view.intrinsics.ray(Vec2::new(0.0, y as f32));
            let mut number = (y * view.width) as u32;
            for (block, values) in row.chunks(RUN).enumerate() {
                let count = match values.first_chunk::<RUN>() {
                    Some(whole) => self.points(&mut run, whole, block, unit, origin, first, step),
                    None => {
                        let mut part = [0; RUN];
                        for (to, from) in part.iter_mut().zip(values) {
                            *to = *from;
                        }
                        self.points(&mut run, &part, block, unit, origin, first, step)
                    }
                };
                if count > 0 {
                    inside += count as usize;
                    self.address(&mut run, number);
                    for (at, key) in run.cell.iter().zip(run.key) {
                        if let Some(held) = cells.get_mut(*at as usize) {
                            *held = if key < *held { key } else { *held };
                            span = (span.0.min(*at as usize), span.1.max(*at as usize));
                        }
                    }
                }
                number += RUN as u32;
            }
        }
        (inside, span)
    }

    /// Points from the map's place, and which are inside; how many are.
    #[inline(always)]
    fn points(
        &self,
        run: &mut Run,
        depth: &[u16; RUN],
        block: usize,
        unit: f32,
        origin: Vec3,
        first: Vec3,
        step: Vec3,
    ) -> u32 {
        let start = (block * RUN) as f32;
        let half = self.half_side;
        let [xs, ys, zs] = &mut run.p;
        for (i, ((((d, x), y), z), within)) in depth.iter().zip(xs).zip(ys).zip(zs).zip(&mut run.within).enumerate() {
            let depth = f32::from(*d) * unit;
            let along = start + i as f32;
            *x = origin.x + depth * (first.x + along * step.x);
            *y = origin.y + depth * (first.y + along * step.y);
            *z = origin.z + depth * (first.z + along * step.z);
            let inside = (x.abs() <= half) & (y.abs() <= half) & (z.abs() <= half) & (*d != 0);
            *within = u32::from(inside);
        }
        run.within.iter().sum()
    }

    /// Where the points lie in the layer, and what they are there.
    #[inline(always)]
    fn address(&self, run: &mut Run, number: u32) {
        let (width, height) = (self.size.0 as i32, self.size.1 as i32);
        let (across, down) = (self.size.0 as f32, self.size.1 as f32);
        let (steps, bits) = (self.steps(), self.pixel_bits);
        let [xs, ys, zs] = &run.p;
        let points = xs.iter().zip(ys).zip(zs).zip(&run.within);
        for (i, ((((x, y), z), within), (cell, key))) in points.zip(run.cell.iter_mut().zip(&mut run.key)).enumerate() {
            let s = x * x + z * z;
            let r = s + y * y;
            let column = whole((0.5 + turns_of(*x, -*z)) * across);
            let line = whole(2.0 * half_turn(s * math::inv_sqrt_fast(s), *y) * down);
            let column = if column >= width { 0 } else { column };
            let line = if line >= height { height - 1 } else { line };
            let good = (*within != 0) & (r > NO_DIRECTION);
            *cell = if good { (line * width + column) as u32 } else { u32::MAX };
            *key = (whole(r * math::inv_sqrt_fast(r) * steps) as u32) << bits | (number + i as u32);
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
