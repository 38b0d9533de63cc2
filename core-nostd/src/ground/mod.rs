//! The ground floor: storage and numbers, knowing nothing of cameras.
//!
//! [`colour`] holds radiance; [`geometry`] has rays, planes and boxes; [`image`] holds pixels (owned in fixed arrays, or borrowed with a stride); [`units`] holds time; [`math`] is the one
//! file that names `libm`.

pub mod colour;
pub mod geometry;
pub mod image;
pub(crate) mod lanes;
pub mod math;
pub(crate) mod regression;
pub(crate) mod rotation;
pub mod units;
