//! How high is the ground, cell by cell? A gravity-aligned grid in the world, built from frames.
//!
//! Beyond the paper, for the planner: DepthLab's avatar knows one ray at a time; to go *around* something needs a map. Each
//! reading falls into a cell and moves the cell's lowest, highest and mean height. Lowest and highest are both kept,
//! because a chair's seat, side and the floor below it share a cell: whether one can stand there is a matter of the spread,
//! and a foreground occluder is not ground.
//!
//! Points more than the clearance above a cell's lowest (lamps, ceilings, the bar of a door) don't block and are only
//! counted. When the ceiling was seen first, the first floor point starts the cell anew.
//!
//! A cell without readings is unknown, and stays so: what that means is the planner's to ask
//! ([`HolePolicy`](crate::sensing::depth::HolePolicy)).
//!
//! Memory: 16 bytes a cell in the caller's slice (64 x 64: 66 kB, 128 x 128: 262 kB), 104 bytes for the map. Cost: about
//! 20 ns a reading on a desktop core, 66 instructions a pixel on a Cortex-M4F. Error: that of the readings; rounding under 1e-4 m
//! within 10 m of the map's centre (held by a test).

use core::fmt;

use glam::Vec3;

use crate::sensing::depth::DepthSample;
use crate::sensing::frame::DepthFrame;

/// Where the map lies: `width` x `depth` square cells around a centre, in a plane square to up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    centre: Vec3,
    right: Vec3,
    forward: Vec3,
    up: Vec3,
    cell: f32,
    width: u32,
    depth: u32,
}

/// A grid or map that can't be.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum HeightMapError {
    /// The cell size is not a positive, finite number of metres (between 1 mm and 1 km).
    BadCell {
        /// What it was, metres.
        cell: f32,
    },
    /// Up and forward leave no direction, or the centre is not finite.
    BadAxes,
    /// More cells than 2^24, or more than the slice holds.
    CapacityExceeded {
        /// Cells needed; `usize::MAX` beyond 2^24.
        needed: usize,
        /// Cells given.
        got: usize,
    },
    /// A parameter is out of its documented range.
    BadParams,
}

impl fmt::Display for HeightMapError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadCell { cell } => {
                write!(f, "height map cells of {cell} m; the size must lie between 0.001 and 1000 m")
            }
            Self::BadAxes => {
                write!(f, "height map axes: up and forward must be finite and not parallel, the centre finite")
            }
            Self::CapacityExceeded { needed, got } => {
                write!(f, "the height map needs {needed} cells, the slice has {got}")
            }
            Self::BadParams => write!(f, "a height map parameter is out of range; see HeightMapParams"),
        }
    }
}

impl core::error::Error for HeightMapError {}

impl Grid {
    /// A grid of `width` x `depth` cells of `cell` metres around `centre` (world, metres; its height is height 0). `up` and
    /// `forward` are world directions of any length; rows go along forward, which is made square to up.
    ///
    /// # Errors
    /// [`HeightMapError`] for an unusable cell size or axes, or more than 2^24 cells.
    pub fn new(
        centre: Vec3,
        up: Vec3,
        forward: Vec3,
        cell: f32,
        width: usize,
        depth: usize,
    ) -> Result<Self, HeightMapError> {
        if !(0.001..=1000.0).contains(&cell) {
            return Err(HeightMapError::BadCell { cell });
        }
        let up = up.try_normalize().ok_or(HeightMapError::BadAxes)?;
        let forward = forward.try_normalize().ok_or(HeightMapError::BadAxes)?;
        let flat = forward - up * forward.dot(up);
        if !(flat.length() > 1e-3 && centre.is_finite()) {
            return Err(HeightMapError::BadAxes);
        }
        let forward = flat.try_normalize().ok_or(HeightMapError::BadAxes)?;
        if width.checked_mul(depth).is_none_or(|n| n > 1 << 24) || width > 1 << 24 || depth > 1 << 24 {
            return Err(HeightMapError::CapacityExceeded { needed: usize::MAX, got: 1 << 24 });
        }
        Ok(Self { centre, right: forward.cross(up), forward, up, cell, width: width as u32, depth: depth as u32 })
    }

