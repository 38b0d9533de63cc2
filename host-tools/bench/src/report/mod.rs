//! What came out, and its forms: a terminal's table ([`Report::text`]), CSV, JSON, and a page with plots.

mod html;
mod peers;
mod plot;
mod terminal;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::BenchError;
use crate::compare::{self, Comparison};
use crate::input::Sensor;
use crate::pareto::front;
use crate::peers::Beside;
use crate::row::{Row, Score};
use crate::sequence::Kind;

pub use peers::LOST;

/// Nanoseconds per unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Time {
    /// Of the best round: without disturbance.
    pub best: f64,
    /// Of the round in the middle.
    pub median: f64,
}

impl Time {
    /// From one number a round.
    pub(crate) fn of(rounds: &mut [f64]) -> Self {
        rounds.sort_by(f64::total_cmp);
        let at = |i: usize| rounds.get(i).copied().unwrap_or(f64::NAN);
        Self { best: at(0), median: at(rounds.len() / 2) }
    }
}

/// One method on one input.
#[derive(Debug, Clone)]
pub struct Result {
    /// The capability.
    pub row: &'static Row,
    /// Scene.
    pub scene: &'static str,
    /// Sensor.
    pub sensor: Sensor,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Method with its knobs.
    pub method: String,
    /// The other library whose method it is, with its version; `None` for isobath.
    pub peer: Option<String>,
    /// What it took.
    pub time: Time,
    /// How wrong it was.
    pub score: Score,
}

/// A feature with and without skipping, on one input.
#[derive(Debug, Clone, PartialEq)]
pub struct Skip {
    /// The feature and what it skips by.
    pub feature: &'static str,
    /// Scene or recording.
    pub scene: String,
    /// How much changes from frame to frame; `None` where one frame was asked.
    pub kind: Option<Kind>,
    /// What it was seen with, in a word or two.
    pub sensor: &'static str,
    /// Columns and rows.
    pub size: (usize, usize),
    /// What one answer is about; times are per this.
    pub unit: &'static str,
    /// Share of the full form's work that was skipped, 0 to 1.
    pub skipped: f64,
    /// Nanoseconds an answer without skipping.
    pub full: Time,
    /// And with it, the summary (pyramid, tile map) included.
    pub skipping: Time,
    /// Of which the summary, where it was timed by itself.
    pub summary: Option<Time>,
    /// Answers asked for.
    pub queries: usize,
    /// Answers that were not the same to the last bit.
    pub different: usize,
    /// Whether `different` must be 0. Where it need not, noise is in play, and [`Self::change`] says what it did.
    pub exact: bool,
    /// What answers that were kept from earlier frames are worth.
    pub change: Option<Change>,
}

/// Normals kept from earlier frames against normals computed anew, degrees; NaN where there are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Mean angle between the two, over what was kept.
    pub mean: f64,
    /// The largest.
    pub worst: f64,
    /// Mean angle to the truth, everything computed, over all pixels.
    pub error_full: f64,
    /// The same with skipping.
    pub error_skipping: f64,
}

impl Default for Change {
    fn default() -> Self {
        Self { mean: f64::NAN, worst: f64::NAN, error_full: f64::NAN, error_skipping: f64::NAN }
    }
}

impl Skip {
    /// How many times as fast skipping is.
    #[must_use]
    pub fn speed_up(&self) -> f64 {
        self.full.best / self.skipping.best
    }
}

/// Everything measured.
#[derive(Debug, Clone)]
pub struct Report {
    /// Of noise and questions.
    pub seed: u64,
    /// Whether it was the short form.
    pub quick: bool,
    /// Methods on inputs, in the order measured.
    pub results: Vec<Result>,
    /// Features that skip.
    pub skips: Vec<Skip>,
    /// Other libraries, when they were asked.
    pub peers: Option<Beside>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

/// A method's mean over scenes.
#[derive(Debug, Clone, PartialEq)]
pub struct Mean {
    /// Method with its knobs.
    pub method: String,
    /// Nanoseconds per unit: the mean of the scenes' best.
    pub time: f64,
    /// Mean of each error over the scenes where it is a number.
    pub errors: Vec<f64>,
    /// No other method beats it in both time and (the first) error.
    pub front: bool,
    /// It is another library's.
    pub peer: bool,
}

impl Report {
    /// Rows that have results, in the order measured.
    #[must_use]
    pub fn rows(&self) -> Vec<&'static Row> {
        let mut rows: Vec<&'static Row> = Vec::new();
        for result in &self.results {
            if !rows.iter().any(|r| r.name == result.row.name) {
                rows.push(result.row);
            }
        }
        let place = |row: &Row| crate::ALL.iter().position(|r| r.name == row.name);
        rows.sort_by_key(|r| place(r));
        rows
    }

