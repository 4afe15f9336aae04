//! Representations: trained, imported, chosen, and used for the neighbour search.

use calib_core::Timestamp;
use calib_data::table::{Table, read_parquet};
use calib_files::{map_npy, read_tensors, write_json, write_npy};
use serde_json::Value;

use crate::harness::Place;

/// A grid of two small representations, to be inserted before `[model]`.
pub(crate) const LAPLACIAN: &str = r#"[representation]
kind = "laplacian"
dimension = 8
hidden_units = 32
batch_size = 32
learning_rate = [1e-3, 3e-3]
steps = 300

[model]"#;

fn laplacian() -> Place {
    let place = Place::with_study();
    place.edit_study("[model]", LAPLACIAN);
    place
}

#[test]
fn a_grid_is_trained_and_the_best_is_searched_in() {
    let place = laplacian();
    let missing = place.calib(&["build-model", "study.toml"]).fails(2);
    assert!(missing.contains("run `calib represent study.toml` first"), "{missing}");
    let trained = place.calib(&["represent", "study.toml"]).succeeds();
    assert!(trained.contains("awareness") && trained.contains("chosen"), "{trained}");
    let manifest = place.read_json("study-results/representation/manifest.json");
    let candidates = manifest["candidates"].as_array().expect("a list");
    let chosen = manifest["chosen"].as_u64().expect("one qualifies") as usize;
    let best = candidates.iter().map(awareness).fold(0.0, f64::max);
    assert_eq!(candidates.len(), 2);
    assert_eq!(awareness(&candidates[chosen]), best);
    assert!(best > 0.5, "{best}");

    let results = place.path().join("study-results");
    let table = read_parquet(&results.join("representation/candidates.parquet")).expect("a table");
    assert_eq!(table.column::<f64>("learning_rate").expect("numbers"), [1e-3, 3e-3]);
    assert!(table.column::<bool>("chosen").expect("flags")[chosen]);
    let curves = read_parquet(&results.join("representation/curves.parquet")).expect("a table");
    assert_eq!(curves.rows(), 40);
    let encoder = read_tensors(&results.join("representation/encoder.safetensors"));
    assert_eq!(encoder.expect("weights").get("4.weight").expect("a layer").shape, [8, 32]);

    assert!(place.calib(&["represent", "study.toml"]).succeeds().contains("up to date"));
    place.run_steps(&["build-model", "rollout", "sweep"]);
    let verified = place.calib(&["build-model", "study.toml", "--verify", "20"]);
    verified.succeeds();
    assert!(verified.stderr().contains("verified: 60 rows agree"), "{}", verified.stderr());
    // Later damage is found, even if the study changes only in keys that the model does not depend on.
    let encoder = results.join("model/encoder.safetensors");
    let good = std::fs::read(&encoder).expect("an encoder");
    let mut damaged = good.clone();
    *damaged.last_mut().expect("bytes") ^= 1;
    std::fs::write(&encoder, &damaged).expect("written");
    let found = place.calib(&["rollout", "study.toml"]).fails(2);
    assert!(found.contains("encoder.safetensors is not what was written"), "{found}");
    place.calib(&["build-model", "study.toml", "--set", "rollout.steps=60"]).succeeds();
    assert!(std::fs::read(&encoder).expect("an encoder") == good, "it is made again");
    place.calib(&["build-model", "study.toml"]).succeeds();
    let representation = results.join("representation/representation.npy");
    let good = std::fs::read(&representation).expect("ψ");
    let mut damaged = good.clone();
    *damaged.last_mut().expect("bytes") ^= 1;
    std::fs::write(&representation, &damaged).expect("written");
    let found = place.calib(&["build-model", "study.toml"]).fails(2);
    assert!(found.contains("representation.npy is not what was written"), "{found}");
    std::fs::write(&representation, &good).expect("written");
    let (states, psi) = ("model/states.npy", "model/representation.npy");
    let states = map_npy::<f32>(&results.join(states)).expect("states");
    let psi = map_npy::<f32>(&results.join(psi)).expect("ψ");
    assert_eq!((psi.rows(), psi.columns()), (states.rows(), 8));
    let verdict = place.calib(&["evaluate", "study.toml", "--why"]);
    assert!(verdict.stdout().contains("Laplacian kNN"), "{}", verdict.stdout());
    let report = place.read("study-results/report.html");
    assert!(report.contains("Representations") && report.contains("dynamics awareness"));

    // The start states of the deployment go through the encoder.
    let nearest = ["rollout", "study.toml", "--set", "rollout.start=nearest"];
    assert!(place.calib(&nearest).succeeds().contains("start states"));

    // Another representation needs another model. A larger grid keeps the trained representations.
    place.edit_study("[1e-3, 3e-3]", "[1e-3, 3e-3, 1e-2]");
    place
        .calib(&["rollout", "study.toml"])
        .fails_with(2, &["representation.learning_rate = [0.001,0.003], now [0.001,0.003,0.01]"]);
    let before = place.content("study-results/representation/candidates");
    place.calib(&["represent", "study.toml"]).succeeds();
    let after = place.content("study-results/representation/candidates");
    assert_eq!((before.len(), after.len()), (4, 6));
    assert!(before.iter().all(|(path, content)| after[path] == *content));
}