    /// Cells along right and along forward.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        (self.width as usize, self.depth as usize)
    }

    /// Number of cells.
    #[must_use]
    pub const fn cells(&self) -> usize {
        self.width as usize * self.depth as usize
    }

    /// Side of a cell, metres.
    #[must_use]
    pub const fn cell(&self) -> f32 {
        self.cell
    }

    /// Up, unit length, world.
    #[must_use]
    pub const fn up(&self) -> Vec3 {
        self.up
    }

    /// Height of a world point above the grid's plane, metres.
    #[must_use]
    pub fn height_of(&self, point: Vec3) -> f32 {
        (point - self.centre).dot(self.up)
    }

    /// Column and row of the cell below or above a world point; `None` outside the grid.
    #[must_use]
    pub fn cell_of(&self, point: Vec3) -> Option<(usize, usize)> {
        let d = point - self.centre;
        let u = d.dot(self.right) / self.cell + 0.5 * self.width as f32;
        let v = d.dot(self.forward) / self.cell + 0.5 * self.depth as f32;
        // Also false for NaN.
        (u >= 0.0 && v >= 0.0 && u < self.width as f32 && v < self.depth as f32).then_some((u as usize, v as usize))
    }

    /// World point (metres) above the middle of a cell at a height over the grid's plane.
    #[must_use]
    pub fn point_of(&self, column: usize, row: usize, height: f32) -> Vec3 {
        let u = (column as f32 + 0.5 - 0.5 * self.width as f32) * self.cell;
        let v = (row as f32 + 0.5 - 0.5 * self.depth as f32) * self.cell;
        self.centre + self.right * u + self.forward * v + self.up * height
    }
}

/// What is known of one cell. Heights are metres above the grid's plane, meaningful when `support > 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightCell {
    /// Lowest reading.
    pub min: f32,
    /// Highest reading that is not more than the clearance above the lowest.
    pub max: f32,
    /// Mean of the readings.
    pub mean: f32,
    /// When the cell last changed: the map's generation less its epoch; see [`HeightMap::changed`].
    changed: u16,
    /// Readings that took part, saturating at [`HeightMapParams::max_support`]; 0: unknown.
    pub support: u16,
}

impl HeightCell {
    /// Never seen: what the slice is filled with.
    pub const UNKNOWN: Self = Self { min: 0.0, max: 0.0, mean: 0.0, changed: 0, support: 0 };

    /// Whether anything was read here.
    #[must_use]
    pub const fn is_known(&self) -> bool {
        self.support > 0
    }

    /// Takes a reading of height `h`: whether a height moved by a visible step, or the cell became known. `steps` is 1 / the step.
    /// `None`: it hangs above the clearance, and nothing moved.
    #[inline(always)]
    fn take(&mut self, h: f32, params: &HeightMapParams, steps: f32) -> Option<bool> {
        // Shifted to be positive, where the cast rounds down: a library call for each would be half the cost of a reading.
        let step = |h: f32| (h * steps + 32_768.5) as i32;
        if self.support == 0 || self.max > h + params.clearance {
            let moved =
                self.support == 0 || [self.min, self.max, self.mean].into_iter().any(|old| step(old) != step(h));
            (self.min, self.max, self.mean, self.support) = (h, h, h, 1);
            return Some(moved);
        }
        if h > self.min + params.clearance {
            return None;
        }
        let before = step(self.mean);
        self.support = self.support.saturating_add(1).min(params.max_support);
        // With the support held, a running mean that forgets slowly.
        self.mean += (h - self.mean) / f32::from(self.support);
        let mut moved = step(self.mean) != before;
        if h < self.min {
            moved |= step(h) != step(self.min);
            self.min = h;
        } else if h > self.max {
            moved |= step(h) != step(self.max);
            self.max = h;
        }
        Some(moved)
    }
}

