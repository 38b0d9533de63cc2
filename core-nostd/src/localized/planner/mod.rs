//! How does one walk there, around what can't be climbed? A* over a height map, then the string pulled tight.
//!
//! Beyond the paper (its avatar climbs whatever is in the way; see [`avatar`](crate::localized::avatar)). Three steps:
//!
//! 1. *Terrain*: a cell is an obstacle when its readings spread over more than a step, when it stands more than a step above
//!    a neighbour, or when the ground around it rises by more than a step within the distance that the steepest walkable
//!    slope needs for it. Obstacles grow by the walker's radius. Unknown cells: [`Walker::unknown`].
//! 2. *A\**: Hart, Nilsson, Raphael 1968, eight neighbours, octile heuristic, binary heap with decrease-key; a diagonal step
//!    needs both cells beside it free. Cost of a step: its horizontal length + [`Walker::climb_cost`] x its rise or fall.
//! 3. *String pulling*: corners are dropped while the straight line crosses free cells only. The path gets never longer; what
//!    it costs may grow by 2 %, or the noise of a flat floor would keep every corner.
//!
//! Memory: 8 bytes a cell in the caller's slice (64 x 64: 33 kB, 128 x 128: 131 kB), no more. Cost on a Cortex-M4F: 80 instructions a
//! cell for the terrain (of a room half seen) and 1,000 an expanded cell. Error: ends lie at the middle of their cells (0.7 cells off at
//! most); the grid path costs what Dijkstra's does, to rounding (held by a test).

mod astar;
mod smooth;
mod terrain;

use core::fmt;

use glam::Vec3;

use crate::ground::math;
use crate::localized::height_map::{HeightCell, HeightMap};
use crate::sensing::depth::HolePolicy;

/// Working memory of one cell: what the caller's slice holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Cheapest known cost of the whole way through here, heuristic included: positive as long as it may fall, infinite where no
    /// way leads yet; negative (its sign turned) when done with, or not to be walked on.
    key: f32,
    /// From the lowest bit: 24 bits that are not of this node, the entry of the heap (later of the path) that happens to lie
    /// here; 3 bits of the direction it was reached by; 1 bit whether it is blocked; 4 bits, of a blocked node why, of another the
    /// last bits of its place in the heap.
    link: u32,
}

impl Node {
    /// What the slice is filled with: all zero, so that a static one costs no flash. A plan begins by overwriting it.
    pub const EMPTY: Self = Self { key: 0.0, link: 0 };

    const SLOT: u32 = 0x00ff_ffff;
    const FROM: u32 = 24;
    const BLOCKED: u32 = 1 << 27;
    const PLACE: u32 = 28;
    /// Places in the heap are told apart as far as this number.
    const PLACES: usize = 16;
    /// Can't be stood on. Each with [`Self::BLOCKED`].
    const OBSTACLE: u32 = 1 << 28;
    /// An obstacle is within the walker's radius.
    const CLOSE: u32 = 1 << 29;
    /// Unknown, and not to be walked on.
    const UNKNOWN: u32 = 1 << 30;
    /// The key of a blocked node.
    const OUT: f32 = -1.0;

    /// Whether the walker of the last plan could stand in the middle of this node's cell (nodes lie as the map's cells do).
    /// Meaningless before the first plan.
    #[must_use]
    pub const fn is_walkable(&self) -> bool {
        self.walkable()
    }

    const fn walkable(&self) -> bool {
        self.link & Self::BLOCKED == 0
    }

    /// Whether it is blocked for this reason.
    const fn is(&self, reason: u32) -> bool {
        !self.walkable() && self.link & reason != 0
    }

    const fn block(&mut self, reason: u32) {
        self.link |= Self::BLOCKED | reason;
    }

    #[inline(always)]
    const fn slot(&self) -> usize {
        (self.link & Self::SLOT) as usize
    }

    #[inline(always)]
    const fn set_slot(&mut self, slot: usize) {
        self.link = (self.link & !Self::SLOT) | (slot as u32 & Self::SLOT);
    }

    #[inline(always)]
    const fn from(&self) -> usize {
        (self.link >> Self::FROM & 7) as usize
    }

    #[inline(always)]
    const fn set_from(&mut self, from: usize) {
        self.link = (self.link & !(7 << Self::FROM)) | (from as u32 & 7) << Self::FROM;
    }

