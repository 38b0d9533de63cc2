//! What an inertial sensor says: readings of a gyroscope and an accelerometer, in SI units.

use glam::Vec3;

use crate::ground::units::Timestamp;

/// One reading of an inertial sensor, in its own right-handed frame (how it is mounted is the calibration's matter). 48 bytes at most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Time of the measurement, in the epoch of the frames it goes with once its source has mapped its clock.
    pub time: Timestamp,
    /// Angular rate, rad/s.
    pub rate: Vec3,
    /// Specific force, m/s^2: about 9.8 upwards at rest.
    pub force: Vec3,
    /// Magnetic field, microtesla; `None` without a magnetometer.
    pub field: Option<Vec3>,
}
