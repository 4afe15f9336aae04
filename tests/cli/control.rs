//! Acting agents: from a log of decisions to a verdict.

use std::{collections::HashSet, fmt::Write as _, fs, path::Path, time::SystemTime};

use calib_files::{read_sealed_json, write_sealed_json};

use crate::harness::Place;

/// Returns a study of two agents on a log of cart-pole under a random policy.
pub(crate) fn place() -> Place {
    Place::with_pole(1500, 1500, 3)
}

#[test]
fn a_log_of_decisions_becomes_a_verdict() {
    let place = place();
    let study = "pole/study.toml";
    let ran = place.calib(&["control", study]);
    let shown = ran.ends(&[1]);
    let first = "Deploy nothing on this evidence.\n    step_size=0.3 is first by mean rank: ";
    assert!(shown.starts_with(first), "{shown}");
    let advice = shown.lines().take_while(|line| !line.contains("model return")).count();
    assert!(advice <= 5, "two lines, and up to three reasons: {shown}");
    assert!(!shown.contains("Best constant action"), "{shown}");
    assert!(ran.stderr().contains("all reasons: calib control pole/study.toml --why"));
    let told = place.calib(&["control", study, "--why"]).ends(&[1]);
    assert!(told.starts_with(first), "{told}");
    let parts = ["action=0", "action=1", "Over the default", "Best constant action"];
    for part in parts {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
    let ranks = "Ahead of the default by ";
    assert!(told.contains(ranks), "{ranks} is missing in {told}");
    assert_eq!(told.matches("Intervals over 3 blocks of the log are weak").count(), 1, "{told}");
    // No random episode has the return that the models promise.
    let part = "no recorded episode got more than";
    assert!(told.contains(part), "{part} is missing in {told}");
    let results = "pole/study-results/control";
    let first = place.content(results);
    let again = place.calib(&["control", study]);
    assert!(again.stderr().contains("up to date"), "{}", again.stderr());
    assert_eq!(again.ends(&[1]), shown, "what is there is told as it was");
    place.calib(&["control", study, "--force", "--threads", "1"]).ends(&[1]);
    assert!(place.content(results) == first, "the same bytes on one thread");
    // Files that show the verdict are made again from it.
    let report = place.path().join(results).join("report.html");
    fs::remove_file(&report).expect("a report");
    place.calib(&["control", study]).ends(&[1]);
    assert!(place.content(results) == first, "the report is back");
    let json = place.calib(&["control", study, "--json"]).json(&[1]);
    assert_eq!(json["transitions"], 1500);
    let decision = &json["decision"];
    assert_eq!(
        (&decision["support"], &json["is_ahead_of_default"]),
        (&"unsupported".into(), &false.into())
    );
    assert!(told.starts_with(decision["headline"].as_str().expect("a sentence")), "{decision}");
    let ranks = &json["verdict"]["ranks_over_default"];
    assert!(ranks["mean"].is_f64() && ranks["interval"]["low"].is_f64(), "{ranks}");
    assert_eq!(json["actions"].as_array().map(Vec::len), Some(2));
    assert_eq!(json["candidates"].as_array().map(Vec::len), Some(2));
    assert_eq!(json["columns"].as_array().map(Vec::len), Some(4), "no action, reward or terminal");
    // The log has the probabilities of actions, which allow importance sampling and the doubly robust estimate.
    let importance = json["importance_sampling"].as_array().expect("probabilities are logged");
    assert_eq!(importance.len(), 2);
    assert!(told.contains("importance") && told.contains("of episodes"), "{told}");
    let robust = json["doubly_robust"].as_array().expect("probabilities are logged");
    assert!(robust.len() == 2 && robust.iter().all(serde_json::Value::is_f64), "{robust:?}");
    assert!(told.contains("doubly robust"), "{told}");
    let report = fs::read_to_string(&report).expect("a report");
    assert!(report.contains("doubly robust"), "the column of the report");
    assert!(report.contains("The last steps of the chosen agent"), "its trajectory");
    assert!(place.path().join(results).join("last-steps.svg").is_file());
    // Another reward needs another verdict.
    let set = "control.reward=[{ column = 'angle', set_point = 0.0, weight = -1.0 }]";
    let other = place.calib(&["control", study, "--set", set, "--dry-run"]);
    assert!(!other.stderr().contains("up to date"), "{}", other.stderr());
    place.calib(&["check", "pole/study-results"]).succeeds();
}

/// Returns how many runs a folder has, which may not exist.
fn runs_in(units: &Path) -> usize {
    let entries = fs::read_dir(units).into_iter().flatten().flatten();
    entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with("run-"))
        .count()
}

