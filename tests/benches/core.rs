//! Run time of the core's kernels, one thread, baseline code of the target. Error figures stand in the tests that hold them
//! (`tests/`), named beside each group; `isobath bench` will print both side by side.
//!
//! `cargo bench` prints; nothing here passes or fails by time.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use isobath::glam::{Vec3, vec2};
use isobath::ground::geometry::Ray;
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::normals::adaptive::{self, AdaptiveParams};
use isobath::localized::normals::dense::{rows, scratch_len};
use isobath::localized::normals::{NormalParams, normal_at};
use isobath::localized::planner::{Node, Plan, Planner, Walker};
use isobath::localized::raycast::{RayParams, cast};
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::decode::{ByteOrder, u16_bytes};
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};
use isobath::skipping::tiles::{Tile, TileMap, tiles_needed};

/// A room: floor, back wall, a box, some holes. Millimetres.
fn room(width: usize, height: usize) -> (Vec<u16>, Intrinsics) {
    let f = width as f32 * 0.82;
    let k = Intrinsics::new(f, f, width as f32 / 2.0 - 0.5, height as f32 / 2.0 - 0.5).unwrap();
    let depth = (0..width * height).map(|i| {
        let (x, y) = (i % width, i / width);
        let ray = k.ray(vec2(x as f32, y as f32));
        let floor = if ray.y > 0.0 { 1.2 / ray.y } else { f32::INFINITY };
        let mut z = floor.min(4.0);
        if ray.x.abs() < 0.15 && ray.y > -0.1 && floor > 1.8 {
            z = z.min(1.8);
        }
        // One pixel in a hundred is a hole.
        if (x * 7919 + y * 104_729) % 101 == 0 { 0 } else { (z * 1000.0) as u16 }
    });
    (depth.collect(), k)
}

fn per_pixel(c: &mut Criterion) {
    let (width, height) = (640, 480);
    let (depth, k) = room(width, height);
    let float: Vec<f32> = depth.iter().map(|v| v.metres(DepthUnit::MILLIMETRE)).collect();
    let mut group = c.benchmark_group("640x480 (error: tests/normals_truth.rs)");
    group.throughput(Throughput::Elements((width * height) as u64));
    let mut scratch = vec![0.0; scratch_len(width)];
    let frame = DepthFrame::new(ImageView::new(&depth, width, height).unwrap(), DepthUnit::MILLIMETRE, k);
    let metres = DepthFrame::new(ImageView::new(&float, width, height).unwrap(), DepthUnit::METRE, k);
    let exact = NormalParams::default();
    let mut sum = 0.0;
    group.bench_function("normals, exact, u16", |b| {
        b.iter(|| rows(black_box(&frame), &exact, &mut scratch, |_, n| sum += n.z[0]).unwrap());
    });
    group.bench_function("normals, exact, f32", |b| {
        b.iter(|| rows(black_box(&metres), &exact, &mut scratch, |_, n| sum += n.z[0]).unwrap());
    });
    let bytes: Vec<u8> = depth.iter().flat_map(|v| v.to_le_bytes()).collect();
    let mut decoded = vec![0_u16; width * height];
    group.bench_function("decode u16 bytes", |b| {
        let mut out = ImageViewMut::new(&mut decoded, width, height).unwrap();
        b.iter(|| u16_bytes(black_box(&bytes), width * 2, ByteOrder::Little, &mut out).unwrap());
    });
    group.finish();
    black_box(sum);
}

/// Depth with a Kinect's noise, from a seed: what the adaptive estimator is for.
fn noisy(metres: &[f32]) -> Vec<f32> {
    let mut state = 1_u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) as f32 + 0.5) / (1_u64 << 31) as f32
    };
    let mut gauss = move || (-2.0 * uniform().ln()).sqrt() * (std::f32::consts::TAU * uniform()).cos();
    metres.iter().map(|z| z + 1.425e-3 * z * z * gauss()).collect()
}

fn adaptive_normals(c: &mut Criterion) {
    let (width, height) = (640, 480);
    let (depth, k) = room(width, height);
    let exact: Vec<f32> = depth.iter().map(|v| v.metres(DepthUnit::MILLIMETRE)).collect();
    let kinect = noisy(&exact);
    let mut scratch = vec![0.0; adaptive::scratch_len(width)];
    let mut sum = 0.0;
    let mut group = c.benchmark_group("640x480 adaptive normals (error: normals/adaptive/tests.rs)");
    group.throughput(Throughput::Elements((width * height) as u64));
    let noisy = DepthFrame::new(ImageView::new(&kinect, width, height).unwrap(), DepthUnit::METRE, k);
    let steps = DepthFrame::new(ImageView::new(&depth, width, height).unwrap(), DepthUnit::MILLIMETRE, k);
    group.bench_function("Kinect noise, f32", |b| {
        let params = AdaptiveParams::default();
        b.iter(|| adaptive::rows(black_box(&noisy), &params, &mut scratch, |_, n| sum += n.z[0]).unwrap());
    });
    group.bench_function("1 mm steps, u16", |b| {
        let params = AdaptiveParams { noise: DepthNoise::NONE, ..AdaptiveParams::default() };
        b.iter(|| adaptive::rows(black_box(&steps), &params, &mut scratch, |_, n| sum += n.z[0]).unwrap());
    });
    group.finish();
    black_box(sum);
}

