//! Key frames: what a device sends so that another computes its lighting, in few bytes, checked before they are believed.
//!
//! LitAR, section 5.1.3, sends three kinds: *init* when a session begins, *near* (colour, depth, pose) and *far* (a small picture and a
//! rotation). These are its kinds in a smaller form of our own:
//!
//! | | paper | here |
//! |---|---|---|
//! | depth | `f32`, all pixels | `u16`, only those within the near-field boundary, their rectangle cut out, [RVL](super::rvl): no loss |
//! | colour | YCbCr 4:2:0, raw | YCbCr 4:2:0 of the same pixels, predicted and Rice coded, off by at most [`NearOptions::colour_error`] |
//! | rotation of a far frame | 36 bytes | 6 bytes, to 0.005 degrees |
//! | integrity | none | magic, version, length, CRC-32 |
//! | low near frame, 256 x 192 | 270,389 bytes | 39,689 to 58,505: 14.7 to 21.6 %, exact depth to a noisy sensor |
//! | far frame, 32 x 24 | 1,189 bytes | 667: 56 % |
//!
//! (Means of eight views of the simulator's living room from `tests/tests/keyframes.rs`, which prints more of them. The colour lost is
//! 4:2:0's, the paper's too: 36.8 dB; the error of 1 leaves 36.2.)
//!
//! [`paper`] gives the paper's sizes for any image. Theirs are an identifier of one byte and 36 or 52 bytes of tracking before the raw images (a header of 16 bytes and
//! a pose of 48, as is sometimes said, would make 270,400).
//!
//! # The form, version 1
//!
//! Little-endian throughout. A message is one key frame.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 2 | `iK` |
//! | 2 | 1 | version, 1 |
//! | 3 | 1 | kind: 1 init, 2 near, 3 far |
//! | 4 | 4 | length of the message, these 8 and the CRC included |
//! | 8 | 4 | session |
//! | 12 | 8 | sequence |
//! | 20 | 8 | time, nanoseconds, signed |
//! | 28 | 2 | view id |
//! | 30 | | the kind's own: [`init`], [`near`], [`far`] |
//! | length - 4 | 4 | CRC-32 of all before it ([`crc32`]) |
//!
//! A version that adds or changes anything has another number; readers refuse those that they don't know.
//!
//! # Memory, cost, loss
//!
//! Encoding writes into the caller's slice and decoding borrows the message and fills the caller's images; neither keeps
//! anything else. [`near_most_bytes`] and [`far_most_bytes`] always suffice; a slice that is too small is an error. Each pass is linear in
//! pixels. A low near frame is encoded in 3 ms and decoded in 1.3 ms on one core of a desktop (colour is two thirds of it, the CRC 0.2 ms), a far frame in 0.13 and 0.015 ms. Depth comes back as it was sent, every bit; colour loses what 4:2:0 loses, and at most `colour_error` a channel of YCbCr more.
//!
//! # Hostile bytes
//!
//! Every length is checked against what there is before it is used, every number against its range. A decoder answers
//! with an error, or with a well-formed key frame; it does not panic, does not read outside the message, and works no longer
//! than the images that the caller gave have pixels. A flipped bit is found by the CRC.

mod bytes;
pub mod far;
pub mod init;
pub mod near;
pub mod paper;
mod planes;
#[cfg(test)]
mod tests;

use core::fmt;

use glam::{Quat, Vec3};

use self::bytes::{CRC, LENGTH_AT, Put, Take};
use super::rvl::RvlError;
use crate::ground::units::Timestamp;
use crate::sensing::camera::{Intrinsics, Pose};

pub use self::far::{Far, FarOptions, encode_far, far_most_bytes};
pub use self::init::{Ambient, Brightness, Init, Knobs, encode_init};
pub use self::near::{Boundary, Near, NearOptions, encode_near, near_most_bytes};
pub use super::crc::crc32;

