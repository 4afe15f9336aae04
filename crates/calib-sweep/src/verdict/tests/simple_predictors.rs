//! Verdicts that compare agents with simple predictors.

use calib_agent::SimplePredictor;
use calib_stats::{Estimate, Interval};

use super::*;
use crate::{
    SimpleScore,
    verdict::simple::{decisive, preferred},
};

/// Returns the error of a simple predictor in the window of this environment that begins at this row.
pub(super) fn score(
    predictor: SimplePredictor,
    environment: EnvironmentId,
    start_row: u32,
    rmse: f64,
) -> SimpleScore {
    let score = PartScore { scored_steps: 10, rmse, mean_return: 1.0, return_std: 1.0 };
    SimpleScore {
        sensor: "A".to_owned(),
        predictor,
        environment,
        start_row,
        scores: Scores { whole_run: Some(score), ..Scores::default() },
    }
}

/// Returns the error of a simple predictor in the held-out window that begins at this row.
fn online_score(predictor: SimplePredictor, start_row: u32, rmse: f64) -> SimpleScore {
    score(predictor, EnvironmentId::Online, start_row, rmse)
}

/// Returns the verdict with these errors of persistence and of the mean in the three held-out windows. The choice has
/// errors 0.2, 0.2 and 0.4.
fn judged_beside(persistence: [f64; 3], mean: f64) -> SensorVerdict {
    let errors = [[0.4, 0.2, 0.4], [0.4, 0.2, 0.4], [0.4, 0.2, 0.4]];
    let windows = [100, 500, 900];
    let results = with(
        windows.iter().zip(errors).map(|(&row, errors)| run(EnvironmentId::Online, 0, row, errors)),
    );
    let simple: Vec<SimpleScore> = windows
        .into_iter()
        .zip(persistence)
        .flat_map(|(row, error)| {
            [
                online_score(SimplePredictor::Mean, row, mean),
                online_score(SimplePredictor::Persistence, row, error),
            ]
        })
        .collect();
    let judging = Judging { simple: &simple, ..judging(Rule::WorstRank) };
    verdict("A", &candidates(), &results, &judging).expect("judged")
}

#[test]
fn no_agent_is_deployed_that_a_simple_predictor_beats() {
    // The agent has 0.2 in every window.
    let verdict = judged_beside([0.11, 0.1, 0.09], 1.0);
    assert_eq!(verdict.grade, Grade::Simpler);
    assert_eq!(verdict.recommendation(), Recommendation::UseSimplePredictor);
    let simpler = verdict.simpler().expect("persistence");
    assert_eq!(simpler.predictor, SimplePredictor::Persistence);
    assert!(simpler.is_better());
    near(simpler.ratio.expect("known").value, 0.2 / (0.11_f64 * 0.1 * 0.09).cbrt());
    // As good on average, and worse in one window: the agent is not shown to be as good.
    let verdict = judged_beside([0.3, 0.2, 0.14], 1.0);
    assert_eq!(verdict.grade, Grade::Simpler);
    assert!(!verdict.simpler().expect("persistence").is_better());
}

/// Returns the verdict by the errors over a part of the runs. Setting 0 has 0.2 over whole runs, where it is the best and
/// persistence has 0.5. In the final quarter the settings and persistence have these errors.
fn judged_by_part(part: Part, settings: [f64; 3], persistence: f64) -> SensorVerdict {
    let windows = [100, 500, 900, 1_300];
    let predictors =
        [(SimplePredictor::Mean, 1.0, 1.0), (SimplePredictor::Persistence, 0.5, persistence)];
    let mut results = Vec::new();
    let mut simple = Vec::new();
    for environment in [EnvironmentId::LogReplay, EnvironmentId::Online] {
        for (number, row) in (0..).zip(windows) {
            let mut result = run(environment, number, row, [0.2, 0.4, 0.3]);
            for (own, rmse) in result.rows.iter_mut().zip(settings) {
                let whole = own.scores.whole_run.expect("scored");
                own.scores.final_quarter = Some(PartScore { rmse, ..whole });
            }
            results.push(result);
            for (predictor, whole, last) in predictors {
                let mut own = score(predictor, environment, row, whole);
                let whole = own.scores.whole_run.expect("scored");
                own.scores.final_quarter = Some(PartScore { rmse: last, ..whole });
                simple.push(own);
            }
        }
    }
    let judging = Judging { part, simple: &simple, ..judging(Rule::LogReplay) };
    verdict("A", &candidates(), &results, &judging).expect("judged")
}

