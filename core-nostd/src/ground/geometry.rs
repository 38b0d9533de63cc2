//! Rays, planes and boxes: the shapes that questions are asked about. Metres; any right-handed frame.

use glam::{Quat, Vec3};

use super::math;
use super::rotation::rotate;

/// `v` made unit length whatever its length, denormal and overflowing squares included; `None` for zero and for what is not
/// finite.
#[must_use]
pub fn unit(v: Vec3) -> Option<Vec3> {
    let [x, y, z] = v.abs().to_array();
    let size = math::max(x, math::max(y, z));
    let scaled = v / size;
    // Denormal lengths keep few digits: a direction of one of them is no direction.
    if size >= f32::MIN_POSITIVE { scaled.try_normalize() } else { None }
}

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
        let direction = unit(direction)?;
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

/// The points p with normal · (p - anchor) = rest.
///
/// Not normal · p = offset: 10 km from the origin the products are kilometres and their rounding a millimetre, while the
/// difference from a point nearby is exact. What the anchor's own rounding leaves is kept in `rest`. 28 bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    normal: Vec3,
    anchor: Vec3,
    rest: f32,
}

impl Plane {
    /// Through a point, with a normal of any length; `None` when the normal has no length or a number is not finite.
    #[must_use]
    pub fn through(point: Vec3, normal: Vec3) -> Option<Self> {
        let normal = unit(normal)?;
        point.is_finite().then_some(Self { normal, anchor: point, rest: 0.0 })
    }

    /// As [`Self::through`], for a point in double precision.
    pub(crate) fn through_f64(point: [f64; 3], normal: Vec3) -> Option<Self> {
        let plane = Self::through(Vec3::from(point.map(|c| c as f32)), normal)?;
        let left = |exact: f64, rounded: f32| (exact - f64::from(rounded)) as f32;
        let [x, y, z] = point;
        let a = plane.anchor;
        Some(Self { rest: plane.normal.dot(Vec3::new(left(x, a.x), left(y, a.y), left(z, a.z))), ..plane })
    }

    /// Unit normal.
    #[must_use]
    pub const fn normal(&self) -> Vec3 {
        self.normal
    }

    /// Signed distance of the frame's origin from the plane, negated: normal · p for every p on the plane.
    #[must_use]
    pub fn offset(&self) -> f32 {
        self.normal.dot(self.anchor) + self.rest
    }

    /// A point on the plane, to rounding: the one it was made from, near which it is most exact.
    #[must_use]
    pub const fn anchor(&self) -> Vec3 {
        self.anchor
    }

    /// Signed distance of a point in metres, positive on the normal's side.
    #[must_use]
    pub fn distance(&self, p: Vec3) -> f32 {
        self.normal.dot(p - self.anchor) - self.rest
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
        let normal = rotate(rotation, self.normal);
        let turned = rotate(rotation, self.anchor);
        let anchor = turned + translation;
        // What the sum rounded away (Knuth's two-sum, exact): at 10 km up to half a millimetre.
        let seen = anchor - turned;
        let lost = (turned - (anchor - seen)) + (translation - seen);
        Self { normal, anchor, rest: self.rest + normal.dot(lost) }
    }

    /// The same plane facing the other way.
    #[must_use]
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, anchor: self.anchor, rest: -self.rest }
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
            self.centre + rotate(self.rotation, self.half * Vec3::new(sign(1), sign(2), sign(4)))
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
    fn directions_may_have_any_length() {
        for scale in [1e-37_f32, 1e-25, 1.0, 1e25, 1e38] {
            let ray = Ray::new(Vec3::ZERO, Vec3::new(0.6, 0.0, 0.8) * scale).unwrap();
            assert!((ray.direction() - Vec3::new(0.6, 0.0, 0.8)).length() < 2e-7, "{scale}");
        }
        assert_eq!(unit(Vec3::splat(1e-45)), None);
        assert_eq!(unit(Vec3::new(f32::INFINITY, 1.0, 0.0)), None);
    }

    /// A floor plane 1.5 m below a camera that stands 10 km from the origin.
    #[test]
    fn ten_kilometres_off_a_plane_keeps_its_tenth_of_a_millimetre() {
        let floor = Plane::through(Vec3::new(0.1, 1.5, 3.0), Vec3::new(0.01, -1.0, 0.02)).unwrap();
        let q = super::super::rotation::unit(Quat::from_xyzw(0.1, -0.4, 0.3, 0.8));
        let t = Vec3::new(9876.5, -8765.4, 7654.3);
        let moved = floor.transformed(q, t);
        // World points are multiples of a millimetre there: what they are in the camera's frame is computed in f64.
        for p in [Vec3::new(2.0, 0.3, 4.0), Vec3::new(-3.0, -1.0, 1.0)] {
            let world = rotate(q, p) + t;
            let back = super::super::rotation::rotate_back_exactly(q, world - t);
            let want = floor.distance(Vec3::from(back.map(|c| c as f32)));
            assert!((moved.distance(world) - want).abs() < 2e-6, "{} {want}", moved.distance(world));
        }
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
