//! Clock maps against simulated clocks whose truth is known: skew, delay, wraps, resets, steps.

use isobath_source::{ClockEvent, ClockMap, DeviceClock, DeviceTicks, HostNanos};
use proptest::prelude::*;

/// A device that stamps in microseconds, off by `skew`, seen over a link of random delay.
#[derive(Debug, Clone)]
struct Link {
    skew: f64,
    boot: u64,
    start_us: u64,
    interval_us: u64,
    jitter_us: u32,
    delays: Vec<u32>,
}

impl Link {
    /// Of frame n: the true device time (us, unwrapped), when it happened by the host's clock, and when it arrived (ns).
    fn frame(&self, n: u64) -> (u64, u64, u64) {
        let device = self.start_us + n * self.interval_us;
        let happened = self.boot + ((n * self.interval_us) as f64 * 1e3 * (1.0 + self.skew)) as u64;
        let delay = self.delays[n as usize % self.delays.len()] % self.jitter_us.max(1);
        (device, happened, happened + 1_000_000 + u64::from(delay) * 1000)
    }
}

fn links() -> impl Strategy<Value = Link> {
    (
        -200e-6..200e-6,
        0_u64..1 << 50,
        0_u64..1 << 33,
        4_000_u64..70_000,
        0_u32..20_000,
        prop::collection::vec(any::<u32>(), 400..800),
    )
        .prop_map(|(skew, boot, start_us, interval_us, jitter_us, delays)| Link {
            skew,
            boot,
            start_us,
            interval_us,
            jitter_us,
            delays,
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Whatever the skew, the delays and the wraps: after a window the mapped times are right to a part of the jitter, the skew is found, and
    /// nothing ever goes backwards, asked for in or a little out of order.
    #[test]
    fn finds_the_truth_through_jitter_and_wraps(link in links(), wrap_soon: bool) {
        let link = Link { start_us: if wrap_soon { (1 << 32) - 20 * 1_000_000 } else { link.start_us }, ..link };
        let mut clock = DeviceClock::new(32, 1e6).unwrap();
        let frames = 60_000_000 / link.interval_us;
        let mut latest = HostNanos(0);
        let mut first = None;
        for n in 0..frames {
            let (device, happened, arrival) = link.frame(n);
            let (ticks, event) = clock.observe(device & 0xffff_ffff, HostNanos(arrival));
            prop_assert_eq!(event, ClockEvent::Steady);
            let zero = *first.get_or_insert(device - ticks.0);
            prop_assert_eq!(ticks.0 + zero, device);
            let host = clock.to_host(ticks).unwrap();
            prop_assert!(host >= latest, "frame {}: {:?} after {:?}", n, host, latest);
            latest = host;
            // An inertial reading between the frames, asked for late, and one ahead of them.
            let before = clock.to_host(DeviceTicks(ticks.0.saturating_sub(1000))).unwrap();
            prop_assert!(before <= host);
            latest = latest.max(clock.to_host(DeviceTicks(ticks.0 + 500)).unwrap());
            if n > frames / 2 {
                let off = host.0 as f64 - (happened + 1_000_000) as f64;
                let allowed = 40e3 + f64::from(link.jitter_us) * 1e3 * 0.15;
                prop_assert!(off.abs() < allowed, "frame {}: off by {} ns of {} us jitter", n, off, link.jitter_us);
            }
        }
        let e = clock.estimate().unwrap();
        prop_assert!((e.skew - link.skew).abs() < 5e-6 + f64::from(link.jitter_us) * 1e-6 * 0.01, "{:?} against {}", e, link.skew);
        prop_assert_eq!(e.pairs, frames);
    }

    /// A device that resets at any time, a host whose stamps jump, in any order: every jump is reported, time never goes backwards, and it is
    /// right again afterwards.
    #[test]
    fn jumps_are_told_and_survived(
        link in links(),
        jumps in prop::collection::btree_map(30_u64..600, (0_u64..1 << 32, 0_u64..5_000_000_000), 0..6),
    ) {
        let mut clock = DeviceClock::new(32, 1e6).unwrap();
        let (mut shift, mut host_shift) = (0_u64, 0_u64);
        let (mut latest_ticks, mut latest) = (DeviceTicks(0), HostNanos(0));
        let mut near = 0;
        for n in 0..900 {
            let (device, _, arrival) = link.frame(n);
            let mut certain = None;
            if let Some(&(to, host)) = jumps.get(&n) {
                let old = device.wrapping_add(shift) & 0xffff_ffff;
                let by = to.abs_diff(old).min((1 << 32) - to.abs_diff(old)) * 1000;
                shift = to.wrapping_sub(device);
                host_shift += host;
                // What differs by little more or less than a second, with jitter, may be taken either way.
                let sum_apart = by.abs_diff(host) > 1_200_000_000 && by + host > 1_200_000_000;
                certain = Some(sum_apart && by > 2 * host + 1_200_000_000);
                near += u64::from(certain == Some(false));
            }
            let (ticks, event) = clock.observe(device.wrapping_add(shift) & 0xffff_ffff, HostNanos(arrival + host_shift));
            match certain {
                Some(true) => prop_assert_eq!(event, ClockEvent::Jump, "frame {}", n),
                Some(false) => {}
                None if near == 0 => prop_assert_eq!(event, ClockEvent::Steady, "frame {}", n),
                None => {}
            }
            prop_assert!(ticks > latest_ticks || n == 0 || near > 0, "{:?} after {:?}", ticks, latest_ticks);
            let host = clock.to_host(ticks).unwrap();
            prop_assert!(host >= latest);
            (latest_ticks, latest) = (latest_ticks.max(ticks), latest.max(host));
        }
    }
}

#[test]
fn a_small_step_back_is_a_jump_and_a_little_disorder_is_none() {
    let mut clock = DeviceClock::new(32, 1e6).unwrap();
    let mut latest = HostNanos(0);
    for n in 0..100_u64 {
        // At frame 50 the device starts anew 0.9 s behind; every tenth reading is 5 ms late.
        let device = 2_000_000 + n * 33_333 - if n >= 50 { 900_000 } else { 0 } - if n % 10 == 9 { 5_000 } else { 0 };
        let (ticks, event) = clock.observe(device, HostNanos(5_000_000_000 + n * 33_333_000));
        assert_eq!(event == ClockEvent::Jump, n == 50, "reading {n}");
        let host = clock.to_host(ticks).unwrap();
        assert!(host >= latest, "reading {n}");
        latest = host;
    }
    let (early, event) =
        clock.observe(2_000_000 + 99 * 33_333 - 900_000 - 40_000, HostNanos(5_000_000_000 + 99 * 33_333_000));
    assert_eq!(event, ClockEvent::Steady);
    assert!(clock.to_host(early).unwrap() < latest, "out of order it is, and stays");
}

#[test]
fn a_long_silence_is_no_jump() {
    let mut clock = DeviceClock::new(32, 1e6).unwrap();
    clock.observe(1_000_000, HostNanos(7_000_000_000));
    // Ten hours, eight wraps and 30 parts in a million later.
    let hours = 36_000_000_000_u64;
    let (ticks, event) =
        clock.observe((1_000_000 + hours) & 0xffff_ffff, HostNanos(7_000_000_000 + hours * 1000 + 1_080_000_000));
    assert_eq!((ticks.0, event), (1_000_000 + hours, ClockEvent::Steady));
}

#[test]
fn host_time_that_steps_back_is_told_and_never_passed_on() {
    let mut clock = DeviceClock::new(32, 1e6).unwrap();
    let mut latest = HostNanos(0);
    let mut jumps = 0;
    for n in 0..600_u64 {
        let step = if n < 300 { 3_600_000_000_000 } else { 0 };
        let (ticks, event) = clock.observe(n * 33_333, HostNanos(1_000_000_000 + step + n * 33_333_000));
        jumps += u64::from(event == ClockEvent::Jump);
        let host = clock.to_host(ticks).unwrap();
        assert!(host >= latest);
        latest = host;
    }
    assert_eq!(jumps, 1);
}

#[test]
fn rates_that_are_none_are_refused() {
    for hz in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e13, 1e-4] {
        assert!(ClockMap::new(hz).is_none() && DeviceClock::new(32, hz).is_none(), "{hz}");
    }
    let mut map = ClockMap::new(1e3).unwrap();
    assert!(map.to_host(DeviceTicks(5)).is_none() && map.estimate().is_none());
    // Pairs at the ends of both clocks.
    for (t, h) in [(0, u64::MAX), (1, 0), (u64::MAX, u64::MAX), (2, 5)] {
        map.observe(DeviceTicks(t), HostNanos(h));
        assert!(map.to_host(DeviceTicks(t)).is_some() && map.estimate().is_some());
        map.restart(DeviceTicks(t), HostNanos(h));
    }
}
