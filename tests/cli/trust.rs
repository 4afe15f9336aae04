//! Nothing is lost, and nothing is silently wrong: damaged files, foreign files, names and numbers from outside.

use std::{fs, path::Path, time::SystemTime};

use calib_core::Timestamp;
use calib_data::table::{Table, read_parquet, write_log};
use calib_files::{read_json, write_sealed_json};
use serde_json::{Value, json};

use crate::harness::Place;

/// Returns a small plant with the shortest possible runs.
fn place() -> Place {
    let place = Place::with_study();
    place.edit_study("sensors = [\"PIT300\", \"TIT101\"]", "sensors = [\"PIT300\"]");
    place.edit_study("steps = 800", "steps = 240");
    place.edit_study("online_runs = 3", "online_runs = 1");
    place.edit_study("member_runs = 2", "member_runs = 1");
    place.edit_study("log_replay_runs = 2", "log_replay_runs = 1");
    place
}

#[test]
fn units_follow_from_the_content_of_the_model() {
    let place = place();
    place.run_steps(&["build-model", "sweep"]);
    let states = place.path().join("study-results/model/states.npy");
    let mut other = fs::read(&states).expect("readable");
    let middle = other.len() / 2;
    other[middle..middle + 4096].fill(0);
    fs::write(&states, other).expect("writable");
    for command in ["rollout", "sweep"] {
        let refused = place.calib(&[command, "study.toml", "--force"]).fails(2);
        assert!(refused.contains("states.npy is not what was written"), "{refused}");
    }
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.calib(&["sweep", "study.toml"]).succeeds_with(&["up to date"]);
}

#[test]
fn a_sweep_with_nothing_to_write_writes_nothing() {
    let place = place();
    place.run_steps(&["build-model", "sweep"]);
    let manifest = place.path().join("study-results/sweep/manifest.json");
    let (before, content) = (modified(&manifest), fs::read(&manifest).expect("readable"));
    // Not even a lock can be created.
    let lock = place.path().join("study-results/sweep/.lock");
    fs::remove_file(&lock).expect("removed");
    fs::create_dir(&lock).expect("made");
    place.calib(&["sweep", "study.toml"]).succeeds();
    assert_eq!((modified(&manifest), fs::read(&manifest).expect("readable")), (before, content));
    place.calib(&["sweep", "study.toml", "--force"]).fails_with(2, &[".lock"]);
    assert!(manifest.exists(), "what could not be begun is not given up");
}

/// Returns the time of the last write to a file.
fn modified(path: &Path) -> SystemTime {
    fs::metadata(path).expect("there").modified().expect("a time")
}

#[test]
fn damaged_one_step_errors_are_told_and_made_again() {
    let place = place();
    place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
    let whole = place.content("study-results");
    assert!(place.read("study-results/report.html").contains("One-step error"));
    for name in ["one_step.json", "one_step.parquet"] {
        let path = place.path().join("study-results/rollout").join(name);
        let mut bytes = fs::read(&path).expect("there");
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x10;
        fs::write(&path, bytes).expect("writable");
        let told = place.calib(&["evaluate", "study.toml"]).ends(&[0, 1]);
        let note = "the one-step errors in study-results/rollout were made with other settings, or are damaged";
        let report = place.read("study-results/report.html");
        assert!(told.contains(note) && report.contains("one-step errors in"), "{told}");
        place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
        assert!(place.content("study-results") == whole, "{name}");
    }
}

/// Counts the half-written files of calib in a folder.
fn half_written_in(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).expect("readable").flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with(".calib-")).count()
}

#[test]
fn what_a_kill_leaves_beside_a_file_of_the_user_goes_with_the_next_command() {
    let place = Place::new();
    place.simulate("data");
    place.write("mine.tmp", "somebody's");
    for (name, value) in [("a.csv", "1\n2\n3\n"), ("b.csv", "1\n3\n")] {
        place.write(name, value);
    }
    let warp = ["dtw", "a.csv", "b.csv", "--step-pattern", "symmetric2", "--path", "path.csv"];
    for args in [&["import", "data", "log.parquet"][..], &warp] {
        let mut leaves = false;
        for operation in 1..20 {
            let fault = format!("kill:{operation}");
            if place.calib_with(args, &[("CALIB_FAULT", &fault)]).code() != -1 {
                break;
            }
            leaves |= half_written_in(place.path()) > 0;
        }
        assert!(leaves, "a kill leaves something half-written");
        place.calib(&[args, &["--force"]].concat()).succeeds();
        assert_eq!(half_written_in(place.path()), 0, "{args:?}");
    }
    assert!(place.path().join("mine.tmp").exists());
}

