//! The time warp edit distance, which is a metric unlike the warping distances.

use crate::distance::check;
use crate::kernel::dispatch::InstructionSet;
use crate::kernel::edit::{EditInput, edit_dispatch};
use crate::{DtwError, Series, Settings};

/// The time warp edit distance (TWED): the cost of turning the query into the reference by matching
/// and deleting samples. Unlike warping distances it is a metric.
///
/// With x₀ = y₀ = 0 before the first samples and |·| summed over channels:
///
/// ```text
/// g(0,0) = 0,  g(i,0) = g(0,j) = ∞
/// g(i,j) = min of  g(i-1, j-1) + |x_i - y_j| + |x_(i-1) - y_(j-1)| + 2 stiffness |i - j|
///                  g(i-1, j)   + |x_i - x_(i-1)| + stiffness + deletion
///                  g(i, j-1)   + |y_j - y_(j-1)| + stiffness + deletion
/// ```
///
/// | parameter | default | meaning |
/// |---|---|---|
/// | `stiffness` ν | 0.001 | price of matching samples one step apart in time |
/// | `deletion` λ | 1 | price of a deletion, in addition to the change it removes |
///
/// Source: Marteau, *Time warp edit distance with stiffness adjustment for time series matching*,
/// 2009; the defaults are those of public packages.
///
/// ```
/// use calib_dtw::TimeWarpEdit;
///
/// let query: Vec<f64> = (1..=10).map(f64::from).collect();
/// let reference: Vec<f64> = (11..=20).map(f64::from).collect();
/// let distance = TimeWarpEdit::default().distance(&query, &reference)?;
/// assert!((distance - 46.018).abs() < 1e-12); // as aeon 1.6.0
/// # Ok::<(), calib_dtw::DtwError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeWarpEdit {
    stiffness: f64,
    deletion: f64,
    instruction_set: InstructionSet,
}

impl Default for TimeWarpEdit {
    fn default() -> Self {
        Self { stiffness: 0.001, deletion: 1.0, instruction_set: InstructionSet::best() }
    }
}

impl TimeWarpEdit {
    /// Creates the distance with these prices.
    ///
    /// # Errors
    /// If a price is negative or not finite.
    pub fn new(stiffness: f64, deletion: f64) -> Result<Self, DtwError> {
        for (name, got) in [("stiffness", stiffness), ("deletion", deletion)] {
            if !got.is_finite() || got < 0.0 {
                return Err(DtwError::Price { name, got });
            }
        }
        Ok(Self { stiffness, deletion, ..Self::default() })
    }

    /// Selects an instruction set other than the best. The results are the same.
    ///
    /// # Errors
    /// If the processor lacks it.
    pub fn instruction_set(mut self, set: InstructionSet) -> Result<Self, DtwError> {
        if !InstructionSet::available().contains(&set) {
            let instruction_set = set.name();
            return Err(DtwError::Unsupported { instruction_set });
        }
        self.instruction_set = set;
        Ok(self)
    }

    /// Returns the distance of a pair, in units of the series. Memory grows with N + M.
    ///
    /// # Errors
    /// If a series is empty, not finite or too large, or the channels differ.
    pub fn distance<'a>(
        &self,
        query: impl Into<Series<'a>>,
        reference: impl Into<Series<'a>>,
    ) -> Result<f64, DtwError> {
        let query = query.into();
        let reference = reference.into();
        check(&[], Settings::default(), query, reference)?;
        let n = query.len();
        let m = reference.len();
        let input = EditInput {
            // Each channel is separate, because cells are computed along one channel at a time.
            query: planes(query, false),
            reference: planes(reference, true),
            query_deletions: self.deletions(query, false),
            reference_deletions: self.deletions(reference, true),
            stiffness: self.stiffness,
            lengths: (n, m),
        };
        Ok(edit_dispatch(self.instruction_set, &input))
    }

    /// Returns the price of deleting each sample, `[n + 1]`. The first is the price of the zero
    /// before the series.
    fn deletions(&self, series: Series<'_>, reverse: bool) -> Vec<f64> {
        let zero = vec![0.0; series.channels()];
        let mut prices = vec![f64::INFINITY];
        for index in 0..series.len() {
            let before = if index == 0 { &zero } else { series.sample(index - 1) };
            let changes = series.sample(index).iter().zip(before);
            let change: f64 = changes.map(|(now, before)| (now - before).abs()).sum();
            prices.push(change + (self.stiffness + self.deletion));
        }
        if reverse {
            prices.reverse();
        }
        prices
    }
}

/// Returns the channels of a series one after the other, `[channels][n + 1]`, each beginning with a
/// zero.
fn planes(series: Series<'_>, reverse: bool) -> Vec<Vec<f64>> {
    (0..series.channels())
        .map(|channel: usize| {
            let samples = (0..series.len()).map(|index| series.sample(index)[channel]);
            let mut plane: Vec<f64> = std::iter::once(0.0).chain(samples).collect();
            if reverse {
                plane.reverse();
            }
            plane
        })
        .collect()
}
