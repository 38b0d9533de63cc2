//! What the program says on stdout: a few lines for people, or one JSON object for machines; never both.
//!
//! Text is gathered and written once, so a reader that closes the pipe early (`| head`) is no error. Bold, dim and red only on
//! a terminal, and never with `NO_COLOR` set. Tables fit 80 columns: the last column is cut first.

use std::fmt::Write as _;
use std::io::{IsTerminal, Write as _};

/// Columns that text is laid out for, whatever the terminal has.
const WIDTH: usize = 80;

/// Gathers the answer of one command.
#[derive(Debug)]
pub(crate) struct Say {
    json: bool,
    styled: bool,
    text: String,
}

impl Say {
    pub(crate) fn new(json: bool) -> Self {
        let plain = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty())
            || std::env::var_os("TERM").is_some_and(|t| t == "dumb");
        Self { json, styled: !plain && std::io::stdout().is_terminal(), text: String::new() }
    }

    fn styled(&self, code: &str, text: &str) -> String {
        if self.styled { format!("\x1b[{code}m{text}\x1b[0m") } else { text.to_owned() }
    }

    /// A headline.
    pub(crate) fn head(&mut self, text: &str) {
        let line = self.styled("1", text);
        self.line(&line);
    }

    /// A line that must not be overlooked: red.
    pub(crate) fn alarm(&mut self, text: &str) {
        let line = self.styled("31", text);
        self.line(&line);
    }

    /// A remark of lesser weight, wrapped.
    pub(crate) fn remark(&mut self, text: &str) {
        for line in wrap(text, WIDTH) {
            let line = self.styled("2", &line);
            self.line(&line);
        }
    }

    /// A line as it is.
    pub(crate) fn line(&mut self, text: &str) {
        if !self.json {
            // No-break spaces have done their work: the lines are broken.
            self.text.push_str(&text.replace('\u{a0}', " "));
            self.text.push('\n');
        }
    }

    /// `name  value`, with long values wrapped under themselves.
    pub(crate) fn fact(&mut self, name: &str, value: &str) {
        const NAME: usize = 12;
        for (i, part) in wrap(value, WIDTH - NAME - 2).iter().enumerate() {
            let name = if i == 0 { name } else { "" };
            self.line(&format!("{name:<NAME$}  {part}"));
        }
    }

    /// A table: the first column to the left, the others to the right, except where `left` says otherwise.
    pub(crate) fn table(&mut self, header: &[&str], rows: &[Vec<String>], left: &[usize]) {
        let mut widths: Vec<usize> = header.iter().map(|h| h.chars().count()).collect();
        for row in rows {
            for (width, cell) in widths.iter_mut().zip(row) {
                *width = (*width).max(cell.chars().count());
            }
        }
        let format = |cells: &mut dyn Iterator<Item = &str>| {
            let mut line = String::new();
            for (i, (cell, &width)) in cells.zip(&widths).enumerate() {
                let gap = if i == 0 { "" } else { "  " };
                let _ = if i == 0 || left.contains(&i) {
                    write!(line, "{gap}{cell:<width$}")
                } else {
                    write!(line, "{gap}{cell:>width$}")
                };
            }
            line.trim_end().chars().take(WIDTH).collect::<String>()
        };
        let head = format(&mut header.iter().copied());
        let head = self.styled("1", &head);
        self.line(&head);
        for row in rows {
            let line = format(&mut row.iter().map(String::as_str));
            self.line(&line);
        }
    }

    /// The answer for machines; with `--json` the only thing printed.
    pub(crate) fn json(&mut self, value: &impl serde::Serialize) {
        if self.json {
            let mut value = serde_json::to_value(value).unwrap_or_default();
            shorten(&mut value);
            // Plain data with string keys: serialising cannot fail; an empty object would say so.
            let value = serde_json::to_string_pretty(&value).unwrap_or_else(|_| "{}".to_owned());
            self.text.push_str(&value);
            self.text.push('\n');
        }
    }

    /// Writes everything. A closed pipe is no error.
    pub(crate) fn print(&self) {
        let mut out = std::io::stdout().lock();
        let _ = out.write_all(self.text.as_bytes()).and_then(|()| out.flush());
    }
}

