//! The part of the report about other libraries: a summary for the terminal, everything in `bench-peers.csv`, JSON and the page.

use std::fmt::Write as _;

use isobath_page::{Card, Page, Table};
use serde_json::{Value, json};

use super::terminal::{WIDTH, heading, wrapped};
use super::{Report, number};
use crate::compare::{Against, Comparison, Verdict};
use crate::input::{Sensor, median};
use crate::row::Row;

/// How a line of the terminal's text begins that tells where isobath is beaten; a terminal shows it in red.
pub const LOST: &str = "LOST ";

const NAME: usize = 20;

/// One method over the scenes of a row, sensor and size.
struct Summary {
    /// Medians of the ratios: where isobath makes no error at all, a ratio is infinite.
    time: f64,
    error: f64,
    /// In how many scenes a setting of isobath beats it, it beats all of them, and how many there are.
    beaten: usize,
    beats_all: usize,
    scenes: usize,
}

/// How many comparisons there are, and in how many isobath holds.
pub(super) fn held(comparisons: &[Comparison]) -> (usize, usize) {
    (comparisons.iter().filter(|c| c.held).count(), comparisons.len())
}

fn total(comparisons: &[Comparison]) -> String {
    let (n, of) = held(comparisons);
    format!("{n} of {of} comparisons: isobath has a setting that no peer beats in both time and error.")
}

/// Where isobath is beaten, in words: one line a row, sensor and size.
fn losses(comparisons: &[Comparison]) -> Vec<String> {
    let mut groups: Vec<Vec<&Comparison>> = Vec::new();
    for c in comparisons {
        let key = |c: &Comparison| (c.row.name, c.sensor.label(), c.size);
        match groups.iter_mut().find(|g| key(g[0]) == key(c)) {
            Some(group) => group.push(c),
            None => groups.push(vec![c]),
        }
    }
    let lost = groups.iter().filter(|g| g.iter().any(|c| !c.held));
    lost.map(|group| {
        let (row, sensor, (w, h)) = (group[0].row, group[0].sensor, group[0].size);
        let scenes: Vec<&str> = group.iter().filter(|c| !c.held).map(|c| c.scene).collect();
        let of = match scenes.as_slice() {
            [one] => (*one).to_owned(),
            many => format!("{} of {} scenes", many.len(), group.len()),
        };
        let winners: Vec<String> = names(group)
            .into_iter()
            .filter_map(|name| {
                // Ratios of the scenes where it wins: elsewhere they may be the other way round.
                let wins =
                    |c: &&&Comparison| c.against.iter().any(|a| a.method == name && a.verdict == Verdict::BeatsAll);
                let won: Vec<&Comparison> = group.iter().filter(wins).copied().collect();
                let s = summary(&won, sensor, &name)?;
                Some(format!("{name} (beats all in {}; {} time, {} error)", s.beats_all, times(s.time), times(s.error)))
            })
            .collect();
        let who = if winners.is_empty() { "several peers together".to_owned() } else { winners.join(", ") };
        format!("{}, {}, {w}x{h}, {of}: {who}", row.name, sensor.label())
    })
    .collect()
}

/// `0.85x`, at most six characters.
fn times(ratio: f64) -> String {
    match ratio {
        r if r.is_nan() => "-".to_owned(),
        r if r >= 999.5 => ">999x".to_owned(),
        r if r < 0.01 => "<.01x".to_owned(),
        r => format!("{}x", if r < 9.95 { format!("{r:.2}") } else { number(r) }),
    }
}

/// The rows and sizes compared, in the report's order.
fn tables<'a>(
    report: &Report,
    comparisons: &'a [Comparison],
) -> Vec<(&'static Row, (usize, usize), Vec<&'a Comparison>)> {
    let mut out = Vec::new();
    for row in report.rows() {
        for size in report.sizes() {
            let of: Vec<&Comparison> =
                comparisons.iter().filter(|c| c.row.name == row.name && c.size == size).collect();
            if !of.is_empty() {
                out.push((row, size, of));
            }
        }
    }
    out
}

