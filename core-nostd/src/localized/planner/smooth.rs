//! From cells to corners: the path is traced back, then the string is pulled tight.

use super::{Ground, Node, astar::DIRECTIONS};
use crate::ground::math;

/// Writes the cells of the way, goal first, into the nodes' slots (the heap is done with them) and returns how many.
pub(super) fn trace(nodes: &mut [Node], ground: &Ground<'_>, start: usize, goal: usize) -> usize {
    let mut at = goal;
    let mut count = 0;
    while let Some(slot) = nodes.get_mut(count) {
        slot.slot = at as u32;
        count += 1;
        if at == start {
            break;
        }
        let from = nodes.get(at).map_or(0, |n| n.from);
        let (dx, dy) = DIRECTIONS.get(usize::from(from)).copied().unwrap_or((0, 0));
        let (x, y) = ground.column_row(at);
        match ground.index(x - dx, y - dy) {
            Some(previous) => at = previous,
            None => break,
        }
    }
    count
}

/// Keeps of the first `cells` slots only the corners that are needed, in place, and returns how many.
pub(super) fn pull(nodes: &mut [Node], ground: &Ground<'_>, cells: usize) -> usize {
    let cell_at = |nodes: &[Node], k: usize| nodes.get(k).map_or(0, |n| n.slot as usize);
    if cells <= 1 {
        return cells;
    }
    let mut kept = 1;
    let mut anchor = cell_at(nodes, 0);
    let mut last = anchor;
    for k in 1..cells {
        let next = cell_at(nodes, k);
        // Neighbours always see each other, so that `last` is never the anchor here.
        if k > 1 && !straight(nodes, ground, anchor, next) {
            if let Some(slot) = nodes.get_mut(kept) {
                slot.slot = last as u32;
            }
            kept += 1;
            anchor = last;
        }
        last = next;
    }
    if let Some(slot) = nodes.get_mut(kept) {
        slot.slot = last as u32;
    }
    kept + 1
}

/// Whether one can walk the straight line between the middles of two cells of the way: every cell it touches is walkable
/// (at a corner it touches all four), and it costs at most 2 % more than the way does.
pub(super) fn straight(nodes: &[Node], ground: &Ground<'_>, a: usize, b: usize) -> bool {
    let ((mut x, mut y), (bx, by)) = (ground.column_row(a), ground.column_row(b));
    let (dx, dy) = (i64::from((bx - x).abs()), i64::from((by - y).abs()));
    let (step_x, step_y) = ((bx - x).signum(), (by - y).signum());
    let free = |x: i32, y: i32| ground.index(x, y).and_then(|i| nodes.get(i)).is_some_and(Node::walkable);
    let (mut ix, mut iy) = (0, 0);
    let mut climb = 0.0;
    let mut height = ground.height(a);
    while ix < dx || iy < dy {
        // Which border comes first: (ix + 1/2) / dx against (iy + 1/2) / dy, in whole numbers.
        let first = ((1 + 2 * ix) * dy).cmp(&((1 + 2 * iy) * dx));
        if first.is_eq() && !(free(x + step_x, y) && free(x, y + step_y)) {
            return false;
        }
        if first.is_le() {
            x += step_x;
            ix += 1;
        }
        if first.is_ge() {
            y += step_y;
            iy += 1;
        }
        if !free(x, y) {
            return false;
        }
        // Heights once a step of the longer way, as a path of as many cells has them.
        let longer = if dx >= dy { first.is_le() } else { first.is_ge() };
        if longer {
            let here = ground.index(x, y).and_then(|i| ground.height(i));
            climb += ground.climb(height, here);
            height = here.or(height);
        }
    }
    let cell = ground.map.grid().cell();
    let length = math::sqrt((dx * dx + dy * dy) as f32) * cell;
    let cost = |i: usize| nodes.get(i).map_or(0.0, |n| n.g);
    length + climb <= 1.02 * (cost(a) - cost(b)).abs() + 1e-4 * cell
}
