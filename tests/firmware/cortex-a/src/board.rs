//! The board: start-up, the virtual counter as the clock, the stack, the console of the debugger. The only `unsafe` of the image.
#![allow(unsafe_code, reason = "start-up is assembly; statics are lent once, and the free stack is painted, below")]

use core::arch::{asm, global_asm};
use core::panic::PanicInfo;

use isobath_firmware_job::device::{Device, Everything};
use semihosting::process::ExitCode;
use semihosting::sys::arm_compat::sys_writec;

#[path = "../../paint.rs"]
mod paint;

static mut MEMORY: Everything = Everything::NEW;

/// Bytes left unpainted for the painter's own frame.
const GAP: usize = 256;

// Switches floating point on (CPACR_EL1.FPEN), sets the stack, zeroes `.bss`, calls `start`. The MMU stays off: memory is
// uncached then, which counts no instructions, and unaligned access faults, which the target's `strict-align` never does.
global_asm!(
    ".section .text.start, \"ax\"",
    ".global _start",
    "_start:",
    "mov x0, #(3 << 20)",
    "msr cpacr_el1, x0",
    "isb",
    "adrp x0, __stack_top",
    "add x0, x0, :lo12:__stack_top",
    "mov sp, x0",
    "adrp x0, __bss_start",
    "add x0, x0, :lo12:__bss_start",
    "adrp x1, __bss_end",
    "add x1, x1, :lo12:__bss_end",
    "2: cmp x0, x1",
    "b.hs 3f",
    "stp xzr, xzr, [x0], #16",
    "b 2b",
    "3: bl {start}",
    start = sym start,
);

extern "C" fn start() -> ! {
    crate::main()
}

/// The board.
pub(crate) struct Board {
    /// The counter when the clock was started.
    begin: u64,
    /// Where the stack was when it was painted.
    base: usize,
}

fn counter() -> u64 {
    let ticks: u64;
    // SAFETY: reads a counter.
    unsafe { asm!("isb", "mrs {}, cntvct_el0", out(reg) ticks, options(nomem, nostack, preserves_flags)) };
    ticks
}

impl Board {
    /// The board and all memory there is.
    pub(crate) fn take() -> (Self, &'static mut Everything) {
        let memory = &raw mut MEMORY;
        // SAFETY: called once, by `main`, which start-up calls once; so these are the only references to the static.
        let memory = unsafe { &mut *memory };
        (Self { begin: 0, base: 0 }, memory)
    }

    /// Ends the emulation.
    pub(crate) fn exit(self, passed: bool) -> ! {
        if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }.exit_process()
    }
}

impl Device for Board {
    // An instruction takes a nanosecond under `-icount shift=0`; the counter runs at 62.5 MHz.
    const INSTRUCTIONS: (u64, u64) = (16, 1);

    fn start(&mut self) {
        self.begin = counter();
    }

    fn ticks(&self) -> u64 {
        counter().wrapping_sub(self.begin)
    }

    #[inline(never)]
    fn paint(&mut self) {
        let sp: usize;
        // SAFETY: reads the stack pointer.
        unsafe { asm!("mov {}, sp", out(reg) sp, options(nomem, nostack, preserves_flags)) };
        self.base = sp;
        // SAFETY: free stack, below everything in use (the gap holds this function's frame; there are no interrupts),
        // above the statics: the stack has what they leave of 16 MiB.
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
        let turns = u64::from(instructions / 2);
        // SAFETY: counts a register down, two instructions a turn.
        unsafe { asm!("2: subs {0}, {0}, #1", "b.ne 2b", inout(reg) turns => _, options(nomem, nostack)) };
    }
}

/// Never linked where nothing panics; the compiler wants it all the same.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    ExitCode::FAILURE.exit_process()
}
