//! The header of a context, its seal, and the views of what lies behind it.
//!
//! The seal is a checksum over the whole header and the block's own address. Each call takes a copy of the header, checks the
//! seal, and works on the copy; a call that changes something writes the copy back, sealed anew. So neither memory that was
//! never initialised, nor a context that `memcpy` moved, nor one that a stray write hit is taken for a context (but for one
//! chance in four thousand million), and sizes that pass the seal are the sizes that the block was made with.
//!
//! Cost: 42 words read and multiplied a call, about 30 ns on a desktop core.

use core::marker::PhantomData;
use core::slice;

use isobath::ground::units::Timestamp;
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::planner::Node;
use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::DepthUnit;
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid};

use crate::check::{Plain, aligned, read};
use crate::ground::Map;
use crate::memory::{ISOBATH_HEADER_BYTES, Layout};
use crate::status::Status;
use crate::types::{Camera, Pose};

/// All that isobath keeps between two calls, in the caller's memory. Opaque: C sees the name only.
#[derive(Debug)]
pub struct Context {
    _header: Header,
}

/// What the depth image holds.
pub(crate) const NO_FRAME: u32 = 0;
/// A frame, its pyramid built.
pub(crate) const FRAME: u32 = 1;

/// Numbers alone, without padding. The order keeps 8-byte fields aligned on every target.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Header {
    pub(crate) seal: u32,
    pub(crate) state: u32,
    pub(crate) time: i64,
    pub(crate) sequence: u64,
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// The map that the block was made for: its cells are all there are.
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    pub(crate) generation: u32,
    pub(crate) unit: f32,
    pub(crate) camera: Camera,
    pub(crate) pose: Pose,
    /// Constant, linear, quadratic.
    pub(crate) noise: [f32; 3],
    pub(crate) map: Map,
    pub(crate) spare: u32,
}

// SAFETY: `repr(C)` and numbers alone; the size assertion in `memory` is the sum of the fields, so there is no padding.
unsafe impl Plain for Header {}

impl Header {
    /// FNV-1a over words with a turn between them, begun with the address.
    fn seal_at(&self, address: usize) -> u32 {
        const WORDS: usize = ISOBATH_HEADER_BYTES / 4;
        // SAFETY: a Plain struct has no padding, and is this many words (asserted in `memory`).
        let words: [u32; WORDS] = unsafe { core::mem::transmute::<Self, [u32; WORDS]>(*self) };
        let start = 0x6973_6f62_u32 ^ address as u32 ^ ((address as u64) >> 32) as u32;
        // The first word is the seal itself.
        let sum = words.iter().skip(1).fold(start, |sum, word| (sum.rotate_left(5) ^ word).wrapping_mul(0x0100_0193));
        // Multiplication carries upwards only: hence the turns, or two flipped top bits would cancel.
        sum ^ (sum >> 15)
    }

    /// Pixels that may be looked at: none between isobath_begin_frame and isobath_end_frame, when something else writes them.
    const fn pixels_to_read(&self, layout: &Layout) -> usize {
        if self.state == FRAME { layout.pixels } else { 0 }
    }

    pub(crate) fn layout(&self) -> Result<Layout, Status> {
        Layout::new(self.width, self.height, self.columns, self.rows).ok_or(Status::ErrorContext)
    }

    /// The frame over the depth image.
    pub(crate) fn frame<'a>(&self, depth: &'a [u16]) -> Result<DepthFrame<'a>, Status> {
        if self.state != FRAME {
            return Err(Status::ErrorNoFrame);
        }
        let k = self.camera;
        let view = isobath::ground::image::ImageView::new(depth, self.width as usize, self.height as usize);
        let (Ok(view), Ok(k), Ok(unit), Ok(pose)) =
            (view, Intrinsics::new(k.fx, k.fy, k.cx, k.cy), DepthUnit::new(self.unit), self.pose.core())
        else {
            return Err(Status::ErrorContext);
        };
        Ok(DepthFrame::new(view, unit, k).with_pose(pose).with_time(Timestamp::from_nanos(self.time), self.sequence))
    }

    pub(crate) fn pyramid<'a>(&self, tiles: &'a [Cell<u16>]) -> Result<Pyramid<'a>, Status> {
        Pyramid::resume((self.width as usize, self.height as usize), tiles).map_err(|_| Status::ErrorContext)
    }

    pub(crate) fn grid(&self) -> Result<(Grid, HeightMapParams), Status> {
        if self.columns == 0 {
            return Err(Status::ErrorNoMap);
        }
        self.map.core().map_err(|_| Status::ErrorContext)
    }

    pub(crate) fn height_map<'a>(&self, heights: &'a mut [HeightCell]) -> Result<HeightMap<'a>, Status> {
        let (grid, params) = self.grid()?;
        HeightMap::resume(grid, heights, params, self.generation).map_err(|_| Status::ErrorContext)
    }

    pub(crate) const fn depth_noise(&self) -> DepthNoise {
        let [constant, linear, quadratic] = self.noise;
        DepthNoise { constant, linear, quadratic }
    }
}

/// A context that may be read: other readers may be at work.
#[derive(Debug)]
pub(crate) struct View<'a> {
    pub(crate) header: Header,
    pub(crate) heights: &'a [HeightCell],
    depth: &'a [u16],
    tiles: &'a [Cell<u16>],
}

