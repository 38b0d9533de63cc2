//! What stands in for hardware: frames from flash for the sensor, the debugger's console for the link. A device has none of this.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use isobath::glam::Vec3;
use isobath::ground::units::Timestamp;
use isobath::sensing::depth::DepthArray;
use isobath::wire::rvl;
use isobath_firmware_stream::SCENES;
use semihosting::process::ExitCode;
use semihosting::sys::arm_compat::sys_writec;

use crate::{Answer, Arrived, Felt};

/// What the IMU of a device held still feels, in the axes of the next frame's camera.
pub(crate) fn force(tick: u32) -> Option<Felt> {
    let (_, pose) = scene(tick / 8 + 1).frame.view.read()?;
    Some(Felt {
        force: pose.direction_to_camera(Vec3::Y * 9.81),
        time: Timestamp::from_nanos(i64::from(tick) * 5_000_000),
    })
}

/// What DMA does by itself: a frame into the buffer.
pub(crate) fn fill(number: u32, depth: &'static mut DepthArray<160, 120>) -> Result<Arrived, rvl::RvlError> {
    let frame = &scene(number).frame;
    rvl::decode(frame.depth, &mut depth.view_mut())?;
    Ok(Arrived { depth, view: frame.view })
}

fn scene(number: u32) -> &'static isobath_firmware_stream::Scene {
    let [first, ..] = &SCENES;
    SCENES.get(number as usize % SCENES.len()).unwrap_or(first)
}

/// Prints an answer in millimetres; ends well after six.
pub(crate) fn send(answer: &Answer) {
    static SENT: AtomicU32 = AtomicU32::new(0);
    for (what, at) in [("seen", answer.seen), (" room", answer.room)] {
        print(what);
        match at {
            None => print(" none"),
            Some(at) => at.to_array().into_iter().for_each(millimetres),
        }
    }
    print("\n");
    // One core, and nobody else counts.
    let sent = SENT.load(Ordering::Relaxed) + 1;
    SENT.store(sent, Ordering::Relaxed);
    if sent == 6 {
        end(true);
    }
}

fn print(text: &str) {
    text.bytes().for_each(sys_writec);
}

fn millimetres(metres: f32) {
    let rounded = (metres * 1000.0) as i32;
    print(if rounded < 0 { " -" } else { " " });
    let mut left = rounded.unsigned_abs();
    let mut digits = [0_u8; 10];
    let mut count = 0;
    for digit in &mut digits {
        *digit = b'0' + (left % 10) as u8;
        left /= 10;
        count += 1;
        if left == 0 {
            break;
        }
    }
    digits.iter().take(count).rev().for_each(|digit| sys_writec(*digit));
}

/// Ends the emulation.
pub(crate) fn end(well: bool) -> ! {
    if well { ExitCode::SUCCESS } else { ExitCode::FAILURE }.exit_process()
}

/// Never linked where nothing panics; the compiler wants it all the same.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    end(false)
}
