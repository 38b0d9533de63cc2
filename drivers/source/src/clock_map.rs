//! From a device's clock to the host's: offset, skew, and how well both are known.
//!
//! The host sees a device's stamp `ticks` only when the frame arrives, after a delay that is never negative: all pairs (ticks, arrival) lie on or
//! above the line `host = offset + rate ticks + least delay`, and the frames with little delay touch it. So the line is the lower envelope of the
//! pairs: of each second the pair of least delay is kept, and the edge of their lower convex hull below the middle of the window is the line that
//! lies below all of them and nearest to them in sum (Moon, Skelly, Towsley 1999, "Estimation and removal of clock skew from network delay
//! measurements", section 4). Averages and regressions, which librealsense's global time uses, follow every burst of delay; the envelope does not.
//!
//! What is published is not the line but a chain of segments that is led towards it: continuous, with a positive slope everywhere, never bent before
//! the latest time that was observed or asked for. So mapped times never go backwards, whatever is learnt in between, and no test of time can
//! find two frames in the wrong order.
//!
//! * Memory: 2.7 kB, no allocation. Cost of a pair: a hull of at most 33 points, 0.3 microseconds; of a mapped time: a search in at most 32 segments.
//! * Error: the least delay itself can't be seen (it belongs to the device's calibration). Beyond it: the spread of the least delays of a
//!   second, divided over the window of 32 s. [`ClockEstimate::residual`] measures it.

use std::time::Duration;

use crate::clock::HostNanos;
use crate::ticks::{DeviceTicks, TickCounter};

/// Seconds whose least delays are kept.
const BINS: usize = 32;
/// Length of a bin, nanoseconds.
const BIN: u64 = 1_000_000_000;
/// Bends of the published chain that are remembered: half a minute, when nothing unusual happens.
const SEGMENTS: usize = 32;
/// Clocks of quartz are off by tens of parts in a million; beyond this a slope is noise.
const MAX_SKEW: f64 = 1e-3;
/// Below this span of the window, nanoseconds, the skew is not estimated: 3 s.
const MIN_SPAN: f64 = 3e9;
/// A pair this far below the published chain bends it at once, nanoseconds.
const URGENT: f64 = 1e5;
/// An arrival that much off what the clocks say is a jump: 1 s, and a part in a thousand of the silence before it.
const JUMP: f64 = 1e9;
/// Readings may come out of order by this much, nanoseconds (two sensors of one clock); what lies further back is a jump.
const OUT_OF_ORDER: f64 = 1e8;

#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    ticks: u64,
    host: u64,
}

impl Pair {
    /// Nanoseconds after `zero`: of the device at its nominal rate, and of the host beyond that.
    fn relative(self, zero: Self, nominal: f64) -> (f64, f64) {
        let x = difference(self.ticks, zero.ticks) * nominal;
        (x, difference(self.host, zero.host) - x)
    }
}

fn difference(a: u64, b: u64) -> f64 {
    if a >= b { (a - b) as f64 } else { -((b - a) as f64) }
}

fn moved(host: u64, nanos: f64) -> u64 {
    if nanos >= 0.0 { host.saturating_add(nanos as u64) } else { host.saturating_sub((-nanos) as u64) }
}

/// From `from` on, host time is led towards the line until `until`, and then goes along with it. Slopes are nanoseconds a tick.
#[derive(Debug, Clone, Copy, Default)]
struct Segment {
    from: u64,
    host: u64,
    slope: f64,
    until: u64,
    after: f64,
}

impl Segment {
    fn at(&self, ticks: u64) -> u64 {
        let bend = |t: u64| moved(self.host, difference(t, self.from) * self.slope);
        if ticks <= self.until {
            bend(ticks)
        } else {
            moved(bend(self.until), difference(ticks, self.until) * self.after)
        }
    }
}

/// What is known of two clocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockEstimate {
    /// Host time of a device time: the newest pair's device time, on the line.
    pub anchor: (DeviceTicks, HostNanos),
    /// How much faster the host's clock runs than the device's nominal rate says, as a ratio: 20e-6 is 20 parts in a million. 0 until the
    /// window is 3 s long.
    pub skew: f64,
    /// Root mean square of how far the least delays of each second lie above the line: what mapped times are unsure by.
    pub residual: Duration,
    /// The oldest pair in use.
    pub since: HostNanos,
    /// Pairs seen since the last jump.
    pub pairs: u64,
}

