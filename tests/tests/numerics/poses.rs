//! Poses, planes and rays near the origin and 10 km from it, against f64.

use std::sync::LazyLock;

use glam::{DVec3, Vec3};
use isobath::ground::geometry::{Plane, Ray};
use isobath::sensing::camera::Pose;

use crate::table::{Dice, Row, U, Worst, hold, rotate_back_f64, rotate_f64};

pub(crate) static ROWS: LazyLock<Vec<Row>> =
    LazyLock::new(|| [near_and_far(), chains(), planes()].into_iter().flatten().collect());

#[test]
fn poses_hold_their_bounds() {
    hold(&ROWS);
}

/// Ten kilometres.
pub(crate) const FAR: f32 = 10_000.0;

fn text(p: Vec3) -> String {
    format!("({}, {}, {})", p.x, p.y, p.z)
}

fn near_and_far() -> Vec<Row> {
    let mut dice = Dice::new(11);
    let (mut turn, mut near, mut far, mut camera) = (Worst::new(), Worst::new(), Worst::new(), Worst::new());
    for _ in 0..100_000 {
        let (q, t) = (dice.turn(), dice.vec3(10.0));
        let p = dice.vec3(1.0) * dice.log(1e-3, 65.0);
        let pose = Pose::new(q, t).unwrap();
        let q = pose.rotation();
        let want = rotate_f64(q, p.as_dvec3());
        let got = pose.direction_to_world(p);
        turn.vec3(got);
        turn.see((got.as_dvec3() - want).length() / p.as_dvec3().length() / U, || text(p));
        let got = pose.to_world(p);
        near.vec3(got);
        let want = want + t.as_dvec3();
        near.see((got.as_dvec3() - want).length() / (p.as_dvec3().length() + want.length()) / U, || text(p));

        let t = Vec3::new(dice.between(-FAR, FAR), dice.between(-FAR, FAR), dice.between(-FAR, FAR));
        let p = dice.vec3(8.0);
        let pose = Pose::new(q, t).unwrap();
        let q = pose.rotation();
        let world = pose.to_world(p);
        far.vec3(world);
        let want = rotate_f64(q, p.as_dvec3()) + t.as_dvec3();
        far.see((world.as_dvec3() - want).length() * 1e3, || format!("{} from {}", text(p), text(t)));
        let got = pose.to_camera(world);
        camera.vec3(got);
        let way = world.as_dvec3() - t.as_dvec3();
        camera.see((got.as_dvec3() - rotate_back_f64(q, way)).length() / way.length() / U, || {
            format!("{} from {}", text(world), text(t))
        });
    }
    vec![
        turn.row(
            "Pose::direction_to_world",
            "1 mm to 65 m",
            "half ulps of |p|",
            18.0,
            "v + w t + b x t with t = 2 b x v, |b| = s and w = c of the half angle. A cross product's rounding is 1.155 + 1 of |a| |b|: t is off by 4.3 s, w t by 6.3 s c, b x t by 8.6 s²; the two outer sums add 1.4 and 1, and the quaternion's length, off by 3.5 / 2, changes the answer by 7 s: 18 at half a turn, if all conspire.",
        ),
        near.row(
            "Pose::to_world, near",
            "poses within 10 m",
            "half ulps of |p| + |world|",
            9.5,
            "the turn's 18 is of |p|, of which the sum |p| + |world| is at least twice (but for |t|, which has no error); the last sum rounds by 1/2.",
        ),
        far.row(
            "Pose::to_world, 10 km",
            "poses within 10 km, points within 8 m",
            "mm",
            0.85,
            "the answer's own rounding, 0.488 mm on each of three axes (0.846), and 5e-3 for the turn: a world of `f32` is no finer out there.",
        ),
        camera.row(
            "Pose::to_camera, 10 km",
            "the same, back",
            "half ulps of the distance",
            19.0,
            "the subtraction comes first and rounds once, of the distance; then `direction_to_world`'s 18.",
        ),
    ]
}

