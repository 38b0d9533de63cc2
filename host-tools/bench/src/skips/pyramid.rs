//! Ray casts and placement on one frame, with the min/max pyramid and without: the same answers to the last bit.

use std::hint::black_box;

use isobath::glam::{Vec3, vec2, vec3};
use isobath::ground::geometry::Ray;
use isobath::localized::placement::{PlaceParams, Spot, place};
use isobath::localized::plane::ground::{GroundParams, dominant_plane};
use isobath::localized::raycast::{RayParams, cast};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::Work;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

use crate::input::{Input, Random, on_frame};
use crate::measure::{Effort, alternating};
use crate::report::Skip;
use crate::row::{Method, Score};
use crate::rows::raycast;
use crate::sequence::{Depths, Sequence};

/// Rays; pixels that a box is put on.
const RAYS: usize = 300;
const SPOTS: usize = 200;

/// On a simulated frame, with the rays whose truth is known.
pub(crate) fn simulated(input: &Input, effort: &Effort) -> Vec<Skip> {
    let about = About { name: input.scene.name(), sensor: input.sensor.label() };
    let rays: Vec<_> = raycast::queries(input).into_iter().map(|q| q.ray).collect();
    let spots = input.some_pixels(SPOTS);
    on_frame!(input, frame => both(about, frame, &rays, &spots, Vec3::Y, effort))
}

/// On the middle frame of a recording, without truth: rays and spots from its own points.
pub(crate) fn recorded(sequence: &Sequence, seed: u64, effort: &Effort) -> Vec<Skip> {
    match &sequence.depth {
        Depths::U16(frames) => middle(sequence, frames, seed, effort),
        Depths::F32(frames) => middle(sequence, frames, seed, effort),
    }
}

fn middle<D: DepthSample>(sequence: &Sequence, frames: &[Vec<D>], seed: u64, effort: &Effort) -> Vec<Skip> {
    let Some(frame) = frames.get(frames.len() / 2).map(|depth| sequence.frame(depth)) else { return Vec::new() };
    let about = About { name: &sequence.name, sensor: sequence.sensor };
    let (w, h) = sequence.size;
    let mut random = Random::new(seed ^ 0x5eed);
    let pixels = (0..20 * RAYS).map(|_| (random.below(w), random.below(h)));
    let pixels: Vec<_> = pixels.filter(|&(x, y)| frame.point(x, y).is_some()).take(RAYS).collect();
    let mut random = Random::new(seed ^ 0xca57);
    let mut between = |low, high| random.between(low, high) as f32;
    let rays = pixels.iter().enumerate().filter_map(|(i, &(x, y))| {
        let origin = vec3(between(-0.5, 0.5), between(-0.3, 0.3), between(0.1, 0.6));
        // Every other one to a surface, every other one anywhere ahead.
        let anywhere = frame.intrinsics().ray(vec2(between(0.0, w as f64), between(0.0, h as f64)));
        let towards = if i % 2 == 0 { frame.point(x, y)? - origin } else { anywhere };
        Ray::new(origin, towards)
    });
    let rays: Vec<_> = rays.collect();
    // Its largest level surface says which way is up; the camera's own up is a guess.
    let up = dominant_plane(&frame, Vec3::NEG_Y, &GroundParams::DEFAULT).map_or(Vec3::NEG_Y, |g| g.fit.plane.normal());
    let spots = pixels.get(..SPOTS.min(pixels.len())).unwrap_or_default();
    both(about, frame, &rays, spots, up, effort)
}

/// What the answers are about, for the report.
#[derive(Clone, Copy)]
struct About<'a> {
    name: &'a str,
    sensor: &'static str,
}

fn both<D: DepthSample>(
    about: About<'_>,
    frame: DepthFrame<'_, D>,
    rays: &[Ray],
    spots: &[(usize, usize)],
    up: Vec3,
    effort: &Effort,
) -> Vec<Skip> {
    let params = RayParams::default();
    let rays = compare(about, frame, effort, "ray cast, pyramid", rays, |pyramid, ray| {
        let answer = cast(&frame, pyramid, ray, &params);
        (answer.outcome, answer.work)
    });
    let spots: Vec<_> = spots.iter().map(|&(x, y)| Spot::Pixel(x, y)).collect();
    let params = PlaceParams::new(Vec3::new(0.2, 0.3, 0.2), up);
    let spots = compare(about, frame, effort, "placement, pyramid", &spots, |pyramid, &spot| {
        let answer = place(&frame, pyramid, spot, &params);
        (answer.outcome, answer.work)
    });
    vec![rays, spots]
}

/// Asks every query with and without the pyramid. The pyramid's build is part of the time with it, once for all queries.
fn compare<Q, D: DepthSample, A: PartialEq>(
    about: About<'_>,
    frame: DepthFrame<'_, D>,
    effort: &Effort,
    feature: &'static str,
    queries: &[Q],
    ask: impl Fn(Option<&Pyramid<'_, D>>, &Q) -> (A, Work) + Copy,
) -> Skip {
    let (w, h) = frame.size();
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
        scene: about.name.to_owned(),
        kind: None,
        sensor: about.sensor,
        size: frame.size(),
        unit: "query",
        skipped: f64::from(work.skipped_share()),
        full: times[0],
        skipping: times[1],
        summary: None,
        queries: n,
        different,
        exact: true,
        change: None,
    }
}
