//! Which frames to gather, and where to look for them (LitAR, section 4.3): few, sharp, from all sides.
//!
//! | file | question |
//! |---|---|
//! | [`guided`] | where should the user look so that the light from behind is known? |
//! | [`motion`] | is this frame worth capturing: sharp, and new in place or in time? |
//! | [`views`] | is this a view that was captured before, and which one does it replace? |
//!
//! They take poses, times and readings of the IMU, never pixels: some hundred operations a frame.

pub mod guided;
pub mod motion;
pub mod views;
