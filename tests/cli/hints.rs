//! Commands that calib suggests can be pasted, and mean the same run. A run
//! belongs to one study, whatever happens to its file.

use std::{
    env, fs,
    io::{BufRead as _, BufReader, Read as _},
    path::Path,
    process::{Command, Output, Stdio},
};

use crate::harness::Place;

/// The options of a command that identify a run.
const GIVEN: [&str; 9] = [
    "--profile",
    "small",
    "--set",
    "agent.gamma=0.8",
    "--set",
    "sweep.sensors=[\"PIT300\"]",
    "--output",
    "it's here",
    "--quiet",
];

/// Runs the command in backticks or after `next:`, as a shell would.
fn paste(place: &Place, line: &str) -> Output {
    let binary = Path::new(env!("CARGO_BIN_EXE_calib"));
    let folder = binary.parent().expect("in a folder").display();
    let path = format!("{folder}:{}", env::var("PATH").unwrap_or_default());
    let mut shell = Command::new("sh");
    shell.args(["-c", line]).current_dir(place.path()).env("PATH", path).env_remove("CALIB_DATA");
    shell.output().expect("sh runs")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Returns the commands after `next:` and `or:`.
fn next(text: &str) -> Vec<String> {
    text.lines()
        .filter_map(|line| {
            let line = line.trim();
            line.strip_prefix("next: ").or(line.strip_prefix("or: ")).map(str::to_owned)
        })
        .collect()
}

/// Returns the command that an error suggests.
fn told(text: &str) -> Option<String> {
    let error = &text[text.find("error: ")?..];
    error.split('`').skip(1).step_by(2).find(|words| words.starts_with("calib ")).map(str::to_owned)
}

/// Runs `line`, and first the commands that its errors suggest, until it succeeds. Returns the commands run before it.
fn follow(place: &Place, line: &str) -> Vec<String> {
    let mut before = Vec::new();
    loop {
        let output = paste(place, line);
        if output.status.success() {
            return before;
        }
        let text = stderr(&output);
        let hint = told(&text).unwrap_or_else(|| panic!("{line} says nothing to run: {text}"));
        assert!(before.len() < 20, "{line} leads in circles: {before:?}");
        assert!(hint.contains("gamma"), "a hint without what was given: {hint}");
        let also = follow(place, &hint);
        before.extend(also);
        before.push(hint);
    }
}

/// Returns a study with a plant, a profile, two models, two deployments, pre-training and representations.
fn everything() -> Place {
    let place = Place::with_plant();
    place.edit_study(
        "train_fraction = 0.7",
        "train = { start = 2022-11-01, end = 2022-11-03 }\n\n[deployments.early]\nstart = 2022-11-03\nend = 2022-11-03T12:00:00\n\n\
         [deployments.late]\nstart = 2022-11-03T12:00:00\nend = 2022-11-04\n\n[models.a]\nmodel.members = 2\n\n\
         [models.b]\nrepresentation = { kind = \"laplacian\", steps = 60, dimension = 4 }\n\n\
         [profiles.small]\nsweep.steps = 300\nsweep.online_runs = 2\nsweep.member_runs = 1\npretrain.epochs = 2\n",
    );
    place
}

#[test]
fn errors_say_what_to_run_with_all_that_was_given() {
    let place = everything();
    let given = "--profile small --set agent.gamma=0.8 --set 'sweep.sensors=[\"PIT300\"]' --output \"it's here\"";
    let line = format!("calib evaluate study.toml {given} --model b --deployment late");
    let before = follow(&place, &line);
    let commands: Vec<&str> = before.iter().filter_map(|ran| ran.split(' ').nth(1)).collect();
    for command in ["simulate", "represent", "build-model", "pretrain", "sweep"] {
        assert!(commands.contains(&command), "{before:?}");
    }
    // Results exist only in this folder, and only for these options.
    assert!(!place.path().join("study-results").exists());
    let sweep = place.read_json("it's here/models/b/deployments/late/sweep/manifest.json");
    assert_eq!(sweep["study"]["agent"]["gamma"], 0.8);
    assert!(!place.path().join("it's here/models/a").exists());
    // Suggestions about results with other settings have the same options.
    let other = line.replace("gamma=0.8", "gamma=0.7");
    let before = follow(&place, &other);
    assert!(before.iter().all(|ran| ran.contains("agent.gamma=0.7")), "{before:?}");
    assert!(before.iter().any(|ran| ran.starts_with("calib sweep")), "{before:?}");
    // So have suggestions about damaged results.
    let rows = place.path().join("it's here/models/b/model/rows.parquet");
    let whole = fs::read(&rows).expect("there");
    fs::write(&rows, &whole[..whole.len() / 2]).expect("writable");
    let before = follow(&place, &other.replace("calib evaluate", "calib rollout"));
    assert_eq!(before.len(), 1, "{before:?}");
}

#[test]
fn what_comes_next_is_of_the_same_run() {
    let place = everything();
    let mut first = vec!["simulate", "study.toml"];
    first.extend(&GIVEN[..6]);
    let hints = next(&place.calib(&first).stderr());
    assert_eq!(hints.len(), 1, "calib run");
    assert!(hints[0].starts_with("calib run") && hints[0].contains("small"), "{hints:?}");
    let commands = [
        ("represent", vec!["--model", "b"], vec!["build-model"]),
        ("build-model", vec!["--model", "b"], vec!["rollout", "sweep"]),
        ("pretrain", vec![], vec!["build-model", "sweep"]),
        ("rollout", vec!["--model", "b"], vec!["sweep"]),
        ("sweep", vec!["--model", "b", "--deployment", "late"], vec!["evaluate"]),
    ];
    for (command, part, expected) in commands {
        let args = [vec![command, "study.toml"], GIVEN[..8].to_vec(), part.clone()].concat();
        let ran = place.calib(&args);
        ran.succeeds();
        let hints = next(&ran.stderr());
        let told: Vec<&str> = hints.iter().filter_map(|hint| hint.split(' ').nth(1)).collect();
        assert_eq!(told, expected, "{command}: {hints:?}");
        // If their inputs are missing, pasted commands say so, and name the same run.
        for hint in &hints {
            let dry = paste(&place, &format!("{hint} --dry-run"));
            let text = stderr(&dry);
            assert!(!text.contains(", now "), "{hint}: {text}");
            assert!(dry.status.success() || told_of_the_same(&text), "{hint}: {text}");
        }
    }
    let evaluated = [vec!["evaluate", "study.toml"], GIVEN.to_vec()].concat();
    let part = ["--model", "b", "--deployment", "late"];
    place.calib(&[evaluated, part.to_vec()].concat()).succeeds();
    assert!(!place.path().join("study-results").exists());
}

fn told_of_the_same(text: &str) -> bool {
    told(text).is_some_and(|hint| {
        ["--profile small", "agent.gamma=0.8", "PIT300", "it's here"]
            .iter()
            .all(|given| hint.contains(given))
    })
}

#[test]
fn a_study_that_is_edited_during_a_run_is_not_mixed_with_itself() {
    let place = Place::with_study();
    let mut child = place.start(&["run", "study.toml"], Stdio::piped());
    let mut lines = BufReader::new(child.stderr.take().expect("piped"));
    let mut line = String::new();
    while lines.read_line(&mut line).expect("readable") > 0
        && !line.trim().ends_with("] build-model")
    {
        line.clear();
    }
    assert!(line.trim().ends_with("] build-model"), "the run begins with its first step");
    place.edit_study("gamma = 0.9", "gamma = 0.5");
    place.edit_study("members = 3", "members = 2");
    let mut rest = String::new();
    lines.read_to_string(&mut rest).expect("readable");
    let status = child.wait().expect("a status");
    assert!(status.success(), "{rest}");
    for step in ["model", "rollout", "sweep"] {
        let manifest = place.read_json(&format!("study-results/{step}/manifest.json"));
        let study = &manifest["study"];
        assert_eq!(study["agent"]["gamma"], 0.9, "{step}");
        assert_eq!(study["model"]["members"], 3, "{step}");
    }
    // The next command uses the study as it is now, and says so.
    place.calib(&["evaluate", "study.toml"]).fails_with(2, &["run `calib sweep study.toml` again"]);
}
