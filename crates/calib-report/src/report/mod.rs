//! What a report says, before it is a page.

mod caveats;
mod data;
mod plain;
mod reliance;
mod sentence;
mod simple;
mod summary;
mod table;
mod verdict;

pub use calib_sweep::{ChoiceBaseline, Grade};
pub use caveats::caveats;
pub use data::{Channel, ChannelStatus, DataProfile, JumpStatistics, Reproduction};
pub use sentence::listed;
pub use simple::{SimpleRow, Simpler};
pub(crate) use summary::{are_of_several_models, summary};
pub use table::{Best, Cell, Table};
pub use verdict::{
    Alternative, HeldOutResult, PartRow, Reason, Separation, Sources, TopK, Verdict,
};

use crate::{
    LearningCurves, RecordedFigure, ReportError, RolloutFigure, RolloutGrid, Sensitivity, page,
};

/// Everything the report shows. Empty lists and `None` leave their section out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// Name of the study.
    pub title: String,
    /// One line below it: the plant, the period, who ran it.
    pub subtitle: Option<String>,
    /// What agents predict, and how far ahead.
    pub predicts: Option<String>,
    /// What to deploy where there are several deployments: a choice for each, and one for all.
    pub decision: Option<Table>,
    /// What to deploy, sensor by sensor. Several on one sensor, from several models, stand beside each other:
    /// which of them had the smallest regret is told, and no other preference.
    pub verdicts: Vec<Verdict>,
    /// What the reader must know before trusting the verdict.
    pub warnings: Vec<String>,
    /// Sensitivity curves.
    pub sensitivities: Vec<Sensitivity>,
    /// Learning curves; those of one sensor follow one another, Online first.
    pub learning: Vec<LearningCurves>,
    /// What was recorded of each sensor while it was learned from, and in each deployment.
    pub recorded: Vec<RecordedFigure>,
    /// Rollouts over the true trajectory.
    pub rollouts: Vec<RolloutFigure>,
    /// Rollouts of all models from the same starts, beside what was recorded.
    pub rollout_grids: Vec<RolloutGrid>,
    /// How often rollouts left the log.
    pub jumps: Vec<JumpStatistics>,
    /// Further tables: DTW distances, representation scores.
    pub tables: Vec<Table>,
    /// What the data looked like.
    pub data: Option<DataProfile>,
    /// How to make the report again.
    pub reproduction: Reproduction,
}

impl Report {
    /// Whether a calibration model had a part in any verdict; else the replayed log decided alone.
    pub(crate) fn has_models(&self) -> bool {
        self.verdicts.is_empty() || self.verdicts.iter().any(Verdict::has_model)
    }

    /// The report as one self-contained HTML document: no network, styles, script and figures inline.
    ///
    /// # Errors
    ///
    /// A figure cannot be drawn; see [`Sensitivity::figure`], [`LearningCurves::figure`], [`RecordedFigure::figure`],
    /// [`RolloutFigure::figure`] and [`RolloutGrid::figure`].
    pub fn html(&self) -> Result<String, ReportError> {
        page::html(self)
    }
}
