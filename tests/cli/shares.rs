//! Work that several processes divide: the bytes equal those of one process.

use crate::{
    control,
    harness::{Content, Place},
    represent::LAPLACIAN,
};

#[test]
fn a_grid_of_representations_in_shares_is_that_of_one_process() {
    let alone = with_three_representations();
    let shared = with_three_representations();
    alone.calib(&["represent", "study.toml"]).succeeds();
    // Shares run in any order, and one runs twice. One of them has nothing left to do.
    assert!(
        shared
            .on_study("represent", &["--share", "1/2"])
            .succeeds()
            .contains("share 1/2: 1 representation trained, of 3")
    );
    shared.calib(&["build-model", "study.toml"]).fails_with(2, &["represent"]);
    shared.on_study("represent", &["--share", "0/2"]).succeeds();
    shared.on_study("represent", &["--share", "1/2"]).succeeds();
    shared.calib(&["represent", "study.toml"]).succeeds_with(&["wrote"]);
    let folder = "study-results/representation";
    assert!(alone.content(folder) == shared.content(folder));
    for (wrong, said) in [("2/2", "there is no share 2 of 2"), ("one", "such as 0/8 or auto/8")] {
        shared.on_study("represent", &["--share", wrong]).fails_with(2, &[said]);
    }
    let forced = shared.calib(&["represent", "study.toml", "--share", "0/2", "--force"]).fails(2);
    assert!(forced.contains("--force makes everything again"), "{forced}");
}

/// Returns a study with a grid of three representations.
fn with_three_representations() -> Place {
    let place = Place::with_study();
    place.edit_study("[model]", LAPLACIAN);
    place.edit_study("[1e-3, 3e-3]", "[1e-3, 2e-3, 3e-3]");
    place
}

#[test]
fn agents_that_shares_pre_train_are_those_of_one_process() {
    let alone = with_three_agents();
    let shared = with_three_agents();
    alone.calib(&["pretrain", "study.toml"]).succeeds();
    assert!(
        shared
            .on_study("pretrain", &["--share", "0/2"])
            .succeeds()
            .contains("share 0/2: 2 agents pre-trained, of 3")
    );
    // The results of a share count, whichever process continues.
    let again = shared.on_study("pretrain", &["--share", "0/2"]);
    assert!(again.stderr().contains("1 of 3 agents left"), "{}", again.stderr());
    shared.on_study("pretrain", &["--share", "1/2"]).succeeds();
    let put_together = shared.calib(&["pretrain", "study.toml"]);
    assert!(put_together.stderr().contains("0 of 3 agents left"), "{}", put_together.stderr());
    assert!(put_together.succeeds().contains("wrote"));
    let folder = "study-results/pretrain";
    assert!(alone.content(folder) == shared.content(folder));
    assert!(shared.calib(&["pretrain", "study.toml"]).succeeds().contains("up to date"));
}

/// Returns a study of three sensors with pre-trained agents.
fn with_three_agents() -> Place {
    let place = Place::with_study();
    place.edit_study(
        "[sweep]",
        "[pretrain]\nepochs = 6\nlearning_rate = 1e-3\nfraction = 0.4\n\n[sweep]",
    );
    place.edit_study("[\"PIT300\", \"TIT101\"]", "[\"PIT300\", \"TUIT101\", \"TIT101\"]");
    place
}

/// Returns the runs that the shares of [`control::place`]'s study have kept: name → content.
fn kept_runs(place: &Place) -> Content {
    let mut content = place.content(UNITS);
    content.retain(|path, _| path.to_string_lossy().starts_with("run-"));
    content
}

const UNITS: &str = "pole/study-results/control-units";

#[test]
fn agents_that_act_in_shares_are_judged_as_those_of_one_process() {
    let study = "pole/study.toml";
    let folder = "pole/study-results/control";
    let alone = control::place();
    alone.calib(&["control", study]).ends(&[1]);
    // Two settings in three members of three kinds: 18 runs.
    for count in [1, 3, 20] {
        let shared = control::place();
        let mut processes = Vec::new();
        for number in (0..count).rev() {
            let part = format!("{number}/{count}");
            processes.push(shared.command(&["control", study, "--share", &part]).spawn());
        }
        for process in processes {
            assert!(process.expect("calib runs").wait().expect("a status").success());
        }
        assert_eq!(kept_runs(&shared).len(), 18);
        let status = shared.calib(&["status", study]).succeeds();
        let next = format!("all runs are made; next: `calib control {study}`");
        assert!(status.contains(&next) && status.contains("by 18 of 18 runs"), "{status}");
        shared.calib(&["control", study]).ends(&[1]);
        assert!(alone.content(folder) == shared.content(folder), "{count} shares");
        let last = shared.calib(&["control", study, "--share", "0/2"]).succeeds();
        assert!(!last.contains("share 0/2"), "nothing is left to make: {last}");
    }
    let started = control::place();
    let share = started.calib(&["control", study, "--share", "1/20"]).succeeds();
    assert!(share.contains("share 1/20: 1 run made, 0 there before, of 18 in all"), "{share}");
    // This share has the last run of networks. Asked again, it has nothing left to train.
    let needed = "this share has runs in the network of ensemble member 2";
    for (counts, is_made) in
        [("1 run made, 0 there before", true), ("0 runs made, 1 there before", false)]
    {
        let ran = started.calib(&["control", study, "--share", "17/18"]);
        let share = ran.succeeds();
        assert!(share.contains(&format!("share 17/18: {counts}, of 18 in all")), "{share}");
        assert_eq!(ran.stderr().contains(needed), is_made, "{}", ran.stderr());
    }
    // Networks have the numbers 12 to 17. The share has runs 12 and 16, in members 0 and 2.
    let ran = started.calib(&["control", study, "--share", "0/4"]);
    ran.succeeds();
    let needed = "this share has runs in the networks of ensemble members 0 and 2";
    assert!(ran.stderr().contains(needed), "{}", ran.stderr());
    // A network that was trained without the others has the same bytes as one trained with them.
    started.calib(&["control", study]).ends(&[1]);
    assert!(alone.content(folder) == started.content(folder));
    let json = ["control", study, "--share", "1/20", "--json"];
    started.calib(&json).fails_with(2, &["a share has no verdict to print", "add --dry-run"]);
}

