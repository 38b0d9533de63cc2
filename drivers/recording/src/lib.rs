#![doc = include_str!("../README.md")]

mod bag;
mod calibration;
mod camera_file;
mod files;
mod imu;
mod layout;
mod mcap;
pub mod messages;
pub mod parse;
mod reader;
mod store;
mod stream;
mod tum_writer;

pub use camera_file::{ColourSection, DepthSection, Direction, Format, PoseSection};
pub use imu::{ImuRecording, open_imu};
pub use mcap::writer::{McapOptions, McapReport, McapWriter};
pub use parse::CameraFile;
pub use reader::{OpenOptions, is_messages, open, open_bytes};
pub use tum_writer::{TumOptions, TumReport, TumWriter};
