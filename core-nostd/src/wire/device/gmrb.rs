//! PrimeSense's command header, which Kinect v1 and Orbbec's cameras still speak: "GM" asks, "RB" answers.
//!
//! ```text
//! question: 47 4d  u16 half-words behind the header  u16 opcode  u16 id   payload
//! answer:   52 42  u16 half-words behind the header  u16 opcode  u16 id   u16 status, payload
//! ```
//!
//! Little-endian. The status is 0, or an error below 0x8000 or 0xffff, or else a warning. On Kinect v1 (libfreenect, `flags.c`) it travels in control
//! transfers; on Orbbec's UVC cameras (`OrbbecSDK_v2`, `Protocol.hpp`) in controls of an extension unit, padded to their size.

use crate::wire::malformed::{Bytes, Malformed, Writer};

/// Bytes of the header.
pub const HEADER: usize = 8;
const QUESTION: [u8; 2] = *b"GM";
const ANSWER: [u8; 2] = *b"RB";

/// Orbbec's opcodes for reading.
pub mod orbbec {
    /// A property: `u32` number; the answer is [`Property`].
    pub const GET_PROPERTY: u16 = 1;
    /// Sets a property: `u32` number, `i32` or `f32` value.
    pub const SET_PROPERTY: u16 = 2;
    /// A structure: `u32` number; the answer is its bytes.
    pub const GET_STRUCTURE: u16 = 3;
    /// A structure with its version before it.
    pub const GET_STRUCTURE_V1_1: u16 = 27;
    /// Begins reading a list of structures: `u32` number; the answer is `u16` version and `u32` bytes in all.
    pub const LIST_BEGIN: u16 = 29;
    /// Reads a part of it: `u32` number, `u32` offset, `u32` bytes.
    pub const LIST_READ: u16 = 30;
    /// Ends reading it: `u32` number.
    pub const LIST_END: u16 = 31;

    /// The list of depth calibrations.
    pub const DEPTH_CALIBRATIONS: u32 = 4026;
    /// The list of calibrations between depth and colour.
    pub const ALIGNMENTS: u32 = 4027;
    /// The property of the depth unit: millimetres a step, a float.
    pub const DEPTH_UNIT: u32 = 176;

    use crate::wire::malformed::{Bytes, Malformed};

    /// A property's value and range, as bits: whether they are integers or floats depends on the property.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct Property {
        /// The value.
        pub now: u32,
        /// The largest.
        pub most: u32,
        /// The smallest.
        pub least: u32,
        /// What it is at first.
        pub default: u32,
        /// From one to the next.
        pub step: u32,
    }

    impl Property {
        /// Reads the data of an answer to [`GET_PROPERTY`].
        ///
        /// # Errors
        /// [`Malformed::TooShort`].
        pub fn parse(data: &[u8]) -> Result<Self, Malformed> {
            let read = Bytes::new("Orbbec property", data);
            let at = |i: usize| read.u32(4 * i);
            Ok(Self { now: at(0)?, most: at(1)?, least: at(2)?, default: at(3)?, step: at(4)? })
        }
    }

    /// The selector and size of the smallest of the three controls that hold so many bytes; `None` when none does.
    ///
    /// ```
    /// use isobath::wire::device::gmrb::orbbec::control;
    /// assert_eq!([12, 64, 65, 600, 2000].map(control), [Some((2, 64)), Some((2, 64)), Some((1, 512)), Some((3, 1024)), None]);
    /// ```
    #[must_use]
    pub const fn control(bytes: usize) -> Option<(u8, usize)> {
        match bytes {
            0..=64 => Some((2, 64)),
            65..=512 => Some((1, 512)),
            513..=1024 => Some((3, 1024)),
            _ => None,
        }
    }
}

/// A question or an answer, checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Packet<'a> {
    /// What is asked.
    pub opcode: u16,
    /// Which answer goes with which question.
    pub id: u16,
    /// What follows the header: of an answer status and data.
    pub payload: &'a [u8],
}

fn encode(magic: [u8; 2], packet: &Packet<'_>, out: &mut [u8]) -> Result<usize, Malformed> {
    let length = packet.payload.len();
    let words = u16::try_from(length / 2).ok().filter(|_| length.is_multiple_of(2));
    let words = words.ok_or(Malformed::Field {
        what: "the payload's length, which must be even and at most 131070",
        at: 2,
        got: length as u32,
    })?;
    let mut writer = Writer::new("GM/RB command", out);
    writer.bytes(&magic)?;
    writer.u16(words)?;
    writer.u16(packet.opcode)?;
    writer.u16(packet.id)?;
    writer.bytes(packet.payload)?;
    Ok(writer.at())
}

fn decode(magic: [u8; 2], bytes: &[u8]) -> Result<Packet<'_>, Malformed> {
    let read = Bytes::new("GM/RB command", bytes);
    let got: [u8; 2] = read.array(0)?;
    if got != magic {
        let got = u32::from(u16::from_le_bytes(got));
        return Err(Malformed::Field { what: "the magic of a GM/RB command", at: 0, got });
    }
    let payload = read.slice(HEADER, 2 * usize::from(read.u16(2)?))?;
    Ok(Packet { opcode: read.u16(4)?, id: read.u16(6)?, payload })
}

