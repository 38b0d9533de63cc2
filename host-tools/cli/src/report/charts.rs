//! Colour bars, keys and the timings chart.

use std::fmt::Write as _;

use crate::picture::colours::hex;
use crate::picture::svg::{Svg, escape};
use crate::say::duration;

/// A horizontal colour bar from `low` to `high` with five marks; `colour` takes the value shown.
pub(crate) fn colour_bar(low: f32, high: f32, unit: &str, label: &str, colour: impl Fn(f32) -> [u8; 3]) -> String {
    const W: f32 = 480.0;
    let mut svg = Svg::new(W, 34.0, label);
    let mut stops = String::from("<defs><linearGradient id=\"ID\">");
    for i in 0..=16 {
        let t = i as f32 / 16.0;
        let _ = write!(stops, "<stop offset=\"{t}\" stop-color=\"{}\"/>", hex(colour(low + t * (high - low))));
    }
    stops.push_str("</linearGradient></defs>");
    // An id must be unique on the page; the label is.
    let id: String = label.chars().filter(char::is_ascii_alphanumeric).collect();
    svg.raw(&stops.replace("ID", &id));
    svg.rect(0.0, 2.0, W - 1.0, 10.0, &format!("rx=\"2\" fill=\"url(#{id})\""));
    for i in 0..=4 {
        let t = i as f32 / 4.0;
        let anchor = ["start", "middle", "middle", "middle", "end"][i];
        let text = format!("{:.2}{unit}", low + t * (high - low));
        svg.text([t * (W - 1.0), 27.0], 12.0, &text, &format!("class=\"soft\" text-anchor=\"{anchor}\""));
    }
    svg.finish()
}

/// What colours mean: pairs of a CSS colour and its meaning.
pub(crate) fn key(entries: &[(&str, &str)]) -> String {
    let mut out = String::new();
    for (colour, meaning) in entries {
        let _ = write!(out, "<span class=\"key\"><i style=\"background:{colour}\"></i>{}</span>", escape(meaning));
    }
    out
}

/// One stage's times in nanoseconds.
#[derive(Debug, Clone)]
pub(crate) struct Bar {
    pub(crate) name: String,
    pub(crate) median: f64,
    pub(crate) worst: f64,
}

/// Median (full) and worst (pale) times as bars.
pub(crate) fn timings(bars: &[Bar]) -> String {
    const W: f32 = 520.0;
    const ROW: f32 = 26.0;
    const LEFT: f32 = 104.0;
    const RIGHT: f32 = 186.0;
    let mut svg = Svg::new(W, bars.len() as f32 * ROW + 6.0, "time per stage");
    let longest = bars.iter().map(|b| b.worst).fold(1.0, f64::max);
    let scale = |ns: f64| ((ns / longest) as f32 * (W - LEFT - RIGHT)).max(1.5);
    for (i, bar) in bars.iter().enumerate() {
        let y = i as f32 * ROW + 4.0;
        svg.text([0.0, y + 13.0], 13.0, &bar.name, "class=\"ink\"");
        svg.rect(LEFT, y + 1.0, scale(bar.worst), 16.0, "rx=\"2\" class=\"worst\"");
        svg.rect(LEFT, y + 1.0, scale(bar.median), 16.0, "rx=\"2\" class=\"bar\"");
        let text = format!("{} (worst {})", duration(bar.median), duration(bar.worst));
        svg.text([LEFT + scale(bar.worst) + 8.0, y + 13.0], 12.0, &text, "class=\"soft\"");
    }
    svg.finish()
}