#[test]
fn the_model_is_made_once_and_a_killed_sweep_goes_on() {
    let place = place();
    let study = "pole/study.toml";
    let args = ["control", study, "--threads", "1", "--set", "control.runs=3"];
    let results = place.path().join("pole/study-results");
    place.calib(&args).ends(&[1]);
    let whole = place.content("pole/study-results");
    fs::remove_dir_all(&results).expect("there");
    let units = results.join("control-units");
    let mut child = place.command(&args).spawn().expect("calib runs");
    while runs_in(&units) < 3 && child.try_wait().expect("a status").is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child.kill().expect("it was running, or has ended");
    child.wait().expect("a status");
    let status = ["status", study, "--set", "control.runs=3"];
    place.calib(&status).succeeds_with(&["settings: ", " of 54 runs"]);
    let again = place.calib(&args);
    again.ends(&[1]);
    let status = place.calib(&[&status[..], &["--json"]].concat()).json(&[0]);
    let ranking = &status["control"];
    assert_eq!(ranking["runs"], serde_json::json!([54, 54]));
    assert_eq!(ranking["members"], 9);
    let verdict = place.read_json("pole/study-results/control/verdict.json");
    let chosen = verdict["verdict"]["chosen"].as_u64().expect("a number") as usize;
    assert_eq!(
        ranking["settings"][0]["mean_rank"],
        verdict["verdict"]["selection"]["mean_ranks"][chosen]
    );
    assert!(again.stderr().contains("control-model is up to date"), "{}", again.stderr());
    assert!(place.content("pole/study-results") == whole, "the same bytes");
    assert_eq!(runs_in(&units), 0, "what was kept on the way is gone");
    // Another grid needs another verdict of the same model; another number of neighbours needs another model.
    let control = ["control", study];
    let grid = ["--set", "control.grid={ step_size = [0.1] }"];
    let other = place.calib(&[&control[..], &grid].concat());
    assert!(other.stderr().contains("control-model is up to date"), "{}", other.stderr());
    let neighbors = ["--set", "control.model.neighbors=2"];
    let other = place.calib(&[&control[..], &neighbors].concat());
    assert!(!other.stderr().contains("control-model is up to date"), "{}", other.stderr());
    place.calib(&["check", "pole/study-results"]).succeeds();
    fs::write(results.join("control-model/rewards.npy"), "damaged").expect("writable");
    place.calib(&["check", "pole/study-results"]).ends(&[1]);
    place.calib(&[&control[..], &neighbors, &["--force"]].concat()).ends(&[1]);
    place.calib(&["check", "pole/study-results"]).succeeds();
}

fn sweep_in_networks(place: &Place, more: &[&str]) {
    let args = ["control", "pole/study.toml", "--set", "control.models=['network']"];
    place.calib(&[&args[..], more].concat()).ends(&[0, 1]);
}

fn changed(path: &Path) -> SystemTime {
    fs::metadata(path).and_then(|file| file.modified()).expect("a file")
}

#[test]
fn networks_are_trained_once_and_kept_with_their_model() {
    let place = place();
    let folder = "pole/study-results/control-model";
    sweep_in_networks(&place, &[]);
    let first = place.content(folder);
    let networks =
        [0, 1, 2].map(|member| place.path_of(&format!("{folder}/network-{member}.safetensors")));
    let before = networks.each_ref().map(|path| changed(path));
    let bytes = networks.each_ref().map(|path| fs::read(path).expect("readable"));
    assert!(bytes[0] != bytes[1] && bytes[1] != bytes[2], "each member has its own");
    // Another grid is swept in the same networks.
    let grid = ["--set", "control.grid={ step_size = [0.1] }"];
    sweep_in_networks(&place, &grid);
    assert_eq!(networks.each_ref().map(|path| changed(path)), before);
    let check = ["check", "pole/study-results"];
    place.calib(&check).succeeds();
    let mut damaged = bytes[1].clone();
    *damaged.last_mut().expect("not empty") ^= 1;
    fs::write(&networks[1], damaged).expect("writable");
    let told = place.calib(&check).ends(&[1]);
    assert!(told.contains("network-1.safetensors") && told.contains("`calib control"), "{told}");
    // The verdict is up to date and needs no network, so the damaged one goes.
    sweep_in_networks(&place, &grid);
    assert!(!networks[1].exists());
    place.calib(&check).succeeds();
    sweep_in_networks(&place, &[]);
    assert!(place.content(folder) == first, "the missing one is made again");
    assert_eq!((changed(&networks[0]), changed(&networks[2])), (before[0], before[2]));
    sweep_in_networks(&place, &["--force"]);
    assert!(changed(&networks[0]) > before[0] && place.content(folder) == first, "the same bytes");
}

