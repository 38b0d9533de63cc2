//! Plane fits and normals on planes known in f64.

use std::sync::LazyLock;

use glam::{DVec3, Vec2, Vec3};
use isobath::ground::image::ImageView;
use isobath::localized::measure::{PatchParams, height_above, patch};
use isobath::localized::normals::adaptive::{self, AdaptiveParams, BlockSize};
use isobath::localized::normals::{NormalParams, normal_at};
use isobath::localized::plane::PlaneSum;
use isobath::localized::plane::ground::{GroundParams, estimate_ground};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::frame::DepthFrame;

use crate::poses::FAR;
use crate::table::{Dice, Row, U, Worst, hold, rotate_f64};

pub(crate) static ROWS: LazyLock<Vec<Row>> = LazyLock::new(|| {
    [plane_sums(), normals(), vec![adaptive_normals()], patches(), floors()].into_iter().flatten().collect()
});

#[test]
fn surfaces_hold_their_bounds() {
    hold(&ROWS);
}

pub(crate) const W: usize = 48;
pub(crate) const H: usize = 36;

/// A plane seen by a camera: depth rounded to `f32`, the plane in f64 (normal towards the camera, n · p = -distance).
#[derive(Debug)]
pub(crate) struct Wall {
    pub(crate) k: Intrinsics,
    pub(crate) depth: Vec<f32>,
    pub(crate) normal: DVec3,
    pub(crate) distance: f64,
    /// Angle between the normal and the middle ray, degrees.
    pub(crate) slant: f64,
}

impl Wall {
    pub(crate) fn ray(&self, pixel: Vec2) -> DVec3 {
        let k = &self.k;
        let [fx, fy, cx, cy] = [k.fx(), k.fy(), k.cx(), k.cy()].map(f64::from);
        DVec3::new((f64::from(pixel.x) - cx) / fx, (f64::from(pixel.y) - cy) / fy, 1.0)
    }

    pub(crate) fn frame(&self) -> DepthFrame<'_, f32> {
        DepthFrame::new(ImageView::new(&self.depth, W, H).unwrap(), DepthUnit::METRE, self.k)
    }

    pub(crate) fn say(&self) -> String {
        let k = &self.k;
        format!("f {} px, c ({}, {}), slant {:.2}°, {:.4} m", k.fx(), k.cx(), k.cy(), self.slant, self.distance)
    }

    /// A random one, seen whole within 1 mm to 65 m; slants even in the tangent's logarithm up to `steepest`.
    pub(crate) fn random(dice: &mut Dice, focal: &[f32], steepest: f32) -> Self {
        loop {
            let f = dice.pick(focal);
            let (cx, cy) = dice.pick(&[(23.5, 17.5), (-80.0, 17.0), (24.0, 333.3)]);
            let Ok(k) = Intrinsics::new(f, dice.pick(&[f, -f]), cx, cy) else { continue };
            let mut wall = Self { k, depth: vec![], normal: DVec3::ZERO, distance: 0.0, slant: 0.0 };
            let middle = wall.ray(Vec2::new(23.5, 17.5)).normalize();
            let aside = middle.cross(dice.vec3(1.0).as_dvec3()).normalize();
            let tangent = f64::from(dice.log(0.01, steepest));
            wall.normal = (aside * tangent - middle).normalize();
            wall.slant = tangent.atan().to_degrees();
            wall.distance = -wall.normal.dot(middle) * f64::from(dice.log(0.01, 30.0));
            let z = |i: usize| -wall.distance / wall.normal.dot(wall.ray(Vec2::new((i % W) as f32, (i / W) as f32)));
            let depth: Vec<f64> = (0..W * H).map(z).collect();
            if depth.iter().all(|z| (1e-3..=65.0).contains(z)) {
                wall.depth = depth.into_iter().map(|z| z as f32).collect();
                return wall;
            }
        }
    }
}

/// Angle between two directions, radians; exact for small ones.
pub(crate) fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

