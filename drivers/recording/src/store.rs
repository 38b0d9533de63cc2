//! A file of time-stamped messages in chunks, whichever container it is: what is in it, where, and each message on demand.
//!
//! Opening makes an index, from the file's own where there is one: 24 bytes a message of the kinds that are read. Afterwards a
//! message is one look into its chunk; the three chunks used last stay in memory, unpacked. Nothing that the file says is
//! believed before it is compared with the file's length: a chunk of more than [`MAX_CHUNK`] bytes, packed or not, is refused.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use isobath_source::SourceError;

use crate::messages::{Encoding, Kind, Message, decode};
use crate::parse::ParseError;
use crate::{bag, mcap};

/// The largest chunk, packed or not, and the largest single message, bytes.
pub(crate) const MAX_CHUNK: u64 = 256 << 20;
/// Messages that are indexed at most, of all kinds together.
pub(crate) const MAX_MESSAGES: usize = 32 << 20;
/// A message that is in no chunk.
pub(crate) const NO_CHUNK: u64 = u64::MAX;
/// Chunks kept in memory.
const CACHED: usize = 3;

/// Where bytes come from: a file, or memory in tests.
pub(crate) trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

/// A file that is read here and there, and its length.
pub(crate) struct Input {
    file: Box<dyn ReadSeek>,
    pub(crate) size: u64,
    pub(crate) path: PathBuf,
}

impl Input {
    pub(crate) fn open(path: &Path) -> Result<Self, SourceError> {
        let io = |e| SourceError::io(path, e);
        let file = File::open(path).map_err(io)?;
        let meta = file.metadata().map_err(io)?;
        if !meta.is_file() {
            return Err(SourceError::Unsupported {
                path: path.into(),
                what: "is not a regular file".into(),
                hint: "give the path of a recording".into(),
            });
        }
        Ok(Self { file: Box::new(file), size: meta.len(), path: path.into() })
    }

    pub(crate) fn of_bytes(bytes: Vec<u8>, name: &str) -> Self {
        Self { size: bytes.len() as u64, file: Box::new(io::Cursor::new(bytes)), path: name.into() }
    }

    /// Whether that many bytes are there.
    pub(crate) fn holds(&self, offset: u64, len: u64) -> bool {
        offset.checked_add(len).is_some_and(|end| end <= self.size)
    }

    /// Reads `len` bytes from `offset`; what is not there is an error before memory is taken for it.
    pub(crate) fn read(&mut self, offset: u64, len: u64, out: &mut Vec<u8>) -> Result<(), SourceError> {
        if len > MAX_CHUNK || !self.holds(offset, len) {
            return Err(self.broken(
                format!("{len} bytes are said to be at byte {offset} of {}", self.size),
                "the file is damaged or cut off: copy it again",
            ));
        }
        out.clear();
        out.resize(len as usize, 0);
        self.file
            .seek(SeekFrom::Start(offset))
            .and_then(|_| self.file.read_exact(out))
            .map_err(|e| SourceError::io(&self.path, e))
    }

    pub(crate) fn raw(&mut self) -> &mut dyn ReadSeek {
        self.file.as_mut()
    }

    pub(crate) fn broken(&self, what: impl Into<String>, hint: &str) -> SourceError {
        SourceError::Format { path: self.path.clone(), line: None, what: what.into(), hint: hint.into() }
    }

    pub(crate) fn parse_error(&self, place: &str, e: ParseError) -> SourceError {
        self.broken(format!("{place}: {}", e.what), &e.hint)
    }
}

/// The kinds of container.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Container {
    Mcap,
    Bag,
}

/// A stream of messages of one kind.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Channel {
    pub(crate) topic: String,
    pub(crate) kind: Kind,
    pub(crate) encoding: Encoding,
    /// Sorted by time.
    pub(crate) messages: Vec<Located>,
}

/// Where a message is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Located {
    /// When it was written down, nanoseconds.
    pub(crate) log_time: u64,
    /// Where its chunk begins in the file, or [`NO_CHUNK`].
    pub(crate) chunk: u64,
    /// Where it begins in the unpacked chunk, or in the file.
    pub(crate) at: u64,
}

/// What a container's index says.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    /// "MCAP, profile ros2".
    pub(crate) kind: String,
    pub(crate) channels: Vec<Channel>,
    /// MCAP's metadata records of ours.
    pub(crate) metadata: BTreeMap<String, BTreeMap<String, String>>,
    pub(crate) notes: Vec<String>,
}

