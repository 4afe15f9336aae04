//! Ranks, intervals, correlations, regret and errors as pure functions.
//!
//! Every function takes slices and returns numbers. Nothing is read, printed or drawn at random. The shape of each
//! input is given in brackets: `[values]` is one number for each hyperparameter value of a grid, in grid order;
//! `[members, values]` is one such row for each member of the ensemble.
//!
//! - [`Direction`]: whether a lower or a higher score is better.
//! - [`summarise`]: mean, sample standard deviation and 95 % t-interval over runs.
//! - [`summarise_clusters`]: the same for clustered runs, such as ensemble members with the same start state;
//!   [`paired_difference`], [`unpaired_difference`], [`error_ratio`]: comparisons of two means or errors.
//! - [`competition_ranks`], [`average_ranks`]: ranks with the two usual rules for ties.
//! - [`select`], [`select_by`]: choices by worst or mean rank, with their tie sets.
//! - [`choose_by_mean_log`]: the smallest mean log error; [`choose_around_default`]: the default, unless another
//!   candidate is clearly better.
//! - [`Losses`]: losses of candidates over several windows, with bounds, and the regret of choosing by another window.
//! - [`upper_bound`], [`cantelli_bound`]: upper bounds of non-negative means; [`jackknife`] and
//!   [`jackknife_of_kinds`]: intervals from estimates without each part of the data; [`ratio_of_sums`]: means over parts of different size; [`summarise_overlapping`]:
//!   windows that share rows.
//! - [`hierarchical`]: how often each candidate is chosen over resamples of ensemble members, windows of the log and
//!   their runs.
//! - [`importance`]: the share of the variance in a grid that one hyperparameter explains.
//! - [`spearman`], [`kendall_tau_b`], [`top_k_hit`]: agreement with the held-out period (Online).
//! - [`pooled_spearman`]: rank correlation within groups.
//! - [`smallest_difference`], [`observations_needed`]: the statistical power of a number of observations.
//! - [`StepErrors`]: one-step prediction errors, beside those of persistence.
//! - [`quantile`], [`median`], [`SortedValues`]: order statistics.
//! - [`wasserstein`], [`autocorrelation_distance`], [`spectral_distance`]: distances of trajectories other than time
//!   warping; [`collapse_step`]: the step at which a trajectory becomes constant.
//!
//! Infinities are results, not mistakes: a diverged run has the error +∞ and ranks last. NaN is a mistake, and always
//! an error.
//!
//! ```
//! use calib_stats::{Direction, Losses, select};
//!
//! // Mean NRMSE of three learning rates in two members.
//! let members = [[0.30, 0.20, 0.50], [0.25, 0.30, f64::INFINITY]];
//! let selection = select(&members, Direction::LowerIsBetter)?;
//! assert_eq!(selection.worst_ranks, [2, 2, 3]);
//! assert_eq!(selection.tie_set, [0, 1]);
//! assert_eq!(selection.chosen, 1); // same mean rank, lower mean error
//!
//! // Mean NRMSE of two held-out windows.
//! let online = Losses::new(&[[0.22, 0.20, 0.90], [0.31, 0.30, 0.80]])?;
//! assert_eq!(online.regret(selection.chosen).map(|regret| regret.value), Some(0.0));
//! # Ok::<(), calib_stats::StatsError>(())
//! ```

mod agreement;
mod bounded;
mod clustered;
mod correlation;
mod default_choice;
mod difference;
mod direction;
pub mod diverged;
mod error;
mod error_ratio;
mod estimate;
mod hierarchical;
mod importance;
mod jackknife;
mod log_choice;
mod losses;
mod nested;
mod one_step;
mod pooled;
mod power;
mod quantile;
mod ranks;
mod ratio;
mod selection;
mod summary;
mod trajectory;

pub use agreement::top_k_hit;
pub use bounded::{Bounded, cantelli_bound, upper_bound};
pub use clustered::{ClusterSummary, cluster_means, summarise_clusters};
pub use correlation::{kendall_tau_b, spearman};
pub use default_choice::{Advantage, DefaultChoice, choose_around_default};
pub use difference::{Difference, paired_difference, unpaired_difference};
pub use direction::Direction;
pub use error::StatsError;
pub use error_ratio::{ErrorRatio, error_ratio};
pub use estimate::Estimate;
pub use hierarchical::{ChoiceOfResamples, hierarchical};
pub use importance::importance;
pub use jackknife::{column_means, jackknife, jackknife_error, jackknife_of_kinds};
pub use log_choice::{LogChoice, choose_by_mean_log};
pub use losses::Losses;
pub use nested::{Drawn, Nested};
pub use one_step::StepErrors;
pub use pooled::pooled_spearman;
pub use power::{observations_needed, smallest_difference};
pub use quantile::{SortedValues, median, quantile};
pub use ranks::{average_ranks, competition_ranks};
pub use ratio::ratio_of_sums;
pub use selection::{RankRule, Selection, select, select_by};
pub use summary::{Interval, Summary, mean, sample_std, summarise, summarise_overlapping};
pub use trajectory::{
    SPECTRUM_FLOOR, autocorrelation, autocorrelation_distance, collapse_step, increments,
    spectral_distance, spectrum, usual_lags, usual_segment, wasserstein,
};
