//! A context comes to be, and frames come in.
//!
//! `isobath_push_frame` copies: the caller's buffer is free again when it returns. That costs two bytes a pixel and a few
//! microseconds, and nothing in C can then outlive what it borrows. Where even that is too much, `isobath_begin_frame` gives the
//! context's own image for a DMA transfer to write to, and `isobath_end_frame` closes it; between the two there is no frame.
//!
//! Either way the pyramid is built once here (about 11 µs at 160 x 120 on a desktop core), so that rays and placement skip.

use isobath::ground::image::ImageView;
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::skipping::pyramid::Pyramid;

use crate::check::{aligned, answer, done, read, read_or};
use crate::context::{Context, Edit, FRAME, Header, NO_FRAME, write};
use crate::ground::Map;
use crate::memory::{ISOBATH_ALIGNMENT, Layout};
use crate::status::Status;
use crate::types::{Camera, Pose};

/// Makes a context of caller memory, which must stay where it is for as long as the context is used. Nothing has to be given
/// back: free or reuse the memory when done.
///
/// memory: at least isobath_context_size(width, height, columns, rows) bytes, aligned to ISOBATH_ALIGNMENT.
/// camera: of the depth image. width, height: pixels. metres_per_unit: of depth values, 0.001 for millimetres.
/// map: where the ground is mapped for isobath_path; null for none.
/// context: receives the context (the memory's address).
///
/// # Safety
/// As for every function here: what is neither null nor misaligned points to what it says, unused by others during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_init(
    memory: *mut core::ffi::c_void,
    bytes: usize,
    camera: *const Camera,
    width: u32,
    height: u32,
    metres_per_unit: f32,
    map: *const Map,
    context: *mut *mut Context,
) -> Status {
    let make = || {
        if memory.is_null() {
            return Err(Status::ErrorNull);
        }
        if !(memory as usize).is_multiple_of(ISOBATH_ALIGNMENT) {
            return Err(Status::ErrorMisaligned);
        }
        // SAFETY: promised by the caller.
        let (camera, map) = unsafe { (read(camera)?, read_or(map, Map::NONE)?) };
        let layout = Layout::new(width, height, map.columns, map.rows).ok_or(Status::ErrorSize)?;
        if bytes < layout.bytes {
            return Err(Status::ErrorTooLittleMemory);
        }
        Intrinsics::new(camera.fx, camera.fy, camera.cx, camera.cy).map_err(|_| Status::ErrorCamera)?;
        DepthUnit::new(metres_per_unit).map_err(|_| Status::ErrorUnit)?;
        if layout.map_cells > 0 {
            map.core()?;
        }
        let DepthNoise { constant, linear, quadratic } = DepthNoise::KINECT;
        let header = Header {
            seal: 0,
            state: NO_FRAME,
            time: 0,
            sequence: 0,
            width,
            height,
            columns: map.columns,
            rows: map.rows,
            generation: 0,
            unit: metres_per_unit,
            camera,
            pose: Pose::IDENTITY,
            noise: [constant, linear, quadratic],
            map,
            spare: 0,
        };
        // SAFETY: aligned, and at least this many bytes by the caller's word. Zero is what the parts begin with: unknown cells,
        // empty nodes, holes.
        unsafe {
            memory.cast::<u8>().write_bytes(0, layout.bytes);
            write(memory.cast(), header);
        }
        Ok(memory.cast())
    };
    // SAFETY: promised by the caller.
    unsafe { answer(context, make) }
}

