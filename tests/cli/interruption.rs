//! A command that was killed at any moment and run again gives the same results as an undisturbed one.

#[cfg(unix)]
use std::io::{BufRead as _, BufReader, Read as _};
use std::{process::Stdio, thread, time::Duration};

#[cfg(unix)]
use crate::harness::{Ran, send};
use crate::{
    harness::{Place, assert_same, wait_until},
    represent::LAPLACIAN,
};

/// Starts `calib` and kills it after some milliseconds, repeatedly and each time later. Then lets it finish.
fn kill_and_rerun(place: &Place, args: &[&str]) {
    let mut killed = 0;
    for milliseconds in [5, 15, 30, 60, 100, 160, 250, 400, 600, 900] {
        let mut child = place.start(args, Stdio::null());
        thread::sleep(Duration::from_millis(milliseconds));
        if child.try_wait().expect("a status").is_some() {
            break;
        }
        child.kill().expect("it was running");
        child.wait().expect("a status");
        killed += 1;
    }
    assert!(killed > 0, "the command was too fast to be killed even once");
    place.calib(args).succeeds();
}

#[test]
fn a_killed_simulation_goes_on() {
    let place = Place::new();
    place.calib(&simulation("whole")).succeeds();
    kill_and_rerun(&place, &simulation("killed"));
    assert_same(&place.content("whole"), &place.content("killed"));
}

/// Returns the arguments that simulate a plant into a folder.
fn simulation(folder: &str) -> [&str; 8] {
    ["simulate", folder, "--days", "6", "--channels", "40", "--period", "10"]
}

#[test]
fn a_killed_study_goes_on() {
    let place = Place::with_study();
    // Training is long enough to save checkpoints between epochs.
    place.edit_study("[sweep]", "[pretrain]\nepochs = 200\n\n[sweep]");
    for command in ["pretrain", "build-model", "rollout", "sweep"] {
        place.calib(&[command, "study.toml", "--output", "whole"]).succeeds();
        kill_and_rerun(&place, &[command, "study.toml", "--output", "killed"]);
        assert_same(&place.content("whole"), &place.content("killed"));
    }
}

#[test]
fn a_killed_training_goes_on() {
    let place = Place::with_study();
    place.edit_study("[model]", &LAPLACIAN.replace("steps = 300", "steps = 4000"));
    place.calib(&["represent", "study.toml", "--output", "whole"]).succeeds();
    kill_and_rerun(&place, &["represent", "study.toml", "--output", "killed"]);
    assert_same(&place.content("whole"), &place.content("killed"));
}

#[test]
fn a_training_that_was_killed_after_its_record_leaves_nothing_behind() {
    let place = Place::with_study();
    place.edit_study("[model]", LAPLACIAN);
    let args = ["represent", "study.toml"];
    place.calib(&args).succeeds();
    let whole = place.content("study-results");
    let representation = place.path().join("study-results/representation");
    let candidates = std::fs::read_dir(representation.join("candidates")).expect("trained");
    for candidate in candidates.flatten() {
        std::fs::write(candidate.path().join("checkpoint.safetensors"), "left").expect("writable");
    }
    std::fs::remove_file(representation.join("manifest.json")).expect("it was complete");
    place.calib(&args).succeeds();
    assert!(place.content("study-results") == whole);
}

#[test]
fn a_killed_training_by_force_is_not_up_to_date() {
    let place = Place::with_study();
    place.edit_study("[model]", &LAPLACIAN.replace("steps = 300", "steps = 4000"));
    let args = ["represent", "study.toml"];
    place.calib(&args).succeeds();
    let whole = place.content("study-results");
    let manifest = place.path().join("study-results/representation/manifest.json");
    let mut child = place.command(&[&args[..], &["--force"]].concat()).spawn().expect("calib runs");
    wait_until(|| !manifest.exists());
    child.kill().expect("it runs");
    child.wait().expect("a status");
    assert!(!manifest.exists(), "what is made again does not count meanwhile");
    assert!(place.calib(&args).succeeds().contains("wrote"));
    assert!(place.content("study-results") == whole);
}

/// Starts a sweep, waits for the first results of a sensor, sends the signal
/// `times` times, and returns how the sweep ended.
#[cfg(unix)]
fn signalled(place: &Place, signal: &str, times: usize) -> Ran {
    let child = place.start(&["sweep", "study.toml", "--threads", "1"], Stdio::piped());
    let units = place.path().join("study-results/sweep/units");
    wait_until(|| units.join("PIT300").is_dir());
    for _ in 0..times {
        send(signal, &child);
    }
    place.ended(&format!("sweep, {signal}"), child)
}

#[cfg(unix)]
#[test]
fn what_a_batch_system_ends_is_to_be_tried_again_and_gives_the_same_bytes() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    // The sweep is long enough that the signals arrive during it.
    place.edit_study("online_runs = 3", "online_runs = 120");
    for signal in ["-TERM", "-USR1", "-USR2"] {
        signalled(&place, signal, 2).fails_with(75, &["run the same command again"]);
        let sweep = place.path().join("study-results/sweep");
        assert!(!sweep.join("manifest.json").exists());
        place.calib(&["sweep", "study.toml"]).succeeds();
        let pieces = place.content("study-results/sweep");
        place.calib(&["sweep", "study.toml", "--force"]).succeeds();
        assert!(place.content("study-results/sweep") == pieces, "{signal}");
        std::fs::remove_dir_all(sweep).expect("there");
    }
}