#[test]
fn what_the_log_does_not_support_is_refused() {
    let place = place();
    let study = "pole/study.toml";
    let strict = ["control", study, "--why", "--set", "control.fewest_terminals=100000"];
    let told = place.calib(&strict).ends(&[1]);
    assert!(told.contains(" in a terminal, and choices depend on what leads there; "), "{told}");
}

/// More neighbours than transitions means all transitions. If memory is too small, the error names the key.
#[test]
fn neighbours_without_bound_take_no_memory_without_bound() {
    let place = place();
    let neighbors = "--set=control.model.neighbors=1000000000";
    let args = ["control", "pole/study.toml", "--dry-run", neighbors];
    place.calib(&[&args[..], &["--set=control.model.members=3"]].concat()).succeeds();
    place
        .calib(&[&args[..], &["--set=control.model.members=1000000"]].concat())
        .fails_with(2, &["control.model.neighbors"]);
}

/// Returns the study of a pump with two speeds and forty rows, which is on in every other row from the first.
pub(crate) fn pump(line: impl Fn(usize) -> String) -> Place {
    let place = Place::new();
    let rows: Vec<String> = (0..40).map(line).collect();
    place.write("log.csv", &format!("timestamp,level,pump\n{}", rows.concat()));
    let control = "[control]\nactions = [\"pump\"]\nreward = [{ column = \"pump\", weight = -1 }]\nsteps = 50\n";
    let data = "[data]\npath = \"log.csv\"\ntrain_fraction = 1.0\n";
    place.write("study.toml", &format!("{data}[control.model]\nmembers = 2\n{control}"));
    place
}

/// Returns a row of the log of a pump.
pub(crate) fn row_of_pump(row: usize, pump: usize) -> String {
    format!("2024-03-01 00:{row:02}:00,{},{pump}\n", row % 7)
}

fn status(place: &Place) -> String {
    place.calib(&["status", "study.toml"]).succeeds()
}

#[test]
fn a_verdict_of_another_study_is_not_done() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    place.calib(&["control", "study.toml"]).ends(&[0, 1]);
    let done = status(&place);
    assert!(done.contains("every step is done") && done.contains("settings: "), "{done}");
    place.edit_study("steps = 50", "steps = 60");
    let edited = status(&place);
    let part = "the verdict in study-results/control was made with control.steps = 50, now 60; run `calib control study.toml` again";
    assert!(edited.contains("some steps are to do") && edited.contains(part), "{edited}");
    assert!(!edited.contains("settings: "), "no ranking of another study: {edited}");
    place.calib(&["control", "study.toml"]).ends(&[0, 1]);
    assert!(status(&place).contains("every step is done"), "{}", status(&place));
    // The log is the same and is read in the same way, so the existing verdict is also the verdict of this study.
    place.edit_study("[data]\n", "[data]\nshape = \"wide\"\n");
    assert!(status(&place).contains("data.shape"), "{}", status(&place));
    place.calib(&["control", "study.toml"]).ends(&[0, 1]);
    assert!(status(&place).contains("every step is done"), "{}", status(&place));
    // The files look as if a calib of the same version had used other inputs for its verdicts.
    for name in ["manifest.json", "verdict.json"] {
        let path = place.path().join("study-results/control").join(name);
        let mut sealed: serde_json::Value = read_sealed_json(&path).expect("sealed");
        sealed["key"] = "another".into();
        write_sealed_json(&path, &sealed).expect("writable");
    }
    let part = "the verdict in study-results/control was made with another calib; run `calib control study.toml` again";
    assert!(status(&place).contains(part), "{}", status(&place));
}

