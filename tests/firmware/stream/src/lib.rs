//! The depth stream of the images: a walk through a living room, then standing still, as a Kinect sees it. Rendered by
//! `build.rs` with isobath's simulator, whose bytes are the same everywhere; so is what the job says of them on the host. And key frames
//! around a virtual object in the same room, for its light.
#![no_std]
#![forbid(unsafe_code)]

use isobath_firmware_job::{Packed, Surroundings, View};

/// A frame and what the host says of it: the bits of [`Answers`](isobath_firmware_job::Answers)' numbers.
#[derive(Debug)]
pub struct Scene {
    /// What the device gets.
    pub frame: Packed<'static>,
    /// What it must say.
    pub answers: &'static [u32],
}

include!(concat!(env!("OUT_DIR"), "/stream.rs"));
