//! Tests of logs in the formats of programs and historians (`scripts/golden/log_formats.py`).

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use calib_core::Silent;
use calib_data::{
    Contradictions, DataConfig, Dataset, MaxAge, PreprocessConfig, Resample, Shape, ShownClock,
    load,
};

use crate::support::{
    Folder, NAN, assert_refused, assert_refused_with, load_with, log_at, names, one_hot, profile,
    train_seconds, train_values, values_of_contradicting,
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

fn column_names(dataset: &Dataset) -> Vec<String> {
    dataset.normaliser.columns().iter().map(|column| column.name.clone()).collect()
}

fn same_as_reference(name: &str, shape: Shape, change: impl FnOnce(&mut DataConfig)) {
    let reference = read("pyarrow.parquet", |_| {});
    let got = read(name, change);
    assert_eq!(column_names(&got), column_names(&reference), "{name}");
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
        data.time_zone = Some("Europe/Paris".to_owned());
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
        "ignition-table.csv",
        "ignition-table.parquet",
        "ignition-no-dates.csv",
        "ignition-no-dates.parquet",
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
    let missing =
        ["PIT300", "TIT101"].map(|name| profile.channel(name).expect("a channel").missing);
    assert_eq!((profile.bad_quality, missing), (7, [4, 3]));
    let words = &profile.channel("PIT300").expect("a channel").values;
    assert!(words.as_ref().is_some_and(|values| values.min > 0.0), "-9999 was bad");
}

/// Returns the configuration for rows every millisecond.
fn fine(folder: &Folder, max_age_secs: Option<f64>, memory: u64) -> DataConfig {
    DataConfig {
        resample: Some(Resample::Last),
        period_secs: Some(0.001),
        max_age_secs: max_age_secs.map(MaxAge::All),
        memory: Some(memory),
        ..folder.data()
    }
}

#[test]
fn a_clock_of_more_rows_than_memory_holds_is_refused() {
    let folder = Folder::of_text(
        "a.csv",
        "time,a\n2024-01-01 00:00:00,1\n2024-01-20 00:00:00,2\n2024-02-18 00:00:00,3\n",
    );
    let profile = profile(&fine(&folder, None, 1 << 30));
    assert_eq!(profile.rows, 23, "values stand for ten periods");
    let all = Some(60.0 * 86_400.0);
    assert_refused(&fine(&folder, all, 4 << 30), &["data.period_secs", "4.0 GiB are available"]);
    let mut long = String::from("time,tag,value\n");
    for tag in 0..500 {
        writeln!(long, "2024-01-01 00:00:00,t{tag},1\n2024-01-01 02:00:00,t{tag},2")
            .expect("memory");
    }
    let long = Folder::of_text("a.csv", &long);
    let many = DataConfig { path: long.data().path, ..fine(&folder, all, 1 << 40) };
    assert_refused(&many, &["3600000500 values of 1000 that were recorded"]);
    let few = DataConfig {
        include: vec!["t1".to_owned(), "t2".to_owned()],
        period_secs: Some(0.1),
        ..many
    };
    assert_eq!(load_with(&few, &PreprocessConfig::default()).train.rows(), 72_001);
    let finer = DataConfig { period_secs: Some(0.0001), memory: None, ..fine(&folder, all, 0) };
    assert_refused(&finer, &["data.period_secs", "calib can index"]);
}

#[test]
fn words_take_no_more_memory_than_is_kept_of_them() {
    let mut rows = String::from("time,a,b,c\n");
    for row in 0..9_000 {
        writeln!(rows, "{},{row:08000}x,{},{row}", 1_704_067_200 + row, row % 7).expect("memory");
    }
    let folder = Folder::of_text("a.csv", &rows);
    let profile = folder.inspect();
    let words = &profile.channel("a").expect("a channel").words;
    assert!(words.iter().all(|(word, _)| word.chars().count() <= 100), "{words:?}");
    assert_refused_with(&folder.data(), &one_hot("a"), &["different words"]);
}

#[test]
fn stops_that_the_last_value_bridges_are_told() {
    let mut rows = String::from("time,tag,value\n");
    for second in (0..600).chain(1_800..2_400) {
        writeln!(rows, "{},fast,{}", 1_704_067_200 + second, second % 7).expect("memory");
    }
    for minute in (0..40).step_by(10) {
        writeln!(rows, "{},slow,{minute}", 1_704_067_200 + minute * 60).expect("memory");
    }
    let folder = Folder::of_text("a.csv", &rows);
    let [profile, short] = [1_800.0, 60.0].map(|max_age_secs| {
        let data = DataConfig {
            resample: Some(Resample::Last),
            period_secs: Some(10.0),
            max_age_secs: Some(MaxAge::All(max_age_secs)),
            ..folder.data()
        };
        profile(&data)
    });
    let bridged = &profile.channel("fast").expect("a channel").bridged;
    assert_eq!((bridged.count, bridged.longest_secs, bridged.usual_secs), (1, 1_201.0, 1.0));
    assert!(profile.channel("slow").expect("a channel").bridged.is_none());
    let [(name, doubt)] = &profile.value_doubts(&ShownClock::default())[..] else {
        panic!("one doubt")
    };
    assert!(
        *name == "fast"
            && doubt.contains("1201 s")
            && doubt.contains("data.max_age_secs = { default = …, \"fast\" = … }"),
        "{doubt}"
    );
    assert!(short.value_doubts(&ShownClock::default()).is_empty(), "missing is not bridged");
}

fn twenty(factor: f64) -> Vec<f64> {
    (0..20_i64).map(|row| factor * (row % 7) as f64).collect()
}

#[test]
fn one_file_per_tag_never_loses_tags() {
    let folder = Folder::new();
    for (name, factor) in [("a", 1.0), ("b", 2.0), ("c", 3.0)] {
        folder.write(&format!("{name}.parquet"), &log_at(0..20, &[("value", &twenty(factor))]));
    }
    let dataset = folder.load();
    let names: Vec<&str> =
        dataset.profile.channels.iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["a", "b", "c"]);
    assert_eq!(train_values(&dataset, "c"), twenty(3.0));
    // The same as one column per file, on different clocks.
    let folder = Folder::of("x.parquet", &log_at(0..10, &[("a", &twenty(1.0)[..10])]));
    folder.write("y.parquet", &log_at(5..15, &[("b", &twenty(2.0)[..10])]));
    let profile = folder.inspect();
    assert_eq!((profile.shape, profile.rows), (Shape::FilePerTag, 15));
    assert_eq!(profile.channel("b").expect("a channel").missing, 5);
}

