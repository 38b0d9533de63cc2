//! The stored table, what callgrind writes, and the comparison of the two.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use anyhow::{Context, Result};

/// Per cent that a kernel may grow by, unless the file says otherwise.
pub(super) const TOLERANCE: f64 = 3.0;

/// What the repository holds.
#[derive(Debug, PartialEq)]
pub(super) struct Baseline {
    /// Per cent.
    pub(super) tolerance: f64,
    pub(super) rustc: String,
    pub(super) target: String,
    /// Instructions of each kernel.
    pub(super) kernels: BTreeMap<String, u64>,
}

impl Baseline {
    /// From the file's text.
    pub(super) fn parse(text: &str) -> Result<Self> {
        let table: toml::Table = text.parse()?;
        let word = |key: &str| {
            table.get(key).and_then(|v| v.as_str()).map(String::from).with_context(|| format!("no `{key}`"))
        };
        let tolerance = table.get("tolerance_percent").and_then(toml::Value::as_float);
        let tolerance =
            tolerance.filter(|t| *t >= 0.0).context("no `tolerance_percent` with a decimal point, 0.0 or more")?;
        let kernels = table.get("kernels").and_then(toml::Value::as_table).context("no `[kernels]`")?;
        let kernels = kernels.iter().map(|(name, value)| {
            let count = value.get("instructions").and_then(toml::Value::as_integer).and_then(|n| u64::try_from(n).ok());
            Ok((name.clone(), count.filter(|n| *n > 0).with_context(|| format!("`{name}` has no `instructions`"))?))
        });
        Ok(Self { tolerance, rustc: word("rustc")?, target: word("target")?, kernels: kernels.collect::<Result<_>>()? })
    }
}

/// A kernel, and what was counted.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Count {
    pub(super) name: String,
    /// Answers of one run, and what one is about.
    pub(super) answers: u64,
    pub(super) unit: String,
    /// 0 before it was counted.
    pub(super) instructions: u64,
}

impl Count {
    /// From a line of the program's list: `NAME ANSWERS UNIT`.
    pub(super) fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let (name, answers, unit) = (words.next()?, words.next()?.parse().ok()?, words.next()?);
        Some(Self { name: name.into(), answers, unit: unit.into(), instructions: 0 })
    }

    /// Instructions of one answer.
    pub(super) fn each(&self) -> f64 {
        self.instructions as f64 / self.answers.max(1) as f64
    }
}

/// The file's text.
pub(super) fn write(counts: &[Count], tolerance: f64, rustc: &str, target: &str) -> String {
    let mut out = format!(
        "# Instructions of each kernel in tests/instructions, by `cargo xtask instructions --store`. By hand, edit only the tolerance:\n\
         # CI fails when a kernel takes that much more.\n\
         tolerance_percent = {tolerance:?}\nrustc = {rustc:?}\ntarget = {target:?}\n\n[kernels]\n"
    );
    for c in counts {
        let _ = writeln!(
            out,
            "{} = {{ instructions = {}, each = {:.1}, unit = {:?} }}",
            c.name,
            c.instructions,
            c.each(),
            c.unit
        );
    }
    out
}

/// The total of what was collected, from callgrind's file: the line `totals: N`.
pub(super) fn total(text: &str) -> Option<u64> {
    text.lines().rev().find_map(|l| l.strip_prefix("totals:"))?.split_whitespace().next()?.parse().ok()
}

/// How much more, per cent.
pub(super) fn percent(stored: u64, now: u64) -> f64 {
    100.0 * (now as f64 - stored as f64) / stored as f64
}

/// What to think of a kernel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    Within,
    Faster,
    Slower,
    /// Counted, but not in the table.
    Unlisted,
    /// In the table, but no longer a kernel.
    Gone,
}

