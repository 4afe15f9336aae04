//! Folders full of foreign files and links, under the names that calib uses and under others. Whatever command writes
//! there, with whatever option, all of them stay unchanged.
//!
//!     CALIB_CASES=5000 CALIB_SEED=7 cargo test --release --test torture foreign -- --nocapture

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use crate::{
    campaign::{Draws, everything, neighbours, number, on_all_cores},
    faults::copied,
    harness::Place,
};

/// Cases that run with the other tests.
const SLICE: u64 = 60;
/// Most foreign files per case.
const MOST: usize = 6;

/// A command that writes.
struct Act {
    args: &'static [&'static str],
    /// Commands that must run before it.
    before: &'static [&'static [&'static str]],
    /// A file that the user names, and that `--force` may replace.
    named: Option<&'static str>,
    /// Whether the command has `--force`.
    force: bool,
    place: fn() -> Place,
}

impl Act {
    const fn of(args: &'static [&'static str], before: &'static [&'static [&'static str]]) -> Self {
        Self { args, before, named: None, force: true, place: everything }
    }

    const fn without_force(self) -> Self {
        Self { force: false, ..self }
    }

    const fn naming(self, named: &'static str) -> Self {
        Self { named: Some(named), ..self }
    }

    const fn at(self, place: fn() -> Place) -> Self {
        Self { place, ..self }
    }
}

const RUN: &[&str] = &["run", "study.toml", "-q", "--output", "out"];
const PRETRAIN: &[&str] = &["pretrain", "study.toml", "-q", "--output", "out"];
const REPRESENT: &[&str] = &["represent", "study.toml", "-q", "--output", "out"];
const BUILD: &[&str] = &["build-model", "study.toml", "-q", "--output", "out"];
const ROLLOUT: &[&str] = &["rollout", "study.toml", "-q", "--output", "out"];
const SWEEP: &[&str] = &["sweep", "study.toml", "-q", "--output", "out"];
const EVALUATE: &[&str] = &["evaluate", "study.toml", "-q", "--output", "out"];
const LOGS: &[&str] = &["simulate", "study.toml", "-q"];
const PLAN: &[&str] =
    &["cluster", "plan", "study.toml", "-q", "--shards", "2", "--output", "results", "-o", "out"];
const MODEL: &[&str] = &["build-model", "study.toml", "-q", "--output", "results"];
const SHARD: &[&str] = &["cluster", "run", "out", "--shard", "0", "-q"];
const OTHER_SHARD: &[&str] = &["cluster", "run", "out", "--shard", "1", "-q"];

const SERIES: &str = "data/2022-11-01.parquet:PIT300";

fn acts() -> Vec<Act> {
    vec![
        Act::of(RUN, &[]),
        Act::of(PRETRAIN, &[LOGS]),
        Act::of(REPRESENT, &[LOGS]),
        Act::of(BUILD, &[LOGS, REPRESENT]),
        Act::of(ROLLOUT, &[LOGS, REPRESENT, BUILD]),
        Act::of(SWEEP, &[LOGS, REPRESENT, PRETRAIN, BUILD]),
        Act::of(EVALUATE, &[LOGS, REPRESENT, PRETRAIN, BUILD, ROLLOUT, SWEEP]),
        Act::of(&["pretrain", "study.toml", "-q", "--output", "out", "--share", "0/2"], &[LOGS]),
        Act::of(&["represent", "study.toml", "-q", "--output", "out", "--share", "0/2"], &[LOGS]),
        Act::of(&["simulate", "out", "--days", "2", "--channels", "3", "--period", "600"], &[]),
        Act::of(
            &["simulate", "out", "--days=2", "--channels=3", "--period=600", "--change=2"],
            &[],
        ),
        Act::of(&["simulate", "out", "--task", "acrobot", "--transitions", "300"], &[]),
        Act::of(&["import", "data", "out/log.parquet"], &[LOGS]).naming("out/log.parquet"),
        Act::of(&["init", "data", "out/new.toml", "--within", "5s"], &[LOGS])
            .naming("out/new.toml"),
        Act::of(
            &["dtw", SERIES, SERIES, "--step-pattern=symmetric2", "--path=out/path.csv"],
            &[LOGS],
        )
        .naming("out/path.csv"),
        Act::of(&["man", "out"], &[]).without_force(),
        Act::of(&["inspect", "data", "--log", "journal.txt"], &[LOGS])
            .without_force()
            .naming("journal.txt"),
        Act::of(PLAN, &[LOGS, MODEL]).at(neighbours),
        Act::of(SHARD, &[LOGS, MODEL, PLAN]).without_force().at(neighbours),
        Act::of(&["cluster", "status", "out", "--clean"], &[LOGS, MODEL, PLAN, SHARD])
            .without_force()
            .at(neighbours),
        Act::of(&["cluster", "merge", "out", "-q"], &[LOGS, MODEL, PLAN, SHARD, OTHER_SHARD])
            .without_force()
            .at(neighbours),
        Act::of(&["control", "pole/study.toml", "-q", "--output", "out"], &[]).at(with_decisions),
        Act::of(&["cluster", "submit", "out", "--engine", "kubernetes"], &[LOGS, MODEL, PLAN])
            .without_force()
            .at(neighbours),
        Act::of(&["evaluate", "--runs", "runs.parquet", "--output", "out"], &[LOGS])
            .without_force()
            .at(with_runs),
        Act::of(&["validity", "study.toml", "--output", "out"], &[LOGS, MODEL])
            .without_force()
            .at(neighbours),
    ]
}

