//! Calibration tables, device data and the depth unit, as the hardware monitor gives them.
//!
//! A table has 16 bytes of header: version (big-endian), number, bytes that follow, a parameter, and the CRC-32 of those bytes. The CRC is checked
//! before anything is believed. (`src/ds/d400/d400-private.h` and `ds-private.h` of librealsense.)

use crate::sensing::depth::DepthUnit;
use crate::wire::crc::crc32;
use crate::wire::malformed::{Bytes, Malformed};

const HEADER: usize = 16;

/// A calibration table whose CRC is right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Table<'a> {
    /// Its version, major and minor.
    pub version: [u8; 2],
    /// Its number.
    pub number: u16,
    /// The table, header included: the offsets of the layouts count from here.
    pub bytes: &'a [u8],
}

impl<'a> Table<'a> {
    /// Checks a table.
    ///
    /// # Errors
    /// [`Malformed::TooShort`], [`Malformed::Crc`].
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Malformed> {
        let what = "RealSense calibration table";
        let read = Bytes::new(what, bytes);
        let (version, number) = (read.array(0)?, read.u16(2)?);
        let (size, said) = (read.u32(4)?, read.u32(12)?);
        let size = usize::try_from(size).unwrap_or(usize::MAX);
        let payload = read.slice(HEADER, size)?;
        let computed = crc32(payload);
        if computed != said {
            return Err(Malformed::Crc { what, said, computed });
        }
        let bytes = read.slice(0, HEADER + size)?;
        Ok(Self { version, number, bytes })
    }

    fn numbered(bytes: &'a [u8], number: u16) -> Result<Bytes<'a>, Malformed> {
        let table = Self::parse(bytes)?;
        if table.number != number {
            let what = "the number of a RealSense calibration table";
            return Err(Malformed::Field { what, at: 2, got: table.number.into() });
        }
        Ok(Bytes::new("RealSense calibration table", table.bytes))
    }
}

/// Writes a table's header before its payload, for simulated devices: `table` is header and payload, of which the header is overwritten.
///
/// # Errors
/// [`Malformed::Full`] for fewer bytes than a header has.
pub fn seal(number: u16, table: &mut [u8]) -> Result<(), Malformed> {
    let got = table.len();
    let Some((header, payload)) = table.split_first_chunk_mut::<HEADER>() else {
        return Err(Malformed::Full { what: "RealSense calibration table", needed: HEADER, got });
    };
    let [n0, n1] = number.to_le_bytes();
    let [s0, s1, s2, s3] = (payload.len() as u32).to_le_bytes();
    let [c0, c1, c2, c3] = crc32(payload).to_le_bytes();
    *header = [1, 0, n0, n1, s0, s1, s2, s3, 0, 0, 0, 0, c0, c1, c2, c3];
    Ok(())
}

/// Table 25: the stereo pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthTable {
    /// The left camera's matrix, normalised, as stored.
    pub left: [f32; 9],
    /// The right camera's.
    pub right: [f32; 9],
    /// Rotation of the rectified frame in the left camera's.
    pub left_rotation: [f32; 9],
    /// In the right camera's.
    pub right_rotation: [f32; 9],
    /// Distance between the cameras, metres, positive.
    pub baseline: f32,
    /// fx, fy, cx, cy in pixels of the rectified image, of each of the sixteen resolutions of
    /// [`RESOLUTIONS`](super::intrinsics::RESOLUTIONS).
    pub rectified: [[f32; 4]; 16],
}

impl DepthTable {
    /// Bytes of the table with its header.
    pub const BYTES: usize = 576;

    /// Reads and checks it.
    ///
    /// # Errors
    /// [`Malformed`]: cut off, damaged, another table, or a baseline that is not a length.
    pub fn parse(bytes: &[u8]) -> Result<Self, Malformed> {
        let read = Table::numbered(bytes, 25)?;
        // As long as the layout, though its end is reserved.
        read.slice(0, Self::BYTES)?;
        let baseline = read.f32(160)?.abs() * 1e-3;
        if !(1e-3..10.0).contains(&baseline) {
            let what = "the baseline of a RealSense camera";
            return Err(Malformed::Field { what, at: 160, got: read.u32(160)? });
        }
        let mut rectified = [[0.0; 4]; 16];
        for (i, k) in rectified.iter_mut().enumerate() {
            *k = read.floats(256 + 16 * i)?;
        }
        Ok(Self {
            left: read.floats(16)?,
            right: read.floats(52)?,
            left_rotation: read.floats(88)?,
            right_rotation: read.floats(124)?,
            baseline,
            rectified,
        })
    }
}