#[test]
fn wide_files_of_different_channels_are_merged_by_column() {
    let values: Vec<f64> = (0..20_u8).map(f64::from).collect();
    let more: Vec<f64> = values.iter().map(|value| value * 2.0).collect();
    let folder = Folder::of("x.parquet", &log_at(0..20, &[("a", &values), ("b", &more)]));
    folder.write("y.parquet", &log_at(0..20, &[("c", &more), ("d", &values)]));
    let dataset = folder.load();
    assert_eq!(train_values(&dataset, "c"), more);
    assert_eq!((dataset.profile.rows, dataset.profile.contradictions.count), (20, 0));
    let missing: u64 = dataset.profile.channels.iter().map(|channel| channel.missing).sum();
    assert_eq!(missing, 0);
}

#[test]
fn rows_that_contradict_each_other_are_refused_with_three_of_them() {
    let folder = Folder::of(
        "a.parquet",
        &log_at(
            [0, 1, 1, 2, 2, 3, 3, 4, 4],
            &[("a", &[0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5])],
        ),
    );
    assert_refused(
        &folder.data(),
        &[
            "contradict each other in 4 values",
            "at 1970-01-01 00:00:01 a is 1 and 1.5; at 1970-01-01 00:00:02 a is 2 and 2.5; at 1970-01-01 00:00:03 a is 3 and 3.5.",
        ],
    );
    assert_eq!(folder.inspect().contradictions.count, 4, "to be looked at");
    let [first, last] = [Contradictions::First, Contradictions::Last].map(|contradictions| {
        values_of_contradicting(&folder, contradictions, &PreprocessConfig::default(), "a")
    });
    assert_eq!(first, [0.0, 1.0, 2.0, 3.0, 4.0]);
    assert_eq!(last, [0.0, 1.5, 2.5, 3.5, 4.5]);
    // The same for samples.
    let long = Folder::of_text(
        "a.csv",
        "time,tag,value\n2024-01-01,a,1\n2024-01-01,a,2\n2024-01-02,a,3\n",
    );
    assert_refused(&long.data(), &["a is 1 and 2"]);
}

