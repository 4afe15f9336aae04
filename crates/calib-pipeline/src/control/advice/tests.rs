use calib_control::{
    ActionModelKind, BestConstant, KindMean, KindReturns, OutlyingMember, RandomActions,
    RecordedReturn, StepRates,
};
use calib_report::{Decision, Support};
use calib_stats::{Difference, Interval};
use serde_json::json;

use super::{summary::MOST_REASONS, *};

/// Returns a verdict that chooses setting 1. Setting 0 is the default.
fn verdict(doubts: &serde_json::Value) -> ReturnVerdict {
    let coverage = json!({ "steps": 100, "missing": 1, "far": 1 });
    let difference = json!({ "mean": 2.0, "interval": null, "clusters": [1, 1] });
    serde_json::from_value(json!({
        "rule": "mean_rank",
        "chosen": 1,
        "default": 0,
        "selection": {
            "chosen": 1, "tie_set": [1], "worst_ranks": [2, 1], "mean_ranks": [2.0, 1.0],
            "mean_errors": [1.0, 3.0], "ranks": [[2, 1]],
        },
        "kinds": [],
        "members": [],
        "over_default": difference,
        "over_random": difference,
        "chosen_of_resamples": [0, 10],
        "behaviour": { "mean": 1.0, "interval": null, "episodes": 4.0, "best": null, "worst": null },
        "coverage": [coverage, coverage],
        "drift": { "episodes": 0, "sums": [], "squares": [] },
        "doubts": doubts,
    }))
    .expect("a verdict")
}

/// Returns advice in the words of a study, on settings that have only names.
fn advice_on<'a>(verdict: &'a ReturnVerdict, settings: &'a [String]) -> Advice<'a> {
    Advice { verdict, settings, fields: &[], actions: &[], columns: &[], vocabulary: STUDY }
}

fn decision(doubts: &serde_json::Value, vocabulary: Vocabulary) -> Decision {
    let verdict = verdict(doubts);
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let actions = &["off".to_owned()];
    let columns = &["level".to_owned()];
    let advice = Advice { actions, columns, vocabulary, ..advice_on(&verdict, &settings) };
    assert_eq!(advice.reasons().len(), verdict.doubts.len());
    assert!(advice.findings().iter().any(|line| line.starts_with("Not covered by the log: 2")));
    advice.decision()
}

#[test]
fn a_setting_is_named_where_nothing_should_be_deployed() {
    let promise = json!({ "reason": "below_recorded", "promised": 3.0, "recorded": 4.0 });
    let alike = json!({ "reason": "not_better_than_default" });
    let ahead = decision(&json!([promise]), STUDY);
    assert_eq!(ahead.headline, "Deploy nothing on this evidence.");
    let named = "First by mean rank is a=2";
    assert!(ahead.plain.starts_with(&format!("{named}, and clearly ahead")), "{ahead:?}");
    assert!(
        ahead
            .plain
            .contains("If you have a trial in which nothing can be harmed, begin with this one."),
        "{ahead:?}"
    );
    let behind = decision(&json!([promise, alike]), STUDY);
    assert_eq!((behind.support, &behind.headline), (Support::Unsupported, &ahead.headline));
    assert!(behind.plain.starts_with(&format!("{named}. If you have a trial")), "{behind:?}");
    let arbitrary = decision(&json!([promise, { "reason": "not_told_apart" }]), STUDY);
    assert!(arbitrary.plain.starts_with("First by mean rank is a=2."), "{arbitrary:?}");
    let kept = decision(&json!([alike]), PYTHON);
    assert_eq!(
        (kept.support, kept.headline.as_str()),
        (Support::KeepDefault, "Keep the default: a=1.")
    );
    let supported = decision(&json!([]), PYTHON);
    assert_eq!(
        (supported.support, supported.headline.as_str()),
        (Support::Supported, "Deploy a=2.")
    );
}

