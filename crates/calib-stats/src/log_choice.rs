//! Choices by the logarithm of errors.

use serde::{Deserialize, Serialize};

use crate::error::check;
use crate::{StatsError, sample_std};

/// The candidate with the smallest mean log error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogChoice {
    /// Index of the candidate; `None` if all diverged somewhere.
    pub chosen: Option<usize>,
    /// Mean over streams of the logarithm of each candidate's error (`null` in files for +∞, `"-inf"` for −∞).
    #[serde(with = "crate::diverged::each")]
    pub mean_logs: Vec<f64>,
}

/// Chooses from `sources` `[source][stream][candidate]`, such as members and log replay, the candidate with the smallest
/// mean of ln error over all streams, pooled: a stream counts alike whatever its source.
///
/// +∞ if the candidate diverged in any stream, which then outweighs errors of 0, whose logarithm is −∞. Ties go to the earlier
/// candidate. Against the mean of errors, streams on which all errors are large do not outvote the others: only quotients matter.
/// Source: our choice, measured beside the worst rank.
///
/// # Errors
///
/// There are no streams or no candidates, streams differ in their number of candidates, or an error is NaN or negative.
pub fn choose_by_mean_log<Source, Row>(sources: &[Source]) -> Result<LogChoice, StatsError>
where
    Source: AsRef<[Row]>,
    Row: AsRef<[f64]>,
{
    let logs = logs(sources)?;
    let mean_logs = (0..logs[0].len()).map(|candidate| mean_log(&logs, candidate)).collect();
    Ok(choice(mean_logs))
}

fn choice(mean_logs: Vec<f64>) -> LogChoice {
    let able = |&candidate: &usize| mean_logs[candidate] < f64::INFINITY;
    let chosen = (0..mean_logs.len()).filter(able);
    let chosen = chosen.min_by(|&a, &b| mean_logs[a].total_cmp(&mean_logs[b]));
    LogChoice { chosen, mean_logs }
}

/// How much better than the default a candidate is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Advantage {
    /// Mean over streams of ln (error of the default / error of the candidate): above 0 the candidate is better. +∞ where
    /// the default diverged and the candidate did not, −∞ the other way round.
    #[serde(with = "crate::diverged")]
    pub mean: f64,
    /// Standard error of the mean; `None` for one stream and an infinite mean.
    pub standard_error: Option<f64>,
}

impl Advantage {
    /// Better by at least one standard error; by anything at all where the mean is infinite.
    fn is_told(&self) -> bool {
        match self.standard_error {
            Some(error) => self.mean > 0.0 && self.mean >= error,
            None => self.mean == f64::INFINITY,
        }
    }
}

/// A choice around a default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DefaultChoice {
    /// Index of the chosen candidate: the default, or a better one.
    pub chosen: usize,
    /// The advantage over the default of each candidate; `None` for the default, and for those that diverged as it did.
    pub advantages: Vec<Option<Advantage>>,
}

/// Stays at candidate `default` of `sources` `[source][stream][candidate]` unless another is better by at least one standard error;
/// then takes the one of these with the smallest mean log error over all streams.
///
/// With d = ln error of the default − ln error of the candidate, stream by stream: better if d̄ > 0 and d̄ ≥ SE, SE = s(d) / √(n / `streams_per_independent`).
/// Streams of one study share start states, members and data, so n of them are worth fewer: 3 in one is what was measured
/// of members with three runs each. With one stream there is no standard error, and the default stays. A candidate that diverged anywhere is never better; one that did not
/// is better than a default that did. Source: the one-standard-error rule of Breiman et al. (1984, section 3.4.3), with the default in the place of the simplest
/// model; paired differences and the effective number are our choice.
///
/// # Errors
///
/// As [`choose_by_mean_log`]; `default` is out of range, or `streams_per_independent` is not at least 1.
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
    let of = |candidate: usize| -> Result<Option<Advantage>, StatsError> {
        if candidate == default {
            return Ok(None);
        }
        advantage(&logs, candidate, default, streams_per_independent)
    };
    let advantages = (0..candidates).map(of).collect::<Result<Vec<_>, _>>()?;
    let better =
        (0..candidates).filter(|&candidate| advantages[candidate].is_some_and(|of| of.is_told()));
    let mean = |candidate: &usize| mean_log(&logs, *candidate);
    let chosen = better.min_by(|a, b| mean(a).total_cmp(&mean(b))).unwrap_or(default);
    Ok(DefaultChoice { chosen, advantages })
}

