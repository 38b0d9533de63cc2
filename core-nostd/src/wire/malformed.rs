//! Why bytes are not what they should be: one error for all parsers of devices' words, and the checked reads and writes they share.

use core::fmt;

/// Bytes that don't hold what was expected of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Malformed {
    /// They end too early.
    TooShort {
        /// What was read.
        what: &'static str,
        /// Bytes needed.
        needed: usize,
        /// Bytes there are.
        got: usize,
    },
    /// A value that can't be.
    Field {
        /// What was read, and which value of it.
        what: &'static str,
        /// Where it stands.
        at: usize,
        /// Its bits.
        got: u32,
    },
    /// The check sum does not match: damaged, or not what it seems.
    Crc {
        /// What was read.
        what: &'static str,
        /// What it says.
        said: u32,
        /// What it should say.
        computed: u32,
    },
    /// A device answers another question than was asked.
    OtherReply {
        /// The number of the question.
        asked: u32,
        /// The number in the answer.
        got: u32,
    },
    /// A device refuses; its own error number is kept.
    Refused {
        /// Which command.
        what: &'static str,
        /// The device's error number.
        code: i32,
    },
    /// The output slice is too small.
    Full {
        /// What was written.
        what: &'static str,
        /// Bytes needed.
        needed: usize,
        /// Bytes there are.
        got: usize,
    },
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooShort { what, needed, got } => write!(f, "{what}: {needed} bytes needed, {got} given"),
            Self::Field { what, at, got } => {
                write!(f, "{what} at byte {at} is {got} ({got:#x}), which is not possible; is it the right device?")
            }
            Self::Crc { what, said, computed } => {
                write!(f, "{what}: CRC {said:08x} should be {computed:08x}: damaged; read it again")
            }
            Self::OtherReply { asked, got } => {
                write!(
                    f,
                    "the device answers {got:#x}, not {asked:#x} as asked; another program may be talking to it, or the command is unknown to its firmware"
                )
            }
            Self::Refused { what, code } => {
                write!(f, "the device refuses {what}: error {code} ({code:#x}); its firmware may be too old for it")
            }
            Self::Full { what, needed, got } => write!(f, "{what}: {needed} bytes of output needed, {got} given"),
        }
    }
}

impl core::error::Error for Malformed {}

/// Bytes with a name, read at fixed places.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bytes<'a> {
    what: &'static str,
    bytes: &'a [u8],
}

impl<'a> Bytes<'a> {
    pub(crate) const fn new(what: &'static str, bytes: &'a [u8]) -> Self {
        Self { what, bytes }
    }

    pub(crate) fn slice(&self, at: usize, length: usize) -> Result<&'a [u8], Malformed> {
        let end = at.saturating_add(length);
        let short = Malformed::TooShort { what: self.what, needed: end, got: self.bytes.len() };
        self.bytes.get(at..end).ok_or(short)
    }

    pub(crate) fn array<const N: usize>(&self, at: usize) -> Result<[u8; N], Malformed> {
        let short = Malformed::TooShort { what: self.what, needed: at.saturating_add(N), got: self.bytes.len() };
        self.bytes.get(at..).and_then(|rest| rest.first_chunk::<N>()).copied().ok_or(short)
    }

    pub(crate) fn u8(&self, at: usize) -> Result<u8, Malformed> {
        self.array(at).map(u8::from_le_bytes)
    }

    pub(crate) fn u16(&self, at: usize) -> Result<u16, Malformed> {
        self.array(at).map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&self, at: usize) -> Result<u32, Malformed> {
        self.array(at).map(u32::from_le_bytes)
    }

    pub(crate) fn i32(&self, at: usize) -> Result<i32, Malformed> {
        self.array(at).map(i32::from_le_bytes)
    }

    pub(crate) fn u64(&self, at: usize) -> Result<u64, Malformed> {
        self.array(at).map(u64::from_le_bytes)
    }

    pub(crate) fn i64(&self, at: usize) -> Result<i64, Malformed> {
        self.array(at).map(i64::from_le_bytes)
    }

    pub(crate) fn f32(&self, at: usize) -> Result<f32, Malformed> {
        self.array(at).map(f32::from_le_bytes)
    }

    pub(crate) fn floats<const N: usize>(&self, at: usize) -> Result<[f32; N], Malformed> {
        let mut values = [0.0; N];
        for (i, v) in values.iter_mut().enumerate() {
            *v = self.f32(at.saturating_add(4 * i))?;
        }
        Ok(values)
    }
}

/// Bytes written one after the other.
#[derive(Debug)]
pub(crate) struct Writer<'a> {
    what: &'static str,
    out: &'a mut [u8],
    at: usize,
}

impl<'a> Writer<'a> {
    pub(crate) const fn new(what: &'static str, out: &'a mut [u8]) -> Self {
        Self { what, out, at: 0 }
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) -> Result<(), Malformed> {
        let needed = self.at.saturating_add(bytes.len());
        let full = Malformed::Full { what: self.what, needed, got: self.out.len() };
        // As long as the bytes, which the compiler sees: no copy can fail.
        self.rest().get_mut(..bytes.len()).ok_or(full)?.copy_from_slice(bytes);
        self.at = needed;
        Ok(())
    }

    pub(crate) fn u16(&mut self, v: u16) -> Result<(), Malformed> {
        self.bytes(&v.to_le_bytes())
    }

    pub(crate) fn u32(&mut self, v: u32) -> Result<(), Malformed> {
        self.bytes(&v.to_le_bytes())
    }

    pub(crate) fn f32(&mut self, v: f32) -> Result<(), Malformed> {
        self.bytes(&v.to_le_bytes())
    }

    pub(crate) fn floats(&mut self, values: &[f32]) -> Result<(), Malformed> {
        values.iter().try_for_each(|v| self.f32(*v))
    }

    /// What is written so far.
    pub(crate) fn written(&self) -> &[u8] {
        self.out.get(..self.at).unwrap_or_default()
    }

    /// What is not written yet.
    pub(crate) fn rest(&mut self) -> &mut [u8] {
        self.out.get_mut(self.at..).unwrap_or_default()
    }

    /// Counts bytes that were written into [`Self::rest`].
    pub(crate) const fn skip(&mut self, bytes: usize) {
        self.at = self.at.saturating_add(bytes);
    }

    /// Writes over what is written already.
    pub(crate) fn amend(&mut self, at: usize, bytes: &[u8]) {
        if let Some(place) = self.out.get_mut(at..).and_then(|rest| rest.get_mut(..bytes.len())) {
            place.copy_from_slice(bytes);
        }
    }

    pub(crate) const fn at(&self) -> usize {
        self.at
    }
}
