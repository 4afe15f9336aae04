//! Measures updates per second of Laplacian training on one thread, to compare with other
//! implementations. Prints one line of JSON.
//!
//!     cargo run --release -p calib-represent --example train_speed -- [COLUMNS [BATCH [UPDATES]]]
//!
//! One update draws BATCH pairs and BATCH independent states, and passes 3 × BATCH rows forward through
//! COLUMNS-256-256-64. Then it computes the loss and the backward pass, and takes a step of Adam.

#![expect(clippy::print_stdout, reason = "the figure is what it is for")]
#![expect(clippy::disallowed_methods, reason = "it measures time")]

use std::time::Instant;

use calib_core::{Seed, Segments, States};
use calib_represent::{LaplacianConfig, Split, Training};

fn main() {
    let mut numbers = std::env::args().skip(1).map(|text| text.parse().expect("a whole number"));
    let [columns, batch_size, updates] =
        [142, 256, 1_000].map(|default: usize| numbers.next().unwrap_or(default));
    let rows = 20_000;
    let mut rng = Seed::new(1).rng();
    let values = (0..rows * columns).map(|_| rng.unit() as f32).collect();
    let states = States::new(values, rows, columns).expect("finite");
    let segments = Segments::from_lengths([rows]).expect("not empty");
    let split = Split::in_time(&segments).expect("long enough");
    let config = LaplacianConfig { batch_size, ..LaplacianConfig::default() };
    let mut training =
        Training::new(&config, &states, &segments, &split, Seed::new(2)).expect("valid");
    for _ in 0..50 {
        training.step();
    }
    let start = Instant::now();
    let mut loss = 0.0;
    for _ in 0..updates {
        loss = training.step().total;
    }
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{{\"threads\": 1, \"columns\": {columns}, \"batch_size\": {batch_size}, \"rows_a_step\": {}, \
         \"updates\": {updates}, \"seconds\": {seconds}, \"updates_per_second\": {}, \"loss\": {loss}}}",
        3 * batch_size,
        updates as f64 / seconds,
    );
}