/// A* over 128 x 128 cells of 5 cm: open floor, and a comb of walls that makes it expand nearly every free cell.
fn planning(c: &mut Criterion) {
    let side = 128;
    let open = vec![0.0; side * side];
    let comb: Vec<f32> = (0..side * side)
        .map(|i| {
            let (x, y) = (i % side, i / side);
            let gap = if (x / 8) % 2 == 0 { y > 120 } else { y < 8 };
            if x % 8 == 4 && !gap { 1.0 } else { 0.0 }
        })
        .collect();
    let mut group = c.benchmark_group("plan on 128x128 cells (optimal: planner/tests.rs)");
    for (name, heights) in [("open floor", open), ("comb of walls", comb)] {
        let grid = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::NEG_Z, 0.05, side, side).unwrap();
        let mut cells = vec![HeightCell::UNKNOWN; side * side];
        let mut map = HeightMap::new(grid, &mut cells, HeightMapParams::DEFAULT).unwrap();
        for (i, &h) in heights.iter().enumerate() {
            map.set(i % side, i / side, h, h);
        }
        let mut nodes = vec![Node::EMPTY; side * side];
        let mut points = [Vec3::ZERO; 256];
        let (from, to) = (grid.point_of(1, 1, 0.0), grid.point_of(126, 60, 0.0));
        let walker = Walker { radius: 0.05, ..Walker::DEFAULT };
        let plan = Planner::new(&mut nodes).plan(&map, &walker, from, to, &mut points).unwrap();
        assert!(matches!(plan, Plan::Found(_)), "{plan:?}");
        group.bench_function(name, |b| {
            b.iter(|| Planner::new(&mut nodes).plan(black_box(&map), &walker, from, to, &mut points).unwrap());
        });
    }
    group.finish();
}

fn pyramid(c: &mut Criterion) {
    let mut group = c.benchmark_group("min/max pyramid (exact)");
    for (width, height) in [(160, 120), (640, 480)] {
        let (depth, _) = room(width, height);
        let view = ImageView::new(&depth, width, height).unwrap();
        let mut cells = vec![Cell::EMPTY; cells_needed(width, height)];
        group.throughput(Throughput::Elements((width * height) as u64));
        group.bench_function(BenchmarkId::from_parameter(format!("{width}x{height}")), |b| {
            b.iter(|| Pyramid::build(black_box(view), &mut cells).unwrap().whole());
        });
    }
    group.finish();
}

/// The tile map on a frame that is new, the same to the last bit, and the same but for noise.
fn tiles(c: &mut Criterion) {
    let (width, height) = (640, 480);
    let (depth, k) = room(width, height);
    let exact: Vec<f32> = depth.iter().map(|v| v.metres(DepthUnit::MILLIMETRE)).collect();
    let kinect = noisy(&exact);
    let shifted: Vec<f32> = exact.iter().map(|z| z * 1.1).collect();
    let frame = |image| DepthFrame::new(ImageView::new(image, width, height).unwrap(), DepthUnit::METRE, k);
    let mut group = c.benchmark_group("640x480 tile map (exact: skipping/tiles)");
    group.throughput(Throughput::Elements((width * height) as u64));
    for (name, images, noise) in [
        ("all new", [&exact, &shifted], DepthNoise::KINECT),
        ("the same", [&exact, &exact], DepthNoise::NONE),
        ("noise", [&exact, &kinect], DepthNoise::KINECT),
    ] {
        let mut reference = vec![0.0; width * height];
        let mut tiles = vec![Tile::NEW; tiles_needed(width, height)];
        let mut map = TileMap::new(ImageViewMut::new(&mut reference, width, height).unwrap(), &mut tiles).unwrap();
        let mut turn = 0;
        group.bench_function(name, |b| {
            b.iter(|| {
                turn ^= 1;
                map.update(black_box(&frame(images[turn])), &noise)
            });
        });
    }
    group.finish();
}

fn queries(c: &mut Criterion) {
    let (width, height) = (640, 480);
    let (depth, k) = room(width, height);
    let frame = DepthFrame::new(ImageView::new(&depth, width, height).unwrap(), DepthUnit::MILLIMETRE, k);
    let mut cells = vec![Cell::EMPTY; cells_needed(width, height)];
    let pyramid = Pyramid::build(frame.depth(), &mut cells).unwrap();
    let mut group = c.benchmark_group("one query (error: unit tests of each module)");
    // A different place each time, so that the branch predictor learns nothing.
    let mut i = 0_usize;
    let mut next = move || {
        i = (i + 7919) % (width * height);
        (i % width, i / width)
    };
    for (name, params) in [
        ("normal, cross", NormalParams::default()),
        ("normal, 11x11 fit", NormalParams::POINT),
        ("normal, paper", NormalParams::PAPER),
    ] {
        group.bench_function(name, |b| {
            b.iter(|| {
                let (x, y) = next();
                black_box(normal_at(black_box(&frame), x, y, &params));
            });
        });
    }
    for (name, params) in [
        ("hit test", HitParams::default()),
        ("hit test without normal", HitParams { normal: None, ..HitParams::default() }),
    ] {
        group.bench_function(name, |b| {
            b.iter(|| {
                let (x, y) = next();
                black_box(hit_test(black_box(&frame), vec2(x as f32 + 0.3, y as f32 - 0.2), &params));
            });
        });
    }
    // From beside the camera, across the view, to a pixel's point.
    let origin = Vec3::new(-0.8, -0.3, 0.5);
    for (name, skipping) in [("ray cast, every pixel", None), ("ray cast, pyramid", Some(&pyramid))] {
        group.bench_function(name, |b| {
            b.iter(|| {
                let (x, y) = next();
                let target = frame.point(x, y).unwrap_or(Vec3::Z);
                let ray = Ray::new(origin, target - origin).unwrap();
                black_box(cast(black_box(&frame), skipping, &ray, &RayParams::default()));
            });
        });
    }
    group.finish();
}

criterion_group!(benches, per_pixel, adaptive_normals, pyramid, tiles, queries, planning);
criterion_main!(benches);
