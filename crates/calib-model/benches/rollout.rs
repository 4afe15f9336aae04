//! Steps per second of one rollout on one core, from a table whose rows are scattered in memory.

use std::hint::black_box;

use calib_core::{Seed, Segments, Silent, States, Transitions};
use calib_knn::{KnnModel, ModelConfig, Weights};
use calib_model::{StartSource, rollout, start_states};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

const STEPS: usize = 100_000;

/// States without structure on a line: neighbours are scattered, so every step misses the
/// caches.
fn scattered(rows: usize) -> KnnModel {
    let mut rng = Seed::new(1).rng();
    let states =
        States::new((0..rows).map(|_| rng.unit() as f32).collect(), rows, 1).expect("valid");
    let transitions = Transitions::new(Segments::from_lengths([rows]).expect("valid"));
    KnnModel::build(states, transitions, &ModelConfig::default(), &Silent).expect("built")
}

fn rollouts(criterion: &mut Criterion) {
    // A pass in test mode should be quick; a measurement should not fit in a cache.
    let testing = std::env::args().any(|argument| argument == "--test");
    let rows = if testing { 2_000 } else { 3_200_000 };
    let model = scattered(rows);
    let member = model.member(0);
    let start =
        start_states(&member, StartSource::Random, 1, Seed::new(1)).expect("a start").remove(0);
    let mut group = criterion.benchmark_group("rollout");
    group.throughput(Throughput::Elements(STEPS as u64)).sample_size(10);
    for (name, weights) in [("linear", Weights::Linear), ("uniform", Weights::Uniform)] {
        group.bench_function(BenchmarkId::new(name, rows), |bench| {
            bench.iter(|| rollout(&member, black_box(&start), STEPS, weights, Seed::new(2)));
        });
    }
    group.finish();
}

criterion_group!(benches, rollouts);
criterion_main!(benches);
