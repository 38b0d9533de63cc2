//! The search: A* with a binary heap whose entries know their place, so that a cheaper way moves its entry up.
//!
//! The heap of node numbers lies in the nodes' own links: no second slice. A node remembers of its place only the last four
//! bits; when its way gets cheaper, the places that end in them are looked through: one of every sixteen.

use super::{Ground, Node};

/// The eight neighbours; number d + 4 is opposite to d.
pub(super) static DIRECTIONS: [(i32, i32); 8] = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];

struct Heap<'n> {
    nodes: &'n mut [Node],
    len: usize,
}

impl Heap<'_> {
    /// Sort key of a node that is in the heap: as numbers that are not negative have it, the bits of the cost.
    #[inline]
    fn key(&self, entry: usize) -> u32 {
        self.nodes.get(entry).map_or(0, |n| n.key.to_bits())
    }

    #[inline]
    fn entry(&self, place: usize) -> usize {
        self.nodes.get(place).map_or(0, Node::slot)
    }

    #[inline]
    fn put(&mut self, place: usize, entry: usize) {
        if let Some(node) = self.nodes.get_mut(place) {
            node.set_slot(entry);
        }
        if let Some(node) = self.nodes.get_mut(entry) {
            node.set_place(place);
        }
    }

    /// Lets an entry rise from a place to below the first that comes before `key`.
    fn up(&mut self, mut place: usize, entry: usize, key: u32) {
        while place > 0 {
            let parent = (place - 1) / 2;
            let above = self.entry(parent);
            if self.key(above) < key {
                break;
            }
            self.put(place, above);
            place = parent;
        }
        self.put(place, entry);
    }

    /// Takes a node in; of equals the newest comes first, which is mostly the one further on its way.
    fn push(&mut self, entry: usize) {
        self.len += 1;
        self.up(self.len - 1, entry, self.key(entry));
    }

    /// Moves a node up whose way got cheaper.
    fn cheaper(&mut self, entry: usize) {
        let first = self.nodes.get(entry).map_or(0, Node::place);
        let places = self.nodes.get(..self.len).and_then(|heap| heap.get(first..)).unwrap_or(&[]);
        if let Some(k) = places.iter().step_by(Node::PLACES).position(|n| n.slot() == entry) {
            self.up(first + k * Node::PLACES, entry, self.key(entry));
        }
    }

    /// The cheapest node, which is done with that, and its cost.
    fn pop(&mut self) -> Option<(usize, f32)> {
        let last = self.len.checked_sub(1)?;
        let (top, moved) = (self.entry(0), self.entry(last));
        self.len = last;
        if last > 0 {
            // The gap sinks to the bottom, and the last entry rises from there: it seldom rises far.
            let mut place = 0;
            loop {
                let mut child = 2 * place + 1;
                if child >= last {
                    break;
                }
                let mut entry = self.entry(child);
                if child + 1 < last {
                    let other = self.entry(child + 1);
                    if self.key(other) < self.key(entry) {
                        (child, entry) = (child + 1, other);
                    }
                }
                self.put(place, entry);
                place = child;
            }
            self.up(place, moved, self.key(moved).saturating_add(1));
        }
        let node = self.nodes.get_mut(top)?;
        let cost = node.key;
        node.key = -cost;
        Some((top, cost))
    }
}

/// From `start` to the ground's goal; the way lies in the nodes' directions. Whether it was found, and how many cells were
/// expanded.
pub(super) fn search(nodes: &mut [Node], ground: &Ground<'_>, start: usize) -> (bool, u32) {
    let goal = ground.goal;
    let straight = ground.cell;
    let diagonal = straight * core::f32::consts::SQRT_2;
    let hops = DIRECTIONS.map(|(dx, dy)| dy as isize * ground.width as isize + dx as isize);
    let (sx, sy) = ground.column_row(start);
    if let Some(node) = nodes.get_mut(start) {
        node.key = ground.ahead(sx, sy);
    }
    let mut heap = Heap { nodes, len: 0 };
    heap.push(start);
    let mut expanded = 0_u32;
    while let Some((i, cost)) = heap.pop() {
        if i == goal {
            return (true, expanded);
        }
        expanded += 1;
        let (x, y) = ground.column_row(i);
        let g = cost - ground.ahead(x, y);
        let height = ground.height(i);
        // Which of the eight can be stood on, a bit each.
        let mut free = 0_u32;
        for (d, hop) in hops.iter().enumerate() {
            let node = heap.nodes.get(i.wrapping_add_signed(*hop));
            free |= u32::from(node.is_some_and(Node::walkable)) << d;
        }
        free &= ground.inside(x, y);
        // A diagonal step needs both cells beside it.
        let beside = (free << 1) & (free >> 1 | free << 7);
        free &= 0b0101_0101 | beside;
        while free != 0 {
            let d = free.trailing_zeros() as usize;
            free &= free - 1;
            let (Some(&hop), Some(&(dx, dy))) = (hops.get(d), DIRECTIONS.get(d)) else { continue };
            let j = i.wrapping_add_signed(hop);
            let Some(node) = heap.nodes.get_mut(j) else { continue };
            // Done with: its sign says so.
            let known = node.key;
            if known.is_sign_negative() {
                continue;
            }
            let pace = if d % 2 == 1 { diagonal } else { straight };
            let cost = g + pace + ground.climb(height, ground.height(j)) + ground.ahead(x + dx, y + dy);
            if !(cost < known) {
                continue;
            }
            node.key = cost;
            node.set_from(d);
            if known < f32::INFINITY {
                heap.cheaper(j);
            } else {
                heap.push(j);
            }
        }
    }
    (false, expanded)
}
