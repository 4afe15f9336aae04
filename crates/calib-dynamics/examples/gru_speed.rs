//! Measures updates per second of GRU training on one thread, to compare with other implementations. Prints one line of JSON.
//!
//!     RAYON_NUM_THREADS=1 cargo run --release -p calib-dynamics --example gru_speed -- [UNITS [BATCH [UPDATES]]]
//!
//! One update passes BATCH sequences of 20 states of 142 columns through two layers of UNITS and a linear head. It computes the mean
//! squared error of every next state and the gradient through the whole sequence, and takes a step of Adam.

#![expect(clippy::print_stdout, reason = "the figure is what it is for")]
#![expect(clippy::disallowed_methods, reason = "it measures time")]

use std::time::Instant;

use calib_core::{Seed, Segments, States, Transitions};
use calib_dynamics::{DynamicsConfig, RecurrentTrainer, Transitioning};

const COLUMNS: usize = 142;

fn main() {
    let mut numbers = std::env::args().skip(1).map(|text| text.parse().expect("a whole number"));
    let hidden_units = numbers.next().unwrap_or(512_usize);
    let batch_size = numbers.next().unwrap_or(256);
    let updates = numbers.next().unwrap_or(4);
    let rows = 20 * batch_size + 200;
    let mut rng = Seed::new(1).rng();
    let values = (0..rows * COLUMNS).map(|_| rng.unit() as f32).collect();
    let states = States::new(values, rows, COLUMNS).expect("finite");
    let transitions = Transitions::new(Segments::from_lengths([rows]).expect("not empty"));
    let data = Transitioning::new(&states, &transitions, 0.1).expect("long enough");
    let config = DynamicsConfig {
        hidden_units,
        hidden_layers: 2,
        batch_size,
        sequence_length: 20,
        ..DynamicsConfig::default()
    };
    let mut training = RecurrentTrainer::new(&data, &config, Seed::new(2)).expect("valid");
    let batch: Vec<u32> = (0..batch_size as u32).map(|sequence| 17 * sequence).collect();
    training.update(&batch);
    let start = Instant::now();
    let mut loss = 0.0;
    for _ in 0..updates {
        loss = training.update(&batch);
    }
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{{\"units\": {hidden_units}, \"batch\": {batch_size}, \"seconds\": {seconds}, \"updates_per_second\": {}, \"loss\": {loss}}}",
        updates as f64 / seconds,
    );
}
