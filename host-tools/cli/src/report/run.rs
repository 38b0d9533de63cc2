//! What the main job found: for people in words, for machines as JSON, and as a page of pictures.

use std::path::Path;
use std::time::Duration;

use isobath::glam::Vec3;
use isobath::ground::geometry::OrientedBox;
use isobath::localized::collision::Verdict;
use isobath::localized::hit::HitOutcome;
use isobath::localized::normals::NormalParams;
use isobath::localized::normals::dense::{rows, scratch_len};
use isobath::localized::placement::NoPlace;
use isobath::localized::planner::Plan;
use isobath::localized::raycast::RayOutcome;
use isobath::localized::reticle::ReticleState;
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::Work;
use serde_json::{Value, json};

use super::charts::{self, Bar};
use super::{Card, Figure, Page, Table};
use crate::commands::info::extend;
use crate::failure::{Failure, Outcome};
use crate::picture::map::{MapDrawing, TALL, height_colour};
use crate::picture::perspective::Pen;
use crate::picture::svg::Svg;
use crate::picture::{colours, frames};
use crate::pipeline::{CHAIR, Findings, MAP_CELL, MAP_CELLS, Pipeline, STAGES, STANDING, STOOL, WALKER, WORK_UNITS};
use crate::say::{Say, bytes, count, duration, metres, point};
use crate::source::{Source, Up};

/// Numbers gathered over all frames.
#[derive(Debug, Default)]
pub(crate) struct Stats {
    read: Vec<u64>,
    stages: [Vec<u64>; STAGES.len()],
    work: [Option<Work>; STAGES.len()],
    frames: Vec<Value>,
    notes: Vec<String>,
    grounds: usize,
    paths: usize,
}

/// Median and worst of some times.
#[derive(Debug, Clone, Copy, Default)]
struct Spread {
    median: f64,
    worst: f64,
}

fn spread(times: &[u64]) -> Spread {
    let mut sorted = times.to_vec();
    sorted.sort_unstable();
    let n = sorted.len();
    let at = |i: usize| sorted.get(i).map_or(0.0, |&t| t as f64);
    if n == 0 {
        return Spread::default();
    }
    Spread { median: 0.5 * (at((n - 1) / 2) + at(n / 2)), worst: at(n - 1) }
}

impl Stats {
    pub(crate) fn read(&mut self, time: Duration) {
        self.read.push(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX));
    }

    pub(crate) fn stages(&mut self, times: &[u64; STAGES.len()]) {
        for (list, &time) in self.stages.iter_mut().zip(times) {
            list.push(time);
        }
    }

    /// Counts a frame, once however often it was repeated.
    pub(crate) fn frame(&mut self, index: usize, found: &Findings, notes: Vec<String>) {
        for (sum, work) in self.work.iter_mut().zip(found.work) {
            if let Some(work) = work {
                *sum.get_or_insert_default() += work;
            }
        }
        self.grounds += usize::from(found.ground.is_ok());
        self.paths += usize::from(matches!(found.plan, Plan::Found(_)));
        let mut entry = serde_json::Map::new();
        entry.insert("frame".into(), index.into());
        extend(&mut entry, findings_json(found));
        self.frames.push(Value::Object(entry));
        for note in notes {
            if !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
    }

    fn spreads(&self) -> [Spread; STAGES.len()] {
        std::array::from_fn(|i| self.stages.get(i).map_or_else(Spread::default, |t| spread(t)))
    }

    /// All stages of one pass together.
    fn total(&self) -> Spread {
        let passes = self.stages[0].len();
        let sums: Vec<u64> = (0..passes)
            .map(|i| self.stages.iter().filter_map(|s| s.get(i)).fold(0, |a: u64, t| a.saturating_add(*t)))
            .collect();
        spread(&sums)
    }
}

/// The pictures of the frame that is shown, drawn while its memory holds it.
#[derive(Debug)]
pub(crate) struct Drawings {
    figures: Vec<Figure>,
}

/// Everything there is to tell.
#[derive(Debug)]
pub(crate) struct Overview<'a> {
    pub(crate) source: &'a Source,
    pub(crate) size: (usize, usize),
    pub(crate) frames: usize,
    pub(crate) repeat: u32,
    pub(crate) shown: usize,
    pub(crate) found: &'a Findings,
    pub(crate) up: Up,
    pub(crate) bytes: &'a [(&'static str, usize)],
    pub(crate) stats: &'a Stats,
    pub(crate) has_poses: bool,
    pub(crate) unread: &'a [String],
    pub(crate) report: &'a Path,
}

