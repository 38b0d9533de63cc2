//! Cameras and inertial sensors, when this program was built for them (feature `live`), and what to say when it was not.
//!
//! | SRC | camera |
//! |---|---|
//! | `v4l2:/dev/videoN` | RealSense, Orbbec, any with a depth format and a camera file |
//! | `usb:kinect`, `usb:kinect@SERIAL` | Kinect v1 |
//! | `usb:bulk`, `usb:bulk@SERIAL` | headset firmware that speaks isobath's bulk protocol; inertial readings too |

use isobath_recording::OpenOptions;
use isobath_source::{DepthSource, ImuSource};

use crate::failure::Outcome;

/// How to get them.
pub(crate) const COMMAND: &str = "cargo build --release --features live";
/// What that needs.
pub(crate) const NEEDS: &str = "on Debian and Ubuntu `apt install libclang-dev`";

/// Whether cameras can be opened.
pub(crate) const BUILT: bool = cfg!(feature = "live");

/// A device that sees and feels.
pub(crate) trait Both: DepthSource + ImuSource {}
impl<T: DepthSource + ImuSource> Both for T {}

/// An opened camera.
#[allow(dead_code, reason = "without the feature `live` none is ever made")]
pub(crate) enum Camera {
    Depth(Box<dyn DepthSource>),
    Both(Box<dyn Both>),
}

impl Camera {
    pub(crate) fn depth(&self) -> &dyn DepthSource {
        match self {
            Self::Depth(camera) => camera.as_ref(),
            Self::Both(camera) => camera.as_ref(),
        }
    }

    pub(crate) fn depth_mut(&mut self) -> &mut dyn DepthSource {
        match self {
            Self::Depth(camera) => camera.as_mut(),
            Self::Both(camera) => camera.as_mut(),
        }
    }

    /// Its own inertial sensor.
    pub(crate) fn imu(&mut self) -> Option<&mut dyn ImuSource> {
        match self {
            Self::Depth(_) => None,
            Self::Both(camera) => Some(camera.as_mut()),
        }
    }
}

#[cfg(feature = "live")]
pub(crate) use built::{imu, open};
#[cfg(not(feature = "live"))]
pub(crate) use not_built::{imu, open};

#[cfg(not(feature = "live"))]
mod not_built {
    use super::{COMMAND, Camera, ImuSource, NEEDS, OpenOptions, Outcome};
    use crate::failure::Failure;

    fn advice() -> String {
        format!("build one that has them: {COMMAND} ({NEEDS} first); or use a recording")
    }

    /// Opens `v4l2:DEVICE` or `usb:KIND`; `every`: no frame is to be passed over.
    pub(crate) fn open(kind: &str, device: &str, _: &OpenOptions, _every: bool) -> Outcome<Camera> {
        Err(Failure::new("this isobath was built without live cameras").at(format!("{kind}:{device}")).advise(advice()))
    }

    /// Opens an inertial sensor of the kernel's.
    pub(crate) fn imu(device: &str) -> Outcome<Box<dyn ImuSource>> {
        Err(Failure::new("this isobath was built without live sensors").at(format!("--imu {device}")).advise(advice()))
    }
}

#[cfg(feature = "live")]
mod built {
    use std::path::Path;

    use isobath_source::BackPressure;
    use isobath_usb::link;

    use super::{Camera, ImuSource, OpenOptions, Outcome};
    use crate::failure::Failure;
    use crate::source::failure;

    /// Opens `v4l2:DEVICE` or `usb:KIND`; `every`: no frame is to be passed over.
    pub(crate) fn open(kind: &str, device: &str, options: &OpenOptions, every: bool) -> Outcome<Camera> {
        let place = format!("{kind}:{device}");
        if kind == "v4l2" {
            let set = &options.set;
            let size =
                set.width.zip(set.height).and_then(|(w, h)| Some((u32::try_from(w).ok()?, u32::try_from(h).ok()?)));
            let options = isobath_v4l2::OpenOptions {
                camera: options.camera.clone(),
                set: set.clone(),
                size,
                colour: options.colour,
                policy: if every { BackPressure::Every } else { BackPressure::Latest },
                ..isobath_v4l2::OpenOptions::default()
            };
            let camera = isobath_v4l2::open(Path::new(device), &options).map_err(|e| failure(&e, &place))?;
            return Ok(Camera::Depth(camera));
        }
        let (name, serial) = match device.split_once('@') {
            Some((name, serial)) => (name, Some(serial)),
            None => (device, None),
        };
        let options = link::Options { reconnect: true };
        match name {
            "kinect" => {
                let camera = isobath_usb::live::kinect1(serial, options).map_err(|e| failure(&e, &place))?;
                Ok(Camera::Depth(Box::new(camera)))
            }
            "bulk" => {
                let camera = isobath_usb::live::bulk(serial, options).map_err(|e| failure(&e, &place))?;
                Ok(Camera::Both(Box::new(camera)))
            }
            _ => Err(Failure::new(format!("no USB camera is called {name:?}"))
                .at(place)
                .advise("usb:kinect, usb:bulk (headset firmware), each with @SERIAL where there are several")),
        }
    }

    /// Opens an inertial sensor of the kernel's: `auto`, or its name or folder.
    pub(crate) fn imu(device: &str) -> Outcome<Box<dyn ImuSource>> {
        let path = (device != "auto").then(|| Path::new(device));
        let imu = isobath_imu::open(path, &isobath_imu::Options::default())
            .map_err(|e| failure(&e, &format!("--imu {device}")))?;
        Ok(Box::new(imu))
    }
}