fn plane_sums() -> Vec<Row> {
    let mut dice = Dice::new(31);
    let (mut normal, mut place, mut rms) = (Worst::new(), Worst::new(), Worst::new());
    for _ in 0..4_000 {
        let size = dice.pick(&[1e-12_f32, 1e-3, 1.0, 1e3, 1e12]);
        let far = if size == 1.0 { dice.vec3(FAR) } else { Vec3::ZERO };
        let q = dice.turn();
        let thick = dice.log(1e-3, 0.1);
        let points: Vec<Vec3> = (0..60)
            .map(|_| {
                let p = Vec3::new(dice.between(-1.0, 1.0), dice.between(-0.5, 0.5), dice.between(-thick, thick));
                far + rotate_f64(q, p.as_dvec3()).as_vec3() * size
            })
            .collect();
        let mut sum = PlaneSum::new();
        for &p in &points {
            sum.add(p);
        }
        let side = rotate_f64(q, DVec3::Z);
        let say = || format!("size {size:e} m, thickness {thick:e}, at ({}, {}, {})", far.x, far.y, far.z);
        let Ok(fit) = sum.fit(side.as_vec3()) else {
            normal.see(f64::INFINITY, say);
            continue;
        };
        let centre = points.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / points.len() as f64;
        let mut c = [[0.0_f64; 3]; 3];
        for p in &points {
            let d = (p.as_dvec3() - centre).to_array();
            for (i, row) in c.iter_mut().enumerate() {
                for (j, cell) in row.iter_mut().enumerate() {
                    *cell += d[i] * d[j] / points.len() as f64;
                }
            }
        }
        // Inverse iteration: the adjugate's columns are cross products of the rows.
        let [x, y, z] = c.map(DVec3::from);
        let adjugate = [y.cross(z), z.cross(x), x.cross(y)];
        let mut n = side;
        for _ in 0..60 {
            n = (adjugate[0] * n.x + adjugate[1] * n.y + adjugate[2] * n.z).normalize();
        }
        let n = if n.dot(side) < 0.0 { -n } else { n };
        normal.vec3(fit.plane.normal());
        normal.see((fit.plane.normal().as_dvec3() - n).length() / U, say);
        // Where the plane is, at the centre of the points: through `distance` of a point 1 size beside it.
        let probe = (centre + side * f64::from(size)).as_vec3();
        let got = fit.plane.distance(probe);
        place.f32(got);
        let want = n.dot(probe.as_dvec3() - centre);
        place.see((f64::from(got) - want) / (probe.as_dvec3() - centre).length() / U, say);
        let squares: f64 = points.iter().map(|p| n.dot(p.as_dvec3() - centre).powi(2)).sum();
        rms.f32(fit.rms);
        rms.see((f64::from(fit.rms) / (squares / (points.len() as f64 - 3.0)).sqrt() - 1.0) / U, say);
    }
    vec![
        normal.row(
            "PlaneSum::fit, normal",
            "60 points, 1e-12 to 1e12 m wide, and 1 m wide 10 km off",
            "half ulps of 1",
            4.5,
            "sums and eigenvectors in f64; the vector is rounded to `f32` (1) and made unit length (scale, length, quotient: 3.5, mostly along itself).",
        ),
        place.row(
            "PlaneSum::fit, plane's place",
            "the same",
            "half ulps of the points' size",
            7.0,
            "`Plane::distance` (4) with the normal above over a lever of the points' size (2 across); the centre is kept in double precision as `anchor` and `rest`.",
        ),
        rms.row(
            "PlaneSum::fit, rms",
            "thickness 0.1 % to 10 % of the width",
            "half ulps",
            1.01,
            "rounded once; the f64 sums lose 1e-16 width² / thickness² = 1e-10.",
        ),
    ]
}

