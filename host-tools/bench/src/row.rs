//! The vocabulary: what is compared with what, in which units.

use std::fmt;

use crate::input::{Input, Sensor};

/// One capability: methods that answer the same question, to be compared.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// To pick it by: lower case, with hyphens.
    pub name: &'static str,
    /// In words.
    pub title: &'static str,
    /// What one answer is about: times are nanoseconds per this ("pixel", "ray", ...).
    pub unit: &'static str,
    /// What is wrong with an answer; the first decides who is on the Pareto front.
    pub errors: &'static [Measure],
    /// Sensors it is measured with.
    pub sensors: &'static [Sensor],
    /// Scenes it is measured on; all when empty.
    pub scenes: &'static [&'static str],
    /// What is compared, ready to run on an input.
    pub methods: for<'a> fn(&'a Input) -> Vec<Method<'a>>,
}

impl Row {
    /// Whether it is measured on a scene.
    #[must_use]
    pub fn takes(&self, scene: &str) -> bool {
        self.scenes.is_empty() || self.scenes.contains(&scene)
    }
}

/// One way of being wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Measure {
    /// Of its numbers.
    pub unit: &'static str,
    /// In a word or two.
    pub name: &'static str,
    /// In a sentence.
    pub what: &'static str,
    /// Whether the terminal has a column for it; files have all.
    pub shown: bool,
}

/// How wrong the answers were: one number for each of the row's [`Measure`]s; NaN where there is nothing to say.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// In the row's order.
    pub errors: Vec<f64>,
}

impl Score {
    /// From its numbers.
    #[must_use]
    pub fn of<const N: usize>(errors: [f64; N]) -> Self {
        Self { errors: errors.to_vec() }
    }
}

/// One method with its knobs set, bound to one input.
pub struct Method<'a> {
    name: String,
    units: usize,
    run: Box<dyn FnMut() + 'a>,
    score: Box<dyn FnMut() -> Score + 'a>,
}

impl fmt::Debug for Method<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Method").field("name", &self.name).field("units", &self.units).finish_non_exhaustive()
    }
}

impl<'a> Method<'a> {
    /// `run` is timed and answers `units` times; `score` gives the same answers once more and compares them with the truth.
    pub fn new(
        name: impl Into<String>,
        units: usize,
        run: impl FnMut() + 'a,
        score: impl FnMut() -> Score + 'a,
    ) -> Self {
        Self { name: name.into(), units: units.max(1), run: Box::new(run), score: Box::new(score) }
    }

    /// Its name and knobs.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Answers that one run gives.
    #[must_use]
    pub const fn units(&self) -> usize {
        self.units
    }

    /// Runs it once.
    pub fn run(&mut self) {
        (self.run)();
    }

    /// Compares its answers with the truth.
    pub fn score(&mut self) -> Score {
        (self.score)()
    }
}
