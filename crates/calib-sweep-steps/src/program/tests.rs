//! Tests with `sh` scripts as programs, which need Unix.
#![cfg(unix)]

use calib_core::{RowStream, Seed, Segments, Silent, States};

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use super::{command::fingerprint, *};

/// A minimal implementation of the protocol in shell. It predicts 1, 2, 3, …, and reads states of one column as bytes.
const COUNTING: &str = r#"
read begin; echo '{"ready": 1}'
while read head; do
  case $head in *begin*'"calib"'*) echo '{"ready": 1}'; continue;; esac
  states=$(echo "$head" | sed 's/.*"states":\([0-9]*\).*/\1/')
  head -c $((4 * states)) > /dev/null
  list=$(seq -s , 1 $states)
  echo "{\"predictions\": [$list], \"updates\": $states}"
done
"#;

fn program(script: &str, timeout: f64) -> ExternalAgents {
    let command = ["sh", "-c", script].map(str::to_owned).to_vec();
    ExternalAgents {
        program: ProgramCommand {
            fingerprint: fingerprint(&command, Path::new("/")).expect("no files"),
            words: command,
            folder: PathBuf::from("/"),
            timeout: Duration::from_secs_f64(timeout),
        },
        states_per_message: 4,
    }
}

fn asked(program: &ExternalAgents, agents: usize) -> Result<Vec<ProgramPredictions>, String> {
    let values = (0..12_u8).map(f32::from).collect();
    let states = States::new(values, 12, 1).expect("valid");
    let stream = RowStream::replay(states, &Segments::from_lengths([7, 5]).expect("valid"));
    let agent = AgentConfig::default();
    let wanted = PredictionRequest {
        sensor: "A",
        column: 0,
        agents: vec![&agent; agents],
        seed: Seed::new(7),
        stream: &stream,
        steps: 9,
    };
    program.predictions(&wanted, &Silent).map_err(|stopped| match stopped {
        ProgramStopped::Cancelled(_) => "interrupted".to_owned(),
        ProgramStopped::Failed(error) | ProgramStopped::CannotAnswer(error) => {
            let source = error.source().map_or_else(String::new, |source| format!(": {source}"));
            format!("{error}{source}")
        }
    })
}

#[test]
fn predictions_come_piece_by_piece() {
    // 7 states in messages of 4 and 3, the last of which does not count. Then states 7 to 9, because step 8 leads to
    // state 9.
    let expected = [1., 2., 3., 4., 1., 2., 0., 1., 2.];
    let got = asked(&program(COUNTING, 20.0), 2).expect("answers");
    assert_eq!(got.len(), 2);
    for predicted in got {
        assert_eq!(predicted, ProgramPredictions { values: expected.to_vec(), updates: 3 });
    }
}

#[test]
fn what_is_not_finite_ends_a_run() {
    let script = r#"read a; echo '{"ready": 1}'; read b; echo '{"predictions": [1, 1e39]}'; cat > /dev/null"#;
    let got = asked(&program(script, 20.0), 1).expect("answers");
    assert_eq!(got[0].values[0], 1.0);
    assert!(got[0].values[1].is_nan() && got[0].values[2..].iter().all(|value| *value == 0.0));
}

fn failure(script: &str, timeout: f64) -> String {
    asked(&program(script, timeout), 1).expect_err("it fails")
}