fn normals() -> Vec<Row> {
    let mut dice = Dice::new(32);
    let (mut cross, mut long, mut wide) = (Worst::new(), Worst::new(), Worst::new());
    for _ in 0..3_000 {
        let wall = Wall::random(&mut dice, &[10.0, 120.0, 525.0, 10_000.0], 50.0);
        let frame = wall.frame();
        for _ in 0..8 {
            let (x, y) = ((dice.bits() % W as u64) as usize, (dice.bits() % H as u64) as usize);
            let pixel = Vec2::new(x as f32, y as f32);
            let cos = -wall.normal.dot(wall.ray(pixel));
            let (dx, dy) = (f64::from(pixel.x - wall.k.cx()).abs(), f64::from(pixel.y - wall.k.cy()).abs());
            // What a change of 1 half ulp per pixel in the slopes of inverse depth turns the normal by.
            let lever = (f64::from(wall.k.fx()) + dx + dy) * U * cos;
            let say = || format!("({x}, {y}), {}", wall.say());
            let got = normal_at(&frame, x, y, &NormalParams::default()).map_or(Vec3::NAN, |e| e.normal);
            cross.vec3(got);
            let error = angle(got.as_dvec3(), wall.normal);
            cross.see(error / (lever + U), say);
            if wall.k.fx() > 9_000.0 {
                long.f32(got.z);
                long.see(error.to_degrees(), say);
            }
            let got = normal_at(&frame, x, y, &NormalParams::POINT).map_or(Vec3::NAN, |e| e.normal);
            wide.vec3(got);
            wide.see(angle(got.as_dvec3(), wall.normal) / (lever + U), say);
        }
    }
    let over = "f 10 to 10,000 px, 1 mm to 65 m, slants to 88.9°";
    vec![
        cross.row(
            "normal_at, exact",
            over,
            "half ulps of inverse depth per pixel",
            16.0,
            "each inverse depth is off by 2 (the depth's own rounding and the division); a one-sided slope (-3 c + 4 r1 - r2) / 2 carries 8 of them, 16 half ulps; its own differences are exact or nearly so. Both slopes together act on the normal with (fx, fy, dx, dy), of which the lever takes the sum.",
        ),
        long.row(
            "normal_at, exact, f = 10,000 px",
            "the same, 10,000 px alone",
            "degrees",
            0.56,
            "the same 16 half ulps times f: 9.7e-3 rad. At this focal length neighbouring depths differ in the fifth digit, and a depth in `f32` has seven: a wider window is the cure.",
        ),
        wide.row(
            "normal_at, 11 x 11 fit",
            over,
            "half ulps of inverse depth per pixel",
            3.0,
            "depth's own rounding, of one sign left and the other right: sum |d| / sum d² is 0.27 on either axis for 11 x 11 pixels and 1 for 3 x 3, which is what the image's corners and the rule against steps beyond 80° leave; as much again from the value at the centre.",
        ),
    ]
}

fn adaptive_normals() -> Row {
    let mut dice = Dice::new(33);
    let mut worst = Worst::new();
    let mut scratch = vec![0.0; adaptive::scratch_len(W)];
    for _ in 0..400 {
        let wall = Wall::random(&mut dice, &[120.0, 525.0, 10_000.0], 10.0);
        let noise = DepthNoise { constant: 0.0, linear: 1e-5, quadratic: 0.0 };
        let params = AdaptiveParams { noise, block: BlockSize::Eight };
        adaptive::rows(&wall.frame(), &params, &mut scratch, |y, row| {
            for x in 0..W {
                let got = Vec3::new(row.x[x], row.y[x], row.z[x]);
                worst.vec3(got);
                let cos = -wall.normal.dot(wall.ray(Vec2::new(x as f32, y as f32)));
                let aside = (x as f64 - f64::from(wall.k.cx())).abs() + (y as f64 - f64::from(wall.k.cy())).abs();
                let lever = (f64::from(wall.k.fx()) + aside) * U * cos;
                worst.see(angle(got.as_dvec3(), wall.normal) / (lever + U), || format!("({x}, {y}), {}", wall.say()));
            }
        })
        .unwrap();
    }
    worst.row(
        "adaptive::rows, 8 x 8 blocks",
        "f 120 to 10,000 px, slants to 84°",
        "half ulps of inverse depth per pixel",
        6.0,
        "each inverse depth is off by 2; over one block of 8 x 8 that is 2 x 0.38 in either slope and falls with the window; the rest are the blocks' `f32` sums of 64 values.",
    )
}

