//! What the filter promises of any motion, of rest, of clocks, and of input that is none.

use glam::{Quat, Vec3};
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

use super::*;

const HERTZ: i64 = 200;

fn at(i: i64) -> Timestamp {
    Timestamp::from_nanos(i * 1_000_000_000 / HERTZ)
}

fn filter() -> Vqf {
    Vqf::new(VqfParams::DEFAULT).unwrap()
}

fn rotation() -> impl Strategy<Value = Quat> {
    proptest::array::uniform4(-1.0_f32..1.0)
        .prop_filter("has a length", |q| Quat::from_array(*q).length() > 0.1)
        .prop_map(|q| Quat::from_array(q).normalize())
}

fn vector(size: f32) -> impl Strategy<Value = Vec3> {
    proptest::array::uniform3(-size..size).prop_map(Vec3::from)
}

/// A number of the kind that breaks things.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        Just(f32::NAN),
        Just(f32::INFINITY),
        Just(0.0),
        Just(999.9),
        Just(-1000.0),
        Just(1e-40),
        Just(9.8),
        Just(-9999.0),
        any::<f32>(),
        -20.0_f32..20.0,
        -1.0_f32..1.0,
    ]
}

fn held(f: &Vqf) -> bool {
    let unit = |q: Quat| q.is_finite() && (q.length() - 1.0).abs() < 1e-4;
    unit(f.orientation())
        && f.orientation_north().is_none_or(unit)
        && f.gravity().is_none_or(|g| (g.up.length() - 1.0).abs() < 2e-4 && g.sigma.is_finite() && g.sigma > 0.0)
        && f.bias().is_finite()
        && f.bias().abs().max_element() <= f.params.rest.max_bias
        && f.bias_sigma().is_finite()
}

proptest! {
    /// Turning evenly about any axis from any orientation, with gravity as it would be felt: both are tracked.
    #[test]
    fn an_even_turn_is_tracked(start in rotation(), rate in vector(6.0)) {
        let mut f = filter();
        let mut turned = Vec::new();
        // The true orientation in f64: start, then turned in its own frame.
        let (speed, axis) = (f64::from(rate.length()), rate.normalize_or(Vec3::X));
        for i in 0..10 * HERTZ {
            let angle = speed * i as f64 / HERTZ as f64;
            let true_turn = Quat::from_axis_angle(axis, (angle % (4.0 * core::f64::consts::PI)) as f32);
            let truth = start * true_turn;
            f.update(&ImuSample { time: at(i), rate, force: truth.inverse() * (Vec3::Z * STANDARD_GRAVITY), field: None });
            turned.push((f.orientation(), truth));
        }
        let (first, first_truth) = turned[0];
        // The heading is free: the difference to the truth is one turn about z that stays.
        let heading = first * first_truth.inverse();
        prop_assert!(heading.x.hypot(heading.y) < 1e-3);
        for (q, truth) in &turned {
            let off = q.dot(heading * *truth).abs().min(1.0);
            prop_assert!(2.0 * off.acos() < 4e-3, "{} rad", 2.0 * off.acos());
        }
        let g = f.gravity().unwrap();
        prop_assert!(g.up.angle_between(turned[turned.len() - 1].1.inverse() * Vec3::Z) < 2e-3);
        prop_assert!(f.bias().length() < 1e-3);
    }

    /// At rest with a bias: it is found.
    #[test]
    fn at_rest_the_bias_is_found(start in rotation(), bias in vector(0.03), seed in any::<u32>()) {
        let (mut f, mut alone) = (filter(), crate::sensing::imu::rest::RestBias::new(RestParams::DEFAULT).unwrap());
        let up = start.inverse() * Vec3::Z;
        let mut s = seed;
        let mut noise = || {
            Vec3::from([(); 3].map(|()| {
                s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (s >> 8) as f32 / (1 << 23) as f32 - 1.0
            }))
        };
        for i in 0..15 * HERTZ {
            let (rate, force) = (bias + noise() * 0.005, up * STANDARD_GRAVITY + noise() * 0.05);
            let sample = ImuSample { time: at(i), rate, force, field: None };
            f.update(&sample);
            alone.update(&sample);
        }
        prop_assert!(f.is_at_rest() && alone.is_at_rest());
        prop_assert!((f.bias() - bias).length() < 4e-4, "{} {}", f.bias(), bias);
        prop_assert!((alone.bias() - bias).length() < 4e-4, "{} {}", alone.bias(), bias);
        prop_assert!(f.gravity().unwrap().up.angle_between(up) < 3e-3);
        prop_assert!(f.bias_sigma() < 1e-3 && alone.sigma() < 1e-3);
    }

    /// Whatever comes: no panic, and what is held stays a rotation, a direction and a bounded bias.
    #[test]
    fn hostile_readings_leave_the_state_sound(
        readings in proptest::collection::vec(
            (
                proptest::array::uniform3(number()), proptest::array::uniform3(number()), proptest::array::uniform3(number()),
                prop_oneof![3 => 0_i64..50_000_000, 1 => Just(0), 1 => any::<i64>(), 1 => Just(1)], any::<bool>(),
            ),
            0..120,
        ),
        time in number(), gap in number(), start in number(),
    ) {
        let wild = VqfParams { time, max_gap: gap, bias_start: start, ..VqfParams::DEFAULT };
        for params in [VqfParams::DEFAULT, wild] {
            let Ok(mut f) = Vqf::new(params) else { continue };
            let mut now = 0_i64;
            for &(rate, force, field, ahead, some) in &readings {
                now = now.wrapping_add(ahead);
                let before = f;
                let sample = ImuSample {
                    time: Timestamp::from_nanos(now), rate: rate.into(), force: force.into(), field: some.then(|| field.into()),
                };
                let step = f.update(&sample);
                prop_assert!(step.is_used() || f == before || step == Step::Repeated);
                prop_assert!(held(&f), "{:?} after {:?}", f, sample);
                prop_assert!(f.orientation_at(Timestamp::from_nanos(now.wrapping_mul(3))).is_none_or(|q| (q.length() - 1.0).abs() < 1e-3));
            }
        }
    }

    /// Stamps tell the period: readings that come unevenly give what even ones do.
    #[test]
    fn jitter_and_lost_readings_are_integrated_rightly(
        ahead in proptest::collection::vec(1_i64..30, 300..600), rate in vector(3.0),
    ) {
        let mut f = filter();
        let mut now = 0_i64;
        let speed = f64::from(rate.length());
        let axis = rate.normalize_or(Vec3::X);
        let mut truth = Quat::IDENTITY;
        for ms in ahead {
            let angle = speed * now as f64 * 1e-3;
            truth = Quat::from_axis_angle(axis, (angle % (4.0 * core::f64::consts::PI)) as f32);
            let time = Timestamp::from_nanos(now * 1_000_000);
            f.update(&ImuSample { time, rate, force: truth.inverse() * (Vec3::Z * STANDARD_GRAVITY), field: None });
            now += ms;
        }
        prop_assert!(2.0 * f.orientation().dot(truth).abs().min(1.0).acos() < 4e-3);
    }
}

