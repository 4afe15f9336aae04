//! One step of a sweep: a population of agents predicts, draws one mini-batch and
//! updates.
//!
//! `cargo bench -p calib-agent --bench td_step`. Throughput is in updates of one agent.

use calib_agent::{AgentConfig, CurveRule, Precision, ValueFunction, train};
use calib_core::{RowIndex, RowStream, Seed, Silent, States};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

const SENSORS: usize = 142;
const BATCH: usize = 256;

/// Returns random states. Their values do not influence the time.
fn stream(steps: usize) -> RowStream {
    let mut rng = Seed::new(1).rng();
    let values = (0..steps * SENSORS).map(|_| rng.unit() as f32).collect();
    let states = States::new(values, steps, SENSORS).expect("finite");
    RowStream::unbroken(states, (0..steps).map(RowIndex::new).collect())
}

/// Returns `size` agents with learning rates from 1e-5 upwards, by half a decade.
fn population(
    size: usize,
    value_function: ValueFunction,
    precision: Precision,
) -> Vec<AgentConfig> {
    (0..size)
        .map(|index| AgentConfig {
            value_function,
            precision,
            learning_rate: 1e-5 * 10_f64.powf(0.5 * index as f64),
            gamma: 0.9,
            batch_size: BATCH,
            ..AgentConfig::default()
        })
        .collect()
}

fn bench(
    criterion: &mut Criterion,
    value_function: ValueFunction,
    precision: Precision,
    updates: usize,
) {
    let name = match (value_function, precision) {
        (ValueFunction::Mlp, Precision::F32) => "td 142-256-256-1, batch 256",
        (ValueFunction::Mlp, Precision::Bf16) => "td 142-256-256-1, batch 256, bf16",
        (ValueFunction::Linear, _) => "td linear 142, batch 256",
    };
    let mut group = criterion.benchmark_group(name);
    group.sample_size(10);
    let stream = stream(BATCH + updates);
    for size in [1, 9] {
        let agents = population(size, value_function, precision);
        group.throughput(Throughput::Elements((size * updates) as u64));
        group.bench_function(BenchmarkId::new("agents", size), |bencher| {
            bencher.iter(|| {
                let curve = CurveRule::default();
                train(&stream, 0, &agents, curve, Seed::new(1), &Silent).expect("trains")
            });
        });
    }
    group.finish();
}

fn mlp(criterion: &mut Criterion) {
    bench(criterion, ValueFunction::Mlp, Precision::F32, 300);
    bench(criterion, ValueFunction::Mlp, Precision::Bf16, 300);
}

fn linear(criterion: &mut Criterion) {
    bench(criterion, ValueFunction::Linear, Precision::F32, 2_000);
}

criterion_group!(benches, mlp, linear);
criterion_main!(benches);
