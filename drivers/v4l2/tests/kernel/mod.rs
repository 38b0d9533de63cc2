//! A scripted kernel: the ownership rules of videobuf2, a device that does what a script says, and a clock that moves only when it is waited on.
//!
//! It refuses what Linux refuses (a buffer queued twice, buffers asked for while mapped, a format changed while buffers exist) and remembers each
//! refusal as an offence of the program: no test may end with one. It counts system calls between steps of progress, so that a
//! program that spins is caught, and mappings, so that one that leaks is.

#![allow(dead_code, reason = "each test uses its part")]

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use isobath_source::{Clock, HostNanos};
use isobath_v4l2::sys::{
    Buffer, BufferPlane, CAP_META, CAP_PLANES, CAP_STREAMING, CAP_VIDEO, CLOCK_MONOTONIC, Capability, Errno,
    FLAG_ERROR, Format, FourCc, FrameSize, Kind, PlaneFormat, Query, Ready, SysResult, V4l2Open, V4l2Sys,
};

/// Raised while the scripted kernel works: what it allocates is not the program's.
pub(crate) static WORKING: AtomicBool = AtomicBool::new(false);

struct Working(bool);

impl Working {
    fn begin() -> Self {
        Self(WORKING.swap(true, Ordering::SeqCst))
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        WORKING.store(self.0, Ordering::SeqCst);
    }
}

/// System calls between two steps of progress (a buffer taken, time passed) after which a program spins.
pub(crate) const PATIENCE: u32 = 64;

/// What the device does at its next frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Act {
    /// A whole frame.
    Whole,
    /// A frame flagged as broken, with this many bytes.
    Flagged(u32),
    /// A frame of this many bytes, not flagged.
    Short(u32),
    /// So many numbers are skipped: lost by the kernel.
    Skip(u32),
    /// So many frames are lost inside the device: only its own counter tells.
    Lose(u32),
    /// Nothing for a while, milliseconds.
    Silence(u64),
    /// All queued buffers come back flagged, empty, without number and time.
    Cancel,
    /// The number is set to this: the driver starts anew.
    Renumber(u32),
    /// The device's clock is set to this.
    Clock(u32),
    /// Metadata of the next frame: missing.
    NoMeta,
    /// Comes one frame late.
    LateMeta,
    /// Comes one frame early: before the image of the frame before.
    EarlyMeta,
    /// Unplugged.
    Unplug,
}

/// System calls that can be made to fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Call {
    Open,
    Capability,
    SetFormat,
    RequestBuffers,
    QueryBuffer,
    Map,
    Unmap,
    Queue,
    Dequeue,
    StreamOn,
    StreamOff,
    Poll,
    Extension,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Dequeued,
    Queued,
    Done,
}

#[derive(Debug, Clone)]
struct Slot {
    state: State,
    mapped: bool,
    content: Vec<u8>,
    info: Buffer,
}

#[derive(Debug, Clone, Default)]
struct Vb2 {
    slots: Vec<Slot>,
    queued: VecDeque<u32>,
    done: VecDeque<u32>,
    streaming: bool,
}

/// A node of the scripted device.
#[derive(Debug, Clone)]
pub(crate) struct NodeScript {
    pub(crate) kind: Kind,
    pub(crate) formats: Vec<FourCc>,
    pub(crate) sizes: Vec<(u32, u32)>,
    /// Bytes added to each row.
    pub(crate) padding: u32,
    /// Bytes before the image, for several planes.
    pub(crate) data_offset: u32,
    /// What `S_FMT` grants whatever is asked.
    pub(crate) grants: Option<(FourCc, u32, u32)>,
    format: Option<Format>,
    vb2: Vb2,
    sequence: u32,
    open: u32,
}

impl NodeScript {
    pub(crate) fn video(format: &[u8; 4], size: (u32, u32)) -> Self {
        Self {
            kind: Kind::Video,
            formats: vec![FourCc(*format)],
            sizes: vec![size],
            padding: 0,
            data_offset: 0,
            grants: None,
            format: None,
            vb2: Vb2::default(),
            sequence: 0,
            open: 0,
        }
    }

