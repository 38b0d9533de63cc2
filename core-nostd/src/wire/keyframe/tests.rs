//! Every kind there and back, and every way in which bytes go wrong.

use glam::{Quat, Vec3, vec3};
use proptest::prelude::*;
use std::string::ToString;
use std::vec;
use std::vec::Vec;

use super::*;
use crate::ground::image::{ImageView, ImageViewMut};
use crate::sensing::depth::DepthUnit;
use crate::sensing::frame::DepthFrame;

/// A picture made from a seed: slopes, holes, noise.
struct Scene {
    width: usize,
    height: usize,
    depth: Vec<u16>,
    colour: Vec<[u8; 3]>,
    sure: Vec<u8>,
}

impl Scene {
    fn new(width: usize, height: usize, seed: u32) -> Self {
        let mut s = seed | 1;
        let mut next = || {
            s ^= s << 13;
            s ^= s >> 17;
            s ^= s << 5;
            s >> 4
        };
        let mut depth = Vec::new();
        let mut colour = Vec::new();
        let mut sure = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let z = 600 + 20 * x + 7 * y + next() as usize % 5;
                depth.push(match next() % 9 {
                    0 => 0,
                    1 if seed.is_multiple_of(3) => u16::MAX,
                    _ => z as u16,
                });
                colour.push([(4 * x) as u8, (6 * y) as u8, (next() % 32) as u8]);
                sure.push(next() as u8);
            }
        }
        Self { width, height, depth, colour, sure }
    }

    fn frame(&self) -> DepthFrame<'_> {
        let k = Intrinsics::new(50.0, 52.0, self.width as f32 * 0.5, self.height as f32 * 0.45).unwrap();
        let pose = Pose::new(rotation(), vec3(0.3, 1.5, -2.0)).unwrap();
        DepthFrame::new(ImageView::new(&self.depth, self.width, self.height).unwrap(), DepthUnit::MILLIMETRE, k)
            .with_confidence(ImageView::new(&self.sure, self.width, self.height).unwrap())
            .unwrap()
            .with_colour(ImageView::new(&self.colour, self.width, self.height).unwrap())
            .unwrap()
            .with_pose(pose)
            .with_time(Timestamp::from_nanos(-1_234_567_890_123), u64::MAX - 3)
    }
}

fn rotation() -> Quat {
    crate::ground::rotation::unit(Quat::from_xyzw(0.1, -0.4, 0.2, 0.8))
}

fn init() -> Init {
    Init {
        header: Header { session: 9, sequence: 4, time: Timestamp::from_nanos(77), view: 0 },
        intrinsics: Intrinsics::new(210.0, -211.0, 127.5, 95.5).unwrap(),
        depth_size: (256, 192),
        colour_size: (1920, 1440),
        position: vec3(0.1, 0.8, -1.5),
        ambient: Ambient { temperature: 3200.0, brightness: Brightness::Relative(0.7) },
        knobs: Knobs { register: true, ..Knobs::LOW },
    }
}

fn encoded_near(scene: &Scene, options: &NearOptions) -> Vec<u8> {
    let mut bytes = vec![0xAA; near_most_bytes(scene.width, scene.height)];
    let used = encode_near(&scene.frame(), options, &mut bytes).unwrap();
    bytes.truncate(used);
    bytes
}

fn encoded_far(scene: &Scene) -> Vec<u8> {
    let mut bytes = vec![0xAA; far_most_bytes(32, 24)];
    let used = encode_far(&scene.frame(), &FarOptions { view: 2, ..Default::default() }, &mut bytes).unwrap();
    bytes.truncate(used);
    bytes
}

fn encoded_init() -> Vec<u8> {
    let mut bytes = vec![0; init::BYTES];
    assert_eq!(encode_init(&init(), &mut bytes), Ok(init::BYTES));
    bytes
}

/// Decodes everything that a message holds.
fn read(message: &[u8]) -> Result<(), KeyFrameError> {
    match KeyFrame::decode(message)? {
        KeyFrame::Init(_) => {}
        KeyFrame::Near(near) => {
            let (w, h) = near.size();
            // As a caller would: an image that large is refused by whoever has no room for it.
            if w * h <= 1 << 16 {
                let (mut depth, mut colour) = (vec![0; w * h], vec![[0; 3]; w * h]);
                near.depth_into(&mut ImageViewMut::new(&mut depth, w, h).unwrap())?;
                let depth = ImageView::new(&depth, w, h).unwrap();
                near.colour_into(depth, &mut ImageViewMut::new(&mut colour, w, h).unwrap())?;
            }
        }
        KeyFrame::Far(far) => {
            let (w, h) = far.size();
            far.colour_into(&mut ImageViewMut::new(&mut vec![[0; 3]; w * h], w, h).unwrap())?;
        }
    }
    Ok(())
}

