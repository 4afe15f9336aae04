//! Tests of text files that end in the middle of their last line.

use std::fmt::Write as _;

use calib_data::{BadRows, DataConfig};

use crate::support::{Folder, assert_refused, profile};

/// Returns forty rows and the offset of the last one. `value` formats the number of a row.
fn rows(header: &str, separator: char, value: impl Fn(f64) -> String) -> (String, usize) {
    let mut text = format!("{header}\n");
    let mut last = 0;
    for row in 0..40 {
        last = text.len();
        let number = value(120.0 + f64::from(row % 7) / 4.0);
        writeln!(text, "2024-03-11 00:{row:02}:00{separator}{number}").expect("memory");
    }
    (text, last)
}

/// Returns the number of rows and of missing values.
fn read(data: &DataConfig) -> (u64, u64) {
    let found = profile(data);
    (found.rows, found.channels[0].missing)
}

#[test]
fn a_last_line_is_never_read_as_another_number() {
    let files = [
        rows("time,level", ',', |value| format!("{value:.2}")),
        rows("time;level", ';', |value| format!("{value:.2}").replace('.', ",")),
    ];
    for (text, last) in files {
        let number = last + "2024-03-11 00:39:00,".len();
        let whole = text.len() - 1;
        assert!(["121.00", "121,00"].contains(&&text[number..whole]), "{text}");
        for end in last + 1..=whole {
            let folder = Folder::of_text("a.csv", &text[..end]);
            let mut data = folder.data();
            if end == whole {
                assert_eq!(read(&data), (40, 0), "honest files may end so");
            } else if end == number {
                assert_eq!(read(&data), (40, 1), "no number is left");
            } else {
                assert_refused(&data, &["a.csv, line 41: ", "is the file cut off"]);
                data.bad_rows = BadRows::Skip;
                assert_eq!(read(&data), (39, 0), "{:?}", &text[last..end]);
            }
        }
    }
}

#[test]
fn files_of_a_tag_each_may_be_cut() {
    let (text, last) = rows("time,value", ',', |value| format!("{value:.2}"));
    let folder = Folder::of_text("FIT100.csv", &text);
    folder.write_file("PIT300.csv", &text[..last + "2024-03-11 00:39:00,121".len()]);
    let told = ["PIT300.csv, line 41: no line break follows \"121\"", "have 2 decimals"];
    assert_refused(&folder.data(), &[&told[..], &["Restore the file", "data.bad_rows"]].concat());
}

fn read_text(text: &str) -> (u64, u64) {
    read(&Folder::of_text("a.csv", text).data())
}

#[test]
fn a_short_last_number_may_be_whole() {
    // Without zeros at the end, 120 has its full length.
    let (text, last) = rows("time,level", ',', |value| value.to_string());
    let shorter = format!("{}2024-03-11 00:39:00,120", &text[..last]);
    assert_eq!(read_text(&shorter), (40, 0));
    // A line break shows that the number is complete.
    let (text, last) = rows("time,level", ',', |value| format!("{value:.2}"));
    let shorter = format!("{}2024-03-11 00:39:00,120", &text[..last]);
    assert_eq!(read_text(&format!("{shorter}\n")), (40, 0));
    assert_refused(&Folder::of_text("a.csv", &shorter).data(), &["is the file cut off"]);
    // A channel that is switched off late writes 0.
    let mut late = text;
    for row in 0..500 {
        let [hour, minute] = [1 + row / 60, row % 60];
        writeln!(late, "2024-03-11 {hour:02}:{minute:02}:00,120.50").expect("memory");
    }
    let [off, cut] = ["0\n2024-03-11 10:00:00,0", "120.50\n2024-03-11 10:00:00,0"];
    assert_eq!(read_text(&format!("{late}2024-03-11 09:59:00,{off}")), (542, 0));
    let cut = format!("{late}2024-03-11 09:59:00,{cut}");
    assert_refused(&Folder::of_text("a.csv", &cut).data(), &["is the file cut off"]);
    // Each tag of a long table may have its own format.
    let mut long = "time,tag,value\n".to_owned();
    for tag in ["PIT300", "valve"] {
        for row in 0..450 {
            let [hour, minute] = [row / 60, row % 60];
            let number =
                if tag == "valve" { (row % 2).to_string() } else { format!("{minute}.50") };
            writeln!(long, "2024-03-11 {hour:02}:{minute:02}:00,{tag},{number}").expect("memory");
        }
    }
    assert_eq!(read_text(long.trim_end()), (450, 0));
}
