//! Inertial sensors of Linux's industrial I/O (IIO) as an [`ImuSource`](isobath_source::ImuSource): readings in SI units, with the host's times.
//!
//! | module | what |
//! |---|---|
//! | [`sysfs`] | which sensors there are, and their attributes; the root directories are parameters, so that a test can lay out its own |
//! | [`device`] | one sensor: its channels, scales and mounting; its buffer on and off; scans read and made into numbers |
//! | [`stamps`] | time stamps that jump or go back, before they do harm |
//! | [`merge`] | accelerometer readings brought to the gyroscope's times |
//! | [`source`] | the source: one sensor with both, or a pair |
//!
//! Plain files do it all: attributes in `/sys/bus/iio/devices/iio:deviceN`, scans from `/dev/iio:deviceN`. No C library, no thread; nothing is allocated
//! once it runs. Inertial readings that come over USB without a kernel driver are `isobath-usb`'s.
//!
//! It needs the right to write the attributes (which switch channels and buffer on); an error says the udev line that gives it.

#[cfg(unix)]
pub mod device;
pub mod merge;
#[cfg(unix)]
pub mod source;
pub mod stamps;
#[cfg(unix)]
pub mod sysfs;

#[cfg(unix)]
pub use source::{IioImu, Options, open};
