//! Continuous actions: levels of the recorded range, and the values that were set.

use calib_core::States;

use crate::{ControlError, LEAST_LEVELS, Levels, level_grid::of_column};

/// The recorded values of continuous actions, and the levels that an agent chooses among. Each column is a share of its recorded range.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    columns: usize,
    /// Recorded values, `[rows, columns]`; 0 in rows without an action.
    of_rows: Vec<f32>,
    /// Levels, `[levels, columns]`.
    of_levels: Vec<f32>,
}

impl Levels {
    /// Returns the levels of continuous actions, and the recorded values, given `[columns][rows]` with NaN for missing values. Levels are
    /// all combinations of up to `levels` values per column. These are the column's own values if it has at most so many, one value per
    /// narrow cluster, or an even grid over its recorded range without the levels that are nearest to no row. The action of a row is the
    /// level that is nearest to its values, in shares of the ranges.
    ///
    /// # Errors
    /// If there are more than `most` combinations.
    ///
    /// # Panics
    /// If `levels` is less than two.
    pub fn of_range(
        columns: &[Vec<f64>],
        levels: usize,
        most: usize,
    ) -> Result<(Self, Settings), ControlError> {
        assert!(levels >= LEAST_LEVELS, "checked with the configuration");
        let own: Vec<Vec<f64>> = columns.iter().map(|column| of_column(column, levels)).collect();
        let mut values: Vec<Vec<f64>> = vec![Vec::new()];
        for column in &own {
            if values.len() * column.len() > most {
                let remedy = if levels > LEAST_LEVELS {
                    "set control.levels lower"
                } else {
                    "name fewer columns in control.actions"
                };
                return Err(ControlError::ManyLevels { most, remedy });
            }
            values = values
                .iter()
                .flat_map(|settings| {
                    column.iter().map(move |&value| [&settings[..], &[value]].concat())
                })
                .collect();
        }
        let ranges: Vec<f64> = own
            .iter()
            .map(|column| match (column.first(), column.last()) {
                (Some(low), Some(high)) if high > low => high - low,
                _ => 1.0,
            })
            .collect();
        let lows: Vec<f64> =
            own.iter().map(|column| column.first().copied().unwrap_or(0.0)).collect();
        let of_levels: Vec<f32> =
            values.iter().flat_map(|set| shares(set, &lows, &ranges)).collect();
        let width = columns.len();
        let rows = columns.first().map_or(0, Vec::len);
        let mut of_rows = Vec::with_capacity(rows * width);
        let mut nearest = Vec::new();
        for row in 0..rows {
            let set: Vec<f64> = columns.iter().map(|column| column[row]).collect();
            let there = set.iter().all(|value| !value.is_nan());
            let set = if there { shares(&set, &lows, &ranges) } else { vec![0.0; width] };
            nearest.push(there.then(|| nearest_of(&of_levels, &set)));
            of_rows.extend(set);
        }
        let settings = Settings { columns: width, of_rows, of_levels };
        Ok((Self { values, of_rows: nearest }, settings))
    }
}

/// Returns values of each column as shares of its range.
fn shares(values: &[f64], lows: &[f64], ranges: &[f64]) -> Vec<f32> {
    let each = values.iter().zip(lows).zip(ranges);
    each.map(|((value, low), range)| ((value - low) / range) as f32).collect()
}

/// Returns the level nearest to the values that were set, or the first of several.
fn nearest_of(levels: &[f32], set: &[f32]) -> u16 {
    let distances = levels
        .chunks(set.len())
        .map(|level: &[f32]| -> f32 {
            level.iter().zip(set).map(|(level, set)| (level - set).powi(2)).sum()
        })
        .enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |nearest| nearest.0 as u16)
}

impl Settings {
    /// Returns settings read from a file: `[rows, columns]` and `[levels, columns]`.
    pub(crate) fn from_parts(of_rows: Vec<f32>, of_levels: Vec<f32>, levels: usize) -> Self {
        Self { columns: of_levels.len() / levels, of_rows, of_levels }
    }

