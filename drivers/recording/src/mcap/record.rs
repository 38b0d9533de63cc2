//! Records in bytes: an opcode, a length of eight bytes, a body. Chunks are records that hold records, packed or not.

use std::io::Read;

use isobath_source::SourceError;
use mcap::records::{ChunkHeader, Record, op};

use crate::store::{Input, MAX_CHUNK};

/// Opcode and length.
pub(super) const HEAD: u64 = 9;
/// Channel, sequence, log time and publish time, in front of a message's content.
const MESSAGE_HEAD: usize = 22;

const DAMAGED: &str = "the file is damaged: copy it again; `mcap recover` keeps what can be kept";

/// The record at `at` of these bytes: its opcode, its body, and where the next one begins.
pub(super) fn split(bytes: &[u8], at: u64) -> Option<(u8, &[u8], u64)> {
    let rest = bytes.get(usize::try_from(at).ok()?..)?;
    let (&[opcode, ref len @ ..], body) = rest.split_first_chunk::<9>()?;
    let len = u64::from_le_bytes(*len);
    let body = body.get(..usize::try_from(len).ok()?)?;
    Some((opcode, body, at.checked_add(HEAD)?.checked_add(len)?))
}

/// A message's head.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    pub(super) channel: u16,
    pub(super) sequence: u32,
    pub(super) log_time: u64,
}

/// A message record's head and content.
pub(super) fn message(body: &[u8]) -> Option<(Head, &[u8])> {
    let (&[c0, c1, s0, s1, s2, s3, ref times @ ..], data) = body.split_first_chunk::<MESSAGE_HEAD>()?;
    let (log_time, _) = times.split_first_chunk()?;
    let head = Head {
        channel: u16::from_le_bytes([c0, c1]),
        sequence: u32::from_le_bytes([s0, s1, s2, s3]),
        log_time: u64::from_le_bytes(*log_time),
    };
    Some((head, data))
}

/// The sequence number and the content of the message at `at` of an unpacked chunk.
pub(crate) fn message_in(chunk: &[u8], at: u64) -> Option<(u32, &[u8])> {
    let (opcode, body, _) = split(chunk, at)?;
    let (head, data) = message(body).filter(|_| opcode == op::MESSAGE)?;
    Some((head.sequence, data))
}

/// The same for a message that is in no chunk.
pub(crate) fn message_in_file(input: &mut Input, at: u64, out: &mut Vec<u8>) -> Result<u32, SourceError> {
    read(input, at, op::MESSAGE, out)?;
    let Some((head, _)) = message(out) else {
        return Err(input.broken(format!("the message at byte {at} is cut off"), DAMAGED));
    };
    out.drain(..MESSAGE_HEAD);
    Ok(head.sequence)
}

/// The opcode and the length of the record at `at`; `None` where the file ends before the record does.
pub(super) fn head(input: &mut Input, at: u64) -> Result<Option<(u8, u64)>, SourceError> {
    if !input.holds(at, HEAD) {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    input.read(at, HEAD, &mut bytes)?;
    let Some((&[opcode, ref len @ ..], _)) = bytes.split_first_chunk::<9>() else { return Ok(None) };
    let len = u64::from_le_bytes(*len);
    Ok(at.checked_add(HEAD).filter(|&body| input.holds(body, len)).map(|_| (opcode, len)))
}

/// Reads the body of the record at `at`, which must be of this kind.
pub(super) fn read(input: &mut Input, at: u64, wanted: u8, out: &mut Vec<u8>) -> Result<(), SourceError> {
    match head(input, at)? {
        Some((opcode, len)) if opcode == wanted => input.read(at + HEAD, len, out),
        _ => Err(input.broken(format!("there is no record of kind {wanted:#04x} at byte {at}"), DAMAGED)),
    }
}

/// What of a record's body is not read yet.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(taken)
    }

    /// Text, a map, or a list: four bytes of length, and so many bytes.
    fn counted(&mut self) -> Option<&'a [u8]> {
        let len = self.take(4)?.first_chunk().copied().map(u32::from_le_bytes)?;
        self.take(usize::try_from(len).ok()?)
    }

    fn map(&mut self) -> Option<()> {
        let mut pairs = Rest(self.counted()?);
        while !pairs.0.is_empty() {
            pairs.counted()?;
        }
        Some(())
    }
}

