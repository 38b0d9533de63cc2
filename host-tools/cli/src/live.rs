//! Cameras, when this program was built for them (feature `live`), and what to say when it was not.

use isobath_recording::OpenOptions;
use isobath_source::DepthSource;

use crate::failure::{Failure, Outcome};

/// How to get them.
pub(crate) const BUILD: &str = "build it so: cargo build --release --features live (Debian and Ubuntu: apt install libclang-dev pkg-config \
    libudev-dev first); recordings need nothing";

/// Whether cameras can be opened.
pub(crate) const BUILT: bool = false;

/// Opens `v4l2:DEVICE` or `usb:KIND`.
pub(crate) fn open(kind: &str, device: &str, _: &OpenOptions) -> Outcome<Box<dyn DepthSource>> {
    Err(Failure::new("this isobath was built without live cameras").at(format!("{kind}:{device}")).advise(BUILD))
}