/// Returns one value per second up to a minute.
fn rising(from: i64, value: i64) -> Vec<f64> {
    (from..60).map(|second| (value + second) as f64).collect()
}

#[test]
fn of_several_files_the_one_that_starts_last_comes_last() {
    // The order of their names is not the order of their first times.
    let a = rising(5, 10);
    let b = rising(3, 20);
    let c = rising(1, 30);
    let folder = Folder::of("a.parquet", &log_at(5..60, &[("a", &a), ("b", &a)]));
    folder.write("b.parquet", &log_at(3..60, &[("a", &b), ("b", &b)]));
    folder.write("c.parquet", &log_at(1..60, &[("a", &c), ("c", &c)]));
    // The last row has the value of the first or the last of the files that have one.
    for (contradictions, channel, expected) in [
        (Contradictions::First, "a", 89.0),
        (Contradictions::First, "b", 79.0),
        (Contradictions::Last, "a", 69.0),
        (Contradictions::Last, "b", 69.0),
    ] {
        let preprocess = PreprocessConfig::default();
        let values = values_of_contradicting(&folder, contradictions, &preprocess, channel);
        assert_eq!(values.last(), Some(&expected), "{contradictions:?} of {channel}");
    }
}

#[test]
fn a_channel_may_be_called_as_qualities_are() {
    let wide = "time,flow,level,status\n2024-01-01,1,2,0\n2024-01-02,2,3,1\n2024-01-03,4,4,2\n";
    let profile = Folder::of_text("a.csv", wide).inspect();
    assert_eq!((profile.shape, profile.channels.len()), (Shape::Wide, 3));
    let two = "time,flow,status\n2024-01-01,1,0\n2024-01-02,2,1\n2024-01-03,4,2\n";
    let profile = Folder::of_text("a.csv", two).inspect();
    assert_eq!((profile.shape, profile.channels.len()), (Shape::Wide, 2));
    // A file of one tag still needs its codes to be known.
    let one = "time,value,status\n2024-01-01,1,0\n2024-01-02,2,1\n";
    let folder = Folder::of_text("a.csv", one);
    let data = DataConfig { shape: Some(Shape::FilePerTag), ..folder.data() };
    assert_refused(&data, &["data.good_quality"]);
}

#[test]
fn the_newest_rows_may_come_first() {
    // 2024-10-27: clocks in Paris go from 3:00 back to 2:00.
    let shown = ["04:00", "03:30", "03:00", "02:30", "02:00", "02:30", "02:00", "01:30"];
    let rows: Vec<String> =
        shown.iter().enumerate().map(|(at, time)| format!("2024-10-27 {time},{at}\n")).collect();
    let folder = Folder::of_text("a.csv", &format!("time,a\n{}", rows.concat()));
    let data = DataConfig { time_zone: Some("Europe/Paris".to_owned()), ..folder.data() };
    let dataset = load_with(&data, &PreprocessConfig::default());
    assert_eq!(train_values(&dataset, "a"), [7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0]);
    assert_eq!(dataset.profile.gaps.count, 0);
}