/// The line in nanoseconds after `zero`.
#[derive(Debug, Clone, Copy)]
struct Line {
    zero: Pair,
    skew: f64,
    offset: f64,
    residual: f64,
    pairs: u64,
}

/// Maps a device's unwrapped clock to the host's.
///
/// ```
/// use isobath_source::{ClockMap, DeviceTicks, HostNanos};
/// let mut map = ClockMap::new(1e6).expect("a positive rate"); // microseconds
/// // Frames every 33 ms; their delay is 2 ms, now and then more.
/// for n in 0..300_u64 {
///     let delay = if n % 3 == 0 { 2_000_000 } else { 9_000_000 };
///     map.observe(DeviceTicks(n * 33_000), HostNanos(5_000_000_000 + n * 33_000_000 + delay));
/// }
/// let exposed = map.to_host(DeviceTicks(301 * 33_000)).unwrap();
/// assert!(exposed.0.abs_diff(5_000_000_000 + 301 * 33_000_000 + 2_000_000) < 10_000);
/// ```
#[derive(Debug, Clone)]
pub struct ClockMap {
    nominal: f64,
    bins: [Pair; BINS],
    used: usize,
    /// The bin that is being filled: its best pair, and when it began.
    current: Option<(Pair, u64)>,
    last: Option<Pair>,
    pairs: u64,
    skew: f64,
    line: Option<Line>,
    segments: [Segment; SEGMENTS],
    bends: usize,
    newest: u64,
}

impl ClockMap {
    /// For a clock of `hz` steps a second; `None` unless that is a positive number from 1e-3 to 1e12.
    #[must_use]
    pub fn new(hz: f64) -> Option<Self> {
        (1e-3..=1e12).contains(&hz).then(|| Self {
            nominal: 1e9 / hz,
            bins: [Pair::default(); BINS],
            used: 0,
            current: None,
            last: None,
            pairs: 0,
            skew: 0.0,
            line: None,
            segments: [Segment::default(); SEGMENTS],
            bends: 0,
            newest: 0,
        })
    }

    /// Nanoseconds that one step nominally lasts.
    #[must_use]
    pub const fn nanos_per_tick(&self) -> f64 {
        self.nominal
    }

    /// Learns that what the device stamped `ticks` was here at `arrival`. Pairs come in the order of their ticks; one that doesn't teaches nothing.
    pub fn observe(&mut self, ticks: DeviceTicks, arrival: HostNanos) {
        let pair = Pair { ticks: ticks.0, host: arrival.0 };
        if self.last.is_some_and(|last| pair.ticks <= last.ticks) {
            return;
        }
        self.last = Some(pair);
        self.pairs += 1;
        let mut closed = false;
        self.current = Some(match self.current {
            Some((best, began)) if pair.host.saturating_sub(began) >= BIN => {
                self.keep(best);
                closed = true;
                (pair, pair.host)
            }
            Some((best, began)) => {
                let later = pair.relative(best, self.nominal).1 > 0.0;
                (if later { best } else { pair }, began)
            }
            None => (pair, pair.host),
        });
        let line = self.fit();
        self.line = Some(line);
        if self.bends == 0 {
            self.begin(pair, 1.0 + line.skew);
        } else if closed || difference(pair.host, self.published(pair.ticks)) < -URGENT {
            self.bend(line, pair.ticks);
        }
        self.newest = self.newest.max(pair.ticks);
    }

    /// Host time of a device time; `None` before the first pair. Asked in any order, later device times never get earlier host times, except
    /// for times more than 32 bends (about half a minute) ago.
    pub fn to_host(&mut self, ticks: DeviceTicks) -> Option<HostNanos> {
        if self.bends == 0 {
            return None;
        }
        let host = self.published(ticks.0);
        self.newest = self.newest.max(ticks.0);
        Some(HostNanos(host))
    }

