//! Frames on their way: negotiation, payloads with their headers, and what can go wrong with each frame.
//!
//! A frame is cut into payloads, each with a header: length, flags (which of two alternating frames it belongs to, whether it is the last,
//! whether something is wrong), the time of exposure and the time now in the device's clock (UVC 1.1, section 2.4.3.3). On an isochronous
//! endpoint a packet is a payload. Frames are numbered from power-on and are due at the rate agreed on; a [`Fault`] is tied to a
//! frame's number, so that a test says beforehand what happens to which frame.

use std::collections::BTreeMap;
use std::time::Duration;

use super::{Format, Transport, descriptor};
use crate::usb::{Next, Packet, Then, Transfer, errno};

/// Bytes of the negotiation, as of version 1.1.
pub(super) const NEGOTIATION: usize = 34;

/// Ticks of the device's clock in a second.
pub const CLOCK_HZ: u32 = 1_000_000;

/// What happens to one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Only this many bytes of pixels are sent, marked as the end.
    Truncated(usize),
    /// The device says that something is wrong with it.
    Marked,
    /// The packet with this byte of it is lost on the wire (isochronous endpoints).
    Lost(usize),
    /// The endpoint halts after this many bytes (bulk endpoints).
    Halt(usize),
    /// The cable is pulled after this many bytes.
    Unplug(usize),
    /// It is not sent; the device's numbers go on.
    Skipped,
    /// It comes this much later, as do all after it.
    Late(Duration),
}

/// When a frame was exposed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moment {
    /// Its number since power-on.
    pub frame: u64,
    /// The device's clock at exposure, microseconds.
    pub exposed: u32,
    /// The time between frames, microseconds.
    pub interval: u32,
}

/// What follows the times in a payload's header.
pub type Metadata = fn(&Moment) -> Vec<u8>;

/// A frame that is being sent.
#[derive(Debug)]
struct Frame {
    moment: Moment,
    pixels: Vec<u8>,
    at: usize,
    fault: Option<Fault>,
}

/// The streaming side of a camera.
#[derive(Debug)]
pub struct Stream {
    /// Where frames come from.
    pub endpoint: u8,
    /// How.
    pub transport: Transport,
    /// What happens to which frame, by its number since power-on.
    pub faults: BTreeMap<u64, Fault>,
    /// What the device's clock showed when it was plugged in, microseconds.
    pub clock: u32,
    /// A format and size (both from 1) that is granted whatever was asked for.
    pub grants: Option<(u8, u8)>,
    /// More for the payload's header.
    pub metadata: Option<Metadata>,
    formats: Vec<Format>,
    chosen: (u8, u8),
    interval: u32,
    streaming: bool,
    next: u64,
    due: Duration,
    toggle: u8,
    current: Option<Frame>,
}

impl Stream {
    /// One that nobody listens to yet.
    pub(super) fn new(endpoint: u8, transport: Transport, formats: Vec<Format>) -> Self {
        let interval = formats.first().and_then(|f| f.rates.first()).map_or(333_333, |&r| descriptor::interval(r));
        Self {
            endpoint,
            transport,
            faults: BTreeMap::new(),
            clock: 0,
            grants: None,
            metadata: None,
            formats,
            chosen: (1, 1),
            interval,
            streaming: false,
            next: 0,
            due: Duration::ZERO,
            toggle: 0,
            current: None,
        }
    }

    /// What it can send.
    #[must_use]
    pub fn formats(&self) -> &[Format] {
        &self.formats
    }

