//! Bodies of flat facets, made from a few numbers: torus knots and (rough) balls as meshes, convex polyhedra as half-spaces.
//!
//! They are of the kind that published normals are compared on (3F2N: Fan et al., RA-L 2021, doi 10.1109/LRA.2021.3067308): every normal is
//! that of a flat facet, never smoothed, and edges are sharp.
//!
//! A polyhedron is where a ray is inside all half-spaces at once: the last plane entered is the facet that is met. That is as
//! exact as a plane and needs no list of corners. Balls are icosahedra whose triangles are cut in four, `level` times.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::mesh::Triangle;
use super::{Ray, Touch};
use crate::maths::{V3, v3};
use crate::random::Random;

/// The golden ratio; its powers are the coordinates of the icosahedron and the dodecahedron.
const PHI: f64 = 1.618_033_988_749_895;

/// A convex body: where every face's plane has the point on its inner side.
#[derive(Debug, Clone)]
pub(crate) struct Polyhedron {
    /// Unit normals, outward, and distances from the origin, metres.
    faces: Vec<(V3, f64)>,
    /// Half the box around it, metres.
    half: V3,
}

/// The signed cyclic permutations of (0, a, b).
fn cyclic(a: f64, b: f64) -> impl Iterator<Item = V3> {
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].into_iter().flat_map(move |(s, t)| {
        let (a, b) = (s * a, t * b);
        [v3(0.0, a, b), v3(b, 0.0, a), v3(a, b, 0.0)]
    })
}

/// The eight corners of a cube.
fn diagonals() -> impl Iterator<Item = V3> {
    (0..8_u32).map(|i| {
        let sign = |bit: u32| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
        v3(sign(0), sign(1), sign(2))
    })
}

/// Which way the faces of a regular solid look; `None` unless there are 4, 6, 8, 12 or 20.
fn regular(faces: u32) -> Option<Vec<V3>> {
    Some(match faces {
        4 => diagonals().filter(|d| d.x * d.y * d.z > 0.0).collect(),
        6 => [v3(1.0, 0.0, 0.0), v3(0.0, 1.0, 0.0), v3(0.0, 0.0, 1.0)].into_iter().flat_map(|d| [d, -d]).collect(),
        8 => diagonals().collect(),
        12 => cyclic(1.0, PHI).collect(),
        20 => diagonals().chain(cyclic(PHI, 1.0 / PHI)).collect(),
        _ => return None,
    })
}

/// Directions spread evenly by a spiral, then each moved aside at random, by up to half of what lies between neighbours.
fn spread(faces: u32, seed: u64) -> Vec<V3> {
    let (n, random) = (f64::from(faces), Random::new(seed).stream(0x4444));
    let aside = 0.5 * (4.0 * std::f64::consts::PI / n).sqrt();
    let direction = |i: u32| {
        let (y, turn) = (1.0 - (2.0 * f64::from(i) + 1.0) / n, TAU * f64::from(i) / PHI);
        let (s, c) = libm::sincos(turn);
        let ring = (1.0 - y * y).sqrt();
        let move_by = |k: u64| aside * (2.0 * random.unit(3 * u64::from(i) + k) - 1.0);
        (v3(ring * c, y, ring * s) + v3(move_by(0), move_by(1), move_by(2))).unit_or_up()
    };
    (0..faces).map(direction).collect()
}

impl Polyhedron {
    /// Faces that all touch a ball of this radius: a regular solid, or with a seed, a random one. `None`: no such regular solid,
    /// or faces that enclose nothing.
    pub(crate) fn around(radius: f64, faces: u32, seed: Option<u64>) -> Option<Self> {
        let directions = match seed {
            None => regular(faces)?,
            Some(seed) => spread(faces, seed),
        };
        let faces: Vec<(V3, f64)> = directions.iter().map(|d| (d.unit_or_up(), radius)).collect();
        // Every corner is where three faces meet and the others agree.
        let mut half = V3::ZERO;
        for (i, a) in faces.iter().enumerate() {
            for (j, b) in faces.iter().enumerate().skip(i + 1) {
                let edge = a.0.cross(b.0);
                // Along an edge that no face ends, the body goes on for ever; parallel faces have no edge.
                let endless = |d: V3| faces.iter().all(|f| f.0.dot(d) <= 1e-9);
                if edge.length() > 1e-9 && (endless(edge) || endless(-edge)) {
                    return None;
                }
                for c in faces.iter().skip(j + 1) {
                    let volume = edge.dot(c.0);
                    let corner = (b.0.cross(c.0) * a.1 + c.0.cross(a.0) * b.1 + edge * c.1) / volume;
                    let kept = |f: &(V3, f64)| f.0.dot(corner) <= f.1 + 1e-9 * radius;
                    // Nearly parallel faces meet nowhere that counts; false for NaN.
                    if volume.abs() > 1e-9 && faces.iter().all(kept) {
                        half = half.max(v3(corner.x.abs(), corner.y.abs(), corner.z.abs()));
                    }
                }
            }
        }
        // Bodies that only just close reach far; nobody means them.
        (half.x.max(half.y).max(half.z) <= radius * 10.0).then_some(Self { faces, half })
    }