/// Returns the dynamics awareness of a candidate.
fn awareness(candidate: &Value) -> f64 {
    candidate["scores"]["dynamics_awareness"].as_f64().expect("a number")
}

#[test]
fn representations_are_the_same_bytes_for_any_number_of_threads() {
    let place = laplacian();
    for (threads, output) in [("1", "one"), ("3", "three")] {
        for command in ["represent", "build-model", "rollout"] {
            let args = [command, "study.toml", "--output", output, "--threads", threads];
            place.calib(&args).succeeds();
        }
    }
    assert!(place.content("one") == place.content("three"));
}

#[test]
fn what_tells_too_little_apart_or_diverges_is_not_chosen() {
    let place = laplacian();
    place.edit_study("[1e-3, 3e-3]", "[1e5]");
    let args = ["represent", "study.toml"];
    let none = place.calib(&args);
    let message = none.fails(1);
    assert!(none.stdout().contains("diverged"), "{}", none.stdout());
    assert!(message.contains("no representation tells more than 95 %"), "{message}");
    place.calib(&["build-model", "study.toml"]).fails_with(2, &["no representation tells"]);
    place.edit_study("kind = \"laplacian\"", "kind = \"none\"");
    place.calib(&args).fails_with(2, &["there is nothing to train"]);
}

/// Returns a study with a model in the state space, and then sets `[representation]` to `section`.
fn importing(section: &str) -> Place {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.edit_study(
        "[model]",
        &format!("[representation]\nkind = \"import\"\n{section}\n\n[model]"),
    );
    place
}

/// Returns the first four columns of the states, as a simple representation.
fn psi(place: &Place) -> (Vec<f32>, usize) {
    let path = place.path().join("study-results/model/states.npy");
    let states = map_npy::<f32>(&path).expect("states");
    let rows = states.as_slice().chunks_exact(states.columns());
    (rows.flat_map(|row| row[..4].to_vec()).collect(), states.rows())
}

#[test]
fn an_imported_representation_is_searched_in() {
    let place = importing("path = \"psi.npy\"");
    let (psi, rows) = psi(&place);
    write_npy(&place.path().join("psi.npy"), &psi, rows, 4).expect("written");
    place.calib(&["represent", "study.toml"]).succeeds_with(&["chosen"]);
    let built = place.calib(&["build-model", "study.toml", "--verify", "20"]);
    assert!(built.succeeds().contains("wrote"));
    assert!(built.stderr().contains("agree with brute force"));
    let nearest = ["rollout", "study.toml", "--set", "rollout.start=nearest"];
    place.calib(&nearest).fails_with(2, &["imported without an encoder"]);
    place.calib(&["rollout", "study.toml"]).succeeds();

    // The same file with other content is another representation.
    write_npy(&place.path().join("psi.npy"), &vec![0.5_f32; 4 * rows], rows, 4).expect("written");
    let stale = place.calib(&["build-model", "study.toml"]).fails(2);
    assert!(stale.contains("run `calib represent study.toml` again"), "{stale}");
    let constant = place.calib(&["represent", "study.toml"]);
    constant.fails(1);
    assert!(constant.stdout().contains("uniqueness not above 0.95"), "{}", constant.stdout());
}

#[test]
fn what_depends_on_coordinates_waits_until_they_are_known() {
    let place = laplacian();
    let tree = ["build-model", "study.toml", "--index", "kd-tree"];
    let dry = [&tree[..], &["--dry-run"]].concat();
    // The representation has eight dimensions although it is not trained yet, and the states have more.
    place.calib(&dry).succeeds();
    place.calib(&tree).fails_with(2, &["run `calib represent study.toml` first"]);
    place.edit_study("dimension = 8", "dimension = 9");
    for args in [&dry[..], &tree[..]] {
        place.calib(args).fails_with(2, &["at most 8 columns, got 9"]);
    }
    // Either of these may be chosen.
    place.edit_study("dimension = 9", "dimension = [8, 9]");
    place.calib(&dry).succeeds();
    place.calib(&tree).fails_with(2, &["run `calib represent study.toml` first"]);
}

