//! Rays that start anywhere: against the surfaces that are truly there.

use std::hint::black_box;

use isobath::ground::geometry::Ray;
use isobath::localized::raycast::{RayHit, RayOutcome, RayParams, cast};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_sim::{V3, v3 as v};

use crate::input::{self, Input, Random, Sensor, mean, on_frame, vec3};
use crate::row::{Measure, Method, Row, Score};

/// Ray casts with and without the pyramid.
pub(crate) const CAST: Row = Row {
    name: "raycast",
    title: "Rays from beside the camera",
    unit: "ray",
    errors: &[
        Measure {
            unit: "per 1000",
            name: "wrong",
            what: "rays without a hit where the camera sees what they truly meet, with a hit where they meet nothing it sees, or more than 10 cm off",
            shown: true,
        },
        Measure { unit: "mm", name: "median", what: "median distance of right hits from the true point", shown: true },
        Measure { unit: "mm", name: "mean", what: "mean of the same", shown: false },
    ],
    sensors: Sensor::ALL,
    scenes: &[],
    methods: |input| on_frame!(input, frame => methods(input, frame)),
    answers: None,
};

const RAYS: usize = 300;
/// A hit this far from the true point is a wrong one, metres.
const OFF: f64 = 0.1;

/// A ray and what it truly meets.
#[derive(Clone, Copy)]
pub(crate) struct Query {
    pub(crate) ray: Ray,
    /// Where, when the camera sees it; `None`: no hit should be reported.
    truth: Option<V3>,
}

/// Rays from within half a metre of the camera, every other one to a surface that it sees and every other one anywhere ahead,
/// truth included.
pub(crate) fn queries(input: &Input) -> Vec<Query> {
    let mut random = Random::new(input.seed ^ 0xca57);
    let eye = input.place.translation;
    let mut out = Vec::new();
    for (x, y) in input.some_pixels(4 * RAYS) {
        let Some(target) = input.true_point(x, y) else { continue };
        // In the camera's frame: to the side and ahead.
        let aside = v(random.between(-0.5, 0.5), random.between(-0.3, 0.3), random.between(0.1, 0.6));
        let anywhere = v(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(0.0, 1.0));
        let origin = input.place.point(aside);
        let towards = if out.len() % 2 == 0 { target - origin } else { input.place.rotation.apply(anywhere) };
        let Some(ray) = Ray::new(vec3(origin), vec3(towards)) else { continue };
        // What the rounded ray truly meets.
        let (origin, direction) = (input::v3(ray.origin()), input::v3(ray.direction()));
        let (Some(direction), Some(out_of_eye)) = (direction.unit(), (origin - eye).unit()) else { continue };
        // A start inside or behind something has no fair answer.
        if input.probe(eye, out_of_eye).is_some_and(|d| d <= (origin - eye).length()) {
            continue;
        }
        let met = input.probe(origin, direction).map(|t| origin + direction * t);
        out.push(Query { ray, truth: met.filter(|&p| input.sees(p, 0.01)) });
        if out.len() == RAYS {
            break;
        }
    }
    out
}

fn methods<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let queries = queries(input);
    let (w, h) = input.size();
    let mut out = Vec::new();
    for (name, skipping, thickness) in [
        ("every pixel", false, 0.3),
        ("pyramid", true, 0.3),
        ("pyramid, 5 cm thick", true, 0.05),
        ("pyramid, endless", true, f32::INFINITY),
    ] {
        let params = RayParams { thickness, ..RayParams::default() };
        let mut cells = vec![Cell::EMPTY; cells_needed(w, h)];
        let mut again = cells.clone();
        let (asked, judged) = (queries.clone(), queries.clone());
        // The pyramid's build is a row of its own: here it is built once a batch of rays, as once a frame.
        let run = move || {
            let pyramid = skipping.then(|| Pyramid::build(frame.depth(), &mut cells).ok()).flatten();
            for q in &asked {
                black_box(cast(&frame, pyramid.as_ref(), &q.ray, &params));
            }
        };
        out.push(Method::new(name, queries.len(), run, move || {
            let pyramid = skipping.then(|| Pyramid::build(frame.depth(), &mut again).ok()).flatten();
            judge(judged.iter().map(|q| (q, cast(&frame, pyramid.as_ref(), &q.ray, &params).outcome)))
        }));
    }
    out
}

fn judge<'a>(answers: impl Iterator<Item = (&'a Query, RayOutcome)>) -> Score {
    let (mut wrong, mut all, mut off) = (0, 0, Vec::new());
    for (query, outcome) in answers {
        all += 1;
        let right = match (outcome, query.truth) {
            (RayOutcome::Hit(RayHit { point, .. }), Some(truth)) => {
                let distance = (input::v3(point) - truth).length();
                if distance <= OFF {
                    off.push(1e3 * distance);
                }
                distance <= OFF
            }
            (RayOutcome::Hit(_), None) | (_, Some(_)) => false,
            (_, None) => true,
        };
        wrong += usize::from(!right);
    }
    let mean = mean(&off);
    Score::of([1000.0 * wrong as f64 / f64::from(all), input::median(&mut off), mean])
}