#[test]
fn a_long_table_is_never_one_channel() {
    // The names decide, whatever the clocks are.
    let named = Folder::of_text(
        "a.csv",
        "time;Tag Name;Value\n2024-01-01 00:00:00;b;1,5\n2024-01-01 00:00:30;a;2\n2024-01-01 00:01:00;b;3\n2024-01-01 00:01:30;a;4\n",
    );
    let names: Vec<String> =
        named.inspect().channels.into_iter().map(|channel| channel.name).collect();
    assert_eq!(names, ["a", "b"]);
    // The names do not decide, but the words alternate, as tags do.
    let mut rows = String::new();
    for row in 0..40 {
        let (word, value) = (["x", "y", "z"][row % 3], 100 * (row % 3) + row);
        writeln!(rows, "2024-01-01 00:00:{row:02},{word},{value}").expect("memory");
    }
    let unnamed = Folder::of_text("a.csv", &format!("when,what,how much\n{rows}"));
    let data = DataConfig { timestamp: "when".to_owned(), ..unnamed.data() };
    assert_eq!(profile(&data).shape, Shape::Long);
    let wide = "when,flow,level\n2024-01-02 00:00:00,1,2\n2024-01-02 00:00:01,2,3\n";
    unnamed.write_file("b.csv", wide);
    assert_refused(&data, &["a.csv is a long table", "data.shape = \"wide\" or \"long\""]);
    // Words that seldom change are modes, or a tag that speaks seldom: that must be said.
    let mut rows = String::new();
    for row in 0..40 {
        writeln!(rows, "2024-01-01 00:00:{row:02},{},{row}", ["x", "y"][row / 20]).expect("memory");
    }
    let unclear = Folder::of_text("a.csv", &format!("when,what,how much\n{rows}"));
    let data = DataConfig { timestamp: "when".to_owned(), ..unclear.data() };
    assert_refused(&data, &["data.tag = \"what\"", "data.shape = \"wide\""]);
    // A wide table with numbers beside what looks like a sample.
    let both = Folder::of_text(
        "a.csv",
        "time,sensor,value,pressure\n2024-01-01,x,1,2\n2024-01-02,x,1,3\n",
    );
    assert_refused(&both.data(), &["data.shape = \"long\" or \"wide\""]);
}

/// Returns a long table of three tags whose column of values has this name.
fn german_table(value: &str) -> String {
    let mut text = format!("Tag;Zeitstempel;{value};Status\n");
    for minute in 0..30 {
        for (tag, level) in [("FIT100", 120), ("PIT300", 434), ("TIT101", 20)] {
            let value = level + minute % 7;
            writeln!(text, "{tag};2024-03-11 00:{minute:02}:00;{value},5;Good").expect("memory");
        }
    }
    text
}

#[test]
fn long_tables_with_headers_of_other_languages_are_read_or_asked_about() {
    let german = Folder::of_text("a.csv", &german_table("Wert"));
    assert_eq!(names(&german.inspect()), ["FIT100", "PIT300", "TIT101"]);
    // The only column of numbers has the values, whatever its name. Of several one is asked for.
    let folder = Folder::of_text("a.csv", &german_table("Ablesung"));
    assert_eq!(names(&folder.inspect()), ["FIT100", "PIT300", "TIT101"]);
    let several =
        german_table("Ablesung").replace(";Status", ";Grenze;Status").replace(";Good", ";7;Good");
    let folder = Folder::of_text("a.csv", &several);
    assert_refused(
        &folder.data(),
        &["They are of 3 different \"Tag\"", "data.tag = \"Tag\", data.value to", "data.quality"],
    );
    let data = DataConfig {
        tag: Some("Tag".to_owned()),
        value: Some("Ablesung".to_owned()),
        ..folder.data()
    };
    assert_eq!(names(&profile(&data)), ["FIT100", "PIT300", "TIT101"]);
}

