//! Pixels to points and back.

use std::hint::black_box;

use isobath::glam::{Vec2, Vec3};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::sensing::points::{self, Space};
use isobath_sim::V3;

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
        Measure { unit: "%", name: "unanswered", what: "pixels with a reading and without a point", shown: false },
        Measure { unit: "%", name: "invented", what: "points where there is no reading, of all pixels", shown: false },
    ],
    sensors: Sensor::ALL,
    scenes: &[],
    methods: |input| on_frame!(input, frame => methods(input, frame)),
    answers: Some(score_answer),
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
    answers: None,
};

fn methods<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let world = all(input, "world_point", move |x, y| frame.world_point(x, y), |x, y| input.true_point(x, y));
    // What other libraries answer is in the camera's frame: beside them, so is one of ours.
    let camera = || all(input, "point (camera)", move |x, y| frame.point(x, y), |x, y| true_camera_point(input, x, y));
    let rows = [("packed", Space::World), ("packed (camera)", Space::Camera)];
    let rows = rows.map(|(name, space)| packed(input, frame, name, space));
    std::iter::once(world).chain(rows).chain(input.keep.then(camera)).collect()
}

/// The kernel that answers all of them, in one array.
fn packed<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>, name: &str, space: Space) -> Method<'a> {
    let (w, h) = input.size();
    let mut scratch = vec![0.0; points::scratch_len(w)];
    let mut out = vec![[0.0; 3]; w * h];
    let run = move || _ = black_box(points::packed(&frame, space, &mut scratch, black_box(&mut out)));
    let score = move || {
        let mut all = vec![[f32::NAN; 3]; w * h];
        let _ = points::packed(&frame, space, &mut vec![0.0; points::scratch_len(w)], &mut all);
        let truth = |x, y| if space == Space::World { input.true_point(x, y) } else { true_camera_point(input, x, y) };
        let got = |x: usize, y: usize| {
            let p = Vec3::from(all[y * w + x]);
            p.is_finite().then(|| v3(p))
        };
        score(w, h, got, truth)
    };
    Method::new(name, w * h, run, score)
}

/// A method that answers every pixel's point, and leaves it in memory when the input says so.
fn all<'a>(
    input: &'a Input,
    name: &str,
    point: impl Fn(usize, usize) -> Option<Vec3> + Copy + 'a,
    truth: impl Fn(usize, usize) -> Option<V3> + 'a,
) -> Method<'a> {
    let (w, h) = input.size();
    let mut kept = vec![[0.0; 3]; if input.keep { w * h } else { 0 }];
    let run = move || {
        if kept.is_empty() {
            each(w, h, |x, y| _ = black_box(point(x, y)));
        }
        for (y, row) in kept.chunks_exact_mut(w.max(1)).enumerate() {
            for (x, to) in row.iter_mut().enumerate() {
                *to = point(x, y).map_or([f32::NAN; 3], |p| p.to_array());
            }
        }
        black_box(&kept);
    };
    Method::new(name, w * h, run, move || score(w, h, |x, y| point(x, y).map(v3), &truth))
}

fn true_camera_point(input: &Input, x: usize, y: usize) -> Option<V3> {
    input.true_point(x, y).map(|p| input.place.undo_point(p))
}

/// Scores what another program answered; zeros, or what is not finite, is no point.
fn score_answer(input: &Input, points: &[f32]) -> Score {
    let (w, h) = input.size();
    let got = |x: usize, y: usize| {
        let at = 3 * (y * w + x);
        let p = points.get(at..at + 3)?;
        let there = p.iter().all(|v| v.is_finite()) && p[2] != 0.0;
        there.then(|| V3::from([p[0], p[1], p[2]].map(f64::from)))
    };
    score(w, h, got, |x, y| true_camera_point(input, x, y))
}

fn score(
    w: usize,
    h: usize,
    got: impl Fn(usize, usize) -> Option<V3>,
    truth: impl Fn(usize, usize) -> Option<V3>,
) -> Score {
    let mut off = Vec::with_capacity(w * h);
    let (mut unanswered, mut invented) = (0, 0);
    each(w, h, |x, y| match (got(x, y), truth(x, y)) {
        (Some(got), Some(truth)) => off.push(1e3 * (got - truth).length()),
        (None, Some(_)) => unanswered += 1,
        (Some(_), None) => invented += 1,
        (None, None) => {}
    });
    let share = |n: usize, of: usize| 100.0 * n as f64 / of as f64;
    let worst = off.iter().copied().fold(0.0, f64::max);
    Score::of([mean(&off), worst, share(unanswered, off.len() + unanswered), share(invented, w * h)])
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::tests::half_a_wall;

    #[test]
    fn beside_peers_the_camera_point_is_asked_too_and_kept() {
        let alone = Input::new("sphere", Sensor::Exact, (64, 48), 1).unwrap();
        let methods = (POINTS.methods)(&alone).len();
        let input = Input { keep: true, ..alone };
        assert_eq!((POINTS.methods)(&input).len(), methods + 1);
        for mut method in (POINTS.methods)(&input) {
            method.run();
            let errors = method.score().errors;
            assert!(errors[1] < 0.01 && errors[2..] == [0.0, 0.0], "{}: {errors:?}", method.name());
        }
    }

    #[test]
    fn an_answer_is_scored_in_the_cameras_frame() {
        let input = half_a_wall();
        let point = |i: usize| true_camera_point(&input, i % 64, i / 64).map_or([0.0; 3], V3::to_f32);
        let right: Vec<_> = (0..input.pixels()).map(point).collect();
        let errors = score_answer(&input, right.as_flattened()).errors;
        assert!(errors[1] < 0.01 && errors[2..] == [0.0, 0.0], "{errors:?}");
        let everywhere = score_answer(&input, &vec![1.0; 3 * input.pixels()]).errors;
        assert!(everywhere[3] == 50.0 && everywhere[0] > 100.0, "{everywhere:?}");
    }
}
