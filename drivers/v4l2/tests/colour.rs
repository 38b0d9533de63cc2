//! Colour against its definitions: the colour space in f64, the geometry of two cameras, and JPEG data that is none.

use isobath::glam::{Quat, Vec3};
use isobath::sensing::camera::{Camera, Distortion, Intrinsics, Pose};
use isobath_source::{HostNanos, OwnedFrame};
use isobath_v4l2::colour::{ColourView, Form, from_jpeg, from_yuv};
use proptest::prelude::*;

/// BT.601, limited range, as the standard has it.
fn oracle(y: u8, u: u8, v: u8) -> [f64; 3] {
    let (kr, kb) = (0.299, 0.114);
    let y = (f64::from(y) - 16.0) / 219.0;
    let (cb, cr) = ((f64::from(u) - 128.0) / 224.0, (f64::from(v) - 128.0) / 224.0);
    let (r, b) = (y + 2.0 * (1.0 - kr) * cr, y + 2.0 * (1.0 - kb) * cb);
    let g = (y - kr * r - kb * b) / (1.0 - kr - kb);
    [r, g, b].map(|c| (c * 255.0).clamp(0.0, 255.0))
}

#[test]
fn yuv_is_within_one_of_the_standard() {
    let mut worst = 0.0_f64;
    for y in 0..=255_u8 {
        for u in (0..=255_u8).step_by(5) {
            for v in (0..=255_u8).step_by(5) {
                let mut out = [[0; 3]; 2];
                from_yuv(&[y, u, 255 - y, v], 4, Form::Yuyv, 2, &mut out);
                for (out, y) in out.iter().zip([y, 255 - y]) {
                    for (a, b) in out.iter().zip(oracle(y, u, v)) {
                        worst = worst.max((f64::from(*a) - b).abs());
                    }
                }
                let mut other = [[0; 3]; 2];
                from_yuv(&[u, y, v, 255 - y], 4, Form::Uyvy, 2, &mut other);
                assert_eq!(out, other);
            }
        }
    }
    assert!(worst > 0.3 && worst < 1.0, "worst error {worst} of 255");
}

proptest! {
    #[test]
    fn rows_are_where_the_stride_says(width in 1_usize..20, height in 1_usize..8, padding in 0_usize..9, short in 0_usize..40) {
        let row = width.div_ceil(2) * 4;
        let stride = row + padding;
        // Grey of the row's number, and padding that is no grey.
        let mut bytes: Vec<u8> = Vec::new();
        for y in 0..height {
            bytes.extend((0..row).map(|i| if i % 2 == 0 { 20 + 10 * y as u8 } else { 128 }));
            bytes.extend(vec![0xff; padding]);
        }
        let mut out = vec![[7; 3]; width * height];
        from_yuv(&bytes, stride, Form::Yuyv, width, &mut out);
        for (i, p) in out.iter().enumerate() {
            let want = oracle(20 + 10 * (i / width) as u8, 128, 128)[0].round() as u8;
            prop_assert!(p[0] == p[1] && p[1] == p[2] && p[0].abs_diff(want) <= 1, "{:?} at {}", p, i);
        }
        // Fewer bytes, or more pixels: what is there is converted.
        let cut = bytes.len().saturating_sub(short);
        from_yuv(&bytes[..cut], stride, Form::Yuyv, width, &mut out);
        from_yuv(&bytes, 0, Form::Uyvy, 0, &mut out);
    }

    #[test]
    fn jpeg_that_is_none_is_an_error(noise in prop::collection::vec(any::<u8>(), 0..300), at in 0_usize..600, bit in 0_u8..8, cut in 0_usize..700) {
        let mut out = vec![[0; 3]; 16 * 8];
        prop_assert!(from_jpeg(&noise, (16, 8), &mut out).is_err());
        let mut bytes = jpeg(16, 8);
        let length = bytes.len();
        bytes[at % length] ^= 1 << bit;
        bytes.truncate(cut.max(1).min(length));
        let _ = from_jpeg(&bytes, (16, 8), &mut out);
    }
}

