//! The pinholes of a RealSense D400 at any resolution, from what its calibration says.
//!
//! Depth: (1) newer firmware lists every resolution it knows, and an exact match wins; (2) else the calibration table's entry of the
//! resolution, 848x100 being 848x480 with 190 rows cut off above; (3) else the table's 1920x1080 scaled, or for 256x144 cropped. A table whose entry
//! has fx = fy and cx = cy is a maker's placeholder, and means fx = fy = 1.5 widths with the principal point in the middle
//! (`d400-private.cpp` of librealsense). Colour: the normalised matrix, after compensation for another aspect than the calibration's.
//!
//! The answers are in pixels, centres at integers, as librealsense's are. Error: rounding of `f32`.

use glam::{Mat3, Quat, Vec3};

use super::tables::{ColourTable, DepthTable};
use crate::sensing::camera::{Camera, Distortion, Intrinsics, Pose};
use crate::wire::malformed::{Bytes, Malformed};

/// Resolutions of the depth table's entries; those of no pixels are reserved.
pub const RESOLUTIONS: [(u16, u16); 16] = [
    (1920, 1080),
    (1280, 720),
    (640, 480),
    (848, 480),
    (640, 360),
    (424, 240),
    (320, 240),
    (480, 270),
    (1280, 800),
    (960, 540),
    (0, 0),
    (0, 0),
    (640, 400),
    (576, 576),
    (720, 720),
    (1152, 1152),
];

/// Where intrinsics came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Origin {
    /// The firmware's list.
    Firmware,
    /// The calibration table's entry of the resolution.
    Table,
    /// The calibration table's largest entry, scaled or cropped.
    Scaled,
    /// A placeholder in the table: right only about.
    Ideal,
}

/// One entry of the firmware's list: a resolution and its fx, fy, cx, cy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// Width and height.
    pub size: (u16, u16),
    /// fx, fy, cx, cy in pixels.
    pub k: [f32; 4],
}

/// Entries of the firmware's list (the answer to [`Opcode::RectifiedParams`](super::monitor::Opcode::RectifiedParams)); what follows the last whole
/// one is padding.
pub fn records(answer: &[u8]) -> impl Iterator<Item = Record> {
    answer.as_chunks::<20>().0.iter().filter_map(|entry| {
        let read = Bytes::new("rectified parameters", entry);
        Some(Record { size: (read.u16(0).ok()?, read.u16(2).ok()?), k: read.floats(4).ok()? })
    })
}

fn usable([fx, fy, cx, cy]: [f32; 4]) -> Option<Intrinsics> {
    // No lens of these cameras is longer than its image is wide eight times over; zeros mean "not here".
    (fx >= 1.0 && fy >= 1.0).then(|| Intrinsics::new(fx, fy, cx, cy).ok()).flatten()
}

/// Intrinsics of depth at a resolution, and where they came from; `None` when neither source tells.
#[must_use]
pub fn rectified(
    width: u16,
    height: u16,
    firmware: impl IntoIterator<Item = Record>,
    table: Option<&DepthTable>,
) -> Option<(Intrinsics, Origin)> {
    let exact = firmware.into_iter().filter(|r| r.size == (width, height)).find_map(|r| usable(r.k));
    if let Some(k) = exact {
        return Some((k, Origin::Firmware));
    }
    let table = table?;
    let entry = |size: (u16, u16)| {
        let all = RESOLUTIONS.iter().zip(&table.rectified);
        let mut same = all.filter(|(r, k)| **r == size && usable(**k).is_some());
        same.next().map(|(_, k)| *k)
    };
    let (w, h) = (f32::from(width), f32::from(height));
    let ideal = |[fx, fy, cx, cy]: [f32; 4]| (fx == fy && cx == cy).then_some([1.5 * w, 1.5 * w, 0.5 * w, 0.5 * h]);
    let own = match (width, height) {
        (0, _) | (_, 0) => return None,
        (848, 100) => entry((848, 480)).map(|[fx, fy, cx, cy]| ([fx, fy, cx, cy], [fx, fy, cx, cy - 190.0])),
        size => entry(size).map(|k| (k, k)),
    };
    let scaled = || {
        let k = entry((1920, 1080))?;
        let [fx, fy, cx, cy] = k;
        let here = match (width, height) {
            (256, 144) => [fx, fy, cx - 832.0, cy - 468.0],
            _ => [fx * w / 1920.0, fy * h / 1080.0, cx * w / 1920.0, cy * h / 1080.0],
        };
        Some((k, here))
    };
    let ((stored, here), origin) = match own {
        Some(own) => (own, Origin::Table),
        None => (scaled()?, Origin::Scaled),
    };
    match ideal(stored) {
        Some(k) => usable(k).map(|k| (k, Origin::Ideal)),
        None => usable(here).map(|k| (k, origin)),
    }
}

/// The colour camera at a resolution, lens included; `None` for a table that describes none. The D405, whose colour is its left infrared
/// camera, has no such table that counts: use its depth's intrinsics.
///
/// The lens is the maker's inverse model (it straightens), as stored: [`Camera::distortion`] holds its coefficients, which for these cameras are
/// small or zero.
#[must_use]
pub fn colour(table: &ColourTable, width: u16, height: u16) -> Option<Camera> {
    if width == 0 || height == 0 {
        return None;
    }
    let [mut k00, _, mut k02, _, mut k11, mut k12, ..] = table.k;
    let (w, h) = (f32::from(width), f32::from(height));
    let aspect = h / w;
    let calibrated = f32::from(table.size.1) / f32::from(table.size.0.max(1));
    if aspect < calibrated {
        k11 *= calibrated / aspect;
        k12 *= calibrated / aspect;
    } else {
        k00 *= aspect / calibrated;
        k02 *= aspect / calibrated;
    }
    let k = [k00 * w / 2.0, k11 * h / 2.0, (1.0 + k02) * w / 2.0, (1.0 + k12) * h / 2.0];
    let distortion = Distortion::from_slice(&table.distortion)?;
    Some(Camera { intrinsics: usable(k)?, distortion })
}

