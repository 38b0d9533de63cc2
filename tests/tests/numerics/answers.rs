//! Hits, rays, reflections, measurements, votes, height maps and the pyramid, against f64.

use std::sync::LazyLock;

use glam::{DVec3, Vec2, Vec3};
use isobath::ground::geometry::Ray;
use isobath::ground::image::ImageView;
use isobath::localized::collision::{CollisionParams, Verdict, vote};
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::measure::{MeasuredPoint, between};
use isobath::localized::normals::NormalParams;
use isobath::localized::raycast::{RayParams, cast};
use isobath::localized::reflect::{Bounce, ReflectParams, mirror, reflect};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

use crate::poses::FAR;
use crate::surfaces::{H, W, Wall, angle};
use crate::table::{Dice, Row, U, Worst, hold, rotate_back_f64, rotate_f64};

pub(crate) static ROWS: LazyLock<Vec<Row>> = LazyLock::new(|| {
    [hits(), rays(), reflections(), lengths(), vec![votes(), heights(), pyramid()]].into_iter().flatten().collect()
});

#[test]
fn answers_hold_their_bounds() {
    hold(&ROWS);
}

fn hits() -> Vec<Row> {
    let mut dice = Dice::new(41);
    let (mut near, mut far) = (Worst::new(), Worst::new());
    for _ in 0..5_000 {
        let wall = Wall::random(&mut dice, &[120.0, 525.0, 10_000.0], 4.0);
        let pose = Pose::new(dice.turn(), dice.vec3(FAR)).unwrap();
        let at = Vec2::new(dice.between(2.0, 45.0), dice.between(2.0, 33.0));
        let frame = wall.frame().with_pose(pose);
        let outcome = hit_test(&frame, at, &HitParams::default());
        let say = || format!("({}, {}), {}", at.x, at.y, wall.say());
        let Some(hit) = outcome.hit() else {
            near.see(f64::INFINITY, say);
            continue;
        };
        let ray = wall.ray(at);
        let z = -wall.distance / wall.normal.dot(ray);
        near.vec3(hit.camera_point);
        near.see((f64::from(hit.z) / z - 1.0) / U, say);
        let want = rotate_f64(pose.rotation(), ray * z) + pose.translation().as_dvec3();
        far.vec3(hit.point);
        far.see((hit.point.as_dvec3() - want).length() * 1e3, say);
    }
    vec![
        near.row("hit_test, z", "f 120 to 10,000 px, slants to 76°", "half ulps", 4.0, "depth's own rounding (1), and the tangent's correction: half a pixel of the fit's slopes, each off by 1 half ulp a pixel here, and two roundings. As a quotient of two products that cancel it was 1 / cos times as much."),
        far.row("hit_test, 10 km", "the same, 10 km off", "mm", 0.86, "the world's own rounding, 0.488 mm on three axes (0.846), and the row above."),
    ]
}

/// Somewhere in front of the wall, in view; and a way from there to a point of the wall that is seen.
fn ray_to(wall: &Wall, dice: &mut Dice, lift: f32) -> (Vec3, Vec3) {
    let pixel = |dice: &mut Dice| Vec2::new(dice.between(3.0, 44.0), dice.between(3.0, 32.0));
    let (a, b) = (pixel(dice), pixel(dice));
    let z = |p: Vec2| -wall.distance / wall.normal.dot(wall.ray(p));
    let start = wall.ray(a) * (z(a) * (1.0 - f64::from(lift)));
    let target = wall.ray(b) * z(b);
    (start.as_vec3(), (target - start).as_vec3())
}

/// Sine of the least angle between ray and surface at which the ray's pixel is the surface's.
const STEEP: f64 = 0.35;

