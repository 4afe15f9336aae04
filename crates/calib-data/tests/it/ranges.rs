//! Tests of ranges, fingerprints, settings and interruption.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use calib_core::Monitor;
use calib_data::{DataConfig, DataError, Missing, Normalisation, PreprocessConfig, load};

use crate::support::{
    Folder, assert_refused, assert_refused_with, load_with, log, segment_lengths, train_seconds,
};

fn folder() -> Folder {
    let values: Vec<f64> = (0..100_i32).map(|i| f64::from(i % 7)).collect();
    Folder::of("a.parquet", &log(0, &[("a", &values), ("b", &values)]))
}

fn configured(folder: &Folder, toml: &str) -> DataConfig {
    let mut data: DataConfig = toml::from_str(toml).expect("valid");
    data.resolve(folder.path());
    data
}

#[test]
fn ranges_are_half_open_and_no_segment_crosses_them() {
    let folder = folder();
    let data = configured(
        &folder,
        r#"
        path = "a.parquet"
        train = { start = "1970-01-01T00:00:10", end = 1970-01-01T00:00:20 }
        held_out = { start = "1970-01-01T00:00:20" }
        "#,
    );
    let dataset = load_with(&data, &PreprocessConfig::default());
    let expected: Vec<f64> = (10..20).map(f64::from).collect();
    assert_eq!(train_seconds(&dataset), expected);
    assert_eq!(segment_lengths(&dataset), [10]);
    let held_out = dataset.held_out.as_ref().expect("a held-out range");
    assert_eq!((held_out.rows(), held_out.segments().len()), (80, 1));
    let profile = &dataset.profile;
    assert_eq!((profile.rows, profile.rows_outside), (90, 10));
    assert_eq!((profile.train.rows, profile.train.transitions), (10, 9));
}

#[test]
fn rows_between_the_ranges_are_not_used() {
    let folder = folder();
    let data = configured(
        &folder,
        r#"
        path = ["a.parquet"]
        held_out = { end = "1970-01-01T00:00:20" }
        train = { start = "1970-01-01T00:00:50", end = "1970-01-01T00:00:60" }
        "#
        .replace("00:60", "01:00")
        .as_str(),
    );
    let dataset = load_with(&data, &PreprocessConfig::default());
    assert_eq!(dataset.train.rows(), 10);
    assert_eq!(dataset.held_out.as_ref().map(calib_core::Frames::rows), Some(20));
    assert_eq!(dataset.profile.rows, 60);
}

#[test]
fn bad_ranges_are_refused() {
    let folder = folder();
    for (toml, part) in [
        (
            "train = { end = \"1970-01-01T00:01:00\" }\nheld_out = { start = \"1970-01-01T00:00:59\" }",
            "data.train (beginning of the log .. 1970-01-01T00:01:00) and data.held_out",
        ),
        (
            "train = { start = \"2022-11-01\" }",
            "the log runs from 1970-01-01 00:00:00 to 1970-01-01 00:01:39",
        ),
        (
            "train = { start = \"1970-01-01T00:00:01.2\", end = \"1970-01-01T00:00:01.8\" }",
            "holds no rows",
        ),
        (
            "train = { start = \"1970-01-02\", end = \"1970-01-01\" }",
            "expected a start before the end",
        ),
        (
            "held_out = { start = \"1970-01-01T00:00:59\" }",
            "data.held_out is set without data.train: set both",
        ),
    ] {
        assert_refused(&configured(&folder, &format!("path = \".\"\n{toml}")), &[part]);
    }
}

#[test]
fn a_range_of_one_row_has_no_transition() {
    let folder = folder();
    let data = configured(
        &folder,
        "path = \".\"\ntrain = { end = \"1970-01-01T00:00:50\" }\nheld_out = { start = \"1970-01-01T00:01:39\" }",
    );
    let part = "data.held_out has no two successive rows left: 1 rows, 0 of them dropped";
    assert_refused(&data, &[part]);
}

