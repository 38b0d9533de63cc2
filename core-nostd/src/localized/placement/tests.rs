use std::vec;
use std::vec::Vec;

use super::search::{SearchParams, find_place};
use super::*;
use crate::ground::image::ImageView;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::DepthUnit;
use crate::skipping::pyramid::{Cell, cells_needed};

const W: usize = 160;
const H: usize = 120;
const F: f32 = 120.0;

struct Rng(u64);

impl Rng {
    fn within(&mut self, lo: f32, hi: f32) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        lo + (hi - lo) * ((self.0 >> 40) as f32 / 16_777_216.0)
    }
}

/// A box that stands on y = `foot`, turned about the vertical: centre x and z, half width, height, half depth, angle.
#[derive(Debug, Clone, Copy)]
struct Block {
    x: f64,
    z: f64,
    foot: f64,
    half: [f64; 2],
    height: f64,
    angle: f64,
}

impl Block {
    /// Into its own axes: x, y up from its foot, z.
    fn local(&self, p: [f64; 3]) -> [f64; 3] {
        let (s, c) = self.angle.sin_cos();
        let (x, z) = (p[0] - self.x, p[2] - self.z);
        [c * x - s * z, p[1] - self.foot, s * x + c * z]
    }
    fn contains(&self, p: [f64; 3]) -> bool {
        let [x, y, z] = self.local(p);
        x.abs() < self.half[0] && z.abs() < self.half[1] && y > 0.0 && y < self.height
    }
    /// Where a ray enters it.
    fn enter(&self, o: [f64; 3], d: [f64; 3]) -> Option<f64> {
        let (a, b) = (self.local(o), self.local([o[0] + d[0], o[1] + d[1], o[2] + d[2]]));
        let bounds = [(-self.half[0], self.half[0]), (0.0, self.height), (-self.half[1], self.half[1])];
        let (mut t0, mut t1) = (0.0_f64, f64::INFINITY);
        for (i, (low, high)) in bounds.into_iter().enumerate() {
            let v = b[i] - a[i];
            let (p, q) = ((low - a[i]) / v, (high - a[i]) / v);
            t0 = t0.max(p.min(q));
            t1 = t1.min(p.max(q));
        }
        (t0 < t1).then_some(t0)
    }
}

/// A camera 1.4 m above the floor y = 0, looking down at it; y is up.
fn camera() -> Pose {
    Pose::looking_at(Vec3::new(0.0, 1.4, 0.0), Vec3::new(0.0, 0.0, 2.0), Vec3::Y).unwrap()
}

const K: Intrinsics = match Intrinsics::new(F, F, 79.5, 59.5) {
    Ok(k) => k,
    Err(_) => panic!(),
};

/// Depth of blocks on the floor, in f64, metres; holes above the horizon.
fn render(blocks: &[Block]) -> Vec<f32> {
    let pose = camera();
    let f = |v: Vec3| v.to_array().map(f64::from);
    let columns = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| f(pose.direction_to_world(axis)));
    let eye = f(pose.translation());
    (0..W * H)
        .map(|i| {
            let (u, v) = (((i % W) as f64 - 79.5) / f64::from(F), ((i / W) as f64 - 59.5) / f64::from(F));
            let d: [f64; 3] = core::array::from_fn(|k| u * columns[0][k] + v * columns[1][k] + columns[2][k]);
            let floor = if d[1] < -1e-3 { -eye[1] / d[1] } else { f64::INFINITY };
            let z = blocks.iter().filter_map(|b| b.enter(eye, d)).fold(floor, f64::min);
            if z < 12.0 { z as f32 } else { 0.0 }
        })
        .collect()
}

fn frame(data: &[f32]) -> DepthFrame<'_, f32> {
    DepthFrame::new(ImageView::new(data, W, H).unwrap(), DepthUnit::METRE, K).with_pose(camera())
}

fn cube(side: f32) -> PlaceParams {
    PlaceParams::new(Vec3::splat(side), Vec3::Y)
}

const POST: Block = Block { x: 0.0, z: 1.9, foot: 0.0, half: [0.05, 0.05], height: 0.3, angle: 0.3 };