#[test]
fn each_part_of_a_run_has_a_recommendation_of_its_own() {
    let judged = judged_by_part(Part::WholeRun, [0.3, 0.5, 0.4], 0.1);
    assert_eq!(judged.recommendation(), Recommendation::Deploy);
    let parts: Vec<(Part, Recommendation)> =
        judged.parts.iter().map(|own| (own.part, own.recommendation)).collect();
    let expected = [
        (Part::WholeRun, Recommendation::Deploy),
        (Part::FinalQuarter, Recommendation::UseSimplePredictor),
    ];
    assert_eq!(parts, expected, "runs have no scores without their first quarter");
    assert_eq!(judged.parts[0].predictor, None);
    assert_eq!(judged.parts[1].predictor, Some(SimplePredictor::Persistence));
    for (own, ratio) in judged.parts.iter().zip([0.4, 3.0]) {
        let compared = own.simple.as_ref().expect("known");
        assert_eq!(compared.predictor, SimplePredictor::Persistence);
        near(compared.ratio.expect("known").value, ratio);
    }
    // The same as if that part were scored.
    let scored = judged_by_part(Part::FinalQuarter, [0.3, 0.5, 0.4], 0.1);
    assert_eq!(scored.recommendation(), Recommendation::UseSimplePredictor);
    assert_eq!(scored.simpler(), judged.parts[1].simple.as_ref());
    assert_eq!(scored.parts[0].recommendation, Recommendation::Deploy);
}

#[test]
fn a_part_names_its_setting_only_if_it_advises_to_use_an_agent_too() {
    let settings = [0.5, 0.4, 0.2];
    let alike = judged_by_part(Part::WholeRun, settings, 0.5);
    let simpler = judged_by_part(Part::WholeRun, settings, 0.1);
    let advice = [&alike, &simpler].map(|verdict| verdict.parts[1].recommendation);
    assert_eq!(advice, [Recommendation::Deploy, Recommendation::UseSimplePredictor]);
    for verdict in [&alike, &simpler] {
        assert_eq!((verdict.chosen, verdict.parts[1].chosen), (0, 2));
    }
    assert!(warns(&alike, "would choose learning_rate = 3;"), "{:?}", alike.warnings);
    assert!(!warns(&simpler, "would choose"), "{:?}", simpler.warnings);
}

/// Returns a simple predictor with these errors on the log and on held-out data. `ratio` is the agent's error relative
/// to it, with its interval.
fn simple(predictor: SimplePredictor, log: f64, online: f64, ratio: [f64; 3]) -> SimpleComparison {
    let [low, value, high] = ratio;
    SimpleComparison {
        predictor,
        online_error: Some(online),
        online_rmse: Some(online),
        log_error: Some(log),
        ratio: Some(Estimate { value, interval: Some(Interval { low, high }) }),
        against_mean: None,
        log_windows: None,
        runaway_windows: 0,
    }
}

fn is_line_beaten(ratio: [f64; 3]) -> bool {
    simple(SimplePredictor::Line, 0.5, 0.5, ratio).is_beaten()
}

#[test]
fn a_predictor_is_beaten_by_two_per_cent_and_more_than_chance() {
    assert!(is_line_beaten([0.9, 0.93, 0.97]));
    assert!(!is_line_beaten([0.8, 0.9, 1.01]), "it could be chance");
    assert!(!is_line_beaten([0.985, 0.99, 0.995]), "one per cent");
    let single = SimpleComparison {
        ratio: Some(Estimate { value: 0.5, interval: None }),
        ..simple(SimplePredictor::Line, 0.5, 0.5, [0.4, 0.5, 0.6])
    };
    assert!(!single.is_beaten(), "one window");
}

