//! Tests of times and numbers that can be read in several ways.

use std::fmt::Write as _;

use calib_core::Timestamp;
use calib_data::{DataConfig, Dataset, PreprocessConfig, TimestampUnit, table::Table};

use crate::support::{Folder, assert_refused, load_with, profile, train_seconds, train_values};

/// Returns one row per day, written with the month first.
fn days_of_march(days: std::ops::Range<u32>) -> String {
    let rows: Vec<String> = days.map(|day| format!("03/{day:02}/2024 10:00,{day}\n")).collect();
    format!("time,a\n{}", rows.concat())
}

#[test]
fn a_day_that_may_be_a_month_is_asked_for() {
    let folder = Folder::of_text("a.csv", &days_of_march(1..9));
    assert_refused(
        &folder.data(),
        &[
            "2024-01-03 10:00:00 with data.timestamp_format = \"%d/%m/%Y %H:%M\"",
            "2024-03-01 10:00:00 with data.timestamp_format = \"%m/%d/%Y %H:%M\"",
        ],
    );
    let data = DataConfig { timestamp_format: Some("%m/%d/%Y %H:%M".to_owned()), ..folder.data() };
    assert_eq!(load_with(&data, &PreprocessConfig::default()).profile.gaps.count, 0);
    // Another file, or a later row, decides.
    folder.write_file("b.csv", &days_of_march(9..20));
    let dataset = folder.load();
    assert_eq!((dataset.train.rows(), dataset.period.as_secs()), (19, 86_400.0));
}

#[test]
fn what_text_leaves_open_is_refused_with_the_line() {
    let cases: [(&str, &[&str]); 6] = [
        (
            "time,a,b\n2024-01-01,1,2\n2024-01-02,1\n",
            &["a.csv, line 3: 2 cells, and the header names 3 columns"],
        ),
        ("time,a\n2024-01-01,1\n2024-01-02,2\nsoon,3\n", &["soon"]),
        ("time;a\n2024-01-01;1,234\n2024-01-02;2,345\n", &["data.decimal"]),
        ("2024-01-01,1,2\n2024-01-02,1,2\n", &["such as time,channel_1,channel_2"]),
        (
            "Date;On;Off;a\n13.03.2024;06:00;07:00;1\n13.03.2024;07:00;08:00;2\n",
            &["column \"Date\"", "several columns have times of day (On, Off)"],
        ),
        ("a,b\n1.5,x\n2.5,y\n", &["has no column \"timestamp\""]),
    ];
    for (content, parts) in cases {
        assert_refused(&Folder::of_text("a.csv", content).data(), parts);
    }
}

#[test]
fn the_decimal_sign_is_that_of_the_whole_log() {
    let folder = Folder::of_text(
        "a.csv",
        "Zeit;a;b\n13.01.2024 00:00;1.210,5;1\n13.01.2024 00:01;1.215,5;2\n",
    );
    folder.write_file("b.csv", "Zeit;a;b\n13.01.2024 00:02;1310;3\n13.01.2024 00:03;1320;4\n");
    assert_eq!(train_values(&folder.load(), "a"), [1210.5, 1215.5, 1310.0, 1320.0]);
    folder.write_file("b.csv", "Zeit;a;b\n13.01.2024 00:02;1.310;3\n13.01.2024 00:03;1.320;4\n");
    assert_refused(
        &folder.data(),
        &["b.csv", "it has 1.310 and", "a.csv has 1.210,5", "data.decimal"],
    );
    let data = DataConfig { decimal: Some(','), ..folder.data() };
    let told = load_with(&data, &PreprocessConfig::default());
    assert_eq!(train_values(&told, "a"), [1210.5, 1215.5, 1310.0, 1320.0]);
    // If the first rows do not decide, later ones must not contradict each other, in one file or in two.
    let rows: Vec<String> =
        (0..500).map(|row| format!("{};{row};1\n", 1_704_067_200 + row)).collect();
    let whole = rows.concat();
    let late =
        |cell: &str, row: i32| format!("time;a;b\n{whole}{};{cell};2\n", 1_704_067_700 + row);
    let folder = Folder::of_text("a.csv", &late("1.210,5", 0));
    assert_eq!(train_values(&folder.load(), "a")[500], 1210.5);
    folder.write_file("b.csv", &late("1.310", 1).replace(&whole, ""));
    assert_refused(&folder.data(), &["data.decimal"]);
    let both = late("1.310", 0) + "1704067801;1.210,5;3\n";
    assert_refused(&Folder::of_text("a.csv", &both).data(), &["data.decimal"]);
}

