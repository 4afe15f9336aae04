//! Odd logs as text, with a known truth. calib reads what was written, or refuses the log. Nothing panics, aborts, hangs
//! or takes more than four gibibytes.
//!
//!     CALIB_CASES=10000 CALIB_SEED=7 cargo test --release --test torture odd_texts -- --nocapture

use std::{collections::BTreeMap, fmt::Write as _, fs};

use calib_core::Timestamp;
use calib_data::table::read_parquet;

use crate::{
    campaign::{Draws, number},
    harness::Place,
    limits::{Ended, TriedCase, run, run_cases},
    texts::{Kind, Log},
};

/// Cases that run with the other tests.
const SLICE: u64 = 80;

/// Words with which a refusal may name the mistake.
const NAMES: [&str; 6] = ["logs", "log ", "data.", "channel", "rows", "--sensor"];

fn place(log: &Log) -> Place {
    let place = Place::new();
    fs::create_dir(place.path().join("logs")).expect("writable");
    for (name, content) in &log.files {
        fs::write(place.path().join("logs").join(name), content).expect("writable");
    }
    place
}

/// Returns the key that a study needs because the log does not contain the information.
fn told(kind: &Kind) -> Option<&'static str> {
    match (kind.times, kind.numbers) {
        ("spreadsheet" | "spreadsheet with comma", _) => Some("data.timestamp_unit=excel"),
        ("milliseconds of 1969", _) => Some("data.timestamp_unit=ms"),
        ("seconds of 1969", _) => Some("data.timestamp_unit=s"),
        ("month/day/year AM", _) => Some("data.timestamp_format=%m/%d/%Y %I:%M:%S %p"),
        (_, "thousands and comma in one file, thousands in the other" | "whole, then both") => {
            Some("data.decimal=,")
        }
        _ => None,
    }
}

/// Returns the difference between the imported log and the truth.
fn difference(place: &Place, kind: &Kind, log: &Log) -> Option<String> {
    let table = match read_parquet(&place.path().join("wide.parquet")) {
        Ok(table) => table,
        Err(error) => return Some(format!("the import cannot be read: {error}")),
    };
    let times = table.column::<Timestamp>("timestamp").expect("times").to_vec();
    let Some(name) = table.names().find(|name| !["timestamp", "Q", "Q1"].contains(name)) else {
        return Some("the channel is not there".to_owned());
    };
    let Ok(values) = table.optional::<f64>(name) else {
        return Some(format!("{name:?} holds no numbers"));
    };
    let truth: BTreeMap<i64, Option<f64>> =
        log.truth.iter().map(|written| (written.time, written.value)).collect();
    for (time, value) in times.iter().zip(values) {
        let at = time.as_micros();
        let Some(expected) = truth.get(&at) else {
            return Some(format!("nothing was recorded at {at}, which has {value:?}"));
        };
        let same = match (value, expected) {
            (Some(value), Some(expected)) => (value - expected).abs() <= 1e-9 * expected.abs(),
            (None, None) => true,
            _ => false,
        };
        if !same {
            return Some(format!("at {at} it is {value:?}, and {expected:?} was written"));
        }
    }
    // Rows of an hour that occurs twice may be left out.
    if !kind.times.starts_with("clock of a zone") && times.len() != truth.len() {
        return Some(format!("{} of {} rows are there", times.len(), truth.len()));
    }
    None
}

/// Returns the mistake in a proposed study.
fn injected(place: &Place) -> Option<String> {
    let text = place.read("study.toml");
    let study: toml::Table = match toml::from_str(&text) {
        Ok(study) => study,
        Err(error) => return Some(format!("the study is no TOML: {error}")),
    };
    let judged = study["evaluate"].as_table().map(toml::Table::len);
    if judged != Some(1) || study["seed"].as_integer() != Some(0) {
        return Some(format!("a name became a key: {text}"));
    }
    match run(place, &["inspect", "study.toml"], &NAMES) {
        Ended::Done => None,
        other => Some(format!("its study cannot be inspected: {other:?}")),
    }
}

