//! Kinect v1 (Xbox 360, Windows): 640 x 480 depth, 30 times a second, in millimetres by the device's own constants.
//!
//! The camera is spoken to by control transfers ([`isobath::wire::device::kinect`]) and sends depth in isochronous packets, which are put together to
//! frames by [`Assembler`]: a frame of which a packet is missing is counted ([`StreamStats::corrupt`]) and never given. At most 64 ms of packets wait in the
//! system, so a program that works longer than that between two frames wraps this source in
//! [`Pumped`](isobath_source::Pumped).
//!
//! The pinhole comes from the same constants, as libfreenect's does: f = distance / (2 pixel size), principal point in the middle; the lens, which the device does
//! not tell, is not corrected. A frame's time is the host's when its last packet came. The accelerometer is on the motor's device and not
//! read.

use std::fmt;
use std::time::Duration;

use isobath::ground::image::ImageViewMut;
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::decode::kinect::{Constants, Table};
use isobath::wire::device::gmrb::{self, Packet};
use isobath::wire::device::kinect::packets::{Assembler, Counts, Event, PACKET};
use isobath::wire::device::kinect::{
    ALGORITHM_PARAMS, ANSWER_BYTES, DEPTH_ENDPOINT, FIXED_PARAMS, FIXED_PARAMS_PAYLOAD, FRAME_BYTES, PRODUCTS,
    ROW_BYTES, SIZE, START_DEPTH, STOP_DEPTH, VENDOR, WRITE_REGISTER, algorithm_params_payload, constants,
    write_register_payload,
};
use isobath::wire::malformed::Malformed;
use isobath_source::{
    Clock, Deadline, DepthSource, Gap, GapCause, HostNanos, LinkKind, Outcome, OwnedFrame, SourceError, SourceInfo,
    StreamStats, SystemClock,
};

use crate::link::{Link, Options, Wanted};
use crate::sys::{IsoLayout, Request, UsbDevice, UsbError, UsbSys};

/// 32 transfers of 16 packets: 64 ms at 8 packets a millisecond.
const LAYOUT: IsoLayout = IsoLayout { endpoint: DEPTH_ENDPOINT, packet: PACKET, packets: 16, transfers: 32 };
/// How long a control transfer may take.
const CONTROL: Duration = Duration::from_millis(500);
/// How often an answer is asked for, a millisecond apart.
const ASK: usize = 200;
/// A transfer is waited for no longer than this, so that an unplugged device shows.
const SLICE: Duration = Duration::from_millis(200);
/// Packets come all the time, empty ones too: after this silence the stream is started anew.
const SILENCE: Duration = Duration::from_secs(1);

/// The camera of a Kinect v1 with a serial number, or the first one.
#[must_use]
pub fn wanted(serial: Option<&str>) -> Wanted {
    let serial = serial.map(str::to_owned);
    Wanted { vendor: Some(VENDOR), products: PRODUCTS.to_vec(), class: None, serial }
}

/// A Kinect v1.
pub struct Kinect1<S: UsbSys> {
    link: Link<S>,
    clock: Box<dyn Clock + Send>,
    info: SourceInfo,
    table: Table,
    tag: u16,
    running: bool,
    assembler: Assembler,
    /// The frame that is put together, and the last one that was whole.
    building: Vec<u8>,
    whole: Vec<u8>,
    /// When the last whole frame came, if nobody took it yet.
    arrived: Option<HostNanos>,
    heard: HostNanos,
    delivered: u64,
    dropped: u64,
    recoveries: u64,
    /// Of streams before the last (re)start.
    before: Counts,
    sequence: u64,
    gap: Option<Gap>,
}

impl<S: UsbSys> fmt::Debug for Kinect1<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Kinect1").field("link", &self.link).field("running", &self.running).finish_non_exhaustive()
    }
}

/// Why a command failed.
enum Failed {
    Usb(UsbError),
    Answer(Malformed),
}

impl From<UsbError> for Failed {
    fn from(e: UsbError) -> Self {
        Self::Usb(e)
    }
}

