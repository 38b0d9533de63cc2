//! The skipping floor: cheap summaries of a frame that tell an algorithm where there is nothing to do.
//!
//! Skipping never changes an answer: each algorithm that skips gives what its full form gives, exactly or within a stated
//! bound, and says in a [`Work`] how much it did and how much it left out.

pub mod pyramid;
pub mod tiles;

/// How much work an answer took, in the units the algorithm names (pixels visited, cells expanded).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Work {
    /// Units done.
    pub done: u32,
    /// Units that the full form would have done and that were skipped.
    pub skipped: u32,
}

impl Work {
    /// Share of the full form's work that was skipped, 0 to 1.
    #[must_use]
    pub fn skipped_share(&self) -> f32 {
        let all = self.done as f32 + self.skipped as f32;
        if all > 0.0 { self.skipped as f32 / all } else { 0.0 }
    }
}

impl core::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.done = self.done.saturating_add(other.done);
        self.skipped = self.skipped.saturating_add(other.skipped);
    }
}
