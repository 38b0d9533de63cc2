//! What is plugged in, as the kernel's file tree says it: no node is opened for it, and names of nodes mean nothing.
//!
//! `/sys/class/video4linux/videoN` is a link to a directory below the device: `device` leads to the USB interface (its number in
//! `bInterfaceNumber`), whose parent is the USB device with vendor, product and serial number. Nodes of one camera share that parent, which is how
//! depth, colour and metadata nodes find each other. The root of the tree is a parameter, so that tests can make one.

use std::fs;
use std::path::{Path, PathBuf};

/// A USB device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Usb {
    /// Its directory, the same for all its nodes.
    pub directory: PathBuf,
    /// Vendor number.
    pub vendor: u16,
    /// Product number.
    pub product: u16,
    /// Serial number, if it has one.
    pub serial: Option<String>,
    /// What it calls itself.
    pub name: Option<String>,
    /// Megabits a second that it is connected at, whole ones: 480 is high speed, 5000 `SuperSpeed`.
    pub speed: Option<u32>,
}

/// A node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    /// Its path below `/dev`.
    pub path: PathBuf,
    /// What its driver calls it.
    pub name: String,
    /// Which node of its interface it is.
    pub index: u32,
    /// The USB interface's number.
    pub interface: Option<u8>,
    /// The USB device; `None` for cameras on other buses.
    pub usb: Option<Usb>,
}

/// The file trees of a machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Roots {
    /// `/sys`.
    pub sys: PathBuf,
    /// `/dev`.
    pub dev: PathBuf,
}

impl Default for Roots {
    fn default() -> Self {
        Self { sys: "/sys".into(), dev: "/dev".into() }
    }
}

/// The first line of a file, if it can be read and says anything.
fn line(path: &Path) -> Option<String> {
    let bytes = fs::read(path).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let line = text.lines().next()?.trim().to_owned();
    (!line.is_empty()).then_some(line)
}

fn hex(path: &Path) -> Option<u16> {
    u16::from_str_radix(&line(path)?, 16).ok()
}

impl Roots {
    /// The video nodes, in the order of their numbers.
    #[must_use]
    pub fn nodes(&self) -> Vec<Node> {
        let Ok(entries) = fs::read_dir(self.sys.join("class/video4linux")) else { return Vec::new() };
        let mut nodes: Vec<(u32, Node)> = entries
            .flatten()
            .filter_map(|entry| {
                let name = entry.file_name();
                let name = name.to_str()?;
                let number = name.strip_prefix("video")?.parse().ok()?;
                Some((number, self.node(name, &entry.path())))
            })
            .collect();
        nodes.sort_by_key(|(number, _)| *number);
        nodes.into_iter().map(|(_, node)| node).collect()
    }

    /// The node at a path, whatever links lead there; `None` when the kernel knows no such one.
    #[must_use]
    pub fn find(&self, path: &Path) -> Option<Node> {
        let real = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let name = real.file_name()?.to_str()?;
        let directory = self.sys.join("class/video4linux").join(name);
        directory.is_dir().then(|| self.node(name, &directory))
    }

    fn node(&self, name: &str, directory: &Path) -> Node {
        let device = fs::canonicalize(directory.join("device")).ok();
        let interface = device.as_ref().and_then(|d| u8::from_str_radix(&line(&d.join("bInterfaceNumber"))?, 16).ok());
        // The USB device is the interface's parent; others are their own.
        let usb = device.as_ref().and_then(|d| d.ancestors().take(2).find_map(usb));
        Node {
            path: self.dev.join(name),
            name: line(&directory.join("name")).unwrap_or_else(|| name.to_owned()),
            index: line(&directory.join("index")).and_then(|l| l.parse().ok()).unwrap_or(0),
            interface,
            usb,
        }
    }

    /// The other nodes of a node's USB device.
    #[must_use]
    pub fn siblings(&self, node: &Node) -> Vec<Node> {
        let Some(usb) = &node.usb else { return Vec::new() };
        let same = |n: &Node| n.path != node.path && n.usb.as_ref().is_some_and(|u| u.directory == usb.directory);
        self.nodes().into_iter().filter(same).collect()
    }
}

/// The USB device of a directory, if it is one.
fn usb(directory: &Path) -> Option<Usb> {
    Some(Usb {
        vendor: hex(&directory.join("idVendor"))?,
        product: hex(&directory.join("idProduct"))?,
        serial: line(&directory.join("serial")),
        name: line(&directory.join("product")),
        speed: line(&directory.join("speed")).and_then(|l| l.split('.').next()?.parse().ok()),
        directory: directory.to_owned(),
    })
}
