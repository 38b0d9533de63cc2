//! What the drivers need of USB, and no more: so that libusb is one implementation and a script another.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// Why a transfer, or opening a device, failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum UsbError {
    /// Nothing came in the time given.
    Timeout,
    /// The endpoint stalled.
    Stall,
    /// The device is not there any more.
    Gone,
    /// This user may not.
    Access,
    /// Another program or driver has the interface.
    Busy,
    /// The device sent more than there was room for.
    Overflow,
    /// The bus has no bandwidth left.
    NoBandwidth,
    /// An error of the bus; how most systems report a device in the moment it is unplugged.
    Io,
    /// Anything else: the library's number.
    Other(i32),
}

impl UsbError {
    /// Linux's number for it.
    #[must_use]
    pub const fn errno(self) -> i32 {
        match self {
            Self::Timeout => 110,
            Self::Stall => 32,
            Self::Gone => 19,
            Self::Access => 13,
            Self::Busy => 16,
            Self::Overflow => 75,
            Self::NoBandwidth => 28,
            Self::Io => 5,
            Self::Other(n) => n,
        }
    }
}

impl fmt::Display for UsbError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", std::io::Error::from_raw_os_error(self.errno()))
    }
}

impl std::error::Error for UsbError {}

/// Where a device is plugged in now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Address {
    /// The bus.
    pub bus: u8,
    /// The device's number on it; another one after each plugging in.
    pub device: u8,
}

impl Address {
    /// Linux's node of it.
    ///
    /// ```
    /// use isobath_usb::sys::Address;
    /// assert_eq!(Address { bus: 3, device: 17 }.path().to_str(), Some("/dev/bus/usb/003/017"));
    /// ```
    #[must_use]
    pub fn path(self) -> PathBuf {
        format!("/dev/bus/usb/{:03}/{:03}", self.bus, self.device).into()
    }
}

/// An interface of a device, as its first setting describes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Interface {
    /// Its number.
    pub number: u8,
    /// Class, subclass, protocol.
    pub class: [u8; 3],
    /// The address of its first bulk endpoint towards the host.
    pub bulk_in: Option<u8>,
}

/// A device that is plugged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Where.
    pub address: Address,
    /// Its vendor's number.
    pub vendor: u16,
    /// Its product number.
    pub product: u16,
    /// Its interfaces.
    pub interfaces: Vec<Interface>,
}

/// A control transfer's request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    /// Direction, kind and recipient (`bmRequestType`).
    pub kind: u8,
    /// `bRequest`.
    pub request: u8,
    /// `wValue`.
    pub value: u16,
    /// `wIndex`.
    pub index: u16,
}

/// How isochronous transfers are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IsoLayout {
    /// The endpoint.
    pub endpoint: u8,
    /// Bytes of the longest packet.
    pub packet: usize,
    /// Packets of a transfer.
    pub packets: usize,
    /// Transfers that are on their way at once.
    pub transfers: usize,
}

/// USB, as one program sees it.
pub trait UsbSys {
    /// An open device.
    type Device: UsbDevice;

    /// What is plugged in.
    ///
    /// # Errors
    /// [`UsbError`] when the system does not say.
    fn devices(&mut self) -> Result<Vec<DeviceInfo>, UsbError>;

    /// Opens a device.
    ///
    /// # Errors
    /// [`UsbError`].
    fn open(&mut self, address: Address) -> Result<Self::Device, UsbError>;

    /// Lets time pass.
    fn wait(&mut self, time: Duration);
}

/// An open device. What it holds ends when it is dropped.
pub trait UsbDevice {
    /// Its serial number, if it has one.
    fn serial(&mut self) -> Option<String>;

    /// Takes an interface, from the kernel's driver if there is one.
    ///
    /// # Errors
    /// [`UsbError`].
    fn claim(&mut self, interface: u8) -> Result<(), UsbError>;

    /// A control transfer to the host: how many bytes came.
    ///
    /// # Errors
    /// [`UsbError`].
    fn control_in(&mut self, request: Request, data: &mut [u8], timeout: Duration) -> Result<usize, UsbError>;

    /// A control transfer to the device: how many bytes went.
    ///
    /// # Errors
    /// [`UsbError`].
    fn control_out(&mut self, request: Request, data: &[u8], timeout: Duration) -> Result<usize, UsbError>;

    /// A bulk transfer to the host: how many bytes came, at least one; what came before the time was up counts.
    ///
    /// # Errors
    /// [`UsbError`].
    fn bulk_in(&mut self, endpoint: u8, data: &mut [u8], timeout: Duration) -> Result<usize, UsbError>;

    /// Lets an endpoint that stalled go on.
    ///
    /// # Errors
    /// [`UsbError`].
    fn clear_halt(&mut self, endpoint: u8) -> Result<(), UsbError>;

    /// Begins isochronous transfers to the host.
    ///
    /// # Errors
    /// [`UsbError`].
    fn start_iso(&mut self, layout: IsoLayout) -> Result<(), UsbError>;

    /// Gives the packets of the next transfer in their order, `None` for one that the bus lost; how many there were.
    ///
    /// # Errors
    /// [`UsbError::Timeout`] when no transfer came back in time; [`UsbError`].
    fn next_iso(&mut self, timeout: Duration, packet: &mut dyn FnMut(Option<&[u8]>)) -> Result<usize, UsbError>;

    /// Ends isochronous transfers; no packet comes after it.
    fn stop_iso(&mut self);
}
