//! Tests of channels that are angles: two channels each, whatever the shape of the log.

use std::{collections::BTreeMap, f64::consts::TAU, fmt::Write as _};

use calib_core::Silent;
use calib_data::{
    AnglePart, Contradictions, DataConfig, PreprocessConfig, Resample, format_time, import, load,
    sketch, survey, table::Table,
};
use calib_files::ExistingFile;

use crate::support::{
    Folder, assert_refused, assert_refused_with, kept, load_with, log, log_at, one_hot, optional,
    profile, refusal, refused, seconds, train_values,
};

const ROWS: u32 = 300;

/// Returns a direction that wanders around the compass, in degrees from 0 to 360.
fn direction(row: u32) -> f64 {
    let at = f64::from(row);
    (300.0 + 9.0 * at + 40.0 * (at / 7.0).sin()).rem_euclid(360.0)
}

fn speed(row: u32) -> f64 {
    6.0 + 3.0 * (f64::from(row) / 11.0).sin()
}

fn of(turns: &[(&str, f64)]) -> BTreeMap<String, f64> {
    turns.iter().map(|(name, turn)| ((*name).to_owned(), *turn)).collect()
}

fn with(folder: &Folder, turns: &[(&str, f64)]) -> DataConfig {
    DataConfig { angles: of(turns), ..folder.data() }
}

/// Rounds physical values of the training range to four decimals.
fn rounded(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    values.into_iter().map(|value| (value * 1e4).round() / 1e4).collect()
}

/// Returns the log of a weather station: degrees with a decimal comma, units below the header, -999 for a missing
/// value, and a word now and then.
fn station() -> String {
    let mut text = String::from("Zeit;Windrichtung;Windgeschwindigkeit\r\n;°;m/s\r\n");
    for row in 0..ROWS {
        let day = 13 + row / 24;
        let hour = row % 24;
        let wind = match row {
            10 => "-999".to_owned(),
            20 => "still".to_owned(),
            row if row % 60 == 30 => "-999".to_owned(),
            row => format!("{:.1}", direction(row)).replace('.', ","),
        };
        let speed = format!("{:.2}", speed(row)).replace('.', ",");
        write!(text, "{day:02}.03.2024 {hour:02}:00;{wind};{speed}\r\n").expect("memory");
    }
    text
}

#[test]
fn a_station_has_the_sine_and_the_cosine_of_its_wind() {
    let folder = Folder::of_text("station.csv", &station());
    let data =
        DataConfig { missing_values: vec![-999.0], ..with(&folder, &[("Windrichtung", 360.0)]) };
    let found = profile(&data);
    assert_eq!(kept(&found), ["Windrichtung_sin", "Windrichtung_cos", "Windgeschwindigkeit"]);
    for name in ["Windrichtung_sin", "Windrichtung_cos"] {
        let channel = found.channel(name).expect("there");
        assert_eq!((channel.stood_for_missing, channel.missing), (6, 7), "of the raw value");
        assert_eq!(channel.words, [("still".to_owned(), 1)]);
        assert_eq!(channel.description.unit, None, "a sine has no unit");
        let values = channel.values.as_ref().expect("values");
        assert!(values.min >= -1.0 && values.max <= 1.0 && values.max - values.min > 1.9);
        let angle = channel.angle.as_ref().expect("of an angle");
        assert_eq!((angle.channel.as_str(), angle.turn), ("Windrichtung", 360.0));
        let [low, high] = angle.recorded.expect("was recorded");
        assert!((0.0..10.0).contains(&low) && (350.0..360.0).contains(&high));
    }
    let angle = found.channel("Windrichtung_cos").expect("there").angle.clone().expect("one");
    assert_eq!(angle.part, AnglePart::Cosine);
    assert!(angle.told().starts_with("cosine of Windrichtung (recorded from "), "{}", angle.told());
    let written = toml::Table::try_from(&found).expect("TOML");
    assert_eq!(written["channels"][0]["angle"]["part"].as_str(), Some("sine"));
    assert!(written["channels"][2].get("angle").is_none(), "nothing is new of other channels");
    // Undeclared sentinels are searched among the angles, once.
    let undeclared = profile(&with(&folder, &[("Windrichtung", 360.0)]));
    let [sentinel] = &undeclared.sentinels[..] else { panic!("one: {:?}", undeclared.sentinels) };
    assert_eq!((sentinel.value, sentinel.count), (-999.0, 6));
    assert_eq!(sentinel.channels, ["Windrichtung"]);
    assert_eq!(undeclared.recorded_name("Windrichtung_sin"), "Windrichtung");
    let looked = sketch(&with(&folder, &[("Windrichtung", 360.0)]), &Silent).expect("a log");
    assert_eq!(looked.sentinels, undeclared.sentinels);
}

