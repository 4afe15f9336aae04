//! Acting agents that are external programs: their input, the use of their answers, and messages about failures.
#![cfg(unix)]

use std::fs;

use crate::{
    control::{place, pump},
    harness::Place,
};

/// A program that always takes the action in its parameters.
const ALWAYS: &str = r#"
while read -r line; do
  case $line in
    *'"begin"'*) action=$(echo "$line" | sed 's/.*"action":\([0-9a-z]*\).*/\1/'); echo '{"ready": 1}' ;;
    *'"ends"'*) echo '{"ready": 1}' ;;
    *) echo "{\"action\": $action}" ;;
  esac
done
"#;

/// Section of a study that uses the program.
const PROGRAM: &str = "[agent]\nkind = \"external\"\ncommand = [\"sh\", \"agent.sh\"]\n[agent.parameters]\naction = 1\n[sweep.grid]\naction = [0, 1]\n";

/// Returns the pump study with agents of a program in `sh`.
fn pump_of_a_program(script: &str) -> Place {
    let place = pump(|row| format!("2024-03-01 00:{row:02}:00,{},{}\n", row % 7, (row + 1) % 2));
    place.write("agent.sh", script);
    place.extend_study(&format!("timeout = 20\n{PROGRAM}"));
    place
}

#[test]
fn agents_of_a_program_act_and_are_judged() {
    let place = pump_of_a_program(ALWAYS);
    let args = ["control", "study.toml", "--threads", "2"];
    let told = place.calib(&args).ends(&[0, 1]);
    assert!(told.contains("action=0") && !told.contains("fitted Q"), "{told}");
    let first = place.content("study-results/control");
    let again = place.calib(&args);
    again.ends(&[0, 1]);
    assert!(again.stderr().contains("up to date"), "{}", again.stderr());
    place.calib(&["control", "study.toml", "--force", "--threads", "1"]).ends(&[0, 1]);
    assert!(place.content("study-results/control") == first, "the same bytes on one thread");
    let json = place.calib(&[&args[..], &["--json"]].concat()).json(&[0, 1]);
    assert_eq!(json["choice"], serde_json::json!({ "parameters": { "action": 0 } }));
    assert_eq!(json["verdict"]["default"], 1);
    // A program that never changes its action has exactly the result of that constant action.
    assert_eq!(json["verdict"]["constant"]["action"], 0);
    // The constant action is averaged over more runs, so the last digits may differ.
    let [constant, chosen] = [
        &json["verdict"]["constant"]["mean_return"],
        &json["verdict"]["selection"]["mean_errors"][0],
    ]
    .map(|value| value.as_f64().expect("a return"));
    assert!((constant - chosen).abs() <= 1e-9 * chosen.abs(), "{constant} and {chosen}");
    assert_eq!(json["verdict"]["selection"]["mean_errors"].as_array().map(Vec::len), Some(2));
    place.calib(&["check", "study-results"]).succeeds();
    // Another program needs another verdict.
    place.write("agent.sh", &format!("{ALWAYS}# changed\n"));
    let other = place.calib(&args);
    other.ends(&[0, 1]);
    assert!(!other.stderr().contains("/control is up to date"), "{}", other.stderr());
}

/// Each run gets its own input.
#[test]
fn a_program_is_told_what_its_actions_led_to() {
    let hearing = ALWAYS.replace("  case", "  echo \"$line\" >> heard\n  case");
    let heard = heard_in(&pump_of_a_program(&hearing), "study.toml");
    // Two settings in two ensemble members, and the chosen setting once more; each for 50 steps in episodes of 20.
    assert_eq!(lines_with(&heard, "\"begin\""), 5);
    assert_eq!(lines_with(&heard, "\"ends\":\"timeout\""), 5 * 2, "{heard}");
    assert_eq!(lines_with(&heard, "\"ends\":\"terminal\""), 0);
    assert_eq!(lines_with(&heard, "\"reward\""), 5 * 49, "that of the last step changes nothing");
    assert_eq!(
        lines_with(&heard, "\"state\""),
        5 * (49 + 3),
        "and the first states of three episodes"
    );
    let begin = heard.lines().next().expect("a beginning");
    let begin: serde_json::Value = serde_json::from_str(begin).expect("JSON");
    let begin = &begin["begin"];
    assert_eq!((&begin["columns"], &begin["actions"]), (&1.into(), &2.into()));
    assert_eq!(begin["action_names"], serde_json::json!(["pump=0", "pump=1"]));
    assert_eq!((&begin["steps"], &begin["timeout"]), (&50.into(), &20.into()));
    assert_eq!(begin["gamma"], 0.99);
    let pole = place();
    let study = pole.read("pole/study.toml");
    let (study, _) = study.split_once("[control.grid]").expect("a grid");
    let agent = format!("{study}{PROGRAM}").replace("steps = 1500", "steps = 200");
    fs::write(pole.path().join("pole/study.toml"), agent).expect("writable");
    pole.write("pole/agent.sh", &hearing);
    let heard = heard_in(&pole, "pole/study.toml");
    assert!(lines_with(&heard, "\"ends\":\"terminal\"") > 10, "a pole falls soon");
    assert_eq!(lines_with(&heard, "\"ends\":\"timeout\""), 0);
}

