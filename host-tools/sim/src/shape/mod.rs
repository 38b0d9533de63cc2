//! What can stand in a scene, and where a ray meets it.
//!
//! Each shape lives in its own frame (y up); the scene turns rays into that frame. Rays need not have length one: `t` counts in
//! lengths of the direction, so that a camera ray with z = 1 gives z depth without a further rounding.
//!
//! | file | shapes |
//! |---|---|
//! | `solids` | plane, rectangle, box, sphere, cylinder, capsule: closed forms |
//! | `waves` | wavy height field: safe steps, then bisection |
//! | `facets` | bodies of flat facets from a few numbers: polyhedra, torus knots, rough balls |
//! | `mesh`, `mesh_file` | triangles with their own tree; OBJ and PLY |
//! | `tree` | the bounding-volume tree that both meshes and scenes use |

pub(crate) mod facets;
pub(crate) mod mesh;
pub(crate) mod mesh_file;
pub(crate) mod solids;
pub(crate) mod tree;
pub(crate) mod waves;

use std::sync::Arc;

use crate::maths::{V3, v3};
use facets::Polyhedron;
use mesh::Mesh;
use tree::Bounds;
use waves::Waves;

/// A half line; the direction has any length but 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: V3,
    pub(crate) direction: V3,
}

impl Ray {
    #[inline]
    pub(crate) fn at(&self, t: f64) -> V3 {
        self.origin + self.direction * t
    }
}

/// Where a ray meets a shape: how far along, and on which part (face, triangle).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Touch {
    pub(crate) t: f64,
    pub(crate) part: u32,
}

/// A shape in its own frame; lengths in metres.
#[derive(Debug, Clone)]
pub(crate) enum Shape {
    /// Infinite plane through the origin.
    Plane { normal: V3 },
    /// In x and y, facing +z.
    Rectangle { half: [f64; 2] },
    /// Centred.
    Box { half: V3 },
    /// Centred.
    Sphere { radius: f64 },
    /// About y, centred, with both ends.
    Cylinder { radius: f64, half: f64 },
    /// About y, centred; `half` is that of the straight part.
    Capsule { radius: f64, half: f64 },
    /// Over x and z, centred.
    Waves(Waves),
    /// Convex, of flat faces.
    Polyhedron(Polyhedron),
    /// Triangles.
    Mesh(Arc<Mesh>),
}

impl Shape {
    /// The nearest meeting with `near < t < far`.
    #[inline]
    pub(crate) fn intersect(&self, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
        match self {
            Self::Plane { normal } => solids::plane(*normal, ray, near, far),
            Self::Rectangle { half } => solids::rectangle(*half, ray, near, far),
            Self::Box { half } => solids::cuboid(*half, ray, near, far),
            Self::Sphere { radius } => solids::sphere(V3::ZERO, *radius, ray, near, far),
            Self::Cylinder { radius, half } => solids::cylinder(*radius, *half, ray, near, far),
            Self::Capsule { radius, half } => solids::capsule(*radius, *half, ray, near, far),
            Self::Waves(waves) => waves.intersect(ray, near, far),
            Self::Polyhedron(body) => body.intersect(ray, near, far),
            Self::Mesh(mesh) => mesh.intersect(ray, near, far),
        }
    }

    /// The exact geometric normal (unit, outward) and texture coordinates (metres or 0 to 1) at a point of a part.
    pub(crate) fn surface(&self, p: V3, part: u32) -> (V3, [f64; 2]) {
        match self {
            Self::Plane { normal } => (*normal, [p.x, p.z]),
            Self::Rectangle { half } => {
                (v3(0.0, 0.0, 1.0), [0.5 + 0.5 * p.x / half[0].max(1e-300), 0.5 - 0.5 * p.y / half[1].max(1e-300)])
            }
            Self::Box { half } => solids::cuboid_surface(*half, p, part),
            Self::Sphere { .. } => solids::sphere_surface(p),
            Self::Cylinder { radius, half } => solids::cylinder_surface(*radius, *half, p, part),
            Self::Capsule { half, .. } => {
                let centre = v3(0.0, p.y.clamp(-half, *half), 0.0);
                solids::sphere_surface(p - centre)
            }
            Self::Waves(waves) => (waves.normal(p.x, p.z), [p.x, p.z]),
            Self::Polyhedron(body) => (body.normal(part), [p.x, p.z]),
            Self::Mesh(mesh) => mesh.surface(p, part),
        }
    }

    /// The box around it; `None` when it is endless.
    pub(crate) fn bounds(&self) -> Option<Bounds> {
        let half = match self {
            Self::Plane { .. } => return None,
            Self::Rectangle { half } => v3(half[0], half[1], 0.0),
            Self::Box { half } => *half,
            Self::Sphere { radius } => V3::splat(*radius),
            Self::Cylinder { radius, half } => v3(*radius, *half, *radius),
            Self::Capsule { radius, half } => v3(*radius, half + radius, *radius),
            Self::Waves(waves) => waves.half(),
            Self::Polyhedron(body) => body.half(),
            Self::Mesh(mesh) => return Some(mesh.bounds()),
        };
        Some(Bounds { min: -half, max: half })
    }
}
