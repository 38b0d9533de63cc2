//! The surface under the footprint: its plane, and how much of the footprint lies on it.
//!
//! All in the camera's frame, where a reading is three multiplications away. The plane is the least squares of heights over the
//! last plane, which is small numbers: `f32` keeps their digits, and devices without double precision don't pay for it (a fit
//! of points in `f64` is twenty times the instructions on a Cortex-M4F). Once a round turns the plane by less than [`SETTLED`], heights along
//! the old normal and distances from the new plane agree to a ten-thousandth, and a last round on a finer grid gives the answer.

use glam::Vec3;

use super::{Facing, NoPlace, PlaceParams};
use crate::ground::geometry::Plane;
use crate::ground::math;
use crate::ground::regression::Sums;
use crate::localized::normals::{NormalParams, normal_at};
use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;
use crate::skipping::Work;

/// Samples across the footprint in each direction: for the plane while it turns, for the plane, and for the coverage.
const TURNING_GRID: u16 = 6;
const FIT_GRID: u16 = 12;
const COVER_GRID: u16 = 8;

/// Rounds, at most; on the coarse grid, at most.
const ROUNDS: usize = 7;
const TURNING_ROUNDS: usize = 3;

/// A round that turns the plane by less (radians) lets in what the round before it did: the last one, on the fine grid, follows.
const SETTLED: f32 = 1e-2;

/// So does one that closes the gate to no less than this share of it.
const CLOSED: f32 = 0.9;

/// The plane and how far readings lie off it.
pub(super) struct Support {
    /// In the camera's frame, its normal towards the camera.
    pub(super) plane: Plane,
    /// RMS distance of the readings, metres.
    pub(super) rms: f32,
}

/// A rectangle in the camera's frame: its middle, and unit vectors along its sides.
struct Sheet {
    middle: Vec3,
    x: Vec3,
    z: Vec3,
    half: (f32, f32),
}

impl Sheet {
    fn new<D: DepthSample>(frame: &DepthFrame<'_, D>, middle: Vec3, up: Vec3, params: &PlaceParams) -> Option<Self> {
        let facing = match params.facing {
            Facing::Camera => -middle,
            Facing::Along(direction) => frame.pose_or_identity().direction_to_camera(direction),
        };
        let flat = (facing - up * facing.dot(up)).try_normalize();
        // Seen from straight above, or asked to face up: any direction will do.
        let z = flat.unwrap_or_else(|| up.any_orthonormal_vector());
        let half = (0.5 * params.size.x, 0.5 * params.size.z);
        (middle.is_finite() && z.is_finite()).then_some(Self { middle, x: up.cross(z), z, half })
    }

    /// As seen from the camera on a plane: along `plane`'s normal every point of it.
    fn onto(&self, plane: &Plane) -> Self {
        let normal = plane.normal();
        let flat = |v: Vec3| v - normal * normal.dot(v);
        Self { middle: plane.project(self.middle), x: flat(self.x), z: flat(self.z), half: self.half }
    }

    /// The readings in the directions of the middles of `n` by `n` cells: offset from the principal point, pixels, and depth, metres.
    ///
    /// Along a row a point moves by one step a cell, and so do its coordinates times the focal lengths: a pixel is two additions
    /// and two quotients.
    #[inline(always)]
    fn readings<D: DepthSample>(
        &self,
        frame: &DepthFrame<'_, D>,
        n: u16,
        work: &mut Work,
        mut each: impl FnMut(f32, f32, f32),
    ) {
        let k = frame.intrinsics();
        let (cx, cy) = (k.cx(), k.cy());
        // The pixel's square begins half a pixel before its centre.
        let (edge_x, edge_y) = (cx + 0.5, cy + 0.5);
        let lens = Vec3::new(k.fx(), k.fy(), 1.0);
        let (depth, unit) = (frame.depth(), frame.unit().metres());
        let cell = 2.0 / f32::from(n);
        let (step, down) = (self.x * (self.half.0 * cell) * lens, self.z * (self.half.1 * cell));
        let first = 0.5 * (f32::from(n) - 1.0);
        let (mut seen, cells) = (0, usize::from(n));
        for j in 0..n {
            let mut p = (self.middle + down * (f32::from(j) - first)) * lens - step * first;
            for _ in 0..cells {
                let (x, y) = (p.x / p.z + edge_x, p.y / p.z + edge_y);
                // Not before the image's first row and column (the sign bits), nor beyond its last (`get`).
                let before = (x.to_bits() | y.to_bits()) >> 31 != 0;
                let (column, row) = (x as u32, y as u32);
                if p.z > 0.0
                    && !before
                    && let Some(value) = depth.get(column as usize, row as usize)
                {
                    seen += 1;
                    if value.is_valid() {
                        each(column as f32 - cx, row as f32 - cy, value.number() * unit);
                    }
                }
                p += step;
            }
        }
        work.done = work.done.saturating_add(seen);
    }
}