/// `f32` numbers became `f64` on their way into JSON: gives them back their own, shorter digits.
pub(crate) fn shorten(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::Array(list) => list.iter_mut().for_each(shorten),
        serde_json::Value::Object(map) => map.values_mut().for_each(shorten),
        serde_json::Value::Number(n) if n.is_f64() => {
            let wide = n.as_f64().unwrap_or_default();
            let narrow = wide as f32;
            if f64::from(narrow).to_bits() == wide.to_bits()
                && let Some(short) = narrow.to_string().parse().ok().and_then(serde_json::Number::from_f64)
            {
                *n = short;
            }
        }
        _ => {}
    }
}

/// Breaks text at spaces into lines of at most `width` characters (longer words stay whole).
fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let mut line = String::new();
    for word in text.split(' ') {
        if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > width {
            lines.push(std::mem::take(&mut line));
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    lines.push(line);
    lines
}

/// A length for people: tenths of millimetres below 1 cm, millimetres below 10 cm, metres above.
pub(crate) fn metres(value: f32) -> String {
    if !value.is_finite() {
        "unknown".to_owned()
    } else if value != 0.0 && value.abs() < 0.00995 {
        format!("{:.1}\u{a0}mm", value * 1e3)
    } else if value.abs() < 0.0995 {
        format!("{:.0}\u{a0}mm", value * 1e3)
    } else {
        format!("{value:.2}\u{a0}m")
    }
}

/// A point for people, in metres.
pub(crate) fn point(p: isobath::glam::Vec3) -> String {
    // Adding zero turns -0.00 into 0.00.
    let [x, y, z] = p.to_array().map(|v| (v * 100.0).round() / 100.0 + 0.0);
    format!("({x:.2},\u{a0}{y:.2},\u{a0}{z:.2})")
}

/// A time for people, from nanoseconds.
pub(crate) fn duration(nanos: f64) -> String {
    match nanos {
        n if n < 1e3 => format!("{n:.0} ns"),
        n if n < 1e5 => format!("{:.1} µs", n / 1e3),
        n if n < 1e6 => format!("{:.0} µs", n / 1e3),
        n if n < 1e8 => format!("{:.2} ms", n / 1e6),
        n => format!("{:.2} s", n / 1e9),
    }
}

/// A number of bytes for people.
pub(crate) fn bytes(n: usize) -> String {
    match n {
        0..=9_999 => format!("{n} B"),
        10_000..=9_999_999 => format!("{:.1} kB", n as f64 / 1e3),
        _ => format!("{:.1} MB", n as f64 / 1e6),
    }
}

/// A count with thin groups: 12345678 as 12,345,678.
pub(crate) fn count(n: impl Into<u64>) -> String {
    let digits = n.into().to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i) % 3 == 0 {
            out.push(',');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(count(1_234_567_u32), "1,234,567");
        assert_eq!(count(12_u8), "12");
        assert_eq!(metres(0.0123), "12\u{a0}mm");
        assert_eq!(metres(0.0012), "1.2\u{a0}mm");
        assert_eq!(metres(2.5), "2.50\u{a0}m");
        assert_eq!(metres(f32::NAN), "unknown");
        assert_eq!(duration(1.5e6), "1.50 ms");
        assert_eq!(duration(15.0e3), "15.0 µs");
        assert_eq!(point(isobath::glam::Vec3::new(-0.001, 1.0, 2.345)), "(0.00,\u{a0}1.00,\u{a0}2.35)");
    }

    #[test]
    fn nothing_is_wider_than_the_page() {
        let mut say = Say { json: false, styled: false, text: String::new() };
        say.fact("ground", &"word ".repeat(60));
        say.table(&["a", "b"], &[vec!["x".repeat(50), "y".repeat(50)]], &[]);
        assert!(say.text.lines().all(|l| l.chars().count() <= WIDTH));
    }

    #[test]
    fn machines_get_json_alone() {
        let mut say = Say { json: true, styled: false, text: String::new() };
        say.head("hello");
        say.json(&serde_json::json!({ "z_m": 1.5 }));
        assert_eq!(serde_json::from_str::<serde_json::Value>(&say.text).unwrap()["z_m"], 1.5);
    }
}
