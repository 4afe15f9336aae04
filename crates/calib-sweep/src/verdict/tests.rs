mod recommendations;
mod simple_predictors;

use calib_agent::{AgentConfig, Part, PartScore, Scores};
use calib_core::Seed;
use proptest::prelude::*;

use super::*;
use crate::{Candidate, CurvePoint, EnvironmentId, RunRow, Unit, UnitResult};

const INF: f64 = f64::INFINITY;

/// Returns three settings, the last of which is the default.
fn candidates() -> Vec<Candidate> {
    (0..3)
        .map(|index| Candidate {
            index,
            is_default: index == 2,
            values: vec![("learning_rate".to_owned(), (index + 1).into())],
            agent: AgentConfig { gamma: 0.9, ..AgentConfig::default() },
        })
        .collect()
}

/// Returns one run with these errors, over a stream whose returns have standard deviation 1.
fn run(environment: EnvironmentId, run: usize, start_row: u32, errors: [f64; 3]) -> UnitResult {
    UnitResult {
        key: String::new(),
        unit: Unit { sensor: "A".to_owned(), environment, run },
        seed: 0,
        start_row,
        not_finite: None,
        rows: errors
            .iter()
            .enumerate()
            .map(|(candidate, &rmse)| {
                let score =
                    PartScore { scored_steps: 1000, rmse, mean_return: 0.0, return_std: 1.0 };
                RunRow {
                    candidate,
                    steps: 1000,
                    updates: 1,
                    scores: Scores { whole_run: Some(score), ..Scores::default() },
                    diverged_at: (rmse == INF).then_some(7),
                    curve: vec![],
                }
            })
            .collect(),
    }
}

fn member(number: usize, number_of_run: usize, errors: [f64; 3]) -> UnitResult {
    run(EnvironmentId::Member(number), number_of_run, 5, errors)
}

/// Returns two members with two rollouts each. Settings 0 and 1 take turns at being better than the default.
fn members() -> Vec<UnitResult> {
    vec![
        member(0, 0, [0.1, 0.2, 0.4]),
        member(0, 1, [0.3, 0.2, 0.4]),
        member(1, 0, [0.2, 0.2, 0.4]),
        member(1, 1, [0.2, 0.1, 0.4]),
    ]
}

fn log_run(number: usize, start_row: u32, errors: [f64; 3]) -> UnitResult {
    run(EnvironmentId::LogReplay, number, start_row, errors)
}

fn online_run(number: usize, start_row: u32, errors: [f64; 3]) -> UnitResult {
    run(EnvironmentId::Online, number, start_row, errors)
}

fn judging(rule: Rule) -> Judging<'static> {
    Judging {
        part: Part::WholeRun,
        rule,
        top_k: 1,
        scales: &[],
        simple: &[],
        best: None,
        stands_still: false,
        resamples: 300,
        seed: Seed::new(3),
    }
}

fn judge(rule: Rule, results: &[UnitResult]) -> SensorVerdict {
    verdict("A", &candidates(), results, &judging(rule)).expect("judged")
}

fn with(more: impl IntoIterator<Item = UnitResult>) -> Vec<UnitResult> {
    members().into_iter().chain(more).collect()
}

fn warns(verdict: &SensorVerdict, text: &str) -> bool {
    verdict.warnings.iter().any(|warning| warning.contains(text))
}

/// Returns the regret of another way to choose.
fn cost(truth: &Truth, baseline: ChoiceBaseline) -> Option<f64> {
    let own = truth.baselines.iter().find(|known| known.baseline == baseline).expect("there");
    own.regret.map(|regret| regret.value)
}

fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12, "{a} instead of {b}");
}

fn chosen_in_members(rule: Rule) -> usize {
    judge(rule, &members()).chosen
}

