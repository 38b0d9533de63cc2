//! Messages there and back, and what damage does.

use super::*;
use crate::ground::image::{ImageView, ImageViewMut};
use crate::sensing::camera::{Camera, Distortion, Intrinsics};
use crate::sensing::depth::DepthUnit;
use crate::sensing::imu::ImuSample;
use glam::Vec3;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

const MOST: usize = 1 << 20;

fn hello() -> Hello {
    let intrinsics = Intrinsics::new(120.0, 121.0, 79.5, 59.5).unwrap();
    let distortion = Distortion::Brown5([0.1, -0.2, 0.001, 0.002, 0.03]);
    Hello {
        depth: Some((160, 120, DepthUnit::QUARTER_MILLIMETRE, Camera { intrinsics, distortion })),
        frame_interval: 33_333,
        imu_millihertz: 400_000,
        imu_offset: -1_500_000,
        firmware: 0x0102_0003,
        serial: Serial::new("HS-0042 b").unwrap(),
    }
}

fn sample(t: i64, v: f32, field: bool) -> ImuSample {
    let field = field.then_some(Vec3::new(v, 20.0, -40.0));
    ImuSample { time: Timestamp::from_nanos(t), rate: Vec3::splat(v), force: Vec3::new(0.0, v, 9.8), field }
}

/// One of each kind.
fn stream() -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    let mut add = |write: &dyn Fn(&mut [u8]) -> Result<usize, Malformed>| {
        let mut bytes = vec![0; 9000];
        let used = write(&mut bytes).unwrap();
        all.push(bytes[..used].to_vec());
    };
    let depth: Vec<u16> = (0..60 * 4).map(|i| if i % 7 == 0 { 0 } else { 1000 + i }).collect();
    let view = ImageView::new(&depth, 60, 4).unwrap();
    let time = Timestamp::from_nanos(-3);
    add(&|out| encode_hello(&hello(), 0, time, out));
    for (n, encoding) in [Encoding::Raw, Encoding::Rvl].into_iter().enumerate() {
        add(&|out| encode_depth(view, DepthUnit::TUM, 8000, encoding, n as u32, time, out));
    }
    add(&|out| encode_imu(&[sample(10, 1.0, true), sample(20, 2.0, true)], 4, out));
    let key = Header { kind: Kind::KeyFrame, sequence: 9, time };
    add(&|out| encode(&key, b"iK and so on", out));
    add(&|out| encode(&Header { kind: Kind::Other(200), ..key }, &[], out));
    all
}

fn read_all(mut bytes: &[u8]) -> (Vec<(Kind, u32)>, usize, usize) {
    let (mut messages, mut garbage_bytes, mut damaged) = (Vec::new(), 0, 0);
    loop {
        match find(bytes, MOST) {
            Found::Message { message, garbage, used } => {
                garbage_bytes += garbage;
                messages.push((message.header.kind, message.header.sequence));
                bytes = &bytes[used..];
            }
            Found::Damaged { used, .. } => {
                damaged += 1;
                bytes = &bytes[used..];
            }
            Found::More { garbage, .. } => return (messages, garbage_bytes + garbage, damaged),
        }
    }
}

#[test]
fn each_kind_comes_back() {
    let all = stream();
    let (kinds, garbage, damaged) = read_all(&all.concat());
    let want = [Kind::Hello, Kind::Depth, Kind::Depth, Kind::Imu, Kind::KeyFrame, Kind::Other(200)];
    assert_eq!(kinds.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), want);
    assert_eq!((garbage, damaged), (0, 0));

    let content = |i: usize| match find(&all[i], MOST) {
        Found::Message { message, .. } => message.content().unwrap(),
        other => panic!("{other:?}"),
    };
    assert_eq!(content(0), Content::Hello(hello()));
    for i in [1, 2] {
        let Content::Depth(depth) = content(i) else { panic!("{i}") };
        assert_eq!((depth.size, depth.unit, depth.exposure), ((60, 4), DepthUnit::TUM, 8000));
        let mut pixels = [9; 240];
        depth.pixels_into(&mut ImageViewMut::new(&mut pixels, 60, 4).unwrap()).unwrap();
        assert!(pixels.iter().enumerate().all(|(i, v)| *v == if i % 7 == 0 { 0 } else { 1000 + i as u16 }));
        assert!(depth.pixels_into(&mut ImageViewMut::new(&mut pixels, 4, 60).unwrap()).is_err());
    }
    let Content::Imu(imu) = content(3) else { panic!("readings") };
    assert_eq!(imu.iter().collect::<Vec<_>>(), [sample(10, 1.0, true), sample(20, 2.0, true)]);
    assert_eq!(content(4), Content::KeyFrame(b"iK and so on"));
    assert_eq!(content(5), Content::Other(200));
    assert_eq!(all[0].len(), 144);
}

#[test]
fn a_device_without_depth_says_so() {
    let hello = Hello { depth: None, serial: Serial::default(), ..hello() };
    let mut bytes = [0; 144];
    encode_hello(&hello, 1, Timestamp::ZERO, &mut bytes).unwrap();
    let Found::Message { message, .. } = find(&bytes, MOST) else { panic!("no message") };
    assert_eq!(message.content(), Ok(Content::Hello(hello)));
    assert_eq!(Serial::new("a\n"), None);
    assert_eq!(Serial::new(&"x".repeat(33)), None);
}