#[test]
fn a_default_that_ranks_first_is_kept_without_a_doubt() {
    let verdict = ReturnVerdict { default: Some(1), ..verdict(&json!([])) };
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let advice = advice_on(&verdict, &settings);
    let kept = advice.decision();
    assert_eq!(
        (kept.support, kept.headline.as_str()),
        (Support::Supported, "Keep the default: a=2.")
    );
    assert!(verdict.is_supported() && advice.reasons().is_empty());
}

/// Returns the returns of four settings in one member of a kind.
fn of_kind(kind: ActionModelKind, returns: [f64; 4]) -> KindReturns {
    KindReturns { kind, chosen: 0, members: vec![returns.to_vec()] }
}

#[test]
fn no_setting_is_named_where_kinds_of_models_disagree() {
    let mut verdict = verdict(&json!([{ "reason": "few_terminals", "terminals": 1 }]));
    verdict.selection.mean_ranks = vec![2.0, 1.0, 3.0, 4.0];
    verdict.coverage = vec![verdict.coverage[0]; 4];
    verdict.kinds = vec![
        of_kind(ActionModelKind::Neighbors, [1.0, 2.0, 3.0, 4.0]),
        of_kind(ActionModelKind::Network, [4.0, 3.0, 2.0, 1.0]),
    ];
    let settings = ["a=1", "a=2", "a=3", "a=4"].map(str::to_owned);
    let advice = advice_on(&verdict, &settings);
    let plain = advice.decision().plain;
    assert!(
        plain.contains("disagree on the order of the settings (Spearman -1.00 on average)"),
        "{plain}"
    );
    let found = advice.findings();
    assert!(
        found
            .iter()
            .any(|line| line.ends_with("a Spearman correlation of -1.00; at 1 they are the same.")),
        "{found:?}"
    );
    verdict.kinds = vec![
        of_kind(ActionModelKind::Neighbors, [4.0; 4]),
        of_kind(ActionModelKind::Network, [3.0; 4]),
    ];
    let tied = advice_on(&verdict, &settings);
    let plain = tied.decision().plain;
    assert!(!plain.contains("disagree"), "{plain}");
    let found = tied.findings().join("\n");
    assert!(found.contains("All settings get the same in every model."), "{found}");
    assert!(!found.contains("Alone, ") && !found.contains("Spearman"), "{found}");
}

/// Returns the doubt about a choice that gets 14 more than random actions, in an interval from `low`.
fn beside_random(low: Option<f64>, outlying: Option<OutlyingMember>) -> String {
    let doubt =
        json!([{ "reason": "not_better_than_random_actions", "random": 24, "promised": 38 }]);
    let interval = low.map(|low| Interval { low, high: 40.0 });
    let mut verdict = verdict(&doubt);
    let over = verdict.over_default.map(|over| Difference { mean: 14.0, interval, ..over });
    verdict.random_actions = Some(RandomActions { mean_return: 24.0, over, outlying });
    let settings = ["a=1", "a=2"].map(str::to_owned);
    advice_on(&verdict, &settings).reasons().remove(0).whole()
}

#[test]
fn more_than_random_actions_get_is_told_with_its_interval() {
    let chance = beside_random(Some(-12.0), None);
    let told = "gets 38, learning included, which could be chance (95 % over blocks of the log: 12 less to 40 more); record";
    assert!(chance.contains(told), "{chance}");
    let more = "narrow the interval with more ensemble members (control.model.members)";
    assert!(chance.ends_with(more), "{chance}");
    let network =
        OutlyingMember { kind: ActionModelKind::Network, member: 2, chosen_return: -501.0 };
    let one = beside_random(Some(-12.0), Some(network));
    let named = "40 more): without the network of ensemble member 2, in which it gets -501, the interval would exclude 0; make more runs (control.runs)";
    assert!(one.contains(named) && !one.contains("varied actions"), "{one}");
    let alone = beside_random(None, None);
    assert!(alone.contains("that it learns anything of use is not shown; record"), "{alone}");
}

