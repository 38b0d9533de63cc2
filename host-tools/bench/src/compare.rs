//! isobath against its peers, comparison by comparison: one row, sensor, size and scene each.
//!
//! A method *beats* another when it is at least as good in time and in error (the row's first), and better in one; differences of
//! less than [`SAME_ERROR`] and [`SAME_TIME`] are none, in favour of nobody. isobath *holds* when one of its settings is beaten by no
//! peer. The setting that ratios refer to is, of those not beaten, the one with the smallest product of time and error: it
//! favours neither the fast nor the exact end.

use crate::input::Sensor;
use crate::report::Result as Found;
use crate::row::Row;

/// Errors that differ by less than this part are the same.
pub const SAME_ERROR: f64 = 0.01;
/// Times that differ by less than this part are the same: what the best of several rounds wavers by.
pub const SAME_TIME: f64 = 0.05;
/// Who answers less than this part of the readings, percent, is marked.
pub const ANSWERED: f64 = 98.0;
/// Who invents normals, or faces away, in more than this part of the pixels, percent, is marked.
const MARKED: f64 = 0.1;

/// One row, sensor, size and scene.
#[derive(Debug, Clone)]
pub struct Comparison {
    /// The capability.
    pub row: &'static Row,
    /// Scene.
    pub scene: &'static str,
    /// Sensor.
    pub sensor: Sensor,
    /// Columns and rows.
    pub size: (usize, usize),
    /// isobath's setting that the ratios refer to.
    pub reference: String,
    /// A setting of isobath is beaten by no peer.
    pub held: bool,
    /// Every method of every peer.
    pub against: Vec<Against>,
}

/// One method of a peer.
#[derive(Debug, Clone, PartialEq)]
pub struct Against {
    /// Its name.
    pub method: String,
    /// The library and its version.
    pub peer: String,
    /// Its time by the reference's: above 1 it is slower.
    pub time_ratio: f64,
    /// Its error by the reference's: above 1 it is further off.
    pub error_ratio: f64,
    /// Who beats whom.
    pub verdict: Verdict,
    /// What else to know of its answer.
    pub marks: Vec<String>,
}

/// Who beats whom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verdict {
    /// This setting of isobath beats it.
    Beaten(String),
    /// Neither: it beats no setting, none beats it.
    Trade,
    /// It beats some settings of isobath, not all.
    BeatsSome(usize),
    /// It beats every setting of isobath.
    BeatsAll,
    /// It answered nothing.
    NoAnswer,
}

impl Verdict {
    /// In a few words.
    #[must_use]
    pub fn text(&self) -> String {
        match self {
            Self::Beaten(by) => format!("beaten by {by}"),
            Self::Trade => "neither".to_owned(),
            Self::BeatsSome(1) => "beats one setting".to_owned(),
            Self::BeatsSome(n) => format!("beats {n} settings"),
            Self::BeatsAll => "BEATS ALL".to_owned(),
            Self::NoAnswer => "no answer".to_owned(),
        }
    }
}

/// One method as it counts here.
#[derive(Debug, Clone, Copy)]
struct Point {
    time: f64,
    error: f64,
}

impl Point {
    fn of(found: &Found) -> Self {
        Self { time: found.time.best, error: found.score.errors.first().copied().unwrap_or(f64::NAN) }
    }

    fn beats(self, other: Self) -> bool {
        let less = |a: f64, b: f64, same: f64| a < b * (1.0 - same);
        let more = |a: f64, b: f64, same: f64| a * (1.0 - same) > b;
        let worse = more(self.time, other.time, SAME_TIME) || more(self.error, other.error, SAME_ERROR);
        let better = less(self.time, other.time, SAME_TIME) || less(self.error, other.error, SAME_ERROR);
        // NaN is neither better nor worse than anything: it beats nobody.
        self.is_one() && (!other.is_one() || (!worse && better))
    }

    fn is_one(self) -> bool {
        !self.time.is_nan() && !self.error.is_nan()
    }
}

