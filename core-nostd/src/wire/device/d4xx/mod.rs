//! Intel RealSense D400 cameras (D415, D435, D455, D405 and their kin): what their extension unit and their frames say.
//!
//! | module | what |
//! |---|---|
//! | [`monitor`] | the "hardware monitor": one control of 1024 bytes that carries questions and answers |
//! | [`tables`] | calibration tables 25 (depth) and 32 (colour), their CRC, device data (GVD), the depth unit |
//! | [`intrinsics`] | the pinhole of depth and colour at any resolution, made from them |
//! | [`metadata`] | what comes with each frame: counter, exposure, laser |
//!
//! Layouts are librealsense's (`src/ds`, Apache-2.0) and the kernel's (`metafmt-d4xx.rst`). Depth of these cameras is rectified: without
//! distortion, in the left infrared camera's frame.

pub mod intrinsics;
pub mod metadata;
pub mod monitor;
pub mod tables;
