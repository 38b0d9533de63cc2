//! The vocabulary: what is compared with what, in which units.

use std::fmt;
use std::time::Duration;

use crate::input::{Input, Sensor};

/// One capability: methods that answer the same question, to be compared.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// To pick it by: lower case, with hyphens. What follows a dot names a variant: the same question of other scenes.
    pub name: &'static str,
    /// In words.
    pub title: &'static str,
    /// What one answer is about: times are nanoseconds per this ("pixel", "ray", ...).
    pub unit: &'static str,
    /// What is wrong with an answer; the first decides who is on the Pareto front.
    pub errors: &'static [Measure],
    /// Sensors it is measured with.
    pub sensors: &'static [Sensor],
    /// Scenes it is measured on; all the usual ones when empty.
    pub scenes: &'static [&'static str],
    /// What is compared, ready to run on an input.
    pub methods: for<'a> fn(&'a Input) -> Vec<Method<'a>>,
    /// How another program's answer is scored: three numbers a pixel, rows from the top, camera frame. `None`: nobody else is asked.
    pub answers: Option<fn(&Input, &[f32]) -> Score>,
}

impl Row {
    /// Whether it is measured on a scene.
    #[must_use]
    pub fn takes(&self, scene: &str) -> bool {
        let named = self.scenes.contains(&scene);
        named || (self.scenes.is_empty() && !crate::FACETS.contains(&scene))
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

    /// Nothing to say of any of a row's errors.
    #[must_use]
    pub fn none(row: &Row) -> Self {
        Self { errors: vec![f64::NAN; row.errors.len()] }
    }
}

/// How a method's time is known.
enum Work<'a> {
    /// We run it and look at the clock.
    Watched(Box<dyn FnMut() + 'a>),
    /// It runs so many times and tells what that took; `None` when it could not.
    Told(Box<dyn FnMut(usize) -> Option<Duration> + 'a>),
}

/// One method with its knobs set, bound to one input.
pub struct Method<'a> {
    name: String,
    units: usize,
    peer: Option<String>,
    work: Work<'a>,
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
        Self {
            name: name.into(),
            units: units.max(1),
            peer: None,
            work: Work::Watched(Box::new(run)),
            score: Box::new(score),
        }
    }

    /// A method of `peer` (another library, with its version), which runs so many times and tells the time it took itself.
    pub fn told(
        name: impl Into<String>,
        units: usize,
        peer: impl Into<String>,
        run: impl FnMut(usize) -> Option<Duration> + 'a,
        score: impl FnMut() -> Score + 'a,
    ) -> Self {
        Self {
            name: name.into(),
            units: units.max(1),
            peer: Some(peer.into()),
            work: Work::Told(Box::new(run)),
            score: Box::new(score),
        }
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

    /// The other library that answers, with its version; `None` for isobath.
    #[must_use]
    pub fn peer(&self) -> Option<&str> {
        self.peer.as_deref()
    }

    /// Runs it once.
    pub fn run(&mut self) {
        match &mut self.work {
            Work::Watched(run) => run(),
            Work::Told(run) => _ = run(1),
        }
    }

    /// The time that `repeats` runs take, by `stopwatch` where the method does not tell it; `None` when it could not run.
    pub(crate) fn spend(
        &mut self,
        repeats: usize,
        stopwatch: impl FnOnce(&mut dyn FnMut()) -> Duration,
    ) -> Option<Duration> {
        match &mut self.work {
            Work::Watched(run) => Some(stopwatch(&mut || (0..repeats).for_each(|_| run()))),
            Work::Told(run) => run(repeats),
        }
    }

    /// Compares its answers with the truth.
    pub fn score(&mut self) -> Score {
        (self.score)()
    }
}
