//! The board: SysTick as the clock, the stack, the console of the debugger. The only `unsafe` of the image.
#![allow(unsafe_code, reason = "statics are lent once, and the free stack is painted, below")]

use core::panic::PanicInfo;

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::register::msp;
use isobath_firmware_job::device::{Device, Everything};
use semihosting::process::ExitCode;
use semihosting::sys::arm_compat::sys_writec;

#[path = "../../paint.rs"]
mod paint;

static mut MEMORY: Everything = Everything::NEW;

/// SysTick counts 24 bits.
const TOP: u32 = 0xff_ffff;
/// Bytes left unpainted for the painter's own frame.
const GAP: usize = 128;

/// The board.
pub(crate) struct Board {
    clock: SYST,
    /// Where the stack was when it was painted.
    base: usize,
}

impl Board {
    /// The board and all memory there is.
    pub(crate) fn take() -> (Self, &'static mut Everything) {
        let memory = &raw mut MEMORY;
        // SAFETY: called once, by the entry, which nothing calls; so these are the only references to the static and to the
        // peripherals that are ever made.
        let (peripherals, memory) = unsafe { (cortex_m::Peripherals::steal(), &mut *memory) };
        let mut clock = peripherals.SYST;
        clock.set_clock_source(SystClkSource::Core);
        clock.set_reload(TOP);
        clock.clear_current();
        clock.enable_counter();
        (Self { clock, base: 0 }, memory)
    }

    /// Ends the emulation.
    pub(crate) fn exit(self, passed: bool) -> ! {
        if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }.exit_process()
    }
}

impl Device for Board {
    // An instruction takes a nanosecond under `-icount shift=0`; the M4 board's clock runs at 25 MHz, the M55 board's at 32.
    const INSTRUCTIONS: (u64, u64) = if cfg!(armv8m) { (125, 4) } else { (40, 1) };

    fn start(&mut self) {
        self.clock.clear_current();
    }

    fn ticks(&self) -> u64 {
        // Counts down from 0, which a write of any value sets.
        (TOP.wrapping_add(1).wrapping_sub(SYST::get_current()) & TOP).into()
    }

    #[inline(never)]
    fn paint(&mut self) {
        self.base = msp::read() as usize;
        // SAFETY: free stack, below everything in use (the gap holds this function's frame; there are no interrupts),
        // above the statics: the stack gets from the linker what they leave, which is more than is painted.
        unsafe { paint::paint(self.base, GAP) };
    }

    #[inline(never)]
    fn used(&self) -> usize {
        // SAFETY: as in `paint`.
        unsafe { paint::used(self.base, GAP) }
    }

    fn print(&mut self, text: &str) {
        text.bytes().for_each(sys_writec);
    }

    fn spend(&mut self, instructions: u32) {
        // Its loop is two instructions.
        cortex_m::asm::delay(instructions / 2);
    }
}

/// Never linked where nothing panics; the compiler wants it all the same.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    ExitCode::FAILURE.exit_process()
}
