use calib_stats::Interval;

use super::{evidence::displaced, *};
use crate::{Ending, recorded::tests::log};

fn run(member: usize, candidate: usize, mean_return: f64) -> Run {
    let coverage = Coverage { steps: 100, missing: 0, far: 10 };
    let episodes = 10;
    let terminals = 10;
    let curve = Vec::new();
    let drift = Drift::default();
    let kind = ActionModelKind::Neighbors;
    Run {
        kind,
        member,
        run: 0,
        candidate,
        mean_return,
        episodes,
        terminals,
        coverage,
        curve,
        drift,
    }
}

/// Returns a log of twenty episodes with returns of −8 to −12, −10 on average, and one terminal in ten steps.
fn plain() -> Decisions {
    let lengths = [8, 9, 10, 11, 12].into_iter().cycle().take(20);
    log(&lengths.map(|steps| (steps, Ending::Terminal)).collect::<Vec<_>>())
}

fn runs(returns: &[[f64; 3]]) -> Vec<Run> {
    returns
        .iter()
        .enumerate()
        .flat_map(|(member, returns)| {
            let returns = *returns;
            (0..3).map(move |candidate| run(member, candidate, returns[candidate]))
        })
        .collect()
}

/// Returns a question about three settings, the first of which is the default.
fn question(log: &Decisions) -> Question<'_> {
    Question { default: Some(0), rule: RankRule::WorstRank, ..Question::new(log, 500, 3) }
}

fn judged_of(log: &Decisions, runs: &[Run], support: Support) -> ReturnVerdict {
    let question = Question { support, resamples: 200, ..question(log) };
    judge(runs, &question, Seed::new(1)).expect("judged")
}

fn judged(returns: &[[f64; 3]], support: Support) -> ReturnVerdict {
    judged_of(&plain(), &runs(returns), support)
}

/// Setting 1 is better than the default, setting 0, and within the recorded returns.
const GOOD: [[f64; 3]; 3] = [[-15.0, -9.0, -12.0], [-15.5, -11.0, -10.0], [-14.0, -8.0, -12.0]];

#[test]
fn the_highest_return_is_the_best_rank() {
    let verdict = judged(&GOOD, Support::default());
    assert_eq!(verdict.chosen, 1);
    assert_eq!(verdict.selection.worst_ranks, [3, 2, 2]);
    assert_eq!(verdict.doubts, []);
    assert!((verdict.behaviour.mean + 10.0).abs() < 1e-9 && verdict.behaviour.best == Some(-8.0));
    assert_eq!(verdict.chosen_of_resamples.iter().sum::<usize>(), 200);
    assert!(verdict.chosen_of_resamples[1] > 100 && verdict.chosen_of_resamples[0] == 0);
    assert_eq!(verdict.coverage[2], Coverage { steps: 300, missing: 0, far: 30 });
}

#[test]
fn intervals_over_members_are_the_jackknifes() {
    let over = judged(&GOOD, Support::default()).over_default.expect("a default");
    // The differences are 6, 4.5 and 6 around 5.5: √(2/3 · 1.5) = 1, t(2) = 4.302652730.
    let interval = over.interval.expect("three members");
    assert!((over.mean - 5.5).abs() < 1e-12);
    assert!((interval.low - 5.5 + 4.302_652_73).abs() < 1e-7, "{interval:?}");
    assert_eq!((over.clusters, over.smaller), ([3, 3], Some([0, 3])));
}

fn runs_of_kind(kind: ActionModelKind, returns: &[[f64; 3]]) -> Vec<Run> {
    runs(returns).into_iter().map(|run| Run { kind, ..run }).collect()
}

