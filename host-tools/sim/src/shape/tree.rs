//! A bounding-volume tree over boxes: split on the longest axis by surface area, visited front to back.
//!
//! 64 bytes a node, at most two nodes an item. Built from a list of boxes, it gives back their indices; what is in the
//! boxes is the caller's.

use super::Ray;
use crate::maths::V3;

/// An axis-aligned box, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) min: V3,
    pub(crate) max: V3,
}

impl Bounds {
    pub(crate) const EMPTY: Self = Self { min: V3::splat(f64::INFINITY), max: V3::splat(f64::NEG_INFINITY) };

    pub(crate) fn with(self, p: V3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    pub(crate) fn union(self, o: Self) -> Self {
        Self { min: self.min.min(o.min), max: self.max.max(o.max) }
    }

    pub(crate) fn corners(&self) -> [V3; 8] {
        let (a, b) = (self.min, self.max);
        std::array::from_fn(|i| V3 {
            x: if i & 1 == 0 { a.x } else { b.x },
            y: if i & 2 == 0 { a.y } else { b.y },
            z: if i & 4 == 0 { a.z } else { b.z },
        })
    }

    /// A hair larger, so that rounding loses no touch.
    pub(crate) fn padded(self) -> Self {
        let pad = V3::splat(1e-9 * (1.0 + self.min.length().max(self.max.length())));
        Self { min: self.min - pad, max: self.max + pad }
    }
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// First item of a leaf, or the second child (the first follows its parent).
    start: u32,
    /// Items of a leaf; 0 for an inner node.
    count: u32,
}

/// The tree.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tree {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

const LEAF: usize = 2;
/// At least a quarter goes to each side: 100 million items would be needed to go deeper.
const DEPTH: usize = 64;

impl Tree {
    pub(crate) fn new(boxes: &[Bounds]) -> Self {
        let mut tree = Self { nodes: Vec::with_capacity(boxes.len() * 2), items: (0..boxes.len() as u32).collect() };
        if !boxes.is_empty() {
            let mut items = std::mem::take(&mut tree.items);
            tree.grow(boxes, &mut items, 0);
            tree.items = items;
        }
        tree
    }

    fn grow(&mut self, boxes: &[Bounds], items: &mut [u32], first: usize) {
        let of = |i: u32| boxes.get(i as usize).copied().unwrap_or(Bounds::EMPTY);
        let bounds = items.iter().fold(Bounds::EMPTY, |b, &i| b.union(of(i)));
        let own = self.nodes.len();
        self.nodes.push(Node { bounds, start: first as u32, count: items.len() as u32 });
        if items.len() <= LEAF {
            return;
        }
        let centre = |i: u32, axis: usize| of(i).min.axis(axis) + of(i).max.axis(axis);
        let spread = |axis: usize| {
            let c = items.iter().map(|&i| centre(i, axis));
            let (low, high) = c.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            high - low
        };
        let spreads = [spread(0), spread(1), spread(2)];
        let axis = (0..3).fold(0, |best, i| if spreads[i] > spreads[best] { i } else { best });
        items.sort_unstable_by(|&a, &b| centre(a, axis).total_cmp(&centre(b, axis)).then(a.cmp(&b)));
        let middle = best_split(items, &of);
        let (left, right) = items.split_at_mut(middle);
        self.grow(boxes, left, first);
        let second = self.nodes.len() as u32;
        self.grow(boxes, right, first + middle);
        if let Some(node) = self.nodes.get_mut(own) {
            (node.start, node.count) = (second, 0);
        }
    }

