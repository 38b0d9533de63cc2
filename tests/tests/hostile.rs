//! Hostile input, table by table: each row gives the documented error or the documented "nothing", and none panics.
//! The fuzz targets look for the rows that nobody thought of.

use isobath::glam::{Mat4, Quat, Vec2, Vec3};
use isobath::ground::geometry::{Plane, Ray};
use isobath::ground::image::{ImageError, ImageView, ImageViewMut};
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::convention::Convention;
use isobath::sensing::camera::crop::CropMap;
use isobath::sensing::camera::pose::PoseError;
use isobath::sensing::camera::rectify::rectify;
use isobath::sensing::camera::screen::{ScreenFit, ScreenMap, ScreenOrientation};
use isobath::sensing::camera::{Camera, Distortion, Intrinsics, Pose};
use isobath::sensing::depth::confidence::{Limits, apply_limits};
use isobath::sensing::depth::decode::{self, ByteOrder, DecodeError, Disparity, Projective};
use isobath::sensing::depth::{DepthSample, DepthUnit};
use isobath::sensing::frame::{DepthFrame, FrameError};
use isobath::skipping::pyramid::{Cell, Pyramid, PyramidError, cells_needed};

const NAN: f32 = f32::NAN;
const INF: f32 = f32::INFINITY;

/// Sizes that images come in when something went wrong upstream, and the largest that are legal.
const SHAPES: [(usize, usize); 10] =
    [(0, 0), (0, 9), (9, 0), (1, 1), (1, 9), (9, 1), (3, 2), (17, 13), (65_535, 1), (1, 65_535)];

/// Depth values that are none, and a few that are.
const DEPTHS: [f32; 10] = [NAN, INF, f32::NEG_INFINITY, 0.0, -0.0, -1.0, f32::MAX, f32::MIN_POSITIVE, 1e-40, 1.5];

fn plain() -> Intrinsics {
    Intrinsics::new(120.0, 120.0, 8.0, 6.0).unwrap()
}

fn cycle<T: Copy>(values: &[T], count: usize) -> Vec<T> {
    values.iter().copied().cycle().take(count).collect()
}

#[test]
fn images_of_impossible_shape() {
    let data = [0_u16; 12];
    let too_short = |needed| Err(ImageError::TooShort { needed, got: 12 });
    let rows: [(usize, usize, usize, Result<(), ImageError>); 8] = [
        (4, 3, 4, Ok(())),
        (0, 0, 0, Ok(())),
        (4, 3, 3, Err(ImageError::StrideBelowWidth { stride: 3, width: 4 })),
        (4, 3, 0, Err(ImageError::StrideBelowWidth { stride: 0, width: 4 })),
        (4, 4, 4, too_short(16)),
        (1, usize::MAX, usize::MAX, too_short(usize::MAX)),
        (usize::MAX, 1, usize::MAX, too_short(usize::MAX)),
        (65_535, 1, 65_535, too_short(65_535)),
    ];
    for (width, height, stride, want) in rows {
        let got = ImageView::with_stride(&data, width, height, stride).map(|_| ());
        assert_eq!(got, want, "{width}x{height} stride {stride}");
        let mut data = data;
        assert_eq!(ImageViewMut::with_stride(&mut data, width, height, stride).map(|_| ()), want);
    }
}

#[test]
fn intrinsics_no_camera_has() {
    let rows: [([f32; 4], &str); 12] = [
        ([0.0, 1.0, 0.0, 0.0], "fx"),
        ([NAN, 1.0, 0.0, 0.0], "fx"),
        ([INF, 1.0, 0.0, 0.0], "fx"),
        ([1e-4, 1.0, 0.0, 0.0], "fx"),
        ([1e8, 1.0, 0.0, 0.0], "fx"),
        ([1.0, -0.0, 0.0, 0.0], "fy"),
        ([1.0, NAN, 0.0, 0.0], "fy"),
        ([1.0, f32::NEG_INFINITY, 0.0, 0.0], "fy"),
        ([1.0, 1.0, NAN, 0.0], "cx"),
        ([1.0, 1.0, -1e7, 0.0], "cx"),
        ([1.0, 1.0, 0.0, INF], "cy"),
        ([NAN, NAN, NAN, NAN], "fx"),
    ];
    for ([fx, fy, cx, cy], name) in rows {
        let error = Intrinsics::new(fx, fy, cx, cy).unwrap_err();
        assert_eq!(error.name, name, "{fx} {fy} {cx} {cy}");
        assert!(error.to_string().contains(name));
    }
    assert!(Intrinsics::new(500.0, -500.0, 0.0, 0.0).is_ok(), "y up is legal");
    for (angle, width, height) in
        [(0.0, 640, 480), (NAN, 640, 480), (INF, 640, 480), (-1.0, 640, 480), (1.0, 0, 0), (1.0, usize::MAX, 1)]
    {
        assert!(Intrinsics::from_fov(angle, width, height).is_err(), "{angle} {width}x{height}");
    }
    for scale in [0.0, NAN, INF, 1e30] {
        assert!(plain().resized(scale, 1.0).is_err(), "{scale}");
    }
}

