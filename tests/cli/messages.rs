//! Messages, on a terminal and in a file.

use crate::harness::Place;

#[test]
fn a_file_keeps_what_is_said_and_what_quiet_hides() {
    let place = Place::with_study();
    let built = place.calib(&["build-model", "study.toml", "-q", "--log", "said.log"]);
    built.succeeds();
    assert_eq!(built.stderr(), "");
    let kept = place.read("said.log");
    assert!(kept.contains(" info    reading data"), "{kept}");
    assert!(kept.contains(" result  "), "{kept}");
    for line in kept.lines() {
        let (time, rest) = line.split_once(' ').expect("a time and more");
        assert!(time.starts_with("20") && time.ends_with('Z') && time.contains('T'), "{line}");
        let known = ["info", "step", "warning", "error", "result"];
        assert!(known.iter().any(|kind| rest.starts_with(kind)), "{line}");
    }
    // The next command appends its messages, and the reason of its failure.
    let told =
        place.calib(&["build-model", "study.toml", "--set", "agent.gamma=7", "--log", "said.log"]);
    let refused = told.fails(2);
    let both = place.read("said.log");
    assert!(both.starts_with(&kept), "{both}");
    assert!(both.contains(" error   ") && both.contains("gamma"), "{both}\n{refused}");
    let refused = place.calib(&["build-model", "study.toml", "--log", "data"]).fails(2);
    assert!(refused.contains("data") && refused.contains("a folder"), "{refused}");
}

#[test]
fn verbose_lines_begin_with_the_time() {
    let place = Place::with_study();
    let said = place.calib(&["build-model", "study.toml", "-v"]).stderr();
    assert!(said.lines().any(|line| line.ends_with("s  reading data")), "{said}");
    let mut timed = said.lines().filter(|line| line.contains(" s  "));
    assert!(timed.all(begins_with_a_number), "{said}");
    place.calib(&["build-model", "study.toml", "-v", "-q"]).fails_with(2, &["--quiet"]);
}

fn begins_with_a_number(line: &str) -> bool {
    line.trim().split(' ').next().is_some_and(|word| word.parse::<f64>().is_ok())
}

#[test]
fn what_to_type_next_has_a_colour() {
    let place = Place::with_study();
    let said = place.calib(&["build-model", "study.toml", "--color", "always"]).stderr();
    assert!(said.contains("next: \u{1b}[36;1mcalib rollout study.toml\u{1b}[0m"), "{said}");
}
