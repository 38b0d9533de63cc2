//! Calibration tables as the camera's flash holds them: a header of 16 bytes with a checksum, then numbers at fixed places.
//!
//! Depth is rectified: a resolution has a pinhole and no lens. Every resolution's numbers are different here, and none is a round
//! one, so that taking another's is seen.

/// Table numbers.
pub const COEFFICIENTS: u32 = 25;
/// The colour camera's.
pub const COLOUR: u32 = 32;

/// Focal lengths and principal point, pixels.
pub type Pinhole = [f32; 4];

/// The pinholes of [`COEFFICIENTS`], by resolution: width, height, the place in the table.
const PLACES: [(u16, u16, usize); 9] = [
    (1920, 1080, 256),
    (1280, 720, 272),
    (640, 480, 288),
    (848, 480, 304),
    (640, 360, 320),
    (424, 240, 336),
    (320, 240, 352),
    (480, 270, 368),
    (1280, 800, 384),
];

/// Distance between the two imagers, millimetres.
pub const BASELINE_MM: f32 = -50.017;

/// The pinhole that the table of coefficients gives for a resolution.
#[must_use]
pub fn pinhole(width: u16, height: u16) -> Pinhole {
    let (w, h) = (f32::from(width), f32::from(height));
    [0.6034 * w + 0.125, 0.6029 * w + 0.25, 0.5 * w + 1.75, 0.5 * h - 2.5]
}

/// The table of coefficients.
#[must_use]
pub fn coefficients() -> Vec<u8> {
    let mut table = vec![0; 576];
    put(&mut table, 160, &[BASELINE_MM]);
    table[164] = 1; // the lens model's name; of no effect on rectified images
    for (width, height, place) in PLACES {
        put(&mut table, place, &pinhole(width, height));
    }
    seal(table, COEFFICIENTS)
}

/// The colour camera's pinhole at 640x480: what [`colour`] says, computed the other way round.
pub const COLOUR_640: Pinhole = [612.5, 611.75, 322.25, 241.5];

/// Where the colour camera is, seen from depth: metres.
pub const COLOUR_AT_M: [f32; 3] = [0.01475, 0.0001, 0.0002];

/// The colour camera's table, calibrated at 640x480.
#[must_use]
pub fn colour() -> Vec<u8> {
    let mut table = vec![0; 256];
    let [fx, fy, cx, cy] = COLOUR_640;
    // Lengths and the principal point in halves of the image, rows of a 3x3 matrix.
    put(&mut table, 16, &[fx / 320.0, 0.0, cx / 320.0 - 1.0, 0.0, fy / 240.0, cy / 240.0 - 1.0, 0.0, 0.0, 1.0]);
    for (field, value) in [(144, 640u16), (146, 480)] {
        table[field..field + 2].copy_from_slice(&value.to_le_bytes());
    }
    put(&mut table, 148, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    put(&mut table, 184, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    // Millimetres, the other way.
    put(&mut table, 220, &COLOUR_AT_M.map(|m| m * -1000.0));
    seal(table, COLOUR)
}

fn put(table: &mut [u8], at: usize, values: &[f32]) {
    for (place, value) in table[at..].chunks_exact_mut(4).zip(values) {
        place.copy_from_slice(&value.to_le_bytes());
    }
}

/// Fills in the header: version, number, length, checksum of what follows.
fn seal(mut table: Vec<u8>, number: u32) -> Vec<u8> {
    table[0..2].copy_from_slice(&[3, 0]); // big-endian in the real one, too
    table[2..4].copy_from_slice(&(number as u16).to_le_bytes());
    let length = table.len() as u32 - 16;
    table[4..8].copy_from_slice(&length.to_le_bytes());
    let sum = crc32(&table[16..]);
    table[12..16].copy_from_slice(&sum.to_le_bytes());
    table
}

/// The CRC-32 of IEEE 802.3, bit by bit.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |s, _| if s & 1 == 1 { s >> 1 ^ 0xedb8_8320 } else { s >> 1 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_the_standard_one_and_tables_carry_theirs() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        for (table, number) in [(coefficients(), COEFFICIENTS), (colour(), COLOUR)] {
            assert_eq!(u32::from(u16::from_le_bytes([table[2], table[3]])), number);
            let sum = u32::from_le_bytes(table[12..16].try_into().unwrap());
            assert_eq!(sum, crc32(&table[16..]));
        }
    }
}