#[test]
fn points_no_camera_sees() {
    let lenses = [
        Distortion::None,
        Distortion::Brown5([-0.3, 0.1, 0.001, 0.001, 0.0]),
        Distortion::Brown8([NAN; 8]),
        Distortion::Brown8([INF; 8]),
        Distortion::Brown8([f32::MAX; 8]),
        Distortion::Brown8([0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0]),
    ];
    let bad = [
        Vec3::ZERO,
        Vec3::NEG_Z,
        Vec3::new(0.0, 0.0, -0.0),
        Vec3::new(NAN, 0.0, 1.0),
        Vec3::new(0.0, INF, 1.0),
        Vec3::new(0.0, 0.0, NAN),
        Vec3::splat(INF),
        Vec3::new(f32::MAX, 0.0, 1.0),
    ];
    for lens in lenses {
        let camera = Camera { intrinsics: plain(), distortion: lens };
        for point in bad {
            assert_eq!(camera.project(point), None, "{lens:?} {point}");
        }
        for pixel in [Vec2::splat(NAN), Vec2::splat(INF), Vec2::splat(f32::MAX), Vec2::ZERO] {
            assert!(camera.ray(pixel).is_none_or(Vec3::is_finite), "{lens:?} {pixel}");
        }
    }
    for k in [&[0.1; 1][..], &[0.1; 3], &[0.1; 6], &[0.1; 12], &[NAN; 5], &[INF; 8]] {
        assert_eq!(Distortion::from_slice(k), None, "{k:?}");
    }
}

#[test]
fn poses_that_are_not_rigid() {
    let not_unit = |q: Quat| matches!(Pose::new(q, Vec3::ZERO), Err(PoseError::NotUnitQuaternion { .. }));
    for q in [
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 2.0],
        [0.5, 0.5, 0.5, 0.0],
        [1e-30, 0.0, 0.0, 0.0],
        [1e30, 1e30, 0.0, 0.0],
    ] {
        assert!(not_unit(Quat::from_array(q)), "{q:?}");
    }
    // Text files round: this much is normalised away.
    let rounded = Pose::new(Quat::from_xyzw(0.0, 0.0, 0.0, 1.005), Vec3::ZERO).unwrap();
    assert!((rounded.rotation().length() - 1.0).abs() < 1e-6);
    for (q, t) in [
        (Quat::from_array([NAN, 0.0, 0.0, 1.0]), Vec3::ZERO),
        (Quat::IDENTITY, Vec3::splat(INF)),
        (Quat::IDENTITY, Vec3::new(0.0, NAN, 0.0)),
    ] {
        assert_eq!(Pose::new(q, t), Err(PoseError::NotFinite));
    }
    let is_rotation_error = |m| matches!(Pose::from_matrix(m), Err(PoseError::NotRotation { .. }));
    assert!(is_rotation_error(Mat4::from_scale(Vec3::splat(2.0))));
    assert!(is_rotation_error(Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0))), "a mirror");
    assert!(is_rotation_error(Mat4::from_cols_array(&[
        0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 1.
    ])));
    assert!(
        is_rotation_error(Mat4::from_cols_array(&[1., 0., 0., 0., 5., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.])),
        "a shear"
    );
    assert_eq!(Pose::from_matrix(Mat4::ZERO), Err(PoseError::NotAffine));
    assert_eq!(Pose::from_matrix(Mat4::NAN), Err(PoseError::NotFinite));
    assert_eq!(Pose::from_matrix(Mat4::from_translation(Vec3::X).transpose()), Err(PoseError::NotAffine), "transposed");
    assert!(Convention::Unity.pose_from_matrix(Mat4::NAN).is_err());
    for (eye, target, up) in [
        (Vec3::ZERO, Vec3::ZERO, Vec3::Y),
        (Vec3::ZERO, Vec3::Y, Vec3::Y),
        (Vec3::ZERO, Vec3::Z, Vec3::ZERO),
        (Vec3::NAN, Vec3::Z, Vec3::Y),
    ] {
        assert_eq!(Pose::looking_at(eye, target, up), None, "{eye} {target} {up}");
    }
}