/// Returns the findings over this many blocks of the log.
fn found_in_blocks(blocks: usize) -> Vec<String> {
    let mut verdict = verdict(&json!([]));
    verdict.members = vec![vec![1.0, 3.0]; blocks];
    let interval = Some(Interval { low: 0.5, high: 1.5 });
    verdict.ranks_over_default =
        verdict.over_default.map(|over| Difference { mean: 1.0, interval, ..over });
    let settings = ["a=1", "a=2"].map(str::to_owned);
    advice_on(&verdict, &settings).findings()
}

#[test]
fn ranks_and_few_blocks_are_told_once() {
    let few = found_in_blocks(3);
    let ranks =
        "Ahead of the default by 1 in mean rank, over blocks of the log (95 %: 0.5 to 1.5).";
    assert!(few.iter().any(|line| line == ranks), "{few:?}");
    let weak = "Intervals over 3 blocks of the log are weak: use 4 ensemble members or more (control.model.members).";
    assert_eq!(few.iter().filter(|line| *line == weak).count(), 1, "{few:?}");
    let one = found_in_blocks(1).join("\n");
    assert!(one.contains("One ensemble member gives no interval: use 4"), "{one}");
    let enough = found_in_blocks(4).join("\n");
    assert!(!enough.contains("ensemble member"), "{enough}");
}

#[test]
fn one_setting_is_not_compared_with_a_random_one() {
    let verdict = ReturnVerdict { chosen: 0, ..verdict(&json!([])) };
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let [one, both] = [&settings[..1], &settings[..]]
        .map(|settings| advice_on(&verdict, settings).findings().join("\n"));
    assert!(!one.contains("Over a random setting"), "{one}");
    assert!(both.contains("Over a random setting"), "{both}");
}

/// Returns the sentence on recorded episodes with these returns.
fn told_of_record(mean: f64, best: Option<f64>, worst: Option<f64>) -> String {
    let mut verdict = verdict(&json!([]));
    verdict.behaviour = RecordedReturn { mean, best, worst, ..verdict.behaviour };
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let found = advice_on(&verdict, &settings).findings();
    found.into_iter().find(|line| line.starts_with("Recorded episodes: ")).expect("a line")
}

#[test]
fn a_recorded_mean_beyond_every_whole_episode_has_its_reason() {
    let above = told_of_record(120.0, Some(110.0), Some(20.0));
    assert!(above.starts_with("Recorded episodes: mean return 120, at most 110."), "{above}");
    assert!(above.contains("beyond every whole episode, because it counts parts"), "{above}");
    let below = told_of_record(-120.0, Some(-20.0), Some(-110.0));
    assert!(below.contains("beyond every whole episode, because it counts parts"), "{below}");
    let within = told_of_record(90.0, Some(110.0), Some(20.0));
    assert_eq!(within, "Recorded episodes: mean return 90, at most 110.");
    let alike = told_of_record(110.000_000_1, Some(110.0), Some(110.0));
    assert!(alike.ends_with("at most 110."), "a rounding: {alike}");
    assert!(told_of_record(5.0, None, None).ends_with("mean return 5."));
}

/// Returns the note on the ends of a grid of these settings, of which number 1 is chosen.
fn told_of_ends(settings: [&[(&str, &str)]; 4], doubts: &serde_json::Value) -> Vec<String> {
    let mut verdict = verdict(doubts);
    verdict.coverage = vec![verdict.coverage[0]; 4];
    let fields = settings.map(|fields| -> Vec<(String, String)> {
        fields.iter().map(|&(field, value)| (field.to_owned(), value.to_owned())).collect()
    });
    let names = ["a", "b", "c", "d"].map(str::to_owned);
    let advice = Advice { fields: &fields, ..advice_on(&verdict, &names) };
    let mut found = advice.findings();
    found.retain(|line| line.starts_with("At the end of the grid"));
    found
}

