//! Normals: of every pixel, and of one.

use std::hint::black_box;

use isobath::localized::normals::adaptive::{self, AdaptiveParams, BlockSize};
use isobath::localized::normals::{NormalMethod, NormalParams, dense, normal_at};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;

use crate::input::{Input, Sensor, degrees_between, mean, median, on_frame};
use crate::row::{Measure, Method, Row, Score};

const ERRORS: &[Measure] = &[
    Measure {
        unit: "degrees",
        name: "mean",
        what: "mean angle to the true normal, over all pixels answered",
        shown: true,
    },
    Measure { unit: "degrees", name: "median", what: "median of the same", shown: false },
    Measure { unit: "%", name: "unanswered", what: "pixels with a reading and without a normal", shown: false },
];

/// Dense normals.
pub(crate) const DENSE: Row = Row {
    name: "normals",
    title: "Normal of every pixel",
    unit: "pixel",
    errors: ERRORS,
    sensors: Sensor::ALL,
    scenes: &[],
    methods: |input| on_frame!(input, frame => dense_methods(input, frame)),
};

/// The normal at one pixel.
pub(crate) const SINGLE: Row = Row {
    name: "normal-at",
    title: "Normal at one pixel",
    unit: "query",
    errors: ERRORS,
    sensors: Sensor::ALL,
    scenes: &[],
    methods: |input| on_frame!(input, frame => single_methods(input, frame)),
};

const fn fit(radius: u8) -> NormalParams {
    NormalParams { method: NormalMethod::Exact, radius, max_step: None }
}

const SETTINGS: &[(&str, NormalParams)] = &[
    ("cross", fit(0)),
    ("paper, r = 2", NormalParams::PAPER),
    ("fit 3x3", fit(1)),
    ("fit 7x7", fit(3)),
    ("fit 11x11", fit(5)),
];

const BLOCKS: &[(&str, BlockSize)] = &[
    ("adaptive", BlockSize::Auto),
    ("adaptive, 4x4", BlockSize::Four),
    ("adaptive, 8x8", BlockSize::Eight),
    ("adaptive, 16x16", BlockSize::Sixteen),
];

fn dense_methods<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let width = input.size().0;
    let plain = SETTINGS.iter().map(|&(name, params)| {
        let mut scratch = vec![0.0; dense::scratch_len(width)];
        let mut again = scratch.clone();
        let run = move || {
            let _ = black_box(dense::rows(&frame, &params, &mut scratch, |_, row| _ = black_box(row.z)));
        };
        Method::new(name, input.pixels(), run, move || {
            let mut tally = Tally::default();
            let _ = dense::rows(&frame, &params, &mut again, |y, row| tally.row(input, y, row.x, row.y, row.z));
            tally.score()
        })
    });
    let adaptive = BLOCKS.iter().map(|&(name, block)| {
        let params = AdaptiveParams { noise: input.sensor.noise(), block };
        let mut scratch = vec![0.0; adaptive::scratch_len(width)];
        let mut again = scratch.clone();
        let run = move || {
            let _ = black_box(adaptive::rows(&frame, &params, &mut scratch, |_, row| _ = black_box(row.z)));
        };
        Method::new(name, input.pixels(), run, move || {
            let mut tally = Tally::default();
            let _ = adaptive::rows(&frame, &params, &mut again, |y, row| tally.row(input, y, row.x, row.y, row.z));
            tally.score()
        })
    });
    plain.chain(adaptive).collect()
}

fn single_methods<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let pixels = input.some_pixels(500);
    let of = |&(name, params): &(&'static str, NormalParams)| {
        let (pixels, again) = (pixels.clone(), pixels.clone());
        let run = move || pixels.iter().for_each(|&(x, y)| _ = black_box(normal_at(&frame, x, y, &params)));
        Method::new(name, again.len(), run, move || {
            let mut tally = Tally::default();
            for &(x, y) in again.iter().filter(|&&(x, y)| frame.z(x, y) > 0.0) {
                tally.add(input, x, y, normal_at(&frame, x, y, &params).map(|e| e.normal.to_array()));
            }
            tally.score()
        })
    };
    SETTINGS.iter().map(of).collect()
}

/// Angles to the truth.
#[derive(Default)]
struct Tally {
    angles: Vec<f64>,
    unanswered: usize,
}

impl Tally {
    fn row(&mut self, input: &Input, y: usize, nx: &[f32], ny: &[f32], nz: &[f32]) {
        for x in 0..nx.len() {
            let there = nx[x].is_finite();
            self.add(input, x, y, there.then(|| [nx[x], ny[x], nz[x]]));
        }
    }

    fn add(&mut self, input: &Input, x: usize, y: usize, normal: Option<[f32; 3]>) {
        let Some(truth) = input.true_normal(x, y) else { return };
        match normal {
            Some(n) => self.angles.push(degrees_between(n.map(f64::from), truth)),
            None => self.unanswered += 1,
        }
    }

    fn score(mut self) -> Score {
        let all = (self.angles.len() + self.unanswered) as f64;
        let mean = mean(&self.angles);
        Score::of([mean, median(&mut self.angles), 100.0 * self.unanswered as f64 / all])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_is_flat_to_every_method() {
        let input = Input::new("wall", Sensor::Exact, (64, 48), 1).unwrap();
        for mut method in (DENSE.methods)(&input).into_iter().chain((SINGLE.methods)(&input)) {
            method.run();
            let errors = method.score().errors;
            assert!(errors[0] < 0.01 && errors[2] == 0.0, "{}: {errors:?}", method.name());
        }
    }

    #[test]
    fn noise_is_what_the_adaptive_estimator_is_for() {
        let input = Input::new("tilted", Sensor::Kinect, (160, 120), 1).unwrap();
        let scores: Vec<f64> = (DENSE.methods)(&input).iter_mut().map(|m| m.score().errors[0]).collect();
        assert!(scores[5] < 5.0 && scores[0] > 20.0, "{scores:?}");
    }
}
