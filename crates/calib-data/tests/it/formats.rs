//! Logs in the forms in which programs and historians write them (`scripts/golden/log_formats.py`).

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use calib_core::{Silent, Timestamp};
use calib_data::{
    Contradictions, DataConfig, Dataset, Paths, PreprocessConfig, Resample, Shape, format_time,
    inspect, load, table::Table,
};
use proptest::prelude::*;

use crate::support::{
    Folder, NAN, load_with, log_at, optional, refused, train_seconds, train_values,
};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/formats").join(name)
}

fn read(name: &str, change: impl FnOnce(&mut DataConfig)) -> Dataset {
    let mut data = DataConfig { train_fraction: 0.7, ..DataConfig::at(golden(name)) };
    change(&mut data);
    load(&data, &PreprocessConfig::default(), &Silent)
        .unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn same_as_reference(name: &str, shape: Shape, change: impl FnOnce(&mut DataConfig)) {
    let reference = read("pyarrow.parquet", |_| {});
    let got = read(name, change);
    let names = |of: &Dataset| -> Vec<String> {
        of.normaliser.columns().iter().map(|column| column.name.clone()).collect()
    };
    assert_eq!(names(&got), names(&reference), "{name}");
    assert_eq!(got.train.states().as_slice(), reference.train.states().as_slice(), "{name}");
    assert_eq!(got.fingerprint, reference.fingerprint, "{name}");
    assert_eq!(got.held_out_fingerprint, reference.held_out_fingerprint, "{name}");
    assert_eq!(got.profile.shape, shape, "{name}");
}

#[test]
fn wide_text_of_other_programs_is_the_same_log() {
    for name in [
        "polars.csv",
        "polars.csv.gz",
        "pyarrow.csv.zst",
        "pandas.tsv",
        "pandas-german.csv",
        "pandas-us.csv",
        "pandas-pi.csv",
        "pandas-units.csv",
        "pandas-epoch.csv",
        "duckdb-zone.csv",
    ] {
        same_as_reference(name, Shape::Wide, |_| {});
    }
    same_as_reference("pandas-paris.csv", Shape::Wide, |data| {
        data.time_zone = Some("Europe/Paris".to_owned())
    });
}

#[test]
fn long_tables_of_other_programs_are_the_same_log() {
    for name in [
        "pandas-long.csv",
        "pandas-long-quality.csv",
        "polars-long.csv",
        "duckdb-long.parquet",
        "ignition.csv",
        "aveva.csv",
        "influxdb.csv",
    ] {
        same_as_reference(name, Shape::Long, |_| {});
    }
}

#[test]
fn files_of_one_tag_each_are_the_same_log() {
    for name in ["polars-per-tag", "pandas-per-tag", "duckdb-hive"] {
        same_as_reference(name, Shape::FilePerTag, |_| {});
    }
}

#[test]
fn working_files_change_nothing() {
    let scratch = tempfile::tempdir().expect("a folder");
    for name in ["polars.csv", "pandas-long-quality.csv"] {
        let in_memory = read(name, |_| {});
        let on_disk = read(name, |data| {
            data.scratch = calib_files::ScratchPlace::Disk(scratch.path().to_owned());
        });
        assert_eq!(in_memory.fingerprint, on_disk.fingerprint);
    }
    assert_eq!(fs::read_dir(scratch.path()).expect("readable").count(), 0);
}

#[test]
fn bad_quality_is_missing_and_counted() {
    let profile = read("pandas-long-quality.csv", |_| {}).profile;
    let missing = |name: &str| profile.channel(name).expect("a channel").missing;
    assert_eq!((profile.bad_quality, missing("PIT300"), missing("TIT101")), (7, 4, 3));
    let words = &profile.channel("PIT300").expect("a channel").values;
    assert!(words.as_ref().is_some_and(|values| values.min > 0.0), "-9999 was bad");
}

fn text(name: &str, text: &str) -> Folder {
    let folder = Folder::new();
    fs::write(folder.file(name), text).expect("written");
    folder
}

fn message(folder: &Folder, change: impl FnOnce(&mut DataConfig)) -> String {
    let mut data = folder.data();
    change(&mut data);
    refused(&data, &PreprocessConfig::default()).to_string()
}

#[test]
fn a_day_that_may_be_a_month_is_asked_for() {
    let rows = |days: std::ops::Range<u32>| {
        let row = |day: u32| format!("0{}/{day:02}/2024 10:00,{day}\n", 3);
        let rows: String = days.map(row).collect();
        format!("time,a\n{rows}")
    };
    let folder = text("a.csv", &rows(1..9));
    let error = message(&folder, |_| {});
    assert!(
        error.contains("2024-01-03 10:00:00 with data.timestamp_format = \"%d/%m/%Y %H:%M\""),
        "{error}"
    );
    assert!(
        error.contains("2024-03-01 10:00:00 with data.timestamp_format = \"%m/%d/%Y %H:%M\""),
        "{error}"
    );
    let data = DataConfig { timestamp_format: Some("%m/%d/%Y %H:%M".to_owned()), ..folder.data() };
    assert_eq!(load_with(&data, &PreprocessConfig::default()).profile.gaps.count, 0);
    // Another file, or a later row, tells.
    fs::write(folder.file("b.csv"), rows(9..20)).expect("written");
    let dataset = folder.load();
    assert_eq!((dataset.train.rows(), dataset.period.as_secs()), (19, 86_400.0));
}

#[test]
fn what_text_leaves_open_is_refused_with_the_line() {
    let error = |content: &str| message(&text("a.csv", content), |_| {});
    let short = error("time,a,b\n2024-01-01,1,2\n2024-01-02,1\n");
    assert!(short.contains("a.csv, line 3: 2 cells, and the header names 3 columns"), "{short}");
    let late = error("time,a\n2024-01-01,1\n2024-01-02,2\nsoon,3\n");
    assert!(late.contains("soon"), "{late}");
    let decimal = error("time;a\n2024-01-01;1,234\n2024-01-02;2,345\n");
    assert!(decimal.contains("data.decimal"), "{decimal}");
    let header = error("2024-01-01,1,2\n2024-01-02,1,2\n");
    assert!(header.contains("expected a header"), "{header}");
    let no_time = error("a,b\n1.5,x\n2.5,y\n");
    assert!(no_time.contains("has no column \"timestamp\""), "{no_time}");
}

#[test]
fn one_file_per_tag_never_loses_tags() {
    let folder = Folder::new();
    let times = || 0..20_i64;
    let values =
        |factor: f64| -> Vec<f64> { times().map(|row| factor * (row % 7) as f64).collect() };
    for (name, factor) in [("a", 1.0), ("b", 2.0), ("c", 3.0)] {
        folder.write(&format!("{name}.parquet"), &log_at(times(), &[("value", &values(factor))]));
    }
    let dataset = folder.load();
    let names: Vec<&str> =
        dataset.profile.channels.iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["a", "b", "c"]);
    assert_eq!(train_values(&dataset, "c"), values(3.0));
    // The same as columns of one name each, on clocks of their own.
    let folder = Folder::new();
    folder.write("x.parquet", &log_at(0..10, &[("a", &values(1.0)[..10])]));
    folder.write("y.parquet", &log_at(5..15, &[("b", &values(2.0)[..10])]));
    let profile = folder.inspect();
    assert_eq!((profile.shape, profile.rows), (Shape::FilePerTag, 15));
    assert_eq!(profile.channel("b").expect("a channel").missing, 5);
}

