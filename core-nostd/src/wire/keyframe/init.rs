//! The first key frame of a session: where the object stands, with which camera and settings, and the light before anything was
//! seen.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 30 | 16 | fx, fy, cx, cy of the depth image, `f32` pixels |
//! | 46 | 8 | width and height of depth, then of colour, `u16` |
//! | 54 | 12 | the object's position, `f32` metres |
//! | 66 | 4 | colour temperature, `f32` K |
//! | 70 | 1 | unit of brightness: 0 lux, 1 relative |
//! | 71 | 4 | brightness, `f32` |
//! | 75 | 4 | half the boundary's side, `f32` metres |
//! | 79 | 4 | views, directions, least confidence, flags (bit 0: registration), a byte each |
//! | 83 | 8 | width and height of a view, then of the map, `u16` |
//! | 91 | 1 | how many levels, 0 to 4 |
//! | 92 | 16 | width and height of each level, `u16`; those there are not: 0 |
//! | 108 | 4 | CRC |

use glam::Vec3;

use super::bytes::Take;
use super::{FRAME_BYTES, Header, INIT, KeyFrameError, begin, put_intrinsics, take_intrinsics, take_size};
use crate::sensing::camera::Intrinsics;

/// Bytes of an init frame.
pub const BYTES: usize = FRAME_BYTES + 78;

/// How bright the surroundings are, by the device's light sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Brightness {
    /// Illuminance, lux, 0 or more.
    Lux(f32),
    /// Relative to a well-lit room, 0 or more; 1 is that room (ARCore's and ARKit's estimate divided by their own 1).
    Relative(f32),
}

/// The ambient light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ambient {
    /// Colour temperature, kelvin, 1000 to 40000.
    pub temperature: f32,
    /// How bright.
    pub brightness: Brightness,
}

/// What the reconstruction is to do: the paper's preset, as numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knobs {
    /// Views kept. The low preset: 3.
    pub views: u8,
    /// Directions of the guided movement.
    pub directions: u8,
    /// Least confidence of a depth pixel, 0 to 255.
    pub min_confidence: u8,
    /// Whether tracking errors are corrected by registration.
    pub register: bool,
    /// Half the side of the near field's cube, metres, above 0, finite. The paper: 1.
    pub half: f32,
    /// Width and height of a view. The low preset: 256 x 192.
    pub view_size: (u16, u16),
    /// Width and height of the map. The low preset: 512 x 256.
    pub map_size: (u16, u16),
    /// Width and height of the projection's levels, finest first, as many as there are; the others (0, 0).
    pub levels: [(u16, u16); 4],
}

impl Knobs {
    /// The low preset.
    pub const LOW: Self = Self {
        views: 3,
        directions: 5,
        min_confidence: 0,
        register: false,
        half: 1.0,
        view_size: (256, 192),
        map_size: (512, 256),
        levels: [(512, 256), (256, 128), (64, 32), (0, 0)],
    };
}

/// A session begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Init {
    /// Session, sequence and time; the view is 0.
    pub header: Header,
    /// The depth image's camera.
    pub intrinsics: Intrinsics,
    /// Width and height of depth images.
    pub depth_size: (u16, u16),
    /// Width and height of colour images, of which depth covers the middle.
    pub colour_size: (u16, u16),
    /// Where the light is asked for: the object's position, world, metres.
    pub position: Vec3,
    /// The ambient light.
    pub ambient: Ambient,
    /// The settings.
    pub knobs: Knobs,
}

