//! Square roots, the One-Euro filter and the cursor's smoothing, against f64.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use glam::{DVec3, Quat, Vec3};
use isobath::ground::math;
use isobath::ground::units::Timestamp;
use isobath::localized::one_euro::{OneEuro, OneEuroParams};
use isobath::localized::reticle::{Reticle, ReticleHit, ReticleParams, ReticleState};
use isobath::sensing::camera::Pose;

use crate::table::{Dice, Row, U, Worst, hold};

pub(crate) static ROWS: LazyLock<Vec<Row>> =
    LazyLock::new(|| [roots(), one_euro(), reticle()].into_iter().flatten().collect());

#[test]
fn filters_hold_their_bounds() {
    hold(&ROWS);
}

fn roots() -> Vec<Row> {
    let (mut exact, mut fast, mut root) = (Worst::new(), Worst::new(), Worst::new());
    // Every normal exponent, every region of the mantissa.
    for bits in (0x0080_0000_u32..0x7f80_0000).step_by(1009) {
        let x = f32::from_bits(bits);
        let want = f64::from(x).sqrt();
        let y = math::inv_sqrt(x);
        exact.f32(y);
        exact.see((f64::from(y) * want - 1.0) / U, || format!("{x:e}"));
        let y = math::inv_sqrt_fast(x);
        fast.f32(y);
        fast.see((f64::from(y) * want - 1.0) / U, || format!("{x:e}"));
        let y = math::sqrt(x);
        root.f32(y);
        root.see((f64::from(y) / want - 1.0) / U, || format!("{x:e}"));
    }
    vec![
        root.row("math::sqrt", "all normal exponents", "half ulps", 1.0, "correctly rounded."),
        exact.row(
            "math::inv_sqrt",
            "all normal exponents",
            "half ulps",
            4.0,
            "the last step adds a small correction to y: its sum rounds once (up to 2 half ulps of a mantissa of 1), and y y rounds once (1), which the correction carries over halved, with half of x y y's own.",
        ),
        fast.row(
            "math::inv_sqrt_fast",
            "all normal exponents",
            "half ulps",
            13.5,
            "two steps: the tuned first leaves 6.5e-4 (Moroz 2018), the second 3/2 of its square, 6.5e-7 or 11, and `inv_sqrt`'s rounding of about 2.",
        ),
    ]
}

/// The published filter in f64: value, rate.
struct Published {
    value: DVec3,
    rate: DVec3,
}

impl Published {
    fn step(&mut self, x: DVec3, te: f64, p: &OneEuroParams) {
        let alpha = |cutoff: f64| 1.0 / (1.0 + 1.0 / (TAU * cutoff * te));
        let dx = (x - self.value) / te;
        self.rate += alpha(f64::from(p.derivative_cutoff)) * (dx - self.rate);
        let cutoff = f64::from(p.min_cutoff) + f64::from(p.beta) * self.rate.length();
        self.value += alpha(cutoff) * (x - self.value);
    }
}

/// Runs a filter beside the published one at a rate, about a place; worst distance in metres.
fn follow(worst: &mut Worst, dice: &mut Dice, hertz: i64, about: Vec3, params: OneEuroParams) {
    let mut filter = OneEuro::<Vec3>::new(params).unwrap();
    let mut published = Published { value: DVec3::ZERO, rate: DVec3::ZERO };
    let mut goal = about;
    for i in 0..4000_i64 {
        // Held, stepped, and jittered.
        if i % 500 == 0 {
            goal = about + dice.vec3(0.1);
        }
        let x = if i % 1000 < 500 { goal } else { goal + dice.vec3(0.01) };
        let nanos = i * (1_000_000_000 / hertz);
        let got = filter.filter(x, Timestamp::from_nanos(nanos));
        worst.vec3(got);
        if i == 0 {
            published = Published { value: x.as_dvec3(), rate: DVec3::ZERO };
        } else {
            published.step(x.as_dvec3(), (1_000_000_000 / hertz) as f64 * 1e-9, &params);
        }
        worst.see((got.as_dvec3() - published.value).length(), || {
            format!("sample {i} at {hertz} Hz, beta {}, about ({}, {}, {})", params.beta, about.x, about.y, about.z)
        });
    }
}

