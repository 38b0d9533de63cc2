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
    let limit = |distance: f32| walker.max_step.max(distance * tan) + 1e-4;
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
    let far = window(walker, cell);
    for y in (0..depth).step_by(BLOCK) {
        for x in (0..width).step_by(BLOCK) {
            let block = (x..(x + BLOCK).min(width), y..(y + BLOCK).min(depth));
            let around = (x.saturating_sub(far)..(x + BLOCK + far).min(width), y..(y + BLOCK + far).min(depth));
            if rise(nodes, width, &around) > gentle {
                judge(nodes, map, walker, &limit, &block);
            }
        }
    }
    for node in nodes.iter_mut() {
        node.g = Node::FAR.g;
    }
    grow(nodes, width, depth, walker.radius / cell + 0.5);
}

/// Side of the blocks of cells that are skipped together.
const BLOCK: usize = 16;

/// A rectangle of cells: columns, rows.
type Cells = (core::ops::Range<usize>, core::ops::Range<usize>);

/// Highest less lowest of a rectangle of cells; negative where none has a height.
fn rise(nodes: &[Node], width: usize, (columns, rows): &Cells) -> f32 {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for y in rows.clone() {
        for node in nodes.get(y * width + columns.start..y * width + columns.end).unwrap_or(&[]) {
            low = if node.g < low { node.g } else { low };
            high = if node.g > high { node.g } else { high };
        }
    }
    high - low
}

/// Marks ledges and slopes that start in a rectangle of cells.
fn judge(
    nodes: &mut [Node],
    map: &HeightMap<'_>,
    walker: &Walker,
    limit: &impl Fn(f32) -> f32,
    (columns, rows): &Cells,
) {
    let (width, depth) = map.grid().size();
    let cell = map.grid().cell();
    for (dx, dy) in [(1_isize, 0_isize), (0, 1), (1, 1), (-1, 1)] {
        let pace = if dx != 0 && dy != 0 { cell * core::f32::consts::SQRT_2 } else { cell };
        let far = window(walker, pace);
        let mut limits = [0.0_f32; MOST];
        for (i, l) in limits.iter_mut().enumerate() {
            *l = limit(pace * (i + 1) as f32);
        }
        let one = limit(pace);
        let hop = dy * width as isize + dx;
        let height = |i: usize, nodes: &[Node]| nodes.get(i).map_or(f32::NAN, |n| n.g);
        for (y, x) in rows.clone().flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let from = y * width + x;
            let first = height(from, nodes);
            if first.is_nan() {
                continue;
            }
            // Cells left in this direction.
            let across = match dx {
                0 => MOST,
                1 => width - 1 - x,
                _ => x,
            };
            let down = if dy == 0 { MOST } else { depth - 1 - y };
            let (mut here, mut at) = (first, from);
            for (k, (&ramp, step)) in limits.iter().zip(1..=far.min(across).min(down)).enumerate() {
                let Some(next) = at.checked_add_signed(hop) else { break };
                let there = height(next, nodes);
                if there.is_nan() {
                    break;
                }
                if (there - here).abs() > one {
                    // The upper side of a ledge is what can't be walked onto, or off. The pair belongs to its own turn.
                    if k == 0 {
                        mark(nodes, if there > here { next } else { at });
                    }
                    break;
                }
                if (there - first).abs() > ramp {
                    // Too steep: all between the ends.
                    let mut between = from;
                    for _ in 1..step {
                        between = between.saturating_add_signed(hop);
                        mark(nodes, between);
                    }
                    break;
                }
                (here, at) = (there, next);
            }
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
