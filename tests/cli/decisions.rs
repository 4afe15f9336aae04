//! Logs of decisions: the actions, rewards and episodes that calib reads in them.

use crate::{
    control::{place, pump, row_of_pump},
    harness::Place,
};

/// The name of the action would match the only channel of the states as a pattern.
#[test]
fn names_of_actions_are_no_patterns() {
    let place =
        pump(|row| format!("2024-03-01 06:{row:02}:00,{},{}\n", 10 + row * row % 7, row % 2));
    place.edit("log.csv", "level,pump", "V1,V[1]");
    let study = place.read("study.toml");
    place.write("study.toml", &study.replace("\"pump\"", "\"V[1]\""));
    let told = place.calib(&["inspect", "study.toml", "--json"]).json(&[0, 1]);
    assert_eq!(told["control"]["columns"][0], "V1", "{}", told["control"]["columns"]);
}

#[test]
fn an_action_costs_in_the_step_that_it_was_taken_in() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    let json = place.calib(&["control", "study.toml", "--json"]).json(&[0, 1]);
    assert_eq!(json["transitions"], 39);
    // In the steps from rows 0, 2, …, 38: 39 of the 50 steps of an agent's episode.
    let mean = &json["verdict"]["behaviour"]["mean"];
    assert!((mean.as_f64().expect("a number") + 20.0 / 0.78).abs() < 1e-9, "{mean}");
    // Leaving the log is worth what an episode of an agent could have
    // got, not the return of the whole log.
    assert_eq!(json["worst_return"], *mean);
    let short = ["control", "study.toml", "--json", "--set", "control.timeout=2"];
    let json = place.calib(&short).json(&[0, 1]);
    assert_eq!(json["worst_return"], -1.0);
}

/// Each row has the action that led to it, so the action of the first row belongs to no step.
#[test]
fn an_action_may_stand_in_a_later_row() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    // Rows 0, 2, …, 38 without a lag, and rows 2, 4, …, 38 with one.
    for (lag, mean) in [("control.lag=0", -20.0), ("control.lag=1", -19.0)] {
        let args = ["--json", "--set", "control.timeout=39", "--set", lag];
        let json = place.on_study("control", &args).json(&[0, 1]);
        assert_eq!(json["transitions"], 39);
        assert_eq!(json["verdict"]["behaviour"]["mean"], mean, "{lag}");
    }
}

