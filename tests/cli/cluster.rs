//! Work divided between processes: the bytes equal those of one process,
//! whatever the division and the fate of the processes.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Stdio,
    thread,
    time::Duration,
};

use calib_files::{Fingerprinter, read_sealed_json, write_sealed_json};
use serde_json::Value;

use crate::harness::{Content, Place, Ran, assert_same};

/// Builds the model of a study, runs its sweep in one process, removes the sweep, and returns its content.
fn alone(place: &Place) -> Content {
    place.calib(&["build-model", "study.toml"]).succeeds();
    swept(place)
}

fn swept(place: &Place) -> Content {
    place.calib(&["sweep", "study.toml"]).succeeds();
    let content = place.content("study-results");
    forget(place);
    content
}

fn forget(place: &Place) {
    let sweep = place.path().join("study-results/sweep");
    fs::remove_dir_all(sweep).expect("there is one");
}

fn plan(place: &Place, name: &str, shards: &str) -> usize {
    let args = ["cluster", "plan", "study.toml", "--shards", shards, "-o", name, "--json"];
    let told = place.calib(&args).json(&[0]);
    told["shards"].as_u64().expect("a number") as usize
}

fn run(place: &Place, plan: &str, shard: usize) -> Ran {
    place.calib(&["cluster", "run", plan, "--shard", &shard.to_string(), "--threads", "1"])
}

fn results(place: &Place, plan: &str, shard: usize) -> PathBuf {
    place.path().join(format!("{plan}/shards/{shard:04}.units"))
}

fn status(place: &Place, plan: &str) -> (i32, Value) {
    let ran = place.calib(&["cluster", "status", plan, "--json"]);
    (ran.code(), ran.json(&[0, 4]))
}

#[test]
fn any_number_of_shards_in_any_order_gives_the_bytes_of_one_process() {
    let place = Place::with_study();
    let alone = alone(&place);
    // Two sensors in eleven runs give at most 22 shards.
    for (shards, expected) in [("1", 1), ("7", 7), ("40", 22)] {
        let name = format!("plan-{shards}");
        assert_eq!(plan(&place, &name, shards), expected);
        // Only the plan is left of the study.
        for hidden in ["data", "study.toml", "study-results"] {
            let from = place.path().join(hidden);
            fs::rename(&from, place.path().join(format!("hidden-{hidden}"))).expect("moved");
        }
        let order = (0..expected).rev().filter(|shard| shard % 2 == 0);
        let order = order.chain((0..expected).filter(|shard| shard % 2 == 1));
        for shard in order {
            assert!(run(&place, &name, shard).succeeds().contains("is done"));
        }
        assert!(run(&place, &name, 0).succeeds().contains("done already"), "twice is no harm");
        for hidden in ["data", "study.toml", "study-results"] {
            let from = place.path().join(format!("hidden-{hidden}"));
            fs::rename(from, place.path().join(hidden)).expect("moved");
        }
        assert_eq!(status(&place, &name).0, 0);
        place.calib(&["cluster", "merge", &name]).succeeds();
        assert!(place.content("study-results") == alone, "{shards} shards");
        place.calib(&["cluster", "merge", &name]).succeeds_with(&["up to date"]);
        forget(&place);
    }
}

#[test]
fn a_plan_is_of_what_is_left_and_of_the_study_as_it_was() {
    let place = Place::with_study();
    let alone = alone(&place);
    place.calib(&["sweep", "study.toml"]).succeeds();
    let units = place.path().join("study-results/sweep/units");
    for lost in ["PIT300/online/run-0001.json", "TIT101/member-2/run-0000.json"] {
        fs::remove_file(units.join(lost)).expect("there");
    }
    assert_eq!(plan(&place, "plan", "5"), 2);
    let told = place.calib(&["cluster", "plan", "study.toml", "-o", "plan"]).fails(2);
    assert!(told.contains("is a plan already"), "{told}");
    let dry = place.calib(&["cluster", "plan", "study.toml", "-o", "dry", "--dry-run"]).succeeds();
    assert!(dry.contains("predicted") && !place.path().join("dry").exists(), "{dry}");
    for shard in 0..2 {
        assert!(run(&place, "plan", shard).succeeds().contains("is done: 3 training runs made"));
    }
    place.edit_study("gamma = 0.9", "gamma = 0.8");
    place.calib(&["cluster", "merge", "plan"]).succeeds();
    assert!(place.content("study-results") == alone);
    place.edit_study("gamma = 0.8", "gamma = 0.9");
    let nothing = place.calib(&["cluster", "plan", "study.toml", "-o", "nothing"]).succeeds();
    assert!(nothing.contains("nothing is left to train"), "{nothing}");
    place.calib(&["cluster", "merge", "nothing"]).succeeds();
}

