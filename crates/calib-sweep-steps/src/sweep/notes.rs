//! Notes on the streams and runs of a sweep, for the reader of its results.

use std::collections::BTreeMap;

use calib_base::output::{Printer, percent};
use calib_core::Normaliser;
use calib_data::Dataset;
use calib_sweep::{EnvironmentId, NotFinite, UnitResult};

use crate::sweep::{
    constant_sensors::{self, ConstantSensor},
    groups::StudyGroup,
};

/// Returns the sensors that are constant in a held-out window, and warns about each.
pub(crate) fn standing_still(
    dataset: &Dataset,
    groups: &[StudyGroup],
    sensors: &[(String, usize)],
    printer: &Printer,
) -> Vec<ConstantSensor> {
    let mut constant = Vec::new();
    for group in groups {
        if let (Some(windows), Some(held_out)) = (&group.streams.online, &dataset.held_out) {
            let own = group.own(sensors);
            constant.extend(constant_sensors::all(held_out.states(), windows, &own));
        }
    }
    for sensor in &constant {
        printer.warn(&sensor.note());
    }
    constant
}

/// Returns notes on the runs of each environment whose rollout ceased to be finite, and warns about each.
pub(crate) fn failed_rollouts(
    results: &[UnitResult],
    normaliser: &Normaliser,
    printer: &Printer,
) -> Vec<String> {
    let mut environments: BTreeMap<EnvironmentId, BTreeMap<usize, NotFinite>> = BTreeMap::new();
    for result in results {
        if let Some(not_finite) = result.not_finite {
            let runs = environments.entry(result.unit.environment).or_default();
            runs.insert(result.unit.run, not_finite);
        }
    }
    let notes: Vec<String> = environments.into_iter().map(|(environment, runs)| {
        let told = runs.iter().map(|(run, NotFinite { step, column })| {
            format!("run {run} at step {step} in {}", normaliser.columns()[*column].name)
        });
        format!(
            "the model's rollout left the finite numbers in {environment}: {}; every setting has an infinite error there",
            told.collect::<Vec<_>>().join(", ")
        )
    }).collect();
    for note in &notes {
        printer.warn(note);
    }
    notes
}

/// Returns a sentence on what a race saved of `all` runs. `None` if it dropped no setting.
pub(crate) fn saved(results: &[UnitResult], all: usize) -> Option<String> {
    let made: usize = results.iter().map(|result| result.rows.len()).sum();
    (made < all).then(|| {
        let share = percent((all - made) as f64 / all as f64);
        format!("the race dropped settings early, which saved {share} of the runs; the verdict names them")
    })
}

#[cfg(test)]
mod tests {
    use calib_sweep::{RunRow, Unit};

    use super::*;

    fn result(run: usize, values: usize) -> UnitResult {
        UnitResult {
            key: String::new(),
            unit: Unit { sensor: "A".to_owned(), environment: EnvironmentId::Member(0), run },
            seed: 0,
            start_row: 0,
            not_finite: None,
            rows: (0..values)
                .map(|candidate| RunRow {
                    candidate,
                    steps: 10,
                    updates: 1,
                    scores: calib_agent::Scores::default(),
                    diverged_at: None,
                    curve: Vec::new(),
                })
                .collect(),
        }
    }

    #[test]
    fn what_a_race_saved_is_counted_in_runs() {
        assert_eq!(saved(&[result(0, 4), result(1, 4)], 8), None);
        let told = saved(&[result(0, 4), result(1, 2)], 8).expect("two runs were not made");
        assert!(told.contains("saved 25 % of the runs"), "{told}");
    }
}
