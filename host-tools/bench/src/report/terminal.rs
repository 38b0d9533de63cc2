//! The tables, at most 80 columns wide.

use std::fmt::Write as _;

use super::{Mean, Report, Skip, number};
use crate::input::Sensor;
use crate::row::Row;
use crate::sequence::Kind;

pub(super) const WIDTH: usize = 80;
const NAME: usize = 19;
const NUMBER: usize = 9;

/// Everything.
pub(super) fn text(report: &Report) -> String {
    let mut out = String::new();
    for row in report.rows() {
        for size in report.sizes() {
            comparison(report, row, size, &mut out);
        }
    }
    super::peers::text(report, &mut out);
    skips(report, &mut out);
    if !report.results.is_empty() {
        out.push_str("* on the Pareto front: no other method beats it in both time and error.\n");
    }
    out
}

/// A heading with something at the right end.
pub(super) fn heading(left: &str, right: &str, out: &mut String) {
    let gap = WIDTH.saturating_sub(left.chars().count() + right.chars().count()).max(2);
    let _ = writeln!(out, "{left}{}{right}", " ".repeat(gap));
}

fn comparison(report: &Report, row: &Row, size: (usize, usize), out: &mut String) {
    let scenes = report.scenes(row, size);
    let columns: Vec<(Sensor, Vec<Mean>)> = row
        .sensors
        .iter()
        .map(|&sensor| (sensor, report.means(row, sensor, size, None)))
        .filter(|(_, means)| !means.is_empty())
        .collect();
    let shown: Vec<usize> = (0..row.errors.len()).filter(|&i| row.errors[i].shown).collect();
    let wide = NUMBER * (1 + shown.len()) + 1;
    let at_once = ((WIDTH - NAME) / wide).max(1);
    let of = match scenes.as_slice() {
        [one] => (*one).to_owned(),
        many => format!("mean of {} scenes", many.len()),
    };
    for (i, block) in columns.chunks(at_once).enumerate() {
        if i == 0 {
            heading(
                &format!("{}: {}", row.name.to_uppercase(), row.title),
                &format!("{}x{}, {of}", size.0, size.1),
                out,
            );
        }
        let mut line = " ".repeat(NAME);
        for (sensor, _) in block {
            let _ = write!(line, "{:>w$} ", sensor.label(), w = wide - 1);
        }
        let _ = writeln!(out, "{}", line.trim_end());
        line = " ".repeat(NAME);
        for _ in block {
            let _ = write!(line, "{:>NUMBER$}", format!("ns/{}", row.unit));
            for &e in &shown {
                let _ = write!(line, "{:>NUMBER$}", row.errors[e].unit);
            }
            line.push(' ');
        }
        let _ = writeln!(out, "{}", line.trim_end());
        // A second line of names only where units alone don't tell.
        if shown.len() > 1 {
            line = " ".repeat(NAME);
            for _ in block {
                let _ = write!(line, "{:>NUMBER$}", "");
                for &e in &shown {
                    let _ = write!(line, "{:>NUMBER$}", row.errors[e].name);
                }
                line.push(' ');
            }
            let _ = writeln!(out, "{}", line.trim_end());
        }
        for name in names(block) {
            line = format!("{name:NAME$}");
            for (_, means) in block {
                // Other libraries don't take every sensor's depth.
                let Some(mean) = means.iter().find(|m| m.method == name) else {
                    let _ = write!(line, "{:wide$}", "");
                    continue;
                };
                let _ = write!(line, "{:>NUMBER$}", number(mean.time));
                for &e in &shown {
                    let _ = write!(line, "{:>NUMBER$}", number(mean.errors[e]));
                }
                line.push(if mean.front && means.len() > 1 { '*' } else { ' ' });
            }
            let _ = writeln!(out, "{}", line.trim_end());
        }
    }
    for &e in &shown {
        let measure = row.errors[e];
        for line in wrapped(&format!("{}: {}", measure.name, measure.what), WIDTH - 2) {
            let _ = writeln!(out, "  {line}");
        }
    }
    let ours = columns.iter().flat_map(|(_, means)| means).filter(|m| !m.peer);
    let worst = ours.filter_map(|m| unanswered(row, m)).fold(0.0, f64::max);
    if worst > 0.05 {
        let _ = writeln!(out, "  unanswered: up to {} % of what has a reading", number(worst));
    }
    out.push('\n');
}

/// The methods of several columns, in the order measured.
fn names(columns: &[(Sensor, Vec<Mean>)]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for mean in columns.iter().flat_map(|(_, means)| means) {
        if !names.contains(&mean.method.as_str()) {
            names.push(&mean.method);
        }
    }
    names
}

/// The share without an answer, where a row has one.
fn unanswered(row: &Row, mean: &Mean) -> Option<f64> {
    let i = row.errors.iter().position(|m| m.name == "unanswered" && !m.shown)?;
    mean.errors.get(i).copied()
}

fn skips(report: &Report, out: &mut String) {
    for size in report.sizes() {
        let of_size = report.skips.iter().filter(|s| s.size == size);
        let (mut single, mut sequences): (Vec<_>, Vec<_>) = of_size.partition(|s| s.kind.is_none());
        single.sort_by_key(|s| s.feature);
        sequences.sort_by_key(|s| s.feature);
        let size = format!("{}x{}", size.0, size.1);
        if !single.is_empty() {
            on_single_frames(&single, &size, out);
        }
        if !sequences.is_empty() {
            over_sequences(&sequences, &size, out);
        }
    }
    for note in &report.notes {
        wrapped(note, WIDTH - 2).iter().for_each(|line| _ = writeln!(out, "  {line}"));
    }
}

