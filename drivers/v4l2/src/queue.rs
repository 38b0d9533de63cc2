//! The buffers of one node, and who owns each: the program, the kernel, or a caller who holds its bytes.
//!
//! The `v4l` crate's stream queues a buffer that the kernel already has when a wait was given up (libv4l-rs issues 16, 58, 89), and then fails for ever.
//! Here every buffer is in one of three states, and each call says what it may be called in; the scripted kernel of the tests refuses what the
//! real one would.
//!
//! ```text
//! start: REQBUFS, QUERYBUF, mmap, QBUF all, STREAMON       Ours --queue--> Kernel --dequeue--> Ours
//! stop:  STREAMOFF, munmap all, REQBUFS(0)                 Ours --hold--> Held --give_back--> Kernel
//! ```
//!
//! A link that fails (`EIO`, `EPIPE`, ...) leaves it unknown which buffers are whose: [`CaptureQueue::restart`] stops, which makes all of them the
//! program's, queues those that nobody holds, and starts again. Interrupted calls are repeated, a bounded number of times.
//!
//! Memory: 24 bytes a buffer beside the mappings. Cost of a frame: three system calls. Nothing is allocated after `start`.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::sys::{Buffer, Errno, Kind, MAX_PLANES, SysResult, V4l2Sys};

/// Interruptions in a row after which a call is given up: a signal storm, not a signal.
const INTERRUPTIONS: usize = 100;

/// Repeats a call that a signal interrupted.
///
/// # Errors
/// The call's own; `EINTR` after a hundred in a row.
pub fn uninterrupted<T>(mut call: impl FnMut() -> SysResult<T>) -> SysResult<T> {
    for _ in 1..INTERRUPTIONS {
        match call() {
            Err(Errno::EINTR) => {}
            result => return result,
        }
    }
    call()
}

/// A call that failed, and what it was for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Failure {
    /// What was being done, to follow "while".
    pub doing: &'static str,
    /// The kernel's number.
    pub errno: Errno,
}

fn failing(doing: &'static str) -> impl Fn(Errno) -> Failure {
    move |errno| Failure { doing, errno }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Owner {
    Program,
    Kernel,
    /// With the ticket of who holds it.
    Held(u64),
}

/// A buffer that somebody holds. It can't be forged nor copied, and is worth nothing once its stream was stopped.
#[derive(Debug, PartialEq, Eq)]
#[must_use = "give it back, or the stream has one buffer less"]
pub struct Held {
    index: u32,
    ticket: u64,
}

/// What taking a buffer gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken {
    /// A buffer, now the program's.
    Buffer(Buffer),
    /// None is done.
    Nothing,
}

/// The buffers of one node.
#[derive(Debug)]
pub struct CaptureQueue {
    kind: Kind,
    planes: usize,
    owners: Vec<Owner>,
    /// Planes mapped of each buffer.
    mapped: Vec<usize>,
    streaming: bool,
    /// The kernel holds buffers for this node.
    asked: bool,
}

/// Tickets are never given twice, not even by another stream: a held buffer of the past is nobody's.
static TICKETS: AtomicU64 = AtomicU64::new(0);

impl CaptureQueue {
    /// Asks for `count` buffers of the format that is set, maps them, queues them and starts. What was begun is undone when a step fails.
    ///
    /// # Errors
    /// [`Failure`]: which step, and the kernel's number.
    pub fn start(sys: &mut impl V4l2Sys, kind: Kind, planes: usize, count: u32) -> Result<Self, Failure> {
        let planes = planes.clamp(1, MAX_PLANES);
        let mut queue = Self { kind, planes, owners: Vec::new(), mapped: Vec::new(), streaming: false, asked: false };
        match queue.begin(sys, count) {
            Ok(()) => Ok(queue),
            Err(failure) => {
                // The first failure is the one to tell.
                let _ = queue.stop(sys);
                Err(failure)
            }
        }
    }

