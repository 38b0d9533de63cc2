//! From a buffer's bytes to the frame type, beside a plain copy of the same bytes: 640x480.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use isobath::glam::{Quat, Vec3};
use isobath::sensing::camera::{Camera, Distortion, Intrinsics, Pose};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::decode::format::Format;
use isobath_source::{HostNanos, OwnedFrame, digest};
use isobath_v4l2::colour::{ColourView, Form, from_yuv};
use isobath_v4l2::decode::{Decoder, Meaning, stride};

const SIZE: (usize, usize) = (640, 480);

fn decoding(c: &mut Criterion) {
    let mut group = c.benchmark_group("v4l2");
    group.throughput(Throughput::Elements((SIZE.0 * SIZE.1) as u64));
    group.measurement_time(Duration::from_secs(2)).warm_up_time(Duration::from_millis(500));
    let bytes: Vec<u8> = (0..SIZE.0 * SIZE.1 * 2).map(|i| (i * 31 % 251) as u8).collect();
    let mut copy = vec![0; bytes.len()];
    group.bench_function("copy", |b| b.iter(|| black_box(&mut copy).copy_from_slice(black_box(&bytes))));
    let mut frame = OwnedFrame::new();
    for format in [Format::Z16, Format::Y16Be, Format::Y12, Format::Y10b] {
        let step = stride(format, SIZE.0, 0);
        let mut decoder = Decoder::new(format, SIZE, step, Meaning::Steps(DepthUnit::MILLIMETRE));
        group.bench_function(format.to_string(), |b| {
            b.iter(|| decoder.decode(black_box(&bytes[..decoder.need()]), &mut frame).is_ok());
        });
    }
    let mut rgb = vec![[0; 3]; SIZE.0 * SIZE.1];
    group.bench_function("YUYV", |b| {
        b.iter(|| from_yuv(black_box(&bytes), SIZE.0 * 2, Form::Yuyv, SIZE.0, black_box(&mut rgb)));
    });
    let k = Intrinsics::new(600.0, 600.0, 320.0, 240.0).expect("a plain camera");
    let pose = Pose::new(Quat::IDENTITY, Vec3::new(0.015, 0.0, 0.0)).expect("a plain pose");
    let mut view = ColourView::new(
        Form::Yuyv,
        SIZE,
        SIZE.0 * 2,
        Camera { intrinsics: k, distortion: Distortion::default() },
        pose,
    );
    view.take(&bytes, HostNanos(1));
    frame.intrinsics = k;
    frame.depth_u16_mut(SIZE.0, SIZE.1).fill(1500);
    group.bench_function("colour of the depth pixels", |b| b.iter(|| view.colour(black_box(&mut frame), HostNanos(1))));
    group.bench_function("digest", |b| b.iter(|| digest(black_box(&frame))));
    group.finish();
}

criterion_group!(benches, decoding);
criterion_main!(benches);