/// Takes a frame: copies its depth, builds the pyramid. What was asked about the last frame stays the caller's.
///
/// depth: rows of `width` values, `stride_in_bytes` from row to row (2 * width when tightly packed); 0 and 65535 are holes.
/// pose: where the camera stood, camera-to-world; null when unknown (the world is then the camera's frame).
/// time_ns: of exposure, nanoseconds since any epoch; given back in answers, read by nothing.
///
/// # Safety
/// See isobath_init; `depth` holds (height - 1) * stride_in_bytes + 2 * width bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_push_frame(
    context: *mut Context,
    depth: *const u16,
    stride_in_bytes: usize,
    pose: *const Pose,
    time_ns: i64,
) -> Status {
    let push = || {
        // SAFETY: promised by the caller.
        let mut context = unsafe { Edit::open_for_frame(context)? };
        aligned(depth)?;
        let (width, height) = (context.header.width as usize, context.header.height as usize);
        let span = (height - 1).checked_mul(stride_in_bytes).and_then(|n| n.checked_add(2 * width));
        let fits = span.and_then(|n| (depth as usize).checked_add(n)).is_some_and(|n| isize::try_from(n).is_ok());
        if stride_in_bytes < 2 * width || !stride_in_bytes.is_multiple_of(2) || !fits {
            return Err(Status::ErrorStride);
        }
        if context.overlaps(depth, span.unwrap_or(usize::MAX)) {
            return Err(Status::ErrorOverlap);
        }
        // SAFETY: promised by the caller.
        let pose = unsafe { read_or(pose, Pose::IDENTITY)? };
        pose.core()?;
        // `max`: what is known already, said for the compiler, which would link the panic of a chunk of 0.
        for (y, row) in context.depth.chunks_exact_mut(width.max(1)).enumerate() {
            // SAFETY: within the caller's rows by the span just checked and the caller's word; aligned, since the stride is even;
            // apart from the context, as just checked.
            unsafe { depth.byte_add(y * stride_in_bytes).copy_to_nonoverlapping(row.as_mut_ptr(), width) };
        }
        close(&mut context, pose, time_ns)
    };
    done(push())
}

/// Gives the context's own depth image to write to: `*depth` receives `width * height` values, tightly packed. Until
/// isobath_end_frame there is no frame, and questions about it return ISOBATH_STATUS_ERROR_NO_FRAME; the map and paths can be used.
///
/// # Safety
/// See isobath_init. The image must not be written any more once isobath_end_frame is called.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_begin_frame(context: *mut Context, depth: *mut *mut u16) -> Status {
    let begin = || {
        // SAFETY: promised by the caller.
        let mut opened = unsafe { Edit::open(context)? };
        opened.header.state = NO_FRAME;
        opened.keep();
        let offset = opened.header.layout()?.depth;
        // From the caller's pointer and not from the view's, which ends here. SAFETY: within the block.
        Ok(unsafe { context.cast::<u8>().add(offset).cast() })
    };
    // SAFETY: promised by the caller.
    unsafe { answer(depth, begin) }
}

/// Closes what isobath_begin_frame opened: the image is complete. `pose` and `time_ns` as for isobath_push_frame.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_end_frame(context: *mut Context, pose: *const Pose, time_ns: i64) -> Status {
    let end = || {
        // SAFETY: promised by the caller.
        let (mut context, pose) = unsafe { (Edit::open_for_frame(context)?, read_or(pose, Pose::IDENTITY)?) };
        pose.core()?;
        close(&mut context, pose, time_ns)
    };
    done(end())
}

fn close(context: &mut Edit<'_>, pose: Pose, time_ns: i64) -> Result<(), Status> {
    let header = &mut context.header;
    let view = ImageView::new(context.depth, header.width as usize, header.height as usize);
    let view = view.map_err(|_| Status::ErrorContext)?;
    Pyramid::build(view, context.tiles).map_err(|_| Status::ErrorContext)?;
    (header.state, header.pose, header.time) = (FRAME, pose, time_ns);
    header.sequence = header.sequence.wrapping_add(1);
    context.keep();
    Ok(())
}

/// The sensor's noise, for the error bars: sigma(z) = constant + linear * z + quadratic * z^2, in metres, and the unit's rounding
/// on top. Default: structured light, 0, 0, 1.425e-3. A typical time-of-flight sensor: 0.002, 0.005, 0. None may be negative.
///
/// # Safety
/// See isobath_init.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isobath_set_noise(
    context: *mut Context,
    constant: f32,
    linear: f32,
    quadratic: f32,
) -> Status {
    let set = || {
        // SAFETY: promised by the caller.
        let mut context = unsafe { Edit::open(context)? };
        let noise = [constant, linear, quadratic];
        if !noise.iter().all(|n| *n >= 0.0 && n.is_finite()) {
            return Err(Status::ErrorParameter);
        }
        context.header.noise = noise;
        context.keep();
        Ok(())
    };
    done(set())
}
