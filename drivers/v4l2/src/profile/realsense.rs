//! Intel's RealSense D400 cameras: everything they know of themselves, over the hardware monitor in their UVC extension unit.
//!
//! The questions are those of librealsense (`src/ds/d400`), reimplemented from its layouts in [`isobath::wire::device::d4xx`]; only such that read.
//! A question is written into a control of 1024 bytes and the answer read from it. What a camera refuses to say (old firmware has no list of
//! intrinsics, the unit needs "advanced mode") has its documented fallback, and a note that says so.

use isobath::sensing::camera::Intrinsics;
use isobath::sensing::depth::DepthUnit;
use isobath::wire::device::d4xx::intrinsics::{Origin, colour_pose, records, rectified};
use isobath::wire::device::d4xx::monitor::{
    COLOUR_CALIBRATION, CONTROL, DEPTH_CALIBRATION, DEPTH_TABLE, Opcode, SELECTOR, UNIT, answer, question,
};
use isobath::wire::device::d4xx::tables::{ColourTable, DepthControl, DepthTable, Gvd};
use isobath::wire::malformed::Malformed;

use super::{ColourFacts, Facts, control};
use crate::sys::{Errno, Query, V4l2Sys};

/// A model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// Its name.
    pub name: &'static str,
    /// Its unit when it does not say, micrometres.
    unit_um: u16,
}

const MODELS: [(u16, &str); 11] = [
    // The one whose metadata Linux 6.1 knows.
    (0x0b03, "Intel RealSense D4M"),
    (0x0ad3, "Intel RealSense D415"),
    (0x0ad4, "Intel RealSense D430"),
    (0x0b07, "Intel RealSense D435"),
    (0x0b3a, "Intel RealSense D435i"),
    (0x0b4b, "Intel RealSense D430i"),
    (0x0b5b, "Intel RealSense D405"),
    (0x0b5c, "Intel RealSense D455"),
    (0x1155, "Intel RealSense D421"),
    (0x0ad1, "Intel RealSense D400"),
    (0x0ad2, "Intel RealSense D410"),
];

impl Model {
    /// By USB vendor and product number.
    #[must_use]
    pub fn of((vendor, product): (u16, u16)) -> Option<Self> {
        let (_, name) = MODELS.iter().find(|(p, _)| vendor == 0x8086 && *p == product)?;
        // The D405 is made for near work.
        Some(Self { name, unit_um: if product == 0x0b5b { 100 } else { 1000 } })
    }
}

/// Why a question has no answer.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Silence {
    System(Errno),
    Answer(Malformed),
}

impl std::fmt::Display for Silence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::System(errno) => errno.fmt(f),
            Self::Answer(malformed) => malformed.fmt(f),
        }
    }
}

/// Asks one question; the answer's data.
fn ask<'a>(
    sys: &mut impl V4l2Sys,
    opcode: Opcode,
    parameters: [u32; 4],
    buffer: &'a mut [u8; CONTROL],
) -> Result<&'a [u8], Silence> {
    *buffer = question(opcode, parameters);
    control(sys, UNIT, SELECTOR, Query::SetCurrent, buffer).map_err(Silence::System)?;
    control(sys, UNIT, SELECTOR, Query::GetCurrent, buffer).map_err(Silence::System)?;
    answer(opcode, buffer).map_err(Silence::Answer)
}

/// Asks a camera for everything that is needed at a size.
pub fn inspect(sys: &mut impl V4l2Sys, model: Model, (width, height): (u32, u32)) -> Facts {
    let mut buffer = [0; CONTROL];
    let mut facts = Facts { kind: model.name.into(), clock_hz: Some(1e6), ..Facts::default() };
    let mut note = Vec::new();

    match ask(sys, Opcode::Gvd, [0; 4], &mut buffer).and_then(|d| Gvd::parse(d).map_err(Silence::Answer)) {
        Ok(gvd) => {
            let serial: String = gvd.serial.iter().map(|b| format!("{b:02x}")).collect();
            let [a, b, c, d] = gvd.firmware;
            facts.kind = format!("{}, serial number {serial}, firmware {a}.{b}.{c}.{d}", model.name);
        }
        Err(e) => note.push(format!("serial number and firmware are not known: {e}")),
    }

    let advanced = ask(sys, Opcode::Advanced, [DEPTH_TABLE, 0, 0, 0], &mut buffer);
    match advanced.and_then(|d| DepthControl::parse(d).map_err(Silence::Answer)) {
        Ok(control) => facts.unit = Some(control.unit),
        Err(e) => {
            facts.unit = DepthUnit::new(f32::from(model.unit_um) * 1e-6).ok();
            note.push(format!(
                "the depth unit is the model's default, {} um: the camera does not say its own ({e}); it was changed if depth looks scaled",
                model.unit_um
            ));
        }
    }

    // The firmware's list and the table each fill the buffer: the list is searched before the table is asked for.
    let (w, h) = (u16::try_from(width).unwrap_or(0), u16::try_from(height).unwrap_or(0));
    let listed = ask(sys, Opcode::RectifiedParams, [0; 4], &mut buffer);
    let mut found: Option<(Intrinsics, Origin)> = listed.ok().and_then(|d| rectified(w, h, records(d), None));
    if found.is_none() {
        let table = ask(sys, Opcode::Calibration, [DEPTH_CALIBRATION, 0, 0, 0], &mut buffer);
        match table.and_then(|d| DepthTable::parse(d).map_err(Silence::Answer)) {
            Ok(table) => found = rectified(w, h, [], Some(&table)),
            Err(e) => note.push(format!("the camera's depth calibration can't be used: {e}")),
        }
    }
    match found {
        Some((k, origin)) => {
            facts.intrinsics = Some(k);
            match origin {
                Origin::Scaled => {
                    note.push(format!("intrinsics at {w}x{h} are scaled from the camera's largest image"));
                }
                Origin::Ideal => note.push(
                    "the camera has no calibration of its own: intrinsics are its design's, right only about".into(),
                ),
                Origin::Firmware | Origin::Table => {}
            }
        }
        None => note.push(format!("the camera says no intrinsics for {w}x{h}")),
    }

    let table = ask(sys, Opcode::Calibration, [COLOUR_CALIBRATION, 0, 0, 0], &mut buffer);
    let colour = table.and_then(|d| ColourTable::parse(d).map_err(Silence::Answer));
    match colour.and_then(|table| Ok(ColourFacts { table, pose: colour_pose(&table).map_err(Silence::Answer)? })) {
        Ok(colour) => facts.colour = Some(colour),
        Err(e) => note.push(format!("no calibration of a colour camera: {e}")),
    }
    facts.notes = note;
    facts
}
