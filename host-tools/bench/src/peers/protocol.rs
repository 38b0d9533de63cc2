//! What is said between the bench and a worker: a request is a line of words, an answer a line of JSON.
//! `host-tools/bench/peers/worker.py` tells it from the other side.

use std::fmt;
use std::path::Path;
use std::time::Duration;

use isobath::sensing::camera::Intrinsics;
use serde::Deserialize;

/// Version-free: a worker that does not understand a line says so.
#[derive(Debug, Clone, Copy)]
pub(super) enum Request<'a> {
    /// Who are you?
    Hello,
    /// From now on, this frame. Which methods can take it?
    Frame { size: (usize, usize), kind: Kind, camera: &'a Intrinsics, path: &'a Path },
    /// Run a method so many times and tell the time.
    Run { method: &'a str, repeats: usize },
    /// Write a method's answer to a file.
    Result { method: &'a str, path: &'a Path },
}

/// What a frame's file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Metres, `f32`.
    Metres,
    /// Millimetres, `u16`.
    Millimetres,
}

impl fmt::Display for Request<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hello => write!(f, "hello"),
            Self::Frame { size: (w, h), kind, camera, path } => {
                let kind = if *kind == Kind::Metres { "f32" } else { "u16" };
                let (fx, fy, cx, cy) = (camera.fx(), camera.fy(), camera.cx(), camera.cy());
                // The path comes last: it may hold spaces.
                write!(f, "frame {w} {h} {kind} {fx} {fy} {cx} {cy} {}", path.display())
            }
            Self::Run { method, repeats } => write!(f, "run {method} {repeats}"),
            Self::Result { method, path } => write!(f, "result {method} {}", path.display()),
        }
    }
}

/// What a worker says.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub(super) enum Answer {
    /// To `hello`.
    Peer { peer: String, version: String },
    /// To `frame`.
    Methods { methods: Vec<Offer> },
    /// To `run`.
    Time { cpu_ns: u64, wall_ns: u64 },
    /// To `result`: how many numbers.
    Written { written: u64 },
    /// To anything: it could not.
    Refused { error: String },
}

/// A method that a worker has for the frame it was given.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(super) struct Offer {
    /// The bench's row that it belongs to.
    pub(super) row: String,
    /// To ask for it by.
    pub(super) id: String,
    /// For people.
    pub(super) label: String,
}

impl Answer {
    /// `None` of what is no answer.
    pub(super) fn parse(line: &str) -> Option<Self> {
        let answer: Self = serde_json::from_str(line.trim()).ok()?;
        let fine = match &answer {
            Self::Methods { methods } => methods.iter().all(|m| plain(&m.label) && word(&m.id)),
            Self::Peer { peer, version } => plain(peer) && plain(version),
            _ => true,
        };
        fine.then_some(answer)
    }
}

/// Fit for a table, a CSV and a terminal.
fn plain(text: &str) -> bool {
    (1..=40).contains(&text.chars().count()) && text.chars().all(|c| !c.is_control() && c != '"')
}

/// Fit for a request.
fn word(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| !c.is_control() && !c.is_whitespace())
}

/// The time told, unless more than one core worked on it.
pub(super) fn one_thread(cpu_ns: u64, wall_ns: u64) -> Option<Duration> {
    // Two clocks, read one after the other: a millisecond and a tenth are theirs.
    let limit = wall_ns.saturating_add(wall_ns / 10).saturating_add(1_000_000);
    (cpu_ns <= limit).then(|| Duration::from_nanos(cpu_ns))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_lines_of_words() {
        let camera = Intrinsics::new(525.5, 525.25, 319.5, 239.5).unwrap();
        let path = Path::new("/tmp/a frame.raw");
        let frame = Request::Frame { size: (640, 480), kind: Kind::Millimetres, camera: &camera, path };
        assert_eq!(frame.to_string(), "frame 640 480 u16 525.5 525.25 319.5 239.5 /tmp/a frame.raw");
        assert_eq!(Request::Run { method: "fals-5", repeats: 7 }.to_string(), "run fals-5 7");
        assert_eq!(Request::Result { method: "map", path }.to_string(), "result map /tmp/a frame.raw");
        assert_eq!(Request::Hello.to_string(), "hello");
    }

    #[test]
    fn answers_are_told_apart() {
        let parse = |line| Answer::parse(line).unwrap();
        assert_eq!(parse(r#"{"cpu_ns": 5, "wall_ns": 6}"#), Answer::Time { cpu_ns: 5, wall_ns: 6 });
        assert_eq!(parse(r#"{"written": 9}"#), Answer::Written { written: 9 });
        assert_eq!(parse(r#"{"error": "no"}"#), Answer::Refused { error: "no".into() });
        assert_eq!(
            parse(r#"{"peer": "PCL", "version": "1"}"#),
            Answer::Peer { peer: "PCL".into(), version: "1".into() }
        );
        let offer = Offer { row: "normals".into(), id: "a".into(), label: "A b".into() };
        let line = r#"{"methods": [{"row": "normals", "id": "a", "label": "A b"}]}"#;
        assert_eq!(parse(line), Answer::Methods { methods: vec![offer] });
    }

    #[test]
    fn rubbish_is_no_answer() {
        for line in [
            "",
            "ok",
            "{}",
            "[1]",
            r#"{"cpu_ns": -5, "wall_ns": 6}"#,
            r#"{"cpu_ns": 5}"#,
            r#"{"peer": "a\u001b[31m", "version": "1"}"#,
            r#"{"methods": [{"row": "normals", "id": "a b", "label": "x"}]}"#,
            r#"{"methods": [{"row": "normals", "id": "a", "label": "\""}]}"#,
        ] {
            assert_eq!(Answer::parse(line), None, "{line}");
        }
    }

    #[test]
    fn several_threads_are_seen() {
        assert_eq!(one_thread(1_000, 900), Some(Duration::from_nanos(1_000)), "clocks differ a little");
        assert_eq!(one_thread(19_000_000, 10_000_000), None);
        assert_eq!(one_thread(u64::MAX, u64::MAX), Some(Duration::from_nanos(u64::MAX)));
    }
}
