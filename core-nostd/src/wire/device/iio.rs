//! Linux industrial I/O: what a channel's `type` file says, where channels lie in a scan, and the number in them.
//!
//! `scan_elements/in_accel_x_type` holds `le:s16/32>>0`: byte order, sign, bits that mean something, bits that are stored, how many values (`X3` for
//! a quaternion's), and by how many places the value is shifted up. Enabled channels follow each other in the order of their index, each at a
//! multiple of its own size; the whole is a multiple of the largest (kernel, `industrialio-buffer.c`).
//!
//! Bits beyond those that mean something hold anything: drivers of HID sensors leave the neighbour's value there. So a number is cut to its bits and
//! its sign extended from them.
//!
//! Memory: none. Cost: a load and three shifts a value. Exact.

use core::fmt;

use crate::wire::malformed::Malformed;

/// How a channel's value is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ChannelType {
    /// Most significant byte first.
    pub big_endian: bool,
    /// Negative values are in two's complement.
    pub signed: bool,
    /// Bits that mean something, 1 to 64.
    pub bits: u8,
    /// Bits stored: 8, 16, 32 or 64.
    pub storage: u8,
    /// Values in a row, 1 to 16.
    pub repeat: u8,
    /// Places the value is shifted up.
    pub shift: u8,
}

impl ChannelType {
    /// A time stamp: `le:s64/64>>0`.
    pub const TIMESTAMP: Self = Self { big_endian: false, signed: true, bits: 64, storage: 64, repeat: 1, shift: 0 };

    /// Reads the content of a `type` file: `[be|le]:[s|u]bits/storagebits[Xrepeat][>>shift]`, white space around it allowed.
    ///
    /// # Errors
    /// [`Malformed::Field`], with the byte where it goes wrong.
    ///
    /// ```
    /// use isobath::wire::device::iio::ChannelType;
    /// let kind = ChannelType::parse("le:s16/32>>0\n")?;
    /// // What a HID sensor gives for -2, with its neighbour in the upper half.
    /// assert_eq!(kind.value(&[0xfe, 0xff, 0x01, 0x00], 0), Some(-2));
    /// # Ok::<(), isobath::wire::malformed::Malformed>(())
    /// ```
    pub fn parse(text: &str) -> Result<Self, Malformed> {
        let bytes = text.trim_end_matches(['\0', '\n', ' ']).as_bytes();
        let skipped = bytes.iter().take_while(|b| **b == b' ').count();
        let mut cursor = Cursor { bytes, at: skipped };
        let big_endian = match (cursor.next(), cursor.next()) {
            (Some(b'b'), Some(b'e')) => true,
            (Some(b'l'), Some(b'e')) => false,
            _ => return Err(cursor.wrong("the byte order of an IIO channel type")),
        };
        cursor.expect(b':')?;
        let signed = match cursor.next() {
            Some(b's') => true,
            Some(b'u') => false,
            _ => return Err(cursor.wrong("the sign of an IIO channel type")),
        };
        let bits = cursor.number()?;
        cursor.expect(b'/')?;
        let storage = cursor.number()?;
        let mut repeat = 1;
        if cursor.peek() == Some(b'X') {
            cursor.at += 1;
            repeat = cursor.number()?;
        }
        let mut shift = 0;
        if cursor.peek().is_some() {
            cursor.expect(b'>')?;
            cursor.expect(b'>')?;
            shift = cursor.number()?;
        }
        if cursor.peek().is_some() {
            return Err(cursor.wrong("the end of an IIO channel type"));
        }
        let fits = matches!(storage, 8 | 16 | 32 | 64)
            && bits >= 1
            && u16::from(bits) + u16::from(shift) <= u16::from(storage)
            && (1..=16).contains(&repeat);
        if !fits {
            let got = u32::from(bits) << 16 | u32::from(storage);
            return Err(Malformed::Field { what: "the bits of an IIO channel type", at: 4, got });
        }
        Ok(Self { big_endian, signed, bits, storage, repeat, shift })
    }