    /// The last bits of a free node's place.
    #[inline(always)]
    const fn place(&self) -> usize {
        (self.link >> Self::PLACE) as usize
    }

    #[inline(always)]
    const fn set_place(&mut self, place: usize) {
        self.link = (self.link & !(15 << Self::PLACE)) | (place as u32) << Self::PLACE;
    }
}

/// Who walks.
///
/// How tall it is, the map must know while readings arrive:
/// [`HeightMapParams::clearance`](crate::localized::height_map::HeightMapParams::clearance).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walker {
    /// Metres kept from obstacles, 0 or more. Default 0.2.
    pub radius: f32,
    /// Highest step up or down, metres, above 0. Default 0.2.
    pub max_step: f32,
    /// Steepest slope, radians, above 0 and below π/2. Default 0.61 (35°).
    pub max_slope: f32,
    /// Cost of a metre up or down, in metres of level walking, 0 or more. Default 1.
    pub climb_cost: f32,
    /// Cells without readings. `Unknown` (default): not walked on, and a goal there is [`Plan::GoalUnknown`]. `Solid`: an
    /// obstacle, kept at the radius. `Free`: walked on, as level as their surroundings.
    pub unknown: HolePolicy,
}

impl Walker {
    /// A small character.
    pub const DEFAULT: Self =
        Self { radius: 0.2, max_step: 0.2, max_slope: 0.61, climb_cost: 1.0, unknown: HolePolicy::Unknown };

    fn check(&self) -> Result<(), WalkerError> {
        let err = |name, value| Err(WalkerError { name, value });
        let finite = |v: f32, least: bool| v.is_finite() && least;
        if !finite(self.radius, self.radius >= 0.0) {
            return err("radius", self.radius);
        }
        if !finite(self.max_step, self.max_step > 0.0) {
            return err("max_step", self.max_step);
        }
        if !(self.max_slope > 0.0 && self.max_slope < core::f32::consts::FRAC_PI_2) {
            return err("max_slope", self.max_slope);
        }
        if !finite(self.climb_cost, self.climb_cost >= 0.0) {
            return err("climb_cost", self.climb_cost);
        }
        Ok(())
    }
}

impl Default for Walker {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A walker that can't be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WalkerError {
    /// The field at fault.
    pub name: &'static str,
    /// What it was.
    pub value: f32,
}

impl fmt::Display for WalkerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "walker: {} = {} is out of range; see Walker", self.name, self.value)
    }
}

impl core::error::Error for WalkerError {}

/// A path that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Path {
    /// World points written to the caller's slice, start and goal included; 1 when both are in one cell.
    pub points: usize,
    /// Length of the line through the points, metres.
    pub length: f32,
    /// Cost of the grid path before pulling, metres of level walking.
    pub cost: f32,
    /// Cells expanded.
    pub expanded: u32,
    /// Generation of the map it was planned on.
    pub generation: u32,
}

/// The answer to "how does one walk there?".
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Plan {
    /// There is a way.
    Found(Path),
    /// There is none over known, free ground.
    NoPath {
        /// Cells expanded: all that can be reached.
        expanded: u32,
    },
    /// The start lies outside the map.
    StartOutside,
    /// Nothing is known of the ground at the start.
    StartUnknown,
    /// The start is, or is too near to, an obstacle.
    StartBlocked,
    /// The goal lies outside the map.
    GoalOutside,
    /// Nothing is known of the ground at the goal.
    GoalUnknown,
    /// The goal is, or is too near to, an obstacle.
    GoalBlocked,
    /// Too few nodes for the map: nothing was planned.
    NodesExceeded {
        /// Nodes needed: the map's cells.
        needed: usize,
        /// Nodes given.
        got: usize,
    },
    /// There is a way, but the slice of points is too short for its corners; as many as fit, from the start on, were written.
    PointsExceeded {
        /// Points needed.
        needed: usize,
        /// Points given.
        got: usize,
    },
}

/// What became of an old plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Replan {
    /// No cell that matters to it has changed: the old points still hold.
    Kept,
    /// Planned anew.
    Planned(Plan),
}