#[test]
fn tags_may_be_numbers() {
    let folder = Folder::of_text(
        "sqlt_data_1_2024_03.csv",
        "tagid,intvalue,floatvalue,stringvalue,datevalue,dataintegrity,t_stamp\n\
         17,,1.5,,,192,1710286200000\n18,3,,,,192,1710286200000\n\
         17,,2.5,,,192,1710286260000\n19,,,,2024-03-13 00:00:00,192,1710286260000\n",
    );
    let profile = folder.inspect();
    assert_eq!((profile.shape, profile.rows), (Shape::Long, 2));
    let missing: Vec<(&str, u64)> =
        profile.channels.iter().map(|channel| (channel.name.as_str(), channel.missing)).collect();
    assert_eq!(missing, [("17", 0), ("18", 1), ("19", 2)]);
}

/// Returns a long table of the values that are not NaN.
fn samples_of(times: [i64; 7], tags: [(&str, [f64; 7]); 2]) -> Folder {
    let samples = tags.iter().flat_map(|(tag, values)| {
        let there = times.iter().zip(values).filter(|(_, value)| !value.is_nan());
        there.map(move |(time, value)| format!("{time},{tag},{value}\n"))
    });
    let text = format!("time,tag,value\n{}", samples.collect::<String>());
    Folder::of_text("a.csv", &text)
}

#[test]
fn tags_with_times_of_their_own_are_told_how_to_share_a_clock() {
    let mut rows = String::from("tag,time,value\n");
    for row in 0..200_i64 {
        // FIT1 is recorded three times as often, at uneven times.
        let (tag, second) =
            if row % 4 == 3 { ("AIT2", 60 * row + 17) } else { ("FIT1", 60 * row + 7 * (row % 5)) };
        writeln!(rows, "{tag},{},{}", 1_704_067_200 + second, row % 9).expect("memory");
    }
    let folder = Folder::of_text("a.csv", &rows);
    for period_secs in [None, Some(60.0)] {
        let data = DataConfig { period_secs, ..folder.data() };
        let [told] = &profile(&data).clock_doubts()[..] else { panic!("one doubt") };
        let expected = "only one of 2 tags: if each has times of its own, put them on one clock with data.resample, data.period_secs and data.max_age_secs";
        assert!(told.contains(expected), "{told}");
    }
    let data = DataConfig {
        resample: Some(Resample::Last),
        period_secs: Some(60.0),
        max_age_secs: Some(MaxAge::All(600.0)),
        ..folder.data()
    };
    let found = profile(&data);
    assert_eq!((found.clock_doubts(), found.kept().count()), (Vec::new(), 2));
    // The tags are on one clock, and most values are too old for its rows.
    let short = DataConfig { period_secs: Some(1.0), max_age_secs: Some(MaxAge::All(1.0)), ..data };
    let told = profile(&short).clock_doubts().join("; ");
    assert!(
        told.contains("although data.resample puts all on one clock: raise data.max_age_secs"),
        "{told}"
    );
    assert!(!told.contains("put them on one clock"), "{told}");
    // There is no warning for tags that are recorded together, nor for missing values of a wide log.
    let again: Vec<&str> = rows.lines().skip(1).collect();
    let others = again.join("\n").replace("FIT1", "other").replace("AIT2", "FIT1");
    let together = rows + &others.replace("other", "AIT2");
    assert_eq!(Folder::of_text("a.csv", &together).inspect().clock_doubts().len(), 0);
}