/// A plan in a word, for machines.
pub(crate) const fn plan_name(plan: &Plan) -> &'static str {
    match plan {
        Plan::Found(_) => "path",
        Plan::NoPath { .. } => "no_path",
        Plan::StartOutside => "start_outside",
        Plan::StartUnknown => "start_unknown",
        Plan::StartBlocked => "start_blocked",
        Plan::GoalOutside => "goal_outside",
        Plan::GoalUnknown => "goal_unknown",
        Plan::GoalBlocked => "goal_blocked",
        Plan::NodesExceeded { .. } => "nodes_exceeded",
        Plan::PointsExceeded { .. } => "points_exceeded",
    }
}

/// A plan that was not found, for people.
pub(crate) fn plan_sentence(plan: &Plan) -> String {
    match plan {
        Plan::Found(path) => format!("{}, {} points", metres(path.length), path.points),
        Plan::NoPath { expanded } => format!("no way over known, free ground ({expanded} cells searched)"),
        Plan::StartOutside => "the start lies outside the map".into(),
        Plan::StartUnknown => "nothing is known of the ground at the start".into(),
        Plan::StartBlocked => "the start is at an obstacle".into(),
        Plan::GoalOutside => "the goal lies outside the map".into(),
        Plan::GoalUnknown => "nothing is known of the ground at the goal".into(),
        Plan::GoalBlocked => "the goal is at an obstacle".into(),
        Plan::NodesExceeded { .. } => "the planner's memory is too small for the map".into(),
        Plan::PointsExceeded { needed, got } => format!("the way has {needed} corners, there is room for {got}"),
    }
}

/// How the chairs' votes came out: free, blocked, unknown.
fn tally(found: &Findings) -> [usize; 3] {
    [Verdict::Free, Verdict::Blocked, Verdict::Unknown].map(|verdict| found.chairs().filter(|c| c.1 == verdict).count())
}

/// Boxes that don't overlap, the first ones first, so that a picture stays readable.
fn thinned<'a>(boxes: impl Iterator<Item = &'a OrientedBox>) -> Vec<OrientedBox> {
    let mut kept: Vec<OrientedBox> = Vec::new();
    for b in boxes {
        let apart = |k: &OrientedBox| (b.centre - k.centre).length() >= 2.0 * b.half.x.max(b.half.z);
        if kept.iter().all(apart) {
            kept.push(*b);
        }
    }
    kept
}

/// The chairs of one verdict, thinned, nearest first.
fn chairs_of(found: &Findings, verdict: Verdict) -> Vec<OrientedBox> {
    let mut all: Vec<&OrientedBox> = found.chairs().filter(|c| c.1 == verdict).map(|c| c.0).collect();
    all.sort_by(|a, b| a.centre.distance(found.camera).total_cmp(&b.centre.distance(found.camera)));
    thinned(all.into_iter())
}

/// Why there is no place, in a word, for machines.
pub(crate) const fn no_place_name(why: &NoPlace) -> &'static str {
    match why {
        NoPlace::BadSize => "bad_size",
        NoPlace::BadUp => "bad_up",
        NoPlace::OutsideView => "outside_view",
        NoPlace::NoSurface => "no_surface",
        NoPlace::TooSteep { .. } => "too_steep",
        NoPlace::TooRough { .. } => "too_rough",
        NoPlace::TooSmall { .. } => "too_small",
        NoPlace::Blocked { .. } => "blocked",
        NoPlace::Unknown { .. } => "unknown",
        _ => "other",
    }
}

const fn verdict_name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Free => "free",
        Verdict::Blocked => "blocked",
        Verdict::Unknown => "unknown",
    }
}

/// Straight-line distance between the path's ends, for comparison.
fn detour(found: &Findings) -> Option<(f32, f32)> {
    let Plan::Found(path) = found.plan else { return None };
    let straight = found.path.first()?.distance(*found.path.last()?);
    Some((path.length, straight))
}

const CHAIR_SAID: &str = "0.5\u{a0}x\u{a0}0.9\u{a0}x\u{a0}0.5";
const STOOL_SAID: &str = "0.3\u{a0}x\u{a0}0.4\u{a0}x\u{a0}0.3";

fn ray_counts(found: &Findings) -> [usize; 5] {
    let mut n = [0; 5];
    for (_, outcome) in &found.rays {
        n[match outcome {
            RayOutcome::Hit(_) => 0,
            RayOutcome::HitOccluded { .. } => 1,
            RayOutcome::Miss { .. } => 2,
            RayOutcome::NoDepth => 3,
            RayOutcome::OutsideView => 4,
        }] += 1;
    }
    n
}

