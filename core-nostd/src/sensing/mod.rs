//! The sensing floor: what a depth value means, how a camera sees, what a frame carries, where its points are,
//! and what an inertial sensor adds: orientation, gravity, delay.

pub mod camera;
pub mod depth;
pub mod frame;
pub mod imu;
pub mod points;
