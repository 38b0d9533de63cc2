//! The per-frame job of a device: from a compressed frame to answers, with all its memory in one `static`.
//!
//! The images for Cortex-M and AArch64 and the program on the host run this same code on the same frames; the host's answers are
//! compiled into the images, which compare. Nothing here knows a device: time and stack are measured by a [`Probe`].
//!
//! [`memory`] is what the job keeps, [`frame`] what it is given, [`run`] what it does, [`answers`] what it says, [`lighting`] an
//! object's light from key frames, [`others`] the capabilities of the core that are measured though the job does without them, [`device`] the run that measures and prints, [`sizes`] the bytes it
//! prints.
#![no_std]
#![forbid(unsafe_code)]

pub mod answers;
pub mod device;
pub mod frame;
pub mod lighting;
pub mod memory;
pub mod others;
pub mod run;
pub mod sizes;

pub use answers::{Answers, Check};
pub use frame::{Packed, View};
pub use lighting::{LightMemory, Surroundings};
pub use memory::{H, Memory, W};
pub use run::{Job, Refused};

/// A part of the work that is measured by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stage {
    /// Its name in the table of results.
    pub name: &'static str,
    /// How often it does what it is named after.
    pub times: u32,
    /// Of what the cost is told: pixels, hits, places.
    pub unit: &'static str,
    /// Whether it belongs to the localized job that the budget is for.
    pub budgeted: bool,
}

/// Measures stages. The images count instructions and the stack's high-water mark; the host measures nothing.
pub trait Probe {
    /// Runs one stage.
    fn stage<R>(&mut self, stage: Stage, work: impl FnOnce() -> R) -> R;
}

/// Measures nothing.
#[derive(Debug, Clone, Copy)]
pub struct Unmeasured;

impl Probe for Unmeasured {
    fn stage<R>(&mut self, _: Stage, work: impl FnOnce() -> R) -> R {
        work()
    }
}