fn case(kind: &Kind, log: &Log, draws: &mut Draws) -> (String, Ended) {
    let place = place(log);
    let mut sets: Vec<String> = log.sets.clone();
    sets.extend(told(kind).filter(|_| draws.below(2) == 0).map(str::to_owned));
    let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
    let args: &[&str] = match draws.below(12) {
        0 => &["init", "logs", "study.toml", "--within", "1s"],
        1 => &["inspect", "logs"],
        2 => &["inspect", "logs", "--json"],
        3 => &["inspect", "logs", "--set", "data.resample=last", "--set", "data.period_secs=7"],
        _ => &["import", "logs", "wide.parquet"],
    };
    let args = [args, &sets].concat();
    let ended = run(&place, &args, &NAMES);
    let wrong = match (&ended, args[0]) {
        (Ended::Done, "import") => difference(&place, kind, log),
        (Ended::Done, "init") => injected(&place),
        _ => None,
    };
    (args.join(" "), wrong.map_or(ended, Ended::Wrong))
}

#[test]
fn odd_texts() {
    run_cases("odd texts", number("CALIB_CASES", SLICE), 1 << 29, |_, draws| {
        let kind = Kind::drawn(draws);
        let log = Log::of(&kind, draws);
        let (args, ended) = case(&kind, &log, draws);
        let told = format!("{kind:?}, calib {args}");
        TriedCase { kind: format!("odd texts: {}", kind.shape), told, ended }
    });
}

/// Returns arbitrary bytes in files with the names of logs.
fn noise(draws: &mut Draws) -> Vec<u8> {
    let length = draws.below(30_000);
    let alphabet: &[u8] = match draws.below(5) {
        0 => &[],
        1 => b",;\t|\"\n\r.:-T0123456789",
        2 => b"0123456789:/ \n\xc3\x9f\xc2\xa0,",
        3 => b"#datype,group\nle_tim\"fault:RFC39 \r",
        _ => b"time,a\n2024-03-01 06:00:00,1.5\xff",
    };
    let mut bytes: Vec<u8> = (0..length)
        .map(|_| match alphabet {
            [] => 1 + draws.below(255) as u8,
            some => *draws.of(some),
        })
        .collect();
    if draws.below(3) == 0 {
        let begins: [&[u8]; 6] = [
            b"time,a\n",
            b"time;tag;value\n",
            b"\xEF\xBB\xBF",
            b"#datatype,string\n",
            b"\x28\xB5\x2F\xFD",
            b"\x1f\x8b",
        ];
        bytes.splice(0..0, draws.of(&begins).iter().copied());
    }
    bytes
}

#[test]
fn noise_by_the_names_of_logs() {
    run_cases("noise", number("CALIB_CASES", SLICE), 1 << 28, |_, draws| {
        let place = Place::new();
        let name =
            *draws.of(&["logs.csv", "logs.tsv", "logs.csv.gz", "logs.csv.zst", "logs.parquet"]);
        fs::write(place.path().join(name), noise(draws)).expect("writable");
        let args: &[&str] = match draws.below(3) {
            0 => &["inspect", name],
            1 => &["import", name, "wide.parquet"],
            _ => &["init", name, "study.toml", "--within", "1s"],
        };
        let told = format!("calib {}", args.join(" "));
        TriedCase { kind: "noise".to_owned(), told, ended: run(&place, args, &NAMES) }
    });
}

/// Logs that are small on disk and large in memory.
const LARGE: [&str; 8] = [
    "InfluxDB with other keys in every table",
    "InfluxDB with many tables",
    "many tags at one time",
    "many tags at times of their own",
    "many columns",
    "long words",
    "long words of many columns",
    "many files of one tag",
];