/// Returns a log of decisions, and a study of it.
fn with_decisions() -> Place {
    Place::with_pole(400, 200, 2)
}

/// Returns a study, and a table of runs from another program.
fn with_runs() -> Place {
    use calib_data::table::Table;
    let place = neighbours();
    let rows: Vec<(&str, i64, i64, f64)> = ["member:0", "member:1", "online"]
        .into_iter()
        .flat_map(|environment| (0..2).map(move |run| (environment, run)))
        .flat_map(|(environment, run)| (0..2).map(move |value| (environment, run, value)))
        .map(|(environment, run, value)| {
            (environment, run, value, 1.0 + value as f64 + 0.1 * run as f64)
        })
        .collect();
    Table::new()
        .with("environment", rows.iter().map(|row| row.0.to_owned()).collect::<Vec<String>>())
        .with("sensor", vec!["P".to_owned(); rows.len()])
        .with("run", rows.iter().map(|row| row.1).collect::<Vec<i64>>())
        .with("candidate", rows.iter().map(|row| row.2).collect::<Vec<i64>>())
        .with("rmse", rows.iter().map(|row| row.3).collect::<Vec<f64>>())
        .write_parquet(&place.path().join("runs.parquet"))
        .expect("written");
    place
}

/// Lists everything in a place except folders, by relative path.
fn listed(place: &Place) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    let mut pending = vec![place.path().to_owned()];
    while let Some(folder) = pending.pop() {
        for entry in fs::read_dir(&folder).expect("readable").flatten() {
            if entry.file_type().expect("known").is_dir() {
                pending.push(entry.path());
            } else {
                let path = entry.path();
                found.insert(path.strip_prefix(place.path()).expect("below").to_owned());
            }
        }
    }
    found
}

/// A place where a command can start, the files that it writes there, and the place afterwards.
struct Base {
    before: Place,
    after: Place,
    written: Vec<PathBuf>,
}

impl Base {
    fn of(act: &Act) -> Self {
        let before = (act.place)();
        for args in act.before {
            before.calib(args).ends(&[0, 1]);
        }
        let after = copied(&before);
        after.calib(act.args).ends(&[0, 1, 4]);
        let known = listed(&before);
        let mut written: Vec<PathBuf> = listed(&after).difference(&known).cloned().collect();
        if written.is_empty() {
            written.extend(known);
        }
        Self { before, after, written }
    }
}

/// A foreign file or link.
#[derive(Debug)]
enum Theirs {
    File(Vec<u8>),
    /// Target of the link.
    Link(PathBuf),
}

fn seen(path: &Path) -> Option<Theirs> {
    let kind = fs::symlink_metadata(path).ok()?;
    if kind.is_symlink() {
        return Some(Theirs::Link(fs::read_link(path).ok()?));
    }
    fs::read(path).ok().map(Theirs::File)
}

/// Puts something at `path` if nothing is there, and creates the parent folders.
fn put(place: &Place, path: &Path, draws: &mut Draws) -> Option<(PathBuf, Theirs)> {
    let whole = place.path().join(path);
    fs::create_dir_all(whole.parent()?).ok()?;
    if fs::symlink_metadata(&whole).is_ok() {
        return None;
    }
    let theirs = place.path().join("theirs");
    match draws.below(8) {
        0 => std::os::unix::fs::symlink(theirs.join("work.txt"), &whole).ok()?,
        1 => std::os::unix::fs::symlink(&theirs, &whole).ok()?,
        2 => std::os::unix::fs::symlink("nowhere", &whole).ok()?,
        3 => {
            // A folder in place of a file.
            let inside = path.join("inside.txt");
            fs::create_dir(&whole).ok()?;
            fs::write(place.path().join(&inside), b"inside").ok()?;
            return Some((inside.clone(), seen(&place.path().join(&inside))?));
        }
        4 => fs::write(&whole, b"").ok()?,
        _ => fs::write(&whole, draws.next().to_le_bytes()).ok()?,
    }
    Some((path.to_owned(), seen(&whole)?))
}

