//! Sensors that are constant in held-out data. There is nothing to predict, so errors there do not rank settings.

use std::ops::Range;

use calib_core::States;
use calib_sweep::Windows;

/// A sensor that is constant in some of the windows.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct ConstantSensor {
    sensor: String,
    /// Windows in which it is constant.
    windows: usize,
    /// All windows.
    all_windows: usize,
}

/// Returns those of `sensors` (name and column of the `held_out` states) that are constant in some window.
pub(crate) fn all(
    held_out: &States,
    windows: &Windows,
    sensors: &[(String, usize)],
) -> Vec<ConstantSensor> {
    let all_windows = windows.starts.len();
    sensors
        .iter()
        .map(|(sensor, column): &(String, usize)| {
            let still = windows.starts.iter().filter(|&&start| {
                let rows = start..(start + windows.states).min(held_out.rows());
                is_constant(held_out, rows, *column)
            });
            ConstantSensor { sensor: sensor.clone(), windows: still.count(), all_windows }
        })
        .filter(|still| still.windows > 0)
        .collect()
}

/// Whether a sensor has one value in all of the rows.
fn is_constant(held_out: &States, mut rows: Range<usize>, column: usize) -> bool {
    let start = rows.start;
    rows.all(|row| held_out.row(row)[column] == held_out.row(start)[column])
}

impl ConstantSensor {
    /// Returns the name of the sensor, if it is constant in all windows.
    pub(crate) fn everywhere(&self) -> Option<String> {
        (self.windows == self.all_windows).then(|| self.sensor.clone())
    }

    /// Returns a note for the reader of the results.
    pub(crate) fn note(&self) -> String {
        let Self { sensor, windows, all_windows } = self;
        let place = match all_windows {
            1 => "the window".to_owned(),
            _ if windows == all_windows => format!("all {all_windows} windows"),
            _ => format!("{windows} of {all_windows} windows"),
        };
        format!(
            "{sensor} is constant in {place} of the held-out period, though not in the training range: there is nothing to predict, and errors there say nothing about a choice; hold out a period in which it changes"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_is_still_where_all_rows_of_a_window_are_equal() {
        // Column 0 changes in the second window only, column 1 in none, column 2 in both.
        let rows: [[f32; 3]; 6] = [
            [1.0, 5.0, 1.0],
            [1.0, 5.0, 2.0],
            [1.0, 5.0, 3.0],
            [1.0, 5.0, 4.0],
            [2.0, 5.0, 5.0],
            [1.0, 5.0, 6.0],
        ];
        let states = States::new(rows.concat(), 6, 3).expect("finite");
        let windows = Windows { starts: vec![0, 3], states: 3, left_out: 0 };
        let sensors = ["a", "b", "c"].into_iter().enumerate();
        let sensors: Vec<_> = sensors.map(|(column, name)| (name.to_owned(), column)).collect();
        let still = all(&states, &windows, &sensors);
        let told: Vec<_> =
            still.iter().map(|sensor| (sensor.sensor.as_str(), sensor.windows)).collect();
        assert_eq!(told, [("a", 1), ("b", 2)]);
        assert_eq!(still[0].everywhere(), None);
        assert_eq!(still[1].everywhere().as_deref(), Some("b"));
        assert!(still[0].note().starts_with("a is constant in 1 of 2 windows"));
        assert!(still[1].note().starts_with("b is constant in all 2 windows"));
    }
}
