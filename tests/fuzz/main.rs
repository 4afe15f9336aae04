//! Parsers on arbitrary bytes: they always return. For a damaged file they return an error, or the written content.
//!
//! 256 cases per parser run with the other tests. To run more: `PROPTEST_CASES=1000000 cargo test --release --test fuzz`.
//! `tests/torture/hostile.rs` tests what only the command line does with parsed content: imports, and manifests and units with
//! other values under a valid fingerprint.
//!
//! A program of its own: `scripts/torture.sh` runs it by this name, with `PROPTEST_CASES` for all of its properties.

use std::{fs, path::Path};

use calib_data::{
    DataConfig, Declared, Moment, PreprocessConfig, format_time, inspect, most_cells,
    number_columns, parse_time,
    table::{Table, parquet_names, read_parquet, read_parquet_list},
};
use calib_files::{
    Tensor, Tensors, map_npy, read_array, read_sealed_json, read_sealed_tensors, read_tensors,
    write_npy, write_sealed_json, write_tensors,
};
use calib_study::{Job, Protocol, Request, Scope, of_data};
use proptest::{collection::vec, prelude::*, sample::Index};

/// One change to some bytes.
#[derive(Clone, Debug)]
enum Edit {
    Set(Index, u8),
    Flip(Index, u8),
    Cut(Index),
    Insert(Index, Vec<u8>),
    /// Overwrites four bytes, which may be a length or a count.
    Number(Index, u32),
    Copy(Index, Index),
}

fn edits() -> impl Strategy<Value = Vec<Edit>> {
    let place = any::<Index>;
    let number =
        prop_oneof![Just(u32::MAX), Just(0), Just(1 << 31), Just(0x7fff_ffff), any::<u32>()];
    vec(
        prop_oneof![
            (place(), any::<u8>()).prop_map(|(place, byte)| Edit::Set(place, byte)),
            (place(), 0..8_u8).prop_map(|(place, bit)| Edit::Flip(place, bit)),
            place().prop_map(Edit::Cut),
            (place(), vec(any::<u8>(), 1..20))
                .prop_map(|(place, bytes)| Edit::Insert(place, bytes)),
            (place(), number).prop_map(|(place, number)| Edit::Number(place, number)),
            (place(), place()).prop_map(|(from, to)| Edit::Copy(from, to)),
        ],
        1..6,
    )
}

fn edited(whole: &[u8], edits: &[Edit]) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for edit in edits {
        if bytes.is_empty() {
            return bytes;
        }
        let length = bytes.len();
        match edit {
            Edit::Set(place, byte) => bytes[place.index(length)] = *byte,
            Edit::Flip(place, bit) => bytes[place.index(length)] ^= 1 << bit,
            Edit::Cut(place) => bytes.truncate(place.index(length)),
            Edit::Insert(place, more) => {
                let place = place.index(length);
                bytes.splice(place..place, more.iter().copied());
            }
            Edit::Number(place, number) => {
                let place = place.index(length);
                let end = (place + 4).min(length);
                bytes[place..end].copy_from_slice(&number.to_le_bytes()[..end - place]);
            }
            Edit::Copy(from, to) => {
                let from = from.index(length);
                let to = to.index(length);
                let count = 16.min(length - from.max(to));
                bytes.copy_within(from..from + count, to);
            }
        }
    }
    bytes
}

/// A folder with one file.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a directory"))
    }

    fn file(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    fn with(name: &str, bytes: &[u8]) -> (Self, std::path::PathBuf) {
        let place = Self::new();
        let path = place.file(name);
        fs::write(&path, bytes).expect("writable");
        (place, path)
    }
}

/// Returns the bytes that `write` writes.
fn written(write: impl FnOnce(&Path)) -> Vec<u8> {
    let place = Place::new();
    let path = place.file("whole");
    write(&path);
    fs::read(path).expect("readable")
}

/// Returns the bytes of files of the corpus: shapes from real files, or ones that caused errors.
fn corpus(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus").join(name);
    let mut paths: Vec<_> =
        fs::read_dir(&folder).expect("a corpus").flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("readable")).collect()
}

