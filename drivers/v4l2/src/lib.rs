#![doc = include_str!("../README.md")]

pub mod colour;
pub mod decode;
pub mod meta;
mod open;
mod options;
pub mod profile;
pub mod queue;
mod report;
mod source;
pub mod stream;
pub mod sys;
pub mod sysfs;

pub use open::open_with;
pub use options::OpenOptions;
pub use report::{DeviceReport, devices_with};
pub use source::{RawFrame, V4l2Source};

/// Opens a depth camera.
///
/// ```no_run
/// use std::time::Duration;
/// use isobath_source::{Clock, Deadline, DepthSource, Outcome, OwnedFrame, SystemClock};
/// use isobath_v4l2::OpenOptions;
/// # fn main() -> Result<(), isobath_source::SourceError> {
/// let mut camera = isobath_v4l2::open("/dev/video0".as_ref(), &OpenOptions::default())?;
/// let mut frame = OwnedFrame::new();
/// while camera.next_into(&mut frame, Deadline::after(&SystemClock, Duration::from_secs(1)))? == Outcome::Frame {
///     println!("{} m ahead", frame.z(320, 240));
/// }
/// # Ok(()) }
/// ```
///
/// # Errors
/// [`SourceError`](isobath_source::SourceError): no such node, not permitted (with the udev line to add), in use, no depth format, another format granted than
/// asked for, or a calibration that neither camera nor caller has.
#[cfg(feature = "live")]
pub fn open(
    path: &std::path::Path,
    options: &OpenOptions,
) -> Result<Box<dyn isobath_source::DepthSource + Send>, isobath_source::SourceError> {
    Ok(Box::new(open_with(&sys::live::Linux, Box::new(isobath_source::SystemClock), path, options)?))
}

/// What is plugged in, what can be done with it, and what is missing.
#[cfg(feature = "live")]
#[must_use]
pub fn devices() -> Vec<DeviceReport> {
    devices_with(&sys::live::Linux, &sysfs::Roots::default())
}
