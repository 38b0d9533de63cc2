//! The inertial readings of a recording, as a source of their own: those of an MCAP file or bag, or a folder's `imu.csv`.
//!
//! One topic of `sensor_msgs/Imu` holds both instruments; RealSense writes two, each with half of the numbers: then the gyroscope
//! leads, at its own rate, and each of its readings takes the acceleration nearest in time. A magnetic field within 50 ms comes along.

use std::path::Path;

use isobath::glam::Vec3;
use isobath::sensing::imu::ImuSample;
use isobath_source::{Deadline, ImuInfo, ImuOutcome, ImuSource, SourceError};

use crate::files::{in_file, read_text};
use crate::messages::{Kind, Message};
use crate::parse::parse_imu_csv;
use crate::store::{Input, Located, Store, nearest};

/// How far apart a magnetic field may be, nanoseconds.
const FIELD_WITHIN: u64 = 50_000_000;

/// The inertial readings of a recording.
#[derive(Debug)]
pub struct ImuRecording {
    info: ImuInfo,
    next: usize,
    from: From,
}

#[derive(Debug)]
enum From {
    /// A list, whole in memory: 48 bytes a reading.
    List(Vec<ImuSample>),
    Messages(Box<Messages>),
}

/// Channels, read as they are asked for.
#[derive(Debug)]
struct Messages {
    store: Store,
    lead: usize,
    force: Option<usize>,
    field: Option<usize>,
    bytes: Vec<u8>,
    seen: [Option<(Located, Vec3)>; 2],
}

/// Opens the inertial readings of a recording: an MCAP file's, a bag's, or a folder's `imu.csv`; `None` when it has none.
///
/// # Errors
/// [`SourceError`] when the file can't be opened, or is not what it should be.
pub fn open_imu(path: &Path) -> Result<Option<ImuRecording>, SourceError> {
    let list = path.join("imu.csv");
    if list.is_file() {
        let samples = parse_imu_csv(&read_text(&list)?).map_err(in_file(&list))?;
        let span = match (samples.first(), samples.last()) {
            (Some(a), Some(b)) => f64::from(b.time.seconds_since(a.time)),
            _ => return Ok(None),
        };
        let info = ImuInfo {
            kind: "inertial readings of imu.csv".into(),
            path: list,
            rate_hz: rate(samples.len(), span),
            notes: Vec::new(),
        };
        return Ok(Some(ImuRecording { info, next: 0, from: From::List(samples) }));
    }
    if path.is_dir() || !crate::is_messages(path) {
        return Ok(None);
    }
    of_input(Input::open(path)?)
}

fn rate(samples: usize, span: f64) -> f32 {
    if span > 0.0 { (samples.saturating_sub(1) as f64 / span) as f32 } else { 0.0 }
}

fn of_input(input: Input) -> Result<Option<ImuRecording>, SourceError> {
    let store = Store::open(input)?;
    let channels = &store.contents.channels;
    let named =
        |word: &str| channels.iter().position(|c| c.kind == Kind::Imu && c.topic.to_ascii_lowercase().contains(word));
    let (lead, force) = match (named("gyro"), named("accel")) {
        (Some(gyro), Some(accel)) if gyro != accel => (gyro, Some(accel)),
        _ => match channels.iter().position(|c| c.kind == Kind::Imu) {
            Some(both) => (both, None),
            None => return Ok(None),
        },
    };
    let field = channels.iter().position(|c| c.kind == Kind::MagneticField);
    let Some(c) = channels.get(lead) else { return Ok(None) };
    let mut notes = Vec::new();
    if let Some(a) = force.and_then(|i| channels.get(i)) {
        notes.push(format!("angular rate from {}, force nearest in time from {}", c.topic, a.topic));
    }
    let span = match (c.messages.first(), c.messages.last()) {
        (Some(a), Some(b)) => b.log_time.saturating_sub(a.log_time) as f64 * 1e-9,
        _ => 0.0,
    };
    let rate_hz = rate(c.messages.len(), span);
    let info = ImuInfo { kind: format!("inertial readings on {}", c.topic), path: store.path().into(), rate_hz, notes };
    let messages = Messages { lead, force, field, store, bytes: Vec::new(), seen: [None; 2] };
    Ok(Some(ImuRecording { info, next: 0, from: From::Messages(Box::new(messages)) }))
}