/// Table 32: the colour camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourTable {
    /// Its matrix, row by row, in units where the image spans -1 to 1.
    pub k: [f32; 9],
    /// Brown-Conrady k1, k2, p1, p2, k3, of the inverse map.
    pub distortion: [f32; 5],
    /// Width and height that it was calibrated at.
    pub size: (u16, u16),
    /// Its rotation, as stored: columns, of the map from colour to depth.
    pub rotation: [f32; 9],
    /// Its translation in the same map, metres.
    pub translation: [f32; 3],
}

impl ColourTable {
    /// Bytes of the table with its header.
    pub const BYTES: usize = 256;

    /// Reads and checks it.
    ///
    /// # Errors
    /// [`Malformed`]: cut off, damaged, another table, or calibrated at no size.
    pub fn parse(bytes: &[u8]) -> Result<Self, Malformed> {
        let read = Table::numbered(bytes, 32)?;
        read.slice(0, Self::BYTES)?;
        let size = (read.u16(144)?, read.u16(146)?);
        if size.0 == 0 || size.1 == 0 {
            return Err(Malformed::Field { what: "the size of a colour calibration", at: 144, got: read.u32(144)? });
        }
        let translation: [f32; 3] = read.floats(220)?;
        Ok(Self {
            k: read.floats(16)?,
            distortion: read.floats(52)?,
            size,
            rotation: read.floats(184)?,
            // Millimetres, the other way round.
            translation: translation.map(|mm| -1e-3 * mm),
        })
    }
}

/// Device data ("GVD").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gvd {
    /// Firmware version, major first.
    pub firmware: [u8; 4],
    /// Whether the camera is locked against calibration.
    pub locked: bool,
    /// Serial number: written as twelve hexadecimal digits.
    pub serial: [u8; 6],
    /// The kind of depth sensor, the maker's number.
    pub depth_sensor: u8,
    /// Whether there is a projector.
    pub projector: bool,
    /// The kind of colour sensor; 0 without one.
    pub colour_sensor: u8,
    /// The kind of motion sensor; 0 without one.
    pub motion_sensor: u8,
}

impl Gvd {
    /// Reads it.
    ///
    /// # Errors
    /// [`Malformed::TooShort`].
    pub fn parse(bytes: &[u8]) -> Result<Self, Malformed> {
        let read = Bytes::new("RealSense device data", bytes);
        let [build, patch, minor, major] = read.array(12)?;
        Ok(Self {
            firmware: [major, minor, patch, build],
            locked: read.u8(25)? != 0,
            serial: read.array(48)?,
            depth_sensor: read.u8(166)?,
            projector: read.u8(170)? != 0,
            colour_sensor: read.u8(174)?,
            motion_sensor: read.u8(178)?,
        })
    }
}

/// The "depth table" control: the depth unit, and the bounds of what the camera gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthControl {
    /// Metres a step.
    pub unit: DepthUnit,
    /// Smallest depth given, in steps.
    pub least: i32,
    /// Largest, in steps.
    pub most: i32,
    /// What disparities are multiplied by, when the camera gives those.
    pub disparity_multiplier: i32,
    /// What is subtracted from disparities.
    pub disparity_shift: i32,
}

