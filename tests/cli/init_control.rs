//! `calib init` for acting agents, and settings of such agents that do not fit a log.

use std::fmt::Write as _;

use crate::{
    control,
    harness::{Place, Ran},
};

/// Returns what a dry run of a sweep tells.
fn told(place: &Place, set: &[&str]) -> String {
    place.calib(&[&["control", "pole/study.toml", "--dry-run"], set].concat()).stderr()
}

/// Temperatures and initial values are in units of return.
#[test]
fn numbers_beyond_the_returns_of_the_log_are_told() {
    let place = control::place();
    let large = told(&place, &["--set=control.agent.temperature=100000"]);
    assert!(large.contains("temperature 100000 is more than the spread"), "{large}");
    assert!(large.contains("set control.agent.temperature to "), "{large}");
    let swept = told(&place, &["--set=control.grid={ temperature = [1.0, 100000.0] }"]);
    assert!(!swept.contains("is more than the spread"), "one of them fits: {swept}");
    let swept = told(&place, &["--set=control.grid={ initial_weight = [1e6, 2e6] }"]);
    assert!(swept.contains("initial weights put the first values at 1e7, more"), "{swept}");
    assert!(swept.contains("set control.grid.initial_weight to 0"), "{swept}");
    // A pole that stands for some 20 steps: returns differ by about 20 with a
    // discount of 1, and hardly with a discount of 0.1.
    let discounted = told(
        &place,
        &[
            "--set=control.agent.gamma=0.1",
            "--set=control.agent.temperature=1.0",
            "--set=control.grid={ gamma = [0.5, 1.0] }",
        ],
    );
    assert!(!discounted.contains("is more than the spread"), "{discounted}");
    let discounted = told(
        &place,
        &[
            "--set=control.agent.gamma=1.0",
            "--set=control.agent.temperature=1.0",
            "--set=control.grid={ gamma = [0.1, 0.2] }",
        ],
    );
    assert!(discounted.contains("temperature 1 is more than the spread"), "{discounted}");
    assert!(discounted.contains("(gamma 0.2, timeout "), "the one that is nearest: {discounted}");
    // Four columns and six pairs give an initial value of 1,500, the columns alone give 600; the spread is about 9.
    let weight = "--set=control.agent.initial_weight=150";
    let paired = told(&place, &[weight]);
    assert!(paired.contains("initial weights put the first values at 1,500, more"), "{paired}");
    let alone = told(&place, &[weight, "--set=control.agent.pairs=false"]);
    assert!(!alone.contains("initial weights put"), "{alone}");
}

/// Rewards a thousand times as large make the values of a proposed study too small.
#[test]
fn numbers_far_below_the_returns_of_the_log_are_told() {
    let place = control::place();
    let fitting = [
        "--set=control.grid={ temperature = [0.1, 1.0, 10.0], step_size = [0.003, 0.03, 0.3] }",
        "--set=control.reward=[{ column = \"reward\" }]",
    ];
    let few = told(&place, &fitting);
    assert!(!few.contains("the spread of the recorded returns"), "{few}");
    let large = "--set=control.reward=[{ column = \"reward\", weight = 1000 }]";
    let scaled = told(&place, &[fitting[0], large]);
    for part in [
        "temperature 10 is less than a five-hundredth of the spread of the recorded returns, ",
        "set control.grid.temperature to about ",
        "step size 0.3 changes a value by 3 in a step, less than a 2,500th of the spread",
        "set control.grid.step_size to about ",
    ] {
        assert!(scaled.contains(part), "{part} is missing in {scaled}");
    }
    let network =
        ["--set=control.agent={ algorithm = \"deep_q_learning\", step_size = 0.001 }", large];
    let unitless =
        told(&place, &[&network[..], &["--set=control.grid={ gamma = [1.0] }"]].concat());
    assert!(!unitless.contains("changes a value by"), "{unitless}");
}

/// Options for models that are quick to build.
const QUICK: [&str; 3] = [
    "--within=6s",
    "--set=control.models=[\"neighbors\", \"increments\"]",
    "--set=control.model.members=2",
];

fn init(place: &Place, args: &[&str]) -> Ran {
    place.calib(&[&["init"][..], args, &QUICK[..]].concat())
}

fn study(place: &Place) -> toml::Table {
    toml::from_str(&place.read("study.toml")).expect("TOML")
}

const POLE: [&str; 9] = [
    "pole/log.parquet",
    "study.toml",
    "--action=action",
    "--reward=reward",
    "--terminal=terminal",
    "--probability=probability",
    "--set=control.runs=1",
    "--set=seed=7",
    "--force",
];