    fn begin(&mut self, sys: &mut impl V4l2Sys, count: u32) -> Result<(), Failure> {
        let (kind, planes) = (self.kind, self.planes);
        let mut asked = uninterrupted(|| sys.request_buffers(kind, count));
        if asked == Err(Errno::EBUSY) {
            // A stream of this very node that could not be stopped; if it is another program's, the kernel refuses this too.
            let _ = uninterrupted(|| sys.stream(kind, false));
            asked = uninterrupted(|| sys.request_buffers(kind, count));
        }
        let granted = asked.map_err(failing("asking for buffers"))?;
        self.asked = granted > 0;
        if granted < 2 {
            // With one, the device has nowhere to put the frame that follows.
            return Err(Failure { doing: "asking for buffers (fewer than two were granted)", errno: Errno::EBUSY });
        }
        for index in 0..granted {
            self.owners.push(Owner::Program);
            self.mapped.push(0);
            let buffer =
                uninterrupted(|| sys.query_buffer(kind, index, planes)).map_err(failing("asking about a buffer"))?;
            for (plane, p) in buffer.planes.iter().enumerate().take(planes) {
                uninterrupted(|| sys.map(kind, index, plane, p.offset, p.length))
                    .map_err(failing("mapping a buffer"))?;
                self.mapped[index as usize] += 1;
            }
        }
        self.queue_all(sys)?;
        uninterrupted(|| sys.stream(kind, true)).map_err(failing("starting the stream"))?;
        self.streaming = true;
        Ok(())
    }

    /// Queues whatever the program owns.
    fn queue_all(&mut self, sys: &mut impl V4l2Sys) -> Result<(), Failure> {
        (0..self.owners.len()).try_for_each(|i| self.give(sys, i as u32))
    }

