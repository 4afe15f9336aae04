use calib_stats::{Direction, select};

use super::*;
use crate::ModelPair;

fn model(name: &str, members: &[[f64; 3]], one_step: f64, spearman: f64) -> ModelPair {
    ModelPair {
        model: name.to_owned(),
        selection: select(members, Direction::LowerIsBetter).expect("numbers"),
        spearman: Some(spearman),
        one_step: Some(one_step),
        one_step_relative: None,
        one_step_all: None,
        dtw: None,
    }
}

fn pair(plant: &str, sensor: &str, online: [f64; 3], models: Vec<ModelPair>) -> Pair {
    Pair {
        plant: plant.to_owned(),
        sensor: sensor.to_owned(),
        online: online.to_vec(),
        default: Some(2),
        log_replay: Some(0),
        models,
    }
}

/// Two plants; in each pair model "a" chooses value 1 and "b" value 2.
fn pairs() -> Vec<Pair> {
    let models = |a: f64, b: f64| {
        vec![model("a", &[[0.3, 0.1, 0.2]], a, 1.0), model("b", &[[0.3, 0.2, 0.1]], b, 0.5)]
    };
    vec![
        pair("north", "p", [0.25, 0.125, 0.375], models(1.0, 2.0)), // regrets 1, 0, 2
        pair("north", "q", [0.5, 0.625, 0.75], models(1.0, 2.0)),   // 0, 0.25, 0.5
        pair("south", "p", [0.75, 0.5, 0.25], models(1.0, 2.0)),    // 2, 1, 0
    ]
}

fn judged(pairs: Vec<Pair>) -> Validity {
    let options = Options { resamples: 400, ..Options::default() };
    judge(["x", "y", "z"].map(str::to_owned).to_vec(), pairs, &options).expect("valid")
}

fn summary<'a>(validity: &'a Validity, name: &str) -> &'a MethodSummary {
    validity.methods.iter().find(|of| of.method.name() == name).expect("it is there")
}

fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12, "{a} instead of {b}");
}

#[test]
fn regrets_of_all_methods_by_hand() {
    let validity = judged(pairs());
    assert_eq!((validity.pairs, validity.plants.len(), validity.models.len()), (3, 2, 2));
    // Mean regrets of x, y, z are 1, 5/12 and 5/6.
    assert_eq!(validity.best_default, 1);
    near(summary(&validity, "model:a").mean, 1.25 / 3.0);
    near(summary(&validity, "model:a").median, 0.25);
    near(summary(&validity, "model:a").good, 1.0 / 3.0);
    near(summary(&validity, "model:a").typical, (1.25_f64 * 2.0).cbrt() - 1.0);
    near(summary(&validity, "model:b").mean, 2.5 / 3.0);
    near(summary(&validity, "best_default").mean, 1.25 / 3.0);
    near(summary(&validity, "log_replay").mean, 1.0);
    near(summary(&validity, "default").mean, 2.5 / 3.0);
    near(summary(&validity, "random").mean, (1.0 + 0.25 + 1.0) / 3.0);
    // For the north the south says z (2 and 0.5); for the south the north says y (mean 1/8): regret 1.
    near(summary(&validity, "best_default_of_other_plants").mean, 3.5 / 3.0);
    // One-step errors prefer a everywhere; there are no warping distances.
    near(summary(&validity, "most_accurate_model").mean, 1.25 / 3.0);
    assert!(validity.methods.iter().all(|of| of.method != Method::LeastWarped));
}

#[test]
fn two_by_two() {
    let validity = judged(pairs());
    let of = |method: &str, against: &str| {
        let found = validity
            .comparisons
            .iter()
            .find(|of| of.method.name() == method && of.against.name() == against);
        found.expect("it is there").clone()
    };
    let random = of("model:a", "random"); // 0, 0.25, 1 against 1, 0.25, 1
    assert_eq!((random.wins, random.ties, random.losses), (1, 2, 0));
    near(random.difference.expect("finite"), -1.0 / 3.0);
    let replay = of("model:b", "log_replay"); // 2, 0.5, 0 against 1, 0, 2
    assert_eq!((replay.wins, replay.ties, replay.losses), (1, 0, 2));
    near(replay.error_ratio.expect("finite"), (1.5_f64 * 1.5 / 3.0).cbrt());
    // Bootstrapping two plants gives (north, north), (south, south) or both.
    let interval = replay.interval.expect("two plants");
    near(interval.low, -2.0);
    near(interval.high, 0.75);
}

#[test]
fn the_more_accurate_model_chooses_better_or_not() {
    let validity = judged(pairs());
    let of = |predictor, outcome| {
        let mut all = validity.accuracy.iter();
        all.find(|of| of.predictor == predictor && of.outcome == outcome).expect("there").clone()
    };
    // a is more accurate in all three pairs and has the smaller regret in two of them.
    let regret = of(crate::Predictor::OneStep, crate::Outcome::Regret);
    assert_eq!((regret.pairs, regret.models), (3, 6));
    near(regret.correlation.expect("defined"), 1.0 / 3.0);
    let ranking = of(crate::Predictor::OneStep, crate::Outcome::Disagreement);
    near(ranking.correlation.expect("defined"), 1.0);
    assert_eq!(of(crate::Predictor::Dtw, crate::Outcome::Regret).correlation, None);
}

#[test]
fn rules_are_compared_with_the_papers() {
    let mut all = pairs();
    for pair in &mut all {
        // Worst ranks 3, 2, 3: value 1; mean ranks 5/3, 2, 7/3: value 0.
        pair.models =
            vec![model("a", &[[0.1, 0.2, 0.3], [0.1, 0.2, 0.3], [0.3, 0.2, 0.1]], 1.0, 0.0)];
    }
    let validity = judged(all);
    let rule = |name: &str| {
        let found = validity.rules.iter().find(|of| of.method.name() == name);
        found.expect("it is there").mean
    };
    near(rule("model:a:worst_rank"), 1.25 / 3.0);
    near(rule("model:a:mean_rank"), 1.0);
    let comparison = &validity.rule_comparisons[0];
    assert_eq!((comparison.wins, comparison.ties, comparison.losses), (1, 0, 2));
    near(comparison.difference.expect("finite"), 1.75 / 3.0);
}

#[test]
fn diverged_values_lose_but_do_not_blur_the_rest() {
    let mut all = pairs();
    all[0].online[2] = f64::INFINITY;
    let validity = judged(all);
    let b = summary(&validity, "model:b");
    assert_eq!((b.diverged, b.mean, b.interval), (1, f64::INFINITY, None));
    let against = validity
        .comparisons
        .iter()
        .find(|of| of.method.name() == "model:b" && of.against == Method::LogReplay);
    let against = against.expect("it is there");
    assert_eq!((against.wins, against.losses, against.finite), (1, 2, 2));
}

#[test]
fn what_cannot_be_judged_is_left_out_or_refused() {
    let mut all = pairs();
    all[1].online = vec![f64::INFINITY; 3];
    assert_eq!(judged(all.clone()).left_out, ["q of north"]);
    all[0].online.pop();
    let options = Options::default();
    let values = || vec!["x".to_owned(), "y".to_owned(), "z".to_owned()];
    assert!(judge(values(), all, &options).unwrap_err().to_string().contains("p of north"));
    assert_eq!(judge(values(), Vec::new(), &options), Err(ValidityError::NoPairs));
}

#[test]
fn the_same_seed_gives_the_same_intervals() {
    assert_eq!(judged(pairs()), judged(pairs()));
}