/// Returns the content of the files of such a log, each perhaps repeated.
fn large(kind: &str, draws: &mut Draws) -> Vec<(String, Vec<u8>)> {
    let mut text = String::new();
    match kind {
        "InfluxDB with other keys in every table" | "InfluxDB with many tables" => {
            let same = kind.ends_with("many tables");
            for table in 0..2_000 + draws.below(18_000) {
                let key = if same { "tag".to_owned() } else { format!("key{table}") };
                let at = time(draws.below(10_000)).replace(' ', "T");
                write!(text, "#group,false,false,false,false,true\n#datatype,string,long,dateTime:RFC3339,double,string\n#default,_result,,,,\n,result,table,_time,_value,{key}\n,,{table},{at}Z,1.5,t{table}\n\n").expect("memory");
            }
        }
        "many tags at one time" | "many tags at times of their own" => {
            let apart = kind.ends_with("their own");
            text.push_str("time,tag,value\n");
            let tags = 2_000 + draws.below(28_000);
            for row in 0..4 {
                for tag in 0..tags {
                    let second = if apart { row * tags + tag } else { row * 60 };
                    writeln!(text, "{},t{tag},{}.5", time(second), (tag * row) % 13)
                        .expect("memory");
                }
            }
        }
        "many columns" => {
            let columns = 5_000 + draws.below(60_000);
            text.push_str("time");
            (0..columns).for_each(|column| write!(text, ",c{column}").expect("memory"));
            for row in 0..8 {
                write!(text, "\n{}", time(row * 60)).expect("memory");
                (0..columns)
                    .for_each(|column| write!(text, ",{}.5", (column * row) % 17).expect("memory"));
            }
        }
        "many files of one tag" => {
            return (0..300 + draws.below(700))
                .map(|file| {
                    let rows: Vec<String> =
                        (0..5).map(|row| format!("{},{row}.5\n", time(row * 60))).collect();
                    let rows = rows.concat();
                    (format!("t{file}.csv"), format!("time,value\n{rows}").into_bytes())
                })
                .collect();
        }
        words => {
            let columns = if words.ends_with("columns") { 40 } else { 2 };
            text.push_str("time");
            (0..columns).for_each(|column| write!(text, ",c{column}").expect("memory"));
            let length = 1 + draws.below(8_192);
            for row in 0..200_000_000 / (length * columns) / 4 {
                write!(text, "\n{}", time(row)).expect("memory");
                (0..columns).for_each(|column| {
                    write!(text, ",{:x>1$}", row * columns + column, length).expect("memory");
                });
            }
            text.push('\n');
            let packed = zstd::encode_all(text.as_bytes(), 1).expect("memory");
            return vec![("a.csv.zst".to_owned(), packed)];
        }
    }
    vec![("a.csv".to_owned(), text.into_bytes())]
}

/// Formats a second of March as a time.
fn time(second: usize) -> String {
    format!(
        "2024-03-{:02} {:02}:{:02}:{:02}",
        1 + second / 86_400,
        second / 3_600 % 24,
        second / 60 % 60,
        second % 60
    )
}

#[test]
fn small_logs_that_become_large() {
    let cases = number("CALIB_CASES", LARGE.len() as u64 * 50) / 50;
    run_cases("small logs that become large", cases, 3 << 28, |case, draws| {
        let kind = LARGE[case % LARGE.len()];
        let files = large(kind, draws);
        let log = Log { files, truth: Vec::new(), never: 0, sets: Vec::new() };
        let place = place(&log);
        let args: &[&str] = match draws.below(5) {
            0 => &["import", "logs", "wide.parquet"],
            1 => &["inspect", "logs", "--json"],
            2 => &[
                "inspect",
                "logs",
                "--set=data.resample=last",
                "--set=data.period_secs=0.001",
                "--set=data.max_age_secs=1e7",
            ],
            3 => &["init", "logs", "study.toml", "--within", "1s"],
            _ => &["inspect", "logs"],
        };
        let told = format!("{kind}, calib {}", args.join(" "));
        TriedCase { kind: kind.to_owned(), told, ended: run(&place, args, &NAMES) }
    });
}