#[test]
fn options_of_init_stand_together_in_its_help() {
    let help = Place::new().calib(&["init", "--help"]).succeeds();
    let options = ["--action", "--reward", "--terminal", "--probability", "--set", "--threads"];
    let places = options.map(|option| help.find(&format!("{option} <")).expect(option));
    assert!(places.is_sorted(), "{help}");
    assert!(help.contains("[control]"), "{help}");
}

/// Reading the log takes longer than the limit, on any machine.
#[test]
fn no_run_is_timed_once_the_time_is_over() {
    let place = Place::new();
    let simulate = ["simulate", "pole", "--task=cart-pole", "--policy=random"];
    place.calib(&[&simulate[..], &["--transitions=2000"]].concat()).succeeds();
    let late = [&["init"][..], &POLE, &["--within=0.0001s", "--json"]].concat();
    let ran = place.calib(&late);
    let said = ran.json(&[0]);
    assert!(said["expected_secs"].is_null(), "{said}");
    assert_eq!(said["steps"], 2_000, "the least");
    let told = ran.stderr();
    assert!(
        told.contains("ended before `calib init` could measure how long a study takes"),
        "{told}"
    );
    assert!(!told.contains("measuring how long"), "{told}");
    let text = place.read("study.toml");
    assert!(text.contains("the least that says anything: "), "{text}");
    place.calib(&["inspect", "study.toml"]).ends(&[0, 1]);
}

/// So many settings that storing their runs alone takes longer than the limit, on any machine. No run of them is made.
#[test]
fn a_study_that_no_number_of_steps_makes_short_is_told() {
    let place = Place::new();
    let simulate = ["simulate", "pole", "--task=cart-pole", "--policy=random"];
    place.calib(&[&simulate[..], &["--transitions=2000"]].concat()).succeeds();
    let values: Vec<String> = (1..=40).map(|value| value.to_string()).collect();
    let values = values.join(", ");
    let grid = format!(
        "--set=control.grid={{ step_size = [{values}], temperature = [{values}], initial_weight = [{values}] }}"
    );
    let few = ["--within=20s", "--set=control.model.members=2", grid.as_str()];
    let ran = place.calib(&[&["init"][..], &POLE, &few].concat());
    let said = ran.succeeds();
    assert!(said.contains("64,000 settings x 6 runs of 2,000 steps: about "), "{said}");
    assert!(said.contains(" of this time do not depend on the steps"), "{said}");
    let told = ran.stderr();
    assert!(told.contains("20 s are not enough for the smallest study"), "{told}");
    assert!(told.contains("do not depend on control.steps, and --within leaves less"), "{told}");
    assert!(!told.contains("ended before `calib init` could measure"), "{told}");
    let text = place.read("study.toml");
    assert!(text.contains("the least that says anything: about "), "{text}");
}

fn number(value: &toml::Value) -> f64 {
    let whole = value.as_integer().map(|whole| whole as f64);
    value.as_float().or(whole).expect("a number")
}

#[test]
fn a_log_of_decisions_becomes_a_study_that_runs() {
    let place = Place::new();
    let simulate = ["simulate", "pole", "--task=cart-pole", "--policy=random"];
    place.calib(&[&simulate[..], &["--transitions=2000"]].concat()).succeeds();
    let ran = init(&place, &POLE);
    let said = ran.succeeds();
    for part in [
        "2,000 transitions in ",
        "states of 4 columns",
        "action=0",
        "so returns are not discounted",
    ] {
        assert!(said.contains(part), "{part} is missing in {said}");
    }
    assert!(said.contains("18 settings x 4 runs of "), "{said}");
    assert!(ran.stderr().contains("next: calib run study.toml"), "{}", ran.stderr());
    let table = study(&place);
    let control = &table["control"];
    assert_eq!(table["seed"].as_integer(), Some(7), "what was given holds");
    assert_eq!(control["actions"][0].as_str(), Some("action"));
    assert_eq!(control["terminal"].as_str(), Some("terminal"));
    assert_eq!(control["start"].as_str(), Some("episodes"));
    let timeout = control["timeout"].as_integer().expect("steps");
    assert!((20..=500).contains(&timeout), "random pushes let the pole fall: {timeout}");
    let steps = control["steps"].as_integer().expect("steps");
    assert!((2_000..=15_000).contains(&steps), "{steps}");
    let temperatures = control["grid"]["temperature"].as_array().expect("a list");
    assert!(temperatures.contains(&control["agent"]["temperature"]), "{control:?}");
    let step_sizes = control["grid"]["step_size"].as_array().expect("a list");
    assert!(step_sizes.contains(&control["agent"]["step_size"]), "{control:?}");
    let in_temperatures =
        number(&control["agent"]["step_size"]) / number(&control["agent"]["temperature"]);
    assert!((0.027..0.033).contains(&in_temperatures), "both are in spreads: {control:?}");
    // Ten initial weights, of four columns and six pairs, give an initial value of five spreads.
    let optimism = number(&control["grid"]["initial_weight"][1]);
    let in_spreads = optimism / number(&control["agent"]["temperature"]);
    assert!((4.5..5.5).contains(&in_spreads), "{control:?}");
    assert!(control.get("levels").is_none() && control["agent"].get("pairs").is_none());
    let ran = place.calib(&["run", "study.toml"]);
    let verdict = ran.ends(&[0, 1]);
    assert!(verdict.contains("default"), "it is one of the settings: {verdict}");
    assert!(!ran.stderr().contains("the spread of the recorded returns"), "{}", ran.stderr());
    // An existing study is kept, unless --force is given.
    init(&place, &POLE[..8]).fails_with(2, &["--force"]);
    let json = init(&place, &[&POLE[..], &["--json"]].concat()).json(&[0]);
    assert_eq!(json["transitions"], 2000);
    assert_eq!(json["actions"].as_array().map(Vec::len), Some(2));
    assert_eq!(json["gamma"], 1.0);
    assert_eq!(json["algorithm"], "expected_sarsa");
}