/// The version written, and the only one read.
pub const VERSION: u8 = 1;
/// How a message begins.
pub const MAGIC: [u8; 2] = *b"iK";
/// Bytes that tell a message's length: [`message_length`].
pub const PREFIX: usize = 8;

/// Why there is no key frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum KeyFrameError {
    /// The output slice is too small.
    Full {
        /// Bytes there are.
        got: usize,
    },
    /// The frame has no pose: nobody could place what it shows.
    NoPose,
    /// The frame has no colour image, which is all that a far frame is made of.
    NoColour,
    /// No pixel is within the boundary and sure enough: send a far frame.
    NothingNear,
    /// The image is wider or higher than 65535 pixels, or has more than 2^28.
    TooLarge {
        /// Its width and height.
        size: (usize, usize),
    },
    /// A value that can't be sent, or was not sent by this encoder.
    Field {
        /// What it is.
        what: &'static str,
        /// Where it stands in the message; 0 when it was to be written.
        at: usize,
    },
    /// The bytes do not begin as a key frame does.
    NotAKeyFrame,
    /// A version that this reader does not know.
    Version {
        /// The version.
        got: u8,
    },
    /// The message ends before what it must hold does.
    CutOff {
        /// Bytes needed, at least.
        needed: usize,
        /// Bytes there are.
        got: usize,
    },
    /// The message says another length than it has.
    Length {
        /// What it says.
        said: usize,
        /// Bytes there are.
        got: usize,
    },
    /// The CRC does not match: damaged on the way.
    Crc {
        /// What it says.
        said: u32,
        /// What it should say.
        computed: u32,
    },
    /// The depth stream is no depth image of the size said.
    Depth(RvlError),
    /// The colour stream is no colour image of the size said.
    Colour,
    /// The key frame came without colour.
    ColourLeftOut,
    /// The image to fill, or the depth image that tells where colour is, is not this key frame's.
    OtherImage {
        /// Width and height of the key frame.
        size: (usize, usize),
        /// Of the image given.
        got: (usize, usize),
    },
}

impl fmt::Display for KeyFrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full { got } => {
                write!(
                    f,
                    "key frame: {got} bytes of output are too few; near_most_bytes and far_most_bytes say how many suffice"
                )
            }
            Self::NoPose => write!(f, "key frame: a near or far frame needs a pose; wait until tracking has one"),
            Self::NoColour => write!(f, "key frame: a far frame needs a colour image"),
            Self::NothingNear => write!(
                f,
                "key frame: no depth pixel is within the boundary and sure enough; send this frame as a far frame"
            ),
            Self::TooLarge { size } => {
                write!(f, "key frame: {}x{} pixels are too many; at most 65535 a side, 2^28 in all", size.0, size.1)
            }
            Self::Field { what, at: 0 } => {
                write!(f, "key frame: {what} is out of its range; see the field's documentation")
            }
            Self::Field { what, at } => {
                write!(f, "key frame: {what} before byte {at} is out of its range; not sent by isobath")
            }
            Self::NotAKeyFrame => {
                write!(f, "key frame: the bytes do not begin with \"iK\"; is the stream out of step?")
            }
            Self::Version { got } => {
                write!(f, "key frame: version {got} is not {VERSION}; bring the older side up to date")
            }
            Self::CutOff { needed, got } => {
                write!(f, "key frame: {got} bytes, but it needs {needed} or more; wait for the rest")
            }
            Self::Length { said, got } => {
                write!(f, "key frame: it says {said} bytes but has {got}; give one whole message")
            }
            Self::Crc { said, computed } => {
                write!(f, "key frame: CRC {said:08x} should be {computed:08x}: damaged on the way; ask for it again")
            }
            Self::Depth(e) => write!(f, "key frame: depth: {e}"),
            Self::Colour => write!(f, "key frame: colour ends too early or goes on too long for this depth image"),
            Self::ColourLeftOut => write!(f, "key frame: it came without colour"),
            Self::OtherImage { size, got } => write!(
                f,
                "key frame: it is {}x{}, the image given {}x{} or of another frame; give images of the key frame's size, and for colour the depth just decoded",
                size.0, size.1, got.0, got.1
            ),
        }
    }
}

