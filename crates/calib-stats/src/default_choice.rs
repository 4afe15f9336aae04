//! A selection method that stays at the default unless another candidate is clearly better.

use serde::{Deserialize, Serialize};

use crate::log_choice::{logs, mean_log};
use crate::{StatsError, sample_std};

/// The advantage of a candidate over the default.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Advantage {
    /// Mean over streams of ln (error of the default / error of the candidate). Above 0 the candidate is better. +∞ if
    /// only the default diverged, −∞ if only the candidate diverged.
    #[serde(with = "crate::diverged")]
    pub mean: f64,
    /// Standard error of the mean. `None` for one stream and for an infinite mean.
    pub standard_error: Option<f64>,
}

impl Advantage {
    /// Whether the candidate is better by at least one standard error, or by any amount if the mean is infinite.
    fn is_told(&self) -> bool {
        match self.standard_error {
            Some(error) => self.mean > 0.0 && self.mean >= error,
            None => self.mean == f64::INFINITY,
        }
    }
}

/// The result of a choice around a default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DefaultChoice {
    /// Index of the chosen candidate: the default, or a better one.
    pub chosen: usize,
    /// The advantage of each candidate over the default. `None` for the default, and for a candidate if both diverged.
    pub advantages: Vec<Option<Advantage>>,
}

