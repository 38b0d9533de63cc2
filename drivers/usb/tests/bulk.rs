//! The bulk source over a scripted USB: what is delivered was sent, what was not is counted, and no call waits beyond its deadline or spins.

mod common;

use std::sync::{Arc, Mutex};
use std::time::Duration;

use common::{Act, Fake};
use isobath::glam::Vec3;
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::{Camera, Distortion, Intrinsics};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::imu::ImuSample;
use isobath::wire::bulk::{self as wire, Encoding, Header, Hello, Kind, Serial};
use isobath_source::{
    Deadline, DepthPixels, DepthSource, GapCause, ImuOutcome, ImuSource, Outcome, OwnedFrame, SourceError,
};
use isobath_usb::bulk::{Bulk, wanted};
use isobath_usb::link::Options;
use isobath_usb::sys::UsbError;
use proptest::prelude::*;

const W: usize = 40;
const H: usize = 30;

fn hello() -> Vec<u8> {
    hello_of(W as u16, H as u16)
}

fn hello_of(width: u16, height: u16) -> Vec<u8> {
    let camera = Camera { intrinsics: Intrinsics::new(30.0, 30.0, 19.5, 14.5).unwrap(), distortion: Distortion::None };
    let hello = Hello {
        depth: Some((width, height, DepthUnit::MILLIMETRE, camera)),
        frame_interval: 33_333,
        imu_millihertz: 200_000,
        imu_offset: 0,
        firmware: 1,
        serial: Serial::new("S1").unwrap(),
    };
    let mut out = vec![0; 144];
    wire::encode_hello(&hello, 0, Timestamp::ZERO, &mut out).unwrap();
    out
}

fn pixels(sequence: u32) -> Vec<u16> {
    (0..W * H).map(|i| 500 + ((i * 7 + sequence as usize * 13) % 3000) as u16).collect()
}

/// The device's clock began 77 s ago, 33 ms from frame to frame.
fn time_of(frame: u32) -> Timestamp {
    Timestamp::from_nanos(77_000_000_000 + i64::from(frame.wrapping_add(4)) * 33_000_000)
}

fn frame(sequence: u32, encoding: Encoding) -> Vec<u8> {
    let mut out = vec![0; wire::depth_most_bytes(W * H, encoding)];
    let time = time_of(sequence);
    let pixels = pixels(sequence);
    let view = ImageView::new(&pixels, W, H).unwrap();
    let used = wire::encode_depth(view, DepthUnit::MILLIMETRE, 0, encoding, sequence, time, &mut out).unwrap();
    out.truncate(used);
    out
}

/// Readings a millisecond apart, from 5 ms after a frame on.
fn readings(sequence: u32, count: usize, frame: u32) -> Vec<u8> {
    let at = time_of(frame).as_nanos() + 5_000_000;
    let all: Vec<ImuSample> = (0..count)
        .map(|i| ImuSample {
            time: Timestamp::from_nanos(at + i as i64 * 1_000_000),
            rate: Vec3::X * i as f32,
            force: Vec3::Y * 9.8,
            field: None,
        })
        .collect();
    let mut out = vec![0; wire::imu_bytes(count, false)];
    wire::encode_imu(&all, sequence, &mut out).unwrap();
    out
}

fn open(fake: &Fake, options: Options) -> Result<Bulk<Fake>, SourceError> {
    Bulk::open_at(fake.clone(), wanted(None), options, Box::new(fake.clone()))
}

fn soon(fake: &Fake) -> Deadline {
    Deadline::after(fake, Duration::from_millis(100))
}

fn check(frame: &OwnedFrame) -> Result<(), TestCaseError> {
    let DepthPixels::U16(got) = frame.depth() else { panic!("u16") };
    prop_assert_eq!(got, &pixels(frame.sequence as u32));
    Ok(())
}

