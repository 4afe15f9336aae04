//! Recorded values of the predicted sensors: the sweep keeps them, and the report shows them.

use std::fs;

use calib_core::Timestamp;
use calib_data::table::read_parquet;

use crate::harness::Place;

/// Smallest and largest value, and the first and last time.
#[derive(Debug, Default)]
struct Range {
    values: Vec<f64>,
    times: Vec<Timestamp>,
}

impl Range {
    fn ends(&self) -> (f64, f64) {
        let low = self.values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = self.values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (low, high)
    }
}

/// Returns the range that the sweep kept for a sensor in a period.
fn kept(place: &Place, period: &str, sensor: &str) -> Range {
    let path = place.path().join("study-results/sweep/recorded.parquet");
    let table = read_parquet(&path).expect("readable");
    let periods = table.column::<String>("period").expect("a column");
    let sensors = table.column::<String>("sensor").expect("a column");
    let times = table.column::<Timestamp>("timestamp").expect("a column");
    let values = table.optional::<f64>("value").expect("a column");
    let mut range = Range::default();
    for row in (0..table.rows()).filter(|&row| periods[row] == period && sensors[row] == sensor) {
        range.times.push(times[row]);
        range.values.extend(values[row]);
    }
    range
}

/// Returns the range of the sensor in the log between two instants.
fn logged(place: &Place, sensor: &str, from: Timestamp, to: Timestamp) -> Range {
    let mut range = Range::default();
    for day in ["2022-11-01", "2022-11-02", "2022-11-03"] {
        let path = place.path().join(format!("data/{day}.parquet"));
        let table = read_parquet(&path).expect("readable");
        let times = table.column::<Timestamp>("timestamp").expect("a column").to_vec();
        let values = table.optional::<f32>(sensor).expect("a column");
        let rows = times.into_iter().zip(values).filter(|(time, _)| (from..=to).contains(time));
        for (time, value) in rows {
            range.times.push(time);
            range.values.extend(value.map(f64::from));
        }
    }
    range
}

#[test]
fn a_sweep_keeps_the_extremes_of_what_was_recorded_in_physical_units() {
    let place = Place::with_study();
    place.run_steps(&["build-model", "sweep", "evaluate"]);
    let mut before: Option<Timestamp> = None;
    for period in ["training", "held-out"] {
        for sensor in ["PIT300", "TIT101"] {
            let kept = kept(&place, period, sensor);
            assert!(kept.times.is_sorted(), "{period}, {sensor}");
            assert!((100..=1300).contains(&kept.times.len()), "{} points", kept.times.len());
            let first = kept.times[0];
            let last = kept.times[kept.times.len() - 1];
            let (low, high) = kept.ends();
            let (least, most) = logged(&place, sensor, first, last).ends();
            assert!((low - least).abs() < 1e-3 && (high - most).abs() < 1e-3, "{period}, {sensor}");
            if period == "held-out" {
                assert!(before.is_some_and(|training| training < first), "after the training");
            } else {
                before = Some(last);
            }
        }
    }
    let results = place.path().join("study-results");
    let report = place.read("study-results/report.html");
    for text in ["id=\"recorded\"", "training: 2022-11-01 00:00 to ", "held out: 2022-11-03 "] {
        assert!(report.contains(text), "{text} is missing");
    }
    let svg = place.read("study-results/evaluate/figures/recorded-TIT101.svg");
    assert!(svg.contains("<desc") && svg.contains("held out: 2022-11-03 "), "{svg}");

    // A lost file is reported, and made again.
    fs::remove_file(results.join("sweep/recorded.parquet")).expect("there");
    let lost = place.calib(&["evaluate", "study.toml"]).fails(2);
    assert!(lost.contains("recorded.parquet") && lost.contains("calib sweep study.toml"), "{lost}");
    place.calib(&["sweep", "study.toml"]).succeeds();
    assert!(results.join("sweep/recorded.parquet").is_file());
}