    pub(crate) fn meta(format: &[u8; 4]) -> Self {
        Self { kind: Kind::Meta, ..Self::video(format, (0, 0)) }
    }
}

/// Answers for the extension units: unit, selector, request, data.
pub(crate) type Extension = Box<dyn FnMut(u8, u8, Query, &mut [u8]) -> SysResult<()> + Send>;

/// Draws an image: kind, format, width, height, bytes a row, frame number.
pub(crate) type Draw = fn(FourCc, u32, u32, u32, u32) -> Vec<u8>;

pub(crate) struct World {
    pub(crate) now: u64,
    /// Microseconds of the device's clock ahead of the host's, wrapping.
    pub(crate) device_shift: u32,
    pub(crate) interval: u64,
    next_frame: u64,
    pub(crate) nodes: BTreeMap<PathBuf, NodeScript>,
    /// The node whose frames the script rules.
    pub(crate) main: PathBuf,
    pub(crate) script: VecDeque<Act>,
    /// What happens when the script is at its end: whole frames, or silence.
    pub(crate) endless: bool,
    faults: BTreeMap<Call, VecDeque<(u32, Errno)>>,
    calls: BTreeMap<Call, u32>,
    /// Poll says "ready" this many times though nothing is.
    pub(crate) false_ready: u32,
    pub(crate) unplugged: bool,
    pub(crate) draw: Draw,
    /// Frames of the device, whatever became of them.
    pub(crate) counter: u32,
    late: VecDeque<(u32, Vec<u8>)>,
    meta_plan: Option<Act>,
    pub(crate) extension: Option<Extension>,
    pub(crate) offences: Vec<String>,
    pub(crate) idle_calls: u32,
    pub(crate) most_idle_calls: u32,
    pub(crate) mappings: i64,
    pub(crate) whole: u64,
    pub(crate) stamps: bool,
    refused_to_stop: bool,
}

#[derive(Clone)]
pub(crate) struct Kernel(pub(crate) Arc<Mutex<World>>);

/// Little-endian steps: column, row and frame number mixed, never 0 nor 65535.
pub(crate) fn draw_z16(_: FourCc, width: u32, height: u32, stride: u32, frame: u32) -> Vec<u8> {
    let mut bytes = vec![0xee; (stride * height) as usize];
    for y in 0..height {
        for x in 0..width {
            let at = (y * stride + 2 * x) as usize;
            bytes[at..at + 2].copy_from_slice(&pixel(x, y, frame).to_le_bytes());
        }
    }
    bytes
}

pub(crate) fn pixel(x: u32, y: u32, frame: u32) -> u16 {
    ((x * 7 + y * 131 + frame % 65_000 * 1009) % 65_000 + 1) as u16
}

impl Kernel {
    pub(crate) fn new(main: &str, node: NodeScript) -> Self {
        let main = PathBuf::from(main);
        Self(Arc::new(Mutex::new(World {
            now: 1_000_000_000,
            device_shift: 0,
            interval: 33_333_333,
            next_frame: 0,
            nodes: BTreeMap::from([(main.clone(), node)]),
            main,
            script: VecDeque::new(),
            endless: true,
            faults: BTreeMap::new(),
            calls: BTreeMap::new(),
            false_ready: 0,
            unplugged: false,
            draw: draw_z16,
            counter: 0,
            late: VecDeque::new(),
            meta_plan: None,
            extension: None,
            offences: Vec::new(),
            idle_calls: 0,
            most_idle_calls: 0,
            mappings: 0,
            whole: 0,
            stamps: true,
            refused_to_stop: false,
        })))
    }

    pub(crate) fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap()
    }

    pub(crate) fn with(self, change: impl FnOnce(&mut World)) -> Self {
        change(&mut self.world());
        self
    }

    /// The call number `after` from now (0: the next) fails with `errno`.
    pub(crate) fn fail(&self, call: Call, after: u32, errno: Errno) {
        let mut world = self.world();
        let at = world.calls.get(&call).copied().unwrap_or(0) + after;
        world.faults.entry(call).or_default().push_back((at, errno));
    }

    /// What a test ends with: no offence, no mapping, no open stream, no spinning.
    pub(crate) fn check(&self) {
        let world = self.world();
        assert!(world.offences.is_empty(), "{:?}", world.offences);
        assert_eq!(world.mappings, 0, "mappings are left");
        assert!(world.most_idle_calls <= PATIENCE, "{} system calls without progress", world.most_idle_calls);
    }
}