    pub(super) const fn half(&self) -> V3 {
        self.half
    }

    pub(super) fn intersect(&self, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
        let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
        for (part, (normal, distance)) in self.faces.iter().enumerate() {
            let (speed, room) = (normal.dot(ray.direction), distance - normal.dot(ray.origin));
            if speed == 0.0 {
                if room < 0.0 {
                    return None;
                }
                continue;
            }
            let t = room / speed;
            if speed < 0.0 && t > enter.0 {
                enter = (t, part as u32);
            } else if speed > 0.0 && t < leave.0 {
                leave = (t, part as u32);
            }
        }
        if enter.0 > leave.0 {
            return None;
        }
        [enter, leave].into_iter().find(|(t, _)| *t > near && *t < far).map(|(t, part)| Touch { t, part })
    }

    pub(super) fn normal(&self, part: u32) -> V3 {
        self.faces.get(part as usize).map_or(V3::UP, |f| f.0)
    }
}

/// A tube along a torus knot about y: `winds` times around the axis while `turns` times through the hole. `rings` x `sides` flat
/// quads, each cut in two triangles; the knot's own radius is `radius`, the tube's `tube`, metres.
pub(crate) fn torus_knot(radius: f64, tube: f64, [winds, turns]: [u32; 2], [rings, sides]: [u32; 2]) -> Vec<Triangle> {
    let (p, q) = (f64::from(winds), f64::from(turns));
    let along = |i: u32| {
        let u = TAU * f64::from(i % rings) / f64::from(rings);
        let ((sp, cp), (sq, cq)) = (libm::sincos(p * u), libm::sincos(q * u));
        let wide = 2.0 + cq;
        let point = v3(wide * cp, -sq, wide * sp) * (radius / 3.0);
        let ahead = v3(-wide * p * sp - q * sq * cp, -q * cq, wide * p * cp - q * sq * sp);
        // Towards the middle line of the torus, without its part along the way: a normal of the knot that never turns over.
        let out = v3(cp * cq, -sq, sp * cq);
        let ahead = ahead.unit_or_up();
        let out = (out - ahead * out.dot(ahead)).unit_or_up();
        (point, out, ahead.cross(out))
    };
    let corner = |i: u32, k: u32| {
        let (point, out, side) = along(i);
        let (s, c) = libm::sincos(TAU * f64::from(k % sides) / f64::from(sides));
        point + (out * c + side * s) * tube
    };
    let mut triangles = Vec::with_capacity(2 * rings as usize * sides as usize);
    for i in 0..rings {
        for k in 0..sides {
            let (a, b, c, d) = (corner(i, k), corner(i, k + 1), corner(i + 1, k + 1), corner(i + 1, k));
            triangles.extend([facet(a, b, c), facet(a, c, d)]);
        }
    }
    triangles
}