/// Names of the peers' methods, in the order measured.
fn names(comparisons: &[&Comparison]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for against in comparisons.iter().flat_map(|c| &c.against) {
        if !names.contains(&against.method) {
            names.push(against.method.clone());
        }
    }
    names
}

fn summary(comparisons: &[&Comparison], sensor: Sensor, method: &str) -> Option<Summary> {
    let all: Vec<_> = comparisons
        .iter()
        .filter(|c| c.sensor == sensor)
        .flat_map(|c| &c.against)
        .filter(|a| a.method == method)
        .collect();
    let middle = |of: fn(&Against) -> f64| {
        let mut ratios: Vec<f64> = all.iter().map(|a| of(a)).filter(|r| !r.is_nan()).collect();
        median(&mut ratios)
    };
    (!all.is_empty()).then(|| Summary {
        time: middle(|a| a.time_ratio),
        error: middle(|a| a.error_ratio),
        beaten: all.iter().filter(|a| matches!(a.verdict, Verdict::Beaten(_))).count(),
        beats_all: all.iter().filter(|a| a.verdict == Verdict::BeatsAll).count(),
        scenes: all.len(),
    })
}

pub(super) fn text(report: &Report, out: &mut String) {
    let Some(beside) = &report.peers else { return };
    let comparisons = report.comparisons();
    for (row, size, of) in tables(report, &comparisons) {
        let scenes = report.scenes(row, size).len();
        let scenes = if scenes == 1 { "1 scene".to_owned() } else { format!("{scenes} scenes") };
        heading(&format!("PEERS: {}", row.title), &format!("{}x{}, {scenes}", size.0, size.1), out);
        let mut head = [" ".repeat(NAME), " ".repeat(NAME)];
        for &sensor in row.sensors {
            let _ = write!(head[0], "{:>20}", sensor.label());
            let _ = write!(head[1], "{:>7}{:>7}{:>6}", "time", "error", "lead");
        }
        for line in head {
            let _ = writeln!(out, "{}", line.trim_end());
        }
        for name in names(&of) {
            let mut line = format!("{name:NAME$}");
            for &sensor in row.sensors {
                let _ = match summary(&of, sensor, &name) {
                    None => write!(line, "{:>20}", "-"),
                    Some(s) => {
                        let lead = if s.beats_all > 0 {
                            format!("{}!", s.beats_all)
                        } else {
                            format!("{}/{}", s.beaten, s.scenes)
                        };
                        write!(line, "{:>7}{:>7}{lead:>6}", times(s.time), times(s.error))
                    }
                };
            }
            let _ = writeln!(out, "{}", line.trim_end());
        }
        out.push('\n');
    }
    let mut say = |text: &str| wrapped(text, WIDTH - 2).iter().for_each(|l| _ = writeln!(out, "{l}"));
    if !comparisons.is_empty() {
        say(
            "time, error: the peer's by those of isobath's best setting that no peer beats, median over scenes; above 1x the \
             peer is slower, further off. lead 3/8: in 3 of 8 scenes a setting of isobath beats it in both; 2!: in 2 scenes it \
             beats every setting.",
        );
        say(&total(&comparisons));
    }
    say(&format!(
        "peers: {}",
        if beside.libraries.is_empty() { "none".to_owned() } else { beside.libraries.join(", ") }
    ));
    beside.missing.iter().for_each(|m| say(&format!("not there: {m}")));
    beside.troubles.iter().for_each(|t| say(&format!("trouble: {t}")));
    for loss in losses(&comparisons) {
        // Each printed line must bear the word: it is what makes it red.
        for line in wrapped(&loss, WIDTH - LOST.len() - 2) {
            let _ = writeln!(out, "{LOST}{line}");
        }
    }
    out.push('\n');
}