impl Clock for Kernel {
    fn now(&self) -> HostNanos {
        HostNanos(self.world().now)
    }
}

pub(crate) struct FakeSys {
    kernel: Kernel,
    path: PathBuf,
    /// The memory that the program sees, so that slices of it can be given.
    maps: BTreeMap<u32, Vec<u8>>,
    owned: BTreeMap<u32, bool>,
}

impl std::fmt::Debug for FakeSys {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FakeSys").field("path", &self.path).finish_non_exhaustive()
    }
}

impl V4l2Open for Kernel {
    type Sys = FakeSys;

    fn open(&self, path: &Path) -> SysResult<FakeSys> {
        let mut world = self.world();
        world.enter(Call::Open)?;
        let node = world.nodes.get_mut(path).ok_or(Errno::ENOENT)?;
        node.open += 1;
        Ok(FakeSys { kernel: self.clone(), path: path.to_owned(), maps: BTreeMap::new(), owned: BTreeMap::new() })
    }
}

impl Drop for FakeSys {
    fn drop(&mut self) {
        let mut world = self.kernel.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        world.mappings -= self.maps.len() as i64;
        if let Some(node) = world.nodes.get_mut(&self.path) {
            node.open -= 1;
            if node.open == 0 {
                node.vb2 = Vb2::default();
            }
        }
    }
}

impl World {
    /// Counts a call and fails it if it is planned to.
    fn enter(&mut self, call: Call) -> SysResult<()> {
        // Setting up takes as many calls as there are buffers.
        self.idle_calls = if matches!(call, Call::Map | Call::Unmap) { 0 } else { self.idle_calls + 1 };
        self.most_idle_calls = self.most_idle_calls.max(self.idle_calls);
        assert!(self.idle_calls <= 20 * PATIENCE, "the program spins: {call:?} and others without progress");
        let n = self.calls.entry(call).or_default();
        let this = *n;
        *n += 1;
        if let Some(queue) = self.faults.get_mut(&call)
            && let Some(at) = queue.iter().position(|(at, _)| *at == this)
        {
            self.refused_to_stop |= call == Call::StreamOff;
            return Err(queue.remove(at).unwrap().1);
        }
        Ok(())
    }

    fn offence(&mut self, what: String) {
        self.offences.push(what);
    }

    fn pass(&mut self, time: u64) {
        if time > 0 {
            self.idle_calls = 0;
        }
        self.now += time;
        self.run();
    }

    fn device_clock(&self) -> u32 {
        ((self.now / 1000) as u32).wrapping_add(self.device_shift)
    }

    /// Lets the device do what it does until now.
    fn run(&mut self) {
        while self.next_frame <= self.now && !self.unplugged {
            let streaming = self.nodes.get(&self.main).is_some_and(|n| n.vb2.streaming);
            if !streaming {
                self.next_frame = self.now + self.interval;
                return;
            }
            let act = match self.script.pop_front() {
                Some(act) => act,
                None if self.endless => Act::Whole,
                None => return,
            };
            match act {
                Act::Silence(ms) => self.next_frame += ms * 1_000_000,
                Act::Skip(n) => {
                    let main = self.main.clone();
                    let node = self.nodes.get_mut(&main).unwrap();
                    node.sequence = node.sequence.wrapping_add(n);
                    self.counter = self.counter.wrapping_add(n);
                }
                Act::Lose(n) => self.counter = self.counter.wrapping_add(n),
                Act::Renumber(n) => {
                    let main = self.main.clone();
                    self.nodes.get_mut(&main).unwrap().sequence = n;
                }
                Act::Clock(us) => self.device_shift = us.wrapping_sub((self.now / 1000) as u32),
                Act::NoMeta | Act::LateMeta | Act::EarlyMeta => self.meta_plan = Some(act),
                Act::Unplug => {
                    self.unplugged = true;
                    for node in self.nodes.values_mut() {
                        node.vb2.streaming = false;
                    }
                }
                Act::Cancel => {
                    let main = self.main.clone();
                    let node = self.nodes.get_mut(&main).unwrap();
                    while let Some(index) = node.vb2.queued.pop_front() {
                        let slot = &mut node.vb2.slots[index as usize];
                        slot.state = State::Done;
                        slot.info = Buffer { index, flags: FLAG_ERROR, ..Buffer::default() };
                        node.vb2.done.push_back(index);
                    }
                    self.next_frame += self.interval;
                }
                Act::Whole => self.frame(None, false),
                Act::Flagged(used) => self.frame(Some(used), true),
                Act::Short(used) => self.frame(Some(used), false),
            }
        }
    }

