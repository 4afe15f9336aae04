//! All content of a report, as typed rows.

use super::{DataProfile, JumpStatistics, Reproduction, Table, Verdict};
use crate::{LearningCurves, RecordedFigure, RolloutFigure, RolloutGrid, Sensitivity};

/// All content of the report. Empty lists and `None` leave their section out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// Name of the study.
    pub title: String,
    /// One line below the title: the plant, the period, the author.
    pub subtitle: Option<String>,
    /// Predicted quantity, and how far ahead.
    pub predicts: Option<String>,
    /// What to deploy if there are several deployments: one choice per deployment, and one for all.
    pub decision: Option<Table>,
    /// What to deploy, one verdict per sensor and model. The report says which model had the smallest regret
    /// on a sensor, and states no other preference.
    pub verdicts: Vec<Verdict>,
    /// Warnings to read before trusting the verdicts.
    pub warnings: Vec<String>,
    /// Sensitivity curves.
    pub sensitivities: Vec<Sensitivity>,
    /// Learning curves; those of one sensor are adjacent, the held-out period first.
    pub learning: Vec<LearningCurves>,
    /// Recorded values of each sensor in the training range and in each deployment.
    pub recorded: Vec<RecordedFigure>,
    /// Rollouts over the true trajectory.
    pub rollouts: Vec<RolloutFigure>,
    /// Rollouts of all models from the same start states, beside the record.
    pub rollout_grids: Vec<RolloutGrid>,
    /// Jump statistics of the rollouts.
    pub jumps: Vec<JumpStatistics>,
    /// Further tables: DTW distances, representation scores.
    pub tables: Vec<Table>,
    /// Summary of the data.
    pub data: Option<DataProfile>,
    /// Instructions to make the report again.
    pub reproduction: Reproduction,
}

impl Report {
    /// Whether a calibration model contributed to any verdict. Otherwise log replay decided alone.
    pub(crate) fn has_models(&self) -> bool {
        self.verdicts.is_empty() || self.verdicts.iter().any(Verdict::has_model)
    }
}