#[test]
fn a_choice_at_the_end_of_the_grid_is_told() {
    let none = json!([]);
    let sizes = ["0.003", "0.3", "0.03", "0.03"].map(|value| [("step_size", value)]);
    let told = told_of_ends(sizes.each_ref().map(|fields| &fields[..]), &none);
    let expected =
        "At the end of the grid: step_size=0.3 (largest). Settings beyond may be better.";
    assert_eq!(told, [expected]);
    let alike = json!([{ "reason": "not_told_apart" }]);
    let told = told_of_ends(sizes.each_ref().map(|fields| &fields[..]), &alike);
    assert!(told.is_empty(), "which is chosen is chance: {told:?}");
    // A setting of another algorithm has no temperature.
    let smallest: [&[(&str, &str)]; 4] = [
        &[("algorithm", "q_learning")],
        &[("temperature", "1e-1"), ("step_size", "3")],
        &[("temperature", "1"), ("step_size", "2")],
        &[("temperature", "10"), ("step_size", "1")],
    ];
    let told = told_of_ends(smallest, &none);
    let expected = "At the end of the grid: temperature=1e-1 (smallest) and step_size=3 (largest). Settings beyond may be better.";
    assert_eq!(told, [expected]);
    for values in [
        // In turn: a middle value, one of two numbers, a value with nothing beyond it, and values
        // that are not numbers.
        ["0.003", "0.01", "0.03", "0.3"],
        ["0.1", "0.3", "0.1", "0.3"],
        ["8", "0", "16", "4"],
        ["small", "2", "1", "3"],
    ] {
        let fields = values.map(|value| [("weight", value)]);
        let told = told_of_ends(fields.each_ref().map(|fields| &fields[..]), &none);
        assert!(told.is_empty(), "{told:?}");
    }
    let discounts = ["0.9", "1", "0.99", "0.5"].map(|value| [("gamma", value)]);
    assert!(told_of_ends(discounts.each_ref().map(|fields| &fields[..]), &none).is_empty());
}

#[test]
fn arguments_have_the_names_of_the_language() {
    let verdict = verdict(&json!([{ "reason": "few_terminals", "terminals": 1 }]));
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let [study, python] = [STUDY, PYTHON].map(|vocabulary| {
        Advice { vocabulary, ..advice_on(&verdict, &settings) }.reasons().remove(0).whole()
    });
    assert!(study.ends_with("with control.fewest_terminals"), "{study}");
    assert!(python.ends_with("with fewest_terminals"), "{python}");
}

#[test]
fn the_first_screen_has_the_number_and_the_strongest_reasons() {
    let doubts = json!([
        { "reason": "few_terminals", "terminals": 1 },
        { "reason": "above_recorded", "promised": 3.0, "best": 2.0 },
        { "reason": "uncovered", "share": 0.9 },
        { "reason": "not_better_than_default" },
        { "reason": "below_recorded", "promised": 3.0, "recorded": 4.0 },
    ]);
    let mut verdict = verdict(&doubts);
    let interval = Some(Interval { low: -1.0, high: 5.0 });
    verdict.over_default = verdict.over_default.map(|over| Difference { interval, ..over });
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let advice = advice_on(&verdict, &settings);
    let shown = advice.summary();
    assert_eq!(shown.len(), 2 + MOST_REASONS, "{shown:?}");
    assert_eq!(shown[0], "Deploy nothing on this evidence.");
    let number = "a=2 is first by mean rank: 2 more per episode than the default in the models (95 % over blocks of the log: 1 less to 5 more).";
    assert_eq!(shown[1], number);
    let parts = ["the recorded behaviour got 4", "has no such action", "no clear difference"];
    for (line, part) in shown[2..].iter().zip(parts) {
        assert!(line.contains(part) && !line.contains(';'), "{shown:?}");
    }
    let all = advice.why();
    assert_eq!(all[..2], shown[..2]);
    let reasons: Vec<String> = advice.reasons().iter().map(Reason::whole).collect();
    assert_eq!(all[3..3 + reasons.len()], reasons[..], "after what the headline means");
    assert_eq!(all[3 + reasons.len()..], advice.findings()[..]);
    // Without another default the choice is compared with the recorded returns.
    for default in [None, Some(1)] {
        let alone = ReturnVerdict { default, ..verdict.clone() };
        let shown = advice_on(&alone, &settings).summary();
        let number =
            "a=2 is first by mean rank: 3 per episode in the models, and recorded episodes got 1.";
        assert_eq!(shown[1], number);
    }
}