    /// One frame of the device: on every streaming node.
    fn frame(&mut self, used: Option<u32>, flagged: bool) {
        let time = self.next_frame.max(1_000_000);
        self.next_frame += self.interval;
        let (draw, counter, main) = (self.draw, self.counter, self.main.clone());
        let pts = ((time / 1000) as u32).wrapping_add(self.device_shift);
        self.counter = self.counter.wrapping_add(1);
        let stamp = |buffer: &mut Buffer, stamps: bool| {
            if stamps {
                buffer.flags |= CLOCK_MONOTONIC;
                (buffer.seconds, buffer.micros) = ((time / 1_000_000_000) as i64, (time % 1_000_000_000 / 1000) as i64);
            }
        };
        let plan = self.meta_plan.take();
        let number = self.nodes[&main].sequence;
        let stamps = self.stamps;
        let mut whole = false;
        let mut metadata: Vec<(u32, Vec<u8>)> = Vec::new();
        let bytes = meta_bytes(time, pts, counter);
        match plan {
            Some(Act::NoMeta) => {}
            Some(Act::LateMeta) => self.late.push_back((number, bytes)),
            Some(Act::EarlyMeta) => {
                metadata.push((
                    number.wrapping_add(1),
                    meta_bytes(time + self.interval, pts.wrapping_add((self.interval / 1000) as u32), counter + 1),
                ));
                metadata.push((number, bytes));
            }
            _ => {
                metadata.extend(self.late.pop_front());
                metadata.push((number, bytes));
            }
        }
        for (path, node) in &mut self.nodes {
            if !node.vb2.streaming {
                continue;
            }
            if node.kind == Kind::Meta {
                // Of bare headers the kernel copies the standard part, whatever their length byte says.
                let bare = node.format.is_some_and(|f| f.fourcc == FourCc(*b"UVCH"));
                for (sequence, bytes) in &metadata {
                    let bytes = if bare { &bytes[..22] } else { &bytes[..] };
                    if let Some(index) = node.vb2.queued.pop_front() {
                        let slot = &mut node.vb2.slots[index as usize];
                        slot.state = State::Done;
                        slot.content[..bytes.len()].copy_from_slice(bytes);
                        slot.info = Buffer { index, sequence: *sequence, ..Buffer::default() };
                        slot.info.planes[0].used = bytes.len() as u32;
                        stamp(&mut slot.info, true);
                        node.vb2.done.push_back(index);
                    }
                }
                continue;
            }
            let sequence = node.sequence;
            node.sequence = node.sequence.wrapping_add(1);
            let Some(format) = node.format else { continue };
            let Some(index) = node.vb2.queued.pop_front() else { continue };
            let slot = &mut node.vb2.slots[index as usize];
            let plane = format.planes[0];
            let image = draw(format.fourcc, format.width, format.height, plane.bytes_per_line, sequence);
            let offset = node.data_offset as usize;
            let is_main = *path == main;
            let full = image.len() as u32;
            let take = if is_main { used.unwrap_or(full).min(full) } else { full };
            slot.content.fill(0xdd);
            slot.content[offset..offset + take as usize].copy_from_slice(&image[..take as usize]);
            slot.state = State::Done;
            slot.info = Buffer { index, sequence, ..Buffer::default() };
            slot.info.planes[0] = BufferPlane {
                length: slot.content.len() as u32,
                offset: 0,
                used: take + node.data_offset,
                data_offset: node.data_offset,
            };
            if is_main && flagged {
                slot.info.flags |= FLAG_ERROR;
            }
            stamp(&mut slot.info, stamps);
            node.vb2.done.push_back(index);
            whole |= is_main && !flagged && take == full;
        }
        self.whole += u64::from(whole);
    }
}

