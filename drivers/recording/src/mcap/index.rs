//! What is in a file, and where. A finished file ends with a summary that says it. A file whose recorder was killed, or that was cut off,
//! is walked through from its beginning: everything up to the last whole record is there, and a note says so.

use std::collections::BTreeMap;

use isobath_source::SourceError;
use mcap::records::{Record, op};
use mcap::sans_io::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};

use super::record::{HEAD, head, is_sound, message, parse, read, split, unpack};
use crate::messages::{Encoding, Kind};
use crate::store::{Channel, Contents, Input, Located, MAX_CHUNK, MAX_MESSAGES, NO_CHUNK};

/// Makes the index.
pub(crate) fn contents(input: &mut Input) -> Result<Contents, SourceError> {
    let mut contents = match by_summary(input) {
        Some(contents) => contents,
        None => Walk::new().run(input)?,
    };
    contents.tidy();
    Ok(contents)
}

/// The channels by their number, as they become known.
#[derive(Debug, Default)]
struct Channels {
    schemas: BTreeMap<u16, String>,
    /// Where in `list` a channel is; `None`: of no interest here.
    known: BTreeMap<u16, Option<usize>>,
    list: Vec<Channel>,
    count: usize,
}

impl Channels {
    fn add(&mut self, id: u16, topic: &str, schema: &str, encoding: &str) {
        if self.known.contains_key(&id) {
            return;
        }
        let of_interest = Kind::of(schema).zip(Encoding::of(encoding)).map(|(kind, encoding)| {
            self.list.push(Channel { topic: topic.to_owned(), kind, encoding, messages: Vec::new() });
            self.list.len() - 1
        });
        self.known.insert(id, of_interest);
    }

    /// Notes a message; `false` when there are too many.
    fn push(&mut self, id: u16, place: Located) -> bool {
        if let Some(channel) = self.known.get(&id).copied().flatten().and_then(|i| self.list.get_mut(i)) {
            if self.count >= MAX_MESSAGES {
                return false;
            }
            self.count += 1;
            channel.messages.push(place);
        }
        true
    }
}

fn kind(profile: &str) -> String {
    if profile.is_empty() { "MCAP".into() } else { format!("MCAP, profile {profile}") }
}

fn profile(input: &mut Input) -> String {
    let mut body = Vec::new();
    let at = super::MAGIC.len() as u64;
    let header = read(input, at, op::HEADER, &mut body).and_then(|()| parse(input, op::HEADER, &body));
    if let Ok(Record::Header(header)) = header { header.profile } else { String::new() }
}

/// By the summary at the end; `None` when there is none that tells of every message.
fn by_summary(input: &mut Input) -> Option<Contents> {
    let summary = summary(input)?;
    let mut channels = Channels::default();
    for channel in summary.channels.values() {
        let schema = channel.schema.as_ref().map_or("", |s| s.name.as_str());
        channels.add(channel.id, &channel.topic, schema, &channel.message_encoding);
    }
    let mut body = Vec::new();
    for chunk in &summary.chunk_indexes {
        if chunk.message_index_offsets.is_empty() && chunk.uncompressed_size > 0 {
            return None;
        }
        for (id, &at) in &chunk.message_index_offsets {
            if channels.known.get(id).copied().flatten().is_none() {
                continue;
            }
            read(input, at, op::MESSAGE_INDEX, &mut body).ok()?;
            let Record::MessageIndex(index) = parse(input, op::MESSAGE_INDEX, &body).ok()? else { return None };
            for entry in index.records {
                let place = Located { log_time: entry.log_time, chunk: chunk.chunk_start_offset, at: entry.offset };
                if !channels.push(*id, place) {
                    return None;
                }
            }
        }
    }
    // Messages outside of chunks are in no index, but they are counted.
    let counted = &summary.stats.as_ref()?.channel_message_counts;
    for (id, index) in &channels.known {
        let found = index.and_then(|i| channels.list.get(i)).map(|c| c.messages.len() as u64);
        if found.is_some_and(|n| n != counted.get(id).copied().unwrap_or(0)) {
            return None;
        }
    }
    let mut metadata = BTreeMap::new();
    for index in summary.metadata_indexes.iter().filter(|m| m.name.starts_with("isobath.")) {
        read(input, index.offset, op::METADATA, &mut body).ok()?;
        if let Record::Metadata(m) = parse(input, op::METADATA, &body).ok()? {
            metadata.entry(m.name).or_insert(m.metadata);
        }
    }
    Some(Contents { kind: kind(&profile(input)), channels: channels.list, metadata, notes: Vec::new() })
}

