//! Sweeps of several hyperparameters: the importance of each, and the two most important against each other.

use calib_stats::importance;

use super::{Dimension, LOWER, NRMSE, Sensitivity};
use crate::{Setting, chart::extent};

/// A heat map of two hyperparameters. Each cell is the best over all other hyperparameters.
pub(crate) struct Heat {
    /// Name of the numbers: "Online (held-out), mean NRMSE".
    pub(crate) label: String,
    pub(crate) row_field: String,
    pub(crate) rows: Vec<Setting>,
    pub(crate) column_field: String,
    pub(crate) columns: Vec<Setting>,
    /// Cells `[rows, columns]`; `None` where the grid has no such combination.
    pub(crate) cells: Vec<Vec<Option<HeatCell>>>,
}

/// One cell of a [`Heat`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HeatCell {
    pub(crate) value: f64,
    /// Position from 0, the best cell, to 1, the worst finite one; `None` for diverged cells.
    pub(crate) place: Option<f64>,
    /// Whether the cell contains the chosen setting.
    pub(crate) is_chosen: bool,
}

/// Importance of each hyperparameter.
pub(crate) struct Importances {
    /// Name of each column of shares.
    pub(crate) labels: Vec<String>,
    /// Each hyperparameter with one share per label, 0 to 1; `None` where all combinations are alike.
    pub(crate) shares: Vec<(String, Vec<Option<f64>>)>,
}

/// One number per combination, with a name.
struct Surface {
    label: String,
    values: Vec<f64>,
}

impl Sensitivity {
    /// Returns the numbers by which combinations are compared: each error curve, or the ranks if there is no error curve.
    fn surfaces(&self) -> Vec<Surface> {
        let errors = self.errors.iter().map(|curve| Surface {
            label: format!("{}, mean {NRMSE}", curve.label),
            values: curve
                .summaries
                .iter()
                .map(|summary| summary.map_or(f64::NAN, |summary| summary.mean))
                .collect(),
        });
        let ranks = self.worst_ranks.iter().map(|curve| Surface {
            label: curve.label.clone(),
            values: curve.worst_ranks.iter().map(|&rank| rank as f64).collect(),
        });
        let all: Vec<Surface> =
            if self.errors.is_empty() { ranks.collect() } else { errors.collect() };
        // A curve that no hyperparameter changes, such as a simple predictor, has nothing to show.
        if all.iter().any(Surface::varies) {
            all.into_iter().filter(Surface::varies).collect()
        } else {
            all
        }
    }

    /// Returns the share of the variance that each hyperparameter alone explains, per curve ([`calib_stats::importance`]).
    /// It uses logarithms if all values are positive. A diverged value counts as the worst finite one.
    pub(crate) fn importances(&self) -> Importances {
        let surfaces = self.surfaces();
        let shares = self
            .varied()
            .iter()
            .map(|dimension| {
                let (_, groups) = dimension.distinct();
                let shares = surfaces.iter().map(|surface| surface.explained(&groups)).collect();
                (dimension.field.clone(), shares)
            })
            .collect();
        Importances { labels: surfaces.into_iter().map(|surface| surface.label).collect(), shares }
    }

    /// Returns one heat map per curve, of the two hyperparameters that matter most for the first curve. Empty if only one
    /// hyperparameter is swept.
    pub(crate) fn heats(&self) -> Vec<Heat> {
        let mut order = self.varied();
        let surfaces = self.surfaces();
        let Some(first) = surfaces.first() else { return Vec::new() };
        // The sort is stable: equally important ones stay in the order of the grid.
        order.sort_by(|a, b| first.importance_of(b).total_cmp(&first.importance_of(a)));
        let [rows, columns, ..] = order.as_slice() else { return Vec::new() };
        surfaces.iter().map(|surface| surface.heat(rows, columns, self.chosen)).collect()
    }
}

impl Surface {
    /// Whether the values differ by more than rounding.
    fn varies(&self) -> bool {
        let known: Vec<f64> = self.values.iter().copied().filter(|value| !value.is_nan()).collect();
        let low = known.iter().copied().fold(f64::INFINITY, f64::min);
        let high = known.iter().copied().fold(-f64::INFINITY, f64::max);
        high - low > 1e-9 * high.abs()
    }

    fn importance_of(&self, dimension: &Dimension) -> f64 {
        self.explained(&dimension.distinct().1).unwrap_or(0.0)
    }