    /// What is known; `None` before the first pair.
    #[must_use]
    pub fn estimate(&self) -> Option<ClockEstimate> {
        let (line, last) = (self.line?, self.last?);
        let (x, _) = last.relative(line.zero, self.nominal);
        let host = moved(line.zero.host, line.offset + x * (1.0 + line.skew));
        Some(ClockEstimate {
            anchor: (DeviceTicks(last.ticks), HostNanos(host)),
            skew: line.skew,
            residual: Duration::from_nanos(line.residual as u64),
            since: HostNanos(line.zero.host),
            pairs: line.pairs,
        })
    }

    /// Forgets all pairs, because one of the clocks jumped, and goes on from this one. Mapped times stay in order: they may jump forward.
    pub fn restart(&mut self, ticks: DeviceTicks, arrival: HostNanos) {
        (self.used, self.current, self.last, self.pairs, self.line) = (0, None, None, 0, None);
        if self.bends > 0 {
            let from = self.newest.max(ticks.0);
            let host = self.published(from).max(arrival.0);
            self.push(Segment { from, host, slope: self.nominal, until: from, after: self.nominal });
        }
        self.observe(ticks, arrival);
    }

    fn keep(&mut self, pair: Pair) {
        if self.used == BINS {
            self.bins.rotate_left(1);
            self.used -= 1;
        }
        self.bins[self.used] = pair;
        self.used += 1;
    }

    /// The lower envelope of the bins' best pairs.
    fn fit(&mut self) -> Line {
        let mut points = [(0.0, 0.0); BINS + 1];
        let mut n = 0;
        let current = self.current.map(|(pair, _)| pair);
        let zero = self.bins[..self.used].first().copied().or(current).unwrap_or_default();
        for pair in self.bins[..self.used].iter().copied().chain(current) {
            points[n] = pair.relative(zero, self.nominal);
            n += 1;
        }
        let points = &points[..n];

        // Andrew's monotone chain: the lower hull of points in the order of x.
        let mut hull = [(0.0, 0.0); BINS + 1];
        let mut m = 0;
        for &p in points {
            while m >= 2 && cross(hull[m - 2], hull[m - 1], p) <= 0.0 {
                m -= 1;
            }
            hull[m] = p;
            m += 1;
        }
        let hull = &hull[..m];
        let span = points.last().map_or(0.0, |p| p.0);
        if span >= MIN_SPAN {
            let middle = points.iter().map(|p| p.0).sum::<f64>() / n as f64;
            let edge = hull.windows(2).find(|e| e[0].0 <= middle && middle <= e[1].0);
            if let Some(&[a, b]) = edge {
                self.skew = ((b.1 - a.1) / (b.0 - a.0)).clamp(-MAX_SKEW, MAX_SKEW);
            }
        }
        let skew = self.skew;
        let offset = points.iter().map(|p| p.1 - skew * p.0).fold(f64::INFINITY, f64::min);
        let squares: f64 = points.iter().map(|p| (p.1 - skew * p.0 - offset).powi(2)).sum();
        Line { zero, skew, offset, residual: (squares / n.max(1) as f64).sqrt(), pairs: self.pairs }
    }

    fn published(&self, ticks: u64) -> u64 {
        let segments = &self.segments[..self.bends];
        let at = segments.iter().rposition(|s| s.from <= ticks).unwrap_or(0);
        segments.get(at).map_or(0, |s| s.at(ticks))
    }

    fn begin(&mut self, pair: Pair, rate: f64) {
        let slope = self.nominal * rate;
        self.push(Segment { from: pair.ticks, host: pair.host, slope, until: pair.ticks, after: slope });
    }

    /// Leads the published chain to the line within the next second, never by more than half the rate.
    fn bend(&mut self, line: Line, ticks: u64) {
        let from = self.newest.max(ticks);
        let host = self.published(from);
        let (x, _) = Pair { ticks: from, host }.relative(line.zero, self.nominal);
        let target = line.offset + x * (1.0 + line.skew);
        let error = target - difference(host, line.zero.host);
        let after = self.nominal * (1.0 + line.skew);
        let second = (BIN as f64 / self.nominal).max(1.0);
        let slope = (after + error / second).clamp(0.5 * self.nominal, 1.5 * self.nominal);
        self.push(Segment { from, host, slope, until: from.saturating_add(second as u64), after });
    }

