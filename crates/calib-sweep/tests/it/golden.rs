//! Compares scores, choices, regrets and bounds with those of NumPy, from
//! `scripts/golden/verdict.py`.

use std::collections::BTreeMap;

use calib_agent::{
    AgentConfig, Checkpoint, CurveRule, Learner, NoKeeper, OptimiserKind, Part, PartScore,
    ReplayKind, Run, Scores, ValueFunction, train_learners,
};
use calib_core::{RowStream, Seed, Segments, Silent, States};
use calib_sweep::{
    BaselineRegret, Candidate, ChoiceBaseline, EnvironmentId, Judging, Rule, RunRow, SensorVerdict,
    Unit, UnitResult, raced, verdict,
};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    scores: GoldenScores,
    verdict: GoldenVerdict,
    race: GoldenRace,
}

/// Some runs of each member, then as many windows of the log.
#[derive(Deserialize)]
struct GoldenRace {
    /// `[run][stream][setting]`; null where a setting diverged.
    streams: Vec<Vec<Vec<Option<f64>>>>,
    /// `[run][stream]`: the settings that are trained.
    trained: Vec<Vec<Vec<usize>>>,
}

#[derive(Deserialize)]
struct GoldenScores {
    states: Vec<Vec<f32>>,
    lengths: Vec<usize>,
    gamma: f64,
    learning_rate: f64,
    steps: usize,
    weights: Vec<f32>,
    scores: Scores,
}

type Runs = Vec<Vec<f64>>;

#[derive(Deserialize)]
struct GoldenVerdict {
    default: usize,
    members: Vec<Runs>,
    log: Runs,
    windows: Vec<Runs>,
    chosen: BTreeMap<String, usize>,
    regrets: Vec<f64>,
    another_window: f64,
    hindsight: f64,
    random: f64,
    log_replay: usize,
    latest_window: usize,
    regret_bound: f64,
    against_default: f64,
    against_default_interval: [f64; 2],
    shares: Vec<f64>,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("../golden/verdict.json")).expect("reads")
}

#[test]
fn errors_of_every_part_are_numpys() {
    let GoldenScores { states, lengths, gamma, learning_rate, steps, weights, scores } =
        golden().scores;
    let rows = states.len();
    let width = states[0].len();
    let states = States::new(states.concat(), rows, width).expect("valid");
    let stream = RowStream::replay(states, &Segments::from_lengths(lengths).expect("valid"));
    let config = AgentConfig {
        value_function: ValueFunction::Linear,
        optimiser: OptimiserKind::Sgd,
        replay: ReplayKind::None,
        learning_rate,
        gamma,
        ..AgentConfig::default()
    };
    let start = Checkpoint { parameters: weights, moments: None };
    let learner = Learner { config: &config, cumulant: 0, start: Some(&start), baseline: None };
    let run = Run { stream: &stream, steps, curve: CurveRule { windows: 0 }, seed: Seed::new(1) };
    let outcome = train_learners(run, &[learner], &NoKeeper, &Silent).expect("trains");
    for part in Part::ALL {
        let got = outcome[0].scores.of(part).expect("scored");
        let expected = scores.of(part).expect("scored");
        assert_eq!(got.scored_steps, expected.scored_steps, "{part:?}");
        for (got, expected) in [
            (got.rmse, expected.rmse),
            (got.mean_return, expected.mean_return),
            (got.return_std, expected.return_std),
        ] {
            assert!((got - expected).abs() < 2e-6, "{part:?}: {got}, expected {expected}");
        }
    }
}

fn candidates(golden: &GoldenVerdict) -> Vec<Candidate> {
    (0..golden.regrets.len())
        .map(|index| Candidate {
            index,
            is_default: index == golden.default,
            values: vec![("learning_rate".to_owned(), (index + 1).into())],
            agent: AgentConfig::default(),
        })
        .collect()
}

fn result(environment: EnvironmentId, run: usize, start_row: usize, errors: &[f64]) -> UnitResult {
    UnitResult {
        key: String::new(),
        unit: Unit { sensor: "A".to_owned(), environment, run },
        seed: 0,
        start_row: start_row as u32,
        not_finite: None,
        rows: errors
            .iter()
            .enumerate()
            .map(|(candidate, &rmse)| {
                let score = PartScore { scored_steps: 9, rmse, mean_return: 0.0, return_std: 1.0 };
                RunRow {
                    candidate,
                    steps: 9,
                    updates: 1,
                    scores: Scores { whole_run: Some(score), ..Scores::default() },
                    diverged_at: rmse.is_infinite().then_some(3),
                    curve: vec![],
                }
            })
            .collect(),
    }
}