#[test]
fn points_of_thousands_are_asked_about_as_commas_are() {
    let rows = ["997;434", "1.000;434", "1.001;435", "998;433"];
    let rows: Vec<String> = rows
        .iter()
        .enumerate()
        .map(|(minute, row)| format!("2024-03-11 00:{minute:02}:00;{row}\n"))
        .collect();
    let text = format!("Zeit;Q;P\n{}", rows.concat());
    let folder = Folder::of_text("a.csv", &text);
    assert_refused(
        &folder.data(),
        &[
            "1.000 is a fraction if data.decimal = \".\" and above a thousand if data.decimal = \",\"",
        ],
    );
    for (sign, expected) in
        [(',', [997.0, 1_000.0, 1_001.0, 998.0]), ('.', [997.0, 1.0, 1.001, 998.0])]
    {
        let data = DataConfig { decimal: Some(sign), ..folder.data() };
        let dataset = load_with(&data, &PreprocessConfig::default());
        // The states are f32.
        for (value, expected) in train_values(&dataset, "Q").into_iter().zip(expected) {
            assert!((value - expected).abs() < 1e-2, "{value} for {expected}");
        }
    }
    let comma = Folder::of_text("a.csv", &text.replace(';', ","));
    assert_eq!(train_values(&comma.load(), "P"), [434.0, 434.0, 435.0, 433.0]);
}

#[test]
fn a_notation_that_two_files_contradict_is_not_guessed() {
    let folder = Folder::of_text("a.csv", "time,a\n13/04/2024 10:00,1\n14/04/2024 10:00,2\n");
    folder.write_file("b.csv", "time,a\n04/15/2024 10:00,3\n04/16/2024 10:00,4\n");
    let orders = ["a.csv has times as %d/%m/%Y %H:%M", "b.csv as %m/%d/%Y %H:%M"];
    assert_refused(&folder.data(), &orders);
}

#[test]
fn numbers_that_fit_two_notations_are_told_with_both() {
    let days = "time,a\n45292.5,1\n45292.75,2\n45293,3\n";
    let folder = Folder::of_text("a.csv", days);
    let doubts = folder.inspect().clock_doubts().join("\n");
    for told in [
        "2024-01-01 12:00:00 with data.timestamp_unit = \"excel\"",
        "1970-01-01 12:34:52.5 with data.timestamp_unit = \"s\"",
    ] {
        assert!(doubts.contains(told), "{doubts}");
    }
    for (unit, zone, expected) in [
        (TimestampUnit::Excel, None, (1_704_110_400.0, false)),
        (TimestampUnit::Excel, Some("Europe/Paris"), (1_704_106_800.0, true)),
        (TimestampUnit::Seconds, None, (45_292.5, true)),
    ] {
        let data = DataConfig {
            timestamp_unit: Some(unit),
            time_zone: zone.map(str::to_owned),
            ..folder.data()
        };
        let dataset = load_with(&data, &PreprocessConfig::default());
        assert_eq!((train_seconds(&dataset)[0], dataset.profile.utc), expected, "{zone:?}");
    }
    // The same as Parquet, and as samples.
    let column = vec![45_292.5, 45_292.75, 45_293.0];
    let wide = Table::new().with("timestamp", column.clone()).with("a", vec![1.0, 2.0, 3.0]);
    let folder = Folder::of("a.parquet", &wide);
    assert_refused(&folder.data(), &["\"excel\""]);
    let data = DataConfig { timestamp_unit: Some(TimestampUnit::Excel), ..folder.data() };
    let dataset = load_with(&data, &PreprocessConfig::default());
    assert_eq!((train_seconds(&dataset)[0], dataset.profile.utc), (1_704_110_400.0, false));
    let tag = vec!["t".to_owned(), "t".to_owned(), "t".to_owned()];
    let long =
        Table::new().with("timestamp", column).with("tag", tag).with("value", vec![1.0, 2.0, 3.0]);
    folder.write("a.parquet", &long);
    assert_refused(&folder.data(), &["\"excel\""]);
    assert_eq!(train_seconds(&load_with(&data, &PreprocessConfig::default()))[0], 1_704_110_400.0);
    // Milliseconds of December 1969 would be seconds of 1937.
    let before = Folder::of_text("a.csv", "time,a\n-1036800000,1\n-1036740000,2\n-1036680000,3\n");
    assert_refused(
        &before.data(),
        &[
            "1969-12-20 00:00:00 with data.timestamp_unit = \"ms\"",
            "1937-02-23 00:00:00 with data.timestamp_unit = \"s\"",
        ],
    );
    let integers = Table::new()
        .with("timestamp", vec![-1_036_800_000_i64, -1_036_740_000])
        .with("a", vec![1.0, 2.0]);
    folder.write("a.parquet", &integers);
    assert_refused(&folder.data(), &["\"ms\""]);
    // A unit that calib does not read at all.
    let matlab = Folder::of_text("a.csv", "time,a\n739252.5,1\n739252.75,2\n");
    assert_refused(&matlab.data(), &["a.csv", "MATLAB"]);
}

