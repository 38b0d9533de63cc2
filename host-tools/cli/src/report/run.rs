//! What the main job found: for people in words, for machines as JSON, and as a page of pictures.

use std::path::Path;
use std::time::Duration;

use isobath::ground::geometry::OrientedBox;
use isobath::localized::collision::Verdict;
use isobath::localized::hit::HitOutcome;
use isobath::localized::placement::NoPlace;
use isobath::localized::planner::Plan;
use isobath::localized::raycast::RayOutcome;
use isobath::localized::reticle::ReticleState;
use isobath::skipping::Work;
use serde_json::{Value, json};

use super::charts::{self, Bar};
use super::drawings::Drawings;
use super::{Card, Figure, Page, Table};
use crate::commands::info::extend;
use crate::lighting::{ANCHORS, light_json, light_words};
use crate::pipeline::{CHAIR, Findings, MAP_CELL, MAP_CELLS, STAGES, STOOL, WORK_UNITS};
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
pub(super) fn thinned<'a>(boxes: impl Iterator<Item = &'a OrientedBox>) -> Vec<OrientedBox> {
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
pub(super) fn chairs_of(found: &Findings, verdict: Verdict) -> Vec<OrientedBox> {
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

pub(super) fn ray_counts(found: &Findings) -> [usize; 5] {
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
    let light = match &found.light {
        Ok(lit) => json!({
            "answer": "light", "at_m": lit.map.at.to_array(), "taken": lit.observed.is_some(),
            "near_points": lit.observed.and_then(|o| o.near).map(|n| n.inside), "far_samples": lit.observed.map(|o| o.far.samples),
            "anchors_seen": lit.seen, "near_share": lit.near_share,
            "harmonics": light_json(&lit.harmonics, |d| lit.map.rotation.inverse() * d),
        }),
        Err(why) => json!({ "answer": "none", "why": why }),
    };
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
        "light": light,
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
        out.push(match &f.light {
            Ok(lit) => {
                let (from, strength) = light_words(lit.harmonics.main_light().as_ref());
                let remark = format!(
                    "{strength}; for {}, at {}; {} of {} directions seen from afar, {:.0} % with near points",
                    lit.why,
                    point(lit.map.at),
                    count(lit.seen as u64),
                    count(ANCHORS as u64),
                    100.0 * lit.near_share
                );
                ("light", format!("mainly {from}"), remark)
            }
            Err(why) => ("light", "none".into(), (*why).into()),
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
        let kind = &self.source.info().kind;
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
        let info = self.source.info();
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
            "command": "run", "source": self.source.name(), "kind": self.source.info().kind,
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
        let info = self.source.info();
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
            ..Table::default()
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
            ..Table::default()
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

/// With a capital first letter.
fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median_and_worst() {
        let s = spread(&[5, 1, 3, 100]);
        assert!((s.median - 4.0).abs() < 1e-9 && (s.worst - 100.0).abs() < 1e-9);
        assert!(spread(&[]).worst.abs() < 1e-9);
    }
}
