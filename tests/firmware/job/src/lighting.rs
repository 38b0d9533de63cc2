//! One virtual object's light on a device: a session of the preset `tiny`, fed by key frames as another device would send them.
//!
//! Near key frames are seen by the session whole, as they would be from a camera of its own (a near view, and light from afar); far key frames are light from afar. After
//! each the map follows. Then the session's steps are measured one by one.

use core::hint::black_box;

use isobath::glam::Vec3;
use isobath::ground::image::{Image, ImageView, ImageViewMut};
use isobath::lighting::compose::compose;
use isobath::lighting::equirect::MapFrame;
use isobath::lighting::far::extrapolate::FarMap;
use isobath::lighting::far::harmonics::Harmonics;
use isobath::lighting::far::observe::FarSampling;
use isobath::lighting::far::{FarField, FarParams, FarReport};
use isobath::lighting::near::{NearField, NearParams, NearReport, NearStorage};
use isobath::lighting::{Drawn, Preset, Session};
use isobath::sensing::camera::Pose;
use isobath::sensing::frame::DepthFrame;
use isobath::wire::keyframe::{Far, KeyFrame, Near, crc32};

use crate::answers::Answers;
use crate::run::Refused;
use crate::{Probe, Stage};

/// The sizes.
pub const TINY: Preset = Preset::TINY;
/// Pixels of a near view.
const VIEW: usize = TINY.view_pixels();
/// Pixels of the near field's picture.
const LEVEL: usize = TINY.level_pixels();
/// Ambient light before anything was seen, linear.
const AMBIENT: [f32; 3] = [0.2, 0.2, 0.22];

/// The state of one session of [`TINY`].
pub type TinySession<'m> = Session<'m, 1280, 64, 32>;

/// What its near field keeps.
pub type TinyNear = NearStorage<{ TINY.views * VIEW }, { TINY.views * LEVEL }, LEVEL, { TINY.strip() }>;

/// All the memory of the session: what a frame is decoded into, both fields, the map. It is zero from end to end, so it lies in `.bss`.
#[derive(Debug)]
pub struct LightMemory {
    depth: [u16; VIEW],
    colour: [[u8; 3]; VIEW],
    near: TinyNear,
    far: FarField<1280>,
    grid: FarMap<64, 32>,
    map: Image<[u8; 3], { TINY.map.0 }, { TINY.map.1 }>,
}

impl LightMemory {
    /// Zeros.
    pub const NEW: Self = Self {
        depth: [0; VIEW],
        colour: [[0; 3]; VIEW],
        near: NearStorage::new(),
        far: FarField::ZERO,
        grid: FarMap::new(),
        map: Image::filled([0; 3]),
    };
}

/// An object's place and the key frames around it.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// World, y up, metres.
    pub place: [f32; 3],
    /// Messages of [`isobath::wire::keyframe`], near views at most 96 x 72; the last is one.
    pub messages: &'a [&'a [u8]],
}

const fn pixels(name: &'static str, times: usize) -> Stage {
    Stage { name, times: times as u32, unit: "pixel", budgeted: false }
}

const SAMPLES: usize = 32 * 24;
const GRID: usize = 64 * 32;
const MAP: usize = TINY.map_pixels();

/// The session from its first frame on, and its steps alone; what they gave goes to `out`.
///
/// # Errors
/// [`Refused`] when a message is none, or not one of a frame that fits.
pub fn measure(
    around: &Surroundings<'_>,
    memory: &mut LightMemory,
    probe: &mut impl Probe,
    out: &mut impl Answers,
) -> Result<(), Refused> {
    let LightMemory { depth, colour, near, far, grid, map } = memory;
    let at = MapFrame::at(Vec3::from(around.place));
    far.restart(FarParams::default(), AMBIENT);
    let lit = NearField::new(TINY, NearParams::default(), near.lend()).map_err(|_| Refused)?;
    let mut session: TinySession<'_> = Session::new(at, lit, far, grid);
    let mut first = true;
    let mut last = None;
    for message in around.messages {
        let stage = match session_step(message, &mut session, depth, colour, probe, out)? {
            _ if first => pixels("light-draw-first", MAP),
            Step::Near(view) => {
                last = Some(view);
                pixels("light-draw-near", MAP)
            }
            Step::Far => pixels("light-draw-far", MAP),
        };
        first = false;
        let drawn = probe.stage(stage, || session.draw(&mut map.view_mut()));
        tell_drawn(&drawn, out);
        checksum(map, out);
    }
    let each = Stage { name: "light-harmonics", times: 1280, unit: "anchor", budgeted: false };
    let (harmonics, main) = probe.stage(each, || {
        let harmonics = session.far().harmonics();
        let main = harmonics.main_light();
        (harmonics, main)
    });
    tell(&harmonics, out);
    if let Some(main) = main {
        out.vector("main light", main.direction);
        out.vector("main light, colour", Vec3::from(main.colour));
        out.vector("main light, ambient", Vec3::from(main.ambient));
    }
    out.vector("towards", Vec3::from(session.towards(Vec3::new(0.6, -0.48, 0.64))));

    // One by one, on the last near frame, from nothing.
    let frame = last.and_then(|near: Near<'_>| frame_of(&near, depth, colour)).ok_or(Refused)?;
    let mut near = NearField::new(TINY, NearParams::default(), near.lend()).map_err(|_| Refused)?;
    let report = probe.stage(pixels("light-near-insert", VIEW), || near.insert(black_box(&frame), 0, &at));
    tell_near(&report.map_err(|_| Refused)?, out);
    let rows = probe.stage(pixels("light-near-merge", LEVEL), || near.merge());
    out.count("rows merged", rows.1 - rows.0.min(rows.1));
    far.restart(FarParams::default(), AMBIENT);
    let samples = Stage { name: "light-far-frame", times: SAMPLES as u32, unit: "sample", budgeted: false };
    let report = probe.stage(samples, || far.add_frame(black_box(&frame), &at, &FarSampling::default()));
    tell_far(report.map_err(|_| Refused)?, out);
    // All anchors are new: all of the grid.
    let report = probe.stage(pixels("light-far-map", GRID), || grid.update(far));
    out.count("far blocks", report.computed);
    let report = probe.stage(pixels("light-compose", MAP), || compose(&near, grid, &mut map.view_mut()));
    out.count("map pixels", report.written);
    checksum(map, out);
    Ok(())
}

/// What a message was.
enum Step<'a> {
    Near(Near<'a>),
    Far,
}

/// A message decoded and seen.
fn session_step<'a>(
    message: &'a [u8],
    session: &mut TinySession<'_>,
    depth: &mut [u16; VIEW],
    colour: &mut [[u8; 3]; VIEW],
    probe: &mut impl Probe,
    out: &mut impl Answers,
) -> Result<Step<'a>, Refused> {
    match KeyFrame::decode(message).map_err(|_| Refused)? {
        KeyFrame::Near(_) => {
            let near = probe.stage(pixels("key-frame-near", VIEW), || decode_near(black_box(message), depth, colour));
            let near = near.ok_or(Refused)?;
            let frame = frame_of(&near, depth, colour).ok_or(Refused)?;
            let id = near.header().view.into();
            let seen = probe.stage(pixels("light-observe-near", VIEW), || session.observe(black_box(&frame), id));
            let seen = seen.map_err(|_| Refused)?;
            if let Some(near) = &seen.near {
                tell_near(near, out);
            }
            tell_far(seen.far, out);
            Ok(Step::Near(near))
        }
        KeyFrame::Far(_) => {
            let far = probe.stage(pixels("key-frame-far", SAMPLES), || decode_far(black_box(message), colour));
            let far = far.ok_or(Refused)?;
            let (width, height) = far.size();
            let picture = ImageView::new(colour, width, height).map_err(|_| Refused)?;
            let camera = Pose::new(far.rotation(), Vec3::ZERO).map_err(|_| Refused)?;
            let samples = Stage { name: "light-observe-far", times: SAMPLES as u32, unit: "sample", budgeted: false };
            let report = probe.stage(samples, || {
                session.observe_far(black_box(picture), &far.intrinsics(), &camera, far.header().time)
            });
            tell_far(report, out);
            Ok(Step::Far)
        }
        _ => Err(Refused),
    }
}

