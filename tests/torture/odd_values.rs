//! Odd values: every key in docs/study.md, set to values that make no sense.
//!
//!     CALIB_CASES=10000 CALIB_SEED=7 cargo test --release --test torture odd_ -- --nocapture

use crate::{
    campaign::{Draws, neighbours, number},
    faults::copied,
    harness::Place,
    limits::{Ended, TriedCase, run, run_cases},
};

/// Cases that run with the other tests.
const SLICE: u64 = 60;
/// Document that lists the keys.
const DOCUMENT: &str = include_str!("../../docs/study.md");

/// Values that are small enough to run with.
const VALUES: [&str; 34] = [
    "-1",
    "0",
    "1",
    "2",
    "3",
    "-0.0",
    "0.5",
    "0.999999",
    "1.0000001",
    "5e-324",
    "1e-310",
    "1e-45",
    "1e38",
    "1e39",
    "1e155",
    "1e300",
    "1.7976931348623157e308",
    "nan",
    "-nan",
    "inf",
    "-inf",
    "true",
    "\"\"",
    "\"x\"",
    "\"../../up\"",
    "\"\\u001b[2J\"",
    "[]",
    "[1, 1]",
    "[nan]",
    "[\"PIT300\"]",
    "{}",
    "{ start = 2022-11-01, end = 2022-11-01T06:00:00 }",
    "2022-11-01T01:00:00Z",
    "{ from = 1e-3, to = 1e-1, count = 2 }",
];

/// Values that would take for ever to run: they are only planned.
const LARGE: [&str; 12] = [
    "100",
    "1000000",
    "100000000",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "1e18",
    "{ from = 1, to = 1e9, step = 1 }",
    "{ from = 0, to = 1, count = 100000000 }",
    "{ start = 0001-01-01, end = 9999-12-31 }",
    "{ from = 1e-300, to = 1e300, per_decade = 1000000 }",
];

/// Returns section and key, as they are typed.
fn keys() -> Vec<String> {
    let mut section = String::new();
    let mut keys = Vec::new();
    for line in DOCUMENT.lines() {
        if let Some(title) = line.strip_prefix("### ") {
            section = match title.trim_matches(['[', ']']) {
                "Top level" => String::new(),
                name => format!("{name}.").replace("NAME", "near"),
            };
        } else if line.starts_with("## ") && line.contains("protocol") {
            break;
        } else if let Some(rest) = line.strip_prefix("| `")
            && let Some((key, _)) = rest.split_once('`')
            && key.chars().all(|letter| {
                letter.is_ascii_lowercase() || letter == '_' || letter.is_ascii_digit()
            })
        {
            keys.push(format!("{section}{key}"));
        }
    }
    keys.extend(
        [
            "sweep.grid.learning_rate",
            "sweep.grid.gamma",
            "sweep.grid.batch_size",
            "sweep.grid.traces",
        ]
        .map(str::to_owned),
    );
    keys
}

/// Commands for any value (plans), and for values that are not large.
const PLANS: [&[&str]; 4] = [
    &["run", "study.toml", "--dry-run"],
    &["sweep", "study.toml", "--dry-run"],
    &["build-model", "study.toml", "--dry-run"],
    &["inspect", "study.toml"],
];
const WORK: [&[&str]; 3] = [
    &["run", "study.toml"],
    &[
        "run",
        "study.toml",
        "--set=model.kind=nn",
        "--set=dynamics.epochs=1",
        "--set=dynamics.hidden_units=4",
    ],
    &[
        "run",
        "study.toml",
        "--set=agent.value_function=mlp",
        "--set=agent.hidden_units=4",
        "--set=pretrain.epochs=1",
    ],
];

/// Commands for keys of `[control]`, in a study with this section.
const CONTROL: [&[&str]; 4] = [
    &["control", "study.toml", "--dry-run"],
    &["inspect", "study.toml"],
    &["control", "study.toml", "--set", "control.steps=60", "--set", "control.runs=2"],
    &["control", "study.toml"],
];
/// Commands for keys of `[data]`, on a log as text.
const TEXT: [&[&str]; 2] = [&["inspect", "log.csv"], &["import", "log.csv", "wide.parquet"]];

/// Places in which the keys are set.
struct Bases {
    /// Place after `run` without the sweep, with a log as text.
    plain: Place,
    /// Place with a log of decisions.
    control: Place,
}

impl Bases {
    fn new() -> Self {
        let plain = neighbours();
        plain.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
        std::fs::remove_dir_all(plain.path().join("study-results/sweep")).expect("swept");
        let rows: String = (0..120)
            .flat_map(|row| {
                let time = format!("2024-03-01 06:{:02}:{:02}", row / 60, row % 60);
                ["PIT300", "TIT100"].map(|tag| format!("{time};{tag};{},5;192\n", row % 7))
            })
            .collect();
        plain.write("log.csv", &format!("time;tag;value;quality\n{rows}"));
        let control = Place::new();
        let simulate = ["simulate", ".", "--task", "puddle-world", "--policy", "random"];
        control.calib(&[&simulate[..], &["--transitions", "600"]].concat()).succeeds();
        let text = control.read("study.toml");
        let small = text.lines().map(|line| match line.split_once(" = ") {
            Some(("steps", _)) => "steps = 300\n".to_owned(),
            _ => format!("{line}\n"),
        });
        control.write("study.toml", &small.collect::<String>());
        Self { plain, control }
    }

    fn case(&self, key: &str, draws: &mut Draws) -> (String, Ended) {
        let plan = draws.below(3) > 0;
        let value =
            if plan && draws.below(3) == 0 { *draws.of(&LARGE) } else { *draws.of(&VALUES) };
        let (base, args) = match key.split('.').next() {
            Some("control") if plan => (&self.control, *draws.of(&CONTROL[..2])),
            Some("control") => (&self.control, *draws.of(&CONTROL)),
            Some("data") if draws.below(2) == 0 => (&self.plain, *draws.of(&TEXT)),
            _ if plan => (&self.plain, *draws.of(&PLANS)),
            _ => (&self.plain, *draws.of(&WORK)),
        };
        let set = format!("{key}={value}");
        let args = [args, &["--set", &set]].concat();
        let last = key.rsplit('.').next().unwrap_or(key);
        // A changed plant is not an invalid value.
        let names = [last, "[simulate]: data holds another simulation"];
        (args.join(" "), run(&copied(base), &args, &names))
    }
}

#[test]
fn odd_values() {
    let bases = Bases::new();
    let keys = keys();
    assert!(keys.len() > 120, "{keys:?}");
    run_cases("odd values", number("CALIB_CASES", SLICE), 1 << 31, |_, draws| {
        let key = draws.of(&keys);
        let (args, ended) = bases.case(key, draws);
        let section = key.split_once('.').map_or("top", |(section, _)| section);
        let told = format!("calib {args}");
        TriedCase { kind: format!("odd values: [{section}]"), told, ended }
    });
}
