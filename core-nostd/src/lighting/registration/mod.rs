//! Tracking drifts: where did these views truly stand, so that their surfaces lie on each other?
//!
//! Each view is left as a grid of small planes (`cells`); each cell of a view is looked up where another view would see it
//! (projective association, Rusinkiewicz and Levoy 2001), and its distance from the plane there is made small (point to plane, Chen
//! and Medioni 1991). Views join one by one, the one that overlaps most first, coarse to fine; then all move together until
//! they agree (`solve`). Weights come from the sensor's noise and fall to zero for what does not belong (Tukey), with
//! a scale that follows the residuals down.
//!
//! What the geometry does not tell is not corrected: along a single wall, and about its normal, every pose fits as well, and noise
//! would choose one. Such directions are found in each view's own scale (Gelfand et al. 2003) and left out of the solution (Zhang et
//! al. 2016, "solution remapping"): of all poses that fit, the one nearest to the tracker's is taken. They are reported
//! ([`Outcome::Degenerate`], [`ViewReport::unknown`]). Directions as weak as the noise of the normals count among them, and so
//! do those of a view that is known only beside another that is not.
//!
//! It is a separate object, off unless called, and works in slices: [`Registration::fill`] and [`Registration::step`] do a bounded
//! amount of work a call, and give the same result however it is sliced. After `fill` a view's image is no longer needed, and
//! stays prepared for the next registration.
//!
//! Memory: the caller's floats, [`scratch_len`] a view (36 KiB at 1024 x 768, 56 KiB at 640 x 480, 14 KiB at 160 x 120; with less,
//! cells are larger); the object itself 19 KiB for 5 views, 7 for 2, 37 for 8.
//!
//! Cost (x86-64 baseline, one core): 0.6 ms to prepare a view of 1024 x 768; five prepared views, all but one drifted by 5 cm and 5
//! degrees, 4 to 5 ms (up to 13 with Kinect noise, which needs more passes). One view against four, with AVX2: 1.6 ms (3.2).
//!
//! Error, on the simulated living room after that drift, worst of 40 views each: 1024 x 768, exact depth in millimetres 0.2 mm and
//! 0.003 degrees, Kinect noise 0.8 mm and 0.02 degrees, time of flight 0.8 mm and 0.02 degrees; 160 x 120, exact 0.5 mm, noisy 9 mm
//! and 0.2 degrees (too few pixels a plane). On a wall it moves no view by more than 1.1 mm along it. Where little but level
//! surfaces is seen (steeply down on a table), 5 cm of drift along one direction stay, and are reported so. Tests hold bounds on all
//! of these (`tests/tests/registration.rs`); `isobath bench --filter registration` prints them.

mod associate;
mod cells;
mod run;
#[allow(
    clippy::indexing_slicing,
    reason = "6 x 6 matrices indexed by loops of fixed bounds: nothing of it is left to panic, which `cargo xtask proof` sees"
)]
mod solve;
#[cfg(test)]
mod tests;

use core::fmt;

use glam::Vec3;

use crate::sensing::camera::Pose;
use crate::sensing::depth::DepthSample;
use crate::sensing::depth::noise::DepthNoise;
use crate::sensing::frame::DepthFrame;
use cells::{Extent, Grid, fit_row};
use run::Run;

/// Smallest cell, pixels.
const LEAST_CELL: usize = 4;
/// Cells without which a view is none.
const LEAST_CELLS: usize = 64;
/// Cells are widened until noise turns their normals by less than this, radians.
const STEADY: f32 = 0.1;
/// Floats a cell.
const FIELDS: usize = 3;

/// Side of the cells of an image of this width, when memory allows: the largest power of two that leaves 48 columns, at least 4.
const fn cell_for(width: usize) -> usize {
    let mut cell = LEAST_CELL;
    while cell < 1 << 16 && width / (2 * cell) >= 48 {
        cell *= 2;
    }
    cell
}

/// Floats that each view of this size wants: 9216 at 1024 x 768, 14,400 at 640 x 480, 3600 at 160 x 120. With less, cells are
/// larger.
#[must_use]
pub const fn scratch_len(width: usize, height: usize) -> usize {
    cells((width, height), cell_for(width)).saturating_mul(FIELDS)
}

/// Whole cells of a side in an image.
const fn cells((width, height): (usize, usize), cell: usize) -> usize {
    // Said so that every compiler sees that nothing is divided by 0.
    let cell = if cell == 0 { 1 } else { cell };
    (width / cell).saturating_mul(height / cell)
}

