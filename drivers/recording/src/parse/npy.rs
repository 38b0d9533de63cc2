//! NPY, NumPy's file of one array: read for depth and disparity, written for the program's results.
//!
//! Versions 1 to 3; `uint16`, `uint32`, `float32` and `float64`, either byte order, two dimensions, rows first (C order). The
//! header is a Python dictionary; it is read by looking for its three keys, in at most [`MAX_HEADER`] bytes.
//! Format: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.

use isobath::sensing::depth::decode::ByteOrder;

use super::{ParseError, RawImage, RawPixels, checked_pixels, quoted};

const MAGIC: &[u8] = b"\x93NUMPY";
/// The longest header that is read; real ones have under 200 bytes.
const MAX_HEADER: usize = 16 << 10;

/// The numbers of an array.
#[derive(Debug, Clone, PartialEq)]
pub enum NpyData {
    /// `uint16`.
    U16(Vec<u16>),
    /// `float32`; `uint32` and `float64` are rounded to it.
    F32(Vec<f32>),
}

/// An array of two dimensions.
#[derive(Debug, Clone, PartialEq)]
pub struct NpyArray {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` numbers, row after row.
    pub data: NpyData,
}

impl From<NpyArray> for RawImage {
    fn from(array: NpyArray) -> Self {
        let pixels = match array.data {
            NpyData::U16(v) => RawPixels::U16(v),
            NpyData::F32(v) => RawPixels::F32(v),
        };
        Self { width: array.width, height: array.height, pixels }
    }
}

/// Reads an array of two dimensions.
///
/// ```
/// use isobath_recording::parse::{parse_npy, write_npy, NpyData, NpySlice};
/// let mut file = Vec::new();
/// write_npy(&mut file, &[1, 2], NpySlice::F32(&[1.5, f32::INFINITY])).unwrap();
/// let array = parse_npy(&file).unwrap();
/// assert_eq!((array.width, array.height), (2, 1));
/// assert_eq!(array.data, NpyData::F32(vec![1.5, f32::INFINITY]));
/// ```
///
/// # Errors
/// [`ParseError`] for other types, shapes and orders, damaged headers, and files cut off.
pub fn parse_npy(bytes: &[u8]) -> Result<NpyArray, ParseError> {
    let cut = || ParseError::new("cut off within its header", "copy the file again");
    if !bytes.starts_with(MAGIC) {
        return Err(ParseError::new(
            "does not begin as an NPY file",
            "numpy.save writes one; .npz is a zip of them: unpack it",
        ));
    }
    let (start, len) = match bytes.get(6..12) {
        Some(&[1, _, a, b, ..]) => (10, usize::from(u16::from_le_bytes([a, b]))),
        Some(&[2 | 3, _, a, b, c, d]) => (12, u32::from_le_bytes([a, b, c, d]) as usize),
        Some(&[v, ..]) => {
            return Err(ParseError::new(
                format!("is NPY version {v}"),
                "versions 1 to 3 are read: save it again with NumPy",
            ));
        }
        _ => return Err(cut()),
    };
    if len > MAX_HEADER {
        return Err(ParseError::new(
            format!("its header says it is {len} bytes long"),
            "it is damaged, or a structured array: save a plain one of depth",
        ));
    }
    let header = bytes.get(start..start + len).ok_or_else(cut)?;
    let header = core::str::from_utf8(header)
        .map_err(|_| ParseError::new("its header is not text", "save it again with numpy.save"))?;
    let body = bytes.get(start + len..).unwrap_or(&[]);

    if value(header, "fortran_order")?.starts_with("True") {
        return Err(ParseError::new(
            "is stored column by column (fortran_order)",
            "save it row by row: numpy.save(path, numpy.ascontiguousarray(a))",
        ));
    }
    let (width, height) = shape(header)?;
    let count = checked_pixels(width, height)?;
    let descr = value(header, "descr")?;
    let kind = descr.get(1..).and_then(|rest| rest.split(['\'', '"']).next()).unwrap_or("");
    let (order, kind) = match kind.split_at_checked(1) {
        Some(("<" | "|", k)) => (ByteOrder::Little, k),
        Some((">", k)) => (ByteOrder::Big, k),
        Some(("=", k)) => (if cfg!(target_endian = "big") { ByteOrder::Big } else { ByteOrder::Little }, k),
        _ => (ByteOrder::Little, kind),
    };
    let data = match kind {
        "u2" => NpyData::U16(read(body, count, order, u16::from_le_bytes, u16::from_be_bytes)?),
        "f4" => NpyData::F32(read(body, count, order, f32::from_le_bytes, f32::from_be_bytes)?),
        "f8" => {
            NpyData::F32(read(body, count, order, |b| f64::from_le_bytes(b) as f32, |b| f64::from_be_bytes(b) as f32)?)
        }
        "u4" => {
            NpyData::F32(read(body, count, order, |b| u32::from_le_bytes(b) as f32, |b| u32::from_be_bytes(b) as f32)?)
        }
        _ => {
            return Err(ParseError::new(
                format!("holds numbers of type {}", quoted(kind)),
                "uint16, uint32, float32 and float64 are read: use a.astype('float32')",
            ));
        }
    };
    Ok(NpyArray { width, height, data })
}

fn read<T, const N: usize>(
    body: &[u8],
    count: usize,
    order: ByteOrder,
    little: impl Fn([u8; N]) -> T,
    big: impl Fn([u8; N]) -> T,
) -> Result<Vec<T>, ParseError> {
    // The count is bounded, so this can't overflow.
    let Some(body) = body.get(..count * N) else {
        return Err(ParseError::new(
            format!("cut off: {count} numbers of {N} bytes are {} bytes, {} are there", count * N, body.len()),
            "copy the file again",
        ));
    };
    let (values, _) = body.as_chunks::<N>();
    Ok(match order {
        ByteOrder::Little => values.iter().map(|&b| little(b)).collect(),
        ByteOrder::Big => values.iter().map(|&b| big(b)).collect(),
    })
}

/// The text after `'key':`.
fn value<'a>(header: &'a str, key: &str) -> Result<&'a str, ParseError> {
    header
        .find(key)
        .and_then(|i| header.get(i + key.len()..))
        .map(|rest| rest.trim_start_matches(['\'', '"', ' ']))
        .and_then(|rest| rest.strip_prefix(':'))
        .map(str::trim_start)
        .ok_or_else(|| ParseError::new(format!("its header does not say {key:?}"), "save it again with numpy.save"))
}

