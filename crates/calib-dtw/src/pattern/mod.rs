//! Step patterns: the cells from which a warping path may come, and the cost of each step.

mod named;
mod names;
mod rabiner_juang;
mod recursion;

pub use names::ParsePatternError;
pub use rabiner_juang::{RabinerJuangType, SlopeWeighting, Smoothing};
pub use recursion::Recursion;

/// Longest advance of one branch, in samples of either series.
pub const LONGEST_BRANCH: usize = 15;

/// One step of a branch: its advance, and the weight of the local distance in the cell that it
/// reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Samples advanced along the query.
    pub query: usize,
    /// Samples advanced along the reference.
    pub reference: usize,
    /// Factor of the local distance in the cell that the step reaches; finite and not negative.
    pub weight: f64,
}

impl Step {
    /// Creates the step (`query`, `reference`) with `weight`.
    pub const fn new(query: usize, reference: usize, weight: f64) -> Self {
        Self { query, reference, weight }
    }
}

/// A cell whose cost a branch adds, counted backwards from the cell in which the branch ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Query samples before the end of the branch.
    pub query: usize,
    /// Reference samples before the end of the branch.
    pub reference: usize,
    /// Factor of the local distance in this cell.
    pub weight: f64,
}

/// One way into a cell: the steps from an earlier cell of the path, in path order.
#[derive(Clone, Debug, PartialEq)]
pub struct Branch {
    steps: Vec<Step>,
}

impl Branch {
    /// Creates the branch with these steps.
    pub fn new(steps: impl Into<Vec<Step>>) -> Self {
        Self { steps: steps.into() }
    }

    /// Returns the steps in path order.
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// Returns how far back the branch starts: (query, reference) samples.
    pub fn origin(&self) -> (usize, usize) {
        self.steps.iter().fold((0, 0), |(query, reference), step| {
            (query + step.query, reference + step.reference)
        })
    }

    /// Returns the cells whose cost the branch adds, first step first. The last one is offset (0,
    /// 0).
    pub fn cells(&self) -> impl Iterator<Item = Cell> + Clone + '_ {
        let (mut query, mut reference) = self.origin();
        self.steps.iter().map(move |step| {
            query -= step.query;
            reference -= step.reference;
            Cell { query, reference, weight: step.weight }
        })
    }
}

/// The divisor of a raw distance that makes pairs of different lengths comparable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Normalisation {
    /// The query's length N.
    Query,
    /// The reference's length M (up to where the path ends).
    Reference,
    /// N + M.
    Sum,
    /// No normalisation: paths with the same ends differ in total weight, so no division makes them
    /// comparable.
    None,
}

/// The reason why a list of branches is not a step pattern.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PatternError {
    /// There is no branch.
    #[error("step pattern `{name}` has no branches: give at least one")]
    NoBranches {
        /// The pattern's name.
        name: String,
    },
    /// A branch has no steps, or a step that advances neither series.
    #[error(
        "branch {branch} of step pattern `{name}` has a step that advances neither series, or no step: \
         every step must advance the query or the reference"
    )]
    NoAdvance {
        /// The pattern's name.
        name: String,
        /// Number of the branch, from 0.
        branch: usize,
    },
    /// A branch is longer than the kernels support.
    #[error(
        "branch {branch} of step pattern `{name}` advances by {got} samples: at most {LONGEST_BRANCH} \
         are allowed along either series"
    )]
    TooLong {
        /// The pattern's name.
        name: String,
        /// Number of the branch, from 0.
        branch: usize,
        /// The longer advance of the branch.
        got: usize,
    },
    /// A weight is negative, infinite or NaN.
    #[error(
        "branch {branch} of step pattern `{name}` has the weight {got}: expected a finite number, 0 or more"
    )]
    Weight {
        /// The pattern's name.
        name: String,
        /// Number of the branch, from 0.
        branch: usize,
        /// The weight.
        got: f64,
    },
}

/// The recursion of a time warp: branches, their weights, and the normalisation.
///
/// With local distances d the cumulated distance is
///
/// ```text
/// g(0,0) = d(0,0)
/// g(i,j) = min over branches of  g(i - a, j - b) + sum of weight * d(i - di, j - dj)
/// ```
///
/// where (a, b) is [`Branch::origin`] and the sum runs over [`Branch::cells`]. Ties go to the
/// earlier branch. They affect paths, never distances.
#[derive(Clone, Debug, PartialEq)]
pub struct StepPattern {
    name: String,
    branches: Vec<Branch>,
    normalisation: Normalisation,
}