impl core::error::Error for KeyFrameError {}

impl From<RvlError> for KeyFrameError {
    fn from(e: RvlError) -> Self {
        match e {
            RvlError::Full { got } => Self::Full { got },
            e => Self::Depth(e),
        }
    }
}

/// What every key frame says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Header {
    /// Whose it is: one session for each virtual object.
    pub session: u32,
    /// The frame's number in its stream.
    pub sequence: u64,
    /// When it was exposed.
    pub time: Timestamp,
    /// The view that it replaces ([`lighting::policy::views`](crate::lighting::policy::views)); 0 for init.
    pub view: u16,
}

const INIT: u8 = 1;
const NEAR: u8 = 2;
const FAR: u8 = 3;

/// A message, checked. It borrows the bytes; images are decoded when asked for.
///
/// ```
/// use glam::Vec3;
/// use isobath::ground::image::Image;
/// use isobath::sensing::camera::{Intrinsics, Pose};
/// use isobath::sensing::depth::{DepthArray, DepthUnit};
/// use isobath::sensing::frame::DepthFrame;
/// use isobath::wire::keyframe::{Boundary, KeyFrame, NearOptions, encode_near, near_most_bytes};
///
/// // On the device: a wall 1.5 m ahead, and the object 20 cm before it.
/// let (depth, colour) = (DepthArray::<64, 48>::filled(1500), Image::<[u8; 3], 64, 48>::filled([200, 180, 160]));
/// let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, Intrinsics::new(60.0, 60.0, 31.5, 23.5)?)
///     .with_colour(colour.view())?
///     .with_pose(Pose::IDENTITY);
/// let near = Boundary { centre: Vec3::new(0.0, 0.0, 1.3), half: 0.5 };
/// let options = NearOptions { boundary: Some(near), view: 3, ..NearOptions::default() };
/// let mut message = [0; near_most_bytes(64, 48)];
/// let used = encode_near(&frame, &options, &mut message)?;
/// assert!(used < 1500); // raw: 10,752
///
/// // Elsewhere.
/// let KeyFrame::Near(got) = KeyFrame::decode(&message[..used])? else { panic!("no near frame") };
/// assert_eq!((got.header().view, got.size(), got.origin()), (3, (40, 40), (12, 4)));
/// let (mut depth, mut colour) = (DepthArray::<40, 40>::filled(0), Image::<[u8; 3], 40, 40>::filled([0; 3]));
/// got.depth_into(&mut depth.view_mut())?;
/// got.colour_into(depth.view(), &mut colour.view_mut())?;
/// assert_eq!(depth.view().get(20, 20), Some(1500));
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum KeyFrame<'a> {
    /// A session begins.
    Init(Init),
    /// Colour and depth around the object.
    Near(Near<'a>),
    /// Colour of a direction.
    Far(Far<'a>),
}

impl<'a> KeyFrame<'a> {
    /// Checks one whole message. Cost: the CRC, about 4 ns a byte; images are not touched yet.
    ///
    /// # Errors
    /// [`KeyFrameError`], naming what is wrong.
    pub fn decode(message: &'a [u8]) -> Result<Self, KeyFrameError> {
        let said = message_length(message)?;
        if said != message.len() {
            return Err(KeyFrameError::Length { said, got: message.len() });
        }
        let Some((body, crc)) = message.split_last_chunk::<CRC>() else {
            return Err(KeyFrameError::CutOff { needed: PREFIX + CRC, got: message.len() });
        };
        let (said, computed) = (u32::from_le_bytes(*crc), crc32(body));
        if said != computed {
            return Err(KeyFrameError::Crc { said, computed });
        }
        let mut take = Take::new(body);
        let [.., kind] = take.array::<4>()?;
        take.u32()?;
        let header = Header {
            session: take.u32()?,
            sequence: take.u64()?,
            time: Timestamp::from_nanos(take.i64()?),
            view: take.u16()?,
        };
        match kind {
            INIT => Init::read(header, take).map(Self::Init),
            NEAR => Near::read(header, take).map(Self::Near),
            FAR => Far::read(header, take).map(Self::Far),
            _ => Err(KeyFrameError::Field { what: "the kind", at: 4 }),
        }
    }

    /// What every key frame says.
    #[must_use]
    pub const fn header(&self) -> Header {
        match self {
            Self::Init(init) => init.header,
            Self::Near(near) => near.header(),
            Self::Far(far) => far.header(),
        }
    }
}

/// How long a message is, from its first [`PREFIX`] bytes: for streams, which must gather it. Compare it with what you are
/// ready to hold.
///
/// # Errors
/// [`KeyFrameError::CutOff`] for fewer than [`PREFIX`] bytes, [`KeyFrameError::NotAKeyFrame`], [`KeyFrameError::Version`].
pub fn message_length(prefix: &[u8]) -> Result<usize, KeyFrameError> {
    let mut take = Take::new(prefix);
    let start = take.array::<{ LENGTH_AT }>();
    if prefix.iter().zip(&MAGIC).any(|(a, b)| a != b) {
        return Err(KeyFrameError::NotAKeyFrame);
    }
    let [_, _, version, _] = start.map_err(|_| KeyFrameError::CutOff { needed: PREFIX, got: prefix.len() })?;
    if version != VERSION {
        return Err(KeyFrameError::Version { got: version });
    }
    let length = take.u32().map_err(|_| KeyFrameError::CutOff { needed: PREFIX, got: prefix.len() })?;
    usize::try_from(length).map_err(|_| KeyFrameError::Field { what: "the length", at: PREFIX })
}

/// Begins a message.
fn begin(out: &mut [u8], kind: u8, header: Header) -> Result<Put<'_>, KeyFrameError> {
    let mut put = Put::new(out);
    put.bytes(&MAGIC)?;
    put.bytes(&[VERSION, kind])?;
    // The length, once it is known.
    put.u32(0)?;
    put.u32(header.session)?;
    put.bytes(&header.sequence.to_le_bytes())?;
    put.bytes(&header.time.as_nanos().to_le_bytes())?;
    put.u16(header.view)?;
    Ok(put)
}

