//! Kinect v1 over USB: the registers that start its depth camera, the constants that make its codes depth, and the packets that carry them.
//!
//! Commands are [`gmrb`](super::gmrb)'s, in vendor control transfers to the device (request 0, value 0, index 0): the question out, then the answer in, asked
//! for again while it is empty or 512 bytes long. Depth comes from the isochronous endpoint 0x82: see [`packets`]. (libfreenect, `cameras.c`,
//! `flags.c`, `registration.c`.)

pub mod packets;

use crate::sensing::depth::decode::kinect::Constants;
use crate::wire::malformed::{Bytes, Malformed};

/// Microsoft.
pub const VENDOR: u16 = 0x045e;
/// The cameras of Kinect for Xbox 360 and of Kinect for Windows.
pub const PRODUCTS: [u16; 2] = [0x02ae, 0x02bf];
/// The isochronous endpoint of depth.
pub const DEPTH_ENDPOINT: u8 = 0x82;
/// Width and height of depth.
pub const SIZE: (usize, usize) = (640, 480);
/// Bytes of a frame of depth, 11 bits a pixel.
pub const FRAME_BYTES: usize = SIZE.0 * SIZE.1 * 11 / 8;
/// Bytes of a row.
pub const ROW_BYTES: usize = SIZE.0 * 11 / 8;
/// Longest answer to a command; one as long as this means "ask again".
pub const ANSWER_BYTES: usize = 0x200;

/// Reads a register: payload its number; the answer's data its value.
pub const READ_REGISTER: u16 = 2;
/// Writes a register: payload its number and its value.
pub const WRITE_REGISTER: u16 = 3;
/// The constants of the reference plane: [`FIXED_PARAMS_PAYLOAD`], [`constants`].
pub const FIXED_PARAMS: u16 = 4;
/// Other constants: [`algorithm_params_payload`], [`constants`].
pub const ALGORITHM_PARAMS: u16 = 0x16;

/// Register and value, in this order, start depth of 11 bits at 30 frames a second: the projector does not cycle, depth off, 11 bits, 640x480,
/// 30 Hz, depth on, not mirrored.
pub const START_DEPTH: [(u16, u16); 7] =
    [(0x105, 0), (0x06, 0), (0x12, 3), (0x13, 1), (0x14, 0x1e), (0x06, 2), (0x17, 0)];
/// Register and value stop depth.
pub const STOP_DEPTH: (u16, u16) = (0x06, 0);

/// Payload of a command that writes a register.
#[must_use]
pub const fn write_register_payload(register: u16, value: u16) -> [u8; 4] {
    let ([a, b], [c, d]) = (register.to_le_bytes(), value.to_le_bytes());
    [a, b, c, d]
}

/// Payload of [`FIXED_PARAMS`]: from the beginning.
pub const FIXED_PARAMS_PAYLOAD: [u8; 10] = [0; 10];

/// Payload of [`ALGORITHM_PARAMS`]: parameter 0 is the constant shift, for 640x480 at 30 Hz.
#[must_use]
pub const fn algorithm_params_payload(parameter: u16) -> [u8; 10] {
    let [a, b] = parameter.to_le_bytes();
    [a, b, 0, 0, 1, 0, 30, 0, 0, 0]
}

/// Where the constants stand in the payload (status included) of the answer to [`FIXED_PARAMS`].
const FIXED_AT: usize = 94;

/// Reads what [`FIXED_PARAMS`] and [`ALGORITHM_PARAMS`] answer, payloads with their status, into the constants of the depth formula.
///
/// # Errors
/// [`Malformed`]: cut off, or numbers that no such camera has.
pub fn constants(fixed_params: &[u8], shift: &[u8]) -> Result<Constants, Malformed> {
    let read = Bytes::new("fixed parameters of the Kinect", fixed_params);
    // The third distance is the colour camera's.
    let [baseline, _, distance, pixel_size] = read.floats(FIXED_AT)?;
    let shift = Bytes::new("constant shift of the Kinect", shift).u16(2)?;
    // Centimetres: half to twice what has been seen.
    let bounds = [
        ("the Kinect's baseline", 0, baseline, 3.0..15.0),
        ("the Kinect's reference distance", 8, distance, 30.0..300.0),
        ("the Kinect's pixel size", 12, pixel_size, 0.02..0.5),
    ];
    for (what, at, value, range) in bounds {
        if !range.contains(&value) {
            return Err(Malformed::Field { what, at: FIXED_AT + at, got: value.to_bits() });
        }
    }
    Ok(Constants { baseline, distance, pixel_size, shift: f32::from(shift) })
}

/// The payloads that [`constants`] reads: what a simulated device answers.
#[must_use]
pub fn encode_constants(constants: &Constants) -> ([u8; 322], [u8; 4]) {
    let mut fixed = [0; 322];
    let values = [constants.baseline, 2.3, constants.distance, constants.pixel_size];
    if let Some(place) = fixed.get_mut(FIXED_AT..) {
        for (place, value) in place.as_chunks_mut::<4>().0.iter_mut().zip(values) {
            *place = value.to_le_bytes();
        }
    }
    let [a, b] = (constants.shift as u16).to_le_bytes();
    (fixed, [0, 0, a, b])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_come_back() {
        let (fixed, shift) = encode_constants(&Constants::NOMINAL);
        assert_eq!(constants(&fixed, &shift), Ok(Constants::NOMINAL));
        for length in 0..FIXED_AT + 16 {
            assert!(matches!(constants(&fixed[..length], &shift), Err(Malformed::TooShort { .. })));
        }
        assert!(constants(&fixed, &shift[..3]).is_err());
        for at in [FIXED_AT, FIXED_AT + 8, FIXED_AT + 12] {
            for value in [0.0, -1.0, 1e9, f32::NAN, f32::INFINITY] {
                let mut bad = fixed;
                bad[at..at + 4].copy_from_slice(&value.to_le_bytes());
                assert!(matches!(constants(&bad, &shift), Err(Malformed::Field { .. })), "{at} {value}");
            }
        }
    }

    #[test]
    fn a_frame_is_as_long_as_it_is() {
        assert_eq!((FRAME_BYTES, ROW_BYTES), (422_400, 880));
        assert_eq!(write_register_payload(0x105, 3), [5, 1, 3, 0]);
        assert_eq!(algorithm_params_payload(0x40)[..2], [0x40, 0]);
    }
}
