//! Several step patterns over the same pairs.

use rayon::prelude::*;

use crate::distance::{check, distances, found};
use crate::kernel::dispatch::InstructionSet;
use crate::{Distance, DtwError, NoPath, Series, Settings, StepPattern};

/// Several patterns over the same pairs.
///
/// Series of several channels are swept once for all patterns, because there the local distances
/// cost most; with one channel each pattern has the caches for itself and is faster alone. The
/// distances are the same.
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

/// One result a pattern, in the order of the patterns.
pub type ByPattern = Vec<Result<Distance, NoPath>>;

impl PatternSet {
    /// `patterns` that share `settings`.
    pub fn new(patterns: impl Into<Vec<StepPattern>>, settings: Settings) -> Self {
        Self { patterns: patterns.into(), settings }
    }

    /// The patterns.
    pub fn patterns(&self) -> &[StepPattern] {
        &self.patterns
    }

    /// The settings.
    pub fn settings(&self) -> Settings {
        self.settings
    }

    /// The distances of one pair; a pattern without an admissible path has its own error.
    ///
    /// # Errors
    /// If the pair is wrong for any pattern: empty, not finite or too large, channels that differ.
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

    /// The distances of many pairs (query, reference), in parallel on rayon's current pool; the
    /// results do not depend on the number of threads.
    pub fn distances_of_pairs(
        &self,
        pairs: &[(Series<'_>, Series<'_>)],
    ) -> Vec<Result<ByPattern, DtwError>> {
        pairs.par_iter().map(|&(query, reference)| self.distances(query, reference)).collect()
    }
}
