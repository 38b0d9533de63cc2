//! Headset firmware to host, on one pipe: a simple protocol of our own for a USB bulk endpoint, a serial line, a socket or a file.
//!
//! A device sends messages whenever it has something; the host only reads. It says [hello](Hello) once at the start and then once a second or more often, so
//! that who joins late waits no longer; until then a reader keeps nothing.
//!
//! # The form, version 1
//!
//! Little-endian throughout.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 2 | `iB` |
//! | 2 | 1 | version, 1 |
//! | 3 | 1 | kind: 1 hello, 2 depth frame, 3 inertial readings, 4 key frame |
//! | 4 | 4 | bytes of the body |
//! | 8 | 4 | sequence: counts the messages of this kind, and wraps |
//! | 12 | 8 | time, nanoseconds of the device's clock, signed |
//! | 20 | 4 | CRC-32 of these first 20 bytes |
//! | 24 | | body: [`Hello`], [`Depth`], [`Imu`], or a whole message of [`keyframe`](super::keyframe) |
//! | 24 + body | 4 | CRC-32 of the body |
//!
//! The header has a CRC of its own, so that a damaged length is noticed before anybody waits for a megabyte. After bytes that are no message
//! [`find`] goes on at the next header whose CRC is right: what is lost is what was damaged, and the sequence tells how much that was. Readers pass over kinds they
//! don't know; another version is an error.
//!
//! # Memory, cost
//!
//! Encoders write into the caller's slice ([`depth_most_bytes`] suffices for any frame) and need no heap; decoding borrows the message. The CRC costs about 4 ns a
//! byte on a desktop, [RVL](super::rvl) 10 ns a pixel and half the bytes.
//!
//! # Hostile bytes
//!
//! Every length is checked, and a message is bounded by what the reader is ready to hold. Work is linear in the bytes.

mod depth;
mod hello;
mod imu;

pub use self::depth::{Depth, Encoding, depth_most_bytes, encode_depth};
pub use self::hello::{Hello, Serial, encode_hello};
pub use self::imu::{Imu, encode_imu, imu_bytes};

use super::crc::crc32;
use super::malformed::{Bytes, Malformed, Writer};
use crate::ground::units::Timestamp;

/// The version written, and the only one read.
pub const VERSION: u8 = 1;
/// How a message begins.
pub const MAGIC: [u8; 2] = *b"iB";
/// Bytes before the body.
pub const HEADER: usize = 24;
/// Bytes around the body.
pub const OVERHEAD: usize = HEADER + 4;

/// What a message holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kind {
    /// Who the device is, and its calibration.
    Hello,
    /// A depth image.
    Depth,
    /// Readings of an inertial sensor.
    Imu,
    /// A key frame.
    KeyFrame,
    /// Something of later firmware.
    Other(u8),
}

impl Kind {
    const fn number(self) -> u8 {
        match self {
            Self::Hello => 1,
            Self::Depth => 2,
            Self::Imu => 3,
            Self::KeyFrame => 4,
            Self::Other(n) => n,
        }
    }

    const fn of(number: u8) -> Self {
        match number {
            1 => Self::Hello,
            2 => Self::Depth,
            3 => Self::Imu,
            4 => Self::KeyFrame,
            n => Self::Other(n),
        }
    }
}

/// What every message says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// What it holds.
    pub kind: Kind,
    /// Its number among its kind.
    pub sequence: u32,
    /// When: of a depth frame the middle of its exposure, of inertial readings the first.
    pub time: Timestamp,
}

/// A message whose CRCs are right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Message<'a> {
    /// What it is.
    pub header: Header,
    /// What it holds.
    pub body: &'a [u8],
}

/// What a message holds, read.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Content<'a> {
    /// Who the device is, and its calibration.
    Hello(Hello),
    /// A depth image.
    Depth(Depth<'a>),
    /// Inertial readings.
    Imu(Imu<'a>),
    /// A key frame, not yet decoded: [`KeyFrame::decode`](super::keyframe::KeyFrame::decode).
    KeyFrame(&'a [u8]),
    /// Of a kind that this reader does not know.
    Other(u8),
}

impl<'a> Message<'a> {
    /// Reads the body.
    ///
    /// # Errors
    /// [`Malformed`], naming the field.
    pub fn content(&self) -> Result<Content<'a>, Malformed> {
        match self.header.kind {
            Kind::Hello => Hello::read(self.body).map(Content::Hello),
            Kind::Depth => Depth::read(self.body).map(Content::Depth),
            Kind::Imu => Imu::read(self.header.time, self.body).map(Content::Imu),
            Kind::KeyFrame => Ok(Content::KeyFrame(self.body)),
            Kind::Other(n) => Ok(Content::Other(n)),
        }
    }
}

/// What [`find`] found.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub enum Found<'a> {
    /// A message: take `used` bytes off, of which the first `garbage` were no message.
    Message {
        /// It.
        message: Message<'a>,
        /// Bytes before it that are no message.
        garbage: usize,
        /// Bytes up to its end.
        used: usize,
    },
    /// None yet: take `garbage` bytes off, and come again when at least `needed` are there.
    More {
        /// Bytes that are no message.
        garbage: usize,
        /// Bytes that are needed behind those.
        needed: usize,
    },
    /// One that is damaged, too long, or of another version: take `used` bytes off and go on.
    Damaged {
        /// Why.
        error: Malformed,
        /// Bytes up to where the search goes on, the garbage before it included.
        used: usize,
    },
}

