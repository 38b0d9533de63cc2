//! Triangle meshes: Möller and Trumbore's test in `f64`, flat (geometric) normals, a tree of their own.

use super::tree::{Bounds, Tree};
use super::{Ray, Touch};
use crate::maths::V3;

/// One triangle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Triangle {
    pub(crate) a: V3,
    pub(crate) b: V3,
    pub(crate) c: V3,
    /// Texture coordinates of the three corners.
    pub(crate) uv: [[f64; 2]; 3],
}

/// Triangles and their tree.
#[derive(Debug, Clone)]
pub(crate) struct Mesh {
    triangles: Vec<Triangle>,
    tree: Tree,
    bounds: Bounds,
}

impl Mesh {
    /// Keeps the triangles that have an area and finite corners.
    pub(crate) fn new(triangles: Vec<Triangle>) -> Self {
        let triangles: Vec<Triangle> = triangles
            .into_iter()
            .filter(|t| t.a.is_finite() && t.b.is_finite() && t.c.is_finite())
            .filter(|t| (t.b - t.a).cross(t.c - t.a).length() > 0.0)
            .collect();
        let boxes: Vec<Bounds> =
            triangles.iter().map(|t| Bounds::EMPTY.with(t.a).with(t.b).with(t.c).padded()).collect();
        let bounds = boxes.iter().fold(Bounds::EMPTY, |a, &b| a.union(b));
        Self { tree: Tree::new(&boxes), triangles, bounds }
    }

    pub(crate) const fn len(&self) -> usize {
        self.triangles.len()
    }

    pub(crate) const fn bounds(&self) -> Bounds {
        self.bounds
    }

    pub(super) fn intersect(&self, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
        let mut best = None;
        self.tree.visit(ray, far, |i, far| {
            let Some(t) = self.triangles.get(i).and_then(|tri| tri.meets(ray)) else { return far };
            if t > near && t < far {
                best = Some(Touch { t, part: i as u32 });
                return t;
            }
            far
        });
        best
    }

    pub(super) fn surface(&self, p: V3, part: u32) -> (V3, [f64; 2]) {
        let Some(t) = self.triangles.get(part as usize) else { return (V3::UP, [0.0; 2]) };
        let (e1, e2, d) = (t.b - t.a, t.c - t.a, p - t.a);
        let n = e1.cross(e2);
        let area = n.dot(n);
        let (v, w) = (d.cross(e2).dot(n) / area, e1.cross(d).dot(n) / area);
        let mix = |i: usize| t.uv[0][i] * (1.0 - v - w) + t.uv[1][i] * v + t.uv[2][i] * w;
        (n.unit_or_up(), [mix(0), mix(1)])
    }
}

impl Triangle {
    #[inline]
    fn meets(&self, ray: &Ray) -> Option<f64> {
        let (e1, e2) = (self.b - self.a, self.c - self.a);
        let p = ray.direction.cross(e2);
        let inverse = 1.0 / e1.dot(p);
        let s = ray.origin - self.a;
        let u = s.dot(p) * inverse;
        let q = s.cross(e1);
        let v = ray.direction.dot(q) * inverse;
        // A hair outside counts, so that no ray slips between neighbours; false for NaN (an edge-on triangle).
        (u >= -1e-12 && v >= -1e-12 && u + v <= 1.0 + 1e-12).then(|| e2.dot(q) * inverse)
    }
}
