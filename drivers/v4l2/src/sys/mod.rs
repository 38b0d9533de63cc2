//! The kernel's side of a capture device, as a trait: one implementation asks Linux (`sys::live`, feature `live`), one is the scripted kernel
//! of the tests, which knows who owns which buffer and forgives nothing.
//!
//! Each method is one system call and nothing else: no retry, no loop, no judgement. Those are the [queue](crate::queue)'s, where the
//! scripted kernel tests them. Numbers are the kernel's own (`linux/videodev2.h`, `linux/uvcvideo.h`).

use std::fmt;
use std::io;
use std::path::Path;
use std::time::Duration;

#[cfg(feature = "live")]
pub mod live;

/// An error number of Linux.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Errno(pub i32);

impl Errno {
    /// No such thing: a path, an extension unit or its control.
    pub const ENOENT: Self = Self(2);
    /// Interrupted by a signal: try again.
    pub const EINTR: Self = Self(4);
    /// Input/output error.
    pub const EIO: Self = Self(5);
    /// No such device or address.
    pub const ENXIO: Self = Self(6);
    /// Nothing there yet.
    pub const EAGAIN: Self = Self(11);
    /// Somebody else uses it.
    pub const EBUSY: Self = Self(16);
    /// The device is gone.
    pub const ENODEV: Self = Self(19);
    /// That can't be.
    pub const EINVAL: Self = Self(22);
    /// Not this kind of device.
    pub const ENOTTY: Self = Self(25);
    /// Stalled.
    pub const EPIPE: Self = Self(32);
    /// The size of a control is another.
    pub const ENOBUFS: Self = Self(105);
    /// The device is shut down.
    pub const ESHUTDOWN: Self = Self(108);

    /// Whether an open device is gone for good.
    #[must_use]
    pub const fn is_gone(self) -> bool {
        matches!(self, Self::ENODEV | Self::ENXIO | Self::ESHUTDOWN)
    }
}

impl fmt::Display for Errno {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        io::Error::from(*self).fmt(f)
    }
}

impl From<Errno> for io::Error {
    fn from(errno: Errno) -> Self {
        Self::from_raw_os_error(errno.0)
    }
}

impl From<io::Error> for Errno {
    fn from(error: io::Error) -> Self {
        // An error without a number is none of the kernel's; EIO says as much as is known.
        Self(error.raw_os_error().unwrap_or(Self::EIO.0))
    }
}

/// What a system call answers.
pub type SysResult<T> = Result<T, Errno>;

/// A pixel format's four letters, in the order of their bytes.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct FourCc(pub [u8; 4]);

impl fmt::Display for FourCc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for byte in self.0 {
            // The uppermost bit marks big-endian forms.
            write!(f, "{}", (byte & 0x7f).escape_ascii())?;
        }
        if self.0[3] & 0x80 != 0 { f.write_str("-BE") } else { Ok(()) }
    }
}

impl fmt::Debug for FourCc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "'{self}'")
    }
}

/// Which of a device's queues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Images whose planes share one buffer.
    Video,
    /// Images of several planes, each with its memory.
    Planes,
    /// What comes with images.
    Meta,
}

impl Kind {
    /// `enum v4l2_buf_type`.
    #[must_use]
    pub const fn number(self) -> u32 {
        match self {
            Self::Video => 1,
            Self::Planes => 9,
            Self::Meta => 13,
        }
    }
}

/// Capability bit: images in one plane.
pub const CAP_VIDEO: u32 = 0x1;
/// Capability bit: images in several planes.
pub const CAP_PLANES: u32 = 0x1000;
/// Capability bit: metadata.
pub const CAP_META: u32 = 0x0080_0000;
/// Capability bit: buffers can be had.
pub const CAP_STREAMING: u32 = 0x0400_0000;

/// Buffer flag: the content may be broken.
pub const FLAG_ERROR: u32 = 0x40;
/// Buffer flags that say which clock stamped it.
pub const FLAGS_CLOCK: u32 = 0xe000;
/// Their value for the monotonic clock.
pub const CLOCK_MONOTONIC: u32 = 0x2000;