    fn push(&mut self, segment: Segment) {
        // A second bend at the same time replaces the first: its slopes were never asked for beyond it.
        if self.bends > 0 && self.segments[self.bends - 1].from == segment.from {
            self.segments[self.bends - 1] = segment;
            return;
        }
        if self.bends == SEGMENTS {
            self.segments.rotate_left(1);
            self.bends -= 1;
        }
        self.segments[self.bends] = segment;
        self.bends += 1;
    }
}

fn cross(a: (f64, f64), b: (f64, f64), c: (f64, f64)) -> f64 {
    (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)
}

/// What a reading said about the device's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockEvent {
    /// The clock goes on.
    Steady,
    /// Device and host no longer fit each other: the device was reset, or the host's stamps jumped. Ticks were carried on by the host's clock.
    Jump,
}

/// A device's wrapping clock and its [`ClockMap`] together: unwraps by what the host's clock leads to expect, and finds jumps.
///
/// ```
/// use isobath_source::{ClockEvent, DeviceClock, HostNanos};
/// let mut clock = DeviceClock::new(32, 1e6).expect("a positive rate");
/// let (first, _) = clock.observe(4_294_960_000, HostNanos(1_000_000_000));
/// let (second, event) = clock.observe(25_704, HostNanos(1_033_000_000)); // wrapped: 33 ms later
/// assert_eq!((second.0 - first.0, event), (33_000, ClockEvent::Steady));
/// let (third, event) = clock.observe(5_000_000, HostNanos(1_066_000_000)); // 5 s on, within 33 ms: another life
/// assert_eq!((third.0 - second.0, event), (33_000, ClockEvent::Jump)); // carried on by the host's clock
/// ```
#[derive(Debug, Clone)]
pub struct DeviceClock {
    counter: TickCounter,
    map: ClockMap,
    /// Added to readings since the last jump.
    shift: u64,
    last: Option<Pair>,
}

impl DeviceClock {
    /// For a counter of `bits` bits and `hz` steps a second; `None` unless the rate is from 1e-3 to 1e12 Hz.
    #[must_use]
    pub fn new(bits: u32, hz: f64) -> Option<Self> {
        Some(Self { counter: TickCounter::new(bits), map: ClockMap::new(hz)?, shift: 0, last: None })
    }

    /// Takes a reading that arrived at `arrival`: its unwrapped time, never earlier than the reading's before unless it came out of order.
    pub fn observe(&mut self, raw: u64, arrival: HostNanos) -> (DeviceTicks, ClockEvent) {
        let Some(last) = self.last else {
            let ticks = self.counter.unwrap(raw);
            self.map.observe(ticks, arrival);
            self.last = Some(Pair { ticks: ticks.0, host: arrival.0 });
            return (ticks, ClockEvent::Steady);
        };
        let nominal = self.map.nanos_per_tick();
        let silence = difference(arrival.0, last.host);
        let expected = moved(last.ticks, silence / nominal);
        let ticks = self.counter.unwrap_near(raw.wrapping_add(self.shift), DeviceTicks(expected));
        let off = difference(ticks.0, expected) * nominal;
        let back = difference(last.ticks, ticks.0) * nominal;
        if off.abs() > JUMP + silence.abs() * MAX_SKEW || silence < -JUMP || back > OUT_OF_ORDER {
            // Go on where the device would be by the host's clock, one step on at least.
            let ticks = DeviceTicks(expected.max(last.ticks.saturating_add(1)));
            self.shift = ticks.0.wrapping_sub(raw);
            self.counter.unwrap_near(ticks.0, ticks);
            self.map.restart(ticks, arrival);
            self.last = Some(Pair { ticks: ticks.0, host: arrival.0 });
            return (ticks, ClockEvent::Jump);
        }
        self.map.observe(ticks, arrival);
        if ticks.0 > last.ticks {
            self.last = Some(Pair { ticks: ticks.0, host: arrival.0 });
        }
        (ticks, ClockEvent::Steady)
    }

    /// Host time of a device time; `None` before the first reading. Never goes backwards: see [`ClockMap::to_host`].
    pub fn to_host(&mut self, ticks: DeviceTicks) -> Option<HostNanos> {
        self.map.to_host(ticks)
    }

    /// What is known of the two clocks; `None` before the first reading.
    #[must_use]
    pub fn estimate(&self) -> Option<ClockEstimate> {
        self.map.estimate()
    }
}
