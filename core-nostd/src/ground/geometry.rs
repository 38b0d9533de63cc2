//! Rays, planes and boxes: the shapes that questions are asked about. Metres; any right-handed frame.

use glam::{Quat, Vec3};

/// A half line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    origin: Vec3,
    direction: Vec3,
}

impl Ray {
    /// From a point and a direction of any length; the direction is normalised. `None` when a number is not finite or the
    /// direction has no length.
    #[must_use]
    pub fn new(origin: Vec3, direction: Vec3) -> Option<Self> {
        let direction = direction.try_normalize()?;
        origin.is_finite().then_some(Self { origin, direction })
    }

    /// Where it starts.
    #[must_use]
    pub const fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Where it goes, unit length.
    #[must_use]
    pub const fn direction(&self) -> Vec3 {
        self.direction
    }

    /// The point at `distance` metres from the origin.
    #[must_use]
    pub fn at(&self, distance: f32) -> Vec3 {
        self.origin + self.direction * distance
    }
}

/// The points p with normal · p = offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    normal: Vec3,
    offset: f32,
}

impl Plane {
    /// Through a point, with a normal of any length; `None` when the normal has no length or a number is not finite.
    #[must_use]
    pub fn through(point: Vec3, normal: Vec3) -> Option<Self> {
        let normal = normal.try_normalize()?;
        point.is_finite().then(|| Self { normal, offset: normal.dot(point) })
    }

    /// Unit normal.
    #[must_use]
    pub const fn normal(&self) -> Vec3 {
        self.normal
    }

    /// Signed distance of the frame's origin from the plane, negated: normal · p for every p on the plane.
    #[must_use]
    pub const fn offset(&self) -> f32 {
        self.offset
    }

    /// Signed distance of a point in metres, positive on the normal's side.
    #[must_use]
    pub fn distance(&self, p: Vec3) -> f32 {
        self.normal.dot(p) - self.offset
    }

    /// The nearest point on the plane.
    #[must_use]
    pub fn project(&self, p: Vec3) -> Vec3 {
        p - self.normal * self.distance(p)
    }

    /// Distance along the ray to the plane; `None` when they never meet.
    #[must_use]
    pub fn intersect(&self, ray: &Ray) -> Option<f32> {
        let t = -self.distance(ray.origin()) / self.normal.dot(ray.direction());
        (t.is_finite() && t >= 0.0).then_some(t)
    }

    /// The same plane seen from another frame: `rotation` and `translation` take points of this frame to that one.
    #[must_use]
    pub fn transformed(&self, rotation: Quat, translation: Vec3) -> Self {
        let normal = rotation * self.normal;
        Self { normal, offset: self.offset + normal.dot(translation) }
    }

    /// The same plane facing the other way.
    #[must_use]
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }
}

/// A box turned in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedBox {
    /// Its middle.
    pub centre: Vec3,
    /// Half its size along its own axes; not negative.
    pub half: Vec3,
    /// Its axes in the frame it stands in; unit length.
    pub rotation: Quat,
}

impl OrientedBox {
    /// The eight corners; x changes fastest, then y, then z.
    #[must_use]
    pub fn corners(&self) -> [Vec3; 8] {
        core::array::from_fn(|i| {
            let sign = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
            self.centre + self.rotation * (self.half * Vec3::new(sign(1), sign(2), sign(4)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degenerate_shapes_are_refused() {
        assert!(Ray::new(Vec3::ZERO, Vec3::ZERO).is_none());
        assert!(Ray::new(Vec3::NAN, Vec3::X).is_none());
        assert!(Plane::through(Vec3::ZERO, Vec3::NAN).is_none());
        let ray = Ray::new(Vec3::ZERO, Vec3::X).unwrap();
        let beside = Plane::through(Vec3::Y, Vec3::Y).unwrap();
        assert_eq!(beside.intersect(&ray), None);
        let behind = Plane::through(Vec3::NEG_X, Vec3::X).unwrap();
        assert_eq!(behind.intersect(&ray), None);
    }

    #[test]
    fn a_moved_plane_holds_its_moved_points() {
        let plane = Plane::through(Vec3::new(0.0, 1.0, 2.0), Vec3::new(1.0, 2.0, -1.0)).unwrap();
        let (q, t) = (Quat::from_rotation_y(0.7), Vec3::new(3.0, -1.0, 0.5));
        let moved = plane.transformed(q, t);
        let p = plane.project(Vec3::new(5.0, 6.0, 7.0));
        assert!(plane.distance(p).abs() < 1e-5);
        assert!(moved.distance(q * p + t).abs() < 1e-5);
        assert!(moved.flipped().distance(q * p + t).abs() < 1e-5);
    }

    #[test]
    fn corners_span_the_box() {
        let b = OrientedBox { centre: Vec3::ONE, half: Vec3::new(1.0, 2.0, 3.0), rotation: Quat::IDENTITY };
        let c = b.corners();
        assert_eq!(c[0], Vec3::new(0.0, -1.0, -2.0));
        assert_eq!(c[7], Vec3::new(2.0, 3.0, 4.0));
        assert_eq!(c[1], Vec3::new(2.0, -1.0, -2.0));
    }
}
