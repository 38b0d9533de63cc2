//! A bounding-volume tree over boxes: split where surface area times count is least, visited front to back.
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

const LEAF: usize = 1;
/// The first splits are free; below them at least a quarter goes to each side, so that depth is bounded: 12 + log(n) / log(4/3).
const FREE: usize = 12;
/// Enough for a million items.
const DEPTH: usize = 64;
/// Up to so many items all three axes are tried; above, the longest.
const THOROUGH: usize = 4096;

impl Tree {
    pub(crate) fn new(boxes: &[Bounds]) -> Self {
        let mut tree = Self { nodes: Vec::with_capacity(boxes.len() * 2), items: (0..boxes.len() as u32).collect() };
        if !boxes.is_empty() {
            let mut items = std::mem::take(&mut tree.items);
            tree.grow(boxes, &mut items, 0, 0);
            tree.items = items;
        }
        tree
    }

    fn grow(&mut self, boxes: &[Bounds], items: &mut [u32], first: usize, depth: usize) {
        let of = |i: u32| boxes.get(i as usize).copied().unwrap_or(Bounds::EMPTY);
        let bounds = items.iter().fold(Bounds::EMPTY, |b, &i| b.union(of(i)));
        let own = self.nodes.len();
        self.nodes.push(Node { bounds, start: first as u32, count: items.len() as u32 });
        if items.len() <= LEAF {
            return;
        }
        let centre = |i: u32, axis: usize| of(i).min.axis(axis) + of(i).max.axis(axis);
        let order = |items: &mut [u32], axis: usize| {
            items.sort_unstable_by(|&a, &b| centre(a, axis).total_cmp(&centre(b, axis)).then(a.cmp(&b)));
        };
        let margin = if depth < FREE { 1 } else { (items.len() / 4).max(1) };
        let mut best = (0, items.len() / 2, f64::INFINITY);
        if items.len() <= THOROUGH {
            for axis in 0..3 {
                order(items, axis);
                let (middle, cost) = best_split(items, &of, margin);
                if cost < best.2 {
                    best = (axis, middle, cost);
                }
            }
        } else {
            let size = bounds.max - bounds.min;
            let axis = (0..3).fold(0, |best, i| if size.axis(i) > size.axis(best) { i } else { best });
            order(items, axis);
            best = (axis, best_split(items, &of, margin).0, 0.0);
        }
        order(items, best.0);
        let (left, right) = items.split_at_mut(best.1);
        self.grow(boxes, left, first, depth + 1);
        let second = self.nodes.len() as u32;
        self.grow(boxes, right, first + best.1, depth + 1);
        if let Some(node) = self.nodes.get_mut(own) {
            (node.start, node.count) = (second, 0);
        }
    }

    /// Calls `visit` with items whose box the ray meets before `far`, roughly from near to far; `visit` gets the present limit
    /// and returns the new one (a nearer touch).
    #[inline]
    pub(crate) fn visit(&self, ray: &Ray, far: f64, mut visit: impl FnMut(usize, f64) -> f64) {
        let probe = Probe::new(ray);
        let mut far = far;
        let mut stack = [(0_u32, 0.0_f64); DEPTH];
        let Some(t) = self.nodes.first().and_then(|root| probe.enter(&root.bounds, far)) else { return };
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
                for &item in self.leaf(node) {
                    far = visit(item as usize, far);
                }
                continue;
            }
            let (a, b) = (index + 1, node.start);
            let near = |i: u32| self.nodes.get(i as usize).and_then(|n| probe.enter(&n.bounds, far));
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

    /// The first item, in no order, whose box the ray meets before `far` and that `stops` it.
    #[inline]
    pub(crate) fn any(&self, ray: &Ray, far: f64, mut stops: impl FnMut(usize) -> bool) -> Option<usize> {
        let probe = Probe::new(ray);
        let mut stack = [0_u32; DEPTH];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let index = stack[top];
            let Some(node) = self.nodes.get(index as usize) else { continue };
            if probe.enter(&node.bounds, far).is_none() {
                continue;
            }
            if node.count > 0 {
                if let Some(&item) = self.leaf(node).iter().find(|&&item| stops(item as usize)) {
                    return Some(item as usize);
                }
                continue;
            }
            for child in [node.start, index + 1] {
                if let Some(slot) = stack.get_mut(top) {
                    *slot = child;
                    top += 1;
                }
            }
        }
        None
    }

    fn leaf(&self, node: &Node) -> &[u32] {
        let from = node.start as usize;
        self.items.get(from..from + node.count as usize).unwrap_or(&[])
    }
}

/// Where to cut sorted items in two, at least `margin` on each side, and what that costs: surface areas times counts.
fn best_split(items: &[u32], of: &impl Fn(u32) -> Bounds, margin: usize) -> (usize, f64) {
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
    for i in 1..n {
        b = b.union(of(items[i - 1]));
        let c = area(&b) * i as f64 + right[i];
        if i >= margin && i <= n - margin && c < cost {
            (best, cost) = (i, c);
        }
    }
    (best, cost)
}

/// A ray prepared for many boxes.
struct Probe {
    origin: V3,
    inverse: V3,
    /// Whether the ray goes down each axis.
    down: [bool; 3],
}

impl Probe {
    #[inline]
    fn new(ray: &Ray) -> Self {
        let d = ray.direction;
        Self {
            origin: ray.origin,
            inverse: V3 { x: 1.0 / d.x, y: 1.0 / d.y, z: 1.0 / d.z },
            down: [d.x < 0.0, d.y < 0.0, d.z < 0.0],
        }
    }

    /// Where the ray enters the box (0 when it starts inside), when before `far`.
    #[inline]
    fn enter(&self, b: &Bounds, far: f64) -> Option<f64> {
        let (mut t0, mut t1) = (0.0, far);
        let mut slab = |low: f64, high: f64, origin: f64, inverse: f64, down: bool| {
            let (first, last) = if down { (high, low) } else { (low, high) };
            let (a, b) = ((first - origin) * inverse, (last - origin) * inverse);
            // Plain comparisons: 0 x infinity is NaN, which then leaves the slab out; and one instruction each.
            t0 = if a > t0 { a } else { t0 };
            t1 = if b < t1 { b } else { t1 };
        };
        slab(b.min.x, b.max.x, self.origin.x, self.inverse.x, self.down[0]);
        slab(b.min.y, b.max.y, self.origin.y, self.inverse.y, self.down[1]);
        slab(b.min.z, b.max.z, self.origin.z, self.inverse.z, self.down[2]);
        (t0 <= t1).then_some(t0)
    }
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
            let probe = Probe::new(&ray);
            let mut expected: Vec<usize> =
                (0..boxes.len()).filter(|&k| probe.enter(&boxes[k], 1e9).is_some()).collect();
            let mut found = Vec::new();
            tree.visit(&ray, 1e9, |k, far| {
                if probe.enter(&boxes[k], 1e9).is_some() {
                    found.push(k);
                }
                far
            });
            let any = tree.any(&ray, 1e9, |k| probe.enter(&boxes[k], 1e9).is_some());
            assert_eq!(any.is_some(), !found.is_empty());
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected);
        }
        Tree::new(&[]).visit(&Ray { origin: V3::ZERO, direction: V3::UP }, 1.0, |_, far| far);
    }
}
