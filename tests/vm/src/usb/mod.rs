//! A USB device in user space: what a profile says, and what is done for it.
//!
//! A profile implements [`Device`]: its descriptors, its answers to class and vendor requests, and what its endpoints send. Everything
//! that all devices do alike (standard requests, halted endpoints, splitting transfers into what the host asked for, the pace
//! of isochronous packets) is in [`engine`]; how that reaches the kernel, in [`port`] and [`usbip`].
//!
//! The terms are those of the USB 2.0 specification, chapters 5 and 9. A *transfer* on a bulk or interrupt endpoint ends with a packet
//! that is not full; a host's request (in Linux: URB) takes as much of it as it has room for.

use std::collections::BTreeMap;
use std::time::Duration;

pub mod descriptor;
pub mod engine;
#[cfg(unix)]
pub mod port;
pub mod usbip;

pub use descriptor::{Configuration, Endpoint, Identity, Kind, Speed};
#[cfg(unix)]
pub use port::Plugged;

/// Linux's error numbers, as they travel in USB/IP.
pub mod errno {
    /// A halted endpoint, a request that is refused (`EPIPE`).
    pub const STALL: i32 = -32;
    /// Bits went wrong on the wire (`EPROTO`).
    pub const PROTOCOL: i32 = -71;
    /// The host took the request back (`ECONNRESET`).
    pub const UNLINKED: i32 = -104;
}

/// The eight bytes that open a control transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Setup {
    /// `bmRequestType`: direction, standard/class/vendor, device/interface/endpoint.
    pub kind: u8,
    /// `bRequest`.
    pub request: u8,
    /// `wValue`.
    pub value: u16,
    /// `wIndex`: the interface or endpoint, and for UVC the entity.
    pub index: u16,
    /// `wLength`: how many bytes follow, or are wanted.
    pub length: u16,
}

impl Setup {
    /// From the wire.
    #[must_use]
    pub fn parse(b: [u8; 8]) -> Self {
        let word = |low, high| u16::from_le_bytes([low, high]);
        let (value, index, length) = (word(b[2], b[3]), word(b[4], b[5]), word(b[6], b[7]));
        Self { kind: b[0], request: b[1], value, index, length }
    }

    /// Whether the device answers with data.
    #[must_use]
    pub const fn is_in(&self) -> bool {
        self.kind & 0x80 != 0
    }
}

/// The answer to a control transfer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reply {
    /// Bytes; more than were asked for are cut off.
    Data(Vec<u8>),
    /// Done, nothing to say.
    Done,
    /// Refused.
    Stall,
}

/// What comes after the bytes of a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Then {
    /// The packet that is not full.
    #[default]
    End,
    /// The endpoint halts until the host clears it.
    Halt,
    /// The cable is pulled.
    Unplug,
}

/// What a bulk or interrupt endpoint sends.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Transfer {
    /// The bytes.
    pub data: Vec<u8>,
    /// What follows.
    pub then: Then,
}

/// One packet of an isochronous endpoint.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Packet {
    /// The bytes; none is a legal packet.
    pub data: Vec<u8>,
    /// 0, or a number of [`errno`]: the packet was lost.
    pub status: i32,
    /// The cable is pulled with it.
    pub unplug: bool,
}

/// An endpoint's answer to "have you something to send?".
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Next {
    /// Yes.
    Now(Transfer),
    /// Not before this time.
    At(Duration),
    /// Not before something else happens.
    Idle,
}

/// What the host reads once, when the device is plugged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Descriptors {
    /// Numbers and names.
    pub identity: Identity,
    /// Interfaces and endpoints.
    pub configuration: Vec<u8>,
    /// HID report descriptors, by interface.
    pub reports: BTreeMap<u8, Vec<u8>>,
}

/// A simulated device. Times count from its plugging in, in the guest's clock.
pub trait Device: Send + 'static {
    /// Who it is.
    fn descriptors(&self) -> Descriptors;

    /// Answers a request that is not among the standard ones. `data` is what came with it.
    fn control(&mut self, setup: Setup, data: &[u8], now: Duration) -> Reply;

    /// The host selected an alternate setting of an interface.
    fn selected(&mut self, _interface: u8, _alternate: u8, _now: Duration) {}

    /// The host cleared a halted endpoint, or one that was not.
    fn cleared(&mut self, _endpoint: u8) {}

    /// What a bulk or interrupt IN endpoint sends next.
    fn transfer(&mut self, _endpoint: u8, _now: Duration) -> Next {
        Next::Idle
    }

    /// What an isochronous IN endpoint sends in this interval.
    fn packet(&mut self, _endpoint: u8, _room: usize, _now: Duration) -> Packet {
        Packet::default()
    }

    /// Bytes came on an OUT endpoint.
    fn receive(&mut self, _endpoint: u8, _data: &[u8], _now: Duration) -> Reply {
        Reply::Done
    }
}