    /// Width and height agreed on.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        let (format, size) = self.chosen;
        let format = self.formats.get(usize::from(format) - 1);
        let (w, h) = format.and_then(|f| f.sizes.get(usize::from(size) - 1)).copied().unwrap_or((0, 0));
        (usize::from(w), usize::from(h))
    }

    /// The number that the next frame will have.
    #[must_use]
    pub const fn next_frame(&self) -> u64 {
        self.next
    }

    /// Whether a host listens.
    #[must_use]
    pub const fn is_streaming(&self) -> bool {
        self.streaming
    }

    /// The host proposes; what is not there becomes the nearest that is.
    pub(super) fn probe(&mut self, asked: &[u8]) {
        let byte = |i: usize| asked.get(i).copied().unwrap_or(0);
        let (format, size) = self.grants.unwrap_or((byte(2), byte(3)));
        let format = format.clamp(1, self.formats.len() as u8);
        let of = &self.formats[usize::from(format) - 1];
        self.chosen = (format, size.clamp(1, of.sizes.len() as u8));
        let asked = u32::from_le_bytes([byte(4), byte(5), byte(6), byte(7)]);
        let offered = of.rates.iter().map(|&rate| descriptor::interval(rate));
        self.interval = offered.min_by_key(|i| i.abs_diff(asked)).unwrap_or(333_333);
    }

    /// What would be agreed on.
    pub(super) fn offer(&self) -> Vec<u8> {
        let mut out = vec![0; NEGOTIATION];
        (out[2], out[3]) = self.chosen;
        let mut put = |at: usize, value: u32| out[at..at + 4].copy_from_slice(&value.to_le_bytes());
        put(4, self.interval);
        put(18, self.frame_bytes() as u32);
        put(22, self.payload_bytes() as u32);
        put(26, CLOCK_HZ);
        out
    }

    fn frame_bytes(&self) -> usize {
        let (width, height) = self.size();
        let bits = self.formats.get(usize::from(self.chosen.0) - 1).map_or(16, |f| f.bits);
        width * height * usize::from(bits) / 8
    }

    /// Largest payload, bytes.
    fn payload_bytes(&self) -> usize {
        match self.transport {
            Transport::Bulk { payload } => payload as usize,
            Transport::BulkWhole => self.frame_bytes() + 255,
            Transport::Isochronous { packets } => 1024 * usize::from(packets),
        }
    }

    /// The host fixes what was negotiated; a bulk stream starts with that.
    pub(super) fn commit(&mut self, now: Duration) {
        if !matches!(self.transport, Transport::Isochronous { .. }) {
            self.start(now);
        }
    }

    /// Frames flow.
    pub(super) fn start(&mut self, now: Duration) {
        self.streaming = true;
        self.current = None;
        self.due = now + self.period();
    }

    /// Frames stop: an isochronous interface's setting 0, a bulk endpoint's clearing.
    pub fn stop(&mut self) {
        self.streaming = false;
        self.current = None;
    }

    fn period(&self) -> Duration {
        Duration::from_nanos(u64::from(self.interval) * 100)
    }

    /// Makes the next frame the current one, when it is due.
    fn advance(&mut self, now: Duration) {
        while self.streaming && self.current.is_none() && now >= self.due {
            let frame = self.next;
            let fault = self.faults.remove(&frame);
            if let Some(Fault::Late(delay)) = fault {
                self.due += delay;
                continue;
            }
            self.next += 1;
            let exposed = self.clock.wrapping_add(self.due.as_micros() as u32);
            // A sensor that was not read in time does not hurry afterwards.
            self.due = (self.due + self.period()).max(now.saturating_sub(self.period()));
            if fault == Some(Fault::Skipped) {
                continue;
            }
            let (width, height) = self.size();
            let Some(format) = self.formats.get(usize::from(self.chosen.0) - 1) else { return };
            let mut pixels = (format.content)(width, height, frame);
            if let Some(Fault::Truncated(bytes)) = fault {
                pixels.truncate(bytes);
            }
            self.toggle ^= 1;
            let moment = Moment { frame, exposed, interval: self.interval / 10 };
            self.current = Some(Frame { moment, pixels, at: 0, fault });
        }
    }

    /// The next payload of at most `room` bytes, and what happens after it.
    fn payload(&mut self, room: usize, now: Duration) -> Option<(Vec<u8>, Option<Fault>)> {
        self.advance(now);
        let frame = self.current.as_mut()?;
        let more = self.metadata.map_or_else(Vec::new, |metadata| metadata(&frame.moment));
        let header = 12 + more.len();
        let start = frame.at;
        frame.at = frame.pixels.len().min(start + room.saturating_sub(header));
        let is_last = frame.at == frame.pixels.len();
        let is_marked = frame.fault == Some(Fault::Marked);
        // End of header, source clock, presentation time; error; last; alternating frames.
        let flags = 0x8c | u8::from(is_marked) << 6 | u8::from(is_last) << 1 | self.toggle;
        let mut out = vec![header as u8, flags];
        out.extend(frame.moment.exposed.to_le_bytes());
        out.extend(self.clock.wrapping_add(now.as_micros() as u32).to_le_bytes());
        out.extend((now.as_millis() as u16 & 0x7ff).to_le_bytes());
        out.extend(more);
        let piece = start..frame.at;
        out.extend(&frame.pixels[piece.clone()]);
        let fault = frame.fault.filter(|fault| match *fault {
            Fault::Lost(at) | Fault::Halt(at) | Fault::Unplug(at) => piece.contains(&at),
            _ => false,
        });
        if let Some(Fault::Halt(at) | Fault::Unplug(at)) = fault {
            out.truncate(header + at - piece.start);
        }
        if is_last || matches!(fault, Some(Fault::Halt(_))) {
            self.current = None;
        }
        Some((out, fault))
    }

    /// What a bulk endpoint sends: one payload.
    pub fn transfer(&mut self, now: Duration) -> Next {
        let Some((data, fault)) = self.payload(self.payload_bytes(), now) else {
            return if self.streaming { Next::At(self.due) } else { Next::Idle };
        };
        let then = match fault {
            Some(Fault::Halt(_)) => Then::Halt,
            Some(Fault::Unplug(_)) => Then::Unplug,
            _ => Then::End,
        };
        Next::Now(Transfer { data, then })
    }

    /// What an isochronous endpoint sends in one interval.
    pub fn packet(&mut self, room: usize, now: Duration) -> Packet {
        let Some((data, fault)) = self.payload(room, now) else { return Packet::default() };
        Packet {
            data,
            status: if matches!(fault, Some(Fault::Lost(_))) { errno::PROTOCOL } else { 0 },
            unplug: matches!(fault, Some(Fault::Unplug(_))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uvc::guid;

    fn stream(transport: Transport) -> Stream {
        let content = Box::new(|w: usize, h: usize, frame: u64| vec![frame as u8; w * h * 2]);
        let format = Format { guid: guid(*b"Z16 "), bits: 16, sizes: vec![(8, 4), (32, 64)], rates: vec![30], content };
        Stream::new(0x82, transport, vec![format])
    }

    #[test]
    fn a_frame_comes_whole_in_payloads_and_only_when_due() {
        let mut s = stream(Transport::Bulk { payload: 1012 });
        s.probe(&[0, 0, 1, 2]);
        assert_eq!(s.transfer(Duration::from_secs(1)), Next::Idle);
        s.commit(Duration::ZERO);
        let mut now = Duration::from_nanos(33_333_300);
        assert_eq!(s.transfer(Duration::ZERO), Next::At(now));
        let mut got: Vec<u8> = Vec::new();
        let mut ends = Vec::new();
        while let Next::Now(transfer) = s.transfer(now) {
            got.extend(&transfer.data[12..]);
            ends.push(transfer.data[1] & 2 != 0);
            now += Duration::from_micros(1);
        }
        assert_eq!(got, vec![0; 4096]);
        assert_eq!(ends, [false, false, false, false, true]);
        assert_eq!(s.next_frame(), 1);
    }

    #[test]
    fn faults_hit_their_frame_and_byte() {
        let mut s = stream(Transport::Isochronous { packets: 1 });
        s.probe(&[0, 0, 1, 2]);
        s.faults = BTreeMap::from([
            (0, Fault::Lost(1500)),
            (1, Fault::Skipped),
            (2, Fault::Truncated(100)),
            (3, Fault::Late(Duration::from_secs(1))),
            (4, Fault::Unplug(3000)),
        ]);
        s.start(Duration::ZERO);
        let mut log = Vec::new();
        for i in 0..20_000 {
            let p = s.packet(1024, Duration::from_micros(125 * i));
            if !p.data.is_empty() {
                log.push((p.data[p.data.len() - 1], p.data.len() - 12, p.status, p.unplug));
            }
            if p.unplug {
                break;
            }
        }
        let whole = |frame, lost: i32| {
            [1012, 1012, 1012, 1012, 48]
                .into_iter()
                .enumerate()
                .map(move |(i, n)| (frame, n, if i == 1 { lost } else { 0 }, false))
        };
        let expected: Vec<_> = whole(0, errno::PROTOCOL)
            .chain([(2, 100, 0, false)])
            .chain(whole(3, 0))
            .chain([(4, 1012, 0, false), (4, 1012, 0, false), (4, 3000 - 2024, 0, true)])
            .collect();
        assert_eq!(log, expected);
    }

    #[test]
    fn what_is_not_offered_is_not_granted() {
        let mut s = stream(Transport::BulkWhole);
        s.probe(&[0, 0, 9, 9, 1, 0, 0, 0]);
        let offer = s.offer();
        assert_eq!((offer[2], offer[3], s.size()), (1, 2, (32, 64)));
        assert_eq!(u32::from_le_bytes([offer[4], offer[5], offer[6], offer[7]]), 333_333);
        s.grants = Some((1, 1));
        s.probe(&[0, 0, 1, 2]);
        assert_eq!(s.size(), (8, 4));
    }
}
