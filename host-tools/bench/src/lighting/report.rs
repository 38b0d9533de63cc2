//! What came out, and its forms: tables for a terminal of 80 columns, CSV, JSON, a page with plots.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use isobath_page::{Card, Figure, Page};
use serde_json::{Value, json};

use super::chart;
use crate::BenchError;
use crate::report::{LOST, machine, number};

/// One column of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// For machines, with its unit.
    pub key: &'static str,
    /// For people.
    pub head: &'static str,
    /// Of its numbers.
    pub unit: &'static str,
    /// Whether the terminal has room for it.
    pub shown: bool,
}

/// One line of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// What it is about.
    pub name: String,
    /// A number a column; NaN where there is none.
    pub cells: Vec<f64>,
    /// Whether it says that something is worse than what it is set against.
    pub lost: bool,
}

impl Line {
    /// Nothing lost.
    pub(super) fn new(name: &str, cells: Vec<f64>) -> Self {
        Self { name: name.to_owned(), cells, lost: false }
    }
}

/// How a table is drawn: which columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plot {
    /// Not at all.
    None,
    /// A group of bars a line.
    Bars(&'static [usize]),
    /// A line a column.
    Lines(&'static [usize]),
}

/// One comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// For machines.
    pub key: &'static str,
    /// For people.
    pub title: String,
    /// How it came about.
    pub note: String,
    /// In order.
    pub columns: &'static [Column],
    /// In order.
    pub lines: Vec<Line>,
    /// On the page.
    pub plot: Plot,
}

/// Everything measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Whether it was the short form.
    pub quick: bool,
    /// Of drift and random colours.
    pub seed: u64,
    /// In order.
    pub tables: Vec<Table>,
    /// What was left out.
    pub notes: Vec<String>,
}

const WIDTH: usize = 80;
const NUMBER: usize = 8;

impl Report {
    /// For a terminal of 80 columns. Lines that begin with [`LOST`] are the ones to show in red.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = String::new();
        for table in &self.tables {
            let shown: Vec<usize> = (0..table.columns.len()).filter(|i| table.columns[*i].shown).collect();
            let room = WIDTH - NUMBER * shown.len();
            let longest =
                table.lines.iter().map(|l| l.name.chars().count() + if l.lost { LOST.len() } else { 0 }).max();
            let name = longest.unwrap_or(0).clamp(14, room.max(15) - 1) + 1;
            let _ = writeln!(out, "{}", table.title);
            for part in [|c: &Column| c.head, |c: &Column| c.unit] {
                let mut line = " ".repeat(name);
                for i in &shown {
                    let _ = write!(line, "{:>NUMBER$}", part(&table.columns[*i]));
                }
                let _ = writeln!(out, "{}", line.trim_end());
            }
            for line in &table.lines {
                let said = if line.lost { format!("{LOST}{}", line.name) } else { line.name.clone() };
                let mut text: String = format!("{said:<name$}").chars().take(name).collect();
                for i in &shown {
                    let value = line.cells.get(*i).copied().unwrap_or(f64::NAN);
                    let _ = write!(text, "{:>NUMBER$}", number(value));
                }
                let _ = writeln!(out, "{}", text.trim_end());
            }
            for line in wrapped(&table.note, WIDTH - 2) {
                let _ = writeln!(out, "  {line}");
            }
            let lost: Vec<&str> = table.lines.iter().filter(|l| l.lost).map(|l| l.name.as_str()).collect();
            if !lost.is_empty() {
                for line in wrapped(&format!("below the capture somewhere: {}", lost.join(", ")), WIDTH - 2) {
                    let _ = writeln!(out, "  {line}");
                }
            }
            out.push('\n');
        }
        for note in &self.notes {
            let _ = writeln!(out, "{note}");
        }
        out
    }

    /// One line a number.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut out = String::from("table,row,column,unit,value\n");
        for table in &self.tables {
            for line in &table.lines {
                for (column, value) in table.columns.iter().zip(&line.cells) {
                    let _ = writeln!(out, "{},\"{}\",{},{},{value}", table.key, line.name, column.key, column.unit);
                }
            }
        }
        out
    }

    /// For machines; numbers that are not finite are null.
    #[must_use]
    pub fn json(&self) -> Value {
        let table = |table: &Table| {
            let lines = table.lines.iter().map(|line| {
                let cells: serde_json::Map<String, Value> = (table.columns.iter().zip(&line.cells))
                    .map(|(c, v)| (format!("{}_{}", c.key, unit_word(c.unit)), json!(v)))
                    .collect();
                json!({ "row": line.name, "lost": line.lost, "values": cells })
            });
            (
                table.key.to_owned(),
                json!({ "title": table.title, "note": table.note, "lines": lines.collect::<Vec<_>>() }),
            )
        };
        let tables: serde_json::Map<String, Value> = self.tables.iter().map(table).collect();
        json!({
            "seed": self.seed, "quick": self.quick, "version": env!("CARGO_PKG_VERSION"), "machine": machine(),
            "lighting": tables, "notes": self.notes,
        })
    }

    /// A page that needs nothing else.
    #[must_use]
    pub fn html(&self) -> String {
        let mut page = Page {
            title: "lighting bench".into(),
            subtitle: format!("{}; seed {}{}", machine(), self.seed, if self.quick { "; quick" } else { "" }),
            cards: Vec::new(),
            figures: Vec::new(),
            tables: Vec::new(),
            notes: self.notes.clone(),
        };
        if let Some(all) = self.line("places", "all") {
            for (name, psnr, gain) in [("Map", Some(0), 1), ("Mirror ball", Some(2), 3), ("Diffuse ball", None, 5)] {
                let cell = |i: usize| all.cells.get(i).copied().unwrap_or(f64::NAN);
                page.cards.push(Card {
                    name: format!("{name}, medium preset, against a 360-degree capture"),
                    value: format!("{:+.1} %", cell(gain)),
                    detail: psnr.map_or_else(String::new, |i| format!("{:.1} dB; ", cell(i)))
                        + "mean PSNR over all places and observers, the capture taken where the observer stands",
                });
            }
        }
        for table in &self.tables {
            let drawing = match table.plot {
                Plot::None => String::new(),
                Plot::Bars(columns) => chart::bars(table, columns),
                Plot::Lines(columns) => chart::lines(table, columns),
            };
            if !drawing.is_empty() {
                let columns = match table.plot {
                    Plot::Bars(columns) | Plot::Lines(columns) => columns,
                    Plot::None => &[],
                };
                page.figures.push(Figure {
                    title: table.title.clone(),
                    drawing,
                    legend: chart::key(table, columns),
                    caption: table.note.clone(),
                    wide: false,
                });
            }
            page.tables.push(isobath_page::Table {
                title: table.title.clone(),
                note: table.note.clone(),
                header: std::iter::once(String::new())
                    .chain(table.columns.iter().map(|c| format!("{} {}", c.head, c.unit)))
                    .collect(),
                rows: table
                    .lines
                    .iter()
                    .map(|l| std::iter::once(l.name.clone()).chain(l.cells.iter().map(|v| number(*v))).collect())
                    .collect(),
                bad: (0..table.lines.len()).filter(|i| table.lines[*i].lost).collect(),
                folded: false,
            });
        }
        page.html()
    }

    /// A line, by its table's key and its name.
    #[must_use]
    pub fn line(&self, table: &str, name: &str) -> Option<&Line> {
        self.tables.iter().find(|t| t.key == table)?.lines.iter().find(|l| l.name == name)
    }

    /// Writes `lighting.html`, `lighting.csv` and `lighting.json` to a folder, which is made when there is none. Returns their paths.
    ///
    /// # Errors
    /// [`BenchError::Write`].
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, BenchError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |error| BenchError::Write { path, error }
        };
        std::fs::create_dir_all(folder).map_err(failed(folder))?;
        let files = [
            ("lighting.html", self.html()),
            ("lighting.csv", self.csv()),
            ("lighting.json", format!("{:#}\n", self.json())),
        ];
        let mut written = Vec::new();
        for (name, text) in files {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(failed(&path))?;
            written.push(path);
        }
        Ok(written)
    }
}

