//! The source: one sensor that measures all, or a gyroscope, the accelerometer beside it, and the magnetometer of the same device.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuSample;
use isobath_source::{
    Clock, ClockEvent, Deadline, DeviceClock, DeviceTicks, Gap, GapCause, HostNanos, ImuInfo, ImuOutcome, ImuSource,
    LinkKind, SourceError, SystemClock,
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::device::{Device, Quirk, Scan};
use crate::merge::{Merged, Merger};
use crate::sysfs::{Found, Root, describe, list, partner, together};

/// Intel.
const REALSENSE: u16 = 0x8086;
/// A stamp this near to now is of the host's own clock: 2 s.
const NEAR: u64 = 2_000_000_000;
/// After this silence of one of two sensors, while the other speaks, it is an error.
const SILENCE: Duration = Duration::from_secs(2);
/// One wait is no longer than this.
const SLICE: Duration = Duration::from_millis(500);

/// What can be chosen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// Where the system keeps its devices.
    pub root: Root,
    /// Readings a second to ask for; the driver's own when `None`.
    pub rate_hz: Option<f32>,
    /// How to read the numbers; by the device when `None`: a RealSense is taken to have firmware 5.16 or later, and says so.
    pub quirk: Option<Quirk>,
}

/// Inertial readings of IIO.
pub struct IioImu {
    info: ImuInfo,
    /// The gyroscope, or the sensor that is both, first.
    devices: [Option<Device>; 3],
    heard: [HostNanos; 3],
    merger: Merger,
    clock: Box<dyn Clock + Send>,
    /// Of the sensors' stamps, when they are not the host's.
    device_clock: Option<DeviceClock>,
    /// From the gyroscope's stamps to its clock's ticks, which go on after a reset.
    shift: Option<u64>,
    decided: bool,
    gap: Option<Gap>,
    gone: bool,
}

impl std::fmt::Debug for IioImu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("IioImu").field("info", &self.info).finish_non_exhaustive()
    }
}

/// Opens a sensor and starts it: `path` is its directory (`/sys/bus/iio/devices/iio:device0`), its name there (`iio:device0`), or, when `None`,
/// the first gyroscope. One that is only a gyroscope is joined by the accelerometer nearest to it.
///
/// # Errors
/// [`SourceError`]: there is none, it may not be used, or its driver is not understood.
pub fn open(path: Option<&Path>, options: &Options) -> Result<IioImu, SourceError> {
    IioImu::open_at(path, options, Box::new(SystemClock))
}

impl IioImu {
    /// As [`open`], by another clock.
    ///
    /// # Errors
    /// As [`open`].
    pub fn open_at(path: Option<&Path>, options: &Options, clock: Box<dyn Clock + Send>) -> Result<Self, SourceError> {
        let all = list(&options.root);
        let missing = |path: PathBuf, what: &str| SourceError::Unsupported {
            path,
            what: what.to_owned(),
            hint: "isobath devices lists the sensors; ls /sys/bus/iio/devices shows what the kernel has".to_owned(),
        };
        let sysfs = || options.root.sysfs.clone();
        let first = match path {
            None => all.iter().find(|f| f.gyroscope).cloned().ok_or_else(|| missing(sysfs(), "no gyroscope"))?,
            Some(path) => {
                let path = options.root.sysfs.join(path);
                describe(&path).ok_or_else(|| missing(path, "no inertial sensor with a buffer"))?
            }
        };
        let second = match (first.gyroscope, first.accelerometer) {
            (true, true) => None,
            (false, false) => return Err(missing(first.path, "it measures neither rate nor force")),
            (gyroscope, _) => Some(
                partner(&first, &all, |f| if gyroscope { f.accelerometer } else { f.gyroscope }).cloned().ok_or_else(
                    || missing(first.path.clone(), "it measures only one of rate and force, and there is no other"),
                )?,
            ),
        };
        let (gyroscope, accelerometer) = match second {
            Some(second) if !first.gyroscope => (second, Some(first)),
            second => (first, second),
        };
        let measured = gyroscope.magnetometer || accelerometer.as_ref().is_some_and(|a| a.magnetometer);
        let beside = |f: &Found| f.magnetometer && !f.gyroscope && !f.accelerometer && together(f, &gyroscope);
        let magnetometer = if measured { None } else { partner(&gyroscope, &all, beside) };
        Self::start([Some(&gyroscope), accelerometer.as_ref(), magnetometer], options, clock)
    }