#[test]
fn changes_are_resampled_to_a_clock() {
    let times = [0, 3, 10, 25, 31, 60, 61];
    let a = [1.0, NAN, 2.0, 3.0, NAN, 4.0, NAN];
    let b = [NAN, 5.0, NAN, NAN, 6.0, NAN, 7.0];
    let folder = Folder::of("a.parquet", &log_at(times, &[("a", &a), ("b", &b)]));
    let [last, mean] = [Resample::Last, Resample::Mean].map(|resample| {
        let data = DataConfig {
            resample: Some(resample),
            period_secs: Some(10.0),
            max_age_secs: Some(MaxAge::All(30.0)),
            ..folder.data()
        };
        load_with(&data, &PreprocessConfig { max_missing: 1.0, ..PreprocessConfig::default() })
    });
    assert_eq!(train_seconds(&last), [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
    assert_eq!(train_values(&last, "a"), [2.0, 2.0, 3.0, 3.0, 3.0, 4.0]);
    assert_eq!(train_values(&last, "b"), [5.0, 5.0, 5.0, 6.0, 6.0, 6.0]);
    assert_eq!(train_values(&mean, "a"), [1.0, 2.0, 2.5, 3.0, 3.0, 3.0]);
    // The same from samples.
    let long = samples_of(times, [("a", a), ("b", b)]);
    let data = DataConfig {
        resample: Some(Resample::Last),
        period_secs: Some(10.0),
        max_age_secs: Some(MaxAge::All(30.0)),
        ..long.data()
    };
    let of_samples =
        load_with(&data, &PreprocessConfig { max_missing: 1.0, ..PreprocessConfig::default() });
    assert_eq!(of_samples.fingerprint, last.fingerprint);
    assert_refused(
        &DataConfig { resample: Some(Resample::Last), ..folder.data() },
        &["data.period_secs"],
    );
}

/// Returns the configuration for rows every 10 s, with these ages by channel.
fn with_ages(folder: &Folder, ages: &[(&str, f64)]) -> DataConfig {
    let ages = ages.iter().map(|&(entry, secs)| (entry.to_owned(), secs));
    DataConfig {
        resample: Some(Resample::Last),
        period_secs: Some(10.0),
        max_age_secs: Some(MaxAge::Channels(ages.collect())),
        ..folder.data()
    }
}

/// A tag of the laboratory, whose values stay valid for longer. Rows are only where the other
/// channels have values.
#[test]
fn a_tag_may_have_an_age_of_its_own() {
    let times = [0, 3, 10, 25, 31, 60, 61];
    let a = [1.0, NAN, 2.0, 3.0, NAN, 4.0, NAN];
    let b = [NAN, 5.0, NAN, NAN, 6.0, NAN, 7.0];
    let wide = Folder::of("a.parquet", &log_at(times, &[("a", &a), ("b", &b)]));
    let long = samples_of(times, [("a", a), ("b", b)]);
    let strict =
        PreprocessConfig { max_missing: 1.0, fill_limit: 0, ..PreprocessConfig::default() };
    let ages = [("default", 10.0), ("[b]", 30.0)];
    let dataset = load_with(&with_ages(&wide, &ages), &strict);
    // By its age b is also valid at 50, but no other value is.
    assert_eq!(train_seconds(&dataset), [10.0, 20.0, 30.0, 60.0]);
    assert_eq!(train_values(&dataset, "a"), [2.0, 2.0, 3.0, 4.0]);
    assert_eq!(train_values(&dataset, "b"), [5.0, 5.0, 5.0, 6.0]);
    let of_samples = load_with(&with_ages(&long, &ages), &strict);
    assert_eq!(of_samples.fingerprint, dataset.fingerprint);
    assert_refused_with(
        &with_ages(&wide, &[("default", 10.0), ("c*", 30.0)]),
        &strict,
        &["data.max_age_secs, \"c*\": it names no channel"],
    );
    assert_refused_with(
        &with_ages(&wide, &[("?", 20.0), ("b*", 30.0)]),
        &strict,
        &["give b an entry of its own"],
    );
    load_with(&with_ages(&wide, &[("?", 20.0), ("b", 30.0)]), &strict);
}

#[test]
fn text_beside_parquet_is_left_alone() {
    let folder = Folder::of("a.parquet", &log_at(0..5, &[("a", &[1.0, 2.0, 3.0, 4.0, 5.0])]));
    folder.write_file("tags.csv", "tag,unit\na,kPa\n");
    assert_eq!(folder.inspect().files, 1);
}