/// How far a reading lies from a point along an axis, of the pixel's offset and the depth.
struct Measure {
    x: f32,
    y: f32,
    ahead: f32,
    from: f32,
}

impl Measure {
    fn along<D: DepthSample>(frame: &DepthFrame<'_, D>, axis: Vec3, from: Vec3) -> Self {
        let k = frame.intrinsics();
        Self { x: axis.x / k.fx(), y: axis.y / k.fy(), ahead: axis.z, from: axis.dot(from) }
    }

    #[inline(always)]
    fn of(&self, x: f32, y: f32, z: f32) -> f32 {
        z * (self.x * x + self.y * y + self.ahead) - self.from
    }
}

/// The plane of the readings under the footprint. `seen` is the pixel's point, `up` unit length, all in the camera's frame.
pub(super) fn fit<D: DepthSample>(
    frame: &DepthFrame<'_, D>,
    pixel: (usize, usize),
    middle: Vec3,
    seen: Vec3,
    up: Vec3,
    params: &PlaceParams,
    work: &mut Work,
) -> Result<Support, NoPlace> {
    let normal = normal_at(frame, pixel.0, pixel.1, &NormalParams::POINT).map_or(up, |estimate| estimate.normal);
    let mut plane = Plane::through(seen, normal).ok_or(NoPlace::NoSurface)?;
    let reach = 0.5 * math::sqrt(params.size.x * params.size.x + params.size.z * params.size.z);
    // First what the local normal's error may leave off, then what noise may.
    let mut gate = 0.1 * reach + 2.0 * params.max_roughness;
    // The tilt of a wall, and no less than its cosine: the arc cosine is seldom asked for.
    let steepest = 2.0 * params.max_tilt + 0.3;
    let square = steepest * steepest;
    let level = 1.0 - square * (0.5 - square / 24.0);
    let mut support = Err(NoPlace::NoSurface);
    // The foot of a post among the readings pulls the first plane off: each round lets less of it in.
    let mut grid = TURNING_GRID;
    for round in 1..=ROUNDS {
        let up_now = plane.normal();
        let sheet = Sheet::new(frame, plane.project(middle), up_now, params).ok_or(NoPlace::NoSurface)?;
        // Along the sides in cells of the grid, up in metres.
        let cells = 0.5 * f32::from(grid);
        let (x, z) = (sheet.x * (cells / sheet.half.0), sheet.z * (cells / sheet.half.1));
        let measure = |axis| Measure::along(frame, axis, sheet.middle);
        let (over, across, ahead) = (measure(up_now), measure(x), measure(z));
        let mut sums = Sums::default();
        sheet.readings(frame, grid, work, |x, y, depth| {
            let height = over.of(x, y, depth);
            if height.abs() <= gate {
                sums.add(across.of(x, y, depth), ahead.of(x, y, depth), height);
            }
        });
        let found = sums.solve().ok_or(NoPlace::NoSurface)?;
        // The slopes are a metre a cell: a metre a metre along the scaled sides.
        let lean = x * found.a + z * found.b;
        let steep = lean.length_squared();
        let turned = up_now - lean;
        // Towards the camera.
        let turned = if turned.dot(seen) > 0.0 { -turned } else { turned };
        plane = Plane::through(sheet.middle + up_now * found.c, turned).ok_or(NoPlace::NoSurface)?;
        let free = sums.n - 3.0;
        let variance = if free > 0.0 { found.squares / free / (1.0 + steep) } else { 0.0 };
        let rms = math::sqrt(variance);
        support = Ok(Support { plane, rms });
        // Hopeless already: a wall.
        let upright = plane.normal().dot(up);
        if upright < level && math::acos(upright) > steepest {
            return support;
        }
        let closed = math::min(gate, math::max(3.0 * rms, 0.5 * params.max_roughness));
        let settled = closed >= CLOSED * gate && steep < SETTLED * SETTLED;
        if grid == FIT_GRID && settled {
            return support;
        }
        if settled || round == TURNING_ROUNDS {
            grid = FIT_GRID;
        }
        gate = closed;
    }
    support
}

impl Support {
    /// Share of the footprint's cells under which a reading lies on the plane, to `clearance` metres.
    pub(super) fn coverage<D: DepthSample>(
        &self,
        frame: &DepthFrame<'_, D>,
        middle: Vec3,
        standing: Vec3,
        clearance: f32,
        params: &PlaceParams,
        work: &mut Work,
    ) -> Option<f32> {
        let sheet = Sheet::new(frame, self.plane.project(middle), standing, params)?;
        // The points of the plane under the footprint's cells.
        let sheet = sheet.onto(&self.plane);
        let over = Measure::along(frame, self.plane.normal(), sheet.middle);
        let mut covered = 0_u16;
        sheet.readings(frame, COVER_GRID, work, |x, y, depth| {
            covered += u16::from(over.of(x, y, depth).abs() <= clearance);
        });
        Some(f32::from(covered) / f32::from(COVER_GRID * COVER_GRID))
    }
}