/// Looks for the first message in bytes of a stream. `most` bounds the bytes of one message that the caller is ready to hold.
///
/// ```
/// use isobath::ground::units::Timestamp;
/// use isobath::wire::bulk::{Content, Found, encode_imu, find, imu_bytes};
/// use isobath::glam::Vec3;
/// use isobath::sensing::imu::ImuSample;
/// // On the device.
/// let reading = ImuSample { time: Timestamp::from_nanos(5), rate: Vec3::Z, force: Vec3::Y * 9.8, field: None };
/// let mut sent = [0; 3 + imu_bytes(1, false)];
/// let used = encode_imu(&[reading], 7, &mut sent[3..])?; // three bytes of noise before it
/// assert_eq!(3 + used, sent.len());
///
/// // On the host.
/// let Found::Message { message, garbage: 3, used } = find(&sent, 1 << 20) else { panic!("no message") };
/// let Content::Imu(readings) = message.content()? else { panic!("no readings") };
/// assert_eq!((message.header.sequence, readings.iter().next()), (7, Some(reading)));
/// # Ok::<(), isobath::wire::malformed::Malformed>(())
/// ```
pub fn find(bytes: &[u8], most: usize) -> Found<'_> {
    let mut at = 0;
    loop {
        let rest = bytes.get(at..).unwrap_or_default();
        // Up to something that may be a header: its magic, or the first byte of it at the end.
        let [first, second] = MAGIC;
        let skip =
            rest.iter().enumerate().find(|(i, b)| **b == first && rest.get(i + 1).is_none_or(|next| *next == second));
        let Some((skip, _)) = skip else { return Found::More { garbage: bytes.len(), needed: HEADER } };
        at += skip;
        let rest = rest.get(skip..).unwrap_or_default();
        let Some(header) = rest.first_chunk::<HEADER>() else {
            return Found::More { garbage: at, needed: HEADER };
        };
        match message(header, rest, most) {
            Ok(Some(message)) => {
                let used = at + OVERHEAD + message.body.len();
                return Found::Message { message, garbage: at, used };
            }
            Ok(None) => return Found::More { garbage: at, needed: needed(header) },
            // Two bytes that look like the magic and are not.
            Err(Wrong::Header) => at += 1,
            Err(Wrong::Message(error)) => return Found::Damaged { error, used: at + HEADER },
        }
    }
}

/// Bytes of the message that a header begins.
fn needed(header: &[u8; HEADER]) -> usize {
    let length = Bytes::new("bulk message", header).u32(4).unwrap_or(0);
    usize::try_from(length).unwrap_or(usize::MAX).saturating_add(OVERHEAD)
}

/// What is wrong with what looks like a message.
enum Wrong {
    /// It is none.
    Header,
    /// It is one, and can't be used.
    Message(Malformed),
}

/// The message that these bytes begin with; `None` when they end before it does.
fn message<'a>(header: &[u8; HEADER], rest: &'a [u8], most: usize) -> Result<Option<Message<'a>>, Wrong> {
    let read = Bytes::new("bulk message", header);
    let of = |e: Malformed| Wrong::Message(e);
    let (checked, said) = (read.slice(0, HEADER - 4).map_err(of)?, read.u32(HEADER - 4).map_err(of)?);
    if crc32(checked) != said {
        return Err(Wrong::Header);
    }
    let version = read.u8(2).map_err(of)?;
    if version != VERSION {
        let what = "the version of a bulk message (bring the older side up to date)";
        return Err(Wrong::Message(Malformed::Field { what, at: 2, got: version.into() }));
    }
    let needed = needed(header);
    if needed > most {
        let got = read.u32(4).map_err(of)?;
        return Err(Wrong::Message(Malformed::Field { what: "the length of a bulk message", at: 4, got }));
    }
    let Some(whole) = rest.get(..needed) else { return Ok(None) };
    let body = whole.get(HEADER..needed - 4).unwrap_or_default();
    let said = Bytes::new("bulk message", whole).u32(needed - 4).map_err(of)?;
    let computed = crc32(body);
    if computed != said {
        return Err(Wrong::Message(Malformed::Crc { what: "the body of a bulk message", said, computed }));
    }
    let header = Header {
        kind: Kind::of(read.u8(3).map_err(of)?),
        sequence: read.u32(8).map_err(of)?,
        time: Timestamp::from_nanos(read.i64(12).map_err(of)?),
    };
    Ok(Some(Message { header, body }))
}

/// Writes a message whose body is there already: a key frame, say. How many bytes it took.
///
/// # Errors
/// [`Malformed::Full`]; [`Malformed::Field`] for bodies of 4 GiB.
pub fn encode(header: &Header, body: &[u8], out: &mut [u8]) -> Result<usize, Malformed> {
    encode_with(header, out, |writer| writer.bytes(body))
}

/// Writes header, body and CRCs.
fn encode_with(
    header: &Header,
    out: &mut [u8],
    body: impl FnOnce(&mut Writer<'_>) -> Result<(), Malformed>,
) -> Result<usize, Malformed> {
    let mut writer = Writer::new("bulk message", out);
    writer.bytes(&MAGIC)?;
    writer.bytes(&[VERSION, header.kind.number()])?;
    writer.u32(0)?;
    writer.u32(header.sequence)?;
    writer.bytes(&header.time.as_nanos().to_le_bytes())?;
    writer.u32(0)?;
    body(&mut writer)?;
    let length = writer.at() - HEADER;
    let sent = u32::try_from(length);
    let sent = sent.map_err(|_| Malformed::Field { what: "the length of a bulk message", at: 4, got: u32::MAX })?;
    writer.amend(4, &sent.to_le_bytes());
    let head = crc32(writer.written().get(..HEADER - 4).unwrap_or_default());
    writer.amend(HEADER - 4, &head.to_le_bytes());
    let tail = crc32(writer.written().get(HEADER..).unwrap_or_default());
    writer.u32(tail)?;
    Ok(writer.at())
}

#[cfg(test)]
mod tests;
