//! Measures updates per second of value networks that train side by side, to compare with other implementations. Prints one line of JSON.
//!
//!     bash scripts/libtorch.sh cargo run --release -p calib-torch --features libtorch --example populations_speed -- cpu|cuda|native [RUNS [LEARNERS [STEPS]]]
//!
//! Each of RUNS streams of 142 sensors has LEARNERS networks 142-256-256-1, each with its own learning rate, with mini-batches of 256
//! transitions and Adam. `native` trains one run after the other on one thread, without libtorch.

#![expect(clippy::print_stdout, reason = "the figure is what it is for")]
#![expect(clippy::disallowed_methods, reason = "it measures time")]

use std::time::Instant;

use calib_agent::{AgentConfig, CurveRule, Learner, NoKeeper, Run, train_learners, train_together};
use calib_core::{RowStream, Seed, Segments, Silent, States};
use calib_torch::{Populations, device};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let place = arguments.next().unwrap_or_else(|| "cpu".to_owned());
    let mut next =
        |default| arguments.next().map_or(default, |text| text.parse().expect("a whole number"));
    let runs = next(4_usize);
    let learners = next(9_usize);
    let steps = next(200_usize);
    let columns = 142;
    let batch = 256;
    let streams: Vec<RowStream> = (0..runs)
        .map(|run| {
            let rows = batch + steps + 200;
            let mut rng = Seed::new(1).number(run as u64).rng();
            let values = (0..rows * columns).map(|_| rng.unit() as f32).collect();
            let states = States::new(values, rows, columns).expect("finite");
            RowStream::replay(states, &Segments::from_lengths([rows]).expect("one"))
        })
        .collect();
    let agents: Vec<AgentConfig> = (0..learners)
        .map(|number: usize| AgentConfig {
            gamma: 0.9,
            batch_size: batch,
            learning_rate: 1e-6 * 10_f64.powf(0.5 * (number % 9) as f64),
            ..AgentConfig::default()
        })
        .collect();
    let all: Vec<Learner<'_>> = agents.iter().map(|config| Learner::new(config, 0)).collect();
    let choice = if place == "native" { "cpu" } else { &place };
    let choice = choice.parse().expect("cpu, cuda or native");
    let populations = Populations::new(device(choice).expect("it is there"));
    let train = |updates: usize| {
        let start = Instant::now();
        let runs: Vec<Run<'_>> = streams
            .iter()
            .map(|stream| Run {
                stream,
                steps: batch - 1 + updates,
                curve: CurveRule::default(),
                seed: Seed::new(2),
            })
            .collect();
        if place == "native" {
            for run in &runs {
                train_learners(*run, &all, &NoKeeper, &Silent).expect("trains");
            }
        } else {
            train_together(&runs, &all, &populations, &Silent).expect("trains");
        }
        start.elapsed().as_secs_f64()
    };
    // The difference contains only updates. Both runs predict as long before them, and move as much to the device.
    let less = steps / 4;
    train(less);
    let seconds = train(steps) - train(less);
    let networks = runs * learners;
    println!(
        "{{\"place\": \"{place}\", \"networks\": {networks}, \"seconds\": {seconds}, \"updates_per_second\": {}}}",
        (networks * (steps - less)) as f64 / seconds,
    );
}
