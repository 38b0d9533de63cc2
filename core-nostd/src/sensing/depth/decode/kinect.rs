//! Kinect v1: the disparity codes of its depth camera into millimetres, by the constants that each device carries.
//!
//! The camera sees a pattern that a projector beside it casts, and says by how much each part of it lies off a picture taken of a plane at a known
//! distance: in eighths of a pixel, from a constant on. Similar triangles give the depth (PrimeSense's method, as libfreenect's
//! `registration.c` has it):
//!
//! ```text
//! m  = ((code - 4 shift) / 4 - 0.375) pixel_size       how far the pattern has moved, in the units of the baseline
//! mm = 10 (m distance / (baseline - m) + distance)     = 10 distance baseline / (baseline - m)
//! ```
//!
//! As m nears the baseline the depth grows without bound, and past it changes its sign; libfreenect converts that to whatever it becomes. Here
//! those codes are holes, as are 2047 (the camera's "nothing") and what does not fit 65 m.
//!
//! Memory: a table of 2048 `u16`, 4 KiB, made once. Cost: one look-up a pixel. Error: the nearest millimetre to the formula in `f64`.

use core::fmt;

use super::{DecodeError, DecodeReport, lines, packed};
use crate::ground::image::ImageViewMut;
use crate::sensing::depth::DepthSample;

/// Codes there are.
pub const CODES: usize = 2048;
/// The code of a pixel without a reading.
pub const NOTHING: u16 = 2047;

/// What a device says of its geometry (`wire::device::kinect` asks it).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants {
    /// Distance from the depth camera to the projector, centimetres.
    pub baseline: f32,
    /// Distance of the reference plane, centimetres ("zero plane distance").
    pub distance: f32,
    /// Size of a pixel on the reference plane, centimetres ("zero plane pixel size").
    pub pixel_size: f32,
    /// Where the reference plane's codes begin, in pixels ("const shift").
    pub shift: f32,
}

/// Depth in millimetres of every code.
#[derive(Clone, PartialEq, Eq)]
pub struct Table([u16; CODES]);

impl fmt::Debug for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Table").finish_non_exhaustive()
    }
}

impl Constants {
    /// The constants that libfreenect's documentation shows of a device: depth that is right to a few percent, for when a device's own
    /// can't be read; who uses them says so.
    pub const NOMINAL: Self = Self { baseline: 7.5, distance: 120.0, pixel_size: 0.1042, shift: 200.0 };

    /// The table.
    ///
    /// # Errors
    /// [`DecodeError::BadConstant`] unless all are finite and all but the shift positive.
    ///
    /// ```
    /// use isobath::sensing::depth::decode::kinect::Constants;
    /// let table = Constants::NOMINAL.table()?;
    /// assert_eq!([600, 800, 1000, 2047].map(|code| table.millimetres(code)), [706, 1194, 3864, 0]);
    /// # Ok::<(), isobath::sensing::depth::decode::DecodeError>(())
    /// ```
    pub fn table(&self) -> Result<Table, DecodeError> {
        let positive = [("baseline", self.baseline), ("distance", self.distance), ("pixel size", self.pixel_size)];
        for (name, value) in positive {
            if !value.is_valid() {
                return Err(DecodeError::BadConstant { name, value });
            }
        }
        if !self.shift.is_finite() {
            return Err(DecodeError::BadConstant { name: "shift", value: self.shift });
        }
        let mut table = [0; CODES];
        for (code, mm) in (0_u16..).zip(&mut table) {
            if code != NOTHING {
                *mm = self.millimetres(code);
            }
        }
        Ok(Table(table))
    }

    fn millimetres(&self, code: u16) -> u16 {
        let [e, d, p, s] = [self.baseline, self.distance, self.pixel_size, self.shift].map(f64::from);
        let m = ((f64::from(code) - 4.0 * s) / 4.0 - 0.375) * p;
        let mm = 10.0 * d * e / (e - m) + 0.5;
        // Negated nowhere: NaN and the far side of the baseline fail both.
        if mm >= 1.0 && mm < f64::from(u16::MAX) { mm as u16 } else { 0 }
    }
}

impl Table {
    /// Depth of a code; 0 when it has none, or is no code.
    #[inline]
    #[must_use]
    pub fn millimetres(&self, code: u16) -> u16 {
        self.0.get(usize::from(code)).copied().unwrap_or(0)
    }

