//! Every disk operation fails once, finds a full disk once, and is the last before a kill once. Afterwards the same
//! command gives the same results as an undisturbed one.
//!
//! Some operations run with the other tests. To run all operations of all commands:
//!
//!     CALIB_FAULTS=all cargo test --release --test torture faults -- --nocapture

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    campaign::{everything, neighbours, on_all_cores},
    harness::{Content, Place, Ran},
};

/// Kinds of failure.
const KINDS: [&str; 3] = ["fail", "full", "kill"];
/// Operations per command and kind that run with the other tests.
const SLICE: usize = 4;

/// A command that writes.
struct Job {
    args: &'static [&'static str],
    place: fn() -> Place,
}

impl Job {
    fn run(&self, place: &Place, fault: Option<&str>) -> Ran {
        let mut args = self.args.to_vec();
        args.extend(["--threads", "1", "-q"]);
        place.calib_with(&args, &[("CALIB_FAULT", fault.unwrap_or_default())])
    }

    /// Returns the results of an undisturbed run.
    fn whole(&self, place: &Place) -> Content {
        self.run(place, None).ends(&[0, 1]);
        content(place)
    }

    /// Returns the disk operations of the command in order.
    fn operations(&self, place: &Place) -> Vec<String> {
        let list = tempfile::NamedTempFile::new().expect("a file");
        self.run(place, Some(&format!("list:{}", list.path().display()))).ends(&[0, 1]);
        let text = fs::read_to_string(list.path()).expect("readable");
        text.lines().map(str::to_owned).collect()
    }
}

/// Returns everything in a place without locks, wall times, and half-written files beside a file that the user named.
/// Those stay after a kill, because no other process can know whether they are still being written.
fn content(place: &Place) -> Content {
    let mut content = place.content(".");
    content.retain(|path, _| !path.ends_with(".lock") && !is_left_by_a_kill(path));
    content
}

/// Whether a file is a half-written one that a kill leaves beside a user's file.
fn is_left_by_a_kill(path: &Path) -> bool {
    path.to_str().is_some_and(|name| name.starts_with(".calib-"))
        && path.extension().is_some_and(|kind| kind == "tmp")
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("writable");
    for entry in fs::read_dir(from).expect("readable").flatten() {
        let path = entry.path();
        let target = to.join(entry.file_name());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).expect("copied");
        }
    }
}

/// Copies a place.
pub(crate) fn copied(place: &Place) -> Place {
    let other = Place::new();
    copy(place.path(), other.path());
    other
}

/// Outcome of one failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// The command reported what it could not do.
    Refused,
    /// The failed operation was not needed, and the result is whole.
    Whole,
    Killed,
}

/// Makes one operation fail, and runs the command again.
fn try_one(job: &Job, base: &Place, whole: &Content, fault: &str) -> Result<Outcome, String> {
    let place = copied(base);
    let ran = job.run(&place, Some(fault));
    let told = ran.stderr();
    let outcome = match ran.code() {
        -1 if fault.starts_with("kill") => Outcome::Killed,
        0 | 1 => {
            same(&content(&place), whole).map_err(|differs| format!("succeeded, but {differs}"))?;
            Outcome::Whole
        }
        2 => {
            let cause = ["a failure on purpose", "no storage space"];
            let says_why =
                told.contains("error: ") && cause.iter().any(|cause| told.contains(cause));
            let places = ["study", "data", "made", "working file in"];
            let says_where = places.iter().any(|place| told.contains(place));
            if !says_why || !says_where || told.contains("panicked") {
                return Err(format!("unclear: {told}"));
            }
            Outcome::Refused
        }
        code => return Err(format!("exit code {code}: {told}")),
    };
    let again = job.run(&place, None);
    if !matches!(again.code(), 0 | 1) {
        return Err(format!("{outcome:?}, then exit code {}: {}", again.code(), again.stderr()));
    }
    same(&content(&place), whole).map_err(|differs| format!("{outcome:?}, then {differs}"))?;
    Ok(outcome)
}

