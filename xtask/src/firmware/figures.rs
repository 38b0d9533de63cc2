//! Measured numbers, by section and name; a subset of TOML that is read and written here.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use anyhow::{Context, Result};

/// Share by which a figure may differ from the stored one.
const TOLERANCE: f64 = 0.03;

/// Sections of named whole numbers.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct Figures {
    sections: BTreeMap<String, BTreeMap<String, u64>>,
}

impl Figures {
    /// Keeps the larger of a figure's values: the worst frame counts.
    pub(super) fn most(&mut self, section: &str, name: &str, value: u64) {
        let kept = self.sections.entry(section.into()).or_default().entry(name.into()).or_default();
        *kept = value.max(*kept);
    }

    pub(super) fn get(&self, section: &str, name: &str) -> Option<u64> {
        self.sections.get(section)?.get(name).copied()
    }

    pub(super) fn section(&self, section: &str) -> impl Iterator<Item = (&str, u64)> {
        self.sections.get(section).into_iter().flatten().map(|(name, value)| (name.as_str(), *value))
    }

    pub(super) fn len(&self) -> usize {
        self.sections.values().map(BTreeMap::len).sum()
    }

    pub(super) fn to_toml(&self) -> String {
        let mut text = String::from(
            "# What `cargo xtask firmware` measured when it was last told to `--store`. Instructions and stack: the worst frame's.\n",
        );
        for (section, figures) in &self.sections {
            let _ = writeln!(text, "\n[{section}]");
            for (name, value) in figures {
                let _ = writeln!(text, "{name} = {value}");
            }
        }
        text
    }

    pub(super) fn from_toml(text: &str) -> Result<Self> {
        let mut figures = Self::default();
        let mut section = "";
        for (i, line) in text.lines().enumerate() {
            let line = line.trim();
            if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                section = name;
            } else if !line.is_empty() && !line.starts_with('#') {
                let parsed = line.split_once(" = ").and_then(|(name, value)| Some((name, value.parse().ok()?)));
                let (name, value) = parsed.with_context(|| format!("line {} is no `name = number`: {line}", i + 1))?;
                figures.most(section, name, value);
            }
        }
        Ok(figures)
    }

    /// What is off by more than [`TOLERANCE`], or there on one side only.
    pub(super) fn differences(&self, stored: &Self) -> Vec<String> {
        let mut all = Vec::new();
        for (section, figures) in &self.sections {
            for (name, &now) in figures {
                match stored.get(section, name) {
                    None => all.push(format!("{section} {name}: {now} now, nothing stored")),
                    Some(then) if now.abs_diff(then) as f64 > TOLERANCE * then as f64 => {
                        let percent = 100.0 * (now as f64 / then as f64 - 1.0);
                        all.push(format!("{section} {name}: {now} now, {then} stored ({percent:+.1} %)"));
                    }
                    Some(_) => {}
                }
            }
        }
        for (section, figures) in &stored.sections {
            let gone = figures.keys().filter(|name| self.get(section, name).is_none());
            all.extend(gone.map(|name| format!("{section} {name}: stored, not measured any more")));
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_what_moves_is_told() {
        let mut stored = Figures::default();
        stored.most("a.b", "hits", 1000);
        stored.most("a.b", "hits", 900);
        stored.most("c", "gone", 1);
        let read = Figures::from_toml(&stored.to_toml()).unwrap();
        assert_eq!(read, stored);
        let mut now = Figures::default();
        now.most("a.b", "hits", 1031);
        now.most("c", "new", 5);
        let told = now.differences(&stored);
        assert_eq!(
            told,
            [
                "a.b hits: 1031 now, 1000 stored (+3.1 %)",
                "c new: 5 now, nothing stored",
                "c gone: stored, not measured any more"
            ]
        );
        assert!(Figures::from_toml("x = y").is_err());
    }
}
