//! Three-dimensional `f64` arithmetic that gives the same bits on every machine.
//!
//! Only +, -, x, / and square roots (which IEEE 754 rounds correctly everywhere) and `libm` (the same code everywhere) are used:
//! no platform mathematics, no fused operations. glam is not used here because it fuses where the target can.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A point, direction or colour in `f64`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct V3 {
    /// First component.
    pub x: f64,
    /// Second component.
    pub y: f64,
    /// Third component.
    pub z: f64,
}

/// Short form of [`V3`].
#[must_use]
pub const fn v3(x: f64, y: f64, z: f64) -> V3 {
    V3 { x, y, z }
}

impl From<[f64; 3]> for V3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<V3> for [f64; 3] {
    fn from(v: V3) -> Self {
        [v.x, v.y, v.z]
    }
}

impl V3 {
    /// The origin.
    pub const ZERO: Self = v3(0.0, 0.0, 0.0);
    /// All ones.
    pub const ONE: Self = v3(1.0, 1.0, 1.0);
    /// Up in every scene.
    pub const UP: Self = v3(0.0, 1.0, 0.0);

    /// The same number three times.
    #[must_use]
    pub const fn splat(v: f64) -> Self {
        v3(v, v, v)
    }

    /// Dot product.
    #[inline]
    #[must_use]
    pub fn dot(self, o: Self) -> f64 {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    /// Cross product.
    #[inline]
    #[must_use]
    pub fn cross(self, o: Self) -> Self {
        v3(self.y * o.z - self.z * o.y, self.z * o.x - self.x * o.z, self.x * o.y - self.y * o.x)
    }

    /// Component by component.
    #[inline]
    #[must_use]
    pub fn times(self, o: Self) -> Self {
        v3(self.x * o.x, self.y * o.y, self.z * o.z)
    }

    /// Euclidean length.
    #[inline]
    #[must_use]
    pub fn length(self) -> f64 {
        self.dot(self).sqrt()
    }

    /// Length one, or `None` when there is no direction (zero, NaN, infinite).
    #[inline]
    #[must_use]
    pub fn unit(self) -> Option<Self> {
        let length = self.length();
        (length > 0.0 && length < f64::INFINITY).then(|| self / length)
    }

    /// Length one; straight up where there is no direction.
    #[inline]
    #[must_use]
    pub fn unit_or_up(self) -> Self {
        self.unit().unwrap_or(Self::UP)
    }

    /// Smaller components of both.
    #[inline]
    #[must_use]
    pub fn min(self, o: Self) -> Self {
        v3(self.x.min(o.x), self.y.min(o.y), self.z.min(o.z))
    }

    /// Larger components of both.
    #[inline]
    #[must_use]
    pub fn max(self, o: Self) -> Self {
        v3(self.x.max(o.x), self.y.max(o.y), self.z.max(o.z))
    }

    /// Component 0, 1 or 2 (2 for anything larger).
    #[inline]
    #[must_use]
    pub const fn axis(self, i: usize) -> f64 {
        match i {
            0 => self.x,
            1 => self.y,
            _ => self.z,
        }
    }

    /// No component is NaN or infinite.
    #[must_use]
    pub const fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }

    /// Rounded to `f32`.
    #[must_use]
    pub const fn to_f32(self) -> [f32; 3] {
        [self.x as f32, self.y as f32, self.z as f32]
    }

    /// From `self` (0) to `o` (1).
    #[inline]
    #[must_use]
    pub fn lerp(self, o: Self, t: f64) -> Self {
        self * (1.0 - t) + o * t
    }
}