#[test]
fn a_verdict_of_another_log_is_not_done() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    place.calib(&["control", "study.toml"]).ends(&[0, 1]);
    assert!(status(&place).contains("every step is done"), "{}", status(&place));
    place.write("log.csv", &format!("{}{}", place.read("log.csv"), row_of_pump(40, 1)));
    let changed = status(&place);
    let part = "the log has changed since the verdict in study-results/control was made, by the size or the time of its files; \
                run `calib control study.toml` again";
    assert!(changed.contains("some steps are to do") && changed.contains(part), "{changed}");
    place.calib(&["control", "study.toml"]).ends(&[0, 1]);
    assert!(status(&place).contains("every step is done"), "{}", status(&place));
    // The log is rewritten with the same rows: `calib control` finds that the verdict is still valid.
    let log = place.read("log.csv");
    place.write("log.csv", &log);
    assert!(status(&place).contains(part), "{}", status(&place));
    let again = place.calib(&["control", "study.toml"]);
    again.ends(&[0, 1]);
    assert!(again.stderr().contains("is up to date"), "{}", again.stderr());
    assert!(status(&place).contains("every step is done"), "{}", status(&place));
    // Results of an earlier version do not identify the log.
    fs::remove_file(place.path().join("study-results/control/sources.json")).expect("there");
    place.write("log.csv", &log);
    assert!(status(&place).contains("every step is done"), "{}", status(&place));
}

const TWO_STEP_SIZES: [&str; 7] = [
    "control",
    "study.toml",
    "--set=control.timeout=20",
    "--set=control.steps=200",
    "--set=control.grid={ step_size = [0.03, 0.3] }",
    "--threads",
    "2",
];

#[test]
fn what_is_not_told_apart_from_the_default_is_not_deployed() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    let reward = "--set=control.reward=[{ column = \"pump\", weight = 0.5 }, { column = \"level\", weight = 0.5 }]";
    let told = place.calib(&[&TWO_STEP_SIZES[..], &[reward, "--why"]].concat()).ends(&[1]);
    assert!(told.starts_with("Deploy nothing on this evidence."), "{told}");
    for reason in [
        "no clear difference between the chosen setting and the default",
        " per episode in the models, and the chosen setting gets ",
    ] {
        assert!(told.contains(reason), "{reason} is missing in {told}");
    }
    let page = place.read("study-results/control/report.html");
    assert!(page.contains("Random actions get "));
}

/// Returns a corridor: five steps in a row lead to the goal, each by the other action than the step before. A wrong action leads back
/// to the first place. Every third episode is the shortest possible, and the others have random actions.
pub(crate) fn corridor() -> Place {
    let mut log = "timestamp,position,move,reward,goal\n".to_owned();
    let (mut position, mut episode, mut reward) = (0, 0, 0);
    let mut random = 1_u32;
    for row in 0..3000 {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let right = position % 2;
        let action = if episode % 3 == 0 { right } else { random >> 31 };
        let is_goal = position == 5;
        let [day, hour, minute] = [1 + row / 1440, row / 60 % 24, row % 60];
        let time = format!("2024-03-0{day} {hour:02}:{minute:02}:00");
        writeln!(log, "{time},{position},{action},{reward},{}", u8::from(is_goal)).expect("text");
        episode += u32::from(is_goal);
        reward = if is_goal { 0 } else { -1 };
        position = if is_goal || action != right { 0 } else { position + 1 };
    }
    let place = Place::new();
    place.write("log.csv", &log);
    let data = "[data]\npath = \"log.csv\"\nshape = \"wide\"\ntrain_fraction = 1.0\n[preprocess]\noutliers = \"keep\"\n";
    let control = "[control]\nactions = [\"move\"]\nterminal = \"goal\"\ntimeout = 10\nsteps = 3000\nmodels = [\"neighbors\"]\n";
    let agent = "[control.agent]\nstep_size = 0.1\n[control.grid]\ntemperature = [0.3, 100.0]\n";
    place.write("study.toml", &format!("{data}{control}{agent}"));
    place
}

/// Agents learn the way, unless their temperature is so high that they act at random.
#[test]
fn a_choice_that_the_log_supports_ends_with_0() {
    let place = corridor();
    for (default, headline) in [("0.3", "Keep the default: "), ("100.0", "Deploy ")] {
        let default = format!("--set=control.agent.temperature={default}");
        let ran = place.calib(&["control", "study.toml", "--json", &default]);
        let told = format!("{}{}", ran.stdout(), ran.stderr());
        let json = ran.json(&[0]);
        let decision = &json["decision"];
        assert_eq!(decision["support"], "supported", "{told}");
        let said = decision["headline"].as_str().expect("a sentence");
        assert!(said.starts_with(headline) && said.contains("0.3"), "{told}");
        assert_eq!(json["verdict"]["doubts"], serde_json::json!([]), "{told}");
    }
}