/// Returns the input that a program recorded while `study` ran.
fn heard_in(place: &Place, study: &str) -> String {
    let args = ["control", study, "--threads", "1", "--set", "control.models=[\"neighbors\"]"];
    place.calib(&args).ends(&[0, 1]);
    let study = place.path().join(study);
    fs::read_to_string(study.with_file_name("heard")).expect("the program wrote it")
}

/// Counts the lines that contain `part`.
fn lines_with(heard: &str, part: &str) -> usize {
    heard.lines().filter(|line| line.contains(part)).count()
}

/// Counts the runs that a program recorded as begun.
fn begun(place: &Place) -> usize {
    fs::read_to_string(place.path().join("begun")).map_or(0, |text| text.lines().count())
}

/// The actions of an agent are unknown before it acts.
#[test]
fn a_dry_run_does_not_run_the_program() {
    let counting = ALWAYS.replace("*'\"begin\"'*) ", "*'\"begin\"'*) echo >> begun; ");
    let place = pump_of_a_program(&counting);
    let dry = place.calib(&["control", "study.toml", "--dry-run"]);
    dry.succeeds();
    let told = dry.stderr();
    for part in [
        "runs left to make: 12 of 12, on ",
        "how long it takes is not known: it depends on the program",
        "without what the agents' program takes",
    ] {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
    assert_eq!(begun(&place), 0);
}

/// Runs are kept, except for those that cannot be trusted.
#[test]
fn a_sweep_of_a_program_goes_on() {
    let args = ["control", "study.toml", "--threads", "1"];
    let counting = ALWAYS.replace("*'\"begin\"'*) ", "*'\"begin\"'*) echo >> begun; ");
    // The program fails with one setting until the file `go` exists.
    let failing =
        counting.replace("    *) echo", "    *) [ $action = 1 ] && [ ! -e go ] && exit 3; echo");
    let whole = pump_of_a_program(&failing);
    whole.write("go", "");
    whole.calib(&args).ends(&[0, 1]);
    let all = begun(&whole);
    let stopped = pump_of_a_program(&failing);
    let without = stopped.calib(&args);
    without.ends(&[0, 1]);
    let told = without.stderr();
    assert!(told.contains("exit status: 3 before it had answered a state of a run"), "{told}");
    assert!(told.contains("action = 1, which is therefore last in every ranking"), "{told}");
    let status = stopped.calib(&["status", "study.toml"]).succeeds();
    assert!(!status.contains("no ranking yet"), "{status}");
    // The failed setting is tried again. Of the other setting, only the last
    // steps of the chosen agent are run once more.
    stopped.write("go", "");
    let before = begun(&stopped);
    let again = stopped.calib(&args);
    again.ends(&[0, 1]);
    assert!(!again.stderr().contains("last in every ranking"), "{}", again.stderr());
    assert_eq!(begun(&stopped) - before, all.div_ceil(2), "half of the runs, and the last steps");
    assert!(stopped.content("study-results/control") == whole.content("study-results/control"));
    // With --force no earlier run is used.
    let before = begun(&stopped);
    stopped.calib(&[&args[..], &["--force"]].concat()).ends(&[0, 1]);
    assert_eq!(begun(&stopped) - before, all);
    // A program that dies between two agents is started again.
    let dying = ALWAYS.replace(
        "*'\"begin\"'*) ",
        "*'\"begin\"'*) began=$((began + 1)); [ $began = 6 ] && exit 3; ",
    );
    let dying = pump_of_a_program(&dying);
    let told = dying.calib(&args);
    told.ends(&[0, 1]);
    assert!(!told.stderr().contains("exit status"), "{}", told.stderr());
    let changing = pump_of_a_program(&ALWAYS.replace("while", "echo '# more' >> agent.sh; while"));
    let told = changing.calib(&args).fails(2);
    assert!(told.contains("a file of `sh agent.sh` was changed while the sweep ran"), "{told}");
    let kept = changing.content("study-results/control-units");
    let mut names = kept.keys().map(|name| name.to_string_lossy());
    assert!(!names.any(|name| name.starts_with("run-")), "{:?}", kept.keys());
    // The program answers everything, and always exits with an error.
    let bad = pump_of_a_program(&format!("{ALWAYS}\nexit 4"));
    for _ in 0..2 {
        bad.calib(&args).fails_with(2, &["exit status: 4 after its last answer"]);
    }
    let more = pump_of_a_program(&ALWAYS.replace("$action}\"", "$action}\"; echo more"));
    more.calib(&args).fails_with(2, &["`sh agent.sh` ", "\"more"]);
}

#[test]
fn a_program_that_cannot_act_is_told() {
    let told = refusal_of(&ALWAYS.replace("$action}\"", "7}\""));
    assert!(
        told.contains("`sh agent.sh` answered a state of a run with action = ")
            && told.contains("with action 7: expected a whole number below 2"),
        "{told}"
    );
    let told = refusal_of(&ALWAYS.replace("{\\\"action\\\": $action}", "go left"));
    assert!(told.contains("expected one line such as {\"action\": 0}"), "{told}");
    let told = refusal_of(&ALWAYS.replace("\\\"action\\\": $action", ""));
    assert!(
        told.contains("with \"{}\\n\": expected one line")
            || told.contains("with \"{}\": expected one line"),
        "{told}"
    );
    let told = refusal_of("read -r line; echo '{\"error\": \"no such parameter\"}'");
    assert!(
        told.contains("the beginning of a run with action = ")
            && told.contains(": no such parameter"),
        "{told}"
    );
    let told =
        refusal_of(&ALWAYS.replace("*'\"ends\"'*) echo '{\"ready\": 1}'", "*'\"ends\"'*) exit 3"));
    assert!(told.contains("exit status: 3 before it had answered the end of an episode"), "{told}");
    let own = pump_of_a_program(ALWAYS);
    own.calib(&["control", "study.toml", "--set", "control.agent.step_size=0.5"])
        .fails_with(2, &["[control.agent] and [control.grid] are of calib's own agents"]);
    own.calib(&["control", "study.toml", "--set", "sweep.grid={ speed = [1, 2] }"])
        .fails_with(2, &["[agent.parameters]"]);
}

/// Returns the error message about a program that cannot act.
fn refusal_of(script: &str) -> String {
    pump_of_a_program(script).calib(&["control", "study.toml"]).fails(2)
}

/// An agent that diverges is ranked last, and the other settings are still judged.
#[test]
fn an_agent_of_a_program_may_diverge() {
    let place = pump_of_a_program(&ALWAYS.replace(
        "echo \"{\\\"action\\\": $action}\"",
        "[ $action = 1 ] && action=null; echo \"{\\\"action\\\": $action}\"",
    ));
    let json = place.calib(&["control", "study.toml", "--json"]).json(&[0, 1]);
    assert_eq!(json["verdict"]["chosen"], 0);
    assert_eq!(json["verdict"]["selection"]["mean_errors"][1], "-inf");
}

/// A failing setting is ranked last, and the other settings are still judged,
/// with the same bytes on any number of threads.
#[test]
fn a_program_may_fail_with_one_setting() {
    let failing = ALWAYS.replace(
        "*'\"begin\"'*) ",
        "*'\"action\":1'*) echo '{\"error\": \"no such valve\"}' ;; *'\"begin\"'*) ",
    );
    let place = pump_of_a_program(&failing);
    let told = place.calib(&["control", "study.toml", "--threads", "1", "--json"]);
    let json = told.json(&[0, 1]);
    assert_eq!(json["verdict"]["chosen"], 0);
    assert_eq!(json["failures"][0]["candidate"], 1);
    // The failing setting is the default, without which no choice is supported.
    assert!(told.stderr().contains("the program failed with the default"), "{}", told.stderr());
    assert_eq!((told.code(), &json["is_ahead_of_default"]), (1, &false.into()));
    assert!(told.stderr().contains("a run with action = 1: no such valve"), "{}", told.stderr());
    let report = place.read("study-results/control/report.html");
    assert!(report.contains("the program failed with action = 1"));
    // In the table of settings, and beside the figure as the mean and the best of the value.
    assert!(report.matches(">failed<").count() >= 3);
    assert!(!report.contains(">diverged<"), "no agent did");
    let other = pump_of_a_program(&failing);
    other.calib(&["control", "study.toml", "--threads", "2"]).ends(&[0, 1]);
    let both = [&place, &other].map(|place| place.content("study-results/control"));
    assert!(both[0] == both[1], "the same bytes on any number of threads");
    place.calib(&["check", "study-results"]).succeeds();
    // A share has run all that it could run.
    let shared = pump_of_a_program(&failing);
    let models = "--set=control.models=[\"neighbors\"]";
    for counts in ["2 runs made, 0 there before", "0 runs made, 2 there before"] {
        let share = shared.calib(&["control", "study.toml", "--share", "0/1", models]);
        let told = share.succeeds();
        assert!(told.contains(&format!("share 0/1: {counts}, of 4 in all")), "{told}");
        let warned = share.stderr();
        assert!(warned.contains("the program failed with action = 1"), "{warned}");
    }
    let shown = place.calib(&["control", "study.toml", "--threads", "1"]).ends(&[1]);
    let status = place.calib(&["status", "study.toml"]).succeeds();
    assert!(shown.contains("\n    the program failed with the default, so that"), "{shown}");
    for told in [shown, status] {
        assert!(told.contains("failed") && !told.contains("diverged"), "{told}");
    }
}