/// Every comparison with a peer in it, in the order measured.
pub(crate) fn all(results: &[Found]) -> Vec<Comparison> {
    let mut out: Vec<Comparison> = Vec::new();
    for found in results.iter().filter(|r| r.peer.is_some()) {
        let same = |c: &&Comparison| {
            c.row.name == found.row.name && c.scene == found.scene && c.sensor == found.sensor && c.size == found.size
        };
        if out.iter().find(same).is_none() {
            let of = |r: &&Found| {
                r.row.name == found.row.name
                    && r.scene == found.scene
                    && r.sensor == found.sensor
                    && r.size == found.size
            };
            let group: Vec<&Found> = results.iter().filter(of).collect();
            out.extend(one(&group));
        }
    }
    out
}

/// One comparison of everything measured on it; `None` without a setting of isobath that answered.
fn one(group: &[&Found]) -> Option<Comparison> {
    let (peers, ours): (Vec<&Found>, Vec<&Found>) = group.iter().partition(|r| r.peer.is_some());
    let ours: Vec<&Found> = ours.into_iter().filter(|r| Point::of(r).is_one()).collect();
    let unbeaten = |r: &&&Found| !peers.iter().any(|p| Point::of(p).beats(Point::of(r)));
    let cost = |r: &Found| r.time.best * Point::of(r).error;
    // Where errors are exactly 0, the faster.
    let order = |a: &&&Found, b: &&&Found| cost(a).total_cmp(&cost(b)).then(a.time.best.total_cmp(&b.time.best));
    let best = ours.iter().filter(unbeaten).min_by(order);
    let reference = best.or_else(|| ours.iter().min_by(order))?;
    let base = Point::of(reference);
    let against = peers.iter().map(|p| Against {
        method: p.method.clone(),
        peer: p.peer.clone().unwrap_or_default(),
        time_ratio: ratio(p.time.best, base.time),
        error_ratio: ratio(Point::of(p).error, base.error),
        verdict: verdict(p, &ours),
        marks: marks(p, &ours),
    });
    Some(Comparison {
        row: reference.row,
        scene: reference.scene,
        sensor: reference.sensor,
        size: reference.size,
        reference: reference.method.clone(),
        held: best.is_some(),
        against: against.collect(),
    })
}

fn verdict(peer: &Found, ours: &[&Found]) -> Verdict {
    let p = Point::of(peer);
    if !p.is_one() {
        return Verdict::NoAnswer;
    }
    let beats = ours.iter().filter(|r| p.beats(Point::of(r))).count();
    if beats == ours.len() {
        return Verdict::BeatsAll;
    }
    // Of several that beat it, the one that gains most.
    let gain = |r: &&&Found| Point::of(r).time * Point::of(r).error;
    let by = ours.iter().filter(|r| Point::of(r).beats(p)).min_by(|a, b| gain(a).total_cmp(&gain(b)));
    match by {
        Some(by) => Verdict::Beaten(by.method.clone()),
        None if beats > 0 => Verdict::BeatsSome(beats),
        None => Verdict::Trade,
    }
}

/// What is wrong with a peer's answer beside its first error.
fn marks(peer: &Found, ours: &[&Found]) -> Vec<String> {
    let value = |name: &str| {
        let i = peer.row.errors.iter().position(|m| m.name == name)?;
        peer.score.errors.get(i).copied().filter(|v| !v.is_nan())
    };
    let mut marks = Vec::new();
    if let Some(unanswered) = value("unanswered").filter(|&u| u > 100.0 - ANSWERED) {
        marks.push(format!("answers {:.0} %", 100.0 - unanswered));
    }
    if let Some(invented) = value("invented").filter(|&v| v > MARKED) {
        marks.push(format!("invents {invented:.1} %"));
    }
    if let Some(away) = value("away").filter(|&v| v > MARKED) {
        marks.push(format!("{away:.1} % away"));
    }
    // Whoever has the opposite sign by convention loses as it stands: said when its turned answer would not.
    if let Some(error) = value("turned") {
        let turned = Point { time: peer.time.best, error };
        let as_it_stands = ours.iter().all(|r| Point::of(peer).beats(Point::of(r)));
        if !as_it_stands && !ours.is_empty() && ours.iter().all(|r| turned.beats(Point::of(r))) {
            marks.push("beats all once turned".to_owned());
        }
    }
    marks
}

