use calib_agent::SimplePredictor;
use calib_stats::{Estimate, Interval};

use super::*;
use crate::{Separation, SimpleRow, Simpler, Sources, TopK};

fn estimate(value: f64, low: f64, high: f64) -> Estimate {
    Estimate { value, interval: Some(Interval { low, high }) }
}

fn alternative(baseline: ChoiceBaseline, value: Option<f64>, regret: f64) -> Alternative {
    let regret = Some(Bounded { value: regret, upper: None });
    Alternative { baseline, value: value.map(Setting::from), regret }
}

pub(in crate::report) fn verdict() -> Verdict {
    Verdict {
        sensor: "PIT300".to_owned(),
        field: "learning_rate".to_owned(),
        model: "kNN".to_owned(),
        chosen: Setting::from(1e-4),
        grade: Grade::Good,
        reason: Reason::WorstRank,
        evidence: Separation::Apart,
        tie_set: [3e-5, 1e-4, 3e-4].map(Setting::from).to_vec(),
        worst_rank: 2,
        values: 9,
        members: 5,
        stability: vec![(Setting::from(1e-4), 0.7), (Setting::from(3e-4), 0.3)],
        stability_nearby: None,
        outside_training: None,
        elsewhere: None,
        online: Some(HeldOutResult {
            part: "whole runs".to_owned(),
            windows: 4,
            runs: 8,
            values: Separation::Apart,
            stands_still: false,
            chosen_error: 0.423,
            chosen_skill: Some(0.55),
            best: Setting::from(3e-4),
            best_error: 0.42,
            best_skill: Some(0.57),
            regret: Some(Bounded { value: 0.025, upper: Some(0.05) }),
            against_default: Some(estimate(0.8, 0.7, 0.9)),
            spearman: Some(0.93),
            kendall: Some(0.83),
            top_k: Some(TopK { k: 3, hit: true }),
        }),
        alternatives: vec![
            alternative(ChoiceBaseline::Default, Some(1e-3), 0.28),
            alternative(ChoiceBaseline::LogReplay, Some(3e-4), 0.01),
            alternative(ChoiceBaseline::LatestWindow, Some(1e-4), 0.025),
            alternative(ChoiceBaseline::Random, None, 1.2),
            alternative(ChoiceBaseline::Hindsight, Some(3e-4), 0.01),
            alternative(ChoiceBaseline::AnotherWindow, None, 0.03),
        ],
        simple: vec![],
        agent_on_log: None,
        simpler: None,
        matched: None,
        frozen: None,
        learns_nothing: false,
        parts: vec![],
        start_up_share: None,
        notes: vec![],
    }
}

fn text(verdict: &Verdict) -> String {
    [vec![verdict.headline()], verdict.reasons()].concat().join("\n")
}

