//! Sources around sources: each takes a [`DepthSource`](crate::DepthSource) and is one, so that they stack in any order.
//!
//! | file | what it adds |
//! |---|---|
//! | [`fault`] | timeouts, losses, broken frames, unplugging, by a seed: what a program must survive |
//! | [`trace`] | a line of text for each call, with a digest of each frame |
//! | [`record`] | a sink that sees each frame and each gap on its way |
//! | [`pump`] | a thread that reads ahead, with a back-pressure policy and frames that can be held |
//!
//! None of them allocates where frames pass, once the stream runs.

pub mod fault;
pub mod pump;
pub mod record;
pub mod trace;
