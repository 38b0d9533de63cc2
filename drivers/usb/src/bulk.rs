//! Headset firmware that speaks [`isobath::wire::bulk`] on a bulk endpoint, as a source of depth and of inertial readings.
//!
//! The device has an interface of class [`CLASS`] with a bulk endpoint towards the host, on which it sends messages; vendor and product are its
//! maker's. One [`Bulk`] is a [`DepthSource`] and an [`ImuSource`] at once, over one pipe: asking for a frame keeps the readings that come meanwhile
//! (4096 of them), asking for readings keeps the newest frame. Times of both are the host's, mapped from the device's clock by [`DeviceClock`].
//!
//! What went wrong shows in three places: a frame whose message was damaged or lost is a gap of the sequence and counted
//! ([`StreamStats::dropped_by_device`]); one that came whole and holds no image is an error and counted ([`StreamStats::corrupt`]); an endpoint that stalled is
//! cleared, and the next answer says so. A device that fails again and again is asked after longer and longer pauses.

use std::collections::VecDeque;
use std::fmt;
use std::time::Duration;

use isobath::ground::image::ImageViewMut;
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::{Camera, Distortion, Intrinsics};
use isobath::sensing::imu::ImuSample;
use isobath::wire::bulk::{Content, Encoding, Found, Header, Hello, Kind, Message, OVERHEAD, depth_most_bytes, find};
use isobath_source::stats::{SequenceGaps, Step};
use isobath_source::{
    Clock, ClockEvent, Deadline, DepthSource, DeviceClock, DeviceTicks, Gap, GapCause, ImuInfo, ImuOutcome, ImuSource,
    Outcome, OwnedFrame, SourceError, SourceInfo, StreamStats, SystemClock,
};

use crate::link::{Link, Options, Wanted};
use crate::sys::{UsbDevice, UsbError, UsbSys};

/// Class, subclass and protocol of the interface: the vendor's own, "i", "B".
pub const CLASS: [u8; 3] = [0xff, b'i', b'B'];
/// Bytes asked for at once: a multiple of every packet size, so that no packet is cut.
const CHUNK: usize = 64 * 1024;
/// Longest message before the hello says how large frames are: a key frame.
const SMALLEST: usize = 256 * 1024;
/// A transfer waits no longer than this, so that a deadline that is far away does not hide an unplugged device.
const SLICE: Duration = Duration::from_millis(500);
/// Readings kept for who asks for frames meanwhile.
const READINGS: usize = 4096;
/// More pixels than any frame has: a hello that says so asks for memory that nobody has.
const MOST_PIXELS: usize = 1 << 24;
/// How long opening waits for the device's hello.
const HELLO: Duration = Duration::from_secs(4);
/// After so many failures in a row, without a byte between them, they are the caller's matter.
const PATIENCE: u32 = 4;

/// Before the hello.
const NO_CAMERA: Intrinsics = match Intrinsics::new(1.0, 1.0, 0.0, 0.0) {
    Ok(k) => k,
    Err(_) => panic!("evaluated by the compiler: a focal length of one pixel is legal"),
};

/// The device of the protocol with a serial number, or the first one.
#[must_use]
pub fn wanted(serial: Option<&str>) -> Wanted {
    Wanted { vendor: None, products: Vec::new(), class: Some(CLASS), serial: serial.map(str::to_owned) }
}

/// What is done with a key frame.
type KeyFrames = Box<dyn FnMut(&[u8]) + Send>;

/// What one step brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Event {
    /// Something that needs no answer.
    Progress,
    /// Nothing in the time given.
    Nothing,
}