/// The exit code does not depend on the headline: "keep the default" is possible with both.
#[test]
fn the_exit_code_says_whether_anything_speaks_against_the_first_setting() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    let reward = "--set=control.reward=[{ column = \"pump\", weight = 0.5 }, { column = \"level\", weight = 0.5 }]";
    for default in ["0.03", "0.3"] {
        let default = format!("--set=control.agent.step_size={default}");
        let ran = place.calib(&[&TWO_STEP_SIZES[..], &[reward, &default, "--json"]].concat());
        let json = ran.json(&[0, 1]);
        let is_supported = json["decision"]["support"] == "supported";
        assert_eq!(ran.code(), i32::from(!is_supported), "{}", json["decision"]);
        assert!(is_supported || ran.stderr().contains("warning: "), "{}", ran.stderr());
    }
}

/// The action "off" costs nothing, but an agent has to try both actions to learn it.
#[test]
fn a_constant_action_that_gets_more_is_named() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    let shown = place.calib(&TWO_STEP_SIZES).ends(&[1]);
    assert!(shown.starts_with("Deploy nothing on this evidence."), "{shown}");
    assert!(shown.contains("\n    always taking pump=0 gets "), "{shown}");
    let told = place.calib(&[&TWO_STEP_SIZES[..], &["--why"]].concat()).ends(&[1]);
    assert!(told.contains("Best constant action: always pump=0 gets "), "{told}");
    let json = [&TWO_STEP_SIZES[..], &["--json"]].concat();
    let json = place.calib(&json).json(&[1]);
    let constant = &json["verdict"]["constant"];
    assert_eq!(constant["action"], 0);
    assert!(constant["mean_return"].as_f64().expect("a number").abs() < 0.01, "{constant}");
}

#[test]
fn neighbours_can_be_near_in_a_representation() {
    let place = place();
    let study = "pole/study.toml";
    let section = "representation={ dimension = 4, hidden_units = 16, batch_size = 32, learning_rate = 3e-3, steps = 300 }";
    let held_out = "data.train_fraction=0.8";
    let set = ["--set", "control.model.distance='laplacian'", "--set", section, "--set", held_out];
    let control = [&["control", study][..], &set].concat();
    let inspected = place.calib(&[&["inspect", study, "--json"][..], &set].concat());
    assert!(inspected.stderr().contains("distances are those of states"), "{}", inspected.stderr());
    let json = place.calib(&[&control[..], &["--json"]].concat()).json(&[0, 1]);
    let period = &json["held_out"][0];
    assert!(period["decisions"].as_u64().is_some_and(|decisions| decisions > 100), "{period}");
    // The same policy acts in the same plant.
    assert!(period["uncovered"].as_f64().is_some_and(|share| share < 0.5), "{period}");
    let representation = "pole/study-results/control-representation";
    let first = place.content("pole/study-results/control");
    let psi = place.content(representation);
    let again = place.calib(&control);
    assert!(again.stderr().contains("up to date"), "{}", again.stderr());
    place.calib(&[&control[..], &["--force", "--threads", "1"]].concat()).ends(&[0, 1]);
    assert!(place.content("pole/study-results/control") == first, "the same bytes on one thread");
    assert!(place.content(representation) == psi, "and the same representation");
    let json = place.calib(&[&["inspect", study, "--json"][..], &set].concat()).json(&[0]);
    assert_eq!(json["control"]["distance"], "laplacian", "what was trained is used");
    let page = place.read("pole/study-results/control/report.html");
    assert!(page.contains("Representations"));
    place.calib(&["check", "pole/study-results"]).succeeds();
    // Another representation needs another verdict.
    let longer = ["--set", "representation.steps=301", "--dry-run"];
    let other = place.calib(&[&control[..], &longer].concat());
    assert!(!other.stderr().contains("up to date"), "{}", other.stderr());
}

/// Whether a file is a network of a model with actions.
fn is_network(name: &Path) -> bool {
    name.file_name().is_some_and(|name| name.to_string_lossy().starts_with("network-"))
}

