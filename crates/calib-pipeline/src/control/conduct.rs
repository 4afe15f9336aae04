//! The behaviour of the chosen agent after learning: its last steps, and its actions by state.

use std::ops::Range;

use calib_control::{ActionModel, At, ControlConfig, SetPoint, StartRows, Trajectory};
use calib_report::{AgentConduct, ColumnConduct, SetPointValues, SetValues};

use super::{
    described::{ActionLogSummary, ColumnMap},
    log::{Names, start_rows},
};

/// Number of steps that are stored one by one.
const TOLD: usize = 200;
/// Number of state columns that are stored.
const COLUMNS: usize = 4;

/// Returns the rows of the log of decisions in which the states of a trajectory were recorded.
pub(super) fn recorded_rows(
    trajectory: &Trajectory,
    model: &ActionModel,
    start: StartRows,
) -> Vec<usize> {
    let starts = start_rows(model.log(), start);
    let places = trajectory.places.iter();
    let rows = places.map(|&place| match place {
        At::Start(number) => starts[number as usize] as usize,
        At::After(transition) => model.led_to(transition).get(),
    });
    rows.collect()
}

/// Describes a trajectory of an agent of the study. Its states were recorded in these `rows`.
pub(super) fn conduct(
    trajectory: &Trajectory,
    rows: &[usize],
    names: &Names,
    log: &ActionLogSummary,
    config: &ControlConfig,
) -> AgentConduct {
    let steps = trajectory.actions.len();
    let told = steps.saturating_sub(TOLD)..steps;
    let last = LastSteps { trajectory, rows, names, config, told };
    let terms = config.reward.terms();
    let (first, others): (Vec<usize>, Vec<usize>) = (0..log.map.len())
        .partition(|&place| terms.iter().any(|term| term.column == log.map[place].column));
    let count = first.len();
    let columns = first.into_iter().chain(others).take(COLUMNS).enumerate();
    let columns = columns.map(|(number, place)| {
        let values = last.all_values(place);
        let taken = taken(&values, &trajectory.actions, log.actions.len(), &log.map[place]);
        let set_point = terms
            .iter()
            .filter(|term| term.column == taken.column)
            .find_map(|term| last.set_point(term.set_point.as_ref()?));
        ColumnConduct {
            in_reward: number < count,
            set_point,
            values: values[last.told.clone()].to_vec(),
            ..taken
        }
    });
    let acts = config.actions.iter().enumerate();
    AgentConduct {
        steps,
        set: acts
            .map(|(place, column)| SetValues { column: column.clone(), values: last.set(place) })
            .collect(),
        columns: columns.collect(),
        rewards: trajectory.rewards[last.told.clone()].to_vec(),
        begins: last
            .told
            .clone()
            .filter(|&step| trajectory.begins[step])
            .map(|step| step - last.told.start)
            .collect(),
    }
}

/// The last steps of a trajectory.
struct LastSteps<'a> {
    trajectory: &'a Trajectory,
    /// The row of the log in which each state was recorded.
    rows: &'a [usize],
    names: &'a Names,
    config: &'a ControlConfig,
    /// The steps that are stored one by one.
    told: Range<usize>,
}

impl LastSteps<'_> {
    /// Returns the values of a state column in all steps, in its unit.
    fn all_values(&self, place: usize) -> Vec<f64> {
        let states = self.trajectory.states.chunks(self.trajectory.columns);
        states.map(|state| self.names.physical(place, f64::from(state[place]))).collect()
    }

    /// Returns the values that an action column was set to in the last steps.
    fn set(&self, place: usize) -> Vec<f64> {
        let actions = self.trajectory.actions[self.told.clone()].iter();
        actions.map(|&action| self.names.levels[action][place]).collect()
    }

    /// Returns the values of a set-point in the last steps. `None` if it is a column of the log that is missing in one
    /// of them.
    fn set_point(&self, set_point: &SetPoint) -> Option<SetPointValues> {
        let column = match set_point {
            SetPoint::Number(number) => {
                let values = vec![*number; self.told.len()];
                return Some(SetPointValues { column: None, values });
            }
            SetPoint::Column(column) => column,
        };
        let values = if let Some(place) = position(&self.names.columns, column) {
            self.all_values(place)[self.told.clone()].to_vec()
        } else if let Some(place) = position(&self.config.actions, column) {
            self.set(place)
        } else if let Some(constant) = self.names.constants.get(column) {
            vec![*constant; self.told.len()]
        } else {
            self.recorded(column)?
        };
        Some(SetPointValues { column: Some(column.clone()), values })
    }

    /// Returns the set-points that were recorded beside the last states.
    fn recorded(&self, column: &str) -> Option<Vec<f64>> {
        let recorded = self.names.set_points.get(column)?;
        let rows = self.rows.get(self.told.clone())?;
        let values = rows.iter().map(|&row| Some(recorded[row]).filter(|value| value.is_finite()));
        values.collect()
    }
}

