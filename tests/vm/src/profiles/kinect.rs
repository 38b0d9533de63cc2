//! Like the depth camera of Microsoft's Kinect for Xbox 360: registers and constants through vendor requests, disparity of 11 bits in
//! isochronous packets.
//!
//! Commands and answers have a header of eight bytes (`GM` asks, `RB` answers, length in words, command, number). A frame is 242 packets with a
//! header of twelve bytes (`RB`, first/middle/last, a counter of eight bits, a time stamp). The numbers are those of libfreenect's `cameras.c`, `flags.c` and
//! `registration.c`, written down in `spec/drivers.md` of this project's notes, section 1.4; nothing here uses our own decoder, or its
//! constants.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use crate::usb::{Configuration, Descriptors, Device, Endpoint, Identity, Kind, Packet, Reply, Setup, Speed, errno};

/// The endpoint of depth.
const DEPTH: u8 = 0x82;
/// The size of its images.
pub const SIZE: (usize, usize) = (640, 480);
/// Disparity for "nothing seen".
pub const NOTHING: u16 = 2047;
/// What the device says of its geometry: baseline, reference distance and pixel size in centimetres, the constant shift.
pub const GEOMETRY: (f32, f32, f32, u16) = (7.5, 120.0, 0.1042, 200);
/// The time stamp's ticks in a second.
pub const CLOCK_HZ: u32 = 60_000_000;

const HEADER: usize = 12;
const DATA: usize = 1748;

/// Registers that matter.
const DEPTH_ON: u16 = 0x06;
const DEPTH_FORMAT: u16 = 0x12;

/// What happens to one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fault {
    /// These packets are lost on the wire, and the bus says so.
    Lost(BTreeSet<usize>),
    /// These packets never left the camera: only their counter tells.
    Skipped(BTreeSet<usize>),
    /// This packet is cut off after so many bytes.
    Cut(usize, usize),
    /// The cable is pulled instead of this packet.
    Unplug(usize),
}

/// The camera.
#[derive(Debug)]
pub struct Kinect {
    /// What happens to which frame, by its number since power-on.
    pub faults: BTreeMap<u64, Fault>,
    /// What the time stamp was at power-on.
    pub clock: u32,
    /// Answers to the first questions for an answer are empty so often: the device takes its time.
    pub slow: u32,
    /// Whether it tells its geometry.
    pub knows_geometry: bool,
    identity: Identity,
    registers: BTreeMap<u16, u16>,
    answer: Option<(u32, Vec<u8>)>,
    frame: u64,
    due: Duration,
    counter: u8,
    current: Vec<u8>,
    index: usize,
}

/// Disparity of a pixel: every code that means a depth, and "nothing".
#[must_use]
pub const fn disparity(x: usize, y: usize, frame: u64) -> u16 {
    if x == 0 && y == 0 {
        return 400 + (frame % 600) as u16;
    }
    if (x + 2 * y + frame as usize).is_multiple_of(61) {
        return NOTHING;
    }
    350 + ((3 * x + 101 * y + 17 * frame as usize) % 701) as u16
}

/// Depth of a disparity, millimetres, after libfreenect; `None` where there is none.
#[must_use]
pub fn millimetres(code: u16) -> Option<f64> {
    let (emitter, distance, pixel, shift) = GEOMETRY;
    let fixed = (f64::from(code) - 4.0 * f64::from(shift)) / 4.0 - 0.375;
    let m = fixed * f64::from(pixel);
    let mm = 10.0 * (m * f64::from(distance) / (f64::from(emitter) - m) + f64::from(distance));
    (code != NOTHING && m < f64::from(emitter)).then_some(mm)
}

impl Kinect {
    /// A camera with this serial number.
    #[must_use]
    pub fn new(serial: &str) -> Self {
        let identity = Identity {
            vendor: 0x045e,
            product: 0x02ae,
            class: [0; 3],
            maker: "Microsoft".into(),
            name: "Xbox NUI Camera".into(),
            serial: serial.into(),
            speed: Speed::High,
        };
        Self {
            faults: BTreeMap::new(),
            clock: 0,
            slow: 2,
            knows_geometry: true,
            identity,
            registers: BTreeMap::new(),
            answer: None,
            frame: 0,
            due: Duration::ZERO,
            counter: 250,
            current: Vec::new(),
            index: 0,
        }
    }