    fn start(
        sensors: [Option<&Found>; 3],
        options: &Options,
        clock: Box<dyn Clock + Send>,
    ) -> Result<Self, SourceError> {
        let [Some(gyroscope), accelerometer, magnetometer] = sensors else {
            return Err(SourceError::Disconnected { device: options.root.sysfs.display().to_string() });
        };
        let mut notes = Vec::new();
        let realsense = gyroscope.usb.is_some_and(|(vendor, _)| vendor == REALSENSE) && gyroscope.name == "gyro_3d";
        let quirk = match options.quirk {
            Some(quirk) => quirk,
            None if realsense => {
                notes.push("RealSense scales of firmware 5.16 and later are assumed; say so if it is older".to_owned());
                Quirk::RealSense
            }
            None => Quirk::None,
        };
        let on = |found: &Found| Device::start(&options.root, found, quirk, options.rate_hz);
        // Should the second fail, the first is switched off by being dropped.
        let first = on(gyroscope)?;
        let second = accelerometer.map(on).transpose()?;
        let third = magnetometer.map(on).transpose()?;
        let mut kind = gyroscope.name.clone();
        let rate_hz = first.rate_hz;
        notes.extend(first.notes.iter().cloned());
        if let Some(second) = &second {
            kind = format!("{kind} + {}", second.found().name);
            notes.extend(second.notes.iter().cloned());
            notes.push("the accelerometer is interpolated at the gyroscope's times".to_owned());
        }
        if let Some(third) = &third {
            kind = format!("{kind} + {}", third.found().name);
            notes.extend(third.notes.iter().cloned());
        }
        notes.dedup();
        let now = clock.now();
        Ok(Self {
            info: ImuInfo { kind: format!("{kind} (IIO)"), path: gyroscope.path.clone(), rate_hz, notes },
            devices: [Some(first), second, third],
            heard: [now; 3],
            merger: Merger::new(),
            clock,
            device_clock: None,
            shift: None,
            decided: false,
            gap: None,
            gone: false,
        })
    }

