use super::dense::{planes, rows, rows_with_fit, scratch_len};
use super::*;
use crate::ground::image::{ImageView, ImageViewMut};
use crate::sensing::camera::Intrinsics;
use crate::sensing::depth::DepthUnit;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

/// Depth of the plane n · p = d in f64, rounded once.
fn plane_depth(k: &Intrinsics, (w, h): (usize, usize), n: [f64; 3], d: f64) -> Vec<f32> {
    let mut out = vec![0.0; w * h];
    for (i, z) in out.iter_mut().enumerate() {
        let u = ((i % w) as f64 - f64::from(k.cx())) / f64::from(k.fx());
        let v = ((i / w) as f64 - f64::from(k.cy())) / f64::from(k.fy());
        let value = d / (n[0] * u + n[1] * v + n[2]);
        // Beyond the horizon of a steep plane there is nothing to see.
        *z = if value > 0.0 && value < 1000.0 { value as f32 } else { 0.0 };
    }
    out
}

/// Angle in degrees between an estimate and the f64 truth.
fn error_deg(n: Vec3, truth: [f64; 3]) -> f64 {
    let a = [f64::from(n.x), f64::from(n.y), f64::from(n.z)];
    let cross =
        [a[1] * truth[2] - a[2] * truth[1], a[2] * truth[0] - a[0] * truth[2], a[0] * truth[1] - a[1] * truth[0]];
    let dot: f64 = a.iter().zip(truth).map(|(p, q)| p * q).sum();
    cross.iter().map(|c| c * c).sum::<f64>().sqrt().atan2(dot).to_degrees()
}

fn tilted(tilt_deg: f64, azimuth: f64) -> [f64; 3] {
    let t = tilt_deg.to_radians();
    [t.sin() * azimuth.cos(), t.sin() * azimuth.sin(), -t.cos()]
}

#[test]
fn exact_on_tilted_planes_anywhere_in_the_image() {
    let mut worst = 0.0_f64;
    for (size, f) in [((160, 120), 120.0), ((640, 480), 525.0), ((741, 500), 995.0)] {
        let k = Intrinsics::new(f, f, size.0 as f32 * 0.45, size.1 as f32 * 0.53).unwrap();
        for tilt in [0.0, 15.0, 45.0, 60.0, 75.0] {
            for azimuth in [0.0, 0.8, 2.0, 3.9, 5.5] {
                let n = tilted(tilt, azimuth);
                let depth = plane_depth(&k, size, n, -2.0);
                let view = ImageView::new(&depth, size.0, size.1).unwrap();
                let frame = DepthFrame::new(view, DepthUnit::METRE, k);
                let mut scratch = vec![0.0; scratch_len(size.0)];
                rows(&frame, &NormalParams::default(), &mut scratch, |y, row| {
                    for x in 0..size.0 {
                        if depth[y * size.0 + x] > 0.0 {
                            let got = Vec3::new(row.x[x], row.y[x], row.z[x]);
                            let e = error_deg(got, n);
                            assert!(e < 0.05, "{e} degrees at {x},{y}, tilt {tilt}, azimuth {azimuth}, f {f}");
                            worst = worst.max(e);
                            assert!((got.length() - 1.0).abs() < 1e-6);
                        } else {
                            assert!(row.x[x].is_nan());
                        }
                    }
                })
                .unwrap();
                // The wide fit is as exact, on a sample.
                for (x, y) in [(0, 0), (size.0 / 2, size.1 / 3), (size.0 - 1, size.1 - 1)] {
                    if let Some(e) = normal_at(&frame, x, y, &NormalParams::POINT) {
                        assert!(error_deg(e.normal, n) < 0.05, "fit at {x},{y}, tilt {tilt}: {e:?}");
                    }
                }
            }
        }
    }
    std::println!("worst error of exact normals on planes: {worst:.5} degrees");
}

#[test]
fn y_up_cameras_get_normals_in_their_own_frame() {
    let k = Intrinsics::new(481.2, -480.0, 79.5, 59.5).unwrap();
    let n = tilted(40.0, 1.1);
    let depth = plane_depth(&k, (160, 120), n, -1.5);
    let frame = DepthFrame::new(ImageView::new(&depth, 160, 120).unwrap(), DepthUnit::METRE, k);
    let e = normal_at(&frame, 30, 100, &NormalParams::default()).unwrap();
    assert!(error_deg(e.normal, n) < 0.01);
}