fn vector(v: [f64; 3]) -> Vec3 {
    Vec3::from(v.map(|v| v as f32))
}

impl Messages {
    /// The lead's message `index`; `None` at the end.
    fn place(&self, index: usize) -> Option<Located> {
        self.store.channel(self.lead)?.messages.get(index).copied()
    }

    fn sample(&mut self, place: Located) -> Result<Option<ImuSample>, SourceError> {
        let (_, message) = self.store.message(self.lead, place, &mut self.bytes)?;
        let Message::Imu(imu) = message else { return Ok(None) };
        let force = self.beside(0, self.force, place.log_time, u64::MAX).unwrap_or_else(|| vector(imu.force));
        let field = self.beside(1, self.field, place.log_time, FIELD_WITHIN);
        Ok(Some(ImuSample { time: imu.stamp, rate: vector(imu.rate), force, field }))
    }

    /// What the other channel said at that time; each message is read once.
    fn beside(&mut self, slot: usize, channel: Option<usize>, time: u64, within: u64) -> Option<Vec3> {
        let channel = channel?;
        let place = nearest(&self.store.channel(channel)?.messages, time)?;
        if place.log_time.abs_diff(time) > within {
            return None;
        }
        if let Some((at, value)) = self.seen.get(slot).copied().flatten()
            && at == place
        {
            return Some(value);
        }
        let value = match self.store.message(channel, place, &mut self.bytes) {
            Ok((_, Message::Imu(imu))) => vector(imu.force),
            // Tesla to microtesla.
            Ok((_, Message::MagneticField(_, field))) => vector(field.map(|v| v * 1e6)),
            _ => return None,
        };
        if let Some(seen) = self.seen.get_mut(slot) {
            *seen = Some((place, value));
        }
        Some(value)
    }
}

impl ImuRecording {
    /// Readings there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match &self.from {
            From::List(samples) => samples.len(),
            From::Messages(m) => m.store.channel(m.lead).map_or(0, |c| c.messages.len()),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether readings may have a magnetic field.
    #[must_use]
    pub fn has_field(&self) -> bool {
        matches!(&self.from, From::Messages(m) if m.field.is_some())
    }

    /// When the next reading was written down, nanoseconds of the recording's clock; `None` at the end.
    #[must_use]
    pub fn next_log_time(&self) -> Option<u64> {
        match &self.from {
            From::List(samples) => Some(u64::try_from(samples.get(self.next)?.time.as_nanos()).unwrap_or(0)),
            From::Messages(m) => Some(m.place(self.next)?.log_time),
        }
    }
}

impl ImuSource for ImuRecording {
    fn info(&self) -> &ImuInfo {
        &self.info
    }

    fn read(&mut self, out: &mut [ImuSample], _: Deadline) -> Result<ImuOutcome, SourceError> {
        let mut written = 0;
        while let Some(slot) = out.get_mut(written) {
            let sample = match &mut self.from {
                From::List(samples) => {
                    let Some(&sample) = samples.get(self.next) else { break };
                    self.next += 1;
                    Some(sample)
                }
                From::Messages(m) => {
                    let Some(place) = m.place(self.next) else { break };
                    // First, so that a broken one is passed over by the next call.
                    self.next += 1;
                    m.sample(place)?
                }
            };
            if let Some(sample) = sample {
                *slot = sample;
                written += 1;
            }
        }
        Ok(if written == 0 && !out.is_empty() { ImuOutcome::EndOfStream } else { ImuOutcome::Samples(written) })
    }
}