    /// Sizes measured, in order.
    #[must_use]
    pub fn sizes(&self) -> Vec<(usize, usize)> {
        let mut sizes: Vec<(usize, usize)> =
            self.results.iter().map(|r| r.size).chain(self.skips.iter().map(|s| s.size)).collect();
        sizes.sort_unstable();
        sizes.dedup();
        sizes
    }

    /// Scenes of one comparison.
    #[must_use]
    pub fn scenes(&self, row: &Row, size: (usize, usize)) -> Vec<&'static str> {
        let mut scenes: Vec<&'static str> = Vec::new();
        for r in self.results.iter().filter(|r| r.row.name == row.name && r.size == size) {
            if !scenes.contains(&r.scene) {
                scenes.push(r.scene);
            }
        }
        scenes
    }

    /// Methods of one comparison, each the mean over its scenes (or one scene alone), with the Pareto front.
    #[must_use]
    pub fn means(&self, row: &Row, sensor: Sensor, size: (usize, usize), scene: Option<&str>) -> Vec<Mean> {
        let chosen = || {
            self.results.iter().filter(move |r| {
                r.row.name == row.name && r.sensor == sensor && r.size == size && scene.is_none_or(|s| s == r.scene)
            })
        };
        let mut means: Vec<Mean> = Vec::new();
        for result in chosen() {
            if means.iter().any(|m| m.method == result.method) {
                continue;
            }
            let same = || chosen().filter(|r| r.method == result.method);
            let time = mean(same().map(|r| r.time.best));
            let errors = (0..row.errors.len()).map(|i| mean(same().filter_map(|r| r.score.errors.get(i).copied())));
            means.push(Mean {
                method: result.method.clone(),
                time,
                errors: errors.collect(),
                front: false,
                peer: result.peer.is_some(),
            });
        }
        let points: Vec<(f64, f64)> =
            means.iter().map(|m| (m.time, m.errors.first().copied().unwrap_or(f64::NAN))).collect();
        for (mean, on) in means.iter_mut().zip(front(&points)) {
            mean.front = on;
        }
        means
    }

    /// isobath against other libraries, one row, sensor, size and scene each.
    #[must_use]
    pub fn comparisons(&self) -> Vec<Comparison> {
        compare::all(&self.results)
    }

    /// For a terminal of 80 columns. Lines that begin with [`LOST`] are the ones to show in red.
    #[must_use]
    pub fn text(&self) -> String {
        terminal::text(self)
    }

    /// A page that needs nothing else.
    #[must_use]
    pub fn html(&self) -> String {
        html::page(self).html()
    }

    /// One line a method, input and error.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut out =
            String::from("row,scene,sensor,width,height,method,unit,best_ns,median_ns,error,error_unit,value\n");
        for r in &self.results {
            let Result { row, scene, sensor, size: (w, h), method, time, score, .. } = r;
            for (measure, value) in row.errors.iter().zip(&score.errors) {
                let _ = writeln!(
                    out,
                    "{},{scene},{},{w},{h},\"{method}\",{},{:.3},{:.3},{},{},{value}",
                    row.name,
                    sensor.label(),
                    row.unit,
                    time.best,
                    time.median,
                    measure.name,
                    measure.unit,
                );
            }
        }
        for s in &self.skips {
            let scene = s.kind.map_or_else(|| s.scene.clone(), |kind| format!("{} {}", s.scene, kind.label()));
            let mut lines = vec![("skipped", "share", s.skipped), ("different", "answers", s.different as f64)];
            if let Some(c) = &s.change {
                let degrees = |name, value| (name, "degrees", value);
                lines.push(degrees("kept against new mean", c.mean));
                lines.push(degrees("kept against new worst", c.worst));
                lines.push(degrees("error full", c.error_full));
                lines.push(degrees("error skipping", c.error_skipping));
            }
            let summary = s.summary.map(|time| ("summary", time));
            for (name, unit, value) in lines {
                for (method, time) in [("full", s.full), ("skipping", s.skipping)].into_iter().chain(summary) {
                    let _ = writeln!(
                        out,
                        "skipping,{scene},{},{},{},\"{}: {method}\",{},{:.3},{:.3},{name},{unit},{value}",
                        s.sensor, s.size.0, s.size.1, s.feature, s.unit, time.best, time.median
                    );
                }
            }
        }
        out
    }

    /// For machines; numbers that are not finite are null.
    #[must_use]
    pub fn json(&self) -> Value {
        let results = self.results.iter().map(|r| {
            let errors: serde_json::Map<String, Value> =
                r.row.errors.iter().zip(&r.score.errors).map(|(m, v)| (key(m.name, m.unit), json!(v))).collect();
            json!({
                "row": r.row.name, "scene": r.scene, "sensor": r.sensor.label(), "size": [r.size.0, r.size.1],
                "method": r.method, "unit": r.row.unit, "best_ns": r.time.best, "median_ns": r.time.median,
                "errors": errors, "peer": r.peer,
            })
        });
        let skips = self.skips.iter().map(|s| {
            json!({
                "feature": s.feature, "scene": s.scene, "kind": s.kind.map(Kind::label), "sensor": s.sensor,
                "size": [s.size.0, s.size.1], "unit": s.unit, "skipped": s.skipped,
                "full_ns": s.full.best, "skipping_ns": s.skipping.best, "summary_ns": s.summary.map(|t| t.best),
                "speed_up": s.speed_up(), "queries": s.queries, "different": s.different, "exact": s.exact,
                "kept_mean_degrees": s.change.map(|c| c.mean), "kept_worst_degrees": s.change.map(|c| c.worst),
                "error_full_degrees": s.change.map(|c| c.error_full),
                "error_skipping_degrees": s.change.map(|c| c.error_skipping),
            })
        });
        let mut all = json!({
            "seed": self.seed, "quick": self.quick, "version": env!("CARGO_PKG_VERSION"), "machine": machine(),
            "results": results.collect::<Vec<_>>(), "skipping": skips.collect::<Vec<_>>(),
            "notes": self.notes,
        });
        if let Some(peers) = peers::json(self) {
            all["peers"] = peers;
        }
        all
    }

    /// Writes `bench.csv`, `bench.json` and `bench.html` to a folder, which is made when there is none, and `bench-peers.csv` when
    /// other libraries were asked. Returns their paths.
    ///
    /// # Errors
    /// [`BenchError::Write`].
    pub fn write(&self, folder: &Path) -> std::result::Result<Vec<PathBuf>, BenchError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |error| BenchError::Write { path, error }
        };
        std::fs::create_dir_all(folder).map_err(failed(folder))?;
        let files =
            [("bench.html", self.html()), ("bench.csv", self.csv()), ("bench.json", format!("{:#}\n", self.json()))];
        let mut written = Vec::new();
        let peers = peers::csv(self).map(|text| ("bench-peers.csv", text));
        for (name, text) in files.into_iter().chain(peers) {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(failed(&path))?;
            written.push(path);
        }
        Ok(written)
    }
}