/// Returns logs as text in the forms of other programs.
fn logs_as_text() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/calib-data/tests/it/formats");
    let mut paths: Vec<_> = fs::read_dir(&folder)
        .expect("the formats")
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_file() && path.extension().is_some_and(|ending| ending != "parquet"))
        .collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("readable")).collect()
}

/// Reads a log in all ways that calib reads text.
fn read_text(path: &Path) {
    for time_zone in [None, Some("Europe/Paris".to_owned())] {
        let data = DataConfig { time_zone, memory: Some(1 << 30), ..DataConfig::at(path) };
        let _ = inspect(&data, &PreprocessConfig::default(), &calib_core::Silent);
    }
    let data = DataConfig { memory: Some(1 << 30), ..DataConfig::at(path) };
    let _ = calib_data::sketch(&data, &calib_core::Silent);
    let written = path.with_extension("parquet");
    let _ = calib_data::import(
        &data,
        &written,
        calib_files::ExistingFile::Replaced,
        &calib_core::Silent,
    );
    let _ = calib_data::read_tags(path);
}

fn tensors() -> Tensors {
    let tensors = vec![
        Tensor {
            name: "a".to_owned(),
            shape: vec![2, 3],
            values: vec![1.0, -2.0, 0.5, 3e38, -0.0, 7.0],
        },
        Tensor::flat("b", vec![1.0; 9]),
    ];
    Tensors { tensors, metadata: [("key".to_owned(), "value \"".to_owned())].into() }
}

fn log() -> Vec<u8> {
    written(|path| {
        let times: Vec<_> =
            (0..60).map(|row| calib_core::Timestamp::from_micros(row * 60_000_000)).collect();
        let table = Table::new()
            .with("timestamp", times)
            .with("P", (0..60).map(|row| f64::from(row).sin()).collect::<Vec<f64>>())
            .with(
                "mode",
                (0..60)
                    .map(|row| if row % 7 == 0 { "on" } else { "off" }.to_owned())
                    .collect::<Vec<String>>(),
            );
        table.write_parquet(path).expect("written");
    })
}

