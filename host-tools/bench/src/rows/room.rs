//! Is there room for a box? Verdicts against the geometry that is truly there.

use std::hint::black_box;

use isobath::glam::{Quat, Vec3};
use isobath::ground::geometry::OrientedBox;
use isobath::localized::collision::{CollisionParams, Verdict, box_points, vote};
use isobath::localized::placement::{Facing, NoPlace, PlaceParams, Spot, Stand, place};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath_sim::{Rigid, SimCamera, V3, v3 as v};

use crate::input::{Input, Random, Sensor, on_frame, vec3};
use crate::row::{Measure, Method, Row, Score};

/// Boxes on level surfaces.
pub(crate) const ROOM: Row = Row {
    name: "room",
    title: "Room for a box where the camera looks",
    unit: "query",
    errors: &[
        Measure {
            unit: "per 1000",
            name: "wrong",
            what: "called free with something in it, or blocked with nothing in it",
            shown: true,
        },
        Measure { unit: "per 1000", name: "unsure", what: "neither called free nor blocked", shown: true },
        Measure { unit: "per 1000", name: "false free", what: "called free with something in it", shown: false },
    ],
    sensors: Sensor::ALL,
    scenes: &["sphere", "corner", "stairs", "desk", "living-room", "corridor"],
    methods: |input| on_frame!(input, frame => methods(input, frame)),
    answers: None,
};

/// Height above the surface that the box stands on below which nothing counts, metres.
const CLEARANCE: f64 = 0.03;
const BOXES: usize = 150;

/// A box that stands at a pixel's point, and whether something is in it.
#[derive(Clone, Copy)]
struct Query {
    pixel: (usize, usize),
    size: Vec3,
    solid: OrientedBox,
    blocked: bool,
}

/// Boxes on level surfaces: with something in them, or empty and with nothing before them. What is empty but hidden nobody
/// can tell, and is not asked.
fn queries(input: &Input) -> Vec<Query> {
    let mut random = Random::new(input.seed ^ 0xb0c5);
    let mut out = Vec::new();
    for pixel in input.some_pixels(30 * BOXES) {
        let Some(point) = input.true_point(pixel.0, pixel.1) else { continue };
        let level = input.true_normal(pixel.0, pixel.1).map(|n| input.place.rotation.apply(V3::from(n)).y);
        if level.is_none_or(|y| y < 0.999) {
            continue;
        }
        let side = random.between(0.1, 0.35);
        let height = random.between(0.1, 0.5);
        let half = v(0.5 * side, 0.5 * (height - CLEARANCE), 0.5 * side);
        let centre = point + v(0.0, CLEARANCE + half.y, 0.0);
        let blocked = occupied(input, centre, half);
        let corners = (0..8).map(|i| {
            let sign = |bit: i32| if i & bit == 0 { -1.0 } else { 1.0 };
            centre + v(sign(1) * half.x, sign(2) * half.y, sign(4) * half.z)
        });
        if !blocked && !corners.chain([centre]).all(|p| input.sees(p, 0.0)) {
            continue;
        }
        let solid = OrientedBox { centre: vec3(centre), half: vec3(half), rotation: Quat::IDENTITY };
        let size = Vec3::new(side as f32, height as f32, side as f32);
        out.push(Query { pixel, size, solid, blocked });
        if out.len() == BOXES {
            break;
        }
    }
    out
}

/// Whether anything is in an upright box: whether a camera in its middle sees anything before the box's sides.
fn occupied(input: &Input, centre: V3, half: V3) -> bool {
    const N: usize = 12;
    [v(1.0, 0.0, 0.0), v(0.0, 1.0, 0.0), v(0.0, 0.0, 1.0)].into_iter().any(|axis| {
        [axis, -axis].into_iter().any(|towards| {
            let place = Rigid::looking_at(centre, centre + towards);
            let along = |a: V3| v(a.x.abs(), a.y.abs(), a.z.abs()).dot(half);
            let [x, y, z] = [place.rotation.x, place.rotation.y, place.rotation.z].map(along);
            // Pixels fill the side of the box exactly.
            let (fx, fy) = (0.5 * N as f64 * z / x, 0.5 * N as f64 * z / y);
            let middle = 0.5 * N as f64 - 0.5;
            let eye = SimCamera { width: N, height: N, fx, fy, cx: middle, cy: middle, lens: [0.0; 8] };
            input.scene.render_geometry(0.0, &eye, &place).z.iter().any(|&d| d > 0.0 && d < z)
        })
    })
}