#[test]
fn the_first_screen_says_that_ranks_decide() {
    let mut verdict = verdict(&json!([]));
    let over = verdict.over_default.expect("a default");
    let lead = Difference { mean: 1.0, interval: Some(Interval { low: 0.5, high: 1.5 }), ..over };
    verdict.ranks_over_default = Some(lead);
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let ranks = "; clearly ahead of it in mean rank, by 1 (95 %: 0.5 to 1.5).";
    for (low, is_told) in [(-1.0, true), (0.5, false)] {
        verdict.over_default =
            Some(Difference { interval: Some(Interval { low, high: 5.0 }), ..over });
        let shown = advice_on(&verdict, &settings).summary();
        assert_eq!(shown[0], "Deploy a=2.");
        assert_eq!(shown[1].ends_with(ranks), is_told, "{shown:?}");
    }
}

#[test]
fn a_period_that_the_log_does_not_cover_is_named() {
    let verdict = verdict(&json!([
        { "reason": "held_out_uncovered", "deployment": "july", "share": 0.75 },
        { "reason": "held_out_uncovered", "share": 0.8 },
        { "reason": "few_terminals", "terminals": 1 },
    ]));
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let advice = advice_on(&verdict, &settings);
    assert_eq!(advice.decision().headline, "Deploy nothing on this evidence.");
    let told: Vec<String> = advice.reasons().iter().map(Reason::whole).collect();
    let july = "75 % of the decisions of the deployment july were made in states";
    assert!(told[0].starts_with(july), "{told:?}");
    let remedy = "let data.train have such states, or allow more with control.most_uncovered";
    assert!(told[0].ends_with(remedy), "{told:?}");
    assert!(told[1].starts_with("80 % of the decisions of the held-out period were"), "{told:?}");
    assert!(told[1].contains("let data.train or data.train_fraction have such"), "{told:?}");
    assert!(told[2].starts_with("only 1 episode ends in a terminal"), "{told:?}");
}

#[test]
fn one_member_supports_nothing() {
    let verdict = verdict(&json!([{ "reason": "one_member" }]));
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let advice = advice_on(&verdict, &settings);
    assert_eq!(advice.decision().headline, "Deploy nothing on this evidence.");
    let reason = advice.reasons().remove(0).whole();
    assert!(reason.ends_with("use 4 ensemble members or more (control.model.members)"), "{reason}");
}

/// Returns all reasons of a verdict without a default.
fn why_without_default(doubts: &serde_json::Value, vocabulary: Vocabulary) -> String {
    let verdict = ReturnVerdict { default: None, over_default: None, ..verdict(doubts) };
    let settings = ["a=1", "a=2"].map(str::to_owned);
    Advice { vocabulary, ..advice_on(&verdict, &settings) }.why().join("\n")
}

#[test]
fn a_default_that_failed_is_not_said_to_be_missing() {
    let failed = json!([{ "reason": "default_failed" }]);
    let python = why_without_default(&failed, PYTHON);
    assert!(python.contains("the default was tried, and failed, so that"), "{python}");
    assert!(!python.contains("No default was compared") && !python.contains("grid"), "{python}");
    let program = why_without_default(&failed, PROGRAM);
    assert!(program.contains("the program failed with the default, so that"), "{program}");
    let none = json!([]);
    assert!(why_without_default(&none, PYTHON).contains("No default was compared."));
    assert!(why_without_default(&none, STUDY).contains("The default is not in the grid."));
}