#[test]
fn a_log_without_angles_is_as_it_was() {
    let folder = Folder::of_text("station.csv", &station());
    let without = load_with(&folder.data(), &PreprocessConfig::default());
    let study = toml::Table::try_from(folder.data()).expect("TOML");
    assert!(study.get("angles").is_none(), "no new key in what results follow from");
    let excluded = DataConfig {
        exclude: vec!["Windrichtung".to_owned()],
        ..with(&folder, &[("Wind*richtung", 360.0)])
    };
    let only = DataConfig { include: vec!["Windg*".to_owned()], ..folder.data() };
    let [excluded, only] =
        [excluded, only].map(|data| load_with(&data, &PreprocessConfig::default()));
    assert_eq!(excluded.fingerprint, only.fingerprint, "other channels are the same");
    assert_ne!(without.fingerprint, only.fingerprint);
}

fn owned(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

#[test]
fn entries_of_include_and_exclude_may_name_the_angle_or_one_of_its_two() {
    let folder = Folder::of_text("station.csv", &station());
    let cases: [(&[&str], &[&str], &str); 4] = [
        (&["Windrichtung"], &[], "Windrichtung_sin Windrichtung_cos"),
        (&["*_cos", "Windg*"], &[], "Windrichtung_cos Windgeschwindigkeit"),
        (&[], &["Windrichtung"], "Windgeschwindigkeit"),
        (&[], &["*_sin"], "Windrichtung_cos Windgeschwindigkeit"),
    ];
    for (include, exclude, expected) in cases {
        let data = DataConfig {
            include: owned(include),
            exclude: owned(exclude),
            ..with(&folder, &[("Windrichtung", 360.0)])
        };
        let found = profile(&data);
        assert!(found.unused_excludes.is_empty(), "{:?}", found.unused_excludes);
        assert_eq!(kept(&found).join(" "), expected, "{include:?} without {exclude:?}");
    }
}

#[test]
fn all_shapes_give_the_same_states() {
    let mut wide = String::from("time,speed,wind\n");
    let mut long = String::from("time,tag,value\n");
    let mut files = [String::from("time,value\n"), String::from("time,value\n")];
    let mut table = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..ROWS {
        let time = format!("2024-03-{:02} {:02}:00:00", 13 + row / 24, row % 24);
        let speed = speed(row);
        let wind = direction(row);
        writeln!(wide, "{time},{speed},{wind}").expect("memory");
        writeln!(long, "{time},speed,{speed}\n{time},wind,{wind}").expect("memory");
        writeln!(files[0], "{time},{speed}").expect("memory");
        writeln!(files[1], "{time},{wind}").expect("memory");
        table.0.push(1_710_288_000 + 3_600 * i64::from(row));
        table.1.push(speed);
        table.2.push(wind);
    }
    let folders = [(); 4].map(|()| Folder::new());
    let angles = [("wind", 360.0)];
    folders[0].write_file("log.csv", &wide);
    folders[1].write_file("log.csv", &long);
    folders[2].write_file("speed.csv", &files[0]);
    folders[2].write_file("wind.csv", &files[1]);
    let parquet = log_at(table.0, &[("speed", &table.1), ("wind", &table.2)]);
    folders[3].write("log.parquet", &parquet);
    let datasets = folders
        .each_ref()
        .map(|folder| load_with(&with(folder, &angles), &PreprocessConfig::default()));
    let names: Vec<&str> =
        datasets[0].normaliser.columns().iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["speed", "wind_sin", "wind_cos"]);
    for dataset in &datasets {
        assert_eq!(dataset.fingerprint, datasets[0].fingerprint);
    }
    let sines = rounded((0..ROWS).map(|row| (direction(row) / 360.0 * TAU).sin()));
    assert_eq!(train_values(&datasets[0], "wind_sin"), sines);
    // A file of the result has the two as ordinary channels.
    let imported = folders[3].file("imported.parquet");
    let data = with(&folders[1], &angles);
    let written = import(&data, &imported, ExistingFile::Kept, &Silent).expect("written");
    assert_eq!((written.channels, written.dropped.repeated), (3, 0));
    let again = DataConfig { train_fraction: 1.0, ..DataConfig::at(imported.as_path()) };
    let again = load_with(&again, &PreprocessConfig::default());
    assert_eq!(again.fingerprint, datasets[0].fingerprint);
}