#[test]
fn kinds_are_pooled_by_rank_and_members_of_one_block_stay_together() {
    // Neighbours cannot distinguish settings 1 and 2, networks prefer 2 by far, and increments prefer it slightly.
    let neighbors = [[-15.0, -9.0, -9.0], [-15.0, -9.0, -9.0], [-15.0, -9.0, -9.0]];
    let increments = [[-9.5, -9.1, -9.0], [-9.5, -9.1, -9.0], [-9.5, -9.0, -9.1]];
    let networks = [[-60.0, -50.0, -8.0]; 3];
    let all = [
        runs_of_kind(ActionModelKind::Network, &networks),
        runs_of_kind(ActionModelKind::Neighbors, &neighbors),
        runs_of_kind(ActionModelKind::Increments, &increments),
    ];
    let log = plain();
    let question = Question { rule: RankRule::MeanRank, ..question(&log) };
    let verdict = judge(&all.concat(), &question, Seed::new(1)).expect("judged");
    assert_eq!((verdict.chosen, verdict.selection.ranks.len()), (2, 9));
    let kinds: Vec<_> = verdict
        .kinds
        .iter()
        .map(|verdict_of_kind| (verdict_of_kind.kind, verdict_of_kind.chosen))
        .collect();
    let expected = [
        (ActionModelKind::Neighbors, 1),
        (ActionModelKind::Increments, 2),
        (ActionModelKind::Network, 2),
    ];
    assert_eq!(kinds, expected);
    assert_eq!(verdict.kinds[2].members, networks.map(|members| members.to_vec()));
    // The independent units are the three blocks, not the nine ensemble members.
    let over = verdict.over_default.expect("a default");
    assert!(
        (over.mean - (6.0 + 0.5 + 52.0 + 6.0 + 0.5 + 52.0 + 6.0 + 0.4 + 52.0) / 9.0).abs() < 1e-9
    );
    assert_eq!(over.clusters, [3, 3]);
    // One kind alone differs between blocks. That is noise, so half of the jackknife's variance is left.
    let differences: Vec<f64> =
        verdict.members.iter().map(|returns| returns[2] - returns[0]).collect();
    let jackknife = calib_stats::jackknife(over.mean, &differences).expect("three blocks");
    let high = over.interval.expect("three blocks").high;
    assert!((2.0f64.sqrt() * (high - over.mean) - (jackknife.high - over.mean)).abs() < 1e-9);
    assert_eq!((verdict.members.len(), verdict.chosen_of_resamples.len()), (3, 3));
    assert_eq!(verdict.chosen_of_resamples.iter().sum::<usize>(), 200);
    assert_eq!(verdict.coverage[2].steps, 300, "of neighbours alone");
    let lacking = all.concat().split_last().expect("runs").1.to_vec();
    assert!(judge(&lacking, &question, Seed::new(1)).is_err(), "a run is missing");
}

#[test]
fn a_candidate_that_diverges_is_not_chosen() {
    let gone = f64::NEG_INFINITY;
    let verdict = judged(&[[gone, -9.0, -12.0], [gone, -11.0, -10.0]], Support::default());
    assert_eq!(verdict.selection.worst_ranks[0], 3);
    assert_ne!(verdict.chosen, 0);
    assert_eq!(verdict.doubts, [], "a default that diverges is surely worse");
}

/// Returns the agreement of neighbours and networks on four settings with these returns in every ensemble member.
fn agreement(returns: [[f64; 4]; 2]) -> Option<f64> {
    let log = plain();
    let kinds = [ActionModelKind::Neighbors, ActionModelKind::Network];
    let mut runs = Vec::new();
    for (kind, own) in kinds.into_iter().zip(returns) {
        for member in 0..2 {
            let candidates = own.into_iter().enumerate();
            runs.extend(
                candidates.map(|(candidate, mean)| Run { kind, ..run(member, candidate, mean) }),
            );
        }
    }
    let question = Question { default: Some(0), ..Question::new(&log, 500, 4) };
    judge(&runs, &question, Seed::new(1)).expect("judged").kinds_agreement()
}

