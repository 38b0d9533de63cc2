//! Environment lighting: what light falls on a virtual object (`LitAR`).

pub mod registration;