    fn explained(&self, groups: &[usize]) -> Option<f64> {
        let known = self.values.iter().zip(groups).filter(|(value, _)| !value.is_nan());
        let (values, groups): (Vec<f64>, Vec<usize>) =
            known.map(|(&value, &row)| (value, row)).unzip();
        let finite: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
        let logarithmic = finite.iter().all(|value| *value > 0.0);
        let finite = finite.into_iter().map(|value| scaled(value, logarithmic));
        let worst = finite.max_by(|a, b| LOWER.compare(*a, *b))?;
        let values: Vec<f64> = values
            .iter()
            .map(|&value| if value.is_finite() { scaled(value, logarithmic) } else { worst })
            .collect();
        importance(&groups, &values).ok().flatten()
    }

    fn heat(&self, rows: &Dimension, columns: &Dimension, chosen: Option<usize>) -> Heat {
        let (row_values, row_of) = rows.distinct();
        let (column_values, column_of) = columns.distinct();
        let cell_of: Vec<(usize, usize)> = row_of.into_iter().zip(column_of).collect();
        let all = (0..row_values.len())
            .flat_map(|row| (0..column_values.len()).map(move |column| (row, column)));
        let places = Places::of(all.filter_map(|cell| self.best_in(&cell_of, cell)));
        let chosen_cell = chosen.map(|candidate| cell_of[candidate]);
        let (row_order, rows_sorted) = sorted(&row_values);
        let (column_order, columns_sorted) = sorted(&column_values);
        let cells = row_order.iter().map(|&row| {
            let row_cells = column_order.iter().map(|&column| {
                let value = self.best_in(&cell_of, (row, column))?;
                let is_chosen = chosen_cell == Some((row, column));
                Some(HeatCell { value, place: places.place(value), is_chosen })
            });
            row_cells.collect()
        });
        Heat {
            label: self.label.clone(),
            row_field: rows.field.clone(),
            rows: rows_sorted,
            column_field: columns.field.clone(),
            columns: columns_sorted,
            cells: cells.collect(),
        }
    }

    /// Returns the best value in a cell; `cell_of` gives the cell of each value.
    fn best_in(&self, cell_of: &[(usize, usize)], cell: (usize, usize)) -> Option<f64> {
        let own = (0..self.values.len()).filter(|&place| cell_of[place] == cell);
        let known = own.map(|place| self.values[place]).filter(|value| !value.is_nan());
        known.min_by(|a, b| LOWER.compare(*a, *b))
    }
}

/// Sorts numbers in ascending order, and leaves names as they are. Also returns the place of each value.
fn sorted(values: &[&Setting]) -> (Vec<usize>, Vec<Setting>) {
    let mut order: Vec<usize> = (0..values.len()).collect();
    if let Some(numbers) =
        values.iter().map(|value| value.as_number()).collect::<Option<Vec<f64>>>()
    {
        order.sort_by(|&a, &b| numbers[a].total_cmp(&numbers[b]));
    }
    let values = order.iter().map(|&place| values[place].clone()).collect();
    (order, values)
}

/// Positions of numbers between the best and the worst, on a logarithmic scale if all are positive.
struct Places {
    best: f64,
    worst: f64,
    logarithmic: bool,
}

impl Places {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let finite: Vec<f64> = values.filter(|value| value.is_finite()).collect();
        let logarithmic = finite.iter().all(|value| *value > 0.0);
        let (best, worst) = extent(&finite).unwrap_or((f64::NAN, f64::NAN));
        Self { best, worst, logarithmic }
    }

    fn place(&self, value: f64) -> Option<f64> {
        if !value.is_finite() {
            return None;
        }
        if self.best == self.worst {
            return Some(0.0);
        }
        let [value, best, worst] =
            [value, self.best, self.worst].map(|value| scaled(value, self.logarithmic));
        Some(((value - best) / (worst - best)).clamp(0.0, 1.0))
    }
}

/// Returns the value on a logarithmic or a linear scale.
fn scaled(value: f64, logarithmic: bool) -> f64 {
    if logarithmic { value.ln() } else { value }
}

#[cfg(test)]
mod tests {
    use calib_stats::summarise;

    use super::*;
    use crate::{ErrorCurve, ErrorSource, RankCurve, Samples};

    /// Returns the positions of the rate and the batch size of each setting of [`grid`].
    fn grid_places() -> impl Iterator<Item = (usize, usize)> {
        (0..2).flat_map(|rate| (0..3).map(move |batch| (rate, batch)))
    }

