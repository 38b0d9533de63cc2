//! Sources of inertial readings and of poses.

use isobath::sensing::camera::Pose;
use isobath::sensing::imu::ImuSample;

use crate::clock::{Deadline, HostNanos};
use crate::error::SourceError;
use crate::source::Gap;

/// What an inertial sensor is.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuInfo {
    /// The kind, in a few words: "RealSense D435i motion module, gyro 400 Hz".
    pub kind: String,
    /// Where it was opened.
    pub path: std::path::PathBuf,
    /// Readings a second, when known; 0 when not.
    pub rate_hz: f32,
    /// What a user should know: what was assumed, what is missing.
    pub notes: Vec<String>,
}

/// What came of asking for readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
#[must_use]
pub enum ImuOutcome {
    /// This many readings were written, at least one.
    Samples(usize),
    /// The deadline passed without a reading.
    TimedOut,
    /// There are no more.
    EndOfStream,
    /// Readings are missing; the sensor goes on.
    Recovered(Gap),
}

/// A stream of inertial readings.
pub trait ImuSource {
    /// What the sensor is.
    fn info(&self) -> &ImuInfo;

    /// Writes the readings that are there to the front of `out`, waiting for the first until `deadline` at most. Never allocates.
    ///
    /// # Errors
    /// [`SourceError`], as [`DepthSource::next_into`](crate::DepthSource::next_into).
    fn read(&mut self, out: &mut [ImuSample], deadline: Deadline) -> Result<ImuOutcome, SourceError>;
}

/// Where a device was, and how well that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose {
    /// The time it holds for.
    pub time: HostNanos,
    /// Device-to-world. Without a known position its translation is zero.
    pub pose: Pose,
    /// Whether the position is known; without one only directions mean anything.
    pub has_position: bool,
    /// Standard deviation of the direction of gravity, radians; infinite when not known.
    pub inclination_sigma: f32,
}

/// Whoever knows where a device is: a tracker, a recording, an orientation filter.
pub trait PoseSource {
    /// The pose at a time, interpolated; `None` when it is not known for that time.
    fn pose_at(&self, time: HostNanos) -> Option<StampedPose>;
}
