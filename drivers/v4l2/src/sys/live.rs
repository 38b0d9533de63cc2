//! Linux itself: the `v4l` crate's device handle, its system calls and its structs of `videodev2.h`.
//!
//! This is the one module with `unsafe` code. What it holds to:
//!
//! * Every ioctl gets a pointer to a live struct of the type that its number was made from (`v4l`'s `vidioc` computes size and direction from that
//!   type), zeroed before it is filled, which is a valid value of each of them. Unions are read as the member that the request's type says.
//! * A plane array handed to the kernel lives until the call returns, and its length is given as it is.
//! * Memory is mapped read-only, in a list of this struct, and unmapped once, at [`V4l2Sys::unmap`] or when this is dropped. A slice of it is given
//!   only while the program owns the buffer (`owned`), and borrows this struct, so that the buffer can't be queued nor unmapped meanwhile.
//! * `v4l`'s handle closes the descriptor when it is dropped, after the mappings.

#![allow(unsafe_code, reason = "system calls: this module is the border")]

use std::ffi::c_void;
use std::os::fd::BorrowedFd;
use std::path::Path;
use std::ptr::NonNull;
use std::sync::Arc;
use std::time::Duration;
use std::{mem, ptr, slice};

use rustix::event::{PollFd, PollFlags, Timespec};
use v4l::device::Handle;
use v4l::v4l_sys as raw;
use v4l::v4l2::{self, vidioc};

use super::{
    Buffer, BufferPlane, Capability, Errno, Format, FourCc, FrameSize, Kind, MAX_PLANES, PlaneFormat, Query, Ready,
    SysResult, V4l2Open, V4l2Sys,
};

const PROT_READ: i32 = 1;
const MAP_SHARED: i32 = 1;
const MEMORY_MMAP: u32 = 1;
/// Images line by line, not in two fields.
const FIELD_NONE: u32 = 1;
/// The capabilities of the node, not of all nodes of the device, are given.
const CAP_DEVICE_CAPS: u32 = 0x8000_0000;

/// `struct uvc_xu_control_query` of `linux/uvcvideo.h`, which `videodev2.h` does not have.
#[repr(C)]
struct ExtensionQuery {
    unit: u8,
    selector: u8,
    query: u8,
    size: u16,
    data: *mut u8,
}

/// `_IOWR('u', 0x21, struct uvc_xu_control_query)`.
const UVCIOC_CTRL_QUERY: vidioc::_IOC_TYPE =
    3 << 30 | (size_of::<ExtensionQuery>() as vidioc::_IOC_TYPE) << 16 | (b'u' as vidioc::_IOC_TYPE) << 8 | 0x21;

/// The memory of a buffer's plane.
#[derive(Debug)]
struct Mapped {
    kind: Kind,
    index: u32,
    plane: usize,
    at: NonNull<u8>,
    length: usize,
    /// Whether the program owns the buffer.
    owned: bool,
}

/// An open node of Linux.
pub struct LiveSys {
    handle: Arc<Handle>,
    maps: Vec<Mapped>,
}

impl std::fmt::Debug for LiveSys {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LiveSys").field("fd", &self.handle.fd()).field("maps", &self.maps.len()).finish_non_exhaustive()
    }
}

// SAFETY: the pointers are to mappings that belong to this struct alone and to the process as a whole; nothing about them or the descriptor is
// tied to a thread.
unsafe impl Send for LiveSys {}

impl Drop for LiveSys {
    fn drop(&mut self) {
        for map in self.maps.drain(..) {
            // SAFETY: mapped by `map` with this length, and still in the list, so not unmapped yet. An error leaks address space.
            let _ = unsafe { v4l2::munmap(map.at.as_ptr().cast(), map.length) };
        }
    }
}

/// Opens nodes of Linux.
#[derive(Debug, Clone, Copy, Default)]
pub struct Linux;

