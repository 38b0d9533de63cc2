//! *isobath* (a line of equal depth) turns a depth camera into answers: is this point solid, which way does this surface
//! face, can the object stand here, how does the avatar walk there.
//!
//! `no_std`, no heap, no panic, no `unsafe`: the same code runs on headset firmware and on a desktop.
//!
//! # The floors
//!
//! A module imports only from lower floors; rooms on the same floor do not know each other.
//!
//! | floor | modules | what it knows |
//! |---|---|---|
//! | edges | [`wire`] | forms in which frames travel or lie in flash |
//! | answers | [`localized`] | a few points of one frame: normals, hits, rays, placement, paths |
//! | | [`lighting`] | what light falls on an object |
//! | skipping | [`skipping`] | what needs no work: min/max depth pyramid |
//! | sensing | [`sensing`] | depth values, cameras, poses, frames; which way is up by an inertial sensor |
//! | ground | [`ground`] | images, time, arithmetic |
//!
//! # Conventions
//!
//! | what | convention |
//! |---|---|
//! | camera frame | right-handed, x right, y down, z forward (OpenCV); others through [`sensing::camera::convention`] |
//! | world frame | right-handed; which way is up is an argument |
//! | pose | camera-to-world |
//! | depth `z` | along the principal axis, never the length of the ray; that is called `range` |
//! | pixel centres | at integer coordinates; the image spans -0.5 to W - 0.5 |
//! | uv | ((x + 0.5) / W, (y + 0.5) / H), origin top left |
//! | units | metres, radians, integer nanoseconds; metres per depth unit travel with the frame |
//! | no reading | 0 (and the saturated 65535; NaN, infinite, negative for `f32` depth): decided in [`sensing::depth`] alone |
//! | memory | the caller's: slices, views, or types with const capacity; a full buffer is an answer, not a panic |
#![no_std]
#![forbid(unsafe_code)]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable)
)]

#[cfg(test)]
extern crate std;

pub use glam;

pub mod ground;
pub mod lighting;
pub mod localized;
pub mod sensing;
pub mod skipping;
pub mod wire;
