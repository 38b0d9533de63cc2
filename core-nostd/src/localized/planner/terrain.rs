//! Where can the walker stand? Height map to obstacles, then obstacles grown by the walker's radius.
//!
//! A slope that is too steep over so many cells has a step among them that is steeper than its mean. So every cell is compared
//! with its neighbours alone, and only where one stands out is the ground around it judged: on a floor nowhere.

use super::{Node, Walker};
use crate::ground::math;
use crate::localized::height_map::HeightMap;
use crate::sensing::depth::HolePolicy;

/// Cells over which a slope is judged, at most.
const MOST: usize = 32;

/// Cells over which the steepest walkable slope rises by a step: a steeper one rises more, a gentler one less.
pub(super) fn window(walker: &Walker, cell: f32) -> usize {
    (math::ceil(walker.max_step / (math::tan(walker.max_slope) * cell)) as usize).clamp(1, MOST)
}

/// Radius in whole cells of the disc around an obstacle's middle that the walker's middle keeps out of.
pub(super) fn disc(walker: &Walker, cell: f32) -> i32 {
    math::floor((walker.radius / cell + 0.5).min(1e6)) as i32
}

/// Sets every node to "never reached" and to what its cell is for this walker.
pub(super) fn classify(nodes: &mut [Node], map: &HeightMap<'_>, walker: &Walker) {
    let (width, depth) = map.grid().size();
    let cell = map.grid().cell();
    let tan = math::tan(walker.max_slope);
    // A tenth of a millimetre for rounding: a step of exactly the height allowed is allowed.
    let limit = |distance: f32| {
        let ramp = distance * tan;
        (if ramp > walker.max_step { ramp } else { walker.max_step }) + 1e-4
    };
    let spread = limit(cell * core::f32::consts::SQRT_2);
    let unknown = match walker.unknown {
        HolePolicy::Unknown => Node::BLOCKED | Node::UNKNOWN,
        HolePolicy::Solid => Node::BLOCKED | Node::OBSTACLE,
        HolePolicy::Free => 0,
    };
    for (node, c) in nodes.iter_mut().zip(map.cells()) {
        // The height lies in the key until the search needs it: NaN where there is none, or none that says anything.
        (node.link, node.key) = match c.is_known() {
            false => (unknown, f32::NAN),
            // Negated, so that NaN is an obstacle.
            true if !(c.max - c.min <= spread) => (Node::BLOCKED | Node::OBSTACLE, f32::NAN),
            true => (0, c.mean),
        };
    }
    let lines = [(1, 0), (1, 1), (0, 1), (-1, 1)].map(|(dx, dy)| Line::new(dx, dy, map, walker, &limit));
    let least = lines.each_ref().map(|line| line.noticed);
    for y in 0..depth {
        let mut x = 0;
        while let Some((at, steps)) = next_step(nodes, (width, y), x, &least) {
            for (line, step) in lines.iter().zip(steps) {
                if step {
                    line.judge(nodes, (width, depth), (at, y));
                }
            }
            x = at + 1;
        }
    }
    grow(nodes, width, depth, walker.radius / cell + 0.5);
}

/// The first cell of row `y`, from column `x` on, that stands out from a neighbour by more than the least step noticed in that
/// neighbour's direction; and which of the four neighbours it is: right, right below, below, left below.
#[inline]
fn next_step(nodes: &[Node], (width, y): (usize, usize), x: usize, least: &[f32; 4]) -> Option<(usize, [bool; 4])> {
    let row = nodes.get(y * width + x..(y + 1) * width)?;
    let below = nodes.get((y + 1) * width + x..(y + 2) * width).unwrap_or(&[]);
    let height = |n: Option<&Node>| n.map_or(f32::NAN, |n| n.key);
    let &[right, right_below, straight_below, left_below] = least;
    let mut here = height(row.first());
    let mut under = height(below.first());
    let mut before = if x == 0 || below.is_empty() { f32::NAN } else { height(nodes.get((y + 1) * width + x - 1)) };
    for k in 0..row.len() {
        let (next, after) = (height(row.get(k + 1)), height(below.get(k + 1)));
        if !here.is_nan() {
            // False where the other is NaN.
            let steps = [
                (next - here).abs() > right,
                (after - here).abs() > right_below,
                (under - here).abs() > straight_below,
                (before - here).abs() > left_below,
            ];
            if steps.contains(&true) {
                return Some((x + k, steps));
            }
        }
        (here, before, under) = (next, under, after);
    }
    None
}