/// A metadata buffer of a D400: UVC header with PTS, and the block of times.
pub(crate) fn meta_bytes(host: u64, pts: u32, counter: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.extend(host.to_le_bytes());
    bytes.extend(0_u16.to_le_bytes());
    bytes.extend([52, 0x8c]);
    bytes.extend(pts.to_le_bytes());
    bytes.extend([0; 6]);
    // Capture timing: counter and exposure hold; 8 ms of exposure.
    bytes.extend(0x8000_0001_u32.to_le_bytes());
    bytes.extend(40_u32.to_le_bytes());
    for word in [1, 0b1001, counter, 0, 0, 8_000, 0, 0] {
        bytes.extend(u32::to_le_bytes(word));
    }
    bytes
}

impl FakeSys {
    fn call<T>(
        &mut self,
        call: Call,
        kind: Kind,
        work: impl FnOnce(&mut World, &mut NodeScript) -> SysResult<T>,
    ) -> SysResult<T> {
        let mut world = self.kernel.world();
        world.enter(call)?;
        if world.unplugged && !matches!(call, Call::Unmap) {
            return Err(Errno::ENODEV);
        }
        world.run();
        if world.unplugged && !matches!(call, Call::Unmap) {
            return Err(Errno::ENODEV);
        }
        let mut node = world.nodes.remove(&self.path).unwrap();
        let result = if node.kind == kind { work(&mut world, &mut node) } else { Err(Errno::EINVAL) };
        world.nodes.insert(self.path.clone(), node);
        result
    }

    fn kind(&self) -> Kind {
        self.kernel.world().nodes[&self.path].kind
    }
}

impl V4l2Sys for FakeSys {
    fn capability(&mut self) -> SysResult<Capability> {
        let _working = Working::begin();
        let kind = self.kind();
        self.call(Call::Capability, kind, |_, node| {
            let cap = match node.kind {
                Kind::Video => CAP_VIDEO,
                Kind::Planes => CAP_PLANES,
                Kind::Meta => CAP_META,
            };
            Ok(Capability {
                driver: "scripted".into(),
                card: "Scripted camera".into(),
                bus: "usb-0".into(),
                kernel: (6, 14, 0),
                caps: cap | CAP_STREAMING,
            })
        })
    }

    fn format_at(&mut self, kind: Kind, index: u32) -> SysResult<FourCc> {
        let _working = Working::begin();
        let world = self.kernel.world();
        let node = &world.nodes[&self.path];
        node.formats.get(index as usize).filter(|_| node.kind == kind).copied().ok_or(Errno::EINVAL)
    }

    fn size_at(&mut self, fourcc: FourCc, index: u32) -> SysResult<FrameSize> {
        let _working = Working::begin();
        let world = self.kernel.world();
        let node = &world.nodes[&self.path];
        let size = node.sizes.get(index as usize).filter(|_| node.formats.contains(&fourcc)).ok_or(Errno::EINVAL)?;
        Ok(FrameSize::Discrete(size.0, size.1))
    }

    fn format(&mut self, _: Kind) -> SysResult<Format> {
        let _working = Working::begin();
        self.kernel.world().nodes[&self.path].format.ok_or(Errno::EINVAL)
    }

    fn set_format(&mut self, kind: Kind, asked: &Format) -> SysResult<Format> {
        let _working = Working::begin();
        self.call(Call::SetFormat, kind, |world, node| {
            if !node.vb2.slots.is_empty() {
                world.offence("S_FMT while there are buffers".into());
                return Err(Errno::EBUSY);
            }
            let mut format = *asked;
            if let Some((fourcc, width, height)) = node.grants {
                (format.fourcc, format.width, format.height) = (fourcc, width, height);
            } else if !node.formats.contains(&asked.fourcc) {
                format.fourcc = node.formats[0];
            }
            let row = match &format.fourcc.0 {
                b"Y10B" => (format.width * 10).div_ceil(8),
                b"INZI" => format.width * 4,
                _ => format.width * 2,
            };
            let stride = row + node.padding;
            format.count = 1;
            format.planes[0] = match kind {
                Kind::Meta => PlaneFormat { bytes_per_line: 0, size: 1024 },
                _ => PlaneFormat { bytes_per_line: stride, size: stride * format.height },
            };
            node.format = Some(format);
            Ok(format)
        })
    }