#[test]
fn rules_choose_by_their_definitions() {
    // Mean errors: member 0 has 0.2, 0.2, 0.4; member 1 has 0.2, 0.15, 0.4.
    let by_worst_rank = chosen_in_members(Rule::WorstRank);
    assert_eq!(by_worst_rank, 1, "rank 1 in both; value 0 is second in member 1");
    assert_eq!(chosen_in_members(Rule::MeanRank), 1);
    assert_eq!(chosen_in_members(Rule::MeanError), 1);
    // ln 0.1 + ln 0.3 + 2 ln 0.2 against 3 ln 0.2 + ln 0.1: 0.0012 against 0.0008.
    assert_eq!(chosen_in_members(Rule::MeanLogError), 1);
    // The log strongly prefers setting 0.
    let all = with((0..2).map(|number| log_run(number, 9, [0.05, 0.4, 0.5])));
    assert_eq!(judge(Rule::MeanLogError, &all).chosen, 1, "the log does not count");
    assert_eq!(judge(Rule::Pooled, &all).chosen, 0);
    assert_eq!(judge(Rule::LogReplay, &all).chosen, 0);
    assert_eq!(chosen_in_members(Rule::LogReplay), 1, "nothing was replayed");
}

/// Without a model only the replayed log decides, and ranks in members are not reported.
#[test]
fn the_log_decides_alone_where_there_is_no_model() {
    let all = [
        log_run(0, 0, [0.2, 0.1, 0.4]),
        log_run(1, 9, [0.3, 0.1, 0.4]),
        log_run(2, 18, [0.2, 0.3, 0.5]),
    ];
    let with_online: Vec<UnitResult> = all.iter().cloned().chain(online()).collect();
    let judged = judge(Rule::LogReplay, &with_online);
    assert_eq!((judged.chosen, judged.selection.as_ref(), judged.members.len()), (1, None, 0));
    let rules: Vec<Rule> = judged.rules.iter().map(|choice| choice.rule).collect();
    assert_eq!(rules, [Rule::LogReplay, Rule::OneStandardError]);
    let shares: f64 = judged.stability.iter().map(|share| share.share).sum();
    near(shares, 1.0);
    assert!(
        judged.stability[0].candidate == 1 && judged.stability.len() > 1,
        "windows are resampled"
    );
    assert!(judged.tells_apart() && judged.truth.is_some());
    // The same choice as next to a model, which this rule ignores.
    let beside =
        judge(Rule::LogReplay, &members().into_iter().chain(with_online).collect::<Vec<_>>());
    assert_eq!((beside.chosen, &beside.scores), (judged.chosen, &judged.scores));
    assert!(beside.selection.is_some());
    let text = serde_json::to_string(&judged).expect("JSON");
    assert!(!text.contains("selection"), "{text}");
    let read: SensorVerdict = serde_json::from_str(&text).expect("the same");
    assert_eq!(read.rules, judged.rules);
    let alike = [log_run(0, 0, [0.2; 3]), log_run(1, 9, [0.2; 3])];
    let alike = judge(Rule::LogReplay, &alike);
    assert!(!alike.tells_apart());
    assert!(
        alike.warnings.iter().any(|warning| warning.starts_with("all settings tie")),
        "{alike:?}"
    );
    for rule in [Rule::WorstRank, Rule::MeanRank, Rule::MeanError] {
        verdict("A", &candidates(), &all, &judging(rule)).expect_err("there is nothing to rank in");
    }
    verdict("A", &candidates(), &online(), &judging(Rule::LogReplay)).expect_err("nothing decides");
}

#[test]
fn what_a_race_on_the_log_dropped_is_told_with_its_error_there() {
    let mut results: Vec<UnitResult> =
        (0..4).map(|number: u32| log_run(number as usize, 9 * number, [0.2, 0.4, 0.3])).collect();
    for result in &mut results[1..] {
        result.rows.retain(|row| row.candidate != 1);
    }
    let verdict = judge(Rule::LogReplay, &results);
    assert_eq!((verdict.chosen, verdict.dropped.len()), (0, 1));
    near(verdict.dropped[0].mean_error, 0.4);
    let told =
        verdict.warnings.iter().find(|warning| warning.contains("the race dropped")).expect("told");
    assert!(
        told.contains("that the others made, on the log (") && !told.contains("model"),
        "{told}"
    );
}

