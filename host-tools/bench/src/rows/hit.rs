//! The hit test.

use std::hint::black_box;

use isobath::glam::vec2;
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::normals::NormalParams;
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath_sim::V3;

use crate::input::{Input, Random, Sensor, degrees_between, mean, on_frame, v3};
use crate::row::{Measure, Method, Row, Score};

/// Surface point and normal between pixel centres.
pub(crate) const HIT: Row = Row {
    name: "hit-test",
    title: "Hit test between pixel centres",
    unit: "query",
    errors: &[
        Measure {
            unit: "mm",
            name: "mean",
            what: "mean distance from what the ray truly meets, over hits within 10 cm of it",
            shown: true,
        },
        Measure { unit: "per 1000", name: "wrong", what: "no hit, or more than 10 cm off", shown: true },
        Measure { unit: "degrees", name: "normal", what: "mean angle to the pixel's true normal", shown: false },
    ],
    sensors: Sensor::ALL,
    scenes: &[],
    methods: |input| on_frame!(input, frame => methods(input, frame)),
    answers: None,
};

fn methods<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let mut random = Random::new(input.seed ^ 0x417);
    let queries: Vec<_> = input
        .some_pixels(400)
        .into_iter()
        .filter_map(|(x, y)| {
            let (dx, dy) = (random.between(-0.49, 0.49), random.between(-0.49, 0.49));
            let at = vec2(x as f32 + dx as f32, y as f32 + dy as f32);
            let ray = input.camera.ray(f64::from(at.x), f64::from(at.y))?;
            let direction = input.place.rotation.apply(ray).unit()?;
            let truth = input.place.translation + direction * input.probe(input.place.translation, direction)?;
            Some((at, truth, input.true_normal(x, y)?))
        })
        .collect();
    let noise = input.sensor.noise();
    let cross = NormalParams::default();
    [("point alone", None), ("cross normal", Some(cross)), ("11x11 normal", Some(NormalParams::POINT))]
        .into_iter()
        .map(|(name, normal)| {
            let params = HitParams { normal, noise };
            let (asked, judged) = (queries.clone(), queries.clone());
            let run = move || asked.iter().for_each(|q| _ = black_box(hit_test(&frame, q.0, &params)));
            Method::new(name, queries.len(), run, move || {
                let (mut off, mut angles, mut wrong) = (Vec::new(), Vec::new(), 0);
                for &(at, truth, normal) in &judged {
                    let outcome = hit_test(&frame, at, &params);
                    let hit = outcome.hit().filter(|h| (v3(h.point) - truth).length() <= 0.1);
                    let Some(hit) = hit else {
                        wrong += 1;
                        continue;
                    };
                    off.push(1e3 * (v3(hit.point) - truth).length());
                    if let Some(n) = hit.normal {
                        let truth: V3 = input.place.rotation.apply(V3::from(normal));
                        angles.push(degrees_between(v3(n).into(), truth.into()));
                    }
                }
                Score::of([mean(&off), 1000.0 * f64::from(wrong) / judged.len() as f64, mean(&angles)])
            })
        })
        .collect()
}