/// Proposes a study with a key set, and returns its section of acting agents.
fn proposed(place: &Place, set: &str) -> toml::Value {
    init(place, &[&POLE[..], &["--set", set]].concat()).succeeds();
    study(place)["control"].clone()
}

#[test]
fn agents_that_are_given_are_proposed_what_they_use() {
    let place = control::place();
    let control = proposed(&place, "control.grid={ step_size = [0.1, 0.2] }");
    let grid = control["grid"].as_table().expect("a table");
    assert_eq!(grid.keys().collect::<Vec<_>>(), ["step_size"], "it replaces the drafted one");
    let control = proposed(&place, "control.agent={ step_size = 0.1, gamma = 0.9 }");
    assert_eq!(control["agent"]["gamma"].as_float(), Some(0.9));
    assert!(control["agent"].get("temperature").is_none(), "{control:?}");
    let control = proposed(&place, "control.agent.algorithm=\"q_learning\"");
    assert!(control["grid"].get("temperature").is_none(), "{control:?}");
    let control = proposed(&place, "control.agent.algorithm=\"deep_q_learning\"");
    assert_eq!(control["agent"]["step_size"].as_float(), Some(0.001));
    assert!(control["agent"].get("temperature").is_none(), "{control:?}");
    init(&place, &[&POLE[..], &["--set=control={ timeout = 9 }"]].concat())
        .fails_with(2, &["give each key by itself"]);
}

#[test]
fn a_torque_of_any_number_gets_levels() {
    let place = Place::new();
    let simulate = ["simulate", "swing", "--task=pendulum", "--policy=random"];
    place.calib(&[&simulate[..], &["--transitions=600"]].concat()).succeeds();
    let torque = ["swing/log.parquet", "study.toml", "--action=torque", "--reward=reward"];
    init(&place, &torque).succeeds_with(&["nearest level"]);
    let table = study(&place);
    assert_eq!(table["control"]["levels"].as_integer(), Some(7));
    assert_eq!(table["control"]["agent"]["gamma"].as_float(), Some(0.99));
    let given = [&torque[..], &["--force", "--set=control.levels=3"]].concat();
    init(&place, &given).succeeds();
    assert_eq!(study(&place)["control"]["levels"].as_integer(), Some(3));
}

/// Returns four hundred rows of a plant, `minutes` apart: sensors, a pump with three speeds, and columns that are not actions,
/// rewards or terminals.
fn plant(minutes: usize) -> Place {
    let place = Place::new();
    let mut text = String::from(
        "time,level,flow,pump,gain,done,stopped,fixed,odds,mode,a1,a2,a3,a4,a5,a6,a7\n",
    );
    for row in 0..400_usize {
        let pump = if row % 150 == 10 { 2 } else { row / 3 % 2 };
        let mode = if row % 2 == 0 { "fast" } else { "slow" };
        let stopped = usize::from(row % 100 == 99);
        let passed = row * minutes;
        let (day, hour, minute) = (13 + passed / 1440, passed / 60 % 24, passed % 60);
        let (level, flow, gain) = (row * row % 7, row * 37 % 11, row * row % 5);
        write!(
            text,
            "2024-03-{day} {hour:02}:{minute:02}:00,{level},{flow},{pump},{gain},1,{stopped},3,0.5,{mode}"
        )
        .expect("memory");
        for factor in 1..=7 {
            write!(text, ",{}", row * (factor + 12) % 101).expect("memory");
        }
        text.push('\n');
    }
    place.write("log.csv", &text);
    place
}

