//! Kinect v1 over a scripted USB: commands, constants, packets lost in every way, unplugged and back.

mod common;

use std::time::Duration;

use common::{Act, Fake, packets, picture};
use isobath::ground::image::ImageViewMut;
use isobath::sensing::depth::decode::kinect::Constants;
use isobath::wire::device::kinect::{ROW_BYTES, START_DEPTH, STOP_DEPTH};
use isobath_source::{Deadline, DepthPixels, DepthSource, GapCause, Outcome, OwnedFrame, SourceError};
use isobath_usb::kinect1::{Kinect1, wanted};
use isobath_usb::link::Options;
use isobath_usb::sys::UsbError;
use proptest::prelude::*;

fn open(fake: &Fake, options: Options) -> Result<Kinect1<Fake>, SourceError> {
    Kinect1::open_at(fake.clone(), wanted(None), options, Box::new(fake.clone()))
}

fn soon(fake: &Fake) -> Deadline {
    Deadline::after(fake, Duration::from_millis(100))
}

/// Transfers of sixteen packets.
fn acts(packets: &[Option<Vec<u8>>]) -> std::vec::IntoIter<Act> {
    packets.chunks(16).map(|some| Act::Packets(some.to_vec())).collect::<Vec<_>>().into_iter()
}

fn millimetres(number: usize) -> Vec<u16> {
    let mut out = vec![0; 640 * 480];
    let table = Constants::NOMINAL.table().unwrap();
    table.decode(&picture(number), ROW_BYTES, &mut ImageViewMut::new(&mut out, 640, 480).unwrap()).unwrap();
    out
}

fn is(frame: &OwnedFrame, number: usize) -> bool {
    matches!(frame.depth(), DepthPixels::U16(got) if *got == millimetres(number))
}

#[test]
fn frames_in_metres_by_the_devices_constants() {
    let fake = Fake::kinect(acts(&packets(0..3)));
    let mut kinect = open(&fake, Options::default()).unwrap();
    assert!(kinect.info().kind.contains("S1") && kinect.info().notes.len() == 1);
    assert!((kinect.info().intrinsics.fx() - 575.8).abs() < 0.1);
    assert!(!fake.world().streaming, "nothing runs before it is asked for");
    let mut frame = OwnedFrame::new();
    for number in 0..3 {
        assert_eq!(kinect.next_into(&mut frame, soon(&fake)).unwrap(), Outcome::Frame);
        assert!(is(&frame, number) && frame.sequence == number as u64);
        assert!(frame.time.as_nanos() > 1_000_000_000);
    }
    assert_eq!(fake.world().registers, START_DEPTH);
    assert_eq!(kinect.next_into(&mut frame, soon(&fake)).unwrap(), Outcome::TimedOut);
    assert_eq!((kinect.stats().delivered, kinect.stats().span()), (3, 3));
    kinect.stop().unwrap();
    kinect.stop().unwrap();
    assert_eq!(fake.world().registers.last(), Some(&STOP_DEPTH));
    assert!(!fake.world().streaming);
    fake.world().script.extend(acts(&packets(7..8)));
    assert_eq!(kinect.next_into(&mut frame, soon(&fake)).unwrap(), Outcome::Frame, "it starts anew");
    drop(kinect);
    assert!(!fake.world().streaming, "dropping it stops it");
}

#[test]
fn without_its_constants_it_says_so() {
    let fake = Fake::kinect(acts(&packets(0..1)));
    fake.world().refuses_constants = true;
    let mut kinect = open(&fake, Options::default()).unwrap();
    assert!(kinect.info().notes[0].contains("a few percent"), "{:?}", kinect.info().notes);
    let mut frame = OwnedFrame::new();
    assert_eq!(kinect.next_into(&mut frame, soon(&fake)).unwrap(), Outcome::Frame);
}