#[test]
fn sensors_of_other_gammas_have_passes_of_their_own() {
    let place = Place::with_study();
    place.edit_study("gamma = 0.9\n", "gamma = 0.9\ngammas = { TIT101 = 0.8 }\n");
    let alone = alone(&place);
    let shards = plan(&place, "plan", "7");
    for shard in 0..shards {
        assert!(run(&place, "plan", shard).succeeds().contains("is done"));
    }
    place.calib(&["cluster", "merge", "plan"]).succeeds();
    assert!(place.content("study-results") == alone);
}

#[test]
fn a_plan_takes_no_folder_of_somebody() {
    let place = Place::with_study();
    fs::rename(place.path().join("data"), place.path().join("inputs")).expect("moved");
    place.edit_study("path = \"data\"", "path = \"inputs\"");
    let log = place.content("inputs");
    place.calib(&["build-model", "study.toml"]).succeeds();
    for more in [&["--dry-run"][..], &["--force"], &[]] {
        let args = [&["cluster", "plan", "study.toml", "-o", "."], more].concat();
        place.calib(&args).fails_with(2, &["which calib did not write"]);
        assert!(place.content("inputs") == log, "the log is what it was");
    }
    assert!(!place.path().join(".lock").exists());
}

#[test]
fn a_killed_planning_is_gone_on_with_and_leaves_what_is_not_its_own() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let args = ["cluster", "plan", "study.toml", "--shards", "2", "-o", "plan"];
    for operation in (1..).step_by(4) {
        let ran = place.calib_with(&args, &[("CALIB_FAULT", &format!("kill:{operation}"))]);
        if ran.code() == 0 || place.path().join("plan/plan.json").exists() {
            break;
        }
        assert_eq!(ran.code(), -1, "operation {operation}: {}", ran.stderr());
        // The half-written inputs are removed, and another plan takes their place.
        place.calib(&[&args[..], &["--set", "sweep.online_runs=2"]].concat()).succeeds();
        fs::remove_dir_all(place.path().join("plan")).expect("there");
    }
    fs::remove_dir_all(place.path().join("plan")).expect("there");
    assert_eq!(place.calib_with(&args, &[("CALIB_FAULT", "kill:20")]).code(), -1);
    assert!(place.path().join("plan/inputs").exists());
    place.calib(&args).succeeds();
    fs::remove_file(place.path().join("plan/plan.json")).expect("there");
    place.write("plan/inputs/notes.txt", "somebody's");
    place.calib(&args).fails_with(2, &["plan holds inputs/notes.txt, which calib did not write"]);
    assert_eq!(fs::read(place.path().join("plan/inputs/notes.txt")).expect("there"), b"somebody's");
}

#[test]
fn of_several_plannings_of_one_folder_one_succeeds() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    for fault in ["", "lockless"] {
        let plan = format!("plan-{fault}");
        let all = ["1", "2", "3"].map(|shards| {
            let args = ["cluster", "plan", "study.toml", "--shards", shards, "-o", &plan];
            place.start_with(&args, &[("CALIB_FAULT", fault)])
        });
        let ended = all.into_iter().map(|child| place.ended(&plan, child));
        let (done, refused): (Vec<_>, Vec<_>) = ended.partition(|ran| ran.code() == 0);
        assert_eq!(done.len(), 1, "{fault}");
        for ran in refused {
            let told = ran.fails(2);
            let is_told = told.contains("is a plan already") || told.contains("another calib");
            // Without locks, one process may remove what another one is writing.
            let is_gone = fault == "lockless" && told.contains("plan-lockless/inputs");
            assert!(is_told || is_gone, "{told}");
        }
        assert_eq!(status(&place, &plan).0, 4, "it is whole, and nothing is done");
    }
}

#[test]
fn stages_of_a_race_follow_from_one_another() {
    let place = Place::with_study();
    place.edit_study("member_runs = 2", "member_runs = 3\nrace = \"halving\"");
    place.edit_study("[1e-5, 1e-3, 1e-2]", "[1e-5, 1e-3, 1e-2, 1e38]");
    let alone = alone(&place);
    place
        .calib(&["cluster", "plan", "study.toml", "-o", "dry", "--dry-run"])
        .succeeds_with(&[" in 3 stages, one after the other, up to ", " training runs"]);
    let count = plan(&place, "plan", "3");
    assert_eq!(count, 9, "three stages of three shards");
    run(&place, "plan", 8).fails_with(4, &["follows from shard 0, which is not done"]);
    for shard in 0..count {
        run(&place, "plan", shard).succeeds();
    }
    place.calib(&["cluster", "merge", "plan"]).succeeds();
    assert!(place.content("study-results") == alone);
}