#[test]
fn wide_files_of_different_channels_are_merged_by_column() {
    let folder = Folder::new();
    let values: Vec<f64> = (0..20_u8).map(f64::from).collect();
    let more: Vec<f64> = values.iter().map(|value| value * 2.0).collect();
    folder.write("x.parquet", &log_at(0..20, &[("a", &values), ("b", &more)]));
    folder.write("y.parquet", &log_at(0..20, &[("c", &more), ("d", &values)]));
    let dataset = folder.load();
    assert_eq!(train_values(&dataset, "c"), more);
    assert_eq!((dataset.profile.rows, dataset.profile.contradictions.count), (20, 0));
    let missing: u64 = dataset.profile.channels.iter().map(|channel| channel.missing).sum();
    assert_eq!(missing, 0);
}

#[test]
fn rows_that_contradict_each_other_are_refused_with_three_of_them() {
    let folder = Folder::new();
    folder.write(
        "a.parquet",
        &log_at(
            [0, 1, 1, 2, 2, 3, 3, 4, 4],
            &[("a", &[0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5])],
        ),
    );
    let error = message(&folder, |_| {});
    assert!(error.contains("contradict each other in 4 values"), "{error}");
    assert!(error.contains("at 1970-01-01 00:00:01 a is 1 and 1.5; at 1970-01-01 00:00:02 a is 2 and 2.5; at 1970-01-01 00:00:03 a is 3 and 3.5."), "{error}");
    assert_eq!(folder.inspect().contradictions.count, 4, "to be looked at");
    let keep = |contradictions| {
        let data = DataConfig { contradictions, ..folder.data() };
        train_values(&load_with(&data, &PreprocessConfig::default()), "a")
    };
    assert_eq!(keep(Contradictions::First), [0.0, 1.0, 2.0, 3.0, 4.0]);
    assert_eq!(keep(Contradictions::Last), [0.0, 1.5, 2.5, 3.5, 4.5]);
    // Of samples too.
    let long = text("a.csv", "time,tag,value\n2024-01-01,a,1\n2024-01-01,a,2\n2024-01-02,a,3\n");
    assert!(message(&long, |_| {}).contains("a is 1 and 2"));
}