/// A device of the protocol.
pub struct Bulk<S: UsbSys> {
    link: Link<S>,
    endpoint: u8,
    clock: Box<dyn Clock + Send>,
    hello: Option<Hello>,
    info: SourceInfo,
    imu_info: ImuInfo,
    /// Bytes not yet made into messages: the first `filled`.
    buffer: Vec<u8>,
    filled: usize,
    most: usize,
    /// The body of the newest frame that nobody took yet, its header, and when it came.
    frame: Vec<u8>,
    frame_header: Option<(Header, Timestamp)>,
    readings: VecDeque<ImuSample>,
    frames: SequenceGaps,
    messages: SequenceGaps,
    device_clock: DeviceClock,
    /// From the device's times to its clock's ticks, which go on when the device starts anew.
    shift: Option<u64>,
    stats: StreamStats,
    imu_lost: u64,
    gap: Option<Gap>,
    imu_gap: Option<Gap>,
    failures: u32,
    /// Whether the caller who waits now has had a transfer: a deadline that has passed already allows one.
    asked: bool,
    /// The size that the last hello said, when it was absurd.
    absurd: Option<(u16, u16)>,
    key_frames: Option<KeyFrames>,
}

impl<S: UsbSys> fmt::Debug for Bulk<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bulk").field("link", &self.link).field("hello", &self.hello).finish_non_exhaustive()
    }
}

fn device_clock() -> DeviceClock {
    // 64 bits of nanoseconds.
    DeviceClock::new(64, 1e9).expect("a rate of 1e9 Hz is within what the clock takes")
}

impl<S: UsbSys> Bulk<S> {
    /// Opens a device and waits for its hello, 4 s at most.
    ///
    /// # Errors
    /// [`SourceError`]: none is there, it may not be opened, or it says nothing.
    pub fn open(sys: S, wanted: Wanted, options: Options) -> Result<Self, SourceError> {
        Self::open_at(sys, wanted, options, Box::new(SystemClock))
    }