/// The planner, in the caller's nodes.
///
/// ```
/// use glam::Vec3;
/// use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
/// use isobath::localized::planner::{Node, Plan, Planner, Walker};
/// let grid = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::NEG_Z, 0.1, 16, 16)?;
/// let mut cells = [HeightCell::UNKNOWN; 256];
/// let mut map = HeightMap::new(grid, &mut cells, HeightMapParams::DEFAULT)?;
/// for (column, row) in (0..16).flat_map(|r| (0..16).map(move |c| (c, r))) {
///     map.set(column, row, 0.0, 0.0);
/// }
/// let mut nodes = [Node::EMPTY; 256];
/// let mut points = [Vec3::ZERO; 32];
/// let (start, goal) = (grid.point_of(2, 2, 0.0), grid.point_of(12, 5, 0.0));
/// let plan = Planner::new(&mut nodes).plan(&map, &Walker::DEFAULT, start, goal, &mut points)?;
/// let Plan::Found(path) = plan else { panic!("{plan:?}") };
/// assert_eq!(path.points, 2); // open floor: a straight line
/// assert!((path.length - start.distance(goal)).abs() < 1e-5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Planner<'a> {
    nodes: &'a mut [Node],
}

impl<'a> Planner<'a> {
    /// A planner for maps of up to as many cells as there are nodes.
    #[must_use]
    pub const fn new(nodes: &'a mut [Node]) -> Self {
        Self { nodes }
    }

    /// Plans from `start` to `goal` (world, metres; their heights don't matter) and writes the corners, at ground height, to
    /// `points`.
    ///
    /// # Errors
    /// [`WalkerError`] when the walker is out of range.
    pub fn plan(
        &mut self,
        map: &HeightMap<'_>,
        walker: &Walker,
        start: Vec3,
        goal: Vec3,
        points: &mut [Vec3],
    ) -> Result<Plan, WalkerError> {
        walker.check()?;
        let grid = map.grid();
        let (width, depth) = grid.size();
        let (needed, got) = (grid.cells(), self.nodes.len());
        let Some(nodes) = self.nodes.get_mut(..needed) else {
            return Ok(Plan::NodesExceeded { needed, got });
        };
        let Some((sx, sy)) = grid.cell_of(start) else { return Ok(Plan::StartOutside) };
        let Some((gx, gy)) = grid.cell_of(goal) else { return Ok(Plan::GoalOutside) };
        terrain::classify(nodes, map, walker);
        let (start, goal) = (sy * width + sx, gy * width + gx);
        let node = |i: usize| nodes.get(i).copied().unwrap_or(Node::EMPTY);
        match (node(start), node(goal)) {
            (s, g) if s.walkable() && g.walkable() => {}
            (s, g) if s.walkable() && g.is(Node::UNKNOWN) => return Ok(Plan::GoalUnknown),
            (s, _) if s.walkable() => return Ok(Plan::GoalBlocked),
            (s, _) if s.is(Node::UNKNOWN) => return Ok(Plan::StartUnknown),
            _ => return Ok(Plan::StartBlocked),
        }
        let ground =
            Ground { map, cells: map.cells(), width, depth, cell: grid.cell(), climb: walker.climb_cost, goal, gx, gy };
        let (found, expanded) = astar::search(nodes, &ground, start);
        if !found {
            return Ok(Plan::NoPath { expanded });
        }
        let cost = ground.cost(nodes, goal);
        let cells = smooth::trace(nodes, &ground, start);
        let corners = smooth::pull(nodes, &ground, cells);
        // The corners lie goal first.
        let mut length = 0.0;
        let mut last: Option<Vec3> = None;
        // An unknown corner (`HolePolicy::Free`) stands as high as the corner before it.
        let mut height = 0.0;
        for (i, corner) in nodes.get(..corners).unwrap_or(&[]).iter().rev().enumerate() {
            height = ground.height(corner.slot()).unwrap_or(height);
            let point = ground.point(corner.slot(), height);
            length += last.map_or(0.0, |l| l.distance(point));
            last = Some(point);
            if let Some(out) = points.get_mut(i) {
                *out = point;
            }
        }
        if corners > points.len() {
            return Ok(Plan::PointsExceeded { needed: corners, got: points.len() });
        }
        Ok(Plan::Found(Path { points: corners, length, cost, expanded, generation: map.generation() }))
    }

