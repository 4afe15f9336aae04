use super::*;
use crate::{
    Badness, CAP, Claim, Finding, ModelPair, Outcome, Predictor, RuleChoice, TaskValue, Test,
};

pub(crate) fn pair(plant: &str, sensor: &str, regrets: [f64; 3]) -> Pair {
    Pair {
        plant: plant.to_owned(),
        sensor: sensor.to_owned(),
        optimiser: "adam".to_owned(),
        online: vec![0.5; 3],
        skill: Some(0.5),
        regrets: Some(regrets.to_vec()),
        default: Some(2),
        log_replay: Some(0),
        another_window: Some(0.5),
        ..Pair::default()
    }
}

fn rule(rule: &str, chosen: usize) -> RuleChoice {
    RuleChoice { rule: rule.to_owned(), chosen }
}

fn model(name: &str, chosen: usize, one_step: f64, spearman: f64) -> ModelPair {
    ModelPair {
        model: name.to_owned(),
        chosen,
        stability: Some(0.75),
        saved_by_halving: Some(if name == "a" { 0.5 } else { 0.25 }),
        rules: vec![rule("worst_rank", chosen), rule("pooled", 0)],
        spearman: Some(spearman),
        one_step: Some(one_step),
        ..ModelPair::default()
    }
}

fn with_models(pair: Pair) -> Pair {
    Pair { models: vec![model("a", 1, 1.0, 1.0), model("b", 2, 2.0, 0.5)], ..pair }
}

/// Returns pairs of two plants. In each pair model "a" chooses value 1 and "b" value 2.
fn pairs() -> Vec<Pair> {
    vec![
        with_models(pair("north", "p", [1.0, 0.0, 2.0])),
        with_models(pair("north", "q", [0.0, 0.25, 0.5])),
        with_models(pair("south", "p", [2.0, 1.0, 0.0])),
    ]
}

fn judged(pairs: Vec<Pair>) -> Validity {
    judge(["x", "y", "z"].map(str::to_owned).to_vec(), pairs, &[]).expect("valid")
}

fn summary<'a>(validity: &'a Validity, name: &str) -> &'a MethodSummary {
    validity.methods.iter().find(|method| method.method.name() == name).expect("it is there")
}

fn comparison<'a>(all: &'a [Comparison], method: &str, against: &str) -> &'a Comparison {
    let found = all.iter().find(|comparison| {
        comparison.method.name() == method && comparison.against.name() == against
    });
    found.expect("it is there")
}

fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12, "{a} instead of {b}");
}

fn mean_regret(validity: &Validity, name: &str) -> f64 {
    summary(validity, name).mean
}

#[test]
fn regrets_of_all_methods_by_hand() {
    let validity = judged(pairs());
    assert_eq!((validity.pairs, validity.plants.len(), validity.models.len()), (3, 2, 2));
    // Products of 1 + regret of x, y, z are 6, 2.5 and 4.5.
    assert_eq!(validity.best_default, 1);
    near(mean_regret(&validity, "model:a"), 1.25 / 3.0);
    near(summary(&validity, "model:a").median, 0.25);
    near(summary(&validity, "model:a").good, 1.0 / 3.0);
    near(summary(&validity, "model:a").typical, 2.5_f64.cbrt() - 1.0);
    near(summary(&validity, "model:a").worst_tenth, 1.0);
    near(mean_regret(&validity, "model:b"), 2.5 / 3.0);
    near(mean_regret(&validity, "best_default"), 1.25 / 3.0);
    near(mean_regret(&validity, "log_replay"), 1.0);
    near(mean_regret(&validity, "default"), 2.5 / 3.0);
    near(mean_regret(&validity, "random"), (1.0 + 0.25 + 1.0) / 3.0);
    // For the north, the south has z as its best value (2 and 0.5). For the south, the north has y (products 2, 1.25,
    // 4.5): regret 1.
    near(mean_regret(&validity, "best_default_of_other_plants"), 3.5 / 3.0);
    near(mean_regret(&validity, "hindsight"), 0.0);
    near(mean_regret(&validity, "another_window"), 0.5);
    // One-step errors prefer a everywhere. There are no warping distances, and no latest windows.
    near(mean_regret(&validity, "most_accurate_model"), 1.25 / 3.0);
    let absent = [Method::LeastWarped, Method::LatestWindow, Method::BestDefaultOfOptimiser];
    assert!(validity.methods.iter().all(|method| !absent.contains(&method.method)));
    assert_eq!(validity.agreement[0].stability, Some(0.75));
    let saved: Vec<_> =
        validity.agreement.iter().map(|agreement| agreement.saved_by_halving).collect();
    assert_eq!(saved, [Some(0.5), Some(0.25)]);
}

