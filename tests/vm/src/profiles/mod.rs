//! The simulated devices.

pub mod d435;
pub mod generic;
pub mod headset;
pub mod kinect;
pub mod orbbec;