/// A ratio; 1 of two zeros.
fn ratio(a: f64, b: f64) -> f64 {
    if a == b { 1.0 } else { a / b }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Time;
    use crate::row::Score;

    fn found(method: &str, peer: bool, time: f64, error: f64) -> Found {
        Found {
            row: &crate::ALL[0],
            scene: "wall",
            sensor: Sensor::Exact,
            size: (160, 120),
            method: method.into(),
            peer: peer.then(|| "Peer 1".into()),
            time: Time { best: time, median: time },
            score: Score::of([error, error, 0.0, 0.0, 0.0, error]),
        }
    }

    fn compare(peers: &[(f64, f64)]) -> Comparison {
        let mut results = vec![found("fast", false, 4.0, 8.0), found("exact", false, 20.0, 1.0)];
        results.extend(peers.iter().map(|&(t, e)| found("theirs", true, t, e)));
        all(&results).remove(0)
    }

    #[test]
    fn a_peer_that_beats_every_setting_wins() {
        let c = compare(&[(3.0, 0.5), (9.0, 9.0)]);
        assert!(!c.held);
        assert_eq!(c.against[0].verdict, Verdict::BeatsAll);
        assert_eq!(c.against[1].verdict, Verdict::Beaten("fast".into()));
    }

    #[test]
    fn peers_can_win_together() {
        let c = compare(&[(3.0, 7.0), (19.0, 0.5)]);
        assert!(!c.held, "each setting is beaten by another peer");
        assert!(c.against.iter().all(|a| a.verdict == Verdict::BeatsSome(1)));
    }

    #[test]
    fn one_setting_that_nobody_beats_is_enough() {
        let c = compare(&[(3.0, 2.0)]);
        assert!(c.held);
        assert_eq!((c.reference.as_str(), &c.against[0].verdict), ("exact", &Verdict::BeatsSome(1)));
        assert_eq!((c.against[0].time_ratio, c.against[0].error_ratio), (0.15, 2.0));
    }

    #[test]
    fn neither_beats_the_other() {
        assert_eq!(compare(&[(10.0, 4.0)]).against[0].verdict, Verdict::Trade);
    }

    #[test]
    fn differences_within_the_noise_are_none() {
        let c = compare(&[(3.95, 8.0), (20.0, 0.995)]);
        assert!(c.held && c.against.iter().all(|a| a.verdict == Verdict::Trade), "{c:?}");
        // Equal errors and a clearly shorter time do beat.
        let c = compare(&[(3.0, 8.0), (15.0, 1.0)]);
        assert!(!c.held);
    }

    #[test]
    fn who_answers_nothing_beats_nobody() {
        let c = compare(&[(3.0, f64::NAN)]);
        assert!(c.held);
        assert_eq!(c.against[0].verdict, Verdict::NoAnswer);
    }

    #[test]
    fn the_reference_is_the_best_product_of_those_unbeaten() {
        assert_eq!(compare(&[(50.0, 9.0)]).reference, "exact");
        assert_eq!(compare(&[(15.0, 0.9)]).reference, "fast", "the other one is beaten");
    }

    #[test]
    fn marks_say_what_the_error_does_not() {
        let mut peer = found("theirs", true, 3.0, 179.0);
        peer.score = Score::of([179.0, 179.0, 4.0, 2.0, 100.0, 0.5]);
        let results = [found("ours", false, 4.0, 1.0), peer];
        let c = all(&results).remove(0);
        assert!(c.held);
        assert_eq!(c.against[0].marks, ["answers 96 %", "invents 2.0 %", "100.0 % away", "beats all once turned"]);
    }

    #[test]
    fn without_peers_there_is_nothing_to_compare() {
        assert!(all(&[found("ours", false, 1.0, 1.0)]).is_empty());
    }
}