fn findings_json(found: &Findings) -> Value {
    let ground = match &found.ground {
        Ok(g) => json!({
            "answer": "ground", "camera_height_m": g.fit.plane.distance(found.camera), "normal": g.fit.plane.normal().to_array(), "offset_m": g.fit.plane.offset(),
            "rms_m": g.fit.rms, "tilt_from_up_rad": g.tilt, "tilt_sigma_rad": g.fit.tilt_sigma, "area_m2": g.area,
        }),
        Err(why) => json!({ "answer": "no_ground", "why": why }),
    };
    let hit = match &found.hit {
        HitOutcome::Hit(hit) => json!({
            "answer": "hit", "point_m": hit.point.to_array(), "normal": hit.normal.map(|n| n.to_array()),
            "z_m": hit.z, "range_m": hit.range, "sigma_z_m": hit.sigma_z,
        }),
        HitOutcome::NoDepth { .. } => json!({ "answer": "no_depth" }),
        HitOutcome::OutsideView => json!({ "answer": "outside_view" }),
    };
    let taps: Vec<Value> = found
        .taps
        .iter()
        .map(|t| {
            let chair = t.chair.map_or_else(
                || json!({ "answer": "not_level" }),
                |(b, c)| {
                    json!({
                        "answer": verdict_name(c.verdict), "centre_m": b.centre.to_array(),
                        "rotation_xyzw": b.rotation.to_array(), "visible": c.tally.visible, "hidden": c.tally.hidden,
                    })
                },
            );
            let stool = match &t.stool {
                Ok(p) => json!({
                    "answer": "free", "centre_m": p.pose.centre.to_array(), "rotation_xyzw": p.pose.rotation.to_array(),
                    "flatness_m": p.flatness, "tilt_rad": p.tilt, "coverage": p.coverage,
                }),
                Err(why) => json!({ "answer": no_place_name(why) }),
            };
            json!({ "pixel": [t.pixel.0, t.pixel.1], "chair": chair, "stool": stool })
        })
        .collect();
    let [free, blocked, unknown] = tally(found);
    let [hits, occluded, missed, no_depth, outside] = ray_counts(found);
    let path: Vec<[f32; 3]> = found.path.iter().map(|p| p.to_array()).collect();
    let detour = detour(found);
    json!({
        "pixels": found.pixels, "readings": found.readings,
        "normals": found.normals, "normals_facing_up": found.level,
        "ground": ground,
        "reticle": hit,
        "rays": { "hit": hits, "hit_occluded": occluded, "miss": missed, "no_depth": no_depth, "outside_view": outside },
        "placement": {
            "chair_size_m": CHAIR.to_array(), "stool_size_m": STOOL.to_array(),
            "chairs_free": free, "chairs_blocked": blocked, "chairs_unknown": unknown,
            "stools_free": found.stools().count(), "taps": taps,
        },
        "height_map": {
            "cell_m": MAP_CELL, "cells": MAP_CELLS * MAP_CELLS, "known_cells": found.map_known,
            "readings_used": found.map.used, "overhead": found.map.overhead, "outside": found.map.outside,
        },
        "path": {
            "answer": plan_name(&found.plan), "points_m": path, "length_m": detour.map(|d| d.0),
            "straight_m": detour.map(|d| d.1),
            "from_m": found.ends.0.to_array(), "to_m": found.ends.1.to_array(),
        },
    })
}

