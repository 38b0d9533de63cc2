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
    Measure { unit: "%", name: "invented", what: "normals where there is no reading, of all pixels", shown: false },
    Measure {
        unit: "%",
        name: "away",
        what: "normals that face away from the camera, of those answered",
        shown: false,
    },
    Measure {
        unit: "degrees",
        name: "turned",
        what: "the mean once those that face away are turned towards the camera",
        shown: false,
    },
    Measure {
        unit: "%",
        name: "beyond",
        what: "errors over twice what was predicted for the pixel, where a prediction is made: 2 % when it is honest",
        shown: false,
    },
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
    answers: Some(score_answer),
};

/// Dense normals on scenes of the published 3F2N benchmark's kind: facets with sharp edges, without noise, depth in no unit.
pub(crate) const FACETS: Row = Row {
    name: "normals.facets",
    title: "Normals of facets (3F2N's kind)",
    sensors: &[Sensor::Exact],
    scenes: crate::FACETS,
    ..DENSE
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
    answers: None,
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
        let mut kept = Kept::of(input);
        let run = move || {
            let _ = black_box(dense::rows(&frame, &params, &mut scratch, |y, row| kept.row(y, row.x, row.y, row.z)));
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
        let mut kept = Kept::of(input);
        let run = move || {
            let _ = black_box(adaptive::rows(&frame, &params, &mut scratch, |y, row| kept.row(y, row.x, row.y, row.z)));
        };
        Method::new(name, input.pixels(), run, move || {
            let mut tally = Tally::default();
            let _ = adaptive::rows(&frame, &params, &mut again, |y, row| {
                tally.row(input, y, row.x, row.y, row.z);
                tally.predicted(row.sigma);
            });
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

/// Where rows of normals go: nowhere, or into planes of the whole image when the input says so.
struct Kept {
    planes: [Vec<f32>; 3],
}

impl Kept {
    fn of(input: &Input) -> Self {
        let plane = vec![0.0; if input.keep { input.pixels() } else { 0 }];
        Self { planes: [plane.clone(), plane.clone(), plane] }
    }

    fn row(&mut self, y: usize, nx: &[f32], ny: &[f32], nz: &[f32]) {
        let width = nz.len();
        for (plane, row) in self.planes.iter_mut().zip([nx, ny, nz]) {
            if let Some(to) = plane.get_mut(y * width..(y + 1) * width) {
                to.copy_from_slice(row);
            }
        }
        black_box((&self.planes, nz));
    }
}

/// Scores what another program answered. Zeros, or what is not finite, is no normal; length does not matter.
fn score_answer(input: &Input, normals: &[f32]) -> Score {
    let mut tally = Tally::default();
    let width = input.size().0;
    for (i, n) in normals.chunks_exact(3).take(input.pixels()).enumerate() {
        let n = [n[0], n[1], n[2]];
        let there = n.iter().all(|v| v.is_finite()) && n != [0.0; 3];
        tally.add(input, i % width, i / width, there.then_some(n));
    }
    tally.score()
}

/// Angles to the truth.
#[derive(Default)]
struct Tally {
    angles: Vec<f64>,
    turned: Vec<f64>,
    unanswered: usize,
    invented: usize,
    away: usize,
    pixels: usize,
    /// Errors over twice the prediction, and predictions.
    beyond: usize,
    predictions: usize,
    /// The last row's angles, NaN where there is none.
    last: Vec<f64>,
}

impl Tally {
    fn row(&mut self, input: &Input, y: usize, nx: &[f32], ny: &[f32], nz: &[f32]) {
        self.last.clear();
        for x in 0..nx.len() {
            let there = nx[x].is_finite();
            self.add(input, x, y, there.then(|| [nx[x], ny[x], nz[x]]));
        }
    }

    /// What was predicted of the last row, radians.
    fn predicted(&mut self, sigma: &[f32]) {
        for (angle, sigma) in self.last.iter().zip(sigma).filter(|(angle, _)| !angle.is_nan()) {
            self.predictions += 1;
            self.beyond += usize::from(angle.to_radians() > 2.0 * f64::from(*sigma));
        }
    }

    fn add(&mut self, input: &Input, x: usize, y: usize, normal: Option<[f32; 3]>) {
        self.pixels += 1;
        let (Some(truth), Some(ray)) = (input.true_normal(x, y), input.camera.ray(x as f64, y as f64)) else {
            self.invented += usize::from(normal.is_some());
            self.last.push(f64::NAN);
            return;
        };
        let Some(n) = normal.map(|n| n.map(f64::from)) else {
            self.unanswered += 1;
            self.last.push(f64::NAN);
            return;
        };
        let angle = degrees_between(n, truth);
        let away = ray.dot(n.into()) > 0.0;
        self.angles.push(angle);
        self.last.push(angle);
        self.turned.push(if away { 180.0 - angle } else { angle });
        self.away += usize::from(away);
    }

    fn score(mut self) -> Score {
        let all = (self.angles.len() + self.unanswered) as f64;
        let share = |n: usize, of: f64| 100.0 * n as f64 / of;
        let away = share(self.away, self.angles.len() as f64);
        let (mean, turned) = (mean(&self.angles), mean(&self.turned));
        let (unanswered, invented) = (share(self.unanswered, all), share(self.invented, self.pixels as f64));
        let beyond = share(self.beyond, self.predictions as f64);
        Score::of([mean, median(&mut self.angles), unanswered, invented, away, turned, beyond])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::tests::half_a_wall;

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
    #[test]
    fn an_answer_is_scored_as_it_stands_and_turned() {
        let input = half_a_wall();
        let truth: Vec<[f32; 3]> = (0..input.pixels())
            .map(|i| input.true_normal(i % 64, i / 64).map_or([0.0; 3], |n| n.map(|v| v as f32)))
            .collect();
        let score = |answer: &[[f32; 3]]| score_answer(&input, answer.as_flattened()).errors;
        let right = score(&truth);
        assert!(right[0] < 1e-3 && right[2..5] == [0.0; 3], "{right:?}");
        let away = score(&truth.iter().map(|n| n.map(|v| -2.0 * v)).collect::<Vec<_>>());
        assert!(away[0] > 179.9 && away[4] == 100.0 && away[5] < 1e-3, "{away:?}");
        let everywhere = score(&vec![[0.0, 0.0, -1.0]; input.pixels()]);
        assert_eq!(everywhere[2..5], [0.0, 50.0, 0.0], "half of it is invented");
        assert_eq!(score(&vec![[f32::NAN; 3]; input.pixels()])[2], 100.0);
    }

    #[test]
    fn kept_rows_are_the_same_rows() {
        let input = Input { keep: true, ..Input::new("corner", Sensor::Exact, (32, 24), 1).unwrap() };
        let mut kept = Kept::of(&input);
        kept.row(23, &[1.0; 32], &[2.0; 32], &[3.0; 32]);
        assert_eq!(kept.planes[1][23 * 32..], [2.0; 32]);
        assert!(Kept::of(&Input { keep: false, ..input }).planes[0].is_empty());
    }
}