    /// Returns two learning rates × three batch sizes: the error is the product of two factors, and one setting diverged.
    fn grid() -> Sensitivity {
        let rates = [0.1, 0.01];
        let batches = [1.0, 16.0, 64.0];
        let errors = [[4.0, 2.0, 4.0], [f64::INFINITY, 1.0, 2.0]];
        let curve = ErrorCurve {
            label: "held-out period".to_owned(),
            source: ErrorSource::Online,
            over: Samples::Runs,
            summaries: grid_places()
                .map(|(rate, batch)| summarise(&[errors[rate][batch]]).ok())
                .collect(),
        };
        Sensitivity {
            sensor: "A".to_owned(),
            field: "learning_rate, batch_size".to_owned(),
            values: grid_places()
                .map(|(rate, batch)| Setting::Name(format!("{rate} {batch}")))
                .collect(),
            errors: vec![curve],
            worst_ranks: vec![RankCurve {
                label: "kNN".to_owned(),
                worst_ranks: vec![5, 3, 4, 6, 1, 2],
            }],
            chosen: Some(4),
            default: Some(1),
            dimensions: vec![
                Dimension {
                    field: "learning_rate".to_owned(),
                    values: grid_places().map(|(rate, _)| rates[rate].into()).collect(),
                },
                Dimension {
                    field: "batch_size".to_owned(),
                    values: grid_places().map(|(_, batch)| batches[batch].into()).collect(),
                },
            ],
        }
    }

    #[test]
    fn slices_go_through_the_choice() {
        let slices = grid().slices();
        let fields: Vec<&str> = slices.iter().map(|slice| slice.field.as_str()).collect();
        assert_eq!(fields, ["learning_rate", "batch_size"]);
        // The slice at batch_size = 16 has the rates 0.1 and 0.01.
        assert_eq!(slices[0].values, [Setting::Number(0.1), Setting::Number(0.01)]);
        assert_eq!(slices[0].worst_ranks[0].worst_ranks, [3, 1]);
        assert_eq!((slices[0].chosen, slices[0].default), (Some(1), Some(0)));
        // The slice at learning_rate = 0.01 has the batches 1, 16 and 64; the default has another rate.
        assert_eq!(slices[1].worst_ranks[0].worst_ranks, [6, 1, 2]);
        assert_eq!((slices[1].chosen, slices[1].default), (Some(1), None));
        let without = Sensitivity { chosen: None, ..grid() };
        assert_eq!(without.slices()[1].worst_ranks[0].worst_ranks, [6, 1, 2], "the best Online");
        let single = Sensitivity { dimensions: vec![], ..grid() };
        assert!(single.slices().is_empty());
    }

    #[test]
    fn what_matters_most_is_shown_against_what_matters_next() {
        let heats = grid().heats();
        assert_eq!(heats.len(), 1);
        let heat = &heats[0];
        // ln: rate means (ln 4 + ln 2 + ln 4, ln 4 + 0 + ln 2) / 3, batch means ln 4, ln √2, ln √8: batches differ more.
        assert_eq!(
            (heat.row_field.as_str(), heat.column_field.as_str()),
            ("batch_size", "learning_rate")
        );
        assert_eq!(heat.columns, [Setting::Number(0.01), Setting::Number(0.1)], "numbers rise");
        let values: Vec<Vec<f64>> = heat
            .cells
            .iter()
            .map(|row| row.iter().flatten().map(|cell| cell.value).collect())
            .collect();
        assert_eq!(values, [[f64::INFINITY, 4.0], [1.0, 2.0], [2.0, 4.0]]);
        let [diverged, best, middle, worst] = [(0, 0), (1, 0), (1, 1), (2, 1)]
            .map(|(row, column): (usize, usize)| heat.cells[row][column].expect("in the grid"));
        assert_eq!(diverged.place, None);
        assert_eq!([best.place, middle.place, worst.place], [Some(0.0), Some(0.5), Some(1.0)]);
        assert!(best.is_chosen && !middle.is_chosen);
        let Importances { labels, shares } = grid().importances();
        assert_eq!(labels, ["held-out period, mean NRMSE"]);
        let [first, second] = [0, 1].map(|place: usize| shares[place].1[0].expect("differs"));
        assert!(second > first, "{shares:?}");
        assert!(first + second <= 1.0);
    }

    #[test]
    fn ranks_stand_in_for_errors() {
        let ranked = Sensitivity { errors: vec![], ..grid() };
        assert_eq!(ranked.heats()[0].label, "kNN");
        assert!(ranked.figure().is_ok());
    }
}