/// Arguments of `init` for the plant. A column of words beside numbers could be a long table.
const PLANT: [&str; 3] = ["log.csv", "study.toml", "--set=data.shape=wide"];

#[test]
fn what_is_no_action_reward_or_terminal_is_refused() {
    let place = plant(1);
    let all = ["a1", "a2", "a3", "a4", "a5", "a6", "a7"].map(|name| format!("--action={name}"));
    let mut all: Vec<&str> = all.iter().map(String::as_str).collect();
    all.push("--reward=gain");
    for (args, expected) in [
        (
            vec!["--action=pmup", "--reward=gain"],
            "no column of numbers with this name; did you mean pump? `calib inspect` shows all columns",
        ),
        (vec!["--action=pump", "--reward=gian"], "--reward gian: the log has no column"),
        (
            vec!["--action=mode", "--reward=gain"],
            "--action mode: the column holds no number, but text, such as \"fast\"; write its values",
        ),
        (vec!["--action=fixed", "--reward=gain"], "--action fixed: it is 3 in every row"),
        (vec!["--action=pump", "--reward=fixed"], "3 in every step, and no episode ends"),
        (vec!["--action=pump", "--reward=pump"], "--reward pump: --action names this column"),
        (
            vec!["--action=pump", "--reward=gain", "--terminal=done"],
            "--terminal done: it is 1 in every row",
        ),
        (vec!["--action=a1", "--reward=gain", "--probability=odds"], "--probability odds: the log"),
        (all, "7 columns of actions have 128 combinations"),
        (
            vec!["--action=pump", "--reward=gain", "--set=control.steps=100"],
            "--set control.steps has no effect",
        ),
        (vec!["--action=pump", "--reward=gain", "--sensor=level"], "cannot be used with"),
        (
            vec!["--action=pump", "--reward=gain", TERMS],
            "--reward gain: --set control.reward gives a reward too",
        ),
        (
            vec!["--action=pump", "--set=control.reward=gain"],
            "--set control.reward: gain is one column, which holds the reward; name it with --reward",
        ),
        (
            vec!["--action=pump", "--set=control.reward=[{ column = \"elevation\" }]"],
            "control.reward[0].column: the log has no column elevation",
        ),
        (
            vec!["--action=pump", "--set=control.reward=[{ column = \"fixed\" }]"],
            "--set control.reward: the reward is 3 in every step, and no episode ends",
        ),
        (
            vec!["--action=pump"],
            "--action pump: agents need a reward; name its column with --reward",
        ),
        (vec!["--reward=gain"], "--action"),
        (vec!["--terminal=done"], "--action"),
    ] {
        let error = init(&place, &[&PLANT[..], &args[..]].concat()).fails(2);
        assert!(error.contains(expected), "{expected} is missing in {error}");
        assert!(!place.path().join("study.toml").exists(), "{args:?} wrote a study");
    }
}

/// A reward of terms for the plant.
const TERMS: &str = "--set=control.reward=[{ column = \"level\", set_point = 3, weight = -1 }]";

/// Values in units of return fit the reward that is meant.
#[test]
fn a_reward_of_terms_needs_no_column() {
    let place = plant(1);
    let proposed = |terms: &str| {
        let args = [&PLANT[..], &["--action=pump", terms, "--force", "--json"]].concat();
        let ran = init(&place, &args);
        let json = ran.json(&[0]);
        let columns = json["columns"].as_array().expect("a list").clone();
        assert!(columns.contains(&"level".into()), "a term leaves it in the state: {json}");
        assert!(columns.contains(&"gain".into()), "nobody says that it is the reward: {json}");
        json["return_spread"].as_f64().expect("a number")
    };
    let once = proposed(TERMS);
    let terms = TERMS.replace("-1 }", "-1000 }");
    let times = proposed(&terms) / once;
    assert!((times / 1_000.0 - 1.0).abs() < 1e-3, "{times}");
    let table = study(&place);
    let control = &table["control"];
    assert_eq!(control["reward"][0]["column"].as_str(), Some("level"));
    assert_eq!(control["reward"][0]["weight"].as_integer(), Some(-1_000));
    let in_spreads = number(&control["agent"]["temperature"]) / (1_000.0 * once);
    assert!((0.09..0.11).contains(&in_spreads), "{control:?}");
    let told = place.calib(&["control", "study.toml", "--dry-run"]).stderr();
    assert!(!told.contains("the spread of the recorded returns"), "{told}");
}

