//! Pinholes, lenses and depth values against the formulas in f64.

use std::sync::LazyLock;

use glam::{DVec2, DVec3, Vec2, Vec3};
use isobath::sensing::camera::{Distortion, Intrinsics};
use isobath::sensing::depth::decode::{Disparity, Projective};
use isobath::sensing::depth::{DepthSample, DepthUnit};

use crate::table::{Dice, Row, U, Worst, hold};

pub(crate) static ROWS: LazyLock<Vec<Row>> =
    LazyLock::new(|| [pinholes(), vec![distort(), undistort()], depths()].into_iter().flatten().collect());

#[test]
fn cameras_hold_their_bounds() {
    hold(&ROWS);
}

const FOCAL: [f32; 6] = [10.0, 120.3, 525.0, -481.2, 1216.5, 10_000.0];
/// In the image, on its edge, far outside.
const CENTRES: [f32; 6] = [319.5, 0.0, 1023.7, -812.3, 5000.1, -40_000.7];
const CAMERAS: &str = "f 10 to 10,000 px, centre -40,000 to 5,000 px";

/// Largest relative error of the components; 0 for 0.
fn relative(got: Vec3, want: DVec3) -> f64 {
    let one = |g: f32, w: f64| if w == f64::from(g) { 0.0 } else { (f64::from(g) - w) / w };
    one(got.x, want.x).abs().max(one(got.y, want.y).abs()).max(one(got.z, want.z).abs())
}

fn pinholes() -> Vec<Row> {
    let mut dice = Dice::new(1);
    let (mut unproject, mut project, mut round, mut range, mut back) =
        (Worst::new(), Worst::new(), Worst::new(), Worst::new(), Worst::new());
    let (mut huge, mut tiny) = (Worst::new(), Worst::new());
    for _ in 0..200_000 {
        let (fx, fy) = (dice.pick(&FOCAL), dice.pick(&FOCAL));
        let (cx, cy) = (dice.pick(&CENTRES), dice.pick(&CENTRES));
        let k = Intrinsics::new(fx, fy, cx, cy).unwrap();
        let pixel = Vec2::new(dice.between(-0.5, 4095.5), dice.between(-0.5, 4095.5));
        let z = dice.log(1e-3, 65.0);
        let say = || format!("pixel ({}, {}), z {z}, f ({fx}, {fy}), c ({cx}, {cy})", pixel.x, pixel.y);
        let (f, c) = (DVec2::new(f64::from(fx), f64::from(fy)), DVec2::new(f64::from(cx), f64::from(cy)));
        let want = ((pixel.as_dvec2() - c) / f * f64::from(z)).extend(f64::from(z));
        let point = k.unproject(pixel, z);
        unproject.vec3(point);
        unproject.see(relative(point, want) / U, say);

        // The point as it is, projected.
        let p = point.as_dvec3();
        let want = DVec2::new(f.x * p.x / p.z + c.x, f.y * p.y / p.z + c.y);
        let got = k.project(point).unwrap();
        project.vec2(got);
        let scale = (want - c).abs().max(want.abs());
        project.see(((got.as_dvec2() - want) / scale).abs().max_element() / U, say);
        round.vec2(got);
        round.see(((got.as_dvec2() - pixel.as_dvec2()) / scale).abs().max_element() / U, say);

        let length = ((pixel.as_dvec2() - c) / f).extend(1.0).length();
        let got = k.range_from_z(pixel, z);
        range.f32(got);
        range.see((f64::from(got) / (f64::from(z) * length) - 1.0) / U, say);
        let got = k.z_from_range(pixel, z);
        back.f32(got);
        back.see((f64::from(got) * length / f64::from(z) - 1.0) / U, say);

        // Scenes of 1e35 m, and of denormals.
        let p = dice.vec3(1.0) * 1e36 + Vec3::Z * 2e36;
        let got = k.project(p);
        let want = DVec2::new(f.x * f64::from(p.x) / f64::from(p.z) + c.x, f.y * f64::from(p.y) / f64::from(p.z) + c.y);
        let scale = (want - c).abs().max(want.abs());
        let got = got.unwrap_or(Vec2::NAN);
        huge.vec2(got);
        huge.see(((got.as_dvec2() - want) / scale).abs().max_element() / U, || format!("({}, {}, {})", p.x, p.y, p.z));
        let p = Vec3::new(dice.between(-9e-39, 9e-39), dice.between(-9e-39, 9e-39), dice.log(1e-39, 1e-38));
        let want = DVec2::new(f.x * f64::from(p.x) / f64::from(p.z) + c.x, f.y * f64::from(p.y) / f64::from(p.z) + c.y);
        let scale = (want - c).abs().max(want.abs());
        let got = k.project(p).unwrap_or(Vec2::NAN);
        tiny.vec2(got);
        tiny.see(((got.as_dvec2() - want) / scale).abs().max_element() / U, || {
            format!("({:e}, {:e}, {:e})", p.x, p.y, p.z)
        });
    }
    let over = CAMERAS;
    vec![
        unproject.row(
            "Intrinsics::unproject",
            over,
            "half ulps",
            3.001,
            "a difference, a product, a quotient: one rounding each, of every component.",
        ),
        project.row(
            "Intrinsics::project",
            over,
            "half ulps of max(|u|, |u - cx|)",
            3.001,
            "a quotient, a product, a sum.",
        ),
        round.row(
            "project after unproject",
            over,
            "half ulps of max(|u|, |u - cx|)",
            6.001,
            "three roundings there and three back, the difference u - cx among them.",
        ),
        range.row(
            "Intrinsics::range_from_z",
            over,
            "half ulps",
            5.501,
            "the ray's components are off by 2, their squares by 5, the two sums add 1 each, the root halves that (3.5) and rounds (1), the product rounds (1).",
        ),
        back.row("Intrinsics::z_from_range", over, "half ulps", 5.501, "as `range_from_z`, a quotient for the product."),
        huge.row(
            "project, far",
            "points 1e36 m away",
            "half ulps of max(|u|, |u - cx|)",
            3.001,
            "as near by; before x / z came first, f x overflowed and the point was not seen.",
        ),
        tiny.row(
            "project, denormal",
            "points 1e-39 m away",
            "half ulps of max(|u|, |u - cx|)",
            3.001,
            "as near by: denormal numbers are exact, and their quotient is of ordinary size.",
        ),
    ]
}

