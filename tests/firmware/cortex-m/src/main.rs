//! The per-frame job on Cortex-M: mps2-an386 (Cortex-M4F) and mps3-an547 (Cortex-M55), in QEMU.
//!
//! Prints instructions and stack of every stage, compares every answer with the host's, and ends with exit code 0 when all are
//! equal. `cargo xtask firmware` runs it. All that is unsafe is in [`board`].
#![no_std]
#![no_main]
#![deny(unsafe_code)]

use isobath_firmware_job::device;
use isobath_firmware_stream::{CENTRE, LIGHT, LIGHT_ANSWERS, OTHERS, SCENES};

mod board;

#[cortex_m_rt::entry]
fn main() -> ! {
    let (mut board, memory) = board::Board::take();
    let frames = SCENES.iter().map(|scene| (scene.frame, scene.answers));
    // The negative control: the answers of a frame are not those of the frame before it.
    #[cfg(feature = "with-fault")]
    let frames = frames.clone().zip(frames.skip(1)).map(|((frame, _), (_, answers))| (frame, answers));
    let passed = device::run(&mut board, memory, CENTRE, frames, OTHERS, (&LIGHT, LIGHT_ANSWERS));
    board.exit(passed)
}
