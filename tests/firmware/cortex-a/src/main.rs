//! The per-frame job on bare AArch64: the board virt with a Cortex-A53, in QEMU.
//!
//! Prints instructions and stack of every stage, compares every answer with the host's, and ends with exit code 0 when all are
//! equal. `cargo xtask firmware` runs it. All that is unsafe is in [`board`].
#![no_std]
#![no_main]
#![deny(unsafe_code)]

use isobath_firmware_job::device;
use isobath_firmware_stream::{CENTRE, LIGHT, LIGHT_ANSWERS, OTHERS, SCENES};

mod board;

/// Called by the start-up code.
fn main() -> ! {
    let (mut board, memory) = board::Board::take();
    let frames = SCENES.iter().map(|scene| (scene.frame, scene.answers));
    let passed = device::run(&mut board, memory, CENTRE, frames, OTHERS, (&LIGHT, LIGHT_ANSWERS));
    board.exit(passed)
}
