//! `calib status` from another shell: during a run, after it, and after a kill.

use std::{
    fs,
    io::{BufRead as _, BufReader, Read as _, Write as _},
    net::{SocketAddr, TcpStream},
    process::{Child, Stdio},
    thread,
    time::Duration,
};

use serde_json::Value;

use crate::harness::{Place, schema};

/// Returns a study whose sweep takes about half a minute on two cores.
fn long() -> Place {
    let place = Place::with_study();
    place.edit_study("value_function = \"linear\"", "value_function = \"mlp\"\nhidden_units = 64");
    place.edit_study("member_runs = 2", "member_runs = 20");
    place.edit_study("log_replay_runs = 2", "log_replay_runs = 20");
    place
}

fn status(place: &Place, path: &str) -> Value {
    place.calib(&["status", path, "--json"]).json(&[0])
}

/// Process that is killed when the test ends, even by a panic.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn begin(place: &Place, args: &[&str]) -> Ends {
    Ends(place.start(args, Stdio::null()))
}

/// Polls until `is_there` returns a value.
fn wait_for<T>(what: &str, mut is_there: impl FnMut() -> Option<T>) -> T {
    for _ in 0..LOOKS {
        if let Some(found) = is_there() {
            return found;
        }
        thread::sleep(Duration::from_millis(100));
    }
    panic!("{what} did not come")
}

/// Limit of polls, so that a test without success ends.
const LOOKS: usize = 3_000;

fn states<'v>(status: &'v Value, step: &str) -> Vec<&'v str> {
    let steps = status["steps"].as_array().expect("steps").iter();
    steps
        .filter(|entry| entry["step"] == step)
        .filter_map(|entry| entry["state"].as_str())
        .collect()
}

fn runs(ranking: &Value) -> (u64, u64) {
    let [made, all] = [0_usize, 1].map(|place| ranking["runs"][place].as_u64().expect("a number"));
    (made, all)
}

#[test]
fn a_finished_study_is_done_and_its_settings_are_ranked() {
    let place = Place::with_study();
    let before = status(&place, "study.toml");
    assert_eq!((&before["state"], &before["rankings"]), (&"waiting".into(), &Value::Array(vec![])));
    assert!(!place.path().join("study-results").exists(), "nothing is written");
    place.calib(&["run", "study.toml"]);
    let content = place.content("study-results");
    let after = status(&place, "study.toml");
    assert_eq!(after["state"], "done", "{after}");
    assert_eq!(after["commands"], Value::Array(vec![]));
    assert!(states(&after, "evaluate") == ["done"] && states(&after, "sweep") == ["done"]);
    let rankings = after["rankings"].as_array().expect("rankings");
    assert_eq!(rankings.len(), 2, "two sensors");
    for ranking in rankings {
        assert_eq!(runs(ranking), (33, 33), "{ranking}");
        let settings = ranking["settings"].as_array().expect("settings");
        assert_eq!(settings[0]["ratio"], 1.0);
        let ratios = settings.iter().filter_map(|setting| setting["ratio"].as_f64());
        assert!(ratios.clone().is_sorted() && ratios.count() == 3, "{ranking}");
        let [low, high] = [0, 1].map(|end| settings[2]["interval"][end].as_f64().expect("known"));
        let ratio = settings[2]["ratio"].as_f64().expect("known");
        assert!(low < ratio && ratio < high, "{ranking}");
        // By the default rule: two runs in each of three members, and two on the log.
        assert!(settings.iter().all(|setting| setting["runs"] == 8), "{ranking}");
    }
    let folder = status(&place, "study-results");
    assert_eq!(folder["rankings"], after["rankings"], "by the folder of its results");
    place.calib(&["status", "study.toml", "--watch"]).succeeds_with(&[
        "study.toml: every step is done",
        "PIT300: 33 of 33 training runs are made; those on the log and in the models count",
        "report: ",
    ]);
    assert!(place.content("study-results") == content, "nothing is written");

    // One more setting is left to run.
    place.edit_study("[1e-5, 1e-3, 1e-2]", "[1e-5, 1e-4, 1e-3, 1e-2]");
    let edited = status(&place, "study.toml");
    assert_eq!((&edited["state"], states(&edited, "sweep")), (&"waiting".into(), vec!["to_do"]));
    assert_eq!(states(&edited, "build-model"), ["done"]);
    assert_eq!(edited["rankings"], Value::Array(vec![]), "no ranking of another study");
}

