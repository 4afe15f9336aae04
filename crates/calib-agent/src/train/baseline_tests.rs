//! Agents that start from a simple predictor.

use calib_core::Silent;

use super::{
    tests::{linear, mlp, waves, waves_in},
    *,
};
use crate::{
    CurveRule, FittedPredictor, Fitter, OptimiserKind, Part, SimplePredictor, score_predictions,
};

fn trained(
    stream: &dyn Stream,
    config: &AgentConfig,
    baseline: Option<&[f32]>,
    start: Option<&crate::Checkpoint>,
) -> RunOutcome {
    let learner = Learner { config, cumulant: 0, start, baseline };
    let steps = stream.len() - 1;
    let run = Run { stream, steps, curve: CurveRule { windows: 20 }, seed: Seed::new(3) };
    train_learners(run, &[learner], &NoKeeper, &Silent).expect("trained").remove(0)
}

fn error(outcome: &RunOutcome) -> f64 {
    outcome.scores.of(Part::WholeRun).expect("steps").rmse
}

#[test]
fn an_agent_that_does_not_learn_is_its_baseline() {
    let stream = waves(2000);
    for config in [linear(), mlp()] {
        let config = AgentConfig { learning_rate: 0.0, ..config };
        for predictor in SimplePredictor::ALL {
            let fitted = Fitter::new(&stream, config.gamma, &[]).fit(predictor, 0);
            let baseline = fitted.predictions(&stream);
            let agent = trained(&stream, &config, Some(&baseline), None);
            let steps = stream.len() - 1;
            let rule = CurveRule { windows: 20 };
            let alone = score_predictions(&stream, 0, config.gamma, &baseline[..steps], 0, rule)
                .expect("scored");
            assert_eq!((agent.scores, agent.curve), (alone.scores, alone.curve), "{predictor:?}");
        }
    }
}

/// A linear value function that is added to a linear baseline equals one that starts with the baseline's
/// weights.
#[test]
fn a_linear_baseline_is_where_a_linear_agent_begins() {
    let stream = waves(1500);
    let config = AgentConfig { optimiser: OptimiserKind::Sgd, learning_rate: 0.2, ..linear() };
    let fitted = Fitter::new(&stream, config.gamma, &[]).fit(SimplePredictor::Persistence, 0);
    let FittedPredictor::Affine { weights, bias } = &fitted else {
        panic!("persistence is affine")
    };
    let parameters = weights.iter().chain([bias]).map(|&weight| weight as f32).collect();
    let start = crate::Checkpoint { parameters, moments: None };
    let added = trained(&stream, &config, Some(&fitted.predictions(&stream)), None);
    let begun = trained(&stream, &config, None, Some(&start));
    assert!((error(&added) / error(&begun) - 1.0).abs() < 1e-3, "{added:?} {begun:?}");
    let frozen = AgentConfig { learning_rate: 0.0, ..config };
    assert!(
        error(&added) < 0.9 * error(&trained(&stream, &frozen, None, Some(&start))),
        "it learns"
    );
}

/// Returns the error of the last quarter.
fn settled_error(outcome: &RunOutcome) -> f64 {
    outcome.scores.of(Part::FinalQuarter).expect("steps").rmse
}

#[test]
fn networks_learn_what_their_baseline_lacks() {
    let stream = waves(3000);
    let config = AgentConfig { learning_rate: 3e-3, ..mlp() };
    let mean = Fitter::new(&stream, config.gamma, &[]).fit(SimplePredictor::Mean, 0);
    let baseline = mean.predictions(&stream);
    let outcome = trained(&stream, &config, Some(&baseline), None);
    let frozen = AgentConfig { learning_rate: 0.0, ..config.clone() };
    let mean = settled_error(&trained(&stream, &frozen, Some(&baseline), None));
    assert!(settled_error(&outcome) < 0.5 * mean, "{} {mean}", settled_error(&outcome));
}

#[test]
fn a_step_size_that_halves_comes_to_rest() {
    let config = AgentConfig { learning_rate: 0.4, halve_after: 100, ..linear() };
    assert_eq!([0, 100, 300].map(|updates| config.rate_after(updates)), [0.4, 0.2, 0.1]);
    let stream = waves(1500);
    let constant = AgentConfig { halve_after: 0, ..config.clone() };
    let nearly = AgentConfig { halve_after: u64::MAX, ..config.clone() };
    assert_eq!(trained(&stream, &constant, None, None), trained(&stream, &nearly, None, None));
    assert_ne!(trained(&stream, &constant, None, None), trained(&stream, &config, None, None));
}

#[test]
fn a_baseline_of_another_stream_is_refused() {
    let stream = waves(100);
    let config = linear();
    let learner = Learner { config: &config, cumulant: 0, start: None, baseline: Some(&[0.0; 7]) };
    let run = Run { stream: &stream, steps: 90, curve: CurveRule::default(), seed: Seed::new(3) };
    let refused = train_learners(run, &[learner], &NoKeeper, &Silent).expect_err("refused");
    assert_eq!(refused, AgentError::Baseline { got: 7, expected: 100 });
}

fn online(optimiser: OptimiserKind) -> AgentConfig {
    AgentConfig {
        optimiser,
        replay: crate::ReplayKind::None,
        learning_rate: 0.02,
        lambda: 0.8,
        ..linear()
    }
}

/// The stream has two pieces, so that traces end at a gap.
#[test]
fn agents_with_traces_learn_and_begin_anew_after_a_gap() {
    let stream = waves_in([2500, 1500]);
    let mean = {
        let frozen = AgentConfig { learning_rate: 0.0, ..linear() };
        let fitted = Fitter::new(&stream, frozen.gamma, &[]).fit(SimplePredictor::Mean, 0);
        error(&trained(&stream, &frozen, Some(&fitted.predictions(&stream)), None))
    };
    for optimiser in [OptimiserKind::TrueOnlineTd, OptimiserKind::SwiftTd] {
        let outcome = trained(&stream, &online(optimiser), None, None);
        let settled = settled_error(&outcome);
        assert!(settled < 0.3 * mean, "{optimiser:?}: {settled} {mean}");
        assert_eq!(outcome.updates, 3998);
    }
}

/// Tabular TD(λ) with λ = 0 and TD(0) make the same updates, except for when they compute the value of a
/// state.
#[test]
fn without_traces_true_online_td_is_td() {
    let stream = waves(3000);
    let descent = online(OptimiserKind::Sgd);
    let nothing = crate::Checkpoint { parameters: vec![0.0; 3], moments: None };
    let td = trained(&stream, &descent, None, Some(&nothing));
    let config = AgentConfig { lambda: 0.0, ..online(OptimiserKind::TrueOnlineTd) };
    let online = trained(&stream, &config, None, None);
    assert!((error(&online) / error(&td) - 1.0).abs() < 0.02, "{online:?} {td:?}");
}

#[test]
fn agents_with_traces_need_a_stream() {
    let config = AgentConfig { optimiser: OptimiserKind::SwiftTd, ..mlp() };
    let refused = config.check().expect_err("a network");
    assert!(refused.to_string().contains("value_function = \"linear\""), "{refused}");
}
