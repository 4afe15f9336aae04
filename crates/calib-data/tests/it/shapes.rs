//! Tests that any shape and notation of the same data gives the same states.

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use calib_core::{Silent, Timestamp};
use calib_data::{
    ChannelProfile, ChannelSketch, DataConfig, Paths, PreprocessConfig, ValueProfile, format_time,
    inspect, load, sketch,
};
use calib_files::Fingerprint;
use proptest::prelude::*;

use crate::support::{Folder, NAN, log_at};

fn quarters() -> impl Strategy<Value = f64> {
    (-1_000_i32..1_000).prop_map(|value| f64::from(value) / 4.0)
}

/// Generates rows with times in seconds and values of some channels; the first channel has a value in
/// every row.
fn tables() -> impl Strategy<Value = (Vec<i64>, Vec<Vec<f64>>)> {
    (1_usize..4, 4_usize..30).prop_flat_map(|(channels, rows)| {
        let first = prop::collection::vec(quarters(), rows);
        let value = prop_oneof![4 => quarters(), 1 => Just(NAN)];
        let others = prop::collection::vec(prop::collection::vec(value, rows), channels);
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

fn written_time(seconds: i64) -> String {
    format_time(Timestamp::from_micros(seconds * 1_000_000))
}

/// Formats a value as text, with a decimal comma or point.
fn cell(value: f64, comma: bool) -> String {
    match (value.is_nan(), comma) {
        (true, _) => String::new(),
        (_, false) => value.to_string(),
        (_, true) => format!("{value:?}").replace('.', ","),
    }
}

/// Writes the table as wide Parquet.
fn wide(times: &[i64], channels: &[Vec<f64>]) -> Folder {
    let channels: Vec<(&str, &[f64])> =
        NAMES.into_iter().zip(channels.iter().map(Vec::as_slice)).collect();
    Folder::of("wide.parquet", &log_at(times.iter().copied(), &channels))
}

/// Writes files into a folder of their own, and returns its path.
fn write_files(folder: &Folder, name: &str, files: Vec<(String, String)>) -> PathBuf {
    let at = folder.file(name);
    fs::create_dir_all(&at).expect("created");
    for (file, text) in files {
        fs::write(at.join(file), text).expect("written");
    }
    at
}

/// Returns the long table of the values at these places, each a tag and a row.
fn long_table(
    places: impl Iterator<Item = (usize, usize)>,
    times: &[i64],
    channels: &[Vec<f64>],
) -> String {
    let samples = places.map(|(tag, row)| {
        format!("\"{}\",{},{}\n", NAMES[tag], written_time(times[row]), channels[tag][row])
    });
    std::iter::once("tag,timestamp,value\n".to_owned()).chain(samples).collect()
}

/// Writes the table in every shape and notation that it can have, each in its own folder.
fn write_shapes(folder: &Folder, times: &[i64], channels: &[Vec<f64>]) -> Vec<PathBuf> {
    let mut made = Vec::new();
    for (name, separator, comma) in
        [("comma", ',', false), ("semicolon", ';', true), ("tab", '\t', false)]
    {
        let mut text = String::from("timestamp");
        let header = NAMES.iter().take(channels.len());
        header.for_each(|name| write!(text, "{separator}\"{name}\"").expect("memory"));
        text.push('\n');
        for (row, &time) in times.iter().enumerate() {
            text.push_str(&written_time(time));
            for values in channels {
                write!(text, "{separator}{}", cell(values[row], comma)).expect("memory");
            }
            text.push_str("\r\n");
        }
        made.push(write_files(folder, name, vec![("log.csv".to_owned(), text)]));
    }
    let there = |tag: usize, row: usize| !channels[tag][row].is_nan();
    let by_time = (0..times.len()).flat_map(|row| {
        (0..channels.len()).filter(move |&tag| there(tag, row)).map(move |tag| (tag, row))
    });
    let by_tag = (0..channels.len()).rev().flat_map(|tag| {
        (0..times.len()).rev().filter(move |&row| there(tag, row)).map(move |row| (tag, row))
    });
    let text = long_table(by_time, times, channels);
    made.push(write_files(folder, "long", vec![("log.csv".to_owned(), text)]));
    let text = long_table(by_tag, times, channels);
    made.push(write_files(folder, "by-tag", vec![("log.csv".to_owned(), text)]));
    let per_tag = (0..channels.len()).map(|tag| {
        let rows = (0..times.len())
            .filter(|&row| there(tag, row))
            .map(|row| format!("{},{}\n", written_time(times[row]), channels[tag][row]));
        (
            format!("{}.csv", NAMES[tag]),
            std::iter::once("timestamp,value\n".to_owned()).chain(rows).collect(),
        )
    });
    made.push(write_files(folder, "per-tag", per_tag.collect()));
    made
}

fn data_at(path: &Path) -> DataConfig {
    DataConfig { train_fraction: 0.7, path: Paths::from(path), ..DataConfig::default() }
}

/// Returns the fingerprints of the states of both ranges.
fn fingerprints(path: &Path) -> Result<(Fingerprint, Option<Fingerprint>), String> {
    let preprocess =
        PreprocessConfig { max_missing: 0.6, fill_limit: 3, ..PreprocessConfig::default() };
    load(&data_at(path), &preprocess, &Silent)
        .map(|dataset| (dataset.fingerprint, dataset.held_out_fingerprint))
        .map_err(|error| error.to_string())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_shape_of_the_same_data_gives_the_same_states((times, channels) in tables()) {
        let folder = wide(&times, &channels);
        let expected = fingerprints(&folder.file("wide.parquet"));
        for path in write_shapes(&folder, &times, &channels) {
            let got = fingerprints(&path);
            match (&got, &expected) {
                (Ok(got), Ok(expected)) => prop_assert_eq!(got, expected, "{}", path.display()),
                (Err(_), Err(_)) => {}
                _ => prop_assert!(false, "{}: {:?} and {:?}", path.display(), got, expected),
            }
        }
    }
}

/// Generates a channel with a value in every row, and some channels with few values, including spikes.
fn seldom() -> impl Strategy<Value = (Vec<i64>, Vec<Vec<f64>>)> {
    let value = prop_oneof![
        60 => Just(NAN),
        3 => (0_i32..8).prop_map(f64::from),
        1 => Just(1e9),
    ];
    let run = (value, 1_usize..6).prop_map(|(value, length)| vec![value; length]);
    let channel = prop::collection::vec(run, 300).prop_map(|runs| runs.concat()[..300].to_vec());
    let steps = prop::collection::vec(prop_oneof![20 => Just(60_i64), 1 => 61_i64..900], 300);
    (prop::collection::vec(channel, 1..4), steps).prop_map(|(others, steps)| {
        let mut time = 1_710_286_200;
        let times = steps.into_iter().map(|step| {
            time += step;
            time
        });
        let first: Vec<f64> = (0..300).map(|row| f64::from(row % 17)).collect();
        (times.collect(), [vec![first], others].concat())
    })
}

fn alike(left: f64, right: f64) -> bool {
    left == right
        || left.is_nan() && right.is_nan()
        || (left - right).abs() <= 1e-9 * left.abs().max(right.abs())
}

/// Formats a profile without the sums that another order of additions may change, and without the
/// names of types.
fn told(channel: &ChannelProfile) -> String {
    let values =
        channel.values.clone().map(|values| ValueProfile { mean: 0.0, std: 0.0, ..values });
    format!("{:?}", ChannelProfile { values, type_name: String::new(), ..channel.clone() })
}

fn looked(channel: &ChannelSketch) -> String {
    format!("{:?}", ChannelSketch { autocorrelation: Vec::new(), ..channel.clone() })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn channels_with_few_values_are_told_by_them_as_by_all_rows((times, channels) in seldom(), max_missing in prop::sample::select(vec![0.5, 0.99, 1.0])) {
        let folder = wide(&times, &channels);
        let long = write_shapes(&folder, &times, &channels).into_iter().find(|path| path.ends_with("long")).expect("made");
        let preprocess = PreprocessConfig { max_missing, ..PreprocessConfig::default() };
        let [wide_log, long_log] = [&folder.file("wide.parquet"), &long]
            .map(|path| inspect(&data_at(path), &preprocess, &Silent).expect("a log"));
        for channel in &long_log.channels {
            let expected = wide_log.channel(&channel.name).expect("there");
            prop_assert_eq!(told(channel), told(expected));
            if let (Some(values), Some(expected)) = (&channel.values, &expected.values) {
                prop_assert!(alike(values.mean, expected.mean) && alike(values.std, expected.std));
            }
        }
        prop_assert_eq!((long_log.train, long_log.held_out), (wide_log.train, wide_log.held_out));
        let wide_log = sketch(&data_at(&folder.file("wide.parquet")), &Silent).expect("a log");
        let long_log = sketch(&data_at(&long), &Silent).expect("a log");
        for channel in &long_log.channels {
            let expected = wide_log.channels.iter().find(|other| other.name == channel.name).expect("there");
            prop_assert_eq!(looked(channel), looked(expected));
            prop_assert_eq!(channel.autocorrelation.len(), expected.autocorrelation.len());
            for (found, expected) in channel.autocorrelation.iter().zip(&expected.autocorrelation) {
                prop_assert!(found.0 == expected.0 && alike(found.1, expected.1));
            }
        }
    }
}
