//! A depth image in a message.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 2, 2 | width and height |
//! | 4 | 1 | 0 raw, little-endian; 1 [RVL](crate::wire::rvl) |
//! | 5 | 3 | 0 |
//! | 8 | 4 | metres a step: it travels with each frame, as it may change |
//! | 12 | 4 | microseconds of exposure, whose middle is the message's time; 0 when not known |
//! | 16 | | the pixels |

use super::{Header, Kind, OVERHEAD, encode_with};
use crate::ground::image::{ImageView, ImageViewMut};
use crate::ground::units::Timestamp;
use crate::sensing::depth::DepthUnit;
use crate::sensing::depth::decode::{ByteOrder, u16_bytes};
use crate::wire::malformed::{Bytes, Malformed};
use crate::wire::rvl;

/// Bytes before the pixels.
const FIXED: usize = 16;

/// How the pixels are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Encoding {
    /// Two bytes a pixel.
    #[default]
    Raw,
    /// About one byte a pixel, without loss.
    Rvl,
}

/// A depth image, its pixels not yet decoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Depth<'a> {
    /// Width and height, neither 0.
    pub size: (usize, usize),
    /// Metres a step.
    pub unit: DepthUnit,
    /// Microseconds of exposure; 0 when not known.
    pub exposure: u32,
    encoding: Encoding,
    pixels: &'a [u8],
}

impl<'a> Depth<'a> {
    pub(super) fn read(body: &'a [u8]) -> Result<Self, Malformed> {
        let read = Bytes::new("bulk depth frame", body);
        let size = (usize::from(read.u16(0)?), usize::from(read.u16(2)?));
        let field = |what, at: usize| Malformed::Field { what, at, got: read.u32(at).unwrap_or(0) };
        if size.0 == 0 || size.1 == 0 {
            return Err(field("the size of a depth frame", 0));
        }
        let encoding = match read.u8(4)? {
            0 => Encoding::Raw,
            1 => Encoding::Rvl,
            _ => return Err(field("the encoding of a depth frame", 4)),
        };
        let unit = DepthUnit::new(read.f32(8)?).map_err(|_| field("the unit of a depth frame", 8))?;
        let exposure = read.u32(12)?;
        let pixels = body.get(FIXED..).unwrap_or_default();
        let raw = size.0 * size.1 * 2;
        if encoding == Encoding::Raw && pixels.len() != raw {
            return Err(Malformed::TooShort { what: "the pixels of a depth frame", needed: raw, got: pixels.len() });
        }
        Ok(Self { size, unit, exposure, encoding, pixels })
    }

    /// How the pixels travelled.
    #[must_use]
    pub const fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Decodes the pixels into an image of the frame's size. After an error the image is unspecified, and no frame.
    ///
    /// # Errors
    /// [`Malformed`]: the image is of another size, or the pixels are not one of this size.
    pub fn pixels_into(&self, out: &mut ImageViewMut<'_, u16>) -> Result<(), Malformed> {
        let what = "the pixels of a depth frame";
        if out.size() != self.size {
            let (needed, got) = (self.size.0 * self.size.1, out.width() * out.height());
            return Err(Malformed::Full { what, needed, got });
        }
        let broken = Malformed::Field { what, at: FIXED, got: self.pixels.len() as u32 };
        match self.encoding {
            Encoding::Raw => {
                u16_bytes(self.pixels, 2 * self.size.0, ByteOrder::Little, out).map(drop).map_err(|_| broken)
            }
            Encoding::Rvl => match rvl::decode(self.pixels, out) {
                Ok(used) if used == self.pixels.len() => Ok(()),
                _ => Err(broken),
            },
        }
    }
}

/// Bytes that no message of a depth frame of so many pixels exceeds.
///
/// ```
/// use isobath::wire::bulk::{Encoding, depth_most_bytes};
/// assert_eq!(depth_most_bytes(160 * 120, Encoding::Raw), 38_444);
/// ```
#[must_use]
pub const fn depth_most_bytes(pixels: usize, encoding: Encoding) -> usize {
    let pixels = match encoding {
        Encoding::Raw => pixels.saturating_mul(2),
        Encoding::Rvl => rvl::most_bytes(pixels),
    };
    pixels.saturating_add(OVERHEAD + FIXED)
}

/// Writes a depth frame; how many bytes it took. `exposure` is in microseconds, 0 when not known; `time` its middle.
///
/// # Errors
/// [`Malformed::Full`]; [`Malformed::Field`] for images of no pixels or wider or higher than 65535.
pub fn encode_depth(
    depth: ImageView<'_, u16>,
    unit: DepthUnit,
    exposure: u32,
    encoding: Encoding,
    sequence: u32,
    time: Timestamp,
    out: &mut [u8],
) -> Result<usize, Malformed> {
    let size = u16::try_from(depth.width()).ok().zip(u16::try_from(depth.height()).ok());
    let size = size.filter(|(w, h)| *w > 0 && *h > 0);
    let what = "the size of a depth frame";
    let (width, height) = size.ok_or(Malformed::Field { what, at: 0, got: depth.width() as u32 })?;
    encode_with(&Header { kind: Kind::Depth, sequence, time }, out, |writer| {
        writer.u16(width)?;
        writer.u16(height)?;
        writer.bytes(&[u8::from(encoding == Encoding::Rvl), 0, 0, 0])?;
        writer.f32(unit.metres())?;
        writer.u32(exposure)?;
        match encoding {
            Encoding::Raw => depth.rows().try_for_each(|row| row.iter().try_for_each(|v| writer.u16(*v))),
            Encoding::Rvl => {
                let needed = writer.at().saturating_add(rvl::most_bytes(depth.width() * depth.height()));
                let rest = writer.rest();
                let got = rest.len();
                let used = rvl::encode(depth, rest);
                let used = used.map_err(|_| Malformed::Full { what: "bulk depth frame", needed, got })?;
                writer.skip(used);
                Ok(())
            }
        }
    })
}
