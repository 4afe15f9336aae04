use std::path::PathBuf;

use calib_core::Timestamp;

use super::*;

fn path() -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("table.parquet");
    (directory, path)
}

fn table() -> Table {
    Table::new()
        .with("f64", vec![1.5, -0.0, f64::INFINITY])
        .with("f32", vec![1.5_f32, 2.5, 3.5])
        .with("u32", vec![0_u32, 1, u32::MAX])
        .with("u64", vec![0_u64, 1, u64::MAX])
        .with("i64", vec![i64::MIN, 0, i64::MAX])
        .with("bool", vec![true, false, true])
        .with("text", vec!["a".to_owned(), String::new(), "é".to_owned()])
        .with("time", (0..3).map(Timestamp::from_micros).collect())
        .with_optional("f64?", vec![Some(1.0), None, Some(3.0)])
        .with_optional::<String>("text?", vec![None, Some("b".to_owned()), None])
        .with_optional("time?", vec![None, None, Some(Timestamp::from_micros(-7))])
        .with_optional("bool?", vec![Some(true), None, None])
        .with_metadata("format", "1")
        .with_metadata("columns", "{\"a\": 1}")
}

#[test]
fn every_type_comes_back() {
    let (_directory, path) = path();
    table().write_parquet(&path).expect("written");
    assert_eq!(read_parquet(&path).expect("readable"), table());
}

fn large() -> Table {
    let rows = 300_000_u32;
    (0..6).fold(table_of_rows(rows), |table, column| {
        table.with(
            format!("c{column}"),
            (0..rows).map(|row| f64::from(row * (column + 1) % 977)).collect(),
        )
    })
}

#[test]
fn the_same_table_gives_the_same_bytes() {
    let (_directory, path) = path();
    large().write_parquet(&path).expect("written");
    let first = std::fs::read(&path).expect("readable");
    for _ in 0..3 {
        large().write_parquet(&path).expect("written");
        assert!(first == std::fs::read(&path).expect("readable"));
    }
    assert_eq!(read_parquet(&path).expect("readable"), large());
}

fn table_of_rows(rows: u32) -> Table {
    Table::new().with("row", (0..rows).collect())
}

#[test]
fn an_empty_table_keeps_its_types() {
    let (_directory, path) = path();
    let empty = Table::new().with::<f64>("a", vec![]).with::<String>("b", vec![]);
    empty.write_parquet(&path).expect("written");
    assert_eq!(read_parquet(&path).expect("readable"), empty);
}

#[test]
fn some_columns_can_be_read_alone() {
    let (_directory, path) = path();
    table().write_parquet(&path).expect("written");
    let part = read_parquet_columns(&path, &["u32", "f64"]).expect("readable");
    assert_eq!(part.names().collect::<Vec<_>>(), ["u32", "f64"]);
    assert_eq!(part.column::<u32>("u32").expect("u32"), [0, 1, u32::MAX]);
    let error = read_parquet_columns(&path, &["f65"]).expect_err("no such column");
    assert!(error.to_string().starts_with("there is no column f65; the columns are: f64, f32"));
}

#[test]
fn columns_are_checked() {
    let table = table();
    assert_eq!(
        table.column::<f32>("f64").expect_err("another type").to_string(),
        "column f64 holds f64, expected f32"
    );
    assert_eq!(
        table.column::<f64>("f64?").expect_err("a missing value").to_string(),
        "column f64? has no value in row 1"
    );
    assert_eq!(
        table.numbers("text").expect_err("text").to_string(),
        "column text holds text, expected numbers"
    );
    let numbers = table.numbers("f64?").expect("numbers");
    assert!(numbers[0] == 1.0 && numbers[1].is_nan() && numbers[2] == 3.0);
    assert_eq!(table.numbers("bool").expect("numbers"), [1.0, 0.0, 1.0]);
}

#[test]
fn damaged_files_are_named() {
    let (_directory, path) = path();
    assert!(matches!(read_parquet(&path), Err(TableError::File(_))));
    table().write_parquet(&path).expect("written");
    let whole = std::fs::read(&path).expect("readable");
    for bytes in [&whole[..whole.len() - 9], &b"time,a\n1,2\n"[..], &[]] {
        std::fs::write(&path, bytes).expect("written");
        let error = read_parquet(&path).expect_err("damaged").to_string();
        assert!(error.contains("table.parquet is not a readable Parquet file"), "{error}");
    }
}

#[test]
fn a_log_keeps_missing_values_apart() {
    let (_directory, path) = path();
    let timestamps: Vec<Timestamp> =
        (0..3).map(|second| Timestamp::from_micros(second * 1_000_000)).collect();
    let channels = [("PIT300", vec![1.0, f32::NAN, 3.0]), ("TIT101", vec![4.0, 5.0, 6.0])];
    write_log(&path, &timestamps, &channels).expect("written");
    let log = read_parquet(&path).expect("readable");
    assert_eq!(log.column::<Timestamp>("timestamp").expect("times"), timestamps);
    assert_eq!(log.optional::<f32>("PIT300").expect("values"), [Some(1.0), None, Some(3.0)]);
    assert_eq!(log.column::<f32>("TIT101").expect("values"), [4.0, 5.0, 6.0]);
}