/// Kinect v1 colour, a wide rational lens of Azure Kinect's shape, a mild barrel.
const LENSES: [[f32; 8]; 3] = [
    [0.2624, -0.9531, -0.0054, 0.0026, 1.1633, 0.0, 0.0, 0.0],
    [2.5, 1.4, 0.0003, -0.0002, 0.08, 2.83, 2.1, 0.38],
    [-0.28, 0.07, 0.0002, 0.000_02, 0.0, 0.0, 0.0, 0.0],
];

fn lens_f64(k: [f32; 8], n: DVec2) -> DVec2 {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = k.map(f64::from);
    let (x, y) = (n.x, n.y);
    let r2 = x * x + y * y;
    let s = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
    DVec2::new(x * s + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * s + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y)
}

/// Newton in f64, from the f32 answer.
fn unlens_f64(k: [f32; 8], d: DVec2, near: DVec2) -> DVec2 {
    let mut n = near;
    for _ in 0..8 {
        const H: f64 = 1e-6;
        let r = lens_f64(k, n) - d;
        let dx = (lens_f64(k, n + DVec2::X * H) - lens_f64(k, n - DVec2::X * H)) / (2.0 * H);
        let dy = (lens_f64(k, n + DVec2::Y * H) - lens_f64(k, n - DVec2::Y * H)) / (2.0 * H);
        let det = dx.x * dy.y - dy.x * dx.y;
        n -= DVec2::new(dy.y * r.x - dy.x * r.y, dx.x * r.y - dx.y * r.x) / det;
    }
    n
}

fn lens_points() -> impl Iterator<Item = ([f32; 8], Vec2)> {
    let mut dice = Dice::new(2);
    (0..100_000).map(move |_| (dice.pick(&LENSES), Vec2::new(dice.between(-0.62, 0.62), dice.between(-0.47, 0.47))))
}

fn distort() -> Row {
    let mut worst = Worst::new();
    for (k, n) in lens_points() {
        let got = Distortion::Brown8(k).distort(n);
        worst.vec2(got);
        worst.see((got.as_dvec2() - lens_f64(k, n.as_dvec2())).length() / U, || {
            format!("({}, {}), k1 {}", n.x, n.y, k[0])
        });
    }
    worst.row(
        "Distortion::distort",
        "three lenses to 0.78",
        "2^-24 of the focal length",
        3.0,
        "s = top / bottom: each polynomial's terms sum to under 2.6 (the Kinect's, at r² = 0.6) and lose 1 of the last sum and under 1 before, the quotient 1; times |n| <= 0.78 and two more sums: 0.78 (1 + 1 + 1 + 1) at most on either side of s = 1.",
    )
}