#[test]
fn a_long_table_is_never_one_channel() {
    // Names say it, whatever the clocks.
    let named = text(
        "a.csv",
        "time;Tag Name;Value\n2024-01-01 00:00:00;b;1,5\n2024-01-01 00:00:30;a;2\n2024-01-01 00:01:00;b;3\n2024-01-01 00:01:30;a;4\n",
    );
    let names: Vec<String> =
        named.inspect().channels.into_iter().map(|channel| channel.name).collect();
    assert_eq!(names, ["a", "b"]);
    // Names say nothing: the words alternate, as tags do.
    let rows: String = (0..40)
        .map(|row| format!("2024-01-01 00:00:{row:02},{},{row}\n", ["x", "y", "z"][row % 3]))
        .collect();
    let unnamed = text("a.csv", &format!("when,what,how much\n{rows}"));
    let data = DataConfig { timestamp: "when".to_owned(), ..unnamed.data() };
    assert_eq!(
        inspect(&data, &PreprocessConfig::default(), &Silent).expect("a log").shape,
        Shape::Long
    );
    // Words that seldom change are modes, or a tag that speaks seldom: that must be said.
    let rows: String = (0..40)
        .map(|row| format!("2024-01-01 00:00:{row:02},{},{row}\n", ["x", "y"][row / 20]))
        .collect();
    let unclear = text("a.csv", &format!("when,what,how much\n{rows}"));
    let error = message(&unclear, |data| data.timestamp = "when".to_owned());
    assert!(
        error.contains("data.tag = \"what\"") && error.contains("data.shape = \"wide\""),
        "{error}"
    );
    // A wide table with numbers beside what looks like a sample.
    let both = text("a.csv", "time,sensor,value,pressure\n2024-01-01,x,1,2\n2024-01-02,x,1,3\n");
    assert!(message(&both, |_| {}).contains("data.shape = \"long\" or \"wide\""));
}