impl<S: UsbSys> Kinect1<S> {
    /// Opens a Kinect and reads its constants. When it does not tell them, nominal ones are used, and [`DepthSource::info`] says so.
    ///
    /// # Errors
    /// [`SourceError`]: none is there, or it may not be opened.
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
        let table = Constants::NOMINAL.table().map_err(|e| SourceError::Config {
            path: link.path().clone(),
            what: e.to_string(),
            hint: "the nominal constants are usable; report this".to_owned(),
        })?;
        let info = SourceInfo {
            kind: "Kinect v1".to_owned(),
            path: link.path().clone(),
            size: Some(SIZE),
            intrinsics: pinhole(&Constants::NOMINAL),
            up: None,
            has_colour: false,
            has_poses: false,
            notes: Vec::new(),
        };
        let mut kinect = Self {
            link,
            info,
            table,
            tag: 0,
            running: false,
            assembler: Assembler::new(),
            building: vec![0; FRAME_BYTES],
            whole: vec![0; FRAME_BYTES],
            arrived: None,
            heard: clock.now(),
            clock,
            delivered: 0,
            dropped: 0,
            recoveries: 0,
            before: Counts::default(),
            sequence: 0,
            gap: None,
        };
        kinect.calibrate()?;
        Ok(kinect)
    }

    /// Packets, beyond what [`StreamStats`] can say.
    #[must_use]
    pub const fn packets(&self) -> Counts {
        sum(self.before, self.assembler.counts())
    }

    /// Sends a command; the payload of its answer, status included, in `answer`.
    fn command<'a>(&mut self, opcode: u16, payload: &[u8], answer: &'a mut [u8]) -> Result<&'a [u8], Failed> {
        let mut question = [0; 64];
        self.tag = self.tag.wrapping_add(1);
        let packet = Packet { opcode, id: self.tag, payload };
        let used = gmrb::encode_question(&packet, &mut question).map_err(Failed::Answer)?;
        let mut request = Request { kind: 0x40, request: 0, value: 0, index: 0 };
        let question = question.get(..used).unwrap_or_default();
        self.link.device()?.control_out(request, question, CONTROL)?;
        request.kind = 0xc0;
        for _ in 0..ASK {
            let got = self.link.device()?.control_in(request, answer, CONTROL)?;
            // Nothing yet, or the whole buffer: it is still thinking.
            if got > 0 && got < answer.len() {
                let answer = answer.get(..got).unwrap_or_default();
                return gmrb::payload(opcode, self.tag, answer).map_err(Failed::Answer);
            }
            self.link.wait(Duration::from_millis(1), Deadline::NEVER, &*self.clock);
        }
        Err(UsbError::Timeout.into())
    }

    fn failed(&self, doing: &'static str, failed: Failed) -> SourceError {
        match failed {
            Failed::Usb(e) => self.link.error(doing, e),
            Failed::Answer(_) => {
                SourceError::Link { path: self.link.path().clone(), kind: LinkKind::Protocol, doing, error: None }
            }
        }
    }

    /// Asks for the constants.
    fn calibrate(&mut self) -> Result<(), SourceError> {
        let (mut fixed, mut shift) = ([0; ANSWER_BYTES], [0; ANSWER_BYTES]);
        let asked = (|| {
            let fixed = self.command(FIXED_PARAMS, &FIXED_PARAMS_PAYLOAD, &mut fixed)?;
            let shift = self.command(ALGORITHM_PARAMS, &algorithm_params_payload(0), &mut shift)?;
            constants(fixed, shift).map_err(Failed::Answer)
        })();
        self.info.notes.clear();
        let found = match asked {
            Ok(found) => found,
            Err(Failed::Usb(e @ (UsbError::Gone | UsbError::Access))) => {
                return Err(self.link.error("reading its constants", e));
            }
            Err(why) => {
                let why = match why {
                    Failed::Usb(e) => e.to_string(),
                    Failed::Answer(e) => e.to_string(),
                };
                self.info.notes.push(format!(
                    "the device does not tell its constants ({why}): depth is right to a few percent only"
                ));
                Constants::NOMINAL
            }
        };
        if let Ok(table) = found.table() {
            self.table = table;
        }
        self.info.intrinsics = pinhole(&found);
        let serial = self.link.serial().map(|serial| format!(", serial number {serial}")).unwrap_or_default();
        self.info.kind = format!("Kinect v1{serial}");
        self.info.path.clone_from(self.link.path());
        self.info.notes.push("pinhole from the device's constants; its lens is not corrected".to_owned());
        Ok(())
    }

    fn write(&mut self, (register, value): (u16, u16)) -> Result<(), Failed> {
        let mut answer = [0; ANSWER_BYTES];
        self.command(WRITE_REGISTER, &write_register_payload(register, value), &mut answer).map(drop)
    }

    fn begin(&mut self) -> Result<(), SourceError> {
        if self.running {
            return Ok(());
        }
        let begun = (|| {
            self.link.device()?.start_iso(LAYOUT)?;
            START_DEPTH.into_iter().try_for_each(|register| self.write(register))
        })();
        if let Err(failed) = begun {
            if let Ok(device) = self.link.device() {
                device.stop_iso();
            }
            return Err(self.failed("starting depth", failed));
        }
        self.running = true;
        self.heard = self.clock.now();
        Ok(())
    }

    fn end(&mut self) {
        if !self.running {
            return;
        }
        self.running = false;
        // A device that is gone or hangs is stopped all the same.
        let _ = self.write(STOP_DEPTH);
        if let Ok(device) = self.link.device() {
            device.stop_iso();
        }
        self.close_books();
    }

    /// What was begun won't be finished, and what waits is given to nobody.
    fn close_books(&mut self) {
        self.assembler.restart();
        self.before = self.packets();
        self.assembler = Assembler::new();
        if self.arrived.take().is_some() {
            self.dropped += 1;
        }
    }

    /// The device is gone: waits until it is back, or the time is up.
    fn come_back(&mut self, deadline: Deadline) -> Result<Outcome, SourceError> {
        if self.running {
            // Its memory is given back with it.
            self.running = false;
            self.close_books();
        }
        self.link.lost()?;
        if !self.link.reopen(deadline, &*self.clock)? {
            return Ok(Outcome::TimedOut);
        }
        match self.calibrate().and_then(|()| self.begin()) {
            Ok(()) => {
                self.recoveries += 1;
                Ok(Outcome::Recovered(Gap { cause: GapCause::Replugged, lost: None }))
            }
            Err(e) if e.is_terminal() => {
                self.link.lost()?;
                Ok(Outcome::TimedOut)
            }
            Err(e) => Err(e),
        }
    }

    /// Takes one transfer's packets; whether there was one.
    fn pump(&mut self, timeout: Duration) -> Result<bool, UsbError> {
        let Self { link, assembler, building, whole, arrived, dropped, clock, .. } = self;
        let taken = link.device()?.next_iso(timeout, &mut |packet| {
            let event = match packet {
                Some(packet) => assembler.packet(packet, building),
                None => assembler.missing(),
            };
            if let Event::Frame { .. } = event {
                std::mem::swap(building, whole);
                if arrived.replace(clock.now()).is_some() {
                    *dropped += 1;
                }
            }
        });
        match taken {
            Ok(packets) => {
                if packets > 0 {
                    self.heard = self.clock.now();
                }
                Ok(packets > 0)
            }
            Err(UsbError::Timeout) => Ok(false),
            Err(e) => Err(e),
        }
    }
}

