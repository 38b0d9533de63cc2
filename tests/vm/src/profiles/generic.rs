//! A depth camera of no maker: the video class, 16-bit depth, nothing else. What any driver must be able to read, given a calibration file.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::pattern;
use crate::usb::descriptor::BY_ASSOCIATION;
use crate::usb::{Configuration, Descriptors, Device, Identity, Next, Packet, Reply, Setup, Speed};
use crate::uvc::{Camera, Format, Stream, Transport, Unit, guid};

/// The endpoint of its frames.
pub const ENDPOINT: u8 = 0x82;

/// The camera.
#[derive(Debug)]
pub struct Generic {
    camera: Camera,
    identity: Identity,
    configuration: Vec<u8>,
}

impl Generic {
    /// One with this serial number, which is how a test finds its nodes. It offers `Z16 ` first, `Y16 ` second.
    #[must_use]
    pub fn new(serial: &str, speed: Speed, transport: Transport, sizes: &[(u16, u16)]) -> Self {
        let identity = Identity {
            // Numbers that no maker has.
            vendor: 0xfff0,
            product: 0x0001,
            class: BY_ASSOCIATION,
            maker: "Simulated".into(),
            name: "Depth Camera".into(),
            serial: serial.into(),
            speed,
        };
        Self::of(identity, transport, sizes, Vec::new())
    }

    /// A maker's camera, with extension units.
    #[must_use]
    pub fn of(identity: Identity, transport: Transport, sizes: &[(u16, u16)], units: Vec<Box<dyn Unit>>) -> Self {
        let format = |code: &[u8; 4]| Format {
            guid: guid(*code),
            bits: 16,
            sizes: sizes.to_vec(),
            rates: vec![30, 15],
            content: Box::new(pattern::bytes),
        };
        let mut camera = Camera::new(ENDPOINT, transport, vec![format(b"Z16 "), format(b"Y16 ")], units);
        let mut configuration = Configuration::new(identity.speed);
        camera.describe(&mut configuration);
        Self { camera, identity, configuration: configuration.finish() }
    }

    /// Its frames.
    pub fn stream(&mut self) -> &mut Stream {
        &mut self.camera.stream
    }
}

impl Device for Generic {
    fn descriptors(&self) -> Descriptors {
        Descriptors {
            identity: self.identity.clone(),
            configuration: self.configuration.clone(),
            reports: BTreeMap::new(),
        }
    }

    fn control(&mut self, setup: Setup, data: &[u8], now: Duration) -> Reply {
        self.camera.control(setup, data, now).unwrap_or(Reply::Stall)
    }

    fn selected(&mut self, interface: u8, alternate: u8, now: Duration) {
        self.camera.selected(interface, alternate, now);
    }

    fn cleared(&mut self, _: u8) {
        self.camera.stream.stop();
    }

    fn transfer(&mut self, _: u8, now: Duration) -> Next {
        self.camera.stream.transfer(now)
    }

    fn packet(&mut self, _: u8, room: usize, now: Duration) -> Packet {
        self.camera.stream.packet(room, now)
    }
}