#[test]
fn what_a_race_dropped_is_not_chosen() {
    // Setting 1 made one run, in a stream that was easy for all. Its error there is the smallest of all means.
    let errors = [[0.1, 0.15, 0.2], [0.4, 0.0, 0.5], [0.4, 0.0, 0.5], [0.4, 0.0, 0.5]];
    let mut results: Vec<UnitResult> = (0..4)
        .map(|number: usize| run(EnvironmentId::Member(number / 2), number % 2, 0, errors[number]))
        .collect();
    for result in &mut results[1..] {
        result.rows.retain(|row| row.candidate != 1);
    }
    for rule in Rule::ALL {
        let verdict = judge(rule, &results);
        assert_eq!(verdict.dropped.len(), 1);
        assert_eq!(verdict.chosen, 0, "{rule:?}");
    }
}

#[test]
fn a_result_of_another_sweep_is_named() {
    let mut results = members();
    results[2].rows[1].candidate = usize::MAX;
    let refused = verdict("A", &candidates(), &results, &judging(Rule::Pooled))
        .expect_err("none of the three");
    assert!(refused.to_string().contains("A in member:1, run 0"), "{refused}");
}

#[test]
fn the_default_stays_unless_another_is_better_by_a_standard_error() {
    // Differences of logarithms to the default: ln 1/2 three times and ln 1/4 once. Mean -0.866, sd 0.347, SE = sd /
    // sqrt(4/3) = 0.3.
    assert_eq!(judge(Rule::OneStandardError, &members()).chosen, 1);
    // Better by a factor of two in half of the runs, worse in the other half: no clear difference.
    let even = [[0.5, 0.2, 0.4], [0.5, 0.8, 0.4], [0.5, 0.2, 0.4], [0.5, 0.75, 0.4]];
    let results: Vec<UnitResult> = (0..4)
        .map(|number| run(EnvironmentId::Member(number / 2), number % 2, 0, even[number]))
        .collect();
    assert_eq!(judge(Rule::Pooled, &results).chosen, 1, "better on average");
    assert_eq!(judge(Rule::OneStandardError, &results).chosen, 2, "but not surely");
}

#[test]
fn what_diverges_is_not_chosen() {
    let mut results = members();
    results[0] = run(EnvironmentId::Member(0), 0, 5, [0.1, INF, 0.4]);
    for rule in Rule::ALL {
        assert_eq!(judge(rule, &results).chosen, 0, "{rule:?}");
    }
    // A default that diverges is replaced by a setting that does not.
    results[0] = run(EnvironmentId::Member(0), 0, 5, [0.1, 0.2, INF]);
    assert_eq!(judge(Rule::OneStandardError, &results).chosen, 1);
}

/// Returns two windows with two runs each. Setting 1 is best in the first, setting 0 in the second.
fn online() -> Vec<UnitResult> {
    vec![
        online_run(0, 100, [0.3, 0.1, 0.4]),
        online_run(1, 900, [0.2, 0.4, 0.4]),
        online_run(2, 100, [0.5, 0.3, 0.4]),
        online_run(3, 900, [0.2, 0.4, 0.4]),
    ]
}