#[test]
fn frames_and_readings_of_one_pipe() {
    let key = Header { kind: Kind::KeyFrame, sequence: 0, time: Timestamp::ZERO };
    let mut message = vec![0; 30];
    let used = wire::encode(&key, b"iK", &mut message).unwrap();
    let stream = [
        &frame(8, Encoding::Raw)[..], // before the hello: nobody's
        &hello(),
        &frame(9, Encoding::Raw),
        &readings(0, 5, 9),
        &message[..used],
        &readings(1, 5, 10),
        &frame(10, Encoding::Rvl),
        &readings(3, 5, 11),
    ]
    .concat();
    let fake = Fake::bulk(stream.chunks(999).map(|bytes| Act::Data(bytes.to_vec())));
    let mut source = open(&fake, Options::default()).unwrap();
    let keys = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&keys);
    source.on_key_frame(move |message| sink.lock().unwrap().push(message.to_vec()));
    assert_eq!(DepthSource::info(&source).size, Some((W, H)));
    assert!(DepthSource::info(&source).kind.contains("S1"));
    assert_eq!(ImuSource::info(&source).rate_hz, 200.0);

    let mut out = OwnedFrame::new();
    let mut times = Vec::new();
    for sequence in [9, 10] {
        assert_eq!(source.next_into(&mut out, soon(&fake)).unwrap(), Outcome::Frame);
        assert_eq!(out.sequence, sequence);
        check(&out).unwrap();
        times.push(out.time.as_nanos());
    }
    // The host's times, a frame apart to the accuracy of arrivals.
    assert!((1_000_000_000..1_100_000_000).contains(&times[0]) && times[1] > times[0], "{times:?}");
    assert_eq!(source.next_into(&mut out, soon(&fake)).unwrap(), Outcome::TimedOut);
    assert_eq!(source.stats().delivered, 2);
    assert_eq!(keys.lock().unwrap().as_slice(), [b"iK"]);

    let empty = ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None };
    let mut got = [empty; 20];
    assert_eq!(source.read(&mut got, soon(&fake)).unwrap(), ImuOutcome::Samples(15));
    assert!(got[..15].windows(2).all(|two| two[0].time < two[1].time || two[1].rate.x == 0.0));
    assert_eq!(got[4].rate.x, 4.0);
    assert_eq!(source.readings_lost(), 5, "message 2 did not come");
    assert_eq!(source.read(&mut got, soon(&fake)).unwrap(), ImuOutcome::TimedOut);
}

#[test]
fn opening_says_what_is_missing() {
    let empty = Fake::default();
    empty.world().gone_for_good = true;
    let e = open(&empty, Options::default()).unwrap_err();
    assert!(matches!(e, SourceError::Unsupported { .. }) && e.to_string().contains("plug it in"), "{e}");

    let locked = Fake::default();
    locked.world().access = true;
    let e = open(&locked, Options::default()).unwrap_err();
    assert!(matches!(e, SourceError::Permission { .. }) && e.to_string().contains("idVendor"), "{e}");

    let silent = Fake::bulk([Act::Data(frame(1, Encoding::Raw))]);
    let e = open(&silent, Options::default()).unwrap_err();
    assert!(matches!(e, SourceError::MissingCalibration { .. }), "{e}");
    let absurd = Fake::bulk([Act::Data(hello_of(65_535, 65_535))]);
    let e = open(&absurd, Options::default()).unwrap_err();
    assert!(e.to_string().contains("65535 x 65535"), "{e}");
    let waited = silent.world().now;
    assert!(waited <= 4_100_000_000, "it waited {waited} ns");
}

#[test]
fn an_unplugged_device_is_an_end() {
    let half = frame(2, Encoding::Raw);
    let script = [
        Act::Data(hello()),
        Act::Data(frame(1, Encoding::Raw)),
        Act::Data(half[..half.len() / 2].to_vec()),
        Act::Unplug(None),
    ];
    let fake = Fake::bulk(script);
    let mut source = open(&fake, Options::default()).unwrap();
    let mut out = OwnedFrame::new();
    assert_eq!(source.next_into(&mut out, Deadline::NEVER).unwrap(), Outcome::Frame);
    for _ in 0..3 {
        let before = fake.world().calls;
        let e = source.next_into(&mut out, Deadline::NEVER).unwrap_err();
        assert!(e.is_terminal(), "{e}");
        assert!(fake.world().calls <= before + 3);
    }
}

