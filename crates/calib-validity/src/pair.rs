//! What is known of one sensor of one plant.

use calib_stats::{Direction, Selection, regret};
use serde::Serialize;

use crate::ValidityError;

/// A sensor of a plant whose held-out data was replayed Online.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The plant: the unit of all intervals.
    pub plant: String,
    /// The predicted sensor.
    pub sensor: String,
    /// Mean error Online of each value of the grid, `[values]`; infinite if a run diverged.
    pub online: Vec<f64>,
    /// The value that one would use without calib, if the grid has it.
    pub default: Option<usize>,
    /// The value that is best on the replayed log.
    pub log_replay: Option<usize>,
    /// What each model chose.
    pub models: Vec<ModelPair>,
}

/// A calibration model, and what is known of it, on one sensor of one plant.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelPair {
    /// Its name.
    pub model: String,
    /// Ranks and errors of the values in its members, and its choice.
    pub selection: Selection,
    /// Spearman's correlation of its ranking with the Online errors.
    pub spearman: Option<f64>,
    /// RMSE of one-step predictions of the sensor on held-out data, normalised units.
    pub one_step: Option<f64>,
    /// The same divided by that of predicting no change.
    pub one_step_relative: Option<f64>,
    /// RMSE of one-step predictions of all columns.
    pub one_step_all: Option<f64>,
    /// Mean normalised warping distance of its rollouts from what was recorded.
    pub dtw: Option<f64>,
}

/// How ranks in the members become one choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// The smallest worst rank (the paper's).
    WorstRank,
    /// The smallest mean rank.
    MeanRank,
    /// The smallest mean error.
    MeanError,
}

impl Rule {
    /// All of them, the paper's first.
    pub const ALL: [Self; 3] = [Self::WorstRank, Self::MeanRank, Self::MeanError];

    /// The name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::WorstRank => "worst_rank",
            Self::MeanRank => "mean_rank",
            Self::MeanError => "mean_error",
        }
    }

    /// What this rule chooses; ties go as in the selection: worst rank, mean rank, mean error, order of the grid.
    pub fn choose(self, selection: &Selection) -> usize {
        let Selection { worst_ranks, mean_ranks, mean_errors, .. } = selection;
        let key = |value: usize| match self {
            Self::WorstRank => [worst_ranks[value] as f64, mean_ranks[value], mean_errors[value]],
            Self::MeanRank => [mean_ranks[value], mean_errors[value], 0.0],
            Self::MeanError => [mean_errors[value], mean_ranks[value], 0.0],
        };
        let before = |&a: &usize, &b: &usize| {
            let pairs = key(a).into_iter().zip(key(b));
            pairs
                .map(|(a, b)| a.total_cmp(&b))
                .find(|order| order.is_ne())
                .unwrap_or_else(|| a.cmp(&b))
        };
        (0..worst_ranks.len()).min_by(before).unwrap_or(0)
    }
}

impl Pair {
    /// Regret of each value, `[values]`: (its Online error − the smallest) / the smallest; infinite for values that
    /// diverged. `None` if all did.
    pub(crate) fn regrets(&self) -> Result<Option<Vec<f64>>, ValidityError> {
        let of = |value| regret(&self.online, value, Direction::LowerIsBetter);
        Ok((0..self.online.len()).map(of).collect::<Result<Option<Vec<f64>>, _>>()?)
    }

    /// That every choice is one of `values` values, and there are as many Online errors.
    pub(crate) fn check(&self, values: usize) -> Result<(), ValidityError> {
        let (plant, sensor) = (self.plant.clone(), self.sensor.clone());
        if self.online.len() != values {
            let got = self.online.len();
            return Err(ValidityError::Values { plant, sensor, expected: values, got });
        }
        let models = self.models.iter().map(|of| (of.model.as_str(), Some(of.selection.chosen)));
        let others = [("the default", self.default), ("log replay", self.log_replay)];
        match models.chain(others).find(|(_, choice)| choice.is_some_and(|of| of >= values)) {
            Some((whose, Some(got))) => {
                let whose = whose.to_owned();
                Err(ValidityError::Choice { plant, sensor, whose, got, values })
            }
            _ => Ok(()),
        }
    }

    /// The model called `name`.
    pub(crate) fn model(&self, name: &str) -> Option<&ModelPair> {
        self.models.iter().find(|of| of.model == name)
    }
}

#[cfg(test)]
mod tests {
    use calib_stats::select;

    use super::*;

    #[test]
    fn rules_differ_where_one_member_disagrees() {
        // Value 0 is best in two members and last in one; value 1 is second everywhere; value 2 has the smallest mean error.
        let members = [[0.10, 0.20, 0.21], [0.10, 0.20, 0.21], [0.90, 0.20, 0.10]];
        let selection = select(&members, Direction::LowerIsBetter).unwrap();
        assert_eq!(selection.worst_ranks, [3, 2, 3]);
        assert_eq!(Rule::WorstRank.choose(&selection), 1);
        assert_eq!(Rule::WorstRank.choose(&selection), selection.chosen);
        assert_eq!(Rule::MeanRank.choose(&selection), 0, "mean ranks 5/3, 2, 7/3");
        assert_eq!(Rule::MeanError.choose(&selection), 2, "means 0.367, 0.2, 0.173");
    }

    #[test]
    fn regrets_by_hand() {
        let mut pair = Pair {
            plant: "a".to_owned(),
            sensor: "s".to_owned(),
            online: vec![0.5, 0.4, f64::INFINITY],
            default: None,
            log_replay: Some(3),
            models: Vec::new(),
        };
        let regrets = pair.regrets().unwrap().unwrap();
        assert!((regrets[0] - 0.25).abs() < 1e-12);
        assert_eq!(&regrets[1..], [0.0, f64::INFINITY]);
        let error = pair.check(3).unwrap_err().to_string();
        assert_eq!(error, "s of a: the choice of log replay is value 3, but there are 3");
        assert!(pair.check(2).unwrap_err().to_string().contains("3 values, expected 2"));
        pair.online = vec![f64::INFINITY; 2];
        assert_eq!(pair.regrets(), Ok(None));
    }
}