/// Loads a log with these times of 2014-10-26: clocks in Moscow go from 2:00 back to 1:00, at 22:00 UTC of the day
/// before.
fn load_of_moscow(times: &[&str]) -> Dataset {
    let rows: Vec<String> =
        times.iter().enumerate().map(|(row, time)| format!("2014-10-26 {time},{row}\n")).collect();
    let folder = Folder::of_text("a.csv", &format!("time,a\n{}", rows.concat()));
    let data = DataConfig {
        time_zone: Some("Europe/Moscow".to_owned()),
        period_secs: Some(1_800.0),
        ..folder.data()
    };
    load_with(&data, &PreprocessConfig::default())
}

#[test]
fn rows_of_an_hour_that_comes_twice_are_placed_or_dropped_and_counted() {
    let twice = ["00:00", "00:30", "01:00", "01:30", "01:00", "01:30", "02:00", "02:30"];
    let whole = load_of_moscow(&twice);
    assert_eq!(train_values(&whole, "a"), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    assert_eq!((whole.profile.gaps.count, whole.profile.undecided_times), (0, 0));
    let once = ["00:00", "00:30", "01:00", "01:30", "02:00", "02:30"];
    let dropped = load_of_moscow(&once);
    assert_eq!(
        train_values(&dropped, "a"),
        [0.0, 1.0, 4.0, 5.0],
        "of which hour the others are, nobody knows"
    );
    assert_eq!((dropped.profile.undecided_times, dropped.profile.null_timestamps), (2, 2));
    // Each tag is decided by its own rows.
    let mut rows = String::new();
    for (row, time) in twice.iter().enumerate() {
        writeln!(rows, "2014-10-26 {time},often,{row}").expect("memory");
    }
    rows.push_str(
        "2014-10-26 00:00,seldom,1\n2014-10-26 01:30,seldom,2\n2014-10-26 02:30,seldom,3\n",
    );
    let long = Folder::of_text("a.csv", &format!("time,tag,value\n{rows}"));
    let data = DataConfig { time_zone: Some("Europe/Moscow".to_owned()), ..long.data() };
    let profile = profile(&data);
    let missing = ["often", "seldom"].map(|name| profile.channel(name).expect("a channel").missing);
    assert_eq!((profile.undecided_times, missing), (1, [0, 6]));
}

#[test]
fn rows_of_the_year_9999_are_dropped_in_every_form() {
    for never in ["9999-12-31 23:59:59", "9999-12-31T23:59:59Z", "9999-01-01"] {
        let folder = Folder::of_text(
            "a.csv",
            &format!("time,a\n2024-01-01,1\n2024-01-02,2\n{never},3\n2024-01-03,4\n"),
        );
        let dataset = folder.load();
        assert_eq!(train_values(&dataset, "a"), [1.0, 2.0, 4.0], "{never}");
        assert_eq!(dataset.profile.null_timestamps, 1);
    }
    let folder = Folder::new();
    let times = ["2024-01-01", "9999-12-31T23:59:59", "2024-01-02"].map(str::to_owned).to_vec();
    folder
        .write("a.parquet", &Table::new().with("timestamp", times).with("a", vec![1.0, 2.0, 3.0]));
    assert_eq!(train_values(&folder.load(), "a"), [1.0, 3.0]);
}

#[test]
fn points_and_commas_that_may_both_be_of_thousands_are_asked_about() {
    let text = "Zeit;Menge;P\n2024-03-01 00:00;3.611;10,710\n2024-03-01 00:01;3.622;11,246\n";
    let folder = Folder::of_text("a.csv", text);
    assert_refused(&folder.data(), &["a.csv: it has 3.611 and 10,710", "data.decimal"]);
    let data = DataConfig { decimal: Some(','), ..folder.data() };
    let told = load_with(&data, &PreprocessConfig::default());
    assert_eq!(train_values(&told, "Menge"), [3611.0, 3622.0]);
    // A single column of points is read, with a warning.
    let alone = Folder::of_text("a.csv", &text.replace(";10,710", ";1").replace(";11,246", ";2"));
    assert_eq!(train_values(&alone.load(), "Menge"), [3.611, 3.622]);
    let doubts = alone.inspect().clock_doubts().join("\n");
    assert!(doubts.contains("points such as that of 3.611"), "{doubts}");
    let quoted = "time,ratio,power\n2024-03-01 00:00,1.243,\"5,284\"\n2024-03-01 00:01,1.251,999\n";
    let quoted = Folder::of_text("a.csv", quoted).load();
    assert_eq!(train_values(&quoted, "ratio"), [1.243, 1.251]);
    assert_eq!(train_values(&quoted, "power"), [5284.0, 999.0]);
    // If the first rows have no point, a later one is ambiguous.
    let rows: Vec<String> =
        (0..500).map(|row| format!("{};{}\n", 1_704_067_200 + row, 400 + row)).collect();
    let late = format!("time;a\n{}1704067700;1.001\n", rows.concat());
    assert_refused(&Folder::of_text("a.csv", &late).data(), &["line 502: 1.001 is a fraction if"]);
    let zero = late.replace("1.001", "0.001");
    assert_eq!(train_values(&Folder::of_text("a.csv", &zero).load(), "a")[500], 0.001);
}

#[test]
fn spaces_and_apostrophes_set_thousands_apart() {
    for thousands in [" ", "\u{A0}", "\u{202F}", "'"] {
        let text = format!(
            "Zeit;Niveau;P\n2024-03-01 00:00;2{thousands}044,722;9\n2024-03-01 00:01;999,5;8\n"
        );
        let folder = Folder::of_text("a.csv", &text);
        assert_eq!(train_values(&folder.load(), "Niveau"), [2044.722, 999.5], "{thousands:?}");
    }
}

/// Returns ten rows, two per day, from day `first` of March on; `date` formats the day.
fn half_days(first: u32, date: impl Fn(u32) -> String) -> String {
    let rows = (0..10).map(|row| {
        let hour = 12 * (row % 2);
        format!("{} {hour:02}:00,{row}\n", date(first + row / 2))
    });
    format!("time,a\n{}", rows.collect::<String>())
}

fn day_first(day: u32) -> String {
    format!("{day:02}/03/2024")
}

fn month_first(day: u32) -> String {
    format!("03/{day:02}/2024")
}

#[test]
fn the_order_of_day_and_month_is_that_of_all_files() {
    let folder = Folder::of_text("a.csv", &half_days(11, day_first));
    folder.write_file("b.csv", &half_days(16, month_first));
    let told = ["a.csv has times as %d/%m/%Y", "b.csv as %m/%d/%Y", "change places"];
    assert_refused(&folder.data(), &told);
    // In the notation of the second file, the days of the first one would be months apart.
    folder.write_file("a.csv", &half_days(6, day_first));
    let told = [
        "b.csv has times as %m/%d/%Y",
        "a.csv are months apart",
        "one order, set data.timestamp_format",
    ];
    assert_refused(&folder.data(), &told);
    folder.write_file("a.csv", &half_days(6, month_first));
    assert_eq!((folder.load().train.rows(), folder.inspect().gaps.count), (20, 1));
    // Samples of a laboratory on the fifth of each month.
    let samples = (1..=6).map(|month| format!("{month:02}/05/2024 12:00,{month}\n"));
    folder.write_file("b.csv", &format!("time,b\n{}", samples.collect::<Vec<_>>().concat()));
    folder.write_file("a.csv", &half_days(16, month_first));
    assert_eq!(profile(&folder.data()).start, Timestamp::from_micros(1_704_456_000_000_000));
}

#[test]
fn dates_with_points_are_day_first() {
    let folder = Folder::of_text("a.csv", &half_days(1, |day| format!("{day:02}.03.2024")));
    assert_eq!(train_seconds(&folder.load())[..2], [1_709_251_200.0, 1_709_294_400.0]);
    let doubts = folder.inspect().clock_doubts().join("\n");
    let told = "are read as day, month, year: set data.timestamp_format = \"%m.%d.%Y %H:%M\"";
    assert!(doubts.contains(told), "{doubts}");
    // If the year has two digits, it may come first.
    let short = Folder::of_text("a.csv", &half_days(11, |day| format!("{day:02}.03.24")));
    assert_eq!(train_seconds(&short.load())[0], 1_710_115_200.0);
    let year_first = Folder::of_text("a.csv", &half_days(11, |day| format!("24.03.{day:02}")));
    assert_eq!(train_seconds(&year_first.load())[0], 1_710_115_200.0);
    let one_day = "time,a\n24.03.11 00:00,1\n24.03.11 12:00,2\n";
    let told = ["data.timestamp_format = \"%y.%m.%d %H:%M\"", "\"%d.%m.%y %H:%M\""];
    assert_refused(&Folder::of_text("a.csv", one_day).data(), &told);
    // A later row that contradicts the first ones counts.
    let month_first = half_days(10, |day| format!("03.{day:02}.2024"));
    assert_eq!(train_seconds(&Folder::of_text("a.csv", &month_first).load())[0], 1_710_028_800.0);
}

#[test]
fn days_of_a_spreadsheet_are_no_seconds_of_1970() {
    let whole = "time,a\n45352,1\n45353,2\n45354,3\n";
    assert_refused(&Folder::of_text("a.csv", whole).data(), &["data.timestamp_unit"]);
    let text = "time,a\n45352.000000,1\n45352.000694,2\n45352.001389,3\n";
    let folder = Folder::of_text("a.csv", text);
    assert_eq!(train_seconds(&folder.load())[0], 1_709_251_200.0);
    let doubts = folder.inspect().clock_doubts().join("\n");
    assert!(doubts.contains("read as days of a spreadsheet: 2024-03-01 00:00:00 with"), "{doubts}");
}

#[test]
fn empty_files_among_others_are_left_out() {
    let folder = Folder::of_text("a.csv", "time,a\n2024-03-01 00:00,1\n2024-03-01 00:01,2\n");
    folder.write_file("b.csv", "");
    folder.write_file("c.csv", "time,a\n");
    assert_eq!(train_values(&folder.load(), "a"), [1.0, 2.0]);
    let doubts = folder.inspect().clock_doubts().join("\n");
    assert!(doubts.contains("an empty file is left out: ") && doubts.contains("b.csv"), "{doubts}");
    assert_refused(&Folder::of_text("b.csv", "").data(), &["b.csv: it is empty"]);
}

#[test]
fn text_of_16_bits_is_named() {
    let folder = Folder::new();
    let wide: Vec<u8> = "time,a\n2024-03-01 00:00,1\n2024-03-01 00:01,2\n"
        .bytes()
        .flat_map(|byte| [byte, 0])
        .collect();
    std::fs::write(folder.file("a.csv"), wide).expect("written");
    assert_refused(&folder.data(), &["a.csv: it is text in UTF-16 without its mark"]);
}