#[test]
fn rays_planes_and_times_that_are_none() {
    for d in [Vec3::ZERO, Vec3::NAN, Vec3::splat(INF), Vec3::splat(1e-45)] {
        assert_eq!(Ray::new(Vec3::ZERO, d), None, "{d}");
        assert_eq!(Plane::through(Vec3::ZERO, d), None, "{d}");
    }
    assert_eq!(Ray::new(Vec3::NAN, Vec3::Z), None);
    assert_eq!(Plane::through(Vec3::splat(INF), Vec3::Z), None);
    for s in [f64::NAN, f64::INFINITY, 1e300, -1e10] {
        assert_eq!(Timestamp::from_seconds(s), None, "{s}");
    }
    for unit in [0.0, -1.0, NAN, INF, 1e-45, 1e-7, 1e4, 1e30] {
        assert!(DepthUnit::new(unit).is_err(), "{unit}");
    }
}

#[test]
fn maps_between_empty_images() {
    for empty in [(0, 0), (0, 5), (5, 0)] {
        assert_eq!(CropMap::centred(empty, (4, 4)), None);
        assert_eq!(CropMap::centred((4, 4), empty), None);
        for fit in [ScreenFit::Fill, ScreenFit::Fit, ScreenFit::Stretch] {
            assert_eq!(ScreenMap::new(ScreenOrientation::Portrait, empty, (4, 4), fit), None);
            assert_eq!(ScreenMap::new(ScreenOrientation::Portrait, (4, 4), empty, fit), None);
        }
    }
    let map = CropMap::centred((65_535, 1), (1, 65_535)).unwrap();
    for p in [Vec2::splat(NAN), Vec2::splat(INF), Vec2::splat(-1.0), Vec2::splat(1e9)] {
        assert_eq!(map.depth_from_colour(p), None);
        assert_eq!(map.colour_from_depth(p), None);
    }
}

#[test]
fn bytes_cut_off_anywhere() {
    for (width, height) in [(3_usize, 2_usize), (1, 9), (9, 1)] {
        let stride = 2 * width + 3;
        let needed = (height - 1) * stride + 2 * width;
        let bytes = vec![1; needed];
        let mut out = vec![0; width * height];
        for got in 0..=needed {
            let mut view = ImageViewMut::new(&mut out, width, height).unwrap();
            let result = decode::u16_bytes(&bytes[..got], stride, ByteOrder::Little, &mut view);
            let want = if got < needed { Err(DecodeError::TooShort { needed, got }) } else { Ok(width * height) };
            assert_eq!(result.map(|r| r.valid), want);
        }
        for narrow in 0..2 * width {
            let mut view = ImageViewMut::new(&mut out, width, height).unwrap();
            let result = decode::u16_bytes(&bytes, narrow, ByteOrder::Big, &mut view);
            assert_eq!(result, Err(DecodeError::StrideBelowRow { stride: narrow, row: 2 * width }));
        }
        let mut view = ImageViewMut::new(&mut out, width, height).unwrap();
        let huge = decode::u16_bytes(&bytes, usize::MAX, ByteOrder::Little, &mut view);
        assert_eq!(huge.is_ok(), height == 1, "only one row fits before the next starts");
    }
}

