//! One image per capability, which does that and nothing else on a frame of unknown depth: what it holds beyond the image `frame`
//! is what the capability costs in flash. Linked, not run. `cargo xtask firmware` makes the table of `docs/footprint.md` of them.
#![no_std]

pub use isobath;

use core::hint::black_box;

use isobath::glam::{Quat, Vec3};
use isobath::sensing::camera::{Intrinsics, Pose};
use isobath::sensing::depth::{DepthArray, DepthUnit};
use isobath::sensing::frame::DepthFrame;

/// Columns and rows.
pub const W: usize = 160;
/// Rows.
pub const H: usize = 120;

/// A frame that the compiler knows nothing of.
pub fn on_a_frame(work: impl FnOnce(&DepthFrame<'_>)) {
    static DEPTH: DepthArray<W, H> = DepthArray::filled(0);
    let pose = Pose::new(black_box(Quat::IDENTITY), black_box(Vec3::ZERO));
    let camera = Intrinsics::new(black_box(120.0), 120.0, 79.5, 59.5);
    if let (Ok(pose), Ok(camera)) = (pose, camera) {
        work(&DepthFrame::new(black_box(&DEPTH).view(), DepthUnit::MILLIMETRE, camera).with_pose(pose));
    }
}

/// The image of a capability: its entry, which runs `$work` on a frame, and the panic handler that is never linked.
#[macro_export]
macro_rules! capability {
    ($work:expr) => {
        /// The linker looks for this name.
        // SAFETY: nothing else in the image has this name.
        #[unsafe(no_mangle)]
        pub extern "C" fn _start() -> ! {
            $crate::on_a_frame($work);
            loop {
                core::hint::spin_loop();
            }
        }

        #[panic_handler]
        fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
            loop {
                core::hint::spin_loop();
            }
        }
    };
}
