//! Sweeps: every field of the agent, lists, ranges and samples, and their cost.

use calib_data::table::{Table, read_parquet};
use insta::assert_snapshot;

use crate::harness::{Content, Place};

/// Returns a small plant with its model, and the shortest possible runs.
fn place() -> Place {
    let place = Place::with_study();
    place.edit_study("sensors = [\"PIT300\", \"TIT101\"]", "sensors = [\"PIT300\"]");
    place.edit_study("steps = 800", "steps = 240");
    place.edit_study("online_runs = 3", "online_runs = 1");
    place.edit_study("member_runs = 2", "member_runs = 1");
    place.edit_study("log_replay_runs = 2", "log_replay_runs = 0");
    place.calib(&["build-model", "study.toml"]).succeeds();
    place
}

fn runs(place: &Place) -> Table {
    read_parquet(&place.path().join("study-results/sweep/runs.parquet")).expect("runs")
}

#[test]
fn every_field_of_the_agent_can_be_swept_and_has_an_effect() {
    let place = place();
    let small = "agent.value_function=mlp agent.hidden_units=6 agent.target_network_period=5";
    let fields = [
        ("value_function", "[\"mlp\", \"linear\"]"),
        ("hidden_layers", "[1, 2]"),
        ("hidden_units", "{ from = 4, to = 6, step = 2 }"),
        ("precision", "[\"f32\", \"bf16\"]"),
        ("optimiser", "[\"adam\", \"sgd\"]"),
        ("learning_rate", "{ from = 1e-4, to = 1e-3, per_decade = 1 }"),
        ("beta1", "[0.5, 0.9]"),
        ("beta2", "{ from = 0.9, to = 0.99, count = 2 }"),
        ("epsilon", "[1e-8, 1e-2]"),
        ("weight_decay", "[0.0, 0.1]"),
        ("replay", "[\"uniform\", \"none\"]"),
        ("replay_capacity", "[50, 1000]"),
        ("batch_size", "[8, 16]"),
        ("updates_per_step", "[1, 2]"),
        ("target_network_period", "[0, 20]"),
        ("traces", "[[], [0.5, 0.9]]"),
    ];
    for (field, values) in fields {
        let grid = format!("sweep.grid={{ {field} = {values} }}");
        let mut args = vec!["sweep", "study.toml", "--set", &grid];
        args.extend(small.split(' ').flat_map(|set| ["--set", set]));
        place.calib(&args).succeeds();
        let table = runs(&place);
        assert!(table.values(field).is_some(), "{field} has a column");
        let environment = table.column::<String>("environment").expect("there");
        let candidate = table.column::<u32>("candidate").expect("there");
        let errors = table.column::<f64>("rmse").expect("there");
        for member in ["member:0", "member:1", "member:2", "online"] {
            let [first, second] = [0, 1].map(|wanted: u32| {
                let mut rows = environment.iter().zip(candidate).zip(errors);
                let row = rows.find(|((name, value), _)| *name == member && **value == wanted);
                *row.expect("trained").1
            });
            assert!(first.is_finite() && second.is_finite(), "{field} in {member}");
            assert!(first != second, "{field} makes a difference in {member}");
        }
    }
    // Swept traces stay distinct in all outputs.
    let traces = runs(&place);
    let written = traces.column::<String>("traces").expect("text");
    assert!(written.iter().any(|text| text == "[0.5, 0.9]"), "{written:?}");
}

#[test]
fn a_dry_run_lists_the_values_and_what_they_take() {
    let place = place();
    let sampled = [
        "sweep",
        "study.toml",
        "--dry-run",
        "--set=sweep.sampling=sobol",
        "--set=sweep.samples=4",
        "--set=sweep.grid={ learning_rate = { from = 1e-5, to = 1e-1, scale = \"log\" }, batch_size = [16, 32] }",
    ];
    let listed = place.calib(&sampled);
    assert_snapshot!(listed.succeeds());
    for part in ["memory: up to ", " beside calib itself ("] {
        assert!(listed.stderr().contains(part), "{part} is missing in {}", listed.stderr());
    }
    let plan = place.calib(&[&sampled[..], &["--json"]].concat()).json(&[0]);
    assert_eq!(plan["candidates"].as_array().map(Vec::len), Some(5), "{plan}");
    assert!(plan["memory"]["total"].as_u64() > plan["memory"]["data"].as_u64());
    let other = place.calib(&[&sampled[..], &["--set", "seed=4"]].concat());
    // Tables over the states do not depend on the seed, so the model
    // stays valid; the sampled values do.
    assert!(other.succeeds() != listed.stdout());
}