impl V4l2Open for Linux {
    type Sys = LiveSys;

    fn open(&self, path: &Path) -> SysResult<LiveSys> {
        // The crate makes a C string of the path and panics on a zero in it.
        if path.as_os_str().as_encoded_bytes().contains(&0) {
            return Err(Errno::EINVAL);
        }
        let device = v4l::Device::with_path(path)?;
        Ok(LiveSys { handle: device.handle(), maps: Vec::new() })
    }
}

/// A struct of zeros.
///
/// # Safety
/// `T` must be a plain C struct or union of integers, arrays and pointers, for which zeros are a value.
unsafe fn zeroed<T>() -> T {
    // SAFETY: the caller's.
    unsafe { mem::zeroed() }
}

/// Text up to its first zero.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

const fn fourcc(number: u32) -> FourCc {
    FourCc(number.to_le_bytes())
}

impl LiveSys {
    /// One ioctl.
    ///
    /// # Safety
    /// `T` must be the struct that `request` takes, and every pointer in `argument` valid for what the kernel does with it.
    unsafe fn ioctl<T>(&self, request: vidioc::_IOC_TYPE, argument: &mut T) -> SysResult<()> {
        // SAFETY: the descriptor is open as long as the handle, the rest is the caller's.
        unsafe { v4l2::ioctl(self.handle.fd(), request, ptr::from_mut(argument).cast::<c_void>()) }.map_err(Errno::from)
    }

    fn own(&mut self, kind: Kind, index: Option<u32>, owned: bool) {
        for map in self.maps.iter_mut().filter(|m| m.kind == kind && index.is_none_or(|i| m.index == i)) {
            map.owned = owned;
        }
    }

    /// A buffer ioctl: `QUERYBUF`, `QBUF`, `DQBUF`.
    fn buffer(&self, request: vidioc::_IOC_TYPE, kind: Kind, index: u32, planes: usize) -> SysResult<Buffer> {
        // SAFETY: plain C structs.
        let (mut buffer, mut list): (raw::v4l2_buffer, [raw::v4l2_plane; MAX_PLANES]) = unsafe { (zeroed(), zeroed()) };
        (buffer.type_, buffer.memory, buffer.index) = (kind.number(), MEMORY_MMAP, index);
        if kind == Kind::Planes {
            buffer.length = planes.min(MAX_PLANES) as u32;
            buffer.m.planes = list.as_mut_ptr();
        }
        // SAFETY: these requests take a v4l2_buffer; its plane array lives in this function and is as long as it says.
        unsafe { self.ioctl(request, &mut buffer) }?;
        let mut answer = Buffer {
            index: buffer.index,
            flags: buffer.flags,
            sequence: buffer.sequence,
            seconds: buffer.timestamp.tv_sec,
            micros: buffer.timestamp.tv_usec,
            planes: [BufferPlane::default(); MAX_PLANES],
        };
        if kind == Kind::Planes {
            for (to, from) in answer.planes.iter_mut().zip(&list) {
                *to = BufferPlane {
                    length: from.length,
                    // SAFETY: for memory of this kind the union holds the offset; zeroed otherwise.
                    offset: unsafe { from.m.mem_offset },
                    used: from.bytesused,
                    data_offset: from.data_offset,
                };
            }
        } else {
            // SAFETY: as above.
            let offset = unsafe { buffer.m.offset };
            answer.planes[0] = BufferPlane { length: buffer.length, offset, used: buffer.bytesused, data_offset: 0 };
        }
        Ok(answer)
    }

