//! What a firmware engineer starts from: a frame arrives in one buffer while the other is worked on, IMU samples come in between,
//! answers go out through a queue. No heap, no lock, no panic, no `unsafe`. The README walks through it.
//!
//! Nothing is shared: who holds a buffer owns it, and owners change through lock-free queues ([`heapless::spsc`]).
//!
//! ```text
//!                free buffers             full buffers, IMU samples            answers
//!   main loop ----------------> sensor -----------------------------> main loop --------> link
//!                             (SysTick here)                                             (PendSV here)
//! ```
#![no_std]
#![no_main]
#![deny(unsafe_code)]

use core::cell::Cell;

use cortex_m::peripheral::{SCB, SYST, syst::SystClkSource};
use cortex_m::singleton;
use cortex_m_rt::{entry, exception};
use critical_section::Mutex;
use heapless::spsc::{Consumer, Producer, Queue};
use isobath::glam::{Vec2, Vec3};
use isobath::ground::units::Timestamp;
use isobath::localized::hit::{HitParams, hit_test};
use isobath::localized::one_euro::{OneEuro, OneEuroParams};
use isobath::localized::placement::{PlaceParams, Spot, place};
use isobath::sensing::depth::{DepthArray, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell as Tile, Pyramid, cells_needed};

mod stand_in;

/// A frame's memory; there are two.
type Buffer = &'static mut DepthArray<160, 120>;

/// A frame that has arrived.
struct Arrived {
    depth: Buffer,
    view: isobath_firmware_job::View,
}

/// What the IMU felt: specific force, m/s², camera axes. At rest it points up.
struct Felt {
    force: Vec3,
    time: Timestamp,
}

/// What goes out.
struct Answer {
    /// What is at the middle of the view, world, metres.
    seen: Option<Vec3>,
    /// Where a box of 30 cm can stand, world, metres.
    room: Option<Vec3>,
}

/// The sensor's ends of its queues.
struct Sensor {
    free: Consumer<'static, Buffer>,
    arrived: Producer<'static, Arrived>,
    felt: Producer<'static, Felt>,
}

// Each handler finds its ends here once, and keeps them.
static SENSOR: Mutex<Cell<Option<Sensor>>> = Mutex::new(Cell::new(None));
static LINK: Mutex<Cell<Option<Consumer<'static, Answer>>>> = Mutex::new(Cell::new(None));

#[entry]
fn main() -> ! {
    // `start` gives up only where it was called twice, or the core refused a constant.
    let _ = start();
    stand_in::end(false)
}

fn start() -> Option<()> {
    // All memory there is, lent once. A queue holds one less than it says.
    let first = singleton!(: DepthArray<160, 120> = DepthArray::filled(0))?;
    let second = singleton!(: DepthArray<160, 120> = DepthArray::filled(0))?;
    let tiles = singleton!(: [Tile<u16>; cells_needed(160, 120)] = [const { Tile { min: 0, max: 0, holes: 0 } }; _])?;
    let (mut free, free_out) = singleton!(: Queue<Buffer, 3> = Queue::new())?.split();
    let (arrived_in, mut arrived) = singleton!(: Queue<Arrived, 3> = Queue::new())?.split();
    let (felt_in, mut felt) = singleton!(: Queue<Felt, 16> = Queue::new())?.split();
    let (mut answers, answers_out) = singleton!(: Queue<Answer, 8> = Queue::new())?.split();

    // Both buffers are free; then the handlers get their ends, and the sensor starts.
    free.enqueue(first).ok()?;
    free.enqueue(second).ok()?;
    let sensor = Sensor { free: free_out, arrived: arrived_in, felt: felt_in };
    critical_section::with(|cs| {
        SENSOR.borrow(cs).set(Some(sensor));
        LINK.borrow(cs).set(Some(answers_out));
    });
    start_sensor(cortex_m::Peripherals::take()?.SYST);

    let mut up = OneEuro::<Vec3>::new(OneEuroParams::default()).ok()?;
    let mut force = Vec3::NEG_Y;
    loop {
        // Every sample counts, so they are drained before the frame that they belong to.
        while let Some(sample) = felt.dequeue() {
            force = up.filter(sample.force, sample.time);
        }
        let Some(Arrived { depth, view }) = arrived.dequeue() else {
            cortex_m::asm::wfi();
            continue;
        };
        if let Some((camera, pose)) = view.read() {
            let frame = DepthFrame::new(depth.view(), DepthUnit::MILLIMETRE, camera).with_pose(pose);
            let pyramid = Pyramid::build(frame.depth(), tiles).ok();
            let seen = hit_test(&frame, Vec2::new(79.5, 59.5), &HitParams::default()).hit().map(|hit| hit.point);
            let wanted =
                PlaceParams { max_hidden: 0.02, ..PlaceParams::new(Vec3::splat(0.3), pose.direction_to_world(force)) };
            let room = place(&frame, pyramid.as_ref(), Spot::Pixel(108, 88), &wanted).outcome.ok();
            // A full queue is an answer too: the link is slower than we are, and this one is lost.
            let _lost = answers.enqueue(Answer { seen, room: room.map(|place| place.pose.centre) }).is_err();
            SCB::set_pendsv();
        }
        // Back to the sensor. There are two places for two buffers: it can't be full.
        free.enqueue(depth).ok()?;
    }
}

/// Two hundred samples a second, and now and then a frame.
fn start_sensor(mut clock: SYST) {
    clock.set_clock_source(SystClkSource::Core);
    clock.set_reload(25_000_000 / 200 - 1);
    clock.clear_current();
    clock.enable_counter();
    clock.enable_interrupt();
}

/// The sensor: on a device, the interrupts of the IMU and of the DMA that has filled a buffer.
#[exception]
fn SysTick() {
    static mut MINE: Option<Sensor> = None;
    static mut TICKS: u32 = 0;
    if MINE.is_none() {
        *MINE = critical_section::with(|cs| SENSOR.borrow(cs).take());
    }
    let Some(sensor) = MINE else { return };
    *TICKS += 1;
    // Queues that are full: the main loop is late, and the newest is lost. It is never the main loop that waits for us.
    if let Some(felt) = stand_in::force(*TICKS) {
        let _ = sensor.felt.enqueue(felt);
    }
    if TICKS.is_multiple_of(8)
        && let Some(depth) = sensor.free.dequeue()
    {
        match stand_in::fill(*TICKS / 8, depth) {
            Ok(arrived) => drop(sensor.arrived.enqueue(arrived)),
            Err(_) => stand_in::end(false),
        }
    }
}

/// The link to whoever asked: on a device, the interrupt of a radio or of USB.
#[exception]
fn PendSV() {
    static mut MINE: Option<Consumer<'static, Answer>> = None;
    if MINE.is_none() {
        *MINE = critical_section::with(|cs| LINK.borrow(cs).take());
    }
    while let Some(answer) = MINE.as_mut().and_then(Consumer::dequeue) {
        stand_in::send(&answer);
    }
}