#[test]
fn models_and_deployments_are_parts_of_one_plan_and_agents_start_where_they_should() {
    let place = Place::with_study();
    place.edit_study("train_fraction = 0.7", "train = { end = 2022-11-03 }");
    place.edit_study("steps = 800", "steps = 300");
    place.edit_study("[sweep]", "[pretrain]\nepochs = 2\n\n[sweep]");
    place.extend_study(
        "
[models.neighbours]
[models.network.model]
kind = \"nn\"
[models.network.dynamics]
epochs = 2
hidden_units = 8
[deployments.near]
start = 2022-11-03
end = 2022-11-03T12:00:00
[deployments.far]
start = 2022-11-03T12:00:00
end = 2022-11-04
",
    );
    place.run_steps(&["pretrain", "build-model", "sweep"]);
    let alone = place.content("study-results");
    for part in ["neighbours", "network"] {
        for deployment in ["near", "far"] {
            let sweep = format!("study-results/models/{part}/deployments/{deployment}/sweep");
            fs::remove_dir_all(place.path().join(sweep)).expect("there");
        }
    }
    let count = plan(&place, "plan", "6");
    assert_eq!(count, 6);
    for shard in 0..count {
        run(&place, "plan", shard).succeeds();
    }
    place.calib(&["cluster", "merge", "plan"]).succeeds();
    assert_same(&alone, &place.content("study-results"));
}

#[test]
fn shards_that_are_killed_a_hundred_times_give_the_same_bytes() {
    let place = Place::with_study();
    place.edit_study("steps = 800", "steps = 2000");
    let alone = alone(&place);
    let count = plan(&place, "plan", "7");
    let mut killed = 0;
    let mut attempts = 0_u64;
    while killed < 100 && attempts < 600 {
        let shard = attempts as usize % count;
        let args = ["cluster", "run", "plan", "--shard", &shard.to_string(), "--threads", "1"];
        let mut child = place.start(&args, Stdio::null());
        thread::sleep(Duration::from_millis(4 + attempts * 7 % 61));
        if child.try_wait().expect("a status").is_none() {
            child.kill().expect("it runs");
            killed += 1;
        } else {
            // The shard had finished. Without its results there is something to kill again, on a fast machine too.
            let _ = fs::remove_file(results(&place, "plan", shard));
        }
        child.wait().expect("a status");
        attempts += 1;
    }
    assert_eq!(killed, 100, "of {attempts} attempts");
    for shard in 0..count {
        run(&place, "plan", shard).succeeds();
    }
    place.calib(&["cluster", "merge", "plan"]).succeeds();
    assert!(place.content("study-results") == alone);
    place.calib(&["cluster", "status", "plan", "--clean"]).succeeds();
    let left = fs::read_dir(place.path().join("plan/shards")).expect("readable").flatten();
    let left: Vec<PathBuf> = left.map(|entry| entry.path()).collect();
    assert!(!left.iter().any(|path| is_unfinished(path)), "{left:?}");
}

/// Whether a file belongs to an unfinished shard.
fn is_unfinished(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "state" || ending == "tmp")
}

#[cfg(unix)]
#[test]
fn a_shard_that_is_asked_to_stop_says_so_and_goes_on() {
    use crate::harness::{send, wait_until};
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.edit_study("online_runs = 3", "online_runs = 400");
    plan(&place, "plan", "1");
    let args = ["cluster", "run", "plan", "--shard", "auto", "--threads", "1"];
    let child = place.start_with(&args, &[("SLURM_ARRAY_TASK_ID", "0")]);
    wait_until(|| results(&place, "plan", 0).exists());
    send("-USR1", &child);
    place.ended("cluster run", child).fails(75);
    let (code, told) = status(&place, "plan");
    let shard = &told["shards"][0];
    assert_eq!((code, shard["state"].as_str()), (4, Some("begun")));
    assert!(shard["note"].as_str().expect("a note").contains("was asked to stop"), "{shard}");
    assert!(shard["units"].as_u64() > Some(0), "{shard}");
    let [had, all] =
        ["training_runs", "all_training_runs"].map(|key| shard[key].as_u64().expect("a number"));
    let rest = format!("is done: {} training runs made", all - had);
    let told = run(&place, "plan", 0).succeeds().replace(',', "");
    assert!(told.contains(&rest), "{rest} is missing in {told}");
}