/// Checks a near key frame and decodes its images.
fn decode_near<'a>(message: &'a [u8], depth: &mut [u16; VIEW], colour: &mut [[u8; 3]; VIEW]) -> Option<Near<'a>> {
    let KeyFrame::Near(near) = KeyFrame::decode(message).ok()? else { return None };
    let (width, height) = near.size();
    let mut depth = ImageViewMut::new(depth, width, height).ok()?;
    near.depth_into(&mut depth).ok()?;
    near.colour_into(depth.as_view(), &mut ImageViewMut::new(colour, width, height).ok()?).ok()?;
    Some(near)
}

/// Checks a far key frame and decodes its picture.
fn decode_far<'a>(message: &'a [u8], colour: &mut [[u8; 3]; VIEW]) -> Option<Far<'a>> {
    let KeyFrame::Far(far) = KeyFrame::decode(message).ok()? else { return None };
    let (width, height) = far.size();
    far.colour_into(&mut ImageViewMut::new(colour, width, height).ok()?).ok()?;
    Some(far)
}

/// A near key frame's images as a frame.
fn frame_of<'a>(near: &Near<'_>, depth: &'a [u16; VIEW], colour: &'a [[u8; 3]; VIEW]) -> Option<DepthFrame<'a>> {
    let (width, height) = near.size();
    let frame = DepthFrame::new(ImageView::new(depth, width, height).ok()?, near.unit(), near.intrinsics());
    let frame = frame.with_colour(ImageView::new(colour, width, height).ok()?).ok()?;
    Some(frame.with_pose(near.pose()).with_time(near.header().time, near.header().sequence))
}

fn tell_near(near: &NearReport, out: &mut impl Answers) {
    out.count("near points", near.points);
    out.count("near points inside", near.inside);
    out.count("near points skipped", near.skipped);
}

fn tell_far(far: FarReport, out: &mut impl Answers) {
    out.count("far samples", far.samples);
    out.count("far anchors changed", far.changed);
}

fn tell_drawn(drawn: &Drawn, out: &mut impl Answers) {
    out.count("first near row", drawn.near_rows.0);
    out.count("last near row", drawn.near_rows.1);
    out.count("far anchors drawn", drawn.far.anchors);
    out.count("far blocks drawn", drawn.far.computed);
    out.count("map pixels drawn", drawn.map.written);
}

fn tell(harmonics: &Harmonics, out: &mut impl Answers) {
    for coefficient in harmonics.coefficients {
        out.vector("harmonics", Vec3::from(coefficient));
    }
    out.vector("ambient", Vec3::from(harmonics.ambient()));
    out.vector("irradiance", Vec3::from(harmonics.irradiance(Vec3::Y)));
}

/// All of the map in two numbers, and some of its pixels as they are.
fn checksum(map: &Image<[u8; 3], { TINY.map.0 }, { TINY.map.1 }>, out: &mut impl Answers) {
    let crc = crc32(map.as_slice().as_flattened());
    out.count("map, upper half of the CRC", (crc >> 16) as usize);
    out.count("map, lower half of the CRC", (crc & 0xffff) as usize);
    for pixel in map.as_slice().iter().step_by(331) {
        out.vector("map", Vec3::from(pixel.map(f32::from)));
    }
}