#[test]
fn a_stale_representation_says_nothing_of_the_next_one() {
    let place = importing("path = \"psi.npy\"");
    let (psi, rows) = psi(&place);
    write_npy(&place.path().join("psi.npy"), &psi, rows, 4).expect("written");
    place.calib(&["represent", "study.toml"]).succeeds();
    let before = place.content("study-results");
    place.calib(&built_with("model.components=4")).fails_with(2, &["fewer than the"]);
    assert!(place.content("study-results") == before, "the model is still there");
    // Four coordinates cannot have five components; the next file has eight coordinates.
    let twice: Vec<f32> = psi.chunks_exact(4).flat_map(|row| [row, row].concat()).collect();
    write_npy(&place.path().join("wide.npy"), &twice, rows, 8).expect("written");
    place.edit_study("psi.npy", "wide.npy");
    place
        .calib(&built_with("model.components=5"))
        .fails_with(2, &["run `calib represent study.toml --set 'model.components=5'` again"]);
}

/// Returns the arguments that build the model with a key set.
fn built_with(set: &str) -> [&str; 6] {
    ["build-model", "study.toml", "--set", set, "--index", "scan"]
}

fn refused(place: &Place) -> String {
    place.on_study("represent", &[]).fails(2)
}

#[test]
fn imports_that_do_not_fit_are_refused() {
    let place = importing("path = \"psi.npy\"");
    let (psi, rows) = psi(&place);
    let path = place.path().join("psi.npy");
    assert!(refused(&place).contains("psi.npy"));
    write_npy(&path, &psi[4..], rows - 1, 4).expect("written");
    let short = refused(&place);
    assert!(short.contains(&format!("it has {} rows", rows - 1)), "{short}");
    let mut broken = psi.clone();
    broken[4 * 7 + 2] = f32::NAN;
    write_npy(&path, &broken, rows, 4).expect("written");
    let broken = refused(&place);
    assert!(broken.contains("state 7 is not finite in dimension 2"), "{broken}");
    let mut huge = psi.clone();
    huge[4 * 7 + 2] = 3e38;
    write_npy(&path, &huge, rows, 4).expect("written");
    let huge = refused(&place);
    assert!(huge.contains("ψ of state 7 is 3e38 in dimension 2"), "{huge}");
    assert!(huge.contains("representation.path"), "{huge}");
    write_npy(&path, &psi, rows, 4).expect("written");
    let sidecar = place.path_of("psi.npy.json");
    write_json(&sidecar, &serde_json::json!({ "data": "00".repeat(32) })).expect("written");
    let foreign = refused(&place);
    assert!(foreign.contains("was made for other data"), "{foreign}");
    let manifest = place.read_json("study-results/model/manifest.json");
    write_json(&sidecar, &serde_json::json!({ "data": manifest["data"] })).expect("written");
    place.calib(&["represent", "study.toml"]).succeeds();
    place.edit_study("psi.npy", "psi.txt");
    place.write("psi.txt", "1 2 3");
    assert!(refused(&place).contains("expected a .npy, .safetensors or .parquet file"));
}

#[test]
fn parquet_is_joined_by_time_and_by_row() {
    let place = importing("path = \"psi.parquet\"\ntimestamp = \"at\"");
    let (psi, rows) = psi(&place);
    let table = read_parquet(&place.path().join("study-results/model/rows.parquet"));
    let times = table.expect("rows").column::<Timestamp>("timestamp").expect("times").to_vec();
    // The rows come in another order, with an additional time.
    let order: Vec<usize> = (0..rows).rev().collect();
    let mut at: Vec<Timestamp> = order.iter().map(|&row| times[row]).collect();
    at.push(Timestamp::from_micros(0));
    let path = place.path().join("psi.parquet");
    let mut table = Table::new().with("at", at);
    for number in 0..4 {
        let values = order.iter().map(|&row| psi[4 * row + number]);
        let values: Vec<f32> = values.chain([0.0]).collect();
        table = table.with(format!("psi{number}"), values);
    }
    table.write_parquet(&path).expect("written");
    place.calib(&["represent", "study.toml"]).succeeds();
    let imported = place.path().join("study-results/representation/representation.npy");
    assert_eq!(map_npy::<f32>(&imported).expect("ψ").as_slice(), psi);
    place.edit_study("timestamp = \"at\"", "columns = [\"psi0\", \"psi1\"]");
    let rows = place.calib(&["represent", "study.toml"]).fails(2);
    assert!(rows.contains("join by time with representation.timestamp"), "{rows}");
}
