#![doc = include_str!("../README.md")]

mod calibration;
mod camera_file;
mod files;
mod layout;
pub mod parse;
mod reader;

pub use camera_file::{ColourSection, DepthSection, Direction, Format, PoseSection};
pub use parse::CameraFile;
pub use reader::{OpenOptions, open};
