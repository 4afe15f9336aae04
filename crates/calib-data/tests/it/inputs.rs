//! Tests of files, timestamps and types.

use std::{fs, path::Path};

use calib_core::{Seed, Silent};
use calib_data::{DataConfig, DropReason, PreprocessConfig, TimestampUnit, inspect, table::Table};
use polars::prelude::{self as pl, IntoColumn as _, NewChunkedArray as _};

use crate::support::{
    Folder, NAN, assert_refused, load_with, log, optional, profile, refused, seconds,
    train_seconds, train_values,
};

const A: &[f64] = &[1.0, 2.0, 3.0, 4.0];

/// Writes a file with types that tables do not have.
fn write_raw(path: &Path, columns: Vec<pl::Column>) {
    let mut frame = pl::DataFrame::new(columns[0].len(), columns).expect("equal lengths");
    let file = fs::File::create(path).expect("created");
    pl::ParquetWriter::new(file).finish(&mut frame).expect("written");
}

fn channel() -> pl::Column {
    pl::Float64Chunked::from_slice("a".into(), A).into_column()
}

#[test]
fn files_are_ordered_by_time_whatever_their_names() {
    let folder = Folder::of("b/late.parquet", &log(4, &[("a", &[5.0, 6.0])]));
    folder.write("z.parquet", &log(0, &[("a", A)]));
    let dataset = folder.load();
    assert_eq!(train_seconds(&dataset), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(train_values(&dataset, "a"), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let profile = &dataset.profile;
    assert_eq!((profile.files, profile.file_rows, profile.rows), (2, 6, 6));
    assert_eq!(profile.overlapping_files, 0);
    assert_eq!(dataset.period.as_secs(), 1.0);
}

#[test]
fn hive_folders_are_a_filter_and_do_not_mix() {
    let folder = Folder::of("well=W-1/x.parquet", &log(0, &[("a", A)]));
    folder.write("well=W-2/x.parquet", &log(2, &[("a", A)]));
    let mut data = folder.data();
    assert_refused(&data, &["partitions = { well = \"W-1\" }"]);
    data.partitions.insert("well".to_owned(), "W-2".to_owned());
    let dataset = load_with(&data, &PreprocessConfig::default());
    assert_eq!(train_seconds(&dataset), [2.0, 3.0, 4.0, 5.0]);
    let names: Vec<&str> =
        dataset.profile.channels.iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["a"], "keys of folders are no channels");
}

#[test]
fn hive_folders_that_follow_each_other_are_one_log() {
    let folder = Folder::of("month=1/x.parquet", &log(0, &[("a", A)]));
    folder.write("month=2/x.parquet", &log(4, &[("a", A)]));
    assert_eq!(folder.load().train.rows(), 8);
}

#[test]
fn damaged_files_are_named() {
    let folder = Folder::of("a.parquet", &log(0, &[("a", A)]));
    folder.write("b.parquet", &log(4, &[("a", A)]));
    let whole = fs::read(folder.file("b.parquet")).expect("readable");
    for bytes in [&whole[..whole.len() / 2], &b"time,a\n0,1\n"[..], &[]] {
        fs::write(folder.file("b.parquet"), bytes).expect("written");
        assert_refused(&folder.data(), &["b.parquet cannot be read as Parquet"]);
    }
}

#[test]
fn damage_anywhere_is_an_error_or_harmless() {
    let values: Vec<f64> = (0..200_i32).map(f64::from).collect();
    let folder = Folder::of("a.parquet", &log(0, &[("a", &values), ("b", &values)]));
    let whole = fs::read(folder.file("a.parquet")).expect("readable");
    let mut refused = 0;
    for seed in 0..300 {
        let mut rng = Seed::new(seed).rng();
        let mut bytes = whole.clone();
        for _ in 0..=rng.below(4) {
            let position = rng.below(bytes.len());
            bytes[position] = rng.bits() as u8;
        }
        fs::write(folder.file("a.parquet"), bytes).expect("written");
        if let Err(error) = inspect(&folder.data(), &PreprocessConfig::default(), &Silent) {
            refused += 1;
            assert!(error.to_string().len() < 600, "{error}");
        }
    }
    assert!(refused > 100, "{refused}");
}

#[test]
fn a_missing_timestamp_column_is_explained() {
    let table = Table::new().with("TagTime", seconds(0..4)).with("a", A.to_vec());
    let folder = Folder::of("a.parquet", &table);
    let error = refused(&folder.data(), &PreprocessConfig::default()).to_string();
    assert!(
        error.ends_with(
            "has no column \"timestamp\" for the timestamps; set data.timestamp to one of: TagTime (--set data.timestamp=TagTime)"
        ),
        "{error}"
    );
    let data = DataConfig { timestamp: "TagTime".to_owned(), ..folder.data() };
    assert_eq!(load_with(&data, &PreprocessConfig::default()).train.rows(), 4);
    let data = DataConfig {
        timestamp: "a".to_owned(),
        timestamp_unit: Some(TimestampUnit::Seconds),
        ..folder.data()
    };
    let profile = profile(&data);
    assert_eq!(profile.period_secs, 1.0);
}

#[test]
fn a_timestamp_column_of_another_type_is_explained() {
    let flags = Table::new().with("timestamp", vec![true, false]).with("a", vec![1.0, 2.0]);
    let folder = Folder::of("a.parquet", &flags);
    assert_refused(&folder.data(), &["does not hold timestamps: it is of type bool; expected"]);
    let text = Table::new()
        .with("timestamp", vec!["1970-01-01".to_owned(), "noon".to_owned()])
        .with("a", vec![1.0, 2.0]);
    folder.write("a.parquet", &text);
    assert_refused(&folder.data(), &["row 1 is \"noon\"; expected ISO 8601"]);
}

#[test]
fn numbers_that_are_dates_are_not_taken_for_seconds() {
    let folder = Folder::new();
    let dates = [20_240_301_235_958_i64, 20_240_301_235_959, 20_240_302_000_000];
    let format = Some("%Y%m%d%H%M%S".to_owned());
    let as_floats = dates.map(|date| date as f64).to_vec();
    for table in
        [Table::new().with("timestamp", dates.to_vec()), Table::new().with("timestamp", as_floats)]
    {
        folder.write("a.parquet", &table.with("a", vec![1.0, 2.0, 3.0]));
        assert_refused(
            &folder.data(),
            &["20240301235958, look like dates", "data.timestamp_format = \"%Y%m%d%H%M%S\""],
        );
        let data = DataConfig { timestamp_format: format.clone(), ..folder.data() };
        let found = profile(&data);
        assert_eq!((found.period_secs, found.utc), (1.0, false));
        assert_eq!(found.start.as_micros(), 1_709_337_598_000_000);
        let data =
            DataConfig { timestamp_unit: Some(TimestampUnit::Milliseconds), ..folder.data() };
        // Numbers, if the study sets a unit.
        profile(&data);
    }
    // Fractions of a second.
    let fractions = dates.map(|date| date as f64 + 0.5).to_vec();
    let table = Table::new().with("timestamp", fractions).with("a", vec![1.0, 2.0, 3.0]);
    folder.write("a.parquet", &table);
    assert_refused(&folder.data(), &["data.timestamp_format = \"%Y%m%d%H%M%S%.f\""]);
    let fractional = Some("%Y%m%d%H%M%S%.f".to_owned());
    let data = DataConfig { timestamp_format: fractional, ..folder.data() };
    let found = profile(&data);
    assert_eq!(found.start.as_micros(), 1_709_337_598_500_000);
    assert!(!found.utc, "dates that name no zone");
    let data = DataConfig { timestamp_format: format.clone(), ..folder.data() };
    assert_refused(&data, &["20240301235958.5 is not what data.timestamp_format says"]);
    // Numbers since 1970 are not such dates, and a given format must fit.
    let seconds = vec![1_709_272_800_i64, 1_709_272_801, 1_709_272_802];
    let table = Table::new().with("timestamp", seconds).with("a", vec![1.0, 2.0, 3.0]);
    folder.write("a.parquet", &table);
    profile(&folder.data());
    let data = DataConfig { timestamp_format: format, ..folder.data() };
    assert_refused(&data, &["1709272800 is not what data.timestamp_format says"]);
}

/// Returns four seconds from 1970 on, with `factor` units per second.
fn zoned(unit: pl::TimeUnit, factor: i64, zone: Option<&str>) -> pl::Column {
    let values: Vec<i64> = (0..4).map(|second| second * factor).collect();
    let zone =
        zone.map(|zone| pl::TimeZone::opt_try_new(Some(zone)).expect("a zone").expect("a zone"));
    pl::Int64Chunked::from_slice("timestamp".into(), &values)
        .into_datetime(unit, zone)
        .into_column()
}

/// Returns four seconds of 2020.
fn integers(factor: i64) -> pl::Column {
    let values: Vec<i64> = (0..4).map(|second| (1_600_000_000 + second) * factor).collect();
    pl::Int64Chunked::from_slice("timestamp".into(), &values).into_column()
}

#[test]
fn timestamps_of_every_type_name_the_same_instants() {
    let text = [
        "1970-01-01T00:00:00Z",
        "1970-01-01 00:00:01",
        "1970-01-01T01:00:02+01:00",
        "1970-01-01T00:00:03.000",
    ];
    let start = 1.6e9;
    let cases = [
        (zoned(pl::TimeUnit::Milliseconds, 1_000, None), 0.0),
        (zoned(pl::TimeUnit::Microseconds, 1_000_000, None), 0.0),
        (zoned(pl::TimeUnit::Nanoseconds, 1_000_000_000, None), 0.0),
        (zoned(pl::TimeUnit::Microseconds, 1_000_000, Some("UTC")), 0.0),
        (zoned(pl::TimeUnit::Microseconds, 1_000_000, Some("America/Edmonton")), 0.0),
        (integers(1), start),
        (integers(1_000), start),
        (integers(1_000_000), start),
        (integers(1_000_000_000), start),
        (pl::StringChunked::from_slice("timestamp".into(), &text).into_column(), 0.0),
    ];
    for (timestamps, start) in cases {
        let folder = Folder::new();
        let type_name = timestamps.dtype().to_string();
        write_raw(&folder.file("a.parquet"), vec![timestamps, channel()]);
        let expected: Vec<f64> = (0..4).map(|second| start + f64::from(second)).collect();
        assert_eq!(train_seconds(&folder.load()), expected, "{type_name}");
    }
}

#[test]
fn dates_are_midnights() {
    let folder = Folder::new();
    let days = pl::Int32Chunked::from_slice("timestamp".into(), &[0, 1, 2, 3]).into_date();
    write_raw(&folder.file("a.parquet"), vec![days.into_column(), channel()]);
    assert_eq!(folder.load().period.as_secs(), 86_400.0);
}

#[test]
fn rows_without_a_timestamp_are_counted_and_dropped() {
    let mut times: Vec<_> = seconds(0..4).into_iter().map(Some).collect();
    times.insert(2, None);
    let table =
        Table::new().with_optional("timestamp", times).with("a", vec![1.0, 2.0, 99.0, 3.0, 4.0]);
    let folder = Folder::of("a.parquet", &table);
    let dataset = folder.load();
    assert_eq!(dataset.profile.null_timestamps, 1);
    assert_eq!(train_values(&dataset, "a"), A);
}

#[test]
fn a_channel_that_a_file_lacks_is_missing_there() {
    let folder = Folder::of("a.parquet", &log(0, &[("a", A)]));
    folder.write("b.parquet", &log(4, &[("b", A), ("a", A)]));
    let preprocess = PreprocessConfig { max_missing: 0.5, ..PreprocessConfig::default() };
    let dataset = load_with(&folder.data(), &preprocess);
    let b = dataset.profile.channel("b").expect("a channel");
    assert_eq!((b.missing, b.missing_fraction, b.unfilled), (4, 0.5, 4));
    assert_eq!(train_seconds(&dataset), [4.0, 5.0, 6.0, 7.0]);
    assert_eq!(dataset.profile.train.dropped_rows, 4);
}

/// Returns a table of two rows that begin at this second.
fn two_rows(start: i64) -> Table {
    Table::new().with("timestamp", seconds(start..start + 2))
}

#[test]
fn types_may_differ_between_files() {
    let folder = Folder::new();
    let texts = vec!["5.5".to_owned(), " 6e0 ".to_owned()];
    let tables = [
        two_rows(0).with("a", vec![1.0, 2.0]),
        two_rows(2).with("a", vec![3_i64, 4]),
        two_rows(4).with("a", vec![true, false]),
        two_rows(6).with("a", texts),
        two_rows(8).with("a", vec![7.0_f32, 8.0]),
    ];
    for (number, table) in tables.iter().enumerate() {
        folder.write(&format!("{number}.parquet"), table);
    }
    let dataset = folder.load();
    let expected = [1.0, 2.0, 3.0, 4.0, 1.0, 0.0, 5.5, 6.0, 7.0, 8.0];
    assert_eq!(train_values(&dataset, "a"), expected);
    let channel = dataset.profile.channel("a").expect("a channel");
    assert_eq!(channel.type_name, "f64 or i64 or bool or text or f32");
}

#[test]
fn other_number_types_are_read() {
    let folder = Folder::new();
    let times = pl::Int64Chunked::from_slice("timestamp".into(), &[0, 1, 2, 3])
        .into_datetime(pl::TimeUnit::Milliseconds, None);
    let small = pl::Int16Chunked::from_slice("i16".into(), &[-3, 0, 3, 6]);
    let unsigned = pl::UInt8Chunked::from_slice("u8".into(), &[0, 1, 2, 255]);
    let decimal = pl::Int128Chunked::from_slice("decimal".into(), &[150, 250, 350, 450]);
    let category = pl::StringChunked::from_slice("category".into(), &["1.5", "Bad", "2.5", "3.5"]);
    let category = category
        .into_column()
        .cast(&pl::DataType::from_categories(pl::Categories::global()))
        .expect("categories");
    let columns = vec![
        times.into_column(),
        small.into_column(),
        unsigned.into_column(),
        decimal.into_decimal(9, 2).expect("fits").into_column(),
        category,
    ];
    write_raw(&folder.file("a.parquet"), columns);
    let preprocess = PreprocessConfig { max_missing: 0.5, ..PreprocessConfig::default() };
    let dataset = load_with(&folder.data(), &preprocess);
    assert_eq!(train_values(&dataset, "i16"), [-3.0, 0.0, 3.0, 6.0]);
    assert_eq!(train_values(&dataset, "u8"), [0.0, 1.0, 2.0, 255.0]);
    assert_eq!(train_values(&dataset, "decimal"), [1.5, 2.5, 3.5, 4.5]);
    assert_eq!(train_values(&dataset, "category"), [1.5, 1.5, 2.5, 3.5]);
    let words = &dataset.profile.channel("category").expect("a channel").words;
    assert_eq!(words[..], [("Bad".to_owned(), 1)]);
}

#[test]
fn quality_words_are_missing_and_listed() {
    let text = ["1", "Bad", "2", "Scan Timeout", "Bad", "3"].map(str::to_owned);
    let table = Table::new()
        .with("timestamp", seconds(0..6))
        .with("a", text.to_vec())
        .with("b", ["x", "y", "x", "y", "x", "y"].map(str::to_owned).to_vec())
        .with("c", vec![1.0, f64::INFINITY, 2.0, NAN, 4.0, f64::NEG_INFINITY]);
    let folder = Folder::of("a.parquet", &table);
    let profile = inspect(
        &folder.data(),
        &PreprocessConfig { max_missing: 0.5, ..PreprocessConfig::default() },
        &Silent,
    )
    .expect("a log");
    let [a, b, c] = ["a", "b", "c"].map(|name| profile.channel(name).expect("a channel"));
    assert_eq!(a.words, [("Bad".to_owned(), 2), ("Scan Timeout".to_owned(), 1)]);
    assert_eq!((a.missing, a.imputed, a.dropped.is_none()), (3, 3, true));
    assert_eq!(b.dropped, Some(DropReason::Text));
    assert_eq!((c.non_finite, c.missing, c.imputed), (3, 3, 3));
    assert_eq!(c.values.as_ref().map(|values| (values.min, values.max)), Some((1.0, 4.0)));
}

#[test]
fn columns_that_hold_no_numbers_are_dropped() {
    let table = log(0, &[("a", A)]).with("since", seconds(0..4));
    let folder = Folder::of("a.parquet", &table);
    let profile = folder.inspect();
    let reason = profile.channel("since").expect("a channel").dropped.clone();
    let expected = DropReason::WrongType { type_name: "datetime".to_owned() };
    assert_eq!(reason, Some(expected));
}

#[test]
fn empty_files_are_no_rows() {
    let folder = Folder::of("empty.parquet", &log(0, &[("a", &[])]));
    assert_refused(
        &folder.data(),
        &["has no rows: the file has a header and no rows; check data.path"],
    );
    folder.write("full.parquet", &log(0, &[("a", A)]));
    assert_eq!(folder.load().train.rows(), 4);
}

#[test]
fn one_row_needs_a_period() {
    let folder = Folder::of("a.parquet", &log(5, &[("a", &[1.0])]));
    assert_refused(&folder.data(), &["one row at 1970-01-01 00:00:05 does not tell"]);
    let data = DataConfig { period_secs: Some(1.0), ..folder.data() };
    let profile = profile(&data);
    assert_eq!((profile.rows, profile.train.transitions), (1, 0));
    let constant = profile.channel("a").expect("a channel").dropped.clone();
    assert_eq!(constant, Some(DropReason::Constant { value: 1.0, word: None }));
}

#[test]
fn row_groups_do_not_matter() {
    let values: Vec<f64> = (0..1_000_i32).map(|i| f64::from(i % 37)).collect();
    let table = log(0, &[("a", &values)]);
    let folder = Folder::of("a.parquet", &table);
    let whole = folder.load();
    let times: Vec<i64> = (0..1_000).map(|second| second * 1_000_000).collect();
    let columns = vec![
        pl::Int64Chunked::from_slice("timestamp".into(), &times)
            .into_datetime(pl::TimeUnit::Microseconds, None)
            .into_column(),
        pl::Float64Chunked::from_slice_options("a".into(), &optional(&values)).into_column(),
    ];
    let mut frame = pl::DataFrame::new(1_000, columns).expect("equal lengths");
    let file = fs::File::create(folder.file("a.parquet")).expect("created");
    let writer = pl::ParquetWriter::new(file).with_row_group_size(Some(64));
    writer.finish(&mut frame).expect("written");
    assert_eq!(folder.load().fingerprint, whole.fingerprint);
}