pub(super) fn page(report: &Report, page: &mut Page) {
    let Some(beside) = &report.peers else { return };
    let comparisons = report.comparisons();
    let (n, of) = held(&comparisons);
    page.cards.push(Card {
        name: "Not beaten by any peer in both time and error".into(),
        value: format!("{n} of {of} comparisons"),
        detail: beside.libraries.join(", "),
    });
    let losses = losses(&comparisons);
    if !losses.is_empty() {
        page.tables.insert(
            0,
            Table {
                title: "Where peers beat every setting of isobath".into(),
                note: "Ratios are the peer's by isobath's: below 1x it is faster, nearer.".into(),
                header: vec!["comparison: peer".into()],
                bad: (0..losses.len()).collect(),
                rows: losses.into_iter().map(|l| vec![l]).collect(),
                ..Table::default()
            },
        );
    }
    for (row, size, of) in tables(report, &comparisons) {
        for &sensor in row.sensors {
            let table = details(row, size, sensor, &of);
            if !table.rows.is_empty() {
                page.tables.push(table);
            }
        }
    }
    page.notes.push(
        "Peers run in processes of their own on the same frames, bound to one core, in turn with isobath's methods; both leave their \
         answers in memory. Times are processor time of what a user of the library calls for every frame."
            .into(),
    );
    page.notes.extend(beside.missing.iter().map(|m| format!("Not there: {m}")));
    page.notes.extend(beside.troubles.iter().map(|t| format!("Trouble: {t}")));
}

/// Every scene and method of a row, size and sensor.
fn details(row: &Row, size: (usize, usize), sensor: Sensor, of: &[&Comparison]) -> Table {
    let mut table = Table {
        title: format!("Peers: {}, {}, {}x{}", row.title, sensor.label(), size.0, size.1),
        note: "Ratios are the peer's by those of the setting of isobath named.".into(),
        header: ["scene: peer's method", "against", "time", "error", "verdict", "marks"].map(String::from).to_vec(),
        folded: true,
        ..Table::default()
    };
    for c in of.iter().filter(|c| c.sensor == sensor) {
        for a in &c.against {
            if a.verdict == Verdict::BeatsAll {
                table.bad.push(table.rows.len());
            }
            table.rows.push(vec![
                format!("{}: {}", c.scene, a.method),
                c.reference.clone(),
                times(a.time_ratio),
                times(a.error_ratio),
                a.verdict.text(),
                a.marks.join(", "),
            ]);
        }
    }
    table
}

pub(super) fn csv(report: &Report) -> Option<String> {
    report.peers.as_ref()?;
    let mut out =
        String::from("row,scene,sensor,width,height,isobath,held,peer,method,time_ratio,error_ratio,verdict,marks\n");
    for c in report.comparisons() {
        for a in &c.against {
            let _ = writeln!(
                out,
                "{},{},{},{},{},\"{}\",{},{},\"{}\",{:.4},{:.4},\"{}\",\"{}\"",
                c.row.name,
                c.scene,
                c.sensor.label(),
                c.size.0,
                c.size.1,
                c.reference,
                c.held,
                a.peer,
                a.method,
                a.time_ratio,
                a.error_ratio,
                a.verdict.text(),
                a.marks.join("; ")
            );
        }
    }
    Some(out)
}

pub(super) fn json(report: &Report) -> Option<Value> {
    let beside = report.peers.as_ref()?;
    let comparisons = report.comparisons();
    let (held, of) = held(&comparisons);
    let all = comparisons.iter().map(|c| {
        let against = c.against.iter().map(|a| {
            json!({
                "method": a.method, "peer": a.peer, "time_ratio": a.time_ratio, "error_ratio": a.error_ratio,
                "verdict": a.verdict.text(), "beats_all": a.verdict == Verdict::BeatsAll, "marks": a.marks,
            })
        });
        json!({
            "row": c.row.name, "scene": c.scene, "sensor": c.sensor.label(), "size": [c.size.0, c.size.1],
            "isobath": c.reference, "held": c.held, "against": against.collect::<Vec<_>>(),
        })
    });
    Some(json!({
        "libraries": beside.libraries, "missing": beside.missing, "troubles": beside.troubles,
        "held": held, "of": of, "comparisons": all.collect::<Vec<_>>(),
    }))
}