/// Parameters of registration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegistrationParams {
    /// Surfaces farther apart than this are not the same, metres. Default 0.5: 5 degrees at 5 m. Above 0.
    pub max_distance: f32,
    /// Surfaces whose normals differ by more than this are not the same, radians. Default 0.6. 0 to pi / 2.
    pub max_angle: f32,
    /// Directions with less information than this share are not corrected. 1 is what a plane tells of its distance when all
    /// cells lie on it. Default 0.002. 0 to 1.
    pub min_information: f32,
    /// A correction that moves a camera by more than this is not believed, metres. Default 0.25.
    pub max_shift: f32,
    /// A correction that turns a camera by more than this is not believed, radians. Default 0.26 (15 degrees).
    pub max_turn: f32,
    /// Share of the matched cells that must lie within 3 standard deviations for a correction to be believed. Default 0.5. 0 to 1.
    pub min_inliers: f32,
}

impl Default for RegistrationParams {
    fn default() -> Self {
        Self {
            max_distance: 0.5,
            max_angle: 0.6,
            min_information: 0.002,
            max_shift: 0.25,
            max_turn: 0.26,
            min_inliers: 0.5,
        }
    }
}

/// Why registration can't begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum RegistrationError {
    /// There is no such slot.
    Slot {
        /// The one asked for.
        slot: usize,
        /// How many there are.
        slots: usize,
    },
    /// The frame has no pose to correct.
    NoPose,
    /// The frame is smaller than a cell, or memory does not hold a grid of 8 x 8 cells.
    TooSmall {
        /// Columns and rows of the frame.
        size: (usize, usize),
        /// Floats a slot has.
        floats: usize,
    },
    /// The frame given to go on with is not the one begun with: its size or camera is another.
    OtherFrame,
    /// None of the slots that should stay holds a finished view.
    NothingFixed,
}

impl fmt::Display for RegistrationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slot { slot, slots } => write!(f, "there is no slot {slot}: there are {slots}, from 0"),
            Self::NoPose => write!(f, "the frame has no pose; registration corrects poses and needs one from tracking"),
            Self::TooSmall { size, floats } => write!(
                f,
                "a frame of {}x{} with {floats} floats of memory has too few cells; scratch_len says how many floats each view wants",
                size.0, size.1
            ),
            Self::OtherFrame => write!(f, "this frame's size or camera is not the one the slot was begun with"),
            Self::NothingFixed => {
                write!(f, "no slot that should stay holds a finished view; one view must tell where the world is")
            }
        }
    }
}

impl core::error::Error for RegistrationError {}

/// Whether there is more to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Call again.
    Working,
    /// Nothing left to do.
    Done,
}

/// What became of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Outcome {
    /// Not finished.
    Working,
    /// It was to stay, and did.
    Fixed,
    /// All six directions were corrected, and the corrections ended.
    Registered,
    /// Some directions are not known and were left as tracked; the others were corrected.
    Degenerate,
    /// Corrections had not become small when iterations ran out; the pose is the best found.
    NotConverged,
    /// Too little in common with the views that stand; the pose is the tracker's.
    NoOverlap,
    /// Too few cells agree with what the correction says; the pose is the tracker's.
    Poor,
    /// The correction is larger than allowed; the pose is the tracker's.
    TooFar,
}

impl Outcome {
    /// Whether the pose was corrected, in some directions at least.
    #[must_use]
    pub const fn is_corrected(self) -> bool {
        matches!(self, Self::Registered | Self::Degenerate | Self::NotConverged)
    }
}

/// A way in which a view may move: a turn about [`ViewReport::centre`] together with a shift of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Turn, world axes, radians (for the shift of [`Self::shift`]).
    pub turn: Vec3,
    /// Shift of the centre, world, metres. Together with the turn times the radius of the view's points a unit vector.
    pub shift: Vec3,
    /// Share of information on it: [`RegistrationParams::min_information`].
    pub information: f32,
}

/// What registration says of one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewReport {
    /// Camera-to-world, corrected.
    pub pose: Pose,
    /// Camera-to-world as given.
    pub tracked: Pose,
    /// What became of it.
    pub outcome: Outcome,
    /// Passes over its cells, coarse ones included.
    pub iterations: u16,
    /// Root mean square distance between its surfaces and the others', metres, of the inliers.
    pub rms: f32,
    /// Share of the matched cells that lie within 3 standard deviations.
    pub inliers: f32,
    /// Pairs of cells that were matched in the last pass.
    pub matched: u32,
    /// Middle of the view's points, world, metres: what [`Self::directions`] turn about.
    pub centre: Vec3,
    /// Six independent ways to move, the least known first.
    pub directions: [Direction; 6],
    /// How many of the directions, from the first, are not known and were not corrected.
    pub unknown: usize,
}

