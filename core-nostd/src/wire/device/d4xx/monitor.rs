//! The hardware monitor: a question is written into a control of the UVC extension unit, the answer read from the same.
//!
//! ```text
//! question: 0 u16 bytes behind the first four   2 u16 0xCDAB   4 u32 opcode   8 u32 x 4 parameters   24 data
//! answer:   0 u32 the opcode again, or an error number   4 data   1020 u32 how many bytes of data
//! ```
//!
//! Both fill the control's 1024 bytes. The count at 1020 is the device's word, and checked: a count beyond the control is refused (librealsense
//! believes it). Only questions that change nothing can be asked here.

use crate::wire::malformed::{Bytes, Malformed, Writer};

/// Bytes of the control, in both directions.
pub const CONTROL: usize = 1024;
/// Id of the extension unit.
pub const UNIT: u8 = 3;
/// The control's selector in it.
pub const SELECTOR: u8 = 1;
/// The extension unit's GUID as descriptors spell it. Cameras of other makers use it too: know a camera by its vendor and product.
pub const GUID: [u8; 16] =
    [0xcb, 0x6c, 0x60, 0xc9, 0x4c, 0x59, 0x25, 0x4d, 0xaf, 0x47, 0xcc, 0xc4, 0x96, 0x43, 0x59, 0x95];

const MAGIC: u16 = 0xcdab;
const HEADER: usize = 24;
const COUNT_AT: usize = CONTROL - 4;

/// Questions that can be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
#[non_exhaustive]
pub enum Opcode {
    /// Reads device memory: first parameter the address, second the one behind the last.
    MemoryRead = 0x01,
    /// Versions, serial number, what is built in: [`Gvd`](super::tables::Gvd).
    Gvd = 0x10,
    /// A calibration table: first parameter its number.
    Calibration = 0x15,
    /// Temperatures.
    Temperature = 0x2a,
    /// An "advanced" control: first parameter its number ([`DEPTH_TABLE`]), second 0 value, 1 least, 2 most.
    Advanced = 0x2c,
    /// A table of the EEPROM by number: motion calibration.
    Eeprom = 0x4f,
    /// Extrinsics between the sensors.
    Extrinsics = 0x53,
    /// How several cameras are synchronised.
    Sync = 0x6a,
    /// Rectified intrinsics of every resolution (firmware 5.11.9.5 and later).
    RectifiedParams = 0x7e,
}

/// The advanced control that holds the depth unit.
pub const DEPTH_TABLE: u32 = 9;
/// The depth camera's calibration table.
pub const DEPTH_CALIBRATION: u32 = 25;
/// The colour camera's calibration table.
pub const COLOUR_CALIBRATION: u32 = 32;

/// Writes a question.
///
/// ```
/// use isobath::wire::device::d4xx::monitor::{Opcode, answer, question};
/// let control = question(Opcode::Calibration, [25, 0, 0, 0]);
/// assert_eq!(control[..9], [20, 0, 0xab, 0xcd, 0x15, 0, 0, 0, 25]);
/// // What a device that knows nothing would say.
/// assert!(answer(Opcode::Calibration, &[0xff; 1024]).is_err());
/// ```
#[must_use]
pub fn question(opcode: Opcode, parameters: [u32; 4]) -> [u8; CONTROL] {
    let mut control = [0; CONTROL];
    let mut writer = Writer::new("hardware monitor question", &mut control);
    let written = (|| {
        writer.u16((HEADER - 4) as u16)?;
        writer.u16(MAGIC)?;
        writer.u32(opcode as u32)?;
        parameters.iter().try_for_each(|p| writer.u32(*p))
    })();
    debug_assert!(written.is_ok(), "24 bytes fit 1024");
    control
}

/// The opcode and parameters of a question: what a simulated device needs.
///
/// # Errors
/// [`Malformed`]: cut off, or not a question.
pub fn parse_question(control: &[u8]) -> Result<(u32, [u32; 4]), Malformed> {
    let read = Bytes::new("hardware monitor question", control);
    let magic = read.u16(2)?;
    if magic != MAGIC {
        return Err(Malformed::Field { what: "the magic of a hardware monitor question", at: 2, got: magic.into() });
    }
    Ok((read.u32(4)?, [read.u32(8)?, read.u32(12)?, read.u32(16)?, read.u32(20)?]))
}