#[test]
fn regrets_are_geometric_over_windows() {
    let verdict = judge(Rule::WorstRank, &with(online()));
    let truth = verdict.truth.expect("held out");
    assert_eq!(truth.windows.iter().map(|window| window.start_row).collect::<Vec<_>>(), [100, 900]);
    assert_eq!(
        truth.windows.iter().map(|window| window.best).collect::<Vec<_>>(),
        [Some(1), Some(0)]
    );
    // Mean errors are 0.4, 0.2, 0.4 and 0.2, 0.4, 0.4. Relative to the best they are 2, 1, 2 and 1, 2, 2.
    let regrets = truth.regrets.as_ref().expect("finite");
    near(regrets[0], 2.0_f64.sqrt() - 1.0);
    near(regrets[1], 2.0_f64.sqrt() - 1.0);
    near(regrets[2], 1.0);
    assert_eq!((truth.best, truth.scores.streams, truth.scores.runs), (Some(0), 2, 4));
    near(cost(&truth, ChoiceBaseline::AnotherWindow).expect("two windows"), 1.0);
    near(cost(&truth, ChoiceBaseline::Hindsight).expect("known"), 2.0_f64.sqrt() - 1.0);
    near(cost(&truth, ChoiceBaseline::Default).expect("known"), 1.0);
    near(
        cost(&truth, ChoiceBaseline::Random).expect("known"),
        (2.0 * (2.0_f64.sqrt() - 1.0) + 1.0) / 3.0,
    );
    assert_eq!(cost(&truth, ChoiceBaseline::LogReplay), None, "the log was not replayed");
    let choice = truth.choice;
    near(choice.against_default.expect("another").value, 0.5_f64.sqrt());
    assert_eq!(choice.regret.expect("known").upper, None, "two windows bound nothing");
    assert_eq!(verdict.grade, Grade::Fair, "a regret of 41 %");
}

#[test]
fn one_window_has_no_floor_and_is_not_green() {
    let results = with(online().into_iter().filter(|result| result.start_row == 100));
    let truth = judge(Rule::WorstRank, &results).truth.expect("held out");
    assert_eq!(truth.windows.len(), 1);
    assert_eq!(cost(&truth, ChoiceBaseline::AnotherWindow), None);
    assert_eq!(truth.scores.candidates[0].runs, 2, "runs are the sample where there is one window");
    assert_eq!(judge(Rule::WorstRank, &results).grade, Grade::Fair);
}

#[test]
fn a_best_value_without_skill_is_not_learnt() {
    let bad = [1.2, 1.1, 1.3];
    let windows = [online_run(0, 100, bad), online_run(1, 900, bad)];
    let verdict = judge(Rule::WorstRank, &with(windows));
    assert_eq!(verdict.grade, Grade::NotLearnt);
    near(verdict.truth.expect("held out").scores.skill[1].expect("finite"), -0.1);
}

#[test]
fn a_default_that_is_better_is_poor_advice() {
    let windows = [100, 500, 900].map(|row| run(EnvironmentId::Online, 0, row, [0.5, 0.4, 0.2]));
    let verdict = judge(Rule::WorstRank, &with(windows));
    assert_eq!(verdict.grade, Grade::Poor);
    let diverged = [100, 900].map(|row| run(EnvironmentId::Online, 0, row, [0.5, INF, 0.6]));
    let verdict = judge(Rule::WorstRank, &with(diverged));
    assert_eq!((verdict.chosen, verdict.grade), (1, Grade::Poor));
    assert_eq!(verdict.truth.expect("held out").choice.regret.expect("known").value, INF);
}

#[test]
fn windows_in_which_everything_diverges_are_left_out_and_told() {
    let lost = run(EnvironmentId::Online, 4, 2000, [INF, INF, INF]);
    let verdict = judge(Rule::WorstRank, &with(online().into_iter().chain([lost])));
    assert_eq!(verdict.grade, Grade::Poor, "the choice diverged there too");
    assert!(warns(&verdict, "diverged in 1 of 3 held-out windows"));
    let truth = verdict.truth.expect("held out");
    assert_eq!((truth.windows.len(), truth.windows[2].best), (3, None));
    near(truth.regrets.expect("of two windows")[0], 2.0_f64.sqrt() - 1.0);
    let all = [run(EnvironmentId::Online, 0, 100, [INF, INF, INF])];
    let verdict = judge(Rule::WorstRank, &with(all));
    assert_eq!(verdict.grade, Grade::Poor);
    assert_eq!(verdict.truth.expect("held out").choice.regret, None);
}

