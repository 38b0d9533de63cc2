//! Like Orbbec's Gemini 336: a depth camera of the video class whose extension unit takes commands with the header of Kinect v1's.
//!
//! A command is written into the smallest of three settings that holds it (64, 512, 1024 bytes) and its answer read from there: `GM` asks, `RB` answers, length in
//! half-words, operation, number, then a status and data. Source: `spec/drivers.md` of this project's notes, section 1.3, which was read from
//! `OrbbecSDK_v2`. Only the property of the depth unit is known here.

use std::sync::{Arc, Mutex, PoisonError};

use super::generic::Generic;
use crate::usb::descriptor::BY_ASSOCIATION;
use crate::usb::{Identity, Speed};
use crate::uvc::{Transport, Unit};

/// The property of the depth unit, and the operation that reads a property.
const DEPTH_UNIT: u32 = 176;
const GET_PROPERTY: u16 = 1;
/// The status of an unknown question.
const UNKNOWN: u16 = 3;

/// The camera's depth unit in millimetres, which a user may change at any time.
pub type DepthUnit = Arc<Mutex<f32>>;

/// A camera with this serial number, and its depth unit.
#[must_use]
pub fn gemini_336(serial: &str, speed: Speed) -> (Generic, DepthUnit) {
    let unit = Arc::new(Mutex::new(0.5));
    let identity = Identity {
        vendor: 0x2bc5,
        product: 0x0803,
        class: BY_ASSOCIATION,
        maker: "Orbbec".into(),
        name: "Orbbec Gemini 336".into(),
        serial: serial.into(),
        speed,
    };
    let commands = Commands { depth_unit: Arc::clone(&unit), answer: Vec::new() };
    let sizes = [(848, 480), (640, 480)];
    (Generic::of(identity, Transport::BulkWhole, &sizes, vec![Box::new(commands)]), unit)
}

/// The extension unit.
#[derive(Debug)]
struct Commands {
    depth_unit: DepthUnit,
    answer: Vec<u8>,
}

impl Unit for Commands {
    /// RealSense's identifier, in the real one, too.
    fn guid(&self) -> [u8; 16] {
        [0xcb, 0x6c, 0x60, 0xc9, 0x4c, 0x59, 0x25, 0x4d, 0xaf, 0x47, 0xcc, 0xc4, 0x96, 0x43, 0x59, 0x95]
    }

    fn lengths(&self) -> Vec<u16> {
        vec![512, 64, 1024]
    }

    fn set(&mut self, _: u8, value: &[u8]) -> bool {
        let word = |at: usize| u16::from_le_bytes([value[at], value[at + 1]]);
        let length = 8 + 2 * usize::from(word(2));
        if !value.starts_with(b"GM") || length > value.len() {
            return false;
        }
        let property = value[8..length].first_chunk().copied().map(u32::from_le_bytes);
        let data = if (word(4), property) == (GET_PROPERTY, Some(DEPTH_UNIT)) {
            let now = *self.depth_unit.lock().unwrap_or_else(PoisonError::into_inner);
            // Now, most, least, at first, step.
            let numbers = [now, 10.0, 0.1, 1.0, 0.1].into_iter().flat_map(f32::to_le_bytes);
            [0, 0].into_iter().chain(numbers).collect()
        } else {
            UNKNOWN.to_le_bytes().to_vec()
        };
        self.answer = b"RB".to_vec();
        self.answer.extend((data.len() as u16 / 2).to_le_bytes());
        self.answer.extend(&value[4..8]);
        self.answer.extend(data);
        true
    }

    fn get(&mut self, _: u8) -> Vec<u8> {
        self.answer.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_is_answered_and_nothing_else() {
        let mut unit = Commands { depth_unit: Arc::new(Mutex::new(0.25)), answer: Vec::new() };
        let ask = |operation: u8, property: u8| {
            let mut question = vec![b'G', b'M', 2, 0, operation, 0, 9, 0, property, 0, 0, 0];
            question.resize(64, 0);
            question
        };
        assert!(unit.set(2, &ask(1, 176)));
        let answer = unit.get(2);
        assert_eq!(answer[..10], [b'R', b'B', 11, 0, 1, 0, 9, 0, 0, 0]);
        assert_eq!(answer[10..14], 0.25f32.to_le_bytes());
        assert!(unit.set(2, &ask(1, 177)) && unit.get(2)[8] == 3);
        assert!(!unit.set(2, &[0; 64]));
    }
}
