//! A log is read once, and again if it has changed.

use std::{fs, path::PathBuf};

use crate::harness::{Place, Ran};

/// Counter of how often files are opened.
#[cfg(target_os = "linux")]
mod opened {
    use std::{
        mem::MaybeUninit,
        os::fd::OwnedFd,
        path::{Path, PathBuf},
    };

    use rustix::fs::inotify::{self, CreateFlags, Reader, WatchFlags};

    pub(super) struct Watched(OwnedFd);

    /// Starts to watch these files.
    pub(super) fn watch(files: &[PathBuf]) -> Watched {
        let watched = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC).expect("a watch");
        for file in files {
            let path: &Path = file;
            inotify::add_watch(&watched, path, WatchFlags::OPEN).expect("there");
        }
        Watched(watched)
    }

    impl Watched {
        /// Returns how often the files were opened, all together.
        pub(super) fn count(&self) -> usize {
            let mut buffer = [MaybeUninit::uninit(); 4096];
            let mut reader = Reader::new(&self.0, &mut buffer);
            let mut opened = 0;
            while reader.next().is_ok() {
                opened += 1;
            }
            opened
        }
    }
}

/// Number of times that reading opens a file of the log: for its pages, and for its fingerprint.
const OPENS: usize = 2;

fn logs(place: &Place) -> Vec<PathBuf> {
    let entries = fs::read_dir(place.path().join("data")).expect("there").flatten();
    let paths = entries.map(|entry| entry.path());
    paths.filter(|path| path.extension().is_some_and(|ending| ending == "parquet")).collect()
}

fn run(place: &Place) -> Ran {
    place.calib(&["run", "study.toml"])
}

#[test]
#[cfg(target_os = "linux")]
fn a_simulated_log_is_checked_when_it_is_read_and_not_again() {
    let place = Place::with_plant();
    run(&place);
    let watched = opened::watch(&logs(&place));
    assert!(run(&place).code() < 2);
    assert_eq!(watched.count(), 0);
    let day = logs(&place).pop().expect("a day");
    let bytes = fs::read(&day).expect("there");
    fs::write(&day, [&bytes[..100], &[1; 100], &bytes[200..]].concat()).expect("writable");
    run(&place).fails_with(2, &["is not what was simulated"]);
}

#[test]
#[cfg(target_os = "linux")]
fn what_is_there_is_shown_without_a_look_into_the_log() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let watched = opened::watch(&logs(&place));
    for command in ["rollout", "sweep", "evaluate", "run"] {
        place.calib(&[command, "study.toml"]).succeeds();
        assert_eq!(watched.count(), 0, "{command} opened the log");
    }
    place.calib(&["run", "study.toml", "--force"]).succeeds();
    let once = watched.count();
    assert!(once > 0, "what is made again begins with the log");
    assert!(once <= OPENS * logs(&place).len(), "{once} times");
    // A single step reads as much as all steps together.
    place.calib(&["build-model", "study.toml", "--force"]).succeeds();
    assert_eq!(watched.count(), once);
}

#[test]
fn a_log_that_was_touched_or_moved_is_read_and_changes_nothing() {
    let place = Place::with_study();
    run(&place);
    let before = place.content("study-results");
    for log in logs(&place) {
        let bytes = fs::read(&log).expect("there");
        fs::remove_file(&log).expect("ours");
        fs::write(&log, bytes).expect("writable");
    }
    let told = run(&place).stderr();
    assert!(told.contains("; 0 of "), "{told}");
    assert_eq!(place.content("study-results"), before);
}

#[test]
fn another_log_of_the_same_size_and_time_is_another_log() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let before = place.content("study-results/model");
    place.simulate_other("other");
    for log in logs(&place) {
        let time = fs::metadata(&log).and_then(|metadata| metadata.modified()).expect("known");
        let other = place.path().join("other").join(log.file_name().expect("has one"));
        fs::copy(other, &log).expect("writable");
        let file = fs::File::options().write(true).open(&log).expect("there");
        file.set_modified(time).expect("ours");
    }
    place.calib(&["build-model", "study.toml"]).succeeds();
    assert_ne!(place.content("study-results/model"), before);
}

