//! Studies without a model: log replay alone decides.

use std::{fmt::Write as _, fs};

use crate::harness::{Place, Ran};

const NONE: [&str; 2] = ["--set", "model.kind=none"];

/// Words about models, which must not occur in such a study.
const OF_MODELS: [&str; 7] =
    ["model", "member", "ensemble", "rollout", "jump", "neighbour", "worst rank"];

/// Runs `calib COMMAND study.toml` with more arguments.
fn calib(place: &Place, command: &[&str], more: &[&str]) -> Ran {
    place.calib(&[command, &["study.toml"], more].concat())
}

/// Removes all keys about models from `study.toml`.
fn without_model(place: &Place) {
    place.edit_study(
        "members = 3\nexclude_self = true\n\n[rollout]\nsteps = 400\nrollouts = 2\n",
        "kind = \"none\"\n",
    );
    place.edit_study("member_runs = 2\n", "");
}

/// Returns the words about models in a text, except for the key that removes the model.
fn said_of_models(text: &str) -> Vec<String> {
    let lower = text.to_lowercase().replace("model.kind", "").replace("[model]", "");
    let lines = lower.lines().filter(|line| OF_MODELS.iter().any(|word| line.contains(word)));
    lines.map(str::to_owned).collect()
}

/// Returns the visible words of a page.
fn words_of(page: &str) -> String {
    let body =
        &page[page.find("<main").expect("a page")..page.rfind("<script>").expect("a script")];
    let study = body.find("id=\"reproduce\"").expect("how to make it again");
    let mut words = String::new();
    for piece in body[..study].split('<').skip(1) {
        words.push_str(piece.split_once('>').map_or("", |(_, text)| text));
        words.push('\n');
    }
    words
}

#[test]
fn the_replayed_log_decides_alone_from_the_log_to_the_report() {
    let place = Place::with_study();
    without_model(&place);
    let dry = calib(&place, &["run"], &["--dry-run"]);
    dry.succeeds();
    let said = dry.stderr();
    assert!(said.contains("to do: reading the log, sweep, evaluate"), "{said}");
    assert!(said.contains("[1/2] sweep") && said.contains("[2/2] evaluate"), "{said}");
    assert!(said.contains("expecting about"), "{said}");
    assert_eq!(said_of_models(&said), Vec::<String>::new());

    let ran = calib(&place, &["run"], &[]);
    let verdict = ran.ends(&[0, 1]);
    assert!(verdict.contains("PIT300") && verdict.contains("TIT101"), "{verdict}");
    assert_eq!(said_of_models(&verdict), Vec::<String>::new());
    assert_eq!(said_of_models(&ran.stderr()), Vec::<String>::new());
    let results = place.path().join("study-results");
    for absent in ["model", "rollout", "representation"] {
        assert!(!results.join(absent).exists(), "{absent} was made");
    }
    let page = place.read("study-results/report.html");
    let words = words_of(&page);
    assert_eq!(said_of_models(&words), Vec::<String>::new());
    assert!(words.contains("windows of the replayed log"), "the log decided: {words}");
    assert!(
        page.contains("calib sweep study.toml") && !page.contains("calib build-model"),
        "the steps"
    );

    let why = calib(&place, &["evaluate"], &["--why"]).ends(&[0, 1]);
    assert!(why.contains("as a geometric mean over 2 windows of the replayed log."), "{why}");
    assert_eq!(said_of_models(&why), Vec::<String>::new());
    let summary = calib(&place, &["evaluate"], &["--json", "-q"]).json(&[0, 1]);
    for verdict in summary["verdicts"].as_array().expect("a list") {
        assert_eq!(verdict["rule"], "log_replay");
        assert_eq!(verdict["members"], serde_json::json!([]));
        assert!(verdict.get("selection").is_none(), "there is nothing to rank in: {verdict}");
        assert!(!verdict["stability"].as_array().expect("a list").is_empty());
    }
    let status = calib(&place, &["status"], &[]).succeeds();
    assert!(status.contains("every step is done"), "{status}");
    assert_eq!(said_of_models(&status), Vec::<String>::new());
    let checked = place.calib(&["check", "study-results"]).succeeds();
    assert!(checked.ends_with("damaged or missing: 0\n"), "{checked}");
    let again = calib(&place, &["run"], &["--dry-run"]).stderr();
    assert!(again.contains("up to date: reading the log, sweep"), "{again}");
}