/// Counts the running processes that were started with this word.
#[cfg(target_os = "linux")]
fn living(word: &str) -> usize {
    let all = std::fs::read_dir("/proc").expect("there").flatten();
    let lines = all.map(|entry| std::fs::read(entry.path().join("cmdline")).unwrap_or_default());
    lines.filter(|line| line.split(|byte| *byte == 0).any(|part| part == word.as_bytes())).count()
}

#[cfg(target_os = "linux")]
#[test]
fn the_program_of_an_agent_does_not_outlive_calib() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let word = format!("{}.75", 200_000 + std::process::id());
    // Neither the program nor its child processes, in their own session or not, read their input.
    let script = format!("setsid sleep {word} & sleep {word} & sleep {word}");
    place.edit_study(
        "value_function = \"linear\"\ngamma = 0.9\nbatch_size = 16\nlearning_rate = 1e-3\n",
        &format!("kind = \"external\"\ncommand = [\"sh\", \"-c\", \"{script}\"]\ngamma = 0.9\n\n[agent.parameters]\nrate = 1\n"),
    );
    place.edit_study("learning_rate = [1e-5, 1e-3, 1e-2]", "rate = [1, 2]");
    for signal in ["-KILL", "-TERM", "-INT"] {
        let mut child = place.start(&["sweep", "study.toml"], Stdio::null());
        assert!(wait_until(|| living(&word) > 0), "{signal}: no process is there");
        send(signal, &child);
        child.wait().expect("it ends");
        assert!(wait_until(|| living(&word) == 0), "{signal}: {} are there", living(&word));
    }
}

#[cfg(unix)]
#[test]
fn a_step_that_never_ends_is_ended_and_a_dry_run_says_what_it_takes() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.edit_study("batch_size = 16", "batch_size = 16\nupdates_per_step = 100000000000000");
    let dry = place.calib(&["sweep", "study.toml", "--dry-run"]);
    dry.succeeds();
    let told = dry.stderr();
    assert!(told.contains("expecting about") && told.contains("days"), "{told}");
    for (signal, status) in [("-TERM", 75), ("-INT", 130), ("-USR1", 75)] {
        let child = place.start(&["sweep", "study.toml"], Stdio::piped());
        let claimed = place.path().join("study-results/sweep/.lock");
        wait_until(|| claimed.exists());
        thread::sleep(Duration::from_millis(300));
        send(signal, &child);
        let ran = place.ended(&format!("sweep, {signal}"), child);
        ran.fails_with(status, &["run the same command again"]);
    }
}

#[test]
fn where_there_are_no_locks_two_sweeps_of_one_folder_end_well() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.edit_study("online_runs = 3", "online_runs = 60");
    place.calib(&["sweep", "study.toml"]).succeeds();
    let alone = place.content("study-results/sweep");
    std::fs::remove_dir_all(place.path().join("study-results/sweep")).expect("there");
    let args = ["sweep", "study.toml", "--threads", "1"];
    let all = [(); 3].map(|()| place.start_with(&args, &[("CALIB_FAULT", "lockless")]));
    for child in all {
        place.ended("sweep", child).succeeds();
    }
    assert!(place.content("study-results/sweep") == alone);
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_what_is_done_and_says_how_to_go_on() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    // The sweep is long enough that the signal arrives during it.
    place.edit_study("online_runs = 3", "online_runs = 4000");
    signalled(&place, "-INT", 1).fails_with(130, &["run the same command again"]);
    assert!(!place.path().join("study-results/sweep/manifest.json").exists());
    place.edit_study("online_runs = 4000", "online_runs = 3");
    place.calib(&["sweep", "study.toml"]).succeeds();
}

#[cfg(unix)]
#[test]
fn a_command_that_keeps_nothing_says_that_it_begins_anew() {
    let place = Place::with_study();
    let mut child = place
        .command(&["init", "data", "proposed.toml", "--within=10m"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("calib runs");
    let mut told = BufReader::new(child.stderr.take().expect("piped"));
    let mut line = String::new();
    while !line.contains("looking at") {
        line.clear();
        assert!(told.read_line(&mut line).expect("text") > 0, "it ended without a word");
    }
    let id = child.id().to_string();
    let sent = std::process::Command::new("kill").args(["-INT", &id]).status();
    assert!(sent.expect("kill runs").success());
    let mut rest = String::new();
    told.read_to_string(&mut rest).expect("text");
    assert_eq!(child.wait().expect("it ends").code(), Some(130), "{rest}");
    let anew = "error: interrupted; nothing is kept, so the same command begins anew";
    assert!(rest.contains(anew) && !rest.contains("to go on"), "{rest}");
    assert!(!place.path().join("proposed.toml").exists());
}