/// Returns the sines and the cosines of the channel `wind` on another clock.
fn resampled(folder: &Folder, resample: Resample, period: f64) -> [Vec<f64>; 2] {
    let data = DataConfig {
        resample: Some(resample),
        period_secs: Some(period),
        ..with(folder, &[("wind", 360.0)])
    };
    let dataset = load_with(&data, &PreprocessConfig::default());
    ["wind_sin", "wind_cos"].map(|column| train_values(&dataset, column))
}

/// The mean of 359° and 1° is 0°, and so is the point halfway between them.
#[test]
fn angles_are_resampled_as_directions() {
    let wind = [359.0, 1.0, 359.0, 1.0, 170.0, 190.0, 350.0, 10.0, 90.0];
    let folder = Folder::of("log.parquet", &log_at((0..9).map(|row| 30 * row), &[("wind", &wind)]));
    let degree = 1.0 / 360.0 * TAU;
    let [sines, cosines] = resampled(&folder, Resample::Mean, 60.0);
    // A mean covers the minute before; at 0 there is only the first value.
    assert_eq!(sines, rounded([-degree.sin(), 0.0, 0.0, 0.0, 0.0]));
    let expected = [degree, degree, degree, std::f64::consts::PI - 10.0 * degree, 10.0 * degree];
    assert_eq!(cosines, rounded(expected.map(f64::cos)));
    let [sines, cosines] = resampled(&folder, Resample::Linear, 45.0);
    let halfway = [0.5 * (-degree.sin() + degree.sin()), degree.cos()];
    assert_eq!([sines[1], cosines[1]], rounded(halfway)[..]);
}

#[test]
fn means_over_states_and_filled_values_are_of_directions() {
    let mut wind = [359.0, 1.0, 180.0, 180.0, 90.0, 90.0, 0.0, 0.0, 300.0, 240.0];
    wind[5] = f64::NAN;
    let folder = Folder::of("log.parquet", &log(0, &[("wind", &wind)]));
    let preprocess = PreprocessConfig {
        subsample: 2,
        reduce: calib_data::Reduce::Mean,
        ..PreprocessConfig::default()
    };
    let dataset = load_with(&with(&folder, &[("wind", 360.0)]), &preprocess);
    let cosines = train_values(&dataset, "wind_cos");
    assert_eq!(cosines.len(), 5);
    assert!((cosines[0] - 0.9998).abs() < 2e-4, "{cosines:?}: north, and not south");
    assert!((cosines[1] + 1.0).abs() < 1e-4, "{cosines:?}");
}

/// Converts degrees to a unit with `turn` to a full turn, and adds `by`.
fn turned(degrees: &[f64], turn: f64, by: f64) -> Vec<f64> {
    degrees.iter().map(|angle| angle.rem_euclid(360.0) / 360.0 * turn + by).collect()
}

