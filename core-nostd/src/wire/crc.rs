//! The CRC that everything on the wire ends with: key frames, the bulk protocol, the tables of RealSense cameras.

/// CRC-32 as in Ethernet, zip and PNG (IEEE 802.3, reflected, 0xEDB88320): a table of 16 words, 64 bytes, two look-ups a byte.
/// It finds every flip of up to three bits in messages of up to 11 KiB, of two in up to 512 MiB, every burst of up to 32 bits,
/// and all but one in 4e9 of anything else. It is no protection from malice: what it lets through is checked again.
///
/// ```
/// assert_eq!(isobath::wire::crc::crc32(b"123456789"), 0xCBF4_3926);
/// ```
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, &byte| nibble(nibble(crc ^ u32::from(byte))))
}

/// The CRC's next four bits.
#[inline]
fn nibble(crc: u32) -> u32 {
    const TABLE: [u32; 16] = {
        let mut table = [0_u32; 16];
        let mut i = 0;
        while i < 16 {
            let mut v = i as u32;
            let mut bit = 0;
            while bit < 4 {
                v = v >> 1 ^ if v & 1 == 1 { 0xEDB8_8320 } else { 0 };
                bit += 1;
            }
            #[allow(clippy::indexing_slicing, reason = "evaluated when compiling, where a panic is an error")]
            {
                table[i] = v;
            }
            i += 1;
        }
        table
    };
    crc >> 4 ^ TABLE.get((crc & 15) as usize).copied().unwrap_or(0)
}
