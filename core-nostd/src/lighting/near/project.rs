//! A view's points onto its layer: a distance buffer that remembers which pixel won.
//!
//! A cell holds, from the top bit down, the distance from the map's place in equal steps and the number of the view's pixel: the least value is
//! the nearest point, of two as near the one that comes first in the view. So the order of points does not matter, and a layer is merged, reduced and coloured
//! later by this number alone. With views of 2^20 pixels a step is 0.4 mm of a 2 m cube, with smaller views less.
//!
//! Eight points at a time: no square roots, no arc functions, no branches but "none of the eight is inside".

use super::NOWHERE;
use super::view::View;
use crate::ground::lanes::{LANES, vectorised};
use crate::ground::math;
use crate::lighting::equirect::{MapFrame, turns_of};
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

/// Eight numbers.
type Eight<T> = [T; LANES];

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
        let (width, height) = self.size;
        let step = turn * Vec3::X / view.intrinsics.fx();
        let unit = view.unit.metres();
        let steps = self.steps();
        let (mut inside, mut span) = (0, NOWHERE);
        for (y, row) in depth.chunks(view.width.max(1)).enumerate() {
            let first = turn * view.intrinsics.ray(Vec2::new(0.0, y as f32));
            for (block, values) in row.chunks(LANES).enumerate() {
                let mut eight = [0_u16; LANES];
                for (to, from) in eight.iter_mut().zip(values) {
                    *to = *from;
                }
                if eight.iter().all(|v| *v == 0) {
                    continue;
                }
                let start = (block * LANES) as f32;
                let mut p: [Eight<f32>; 3] = [[0.0; LANES]; 3];
                let mut within: Eight<u32> = [0; LANES];
                for i in 0..LANES {
                    let z = f32::from(eight[i]) * unit;
                    let along = start + i as f32;
                    let x = origin.x + z * (first.x + along * step.x);
                    let y = origin.y + z * (first.y + along * step.y);
                    let w = origin.z + z * (first.z + along * step.z);
                    let far = x.abs().max(y.abs()).max(w.abs());
                    within[i] = u32::from(far <= self.half_side) & u32::from(z > 0.0);
                    [p[0][i], p[1][i], p[2][i]] = [x, y, w];
                }
                let count = within.iter().sum::<u32>();
                if count == 0 {
                    continue;
                }
                let mut cell: Eight<u32> = [0; LANES];
                let mut key: Eight<u32> = [0; LANES];
                let number = (y * view.width + block * LANES) as u32;
                for i in 0..LANES {
                    let [x, y, z] = [p[0][i], p[1][i], p[2][i]];
                    let s = x * x + z * z;
                    let r = s + y * y;
                    let u = 0.5 + turns_of(x, -z);
                    let v = 2.0 * turns_of(s * math::inv_sqrt_fast(s), y);
                    let (column, line) = ((u * width as f32) as i32, (v * height as f32) as i32);
                    let column = if column >= width as i32 { 0 } else { column };
                    let line = if line >= height as i32 { height as i32 - 1 } else { line };
                    let distance = (r * math::inv_sqrt_fast(r) * steps) as i32 as u32;
                    let good = within[i] != 0 && r > NO_DIRECTION;
                    cell[i] = if good { (line * width as i32 + column) as u32 } else { u32::MAX };
                    key[i] = distance << self.pixel_bits | (number + i as u32);
                }
                inside += count as usize;
                for i in 0..LANES {
                    let at = cell[i] as usize;
                    if let Some(held) = cells.get_mut(at) {
                        *held = (*held).min(key[i]);
                        span = (span.0.min(at), span.1.max(at));
                    }
                }
            }
        }
        (inside, span)
    }
}
