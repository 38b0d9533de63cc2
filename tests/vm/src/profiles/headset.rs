//! A headset with firmware of our own: messages of `isobath::wire::bulk` on one bulk endpoint: who it is, depth, inertial readings.
//!
//! The firmware's side of the protocol is the core's own encoder, as in a real headset; what is simulated is the USB device around it, and
//! everything that happens to its messages on their way.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use isobath::glam::{Vec3, vec3};
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::{Camera, Distortion, Intrinsics};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::imu::ImuSample;
use isobath::wire::bulk::{
    Encoding, Hello, Serial, depth_most_bytes, encode_depth, encode_hello, encode_imu, imu_bytes,
};

use crate::pattern;
use crate::usb::{
    Configuration, Descriptors, Device, Endpoint, Identity, Kind, Next, Reply, Setup, Speed, Then, Transfer,
};

/// Where messages come from.
pub const ENDPOINT: u8 = 0x81;
/// The size of its depth images.
pub const SIZE: (usize, usize) = (160, 120);
/// Its pinhole: focal lengths and principal point, pixels.
pub const PINHOLE: [f32; 4] = [130.5, 131.25, 80.75, 58.5];
/// A step of depth, metres.
pub const UNIT_M: f32 = 0.0005;
/// Inertial readings a second.
pub const IMU_HZ: u64 = 400;
/// Readings in a message.
const BATCH: u64 = 8;

/// What happens to one depth frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// A bit of this byte of its message turns over.
    Flipped(usize),
    /// Its message ends after so many bytes.
    Cut(usize),
    /// So many bytes of noise come before it.
    Noise(usize),
    /// It is not sent; its number is.
    Skipped,
    /// The endpoint halts after so many bytes of it.
    Halt(usize),
    /// The cable is pulled after so many bytes of it.
    Unplug(usize),
    /// It comes this much later, as does everything after it.
    Late(Duration),
}

/// The device.
#[derive(Debug)]
pub struct Headset {
    /// What happens to which depth frame, by its number since power-on.
    pub faults: BTreeMap<u64, Fault>,
    /// What the device's clock shows at power-on, nanoseconds.
    pub clock: i64,
    /// How pixels travel.
    pub encoding: Encoding,
    class: [u8; 3],
    identity: Identity,
    frame: u64,
    readings: u64,
    hellos: u32,
    late: Duration,
    waiting: VecDeque<Transfer>,
}

/// The time between frames.
const FRAME: Duration = Duration::from_nanos(33_333_333);

/// A reading, by its number: turning about y faster and faster, gravity along y.
#[must_use]
pub fn reading(number: u64) -> (Vec3, Vec3) {
    let n = (number % 1000) as f32;
    (vec3(0.01, 0.001 * n, -0.02), vec3(0.1, 9.8, 0.001 * n))
}

impl Headset {
    /// A headset with these numbers (of its maker), serial number, and class of its interface.
    #[must_use]
    pub fn new(serial: &str, (vendor, product): (u16, u16), class: [u8; 3], speed: Speed) -> Self {
        let identity = Identity {
            vendor,
            product,
            class: [0; 3],
            maker: "Simulated".into(),
            name: "Headset".into(),
            serial: serial.into(),
            speed,
        };
        Self {
            faults: BTreeMap::new(),
            clock: 5_000_000_000,
            encoding: Encoding::Raw,
            class,
            identity,
            frame: 0,
            readings: 0,
            hellos: 0,
            late: Duration::ZERO,
            waiting: VecDeque::new(),
        }
    }

    /// The number that the next depth frame will have.
    #[must_use]
    pub const fn next_frame(&self) -> u64 {
        self.frame
    }

    /// The device's clock, some time after power-on.
    fn stamp(&self, at: Duration) -> Timestamp {
        Timestamp::from_nanos(self.clock + at.as_nanos() as i64)
    }

    /// When the next message of each kind is due: hello, depth, inertial.
    fn due(&self) -> [Duration; 3] {
        let readings = Duration::from_nanos(1_000_000_000 / IMU_HZ * (self.readings + BATCH));
        let hello = Duration::from_millis(500 * u64::from(self.hellos));
        [hello, FRAME * (self.frame + 1) as u32, readings].map(|due| due + self.late)
    }

    /// What nobody read in time is dropped, as a device does that has a buffer for two frames.
    fn forget(&mut self, now: Duration) {
        let old = now.saturating_sub(FRAME * 2);
        while self.due()[1] < old && !self.faults.contains_key(&self.frame) {
            self.frame += 1;
        }
        while self.due()[2] < old {
            self.readings += BATCH;
        }
        while self.due()[0] < old {
            self.hellos += 1;
        }
    }

    fn hello(&mut self, at: Duration) -> Vec<u8> {
        let [fx, fy, cx, cy] = PINHOLE;
        let depth = Intrinsics::new(fx, fy, cx, cy).ok().zip(DepthUnit::new(UNIT_M).ok()).map(|(intrinsics, unit)| {
            let camera = Camera { intrinsics, distortion: Distortion::None };
            (SIZE.0 as u16, SIZE.1 as u16, unit, camera)
        });
        let hello = Hello {
            depth,
            frame_interval: FRAME.as_micros() as u32,
            imu_millihertz: IMU_HZ as u32 * 1000,
            imu_offset: 0,
            firmware: 7,
            serial: Serial::new(&self.identity.serial).unwrap_or_default(),
        };
        let mut out = vec![0; 256];
        let used = encode_hello(&hello, self.hellos, self.stamp(at), &mut out);
        self.hellos += 1;
        sent(out, used)
    }