impl Overview<'_> {
    fn times_said(&self) -> String {
        match (self.frames, self.repeat) {
            (1, n) => format!("of {n} passes over the one frame"),
            (frames, 1) => format!("of {frames} frames"),
            (frames, n) => format!("of {frames} frames, {n} passes each"),
        }
    }

    /// Name, finding, and remark of each answer.
    fn answers(&self) -> Vec<(&'static str, String, String)> {
        let f = self.found;
        let share = |part: usize, whole: usize| 100.0 * part as f32 / whole.max(1) as f32;
        let (w, h) = self.size;
        let mut out = vec![(
            "depth",
            format!("{:.1} % of {w} x {h} pixels", share(f.readings, f.pixels)),
            format!("{} readings", count(f.readings as u64)),
        )];
        out.push((
            "normals",
            format!("{} pixels", count(f.normals as u64)),
            format!("{:.0} % of them face up", share(f.level, f.normals)),
        ));
        out.push(match &f.ground {
            Ok(g) => (
                "ground",
                format!("{} below the camera", metres(g.fit.plane.distance(f.camera))),
                format!("{:.1} m² of it seen, flat to {} RMS; {}", g.area, metres(g.fit.rms), self.pitch()),
            ),
            Err(why) => ("ground", "not found".into(), why.clone()),
        });
        out.push(match (&f.hit, f.reticle) {
            (HitOutcome::Hit(hit), _) => (
                "reticle",
                format!("{} ahead, ±\u{a0}{}", metres(hit.z), metres(hit.sigma_z)),
                hit.normal.map_or("no normal there".into(), |n| {
                    let tilt = n.dot(self.up.direction).clamp(-1.0, 1.0).acos().to_degrees();
                    format!("at {}, its normal {tilt:.0}° from up", point(hit.point))
                }),
            ),
            (_, ReticleState::Holding { age, .. }) => {
                ("reticle", format!("held for {age:.2} s"), "no depth at the centre; the last pose is kept".into())
            }
            _ => ("reticle", "lost".into(), "no depth at the centre".into()),
        });
        let [hits, occluded, missed, no_depth, outside] = ray_counts(f);
        out.push((
            "rays",
            format!("{hits} of {} hit", f.rays.len()),
            format!("{occluded} went behind something, {missed} missed, {} unknown", no_depth + outside),
        ));
        let [free, blocked, unknown] = tally(f);
        let level = free + blocked + unknown;
        out.push((
            "chair",
            format!("free at {free} of {level} taps"),
            format!(
                "blocked at {blocked}, unknown at {unknown}; {}\u{a0}m, a vote of 13 points; {level} of {} taps met level ground",
                CHAIR_SAID,
                f.taps.len()
            ),
        ));
        out.push((
            "stool",
            format!("fits at {} of {} taps", f.stools().count(), f.taps.len()),
            format!("{STOOL_SAID}\u{a0}m, level and wholly in sight"),
        ));
        out.push((
            "height map",
            format!("{:.1} m² known", f.map_known as f32 * MAP_CELL * MAP_CELL),
            format!("{} cells of {:.0} cm", count(f.map_known as u64), MAP_CELL * 100.0),
        ));
        out.push(match detour(f) {
            Some((length, straight)) => {
                let more = (length / straight.max(1e-6) - 1.0) * 100.0;
                let corners = f.path.len().saturating_sub(2);
                let remark = if more < 0.5 {
                    "straight across".to_owned()
                } else {
                    let s = if corners == 1 { "" } else { "s" };
                    format!("{more:.0} % longer than the straight line, {corners} corner{s} around what is in the way")
                };
                ("path", format!("{} long", metres(length)), remark)
            }
            None => ("path", "none".into(), plan_sentence(&f.plan)),
        });
        out
    }

    /// Where the camera looks, against the horizon.
    fn pitch(&self) -> String {
        let down = -self.found.axis.dot(self.up.direction).clamp(-1.0, 1.0).asin().to_degrees();
        let way = if down < 0.0 { "up" } else { "down" };
        format!("the camera looks {:.0}° {way}", down.abs())
    }

    /// For people, on a terminal.
    pub(crate) fn tell(&self, say: &mut Say) {
        let (w, h) = self.size;
        let name = self.source.name();
        let kind = &self.source.recording().info().kind;
        let frames = if self.frames == 1 { "1 frame".to_owned() } else { format!("{} frames", self.frames) };
        say.head(&format!("{name}: {kind}, {frames} of {w} x {h}"));
        say.fact("up", &self.up.sentence());
        if !self.has_poses {
            say.fact("world", "the camera frame (x right, y down, z forward): there are no poses");
        }
        for note in self.notes() {
            say.fact("note", &note);
        }
        say.line("");
        let what = if self.frames == 1 {
            "What was found".to_owned()
        } else {
            format!("What was found in frame {}", self.shown)
        };
        say.head(&what);
        for (name, value, remark) in self.answers() {
            say.fact(name, &format!("{value}; {remark}"));
        }
        if self.frames > 1 {
            let s = self.stats;
            let n = s.frames.len();
            say.fact("all frames", &format!("ground in {} of {n}, a path in {} of {n}", s.grounds, s.paths));
        }
        say.line("");
        let header = ["stage", "median", "worst", "work done", "skipped", "unit"];
        say.table(&header, &self.stage_rows(), &[5]);
        say.remark(&format!("Wall-clock times {}, one core. `read` is done once a frame.", self.times_said()));
        say.line("");
        let total: usize = self.bytes.iter().map(|b| b.1).sum();
        let parts: Vec<String> =
            self.bytes.iter().map(|(name, n)| format!("{name} {}", bytes(*n).replace(' ', "\u{a0}"))).collect();
        say.fact("state", &format!("{}: {}", bytes(total), parts.join(", ")));
        say.fact("report", &self.report.display().to_string());
    }

    fn stage_rows(&self) -> Vec<Vec<String>> {
        let spreads = self.stats.spreads();
        let read = spread(&self.stats.read);
        let time = |s: Spread| [duration(s.median), duration(s.worst)];
        let row = |name: &str, s: Spread, rest: [String; 3]| {
            let [median, worst] = time(s);
            let [done, skipped, unit] = rest;
            vec![name.to_owned(), median, worst, done, skipped, unit]
        };
        let none = || [String::new(), String::new(), String::new()];
        let mut rows = vec![row("read", read, none())];
        for (i, (name, s)) in STAGES.iter().zip(spreads).enumerate() {
            let work = match self.stats.work[i] {
                Some(work) => [
                    count(work.done),
                    format!("{} ({:.0} %)", count(work.skipped), work.skipped_share() * 100.0),
                    WORK_UNITS[i].to_owned(),
                ],
                None => none(),
            };
            rows.push(row(name, s, work));
        }
        rows.push(row("all stages", self.stats.total(), none()));
        rows
    }

    fn notes(&self) -> Vec<String> {
        let info = self.source.recording().info();
        let mut notes: Vec<String> = info.notes.iter().chain(&self.stats.notes).cloned().collect();
        let most = 5;
        notes.extend(self.unread.iter().take(most).cloned());
        if self.unread.len() > most {
            notes.push(format!("{} more frames were left out", self.unread.len() - most));
        }
        notes
    }

    /// For machines.
    pub(crate) fn json(&self) -> Value {
        let spreads = self.stats.spreads();
        let ns = |s: Spread| json!({ "median_ns": s.median, "worst_ns": s.worst });
        let mut times = serde_json::Map::new();
        times.insert("read".into(), ns(spread(&self.stats.read)));
        let mut work = serde_json::Map::new();
        for (i, name) in STAGES.iter().enumerate() {
            let key = name.replace(' ', "_");
            times.insert(key.clone(), ns(spreads[i]));
            if let Some(w) = self.stats.work[i] {
                work.insert(key, json!({ "done": w.done, "skipped": w.skipped, "unit": WORK_UNITS[i] }));
            }
        }
        times.insert("all_stages".into(), ns(self.stats.total()));
        let state: serde_json::Map<String, Value> =
            self.bytes.iter().map(|(name, n)| (name.replace(' ', "_"), (*n).into())).collect();
        json!({
            "command": "run", "source": self.source.name(), "kind": self.source.recording().info().kind,
            "frames": self.frames, "passes_per_frame": self.repeat, "shown_frame": self.shown,
            "width": self.size.0, "height": self.size.1, "has_poses": self.has_poses,
            "up": self.up.json(), "notes": self.notes(),
            "times": times, "work": work, "state_bytes": state,
            "results": self.stats.frames,
            "report": self.report,
        })
    }

    /// The page.
    pub(crate) fn page(&self, drawings: Drawings) -> Page {
        let (w, h) = self.size;
        let info = self.source.recording().info();
        let name = Path::new(self.source.name());
        let title =
            name.file_name().map_or_else(|| self.source.name().to_owned(), |n| n.to_string_lossy().into_owned());
        let frames = if self.frames == 1 {
            "one frame".to_owned()
        } else {
            format!("{} frames, pictures of frame {}", self.frames, self.shown)
        };
        let cards = self
            .answers()
            .into_iter()
            .map(|(name, value, detail)| Card { name: capital(name), value: capital(&value), detail: capital(&detail) })
            .collect();
        let mut figures = drawings.figures;
        let mut bars: Vec<Bar> = STAGES
            .iter()
            .zip(self.stats.spreads())
            .map(|(name, s)| Bar { name: (*name).to_owned(), median: s.median, worst: s.worst })
            .collect();
        let total = self.stats.total();
        bars.push(Bar { name: "all stages".into(), median: total.median, worst: total.worst });
        figures.push(Figure {
            title: "Time".into(),
            drawing: charts::timings(&bars),
            legend: charts::key(&[("var(--accent)", "median"), ("var(--worst)", "worst")]),
            caption: format!(
                "Wall-clock time a stage {}, one core. Reading and decoding the files is not in it: {}.",
                self.times_said(),
                duration(spread(&self.stats.read).median)
            ),
            wide: false,
        });
        let header = ["Stage", "Median", "Worst", "Work done", "Skipped", "Unit"].map(str::to_owned).to_vec();
        let stages = Table {
            title: "Work".into(),
            note: "Skipped: pixels without a reading, or that the depth pyramid answered for (which changes no answer), or \
                   between the samples of the ground plane; points that could not vote; cells the search never came to."
                .into(),
            header,
            rows: self.stage_rows(),
        };
        let total: usize = self.bytes.iter().map(|b| b.1).sum();
        let mut rows: Vec<Vec<String>> = self.bytes.iter().map(|(n, b)| vec![(*n).to_owned(), bytes(*b)]).collect();
        rows.push(vec!["together".into(), bytes(total)]);
        let state = Table {
            title: "State".into(),
            note: format!(
                "The memory that the stages work in, taken once before the first frame, for {w} x {h} pixels and a map of \
                 {MAP_CELLS} x {MAP_CELLS} cells; the input images are not in it. Nothing is allocated inside the core."
            ),
            header: vec!["What".into(), "Bytes".into()],
            rows,
        };
        let mut notes = vec![format!("Up is {}.", self.up.sentence())];
        if !self.has_poses {
            notes.push("There are no poses: the world is the camera frame (x right, y down, z forward).".into());
        }
        notes.extend(self.notes());
        Page {
            title,
            subtitle: format!("{}: {}, {frames}, {w} x {h} pixels", self.source.name(), info.kind),
            cards,
            figures,
            tables: vec![stages, state],
            notes,
        }
    }
}