impl ViewReport {
    /// The directions that were not corrected.
    #[must_use]
    pub fn unknown_directions(&self) -> &[Direction] {
        self.directions.get(..self.unknown).unwrap_or(&self.directions)
    }
}

/// One view's place in memory.
#[derive(Debug, Clone, Copy)]
struct Slot {
    /// Rows of the grid that are fitted; `None` when there is no view.
    filled: Option<usize>,
    grid: Grid,
    extent: Extent,
    tracked: Pose,
}

impl Slot {
    const EMPTY: Self = Self {
        filled: None,
        grid: Grid::EMPTY,
        extent: Extent { count: 0, first: Vec3::ZERO, second: 0.0 },
        tracked: Pose::IDENTITY,
    };

    fn is_ready(&self) -> bool {
        self.filled.is_some_and(|rows| rows >= self.grid.rows)
    }
}

/// Up to `N` views whose poses are made to agree.
///
/// ```
/// use glam::{Quat, Vec3, vec3};
/// use isobath::lighting::registration::{Outcome, Progress, Registration, RegistrationParams, scratch_len};
/// use isobath::sensing::camera::{Intrinsics, Pose};
/// use isobath::sensing::depth::{DepthArray, DepthUnit, noise::DepthNoise};
/// use isobath::sensing::frame::DepthFrame;
///
/// // The corner of a room, seen twice from one place; the tracker believes that the camera moved in between.
/// let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5)?;
/// let mut depth = DepthArray::<160, 120>::filled(0);
/// for y in 0..120 {
///     for x in 0..160 {
///         let ray = k.ray(glam::vec2(x as f32, y as f32));
///         // Walls at x + z = 3 m and z - x = 3 m, floor at y = 1 m.
///         let z = (3.0 / (1.0 + ray.x)).min(3.0 / (1.0 - ray.x)).min(if ray.y > 0.0 { 1.0 / ray.y } else { 9.0 });
///         depth.view_mut().set(x, y, (z * 1000.0 + 0.5) as u16);
///     }
/// }
/// let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, k);
/// let drift = Pose::new(Quat::from_rotation_y(0.05), vec3(0.03, 0.0, -0.02))?;
///
/// let mut memory = [0.0; 2 * scratch_len(160, 120)];
/// let mut views = Registration::<2>::new(&mut memory, RegistrationParams::default());
/// views.set(0, &frame.with_pose(Pose::IDENTITY), &DepthNoise::NONE)?;
/// views.set(1, &frame.with_pose(drift), &DepthNoise::NONE)?;
/// views.start(&[0])?;
/// while views.step(1000) == Progress::Working {} // a little in each frame
/// let report = views.report(1).unwrap();
/// assert_eq!(report.outcome, Outcome::Registered);
/// assert!(report.pose.translation().length() < 0.001);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Registration<'m, const N: usize> {
    memory: &'m mut [f32],
    params: RegistrationParams,
    slots: [Slot; N],
    run: Run<N>,
}

impl<'m, const N: usize> Registration<'m, N> {
    /// Without views, over memory that is shared evenly among the slots ([`scratch_len`] floats each).
    #[must_use]
    pub const fn new(memory: &'m mut [f32], params: RegistrationParams) -> Self {
        Self { memory, params, slots: [Slot::EMPTY; N], run: Run::IDLE }
    }

    /// Floats of one slot.
    const fn share(&self) -> usize {
        match self.memory.len().checked_div(N) {
            Some(floats) => floats,
            None => 0,
        }
    }

    /// Begins a view in a slot, in place of what was there; [`Self::fill`] does the work. The frame's pose is what the tracker says.
    /// A registration that is under way ends without result.
    ///
    /// # Errors
    /// [`RegistrationError`]: no such slot, no pose, or too little memory.
    pub fn begin<D: DepthSample>(
        &mut self,
        slot: usize,
        frame: &DepthFrame<'_, D>,
        noise: &DepthNoise,
    ) -> Result<(), RegistrationError> {
        let floats = self.share();
        let place = self.slots.get_mut(slot).ok_or(RegistrationError::Slot { slot, slots: N })?;
        let tracked = frame.pose().ok_or(RegistrationError::NoPose)?;
        let mut cell = cell_for(frame.size().0);
        while cells(frame.size(), cell) > floats / FIELDS {
            cell = cell.saturating_mul(2);
        }
        let mut grid = Grid::new(frame, cell, noise);
        // A cell twice as wide has a normal four times as exact.
        while grid.normal_sigma(frame) > STEADY {
            let wider = Grid::new(frame, 2 * grid.cell, noise);
            if wider.cells() < LEAST_CELLS {
                break;
            }
            grid = wider;
        }
        if grid.cells() < LEAST_CELLS {
            return Err(RegistrationError::TooSmall { size: frame.size(), floats });
        }
        self.run.stop();
        *place = Slot { filled: Some(0), grid, extent: Extent::default(), tracked };
        Ok(())
    }