    /// As [`Self::open`], by another clock.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_at(
        sys: S,
        wanted: Wanted,
        options: Options,
        clock: Box<dyn Clock + Send>,
    ) -> Result<Self, SourceError> {
        let link = Link::open(sys, wanted, options)?;
        let endpoint = endpoint(&link)?;
        let path = link.path().clone();
        let mut bulk = Self {
            endpoint,
            clock,
            hello: None,
            info: SourceInfo {
                kind: "isobath bulk device".to_owned(),
                path: path.clone(),
                size: None,
                intrinsics: NO_CAMERA,
                up: None,
                has_colour: false,
                has_poses: false,
                notes: Vec::new(),
            },
            imu_info: ImuInfo { kind: "isobath bulk device".to_owned(), path, rate_hz: 0.0, notes: Vec::new() },
            buffer: vec![0; SMALLEST + CHUNK],
            filled: 0,
            most: SMALLEST,
            frame: Vec::new(),
            frame_header: None,
            readings: VecDeque::with_capacity(READINGS),
            frames: SequenceGaps::default(),
            messages: SequenceGaps::default(),
            device_clock: device_clock(),
            shift: None,
            stats: StreamStats::default(),
            imu_lost: 0,
            gap: None,
            imu_gap: None,
            failures: 0,
            asked: false,
            absurd: None,
            key_frames: None,
            link,
        };
        let deadline = Deadline::after(&*bulk.clock, HELLO);
        while bulk.hello.is_none() {
            let nothing = bulk.step(deadline)? == Event::Nothing;
            if let Some((w, h)) = bulk.absurd {
                return Err(SourceError::Unsupported {
                    path: bulk.link.path().clone(),
                    what: format!("the device says its frames have {w} x {h} pixels"),
                    hint: format!("{MOST_PIXELS} are taken at most; its firmware may be broken"),
                });
            }
            if nothing {
                return Err(SourceError::MissingCalibration {
                    path: bulk.link.path().clone(),
                    needed: vec!["size", "unit", "intrinsics"],
                    hint: format!(
                        "the device sent no hello for {} s; its firmware must send one every second (isobath::wire::bulk)",
                        HELLO.as_secs()
                    ),
                });
            }
        }
        // What happened while it was opened is nobody's.
        (bulk.gap, bulk.imu_gap) = (None, None);
        Ok(bulk)
    }

    /// What the device said of itself.
    #[must_use]
    pub const fn hello(&self) -> Option<&Hello> {
        self.hello.as_ref()
    }

    /// Hands every key frame to `sink`, as it comes: a whole message of [`isobath::wire::keyframe`].
    pub fn on_key_frame(&mut self, sink: impl FnMut(&[u8]) + Send + 'static) {
        self.key_frames = Some(Box::new(sink));
    }

    /// Readings that did not come or found no room.
    #[must_use]
    pub const fn readings_lost(&self) -> u64 {
        self.imu_lost
    }

    /// Makes the next message there is, or reads once.
    fn step(&mut self, deadline: Deadline) -> Result<Event, SourceError> {
        // The buffer is lent to the message while the rest of the source changes.
        let buffer = std::mem::take(&mut self.buffer);
        let used = match find(buffer.get(..self.filled).unwrap_or_default(), self.most) {
            Found::Message { message, used, .. } => {
                self.take(&message);
                used
            }
            Found::Damaged { used, .. } => used,
            Found::More { garbage, .. } => garbage,
        };
        let more = used > 0;
        self.buffer = buffer;
        self.buffer.copy_within(used..self.filled, 0);
        self.filled -= used;
        // The longest message, which a hello may have changed, and what is read at once.
        let room = self.most + CHUNK;
        if self.buffer.len() < room {
            self.buffer.resize(room, 0);
        }
        if more { Ok(Event::Progress) } else { self.read(deadline) }
    }

    fn read(&mut self, deadline: Deadline) -> Result<Event, SourceError> {
        if !self.link.is_open() {
            return self.come_back(deadline);
        }
        // A device that talks without end and says nothing must not hold the caller either.
        if self.asked && deadline.has_passed(self.clock.now()) {
            return Ok(Event::Nothing);
        }
        self.asked = true;
        let left = deadline.remaining(self.clock.now()).unwrap_or(SLICE);
        // Zero would be for ever.
        let timeout = left.min(SLICE).max(Duration::from_millis(1));
        let place = self.buffer.get_mut(self.filled..).unwrap_or_default();
        let place = place.get_mut(..CHUNK).unwrap_or_default();
        let (endpoint, device) = (self.endpoint, self.link.device());
        let error = match device.and_then(|device| device.bulk_in(endpoint, place, timeout)) {
            Ok(bytes) if bytes > 0 => {
                self.filled += bytes.min(CHUNK);
                self.failures = 0;
                return Ok(Event::Progress);
            }
            // An empty packet ends a transfer and says nothing.
            Ok(_) | Err(UsbError::Timeout) => return Ok(Event::Progress),
            Err(e) => e,
        };
        // Whatever was begun is cut.
        self.filled = 0;
        let (endpoint, device) = (self.endpoint, self.link.device());
        let cleared =
            if error == UsbError::Gone { Err(error) } else { device.and_then(|device| device.clear_halt(endpoint)) };
        if cleared == Err(UsbError::Gone) {
            self.link.lost()?;
            return self.come_back(deadline);
        }
        self.failures += 1;
        self.stats.recoveries += 1;
        self.link.wait(Duration::from_millis(5 << self.failures.min(6)), deadline, &*self.clock);
        if self.failures > PATIENCE || cleared.is_err() {
            return Err(self.link.error("reading its bulk endpoint", error));
        }
        self.note(GapCause::Link);
        Ok(Event::Progress)
    }

    /// Looks for a device that is gone.
    fn come_back(&mut self, deadline: Deadline) -> Result<Event, SourceError> {
        if !self.link.reopen(deadline, &*self.clock)? {
            return Ok(Event::Nothing);
        }
        self.endpoint = endpoint(&self.link)?;
        self.info.path.clone_from(self.link.path());
        (self.filled, self.failures) = (0, 0);
        self.frames.reset();
        self.messages.reset();
        (self.device_clock, self.shift) = (device_clock(), None);
        // What came before it went has times of another life.
        if self.frame_header.take().is_some() {
            self.stats.dropped_by_policy += 1;
        }
        self.imu_lost += self.readings.len() as u64;
        self.readings.clear();
        self.stats.recoveries += 1;
        self.note(GapCause::Replugged);
        Ok(Event::Progress)
    }

    /// Both who ask for frames and who ask for readings are to be told.
    fn note(&mut self, cause: GapCause) {
        let gap = Some(Gap { cause, lost: None });
        (self.gap, self.imu_gap) = (gap, gap);
    }

    /// The host's time of a device's. One stream leads, the inertial one if there is one: frames lie behind it by their exposure and all that the
    /// device does with them, which would look like a clock set back.
    fn host_time(&mut self, time: Timestamp, kind: Kind) -> Timestamp {
        let raw = time.as_nanos().cast_unsigned();
        let follows = kind == Kind::Depth && self.hello.is_some_and(|hello| hello.imu_millihertz > 0);
        let ticks = match self.shift.filter(|_| follows) {
            Some(shift) => DeviceTicks(raw.wrapping_add(shift)),
            None => {
                let (ticks, event) = self.device_clock.observe(raw, self.clock.now());
                if event == ClockEvent::Jump {
                    self.note(GapCause::Reset);
                }
                self.shift = Some(ticks.0.wrapping_sub(raw));
                ticks
            }
        };
        self.device_clock.to_host(ticks).map_or(time, |host| host.timestamp())
    }

    fn take(&mut self, message: &Message<'_>) {
        let header = message.header;
        if self.hello.is_none() && header.kind != Kind::Hello {
            return;
        }
        match header.kind {
            Kind::Hello => {
                if let Ok(Content::Hello(hello)) = message.content() {
                    self.meet(&hello);
                }
            }
            Kind::Depth => self.take_frame(header, message.body),
            Kind::Imu => self.take_readings(message),
            Kind::KeyFrame => {
                if let Some(sink) = &mut self.key_frames {
                    sink(message.body);
                }
            }
            _ => {}
        }
    }

    fn take_frame(&mut self, header: Header, body: &[u8]) {
        match self.frames.next(header.sequence) {
            Step::On { lost } => self.stats.dropped_by_device += lost,
            Step::Back => {
                self.frames = SequenceGaps::after(header.sequence);
                self.note(GapCause::Reset);
            }
        }
        let time = self.host_time(header.time, Kind::Depth);
        if self.frame_header.is_some() {
            self.stats.dropped_by_policy += 1;
        }
        self.frame.clear();
        self.frame.extend_from_slice(body);
        self.frame_header = Some((header, time));
    }

    fn take_readings(&mut self, message: &Message<'_>) {
        let Ok(Content::Imu(imu)) = message.content() else {
            self.imu_lost += 1;
            return;
        };
        match self.messages.next(message.header.sequence) {
            // Messages are numbered, not readings: as many as in this one, each.
            Step::On { lost } => self.imu_lost += lost * imu.len() as u64,
            Step::Back => {
                self.messages = SequenceGaps::after(message.header.sequence);
                self.imu_gap = Some(Gap { cause: GapCause::Reset, lost: None });
            }
        }
        let Some(last) = imu.iter().last() else { return };
        let offset = self.hello.map_or(0, |hello| hello.imu_offset);
        let span = last.time.as_nanos() - message.header.time.as_nanos();
        // The last reading is the one just taken: the others lie before it.
        let end = self.host_time(last.time, Kind::Imu).saturating_add_nanos(offset);
        for reading in imu.iter() {
            if self.readings.len() == READINGS {
                self.readings.pop_front();
                self.imu_lost += 1;
            }
            let behind = reading.time.as_nanos() - message.header.time.as_nanos() - span;
            self.readings.push_back(ImuSample { time: end.saturating_add_nanos(behind), ..reading });
        }
    }

    /// A hello: the first, or one that says something new.
    fn meet(&mut self, hello: &Hello) {
        if self.hello.as_ref() == Some(hello) {
            return;
        }
        let size = hello.depth.map(|(w, h, ..)| (w, h));
        self.absurd = size.filter(|(w, h)| usize::from(*w) * usize::from(*h) > MOST_PIXELS);
        if self.absurd.is_some() {
            return;
        }
        self.hello = Some(*hello);
        self.most = SMALLEST;
        let serial = hello.serial.as_str();
        self.info.kind = format!("isobath bulk device {serial}, firmware {:#x}", hello.firmware);
        self.info.size = None;
        self.info.notes.clear();
        if let Some((w, h, _, Camera { intrinsics, distortion })) = &hello.depth {
            let pixels = usize::from(*w) * usize::from(*h);
            let longest = depth_most_bytes(pixels, Encoding::Rvl).max(depth_most_bytes(pixels, Encoding::Raw));
            self.most = longest.max(SMALLEST);
            self.frame.reserve(self.most - OVERHEAD);
            self.info.size = Some((usize::from(*w), usize::from(*h)));
            self.info.intrinsics = *intrinsics;
            if *distortion != Distortion::None {
                self.info.notes.push("each frame's lens is straightened".to_owned());
            }
        } else {
            self.info.notes.push("the device has no depth camera".to_owned());
        }
        self.imu_info.rate_hz = hello.imu_millihertz as f32 / 1000.0;
        self.imu_info.kind.clone_from(&self.info.kind);
        self.imu_info.path.clone_from(self.link.path());
        self.imu_info.notes.clear();
        if hello.imu_millihertz == 0 {
            self.imu_info.notes.push("the device has no inertial sensor".to_owned());
        }
    }

    /// The frame that waits, into the caller's.
    fn give(&mut self, header: Header, time: Timestamp, frame: &mut OwnedFrame) -> Result<(), SourceError> {
        let message = Message { header, body: &self.frame };
        let camera = self.hello.and_then(|hello| hello.depth);
        let wanted = camera.map_or(0, |(w, h, ..)| u64::from(w) * u64::from(h));
        let corrupt = SourceError::Corrupt { what: "a depth frame", got: self.frame.len() as u64, want: wanted };
        let (Ok(Content::Depth(depth)), Some((w, h, _, camera))) = (message.content(), camera) else {
            return Err(corrupt);
        };
        if depth.size != (usize::from(w), usize::from(h)) {
            return Err(corrupt);
        }
        frame.clear();
        let pixels = frame.depth_u16_mut(depth.size.0, depth.size.1);
        let view = ImageViewMut::new(pixels, depth.size.0, depth.size.1);
        if !view.is_ok_and(|mut view| depth.pixels_into(&mut view).is_ok()) {
            return Err(corrupt);
        }
        (frame.unit, frame.intrinsics) = (depth.unit, camera.intrinsics);
        (frame.time, frame.sequence) = (time, header.sequence.into());
        frame.straighten(&camera);
        Ok(())
    }
}