fn jpeg(width: u32, height: u32) -> Vec<u8> {
    let picture = image::RgbImage::from_fn(width, height, |x, _| {
        if x < width / 2 { image::Rgb([200, 30, 30]) } else { image::Rgb([30, 30, 200]) }
    });
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95).encode_image(&picture).unwrap();
    bytes
}

#[test]
fn jpeg_of_the_granted_size_alone_is_taken() {
    let mut out = vec![[0; 3]; 32 * 16];
    from_jpeg(&jpeg(32, 16), (32, 16), &mut out).unwrap();
    assert!(out[0][0] > 180 && out[0][2] < 60 && out[31][2] > 180, "{:?} {:?}", out[0], out[31]);
    for size in [(16, 32), (64, 64), (8, 8)] {
        assert!(from_jpeg(&jpeg(size.0, size.1), (32, 16), &mut out).is_err(), "{size:?}");
    }
}

/// A colour image whose luma says which column it is.
fn map(width: usize, height: usize) -> Vec<u8> {
    (0..height).flat_map(|_| (0..width).flat_map(|x| [16 + 2 * x as u8, 128])).collect()
}

#[test]
fn colour_is_seen_from_the_depth_camera() {
    // Twice the resolution, 5 cm to the right, turned by nothing: a point at z shows at f b / z to the left.
    let (w, h) = (64, 48);
    let k = Intrinsics::new(30.0, 30.0, 15.5, 11.5).unwrap();
    let c = Intrinsics::new(60.0, 60.0, 31.0, 23.0).unwrap();
    let pose = Pose::new(Quat::IDENTITY, Vec3::new(0.05, 0.0, 0.0)).unwrap();
    let mut view =
        ColourView::new(Form::Yuyv, (w, h), w * 2, Camera { intrinsics: c, distortion: Distortion::default() }, pose);
    let mut frame = OwnedFrame::new();
    let depth = frame.depth_u16_mut(32, 24);
    depth.fill(1000);
    depth[5] = 0;
    depth[32..64].fill(500);
    frame.intrinsics = k;
    // Before there is an image, and long after, there is no colour.
    view.colour(&mut frame, HostNanos(1_000_000_000));
    assert!(frame.colour().is_none());
    view.take(&map(w, h), HostNanos(1_000_000_000));
    view.colour(&mut frame, HostNanos(1_060_000_000));
    assert!(frame.colour().is_none(), "60 ms apart");
    view.colour(&mut frame, HostNanos(1_040_000_000));
    let colour = frame.colour().unwrap();
    assert_eq!(colour.get(5, 0), Some([0; 3]), "no depth, no colour");
    for (y, z) in [(0, 1.0), (1, 0.5), (12, 1.0)] {
        for x in 0..32_u32 {
            // In f64: the point, and where the colour camera has it.
            let point = ((f64::from(x) - 15.5) / 30.0 * z, (f64::from(y) - 11.5) / 30.0 * z);
            let at = ((60.0 * (point.0 - 0.05) / z + 31.0).round(), (60.0 * point.1 / z + 23.0).round());
            let got = colour.get(x as usize, y as usize).unwrap();
            if (y, x) == (0, 5) {
                continue;
            }
            if at.0 < 0.0 || at.0 >= 64.0 || at.1 < 0.0 || at.1 >= 48.0 {
                assert_eq!(got, [0; 3], "{x},{y} is outside");
                continue;
            }
            // Grey grows with the column by 2 * 255 / 219.
            let want = (2.0 * at.0) * 255.0 / 219.0;
            assert!((f64::from(got[2]) - want).abs() <= 1.6, "{x},{y}: {got:?}, at {at:?}, {want}");
        }
    }
    // A broken image takes the old one away.
    let mut jpeg_view = ColourView::new(Form::Mjpg, (w, h), 0, *view.camera(), *view.pose());
    jpeg_view.take(&jpeg(64, 48), HostNanos(5));
    jpeg_view.take(&[1, 2, 3], HostNanos(6));
    jpeg_view.colour(&mut frame, HostNanos(6));
    assert!(frame.colour().is_none() && jpeg_view.broken == 1);
}