fn same(found: &Content, whole: &Content) -> Result<(), String> {
    let further: Vec<_> = found.keys().filter(|path| !whole.contains_key(*path)).collect();
    let missing: Vec<_> = whole.keys().filter(|path| !found.contains_key(*path)).collect();
    let other: Vec<_> = whole
        .keys()
        .filter(|path| found.get(*path).is_some_and(|bytes| bytes != &whole[*path]))
        .collect();
    if further.is_empty() && missing.is_empty() && other.is_empty() {
        return Ok(());
    }
    Err(format!("left over: {further:?}; missing: {missing:?}; other bytes: {other:?}"))
}

/// Tries the operations of a command: all of them, or some that are spread over it.
#[expect(clippy::print_stdout, reason = "a campaign by hand says what it counted")]
fn campaign(job: &Job) {
    let base = (job.place)();
    let whole = job.whole(&copied(&base));
    let operations = job.operations(&copied(&base));
    assert!(!operations.is_empty());
    let all = std::env::var("CALIB_FAULTS").is_ok_and(|which| which == "all");
    let wanted = if all { operations.len() } else { SLICE.min(operations.len()) };
    let cases: Vec<(usize, usize)> = (0..KINDS.len())
        .flat_map(|kind| (0..wanted).map(move |place| (kind, place)))
        .map(|(kind, place)| {
            if all {
                return (kind, place + 1);
            }
            // The operations are spread over the command, and differ between the kinds.
            let shift = kind * operations.len() / KINDS.len();
            (kind, 1 + (place * operations.len() + shift) / wanted % operations.len())
        })
        .collect();
    let outcomes = on_all_cores(cases.len(), |case| {
        let (kind, number) = cases[case];
        try_one(job, &base, &whole, &format!("{}:{number}", KINDS[kind]))
    });
    let mut wrong = Vec::new();
    for (kind, name) in KINDS.iter().enumerate() {
        let own: Vec<_> =
            cases.iter().zip(&outcomes).filter(|((tried, _), _)| *tried == kind).collect();
        let [refused, still_whole, killed] = [Outcome::Refused, Outcome::Whole, Outcome::Killed]
            .map(|wanted| own.iter().filter(|(_, outcome)| **outcome == Ok(wanted)).count());
        println!(
            "{:<40} {name}: {} of {} operations tried, {refused} refused, \
             {still_whole} whole all the same, {killed} killed",
            job.args.join(" "),
            own.len(),
            operations.len()
        );
        wrong.extend(own.into_iter().filter_map(|((_, number), outcome)| {
            let error = outcome.as_ref().err()?;
            Some(format!("{name}:{number} ({}): {error}", operations[number - 1]))
        }));
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
}

/// Returns a place in which these commands have run.
fn after(place: Place, commands: &[&[&str]]) -> Place {
    for args in commands {
        place.calib(&[args, &["--threads", "1", "-q"][..]].concat()).ends(&[0, 1]);
    }
    place
}

#[test]
fn a_study_of_neighbours() {
    campaign(&Job { args: &["run", "study.toml"], place: neighbours });
}

#[test]
fn a_study_of_everything() {
    campaign(&Job { args: &["run", "study.toml"], place: everything });
}

/// A study of acting agents with a verdict, to which a held-out period was added.
fn another_period() -> Place {
    let place = Place::new();
    let rows = (0..400).map(|row| {
        let [hour, minute, position] = [row / 60, row % 60, row % 4];
        let action = row / 4 % 2;
        format!("2024-03-01 {hour:02}:{minute:02}:00,{position},{action},-{position}\n")
    });
    let log: String = rows.collect();
    place.write("data.csv", &format!("timestamp,position,move,reward\n{log}"));
    let data =
        "[data]\npath = \"data.csv\"\nshape = \"wide\"\ntrain = { end = 2024-03-01T05:00:00 }\n";
    let control =
        "[control]\nactions = [\"move\"]\ntimeout = 10\nsteps = 100\nmodels = [\"neighbors\"]\n";
    let grid = "[control.grid]\nstep_size = [0.1, 0.3]\n";
    place.write("study.toml", &format!("{data}{control}{grid}"));
    let place = after(place, &[&["control", "study.toml"]]);
    place.edit("study.toml", "[control]", "held_out = { start = 2024-03-01T05:00:00 }\n[control]");
    place
}

#[test]
fn what_is_judged_again() {
    campaign(&Job { args: &["control", "study.toml"], place: another_period });
}

#[test]
fn what_is_made_anew() {
    campaign(&Job {
        args: &["simulate", "data", "--days", "1", "--channels", "4", "--period", "600", "--force"],
        place: || {
            after(
                Place::new(),
                &[&["simulate", "data", "--days", "2", "--channels", "3", "--period", "900"]],
            )
        },
    });
    for args in [
        &["build-model", "study.toml", "--force", "--spill", "always"][..],
        &["represent", "study.toml", "--force"],
        &["pretrain", "study.toml", "--force"],
        &["rollout", "study.toml", "--force"],
        &["sweep", "study.toml", "--force"],
        &["evaluate", "study.toml", "--force"],
    ] {
        campaign(&Job { args, place: || after(everything(), &[&["run", "study.toml"]]) });
    }
}

#[test]
fn what_stands_alone() {
    campaign(&Job { args: &["man", "made"], place: Place::new });
    campaign(&Job {
        args: &["dtw", "a.csv", "b.csv", "--step-pattern=symmetric2", "--path=made.csv", "--force"],
        place: || {
            let place = Place::new();
            place.write("a.csv", "1\n2\n3\n");
            place.write("b.csv", "1\n3\n3\n");
            place
        },
    });
    campaign(&Job { args: &["validity", "study.toml", "--output", "made"], place: neighbours });
}

/// Calls that change a disk, in Rust's standard library and in calib's dependencies.
const CHANGES: [&str; 16] = [
    "fs::write(",
    "fs::rename(",
    "fs::copy(",
    "fs::hard_link(",
    "fs::remove_file(",
    "fs::remove_dir(",
    "fs::remove_dir_all(",
    "fs::create_dir(",
    "fs::create_dir_all(",
    "fs::set_permissions(",
    "File::create(",
    "File::create_new(",
    "File::options(",
    "OpenOptions::new(",
    "tempfile::",
    ".set_len(",
];

/// Collects the sources in a folder, without their tests.
fn sources(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    for entry in fs::read_dir(folder).expect("readable").flatten() {
        let path = entry.path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|kind| kind == "rs") && !path.ends_with("tests.rs") {
            let text = fs::read_to_string(&path).expect("readable");
            let end = text.find("#[cfg(test)]\nmod tests").unwrap_or(text.len());
            let code = text[..end].lines().filter(|line| !line.trim_start().starts_with("//"));
            found.push((path, code.collect::<Vec<_>>().join("\n")));
        }
    }
}

