//! Cameras' pixel formats into 16 bits a pixel, beside a plain copy of the bytes and a reader that takes one bit at a time.

use std::hint::black_box;

use isobath::ground::image::ImageViewMut;
use isobath::sensing::depth::decode::format::Format;
use isobath::sensing::depth::decode::kinect::Constants;

use crate::input::{Depth, Input, Sensor};
use crate::row::{Measure, Method, Row, Score};

/// Whole images; the codes are the scene's millimetres, cut to the format's bits.
pub(crate) const UNPACK: Row = Row {
    name: "unpack",
    title: "Pixel formats of cameras",
    unit: "pixel",
    errors: &[Measure { unit: "%", name: "wrong", what: "pixels that are not what was packed", shown: true }],
    sensors: &[Sensor::Millimetres],
    scenes: &["living-room"],
    methods,
    answers: None,
};

/// Depth in the room; a code where there is none, and 65535, are 0 in every format.
fn codes(input: &Input, bits: usize) -> Vec<u16> {
    let Depth::U16(depth) = &input.depth else { return vec![0; input.pixels()] };
    depth.iter().map(|z| z & (u32::MAX >> (32 - bits)) as u16).map(|z| if z == u16::MAX { 0 } else { z }).collect()
}

/// Rows of codes, one bit at a time; least significant byte first in words of 16, else most significant bit first.
fn pack(format: Format, codes: &[u16], width: usize) -> Vec<u8> {
    if format.bits() == 16 {
        let order = if format == Format::Y16Be { u16::to_be_bytes } else { u16::to_le_bytes };
        return codes.iter().flat_map(|code| order(*code)).collect();
    }
    let mut bytes = Vec::new();
    for row in codes.chunks(width.max(1)) {
        let start = bytes.len();
        bytes.resize(start + format.row_bytes(width), 0);
        for (i, code) in row.iter().enumerate() {
            for bit in (0..format.bits()).filter(|bit| code >> (format.bits() - 1 - bit) & 1 == 1) {
                let at = i * format.bits() + bit;
                bytes[start + at / 8] |= 0x80 >> (at % 8);
            }
        }
    }
    bytes
}

/// The other way round, as slowly.
fn one_bit_at_a_time(bytes: &[u8], bits: usize, width: usize, out: &mut [u16]) {
    let stride = (width * bits).div_ceil(8);
    for (row, out) in bytes.chunks(stride.max(1)).zip(out.chunks_mut(width.max(1))) {
        for (i, code) in out.iter_mut().enumerate() {
            *code = 0;
            for at in i * bits..(i + 1) * bits {
                *code = *code << 1 | u16::from(row[at / 8] >> (7 - at % 8) & 1);
            }
        }
    }
}

fn wrong(got: &[u16], want: &[u16]) -> Score {
    let wrong = got.iter().zip(want).filter(|(a, b)| a != b).count();
    Score::of([100.0 * wrong as f64 / want.len().max(1) as f64])
}

fn methods(input: &Input) -> Vec<Method<'_>> {
    let (width, height) = input.size();
    let method = |name: String, bytes: Vec<u8>, want: Vec<u16>, decode: fn(&[u8], usize, &mut [u16])| {
        let (mut out, again) = (vec![0; width * height], bytes.clone());
        let run = move || {
            decode(black_box(&bytes), width, &mut out);
            black_box(&out);
        };
        let score = move || {
            let mut out = vec![1; width * height];
            decode(&again, width, &mut out);
            wrong(&out, &want)
        };
        Method::new(name, width * height, run, score)
    };
    let mut all = Vec::new();
    let whole = codes(input, 16);
    all.push(method("memcpy".to_owned(), pack(Format::Z16, &whole, width), whole, |bytes, _, out| {
        for (out, pair) in out.iter_mut().zip(bytes.as_chunks::<2>().0) {
            *out = u16::from_le_bytes(*pair);
        }
    }));
    let mut add = |format: Format, bits: usize, decode| {
        let want = codes(input, bits);
        all.push(method(format.to_string(), pack(format, &want, width), want, decode));
    };
    /// A format's own call.
    macro_rules! codes_of {
        ($format:expr) => {
            |bytes, width, out| {
                let height = out.len() / width.max(1);
                if let Ok(mut out) = ImageViewMut::new(out, width, height) {
                    let _ = $format.codes(bytes, $format.row_bytes(width), &mut out);
                }
            }
        };
    }
    add(Format::Z16, 16, codes_of!(Format::Z16));
    add(Format::Y16Be, 16, codes_of!(Format::Y16Be));
    add(Format::Y12, 12, codes_of!(Format::Y12));
    add(Format::Y10b, 10, codes_of!(Format::Y10b));
    add(Format::Kinect11, 11, codes_of!(Format::Kinect11));

    let bits = codes(input, 11);
    let packed = pack(Format::Kinect11, &bits, width);
    if let Ok(table) = Constants::NOMINAL.table() {
        let want: Vec<u16> = bits.iter().map(|code| table.millimetres(*code)).collect();
        let (again, bytes, now) = (packed.clone(), packed.clone(), table.clone());
        let mut out = vec![0; width * height];
        let decode = move |table: &isobath::sensing::depth::decode::kinect::Table, bytes: &[u8], out: &mut [u16]| {
            if let Ok(mut out) = ImageViewMut::new(out, width, height) {
                let _ = table.decode(bytes, Format::Kinect11.row_bytes(width), &mut out);
            }
        };
        let run = move || {
            decode(&now, black_box(&bytes), &mut out);
            black_box(&out);
        };
        let score = move || {
            let mut out = vec![1; width * height];
            decode(&table, &again, &mut out);
            wrong(&out, &want)
        };
        all.push(Method::new("Kinect 11 bit to mm", width * height, run, score));
    }
    all.push(method("one bit at a time, 11".to_owned(), packed, bits, |bytes, width, out| {
        one_bit_at_a_time(bytes, 11, width, out);
    }));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_comes_back_and_is_scored() {
        let input = Input::new("sphere", Sensor::Millimetres, (36, 24), 1).unwrap();
        let mut all = (UNPACK.methods)(&input);
        assert_eq!(all.len(), 8);
        for method in &mut all {
            method.run();
            assert_eq!(method.score().errors, [0.0], "{}", method.name());
        }
        assert_eq!(wrong(&[1, 2], &[1, 3]).errors, [50.0]);
    }
}
