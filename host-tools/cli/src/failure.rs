//! What is said when something goes wrong: what happened, where, and what to do about it.
//!
//! On stderr, for people:
//! ```text
//! error: no camera for this depth image
//!   where: scan/depth.png
//!   what to do: put a camera.toml beside it, or give --intrinsics fx,fy,cx,cy --unit METRES
//! ```
//! With `--json`, for machines: `{"error": {"what": "...", "where": "...", "what_to_do": "..."}}`.

use std::fmt;
use std::path::Path;

/// A failure that ends the program with exit code 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Failure {
    what: String,
    place: Option<String>,
    advice: Option<String>,
}

pub(crate) type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    pub(crate) fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), place: None, advice: None }
    }

    /// Where it happened: a file, a frame, an option.
    pub(crate) fn at(self, place: impl fmt::Display) -> Self {
        Self { place: Some(place.to_string()), ..self }
    }

    /// What the reader can do about it.
    pub(crate) fn advise(self, advice: impl Into<String>) -> Self {
        Self { advice: Some(advice.into()), ..self }
    }

    /// A file that could not be written.
    pub(crate) fn writing(path: &Path, cause: impl fmt::Display) -> Self {
        Self::new(format!("cannot write: {cause}"))
            .at(path.display())
            .advise("choose a place that exists and can be written, with --out")
    }

    /// From any error of the core or the drivers, with the place it was met.
    pub(crate) fn of(cause: &(impl std::error::Error + ?Sized), place: impl fmt::Display) -> Self {
        let mut what = cause.to_string();
        let mut source = cause.source();
        while let Some(cause) = source {
            let text = cause.to_string();
            if !what.contains(&text) {
                what.push_str(": ");
                what.push_str(&text);
            }
            source = cause.source();
        }
        Self::new(what).at(place)
    }

    pub(crate) fn to_json(&self) -> serde_json::Value {
        serde_json::json!({ "error": { "what": self.what, "where": self.place, "what_to_do": self.advice } })
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error: {}", self.what)?;
        if let Some(place) = &self.place {
            write!(f, "\n  where: {place}")?;
        }
        if let Some(advice) = &self.advice {
            write!(f, "\n  what to do: {advice}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn says_what_where_and_what_to_do() {
        let failure = Failure::new("no camera").at("a.png").advise("give one");
        assert_eq!(failure.to_string(), "error: no camera\n  where: a.png\n  what to do: give one");
        assert_eq!(failure.to_json()["error"]["what_to_do"], "give one");
        assert_eq!(Failure::new("x").to_string(), "error: x");
    }
}