#[test]
fn a_box_stands_on_the_floor_and_faces_the_camera() {
    let data = render(&[]);
    let spot = Vec3::new(0.2, 0.0, 2.0);
    let got = place(&frame(&data), None, Spot::World(spot), &cube(0.3)).outcome.unwrap();
    assert!((got.pose.centre - Vec3::new(0.2, 0.15, 2.0)).length() < 1e-3, "{got:?}");
    assert!((got.pose.rotation * Vec3::Y - Vec3::Y).length() < 1e-3);
    let forward = got.pose.rotation * Vec3::Z;
    let camera = Vec3::new(-0.2, 0.0, -2.0).try_normalize().unwrap();
    assert!((forward - camera).length() < 1e-3, "{forward}");
    assert!(got.tilt < 1e-3 && got.flatness < 1e-4 && got.coverage == 1.0, "{got:?}");
    let turned = PlaceParams { facing: Facing::Along(Vec3::new(1.0, 5.0, 0.0)), ..cube(0.3) };
    let got = place(&frame(&data), None, Spot::World(spot), &turned).outcome.unwrap();
    assert!((got.pose.rotation * Vec3::Z - Vec3::X).length() < 1e-3);
}

#[test]
fn on_a_slope_it_lies_flat_or_stands_on_its_lowest_corner() {
    // The floor, called sloping by asking with another up.
    let data = render(&[]);
    let up = Vec3::new(0.1, 1.0, 0.0).try_normalize().unwrap();
    for stand in [Stand::OnSurface, Stand::Upright] {
        let params = PlaceParams { up, stand, ..cube(0.3) };
        let got = place(&frame(&data), None, Spot::World(Vec3::new(0.0, 0.0, 2.0)), &params).outcome.unwrap();
        assert!((got.tilt - 0.1_f32.atan()).abs() < 1e-3, "{got:?}");
        let axis = got.pose.rotation * Vec3::Y;
        assert!((axis - if stand == Stand::Upright { up } else { Vec3::Y }).length() < 1e-3);
        let lowest = got.pose.corners().iter().fold(f32::INFINITY, |m, c| m.min(c.y));
        assert!(lowest.abs() < 1e-3, "{stand:?} {lowest}");
    }
    let level = PlaceParams { max_tilt: 0.05, up, ..cube(0.3) };
    let got = place(&frame(&data), None, Spot::World(Vec3::new(0.0, 0.0, 2.0)), &level).outcome;
    assert!(matches!(got, Err(NoPlace::TooSteep { tilt }) if (tilt - 0.0997).abs() < 1e-3), "{got:?}");
}

#[test]
fn it_says_what_is_wrong() {
    let spot = Spot::World(Vec3::new(0.0, 0.0, 1.9));
    let at = |data: &[f32], params: &PlaceParams| place(&frame(data), None, spot, params).outcome;
    let floor = render(&[]);

    // A post within the footprint, beside the spot.
    let post = render(&[POST]);
    let beside = place(&frame(&post), None, Spot::World(Vec3::new(0.12, 0.0, 1.85)), &cube(0.3)).outcome;
    assert!(matches!(beside, Err(NoPlace::Blocked { hidden }) if hidden > 0.02), "{beside:?}");

    // A post before the box hides part of it; with leave, that is no matter.
    let before = Block { x: 0.08, z: 1.55, half: [0.02, 0.02], ..POST };
    let hidden = render(&[before]);
    assert!(matches!(at(&hidden, &cube(0.3)), Err(NoPlace::Blocked { .. })), "{:?}", at(&hidden, &cube(0.3)));
    assert!(at(&hidden, &PlaceParams { max_hidden: 0.5, ..cube(0.3) }).is_ok());

    // The top of a block that is smaller than the box.
    let pedestal = render(&[Block { half: [0.12, 0.12], ..POST }]);
    let top = place(&frame(&pedestal), None, Spot::World(Vec3::new(0.0, 0.3, 1.9)), &cube(0.4)).outcome;
    assert!(matches!(top, Err(NoPlace::TooSmall { coverage }) if coverage < 0.7), "{top:?}");
    let fits = place(&frame(&pedestal), None, Spot::World(Vec3::new(0.0, 0.3, 1.9)), &cube(0.15)).outcome.unwrap();
    assert!((fits.pose.centre.y - 0.375).abs() < 2e-3, "{fits:?}");

    // The front of a large block.
    let wall = render(&[Block { z: 2.4, half: [1.0, 0.3], height: 1.5, angle: 0.0, ..POST }]);
    let front = place(&frame(&wall), None, Spot::World(Vec3::new(0.0, 0.7, 2.1)), &cube(0.3)).outcome;
    assert!(matches!(front, Err(NoPlace::TooSteep { tilt }) if tilt > 1.4), "{front:?}");

    // A rubble floor.
    let mut rng = Rng(9);
    let rubble: Vec<f32> = floor.iter().map(|z| z * (1.0 + rng.within(-0.03, 0.03))).collect();
    assert!(matches!(at(&rubble, &cube(0.3)), Err(NoPlace::TooRough { .. } | NoPlace::TooSteep { .. })));

    // Holes in the upper half of the box, where the floor behind should be.
    let (_, y) = frame(&floor).pixel_of_world(Vec3::new(0.0, 0.25, 1.9)).unwrap();
    let mut holes = floor.clone();
    for row in holes.chunks_mut(W).take(y + 4) {
        row.fill(0.0);
    }
    let policy = |holes_are| PlaceParams { holes: holes_are, ..cube(0.3) };
    let unknown = at(&holes, &policy(HolePolicy::Unknown));
    assert!(matches!(unknown, Err(NoPlace::Unknown { holes }) if holes > 0.2), "{unknown:?}");
    assert!(matches!(at(&holes, &policy(HolePolicy::Solid)), Err(NoPlace::Blocked { .. })));
    assert!(at(&holes, &policy(HolePolicy::Free)).is_ok());

    // Nothing there, and outside.
    let nothing = vec![0.0; W * H];
    assert_eq!(at(&nothing, &cube(0.3)), Err(NoPlace::NoSurface));
    let away = place(&frame(&floor), None, Spot::World(Vec3::new(0.0, 0.0, -3.0)), &cube(0.3)).outcome;
    assert_eq!(away, Err(NoPlace::OutsideView));
    let tall = PlaceParams { size: Vec3::new(0.3, 2.0, 0.3), ..cube(0.3) };
    assert_eq!(at(&floor, &tall), Err(NoPlace::OutsideView), "its head is not seen");
    let high = place(&frame(&floor), None, Spot::World(Vec3::new(0.0, 0.7, 1.9)), &cube(0.3)).outcome;
    assert_eq!(high, Err(NoPlace::NoSurface), "the spot hangs in the air");
}

