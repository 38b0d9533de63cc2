//! An image without std and without a global allocator that calls the core on static buffers. That it links is the proof
//! (`cargo xtask proof`): one `extern crate alloc` anywhere in the tree, and it does not. It is linked, not run: the images that run
//! in QEMU are beside it.
//!
//! `black_box` hides the inputs, or the optimiser would compute the answers and link nothing.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use isobath::ground::image::Image;
use isobath::sensing::camera::{Camera, Distortion, Intrinsics, Pose, rectify::rectify};
use isobath::sensing::depth::decode::{self, ByteOrder, Disparity};
use isobath::sensing::depth::{DepthArray, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid, cells_needed};

mod devices;
mod inertial;
mod lighting;
mod localized;

const W: usize = 160;
const H: usize = 120;

/// All the memory there is: inputs, scratch, outputs.
struct Memory {
    raw: [u8; W * H * 2],
    seen: DepthArray<W, H>,
    depth: DepthArray<W, H>,
    confidence: Image<u8, W, H>,
    disparity: Image<f32, W, H>,
    colour: Image<[u8; 3], W, H>,
    cells: [Cell<u16>; cells_needed(W, H)],
    localized: localized::Memory,
    lighting: lighting::Memory,
}

static mut MEMORY: Memory = Memory {
    raw: [0; W * H * 2],
    seen: Image::filled(0),
    depth: Image::filled(0),
    confidence: Image::filled(0),
    disparity: Image::filled(0.0),
    colour: Image::filled([0; 3]),
    // Not `Cell::EMPTY`, whose minimum is not zero: that would put the buffer into the image instead of into zeroed memory.
    cells: [Cell { min: 0, max: 0, holes: 0 }; cells_needed(W, H)],
    localized: localized::Memory::NEW,
    lighting: lighting::Memory::NEW,
};

/// The image's entry; the linker looks for this name.
// SAFETY: nothing else in the image has this name.
#[unsafe(no_mangle)]
pub extern "C" fn _start() -> ! {
    let memory = &raw mut MEMORY;
    // SAFETY: the only reference ever made to MEMORY: there is one entry, one thread, and it never returns.
    let memory = unsafe { &mut *memory };
    black_box(exercise(black_box(memory)));
    // The negative control: an index that nobody has checked.
    #[cfg(feature = "with-panic")]
    black_box([1, 2, 3][black_box(2_usize)]);
    loop {
        core::hint::spin_loop();
    }
}

/// Every floor of the core once. `None` when something refused its input, which is as good: the code is linked.
fn exercise(memory: &mut Memory) -> Option<usize> {
    // Sensing: formats into depth.
    let millimetre = DepthUnit::MILLIMETRE;
    decode::u16_bytes(&memory.raw, 2 * W, ByteOrder::Little, &mut memory.seen.view_mut()).ok()?;
    decode::depth16(memory.seen.view(), &mut memory.depth.view_mut(), Some(&mut memory.confidence.view_mut())).ok()?;
    let stereo = Disparity { focal: black_box(120.0), baseline: 0.05, offset: 0.0, scale: 1.0 };
    decode::disparity(memory.disparity.view(), stereo, millimetre, &mut memory.seen.view_mut()).ok()?;

    let mut answers = devices::exercise(&mut memory.raw, &mut memory.seen, &mut memory.depth, &mut memory.confidence);

    // Sensing: cameras and frames.
    let k = Intrinsics::new(black_box(120.0), 120.0, 79.5, 59.5).ok()?;
    let lens = Distortion::from_slice(&black_box([0.1, -0.05, 0.001, 0.001, 0.0]))?;
    let camera = Camera { intrinsics: k, distortion: lens };
    rectify(memory.seen.view(), &camera, &k, 0, &mut memory.depth.view_mut());
    let eye = black_box(isobath::glam::Vec3::new(0.0, 1.5, 0.0));
    let pose = Pose::looking_at(eye, isobath::glam::Vec3::Z, isobath::glam::Vec3::Y)?;
    let frame = DepthFrame::new(memory.depth.view(), millimetre, k)
        .with_confidence(memory.confidence.view())
        .ok()?
        .with_pose(pose);
    let seen = frame.world_point(80, 60).and_then(|p| frame.pixel_of_world(p))?;
    let ray = camera.ray(isobath::glam::Vec2::new(seen.0 as f32, seen.1 as f32))?;

    // Skipping.
    let pyramid = Pyramid::build(frame.depth(), &mut memory.cells).ok()?;

    // Answers.
    answers += localized::exercise(&frame, &pyramid, black_box(ray), &mut memory.localized);

    // The inertial sensor.
    answers += inertial::exercise(&pose)?;

    // The light, of frames with colour.
    memory.colour.view_mut().fill(black_box([3; 3]));
    let frame = frame.with_colour(memory.colour.view()).ok()?;
    let metres =
        DepthFrame::new(memory.disparity.view(), DepthUnit::METRE, k).with_colour(memory.colour.view()).ok()?;
    answers += lighting::exercise(&frame, &metres.with_pose(pose), &mut memory.lighting);
    Some(answers + usize::from(pyramid.whole().min))
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}

#[cfg(feature = "with-alloc")]
mod control {
    extern crate alloc;

    /// Keeps the allocation from being removed.
    #[unsafe(no_mangle)]
    // SAFETY: nothing else in the image has this name.
    pub extern "C" fn isobath_proof_allocates(n: usize) -> usize {
        core::hint::black_box(alloc::vec![0_u8; n]).len()
    }
}
