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

    /// The middles of `n` by `n` cells.
    fn each(&self, n: u16, mut sample: impl FnMut(Vec3)) {
        let cell = 2.0 / f32::from(n);
        let (x, z) = (self.x * (self.half.0 * cell), self.z * (self.half.1 * cell));
        let first = 0.5 * (f32::from(n) - 1.0);
        for j in 0..n {
            let row = self.middle + z * (f32::from(j) - first);
            for i in 0..n {
                sample(row + x * (f32::from(i) - first));
            }
        }
    }
}

/// The reading in the direction of a point, as a point.
#[inline]
fn read<D: DepthSample>(frame: &DepthFrame<'_, D>, point: Vec3, work: &mut Work) -> Option<Vec3> {
    let (x, y) = frame.pixel_of(point)?;
    work.done = work.done.saturating_add(1);
    frame.point(x, y)
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
    let mut support = Err(NoPlace::NoSurface);
    // The foot of a post among the readings pulls the first plane off: each round lets less of it in.
    let mut grid = TURNING_GRID;
    for round in 1..=ROUNDS {
        let up_now = plane.normal();
        let sheet = Sheet::new(frame, plane.project(middle), up_now, params).ok_or(NoPlace::NoSurface)?;
        // Along the sides in cells of the grid, up in metres.
        let cells = 0.5 * f32::from(grid);
        let (x, z) = (sheet.x * (cells / sheet.half.0), sheet.z * (cells / sheet.half.1));
        let mut sums = Sums::default();
        sheet.each(grid, |point| {
            let Some(p) = read(frame, point, work) else { return };
            let away = p - sheet.middle;
            let height = up_now.dot(away);
            if height.abs() <= gate {
                sums.add(x.dot(away), z.dot(away), height);
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
        if math::acos(plane.normal().dot(up)) > 2.0 * params.max_tilt + 0.3 {
            return support;
        }
        let closed = gate.min((3.0 * rms).max(0.5 * params.max_roughness));
        let settled = closed == gate && steep < SETTLED * SETTLED;
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
        let mut covered = 0_u16;
        sheet.each(COVER_GRID, |point| {
            // The point of the plane under this cell of the footprint.
            let seen = read(frame, self.plane.project(point), work);
            covered += u16::from(seen.is_some_and(|p| self.plane.distance(p).abs() <= clearance));
        });
        Some(f32::from(covered) / f32::from(COVER_GRID * COVER_GRID))
    }
}