    /// The number that the next frame will have.
    #[must_use]
    pub const fn next_frame(&self) -> u64 {
        self.frame
    }

    /// It was without power: it forgets what it was told, and its numbers go on.
    pub fn power_on(&mut self) {
        self.registers.clear();
        self.answer = None;
        self.current.clear();
        self.index = 0;
    }

    /// Whether depth is switched on.
    #[must_use]
    pub fn is_streaming(&self) -> bool {
        self.register(DEPTH_ON) == 2
    }

    fn register(&self, number: u16) -> u16 {
        self.registers.get(&number).copied().unwrap_or(0)
    }

    /// Bits of a disparity, as a register says.
    fn bits(&self) -> usize {
        if self.register(DEPTH_FORMAT) == 3 { 11 } else { 10 }
    }

    fn command(&mut self, command: &[u8], now: Duration) -> Reply {
        let word = |at: usize| command.get(at..at + 2).map_or(0, |b| u16::from_le_bytes([b[0], b[1]]));
        if !command.starts_with(b"GM") || command.len() != 8 + 2 * usize::from(word(2)) {
            return Reply::Stall;
        }
        let (kind, first, second) = (word(4), word(8), word(10));
        // A status of 0, then data.
        let mut data = vec![0, 0];
        match kind {
            2 => data.extend(self.register(first).to_le_bytes()),
            3 => {
                self.registers.insert(first, second);
                if first == DEPTH_ON && second == 2 {
                    self.due = now + Duration::from_millis(33);
                    self.index = 0;
                    self.current.clear();
                }
            }
            4 if self.knows_geometry => {
                let (emitter, distance, pixel, _) = GEOMETRY;
                data.resize(94, 0);
                data.extend([emitter, 2.3, distance, pixel].into_iter().flat_map(f32::to_le_bytes));
                data.resize(322, 0);
            }
            0x16 if self.knows_geometry && first == 0 => data.extend(GEOMETRY.3.to_le_bytes()),
            _ => data = vec![1, 0], // an error's number
        }
        let mut answer = b"RB".to_vec();
        answer.extend((data.len() as u16 / 2).to_le_bytes());
        answer.extend(&command[4..8]);
        answer.extend(data);
        self.answer = Some((self.slow, answer));
        Reply::Done
    }

    /// Begins a frame that is due.
    fn begin(&mut self, now: Duration) -> bool {
        if !self.is_streaming() || now < self.due {
            return false;
        }
        let (width, height) = SIZE;
        let bits = self.bits();
        let codes = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let frame = self.frame;
        // 10-bit codes are the upper ten bits.
        self.current = pack(codes.map(|(x, y)| disparity(x, y, frame) >> (11 - bits)), bits);
        self.index = 0;
        self.frame += 1;
        self.due += Duration::from_micros(33_333);
        true
    }
}

/// Codes of this many bits, one after the other, the highest bit first.
fn pack(codes: impl Iterator<Item = u16>, bits: usize) -> Vec<u8> {
    let (mut out, mut buffer, mut held) = (Vec::new(), 0u32, 0);
    for code in codes {
        buffer = buffer << bits | u32::from(code);
        held += bits;
        while held >= 8 {
            held -= 8;
            out.push((buffer >> held) as u8);
        }
        buffer &= (1 << held) - 1;
    }
    out
}

impl Device for Kinect {
    fn descriptors(&self) -> Descriptors {
        let mut configuration = Configuration::new(Speed::High);
        configuration.interface([0xff, 0xff, 0xff], 2);
        for address in [0x81, DEPTH] {
            configuration.endpoint(Endpoint { address, kind: Kind::Isochronous { bytes: 960, packets: 2 } });
        }
        Descriptors { identity: self.identity.clone(), configuration: configuration.finish(), reports: BTreeMap::new() }
    }

    fn control(&mut self, setup: Setup, data: &[u8], now: Duration) -> Reply {
        match (setup.kind, setup.request) {
            (0x40, 0) => self.command(data, now),
            (0xc0, 0) => match self.answer.as_mut() {
                Some((wait @ 1.., _)) => {
                    *wait -= 1;
                    Reply::Data(Vec::new())
                }
                _ => self.answer.take().map_or(Reply::Stall, |(_, answer)| Reply::Data(answer)),
            },
            _ => Reply::Stall,
        }
    }

