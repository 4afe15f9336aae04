//! Choices by the mean logarithm of errors.

use serde::{Deserialize, Serialize};

use crate::StatsError;
use crate::error::check;

/// The candidate with the smallest mean log error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogChoice {
    /// Index of the candidate; `None` if all diverged somewhere.
    pub chosen: Option<usize>,
    /// Mean over streams of the logarithm of each candidate's error (`null` in files for +∞, `"-inf"` for −∞).
    #[serde(with = "crate::diverged::each")]
    pub mean_logs: Vec<f64>,
}

/// Chooses from `sources` `[source][stream][candidate]`, such as ensemble members and log replay. It returns the
/// candidate with the smallest mean of ln error over all streams. Streams are pooled: each counts equally, whatever its
/// source.
///
/// The mean is +∞ if the candidate diverged in any stream, even if another error is 0, whose logarithm is −∞. Ties go
/// to the earlier candidate. Compared with the mean of errors, streams with large errors do not outvote the others,
/// because only ratios matter. Source: our choice, measured beside the worst rank.
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
    let chosen = (0..mean_logs.len()).filter(|&candidate| mean_logs[candidate] < f64::INFINITY);
    let chosen = chosen.min_by(|&a, &b| mean_logs[a].total_cmp(&mean_logs[b]));
    LogChoice { chosen, mean_logs }
}

/// Returns the logarithms of the errors in all streams, `[stream][candidate]`.
pub(crate) fn logs<Source, Row>(sources: &[Source]) -> Result<Vec<Vec<f64>>, StatsError>
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

/// Returns the mean logarithm of one candidate, or +∞ if any of its logarithms is.
pub(crate) fn mean_log(logs: &[Vec<f64>], candidate: usize) -> f64 {
    let own = logs.iter().map(|stream| stream[candidate]);
    if own.clone().any(|log| log == f64::INFINITY) {
        return f64::INFINITY;
    }
    own.sum::<f64>() / logs.len() as f64
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
        // Candidate 1 has half the error of candidate 0 in two streams. In the third, with large errors, it has a
        // little more.
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

    #[test]
    fn bad_input_is_an_error() {
        let none: [[[f64; 2]; 0]; 1] = [[]];
        assert!(matches!(choose_by_mean_log(&none), Err(StatsError::Empty { .. })));
        assert!(choose_by_mean_log(&[[[1.0, -1.0]]]).is_err());
        assert!(choose_by_mean_log(&[[vec![1.0], vec![1.0, 2.0]]]).is_err());
    }

    proptest! {
        #[test]
        fn the_choice_has_the_smallest_geometric_mean(
            streams in (1usize..6, 1usize..6).prop_flat_map(|(streams, candidates)| {
                prop::collection::vec(prop::collection::vec(0.01f64..9.0, candidates), streams)
            })
        ) {
            let chosen = choose_by_mean_log(&[&streams]).unwrap().chosen.unwrap();
            let product = |candidate: usize| streams.iter().map(|errors| errors[candidate]).product::<f64>();
            for candidate in 0..streams[0].len() {
                prop_assert!(product(chosen) <= product(candidate) * (1.0 + 1e-9));
            }
        }
    }
}