/// A way in which ledges and slopes are looked for: half of the eight, the others are these from the other end.
struct Line {
    dx: isize,
    dy: isize,
    /// Nodes from a cell to the next. Never back; it would be 0 only in a map one cell wide, where there is no step to take.
    hop: usize,
    /// Largest rise over so many cells.
    limits: [f32; MOST],
    /// Cells over which a slope is judged.
    far: usize,
    /// Every slope that is too steep has a step higher than this.
    noticed: f32,
    /// The bit of a node that says that the slopes that begin there were judged.
    judged: u32,
}

impl Line {
    fn new(dx: isize, dy: isize, map: &HeightMap<'_>, walker: &Walker, limit: &impl Fn(f32) -> f32) -> Self {
        let (width, cell) = (map.grid().size().0, map.grid().cell());
        let pace = if dx != 0 && dy != 0 { cell * core::f32::consts::SQRT_2 } else { cell };
        let limits: [f32; MOST] = core::array::from_fn(|i| limit(pace * (i + 1) as f32));
        let hop = (dy * width as isize + dx).unsigned_abs().max(1);
        let far = window(walker, pace);
        // A thousandth for rounding.
        let mean = |(i, limit): (usize, &f32)| 0.999 * limit / (i + 1) as f32;
        let noticed = limits.iter().take(far).enumerate().map(mean).fold(f32::INFINITY, f32::min);
        Self { dx, dy, hop, limits, far, noticed, judged: 1 << (dx + 3 * dy) }
    }

    /// Marks what is wrong with the step that leaves a cell.
    fn judge(&self, nodes: &mut [Node], (width, depth): (usize, usize), (x, y): (usize, usize)) {
        let [one, ..] = self.limits;
        let height = |nodes: &[Node], i: usize| nodes.get(i).map_or(f32::NAN, |n| n.key);
        let at = y * width + x;
        let (here, there) = (height(nodes, at), height(nodes, at + self.hop));
        if (there - here).abs() > one {
            // A ledge: its upper side is what can't be walked onto, or off.
            mark(nodes, if there > here { at + self.hop } else { at });
            return;
        }
        let judged = |nodes: &[Node], i: usize| nodes.get(i).is_none_or(|n| n.link & self.judged != 0);
        if judged(nodes, at) {
            return;
        }
        // Cells to the map's border, there and back.
        let (there, back) = match self.dx {
            0 => (usize::MAX, usize::MAX),
            1 => (width - 1 - x, x),
            _ => (x, width - 1 - x),
        };
        let (there, back) = if self.dy > 0 { (there.min(depth - 1 - y), back.min(y)) } else { (there, back) };
        // The slopes that this step is part of begin here and at the cells before, as far as the ground hangs together.
        let (mut first, mut before) = (at, 0);
        let mut last = here;
        while before < back.min(self.far - 1) {
            let previous = first - self.hop;
            let h = height(nodes, previous);
            if !((last - h).abs() <= one) || judged(nodes, previous) {
                break;
            }
            (first, before, last) = (previous, before + 1, h);
        }
        // From the first on: as long as all lies within the height of a step, no slope is too steep.
        let reach = there + before;
        let (mut low, mut high) = (last, last);
        let (mut end, mut k) = (first, 0);
        let gentle = loop {
            if k == reach.min(2 * self.far) {
                // At the border slopes end; else they go on.
                break if k == reach { k + 1 } else { k + 1 - self.far };
            }
            let h = height(nodes, end + self.hop);
            if !((h - last).abs() <= one) {
                break k + 1;
            }
            (end, k, last) = (end + self.hop, k + 1, h);
            low = if h < low { h } else { low };
            high = if h > high { h } else { high };
            if high - low > one {
                break k.saturating_sub(self.far);
            }
        };
        for i in 0..gentle.max(before + 1) {
            let from = first + i * self.hop;
            if let Some(node) = nodes.get_mut(from) {
                node.link |= self.judged;
            }
            if i >= gentle {
                self.slope(nodes, from, reach - i);
            }
        }
    }

