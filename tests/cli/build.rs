//! Builds of models: killed and resumed, within limited memory, with every search structure.

use std::{
    fs,
    path::Path,
    process::{Child, Stdio},
    thread,
    time::{Duration, Instant, SystemTime},
};

#[cfg(unix)]
use crate::harness::send;
use crate::harness::{Place, assert_same};

/// Returns a study with a log of a third of a million states, which are searched in five parts.
fn long_study() -> Place {
    let place = Place::new();
    let args = ["simulate", "data", "--days", "5", "--channels", "12", "--period", "1"];
    place.calib(&args).succeeds();
    let study = "[data]\npath = \"data\"\ntrain_fraction = 0.75\n\n[model]\nmembers = 3\n";
    place.write("study.toml", study);
    place
}

fn start(place: &Place, output: &str) -> Child {
    let args = ["build-model", "study.toml", "--output", output, "--threads", "1"];
    place.start(&args, Stdio::piped())
}

fn parts(directory: &Path) -> usize {
    let entries = fs::read_dir(directory.join("model/partial")).into_iter().flatten().flatten();
    entries.filter(|entry| entry.path().extension().is_some_and(|e| e == "part")).count()
}

/// Waits until `count` parts are saved; returns false if the build ends before.
fn wait_for_parts(child: &mut Child, directory: &Path, count: usize) -> bool {
    while parts(directory) < count {
        if child.try_wait().expect("a status").is_some() {
            return false;
        }
        thread::sleep(Duration::from_millis(1));
    }
    true
}

#[expect(
    clippy::disallowed_methods,
    reason = "the moments to kill are spread over the time of a build"
)]
#[test]
fn a_build_killed_ten_times_gives_the_same_bytes() {
    let place = long_study();
    let clock = Instant::now();
    assert!(start(&place, "whole").wait().expect("it ends").success());
    let whole = clock.elapsed();
    let directory = place.path().join("killed");
    let mut killed = 0;
    let mut seen = 0;
    // Kills come right after each part, then at moments spread over the whole build.
    for part in 1..=3 {
        let mut child = start(&place, "killed");
        if wait_for_parts(&mut child, &directory, part) {
            child.kill().expect("it was running");
            killed += 1;
        }
        child.wait().expect("a status");
        seen = seen.max(parts(&directory));
    }
    assert!(seen >= 3, "only {seen} parts were ever kept");
    for moment in 0..20 {
        if killed == 10 {
            break;
        }
        // Saved parts make the build shorter, so they are removed from time to
        // time, as after a change of the settings.
        if moment % 4 == 0 {
            let _ = fs::remove_dir_all(directory.join("model/partial"));
        }
        let mut child = start(&place, "killed");
        thread::sleep(whole.mul_f64(f64::from(moment * 7 % 19) / 19.0));
        killed += usize::from(child.try_wait().expect("a status").is_none());
        // A build that has ended cannot be killed, and starts again.
        let _ = child.kill();
        if child.wait().expect("a status").success() {
            fs::remove_file(directory.join("model/manifest.json")).expect("it was complete");
        }
    }
    assert!(killed >= 10, "killed {killed} times");
    place.calib(&["build-model", "study.toml", "--output", "killed", "--verify", "5"]).succeeds();
    assert_same(&place.content("whole"), &place.content("killed"));
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_the_parts_and_the_next_build_uses_them() {
    let place = long_study();
    let directory = place.path().join("stopped");
    let mut child = start(&place, "stopped");
    assert!(wait_for_parts(&mut child, &directory, 1));
    send("-INT", &child);
    place.ended("build-model", child).fails_with(130, &["run the same command again to go on"]);
    assert!(parts(&directory) >= 1);
    assert!(!directory.join("model/manifest.json").exists());
    place.calib(&["build-model", "study.toml", "--output", "stopped"]).succeeds();
    assert!(!directory.join("model/partial").exists(), "parts go when the tables are there");
    place.calib(&["build-model", "study.toml", "--output", "whole"]).succeeds();
    assert!(place.content("stopped") == place.content("whole"));
}

/// Kills a build while it judges the model, after its last table, and returns when its parts were written. `None` if
/// it had finished before the kill, as may happen on a busy machine.
fn kill_while_judging(place: &Place, directory: &Path) -> Option<Vec<SystemTime>> {
    let table = directory.join("model/members/2/distances.npy");
    let _ = fs::remove_file(&table);
    let mut child = start(place, "judged");
    while !table.exists() && child.try_wait().expect("a status").is_none() {
        thread::sleep(Duration::from_millis(1));
    }
    // It may have ended already.
    let _ = child.kill();
    child.wait().expect("a status");
    assert!(table.exists(), "the build ended without a table");
    if directory.join("model/manifest.json").exists() {
        return None;
    }
    let mut parts: Vec<_> = fs::read_dir(directory.join("model/partial"))
        .expect("parts are kept until the model is complete")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == "part"))
        .collect();
    parts.sort();
    Some(
        parts
            .into_iter()
            .map(|path| {
                fs::metadata(path).and_then(|metadata| metadata.modified()).expect("a time")
            })
            .collect(),
    )
}