#[test]
fn unplugged_in_mid_frame() {
    let script = || acts(&packets(0..1)).chain(acts(&packets(1..2)[..100]));
    let fake = Fake::kinect(script().chain([Act::Unplug(None)]));
    let mut kinect = open(&fake, Options::default()).unwrap();
    let mut frame = OwnedFrame::new();
    assert_eq!(kinect.next_into(&mut frame, soon(&fake)).unwrap(), Outcome::Frame);
    for _ in 0..3 {
        assert!(kinect.next_into(&mut frame, Deadline::NEVER).unwrap_err().is_terminal());
    }
    assert_eq!((kinect.stats().delivered, kinect.stats().corrupt), (1, 1));

    let fake = Fake::kinect(script().chain([Act::Unplug(Some(3))]).chain(acts(&packets(5..6))));
    let mut kinect = open(&fake, Options { reconnect: true }).unwrap();
    let mut seen = Vec::new();
    for _ in 0..30 {
        let deadline = soon(&fake);
        seen.push(kinect.next_into(&mut frame, deadline).unwrap());
        if seen.iter().filter(|o| **o == Outcome::Frame).count() == 2 {
            break;
        }
    }
    assert!(is(&frame, 5), "{seen:?}");
    let replugged = |o: &Outcome| matches!(o, Outcome::Recovered(gap) if gap.cause == GapCause::Replugged);
    assert_eq!(seen.iter().filter(|o| replugged(o)).count(), 1);
    assert!(seen.contains(&Outcome::TimedOut));
    let stats = kinect.stats();
    assert_eq!((stats.delivered, stats.corrupt, stats.recoveries), (2, 1, 1));
}

#[test]
fn silence_starts_it_anew() {
    let fake = Fake::kinect([Act::Silence(Duration::from_millis(1500))].into_iter().chain(acts(&packets(0..1))));
    let mut kinect = open(&fake, Options::default()).unwrap();
    let mut frame = OwnedFrame::new();
    let mut seen = Vec::new();
    for _ in 0..30 {
        seen.push(kinect.next_into(&mut frame, soon(&fake)).unwrap());
        if seen.last() == Some(&Outcome::Frame) {
            break;
        }
    }
    let link = |o: &Outcome| matches!(o, Outcome::Recovered(gap) if gap.cause == GapCause::Link);
    assert_eq!(seen.iter().filter(|o| link(o)).count(), 1, "{seen:?}");
    assert!(is(&frame, 0));
}

#[test]
fn an_error_of_the_bus_is_retryable_and_does_not_spin() {
    let failures = std::iter::repeat_n(Act::Fail(UsbError::Io), 5);
    let fake = Fake::kinect(failures.chain(acts(&packets(0..1))));
    let mut kinect = open(&fake, Options::default()).unwrap();
    let mut frame = OwnedFrame::new();
    for _ in 0..5 {
        let before = fake.world().now;
        let e = kinect.next_into(&mut frame, soon(&fake)).unwrap_err();
        assert!(e.is_retryable(), "{e}");
        assert!(fake.world().now > before, "time passed");
    }
    assert_eq!(kinect.next_into(&mut frame, soon(&fake)).unwrap(), Outcome::Frame);
    assert_eq!(kinect.stats().recoveries, 5);
}

#[derive(Debug, Clone, Copy)]
enum Fault {
    Drop,
    Twice,
    Swap,
    Cut(usize),
    Bus,
    Empty,
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        Just(Fault::Drop),
        Just(Fault::Twice),
        Just(Fault::Swap),
        (0_usize..1760).prop_map(Fault::Cut),
        Just(Fault::Bus),
        Just(Fault::Empty)
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn every_frame_given_was_whole(
        faults in prop::collection::vec((242_usize..5 * 242, fault()), 0..6),
        size in 1_usize..40,
    ) {
        let mut all = packets(0..7);
        let mut faults = faults;
        faults.sort_by_key(|(at, _)| std::cmp::Reverse(*at));
        for (at, fault) in faults {
            match fault {
                Fault::Drop => drop(all.remove(at)),
                Fault::Twice => all.insert(at, all[at].clone()),
                Fault::Swap => all.swap(at, at + 1),
                Fault::Cut(n) => { if let Some(packet) = &mut all[at] { packet.truncate(n); } }
                Fault::Bus => all[at] = None,
                Fault::Empty => all.insert(at, Some(Vec::new())),
            }
        }
        let fake = Fake::kinect(all.chunks(size).map(|some| Act::Packets(some.to_vec())));
        let mut kinect = open(&fake, Options::default()).unwrap();
        let mut frame = OwnedFrame::new();
        let mut next = 0;
        let mut delivered = 0;
        loop {
            let deadline = soon(&fake);
            match kinect.next_into(&mut frame, deadline).unwrap() {
                Outcome::Frame => {
                    let number = (next..7).find(|n| is(&frame, *n));
                    prop_assert!(number.is_some(), "a frame that was never sent, after {}", next);
                    next = number.unwrap() + 1;
                    delivered += 1;
                }
                _ if fake.world().script.is_empty() => break,
                _ => {}
            }
        }
        let stats = kinect.stats();
        prop_assert_eq!((stats.delivered, next), (delivered, 7), "the last one is whole");
        prop_assert!(stats.span() <= 7);
        prop_assert_eq!(kinect.packets().whole, stats.delivered + stats.dropped_by_policy);
    }
}