fn chains() -> Vec<Row> {
    let mut dice = Dice::new(12);
    let (mut inverse, mut compose, mut relative, mut rotation) =
        (Worst::new(), Worst::new(), Worst::new(), Worst::new());
    for _ in 0..100_000 {
        let far =
            |dice: &mut Dice| Vec3::new(dice.between(-FAR, FAR), dice.between(-FAR, FAR), dice.between(-FAR, FAR));
        let t = far(&mut dice);
        let a = Pose::new(dice.turn(), t).unwrap();
        let b = Pose::new(dice.turn(), t + dice.vec3(3.0)).unwrap();
        let i = a.inverse();
        inverse.vec3(i.translation());
        let want = -rotate_back_f64(a.rotation(), t.as_dvec3());
        inverse.see((i.translation().as_dvec3() - want).length() * 1e3, || text(t));
        let small = Pose::new(dice.turn(), dice.vec3(3.0)).unwrap();
        let c = a.compose(&small);
        compose.vec3(c.translation());
        let want = rotate_f64(a.rotation(), small.translation().as_dvec3()) + t.as_dvec3();
        compose.see((c.translation().as_dvec3() - want).length() * 1e3, || text(t));
        let product = a.rotation().as_dquat().normalize() * small.rotation().as_dquat().normalize();
        rotation.quat(c.rotation());
        let off = (c.rotation().as_dquat() - product).length().min((c.rotation().as_dquat() + product).length());
        rotation.see(off / U, || format!("{:?} {:?}", a.rotation(), small.rotation()));
        let r = b.relative_to(&a);
        relative.vec3(r.translation());
        relative.quat(r.rotation());
        let way = b.translation().as_dvec3() - t.as_dvec3();
        let want = rotate_back_f64(a.rotation(), way);
        relative.see((r.translation().as_dvec3() - want).length() / way.length() / U, || text(t));
    }
    vec![
        inverse.row(
            "Pose::inverse, 10 km",
            "poses within 10 km on each axis",
            "mm",
            1.04,
            "computed in f64 (in `f32` it was 5.5 mm), so only the answer is rounded: half a millimetre on three axes (0.846), or, where one is above 16,384 m, 0.977 mm on it and 0.244 on the others, which are then below 4,096 m (1.04).",
        ),
        compose.row("Pose::compose, 10 km", "steps of 3 m", "mm", 0.85, "as `to_world`."),
        rotation.row(
            "Pose::compose, rotation",
            "any two",
            "half ulps of 1",
            5.0,
            "each entry sums four products (at most 4 roundings of entries whose squares sum to 1) and the factors' lengths are off by 1 each; normalising takes the part along the quaternion away and rounds twice.",
        ),
        relative.row(
            "Pose::relative_to, 10 km",
            "two poses 3 m apart, 10 km off",
            "half ulps of the distance between",
            19.0,
            "as `to_camera`; through `inverse().compose()` it was 5 mm.",
        ),
    ]
}

