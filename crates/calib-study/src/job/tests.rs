use std::{fs, path::Path};

use calib_sweep::RaceKind;

use super::*;

fn job(text: &str, overrides: &[&str]) -> Result<Job, StudyError> {
    let set = overrides.iter().map(|&text| text.to_owned()).collect();
    let request = Request { set, ..Request::new("study.toml") };
    Job::of_text(request, text.to_owned())
}

fn refused(text: &str, overrides: &[&str]) -> String {
    job(text, overrides).expect_err("invalid").to_string()
}

#[test]
fn overrides_win_and_may_be_any_toml_or_text() {
    let text = "seed = 1\n[data]\npath = \"logs\"\n[agent]\ngamma = 0.5\n";
    let set = ["agent.gamma=0.9", "sweep.sensors=[\"A\"]", "agent.optimiser=sgd", "seed=7"];
    let job = job(text, &set).expect("valid");
    let study = job.study();
    assert_eq!(study.seed, 7);
    assert!((study.agent.gamma - 0.9).abs() < 1e-12);
    assert_eq!(study.sweep.sensors, ["A"]);
    assert_eq!(job.layout().root(), Path::new("study-results"));
}

#[test]
fn sensors_are_grouped_by_their_discount_factors() {
    let text = "[data]\npath = \"logs\"\n[agent]\ngamma = 0.5\ngammas = { B = 0.9, C = 0.5 }\n\
        [sweep]\nsensors = [\"B\", \"A\", \"C\"]\n";
    let job = job(text, &[]).expect("valid");
    assert_eq!(job.study().gammas(), [0.9, 0.5]);
    assert_eq!(job.study().sensors_of(0.5).collect::<Vec<_>>(), ["A", "C"]);
}

fn title(file: &str, text: &str) -> String {
    let request = Request::new(file);
    Job::of_text(request, text.to_owned()).expect("valid").title()
}

/// Returns a study of the logs at `path`.
fn logs(path: &str) -> String {
    format!("[data]\npath = \"{path}\"\n[sweep]\nsensors = [\"A\", \"B\"]\n")
}

#[test]
fn a_report_is_called_by_what_tells_it_from_others() {
    assert_eq!(title("membranes.toml", &logs("log.parquet")), "membranes");
    assert_eq!(title("study.toml", &logs("plant-7.parquet")), "plant-7");
    assert_eq!(title("study.toml", &logs("../plant 7/logs/*.csv")), "plant 7");
    assert_eq!(title("study.toml", &logs("log.parquet")), "A and B");
    let titled = format!("{}[evaluate]\ntitle = \"Mine\"\n", logs("log.parquet"));
    assert_eq!(title("membranes.toml", &titled), "Mine");
}

#[test]
fn a_job_is_what_the_file_was() {
    let place = tempfile::tempdir().expect("a directory");
    let path = place.path().join("study.toml");
    fs::write(&path, "seed = 1\n[models.a]\nmodel.members = 3\n").expect("writable");
    let job = Job::resolve(Request::new(&path)).expect("valid");
    fs::write(&path, "seed = 2\n").expect("writable");
    let part = job.choose(Some("a"), None).expect("valid");
    assert_eq!((part.study().seed, part.study().model.members), (1, 3));
    assert_eq!(job.whole().expect("valid").models.len(), 1);
    fs::remove_file(&path).expect("there");
    assert!(job.models().is_ok());
    assert!(matches!(Job::resolve(Request::new(&path)), Err(StudyError::Unreadable { .. })));
}

/// Returns the folder of the results of a study with two profiles.
fn root(change: fn(&mut Request)) -> String {
    let text = "output = \"there\"\n[profiles.tiny]\nseed = 2\n[profiles.own]\noutput = \"own\"\n";
    let mut request = Request::new("folder/s.toml");
    change(&mut request);
    let job = Job::of_text(request, text.to_owned()).expect("valid");
    job.layout().root().display().to_string()
}

#[test]
fn results_lie_where_they_are_asked_for() {
    assert_eq!(root(|_| ()), "folder/there");
    assert_eq!(root(|request| request.profile = Some("tiny".to_owned())), "folder/there/tiny");
    assert_eq!(root(|request| request.profile = Some("own".to_owned())), "folder/own");
    assert_eq!(root(|request| request.output = Some("x".into())), "x");
}

#[test]
fn mistakes_name_file_line_and_nearest_key() {
    let key = refused("[agent]\nlearning_rat = 0.1\n", &[]);
    assert!(
        key.starts_with(
            "study.toml:2:1: unknown key `learning_rat`; did you mean `learning_rate`?"
        ),
        "{key}"
    );
    let section = refused("[agnt]\n", &[]);
    assert!(section.contains("did you mean `agent`"), "{section}");
    let set = refused("", &["agent.gama=0.9"]);
    assert!(
        set.starts_with("study.toml with --set agent.gama=0.9: agent: unknown key")
            && set.contains("did you mean `gamma`"),
        "{set}"
    );
    assert!(refused("", &["gamma"]).contains("expected section.key=value"));
    assert!(refused("[agent\n", &[]).starts_with("study.toml:1:"));
    let infinite = refused("", &["model.temperature=inf"]);
    assert!(infinite.contains("model.temperature = inf: expected a finite number"), "{infinite}");
    let list = refused("[sweep.grid]\ngamma = [0.5, nan]\n", &[]);
    assert!(list.contains("sweep.grid.gamma = NaN"), "{list}");
    let gammas = "[data]\npath = \"logs\"\n[agent.gammas]\nPIT30 = 0.5\n[sweep]\nsensors = [\"PIT300\", \"TIT101\"]\n";
    let sensor = refused(gammas, &[]);
    assert!(sensor.contains("agent.gammas names PIT30 (did you mean PIT300?)"), "{sensor}");
}