impl Contents {
    /// Sorts what a walk through a file found, and leaves out channels without messages.
    pub(crate) fn tidy(&mut self) {
        self.channels.retain(|c| !c.messages.is_empty());
        for c in &mut self.channels {
            c.messages.sort();
        }
        self.channels.sort_by(|a, b| a.topic.cmp(&b.topic));
    }
}

/// An opened container.
pub(crate) struct Store {
    input: Input,
    container: Container,
    pub(crate) contents: Contents,
    /// The chunks used last, the latest at the end.
    chunks: Vec<(u64, Vec<u8>)>,
    packed: Vec<u8>,
}

impl std::fmt::Debug for Store {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Store").field("path", &self.input.path).finish_non_exhaustive()
    }
}

impl Store {
    /// Opens a container, recognised by its first bytes.
    pub(crate) fn open(mut input: Input) -> Result<Self, SourceError> {
        let mut head = Vec::new();
        input.read(0, input.size.min(16), &mut head)?;
        let (container, contents) = if head.starts_with(mcap::MAGIC) {
            (Container::Mcap, mcap::contents(&mut input)?)
        } else if head.starts_with(bag::MAGIC) {
            (Container::Bag, bag::contents(&mut input)?)
        } else {
            return Err(input.broken("is neither MCAP nor a ROS 1 bag", "check what it is"));
        };
        Ok(Self { input, container, contents, chunks: Vec::new(), packed: Vec::new() })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.input.path
    }

    pub(crate) const fn container(&self) -> Container {
        self.container
    }

    pub(crate) fn channel(&self, index: usize) -> Option<&Channel> {
        self.contents.channels.get(index)
    }

    /// Copies the message's content out, and gives the number that its sender gave it.
    pub(crate) fn read(&mut self, place: Located, out: &mut Vec<u8>) -> Result<u32, SourceError> {
        out.clear();
        if place.chunk == NO_CHUNK {
            let sequence = mcap::message_in_file(&mut self.input, place.at, out)?;
            return Ok(sequence);
        }
        let at = match self.chunks.iter().position(|(chunk, _)| *chunk == place.chunk) {
            Some(at) => at,
            None => {
                // The memory of the chunk unused for longest is the next one's.
                let mut unpacked = if self.chunks.len() < CACHED { Vec::new() } else { self.chunks.remove(0).1 };
                match self.container {
                    Container::Mcap => mcap::unpack(&mut self.input, place.chunk, &mut self.packed, &mut unpacked)?,
                    Container::Bag => bag::unpack(&mut self.input, place.chunk, &mut self.packed, &mut unpacked)?,
                }
                self.chunks.push((place.chunk, unpacked));
                self.chunks.len() - 1
            }
        };
        let chunk = self.chunks.remove(at);
        let message = match self.container {
            Container::Mcap => mcap::message_in(&chunk.1, place.at),
            Container::Bag => bag::message_in(&chunk.1, place.at),
        };
        let sequence = message.map(|(sequence, data)| {
            out.extend_from_slice(data);
            sequence
        });
        self.chunks.push(chunk);
        sequence.ok_or_else(|| {
            self.input.broken(
                format!("there is no message where the index says (chunk at byte {})", place.chunk),
                "the file is damaged: copy it again",
            )
        })
    }

    /// Reads and decodes a message of a channel.
    pub(crate) fn message<'a>(
        &mut self,
        channel: usize,
        place: Located,
        out: &'a mut Vec<u8>,
    ) -> Result<(u32, Message<'a>), SourceError> {
        let sequence = self.read(place, out)?;
        let Some(c) = self.contents.channels.get(channel) else {
            return Err(self.input.broken("there is no such channel", "this is a fault of isobath: report it"));
        };
        let message = decode(c.kind, c.encoding, out).map_err(|e| self.input.parse_error(&c.topic, e))?;
        Ok((sequence, message))
    }
}

/// The message nearest to a time in a list sorted by time; the earlier of two as near.
pub(crate) fn nearest(messages: &[Located], time: u64) -> Option<Located> {
    let after = messages.partition_point(|m| m.log_time < time);
    let near = messages.get(after.saturating_sub(1)..messages.len().min(after + 1))?;
    near.iter().copied().min_by_key(|m| m.log_time.abs_diff(time))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_message_is_found() {
        let list = [10, 20, 40].map(|log_time| Located { log_time, chunk: 0, at: 0 });
        for (time, found) in [(0, 10), (15, 10), (16, 20), (31, 40), (u64::MAX, 40)] {
            assert_eq!(nearest(&list, time).map(|m| m.log_time), Some(found), "{time}");
        }
        assert_eq!(nearest(&[], 5), None);
    }
}