impl Init {
    fn fault(&self) -> Option<&'static str> {
        let above = |size: (u16, u16)| size.0 > 0 && size.1 > 0;
        let (Brightness::Lux(brightness) | Brightness::Relative(brightness)) = self.ambient.brightness;
        // Levels that there are come first.
        let count = self.level_count();
        let gap = self.knobs.levels.iter().skip(count).any(|l| *l != (0, 0));
        let temperature = self.ambient.temperature;
        Some(match () {
            () if !(above(self.depth_size) && above(self.colour_size)) => "an image's size",
            () if !self.position.is_finite() => "the position",
            () if !(1e3..=4e4).contains(&temperature) => "the colour temperature",
            () if !(brightness >= 0.0 && brightness.is_finite()) => "the brightness",
            () if !(self.knobs.half > 0.0 && self.knobs.half.is_finite()) => "the boundary",
            () if self.knobs.views == 0 => "the number of views",
            () if !(above(self.knobs.view_size) && above(self.knobs.map_size)) => "the size of views or map",
            () if gap => "a level's size",
            () => return None,
        })
    }

    fn level_count(&self) -> usize {
        self.knobs.levels.iter().take_while(|l| l.0 > 0 && l.1 > 0).count()
    }

    pub(super) fn read(header: Header, mut take: Take<'_>) -> Result<Self, KeyFrameError> {
        let intrinsics = take_intrinsics(&mut take)?;
        let mut size = || take_size(&mut take).map(|(w, h)| (w as u16, h as u16));
        let (depth_size, colour_size) = (size()?, size()?);
        let position = Vec3::from(take.floats::<3>()?);
        let temperature = take.f32()?;
        let brightness: fn(f32) -> Brightness = match take.u8()? {
            0 => Brightness::Lux,
            1 => Brightness::Relative,
            _ => return Err(KeyFrameError::Field { what: "the unit of brightness", at: take.at() }),
        };
        let ambient = Ambient { temperature, brightness: brightness(take.f32()?) };
        let half = take.f32()?;
        let [views, directions, min_confidence, flags] = take.array()?;
        let mut pair = || -> Result<(u16, u16), KeyFrameError> { Ok((take.u16()?, take.u16()?)) };
        let (view_size, map_size) = (pair()?, pair()?);
        let count = usize::from(take.u8()?);
        let mut levels = [(0, 0); 4];
        for level in &mut levels {
            *level = (take.u16()?, take.u16()?);
        }
        let register = flags & 1 == 1;
        let knobs = Knobs { views, directions, min_confidence, register, half, view_size, map_size, levels };
        let header = Header { view: 0, ..header };
        let init = Self { header, intrinsics, depth_size, colour_size, position, ambient, knobs };
        let at = take.at();
        if let Some(what) = init.fault() {
            return Err(KeyFrameError::Field { what, at });
        }
        if count != init.level_count() || flags > 1 || !take.rest().is_empty() {
            return Err(KeyFrameError::Field { what: "what an init frame holds", at });
        }
        Ok(init)
    }
}

/// Writes an init frame; how many bytes it took, always [`BYTES`].
///
/// # Errors
/// [`KeyFrameError::Full`]; [`KeyFrameError::Field`] for a value out of its range.
///
/// ```
/// use glam::vec3;
/// use isobath::sensing::camera::Intrinsics;
/// use isobath::wire::keyframe::init::BYTES;
/// use isobath::wire::keyframe::{Ambient, Brightness, Header, Init, KeyFrame, Knobs, encode_init};
/// let init = Init {
///     header: Header { session: 7, ..Header::default() },
///     intrinsics: Intrinsics::new(210.0, 210.0, 127.5, 95.5)?,
///     depth_size: (256, 192),
///     colour_size: (1920, 1440),
///     position: vec3(0.0, 0.8, -1.5),
///     ambient: Ambient { temperature: 4000.0, brightness: Brightness::Lux(300.0) },
///     knobs: Knobs::LOW,
/// };
/// let mut message = [0; BYTES];
/// assert_eq!(encode_init(&init, &mut message)?, 112);
/// assert_eq!(KeyFrame::decode(&message)?, KeyFrame::Init(init));
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
pub fn encode_init(init: &Init, out: &mut [u8]) -> Result<usize, KeyFrameError> {
    if let Some(what) = init.fault() {
        return Err(KeyFrameError::Field { what, at: 0 });
    }
    let mut put = begin(out, INIT, Header { view: 0, ..init.header })?;
    put_intrinsics(&mut put, &init.intrinsics)?;
    let knobs = &init.knobs;
    for size in [init.depth_size, init.colour_size] {
        put.u16(size.0)?;
        put.u16(size.1)?;
    }
    put.floats(&init.position.to_array())?;
    put.floats(&[init.ambient.temperature])?;
    let (unit, brightness) = match init.ambient.brightness {
        Brightness::Lux(v) => (0, v),
        Brightness::Relative(v) => (1, v),
    };
    put.u8(unit)?;
    put.floats(&[brightness, knobs.half])?;
    put.bytes(&[knobs.views, knobs.directions, knobs.min_confidence, u8::from(knobs.register)])?;
    for size in [knobs.view_size, knobs.map_size] {
        put.u16(size.0)?;
        put.u16(size.1)?;
    }
    put.u8(init.level_count() as u8)?;
    for size in knobs.levels {
        put.u16(size.0)?;
        put.u16(size.1)?;
    }
    put.seal()
}
