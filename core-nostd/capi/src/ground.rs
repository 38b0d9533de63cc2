//! How high is the ground, and how does one walk there? See the core's `height_map` and `planner`.

use isobath::glam;
use isobath::localized::height_map::{Grid, HeightMapParams};
use isobath::localized::planner::{Plan, Planner, Walker as CoreWalker};

use crate::check::{Plain, aligned, answer, done, read, read_or};
use crate::context::{Context, Edit, View};
use crate::memory::Layout;
use crate::status::Status;
use crate::types::{Holes, Vec3};

/// Where the ground is mapped, and how.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Map {
    /// The map's middle in the world, metres; its height is height 0. Default 0 0 0.
    pub centre: Vec3,
    /// Up in the world, any length but 0. Default 0 1 0.
    pub up: Vec3,
    /// Along the map's rows' numbers, a world direction not along up. Default 0 0 -1.
    pub forward: Vec3,
    /// Side of a cell, metres, 0.001 to 1000. Default 0.05.
    pub cell: f32,
    /// Cells to the right. Default 64; 0 and 0: no map.
    pub columns: u32,
    /// Cells forward. Default 64.
    pub rows: u32,
    /// Free height that a walker needs, metres, above 0; what hangs higher does not block. Default 1.
    pub clearance: f32,
    /// Readings further above or below the map's plane are left out, metres, above 0. Default 3.
    pub reach: f32,
    /// Every n-th pixel of every n-th row is read, 1 or more. Default 1.
    pub pixel_step: u32,
}

// SAFETY: `repr(C)`, numbers of four bytes alone.
unsafe impl Plain for Map {}

impl Map {
    pub(crate) const NONE: Self = Self { columns: 0, rows: 0, ..Self::DEFAULT };
    const DEFAULT: Self = Self {
        centre: Vec3 { x: 0.0, y: 0.0, z: 0.0 },
        up: Vec3 { x: 0.0, y: 1.0, z: 0.0 },
        forward: Vec3 { x: 0.0, y: 0.0, z: -1.0 },
        cell: 0.05,
        columns: 64,
        rows: 64,
        clearance: HeightMapParams::DEFAULT.clearance,
        reach: HeightMapParams::DEFAULT.reach,
        pixel_step: HeightMapParams::DEFAULT.stride,
    };

    pub(crate) fn core(&self) -> Result<(Grid, HeightMapParams), Status> {
        let positive = |n: f32| n > 0.0 && n.is_finite();
        if !(positive(self.clearance) && positive(self.reach)) || self.pixel_step == 0 {
            return Err(Status::ErrorParameter);
        }
        let params = HeightMapParams {
            clearance: self.clearance,
            reach: self.reach,
            stride: self.pixel_step,
            ..HeightMapParams::DEFAULT
        };
        let (columns, rows) = (self.columns as usize, self.rows as usize);
        let grid = Grid::new(self.centre.into(), self.up.into(), self.forward.into(), self.cell, columns, rows);
        Ok((grid.map_err(|_| Status::ErrorGrid)?, params))
    }
}

/// Writes the defaults: 3.2 m x 3.2 m around the world's origin at 5 cm.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_map_defaults(map: *mut Map) -> Status {
    // SAFETY: promised by the caller.
    unsafe { answer(map, || Ok(Map::DEFAULT)) }
}

/// Lays the map elsewhere, of nothing known: when tracking starts anew, or the user has walked off it. It must not have more
/// cells than the context was made with.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_map_restart(context: *mut Context, map: *const Map) -> Status {
    let restart = || {
        // SAFETY: promised by the caller.
        let (mut context, map) = unsafe { (Edit::open(context)?, read(map)?) };
        if context.header.columns == 0 {
            return Err(Status::ErrorNoMap);
        }
        let layout = Layout::new(context.header.width, context.header.height, map.columns, map.rows);
        if map.columns == 0 || layout.is_none_or(|l| l.map_cells > context.heights.len()) {
            return Err(Status::ErrorSize);
        }
        let (grid, _) = map.core()?;
        let mut old = context.header.height_map(context.heights)?;
        old.restart(grid).map_err(|_| Status::ErrorSize)?;
        context.header.generation = old.generation();
        context.header.map = map;
        context.keep();
        Ok(())
    };
    done(restart())
}

/// What became of a frame's readings.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Integrated {
    /// Readings that moved a cell.
    pub used: u32,
    /// Readings more than the clearance above their cell's lowest.
    pub overhead: u32,
    /// Readings off the map, or beyond its reach.
    pub outside: u32,
    /// Pixels without a reading.
    pub holes: u32,
}

