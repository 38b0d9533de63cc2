//! What an inertial sensor says, and what follows from it: which way is up, how the device turned, when it lies still.
//!
//! Readings are in SI units, stamped, and may be anything: NaN, huge, repeated, late or from before. Nothing here panics, nothing
//! that was held becomes NaN, and every call says what it did with the reading ([`Step`]).
//!
//! ```text
//! ImuSample -> ImuCalibration -> Vqf        -> orientation, Gravity -> `up` of ground, maps, planner; ScreenTurn
//!                             -> RestBias   -> bias alone, where there is no room for more
//!                             -> TimeOffset -> how late the sensor's clock is against the camera's
//!                             -> lighting's AutoCapture::imu(s.rate, s.force, s.time): is this frame sharp, is it new?
//! ```
//!
//! | module | idea |
//! |---|---|
//! | [`calibration`] | scale, misalignment, bias, mounting and time offset, applied |
//! | [`step`] | the time from reading to reading, gaps and backward clocks included |
//! | [`rest`] | lies it still? and what the gyroscope says then |
//! | [`vqf`] | the orientation filter |
//! | [`gravity`] | which way is up, how surely; in the camera's frame and the world's |
//! | [`screen`] | which of four ways a screen is held |
//! | [`offset`] | the delay between gyroscope and camera |

use core::fmt;

use glam::Vec3;

use crate::ground::units::Timestamp;

pub mod calibration;
pub mod gravity;
mod lowpass;
pub mod offset;
pub mod rest;
pub mod screen;
pub mod step;
pub mod vqf;

pub use calibration::ImuCalibration;
pub use gravity::Gravity;
pub use step::Step;
pub use vqf::Vqf;

/// Standard gravity, m/s^2.
pub const STANDARD_GRAVITY: f32 = 9.806_65;

/// Fastest turning that is taken for a reading, rad/s on each axis: thirty times what gyroscopes measure.
const MAX_RATE: f32 = 1000.0;
/// Largest specific force that is taken for a reading, m/s^2 on each axis: a thousand g.
const MAX_FORCE: f32 = 1e4;
/// Strongest field that is taken for a reading, microtesla on each axis: a tenth of a tesla.
const MAX_FIELD: f32 = 1e5;

/// One reading of an inertial sensor, in its own right-handed frame (how it is mounted is the calibration's matter). 48 bytes at most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Time of the measurement, in the epoch of the frames it goes with once its source has mapped its clock.
    pub time: Timestamp,
    /// Angular rate, rad/s: its mean since the reading before, as sensors give it that average over their period. Of one that samples points, this time is half a period
    /// late; [`offset::TimeOffset`] finds that with the rest of the delay.
    pub rate: Vec3,
    /// Specific force, m/s^2: about 9.8 upwards at rest.
    pub force: Vec3,
    /// Magnetic field, microtesla; `None` without a magnetometer.
    pub field: Option<Vec3>,
}

impl ImuSample {
    /// Whether rate and force are numbers that a sensor may give: finite, within 1000 rad/s and 10,000 m/s^2 on each axis. Everything in
    /// this module refuses other readings.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        within(self.rate, MAX_RATE) && within(self.force, MAX_FORCE)
    }

    /// The field, when there is one and it is a number that a sensor may give: not zero, within 0.1 T on each axis.
    #[must_use]
    pub fn usable_field(&self) -> Option<Vec3> {
        self.field.filter(|f| within(*f, MAX_FIELD) && *f != Vec3::ZERO)
    }
}

/// Whether each component is at most `limit` from 0; never with NaN.
fn within(v: Vec3, limit: f32) -> bool {
    v.x.abs() <= limit && v.y.abs() <= limit && v.z.abs() <= limit
}

/// A parameter out of its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuError {
    /// The field at fault.
    pub name: &'static str,
    /// What it was.
    pub value: f32,
}

impl fmt::Display for ImuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is {}: out of the range that its documentation states", self.name, self.value)
    }
}

impl core::error::Error for ImuError {}

/// Holds `value` to be finite and above 0.
fn positive(name: &'static str, value: f32) -> Result<(), ImuError> {
    if value > 0.0 && value.is_finite() { Ok(()) } else { Err(ImuError { name, value }) }
}

/// Holds a number to a range; NaN is never in it.
fn in_range(name: &'static str, value: f32, low: f32, high: f32) -> Result<(), ImuError> {
    if value >= low && value <= high { Ok(()) } else { Err(ImuError { name, value }) }
}
