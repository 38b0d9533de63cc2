//! Turning by unit quaternions in plain scalar arithmetic: the same bits on every target.
//!
//! glam's own quaternion product and `slerp` are SSE2 on x86 (sums in another order than elsewhere) and fuse where the target has
//! FMA, so their last bits depend on the machine (docs/numerics.md). Everything here is one fixed sequence of
//! multiplications and additions; the compiler never fuses those by itself.

use glam::{Quat, Vec3};

use super::math;

/// `v` turned by the unit quaternion `q`: v + w t + b x t with t = 2 b x v. Error at most 18 half ulps (2^-24; found: 9.5) of |v|.
#[inline]
pub(crate) fn rotate(q: Quat, v: Vec3) -> Vec3 {
    let b = Vec3::new(q.x, q.y, q.z);
    let t = 2.0 * b.cross(v);
    v + q.w * t + b.cross(t)
}

/// `v` turned back by the unit quaternion `q`.
#[inline]
pub(crate) fn rotate_back(q: Quat, v: Vec3) -> Vec3 {
    let b = Vec3::new(q.x, q.y, q.z);
    let t = 2.0 * v.cross(b);
    v + q.w * t + t.cross(b)
}

/// As [`rotate_back`], in double precision and for a quaternion of any length above 0: for vectors of kilometres, where the
/// rounding of the quaternion's length alone is a millimetre.
pub(crate) fn rotate_back_exactly(q: Quat, v: Vec3) -> [f64; 3] {
    let [x, y, z, w] = [q.x, q.y, q.z, q.w].map(f64::from);
    let [a, b, c] = [v.x, v.y, v.z].map(f64::from);
    let s = 2.0 / (x * x + y * y + z * z + w * w);
    let cross =
        |[ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]| [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
    let t = cross([a, b, c], [x, y, z]);
    let u = cross(t, [x, y, z]);
    let [tx, ty, tz] = t;
    let [ux, uy, uz] = u;
    [a + s * (w * tx + ux), b + s * (w * ty + uy), c + s * (w * tz + uz)]
}

/// First `b`, then `a`. Not normalised.
#[inline]
pub(crate) fn product(a: Quat, b: Quat) -> Quat {
    Quat::from_xyzw(
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
    )
}

/// Length of a quaternion.
#[inline]
pub(crate) fn length(q: Quat) -> f32 {
    math::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
}

/// Made unit length; the identity when there is no length.
#[inline]
pub(crate) fn unit(q: Quat) -> Quat {
    let length = length(q);
    if length > 0.0 { Quat::from_xyzw(q.x / length, q.y / length, q.z / length, q.w / length) } else { Quat::IDENTITY }
}

/// The turn from `from` to `to` the shorter way, as axis times angle (radians).
pub(crate) fn way(from: Quat, to: Quat) -> Vec3 {
    let d = product(to, from.conjugate());
    // q and -q are one orientation: take the shorter way.
    let d = if d.w < 0.0 { -d } else { d };
    let v = Vec3::new(d.x, d.y, d.z);
    let s = v.length();
    // For small angles sin(a/2) = a/2 to f32 rounding, and the quotient would divide 0 by 0.
    if s < 1e-6 { v * 2.0 } else { v * (2.0 * math::atan2(s, d.w) / s) }
}

/// `q` turned further by axis times angle (radians).
pub(crate) fn turned(q: Quat, turn: Vec3) -> Quat {
    let half = 0.5 * turn.length();
    let sinc = if half < 1e-6 { 1.0 } else { math::sin(half) / half };
    let v = turn * (0.5 * sinc);
    // Renormalised, so that rounding does not build up; the length is near 1, never 0.
    unit(product(Quat::from_xyzw(v.x, v.y, v.z, math::cos(half)), q))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_glam(a in proptest::array::uniform4(-1.0_f32..1.0), b in proptest::array::uniform4(-1.0_f32..1.0),
                            v in proptest::array::uniform3(-9.0_f32..9.0), share in 0.0_f32..1.0) {
            let (a, b) = (unit(Quat::from_array(a)), unit(Quat::from_array(b)));
            let v = Vec3::from(v);
            prop_assert!((rotate(a, v) - a * v).length() < 1e-5);
            prop_assert!((rotate_back(a, rotate(a, v)) - v).length() < 1.5e-5);
            let [x, y, z] = rotate_back_exactly(a, v);
            prop_assert!((rotate_back(a, v) - Vec3::new(x as f32, y as f32, z as f32)).length() < 1e-5);
            prop_assert!((product(a, b) - a * b).length() < 1e-6);
            // glam's slerp approximates the arc cosine.
            let between = turned(a, way(a, b) * share);
            prop_assert!(between.dot(a.slerp(b, share)).abs() > 1.0 - 1e-5);
        }
    }
}