/// Adds the frame's readings to the map, at its pose. Once a frame, when paths are asked for: about 20 ns a reading on a desktop
/// core. `report` may be null.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_integrate(context: *mut Context, report: *mut Integrated) -> Status {
    let integrate = || {
        // SAFETY: promised by the caller.
        let mut context = unsafe { Edit::open(context)? };
        let frame = context.header.frame(context.depth)?;
        let mut map = context.header.height_map(context.heights)?;
        let r = map.integrate(&frame);
        context.header.generation = map.generation();
        context.keep();
        Ok(Integrated { used: r.used, overhead: r.overhead, outside: r.outside, holes: r.holes })
    };
    if report.is_null() {
        return done(integrate().map(|_| ()));
    }
    // SAFETY: promised by the caller.
    unsafe { answer(report, integrate) }
}

/// Lets what is not seen again fade from the map: call it once a second or so.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_map_fade(context: *mut Context) -> Status {
    let fade = || {
        // SAFETY: promised by the caller.
        let mut context = unsafe { Edit::open(context)? };
        let mut map = context.header.height_map(context.heights)?;
        map.fade();
        context.header.generation = map.generation();
        context.keep();
        Ok(())
    };
    done(fade())
}

/// What is known of the ground at a point.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GroundOutcome {
    /// Its height.
    Known = 0,
    /// Nothing was seen there.
    Unknown = 1,
    /// The point is off the map.
    OutsideMap = 2,
}

/// The answer of isobath_ground_at. Heights: metres above the map's centre, along up; 0 unless known.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// What is known.
    pub outcome: GroundOutcome,
    /// Lowest reading.
    pub min: f32,
    /// Highest reading below the clearance.
    pub max: f32,
    /// Mean of the readings.
    pub mean: f32,
    /// Readings that took part.
    pub support: u32,
}

/// How high is the ground below or above a world point (metres)?
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_ground_at(context: *const Context, point: *const Vec3, ground: *mut Ground) -> Status {
    let look = || {
        // SAFETY: promised by the caller.
        let (context, point) = unsafe { (View::open(context)?, read(point)?) };
        let (grid, _) = context.header.grid()?;
        let nothing = |outcome| Ground { outcome, min: 0.0, max: 0.0, mean: 0.0, support: 0 };
        let cell = grid.cell_of(point.into());
        let Some(cell) = cell.and_then(|(column, row)| context.heights.get(row * grid.size().0 + column)) else {
            return Ok(nothing(GroundOutcome::OutsideMap));
        };
        Ok(if cell.is_known() {
            let (min, max, mean, support) = (cell.min, cell.max, cell.mean, u32::from(cell.support));
            Ground { outcome: GroundOutcome::Known, min, max, mean, support }
        } else {
            nothing(GroundOutcome::Unknown)
        })
    };
    // SAFETY: promised by the caller.
    unsafe { answer(ground, look) }
}

/// Who walks.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walker {
    /// Metres kept from obstacles, 0 or more. Default 0.2.
    pub radius: f32,
    /// Highest step up or down, metres, above 0. Default 0.2.
    pub max_step: f32,
    /// Steepest slope, radians, above 0 and below pi / 2. Default 0.61.
    pub max_slope: f32,
    /// Cost of a metre up or down in metres of level walking, 0 or more. Default 1.
    pub climb_cost: f32,
    /// An isobath_holes: cells that nobody saw. Default unknown: not walked on.
    pub unknown: i32,
}

// SAFETY: `repr(C)`, numbers of four bytes alone.
unsafe impl Plain for Walker {}

impl Walker {
    const DEFAULT: Self = Self {
        radius: CoreWalker::DEFAULT.radius,
        max_step: CoreWalker::DEFAULT.max_step,
        max_slope: CoreWalker::DEFAULT.max_slope,
        climb_cost: CoreWalker::DEFAULT.climb_cost,
        unknown: Holes::Unknown as i32,
    };
}

/// Writes the defaults: a small character.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_walker_defaults(walker: *mut Walker) -> Status {
    // SAFETY: promised by the caller.
    unsafe { answer(walker, || Ok(Walker::DEFAULT)) }
}

