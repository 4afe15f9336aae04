//! Advice on a verdict about agents that act, in words. Studies and Python share it.

mod beside;
mod decision;
mod findings;
mod reasons;
mod summary;
mod vocabulary;
mod words;

use calib_control::{Doubt, ReturnVerdict};

pub(super) use beside::beyond_whole_episodes;
pub use reasons::Reason;
pub(super) use vocabulary::{PROGRAM, STUDY};
pub use vocabulary::{PYTHON, Vocabulary};
pub(super) use words::rank_name;

/// A verdict with the names of everything in it.
#[derive(Clone, Copy, Debug)]
pub struct Advice<'a> {
    /// The verdict.
    pub verdict: &'a ReturnVerdict,
    /// The name of each setting.
    pub settings: &'a [String],
    /// The fields that have an effect in each setting, with their values.
    pub fields: &'a [Vec<(String, String)>],
    /// The names of the actions, by number.
    pub actions: &'a [String],
    /// The state columns.
    pub columns: &'a [String],
    /// The other names that the user knows.
    pub vocabulary: Vocabulary,
}

impl Advice<'_> {
    /// Whether the choice diverged. Diverged settings rank last, so every other setting diverged too.
    fn has_diverged(&self) -> bool {
        self.verdict.doubts.iter().any(|doubt| matches!(doubt, Doubt::Diverged))
    }

    /// Whether the models show no difference between the settings, or cannot rank the choice. Otherwise their ranking
    /// is more reliable than the returns that they predict. docs/control.md shows how choices do that are not
    /// recommended.
    fn is_arbitrary(&self) -> bool {
        let mut doubts = self.verdict.doubts.iter();
        doubts.any(|doubt| matches!(doubt, Doubt::NotToldApart | Doubt::Diverged))
    }

    /// Whether all settings get the same return in every ensemble member, so that no kind of model ranks them.
    fn all_tie(&self) -> bool {
        let mut members = self.verdict.kinds.iter().flat_map(|own| &own.members).peekable();
        members.peek().is_some()
            && members
                .all(|returns| returns.windows(2).all(|pair| pair[0].total_cmp(&pair[1]).is_eq()))
    }

    fn action(&self, number: usize) -> &str {
        self.actions.get(number).map_or("?", String::as_str)
    }
}

#[cfg(test)]
mod tests;