/// A command that is killed in its first second leaves a note.
#[test]
fn a_command_is_noted_before_its_first_second_ends() {
    let place = long();
    let _run = begin(&place, &["run", "study.toml"]);
    let folder = place.path().join("study-results/.progress");
    let note: Value = wait_for("a note", || {
        let entries = fs::read_dir(&folder).ok()?;
        let mut notes = entries.flatten().filter_map(|entry| fs::read(entry.path()).ok());
        notes.find_map(|text| serde_json::from_slice(&text).ok())
    });
    let [began, written] = ["began", "written"].map(|key| note[key].as_f64().expect("seconds"));
    assert!(written - began < 1.0, "{note}");
}

/// Returns the sensors for which `calib status` ranks settings, and
/// the reason why the sweep has to run again.
fn ranked(place: &Place, set: &str) -> (Vec<String>, String) {
    let standing = place.calib(&["status", "study.toml", "--json", "--set", set]).json(&[0]);
    let rankings = standing["rankings"].as_array().expect("rankings").iter();
    let sensors = rankings.filter_map(|ranking| ranking["sensor"].as_str().map(str::to_owned));
    let steps = standing["steps"].as_array().expect("steps").iter();
    let reasons = steps.filter_map(|step| step["stale"].as_str());
    (sensors.collect(), reasons.collect::<Vec<_>>().join("\n"))
}

#[test]
fn a_sweep_of_another_study_is_told_and_its_runs_are_not_ranked() {
    let place = Place::with_study();
    place.calib(&["run", "study.toml"]).ends(&[0, 1]);
    let none: [&str; 0] = [];
    let again = "run `calib sweep study.toml";
    for (set, sensors, key) in [
        ("sweep.steps=700", &none[..], "sweep.steps = "),
        ("sweep.online_runs=2", &none[..], "sweep.online_runs = "),
        (
            "agent.gammas={ TIT101 = 0.8 }",
            &["PIT300"][..],
            "agent.gammas.TIT101 = nothing, now 0.8",
        ),
        ("sweep.sensors=[\"TIT101\"]", &["TIT101"][..], "sweep.sensors = "),
    ] {
        let (found, reason) = ranked(&place, set);
        assert_eq!(found, sensors, "{set}");
        assert!(reason.contains(key) && reason.contains(again), "{reason}");
    }
    let told = place.calib(&["status", "study.toml", "--set", "sweep.steps=700"]).succeeds();
    assert!(told.contains("was made with sweep.steps = "), "{told}");
}

#[test]
fn what_is_no_study_is_refused_with_what_to_do() {
    let place = Place::new();
    let refused = place.calib(&["status", "nowhere"]).fails(2);
    assert!(refused.contains("nowhere does not exist; give a study file"), "{refused}");
    fs::create_dir(place.path().join("empty")).expect("made");
    place
        .calib(&["status", "empty"])
        .fails_with(2, &["empty holds no study", "calib status STUDY"]);
    place.write("study.toml", "[modl]\n");
    place.calib(&["status", "study.toml"]).fails(2);
    place.calib(&["status", "study.toml", "--serve", "here"]).fails_with(2, &["--serve"]);
}

