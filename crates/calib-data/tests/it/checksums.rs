//! Pages whose checksums do not fit. The files are from pyarrow (`scripts/golden/parquet_checksums.py`).

use std::{fs, ops::Range, path::Path};

use calib_core::Silent;
use calib_data::{
    DataConfig, PreprocessConfig, load,
    table::{Table, read_parquet},
};

/// All of whose pages carry a checksum.
const CHECKED: [&str; 3] = ["crc.parquet", "crc-v2.parquet", "gzip.parquet"];

/// Levels of v2 pages are not packed, nor is what packing would not shorten: gzip's checksum does not cover them.
const HALF_CHECKED: &str = "gzip-v2.parquet";

fn original(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/checked");
    fs::read(folder.join(name)).expect("readable")
}

/// The pages, between the magic bytes and the footer.
fn pages(file: &[u8]) -> Range<usize> {
    let footer = &file[file.len() - 8..file.len() - 4];
    let length = u32::from_le_bytes(footer.try_into().expect("four bytes")) as usize;
    4..file.len() - 8 - length
}

fn bits(table: &Table) -> Vec<Option<u64>> {
    let of = |name: &str| table.optional::<f64>(name).expect("numbers");
    let narrow = table.optional::<f32>("Q").expect("numbers").into_iter();
    let narrow = narrow.map(|value| value.map(|value| u64::from(value.to_bits())));
    of("P").into_iter().map(|value| value.map(f64::to_bits)).chain(narrow).collect()
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
        let (mut refused, mut silent) = (0, Vec::new());
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
