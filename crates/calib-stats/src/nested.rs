//! Scores on two levels: units, such as windows or ensemble members, and the runs in each.

use crate::StatsError;
use crate::error::check;

/// Scores of the candidates in the runs of units: `[unit][run][candidate]`. Units may have different numbers of runs.
///
/// Units are exchangeable: a unit is a held-out window or a member of the ensemble. A run of a unit is one stream, on
/// which all candidates are trained, so its scores stay together.
#[derive(Debug, Clone, PartialEq)]
pub struct Nested {
    units: Vec<Vec<Vec<f64>>>,
    candidates: usize,
    /// Number of independent draws of units. Each draw fills an equal share of the places.
    independent: usize,
}

impl Nested {
    /// Stores scores `[unit][run][candidate]`; infinite where a run diverged.
    ///
    /// # Errors
    ///
    /// There are no units, a unit has no runs or a run no candidates, runs differ in their number of candidates, or a
    /// score is NaN.
    pub fn new(units: Vec<Vec<Vec<f64>>>) -> Result<Self, StatsError> {
        const RUNS: &str = "runs of a unit";
        let first = units.first().ok_or(StatsError::Empty { what: "the units" })?;
        let candidates = first.first().ok_or(StatsError::Empty { what: RUNS })?.len();
        for runs in &units {
            if runs.is_empty() {
                return Err(StatsError::Empty { what: RUNS });
            }
            for (row, run) in runs.iter().enumerate() {
                check("scores of a run", run)?;
                if run.len() != candidates {
                    let expected = candidates;
                    let got = run.len();
                    return Err(StatsError::Ragged { what: RUNS, row, expected, got });
                }
            }
        }
        let independent = units.len();
        Ok(Self { units, candidates, independent })
    }

    /// Sets the number of independent units, for units such as windows that share rows. Fewer units are then drawn,
    /// each for several places, so that means vary as those of `independent` units do.
    #[must_use]
    pub fn with_independent(self, independent: usize) -> Self {
        let independent = independent.clamp(1, self.units.len());
        Self { independent, ..self }
    }

    /// Returns the number of candidates.
    pub const fn candidates(&self) -> usize {
        self.candidates
    }

    /// Returns all units and runs, once each, for a statistic of the data themselves.
    pub fn whole(&self) -> Drawn<'_> {
        let units = self.units.iter().enumerate();
        Drawn {
            nested: self,
            units: units.map(|(unit, runs)| (unit, (0..runs.len()).collect())).collect(),
        }
    }

    /// Draws as many units as there are, and in each as many runs as it has, with replacement.
    pub(crate) fn draw(&self, draw: &mut impl FnMut(usize) -> usize) -> Drawn<'_> {
        let all = self.units.len();
        let mut unit = 0;
        let mut last = None;
        let mut units = Vec::with_capacity(all);
        for place in 0..all {
            let number = place * self.independent / all;
            if last != Some(number) && all > 1 {
                unit = draw(all);
            }
            last = Some(number);
            let runs = self.units[unit].len();
            units.push((unit, (0..runs).map(|_| if runs > 1 { draw(runs) } else { 0 }).collect()));
        }
        Drawn { nested: self, units }
    }
}

/// A resample of the units and runs of a [`Nested`], some of them several times.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawn<'a> {
    nested: &'a Nested,
    units: Vec<(usize, Vec<usize>)>,
}

impl<'a> Drawn<'a> {
    /// Returns the numbers of the drawn units, each with the scores of its drawn runs, `[run][candidate]`.
    pub fn units(&self) -> impl Iterator<Item = (usize, impl Iterator<Item = &'a [f64]>)> {
        self.units.iter().map(|(unit, runs)| {
            let scores = &self.nested.units[*unit];
            (*unit, runs.iter().map(|&run| scores[run].as_slice()))
        })
    }