#[test]
fn a_default_may_depend_on_the_optimiser() {
    let mut all = pairs();
    all.push(pair("west", "p", [0.0, 0.5, 1.0]));
    for pair in &mut all[2..] {
        pair.optimiser = "sgd".to_owned();
    }
    let validity = judged(all);
    // All: products 6, 3.75, 9. Adam's: 2, 1.25, 4.5. SGD's: 3, 3, 2.
    assert_eq!(validity.best_default, 1);
    let own = validity.best_defaults_of_optimisers.iter();
    let own: Vec<(&str, usize)> =
        own.map(|default| (default.optimiser.as_str(), default.value)).collect();
    assert_eq!(own, [("adam", 1), ("sgd", 2)]);
    near(summary(&validity, "best_default_of_optimiser").mean, (0.0 + 0.25 + 0.0 + 1.0) / 4.0);
    // The north has no other plant with Adam. The west's best value is x (regret 2 in the south), the south's is z
    // (regret 1 in the west).
    let others = summary(&validity, "best_default_of_other_plants_with_optimiser");
    assert_eq!(others.pairs, 2);
    near(others.mean, 1.5);
}

#[test]
fn two_by_two() {
    let validity = judged(pairs());
    let random = comparison(&validity.comparisons, "model:a", "random"); // 0, 0.25, 1 against 1, 0.25, 1
    assert_eq!((random.wins, random.ties, random.losses), (1, 2, 0));
    near(random.difference, -1.0 / 3.0);
    near(random.error_ratio, 0.5_f64.cbrt());
    let replay = comparison(&validity.comparisons, "model:b", "log_replay"); // 2, 0.5, 0 against 1, 0, 2
    assert_eq!((replay.wins, replay.ties, replay.losses), (1, 0, 2));
    near(replay.error_ratio, (1.5_f64 * 1.5 / 3.0).cbrt());
    assert_eq!(
        (replay.error_ratio_interval, replay.finding),
        (None, Finding::Untold),
        "two plants"
    );
    // Two models are compared only once.
    assert_eq!(comparison(&validity.comparisons, "model:a", "model:b").wins, 2);
    assert!(
        validity
            .comparisons
            .iter()
            .all(|comparison| comparison.method.name() != "model:b"
                || !comparison.against.is_model())
    );
}

/// Judges `count` plants with one sensor each, in which the model chooses value 1.
fn plants(count: usize, regrets: impl Fn(usize) -> [f64; 3]) -> Validity {
    judged(
        (0..count)
            .map(|plant: usize| Pair {
                models: vec![model("a", 1, 1.0, 1.0)],
                ..pair(&format!("plant {plant}"), "p", regrets(plant))
            })
            .collect(),
    )
}

/// Returns regrets for error ratios e and 1 in turn, against log replay, whose regret is 0 everywhere.
fn regrets_in_turn(plant: usize) -> [f64; 3] {
    [0.0, if plant.is_multiple_of(2) { 1_f64.exp_m1() } else { 0.0 }, 1.0]
}

#[test]
fn eight_plants_have_the_interval_of_students_t_on_logarithms() {
    let validity = plants(8, regrets_in_turn);
    let compared = comparison(&validity.comparisons, "model:a", "log_replay");
    // Mean ½, s = √(2/7), t(7) = 2.364624252.
    let half = 2.364_624_252 * (2.0_f64 / 7.0 / 8.0).sqrt();
    let interval = compared.error_ratio_interval.expect("eight plants");
    assert!((interval.low - (0.5 - half).exp()).abs() < 1e-8, "{interval:?}");
    assert!((interval.high - (0.5 + half).exp()).abs() < 1e-8, "{interval:?}");
    let own = summary(&validity, "model:a");
    let typical = own.typical_interval.expect("eight plants");
    let bound = 0.5 + (19.0 * 2.0_f64 / 7.0 / 8.0).sqrt();
    assert!((typical.low - (0.5 - half).exp_m1()).abs() < 1e-8, "{typical:?}");
    near(typical.high, bound.exp_m1());
    // Mean (e − 1)/2, s = (e − 1) √(2/7).
    near(own.upper.expect("eight plants"), bound * 1_f64.exp_m1());
    let replay = summary(&validity, "log_replay");
    assert_eq!((replay.upper, replay.typical_interval), (None, None), "nothing differs");
    let few = plants(7, regrets_in_turn);
    assert_eq!(summary(&few, "model:a").upper, None);
    assert_eq!(comparison(&few.comparisons, "model:a", "log_replay").error_ratio_interval, None);
}

