//! Description of a log of decisions: its actions and rewards, and the states in which it shows the effect of an
//! action.

use calib_base::StepError;
use calib_control::{ActionModel, CoverageMap, Distance, Spread};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::log::Names;

/// Number of parts of a column in the map of coverage.
const PARTS: usize = 5;

/// A log of decisions, as told.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct ActionLogSummary {
    /// What the actions are called, and how the log has them.
    pub(super) actions: Vec<ActionTold>,
    /// What was set, where actions are continuous; the actions are then levels of it, each with the transitions that are nearest to it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) settings: Vec<SettingTold>,
    /// Columns of the states.
    pub(super) columns: Vec<String>,
    pub(super) transitions: usize,
    pub(super) episodes: usize,
    pub(super) terminals: usize,
    /// What neighbours were near in.
    pub(super) distance: Distance,
    /// Distance up to which a recorded transition covers a state.
    pub(super) radius: f32,
    /// Where along each column the log says what each action does.
    pub(super) map: Vec<ColumnMap>,
}

/// A continuous action as the log has it.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct SettingTold {
    pub(super) column: String,
    /// What was set: the least, the 5 %, 50 % and 95 % quantiles, and the largest.
    pub(super) quantiles: [f64; 5],
}

/// An action as the log has it.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct ActionTold {
    pub(super) name: String,
    /// Transitions with it.
    pub(super) transitions: usize,
    /// Share of the recorded states near which it was taken.
    pub(super) covered: f64,
    /// In which states it was taken: the 5 %, 50 % and 95 % quantiles of each column, in its unit; none if it never was.
    pub(super) states: Vec<Spread>,
}

/// Where along a column the log says what each action does.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct ColumnMap {
    pub(super) column: String,
    /// Upper bound of each part, in the unit of the column.
    pub(super) upper: Vec<f64>,
    /// Recorded states in each part, over all members.
    pub(super) states: Vec<usize>,
    /// Share of the states of each part near which the action was taken, `[actions][parts]`.
    pub(super) covered: Vec<Vec<f64>>,
}

/// Describes the log of `model`.
pub(super) fn described(
    model: &ActionModel,
    distance: Distance,
    names: &Names,
) -> Result<ActionLogSummary, StepError> {
    let log = model.log();
    let counted = log.counts().into_iter().zip(model.covered()).zip(log.spreads()?);
    Ok(ActionLogSummary {
        actions: names
            .actions
            .iter()
            .zip(counted)
            .map(|(name, ((transitions, covered), spreads)): (&String, _)| {
                let states = spreads
                    .into_iter()
                    .enumerate()
                    .map(|(place, spread)| spread.map(|value| names.physical(place, value)))
                    .collect();
                ActionTold { name: name.clone(), transitions, covered, states }
            })
            .collect(),
        settings: names.settings.clone(),
        columns: names.columns.clone(),
        transitions: log.len(),
        episodes: log.starts().len(),
        terminals: log.terminals(),
        distance,
        radius: model.radius(),
        map: names
            .columns
            .iter()
            .enumerate()
            .map(|(place, column)| -> Result<ColumnMap, StepError> {
                let CoverageMap { upper, states, covered } = model.coverage_map(place, PARTS)?;
                let upper = upper.into_iter().map(|bound| names.physical(place, bound)).collect();
                Ok(ColumnMap { column: column.clone(), upper, states, covered })
            })
            .collect::<Result<_, _>>()?,
    })
}
