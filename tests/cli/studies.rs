//! Studies that run as a whole, on a plant that they describe themselves.

use crate::harness::Place;

#[test]
fn one_command_runs_a_study_from_its_plant_to_the_verdict() {
    let place = Place::with_plant();
    let dry = place.calib(&["run", "study.toml", "--dry-run"]);
    assert_eq!(dry.code(), 0, "{}", dry.stderr());
    let said = dry.stderr();
    assert!(said.contains("dry run: rollout waits for the steps before it\n"), "{said}");
    assert!(said.contains("rows x 11 columns in ") && said.contains("expecting about "), "{said}");
    assert!(said.contains("to do: simulate, reading the log, build-model, "), "{said}");
    assert!(said.contains("of a processor on this machine"), "{said}");
    assert!(!said.contains("data.path"), "{said}");
    assert!(!place.path().join("data").exists());

    let whole = place.calib(&["run", "study.toml", "-v"]);
    let verdict = whole.succeeds();
    assert!(verdict.contains("PIT300") && !verdict.contains("wrote"), "{verdict}");
    assert!(whole.stderr().contains("3 written"), "{}", whole.stderr());
    let before = place.content("study-results");
    let again = place.calib(&["run", "study.toml", "-v"]);
    again.succeeds();
    assert_eq!(again.stderr().matches("up to date").count(), 4, "{}", again.stderr());
    assert!(!again.stderr().contains("day files"), "{}", again.stderr());
    assert!(place.content("study-results") == before);

    // Single steps give the same results.
    for command in ["build-model", "rollout", "sweep", "evaluate"] {
        place.calib(&[command, "study.toml", "--output", "steps"]).succeeds();
    }
    let by_steps = place.content("steps");
    let mut whole = place.content("study-results");
    whole.insert("report.html".into(), by_steps[std::path::Path::new("report.html")].clone());
    assert!(by_steps == whole, "but for the report's command lines");

    // Stale results are made again, and the others stay.
    let fewer = place.calib(&["run", "study.toml", "-v", "--set", "rollout.steps=300"]);
    fewer.succeeds();
    assert_eq!(fewer.stderr().matches("up to date").count(), 3, "{}", fewer.stderr());
    assert!(fewer.stderr().contains("wrote study-results/rollout"), "{}", fewer.stderr());
    let summary = place.calib(&["run", "study.toml", "--json", "-q", "--force"]).json(&[0]);
    assert_eq!(summary["verdicts"].as_array().expect("a list").len(), 2);
}

#[test]
fn what_is_wrong_with_a_study_is_said_before_its_plant_is_simulated() {
    let place = Place::with_plant();
    let sensor = ["--set", "sweep.sensors=[\"PIT30\"]"];
    let pattern = ["--set", "data.include=[\"PIT3OO\"]"];
    let refused = "sweep.sensors: sensor \"PIT30\" is not a channel of the plant that [simulate] describes; did you mean PIT300";
    let all = "and 4 more: `calib simulate study.toml ";
    // If the study has its own clock, the simulated plant cannot replace the log.
    for clock in [&["--set", "data.period_secs=60", "--dry-run"][..], &["--dry-run"]] {
        let error = place.on_study("run", &[clock, &sensor].concat()).fails(2);
        assert!(
            error.contains(refused) && error.contains(all) && error.contains("? It has PIT300, "),
            "{error}"
        );
        let error = place.on_study("run", &[clock, &pattern].concat()).fails(2);
        assert!(error.contains("data.include has \"PIT3OO\", which names no channel"), "{error}");
        place.on_study("run", clock).succeeds();
    }
    assert!(place.on_study("run", &sensor).fails(2).contains(refused));
    assert!(!place.path().join("data").exists(), "nothing is simulated in vain");
}

#[test]
fn a_plant_that_is_not_there_is_simulated_first() {
    let place = Place::with_plant();
    for command in ["build-model", "inspect"] {
        let message = place.calib(&[command, "study.toml"]).fails(2);
        assert!(message.contains("run `calib simulate study.toml` first"), "{message}");
    }
    let simulated = place.calib(&["simulate", "study.toml"]);
    assert!(simulated.succeeds().contains("3 day files of 12 channels in data (3 written"));
    assert!(simulated.stderr().contains("next: calib run study.toml"), "{}", simulated.stderr());
    place.calib(&["build-model", "study.toml"]).succeeds();

    // A deleted day is reported missing, and is simulated again to the same bytes.
    let day = place.path().join("data/2022-11-02.parquet");
    let whole = std::fs::read(&day).expect("readable");
    std::fs::remove_file(&day).expect("there");
    place.calib(&["build-model", "study.toml"]).fails_with(2, &["is not in data"]);
    assert!(place.calib(&["simulate", "study.toml"]).succeeds().contains("1 written"));
    assert!(std::fs::read(&day).expect("readable") == whole);

    // Another plant is not mistaken for it, and does not overwrite it.
    let other = ["--set", "simulate.seed=9"];
    place
        .calib(&["sweep", "study.toml", other[0], other[1]])
        .fails_with(2, &["calib simulate study.toml --set 'simulate.seed=9' --force"]);
    let message = place.calib(&["run", "study.toml", other[0], other[1]]).fails(2);
    assert!(message.contains("holds another simulation"), "{message}");
}