#[test]
fn bad_arguments_have_answers() {
    let data = render(&[]);
    let at = |spot, params: &PlaceParams| place(&frame(&data), None, spot, params).outcome;
    let middle = Spot::Pixel(80, 60);
    for side in [0.0, -1.0, 1e-9, 1e9, f32::NAN, f32::INFINITY] {
        assert_eq!(at(middle, &cube(side)), Err(NoPlace::BadSize));
        for size in [Vec3::new(side, 0.1, 0.1), Vec3::new(0.1, side, 0.1), Vec3::new(0.1, 0.1, side)] {
            assert_eq!(at(middle, &PlaceParams { size, ..cube(0.1) }), Err(NoPlace::BadSize));
        }
    }
    for up in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
        assert_eq!(at(middle, &PlaceParams { up, ..cube(0.1) }), Err(NoPlace::BadUp));
    }
    for spot in [Spot::Pixel(W, 0), Spot::Pixel(0, usize::MAX), Spot::World(Vec3::NAN), Spot::World(Vec3::INFINITY)] {
        assert_eq!(at(spot, &cube(0.1)), Err(NoPlace::OutsideView), "{spot:?}");
    }
    let nan = f32::NAN;
    let strict = PlaceParams { max_tilt: nan, ..cube(0.1) };
    assert!(matches!(at(middle, &strict), Err(NoPlace::TooSteep { .. })));
    assert!(at(middle, &PlaceParams { facing: Facing::Along(Vec3::NAN), ..cube(0.1) }).is_ok());
    for bad in [
        PlaceParams { max_roughness: nan, ..cube(0.1) },
        PlaceParams { min_coverage: nan, ..cube(0.1) },
        PlaceParams { max_hidden: nan, ..cube(0.1) },
        PlaceParams { max_unknown: nan, ..cube(0.1) },
    ] {
        assert!(at(middle, &bad).is_err(), "{bad:?}");
    }
    for (w, h) in [(0, 0), (0, 5), (1, 1), (1, 90), (90, 1)] {
        let data = vec![1.0_f32; w * h];
        let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::METRE, K);
        let params = PlaceParams::new(Vec3::splat(0.01), Vec3::NEG_Z);
        assert!(place(&frame, None, Spot::Pixel(0, 0), &params).outcome.is_err());
        let mut best = [None; 2];
        let search = SearchParams { start: Some((usize::MAX, 0)), step: Some(0), max_tries: 50 };
        assert_eq!(find_place(&frame, None, &params, &search, &mut best).found, 0);
    }
    // A very wide image and the finest step: as much work as there are pixels, no more.
    let wide = vec![0_u16; 65_535];
    let frame = DepthFrame::new(ImageView::new(&wide, 65_535, 1).unwrap(), DepthUnit::MILLIMETRE, K);
    let search = SearchParams { start: Some((0, 0)), step: Some(1), max_tries: u32::MAX };
    assert_eq!(find_place(&frame, None, &cube(0.1), &search, &mut [None]).tried, 65_535);
    // A box below a pixel's size is not judged.
    let speck = PlaceParams { size: Vec3::splat(1e-3), ..cube(0.1) };
    assert!(at(Spot::World(Vec3::new(0.0, 0.0, 2.0)), &speck).is_err());
}