#[test]
fn values_outside_of_a_turn_and_other_turns_are_fine() {
    let around: Vec<f64> = (0..40).map(|row| f64::from(row) * 31.0).collect();
    let columns = [
        ("wide", turned(&around, 360.0, 720.0)),
        ("around", around.clone()),
        ("signed", around.iter().map(|angle| (angle + 180.0).rem_euclid(360.0) - 180.0).collect()),
        ("radians", turned(&around, TAU, 0.0)),
        ("hours", turned(&around, 24.0, 0.0)),
    ];
    let columns: Vec<(&str, &[f64])> =
        columns.iter().map(|(name, values)| (*name, values.as_slice())).collect();
    let folder = Folder::of("log.parquet", &log(0, &columns));
    let turns = [("*d*", 360.0), ("radians", TAU), ("hours", 24.0)];
    // A pattern with another turn matches `radians`, but it has its own entry.
    let dataset = load_with(&with(&folder, &turns), &PreprocessConfig::default());
    for part in ["sin", "cos"] {
        let expected = train_values(&dataset, &format!("around_{part}"));
        for name in ["wide", "signed", "radians", "hours"] {
            assert_eq!(train_values(&dataset, &format!("{name}_{part}")), expected, "{name}");
        }
    }
}

/// Returns a log, of samples or wide, of five directions and then of repeated times.
fn samples(again: &[(i64, f64)], is_long: bool) -> Folder {
    let folder = Folder::new();
    let first = [(0, 0.0), (1, -90.0), (2, 10.0), (3, 100.0), (4, 200.0)];
    let all: Vec<(i64, f64)> = first.iter().chain(again).copied().collect();
    if is_long {
        let mut text = String::from("time,tag,value\n");
        for (second, wind) in all {
            let time = format_time(calib_core::Timestamp::from_micros(1_000_000 * second));
            writeln!(text, "{time},wind,{wind}\n{time},x,{second}").expect("memory");
        }
        folder.write_file("log.csv", &text);
    } else {
        let times = all.iter().map(|sample| sample.0);
        let wind: Vec<f64> = all.iter().map(|sample| sample.1).collect();
        let x: Vec<f64> = all.iter().map(|sample| sample.0 as f64).collect();
        folder.write("log.parquet", &log_at(times, &[("wind", &wind), ("x", &x)]));
    }
    folder
}

#[test]
fn the_same_direction_is_no_contradiction_and_another_is_told_once() {
    for is_long in [false, true] {
        let same = samples(&[(0, 360.0), (1, 270.0), (2, 370.0)], is_long);
        let found = profile(&with(&same, &[("wind", 360.0)]));
        assert_eq!((found.contradictions.count, found.duplicates.conflicting), (0, 0), "{is_long}");
        assert_eq!(profile(&same.data()).contradictions.count, 3, "as numbers they differ");
        let other = samples(&[(0, 360.0), (2, 190.0)], is_long);
        let mut data = with(&other, &[("wind", 360.0)]);
        let error = refusal(&data);
        assert!(
            error.contains("in 1 values: at 1970-01-01 00:00:02 wind is 10 and 190."),
            "{error}"
        );
        let looked = sketch(&data, &Silent).expect_err("one of five rows").to_string();
        assert_eq!(looked, error);
        let file = other.file("imported.parquet");
        let refused = import(&data, &file, ExistingFile::Kept, &Silent).expect_err("refused");
        assert_eq!(refused.to_string(), error);
        data.contradictions = Contradictions::Last;
        let last = load_with(&data, &PreprocessConfig::default());
        assert_eq!(train_values(&last, "wind_cos")[2], rounded([-10.0_f64.to_radians().cos()])[0]);
    }
}

