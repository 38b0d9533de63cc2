//! What light falls on an object: the surroundings, gathered frame by frame (LitAR).

pub mod policy;
