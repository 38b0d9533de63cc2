//! Environment lighting against the truth: the lighting paper's section 6, on scenes that are known exactly.
//!
//! Around each of ten places in a living room stand 72 observers (8 around, 3 body heights, 3 distances). Each takes one frame that sees
//! the place and nine that look away from it, in the guided grid; the map made from them is compared with what is seen from the place in truth, and so are three
//! balls under both. Beside it stand what else one could do: a 360-degree picture taken where the observer is, one field alone, an ambient reading. Then one
//! thing at a time: views, directions, the paper's rules, drift of the poses, forms of the extrapolation; and what each component takes.
//!
//! | file | idea |
//! |---|---|
//! | here | what is measured, and in which order |
//! | `sights` | frames as phones give them, rendered |
//! | `reconstruct` | frames into a map, whole or in parts |
//! | `score` | PSNR and SSIM of maps and balls |
//! | `quality` | all observers, all ways, all ablations |
//! | `anchors` | forms of the far field's extrapolation |
//! | `panoramas` | the far field under photographed HDR light |
//! | `times` | components, preset by preset |
//! | `report`, `chart` | tables for a terminal, a page, machines |
//!
//! Frames are 8-bit colour and 16-bit depth with exact poses, one ray a pixel, 63 degrees wide; windows and lamps are brighter than their
//! white, so some light is lost to all who look through such a camera (the row `360 capture, HDR` is the one that does not).

mod anchors;
mod chart;
mod panoramas;
mod quality;
mod reconstruct;
pub mod report;
mod score;
mod sights;
mod times;

use std::time::Duration;

use isobath_sim::Scene;

use crate::BenchError;
use crate::measure::Effort;
use quality::{CAPTURE, DIRECTIONS, DRIFT, Measured, OURS, PRESETS, RULES, VIEWS, WAYS};
use report::{Column, Line, Plot, Report, Table};
pub use score::{Alike, Quality};

/// All maps are compared at this size.
const SIZE: (usize, usize) = (512, 256);
/// The scene of the simulated part.
const SCENE: &str = "living-room";

/// What to measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Two places, two stations: half a minute.
    pub quick: bool,
    /// Of drift and random colours.
    pub seed: u64,
}

/// How much of everything.
#[derive(Debug)]
struct Plan {
    places: usize,
    stations: Vec<usize>,
    /// Stations where the ablations are done too.
    few: Vec<usize>,
    panoramas: usize,
    seed: u64,
}

impl Plan {
    fn new(options: &Options) -> Self {
        let Options { quick, seed } = *options;
        // Every ninth: all heights, distances and sides in turn.
        let few: Vec<usize> = (0..8).map(|i| 9 * i).collect();
        if quick {
            return Self { places: 2, stations: vec![9, 36], few: vec![9, 36], panoramas: 2, seed };
        }
        Self { places: usize::MAX, stations: (0..72).collect(), few, panoramas: usize::MAX, seed }
    }
}

const fn column(key: &'static str, head: &'static str, unit: &'static str, shown: bool) -> Column {
    Column { key, head, unit, shown }
}

const QUALITY: &[Column] = &[
    column("map_psnr", "map", "dB", true),
    column("mirror_psnr", "mirror", "dB", true),
    column("glossy_psnr", "glossy", "dB", true),
    column("diffuse_psnr", "diffuse", "dB", true),
    column("map_ssim", "map", "SSIM", true),
    column("mirror_ssim", "mirror", "SSIM", true),
    column("glossy_ssim", "glossy", "SSIM", false),
    column("diffuse_ssim", "diffuse", "SSIM", false),
];

const AGAINST: &[Column] = &[
    column("ours_map_psnr", "map", "dB", true),
    column("map_gain", "map", "%", true),
    column("ours_mirror_psnr", "mirror", "dB", true),
    column("mirror_gain", "mirror", "%", true),
    column("glossy_gain", "glossy", "%", true),
    column("diffuse_gain", "diffuse", "%", true),
    column("capture_map_psnr", "360 map", "dB", false),
    column("capture_mirror_psnr", "360 mirror", "dB", false),
];

const ANCHORS: &[Column] = &[
    column("scene_psnr", "room", "dB", true),
    column("random_psnr", "random", "dB", true),
    column("worst", "worst", "of 1", true),
    column("time", "512x256", "ms", true),
    column("tables", "tables", "KiB", true),
];

