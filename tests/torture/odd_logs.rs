//! Odd logs: every shape of column, content, time and file, read by the commands that read logs. Nothing panics, aborts,
//! hangs or takes more than four gibibytes. Each refusal names the file and a remedy.
//!
//!     CALIB_CASES=10000 CALIB_SEED=7 cargo test --release --test torture odd_ -- --nocapture

use std::fs;

use crate::{
    campaign::{Draws, STUDY, number},
    harness::Place,
    limits::{Ended, TriedCase, run, run_cases},
    shapes::{FILES, Shape},
    times::TIMES,
    types::{CONTENTS, KINDS},
};

/// Cases that run with the other tests.
const SLICE: u64 = 60;

/// Commands that read a log.
const COMMANDS: [&[&str]; 8] = [
    &["inspect", "logs"],
    &["inspect", "logs", "--json"],
    &["inspect", "study.toml", "--all"],
    &["build-model", "study.toml", "--dry-run"],
    &["build-model", "study.toml"],
    &["run", "study.toml"],
    &[
        "run",
        "study.toml",
        "--set=preprocess.missing=\"linear\"",
        "--set=preprocess.normalise=\"standard\"",
    ],
    &["dtw", "logs/a.parquet:P", "series.csv"],
];

/// Returns one log per shape alone, then randomly drawn ones.
fn shape(case: usize, draws: &mut Draws) -> Shape {
    let plain = Shape { kind: "f64", content: "wave", times: "us", files: "one" };
    let kinds = KINDS.len();
    let contents = CONTENTS.len();
    let times = TIMES.len();
    let files = FILES.len();
    match case {
        case if case < kinds => Shape { kind: KINDS[case], ..plain },
        case if case < kinds + contents => Shape { content: CONTENTS[case - kinds], ..plain },
        case if case < kinds + contents + times => {
            Shape { times: TIMES[case - kinds - contents], ..plain }
        }
        case if case < kinds + contents + times + files => {
            Shape { files: FILES[case - kinds - contents - times], ..plain }
        }
        _ => Shape::drawn(draws),
    }
}

fn place(shape: &Shape, draws: &mut Draws) -> Place {
    let place = Place::new();
    place
        .write("study.toml", &STUDY.replace("\"PIT300\"", "\"P\"").replace("\"data\"", "\"logs\""));
    place.write("series.csv", "1\n2\n3\n4\n");
    fs::create_dir(place.path().join("logs")).expect("writable");
    for (name, content) in shape.files(draws) {
        let path = place.path().join("logs").join(name);
        fs::create_dir_all(path.parent().expect("below logs")).expect("writable");
        if let Some(content) = content {
            fs::write(path, content).expect("writable");
        }
    }
    place
}

#[test]
fn odd_logs() {
    let cases = number("CALIB_CASES", SLICE);
    // With the other tests, the single shapes are also drawn at random.
    let shapes = KINDS.len() + CONTENTS.len() + TIMES.len() + FILES.len();
    run_cases("odd logs", cases, 0, |case, draws| {
        let which = if cases < shapes as u64 { draws.below(2 * shapes) } else { case };
        let shape = shape(which, draws);
        let place = place(&shape, draws);
        let args = *draws.of(&COMMANDS);
        let ended = run(
            &place,
            args,
            &[
                "log",
                "data.",
                "preprocess.",
                "sweep.sensors",
                "query",
                "channel",
                "held-out",
                "values",
            ],
        );
        let kind = if shape.files != "one" {
            "files"
        } else if shape.times != "us" {
            "times"
        } else if shape.kind != "f64" {
            "types"
        } else {
            "contents"
        };
        let told = format!("{shape:?}, calib {}", args.join(" "));
        TriedCase { kind: format!("odd logs: {kind}"), told, ended }
    });
}

/// The reaction to an address space that is too small for the log.
#[test]
fn a_log_of_a_hundred_million_equal_rows_is_refused() {
    let shape = Shape { kind: "f64", content: "wave", times: "us", files: "runs of 10^8 rows" };
    let place = place(&shape, &mut Draws(1));
    let small = fs::metadata(place.path().join("logs/a.parquet")).expect("there").len();
    assert!(small < 1000, "{small} bytes");
    let series = "logs/a.parquet:P";
    for args in [
        &["inspect", "logs"][..],
        &["inspect", "study.toml"],
        &["build-model", "study.toml"],
        &["dtw", series, series],
    ] {
        let ended = run(&place, args, &["logs"]);
        let Ended::Refused(told) = &ended else { panic!("{args:?}: {ended:?}") };
        assert!(told.contains("of memory"), "{told}");
    }
}

/// The Parquet reader panics on some types that calib does not use.
#[test]
fn a_column_of_a_type_that_cannot_be_read_is_named() {
    for kind in ["map key", "struct", "list of lists"] {
        let shape = Shape { kind, content: "wave", times: "us", files: "one" };
        let place = place(&shape, &mut Draws(1));
        let ended = run(&place, &["dtw", "logs/a.parquet:P", "series.csv"], &["column P"]);
        assert!(matches!(ended, Ended::Refused(_)), "{kind}: {ended:?}");
    }
}
