//! A motion sensor as a HID sensor hub: accelerometer and gyroscope, each a collection with a feature report (on or off, how often) and
//! an input report (axes, the device's time).
//!
//! Linux makes two industrial-IO devices of it, `accel_3d` and `gyro_3d`. Sources: HID Sensor Usages (HUTRR39), HID 1.11 section 6.2.2; the
//! units of Intel's cameras: 0.001 g and 0.1 degrees a second. Axes have 16 bits, which the kernel puts into cells of 32 with whatever
//! lies beside them above: a reader has to extend the sign itself.

use std::time::Duration;

use crate::usb::{Configuration, Endpoint, Kind, Next, Reply, Setup, Transfer};

/// Which sensor: also the number of its reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensor {
    /// 0.001 g a step.
    Accelerometer = 1,
    /// 0.1 degrees a second a step.
    Gyroscope = 2,
}

/// Both.
pub const SENSORS: [Sensor; 2] = [Sensor::Accelerometer, Sensor::Gyroscope];

/// A reading: the sensor and the reading's number give three axes, in steps.
pub type Motion = fn(Sensor, u64) -> [i16; 3];

/// What becomes of one sensor.
#[derive(Debug, Clone)]
struct State {
    /// Number, reporting state, power state, period in milliseconds (32 bits), sensitivity (16 bits).
    feature: Vec<u8>,
    next: u64,
    due: Duration,
}

/// The function of a device.
#[derive(Debug)]
pub struct Hub {
    /// Its interface.
    pub interface: u8,
    /// What is felt.
    pub motion: Motion,
    /// What the device's clock showed when it was plugged in, microseconds.
    pub clock: u64,
    endpoint: u8,
    sensors: [State; 2],
}

/// Bytes of a feature report.
const FEATURE: usize = 9;

impl Hub {
    /// A hub that reports through `endpoint` (bit 7 set), switched off.
    #[must_use]
    pub fn new(endpoint: u8, motion: Motion) -> Self {
        let sensors = SENSORS.map(|sensor| State {
            feature: vec![sensor as u8, 0, 0, 5, 0, 0, 0, 0, 0],
            next: 0,
            due: Duration::ZERO,
        });
        Self { interface: 0, motion, clock: 1_000_000, endpoint, sensors }
    }

    /// Adds its interface to a device.
    pub fn describe(&mut self, configuration: &mut Configuration) {
        self.interface = configuration.interface([3, 0, 0], 1);
        let [low, high] = (report_descriptor().len() as u16).to_le_bytes();
        configuration.class_specific(&[9, 0x21, 0x11, 1, 0, 1, 0x22, low, high]);
        // Asked for every millisecond.
        let kind = Kind::Interrupt { bytes: 64, interval: 4 };
        configuration.endpoint(Endpoint { address: self.endpoint, kind });
    }

    /// Answers a request; `None` when it is for another interface.
    pub fn control(&mut self, setup: Setup, data: &[u8], now: Duration) -> Option<Reply> {
        const INPUT: u8 = 1;
        const FEATURE_REPORT: u8 = 3;
        if !matches!(setup.kind, 0x21 | 0xa1) || setup.index != u16::from(self.interface) {
            return None;
        }
        let [number, kind] = setup.value.to_le_bytes();
        if setup.request == 0x0a {
            return Some(Reply::Done); // no reports while nothing changes: never the case here
        }
        let Some(sensor) = SENSORS.into_iter().find(|s| *s as u8 == number) else { return Some(Reply::Stall) };
        let state = &mut self.sensors[sensor as usize - 1];
        Some(match (setup.kind, setup.request, kind) {
            (0xa1, 1, FEATURE_REPORT) => Reply::Data(state.feature.clone()),
            (0xa1, 1, INPUT) => Reply::Data(self.report(sensor, now)),
            (0x21, 9, FEATURE_REPORT) => {
                state.feature = data.to_vec();
                state.feature.resize(FEATURE, 0);
                state.due = now + state.period();
                Reply::Done
            }
            _ => Reply::Stall,
        })
    }

    /// What its endpoint sends.
    pub fn transfer(&mut self, now: Duration) -> Next {
        let on = SENSORS.into_iter().filter(|s| self.sensors[*s as usize - 1].is_on());
        let Some(sensor) = on.min_by_key(|s| self.sensors[*s as usize - 1].due) else { return Next::Idle };
        let due = self.sensors[sensor as usize - 1].due;
        if due > now {
            return Next::At(due);
        }
        let data = self.report(sensor, due);
        let state = &mut self.sensors[sensor as usize - 1];
        state.next += 1;
        state.due += state.period();
        Next::Now(Transfer { data, ..Transfer::default() })
    }

    /// Readings sent so far.
    #[must_use]
    pub const fn sent(&self, sensor: Sensor) -> u64 {
        self.sensors[sensor as usize - 1].next
    }

    /// An input report: number, state "ready", event "updated", axes, the device's time in microseconds.
    fn report(&self, sensor: Sensor, at: Duration) -> Vec<u8> {
        let mut out = vec![sensor as u8, 2, 3];
        let axes = (self.motion)(sensor, self.sensors[sensor as usize - 1].next);
        out.extend(axes.iter().flat_map(|axis| axis.to_le_bytes()));
        out.extend((self.clock + at.as_micros() as u64).to_le_bytes());
        out
    }
}

