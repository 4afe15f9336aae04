use super::*;
use crate::{Job, Request};

fn study(text: &str) -> Study {
    let job = Job::of_text(Request::new("s.toml"), text.to_owned()).expect("valid");
    job.study().clone()
}

/// Returns the keys whose difference between the studies `made` and `now` affects the result.
fn changed(result: StepKind, made: &str, now: &str) -> String {
    let all = study(now).differences(result, &study(made));
    all.into_iter().map(|difference| difference.key).collect::<Vec<_>>().join(" ")
}

/// Returns the same keys with both values.
fn told(result: StepKind, made: &str, now: &str) -> String {
    let all = study(now).differences(result, &study(made));
    all.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

#[test]
fn what_changes_no_byte_is_no_input() {
    let all = [
        StepKind::Represent,
        StepKind::BuildModel,
        StepKind::Pretrain,
        StepKind::Rollout,
        StepKind::Sweep,
    ];
    for text in [
        "[model]\nindex = \"scan\"\n",
        "[data]\npath = \"elsewhere\"\n",
        "[evaluate]\ntop_k = 1\n",
        "output = \"there\"\n",
        "[dynamics]\nhidden_units = 7\n",
        "[model]\ntemperature = 0.5\n",
        "[representation]\nbeta = 2\n",
    ] {
        for result in all {
            let own = changed(result, "", text);
            // The section is the input of a representation, whatever its kind.
            let of_itself = result == StepKind::Represent && text.starts_with("[representation]");
            assert!(own.is_empty() || of_itself, "{result:?}: {own:?}");
        }
    }
}

/// Returns the keys of a study by which the result differs from that of an empty one.
fn keys(result: StepKind, text: &str) -> String {
    changed(result, "", text)
}

#[test]
fn a_result_follows_from_its_own_keys_alone() {
    let gamma = "[agent]\ngamma = 0.5\n";
    assert_eq!(keys(StepKind::BuildModel, gamma), "");
    assert_eq!(keys(StepKind::Rollout, gamma), "");
    assert_eq!(keys(StepKind::Sweep, gamma), "agent.gamma");
    assert_eq!(keys(StepKind::Pretrain, gamma), "agent.gamma");
    let seed = "seed = 7\n";
    assert_eq!(keys(StepKind::BuildModel, seed), "");
    assert_eq!(keys(StepKind::Sweep, seed), "seed");
    let rollouts = "[rollout]\nsteps = 7\nstart = \"recent\"\n";
    assert_eq!(keys(StepKind::Rollout, rollouts), "rollout.start rollout.steps");
    assert_eq!(keys(StepKind::Sweep, rollouts), "rollout.start");
    assert_eq!(keys(StepKind::Sweep, "[sweep]\nstart = \"recent\"\n"), "rollout.start");
    let held_out = "[data]\ntrain = { end = 2022-01-01 }\nheld_out = { start = 2022-01-01 }\n";
    let train = "data.train.end data.train_fraction";
    assert_eq!(keys(StepKind::BuildModel, held_out), train);
    assert_eq!(keys(StepKind::Rollout, held_out), train);
    assert_eq!(keys(StepKind::Sweep, held_out), format!("data.held_out.start {train}"));
    assert_eq!(
        keys(StepKind::Sweep, "[sweep.grid]\ngamma = [0.5, 0.6]\n"),
        "sweep.grid.gamma sweep.grid.learning_rate"
    );
}

/// Returns the differences of a verdict on agents that act, after `added` was added to a study.
fn told_of_acting(study: &str, added: &str) -> String {
    told(StepKind::Control, study, &format!("{study}{added}"))
}

#[test]
fn a_verdict_about_agents_that_act_follows_from_what_they_learn_in() {
    let acting = "[control]\nactions = [\"valve\"]\n";
    assert_eq!(told_of_acting(acting, "steps = 100\n"), "control.steps = 15000, now 100");
    let resamples = told_of_acting(acting, "[evaluate]\nresamples = 7\n");
    assert_eq!(resamples, "evaluate.resamples = 2000, now 7");
    let unused = "[representation]\ndimension = 3\n[agent]\ngamma = 0.5\n";
    assert_eq!(told_of_acting(acting, unused), "");
    let train = "[data]\ntrain = { end = 2022-01-01 }\n";
    let trained = format!("{train}{acting}");
    let held_out = format!("{train}held_out = {{ start = 2022-01-01 }}\n{acting}");
    let of_period = told(StepKind::Control, &trained, &held_out);
    assert_eq!(of_period, "data.held_out.start = nothing, now \"2022-01-01\"");
    let deployed = format!("{train}{acting}[deployments.may]\nstart = 2022-05-01\n");
    let of_deployment = told(StepKind::Control, &trained, &deployed);
    assert_eq!(of_deployment, "deployments.may.start = nothing, now \"2022-05-01\"");
    let near = format!("{acting}[control.model]\ndistance = \"laplacian\"\n");
    let dimension = told_of_acting(&near, "[representation]\ndimension = 3\n");
    assert!(dimension.starts_with("representation.dimension = "), "{dimension}");
    let program = format!("{acting}[agent]\nkind = \"external\"\ncommand = [\"act\"]\n");
    let gamma = told_of_acting(&program, "gamma = 0.5\n");
    assert_eq!(gamma, "agent.gamma = 0.99, now 0.5");
}

#[test]
fn a_network_follows_from_what_its_kind_uses() {
    let nn = "[model]\nkind = \"nn\"\n";
    assert_eq!(
        changed(
            StepKind::BuildModel,
            nn,
            &format!("{nn}neighbors = 9\n[dynamics]\nsequence_length = 9\n")
        ),
        ""
    );
    assert_eq!(
        changed(StepKind::BuildModel, nn, &format!("seed = 3\n{nn}[dynamics]\nepochs = 9\n")),
        "dynamics.epochs seed"
    );
    let gru = "[model]\nkind = \"gru\"\n";
    let sequences = format!("{gru}[dynamics]\nsequence_length = 9\n");
    assert_eq!(changed(StepKind::BuildModel, gru, &sequences), "dynamics.sequence_length");
}

/// Returns the inputs of the sweep of a study.
fn swept(text: &str, set: &[&str]) -> Inputs {
    let set = set.iter().map(|&text| text.to_owned()).collect();
    let request = Request { set, ..Request::new("s.toml") };
    let job = Job::of_text(request, text.to_owned()).expect("valid");
    job.study().inputs(StepKind::Sweep)
}

#[test]
fn without_a_model_nothing_follows_from_the_keys_of_one() {
    let of_a_model = "[model]\nmembers = 3\n[rollout]\nstart = \"recent\"\n\
        [sweep]\nmember_runs = 4\n[representation]\nkind = \"laplacian\"\n";
    assert_eq!(swept(of_a_model, &["model.kind=none"]), swept("[model]\nkind = \"none\"\n", &[]));
    assert_ne!(swept(of_a_model, &[]), swept("", &[]));
}

#[test]
fn a_difference_says_both_values() {
    let gamma = told(StepKind::Sweep, "", "[agent]\ngamma = 0.5\n");
    assert_eq!(gamma, "agent.gamma = 0.99, now 0.5");
    let period = told(StepKind::Sweep, "", "[model]\nperiod = { end = 2022-01-01 }\n");
    assert_eq!(period, "model.period.end = nothing, now \"2022-01-01\"");
}
