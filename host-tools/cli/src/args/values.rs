//! Numbers, points, sizes and file names from words; the error is what clap shows after the word.

use std::path::PathBuf;

use isobath::glam::{Vec2, Vec3};

pub(super) fn map_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("exr" | "hdr" | "png") => Ok(path),
        _ => Err("the name must end in .exr, .hdr or .png".to_owned()),
    }
}

pub(super) fn mcap_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|e| e == "mcap") { Ok(path) } else { Err("the name must end in .mcap".to_owned()) }
}

/// An MCAP file, or what can be a folder.
pub(super) fn recording(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("bag" | "png" | "npy" | "zip" | "ply" | "mkv" | "db3") => {
            Err("MCAP files (F.mcap) and TUM RGB-D folders (DIR) are written".to_owned())
        }
        _ => Ok(path),
    }
}

pub(super) fn positive(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(v) if v.is_normal() && v > 0.0 => Ok(v),
        _ => Err(format!("`{text}` is not a positive number")),
    }
}

pub(super) fn png_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|e| e == "png") { Ok(path) } else { Err("the name must end in .png".to_owned()) }
}

pub(super) fn numbers<const N: usize>(text: &str) -> Result<[f32; N], String> {
    let mut out = [0.0; N];
    let mut parts = text.split(',');
    for slot in &mut out {
        let part = parts.next().ok_or_else(|| format!("{N} numbers with commas between are needed"))?.trim();
        let value: f32 = part.parse().map_err(|_| format!("`{part}` is not a number"))?;
        if !value.is_finite() {
            return Err(format!("`{part}` is not a finite number"));
        }
        *slot = value;
    }
    match parts.next() {
        None => Ok(out),
        Some(_) => Err(format!("{N} numbers with commas between are needed, no more")),
    }
}

pub(super) fn vec2(text: &str) -> Result<Vec2, String> {
    numbers::<2>(text).map(Vec2::from)
}

pub(super) fn vec3(text: &str) -> Result<Vec3, String> {
    numbers::<3>(text).map(Vec3::from)
}

pub(super) fn size(text: &str) -> Result<(usize, usize), String> {
    let side = |s: &str| s.trim().parse::<usize>().ok().filter(|n| (1..=65_535).contains(n));
    text.split_once(['x', 'X'])
        .and_then(|(w, h)| Some((side(w)?, side(h)?)))
        .ok_or_else(|| "width and height are needed, as in 640x480".to_owned())
}

pub(super) fn points_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("ply" | "npy") => Ok(path),
        _ => Err("the name must end in .ply or .npy".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_and_sizes() {
        assert_eq!(vec3("1, -2,3.5"), Ok(Vec3::new(1.0, -2.0, 3.5)));
        assert!(vec3("1,2").is_err() && vec3("1,2,3,4").is_err() && vec3("1,2,x").is_err() && vec3("1,2,NaN").is_err());
        assert_eq!(size("640x480"), Ok((640, 480)));
        assert!(size("640").is_err() && size("0x3").is_err());
    }
}
