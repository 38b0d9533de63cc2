//! Closed-form intersections of the simple solids, each in its own frame.

use super::{Ray, Touch};
use crate::maths::{V3, v3};

const fn touch(t: f64, part: u32, near: f64, far: f64) -> Option<Touch> {
    // False for NaN.
    if t > near && t < far { Some(Touch { t, part }) } else { None }
}

pub(super) fn plane(normal: V3, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
    touch(-normal.dot(ray.origin) / normal.dot(ray.direction), 0, near, far)
}

pub(super) fn rectangle(half: [f64; 2], ray: &Ray, near: f64, far: f64) -> Option<Touch> {
    let hit = touch(-ray.origin.z / ray.direction.z, 0, near, far)?;
    let p = ray.at(hit.t);
    (p.x.abs() <= half[0] && p.y.abs() <= half[1]).then_some(hit)
}

/// Parts: 0, 1, 2 for the faces -x, -y, -z; 3, 4, 5 for +x, +y, +z.
pub(super) fn cuboid(half: V3, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut enter_part, mut leave_part) = (0, 0);
    for i in 0..3_u32 {
        let (o, d, h) = (ray.origin.axis(i as usize), ray.direction.axis(i as usize), half.axis(i as usize));
        if d == 0.0 {
            if o.abs() > h {
                return None;
            }
            continue;
        }
        let (inverse, half) = (1.0 / d, if d > 0.0 { h } else { -h });
        // Going up one enters through the lower face.
        let (a, b) = ((-half - o) * inverse, (half - o) * inverse);
        let (part_a, part_b) = if d > 0.0 { (i, i + 3) } else { (i + 3, i) };
        if a > enter {
            (enter, enter_part) = (a, part_a);
        }
        if b < leave {
            (leave, leave_part) = (b, part_b);
        }
    }
    if enter > leave {
        return None;
    }
    touch(enter, enter_part, near, far).or_else(|| touch(leave, leave_part, near, far))
}

pub(super) fn cuboid_surface(half: V3, p: V3, part: u32) -> (V3, [f64; 2]) {
    let sign = if part < 3 { -1.0 } else { 1.0 };
    let u = |v: f64, h: f64| 0.5 + 0.5 * v / h.max(1e-300);
    match part % 3 {
        0 => (v3(sign, 0.0, 0.0), [u(p.z * -sign, half.z), u(-p.y, half.y)]),
        1 => (v3(0.0, sign, 0.0), [u(p.x, half.x), u(p.z * sign, half.z)]),
        _ => (v3(0.0, 0.0, sign), [u(p.x * sign, half.x), u(-p.y, half.y)]),
    }
}

/// Both roots of a t² + 2 b t + c, the smaller first, without cancellation.
fn roots(a: f64, b: f64, c: f64) -> Option<(f64, f64)> {
    let discriminant = b * b - a * c;
    if !(discriminant >= 0.0) || a == 0.0 {
        return None;
    }
    let q = -(b + discriminant.sqrt().copysign(b));
    let (t0, t1) = (q / a, if q == 0.0 { 0.0 } else { c / q });
    Some(if t0 < t1 { (t0, t1) } else { (t1, t0) })
}

pub(super) fn sphere(centre: V3, radius: f64, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
    let (a, o) = (ray.direction.dot(ray.direction), ray.origin - centre);
    // From the point of the ray nearest to the centre, so that c does not cancel for far spheres.
    let t = -o.dot(ray.direction) / a;
    let rest = o + ray.direction * t;
    let room = radius * radius - rest.dot(rest);
    if !(room >= 0.0) {
        return None;
    }
    let half = (room / a).sqrt();
    touch(t - half, 0, near, far).or_else(|| touch(t + half, 0, near, far))
}

pub(super) fn sphere_surface(p: V3) -> (V3, [f64; 2]) {
    let n = p.unit_or_up();
    let u = 0.5 + libm::atan2(n.x, -n.z) / std::f64::consts::TAU;
    let v = libm::acos(n.y.clamp(-1.0, 1.0)) / std::f64::consts::PI;
    (n, [u, v])
}

/// Roots on the endless cylinder about y.
fn tube(radius: f64, ray: &Ray) -> Option<(f64, f64)> {
    let (o, d) = (ray.origin, ray.direction);
    let a = d.x * d.x + d.z * d.z;
    roots(a, o.x * d.x + o.z * d.z, o.x * o.x + o.z * o.z - radius * radius)
}

/// Parts: 0 mantle, 1 top, 2 bottom.
pub(super) fn cylinder(radius: f64, half: f64, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
    let mut best: Option<Touch> = None;
    let mut keep = |candidate: Option<Touch>| {
        if let Some(c) = candidate
            && best.is_none_or(|b| c.t < b.t)
        {
            best = Some(c);
        }
    };
    if let Some((t0, t1)) = tube(radius, ray) {
        for t in [t0, t1] {
            let y = ray.origin.y + ray.direction.y * t;
            if y.abs() <= half {
                keep(touch(t, 0, near, far));
            }
        }
    }
    for (y, part) in [(half, 1), (-half, 2)] {
        let t = (y - ray.origin.y) / ray.direction.y;
        let p = ray.at(t);
        if p.x * p.x + p.z * p.z <= radius * radius {
            keep(touch(t, part, near, far));
        }
    }
    best
}