fn preferred_predictor(all: &[SimpleComparison]) -> Option<SimplePredictor> {
    preferred(&all.iter().collect::<Vec<_>>()).map(|own| own.predictor)
}

fn decisive_predictor(all: &[SimpleComparison]) -> Option<SimplePredictor> {
    decisive(all, None, None).map(|own| own.predictor)
}

#[test]
fn the_simple_predictor_to_use_is_chosen_on_the_log() {
    let mean = simple(SimplePredictor::Mean, 1.0, 1.0, [0.2, 0.3, 0.4]);
    let ridge = simple(SimplePredictor::Ridge, 0.30, 0.35, [0.8, 1.0, 1.2]);
    // Better on held-out data, which is not known at the time of the choice.
    let line = simple(SimplePredictor::Line, 0.40, 0.33, [0.9, 1.1, 1.3]);
    let all = [mean.clone(), line.clone(), ridge.clone()];
    assert_eq!(preferred_predictor(&all), Some(SimplePredictor::Ridge));
    assert_eq!(decisive_predictor(&all), Some(SimplePredictor::Ridge));
    // The simplest of those within one per cent.
    let near = SimpleComparison { log_error: Some(0.302), ..line.clone() };
    let all = [mean.clone(), near, ridge.clone()];
    assert_eq!(preferred_predictor(&all), Some(SimplePredictor::Line));
    // The agent matches the preferred predictor. The advantage of the other on held-out data could be chance.
    let matched = simple(SimplePredictor::Ridge, 0.30, 0.35, [0.95, 0.98, 1.01]);
    assert_eq!(decisive_predictor(&[mean.clone(), line, matched.clone()]), None);
    // This advantage is more than chance.
    let better = simple(SimplePredictor::Line, 0.40, 0.2, [1.4, 1.6, 1.8]);
    let all = [mean, better, matched.clone()];
    assert_eq!(decisive_predictor(&all), Some(SimplePredictor::Line));
    // The mean has one per cent more error than the ridge predictor, which is too little to count as prediction.
    let nearly = simple(SimplePredictor::Mean, 1.0, 0.3535, [0.8, 0.99, 1.2]);
    assert_eq!(decisive_predictor(&[nearly, ridge.clone()]), Some(SimplePredictor::Mean));
    // The mean does as well as the predictor that the log prefers.
    let mean = simple(SimplePredictor::Mean, 1.0, 0.34, [0.9, 1.02, 1.2]);
    assert_eq!(decisive_predictor(&[mean, ridge]), Some(SimplePredictor::Mean));
}

/// Returns the same predictor with this ratio to the training mean.
fn beside_mean(own: &SimpleComparison, [low, value, high]: [f64; 3]) -> SimpleComparison {
    let against_mean = Some(Estimate { value, interval: Some(Interval { low, high }) });
    SimpleComparison { against_mean, ..own.clone() }
}

#[test]
fn the_training_mean_is_not_named_where_something_is_shown_to_beat_it() {
    // Three windows of a well. The log prefers ridge regression, which fails in one of them.
    let mean = simple(SimplePredictor::Mean, 0.892, 1.50, [0.092, 0.156, 0.266]);
    let ridge = simple(SimplePredictor::Ridge, 0.2358, 1.99, [0.011, 0.161, 2.39]);
    let ridge = beside_mean(&ridge, [0.091, 0.971, 10.4]);
    let persistence = simple(SimplePredictor::Persistence, 0.2732, 0.279, [0.720, 0.843, 0.988]);
    let persistence = beside_mean(&persistence, [0.105, 0.185, 0.329]);
    let autoregression =
        simple(SimplePredictor::Autoregression, 0.2397, 0.2345, [0.977, 1.005, 1.033]);
    let autoregression = beside_mean(&autoregression, [0.092, 0.156, 0.265]);
    let all = [mean.clone(), persistence, autoregression.clone(), ridge.clone()];
    assert_eq!(decisive_predictor(&all), Some(SimplePredictor::Autoregression));
    // The agent matches the autoregression.
    let ratio = simple(SimplePredictor::Autoregression, 0.2397, 0.2345, [0.99, 1.0, 1.01]).ratio;
    let matched = SimpleComparison { ratio, ..autoregression };
    assert_eq!(decisive_predictor(&[mean.clone(), matched.clone(), ridge.clone()]), None);
    // The agent alone is shown to beat the mean.
    assert_eq!(decisive_predictor(&[mean.clone(), ridge.clone()]), None);
    // Nothing is shown to beat the mean.
    let chance = simple(SimplePredictor::Mean, 0.892, 1.50, [0.02, 0.156, 1.2]);
    assert_eq!(decisive_predictor(&[chance.clone(), ridge.clone()]), Some(SimplePredictor::Mean));
    // The agent matches a predictor that is shown to beat the mean, but is not shown to beat it itself.
    let all = [simple(SimplePredictor::Mean, 0.892, 1.50, [0.97, 0.99, 1.01]), matched];
    assert_eq!(decisive_predictor(&all), Some(SimplePredictor::Autoregression));
}