impl<'a> View<'a> {
    /// # Safety
    /// `context` is null, misaligned, or points to at least as many readable bytes as a header has; when it is a context,
    /// nothing writes its block for as long as the view lives.
    pub(crate) unsafe fn open(context: *const Context) -> Result<Self, Status> {
        // SAFETY: promised by the caller.
        let (header, layout) = unsafe { checked(context)? };
        let base = context.cast::<u8>();
        // SAFETY: the seal says that `isobath_init` made this block, of the size that the layout was computed from then and now,
        // and wrote all of it; parts begin at multiples of their alignment, from an aligned start. Nothing writes meanwhile.
        unsafe {
            Ok(Self {
                header,
                heights: slice::from_raw_parts(base.add(layout.heights).cast(), layout.map_cells),
                depth: slice::from_raw_parts(base.add(layout.depth).cast(), header.pixels_to_read(&layout)),
                tiles: slice::from_raw_parts(base.add(layout.pyramid).cast(), layout.tiles),
            })
        }
    }

    pub(crate) fn frame(&self) -> Result<DepthFrame<'a>, Status> {
        self.header.frame(self.depth)
    }

    pub(crate) fn pyramid(&self) -> Result<Pyramid<'a>, Status> {
        self.header.pyramid(self.tiles)
    }
}

/// A context that may be changed.
#[derive(Debug)]
pub(crate) struct Edit<'a> {
    pub(crate) header: Header,
    pub(crate) heights: &'a mut [HeightCell],
    pub(crate) nodes: &'a mut [Node],
    pub(crate) depth: &'a mut [u16],
    pub(crate) tiles: &'a mut [Cell<u16>],
    place: *mut Header,
    bytes: usize,
    /// The block, which `place` points into.
    lives: PhantomData<&'a mut Header>,
}

impl Edit<'_> {
    /// # Safety
    /// `context` is null, misaligned, or points to at least as many readable bytes as a header has; when it is a context,
    /// nothing else uses its block for as long as the view lives, but for its image while there is no frame.
    pub(crate) unsafe fn open(context: *mut Context) -> Result<Self, Status> {
        // SAFETY: promised by the caller.
        unsafe { Self::parts(context, Header::pixels_to_read) }
    }

    /// With the image even if there is no frame yet: to make one.
    ///
    /// # Safety
    /// As for [`Self::open`], and nothing else uses the image.
    pub(crate) unsafe fn open_for_frame(context: *mut Context) -> Result<Self, Status> {
        // SAFETY: promised by the caller.
        unsafe { Self::parts(context, |_, layout| layout.pixels) }
    }

    /// # Safety
    /// As for [`Self::open`], and nothing else uses that many pixels.
    unsafe fn parts(context: *mut Context, pixels: fn(&Header, &Layout) -> usize) -> Result<Self, Status> {
        // SAFETY: promised by the caller.
        let (header, layout) = unsafe { checked(context)? };
        let base = context.cast::<u8>();
        // SAFETY: as in `View::open`; the parts do not overlap, and nothing else uses them.
        unsafe {
            Ok(Self {
                header,
                heights: slice::from_raw_parts_mut(base.add(layout.heights).cast(), layout.map_cells),
                nodes: slice::from_raw_parts_mut(base.add(layout.nodes).cast(), layout.map_cells),
                depth: slice::from_raw_parts_mut(base.add(layout.depth).cast(), pixels(&header, &layout)),
                tiles: slice::from_raw_parts_mut(base.add(layout.pyramid).cast(), layout.tiles),
                place: context.cast(),
                bytes: layout.bytes,
                lives: PhantomData,
            })
        }
    }

    /// Whether some of the caller's memory lies in the block, where the views would see it change.
    pub(crate) fn overlaps<T>(&self, pointer: *const T, bytes: usize) -> bool {
        let (start, block) = (pointer as usize, self.place as usize);
        bytes > 0 && start < block + self.bytes && block < start.saturating_add(bytes)
    }

    /// Writes the header back, sealed.
    pub(crate) fn keep(&mut self) {
        // SAFETY: `open` read a header from there, the block is ours alone, and no other part overlaps it.
        unsafe { write(self.place, self.header) }
    }
}

/// Writes a header, sealed for where it lies.
///
/// # Safety
/// `place` is aligned and points to writable memory for a header that nothing else uses.
pub(crate) unsafe fn write(place: *mut Header, header: Header) {
    let seal = header.seal_at(place as usize);
    // SAFETY: promised by the caller.
    unsafe { place.write(Header { seal, ..header }) }
}

/// # Safety
/// `context` is null, misaligned, or points to at least as many readable bytes as a header has.
#[inline(never)]
unsafe fn checked(context: *const Context) -> Result<(Header, Layout), Status> {
    let place = context.cast::<Header>();
    if aligned(place) == Err(Status::ErrorNull) {
        return Err(Status::ErrorNull);
    }
    // Aligned to 8 on every target, though the header itself needs only 4 on some.
    if !(place as usize).is_multiple_of(crate::memory::ISOBATH_ALIGNMENT) {
        return Err(Status::ErrorMisaligned);
    }
    // SAFETY: promised by the caller; a header is Plain, so any bytes make one.
    let header = unsafe { read(place)? };
    if header.seal != header.seal_at(place as usize) {
        return Err(Status::ErrorContext);
    }
    let layout = header.layout()?;
    Ok((header, layout))
}