    /// Returns the number of columns of actions.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Returns the values that were set in each row, `[rows, columns]`; 0 in rows without an action.
    pub fn of_rows(&self) -> &[f32] {
        &self.of_rows
    }

    /// Returns the levels, `[levels, columns]`.
    pub fn of_levels(&self) -> &[f32] {
        &self.of_levels
    }

    /// Returns the values that were set in a row.
    pub fn of_row(&self, row: usize) -> &[f32] {
        &self.of_rows[row * self.columns..][..self.columns]
    }

    /// Returns the values of a level.
    pub fn of_level(&self, level: usize) -> &[f32] {
        &self.of_levels[level * self.columns..][..self.columns]
    }

    /// Returns the number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.of_rows.len() / self.columns
    }

    /// Returns the number of levels.
    pub(crate) fn levels(&self) -> usize {
        self.of_levels.len() / self.columns
    }

    /// Returns `metric` with the values that were set in each row as further columns, times `weight`.
    pub(crate) fn taken(&self, metric: &States, weight: f64) -> Result<States, ControlError> {
        joined(metric.rows(), self.columns, |row| (metric.row(row), self.of_row(row)), weight)
    }

    /// Returns `metric` with the values of a level as further columns, times `weight`.
    pub(crate) fn at_level(
        &self,
        metric: &States,
        level: usize,
        weight: f64,
    ) -> Result<States, ControlError> {
        let set = self.of_level(level);
        joined(metric.rows(), self.columns, |row| (metric.row(row), set), weight)
    }
}

fn joined<'a>(
    rows: usize,
    columns: usize,
    at_row: impl Fn(usize) -> (&'a [f32], &'a [f32]),
    weight: f64,
) -> Result<States, ControlError> {
    let mut values = Vec::new();
    for row in 0..rows {
        let (state, set) = at_row(row);
        values.extend_from_slice(state);
        values.extend(set.iter().map(|value| (weight * f64::from(*value)) as f32));
    }
    let width = values.len().checked_div(rows).unwrap_or(columns);
    Ok(States::new(values, rows, width)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_an_even_grid_and_rows_have_the_nearest() {
        let torque = vec![-2.0, 1.9, 0.1, f64::NAN, 2.0, -0.9, 1.2];
        let (levels, settings) = Levels::of_range(&[torque], 5, 64).expect("five");
        assert_eq!(levels.values, [[-2.0], [-1.0], [0.0], [1.0], [2.0]]);
        assert_eq!(levels.of_rows, [Some(0), Some(4), Some(2), None, Some(4), Some(1), Some(3)]);
        assert_eq!((settings.rows(), settings.levels()), (7, 5));
        let metric = States::new(vec![7.0; 7], 7, 1).expect("valid");
        let taken = settings.taken(&metric, 2.0).expect("finite");
        assert_eq!(taken.row(1), [7.0, (2.0 * (1.9 + 2.0) / 4.0) as f32]);
        assert_eq!(taken.row(3), [7.0, 0.0], "nothing was set");
        let level = settings.at_level(&metric.slice(0..1), 4, 0.5).expect("finite");
        assert_eq!(level.row(0), [7.0, 0.5]);
    }

    #[test]
    fn columns_combine_and_few_values_stay_as_they_are() {
        let dose = (0..100).map(f64::from).collect::<Vec<_>>();
        let pump = (0..100).map(|row| f64::from(row % 2) * 5.0).collect::<Vec<_>>();
        let columns = [dose, pump];
        let (levels, _) = Levels::of_range(&columns, 3, 6).expect("six");
        assert_eq!(levels.values.len(), 6);
        assert_eq!(levels.values[3], [49.5, 5.0]);
        let eight = Levels::of_range(&columns, 4, 6).expect_err("too many").to_string();
        assert!(eight.contains("more than 6 combinations; set control.levels lower"), "{eight}");
        let four = Levels::of_range(&columns, 2, 3).expect_err("too many").to_string();
        assert!(four.contains("; name fewer columns in control.actions"), "{four}");
        let (constant, _) = Levels::of_range(&[vec![3.0; 4]], 4, 6).expect("one");
        assert_eq!(constant.values, [[3.0]]);
    }
}