/// Returns the verdict without held-out data. The choice has error 0.2 in four windows of the log, and the predictors
/// have these errors.
fn judged_on_the_log(scores: &[(SimplePredictor, [f64; 4])]) -> SensorVerdict {
    let rows = [0, 5000, 10_000, 15_000];
    let results: Vec<UnitResult> =
        rows.iter().enumerate().map(|(run, &row)| log_run(run, row, [0.2, 0.4, 0.3])).collect();
    let simple: Vec<SimpleScore> = scores
        .iter()
        .flat_map(|(predictor, errors)| {
            rows.iter()
                .zip(errors)
                .map(move |(&row, &error)| score(*predictor, EnvironmentId::LogReplay, row, error))
        })
        .collect();
    let judging = Judging { simple: &simple, ..judging(Rule::LogReplay) };
    verdict("A", &candidates(), &results, &judging).expect("judged")
}

#[test]
fn without_held_out_data_simple_predictors_are_compared_on_the_log() {
    let mean = (SimplePredictor::Mean, [0.5, 0.6, 0.5, 0.4]);
    let beaten =
        judged_on_the_log(&[mean, (SimplePredictor::Persistence, [0.03, 0.04, 0.03, 0.05])]);
    assert_eq!((beaten.chosen, beaten.grade), (0, Grade::Simpler));
    assert_eq!(beaten.recommendation(), Recommendation::UseSimplePredictor);
    let simpler = beaten.simpler().expect("persistence");
    assert_eq!(simpler.predictor, SimplePredictor::Persistence);
    assert_eq!((simpler.log_windows, simpler.online_error), (Some(4), None));
    let ratio = simpler.ratio.expect("known");
    near(ratio.value, 0.2 / (0.03_f64 * 0.04 * 0.03 * 0.05).powf(0.25));
    assert!(ratio.interval.is_some_and(|interval| interval.low > 1.0), "{ratio:?}");
    assert!(!beaten.level_may_have_changed(), "only held-out data shows another level");
    let unlearnt = judged_on_the_log(&[(SimplePredictor::Mean, [0.1, 0.12, 0.1, 0.11])]);
    assert_eq!(unlearnt.recommendation(), Recommendation::DoNotDeploy);
    let matched = judged_on_the_log(&[mean, (SimplePredictor::Persistence, [0.3, 0.4, 0.3, 0.3])]);
    assert_eq!((matched.grade, matched.simpler()), (Grade::Unchecked, None));
    assert_eq!(judged_on_the_log(&[]).grade, Grade::Unchecked);
}

#[test]
fn the_log_decides_where_the_sensor_is_constant_in_the_held_out_data() {
    let rows = [0, 5000, 10_000];
    let results: Vec<UnitResult> = rows
        .into_iter()
        .flat_map(|row| [log_run(0, row, [0.2, 0.4, 0.3]), online_run(0, row, [0.2, 0.4, 0.3])])
        .collect();
    let line = SimplePredictor::Line;
    let online = rows.map(|row| score(line, EnvironmentId::Online, row, 0.001));
    // The errors in constant data say nothing.
    for (error, grade) in [(0.1, Grade::Simpler), (0.5, Grade::Unchecked)] {
        let on_the_log = rows.map(|row| score(line, EnvironmentId::LogReplay, row, error));
        let simple = [online.clone(), on_the_log].concat();
        let judging = Judging { simple: &simple, stands_still: true, ..judging(Rule::LogReplay) };
        let judged = verdict("A", &candidates(), &results, &judging).expect("judged");
        assert_eq!(judged.grade, grade, "an error of {error} on the log");
    }
}