/// Planes a buffer may have.
pub const MAX_PLANES: usize = 8;

/// What a device says of itself.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Capability {
    /// The kernel driver: "uvcvideo", "vivid".
    pub driver: String,
    /// The device's name.
    pub card: String,
    /// Where it is plugged in.
    pub bus: String,
    /// The kernel's version.
    pub kernel: (u8, u8, u8),
    /// What this node can do: `CAP_` bits.
    pub caps: u32,
}

impl Capability {
    /// The queue that this node captures from; `None` for outputs, radios and the like.
    #[must_use]
    pub const fn kind(&self) -> Option<Kind> {
        if self.caps & CAP_STREAMING == 0 {
            None
        } else if self.caps & CAP_VIDEO != 0 {
            Some(Kind::Video)
        } else if self.caps & CAP_PLANES != 0 {
            Some(Kind::Planes)
        } else if self.caps & CAP_META != 0 {
            Some(Kind::Meta)
        } else {
            None
        }
    }
}

/// A plane of a format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PlaneFormat {
    /// Bytes from row to row.
    pub bytes_per_line: u32,
    /// Bytes of the buffer.
    pub size: u32,
}

/// A format, asked for or granted. Metadata has no width and height, and one plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// What the bytes mean.
    pub fourcc: FourCc,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The planes; the first [`Self::count`] hold.
    pub planes: [PlaneFormat; MAX_PLANES],
    /// Planes there are.
    pub count: usize,
}

impl Format {
    /// A format to ask for; the driver fills in strides and sizes.
    #[must_use]
    pub fn ask(fourcc: FourCc, width: u32, height: u32) -> Self {
        Self { fourcc, width, height, planes: [PlaneFormat::default(); MAX_PLANES], count: 1 }
    }
}

/// Sizes that a format comes in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameSize {
    /// This one: width and height.
    Discrete(u32, u32),
    /// Those within.
    Range {
        /// Least width and height.
        least: (u32, u32),
        /// Largest width and height.
        most: (u32, u32),
    },
}

/// A plane of a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BufferPlane {
    /// Bytes of memory.
    pub length: u32,
    /// What to map it by.
    pub offset: u32,
    /// Bytes that were written, those before the data included.
    pub used: u32,
    /// Where the data begins.
    pub data_offset: u32,
}

/// A buffer, as the kernel describes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Buffer {
    /// Its number.
    pub index: u32,
    /// `FLAG_` bits and others.
    pub flags: u32,
    /// The frame's number, as the kernel counts; wraps.
    pub sequence: u32,
    /// Time stamp, seconds.
    pub seconds: i64,
    /// And microseconds.
    pub micros: i64,
    /// The planes; as many as the format has hold.
    pub planes: [BufferPlane; MAX_PLANES],
}

/// What a device has to say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ready {
    /// A buffer is there (or an error that taking it will tell).
    pub readable: bool,
    /// It does not stream, has no buffer to fill, or is gone.
    pub error: bool,
}

/// What a control request of an extension unit asks for (`UVC_*`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Query {
    /// Sets the value.
    SetCurrent = 0x01,
    /// Reads the value.
    GetCurrent = 0x81,
    /// Reads the length.
    GetLength = 0x85,
}