#[test]
fn other_data_make_the_plant_superfluous() {
    let place = Place::with_plant();
    place.simulate("logs");
    place.calib(&["build-model", "study.toml", "--set", "data.path=logs"]).succeeds();
    // A path that does not exist is a typing error, and nothing is written there.
    let message = place.calib(&["run", "study.toml", "--set", "data.path=lgos"]).fails(2);
    assert!(message.contains("no log at lgos"), "{message}");
    let message = place.calib(&["simulate", "study.toml", "--set", "data.path=logs"]).fails(2);
    assert!(message.contains("no [simulate] section (one is not used"), "{message}");

    // A user's own logs in the folder of the plant are read as they are.
    std::fs::remove_file(place.path().join("logs/simulation.json")).expect("there");
    std::fs::rename(place.path().join("logs"), place.path().join("data")).expect("there");
    place.calib(&["build-model", "study.toml"]).succeeds();
    let ran = place.calib(&["run", "study.toml", "--dry-run"]);
    assert!(ran.stderr().contains("did not simulate: [simulate] is not used"), "{}", ran.stderr());
}

#[test]
fn mistakes_about_the_plant_are_named() {
    let place = Place::with_plant();
    assert!(place.refusal("simulate", "simulate.chanels=5").contains("did you mean `channels`"));
    assert!(place.refusal("simulate", "simulate.channels=1").contains("`channels` is 1, expected"));
    assert!(
        place.refusal("simulate", "simulate.period_secs=0").contains("positive number of seconds")
    );
    let message = place.calib(&["simulate", "study.toml", "--days", "2"]).fails(2);
    assert!(message.contains("--set simulate.days=2"), "{message}");
    place.edit_study("path = \"data\"", "path = \"data/*.parquet\"");
    place.calib(&["simulate", "study.toml"]).fails_with(2, &["one plain folder"]);
    let message = place.calib(&["simulate", "logs", "--set", "seed=1"]).fails(2);
    assert!(message.contains("--set and --profile change a study"), "{message}");
}

#[test]
fn a_model_that_needs_libtorch_is_left_out_aloud() {
    if cfg!(feature = "torch") {
        return;
    }
    let place = Place::with_plant();
    let script = "[models.script.model]\nkind = \"torchscript\"\n[models.script.dynamics]\npath = \"model.pt\"\n[models.knn]\n\n[rollout]";
    place.edit_study("[rollout]", script);
    let ran = place.calib(&["run", "study.toml"]);
    assert_eq!(ran.code(), 1, "{}", ran.stderr());
    assert!(
        ran.stderr().contains(
            "error: model script is left out: model.kind = \"torchscript\" wants libtorch"
        )
    );
    assert!(ran.stdout().contains("knn"), "{}", ran.stdout());
    assert!(place.read("study-results/report.html").contains("model script is left out"));
    place.calib(&["run", "study.toml", "--model", "script"]).fails_with(2, &["wants libtorch"]);
}

#[test]
fn a_profile_is_the_study_at_another_size_with_results_of_its_own() {
    let place = Place::with_plant();
    place.edit_study(
        "[model]",
        "[profiles.tiny]\ndata.path = \"small\"\nsimulate = { days = 1.5 }\nsweep.steps = 200\n\n\
         [profiles.here]\noutput = \"elsewhere\"\n\n[model]",
    );
    let message = place.calib(&["build-model", "study.toml", "--profile", "tiny"]).fails(2);
    assert!(message.contains("run `calib simulate study.toml --profile tiny` first"), "{message}");
    place.calib(&["simulate", "study.toml", "--profile", "tiny"]).succeeds();
    assert!(place.path().join("small/2022-11-02.parquet").is_file());
    place.calib(&["inspect", "study.toml", "--profile", "tiny"]).succeeds_with(&["2022-11-02 1"]);
    let ran = place.calib(&["run", "study.toml", "--profile", "tiny"]);
    ran.succeeds();
    assert!(ran.stderr().contains("of 200 steps"), "{}", ran.stderr());
    let report = place.read("study-results/tiny/report.html");
    assert!(report.contains("calib sweep study.toml --profile tiny"), "how to make it again");
    assert!(!place.path().join("study-results/model").exists());

    let next = place.calib(&["build-model", "study.toml", "--profile", "tiny"]);
    assert!(next.stderr().contains("calib rollout study.toml --profile tiny"), "{}", next.stderr());
    place.calib(&["simulate", "study.toml"]).succeeds();
    place.calib(&["build-model", "study.toml", "--profile", "here"]).succeeds();
    assert!(place.path().join("elsewhere/model/manifest.json").is_file());
    let given = ["build-model", "study.toml", "--profile", "tiny", "--output", "given"];
    place.calib(&given).succeeds();
    assert!(place.path().join("given/model/manifest.json").is_file());
}