fn shape(header: &str) -> Result<(usize, usize), ParseError> {
    let text = value(header, "shape")?;
    let inner = text.strip_prefix('(').and_then(|rest| rest.split_once(')')).map_or(text, |(inner, _)| inner);
    let sides: Option<Vec<usize>> =
        inner.split(',').map(str::trim).filter(|s| !s.is_empty()).take(8).map(|s| s.parse().ok()).collect();
    match sides.as_deref() {
        Some(&[height, width]) => Ok((width, height)),
        // One channel, however it is written.
        Some(&[height, width, 1] | &[1, height, width]) => Ok((width, height)),
        _ => Err(ParseError::new(
            format!("has the shape ({}), not (rows, columns)", inner.chars().take(40).collect::<String>()),
            "save one image, two dimensions",
        )),
    }
}

/// Numbers to be written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NpySlice<'a> {
    /// `uint8`.
    U8(&'a [u8]),
    /// `uint16`.
    U16(&'a [u16]),
    /// `float32`.
    F32(&'a [f32]),
}

/// Writes an array of any shape, rows first (`[rows, columns]`, `[rows, columns, 3]`), little-endian, version 1: byte for byte
/// what `numpy.save` writes.
///
/// # Errors
/// What the writer says; [`std::io::ErrorKind::InvalidInput`] when shape and data disagree.
pub fn write_npy(out: &mut impl std::io::Write, shape: &[usize], data: NpySlice<'_>) -> std::io::Result<()> {
    let (descr, len) = match data {
        NpySlice::U8(v) => ("|u1", v.len()),
        NpySlice::U16(v) => ("<u2", v.len()),
        NpySlice::F32(v) => ("<f4", v.len()),
    };
    if shape.iter().try_fold(1_usize, |n, &side| n.checked_mul(side)) != Some(len) || shape.len() > 8 {
        let what = format!("an array of shape {shape:?} does not hold {len} numbers");
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, what));
    }
    let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let comma = if sides.len() == 1 { "," } else { "" };
    let mut header =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}{comma}), }}", sides.join(", "));
    // Magic, version and length take 10 bytes; the numbers begin at a multiple of 64.
    let padding = 63 - (10 + header.len()) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    out.write_all(MAGIC)?;
    out.write_all(&[1, 0])?;
    out.write_all(&u16::try_from(header.len()).unwrap_or(u16::MAX).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    // A buffer of a few rows, so that an unbuffered file is written in large pieces.
    let mut buffer = Vec::with_capacity(64 << 10);
    match data {
        NpySlice::U8(v) => out.write_all(v)?,
        NpySlice::U16(v) => {
            for part in v.chunks(32 << 10) {
                buffer.clear();
                buffer.extend(part.iter().flat_map(|x| x.to_le_bytes()));
                out.write_all(&buffer)?;
            }
        }
        NpySlice::F32(v) => {
            for part in v.chunks(16 << 10) {
                buffer.clear();
                buffer.extend(part.iter().flat_map(|x| x.to_le_bytes()));
                out.write_all(&buffer)?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(header: &str, body: &[u8]) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        out.extend([1, 0]);
        out.extend((header.len() as u16).to_le_bytes());
        out.extend(header.as_bytes());
        out.extend(body);
        out
    }

    #[test]
    fn types_and_orders() {
        let header = |d: &str| format!("{{'descr': '{d}', 'fortran_order': False, 'shape': (1, 2), }}\n");
        let one = |d: &str, body: &[u8]| parse_npy(&file(&header(d), body)).unwrap().data;
        assert_eq!(one(">u2", &[1, 2, 3, 4]), NpyData::U16(vec![0x102, 0x304]));
        assert_eq!(one("<u2", &[1, 2, 3, 4]), NpyData::U16(vec![0x201, 0x403]));
        let f = [1.5_f64, -2.0].map(f64::to_be_bytes).concat();
        assert_eq!(one(">f8", &f), NpyData::F32(vec![1.5, -2.0]));
        let u = [70_000_u32, 1].map(u32::to_le_bytes).concat();
        assert_eq!(one("<u4", &u), NpyData::F32(vec![70_000.0, 1.0]));
        for bad in ["<i8", "|b1", "<c8", "", "<", "[('a', '<f4')]"] {
            assert!(parse_npy(&file(&header(bad), &[0; 32])).is_err(), "{bad}");
        }
    }

    #[test]
    fn headers_that_lie_are_refused() {
        let h =
            |order: &str, shape: &str| format!("{{'descr': '<u2', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let e = parse_npy(&file(&h("True", "(1, 2)"), &[0; 4])).unwrap_err();
        assert!(e.hint.contains("ascontiguousarray"), "{e}");
        for shape in ["(2,)", "()", "(1, 2, 3)", "(0, 5)", "(99999999999, 99999999999)", "(-1, 2)", "(1, 2", "x"] {
            assert!(parse_npy(&file(&h("False", shape), &[0; 2])).is_err(), "{shape}");
        }
        assert!(parse_npy(&file(&h("False", "(1, 2)"), &[0; 3])).unwrap_err().what.contains("cut off"));
        assert!(parse_npy(b"PK\x03\x04").unwrap_err().hint.contains("npz"));
        let mut long = MAGIC.to_vec();
        long.extend([2, 0, 0xff, 0xff, 0xff, 0xff]);
        assert!(parse_npy(&long).is_err());
        let good = file(&h("False", "(1, 2)"), &[0; 4]);
        for cut in 0..good.len() {
            assert!(parse_npy(&good[..cut]).is_err());
        }
    }

    #[test]
    fn shape_and_data_must_agree() {
        let mut out = Vec::new();
        write_npy(&mut out, &[2, 1, 3], NpySlice::F32(&[0.0; 6])).unwrap();
        assert_eq!(out.len() % 64, 24, "the numbers begin at a multiple of 64");
        assert!(write_npy(&mut out, &[2, 2], NpySlice::U8(&[0; 3])).is_err());
        assert!(write_npy(&mut out, &[usize::MAX, 2], NpySlice::U8(&[0; 3])).is_err());
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(width in 1_usize..9, height in 1_usize..9, seed in any::<u16>()) {
            let ints: Vec<u16> = (0..width * height).map(|i| (i as u16).wrapping_mul(seed)).collect();
            let floats: Vec<f32> = ints.iter().map(|&v| f32::from(v) * 0.37 - 100.0).collect();
            let mut out = Vec::new();
            write_npy(&mut out, &[height, width], NpySlice::U16(&ints)).unwrap();
            prop_assert_eq!(parse_npy(&out).unwrap(), NpyArray { width, height, data: NpyData::U16(ints) });
            out.clear();
            write_npy(&mut out, &[height, width], NpySlice::F32(&floats)).unwrap();
            prop_assert_eq!(parse_npy(&out).unwrap(), NpyArray { width, height, data: NpyData::F32(floats) });
        }

        #[test]
        fn any_bytes_give_an_answer(tail in proptest::collection::vec(any::<u8>(), 0..200), text in ".{0,80}") {
            let _ = parse_npy(&[MAGIC, &tail].concat());
            let _ = parse_npy(&file(&text, &tail));
            let _ = parse_npy(&file(&format!("'descr': '{text}', 'fortran_order': False, 'shape': ({text})"), &tail));
        }
    }
}
