//! How a camera sees: pinhole [`intrinsics`], lens [`distortion`] (and its removal, [`rectify`]), where it stands ([`pose`]),
//! other engines' axes ([`convention`]), and how images map to each other ([`crop`]) and to the screen ([`screen`]).

pub mod convention;
pub mod crop;
pub mod distortion;
pub mod intrinsics;
pub mod pose;
pub mod rectify;
pub mod screen;

pub use distortion::{Camera, Distortion};
pub use intrinsics::Intrinsics;
pub use pose::Pose;