#[test]
fn mistakes_in_the_values_say_what_to_do() {
    let place = place();
    let grids = [
        "learning_rate = { from = 1e-2, to = 1e-4, per_decade = 1 }",
        "learning_rate = { from = 0, to = 1e-1, per_decade = 2 }",
        "learning_rate = { from = 1e-4, to = 1e-1 }",
        "learning_rate = { from = 1e-4, to = 1e-1, per_decad = 2 }",
        "hidden_units = { from = 8, to = 10, scale = \"log\", count = 9 }",
        "optimiser = { from = 1, to = 2, count = 2 }",
        "learning_rat = [0.1]",
        "learning_rate = 0.1",
        "beta2 = { from = 0.1, to = 0.9, count = 101 }, beta1 = { from = 0.1, to = 0.9, count = 101 }",
    ];
    let mut mistakes: Vec<String> = grids
        .iter()
        .map(|grid| place.refusal("sweep", &format!("sweep.grid={{ {grid} }}")))
        .collect();
    mistakes.push(place.refusal("sweep", "sweep.sampling=sobel"));
    mistakes.push(place.refusal("sweep", "sweep.sampling=random"));
    assert_snapshot!(mistakes.join("\n\n"));
}

#[test]
fn a_sweep_that_does_not_fit_is_refused_with_advice() {
    let place = place();
    let sets = ["agent.value_function=mlp", "agent.hidden_units=16384", "agent.hidden_layers=16"];
    let mut args = vec!["sweep", "study.toml", "--dry-run"];
    args.extend(sets.iter().flat_map(|set| ["--set", set]));
    place.calib(&args).fails_with(2, &["of memory and", "hidden_units"]);
}

#[test]
fn a_halving_chooses_from_a_part_of_the_runs_and_says_so() {
    let place = Place::with_study();
    place.edit_study("member_runs = 2", "member_runs = 4");
    place.edit_study("[1e-5, 1e-3, 1e-2]", "[1e-5, 1e-4, 1e-3, 1e-2, 1e38]");
    place.run_steps(&["build-model", "sweep"]);
    let whole = chosen(&place);
    let all = runs_made(&place);
    place.edit_study("member_runs = 4", "member_runs = 4\nrace = \"halving\"");
    place.calib(&["sweep", "study.toml"]).succeeds();
    assert_eq!(chosen(&place), whole);
    let left = runs_made(&place);
    assert!(left < all * 3 / 4, "{left} of {all} runs");
    let shown = place.calib(&["evaluate", "study.toml"]).stdout();
    assert!(shown.contains("the race dropped"), "{shown}");
    let refused = place.calib(&["sweep", "study.toml", "--set", "sweep.race=3"]).fails(2);
    assert!(refused.contains("sweep.race: expected \"none\" or \"halving\", got"), "{refused}");
}

/// Returns the chosen candidates, one per sensor.
fn chosen(place: &Place) -> Vec<u64> {
    let verdict = place.calib(&["evaluate", "study.toml", "--json"]).json(&[0, 1]);
    verdict["verdicts"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|one| one["chosen"].as_u64().expect("a number"))
        .collect()
}

/// Returns the number of runs that the sweep made.
fn runs_made(place: &Place) -> usize {
    runs(place).column::<u32>("candidate").expect("there").len()
}

/// Counts the runs of a setting in an environment.
fn runs_of(table: &Table, member: &str, wanted: u32) -> usize {
    let environment = table.column::<String>("environment").expect("there");
    let candidate = table.column::<u32>("candidate").expect("there");
    let runs = environment.iter().zip(candidate);
    runs.filter(|(name, value)| *name == member && **value == wanted).count()
}

