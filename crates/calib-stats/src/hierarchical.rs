//! A two-level bootstrap: units, such as ensemble members, and the runs in each.

use serde::{Deserialize, Serialize};

use crate::{Drawn, Nested, StatsError};

/// The choices over all resamples.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChoiceOfResamples {
    /// Number of resamples that choose each candidate.
    pub counts: Vec<usize>,
    /// Number of resamples that choose no candidate.
    pub none: usize,
}

/// Chooses from `inputs` under resampling on two levels. From each input, as many units as it has are drawn with
/// replacement, and from each of them as many runs as it has. Each of `resamples` draws from all inputs again.
///
/// Source: Davison & Hinkley (1997, section 3.8). They show that resampling both levels with replacement gives the
/// variance of means between units, and a little more (by the part of the variance within units). With few units the
/// shares are less informative than they seem: with three units, a resample is one of ten sets. Runs are resampled
/// within their unit; randomness that runs of different units share is not resampled. Members of an ensemble share most
/// of their log. The shares therefore tell what other resamples of this log choose; another log of the same plant
/// agrees less often.
///
/// `draw(n)` returns a uniform number below `n`. It is called in the order of the inputs, and within an input unit by
/// unit: first for the unit (if there are several), then for its runs (if there are several). `choose` returns one of
/// the candidates of the first input, or `None`.
///
/// # Errors
///
/// An error of `choose`, or a choice that is not one of the candidates.
pub fn hierarchical(
    inputs: &[&Nested],
    resamples: usize,
    mut draw: impl FnMut(usize) -> usize,
    mut choose: impl FnMut(&[Drawn<'_>]) -> Result<Option<usize>, StatsError>,
) -> Result<ChoiceOfResamples, StatsError> {
    let candidates = inputs.first().map_or(0, |nested| nested.candidates());
    let mut counts = vec![0; candidates];
    let mut none = 0;
    for _ in 0..resamples {
        let drawn: Vec<Drawn<'_>> = inputs.iter().map(|nested| nested.draw(&mut draw)).collect();
        match choose(&drawn)? {
            Some(index) if index >= candidates => {
                let what = "candidates";
                return Err(StatsError::OutOfRange { what, index, len: candidates });
            }
            Some(index) => counts[index] += 1,
            None => none += 1,
        }
    }
    Ok(ChoiceOfResamples { counts, none })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose_by_mean_log;
    use crate::nested::tests::draws;

    fn nested(units: &[&[&[f64]]]) -> Nested {
        Nested::new(
            units
                .iter()
                .map(|runs: &&[&[f64]]| runs.iter().map(|run| run.to_vec()).collect())
                .collect(),
        )
        .unwrap()
    }

    /// Chooses by the first input.
    fn choose(drawn: &[Drawn<'_>]) -> Result<Option<usize>, StatsError> {
        Ok(choose_by_mean_log(&[drawn[0].runs()])?.chosen)
    }

    #[test]
    fn members_and_their_runs_vary() {
        // Two members prefer different candidates.
        let members = nested(&[&[&[1.0, 2.0], &[1.0, 2.1]], &[&[2.0, 1.0], &[2.2, 1.0]]]);
        let told = hierarchical(&[&members], 2000, draws(1), choose).unwrap();
        assert_eq!(told.counts.iter().sum::<usize>() + told.none, 2000);
        // Each member alone makes up a quarter of the resamples. In the other half both occur, and the runs decide.
        assert!(told.counts.iter().all(|count| *count > 450), "{:?}", told.counts);
        assert_eq!(told, hierarchical(&[&members], 2000, draws(1), choose).unwrap());
        let text = serde_json::to_string(&told).unwrap();
        assert_eq!(serde_json::from_str::<ChoiceOfResamples>(&text).unwrap(), told);
    }

    #[test]
    fn none_is_counted() {
        let diverged = nested(&[&[&[f64::INFINITY; 2]]]);
        let told = hierarchical(&[&diverged], 9, draws(3), choose).unwrap();
        assert_eq!((told.counts.as_slice(), told.none), (&[0, 0][..], 9));
    }

    fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    /// Returns the sum of squared distances from `centre`.
    fn squares(values: &[f64], centre: f64) -> f64 {
        values.iter().map(|x| (x - centre).powi(2)).sum()
    }

    #[test]
    fn the_variance_is_that_of_both_levels() {
        // Resampling with replacement on both levels: Var* = Σ(m_u − m)² / U² + Σ_u Σ_r (x − m_u)² / (R U)².
        let rows = [[1.0, 3.0, 5.0], [2.0, 2.0, 8.0], [7.0, 9.0, 5.0]];
        let units = rows.map(|row| row.map(|score| vec![score]).to_vec()).to_vec();
        let nested = Nested::new(units).unwrap();
        let resamples = 40_000;
        let mut means = Vec::new();
        hierarchical(&[&nested], resamples, draws(4), |drawn| {
            let units = drawn[0].means();
            means.push(units.iter().map(|unit| unit[0]).sum::<f64>() / units.len() as f64);
            Ok(None)
        })
        .unwrap();
        let of_units = rows.map(|row| mean(&row));
        let inside: f64 =
            rows.iter().zip(of_units).map(|(row, mean_of_row)| squares(row, mean_of_row)).sum();
        let expected = squares(&of_units, mean(&of_units)) / 9.0 + inside / 81.0;
        let got = squares(&means, mean(&means)) / resamples as f64;
        assert!((got / expected - 1.0).abs() < 0.03, "{got}, not {expected}");
    }

    #[test]
    fn a_choice_of_no_candidate_is_an_error() {
        let one = nested(&[&[&[1.0, 2.0]]]);
        let refused = hierarchical(&[&one], 3, draws(5), |_| Ok(Some(2)));
        assert!(matches!(refused, Err(StatsError::OutOfRange { index: 2, len: 2, .. })));
    }
}