const fn sum(a: Counts, b: Counts) -> Counts {
    Counts {
        whole: a.whole + b.whole,
        broken: a.broken + b.broken,
        lost: a.lost + b.lost,
        duplicates: a.duplicates + b.duplicates,
        late: a.late + b.late,
        strange: a.strange + b.strange,
    }
}

/// The depth camera's pinhole.
fn pinhole(k: &Constants) -> Intrinsics {
    let f = k.distance / (2.0 * k.pixel_size);
    let centre = (0.5 * SIZE.0 as f32, 0.5 * SIZE.1 as f32);
    Intrinsics::new(f, f, centre.0, centre.1).unwrap_or_else(|_| pinhole(&Constants::NOMINAL))
}

impl<S: UsbSys> DepthSource for Kinect1<S> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), SourceError> {
        self.begin()
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.end();
        (self.delivered, self.dropped, self.recoveries, self.before) = (0, 0, 0, Counts::default());
        self.sequence = 0;
        Ok(())
    }

    fn stats(&self) -> StreamStats {
        StreamStats {
            delivered: self.delivered,
            dropped_by_policy: self.dropped,
            corrupt: self.packets().broken,
            recoveries: self.recoveries,
            ..StreamStats::default()
        }
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
        if !self.link.is_open() {
            return self.come_back(deadline);
        }
        self.begin()?;
        loop {
            if let Some(gap) = self.gap.take() {
                return Ok(Outcome::Recovered(gap));
            }
            if let Some(arrived) = self.arrived.take() {
                frame.clear();
                let (w, h) = SIZE;
                let pixels = frame.depth_u16_mut(w, h);
                let decoded =
                    ImageViewMut::new(pixels, w, h).map(|mut out| self.table.decode(&self.whole, ROW_BYTES, &mut out));
                debug_assert!(matches!(decoded, Ok(Ok(_))), "both are of the Kinect's size");
                (frame.unit, frame.intrinsics) = (DepthUnit::MILLIMETRE, self.info.intrinsics);
                (frame.time, frame.sequence) = (arrived.timestamp(), self.sequence);
                self.sequence += 1;
                self.delivered += 1;
                return Ok(Outcome::Frame);
            }
            let now = self.clock.now();
            let left = deadline.remaining(now).unwrap_or(SLICE);
            let timeout = left.min(SLICE).max(Duration::from_millis(1));
            let came = match self.pump(timeout) {
                Ok(came) => came,
                Err(UsbError::Gone) => return self.come_back(deadline),
                Err(e) => {
                    self.end();
                    self.recoveries += 1;
                    self.link.wait(Duration::from_millis(20), deadline, &*self.clock);
                    return Err(self.link.error("reading depth packets", e));
                }
            };
            let now = self.clock.now();
            if now.saturating_since(self.heard) >= SILENCE {
                self.end();
                self.recoveries += 1;
                self.heard = now;
                match self.begin() {
                    Ok(()) => self.gap = Some(Gap { cause: GapCause::Link, lost: None }),
                    Err(e) if e.is_terminal() => return self.come_back(deadline),
                    Err(e) => return Err(e),
                }
                continue;
            }
            if !came && deadline.has_passed(now) {
                return Ok(Outcome::TimedOut);
            }
            // Packets that make no frame for a whole deadline must not hold the caller either.
            if self.arrived.is_none() && deadline.has_passed(now) {
                return Ok(Outcome::TimedOut);
            }
        }
    }
}

impl<S: UsbSys> Drop for Kinect1<S> {
    fn drop(&mut self) {
        self.end();
    }
}
