//! USB as libusb sees it (feature `live`), and the sources over it, ready to open.
//!
//! ```no_run
//! use isobath_source::{Deadline, DepthSource, OwnedFrame};
//! use isobath_usb::{link::Options, live};
//! let mut kinect = live::kinect1(None, Options::default())?;
//! let mut frame = OwnedFrame::new();
//! let _ = kinect.next_into(&mut frame, Deadline::NEVER)?;
//! # Ok::<(), isobath_source::SourceError>(())
//! ```

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use isobath_source::SourceError;
use rusb::{Context, Device, DeviceHandle, Direction, TransferType, UsbContext};

use crate::bulk::{self, Bulk};
use crate::iso::IsoStream;
use crate::kinect1::{self, Kinect1};
use crate::link::{Options, Wanted};
use crate::sys::{Address, DeviceInfo, Interface, IsoLayout, Request, UsbDevice, UsbError, UsbSys};

/// libusb. Each list of devices comes from a new context: one that is kept does not see devices that come later unless udev runs.
#[derive(Debug, Clone, Copy, Default)]
pub struct LibUsb;

/// An open device.
pub struct LibUsbDevice {
    /// Before the handle, so that it is dropped first.
    iso: Option<IsoStream>,
    handle: Arc<DeviceHandle<Context>>,
}

impl fmt::Debug for LibUsbDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LibUsbDevice").field("streams", &self.iso.is_some()).finish_non_exhaustive()
    }
}

/// Opens a device of the bulk protocol: the one with this serial number, or the first. It is a source of depth and of inertial readings.
///
/// # Errors
/// [`SourceError`], as [`Bulk::open`].
pub fn bulk(serial: Option<&str>, options: Options) -> Result<Bulk<LibUsb>, SourceError> {
    Bulk::open(LibUsb, bulk::wanted(serial), options)
}

/// Opens a Kinect v1: the one with this serial number, or the first.
///
/// # Errors
/// [`SourceError`], as [`Kinect1::open`].
pub fn kinect1(serial: Option<&str>, options: Options) -> Result<Kinect1<LibUsb>, SourceError> {
    Kinect1::open(LibUsb, kinect1::wanted(serial), options)
}

/// What is plugged in that can be opened here: in words, and where.
///
/// # Errors
/// [`UsbError`] when the system does not say.
pub fn plugged_in() -> Result<Vec<(&'static str, DeviceInfo)>, UsbError> {
    let all = LibUsb.devices()?;
    let kinds: [(&str, Wanted); 2] =
        [("Kinect v1 (usb:kinect)", kinect1::wanted(None)), ("isobath bulk device (usb:bulk)", bulk::wanted(None))];
    let of = |(name, wanted): &(&'static str, Wanted)| {
        wanted.among(&all).map(|(info, _)| (*name, info.clone())).collect::<Vec<_>>()
    };
    Ok(kinds.iter().flat_map(of).collect())
}

fn error(e: rusb::Error) -> UsbError {
    match e {
        rusb::Error::Timeout => UsbError::Timeout,
        rusb::Error::Pipe => UsbError::Stall,
        // Not found: an interface or endpoint that went with the device.
        rusb::Error::NoDevice | rusb::Error::NotFound => UsbError::Gone,
        rusb::Error::Access => UsbError::Access,
        rusb::Error::Busy => UsbError::Busy,
        rusb::Error::Overflow => UsbError::Overflow,
        rusb::Error::Io => UsbError::Io,
        // Signals interrupt transfers; nothing came.
        rusb::Error::Interrupted => UsbError::Timeout,
        rusb::Error::NoMem => UsbError::Other(12),
        rusb::Error::NotSupported => UsbError::Other(95),
        rusb::Error::InvalidParam => UsbError::Other(22),
        rusb::Error::BadDescriptor | rusb::Error::Other => UsbError::Other(71),
    }
}