impl Drawings {
    /// Draws everything there is to see of a frame.
    pub(crate) fn new<D: DepthSample>(
        frame: &DepthFrame<'_, D>,
        found: &Findings,
        pipeline: &Pipeline<'_, D>,
    ) -> Outcome<Self> {
        let (w, h) = frame.size();
        let mut normals = Vec::with_capacity(w * h);
        let mut scratch = vec![0.0; scratch_len(w)];
        rows(frame, &NormalParams::default(), &mut scratch, |_, row| {
            normals.extend(row.x.iter().zip(row.y).zip(row.z).map(|((&x, &y), &z)| [x, y, z]));
        })
        .map_err(|e| Failure::of(&e, "normals"))?;
        let mut figures = vec![scene_figure(frame, found, &normals), depth_figure(frame)];
        if let Some(confidence) = frames::confidence(frame) {
            figures.push(Figure {
                title: "Confidence".into(),
                drawing: Svg::over(&confidence, "confidence").finish(),
                legend: charts::colour_bar(0.0, 100.0, " %", "confidence in percent", |v| {
                    frames::confidence_colour(v / 100.0)
                }),
                caption: "How sure the sensor is of each pixel, as it says itself.".into(),
                wide: false,
            });
        }
        figures.push(normals_figure((w, h), &normals));
        figures.push(rays_figure(frame, found, &normals));
        figures.push(map_figure(frame, found, pipeline));
        Ok(Self { figures })
    }
}