#[test]
fn changes_are_resampled_to_a_clock() {
    let times = [0, 3, 10, 25, 31, 60, 61];
    let a = [1.0, NAN, 2.0, 3.0, NAN, 4.0, NAN];
    let b = [NAN, 5.0, NAN, NAN, 6.0, NAN, 7.0];
    let folder = Folder::new();
    folder.write("a.parquet", &log_at(times, &[("a", &a), ("b", &b)]));
    let with = |resample| {
        let data = DataConfig {
            resample: Some(resample),
            period_secs: Some(10.0),
            max_age_secs: Some(30.0),
            ..folder.data()
        };
        load_with(&data, &PreprocessConfig { max_missing: 1.0, ..PreprocessConfig::default() })
    };
    let last = with(Resample::Last);
    assert_eq!(train_seconds(&last), [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
    assert_eq!(train_values(&last, "a"), [2.0, 2.0, 3.0, 3.0, 3.0, 4.0]);
    assert_eq!(train_values(&last, "b"), [5.0, 5.0, 5.0, 6.0, 6.0, 6.0]);
    let mean = with(Resample::Mean);
    assert_eq!(train_values(&mean, "a"), [1.0, 2.0, 2.5, 3.0, 3.0, 3.0]);
    // The same from samples.
    let long = Folder::new();
    let samples: String = [("a", a), ("b", b)]
        .iter()
        .flat_map(|(tag, values)| {
            times
                .iter()
                .zip(values)
                .filter(|(_, value)| !value.is_nan())
                .map(move |(time, value)| format!("{time},{tag},{value}\n"))
        })
        .collect();
    fs::write(long.file("a.csv"), format!("time,tag,value\n{samples}")).expect("written");
    let data = DataConfig {
        resample: Some(Resample::Last),
        period_secs: Some(10.0),
        max_age_secs: Some(30.0),
        ..long.data()
    };
    let of_samples =
        load_with(&data, &PreprocessConfig { max_missing: 1.0, ..PreprocessConfig::default() });
    assert_eq!(of_samples.fingerprint, last.fingerprint);
    let error = refused(
        &DataConfig { resample: Some(Resample::Last), ..folder.data() },
        &PreprocessConfig::default(),
    );
    assert!(error.to_string().contains("data.period_secs"), "{error}");
}

#[test]
fn text_beside_parquet_is_left_alone() {
    let folder = Folder::new();
    folder.write("a.parquet", &log_at(0..5, &[("a", &[1.0, 2.0, 3.0, 4.0, 5.0])]));
    fs::write(folder.file("tags.csv"), "tag,unit\na,kPa\n").expect("written");
    assert_eq!(folder.inspect().files, 1);
}

/// Rows with times in seconds and a value of some channels; the first channel has one in every row.
fn tables() -> impl Strategy<Value = (Vec<i64>, Vec<Vec<f64>>)> {
    let value = || prop_oneof![4 => (-1_000_i32..1_000).prop_map(|value| f64::from(value) / 4.0), 1 => Just(NAN)];
    (1_usize..4, 4_usize..30).prop_flat_map(move |(channels, rows)| {
        let first = prop::collection::vec(
            (-1_000_i32..1_000).prop_map(|value| f64::from(value) / 4.0),
            rows,
        );
        let others = prop::collection::vec(prop::collection::vec(value(), rows), channels);
        let steps = prop::collection::vec(prop_oneof![6 => Just(60_i64), 1 => 1_i64..300], rows);
        (first, others, steps).prop_map(|(first, others, steps)| {
            let mut time = 1_710_286_200;
            let times = steps.into_iter().map(|step| {
                time += step;
                time
            });
            (times.collect(), [vec![first], others].concat())
        })
    })
}

const NAMES: [&str; 4] = ["A 1", "B,2", "C", "D"];

/// The table in every shape and notation that it can have, each in a folder of its own.
fn write_shapes(folder: &Folder, times: &[i64], channels: &[Vec<f64>]) -> Vec<PathBuf> {
    let at = |seconds: i64| format_time(Timestamp::from_micros(seconds * 1_000_000));
    let cell = |value: f64, comma: bool| match (value.is_nan(), comma) {
        (true, _) => String::new(),
        (_, false) => value.to_string(),
        (_, true) => format!("{value:?}").replace('.', ","),
    };
    let mut made = Vec::new();
    let mut make = |name: &str, files: Vec<(String, String)>| {
        let at = folder.file(name);
        fs::create_dir_all(&at).expect("created");
        files.into_iter().for_each(|(file, text)| fs::write(at.join(file), text).expect("written"));
        made.push(at);
    };
    for (name, separator, comma) in
        [("comma", ',', false), ("semicolon", ';', true), ("tab", '\t', false)]
    {
        let mut text = String::from("timestamp");
        let header = NAMES.iter().take(channels.len());
        header.for_each(|name| write!(text, "{separator}\"{name}\"").expect("memory"));
        text.push('\n');
        for (row, &time) in times.iter().enumerate() {
            text.push_str(&at(time));
            channels.iter().for_each(|of| {
                write!(text, "{separator}{}", cell(of[row], comma)).expect("memory")
            });
            text.push_str("\r\n");
        }
        make(name, vec![("log.csv".to_owned(), text)]);
    }
    let sample = |tag: usize, row: usize| {
        format!("\"{}\",{},{}\n", NAMES[tag], at(times[row]), channels[tag][row])
    };
    let there = |tag: usize, row: usize| !channels[tag][row].is_nan();
    let rows = || 0..times.len();
    let by_time = rows().flat_map(|row| {
        (0..channels.len()).filter(move |&tag| there(tag, row)).map(move |tag| (tag, row))
    });
    let by_tag = (0..channels.len()).rev().flat_map(|tag| {
        rows().rev().filter(move |&row| there(tag, row)).map(move |row| (tag, row))
    });
    let header = "tag,timestamp,value\n";
    let text = |pairs: Vec<(usize, usize)>| -> String {
        std::iter::once(header.to_owned())
            .chain(pairs.into_iter().map(|(tag, row)| sample(tag, row)))
            .collect()
    };
    make("long", vec![("log.csv".to_owned(), text(by_time.collect()))]);
    make("by-tag", vec![("log.csv".to_owned(), text(by_tag.collect()))]);
    let per_tag = (0..channels.len()).map(|tag| {
        let rows = rows()
            .filter(|&row| there(tag, row))
            .map(|row| format!("{},{}\n", at(times[row]), channels[tag][row]));
        (
            format!("{}.csv", NAMES[tag]),
            std::iter::once("timestamp,value\n".to_owned()).chain(rows).collect(),
        )
    });
    make("per-tag", per_tag.collect());
    made
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_shape_of_the_same_data_gives_the_same_states((times, channels) in tables()) {
        let folder = Folder::new();
        let seconds = times.iter().map(|&second| Timestamp::from_micros(second * 1_000_000)).collect();
        let wide = NAMES.iter().zip(&channels).fold(Table::new().with::<Timestamp>("timestamp", seconds), |table, (name, values)| {
            table.with_optional(*name, optional(values))
        });
        folder.write("wide.parquet", &wide);
        let load = |path: &Path| {
            let data = DataConfig { train_fraction: 0.7, path: Paths::from(path), ..DataConfig::default() };
            let preprocess = PreprocessConfig { max_missing: 0.6, fill_limit: 3, ..PreprocessConfig::default() };
            load(&data, &preprocess, &Silent).map(|of| (of.fingerprint, of.held_out_fingerprint)).map_err(|error| error.to_string())
        };
        let expected = load(&folder.file("wide.parquet"));
        for path in write_shapes(&folder, &times, &channels) {
            let got = load(&path);
            match (&got, &expected) {
                (Ok(got), Ok(expected)) => prop_assert_eq!(got, expected, "{}", path.display()),
                (Err(_), Err(_)) => {}
                _ => prop_assert!(false, "{}: {:?} and {:?}", path.display(), got, expected),
            }
        }
    }
}