/// How readings become heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightMapParams {
    /// Free height a walker needs, metres, above 0; what hangs higher over a cell's lowest reading doesn't block. Default 1.
    pub clearance: f32,
    /// Readings further than this above or below the grid's plane are left out, metres, above 0. Default 3.
    pub reach: f32,
    /// Every n-th pixel of every n-th row is read, 1 or more. Default 1.
    pub stride: u32,
    /// Readings after which the mean begins to forget, 1 or more. Default 1000.
    pub max_support: u16,
    /// The step by which a height must move to count as changed, metres, above 0. Default 0.02.
    pub change: f32,
}

impl HeightMapParams {
    /// For a character of up to a metre.
    pub const DEFAULT: Self = Self { clearance: 1.0, reach: 3.0, stride: 1, max_support: 1000, change: 0.02 };
}

impl Default for HeightMapParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What became of a frame's readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IntegrateReport {
    /// Readings that fell into a cell and moved it.
    pub used: u32,
    /// Readings more than the clearance above their cell's lowest.
    pub overhead: u32,
    /// Readings beyond the grid's sides, or further from its plane than the reach.
    pub outside: u32,
    /// Pixels read that hold no reading.
    pub holes: u32,
    /// Generation of the map from this frame on.
    pub generation: u32,
}

/// The map, in the caller's cells.
///
/// ```
/// use glam::Vec3;
/// use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
/// use isobath::sensing::{camera::{Intrinsics, Pose}, depth::{DepthArray, DepthUnit}, frame::DepthFrame};
/// // From 2 m above, straight down on a floor at height 0.
/// let depth = DepthArray::<64, 48>::filled(2000);
/// let pose = Pose::looking_at(Vec3::Y * 2.0, Vec3::ZERO, Vec3::NEG_Z).unwrap();
/// let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, Intrinsics::new(50.0, 50.0, 31.5, 23.5)?).with_pose(pose);
/// let grid = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::NEG_Z, 0.1, 16, 16)?;
/// let mut cells = [HeightCell::UNKNOWN; 256];
/// let mut map = HeightMap::new(grid, &mut cells, HeightMapParams::DEFAULT)?;
/// let report = map.integrate(&frame);
/// assert!(report.used > 1000 && report.outside > 100);
/// let cell = map.cell_at(Vec3::new(0.3, 5.0, 0.3)).unwrap();
/// assert!(cell.is_known() && cell.mean.abs() < 1e-4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct HeightMap<'a> {
    grid: Grid,
    params: HeightMapParams,
    cells: &'a mut [HeightCell],
    generation: u32,
}

/// Generations after which cells' marks of change are moved to a new epoch: half of what a mark can tell apart.
const EPOCH: u32 = 1 << 15;

impl<'a> HeightMap<'a> {
    /// A map of nothing known; the first [`Grid::cells`] of `cells` are overwritten.
    ///
    /// # Errors
    /// [`HeightMapError`] when the slice is too short or a parameter out of range.
    pub fn new(grid: Grid, cells: &'a mut [HeightCell], params: HeightMapParams) -> Result<Self, HeightMapError> {
        let map = Self::resume(grid, cells, params, 0)?;
        map.cells.fill(HeightCell::UNKNOWN);
        Ok(map)
    }

    /// The map that an earlier one left in `cells`, at its [`Self::generation`]: for owners that can't keep its borrow between
    /// two frames (the C interface), or that kept the cells through a restart.
    ///
    /// # Errors
    /// [`HeightMapError`] when the slice is too short or a parameter out of range.
    pub fn resume(
        grid: Grid,
        cells: &'a mut [HeightCell],
        params: HeightMapParams,
        generation: u32,
    ) -> Result<Self, HeightMapError> {
        let positive = |v: f32| v > 0.0 && v.is_finite();
        let ok = positive(params.clearance) && positive(params.reach) && positive(params.change);
        if !ok || params.stride == 0 || params.max_support == 0 {
            return Err(HeightMapError::BadParams);
        }
        let (needed, got) = (grid.cells(), cells.len());
        let cells = cells.get_mut(..needed).ok_or(HeightMapError::CapacityExceeded { needed, got })?;
        Ok(Self { grid, params, cells, generation })
    }