/// The same bytes with the length and CRC that they should have.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let length = bytes.len();
    bytes[4..8].copy_from_slice(&(length as u32).to_le_bytes());
    let crc = crc32(&bytes[..length - 4]);
    bytes[length - 4..].copy_from_slice(&crc.to_le_bytes());
    bytes
}

#[test]
fn init_comes_back() {
    let bytes = encoded_init();
    assert_eq!(KeyFrame::decode(&bytes), Ok(KeyFrame::Init(init())));
    assert_eq!(KeyFrame::decode(&bytes).unwrap().header().session, 9);
    let lux = Init { ambient: Ambient { brightness: Brightness::Lux(0.0), ..init().ambient }, ..init() };
    let mut bytes = [0; init::BYTES];
    encode_init(&lux, &mut bytes).unwrap();
    assert_eq!(KeyFrame::decode(&bytes), Ok(KeyFrame::Init(lux)));

    let with = |change: &dyn Fn(&mut Init)| {
        let mut init = init();
        change(&mut init);
        encode_init(&init, &mut [0; init::BYTES]).unwrap_err()
    };
    for (error, what) in [
        (with(&|i| i.position.x = f32::NAN), "the position"),
        (with(&|i| i.depth_size.0 = 0), "an image's size"),
        (with(&|i| i.ambient.temperature = 100.0), "the colour temperature"),
        (with(&|i| i.ambient.brightness = Brightness::Lux(-1.0)), "the brightness"),
        (with(&|i| i.knobs.half = f32::INFINITY), "the boundary"),
        (with(&|i| i.knobs.views = 0), "the number of views"),
        (with(&|i| i.knobs.map_size.1 = 0), "the size of views or map"),
        (with(&|i| i.knobs.levels[1] = (0, 0)), "a level's size"),
    ] {
        assert_eq!(error, KeyFrameError::Field { what, at: 0 });
    }
    assert_eq!(encode_init(&init(), &mut [0; 20]).map_err(|e| e.to_string().is_empty()), Err(false));
}

