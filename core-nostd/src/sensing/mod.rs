//! The sensing floor: what a depth value means, how a camera sees, what a frame carries.

pub mod camera;
pub mod depth;
pub mod frame;
