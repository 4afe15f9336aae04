use super::*;
use crate::sweep::tests::small_model;

fn run(member: usize, candidate: usize, mean_return: f64) -> Run {
    let coverage = Coverage { steps: 100, missing: 0, far: 10 };
    let (episodes, terminals, curve) = (5, 5, Vec::new());
    Run { member, run: 0, candidate, mean_return, episodes, terminals, coverage, curve }
}

fn judged(returns: &[[f64; 3]], support: Support) -> ReturnVerdict {
    let runs: Vec<Run> = returns
        .iter()
        .enumerate()
        .flat_map(|(member, of)| (0..3).map(move |candidate| run(member, candidate, of[candidate])))
        .collect();
    let model = small_model();
    judge(&runs, 3, Some(0), (model.log(), 500), support, 200, Seed::new(1)).expect("judged")
}

#[test]
fn the_highest_return_is_the_best_rank() {
    let returns = [[-9.0, -2.0, -5.0], [-9.5, -4.0, -3.0], [-8.0, -1.0, -5.0]];
    let verdict = judged(&returns, Support::default());
    assert_eq!(verdict.chosen, 1);
    assert_eq!(verdict.selection.worst_ranks, [3, 2, 2]);
    assert!(verdict.is_supported(), "{:?}", verdict.doubts);
    let over = verdict.over_default.expect("a default");
    assert!((over.mean - 6.5).abs() < 1e-12 && over.is_told(), "{over:?}");
    assert_eq!(verdict.chosen_of_resamples.iter().sum::<usize>(), 200);
    assert!(verdict.chosen_of_resamples[1] > 100 && verdict.chosen_of_resamples[0] == 0);
    assert!(verdict.behaviour.is_some_and(|of| of.mean > 5.0));
    assert_eq!(verdict.coverage[2], Coverage { steps: 300, missing: 0, far: 30 });
}

#[test]
fn a_candidate_that_diverges_is_not_chosen() {
    let gone = f64::NEG_INFINITY;
    let verdict = judged(&[[gone, -2.0, -5.0], [gone, -4.0, -3.0]], Support::default());
    assert_eq!(verdict.selection.worst_ranks[0], 3);
    assert_ne!(verdict.chosen, 0);
}

#[test]
fn a_choice_without_support_says_why() {
    let alike = [[1.0; 3]; 3];
    let strict = Support { most_uncovered: 0.05, fewest_terminals: 100_000 };
    let doubts = judged(&alike, strict).doubts;
    assert!(doubts.contains(&Doubt::NotToldApart));
    assert!(doubts.contains(&Doubt::Uncovered { share: 0.1 }));
    assert!(matches!(doubts[1], Doubt::FewTerminals { .. }), "{doubts:?}");
    let gone = [[f64::NEG_INFINITY; 3]; 2];
    assert!(judged(&gone, Support::default()).doubts.contains(&Doubt::Diverged));
}

#[test]
fn regret_is_what_the_best_has_more() {
    let truth = [-100.0, -50.0, -75.0, -50.0, -500.0];
    assert_eq!(regret(&truth, 2), Regret { regret: 25.0, percentile: 0.5 });
    assert_eq!(regret(&truth, 1), Regret { regret: 0.0, percentile: 3.5 / 4.0 });
    assert_eq!(regret(&truth, 4).percentile, 0.0);
}