    fn set_interval(&mut self, _: Kind, interval: (u32, u32)) -> SysResult<(u32, u32)> {
        let _working = Working::begin();
        Ok(interval)
    }

    fn request_buffers(&mut self, kind: Kind, count: u32) -> SysResult<u32> {
        let _working = Working::begin();
        self.call(Call::RequestBuffers, kind, |world, node| {
            if node.vb2.slots.iter().any(|s| s.mapped) {
                world.offence("REQBUFS while buffers are mapped".into());
                return Err(Errno::EBUSY);
            }
            if node.vb2.streaming {
                // A program whose STREAMOFF was refused can't know better.
                if !world.refused_to_stop {
                    world.offence("REQBUFS while streaming".into());
                }
                return Err(Errno::EBUSY);
            }
            let size = node.format.ok_or(Errno::EINVAL)?.planes[0].size + node.data_offset;
            // Memory comes in pages: a mapping is longer than an image.
            let size = size.next_multiple_of(4096);
            let slot = Slot {
                state: State::Dequeued,
                mapped: false,
                content: vec![0xdd; size as usize],
                info: Buffer::default(),
            };
            node.vb2 = Vb2 { slots: vec![slot; count as usize], ..Vb2::default() };
            Ok(count)
        })
    }

    fn query_buffer(&mut self, kind: Kind, index: u32, _: usize) -> SysResult<Buffer> {
        let _working = Working::begin();
        self.call(Call::QueryBuffer, kind, |_, node| {
            let slot = node.vb2.slots.get(index as usize).ok_or(Errno::EINVAL)?;
            let mut buffer = Buffer { index, ..Buffer::default() };
            buffer.planes[0] =
                BufferPlane { length: slot.content.len() as u32, offset: index * 0x10_0000, used: 0, data_offset: 0 };
            Ok(buffer)
        })
    }

    fn map(&mut self, kind: Kind, index: u32, plane: usize, offset: u32, length: u32) -> SysResult<()> {
        let _working = Working::begin();
        let path = self.path.clone();
        self.call(Call::Map, kind, |world, node| {
            let slot = node.vb2.slots.get_mut(index as usize).filter(|_| plane == 0 && offset == index * 0x10_0000);
            let slot = slot.ok_or(Errno::EINVAL)?;
            if slot.mapped || length as usize != slot.content.len() {
                world.offence(format!("{path:?}: mapped twice, or with a wrong length"));
                return Err(Errno::EINVAL);
            }
            slot.mapped = true;
            world.mappings += 1;
            Ok(())
        })?;
        self.maps.insert(index, vec![0xdd; length as usize]);
        self.owned.insert(index, true);
        Ok(())
    }

    fn unmap(&mut self, kind: Kind, index: u32, _: usize) -> SysResult<()> {
        let _working = Working::begin();
        if !self.maps.contains_key(&index) {
            self.kernel.world().offence("munmap of what is not mapped".into());
            return Err(Errno::EINVAL);
        }
        self.call(Call::Unmap, kind, |world, node| {
            if let Some(slot) = node.vb2.slots.get_mut(index as usize) {
                slot.mapped = false;
            }
            world.mappings -= 1;
            Ok(())
        })?;
        self.maps.remove(&index);
        Ok(())
    }

    fn bytes(&self, _: Kind, index: u32, plane: usize) -> &[u8] {
        match (self.maps.get(&index), self.owned.get(&index)) {
            (Some(bytes), Some(true)) if plane == 0 => bytes,
            _ => &[],
        }
    }