proptest! {
    #[test]
    fn arrays(edits in edits(), which in any::<Index>()) {
        let mut whole = corpus("npy");
        whole.push(written(|path| write_npy(path, &[1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0], 2, 3).expect("written")));
        let (_place, path) = Place::with("a.npy", &edited(&whole[which.index(whole.len())], &edits));
        if let Ok(array) = read_array(&path) {
            prop_assert_eq!(array.values.len(), array.shape.iter().product::<usize>());
        }
        if let Ok(mapped) = map_npy::<f32>(&path) {
            prop_assert_eq!(mapped.as_slice().len(), mapped.rows() * mapped.columns());
        }
    }

    #[test]
    fn series(edits in edits(), which in any::<Index>()) {
        let whole = corpus("csv");
        let text = edited(&whole[which.index(whole.len())], &edits);
        if let Ok(columns) = number_columns(&text) {
            let lengths: Vec<usize> = columns.iter().flat_map(|column| &column.numbers).map(Vec::len).collect();
            prop_assert!(lengths.windows(2).all(|pair| pair[0] == pair[1]));
            prop_assert!(lengths.iter().sum::<usize>() <= most_cells(&text));
        }
    }

    #[test]
    fn weights(edits in edits()) {
        let whole = written(|path| write_tensors(path, &tensors()).expect("written"));
        let bytes = edited(&whole, &edits);
        let (_place, path) = Place::with("a.safetensors", &bytes);
        if let Ok(read) = read_tensors(&path) {
            for tensor in &read.tensors {
                prop_assert_eq!(tensor.values.len(), tensor.shape.iter().product::<usize>());
            }
        }
        if let Ok(read) = read_sealed_tensors(&path) {
            prop_assert_eq!(read, tensors());
        }
    }

    #[test]
    fn sealed(edits in edits()) {
        let value = serde_json::json!({"format": 3, "files": {"a": [1, 2.5, null]}, "name": "温\"\n"});
        let whole = written(|path| write_sealed_json(path, &value).expect("written"));
        let (_place, path) = Place::with("manifest.json", &edited(&whole, &edits));
        if let Ok(read) = read_sealed_json::<serde_json::Value>(&path) {
            prop_assert_eq!(read, value);
        }
    }

    #[test]
    fn logs(edits in edits(), at_end in any::<bool>()) {
        let whole = log();
        // The footer contains most of what can be wrong.
        let footer = whole.len() - 8 - u32::from_le_bytes(
            whole[whole.len() - 8..whole.len() - 4].try_into().expect("four bytes")) as usize;
        let bytes = if at_end {
            [&whole[..footer], &edited(&whole[footer..whole.len() - 8], &edits), &whole[whole.len() - 8..]].concat()
        } else {
            edited(&whole, &edits)
        };
        let (place, path) = Place::with("a.parquet", &bytes);
        let data = DataConfig::at(place.0.path());
        let _ = read_parquet(&path);
        let _ = parquet_names(&path);
        let _ = read_parquet_list(&path, "P");
        // A file that declares impossible sizes is refused before it is read.
        if Declared::of(&data).is_ok_and(|declared| declared.least_bytes < 1 << 30) {
            let _ = inspect(&data, &PreprocessConfig::default(), &calib_core::Silent);
        }
    }

    #[test]
    fn texts(edits in edits(), which in any::<Index>()) {
        let whole = logs_as_text();
        let (_place, path) = Place::with("a.csv", &edited(&whole[which.index(whole.len())], &edits));
        read_text(&path);
    }

    #[test]
    fn columns_of_times(
        cells in vec("\\PC{0,12}|[-+0-9TtZz:. /,apmAPM]{0,24}|[0-9]{1,18}|\\PC{0,3}[0-9]{1,2}:[0-9]{2}", 1..6),
        name in "\\PC{0,8}",
    ) {
        let rows: Vec<String> = cells
            .iter()
            .map(|cell| format!("\"{}\",1\n", cell.replace('"', "\"\"")))
            .collect();
        let rows = rows.concat();
        let text = format!("time,\"{}\"\n{rows}", name.replace('"', "\"\""));
        let (_place, path) = Place::with("a.csv", text.as_bytes());
        read_text(&path);
    }

    #[test]
    fn times(text in "[-+0-9TtZz:. /a-e\\[\\]]{0,40}|\\PC{0,12}") {
        if let Some(time) = parse_time(&text) {
            prop_assert_eq!(parse_time(&format_time(time)), Some(time), "{}", text);
        }
        let _ = Moment::new(&text);
    }

    #[test]
    fn studies(edits in edits(), which in any::<Index>()) {
        let whole = corpus("toml");
        let bytes = edited(&whole[which.index(whole.len())], &edits);
        let (_place, path) = Place::with("study.toml", &bytes);
        if let Ok(drawn) = Protocol::find(&path) {
            prop_assert!(drawn.is_none() || bytes.windows(8).any(|part| part == b"validity"));
        }
        for profile in [None, Some("small".to_owned())] {
            let Ok(job) = Job::resolve(Request { profile, ..Request::new(&path) }) else { continue };
            // A study that is valid as a whole may be invalid with one of its models.
            if let Ok(models) = job.models() {
                prop_assert!(!models.is_empty());
            }
            let _ = job.parts(Scope::Rollouts);
        }
    }

    #[test]
    fn overrides(
        key in "(agent|sweep|model|rollout|preprocess|data|representation|evaluate|pretrain|dynamics|simulate)\
                \\.(gamma|steps|grid|members|start|traces|train|kind|rule|epochs|days)(\\.[a-z_]{0,12})?",
        value in "[-+0-9a-z_\"'\\[\\]{}=,. :eE]{0,40}|\\PC{0,20}",
    ) {
        let _ = of_data(Path::new("logs"), &[format!("{key}={value}")]);
        let _ = of_data(Path::new("logs"), &[format!("{value}={key}"), value]);
    }
}