/// Returns the line about actions that were hardly ever taken.
fn line_of_rare(told: &str) -> String {
    let line = told.lines().find(|line| line.contains("hardly ever taken"));
    line.unwrap_or_else(|| panic!("no such line in {told}")).to_owned()
}

#[test]
fn what_speaks_against_a_choice_is_told_at_once() {
    let place = plant(1);
    place.edit("log.csv", ",flow,", ",Last_Action,");
    let columns = ["--action=pump", "--reward=gain", "--terminal=stopped"];
    let ran = init(&place, &[&PLANT[..], &columns].concat());
    ran.succeeds_with(&["state: level, Last_Action, a1, "]);
    let told = ran.stderr();
    assert!(told.contains("the state has Last_Action, which may be what an agent does"), "{told}");
    assert!(told.contains("1 action was hardly ever taken: pump=2 (3 of 3"), "{told}");
    assert!(told.contains("the log has 4 terminals, and calib names no setting"), "{told}");
    assert_eq!(study(&place)["control"]["start"].as_str(), Some("anywhere"));
    let control = place.calib(&["control", "study.toml", "--dry-run"]);
    assert_eq!(line_of_rare(&control.stderr()), line_of_rare(&told), "the same of the study");
    let logged =
        place.calib(&["control", "study.toml", "--dry-run", "--set=control.probability=\"odds\""]);
    let told = line_of_rare(&logged.stderr());
    assert!(
        told.ends_with("in the log, or use a longer log"),
        "levels have no probability: {told}"
    );
}

/// The log is read twice: as it is, and with levels in place of very many actions.
#[test]
fn text_among_many_actions_is_told_once() {
    let place = plant(1);
    let log = place.read("log.csv");
    let column = log.lines().next().expect("a header").split(',').position(|name| name == "a1");
    let lines: Vec<String> = log
        .lines()
        .enumerate()
        .map(|(number, line)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            if [50, 60].contains(&number) {
                cells[column.expect("a column")] = "auto";
            }
            cells.join(",")
        })
        .collect();
    place.write("log.csv", &lines.join("\n"));
    let ran = init(&place, &[&PLANT[..], &["--action=a1", "--reward=gain"]].concat());
    ran.succeeds();
    let told = ran.stderr();
    let text = "a1 (control.actions) holds text in 2 rows of the log, such as \"auto\"";
    assert_eq!(told.matches(text).count(), 1, "{told}");
}

/// A day has half as many decisions as rows.
#[test]
fn a_day_of_thinned_decisions_has_fewer_steps() {
    let place = plant(15);
    let columns = ["--action=pump", "--reward=gain", "--set=control.every=2"];
    init(&place, &[&PLANT[..], &columns].concat())
        .succeeds_with(&["episodes of at most 48 steps: a day"]);
    assert_eq!(study(&place)["control"]["timeout"].as_integer(), Some(48));
}

/// An outlier of the logger stretches no levels, neither proposed ones nor those of a study.
#[test]
fn an_action_that_stands_out_makes_no_levels() {
    let place = plant(1);
    let log = place.read("log.csv");
    let column = log.lines().next().expect("a header").split(',').position(|name| name == "a1");
    let lines: Vec<String> = log
        .lines()
        .enumerate()
        .map(|(number, line)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            if number == 61 {
                cells[column.expect("a column")] = "1000000";
            }
            cells.join(",")
        })
        .collect();
    place.write("log.csv", &lines.join("\n"));
    let ran = init(&place, &[&PLANT[..], &["--action=a1", "--reward=gain"]].concat());
    let said = ran.succeeds();
    assert!(said.contains("a1=100") && !said.contains("a1=1000000"), "{said}");
    let slip = "a1 (control.actions): 1000000 at 2024-03-13 01:00:00 stands out from all others, which lie from 0 to 100.";
    assert_eq!(ran.stderr().matches(slip).count(), 1, "{}", ran.stderr());
    assert!(!ran.stderr().contains("hardly ever taken"), "{}", ran.stderr());
    let inspected = place.calib(&["inspect", "study.toml"]);
    assert!(inspected.stderr().contains(slip), "{}", inspected.stderr());
    let shown = inspected.succeeds();
    assert!(shown.contains("a1=100") && !shown.contains("a1=1000000"), "{shown}");
}