#[test]
fn kinds_agree_on_an_order_as_far_as_their_ranks_do() {
    let order = [-9.0, -8.0, -7.0, -6.0];
    assert_eq!(agreement([order, [-90.0, -80.0, -70.0, -60.0]]), Some(1.0));
    assert_eq!(agreement([order, [-6.0, -7.0, -8.0, -9.0]]), Some(-1.0));
    assert_eq!(agreement([order, [-1.0; 4]]), Some(0.0), "a kind that ranks all alike");
    assert_eq!(judged(&GOOD, Support::default()).kinds_agreement(), None, "of one kind");
}

#[test]
fn a_choice_without_support_says_why() {
    let alike = [[-9.0; 3]; 3];
    let strict = Support { most_uncovered: 0.05, fewest_terminals: 100_000 };
    let doubts = judged(&alike, strict).doubts;
    assert!(doubts.contains(&Doubt::NotToldApart));
    assert!(doubts.contains(&Doubt::Uncovered { share: 0.1 }));
    assert!(matches!(doubts[1], Doubt::FewTerminals { .. }), "{doubts:?}");
    let gone = [[f64::NEG_INFINITY; 3]; 2];
    assert_eq!(judged(&gone, Support::default()).doubts, [Doubt::NotToldApart, Doubt::Diverged]);
}

#[test]
fn a_held_out_period_that_left_the_log_is_doubted() {
    let support = Support { most_uncovered: 0.3, ..Support::default() };
    assert_eq!(support.doubt_about_held_out(Some("july"), 0.3), None);
    let expected = Doubt::HeldOutUncovered { deployment: Some("july".to_owned()), share: 0.31 };
    assert_eq!(support.doubt_about_held_out(Some("july"), 0.31), Some(expected));
}

#[test]
fn a_choice_that_may_be_no_better_than_the_default_is_doubted() {
    let noise = [[-10.0, -9.0, -12.0], [-9.0, -9.5, -12.0], [-9.5, -9.0, -12.0]];
    let verdict = judged(&noise, Support::default());
    assert_eq!((verdict.chosen, verdict.doubts), (1, vec![Doubt::NotBetterThanDefault]));
    let default = [[-9.0, -10.0, -12.0]; 3];
    assert_eq!(judged(&default, Support::default()).doubts, [], "the default is chosen");
    let log = plain();
    let alone = judge(&runs(&noise), &Question { default: None, ..question(&log) }, Seed::new(1));
    assert_eq!(alone.expect("judged").doubts, [], "there is no default");
}

#[test]
fn ranks_over_few_blocks_alone_put_no_choice_ahead_of_the_default() {
    // The difference is one rank in every block, and a return of 1.1 or 0.1.
    let returns = [[-10.1, -9.0, -12.0], [-9.1, -9.0, -12.0]].repeat(2);
    for blocks in [2, 3, FEWEST_BLOCKS] {
        let verdict = judged(&returns[..blocks], Support::default());
        let [of_returns, of_ranks] = [verdict.over_default, verdict.ranks_over_default]
            .map(|over: Option<Difference>| over.expect("two").interval.expect("blocks"));
        assert!(of_returns.low < 0.0);
        assert_eq!(of_ranks, Interval { low: 1.0, high: 1.0 });
        let expected =
            if blocks < FEWEST_BLOCKS { vec![Doubt::NotBetterThanDefault] } else { Vec::new() };
        assert_eq!(verdict.doubts, expected, "{blocks} blocks");
        assert_eq!(verdict.is_ahead_of_default(), expected.is_empty(), "{blocks} blocks");
    }
    let ranks = judged(&GOOD, Support::default()).ranks_over_default.expect("a default");
    assert!((ranks.mean - 5.0 / 3.0).abs() < 1e-12, "of 3 and 1, 3 and 2, 3 and 1");
}