fn patches() -> Vec<Row> {
    let mut dice = Dice::new(34);
    let (mut normal, mut height, mut sigma) = (Worst::new(), Worst::new(), Worst::new());
    for _ in 0..2_000 {
        let wall = Wall::random(&mut dice, &[120.0, 525.0], 5.0);
        let pose = Pose::new(dice.turn(), dice.vec3(FAR)).unwrap();
        let frame = wall.frame().with_pose(pose);
        let Ok(found) = patch(&frame, 24, 18, &DepthNoise::KINECT, &PatchParams { radius: 12, max_jump: 0.9 }) else {
            normal.see(f64::INFINITY, || wall.say());
            continue;
        };
        let say = || wall.say();
        let n = rotate_f64(pose.rotation(), wall.normal);
        let plane = found.fit.plane;
        normal.vec3(plane.normal());
        // The patch is 24 pixels wide: its depth's rounding over its width.
        let width = 24.0 / f64::from(wall.k.fx()) / wall.slant.to_radians().cos().abs();
        normal.see(angle(plane.normal().as_dvec3(), n) * width / U, say);
        // A point 1 m or less over the patch, in the world.
        let p = rotate_f64(pose.rotation(), wall.ray(Vec2::new(24.0, 18.0)) * f64::from(wall.depth[18 * W + 24]) * 0.5);
        let world = (p + pose.translation().as_dvec3()).as_vec3();
        let point = isobath::localized::measure::MeasuredPoint { point: world, ray: plane.normal(), sigma: 0.01 };
        let got = height_above(&point, &found.fit);
        height.f32(got.value);
        let want = n.dot(world.as_dvec3() - pose.translation().as_dvec3()) + wall.distance;
        height.see((f64::from(got.value) - want) / wall.distance * 1e6, say);
        sigma.f32(got.sigma);
        let d = world.as_dvec3() - found.fit.centroid.as_dvec3();
        let offset = f64::from(found.fit.offset_sigma);
        let mut var = offset * offset + (n.length_squared() * 0.01 * 0.01);
        for (axis, spread) in found.fit.axes.iter().zip(found.fit.spread) {
            var += (d.dot(axis.as_dvec3()) * offset / f64::from(spread)).powi(2);
        }
        sigma.see((f64::from(got.sigma) / var.sqrt() - 1.0) / U, say);
    }
    vec![
        normal.row(
            "measure::patch, 10 km",
            "25 x 25 pixels, slants to 79°",
            "half ulps over the patch's width",
            7.0,
            "fitted in the camera's frame, so depth's own rounding (1, over a width whose ends weigh 3 times the mean) and the points' 3 in x and y, at a slant; and the turn to the world. Fitted in the world it was a millimetre over the patch's width.",
        ),
        height.row("measure::height_above, 10 km", "half way to the patch", "1e-6 of the distance", 3.0, "the normal above, over the patch's and the point's distance aside (5 times the height at 79°): 7 half ulps of 5, and depth's own rounding."),
        sigma.row("height_above, sigma", "the same", "half ulps", 28.0, "the turned normal's length (9.5, found above) enters as normal · ray twice, with `MeasuredPoint::ray` along it here; squares, sum and root add 8."),
    ]
}

fn floors() -> Vec<Row> {
    let mut dice = Dice::new(35);
    let (mut tilt, mut height) = (Worst::new(), Worst::new());
    for _ in 0..100 {
        let (up, far) = (dice.turn() * Vec3::Z, dice.vec3(FAR));
        let Some(pose) = Pose::looking_at(far, far - up + up.any_orthonormal_vector(), up) else { continue };
        let k = Intrinsics::new(40.0, 40.0, 23.5, 17.5).unwrap();
        let high = f64::from(dice.between(0.8, 2.0));
        // What the floor's normal is in the camera's frame, to the last digit of f64.
        let down = crate::table::rotate_back_f64(pose.rotation(), -up.as_dvec3()).normalize();
        let z =
            |i: usize| high / down.dot(DVec3::new(((i % W) as f64 - 23.5) / 40.0, ((i / W) as f64 - 17.5) / 40.0, 1.0));
        let depth: Vec<f32> = (0..W * H).map(z).map(|z| if z > 0.0 && z < 8.0 { z as f32 } else { 0.0 }).collect();
        let frame = DepthFrame::new(ImageView::new(&depth, W, H).unwrap(), DepthUnit::METRE, k).with_pose(pose);
        let say = || format!("{high:.3} m above a floor, up ({}, {}, {})", up.x, up.y, up.z);
        let Ok(found) = estimate_ground(&frame, up, &GroundParams::default()) else {
            tilt.see(f64::INFINITY, say);
            continue;
        };
        let plane = found.fit.plane;
        tilt.vec3(plane.normal());
        tilt.see(angle(plane.normal().as_dvec3(), up.as_dvec3()) / U, say);
        let got = plane.distance(far);
        height.f32(got);
        height.see((f64::from(got) - high) * 1e6, say);
    }
    vec![
        tilt.row(
            "estimate_ground, normal, 10 km",
            "floors 0.8 to 2 m below the camera",
            "half ulps of 1",
            14.0,
            "fitted in the camera's frame over metres, where points are off by 3 half ulps and their mean by much less; then one turn (9.5, found above, across and along together) and the fit's own 4.5. Fitted in the world, points were off by half a millimetre.",
        ),
        height.row(
            "estimate_ground, height, 10 km",
            "the same",
            "µm",
            3.5,
            "the tilt above over the centre's distance aside, up to 3 m, and the turn of the anchor over 4 m.",
        ),
    ]
}