    /// Lays the map elsewhere, of nothing known, in the same cells: when tracking starts anew, or the user has walked off it.
    ///
    /// # Errors
    /// [`HeightMapError::CapacityExceeded`] when the grid has more cells than the map was made with; the map is kept.
    pub fn restart(&mut self, grid: Grid) -> Result<(), HeightMapError> {
        let (needed, got) = (grid.cells(), self.cells.len());
        if needed > got {
            return Err(HeightMapError::CapacityExceeded { needed, got });
        }
        let changed = self.next_generation();
        self.cells.fill(HeightCell { changed, ..HeightCell::UNKNOWN });
        self.grid = grid;
        Ok(())
    }

    /// Where it lies.
    #[must_use]
    pub const fn grid(&self) -> &Grid {
        &self.grid
    }

    /// How readings become heights.
    #[must_use]
    pub const fn params(&self) -> &HeightMapParams {
        &self.params
    }

    /// Grows by one with every frame, fading and edit.
    #[must_use]
    pub const fn generation(&self) -> u32 {
        self.generation
    }

    /// The generation when a cell last changed: became known or unknown, or a height moved by a visible step. `None` outside.
    ///
    /// A cell has 16 bits for it: exact for the last 32,768 generations (18 minutes at 30 frames a second). What did not change
    /// since is said to have changed at a generation older than that, never older than the change itself; 0: never.
    #[must_use]
    pub fn changed(&self, column: usize, row: usize) -> Option<u32> {
        self.cell(column, row).map(|cell| self.epoch() + u32::from(cell.changed))
    }

    /// Whether one of these cells of a row changed after a generation.
    #[inline]
    pub(super) fn any_changed(&self, row: usize, columns: core::ops::Range<usize>, since: u32) -> bool {
        let first = row * self.grid.width as usize;
        let cells = self.cells.get(first + columns.start..first + columns.end).unwrap_or(&[]);
        match since.checked_sub(self.epoch()) {
            Some(since) => cells.iter().any(|c| u32::from(c.changed) > since),
            // All that is known of a cell may be that it has not changed since the epoch.
            None => !cells.is_empty(),
        }
    }

    /// The generation from which cells' marks are counted: the last multiple of [`EPOCH`] but one.
    const fn epoch(&self) -> u32 {
        (self.generation / EPOCH).saturating_sub(1) * EPOCH
    }

    /// Begins the next generation, and gives the mark of a cell that changes in it.
    fn next_generation(&mut self) -> u16 {
        let before = self.epoch();
        self.generation = self.generation.saturating_add(1);
        let age = (self.epoch() - before) as u16;
        if age > 0 {
            for cell in &mut *self.cells {
                cell.changed = cell.changed.saturating_sub(age);
            }
        }
        (self.generation - self.epoch()) as u16
    }

    /// All cells, row after row.
    #[must_use]
    pub fn cells(&self) -> &[HeightCell] {
        self.cells.get(..self.grid.cells()).unwrap_or(&[])
    }

    /// One cell; `None` outside.
    #[inline]
    #[must_use]
    pub fn cell(&self, column: usize, row: usize) -> Option<&HeightCell> {
        let (w, _) = self.grid.size();
        if column >= w { None } else { self.cells.get(row * w + column) }
    }

    /// The cell below or above a world point; `None` outside.
    #[must_use]
    pub fn cell_at(&self, point: Vec3) -> Option<&HeightCell> {
        let (column, row) = self.grid.cell_of(point)?;
        self.cell(column, row)
    }

    /// Overwrites a cell, as a level designer or a test does; `false` outside. A height that is not finite makes it unknown.
    pub fn set(&mut self, column: usize, row: usize, min: f32, max: f32) -> bool {
        let (w, _) = self.grid.size();
        let i = row * w + column;
        if column >= w || i >= self.cells.len() {
            return false;
        }
        let changed = self.next_generation();
        let Some(cell) = self.cells.get_mut(i) else { return false };
        *cell = if min.is_finite() && max.is_finite() {
            HeightCell { min, max: max.max(min), mean: 0.5 * (min + max), changed, support: 1 }
        } else {
            HeightCell { changed, ..HeightCell::UNKNOWN }
        };
        true
    }

