//! The behaviour of the chosen agent after learning: its last steps, and its actions by state.

use calib_control::Trajectory;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    described::{ActionLogSummary, ColumnMap},
    log::Names,
};

/// Number of steps that are stored one by one.
const TOLD: usize = 200;
/// Number of state columns that are stored.
const COLUMNS: usize = 4;

/// Behaviour of the chosen agent at the end of its first run, in the neighbour model of the first ensemble
/// member.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(super) struct AgentConduct {
    /// Number of steps that `taken` counts: the last quarter of the run.
    pub(super) steps: usize,
    /// Values that each action column was set to in the last steps.
    pub(super) set: Vec<SetValues>,
    /// Columns of the states, those of the reward first.
    pub(super) columns: Vec<ColumnConduct>,
    /// Rewards of the last steps.
    pub(super) rewards: Vec<f64>,
    /// Indices of the last steps at which an episode begins.
    pub(super) begins: Vec<usize>,
}

/// A column of the actions.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(super) struct SetValues {
    pub(super) column: String,
    pub(super) values: Vec<f64>,
}

/// A column of the states, in its unit.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(super) struct ColumnConduct {
    pub(super) column: String,
    /// Values in the last steps.
    pub(super) values: Vec<f64>,
    /// Upper bounds of the parts of the recorded range.
    pub(super) upper: Vec<f64>,
    /// Number of the agent's steps in each part.
    pub(super) steps: Vec<usize>,
    /// Share of these steps in which the action was taken, `[actions][parts]`; 0 in parts that the agent
    /// never visited.
    pub(super) taken: Vec<Vec<f64>>,
}

/// Describes a trajectory. `of_reward` are the columns that the reward depends on, `acts` the action columns.
pub(super) fn conduct(
    trajectory: &Trajectory,
    names: &Names,
    log: &ActionLogSummary,
    of_reward: &[String],
    acts: &[String],
) -> AgentConduct {
    let steps = trajectory.actions.len();
    let told = steps.saturating_sub(TOLD)..steps;
    let set = acts.iter().enumerate().map(|(place, column)| SetValues {
        column: column.clone(),
        values: trajectory.actions[told.clone()]
            .iter()
            .map(|&action| names.levels[action][place])
            .collect(),
    });
    let (first, others): (Vec<usize>, Vec<usize>) =
        (0..log.map.len()).partition(|&place| of_reward.contains(&log.map[place].column));
    let columns = first.into_iter().chain(others).take(COLUMNS).map(|place| {
        let values: Vec<f64> = trajectory
            .states
            .chunks(trajectory.columns)
            .map(|state| names.physical(place, f64::from(state[place])))
            .collect();
        let taken = taken(&values, &trajectory.actions, log.actions.len(), &log.map[place]);
        ColumnConduct { values: values[told.clone()].to_vec(), ..taken }
    });
    AgentConduct {
        steps,
        set: set.collect(),
        columns: columns.collect(),
        rewards: trajectory.rewards[told.clone()].to_vec(),
        begins: told
            .clone()
            .filter(|&step| trajectory.begins[step])
            .map(|step| step - told.start)
            .collect(),
    }
}

/// Returns the share of each action in each part of a column.
fn taken(values: &[f64], chosen: &[usize], actions: usize, map: &ColumnMap) -> ColumnConduct {
    let parts = map.upper.len();
    let mut counts = vec![vec![0_usize; parts]; actions];
    for (value, &action) in values.iter().zip(chosen) {
        let part = map.upper.iter().position(|upper| value <= upper).unwrap_or(parts - 1);
        counts[action][part] += 1;
    }
    let steps: Vec<usize> =
        (0..parts).map(|part| counts.iter().map(|own| own[part]).sum()).collect();
    let taken = counts.iter().map(|own| {
        let parts = own.iter().zip(&steps);
        parts.map(|(&count, &steps)| count as f64 / steps.max(1) as f64).collect()
    });
    ColumnConduct {
        column: map.column.clone(),
        values: Vec::new(),
        upper: map.upper.clone(),
        taken: taken.collect(),
        steps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_of_the_steps_in_a_part() {
        let map = ColumnMap {
            column: "level".to_owned(),
            upper: vec![1.0, 2.0, 3.0],
            states: vec![0; 3],
            covered: Vec::new(),
        };
        // A value beyond the recorded range belongs to the last part.
        let told = taken(&[0.5, 0.7, 1.0, 3.5], &[0, 1, 1, 1], 2, &map);
        assert_eq!(told.steps, [3, 0, 1]);
        assert_eq!(told.taken, [vec![1.0 / 3.0, 0.0, 0.0], vec![2.0 / 3.0, 0.0, 1.0]]);
    }
}