#[test]
fn a_step_edge_does_not_bend_the_normals_beside_it() {
    // Left half: a plane tilted 40 degrees; right half: a wall 1 m behind.
    let k = Intrinsics::new(200.0, 200.0, 31.5, 23.5).unwrap();
    let (n, wall) = (tilted(40.0, 0.3), tilted(0.0, 0.0));
    let (near, far) = (plane_depth(&k, (64, 48), n, -1.0), plane_depth(&k, (64, 48), wall, -3.0));
    let depth: Vec<f32> = (0..64 * 48).map(|i| if i % 64 < 30 { near[i] } else { far[i] }).collect();
    let frame = DepthFrame::new(ImageView::new(&depth, 64, 48).unwrap(), DepthUnit::METRE, k);
    for params in [NormalParams::default(), NormalParams::POINT] {
        for y in 0..48 {
            for x in 0..64 {
                let truth = if x < 30 { n } else { wall };
                let e = normal_at(&frame, x, y, &params).unwrap();
                assert!(error_deg(e.normal, truth) < 0.1, "{x},{y} {e:?}");
            }
        }
    }
}

#[test]
fn the_wide_fit_stays_on_its_side_of_any_step() {
    // Walls of many distances beside each other, seen from either side, with and without a hole in between.
    let k = Intrinsics::new(200.0, 200.0, 15.5, 15.5).unwrap();
    for far in [1.1_f32, 1.3, 2.0, 3.0, 8.0] {
        for hole in [false, true] {
            let depth: Vec<f32> = (0..32 * 32)
                .map(|i| match i % 32 {
                    16 if hole => 0.0,
                    0..=15 => 1.0,
                    _ => far,
                })
                .collect();
            let frame = DepthFrame::new(ImageView::new(&depth, 32, 32).unwrap(), DepthUnit::METRE, k);
            for radius in 1..=MAX_RADIUS {
                for x in (0..32).filter(|&x| depth[x] > 0.0) {
                    let e = normal_at(&frame, x, 12, &NormalParams { radius, ..NormalParams::default() }).unwrap();
                    let error = error_deg(e.normal, [0.0, 0.0, -1.0]);
                    assert!(error < 0.05, "far {far} hole {hole} radius {radius} x {x}: {error} {e:?}");
                }
            }
        }
    }
}

#[test]
fn one_hole_costs_nothing_and_gets_nothing() {
    let k = Intrinsics::new(200.0, 200.0, 31.5, 23.5).unwrap();
    let n = tilted(50.0, 2.2);
    let mut depth = plane_depth(&k, (64, 48), n, -1.0);
    depth[20 * 64 + 30] = f32::NAN;
    depth[20 * 64 + 33] = 65_535.0;
    depth[20 * 64 + 33] = f32::INFINITY;
    let frame = DepthFrame::new(ImageView::new(&depth, 64, 48).unwrap(), DepthUnit::METRE, k);
    for params in [NormalParams::default(), NormalParams::POINT] {
        assert_eq!(normal_at(&frame, 30, 20, &params), None);
        for x in [28, 29, 31, 32, 34] {
            let e = normal_at(&frame, x, 20, &params).unwrap();
            assert!(error_deg(e.normal, n) < 0.05, "{x}: {e:?}");
        }
    }
}

#[test]
fn paper_mode_is_the_repaired_algorithm() {
    let k = Intrinsics::new(120.0, 120.0, 79.5, 59.5).unwrap();
    // A wall: as printed 0/0; repaired, it faces the camera.
    let wall = vec![1.5_f32; 160 * 120];
    let frame = DepthFrame::new(ImageView::new(&wall, 160, 120).unwrap(), DepthUnit::METRE, k);
    assert_eq!(normal_at(&frame, 80, 60, &NormalParams::PAPER).unwrap().normal, Vec3::NEG_Z);
    // Right at the principal point it is close; 60 pixels off it is the 18 degrees off that the weak perspective costs.
    let n = tilted(45.0, 0.0);
    let depth = plane_depth(&k, (160, 120), n, -2.0);
    let frame = DepthFrame::new(ImageView::new(&depth, 160, 120).unwrap(), DepthUnit::METRE, k);
    let at = |x| error_deg(normal_at(&frame, x, 60, &NormalParams::PAPER).unwrap().normal, n);
    assert!(at(80) < 1.0, "{}", at(80));
    assert!((10.0..25.0).contains(&at(20)), "{}", at(20));
    assert!(error_deg(normal_at(&frame, 20, 60, &NormalParams::default()).unwrap().normal, n) < 0.01);
}

