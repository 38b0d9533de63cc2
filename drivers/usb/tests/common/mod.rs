//! A scripted USB: what each transfer answers is said beforehand, time passes only while somebody waits, and every call is counted.

#![allow(dead_code, unreachable_pub, reason = "each test program uses a part of it")]

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use isobath::sensing::depth::decode::kinect::Constants;
use isobath::wire::device::gmrb::{self, Packet};
use isobath::wire::device::kinect::packets::{PACKET, PACKETS, write_packet};
use isobath::wire::device::kinect::{
    ALGORITHM_PARAMS, FIXED_PARAMS, FRAME_BYTES, PRODUCTS, VENDOR, WRITE_REGISTER, encode_constants,
};
use isobath_source::{Clock, HostNanos};
use isobath_usb::bulk::CLASS;
use isobath_usb::sys::{Address, DeviceInfo, Interface, IsoLayout, Request, UsbDevice, UsbError, UsbSys};

/// What the next bulk transfer, or the next isochronous one, does.
#[derive(Debug, Clone)]
pub enum Act {
    /// Gives bytes; what does not fit stays for the next transfer.
    Data(Vec<u8>),
    /// Fails at once.
    Fail(UsbError),
    /// The device is pulled out; after so many looks it is there again, under a new address.
    Unplug(Option<usize>),
    /// Packets; `None` for one that the bus lost.
    Packets(Vec<Option<Vec<u8>>>),
    /// So much time passes without anything.
    Silence(Duration),
}

/// Everything there is.
#[derive(Debug, Default)]
pub struct World {
    pub now: u64,
    pub script: VecDeque<Act>,
    pub absent: Option<usize>,
    pub gone_for_good: bool,
    pub address: u8,
    pub kinect: bool,
    pub refuses_constants: bool,
    pub access: bool,
    pub halted: bool,
    pub cleared: usize,
    /// Calls of any kind.
    pub calls: usize,
    pub streaming: bool,
    pub registers: Vec<(u16, u16)>,
    answer: Vec<u8>,
    waits: usize,
}

/// A handle to it.
#[derive(Debug, Clone, Default)]
pub struct Fake(pub Arc<Mutex<World>>);

impl Fake {
    pub fn bulk(script: impl IntoIterator<Item = Act>) -> Self {
        let world = World { script: script.into_iter().collect(), ..World::default() };
        Self(Arc::new(Mutex::new(world)))
    }

    pub fn kinect(script: impl IntoIterator<Item = Act>) -> Self {
        let fake = Self::bulk(script);
        fake.world().kinect = true;
        fake
    }

    pub fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap()
    }
}

impl Clock for Fake {
    fn now(&self) -> HostNanos {
        HostNanos(1_000_000_000 + self.world().now)
    }
}

/// An open device of it; calls after an unplug find it gone.
#[derive(Debug)]
pub struct FakeDevice {
    fake: Fake,
    address: u8,
}

impl World {
    fn there(&mut self, address: u8) -> Result<(), UsbError> {
        self.calls += 1;
        if self.absent.is_some() || self.gone_for_good || self.address != address {
            Err(UsbError::Gone)
        } else {
            Ok(())
        }
    }

    fn pass(&mut self, time: Duration) {
        assert!(time > Duration::ZERO, "a transfer without a limit");
        self.now += u64::try_from(time.as_nanos()).unwrap();
    }

    fn unplug(&mut self, looks: Option<usize>) {
        match looks {
            Some(looks) => self.absent = Some(looks),
            None => self.gone_for_good = true,
        }
        self.halted = false;
        self.streaming = false;
    }
}

impl UsbSys for Fake {
    type Device = FakeDevice;

    fn devices(&mut self) -> Result<Vec<DeviceInfo>, UsbError> {
        let mut world = self.world();
        world.calls += 1;
        match world.absent {
            Some(0) => {
                world.absent = None;
                world.address += 1;
            }
            Some(looks) => {
                world.absent = Some(looks - 1);
                return Ok(Vec::new());
            }
            None if world.gone_for_good => return Ok(Vec::new()),
            None => {}
        }
        let (vendor, product) = if world.kinect { (VENDOR, PRODUCTS[0]) } else { (0x1209, 1) };
        let class = if world.kinect { [0xff; 3] } else { CLASS };
        let interface = Interface { number: 0, class, bulk_in: (!world.kinect).then_some(0x81) };
        let address = Address { bus: 1, device: world.address };
        let hub =
            DeviceInfo { address: Address { bus: 1, device: 99 }, vendor: 0x1d6b, product: 2, interfaces: vec![] };
        Ok(vec![hub, DeviceInfo { address, vendor, product, interfaces: vec![interface] }])
    }

    fn open(&mut self, address: Address) -> Result<FakeDevice, UsbError> {
        let mut world = self.world();
        world.calls += 1;
        if world.access {
            return Err(UsbError::Access);
        }
        assert_eq!(address.device, world.address);
        Ok(FakeDevice { fake: self.clone(), address: address.device })
    }

    fn wait(&mut self, time: Duration) {
        let mut world = self.world();
        world.now += u64::try_from(time.as_nanos()).unwrap();
    }
}

impl UsbDevice for FakeDevice {
    fn serial(&mut self) -> Option<String> {
        Some("S1".to_owned())
    }

    fn claim(&mut self, _: u8) -> Result<(), UsbError> {
        self.fake.world().there(self.address)
    }

