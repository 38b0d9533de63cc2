//! Nothing is allocated once a stream runs, and nothing is lost count of: twenty thousand frames and their readings over the bulk protocol, with
//! bits that turn over, messages that are cut, and stalls. A program of its own, without a harness: its allocator counts the whole process.

#![allow(unsafe_code, reason = "a counting global allocator can't be written without")]

#[path = "../../source/tests/common/counting.rs"]
mod counting;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use counting::ALLOCATIONS;
use isobath::glam::Vec3;
use isobath::ground::image::ImageView;
use isobath::ground::units::Timestamp;
use isobath::sensing::camera::{Camera, Distortion, Intrinsics};
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::imu::ImuSample;
use isobath::wire::bulk::{Encoding, Hello, Serial, encode_depth, encode_hello, encode_imu};
use isobath_source::{Deadline, DepthSource, ImuSource, Outcome, OwnedFrame};
use isobath_usb::bulk::{Bulk, CLASS, wanted};
use isobath_usb::link::Options;
use isobath_usb::sys::{Address, DeviceInfo, Interface, IsoLayout, Request, UsbDevice, UsbError, UsbSys};

/// All that is allocated counts.
fn counts() -> bool {
    true
}

/// A device that writes its next message when it is asked for bytes, and does it wrong now and then.
struct Endless {
    sequence: u32,
    depth: Vec<u16>,
    random: u32,
    frames_sent: std::sync::Arc<AtomicUsize>,
}

impl Endless {
    fn random(&mut self) -> u32 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 17;
        self.random ^= self.random << 5;
        self.random
    }
}

impl UsbSys for Endless {
    type Device = Self;

    fn devices(&mut self) -> Result<Vec<DeviceInfo>, UsbError> {
        let interfaces = vec![Interface { number: 0, class: CLASS, bulk_in: Some(0x81) }];
        Ok(vec![DeviceInfo { address: Address { bus: 1, device: 1 }, vendor: 1, product: 1, interfaces }])
    }

    fn open(&mut self, _: Address) -> Result<Self, UsbError> {
        Ok(Self { sequence: 0, depth: self.depth.clone(), random: 1, frames_sent: self.frames_sent.clone() })
    }

    fn wait(&mut self, _: Duration) {}
}

impl UsbDevice for Endless {
    fn serial(&mut self) -> Option<String> {
        None
    }
    fn claim(&mut self, _: u8) -> Result<(), UsbError> {
        Ok(())
    }
    fn control_in(&mut self, _: Request, _: &mut [u8], _: Duration) -> Result<usize, UsbError> {
        Err(UsbError::Stall)
    }
    fn control_out(&mut self, _: Request, _: &[u8], _: Duration) -> Result<usize, UsbError> {
        Err(UsbError::Stall)
    }
    fn bulk_in(&mut self, _: u8, data: &mut [u8], _: Duration) -> Result<usize, UsbError> {
        if self.random().is_multiple_of(50) {
            return Err(UsbError::Stall);
        }
        let (n, time) = (self.sequence, Timestamp::from_nanos(i64::from(self.sequence) * 1_000_000));
        self.sequence += 1;
        let used = match n % 3 {
            0 => {
                let camera =
                    Camera { intrinsics: Intrinsics::new(9.0, 9.0, 19.5, 14.5).unwrap(), distortion: Distortion::None };
                let depth = Some((40, 30, DepthUnit::MILLIMETRE, camera));
                let serial = Serial::default();
                let hello = Hello { depth, frame_interval: 0, imu_millihertz: 1, imu_offset: 0, firmware: 0, serial };
                encode_hello(&hello, n, time, data)
            }
            1 => {
                self.frames_sent.store((n / 3) as usize, Ordering::SeqCst);
                let view = ImageView::new(&self.depth, 40, 30).unwrap();
                encode_depth(view, DepthUnit::MILLIMETRE, 0, Encoding::Rvl, n / 3, time, data)
            }
            _ => encode_imu(&[ImuSample { time, rate: Vec3::X, force: Vec3::Y, field: None }], n / 3, data),
        };
        let mut used = used.unwrap();
        // The first ones come whole: there must be a hello.
        if n > 3 {
            match self.random() % 40 {
                0 => data[self.random() as usize % used] ^= 4,
                1 => used = 1 + self.random() as usize % used,
                _ => {}
            }
        }
        Ok(used)
    }
    fn clear_halt(&mut self, _: u8) -> Result<(), UsbError> {
        Ok(())
    }
    fn start_iso(&mut self, _: IsoLayout) -> Result<(), UsbError> {
        Err(UsbError::Stall)
    }
    fn next_iso(&mut self, _: Duration, _: &mut dyn FnMut(Option<&[u8]>)) -> Result<usize, UsbError> {
        Err(UsbError::Stall)
    }
    fn stop_iso(&mut self) {}
}

fn main() {
    let frames_sent = std::sync::Arc::new(AtomicUsize::new(0));
    let depth = (0..1200).map(|i| 500 + i).collect();
    let sys = Endless { sequence: 0, depth, random: 1, frames_sent: frames_sent.clone() };
    let mut source = Bulk::open(sys, wanted(None), Options::default()).unwrap();
    let mut frame = OwnedFrame::new();
    let mut readings = [ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None }; 8];
    let (mut frames, mut before, mut first, mut gaps) = (0_u64, 0, None, 0);
    let mut last = 0;
    while frames < 20_000 {
        if frames == 100 {
            before = ALLOCATIONS.load(Ordering::SeqCst);
        }
        match source.next_into(&mut frame, Deadline::NEVER).unwrap() {
            Outcome::Frame => {
                frames += 1;
                first.get_or_insert(frame.sequence);
                last = frame.sequence;
            }
            // Stalls; and the device's clock and the host's do not fit, so there are jumps too.
            Outcome::Recovered(_) => gaps += 1,
            other => panic!("{other:?}"),
        }
        let _ = source.read(&mut readings, Deadline::NEVER).unwrap();
    }
    assert_eq!(ALLOCATIONS.load(Ordering::SeqCst) - before, 0);
    let stats = source.stats();
    assert!(gaps > 0 && stats.recoveries > 1000 && stats.dropped_by_device > 500, "{stats:?}");
    // Reading on for inertial readings may have replaced frames that waited.
    let newest = frames_sent.load(Ordering::SeqCst) as u64;
    let span = last - first.unwrap() + 1;
    assert!((span..=newest + 1).contains(&stats.span()), "{stats:?}, {span} to {newest}");
}