#[test]
fn near_says_all_that_the_frame_said() {
    let scene = Scene::new(40, 30, 1);
    let bytes = encoded_near(&scene, &NearOptions { session: 5, view: 700, ..Default::default() });
    let KeyFrame::Near(near) = KeyFrame::decode(&bytes).unwrap() else { panic!() };
    let frame = scene.frame();
    let header = Header { session: 5, sequence: frame.sequence(), time: frame.time(), view: 700 };
    assert_eq!(near.header(), header);
    assert!((near.pose().translation() - frame.pose().unwrap().translation()).length() == 0.0);
    assert!(near.pose().rotation().dot(rotation()) > 0.999_999_8);
    assert_eq!((near.unit(), near.intrinsics()), (frame.unit(), *frame.intrinsics()));
    assert_eq!((near.size(), near.origin()), ((40, 30), (0, 0)));
    assert!(near.has_colour());
    let without = encoded_near(&scene, &NearOptions { colour: false, ..Default::default() });
    let KeyFrame::Near(without) = KeyFrame::decode(&without).unwrap() else { panic!() };
    assert_eq!(without.stream_bytes(), (near.stream_bytes().0, 0));
    let mut colour = vec![[0; 3]; 1200];
    let view = ImageView::new(&scene.depth, 40, 30).unwrap();
    let mut out = ImageViewMut::new(&mut colour, 40, 30).unwrap();
    assert_eq!(without.colour_into(view, &mut out), Err(KeyFrameError::ColourLeftOut));
    // A depth image of the right size but other holes is noticed.
    let ones = vec![1; 1200];
    let other = ImageView::new(&ones, 40, 30).unwrap();
    assert!(matches!(near.colour_into(other, &mut out), Err(KeyFrameError::OtherImage { .. })));
    let mut short = [0_u16; 39 * 30];
    let mut short = ImageViewMut::new(&mut short, 39, 30).unwrap();
    assert!(matches!(near.depth_into(&mut short), Err(KeyFrameError::OtherImage { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever the boundary, confidence and error: what is within comes back exactly, in its place; nothing else does.
    #[test]
    fn near_keeps_what_is_near(
        width in 1_usize..50, height in 1_usize..40, seed in any::<u32>(), half in 0.05_f32..3.0, min_confidence in any::<u8>(),
        bounded in any::<bool>(), colour_error in 0_u8..=15, at in proptest::array::uniform3(-1.0_f32..1.0),
    ) {
        let scene = Scene::new(width, height, seed);
        let frame = scene.frame();
        let centre = frame.pose().unwrap().to_world(vec3(0.0, 0.0, 1.2)) + Vec3::from(at) * 0.5;
        let boundary = bounded.then_some(Boundary { centre, half });
        let options = NearOptions { boundary, min_confidence, colour_error, ..Default::default() };
        let mut bytes = vec![0; near_most_bytes(width, height)];
        let result = encode_near(&frame, &options, &mut bytes);
        // How far a pixel's point is within the cube; on its faces rounding decides.
        let inside = |x: usize, y: usize| {
            let sure = scene.sure[y * width + x] >= min_confidence;
            let depth = frame.world_point(x, y).map(|p| half - (p - centre).abs().max_element());
            depth.filter(|_| sure).map_or(f32::NEG_INFINITY, |d| if bounded { d } else { 1.0 })
        };
        let all = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let used = match result {
            Err(KeyFrameError::NothingNear) => {
                prop_assert!(all().all(|(x, y)| inside(x, y) < 1e-5));
                return Ok(());
            }
            other => other.unwrap(),
        };
        let KeyFrame::Near(near) = KeyFrame::decode(&bytes[..used]).unwrap() else { panic!() };
        let ((w, h), (left, top)) = (near.size(), near.origin());
        let (mut depth, mut colour) = (vec![7; w * h], vec![[7; 3]; w * h]);
        near.depth_into(&mut ImageViewMut::new(&mut depth, w, h).unwrap()).unwrap();
        let depth = ImageView::new(&depth, w, h).unwrap();
        near.colour_into(depth, &mut ImageViewMut::new(&mut colour, w, h).unwrap()).unwrap();
        let got = DepthFrame::new(depth, near.unit(), near.intrinsics()).with_pose(near.pose());
        let mut count = 0;
        for (x, y) in all() {
            let there = x.checked_sub(left).zip(y.checked_sub(top)).filter(|(a, b)| *a < w && *b < h);
            let value = there.and_then(|(a, b)| depth.get(a, b)).unwrap_or(0);
            let within = inside(x, y);
            if value > 0 {
                count += 1;
                prop_assert!(within > -1e-5);
                prop_assert_eq!(value, scene.depth[y * width + x]);
                let (a, b) = there.unwrap();
                prop_assert!((got.world_point(a, b).unwrap() - frame.world_point(x, y).unwrap()).length() < 1e-5);
                let (got, want) = (colour[b * w + a], scene.colour[y * width + x]);
                // Luma alone keeps its word to the step; chroma is shared by four.
                let luma = |p| i32::from(planes::ycc(p)[0]);
                // Twice, where a colour was cut off at the end of the range.
                prop_assert!((luma(got) - luma(want)).abs() <= 40 + i32::from(colour_error));
            } else {
                prop_assert!(within < 1e-5, "{x} {y} {within}");
                if let Some((a, b)) = there {
                    prop_assert_eq!(colour[b * w + a], [0; 3]);
                }
            }
        }
        prop_assert_eq!(count, near.readings());
    }

    /// Bytes from anywhere, sealed so that they get past the CRC.
    #[test]
    fn any_bytes_are_answered(noise in proptest::collection::vec(any::<u8>(), 30..300), kind in 0_u8..5) {
        let mut bytes = noise;
        bytes[..4].copy_from_slice(&[b'i', b'K', VERSION, kind]);
        let _ = read(&bytes);
        let _ = read(&sealed(bytes));
    }

    /// A real message with some bytes changed and sealed again.
    #[test]
    fn changed_bytes_are_answered(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), near in any::<bool>(),
    ) {
        let scene = Scene::new(20, 15, 8);
        let mut bytes = if near { encoded_near(&scene, &NearOptions::default()) } else { encoded_far(&scene) };
        for (place, value) in changes {
            let at = place.index(bytes.len());
            bytes[at] = value;
        }
        let _ = read(&sealed(bytes));
    }
}

#[test]
fn colour_of_another_size_is_resampled_to_depths_grid() {
    let scene = Scene::new(40, 30, 1);
    // Twice as large and wider than depth: depth covers the middle.
    let (w, h) = (120, 60);
    let large: Vec<[u8; 3]> = (0..w * h).map(|i| [(2 * (i % w)) as u8, (4 * (i / w)) as u8, 90]).collect();
    let frame = scene.frame().with_colour(ImageView::new(&large, w, h).unwrap()).unwrap();
    let mut bytes = vec![0; near_most_bytes(40, 30)];
    let options = NearOptions { colour_error: 0, ..Default::default() };
    let used = encode_near(&frame, &options, &mut bytes).unwrap();
    let KeyFrame::Near(near) = KeyFrame::decode(&bytes[..used]).unwrap() else { panic!() };
    let (mut depth, mut colour) = (vec![0; 1200], vec![[0; 3]; 1200]);
    near.depth_into(&mut ImageViewMut::new(&mut depth, 40, 30).unwrap()).unwrap();
    let view = ImageView::new(&depth, 40, 30).unwrap();
    near.colour_into(view, &mut ImageViewMut::new(&mut colour, 40, 30).unwrap()).unwrap();
    for (i, got) in colour.iter().enumerate().filter(|(i, _)| depth[*i] > 0) {
        let want = frame.colour_at(i % 40, i / 40).unwrap();
        // Half a step of the ramps: what sharing chroma costs.
        assert!(got.iter().zip(want).all(|(a, b)| a.abs_diff(b) <= 8), "{i}: {got:?} {want:?}");
    }
}

#[test]
fn float_depth_is_sent_in_millimetres() {
    let depth: Vec<f32> = (0..192).map(|i| if i % 7 == 0 { f32::NAN } else { 0.5 + i as f32 * 0.01 }).collect();
    let frame = DepthFrame::new(
        ImageView::new(&depth, 16, 12).unwrap(),
        DepthUnit::METRE,
        *Scene::new(1, 1, 1).frame().intrinsics(),
    );
    let mut bytes = vec![0; near_most_bytes(16, 12)];
    assert_eq!(encode_near(&frame, &NearOptions::default(), &mut bytes), Err(KeyFrameError::NoPose));
    let frame = frame.with_pose(Pose::IDENTITY);
    let used = encode_near(&frame, &NearOptions::default(), &mut bytes).unwrap();
    let KeyFrame::Near(near) = KeyFrame::decode(&bytes[..used]).unwrap() else { panic!() };
    assert_eq!((near.unit(), near.size(), near.origin()), (DepthUnit::MILLIMETRE, (16, 12), (0, 0)));
    let mut back = vec![0; 192];
    near.depth_into(&mut ImageViewMut::new(&mut back, 16, 12).unwrap()).unwrap();
    for (got, want) in back.iter().zip(&depth) {
        assert!(if want.is_nan() { *got == 0 } else { (f32::from(*got) * 0.001 - want).abs() <= 0.000_501 });
    }
}

#[test]
fn far_comes_back() {
    let scene = Scene::new(64, 48, 3);
    let bytes = encoded_far(&scene);
    let KeyFrame::Far(far) = KeyFrame::decode(&bytes).unwrap() else { panic!() };
    assert_eq!((far.size(), far.header().view), ((32, 24), 2));
    assert!(far.rotation().angle_between(rotation()).to_degrees() < 0.03);
    let k = scene.frame().intrinsics().resized(0.5, 0.5).unwrap();
    assert_eq!(far.intrinsics(), k);
    let mut picture = vec![[0; 3]; 32 * 24];
    far.colour_into(&mut ImageViewMut::new(&mut picture, 32, 24).unwrap()).unwrap();
    // Further down the ramp of green begins anew.
    for (i, got) in picture.iter().enumerate().take(20 * 32) {
        let (x, y) = (i % 32, i / 32);
        // Red and green are ramps of 8 and 12 codes a pixel.
        assert!((i32::from(got[0]) - (8 * x as i32 + 2)).abs() <= 14, "{x} {y} {got:?}");
        assert!((i32::from(got[1]) - (12 * y as i32 + 3)).abs() <= 14, "{x} {y} {got:?}");
    }
    let mut small = [[0; 3]; 4];
    let mut small = ImageViewMut::new(&mut small, 2, 2).unwrap();
    assert_eq!(far.colour_into(&mut small), Err(KeyFrameError::OtherImage { size: (32, 24), got: (2, 2) }));
}

#[test]
fn what_cannot_be_sent_is_refused() {
    let scene = Scene::new(40, 30, 1);
    let frame = scene.frame();
    let mut out = vec![0; near_most_bytes(40, 30)];
    let far_away =
        NearOptions { boundary: Some(Boundary { centre: Vec3::splat(99.0), half: 1.0 }), ..Default::default() };
    assert_eq!(encode_near(&frame, &far_away, &mut out), Err(KeyFrameError::NothingNear));
    let bad = NearOptions { boundary: Some(Boundary { centre: Vec3::NAN, half: 1.0 }), ..Default::default() };
    assert!(matches!(encode_near(&frame, &bad, &mut out), Err(KeyFrameError::Field { what: "the boundary", .. })));
    let bad = NearOptions { colour_error: 16, ..Default::default() };
    assert!(matches!(encode_near(&frame, &bad, &mut out), Err(KeyFrameError::Field { .. })));
    let bad = FarOptions { size: (0, 24), ..Default::default() };
    assert!(matches!(encode_far(&frame, &bad, &mut out), Err(KeyFrameError::Field { .. })));
    let empty = DepthFrame::new(ImageView::<u16>::EMPTY, frame.unit(), *frame.intrinsics()).with_pose(Pose::IDENTITY);
    assert_eq!(encode_near(&empty, &NearOptions::default(), &mut out), Err(KeyFrameError::NothingNear));
    assert_eq!(encode_far(&empty, &FarOptions::default(), &mut out), Err(KeyFrameError::NoColour));
    let wide = vec![1_u16; 70_000];
    let wide = DepthFrame::new(ImageView::new(&wide, 70_000, 1).unwrap(), frame.unit(), *frame.intrinsics());
    let error = encode_near(&wide.with_pose(Pose::IDENTITY), &NearOptions::default(), &mut out).unwrap_err();
    assert_eq!(error, KeyFrameError::TooLarge { size: (70_000, 1) });
}

#[test]
fn every_slice_that_is_too_small_is_told_so() {
    let scene = Scene::new(12, 9, 1);
    let mut enough = 0;
    for length in 0..near_most_bytes(12, 9) {
        let mut out = vec![0; length];
        match encode_near(&scene.frame(), &NearOptions::default(), &mut out) {
            Ok(_) => enough += 1,
            Err(e) => assert_eq!((e, enough), (KeyFrameError::Full { got: length }, 0), "{length}"),
        }
    }
    for length in 0..far_most_bytes(32, 24) {
        let result = encode_far(&scene.frame(), &FarOptions::default(), &mut vec![0; length]);
        assert!(matches!(result, Ok(_) | Err(KeyFrameError::Full { .. })));
    }
}

#[test]
fn truncated_anywhere_it_is_refused() {
    let scene = Scene::new(24, 18, 2);
    for message in [encoded_init(), encoded_near(&scene, &NearOptions::default()), encoded_far(&scene)] {
        read(&message).unwrap();
        for length in 0..message.len() {
            let error = read(&message[..length]).unwrap_err();
            let expected = match length {
                0..PREFIX => KeyFrameError::CutOff { needed: PREFIX, got: length },
                _ => KeyFrameError::Length { said: message.len(), got: length },
            };
            assert_eq!(error, expected, "{length}");
            // With a right length and CRC the fields are found wanting, or the streams.
            if length >= PREFIX + 4 {
                assert!(read(&sealed(message[..length].to_vec())).is_err(), "{length}");
            }
        }
        let longer = [&message[..], &[0]].concat();
        assert!(matches!(read(&longer), Err(KeyFrameError::Length { .. })));
    }
}

#[test]
fn every_flipped_bit_is_found() {
    let scene = Scene::new(24, 18, 2);
    for message in [encoded_init(), encoded_near(&scene, &NearOptions::default()), encoded_far(&scene)] {
        let mut bytes = message.clone();
        for bit in 0..8 * message.len() {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(KeyFrame::decode(&bytes).is_err(), "bit {bit}");
            // Sealed again it gets past the CRC: then it is another message, or refused; safe at any rate.
            let _ = read(&sealed(bytes.clone()));
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

#[test]
fn errors_say_what_where_and_what_to_do() {
    let bytes = encoded_init();
    assert_eq!(KeyFrame::decode(b"PNG"), Err(KeyFrameError::NotAKeyFrame));
    assert_eq!(KeyFrame::decode(&[]), Err(KeyFrameError::CutOff { needed: 8, got: 0 }));
    assert_eq!(message_length(&bytes[..8]), Ok(init::BYTES));
    let with = |at: usize, value: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = value;
        bytes
    };
    assert_eq!(KeyFrame::decode(&with(2, 9)), Err(KeyFrameError::Version { got: 9 }));
    assert!(matches!(KeyFrame::decode(&with(50, 9)), Err(KeyFrameError::Crc { .. })));
    for (at, what) in [
        (3, "the kind"),
        (70, "the unit of brightness"),
        (82, "what an init frame holds"),
        (91, "what an init frame holds"),
    ] {
        let error = KeyFrame::decode(&sealed(with(at, 99))).unwrap_err();
        assert!(matches!(error, KeyFrameError::Field { what: w, at } if w == what && at > 0), "{error}");
        assert!(error.to_string().contains(what));
    }
}
