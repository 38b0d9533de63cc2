//! What every device does: standard requests, halted endpoints, and the host's requests filled from the profile's transfers.
//!
//! Bulk and interrupt: a transfer is cut into what the host's requests have room for, and ends in a packet that is not full. When its
//! last packet happens to be full, an empty one follows, which is why a driver may see a read of no bytes. A halted endpoint
//! answers everything with a stall until the host clears it. Isochronous: a request of n packets is answered n intervals after the last
//! one, no sooner, because the bus is what gives isochronous endpoints their pace.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use super::usbip::{self, Request, Submit};
use super::{Descriptors, Device, Next, Packet, Reply, Setup, Then, Transfer, errno};

/// An interval of the bus.
pub const MICROFRAME: Duration = Duration::from_micros(125);

/// What the descriptors say about an endpoint.
#[derive(Debug, Clone, Copy)]
struct Facts {
    interface: u8,
    is_bulk: bool,
    packet: usize,
}

/// A device's side of the bus.
#[derive(Debug)]
pub struct Engine {
    descriptors: Descriptors,
    endpoints: BTreeMap<u8, Facts>,
    pending: BTreeMap<u8, VecDeque<Submit>>,
    /// The transfer that an endpoint is in the middle of, and how far it is.
    sending: BTreeMap<u8, (Transfer, usize)>,
    halted: BTreeSet<u8>,
    alternates: BTreeMap<u8, u8>,
    /// When the last isochronous request of an endpoint was over.
    over: BTreeMap<u8, Duration>,
    out: Vec<u8>,
    unplugged: bool,
}

/// What became of a turn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Turn {
    /// Messages for the host.
    pub out: Vec<u8>,
    /// Ask again by then, if nothing comes before.
    pub wake: Option<Duration>,
    /// The device is gone.
    pub unplugged: bool,
}

impl Engine {
    /// For a device that was just plugged in.
    #[must_use]
    pub fn new(descriptors: Descriptors) -> Self {
        let endpoints = endpoints(&descriptors.configuration);
        Self {
            descriptors,
            endpoints,
            pending: BTreeMap::new(),
            sending: BTreeMap::new(),
            halted: BTreeSet::new(),
            alternates: BTreeMap::new(),
            over: BTreeMap::new(),
            out: Vec::new(),
            unplugged: false,
        }
    }

    /// Takes in what the host says.
    pub fn request(&mut self, device: &mut dyn Device, request: Request, now: Duration) {
        match request {
            Request::Unlink { sequence, of } => {
                let found = self.pending.values_mut().any(|queue| {
                    let before = queue.len();
                    queue.retain(|submit| submit.sequence != of);
                    queue.len() < before
                });
                self.out.extend(usbip::unlinked(sequence, if found { errno::UNLINKED } else { 0 }));
            }
            Request::Submit(submit) if submit.endpoint & 0x7f == 0 => {
                let setup = Setup::parse(submit.setup);
                let reply =
                    self.standard(device, setup, now).unwrap_or_else(|| device.control(setup, &submit.data, now));
                self.answer(submit.sequence, reply, usize::from(setup.length), submit.data.len());
            }
            Request::Submit(submit) if submit.endpoint & 0x80 == 0 => {
                let halted = self.halted.contains(&submit.endpoint);
                let reply = if halted { Reply::Stall } else { device.receive(submit.endpoint, &submit.data, now) };
                if reply == Reply::Stall {
                    self.halted.insert(submit.endpoint);
                }
                self.answer(submit.sequence, reply, 0, submit.data.len());
            }
            Request::Submit(submit) => self.pending.entry(submit.endpoint).or_default().push_back(submit),
        }
    }