/// Random rooms: what is found does not meet what is there, with and without the pyramid, and the empty part is found.
#[test]
fn found_places_are_free() {
    let mut rng = Rng(0xfeed_beef);
    let (mut found, mut tried, mut work) = (0, 0, Work::default());
    for round in 0..60 {
        let blocks: Vec<Block> = (0..round % 12)
            .map(|_| Block {
                x: f64::from(rng.within(-1.2, 1.2)),
                z: f64::from(rng.within(0.9, 3.5)),
                foot: 0.0,
                half: [f64::from(rng.within(0.03, 0.25)), f64::from(rng.within(0.03, 0.25))],
                height: f64::from(rng.within(0.06, 0.6)),
                angle: f64::from(rng.within(-1.5, 1.5)),
            })
            .collect();
        let data = render(&blocks);
        let frame = frame(&data);
        let mut cells = vec![Cell::EMPTY; cells_needed(W, H)];
        let pyramid = Pyramid::build(frame.depth(), &mut cells).unwrap();
        let params = PlaceParams {
            size: Vec3::new(rng.within(0.1, 0.5), rng.within(0.05, 0.4), rng.within(0.1, 0.5)),
            ..cube(0.1)
        };
        let (mut best, mut again) = ([None; 4], [None; 4]);
        let report = find_place(&frame, Some(&pyramid), &params, &SearchParams::default(), &mut best);
        let full = find_place(&frame, None, &params, &SearchParams::default(), &mut again);
        assert_eq!(best, again, "the pyramid changes nothing");
        assert_eq!(full.work.done, report.work.done + report.work.skipped);
        assert_eq!((full.work.skipped, report.found), (0, best.iter().flatten().count()));
        assert!(round % 12 > 0 || report.found == 4, "an empty floor has room: {report:?}");
        let scores: Vec<f32> = best.iter().flatten().map(|p| p.score(&params)).collect();
        assert!(scores.is_sorted_by(|a, b| a >= b), "{scores:?}");
        (found, tried) = (found + report.found, tried + report.tried);
        work += report.work;
        for placement in best.iter().flatten() {
            let pose = placement.pose;
            // What a pixel can't see: its own width, and what is lower than the clearance.
            let blind = 1.5 * (pose.centre - camera().translation()).length() / F;
            let inner = pose.half - Vec3::new(blind, 0.0, blind);
            if inner.min_element() <= 0.0 {
                continue;
            }
            for i in 0..1000 {
                let unit = |k: usize| (k % 10) as f32 / 4.5 - 1.0;
                let mut p = inner * Vec3::new(unit(i), unit(i / 10), unit(i / 100));
                p.y = (p.y).max(-pose.half.y + params.clearance + blind);
                let p = (pose.centre + pose.rotation * p).to_array().map(f64::from);
                let hit = blocks.iter().find(|b| b.contains(p));
                assert!(hit.is_none(), "round {round}: {placement:?} meets {hit:?} at {p:?}");
            }
        }
    }
    std::println!("{found} places of {tried} spots, {:.3} of pixels skipped", work.skipped_share());
    assert!(found > 100, "{found}");
}

#[test]
fn a_search_is_bounded_and_says_so() {
    let data = render(&[]);
    let search = SearchParams { start: Some((10, 100)), step: Some(5), max_tries: 7 };
    let mut best = [None; 2];
    let report = find_place(&frame(&data), None, &cube(0.1), &search, &mut best);
    assert!(report.exhausted && report.tried == 7);
    let all = SearchParams { max_tries: u32::MAX, step: Some(16), start: None };
    let report = find_place(&frame(&data), None, &cube(0.1), &all, &mut []);
    assert!(!report.exhausted && report.found == 0);
    // Every pixel of the grid once: x = 0, 16, ..., 144 and y = 60 - 48, ..., 60 + 48.
    assert_eq!(report.tried, 10 * 7);
}
