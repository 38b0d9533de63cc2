//! What cameras and sensors that others make say, byte by byte: requests to write, replies and headers to check and read.
//!
//! | module | whose | transport |
//! |---|---|---|
//! | [`uvc`] | every USB video camera's payload header, and Linux's metadata buffers | `/dev/videoN` |
//! | [`d4xx`] | Intel RealSense D400: calibration, versions, depth unit, frame metadata | UVC extension unit |
//! | [`gmrb`] | PrimeSense's command header, of Kinect v1 and of Orbbec | control transfers; UVC extension unit |
//! | [`kinect`] | Kinect v1: registers, constants, packets of depth | USB |
//! | [`iio`] | Linux industrial I/O: channel types and scans | `/dev/iio:deviceN` |
//!
//! All are pure functions of bytes: no device is needed to test them, none is opened here. A parser answers with values in range or with
//! [`Malformed`](crate::wire::malformed::Malformed), never reads outside its bytes, and works in time linear in them. Where the layouts come
//! from (kernel documentation, the makers' open drivers) is said in each module. What would write a device's flash is not here, so that it
//! can't be done by mistake.

pub mod d4xx;
pub mod gmrb;
pub mod iio;
pub mod kinect;
pub mod uvc;
