//! The messages between a host controller and a device over USB/IP.
//!
//! All numbers are big-endian; a message is 48 bytes of header, then bytes that a transfer carries, then 16 bytes for each
//! isochronous packet. Source: `Documentation/usb/usbip_protocol.rst` of Linux, version 1.1.1.

/// Length of every header, bytes.
const HEADER: usize = 48;

const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;

/// A place for one isochronous packet in the host's buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot {
    /// Where in the buffer, bytes.
    pub offset: u32,
    /// Room, bytes.
    pub room: u32,
}

/// A request of the host (an URB).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Submit {
    /// Its number.
    pub sequence: u32,
    /// The endpoint, with bit 7 set for IN.
    pub endpoint: u8,
    /// Bytes of room, or of `data`.
    pub length: usize,
    /// For isochronous requests.
    pub slots: Vec<Slot>,
    /// For control requests.
    pub setup: [u8; 8],
    /// What goes to the device.
    pub data: Vec<u8>,
}

/// What a host says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// A new request.
    Submit(Submit),
    /// It takes one back.
    Unlink {
        /// This message's number.
        sequence: u32,
        /// The request's.
        of: u32,
    },
}

/// Takes one whole message from the front of `bytes`; `None` while it is incomplete.
///
/// # Errors
/// A command that the protocol does not have: the link can't be trusted any more.
pub fn take(bytes: &mut Vec<u8>) -> Result<Option<Request>, String> {
    let Some(header) = bytes.first_chunk::<HEADER>() else { return Ok(None) };
    let word = |i: usize| number(header, i);
    let sequence = word(1);
    match word(0) {
        UNLINK => {
            let of = word(5);
            bytes.drain(..HEADER);
            Ok(Some(Request::Unlink { sequence, of }))
        }
        SUBMIT => {
            let is_in = word(3) == 1;
            let endpoint = word(4) as u8 | if is_in { 0x80 } else { 0 };
            let length = word(6) as usize;
            // 0 or all ones where there are none.
            let packets = if word(8) == u32::MAX { 0 } else { word(8) as usize };
            let carried = if is_in { 0 } else { length };
            let end = HEADER + carried + 16 * packets;
            if bytes.len() < end {
                return Ok(None);
            }
            let setup = std::array::from_fn(|i| header[40 + i]);
            let data = bytes[HEADER..HEADER + carried].to_vec();
            let slots = bytes[HEADER + carried..end].chunks_exact(16);
            let slots = slots.map(|s| Slot { offset: number(s, 0), room: number(s, 1) }).collect();
            bytes.drain(..end);
            Ok(Some(Request::Submit(Submit { sequence, endpoint, length, slots, setup, data })))
        }
        other => Err(format!("USB/IP has no command {other}")),
    }
}

/// The answer to a request that is not isochronous. For OUT, `length` is what was taken and `data` is empty.
#[must_use]
pub fn done(sequence: u32, status: i32, length: usize, data: &[u8]) -> Vec<u8> {
    let mut out = header([SUBMITTED, sequence, 0, 0, 0, status as u32, length as u32, 0, 0, 0]);
    out.extend(data);
    out
}

/// The answer to an isochronous request: each packet's bytes and status.
#[must_use]
pub fn done_isochronous(sequence: u32, slots: &[Slot], packets: &[(Vec<u8>, i32)]) -> Vec<u8> {
    let length: usize = packets.iter().map(|(data, _)| data.len()).sum();
    let wrong = packets.iter().filter(|(_, status)| *status != 0).count();
    let counts = [length as u32, 0, packets.len() as u32, wrong as u32];
    let mut out = header([SUBMITTED, sequence, 0, 0, 0, 0, counts[0], counts[1], counts[2], counts[3]]);
    for (data, _) in packets {
        out.extend(data); // without the gaps of the host's buffer
    }
    for (slot, (data, status)) in slots.iter().zip(packets) {
        for field in [slot.offset, slot.room, data.len() as u32, *status as u32] {
            out.extend(field.to_be_bytes());
        }
    }
    out
}

/// The answer to taking a request back: `status` is 0 when the request was answered already.
#[must_use]
pub fn unlinked(sequence: u32, status: i32) -> Vec<u8> {
    header([UNLINKED, sequence, 0, 0, 0, status as u32, 0, 0, 0, 0])
}

fn header(fields: [u32; 10]) -> Vec<u8> {
    let mut out: Vec<u8> = fields.iter().flat_map(|f| f.to_be_bytes()).collect();
    out.resize(HEADER, 0);
    out
}

fn number(bytes: &[u8], index: usize) -> u32 {
    bytes.chunks_exact(4).nth(index).map_or(0, |b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_in_pieces_is_taken_when_whole() {
        let mut message = header([SUBMIT, 7, 0, 0, 2, 0, 3, 0, u32::MAX, 0]);
        message.extend([1, 2, 3]);
        message.extend(header([UNLINK, 8, 0, 0, 0, 7, 0, 0, 0, 0]));
        let (mut got, mut taken) = (Vec::new(), Vec::new());
        for byte in message {
            got.push(byte);
            taken.extend(take(&mut got).unwrap());
        }
        let Request::Submit(first) = &taken[0] else { panic!("{taken:?}") };
        assert_eq!((first.sequence, first.endpoint, &first.data[..]), (7, 2, &[1, 2, 3][..]));
        assert_eq!(taken[1], Request::Unlink { sequence: 8, of: 7 });
        assert!(got.is_empty() && taken.len() == 2);
        assert!(take(&mut header([9; 10])).is_err());
    }

    #[test]
    fn isochronous_packets_are_packed_and_described() {
        let slots = [Slot { offset: 0, room: 8 }, Slot { offset: 8, room: 8 }];
        let out = done_isochronous(1, &slots, &[(vec![1, 2, 3], 0), (vec![], -71)]);
        assert_eq!(out.len(), HEADER + 3 + 32);
        assert_eq!((number(&out, 6), number(&out, 8), number(&out, 9)), (3, 2, 1));
        assert_eq!(number(&out[HEADER + 3 + 16..], 3) as i32, -71);
    }
}