    /// Calls `visit` with items whose box the ray meets before `far`, roughly from near to far; `visit` gets the present limit
    /// and returns the new one (a nearer touch), or a limit of 0 to stop.
    #[inline]
    pub(crate) fn visit(&self, ray: &Ray, far: f64, mut visit: impl FnMut(usize, f64) -> f64) {
        let inverse = V3 { x: 1.0 / ray.direction.x, y: 1.0 / ray.direction.y, z: 1.0 / ray.direction.z };
        let mut far = far;
        let mut stack = [(0_u32, 0.0_f64); DEPTH];
        let Some(root) = self.nodes.first() else { return };
        let Some(t) = enter(&root.bounds, ray, inverse, far) else { return };
        stack[0] = (0, t);
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (index, entered) = stack[top];
            if entered >= far {
                continue;
            }
            let Some(node) = self.nodes.get(index as usize) else { continue };
            if node.count > 0 {
                let from = node.start as usize;
                for &item in self.items.get(from..from + node.count as usize).unwrap_or(&[]) {
                    far = visit(item as usize, far);
                }
                if far <= 0.0 {
                    return;
                }
                continue;
            }
            let (a, b) = (index + 1, node.start);
            let near = |i: u32| self.nodes.get(i as usize).and_then(|n| enter(&n.bounds, ray, inverse, far));
            let (first, second) = match (near(a), near(b)) {
                (Some(ta), Some(tb)) if ta <= tb => (Some((b, tb)), Some((a, ta))),
                (Some(ta), Some(tb)) => (Some((a, ta)), Some((b, tb))),
                (Some(ta), None) => (None, Some((a, ta))),
                (None, Some(tb)) => (None, Some((b, tb))),
                (None, None) => (None, None),
            };
            for entry in [first, second].into_iter().flatten() {
                if let Some(slot) = stack.get_mut(top) {
                    *slot = entry;
                    top += 1;
                }
            }
        }
    }
}

/// Where to cut sorted items in two: least surface area times count, at least a quarter on each side so that depth stays bounded.
fn best_split(items: &[u32], of: &impl Fn(u32) -> Bounds) -> usize {
    let n = items.len();
    let area = |b: &Bounds| {
        let d = b.max - b.min;
        d.x * d.y + d.y * d.z + d.z * d.x
    };
    let mut right = vec![0.0; n];
    let mut b = Bounds::EMPTY;
    for i in (0..n).rev() {
        b = b.union(of(items[i]));
        right[i] = area(&b) * (n - i) as f64;
    }
    let (mut best, mut cost) = (n / 2, f64::INFINITY);
    let mut b = Bounds::EMPTY;
    let margin = (n / 4).max(1);
    for i in 1..n {
        b = b.union(of(items[i - 1]));
        let c = area(&b) * i as f64 + right[i];
        if i >= margin && i <= n - margin && c < cost {
            (best, cost) = (i, c);
        }
    }
    best
}

/// Where the ray enters the box (0 when it starts inside), when before `far`.
#[inline]
fn enter(b: &Bounds, ray: &Ray, inverse: V3, far: f64) -> Option<f64> {
    let o = ray.origin;
    // 0 x infinity is NaN; min and max then keep the other operand, which leaves the slab out.
    let (x0, x1) = ((b.min.x - o.x) * inverse.x, (b.max.x - o.x) * inverse.x);
    let (y0, y1) = ((b.min.y - o.y) * inverse.y, (b.max.y - o.y) * inverse.y);
    let (z0, z1) = ((b.min.z - o.z) * inverse.z, (b.max.z - o.z) * inverse.z);
    let t0 = x0.min(x1).max(y0.min(y1)).max(z0.min(z1)).max(0.0);
    let t1 = x0.max(x1).min(y0.max(y1)).min(z0.max(z1)).min(far);
    (t0 <= t1).then_some(t0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::v3;
    use crate::random::Random;

    #[test]
    fn finds_what_a_full_scan_finds() {
        let r = Random::new(1);
        let boxes: Vec<Bounds> = (0..300)
            .map(|i| {
                let c = v3(r.normal(i * 4) * 3.0, r.normal(i * 4 + 1), r.normal(i * 4 + 2));
                let h = V3::splat(0.02 + 0.1 * r.unit(i * 9 + 3));
                Bounds { min: c - h, max: c + h }
            })
            .collect();
        let tree = Tree::new(&boxes);
        for i in 0..500 {
            let n = |k: u64| r.stream(1).normal(i * 8 + k);
            let ray = Ray {
                origin: v3(n(0), n(1), n(2)) * 3.0,
                direction: v3(n(3), n(4), if i % 5 == 0 { 0.0 } else { n(5) }),
            };
            let inverse = v3(1.0 / ray.direction.x, 1.0 / ray.direction.y, 1.0 / ray.direction.z);
            let mut expected: Vec<usize> =
                (0..boxes.len()).filter(|&k| enter(&boxes[k], &ray, inverse, 1e9).is_some()).collect();
            let mut found = Vec::new();
            tree.visit(&ray, 1e9, |k, far| {
                if enter(&boxes[k], &ray, inverse, 1e9).is_some() {
                    found.push(k);
                }
                far
            });
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected);
        }
        Tree::new(&[]).visit(&Ray { origin: V3::ZERO, direction: V3::UP }, 1.0, |_, far| far);
    }
}