/// The data of an answer.
///
/// # Errors
/// [`Malformed::Refused`] with the device's error number, which is negative; [`Malformed::OtherReply`] when it answers another
/// question; [`Malformed`] when the control or its data is cut off, or the count is beyond the control.
pub fn answer(opcode: Opcode, control: &[u8]) -> Result<&[u8], Malformed> {
    let read = Bytes::new("hardware monitor answer", control);
    let (echo, count) = (read.i32(0)?, read.u32(COUNT_AT)?);
    if echo < 0 {
        return Err(Malformed::Refused { what: "a hardware monitor command", code: echo });
    }
    let asked = opcode as u32;
    if echo.cast_unsigned() != asked {
        return Err(Malformed::OtherReply { asked, got: echo.cast_unsigned() });
    }
    let length = usize::try_from(count).unwrap_or(usize::MAX);
    if length > COUNT_AT - 4 {
        let what = "the byte count of a hardware monitor answer";
        return Err(Malformed::Field { what, at: COUNT_AT, got: count });
    }
    read.slice(4, length)
}

/// An answer, as a simulated device gives it: `data` of at most 1016 bytes.
///
/// # Errors
/// [`Malformed::Full`].
pub fn write_answer(opcode: u32, data: &[u8]) -> Result<[u8; CONTROL], Malformed> {
    let mut control = [0; CONTROL];
    let needed = data.len().saturating_add(8);
    if needed > CONTROL {
        return Err(Malformed::Full { what: "hardware monitor answer", needed, got: CONTROL });
    }
    let mut writer = Writer::new("hardware monitor answer", &mut control);
    writer.u32(opcode)?;
    writer.bytes(data)?;
    writer.amend(COUNT_AT, &(data.len() as u32).to_le_bytes());
    Ok(control)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn answers_come_back(data in prop::collection::vec(any::<u8>(), 0..=1016), lie in any::<u32>()) {
            let mut control = write_answer(Opcode::Gvd as u32, &data).unwrap();
            prop_assert_eq!(answer(Opcode::Gvd, &control), Ok(&data[..]));
            prop_assert_eq!(
                answer(Opcode::Sync, &control),
                Err(Malformed::OtherReply { asked: 0x6a, got: 0x10 })
            );
            control[COUNT_AT..].copy_from_slice(&lie.to_le_bytes());
            match answer(Opcode::Gvd, &control) {
                Ok(data) => prop_assert_eq!(data.len() as u32, lie),
                Err(e) => {
                    let what = "the byte count of a hardware monitor answer";
                    prop_assert_eq!(e, Malformed::Field { what, at: COUNT_AT, got: lie });
                    prop_assert!(lie > 1016);
                }
            }
        }

        #[test]
        fn questions_come_back(parameters in any::<[u32; 4]>()) {
            let control = question(Opcode::Advanced, parameters);
            prop_assert_eq!(parse_question(&control), Ok((0x2c, parameters)));
            prop_assert_eq!(u16::from_le_bytes([control[0], control[1]]), 20);
        }
    }

    #[test]
    fn refusals_keep_their_number_and_short_controls_are_refused() {
        let control = write_answer((-12_i32).cast_unsigned(), &[]).unwrap();
        assert!(matches!(answer(Opcode::Gvd, &control), Err(Malformed::Refused { code: -12, .. })));
        for length in [0, 3, 4, 1020, 1023] {
            let control = write_answer(Opcode::Gvd as u32, &[]).unwrap();
            assert!(matches!(answer(Opcode::Gvd, &control[..length]), Err(Malformed::TooShort { .. })), "{length}");
        }
        assert!(write_answer(0x10, &[0; 1017]).is_err());
        assert!(parse_question(&[0; 24]).is_err());
    }
}
