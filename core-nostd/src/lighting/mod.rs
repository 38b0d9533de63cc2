//! Environment lighting: what a virtual object is lit by at its place (LitAR: Zhao et al. 2022, Proc. ACM IMWUT 6(3), 153).
//!
//! From frames of depth, colour and pose to an equirectangular map of light at one place. Light is kept in two fields: what is *near* changes with every
//! step, so it is kept as views with depth and seen from the object's place; what is *far* depends on the direction alone, so it is kept as colours of 1280
//! directions. The map is near over far.
//!
//! ```text
//! frame -> policy (is it worth taking?) -> session -+-> near: views -> layers -> picture -+-> compose -> map
//!                                                   +-> far: anchors -> grid -------------+
//!                                                            anchors -> harmonics (order 2, main light, ambient)
//! ```
//!
//! | room | question |
//! |---|---|
//! | [`policy`] | which frames are worth taking, and where should the user look? |
//! | [`Session`] | one object's light, from the first frame on |
//! | [`near`] | what of the last few views is seen from the object's place? |
//! | [`far`] | how bright and of which colour is each direction? |
//! | [`compose`] | near over far, where it changed |
//! | [`cube`] | the same map as six small faces |
//! | [`registration`] | where did the near views truly stand? |
//! | [`preset`] | how much of everything |
//! | [`lattice`], [`equirect`] | even directions and the nearest of them; directions and map pixels |
//!
//! Memory: the caller's. Anchors 30 KiB, their grid 98 KiB (24 KiB at 64 x 32), the near field by [`Preset`]. Costs are in the
//! modules and in `isobath bench lighting`, each beside its error against the ground truth.

pub mod compose;
pub mod cube;
pub mod equirect;
pub mod far;
pub mod lattice;
pub mod near;
pub mod policy;
pub mod preset;
pub mod registration;
mod session;
#[cfg(test)]
mod tests;

pub use preset::Preset;
pub use session::{Drawn, LightError, Observed, Session};