impl DepthControl {
    /// Reads it.
    ///
    /// # Errors
    /// [`Malformed`]: cut off, or a unit that is none.
    pub fn parse(bytes: &[u8]) -> Result<Self, Malformed> {
        let read = Bytes::new("RealSense depth control", bytes);
        let micrometres = read.u32(0)?;
        let unit = DepthUnit::new((f64::from(micrometres) * 1e-6) as f32);
        let what = "the depth unit in micrometres";
        let unit = unit.map_err(|_| Malformed::Field { what, at: 0, got: micrometres })?;
        Ok(Self {
            unit,
            least: read.i32(4)?,
            most: read.i32(8)?,
            disparity_multiplier: read.i32(12)?,
            disparity_shift: read.i32(16)?,
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::vec::Vec;

    /// A depth table such as a D435 has.
    pub(in super::super) fn depth_table() -> Vec<u8> {
        let mut table = std::vec![0_u8; DepthTable::BYTES];
        let mut put = |at: usize, values: &[f32]| {
            for (i, v) in values.iter().enumerate() {
                table[at + 4 * i..][..4].copy_from_slice(&v.to_le_bytes());
            }
        };
        put(16, &[0.5; 9]);
        put(160, &[-50.02]);
        put(256, &[1396.2, 1396.1, 960.5, 540.25]);
        put(272, &[930.8, 930.7, 640.3, 360.2]);
        put(288, &[620.1, 620.0, 321.5, 239.25]);
        put(304, &[640.4, 640.3, 424.2, 240.1]);
        seal(25, &mut table).unwrap();
        table
    }

    /// A colour table.
    pub(in super::super) fn colour_table() -> Vec<u8> {
        let mut table = std::vec![0_u8; ColourTable::BYTES];
        let mut put = |at: usize, values: &[f32]| {
            for (i, v) in values.iter().enumerate() {
                table[at + 4 * i..][..4].copy_from_slice(&v.to_le_bytes());
            }
        };
        put(16, &[0.96, 0.0, 0.01, 0.0, 1.71, -0.02, 0.0, 0.0, 1.0]);
        put(52, &[0.1, -0.2, 0.001, 0.002, 0.03]);
        put(184, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        put(220, &[14.7, 0.1, 0.2]);
        table[144..148].copy_from_slice(&[0x80, 0x07, 0x38, 0x04]);
        seal(32, &mut table).unwrap();
        table
    }

    #[test]
    fn tables_are_read() {
        let table = DepthTable::parse(&depth_table()).unwrap();
        assert!((table.baseline - 0.050_02).abs() < 1e-7);
        assert_eq!(table.rectified[2], [620.1, 620.0, 321.5, 239.25]);
        let colour = ColourTable::parse(&colour_table()).unwrap();
        assert_eq!(colour.size, (1920, 1080));
        assert!((colour.translation[0] + 0.0147).abs() < 1e-7);
        assert_eq!(colour.distortion[4], 0.03);
    }

    #[test]
    fn every_corrupted_byte_is_found() {
        for (table, parse) in [
            (depth_table(), (|b| DepthTable::parse(b).map(drop)) as fn(&[u8]) -> Result<(), Malformed>),
            (colour_table(), |b| ColourTable::parse(b).map(drop)),
        ] {
            assert_eq!(parse(&table), Ok(()));
            for at in 0..table.len() {
                for flip in [1, 0x80, 0xff] {
                    let mut bad = table.clone();
                    bad[at] ^= flip;
                    let got = parse(&bad);
                    match at {
                        // Version and parameter are outside the CRC and mean nothing here.
                        0 | 1 | 8..=11 => assert_eq!(got, Ok(())),
                        2 | 3 => assert!(matches!(got, Err(Malformed::Field { .. })), "{at}: {got:?}"),
                        4..=7 => assert!(got.is_err(), "{at}"),
                        _ => assert!(matches!(got, Err(Malformed::Crc { .. })), "{at}: {got:?}"),
                    }
                }
            }
            for length in 0..table.len() {
                assert!(matches!(parse(&table[..length]), Err(Malformed::TooShort { .. })), "{length}");
            }
            // What follows is not the table's.
            assert_eq!(parse(&[&table[..], &[7; 9]].concat()), Ok(()));
        }
    }

    #[test]
    fn short_tables_with_a_right_crc_are_refused() {
        for (number, length) in [(25, 575), (25, 16), (32, 255)] {
            let mut table = std::vec![0; length];
            seal(number, &mut table).unwrap();
            assert!(Table::parse(&table).is_ok());
            assert!(DepthTable::parse(&table).is_err() && ColourTable::parse(&table).is_err());
        }
        // All zeros: no baseline, no size.
        let mut table = std::vec![0; 576];
        seal(25, &mut table).unwrap();
        assert!(matches!(DepthTable::parse(&table), Err(Malformed::Field { at: 160, .. })));
        assert!(seal(1, &mut [0; 15]).is_err());
    }

    #[test]
    fn device_data_and_depth_unit_are_read() {
        let mut bytes = [0_u8; 200];
        bytes[12..16].copy_from_slice(&[50, 13, 16, 5]);
        bytes[48..54].copy_from_slice(&[0x12, 0x34, 0x56, 0x78, 0x9a, 0xbc]);
        bytes[178] = 2;
        let gvd = Gvd::parse(&bytes).unwrap();
        assert_eq!((gvd.firmware, gvd.serial), ([5, 16, 13, 50], [0x12, 0x34, 0x56, 0x78, 0x9a, 0xbc]));
        assert!(!gvd.locked && gvd.motion_sensor == 2);
        assert!(Gvd::parse(&bytes[..178]).is_err());

        let mut control = [0_u8; 20];
        assert!(matches!(DepthControl::parse(&control), Err(Malformed::Field { .. })));
        control[..4].copy_from_slice(&1000_u32.to_le_bytes());
        control[8..12].copy_from_slice(&65_536_i32.to_le_bytes());
        let got = DepthControl::parse(&control).unwrap();
        assert_eq!((got.unit, got.most), (DepthUnit::MILLIMETRE, 65_536));
        control[..4].copy_from_slice(&100_u32.to_le_bytes());
        assert_eq!(DepthControl::parse(&control).unwrap().unit, DepthUnit::TENTH_MILLIMETRE);
        assert!(DepthControl::parse(&control[..19]).is_err());
    }
}