    /// Bytes of the channel in a scan.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.storage as usize / 8 * self.repeat as usize
    }

    /// Value `index` (below `repeat`) of the channel's bytes; `None` when they end before it. A `u64` beyond [`i64::MAX`] wraps to
    /// a negative number; no sensor counts so far.
    #[must_use]
    pub fn value(&self, bytes: &[u8], index: usize) -> Option<i64> {
        let size = usize::from(self.storage / 8);
        let bytes = bytes.get(index.checked_mul(size)?..)?.get(..size)?;
        let mut word = 0_u64;
        for i in 0..size {
            let byte = if self.big_endian { bytes.get(i) } else { bytes.get(size - 1 - i) };
            word = word << 8 | u64::from(*byte?);
        }
        // Up to the top, and down again: what is above the value goes, and the sign comes.
        let up = 64_u32.checked_sub(u32::from(self.bits) + u32::from(self.shift))?;
        let top = (word.checked_shl(up)? >> self.shift.min(63)) << self.shift.min(63);
        let down = 64 - u32::from(self.bits);
        Some(if self.signed { top.cast_signed() >> down } else { (top >> down).cast_signed() })
    }
}

impl fmt::Display for ChannelType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (order, sign) = (if self.big_endian { "be" } else { "le" }, if self.signed { 's' } else { 'u' });
        write!(f, "{order}:{sign}{}/{}", self.bits, self.storage)?;
        if self.repeat > 1 {
            write!(f, "X{}", self.repeat)?;
        }
        write!(f, ">>{}", self.shift)
    }
}

/// A place in a text.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Cursor<'_> {
    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    fn next(&mut self) -> Option<u8> {
        let byte = self.peek();
        self.at += usize::from(byte.is_some());
        byte
    }

    fn wrong(&self, what: &'static str) -> Malformed {
        let at = self.at.saturating_sub(1);
        Malformed::Field { what, at, got: self.bytes.get(at).copied().unwrap_or(0).into() }
    }

    fn expect(&mut self, byte: u8) -> Result<(), Malformed> {
        if self.next() == Some(byte) { Ok(()) } else { Err(self.wrong("a separator of an IIO channel type")) }
    }

    fn number(&mut self) -> Result<u8, Malformed> {
        let mut value: Option<u8> = None;
        while let Some(digit) = self.peek().filter(u8::is_ascii_digit) {
            let next = value.unwrap_or(0).checked_mul(10).and_then(|v| v.checked_add(digit - b'0'));
            self.at += 1;
            value = Some(next.ok_or(self.wrong("a number of an IIO channel type"))?);
        }
        value.ok_or(self.wrong("a number of an IIO channel type"))
    }
}

/// Places channels, given in the order of their index, in a scan: where each begins goes into `offsets`; the answer is the bytes of a scan.
///
/// # Errors
/// [`Malformed::Full`] when `offsets` is shorter than `types`.
///
/// ```
/// use isobath::wire::device::iio::{ChannelType, layout};
/// let axis = ChannelType::parse("le:s16/16>>0")?;
/// let mut offsets = [0; 4];
/// let scan = layout(&[axis, axis, axis, ChannelType::TIMESTAMP], &mut offsets)?;
/// assert_eq!((offsets, scan), ([0, 2, 4, 8], 16));
/// # Ok::<(), isobath::wire::malformed::Malformed>(())
/// ```
pub fn layout(types: &[ChannelType], offsets: &mut [usize]) -> Result<usize, Malformed> {
    if offsets.len() < types.len() {
        return Err(Malformed::Full { what: "IIO scan layout", needed: types.len(), got: offsets.len() });
    }
    let (mut at, mut largest) = (0_usize, 1);
    for (kind, offset) in types.iter().zip(offsets) {
        let size = kind.bytes().max(1);
        at = at.next_multiple_of(size);
        *offset = at;
        at += size;
        largest = largest.max(size);
    }
    Ok(at.next_multiple_of(largest))
}

/// RealSense's motion modules, whose numbers the kernel's scales do not always fit (librealsense, `hid`): multiply raw values by these.
pub mod realsense {
    /// Accelerometer: metres per square second a step (a thousandth of standard gravity).
    pub const ACCEL: f32 = 0.001 * 9.806_65;
    /// Gyroscope: radians a second a step, firmware 5.16 and later (a ten-thousandth of a degree).
    pub const GYRO: f32 = 0.000_1 * core::f32::consts::PI / 180.0;
    /// Gyroscope: radians a second a step, firmware before 5.16 (a tenth of a degree), whose values are the low 16 bits of the cell
    /// whatever its type says.
    pub const GYRO_BEFORE_5_16: f32 = 0.1 * core::f32::consts::PI / 180.0;