#[test]
fn what_is_damaged_is_found_and_made_again() {
    let place = place();
    let section =
        "representation={ kind = 'laplacian', steps = 200, dimension = 3, hidden_units = 8 }";
    let set = ["--set", "control.model.distance='laplacian'", "--set", section];
    let args = [&["control", "pole/study.toml", "-q"][..], &set].concat();
    place.calib(&args).ends(&[0, 1]);
    let whole = place.content("pole/study-results");
    let figures =
        whole.keys().filter(|name| name.extension().is_some_and(|ending| ending == "svg"));
    assert!(figures.count() > 0, "there are figures");
    let mut kinds_made_again = HashSet::new();
    for name in whole.keys().filter(|name| !name.ends_with(".lock")) {
        let path = place.path().join("pole/study-results").join(name);
        let Ok(mut bytes) = fs::read(&path) else {
            assert!(is_network(name), "{}", name.display());
            continue;
        };
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x10;
        fs::write(&path, bytes).expect("writable");
        let found = place.calib(&["check", "pole/study-results"]);
        let told = found.ends(&[1]);
        assert!(
            told.contains("`calib control STUDY` makes it again"),
            "{}: {told}",
            name.display()
        );
        // One command makes all arrays of a folder, and all figures: one of them is made again, the others are put back.
        let ending = name.extension();
        let is_alike = !kinds_made_again.insert((name.parent(), ending));
        if is_alike && ending.is_some_and(|ending| ending == "npy" || ending == "svg") {
            fs::write(&path, &whole[name]).expect("writable");
            continue;
        }
        place.calib(&args).ends(&[0, 1]);
        // Networks are trained when they are next used: until then a damaged one, or one of tables that were made again, is absent.
        let again = place.content("pole/study-results");
        let is_as_before = whole.iter().all(|(name, bytes)| match again.get(name) {
            Some(now) => now == bytes,
            None => is_network(name),
        });
        assert!(is_as_before && again.len() <= whole.len(), "{}", name.display());
    }
    place.calib(&["check", "pole/study-results"]).succeeds();
}

