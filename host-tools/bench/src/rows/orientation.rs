//! How is the device turned? Orientation filters against the truth: the optical one of two recordings (BROAD), and a simulated hand's.
//!
//! The frame plays no part: each row is measured once a size.

use std::hint::black_box;

use isobath::sensing::imu::ImuSample;
use isobath::sensing::imu::vqf::{Vqf, VqfParams};
use vqf_rs::VQF;

use crate::inertial::{Naive, Trial, broad, double, simulated};
use crate::input::{Input, Sensor};
use crate::row::{Measure, Method, Row, Score};

const ERRORS: &[Measure] = &[
    Measure {
        unit: "mdeg",
        name: "tilt",
        what: "root mean square angle between the verticals, while moving",
        shown: true,
    },
    Measure {
        unit: "mdeg",
        name: "total",
        what: "root mean square angle of the whole rotation, while moving; only with a magnetometer is the heading comparable",
        shown: true,
    },
];

/// A phone's sensor in a simulated hand.
pub(crate) const SIMULATED: Row =
    row("orientation", "Orientation filters, simulated phone", |input| methods(simulated(input.seed)));
/// BROAD, trial 3.
pub(crate) const SLOW: Row =
    row("orientation.slow", "BROAD 03, slow rotation", |_| broad(3).map(methods).unwrap_or_default());
/// BROAD, trial 27.
pub(crate) const VIBRATION: Row =
    row("orientation.vibration", "BROAD 27, a phone vibrates", |_| broad(27).map(methods).unwrap_or_default());

const fn row(name: &'static str, title: &'static str, methods: for<'a> fn(&'a Input) -> Vec<Method<'a>>) -> Row {
    Row {
        name,
        title,
        unit: "step",
        errors: ERRORS,
        sensors: &[Sensor::Exact],
        scenes: &["wall"],
        methods,
        answers: None,
    }
}

fn methods(trial: Trial) -> Vec<Method<'static>> {
    // Leaked: as long as the program measures.
    let trial: &'static Trial = Box::leak(Box::new(trial));
    let mut out = Vec::new();
    let has_field = trial.samples.iter().any(|s| s.field.is_some());
    for field in [false, true].into_iter().filter(|&f| has_field || !f) {
        let samples: &'static [ImuSample] = trial
            .samples
            .iter()
            .map(|s| ImuSample { field: s.field.filter(|_| field), ..*s })
            .collect::<Vec<_>>()
            .leak();
        let label = if field { "with magnetometer" } else { "6D" };
        let n = samples.len();
        let scored = move |e: crate::inertial::Errors| {
            Score::of([1e3 * e.inclination, if field { 1e3 * e.total } else { f64::NAN }])
        };
        let ours = move || {
            let Ok(mut filter) = Vqf::new(VqfParams::DEFAULT) else { return };
            samples.iter().for_each(|s| _ = black_box(filter.update(s)));
            black_box(filter.orientation());
        };
        out.push(Method::new(format!("VQF, f32, {label}"), n, ours, move || {
            let Ok(mut filter) = Vqf::new(VqfParams::DEFAULT) else { return Score::of([f64::NAN; 2]) };
            scored(trial.score(samples.iter().map(|s| {
                filter.update(s);
                double(if field { filter.orientation_north() } else { None }.unwrap_or(filter.orientation()))
            })))
        }));
        let wide: &'static [Reading] = samples.iter().map(Reading::of).collect::<Vec<_>>().leak();
        let theirs = move || {
            let mut filter = VQF::new(trial.period, None, None, None);
            wide.iter().for_each(|r| filter.update(r.rate, r.force, r.field));
            black_box(filter.quat_6d());
        };
        out.push(Method::new(format!("vqf-rs 0.3, f64, {label}"), n, theirs, move || {
            let mut filter = VQF::new(trial.period, None, None, None);
            scored(trial.score(wide.iter().map(|r| {
                filter.update(r.rate, r.force, r.field);
                let q = if field { filter.quat_9d() } else { filter.quat_6d() };
                glam::DQuat::from_xyzw(q.1, q.2, q.3, q.0)
            })))
        }));
    }
    let run = move || {
        let mut filter = Naive::new(trial.period);
        trial.samples.iter().for_each(|s| _ = black_box(filter.update(s)));
    };
    out.push(Method::new("complementary, f64", trial.samples.len(), run, move || {
        let mut filter = Naive::new(trial.period);
        let errors = trial.score(trial.samples.iter().map(|s| filter.update(s)));
        Score::of([1e3 * errors.inclination, f64::NAN])
    }));
    out
}

/// A reading as vqf-rs takes it.
#[derive(Debug, Clone, Copy)]
struct Reading {
    rate: [f64; 3],
    force: [f64; 3],
    field: Option<[f64; 3]>,
}

impl Reading {
    fn of(s: &ImuSample) -> Self {
        let wide = |v: glam::Vec3| v.as_dvec3().to_array();
        Self { rate: wide(s.rate), force: wide(s.force), field: s.field.map(wide) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everybody_answers_and_ours_is_no_worse() {
        let mut found: Vec<(String, f64)> =
            methods(simulated(1)).iter_mut().map(|m| (m.name().to_owned(), m.score().errors[0])).collect();
        println!("{found:?}");
        assert_eq!(found.len(), 3);
        let naive = found.pop().unwrap().1;
        let theirs = found.pop().unwrap().1;
        let ours = found.pop().unwrap().1;
        assert!(ours <= theirs * 1.01 && ours < 0.5 * naive && ours > 0.0, "{ours} {theirs} {naive}");
    }
}
