//! The hardware monitor: commands to the camera's firmware, through one setting of 1024 bytes of its extension unit.
//!
//! A command is written (length, magic number, operation, four parameters, data), its answer read from the same setting: the
//! operation's number again, or an error's, then data, and at offset 1020 how much of it.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::tables::{self, Pinhole};
use crate::uvc::Unit;

/// The setting, and its size.
const SELECTOR: u8 = 1;
const SIZE: u16 = 1024;

/// Operations.
mod operation {
    pub(super) const READ_REGISTER: u32 = 0x01;
    pub(super) const VERSION_DATA: u32 = 0x10;
    pub(super) const TABLE: u32 = 0x15;
    pub(super) const ADVANCED: u32 = 0x2c;
    pub(super) const RESOLUTIONS: u32 = 0x7e;
}

/// Answers instead of the operation's number: the real ones are negative numbers, too.
const NO_SUCH_OPERATION: i32 = -1;
const NO_SUCH_TABLE: i32 = -21;

/// What the firmware holds; a test may change it at any time.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Version, major first.
    pub firmware: [u8; 4],
    /// The serial number of the optical module.
    pub serial: [u8; 6],
    /// Micrometres of a depth step; `None`: advanced mode is off, and the question is refused.
    pub unit_um: Option<u32>,
    /// Tables by number.
    pub tables: BTreeMap<u32, Vec<u8>>,
    /// What newer firmware knows: width, height, pinhole. Empty: it does not know the question.
    pub resolutions: Vec<(u16, u16, Pinhole)>,
    /// How long an answer says it is, if that is not so.
    pub claimed_length: Option<u32>,
    /// Operations asked for, in order.
    pub asked: Vec<u32>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            firmware: [5, 12, 7, 100],
            serial: [0x81, 0x73, 0x12, 0x07, 0x01, 0x55],
            unit_um: Some(1000),
            tables: [(tables::COEFFICIENTS, tables::coefficients()), (tables::COLOUR, tables::colour())].into(),
            resolutions: Vec::new(),
            claimed_length: None,
            asked: Vec::new(),
        }
    }
}

impl Settings {
    fn answer(&mut self, command: &[u8]) -> Vec<u8> {
        let word = |at: usize| command.get(at..at + 4).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes);
        let (operation, parameter) = (word(4), word(8));
        self.asked.push(operation);
        let is_command = word(0) >> 16 == 0xcdab && word(0) & 0xffff >= 20;
        let data = if is_command { self.data(operation, parameter, word(12)) } else { Err(NO_SUCH_OPERATION) };
        let mut out = match &data {
            Ok(data) => [&operation.to_le_bytes()[..], data].concat(),
            Err(error) => error.to_le_bytes().to_vec(),
        };
        out.resize(usize::from(SIZE), 0);
        let length = self.claimed_length.unwrap_or_else(|| data.map_or(0, |d| d.len() as u32));
        out[1020..].copy_from_slice(&length.to_le_bytes());
        out
    }

    fn data(&self, operation: u32, first: u32, second: u32) -> Result<Vec<u8>, i32> {
        match operation {
            operation::VERSION_DATA => Ok(self.version_data()),
            operation::TABLE => self.tables.get(&first).cloned().ok_or(NO_SUCH_TABLE),
            operation::RESOLUTIONS if !self.resolutions.is_empty() => {
                let entry = |(w, h, k): &(u16, u16, Pinhole)| {
                    let size = [w.to_le_bytes(), h.to_le_bytes()].concat();
                    [size, k.iter().flat_map(|f| f.to_le_bytes()).collect()].concat()
                };
                Ok(self.resolutions.iter().flat_map(entry).collect())
            }
            // The table of depth: unit, clamps, disparity. Only "the value now" is asked for.
            operation::ADVANCED if (first, second) == (9, 0) => {
                let unit = self.unit_um.ok_or(NO_SUCH_OPERATION)?;
                Ok([unit, 0, 65535, 0, 0].into_iter().flat_map(u32::to_le_bytes).collect())
            }
            // The clock; this one stands still.
            operation::READ_REGISTER if first == 0x1613c => Ok(vec![0, 0, 0, 1]),
            _ => Err(NO_SUCH_OPERATION),
        }
    }

    /// Versions, numbers, and which parts there are.
    fn version_data(&self) -> Vec<u8> {
        let mut out = vec![0; 276];
        for (place, byte) in out[12..16].iter_mut().zip(self.firmware.iter().rev()) {
            *place = *byte;
        }
        out[48..54].copy_from_slice(&self.serial);
        for (place, kind) in [(166, 1), (170, 1), (174, 1), (178, 1)] {
            out[place] = kind; // depth sensor, projector, colour sensor, motion sensor
        }
        out
    }
}

/// The extension unit.
#[derive(Debug)]
pub struct Monitor {
    settings: Arc<Mutex<Settings>>,
    answer: Vec<u8>,
}

impl Monitor {
    pub(super) const fn new(settings: Arc<Mutex<Settings>>) -> Self {
        Self { settings, answer: Vec::new() }
    }
}

impl Unit for Monitor {
    fn guid(&self) -> [u8; 16] {
        [0xcb, 0x6c, 0x60, 0xc9, 0x4c, 0x59, 0x25, 0x4d, 0xaf, 0x47, 0xcc, 0xc4, 0x96, 0x43, 0x59, 0x95]
    }

    fn lengths(&self) -> Vec<u16> {
        // Emitter, exposure, power of the laser are there, and hold still.
        vec![SIZE, 1, 4, 2]
    }

    fn set(&mut self, selector: u8, value: &[u8]) -> bool {
        if selector == SELECTOR {
            self.answer = self.settings.lock().unwrap_or_else(PoisonError::into_inner).answer(value);
        }
        true
    }

    fn get(&mut self, selector: u8) -> Vec<u8> {
        if selector == SELECTOR { self.answer.clone() } else { Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(operation: u32, first: u32) -> Vec<u8> {
        let mut out = vec![20, 0, 0xab, 0xcd];
        out.extend([operation, first, 0, 0, 0].into_iter().flat_map(u32::to_le_bytes));
        out.resize(1024, 0);
        out
    }

    #[test]
    fn commands_are_answered_by_the_setting_they_came_by() {
        let mut monitor = Monitor::new(Arc::default());
        monitor.set(1, &command(0x15, 25));
        let answer = monitor.get(1);
        let length = u32::from_le_bytes(answer[1020..].try_into().unwrap()) as usize;
        assert_eq!((answer.len(), length, answer[0]), (1024, 576, 0x15));
        assert_eq!(answer[4..4 + length], tables::coefficients());
        monitor.set(1, &command(0x2c, 9));
        assert_eq!(monitor.get(1)[4..8], 1000u32.to_le_bytes());
        monitor.set(1, &command(0x77, 0));
        assert_eq!(monitor.get(1)[..4], NO_SUCH_OPERATION.to_le_bytes());
        monitor.set(1, &[0; 1024]);
        assert_eq!(monitor.get(1)[..4], NO_SUCH_OPERATION.to_le_bytes(), "no magic number");
    }
}