impl State {
    /// Linux selects "all events" and "full power" by 2 here.
    fn is_on(&self) -> bool {
        self.feature[1] == 2 && self.feature[2] == 2
    }

    fn period(&self) -> Duration {
        let millis = self.feature.get(3..7).and_then(|b| b.try_into().ok()).map_or(5, u32::from_le_bytes);
        Duration::from_millis(u64::from(millis.max(1)))
    }
}

/// Items of a report descriptor (HID 1.11, section 6.2.2): what a field means and how it is laid out.
struct Items(Vec<u8>);

const INPUT: u8 = 0x81;
const FEATURE_ITEM: u8 = 0xb1;

impl Items {
    fn put(&mut self, bytes: &[u8]) -> &mut Self {
        self.0.extend(bytes);
        self
    }

    /// A usage of the sensor page.
    fn usage(&mut self, usage: u16) -> &mut Self {
        let [low, high] = usage.to_le_bytes();
        self.put(&[0x0a, low, high])
    }

    /// A byte that selects one of `count` named values.
    fn choice(&mut self, usage: u16, first: u16, count: u8, main: u8) -> &mut Self {
        self.usage(usage).put(&[0x15, 0, 0x25, count - 1, 0x75, 8, 0x95, 1, 0xa1, 2]);
        for value in 0..u16::from(count) {
            self.usage(first + value);
        }
        self.put(&[main, 0, 0xc0])
    }

    /// `count` unsigned numbers of 32 bits, times ten to the `exponent` (a nibble: 0xa is -6).
    fn long(&mut self, usage: u16, count: u8, exponent: u8, main: u8) -> &mut Self {
        self.usage(usage).put(&[0x15, 0, 0x27, 0xff, 0xff, 0xff, 0x7f, 0x75, 32, 0x95, count, 0x55, exponent, main, 2])
    }

    /// A signed number of 16 bits.
    fn short(&mut self, usage: u16, exponent: u8, main: u8) -> &mut Self {
        self.usage(usage).put(&[0x16, 0x01, 0x80, 0x26, 0xff, 0x7f, 0x75, 16, 0x95, 1, 0x55, exponent, main, 2])
    }
}

/// The whole hub's.
#[must_use]
pub fn report_descriptor() -> Vec<u8> {
    let mut items = Items(Vec::new());
    // The sensor page; a collection of sensors.
    items.put(&[0x05, 0x20, 0x09, 0x01, 0xa1, 0x00]);
    for sensor in SENSORS {
        // Usage of the sensor, of its first axis, of its sensitivity; the exponent of its unit: -3 of g, -1 of degrees a second.
        let (usage, axis, sensitivity, exponent) = match sensor {
            Sensor::Accelerometer => (0x73, 0x0453, 0x1452, 0x0d),
            Sensor::Gyroscope => (0x76, 0x0457, 0x1456, 0x0f),
        };
        items.put(&[0x05, 0x20, 0x09, usage, 0xa1, 0x00, 0x85, sensor as u8]);
        items.choice(0x0316, 0x0840, 6, FEATURE_ITEM); // reporting state
        items.choice(0x0319, 0x0850, 6, FEATURE_ITEM); // power state
        items.long(0x030e, 1, 0, FEATURE_ITEM); // period, milliseconds
        items.short(sensitivity, exponent, FEATURE_ITEM);
        items.choice(0x0201, 0x0800, 7, INPUT); // state
        items.choice(0x0202, 0x0810, 6, INPUT); // event
        for k in 0..3 {
            items.short(axis + k, exponent, INPUT);
        }
        items.long(0x0529, 2, 0x0a, INPUT); // time, microseconds, 64 bits
        items.put(&[0xc0]);
    }
    items.put(&[0xc0]);
    items.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_come_in_order_of_time_and_only_when_switched_on() {
        let mut hub = Hub::new(0x83, |sensor, n| [sensor as i16, n as i16, -1]);
        assert_eq!(hub.transfer(Duration::from_secs(1)), Next::Idle);
        let set = |number: u8| Setup { kind: 0x21, request: 9, value: 0x300 | u16::from(number), index: 0, length: 9 };
        hub.control(set(1), &[1, 2, 2, 10, 0, 0, 0, 0, 0], Duration::ZERO).unwrap();
        hub.control(set(2), &[2, 2, 2, 4, 0, 0, 0, 0, 0], Duration::ZERO).unwrap();
        let mut got = Vec::new();
        while let Next::Now(t) = hub.transfer(Duration::from_millis(20)) {
            got.push((t.data[0], t.data[5], u64::from_le_bytes(t.data[9..17].try_into().unwrap()) - 1_000_000));
        }
        let expected = [
            (2, 0, 4000),
            (2, 1, 8000),
            (1, 0, 10_000),
            (2, 2, 12_000),
            (2, 3, 16_000),
            (1, 1, 20_000),
            (2, 4, 20_000),
        ];
        assert_eq!(got, expected);
    }
}
