//! Compares updates with PyTorch's from the same weights and mini-batches: `scripts/golden/td0.py`.

use std::collections::BTreeMap;

use calib_core::{RowIndex, RowStream, Seed, States};
use serde::Deserialize;

use crate::{
    AgentConfig, Checkpoint, Learner, Precision, ValueFunction,
    checkpointer::ValueState,
    linear::LinearValues,
    mlp::MlpValues,
    values::{Batch, Learned, Values},
};

/// Values are about 3. PyTorch's own single precision deviates by up to 3.2e-6 from the double precision in
/// the file.
const TOLERANCE: f64 = 2e-5;

/// The tolerance for products in bfloat16, which has eight significant bits.
const ROUNDED_TOLERANCE: f64 = 0.05;

#[derive(Deserialize)]
struct Golden {
    cumulant: usize,
    /// `[steps][sensors]`.
    states: Vec<Vec<f32>>,
    sizes: BTreeMap<String, Vec<usize>>,
    /// Initial parameters, by the name of the value function.
    parameters: BTreeMap<String, Vec<f32>>,
    /// The step at which each transition of an update starts.
    batches: Vec<Vec<usize>>,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    agent: AgentConfig,
    /// Predictions `v(s_n)` before update n.
    predictions: Vec<f64>,
    /// Parameters after the last update.
    parameters: Vec<f64>,
}

/// Returns the predictions before each update and the parameters after the last, in the file's order.
fn trained(golden: &Golden, config: &AgentConfig) -> (Vec<f32>, Vec<f32>) {
    let steps = golden.states.len();
    let width = golden.states[0].len();
    let states = States::new(golden.states.concat(), steps, width).expect("valid");
    let stream = RowStream::unbroken(states, (0..steps).map(RowIndex::new).collect());
    let learners = [Learner::new(config, golden.cumulant)];
    let (name, mut values): (_, Box<dyn Values>) = match config.value_function {
        ValueFunction::Mlp => {
            let values = MlpValues::new(&learners, &stream, config.batch_size, Seed::new(1));
            ("mlp", Box::new(values))
        }
        ValueFunction::Linear => {
            ("linear", Box::new(LinearValues::new(&learners, &stream, Seed::new(1))))
        }
    };
    let parameters = golden.parameters[name].clone();
    values.restore(0, &ValueState::from(&Checkpoint { parameters, moments: None }));
    let predictions = golden
        .batches
        .iter()
        .enumerate()
        .map(|(number, starts)| {
            let mut learned = [Learned::default()];
            let batch = Batch { stream: &stream, starts, present: Some(number) };
            values.learn(batch, &[0], &mut learned);
            learned[0].prediction.expect("asked for")
        })
        .collect();
    (predictions, values.state(0).checkpoint.parameters)
}

fn assert_close(what: &str, got: &[f32], expected: &[f64], tolerance: f64, agent: &AgentConfig) {
    assert_eq!(got.len(), expected.len());
    for (index, (got, expected)) in got.iter().zip(expected).enumerate() {
        let difference = (f64::from(*got) - expected).abs();
        assert!(difference < tolerance, "{what} {index}: {got}, expected {expected}: {agent:?}");
    }
}

#[test]
fn sixty_updates_are_those_of_pytorch() {
    let golden: Golden =
        serde_json::from_str(include_str!("../tests/golden/td0.json")).expect("reads");
    assert_eq!((golden.batches.len(), golden.cases.len()), (60, 10));
    for Case { agent, predictions, parameters } in &golden.cases {
        assert_eq!(golden.sizes["mlp"][1..3], [agent.hidden_units; 2]);
        assert_eq!(agent.batch_size, golden.batches[0].len());
        let (our_predictions, our_parameters) = trained(&golden, agent);
        assert_close("prediction", &our_predictions, predictions, TOLERANCE, agent);
        assert_close("parameter", &our_parameters, parameters, TOLERANCE, agent);
    }
}

#[test]
fn rounded_products_stay_near_those_of_pytorch() {
    let golden: Golden =
        serde_json::from_str(include_str!("../tests/golden/td0.json")).expect("reads");
    let networks =
        golden.cases.iter().filter(|case| case.agent.value_function == ValueFunction::Mlp);
    for Case { agent, predictions, .. } in networks {
        let agent = AgentConfig { precision: Precision::Bf16, ..agent.clone() };
        let (ours, _) = trained(&golden, &agent);
        assert_close("prediction", &ours, predictions, ROUNDED_TOLERANCE, &agent);
    }
}
