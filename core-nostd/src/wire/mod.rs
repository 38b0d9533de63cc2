//! The edges: forms in which frames travel or lie in flash. Bytes from outside are checked before they are believed.

pub mod keyframe;
pub mod rvl;