#[test]
fn a_race_drops_what_diverges_says_so_and_resumes() {
    let place = Place::with_study();
    place.edit_study("member_runs = 2", "member_runs = 3\nrace = \"halving\"");
    place.edit_study("[1e-5, 1e-3, 1e-2]", "[1e-5, 1e-3, 1e-2, 1e38]");
    place.run_steps(&["build-model", "sweep"]);
    let table = runs(&place);
    // There are two sensors. The diverging setting makes its first run
    // in each member, and all held-out runs.
    assert_eq!((runs_of(&table, "member:0", 3), runs_of(&table, "online", 3)), (2, 6));
    assert!(runs_of(&table, "member:0", 2) > 2, "the best goes on");
    let verdict = place.calib(&["evaluate", "study.toml"]).stdout();
    assert!(verdict.contains("the race dropped") && verdict.contains("of 4 settings"), "{verdict}");
    assert!(place.calib(&["sweep", "study.toml"]).succeeds().contains("up to date"));
    let content = place.content("study-results");
    let units = place.path().join("study-results/sweep/units/PIT300");
    std::fs::remove_file(units.join("member-0/run-0000.json")).expect("was there");
    assert!(place.calib(&["sweep", "study.toml"]).succeeds().contains("training runs made in"));
    place.calib(&["evaluate", "study.toml"]);
    assert!(place.content("study-results") == content, "the same bytes");
    for (set, told) in [
        ("sweep.race=sure", "sweep.race: the race by certainty is gone. Write \"halving\""),
        ("sweep.race=true", "sweep.race: the race by certainty is gone. Write \"halving\""),
        (
            "sweep.race_error_rate=0.05",
            "unknown key `race_error_rate`: the race by certainty is gone",
        ),
    ] {
        place.calib(&["sweep", "study.toml", "--set", set]).fails_with(2, &[told]);
    }
}

/// Reads the number of runs that the last sweep reported.
fn told_runs(told: &str) -> Option<usize> {
    told.split_once(" training runs made in")?.0.rsplit('\n').next()?.parse().ok()
}

#[test]
fn one_more_value_in_the_grid_trains_that_value_alone() {
    let small = "learning_rate = [1e-5, 1e-3, 1e-2]";
    let large = "learning_rate = [1e-5, 1e-4, 1e-3, 1e-2]";
    for race in ["none", "halving"] {
        let grown = Place::with_study();
        let fresh = Place::with_study();
        for place in [&grown, &fresh] {
            place.edit_study("member_runs = 2", &format!("member_runs = 3\nrace = \"{race}\""));
            place.calib(&["build-model", "study.toml"]).succeeds();
        }
        fresh.edit_study(small, large);
        let whole = fresh.calib(&["sweep", "study.toml"]).succeeds();
        grown.calib(&["sweep", "study.toml"]).succeeds();
        grown.calib(&["evaluate", "study.toml"]);
        let before = grown.content("study-results");
        grown.edit_study(small, large);
        let dry = grown.calib(&["sweep", "study.toml", "--dry-run"]);
        dry.succeeds();
        let told = grown.calib(&["sweep", "study.toml"]).succeeds();
        let made = told_runs(&told).unwrap_or_else(|| panic!("{race}: {told}"));
        let all = runs(&fresh).column::<u32>("candidate").expect("there").len();
        if race == "none" {
            // Two sensors; three runs in each of three members, three
            // held-out runs, and two on the log.
            assert_eq!((made, all), (28, 112), "{told}");
            assert_eq!(told_runs(&whole), Some(112), "{whole}");
            assert!(
                dry.stderr().contains("; 28 of 112 training runs are left ("),
                "{}",
                dry.stderr()
            );
        }
        assert!(made * 2 < all, "{race}: {made} of {all}");
        let [swept, afresh] = [&grown, &fresh].map(|place| {
            let mut content = place.content("study-results/sweep");
            // In a race, runs stay that this sweep would not have made.
            content.retain(|path, _| race == "none" || !path.starts_with("units"));
            content
        });
        assert!(swept == afresh, "{race}: the same bytes");
        // Returning to the smaller number of runs costs nothing.
        grown.edit_study(large, small);
        let back = grown.calib(&["sweep", "study.toml"]).succeeds();
        assert!(back.contains("up to date"), "{race}: {back}");
        grown.calib(&["evaluate", "study.toml"]);
        assert!(
            without_units(grown.content("study-results")) == without_units(before),
            "{race}: as it was"
        );
    }
}

/// Returns the files of a sweep without its units.
fn without_units(mut content: Content) -> Content {
    content.retain(|path, _| !path.starts_with("sweep/units"));
    content
}
