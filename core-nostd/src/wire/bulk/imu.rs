//! Inertial readings in a message: as many as came since the last one.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 2 | how many, at least 1 |
//! | 2 | 1 | 1 with a magnetometer, else 0 |
//! | 3 | 1 | 0 |
//! | 4 | 28 or 40 each | `u32` nanoseconds behind the message's time; rate, rad/s, 3 x `f32`; force, m/s², 3 x `f32`; field, microtesla, 3 x `f32` |

use glam::Vec3;

use super::{Header, Kind, OVERHEAD, encode_with};
use crate::ground::units::Timestamp;
use crate::sensing::imu::ImuSample;
use crate::wire::malformed::{Bytes, Malformed};

/// Bytes before the readings.
const FIXED: usize = 4;

const fn each(field: bool) -> usize {
    if field { 40 } else { 28 }
}

/// Readings, borrowed from a message; all of them finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imu<'a> {
    time: Timestamp,
    field: bool,
    readings: &'a [u8],
}

impl<'a> Imu<'a> {
    pub(super) fn read(time: Timestamp, body: &'a [u8]) -> Result<Self, Malformed> {
        let read = Bytes::new("bulk inertial readings", body);
        let (count, field) = (usize::from(read.u16(0)?), read.u8(2)?);
        if count == 0 || field > 1 {
            return Err(Malformed::Field { what: "the form of inertial readings", at: 0, got: read.u32(0)? });
        }
        let readings = read.slice(FIXED, count * each(field == 1))?;
        let imu = Self { time, field: field == 1, readings };
        if imu.iter().count() == count {
            return Ok(imu);
        }
        Err(Malformed::Field { what: "a number of inertial readings, which is not finite,", at: FIXED, got: 0 })
    }

    /// Readings there are, at least one.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.readings.len() / each(self.field)
    }

    /// Never: a message holds one reading at least.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.readings.is_empty()
    }

    /// The readings in their order.
    pub fn iter(&self) -> impl Iterator<Item = ImuSample> + use<'a> {
        let Self { time, field, readings } = *self;
        readings.chunks_exact(each(field)).map_while(move |bytes| {
            let read = Bytes::new("bulk inertial readings", bytes);
            let vector = |at| read.floats(at).ok().map(Vec3::from_array).filter(|v| v.is_finite());
            Some(ImuSample {
                time: time.saturating_add_nanos(read.u32(0).ok()?.into()),
                rate: vector(4)?,
                force: vector(16)?,
                field: if field { Some(vector(28)?) } else { None },
            })
        })
    }
}

/// Bytes of a message of so many readings.
#[must_use]
pub const fn imu_bytes(readings: usize, field: bool) -> usize {
    readings.saturating_mul(each(field)).saturating_add(OVERHEAD + FIXED)
}

/// Writes readings, the first of which gives the message its time; how many bytes it took. With a magnetometer in the first, all must have one.
///
/// # Errors
/// [`Malformed::Full`]; [`Malformed::Field`] for none or more than 65535 readings, for a reading before the first or more than 4.29 s behind it, or
/// with numbers that are not finite, or when some have a field and others don't.
pub fn encode_imu(readings: &[ImuSample], sequence: u32, out: &mut [u8]) -> Result<usize, Malformed> {
    let bad = |what| Malformed::Field { what, at: 0, got: readings.len() as u32 };
    let first = readings.first().ok_or(bad("the number of inertial readings"))?;
    let count = u16::try_from(readings.len()).map_err(|_| bad("the number of inertial readings"))?;
    let field = first.field.is_some();
    encode_with(&Header { kind: Kind::Imu, sequence, time: first.time }, out, |writer| {
        writer.u16(count)?;
        writer.bytes(&[u8::from(field), 0])?;
        for reading in readings {
            let behind = reading.time.as_nanos().checked_sub(first.time.as_nanos());
            let behind = behind.and_then(|nanos| u32::try_from(nanos).ok());
            writer.u32(behind.ok_or(bad("the time of an inertial reading"))?)?;
            let vectors = [Some(reading.rate), Some(reading.force), reading.field];
            for vector in vectors.iter().flatten() {
                if !vector.is_finite() {
                    return Err(bad("an inertial reading, which is not finite,"));
                }
                writer.floats(&vector.to_array())?;
            }
            if reading.field.is_some() != field {
                return Err(bad("the magnetometer of inertial readings, which all or none must have,"));
            }
        }
        Ok(())
    })
}
