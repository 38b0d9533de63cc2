//! Environment lighting (LitAR).

pub mod compose;
pub mod equirect;
pub mod far;
pub mod lattice;
pub mod near;
pub mod preset;
mod session;

pub use preset::Preset;
pub use session::{Drawn, LightError, Observed, Session};