/// Both have a run with the same numbers.
#[test]
fn shares_of_two_studies_in_one_folder_keep_their_runs() {
    let place = control::place();
    let share = ["control", "pole/study.toml", "--share", "0/20"];
    for steps in ["--set=control.steps=1500", "--set=control.steps=1400"] {
        let told = place.calib(&[&share[..], &[steps]].concat()).succeeds();
        assert!(told.contains("share 0/20: 1 run made, 0 there before, of 18 in all"), "{told}");
    }
    for (set, own, others) in [("1500", 1, 1), ("1400", 1, 1), ("1300", 0, 2)] {
        let set = format!("--set=control.steps={set}");
        let status = place.calib(&["status", "pole/study.toml", &set, "--json"]).json(&[0]);
        assert_eq!(status["control"]["runs"], serde_json::json!([own, 18]), "{status}");
        assert_eq!(status["control"]["other_runs"], others, "{status}");
    }
    let status = place.calib(&["status", "pole/study.toml", "--set=control.steps=1300"]).succeeds();
    assert!(status.contains("not counted: 2 runs of another study"), "{status}");
    let told = place.calib(&[&share[..], &["--set=control.steps=1500"]].concat()).succeeds();
    assert!(told.contains("share 0/20: 0 runs made, 1 there before, of 18 in all"), "{told}");
    place.calib(&["control", "pole/study.toml"]).ends(&[1]);
    assert!(kept_runs(&place).is_empty(), "the command without a share removes all of them");
}

#[test]
fn a_share_that_ends_after_the_verdict_does_not_hide_it() {
    let place = control::place();
    let study = "pole/study.toml";
    place.calib(&["control", study, "--share", "0/20"]).succeeds();
    let late = kept_runs(&place);
    assert_eq!(late.len(), 1);
    place.calib(&["control", study]).ends(&[1]);
    for (name, content) in late {
        std::fs::write(place.path().join(UNITS).join(name), content).expect("writable");
    }
    let status = place.calib(&["status", study, "--json"]).json(&[0]);
    assert_eq!(status["control"]["runs"], serde_json::json!([18, 18]), "{status}");
    let again = place.calib(&["control", study]);
    again.ends(&[1]);
    assert!(again.stderr().contains("control is up to date"), "{}", again.stderr());
    assert!(kept_runs(&place).is_empty(), "its runs are in the verdict");
}

/// Every share that starts before the representation is written trains it.
#[test]
fn shares_whose_neighbours_are_near_in_a_representation_run_side_by_side() {
    let args = [
        "control",
        "pole/study.toml",
        "--set=control.model.distance='laplacian'",
        "--set=representation={ dimension = 4, hidden_units = 16, batch_size = 32, learning_rate = 3e-3, steps = 300 }",
    ];
    let alone = control::place();
    alone.calib(&args).ends(&[0, 1]);
    let shared = control::place();
    let shares = ["0/2", "1/2"].map(|part| {
        let share = [&args[..], &["--share", part]].concat();
        shared.command(&share).spawn().expect("calib runs")
    });
    for mut share in shares {
        assert!(share.wait().expect("a status").success());
    }
    shared.calib(&args).ends(&[0, 1]);
    for folder in ["control", "control-representation"] {
        let folder = format!("pole/study-results/{folder}");
        assert!(alone.content(&folder) == shared.content(&folder), "{folder}");
    }
}

#[test]
fn what_a_share_has_made_is_not_believed_when_it_is_damaged() {
    let place = Place::with_study();
    place.edit_study("[sweep]", "[pretrain]\nepochs = 2\nfraction = 0.4\n\n[sweep]");
    place.calib(&["pretrain", "study.toml", "--share", "0/1"]).succeeds();
    let weights = place.path().join("study-results/pretrain/shares/PIT300.safetensors");
    let mut bytes = std::fs::read(&weights).expect("written");
    *bytes.last_mut().expect("not empty") ^= 1;
    std::fs::write(&weights, bytes).expect("written");
    let again = place.calib(&["pretrain", "study.toml", "--dry-run"]);
    assert!(again.stderr().contains("1 of 2 agents left"), "{}", again.stderr());
}
