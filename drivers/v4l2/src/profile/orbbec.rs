//! Orbbec's UVC cameras: the depth unit, over the GM/RB commands in their extension unit.
//!
//! Intrinsics are kept in lists of structures (4026, 4027) whose layout differs between models and firmware; they come from a calibration file here.
//! The unit is a property that the camera's user may change at any time, so it is asked for at each opening
//! (`OrbbecSDK_v2`, `src/device/gemini330/G330Device.cpp`, `src/core/platform/.../Protocol.hpp`). Requests go to the extension unit of the model:
//! number 3 for the Gemini 330 series, 4 for the others, in the smallest of its three controls that holds them.

use isobath::sensing::depth::DepthUnit;
use isobath::wire::device::gmrb::orbbec::{DEPTH_UNIT, GET_PROPERTY, Property, control as size_of_control};
use isobath::wire::device::gmrb::{self, Packet, encode_question};

use super::{Facts, control};
use crate::sys::{Query, V4l2Sys};

/// A model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// Its name.
    pub name: &'static str,
    unit: u8,
}

const MODELS: [(u16, &str, u8); 9] = [
    (0x0660, "Orbbec Astra 2", 4),
    (0x0670, "Orbbec Gemini 2", 4),
    (0x0673, "Orbbec Gemini 2 L", 4),
    (0x0808, "Orbbec Gemini 215", 4),
    (0x0809, "Orbbec Gemini 210", 4),
    (0x0803, "Orbbec Gemini 336", 3),
    (0x0807, "Orbbec Gemini 336L", 3),
    (0x080e, "Orbbec Gemini 335Le", 3),
    (0x0669, "Orbbec Femto Mega", 4),
];

impl Model {
    /// By USB vendor and product number.
    #[must_use]
    pub fn of((vendor, product): (u16, u16)) -> Option<Self> {
        let (_, name, unit) = MODELS.iter().find(|(p, ..)| vendor == 0x2bc5 && *p == product)?;
        Some(Self { name, unit: *unit })
    }
}

/// Asks for a property.
fn property(sys: &mut impl V4l2Sys, unit: u8, number: u32, id: u16) -> Result<Property, String> {
    let mut buffer = [0; 64];
    let payload = number.to_le_bytes();
    let question = Packet { opcode: GET_PROPERTY, id, payload: &payload };
    encode_question(&question, &mut buffer).map_err(|e| e.to_string())?;
    let (selector, bytes) = size_of_control(gmrb::HEADER + payload.len()).ok_or("it does not fit a control")?;
    let data = buffer.get_mut(..bytes).ok_or("it does not fit a control")?;
    control(sys, unit, selector, Query::SetCurrent, data).map_err(|e| e.to_string())?;
    control(sys, unit, selector, Query::GetCurrent, data).map_err(|e| e.to_string())?;
    let data = gmrb::data(GET_PROPERTY, id, data).map_err(|e| e.to_string())?;
    Property::parse(data).map_err(|e| e.to_string())
}

/// Asks a camera for its unit.
pub fn inspect(sys: &mut impl V4l2Sys, model: Model) -> Facts {
    let mut facts = Facts { kind: model.name.into(), ..Facts::default() };
    let unit = property(sys, model.unit, DEPTH_UNIT, 1).and_then(|p| {
        // Millimetres a step, as a float.
        DepthUnit::new(f32::from_bits(p.now) * 1e-3).map_err(|e| e.to_string())
    });
    match unit {
        Ok(unit) => facts.unit = Some(unit),
        Err(e) => facts.notes.push(format!("the camera does not say its depth unit: {e}")),
    }
    facts
}