#[test]
fn a_damaged_verdict_is_named_before_its_runs_are_made_again() {
    let place = place();
    let args = ["control", "pole/study.toml"];
    place.calib(&args).ends(&[0, 1]);
    let results = "pole/study-results/control";
    let whole = place.content(results);
    let dry = [&args[..], &["--dry-run"]].concat();
    for name in ["manifest.json", "runs.parquet", "verdict.json"] {
        let path = place.path_of(&format!("{results}/{name}"));
        let written = fs::read(&path).expect("readable");
        let mut damaged = written.clone();
        let middle = damaged.len() / 2;
        damaged[middle] ^= 0x10;
        fs::write(&path, &damaged).expect("writable");
        let told = format!("control/{name} is damaged: ");
        let ran = place.calib(&dry);
        assert!(ran.stderr().contains(&told), "{}", ran.stderr());
        let forced = place.calib(&[&dry[..], &["--force"]].concat());
        assert!(!forced.stderr().contains(&told), "{}", forced.stderr());
        fs::write(&path, &written).expect("writable");
    }
    let verdict = place.path_of(&format!("{results}/verdict.json"));
    fs::write(&verdict, "no JSON").expect("writable");
    let ran = place.calib(&args);
    ran.ends(&[0, 1]);
    let told = ran.stderr();
    for part in ["verdict.json is damaged", "its runs have to be made again"] {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
    assert!(place.content(results) == whole, "the same bytes");
    let again = place.calib(&args);
    assert!(!again.stderr().contains("is damaged"), "{}", again.stderr());
}

#[test]
fn a_torque_is_chosen_among_levels_of_its_range() {
    let place = Place::new();
    let args = ["simulate", "swing", "--task", "pendulum", "--policy", "random"];
    place.calib(&[&args[..], &["--transitions", "1500"]].concat()).succeeds();
    let study = "swing/study.toml";
    let told = place.calib(&["inspect", study]).succeeds();
    for part in ["torque", "least", "largest", "nearest level", "torque=-2", "torque=2"] {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
    let few = ["--set", "control.steps=400", "--set", "control.model.members=2"];
    let grid = ["--set", "control.grid={ step_size = [0.03, 0.3] }"];
    let args = [&["control", study, "--json"][..], &few, &grid].concat();
    let json = place.calib(&args).json(&[0, 1]);
    assert_eq!(json["actions"].as_array().map(Vec::len), Some(7));
    assert_eq!(json["settings"][0]["column"], "torque");
    let heavier = [&args[..], &["--set", "control.model.action_weight=3"]].concat();
    let other = place.calib(&heavier).json(&[0, 1]);
    assert_ne!(json["verdict"]["members"], other["verdict"]["members"], "the weight counts");
    let text = place.read(study);
    place.write(study, &text.replace("levels = 7", "most_actions = 64"));
    place.calib(&["control", study]).fails_with(2, &["control.levels"]);
}

/// Asserts that a sweep refuses a key set, and returns the error message.
fn refused(place: &Place, set: &str) -> String {
    place.calib(&["control", "pole/study.toml", "--set", set]).fails(2)
}

#[test]
fn mistakes_in_the_section_say_what_to_do() {
    let place = place();
    let told = refused(&place, "control.actions=['acton']");
    assert!(told.contains("acton") && told.contains("did you mean action"), "{told}");
    for set in ["actions=['qqq']", "reward='qqq'", "terminal='qqq'", "probability='qqq'"] {
        let told = refused(&place, &format!("control.{set}"));
        let (key, _) = set.split_once('=').expect("a key");
        let expected = format!("control.{key}: the log has no column qqq; give one of its columns");
        assert!(told.contains(&expected), "{told}");
    }
    let told = refused(&place, "control.actions=[]");
    assert!(told.contains("name the columns of the action"), "{told}");
    let told = refused(&place, "control.actions=['angle']");
    assert!(told.contains("more than 64 different actions"), "{told}");
    let told = refused(&place, "preprocess.subsample=2");
    assert!(told.contains("subsample") && told.contains("its own row"), "{told}");
    let told = refused(&place, "control.probability='angular_speed'");
    assert!(told.contains("control.probability") && told.contains("up to 1"), "{told}");
    let told = refused(&place, "control.agent.temperature=0");
    assert!(told.contains("temperature"), "{told}");
    place.calib(&["simulate", "pole", "--task", "cart-pole"]).fails_with(2, &["--force"]);
    let told = place.calib(&["simulate", "x", "--task", "acrobot", "--days", "3"]).fails(2);
    assert!(told.contains("of the plant"), "{told}");
    place.write("plain.toml", "[data]\npath = \"pole/log.parquet\"\n");
    place.calib(&["control", "plain.toml"]).fails_with(2, &["[control]"]);
}

#[test]
fn a_plant_that_somebody_operates_is_logged_and_inspected() {
    let place = Place::new();
    let args = ["simulate", "plant", "--task", "membrane", "--policy", "perturbed"];
    place.calib(&[&args[..], &["--transitions", "1500"]].concat()).succeeds();
    let study = "plant/study.toml";
    let told = place.calib(&["inspect", study]).succeeds();
    for part in [
        "DOSE_MG_L=2",
        "known in states",
        "taken where",
        "for agents that act: 1,500 transitions",
        "; states of 4 columns, without what they do and get",
        " a step; recorded episodes: mean return ",
        "; spread of returns ",
        " (gamma 0.99)",
    ] {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
    let json = place.calib(&["inspect", study, "--json"]).json(&[0]);
    let control = &json["control"];
    assert_eq!(control["actions"].as_array().map(Vec::len), Some(8));
    assert_eq!(control["columns"].as_array().map(Vec::len), Some(4), "accounts are no state");
    assert_eq!(control["reward"]["gamma"], 0.99);
    assert!(control["reward"]["return_spread"].as_f64() > Some(0.0), "{}", control["reward"]);
    // A network beside tile coding, in few steps; the page has figures and loads nothing.
    let set = "control.grid={ algorithm = ['expected_sarsa', 'deep_q_learning'] }";
    let few = ["--set", "control.steps=600", "--set", "control.model.members=2"];
    place.calib(&[&["control", study, "--set", set][..], &few].concat()).ends(&[0, 1]);
    let page = place.read("plant/study-results/control/report.html");
    assert!(page.contains("Where along TURBIDITY_NTU actions are known"));
    assert!(!page.contains("src=\"http"), "loads nothing");
    let told = place.calib(&["simulate", "x", "--task", "acrobot", "--policy", "rule"]).fails(2);
    assert!(told.contains("nobody operates acrobot"), "{told}");
}