    fn packet(&mut self, endpoint: u8, _: usize, now: Duration) -> Packet {
        let done = self.index * DATA >= self.current.len();
        if endpoint != DEPTH || !self.is_streaming() || (done && !self.begin(now)) {
            return Packet::default();
        }
        let (frame, index) = (self.frame - 1, self.index);
        let start = index * DATA;
        let end = self.current.len().min(start + DATA);
        let flag = match index {
            0 => 0x71,
            _ if end == self.current.len() => 0x75,
            _ => 0x72,
        };
        let time = self.clock.wrapping_add((now.as_nanos() * u128::from(CLOCK_HZ) / 1_000_000_000) as u32);
        let mut data = vec![b'R', b'B', 0, flag, 0, self.counter, 0, 0];
        data.extend(time.to_le_bytes());
        data.extend(&self.current[start..end]);
        self.counter = self.counter.wrapping_add(1);
        self.index += 1;
        let mut packet = Packet { data, ..Packet::default() };
        match self.faults.get(&frame) {
            Some(Fault::Lost(which)) if which.contains(&index) => packet.status = errno::PROTOCOL,
            Some(Fault::Skipped(which)) if which.contains(&index) => packet.data.clear(),
            Some(Fault::Cut(which, bytes)) if *which == index => packet.data.truncate(HEADER.max(*bytes)),
            Some(Fault::Unplug(which)) if *which == index => packet.unplug = true,
            _ => {}
        }
        packet
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_answered_in_their_own_time() {
        let mut device = Kinect::new("k");
        let ask = |device: &mut Kinect, command: &[u8]| {
            let out = Setup { kind: 0x40, request: 0, value: 0, index: 0, length: command.len() as u16 };
            assert_eq!(device.control(out, command, Duration::ZERO), Reply::Done);
            let get = Setup { kind: 0xc0, length: 512, ..out };
            let mut empty = 0;
            loop {
                match device.control(get, &[], Duration::ZERO) {
                    Reply::Data(data) if data.is_empty() => empty += 1,
                    Reply::Data(data) => return (empty, data),
                    other => panic!("{other:?}"),
                }
            }
        };
        let write = ask(&mut device, &[0x47, 0x4d, 2, 0, 3, 0, 7, 0, 0x12, 0, 3, 0]);
        assert_eq!(write, (2, vec![0x52, 0x42, 1, 0, 3, 0, 7, 0, 0, 0]));
        let read = ask(&mut device, &[0x47, 0x4d, 1, 0, 2, 0, 8, 0, 0x12, 0]);
        assert_eq!(read.1, [0x52, 0x42, 2, 0, 2, 0, 8, 0, 0, 0, 3, 0]);
    }

    #[test]
    fn packets_hold_a_frame() {
        let mut device = Kinect::new("k");
        device.registers.extend([(DEPTH_FORMAT, 3), (DEPTH_ON, 2)]);
        let mut bits: Vec<u8> = Vec::new();
        let mut flags = Vec::new();
        for _ in 0..242 {
            let packet = device.packet(DEPTH, 1920, Duration::ZERO);
            flags.push(packet.data[3]);
            bits.extend(packet.data[HEADER..].iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1)));
        }
        assert_eq!((flags[0], flags[1], flags[241], bits.len()), (0x71, 0x72, 0x75, 640 * 480 * 11));
        let code = |i: usize| bits[11 * i..11 * (i + 1)].iter().fold(0, |code, bit| code << 1 | u16::from(*bit));
        for (x, y) in [(0, 0), (1, 0), (639, 0), (0, 1), (123, 456), (639, 479)] {
            assert_eq!(code(y * 640 + x), disparity(x, y, 0));
        }
    }

    #[test]
    fn depth_is_as_the_notes_have_it() {
        for (code, expected) in [(600, 706.0), (800, 1194.0), (1000, 3864.0), (1050, 8767.0)] {
            assert!((millimetres(code).unwrap() - expected).abs() < 1.0, "{code}");
        }
        assert_eq!(millimetres(NOTHING), None);
    }
}
