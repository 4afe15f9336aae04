//! Bootstrap on two levels: units, such as windows or members, and the runs in each.

use serde::{Deserialize, Serialize};

use crate::{Drawn, Interval, Nested, StatsError, Varies, percentile_interval};

/// What is computed of a resample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Statistics {
    /// Numbers, `None` where one is not defined; +∞ is a number here.
    pub numbers: Vec<Option<f64>>,
    /// Candidates that are chosen, `None` where none is.
    pub choices: Vec<Option<usize>>,
}

/// What all resamples say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hierarchical {
    /// Resamples.
    pub resamples: usize,
    /// What they differ in, one for each of the inputs.
    pub varies: Vec<Varies>,
    /// One for each of the numbers.
    pub numbers: Vec<NumberOfResamples>,
    /// One for each of the choices.
    pub choices: Vec<ChoiceOfResamples>,
}

/// A number over resamples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NumberOfResamples {
    /// From the 0.025 to the 0.975 quantile of the resamples in which it is defined; `None` if half of them or more are
    /// not, or if resamples vary nothing.
    pub interval: Option<Interval>,
    /// Resamples in which it is not defined.
    pub undefined: usize,
}

/// A choice over resamples.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChoiceOfResamples {
    /// How many resamples choose each candidate.
    pub counts: Vec<usize>,
    /// How many choose none.
    pub none: usize,
}