#[test]
fn a_divergence_of_another_windows_choice_excuses_nothing() {
    // Setting 0 is best in the first window and diverges in the second.
    let windows = [
        online_run(0, 100, [0.1, 0.3, 0.9]),
        online_run(1, 500, [INF, 0.3, 0.2]),
        online_run(2, 900, [0.15, 0.3, 0.2]),
    ];
    let verdict = judge(Rule::WorstRank, &with(windows));
    let truth = verdict.truth.expect("held out");
    let another = cost(&truth, ChoiceBaseline::AnotherWindow).expect("pairs without divergence");
    // The four pairs without divergence: ratios 0.2 / 0.2, 9, 0.2 / 0.15 and 1.
    let expected = ((1.0_f64.ln() + 9.0_f64.ln() + (0.2_f64 / 0.15).ln() + 0.0) / 4.0).exp_m1();
    near(another, expected);
}

#[test]
fn values_that_all_diverge_in_the_evidence_are_not_recommended() {
    // Every setting diverges in one window of the log, setting 2 in two.
    let results = with([
        log_run(0, 0, [INF, 0.2, INF]),
        log_run(1, 5_000, [0.1, INF, INF]),
        log_run(2, 10_000, [0.1, 0.3, 0.2]),
        log_run(3, 15_000, [0.1, 0.3, 0.2]),
    ]);
    let results: Vec<UnitResult> = results.into_iter().chain(online()).collect();
    let verdict = judge(Rule::Pooled, &results);
    assert_eq!(verdict.chosen, 0, "of those that diverged once the best elsewhere");
    assert_eq!(verdict.grade, Grade::Poor);
    assert!(warns(&verdict, "recommends none of them"));
    assert_eq!(judge(Rule::WorstRank, &results).grade, Grade::Fair, "members did not diverge");
}

/// Returns the scores on the log where the first setting has these errors in windows that begin at these rows.
fn log_scores(windows: &[(u32, f64)]) -> EnvironmentScores {
    let windows = windows.iter().enumerate();
    let runs = windows.map(|(number, &(row, error))| log_run(number, row, [error, 0.3, 0.4]));
    judge(Rule::Pooled, &with(runs)).log_replay.expect("replayed")
}

#[test]
fn windows_of_the_log_that_overlap_count_as_often_as_they_fit() {
    // A thousand steps each: two windows of the same rows, one that shares three hundred with them, and one apart.
    let some = log_scores(&[(0, 0.1), (0, 0.3), (700, 0.4), (5000, 0.7)]);
    assert_eq!((some.streams, some.independent, some.runs), (3, 2, 4));
    near(some.candidates[0].mean, (0.2 + 0.4 + 0.7) / 3.0);
    // s² = 0.19 / 3, with two of three windows independent: (2/3) s², t(1) = 12.706204736.
    let half = 12.706_204_736 * (2.0_f64 / 3.0 * (0.19 / 3.0)).sqrt();
    let interval = some.candidates[0].interval.expect("two");
    assert!((interval.high - 1.3 / 3.0 - half).abs() < 1e-6, "{interval:?}");
    // A chain in which each window shares rows with the next. Two windows fit into the 2,800 rows.
    let chain = log_scores(&[(0, 0.1), (600, 0.3), (1200, 0.4), (1800, 0.7)]);
    assert_eq!((chain.streams, chain.independent), (4, 2));
    let apart = log_scores(&[(0, 0.1), (1000, 0.3), (2000, 0.4), (3000, 0.7)]);
    assert_eq!((apart.streams, apart.independent), (4, 4));
}