#[test]
fn a_build_killed_while_judging_searches_nothing_again() {
    let place = long_study();
    // An approximate search makes the judgement long.
    place.edit_study("members = 3", "members = 3\nprototypes = 32");
    let directory = place.path().join("judged");
    // A build that ends before the kill removes its parts, so it has to start again.
    let killed = (0..20).find_map(|_| {
        let _ = fs::remove_dir_all(&directory);
        let first = kill_while_judging(&place, &directory)?;
        Some((first, kill_while_judging(&place, &directory)?))
    });
    let (first, second) = killed.expect("in one of twenty times it is killed while it judges");
    assert_eq!(first.len(), 5, "all of them");
    assert_eq!(second, first, "none was written again");
    place.calib(&["build-model", "study.toml", "--output", "judged", "--verify", "9"]).succeeds();
    assert!(!directory.join("model/partial").exists());
    place.calib(&["build-model", "study.toml", "--output", "whole"]).succeeds();
    assert!(place.content("judged") == place.content("whole"));
}

#[test]
fn parts_that_are_left_go_with_the_next_command_unless_another_calib_is_there() {
    let place = Place::with_study();
    place.on_study("build-model", &[]).succeeds();
    let before = place.content("study-results");
    let model = place.path().join("study-results/model");
    let part = model.join("partial/00000000.part");
    fs::create_dir(model.join("partial")).expect("writable");
    fs::write(&part, "of a build that began a moment ago").expect("writable");
    let lock = fs::File::open(model.join(".lock")).expect("it was claimed");
    lock.lock().expect("nobody has it");
    place.on_study("build-model", &[]).fails_with(2, &["another calib is writing to"]);
    assert!(part.exists(), "it is another's");
    drop(lock);
    assert!(place.on_study("build-model", &[]).succeeds().contains("up to date"));
    assert!(!model.join("partial").exists());
    assert!(place.content("study-results") == before);
}

#[test]
fn too_little_memory_is_refused_with_advice() {
    let place = Place::with_study();
    place
        .on_study("build-model", &["--memory", "100MiB"])
        .fails_with(2, &["takes", "100.0 MiB is there", "preprocess.subsample", "--memory"]);
    assert!(!place.path().join("study-results/model").exists(), "refused before anything is done");
    place.on_study("build-model", &["--memory", "lots"]).fails_with(2, &["16GiB"]);
    let told = place.on_study("build-model", &["--memory", "4GiB", "--dry-run", "--json"]);
    let plan = told.json(&[0]);
    assert_eq!(plan["available_bytes"], 4_u64 << 30);
    assert_eq!((&plan["spill"], &plan["members"]), (&"nothing".into(), &3.into()));
    assert!(plan["memory_bytes"].as_u64().expect("a number") > 300 << 20, "{plan}");
    assert!(told.stderr().contains("of 4.0 GiB there"), "{}", told.stderr());
    place.on_study("build-model", &[]).succeeds();
}