/// A ball of 20 x 4^`level` triangles, whose corners lie nearer to the middle by up to a part `roughness` of the radius, at random.
pub(crate) fn icosphere(radius: f64, level: u32, roughness: f64, seed: u64) -> Vec<Triangle> {
    let mut corners: Vec<V3> = cyclic(1.0, PHI).map(V3::unit_or_up).collect();
    // Faces are the triples of corners that are all one edge apart; the order of the corners is made outward.
    let near = |a: V3, b: V3| a.dot(b) > 0.4 && a != b;
    let mut faces: Vec<[usize; 3]> = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let (p, q, r) = (corners[a], corners[b], corners[c]);
                if near(p, q) && near(q, r) && near(r, p) {
                    faces.push(if (q - p).cross(r - p).dot(p) > 0.0 { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..level {
        let mut middles = BTreeMap::new();
        let mut middle = |a: usize, b: usize| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                corners.push((corners[a] + corners[b]).unit_or_up());
                corners.len() - 1
            })
        };
        let cut = |[a, b, c]: [usize; 3]| {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        faces = faces.into_iter().flat_map(cut).collect();
    }
    let random = Random::new(seed).stream(0x5555);
    let at = |i: usize| corners[i] * (radius * (1.0 - roughness * random.unit(i as u64)));
    faces.into_iter().map(|[a, b, c]| facet(at(a), at(b), at(c))).collect()
}

const fn facet(a: V3, b: V3, c: V3) -> Triangle {
    Triangle { a, b, c, uv: [[0.0; 2]; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times the volume of a closed mesh whose triangles are counter-clockwise from outside, and whether each edge is met by
    /// exactly one triangle each way.
    fn closed(triangles: &[Triangle]) -> (f64, bool) {
        let key = |p: V3| [p.x, p.y, p.z].map(f64::to_bits);
        let mut edges = BTreeMap::new();
        let mut volume = 0.0;
        for t in triangles {
            volume += t.a.dot(t.b.cross(t.c));
            for (a, b) in [(t.a, t.b), (t.b, t.c), (t.c, t.a)] {
                *edges.entry((key(a), key(b))).or_insert(0) += 1;
            }
        }
        (volume, edges.iter().all(|((a, b), n)| *n == 1 && edges.get(&(*b, *a)) == Some(&1)))
    }

    #[test]
    fn meshes_are_closed_and_as_large_as_they_should_be() {
        let ball = icosphere(2.0, 4, 0.0, 0);
        let (six, whole) = closed(&ball);
        assert_eq!(ball.len(), 20 * 256);
        assert!(whole && (six / 6.0 / (4.0 / 3.0 * std::f64::consts::PI * 8.0) - 1.0).abs() < 0.01, "{six}");
        let (rough, whole) = closed(&icosphere(2.0, 4, 0.2, 7));
        assert!(whole && rough < six && rough > 0.5 * six);
        for (winds, sizes) in [([2, 3], [94, 16]), ([3, 7], [400, 24])] {
            let knot = torus_knot(3.0, 0.2, winds, sizes);
            let (six, whole) = closed(&knot);
            // A tube's volume is its cross-section times the length of its middle line (Pappus).
            let side = TAU / f64::from(sizes[1]);
            let section = 0.5 * f64::from(sizes[1]) * libm::sin(side) * 0.04;
            let point = |i: u32| {
                let u = TAU * f64::from(i) / 1e5;
                let wide = 2.0 + libm::cos(f64::from(winds[1]) * u);
                let (s, c) = libm::sincos(f64::from(winds[0]) * u);
                v3(wide * c, -libm::sin(f64::from(winds[1]) * u), wide * s)
            };
            let length: f64 = (0..100_000).map(|i| (point(i + 1) - point(i)).length()).sum();
            assert!(whole && (six / 6.0 / (section * length) - 1.0).abs() < 0.02, "{winds:?} {six} {length}");
        }
    }

    #[test]
    fn polyhedra_are_met_where_their_half_spaces_say() {
        assert!(Polyhedron::around(1.0, 7, None).is_none(), "no regular solid of seven faces");
        assert!(Polyhedron::around(1.0, 3, Some(1)).is_none(), "three faces enclose nothing");
        assert!(Polyhedron::around(1.0, 4, Some(3)).is_none(), "these four all look down");
        let random = Random::new(2);
        for (faces, seed) in [(4, None), (6, None), (8, None), (12, None), (20, None), (16, Some(1)), (60, Some(9))] {
            let body = Polyhedron::around(0.5, faces, seed).unwrap();
            assert_eq!(body.faces.len(), faces as usize);
            let outside = |p: V3| body.faces.iter().map(|f| f.0.dot(p) - f.1).fold(f64::NEG_INFINITY, f64::max);
            let mut hits = 0;
            for i in 0..500 {
                let n = |k: u64| random.normal(i * 8 + k);
                let from = v3(n(0), n(1), n(2)).unit_or_up() * 6.0;
                let ray = Ray { origin: from, direction: v3(n(3), n(4), n(5)) * 0.3 - from };
                let Some(touch) = body.intersect(&ray, 0.0, 1e9) else { continue };
                hits += 1;
                let p = ray.at(touch.t);
                assert!(outside(p).abs() < 1e-13, "on the surface");
                assert!((body.normal(touch.part).dot(p) - 0.5).abs() < 1e-13, "on the face it names");
                assert!(body.normal(touch.part).dot(ray.direction) < 0.0 && outside(ray.at(0.99 * touch.t)) > 0.0);
                let half = body.half() * (1.0 + 1e-12);
                assert!(p.x.abs() <= half.x && p.y.abs() <= half.y && p.z.abs() <= half.z, "in its box");
                // From within, the way out.
                let out = body.intersect(&Ray { origin: V3::ZERO, direction: p }, 0.0, 1e9).unwrap();
                assert!((out.t - 1.0).abs() < 1e-12);
            }
            assert!(hits > 200, "{faces}: {hits}");
        }
    }
}