    fn inertial(&mut self) -> Vec<u8> {
        let nanos = 1_000_000_000 / IMU_HZ;
        let sample = |number| {
            let (rate, force) = reading(number);
            ImuSample { time: self.stamp(Duration::from_nanos(nanos * number) + self.late), rate, force, field: None }
        };
        let samples: Vec<ImuSample> = (self.readings..self.readings + BATCH).map(sample).collect();
        let mut out = vec![0; imu_bytes(samples.len(), false)];
        let used = encode_imu(&samples, (self.readings / BATCH) as u32, &mut out);
        self.readings += BATCH;
        sent(out, used)
    }

    fn depth(&mut self, at: Duration) -> Option<Transfer> {
        let frame = self.frame;
        self.frame += 1;
        let fault = self.faults.remove(&frame);
        if fault == Some(Fault::Skipped) {
            return None;
        }
        let pixels = pattern::frame(SIZE.0, SIZE.1, frame);
        let mut out = vec![0; depth_most_bytes(pixels.len(), self.encoding)];
        let (view, unit) = (ImageView::new(&pixels, SIZE.0, SIZE.1).ok()?, DepthUnit::new(UNIT_M).ok()?);
        let used = encode_depth(view, unit, 8000, self.encoding, frame as u32, self.stamp(at), &mut out);
        let mut data = sent(out, used);
        let mut then = Then::End;
        match fault {
            Some(Fault::Flipped(at)) => data[at] ^= 0x10,
            Some(Fault::Cut(bytes)) => data.truncate(bytes),
            Some(Fault::Noise(bytes)) => drop(data.splice(..0, (0..bytes).map(|i| (i * 37) as u8))),
            Some(Fault::Halt(bytes)) => {
                data.truncate(bytes);
                then = Then::Halt;
            }
            Some(Fault::Unplug(bytes)) => {
                data.truncate(bytes);
                then = Then::Unplug;
            }
            Some(Fault::Late(_) | Fault::Skipped) | None => {}
        }
        Some(Transfer { data, then })
    }
}

/// What an encoder wrote.
fn sent(mut out: Vec<u8>, used: Result<usize, impl std::fmt::Debug>) -> Vec<u8> {
    out.truncate(used.expect("the buffer is as long as the encoder asks for, and the numbers are legal"));
    out
}

impl Device for Headset {
    fn descriptors(&self) -> Descriptors {
        let mut configuration = Configuration::new(self.identity.speed);
        configuration.interface(self.class, 1);
        configuration.endpoint(Endpoint { address: ENDPOINT, kind: Kind::Bulk });
        Descriptors { identity: self.identity.clone(), configuration: configuration.finish(), reports: BTreeMap::new() }
    }

    fn control(&mut self, _: Setup, _: &[u8], _: Duration) -> Reply {
        Reply::Stall
    }

    fn transfer(&mut self, _: u8, now: Duration) -> Next {
        if self.waiting.is_empty() {
            self.forget(now);
        }
        loop {
            if let Some(transfer) = self.waiting.pop_front() {
                return Next::Now(transfer);
            }
            let due = self.due();
            let first = due.into_iter().min().unwrap_or_default();
            if first > now {
                return Next::At(first);
            }
            let [hello, depth, _] = due;
            if first == depth
                && let Some(Fault::Late(by)) = self.faults.get(&self.frame).copied()
            {
                self.faults.remove(&self.frame);
                self.late += by;
                continue;
            }
            let message = if first == hello {
                Some(Transfer { data: self.hello(first), ..Transfer::default() })
            } else if first == depth {
                self.depth(first)
            } else {
                Some(Transfer { data: self.inertial(), ..Transfer::default() })
            };
            self.waiting.extend(message);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobath::wire::bulk::{Content, Found, find};

    #[test]
    fn messages_come_in_order_of_time_and_faults_hit_their_frame() {
        let mut device = Headset::new("h", (1, 2), [0xff, 0, 0], Speed::High);
        device.faults = BTreeMap::from([(1, Fault::Flipped(1000)), (2, Fault::Skipped), (3, Fault::Noise(70))]);
        let (mut bytes, mut now) = (Vec::new(), Duration::ZERO);
        while now < Duration::from_millis(200) {
            match device.transfer(ENDPOINT, now) {
                Next::Now(transfer) => bytes.extend(transfer.data),
                Next::At(time) => now = time,
                Next::Idle => panic!("it always has something to send"),
            }
        }
        let (mut frames, mut readings, mut hellos, mut damaged, mut noise) = (Vec::new(), 0, 0, 0, 0);
        let mut rest = &bytes[..];
        loop {
            match find(rest, 1 << 20) {
                Found::Message { message, garbage, used } => {
                    noise += garbage;
                    match message.content().unwrap() {
                        Content::Depth(_) => frames.push(message.header.sequence),
                        Content::Imu(imu) => {
                            for sample in imu.iter() {
                                assert_eq!((sample.rate, sample.force), reading(readings));
                                readings += 1;
                            }
                        }
                        Content::Hello(_) => hellos += 1,
                        other => panic!("{other:?}"),
                    }
                    rest = &rest[used..];
                }
                Found::Damaged { used, .. } => {
                    damaged += 1;
                    rest = &rest[used..];
                }
                Found::More { .. } => break,
            }
        }
        assert_eq!(frames, [0, 3, 4, 5]);
        assert_eq!((hellos, damaged), (1, 1));
        assert!(readings >= 72 && noise > 70, "{readings} {noise}");
    }
}
