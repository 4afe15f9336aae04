//! Describes which actions a log took, and in which states.

use calib_core::TransitionIndex;
use calib_stats::SortedValues;

use crate::{ActionModel, ControlError, Decisions, FEW_STEPS};

/// The states in which an action was taken: the 5 %, 50 % and 95 % quantiles of a column.
pub type Spread = [f64; 3];

/// An action with at least one step in this many is not rare in a short log. Our choice: 5 %.
const STEPS_TO_ONE: usize = 20;

/// Returns the actions that were taken in no step, or in few steps that are a small share of all. `counts` has the steps of each action.
pub fn hardly_taken(counts: &[usize]) -> Vec<usize> {
    let steps: usize = counts.iter().sum();
    let taken = counts.iter().copied().enumerate();
    taken
        .filter(|&(_, taken)| taken < FEW_STEPS && taken * STEPS_TO_ONE < steps)
        .map(|(action, _)| action)
        .collect()
}

impl Decisions {
    /// Returns the states in which each action was taken, `[actions][columns]`. An action that was never taken has no columns.
    ///
    /// # Errors
    /// If a state is NaN.
    pub fn spreads(&self) -> Result<Vec<Vec<Spread>>, ControlError> {
        (0..self.levels()).map(|action| self.spread(action)).collect()
    }

    fn spread(&self, action: usize) -> Result<Vec<Spread>, ControlError> {
        let sources = self.transitions().sources();
        let rows: Vec<usize> = self
            .with_action(action)
            .iter()
            .map(|&transition| sources[transition as usize] as usize)
            .collect();
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        (0..self.states().columns())
            .map(|column: usize| -> Result<Spread, ControlError> {
                let values = rows.iter().map(|&row| f64::from(self.states().row(row)[column]));
                let values = SortedValues::new(values.collect())?;
                Ok([values.quantile(0.05)?, values.quantile(0.5)?, values.quantile(0.95)?])
            })
            .collect()
    }
}

/// The coverage of each action along one column.
#[derive(Clone, Debug, PartialEq)]
pub struct CoverageMap {
    /// Upper bound of each part of the column, in scaled units. Parts are bounded by quantiles.
    pub upper: Vec<f64>,
    /// Number of recorded states in each part, over all ensemble members.
    pub states: Vec<usize>,
    /// Share of the states of a part that have a transition with the action within the radius, `[actions][parts]`.
    pub covered: Vec<Vec<f64>>,
}

impl ActionModel {
    /// Computes the coverage of each action along `column`: the recorded states form `parts` parts with about as many states each.
    ///
    /// Parts that would be empty, because many values are equal, are left out.
    ///
    /// # Errors
    /// If a state is NaN.
    ///
    /// # Panics
    /// If there is no such column.
    pub fn coverage_map(&self, column: usize, parts: usize) -> Result<CoverageMap, ControlError> {
        let log = self.log();
        let values: Vec<f64> = (0..log.len())
            .map(|number: usize| {
                let next = log.transitions().next(TransitionIndex::new(number));
                f64::from(log.states().row(next.get())[column])
            })
            .collect();
        let sorted = SortedValues::new(values.clone())?;
        let mut upper = (1..=parts)
            .map(|part| sorted.quantile(part as f64 / parts as f64))
            .collect::<Result<Vec<f64>, _>>()?;
        upper.dedup();
        let mut states = vec![0; upper.len()];
        let mut covered = vec![vec![0.0; upper.len()]; log.levels()];
        self.each_within(|transition, within| {
            let part = upper.partition_point(|&bound| bound < values[transition.get()]);
            let part = part.min(upper.len() - 1);
            states[part] += 1;
            for (own, &within) in covered.iter_mut().zip(within) {
                own[part] += f64::from(u8::from(within));
            }
        });
        for own in &mut covered {
            own.iter_mut().zip(&states).for_each(|(own, &all)| *own /= all.max(1) as f64);
        }
        Ok(CoverageMap { upper, states, covered })
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Seed, Segments, States};

    use super::*;
    use crate::{ActionModelConfig, Columns, Ending, model::tests::built};

    /// Returns a log in which action 1 occurs only in the upper half of a column from 0 to 1.
    fn log() -> Decisions {
        let mut rng = Seed::new(1).rng();
        let rows = 1200;
        let values: Vec<f32> = (0..rows).map(|_| rng.unit() as f32).collect();
        let actions: Vec<Option<u16>> = values
            .iter()
            .map(|&value| Some(if value > 0.5 { rng.below(2) as u16 } else { 0 }))
            .collect();
        let columns = Columns {
            actions: &actions,
            rewards: &vec![1.0; rows],
            endings: &vec![Ending::Continues; rows],
        };
        let states = States::new(values, rows, 1).expect("valid");
        Decisions::new(states, &Segments::from_lengths([rows]).expect("valid"), columns, 3)
            .expect("valid")
    }

    #[test]
    fn spreads_are_where_an_action_was_taken() {
        let spreads = log().spreads().expect("numbers");
        let [low, middle, high] = spreads[1][0];
        assert!(low > 0.5 && (0.7..0.8).contains(&middle) && high > 0.95, "{spreads:?}");
        assert!(spreads[0][0][0] < 0.1);
        assert!(spreads[2].is_empty(), "never taken");
    }

    #[test]
    fn actions_with_few_steps_are_hardly_taken() {
        assert_eq!(hardly_taken(&[500, 3, 30, 0]), [1, 3]);
        assert!(hardly_taken(&[23, 13, 20]).is_empty(), "a short log, whose actions are not rare");
        assert_eq!(hardly_taken(&[54, 2]), [1], "below 5 %");
    }

    #[test]
    fn the_map_shows_where_an_action_is_not_known() {
        let model = built(log(), 5, &ActionModelConfig::default(), 0.0);
        let map = model.coverage_map(0, 5).expect("numbers");
        assert_eq!(map.states.len(), 5);
        assert_eq!(map.covered[2], [0.0; 5]);
        assert!(map.covered[0].iter().all(|&share| share > 0.9), "{map:?}");
        assert!(map.covered[1][0] == 0.0 && map.covered[1][4] > 0.8, "{map:?}");
        // The parts together give the coverage of the whole log.
        let all: usize = map.states.iter().sum();
        for (action, whole) in model.covered().into_iter().enumerate() {
            let parts = map.covered[action].iter().zip(&map.states);
            let sum: f64 = parts.map(|(share, &states)| share * states as f64).sum();
            assert!((sum / all as f64 - whole).abs() < 1e-9);
        }
    }
}
