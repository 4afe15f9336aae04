//! Tests of files of one column each, which may be of one tag each or of one tag together.

use std::fmt::Write as _;

use calib_data::{DataConfig, Shape};

use crate::support::{Folder, names, profile};

/// Returns a file of one column, recorded every minute from second `from` of the day on.
fn minutes(header: &str, from: u32, level: f64) -> String {
    minutes_around(header, from, |_| level)
}

/// Returns such a file with a level for each minute.
fn minutes_around(header: &str, from: u32, level: impl Fn(u32) -> f64) -> String {
    let mut text = format!("Zeitstempel;{header}\n");
    for minute in 0..40 {
        let second = from + 60 * minute;
        let [hours, minutes, seconds] = [second / 3_600, second / 60 % 60, second % 60];
        let value = (level(minute) + f64::from(minute % 7) / 4.0).to_string().replace('.', ",");
        writeln!(text, "2024-03-11 {hours:02}:{minutes:02}:{seconds:02};{value}").expect("memory");
    }
    text
}

#[test]
fn files_of_one_time_are_of_a_tag_each_whatever_their_column_is_called() {
    for header in ["Wert", "Valeur", "y", "Value [bar]"] {
        // On one clock, and on two.
        for from in [0, 30] {
            let folder = Folder::of_text("FIT100.csv", &minutes(header, 0, 120.25));
            folder.write_file("PIT300.csv", &minutes(header, from, 434.25));
            let data = folder.data();
            let found = profile(&data);
            assert_eq!(names(&found), ["FIT100", "PIT300"], "{header}, from {from} on");
            assert_eq!((found.shape, found.contradictions.count), (Shape::FilePerTag, 0));
            let pressures = found.channel("PIT300").expect("a tag").values.as_ref();
            assert!(pressures.is_some_and(|values| values.min > 400.0), "no flow among them");
            let wide = DataConfig { shape: Some(Shape::Wide), ..data };
            assert_eq!(profile(&wide).channels.len(), 1, "if the study says so");
        }
    }
}

#[test]
fn files_that_follow_one_another_are_of_one_tag_unless_the_study_says_otherwise() {
    let folder = Folder::of_text("export 1.csv", &minutes("Wert", 0, 120.25));
    folder.write_file("export 2.csv", &minutes("Wert", 2_400, 122.25));
    let data = folder.data();
    let found = profile(&data);
    assert_eq!((found.shape, found.channels.len(), found.rows), (Shape::Wide, 1, 80));
    // An export that repeats the rows of another is of the same sensor.
    folder.write_file("export 3.csv", &minutes("Wert", 0, 120.25));
    let found = profile(&data);
    assert_eq!((found.shape, found.duplicates.identical), (Shape::Wide, 40));
    let asked = [
        DataConfig { shape: Some(Shape::FilePerTag), ..data.clone() },
        DataConfig { value: Some("Wert".to_owned()), ..data },
    ];
    for data in asked {
        let found = profile(&data);
        assert_eq!(names(&found), ["export 1", "export 2", "export 3"]);
        assert_eq!(found.shape, Shape::FilePerTag);
    }
}

/// Returns such a file whose first `other` rows have another level.
fn with_other_rows(header: &str, other: u32) -> String {
    minutes_around(header, 0, |minute| if minute < other { 300.25 } else { 120.25 })
}

#[test]
fn files_that_agree_in_part_are_told_with_the_key_that_reads_them_otherwise() {
    for header in ["Wert", "Druck"] {
        let folder = Folder::of_text("export 1.csv", &with_other_rows(header, 0));
        folder.write_file("export 2.csv", &with_other_rows(header, 12));
        let read = |shape: Option<Shape>| {
            let found = profile(&DataConfig { shape, ..folder.data() });
            (found.shape, found.channels.len(), found.contradictions.count, found.read_as)
        };
        let told = "the files \"export 1\" and \"export 2\" have the same value in 70 % of their 40 shared rows, and are read as \
                    a tag each. If they are exports of one sensor, set data.shape = \"wide\"";
        assert_eq!(read(None), (Shape::FilePerTag, 2, 0, vec![told.to_owned()]), "{header}");
        let [wide, per_tag] = [Shape::Wide, Shape::FilePerTag];
        assert_eq!(read(Some(wide)), (wide, 1, 12, Vec::new()), "{header}");
        assert_eq!(read(Some(per_tag)), (per_tag, 2, 0, Vec::new()), "{header}");
        folder.write_file("export 2.csv", &with_other_rows(header, 2));
        let told = "the files \"export 1\" and \"export 2\" have the same value in 95 % of their 40 shared rows, and are read as \
                    exports of one sensor. If each is of a tag of its own, set data.shape = \"file_per_tag\"";
        assert_eq!(read(None), (wide, 1, 2, vec![told.to_owned()]), "{header}");
        assert_eq!(read(Some(per_tag)), (per_tag, 2, 0, Vec::new()), "{header}");
        // A third file that has nothing in common with the first leaves no doubt.
        folder.write_file("export 3.csv", &with_other_rows(header, 40));
        assert_eq!(read(None), (per_tag, 3, 0, Vec::new()), "{header}");
    }
}

/// Returns such a file with a column of quality.
fn with_quality(header: &str, level: f64) -> String {
    let mut text = String::new();
    for (row, line) in minutes(header, 0, level).lines().enumerate() {
        let quality = match row {
            0 => "Quality",
            7 => "Bad",
            _ => "Good",
        };
        writeln!(text, "{line};{quality}").expect("memory");
    }
    text
}

#[test]
fn a_column_of_quality_holds_for_files_of_a_tag_each() {
    for header in ["Wert", "y"] {
        let folder = Folder::of_text("FIT100.csv", &with_quality(header, 120.25));
        folder.write_file("PIT300.csv", &with_quality(header, 434.25));
        for shape in [None, Some(Shape::FilePerTag)] {
            let found = profile(&DataConfig { shape, ..folder.data() });
            assert_eq!(names(&found), ["FIT100", "PIT300"], "{header}");
            assert_eq!(found.bad_quality, 2, "{header}");
        }
    }
}