#[test]
fn the_field_gives_north_and_a_magnet_does_not_tilt() {
    let mut f = filter();
    // North is where the sensor's x points; it dips by 60 degrees.
    let field = Vec3::new(25.0, 0.0, -43.3);
    let (mut i, force) = (0, Vec3::Z * STANDARD_GRAVITY);
    let mut feed = |f: &mut Vqf, seconds: i64, field: Vec3, rate: Vec3| {
        for _ in 0..seconds * HERTZ {
            f.update(&ImuSample { time: at(i), rate, force, field: Some(field) });
            i += 1;
        }
    };
    assert_eq!(f.orientation_north(), None);
    feed(&mut f, 10, field, Vec3::ZERO);
    let north = |f: &Vqf| f.orientation_north().unwrap() * Vec3::X;
    assert!((north(&f) - Vec3::Y).length() < 1e-3, "{}", north(&f));
    assert!(f.is_field_disturbed(), "no reference before it has turned");
    // It turns, so the field is known.
    let mut turn = 0.0_f32;
    for _ in 0..12 * HERTZ {
        turn += 1.0 / HERTZ as f32;
        let field = Quat::from_rotation_z(-turn) * field;
        f.update(&ImuSample { time: at(i), rate: Vec3::Z, force, field: Some(field) });
        i += 1;
    }
    assert!(!f.is_field_disturbed());
    let expected = Quat::from_rotation_z(turn) * Vec3::Y;
    assert!((north(&f) - expected).length() < 0.02, "{} {expected}", north(&f));
    // A magnet, for ten seconds: the heading stays, and so does the horizon.
    let before = (north(&f), f.gravity().unwrap().up);
    for _ in 0..10 * HERTZ {
        f.update(&ImuSample { time: at(i), rate: Vec3::ZERO, force, field: Some(Vec3::new(90.0, 70.0, 30.0)) });
        i += 1;
    }
    assert!(f.is_field_disturbed());
    assert!((north(&f) - before.0).length() < 0.02 && (f.gravity().unwrap().up - before.1).length() < 1e-4);
}