fn position(names: &[String], name: &str) -> Option<usize> {
    names.iter().position(|other| other == name)
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
        in_reward: false,
        set_point: None,
        values: Vec::new(),
        upper: map.upper.clone(),
        taken: taken.collect(),
        steps,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use calib_control::{AgentRun, Distance};
    use calib_core::Bounds;

    use super::*;
    use crate::control::described::ActionTold;

    fn names<const N: usize>(names: [&str; N]) -> Vec<String> {
        names.map(str::to_owned).to_vec()
    }

    /// Returns the names of a log with these columns, whose values 0 and 1 are 10 and 20 in its units.
    fn named(columns: &[String]) -> Names {
        Names {
            actions: names(["shut", "open"]),
            settings: Vec::new(),
            columns: columns.to_vec(),
            bounds: vec![Bounds { offset: 10.0, scale: 10.0 }; columns.len()],
            levels: vec![vec![0.0], vec![1.0]],
            ranges: vec![[0.0, 1.0]],
            constants: BTreeMap::from([("fixed".to_owned(), 7.0)]),
            set_points: BTreeMap::new(),
        }
    }

    fn summary(columns: &[String]) -> ActionLogSummary {
        let actions = names(["shut", "open"]).into_iter();
        ActionLogSummary {
            actions: actions
                .map(|name| ActionTold { name, transitions: 0, covered: 0.0, states: Vec::new() })
                .collect(),
            settings: Vec::new(),
            columns: columns.to_vec(),
            transitions: 0,
            episodes: 0,
            terminals: 0,
            distance: Distance::Euclidean,
            radius: 1.0,
            map: columns
                .iter()
                .map(|column| ColumnMap {
                    column: column.clone(),
                    upper: vec![20.0],
                    states: vec![0],
                    covered: Vec::new(),
                })
                .collect(),
        }
    }

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

    #[test]
    fn columns_of_the_reward_come_first_and_have_the_set_points_of_their_terms() {
        let columns = names(["ambient", "target", "level", "flow", "pressure", "heat"]);
        let config: ControlConfig = toml::from_str(
            r#"
            actions = ["valve"]
            reward = [
                { column = "level", weight = 2.0 },
                { column = "level", set_point = "target" },
                { column = "flow", set_point = "valve" },
                { column = "pressure", set_point = "fixed" },
                { column = "heat", set_point = "elsewhere" },
                { column = "heat", set_point = 5.0 },
            ]
            "#,
        )
        .expect("valid");
        let trajectory = Trajectory {
            run: AgentRun::default(),
            columns: columns.len(),
            states: vec![0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.25, 1.0, 0.0, 0.0, 0.0],
            places: Vec::new(),
            actions: vec![1, 0],
            rewards: vec![-1.0, -2.0],
            begins: vec![false, true],
        };
        let log = summary(&columns);
        let told = conduct(&trajectory, &[], &named(&columns), &log, &config);
        let set_points = told.columns.iter().map(|own| {
            let set_point = own.set_point.as_ref().expect("every column has one");
            let name = set_point.column.as_deref().unwrap_or("a number");
            format!("{}: {name} {:?}", own.column, set_point.values)
        });
        assert_eq!(
            set_points.collect::<Vec<_>>(),
            [
                "level: target [15.0, 12.5]",
                "flow: valve [1.0, 0.0]",
                "pressure: fixed [7.0, 7.0]",
                "heat: a number [5.0, 5.0]",
            ]
        );
        assert!(told.columns.iter().all(|own| own.in_reward));
        assert_eq!(told.columns[0].values, [20.0, 20.0]);
        assert_eq!(told.set[0].values, [1.0, 0.0]);
        assert_eq!(told.begins, [1]);
        // A recorded reward is about no column of the state.
        let recorded = conduct(&trajectory, &[], &named(&columns), &log, &ControlConfig::default());
        assert!(recorded.columns.iter().all(|own| !own.in_reward && own.set_point.is_none()));
        assert_eq!(recorded.columns.len(), COLUMNS);
    }

    #[test]
    fn a_set_point_beside_the_state_is_that_of_the_rows_of_the_states() {
        let columns = names(["level"]);
        let config: ControlConfig = toml::from_str(
            r#"
            actions = ["valve"]
            reward = [{ column = "level", set_point = "target" }]
            "#,
        )
        .expect("valid");
        let trajectory = Trajectory {
            run: AgentRun::default(),
            columns: 1,
            states: vec![0.0, 0.5],
            places: vec![At::Start(0), At::After(1)],
            actions: vec![0, 0],
            rewards: vec![0.0, 0.0],
            begins: vec![true, false],
        };
        let log = summary(&columns);
        let drawn = |target: [f64; 3]| {
            let mut names = named(&columns);
            names.set_points.insert("target".to_owned(), target.to_vec());
            conduct(&trajectory, &[0, 2], &names, &log, &config).columns[0].set_point.clone()
        };
        let values = vec![12.0, 14.0];
        let expected = SetPointValues { column: Some("target".to_owned()), values };
        assert_eq!(drawn([12.0, 13.0, 14.0]), Some(expected.clone()));
        assert_eq!(drawn([12.0, f64::NAN, 14.0]), Some(expected));
        assert_eq!(drawn([12.0, 13.0, f64::NAN]), None, "no line has a gap");
    }
}
