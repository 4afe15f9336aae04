use calib_core::{RowStream, Segments, Silent, States};

use super::*;
use crate::{
    Precision,
    train::tests::{self, waves_in, weighted_sum},
};

/// Returns a slow wave and its derivative in two segments. The second sensor is the first one a quarter period
/// later.
fn waves(steps: usize) -> RowStream {
    waves_in([steps / 3, steps - steps / 3])
}

fn mlp(learning_rate: f64) -> AgentConfig {
    AgentConfig { learning_rate, ..tests::mlp() }
}

fn linear(learning_rate: f64) -> AgentConfig {
    AgentConfig { learning_rate, ..tests::linear() }
}

fn rounded() -> AgentConfig {
    AgentConfig { precision: Precision::Bf16, ..mlp(1e-3) }
}

fn settings(epochs: usize, patience: usize) -> PretrainSettings {
    PretrainSettings { epochs, patience, validation_fraction: 0.25 }
}

fn run(
    stream: &RowStream,
    settings: PretrainSettings,
    config: &AgentConfig,
    sensors: &[usize],
    file: Option<&StateFile>,
) -> Result<Vec<Pretrained>, AgentError> {
    let learners: Vec<_> = sensors.iter().map(|&cumulant| Learner::new(config, cumulant)).collect();
    let training = Pretraining { stream, settings, seed: Seed::new(5) };
    let outcomes = pretrain(training, &learners, file, &Silent)?;
    Ok(outcomes.into_iter().map(|outcome| outcome.expect("it does not diverge")).collect())
}

#[test]
fn agents_learn_from_epoch_to_epoch() {
    let stream = waves(1_500);
    for config in [mlp(1e-3), linear(0.1)] {
        let agent = run(&stream, settings(30, 0), &config, &[0], None).expect("trains").remove(0);
        let first = agent.curve[0];
        let last = agent.curve[29];
        assert_eq!((agent.epoch, agent.curve.len(), last.epoch), (30, 30, 30));
        let [first_error, last_error] =
            [first, last].map(|epoch| epoch.validation_nrmse.expect("known"));
        assert!(last_error < 0.2 && last_error < 0.5 * first_error, "{agent:?}");
        assert!(last.training_loss < first.training_loss, "{first:?} {last:?}");
        assert!(last.validation_loss < first.validation_loss, "{first:?} {last:?}");
    }
}

/// Checks against one epoch of linear gradient descent, written as plainly as possible and in f64.
#[test]
fn an_epoch_is_one_pass_over_the_first_transitions() {
    let stream = waves(60);
    let config = linear(0.05);
    let agent = run(&stream, settings(1, 0), &config, &[1], None).expect("trains").remove(0);
    let initial = calib_nn::Mlp::new(&[2, 1], Seed::new(5).child("parameters"));
    let mut w: Vec<f64> = initial.parameters().iter().map(|&p| f64::from(p)).collect();
    // Two segments have 58 transitions. The last quarter, 15 (14.5 rounded), is for validation.
    let train: Vec<usize> = (0..19).chain(20..44).collect();
    let order = shuffled(&train, Seed::new(5).child("epoch").number(0));
    let rows: Vec<[f64; 3]> = (0..stream.len())
        .map(|t| [f64::from(stream.state(t)[0]), f64::from(stream.state(t)[1]), 1.0])
        .collect();
    let mut loss = 0.0;
    for batch in order.chunks(16) {
        let before = w.clone();
        for &t in batch {
            let error = rows[t + 1][1] + 0.9 * weighted_sum(&before, rows[t + 1])
                - weighted_sum(&before, rows[t]);
            loss += error * error;
            for (w, x) in w.iter_mut().zip(rows[t]) {
                *w += 0.05 / batch.len() as f64 * error * x;
            }
        }
    }
    for (got, expected) in agent.checkpoint.parameters.iter().zip(&w) {
        assert!((f64::from(*got) - expected).abs() < 1e-6, "{got} {expected}");
    }
    assert!((agent.curve[0].training_loss - loss / train.len() as f64).abs() < 1e-6);
    let held_back: Vec<usize> = (44..59).collect();
    let errors = held_back
        .iter()
        .map(|&t| rows[t + 1][1] + 0.9 * weighted_sum(&w, rows[t + 1]) - weighted_sum(&w, rows[t]))
        .map(|error| error * error);
    let expected = errors.sum::<f64>() / 15.0;
    assert!((agent.curve[0].validation_loss - expected).abs() < 1e-6);
    assert_eq!(
        agent.curve[0].validation_rmse, None,
        "the last 44 returns of a segment are cut off"
    );
}

#[test]
fn sensors_together_are_what_they_are_alone_on_any_number_of_threads() {
    let stream = waves(300);
    let traced = AgentConfig { traces: vec![0.5, 0.9], ..mlp(1e-3) };
    for config in [mlp(1e-3), rounded(), linear(0.1), traced] {
        let trained = |threads, sensors: &[usize]| {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| run(&stream, settings(4, 2), &config, sensors, None).expect("trains"))
        };
        let together = trained(1, &[0, 1]);
        assert_eq!(trained(2, &[0, 1]), together);
        assert_eq!([trained(1, &[0]), trained(1, &[1])].concat(), together);
        assert_ne!(together[0].checkpoint, together[1].checkpoint);
    }
}