/// Setting 0 is the default with these errors, and learns nothing. Setting 1 is chosen. All start from a line. The
/// best simple predictor is persistence.
fn judged_beside_frozen(of_default: [f64; 3]) -> SensorVerdict {
    let windows = [100, 500, 900];
    let online =
        windows.iter().zip(of_default).map(|(&row, error)| online_run(0, row, [error, 0.2, 0.4]));
    let mut candidates = candidates();
    for candidate in &mut candidates {
        candidate.is_default = candidate.index == 0;
        candidate.agent.baseline = Some(SimplePredictor::Best);
    }
    candidates[0].agent.learning_rate = 0.0;
    let predictors = [(SimplePredictor::Mean, 1.0), (SimplePredictor::Persistence, 0.25)];
    let simple: Vec<SimpleScore> = windows
        .iter()
        .flat_map(|&row| predictors.map(|(predictor, error)| online_score(predictor, row, error)))
        .collect();
    let best = Some(SimplePredictor::Line);
    let judging = Judging { simple: &simple, best, ..judging(Rule::WorstRank) };
    verdict("A", &candidates, &with(online), &judging).expect("judged")
}

#[test]
fn a_default_that_learns_nothing_is_kept_unless_the_choice_improves_on_it() {
    let alike = judged_beside_frozen([0.19, 0.2, 0.22]);
    assert_eq!((alike.chosen, alike.grade), (1, Grade::Good));
    assert_eq!(alike.learning_off, Some(0));
    assert_eq!(alike.recommendation(), Recommendation::UseSimplePredictor);
    // The part names the predictor that the default starts from, which is not the one of the ratio.
    let part = &alike.parts[0];
    assert_eq!(part.predictor, Some(SimplePredictor::Line));
    let compared = part.simple.as_ref().expect("known");
    assert_eq!(compared.predictor, SimplePredictor::Persistence);
    // More than chance, but too little to be worth an agent.
    let hardly = judged_beside_frozen([0.2006, 0.2005, 0.2004]);
    assert!(hardly.truth.as_ref().is_some_and(Truth::improves_on_the_default));
    assert_eq!(hardly.learning_off, Some(0));
    let improved = judged_beside_frozen([0.3, 0.32, 0.31]);
    assert_eq!(improved.learning_off, None);
    assert_eq!(improved.recommendation(), Recommendation::Deploy);
    assert_eq!(improved.parts[0].predictor, None);
}

#[test]
fn an_agent_that_matches_every_simple_predictor_is_judged_as_before() {
    let verdict = judged_beside([0.2, 0.2, 0.2], 1.0);
    assert_eq!((verdict.grade, verdict.simpler()), (Grade::Good, None));
    assert_eq!(verdict.recommendation(), Recommendation::Deploy);
    assert_eq!(verdict.simple.len(), 2);
    let better = judged_beside([0.5, 0.6, 0.55], 1.0);
    assert_eq!(better.recommendation(), Recommendation::Deploy);
}

#[test]
fn what_does_not_beat_the_training_mean_is_not_learnt() {
    let verdict = judged_beside([0.5, 0.5, 0.5], 0.15);
    assert_eq!(verdict.grade, Grade::NotLearnt);
    assert_eq!(verdict.recommendation(), Recommendation::DoNotDeploy);
}

/// Returns the grade of an agent with these errors, one per window. The training mean has error 1 in each, and nothing
/// else predicts better than that mean.
fn grade_beside_mean(agent: &[f64]) -> Grade {
    let rows = (1..).map(|window| 100 * window);
    let online = rows.clone().zip(agent).map(|(row, &error)| online_run(0, row, [2.0, error, 2.0]));
    let results = with(online);
    let means: Vec<SimpleScore> =
        rows.zip(agent).map(|(row, _)| online_score(SimplePredictor::Mean, row, 1.0)).collect();
    let judging = Judging { simple: &means, ..judging(Rule::WorstRank) };
    verdict("A", &candidates(), &results, &judging).expect("judged").grade
}

