//! Like Intel's RealSense D435i: depth and colour cameras, a motion module, calibration through the camera's extension unit.
//!
//! What it has in common with the real one: numbers and names, the extension unit and its commands ([`monitor`]), tables and their
//! checksums ([`tables`]), frames in one payload over bulk with metadata behind the payload's header, a clock of 32 bits of microseconds. What it
//! leaves out: infrared streams, settings, firmware update. Source: `spec/drivers.md` of this project's notes, section 1.2, which was
//! read from librealsense.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::hid::{self, Hub, Sensor};
use crate::pattern;
use crate::usb::descriptor::BY_ASSOCIATION;
use crate::usb::{Configuration, Descriptors, Device, Identity, Next, Packet, Reply, Setup, Speed};
use crate::uvc::{Camera, Format, Moment, Stream, Transport, guid};

pub mod monitor;
pub mod tables;

use monitor::{Monitor, Settings};

/// Endpoints: depth, colour, motion.
pub const DEPTH: u8 = 0x82;
/// Endpoint of colour frames.
pub const COLOUR: u8 = 0x84;
/// Endpoint of motion reports.
pub const MOTION: u8 = 0x85;

/// The sizes of its depth images.
pub const SIZES: [(u16, u16); 3] = [(640, 480), (848, 480), (424, 240)];

/// The camera.
#[derive(Debug)]
pub struct D435 {
    /// The depth camera.
    pub depth: Camera,
    /// The colour camera.
    pub colour: Camera,
    /// The motion module.
    pub motion: Hub,
    /// What its extension unit answers.
    pub settings: Arc<Mutex<Settings>>,
    identity: Identity,
    configuration: Vec<u8>,
}

impl D435 {
    /// A camera with this serial number.
    #[must_use]
    pub fn new(serial: &str, speed: Speed) -> Self {
        let settings = Arc::new(Mutex::new(Settings::default()));
        let z16 = Format {
            guid: guid(*b"Z16 "),
            bits: 16,
            sizes: SIZES.to_vec(),
            rates: vec![30, 15, 90],
            content: Box::new(pattern::bytes),
        };
        let yuyv = Format {
            guid: guid(*b"YUY2"),
            bits: 16,
            sizes: vec![(640, 480), (424, 240)],
            rates: vec![30, 15],
            content: Box::new(yuyv),
        };
        let monitor = Box::new(Monitor::new(Arc::clone(&settings)));
        let mut depth = Camera::new(DEPTH, Transport::BulkWhole, vec![z16], vec![monitor]);
        depth.stream.metadata = Some(metadata);
        let mut colour = Camera::new(COLOUR, Transport::BulkWhole, vec![yuyv], Vec::new());
        let mut motion = Hub::new(MOTION, at_rest);
        let mut configuration = Configuration::new(speed);
        depth.describe(&mut configuration);
        colour.describe(&mut configuration);
        motion.describe(&mut configuration);
        let identity = Identity {
            vendor: 0x8086,
            product: 0x0b3a,
            class: BY_ASSOCIATION,
            maker: "Intel(R) RealSense(TM) Depth Camera 435i".into(),
            name: "Intel(R) RealSense(TM) Depth Camera 435i".into(),
            serial: serial.into(),
            speed,
        };
        Self { depth, colour, motion, settings, identity, configuration: configuration.finish() }
    }

    /// Depth frames.
    pub fn stream(&mut self) -> &mut Stream {
        &mut self.depth.stream
    }
}

/// A device that lies still, tilted: gravity (1 g is 1000 steps) along -y mostly, a small constant turn, a counter in the last digit.
fn at_rest(sensor: Sensor, number: u64) -> [i16; 3] {
    let digit = (number % 10) as i16;
    match sensor {
        Sensor::Accelerometer => [digit, -990, 140],
        Sensor::Gyroscope => [-3, digit, 7],
    }
}

/// Colour whose luma is the column, so that a pixel out of place is seen.
fn yuyv(width: usize, height: usize, frame: u64) -> Vec<u8> {
    let pixel = |x: usize, y: usize| [16 + ((x + 3 * y + frame as usize) % 220) as u8, 128];
    (0..height).flat_map(|y| (0..width).flat_map(move |x| pixel(x, y))).collect()
}

/// The blocks behind a depth payload's header: capture timing (with the frame counter), depth control.
fn metadata(moment: &Moment) -> Vec<u8> {
    const CAPTURE_TIMING: u32 = 0x8000_0001;
    const DEPTH_CONTROL: u32 = 0x8000_0000;
    const EXPOSURE: u32 = 8500;
    let timing = [
        CAPTURE_TIMING,
        40,
        1,
        0x3f, // all fields hold
        moment.frame as u32,
        EXPOSURE / 2, // from the frame's start to its middle
        9000,
        EXPOSURE,
        moment.interval,
        1500,
    ];
    let mut control = [0; 15];
    control[..8].copy_from_slice(&[DEPTH_CONTROL, 60, 1, 0x3ff, 16, EXPOSURE, 150, 1]);
    timing.into_iter().chain(control).flat_map(u32::to_le_bytes).collect()
}

impl Device for D435 {
    fn descriptors(&self) -> Descriptors {
        let reports = BTreeMap::from([(self.motion.interface, hid::report_descriptor())]);
        Descriptors { identity: self.identity.clone(), configuration: self.configuration.clone(), reports }
    }

    fn control(&mut self, setup: Setup, data: &[u8], now: Duration) -> Reply {
        let depth = self.depth.control(setup, data, now);
        let colour = depth.or_else(|| self.colour.control(setup, data, now));
        colour.or_else(|| self.motion.control(setup, data, now)).unwrap_or(Reply::Stall)
    }

    fn cleared(&mut self, endpoint: u8) {
        match endpoint {
            DEPTH => self.depth.stream.stop(),
            COLOUR => self.colour.stream.stop(),
            _ => {}
        }
    }

    fn transfer(&mut self, endpoint: u8, now: Duration) -> Next {
        match endpoint {
            DEPTH => self.depth.stream.transfer(now),
            COLOUR => self.colour.stream.transfer(now),
            _ => self.motion.transfer(now),
        }
    }

    fn packet(&mut self, _: u8, _: usize, _: Duration) -> Packet {
        Packet::default()
    }
}