    /// Marks the slope that begins at a cell if it is too steep; there are `left` more cells.
    fn slope(&self, nodes: &mut [Node], from: usize, left: usize) {
        let [one, ..] = self.limits;
        let first = nodes.get(from).map_or(f32::NAN, |n| n.key);
        let (mut here, mut at) = (first, from);
        for (k, &ramp) in self.limits.iter().take(left.min(self.far)).enumerate() {
            let Some(&Node { key: there, .. }) = nodes.get(at + self.hop) else { break };
            // A hole, or a ledge.
            if !((there - here).abs() <= one) {
                break;
            }
            if (there - first).abs() > ramp {
                // Too steep: all between the ends.
                for between in 1..=k {
                    mark(nodes, from + between * self.hop);
                }
                break;
            }
            (here, at) = (there, at + self.hop);
        }
    }
}

fn mark(nodes: &mut [Node], i: usize) {
    if let Some(node) = nodes.get_mut(i) {
        node.block(Node::OBSTACLE);
    }
}

/// Half the width of a disc `dy` rows from its middle.
fn half(radius: f32, dy: usize) -> usize {
    math::floor(math::sqrt((radius * radius - (dy * dy) as f32).max(0.0))) as usize
}

/// Marks all within `radius` cells of an obstacle, and makes the keys ready for the search: "never reached", or not to be.
fn grow(nodes: &mut [Node], width: usize, depth: usize, radius: f32) {
    let most = radius.min((width + depth) as f32);
    let reach = math::floor(most) as usize;
    let halves: [usize; 8] = core::array::from_fn(|dy| half(most, dy));
    for y in 0..depth {
        let mut x = 0;
        while let Some(run) = next_run(nodes, width, y, x) {
            x = run.end;
            if reach == 0 {
                continue;
            }
            for up in [true, false] {
                // Where the row beside is an obstacle all along the run, its own discs cover what this one's would.
                let beside = if up { y.checked_sub(1) } else { Some(y + 1).filter(|&r| r < depth) };
                let Some(beside) = beside else { continue };
                let beside = nodes.get(beside * width + run.start..beside * width + run.end).unwrap_or(&[]);
                if beside.iter().all(|n| n.link & Node::OBSTACLE != 0) {
                    continue;
                }
                for dy in 1..=reach {
                    let row = if up { y.checked_sub(dy) } else { Some(y + dy).filter(|&r| r < depth) };
                    let Some(row) = row else { break };
                    close(nodes, width, row, &run, halves.get(dy).copied().unwrap_or_else(|| half(most, dy)));
                }
            }
            let [widest, ..] = halves;
            close(nodes, width, y, &run, widest);
        }
    }
}

/// Marks the cells of a row beside a run of columns as too near to it.
fn close(nodes: &mut [Node], width: usize, row: usize, run: &core::ops::Range<usize>, half: usize) {
    let span = row * width + run.start.saturating_sub(half)..row * width + (run.end + half).min(width);
    for node in nodes.get_mut(span).unwrap_or(&mut []) {
        node.block(Node::CLOSE);
        node.key = Node::OUT;
    }
}

/// The next run of obstacles in a row, from column `x` on; sets the keys of the cells on the way there.
fn next_run(nodes: &mut [Node], width: usize, y: usize, x: usize) -> Option<core::ops::Range<usize>> {
    let row = nodes.get_mut(y * width + x..(y + 1) * width)?;
    let mut start = None;
    for (k, node) in row.iter_mut().enumerate() {
        let obstacle = node.link & Node::OBSTACLE != 0;
        node.key = if node.walkable() { f32::INFINITY } else { Node::OUT };
        match start {
            None if obstacle => start = Some(x + k),
            Some(start) if !obstacle => return Some(start..x + k),
            _ => {}
        }
    }
    start.map(|start| start..width)
}