/// Statistics of `inputs` under resampling on two levels: of each input, as many units as there are are drawn with
/// replacement, and in each of them as many runs as it has. All inputs are drawn anew in each of `resamples`, so a
/// choice made on one (members) and its regret on another (windows) vary together, and everything that `statistic`
/// returns comes from the same draws.
///
/// The interval is that of percentiles. Source: Davison & Hinkley (1997, section 3.8), who show that resampling both
/// levels with replacement gives the variance of means between units, and a little more (by the part of the variance
/// within units); a percentile interval over G units is too narrow by about √((G − 1) / G), so read one over two or
/// three windows as a lower bound of what is not known. Runs are taken as drawn within their unit: what runs of
/// different units share is not resampled.
///
/// `draw(n)` returns a number below `n`, evenly; it is called in the order of the inputs, and within one unit by unit: the unit (where there are
/// several), then its runs (where there are several). `statistic` returns equally many numbers and choices each time.
///
/// # Errors
///
/// A number is NaN, +∞ and −∞ meet in a quantile, or a choice is none of the candidates of the first input.
pub fn hierarchical(
    inputs: &[&Nested],
    resamples: usize,
    mut draw: impl FnMut(usize) -> usize,
    mut statistic: impl FnMut(&[Drawn<'_>]) -> Result<Statistics, StatsError>,
) -> Result<Hierarchical, StatsError> {
    let candidates = inputs.first().map_or(0, |of| of.candidates());
    let mut all = Vec::with_capacity(resamples);
    for _ in 0..resamples {
        let drawn: Vec<Drawn<'_>> = inputs.iter().map(|of| of.draw(&mut draw)).collect();
        all.push(statistic(&drawn)?);
    }
    let varies: Vec<Varies> = inputs.iter().map(|of| of.varies()).collect();
    let fixed = varies.iter().all(|of| *of == Varies::Nothing);
    let places = |of: fn(&Statistics) -> usize| 0..all.first().map_or(0, of);
    let number = |place: usize| {
        let values: Vec<Option<f64>> = all.iter().map(|of| of.numbers[place]).collect();
        let undefined = values.iter().filter(|value| value.is_none()).count();
        let interval = if fixed { None } else { percentile_interval(&values)? };
        Ok(NumberOfResamples { interval, undefined })
    };
    let choice = |place: usize| {
        let (mut counts, mut none) = (vec![0; candidates], 0);
        for chosen in all.iter().map(|of| of.choices[place]) {
            match chosen {
                Some(index) if index >= candidates => {
                    let what = "candidates";
                    return Err(StatsError::OutOfRange { what, index, len: candidates });
                }
                Some(index) => counts[index] += 1,
                None => none += 1,
            }
        }
        Ok(ChoiceOfResamples { counts, none })
    };
    Ok(Hierarchical {
        resamples,
        varies,
        numbers: places(|of| of.numbers.len()).map(number).collect::<Result<_, _>>()?,
        choices: places(|of| of.choices.len()).map(choice).collect::<Result<_, _>>()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nested::tests::draws;
    use crate::{choose_by_mean_log, geometric_regret};

    const INF: f64 = f64::INFINITY;

    fn nested(units: &[&[&[f64]]]) -> Nested {
        let runs = |runs: &&[&[f64]]| runs.iter().map(|run| run.to_vec()).collect();
        Nested::new(units.iter().map(runs).collect()).unwrap()
    }

    fn number(value: f64) -> Statistics {
        Statistics { numbers: vec![Some(value)], choices: Vec::new() }
    }

    fn mean_of_units(drawn: &Drawn<'_>) -> f64 {
        let means = drawn.means();
        means.iter().map(|of| of[0]).sum::<f64>() / means.len() as f64
    }

    #[test]
    fn members_and_windows_vary_together() {
        // Two members prefer different candidates; each window too.
        let members = nested(&[&[&[1.0, 2.0], &[1.0, 2.1]], &[&[2.0, 1.0], &[2.2, 1.0]]]);
        let windows = nested(&[&[&[1.0, 1.5], &[1.1, 1.5]], &[&[3.0, 2.0], &[3.0, 2.1]]]);
        let statistic = |drawn: &[Drawn<'_>]| {
            let chosen = choose_by_mean_log(&[drawn[0].runs()])?.chosen;
            let errors = drawn[1].means();
            let of = |choice: usize| Ok(geometric_regret(&errors, |_| choice)?.map(|of| of.regret));
            let numbers = vec![of(0)?, chosen.map(of).transpose()?.flatten()];
            Ok(Statistics { numbers, choices: vec![chosen] })
        };
        let told = hierarchical(&[&members, &windows], 2000, draws(1), statistic).unwrap();
        assert_eq!(told.varies, [Varies::UnitsAndRuns; 2]);
        let counts = &told.choices[0].counts;
        assert_eq!(counts.iter().sum::<usize>() + told.choices[0].none, 2000);
        // A quarter of the resamples has each member alone, half has both, where runs decide.
        assert!(counts.iter().all(|count| *count > 450), "{counts:?}");
        // With both windows the first candidate's regret is that of one of them; with one window it is 0 or 3 / 2.05 - 1 or so.
        let fixed = told.numbers[0].interval.unwrap();
        assert!(fixed.low == 0.0 && fixed.high > 0.42 && fixed.high <= 0.5, "{fixed:?}");
        let again = hierarchical(&[&members, &windows], 2000, draws(1), statistic).unwrap();
        assert_eq!(told, again);
    }

    #[test]
    fn one_window_is_resampled_by_its_runs() {
        let window = nested(&[&[&[1.0], &[2.0], &[4.0]]]);
        let told = hierarchical(&[&window], 500, draws(2), |of| Ok(number(mean_of_units(&of[0]))))
            .unwrap();
        assert_eq!(told.varies, [Varies::Runs]);
        let interval = told.numbers[0].interval.unwrap();
        assert!(interval.low >= 1.0 && interval.high <= 4.0 && interval.low < interval.high);
        let windows = nested(&[&[&[1.0]], &[&[2.0]]]);
        let told = hierarchical(&[&windows], 9, draws(2), |_| Ok(number(1.0))).unwrap();
        assert_eq!(told.varies, [Varies::Units]);
        let one = nested(&[&[&[1.0]]]);
        let told = hierarchical(&[&one], 9, draws(2), |_| Ok(number(1.0))).unwrap();
        assert_eq!((told.varies[0], told.numbers[0].interval), (Varies::Nothing, None));
    }

    #[test]
    fn divergence_is_at_the_upper_end() {
        let windows = nested(&[&[&[INF, 1.0], &[2.0, 1.0]], &[&[2.0, 1.0], &[2.0, 1.0]]]);
        let regret = |of: &[Drawn<'_>]| {
            let regret = geometric_regret(&of[0].means(), |_| 0)?.map(|of| of.regret);
            Ok(Statistics { numbers: vec![regret, None], choices: vec![None] })
        };
        let told = hierarchical(&[&windows], 1000, draws(3), regret).unwrap();
        let interval = told.numbers[0].interval.unwrap();
        assert!((interval.low - 1.0).abs() < 1e-12, "{interval:?}");
        assert_eq!(interval.high, INF);
        assert_eq!((told.numbers[1].interval, told.numbers[1].undefined), (None, 1000));
        assert_eq!((told.choices[0].counts.as_slice(), told.choices[0].none), (&[0, 0][..], 1000));
        let text = serde_json::to_string(&told).unwrap();
        assert_eq!(serde_json::from_str::<Hierarchical>(&text).unwrap(), told);
    }

    #[test]
    fn the_variance_is_that_of_both_levels() {
        // Strategy with replacement on both levels: Var* = Σ(m_u − m)² / U² + Σ_u Σ_r (x − m_u)² / (R U)².
        let rows = [[1.0, 3.0, 5.0], [2.0, 2.0, 8.0], [7.0, 9.0, 5.0]];
        let units = rows.map(|row| row.map(|score| vec![score]).to_vec()).to_vec();
        let nested = Nested::new(units).unwrap();
        let resamples = 40_000;
        let mut means = Vec::new();
        hierarchical(&[&nested], resamples, draws(4), |of| {
            means.push(mean_of_units(&of[0]));
            Ok(Statistics::default())
        })
        .unwrap();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let square = |values: &[f64], of: f64| values.iter().map(|x| (x - of).powi(2)).sum::<f64>();
        let of_units = rows.map(|row| mean(&row));
        let inside: f64 = rows.iter().zip(of_units).map(|(row, of)| square(row, of)).sum();
        let expected = square(&of_units, mean(&of_units)) / 9.0 + inside / 81.0;
        let got = square(&means, mean(&means)) / resamples as f64;
        assert!((got / expected - 1.0).abs() < 0.03, "{got}, not {expected}");
    }

    #[test]
    fn a_choice_of_no_candidate_is_an_error() {
        let one = nested(&[&[&[1.0, 2.0]]]);
        let choice =
            |_: &[Drawn<'_>]| Ok(Statistics { numbers: Vec::new(), choices: vec![Some(2)] });
        let refused = hierarchical(&[&one], 3, draws(5), choice);
        assert!(matches!(refused, Err(StatsError::OutOfRange { index: 2, len: 2, .. })));
    }
}