/// Whether the texts and maps of a record end within its body. The mcap crate makes room for as many bytes as a text says it has (4 GiB at most) before it
/// looks whether they are there.
pub(super) fn is_sound(opcode: u8, body: &[u8]) -> bool {
    // Bytes before, texts; and then a map, or a list and a text behind eight bytes.
    let (before, texts) = match opcode {
        op::HEADER => (0, 2),
        op::SCHEMA => (2, 2),
        op::CHANNEL => (4, 2),
        op::CHUNK => (28, 1),
        op::CHUNK_INDEX => (32, 0),
        op::ATTACHMENT_INDEX => (40, 2),
        op::METADATA => (0, 1),
        op::METADATA_INDEX => (16, 1),
        _ => return true,
    };
    let mut rest = Rest(body);
    let fits = |rest: &mut Rest<'_>| {
        rest.take(before)?;
        for _ in 0..texts {
            rest.counted()?;
        }
        match opcode {
            op::CHANNEL | op::METADATA => rest.map(),
            op::CHUNK_INDEX => {
                rest.counted()?;
                rest.take(8)?;
                rest.counted().map(|_| ())
            }
            _ => Some(()),
        }
    };
    fits(&mut rest).is_some()
}

/// Parses a record's body. (Attachments, of any size and of no interest here, are never given to it.)
pub(super) fn parse<'a>(input: &Input, opcode: u8, body: &'a [u8]) -> Result<Record<'a>, SourceError> {
    if !is_sound(opcode, body) {
        let what = format!("a record of kind {opcode:#04x} says that it holds more than it does");
        return Err(input.broken(what, DAMAGED));
    }
    mcap::parse_record(opcode, body)
        .map_err(|e| input.broken(format!("a record of kind {opcode:#04x} can't be read: {e}"), DAMAGED))
}

/// Reads and unpacks the chunk at `at`.
pub(crate) fn unpack(input: &mut Input, at: u64, packed: &mut Vec<u8>, out: &mut Vec<u8>) -> Result<(), SourceError> {
    read(input, at, op::CHUNK, packed)?;
    let Record::Chunk { header, data } = parse(input, op::CHUNK, packed)? else {
        return Err(input.broken(format!("the record at byte {at} is no chunk"), DAMAGED));
    };
    unpack_data(&header, &data, out)
        .map_err(|what| input.broken(format!("the chunk at byte {at} can't be unpacked: {what}"), DAMAGED))
}

fn unpack_data(header: &ChunkHeader, data: &[u8], out: &mut Vec<u8>) -> Result<(), String> {
    let size = header.uncompressed_size;
    if size > MAX_CHUNK {
        return Err(format!("it says that it unpacks to {size} bytes, more than {MAX_CHUNK}"));
    }
    out.clear();
    match header.compression.as_str() {
        "" => out.extend_from_slice(data),
        // One byte more than was said shows that more is there.
        "lz4" => {
            lz4_flex::frame::FrameDecoder::new(data).take(size + 1).read_to_end(out).map_err(|e| e.to_string())?;
        }
        "zstd" => {
            let decoder = ruzstd::decoding::StreamingDecoder::new(data).map_err(|e| e.to_string())?;
            decoder.take(size + 1).read_to_end(out).map_err(|e| e.to_string())?;
        }
        other => return Err(format!("it is packed by {other:?}; lz4, zstd and none are known")),
    }
    if out.len() as u64 != size {
        return Err(format!("it holds {} bytes, not the {size} that it says", out.len()));
    }
    let sum = crc32fast::hash(out);
    if header.uncompressed_crc != 0 && header.uncompressed_crc != sum {
        return Err(format!("its checksum is {sum:08x}, not {:08x}", header.uncompressed_crc));
    }
    Ok(())
}