#[test]
fn a_damaged_copy_of_the_log_is_made_again() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let before = place.content("study-results");
    let damaged: Vec<PathBuf> = before
        .keys()
        .filter(|path| path.starts_with("dataset") && !path.ends_with(".lock"))
        .cloned()
        .collect();
    assert_eq!(damaged.len(), 5, "{damaged:?}");
    let checked = place.calib(&["check", "study-results/dataset", "--json"]).json(&[0]);
    assert_eq!(checked["files"], 5, "each counts once");
    for name in damaged {
        let path = place.path().join("study-results").join(&name);
        let mut bytes = fs::read(&path).expect("there");
        let middle = bytes.len() / 2;
        if middle > 0 {
            bytes[middle] ^= 0x10;
        }
        fs::remove_file(&path).expect("ours");
        fs::write(&path, bytes).expect("writable");
        let checked = place.calib(&["check", "study-results"]);
        assert_eq!(checked.code(), 1, "{}: {}", name.display(), checked.stdout());
        place.calib(&["build-model", "study.toml"]).succeeds();
        assert!(place.content("study-results") == before, "{}", name.display());
    }
}

#[test]
fn only_what_the_study_reads_is_kept() {
    let place = Place::with_study();
    let folders =
        || fs::read_dir(place.path().join("study-results/dataset")).expect("there").count();
    place.calib(&["build-model", "study.toml"]).succeeds();
    assert_eq!(folders(), 1);
    place.calib(&["build-model", "study.toml", "--set", "preprocess.subsample=2"]).succeeds();
    assert_eq!(folders(), 1);
    let states = place.path().join("study-results/dataset");
    let dry = place.calib(&["build-model", "study.toml", "--dry-run"]);
    dry.succeeds();
    assert_eq!(fs::read_dir(states).expect("there").count(), 1, "a dry run writes nothing");
}

fn steps_to_do(place: &Place, more: &[&str]) -> Vec<String> {
    let told = place.on_study("run", &[&["--dry-run", "--json"], more].concat()).json(&[0]);
    let steps = told["steps"].as_array().expect("steps").iter();
    let to_do = steps.filter(|step| step["state"] == "to_do");
    to_do.map(|step| step["step"].as_str().expect("a name").to_owned()).collect()
}

#[test]
fn a_run_says_what_is_up_to_date_and_what_is_to_do() {
    let place = Place::with_study();
    assert_eq!(
        steps_to_do(&place, &[]),
        ["reading the log", "build-model", "rollout", "sweep", "evaluate"]
    );
    place.calib(&["build-model", "study.toml"]).succeeds();
    assert_eq!(steps_to_do(&place, &[]), ["rollout", "sweep", "evaluate"]);
    let told = place.calib(&["run", "study.toml"]);
    told.succeeds();
    assert!(
        told.stderr().contains("up to date: reading the log, build-model\n"),
        "{}",
        told.stderr()
    );
    assert_eq!(steps_to_do(&place, &[]), ["evaluate"]);
    assert_eq!(steps_to_do(&place, &["--set", "agent.gamma=0.8"]), ["sweep", "evaluate"]);
    assert_eq!(steps_to_do(&place, &["--set", "rollout.steps=300"]), ["rollout", "evaluate"]);
    assert_eq!(steps_to_do(&place, &["--force"]).len(), 5);
    place.edit_study("members = 3", "members = 4");
    assert_eq!(steps_to_do(&place, &[]), ["build-model", "rollout", "sweep", "evaluate"]);
}

#[test]
fn what_others_put_beside_prepared_logs_stays() {
    let place = Place::with_study();
    place.on_study_with("build-model", "preprocess.subsample=1").succeeds();
    let states = place.path().join("study-results/dataset");
    let own = fs::read_dir(&states).expect("there").flatten().next().expect("one").path();
    fs::create_dir(states.join("notes")).expect("made");
    fs::write(states.join("notes/mine.txt"), "mine").expect("written");
    fs::write(own.join("mine.txt"), "mine").expect("written");
    place.on_study_with("build-model", "preprocess.subsample=2").succeeds();
    assert!(states.join("notes/mine.txt").exists());
    let left: Vec<_> =
        fs::read_dir(&own).expect("there").flatten().map(|entry| entry.file_name()).collect();
    assert_eq!(left, ["mine.txt"]);
}