fn on_single_frames(skips: &[&Skip], size: &str, out: &mut String) {
    heading("SKIPPING on single frames: it changes nothing", size, out);
    let _ = writeln!(
        out,
        "{:20}{:12}{:>8}{:>10}{:>10}{:>9}{:>11}",
        "", "", "skipped", "full ns", "skip ns", "speed-up", "different"
    );
    let mut last = "";
    for s in skips {
        let name = if last == s.feature { "" } else { s.feature };
        last = s.feature;
        let _ = writeln!(
            out,
            "{name:20}{:12}{:>6.1} %{:>10}{:>10}{:>8.2}x{:>11}",
            s.scene,
            100.0 * s.skipped,
            number(s.full.best),
            number(s.skipping.best),
            s.speed_up(),
            format!("{}/{}", s.different, s.queries)
        );
    }
    out.push_str("  skip ns: with the pyramid's build shared by all queries; different: must be 0.\n\n");
}

/// What a row of either table begins with: 34 columns.
fn who(s: &Skip) -> String {
    format!("{:13}{:8}{:13}", s.scene, s.kind.map_or("", Kind::label), s.sensor)
}

fn over_sequences(skips: &[&Skip], size: &str, out: &mut String) {
    let feature = skips.first().map_or("", |s| s.feature);
    heading(&format!("SKIPPING over sequences: {feature}"), size, out);
    let _ = writeln!(
        out,
        "{:34}{:>8}{:>8}{:>8}{:>7}{:>8}{:>7}",
        "", "skipped", "full ns", "skip ns", "map ns", "speed", "differ"
    );
    for s in skips {
        let differ = match 100.0 * s.different as f64 / s.queries.max(1) as f64 {
            _ if s.different == 0 => "0".to_owned(),
            share => format!("{share:.1} %"),
        };
        let _ = writeln!(
            out,
            "{}{:>6.1} %{:>8}{:>8}{:>7}{:>7.2}x{differ:>7}",
            who(s),
            100.0 * s.skipped,
            number(s.full.best),
            number(s.skipping.best),
            s.summary.map_or_else(String::new, |t| number(t.best)),
            s.speed_up(),
        );
    }
    let about = "ns: per pixel of a frame; map ns: of skip ns, the tile map's own update; differ: pixels, must be 0 on exact depth.";
    wrapped(about, WIDTH - 2).iter().for_each(|line| _ = writeln!(out, "  {line}"));
    let slower: Vec<_> = skips.iter().filter(|s| s.speed_up() < 1.0).collect();
    if !slower.is_empty() {
        let text = format!(
            "below 1x in {} of {}: where nearly everything changes, the map costs more than it saves. Compute everything there.",
            slower.len(),
            skips.len()
        );
        wrapped(&text, WIDTH - 2).iter().for_each(|line| _ = writeln!(out, "  {line}"));
    }
    out.push('\n');
    let changed: Vec<_> = skips.iter().filter_map(|s| Some((s, s.change.filter(|_| s.different > 0)?))).collect();
    if changed.is_empty() {
        return;
    }
    let _ = writeln!(out, "{:34}{:>23}{:>23}", "where they differ, degrees", "kept against new", "error against truth");
    let _ = writeln!(out, "{:34}{:>12}{:>11}{:>12}{:>11}", "", "mean", "worst", "full", "skipping");
    for (s, c) in changed {
        let [mean, worst, full, skipping] = [c.mean, c.worst, c.error_full, c.error_skipping].map(number);
        let _ = writeln!(out, "{}{mean:>12}{worst:>11}{full:>12}{skipping:>11}", who(s));
    }
    let about = "Both are estimates from noisy frames of the same surface and differ by the noise of either. What counts is the error \
                 against the truth: a test holds that of skipping to 2 % above. Recordings have no truth.";
    wrapped(about, WIDTH - 2).iter().for_each(|line| _ = writeln!(out, "  {line}"));
    out.push('\n');
}

pub(super) fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().filter(|l| l.is_empty() || l.chars().count() + 1 + word.chars().count() <= width);
        match line {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) => {
                line.push(' ');
                line.push_str(word);
            }
            None => lines.push(format!("  {word}")),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::super::tests::example;
    use super::*;

    #[test]
    fn nothing_is_wider_than_a_terminal() {
        let text = example().text();
        for line in text.lines() {
            assert!(line.chars().count() <= WIDTH, "{line}");
        }
        assert!(text.contains("mean of 2 scenes") && text.contains("0/300"), "{text}");
        for needed in ["0.67x", "below 1x in 1 of 2", "99.0 %", "icl left out", "55.4"] {
            assert!(text.contains(needed), "{needed}: {text}");
        }
        let adaptive = text.lines().find(|l| l.starts_with("adaptive")).unwrap();
        assert_eq!(adaptive.matches('*').count(), 3, "{adaptive}");
    }

    #[test]
    fn every_row_fits() {
        for row in crate::ALL {
            let shown = row.errors.iter().filter(|m| m.shown).count();
            assert!(NAME + NUMBER * (1 + shown) < WIDTH, "{}", row.name);
            assert!(row.unit.len() + 3 < NUMBER, "{}: ns/{} touches its neighbour", row.name, row.unit);
            assert!(row.errors.iter().all(|m| !m.shown || (m.unit.len() < NUMBER && m.name.len() < NUMBER)));
            assert!(
                row.name.len() + row.title.len() + 2 + "640x480, mean of 8 scenes".len() + 2 <= WIDTH,
                "{}",
                row.name
            );
        }
    }
}
