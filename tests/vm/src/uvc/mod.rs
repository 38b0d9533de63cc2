//! A USB Video Class camera: one control interface, one streaming interface, extension units.
//!
//! What is in its pictures is a closure of width, height and frame number. A driver asks for a format by negotiating (*probe*), fixes it
//! (*commit*), and frames flow, over a bulk endpoint or an isochronous one. Source: USB Device Class Definition for Video Devices 1.1
//! (descriptors 3, requests 4, payload headers 2.4.3).

use std::fmt;
use std::time::Duration;

use crate::usb::{Configuration, Endpoint, Kind, Reply, Setup};

mod descriptor;
pub mod stream;

pub use stream::{Fault, Moment, Stream};

/// Draws a frame: width, height, frame number.
pub type Content = Box<dyn Fn(usize, usize, u64) -> Vec<u8> + Send>;

/// A pixel format of a camera.
pub struct Format {
    /// The identifier by which a driver knows it.
    pub guid: [u8; 16],
    /// Bits of a pixel.
    pub bits: u8,
    /// Width and height.
    pub sizes: Vec<(u16, u16)>,
    /// Frames a second.
    pub rates: Vec<u32>,
    /// What is in it.
    pub content: Content,
}

impl fmt::Debug for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Format").field("guid", &self.guid).field("sizes", &self.sizes).finish_non_exhaustive()
    }
}

/// The identifier that Microsoft's rule makes of a four-letter code.
#[must_use]
pub const fn guid(code: [u8; 4]) -> [u8; 16] {
    let [a, b, c, d] = code;
    [a, b, c, d, 0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71]
}

/// How frames travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transport {
    /// Bulk, in payloads of at most this many bytes.
    Bulk {
        /// Header and pixels, bytes.
        payload: u32,
    },
    /// Bulk, a frame in one payload, as Intel's cameras do, whose header has room for more than times.
    BulkWhole,
    /// Isochronous, 1024 bytes this many times in 125 microseconds.
    Isochronous {
        /// 1 to 3.
        packets: u16,
    },
}

/// Settings of a camera that are its maker's: read and written in blocks of bytes.
pub trait Unit: Send + fmt::Debug {
    /// Its identifier.
    fn guid(&self) -> [u8; 16];
    /// Bytes of each setting, by selector from 1; 0 for one that is not there.
    fn lengths(&self) -> Vec<u16>;
    /// Writes one; false refuses.
    fn set(&mut self, selector: u8, value: &[u8]) -> bool;
    /// Reads one.
    fn get(&mut self, selector: u8) -> Vec<u8>;
}

/// A camera function of a device.
#[derive(Debug)]
pub struct Camera {
    /// The control interface; the streaming interface is the next.
    pub interface: u8,
    /// Frames and their faults.
    pub stream: Stream,
    /// Extension units; the first has number [`FIRST_UNIT`].
    pub units: Vec<Box<dyn Unit>>,
}

/// The number of the first extension unit; 1 and 2 are the sensor and the stream.
pub const FIRST_UNIT: u8 = 3;

/// Requests of the class.
const SET_CURRENT: u8 = 0x01;
const GET_CURRENT: u8 = 0x81;
const GET_MINIMUM: u8 = 0x82;
const GET_MAXIMUM: u8 = 0x83;
const GET_STEP: u8 = 0x84;
const GET_LENGTH: u8 = 0x85;
const GET_INFO: u8 = 0x86;
const GET_DEFAULT: u8 = 0x87;

impl Camera {
    /// A camera whose frames come from `endpoint` (bit 7 set).
    #[must_use]
    pub fn new(endpoint: u8, transport: Transport, formats: Vec<Format>, units: Vec<Box<dyn Unit>>) -> Self {
        Self { interface: 0, stream: Stream::new(endpoint, transport, formats), units }
    }

    /// Adds its interfaces to a device.
    pub fn describe(&mut self, configuration: &mut Configuration) {
        const CONTROL: [u8; 3] = [0x0e, 1, 0];
        const STREAMING: [u8; 3] = [0x0e, 2, 0];
        configuration.association(2, [0x0e, 3, 0]);
        self.interface = configuration.interface(CONTROL, 0);
        configuration.class_specific(&descriptor::control(self));
        let endpoint = Endpoint { address: self.stream.endpoint, kind: self.stream.kind() };
        let is_bulk = endpoint.kind == Kind::Bulk;
        configuration.interface(STREAMING, u8::from(is_bulk));
        configuration.class_specific(&descriptor::streaming(&self.stream));
        if !is_bulk {
            // The first setting of an isochronous stream takes no bandwidth.
            configuration.alternate(1, STREAMING, 1);
        }
        configuration.endpoint(endpoint);
    }

    /// Answers a request; `None` when it is for another interface.
    pub fn control(&mut self, setup: Setup, data: &[u8], now: Duration) -> Option<Reply> {
        let [interface, entity] = setup.index.to_le_bytes();
        let selector = (setup.value >> 8) as u8;
        if !matches!(setup.kind, 0x21 | 0xa1) {
            return None;
        }
        if interface == self.interface + 1 {
            return Some(self.negotiate(setup.request, selector, data, now));
        }
        if interface != self.interface {
            return None;
        }
        let unit = entity.checked_sub(FIRST_UNIT).and_then(|i| self.units.get_mut(usize::from(i)));
        Some(unit.map_or(Reply::Stall, |unit| unit_control(unit.as_mut(), setup.request, selector, data)))
    }

    /// Probe (selector 1) and commit (selector 2).
    fn negotiate(&mut self, request: u8, selector: u8, data: &[u8], now: Duration) -> Reply {
        match (request, selector) {
            (SET_CURRENT, 1) => {
                self.stream.probe(data);
                Reply::Done
            }
            (SET_CURRENT, 2) => {
                self.stream.probe(data);
                self.stream.commit(now);
                Reply::Done
            }
            (GET_CURRENT..=GET_STEP | GET_DEFAULT, 1 | 2) => Reply::Data(self.stream.offer()),
            (GET_LENGTH, 1 | 2) => Reply::Data(vec![stream::NEGOTIATION as u8, 0]),
            (GET_INFO, 1 | 2) => Reply::Data(vec![3]),
            _ => Reply::Stall,
        }
    }

    /// The host chose a setting of an interface.
    pub fn selected(&mut self, interface: u8, alternate: u8, now: Duration) {
        if interface == self.interface + 1 && self.stream.kind() != Kind::Bulk {
            if alternate == 0 { self.stream.stop() } else { self.stream.start(now) }
        }
    }
}

/// A setting of an extension unit.
fn unit_control(unit: &mut dyn Unit, request: u8, selector: u8, data: &[u8]) -> Reply {
    let lengths = unit.lengths();
    let length = selector.checked_sub(1).and_then(|i| lengths.get(usize::from(i)).copied()).unwrap_or(0);
    if length == 0 {
        return Reply::Stall;
    }
    match request {
        SET_CURRENT if data.len() == usize::from(length) && unit.set(selector, data) => Reply::Done,
        GET_CURRENT => {
            let mut value = unit.get(selector);
            value.resize(usize::from(length), 0);
            Reply::Data(value)
        }
        GET_LENGTH => Reply::Data(length.to_le_bytes().to_vec()),
        GET_INFO => Reply::Data(vec![3]),
        GET_MAXIMUM => Reply::Data(vec![0xff; usize::from(length)]),
        GET_STEP => Reply::Data(vec![1; usize::from(length)]),
        GET_MINIMUM | GET_DEFAULT => Reply::Data(vec![0; usize::from(length)]),
        _ => Reply::Stall,
    }
}