pub(super) fn cylinder_surface(radius: f64, half: f64, p: V3, part: u32) -> (V3, [f64; 2]) {
    match part {
        1 => (V3::UP, [0.5 + 0.5 * p.x / radius, 0.5 + 0.5 * p.z / radius]),
        2 => (-V3::UP, [0.5 + 0.5 * p.x / radius, 0.5 - 0.5 * p.z / radius]),
        _ => {
            let n = v3(p.x, 0.0, p.z).unit().unwrap_or(v3(1.0, 0.0, 0.0));
            let u = 0.5 + libm::atan2(p.x, -p.z) / std::f64::consts::TAU;
            (n, [u, 0.5 - 0.5 * p.y / half.max(1e-300)])
        }
    }
}

pub(super) fn capsule(radius: f64, half: f64, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
    let mut best: Option<Touch> = None;
    let mut keep = |t: f64, on_it: bool| {
        if on_it && t > near && t < far && best.is_none_or(|b| t < b.t) {
            best = Some(Touch { t, part: 0 });
        }
    };
    if let Some((t0, t1)) = tube(radius, ray) {
        for t in [t0, t1] {
            keep(t, (ray.origin.y + ray.direction.y * t).abs() <= half);
        }
    }
    let a = ray.direction.dot(ray.direction);
    for end in [half, -half] {
        let o = ray.origin - v3(0.0, end, 0.0);
        if let Some((t0, t1)) = roots(a, o.dot(ray.direction), o.dot(o) - radius * radius) {
            for t in [t0, t1] {
                // The outer half of the end's sphere.
                keep(t, (o.y + ray.direction.y * t) * end.signum() >= 0.0);
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::shape::Shape;

    /// Every touch lies on its shape, its normal is the gradient there, and nothing nearer was missed (by marching).
    #[test]
    fn touches_lie_on_the_surface_and_are_the_first() {
        let on = |s: &Shape, p: V3| -> f64 {
            // Signed distances.
            match s {
                Shape::Box { half } => {
                    let q = v3(p.x.abs() - half.x, p.y.abs() - half.y, p.z.abs() - half.z);
                    q.max(V3::ZERO).length() + q.x.max(q.y).max(q.z).min(0.0)
                }
                Shape::Sphere { radius } => p.length() - radius,
                Shape::Cylinder { radius, half } => {
                    let q = [(p.x * p.x + p.z * p.z).sqrt() - radius, p.y.abs() - half];
                    v3(q[0].max(0.0), q[1].max(0.0), 0.0).length() + q[0].max(q[1]).min(0.0)
                }
                Shape::Capsule { radius, half } => (p - v3(0.0, p.y.clamp(-half, *half), 0.0)).length() - radius,
                _ => f64::NAN,
            }
        };
        let shapes = [
            Shape::Box { half: v3(0.3, 0.5, 0.2) },
            Shape::Sphere { radius: 0.6 },
            Shape::Cylinder { radius: 0.3, half: 0.5 },
            Shape::Capsule { radius: 0.25, half: 0.4 },
        ];
        let random = Random::new(5);
        let mut hits = 0;
        for i in 0..4000 {
            let n = |k: u64| random.normal(i * 8 + k);
            let ray = Ray { origin: v3(n(0), n(1), n(2)), direction: v3(n(3), n(4), n(5)) };
            for shape in &shapes {
                let marched = {
                    // Sphere tracing from the distance's sign at the start.
                    let (mut t, length) = (0.0, ray.direction.length());
                    let sign = on(shape, ray.origin).signum();
                    let mut found = None;
                    for _ in 0..4000 {
                        let d = on(shape, ray.at(t)) * sign;
                        if d < 1e-10 {
                            found = Some(t);
                            break;
                        }
                        t += d / length;
                        if t > 100.0 {
                            break;
                        }
                    }
                    found
                };
                let hit = shape.intersect(&ray, 0.0, 1e9);
                if let (Some(hit), Some(t)) = (hit, marched) {
                    hits += 1;
                    let p = ray.at(hit.t);
                    assert!(on(shape, p).abs() < 1e-12 * (1.0 + p.length()), "{shape:?} {ray:?}");
                    assert!((hit.t - t).abs() * ray.direction.length() < 1e-3, "{shape:?} {ray:?} {hit:?} {t}");
                    let (normal, uv) = shape.surface(p, hit.part);
                    assert!((on(shape, p + normal * 1e-6) - 1e-6).abs() < 1e-9, "{shape:?} {normal:?}");
                    assert!(uv.iter().all(|v| (-1e-9..=1.0 + 1e-9).contains(v)), "{shape:?} {uv:?}");
                } else {
                    assert!(hit.is_none() || marched.is_none_or(|t| t > 99.0), "{shape:?} {ray:?} {hit:?} {marched:?}");
                }
            }
        }
        assert!(hits > 800, "{hits}");
    }
}