#[cfg(unix)]
#[test]
fn what_belongs_to_others_stays() {
    use std::os::unix::fs::symlink;

    use crate::dtw::align;

    let place = place();
    // A lock that links to a user's file.
    place.write("thesis.tex", "years of work");
    fs::create_dir_all(place.path_of("study-results/model")).expect("made");
    symlink(place.path_of("thesis.tex"), place.path_of("study-results/model/.lock"))
        .expect("linked");
    let refused = place.calib(&["build-model", "study.toml"]).fails(2);
    assert!(refused.contains("holds .lock, which calib did not write"), "{refused}");
    assert_eq!(fs::read(place.path_of("thesis.tex")).expect("readable"), b"years of work");
    fs::remove_file(place.path_of("study-results/model/.lock")).expect("removed");
    // A link to a user's folder in place of the units.
    place.calib(&["build-model", "study.toml"]).succeeds();
    fs::create_dir_all(place.path_of("theirs/units/P/online")).expect("made");
    place.write("theirs/units/P/online/notes.txt", "theirs");
    symlink(place.path_of("theirs"), place.path_of("study-results/sweep")).expect("linked");
    place
        .calib(&["sweep", "study.toml", "--force"])
        .fails_with(2, &["holds units/P/online/notes.txt, which calib did not write"]);
    assert!(place.path_of("theirs/units/P/online/notes.txt").exists());
    // Day files that no simulation wrote.
    fs::create_dir(place.path_of("logs")).expect("made");
    fs::copy(place.path_of("data/2022-11-01.parquet"), place.path_of("logs/2022-11-01.parquet"))
        .expect("copied");
    let refused = place.calib(&["simulate", "logs", "--days", "2", "--force"]).fails(2);
    assert!(refused.contains("2022-11-01.parquet is in the way"), "{refused}");
    let own = fs::read(place.path_of("data/2022-11-01.parquet")).expect("readable");
    assert_eq!(fs::read(place.path_of("logs/2022-11-01.parquet")).expect("readable"), own);
    // A warping path that should go to a device; the target of a link belongs to the user.
    let series = ["a.csv", "b.csv"];
    for name in series {
        place.write(name, "1\n2\n3\n");
    }
    place.write("path.csv", "old");
    symlink(place.path_of("path.csv"), place.path_of("link.csv")).expect("linked");
    for force in [&["--force"][..], &[]] {
        align(&place, series, "link.csv", force).fails_with(2, &["it is a link"]);
    }
    assert!(fs::symlink_metadata(place.path_of("link.csv")).expect("there").is_symlink());
    assert_eq!(fs::read(place.path_of("path.csv")).expect("readable"), b"old");
    assert!(align(&place, series, "/dev/stdout", &[]).succeeds().contains("query,reference"));
}

#[test]
#[cfg(target_os = "linux")]
fn what_the_kernel_says_of_itself_is_no_log() {
    let place = Place::new();
    for path in ["/proc/kmsg", "/proc/self/mounts", "/proc/sys/kernel/hostname"] {
        for args in
            [&["import", path, "wide.parquet"][..], &["inspect", path], &["dtw", path, path]]
        {
            place.calib(args).fails_with(2, &[path]);
        }
    }
}

#[cfg(unix)]
#[test]
fn pipes_are_refused_instead_of_waited_for() {
    let place = place();
    for name in ["s.toml", "q.npy", "q.csv", "q.parquet", "logs.parquet"] {
        let made = std::process::Command::new("mkfifo").arg(place.path().join(name)).status();
        assert!(made.expect("mkfifo").success());
    }
    place.write("r.csv", "1\n2\n");
    for query in ["q.npy", "q.csv", "q.parquet:a"] {
        let refused = place.calib(&["dtw", query, "r.csv"]).fails(2);
        assert!(refused.contains("a pipe"), "{query}: {refused}");
    }
    assert!(place.calib(&["run", "s.toml"]).fails(2).contains("a pipe"));
    place.calib(&["inspect", "logs.parquet"]).fails(2);
    place.calib(&["inspect", "*.parquet"]).fails(2);
    assert!(place.calib(&["validity", "s.toml"]).fails(2).contains("a pipe"));
}

/// Writes a log with one row per minute; `value` gives the values by row and channel.
fn log(place: &Place, name: &str, channels: &[&str], value: impl Fn(usize, usize) -> f64) {
    let times: Vec<Timestamp> = (0..3000)
        .map(|row| Timestamp::from_micros(1_667_260_800_000_000 + row * 60_000_000))
        .collect();
    let table = Table::new().with("timestamp", times);
    let table = channels.iter().enumerate().fold(table, |table, (number, channel)| {
        let values: Vec<f64> = (0..3000).map(|row| value(row, number)).collect();
        table.with(*channel, values)
    });
    fs::create_dir_all(place.path().join(name)).expect("made");
    table.write_parquet(&place.path().join(name).join("a.parquet")).expect("written");
}