/// Asserts that a plan is not merged, for this reason, and that nothing is written.
fn merge_refused(place: &Place, told: &str) {
    let error = place.calib(&["cluster", "merge", "plan"]).fails(4);
    assert!(error.contains(told) && error.contains("nothing was written"), "{told}: {error}");
    assert!(!place.path().join("study-results/sweep").exists(), "{told}");
}

#[test]
fn what_is_missing_damaged_or_of_others_is_named_and_nothing_is_written() {
    let place = Place::with_study();
    let alone = alone(&place);
    let count = plan(&place, "plan", "7");
    for shard in (0..count).filter(|shard| *shard != 2) {
        run(&place, "plan", shard).succeeds();
    }
    merge_refused(&place, "shard 2: it has no results");
    let missing = place.calib(&["cluster", "status", "plan", "--missing", "slurm"]);
    assert_eq!((missing.code(), missing.stdout().trim()), (4, "2"));
    run(&place, "plan", 2).succeeds();
    // A flipped byte.
    let path = results(&place, "plan", 5);
    let whole = fs::read(&path).expect("readable");
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 4;
    fs::write(&path, &flipped).expect("writable");
    merge_refused(&place, "shard 5: ");
    // The shard is computed again as if the file did not exist.
    let ran = run(&place, "plan", 5);
    assert!(ran.stderr().contains("is damaged") && ran.stderr().contains("begins anew"));
    assert!(fs::read(&path).expect("readable") == whole);
    // The file of another shard.
    fs::copy(results(&place, "plan", 4), &path).expect("copied");
    merge_refused(&place, "is of another plan or shard");
    // The file of another version of calib.
    fs::write(&path, of_version_nine(&whole)).expect("writable");
    merge_refused(&place, "calib 9.9.9");
    fs::write(&path, &whole).expect("writable");
    place.calib(&["cluster", "merge", "plan"]).succeeds();
    assert!(place.content("study-results") == alone);
}

/// Returns the same results, sealed with the version number 9.9.9.
fn of_version_nine(file: &[u8]) -> Vec<u8> {
    let text = std::str::from_utf8(file).expect("text");
    let (body, _) = text.trim_end().rsplit_once('\n').expect("lines");
    let tool = concat!("calib ", env!("CARGO_PKG_VERSION"));
    let body = body.replacen(tool, "calib 9.9.9", 1) + "\n";
    let units = body.lines().count() - 1;
    let mut fingerprinter = Fingerprinter::default();
    fingerprinter.add(body.as_bytes()).add(&[1]).add(&(units as u64).to_le_bytes());
    let seal = fingerprinter.finish();
    let trailer =
        format!("{{\"extent\":\"whole\",\"units\":{units},\"fingerprint\":\"{seal}\"}}\n");
    (body + &trailer).into_bytes()
}

/// Writes another file in place of one: the model's file is a hard link to it, and stays.
fn replace(path: &Path, bytes: &[u8]) {
    fs::remove_file(path).expect("there");
    fs::write(path, bytes).expect("writable");
}

#[test]
fn other_versions_processors_and_damaged_inputs_are_refused() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    plan(&place, "plan", "2");
    let path = place.path().join("plan/plan.json");
    let written: Value = read_sealed_json(&path).expect("whole");
    for (key, value, told) in [
        ("tool", Value::from("calib 9.9.9"), "calib 9.9.9"),
        ("results", Value::from(0), "results 0"),
        ("arithmetic", Value::from("f00"), "numbers of the class f00"),
    ] {
        let mut other = written.clone();
        other["maker"][key] = value;
        write_sealed_json(&path, &other).expect("writable");
        for command in [&["run", "plan", "--shard", "0"][..], &["merge", "plan"]] {
            let error = place.calib(&[&["cluster"], command].concat()).fails(2);
            assert!(error.contains(told), "{error}");
        }
    }
    write_sealed_json(&path, &written).expect("writable");
    assert!(run(&place, "plan", 7).fails(2).contains("shards 0 to 1"));
    let states = place.path().join("plan/inputs/0/states.npy");
    let whole = fs::read(&states).expect("readable");
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    replace(&states, &flipped);
    let ran = (0..2).map(|shard| run(&place, "plan", shard)).filter(|ran| ran.code() != 0);
    let failed: Vec<String> = ran.map(|ran| ran.fails(2)).collect();
    assert!(!failed.is_empty());
    assert!(failed.iter().all(|error| error.contains("is not what was planned")), "{failed:?}");
    let (code, told) = status(&place, "plan");
    assert!(code == 4 && told.to_string().contains("is not what was planned"), "{told}");
    replace(&states, &whole);
    fs::write(&path, b"{").expect("writable");
    assert!(run(&place, "plan", 0).fails(2).contains("is damaged"));
}