#[test]
fn a_gap_and_a_backward_clock_keep_the_orientation_and_are_levelled_anew() {
    let mut f = filter();
    let tilted = Quat::from_rotation_x(0.5);
    let feed = |f: &mut Vqf, from: i64, count: i64, q: Quat| {
        let mut first = None;
        for i in from..from + count {
            let force = q.inverse() * (Vec3::Z * STANDARD_GRAVITY);
            let step = f.update(&ImuSample { time: at(i), rate: Vec3::ZERO, force, field: None });
            first.get_or_insert(step);
        }
        first.unwrap()
    };
    assert_eq!(f.gravity(), None);
    assert_eq!(f.inclination_sigma(), f32::INFINITY);
    assert_eq!(feed(&mut f, 0, 1000, tilted), Step::First);
    let sure = f.inclination_sigma();
    assert!(sure < 0.02, "{sure}");
    // Ten seconds of silence, in which it was laid flat: known at the next reading, less surely.
    let step = feed(&mut f, 3000, 1, Quat::IDENTITY);
    assert!(matches!(step, Step::Gap(s) if (s - 10.0).abs() < 0.01), "{step:?}");
    assert!(f.gravity().unwrap().up.angle_between(Vec3::Z) < 1e-3);
    assert!(f.inclination_sigma() > 0.09);
    feed(&mut f, 3001, 1000, Quat::IDENTITY);
    assert!(f.inclination_sigma() < 0.02);
    // The sensor's clock starts anew.
    assert_eq!(feed(&mut f, 5, 1, tilted), Step::Backward);
    assert!(f.gravity().unwrap().up.angle_between(tilted.inverse() * Vec3::Z) < 1e-3);
    assert_eq!(f.orientation_at(at(5 + 2 * HERTZ)), None);
    assert!(f.orientation_at(at(7)).is_some());
    assert!(f.orientation_at(Timestamp::from_nanos(i64::MIN)).is_none());
}

#[test]
fn impossible_parameters_are_refused() {
    let d = VqfParams::DEFAULT;
    for (p, name) in [
        (VqfParams { time: 0.0, ..d }, "time"),
        (VqfParams { bias_start: f32::NAN, ..d }, "bias_start"),
        (VqfParams { bias_time: -1.0, ..d }, "bias_time"),
        (VqfParams { bias_motion: 0.0, ..d }, "bias_motion"),
        (VqfParams { bias_vertical: 2.0, ..d }, "bias_vertical"),
        (VqfParams { bias_rest: f32::INFINITY, ..d }, "bias_rest"),
        (VqfParams { max_gap: 11.0, ..d }, "max_gap"),
        (VqfParams { force_error: -0.1, ..d }, "force_error"),
        (VqfParams { rest: RestParams { smoothing: 0.0, ..RestParams::DEFAULT }, ..d }, "smoothing"),
        (
            VqfParams { magnetic: MagneticParams { rejection_factor: 0.5, ..MagneticParams::DEFAULT }, ..d },
            "rejection_factor",
        ),
    ] {
        assert_eq!(Vqf::new(p).unwrap_err().name, name);
    }
}

#[test]
fn a_stored_bias_is_a_start_within_its_limits() {
    let mut f = filter();
    f.set_bias(Vec3::new(0.01, -1.0, 0.0), 1e-4);
    assert_eq!(f.bias(), Vec3::new(0.01, -f.params.rest.max_bias, 0.0));
    assert!((f.bias_sigma() - 1e-4).abs() < 1e-8);
    f.set_bias(Vec3::NAN, 1e-4);
    f.set_bias(Vec3::ZERO, f32::NAN);
    assert_eq!(f.bias().x, 0.01);
}

#[test]
fn state_is_small() {
    std::println!(
        "Vqf {} bytes, RestDetector {}, RestBias {}",
        size_of::<Vqf>(),
        size_of::<RestDetector>(),
        size_of::<crate::sensing::imu::rest::RestBias>()
    );
    assert!(
        size_of::<Vqf>() <= 800
            && size_of::<RestDetector>() <= 160
            && size_of::<crate::sensing::imu::rest::RestBias>() <= 256
    );
}