/// Each decision covers three rows, which alternate between off and on. The
/// pump is on in the third row of each decision.
#[test]
fn an_agent_may_decide_in_every_third_row() {
    let place = pump(|row| {
        let pump = if row % 3 == 2 { 1 } else { row / 3 % 2 };
        format!("2024-03-01 00:{row:02}:00,{},{pump}\n", row % 7)
    });
    let every = ["inspect", "study.toml", "--set", "control.every=3"];
    let ran = place.calib(&every);
    ran.succeeds_with(&["for agents that act: 13 transitions in 1 episode"]);
    let told = ran.stderr();
    for part in [
        "13 decisions of 3 rows (3 min): steps and timeouts count decisions",
        "in 54 % of the decisions (7 of 13) another action was set before the next one, first at \
         2024-03-01 00:02:00: the action of the first row counts",
    ] {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
    let args = ["control", "study.toml", "--json", "--set", "control.every=3", "--set"];
    let few = ["control.timeout=13", "--set", "control.models=['neighbors']"];
    let args = [&args[..], &few].concat();
    let json = place.calib(&args).json(&[0, 1]);
    assert_eq!(json["transitions"], 13);
    assert_eq!(json["verdict"]["behaviour"]["mean"], -25.0, "7 times 1, and 6 times 3");
    let told = place.calib(&["inspect", "study.toml", "--set", "control.every=40"]).fails(2);
    assert!(told.contains("no recorded episode has more rows than control.every = 40"), "{told}");
    let told = place.calib(&["inspect", "study.toml", "--set", "control.every=0"]).fails(2);
    assert!(told.contains("`every` is 0, expected from 1 to 1,000,000"), "{told}");
}

/// A valve that never moves.
#[test]
fn a_log_with_one_action_is_refused() {
    let place = pump(|row| format!("2024-03-01 00:{row:02}:00,{},0.5\n", row % 7));
    let told = "control.actions: it is pump=0.5 in every row, so there is nothing to choose";
    for levels in ["control.most_actions=64", "control.levels=3"] {
        place.calib(&["control", "study.toml", "--set", levels]).fails_with(2, &[told]);
    }
    assert!(!place.path().join("study-results/control").exists(), "nothing is begun");
    let inspected = place.calib(&["inspect", "study.toml"]);
    let warned = inspected.stderr();
    assert!(warned.contains(&format!("warning: {told}")), "{warned}");
    inspected.succeeds_with(&["pump=0.5"]);
    // The pump is on in every other row, and so in all rows in which agents decide.
    let other = pump(|row| row_of_pump(row, (row + 1) % 2));
    let told = "it is pump=1 in every row in which agents decide (control.every = 2), so there is nothing to choose";
    let every = ["control", "study.toml", "--set", "control.every=2"];
    other.calib(&every).fails_with(2, &[told]);
}

/// Two whole episodes of one step, and two that a missing reward or the end of the log cut short.
#[test]
fn an_inspected_mean_beyond_every_whole_episode_has_its_reason() {
    let place = pump(|row| {
        let gain = if row == 20 { "" } else { "-1" };
        let trip = u8::from(row == 1 || row == 3);
        format!("2024-03-01 00:{row:02}:00,{},{gain},{trip},{}\n", row % 7, (row + 1) % 2)
    });
    place.edit("log.csv", "level,pump", "level,gain,trip,pump");
    let reward = "[{ column = \"pump\", weight = -1 }]";
    place.edit_study(reward, "\"gain\"\nterminal = \"trip\"");
    let told = place.calib(&["inspect", "study.toml"]).succeeds();
    let parts = [
        "mean return -13.4; spread of returns ",
        ". The mean is beyond every whole episode, because it counts parts",
    ];
    assert!(parts.iter().all(|part| told.contains(part)), "{told}");
    let json = place.calib(&["inspect", "study.toml", "--json"]).json(&[0, 1]);
    let reason = json["control"]["reward"]["beyond_whole_episodes"].as_str();
    assert!(reason.is_some_and(|reason| reason.starts_with("The mean is beyond")), "{json}");
    // If every episode is whole, there is nothing to explain.
    let short = ["inspect", "study.toml", "--set", "control.timeout=1"];
    let told = place.calib(&short).succeeds();
    assert!(told.contains("mean return ") && !told.contains("beyond every whole"), "{told}");
}

/// The reward is the distance from a tag that an operator moves. The tag stays in the state.
#[test]
fn a_set_point_is_a_tag() {
    let place = pump(|row| {
        let target = if row < 20 { 2 } else { 5 };
        format!("2024-03-01 00:{row:02}:00,{},{target},{}\n", target + 1, row % 2)
    });
    place.edit("log.csv", "level,pump", "level,LIC101.SP,pump");
    let reward = "control.reward=[{ column = \"level\", set_point = \"LIC101.SP\", weight = -2 }]";
    let args = ["control", "study.toml", "--json", "--set", reward, "--set", "control.timeout=39"];
    let json = place.calib(&args).json(&[0, 1]);
    assert_eq!(json["verdict"]["behaviour"]["mean"], -78.0, "2 in each of 39 steps");
    assert_eq!(json["columns"], serde_json::json!(["level", "LIC101.SP"]));
}

#[test]
fn an_inspected_log_counts_one_of_a_thing_as_one() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    let told = place.calib(&["inspect", "study.toml"]).succeeds();
    assert!(told.contains("40 states in 1 segment, 39 transitions"), "{told}");
    assert!(told.contains("for agents that act: 39 transitions in 1 episode"), "{told}");
    assert!(told.contains("states of 1 column, without"), "{told}");
    let reward = "reward: mean -0.513, from -1 to 0 a step; recorded episodes: mean return ";
    assert!(told.contains(reward), "{told}");
}

#[test]
fn actions_are_numbers_that_somebody_set() {
    let place = pump(|row| {
        let word = if row % 2 == 0 { "fast" } else { "slow" };
        format!("2024-03-01 00:{row:02}:00,{},{word}\n", row % 7)
    });
    // One column of words and one of numbers could be a long table.
    let wide = ["control", "study.toml", "--set", "data.shape=wide"];
    place.calib(&wide).fails_with(2, &["pump is of type text, such as \"fast\""]);
    let mean = ["--set", "data.resample=mean", "--set", "data.period_secs=300"];
    place.calib(&[&wide[..], &mean].concat()).fails_with(2, &["data.resample = \"last\""]);
}

