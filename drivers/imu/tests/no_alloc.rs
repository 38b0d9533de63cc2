//! Nothing is allocated once a sensor runs. A program of its own, without a harness: its allocator counts the whole process.

#![allow(unsafe_code, reason = "a counting global allocator can't be written without")]

mod common;
#[path = "../../source/tests/common/counting.rs"]
mod counting;

use std::sync::atomic::Ordering;

use common::{ACCEL, GYRO, TIMESTAMP, Tree, now, send};
use counting::ALLOCATIONS;
use isobath::glam::Vec3;
use isobath::ground::units::Timestamp;
use isobath::sensing::imu::ImuSample;
use isobath_imu::open;
use isobath_source::{Deadline, ImuOutcome, ImuSource};

/// All that is allocated counts.
fn counts() -> bool {
    true
}

fn main() {
    let tree = Tree::new();
    let kinds: Vec<(&str, &str)> = GYRO.iter().chain(&ACCEL).map(|n| (*n, "le:s16/16>>0")).chain([TIMESTAMP]).collect();
    let mut pipe = tree.sensor(0, "x", None, &kinds, &[]);
    let mut imu = open(None, &tree.options()).unwrap();
    let empty = ImuSample { time: Timestamp::ZERO, rate: Vec3::ZERO, force: Vec3::ZERO, field: None };
    let mut out = [empty; 8];
    let mut scan = [7_u8; 24];
    let (start, mut count, mut before) = (now(), 0, 0);
    for i in 0..1100_i64 {
        if i == 100 {
            before = ALLOCATIONS.load(Ordering::SeqCst);
        }
        scan[16..].copy_from_slice(&(start + i * 1_000_000).to_le_bytes());
        send(&mut pipe, &scan);
        if let ImuOutcome::Samples(n) = imu.read(&mut out, Deadline::NEVER).unwrap() {
            count += n;
        }
    }
    assert_eq!((count, ALLOCATIONS.load(Ordering::SeqCst) - before), (1100, 0));
}
