//! Skipping must change no answer: how much is skipped, what that gains, and whether the answers are the same.

use std::hint::black_box;

use isobath::glam::Vec3;
use isobath::localized::placement::{PlaceParams, Spot, place};
use isobath::localized::raycast::{RayParams, cast};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::Work;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

use crate::input::{Input, on_frame};
use crate::measure::{Effort, alternating};
use crate::report::Skip;
use crate::row::{Method, Score};
use crate::rows::raycast;

/// Every feature with a skipping path, on one input.
pub(crate) fn all(input: &Input, effort: &Effort) -> Vec<Skip> {
    on_frame!(input, frame => of(input, frame, effort))
}

fn of<D: DepthSample>(input: &Input, frame: DepthFrame<'_, D>, effort: &Effort) -> Vec<Skip> {
    let rays: Vec<_> = raycast::queries(input).into_iter().map(|q| q.ray).collect();
    let params = RayParams::default();
    let rays = compare(input, frame, effort, "ray cast, pyramid", &rays, |pyramid, ray| {
        let answer = cast(&frame, pyramid, ray, &params);
        (answer.outcome, answer.work)
    });
    let spots: Vec<_> = input.some_pixels(200).into_iter().map(|(x, y)| Spot::Pixel(x, y)).collect();
    let params = PlaceParams::new(Vec3::new(0.2, 0.3, 0.2), Vec3::Y);
    let spots = compare(input, frame, effort, "placement, pyramid", &spots, |pyramid, &spot| {
        let answer = place(&frame, pyramid, spot, &params);
        (answer.outcome, answer.work)
    });
    vec![rays, spots]
}

/// Asks every query with and without the pyramid. The pyramid's build is part of the time with it, once for all queries.
fn compare<Q, D: DepthSample, A: PartialEq>(
    input: &Input,
    frame: DepthFrame<'_, D>,
    effort: &Effort,
    feature: &'static str,
    queries: &[Q],
    ask: impl Fn(Option<&Pyramid<'_, D>>, &Q) -> (A, Work) + Copy,
) -> Skip {
    let (w, h) = input.size();
    let mut cells = vec![Cell::EMPTY; cells_needed(w, h)];
    let (mut work, mut different) = (Work::default(), 0);
    if let Ok(pyramid) = Pyramid::build(frame.depth(), &mut cells) {
        for q in queries {
            let (answer, saved) = ask(Some(&pyramid), q);
            work += saved;
            // NaN in an answer would count as a difference: rightly, as no answer holds one.
            different += usize::from(answer != ask(None, q).0);
        }
    }
    let none = || Score { errors: Vec::new() };
    let full = || queries.iter().for_each(|q| _ = black_box(ask(None, q)));
    let skipping = || {
        let pyramid = Pyramid::build(frame.depth(), &mut cells).ok();
        queries.iter().for_each(|q| _ = black_box(ask(pyramid.as_ref(), q)));
    };
    let n = queries.len();
    let mut methods = [Method::new("full", n, full, none), Method::new("skipping", n, skipping, none)];
    let times = alternating(&mut methods, effort);
    Skip {
        feature,
        scene: input.scene.name().to_owned(),
        size: input.size(),
        skipped: f64::from(work.skipped_share()),
        full: times[0],
        skipping: times[1],
        queries: n,
        different,
    }
}
