//! What was wrong with a call: a code, and a text that says what to do.

use core::ffi::{CStr, c_char};

/// What a function returns: 0, or what is wrong with the call. What was found in the world is in the answer.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// The answer was written.
    Ok = 0,
    /// A pointer that must not be null is.
    ErrorNull = -1,
    /// A pointer is not aligned for what it points to; memory for a context, not to ISOBATH_ALIGNMENT.
    ErrorMisaligned = -2,
    /// Less memory than isobath_context_size says.
    ErrorTooLittleMemory = -3,
    /// A side of the image is 0 or above ISOBATH_MAX_SIDE, or the map has more than ISOBATH_MAX_CELLS cells or a side of 0.
    ErrorSize = -4,
    /// Bytes from row to row: below two a pixel, odd, or so large that the image would not fit in memory.
    ErrorStride = -5,
    /// A focal length or principal point is not usable: not finite, or a focal length below 0.001 px in size.
    ErrorCamera = -6,
    /// Metres per depth unit are not within 1e-6 to 1e3 (millimetres: 0.001).
    ErrorUnit = -7,
    /// A pose has a number that is not finite, or its quaternion's length is not 1 to 1 %.
    ErrorPose = -8,
    /// The map's cell size, axes or centre are not usable.
    ErrorGrid = -9,
    /// Not a context: never initialised, moved after it was, or overwritten.
    ErrorContext = -10,
    /// No frame has been pushed yet, or isobath_begin_frame has not been followed by isobath_end_frame.
    ErrorNoFrame = -11,
    /// The context was made without a map.
    ErrorNoMap = -12,
    /// A parameter is out of its documented range.
    ErrorParameter = -13,
    /// Memory that must not overlap the context does.
    ErrorOverlap = -14,
}

impl Status {
    const fn text(code: i32) -> &'static CStr {
        match code {
            0 => c"ok",
            -1 => c"a pointer is null",
            -2 => c"a pointer is misaligned (a context's memory wants ISOBATH_ALIGNMENT)",
            -3 => c"too little memory for a context: isobath_context_size says how much it takes",
            -4 => c"a side of the image or of the map is 0 or too large",
            -5 => c"the stride is below two bytes a pixel, odd, or too large; it counts bytes from row to row",
            -6 => c"camera intrinsics are not usable; focal lengths and principal point are in pixels",
            -7 => c"metres per depth unit must be within 0.000001 to 1000 (millimetres: 0.001)",
            -8 => c"the pose is not finite or its quaternion (x y z w) not of length 1",
            -9 => c"the map's cell size must be 0.001 to 1000 m, up and forward not parallel, its centre finite",
            -10 => c"not a context: never initialised, moved or overwritten",
            -11 => c"no frame yet: push one, or end the one that was begun",
            -12 => c"the context was made without a map",
            -13 => c"a parameter is out of range",
            -14 => c"memory overlaps the context",
            _ => c"unknown status",
        }
    }
}

/// A static, English, zero-terminated text for a status; never null, whatever the number.
#[unsafe(no_mangle)]
// SAFETY: the prefix `isobath_` is this library's; nothing else defines the name.
pub extern "C" fn isobath_status_text(status: i32) -> *const c_char {
    Status::text(status).as_ptr()
}

/// The library's version, as "0.1.0"; static, never null.
#[unsafe(no_mangle)]
// SAFETY: the prefix `isobath_` is this library's; nothing else defines the name.
pub extern "C" fn isobath_version() -> *const c_char {
    const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(text) => text,
        Err(_) => c"unknown",
    };
    VERSION.as_ptr()
}
