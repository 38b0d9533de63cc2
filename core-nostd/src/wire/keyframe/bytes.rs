//! Numbers in little-endian bytes, with every length checked.

use super::KeyFrameError;
use crate::wire::crc::crc32;

/// Writes one thing after the other.
pub(super) struct Put<'a> {
    out: &'a mut [u8],
    at: usize,
}

impl<'a> Put<'a> {
    pub(super) const fn new(out: &'a mut [u8]) -> Self {
        Self { out, at: 0 }
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) -> Result<(), KeyFrameError> {
        let got = self.out.len();
        let place = self.rest().get_mut(..bytes.len()).ok_or(KeyFrameError::Full { got })?;
        place.copy_from_slice(bytes);
        self.at += bytes.len();
        Ok(())
    }

    pub(super) fn u8(&mut self, v: u8) -> Result<(), KeyFrameError> {
        self.bytes(&[v])
    }
    pub(super) fn u16(&mut self, v: u16) -> Result<(), KeyFrameError> {
        self.bytes(&v.to_le_bytes())
    }
    pub(super) fn u32(&mut self, v: u32) -> Result<(), KeyFrameError> {
        self.bytes(&v.to_le_bytes())
    }
    pub(super) fn floats(&mut self, values: &[f32]) -> Result<(), KeyFrameError> {
        values.iter().try_for_each(|v| self.bytes(&v.to_le_bytes()))
    }

    /// What is not written yet.
    pub(super) fn rest(&mut self) -> &mut [u8] {
        self.out.get_mut(self.at..).unwrap_or_default()
    }

    /// Counts bytes that were written into [`Self::rest`].
    pub(super) const fn skip(&mut self, bytes: usize) {
        self.at += bytes;
    }

    pub(super) const fn at(&self) -> usize {
        self.at
    }

    /// Writes into what was written before.
    pub(super) fn amend(&mut self, at: usize, bytes: &[u8]) {
        if let Some(place) = self.out.get_mut(at..).and_then(|rest| rest.get_mut(..bytes.len())) {
            place.copy_from_slice(bytes);
        }
    }

    /// Writes the length where it belongs and the CRC behind everything; how many bytes it is.
    pub(super) fn seal(mut self) -> Result<usize, KeyFrameError> {
        let length = u32::try_from(self.at + CRC).map_err(|_| KeyFrameError::Full { got: self.out.len() })?;
        self.amend(LENGTH_AT, &length.to_le_bytes());
        let crc = crc32(self.out.get(..self.at).unwrap_or_default());
        self.u32(crc)?;
        Ok(self.at)
    }
}

/// Where the length stands.
pub(super) const LENGTH_AT: usize = 4;
/// Bytes of the CRC.
pub(super) const CRC: usize = 4;

/// Reads one thing after the other.
#[derive(Clone, Copy)]
pub(super) struct Take<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Take<'a> {
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], KeyFrameError> {
        let place = self.rest().first_chunk::<N>();
        let array = *place.ok_or(KeyFrameError::CutOff { needed: self.at + N, got: self.bytes.len() })?;
        self.at += N;
        Ok(array)
    }

    pub(super) fn u8(&mut self) -> Result<u8, KeyFrameError> {
        self.array().map(u8::from_le_bytes)
    }
    pub(super) fn u16(&mut self) -> Result<u16, KeyFrameError> {
        self.array().map(u16::from_le_bytes)
    }
    pub(super) fn i16(&mut self) -> Result<i16, KeyFrameError> {
        self.array().map(i16::from_le_bytes)
    }
    pub(super) fn u32(&mut self) -> Result<u32, KeyFrameError> {
        self.array().map(u32::from_le_bytes)
    }
    pub(super) fn u64(&mut self) -> Result<u64, KeyFrameError> {
        self.array().map(u64::from_le_bytes)
    }
    pub(super) fn i64(&mut self) -> Result<i64, KeyFrameError> {
        self.array().map(i64::from_le_bytes)
    }
    pub(super) fn f32(&mut self) -> Result<f32, KeyFrameError> {
        self.array().map(f32::from_le_bytes)
    }
    pub(super) fn floats<const N: usize>(&mut self) -> Result<[f32; N], KeyFrameError> {
        let mut values = [0.0; N];
        for v in &mut values {
            *v = self.f32()?;
        }
        Ok(values)
    }

    /// So many bytes as they are.
    pub(super) fn slice(&mut self, length: usize) -> Result<&'a [u8], KeyFrameError> {
        let slice = self.rest().get(..length);
        let cut_off = KeyFrameError::CutOff { needed: self.at.saturating_add(length), got: self.bytes.len() };
        let slice = slice.ok_or(cut_off)?;
        self.at += length;
        Ok(slice)
    }

    /// What is not read yet.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// Where the next number stands, for errors.
    pub(super) const fn at(&self) -> usize {
        self.at
    }
}