/// The choice equals that of the same study with a model, which this rule ignores. The runs on the log are the same.
#[test]
fn the_choice_is_that_of_log_replay_beside_a_model() {
    let place = Place::with_study();
    let rule = ["--set", "evaluate.rule=log_replay"];
    calib(&place, &["run"], &rule).ends(&[0, 1]);
    let beside = calib(&place, &["evaluate", "--json", "-q"], &rule).json(&[0, 1]);
    calib(&place, &["evaluate"], &NONE).fails_with(2, &["model.kind = \"knn\", now \"none\""]);
    let swept = calib(&place, &["sweep"], &NONE).succeeds();
    assert!(swept.contains("up to date"), "no run is left to make: {swept}");
    let alone = calib(&place, &["evaluate", "--json", "-q"], &NONE).json(&[0, 1]);
    assert_eq!(alone["choices"][0]["values"], beside["choices"][0]["values"]);
    assert_eq!(alone["verdicts"][0]["log_replay"], beside["verdicts"][0]["log_replay"]);
    assert_eq!(alone["verdicts"][0]["truth"], beside["verdicts"][0]["truth"]);
    // An existing model does not belong to a study without a model, and neither do its rollouts.
    assert!(place.path().join("study-results/rollout").exists());
    assert_eq!(said_of_models(&alone["notes"].to_string()), Vec::<String>::new());
}

#[test]
fn steps_of_a_model_say_that_there_is_none() {
    let place = Place::with_study();
    for step in ["build-model", "rollout", "represent"] {
        let told = calib(&place, &[step], &NONE).fails(2);
        assert!(told.contains("the study has no model (model.kind = \"none\")"), "{told}");
        let next = "calib sweep study.toml --set 'model.kind=none'";
        assert!(told.contains(next) && told.contains("model.kind = \"knn\""), "{told}");
    }
    for (key, told) in [
        ("model.members=2", "model.members has no effect"),
        ("sweep.member_runs=2", "sweep.member_runs has no effect"),
        ("rollout.start=recent", "rollout.start has no effect"),
        ("evaluate.rule=worst_rank", "evaluate.rule = \"worst_rank\" counts runs in a model"),
        ("sweep.log_replay_runs=0", "nothing would decide"),
    ] {
        calib(&place, &["sweep"], &[&NONE[..], &["--set", key]].concat()).fails_with(2, &[told]);
    }
    let windows = ["--set", "data.train_fraction=0.02", "--set", "agent.gamma=0.99"];
    let short = calib(&place, &["run"], &[&NONE[..], &windows].concat());
    short.fails_with(2, &["no window of the training range can be replayed"]);
    place.write("validity.toml", &place.read("study.toml"));
    let refused = place.calib(&[&["validity", "validity.toml"], &NONE[..]].concat()).fails(2);
    assert!(refused.contains("validity compares the choices of models"), "{refused}");
}

/// Other features without a model: pre-trained agents, several deployments, a race.
#[test]
fn pretraining_deployments_and_races_need_no_model() {
    let place = Place::with_study();
    without_model(&place);
    place.edit_study("log_replay_runs = 2", "log_replay_runs = 9\nrace = \"halving\"");
    place.edit_study("[agent]", "[pretrain]\nepochs = 3\n\n[agent]");
    place.edit_study(
        "train_fraction = 0.7",
        "train = { end = 2022-11-03 }\n\n[deployments]\nfirst = { start = 2022-11-03, end = 2022-11-03T12:00:00 }\n\
         second = { start = 2022-11-03T12:00:00, end = 2022-11-04 }",
    );
    place.edit_study("steps = 800", "steps = 500");
    let ran = calib(&place, &["run"], &[]);
    let verdict = ran.ends(&[0, 1]);
    assert!(verdict.contains("what to deploy"), "{verdict}{}", ran.stderr());
    assert!(ran.stderr().contains("are left for log replay"), "{}", ran.stderr());
    assert!(ran.stderr().contains("log replay replays"), "{}", ran.stderr());
    assert!(ran.stderr().contains("[2/3] sweep"), "{}", ran.stderr());
    assert_eq!(said_of_models(&verdict), Vec::<String>::new());
    assert_eq!(said_of_models(&ran.stderr()), Vec::<String>::new());
    for page in ["report.html", "deployments/first/report.html"] {
        let page = place.read(&format!("study-results/{page}"));
        assert_eq!(said_of_models(&words_of(&page)), Vec::<String>::new());
    }
    let summary = calib(&place, &["evaluate"], &["--json", "-q"]).json(&[0, 1]);
    assert_eq!(summary["deployments"].as_array().map(Vec::len), Some(2));
}