#[test]
fn what_is_not_shown_to_beat_the_training_mean_is_not_learnt() {
    // White noise: slightly less error than the mean.
    assert_eq!(grade_beside_mean(&[0.997, 0.99, 1.004, 0.998]), Grade::NotLearnt);
    assert_eq!(grade_beside_mean(&[0.99, 0.991, 0.989, 0.99]), Grade::NotLearnt, "too little");
    assert_eq!(grade_beside_mean(&[0.96, 0.965, 0.955, 0.96]), Grade::Good);
    assert_eq!(grade_beside_mean(&[0.5, 1.6, 0.6, 0.7]), Grade::NotLearnt, "chance");
    assert_eq!(grade_beside_mean(&[0.2, 0.21]), Grade::Good);
}

#[test]
fn a_default_that_is_the_training_mean_is_not_learnt() {
    // The choice has 5 % less error, in too few windows to show it. The default learns nothing, and equals the mean.
    let windows = [100, 500, 900];
    let errors = [0.93, 0.955, 0.97];
    let online =
        windows.into_iter().zip(errors).map(|(row, error)| online_run(0, row, [1.0, error, 2.0]));
    let mut candidates = candidates();
    for candidate in &mut candidates {
        candidate.is_default = candidate.index == 0;
        candidate.agent.baseline = Some(SimplePredictor::Mean);
    }
    candidates[0].agent.learning_rate = 0.0;
    let means: Vec<SimpleScore> =
        windows.iter().map(|&row| online_score(SimplePredictor::Mean, row, 1.0)).collect();
    let judging = Judging { simple: &means, ..judging(Rule::WorstRank) };
    let verdict = verdict("A", &candidates, &with(online), &judging).expect("judged");
    assert_eq!((verdict.chosen, verdict.learning_off), (1, Some(0)));
    assert_eq!(verdict.grade, Grade::NotLearnt);
}

#[test]
fn windows_in_which_the_agent_ran_away_are_counted() {
    // The agent has 0.2 in every window.
    let verdict = judged_beside([0.01, 0.015, 0.1], 1.0);
    let persistence = &verdict.simple[1];
    assert_eq!(
        (persistence.predictor, persistence.runaway_windows),
        (SimplePredictor::Persistence, 2)
    );
    assert_eq!(verdict.simple[0].runaway_windows, 0);
}

#[test]
fn held_out_values_that_are_elsewhere_are_a_poor_ground() {
    let verdict = judged_beside([0.3, 0.3, 0.3], 400.0);
    assert_eq!((verdict.grade, verdict.elsewhere()), (Grade::Poor, Some(400.0)));
    assert_eq!(verdict.recommendation(), Recommendation::DoNotDeploy);
    assert_eq!(judged_beside([0.3, 0.3, 0.3], 19.0).grade, Grade::Good);
}

#[test]
fn inputs_that_left_their_range_make_a_good_choice_fair() {
    let mut good = judged_beside([0.5, 0.6, 0.55], 1.0);
    good.doubt_inputs();
    assert_eq!(good.grade, Grade::Fair);
    let mut simpler = judged_beside([0.11, 0.1, 0.09], 1.0);
    simpler.doubt_inputs();
    assert_eq!(simpler.grade, Grade::Simpler);
}

/// Returns the training mean with this error on held-out data.
fn mean(online: f64) -> SimpleComparison {
    simple(SimplePredictor::Mean, 1.0, online, [1.0, 0.9, 1.1])
}

#[test]
fn another_level_than_in_training_is_known() {
    let persistence = simple(SimplePredictor::Persistence, 1.0, 9.0, [1.0, 0.9, 1.1]);
    assert!(warnings::level_may_have_changed(&[persistence.clone(), mean(3.32)]));
    for quiet in [vec![persistence], vec![mean(1.9)], vec![mean(f64::INFINITY)]] {
        assert!(!warnings::level_may_have_changed(&quiet));
    }
}
