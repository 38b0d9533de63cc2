//! Where can the walker stand? Height map to obstacles, then obstacles grown by the walker's radius.

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
        HolePolicy::Unknown => Node::UNKNOWN,
        HolePolicy::Solid => Node::OBSTACLE,
        HolePolicy::Free => 0,
    };
    for (node, c) in nodes.iter_mut().zip(map.cells()) {
        *node = Node::FAR;
        // The height lies in `g` until the search needs it: NaN where there is none, or none that says anything.
        (node.state, node.g) = match c.is_known() {
            false => (unknown, f32::NAN),
            // Negated, so that NaN is an obstacle.
            true if !(c.max - c.min <= spread) => (Node::OBSTACLE, f32::NAN),
            true => (0, c.mean),
        };
    }
    // Blocks of cells whose surroundings rise by less than any limit hold nothing to mark: most of a floor.
    let gentle = limit(cell);
    let around = window(walker, cell).div_ceil(BLOCK);
    let directions = [(1, 0), (0, 1), (1, 1), (-1, 1)].map(|(dx, dy)| Direction::new(dx, dy, map, walker, &limit));
    let (across, down) = (width.div_ceil(BLOCK), depth.div_ceil(BLOCK));
    let block = |bx: usize, by: usize| {
        let (x, y) = (bx * BLOCK, by * BLOCK);
        (x..(x + BLOCK).min(width), y..(y + BLOCK).min(depth))
    };
    let blocks = || (0..down).flat_map(|by| (0..across).map(move |bx| (bx, by)));
    for (bx, by) in blocks() {
        note_extremes(nodes, width, &block(bx, by));
    }
    for (bx, by) in blocks() {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for y in by.saturating_sub(around)..(by + around + 1).min(down) {
            for x in bx.saturating_sub(around)..(bx + around + 1).min(across) {
                let (least, most) = noted_extremes(nodes, y * BLOCK * width + x * BLOCK);
                low = if least < low { least } else { low };
                high = if most > high { most } else { high };
            }
        }
        if high - low > gentle {
            for direction in &directions {
                judge(nodes, map, direction, &block(bx, by));
            }
        }
    }
    for node in nodes.iter_mut() {
        (node.g, node.f) = (Node::FAR.g, Node::FAR.f);
    }
    grow(nodes, width, depth, walker.radius / cell + 0.5);
}

/// Side of the blocks of cells that are skipped together.
const BLOCK: usize = 8;

/// A rectangle of cells: columns, rows.
type Cells = (core::ops::Range<usize>, core::ops::Range<usize>);

/// Writes the lowest and the highest height of a block into its first node, where the search will keep other things.
fn note_extremes(nodes: &mut [Node], width: usize, (columns, rows): &Cells) {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for y in rows.clone() {
        for node in nodes.get(y * width + columns.start..y * width + columns.end).unwrap_or(&[]) {
            low = if node.g < low { node.g } else { low };
            high = if node.g > high { node.g } else { high };
        }
    }
    if let Some(node) = nodes.get_mut(rows.start * width + columns.start) {
        (node.f, node.slot) = (low, high.to_bits());
    }
}

fn noted_extremes(nodes: &[Node], first: usize) -> (f32, f32) {
    nodes.get(first).map_or((f32::INFINITY, f32::NEG_INFINITY), |n| (n.f, f32::from_bits(n.slot)))
}

/// A way in which ledges and slopes are looked for: half of the eight, the others are these from the other end.
struct Direction {
    dx: isize,
    /// Nodes from a cell to the next. Never back; it would be 0 only in a map one cell wide, where there is no step to take.
    hop: usize,
    down: bool,
    /// Largest rise over so many cells.
    limits: [f32; MOST],
    /// Cells over which a slope is judged.
    far: usize,
}

impl Direction {
    fn new(dx: isize, dy: isize, map: &HeightMap<'_>, walker: &Walker, limit: &impl Fn(f32) -> f32) -> Self {
        let (width, cell) = (map.grid().size().0, map.grid().cell());
        let pace = if dx != 0 && dy != 0 { cell * core::f32::consts::SQRT_2 } else { cell };
        let limits = core::array::from_fn(|i| limit(pace * (i + 1) as f32));
        let hop = (dy * width as isize + dx).unsigned_abs().max(1);
        Self { dx, hop, down: dy > 0, limits, far: window(walker, pace) }
    }
}

/// Marks ledges and slopes that start in a rectangle of cells.
fn judge(nodes: &mut [Node], map: &HeightMap<'_>, direction: &Direction, (columns, rows): &Cells) {
    let (width, depth) = map.grid().size();
    let &Direction { dx, hop, down, ref limits, far } = direction;
    let [one, ..] = *limits;
    for (y, x) in rows.clone().flat_map(|y| columns.clone().map(move |x| (y, x))) {
        let from = y * width + x;
        let first = nodes.get(from).map_or(f32::NAN, |n| n.g);
        if first.is_nan() {
            continue;
        }
        // Cells left in this direction.
        let across = match dx {
            0 => MOST,
            1 => width - 1 - x,
            _ => x,
        };
        let left = far.min(across).min(if down { depth - 1 - y } else { MOST });
        let (mut here, mut at) = (first, from);
        for (k, &ramp) in limits.iter().take(left).enumerate() {
            let Some(&Node { g: there, .. }) = nodes.get(at + hop) else { break };
            if !((there - here).abs() <= one) {
                // A hole, or a ledge: its upper side is what can't be walked onto, or off. A pair belongs to its own turn.
                if k == 0 && !there.is_nan() {
                    mark(nodes, if there > here { at + hop } else { at });
                }
                break;
            }
            if (there - first).abs() > ramp {
                // Too steep: all between the ends.
                for between in 1..=k {
                    mark(nodes, from + between * hop);
                }
                break;
            }
            (here, at) = (there, at + hop);
        }
    }
}

fn mark(nodes: &mut [Node], i: usize) {
    if let Some(node) = nodes.get_mut(i) {
        node.state |= Node::OBSTACLE;
    }
}

/// Marks all within `radius` cells of an obstacle.
fn grow(nodes: &mut [Node], width: usize, depth: usize, radius: f32) {
    let most = radius.min((width + depth) as f32);
    let reach = math::floor(most) as i32;
    if reach == 0 {
        return;
    }
    for (y, x) in (0..depth).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let i = y * width + x;
        let is_obstacle = |j: Option<usize>| j.and_then(|j| nodes.get(j)).is_none_or(|n| n.state & Node::OBSTACLE != 0);
        if !is_obstacle(Some(i)) {
            continue;
        }
        // Inside an obstacle the rim's discs cover all that this one's would: the nearest obstacle of a free cell has a
        // free neighbour on one of four sides.
        let left = if x == 0 { None } else { Some(i - 1) };
        let right = if x + 1 == width { None } else { Some(i + 1) };
        if [left, right, i.checked_sub(width), Some(i + width)].into_iter().all(is_obstacle) {
            continue;
        }
        for dy in -reach..=reach {
            let Some(row) = y.checked_add_signed(dy as isize).filter(|&r| r < depth) else { continue };
            let half = math::floor(math::sqrt((most * most - (dy * dy) as f32).max(0.0))) as usize;
            let span = row * width + x.saturating_sub(half)..row * width + (x + half + 1).min(width);
            for node in nodes.get_mut(span).unwrap_or(&mut []) {
                node.state |= Node::CLOSE;
            }
        }
    }
}