/// Chooses the default from `sources` `[source][stream][candidate]` unless another candidate is better by at least one
/// standard error. Of those candidates it then chooses the one with the smallest mean log error over all streams.
///
/// With d = ln error of the default − ln error of the candidate, stream by stream, a candidate is better if d̄ > 0 and
/// d̄ ≥ SE, where SE = s(d) / √(n / `streams_per_independent`). Streams of one study share start states, members and
/// data, so n streams count as fewer independent ones. The measured ratio is 3 to 1 for members with three runs each.
/// With one stream there is no standard error, and the default stays. A candidate that diverged anywhere is never
/// better. A candidate that did not diverge is better than a default that did. Source: the one-standard-error rule of
/// Breiman et al. (1984, section 3.4.3), with the default in the place of the simplest model. Paired differences and
/// the effective number are our choice.
///
/// # Errors
///
/// As [`choose_by_mean_log`](crate::choose_by_mean_log); `default` is out of range, or `streams_per_independent` is not
/// at least 1.
pub fn choose_around_default<Source, Row>(
    sources: &[Source],
    default: usize,
    streams_per_independent: f64,
) -> Result<DefaultChoice, StatsError>
where
    Source: AsRef<[Row]>,
    Row: AsRef<[f64]>,
{
    let logs = logs(sources)?;
    let candidates = logs[0].len();
    if default >= candidates {
        let what = "candidates";
        return Err(StatsError::OutOfRange { what, index: default, len: candidates });
    }
    if !(streams_per_independent >= 1.0 && streams_per_independent.is_finite()) {
        return Err(StatsError::EffectiveNumber { got: streams_per_independent });
    }
    let advantages = (0..candidates)
        .map(|candidate: usize| -> Result<Option<Advantage>, StatsError> {
            if candidate == default {
                return Ok(None);
            }
            advantage(&logs, candidate, default, streams_per_independent)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let better = (0..candidates)
        .filter(|&candidate| advantages[candidate].is_some_and(|advantage| advantage.is_told()));
    let chosen = better.min_by(|&a, &b| mean_log(&logs, a).total_cmp(&mean_log(&logs, b)));
    let chosen = chosen.unwrap_or(default);
    Ok(DefaultChoice { chosen, advantages })
}

fn advantage(
    logs: &[Vec<f64>],
    candidate: usize,
    default: usize,
    streams_per_independent: f64,
) -> Result<Option<Advantage>, StatsError> {
    let own = mean_log(logs, candidate);
    let others = mean_log(logs, default);
    if own == others && own.is_infinite() {
        return Ok(None);
    }
    if own.is_infinite() || others.is_infinite() {
        return Ok(Some(Advantage { mean: others - own, standard_error: None }));
    }
    let differences: Vec<f64> =
        logs.iter().map(|stream| stream[default] - stream[candidate]).collect();
    let n = differences.len() as f64;
    let standard_error =
        sample_std(&differences)?.map(|std| std / (n / streams_per_independent).sqrt());
    Ok(Some(Advantage { mean: differences.iter().sum::<f64>() / n, standard_error }))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::choose_by_mean_log;

    const INF: f64 = f64::INFINITY;

    /// Returns errors of two candidates with the log ratios `d`: the default's error over the other's.
    fn streams(d: &[f64]) -> Vec<[f64; 2]> {
        d.iter().map(|d| [d.exp(), 1.0]).collect()
    }

    fn around(d: &[f64], streams_per_independent: f64) -> DefaultChoice {
        choose_around_default(&[streams(d)], 0, streams_per_independent).unwrap()
    }

    #[test]
    fn a_default_stays_unless_another_is_one_standard_error_better() {
        // Mean 1, s = 1, n = 3: SE = 1/sqrt 3, or 1 if three streams count as one.
        assert_eq!(around(&[0.0, 1.0, 2.0], 1.0).chosen, 1);
        assert_eq!(around(&[-0.1, 1.0, 2.1], 3.0).chosen, 0);
        let advantage = around(&[0.0, 1.0, 2.0], 3.0).advantages[1].unwrap();
        assert!((advantage.mean - 1.0).abs() < 1e-12);
        assert!((advantage.standard_error.unwrap() - 1.0).abs() < 1e-12);
        assert_eq!(around(&[-0.5, -0.5], 1.0).chosen, 0, "worse");
        assert_eq!(around(&[0.5, 0.5], 3.0).chosen, 1, "better everywhere, without spread");
        assert_eq!(around(&[0.0, 0.0], 3.0).chosen, 0, "equal");
        assert_eq!(around(&[0.5], 1.0).chosen, 0, "one stream has no standard error");
    }

    #[test]
    fn of_those_that_are_better_the_best_is_taken() {
        // Candidate 2 has the smallest mean, but with a large standard error. Candidate 1 is slightly but clearly
        // better than the default.
        let streams = [[1.0, 0.9, 0.01], [1.0, 0.9, 3.0], [1.0, 0.9, 3.0]];
        assert_eq!(choose_by_mean_log(&[streams]).unwrap().chosen, Some(2));
        assert_eq!(choose_around_default(&[streams], 0, 3.0).unwrap().chosen, 1);
        let streams = [[1.0, 0.9, 0.5], [1.0, 0.9, 0.5]];
        assert_eq!(choose_around_default(&[streams], 0, 3.0).unwrap().chosen, 2);
    }

    /// Returns the choice around the first candidate.
    fn choice(streams: &[[f64; 3]]) -> DefaultChoice {
        choose_around_default(&[streams], 0, 3.0).unwrap()
    }

    #[test]
    fn divergence_around_a_default() {
        assert_eq!(choice(&[[INF, 0.5, INF], [0.1, 0.5, 0.1]]).chosen, 1);
        let all = choice(&[[INF, INF, 0.1], [0.1, 0.5, INF]]);
        assert_eq!((all.chosen, all.advantages), (0, vec![None; 3]));
        let others = choice(&[[0.9, INF, 0.9], [0.9, 0.1, 0.9]]);
        assert_eq!((others.chosen, others.advantages[1].unwrap().mean), (0, -INF));
    }

    #[test]
    fn bad_input_is_an_error() {
        let streams = [[[1.0, 2.0]]];
        let range = choose_around_default(&streams, 2, 3.0);
        assert!(matches!(range, Err(StatsError::OutOfRange { index: 2, .. })));
        for got in [0.5, INF, f64::NAN] {
            let number = choose_around_default(&streams, 0, got);
            assert!(matches!(number, Err(StatsError::EffectiveNumber { .. })), "{got}");
        }
    }

    proptest! {
        /// With fewer independent streams, the choice never leaves a default where it stays with more.
        #[test]
        fn fewer_independent_streams_move_less(
            d in prop::collection::vec(-2.0f64..2.0, 2..12), one in 1.0f64..5.0, more in 0.0f64..5.0
        ) {
            let (few, many) = (around(&d, one + more), around(&d, one));
            prop_assert!(few.chosen <= many.chosen);
        }
    }
}