fn planes() -> Vec<Row> {
    let mut dice = Dice::new(13);
    let (mut height, mut moved, mut meet, mut length, mut offset) =
        (Worst::new(), Worst::new(), Worst::new(), Worst::new(), Worst::new());
    for _ in 0..100_000 {
        // A floor seen from a camera 10 km off, and a point near it.
        let t = Vec3::new(dice.between(-FAR, FAR), dice.between(-FAR, FAR), dice.between(-FAR, FAR));
        let normal = dice.vec3(1.0) * dice.log(1e-30, 1e30);
        let here = t + dice.vec3(5.0);
        let Some(plane) = Plane::through(here, normal) else { continue };
        let p = t + dice.vec3(5.0);
        let n = plane.normal().as_dvec3();
        let got = plane.distance(p);
        height.f32(got);
        let way = p.as_dvec3() - here.as_dvec3();
        height.see((f64::from(got) - n.dot(way)) / way.length() / U, || format!("{} over {}", text(p), text(here)));
        length.vec3(plane.normal());
        let exact = normal.as_dvec3().normalize();
        length.see((n - exact).length() / U, || format!("({:e}, {:e}, {:e})", normal.x, normal.y, normal.z));

        // The same plane, made in the camera's frame and moved there.
        let pose = Pose::new(dice.turn(), t).unwrap();
        let local = Plane::through(dice.vec3(5.0), dice.vec3(1.0)).unwrap();
        let there = local.transformed(pose.rotation(), t);
        let got = there.distance(p);
        moved.f32(got);
        let q = rotate_back_f64(pose.rotation(), p.as_dvec3() - t.as_dvec3());
        let want = local.normal().as_dvec3().dot(q - local.anchor().as_dvec3());
        moved.see((f64::from(got) - want) * 1e6, || format!("{} from {}", text(p), text(t)));
        offset.f32(there.offset());
        let exact = local.normal().as_dvec3().dot(local.anchor().as_dvec3())
            + rotate_f64(pose.rotation(), local.normal().as_dvec3()).dot(t.as_dvec3());
        offset.see((f64::from(there.offset()) - exact) * 1e3, || text(t));

        // A ray onto it, not along it.
        let ray = Ray::new(p, dice.vec3(1.0)).unwrap();
        let slant = n.dot(ray.direction().as_dvec3());
        if slant.abs() < 1e-3 {
            continue;
        }
        if let Some(at) = plane.intersect(&ray) {
            meet.f32(at);
            let want = -n.dot(way) / slant;
            let scale = (way.length() + want) / slant.abs();
            meet.see((f64::from(at) - want) / scale / U, || format!("{} slant {slant:.3}", text(p)));
        }
    }
    vec![
        length.row(
            "Plane::through, Ray::new",
            "normals of length 1e-30 to 1e30",
            "half ulps of 1",
            4.0,
            "scaled by the largest component (1), length (2.5) and its reciprocal (1), product (1), of which the largest component's share is common. Before, lengths beyond 1e19 and below 1e-19 were refused.",
        ),
        height.row(
            "Plane::distance, 10 km",
            "planes and points within 5 m of each other, 10 km off",
            "half ulps of their distance",
            4.0,
            "the difference rounds once, the products and the two sums of the dot product once each. As normal · p - offset it was 2.4 mm.",
        ),
        moved.row(
            "Plane::transformed, 10 km",
            "a camera's plane moved 10 km",
            "µm",
            15.0,
            "the turned normal and anchor are off by 9.5 half ulps (found above) of 1 and of 8.7 m, and the lever is up to 17.3 m: 9.5 (8.7 + 17.3) 2^-24 m = 14.7 µm. The sum with the translation is carried in `rest`, exactly.",
        ),
        offset.row(
            "Plane::offset, 10 km",
            "the same",
            "mm",
            13.0,
            "normal · anchor over 17.3 km: 9.5 half ulps of the turned normal (found above) and 3 of the products are 12.9 mm. `distance` does not use it.",
        ),
        meet.row(
            "Plane::intersect, 10 km",
            "rays at a slant of 0.001 or more",
            "half ulps of (distance + answer) / slant",
            4.0,
            "`distance`'s 4 of the distance, the slant's 3 of the answer over the slant.",
        ),
    ]
}

#[test]
fn a_relative_pose_far_off_is_exact_where_the_product_is_millimetres_off() {
    let t = Vec3::new(9_000.25, -8_000.5, 9_500.75);
    let mut dice = Dice::new(14);
    let a = Pose::new(dice.turn(), t).unwrap();
    let b = Pose::new(dice.turn(), t + Vec3::new(0.25, 0.5, 1.0)).unwrap();
    let want = rotate_back_f64(a.rotation(), DVec3::new(0.25, 0.5, 1.0));
    assert!((b.relative_to(&a).translation().as_dvec3() - want).length() < 1e-6);
    assert!((a.inverse().compose(&b).translation().as_dvec3() - want).length() > 1e-5);
}