#[test]
fn decoders_of_every_shape_and_number() {
    let constants = [NAN, INF, 0.0, -1.0, f32::MAX, f32::MIN_POSITIVE, 1.0];
    for (width, height) in SHAPES {
        let raw = cycle(&DEPTHS, width * height);
        let words = cycle(&[0_u16, 1, 0x1fff, 0x2000, 0xffff], width * height);
        let (raw, words) =
            (ImageView::new(&raw, width, height).unwrap(), ImageView::new(&words, width, height).unwrap());
        let mut out = vec![7_u16; width * height];
        let mut out = ImageViewMut::new(&mut out, width, height).unwrap();
        let pixels = width * height;
        let sum = |r: decode::DecodeReport| r.valid + r.holes + r.out_of_range;
        assert_eq!(decode::metres(raw, DepthUnit::MILLIMETRE, &mut out).map(sum), Ok(pixels));
        assert_eq!(decode::depth16(words, &mut out, None).map(sum), Ok(pixels));
        for a in constants {
            // Seven values of each constant in turn; every pair would take minutes on the long images.
            let stereo = Disparity { focal: a, baseline: 0.1, offset: 0.0, scale: 1.0 };
            let good = (1e-12..=1e12).contains(&a);
            assert_eq!(decode::disparity(raw, stereo, DepthUnit::MILLIMETRE, &mut out).is_ok(), good, "focal {a}");
            let stereo = Disparity { focal: 500.0, offset: a, ..stereo };
            assert_eq!(
                decode::disparity(words, stereo, DepthUnit::MILLIMETRE, &mut out).is_ok(),
                a.is_finite(),
                "offset {a}"
            );
            let planes = Projective { near: 0.1, far: a };
            assert_eq!(decode::projective(raw, planes, DepthUnit::MILLIMETRE, &mut out).is_ok(), a > 0.1, "far {a}");
            let planes = Projective { near: a, far: INF };
            assert_eq!(decode::projective(raw, planes, DepthUnit::MILLIMETRE, &mut out).is_ok(), good, "near {a}");
        }
        // An output of another size.
        let mut other = vec![0_u16; (width + 1) * height];
        let mut other = ImageViewMut::new(&mut other, width + 1, height).unwrap();
        let mismatch = Err(DecodeError::SizeMismatch { input: (width, height), output: (width + 1, height) });
        assert_eq!(decode::metres(raw, DepthUnit::MILLIMETRE, &mut other), mismatch);
        assert_eq!(decode::depth16(words, &mut other, None), mismatch);
        let limits = Limits { min_z: NAN, max_z: NAN, min_confidence: 255 };
        let removed = apply_limits(&mut out, DepthUnit::MILLIMETRE, None, limits);
        assert!(removed <= pixels);
        assert!(out.as_view().rows().flatten().all(|v| !v.is_valid()), "limits that are not numbers believe nothing");
    }
}

#[test]
fn frames_and_pyramids_of_every_shape() {
    for (width, height) in SHAPES {
        let depth = cycle(&DEPTHS, width * height);
        let view = ImageView::new(&depth, width, height).unwrap();
        let frame = DepthFrame::new(view, DepthUnit::METRE, plain());
        for (x, y) in [(0, 0), (width, 0), (0, height), (usize::MAX, usize::MAX), (width / 2, height / 2)] {
            let z = frame.z(x, y);
            assert!(z >= 0.0 && z.is_finite());
            assert_eq!(frame.point(x, y).is_some(), z > 0.0);
            assert_eq!(frame.colour_at(x, y), None);
        }
        for p in [Vec3::NAN, Vec3::ZERO, Vec3::NEG_Z, Vec3::splat(INF), Vec3::Z] {
            assert!(frame.pixel_of_world(p).is_none_or(|(x, y)| x < width && y < height));
        }
        let wrong = ImageView::EMPTY;
        let confidence = frame.with_confidence(wrong).err();
        let differs = (width, height) != (0, 0);
        assert_eq!(
            confidence,
            differs.then_some(FrameError::ConfidenceSize { depth: (width, height), confidence: (0, 0) })
        );
        assert_eq!(frame.with_colour(ImageView::EMPTY).err(), Some(FrameError::EmptyColour));

        let needed = cells_needed(width, height);
        let mut storage = vec![Cell::EMPTY; needed];
        if needed > 0 {
            let short = Pyramid::build(view, &mut storage[1..]).err();
            assert_eq!(short, Some(PyramidError { needed, got: needed - 1 }));
        }
        let pyramid = Pyramid::build(view, &mut storage).unwrap();
        assert_eq!(pyramid.cell(usize::MAX, 0, 0), None);
        assert_eq!(pyramid.cell(0, usize::MAX, usize::MAX), None);
        assert_eq!(pyramid.level_size(usize::MAX), (0, 0));

        let mut out = vec![1.0; 12];
        let mut out = ImageViewMut::new(&mut out, 4, 3).unwrap();
        let lens = Camera { intrinsics: plain(), distortion: Distortion::Brown8([NAN; 8]) };
        rectify(view, &lens, &plain(), 0.0, &mut out);
        assert!(out.as_view().rows().flatten().all(|&v| v == 0.0), "a lens of NaN sees nothing");
    }
}
