use super::*;
use crate::ground::image::ImageView;
use crate::sensing::camera::{Intrinsics, Pose};
use crate::sensing::depth::DepthUnit;
use glam::{Quat, Vec3};
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

/// A frame and what it borrows.
#[derive(Debug, Clone)]
struct Shot {
    size: (usize, usize),
    depth: Vec<u16>,
    colour: Vec<[u8; 3]>,
    pose: Pose,
    fov: f32,
}

impl Shot {
    fn frame(&self) -> DepthFrame<'_> {
        let (w, h) = self.size;
        DepthFrame::new(ImageView::new(&self.depth, w, h).unwrap(), DepthUnit::MILLIMETRE, self.intrinsics())
            .with_colour(ImageView::new(&self.colour, w, h).unwrap())
            .unwrap()
            .with_pose(self.pose)
    }

    fn intrinsics(&self) -> Intrinsics {
        Intrinsics::from_fov(self.fov, self.size.0, self.size.1).unwrap()
    }
}

/// Views of bumpy things around the origin, from a metre or so away.
fn shots(size: (usize, usize), count: usize) -> impl Strategy<Value = Vec<Shot>> {
    let one = (any::<u32>(), -1.0_f32..1.0, -1.0_f32..1.0, -1.0_f32..1.0, 0.5_f32..1.4).prop_map(
        move |(seed, x, y, z, fov)| {
            let eye = (Vec3::new(x, y, z) + Vec3::new(0.01, 0.02, 0.03)).normalize_or(Vec3::X) * 1.2;
            let mut state = seed;
            let mut next = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                state >> 8
            };
            let n = size.0 * size.1;
            // Patches at several depths, some holes, some far behind.
            let depth = (0..n).map(|i| match (i / 7 + i / size.0 / 5) % 6 {
                0 => 900 + (next() % 40) as u16,
                1 => 0,
                2 => 5000,
                _ => 1300 + (next() % 300) as u16,
            });
            let depth = depth.collect();
            let colour = (0..n).map(|_| [next() as u8, next() as u8, next() as u8]).collect();
            let pose = Pose::looking_at(eye, Vec3::ZERO, Vec3::new(0.2, 1.0, 0.1)).unwrap();
            Shot { size, depth, colour, pose, fov }
        },
    );
    prop::collection::vec(one, 1..=count)
}