#[test]
fn actions_that_contradict_each_other_are_refused() {
    let place = pump(|row| {
        if row == 20 {
            row_of_pump(row, 0) + &row_of_pump(row, 1)
        } else {
            row_of_pump(row, (row + 1) % 2)
        }
    });
    place.calib(&["control", "study.toml"]).fails_with(2, &["pump is 0 and 1"]);
    let first = place.calib(&["control", "study.toml", "--set", "data.contradictions=first"]);
    first.ends(&[0, 1]);
}

/// A sensor fails to answer once, as after the restart of a controller.
#[test]
fn an_empty_reward_ends_an_episode_and_is_told_with_its_time() {
    let place = pump(|row| {
        let gain = if row == 20 { String::new() } else { (row % 3).to_string() };
        format!("2024-03-01 00:{row:02}:00,{},{gain},{}\n", row % 7, (row + 1) % 2)
    });
    place.edit("log.csv", "level,pump", "level,gain,pump");
    place.edit_study("[{ column = \"pump\", weight = -1 }]", "\"gain\"");
    let inspected = place.calib(&["inspect", "study.toml"]);
    let told = inspected.stderr();
    assert!(
        told.contains(
            "1 row has no reward though an action leads there, the first at 2024-03-01 00:20:00"
        ),
        "{told}"
    );
    inspected.succeeds_with(&["38 transitions in 2 episodes"]);
    place.calib(&["control", "study.toml"]).ends(&[0, 1]);
    let weight = "--set=control.reward=[{ column = \"gain\", weight = 1e39 }]";
    let told = place.calib(&["inspect", "study.toml", weight]).stderr();
    assert!(told.contains("rewards are infinite or too large for single precision"), "{told}");
}

#[test]
fn actions_that_are_recorded_when_they_change_are_told_and_held() {
    let place = pump(|row| {
        let pump = if row % 4 == 0 { (row / 4 % 2).to_string() } else { String::new() };
        format!("2024-03-01 00:{row:02}:00,{},{pump}\n", row * row % 7)
    });
    let inspected = place.calib(&["inspect", "study.toml"]);
    let told = inspected.stderr();
    let part = "29 rows have no action: an episode ends at each, the first at 2024-03-01 00:01:00. If the action is recorded only when it \
                changes, set data.resample = \"last\" with data.period_secs, and data.max_age_secs";
    assert!(told.contains(part), "{told}");
    inspected.succeeds_with(&["10 transitions in 10 episodes"]);
    // Times are told on the clock of the study, which is an hour ahead of UTC in winter.
    let local = place.on_study("inspect", &["--set=data.time_zone=Europe/Berlin"]).stderr();
    assert!(local.contains(part), "{local}");
    let held = ["--set=data.resample=last", "--set=data.period_secs=60"];
    let long = place.on_study("inspect", &[&held[..], &["--set=data.max_age_secs=300"]].concat());
    assert!(!long.stderr().contains("no action"), "{}", long.stderr());
    long.succeeds_with(&["39 transitions in 1 episode"]);
    let short = place.on_study("inspect", &[&held[..], &["--set=data.max_age_secs=61"]].concat());
    let short = short.stderr();
    assert!(short.contains("changes, raise data.max_age_secs to the longest time"), "{short}");
}

/// Returns a log with terminals and the study of it; `cells` are the reward and the terminal of each row.
fn with_terminals(cells: impl Fn(usize) -> String) -> Place {
    let place = pump(|row| {
        let level = row * row % 7;
        format!("2024-03-01 00:{row:02}:00,{level},{},{}\n", cells(row), row / 2 % 2)
    });
    place.edit("log.csv", "level,pump", "level,gain,end,pump");
    place.edit_study("[{ column = \"pump\", weight = -1 }]", "\"gain\"");
    place.extend_study("terminal = \"end\"\n");
    place
}

