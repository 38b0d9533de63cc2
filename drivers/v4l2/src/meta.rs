//! What comes with a frame on a node of its own: the device's time stamp, its frame counter, the exposure.
//!
//! uvcvideo gives each frame's UVC header, and the maker's blocks behind it, as a buffer of the metadata node that has the frame's number
//! (`Documentation/userspace-api/media/v4l/metafmt-uvc.rst`, `metafmt-d4xx.rst`). Only the number pairs them. Metadata that comes early waits, in a ring
//! of eight; what comes late or never is missed: no image waits for it, and a camera without such a node works all the same.
//!
//! Formats: `D4XX` (RealSense models that the kernel knows; 6.1 knows one), `UVCM` (Linux 6.17 and later, any camera with Microsoft's extension), `UVCH` (the
//! bare header: a time stamp, but no frame counter and no exposure). Of `UVCH` the kernel hands over the standard header alone, and leaves
//! its length byte as the camera sent it: it counts blocks that are not there.

use isobath::wire::device::d4xx::metadata::FrameInfo;
use isobath::wire::device::uvc;
use isobath_source::HostNanos;

use crate::queue::{CaptureQueue, Failure, Taken, uninterrupted};
use crate::sys::{Format, FourCc, Kind, V4l2Sys};

/// The format of bare headers.
pub const BARE: FourCc = FourCc(*b"UVCH");
/// Formats in the order of how much they say.
pub const FORMATS: [FourCc; 3] = [FourCc(*b"D4XX"), FourCc(*b"UVCM"), BARE];
/// Metadata that may wait for its frame.
const RING: usize = 8;
/// Failures in a row after which the node is left alone.
const PATIENCE: u32 = 3;

/// What is known of one frame beside its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Record {
    /// The kernel's number of the frame.
    pub sequence: u32,
    /// The device's time stamp, in its own ticks; 32 bits, wrapping.
    pub pts: Option<u32>,
    /// When the frame's first bytes were at the host, by the monotonic clock.
    pub arrival: HostNanos,
    /// What the maker's blocks say.
    pub info: FrameInfo,
}

/// A metadata node.
#[derive(Debug)]
pub struct MetaStream<S> {
    sys: S,
    format: FourCc,
    queue: Option<CaptureQueue>,
    ring: [Option<Record>; RING],
    next: usize,
    failures: u32,
}

impl<S: V4l2Sys> MetaStream<S> {
    /// Sets the best format that the node grants.
    ///
    /// # Errors
    /// [`Failure`]: it grants none of them.
    pub fn new(mut sys: S) -> Result<Self, Failure> {
        let doing = "setting the metadata format";
        let mut last = Failure { doing, errno: crate::sys::Errno::EINVAL };
        for fourcc in FORMATS {
            match uninterrupted(|| sys.set_format(Kind::Meta, &Format::ask(fourcc, 0, 0))) {
                Ok(granted) if granted.fourcc == fourcc => {
                    let (queue, ring) = (None, [None; RING]);
                    return Ok(Self { sys, format: fourcc, queue, ring, next: 0, failures: 0 });
                }
                Ok(_) => {}
                Err(errno) => last = Failure { doing, errno },
            }
        }
        Err(last)
    }

    /// The format that was granted.
    #[must_use]
    pub const fn format(&self) -> FourCc {
        self.format
    }

    /// Starts, before the images do: the first frame's metadata comes with it.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn start(&mut self, buffers: u32) -> Result<(), Failure> {
        (self.failures, self.ring) = (0, [None; RING]);
        if self.queue.is_none() {
            self.queue = Some(CaptureQueue::start(&mut self.sys, Kind::Meta, 1, buffers)?);
        }
        Ok(())
    }

    /// Stops, and gives everything back.
    ///
    /// # Errors
    /// [`Failure`]; it is stopped all the same.
    pub fn stop(&mut self) -> Result<(), Failure> {
        self.queue.take().map_or(Ok(()), |mut queue| queue.stop(&mut self.sys))
    }

    /// Forgets what waits: the kernel counts frames anew.
    pub const fn restarted(&mut self) {
        self.ring = [None; RING];
    }

    /// What came with frame `sequence`, if it is here. What is older is forgotten.
    pub fn of(&mut self, sequence: u32) -> Option<Record> {
        self.collect();
        let mut found = None;
        for slot in &mut self.ring {
            let ahead = slot.map_or(1, |r| r.sequence.wrapping_sub(sequence));
            if ahead == 0 {
                found = slot.take();
            } else if ahead >= 0x8000_0000 {
                *slot = None;
            }
        }
        found
    }

    /// Reads what is there, without waiting.
    fn collect(&mut self) {
        let Some(queue) = &mut self.queue else { return };
        // At most all buffers once: a node that fills them as they are given back must not keep us.
        for _ in 0..queue.len() {
            let result = match queue.take(&mut self.sys) {
                Ok(Taken::Nothing) => break,
                Ok(Taken::Buffer(buffer)) => {
                    self.failures = 0;
                    let bytes = queue.bytes(&self.sys, &buffer, 0);
                    let record = if self.format == BARE {
                        bare(bytes).and_then(|(header, length)| parse(header.get(..length)?, buffer.sequence))
                    } else {
                        parse(bytes, buffer.sequence)
                    };
                    if let Some(record) = record {
                        self.ring[self.next] = Some(record);
                        self.next = (self.next + 1) % RING;
                    }
                    queue.give(&mut self.sys, buffer.index)
                }
                Err(failure) => Err(failure),
            };
            if let Err(failure) = result {
                self.failures += 1;
                let lost = failure.errno.is_gone() || self.failures > PATIENCE || queue.restart(&mut self.sys).is_err();
                if lost {
                    // Images go on without.
                    let _ = self.stop();
                }
                return;
            }
        }
    }
}

/// The first header of a buffer of bare ones, with the length that it has; `None` where it is cut off.
fn bare(bytes: &[u8]) -> Option<([u8; 22], usize)> {
    const PREFIX: usize = 10;
    let flags = bytes.get(PREFIX + 1)?;
    let length = 2 + if flags & 4 != 0 { 4 } else { 0 } + if flags & 8 != 0 { 6 } else { 0 };
    let mut header = [0; 22];
    let entry = bytes.get(..PREFIX + length)?;
    header.get_mut(..entry.len())?.copy_from_slice(entry);
    header[PREFIX] = length as u8;
    Some((header, entry.len()))
}

/// The first payload of a buffer that can be read.
fn parse(bytes: &[u8], sequence: u32) -> Option<Record> {
    let mut record: Option<Record> = None;
    for meta in uvc::metadata(bytes).map_while(Result::ok) {
        let first = record.get_or_insert(Record {
            sequence,
            pts: None,
            arrival: HostNanos(meta.host_nanos),
            // Blocks that are not the maker's, or broken, say nothing.
            info: FrameInfo::parse(meta.blocks).unwrap_or_default(),
        });
        first.pts = first.pts.or(meta.header.pts);
        if first.pts.is_some() {
            break;
        }
    }
    record
}