/// Returns the doubts about good runs with this many terminals each in the three kinds of models.
fn doubts_with_terminals(terminals: [usize; 3]) -> Vec<Doubt> {
    let log = plain();
    let all = ActionModelKind::ALL.into_iter().zip(terminals).flat_map(|(kind, terminals)| {
        runs(&GOOD).into_iter().map(move |run| Run { kind, terminals, ..run })
    });
    let all: Vec<Run> = all.collect();
    let question = Question { rule: RankRule::MeanRank, ..question(&log) };
    judge(&all, &question, Seed::new(1)).expect("judged").doubts
}

#[test]
fn terminals_are_rare_where_most_kinds_of_models_have_few() {
    // Terminals occur in one of ten steps of the log, and in one of a hundred steps or in none of models.
    assert_eq!(doubts_with_terminals([0, 10, 10]), [], "one kind alone");
    assert!(matches!(doubts_with_terminals([0, 0, 10])[..], [Doubt::RareTerminals { .. }]));
}

#[test]
fn a_choice_that_gets_less_than_was_recorded_is_doubted() {
    let worse = GOOD.map(|values| values.map(|value| value - 3.0));
    let doubts = judged(&worse, Support::default()).doubts;
    assert_eq!(doubts.len(), 1, "{doubts:?}");
    assert!(
        matches!(doubts[0], Doubt::BelowRecorded { promised, recorded } if promised < recorded)
    );
}

#[test]
fn a_promise_above_the_best_recorded_episode_is_doubted() {
    let better = GOOD.map(|values| values.map(|value| value + 3.0));
    let doubts = judged(&better, Support::default()).doubts;
    assert_eq!(doubts.len(), 1, "{doubts:?}");
    assert!(matches!(doubts[0], Doubt::AboveRecorded { promised, best: -8.0 } if promised > -8.0));
    // A log without whole episodes gives no best return.
    let cut = log(&[(400, Ending::Continues)]);
    let support = Support { fewest_terminals: 0, ..Support::default() };
    let returns = runs(&GOOD.map(|values| values.map(|value| value * 20.0)));
    assert_eq!(judged_of(&cut, &returns, support).doubts, []);
}

/// Returns good runs of 100 steps each, with this many episodes that all end in a terminal, and the mean of these returns.
fn runs_of_episodes(episodes: usize, mean_return: f64) -> Vec<Run> {
    let all = runs(&GOOD).into_iter();
    all.map(|run| Run { episodes, terminals: episodes, mean_return, ..run }).collect()
}

#[test]
fn a_choice_ends_early_if_its_episodes_are_short_and_its_steps_bad() {
    let log = plain();
    let rates = |episodes, mean_return| {
        let runs = runs_of_episodes(episodes, mean_return);
        judged_of(&log, &runs, Support::default()).step_rates.expect("finite")
    };
    // A recorded episode has ten steps of -1. Four times as many terminals, with -8 in 2.5 steps, are -3.2 a step.
    let tripping = rates(40, -8.0);
    assert_eq!((tripping.terminals_in_model, tripping.reward_in_model), (0.4, -3.2));
    assert_eq!((tripping.terminals_in_log, tripping.reward_in_log), (0.1, -1.0));
    assert!(tripping.end_early());
    assert!(!rates(40, -2.0).end_early(), "a goal that is reached sooner");
    assert!(!rates(15, -8.0).end_early(), "hardly more often");
    let diverged = judged_of(&log, &runs_of_episodes(0, f64::NEG_INFINITY), Support::default());
    assert_eq!(diverged.step_rates, None);
}

/// Returns good runs with this many terminals each.
fn runs_with_terminals(terminals: usize) -> Vec<Run> {
    runs(&GOOD).into_iter().map(|run| Run { terminals, ..run }).collect()
}

