//! The simulated devices.

pub mod generic;