    /// Sends what can be sent now.
    pub fn turn(&mut self, device: &mut dyn Device, now: Duration) -> Turn {
        let mut wake: Option<Duration> = None;
        for endpoint in self.pending.keys().copied().collect::<Vec<_>>() {
            while let Some(submit) = self.pending.get_mut(&endpoint).and_then(VecDeque::pop_front) {
                let waits = if submit.slots.is_empty() {
                    self.fill(device, &submit, now)
                } else {
                    self.pace(device, &submit, now)
                };
                if self.unplugged {
                    return Turn { out: std::mem::take(&mut self.out), wake: None, unplugged: true };
                }
                if let Some(until) = waits {
                    self.pending.entry(endpoint).or_default().push_front(submit);
                    wake = [wake, until].into_iter().flatten().min();
                    break;
                }
            }
        }
        Turn { out: std::mem::take(&mut self.out), wake, unplugged: false }
    }

    /// Answers a bulk or interrupt request; or says how long that has to wait (`Some(None)`: until something happens).
    fn fill(&mut self, device: &mut dyn Device, submit: &Submit, now: Duration) -> Option<Option<Duration>> {
        let endpoint = submit.endpoint;
        if self.halted.contains(&endpoint) {
            self.out.extend(usbip::done(submit.sequence, errno::STALL, 0, &[]));
            return None;
        }
        let (transfer, at) = match self.sending.entry(endpoint) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => match device.transfer(endpoint, now) {
                Next::Now(transfer) => entry.insert((transfer, 0)),
                Next::At(time) => return Some(Some(time)),
                Next::Idle => return Some(None),
            },
        };
        let end = transfer.data.len().min(*at + submit.length);
        let piece = transfer.data.get(*at..end).unwrap_or_default();
        let is_last = end == transfer.data.len();
        let (then, fills) = (transfer.then, piece.len() == submit.length);
        let facts = self.endpoints.get(&endpoint);
        let empty_packet_follows = fills
            && facts.is_some_and(|f| f.is_bulk && piece.len().is_multiple_of(f.packet.max(1)))
            && then == Then::End;
        let status = if is_last && then == Then::Halt { errno::STALL } else { 0 };
        if !(is_last && then == Then::Unplug) {
            self.out.extend(usbip::done(submit.sequence, status, piece.len(), piece));
        }
        *at = end;
        if is_last && !empty_packet_follows {
            self.sending.remove(&endpoint);
            match then {
                Then::End => {}
                Then::Halt => drop(self.halted.insert(endpoint)),
                Then::Unplug => self.unplugged = true,
            }
        }
        None
    }

    /// Answers an isochronous request, or says when that is due.
    fn pace(&mut self, device: &mut dyn Device, submit: &Submit, now: Duration) -> Option<Option<Duration>> {
        let length = MICROFRAME * submit.slots.len() as u32;
        // A host that was late starts anew: the bus does not wait for it, and loses nothing that we could send.
        let earliest = now.saturating_sub(length * 8);
        let start = self.over.get(&submit.endpoint).copied().unwrap_or(now).max(earliest);
        let end = start + length;
        self.over.insert(submit.endpoint, start);
        if end > now {
            return Some(Some(end));
        }
        self.over.insert(submit.endpoint, end);
        let mut packets = Vec::with_capacity(submit.slots.len());
        for (slot, index) in submit.slots.iter().zip(0..) {
            let Packet { mut data, status, unplug } =
                device.packet(submit.endpoint, slot.room as usize, start + MICROFRAME * index);
            data.truncate(slot.room as usize);
            packets.push((if status == 0 { data } else { Vec::new() }, status));
            if unplug {
                self.unplugged = true;
                return None;
            }
        }
        self.out.extend(usbip::done_isochronous(submit.sequence, &submit.slots, &packets));
        None
    }

    fn answer(&mut self, sequence: u32, reply: Reply, wanted: usize, came: usize) {
        let message = match reply {
            Reply::Data(mut data) => {
                data.truncate(wanted);
                usbip::done(sequence, 0, data.len(), &data)
            }
            Reply::Done => usbip::done(sequence, 0, came, &[]),
            Reply::Stall => usbip::done(sequence, errno::STALL, 0, &[]),
        };
        self.out.extend(message);
    }

    /// The requests of chapter 9; `None` for all others.
    fn standard(&mut self, device: &mut dyn Device, setup: Setup, now: Duration) -> Option<Reply> {
        let [low, high] = setup.value.to_le_bytes();
        let (interface, endpoint) = (setup.index as u8, setup.index as u8);
        let data = |found: Option<Vec<u8>>| Some(found.map_or(Reply::Stall, Reply::Data));
        let identity = &self.descriptors.identity;
        match (setup.kind, setup.request) {
            // Descriptors: device, configuration, string, object store; a HID interface's reports.
            (0x80, 6) => data(match high {
                1 => Some(identity.device()),
                2 => Some(self.descriptors.configuration.clone()),
                3 => identity.string(low),
                15 => identity.object_store(),
                _ => None,
            }),
            (0x81, 6) if high == 0x22 => data(self.descriptors.reports.get(&interface).cloned()),
            // Status.
            (0x80 | 0x81, 0) => Some(Reply::Data(vec![0, 0])),
            (0x82, 0) => Some(Reply::Data(vec![u8::from(self.halted.contains(&endpoint)), 0])),
            // Features: only an endpoint's halt is one.
            (0x02, 1) => {
                self.halted.remove(&endpoint);
                self.sending.remove(&endpoint);
                device.cleared(endpoint);
                Some(Reply::Done)
            }
            (0x02, 3) => {
                self.halted.insert(endpoint);
                Some(Reply::Done)
            }
            (0x00 | 0x01, 1 | 3) => Some(Reply::Done),
            // Address, configuration, and what SuperSpeed adds: the latencies of the link.
            (0x00, 5 | 9 | 0x30 | 0x31) => Some(Reply::Done),
            (0x80, 8) => Some(Reply::Data(vec![1])),
            // Alternate settings.
            (0x81, 10) => Some(Reply::Data(vec![self.alternates.get(&interface).copied().unwrap_or(0)])),
            (0x01, 11) => {
                self.alternates.insert(interface, low);
                for (endpoint, _) in self.endpoints.iter().filter(|(_, facts)| facts.interface == interface) {
                    self.halted.remove(endpoint);
                    self.sending.remove(endpoint);
                    self.over.remove(endpoint);
                }
                device.selected(interface, low, now);
                Some(Reply::Done)
            }
            _ => None,
        }
    }
}

