//! The bodies of the fuzz targets: bytes in, no panic out, and what the documentation promises of any input asserted.
//!
//! A target is one function here, its name in [`TARGETS`], three lines in `fuzz/fuzz_targets/` and a few seeds in
//! `fuzz/corpus/`; a test holds the four together. The cameras and images are drawn from the bytes, small enough that
//! thousands run in a second.

#![allow(clippy::missing_panics_doc, reason = "a panic is how a fuzz body reports what it found")]

mod decode;
mod devices;
mod features;
mod inertial;
mod lighting;
mod localized;
mod parsers;
mod sensing;

use arbitrary::{Arbitrary, Result, Unstructured};
use isobath::glam::{Quat, Vec2, Vec3};

pub use decode::{depth16, disparity, key_frame, metres, projective, rvl, u16_bytes};
pub use devices::{bulk, d4xx, gmrb, iio, pixel_formats, uvc_metadata};
pub use features::features;
pub use inertial::imu;
pub use lighting::lighting;
pub use localized::localized;
pub use parsers::{camera_file, depth_png, lists, message, npy, open_messages, pgm};
pub use sensing::{camera, pose, pyramid, rectify};

/// One target: its name and its body.
pub type Target = (&'static str, fn(&[u8]));

/// Every target.
pub const TARGETS: &[Target] = &[
    ("decode_u16_bytes", u16_bytes),
    ("decode_depth16", depth16),
    ("decode_metres", metres),
    ("decode_disparity", disparity),
    ("decode_projective", projective),
    ("decode_rvl", rvl),
    ("decode_key_frame", key_frame),
    ("decode_pixel_formats", pixel_formats),
    ("parse_uvc_metadata", uvc_metadata),
    ("parse_d4xx", d4xx),
    ("parse_gmrb", gmrb),
    ("parse_iio", iio),
    ("parse_bulk", bulk),
    ("camera", camera),
    ("pose", pose),
    ("rectify", rectify),
    ("pyramid", pyramid),
    ("localized", localized),
    ("features", features),
    ("lighting", lighting),
    ("imu", imu),
    ("parse_npy", npy),
    ("parse_pgm", pgm),
    ("parse_depth_png", depth_png),
    ("parse_camera_file", camera_file),
    ("parse_lists", lists),
    ("decode_message", message),
    ("open_messages", open_messages),
];

/// A number of the kind that breaks things more often than chance would: special values, camera-like values, any bits.
fn number(u: &mut Unstructured<'_>) -> Result<f32> {
    const SPECIAL: [f32; 16] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        0.5,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        1e-40,
        1e-3,
        1e6,
        65_535.0,
        -500.0,
    ];
    Ok(match u8::arbitrary(u)? {
        n if n < 96 => SPECIAL[usize::from(n) % SPECIAL.len()],
        n if n < 176 => f32::from(i16::arbitrary(u)?) / 256.0,
        _ => f32::from_bits(u32::arbitrary(u)?),
    })
}

/// A raw depth value.
fn word(u: &mut Unstructured<'_>) -> Result<u16> {
    u16::arbitrary(u)
}

fn vec2(u: &mut Unstructured<'_>) -> Result<Vec2> {
    Ok(Vec2::new(number(u)?, number(u)?))
}

fn vec3(u: &mut Unstructured<'_>) -> Result<Vec3> {
    Ok(Vec3::new(number(u)?, number(u)?, number(u)?))
}

fn quat(u: &mut Unstructured<'_>) -> Result<Quat> {
    let q = Quat::from_xyzw(number(u)?, number(u)?, number(u)?, number(u)?);
    // Half of them usable: otherwise no pose would ever get past its check.
    Ok(if bool::arbitrary(u)? && q.length_squared().is_normal() { q.normalize() } else { q })
}

/// Width, height and stride of a small image; the stride may be too small.
fn shape(u: &mut Unstructured<'_>) -> Result<(usize, usize, usize)> {
    let width = u.int_in_range(0..=70)?;
    let height = u.int_in_range(0..=40)?;
    let stride = if u.ratio(1, 4)? { u.int_in_range(0..=80)? } else { width };
    Ok((width, height, stride))
}

/// Elements that an image of this shape needs.
fn elements(width: usize, height: usize, stride: usize) -> usize {
    if width == 0 || height == 0 { 0 } else { (height - 1) * stride + width }
}

/// `count` values from what is left of the bytes, repeating them when they run out.
fn fill<T: Clone>(
    u: &mut Unstructured<'_>,
    count: usize,
    mut next: impl FnMut(&mut Unstructured<'_>) -> Result<T>,
) -> Result<Vec<T>> {
    let mut values = Vec::with_capacity(count);
    while values.len() < count && !u.is_empty() {
        values.push(next(u)?);
    }
    if values.is_empty() && count > 0 {
        values.push(next(u)?);
    }
    let given = values.len();
    for i in given..count {
        values.push(values[i % given].clone());
    }
    Ok(values)
}
