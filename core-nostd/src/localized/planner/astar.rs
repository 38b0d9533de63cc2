//! The search: A* with a binary heap whose entries know their place, so that a cheaper way moves its entry up.
//!
//! The heap of node numbers lies in the nodes' own `slot` fields: no second slice.

use super::{Ground, Node};

/// The eight neighbours; number d + 4 is opposite to d.
pub(super) const DIRECTIONS: [(i32, i32); 8] = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];

/// Octile distance in cells: straight and diagonal steps only.
fn octile(dx: u32, dy: u32) -> f32 {
    let (long, short) = (dx.max(dy) as f32, dx.min(dy) as f32);
    // A hair below the truth, so that rounding never makes it promise too much.
    (long + (core::f32::consts::SQRT_2 - 1.0) * short) * 0.999_999
}

struct Heap<'n> {
    nodes: &'n mut [Node],
    len: usize,
}

impl Heap<'_> {
    /// Sort key of a node: low f first; of equals the one further on its way.
    fn before(&self, a: u32, b: u32) -> bool {
        match (self.nodes.get(a as usize), self.nodes.get(b as usize)) {
            (Some(a), Some(b)) => a.f < b.f || (a.f == b.f && a.g > b.g),
            _ => false,
        }
    }

    fn entry(&self, place: usize) -> u32 {
        self.nodes.get(place).map_or(0, |n| n.slot)
    }

    fn put(&mut self, place: usize, entry: u32) {
        if let Some(node) = self.nodes.get_mut(place) {
            node.slot = entry;
        }
        if let Some(node) = self.nodes.get_mut(entry as usize) {
            node.place = place as u32 + 1;
        }
    }

    fn up(&mut self, mut place: usize, entry: u32) {
        while place > 0 {
            let parent = (place - 1) / 2;
            let above = self.entry(parent);
            if !self.before(entry, above) {
                break;
            }
            self.put(place, above);
            place = parent;
        }
        self.put(place, entry);
    }

    fn push(&mut self, entry: u32) {
        self.len += 1;
        self.up(self.len - 1, entry);
    }

    fn pop(&mut self) -> Option<u32> {
        let last = self.len.checked_sub(1)?;
        let top = self.entry(0);
        let moved = self.entry(last);
        self.len = last;
        if last > 0 {
            let mut place = 0;
            loop {
                let mut child = 2 * place + 1;
                if child >= last {
                    break;
                }
                if child + 1 < last && self.before(self.entry(child + 1), self.entry(child)) {
                    child += 1;
                }
                let below = self.entry(child);
                if !self.before(below, moved) {
                    break;
                }
                self.put(place, below);
                place = child;
            }
            self.put(place, moved);
        }
        if let Some(node) = self.nodes.get_mut(top as usize) {
            node.place = Node::CLOSED;
        }
        Some(top)
    }
}

/// From `start` to `goal`; the way lies in the nodes' `from`. Whether it was found, and how many cells were expanded.
pub(super) fn search(nodes: &mut [Node], ground: &Ground<'_>, start: usize, goal: usize) -> (bool, u32) {
    let cell = ground.map.grid().cell();
    let (gx, gy) = ground.column_row(goal);
    let ahead = |x: i32, y: i32| octile(x.abs_diff(gx), y.abs_diff(gy)) * cell;
    let (sx, sy) = ground.column_row(start);
    if let Some(node) = nodes.get_mut(start) {
        node.g = 0.0;
        node.f = ahead(sx, sy);
    }
    let mut heap = Heap { nodes, len: 0 };
    heap.push(start as u32);
    let mut expanded = 0_u32;
    while let Some(top) = heap.pop() {
        let i = top as usize;
        if i == goal {
            return (true, expanded);
        }
        expanded += 1;
        let (x, y) = ground.column_row(i);
        let g = heap.nodes.get(i).map_or(f32::INFINITY, |n| n.g);
        let height = ground.height(i);
        // Straight neighbours first, for a diagonal step needs both beside it.
        let mut free = [None; 8];
        for (slot, (dx, dy)) in free.iter_mut().zip(DIRECTIONS) {
            *slot = ground.index(x + dx, y + dy).filter(|&j| heap.nodes.get(j).is_some_and(Node::walkable));
        }
        for (d, (dx, dy)) in DIRECTIONS.into_iter().enumerate() {
            let Some(j) = free.get(d).copied().flatten() else { continue };
            let diagonal = d % 2 == 1;
            if diagonal {
                let beside = |n: usize| free.get(n % 8).is_some_and(Option::is_some);
                if !(beside(d + 7) && beside(d + 1)) {
                    continue;
                }
            }
            let pace = if diagonal { cell * core::f32::consts::SQRT_2 } else { cell };
            let Some(node) = heap.nodes.get_mut(j) else { continue };
            if node.place == Node::CLOSED {
                continue;
            }
            let cost = g + pace + ground.climb(height, ground.height(j));
            if !(cost < node.g) {
                continue;
            }
            node.g = cost;
            node.f = cost + ahead(x + dx, y + dy);
            node.from = d as u8;
            match node.place {
                0 => heap.push(j as u32),
                place => heap.up(place as usize - 1, j as u32),
            }
        }
    }
    (false, expanded)
}