fn wave(row: usize, channel: usize) -> f64 {
    (row as f64 / (20.0 + channel as f64)).sin() + (row * (7 + channel) % 101) as f64 / 200.0
}

#[test]
fn sensors_may_be_called_anything() {
    let place = place();
    let long = "温".repeat(40);
    let names = [
        "step",
        "row",
        "A",
        "A.normalised",
        "X (1)",
        "X-1",
        "X, 1",
        "X 1",
        &long,
        "E\u{1b}[2J\nerror: forged",
    ];
    log(&place, "logs", &names, wave);
    let list = format!("sweep.sensors={names:?}").replace("\\u{1b}", "\\u001b");
    let grid = "sweep.grid={ learning_rate = [1e-3, 1e-2] }";
    let logs = ["run", "study.toml", "--set=data.path=logs", "--set=rollout.steps=60"];
    let ran = place.calib(&[&logs[..], &["--set", &list, "--set", grid]].concat());
    let printed = format!("{}{}", ran.ends(&[0, 1]), ran.stderr());
    assert!(
        !printed.contains('\u{1b}')
            && !printed.lines().any(|line| line.starts_with("error: forged"))
    );
    let rollout = place.path().join("study-results/rollout");
    let table = read_parquet(&rollout.join("trajectories.parquet")).expect("a table");
    for column in ["step", "sensor:step", "sensor:row.recorded", "X (1)", "sensor:A"] {
        assert!(table.values(column).is_some(), "{column}");
    }
    let figures =
        fs::read_dir(place.path().join("study-results/evaluate/figures")).expect("figures");
    let grids = figures.flatten().map(|entry| entry.path()).filter(|path| {
        let name = path.file_stem().map(|stem| stem.to_string_lossy()).unwrap_or_default();
        name.starts_with("rollouts-") && path.extension().is_some_and(|kind| kind == "svg")
    });
    assert_eq!(grids.count(), names.len());
    let inspected = place.calib(&["inspect", "logs"]);
    assert!(!inspected.succeeds().contains('\u{1b}'), "{}", inspected.stdout());
    place.calib(&["inspect", "logs", "--json"]).json(&[0]);
}

#[test]
fn numbers_that_nothing_can_work_with_are_missing_or_refused() {
    let place = place();
    log(&place, "logs", &["PIT300", "B", "C"], |row, channel| match (row, channel) {
        (100, 0) => 1e200,
        (200, 1) => f64::MAX,
        (row, 2) => wave(row, 2) * 1e-320,
        (row, channel) => wave(row, channel),
    });
    place
        .calib(&["run", "study.toml", "--set", "data.path=logs", "--set", "rollout.steps=60"])
        .ends(&[0, 1]);
    assert!(
        place.refusal("build-model", "model.temperature=inf").contains("model.temperature = inf")
    );
    assert!(
        place.refusal("build-model", "data.gap_tolerance=nan").contains("data.gap_tolerance = NaN")
    );
    for rate in ["1e300", "5e-324"] {
        let refused = place.refusal("build-model", &format!("agent.learning_rate={rate}"));
        assert!(refused.contains("1e-45 to 1e38"), "{refused}");
    }
    let calm = ["simulate", "calm", "--days=1", "--channels=3", "--period=600"];
    place.calib(&[&calm[..], &["--storms-per-day=-0.0"]].concat()).succeeds();
    assert!(
        place.calib(&["--threads", "20000", "inspect", "data"]).fails(2).contains("from 1 to 1024")
    );
}

#[test]
fn dates_that_stand_for_never_are_no_rows() {
    let place = Place::new();
    for (name, last) in [("never", 253_402_214_400_000_000), ("most", i64::MAX)] {
        let mut times: Vec<Timestamp> = (0..500)
            .map(|row| Timestamp::from_micros(1_667_260_800_000_000 + row * 60_000_000))
            .collect();
        times[499] = Timestamp::from_micros(last);
        let values = (0..500).map(|row| wave(row, 0) as f32).collect();
        fs::create_dir(place.path().join(name)).expect("made");
        write_log(&place.path().join(name).join("a.parquet"), &times, &[("P", values)])
            .expect("written");
        place.calib(&["inspect", name]).succeeds_with(&[
            "1: rows without a timestamp of the years 1 to 9998",
            "held out: 2022-11-01",
        ]);
    }
}

#[test]
fn results_are_no_logs() {
    let place = place();
    place.calib(&["run", "study.toml", "-q"]).succeeds();
    let whole = place.on_study_with("inspect", "data.path=.").succeeds();
    let log = place.on_study_with("inspect", "data.path=data").succeeds();
    assert_eq!(whole.replace("in .", "in data"), log.replace("in .", "in data"));
    let refused = place.calib(&["inspect", "study-results"]).fails(2);
    assert!(refused.contains("results of calib, which are no logs"), "{refused}");
}