/// An open node, one system call a method.
///
/// Each error is the kernel's number, and leaves everything as it was unless the kernel says otherwise.
#[expect(clippy::missing_errors_doc, reason = "the trait says it once for all of them")]
pub trait V4l2Sys {
    /// `VIDIOC_QUERYCAP`.
    fn capability(&mut self) -> SysResult<Capability>;
    /// `VIDIOC_ENUM_FMT`: format number `index`; `EINVAL` behind the last.
    fn format_at(&mut self, kind: Kind, index: u32) -> SysResult<FourCc>;
    /// `VIDIOC_ENUM_FRAMESIZES`: size number `index` of a format; `EINVAL` behind the last.
    fn size_at(&mut self, fourcc: FourCc, index: u32) -> SysResult<FrameSize>;
    /// `VIDIOC_G_FMT`.
    fn format(&mut self, kind: Kind) -> SysResult<Format>;
    /// `VIDIOC_S_FMT`: what was granted, which may be something else.
    fn set_format(&mut self, kind: Kind, format: &Format) -> SysResult<Format>;
    /// `VIDIOC_S_PARM`: seconds from frame to frame, as a fraction; what was granted.
    fn set_interval(&mut self, kind: Kind, interval: (u32, u32)) -> SysResult<(u32, u32)>;
    /// `VIDIOC_REQBUFS` for mapped memory: how many were granted; 0 gives all back.
    fn request_buffers(&mut self, kind: Kind, count: u32) -> SysResult<u32>;
    /// `VIDIOC_QUERYBUF`.
    fn query_buffer(&mut self, kind: Kind, index: u32, planes: usize) -> SysResult<Buffer>;
    /// `mmap`: makes the memory of a buffer's plane readable through [`Self::bytes`].
    fn map(&mut self, kind: Kind, index: u32, plane: usize, offset: u32, length: u32) -> SysResult<()>;
    /// `munmap`; `EINVAL` for what is not mapped.
    fn unmap(&mut self, kind: Kind, index: u32, plane: usize) -> SysResult<()>;
    /// The mapped memory of a plane; nothing while the kernel owns the buffer.
    fn bytes(&self, kind: Kind, index: u32, plane: usize) -> &[u8];
    /// `VIDIOC_QBUF`: the buffer is the kernel's.
    fn queue(&mut self, kind: Kind, index: u32, planes: usize) -> SysResult<()>;
    /// `VIDIOC_DQBUF`: a buffer is the program's again; `EAGAIN` when none is done.
    fn dequeue(&mut self, kind: Kind, planes: usize) -> SysResult<Buffer>;
    /// `VIDIOC_STREAMON` and `VIDIOC_STREAMOFF`; the latter makes all buffers the program's.
    fn stream(&mut self, kind: Kind, on: bool) -> SysResult<()>;
    /// `poll` for reading; `None` waits for ever. Neither readable nor an error: the time is up.
    fn poll(&mut self, timeout: Option<Duration>) -> SysResult<Ready>;
    /// `UVCIOC_CTRL_QUERY`: a control of an extension unit; `ENOTTY` where the driver is not uvcvideo.
    fn extension(&mut self, unit: u8, selector: u8, query: Query, data: &mut [u8]) -> SysResult<()>;
    /// `clock_nanosleep`: does nothing for a while.
    fn pause(&mut self, time: Duration);
}

/// Opens nodes.
pub trait V4l2Open {
    /// An open node.
    type Sys: V4l2Sys;

    /// `open`, for reading and writing and without blocking.
    ///
    /// # Errors
    /// The kernel's number.
    fn open(&self, path: &Path) -> SysResult<Self::Sys>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fourccs_print_whatever_they_hold() {
        assert_eq!(FourCc(*b"Z16 ").to_string(), "Z16 ");
        assert_eq!(FourCc([b'Y', b'1', b'6', b' ' | 0x80]).to_string(), "Y16 -BE");
        assert_eq!(FourCc([0, 10, b'"', 0xff]).to_string(), "\\x00\\n\\\"\\x7f-BE");
    }

    #[test]
    fn a_node_is_what_its_bits_say() {
        let of = |caps| Capability { caps, ..Capability::default() }.kind();
        assert_eq!(of(CAP_STREAMING | CAP_VIDEO), Some(Kind::Video));
        assert_eq!(of(CAP_STREAMING | CAP_PLANES), Some(Kind::Planes));
        assert_eq!(of(CAP_STREAMING | CAP_META), Some(Kind::Meta));
        assert_eq!((of(CAP_VIDEO), of(CAP_STREAMING | 0x2)), (None, None));
    }
}