    /// Goes on with a view that was begun, with the same frame: reads rows of cells until about `budget` pixels are read, one row at
    /// least.
    ///
    /// # Errors
    /// [`RegistrationError`]: no such slot, or another frame than it was begun with.
    pub fn fill<D: DepthSample>(
        &mut self,
        slot: usize,
        frame: &DepthFrame<'_, D>,
        budget: usize,
    ) -> Result<Progress, RegistrationError> {
        let share = self.share();
        let start = slot.saturating_mul(share);
        let place = self.slots.get_mut(slot).ok_or(RegistrationError::Slot { slot, slots: N })?;
        let Some(mut row) = place.filled else { return Ok(Progress::Done) };
        if !place.grid.is_of(frame) {
            return Err(RegistrationError::OtherFrame);
        }
        let Grid { columns, rows, .. } = place.grid;
        let cells = place.grid.cells();
        let memory = self.memory.get_mut(start..).and_then(|m| m.get_mut(..FIELDS * cells)).unwrap_or_default();
        let (nx, rest) = memory.split_at_mut_checked(cells).unwrap_or_default();
        let (ny, nz) = rest.split_at_mut_checked(cells).unwrap_or_default();
        let mut spent = 0;
        while row < rows {
            let at = row * columns;
            fit_row(
                frame,
                &place.grid,
                row,
                [part(nx, at, columns), part(ny, at, columns), part(nz, at, columns)],
                &mut place.extent,
            );
            row += 1;
            place.filled = Some(row);
            spent += columns * place.grid.samples();
            if spent >= budget {
                break;
            }
        }
        Ok(if row < rows { Progress::Working } else { Progress::Done })
    }

    /// [`Self::begin`] and all of [`Self::fill`].
    ///
    /// # Errors
    /// Those of [`Self::begin`].
    pub fn set<D: DepthSample>(
        &mut self,
        slot: usize,
        frame: &DepthFrame<'_, D>,
        noise: &DepthNoise,
    ) -> Result<(), RegistrationError> {
        self.begin(slot, frame, noise)?;
        self.fill(slot, frame, usize::MAX).map(|_| ())
    }

    /// Gives a view another tracked pose, for instance the one it was corrected to. `false` when the slot is empty.
    pub fn set_pose(&mut self, slot: usize, pose: Pose) -> bool {
        let Some(place) = self.slots.get_mut(slot).filter(|s| s.filled.is_some()) else { return false };
        place.tracked = pose;
        self.run.stop();
        true
    }

    /// Empties a slot.
    pub fn clear(&mut self, slot: usize) {
        if let Some(place) = self.slots.get_mut(slot) {
            *place = Slot::EMPTY;
            self.run.stop();
        }
    }

    /// Begins to register all finished views; those in `fixed` stay where they are. [`Self::step`] does the work.
    ///
    /// # Errors
    /// [`RegistrationError::NothingFixed`] when no slot in `fixed` holds a finished view.
    pub fn start(&mut self, fixed: &[usize]) -> Result<(), RegistrationError> {
        let begun = self.run.begin(&self.slots, &self.params, fixed);
        if begun { Ok(()) } else { Err(RegistrationError::NothingFixed) }
    }

    /// Compares cells until about `budget` are compared, one row of cells at least.
    pub fn step(&mut self, budget: usize) -> Progress {
        let share = self.share();
        let mut spent = 0_usize;
        while !self.run.is_done() {
            spent = spent.saturating_add(self.run.unit(&self.slots, self.memory, share, &self.params));
            if spent >= budget {
                break;
            }
        }
        if self.run.is_done() { Progress::Done } else { Progress::Working }
    }

    /// What is known of a view; `None` when the slot holds no finished view, or nothing was started since it does.
    #[must_use]
    pub fn report(&self, slot: usize) -> Option<ViewReport> {
        self.run.report(slot, self.slots.get(slot)?)
    }
}

/// `len` values from `at`; fewer, or none, where the slice ends before.
fn part(slice: &mut [f32], at: usize, len: usize) -> &mut [f32] {
    slice.get_mut(at..).and_then(|rest| rest.get_mut(..len)).unwrap_or_default()
}
