//! The studies of the paper are valid as written, and their small profiles run.

use std::{fs, path::Path};

use crate::harness::Place;

/// Returns a directory with the three studies.
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
    for study in ["one-week.toml", "twelve-months.toml", "fine-tuning.toml"] {
        let status = place.calib(&["status", study]).succeeds();
        assert!(status.contains("reading the log"), "{status}");
        let sizes = ["tiny", "small"].into_iter();
        let changing = ["change", "tiny-change", "small-change"].into_iter();
        for profile in sizes.chain(changing.filter(|_| study != "one-week.toml")) {
            place.calib(&["status", study, "--profile", profile]).succeeds();
        }
    }
}

#[test]
fn a_dry_run_says_what_a_study_takes_before_its_log_is_simulated() {
    let place = place();
    let dry = place.calib(&["run", "one-week.toml", "--dry-run"]);
    assert_eq!(dry.code(), 0, "{}", dry.stderr());
    let said = dry.stderr();
    // The simulated log has 345,244 x 142, because some gaps remove rows. The
    // sample counts the rows that it stands for.
    assert!(said.contains("345,619 rows x 142 columns; 1 representation"), "{said}");
    let order = ["simulate", "represent,", "build-model,", "rollout,", "sweep,", "evaluate"];
    let places = order.map(|step| said.find(&format!("] {step}")).expect(step));
    assert!(places.is_sorted(), "{said}");
    // Runs that models share count once: 40 of 90 passes, and of 50.
    assert!(said.contains("(160 passes over the data"), "{said}");
    assert!(said.contains("all sweeps together: expecting about"), "{said}");
    let files = fs::read_dir(place.path()).expect("readable").flatten();
    assert_eq!(files.count(), 3, "nothing is written");
}

#[test]
fn the_week_runs_to_one_report_on_its_models() {
    let place = place();
    let tiny = ["run", "one-week.toml", "--profile", "tiny"];
    let verdict = place.calib(&tiny).succeeds();
    for model in ["euclidean", "laplacian", "nn", "gru"] {
        assert!(verdict.contains(model), "{verdict}");
    }
    let report = place.read("one-week-results/tiny/report.html");
    assert!(report.contains("Four models of one week"), "the title");
    // Existing results can be shown again, and a dry run checks every step.
    let dry = place.calib(&[&tiny[..], &["--dry-run"]].concat());
    assert_eq!(dry.code(), 0, "{}", dry.stderr());
    let said = "up to date: reading the log, represent, build-model, rollout, sweep";
    assert!(dry.stderr().contains(said), "{}", dry.stderr());
}
