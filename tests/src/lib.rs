//! What crosses isobath's crates and belongs to none of them.
//!
//! - [`fuzz`]: the body of every fuzz target. `fuzz/` wraps them for libFuzzer (nightly); `tests/fuzz_corpora.rs` replays the
//!   seed corpora through them on stable, so a crash that was found once stays found.
//! - `tests/`: numerics against `f64` oracles, hostile input, end to end.

pub mod fuzz;
pub mod near;
pub mod shared;

/// The README's examples, compiled and run by `cargo test --doc`.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
