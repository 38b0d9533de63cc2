//! The other way into the kernel: a device of one vendor-specific interface, on the kernel's own device side (`dummy_hcd`, `FunctionFS`).
//!
//! The kernel answers chapter 9's requests itself here, gives endpoints the addresses it likes, and cuts transfers as a real
//! device controller would, so this is a second opinion on [`usb`](crate::usb). It has no isochronous endpoints, no classes, no unplugging in the middle
//! of a transfer. Source: `Documentation/usb/functionfs.rst` and `include/uapi/linux/usb/functionfs.h` of Linux. Needs root, `dummy_hcd`, `libcomposite`
//! and `usb_f_fs`.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::usb::{Device, Endpoint, Kind, Next, Speed};

const GADGET: &str = "/sys/kernel/config/usb_gadget/isobath";
const FUNCTION: &str = "/dev/isobath-function";
const CONTROLLER: &str = "dummy_udc.0";

/// A device that is bound to the controller, until this is dropped.
#[derive(Debug)]
pub struct Gadget {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Gadget {
    /// Binds a device whose only endpoint is a bulk one, IN.
    ///
    /// # Errors
    /// A module is not loaded, or the kernel refuses.
    pub fn bind<D: Device>(mut device: D) -> io::Result<Self> {
        let described = device.descriptors();
        let identity = described.identity;
        // The interface's descriptor follows the configuration's nine bytes.
        let class = described.configuration.get(14..17).and_then(|c| c.try_into().ok()).unwrap_or([0xff, 0, 0]);
        let gadget = Path::new(GADGET);
        if !gadget.parent().is_some_and(Path::is_dir) {
            mount("configfs", "/sys/kernel/config")?;
        }
        fs::create_dir(gadget)?;
        for (file, value) in [("idVendor", identity.vendor), ("idProduct", identity.product)] {
            fs::write(gadget.join(file), format!("{value:#06x}"))?;
        }
        let strings = gadget.join("strings/0x409");
        fs::create_dir(&strings)?;
        let names =
            [("manufacturer", &identity.maker), ("product", &identity.name), ("serialnumber", &identity.serial)];
        for (file, value) in names {
            fs::write(strings.join(file), value)?;
        }
        let (configuration, function) = (gadget.join("configs/c.1"), gadget.join("functions/ffs.isobath"));
        fs::create_dir(&configuration)?;
        fs::create_dir(&function)?;
        std::os::unix::fs::symlink(&function, configuration.join("ffs.isobath"))?;
        fs::create_dir_all(FUNCTION)?;
        mount("functionfs", FUNCTION)?;
        let mut control = open("ep0")?;
        control.write_all(&descriptors(class))?;
        control.write_all(&strings_block())?;
        let stop = Arc::new(AtomicBool::new(false));
        let (over, start) = (Arc::clone(&stop), Instant::now());
        let mut endpoint = open("ep1")?;
        // A write waits until the host reads, so nothing is sent to nobody.
        let sender = std::thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                match device.transfer(0x81, start.elapsed()) {
                    Next::Now(transfer) => {
                        if endpoint.write_all(&transfer.data).is_err() {
                            std::thread::sleep(Duration::from_millis(10)); // not configured (any more)
                        }
                    }
                    Next::At(time) => std::thread::sleep(time.saturating_sub(start.elapsed())),
                    Next::Idle => std::thread::sleep(Duration::from_millis(5)),
                }
            }
        });
        fs::write(gadget.join("UDC"), CONTROLLER)?;
        Ok(Self { stop, threads: vec![sender] })
    }
}

impl Drop for Gadget {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let gadget = Path::new(GADGET);
        // Unbinding ends a write that waits.
        let _ = fs::write(gadget.join("UDC"), "\n");
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
        let _ = Command::new("umount").arg(FUNCTION).status();
        let _ = fs::remove_file(gadget.join("configs/c.1/ffs.isobath"));
        for folder in ["configs/c.1", "functions/ffs.isobath", "strings/0x409", ""] {
            let _ = fs::remove_dir(gadget.join(folder));
        }
    }
}

fn mount(kind: &str, at: &str) -> io::Result<()> {
    // The name of what is mounted is the function's.
    let status = Command::new("mount").args(["-t", kind, "isobath", at]).status()?;
    if status.success() { Ok(()) } else { Err(io::Error::other(format!("mounting {kind} failed"))) }
}

fn open(file: &str) -> io::Result<File> {
    OpenOptions::new().read(true).write(true).open(Path::new(FUNCTION).join(file))
}

/// Descriptors at three speeds, behind a header (version 2).
fn descriptors([class, subclass, protocol]: [u8; 3]) -> Vec<u8> {
    const MAGIC: u32 = 3;
    const ALL_SPEEDS: u32 = 1 | 2 | 4;
    let endpoint = |speed| Endpoint { address: 0x81, kind: Kind::Bulk }.descriptor(speed);
    let mut full = endpoint(Speed::High);
    full[4..6].copy_from_slice(&[64, 0]);
    let interface = [9, 4, 0, 0, 1, class, subclass, protocol, 1];
    let all = [full, endpoint(Speed::High), endpoint(Speed::Super)].map(|e| [&interface[..], &e].concat());
    // Interface and endpoint; at 5 Gbit/s with its companion, three.
    let counts = [2u32, 2, 3];
    let length = 12 + 12 + all.iter().map(Vec::len).sum::<usize>();
    let head = [MAGIC, length as u32, ALL_SPEEDS];
    head.into_iter().chain(counts).flat_map(u32::to_le_bytes).chain(all.into_iter().flatten()).collect()
}

/// The interface's name, in English, behind a header.
fn strings_block() -> Vec<u8> {
    const MAGIC: u32 = 2;
    let name = b"Headset\0";
    let head = [MAGIC, 16 + 2 + name.len() as u32, 1, 1];
    head.into_iter().flat_map(u32::to_le_bytes).chain([9, 4]).chain(*name).collect()
}
