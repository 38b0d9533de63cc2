//! Descriptors: how a device describes itself (USB 2.0 section 9.6, USB 3.2 section 9.6).

/// How fast the link is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Speed {
    /// 480 Mbit/s.
    High,
    /// 5 Gbit/s.
    Super,
}

/// A device's numbers and names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// `idVendor`.
    pub vendor: u16,
    /// `idProduct`.
    pub product: u16,
    /// Class, subclass and protocol.
    pub class: [u8; 3],
    /// The maker's name.
    pub maker: String,
    /// The product's name.
    pub name: String,
    /// The serial number.
    pub serial: String,
    /// The link.
    pub speed: Speed,
}

/// The class of a device whose interfaces are grouped by associations.
pub const BY_ASSOCIATION: [u8; 3] = [0xef, 2, 1];

impl Identity {
    /// The device descriptor.
    #[must_use]
    pub fn device(&self) -> Vec<u8> {
        // A version of 2.00 or 3.00, and the control endpoint's packets: 64 bytes, or 2 to the 9th.
        let (version, control) = match self.speed {
            Speed::High => (2, 64),
            Speed::Super => (3, 9),
        };
        let mut d = vec![18, 1, 0, version];
        d.extend(self.class);
        d.push(control);
        d.extend(self.vendor.to_le_bytes());
        d.extend(self.product.to_le_bytes());
        d.extend([0, 1, 1, 2, 3, 1]);
        d
    }

    /// The binary object store of a 5 Gbit/s device: it knows link power management, and its speeds.
    #[must_use]
    pub fn object_store(&self) -> Option<Vec<u8>> {
        let usb2 = [7, 0x10, 2, 2, 0, 0, 0];
        let usb3 = [10, 0x10, 3, 0, 0x0e, 0, 1, 0, 0, 0];
        (self.speed == Speed::Super).then(|| [&[5, 15, 22, 0, 2][..], &usb2, &usb3].concat())
    }

    /// A string descriptor; number 0 lists the languages (one: English).
    #[must_use]
    pub fn string(&self, number: u8) -> Option<Vec<u8>> {
        let text = match number {
            0 => return Some(vec![4, 3, 9, 4]),
            1 => &self.maker,
            2 => &self.name,
            3 => &self.serial,
            _ => return None,
        };
        let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        Some([&[2 + units.len() as u8, 3], &units[..]].concat())
    }
}

/// How an endpoint carries bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// At a fixed pace, unacknowledged.
    Isochronous {
        /// Bytes in a packet, up to 1024.
        bytes: u16,
        /// Packets in an interval of 125 microseconds: 1 to 3.
        packets: u16,
    },
    /// When there is room, acknowledged.
    Bulk,
    /// Asked for every so often.
    Interrupt {
        /// Bytes in a packet.
        bytes: u16,
        /// The period is 125 microseconds times 2 to this, less one.
        interval: u8,
    },
}

/// An endpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Endpoint {
    /// With bit 7 set for IN.
    pub address: u8,
    /// How.
    pub kind: Kind,
}

impl Endpoint {
    /// Its descriptor, at 5 Gbit/s with its companion.
    #[must_use]
    pub fn descriptor(&self, speed: Speed) -> Vec<u8> {
        let (attributes, interval) = match self.kind {
            Kind::Isochronous { .. } => (5, 1), // asynchronous: the device's own clock
            Kind::Bulk => (2, 0),
            Kind::Interrupt { interval, .. } => (3, interval),
        };
        let (size, burst, per_interval) = match (self.kind, speed) {
            (Kind::Isochronous { bytes, packets }, Speed::High) => (bytes | (packets - 1) << 11, 0, 0),
            (Kind::Isochronous { bytes, packets }, Speed::Super) => (bytes, packets - 1, bytes * packets),
            (Kind::Bulk, Speed::High) => (512, 0, 0),
            (Kind::Bulk, Speed::Super) => (1024, 0, 0),
            (Kind::Interrupt { bytes, .. }, _) => (bytes, 0, bytes),
        };
        let [low, high] = size.to_le_bytes();
        let mut d = vec![7, 5, self.address, attributes, low, high, interval];
        if speed == Speed::Super {
            d.extend([6, 0x30, burst as u8, 0]);
            d.extend(per_interval.to_le_bytes());
        }
        d
    }
}

/// A configuration descriptor in the making: interfaces in order, with what is theirs after each.
#[derive(Debug, Clone)]
pub struct Configuration {
    body: Vec<u8>,
    interfaces: u8,
    speed: Speed,
}

impl Configuration {
    /// An empty one.
    #[must_use]
    pub const fn new(speed: Speed) -> Self {
        Self { body: Vec::new(), interfaces: 0, speed }
    }

    /// The next `count` interfaces are one function.
    pub fn association(&mut self, count: u8, class: [u8; 3]) {
        self.body.extend([8, 11, self.interfaces, count, class[0], class[1], class[2], 0]);
    }

    /// The next interface; its number.
    pub fn interface(&mut self, class: [u8; 3], endpoints: u8) -> u8 {
        self.interfaces += 1;
        self.alternate(0, class, endpoints)
    }

    /// Another setting of the last interface; the interface's number.
    pub fn alternate(&mut self, setting: u8, class: [u8; 3], endpoints: u8) -> u8 {
        let number = self.interfaces - 1;
        self.body.extend([9, 4, number, setting, endpoints, class[0], class[1], class[2], 0]);
        number
    }

    /// An endpoint of the last interface.
    pub fn endpoint(&mut self, endpoint: Endpoint) {
        self.body.extend(endpoint.descriptor(self.speed));
    }

    /// Descriptors of a class.
    pub fn class_specific(&mut self, bytes: &[u8]) {
        self.body.extend(bytes);
    }

    /// The link it is for.
    #[must_use]
    pub const fn speed(&self) -> Speed {
        self.speed
    }

    /// The descriptor, with everything in it.
    #[must_use]
    pub fn finish(&self) -> Vec<u8> {
        let total = (9 + self.body.len() as u16).to_le_bytes();
        // Bus-powered, 100 mA.
        let mut d = vec![9, 2, total[0], total[1], self.interfaces, 1, 0, 0x80, 50];
        d.extend(&self.body);
        d
    }
}