#[test]
fn every_flipped_bit_is_found() {
    for (n, message) in stream().iter().enumerate() {
        for at in 0..message.len() {
            for bit in 0..8 {
                let mut bad = message.clone();
                bad[at] ^= 1 << bit;
                let found = find(&bad, MOST);
                assert!(!matches!(found, Found::Message { .. }), "{n}: byte {at} bit {bit}: {found:?}");
            }
        }
    }
}

#[test]
fn a_stream_cut_anywhere_says_how_much_it_needs() {
    for message in stream() {
        for length in 0..message.len() {
            match find(&message[..length], MOST) {
                Found::More { garbage: 0, needed } => {
                    assert_eq!(needed, if length < HEADER { HEADER } else { message.len() });
                }
                other => panic!("{length}: {other:?}"),
            }
        }
    }
}

#[test]
fn what_is_too_long_or_of_another_version_is_passed_over() {
    let all = stream();
    let two = [&all[1][..], &all[0]].concat();
    let Found::Damaged { error: Malformed::Field { at: 4, .. }, used } = find(&two, 200) else { panic!("too long") };
    assert_eq!(used, HEADER);
    assert_eq!(read_all(&two[used..]).0, [(Kind::Hello, 0)]);

    let mut newer = all[0].clone();
    newer[2] = 2;
    let crc = crc32(&newer[..HEADER - 4]);
    newer[HEADER - 4..HEADER].copy_from_slice(&crc.to_le_bytes());
    assert!(matches!(find(&newer, MOST), Found::Damaged { error: Malformed::Field { at: 2, got: 2, .. }, .. }));
}

#[test]
fn what_can_not_be_sent_is_refused() {
    let mut out = [0; 400];
    let t = Timestamp::ZERO;
    let none = ImageView::EMPTY;
    assert!(encode_depth(none, DepthUnit::TUM, 0, Encoding::Raw, 0, t, &mut out).is_err());
    assert!(encode_imu(&[], 0, &mut out).is_err());
    assert!(encode_imu(&[sample(10, 1.0, false), sample(9, 1.0, false)], 0, &mut out).is_err());
    assert!(encode_imu(&[sample(0, 1.0, false), sample(5_000_000_000, 1.0, false)], 0, &mut out).is_err());
    assert!(encode_imu(&[sample(0, f32::NAN, false)], 0, &mut out).is_err());
    assert!(encode_imu(&[sample(0, 1.0, true), sample(0, 1.0, false)], 0, &mut out).is_err());
    let pixels = [500_u16; 30];
    let view = ImageView::new(&pixels, 6, 5).unwrap();
    for encoding in [Encoding::Raw, Encoding::Rvl] {
        let most = depth_most_bytes(30, encoding);
        assert!(encode_depth(view, DepthUnit::TUM, 0, encoding, 0, t, &mut out[..most]).is_ok());
        assert!(encode_depth(view, DepthUnit::TUM, 0, encoding, 0, t, &mut out[..40]).is_err());
    }
    assert_eq!(encode_imu(&[sample(0, 1.0, false)], 0, &mut out), Ok(imu_bytes(1, false)));
}

proptest! {
    #[test]
    fn after_garbage_the_next_message_is_found(
        garbage in prop::collection::vec(prop_oneof![any::<u8>(), Just(b'i'), Just(b'B'), Just(1)], 0..200),
        order in prop::collection::vec(0_usize..6, 1..6),
    ) {
        let all = stream();
        let mut bytes = Vec::new();
        for n in &order {
            bytes.extend(&garbage);
            bytes.extend(&all[*n]);
        }
        let (messages, skipped, damaged) = read_all(&bytes);
        prop_assert_eq!((messages.len(), skipped, damaged), (order.len(), garbage.len() * order.len(), 0));
    }

    #[test]
    fn a_hole_costs_the_messages_it_touches(
        order in prop::collection::vec(0_usize..6, 2..8), from in 0_usize..5000, length in 1_usize..700,
    ) {
        let all = stream();
        let bytes: Vec<u8> = order.iter().flat_map(|n| all[*n].clone()).collect();
        let from = from % bytes.len();
        let to = (from + length).min(bytes.len());
        let (mut at, mut whole) = (0, 0);
        for n in &order {
            let end = at + all[*n].len();
            whole += usize::from(end <= from || at >= to);
            at = end;
        }
        let holed = [&bytes[..from], &bytes[to..]].concat();
        // At the end of a stream a damaged message may still wait for its rest: give it.
        let padded = [&holed[..], &vec![0; 10_000]].concat();
        // Where equal messages meet, the two ends of a hole can make one of them.
        let got = read_all(&padded).0.len();
        prop_assert!(whole <= got && got <= order.len(), "{got} of {whole}");
    }

    #[test]
    fn sealed_bodies_of_any_bytes_are_survived(kind in 0_u8..6, body in prop::collection::vec(any::<u8>(), 0..160)) {
        let mut bytes = vec![0; body.len() + OVERHEAD];
        let header = Header { kind: Kind::of(kind), sequence: 1, time: Timestamp::ZERO };
        prop_assert_eq!(encode(&header, &body, &mut bytes), Ok(bytes.len()));
        let Found::Message { message, .. } = find(&bytes, MOST) else { panic!("sealed") };
        match message.content() {
            Ok(Content::Imu(imu)) => prop_assert_eq!(imu.iter().count(), imu.len()),
            Ok(Content::Depth(depth)) => {
                let (w, h) = depth.size;
                if w * h < 100_000 {
                    let mut pixels = vec![0; w * h];
                    let _ = depth.pixels_into(&mut ImageViewMut::new(&mut pixels, w, h).unwrap());
                }
            }
            _ => {}
        }
    }
}