fn rays() -> Vec<Row> {
    let mut dice = Dice::new(42);
    let (mut near, mut far, mut graze) = (Worst::new(), Worst::new(), Worst::new());
    for _ in 0..10_000 {
        let wall = Wall::random(&mut dice, &[120.0, 525.0, 10_000.0], 1.5);
        let lift = dice.log(1e-3, 0.95);
        let (start, way) = ray_to(&wall, &mut dice, lift);
        let Some(ray) = Ray::new(start, way) else { continue };
        let (o, d) = (start.as_dvec3(), ray.direction().as_dvec3());
        let slant = -wall.normal.dot(d);
        let want = (wall.distance + wall.normal.dot(o)) / slant;
        let params = RayParams { max_distance: 100.0, thickness: f32::INFINITY, ..RayParams::default() };
        let say = || format!("{} m at {:.2} m, {}", want, slant, wall.say());
        let Some(hit) = cast(&wall.frame(), None, &ray, &params).hit().copied() else {
            // A start nearer to the surface than a pixel's step may be behind the pixel's patch: no hit is right.
            if lift > 0.2 && slant > STEEP {
                near.see(f64::INFINITY, say);
            }
            continue;
        };
        if slant < STEEP || lift < 0.2 {
            // Off the surface by how much, in steps of depth from pixel to pixel?
            graze.f32(hit.distance);
            let p = o + d * f64::from(hit.distance);
            let step = p.z / f64::from(wall.k.fx()) * (wall.slant.to_radians().tan() + 1.0);
            graze.see((wall.normal.dot(p) + wall.distance) / step, say);
            continue;
        }
        let scale = (o.length() + want) / slant;
        near.f32(hit.distance);
        near.see((f64::from(hit.distance) - want) / scale / U, say);
        if wall.distance < 0.3 {
            continue;
        }

        // The same 10 km off: the ray's start is a world point, rounded, so the truth starts from it.
        let pose = Pose::new(dice.turn(), dice.vec3(FAR)).unwrap();
        let world = Ray::new(pose.to_world(start), pose.direction_to_world(way)).unwrap();
        let o = rotate_back_f64(pose.rotation(), world.origin().as_dvec3() - pose.translation().as_dvec3());
        let d = rotate_back_f64(pose.rotation(), world.direction().as_dvec3());
        let slant = -wall.normal.dot(d);
        let want = (wall.distance + wall.normal.dot(o)) / slant;
        if slant > STEEP
            && let Some(hit) = cast(&wall.frame().with_pose(pose), None, &world, &params).hit()
        {
            let scale = (o.length() + want) / slant;
            far.f32(hit.distance);
            far.see((f64::from(hit.distance) - want) / scale / U, say);
        }
    }
    vec![
        near.row("raycast::cast", "f 120 to 10,000 px", "half ulps of way / slant", 12.0, "the ray's ends are projected (3 half ulps of up to 160 px, a part of f) and 1/z at either end rounds by 2; the plane's inverse depths are off by 2 each and reach the crossing through slopes (1.5 pixels of 2); 1 / gap's slope is the 1 / slant of the unit."),
        graze.row("raycast::cast, grazing", "rays within 20° of the surface, or from near it", "steps of depth from pixel to pixel", 1.5, "the model, not rounding: each pixel is a patch of one depth; a grazing ray meets a patch's side, and where the plane through the neighbours is more than 1.5 pixels off that place, the hit stays there."),
        far.row("raycast::cast, 10 km", "the same, 10 km off", "half ulps of way / slant", 24.0, "the ray is brought to the camera first (two turns, 9.5 each as found above, over the distance) and then as near the origin."),
    ]
}

fn reflections() -> Vec<Row> {
    let mut dice = Dice::new(43);
    let (mut image, mut path, mut last) = (Worst::new(), Worst::new(), Worst::new());
    for _ in 0..3_000 {
        let (d, n) = (dice.turn() * Vec3::Z, dice.turn() * Vec3::Z);
        let got = mirror(d, n);
        image.vec3(got);
        let (e, m) = (d.as_dvec3(), n.as_dvec3());
        image.see((got.as_dvec3() - (e - m * (2.0 * m.dot(e)))).length() / U, || format!("{d} at {n}"));

        let wall = Wall::random(&mut dice, &[120.0, 525.0], 1.5);
        // Nearer, a millimetre of the start's rounding is many pixels.
        if wall.distance < 0.5 {
            continue;
        }
        let pose = Pose::new(dice.turn(), dice.vec3(FAR)).unwrap();
        let lift = dice.between(0.2, 0.95);
        let (start, way) = ray_to(&wall, &mut dice, lift);
        let Some(ray) = Ray::new(pose.to_world(start), pose.direction_to_world(way)) else { continue };
        if -wall.normal.dot(way.as_dvec3().normalize()) < STEEP {
            continue;
        }
        let mut bounces = [Bounce::EMPTY; 1];
        let params = ReflectParams {
            ray: RayParams { max_distance: 100.0, thickness: f32::INFINITY, ..RayParams::default() },
            normals: NormalParams::POINT,
            offset: 0.0,
        };
        let say = || wall.say();
        let found = reflect(&wall.frame().with_pose(pose), None, &ray, &params, &mut bounces);
        if found.bounces == 0 {
            path.see(f64::INFINITY, say);
            continue;
        }
        let n = rotate_f64(pose.rotation(), wall.normal);
        let e = ray.direction().as_dvec3();
        let want = e - n * (2.0 * n.dot(e));
        path.vec3(bounces[0].direction);
        let lever = 2.0 * f64::from(wall.k.fx()) * U;
        path.see(angle(bounces[0].direction.as_dvec3(), want) / (lever + 8.0 * U), say);
        let o = ray.origin().as_dvec3() - pose.translation().as_dvec3();
        let t = (wall.distance + n.dot(o)) / -n.dot(e);
        last.vec3(found.last.origin());
        last.see((found.last.origin().as_dvec3() - (ray.origin().as_dvec3() + e * t)).length() * 1e3, say);
    }
    vec![
        image.row("reflect::mirror", "any two unit vectors", "half ulps of 1", 8.0, "the dot product (3), doubled, over n (1 + 2 3) and one sum (1)."),
        path.row("reflect::reflect, direction, 10 km", "f 120 and 525 px", "half ulps of twice f", 1.0, "twice the normal's error, which the 11 x 11 fit leaves at 0.27 half ulps of f on either axis, and three turns (9.5 each, found above), small beside f."),
        last.row("reflect::reflect, place, 10 km", "the same", "mm", 0.86, "the bounce's world point is rounded once, at the end: legs are followed in the camera's frame."),
    ]
}

