//! Kernels over every pixel: decoding, projection, dense normals.

use std::hint::black_box;

use isobath::ground::image::{ImageView, ImageViewMut};
use isobath::localized::normals::adaptive::{self, AdaptiveParams, BlockSize};
use isobath::localized::normals::{NormalParams, dense};
use isobath::sensing::depth::DepthSample;
use isobath::sensing::depth::decode::format::Format;
use isobath::sensing::depth::decode::kinect::Constants;
use isobath::sensing::depth::decode::packed::y10b;
use isobath::sensing::depth::decode::{ByteOrder, depth16, u16_bytes};
use isobath::sensing::frame::DepthFrame;

use crate::room::{HEIGHT, PIXELS, Room, WIDTH};
use crate::{Kernel, counted};

const fn kernel(name: &'static str, run: fn()) -> Kernel {
    Kernel { name, answers: PIXELS, unit: "pixel", run }
}

pub(crate) const ALL: &[Kernel] = &[
    kernel("decode-u16-bytes", decode),
    kernel("decode-depth16", decode_depth16),
    kernel("decode-y10b", decode_y10b),
    kernel("decode-kinect", decode_kinect),
    kernel("unproject-and-project", there_and_back),
    kernel("normals-exact-u16", || normals(&Room::new().coarse(), &NormalParams::default())),
    kernel("normals-exact-f32", || normals(&Room::new().fine(), &NormalParams::default())),
    kernel("normals-paper", || normals(&Room::new().coarse(), &NormalParams::PAPER)),
    kernel("normals-adaptive-auto", || adaptive(BlockSize::Auto)),
    kernel("normals-adaptive-4", || adaptive(BlockSize::Four)),
    kernel("normals-adaptive-8", || adaptive(BlockSize::Eight)),
    kernel("normals-adaptive-16", || adaptive(BlockSize::Sixteen)),
];

fn decode() {
    let bytes: Vec<u8> = Room::new().millimetres.iter().flat_map(|v| v.to_be_bytes()).collect();
    let mut out = vec![0_u16; PIXELS];
    let mut out = image(&mut out);
    counted(|| u16_bytes(black_box(&bytes), WIDTH * 2, ByteOrder::Big, &mut out).is_ok());
}

fn decode_depth16() {
    let raw: Vec<u16> = Room::new().millimetres.iter().map(|v| v & 0x1fff | 0x6000).collect();
    let raw = ImageView::new(&raw, WIDTH, HEIGHT).unwrap_or_else(|e| unreachable!("one value a pixel: {e}"));
    let (mut depth, mut sure) = (vec![0_u16; PIXELS], vec![0_u8; PIXELS]);
    let (mut depth, mut sure) = (image(&mut depth), image(&mut sure));
    counted(|| depth16(black_box(raw), &mut depth, Some(&mut sure)).is_ok());
}

fn decode_y10b() {
    let bytes: Vec<u8> = (0..Format::Y10b.row_bytes(WIDTH) * HEIGHT).map(|i| (i * 31) as u8).collect();
    let mut out = vec![0_u16; PIXELS];
    let mut out = image(&mut out);
    counted(|| y10b(black_box(&bytes), Format::Y10b.row_bytes(WIDTH), &mut out).is_ok());
}

/// Codes of 11 bits into millimetres, in one pass.
fn decode_kinect() {
    let stride = Format::Kinect11.row_bytes(WIDTH);
    let bytes: Vec<u8> = (0..stride * HEIGHT).map(|i| (i * 31) as u8).collect();
    let table = Constants::NOMINAL.table().unwrap_or_else(|e| unreachable!("the nominal constants are usable: {e}"));
    let mut out = vec![0_u16; PIXELS];
    let mut out = image(&mut out);
    counted(|| black_box(&table).decode(black_box(&bytes), stride, &mut out).is_ok());
}

/// Every pixel into the world, and from there to its pixel again.
fn there_and_back() {
    let room = Room::new();
    let frame = room.coarse();
    counted(|| {
        let frame = black_box(&frame);
        let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
        pixels.filter_map(|(x, y)| frame.pixel_of_world(frame.world_point(x, y)?)).map(|(x, y)| x + y).sum::<usize>()
    });
}

fn normals<D: DepthSample>(frame: &DepthFrame<'_, D>, params: &NormalParams) {
    let mut scratch = vec![0.0; dense::scratch_len(WIDTH)];
    let mut sum = 0.0;
    counted(|| {
        let done = dense::rows(black_box(frame), params, &mut scratch, |_, n| sum += n.x[1] + n.y[1] + n.z[1]);
        (done.is_ok(), sum)
    });
}

fn adaptive(block: BlockSize) {
    let room = Room::noisy();
    let frame = room.fine();
    let params = AdaptiveParams { block, ..AdaptiveParams::default() };
    let mut scratch = vec![0.0; adaptive::scratch_len(WIDTH)];
    let mut sum = 0.0;
    counted(|| {
        let done = adaptive::rows(black_box(&frame), &params, &mut scratch, |_, n| sum += n.x[1] + n.y[1] + n.z[1]);
        (done.is_ok(), sum)
    });
}

fn image<T: Copy>(data: &mut [T]) -> ImageViewMut<'_, T> {
    ImageViewMut::new(data, WIDTH, HEIGHT).unwrap_or_else(|e| unreachable!("one value a pixel: {e}"))
}