#[test]
fn patience_keeps_the_best_epoch() {
    let stream = waves(600);
    // The rate is so large that some epochs are worse than the one before.
    let config = mlp(0.05);
    let all = run(&stream, settings(40, 0), &config, &[0], None).expect("trains").remove(0);
    let early = run(&stream, settings(40, 2), &config, &[0], None).expect("trains").remove(0);
    let epochs = early.curve.len();
    assert!(epochs < 40, "it never got worse twice");
    assert_eq!(early.curve, all.curve[..epochs], "stopping changes nothing before it");
    let best = early.curve.iter().min_by(|a, b| a.error().total_cmp(&b.error()));
    assert_eq!((early.epoch, epochs), (best.expect("some").epoch, early.epoch + 2));
    let until = run(&stream, settings(early.epoch, 0), &config, &[0], None).expect("trains");
    assert_eq!(until[0].checkpoint, early.checkpoint);
}

#[test]
fn a_resumed_training_is_the_uninterrupted_one() {
    let stream = waves(400);
    let directory = tempfile::tempdir().expect("a directory");
    for (number, config) in [mlp(0.03), rounded(), linear(0.1)].into_iter().enumerate() {
        let whole = run(&stream, settings(12, 3), &config, &[0, 1], None).expect("trains");
        for after in [1, 4, 7] {
            let path = directory.path().join(format!("{number}-{after}"));
            let file = StateFile::new(path, "key".to_owned());
            let training =
                Pretraining { stream: &stream, settings: settings(12, 3), seed: Seed::new(5) };
            let learners = [0, 1].map(|cumulant| Learner::new(&config, cumulant));
            let transitions: Vec<usize> = (0..132).chain(133..399).collect();
            let (train, validate) = transitions.split_at(298);
            let mut begun = PretrainRun::new(training, &learners, validate);
            for epoch in 0..after {
                let order = shuffled(train, training.seed.child("epoch").number(epoch));
                begun.epoch(&order, 16, &Silent).expect("trains");
            }
            begun.keep(&file).expect("written");
            let resumed = run(&stream, settings(12, 3), &config, &[0, 1], Some(&file));
            assert_eq!(resumed.expect("trains"), whole);
        }
    }
}

#[test]
fn what_cannot_be_trained_says_why() {
    let few = run(&waves(18), settings(50, 0), &mlp(1e-3), &[0], None).expect_err("refused");
    assert!(matches!(few, AgentError::TooFewTransitions { got: 16, expected: 16 }), "{few}");
}

#[test]
fn an_agent_that_diverges_stops_alone() {
    // The third sensor is constant: an agent that starts from zero has nothing to learn, so no rate is too large.
    let values = (0..400).flat_map(|t| [(f64::from(t) * 0.05).sin() as f32, 1.0, 0.0]);
    let states = States::new(values.collect(), 400, 3).expect("valid");
    let stream = RowStream::replay(states, &Segments::from_lengths([400]).expect("valid"));
    let config = linear(50.0);
    let training = Pretraining { stream: &stream, settings: settings(50, 2), seed: Seed::new(5) };
    let start = Checkpoint { parameters: vec![0.0; 4], moments: None };
    let trained = |sensors: &[usize], file: Option<&StateFile>| {
        let learners: Vec<_> = sensors
            .iter()
            .map(|&cumulant| Learner { start: Some(&start), ..Learner::new(&config, cumulant) })
            .collect();
        pretrain(training, &learners, file, &Silent).expect("trains")
    };
    let together = trained(&[0, 2], None);
    let failed = together[0].as_ref().expect_err("it diverges");
    assert!(failed.epoch < 50, "{together:?}");
    let calm = together[1].as_ref().expect("it does not diverge");
    assert_eq!((calm.checkpoint.parameters.as_slice(), calm.epoch), (&[0.0; 4][..], 1));
    assert_eq!(trained(&[2], None)[0].as_ref(), Ok(calm));
}

#[test]
fn traces_are_what_is_learnt_from_here_too() {
    let stream = waves(600);
    let config = AgentConfig { traces: vec![0.9], ..mlp(1e-3) };
    let agent = run(&stream, settings(3, 0), &config, &[0], None).expect("trains").remove(0);
    // Two columns and their traces, twelve units, two layers, one output.
    let layers = [(4, 12), (12, 12), (12, 1)];
    let parameters: usize = layers.iter().map(|(inputs, outputs)| (inputs + 1) * outputs).sum();
    assert_eq!(agent.checkpoint.parameters.len(), parameters);
    let plain = run(&stream, settings(3, 0), &mlp(1e-3), &[0], None).expect("trains").remove(0);
    assert_ne!(agent.curve, plain.curve);
}

#[test]
fn agents_of_several_discount_factors_learn_as_they_do_alone() {
    let stream = waves(400);
    let far = mlp(1e-3);
    let near = AgentConfig { gamma: 0.5, ..mlp(1e-3) };
    let learners =
        [(&far, 0), (&near, 1), (&far, 1)].map(|(config, cumulant)| Learner::new(config, cumulant));
    let training = Pretraining { stream: &stream, settings: settings(3, 0), seed: Seed::new(5) };
    let together = pretrain(training, &learners, None, &Silent).expect("trains");
    for (learner, got) in learners.iter().zip(together) {
        let sensors = [learner.cumulant];
        let alone = run(&stream, settings(3, 0), learner.config, &sensors, None).expect("trains");
        assert_eq!(got.expect("it does not diverge"), alone[0]);
    }
}
