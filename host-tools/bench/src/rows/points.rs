//! Pixels to points and back.

use std::hint::black_box;

use isobath::glam::Vec2;
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;

use crate::input::{Input, Sensor, mean, on_frame, v3};
use crate::row::{Measure, Method, Row, Score};

/// Every pixel's world point.
pub(crate) const POINTS: Row = Row {
    name: "points",
    title: "World point of every pixel",
    unit: "pixel",
    errors: &[
        Measure { unit: "mm", name: "mean", what: "mean distance from the true point", shown: true },
        Measure { unit: "mm", name: "worst", what: "largest of the same", shown: true },
    ],
    sensors: Sensor::ALL,
    scenes: &[],
    methods: |input| on_frame!(input, frame => points(input, frame)),
};

/// Pixel to point and back.
pub(crate) const PROJECTION: Row = Row {
    name: "projection",
    title: "Pixel to camera point and back",
    unit: "pixel",
    errors: &[Measure {
        unit: "px",
        name: "worst",
        what: "largest distance from the pixel it began with",
        shown: true,
    }],
    sensors: &[Sensor::Exact, Sensor::Millimetres],
    scenes: &[],
    methods: |input| on_frame!(input, frame => projection(input, frame)),
};

fn points<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let (w, h) = input.size();
    let run = move || each(w, h, |x, y| _ = black_box(frame.world_point(x, y)));
    let score = move || {
        let mut off = Vec::with_capacity(w * h);
        each(w, h, |x, y| {
            if let (Some(got), Some(truth)) = (frame.world_point(x, y), input.true_point(x, y)) {
                off.push(1e3 * (v3(got) - truth).length());
            }
        });
        Score::of([mean(&off), off.iter().copied().fold(0.0, f64::max)])
    };
    vec![Method::new("world_point", w * h, run, score)]
}

fn projection<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let (w, h) = input.size();
    let back = move |x, y| frame.point(x, y).and_then(|p| frame.intrinsics().project(p));
    let run = move || each(w, h, |x, y| _ = black_box(back(x, y)));
    let score = move || {
        let mut worst = 0.0_f64;
        each(w, h, |x, y| {
            if let Some(pixel) = back(x, y) {
                worst = worst.max(f64::from((pixel - Vec2::new(x as f32, y as f32)).length()));
            }
        });
        Score::of([worst])
    };
    vec![Method::new("point, project", w * h, run, score)]
}

fn each(width: usize, height: usize, mut what: impl FnMut(usize, usize)) {
    for y in 0..height {
        for x in 0..width {
            what(x, y);
        }
    }
}