/// The endpoints that a configuration descriptor holds.
fn endpoints(configuration: &[u8]) -> BTreeMap<u8, Facts> {
    let (mut found, mut interface, mut rest) = (BTreeMap::new(), 0, configuration);
    while let Some(d) = rest.first().and_then(|&length| rest.get(..usize::from(length.max(2)))) {
        match *d {
            [_, 4, number, ..] => interface = number,
            [_, 5, address, attributes, low, high, ..] => {
                let packet = usize::from(u16::from_le_bytes([low, high]) & 0x7ff);
                found.insert(address, Facts { interface, is_bulk: attributes & 3 == 2, packet });
            }
            _ => {}
        }
        rest = &rest[d.len()..];
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::{BTreeMap as Map, Configuration, Endpoint, Identity, Kind, Speed};
    use super::*;

    /// Sends the same transfer three times.
    struct Thrice(Transfer, u32);

    impl Device for Thrice {
        fn descriptors(&self) -> Descriptors {
            let mut configuration = Configuration::new(Speed::High);
            configuration.interface([0xff, 0, 0], 1);
            configuration.endpoint(Endpoint { address: 0x81, kind: Kind::Bulk });
            let (maker, name, serial) = (String::new(), String::new(), String::new());
            let identity = Identity { vendor: 1, product: 2, class: [0; 3], maker, name, serial, speed: Speed::High };
            Descriptors { identity, configuration: configuration.finish(), reports: Map::new() }
        }
        fn control(&mut self, _: Setup, _: &[u8], _: Duration) -> Reply {
            Reply::Stall
        }
        fn transfer(&mut self, _: u8, _: Duration) -> Next {
            self.1 += 1;
            if self.1 > 3 { Next::Idle } else { Next::Now(self.0.clone()) }
        }
    }

    fn submit(sequence: u32, endpoint: u8, length: usize, setup: [u8; 8]) -> Request {
        Request::Submit(Submit { sequence, endpoint, length, slots: Vec::new(), setup, data: Vec::new() })
    }

    /// Status and length of each answer.
    fn answers(mut out: &[u8]) -> Vec<(i32, usize)> {
        let mut found = Vec::new();
        while out.len() >= 48 {
            let word = |i: usize| u32::from_be_bytes([out[i * 4], out[i * 4 + 1], out[i * 4 + 2], out[i * 4 + 3]]);
            found.push((word(5) as i32, word(6) as usize));
            out = &out[48 + word(6) as usize..];
        }
        found
    }

    fn run(transfer: Transfer, rooms: &[usize]) -> Vec<(i32, usize)> {
        let mut device = Thrice(transfer, 0);
        let mut engine = Engine::new(device.descriptors());
        for (room, number) in rooms.iter().zip(1..) {
            engine.request(&mut device, submit(number, 0x81, *room, [0; 8]), Duration::ZERO);
        }
        answers(&engine.turn(&mut device, Duration::ZERO).out)
    }

    #[test]
    fn transfers_are_cut_to_the_hosts_requests_and_a_full_last_packet_is_followed_by_an_empty_one() {
        let of = |n: usize, then| Transfer { data: vec![7; n], then };
        assert_eq!(run(of(1300, Then::End), &[1024, 1024, 1024]), [(0, 1024), (0, 276), (0, 1024)]);
        assert_eq!(run(of(1024, Then::End), &[1024; 4]), [(0, 1024), (0, 0), (0, 1024), (0, 0)]);
        assert_eq!(run(of(1024, Then::End), &[2048; 2]), [(0, 1024); 2]);
        assert_eq!(run(of(100, Then::End), &[512; 5]), [(0, 100); 3], "then nothing is there");
    }

    #[test]
    fn a_halted_endpoint_stalls_until_cleared() {
        let mut device = Thrice(Transfer { data: vec![1; 100], then: Then::Halt }, 0);
        let mut engine = Engine::new(device.descriptors());
        for number in 1..4 {
            engine.request(&mut device, submit(number, 0x81, 512, [0; 8]), Duration::ZERO);
        }
        assert_eq!(answers(&engine.turn(&mut device, Duration::ZERO).out), [(-32, 100), (-32, 0), (-32, 0)]);
        engine.request(&mut device, submit(4, 0, 0, [0x02, 1, 0, 0, 0x81, 0, 0, 0]), Duration::ZERO);
        engine.request(&mut device, submit(5, 0x81, 512, [0; 8]), Duration::ZERO);
        assert_eq!(answers(&engine.turn(&mut device, Duration::ZERO).out), [(0, 0), (-32, 100)]);
    }

    #[test]
    fn unplugging_answers_nothing_more() {
        assert_eq!(run(Transfer { data: vec![1; 600], then: Then::Unplug }, &[512, 512, 512]), [(0, 512)]);
    }

    #[test]
    fn what_no_device_has_is_refused() {
        let mut device = Thrice(Transfer::default(), 0);
        let mut engine = Engine::new(device.descriptors());
        let qualifier = [0x80, 6, 0, 6, 0, 0, 10, 0];
        let first_string = [0x80, 6, 0, 3, 0, 0, 255, 0];
        for (setup, number) in [qualifier, first_string].into_iter().zip(1..) {
            engine.request(&mut device, submit(number, 0x80, 255, setup), Duration::ZERO);
        }
        assert_eq!(answers(&engine.turn(&mut device, Duration::ZERO).out), [(-32, 0), (0, 4)]);
    }
}