#[test]
fn a_good_verdict() {
    insta::assert_snapshot!(text(&verdict()), @r"
Use learning_rate = 1e-4 for PIT300.
kNN never ranks it below 2nd of 9 settings in its 5 ensemble members.
It ties with 3e-5 and 3e-4 on worst rank; mean rank, then mean NRMSE, then the order of the grid decided.
Not certain: when calib resamples its evidence (models, runs and windows of the log), 1e-4 wins in 70 % and 3e-4 in 30 %.
On held-out data (whole runs of 4 windows, 8 runs) its regret is 2.5 % (95 %: at most 5 %). The best setting over all windows is 3e-4 (NRMSE 0.42 against 0.423).
Its skill is 0.55: 55 % less error than the mean return of each window, which is only known afterwards. The best setting's is 0.57. NRMSE divides by the spread of returns in the training range.
It has 20 % less error than the default, 1e-3 (95 %: 10 % to 30 % less).
Log replay's choice (3e-4) would have had a regret of 1 %.
The choice of the log's latest window is the same setting.
For scale: choosing by one other window of the held-out period would have cost 3 %, the best fixed setting 1 % and a random setting 120 % on average.
The ranking of all settings agrees closely with the one on held-out data (Spearman 0.93, Kendall 0.83). The choice is among the 3 best there.
");
}

#[test]
fn a_pooled_choice() {
    let reason = Reason::Pooled { streams: 25, sources: Sources::MembersAndLog };
    let verdict = Verdict { reason, stability: vec![], ..verdict() };
    insta::assert_snapshot!(text(&verdict).lines().take(3).collect::<Vec<_>>().join("\n"), @r"
Use learning_rate = 1e-4 for PIT300.
Chosen for the smallest error, as a geometric mean over 25 training runs in kNN and on the replayed log.
kNN never ranks it below 2nd of 9 settings in its 5 ensemble members.
");
}

#[test]
fn a_choice_without_a_model_speaks_of_the_log_alone() {
    let alone = Verdict {
        model: "log replay".to_owned(),
        reason: Reason::LogReplay { streams: 25 },
        tie_set: vec![],
        worst_rank: 0,
        members: 0,
        ..verdict()
    };
    insta::assert_snapshot!(text(&alone).lines().take(3).collect::<Vec<_>>().join("\n"), @r"
Use learning_rate = 1e-4 for PIT300.
Chosen for the smallest error, as a geometric mean over 25 windows of the replayed log.
Not certain: when calib resamples its evidence (windows of the log), 1e-4 wins in 70 % and 3e-4 in 30 %.
");
    let sources = Sources::Log;
    let stays =
        Verdict { reason: Reason::OneStandardError { streams: 25, sources }, ..alone.clone() };
    assert!(
        text(&stays).contains("over 25 training runs on the replayed log."),
        "{}",
        text(&stays)
    );
    let not_learnt = Verdict { grade: Grade::NotLearnt, ..alone.clone() };
    assert!(text(&not_learnt).contains("The choice of log replay is learning_rate = 1e-4."));
    for told in [text(&alone), text(&stays), text(&not_learnt)] {
        assert!(!["model", "member", "kNN"].iter().any(|word| told.contains(word)), "{told}");
    }
}

#[test]
fn a_default_that_stays() {
    let mut verdict = Verdict {
        reason: Reason::OneStandardError { streams: 25, sources: Sources::MembersAndLog },
        chosen: Setting::from(1e-3),
        ..verdict()
    };
    verdict.online.as_mut().unwrap().against_default = None;
    insta::assert_snapshot!(text(&verdict).lines().take(2).collect::<Vec<_>>().join("\n"), @r"
Use learning_rate = 1e-3 for PIT300.
It is the default, and no other setting is better by more than one standard error over 25 training runs in kNN and on the replayed log.
");
    assert!(text(&verdict).contains("is the default."));
}

#[test]
fn a_verdict_without_online() {
    let verdict = Verdict {
        online: None,
        grade: Grade::Unchecked,
        outside_training: None,
        elsewhere: None,
        tie_set: vec![Setting::from(1e-4)],
        worst_rank: 1,
        stability: vec![(Setting::from(1e-4), 1.0)],
        ..verdict()
    };
    insta::assert_snapshot!(text(&verdict), @r"
Use learning_rate = 1e-4 for PIT300, on the evidence of the log.
kNN ranks it best of 9 settings in all 5 ensemble members.
When calib resamples its evidence (models, runs and windows of the log), 1e-4 always wins.
No data was held out, so regret and agreement with the held-out period are unknown.
");
}

#[test]
fn a_choice_that_diverged() {
    let mut verdict = Verdict { grade: Grade::Poor, ..verdict() };
    let online = verdict.online.as_mut().unwrap();
    let infinite = Bounded { value: f64::INFINITY, upper: None };
    online.chosen_error = f64::INFINITY;
    online.chosen_skill = None;
    online.regret = Some(infinite);
    online.against_default = None;
    online.spearman = Some(-0.4);
    online.top_k = Some(TopK { k: 3, hit: false });
    verdict.alternatives[0].regret = Some(infinite);
    insta::assert_snapshot!(text(&verdict), @r"
Do not deploy learning_rate = 1e-4 for PIT300 on this evidence.
kNN never ranks it below 2nd of 9 settings in its 5 ensemble members.
It ties with 3e-5 and 3e-4 on worst rank; mean rank, then mean NRMSE, then the order of the grid decided.
Not certain: when calib resamples its evidence (models, runs and windows of the log), 1e-4 wins in 70 % and 3e-4 in 30 %.
On held-out data (whole runs of 4 windows, 8 runs) it diverged. The best setting was 3e-4 (NRMSE 0.42).
The default (1e-3) would have diverged.
Log replay's choice (3e-4) would have had a regret of 1 %.
The choice of the log's latest window is the same setting.
For scale: choosing by one other window of the held-out period would have cost 3 %, the best fixed setting 1 % and a random setting 120 % on average.
The ranking of all settings contradicts the one on held-out data (Spearman -0.40, Kendall 0.83). The choice is not among the 3 best there.
");
}

#[test]
fn a_default_that_is_better_is_kept() {
    let mut verdict = Verdict { grade: Grade::Poor, ..verdict() };
    let online = verdict.online.as_mut().unwrap();
    online.against_default = Some(estimate(1.1, 1.05, 1.2));
    assert_eq!(
        verdict.headline(),
        "Keep the default, learning_rate = 1e-3, for PIT300: 1e-4 is worse."
    );
    let reasons = verdict.reasons().join("\n");
    assert!(
        reasons.contains("10 % more error than the default, 1e-3 (95 %: 5 % to 20 % more)."),
        "{reasons}"
    );
}

#[test]
fn nothing_learnt_is_said() {
    let mut verdict = Verdict { grade: Grade::NotLearnt, ..verdict() };
    let online = verdict.online.as_mut().unwrap();
    (online.chosen_skill, online.best_skill) = (Some(-0.1), Some(-0.02));
    assert_eq!(
        verdict.headline(),
        "PIT300 hardly varies in the held-out windows, and no setting of learning_rate predicts it better than their own means \
         would: nothing to deploy on this evidence."
    );
    assert!(verdict.plain().contains("livelier data"), "{}", verdict.plain());
    let mut worse = verdict.clone();
    worse.online.as_mut().unwrap().best_error = 1.1;
    assert_eq!(
        worse.headline(),
        "No setting of learning_rate learns PIT300: do not deploy on this evidence."
    );
    let reasons = verdict.reasons().join("\n");
    assert!(
        reasons.contains("no better than the mean return of each window, which is only known afterwards. The best setting's is -0.02."),
        "{reasons}"
    );
}

#[test]
fn everything_diverged() {
    let mut verdict = Verdict { grade: Grade::Poor, ..verdict() };
    let online = verdict.online.as_mut().unwrap();
    (online.regret, online.spearman, online.top_k) = (None, None, None);
    (online.against_default, online.chosen_skill) = (None, None);
    verdict.alternatives = vec![Alternative {
        baseline: ChoiceBaseline::LogReplay,
        value: Some(Setting::from(1e-4)),
        regret: None,
    }];
    insta::assert_snapshot!(text(&verdict), @r"
No setting of learning_rate can be deployed for PIT300: every one diverged.
kNN never ranks it below 2nd of 9 settings in its 5 ensemble members.
It ties with 3e-5 and 3e-4 on worst rank; mean rank, then mean NRMSE, then the order of the grid decided.
Not certain: when calib resamples its evidence (models, runs and windows of the log), 1e-4 wins in 70 % and 3e-4 in 30 %.
On held-out data (whole runs of 4 windows, 8 runs) every setting diverged, so there is no best one.
");
}

#[test]
fn one_window_cannot_be_compared() {
    let mut verdict = Verdict { grade: Grade::Fair, ..verdict() };
    verdict.online.as_mut().unwrap().windows = 1;
    verdict
        .alternatives
        .retain(|alternative| alternative.baseline != ChoiceBaseline::AnotherWindow);
    let reasons = verdict.reasons().join("\n");
    assert!(reasons.contains("cannot be judged: only one window was held out."), "{reasons}");
}

#[test]
fn ordinals() {
    assert_eq!(
        [1, 2, 3, 4, 11, 12, 13, 21, 112].map(ordinal).join(" "),
        "1st 2nd 3rd 4th 11th 12th 13th 21st 112th"
    );
}

#[test]
fn a_choice_that_did_not_learn_is_named_and_not_explained() {
    let mut verdict = Verdict { grade: Grade::NotLearnt, ..verdict() };
    let online = verdict.online.as_mut().unwrap();
    (online.chosen_error, online.best_error) = (0.95, 0.9);
    (online.chosen_skill, online.best_skill) = (Some(-0.1), Some(-0.02));
    insta::assert_snapshot!(text(&verdict), @r"
No setting of learning_rate learns PIT300: do not deploy on this evidence.
The choice of kNN is learning_rate = 1e-4.
On held-out data (whole runs of 4 windows, 8 runs) its regret is 2.5 % (95 %: at most 5 %). The best setting over all windows is 3e-4 (NRMSE 0.9 against 0.95).
Its skill is -0.10: it predicts no better than the mean return of each window, which is only known afterwards. The best setting's is -0.02. NRMSE divides by the spread of returns in the training range.
");
}

#[test]
fn a_choice_without_skill_is_not_recommended() {
    let mut verdict = Verdict { grade: Grade::Poor, ..verdict() };
    let online = verdict.online.as_mut().unwrap();
    (online.chosen_skill, online.best_skill) = (Some(-0.17), Some(0.02));
    assert_eq!(
        verdict.headline(),
        "Do not deploy learning_rate = 1e-4 for PIT300 on this evidence."
    );
    insta::assert_snapshot!(verdict.plain(), @"On held-out data it predicts no better than the mean return; the best setting, 3e-4, has 2 % less error than that. Keeping the default, 1e-3, would have cost 28 %.");
}

#[test]
fn errors_that_are_all_alike_praise_no_value() {
    let mut verdict = Verdict { grade: Grade::Unchecked, ..verdict() };
    let online = verdict.online.as_mut().unwrap();
    online.values = Separation::Alike;
    online.regret = Some(Bounded { value: 0.0, upper: None });
    insta::assert_snapshot!(text(&verdict), @r"
Use learning_rate = 1e-4 for PIT300, on the evidence of the log.
kNN never ranks it below 2nd of 9 settings in its 5 ensemble members.
It ties with 3e-5 and 3e-4 on worst rank; mean rank, then mean NRMSE, then the order of the grid decided.
Not certain: when calib resamples its evidence (models, runs and windows of the log), 1e-4 wins in 70 % and 3e-4 in 30 %.
On held-out data (whole runs of 4 windows, 8 runs) all 9 settings have the same error (NRMSE 0.423), so it shows no difference between them.
Its skill is 0.55: 55 % less error than the mean return of each window, which is only known afterwards. The best setting's is 0.57. NRMSE divides by the spread of returns in the training range.
");
    assert_eq!(verdict.badge(), "Not checked: no clear difference on held-out data");
    verdict.evidence = Separation::Alike;
    insta::assert_snapshot!(text(&verdict), @r"
No clear difference for PIT300: all settings of learning_rate did alike.
Nothing was chosen: all 9 settings did alike in every run that counts, and 1e-4 stands for any of them.
On held-out data (whole runs of 4 windows, 8 runs) all 9 settings have the same error (NRMSE 0.423), so it shows no difference between them.
Its skill is 0.55: 55 % less error than the mean return of each window, which is only known afterwards. The best setting's is 0.57. NRMSE divides by the spread of returns in the training range.
");
    assert_eq!(verdict.badge(), "No clear difference: all settings did alike");
}

#[test]
fn a_sensor_that_stands_still_checks_nothing() {
    let mut verdict = Verdict { grade: Grade::Unchecked, ..verdict() };
    verdict.online.as_mut().unwrap().stands_still = true;
    insta::assert_snapshot!(text(&verdict).lines().chain([verdict.plain().as_str()]).collect::<Vec<_>>().join("\n"), @"
    PIT300 never changes in the held-out data, so the choice could not be checked. The log suggests learning_rate = 1e-4.
    kNN never ranks it below 2nd of 9 settings in its 5 ensemble members.
    It ties with 3e-5 and 3e-4 on worst rank; mean rank, then mean NRMSE, then the order of the grid decided.
    Not certain: when calib resamples its evidence (models, runs and windows of the log), 1e-4 wins in 70 % and 3e-4 in 30 %.
    On held-out data (whole runs of 4 windows, 8 runs) PIT300 is constant: there is nothing to predict, and errors say nothing.
    It is constant in the held-out period, so there was nothing to predict, and the choice is not checked. Hold out a period in which it changes.
    ");
}

#[test]
fn one_value_is_no_choice() {
    let verdict = Verdict { values: 1, worst_rank: 1, ..verdict() };
    let reasons = verdict.reasons().join("\n");
    assert!(
        reasons.starts_with("There is no other setting to choose from.\nOn held-out"),
        "{reasons}"
    );
    assert!(!reasons.contains("best of"), "{reasons}");
}

#[test]
fn values_next_to_the_choice_count_as_the_same_in_a_second_share() {
    let told = Verdict { stability_nearby: Some(0.95), ..verdict() }.stability_sentence().unwrap();
    assert!(told.ends_with("3e-4 in 30 %. It or a setting next to it wins in 95 %."), "{told}");
}

#[test]
fn a_share_below_all_is_not_called_all() {
    let stability = vec![(Setting::from(1e-4), 0.9995), (Setting::from(1e-2), 0.0005)];
    let told = Verdict { stability, ..verdict() }.stability_sentence().unwrap();
    assert!(told.contains("1e-4 wins nearly always and 0.01 in <0.1 %."), "{told}");
}

#[test]
fn several_fields_are_named_once() {
    let verdict = Verdict {
        field: "gamma, learning_rate".to_owned(),
        chosen: Setting::from("gamma = 0.8, learning_rate = 0.1"),
        ..verdict()
    };
    assert_eq!(verdict.headline(), "Use gamma = 0.8, learning_rate = 0.1 for PIT300.");
    let mut not_learnt = Verdict { grade: Grade::NotLearnt, ..verdict };
    not_learnt.online.as_mut().unwrap().best_error = 0.9;
    assert!(
        not_learnt.headline().starts_with("No setting of gamma and learning_rate learns PIT300")
    );
}

#[test]
fn streams_of_a_log_that_was_not_replayed_are_not_told() {
    let reason = Reason::Pooled { streams: 10, sources: Sources::Members };
    let told = Verdict { reason, ..verdict() }.reason_sentence();
    assert_eq!(
        told,
        "Chosen for the smallest error, as a geometric mean over 10 training runs in kNN."
    );
}

fn simple_row(predictor: SimplePredictor, error: f64) -> SimpleRow {
    SimpleRow { predictor, error, typical_error: None, ratio: None }
}

/// Persistence has half of the agent's error.
fn beaten(is_better: bool) -> Verdict {
    let ratio = if is_better { estimate(2.0, 1.8, 2.2) } else { estimate(0.99, 0.9, 1.1) };
    Verdict {
        grade: Grade::Simpler,
        simple: vec![
            simple_row(SimplePredictor::Mean, 1.02),
            simple_row(SimplePredictor::Persistence, 0.21),
            simple_row(SimplePredictor::Ridge, 0.3),
        ],
        simpler: Some(Simpler {
            predictor: SimplePredictor::Persistence,
            ratio: Some(ratio),
            is_better,
            typical_errors: Some(if is_better { [1.3, 2.6] } else { [2.63, 2.6] }),
            runaway_windows: 0,
            has_baseline: false,
            starts_from: None,
        }),
        ..verdict()
    }
}

#[test]
fn a_simple_predictor_that_is_better_is_recommended_instead() {
    let verdict = beaten(true);
    insta::assert_snapshot!(verdict.headline(), @"Use persistence for PIT300, not an agent: it has 50 % less error.");
    insta::assert_snapshot!(verdict.plain(), @r#"On held-out data persistence has 50 % less error than the chosen agent (95 %: 44 % to 55 % less). Typical error of the predicted mean, in the sensor's unit: persistence 1.3, the agent 2.6. To improve on it, let the agent start from it: agent.baseline = "persistence"."#);
    insta::assert_snapshot!(verdict.simple_sentence().unwrap(), @"NRMSE of simple predictors on the same windows: the training mean 1.02, persistence 0.21 and ridge regression 0.3. The agent: 0.423.");
    assert_eq!(verdict.badge(), "Simpler is better: no agent needed");
}

#[test]
fn without_held_out_data_the_log_is_named_as_the_evidence() {
    let mut verdict = Verdict { online: None, agent_on_log: Some(0.42), ..beaten(true) };
    verdict.simpler.as_mut().unwrap().typical_errors = None;
    insta::assert_snapshot!(verdict.headline(), @"Use persistence for PIT300, not an agent, on the evidence of the log: it has 50 % less error.");
    insta::assert_snapshot!(verdict.plain(), @r#"On windows of the log persistence has 50 % less error than the chosen agent (95 %: 44 % to 55 % less). No data was held out, so this is the evidence of the log. To improve on it, let the agent start from it: agent.baseline = "persistence"."#);
    assert_eq!(verdict.badge(), "Simpler is better on the log: no agent needed");
    assert_eq!(verdict.advice(), "use persistence");
    let reasons = verdict.reasons();
    insta::assert_snapshot!(reasons[reasons.len() - 2..].join("\n"), @r"
    No data was held out, so regret and agreement with the held-out period are unknown.
    NRMSE of simple predictors on windows of the log, as geometric means: the training mean 1.02, persistence 0.21 and ridge regression 0.3. The agent: 0.42.
    ");
    let simpler = verdict.simpler.as_mut().unwrap();
    (simpler.is_better, simpler.ratio) = (false, Some(estimate(0.9, 0.7, 1.1)));
    insta::assert_snapshot!(verdict.headline(), @"Use persistence for PIT300 for now, on the evidence of the log: an agent may do better, but it is not shown.");
    assert!(verdict.plain().contains("Held-out data would decide"), "{}", verdict.plain());
    verdict.grade = Grade::NotLearnt;
    insta::assert_snapshot!(verdict.headline(), @"Do not deploy an agent for PIT300: at this horizon, nothing is shown on the log to predict it better than its training mean.");
    assert!(verdict.plain().starts_with("On windows of the log neither it nor"));
    assert_eq!(verdict.badge(), "Not learned: nothing beats a mean on the log");
}

#[test]
fn where_the_held_out_data_is_constant_the_log_is_named_as_the_evidence() {
    let mut verdict = Verdict { agent_on_log: Some(0.42), ..beaten(true) };
    verdict.online.as_mut().unwrap().stands_still = true;
    assert!(verdict.headline().contains("on the evidence of the log"), "{}", verdict.headline());
    assert!(verdict.plain().contains("do not vary in the held-out data"), "{}", verdict.plain());
    assert_eq!(verdict.badge(), "Simpler is better on the log: no agent needed");
    let reasons = verdict.reasons();
    assert!(reasons.last().unwrap().contains("windows of the log"), "{reasons:?}");
}

#[test]
fn an_agent_that_is_not_shown_to_be_better_is_not_recommended() {
    let verdict = beaten(false);
    insta::assert_snapshot!(verdict.headline(), @"Use persistence for PIT300: no agent is shown to do better.");
    insta::assert_snapshot!(verdict.plain(), @r#"On held-out data persistence has 1 % more error than the chosen agent, which could be chance (95 %: 9.1 % less to 11 % more). Typical error of the predicted mean, in the sensor's unit: persistence 2.63, the agent 2.6. To improve on it, let the agent start from it: agent.baseline = "persistence"."#);
}

#[test]
fn a_start_from_another_predictor_is_told() {
    let start = "The agent starts from a line on the sensor instead, which cross-validation in the training range prefers.";
    let mut verdict = beaten(false);
    assert!(!verdict.plain().contains("starts from"), "{}", verdict.plain());
    let simpler = verdict.simpler.as_mut().unwrap();
    (simpler.has_baseline, simpler.starts_from) = (true, Some(SimplePredictor::Line));
    assert!(verdict.plain().ends_with(start), "{}", verdict.plain());
    let matched = verdict.simpler.take();
    let deployed = Verdict { matched, grade: Grade::Good, ..verdict };
    assert!(deployed.plain().contains(start), "{}", deployed.plain());
}

#[test]
fn an_agent_that_is_deployed_stands_beside_the_simple_predictor_that_the_log_prefers() {
    let matched = Some(Simpler {
        predictor: SimplePredictor::Ridge,
        ratio: Some(estimate(0.9, 0.85, 0.96)),
        is_better: false,
        typical_errors: None,
        runaway_windows: 0,
        has_baseline: true,
        starts_from: None,
    });
    let told = Verdict { matched, ..verdict() }.plain();
    insta::assert_snapshot!(told, @"It has 10 % less error than ridge regression, the simple predictor that the log prefers (95 %: 4 % to 15 % less). On held-out data its predictions are 2.5 % worse than those of the best setting of each window. Keeping the default, 1e-3, would have cost 28 %.");
}

#[test]
fn a_default_that_learns_nothing_is_kept_where_learning_on_is_not_shown_to_help() {
    let mut verdict = Verdict { frozen: Some(SimplePredictor::Line), ..verdict() };
    let online = verdict.online.as_mut().unwrap();
    online.against_default = Some(estimate(0.999, 0.99, 1.01));
    insta::assert_snapshot!(verdict.headline(), @"Use a line on the sensor for PIT300: further learning adds nothing.");
    insta::assert_snapshot!(verdict.plain(), @"An agent that goes on learning, with learning_rate = 1e-4, is not shown to do better on held-out data: it has 0.1 % less error than the default (95 %: 1 % less to 1 % more). So keep the default, learning_rate = 1e-3.");
    assert_eq!(verdict.badge(), "Simpler is better: no agent needed");
    assert_eq!(verdict.advice(), "use a line on the sensor");
    // The error is much smaller, but there are too few windows.
    verdict.online.as_mut().unwrap().against_default = Some(estimate(0.85, 0.7, 1.03));
    insta::assert_snapshot!(verdict.headline(), @"Use a line on the sensor for PIT300 for now: further learning may help, but it is not shown.");
    assert_eq!(verdict.badge(), "Undecided: the agent may be better");
}

#[test]
fn few_windows_recommend_for_now_alone() {
    let mut verdict = verdict();
    verdict.online.as_mut().unwrap().windows = 3;
    insta::assert_snapshot!(verdict.headline(), @"Use learning_rate = 1e-4 for PIT300 for now: too few held-out windows to be sure.");
    assert_eq!(verdict.badge(), "Undecided: too few held-out windows to tell");
    verdict.frozen = Some(SimplePredictor::Line);
    verdict.online.as_mut().unwrap().against_default = None;
    insta::assert_snapshot!(verdict.headline(), @"Use a line on the sensor for PIT300 for now: too few held-out windows to tell whether further learning helps.");
    verdict.online.as_mut().unwrap().windows = 4;
    assert!(!verdict.headline().contains("for now"));
}

#[test]
fn a_gain_is_told_beside_the_best_simple_predictor_too() {
    let matched = Some(Simpler {
        predictor: SimplePredictor::Ridge,
        ratio: Some(estimate(0.5, 0.4, 0.6)),
        is_better: false,
        typical_errors: None,
        runaway_windows: 0,
        has_baseline: false,
        starts_from: None,
    });
    let mut verdict = Verdict { matched, ..verdict() };
    verdict.online.as_mut().unwrap().chosen_error = 0.6;
    verdict.simple =
        vec![simple_row(SimplePredictor::Ridge, 1.2), simple_row(SimplePredictor::Line, 0.8)];
    let told = verdict.plain();
    let beside = "The best simple predictor on these windows is a line on the sensor. The agent has 25 % less error than that.";
    assert!(told.contains(beside), "{told}");
    verdict.simple.swap(0, 1);
    verdict.simple[1].error = 0.7;
    assert!(!verdict.plain().contains("The best simple predictor"), "it is the same");
}

#[test]
fn an_agent_that_only_is_its_baseline_is_called_so() {
    let mut verdict = Verdict { frozen: Some(SimplePredictor::Ridge), ..verdict() };
    verdict.online.as_mut().unwrap().against_default = None;
    // The regret shows that another setting may be better.
    assert_eq!(
        verdict.headline(),
        "Use ridge regression for PIT300: no clear gain from further learning."
    );
    verdict.online.as_mut().unwrap().regret = Some(Bounded { value: 0.0, upper: None });
    assert_eq!(
        verdict.headline(),
        "Use ridge regression for PIT300: further learning adds nothing."
    );
}

#[test]
fn a_gain_of_a_choice_that_learns_nothing_is_none_by_learning() {
    let frozen = Some(SimplePredictor::Line);
    let mut verdict = Verdict { frozen, learns_nothing: true, ..verdict() };
    // The default learns: it may have less error, or it has more.
    for against in [estimate(1.03, 0.995, 1.07), estimate(0.9, 0.85, 0.95)] {
        verdict.online.as_mut().unwrap().against_default = Some(against);
        let headline = verdict.headline();
        assert_eq!(
            headline,
            "Use a line on the sensor for PIT300: no clear gain from further learning."
        );
        assert_eq!(verdict.badge(), "Simpler is better: no agent needed");
        let plain = verdict.plain();
        assert!(!plain.contains("goes on learning") && !plain.contains("keep"), "{plain}");
        assert!(plain.contains("Keeping the default, 1e-3, would have cost 28 %."), "{plain}");
    }
    verdict.online.as_mut().unwrap().regret = Some(Bounded { value: 0.0, upper: None });
    assert!(verdict.headline().ends_with("further learning adds nothing."));
}

#[test]
fn no_gain_is_claimed_where_the_interval_has_one() {
    let mut verdict = Verdict { frozen: Some(SimplePredictor::Line), ..verdict() };
    verdict.online.as_mut().unwrap().against_default = Some(estimate(0.985, 0.95, 1.02));
    insta::assert_snapshot!(verdict.headline(), @"Use a line on the sensor for PIT300: no clear gain from further learning.");
    verdict.online.as_mut().unwrap().against_default = None;
    verdict.simple =
        vec![SimpleRow { typical_error: Some(8.52), ..simple_row(SimplePredictor::Line, 0.4) }];
    let told = verdict.plain();
    assert!(
        told.ends_with(" Its typical error of the predicted mean, in the sensor's unit: 8.52."),
        "{told}"
    );
}

#[test]
fn a_predictor_that_is_hardly_better_is_simpler_alone() {
    let mut verdict = beaten(true);
    verdict.simpler.as_mut().unwrap().ratio = Some(estimate(1.001, 1.0005, 1.0015));
    insta::assert_snapshot!(verdict.headline(), @"Use persistence for PIT300: it does as well as the agent and is simpler.");
}

#[test]
fn windows_in_which_the_agent_ran_away_are_told() {
    let mut verdict = beaten(false);
    let simpler = verdict.simpler.as_mut().unwrap();
    simpler.ratio = Some(estimate(5.56, 0.018, 3000.0));
    simpler.typical_errors = Some([0.223, 84.7]);
    simpler.runaway_windows = 2;
    insta::assert_snapshot!(verdict.headline(), @"Use persistence for PIT300, not an agent: in 2 of 4 held-out windows the agent's error was more than ten times as large.");
    let told = verdict.plain();
    let means = " Typical error of the predicted mean, in the sensor's unit, as a mean over windows, which the worst of them decide: persistence 0.223, the agent 84.7.";
    assert!(told.contains(means), "{told}");
    // In all windows: the mean shows it already.
    verdict.simpler.as_mut().unwrap().runaway_windows = 4;
    assert!(!verdict.headline().contains("ten times"), "{}", verdict.headline());
}

/// Formats a regret of 20 % with this upper bound.
fn regret_up_to(upper: f64) -> String {
    with_interval(Bounded { value: 0.2, upper: Some(upper) })
}

#[test]
fn bounds_without_a_meaning_have_no_number() {
    assert_eq!(changed(2.71e19), "more than 1,000 times more");
    assert_eq!(regret_up_to(2.71e19), "20 % (95 %: perhaps more than 1,000 times)");
    assert_eq!(regret_up_to(180.0), "20 % (95 %: at most 180 times)");
}

fn told_between(low: f64, high: f64) -> String {
    between(Interval { low, high })
}

#[test]
fn large_bounds_are_factors() {
    assert_eq!(told_between(0.003, 55.98), "100 % less to 56 times as much");
    assert_eq!(told_between(1.2, 55.0), "20 % more to 55 times as much");
    assert_eq!(told_between(12.0, 55.0), "12 to 55 times as much");
    assert_eq!(told_between(0.9, 2.71e19), "10 % less to more than 1,000 times as much");
    assert_eq!(told_between(0.9, f64::INFINITY), "10 % less to divergence");
    assert_eq!(told_between(0.9, 9.0), "10 % less to 800 % more");
}

#[test]
fn means_that_disagree_about_the_better_one_are_told() {
    let mut verdict = beaten(true);
    let simpler = verdict.simpler.as_mut().unwrap();
    // The predictor has 1.9 % more error as a geometric mean, and less as a mean over windows.
    simpler.ratio = Some(estimate(0.981, 0.9, 1.1));
    simpler.typical_errors = Some([420.0, 425.0]);
    let told = verdict.plain();
    assert!(
        told.contains("which the worst of them decide: persistence 420, the agent 425."),
        "{told}"
    );
    verdict.simpler.as_mut().unwrap().typical_errors = Some([425.0, 420.0]);
    assert!(!verdict.plain().contains("the worst of them"), "{}", verdict.plain());
}

#[test]
fn what_is_not_shown_to_be_predictable_is_called_so() {
    let mut verdict = Verdict { grade: Grade::NotLearnt, ..beaten(true) };
    verdict.simpler = None;
    insta::assert_snapshot!(verdict.headline(), @"Do not deploy an agent for PIT300: at this horizon, nothing is shown to predict it better than its training mean.");
    let told = verdict.plain();
    assert!(told.contains(" The NRMSE of the training mean is 1.02."), "{told}");
    assert!(told.contains(" Deploy that mean, or nothing;"), "{told}");
}

#[test]
fn held_out_values_that_are_elsewhere_judge_no_agent() {
    let verdict = Verdict { grade: Grade::Poor, elsewhere: Some(422.6), ..verdict() };
    insta::assert_snapshot!(verdict.headline(), @"Do not deploy an agent for PIT300: held-out values are far from all that it was trained on.");
    let told = verdict.plain();
    assert!(
        told.starts_with("Held-out values lie 423 times the spread of the training range"),
        "{told}"
    );
    assert_eq!(verdict.badge(), "Poor: held-out values are far from the training range");
}