#[test]
fn the_fingerprint_is_of_what_a_model_sees() {
    let values: Vec<f64> = (0..60_i32).map(|i| f64::from(i % 7)).collect();
    let one = Folder::of("all.parquet", &log(0, &[("a", &values)]));
    let many = Folder::of("2.parquet", &log(0, &[("a", &values[..20])]));
    many.write("1/1.parquet", &log(20, &[("a", &values[20..])]));
    let fingerprint = one.load().fingerprint;
    assert_eq!(many.load().fingerprint, fingerprint);
    let mut other = values;
    other[30] += 0.5;
    many.write("1/1.parquet", &log(20, &[("a", &other[20..])]));
    assert_ne!(many.load().fingerprint, fingerprint);
    let standard =
        PreprocessConfig { normalise: Normalisation::Standard, ..PreprocessConfig::default() };
    assert_ne!(load_with(&one.data(), &standard).fingerprint, fingerprint);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let folder = folder();
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| folder.load())
    });
    assert_eq!(one.fingerprint, three.fingerprint);
    assert_eq!(one.profile, three.profile);
}

#[test]
fn settings_are_checked() {
    let folder = folder();
    for (toml, part) in [
        ("max_missing = 2.0", "preprocess.max_missing = 2: expected a fraction from 0 to 1"),
        ("quantiles = [0.9, 0.1]", "two increasing fractions"),
        ("traces = [1.0]", "decay rates from 0 to below 1"),
        ("subsample = 0", "at least 1"),
        ("clip = true\nnormalise = \"standard\"", "no ends to clip to"),
    ] {
        assert_refused_with(&folder.data(), &toml::from_str(toml).expect("well-formed"), &[part]);
    }
    let data = DataConfig { gap_tolerance: 0.5, ..folder.data() };
    assert_refused(&data, &["data.gap_tolerance = 0.5: expected a number above 1"]);
}

#[test]
fn settings_come_from_toml_and_go_back() {
    let preprocess: PreprocessConfig = toml::from_str(
        "missing = \"linear\"\nnormalise = \"quantile\"\nquantiles = [0.05, 0.95]\none_hot = \"MODE\"",
    )
    .expect("valid");
    assert_eq!((preprocess.missing, preprocess.fill_limit), (Missing::Linear, 10));
    let text = toml::to_string(&preprocess).expect("serialisable");
    assert_eq!(toml::from_str::<PreprocessConfig>(&text).expect("valid"), preprocess);

    let data: DataConfig = toml::from_str(
        "path = [\"a\", \"b/*.parquet\"]\npartitions = { well = \"1\" }\ntimestamp_unit = \"ms\"\ntrain = { start = 2022-11-01, end = \"2022-12-01\" }",
    )
    .expect("valid");
    let text = toml::to_string(&data).expect("serialisable");
    assert_eq!(toml::from_str::<DataConfig>(&text).expect("valid"), data);

    let unknown =
        toml::from_str::<DataConfig>("paht = \"a\"").expect_err("unknown key").to_string();
    assert!(unknown.contains("unknown field `paht`"), "{unknown}");
    let number = toml::from_str::<DataConfig>("path = 3").expect_err("a number").to_string();
    assert!(number.contains("expected a path, a glob pattern, or a list of them"), "{number}");
    let time = toml::from_str::<DataConfig>("train = { start = \"noon\" }")
        .expect_err("no time")
        .to_string();
    assert!(time.contains("\"noon\" is not a time; expected a date such as 2022-11-01"), "{time}");
}

/// A monitor that requests a stop after a number of checks.
struct Impatient(AtomicU64);

impl Monitor for Impatient {
    fn begin(&self, _task: &str, _total: u64) {}

    fn advance(&self, _units: u64) {}

    fn interrupted(&self) -> bool {
        self.0.fetch_sub(1, Relaxed) == 0
    }
}

#[test]
fn loading_stops_when_asked() {
    let folder = folder();
    for patience in 0..3 {
        let monitor = Impatient(AtomicU64::new(patience));
        let stopped = load(&folder.data(), &PreprocessConfig::default(), &monitor);
        assert!(matches!(stopped, Err(DataError::Cancelled(_))), "after {patience}");
    }
}