#[test]
fn a_study_beside_its_text_can_run_again() {
    let place = Place::new();
    let rows: String = (0..2000).map(row_of_waves).collect();
    place.write("log.csv", &format!("time,a,b\n{rows}"));
    place.write("study.toml", "[data]\npath = \".\"\ntrain_fraction = 0.7\n");
    let before = place.calib(&["inspect", "."]).succeeds();
    assert!(place.calib(&["build-model", "study.toml"]).succeeds().contains("wrote"));
    assert!(place.calib(&["build-model", "study.toml"]).succeeds().contains("up to date"));
    assert_eq!(place.calib(&["inspect", "."]).succeeds(), before);
}

/// Returns a row of a log of two waves.
fn row_of_waves(row: usize) -> String {
    let (hour, minute) = (row / 60 % 24, row % 60);
    let day = 1 + row / 1440;
    format!("2024-03-{day:02} {hour:02}:{minute:02}:00,{:.3},{:.3}\n", wave(row, 0), wave(row, 1))
}

#[test]
fn a_simulated_log_is_what_was_simulated() {
    let place = Place::new();
    let args =
        ["simulate", "data", "--days", "2", "--channels", "4", "--period", "600", "--seed", "3"];
    place.calib(&args).succeeds();
    let day = place.path().join("data/2022-11-01.parquet");
    let whole = fs::read(&day).expect("readable");
    let mut other = whole.clone();
    let middle = other.len() / 2;
    other[middle] ^= 4;
    fs::write(&day, other).expect("writable");
    place.calib(&args).fails_with(2, &["2022-11-01.parquet is not what was simulated"]);
    fs::remove_file(&day).expect("removed");
    place.calib(&args).succeeds();
    assert_eq!(fs::read(&day).expect("readable"), whole);
    let record = place.path().join("data/simulation.json");
    let text = fs::read_to_string(&record).expect("readable");
    fs::write(&record, text.replacen("\"days\": 2", "\"days\": 9", 1)).expect("writable");
    place.calib(&args).fails_with(2, &["it is not known what the logs in data"]);
    // Only files that are known to be simulated are removed.
    let theirs = place.path().join("data/2022-11-05.parquet");
    fs::write(&theirs, "theirs").expect("writable");
    place.calib(&[&args[..], &["--force"]].concat()).succeeds();
    assert_eq!(fs::read(&day).expect("readable"), whole);
    assert_eq!(fs::read(&theirs).expect("readable"), b"theirs");
}

/// Changes a JSON file, and seals it with a valid fingerprint.
fn forge(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut value: Value = read_json(path).expect("JSON");
    value.as_object_mut().expect("an object").remove("fingerprint");
    change(&mut value);
    write_sealed_json(path, &value).expect("written");
}

#[test]
fn forged_results_are_refused_with_what_to_do() {
    let place = place();
    place.run_steps(&["build-model", "rollout", "sweep"]);
    let results = place.path().join("study-results");
    let before = place.content("study-results");

    let unit = results.join("sweep/units/PIT300/member-0/run-0000.json");
    forge(&unit, |unit| {
        let run = unit["runs"].as_object_mut().and_then(|runs| runs.values_mut().next());
        run.expect("a run")["scores"]["whole_run"] = json!(null);
    });
    place
        .calib(&["evaluate", "study.toml"])
        .fails_with(2, &["PIT300 in member:0, run 0", "--force"]);
    place.calib(&["sweep", "study.toml", "--force"]).succeeds();

    forge(&results.join("rollout/manifest.json"), |rollout| rollout["period_secs"] = json!(-0.0));
    place.calib(&["evaluate", "study.toml"]).fails_with(2, &["sample period of -0 s", "--force"]);
    place.calib(&["rollout", "study.toml", "--force"]).succeeds();

    let profile = results.join("model/profile.json");
    let text = fs::read_to_string(&profile).expect("readable");
    fs::write(&profile, text.replacen("null_timestamps", "timestamps", 1)).expect("writable");
    forge(&results.join("model/manifest.json"), |model| {
        model["files"]["profile.json"] =
            json!(calib_files::fingerprint_file(&profile).expect("readable"));
    });
    let refused = place.calib(&["rollout", "study.toml", "--force"]).fails(2);
    assert!(refused.contains("build-model STUDY --force` makes it again"), "{refused}");
    place.calib(&["build-model", "study.toml", "--force"]).succeeds();
    place.calib(&["rollout", "study.toml"]).succeeds();

    place.calib(&["evaluate", "study.toml"]).succeeds();
    let again = place.content("study-results");
    for (name, bytes) in before {
        assert_eq!(again.get(&name), Some(&bytes), "{}", name.display());
    }
}