#[test]
fn rewards_that_stand_for_a_missing_value_are_told() {
    let code =
        |row: usize, gain: usize| if row % 10 == 9 { "-9999".to_owned() } else { gain.to_string() };
    let dry = |place: &Place| {
        let [dry, inspected] =
            [&["control", "study.toml", "--dry-run"][..], &["inspect", "study.toml"]]
                .map(|args| place.calib(args).stderr());
        assert_eq!(dry.contains("-9999 stands"), inspected.contains("-9999 stands"), "{inspected}");
        assert!(inspected.matches("-9999 stands").count() < 2, "said once: {inspected}");
        dry
    };
    let told = dry(&with_terminals(|row| format!("{},0", code(row, row % 3))));
    let part = "-9999 stands 4 times (10.00 %) far away from all other values of 1 channel (gain): if that stands for a missing value";
    assert!(told.contains(part), "{told}");
    let penalty = dry(&with_terminals(|row| {
        format!("{},{}", code(row, row % 3), usize::from(row % 10 == 9))
    }));
    assert!(!penalty.contains("-9999"), "each is in a row with a terminal: {penalty}");
    let dropout = dry(&with_terminals(|row| format!("{},{}", code(row, row % 3), code(row, 0))));
    let part = "of 1 channel (gain): if that stands for a missing value, as loggers write it, set data.missing_values = [-9999] ";
    assert!(dropout.contains(part), "a terminal of -9999 is none: {dropout}");
}

/// The training range has none of the numbers, so that `calib control` has nothing to tell.
#[test]
fn codes_of_held_out_sensors_are_inspected_too() {
    let place = pump(|row| row_of_pump(row, row % 2));
    let row = |row: usize| {
        let level = if row % 20 == 19 && row > 200 { -9_999 } else { row as i32 % 37 };
        format!("2024-03-01 0{}:{:02}:00,{level},{}\n", row / 60, row % 60, row / 2 % 2)
    };
    let rows: String = (0..300).map(row).collect();
    place.write("log.csv", &format!("timestamp,level,pump\n{rows}"));
    place.edit_study("train_fraction = 1.0", "train_fraction = 0.6");
    let told = place.calib(&["inspect", "study.toml"]).stderr();
    assert_eq!(told.matches("-9999 stands 5 times").count(), 1, "{told}");
}

#[test]
fn a_reward_that_never_changes_is_told() {
    let same = "the reward is 2 for every decision, and no episode ends in a terminal";
    let told = with_terminals(|_| "2,0".to_owned()).calib(&["inspect", "study.toml"]).stderr();
    assert!(told.contains(same), "{told}");
    let ends = with_terminals(|row| format!("2,{}", usize::from(row % 10 == 9)));
    let told = ends.calib(&["inspect", "study.toml"]).stderr();
    assert!(!told.contains(same), "the length of an episode counts: {told}");
}

#[test]
fn what_an_inspection_shows_is_told_of_agents_that_act_too() {
    let place = pump(|row| row_of_pump(row, row % 2));
    let row = |row: usize| {
        let flow = if (50..150).contains(&row) { 433 } else { 400 + 37 * row % 97 };
        format!("2024-03-01 0{}:{:02}:00,{},{flow},{}\n", row / 60, row % 60, row % 7, row / 2 % 2)
    };
    let rows: String = (0..300).map(row).collect();
    place.write("log.csv", &format!("timestamp,level,flow,pump\n{rows}"));
    let set = "data.exclude=['flwo']";
    let told = place.calib(&["control", "study.toml", "--dry-run", "--set", set]).stderr();
    assert!(told.contains("data.exclude = \"flwo\" matches no channel"), "{told}");
    assert!(told.contains("are constant for long: flow for "), "{told}");
}

/// The transmitter of a flow is replaced by one that reports another unit.
#[test]
fn a_unit_that_changes_is_told_of_agents_that_act_too() {
    let place = pump(|row| row_of_pump(row, row % 2));
    let row = |row: usize| {
        let flow = (10 + row % 7) * if row < 400 { 1 } else { 100 };
        let [hour, minute] = [row / 60, row % 60];
        format!("2024-03-01 {hour:02}:{minute:02}:00,{},{flow},{}\n", row % 11, row / 2 % 2)
    };
    let rows: String = (0..1_000).map(row).collect();
    place.write("log.csv", &format!("timestamp,level,flow,pump\n{rows}"));
    let told = place.calib(&["control", "study.toml", "--dry-run"]).stderr();
    let part =
        "flow has two ranges that do not overlap, mostly 10 to 16 before 2024-03-01 06:40:00";
    assert!(told.contains(part), "{told}");
    let inspected = place.calib(&["inspect", "study.toml"]).stderr();
    assert_eq!(inspected.matches("two ranges that do not overlap").count(), 1, "{inspected}");
}

