//! A device on a cable: found, opened, lost, and found again.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use isobath_source::permission::Subsystem;
use isobath_source::{Clock, Deadline, SourceError};

use crate::sys::{DeviceInfo, Interface, UsbDevice, UsbError, UsbSys};

/// How often a lost device is looked for.
const LOOK: Duration = Duration::from_millis(200);

/// Which device is meant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wanted {
    /// Vendor's number; any when `None`.
    pub vendor: Option<u16>,
    /// Product numbers; any when empty.
    pub products: Vec<u16>,
    /// Class, subclass and protocol of the interface; the first interface when `None`.
    pub class: Option<[u8; 3]>,
    /// Serial number; any when `None`.
    pub serial: Option<String>,
}

impl Wanted {
    fn interface(&self, info: &DeviceInfo) -> Option<Interface> {
        let vendor = self.vendor.is_none_or(|v| v == info.vendor);
        let product = self.products.is_empty() || self.products.contains(&info.product);
        let mut interfaces = info.interfaces.iter().filter(|i| self.class.is_none_or(|class| class == i.class));
        interfaces.next().copied().filter(|_| vendor && product)
    }

    /// The devices that fit, but for their serial numbers, which only an open device tells.
    pub fn among<'a>(&'a self, all: &'a [DeviceInfo]) -> impl Iterator<Item = (&'a DeviceInfo, Interface)> {
        all.iter().filter_map(|info| Some((info, self.interface(info)?)))
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a USB device")?;
        if let Some(vendor) = self.vendor {
            write!(f, " of vendor {vendor:04x}")?;
        }
        for (i, product) in self.products.iter().enumerate() {
            write!(f, "{} {product:04x}", if i == 0 { ", product" } else { " or" })?;
        }
        if let Some([a, b, c]) = self.class {
            write!(f, " with an interface of class {a:02x}/{b:02x}/{c:02x}")?;
        }
        if let Some(serial) = &self.serial {
            write!(f, " and serial number {serial}")?;
        }
        Ok(())
    }
}

/// What happens when things go wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// A device that was unplugged is waited for: calls time out until it is back, and then say so
    /// ([`Outcome::Recovered`](isobath_source::Outcome::Recovered)). Otherwise it is an end.
    pub reconnect: bool,
}

/// An open device, or the place where one was.
pub struct Link<S: UsbSys> {
    sys: S,
    wanted: Wanted,
    options: Options,
    device: Option<S::Device>,
    interface: Interface,
    numbers: (u16, u16),
    path: PathBuf,
    serial: Option<String>,
    /// It is gone and will not be looked for.
    ended: bool,
}

impl<S: UsbSys> fmt::Debug for Link<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link").field("path", &self.path).field("open", &self.device.is_some()).finish_non_exhaustive()
    }
}

impl<S: UsbSys> Link<S> {
    /// Opens the first device that fits, and takes its interface.
    ///
    /// # Errors
    /// [`SourceError::Unsupported`] when none is there; [`SourceError`] of the first that could not be opened.
    pub fn open(mut sys: S, wanted: Wanted, options: Options) -> Result<Self, SourceError> {
        let mut first = None;
        let listed = |e: UsbError| SourceError::io("/dev/bus/usb", io::Error::from_raw_os_error(e.errno()));
        let all = sys.devices().map_err(listed)?;
        for (info, interface) in wanted.among(&all) {
            match open_one(&mut sys, info, interface, &wanted) {
                Ok(Some((device, serial))) => {
                    let (numbers, path) = ((info.vendor, info.product), info.address.path());
                    // The same one, when it comes back.
                    let wanted = Wanted { serial: serial.clone().or(wanted.serial.clone()), ..wanted.clone() };
                    let device = Some(device);
                    return Ok(Self { sys, wanted, options, device, interface, numbers, path, serial, ended: false });
                }
                Ok(None) => {}
                Err(e) => _ = first.get_or_insert_with(|| error(info, "opening it", e)),
            }
        }
        Err(first.unwrap_or_else(|| SourceError::Unsupported {
            path: "/dev/bus/usb".into(),
            what: format!("{wanted} is not plugged in"),
            hint: "plug it in (Kinect: its power supply too); lsusb and isobath devices show what is there".to_owned(),
        }))
    }