fn judged(golden: &GoldenVerdict) -> SensorVerdict {
    let mut results = Vec::new();
    for (member, runs) in golden.members.iter().enumerate() {
        let runs = runs.iter().enumerate();
        results.extend(
            runs.map(|(run, errors)| result(EnvironmentId::Member(member), run, 0, errors)),
        );
    }
    let log = golden.log.iter().enumerate();
    // Starts nine rows apart, so that windows do not overlap.
    results.extend(log.map(|(run, errors)| result(EnvironmentId::LogReplay, run, run * 9, errors)));
    for (window, runs) in golden.windows.iter().enumerate() {
        let runs = runs.iter().enumerate();
        results.extend(runs.map(|(run, errors)| {
            result(EnvironmentId::Online, run * golden.windows.len() + window, window, errors)
        }));
    }
    let judging = Judging {
        part: Part::WholeRun,
        rule: Rule::WorstRank,
        top_k: 1,
        scales: &[],
        simple: &[],
        best: None,
        stands_still: false,
        resamples: 20_000,
        seed: Seed::new(1),
    };
    verdict("A", &candidates(golden), &results, &judging).expect("judged")
}

fn near(what: &str, got: f64, expected: f64, tolerance: f64) {
    assert!((got - expected).abs() < tolerance, "{what}: {got}, expected {expected}");
}

fn baseline(all: &[BaselineRegret], wanted: ChoiceBaseline) -> &BaselineRegret {
    all.iter().find(|known| known.baseline == wanted).expect("there")
}

#[test]
fn choices_regrets_and_bounds_are_numpys() {
    let golden = golden().verdict;
    let verdict = judged(&golden);
    assert_eq!(verdict.rules.len(), golden.chosen.len());
    for choice in &verdict.rules {
        assert_eq!(choice.chosen, golden.chosen[choice.rule.name()], "{:?}", choice.rule);
    }
    let truth = verdict.truth.expect("held out");
    for (value, (got, expected)) in
        truth.regrets.expect("finite").into_iter().zip(&golden.regrets).enumerate()
    {
        near(&format!("regret of {value}"), got, *expected, 1e-12);
    }
    for (wanted, expected) in [
        (ChoiceBaseline::AnotherWindow, golden.another_window),
        (ChoiceBaseline::Hindsight, golden.hindsight),
        (ChoiceBaseline::Random, golden.random),
    ] {
        let cost = baseline(&truth.baselines, wanted).regret.expect("known").value;
        near(&format!("{wanted:?}"), cost, expected, 1e-12);
    }
    let replayed = baseline(&truth.baselines, ChoiceBaseline::LogReplay);
    assert_eq!(replayed.chosen, Some(golden.log_replay));
    let latest = baseline(&truth.baselines, ChoiceBaseline::LatestWindow);
    assert_eq!(latest.chosen, Some(golden.latest_window));
    let bound = truth.choice.regret.expect("known").upper.expect("four windows");
    near("bound", bound, golden.regret_bound, 1e-6);
    let quotient = truth.choice.against_default.expect("another");
    near("quotient", quotient.value, golden.against_default, 1e-12);
    let quotient = quotient.interval.expect("finite");
    near("quotient, low", quotient.low, golden.against_default_interval[0], 1e-9);
    near("quotient, high", quotient.high, golden.against_default_interval[1], 1e-9);
    // Both are estimates, from 20,000 and 40,000 resamples.
    for (value, &expected) in golden.shares.iter().enumerate() {
        let share = verdict.stability.iter().find(|share| share.candidate == value);
        near("share", share.map_or(0.0, |share| share.share), expected, 0.015);
    }
}

#[test]
fn a_race_drops_what_numpy_drops() {
    let GoldenRace { streams, trained } = golden().race;
    let mut results = Vec::new();
    let mut expected = BTreeMap::new();
    for (run, (errors, trained)) in streams.iter().zip(trained).enumerate() {
        for (stream, (errors, trained)) in errors.iter().zip(trained).enumerate() {
            let errors: Vec<f64> =
                errors.iter().map(|error| error.unwrap_or(f64::INFINITY)).collect();
            let environment = match stream {
                4 => EnvironmentId::LogReplay,
                member => EnvironmentId::Member(member),
            };
            results.push(result(environment, run, 0, &errors));
            if !trained.is_empty() {
                expected.insert((environment, run), trained);
            }
        }
    }
    let values = streams[0][0].len();
    let made: BTreeMap<(EnvironmentId, usize), Vec<usize>> =
        raced(&results, values, Part::WholeRun)
            .iter()
            .map(|result| {
                let Unit { environment, run, .. } = result.unit;
                let trained = result.rows.iter().map(|row| row.candidate);
                ((environment, run), trained.collect())
            })
            .collect();
    assert_eq!(made, expected);
}