/// A unit as a part of a name.
fn unit_word(unit: &str) -> &str {
    match unit {
        "%" => "percent",
        "dB" => "db",
        "SSIM" => "similarity",
        "of 1" => "of_1",
        "KiB" => "kib",
        other => other,
    }
}

fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let Some(line) = lines.last_mut() else { break };
        if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > width {
            lines.push(word.to_owned());
        } else {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn example() -> Report {
        const COLUMNS: &[Column] = &[
            Column { key: "map_psnr", head: "map", unit: "dB", shown: true },
            Column { key: "gain", head: "gain", unit: "%", shown: true },
            Column { key: "hidden", head: "hidden", unit: "dB", shown: false },
        ];
        let lines = vec![
            Line::new(
                "<all> that is long, much longer than a terminal has room for in its first column of all",
                vec![20.0, 3.0, 1.0],
            ),
            Line { lost: true, ..Line::new("b", vec![10.0, -3.0, f64::NAN]) },
        ];
        let table = |plot| Table {
            key: "places",
            title: "By place".into(),
            note: "word ".repeat(40).trim_end().to_owned(),
            columns: COLUMNS,
            lines: lines.clone(),
            plot,
        };
        let tables = vec![table(Plot::Bars(&[0, 1])), table(Plot::Lines(&[0, 1])), table(Plot::None)];
        Report { quick: true, seed: 4, tables, notes: vec!["none".into()] }
    }

    #[test]
    fn eighty_columns_hold_it_and_losses_are_said() {
        let text = example().text();
        assert!(text.lines().all(|l| l.chars().count() <= WIDTH), "{text}");
        assert!(text.lines().any(|l| l.starts_with(LOST)) && text.contains("below the capture somewhere: b"));
        assert!(!text.contains("hidden"));
    }

    #[test]
    fn machines_get_every_number() {
        let report = example();
        assert_eq!(report.csv().lines().count(), 1 + 3 * 2 * 3);
        let json = report.json();
        let line = &json["lighting"]["places"]["lines"][1];
        assert_eq!((&line["lost"], &line["values"]["gain_percent"]), (&json!(true), &json!(-3.0)));
        assert!(line["values"]["hidden_db"].is_null());
    }

    #[test]
    fn the_page_is_whole() {
        let page = example().html();
        assert!(page.contains("&lt;all&gt;") && page.contains("<svg") && page.contains("class=\"bad\""));
        assert!(!page.contains("<all>") && !page.contains("<script"));
    }
}