#[test]
fn shards_and_killed_sweeps_give_the_bytes_of_one_process() {
    let place = Place::with_study();
    without_model(&place);
    calib(&place, &["sweep"], &[]).succeeds();
    let alone = place.content("study-results");
    let sweep = place.path().join("study-results/sweep");
    // The state after a kill: some units exist, and no manifest.
    fs::remove_file(sweep.join("manifest.json")).expect("there");
    fs::remove_file(sweep.join("units/PIT300/log-replay/run-0001.json")).expect("there");
    fs::remove_file(sweep.join("profile.json")).expect("there");
    calib(&place, &["sweep"], &[]).succeeds_with(&["3 training runs made"]);
    assert!(place.content("study-results") == alone);

    fs::remove_dir_all(&sweep).expect("there");
    calib(&place, &["cluster", "plan"], &["--shards", "3", "-o", "plan"]).succeeds();
    // A shard reads neither a log nor results of the study.
    for hidden in ["data", "study-results"] {
        let to = place.path().join(format!("hidden-{hidden}"));
        fs::rename(place.path().join(hidden), to).expect("moved");
    }
    for shard in ["2", "0", "1"] {
        let ran = place.calib(&["cluster", "run", "plan", "--shard", shard, "--threads", "1"]);
        assert!(ran.succeeds().contains("is done"));
    }
    for hidden in ["data", "study-results"] {
        let from = place.path().join(format!("hidden-{hidden}"));
        fs::rename(from, place.path().join(hidden)).expect("moved");
    }
    let merged = place.calib(&["cluster", "merge", "plan"]);
    merged.succeeds();
    assert_eq!(said_of_models(&merged.stderr()), Vec::<String>::new());
    assert!(place.content("study-results") == alone);
    calib(&place, &["evaluate"], &[]).ends(&[0, 1]);
}

/// An input whose unit changes spoils a verdict, even if no agent predicts it.
#[test]
fn an_input_that_breaks_in_the_held_out_period_is_told_once() {
    let mut log = String::from("time,level,height\n");
    for row in 0..1_200 {
        let unit = if row < 900 { 1 } else { 1_000 };
        writeln!(log, "{},{},{}", 1_704_067_200 + row, row % 11, row % 7 * unit).expect("memory");
    }
    let place = Place::new();
    place.write("log.csv", &log);
    place.write(
        "study.toml",
        r#"
[data]
path = "log.csv"
train_fraction = 0.7

[model]
kind = "none"

[agent]
value_function = "linear"
gamma = 0.5
learning_rate = 1e-8

[sweep]
sensors = ["level"]
steps = 150
online_runs = 1
log_replay_runs = 1

[sweep.grid]
learning_rate = [0, 1e-8]
"#,
    );
    let told = "columns that agents read are far outside of their training range";
    let ran = calib(&place, &["run"], &[]).ends(&[0, 1]);
    assert_eq!(ran.matches(told).count(), 1, "{ran}");
    let summary = calib(&place, &["evaluate"], &["--json", "-q"]).json(&[0, 1]);
    let notes = summary["notes"].as_array().expect("a list");
    let doubt = notes[0].as_str().expect("a sentence");
    assert!(doubt.contains(told) && doubt.contains("height ("), "{summary}");
    let page = place.read("study-results/report.html");
    let (_, before) = page.split_once("Before you rely on this").expect("a box");
    assert!(before.contains(told), "{before}");
}