fn methods<'a, D: DepthSample>(input: &'a Input, frame: DepthFrame<'a, D>) -> Vec<Method<'a>> {
    let queries = queries(input);
    if queries.is_empty() {
        return Vec::new();
    }
    let mut out = Vec::new();
    let thin = CollisionParams { tolerance: 0.03, ..CollisionParams::default() };
    let wary = CollisionParams { threshold: 0.0, ..thin };
    for (name, thirteen, params) in [
        ("vote, 8 points", false, CollisionParams::default()),
        ("vote, 13 points", true, CollisionParams::default()),
        ("13 points, 3 cm", true, thin),
        ("13 pts, 3 cm, any", true, wary),
    ] {
        let ask = move |q: &Query| {
            let verdict = if thirteen {
                vote(&frame, box_points(&q.solid, Vec3::Y), &params).verdict
            } else {
                vote(&frame, q.solid.corners(), &params).verdict
            };
            match verdict {
                Verdict::Free => Some(false),
                Verdict::Blocked => Some(true),
                Verdict::Unknown => None,
            }
        };
        out.push(method(name, &queries, ask));
    }
    let (w, h) = input.size();
    for (name, skipping) in [("place", false), ("place, pyramid", true)] {
        let cells = vec![Cell::EMPTY; cells_needed(w, h)];
        let mut storage = cells.clone();
        let (asked, judged) = (queries.clone(), queries.clone());
        let ask = move |pyramid: Option<&Pyramid<'_, D>>, q: &Query| {
            let params = PlaceParams {
                facing: Facing::Along(Vec3::Z),
                stand: Stand::Upright,
                clearance: CLEARANCE as f32,
                ..PlaceParams::new(q.size, Vec3::Y)
            };
            match place(&frame, pyramid, Spot::Pixel(q.pixel.0, q.pixel.1), &params).outcome {
                Ok(_) => Some(false),
                Err(NoPlace::Blocked { .. }) => Some(true),
                Err(_) => None,
            }
        };
        let mut again = cells;
        let run = move || {
            let pyramid = skipping.then(|| Pyramid::build(frame.depth(), &mut storage).ok()).flatten();
            asked.iter().for_each(|q| _ = black_box(ask(pyramid.as_ref(), q)));
        };
        out.push(Method::new(name, queries.len(), run, move || {
            let pyramid = skipping.then(|| Pyramid::build(frame.depth(), &mut again).ok()).flatten();
            judge(judged.iter().map(|q| (q.blocked, ask(pyramid.as_ref(), q))))
        }));
    }
    out
}

/// A method that needs nothing but the query.
fn method<'a>(name: &str, queries: &[Query], ask: impl Fn(&Query) -> Option<bool> + Copy + 'a) -> Method<'a> {
    let (asked, judged) = (queries.to_vec(), queries.to_vec());
    let run = move || asked.iter().for_each(|q| _ = black_box(ask(q)));
    Method::new(name, queries.len(), run, move || judge(judged.iter().map(|q| (q.blocked, ask(q)))))
}

/// From pairs of (truly blocked, called blocked or free or neither).
fn judge(answers: impl Iterator<Item = (bool, Option<bool>)>) -> Score {
    let (mut wrong, mut unsure, mut false_free, mut all) = (0, 0, 0, 0);
    for (truth, said) in answers {
        all += 1;
        match said {
            None => unsure += 1,
            Some(said) if said != truth => {
                wrong += 1;
                false_free += i32::from(truth);
            }
            Some(_) => {}
        }
    }
    Score::of([wrong, unsure, false_free].map(|n| 1000.0 * f64::from(n) / f64::from(all)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_knows_what_is_in_it() {
        let input = Input::new("corner", Sensor::Exact, (64, 48), 1).unwrap();
        // The scene's box: 0.5 x 0.3 x 0.35 at (-1.1, 0.15, -1.2), turned.
        assert!(occupied(&input, v(-1.1, 0.4, -1.2), v(0.05, 0.15, 0.05)), "reaches into it from above");
        assert!(!occupied(&input, v(-1.1, 0.5, -1.2), v(0.05, 0.15, 0.05)), "floats above it");
        assert!(occupied(&input, v(0.0, 0.05, -0.5), v(0.1, 0.06, 0.1)), "reaches into the floor");
        assert!(!occupied(&input, v(0.0, 0.07, -0.5), v(0.1, 0.06, 0.1)));
        let queries = queries(&input);
        assert!(queries.iter().any(|q| q.blocked) && queries.iter().any(|q| !q.blocked));
    }
}
