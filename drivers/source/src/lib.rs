//! What a depth source is, seen from the program that reads it: a live camera, a recording and a simulated scene are one
//! trait, [`DepthSource`], that fills one caller-owned frame, [`OwnedFrame`].
//!
//! ```text
//! sensor or file -> DepthSource::next_into -> OwnedFrame -> view() -> isobath::sensing::frame::DepthFrame -> answers
//! ```
//!
//! | file | idea |
//! |---|---|
//! | [`source`] | the traits: the next frame of a stream; any frame of a recording |
//! | [`inertial`] | the traits of inertial sensors and of whoever knows poses |
//! | [`stats`] | what became of a stream's frames, in numbers that add up |
//! | [`frame`] | a frame that owns its pixels, reused from call to call; `u16` and `f32` depth without converting |
//! | [`error`] | what can go wrong, whether it ends the stream, and what to do about it |
//! | [`clock`] | the host's time and deadlines, apart from the frames' own time |
//!
//! A timeout is an [`Outcome`], not an error; an unplugged camera is an error that [ends the stream](SourceError::is_terminal);
//! a broken frame is an error that does not. Units are the core's: metres, radians, integer nanoseconds.

pub mod clock;
pub mod error;
pub mod frame;
pub mod inertial;
pub mod source;
pub mod stats;

pub use clock::{Clock, Deadline, HostNanos, SystemClock};
pub use error::SourceError;
pub use frame::{AnyFrame, DepthPixels, FrameVisitor, OwnedFrame};
pub use inertial::{ImuInfo, ImuOutcome, ImuSource, PoseSource, StampedPose};
pub use source::{DepthSource, Gap, GapCause, Outcome, Recording, SourceInfo};
pub use stats::StreamStats;