/// Sizes of strokes and letters, for drawings of any size.
fn unit_of((w, _): (usize, usize)) -> f32 {
    w as f32 / 640.0
}

fn scene_figure<D: DepthSample>(frame: &DepthFrame<'_, D>, found: &Findings, normals: &[[f32; 3]]) -> Figure {
    let raster = frames::scene(frame, normals);
    let unit = unit_of(frame.size());
    let mut svg = Svg::over(&raster, "the scene with reticle, chairs and path");
    let pen = Pen::new(frame);
    // Footprints first, so that boxes stand over them.
    let blocked = chairs_of(found, Verdict::Blocked);
    for chair in &blocked {
        pen.footprint(&mut svg, chair, colours::BLOCKED, 1.3 * unit);
    }
    for stool in thinned(found.stools()) {
        pen.cuboid(&mut svg, &stool, colours::ROOM, 1.5 * unit);
    }
    // Far ones first, near ones over them.
    for chair in chairs_of(found, Verdict::Free).iter().rev() {
        pen.cuboid(&mut svg, chair, colours::FREE, 1.7 * unit);
    }
    for tap in &found.taps {
        let at = [tap.pixel.0 as f32, tap.pixel.1 as f32];
        svg.circle(at, 1.8 * unit, "#ffffff", "stroke=\"#10161c\" stroke-width=\"0.8\" opacity=\"0.8\"");
    }
    if let Plan::Found(_) = found.plan {
        let lifted: Vec<Vec3> = found.path.iter().map(|&p| p + found.up * 0.02).collect();
        pen.polyline(&mut svg, &lifted, "#1a1400", 5.0 * unit);
        pen.polyline(&mut svg, &lifted, colours::PATH, 3.0 * unit);
        for (p, name) in [(lifted.first(), "start"), (lifted.last(), "goal")] {
            if let Some(at) = p.and_then(|&p| pen.pixel(p)).filter(|&at| inside(at, frame.size())) {
                svg.circle(at, 4.5 * unit, colours::PATH, "stroke=\"#1a1400\" stroke-width=\"1.2\"");
                svg.label([at[0], at[1] - 9.0 * unit], 13.0 * unit, name, colours::PATH, "middle");
            }
        }
    }
    if let ReticleState::Tracking(pose) | ReticleState::Holding { pose, .. } = found.reticle {
        let normal = pose.orientation * Vec3::Z;
        let size = 0.02 * frame.pose_or_identity().to_camera(pose.position).z;
        let lifted = pose.position + normal * size * 0.1;
        pen.circle(&mut svg, lifted, normal, size * 2.2, colours::CURSOR, 2.2 * unit);
        pen.circle(&mut svg, lifted, normal, size * 0.5, colours::CURSOR, 2.2 * unit);
        pen.line(&mut svg, lifted, lifted + normal * size * 4.0, colours::CURSOR, 2.2 * unit);
        if let (Some(at), Some(hit)) = (pen.pixel(lifted), found.hit()) {
            let at = [at[0] + 22.0 * unit, at[1] - 14.0 * unit];
            svg.label(at, 13.0 * unit, &metres(hit.z), colours::CURSOR, "start");
        }
    }
    Figure {
        title: "What was found".into(),
        drawing: svg.finish(),
        legend: charts::key(&[
            (colours::FREE, "a chair is free"),
            (colours::BLOCKED, "a chair is blocked (footprint)"),
            (colours::ROOM, "a stool fits"),
            ("#ffffff", "taps"),
            (colours::PATH, "path"),
            (colours::CURSOR, "reticle and its normal"),
        ]),
        caption: "Drawn through the frame's own camera; what the real scene hides is dashed. Where a tap meets level \
                  ground, a chair (0.5 x 0.9 x 0.5 m) is judged by the vote of 13 of its points (a fifth hidden blocks); a stool (0.3 x 0.4 x 0.3 m) must \
                  stand level and be wholly in sight. Of overlapping ones the nearest is drawn."
            .into(),
        wide: true,
    }
}

