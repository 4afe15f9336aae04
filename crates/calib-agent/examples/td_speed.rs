//! Measures the TD(0) updates per second of a population on one thread, beside the bare matrix products of such an
//! update. The result is one line of JSON; `scripts/peers/td0.py` compares it with other packages.
//!
//! ```text
//! td_speed mlp|mlp-bf16|linear AGENTS UPDATES
//! ```
//!
//! Shapes are those of the paper: 142 sensors, two hidden layers of 256 units, batches of 256. One update is the update
//! of one agent.

#![expect(clippy::print_stdout, reason = "a program prints")]
#![expect(clippy::disallowed_methods, reason = "a program that measures reads the clock")]

use std::{env, error::Error, fs, hint::black_box, time::Instant};

use calib_agent::{AgentConfig, CurveRule, Precision, ValueFunction, train};
use calib_core::{RowIndex, RowStream, Seed, Silent, States};
use calib_nn::{Matrix, multiply};

const SENSORS: usize = 142;
const UNITS: usize = 256;
const BATCH: usize = 256;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [kind, agents, updates] = arguments.as_slice() else {
        // `cargo test` and `cargo bench` run examples without arguments.
        println!("td_speed mlp|mlp-bf16|linear AGENTS UPDATES");
        return Ok(());
    };
    let (value_function, precision) = match kind.as_str() {
        "mlp" => (ValueFunction::Mlp, Precision::F32),
        "mlp-bf16" => (ValueFunction::Mlp, Precision::Bf16),
        "linear" => (ValueFunction::Linear, Precision::F32),
        other => return Err(format!("mlp, mlp-bf16 or linear, got {other}").into()),
    };
    let (agents, updates): (usize, usize) = (agents.parse()?, updates.parse()?);
    let population: Vec<AgentConfig> = (0..agents)
        .map(|index| AgentConfig {
            value_function,
            precision,
            hidden_units: UNITS,
            learning_rate: 1e-6 * 10_f64.powf(0.5 * index as f64),
            gamma: 0.9,
            batch_size: BATCH,
            ..AgentConfig::default()
        })
        .collect();
    run(&population, updates.min(50))?;
    let [wall, processor] =
        run(&population, updates)?.map(|seconds| (agents * updates) as f64 / seconds);
    let (flops, seconds) = products((agents * updates).clamp(100, 1_000));
    let gflops = flops / seconds / 1e9;
    println!(
        "{{\"updates_per_second\": {wall}, \"updates_per_processor_second\": {processor}, \
         \"gemm_gflops\": {gflops}, \"gemm_updates_per_second\": {}}}",
        1.0 / seconds
    );
    Ok(())
}

/// Trains a population, and returns the wall and processor seconds.
fn run(population: &[AgentConfig], updates: usize) -> Result<[f64; 2], Box<dyn Error>> {
    let stream = stream(BATCH + updates)?;
    let curve = CurveRule::default();
    let clock = Clock::start();
    let outcomes = train(&stream, 0, population, curve, Seed::new(1), &Silent)?;
    black_box(outcomes);
    Ok(clock.seconds())
}

/// The start of a measurement in wall time and processor time.
struct Clock(Instant, Option<f64>);

impl Clock {
    fn start() -> Self {
        Self(Instant::now(), processor_seconds())
    }

    /// Returns the elapsed wall and processor seconds. Where the system does not report processor time, both are wall
    /// time.
    fn seconds(&self) -> [f64; 2] {
        let wall = self.0.elapsed().as_secs_f64();
        let processor = self.1.zip(processor_seconds()).map(|(before, after)| after - before);
        [wall, processor.unwrap_or(wall)]
    }
}

/// Returns the processor time of this thread so far, as Linux counts it.
fn processor_seconds() -> Option<f64> {
    let text = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split(' ').next()?.parse::<f64>().ok()? / 1e9)
}

/// Returns random states. Their values do not influence the time.
fn stream(steps: usize) -> Result<RowStream, Box<dyn Error>> {
    let mut rng = Seed::new(1).rng();
    let values = (0..steps * SENSORS).map(|_| rng.unit() as f32).collect();
    let states = States::new(values, steps, SENSORS)?;
    Ok(RowStream::unbroken(states, (0..steps).map(RowIndex::new).collect()))
}

/// Returns the operations and processor seconds of the five large products of one update: the forward pass of both
/// layers for s, s' and the present state, the weight gradients of both layers, and the error of the first.
fn products(repeats: usize) -> (f64, f64) {
    let rows = 2 * BATCH + 1;
    let ones = vec![1.0_f32; rows * UNITS];
    let mut out = vec![0.0_f32; rows * UNITS];
    let shapes = [
        (rows, SENSORS, UNITS),
        (rows, UNITS, UNITS),
        (SENSORS, BATCH, UNITS),
        (UNITS, BATCH, UNITS),
        (BATCH, UNITS, UNITS),
    ];
    let flops: usize = shapes.iter().map(|(m, k, n)| 2 * m * k * n).sum();
    multiply_all(&shapes, &ones, &mut out);
    let clock = Clock::start();
    for _ in 0..repeats {
        multiply_all(&shapes, &ones, &mut out);
    }
    let [_, processor] = clock.seconds();
    (flops as f64, processor / repeats as f64)
}

/// Makes the products of these rows, inner dimensions and columns.
fn multiply_all(shapes: &[(usize, usize, usize); 5], ones: &[f32], out: &mut [f32]) {
    for (index, &(m, k, n)) in shapes.iter().enumerate() {
        let left = match index {
            2 | 3 => Matrix::new(&ones[..m * k], k, m).transposed(),
            _ => Matrix::new(&ones[..m * k], m, k),
        };
        let right = match index {
            4 => Matrix::new(&ones[..k * n], n, k).transposed(),
            _ => Matrix::new(&ones[..k * n], k, n),
        };
        multiply(&mut out[..m * n], left, right);
    }
    black_box(out[0]);
}