#[test]
fn entries_that_make_no_two_channels_are_refused() {
    let values: Vec<f64> = (0..20).map(f64::from).collect();
    let words: Vec<String> = (0..20).map(|row| ["N", "NNE", "N"][row % 3].to_owned()).collect();
    let table = log(0, &[("wind", &values), ("yaw", &values), ("yaw_cos", &values)])
        .with("compass", words)
        .with("seen", seconds(0..20));
    let folder = Folder::of("log.parquet", &table);
    for (turns, expected) in [
        (&[("wnid", 360.0)][..], "data.angles, \"wnid\": it names no channel; did you mean wind?"),
        (&[("w*", 0.0)], "data.angles.w* = 0: expected a positive number: a full turn"),
        (&[("wind", f64::NAN)], "data.angles.wind = NaN: expected a positive number"),
        (
            &[("wi*", 360.0), ("*nd", TAU)],
            "data.angles, \"*nd\": wind has a turn of 6.283185307179586 by this entry and of 360 by \"wi*\"; give wind an entry",
        ),
        (
            &[("yaw", 360.0)],
            "data.angles, \"yaw\": its columns are called yaw_sin and yaw_cos, and the log has a channel yaw_cos already; leave",
        ),
        (
            &[("compass", 360.0)],
            "data.angles, \"compass\": it holds text, such as \"N\", and no numbers; write its angles as numbers",
        ),
        (&[("seen", 360.0)], "data.angles, \"seen\": it is of type datetime, expected numbers"),
    ] {
        assert_refused(&with(&folder, turns), &[expected]);
    }
    // Excluded channels need not be numbers.
    let left_out = DataConfig {
        exclude: vec!["compass".to_owned(), "seen".to_owned()],
        ..with(&folder, &[("compass", 360.0), ("see?", 360.0), ("wind", 360.0)])
    };
    assert_eq!(kept(&profile(&left_out)), ["wind_sin", "wind_cos", "yaw", "yaw_cos"]);
}

#[test]
fn whoever_names_the_angle_is_told_of_the_two() {
    let wind: Vec<f64> = (0..40).map(direction).collect();
    let folder = Folder::of("log.parquet", &log(0, &[("wind", &wind)]));
    let data = with(&folder, &[("wind", 360.0)]);
    let hint = "data.angles makes wind_sin and wind_cos of it: name one of these";
    let error = profile(&data).require_sensor("wind").expect_err("no channel").to_string();
    assert_eq!(error, format!("sensor \"wind\" is not a channel of the log; {hint}"));
    let error = refused(&data, &one_hot("wind")).to_string();
    assert!(error.ends_with(hint), "{error}");
    assert_refused_with(&data, &one_hot("wind_sin"), &["of the angle wind, which has no modes"]);
    let surveyed = survey(&data, &PreprocessConfig::default(), &Silent).expect("a log");
    let error =
        surveyed.recorded(&["wind".to_owned()], &Silent).expect_err("no column").to_string();
    assert!(error.ends_with(hint), "{error}");
    let both = ["wind_cos".to_owned(), "wind_sin".to_owned()];
    let recorded = surveyed.recorded(&both, &Silent).expect("two channels").values;
    for (cosine, sine) in recorded[0].iter().zip(&recorded[1]) {
        assert!((cosine.hypot(*sine) - 1.0).abs() < 1e-12);
    }
}

/// Returns forty directions from row `first` on.
fn directions(first: u32) -> Vec<f64> {
    (0..40).map(|row| direction(row + first)).collect()
}

#[test]
fn angles_of_several_files_are_called_after_both() {
    let folder = Folder::of("north.parquet", &log(0, &[("wind", &directions(0))]));
    folder.write("south.parquet", &log(0, &[("wind", &directions(9))]));
    let data = DataConfig { file_as_prefix: true, ..with(&folder, &[("* wind", 360.0)]) };
    let expected = ["north wind_sin", "north wind_cos", "south wind_sin", "south wind_cos"];
    assert_eq!(kept(&profile(&data)), expected);
}

#[test]
fn a_row_is_chosen_by_what_was_recorded() {
    let wind: Vec<f64> = (0..40).map(|row| 45.0 * f64::from(row % 8)).collect();
    let units: Vec<String> = (0..40).map(|row| ["A", "B"][row / 20].to_owned()).collect();
    let table = Table::new()
        .with("timestamp", seconds((0..20).chain(0..20)))
        .with("unit", units)
        .with_optional("wind", optional(&wind));
    let folder = Folder::of("log.parquet", &table);
    let mut data = with(&folder, &[("wind", 360.0)]);
    data.only = BTreeMap::from([("unit".to_owned(), "B".to_owned())]);
    let dataset = load(&data, &PreprocessConfig::default(), &Silent).expect("a log");
    let expected = rounded(wind[20..].iter().map(|angle| angle.to_radians().sin()));
    assert_eq!(train_values(&dataset, "wind_sin"), expected);
    data.only = BTreeMap::from([("wind".to_owned(), "45".to_owned())]);
    assert_eq!(profile(&data).rows, 5, "by the angle itself");
}