#[test]
fn terminals_that_are_rarer_by_an_order_than_in_the_log_are_doubted() {
    let rare = judged_of(&plain(), &runs_with_terminals(0), Support::default()).doubts;
    assert!(matches!(rare[..], [Doubt::RareTerminals { in_model: 0.0, in_log }] if in_log > 0.09));
    assert_eq!(
        judged_of(&plain(), &runs_with_terminals(1), Support::default()).doubts,
        [],
        "a tenth"
    );
    let support = Support { fewest_terminals: 0, ..Support::default() };
    let endless = log(&[(500, Ending::Continues); 2]);
    let returns = runs(&GOOD.map(|values| values.map(|value| value * 50.0)));
    let none: Vec<Run> = returns.into_iter().map(|run| Run { terminals: 0, ..run }).collect();
    let doubts = judged_of(&endless, &none, support).doubts;
    assert!(!doubts.iter().any(|doubt| matches!(doubt, Doubt::RareTerminals { .. })), "{doubts:?}");
}

#[test]
fn regret_is_what_the_best_has_more() {
    let truth = [-100.0, -50.0, -75.0, -50.0, -500.0];
    assert_eq!(regret(&truth, 2), Regret { regret: 25.0, percentile: 0.5 });
    assert_eq!(regret(&truth, 1), Regret { regret: 0.0, percentile: 3.5 / 4.0 });
    assert_eq!(regret(&truth, 4).percentile, 0.0);
}

/// Returns the doubts about good runs whose episodes have these displacements.
fn doubts_with_jumps(displacements: &[f32]) -> Vec<Doubt> {
    let mut drift = Drift::default();
    for &displacement in displacements {
        drift.count(&[0.1, displacement]);
    }
    let each = runs(&GOOD).into_iter().map(|run| Run { drift: drift.clone(), ..run });
    judged_of(&plain(), &each.collect::<Vec<_>>(), Support::default()).doubts
}

#[test]
fn a_rollout_that_jumps_move_on_and_on_is_doubted() {
    // An actuator was held at +1, and jumps moved it back in every step.
    let doubts = doubts_with_jumps(&[-4.0, -4.4, -3.9, -4.1]);
    assert!(
        matches!(&doubts[..], [Doubt::Displaced { column: 1, mean, .. }] if (mean + 4.1).abs() < 1e-3),
        "{doubts:?}"
    );
    // Noise is displaced as far, but to both sides.
    assert_eq!(doubts_with_jumps(&[-4.0, 4.4, 3.9, -4.1]), []);
    assert_eq!(doubts_with_jumps(&[-0.4, -0.41, -0.39, -0.4]), [], "less than was recorded");
}

/// An actuator moves by increments, and never beyond some level in the log. In the model it stays below that level, and every step is
/// covered.
#[test]
fn a_wall_of_the_log_is_told_by_displacement() {
    use calib_core::{Segments, States};

    use crate::{
        ActionModelConfig, Columns, Ensemble as _, Environment as _, ModelEnvironment as _,
        model::tests::built,
    };

    let mut rng = Seed::new(4).rng();
    let mut level = 0.5_f64;
    let rows = 3000;
    let mut values = Vec::new();
    let mut actions = Vec::new();
    for _ in 0..rows {
        // Three other sensors make sure that neighbours are not near in each column.
        values.push(level as f32);
        values.extend((0..3).map(|_| rng.unit() as f32));
        // Actions are down, nothing and up. Near the end of the recorded range, none moves it up.
        let choices = if level > 0.95 { 2 } else { 3 };
        let action = rng.below(choices);
        actions.push(Some(action as u16));
        level = (level + 0.05 * (action as f64 - 1.0) + 0.01 * (rng.unit() - 0.5)).clamp(0.0, 1.0);
    }
    let rewards = vec![0.0; rows];
    let endings = vec![Ending::Continues; rows];
    let columns = Columns { actions: &actions, rewards: &rewards, endings: &endings };
    let states = States::new(values, rows, 4).expect("valid");
    let segments = Segments::from_lengths([rows]).expect("valid");
    let log = Decisions::new(states, &segments, columns, 3).expect("a log");
    let model = built(log, 20, &ActionModelConfig::default(), 0.0);
    let actions: [fn(usize) -> usize; 2] = [|_| 2, |step| 2 * (step % 2)];
    let [up, up_and_down] = actions.map(|action| {
        let mut rollout = model.rollout(0);
        let mut rng = Seed::new(5).rng();
        let mut state = [0.0; 4];
        for _ in 0..10 {
            rollout.start(&mut rng, &mut state);
            for step in 0..100 {
                rollout.step(action(step), &mut rng, &mut state);
            }
        }
        rollout.start(&mut rng, &mut state);
        assert!(rollout.coverage().uncovered() < 0.3, "{:?}", rollout.coverage());
        displaced(&rollout.drift())
    });
    // 100 steps up would be five times the recorded range. All of them are covered, and jumps undo the movement beyond the range.
    assert!(matches!(up, Some(Doubt::Displaced { column: 0, mean, .. }) if mean < -3.5), "{up:?}");
    assert_eq!(up_and_down, None);
}