    /// The device.
    ///
    /// # Errors
    /// [`UsbError::Gone`] while it is not there.
    pub fn device(&mut self) -> Result<&mut S::Device, UsbError> {
        self.device.as_mut().ok_or(UsbError::Gone)
    }

    /// The interface taken.
    #[must_use]
    pub const fn interface(&self) -> Interface {
        self.interface
    }

    /// Where it was last plugged in.
    #[must_use]
    pub const fn path(&self) -> &PathBuf {
        &self.path
    }

    /// Its serial number, if it has one.
    #[must_use]
    pub fn serial(&self) -> Option<&str> {
        self.serial.as_deref()
    }

    /// Whether it is open.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.device.is_some()
    }

    /// An error of this device, in the words of sources.
    #[must_use]
    pub fn error(&self, doing: &'static str, error: UsbError) -> SourceError {
        let error = io::Error::from_raw_os_error(error.errno());
        SourceError::device(&self.path, doing, Subsystem::Usb, Some(self.numbers), error)
    }

    /// Lets time pass, but not beyond a deadline.
    pub fn wait(&mut self, time: Duration, deadline: Deadline, clock: &dyn Clock) {
        let left = deadline.remaining(clock.now()).unwrap_or(time);
        self.sys.wait(time.min(left));
    }

    /// The device is gone: closes it.
    ///
    /// # Errors
    /// [`SourceError::Disconnected`] when it is not to be waited for, now and ever after.
    pub fn lost(&mut self) -> Result<(), SourceError> {
        self.device = None;
        self.ended |= !self.options.reconnect;
        if self.ended { Err(SourceError::Disconnected { device: self.path.display().to_string() }) } else { Ok(()) }
    }

    /// Looks for the device until it is back and open, or the time is up: whether it is.
    ///
    /// # Errors
    /// [`SourceError::Disconnected`] when it is not to be waited for.
    pub fn reopen(&mut self, deadline: Deadline, clock: &dyn Clock) -> Result<bool, SourceError> {
        loop {
            if self.device.is_some() {
                return Ok(true);
            }
            self.lost()?;
            // What can't be listed or opened now may be in a moment: udev may still be setting its rights.
            let all = self.sys.devices().unwrap_or_default();
            for (info, interface) in self.wanted.among(&all) {
                if let Ok(Some((device, serial))) = open_one(&mut self.sys, info, interface, &self.wanted) {
                    (self.device, self.interface, self.serial) = (Some(device), interface, serial);
                    (self.numbers, self.path) = ((info.vendor, info.product), info.address.path());
                    return Ok(true);
                }
            }
            if deadline.has_passed(clock.now()) {
                return Ok(false);
            }
            self.wait(LOOK, deadline, clock);
        }
    }
}

/// An open device and its serial number.
type Opened<D> = (D, Option<String>);

/// Opens a device and takes its interface; `None` when its serial number is another.
fn open_one<S: UsbSys>(
    sys: &mut S,
    info: &DeviceInfo,
    interface: Interface,
    wanted: &Wanted,
) -> Result<Option<Opened<S::Device>>, UsbError> {
    let mut device = sys.open(info.address)?;
    let serial = device.serial();
    if wanted.serial.is_some() && serial != wanted.serial {
        return Ok(None);
    }
    device.claim(interface.number)?;
    Ok(Some((device, serial)))
}

fn error(info: &DeviceInfo, doing: &'static str, error: UsbError) -> SourceError {
    let numbers = Some((info.vendor, info.product));
    let error = io::Error::from_raw_os_error(error.errno());
    SourceError::device(&info.address.path(), doing, Subsystem::Usb, numbers, error)
}
