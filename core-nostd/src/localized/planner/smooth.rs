//! From cells to corners: the path is traced back, then the string is pulled tight.

use super::{Ground, Node, astar::DIRECTIONS};
use crate::ground::math;

/// Writes the cells of the way, goal first, into the nodes' slots (the heap is done with them) and returns how many.
pub(super) fn trace(nodes: &mut [Node], ground: &Ground<'_>, start: usize) -> usize {
    let mut at = ground.goal;
    let mut count = 0;
    while let Some(slot) = nodes.get_mut(count) {
        slot.set_slot(at);
        count += 1;
        if at == start {
            break;
        }
        let from = nodes.get(at).map_or(0, Node::from);
        let (dx, dy) = DIRECTIONS.get(from).copied().unwrap_or((0, 0));
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
    let cell_at = |nodes: &[Node], k: usize| nodes.get(k).map_or(0, Node::slot);
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
                slot.set_slot(last);
            }
            kept += 1;
            anchor = last;
        }
        last = next;
    }
    if let Some(slot) = nodes.get_mut(kept) {
        slot.set_slot(last);
    }
    kept + 1
}

/// Whether one can walk the straight line between the middles of two cells of the way: every cell it touches is walkable
/// (at a corner it touches all four), and it costs at most 2 % more than the way does.
pub(super) fn straight(nodes: &[Node], ground: &Ground<'_>, a: usize, b: usize) -> bool {
    let ((ax, ay), (bx, by)) = (ground.column_row(a), ground.column_row(b));
    let (dx, dy) = ((bx - ax).abs(), (by - ay).abs());
    let (hop_x, hop_y) = ((bx - ax).signum() as isize, (by - ay).signum() as isize * ground.width as isize);
    // The line stays in the rectangle between two cells of the map, and so do the cells beside its corners.
    let free = |i: usize| nodes.get(i).is_some_and(Node::walkable);
    // Borders still to cross.
    let (mut left_x, mut left_y) = (dx, dy);
    // Which border comes first: (crossed x + 1/2) / dx against (crossed y + 1/2) / dy, in whole numbers.
    let mut first = dy - dx;
    let mut at = a;
    let mut climb = 0.0;
    let mut height = ground.height(a);
    while left_x > 0 || left_y > 0 {
        let (cross_x, cross_y) = (first <= 0, first >= 0);
        if cross_x && cross_y && !(free(at.wrapping_add_signed(hop_x)) && free(at.wrapping_add_signed(hop_y))) {
            return false;
        }
        if cross_x {
            at = at.wrapping_add_signed(hop_x);
            left_x -= 1;
            first += 2 * dy;
        }
        if cross_y {
            at = at.wrapping_add_signed(hop_y);
            left_y -= 1;
            first -= 2 * dx;
        }
        if !free(at) {
            return false;
        }
        // Heights once a step of the longer way, as a path of as many cells has them.
        if if dx >= dy { cross_x } else { cross_y } {
            let here = ground.height(at);
            climb += ground.climb(height, here);
            height = here.or(height);
        }
    }
    let length = math::sqrt((dx as f32) * (dx as f32) + (dy as f32) * (dy as f32)) * ground.cell;
    length + climb <= 1.02 * (ground.cost(nodes, a) - ground.cost(nodes, b)).abs() + 1e-4 * ground.cell
}