#[test]
fn rows_of_an_hour_that_clocks_showed_twice_are_told_as_such() {
    let place = pump(|row| {
        let [hour, minute] = [row / 2, row % 2 * 30];
        format!("2024-10-27 {hour:02}:{minute:02}:00,{},{}\n", row % 7, row / 3 % 2)
    });
    let args = ["--dry-run", "--set=data.time_zone=Europe/Berlin", "--set=data.period_secs=1800"];
    let told = place.on_study("control", &args).stderr();
    let part = "2 rows have a time of an hour that clocks showed twice or never (data.time_zone), which no other row decides, and are left out";
    assert!(told.contains(part), "{told}");
    assert!(!told.contains("no time and"), "every row has a time: {told}");
}

#[test]
fn warnings_about_the_log_are_in_the_verdict_and_its_report() {
    let place = pump(|row| {
        let gain = if row == 20 { String::new() } else { (row % 3).to_string() };
        format!("2024-03-01 00:{row:02}:00,{},{gain},{}\n", row % 7, (row + 1) % 2)
    });
    place.edit("log.csv", "level,pump", "level,gain,pump");
    place.edit_study("[{ column = \"pump\", weight = -1 }]", "\"gain\"");
    let warning = "1 row has no reward though an action leads there, the first at 2024-03-01 00:20:00: an episode ends before each. Rewards are \
                   never filled in";
    let ran = place.calib(&["control", "study.toml", "--json"]);
    assert_eq!(ran.stderr().matches(warning).count(), 1, "{}", ran.stderr());
    let json = ran.json(&[0, 1]);
    assert_eq!(json["log_warnings"], serde_json::json!([warning]));
    assert_eq!(json["decision_secs"], 60.0);
    let page = place.read("study-results/control/report.html");
    for part in [
        "About the log",
        "1 row has no reward though an action leads there",
        "What an episode is",
        "The reward of a step is the column gain.",
        "from one decision to the next it is 1 min",
    ] {
        assert!(page.contains(part), "{part} is missing");
    }
    // The states are the same, so the runs stay and only the warnings are others.
    let typo = ["control", "study.toml", "--json", "--set", "data.exclude=['flwo']"];
    let again = place.calib(&typo);
    assert!(again.stderr().contains("is up to date"), "{}", again.stderr());
    let unused = "data.exclude = \"flwo\" matches no channel";
    assert_eq!(again.json(&[0, 1])["log_warnings"], serde_json::json!([warning, unused]));
    let verdict = place.read_json("study-results/control/verdict.json");
    assert_eq!(verdict["log_warnings"], serde_json::json!([warning, unused]));
}

#[test]
fn a_term_that_rewards_a_deviation_is_told() {
    let place = pump(|row| row_of_pump(row, (row + 1) % 2));
    let told = |term: &str| {
        let reward = format!("--set=control.reward=[{term}]");
        place.calib(&["inspect", "study.toml", &reward]).stderr()
    };
    let rewarded = told("{ column = \"level\", set_point = 78.4 }");
    let part = "control.reward[0] has weight 1 for the distance of level from 78.4, so that agents get more reward the larger that is";
    assert!(rewarded.contains(part), "{rewarded}");
    let cost = told("{ column = \"level\", set_point = 78.4, weight = -1 }");
    assert!(!cost.contains("control.reward[0]"), "{cost}");
}

#[test]
fn terminals_without_a_reward_are_told() {
    let place =
        with_terminals(|row| if row % 10 == 9 { ",1".to_owned() } else { "2,0".to_owned() });
    let told = place.calib(&["inspect", "study.toml"]).stderr();
    assert!(told.contains("4 rows have no reward though an action leads there"), "{told}");
    assert!(told.contains("4 of the 4 terminals are in rows without a reward"), "{told}");
}

#[test]
fn gaps_among_terminals_are_told_and_drop_no_column() {
    let place = with_terminals(|row| {
        let end = if row % 5 == 2 { "" } else { ["0", "1"][usize::from(row % 10 == 9)] };
        format!("{},{end}", row % 3)
    });
    let inspected = place.calib(&["inspect", "study.toml"]);
    let told = inspected.stderr();
    let part = "end (control.terminal) has 0 in some rows and no number in 8 of 40 rows, the first at 2024-03-01 00:02:00";
    assert!(told.contains(part), "{told}");
    let shown = inspected.succeeds();
    assert!(!shown.contains("preprocess.max_missing"), "the column is read: {shown}");
    let of_log = place.calib(&["inspect", "log.csv"]).succeeds();
    assert!(of_log.contains("preprocess.max_missing"), "it would be no state: {of_log}");
}

