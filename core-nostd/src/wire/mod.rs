//! The edges: forms in which frames travel or lie in flash, and what devices say. Bytes from outside are checked before they
//! are believed.
//!
//! | module | whose words |
//! |---|---|
//! | [`keyframe`], [`rvl`] | frames for another machine, small |
//! | [`bulk`] | headset firmware to host: depth, inertial readings, calibration, key frames on one pipe |
//! | [`device`] | cameras and sensors that others make: UVC, RealSense, Orbbec, Kinect v1, Linux IIO |
//! | [`crc`], [`malformed`] | what they share |

pub mod bulk;
pub mod crc;
pub mod device;
pub mod keyframe;
pub mod malformed;
pub mod rvl;