/// Returns a name that calib may or may not use, in a folder that it writes to.
fn elsewhere(written: &[PathBuf], draws: &mut Draws) -> PathBuf {
    const NAMES: [&str; 16] = [
        "notes.txt",
        ".hidden",
        "report.html",
        "summary.json",
        "manifest.json",
        "log.parquet",
        "0000.units",
        "run-0000.json.bak",
        "run-7.json",
        "training.json.old",
        "checkpoint.safetensors.old",
        "figure.svg",
        "states.npy.bak",
        "deeper/notes.txt",
        "00000000.part.bak",
        "plan.json.old",
    ];
    let beside = draws.of(written);
    let folder = beside.ancestors().nth(1 + draws.below(2)).unwrap_or(Path::new(""));
    let folder = if folder.starts_with("out") { folder } else { Path::new("out") };
    folder.join(draws.of(&NAMES))
}

fn try_one(act: &Act, base: &Base, draws: &mut Draws) -> Result<&'static str, String> {
    let begun = draws.below(2) == 0;
    let place = copied(if begun { &base.before } else { &base.after });
    fs::create_dir_all(place.path().join("theirs")).expect("writable");
    fs::write(place.path().join("theirs/work.txt"), b"years of work").expect("writable");
    let mut theirs =
        vec![(PathBuf::from("theirs/work.txt"), Theirs::File(b"years of work".to_vec()))];
    for _ in 0..=draws.below(MOST) {
        let path = if begun && draws.below(3) > 0 {
            draws.of(&base.written).clone()
        } else {
            elsewhere(&base.written, draws)
        };
        theirs.extend(put(&place, &path, draws));
    }
    let mut args = act.args.to_vec();
    let forced = act.force && draws.below(2) == 0;
    if forced {
        args.push("--force");
    }
    let ran = place.calib(&args);
    let told = format!("calib {}: {}{}", args.join(" "), ran.stdout(), ran.stderr());
    if !matches!(ran.code(), 0..=2 | 4) || ran.stderr().contains("panicked") {
        return Err(format!("exit code {}: {told}", ran.code()));
    }
    for (path, was) in &theirs {
        let is_named = act.named.is_some_and(|named| Path::new(named) == path);
        match was {
            Theirs::File(_) if is_named && forced => continue,
            // A journal is appended to, and an empty file becomes a new journal.
            Theirs::File(was) if is_named && !act.force && was.is_empty() => continue,
            _ => {}
        }
        let same = match (seen(&place.path().join(path)), was) {
            (Some(Theirs::File(now)), Theirs::File(was)) => now == *was,
            (Some(Theirs::Link(now)), Theirs::Link(was)) => now == *was,
            _ => false,
        };
        if !same {
            return Err(format!("{} is not what it was ({was:?}): {told}", path.display()));
        }
    }
    let inside = fs::read_dir(place.path().join("theirs")).expect("there").count();
    if inside != 1 {
        return Err(format!("something was written where a link leads: {told}"));
    }
    Ok(if ran.code() == 2 { "refused" } else { "done" })
}

/// Puts foreign files and links into a place, then runs a command.
#[cfg(unix)]
#[test]
fn foreign() {
    let acts = acts();
    let bases = on_all_cores(acts.len(), |number| Base::of(&acts[number]));
    let seed = number("CALIB_SEED", 1);
    let count = number("CALIB_CASES", SLICE) as usize;
    let outcomes = on_all_cores(count, |case| {
        let mut draws = Draws(seed << 32 | case as u64);
        let number = case % acts.len();
        (number, try_one(&acts[number], &bases[number], &mut draws))
    });
    let mut wrong = Vec::new();
    for (number, act) in acts.iter().enumerate() {
        let own: Vec<&Result<&str, String>> = outcomes
            .iter()
            .filter(|(tried, _)| *tried == number)
            .map(|(_, outcome)| outcome)
            .collect();
        let [done, refused] = ["done", "refused"]
            .map(|how| own.iter().filter(|outcome| ***outcome == Ok(how)).count());
        println!("{:<60} {done:>6} {refused:>6}", act.args.join(" "));
        wrong.extend(own.into_iter().filter_map(|outcome| outcome.clone().err()));
    }
    assert!(wrong.is_empty(), "seed {seed}, {} of {count}:\n{}", wrong.len(), wrong.join("\n"));
}
