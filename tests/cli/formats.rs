//! Logs as text, and as Parquet made of them.

use std::fmt::Write as _;

use crate::harness::Place;

/// A long table of two tags, one row a minute.
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
    let shown = place.calib(&["inspect", "history.csv"]).succeeds();
    assert!(shown.contains("read as long tables: a row a sample"), "{shown}");
    assert!(shown.contains("1: samples of bad quality"), "{shown}");
    assert!(shown.contains("1 h 29 min"), "{shown}");
    let made = place.calib(&["import", "history.csv", "wide.parquet"]).succeeds();
    assert!(made.contains("90 rows of 2 channels"), "{made}");
    let again = place.calib(&["import", "history.csv", "wide.parquet"]).fails(2);
    assert!(again.contains("--force"), "{again}");
    let wide = place.calib(&["inspect", "wide.parquet"]).succeeds();
    assert!(wide.contains("read as wide tables"), "{wide}");
    let json = |log: &str| -> serde_json::Value {
        let text = place.calib(&["inspect", log, "--json"]).succeeds();
        serde_json::from_str(&text).expect("JSON")
    };
    let (long, wide) = (json("history.csv"), json("wide.parquet"));
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
        shown
            .stderr()
            .contains("LIT100 has a spike (such as 9900000000000 at 2024-03-13 05:00:00)"),
        "{}",
        shown.stderr()
    );
    let json = place.calib(&["inspect", "level.csv", "--json"]).succeeds();
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["channels"][0]["values"]["max"], 1510.0);
}