/// Returns results of two actions. The second one has these returns in the ensemble members.
fn constants(returns: [f64; 3], far: u64) -> [ConstantReturns; 1] {
    let covered = Coverage { steps: 100, missing: 0, far: 0 };
    [ConstantReturns {
        kind: ActionModelKind::Neighbors,
        members: returns.map(|of_second| vec![-20.0, of_second]).to_vec(),
        random: vec![-20.0; returns.len()],
        coverage: vec![covered, Coverage { far, ..covered }],
    }]
}

fn judged_beside(constants: &[ConstantReturns]) -> ReturnVerdict {
    let log = plain();
    let question = Question { constants, ..question(&log) };
    judge(&runs(&GOOD), &question, Seed::new(1)).expect("judged")
}

fn is_worse_than_constant(doubt: &Doubt) -> bool {
    matches!(doubt, Doubt::WorseThanConstant { action: 1, .. })
}

#[test]
fn a_constant_action_that_gets_more_is_a_doubt() {
    // The choice gets -9, -11 and -8.
    let verdict = judged_beside(&constants([-4.0, -5.9, -3.1], 10));
    let best = verdict.constant.as_ref().expect("tried");
    assert_eq!((best.action, best.uncovered), (1, 0.1));
    assert!((best.mean_return + 13.0 / 3.0).abs() < 1e-12);
    assert!((best.over.expect("finite").mean + 5.0).abs() < 1e-12);
    assert!(verdict.doubts.iter().any(is_worse_than_constant), "{:?}", verdict.doubts);
    let of_kind = KindMean { kind: ActionModelKind::Neighbors, mean_return: best.mean_return };
    assert_eq!(best.kinds, [of_kind]);
    // This action gets more on average, but possibly by chance.
    let verdict = judged_beside(&constants([-1.0, -19.0, -1.0], 10));
    let over = verdict.constant.as_ref().and_then(|constant| constant.over).expect("finite");
    assert!(over.mean < 0.0 && over.interval.is_some_and(|interval| interval.high > 0.0));
    assert!(verdict.doubts.iter().any(is_worse_than_constant), "{:?}", verdict.doubts);
    // An action that gets less on average is no doubt.
    let verdict = judged_beside(&constants([-4.0, -30.0, -3.1], 10));
    assert_eq!(verdict.doubts, []);
    // Neither is an action whose steps are not recorded: the best of the others is named.
    let verdict = judged_beside(&constants([-4.0, -5.9, -3.1], 90));
    assert_eq!(verdict.constant.map(|constant| constant.action), Some(0));
    assert_eq!(verdict.doubts, []);
    let [mut unknown] = constants([-4.0, -5.9, -3.1], 90);
    unknown.coverage[0].far = 90;
    assert_eq!(judged_beside(&[unknown]).constant, None, "nobody recorded any");
    assert_eq!(judged(&GOOD, Support::default()).constant, None, "not tried");
}

