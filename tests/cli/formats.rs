//! Logs as text, and the Parquet files that `import` makes of them.

use std::fmt::Write as _;

use crate::harness::Place;

/// Returns a long table of two tags with one row per minute.
fn long() -> String {
    let rows = (0..90).flat_map(|minute: u32| {
        let time = format!("2024-03-13 {:02}:{:02}:00", 6 + minute / 60, minute % 60);
        let wave = f64::from(minute % 7) / 4.0;
        let quality = if minute == 40 { 0 } else { 192 };
        [
            format!("{time},FIT100,{wave},192\n"),
            format!("{time},PIT300,{},{quality}\n", 1500.0 + wave),
        ]
    });
    std::iter::once("DateTime,TagName,Value,OPCQuality\n".to_owned()).chain(rows).collect()
}

#[test]
fn a_long_table_is_shown_and_imported() {
    let place = Place::new();
    place.write("history.csv", &long());
    place.calib(&["inspect", "history.csv"]).succeeds_with(&[
        "read as long tables: one row per sample",
        "1: samples of bad quality",
        "1 h 29 min",
    ]);
    let made = place.calib(&["import", "history.csv", "wide.parquet"]).succeeds();
    assert!(made.contains("90 rows of 2 channels"), "{made}");
    place.calib(&["import", "history.csv", "wide.parquet"]).fails_with(2, &["--force"]);
    place.calib(&["inspect", "wide.parquet"]).succeeds_with(&["read as wide tables"]);
    let [long, wide] = ["history.csv", "wide.parquet"]
        .map(|log| place.calib(&["inspect", log, "--json"]).json(&[0]));
    assert_eq!(long["shape"], "long");
    assert_eq!(long["train"], wide["train"]);
    for channel in 0..2 {
        assert_eq!(long["channels"][channel]["values"], wide["channels"][channel]["values"]);
    }
}

#[test]
fn a_spike_is_told_and_harmless() {
    let place = Place::new();
    let mut text = String::from("time,LIT100\n");
    for minute in 0..600_u32 {
        let level = if minute == 300 { 9.9e12 } else { 1500.0 + f64::from(minute % 11) };
        writeln!(text, "2024-03-13 {:02}:{:02}:00,{level}", minute / 60, minute % 60)
            .expect("memory");
    }
    place.write("level.csv", &text);
    let shown = place.calib(&["inspect", "level.csv"]);
    assert!(shown.succeeds().contains("1 spike"), "{}", shown.stdout());
    assert!(
        shown.stderr().contains("LIT100: a spike (such as 9900000000000 at 2024-03-13 05:00:00)"),
        "{}",
        shown.stderr()
    );
    let json = place.calib(&["inspect", "level.csv", "--json"]).json(&[0]);
    assert_eq!(json["channels"][0]["values"]["max"], 1510.0);
}

#[test]
fn an_import_says_what_it_dropped() {
    let place = Place::new();
    let mut text = String::from("time,LIT100,FIT200\n");
    for minute in 0..60_u32 {
        writeln!(text, "2024-03-13 05:{minute:02}:00,{minute},1e200").expect("memory");
        writeln!(text, "9999-12-31 00:00:00,{minute},{minute}").expect("memory");
        if minute < 5 {
            writeln!(text, "2024-03-13 05:{minute:02}:00,{minute},").expect("memory");
        }
    }
    place.write("log.csv", &text);
    place.calib(&["import", "log.csv", "wide.parquet"]).succeeds_with(&[
        "60 rows of 2 channels",
        "60 of 125 rows without a timestamp of the years 1 to 9998",
        "5 of 125 rows of the same time as another",
        "FIT200: 60 values not finite or beyond ±1e150",
    ]);
    let json = place.calib(&["import", "log.csv", "again.parquet", "--json"]).json(&[0]);
    assert_eq!(json["dropped"]["without_time"], 60);
    assert_eq!(json["dropped"]["repeated"], 5);
    let whole = "time,LIT100\n2024-03-13 05:00:00,1\n2024-03-13 05:01:00,2\n";
    place.write("whole.csv", whole);
    let said = place.calib(&["import", "whole.csv", "whole.parquet"]).succeeds();
    assert_eq!(said.lines().count(), 1, "nothing was dropped: {said}");
}

/// Three samples with a period of a millisecond.
#[test]
fn what_memory_cannot_hold_is_refused_with_the_key() {
    let place = Place::new();
    place.write(
        "log.csv",
        "time,a\n2024-01-01 00:00:00,1\n2024-01-20 00:00:00,2\n2024-02-18 00:00:00,3\n",
    );
    let args = ["inspect", "log.csv", "--set=data.resample=last", "--set=data.period_secs=1e-5"];
    place
        .calib(&[&args[..], &["--set=data.max_age_secs=1e7"]].concat())
        .fails_with(2, &["data.period_secs"]);
    let few = place.calib(&[&args[..], &["--set=data.max_age_secs=1e-4"]].concat());
    few.ends(&[0, 1]);
    assert!(
        few.stdout().contains("23 rows") || few.stdout().contains("3 rows in 1 file"),
        "{}",
        few.stdout()
    );
}