#[test]
fn a_shard_without_room_fails_is_named_and_goes_on_elsewhere() {
    let place = Place::with_study();
    let alone = alone(&place);
    let count = plan(&place, "plan", "3");
    let args = ["cluster", "run", "plan", "--shard", "1", "--threads", "1"];
    let full = place.calib_with(&args, &[("CALIB_FAULT", "full:10")]);
    assert_eq!(full.code(), 4, "{}", full.stderr());
    assert!(full.stderr().contains("run"), "{}", full.stderr());
    let killed = place.calib_with(&args, &[("CALIB_FAULT", "kill:16")]);
    assert!(killed.code() != 0);
    let (_, told) = status(&place, "plan");
    let note = told["shards"][1]["note"].as_str().expect("a note");
    assert!(note.contains("was killed") && note.contains("run"), "{note}");
    for shard in 0..count {
        run(&place, "plan", shard).succeeds();
    }
    place.calib(&["cluster", "merge", "plan"]).succeeds();
    assert!(place.content("study-results") == alone);
}

/// Submits a plan, and returns the arguments that the queue of this search path got.
#[cfg(unix)]
fn submitted(place: &Place, path: &str, more: &[&str]) -> String {
    let args = [&["cluster", "submit", "plan", "--engine", "slurm"], more].concat();
    place.calib_with(&args, &[("PATH", path)]).succeeds();
    let asked = place.read("asked");
    fs::remove_file(place.path().join("asked")).expect("there");
    asked.replace(&*place.path().to_string_lossy(), "PLACE")
}

#[cfg(unix)]
#[test]
fn slurm_is_told_stage_by_stage_and_only_what_is_missing() {
    use std::os::unix::fs::PermissionsExt as _;
    let place = Place::with_study();
    place.edit_study("member_runs = 2", "member_runs = 3\nrace = \"halving\"");
    place.calib(&["build-model", "study.toml"]).succeeds();
    let count = plan(&place, "plan", "3");
    let shown = place.calib(&["cluster", "submit", "plan", "--engine", "slurm", "--dry-run"]);
    let shown = shown.succeeds();
    for line in ["#SBATCH --array=0-2", "#SBATCH --array=3-5", "#SBATCH --signal=B:USR1@120"] {
        assert!(shown.contains(line), "{line} is not in\n{shown}");
    }
    assert!(!place.path().join("plan/slurm").exists(), "a dry run writes nothing");
    // A queue that counts jobs and records its arguments.
    let sbatch = place.path().join("sbatch");
    fs::write(&sbatch, "#!/bin/sh\necho \"$@\" >> asked\necho \"7$(wc -l < asked);here\"\n")
        .expect("writable");
    fs::set_permissions(&sbatch, fs::Permissions::from_mode(0o755)).expect("set");
    let path = format!("{}:{}", place.path().display(), std::env::var("PATH").expect("a path"));
    let after_ok = "--parsable --kill-on-invalid-dep=yes --dependency=afterok:";
    let after_any = "--parsable --kill-on-invalid-dep=yes --dependency=afterany:";
    let asked = submitted(&place, &path, &[]);
    let expected = [
        format!("--parsable {}", script_of("stage-0")),
        format!("{after_ok}71 {}", script_of("stage-1")),
        format!("{after_ok}72 {}", script_of("stage-2")),
        format!("{after_any}73 {}", script_of("merge")),
    ];
    assert_eq!(asked.lines().collect::<Vec<_>>(), expected);
    for shard in 0..count - 3 {
        run(&place, "plan", shard).succeeds();
    }
    let asked = submitted(&place, &path, &["--missing-only"]);
    assert_eq!(asked.lines().count(), 2, "{asked}");
    let stage = place.path().join("plan/slurm/stage-2.sh");
    assert!(fs::read_to_string(stage).expect("kept").contains("--array=6-8"));
    for name in ["stage-2", "merge"] {
        let script = place.path().join(format!("plan/slurm/{name}.sh"));
        let read = std::process::Command::new("bash").arg("-n").arg(script).status();
        assert!(read.expect("bash runs").success(), "{name}");
    }
    place.write("cluster.toml", "thread = 4\n");
    let args = ["cluster", "submit", "plan", "--engine", "slurm", "--config", "cluster.toml"];
    place.calib(&args).fails_with(2, &["thread", "cluster.toml"]);
}

/// Returns the displayed path of the script of a stage.
#[cfg(unix)]
fn script_of(stage: &str) -> String {
    format!("PLACE/plan/slurm/{stage}.sh")
}