fn undistort() -> Row {
    let mut worst = Worst::new();
    for (k, n) in lens_points() {
        let d = Distortion::Brown8(k).distort(n);
        let Some(got) = Distortion::Brown8(k).undistort(d) else {
            worst.see(f64::INFINITY, || format!("({}, {}), k1 {}", n.x, n.y, k[0]));
            continue;
        };
        worst.vec2(got);
        worst.see((got.as_dvec2() - unlens_f64(k, d.as_dvec2(), n.as_dvec2())).length() / U, || {
            format!("({}, {}), k1 {}", n.x, n.y, k[0])
        });
    }
    worst.row(
        "Distortion::undistort",
        "three lenses to 0.78",
        "2^-24 of the focal length",
        8.0,
        "the last Newton step sees a residual that is off by `distort`'s 3, which the inverse Jacobian (up to 2 here, where the barrel flattens) carries over, and rounds once.",
    )
}

fn depths() -> Vec<Row> {
    let mut dice = Dice::new(3);
    let (mut metres, mut steps) = (Worst::new(), Worst::new());
    for per_unit in [0.001_f32, 0.0002, 0.00025, 0.000_1, 0.01, 1.0, 1e-6, 30.48] {
        let unit = DepthUnit::new(per_unit).unwrap();
        for v in 0..=u16::MAX {
            let z = v.metres(unit);
            metres.f32(z);
            let want = if v == 0 || v == u16::MAX { 0.0 } else { f64::from(v) * f64::from(per_unit) };
            let error = if want == 0.0 { f64::from(z) } else { f64::from(z) / want - 1.0 };
            metres.see(error / U, || format!("{v} of {per_unit} m"));
            let back = u16::from_metres(z, unit);
            let want = if v == u16::MAX { 0 } else { v };
            steps.bits(u32::from(back));
            steps.see(f64::from(back) - f64::from(want), || format!("{v} of {per_unit} m"));
        }
    }
    let (mut disparity, mut projective) = (Worst::new(), Worst::new());
    for _ in 0..200_000 {
        let c = Disparity {
            focal: dice.log(10.0, 10_000.0),
            baseline: dice.log(0.01, 1.0),
            offset: dice.between(-64.0, 64.0),
            scale: dice.pick(&[1.0, 0.125, 0.0625, 0.1]),
        };
        let raw = dice.between(1.0, 4000.0);
        let d = f64::from(raw) * f64::from(c.scale) + f64::from(c.offset);
        if d < f64::from(c.scale) {
            continue;
        }
        let z = c.z(raw);
        disparity.f32(z);
        // In steps of the sensor: how far would the disparity have to move to give this depth?
        let seen = f64::from(c.focal) * f64::from(c.baseline) / f64::from(z);
        disparity.see((seen - d) / (d.max(f64::from(raw) * f64::from(c.scale)) * U), || {
            format!("{raw} x {} + {}", c.scale, c.offset)
        });
        let p = Projective { near: dice.log(0.01, 1.0), far: dice.log(2.0, 1e6) };
        let b = dice.unit();
        let (n, f) = (f64::from(p.near), f64::from(p.far));
        let shift = f64::from(b) * (1.0 - n / f);
        let z = p.z(b);
        projective.f32(z);
        // As a buffer value: the buffer's own step near 1 is 2^-24.
        projective.see((n / f64::from(z) - (1.0 - shift)) / U, || format!("{b}, {} to {} m", p.near, p.far));
    }
    vec![
        metres.row(
            "u16::metres",
            "every u16, eight units",
            "half ulps",
            1.0,
            "one product; 0 and 65535 are holes in every unit.",
        ),
        steps.row("u16::from_metres after metres", "every u16, eight units", "steps", 0.0, "exact: every value comes back."),
        disparity.row(
            "Disparity::z",
            "f 10 to 10,000 px, offsets ±64",
            "half ulps of the raw disparity, in disparity",
            4.0,
            "product, sum, product, quotient: where the offset cancels the raw disparity the first rounding stays, 2^-24 of the raw value, a 250th of a step of any `u16` sensor.",
        ),
        projective.row(
            "Projective::z",
            "near 1 cm to 1 m, far to 1,000 km",
            "2^-24 of the buffer's span",
            4.0,
            "1 - d (1 - n / f): n / f, the difference, the product and the outer difference round once each below 1; the quotient is relative. The buffer itself is no finer.",
        ),
    ]
}
