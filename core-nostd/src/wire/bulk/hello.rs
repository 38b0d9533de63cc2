//! Who the device is, and its calibration.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 2, 2 | width and height of depth; 0 without depth |
//! | 4 | 4 | metres a step of depth |
//! | 8 | 16 | fx, fy, cx, cy in pixels |
//! | 24 | 4 | lens coefficients that count: 0, 5 or 8 |
//! | 28 | 32 | the coefficients: k1 k2 p1 p2 k3 k4 k5 k6 |
//! | 60 | 4 | microseconds from frame to frame; 0 when not known |
//! | 64 | 4 | thousandths of a hertz of the inertial sensor; 0 without one |
//! | 68 | 8 | nanoseconds to add to inertial times to get the camera's, signed |
//! | 76 | 4 | firmware version |
//! | 80 | 4 | bytes of the serial number, up to 32 |
//! | 84 | 32 | the serial number, printable ASCII |

use core::fmt;

use super::{Header, Kind, encode_with};
use crate::ground::units::Timestamp;
use crate::sensing::camera::{Camera, Distortion, Intrinsics};
use crate::sensing::depth::DepthUnit;
use crate::wire::malformed::{Bytes, Malformed};

/// Bytes of the body.
const BYTES: usize = 116;
/// The longest serial number.
const SERIAL: usize = 32;

/// A serial number: up to 32 printable ASCII characters.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Serial {
    bytes: [u8; SERIAL],
    length: u8,
}

impl Serial {
    /// From text; `None` when it is too long or not printable ASCII.
    #[must_use]
    pub fn new(text: &str) -> Option<Self> {
        let mut bytes = [0; SERIAL];
        bytes.get_mut(..text.len())?.copy_from_slice(text.as_bytes());
        text.bytes().all(|b| b.is_ascii_graphic() || b == b' ').then_some(Self { bytes, length: text.len() as u8 })
    }

    /// As text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let bytes = self.bytes.get(..usize::from(self.length)).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or_default()
    }
}

impl fmt::Debug for Serial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

/// What a device says of itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hello {
    /// Width, height and unit of depth, and the camera through which it is seen; `None` without depth.
    pub depth: Option<(u16, u16, DepthUnit, Camera)>,
    /// Microseconds from frame to frame; 0 when not known.
    pub frame_interval: u32,
    /// Thousandths of a hertz of the inertial sensor; 0 without one.
    pub imu_millihertz: u32,
    /// Nanoseconds to add to inertial times to get the camera's.
    pub imu_offset: i64,
    /// Firmware version, as the device counts.
    pub firmware: u32,
    /// The serial number.
    pub serial: Serial,
}

impl Hello {
    pub(super) fn read(body: &[u8]) -> Result<Self, Malformed> {
        let read = Bytes::new("bulk hello", body);
        read.slice(0, BYTES)?;
        let (width, height) = (read.u16(0)?, read.u16(2)?);
        let field = |what, at: usize| Malformed::Field { what, at, got: read.u32(at).unwrap_or(0) };
        let mut depth = None;
        if width > 0 && height > 0 {
            let unit = DepthUnit::new(read.f32(4)?).map_err(|_| field("the depth unit", 4))?;
            let [fx, fy, cx, cy] = read.floats(8)?;
            let intrinsics = Intrinsics::new(fx, fy, cx, cy).map_err(|_| field("the intrinsics", 8))?;
            let coefficients: [f32; 8] = read.floats(28)?;
            let distortion = match read.u32(24)? {
                n @ (0 | 5 | 8) => coefficients.get(..n as usize).and_then(Distortion::from_slice),
                _ => None,
            };
            let distortion = distortion.ok_or(field("the lens", 24))?;
            depth = Some((width, height, unit, Camera { intrinsics, distortion }));
        }
        let length = read.u32(80)?;
        let text = read.slice(84, SERIAL)?.get(..usize::try_from(length).unwrap_or(usize::MAX));
        let serial = text.and_then(|text| Serial::new(core::str::from_utf8(text).ok()?));
        Ok(Self {
            depth,
            frame_interval: read.u32(60)?,
            imu_millihertz: read.u32(64)?,
            imu_offset: read.i64(68)?,
            firmware: read.u32(76)?,
            serial: serial.ok_or(field("the serial number", 80))?,
        })
    }
}

/// Writes a hello; how many bytes it took: 144.
///
/// # Errors
/// [`Malformed::Full`].
pub fn encode_hello(hello: &Hello, sequence: u32, time: Timestamp, out: &mut [u8]) -> Result<usize, Malformed> {
    encode_with(&Header { kind: Kind::Hello, sequence, time }, out, |writer| {
        let (width, height, unit, k, lens) = match &hello.depth {
            None => (0, 0, 0.0, [0.0; 4], Distortion::None),
            Some((w, h, unit, Camera { intrinsics: k, distortion })) => {
                (*w, *h, unit.metres(), [k.fx(), k.fy(), k.cx(), k.cy()], *distortion)
            }
        };
        writer.u16(width)?;
        writer.u16(height)?;
        writer.f32(unit)?;
        writer.floats(&k)?;
        let (count, coefficients) = match lens {
            Distortion::None => (0, [0.0; 8]),
            Distortion::Brown5([k1, k2, p1, p2, k3]) => (5, [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]),
            Distortion::Brown8(k) => (8, k),
        };
        writer.u32(count)?;
        writer.floats(&coefficients)?;
        writer.u32(hello.frame_interval)?;
        writer.u32(hello.imu_millihertz)?;
        writer.bytes(&hello.imu_offset.to_le_bytes())?;
        writer.u32(hello.firmware)?;
        writer.u32(hello.serial.length.into())?;
        writer.bytes(&hello.serial.bytes)
    })
}