/// Returns all reasons where a constant action gets 1 more, in an interval up to `high`.
fn why_of_constant(high: Option<f64>) -> String {
    let doubt =
        json!([{ "reason": "worse_than_constant", "action": 0, "constant": 4, "promised": 3 }]);
    let mut verdict = verdict(&doubt);
    let interval = high.map(|high| Interval { low: -3.0, high });
    verdict.members = vec![vec![1.0, 3.0]; if high.is_some() { 5 } else { 1 }];
    let kinds = [(ActionModelKind::Neighbors, 132.0), (ActionModelKind::Increments, 10.0)];
    verdict.constant = Some(BestConstant {
        action: 0,
        mean_return: 71.0,
        uncovered: 0.0,
        over: verdict.over_default.map(|over| Difference { mean: -1.0, interval, ..over }),
        kinds: kinds.map(|(kind, mean_return)| KindMean { kind, mean_return }).to_vec(),
    });
    let (settings, actions) = (["a=1", "a=2"].map(str::to_owned), ["off".to_owned()]);
    let advice = Advice { actions: &actions, ..advice_on(&verdict, &settings) };
    assert_eq!(advice.decision().support, Support::Unsupported);
    advice.why().join("\n")
}

#[test]
fn a_constant_action_is_told_with_its_kinds_and_whether_it_could_be_chance() {
    let chance = why_of_constant(Some(1.0));
    let kinds = "always off gets 71 in the model (132 in neighbors and 10 in increments)";
    assert!(chance.contains(kinds), "{chance}");
    let could = "gets 3, learning included, which could be chance (95 % over blocks of the log: 3 less to 1 more); try that action first";
    assert!(chance.contains(could), "{chance}");
    let beside = "The chosen setting gets 1 less than the action that is best in the other ensemble members (95 %";
    assert!(chance.contains(beside), "{chance}");
    let sure = why_of_constant(Some(-0.5));
    assert!(sure.contains("learning included; take that action"), "{sure}");
    let alone = why_of_constant(None);
    assert!(alone.contains("which could be chance; try that action first"), "{alone}");
    assert!(alone.contains("The chosen setting gets 1 less than that."), "{alone}");
}

#[test]
fn a_choice_that_ends_its_episodes_early_is_deployed_with_a_warning() {
    let settings = ["a=1", "a=2"].map(str::to_owned);
    let rates = StepRates {
        terminals_in_model: 0.092,
        terminals_in_log: 0.0085,
        reward_in_model: -0.75,
        reward_in_log: -0.4,
    };
    let supported = ReturnVerdict { step_rates: Some(rates), ..verdict(&json!([])) };
    let advice = advice_on(&supported, &settings);
    let warning = advice.early_ends().expect("a warning");
    assert!(
        warning.starts_with(
            "Its episodes in the models end in a terminal 11 times as often as the recorded ones \
             (in 9.2 % of the steps, recorded 0.9 %), and its steps get less reward (-0.75, recorded -0.4)."
        ),
        "{warning}"
    );
    assert_eq!(advice.decision().headline, "Deploy a=2, unless a terminal is a failure.");
    assert_eq!(advice.summary().last(), Some(&warning));
    assert!(advice.findings().contains(&warning));

    let doubt = json!([{ "reason": "not_better_than_default" }]);
    let refused = ReturnVerdict { step_rates: Some(rates), ..verdict(&doubt) };
    assert!(!advice_on(&refused, &settings).summary().contains(&warning), "reasons come first");

    let calm = StepRates { terminals_in_model: 0.012, ..rates };
    let calm = ReturnVerdict { step_rates: Some(calm), ..verdict(&json!([])) };
    let found = advice_on(&calm, &settings).findings();
    let told = "A terminal ends the episode in 1.2 % of its steps in the models, and in 0.9 % of the recorded ones.";
    assert!(found.iter().any(|line| line == told), "{found:?}");
}