/// `None` unless the summary's records [hold what they say](is_sound): the crate's reader is given no others.
fn sound_summary(input: &mut Input) -> Option<()> {
    // The last record, of 20 bytes, and the magic.
    const TAIL: u64 = HEAD + 20 + super::MAGIC.len() as u64;
    let (mut body, footer) = (Vec::new(), input.size.checked_sub(TAIL)?);
    read(input, footer, op::FOOTER, &mut body).ok()?;
    let mut at = u64::from_le_bytes(*body.first_chunk()?);
    while at != 0 && at < footer {
        let (opcode, len) = head(input, at).ok()??;
        // Longer than a chunk may be is refused.
        input.read(at + HEAD, len, &mut body).ok()?;
        if !is_sound(opcode, &body) {
            return None;
        }
        at = at.checked_add(HEAD)?.checked_add(len)?;
    }
    Some(())
}

fn summary(input: &mut Input) -> Option<mcap::Summary> {
    sound_summary(input)?;
    let options =
        SummaryReaderOptions::default().with_file_size(input.size).with_record_length_limit(MAX_CHUNK as usize);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            SummaryReadEvent::ReadRequest(n) => {
                let read = std::io::Read::read(input.raw(), reader.insert(n)).ok()?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(to) => reader.notify_seeked(std::io::Seek::seek(input.raw(), to).ok()?),
        }
    }
    reader.finish()
}

/// A walk through the whole file.
struct Walk {
    channels: Channels,
    contents: Contents,
    damaged: usize,
    full: bool,
}

impl Walk {
    fn new() -> Self {
        Self { channels: Channels::default(), contents: Contents::default(), damaged: 0, full: false }
    }

    fn run(mut self, input: &mut Input) -> Result<Contents, SourceError> {
        let (mut body, mut chunk) = (Vec::new(), Vec::new());
        let mut at = super::MAGIC.len() as u64;
        let mut ended = false;
        while let Some((opcode, len)) = head(input, at)? {
            match opcode {
                op::CHUNK => match unpack(input, at, &mut body, &mut chunk) {
                    Ok(()) => self.chunk(input, at, &chunk),
                    Err(_) => self.damaged += 1,
                },
                op::MESSAGE if len <= MAX_CHUNK => {
                    input.read(at + HEAD, len.min(32), &mut body)?;
                    if let Some((m, _)) = message(&body) {
                        self.full |=
                            !self.channels.push(m.channel, Located { log_time: m.log_time, chunk: NO_CHUNK, at });
                    }
                }
                op::SCHEMA | op::CHANNEL | op::METADATA | op::HEADER if len <= MAX_CHUNK => {
                    input.read(at + HEAD, len, &mut body)?;
                    self.record(input, opcode, &body);
                }
                op::DATA_END | op::FOOTER => {
                    ended = true;
                    break;
                }
                _ => {}
            }
            at += HEAD + len;
        }
        if !ended {
            self.contents.notes.push(format!(
                "the file is cut off (its recorder was probably stopped by force): everything up to byte {at} of {} is here",
                input.size
            ));
        } else {
            self.contents.notes.push("the file has no index: it was read through once to open it".into());
        }
        if self.damaged > 0 {
            self.contents.notes.push(format!("{} damaged chunks were left out", self.damaged));
        }
        if self.full {
            self.contents.notes.push(format!("only the first {MAX_MESSAGES} messages are here"));
        }
        self.contents.channels = self.channels.list;
        if self.contents.kind.is_empty() {
            self.contents.kind = kind("");
        }
        Ok(self.contents)
    }

    fn chunk(&mut self, input: &Input, chunk: u64, bytes: &[u8]) {
        let mut at = 0;
        while let Some((opcode, body, next)) = split(bytes, at) {
            if opcode == op::MESSAGE {
                if let Some((m, _)) = message(body) {
                    self.full |= !self.channels.push(m.channel, Located { log_time: m.log_time, chunk, at });
                }
            } else {
                self.record(input, opcode, body);
            }
            at = next;
        }
    }

    /// What is not a message; what can't be read is passed over.
    fn record(&mut self, input: &Input, opcode: u8, body: &[u8]) {
        if !matches!(opcode, op::SCHEMA | op::CHANNEL | op::METADATA | op::HEADER) {
            return;
        }
        match parse(input, opcode, body) {
            Ok(Record::Header(header)) => self.contents.kind = kind(&header.profile),
            Ok(Record::Schema { header, .. }) => {
                self.channels.schemas.entry(header.id).or_insert(header.name);
            }
            Ok(Record::Channel(c)) => {
                let schema = self.channels.schemas.get(&c.schema_id).cloned().unwrap_or_default();
                self.channels.add(c.id, &c.topic, &schema, &c.message_encoding);
            }
            Ok(Record::Metadata(m)) if m.name.starts_with("isobath.") => {
                self.contents.metadata.entry(m.name).or_insert(m.metadata);
            }
            _ => {}
        }
    }
}
