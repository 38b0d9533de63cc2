//! Files that other programs read: NPY, PLY, PNG, and text.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use isobath_recording::parse::{NpySlice, write_npy as npy};

use crate::failure::{Failure, Outcome};
use crate::picture::raster::Raster;

/// Creates the file, lets `fill` write it, and makes sure that everything arrived.
fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>) -> Outcome {
    let go = || {
        let mut file = BufWriter::new(File::create(path)?);
        fill(&mut file)?;
        file.flush()
    };
    go().map_err(|e| Failure::writing(path, e))
}

/// An `f32` array of any shape, little-endian.
pub(crate) fn write_npy(path: &Path, shape: &[usize], data: &[f32]) -> Outcome {
    write(path, |file| npy(file, shape, NpySlice::F32(data)))
}

pub(crate) fn write_png(path: &Path, raster: &Raster) -> Outcome {
    let png = raster.png().map_err(|e| Failure::writing(path, e))?;
    write(path, |file| file.write_all(&png))
}

pub(crate) fn write_text(path: &Path, text: &str) -> Outcome {
    write(path, |file| file.write_all(text.as_bytes()))
}

pub(crate) fn create_folder(path: &Path) -> Outcome {
    fs::create_dir_all(path).map_err(|e| Failure::writing(path, e))
}

/// One vertex of a point cloud.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlyPoint {
    pub(crate) position: [f32; 3],
    pub(crate) colour: Option<[u8; 3]>,
}

/// A binary little-endian PLY point cloud.
pub(crate) fn write_ply(path: &Path, points: &[PlyPoint], coloured: bool) -> Outcome {
    write(path, |file| ply(file, points, coloured))
}

fn ply(file: &mut impl Write, points: &[PlyPoint], coloured: bool) -> std::io::Result<()> {
    write!(file, "ply\nformat binary_little_endian 1.0\ncomment isobath, metres\nelement vertex {}\n", points.len())?;
    for axis in ["x", "y", "z"] {
        writeln!(file, "property float {axis}")?;
    }
    if coloured {
        for channel in ["red", "green", "blue"] {
            writeln!(file, "property uchar {channel}")?;
        }
    }
    writeln!(file, "end_header")?;
    for point in points {
        for v in point.position {
            file.write_all(&v.to_le_bytes())?;
        }
        if coloured {
            file.write_all(&point.colour.unwrap_or([128; 3]))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ply_vertex_has_fifteen_bytes() {
        let points = [PlyPoint { position: [1.0, 2.0, 3.0], colour: Some([9, 8, 7]) }];
        let mut file = Vec::new();
        ply(&mut file, &points, true).unwrap();
        let header = file.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        assert_eq!(file.len() - header, 15);
        assert_eq!(&file[header..header + 4], &1.0_f32.to_le_bytes());
        assert_eq!(&file[header + 12..], &[9, 8, 7]);
        assert!(file.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
    }

    #[test]
    fn a_folder_that_is_not_there_is_told() {
        let failure = write_text(Path::new("/nowhere/at/all.txt"), "x").unwrap_err().to_string();
        assert!(failure.contains("/nowhere/at/all.txt") && failure.contains("what to do"), "{failure}");
    }
}