fn one_euro() -> Vec<Row> {
    let mut dice = Dice::new(21);
    let (mut near, mut far, mut turn) = (Worst::new(), Worst::new(), Worst::new());
    for hertz in [30, 240, 1000, 10_000, 100_000] {
        for beta in [0.0, 2.0] {
            let params = OneEuroParams { beta, ..OneEuroParams::DEFAULT };
            follow(&mut near, &mut dice, hertz, Vec3::new(1.0, -0.5, 2.0), params);
            follow(&mut far, &mut dice, hertz, Vec3::new(9_000.0, -7_777.0, 8_888.0), params);
        }
        // A held orientation after a turn of 1 radian: the way back is a geometric series.
        let mut filter = OneEuro::<Quat>::new(OneEuroParams::DEFAULT).unwrap();
        let te = (1_000_000_000 / hertz) as f64 * 1e-9;
        let kept = 1.0 - 1.0 / (1.0 + 1.0 / (TAU * te));
        let goal = Quat::from_xyzw(0.0, 0.479_425_54, 0.0, 0.877_582_55);
        filter.filter(Quat::IDENTITY, Timestamp::ZERO);
        let mut left = 1.0;
        for i in 1..4000_i64 {
            let got = filter.filter(goal, Timestamp::from_nanos(i * (1_000_000_000 / hertz)));
            turn.quat(got);
            left *= kept;
            let d = got.as_dquat();
            let angle = 2.0 * d.y.atan2(d.w);
            turn.see(angle - (1.0 - left), || format!("sample {i} at {hertz} Hz"));
        }
    }
    vec![
        near.row(
            "OneEuro<Vec3>",
            "30 Hz to 100 kHz, beta 0 and 2, near the origin",
            "m",
            3.5e-7,
            "the value rounds by half an ulp of 2 m on an axis (1.2e-7; 1.4e-7 with the others), which is kept and not added up; the shares are off by 4 half ulps of ways of 0.2 m, of which a / (1 - (1 - a)) = 1 steps add up.",
        ),
        far.row(
            "OneEuro<Vec3>, 10 km",
            "the same, 10 km off",
            "m",
            8.5e-4,
            "the answer's own rounding on three axes, 0.488 mm each. Before, steps below it were lost: the filter stuck 8 cm from where it should be at 1 kHz, and at 10 kHz did not move over 10 cm at all.",
        ),
        turn.row(
            "OneEuro<Quat>",
            "30 Hz to 100 kHz, a turn of 1 rad",
            "rad",
            1.5e-5,
            "what rounding leaves out is not kept here: the filter rests when the share (6.2e-3 at 1 kHz) of the way is below the rounding of the product and the entries, 1.5 half ulps of 1 in an angle.",
        ),
    ]
}

fn reticle() -> Vec<Row> {
    let mut dice = Dice::new(22);
    let (mut place, mut turn) = (Worst::new(), Worst::new());
    for hertz in [30, 240, 1000, 10_000, 100_000] {
        for far in [0.0_f32, 9_000.0] {
            let params = ReticleParams { move_time: 0.1, ..ReticleParams::DEFAULT };
            let mut reticle = Reticle::new(params).unwrap();
            let from = Vec3::new(far + 1.0, 0.5 - far, 2.0);
            let to = from + dice.vec3(0.25);
            let normal = Vec3::new(0.6, 0.0, -0.8);
            let camera = Pose::IDENTITY;
            reticle.update(Some(ReticleHit { point: from, normal: Some(Vec3::NEG_Z) }), &camera, Timestamp::ZERO);
            for i in 1..4000_i64 {
                let nanos = i * (1_000_000_000 / hertz);
                let hit = ReticleHit { point: to, normal: Some(normal) };
                let ReticleState::Tracking(got) = reticle.update(Some(hit), &camera, Timestamp::from_nanos(nanos))
                else {
                    panic!("lost");
                };
                place.vec3(got.position);
                turn.quat(got.orientation);
                let t = nanos as f64 * 1e-9;
                let want = to.as_dvec3() + (from - to).as_dvec3() * (-t / f64::from(params.move_time)).exp();
                // In half ulps of the largest coordinate, so that near and far are one row.
                let size = if far > 0.0 { 16_384.0 } else { 2.0 };
                place.see((got.position.as_dvec3() - want).length() / size / U, || {
                    format!("sample {i} at {hertz} Hz, {far} m off")
                });
                // z turns from -z towards the normal in the x-z plane.
                let z = got.orientation.as_dquat() * DVec3::Z;
                let angle = z.x.atan2(-z.z);
                let full = f64::from(normal.x).atan2(f64::from(-normal.z));
                turn.see(angle - full * (1.0 - (-t / f64::from(params.turn_time)).exp()), || {
                    format!("sample {i} at {hertz} Hz")
                });
            }
        }
    }
    vec![
        place.row(
            "Reticle, position",
            "30 Hz to 100 kHz, near and 9 km off",
            "half ulps of the largest coordinate",
            1.8,
            "the answer's own rounding on three axes (sqrt 3 at most), since what a step loses is kept, and 1 - exp by `expm1`.",
        ),
        turn.row(
            "Reticle, orientation",
            "the same",
            "rad",
            1.1e-5,
            "as `OneEuro<Quat>`: 9e-8 over the share of a step, 8.6e-3 at 1 kHz.",
        ),
    ]
}
