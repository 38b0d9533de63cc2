//! isobath for C: a depth frame goes in, answers come out (hit, normal, ray, room for a box, a path), in memory that the
//! caller owns. `include/isobath.h` is generated from this crate and checked in; `examples/firmware.c` is where to begin.
//!
//! # How it is held together
//!
//! A context is one block of the caller's memory: a header, the depth image, its pyramid, the height map and the planner's
//! nodes ([`memory`]). Nothing in it is a pointer or a Rust value with forbidden bit patterns; each call checks the header's
//! seal ([`context`]) and makes its views of the rest anew. A context that was never initialised, was moved, or has its header
//! overwritten is therefore an error code and not a crash.
//!
//! | file | idea |
//! |---|---|
//! | [`status`] | error codes and their texts |
//! | [`types`] | what crosses the border: plain structs and enums of fixed width |
//! | [`check`] | pointers: null, alignment, overlap |
//! | [`memory`] | where what lies in the block |
//! | [`context`] | the header, its seal, and the views of the rest |
//! | [`frames`] | `isobath_init`, `isobath_push_frame` and the copy-free pair around a DMA transfer |
//! | [`points`] | `isobath_hit_test`, `isobath_normal`, `isobath_ray_cast` |
//! | [`room`] | `isobath_vote`, `isobath_place` |
//! | [`ground`] | `isobath_integrate`, `isobath_ground_at`, `isobath_path` and the rest of the map |
//!
//! # Errors and answers
//!
//! A function returns an [`Status`](status::Status): 0, or below 0 what is wrong with the *call*. What was found in the world is
//! an *outcome* in the answer's struct, with every case named: a hole, or no way there, is an answer and returns 0. On an error
//! the answer is left as it was.
//!
//! # Unsafe code
//!
//! Only here: the core forbids it. What can't be checked from inside is the caller's promise, the same for every function: a
//! pointer that is neither null nor misaligned points to as much memory as the function says, which nothing else uses during
//! the call. One context serves one caller at a time; two contexts are independent.
#![no_std]
#![allow(
    unsafe_code,
    reason = "this crate is the border to C: pointers come in, and each block says why it may use them"
)]
#![allow(clippy::doc_markdown, reason = "the comments are the C header's too, where backticks are noise")]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core, unsafe_op_in_unsafe_fn)]
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable)
)]

#[cfg(test)]
extern crate std;

pub mod check;
pub mod context;
pub mod frames;
pub mod ground;
pub mod memory;
pub mod points;
pub mod room;
pub mod status;
pub mod types;

/// The static library's panic handler. Nothing in it can panic (`cargo xtask test --only c-interface` looks), so nothing calls
/// this; the compiler wants one all the same.
#[cfg(all(feature = "panic-handler", not(test)))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