    fn queue(&mut self, kind: Kind, index: u32, _: usize) -> SysResult<()> {
        let _working = Working::begin();
        self.call(Call::Queue, kind, |world, node| {
            let Some(slot) = node.vb2.slots.get_mut(index as usize) else {
                world.offence(format!("QBUF of {index}, which does not exist"));
                return Err(Errno::EINVAL);
            };
            if slot.state != State::Dequeued {
                let state = slot.state;
                world.offence(format!("QBUF of {index}, which is {state:?}"));
                return Err(Errno::EINVAL);
            }
            slot.state = State::Queued;
            node.vb2.queued.push_back(index);
            Ok(())
        })?;
        self.owned.insert(index, false);
        Ok(())
    }

    fn dequeue(&mut self, kind: Kind, _: usize) -> SysResult<Buffer> {
        let _working = Working::begin();
        let (buffer, content) = self.call(Call::Dequeue, kind, |world, node| {
            if !node.vb2.streaming {
                return Err(Errno::EINVAL);
            }
            let index = node.vb2.done.pop_front().ok_or(Errno::EAGAIN)?;
            let slot = &mut node.vb2.slots[index as usize];
            slot.state = State::Dequeued;
            world.idle_calls = 0;
            // Lent, not copied: the counting allocator of a test must see the program alone.
            Ok((slot.info, std::mem::take(&mut slot.content)))
        })?;
        let mut content = content;
        if let Some(map) = self.maps.get_mut(&buffer.index) {
            map.copy_from_slice(&content);
        }
        let mut world = self.kernel.world();
        let node = world.nodes.get_mut(&self.path).unwrap();
        std::mem::swap(&mut node.vb2.slots[buffer.index as usize].content, &mut content);
        self.owned.insert(buffer.index, true);
        Ok(buffer)
    }

    fn stream(&mut self, kind: Kind, on: bool) -> SysResult<()> {
        let _working = Working::begin();
        let call = if on { Call::StreamOn } else { Call::StreamOff };
        self.call(call, kind, |world, node| {
            node.vb2.streaming = on;
            if on {
                node.sequence = 0;
                world.next_frame = world.next_frame.max(world.now + world.interval);
            } else {
                node.vb2.queued.clear();
                node.vb2.done.clear();
                node.vb2.slots.iter_mut().for_each(|s| s.state = State::Dequeued);
            }
            Ok(())
        })?;
        if !on {
            self.owned.values_mut().for_each(|o| *o = true);
        }
        Ok(())
    }

    fn poll(&mut self, timeout: Option<Duration>) -> SysResult<Ready> {
        let _working = Working::begin();
        let mut world = self.kernel.world();
        world.enter(Call::Poll)?;
        world.run();
        let deadline = timeout.map(|t| world.now + t.as_nanos() as u64);
        loop {
            if world.unplugged {
                return Ok(Ready { readable: false, error: true });
            }
            if world.false_ready > 0 {
                world.false_ready -= 1;
                return Ok(Ready { readable: true, error: false });
            }
            let node = &world.nodes[&self.path];
            if !node.vb2.done.is_empty() {
                return Ok(Ready { readable: true, error: false });
            }
            if !node.vb2.streaming || node.vb2.queued.is_empty() {
                return Ok(Ready { readable: false, error: true });
            }
            let stuck = world.script.is_empty() && !world.endless;
            let next = if stuck { u64::MAX } else { world.next_frame };
            match deadline {
                Some(d) if d <= next || d <= world.now => {
                    let left = d.saturating_sub(world.now);
                    world.pass(left);
                    let node = &world.nodes[&self.path];
                    return Ok(Ready { readable: !node.vb2.done.is_empty(), error: world.unplugged });
                }
                None if stuck => panic!("waiting for ever for a frame that never comes"),
                _ => {
                    let left = next.saturating_sub(world.now).max(1);
                    world.pass(left);
                }
            }
        }
    }

    fn extension(&mut self, unit: u8, selector: u8, query: Query, data: &mut [u8]) -> SysResult<()> {
        let _working = Working::begin();
        let mut world = self.kernel.world();
        world.enter(Call::Extension)?;
        world.idle_calls = 0;
        match &mut world.extension {
            Some(answer) => answer(unit, selector, query, data),
            None => Err(Errno::ENOTTY),
        }
    }

    fn pause(&mut self, time: Duration) {
        let _working = Working::begin();
        self.kernel.world().pass(time.as_nanos() as u64);
    }
}