#[test]
fn a_device_that_comes_back_is_gone_on_with() {
    let script = [
        Act::Data([hello(), frame(5, Encoding::Raw)].concat()),
        Act::Unplug(Some(4)),
        Act::Data([hello(), frame(0, Encoding::Raw)].concat()),
    ];
    let fake = Fake::bulk(script);
    let mut source = open(&fake, Options { reconnect: true }).unwrap();
    let mut out = OwnedFrame::new();
    let mut got = Vec::new();
    let calls = fake.world().calls;
    for _ in 0..20 {
        let deadline = soon(&fake);
        let outcome = source.next_into(&mut out, deadline).unwrap();
        assert!(deadline.time().unwrap().0 + 1_000_000 >= 1_000_000_000 + fake.world().now, "beyond the deadline");
        got.push(outcome);
        if got.iter().filter(|o| **o == Outcome::Frame).count() == 2 {
            break;
        }
    }
    assert!(got.contains(&Outcome::TimedOut), "while it is away: {got:?}");
    let back = got.iter().find_map(|o| if let Outcome::Recovered(gap) = o { Some(gap.cause) } else { None });
    assert_eq!(back, Some(GapCause::Replugged));
    assert_eq!(out.sequence, 0);
    check(&out).unwrap();
    assert!(fake.world().calls - calls < 30, "it is looked for now and then");
    assert_eq!(source.stats().delivered, 2);
}

#[test]
fn a_stall_is_cleared_and_said() {
    let script = [
        Act::Data([hello(), frame(1, Encoding::Raw)].concat()),
        Act::Fail(UsbError::Stall),
        Act::Data(frame(2, Encoding::Raw)),
    ];
    let fake = Fake::bulk(script);
    let mut source = open(&fake, Options::default()).unwrap();
    let mut out = OwnedFrame::new();
    assert_eq!(source.next_into(&mut out, soon(&fake)).unwrap(), Outcome::Frame);
    assert!(
        matches!(source.next_into(&mut out, soon(&fake)).unwrap(), Outcome::Recovered(g) if g.cause == GapCause::Link)
    );
    assert_eq!(source.next_into(&mut out, soon(&fake)).unwrap(), Outcome::Frame);
    let cleared = fake.world().cleared;
    assert_eq!((out.sequence, source.stats().recoveries, cleared), (2, 1, 1));
}

#[test]
fn a_device_that_always_stalls_neither_spins_nor_hangs() {
    let stalls = std::iter::repeat_n(Act::Fail(UsbError::Stall), 10_000);
    let fake = Fake::bulk(std::iter::once(Act::Data(hello())).chain(stalls));
    let mut source = open(&fake, Options::default()).unwrap();
    let mut out = OwnedFrame::new();
    let calls = fake.world().calls;
    let start = fake.world().now;
    let mut errors = 0;
    while fake.world().now < start + 10_000_000_000 {
        match source.next_into(&mut out, soon(&fake)) {
            Err(e) => {
                assert!(e.is_retryable(), "{e}");
                errors += 1;
            }
            Ok(outcome) => assert!(!matches!(outcome, Outcome::Frame)),
        }
    }
    assert!(errors > 0);
    let calls = fake.world().calls - calls;
    assert!(calls < 1000, "{calls} calls in 10 s");
}

#[test]
fn more_readings_than_there_is_room_for_are_counted() {
    let mut script = vec![Act::Data(hello())];
    script.extend((0..50).map(|n| Act::Data(readings(n, 100, n * 4))));
    let fake = Fake::bulk(script);
    let mut source = open(&fake, Options::default()).unwrap();
    let mut out = OwnedFrame::new();
    assert_eq!(source.next_into(&mut out, soon(&fake)).unwrap(), Outcome::TimedOut);
    assert_eq!(source.readings_lost(), 5000 - 4096);
}

#[test]
fn a_message_that_holds_no_frame_is_an_error_and_counted() {
    let time = time_of(0);
    let header = |sequence| Header { kind: Kind::Depth, sequence, time };
    let whole = frame(0, Encoding::Rvl);
    let body = &whole[24..whole.len() - 4];
    let small = {
        let mut out = vec![0; 400];
        let view = ImageView::new(&[700; 20], 5, 4).unwrap();
        let used = wire::encode_depth(view, DepthUnit::MILLIMETRE, 0, Encoding::Raw, 2, time, &mut out).unwrap();
        out.truncate(used);
        out
    };
    // Cut short, of another size, and none at all: each with a right CRC.
    let mut script = vec![Act::Data([hello(), frame(0, Encoding::Raw)].concat())];
    for (sequence, body) in [(1, &body[..body.len() - 8]), (3, &[][..])] {
        let mut out = vec![0; body.len() + wire::OVERHEAD];
        wire::encode(&header(sequence), body, &mut out).unwrap();
        script.push(Act::Data(out));
    }
    script.insert(2, Act::Data(small));
    script.push(Act::Data(frame(4, Encoding::Rvl)));
    let fake = Fake::bulk(script);
    let mut source = open(&fake, Options::default()).unwrap();
    let mut out = OwnedFrame::new();
    assert_eq!(source.next_into(&mut out, soon(&fake)).unwrap(), Outcome::Frame);
    for _ in 0..3 {
        let e = source.next_into(&mut out, soon(&fake)).unwrap_err();
        assert!(matches!(e, SourceError::Corrupt { .. }), "{e}");
    }
    assert_eq!(source.next_into(&mut out, soon(&fake)).unwrap(), Outcome::Frame);
    let stats = source.stats();
    assert_eq!((stats.delivered, stats.corrupt, stats.span(), out.sequence), (2, 3, 5, 4));
}