    fn control_in(&mut self, _: Request, data: &mut [u8], _: Duration) -> Result<usize, UsbError> {
        let mut world = self.fake.world();
        world.there(self.address)?;
        // The first two times it is not ready, in both of the ways there are.
        world.waits += 1;
        match world.waits {
            1 => return Ok(0),
            2 => return Ok(data.len()),
            _ => {}
        }
        let answer = std::mem::take(&mut world.answer);
        data[..answer.len()].copy_from_slice(&answer);
        Ok(answer.len())
    }

    fn control_out(&mut self, _: Request, data: &[u8], _: Duration) -> Result<usize, UsbError> {
        let mut world = self.fake.world();
        world.there(self.address)?;
        world.waits = 0;
        let question = gmrb::question(data).unwrap();
        let (fixed, shift) = encode_constants(&Constants::NOMINAL);
        let payload = match question.opcode {
            FIXED_PARAMS if world.refuses_constants => vec![3, 0],
            FIXED_PARAMS => fixed.to_vec(),
            ALGORITHM_PARAMS => shift.to_vec(),
            WRITE_REGISTER => {
                let word = |i: usize| u16::from_le_bytes([question.payload[i], question.payload[i + 1]]);
                world.registers.push((word(0), word(2)));
                vec![0, 0]
            }
            _ => vec![2, 0],
        };
        let mut answer = vec![0; 8 + payload.len()];
        gmrb::encode_answer(&Packet { payload: &payload, ..question }, &mut answer).unwrap();
        world.answer = answer;
        Ok(data.len())
    }

    fn bulk_in(&mut self, endpoint: u8, data: &mut [u8], timeout: Duration) -> Result<usize, UsbError> {
        assert!(endpoint == 0x81 && data.len().is_multiple_of(1024), "a packet may be cut");
        let mut world = self.fake.world();
        world.there(self.address)?;
        if world.halted {
            return Err(UsbError::Stall);
        }
        match world.script.pop_front() {
            Some(Act::Data(mut bytes)) => {
                let now = bytes.len().min(data.len());
                data[..now].copy_from_slice(&bytes[..now]);
                if now < bytes.len() {
                    bytes.drain(..now);
                    world.script.push_front(Act::Data(bytes));
                }
                world.now += 1_000_000;
                Ok(now)
            }
            Some(Act::Fail(e)) => {
                world.halted = e == UsbError::Stall;
                Err(e)
            }
            Some(Act::Unplug(looks)) => {
                world.unplug(looks);
                // What most systems say first.
                Err(UsbError::Io)
            }
            Some(Act::Silence(time)) => {
                if time > timeout {
                    world.script.push_front(Act::Silence(time - timeout));
                }
                world.pass(timeout.min(time));
                Err(UsbError::Timeout)
            }
            Some(Act::Packets(_)) => panic!("packets on a bulk endpoint"),
            None => {
                world.pass(timeout);
                Err(UsbError::Timeout)
            }
        }
    }

    fn clear_halt(&mut self, _: u8) -> Result<(), UsbError> {
        let mut world = self.fake.world();
        world.there(self.address)?;
        world.halted = false;
        world.cleared += 1;
        Ok(())
    }

    fn start_iso(&mut self, layout: IsoLayout) -> Result<(), UsbError> {
        let mut world = self.fake.world();
        world.there(self.address)?;
        assert!(!world.streaming && layout.packet == PACKET);
        world.streaming = true;
        Ok(())
    }

    fn next_iso(&mut self, timeout: Duration, packet: &mut dyn FnMut(Option<&[u8]>)) -> Result<usize, UsbError> {
        let act = {
            let mut world = self.fake.world();
            world.there(self.address)?;
            assert!(world.streaming, "nothing was started");
            let act = world.script.pop_front();
            match &act {
                Some(Act::Packets(_)) => world.now += 2_000_000,
                Some(Act::Silence(time)) => {
                    if *time > timeout {
                        world.script.push_front(Act::Silence(*time - timeout));
                    }
                    world.pass(timeout.min(*time));
                }
                Some(Act::Unplug(looks)) => world.unplug(*looks),
                Some(_) => {}
                None => world.pass(timeout),
            }
            act
        };
        match act {
            Some(Act::Packets(packets)) => {
                for p in &packets {
                    packet(p.as_deref());
                }
                Ok(packets.len())
            }
            Some(Act::Fail(e)) => Err(e),
            Some(Act::Unplug(_)) => Err(UsbError::Gone),
            _ => Err(UsbError::Timeout),
        }
    }

    fn stop_iso(&mut self) {
        self.fake.world().streaming = false;
    }
}

/// The codes of a Kinect's frame, packed: each number another picture.
pub fn picture(number: usize) -> Vec<u8> {
    let mut bytes = vec![0; FRAME_BYTES];
    let (mut held, mut bits, mut at) = (0_u32, 0, 0);
    for i in 0..640 * 480 {
        held = held << 11 | (400 + (i + i / 640 * 3 + number * 17) % 600) as u32;
        bits += 11;
        while bits >= 8 {
            bits -= 8;
            bytes[at] = (held >> bits) as u8;
            at += 1;
        }
        held &= (1 << bits) - 1;
    }
    bytes
}

/// The packets of frames, one after the other.
pub fn packets(frames: std::ops::Range<usize>) -> Vec<Option<Vec<u8>>> {
    let mut all = Vec::new();
    let mut sequence = (frames.start * PACKETS) as u8;
    for number in frames {
        let frame = picture(number);
        for index in 0..PACKETS {
            let mut packet = [0; PACKET];
            let used = write_packet(&frame, index, sequence, number as u32, &mut packet);
            all.push(Some(packet[..used].to_vec()));
            sequence = sequence.wrapping_add(1);
        }
    }
    all
}