    /// Adds the readings of a frame with its pose (identity when it has none).
    pub fn integrate<D: DepthSample>(&mut self, frame: &DepthFrame<'_, D>) -> IntegrateReport {
        let changed = self.next_generation();
        let (k, pose, grid) = (frame.intrinsics(), frame.pose_or_identity(), &self.grid);
        let (w, h) = grid.size();
        // Camera to grid in one step: each grid axis seen from the camera, scaled to cells, and the camera's own place.
        let axis = |a: Vec3, scale: f32| {
            (pose.direction_to_camera(a) * scale, (pose.translation() - grid.centre).dot(a) * scale)
        };
        let (right, u0) = axis(grid.right, 1.0 / grid.cell);
        let (forward, v0) = axis(grid.forward, 1.0 / grid.cell);
        let (up, h0) = axis(grid.up, 1.0);
        let (u0, v0) = (u0 + 0.5 * w as f32, v0 + 0.5 * h as f32);
        let (wide, deep) = (w as f32, h as f32);
        // Along each axis by a pixel to the right, at one metre.
        let [along_u, along_v, along_h] = [right.x, forward.x, up.x].map(|a| a / k.fx());
        let (params, cells, unit) = (self.params, &mut *self.cells, frame.unit());
        // At least 1 already: said again for the compiler, which would link the panic of a step of 0.
        let (stride, steps) = ((params.stride as usize).max(1), 1.0 / params.change);
        let (mut used, mut overhead, mut holes, mut read) = (0_u32, 0_u32, 0_u32, 0_u32);
        for (y, row) in frame.depth().rows().enumerate().step_by(stride) {
            let ry = (y as f32 - k.cy()) / k.fy();
            let (ru, rv, rh) = (right.y * ry + right.z, forward.y * ry + forward.z, up.y * ry + up.z);
            let mut x = 0;
            while let Some(sample) = row.get(x) {
                let column = x as f32 - k.cx();
                x = x.saturating_add(stride);
                read += 1;
                let z = sample.metres(unit);
                if !(z > 0.0) {
                    holes += 1;
                    continue;
                }
                // In this order, and negated: NaN, which overflow can give, is outside.
                let u = u0 + z * (column * along_u + ru);
                if !(u >= 0.0 && u < wide) {
                    continue;
                }
                let v = v0 + z * (column * along_v + rv);
                if !(v >= 0.0 && v < deep) {
                    continue;
                }
                let height = h0 + z * (column * along_h + rh);
                if !(height.abs() <= params.reach) {
                    continue;
                }
                let Some(cell) = cells.get_mut(v as usize * w + u as usize) else { continue };
                match cell.take(height, &params, steps) {
                    Some(moved) => {
                        used += 1;
                        if moved {
                            cell.changed = changed;
                        }
                    }
                    None => overhead += 1,
                }
            }
        }
        let outside = read - used - overhead - holes;
        IntegrateReport { used, overhead, outside, holes, generation: self.generation }
    }

    /// Forgets: halves every cell's support, and makes unknown what had only one reading left. Called now and then (once a
    /// second, say), it lets what is not seen again fade and what is seen again win over what was.
    pub fn fade(&mut self) {
        let changed = self.next_generation();
        for cell in self.cells.iter_mut().filter(|c| c.is_known()) {
            cell.support /= 2;
            // Extremes come back with the next readings; until then they close in on the mean.
            cell.min = 0.5 * (cell.min + cell.mean);
            cell.max = 0.5 * (cell.max + cell.mean);
            if cell.support == 0 {
                *cell = HeightCell::UNKNOWN;
            }
            cell.changed = changed;
        }
    }
}

#[cfg(test)]
mod tests;