    fn convert(kind: Kind, format: &raw::v4l2_format) -> Format {
        let mut answer = Format::ask(FourCc([0; 4]), 0, 0);
        // SAFETY: the type of the request says which member of the union the kernel filled; all are plain numbers. The structs are packed, so
        // members are copied, not borrowed.
        unsafe {
            match kind {
                Kind::Video => {
                    let pix = format.fmt.pix;
                    (answer.fourcc, answer.width, answer.height) = (fourcc(pix.pixelformat), pix.width, pix.height);
                    answer.planes[0] = PlaneFormat { bytes_per_line: pix.bytesperline, size: pix.sizeimage };
                }
                Kind::Planes => {
                    let pix = format.fmt.pix_mp;
                    (answer.fourcc, answer.width, answer.height) = (fourcc(pix.pixelformat), pix.width, pix.height);
                    answer.count = usize::from(pix.num_planes).min(MAX_PLANES);
                    let list = pix.plane_fmt;
                    for (to, from) in answer.planes.iter_mut().zip(list) {
                        *to = PlaneFormat { bytes_per_line: from.bytesperline, size: from.sizeimage };
                    }
                }
                Kind::Meta => {
                    let meta = format.fmt.meta;
                    answer.fourcc = fourcc(meta.dataformat);
                    answer.planes[0].size = meta.buffersize;
                }
            }
        }
        answer
    }
}

impl V4l2Sys for LiveSys {
    fn capability(&mut self) -> SysResult<Capability> {
        // SAFETY: a plain C struct, and the one that this request takes.
        let cap = unsafe {
            let mut cap: raw::v4l2_capability = zeroed();
            self.ioctl(vidioc::VIDIOC_QUERYCAP, &mut cap)?;
            cap
        };
        let [patch, minor, major, _] = cap.version.to_le_bytes();
        // Nodes of one device share `capabilities`; `device_caps` are this node's, where the driver says so.
        let caps = if cap.capabilities & CAP_DEVICE_CAPS == 0 { cap.capabilities } else { cap.device_caps };
        Ok(Capability {
            driver: text(&cap.driver),
            card: text(&cap.card),
            bus: text(&cap.bus_info),
            kernel: (major, minor, patch),
            caps,
        })
    }

    fn format_at(&mut self, kind: Kind, index: u32) -> SysResult<FourCc> {
        // SAFETY: a plain C struct, and the one that this request takes.
        unsafe {
            let mut description: raw::v4l2_fmtdesc = zeroed();
            (description.index, description.type_) = (index, kind.number());
            self.ioctl(vidioc::VIDIOC_ENUM_FMT, &mut description)?;
            Ok(fourcc(description.pixelformat))
        }
    }

    fn size_at(&mut self, format: FourCc, index: u32) -> SysResult<FrameSize> {
        // SAFETY: a plain C struct, and the one that this request takes; its type says which member of the union holds.
        unsafe {
            let mut size: raw::v4l2_frmsizeenum = zeroed();
            (size.index, size.pixel_format) = (index, u32::from_le_bytes(format.0));
            self.ioctl(vidioc::VIDIOC_ENUM_FRAMESIZES, &mut size)?;
            Ok(match size.type_ {
                1 => {
                    let one = size.__bindgen_anon_1.discrete;
                    FrameSize::Discrete(one.width, one.height)
                }
                _ => {
                    let range = size.__bindgen_anon_1.stepwise;
                    FrameSize::Range {
                        least: (range.min_width, range.min_height),
                        most: (range.max_width, range.max_height),
                    }
                }
            })
        }
    }

    fn format(&mut self, kind: Kind) -> SysResult<Format> {
        // SAFETY: a plain C struct, and the one that this request takes.
        unsafe {
            let mut format: raw::v4l2_format = zeroed();
            format.type_ = kind.number();
            self.ioctl(vidioc::VIDIOC_G_FMT, &mut format)?;
            Ok(Self::convert(kind, &format))
        }
    }

