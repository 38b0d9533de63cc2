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
//! | [`policy`] | which frames a slow caller gets |
//! | [`through`] | sources around sources: faults, traces, recorders, a thread that reads ahead |
//! | [`stats`] | what became of a stream's frames, in numbers that add up |
//! | [`frame`] | a frame that owns its pixels, reused from call to call; `u16` and `f32` depth without converting |
//! | [`error`] | what can go wrong, whether it ends the stream, and what to do about it |
//! | [`permission`] | who may open a device, and the udev line that lets one |
//! | [`clock`] | the host's time and deadlines, apart from the frames' own time |
//! | [`ticks`] | a device's wrapping counters, unwrapped |
//! | [`clock_map`] | from a device's clock to the host's: offset, skew, residual; never backwards |
//!
//! A timeout is an [`Outcome`], not an error; an unplugged camera is an error that [ends the stream](SourceError::is_terminal);
//! a broken frame is an error that does not. Units are the core's: metres, radians, integer nanoseconds.

pub mod clock;
pub mod clock_map;
pub mod error;
pub mod frame;
pub mod inertial;
pub mod permission;
pub mod policy;
pub mod source;
pub mod stats;
pub mod through;
pub mod ticks;

pub use clock::{Clock, Deadline, HostNanos, SystemClock};
pub use clock_map::{ClockEstimate, ClockEvent, ClockMap, DeviceClock};
pub use error::{LinkKind, SourceError};
pub use frame::{AnyFrame, DepthPixels, FrameVisitor, OwnedFrame};
pub use inertial::{ImuInfo, ImuOutcome, ImuSource, PoseSource, StampedPose};
pub use policy::BackPressure;
pub use source::{DepthSource, Gap, GapCause, Outcome, Recording, SourceInfo};
pub use stats::StreamStats;
pub use through::fault::{FaultInjector, Faults};
pub use through::pump::{FrameLease, Pumped};
pub use through::record::{FrameSink, Recorded};
pub use through::trace::{Tracer, digest};
pub use ticks::{DeviceTicks, TickCounter};