impl Add for V3 {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        v3(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl AddAssign for V3 {
    #[inline]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl Sub for V3 {
    type Output = Self;
    #[inline]
    fn sub(self, o: Self) -> Self {
        v3(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl Neg for V3 {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        v3(-self.x, -self.y, -self.z)
    }
}

impl Mul<f64> for V3 {
    type Output = Self;
    #[inline]
    fn mul(self, s: f64) -> Self {
        v3(self.x * s, self.y * s, self.z * s)
    }
}

impl Div<f64> for V3 {
    type Output = Self;
    #[inline]
    fn div(self, s: f64) -> Self {
        v3(self.x / s, self.y / s, self.z / s)
    }
}

/// A rotation matrix, by its columns: the images of the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotation {
    /// Image of the x axis.
    pub x: V3,
    /// Image of the y axis.
    pub y: V3,
    /// Image of the z axis.
    pub z: V3,
}

impl Default for Rotation {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Rotation {
    /// Turns nothing.
    pub const IDENTITY: Self = Self { x: v3(1.0, 0.0, 0.0), y: v3(0.0, 1.0, 0.0), z: v3(0.0, 0.0, 1.0) };

    /// Yaw about y (up), then pitch about x, then roll about z, each in the turned frame: R = `Ry(yaw) Rx(pitch) Rz(roll)`. Radians.
    #[must_use]
    pub fn from_yaw_pitch_roll(yaw: f64, pitch: f64, roll: f64) -> Self {
        let (sy, cy) = libm::sincos(yaw);
        let (sp, cp) = libm::sincos(pitch);
        let (sr, cr) = libm::sincos(roll);
        let ry = Self { x: v3(cy, 0.0, -sy), y: v3(0.0, 1.0, 0.0), z: v3(sy, 0.0, cy) };
        let rx = Self { x: v3(1.0, 0.0, 0.0), y: v3(0.0, cp, sp), z: v3(0.0, -sp, cp) };
        let rz = Self { x: v3(cr, sr, 0.0), y: v3(-sr, cr, 0.0), z: v3(0.0, 0.0, 1.0) };
        ry.then(&rx).then(&rz)
    }

    /// About a rotation vector: its direction is the axis, its length the angle in radians.
    #[must_use]
    pub fn from_vector(v: V3) -> Self {
        let angle = v.length();
        let Some(axis) = v.unit() else { return Self::IDENTITY };
        let (s, c) = libm::sincos(angle);
        let turned = |e: V3| e * c + axis.cross(e) * s + axis * (axis.dot(e) * (1.0 - c));
        Self { x: turned(v3(1.0, 0.0, 0.0)), y: turned(v3(0.0, 1.0, 0.0)), z: turned(v3(0.0, 0.0, 1.0)) }
    }

    /// A vector turned.
    #[inline]
    #[must_use]
    pub fn apply(&self, v: V3) -> V3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }

    /// A vector turned back.
    #[inline]
    #[must_use]
    pub fn undo(&self, v: V3) -> V3 {
        v3(self.x.dot(v), self.y.dot(v), self.z.dot(v))
    }

    /// The product: `inner` first, then `self`.
    #[must_use]
    pub fn then(&self, inner: &Self) -> Self {
        Self { x: self.apply(inner.x), y: self.apply(inner.y), z: self.apply(inner.z) }
    }

    /// The inverse.
    #[must_use]
    pub const fn transposed(&self) -> Self {
        Self {
            x: v3(self.x.x, self.y.x, self.z.x),
            y: v3(self.x.y, self.y.y, self.z.y),
            z: v3(self.x.z, self.y.z, self.z.z),
        }
    }

    /// The angle of this rotation, radians, 0 to pi.
    #[must_use]
    pub fn angle(&self) -> f64 {
        let sine = 0.5 * v3(self.y.z - self.z.y, self.z.x - self.x.z, self.x.y - self.y.x).length();
        libm::atan2(sine, 0.5 * (self.x.x + self.y.y + self.z.z - 1.0))
    }

    /// As a unit quaternion x, y, z, w with w >= 0.
    #[must_use]
    pub fn quaternion(&self) -> [f64; 4] {
        let (m00, m11, m22) = (self.x.x, self.y.y, self.z.z);
        // Shepperd's method: divide by the largest component.
        let q = if m00 + m11 + m22 > 0.0 {
            [self.y.z - self.z.y, self.z.x - self.x.z, self.x.y - self.y.x, 1.0 + m00 + m11 + m22]
        } else if m00 > m11 && m00 > m22 {
            [1.0 + m00 - m11 - m22, self.x.y + self.y.x, self.x.z + self.z.x, self.y.z - self.z.y]
        } else if m11 > m22 {
            [self.x.y + self.y.x, 1.0 + m11 - m00 - m22, self.y.z + self.z.y, self.z.x - self.x.z]
        } else {
            [self.x.z + self.z.x, self.y.z + self.z.y, 1.0 + m22 - m00 - m11, self.x.y - self.y.x]
        };
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let sign = if q[3] < 0.0 { -length } else { length };
        q.map(|v| v / sign)
    }
}

/// A rigid transform: rotate, then move. Of a camera: camera-to-world.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rigid {
    /// The rotation.
    pub rotation: Rotation,
    /// The translation, metres.
    pub translation: V3,
}

impl Rigid {
    /// Moves nothing.
    pub const IDENTITY: Self = Self { rotation: Rotation::IDENTITY, translation: V3::ZERO };

    /// A point moved.
    #[inline]
    #[must_use]
    pub fn point(&self, p: V3) -> V3 {
        self.rotation.apply(p) + self.translation
    }

    /// A point moved back.
    #[inline]
    #[must_use]
    pub fn undo_point(&self, p: V3) -> V3 {
        self.rotation.undo(p - self.translation)
    }

    /// The product: `inner` first, then `self`.
    #[must_use]
    pub fn then(&self, inner: &Self) -> Self {
        Self { rotation: self.rotation.then(&inner.rotation), translation: self.point(inner.translation) }
    }

    /// A camera (x right, y down, z forward) at `eye` that looks at `target`, image top towards world up; looking straight
    /// up or down, image top is towards -z.
    #[must_use]
    pub fn looking_at(eye: V3, target: V3) -> Self {
        let z = (target - eye).unit().unwrap_or(v3(0.0, 0.0, -1.0));
        let x = z.cross(V3::UP).unit().or_else(|| z.cross(v3(0.0, 0.0, -1.0)).unit()).unwrap_or(v3(1.0, 0.0, 0.0));
        Self { rotation: Rotation { x, y: z.cross(x), z }, translation: eye }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_are_rigid_and_named_right() {
        let r = Rotation::from_yaw_pitch_roll(0.3, -0.7, 1.9);
        let back = r.then(&r.transposed());
        assert!(back.angle() < 1e-15 && (r.apply(v3(1.0, 2.0, 3.0)).length() - 14.0_f64.sqrt()).abs() < 1e-14);
        let quarter = Rotation::from_yaw_pitch_roll(std::f64::consts::FRAC_PI_2, 0.0, 0.0);
        assert!((quarter.apply(v3(0.0, 0.0, 1.0)) - v3(1.0, 0.0, 0.0)).length() < 1e-15, "yaw turns z to x");
        assert!((Rotation::from_vector(v3(0.0, 0.4, 0.0)).angle() - 0.4).abs() < 1e-15);
        for r in [r, quarter, Rotation::from_vector(v3(3.1, 0.2, 0.1)), Rotation::from_vector(v3(0.1, 0.2, 3.1))] {
            let [x, y, z, w] = r.quaternion();
            let v = v3(0.2, -0.5, 0.9);
            let u = v3(x, y, z);
            let turned = v + (u.cross(v) * w + u.cross(u.cross(v))) * 2.0;
            assert!((turned - r.apply(v)).length() < 1e-14);
        }
    }

    #[test]
    fn cameras_look_where_they_are_told() {
        let camera = Rigid::looking_at(v3(1.0, 1.5, 2.0), v3(0.0, 0.5, -1.0));
        let p = camera.undo_point(v3(0.0, 0.5, -1.0));
        assert!(p.x.abs() < 1e-15 && p.y.abs() < 1e-15 && p.z > 3.0);
        assert!(camera.rotation.y.y < 0.0, "image y points down");
        let down = Rigid::looking_at(v3(0.0, 2.0, 0.0), V3::ZERO);
        assert_eq!(down.rotation.z, v3(0.0, -1.0, 0.0));
        assert_eq!(down.rotation.y, v3(0.0, 0.0, 1.0), "image top towards -z");
    }
}