fn lengths() -> Vec<Row> {
    let mut dice = Dice::new(44);
    let (mut value, mut sigma) = (Worst::new(), Worst::new());
    for _ in 0..50_000 {
        let about = dice.vec3(FAR) * dice.pick(&[0.0, 1.0]);
        let size = dice.log(1e-3, 65.0);
        let mut point = || {
            let turn = dice.turn();
            MeasuredPoint { point: about + dice.vec3(size), ray: turn * Vec3::Z, sigma: dice.log(1e-4, 0.3) }
        };
        let (a, b) = (point(), point());
        let d = b.point.as_dvec3() - a.point.as_dvec3();
        if d.length() == 0.0 {
            continue;
        }
        let got = between(&a, &b);
        let say = || format!("{} and {}", a.point, b.point);
        value.f32(got.value);
        value.see((f64::from(got.value) / d.length() - 1.0) / U, say);
        let along = |p: &MeasuredPoint| d.normalize().dot(p.ray.as_dvec3()) * f64::from(p.sigma);
        sigma.f32(got.sigma);
        sigma.see((f64::from(got.sigma) - along(&a).hypot(along(&b))) / f64::from(a.sigma.hypot(b.sigma)) / U, say);
    }
    vec![
        value.row(
            "measure::between",
            "1 mm to 65 m apart, near and 10 km off",
            "half ulps",
            4.5,
            "each difference rounds once, its square by 2 + 1, the two sums once each: 5, which the root halves, and rounds once (1).",
        ),
        sigma.row(
            "measure::between, sigma",
            "the same",
            "half ulps of both sigmas",
            9.0,
            "both dot products of unit vectors are off by 3 and the direction by 2.5, the squares, the sum and the root by 2.5 more, for either point at most its own sigma.",
        ),
    ]
}

fn votes() -> Row {
    let mut dice = Dice::new(45);
    let mut worst = Worst::new();
    let k = Intrinsics::new(120.0, 120.0, 23.5, 17.5).unwrap();
    for _ in 0..100_000 {
        let z = dice.between(0.5, 8.0);
        let depth = vec![z; W * H];
        let pose = Pose::new(dice.turn(), dice.vec3(FAR)).unwrap();
        let frame = DepthFrame::new(ImageView::new(&depth, W, H).unwrap(), DepthUnit::METRE, k).with_pose(pose);
        let params = CollisionParams::default();
        // Around the border, in steps of a world's rounding.
        let ray = Vec3::new(dice.between(-0.18, 0.18), dice.between(-0.13, 0.13), 1.0);
        let border = f64::from(z) + f64::from(params.tolerance);
        let point = pose.to_world(ray * (border as f32 + dice.between(-3e-6, 3e-6)));
        let seen = rotate_back_f64(pose.rotation(), point.as_dvec3() - pose.translation().as_dvec3());
        let verdict = vote(&frame, [point], &params).verdict;
        worst.bits(u32::from(verdict == Verdict::Blocked));
        let wrong = (verdict == Verdict::Blocked) != (seen.z > border);
        // How far from the border a verdict may be wrong.
        worst.see(if wrong { (seen.z - border).abs() / border / U } else { 0.0 }, || format!("{point}, wall at {z} m"));
    }
    worst.row(
        "collision::vote, 10 km",
        "points at the border, walls at 0.5 to 8 m",
        "half ulps of depth from the border, where wrong",
        19.0,
        "`Pose::to_camera` (19) in one coordinate: a point within that of the border may fall on either side.",
    )
}

