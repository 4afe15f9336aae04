//! Distances of several step patterns for the same pairs.

use rayon::prelude::*;

use crate::distance::{check, distances, found};
use crate::kernel::dispatch::InstructionSet;
use crate::{Distance, DtwError, NoPath, Series, Settings, StepPattern};

/// Several step patterns that are applied to the same pairs.
///
/// With several channels, the local distances cost most, so one sweep serves all patterns. With one
/// channel, each pattern is swept separately, because it is faster when it has the caches for
/// itself. The distances are the same.
///
/// ```
/// use calib_dtw::{PatternSet, Settings};
///
/// let names = ["symmetric2", "asymmetric", "rabinerJuang:6c"];
/// let patterns = names.map(|name| name.parse().unwrap());
/// let set = PatternSet::new(patterns, Settings::default());
/// let distances = set.distances(&[0.0, 1.0, 2.0, 1.0], &[0.0, 1.0, 1.5, 1.0])?;
/// assert_eq!(distances[0].as_ref().unwrap().raw, 1.0);
/// # Ok::<(), calib_dtw::DtwError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PatternSet {
    patterns: Vec<StepPattern>,
    settings: Settings,
}

/// One result per pattern, in the order of the patterns.
pub type ByPattern = Vec<Result<Distance, NoPath>>;

impl PatternSet {
    /// Creates a set of `patterns` that share `settings`.
    pub fn new(patterns: impl Into<Vec<StepPattern>>, settings: Settings) -> Self {
        Self { patterns: patterns.into(), settings }
    }

    /// Returns the patterns.
    pub fn patterns(&self) -> &[StepPattern] {
        &self.patterns
    }

    /// Returns the settings.
    pub fn settings(&self) -> Settings {
        self.settings
    }

    /// Returns the distances of one pair. A pattern without an admissible path has its own error.
    ///
    /// # Errors
    /// If the pair is invalid for any pattern: a series is empty, not finite or too large, or the
    /// channels differ.
    pub fn distances<'a>(
        &self,
        query: impl Into<Series<'a>>,
        reference: impl Into<Series<'a>>,
    ) -> Result<ByPattern, DtwError> {
        let query = query.into();
        let reference = reference.into();
        check(&self.patterns, self.settings, query, reference)?;
        let together = if query.channels() == 1 { 1 } else { self.patterns.len().max(1) };
        let set = InstructionSet::best();
        let n = query.len();
        let m = reference.len();
        let outcomes = self
            .patterns
            .chunks(together)
            .flat_map(|patterns| distances(set, patterns, self.settings, query, reference, None));
        Ok(outcomes
            .zip(&self.patterns)
            .map(|(outcome, pattern)| found(&outcome, pattern, self.settings, n, m))
            .collect())
    }

    /// Returns the distances of many pairs (query, reference), in parallel on rayon's current pool.
    /// The results do not depend on the number of threads.
    pub fn distances_of_pairs(
        &self,
        pairs: &[(Series<'_>, Series<'_>)],
    ) -> Vec<Result<ByPattern, DtwError>> {
        pairs.par_iter().map(|&(query, reference)| self.distances(query, reference)).collect()
    }
}