fn endpoint<S: UsbSys>(link: &Link<S>) -> Result<u8, SourceError> {
    link.interface().bulk_in.ok_or_else(|| SourceError::Unsupported {
        path: link.path().clone(),
        what: "the interface has no bulk endpoint towards the host".to_owned(),
        hint: "the firmware must have one: see isobath_usb::bulk".to_owned(),
    })
}

impl<S: UsbSys> DepthSource for Bulk<S> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.frame_header = None;
        self.readings.clear();
        self.frames.reset();
        self.messages.reset();
        self.stats = StreamStats::default();
        Ok(())
    }

    fn stats(&self) -> StreamStats {
        self.stats
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
        self.asked = false;
        loop {
            if let Some(gap) = self.gap.take() {
                return Ok(Outcome::Recovered(gap));
            }
            if let Some((header, time)) = self.frame_header.take() {
                match self.give(header, time, frame) {
                    Ok(()) => self.stats.delivered += 1,
                    Err(e) => {
                        self.stats.corrupt += 1;
                        return Err(e);
                    }
                }
                return Ok(Outcome::Frame);
            }
            if self.step(deadline)? == Event::Nothing {
                return Ok(Outcome::TimedOut);
            }
        }
    }
}

impl<S: UsbSys> ImuSource for Bulk<S> {
    fn info(&self) -> &ImuInfo {
        &self.imu_info
    }

    fn read(&mut self, out: &mut [ImuSample], deadline: Deadline) -> Result<ImuOutcome, SourceError> {
        self.asked = false;
        loop {
            if let Some(gap) = self.imu_gap.take() {
                return Ok(ImuOutcome::Recovered(gap));
            }
            let count = self.readings.len().min(out.len());
            if count > 0 || out.is_empty() {
                for (to, reading) in out.iter_mut().zip(self.readings.drain(..count)) {
                    *to = reading;
                }
                return Ok(if count > 0 { ImuOutcome::Samples(count) } else { ImuOutcome::TimedOut });
            }
            if self.step(deadline)? == Event::Nothing {
                return Ok(ImuOutcome::TimedOut);
            }
        }
    }
}