#[cfg(test)]
mod tests {
    use super::super::tests::example;
    use super::*;
    use crate::peers::Beside;
    use crate::report::{Result as Found, Time};
    use crate::row::Score;

    /// A peer that is beaten everywhere, and one that wins on the wall with exact depth.
    fn with_peers() -> Report {
        let mut report = example();
        for found in report.results.clone().into_iter().filter(|r| r.method == "cross") {
            let wins = found.scene == "wall" && found.sensor == Sensor::Exact;
            let (time, error) = if wins { (2.0, 0.5) } else { (40.0, 90.0) };
            for (method, time, error) in [("Peer <slow>", 50.0, 100.0), ("Peer quick", time, error)] {
                let time = Time { best: time, median: time };
                let score = Score::of([error, error, 3.0, 0.0, 0.0, error]);
                let (method, peer) = (method.to_owned(), Some("Peer 1.0".to_owned()));
                report.results.push(Found { method, peer, time, score, ..found.clone() });
            }
        }
        report.peers = Some(Beside {
            libraries: vec!["Peer 1.0".into()],
            missing: vec!["pcl: no apt-get here".into()],
            troubles: vec!["Other 2: the worker ended while asked `run x`".into()],
        });
        report
    }

    #[test]
    fn a_peer_that_wins_is_told_in_red() {
        let text = with_peers().text();
        let lost: Vec<&str> = text.lines().filter(|l| l.starts_with(LOST)).collect();
        assert!(!lost.is_empty() && lost.len() <= 2, "one group, perhaps broken: {text}");
        assert!(lost[0].contains("exact depth, 160x120, wall: Peer quick"), "{lost:?}");
        assert!(text.contains("5 of 6 comparisons: isobath has a setting"), "{text}");
        let html = with_peers().html();
        assert!(html.contains("class=\"bad\"") && html.contains("BEATS ALL"), "red on the page");
        assert!(!html.contains("<slow>") && html.contains("<details"));
    }

    #[test]
    fn nothing_is_red_when_nobody_wins() {
        let mut report = with_peers();
        report.results.retain(|r| r.method != "Peer quick");
        assert!(!report.text().contains(LOST) && !report.html().contains("class=\"bad\""));
        assert!(report.text().contains("6 of 6 comparisons"));
    }

    #[test]
    fn the_table_fits_and_tells_who_is_missing() {
        let text = with_peers().text();
        for line in text.lines() {
            assert!(line.chars().count() <= WIDTH, "{line}");
        }
        let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
        for needed in ["not there: pcl: no apt-get here", "trouble: Other 2", "peers: Peer 1.0", "2/2"] {
            assert!(words.contains(needed), "{needed}: {text}");
        }
    }

    #[test]
    fn files_hold_every_comparison() {
        let report = with_peers();
        let csv = csv(&report).unwrap();
        assert_eq!(csv.lines().count(), 1 + 12);
        assert!(csv.contains("\"BEATS ALL\",\"answers 97 %\""), "{csv}");
        let json = &report.json()["peers"];
        assert_eq!((&json["held"], &json["of"]), (&5.into(), &6.into()));
        assert_eq!(json["comparisons"][0]["against"].as_array().unwrap().len(), 2);
    }

    #[test]
    fn without_peers_nothing_is_said_of_them() {
        let report = example();
        assert!(csv(&report).is_none() && report.json().get("peers").is_none());
        assert!(!report.text().contains("peer") && !report.html().contains("peer"));
    }

    #[test]
    fn ratios_are_short() {
        for (ratio, text) in
            [(0.5, "0.50x"), (0.001, "<.01x"), (12.3, "12.3x"), (5e3, ">999x"), (f64::NAN, "-"), (999.0, "999x")]
        {
            assert_eq!(times(ratio), text);
        }
    }
}