/// Returns the mean of the worst tenth of so many plants.
fn worst(count: usize) -> f64 {
    let validity = plants(count, |plant: usize| {
        let regret = match plant {
            1 => 3.0,
            2 => 8.0,
            _ => 0.1,
        };
        [0.0, regret, 1.0]
    });
    summary(&validity, "model:a").worst_tenth
}

#[test]
fn the_worst_tenth_is_of_pairs_and_never_empty() {
    // The largest regrets of the model are 8 and 3: quotients of errors of 9 and 4, whose geometric mean is 6.
    near(worst(20), 5.0);
    near(worst(15), 5.0);
    for count in [4, 10, 14] {
        near(worst(count), 8.0);
    }
    near(worst(25), (36.0_f64 * 1.1).cbrt() - 1.0);
}

#[test]
fn what_plants_can_tell_follows_from_their_means() {
    let validity = judged(pairs());
    let power = validity.power.iter();
    let power = power
        .clone()
        .find(|power| power.method.name() == "model:a" && power.against == Method::Random);
    let power = power.expect("it is there");
    // The north's mean logarithm is −ln 2 / 2, the south's 0: a deviation of ln 2 / 2 / √2.
    let std = 2.0_f64.ln() / 8.0_f64.sqrt();
    assert_eq!(power.plants, 2);
    near(power.std.expect("two plants"), std);
    let visible = calib_stats::smallest_difference(std, 2).expect("two").exp_m1();
    near(power.visible.expect("two plants"), visible);
    assert_eq!(power.needed[2], calib_stats::observations_needed(std, 1.05_f64.ln()));
}

fn test_of<'a>(
    tests: &'a [Test],
    claim: Claim,
    method: &str,
    against: Option<&str>,
) -> Option<&'a Test> {
    tests.iter().find(|test| {
        let other = test.against.as_ref().map(Method::name);
        test.claim == claim && test.method.name() == method && other.as_deref() == against
    })
}

#[test]
fn claims_are_of_models_against_what_one_would_do_without() {
    let values = ["x", "y", "z"].map(str::to_owned).to_vec();
    let validity = judge(values, pairs(), &["b".to_owned()]).expect("valid");
    let tests = &validity.tests;
    let regret = test_of(tests, Claim::SmallRegret, "model:a", None).expect("claimed");
    assert_eq!(regret.outcome, Outcome::Open, "two plants");
    near(regret.value, 1.25 / 3.0);
    assert!(test_of(tests, Claim::NoWorse, "model:a", Some("log_replay")).is_some());
    assert!(test_of(tests, Claim::Better, "model:a", Some("model:b")).is_some(), "b is a network");
    assert!(test_of(tests, Claim::Better, "model:b", Some("default")).is_some());
    assert!(validity.tests.iter().all(|test| !test.against.as_ref().is_some_and(Method::is_floor)));
}

fn accuracy_of(validity: &Validity, predictor: Predictor, outcome: Badness) -> &Accuracy {
    let mut all = validity.accuracy.iter();
    all.find(|accuracy| accuracy.predictor == predictor && accuracy.outcome == outcome)
        .expect("there")
}

#[test]
fn the_more_accurate_model_chooses_better_or_not() {
    let validity = judged(pairs());
    // a is more accurate in all three pairs and has the smaller regret in two of them.
    let regret = accuracy_of(&validity, Predictor::OneStep, Badness::Regret);
    assert_eq!((regret.pairs, regret.models), (3, 6));
    near(regret.correlation.expect("defined"), 1.0 / 3.0);
    let ranking = accuracy_of(&validity, Predictor::OneStep, Badness::Disagreement);
    near(ranking.correlation.expect("defined"), 1.0);
    assert_eq!(accuracy_of(&validity, Predictor::Dtw, Badness::Regret).correlation, None);
}

