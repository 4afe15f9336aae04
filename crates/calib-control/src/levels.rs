use std::cmp::Ordering;

use calib_core::exact;

use crate::ControlError;

/// An action with fewer steps is hardly known. Our choice.
pub const FEW_STEPS: usize = 30;

/// The fewest levels of a column of continuous actions. With fewer there is nothing to choose.
pub const LEAST_LEVELS: usize = 2;

/// The actions of a log: every combination of values of its action columns that occurs, in ascending
/// order.
#[derive(Clone, Debug, PartialEq)]
pub struct Levels {
    /// The values of each action, one per column.
    pub values: Vec<Vec<f64>>,
    /// The action of each row; `None` where a value is missing.
    pub of_rows: Vec<Option<u16>>,
}

impl Levels {
    /// Returns the actions of `columns`, `[columns][rows]`, with NaN for missing values.
    ///
    /// # Errors
    /// If there are more than `most`.
    pub fn new(columns: &[Vec<f64>], most: usize) -> Result<Self, ControlError> {
        let rows = columns.first().map_or(0, Vec::len);
        let mut values: Vec<Vec<f64>> = Vec::new();
        for row in 0..rows {
            let Some(here) = values_in(columns, row) else { continue };
            if let Err(place) = values.binary_search_by(|level| compare(level, &here)) {
                if values.len() == most {
                    return Err(ControlError::ManyActions { most });
                }
                values.insert(place, here);
            }
        }
        let of_rows = (0..rows)
            .map(|row: usize| {
                let here = values_in(columns, row)?;
                values
                    .binary_search_by(|level| compare(level, &here))
                    .ok()
                    .map(|place| place as u16)
            })
            .collect();
        Ok(Self { values, of_rows })
    }

    /// Returns the name of an action: its values by column.
    pub fn name(&self, action: usize, columns: &[String]) -> String {
        let values = columns.iter().zip(&self.values[action]);
        let told: Vec<String> =
            values.map(|(column, &value)| format!("{column}={}", exact(value))).collect();
        told.join(" ")
    }
}

/// Returns the values of `columns` in a row; `None` if one is missing.
fn values_in(columns: &[Vec<f64>], row: usize) -> Option<Vec<f64>> {
    // Adding 0 turns −0 into 0.
    let values: Vec<f64> = columns.iter().map(|column| column[row] + 0.0).collect();
    values.iter().all(|value| !value.is_nan()).then_some(values)
}

/// Compares two actions by the first values that differ.
fn compare(a: &[f64], b: &[f64]) -> Ordering {
    let mut orders = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
    orders.find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_found_and_listed_in_order() {
        let nan = f64::NAN;
        let dose = vec![1.0, 0.0, -0.0, nan, 1.0];
        let pump = vec![5.0, 5.0, 5.0, 5.0, 2.0];
        let levels = Levels::new(&[dose, pump], 8).expect("three");
        assert_eq!(levels.values, [[0.0, 5.0], [1.0, 2.0], [1.0, 5.0]]);
        assert_eq!(levels.of_rows, [Some(2), Some(0), Some(0), None, Some(1)]);
        let names = ["dose", "pump"].map(str::to_owned);
        assert_eq!(levels.name(1, &names), "dose=1 pump=2");
        let precise = Levels::new(&[vec![f64::from(0.28_f32)], vec![0.28]], 8).expect("one");
        assert_eq!(precise.name(0, &names), "dose=0.28 pump=0.28");
    }

    #[test]
    fn a_continuous_column_is_refused() {
        let many = vec![(0..100).map(f64::from).collect::<Vec<_>>()];
        let told = Levels::new(&many, 64).expect_err("100 levels").to_string();
        assert!(told.contains("64") && told.contains("most_actions"), "{told}");
    }
}
