//! The class-specific descriptors of a camera (UVC 1.1, section 3.7 and 3.9).

use super::{Camera, FIRST_UNIT, Stream};
use crate::usb::Kind;

const INTERFACE: u8 = 0x24;

/// A descriptor: its length in front.
fn descriptor(subtype: u8, body: &[u8]) -> Vec<u8> {
    [&[body.len() as u8 + 3, INTERFACE, subtype], body].concat()
}

/// The control interface: sensor (entity 1), stream (entity 2), extension units.
pub(super) fn control(camera: &Camera) -> Vec<u8> {
    // A sensor (type 0x0201) without lens data and with no control of its own.
    let mut entities = descriptor(2, &[1, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0]);
    let mut source = 1;
    for (unit, number) in camera.units.iter().zip(FIRST_UNIT..) {
        let lengths = unit.lengths();
        let bytes = lengths.len().div_ceil(8);
        let mut there = vec![0u8; bytes];
        for (bit, _) in lengths.iter().enumerate().filter(|(_, length)| **length > 0) {
            there[bit / 8] |= 1 << (bit % 8);
        }
        let count = lengths.iter().filter(|length| **length > 0).count() as u8;
        let body = [&[number], &unit.guid()[..], &[count, 1, source, bytes as u8], &there, &[0]].concat();
        entities.extend(descriptor(6, &body));
        source = number;
    }
    // The stream (type 0x0101), fed by the last unit.
    entities.extend(descriptor(3, &[2, 0x01, 0x01, 0, source, 0]));
    let total = (13 + entities.len() as u16).to_le_bytes();
    let clock = super::stream::CLOCK_HZ.to_le_bytes();
    let version = [0x10, 0x01];
    let body = [&version[..], &total, &clock, &[1, camera.interface + 1]].concat();
    [descriptor(1, &body), entities].concat()
}

/// The streaming interface: formats, and frames of each.
pub(super) fn streaming(stream: &Stream) -> Vec<u8> {
    let mut formats = Vec::new();
    for (format, number) in stream.formats().iter().zip(1u8..) {
        let body = [&[number, format.sizes.len() as u8], &format.guid[..], &[format.bits, 1, 0, 0, 0, 0]].concat();
        formats.extend(descriptor(4, &body));
        for (&(width, height), number) in format.sizes.iter().zip(1u8..) {
            let size = u32::from(width) * u32::from(height) * u32::from(format.bits) / 8;
            let fastest = format.rates.iter().copied().max().unwrap_or(30);
            let slowest = format.rates.iter().copied().min().unwrap_or(30);
            let mut body = vec![number, 0];
            body.extend(width.to_le_bytes());
            body.extend(height.to_le_bytes());
            for field in [size * 8 * slowest, size * 8 * fastest, size, interval(fastest)] {
                body.extend(field.to_le_bytes());
            }
            body.push(format.rates.len() as u8);
            body.extend(format.rates.iter().flat_map(|&rate| interval(rate).to_le_bytes()));
            formats.extend(descriptor(5, &body));
        }
    }
    let count = stream.formats().len() as u8;
    let total = (13 + u16::from(count) + formats.len() as u16).to_le_bytes();
    let mut body = vec![count, total[0], total[1], stream.endpoint, 0, 2, 0, 0, 0, 1];
    body.extend(vec![0; usize::from(count)]);
    [descriptor(1, &body), formats].concat()
}

/// The time between frames, in units of 100 ns.
pub(super) const fn interval(rate: u32) -> u32 {
    10_000_000 / rate
}

impl Stream {
    /// The endpoint's kind.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self.transport {
            super::Transport::Isochronous { packets } => Kind::Isochronous { bytes: 1024, packets },
            super::Transport::Bulk { .. } | super::Transport::BulkWhole => Kind::Bulk,
        }
    }
}