/// Whether there is a way.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathOutcome {
    /// There is.
    Found = 0,
    /// There is none over known, free ground.
    NoPath = 1,
    /// The start is off the map.
    StartOutside = 2,
    /// Nothing is known of the ground at the start.
    StartUnknown = 3,
    /// The start is, or is too near to, an obstacle.
    StartBlocked = 4,
    /// The goal is off the map.
    GoalOutside = 5,
    /// Nothing is known of the ground at the goal.
    GoalUnknown = 6,
    /// The goal is, or is too near to, an obstacle.
    GoalBlocked = 7,
    /// There is a way, but `points` is too short: as many as fit, from the start on, were written; see `needed`.
    PointsExceeded = 8,
}

/// The answer of isobath_path; what does not apply is 0.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Path {
    /// Whether there is a way.
    pub outcome: PathOutcome,
    /// Points written.
    pub count: u32,
    /// Points that the way has.
    pub needed: u32,
    /// Length of the way, metres.
    pub length: f32,
    /// Its cost before it was straightened, metres of level walking.
    pub cost: f32,
    /// Cells that the search expanded.
    pub expanded: u32,
}

/// How does one walk there? Plans over what isobath_integrate has mapped, needs no frame.
///
/// from, to: world, metres; their heights do not matter. walker: null for the defaults.
/// points: receives the corners, start and goal included, at ground height, world, metres; may be null when capacity is 0.
///
/// # Safety
/// See isobath_init; `points` holds `capacity` of them. Memory up to there is overwritten, beyond `count` with nothing of use.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_path(
    context: *mut Context,
    from: *const Vec3,
    to: *const Vec3,
    walker: *const Walker,
    points: *mut Vec3,
    capacity: usize,
    path: *mut Path,
) -> Status {
    let find = || {
        // SAFETY: promised by the caller.
        let (context, from, to, walker) =
            unsafe { (Edit::open(context)?, read(from)?, read(to)?, read_or(walker, Walker::DEFAULT)?) };
        let walker = CoreWalker {
            radius: walker.radius,
            max_step: walker.max_step,
            max_slope: walker.max_slope,
            climb_cost: walker.climb_cost,
            unknown: Holes::policy(walker.unknown)?,
        };
        // A path can't have more corners than the map has cells: no more is looked at, however large the number.
        let capacity = capacity.min(context.nodes.len());
        let corners: &mut [glam::Vec3] = if capacity == 0 {
            &mut []
        } else {
            aligned(points)?;
            if context.overlaps(points, capacity * size_of::<Vec3>()) {
                return Err(Status::ErrorOverlap);
            }
            // SAFETY: aligned, as many as the caller says, apart from the context; both types are three `f32` in C's order
            // (asserted below). Zeroed first, so that the slice is of initialised memory.
            unsafe {
                points.write_bytes(0, capacity);
                core::slice::from_raw_parts_mut(points.cast(), capacity)
            }
        };
        let map = context.header.height_map(context.heights)?;
        let plan = Planner::new(context.nodes).plan(&map, &walker, from.into(), to.into(), corners);
        let nothing = Path { outcome: PathOutcome::NoPath, count: 0, needed: 0, length: 0.0, cost: 0.0, expanded: 0 };
        let because = |outcome| Path { outcome, ..nothing };
        Ok(match plan.map_err(|_| Status::ErrorParameter)? {
            Plan::Found(path) => Path {
                outcome: PathOutcome::Found,
                count: path.points as u32,
                needed: path.points as u32,
                length: path.length,
                cost: path.cost,
                expanded: path.expanded,
            },
            Plan::NoPath { expanded } => Path { expanded, ..nothing },
            Plan::StartOutside => because(PathOutcome::StartOutside),
            Plan::StartUnknown => because(PathOutcome::StartUnknown),
            Plan::StartBlocked => because(PathOutcome::StartBlocked),
            Plan::GoalOutside => because(PathOutcome::GoalOutside),
            Plan::GoalUnknown => because(PathOutcome::GoalUnknown),
            Plan::GoalBlocked => because(PathOutcome::GoalBlocked),
            Plan::PointsExceeded { needed, got } => {
                Path { count: got as u32, needed: needed as u32, ..because(PathOutcome::PointsExceeded) }
            }
            // A context has a node for every cell.
            Plan::NodesExceeded { .. } => return Err(Status::ErrorContext),
        })
    };
    // SAFETY: promised by the caller.
    unsafe { answer(path, find) }
}

const _: () = assert!(
    size_of::<Vec3>() == size_of::<glam::Vec3>() && align_of::<Vec3>() == align_of::<glam::Vec3>(),
    "a slice of one is read as a slice of the other; glam's is `repr(C)`"
);