fn address<T: UsbContext>(device: &Device<T>) -> Address {
    Address { bus: device.bus_number(), device: device.address() }
}

/// What a device's descriptors say; `None` for one that has none that can be read.
fn describe<T: UsbContext>(device: &Device<T>) -> Option<DeviceInfo> {
    let descriptor = device.device_descriptor().ok()?;
    let config = device.active_config_descriptor().or_else(|_| device.config_descriptor(0)).ok()?;
    let interfaces = config.interfaces().filter_map(|interface| {
        let first = interface.descriptors().next()?;
        let mut endpoints = first.endpoint_descriptors();
        let bulk = endpoints
            .find(|e| e.direction() == Direction::In && e.transfer_type() == TransferType::Bulk)
            .map(|e| e.address());
        let class = [first.class_code(), first.sub_class_code(), first.protocol_code()];
        Some(Interface { number: interface.number(), class, bulk_in: bulk })
    });
    let interfaces = interfaces.collect();
    Some(DeviceInfo {
        address: address(device),
        vendor: descriptor.vendor_id(),
        product: descriptor.product_id(),
        interfaces,
    })
}

impl UsbSys for LibUsb {
    type Device = LibUsbDevice;

    fn devices(&mut self) -> Result<Vec<DeviceInfo>, UsbError> {
        let context = Context::new().map_err(error)?;
        Ok(context.devices().map_err(error)?.iter().filter_map(|device| describe(&device)).collect())
    }

    fn open(&mut self, wanted: Address) -> Result<LibUsbDevice, UsbError> {
        let context = Context::new().map_err(error)?;
        let all = context.devices().map_err(error)?;
        let device = all.iter().find(|device| address(device) == wanted).ok_or(UsbError::Gone)?;
        let handle = device.open().map_err(error)?;
        Ok(LibUsbDevice { handle: Arc::new(handle), iso: None })
    }

    fn wait(&mut self, time: Duration) {
        std::thread::sleep(time);
    }
}

impl UsbDevice for LibUsbDevice {
    fn serial(&mut self) -> Option<String> {
        let descriptor = self.handle.device().device_descriptor().ok()?;
        self.handle.read_serial_number_string_ascii(&descriptor).ok().filter(|serial| !serial.is_empty())
    }

    fn claim(&mut self, interface: u8) -> Result<(), UsbError> {
        // Some systems have no kernel drivers to detach.
        let _ = self.handle.set_auto_detach_kernel_driver(true);
        self.handle.claim_interface(interface).map_err(error)
    }

    fn control_in(&mut self, r: Request, data: &mut [u8], timeout: Duration) -> Result<usize, UsbError> {
        self.handle.read_control(r.kind, r.request, r.value, r.index, data, timeout).map_err(error)
    }

    fn control_out(&mut self, r: Request, data: &[u8], timeout: Duration) -> Result<usize, UsbError> {
        self.handle.write_control(r.kind, r.request, r.value, r.index, data, timeout).map_err(error)
    }

    fn bulk_in(&mut self, endpoint: u8, data: &mut [u8], timeout: Duration) -> Result<usize, UsbError> {
        self.handle.read_bulk(endpoint, data, timeout).map_err(error)
    }

    fn clear_halt(&mut self, endpoint: u8) -> Result<(), UsbError> {
        self.handle.clear_halt(endpoint).map_err(error)
    }

    fn start_iso(&mut self, layout: IsoLayout) -> Result<(), UsbError> {
        self.iso = None;
        self.iso = Some(IsoStream::new(Arc::clone(&self.handle), layout)?);
        Ok(())
    }

    fn next_iso(&mut self, timeout: Duration, packet: &mut dyn FnMut(Option<&[u8]>)) -> Result<usize, UsbError> {
        match &mut self.iso {
            Some(stream) => stream.next(timeout, packet),
            None => Err(UsbError::Other(22)),
        }
    }

    fn stop_iso(&mut self) {
        self.iso = None;
    }
}