#[test]
fn a_study_can_be_looked_at_while_it_runs_and_after_a_kill() {
    let place = long();
    let mut run = begin(&place, &["run", "study.toml", "--threads", "1"]);
    let during = wait_for("a stored run", || {
        let now = status(&place, "study.toml");
        assert_ne!(now["state"], "done", "too fast to look at");
        let (stored, _) = now["rankings"].as_array()?.first().map(runs)?;
        (stored > 0 && now["secs_left"].is_number()).then_some(now)
    });
    assert_eq!(during["state"], "running", "{during}");
    assert_eq!(during["commands"][0]["command"], "run", "{during}");
    assert_eq!(during["commands"][0]["standing"], "running");
    assert_eq!(during["commands"][0]["process"], run.0.id());
    assert_eq!(during["commands"][0]["task"]["name"], "training");
    assert_eq!(states(&during, "sweep"), ["running"], "{during}");
    assert_eq!(
        (states(&during, "build-model"), states(&during, "evaluate")),
        (vec!["done"], vec!["to_do"])
    );
    let (stored, all) = runs(&during["rankings"][0]);
    assert!(stored < all, "{stored} of {all}");
    place.calib(&["status", "study.toml"]).succeeds_with(&["PIT300: provisional, ", " left"]);

    run.0.kill().expect("killed");
    run.0.wait().expect("gone");
    let killed = status(&place, "study-results");
    assert_eq!(killed["state"], "killed", "{killed}");
    assert_eq!(killed["commands"][0]["standing"], "killed");
    assert!(killed["secs_left"].is_null() && states(&killed, "sweep") == ["to_do"], "{killed}");
    place.calib(&["status", "study.toml"]).succeeds_with(&[
        "was killed",
        "sweep: ",
        " training runs are made",
    ]);

    // A note that was half-written at a kill, on another machine two days ago.
    let half = place.path().join("study-results/.progress/.calib-0123456789ab-7-x.tmp");
    let file = fs::File::create(&half).expect("writable");
    let written = file.metadata().and_then(|found| found.modified()).expect("known");
    file.set_modified(written - Duration::from_hours(48)).expect("set");

    // The next command removes the rest of the killed one, and resumes.
    let smaller = ["--set", "sweep.member_runs=1", "--set", "sweep.log_replay_runs=1"];
    place.calib(&[&["run", "study.toml"][..], &smaller].concat());
    assert!(!place.path().join("study-results/.progress").exists());
    let again =
        place.calib(&[&["status", "study.toml", "--json"][..], &smaller].concat()).json(&[0]);
    assert_eq!((&again["state"], &again["commands"]), (&"done".into(), &Value::Array(vec![])));
}

#[test]
fn what_is_missing_or_changed_is_to_do_and_told() {
    let place = Place::with_study();
    let results = place.path().join("study-results");
    place
        .calib(&["check", "study.toml"])
        .fails_with(2, &["study.toml has no results in study-results; run it first"]);
    place
        .calib(&["check", "other.toml"])
        .fails_with(2, &["other.toml does not exist; give a study file"]);
    place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
    for missing in ["sweep/runs.parquet", "sweep/units/PIT300/log-replay/run-0001.json"] {
        fs::remove_file(results.join(missing)).expect("there");
        assert_eq!(states(&status(&place, "study.toml"), "sweep"), ["to_do"], "{missing}");
        place.calib(&["status", "study.toml"]).succeeds_with(&["files are missing from"]);
        let checked = place.calib(&["check", "study-results"]).ends(&[1]);
        let told = format!("study-results/{missing}: it is missing; `calib sweep STUDY` makes it");
        assert!(
            checked.contains(&told) && checked.ends_with("damaged or missing: 1\n"),
            "{checked}"
        );
        let ran = place.calib(&["run", "study.toml"]);
        assert!(ran.stderr().contains("to do: sweep, evaluate"), "{}", ran.stderr());
        assert_eq!(status(&place, "study.toml")["state"], "done", "{missing}");
    }
    fs::remove_file(results.join("report.html")).expect("there");
    let checked = place.calib(&["check", "study.toml"]).ends(&[1]);
    assert!(checked.contains("study-results/report.html: it is missing"), "{checked}");
    place.calib(&["evaluate", "study.toml"]).ends(&[0, 1]);

    // A touched file may have changed.
    let log = place.path().join("data/2022-11-02.parquet");
    fs::write(&log, fs::read(&log).expect("there")).expect("writable");
    let told = "2022-11-02.parquet has another name, size or date than when the log was read";
    let shown = place.calib(&["status", "study.toml"]).succeeds();
    assert!(shown.contains(told) && shown.contains("keeps results"), "{shown}");
    let old = place.calib(&["evaluate", "study.toml"]);
    assert!(old.stderr().contains(told), "{}", old.stderr());
    place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
    let new = place.calib(&["evaluate", "study.toml"]);
    assert!(!new.stderr().contains("the log has changed"), "{}", new.stderr());
}

#[test]
fn shards_of_a_cluster_are_ranked_as_far_as_they_are() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.calib(&["cluster", "plan", "study.toml", "-o", "plan", "--shards", "3"]).succeeds();
    let before = status(&place, "plan");
    assert_eq!(before["cluster"]["done"], 0, "{before}");
    place.calib(&["cluster", "run", "plan", "--shard", "1"]).succeeds();
    let after = status(&place, "plan");
    assert_eq!(after["cluster"]["done"], 1, "{after}");
    let rankings = after["rankings"].as_array().expect("rankings");
    let stored: u64 = rankings.iter().map(|ranking| runs(ranking).0).sum();
    assert!(stored > 0 && stored < 66, "{stored}");
    place.calib(&["status", "plan"]).succeeds_with(&["1 of 3 shards done", "provisional"]);
}

