use calib_core::{Segments, Silent, States, Transitions};

use super::*;
use crate::Keep;

/// Returns a rotation by a fixed angle: the next state is a linear function of the state.
fn rotation(rows: usize) -> (States, Transitions) {
    let values = (0..rows).flat_map(|t| [(t as f32 * 0.3).sin(), (t as f32 * 0.3).cos()]).collect();
    let states = States::new(values, rows, 2).expect("finite");
    (states, Transitions::new(Segments::from_lengths([rows / 2, rows - rows / 2]).expect("valid")))
}

fn config(epochs: usize) -> DynamicsConfig {
    DynamicsConfig { hidden_units: 24, batch_size: 100, epochs, ..DynamicsConfig::default() }
}

fn trained(epochs: usize, threads: usize) -> Tensors {
    let (states, transitions) = rotation(700);
    let data = Transitioning::new(&states, &transitions, 0.2).expect("enough");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let mut trainer = FeedForwardTrainer::new(&data, &config(epochs), Seed::new(3));
        while !trainer.record().is_complete(&config(epochs)) {
            trainer.epoch(&Silent).expect("finite");
        }
        trainer.checkpoint().expect("native")
    })
}

#[test]
fn a_linear_map_is_learnt() {
    let (states, transitions) = rotation(700);
    let data = Transitioning::new(&states, &transitions, 0.2).expect("enough");
    let config = config(60);
    let mut trainer = FeedForwardTrainer::new(&data, &config, Seed::new(3));
    assert_eq!(trainer.updates_per_epoch(), 6);
    while !trainer.record().is_complete(&config) {
        trainer.epoch(&Silent).expect("finite");
    }
    let record = trainer.record().clone();
    assert_eq!(record.updates, 360);
    let first = record.epochs[0].validation;
    let last = record.epochs[59].validation;
    assert!(last < 1e-3 && last < first / 100.0, "{first} {last}");
    let model = trainer.model();
    assert_eq!(
        FeedForward::from_tensors(&trainer.weights().expect("native")).expect("fits"),
        model
    );
}

#[test]
fn the_gradient_is_that_of_the_loss() {
    let (states, transitions) = rotation(100);
    let data = Transitioning::new(&states, &transitions, 0.2).expect("enough");
    let config = DynamicsConfig { learning_rate: 1.0, ..config(1) };
    let batch: Vec<u32> = (0..70).collect();
    let mut trainer = FeedForwardTrainer::new(&data, &config, Seed::new(8));
    trainer.squared_error(&batch, Some(2.0 / (2 * batch.len()) as f32));
    let [first, second] = &mut trainer.halves;
    let gradients: Vec<f32> = first
        .workspace
        .gradients_mut()
        .iter()
        .zip(second.workspace.gradients_mut())
        .map(|(a, b)| *a + *b)
        .collect();
    for parameter in [0, 13, 47, 80, 300, 650, gradients.len() - 1] {
        let step = 1e-2_f32;
        let [above, below] = [step, -step].map(|offset| {
            trainer.parameters[parameter] += offset;
            let loss = trainer.squared_error(&batch, None) / (2 * batch.len()) as f64;
            trainer.parameters[parameter] -= offset;
            loss
        });
        let slope = (above - below) / f64::from(2.0 * step);
        let got = f64::from(gradients[parameter]);
        assert!((slope - got).abs() < 2e-3 * (1.0 + slope.abs()), "{parameter}: {got} {slope}");
    }
}

#[test]
fn threads_change_no_bit() {
    assert_eq!(trained(3, 1), trained(3, 3));
}

#[test]
fn put_aside_and_resumed_is_the_same_to_the_bit() {
    let (states, transitions) = rotation(700);
    let data = Transitioning::new(&states, &transitions, 0.2).expect("enough");
    let config = config(5);
    let seed = Seed::new(3);
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("checkpoint.safetensors");
    let mut checkpoint = None;
    for _ in 0..5 {
        let mut trainer = match &checkpoint {
            None => FeedForwardTrainer::new(&data, &config, seed),
            Some(found) => {
                FeedForwardTrainer::new(&data, &config, seed).resumed(found).expect("ours")
            }
        };
        trainer.epoch(&Silent).expect("finite");
        calib_files::write_tensors(&path, &trainer.checkpoint().expect("native")).expect("written");
        checkpoint = Some(calib_files::read_tensors(&path).expect("readable"));
    }
    let resumed = checkpoint.expect("five epochs");
    let mut whole = trained(5, 2);
    whole.tensors.sort_by(|a, b| a.name.cmp(&b.name));
    assert_eq!(resumed, whole);
    let other = DynamicsConfig { hidden_units: 25, ..config };
    let error = FeedForwardTrainer::new(&data, &other, seed).resumed(&resumed).expect_err("wider");
    assert!(error.to_string().contains("another network"), "{error}");
}

#[test]
fn steps_that_are_too_large_are_an_error() {
    let (states, transitions) = rotation(300);
    let data = Transitioning::new(&states, &transitions, 0.2).expect("enough");
    let config = DynamicsConfig { learning_rate: 1e18, keep: Keep::Last, ..config(9) };
    let mut trainer = FeedForwardTrainer::new(&data, &config, Seed::new(3));
    let mut result = Ok(());
    for _ in 0..9 {
        result = result.and_then(|()| trainer.epoch(&Silent).map(|_| ()));
    }
    assert!(matches!(result, Err(DynamicsError::Diverged { .. })), "{result:?}");
}
