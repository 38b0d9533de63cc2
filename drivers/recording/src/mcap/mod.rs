//! MCAP, the container that Foxglove and ROS 2 record into. <https://mcap.dev/spec>
//!
//! | file | idea |
//! |---|---|
//! | [`index`] | what is in a file and where: by its summary, or, when the recorder was killed, by walking through it |
//! | [`record`] | records, chunks and messages in bytes |
//! | [`writer`] | frames and inertial readings into a file that survives a crash |
//!
//! The `mcap` crate writes, and reads summaries and records; the walk and the chunks are our own, because a file cut off anywhere
//! must open. Its compression features are off (both are C): lz4 and zstd chunks are unpacked by `lz4_flex` and `ruzstd`, which have no
//! `unsafe` to be afraid of in hostile files, and what is written is not packed (`mcap compress` does that afterwards).

mod index;
mod record;
pub(crate) mod writer;

pub(crate) use index::contents;
pub(crate) use mcap::MAGIC;
pub(crate) use record::{message_in, message_in_file, unpack};
