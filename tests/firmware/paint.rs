//! How deep the stack went: free stack is painted, and later the paint that is left is counted. Both boards have it as a module.

/// What is written into the free stack.
const PAINT: u32 = 0x5afe_57ac;
/// Bytes below the stack pointer that are painted: twice what the localized job may use on the M4.
const PAINTED: usize = 16 * 1024;

/// Paints below the stack pointer, all but the `gap` that holds the painter's own frame.
///
/// # Safety
/// [`PAINTED`] bytes below `sp` are free stack but for the `gap`, and no interrupt uses them meanwhile.
#[inline(always)]
pub(crate) unsafe fn paint(sp: usize, gap: usize) {
    for at in (sp - PAINTED..sp - gap).step_by(4) {
        // SAFETY: the caller's promise.
        unsafe { (at as *mut u32).write_volatile(PAINT) };
    }
}

/// Bytes below the stack pointer of the painter that have been used since.
///
/// # Safety
/// As [`paint`], with its arguments.
#[inline(always)]
pub(crate) unsafe fn used(sp: usize, gap: usize) -> usize {
    // SAFETY: the caller's promise; reading plain memory.
    let clean =
        (sp - PAINTED..sp - gap).step_by(4).take_while(|at| unsafe { (*at as *const u32).read_volatile() } == PAINT);
    PAINTED - 4 * clean.count()
}