/// A near field with its memory.
fn with_field<R>(preset: Preset, params: NearParams, act: impl FnOnce(NearField<'_>) -> R) -> R {
    let points = preset.views * preset.view_pixels();
    let (mut depth, mut colour) = (vec![7; points], vec![[7; 3]; points]);
    let mut layers = vec![7; preset.views * preset.level_pixels()];
    let (mut picture, mut strip) = (vec![[7; 4]; preset.level_pixels()], vec![7; preset.strip()]);
    let memory = NearMemory {
        depth: &mut depth,
        colour: &mut colour,
        layers: &mut layers,
        picture: &mut picture,
        strip: &mut strip,
    };
    act(NearField::new(preset, params, memory).unwrap())
}

fn pixels(near: &NearField<'_>) -> Vec<[u8; 4]> {
    near.picture().rows().flatten().copied().collect()
}

const HERE: MapFrame = MapFrame { at: Vec3::new(0.05, -0.1, 0.02), rotation: Quat::IDENTITY };
const SMALL: Preset = Preset { views: 3, view: (32, 24), levels: [64, 32, 8, 0], map: (64, 32) };
const MEDIUM: Preset = Preset { views: 3, view: (32, 24), levels: [48, 24, 0, 0], map: (32, 16) };
const ODD: Preset = Preset { views: 3, view: (32, 24), levels: [60, 20, 10, 2], map: (60, 30) };

/// The paper's form: every level projected by itself, scaled to the finest by the nearest pixel, merged by the nearest point, of two as near the finer level's.
fn separate_projections(preset: &Preset, shots: &[Shot], map: &MapFrame) -> Vec<[u8; 4]> {
    let bits = usize::BITS - (preset.view_pixels() - 1).leading_zeros();
    let (width, height) = preset.finest();
    // Distance, level, then which of the points.
    let mut best = vec![(u32::MAX, usize::MAX, u32::MAX, usize::MAX); width * height];
    for (level, &wide) in preset.levels.iter().enumerate().take_while(|(_, w)| **w > 0) {
        let layer = project::Layer { size: (wide, wide / 2), half_side: 1.0, pixel_bits: bits, thin: 0.0 };
        for (slot, shot) in shots.iter().enumerate() {
            let mut cells = vec![project::EMPTY; wide * wide / 2];
            let view = View::of(&shot.frame(), 0, preset.view).unwrap();
            layer.project(&view, &shot.depth, map, &mut cells);
            for (i, best) in best.iter_mut().enumerate() {
                let cell = cells[i / width * wide / width * wide + i % width * wide / width];
                if cell != project::EMPTY {
                    *best = (*best).min((cell >> bits, level, cell & ((1 << bits) - 1), slot));
                }
            }
        }
    }
    best.into_iter()
        .map(|(distance, _, pixel, slot)| {
            if distance == u32::MAX {
                return [0; 4];
            }
            let [r, g, b] = shots[slot].colour[pixel as usize];
            [r, g, b, 255]
        })
        .collect()
}

/// Without the points that lie on an edge between pixels of a level `wide` across, where rounding decides which pixel is theirs, for each level by itself.
fn off_edges(mut shots: Vec<Shot>, wide: &[usize], map: &MapFrame) -> Vec<Shot> {
    for shot in &mut shots {
        let (k, width) = (shot.intrinsics(), shot.size.0);
        for (i, depth) in shot.depth.iter_mut().enumerate() {
            let ray = k.ray(glam::Vec2::new((i % width) as f32, (i / width) as f32));
            let world = shot.pose.rotation() * (ray * (f32::from(*depth) * 1e-3)) + shot.pose.translation();
            let uv = crate::lighting::equirect::uv_of_direction(map.direction(world - map.at));
            let on_edge = |x: f32| (x - crate::ground::math::round(x)).abs() < 1e-3;
            if wide.iter().any(|w| on_edge(uv.x * *w as f32) || on_edge(uv.y * *w as f32 * 0.5)) {
                *depth = 0;
            }
        }
    }
    shots
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn one_projection_and_minima_are_the_papers_separate_projections(shots in shots((32, 24), 3)) {
        let shots = off_edges(shots, &[SMALL, MEDIUM, ODD].map(|p| p.levels[0]), &HERE);
        for preset in [SMALL, MEDIUM, ODD] {
            let got = with_field(preset, NearParams::PAPER, |mut near| {
                for (id, shot) in shots.iter().enumerate() {
                    near.insert(&shot.frame(), id as u32, &HERE).unwrap();
                }
                near.merge();
                pixels(&near)
            });
            let want = separate_projections(&preset, &shots, &HERE);
            prop_assert_eq!(&got, &want, "{:?}", preset.levels);
        }
    }

    #[test]
    fn points_land_where_double_precision_puts_them(shots in shots((32, 24), 1)) {
        let (shot, size) = (&shots[0], (1024, 512));
        let layer = project::Layer { size, half_side: 1.0, pixel_bits: 10, thin: 0.0 };
        let view = View::of(&shot.frame(), 0, (32, 24)).unwrap();
        let mut cells = vec![project::EMPTY; size.0 * size.1];
        layer.project(&view, &shot.depth, &HERE, &mut cells);
        for (i, cell) in cells.iter().enumerate().filter(|(_, c)| **c != project::EMPTY) {
            let pixel = (cell & 1023) as usize;
            let at = shot.frame().world_point(pixel % 32, pixel / 32).unwrap() - HERE.at;
            let [dx, dy, dz] = at.to_array().map(f64::from);
            let length = libm::sqrt(dx * dx + dy * dy + dz * dz);
            let u = 0.5 + libm::atan2(dx, -dz) / core::f64::consts::TAU;
            let v = libm::acos(dy / length) / core::f64::consts::PI;
            let (x, y) = (u * 1024.0 - (i % 1024) as f64, v * 512.0 - (i / 1024) as f64);
            // Within the pixel, but for a thousandth; column 0 may have come around the seam.
            prop_assert!((-2e-3..1.002).contains(&y) && ((-2e-3..1.002).contains(&x) || x > 1023.99), "{x} {y}");
            let distance = f64::from(cell >> 10) / f64::from(layer.steps());
            prop_assert!((distance - length).abs() < 1.1 / f64::from(layer.steps()) + 2e-6);
            prop_assert!(at.abs().max_element() < 1.000_01);
        }
    }

    #[test]
    fn thinning_is_off_unless_asked_and_only_leaves_points_out(shots in shots((96, 72), 2), thin in 0.1_f32..2.0) {
        let preset = Preset { views: 2, view: (96, 72), levels: [48, 0, 0, 0], map: (48, 24) };
        let draw = |thin| with_field(preset, NearParams { thin, seam: 0, ..NearParams::default() }, |mut near| {
            let mut skipped = 0;
            for (id, shot) in shots.iter().enumerate() {
                skipped += near.insert(&shot.frame(), id as u32, &HERE).unwrap().skipped;
            }
            near.merge();
            (pixels(&near), skipped)
        });
        let ((all, none), (thinned, skipped)) = (draw(NearParams::default().thin), draw(thin));
        prop_assert_eq!(none, 0);
        let lost = all.iter().zip(&thinned).filter(|(a, t)| a[3] > t[3]).count();
        prop_assert!(skipped > 0 || all == thinned);
        prop_assert!(all.iter().zip(&thinned).all(|(a, t)| a[3] >= t[3]), "a point from nowhere");
        prop_assert!(lost <= skipped);
    }

    #[test]
    fn what_is_done_step_by_step_is_as_if_done_at_once(shots in shots((32, 24), 6), moves in prop::collection::vec(0_usize..6, 1..12)) {
        with_field(SMALL, NearParams::default(), |mut near| {
            for (step, &i) in moves.iter().enumerate() {
                let shot = &shots[i % shots.len()];
                match step % 4 {
                    3 => _ = near.remove(i % 3),
                    2 => _ = near.correct(i % 3, shot.pose, &HERE),
                    _ => _ = near.insert(&shot.frame(), i as u32, &HERE).unwrap(),
                }
                let before = pixels(&near);
                let rows = near.merge();
                let after = pixels(&near);
                let changed = |i: usize| before[i] != after[i];
                let outside = (0..after.len()).filter(|&i| changed(i) && !(rows.0..rows.1).contains(&(i / 64))).count();
                assert_eq!(outside, 0, "rows said to be unchanged changed");
            }
            let stepwise = pixels(&near);
            // All layers anew, and the picture from nothing.
            near.project_all(&HERE);
            near.memory.picture.fill([9; 4]);
            near.drawn = (0, 32);
            near.merge();
            assert_eq!(stepwise, pixels(&near));
        });
    }
}

fn plain(size: (usize, usize), depth: u16) -> Shot {
    let n = size.0 * size.1;
    let pose = Pose::looking_at(Vec3::new(0.0, 0.0, 1.2), Vec3::ZERO, Vec3::Y).unwrap();
    Shot { size, depth: vec![depth; n], colour: vec![[10, 20, 30]; n], pose, fov: 1.1 }
}

#[test]
fn the_same_id_then_an_empty_slot_then_the_oldest_makes_room() {
    with_field(SMALL, NearParams::default(), |mut near| {
        let shot = plain((32, 24), 1300);
        let mut put = |id| {
            let report = near.insert(&shot.frame(), id, &HERE).unwrap();
            (report.slot, report.replaced)
        };
        assert_eq!([put(7), put(8), put(9)], [(0, None), (1, None), (2, None)]);
        assert_eq!(put(8), (1, Some(8)));
        assert_eq!(put(7), (0, Some(7)));
        assert_eq!(put(1), (2, Some(9)), "9 was observed longest ago");
        assert_eq!(put(2), (1, Some(8)));
        assert_eq!(near.len(), 3);
        assert!(near.remove(1) && !near.remove(1) && !near.remove(99));
        assert!(!near.correct(1, shot.pose, &HERE) && near.depth(1).is_none());
        assert_eq!(near.depth(0).unwrap().get(3, 3), Some(1300));
        assert_eq!(near.colour(0).unwrap().size(), (32, 24));
        near.remove(0);
        near.remove(2);
        near.merge();
        assert!(near.is_empty() && pixels(&near).iter().all(|p| *p == [0; 4]));
    });
}

#[test]
fn frames_of_other_sizes_are_brought_to_the_views() {
    with_field(SMALL, NearParams::default(), |mut near| {
        // Twice as fine: every second depth, mean colours.
        let mut shot = plain((64, 48), 1300);
        for (i, c) in shot.colour.iter_mut().enumerate() {
            *c = if i % 2 == 0 { [0; 3] } else { [255; 3] };
        }
        let report = near.insert(&shot.frame(), 0, &HERE).unwrap();
        assert_eq!((report.scale, report.points), (0.5, 32 * 24));
        // Half the light is not half the byte.
        assert!(near.colour(0).unwrap().rows().flatten().all(|c| *c == [188; 3]));
        let k = near.view(0).unwrap().intrinsics;
        assert!((k.fx() * 2.0 - shot.intrinsics().fx()).abs() < 1e-3 && (k.cx() - 15.5).abs() < 1e-4);
        // Smaller frames stay as they are.
        assert_eq!(near.insert(&plain((16, 12), 1300).frame(), 1, &HERE).unwrap().points, 16 * 12);
        // Another shape: as large as fits.
        let wide = near.insert(&plain((64, 16), 1300).frame(), 2, &HERE).unwrap();
        assert_eq!((near.view(2).unwrap().width, near.view(2).unwrap().height, wide.points), (32, 8, 256));
        // Nothing.
        let empty = near.insert(&DepthFrame::<u16>::new(ImageView::EMPTY, DepthUnit::MILLIMETRE, k), 3, &HERE);
        assert_eq!(empty, Err(NearError::View(ViewError::NoColour)));
    });
}

#[test]
fn colour_finer_than_depth_makes_finer_views_of_a_slope() {
    let preset = Preset { views: 1, view: (64, 48), levels: [64, 32, 0, 0], map: (64, 32) };
    with_field(preset, NearParams::default(), |mut near| {
        let k = Intrinsics::from_fov(1.1, 16, 12).unwrap();
        let depth: Vec<u16> =
            (0..16 * 12).map(|i| 1000 + (i % 16) as u16 * 20 + if i / 16 > 5 { 500 } else { 0 }).collect();
        let colour = vec![[50; 3]; 64 * 48];
        let frame = DepthFrame::new(ImageView::new(&depth, 16, 12).unwrap(), DepthUnit::MILLIMETRE, k)
            .with_colour(ImageView::new(&colour, 64, 48).unwrap())
            .unwrap()
            .with_pose(plain((1, 1), 1).pose);
        assert_eq!(near.insert(&frame, 0, &HERE).unwrap().scale, 4.0);
        let kept = near.depth(0).unwrap();
        // Between the columns, the slope; between the rows 5 and 6, the step: nothing in between.
        for x in 2..61 {
            let exact = 1000.0 + ((x as f32 + 0.5) / 4.0 - 0.5) * 20.0;
            assert!((f32::from(kept.get(x, 10).unwrap()) - exact).abs() <= 1.0, "{x}");
        }
        assert!(kept.rows().flatten().all(|d| (*d <= 1300) || (*d >= 1500)));
    });
}

#[test]
fn unsure_points_and_floats() {
    with_field(SMALL, NearParams::default(), |mut near| {
        let shot = plain((32, 24), 1300);
        let confidence: Vec<u8> = (0..32 * 24).map(|i| if i % 3 == 0 { 127 } else { 128 }).collect();
        let frame = shot.frame().with_confidence(ImageView::new(&confidence, 32, 24).unwrap()).unwrap();
        let report = near.insert(&frame, 0, &HERE).unwrap();
        assert_eq!((report.points, report.unsure), (512, 256));
        let depth = vec![1.3_f32; 32 * 24];
        let frame = DepthFrame::new(ImageView::new(&depth, 32, 24).unwrap(), DepthUnit::METRE, shot.intrinsics())
            .with_colour(ImageView::new(&shot.colour, 32, 24).unwrap())
            .unwrap();
        assert_eq!(near.insert(&frame, 1, &HERE), Err(NearError::View(ViewError::NoPose)));
        assert_eq!(near.insert(&frame.with_pose(shot.pose), 1, &HERE).unwrap().points, 768);
        assert_eq!(near.depth(1).unwrap().get(0, 0), Some(13_000));
    });
}

#[test]
fn short_memory_and_bad_sizes_are_named() {
    let memory = NearMemory::default();
    let error = NearField::new(SMALL, NearParams::default(), memory).unwrap_err();
    assert_eq!(error, NearError::Memory { name: "depth", needed: 3 * 32 * 24, got: 0 });
    assert!(std::format!("{error}").contains("depth has 0 elements, the preset needs 2304"));
    let bad = Preset { levels: [64, 24, 0, 0], ..SMALL };
    assert!(matches!(NearField::new(bad, NearParams::default(), NearMemory::default()), Err(NearError::Preset(_))));
}

#[test]
fn coverage_fades_towards_its_border_around_the_ring() {
    // A band over the seam, in the rows 4 to 12 of 16.
    let (width, height) = (32, 16);
    let mut picture = vec![[1, 2, 3, 0]; width * height];
    for y in 4..12 {
        for x in (0..width).filter(|x| !(10..22).contains(x)) {
            picture[y * width + x][3] = 255;
        }
    }
    seam::fade(&mut picture, width, (4, 12), 3);
    let cover = |x: usize, y: usize| picture[y * width + x][3];
    assert_eq!([cover(9, 7), cover(8, 7), cover(7, 7), cover(6, 7)], [85, 170, 255, 255]);
    assert_eq!([cover(22, 7), cover(23, 7), cover(24, 7)], [85, 170, 255]);
    assert_eq!([cover(0, 4), cover(0, 5), cover(0, 6)], [85, 170, 255]);
    assert_eq!([cover(31, 11), cover(31, 10), cover(31, 9), cover(15, 7)], [85, 170, 255, 0]);
    assert!(picture.iter().all(|p| p[..3] == [1, 2, 3]));
    // Poles have nothing beyond them.
    let mut whole = vec![[0, 0, 0, 255]; 64];
    seam::fade(&mut whole, 8, (0, 8), 3);
    assert!(whole.iter().all(|p| p[3] == 255));
    seam::fade(&mut [], 0, (0, 0), 3);
}

#[test]
fn a_point_on_the_place_itself_has_no_direction() {
    let mut shot = plain((32, 24), 0);
    shot.depth[12 * 32 + 16] = 1200;
    let at = shot.frame().world_point(16, 12).unwrap();
    with_field(SMALL, NearParams::PAPER, |mut near| {
        near.insert(&shot.frame(), 0, &MapFrame::at(at)).unwrap();
        near.merge();
        assert!(pixels(&near).iter().all(|p| p[3] == 0));
        near.project_all(&MapFrame::at(at + Vec3::Y * 0.01));
        near.merge();
        // Straight below: in the last row, in any column.
        assert!(near.picture().row(31).iter().any(|p| p[3] > 0));
    });
}
