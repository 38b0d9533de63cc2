//! The sizes of the paper's key frames (LitAR, section 5.1.3), to compare with.
//!
//! They follow from its two figures: 270,389 bytes are a byte, 52 bytes of tracking (twelve floats of a 3 x 4 pose and four bytes
//! more), 73,728 bytes of colour and 196,608 of depth; 1,189 are a byte, 36 bytes of a 3 x 3 rotation, and 1,152 of colour.

/// Bytes of a near frame: YCbCr 4:2:0 and `f32` depth, nothing left out.
///
/// ```
/// use isobath::wire::keyframe::paper;
/// assert_eq!(paper::near_bytes(256, 192), 270_389);
/// ```
#[must_use]
pub const fn near_bytes(width: usize, height: usize) -> usize {
    1 + 4 + 12 * 4 + colour_bytes(width, height) + width * height * 4
}

/// Bytes of a far frame: YCbCr 4:2:0.
///
/// ```
/// use isobath::wire::keyframe::paper;
/// assert_eq!(paper::far_bytes(32, 24), 1_189);
/// ```
#[must_use]
pub const fn far_bytes(width: usize, height: usize) -> usize {
    1 + 9 * 4 + colour_bytes(width, height)
}

const fn colour_bytes(width: usize, height: usize) -> usize {
    width * height + 2 * (width.div_ceil(2) * height.div_ceil(2))
}