/// Whether a place is on the picture, give or take a few pixels.
fn inside([x, y]: [f32; 2], (w, h): (usize, usize)) -> bool {
    (-4.0..w as f32 + 4.0).contains(&x) && (-4.0..h as f32 + 4.0).contains(&y)
}

fn depth_figure<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Figure {
    let (near, far) = frames::depth_span(frame);
    let step = frames::round_step(far - near, 14.0);
    let raster = frames::depth(frame, (near, far), step);
    Figure {
        title: "Depth".into(),
        drawing: Svg::over(&raster, "false-colour depth").finish(),
        legend: charts::colour_bar(near, far, " m", "depth in metres", |z| colours::depth(z, near, far)),
        caption: format!(
            "z along the camera's axis. Dark lines join points of equal depth, every {} m; dark grey has no reading.",
            short(step)
        ),
        wide: false,
    }
}

/// With a capital first letter.
fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

/// A round number without trailing zeros.
fn short(value: f32) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn normals_figure((w, h): (usize, usize), normals: &[[f32; 3]]) -> Figure {
    let raster = frames::normals(w, h, normals);
    let unit = unit_of((w, h));
    let mut svg = Svg::over(&raster, "surface normals");
    let side = 84.0 * unit;
    let (x, y) = (w as f32 - side - 12.0 * unit, h as f32 - side - 12.0 * unit);
    svg.raw(&format!(
        "<defs><clipPath id=\"ball\"><circle cx=\"{0}\" cy=\"{1}\" r=\"{2}\"/></clipPath></defs><g clip-path=\"url(#ball)\">",
        x + side / 2.0,
        y + side / 2.0,
        side / 2.0
    ));
    svg.picture(&frames::normal_ball(96), x, y, side, side, false);
    svg.raw("</g>");
    svg.circle([x + side / 2.0, y + side / 2.0], side / 2.0, "none", "stroke=\"#ffffff\" stroke-width=\"1.5\"");
    Figure {
        title: "Normals".into(),
        drawing: svg.finish(),
        legend: String::new(),
        caption: "Which way each pixel faces, in the camera frame: x as red, up as green, towards the camera as blue. The ball \
                  shows the colours of all directions."
            .into(),
        wide: false,
    }
}

