//! Depth cameras and inertial sensors on USB that no kernel driver serves.
//!
//! | module | what |
//! |---|---|
//! | [`bulk`] | headset firmware that speaks [`isobath::wire::bulk`] on a bulk endpoint: depth, inertial readings, key frames |
//! | [`kinect1`] | Kinect v1: depth over isochronous transfers, in metres by the device's own constants |
//! | [`sys`] | what both need of USB, as a trait: libusb here, a script in the tests, another library if need be |
//! | [`link`] | a device that can be unplugged and come back |
#![cfg_attr(feature = "live", doc = "| [`live`] | libusb |")]
//!
//! The protocols are pure code over [`sys::UsbSys`]; real devices need the feature `live`, which builds libusb. A permission that is missing is an error
//! that says the udev line. Nothing waits beyond the deadline it was given, and nothing spins: a failing device is asked less and less often, one
//! that is gone is an end ([`SourceError::Disconnected`](isobath_source::SourceError::Disconnected)) or, when asked to
//! [reconnect](link::Options::reconnect), looked for five times a second until it is back.

pub mod bulk;
#[cfg(feature = "live")]
mod iso;
pub mod kinect1;
pub mod link;
#[cfg(feature = "live")]
pub mod live;
pub mod sys;