#[test]
fn terminals_in_most_rows_are_told() {
    let place = with_terminals(|row| format!("{},{}", row % 3, usize::from(row % 10 != 9)));
    let told = place.calib(&["inspect", "study.toml"]).stderr();
    let part = "end (control.terminal) is another number than 0 in 36 of 40 rows, and an episode ends in each";
    assert!(told.contains(part), "{told}");
    let place = with_terminals(|row| format!("{},7", row % 3));
    let told = place.calib(&["inspect", "study.toml"]).fails(2);
    assert!(told.contains("the terminal is another number than 0 in every row"), "{told}");
}

#[test]
fn a_lag_longer_than_episodes_is_told() {
    let place = with_terminals(|row| format!("{},{}", row % 3, usize::from(row % 10 == 9)));
    let told = place.calib(&["inspect", "study.toml", "--set=control.lag=20"]).stderr();
    let part = "with control.lag = 20 the action of 100 % of the decisions (36 of 36) would be shown after the terminal";
    assert!(told.contains(part), "{told}");
    let told = place.calib(&["inspect", "study.toml", "--set=control.lag=1"]).stderr();
    assert!(!told.contains("control.lag"), "{told}");
}

/// A controller is in automatic mode for two rows.
#[test]
fn text_among_actions_is_told() {
    let place = pump(|row| {
        let pump = if [20, 21].contains(&row) { "auto" } else { ["0", "1"][row % 2] };
        format!("2024-03-01 00:{row:02}:00,{},{pump}\n", row % 7)
    });
    let wide = ["inspect", "study.toml", "--set=data.shape=wide"];
    let inspected = place.calib(&wide);
    let told = inspected.stderr();
    assert!(
        told.contains(
            "pump (control.actions) holds text in 2 rows of the log, such as \"auto\": text counts as missing"
        ),
        "{told}"
    );
    inspected.succeeds_with(&["37 transitions in 2 episodes"]);
}

#[test]
fn mistakes_in_rewards_and_grids_name_the_key() {
    let place = place();
    for (set, told) in [
        (
            "reward=[{ column = 'angle', wieght = -1.0 }]",
            "control.reward: unknown key `wieght`; did you mean",
        ),
        ("reward=3", "control.reward: expected the name of a column, or a list of terms"),
        ("reward={ column = 'angle' }", "control.reward: expected the name of a column"),
        ("reward=[{ column = 'angle', weight = 'x' }]", "control.reward.weight: expected a number"),
        (
            "reward=[{ column = 'angle', set_point = true }]",
            "control.reward.set_point: expected a number or the name of a column",
        ),
        (
            "reward=[{ column = 'angle', set_point = 'place', high = 1.0 }]",
            "reward[0] has both set_point and high: write two terms",
        ),
        (
            "reward=[{ column = 'angle' }, { column = 'place', set_point = 'plaace' }]",
            "control.reward[1].set_point: the log has no column plaace; did you mean place?",
        ),
        (
            "reward=[{ column = 'angle' }, { column = 'angle', low = 1.0, high = 0.5 }]",
            "`reward[1].low` is 1, expected at most what `high` is",
        ),
        (
            "reward=[{ column = 'qqq' }]",
            "control.reward[0].column: the log has no column qqq; give one of its columns",
        ),
        (
            "grid={ epsilon = [0.1, 0.2] }",
            "control.grid.epsilon decides nothing: expected_sarsa does not use it",
        ),
        ("terminal='action'", "control.terminal names action, which control.actions names already"),
        ("reward='action'", "control.reward names action, which control.actions names already"),
        ("terminal='reward'", "control.terminal names reward, which control.reward names already"),
        ("grid={ hidden_width = [8, 16] }", "control.grid.hidden_width decides nothing"),
        ("grid={ step_size = [0.1, 0.2, 0.1] }", "control.grid.step_size has the value 0.1 twice"),
    ] {
        let args = ["control", "pole/study.toml", "--dry-run", "--set", &format!("control.{set}")];
        let refused = place.calib(&args).fails(2);
        assert!(refused.contains(told), "{set}: {refused}");
    }
}