#[test]
fn approximate_tables_say_how_good_they_are() {
    let place = Place::with_study();
    for sets in [
        ["model.prototypes=4", "model.prototype_kind=every"],
        ["model.prototypes=4", "model.prototype_kind=k_centre"],
        ["model.leaf_budget=1", "model.prototypes=1"],
        ["model.components=4", "model.prototypes=1"],
    ] {
        let set = ["--set", sets[0], "--set", sets[1]];
        let built = place.on_study("build-model", &[&set[..], &["--verify", "30"]].concat());
        let told = built.succeeds();
        assert!(
            told.contains("approximate: recall@3 0.") || told.contains("recall@3 1."),
            "{told}"
        );
        assert!(built.stderr().contains("on 90 rows"), "{}", built.stderr());
        assert!(built.stderr().contains("the lists of 90 rows have"), "{}", built.stderr());
        let manifest = place.on_study("build-model", &[&set[..], &["--json"]].concat()).json(&[0]);
        assert_eq!(manifest["recall"]["rows"], 300);
        let (recall, interval) = (&manifest["recall"]["recall"], &manifest["recall"]["interval"]);
        assert!(number(&interval[0]) <= number(recall) && number(recall) <= number(&interval[1]));
        assert!(number(&interval[1]) - number(&interval[0]) < 0.13, "{interval}");
    }
    let args = ["build-model", "study.toml", "--set", "model.leaf_budget=2", "--index", "scan"];
    assert!(place.calib(&args).fails(2).contains("is for the join"));
}

fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().expect("a number")
}

#[test]
fn what_cannot_be_built_leaves_the_model_that_is_there() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let before = place.content("study-results");
    for (set, told) in [
        ("model.neighbors=2900", "possible neighbours"),
        ("model.neighbors=9000000000000000000", "possible neighbours"),
        ("model.components=500", "fewer than the"),
        ("model.members=4000", "transitions cannot be split"),
    ] {
        place.calib(&["build-model", "study.toml", "--set", set]).fails_with(2, &[told]);
        assert_eq!(place.content("study-results"), before);
        let dry = place.calib(&["build-model", "study.toml", "--set", set, "--dry-run"]).fails(2);
        assert!(dry.contains(told), "a plan of what is refused: {dry}");
    }
    let args = ["build-model", "study.toml", "--force", "--index", "kd-tree"];
    place.calib(&args).fails_with(2, &["at most 8 columns"]);
    assert_eq!(place.content("study-results"), before);
}

#[test]
fn structures_and_places_do_not_change_the_model() {
    let place = Place::with_study();
    place.on_study("build-model", &["-v", "--output", "plain"]).succeeds();
    let mut plain = place.content("plain");
    plain.remove(Path::new("model/manifest.json"));
    for (output, args, told, kept) in [
        ("join", ["--index", "join"], "join (asked for)", "join (asked for)"),
        ("scan", ["--index", "scan"], "scan (asked for)", "scan (asked for)"),
        ("set", ["--set", "model.index=scan"], "scan (asked for)", "scan (asked for)"),
        ("disk", ["--spill", "always"], "join (a join takes", "join (less work than a scan"),
    ] {
        let more = [&["-v", "--output", output][..], &args].concat();
        let built = place.on_study("build-model", &more);
        built.succeeds();
        assert!(built.stderr().contains(told), "{}", built.stderr());
        let mut content = place.content(output);
        let manifest = content.remove(Path::new("model/manifest.json")).expect("complete");
        assert!(String::from_utf8_lossy(&manifest).contains(kept));
        assert!(content == plain, "{output} differs");
        // It is the model of the study, whichever search structure built its tables or would build them now.
        place.calib(&["rollout", "study.toml", "--output", output]).succeeds();
        let other = ["rollout", "study.toml", "--output", output, "--set", "model.index=join"];
        place.calib(&other).succeeds();
    }
    let tree = ["-v", "--output", "tree", "--index", "kd_tree"];
    place.on_study("build-model", &tree).fails_with(2, &["at most 8 columns"]);
}