    fn set_format(&mut self, kind: Kind, asked: &Format) -> SysResult<Format> {
        let number = u32::from_le_bytes(asked.fourcc.0);
        // SAFETY: a plain C struct, and the one that this request takes; writing a member of a union of plain numbers is sound.
        unsafe {
            let mut format: raw::v4l2_format = zeroed();
            format.type_ = kind.number();
            match kind {
                Kind::Video => {
                    let pix = &mut format.fmt.pix;
                    (pix.width, pix.height, pix.pixelformat, pix.field) =
                        (asked.width, asked.height, number, FIELD_NONE);
                }
                Kind::Planes => {
                    format.fmt.pix_mp.width = asked.width;
                    format.fmt.pix_mp.height = asked.height;
                    format.fmt.pix_mp.pixelformat = number;
                    format.fmt.pix_mp.field = FIELD_NONE;
                    format.fmt.pix_mp.num_planes = asked.count as u8;
                }
                Kind::Meta => format.fmt.meta.dataformat = number,
            }
            self.ioctl(vidioc::VIDIOC_S_FMT, &mut format)?;
            Ok(Self::convert(kind, &format))
        }
    }

    fn set_interval(&mut self, kind: Kind, (numerator, denominator): (u32, u32)) -> SysResult<(u32, u32)> {
        // SAFETY: a plain C struct, and the one that this request takes; for captures the union holds `capture`.
        unsafe {
            let mut parameters: raw::v4l2_streamparm = zeroed();
            parameters.type_ = kind.number();
            parameters.parm.capture.timeperframe = raw::v4l2_fract { numerator, denominator };
            self.ioctl(vidioc::VIDIOC_S_PARM, &mut parameters)?;
            let granted = parameters.parm.capture.timeperframe;
            Ok((granted.numerator, granted.denominator))
        }
    }

    fn request_buffers(&mut self, kind: Kind, count: u32) -> SysResult<u32> {
        // SAFETY: a plain C struct, and the one that this request takes.
        unsafe {
            let mut request: raw::v4l2_requestbuffers = zeroed();
            (request.count, request.type_, request.memory) = (count, kind.number(), MEMORY_MMAP);
            self.ioctl(vidioc::VIDIOC_REQBUFS, &mut request)?;
            Ok(request.count)
        }
    }

    fn query_buffer(&mut self, kind: Kind, index: u32, planes: usize) -> SysResult<Buffer> {
        self.buffer(vidioc::VIDIOC_QUERYBUF, kind, index, planes)
    }

    fn map(&mut self, kind: Kind, index: u32, plane: usize, offset: u32, length: u32) -> SysResult<()> {
        let size = usize::try_from(length).unwrap_or(0);
        if size == 0 || self.maps.iter().any(|m| (m.kind, m.index, m.plane) == (kind, index, plane)) {
            return Err(Errno::EINVAL);
        }
        // SAFETY: a new mapping at an address of the kernel's choice.
        let at = unsafe { v4l2::mmap(ptr::null_mut(), size, PROT_READ, MAP_SHARED, self.handle.fd(), offset.into()) }?;
        let at = NonNull::new(at.cast()).ok_or(Errno::EINVAL)?;
        self.maps.push(Mapped { kind, index, plane, at, length: size, owned: true });
        Ok(())
    }

    fn unmap(&mut self, kind: Kind, index: u32, plane: usize) -> SysResult<()> {
        let found = self.maps.iter().position(|m| (m.kind, m.index, m.plane) == (kind, index, plane));
        let at = found.ok_or(Errno::EINVAL)?;
        let map = &self.maps[at];
        // SAFETY: mapped by `map` with this length, and taken out of the list once it is unmapped.
        unsafe { v4l2::munmap(map.at.as_ptr().cast(), map.length) }?;
        self.maps.swap_remove(at);
        Ok(())
    }

    fn bytes(&self, kind: Kind, index: u32, plane: usize) -> &[u8] {
        let found = self.maps.iter().find(|m| (m.kind, m.index, m.plane) == (kind, index, plane) && m.owned);
        // SAFETY: mapped readable with this length and not unmapped while `self` is borrowed; the kernel gave the buffer back, and gets it
        // again only through `&mut self`.
        found.map_or(&[], |m| unsafe { slice::from_raw_parts(m.at.as_ptr(), m.length) })
    }