    /// Plans anew only when a cell that bears on `previous`, whose corners are still in `points`, has changed since. A path
    /// that could now be shorter elsewhere is kept; when start or goal moved, call [`Self::plan`].
    ///
    /// # Errors
    /// [`WalkerError`] when the walker is out of range.
    pub fn replan(
        &mut self,
        map: &HeightMap<'_>,
        walker: &Walker,
        start: Vec3,
        goal: Vec3,
        previous: &Path,
        points: &mut [Vec3],
    ) -> Result<Replan, WalkerError> {
        walker.check()?;
        let old = points.get(..previous.points);
        if old.is_some_and(|old| !old.is_empty() && !path_changed(map, walker, old, previous.generation)) {
            return Ok(Replan::Kept);
        }
        self.plan(map, walker, start, goal, points).map(Replan::Planned)
    }
}

/// Whether a cell that decides if `points` can be walked has changed after generation `since` (or a point left the map).
#[must_use]
pub fn path_changed(map: &HeightMap<'_>, walker: &Walker, points: &[Vec3], since: u32) -> bool {
    let grid = map.grid();
    let (width, depth) = grid.size();
    // What makes a cell an obstacle lies within the slope's window of it, and the obstacle within the radius.
    let reach = terrain::disc(walker, grid.cell()) as usize + terrain::window(walker, grid.cell()) + 1;
    let touched = |p: Vec3| {
        let Some((x, y)) = grid.cell_of(p) else { return true };
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
        (y.saturating_sub(reach)..(y + reach + 1).min(depth)).any(|row| map.any_changed(row, columns.clone(), since))
    };
    if let [only] = points {
        return touched(*only);
    }
    points.windows(2).any(|pair| {
        let &[a, b] = pair else { return false };
        // One sample a cell: the reach has a cell to spare.
        let steps = math::clamp(math::ceil(a.distance(b) / grid.cell()), 1.0, (width + depth) as f32) as u32;
        (0..=steps).any(|i| touched(a + (b - a) * (i as f32 / steps as f32)))
    })
}

/// What the search knows of the map, and where it goes.
struct Ground<'m> {
    map: &'m HeightMap<'m>,
    cells: &'m [HeightCell],
    width: usize,
    depth: usize,
    /// Side of a cell, metres.
    cell: f32,
    climb: f32,
    goal: usize,
    /// The goal's column and row.
    gx: usize,
    gy: usize,
}

impl Ground<'_> {
    /// Mean height; `None` where unknown.
    #[inline]
    fn height(&self, i: usize) -> Option<f32> {
        self.cells.get(i).and_then(|c| c.is_known().then_some(c.mean))
    }

    /// What the way from a cell to the goal costs at least: straight and diagonal steps only.
    #[inline]
    fn ahead(&self, x: i32, y: i32) -> f32 {
        let (dx, dy) = (x.abs_diff(self.gx as i32), y.abs_diff(self.gy as i32));
        let (long, short) = (dx.max(dy) as f32, dx.min(dy) as f32);
        // A hair below the truth, so that rounding never makes it promise too much.
        (long + (core::f32::consts::SQRT_2 - 1.0) * short) * 0.999_999 * self.cell
    }

    /// Cost of the cheapest way found from the start to a cell that the search is done with.
    fn cost(&self, nodes: &[Node], i: usize) -> f32 {
        let (x, y) = self.column_row(i);
        nodes.get(i).map_or(0.0, |n| n.key.abs() - self.ahead(x, y))
    }

    /// Which of the eight neighbours of a cell lie on the map, a bit each.
    #[inline]
    fn inside(&self, x: i32, y: i32) -> u32 {
        let mut inside = 0xff;
        if x == 0 {
            inside &= !0b0011_1000;
        }
        if x + 1 == self.width as i32 {
            inside &= !0b1000_0011;
        }
        if y == 0 {
            inside &= !0b1110_0000;
        }
        if y + 1 == self.depth as i32 {
            inside &= !0b0000_1110;
        }
        inside
    }

    /// Cost of the rise or fall between two cells.
    #[inline]
    fn climb(&self, from: Option<f32>, to: Option<f32>) -> f32 {
        match (from, to) {
            (Some(a), Some(b)) => self.climb * (a - b).abs(),
            _ => 0.0,
        }
    }

    fn column_row(&self, i: usize) -> (i32, i32) {
        let w = self.width.max(1);
        ((i % w) as i32, (i / w) as i32)
    }

    fn index(&self, x: i32, y: i32) -> Option<usize> {
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        (x < self.width && y < self.depth).then_some(y * self.width + x)
    }

    fn point(&self, i: usize, height: f32) -> Vec3 {
        let (x, y) = self.column_row(i);
        self.map.grid().point_of(x as usize, y as usize, height)
    }
}

#[cfg(test)]
mod tests;
