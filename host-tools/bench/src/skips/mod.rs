//! Skipping must change no answer: how much is skipped, what that gains, and whether the answers are the same.
//!
//! [`pyramid`]: single frames, where the same means the same to the last bit. [`tiles`]: sequences, where it means that on exact
//! depth, and with noise, as right as computing everything.

pub(crate) mod pyramid;
pub(crate) mod tiles;
