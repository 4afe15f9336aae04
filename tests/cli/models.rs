//! Several models of one study, in one report.

use std::path::Path;

use crate::harness::Place;

const MODELS: &str = r#"
[models.euclidean]

[models.laplacian.representation]
kind = "laplacian"
dimension = 8
hidden_units = 32
batch_size = 32
steps = 200
"#;

fn place() -> Place {
    let place = Place::with_study();
    place.extend_study(MODELS);
    place
}

#[test]
fn models_are_compared_in_one_report() {
    let place = place();
    place.run_steps(&["represent", "build-model", "rollout"]);
    place.calib(&["sweep", "study.toml", "--model", "euclidean"]).succeeds();
    let sweep = place.calib(&["sweep", "study.toml", "--model", "laplacian"]);
    // Two sensors in three members with two runs each. Held-out runs and log replay are shared.
    assert!(sweep.succeeds().contains("36 training runs made"), "{}", sweep.stdout());
    let compared = place.calib(&["evaluate", "study.toml", "--why"]);
    let table = compared.stdout();
    assert!(table.contains("order agrees") && table.contains("DTW"), "{table}");
    assert!(table.contains("laplacian ranks") && table.contains("euclidean ranks"));
    let results = place.path().join("study-results");
    for file in ["report.html", "models/euclidean/report.html", "models/laplacian/report.html"] {
        assert!(results.join(file).is_file(), "{file} is missing");
    }
    let report = place.read("study-results/report.html");
    assert!(report.contains("Representations of laplacian"));
    assert!(report.contains("euclidean, worst rank") && report.contains("laplacian, worst rank"));
    // Only held-out data makes a model preferable, and curves have the name of their model.
    assert!(
        report.contains("smallest regret on held-out data is that of")
            || report.contains("equally good")
            || report.contains("all models choose")
            || report.contains("whichever model chooses")
    );
    assert!(
        report.contains("ensemble member 0 of laplacian") && report.contains("PIT300, euclidean")
    );
    // The report has the commands, and the study with all its models.
    assert!(
        report.contains("calib represent study.toml\ncalib build-model study.toml\ncalib rollout")
    );
    assert!(report.contains("[models.laplacian.representation]"), "the study has all models");
    let own = place.read("study-results/models/laplacian/report.html");
    assert!(own.contains("calib represent study.toml --model laplacian"));
    assert!(own.contains("[models.laplacian.representation]"), "the study has all models");
    let summary = place.calib(&["evaluate", "study.toml", "--json", "-q"]).json(&[0, 1]);
    assert_eq!(summary["models"]["laplacian"]["verdicts"].as_array().expect("a list").len(), 2);
    // A model alone gives the same results as in a study of its own.
    place.edit_study("[models.laplacian.representation]", "[representation]");
    place.edit_study("[models.euclidean]", "");
    for command in ["represent", "build-model"] {
        place.calib(&[command, "study.toml", "--output", "alone"]).succeeds();
    }
    let alone = place.path().join("alone/model/members/0/neighbors.npy");
    let together = results.join("models/laplacian/model/members/0/neighbors.npy");
    assert!(read(&alone) == read(&together));
}

fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).expect("readable")
}

#[test]
fn a_model_is_chosen_by_name() {
    let place = place();
    let unknown = place.calib(&["build-model", "study.toml", "--model", "gru"]).fails(2);
    assert!(unknown.contains("the study's models are euclidean, laplacian"), "{unknown}");
    let json = place.calib(&["build-model", "study.toml", "--json"]).fails(2);
    assert!(json.contains("add --model NAME (euclidean, laplacian)"), "{json}");
    let missing = place.calib(&["build-model", "study.toml", "--model", "laplacian"]).fails(2);
    assert!(missing.contains("calib represent study.toml --model laplacian"), "{missing}");
    place.edit_study("dimension = 8", "dimensions = 8");
    place.calib(&["represent", "study.toml"]).fails_with(2, &["did you mean `dimension`"]);
    place.edit_study("dimensions = 8", "dimension = 8");
    place.edit_study("[models.euclidean]", "[models.euclidean]\nseed = 9");
    place
        .calib(&["represent", "study.toml"])
        .fails_with(2, &["[models.euclidean]: seed cannot differ from model to model"]);
    place.edit_study("[models.euclidean]\nseed = 9", "[models.\"a/b\"]");
    place.calib(&["represent", "study.toml"]).fails_with(2, &["names have ASCII letters"]);
}
