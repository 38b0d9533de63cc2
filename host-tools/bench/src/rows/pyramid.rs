//! The min/max pyramid.

use std::hint::black_box;

use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

use crate::input::{Input, Sensor, on_frame};
use crate::row::{Measure, Method, Row, Score};

/// Its build, once a frame.
pub(crate) const BUILD: Row = Row {
    name: "pyramid",
    title: "Min/max pyramid of a frame",
    unit: "pixel",
    errors: &[Measure {
        unit: "per 1000",
        name: "wrong",
        what: "tiles that differ from their own pixels",
        shown: true,
    }],
    sensors: &[Sensor::Exact, Sensor::Millimetres],
    scenes: &[],
    methods: |input| on_frame!(input, frame => methods(input, frame)),
    answers: None,
};

fn methods<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let (w, h) = input.size();
    let mut cells = vec![Cell::EMPTY; cells_needed(w, h)];
    let mut again = cells.clone();
    let run = move || _ = black_box(Pyramid::build(frame.depth(), &mut cells).map(|p| p.whole()));
    let score = move || {
        let Ok(pyramid) = Pyramid::build(frame.depth(), &mut again) else { return Score::of([f64::NAN]) };
        let (mut wrong, mut all) = (0, 0);
        for level in 0..pyramid.levels() {
            let (across, down) = pyramid.level_size(level);
            for (x, y) in (0..across * down).map(|i| (i % across, i / across)) {
                all += 1;
                wrong +=
                    usize::from(pyramid.cell(level, x, y) != Some(of_pixels(&frame, Pyramid::<D>::tile(level), x, y)));
            }
        }
        Score::of([1000.0 * wrong as f64 / f64::from(all)])
    };
    vec![Method::new("build", w * h, run, score)]
}

/// One tile, from its pixels.
fn of_pixels<D: DepthSample>(frame: &DepthFrame<'_, D>, tile: usize, x: usize, y: usize) -> Cell<D> {
    let (w, h) = frame.size();
    let mut cell = Cell::EMPTY;
    for y in y * tile..((y + 1) * tile).min(h) {
        for x in x * tile..((x + 1) * tile).min(w) {
            match frame.depth().get(x, y) {
                Some(v) if v.is_valid() => {
                    cell.min = if v < cell.min { v } else { cell.min };
                    cell.max = if v > cell.max { v } else { cell.max };
                }
                _ => cell.holes = cell.holes.saturating_add(1),
            }
        }
    }
    cell
}
