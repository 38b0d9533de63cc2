//! Pointers from C, before anything is done with them: null and misaligned ones are errors.
//!
//! Structs are read and written whole, by copy: no reference to the caller's memory outlives a line here.

use crate::status::Status;

/// A pointer that may be read or written as `T`, as far as can be seen from here.
pub(crate) fn aligned<T>(pointer: *const T) -> Result<(), Status> {
    if pointer.is_null() {
        Err(Status::ErrorNull)
    } else if !pointer.is_aligned() {
        Err(Status::ErrorMisaligned)
    } else {
        Ok(())
    }
}

/// A copy of what the caller points to.
///
/// # Safety
/// `pointer` is null, misaligned, or points to a `T` that nothing writes meanwhile; every bit pattern of `T` is valid.
pub(crate) unsafe fn read<T: Plain>(pointer: *const T) -> Result<T, Status> {
    aligned(pointer)?;
    // SAFETY: not null, aligned; the caller of this function promises the rest.
    Ok(unsafe { pointer.read() })
}

/// As [`read`], with null for "the default".
///
/// # Safety
/// As for [`read`].
pub(crate) unsafe fn read_or<T: Plain>(pointer: *const T, default: T) -> Result<T, Status> {
    if pointer.is_null() {
        return Ok(default);
    }
    // SAFETY: promised by the caller of this function.
    unsafe { read(pointer) }
}

/// Structs of numbers alone: whatever bytes C left in them, reading them is defined.
///
/// # Safety
/// Every bit pattern is a value, and there is no padding.
pub(crate) unsafe trait Plain: Copy {}

/// Asks first whether the answer can be written, then for the answer, then writes it: on an error it is left as it was.
///
/// # Safety
/// `out` is null, misaligned, or points to memory for a `T` that nothing else uses meanwhile.
pub(crate) unsafe fn answer<T>(out: *mut T, make: impl FnOnce() -> Result<T, Status>) -> Status {
    if let Err(status) = aligned(out) {
        return status;
    }
    match make() {
        Ok(value) => {
            // SAFETY: not null, aligned; the caller of this function promises the rest. `make` has returned, so that no view
            // of a context is alive, should `out` lie in one.
            unsafe { out.write(value) };
            Status::Ok
        }
        Err(status) => status,
    }
}

/// Makes a `Result` of nothing a status.
pub(crate) fn done(result: Result<(), Status>) -> Status {
    match result {
        Ok(()) => Status::Ok,
        Err(status) => status,
    }
}
