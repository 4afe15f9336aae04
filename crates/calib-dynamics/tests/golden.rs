//! Tests predictions and gradients against PyTorch: `scripts/golden/gru.py`.

use calib_dynamics::{Dynamics as _, FeedForward, LANES};
use calib_nn::{Adam, AdamRule, Mlp, Workspace};
use serde::Deserialize;

/// PyTorch's own single precision is within 3e-8 for predictions and gradients, 1.1e-7 after Adam.
const TOLERANCE: f64 = 5e-7;

#[derive(Deserialize)]
struct Golden {
    columns: usize,
    steps: usize,
    /// The states, `[sequences][length + 1][columns]`.
    states: Vec<Vec<Vec<f32>>>,
    nn_sizes: Vec<usize>,
    nn_parameters: Vec<f32>,
    nn: NnCase,
}

#[derive(Deserialize)]
struct NnCase {
    /// The predictions, `[sequences * length][columns]`.
    predictions: Vec<Vec<f64>>,
    loss: f64,
    gradients: Vec<f64>,
    parameters_after: Vec<f64>,
}

fn assert_close(what: &str, got: &[f32], expected: &[f64]) {
    assert_eq!(got.len(), expected.len(), "{what}");
    for (index, (got, expected)) in got.iter().zip(expected).enumerate() {
        let difference = (f64::from(*got) - expected).abs();
        assert!(difference < TOLERANCE, "{what} {index}: {got}, expected {expected}");
    }
}

#[test]
fn a_feed_forward_network_learns_as_in_pytorch() {
    let golden: Golden = serde_json::from_str(include_str!("golden/dynamics.json")).expect("reads");
    let network = Mlp::from_parameters(&golden.nn_sizes, &golden.nn_parameters).expect("fits");
    let inputs: Vec<f32> =
        golden.states.iter().flat_map(|sequence| sequence[..sequence.len() - 1].concat()).collect();
    let targets: Vec<f32> =
        golden.states.iter().flat_map(|sequence| sequence[1..].concat()).collect();
    let rows = inputs.len() / golden.columns;

    let model = FeedForward::new(network.clone()).expect("states to states");
    let mut rollouts = model.begin_rollouts().expect("it runs");
    let mut next = vec![0.0; LANES * golden.columns];
    rollouts.step(&inputs[..LANES * golden.columns], &mut next).expect("a step");
    assert_close("prediction", &next, &golden.nn.predictions[..LANES].concat());

    let mut network = network;
    let mut workspace = Workspace::new(&network, rows);
    let mut adam = Adam::new(
        AdamRule { learning_rate: 1e-2, ..AdamRule::default() },
        network.parameter_count(),
    );
    for step in 0..golden.steps {
        let outputs = network.forward(&inputs, &mut workspace);
        let errors: Vec<f32> = outputs.iter().zip(&targets).map(|(a, b)| a - b).collect();
        let count = errors.len() as f64;
        let loss = errors.iter().map(|&error| f64::from(error).powi(2)).sum::<f64>() / count;
        let slopes: Vec<f32> = errors.iter().map(|error| 2.0 * error / count as f32).collect();
        let gradients = network.backward(&inputs, &slopes, &mut workspace);
        if step == 0 {
            assert!((loss - golden.nn.loss).abs() < TOLERANCE, "{loss}");
            assert_close("gradient", gradients, &golden.nn.gradients);
        }
        adam.step(network.parameters_mut(), gradients);
    }
    assert_close("parameter", network.parameters(), &golden.nn.parameters_after);
}