#[test]
fn programs_that_fail_are_named() {
    let dead = failure("read a; echo oh no >&2; exit 3", 20.0);
    assert!(dead.contains("sh -c") && dead.contains("exit status: 3"), "{dead}");
    assert!(dead.ends_with("at last it said: oh no"), "{dead}");
    let hangs = failure("read a; sleep 20", 0.2);
    assert!(hangs.contains("has not answered the beginning of a run"), "{hangs}");
    assert!(hangs.contains("for 0.2 s") && hangs.contains("agent.timeout_secs"), "{hangs}");
    let babbles = failure("echo hello; cat > /dev/null", 20.0);
    assert!(babbles.contains(r#"with "hello": expected one line"#), "{babbles}");
    assert!(babbles.contains("standard error"), "{babbles}");
    let endless = failure("yes no | tr -d '\\n'", 20.0);
    assert!(endless.contains("nonono") && endless.len() < 1000, "{endless}");
    let other = failure(r#"echo '{"ready": 2}'; cat > /dev/null"#, 20.0);
    assert!(other.contains(r#"expected one line such as {"ready": 1}"#), "{other}");
    let refuses = failure(r#"read a; echo '{"error": "no rate"}'"#, 20.0);
    assert!(refuses.ends_with(": no rate"), "{refuses}");
    let few = r#"read a; echo '{"ready": 1}'; read b; echo '{"predictions": [1]}'; cat"#;
    let few = failure(few, 20.0);
    assert!(few.contains("answered 4 states with 1 predictions"), "{few}");
    let closed = failure("exec >&-; cat > /dev/null", 20.0);
    assert!(closed.contains("has closed its standard output"), "{closed}");
}

#[test]
fn a_program_ends_as_it_should() {
    let bad = COUNTING.to_owned() + "exit 4";
    let told = asked(&program(&bad, 20.0), 1).expect_err("it fails at the end");
    assert!(told.contains("exit status: 4 after its last answer"), "{told}");
    let more = COUNTING.to_owned() + "echo bye";
    let told = asked(&program(&more, 20.0), 1).expect_err("it says more");
    assert!(told.contains(r#"said "bye" beside its answers"#), "{told}");
}

/// Returns the number of live processes with this argument.
#[cfg(target_os = "linux")]
fn living(word: &str) -> usize {
    let all = std::fs::read_dir("/proc").expect("there").flatten();
    all.map(|entry| {
        let line = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
        line.split(|byte| *byte == 0).any(|argument| argument == word.as_bytes())
    })
    .filter(|found| *found)
    .count()
}

#[cfg(target_os = "linux")]
#[test]
fn what_a_program_has_started_ends_with_it() {
    // The children: one in a session of its own, one that keeps the pipes open, and a grandchild whose parent is gone.
    let word = format!("{}.25", 100_000 + std::process::id());
    let children = format!(
        "setsid sleep {word} > /dev/null 2>&1 < /dev/null &\n sleep {word} &\n (setsid sh -c 'sleep {word} & exit' &)\n"
    );
    let got = asked(&program(&(children.clone() + COUNTING), 20.0), 1).expect("answers");
    assert_eq!(got.len(), 1);
    assert_eq!(living(&word), 0, "it ended well");
    let told = asked(&program(&(children.clone() + "exit 3"), 20.0), 1).expect_err("it fails");
    assert!(told.contains("exit status: 3"), "{told}");
    assert_eq!(living(&word), 0, "it ended badly");
    let told = asked(&program(&(children + "trap '' TERM; sleep 20"), 0.2), 1).expect_err("hangs");
    assert!(told.contains("has not answered"), "{told}");
    assert_eq!(living(&word), 0, "it was ended");
}

#[cfg(target_os = "linux")]
#[test]
fn how_a_program_was_killed_is_told() {
    let told = asked(&program("kill -9 $$", 20.0), 1).expect_err("it is gone");
    assert!(told.contains("signal: 9"), "{told}");
}

#[test]
fn a_program_that_is_not_there_is_told() {
    let mut absent = program("", 1.0);
    absent.program.words = vec!["./no-such-agent".to_owned(), "x".to_owned()];
    let told = asked(&absent, 1).expect_err("absent");
    assert!(told.starts_with("`./no-such-agent x` cannot be started in /;"), "{told}");
}

#[test]
fn the_content_of_files_is_known() {
    let folder = tempfile::tempdir().expect("a folder");
    let command = ["python3", "agent.py", "--fast"].map(str::to_owned);
    let absent = fingerprint(&command, folder.path()).expect("readable");
    std::fs::write(folder.path().join("agent.py"), "1").expect("written");
    let first = fingerprint(&command, folder.path()).expect("readable");
    std::fs::write(folder.path().join("agent.py"), "2").expect("written");
    assert!(absent != first && first != fingerprint(&command, folder.path()).expect("readable"));
    let before = fingerprint(&command, folder.path()).expect("readable");
    std::fs::write(folder.path().join("python3"), "no path").expect("written");
    assert_eq!(
        fingerprint(&command, folder.path()).expect("readable"),
        before,
        "a name is looked up elsewhere"
    );
}
