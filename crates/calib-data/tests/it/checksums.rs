//! Tests of pages with wrong checksums. The files are from pyarrow (`scripts/golden/parquet_checksums.py`).

use std::{fs, ops::Range, path::Path};

use calib_core::Silent;
use calib_data::{
    DataConfig, PreprocessConfig, load,
    table::{Table, read_parquet},
};

/// Files in which every page has a checksum.
const CHECKED: [&str; 3] = ["crc.parquet", "crc-v2.parquet", "gzip.parquet"];

/// A file with partial checksums. Levels of v2 pages are not compressed, nor are pages that compression would not
/// shorten: gzip's checksum does not cover them.
const HALF_CHECKED: &str = "gzip-v2.parquet";

fn original(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/checked");
    fs::read(folder.join(name)).expect("readable")
}

/// Returns the range of the pages, between the magic bytes and the footer.
fn pages(file: &[u8]) -> Range<usize> {
    let footer = &file[file.len() - 8..file.len() - 4];
    let length = u32::from_le_bytes(footer.try_into().expect("four bytes")) as usize;
    4..file.len() - 8 - length
}

fn bits(table: &Table) -> Vec<Option<u64>> {
    let wide = table.optional::<f64>("P").expect("numbers").into_iter();
    let wide = wide.map(|value| value.map(f64::to_bits));
    let narrow = table.optional::<f32>("Q").expect("numbers").into_iter();
    let narrow = narrow.map(|value| value.map(|value| u64::from(value.to_bits())));
    wide.chain(narrow).collect()
}

#[test]
fn whole_files_are_read() {
    for name in CHECKED.into_iter().chain([HALF_CHECKED]) {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join(name);
        fs::write(&path, original(name)).expect("written");
        assert_eq!(read_parquet(&path).expect(name).rows(), 120);
        let data = DataConfig { train_fraction: 1.0, ..DataConfig::at(path.as_path()) };
        let dataset = load(&data, &PreprocessConfig::default(), &Silent).expect(name);
        assert_eq!(dataset.train.rows(), 120);
    }
}

#[test]
fn damage_is_never_read_as_other_values() {
    for name in CHECKED {
        let whole = original(name);
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join(name);
        fs::write(&path, &whole).expect("written");
        let expected = bits(&read_parquet(&path).expect("whole"));
        let mut refused = 0;
        let mut silent = Vec::new();
        for place in pages(&whole) {
            let mut other = whole.clone();
            other[place] ^= 1 << (place % 8);
            fs::write(&path, &other).expect("written");
            match read_parquet(&path) {
                Ok(table) if bits(&table) != expected => silent.push(place),
                Ok(_) => {}
                Err(_) => refused += 1,
            }
        }
        assert!(silent.is_empty(), "{name}: bytes {silent:?}");
        assert!(2 * refused > pages(&whole).len(), "{name}: {refused} refused");
    }
}

#[test]
fn a_log_with_a_damaged_page_is_refused_with_its_place() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("a.parquet");
    let mut damaged = original("crc.parquet");
    let last = pages(&damaged).end - 3;
    damaged[last] ^= 0x10;
    fs::write(&path, damaged).expect("written");
    let error = load(&DataConfig::at(path.as_path()), &PreprocessConfig::default(), &Silent);
    let error = error.expect_err("damaged").to_string();
    let told = "column Q in row group 2 has a page whose CRC does not fit its content";
    assert!(error.contains(told) && error.contains("a.parquet"), "{error}");
}

/// Returns the extremes of the numbers, the number of missing ones, and the extremes of the integers.
fn extremes(table: &Table) -> (f64, f64, usize, Option<i64>, Option<i64>) {
    let numbers = table.optional::<f64>("P").expect("numbers");
    let there: Vec<f64> =
        numbers.iter().flatten().copied().filter(|value| !value.is_nan()).collect();
    let low = there.iter().copied().fold(f64::INFINITY, f64::min);
    let high = there.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let integers = table.column::<i64>("Q").expect("integers");
    (
        low,
        high,
        numbers.len() - there.len(),
        integers.iter().min().copied(),
        integers.iter().max().copied(),
    )
}

/// No page has a checksum: only the statistics in the footer can show damage.
#[test]
fn what_the_footer_contradicts_is_refused() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("a.parquet");
    let numbers: Vec<Option<f64>> =
        (0..300).map(|row| (row % 9 > 0).then(|| f64::from(row).sqrt())).collect();
    let words = (0..300).map(|row| ["auto", "hand", "off"][row % 3].to_owned()).collect::<Vec<_>>();
    let times = (0..300)
        .map(|row| calib_core::Timestamp::from_micros(row * 60_000_000))
        .collect::<Vec<_>>();
    let table = Table::new()
        .with("timestamp", times)
        .with_optional("P", numbers)
        .with("Q", (0..300).map(|row| row * row - 900).collect::<Vec<i64>>())
        .with("mode", words);
    table.write_parquet(&path).expect("written");
    let whole = fs::read(&path).expect("readable");
    let expected = extremes(&read_parquet(&path).expect("whole"));
    let mut told = 0;
    for place in pages(&whole).step_by(3) {
        let mut other = whole.clone();
        other[place] ^= 1 << (place % 8);
        fs::write(&path, &other).expect("written");
        match read_parquet(&path) {
            Ok(table) => {
                let found = extremes(&table);
                // Footers do not describe NaN.
                assert!(found == expected || found.2 > expected.2, "byte {place}: {found:?}");
            }
            Err(error) => told += usize::from(error.to_string().contains("the footer says")),
        }
        let data = DataConfig { train_fraction: 1.0, ..DataConfig::at(path.as_path()) };
        if let Ok(dataset) = load(&data, &PreprocessConfig::default(), &Silent) {
            let channel = dataset.profile.channel("P").expect("there");
            let values = channel.values.clone().expect("some");
            assert!(values.min >= expected.0 && values.max <= expected.1, "byte {place}");
        }
    }
    assert!(told > 10, "{told}");
}