    /// A channel type with its value cut to the low 16 bits: firmware before 5.16.
    #[must_use]
    pub const fn low_16(kind: super::ChannelType) -> super::ChannelType {
        super::ChannelType { bits: if kind.bits > 16 { 16 } else { kind.bits }, signed: true, ..kind }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::string::ToString;
    use std::vec;
    use std::vec::Vec;

    fn kind() -> impl Strategy<Value = ChannelType> {
        (any::<bool>(), any::<bool>(), 0_u32..4, 1_u8..=64, 0_u8..64, 1_u8..=16).prop_map(
            |(big_endian, signed, log, bits, shift, repeat)| {
                let storage = 8 << log;
                let bits = bits.min(storage);
                ChannelType { big_endian, signed, bits, storage, repeat, shift: shift.min(storage - bits) }
            },
        )
    }

    /// One bit at a time, from the bytes in the order of significance.
    fn reference(kind: &ChannelType, bytes: &[u8], index: usize) -> i128 {
        let size = usize::from(kind.storage) / 8;
        let mut bytes = bytes[index * size..(index + 1) * size].to_vec();
        if kind.big_endian {
            bytes.reverse();
        }
        let mut value = 0_i128;
        for bit in 0..usize::from(kind.bits) {
            let at = bit + usize::from(kind.shift);
            if bytes[at / 8] >> (at % 8) & 1 == 1 {
                value += 1 << bit;
                if kind.signed && bit + 1 == usize::from(kind.bits) {
                    value -= 1 << (bit + 1);
                }
            }
        }
        value
    }

    proptest! {
        #[test]
        fn types_come_back(kind in kind(), space in any::<bool>()) {
            let text = if space { std::format!(" {kind}\n\0") } else { kind.to_string() };
            prop_assert_eq!(ChannelType::parse(&text), Ok(kind));
        }

        #[test]
        fn values_are_those_of_their_bits(kind in kind(), bytes in prop::collection::vec(any::<u8>(), 128), index in 0_usize..16) {
            let got = kind.value(&bytes, index);
            let want = reference(&kind, &bytes, index);
            prop_assert_eq!(got, Some(want as i64));
            prop_assert_eq!(kind.value(&bytes[..usize::from(kind.storage) / 8 - 1], 0), None);
        }

        #[test]
        fn channels_neither_overlap_nor_misalign(kinds in prop::collection::vec(kind(), 0..12)) {
            let mut offsets = vec![usize::MAX; kinds.len()];
            let scan = layout(&kinds, &mut offsets).unwrap();
            let mut end = 0;
            for (kind, at) in kinds.iter().zip(&offsets) {
                prop_assert!(*at >= end && at.is_multiple_of(kind.bytes()) && *at < end + kind.bytes());
                end = at + kind.bytes();
            }
            prop_assert!(scan >= end);
            let largest = kinds.iter().map(ChannelType::bytes).max();
            prop_assert!(largest.is_none_or(|n| scan.is_multiple_of(n) && scan < end + n));
            if !kinds.is_empty() {
                prop_assert!(layout(&kinds, &mut offsets[1..]).is_err());
            }
        }

        #[test]
        fn any_text_is_a_type_or_refused(text in "[lbe:su0-9/X> ]{0,20}") {
            if let Ok(kind) = ChannelType::parse(&text) {
                prop_assert_eq!(ChannelType::parse(&kind.to_string()), Ok(kind));
            }
        }
    }

    #[test]
    fn what_is_no_type_is_refused() {
        let bad = [
            "",
            "l",
            "xe:s16/16>>0",
            "le s16/16>>0",
            "le:x16/16",
            "le:s/16",
            "le:s16",
            "le:s16/",
            "le:s17/16>>0",
            "le:s16/24>>0",
            "le:s0/16>>0",
            "le:s16/16>>1",
            "le:s16/16>0",
            "le:s16/16>>",
            "le:s16/16X>>0",
            "le:s16/16X0>>0",
            "le:s16/16X17>>0",
            "le:s16/16>>0x",
            "le:s300/16>>0",
            "le:s16/128>>0",
            "le:é16/16",
        ];
        for text in bad {
            assert!(ChannelType::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn realsense_quirks() {
        let cell = ChannelType::parse("le:s32/32>>0").unwrap();
        let bytes: Vec<u8> = vec![0xf6, 0xff, 0x01, 0x00];
        assert_eq!(cell.value(&bytes, 0), Some(0x1_fff6));
        assert_eq!(realsense::low_16(cell).value(&bytes, 0), Some(-10));
        assert!((realsense::GYRO_BEFORE_5_16 / realsense::GYRO - 1000.0).abs() < 0.01);
    }
}