/// Calls that open a file for reading.
const OPENS: [&str; 3] = ["fs::read(", "fs::read_to_string(", "File::open("];

/// Returns the sources of everything except `calib-files`.
fn sources_of_all() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    sources(&root.join("src"), &mut found);
    for package in fs::read_dir(root.join("crates")).expect("readable").flatten() {
        if package.file_name() != "calib-files" {
            sources(&package.path().join("src"), &mut found);
        }
    }
    assert!(found.len() > 300, "{} files", found.len());
    found
}

/// Whether a text contains a call, and not only a call of a function whose name ends in the same way.
fn names(text: &str, call: &str) -> bool {
    text.match_indices(call).any(|(place, _)| {
        !text[..place].ends_with(|before: char| before.is_alphanumeric() || before == '_')
    })
}

/// Returns the files that contain one of `calls`, except for `own`, a path from the root.
fn callers(calls: &[&'static str], own: &str) -> Vec<(PathBuf, Vec<&'static str>)> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join(own);
    let found = sources_of_all().into_iter().filter(|(path, _)| *path != own);
    let found = found.map(|(path, text)| {
        let made: Vec<_> = calls.iter().copied().filter(|call| names(&text, call)).collect();
        (path, made)
    });
    found.filter(|(_, made)| !made.is_empty()).collect()
}

#[test]
fn nothing_but_calib_files_changes_a_disk() {
    // The list of operations, which a test requests, is not a result.
    assert_eq!(callers(&CHANGES, "src/faults.rs"), []);
}

/// Code that opens a file itself would wait for ever if the file is a pipe.
#[test]
fn nothing_but_calib_files_opens_a_file() {
    // System files about memory and processes are not user files.
    assert_eq!(callers(&OPENS, "crates/calib-base/src/memory.rs"), []);
}