/// A measure's name and unit as one word of JSON.
fn key(name: &str, unit: &str) -> String {
    let unit = if unit == "%" { "percent" } else { unit };
    format!("{name}_{unit}").replace(' ', "_")
}

/// Mean of what is a number; NaN of nothing.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.filter(|v| !v.is_nan()).fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / n
}

/// The processor's name where the system tells, and the architecture.
#[must_use]
pub fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find(|l| l.starts_with("model name")).and_then(|l| l.split_once(':'));
    match name {
        Some((_, name)) => format!("{}, {}", name.trim(), std::env::consts::ARCH),
        None => std::env::consts::ARCH.to_owned(),
    }
}

/// Three digits that matter, in at most seven characters.
pub(crate) fn number(value: f64) -> String {
    if value.is_nan() {
        return "-".to_owned();
    }
    let size = value.abs();
    match size {
        0.0 => "0".to_owned(),
        _ if size < 0.0005 => format!("{value:.0e}"),
        _ if size < 0.0995 => format!("{value:.4}"),
        _ if size < 0.995 => format!("{value:.3}"),
        _ if size < 9.95 => format!("{value:.2}"),
        _ if size < 99.5 => format!("{value:.1}"),
        _ if size < 999_999.5 => format!("{value:.0}"),
        _ => format!("{value:.1e}"),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Three methods on two scenes; the third is beaten.
    pub(crate) fn example() -> Report {
        let row = &crate::ALL[0];
        let mut results = Vec::new();
        for (scene, harder) in [("wall", 1.0), ("desk", 3.0)] {
            for &sensor in row.sensors {
                for (method, time, error) in [("cross", 5.0, 30.0), ("adaptive", 8.0, 2.0), ("<slow>", 9.0, 31.0)] {
                    let time = Time { best: time, median: time * 1.1 };
                    let score = Score::of([error * harder, error, 0.0]);
                    let method = method.to_owned();
                    results.push(Result { row, scene, sensor, size: (160, 120), method, peer: None, time, score });
                }
            }
        }
        let time = |best| Time { best, median: best };
        let one = Skip {
            feature: "ray cast, pyramid",
            scene: "wall".into(),
            kind: None,
            sensor: "1 mm steps",
            size: (160, 120),
            unit: "query",
            skipped: 0.97,
            full: time(2000.0),
            skipping: time(700.0),
            summary: None,
            queries: 300,
            different: 0,
            exact: true,
            change: None,
        };
        let still = Skip {
            feature: "dense normals, tiles",
            scene: "living-room".into(),
            kind: Some(Kind::Static),
            sensor: "Kinect noise",
            unit: "pixel",
            full: time(5.0),
            skipping: time(2.5),
            summary: Some(time(2.0)),
            queries: 19_200,
            different: 19_000,
            exact: false,
            change: Some(Change { mean: 40.1, worst: 179.2, error_full: 55.5, error_skipping: 55.4 }),
            ..one.clone()
        };
        let full = Skip { kind: Some(Kind::Full), skipping: time(7.5), skipped: 0.0, ..still.clone() };
        let notes = vec!["icl left out: no folder".into()];
        Report { seed: 1, quick: true, results, skips: vec![one, still, full], notes, peers: None }
    }

    #[test]
    fn means_are_over_scenes_and_know_the_front() {
        let report = example();
        let means = report.means(report.rows()[0], Sensor::Kinect, (160, 120), None);
        assert_eq!(means.iter().map(|m| m.front).collect::<Vec<_>>(), [true, true, false]);
        assert_eq!((means[0].errors[0], means[0].time), (60.0, 5.0));
        let alone = report.means(report.rows()[0], Sensor::Kinect, (160, 120), Some("wall"));
        assert_eq!(alone[0].errors[0], 30.0);
    }

    #[test]
    fn files_hold_everything() {
        let report = example();
        let csv = report.csv();
        assert_eq!(csv.lines().count(), 1 + 2 * 3 * 3 * 3 + 4 + 2 * 6 * 3);
        let columns = csv.lines().next().unwrap().split(',').count();
        assert!(csv.lines().filter(|l| !l.starts_with("skipping")).all(|l| l.split(',').count() == columns));
        let json = report.json();
        assert_eq!(json["results"].as_array().unwrap().len(), 18);
        assert_eq!(json["results"][0]["errors"]["mean_degrees"], 30.0);
        assert_eq!(json["skipping"][0]["different"], 0);
        assert_eq!(json["skipping"][0]["kept_mean_degrees"], Value::Null);
        assert_eq!(json["skipping"][1]["kind"], "static");
        assert_eq!(json["skipping"][1]["error_skipping_degrees"], 55.4);
    }

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (1.234_5e-5, "1e-5"),
            (0.012_345, "0.0123"),
            (0.123_45, "0.123"),
            (1.234_5, "1.23"),
            (12.345, "12.3"),
            (99.96, "100"),
            (1234.5, "1234"),
            (f64::NAN, "-"),
            (-3.21, "-3.21"),
            (1.0e7, "1.0e7"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