/// Writes a question; how many bytes it took.
///
/// # Errors
/// [`Malformed::Full`]; [`Malformed::Field`] for payloads of odd length.
///
/// ```
/// use isobath::wire::device::gmrb::{Packet, data, encode_question};
/// let mut bytes = [0; 12];
/// let read_register_6 = Packet { opcode: 2, id: 1, payload: &[6, 0] };
/// assert_eq!(encode_question(&read_register_6, &mut bytes)?, 10);
/// assert_eq!(bytes[..10], [0x47, 0x4d, 1, 0, 2, 0, 1, 0, 6, 0]);
/// let answer = [0x52, 0x42, 2, 0, 2, 0, 1, 0, 0, 0, 5, 0];
/// assert_eq!(data(2, 1, &answer)?, &[5, 0]);
/// # Ok::<(), isobath::wire::malformed::Malformed>(())
/// ```
pub fn encode_question(packet: &Packet<'_>, out: &mut [u8]) -> Result<usize, Malformed> {
    encode(QUESTION, packet, out)
}

/// Writes an answer, whose payload begins with its status: what a simulated device does.
///
/// # Errors
/// As [`encode_question`].
pub fn encode_answer(packet: &Packet<'_>, out: &mut [u8]) -> Result<usize, Malformed> {
    encode(ANSWER, packet, out)
}

/// Reads a question: what a simulated device does.
///
/// # Errors
/// [`Malformed`]: cut off, or no question.
pub fn question(bytes: &[u8]) -> Result<Packet<'_>, Malformed> {
    decode(QUESTION, bytes)
}

/// The payload of the answer to a question, status included.
///
/// # Errors
/// [`Malformed`]: cut off, no answer; [`Malformed::OtherReply`] with opcode and id of another question; [`Malformed::Refused`].
pub fn payload(opcode: u16, id: u16, bytes: &[u8]) -> Result<&[u8], Malformed> {
    let packet = decode(ANSWER, bytes)?;
    let number = |opcode: u16, id: u16| u32::from(opcode) << 16 | u32::from(id);
    if (packet.opcode, packet.id) != (opcode, id) {
        return Err(Malformed::OtherReply { asked: number(opcode, id), got: number(packet.opcode, packet.id) });
    }
    match Bytes::new("status of a GM/RB command", packet.payload).u16(0)? {
        // Warnings.
        0 | 0x8000..=0xfffe => Ok(packet.payload),
        code => Err(Malformed::Refused { what: "a GM/RB command", code: code.into() }),
    }
}

/// As [`payload`], without the status.
///
/// # Errors
/// As [`payload`].
pub fn data(opcode: u16, id: u16, bytes: &[u8]) -> Result<&[u8], Malformed> {
    payload(opcode, id, bytes).map(|payload| payload.get(2..).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;

    proptest! {
        #[test]
        fn packets_come_back(
            opcode in any::<u16>(), id in any::<u16>(),
            words in prop::collection::vec(any::<u16>(), 1..60), padding in 0_usize..20,
        ) {
            let payload_bytes: vec::Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
            let packet = Packet { opcode, id, payload: &payload_bytes };
            let mut bytes = vec![0xaa; HEADER + payload_bytes.len() + padding];
            let used = encode_question(&packet, &mut bytes).unwrap();
            prop_assert_eq!(used, HEADER + payload_bytes.len());
            prop_assert_eq!(question(&bytes), Ok(packet));
            for cut in 0..used {
                prop_assert!(question(&bytes[..cut]).is_err());
                prop_assert!(encode_question(&packet, &mut bytes.clone()[..cut]).is_err());
            }
            prop_assert!(payload(opcode, id, &bytes).is_err());

            encode_answer(&packet, &mut bytes).unwrap();
            match words[0] {
                0 | 0x8000..=0xfffe => prop_assert_eq!(data(opcode, id, &bytes), Ok(&payload_bytes[2..])),
                code => {
                    let refused = Malformed::Refused { what: "a GM/RB command", code: code.into() };
                    prop_assert_eq!(data(opcode, id, &bytes), Err(refused));
                }
            }
            prop_assert!(matches!(payload(opcode, id ^ 1, &bytes), Err(Malformed::OtherReply { .. })), "other id");
            prop_assert!(matches!(payload(opcode ^ 1, id, &bytes), Err(Malformed::OtherReply { .. })), "other opcode");
        }
    }

    #[test]
    fn odd_payloads_and_empty_answers_are_refused() {
        let odd = Packet { opcode: 1, id: 1, payload: &[1] };
        assert!(matches!(encode_question(&odd, &mut [0; 99]), Err(Malformed::Field { .. })));
        let mut bytes = [0; 8];
        encode_answer(&Packet { opcode: 1, id: 1, payload: &[] }, &mut bytes).unwrap();
        assert!(matches!(payload(1, 1, &bytes), Err(Malformed::TooShort { .. })));
        assert!(orbbec::Property::parse(&[0; 19]).is_err());
        let property = orbbec::Property::parse(&[1; 20]).unwrap();
        assert_eq!(property.step, 0x0101_0101);
    }
}
