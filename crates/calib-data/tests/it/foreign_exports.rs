//! Tests of exports with columns, words and numbers of other languages.

use std::fmt::Write as _;

use calib_data::{DataConfig, Shape};

use crate::support::{Folder, assert_refused, kept, profile};

/// Returns the rows of three tags in turn, 30 each, `apart` seconds from one to the next. `row` writes the cells after
/// the time, given the numbers of the tag and of its row.
fn in_turn(header: &str, apart: usize, row: impl Fn(usize, usize) -> String) -> String {
    let mut text = format!("{header}\n");
    for number in 0..30 {
        for tag in 0..3 {
            writeln!(text, "2024-03-01 00:{number:02}:{:02};{}", tag * apart, row(tag, number))
                .expect("memory");
        }
    }
    text
}

const TAGS: [&str; 3] = ["Füllstand", "Durchfluss", "Temperatur"];

#[test]
fn columns_of_other_languages_are_a_long_table() {
    for apart in [0, 20] {
        let text = in_turn("Zeitpunkt;Messstelle;Wert;Qualität", apart, |tag, number| {
            let word = if number == 4 { "SCHLECHT" } else { "GUT" };
            format!("{};{},5{number};{word}", TAGS[tag], 10 * tag)
        });
        let found = Folder::of_text("a.csv", &text).inspect();
        assert_eq!((found.shape, found.channels.len()), (Shape::Long, 3), "{apart}");
        assert_eq!(found.bad_quality, 3);
    }
}

#[test]
fn words_that_alternate_are_tags_or_asked_about() {
    let known = in_turn("Zeitpunkt;Wo;Ist;Qualität", 20, |tag, number| {
        format!("{};{tag},{number:02};GUT", TAGS[tag])
    });
    assert_eq!(Folder::of_text("a.csv", &known).inspect().shape, Shape::Long);
    let same = in_turn("Zeitpunkt;Wo;Ist;Werk", 20, |tag, number| {
        format!("{};{tag},{number:02};x", TAGS[tag])
    });
    let folder = Folder::of_text("a.csv", &same);
    let found = folder.inspect();
    assert_eq!(found.shape, Shape::Long);
    let told = found.read_as.join("\n");
    assert!(told.contains("words in \"Wo\" change from row to row and are read as tags"), "{told}");
    let long = DataConfig { shape: Some(Shape::Long), ..folder.data() };
    assert_eq!(profile(&long).read_as, [""; 0]);
    // A name of the values does not say what the words are.
    let weather = Folder::of_text("a.csv", &same.replace(";Wo;Ist;", ";Wetter;Wert;")).inspect();
    assert_eq!(weather.shape, Shape::Long);
    assert!(weather.read_as.join("\n").contains("words in \"Wetter\""), "{:?}", weather.read_as);
    let open = in_turn("Zeitpunkt;Wo;Ist;Was", 20, |tag, number| {
        format!("{};{tag},{number:02};{}", TAGS[tag], ["m", "m3/h", "C"][tag])
    });
    let folder = Folder::of_text("a.csv", &open);
    assert_refused(&folder.data(), &["data.tag = \"Wo\" and data.value = \"Ist\"", "\"wide\""]);
    let wide = DataConfig { shape: Some(Shape::Wide), ..folder.data() };
    assert_eq!(profile(&wide).shape, Shape::Wide);
    // A state stays for many rows, and ON and OFF are not names.
    for words in [["RUN", "STOP"], ["AUTO", "HAND"]] {
        let state = in_turn("Zeitpunkt;Betrieb;Ist;Linie", 20, |tag, number| {
            format!("{};{tag},{number:02};A", words[number / 10 % 2])
        });
        assert_eq!(Folder::of_text("a.csv", &state).inspect().shape, Shape::Wide, "{words:?}");
    }
    let fast = in_turn("Zeitpunkt;Ventil;Ist", 20, |tag, number| {
        format!("{};{tag},{number:02}", ["ON", "OFF"][tag % 2])
    });
    assert_eq!(Folder::of_text("a.csv", &fast).inspect().shape, Shape::Wide);
}

/// Days with the weather, whose words change from row to row, and what `row` writes behind it.
fn days(header: &str, row: impl Fn(usize) -> String) -> String {
    let mut text = format!("{header}\n");
    for day in 0..90 {
        let weather = ["sonnig", "Regen", "bewölkt"][day * day % 7 % 3];
        writeln!(text, "2024-{:02}-{:02};{weather};{}", 1 + day / 28, 1 + day % 28, row(day))
            .expect("memory");
    }
    text
}

#[test]
fn words_that_are_states_are_asked_about() {
    let asked = ["data.tag = \"Wetter\"", "data.shape = \"wide\""];
    // A switch beside them is a channel, however much the words tell of the numbers.
    for level in [0, 1_000] {
        let text = days("Datum;Wetter;Pumpe;Ertrag", |day| {
            let pump = ["EIN", "AUS"][day / 9 % 2];
            format!("{pump};{}", day % 11 + level * (day * day % 7 % 3))
        });
        let folder = Folder::of_text("a.csv", &text);
        assert_refused(&folder.data(), &asked);
        let wide = DataConfig { shape: Some(Shape::Wide), ..folder.data() };
        assert_eq!(kept(&profile(&wide)), ["Pumpe", "Ertrag"]);
    }
    // So are words alone that tell little of the numbers.
    let text = days("Datum;Wetter;Ertrag", |day| (day % 11 + 4 * (day * day % 7 % 3)).to_string());
    assert_refused(&Folder::of_text("a.csv", &text).data(), &asked);
}

#[test]
fn words_of_quality_that_nobody_knows_are_asked_for() {
    let text = in_turn("Zeitpunkt;Messstelle;Wert;Qualität", 0, |tag, number| {
        format!("{};{tag},{number:02};FEINE", TAGS[tag])
    });
    let folder = Folder::of_text("a.csv", &text);
    assert_refused(&folder.data(), &["\"Qualität\"", "\"FEINE\"", "data.good_quality"]);
    let good_quality = vec!["feine".to_owned()];
    let found = profile(&DataConfig { good_quality, ..folder.data() });
    assert_eq!((found.bad_quality, kept(&found).len()), (0, 3));
}

#[test]
fn a_sensor_that_is_off_at_first_has_words_that_other_files_tell() {
    let folder = Folder::new();
    for (number, tag) in ["flow", "level"].into_iter().enumerate() {
        let mut text = format!("time,{tag},quality\n");
        for row in 0..900 {
            let word = if number == 0 && row < 450 { "Comm Fail" } else { "Good" };
            let [hour, minute, value] = [row / 60, row % 60, row % 7 + number];
            writeln!(text, "2024-03-01 {hour:02}:{minute:02},{value},{word}").expect("memory");
        }
        folder.write_file(&format!("{tag}.csv"), &text);
    }
    let found = folder.inspect();
    assert_eq!((found.shape, found.bad_quality), (Shape::FilePerTag, 450));
}