#[test]
fn rules_are_compared_over_the_pairs_of_all_models() {
    let validity = judged(pairs());
    for (name, mean) in [("model:a:worst_rank", 1.25 / 3.0), ("model:b:pooled", 1.0)] {
        let found = validity.rules.iter().find(|rule| rule.method.name() == name);
        let found = found.expect("it is there").mean;
        assert!((found - mean).abs() < 1e-12, "{name}: {found} instead of {mean}");
    }
    assert_eq!(validity.rule_comparisons.len(), 1, "two rules are compared once");
    // 0, 0.25, 1 of a and 2, 0.5, 0 of b against 1, 0, 2 in both.
    let compared = comparison(&validity.rule_comparisons, "rule:worst_rank", "rule:pooled");
    assert_eq!((compared.pairs, compared.wins, compared.ties, compared.losses), (6, 3, 0, 3));
    near(compared.error_ratio, (2.5_f64 * 4.5 / 36.0).powf(1.0 / 6.0));
    assert_eq!(compared.of_plants.len(), 2, "the plant stays the unit");
}

#[test]
fn tasks_that_are_alike_are_summarised() {
    let mut all = pairs();
    for (pair, gamma) in all.iter_mut().zip([0.8, 0.8, 0.9]) {
        pair.task = vec![("gamma".to_owned(), TaskValue::Number(gamma))];
    }
    let validity = judged(all);
    let mut groups = validity.groups.iter();
    let own = groups.find(|group| group.group == "0.8" && group.method.name() == "model:a");
    let own = own.expect("it is there");
    assert_eq!((own.feature.as_str(), own.pairs, own.plants), ("gamma", 2, 1));
    near(own.typical, 1.25_f64.sqrt() - 1.0);
    near(own.against_default.expect("known"), (1.25_f64 / 4.5).sqrt());
    assert_eq!(own.interval, None, "one plant alone has none");
    assert!(validity.groups.iter().all(|group| group.feature == "gamma"), "all have one optimiser");
}

#[test]
fn diverged_choices_count_as_the_cap() {
    let mut all = pairs();
    let diverging = vec![1.0, 0.0, f64::INFINITY];
    all[0].regrets = Some(diverging);
    all[1].regrets = Some(vec![0.0, 0.25, 2.0 * CAP]);
    let validity = judged(all);
    let b = summary(&validity, "model:b"); // ∞ and 20 count as 10
    assert_eq!((b.diverged, b.capped), (1, 2));
    near(b.mean, 20.0 / 3.0);
    near(b.typical, 121.0_f64.cbrt() - 1.0);
    near(b.worst_tenth, CAP);
    near(summary(&validity, "random").mean, (11.0 / 3.0 + 10.25 / 3.0 + 1.0) / 3.0);
    let against = comparison(&validity.comparisons, "model:b", "log_replay");
    assert_eq!((against.wins, against.losses, against.pairs), (1, 2, 3));
    near(against.error_ratio, (121.0_f64 / 6.0).cbrt());
    let each = validity.each.iter().find(|regret| regret.method.name() == "model:b");
    assert_eq!(each.map(|regret| regret.regret), Some(f64::INFINITY), "what it was stays known");
}

fn refused(all: Vec<Pair>) -> String {
    let values = ["x", "y", "z"].map(str::to_owned).to_vec();
    judge(values, all, &[]).expect_err("refused").to_string()
}

#[test]
fn what_cannot_be_judged_is_left_out_or_refused() {
    let mut all = pairs();
    all[1].regrets = None;
    all[2].skill = Some(-0.1);
    let validity = judged(all.clone());
    assert_eq!((&*validity.left_out, validity.not_learnt), (&["q of north".to_owned()][..], 1));
    assert_eq!(validity.judged.len(), 2);
    assert!(refused(Vec::new()).contains("there is no plant and sensor to judge"));
    let mut odd = all.clone();
    odd[0].log_replay = Some(3);
    assert_eq!(refused(odd), "p of north: the choice of log replay is setting 3, but there are 3");
    let mut odd = all.clone();
    odd[0].another_window = Some(f64::NAN);
    assert!(refused(odd).contains("p of north has a regret of NaN"));
    all[0].online.pop();
    assert!(
        refused(all).contains("p of north has errors of 2 settings on held-out data, expected 3")
    );
}