/// Simulates the plant of the study with these profiles, and returns the error message.
fn refused_profiles(place: &Place, profiles: &str, more: &[&str]) -> String {
    let study = place.read("study.toml");
    place.extend_study(&format!("\n{profiles}\n"));
    let refused = place.on_study("simulate", more).fails(2);
    place.write("study.toml", &study);
    refused
}

#[test]
fn mistakes_in_profiles_are_named_before_they_are_chosen() {
    let place = Place::with_plant();
    let key = refused_profiles(&place, "[profiles.tiny.agent]\ngama = 0.5", &[]);
    assert!(
        key.contains("[profiles.tiny]: agent: unknown key `gama`; did you mean `gamma`"),
        "{key}"
    );
    let model = refused_profiles(&place, "[profiles.tiny.models.a]\nagent.gamma = 0.5", &[]);
    assert!(model.contains("[models.a]: agent cannot differ"), "{model}");
    let name = refused_profiles(&place, "[profiles.sweep]\nseed = 1", &[]);
    assert!(name.contains("choose another name"), "{name}");
    let unknown = refused_profiles(&place, "[profiles.tiny]\nseed = 1", &["--profile", "small"]);
    assert!(unknown.contains("--profile small: the study's profiles are tiny"), "{unknown}");
    let value =
        refused_profiles(&place, "[profiles.tiny.agent]\ngamma = 5", &["--profile", "tiny"]);
    assert!(value.contains("study.toml:") && value.contains("`gamma`"), "{value}");
}

#[test]
fn models_of_a_part_of_the_range_have_the_units_of_all_of_it() {
    let place = Place::with_plant();
    place.edit_study(
        "train_fraction = 0.7",
        "train = { start = 2022-11-01, end = 2022-11-03 }\nheld_out = { start = 2022-11-03, end = 2022-11-04 }",
    );
    place.edit_study(
        "[rollout]",
        "[models.day.model.period]\nstart = 2022-11-02\n[models.all]\n\n[rollout]",
    );
    place.calib(&["run", "study.toml"]).succeeds();
    let manifest =
        |model: &str| place.read_json(&format!("study-results/models/{model}/model/manifest.json"));
    let all = manifest("all");
    let day = manifest("day");
    assert_eq!(all["normaliser"], day["normaliser"]);
    assert!(day["rows"].as_u64() < all["rows"].as_u64().map(|rows| rows * 2 / 3));
    assert!(day["times"][0].as_str().expect("a time").starts_with("2022-11-02"));
    let late = place.refusal("build-model", "models.day.model.period.start=2022-11-05");
    assert!(late.contains("model.period") && late.contains("has 0 states"), "{late}");
    let key = place.refusal("build-model", "models.day.model.perriod=1");
    assert!(key.contains("unknown key `perriod`; did you mean `period`"), "{key}");
}

#[test]
fn models_that_differ_in_their_rollouts_share_tables() {
    let place = Place::with_plant();
    place.edit_study(
        "[rollout]",
        "[models.near.rollout]\nstart = \"recent\"\n[models.anywhere]\n\n[rollout]",
    );
    place.calib(&["simulate", "study.toml"]).succeeds();
    let built = place.calib(&["build-model", "study.toml"]);
    built.succeeds();
    assert!(
        built.stderr().contains("the model is that in study-results/models/anywhere/model"),
        "{}",
        built.stderr()
    );
    let verified = ["build-model", "study.toml", "--model", "near", "--verify", "5"];
    place.calib(&verified).succeeds();
    place.run_steps(&["rollout", "sweep", "evaluate"]);
    // Each has the same bytes as alone.
    let alone = ["build-model", "study.toml", "--model", "near", "--output", "alone"];
    place.calib(&alone).succeeds();
    let mut copied = place.content("study-results/models/near/model");
    let mut made = place.content("alone/models/near/model");
    for content in [&mut copied, &mut made] {
        content.retain(|path, _| path.file_name().is_some_and(|name| name != "manifest.json"));
    }
    assert!(copied == made);
    // With some of the models only, the others are ignored.
    let some = ["evaluate", "study.toml", "--set", "compare=[\"near\"]"];
    place.calib(&some).succeeds();
    let message = place.calib(&["run", "study.toml", "--set", "compare=[\"far\"]"]).fails(2);
    assert!(message.contains("compare lists far"), "{message}");
}