/// What happens to the bytes on their way.
#[derive(Debug, Clone)]
enum Fault {
    Flip(usize),
    Cut(usize, usize),
    Insert(usize, Vec<u8>),
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        any::<usize>().prop_map(Fault::Flip),
        (any::<usize>(), 1_usize..4000).prop_map(|(at, n)| Fault::Cut(at, n)),
        (any::<usize>(), prop::collection::vec(any::<u8>(), 1..600)).prop_map(|(at, b)| Fault::Insert(at, b)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn every_frame_given_was_sent_and_the_counters_add_up(
        faults in prop::collection::vec(fault(), 0..6),
        chunks in prop::collection::vec((1_usize..5000, 0_u8..12), 1..40),
        rvl in any::<bool>(),
        first in prop_oneof![Just(0_u32), Just(u32::MAX - 3)],
    ) {
        let encoding = if rvl { Encoding::Rvl } else { Encoding::Raw };
        let count = 8;
        let number = |n: u32| first.wrapping_add(n);
        let mut middle: Vec<u8> = (1..count - 1).flat_map(|n| [frame(number(n), encoding), readings(n, 3, number(n))].concat()).collect();
        for fault in faults {
            let length = middle.len();
            match fault {
                Fault::Flip(at) => middle[at % length] ^= 1 << (at % 8),
                Fault::Cut(at, n) => drop(middle.drain(at % length..(at % length + n).min(length))),
                Fault::Insert(at, bytes) => drop(middle.splice(at % length..at % length, bytes)),
            }
            prop_assume!(!middle.is_empty());
        }
        // The first and the last come whole, so that the span is known; before the last one hello ends whatever was cut.
        let mut script = vec![Act::Data([hello(), frame(number(0), encoding)].concat())];
        let mut rest = &middle[..];
        for (length, what) in chunks.iter().cycle() {
            if rest.is_empty() {
                break;
            }
            let (now, later) = rest.split_at((*length).min(rest.len()));
            rest = later;
            match what {
                0 => script.push(Act::Silence(Duration::from_millis(150))),
                1 => script.push(Act::Fail(UsbError::Stall)),
                2 => script.push(Act::Fail(UsbError::Overflow)),
                _ => {}
            }
            script.push(Act::Data(now.to_vec()));
        }
        // A message cut at its end swallows what follows until its length is full.
        script.push(Act::Data(vec![0; 300_000]));
        script.push(Act::Data(frame(number(count - 1), encoding)));
        let fake = Fake::bulk(script);
        let mut source = open(&fake, Options::default()).unwrap();
        let mut out = OwnedFrame::new();
        let mut last = None;
        let mut delivered = 0;
        loop {
            let deadline = soon(&fake);
            match source.next_into(&mut out, deadline) {
                Ok(Outcome::Frame) => {
                    check(&out)?;
                    let sequence = out.sequence as u32;
                    prop_assert!(last.is_none_or(|l: u32| sequence.wrapping_sub(l) < 100 && sequence != l));
                    last = Some(sequence);
                    delivered += 1;
                }
                Ok(Outcome::TimedOut) if fake.world().script.is_empty() => break,
                Ok(_) => {}
                Err(e) => prop_assert!(e.is_retryable(), "{}", e),
            }
            prop_assert!(1_000_000_000 + fake.world().now <= deadline.time().unwrap().0 + 10_000_000, "beyond the deadline");
        }
        prop_assert_eq!(last, Some(number(count - 1)));
        let stats = source.stats();
        prop_assert_eq!(stats.delivered, delivered);
        prop_assert_eq!(stats.span(), u64::from(count), "{:?}", stats);
    }
}