/// Where the colour camera stands in the depth camera's frame.
///
/// # Errors
/// [`Malformed::Field`] when the table's rotation is none.
pub fn colour_pose(table: &ColourTable) -> Result<Pose, Malformed> {
    let bad = Malformed::Field { what: "the rotation of a colour calibration", at: 184, got: 0 };
    let m = Mat3::from_cols_array(&table.rotation);
    let off = (m * m.transpose() - Mat3::IDENTITY).to_cols_array();
    if !off.iter().all(|v| v.abs() < 1e-2) || !(m.determinant() > 0.5) {
        return Err(bad);
    }
    Pose::new(Quat::from_mat3(&m).normalize(), Vec3::from(table.translation)).map_err(|_| bad)
}

#[cfg(test)]
mod tests {
    use super::super::tables::tests::{colour_table, depth_table};
    use super::*;

    fn k(of: Option<(Intrinsics, Origin)>) -> ([f32; 4], Origin) {
        let (k, origin) = of.unwrap();
        ([k.fx(), k.fy(), k.cx(), k.cy()], origin)
    }

    #[test]
    fn the_three_steps() {
        let table = DepthTable::parse(&depth_table()).unwrap();
        let mut list = std::vec::Vec::new();
        list.extend([0x80, 2, 0xe0, 1]);
        for v in [601.0_f32, 602.0, 319.0, 238.0] {
            list.extend(v.to_le_bytes());
        }
        list.extend([9; 7]);
        assert_eq!(records(&list).count(), 1);
        let got = rectified(640, 480, records(&list), Some(&table));
        assert_eq!(k(got), ([601.0, 602.0, 319.0, 238.0], Origin::Firmware));
        assert_eq!(k(rectified(640, 480, [], Some(&table))), ([620.1, 620.0, 321.5, 239.25], Origin::Table));
        let (crop, origin) = k(rectified(848, 100, [], Some(&table)));
        assert_eq!(origin, Origin::Table);
        assert!((crop[3] - 50.1).abs() < 1e-4);
        // Not in the table: 1920x1080 scaled; 640x360's own entry is zeros.
        let (scaled, origin) = k(rectified(640, 360, [], Some(&table)));
        assert_eq!(origin, Origin::Scaled);
        assert!((scaled[0] - 1396.2 / 3.0).abs() < 1e-3 && (scaled[3] - 540.25 / 3.0).abs() < 1e-3);
        let (crop, origin) = k(rectified(256, 144, [], Some(&table)));
        assert_eq!((crop, origin), ([1396.2, 1396.1, 128.5, 72.25], Origin::Scaled));
        // A record of zeros is none.
        let none = Record { size: (640, 480), k: [0.0; 4] };
        assert_eq!(k(rectified(640, 480, [none], Some(&table))).1, Origin::Table);
    }

    #[test]
    fn without_a_source_there_is_no_answer() {
        let table = DepthTable::parse(&depth_table()).unwrap();
        assert!(rectified(640, 480, [], None).is_none());
        assert!(rectified(0, 480, [], Some(&table)).is_none() && rectified(640, 0, [], Some(&table)).is_none());
        let empty = DepthTable { rectified: [[0.0; 4]; 16], ..table };
        assert!(rectified(640, 480, [], Some(&empty)).is_none());
        let nan = DepthTable { rectified: [[f32::NAN; 4]; 16], ..table };
        assert!(rectified(640, 480, [], Some(&nan)).is_none());
        let ideal = DepthTable { rectified: [[1.0, 1.0, 0.5, 0.5]; 16], ..table };
        let got = k(rectified(640, 480, [], Some(&ideal)));
        assert_eq!(got, ([960.0, 960.0, 320.0, 240.0], Origin::Ideal));
    }

    #[test]
    fn colour_at_other_aspects() {
        let table = ColourTable::parse(&colour_table()).unwrap();
        let own = colour(&table, 1920, 1080).unwrap().intrinsics;
        assert!((own.fx() - 0.96 * 960.0).abs() < 1e-3 && (own.cx() - 969.6).abs() < 1e-3);
        assert!((own.fy() - 1.71 * 540.0).abs() < 1e-3 && (own.cy() - 0.98 * 540.0).abs() < 1e-3);
        // 4:3 is cut out of the middle of 16:9: the same focal length in pixels, at the same height of image.
        let cut = colour(&table, 640, 480).unwrap().intrinsics;
        assert!((cut.fy() / 480.0 - own.fy() / 1080.0).abs() < 1e-6);
        assert!((cut.fx() / 480.0 - own.fx() / 1080.0).abs() < 1e-6);
        assert!(colour(&table, 0, 480).is_none());
        let pose = colour_pose(&table).unwrap();
        assert!((pose.translation().x + 0.0147).abs() < 1e-6);
        assert!(colour_pose(&ColourTable { rotation: [0.0; 9], ..table }).is_err());
        assert!(colour_pose(&ColourTable { rotation: [f32::NAN; 9], ..table }).is_err());
    }
}