    /// Buffers there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.owners.len()
    }

    /// Whether there are none: the stream was stopped.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.owners.is_empty()
    }

    /// Takes a buffer that is done.
    ///
    /// # Errors
    /// [`Failure`] with the kernel's number. After anything but `ENODEV` it is unknown who owns what: [`Self::restart`].
    pub fn take(&mut self, sys: &mut impl V4l2Sys) -> Result<Taken, Failure> {
        let (kind, planes) = (self.kind, self.planes);
        match uninterrupted(|| sys.dequeue(kind, planes)) {
            Ok(buffer) => match self.owners.get_mut(buffer.index as usize) {
                Some(owner @ Owner::Kernel) => {
                    *owner = Owner::Program;
                    Ok(Taken::Buffer(buffer))
                }
                // A number that the kernel can't have given: nothing is known any more.
                _ => Err(Failure {
                    doing: "taking a buffer (the kernel gave one that it did not have)",
                    errno: Errno::EIO,
                }),
            },
            Err(Errno::EAGAIN) => Ok(Taken::Nothing),
            Err(errno) => Err(Failure { doing: "taking a buffer", errno }),
        }
    }

    /// The bytes of a plane of a buffer that the program owns: those that were written, without what comes before the data. Nothing for buffers that
    /// are somebody else's, and no more than is mapped, whatever the driver says.
    pub fn bytes<'s>(&self, sys: &'s impl V4l2Sys, buffer: &Buffer, plane: usize) -> &'s [u8] {
        if plane >= self.planes || self.owners.get(buffer.index as usize) != Some(&Owner::Program) {
            return &[];
        }
        written(sys.bytes(self.kind, buffer.index, plane), buffer, plane)
    }

    /// Gives a buffer that the program owns to the kernel to fill; nothing happens to buffers that are somebody else's.
    ///
    /// # Errors
    /// [`Failure`]; the buffer stays the program's. After anything but `ENODEV`: [`Self::restart`].
    pub fn give(&mut self, sys: &mut impl V4l2Sys, index: u32) -> Result<(), Failure> {
        let (kind, planes) = (self.kind, self.planes);
        if let Some(owner @ Owner::Program) = self.owners.get_mut(index as usize) {
            uninterrupted(|| sys.queue(kind, index, planes)).map_err(failing("giving a buffer"))?;
            *owner = Owner::Kernel;
        }
        Ok(())
    }

    /// Lets somebody hold a buffer that the program owns: its bytes stay as they are until it is given back. `None` when the buffer is not
    /// the program's, or when all but two are held already, since the stream would starve.
    pub fn hold(&mut self, index: u32) -> Option<Held> {
        let room = self.can_hold();
        let owner = self.owners.get_mut(index as usize).filter(|o| **o == Owner::Program && room)?;
        let ticket = TICKETS.fetch_add(1, Ordering::Relaxed);
        *owner = Owner::Held(ticket);
        Some(Held { index, ticket })
    }

    /// Whether one more may be held.
    #[must_use]
    pub fn can_hold(&self) -> bool {
        self.owners.iter().filter(|o| matches!(o, Owner::Held(_))).count() < self.lease_limit()
    }

    /// Buffers that may be held at once.
    #[must_use]
    pub fn lease_limit(&self) -> usize {
        self.owners.len().saturating_sub(2)
    }

    /// The bytes of a held buffer, as [`Self::bytes`]; nothing once its stream was stopped.
    pub fn held_bytes<'s>(&self, sys: &'s impl V4l2Sys, held: &Held, buffer: &Buffer, plane: usize) -> &'s [u8] {
        let mine = self.owners.get(held.index as usize) == Some(&Owner::Held(held.ticket));
        if !mine || plane >= self.planes || buffer.index != held.index {
            return &[];
        }
        written(sys.bytes(self.kind, held.index, plane), buffer, plane)
    }

    /// Gives a held buffer to the kernel; nothing happens when its stream was stopped since.
    ///
    /// # Errors
    /// As [`Self::give`].
    pub fn give_back(&mut self, sys: &mut impl V4l2Sys, held: Held) -> Result<(), Failure> {
        match self.owners.get_mut(held.index as usize) {
            Some(owner) if *owner == Owner::Held(held.ticket) => {
                *owner = Owner::Program;
                if self.streaming { self.give(sys, held.index) } else { Ok(()) }
            }
            _ => Ok(()),
        }
    }

    /// After a failure of the link: stops, and starts again with all buffers that nobody holds.
    ///
    /// # Errors
    /// [`Failure`]; the stream does not run then, and can be restarted again or stopped.
    pub fn restart(&mut self, sys: &mut impl V4l2Sys) -> Result<(), Failure> {
        let kind = self.kind;
        uninterrupted(|| sys.stream(kind, false)).map_err(failing("stopping the stream"))?;
        self.streaming = false;
        for owner in self.owners.iter_mut().filter(|o| **o == Owner::Kernel) {
            *owner = Owner::Program;
        }
        self.queue_all(sys)?;
        uninterrupted(|| sys.stream(kind, true)).map_err(failing("starting the stream"))?;
        self.streaming = true;
        Ok(())
    }

    /// Stops, unmaps everything and gives the buffers back to the kernel. Goes through all steps whatever fails on the way. Stopping twice changes
    /// nothing; who still holds a buffer finds it empty.
    ///
    /// # Errors
    /// [`Failure`]: the first one. A device that is gone is none: there is nothing left to give back.
    pub fn stop(&mut self, sys: &mut impl V4l2Sys) -> Result<(), Failure> {
        let kind = self.kind;
        let mut first = Ok(());
        let mut note = |doing, result: SysResult<()>| {
            if let (Err(errno), Ok(())) = (result, &first)
                && !errno.is_gone()
            {
                first = Err(Failure { doing, errno });
            }
        };
        if !self.asked {
            return Ok(());
        }
        let mut stopped = uninterrupted(|| sys.stream(kind, false));
        if stopped.is_err_and(|e| !e.is_gone()) {
            stopped = uninterrupted(|| sys.stream(kind, false));
        }
        note("stopping the stream", stopped);
        for (index, planes) in self.mapped.drain(..).enumerate() {
            for plane in 0..planes {
                let mut result = uninterrupted(|| sys.unmap(kind, index as u32, plane));
                if result.is_err() {
                    result = uninterrupted(|| sys.unmap(kind, index as u32, plane));
                }
                note("unmapping a buffer", result);
            }
        }
        self.owners.clear();
        (self.streaming, self.asked) = (false, false);
        // A stream that could not be stopped keeps its buffers until the node is closed: asking would only be refused.
        if stopped.is_ok() {
            note("giving the buffers back", uninterrupted(|| sys.request_buffers(kind, 0)).map(drop));
        }
        first
    }
}

/// The part of a plane's memory that was written, without what comes before the data.
fn written<'s>(memory: &'s [u8], buffer: &Buffer, plane: usize) -> &'s [u8] {
    let Some(p) = buffer.planes.get(plane) else { return &[] };
    let end = memory.len().min(p.used as usize);
    memory.get(p.data_offset as usize..end).unwrap_or_default()
}