fn advantage(
    logs: &[Vec<f64>],
    candidate: usize,
    default: usize,
    streams_per_independent: f64,
) -> Result<Option<Advantage>, StatsError> {
    let (own, others) = (mean_log(logs, candidate), mean_log(logs, default));
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

/// Logarithms of the errors in all streams, `[stream][candidate]`.
fn logs<Source, Row>(sources: &[Source]) -> Result<Vec<Vec<f64>>, StatsError>
where
    Source: AsRef<[Row]>,
    Row: AsRef<[f64]>,
{
    const WHAT: &str = "errors of a stream";
    let streams = sources.iter().flat_map(AsRef::as_ref).map(AsRef::as_ref);
    let mut logs: Vec<Vec<f64>> = Vec::new();
    for (row, errors) in streams.enumerate() {
        check(WHAT, errors)?;
        if let Some(index) = errors.iter().position(|&error| error < 0.0) {
            return Err(StatsError::Negative { what: WHAT, index });
        }
        let expected = logs.first().map_or(errors.len(), Vec::len);
        if errors.len() != expected {
            return Err(StatsError::Ragged { what: WHAT, row, expected, got: errors.len() });
        }
        logs.push(errors.iter().map(|error| error.ln()).collect());
    }
    if logs.is_empty() { Err(StatsError::Empty { what: "the streams" }) } else { Ok(logs) }
}

/// Of one candidate; +∞ if any of its logarithms is.
fn mean_log(logs: &[Vec<f64>], candidate: usize) -> f64 {
    let own = || logs.iter().map(|stream| stream[candidate]);
    if own().any(|log| log == f64::INFINITY) {
        return f64::INFINITY;
    }
    own().sum::<f64>() / logs.len() as f64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const INF: f64 = f64::INFINITY;

    fn chosen(streams: &[[f64; 3]]) -> Option<usize> {
        choose_by_mean_log(&[streams]).unwrap().chosen
    }

    #[test]
    fn quotients_decide_and_not_sizes() {
        // Candidate 1 is half of candidate 0 in two streams; in the third, with large errors, a little more.
        let streams = [[0.2, 0.1, 0.3], [0.2, 0.1, 0.3], [90.0, 99.0, 95.0]];
        assert_eq!(chosen(&streams), Some(1));
        let told = choose_by_mean_log(&[&streams[..2], &streams[2..]]).unwrap();
        assert_eq!(told.chosen, Some(1), "pooled over sources");
        let expected = (0.1_f64.ln() + 0.1_f64.ln() + 99_f64.ln()) / 3.0;
        assert!((told.mean_logs[1] - expected).abs() < 1e-12);
    }

    #[test]
    fn divergence_outweighs_everything() {
        assert_eq!(chosen(&[[INF, 0.5, 0.6], [0.0, 0.5, 0.6]]), Some(1));
        assert_eq!(chosen(&[[INF, INF, INF]]), None);
        assert_eq!(chosen(&[[0.5, 0.5, 0.5]]), Some(0), "ties go to the earlier one");
        assert_eq!(chosen(&[[0.5, 0.0, 0.5]]), Some(1));
        let text = serde_json::to_string(&choose_by_mean_log(&[[[INF, 0.0]]]).unwrap()).unwrap();
        assert_eq!(text, r#"{"chosen":1,"mean_logs":[null,"-inf"]}"#);
    }

    /// Errors of two candidates whose log quotients are `d`: the default's over the other's.
    fn streams(d: &[f64]) -> Vec<[f64; 2]> {
        d.iter().map(|d| [d.exp(), 1.0]).collect()
    }

    fn around(d: &[f64], streams_per_independent: f64) -> DefaultChoice {
        choose_around_default(&[streams(d)], 0, streams_per_independent).unwrap()
    }

    #[test]
    fn a_default_stays_unless_another_is_one_standard_error_better() {
        // Mean 1, s = 1, n = 3: SE = 1/sqrt 3, or 1 if three streams are worth one.
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
        // Candidate 2 has the smallest mean, but not surely so; candidate 1 surely is a little better than the default.
        let streams = [[1.0, 0.9, 0.01], [1.0, 0.9, 3.0], [1.0, 0.9, 3.0]];
        assert_eq!(chosen(&streams), Some(2));
        assert_eq!(choose_around_default(&[streams], 0, 3.0).unwrap().chosen, 1);
        let streams = [[1.0, 0.9, 0.5], [1.0, 0.9, 0.5]];
        assert_eq!(choose_around_default(&[streams], 0, 3.0).unwrap().chosen, 2);
    }

    #[test]
    fn divergence_around_a_default() {
        let of = |streams: &[[f64; 3]]| choose_around_default(&[streams], 0, 3.0).unwrap();
        assert_eq!(of(&[[INF, 0.5, INF], [0.1, 0.5, 0.1]]).chosen, 1);
        let all = of(&[[INF, INF, 0.1], [0.1, 0.5, INF]]);
        assert_eq!((all.chosen, all.advantages), (0, vec![None; 3]));
        let others = of(&[[0.9, INF, 0.9], [0.9, 0.1, 0.9]]);
        assert_eq!((others.chosen, others.advantages[1].unwrap().mean), (0, -INF));
    }

    #[test]
    fn bad_input_is_an_error() {
        let none: [[[f64; 2]; 0]; 1] = [[]];
        assert!(matches!(choose_by_mean_log(&none), Err(StatsError::Empty { .. })));
        assert!(choose_by_mean_log(&[[[1.0, -1.0]]]).is_err());
        assert!(choose_by_mean_log(&[[vec![1.0], vec![1.0, 2.0]]]).is_err());
        let streams = [[[1.0, 2.0]]];
        let range = choose_around_default(&streams, 2, 3.0);
        assert!(matches!(range, Err(StatsError::OutOfRange { index: 2, .. })));
        for got in [0.5, INF, f64::NAN] {
            let number = choose_around_default(&streams, 0, got);
            assert!(matches!(number, Err(StatsError::EffectiveNumber { .. })), "{got}");
        }
    }

    proptest! {
        /// A worse effective number never moves away from a default where a better one stays.
        #[test]
        fn fewer_independent_streams_move_less(
            d in prop::collection::vec(-2.0f64..2.0, 2..12), one in 1.0f64..5.0, more in 0.0f64..5.0
        ) {
            let (few, many) = (around(&d, one + more), around(&d, one));
            prop_assert!(few.chosen <= many.chosen);
        }

        #[test]
        fn the_choice_has_the_smallest_geometric_mean(
            streams in (1usize..6, 1usize..6).prop_flat_map(|(streams, candidates)| {
                prop::collection::vec(prop::collection::vec(0.01f64..9.0, candidates), streams)
            })
        ) {
            let chosen = choose_by_mean_log(&[&streams]).unwrap().chosen.unwrap();
            let product = |candidate: usize| streams.iter().map(|of| of[candidate]).product::<f64>();
            for candidate in 0..streams[0].len() {
                prop_assert!(product(chosen) <= product(candidate) * (1.0 + 1e-9));
            }
        }
    }
}
