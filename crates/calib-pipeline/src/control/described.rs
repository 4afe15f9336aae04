//! Description of a log of decisions: its actions and rewards, and the states in which it shows the effect of an
//! action.

use calib_base::StepError;
use calib_control::{ActionModel, CoverageMap, Distance, Spread};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::log::{Names, SettingTold};

/// Number of parts of a column in the map of coverage.
const PARTS: usize = 5;

/// Summary of a log with actions.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct ActionLogSummary {
    /// Names and statistics of the actions.
    pub(super) actions: Vec<ActionTold>,
    /// Recorded values of continuous action columns. The actions are then levels of these, each with its nearest transitions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) settings: Vec<SettingTold>,
    /// Columns of the states.
    pub(super) columns: Vec<String>,
    pub(super) transitions: usize,
    pub(super) episodes: usize,
    pub(super) terminals: usize,
    /// The space in which distances between states were measured.
    pub(super) distance: Distance,
    /// Distance up to which a recorded transition covers a state.
    pub(super) radius: f32,
    /// Where along each column the log covers each action.
    pub(super) map: Vec<ColumnMap>,
}

/// An action in the log.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct ActionTold {
    pub(super) name: String,
    /// Number of transitions with the action.
    pub(super) transitions: usize,
    /// Share of the recorded states near which the action was taken.
    pub(super) covered: f64,
    /// States in which the action was taken: the 5 %, 50 % and 95 % quantiles of each column, in its unit; empty if it was never taken.
    pub(super) states: Vec<Spread>,
}

/// Coverage of each action along one column.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct ColumnMap {
    pub(super) column: String,
    /// Upper bound of each part, in the unit of the column.
    pub(super) upper: Vec<f64>,
    /// Number of recorded states in each part, over all ensemble members.
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
