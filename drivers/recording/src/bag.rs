//! ROS 1 bags, version 2.0, which RealSense's viewer records into too. <http://wiki.ros.org/Bags/Format/2.0>
//!
//! A record is a header of named fields and data, each behind its length. Messages lie in chunks, each followed by its index;
//! a walk over the records' headers, which skips what the chunks hold, finds them all. A chunk without index (the recorder was
//! killed) is unpacked and walked through. Chunks packed by lz4, or not at all, are read; bzip2 is not.

use std::collections::BTreeMap;
use std::io::Read;

use isobath_source::SourceError;

use crate::messages::{Encoding, Kind};
use crate::store::{Channel, Contents, Input, Located, MAX_CHUNK, MAX_MESSAGES};

/// The first bytes of a bag.
pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

const MESSAGE: u8 = 0x02;
const INDEX: u8 = 0x04;
const CHUNK: u8 = 0x05;
const CONNECTION: u8 = 0x07;
/// The longest header, bytes.
const MAX_HEADER: u64 = 1 << 20;
const DAMAGED: &str = "the file is damaged: copy it again; `rosbag reindex` keeps what can be kept";

/// A header's fields.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn get(&self, name: &str) -> Option<&'a [u8]> {
        let mut rest = self.0;
        while let Some((field, after)) = prefixed(rest) {
            rest = after;
            if let Some(value) = field.strip_prefix(name.as_bytes()).and_then(|v| v.strip_prefix(b"=")) {
                return Some(value);
            }
        }
        None
    }

    fn op(&self) -> Option<u8> {
        self.get("op")?.first().copied()
    }

    fn u32(&self, name: &str) -> Option<u32> {
        Some(u32::from_le_bytes(self.get(name)?.try_into().ok()?))
    }

    fn text(&self, name: &str) -> Option<&'a str> {
        std::str::from_utf8(self.get(name)?).ok()
    }
}

/// Bytes behind their length of four bytes, and what follows them.
fn prefixed(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (len, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(*len) as usize)
}

/// The record at the front: its fields, its data, and what follows.
fn record(bytes: &[u8]) -> Option<(Fields<'_>, &[u8], &[u8])> {
    let (header, rest) = prefixed(bytes)?;
    let (data, rest) = prefixed(rest)?;
    Some((Fields(header), data, rest))
}

fn time(sec_nsec: &[u8]) -> Option<u64> {
    let [sec, nsec] = *sec_nsec.as_chunks::<4>().0 else { return None };
    Some(u64::from(u32::from_le_bytes(sec)) * 1_000_000_000 + u64::from(u32::from_le_bytes(nsec)))
}

/// The message at `at` of an unpacked chunk. Bags count per connection, in the messages' own headers: 0 here.
pub(crate) fn message_in(chunk: &[u8], at: u64) -> Option<(u32, &[u8])> {
    let (fields, data, _) = record(chunk.get(usize::try_from(at).ok()?..)?)?;
    (fields.op()? == MESSAGE).then_some((0, data))
}

/// Reads a record's header, and where its data are: offset and length. `None` where the file ends first.
fn head(input: &mut Input, at: u64, header: &mut Vec<u8>) -> Result<Option<(u64, u64)>, SourceError> {
    let len = |input: &mut Input, at: u64, most: u64| -> Result<Option<u64>, SourceError> {
        if !input.holds(at, 4) {
            return Ok(None);
        }
        let mut bytes = Vec::new();
        input.read(at, 4, &mut bytes)?;
        let len = bytes.as_slice().try_into().map_or(0, u32::from_le_bytes);
        Ok(Some(u64::from(len)).filter(|&n| n <= most && input.holds(at + 4, n)))
    };
    let Some(header_len) = len(input, at, MAX_HEADER)? else { return Ok(None) };
    let data_at = at + 4 + header_len;
    let Some(data_len) = len(input, data_at, u64::MAX)? else { return Ok(None) };
    input.read(at + 4, header_len, header)?;
    Ok(Some((data_at + 4, data_len)))
}

/// Reads and unpacks the chunk whose record begins at `at`.
pub(crate) fn unpack(input: &mut Input, at: u64, packed: &mut Vec<u8>, out: &mut Vec<u8>) -> Result<(), SourceError> {
    let mut header = Vec::new();
    let Some((data_at, len)) = head(input, at, &mut header)? else {
        return Err(input.broken(format!("the chunk at byte {at} is cut off"), DAMAGED));
    };
    let fields = Fields(&header);
    let (Some(CHUNK), Some(compression), Some(size)) = (fields.op(), fields.text("compression"), fields.u32("size"))
    else {
        return Err(input.broken(format!("there is no chunk at byte {at}"), DAMAGED));
    };
    if u64::from(size) > MAX_CHUNK {
        return Err(input.broken(format!("the chunk at byte {at} says that it unpacks to {size} bytes"), DAMAGED));
    }
    input.read(data_at, len, packed)?;
    out.clear();
    match compression {
        "none" => std::mem::swap(packed, out),
        "lz4" => {
            lz4_flex::frame::FrameDecoder::new(packed.as_slice())
                .take(u64::from(size) + 1)
                .read_to_end(out)
                .map_err(|e| input.broken(format!("the chunk at byte {at} can't be unpacked: {e}"), DAMAGED))?;
        }
        other => {
            return Err(SourceError::Unsupported {
                path: input.path.clone(),
                what: format!("has chunks packed by {other}"),
                hint: "lz4 and unpacked ones are read: `rosbag decompress` unpacks a bag".into(),
            });
        }
    }
    if out.len() as u64 != u64::from(size) {
        let held = out.len();
        return Err(
            input.broken(format!("the chunk at byte {at} holds {held} bytes, not the {size} that it says"), DAMAGED)
        );
    }
    Ok(())
}

