//! A scene at one time: every object in its place, and the tree over them.

use super::Scene;
use crate::maths::{Rigid, Rotation, V3};
use crate::shape::tree::{Bounds, Tree};
use crate::shape::{Ray, Shape};

/// One object, posed.
#[derive(Debug, Clone, Copy)]
struct Placed<'a> {
    shape: &'a Shape,
    place: Rigid,
    /// Not turned at all: most things in a room.
    straight: bool,
    material: u32,
    segment: u16,
    shadow: bool,
}

/// The scene at one time.
#[derive(Debug)]
pub(crate) struct World<'a> {
    pub(crate) scene: &'a Scene,
    /// In the tree, in the order of its boxes.
    placed: Vec<Placed<'a>>,
    tree: Tree,
    /// Without a box around them: tested by every ray.
    endless: Vec<Placed<'a>>,
}

/// What a ray meets.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    /// Along the ray, in lengths of its direction.
    pub(crate) t: f64,
    /// World, metres.
    pub(crate) point: V3,
    /// In the object's frame, metres.
    pub(crate) local: V3,
    /// World, unit, on the side the ray comes from.
    pub(crate) normal: V3,
    /// Whether the ray comes from outside (against the shape's own normal).
    pub(crate) front: bool,
    pub(crate) uv: [f64; 2],
    pub(crate) material: u32,
    pub(crate) segment: u16,
}

impl<'a> World<'a> {
    pub(crate) fn new(scene: &'a Scene, time: f64) -> Self {
        let groups: Vec<Rigid> = scene.motions.iter().map(|m| m.at(time)).collect();
        let (mut placed, mut endless, mut boxes) = (Vec::new(), Vec::new(), Vec::new());
        for object in &scene.objects {
            let group = object.group.and_then(|g| groups.get(g)).copied().unwrap_or(Rigid::IDENTITY);
            let place = group.then(&object.place);
            let (shape, material) = (&object.shape, object.material);
            let straight = place.rotation == Rotation::IDENTITY;
            let item = Placed { shape, place, straight, material, segment: object.segment, shadow: object.shadow };
            match shape.bounds() {
                None => endless.push(item),
                Some(b) => {
                    boxes.push(b.corners().iter().fold(Bounds::EMPTY, |b, &c| b.with(place.point(c))).padded());
                    placed.push(item);
                }
            }
        }
        Self { scene, placed, tree: Tree::new(&boxes), endless }
    }

    /// The first thing a ray meets beyond `near` (in lengths of its direction).
    pub(crate) fn first(&self, ray: &Ray, near: f64, far: f64) -> Option<Hit> {
        let mut best: Option<(&Placed<'_>, crate::shape::Touch)> = None;
        let mut limit = far;
        for item in &self.endless {
            if let Some(touch) = item.shape.intersect(&item.own_ray(ray), near, limit) {
                (limit, best) = (touch.t, Some((item, touch)));
            }
        }
        self.tree.visit(ray, limit, |i, far| {
            let Some(item) = self.placed.get(i) else { return far };
            let Some(touch) = item.shape.intersect(&item.own_ray(ray), near, far) else { return far };
            best = Some((item, touch));
            touch.t
        });
        let (item, touch) = best?;
        let local = item.own_ray(ray).at(touch.t);
        let (own_normal, uv) = item.shape.surface(local, touch.part);
        let outward = item.place.rotation.apply(own_normal);
        let front = outward.dot(ray.direction) <= 0.0;
        Some(Hit {
            t: touch.t,
            point: ray.at(touch.t),
            local,
            normal: if front { outward } else { -outward },
            front,
            uv,
            material: item.material,
            segment: item.segment,
        })
    }

    /// Whether anything that casts shadows stands between `near` and `far`. `last` remembers what did, to be tried first: the
    /// next pixel's shadow is mostly the same object's.
    pub(crate) fn blocked(&self, ray: &Ray, near: f64, far: f64, last: &mut Option<u32>) -> bool {
        let stops = |item: &Placed<'_>| item.shadow && item.shape.intersect(&item.own_ray(ray), near, far).is_some();
        if let Some(item) = last.and_then(|i| self.placed.get(i as usize))
            && stops(item)
        {
            return true;
        }
        if self.endless.iter().any(stops) {
            return true;
        }
        let found = self.tree.any(ray, far, |i| self.placed.get(i).is_some_and(stops));
        if let Some(i) = found {
            *last = Some(i as u32);
        }
        found.is_some()
    }
}

impl Placed<'_> {
    #[inline]
    fn own_ray(&self, ray: &Ray) -> Ray {
        if self.straight {
            return Ray { origin: ray.origin - self.place.translation, direction: ray.direction };
        }
        Ray { origin: self.place.undo_point(ray.origin), direction: self.place.rotation.undo(ray.direction) }
    }
}