const REAL: &[Column] = &[
    column("seen", "seen", "%", true),
    column("blurred_psnr", "blurred", "dB", true),
    column("blurred_seen_psnr", "of seen", "dB", true),
    column("sharp_psnr", "sharp", "dB", true),
    column("sharp_seen_psnr", "of seen", "dB", true),
    column("diffuse_psnr", "matt", "dB", true),
];

const TIMES: &[Column] = &[
    column("view_in", "view in", "ms", true),
    column("merge", "merge", "ms", true),
    column("far_frame_in", "far in", "ms", true),
    column("far_map", "far map", "ms", true),
    column("compose", "compose", "ms", true),
    column("near_to_map", "near", "ms", true),
    column("far_to_map", "far", "ms", true),
    column("near_to_bytes", "near, bytes", "ms", false),
    column("far_to_bytes", "far, bytes", "ms", false),
    column("memory", "memory", "KiB", true),
];

/// Measures; `tell` hears what is being done.
///
/// # Errors
/// [`BenchError`]: a scene that can't be simulated, a panorama that can't be read.
pub fn run(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Report, BenchError> {
    let plan = Plan::new(options);
    let scene = Scene::open(SCENE)?;
    let effort = if options.quick {
        Effort { rounds: 3, batch: Duration::from_micros(500), longest: Duration::from_millis(120) }
    } else {
        Effort { rounds: 9, batch: Duration::from_millis(2), longest: Duration::from_secs(1) }
    };
    tell("lighting: components");
    let times = times::measure(&scene, &effort)?;
    tell("lighting: extrapolation");
    let first = scene.places().values().next().copied().unwrap_or_default();
    let anchors = anchors::measure(&sights::panorama(&scene, first, 1), options.seed, &effort)?;
    let (real, notes) = panoramas::measure(&plan, tell)?;
    let measured = quality::measure(&plan, &scene, tell)?;
    let mut report = Report { quick: options.quick, seed: options.seed, tables: Vec::new(), notes };
    tables(&plan, &measured, &mut report);
    report.tables.push(Table {
        key: "extrapolation",
        title: "Light between the anchors, against the sum over all 1280".into(),
        note: "room: the light of the scene's first place on all anchors; random: colours independent from anchor to anchor. Linear light, peak 1. \
               Times are of a whole map of 512x256; tables are constants and the grid itself, and for the 32 nearest a table for 1024x512."
            .into(),
        columns: ANCHORS,
        lines: anchors,
        plot: Plot::None,
    });
    report.tables.push(Table {
        key: "panoramas",
        title: "The far field under real light: HDR panoramas".into(),
        note: "From 32x24 crops of photographed panoramas, without depth; PSNR against the panorama under the anchors' own kernel \
               (blurred) and itself (sharp), over all directions and those seen. 26 directions see everything."
            .into(),
        columns: REAL,
        lines: real,
        plot: Plot::None,
    });
    report.tables.push(Table {
        key: "times",
        title: "What components take, all views stored, one core".into(),
        note: "Best of several rounds, the thread's own time. near, far: a frame in to the map drawn (f32; as sRGB bytes in the files), by a session. memory: near field, anchors, grid; not the map. To be reached: near \
               15 (high), 6 (medium), 2 ms (low), far 1 ms; tiny within 256 KiB. The paper, Jetson GPU: projection 14.6 ms, near 134, far 58 ms to the map."
            .into(),
        columns: TIMES,
        lines: times,
        plot: Plot::Bars(&[0, 1, 2, 3, 4]),
    });
    report.tables.retain(|table| !table.lines.is_empty());
    Ok(report)
}

/// Means over observers of what was measured.
fn tables(plan: &Plan, measured: &[Measured], report: &mut Report) {
    let low = "One near view of 256x192 (low preset) and nine guided frames, unless said.";
    let sorts: [(&'static str, &str, &str, Plot); 6] = [
        (
            WAYS,
            "Ours and what else one could do",
            "One near view of 512x384 and nine guided frames. 360 capture: a panorama taken where the observer stands.",
            Plot::Bars(&[0, 1, 2, 3]),
        ),
        (
            PRESETS,
            "Presets",
            "One near view of 1024x768, brought down by each preset, and nine guided frames.",
            Plot::Bars(&[0, 1, 2, 3]),
        ),
        (
            VIEWS,
            "Near views",
            "Low preset with room for 7; neighbours on the circle; no far field, ambient instead.",
            Plot::Lines(&[0, 1, 2, 3]),
        ),
        (DIRECTIONS, "Guided directions", low, Plot::Lines(&[0, 1, 2, 3])),
        (RULES, "Our rules and the paper's", low, Plot::None),
        (
            DRIFT,
            "Drift of the poses",
            "Five near views, four of them off by so much, and nine guided frames. Registered: poses made to agree with the exact one's.",
            Plot::None,
        ),
    ];
    for (key, title, note, plot) in sorts {
        let own: Vec<&Measured> = measured.iter().filter(|m| m.table == key).collect();
        let mut rows: Vec<&'static str> = Vec::new();
        for m in &own {
            if !rows.contains(&m.row) {
                rows.push(m.row);
            }
        }
        let of = |row: &str| own.iter().filter(|m| m.row == row).map(|m| &m.quality).collect::<Vec<_>>();
        let observers = rows.first().map_or(0, |row| of(row).len());
        let lines = rows.iter().map(|row| Line::new(row, score::mean(of(row).into_iter()).to_vec())).collect();
        report.tables.push(Table {
            key,
            title: title.into(),
            note: format!("Mean of {observers} observers. {note}"),
            columns: QUALITY,
            lines,
            plot,
        });
        if key == WAYS {
            report.tables.push(against(plan, &own));
        }
    }
}

/// Ours against the 360-degree capture, place by place.
fn against(plan: &Plan, ways: &[&Measured]) -> Table {
    let mut places: Vec<&str> = Vec::new();
    for m in ways {
        if !places.contains(&m.place.as_str()) {
            places.push(&m.place);
        }
    }
    let line = |name: &str, place: Option<&str>| {
        let of = |row: &str| {
            let own = ways.iter().filter(|m| m.row == row && place.is_none_or(|p| p == m.place));
            score::mean(own.map(|m| &m.quality))
        };
        let (ours, capture) = (of(OURS), of(CAPTURE));
        let gain = |i: usize| 100.0 * (ours[i] / capture[i] - 1.0);
        let cells = vec![ours[0], gain(0), ours[1], gain(1), gain(2), gain(3), capture[0], capture[1]];
        let lost = (0..4).any(|i| gain(i) < 0.0);
        Line { name: name.to_owned(), cells, lost }
    };
    let mut lines: Vec<Line> = places.iter().map(|place| line(place, Some(place))).collect();
    lines.push(line("all", None));
    Table {
        key: "places",
        title: "Ours (medium) against the 360-degree capture, by place".into(),
        note: format!(
            "Mean PSNR of {} observers a place; gain: by how much ours is above the capture's, in per cent of its decibels as the paper counts, which says 17.1 \
             on the mean of its objects. Lines with a loss anywhere are marked.",
            plan.stations.len()
        ),
        columns: AGAINST,
        lines,
        plot: Plot::Bars(&[1, 3, 4, 5]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_few_stations_take_every_height_distance_and_side() {
        let plan = Plan::new(&Options { quick: false, seed: 1 });
        assert_eq!(
            (plan.stations.len(), plan.few.len()),
            (isobath_sim::orbit_stations(isobath_sim::V3::ZERO).len(), 8)
        );
        let mut sides: Vec<usize> = plan.few.iter().map(|s| s % 8).collect();
        sides.sort_unstable();
        assert_eq!(sides, (0..8).collect::<Vec<_>>());
        assert!((0..9).filter(|c| plan.few.iter().any(|s| s / 8 == *c)).count() == 8);
    }

    #[test]
    fn places_where_ours_loses_are_marked() {
        let quality = |psnr: f64| {
            let alike = Alike { psnr, ssim: 0.5 };
            Quality { map: alike, balls: [alike; 3] }
        };
        let of = |row, place: &str, psnr| Measured { table: WAYS, row, place: place.into(), quality: quality(psnr) };
        let measured = [of(OURS, "a", 20.0), of(CAPTURE, "a", 16.0), of(OURS, "b", 15.0), of(CAPTURE, "b", 16.0)];
        let mut report = Report { quick: true, seed: 1, tables: Vec::new(), notes: Vec::new() };
        tables(&Plan::new(&Options { quick: true, seed: 1 }), &measured, &mut report);
        let places = report.tables.iter().find(|t| t.key == "places").unwrap();
        assert_eq!(places.lines.iter().map(|l| l.lost).collect::<Vec<_>>(), [false, true, false]);
        assert!((places.lines[0].cells[1] - 25.0).abs() < 1e-9);
        assert!(report.text().contains("below"), "{}", report.text());
    }
}