/// What a walk has found.
#[derive(Debug, Default)]
struct Walk {
    /// Topic and type by connection.
    connections: BTreeMap<u32, (String, String)>,
    messages: BTreeMap<u32, Vec<Located>>,
    count: usize,
    notes: Vec<String>,
}

impl Walk {
    fn connection(&mut self, fields: &Fields<'_>, data: &[u8]) {
        let topic = fields.text("topic").map(ToOwned::to_owned);
        let kind = Fields(data).text("type").map(ToOwned::to_owned);
        if let (Some(id), Some(topic), Some(kind)) = (fields.u32("conn"), topic, kind) {
            self.connections.entry(id).or_insert((topic, kind));
        }
    }

    fn message(&mut self, connection: u32, place: Located) {
        if self.count < MAX_MESSAGES {
            self.count += 1;
            self.messages.entry(connection).or_default().push(place);
        }
    }

    /// Walks through an unpacked chunk: its connections, and its messages when no index tells of them.
    fn chunk(&mut self, chunk: u64, bytes: &[u8], indexed: bool) {
        let mut rest = bytes;
        while let Some((fields, data, after)) = record(rest) {
            let at = (bytes.len() - rest.len()) as u64;
            match fields.op() {
                Some(CONNECTION) => self.connection(&fields, data),
                Some(MESSAGE) if !indexed => {
                    if let (Some(id), Some(log_time)) = (fields.u32("conn"), fields.get("time").and_then(time)) {
                        self.message(id, Located { log_time, chunk, at });
                    }
                }
                _ => {}
            }
            rest = after;
        }
    }
}

/// Makes the index.
pub(crate) fn contents(input: &mut Input) -> Result<Contents, SourceError> {
    let mut walk = Walk::default();
    let (mut header, mut data, mut unpacked) = (Vec::new(), Vec::new(), Vec::new());
    // Chunks, and whether an index followed.
    let mut chunks: Vec<(u64, bool)> = Vec::new();
    let mut at = MAGIC.len() as u64;
    let mut cut_off = at < input.size;
    while let Some((data_at, len)) = head(input, at, &mut header)? {
        let fields = Fields(&header);
        match fields.op() {
            Some(CHUNK) => chunks.push((at, false)),
            Some(INDEX) => {
                input.read(data_at, len, &mut data)?;
                if let (Some(id), Some((chunk, indexed))) = (fields.u32("conn"), chunks.last_mut()) {
                    *indexed = true;
                    for entry in data.as_chunks::<12>().0 {
                        let (when, offset) = entry.split_at(8);
                        let offset = offset.try_into().map_or(0, u32::from_le_bytes);
                        let log_time = time(when).unwrap_or(0);
                        walk.message(id, Located { log_time, chunk: *chunk, at: u64::from(offset) });
                    }
                }
            }
            Some(CONNECTION) => {
                input.read(data_at, len, &mut data)?;
                walk.connection(&fields, &data);
            }
            _ => {}
        }
        at = data_at + len;
        cut_off = at < input.size;
    }
    let unnamed = walk.messages.keys().any(|id| !walk.connections.contains_key(id));
    let mut damaged = 0;
    for &(chunk, indexed) in chunks.iter().filter(|(_, indexed)| unnamed || !indexed) {
        match unpack(input, chunk, &mut data, &mut unpacked) {
            Ok(()) => walk.chunk(chunk, &unpacked, indexed),
            Err(e @ SourceError::Unsupported { .. }) => return Err(e),
            Err(_) => damaged += 1,
        }
    }
    if cut_off {
        walk.notes.push(format!("the file is cut off: everything up to byte {at} of {} is here", input.size));
    }
    if damaged > 0 {
        walk.notes.push(format!("{damaged} damaged chunks were left out"));
    }
    let mut channels = Vec::new();
    for (id, messages) in walk.messages {
        let Some((topic, kind)) = walk.connections.get(&id) else { continue };
        if let Some(kind) = Kind::of(kind) {
            // Several senders of one topic are one stream.
            let same = |c: &&mut Channel| c.topic == *topic && c.kind == kind;
            match channels.iter_mut().find(same) {
                Some(c) => c.messages.extend(messages),
                None => channels.push(Channel { topic: topic.clone(), kind, encoding: Encoding::Ros1, messages }),
            }
        }
    }
    let mut contents = Contents { kind: "ROS 1 bag".into(), channels, metadata: BTreeMap::new(), notes: walk.notes };
    contents.tidy();
    Ok(contents)
}
