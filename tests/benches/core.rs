//! Run time of the core's kernels, one thread, baseline code of the target. Error figures stand in the tests that hold them
//! (`tests/`), named beside each group; `isobath bench` will print both side by side.
//!
//! `cargo bench` prints; nothing here passes or fails by time.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use isobath::glam::{Vec3, vec2};
use isobath::ground::geometry::Ray;
use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::normals::dense::{rows, scratch_len};
use isobath::localized::normals::{NormalParams, normal_at};
use isobath::localized::raycast::{RayParams, cast};
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::decode::{ByteOrder, u16_bytes};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

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

criterion_group!(benches, per_pixel, pyramid, queries);
criterion_main!(benches);
