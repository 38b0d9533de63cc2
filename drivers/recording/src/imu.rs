//! The inertial readings of a recording, as a source of their own.
//!
//! One topic of `sensor_msgs/Imu` holds both instruments; RealSense writes two, each with half of the numbers: then the gyroscope
//! leads, at its own rate, and each of its readings takes the acceleration nearest in time. A magnetic field within 50 ms comes along.

use std::path::Path;

use isobath::glam::Vec3;
use isobath::sensing::imu::ImuSample;
use isobath_source::{Deadline, ImuInfo, ImuOutcome, ImuSource, SourceError};

use crate::messages::{Kind, Message};
use crate::store::{Input, Located, Store, nearest};

/// How far apart a magnetic field may be, nanoseconds.
const FIELD_WITHIN: u64 = 50_000_000;

/// The inertial readings of an MCAP file or bag.
#[derive(Debug)]
pub struct ImuRecording {
    info: ImuInfo,
    store: Store,
    lead: usize,
    force: Option<usize>,
    field: Option<usize>,
    next: usize,
    bytes: Vec<u8>,
    seen: [Option<(Located, Vec3)>; 2],
}

/// Opens the inertial readings of a recording; `None` when it has none.
///
/// # Errors
/// [`SourceError`] when the file can't be opened.
pub fn open_imu(path: &Path) -> Result<Option<ImuRecording>, SourceError> {
    // Folders have no readings that are read here.
    if path.is_dir() || !crate::is_messages(path) {
        return Ok(None);
    }
    of_input(Input::open(path)?)
}

pub(crate) fn of_input(input: Input) -> Result<Option<ImuRecording>, SourceError> {
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
    let rate_hz = if span > 0.0 { ((c.messages.len() - 1) as f64 / span) as f32 } else { 0.0 };
    let info = ImuInfo { kind: format!("inertial readings on {}", c.topic), path: store.path().into(), rate_hz, notes };
    Ok(Some(ImuRecording { info, store, lead, force, field, next: 0, bytes: Vec::new(), seen: [None; 2] }))
}

fn vector(v: [f64; 3]) -> Vec3 {
    Vec3::from(v.map(|v| v as f32))
}

impl ImuRecording {
    /// Readings there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.store.channel(self.lead).map_or(0, |c| c.messages.len())
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether readings may have a magnetic field.
    #[must_use]
    pub const fn has_field(&self) -> bool {
        self.field.is_some()
    }

    /// When the next reading was written down, nanoseconds of the file's clock; `None` at the end.
    #[must_use]
    pub fn next_log_time(&self) -> Option<u64> {
        Some(self.store.channel(self.lead)?.messages.get(self.next)?.log_time)
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

impl ImuSource for ImuRecording {
    fn info(&self) -> &ImuInfo {
        &self.info
    }

    fn read(&mut self, out: &mut [ImuSample], _: Deadline) -> Result<ImuOutcome, SourceError> {
        let mut written = 0;
        while let Some(slot) = out.get_mut(written) {
            let Some(&place) = self.store.channel(self.lead).and_then(|c| c.messages.get(self.next)) else { break };
            self.next += 1;
            let (_, message) = self.store.message(self.lead, place, &mut self.bytes)?;
            let Message::Imu(imu) = message else { continue };
            let force = self.beside(0, self.force, place.log_time, u64::MAX).unwrap_or_else(|| vector(imu.force));
            let field = self.beside(1, self.field, place.log_time, FIELD_WITHIN);
            *slot = ImuSample { time: imu.stamp, rate: vector(imu.rate), force, field };
            written += 1;
        }
        Ok(if written == 0 && !out.is_empty() { ImuOutcome::EndOfStream } else { ImuOutcome::Samples(written) })
    }
}