#[test]
fn stability_counts_what_other_draws_choose() {
    let verdict = judge(Rule::WorstRank, &members());
    let shares: f64 = verdict.stability.iter().map(|share| share.share).sum();
    near(shares, 1.0);
    assert!(
        verdict.stability.iter().all(|share| share.candidate != 2),
        "the default is never better"
    );
    assert!(verdict.stability.len() == 2, "both others are chosen from some draws");
    assert_eq!(judge(Rule::WorstRank, &members()), verdict, "the same seed, the same draws");
}

#[test]
fn a_sensor_that_does_not_move_is_not_checked() {
    let judging = Judging { stands_still: true, ..judging(Rule::WorstRank) };
    let results = with(online());
    let verdict = verdict("A", &candidates(), &results, &judging).expect("judged");
    assert_eq!(verdict.recommendation(), Recommendation::NotChecked);
}

#[test]
fn the_start_up_and_other_parts_of_a_run_are_told() {
    // Setting 1 learns at once and is worse afterwards.
    let results: Vec<UnitResult> = with(online())
        .into_iter()
        .map(|mut result| {
            for row in &mut result.rows {
                row.steps = 100;
                let curve = (0..10).map(|window| {
                    let rmse = if window == 0 { 3.0 } else { 1.0 };
                    CurvePoint { step: 10 * (window + 1), rmse }
                });
                row.curve = curve.collect();
                let settled = [0.1, 0.3, 0.2][row.candidate];
                let score =
                    PartScore { scored_steps: 5, rmse: settled, mean_return: 1.0, return_std: 1.0 };
                row.scores.final_quarter = Some(score);
            }
            result
        })
        .collect();
    let verdict = judge(Rule::WorstRank, &results);
    near(verdict.start_up_share.expect("curves"), 0.5);
    let parts: Vec<(Part, usize)> =
        verdict.parts.iter().map(|choice| (choice.part, choice.chosen)).collect();
    assert_eq!(parts, [(Part::WholeRun, 1), (Part::FinalQuarter, 0)]);
    near(verdict.parts[1].online_error.expect("held out"), 0.1);
    near(verdict.parts[1].online_error_of_verdict.expect("held out"), 0.3);
}

fn regrets(results: &[UnitResult]) -> Vec<f64> {
    judge(Rule::WorstRank, results).truth.and_then(|truth| truth.regrets).expect("finite")
}

proptest! {
    /// With one window and one run, the geometric regret is the plain regret.
    #[test]
    fn with_one_window_regret_is_the_quotient(errors in prop::array::uniform3(0.01_f64..5.0)) {
        let verdict = judge(Rule::WorstRank, &with([run(EnvironmentId::Online, 0, 1, errors)]));
        let truth = verdict.truth.expect("held out");
        let best = errors.iter().copied().fold(INF, f64::min);
        for (error, regret) in errors.iter().zip(truth.regrets.expect("finite")) {
            prop_assert!((regret - (error / best - 1.0)).abs() < 1e-9);
        }
        prop_assert_eq!(truth.choice.regret.expect("known").upper, None);
        prop_assert_eq!(truth.choice.against_default.and_then(|estimate| estimate.interval), None);
        prop_assert_ne!(verdict.grade, Grade::Good);
        prop_assert!(verdict.grade != Grade::Poor || errors[verdict.chosen] >= 1.0, "one run is no proof");
    }

    /// A factor on the errors of all settings in a window changes no regret.
    #[test]
    fn regrets_do_not_depend_on_the_level_of_a_window(factor in 0.01_f64..100.0) {
        let scaled = online().into_iter().map(|mut result| {
            if result.start_row == 100 {
                for row in &mut result.rows {
                    let score = row.scores.whole_run.as_mut().expect("scored");
                    score.rmse *= factor;
                }
            }
            result
        });
        let (plain, scaled) = (regrets(&with(online())), regrets(&with(scaled)));
        for (a, b) in plain.iter().zip(scaled) {
            prop_assert!((a - b).abs() < 1e-9);
        }
    }
}
