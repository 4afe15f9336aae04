//! The paper's studies are valid as they stand, and their small profiles run.

use std::{fs, path::Path};

use crate::harness::Place;

/// A directory with the three studies.
fn place() -> Place {
    let place = Place::new();
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/paper");
    for entry in fs::read_dir(configs).expect("readable").flatten() {
        let name = entry.file_name().into_string().expect("a name");
        fs::copy(entry.path(), place.path().join(name)).expect("copied");
    }
    place
}

#[test]
fn the_papers_studies_are_valid_at_every_size() {
    let place = place();
    for (study, steps) in [
        ("one-week.toml", "then: represent, build-model, rollout, sweep, evaluate"),
        ("twelve-months.toml", "then: represent, build-model, rollout, sweep, evaluate"),
        ("fine-tuning.toml", "then: pretrain, represent, build-model, rollout, sweep, evaluate"),
    ] {
        let whole = place.calib(&["run", study, "--dry-run"]);
        assert_eq!(whole.code(), 0, "{}", whole.stderr());
        assert!(whole.stderr().contains("days x 480 channels"), "{}", whole.stderr());
        assert!(whole.stderr().contains(steps), "{}", whole.stderr());
        let sizes = ["tiny", "small"].into_iter();
        let changing = ["change", "tiny-change", "small-change"].into_iter();
        for profile in sizes.chain(changing.filter(|_| study != "one-week.toml")) {
            let other = place.calib(&["run", study, "--dry-run", "--profile", profile]);
            assert_eq!(other.code(), 0, "{}", other.stderr());
            assert!(other.stderr().contains(steps), "{}", other.stderr());
        }
    }
}

#[test]
fn the_week_runs_to_one_report_on_its_models() {
    let place = place();
    let tiny = ["run", "one-week.toml", "--profile", "tiny"];
    let verdict = place.calib(&tiny).succeeds();
    for model in ["euclidean", "laplacian", "nn", "gru"] {
        assert!(verdict.contains(model), "{verdict}");
    }
    let results = place.path().join("one-week-results/tiny");
    let report = fs::read_to_string(results.join("report.html")).expect("written");
    assert!(report.contains("Four models of one week"), "the title");
    // What is there can be looked at again, and a dry run looks into every step.
    let dry = place.calib(&[&tiny[..], &["--dry-run"]].concat());
    assert_eq!(dry.code(), 0, "{}", dry.stderr());
    let said = "up to date: reading the log, represent, build-model, rollout, sweep";
    assert!(dry.stderr().contains(said), "{}", dry.stderr());
}