#[test]
fn what_is_gone_is_refused_with_what_to_write() {
    let gone = "the race by certainty is gone. Write \"halving\", which saves more runs and chooses as well, \
        or \"none\", which makes all runs";
    for race in ["\"sure\"", "true"] {
        let told = refused(&format!("[sweep]\nrace = {race}\n"), &[]);
        assert_eq!(told, format!("study.toml:2:8: {gone}"));
    }
    let set = "sweep.race=sure";
    assert_eq!(refused("", &[set]), format!("study.toml with --set {set}: sweep.race: {gone}"));
    let rate = refused("[sweep]\nrace_error_rate = 0.05\n", &[]);
    assert_eq!(
        rate,
        "study.toml:2:1: unknown key `race_error_rate`: the race by certainty is gone, and its error rate with it. \
         Leave the key out"
    );
    let other = refused("[sweep]\nrace = \"halfing\"\n", &[]);
    assert_eq!(
        other,
        "study.toml:2:8: unknown value \"halfing\"; did you mean \"halving\"? (known values: \"none\", \"halving\")"
    );
    for (race, kind) in [("false", RaceKind::None), ("\"halving\"", RaceKind::Halving)] {
        let job = job(&format!("[sweep]\nrace = {race}\n"), &[]).expect("valid");
        assert_eq!(job.study().sweep.race, kind);
    }
}

/// Returns line, column and excerpt of a mistake.
fn place(text: &str, set: &[&str]) -> Option<(usize, usize, String)> {
    let error = job(text, set).expect_err("invalid");
    error.place().map(|place| (place.line, place.column, place.excerpt()))
}

#[test]
fn values_that_types_cannot_refuse_have_a_place_too() {
    let text = "seed = 1\n[agent]\n  gamma = 2.0\n";
    let excerpt = "  |\n3 |   gamma = 2.0\n  |   ^^^^^".to_owned();
    assert_eq!(place(text, &[]), Some((3, 3, excerpt)));
    assert_eq!(place(text, &["agent.gamma=3.0"]), None, "what is wrong is not what stands there");
    assert_eq!(place("[sweep]\nsteps = 1\n", &["seed=3"]).map(|place| place.0), Some(2));
    let profile = "[agent]\ngamma = 0.5\n[profiles.p]\nagent.gama = 2.0\n";
    assert_eq!(place(profile, &[]).map(|place| (place.0, place.1)), Some((4, 7)));
    let types = place("[agent]\ngamma = \"x\"\n", &[]).expect("a place");
    assert_eq!((types.0, types.1), (2, 9));
}

const CONTROL: &str = "[control]\nactions = [\"a\"]\n[control.grid]\nstep_size = [0.1]\n";

#[test]
fn what_was_given_beside_the_file_is_not_looked_for_in_it() {
    for (set, told) in [
        ("control.grid.gamma=[1.2]", "`control.grid.gamma` is 1.2, expected from 0 to 1"),
        ("control.agent.gamma=1.2", "`control.agent.gamma` is 1.2, expected from 0 to 1"),
        ("control.model.members=1", "`control.model.members` is 1, expected at least 2"),
        ("control.grid.step_size=[]", "control.grid.step_size has no value; leave"),
        ("control.models=[]", "control.models is empty; list"),
        ("control.reward=[{column=\"a\",power=3}]", "[control]: `reward[0].power` is 3, expected"),
        (
            "control.reward=[{column=\"a\",set_point=\"a\"}]",
            "[control]: the set-point of reward[0] is its own column",
        ),
    ] {
        let refused = refused(CONTROL, &[set]);
        assert!(refused.starts_with(&format!("study.toml with --set {set}: {told}")), "{refused}");
        assert_eq!(place(CONTROL, &[set]), None, "{set}");
    }
    let gamma = CONTROL.replace("step_size = [0.1]", "gamma = [1.2]");
    assert_eq!(place(&gamma, &["control.steps=9"]).map(|place| place.0), Some(4));
    let reward = CONTROL
        .replace("[control.grid]", "reward = [{ column = \"a\", power = 3 }]\n[control.grid]");
    assert_eq!(place(&reward, &["control.steps=9"]).map(|place| place.0), Some(3));
}

/// Returns the error message for a value of the agent.
fn told(value: &str) -> String {
    refused(&format!("[agent]\n{value}\n"), &[])
}

#[test]
fn what_is_expected_is_said_in_words() {
    assert_eq!(told("gamma = \"x\""), "study.toml:2:9: expected a number, got the text \"x\"");
    assert_eq!(
        told("batch_size = -1"),
        "study.toml:2:14: expected a whole number from 0 up, got -1"
    );
    assert_eq!(
        told("batch_size = 1.5"),
        "study.toml:2:14: expected a whole number from 0 up, got 1.5"
    );
    assert_eq!(
        told("batch_size = true"),
        "study.toml:2:14: expected a whole number from 0 up, got true"
    );
    let given = refused("", &["agent.gamma=x"]);
    assert_eq!(
        given,
        "study.toml with --set agent.gamma=x: agent.gamma: expected a number, got the text \"x\""
    );
    assert_eq!(refused("agent = 3\n", &[]), "study.toml:1:9: expected a section, got 3");
    let unnamed = "[deployments]\nstart = 2024-04-01\n";
    let date = "study.toml:2:9: expected a section with start or end, got a date";
    assert_eq!(refused(unnamed, &[]), date);
    assert_eq!(
        refused("[sweep]\nsensors = \"A\"\n", &[]),
        "study.toml:2:11: expected a list, got the text \"A\""
    );
}