    /// Readings that were dropped: stamps that can't be, rates without a force.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.merger.lost() + self.devices.iter().flatten().map(Device::dropped).sum::<u64>()
    }

    /// Takes what the sensors have, without waiting: whether anything came.
    fn take(&mut self) -> Result<bool, SourceError> {
        let Self { devices, heard, merger, clock, device_clock, shift, decided, gap, .. } = self;
        let mut came = 0;
        for (device, heard) in devices.iter_mut().zip(heard) {
            let Some(device) = device else { continue };
            let now = clock.now();
            let scans = device.scans(|Scan { stamp, rate, force, field }| {
                if !*decided {
                    *decided = true;
                    let near = stamp.cast_unsigned().abs_diff(now.0) <= NEAR;
                    *device_clock = if near { None } else { DeviceClock::new(64, 1e9) };
                }
                let time = match device_clock {
                    None => stamp,
                    // The gyroscope leads: a batch of the other sensor's readings, read after its own, would look like a clock set back.
                    Some(map) => {
                        let raw = stamp.cast_unsigned();
                        let ticks = match *shift {
                            Some(shift) if rate.is_none() => DeviceTicks(raw.wrapping_add(shift)),
                            None if rate.is_none() => return,
                            _ => {
                                let (ticks, event) = map.observe(raw, now);
                                if event == ClockEvent::Jump {
                                    *gap = Some(Gap { cause: GapCause::Reset, lost: None });
                                    merger.clear();
                                }
                                *shift = Some(ticks.0.wrapping_sub(raw));
                                ticks
                            }
                        };
                        ticks.0.cast_signed()
                    }
                };
                if let Some(force) = force {
                    merger.force(time, force);
                }
                if let Some(field) = field {
                    merger.field(time, field);
                }
                if let Some(rate) = rate {
                    merger.rate(time, rate);
                }
            })?;
            if scans > 0 {
                *heard = now;
            }
            came += scans;
        }
        Ok(came > 0)
    }

    /// Waits until a sensor has something, or the time is up.
    fn wait(&self, time: Duration) -> Result<(), SourceError> {
        let Some(first) = &self.devices[0] else { return Ok(()) };
        let timeout =
            Timespec { tv_sec: i64::try_from(time.as_secs()).unwrap_or(i64::MAX), tv_nsec: time.subsec_nanos().into() };
        let mut fds = self.devices.each_ref().map(|device| readable(device.as_ref().unwrap_or(first)));
        let fds = &mut fds[..];
        match poll(fds, Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(e) => return Err(SourceError::io(&self.info.path, io::Error::from(e))),
        }
        // Hung up and nothing left to read: polling again would answer at once, and for ever.
        let over = fds.iter().any(|fd| {
            let now = fd.revents();
            now.intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL) && !now.contains(PollFlags::IN)
        });
        if over { Err(self.disconnected()) } else { Ok(()) }
    }

    fn disconnected(&self) -> SourceError {
        SourceError::Disconnected { device: self.info.path.display().to_string() }
    }

    fn fill(&mut self, out: &mut [ImuSample], deadline: Deadline) -> Result<ImuOutcome, SourceError> {
        loop {
            if let Some(gap) = self.gap.take() {
                return Ok(ImuOutcome::Recovered(gap));
            }
            let came = self.take()?;
            let mut count = 0;
            for place in &mut *out {
                let Some(Merged { time: ticks, rate, force, field }) = self.merger.pop() else { break };
                // Only now: put together by the sensors' own clock, readings keep their distances while the two clocks get to know each other.
                let host = self.device_clock.as_mut().and_then(|map| map.to_host(DeviceTicks(ticks.cast_unsigned())));
                let time = host.map_or(ticks, |host| host.timestamp().as_nanos());
                *place = ImuSample { time: Timestamp::from_nanos(time), rate, force, field };
                count += 1;
            }
            if count > 0 {
                return Ok(ImuOutcome::Samples(count));
            }
            let now = self.clock.now();
            if self.devices[1].is_some() {
                let [a, b, _] = self.heard;
                if a.saturating_since(b).max(b.saturating_since(a)) > SILENCE {
                    // Once: what is heard from here on counts anew.
                    self.heard = [now; 3];
                    return Err(SourceError::Link {
                        path: self.info.path.clone(),
                        kind: LinkKind::NoAnswer,
                        doing: "waiting for one of gyroscope and accelerometer, while the other speaks",
                        error: None,
                    });
                }
            }
            if deadline.has_passed(now) {
                return Ok(ImuOutcome::TimedOut);
            }
            if !came {
                self.wait(deadline.remaining(now).unwrap_or(SLICE).min(SLICE))?;
            }
        }
    }
}

fn readable(device: &Device) -> PollFd<'_> {
    PollFd::from_borrowed_fd(device.fd(), PollFlags::IN)
}

impl ImuSource for IioImu {
    fn info(&self) -> &ImuInfo {
        &self.info
    }

    fn read(&mut self, out: &mut [ImuSample], deadline: Deadline) -> Result<ImuOutcome, SourceError> {
        if self.gone {
            return Err(self.disconnected());
        }
        if out.is_empty() {
            return Ok(ImuOutcome::TimedOut);
        }
        let result = self.fill(out, deadline);
        self.gone |= result.as_ref().is_err_and(SourceError::is_terminal);
        result
    }
}