/// Returns the status that a page serves.
fn told(address: SocketAddr) -> Value {
    let (_, told) = ask(address, "GET /status.json", &address.to_string());
    serde_json::from_str(&told).expect("JSON")
}

/// Sends a request to a page, and returns the status with headers, and the body.
fn ask(address: SocketAddr, request: &str, host: &str) -> (String, String) {
    let mut stream = TcpStream::connect(address).expect("connected");
    let text = format!("{request} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    stream.write_all(text.as_bytes()).expect("sent");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("answered");
    // A long body comes in chunks, which may end within a letter.
    let answer = String::from_utf8_lossy(&answer);
    let (head, body) = answer.split_once("\r\n\r\n").expect("headers");
    (head.to_owned(), body.to_owned())
}

/// Starts a command that serves a page, and returns the address of the page.
fn serving(
    place: &Place,
    args: &[&str],
) -> (Ends, SocketAddr, BufReader<std::process::ChildStderr>) {
    let mut child = place.start(args, Stdio::piped());
    let mut said = BufReader::new(child.stderr.take().expect("piped"));
    let ends = Ends(child);
    let mut line = String::new();
    while !line.contains("page: http://") {
        line.clear();
        assert!(said.read_line(&mut line).expect("readable") > 0, "no page was shown");
    }
    let address = line.trim().trim_start_matches("page: http://").trim_end_matches('/');
    (ends, address.parse().expect("an address"), said)
}

#[test]
fn a_page_shows_a_study_to_this_machine_alone_and_changes_nothing() {
    let place = Place::with_study();
    place.calib(&["run", "study.toml"]);
    let content = place.content("study-results");
    let (ends, address, _said) = serving(&place, &["status", "study.toml", "--serve", "0"]);
    assert!(address.ip().is_loopback());
    let host = address.to_string();
    let (head, page) = ask(address, "GET /", &host);
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("text/html"), "{head}");
    assert!(head.contains("default-src 'none'") && page.contains("status.json"), "{head}");
    let told = told(address);
    assert_eq!(told["state"], "done");
    assert_eq!(schema::problem(&schema::of("status"), &told), None);
    let (head, report) = ask(address, "GET /report", &format!("localhost:{}", address.port()));
    assert!(head.starts_with("HTTP/1.1 200") && report.contains("PIT300"), "{head}");
    for (request, host, expected) in [
        ("GET /../study.toml", host.as_str(), "404"),
        ("POST /", host.as_str(), "405"),
        ("DELETE /report", host.as_str(), "405"),
        ("GET /status.json", "somebody.example", "403"),
    ] {
        let (head, _) = ask(address, request, host);
        assert!(head.starts_with(&format!("HTTP/1.1 {expected}")), "{request}: {head}");
    }
    // The address is already in use.
    place.calib(&["status", "study.toml", "--serve", &host]).fails_with(2, &["give another port"]);
    drop(ends);
    assert!(place.content("study-results") == content, "nothing is written");
}

#[test]
fn the_page_of_a_run_answers_while_all_threads_train() {
    let place = long();
    let (ends, address, _said) =
        serving(&place, &["run", "study.toml", "--threads", "1", "--serve", "127.0.0.1:0"]);
    let shown = wait_for("a stored run", || {
        let told = told(address);
        assert_ne!(told["state"], "done", "the page waited for the run");
        let (stored, _) = told["rankings"].as_array()?.first().map(runs)?;
        (stored > 0 && told["secs_left"].is_number()).then_some(told)
    });
    assert_eq!((&shown["state"], states(&shown, "sweep")), (&"running".into(), vec!["running"]));
    drop(ends);
}

#[test]
fn a_run_shows_its_page_as_long_as_it_runs() {
    let place = Place::with_plant();
    let (mut ends, address, mut said) =
        serving(&place, &["run", "study.toml", "--serve", "127.0.0.1:0"]);
    let told = told(address);
    assert!(told["steps"].is_array(), "{told}");
    let mut rest = String::new();
    said.read_to_string(&mut rest).expect("readable");
    ends.0.wait().expect("ended");
    assert!(rest.contains("done in"), "{rest}");
    assert!(TcpStream::connect(address).is_err(), "the page is gone");
}