    /// Turns an image of codes into millimetres, in place.
    pub fn apply(&self, image: &mut ImageViewMut<'_, u16>) -> DecodeReport {
        let (width, height) = image.size();
        let mut report = DecodeReport::default();
        for y in 0..height {
            for pixel in image.row_mut(y) {
                let code = *pixel;
                *pixel = self.millimetres(code);
                report.valid += usize::from(*pixel != 0);
                report.holes += usize::from(code >= NOTHING);
            }
        }
        report.out_of_range = width * height - report.valid - report.holes;
        report
    }

    /// [`packed::kinect11`] and [`Self::apply`] in one pass.
    ///
    /// # Errors
    /// [`DecodeError::StrideBelowRow`], [`DecodeError::TooShort`].
    pub fn decode(
        &self,
        bytes: &[u8],
        stride: usize,
        out: &mut ImageViewMut<'_, u16>,
    ) -> Result<DecodeReport, DecodeError> {
        let (width, height) = out.size();
        if !width.is_multiple_of(8) {
            packed::kinect11(bytes, stride, out)?;
            return Ok(self.apply(out));
        }
        let (mut valid, mut holes) = (0_usize, 0_usize);
        for (y, line) in lines(bytes, stride, packed::packed_row(width, 11), height)?.enumerate() {
            let (pixels, _) = out.row_mut(y).as_chunks_mut::<8>();
            for (pixels, group) in pixels.iter_mut().zip(line.as_chunks::<11>().0) {
                let codes = packed::kinect11_group(group);
                *pixels = codes.map(|code| self.millimetres(code));
                valid += pixels.iter().map(|mm| usize::from(*mm != 0)).sum::<usize>();
                holes += codes.iter().map(|code| usize::from(*code >= NOTHING)).sum::<usize>();
            }
        }
        Ok(DecodeReport { valid, holes, out_of_range: width * height - valid - holes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;

    #[test]
    fn depth_grows_with_the_code_until_there_is_none() {
        let table = Constants::NOMINAL.table().unwrap();
        let known = [(600, 706), (800, 1194), (1000, 3864), (1050, 8767)];
        for (code, mm) in known {
            assert_eq!(table.millimetres(code), mm);
        }
        let mut last = 0;
        let mut ended = false;
        for code in 0..2048 {
            let mm = table.millimetres(code);
            ended |= mm == 0;
            assert!(if ended { mm == 0 } else { mm >= last }, "{code}: {mm} after {last}");
            last = mm;
        }
        assert!(ended && table.millimetres(2047) == 0 && table.millimetres(u16::MAX) == 0);
    }

    #[test]
    fn the_guard_is_at_the_baseline() {
        // The pattern moves by the baseline at code 4 (shift + 0.375 + baseline / pixel size).
        let k = Constants::NOMINAL;
        let end = 4.0 * (k.shift + 0.375 + k.baseline / k.pixel_size);
        let table = k.table().unwrap();
        assert!(table.millimetres(end as u16 - 8) > 20_000);
        assert_eq!(table.millimetres(end as u16 + 1), 0);
    }

    #[test]
    fn constants_are_checked() {
        let good = Constants::NOMINAL;
        for bad in [
            Constants { baseline: 0.0, ..good },
            Constants { distance: f32::NAN, ..good },
            Constants { pixel_size: -0.1, ..good },
            Constants { shift: f32::INFINITY, ..good },
        ] {
            assert!(matches!(bad.table(), Err(DecodeError::BadConstant { .. })));
        }
        // Absurd but finite: no depth fits, and nothing panics.
        let absurd = Constants { shift: -1e30, ..good }.table().unwrap();
        assert!((0..2048).all(|code| absurd.millimetres(code) == 0));
    }

    #[test]
    fn one_pass_is_two() {
        let table = Constants::NOMINAL.table().unwrap();
        for (width, height) in [(8, 5), (16, 2), (13, 3), (0, 3)] {
            let stride = (width * 11_usize).div_ceil(8) + 1;
            let mut s = 1_u32;
            let mut next = || {
                s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (s >> 24) as u8
            };
            let bytes: vec::Vec<u8> = (0..stride * height).map(|i| if i % 5 == 0 { 0xff } else { next() }).collect();
            let (mut one, mut two) = (vec![7; width * height], vec![7; width * height]);
            let mut a = ImageViewMut::new(&mut one, width, height).unwrap();
            let mut b = ImageViewMut::new(&mut two, width, height).unwrap();
            let report = table.decode(&bytes, stride, &mut a).unwrap();
            packed::kinect11(&bytes, stride, &mut b).unwrap();
            assert_eq!(table.apply(&mut b), report);
            assert_eq!(report.valid + report.holes + report.out_of_range, width * height);
            assert_eq!(one, two);
        }
    }
}