#[test]
fn noise_is_averaged_by_the_wide_fit() {
    let k = Intrinsics::new(525.0, 525.0, 159.5, 119.5).unwrap();
    let n = tilted(30.0, 1.0);
    let mut depth = plane_depth(&k, (320, 240), n, -1.5);
    let mut s = 12345_u32;
    for z in &mut depth {
        let mut uniform = || {
            s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(s >> 8) / f64::from(1 << 24)
        };
        let gauss = (-2.0 * uniform().max(1e-12).ln()).sqrt() * (core::f64::consts::TAU * uniform()).cos();
        *z += (gauss * 1.425e-3) as f32 * *z * *z;
    }
    let frame = DepthFrame::new(ImageView::new(&depth, 320, 240).unwrap(), DepthUnit::METRE, k);
    let mean = |params: &NormalParams| {
        let points = (10..310).step_by(7).flat_map(|x| (10..230).step_by(7).map(move |y| (x, y)));
        let errors: Vec<f64> =
            points.filter_map(|(x, y)| normal_at(&frame, x, y, params)).map(|e| error_deg(e.normal, n)).collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    let (cross, wide) = (mean(&NormalParams::default()), mean(&NormalParams::POINT));
    std::println!("mean error at 1.5 m with Kinect noise: cross {cross:.1}, 11x11 {wide:.2} degrees");
    assert!(wide < 6.0 && wide < cross / 4.0, "cross {cross}, wide {wide}");
}

fn random_depth(seed: u32, n: usize) -> Vec<u16> {
    let mut s = seed | 1;
    (0..n)
        .map(|_| {
            s ^= s << 13;
            s ^= s >> 17;
            s ^= s << 5;
            match s % 6 {
                0 => 0,
                1 => u16::MAX,
                _ => (s >> 16) as u16,
            }
        })
        .collect()
}

proptest! {
    #[test]
    fn dense_and_single_point_agree(w in 1_usize..40, h in 1_usize..12, seed in any::<u32>(), method in 0_usize..3) {
        let data = random_depth(seed, w * h);
        let k = Intrinsics::new(30.0, -31.0, 8.0, 5.0).unwrap();
        let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
        let params = [NormalParams::default(), NormalParams::PAPER, NormalParams { radius: 2, ..NormalParams::default() }][method];
        let mut scratch = vec![0.0; scratch_len(w)];
        let work = rows_with_fit(&frame, &params, &mut scratch, |y, row, fit| {
            for x in 0..w {
                let dense = [row.x[x], row.y[x], row.z[x], fit.residual[x], fit.support[x]];
                match normal_at(&frame, x, y, &params) {
                    Some(e) => {
                        assert_eq!([e.normal.x, e.normal.y, e.normal.z, e.residual, f32::from(e.support)], dense, "{x},{y}");
                        assert!((e.normal.length() - 1.0).abs() < 1e-5);
                        let p = frame.point(x, y).unwrap();
                        assert!(method == 1 || e.normal.dot(p) <= 1e-6, "faces away at {x},{y}");
                    }
                    None => assert!(dense[0].is_nan()),
                }
            }
        }).unwrap();
        prop_assert_eq!((work.done + work.skipped) as usize, w * h);
        // The same numbers as f32 depth give the same bits.
        let float: Vec<f32> = data.iter().map(|&v| if v.is_valid() { f32::from(v) } else { f32::NAN }).collect();
        let as_float = DepthFrame::new(ImageView::new(&float, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
        for i in 0..w * h {
            prop_assert_eq!(normal_at(&frame, i % w, i / w, &params), normal_at(&as_float, i % w, i / w, &params));
        }
    }
}

proptest! {
    #[test]
    fn any_part_equals_the_whole(w in 1_usize..40, h in 1_usize..24, x in 0_usize..40, y in 0_usize..24,
                                 pw in 0_usize..40, ph in 0_usize..24, seed in any::<u32>(), paper in any::<bool>()) {
        let data = random_depth(seed, w * h);
        let k = Intrinsics::new(30.0, -31.0, 8.3, 5.7).unwrap();
        let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
        let params = if paper { NormalParams::PAPER } else { NormalParams::default() };
        let mut scratch = vec![0.0; scratch_len(w.max(pw))];
        let mut whole = vec![0_u32; w * h];
        rows(&frame, &params, &mut scratch, |y, n| {
            for x in 0..w { whole[y * w + x] = n.x[x].to_bits() ^ n.y[x].to_bits().rotate_left(9) ^ n.z[x].to_bits().rotate_left(17); }
        }).unwrap();
        let mut seen = 0;
        let part = dense::Region { x, y, width: pw, height: ph };
        dense::region(&frame, &params, part, &mut scratch, |row, n| {
            for (i, x) in (x..).enumerate().take(n.x.len()) {
                let bits = n.x[i].to_bits() ^ n.y[i].to_bits().rotate_left(9) ^ n.z[i].to_bits().rotate_left(17);
                assert_eq!(bits, whole[row * w + x], "{x},{row}");
                seen += 1;
            }
        }).unwrap();
        prop_assert_eq!(seen, pw.min(w.saturating_sub(x)) * ph.min(h.saturating_sub(y)));
    }

    #[test]
    fn updating_changed_tiles_equals_computing_everything(w in 1_usize..60, h in 1_usize..40, seed in any::<u32>(), changes in 0_usize..5) {
        use crate::sensing::depth::noise::DepthNoise;
        use crate::skipping::tiles::{Tile, TileMap, tiles_needed};
        let k = Intrinsics::new(30.0, 31.0, 8.3, 5.7).unwrap();
        let mut data: Vec<f32> = random_depth(seed, w * h).iter().map(|&v| f32::from(v)).collect();
        let (mut reference, mut tiles) = (vec![0.0; w * h], vec![Tile::NEW; tiles_needed(w, h)]);
        let mut map = TileMap::new(ImageViewMut::new(&mut reference, w, h).unwrap(), &mut tiles).unwrap();
        let mut scratch = vec![0.0; scratch_len(w)];
        // As `update` wants them: tiles that never had a reading are never written.
        let mut kept = vec![vec![f32::from_bits(u32::MAX); w * h]; 3];
        let mut fresh = kept.clone();
        fn views(planes: &mut [Vec<f32>], w: usize, h: usize) -> [ImageViewMut<'_, f32>; 3] {
            let mut planes = planes.iter_mut().map(|p| ImageViewMut::new(p, w, h).unwrap());
            core::array::from_fn(|_| planes.next().unwrap())
        }
        for round in 0..4 {
            let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
            let report = map.update(&frame, &DepthNoise::NONE);
            let params = NormalParams::default();
            let [mut x, mut y, mut z] = views(&mut kept, w, h);
            let work = dense::update(&frame, &map, &params, &mut scratch, [&mut x, &mut y, &mut z]).unwrap();
            let [mut x, mut y, mut z] = views(&mut fresh, w, h);
            planes(&frame, &params, &mut scratch, [&mut x, &mut y, &mut z], None).unwrap();
            for (a, b) in kept.iter().flatten().zip(fresh.iter().flatten()) {
                prop_assert_eq!(a.to_bits(), b.to_bits());
            }
            prop_assert_eq!((work.done + work.skipped) as usize, w * h);
            prop_assert!(round == 0 || report.changed as usize <= changes);
            for i in 0..changes {
                let at = (seed as usize).wrapping_mul(round + 7).wrapping_add(i * 7919) % (w * h);
                data[at] = (at % 5) as f32 * 300.0;
            }
        }
    }
}

#[test]
fn shapes_without_normals_give_none() {
    let k = Intrinsics::new(30.0, 30.0, 0.0, 0.0).unwrap();
    let data = vec![1000_u16; 65_535];
    for (w, h) in [(0, 0), (1, 1), (65_535, 1), (1, 65_535)] {
        let frame = DepthFrame::new(ImageView::new(&data, w, h).unwrap(), DepthUnit::MILLIMETRE, k);
        let mut scratch = vec![0.0; scratch_len(w)];
        for params in [NormalParams::default(), NormalParams::PAPER, NormalParams::POINT] {
            assert_eq!(normal_at(&frame, 0, 0, &params), None);
            rows(&frame, &params, &mut scratch, |_, row| assert!(row.x.iter().all(|v| v.is_nan()))).unwrap();
        }
    }
    let frame = DepthFrame::new(ImageView::new(&data, 2, 2).unwrap(), DepthUnit::MILLIMETRE, k);
    assert!(normal_at(&frame, 1, 1, &NormalParams::default()).is_some());
    assert_eq!(normal_at(&frame, 2, 1, &NormalParams::default()), None);
    let err = rows(&frame, &NormalParams::default(), &mut [], |_, _| ()).unwrap_err();
    assert_eq!(err, dense::DenseError::Scratch { needed: scratch_len(2), got: 0 });
}

#[test]
fn planes_must_fit() {
    let k = Intrinsics::new(30.0, 30.0, 0.0, 0.0).unwrap();
    let data = [1000_u16; 16];
    let frame = DepthFrame::new(ImageView::new(&data, 4, 4).unwrap(), DepthUnit::MILLIMETRE, k);
    let mut scratch = [0.0; scratch_len(4)];
    let (mut a, mut b, mut c) = ([0.0; 16], [0.0; 16], [0.0; 12]);
    let mut x = ImageViewMut::new(&mut a, 4, 4).unwrap();
    let mut y = ImageViewMut::new(&mut b, 4, 4).unwrap();
    let mut z = ImageViewMut::new(&mut c, 4, 3).unwrap();
    let err = planes(&frame, &NormalParams::default(), &mut scratch, [&mut x, &mut y, &mut z], None).unwrap_err();
    assert_eq!(err, dense::DenseError::Size { depth: (4, 4), output: (4, 3) });
}