fn heights() -> Row {
    let mut dice = Dice::new(46);
    let mut worst = Worst::new();
    for _ in 0..300 {
        // A level floor, seen from 0.3 to 3 m above, 10 km off; the grid's centre anywhere near.
        let up = dice.turn() * Vec3::Z;
        let far = dice.vec3(FAR);
        let aside = up.any_orthonormal_vector();
        let Some(pose) = Pose::looking_at(far, far - up * 2.0 + aside, up) else { continue };
        let k = Intrinsics::new(40.0, 40.0, 23.5, 17.5).unwrap();
        let high = f64::from(dice.between(0.3, 3.0));
        let down = rotate_back_f64(pose.rotation(), -up.as_dvec3());
        let z = |i: usize| {
            let ray = DVec3::new(((i % W) as f64 - 23.5) / 40.0, ((i / W) as f64 - 17.5) / 40.0, 1.0);
            (high / down.dot(ray)) as f32
        };
        let depth: Vec<f32> = (0..W * H).map(z).map(|z| if z > 0.0 && z < 20.0 { z } else { 0.0 }).collect();
        let frame = DepthFrame::new(ImageView::new(&depth, W, H).unwrap(), DepthUnit::METRE, k).with_pose(pose);
        let centre = far + dice.vec3(2.0);
        let grid = Grid::new(centre, up, aside, 0.5, 64, 64).unwrap();
        let mut cells = vec![HeightCell::UNKNOWN; 64 * 64];
        let mut map =
            HeightMap::new(grid, &mut cells, HeightMapParams { reach: 9.0, ..HeightMapParams::DEFAULT }).unwrap();
        for _ in 0..3 {
            map.integrate(&frame);
        }
        let u = grid.up().as_dvec3();
        let want = (far.as_dvec3() - centre.as_dvec3()).dot(u) - high * up.as_dvec3().dot(u);
        for cell in map.cells().iter().filter(|c| c.is_known()) {
            for h in [cell.min, cell.max, cell.mean] {
                worst.f32(h);
                worst.see((f64::from(h) - want) * 1e6, || format!("{high} m above the floor, grid at {centre}"));
            }
        }
    }
    worst.row(
        "HeightMap::integrate, 10 km",
        "readings within 20 m, the grid 3 m from the camera",
        "µm",
        5.0,
        "the camera's place is taken relative to the grid's centre, exactly; its dot product with up (3 m) and each reading's (up to 20 m along a grazing ray, z times a sum of three, of 3 m height) are off by 4 and 6 half ulps of 3 m, the axes by 9.5 of 3 m at most.",
    )
}

fn pyramid() -> Row {
    let mut dice = Dice::new(47);
    let mut worst = Worst::new();
    // Every u16 once, and random ones.
    let every: Vec<u16> = (0..=u16::MAX).collect();
    let random: Vec<u16> = (0..161 * 119).map(|_| (dice.bits() >> 48) as u16).collect();
    for (data, w, h) in [(every, 256, 256), (random, 161, 119)] {
        let view = ImageView::new(&data, w, h).unwrap();
        let mut cells = vec![Cell::EMPTY; cells_needed(w, h)];
        let pyramid = Pyramid::build(view, &mut cells).unwrap();
        for level in 0..pyramid.levels() {
            let tile = Pyramid::<u16>::tile(level);
            let (across, down) = pyramid.level_size(level);
            for (x, y) in (0..down).flat_map(|y| (0..across).map(move |x| (x, y))) {
                let part = view.crop(x * tile, y * tile, tile, tile);
                let valid = || part.rows().flatten().copied().filter(|v| v.is_valid());
                let cell = pyramid.cell(level, x, y).unwrap();
                worst.bits(u32::from(cell.min) << 16 | u32::from(cell.max));
                let holes = part.rows().flatten().filter(|v| !v.is_valid()).count();
                let wrong = valid().min().is_some_and(|v| v != cell.min)
                    || valid().max().is_some_and(|v| v != cell.max)
                    || (holes > 0) != (cell.holes > 0);
                worst.see(f64::from(u8::from(wrong)), || format!("level {level}, tile ({x}, {y})"));
            }
        }
    }
    worst.row(
        "Pyramid::build",
        "every u16 value; random ones",
        "tiles that differ",
        0.0,
        "minima and maxima are exact.",
    )
}
