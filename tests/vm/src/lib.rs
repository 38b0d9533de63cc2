//! Simulated USB depth cameras, and what the tests of the drivers need in the guest.
//!
//! The drivers are tested on a real Linux kernel, in QEMU, with devices that the tests themselves play: a device is a piece of
//! Rust in the test's own process, plugged into the kernel's virtual host controller. So the kernel's USB stack, its camera
//! and sensor drivers and ours are the real ones, and the test says what the device does to them, frame by frame.
//!
//! ```text
//! test -> our driver -> /dev/video0 -> uvcvideo -> USB core -> vhci-hcd -> USB/IP -> the test's device (profiles)
//! ```
//!
//! | module | idea |
//! |---|---|
//! | [`usb`] | what every device does: descriptors, standard requests, transfers; plugging in |
//! | [`uvc`] | a camera: negotiation, payloads, extension units, faults tied to frames |
//! | [`hid`] | an accelerometer and a gyroscope as a HID sensor hub |
//! | [`pattern`] | what cameras see: every pixel of every frame known |
//! | [`profiles`] | the devices |
//! | `gadget` | a device on the kernel's own device side (feature `guest`) |
//! | `guest` | modules, nodes, programs (feature `guest`) |
//! | `watch` | what a source gives: frames by their numbers, gaps, errors (feature `guest`) |
//!
//! This library and its own tests need no guest. `cargo xtask vm` runs the rest; README.md says how.

#[cfg(feature = "guest")]
pub mod gadget;
#[cfg(feature = "guest")]
pub mod guest;
pub mod hid;
pub mod pattern;
pub mod profiles;
pub mod usb;
pub mod uvc;
#[cfg(feature = "guest")]
pub mod watch;