    fn queue(&mut self, kind: Kind, index: u32, planes: usize) -> SysResult<()> {
        let result = self.buffer(vidioc::VIDIOC_QBUF, kind, index, planes).map(drop);
        if result.is_ok() {
            self.own(kind, Some(index), false);
        }
        result
    }

    fn dequeue(&mut self, kind: Kind, planes: usize) -> SysResult<Buffer> {
        let buffer = self.buffer(vidioc::VIDIOC_DQBUF, kind, 0, planes)?;
        self.own(kind, Some(buffer.index), true);
        Ok(buffer)
    }

    fn stream(&mut self, kind: Kind, on: bool) -> SysResult<()> {
        let mut number = kind.number().cast_signed();
        let request = if on { vidioc::VIDIOC_STREAMON } else { vidioc::VIDIOC_STREAMOFF };
        // SAFETY: these requests take an int.
        unsafe { self.ioctl(request, &mut number) }?;
        if !on {
            self.own(kind, None, true);
        }
        Ok(())
    }

    fn poll(&mut self, timeout: Option<Duration>) -> SysResult<Ready> {
        // SAFETY: the descriptor is open as long as the handle, which outlives this borrow.
        let fd = unsafe { BorrowedFd::borrow_raw(self.handle.fd()) };
        let mut fds = [PollFd::new(&fd, PollFlags::IN)];
        let timeout = timeout
            .map(|t| Timespec { tv_sec: t.as_secs().try_into().unwrap_or(i64::MAX), tv_nsec: t.subsec_nanos().into() });
        let ready = rustix::event::poll(&mut fds, timeout.as_ref()).map_err(|e| Errno(e.raw_os_error()))?;
        if ready == 0 {
            return Ok(Ready::default());
        }
        let events = fds[0].revents();
        Ok(Ready {
            readable: events.intersects(PollFlags::IN),
            error: events.intersects(PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL),
        })
    }

    fn extension(&mut self, unit: u8, selector: u8, query: Query, data: &mut [u8]) -> SysResult<()> {
        let size = u16::try_from(data.len()).map_err(|_| Errno::ENOBUFS)?;
        let mut request = ExtensionQuery { unit, selector, query: query as u8, size, data: data.as_mut_ptr() };
        // SAFETY: uvcvideo reads or writes `size` bytes at `data`, whose borrow lasts through the call; other drivers don't know the number.
        unsafe { self.ioctl(UVCIOC_CTRL_QUERY, &mut request) }
    }

    fn pause(&mut self, time: Duration) {
        std::thread::sleep(time);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_request_number_is_the_kernels() {
        // From the kernel's headers: 0xC0107521 where pointers have 64 bits, 0xC00C7521 where they have 32.
        let want = if cfg!(target_pointer_width = "64") { 0xc010_7521_u32 } else { 0xc00c_7521 };
        assert_eq!(UVCIOC_CTRL_QUERY as u32, want);
    }

    #[test]
    fn what_is_no_device_is_refused_without_a_panic() {
        assert_eq!(Linux.open(Path::new("/no/such/device")).unwrap_err(), Errno::ENOENT);
        assert_eq!(Linux.open(Path::new("/dev/vi\0deo0")).unwrap_err(), Errno::EINVAL);
        let mut null = Linux.open(Path::new("/dev/null")).unwrap();
        assert_eq!(null.capability().unwrap_err(), Errno::ENOTTY);
        assert!(null.poll(Some(Duration::ZERO)).is_ok());
        assert!(null.map(Kind::Video, 0, 0, 0, 4096).is_err() && null.bytes(Kind::Video, 0, 0).is_empty());
        assert_eq!(null.unmap(Kind::Video, 0, 0), Err(Errno::EINVAL));
    }
}