/// Bytes that [`begin`] and the CRC take.
const FRAME_BYTES: usize = 30 + CRC;

fn put_intrinsics(put: &mut Put<'_>, k: &Intrinsics) -> Result<(), KeyFrameError> {
    put.floats(&[k.fx(), k.fy(), k.cx(), k.cy()])
}

fn take_intrinsics(take: &mut Take<'_>) -> Result<Intrinsics, KeyFrameError> {
    let [fx, fy, cx, cy] = take.floats()?;
    let at = take.at();
    Intrinsics::new(fx, fy, cx, cy).map_err(|_| KeyFrameError::Field { what: "a number of the camera", at })
}

fn take_pose(take: &mut Take<'_>) -> Result<Pose, KeyFrameError> {
    let rotation = Quat::from_array(take.floats()?);
    let translation = Vec3::from(take.floats::<3>()?);
    let at = take.at();
    Pose::new(rotation, translation).map_err(|_| KeyFrameError::Field { what: "the pose", at })
}

/// Width and height, neither of them 0.
fn take_size(take: &mut Take<'_>) -> Result<(usize, usize), KeyFrameError> {
    let size = (usize::from(take.u16()?), usize::from(take.u16()?));
    if size.0 == 0 || size.1 == 0 || size.0.saturating_mul(size.1) > MOST_PIXELS {
        return Err(KeyFrameError::Field { what: "the image's size", at: take.at() });
    }
    Ok(size)
}

/// Pixels of the largest image: their streams' lengths fit in 32 bits.
const MOST_PIXELS: usize = 1 << 28;