/// What 64 equal actions get in a member: the same values, of a standard deviation of 1, in an order that follows from an odd `step`. Their mean
/// is half a standard deviation below that of the choice, which gets -9, -11 and -8.
fn noisy_actions(step: u32) -> Vec<f64> {
    let places = (1..=64).map(|action: u32| f64::from(action * step % 64));
    places.map(|place| (place - 31.5) / 18.47 - 9.833).collect()
}

/// Returns the best of 64 equal actions, of which one gets `more_of_one` more, and whether it is a doubt.
fn best_of_many(more_of_one: f64) -> (BestConstant, bool) {
    let mut members = [5, 27, 43].map(noisy_actions).to_vec();
    for returns in &mut members {
        returns[7] += more_of_one;
    }
    let [of_two] = constants([-20.0; 3], 0);
    let coverage = vec![of_two.coverage[0]; 64];
    let verdict = judged_beside(&[ConstantReturns { members, coverage, ..of_two }]);
    let best = verdict.constant.expect("tried");
    let mut doubts = verdict.doubts.into_iter();
    let is_doubted = doubts.any(|doubt| matches!(doubt, Doubt::WorseThanConstant { .. }));
    (best, is_doubted)
}

#[test]
fn the_best_of_many_equal_actions_is_no_doubt() {
    let (best, is_doubted) = best_of_many(0.0);
    let over = best.over.expect("finite");
    assert!(best.mean_return > -9.0 && over.mean > 1.4, "the best one looks good: {best:?}");
    assert!(over.interval.is_some() && !is_doubted);
    let (best, is_doubted) = best_of_many(4.0);
    assert!(best.action == 7 && is_doubted, "{best:?}");
}

#[test]
fn the_order_of_kinds_changes_nothing() {
    let log = plain();
    let [of_neighbors] = constants([-4.0, -5.9, -3.1], 90);
    let kind = ActionModelKind::Network;
    // A network knows of no step whether the log covers it.
    let coverage = vec![Coverage { far: 0, ..of_neighbors.coverage[0] }; 2];
    let of_networks = ConstantReturns { kind, coverage, ..of_neighbors.clone() };
    let runs = [runs(&GOOD), runs_of_kind(kind, &GOOD)].concat();
    let orders = [[of_neighbors.clone(), of_networks.clone()], [of_networks, of_neighbors]];
    let [verdict, other] = orders.map(|constants: [ConstantReturns; 2]| {
        let question = Question { constants: &constants, ..question(&log) };
        judge(&runs, &question, Seed::new(1)).expect("judged")
    });
    assert_eq!(
        verdict.constant.as_ref().map(|best| best.action),
        Some(0),
        "the other is not covered"
    );
    assert_eq!(verdict.doubts, []);
    assert_eq!(other.doubts, []);
    let [one, two] = [verdict, other].map(|verdict| verdict.constant.expect("tried"));
    assert_eq!(
        (one.action, one.mean_return, one.uncovered),
        (two.action, two.mean_return, two.uncovered)
    );
    assert_eq!(one.over, two.over);
}

fn is_doubted_beside_random(verdict: &ReturnVerdict) -> bool {
    verdict.doubts.iter().any(|doubt| matches!(doubt, Doubt::NotBetterThanRandomActions { .. }))
}

/// Returns the doubts about good runs of one ensemble member, in which random actions get `random`.
fn doubts_in_one_member(random: f64) -> Vec<Doubt> {
    let [of_three] = constants([-30.0; 3], 10);
    let members = of_three.members[..1].to_vec();
    let constants = [ConstantReturns { members, random: vec![random], ..of_three }];
    let log = plain();
    let question = Question { constants: &constants, ..question(&log) };
    judge(&runs(&GOOD[..1]), &question, Seed::new(1)).expect("judged").doubts
}