/// Compares, and says in words what to do.
pub(super) fn judge(name: &str, stored: Option<u64>, now: Option<u64>, tolerance: f64) -> (Verdict, String) {
    let store = "cargo xtask instructions --store";
    let (verdict, text) = match (stored, now) {
        (None, None) => (Verdict::Within, String::new()),
        (None, Some(now)) => {
            (Verdict::Unlisted, format!("{now} instructions, but none are stored; store them: {store}"))
        }
        (Some(stored), None) => (
            Verdict::Gone,
            format!("{stored} instructions are stored, but there is no such kernel; store what there is: {store}"),
        ),
        (Some(stored), Some(now)) => {
            let change = percent(stored, now);
            let both = format!("{stored} -> {now} instructions, {change:+.2} %");
            if change > tolerance {
                (
                    Verdict::Slower,
                    format!(
                        "{both}, and {tolerance} % is allowed. Find out why (does the loop still vectorise?); if it is worth it, say so in \
                         the commit and store the new number: {store}"
                    ),
                )
            } else if change < -tolerance {
                (Verdict::Faster, format!("{both}: faster. Store it, so that it stays so: {store}"))
            } else {
                (Verdict::Within, both)
            }
        }
    };
    (verdict, format!("{name}: {text}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(stored: impl Into<Option<u64>>, now: impl Into<Option<u64>>) -> Verdict {
        judge("k", stored.into(), now.into(), TOLERANCE).0
    }

    #[test]
    fn more_than_the_tolerance_fails_with_both_numbers() {
        assert_eq!(verdict(100_000, 103_100), Verdict::Slower);
        assert_eq!(verdict(100_000, 103_000), Verdict::Within, "3 % to the dot is no more than 3 %");
        assert_eq!(verdict(100_000, 102_900), Verdict::Within);
        assert_eq!(verdict(100_000, 96_900), Verdict::Faster);
        let (_, text) = judge("hit-test", Some(100_000), Some(103_100), TOLERANCE);
        for needed in ["hit-test", "100000", "103100", "+3.10 %", "--store"] {
            assert!(text.contains(needed), "{text}");
        }
    }

    #[test]
    fn a_kernel_in_one_list_only_fails() {
        assert_eq!(verdict(None, 5), Verdict::Unlisted);
        assert_eq!(verdict(5, None), Verdict::Gone);
    }

    #[test]
    fn what_is_written_is_read() {
        let mut count = Count::parse("hit-test 1000 hit").unwrap();
        count.instructions = 123_456;
        let text = write(&[count], 2.5, "1.95.0 (abc 2026-01-01)", "x86_64-unknown-linux-gnu");
        assert!(text.contains("each = 123.5, unit = \"hit\""), "{text}");
        let read = Baseline::parse(&text).unwrap();
        assert_eq!((read.tolerance, read.rustc.as_str()), (2.5, "1.95.0 (abc 2026-01-01)"));
        assert_eq!(read.kernels.into_iter().collect::<Vec<_>>(), [("hit-test".to_owned(), 123_456)]);
    }

    #[test]
    fn a_broken_table_says_what_is_missing() {
        let head = "tolerance_percent = 3.0\nrustc = \"1\"\ntarget = \"t\"\n";
        for (text, what) in [
            ("", "tolerance_percent"),
            ("tolerance_percent = -1.0\n[kernels]", "tolerance_percent"),
            (head, "[kernels]"),
            (&format!("{head}[kernels]\na = {{ each = 1.0 }}"), "`a`"),
            (&format!("{head}[kernels]\na = {{ instructions = 0 }}"), "`a`"),
        ] {
            let error = Baseline::parse(text).unwrap_err().to_string();
            assert!(error.contains(what), "{text}: {error}");
        }
    }

    #[test]
    fn callgrinds_total() {
        assert_eq!(total("events: Ir\nfn=(1) main\n12 345\n\ntotals: 684573\n"), Some(684_573));
        assert_eq!(total("events: Ir\n"), None);
        assert!(Count::parse("name without numbers").is_none() && Count::parse("name 12").is_none());
    }

    /// The table of this repository is one, and has what the issue asks for.
    #[test]
    fn the_stored_table_is_readable() {
        let stored = super::super::read_baseline().unwrap();
        assert!((0.0..=TOLERANCE).contains(&stored.tolerance) && stored.kernels.len() > 20);
    }
}