fn rays_figure<D: DepthSample>(frame: &DepthFrame<'_, D>, found: &Findings, normals: &[[f32; 3]]) -> Figure {
    let raster = frames::scene(frame, normals);
    let unit = unit_of(frame.size());
    let (w, h) = frame.size();
    let mut svg = Svg::over(&raster, "rays from a hand");
    svg.rect(-0.5, -0.5, w as f32, h as f32, "fill=\"#000000\" opacity=\"0.45\"");
    let pen = Pen::new(frame);
    for (ray, outcome) in &found.rays {
        let (end, colour) = match outcome {
            RayOutcome::Hit(hit) => (hit.point, colours::RAY),
            RayOutcome::HitOccluded { point, .. } => (*point, colours::BLOCKED),
            RayOutcome::Miss { .. } | RayOutcome::NoDepth | RayOutcome::OutsideView => (ray.at(8.0), colours::UNKNOWN),
        };
        pen.line(&mut svg, ray.origin(), end, colour, 1.1 * unit);
        if matches!(outcome, RayOutcome::Hit(_) | RayOutcome::HitOccluded { .. })
            && let Some(at) = pen.pixel(end)
        {
            svg.circle(at, 3.6 * unit, colour, "stroke=\"#10060f\" stroke-width=\"1\"");
        }
    }
    let [hits, occluded, missed, no_depth, outside] = ray_counts(found);
    Figure {
        title: "Ray casts".into(),
        drawing: svg.finish(),
        legend: charts::key(&[
            (colours::RAY, &format!("hit ({hits})")),
            (colours::BLOCKED, &format!("went behind a surface ({occluded})")),
            (colours::UNKNOWN, &format!("missed, or unknown ({})", missed + no_depth + outside)),
        ]),
        caption:
            "Rays from a hand 25 cm to the right of and below the camera, each stopped where it first meets the scene. \
                  What a ray does behind a surface the camera cannot know."
                .into(),
        wide: false,
    }
}

fn map_figure<D: DepthSample>(frame: &DepthFrame<'_, D>, found: &Findings, pipeline: &Pipeline<'_, D>) -> Figure {
    let camera = frame.pose_or_identity().translation();
    let map = pipeline.map();
    let mut drawing = MapDrawing::new(map, &[camera], |x, y| pipeline.walkable(x, y));
    // The view's two sides, as far as the map goes.
    let pose = frame.pose_or_identity();
    let k = frame.intrinsics();
    let (w, h) = frame.size();
    let side = |x: f32| {
        let ray = k.ray(isobath::glam::Vec2::new(x, h as f32 / 2.0));
        let along = pose.direction_to_world(ray);
        camera + along * 6.0
    };
    let wedge = [side(-0.5), camera, side(w as f32 - 0.5)];
    drawing.line(&wedge, "#ffffff", 1.2, "stroke-dasharray=\"5 5\" stroke-opacity=\"0.7\"");
    let shapes = thinned(found.stools()).into_iter().map(|b| (b, colours::ROOM));
    let shapes = shapes.chain(chairs_of(found, Verdict::Blocked).into_iter().map(|b| (b, colours::BLOCKED)));
    let shapes = shapes.chain(chairs_of(found, Verdict::Free).into_iter().map(|b| (b, colours::FREE)));
    for (shape, colour) in shapes {
        let c = shape.corners();
        let extra = format!("fill-opacity=\"0.15\" stroke=\"{colour}\" stroke-width=\"2\"");
        drawing.polygon(&[c[0], c[1], c[5], c[4]], colour, &extra);
    }
    if !found.path.is_empty() {
        drawing.line(&found.path, "#1a1400", 7.0, "");
        drawing.line(&found.path, colours::PATH, 4.0, "");
        for (p, name) in [(found.path.first(), "start"), (found.path.last(), "goal")] {
            if let Some(&p) = p {
                drawing.place(p, name, colours::PATH);
            }
        }
    }
    drawing.place(camera, "camera", "#ffffff");
    let from = if pipeline.grounded() {
        "the ground".to_owned()
    } else {
        format!("a level {STANDING} m below the camera, as no ground was seen")
    };
    let bar = charts::colour_bar(0.0, TALL, " m", "height above the ground in metres", height_colour);
    let key = charts::key(&[
        ("#d6ded6", "can be walked on"),
        (&colours::hex(colours::HOLE), "never seen"),
        (colours::FREE, "chair free"),
        (colours::BLOCKED, "chair blocked"),
        (colours::ROOM, "stool"),
        (colours::PATH, "path"),
    ]);
    Figure {
        title: "Height map and path".into(),
        drawing: drawing.svg.finish(),
        legend: format!("{bar}{key}"),
        caption: format!(
            "From above, the camera looking up the page; cells of {:.0} cm, coloured by the highest reading over {from}. The \
             walker keeps {:.0} cm from obstacles and climbs {:.0} cm at most; what was never seen it does not enter.",
            MAP_CELL * 100.0,
            WALKER.radius * 100.0,
            WALKER.max_step * 100.0
        ),
        wide: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median_and_worst() {
        let s = spread(&[5, 1, 3, 100]);
        assert!((s.median - 4.0).abs() < 1e-9 && (s.worst - 100.0).abs() < 1e-9);
        assert!(spread(&[]).worst.abs() < 1e-9);
        assert_eq!(short(0.25), "0.25");
        assert_eq!(short(0.2), "0.2");
    }
}