#[test]
fn a_choice_that_may_be_no_better_than_random_actions_is_doubted() {
    let worse = constants([-30.0; 3], 10);
    // The choice gets -9, -11 and -8, and random actions get -20.
    let verdict = judged_beside(&worse);
    let random = verdict.random_actions.expect("tried");
    assert!((random.over.expect("finite").mean - 32.0 / 3.0).abs() < 1e-12);
    assert!(!is_doubted_beside_random(&verdict), "{:?}", verdict.doubts);
    let [mut alike, mut better] = [worse.clone(), worse];
    alike[0].random = vec![-9.0, -13.0, -7.0];
    better[0].random = vec![-3.0; 3];
    assert!(is_doubted_beside_random(&judged_beside(&alike)), "by chance");
    assert!(is_doubted_beside_random(&judged_beside(&better)));
    // One ensemble member has no interval. The choice gets -9 in it.
    let expected = [Doubt::OneMember, Doubt::NotBetterThanDefault];
    assert_eq!(doubts_in_one_member(-20.0), expected);
    let random = Doubt::NotBetterThanRandomActions { random: -9.0, promised: -9.0 };
    assert_eq!(doubts_in_one_member(-9.0), [&expected[..], &[random]].concat());
}

#[test]
fn less_evidence_gives_no_more_confidence() {
    let log = plain();
    // There is no default, and returns are noise: the choice of the first member looks good in it.
    let question = Question { default: None, ..question(&log) };
    let returns = [[-15.0, -9.0, -12.0], [-15.5, -9.5, -12.0]];
    let one = judge(&runs(&returns[..1]), &question, Seed::new(1)).expect("judged");
    assert_eq!(one.doubts, [Doubt::OneMember]);
    let two = judge(&runs(&returns), &question, Seed::new(1)).expect("judged");
    assert_eq!(two.doubts, []);
}

/// Judges a choice that fails in one network. Random actions get `of_neighbors` in neighbours, and less in networks.
fn random_actions_beside(of_neighbors: [f64; 4], blocks: usize) -> RandomActions {
    let kinds = [ActionModelKind::Neighbors, ActionModelKind::Network];
    let fails = [[-15.0, -10.0, -16.0], [-15.0, -150.0, -16.0]];
    let networks = [fails[0], fails[0], fails[1], fails[0]];
    let all =
        [runs_of_kind(kinds[0], &[[-15.0, -9.0, -16.0]; 4]), runs_of_kind(kinds[1], &networks)];
    let log = plain();
    let random = [of_neighbors, [-40.0; 4]];
    let constants = [0, 1].map(|kind: usize| ConstantReturns {
        kind: kinds[kind],
        members: vec![vec![-300.0]; blocks],
        random: random[kind][..blocks].to_vec(),
        coverage: vec![Coverage::default()],
    });
    let mut runs = all.concat();
    runs.retain(|run| run.member < blocks);
    let rule = RankRule::MeanRank;
    let question = Question { constants: &constants, rule, ..question(&log) };
    let verdict = judge(&runs, &question, Seed::new(1)).expect("judged");
    assert_eq!(verdict.chosen, 1);
    verdict.random_actions.expect("tried")
}

#[test]
fn a_member_that_alone_makes_random_actions_look_as_good_is_named() {
    let random = random_actions_beside([-20.0; 4], 4);
    let over = random.over.expect("finite");
    assert!(over.mean > 0.0 && over.interval.is_some_and(|interval| interval.low < 0.0));
    let network =
        OutlyingMember { kind: ActionModelKind::Network, member: 2, chosen_return: -150.0 };
    assert_eq!(random.outlying, Some(network));
    assert_eq!(
        random_actions_beside([-90.0, -20.0, -20.0, -5.0], 4).outlying,
        None,
        "noise without it too"
    );
    let few = random_actions_beside([-60.0; 4], 3);
    assert!(few.outlying.is_none(), "of three members none stands out");
}