impl StepPattern {
    /// Creates a custom pattern.
    ///
    /// # Errors
    /// If there is no branch, a step advances nothing, a branch is longer than [`LONGEST_BRANCH`],
    /// or a weight is negative or not finite.
    pub fn new(
        name: impl Into<String>,
        branches: impl Into<Vec<Branch>>,
        normalisation: Normalisation,
    ) -> Result<Self, PatternError> {
        let name = name.into();
        let branches = branches.into();
        if branches.is_empty() {
            return Err(PatternError::NoBranches { name });
        }
        for (branch, entry) in branches.iter().enumerate() {
            if entry.steps.is_empty() || entry.steps.iter().any(|s| s.query + s.reference == 0) {
                return Err(PatternError::NoAdvance { name, branch });
            }
            let (query, reference) = entry.origin();
            let got = query.max(reference);
            if got > LONGEST_BRANCH {
                return Err(PatternError::TooLong { name, branch, got });
            }
            if let Some(step) = entry.steps.iter().find(|s| !s.weight.is_finite() || s.weight < 0.0)
            {
                let got = step.weight;
                return Err(PatternError::Weight { name, branch, got });
            }
        }
        Ok(Self { name, branches, normalisation })
    }

    /// Returns the name. [`FromStr`](std::str::FromStr) reads it for the patterns of this crate.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the branches, in the order that breaks ties.
    pub fn branches(&self) -> &[Branch] {
        &self.branches
    }

    /// Returns the divisor of a raw distance.
    pub fn normalisation(&self) -> Normalisation {
        self.normalisation
    }

    /// Returns the longest advance of a branch along (query, reference).
    pub fn reach(&self) -> (usize, usize) {
        self.branches
            .iter()
            .map(Branch::origin)
            .fold((0, 0), |reach, origin| (reach.0.max(origin.0), reach.1.max(origin.1)))
    }

    /// Returns the smallest and largest slope of a path: reference samples per query sample. The
    /// largest is infinite if a branch advances only the reference.
    pub fn slopes(&self) -> (f64, f64) {
        self.branches
            .iter()
            .map(|branch| {
                let (query, reference) = branch.origin();
                reference as f64 / query as f64
            })
            .fold((f64::INFINITY, 0.0), |(low, high), slope| {
                (low.min(slope), f64::max(high, slope))
            })
    }

    /// Returns `distance` divided by the normalisation, for a query of `query` samples and a
    /// reference of `reference` samples. `None` if the pattern has no normalisation.
    pub fn normalise(&self, distance: f64, query: usize, reference: usize) -> Option<f64> {
        match self.normalisation {
            Normalisation::Query => Some(distance / query as f64),
            Normalisation::Reference => Some(distance / reference as f64),
            Normalisation::Sum => Some(distance / (query + reference) as f64),
            Normalisation::None => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_counted_back_from_the_end_of_the_branch() {
        let branch =
            Branch::new([Step::new(1, 1, 2.0), Step::new(1, 0, 1.0), Step::new(1, 0, 0.5)]);
        assert_eq!(branch.origin(), (3, 1));
        let cells: Vec<_> = branch.cells().map(|c| (c.query, c.reference, c.weight)).collect();
        assert_eq!(cells, [(2, 0, 2.0), (1, 0, 1.0), (0, 0, 0.5)]);
    }

    #[test]
    fn slopes_are_reference_samples_per_query_sample() {
        assert_eq!(StepPattern::symmetric2().slopes(), (0.0, f64::INFINITY));
        assert_eq!(StepPattern::asymmetric().slopes(), (0.0, 2.0));
        assert_eq!(StepPattern::symmetric_p1().slopes(), (0.5, 2.0));
        assert_eq!(StepPattern::symmetric_p2().slopes(), (2.0 / 3.0, 1.5));
        assert_eq!(StepPattern::symmetric_p05().slopes(), (1.0 / 3.0, 3.0));
    }

    #[test]
    fn impossible_patterns_are_refused_with_the_branch_that_is_wrong() {
        let diagonal = Branch::new([Step::new(1, 1, 1.0)]);
        for (branch, reason) in [
            (Branch::new([]), "branch 1 of step pattern `mine`"),
            (Branch::new([Step::new(0, 0, 1.0)]), "advances neither"),
            (Branch::new([Step::new(16, 1, 1.0)]), "advances by 16 samples"),
            (Branch::new([Step::new(1, 0, -1.0)]), "the weight -1"),
            (Branch::new([Step::new(1, 0, f64::NAN)]), "the weight NaN"),
        ] {
            let refused = StepPattern::new("mine", [diagonal.clone(), branch], Normalisation::None);
            let error = refused.unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
        assert!(StepPattern::new("mine", [], Normalisation::None).is_err());
    }
}
