//! Bars and lines over a table's rows.

use std::fmt::Write as _;

use isobath_page::svg::{Svg, escape};

use super::report::Table;
use crate::report::number;

const W: f32 = 560.0;
const H: f32 = 300.0;
const LEFT: f32 = 44.0;
const TOP: f32 = 18.0;
const BOTTOM: f32 = 46.0;
const FONT: f32 = 11.0;
/// Told apart in light and dark, and without seeing red from green.
const COLOURS: [&str; 5] = ["var(--accent)", "#e8890c", "#8f6fd8", "#c2527a", "#7c8a99"];

fn colour(i: usize) -> &'static str {
    COLOURS.get(i % COLOURS.len()).copied().unwrap_or("currentColor")
}

/// Which colour is which column.
pub(super) fn key(table: &Table, columns: &[usize]) -> String {
    let mut out = String::new();
    for (i, column) in columns.iter().filter_map(|c| table.columns.get(*c)).enumerate() {
        let name = format!("{}, {}", column.head, column.unit);
        let _ = write!(out, "<span class=\"key\"><i style=\"background:{}\"></i>{}</span>", colour(i), escape(&name));
    }
    out
}

/// From values to heights; zero is on it.
struct Scale {
    low: f64,
    high: f64,
}

impl Scale {
    fn over(table: &Table, columns: &[usize], from_zero: bool) -> Option<Self> {
        let values = table.lines.iter().flat_map(|l| columns.iter().filter_map(|c| l.cells.get(*c)));
        let (low, high) = values
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
        if low > high {
            return None;
        }
        let low = if from_zero { low.min(0.0) } else { low - 0.1 * (high - low).max(1.0) };
        let high = high.max(low + 1e-9);
        Some(Self { low: if low < 0.0 { low * 1.1 } else { low }, high: high + 0.08 * (high - low) })
    }

    fn at(&self, value: f64) -> f32 {
        let t = ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        H - BOTTOM - t as f32 * (H - BOTTOM - TOP)
    }

    fn grid(&self, svg: &mut Svg) {
        let rough = (self.high - self.low) / 5.0;
        let power = 10.0_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|s| s * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
        let first = (self.low / step).ceil() as i64;
        for v in (first..first + 12).map(|i| i as f64 * step).filter(|v| *v <= self.high) {
            let y = self.at(v);
            svg.polyline(&[[LEFT, y], [W - 6.0, y]], "currentColor", 1.0, "class=\"grid\"");
            svg.text([LEFT - 6.0, y + 4.0], FONT, &number(v), "class=\"soft\" text-anchor=\"end\"");
        }
    }
}

/// Row names under their places, in two heights so that neighbours don't touch.
fn names(table: &Table, svg: &mut Svg, x: impl Fn(usize) -> f32) {
    let room = 2.0 * (W - LEFT) / table.lines.len().max(1) as f32 / (0.56 * FONT);
    for (i, line) in table.lines.iter().enumerate() {
        let y = H - BOTTOM + 16.0 + 14.0 * (i % 2) as f32;
        let mut name: String = line.name.chars().take(room as usize).collect();
        if name.chars().count() < line.name.chars().count() {
            name.pop();
            name.push('…');
        }
        svg.text([x(i), y], FONT, &name, "class=\"soft\" text-anchor=\"middle\"");
    }
}

/// A group of bars a row.
pub(super) fn bars(table: &Table, columns: &[usize]) -> String {
    let Some(scale) = Scale::over(table, columns, true) else { return String::new() };
    let mut svg = Svg::new(W, H, &table.title);
    scale.grid(&mut svg);
    let group = (W - LEFT - 6.0) / table.lines.len().max(1) as f32;
    let bar = 0.8 * group / columns.len().max(1) as f32;
    for (i, line) in table.lines.iter().enumerate() {
        for (j, value) in columns.iter().filter_map(|c| line.cells.get(*c)).enumerate().filter(|v| v.1.is_finite()) {
            let x = LEFT + group * (i as f32 + 0.1) + bar * j as f32;
            let (zero, end) = (scale.at(0.0), scale.at(*value));
            let extra = format!("fill=\"{}\"", colour(j));
            svg.rect(x, zero.min(end), (bar - 1.0).max(1.0), (zero - end).abs().max(0.5), &extra);
        }
    }
    names(table, &mut svg, |i| LEFT + group * (i as f32 + 0.5));
    svg.finish()
}

/// A line a column, over the rows.
pub(super) fn lines(table: &Table, columns: &[usize]) -> String {
    let Some(scale) = Scale::over(table, columns, false) else { return String::new() };
    let mut svg = Svg::new(W, H, &table.title);
    scale.grid(&mut svg);
    let n = table.lines.len().max(1) as f32;
    let x = |i: usize| LEFT + (W - LEFT - 6.0) * (i as f32 + 0.5) / n;
    for (j, column) in columns.iter().enumerate() {
        let points: Vec<[f32; 2]> = (table.lines.iter().enumerate())
            .filter_map(|(i, l)| l.cells.get(*column).filter(|v| v.is_finite()).map(|v| [x(i), scale.at(*v)]))
            .collect();
        svg.polyline(&points, colour(j), 2.0, "");
        for point in points {
            svg.circle(point, 3.5, colour(j), "");
        }
    }
    names(table, &mut svg, x);
    svg.finish()
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::example;
    use super::*;

    #[test]
    fn charts_hold_what_is_a_number() {
        let report = example();
        let table = &report.tables[0];
        assert_eq!(bars(table, &[0, 1]).matches("<rect").count(), 4);
        assert_eq!(bars(table, &[0, 2]).matches("<rect").count(), 3, "one is no number");
        assert_eq!(lines(table, &[0, 1]).matches("<circle").count(), 4);
        assert!(bars(table, &[7]).is_empty() && key(table, &[0]).contains("map, dB"));
    }
}