    /// Returns the scores of all drawn runs, regardless of unit: `[run][candidate]`.
    pub fn runs(&self) -> Vec<&'a [f64]> {
        self.units().flat_map(|(_, runs)| runs).collect()
    }

    /// Returns arithmetic means over the runs of each drawn unit: `[unit][candidate]`, infinite where a run diverged.
    pub fn means(&self) -> Vec<Vec<f64>> {
        self.units
            .iter()
            .map(|(unit, runs): &(usize, Vec<usize>)| {
                let mut sums = vec![0.0; self.nested.candidates];
                for &run in runs {
                    for (sum, score) in sums.iter_mut().zip(&self.nested.units[*unit][run]) {
                        *sum += score;
                    }
                }
                sums.into_iter().map(|sum| sum / runs.len() as f64).collect()
            })
            .collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns a deterministic pseudo-random generator.
    pub(crate) fn draws(seed: u64) -> impl FnMut(usize) -> usize {
        let mut state = seed;
        move |n| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            ((u128::from(state) * n as u128) >> 64) as usize
        }
    }

    #[test]
    fn bad_tables_are_errors() {
        assert!(matches!(Nested::new(Vec::new()), Err(StatsError::Empty { .. })));
        assert!(matches!(Nested::new(vec![Vec::new()]), Err(StatsError::Empty { .. })));
        assert!(matches!(Nested::new(vec![vec![Vec::new()]]), Err(StatsError::Empty { .. })));
        let ragged = Nested::new(vec![vec![vec![1.0]], vec![vec![1.0], vec![1.0, 2.0]]]);
        assert!(matches!(ragged, Err(StatsError::Ragged { row: 1, expected: 1, got: 2, .. })));
        assert!(Nested::new(vec![vec![vec![f64::NAN]]]).is_err());
    }

    #[test]
    fn units_that_are_not_independent_are_drawn_together() {
        let units = (0..6).map(|unit| vec![vec![f64::from(unit)]]).collect();
        let nested = Nested::new(units).unwrap().with_independent(2);
        let mut draw = draws(1);
        let mut means = Vec::new();
        for _ in 0..20_000 {
            let drawn: Vec<f64> =
                nested.draw(&mut draw).means().iter().map(|mean| mean[0]).collect();
            assert!(
                drawn[..3].iter().all(|mean| *mean == drawn[0])
                    && drawn[3..].iter().all(|mean| *mean == drawn[3])
            );
            means.push(f64::midpoint(drawn[0], drawn[3]));
        }
        // The variance of 0 … 5 is 35 / 12; that of the mean of two such numbers is half of it.
        let mean = means.iter().sum::<f64>() / means.len() as f64;
        let variance =
            means.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / means.len() as f64;
        assert!((variance / (35.0 / 24.0) - 1.0).abs() < 0.05, "{variance}");
    }

    proptest! {
        /// A resample holds only units and runs of the data, and as many as there are.
        #[test]
        fn draws_are_of_the_data(
            table in prop::collection::vec(prop::collection::vec(prop::collection::vec(-9.0f64..9.0, 2), 1..4), 1..5),
            seed in 0u64..1000
        ) {
            let nested = Nested::new(table.clone()).unwrap();
            let drawn = nested.draw(&mut draws(seed));
            prop_assert_eq!(drawn.units().count(), table.len());
            for ((unit, runs), mean) in drawn.units().zip(drawn.means()) {
                let runs: Vec<&[f64]> = runs.collect();
                prop_assert_eq!(runs.len(), table[unit].len());
                for run in &runs {
                    prop_assert!(table[unit].iter().any(|known| known == run));
                }
                let sum: f64 = runs.iter().map(|run| run[1]).sum();
                prop_assert!((mean[1] - sum / runs.len() as f64).abs() < 1e-12);
            }
            let whole = nested.whole();
            prop_assert_eq!(whole.runs().len(), table.iter().map(Vec::len).sum::<usize>());
            prop_assert_eq!(nested.candidates(), 2);
        }
    }
}
