//! Benchmarks of a study on a simulated morning, stage by stage. Kernels have benches in the
//! packages that own them.

use std::hint::black_box;

use calib_agent::{AgentConfig, CurveRule, train};
use calib_core::{Period, Seed, Segments, Silent, States, Transitions};
use calib_knn::{KnnModel, ModelConfig, Weights};
use calib_model::{StartSource, rollout, start_states};
use calib_plant::{Plant, PlantOptions};
use criterion::{Criterion, criterion_group, criterion_main};

const ROWS: usize = 4000;

/// Returns some hours of a plant, with every column scaled to [0, 1].
fn states() -> States {
    let options = PlantOptions {
        channels: 24,
        days: 0.5,
        period: Period::from_secs(10.0).expect("positive"),
        gaps_per_day: 0.0,
        ..PlantOptions::default()
    };
    let day = Plant::new(options).expect("valid").next().expect("a day");
    let columns: Vec<Vec<f32>> = day.columns.iter().filter_map(|column| scaled(column)).collect();
    let values = (0..ROWS).flat_map(|row| columns.iter().map(move |column| column[row])).collect();
    States::new(values, ROWS, columns.len()).expect("finite")
}

fn scaled(column: &[f32]) -> Option<Vec<f32>> {
    let known = column.iter().copied().filter(|value| value.is_finite());
    let (low, high) =
        known.fold((f32::MAX, f32::MIN), |(low, high), value| (low.min(value), high.max(value)));
    (high > low).then(|| {
        column
            .iter()
            .map(|value| if value.is_finite() { (value - low) / (high - low) } else { 0.0 })
            .collect()
    })
}

fn study(criterion: &mut Criterion) {
    let states = states();
    let transitions = Transitions::new(Segments::from_lengths([ROWS]).expect("valid"));
    let config = ModelConfig { exclude_self: true, theiler: 6, ..ModelConfig::default() };
    let build =
        || KnnModel::build(states.clone(), transitions.clone(), &config, &Silent).expect("built");
    let mut group = criterion.benchmark_group("study");
    group.sample_size(10);
    group.bench_function("build model, 4,000 rows", |bencher| bencher.iter(&build));

    let model = build();
    let member = model.member(0);
    let seed = Seed::new(1);
    let starts = start_states(&member, StartSource::Random, 1, seed).expect("a start");
    let roll = |steps| rollout(&member, &starts[0], steps, Weights::Linear, seed);
    group.bench_function("roll out 10,000 steps", |bencher| {
        bencher.iter(|| roll(black_box(10_000)));
    });

    let stream = roll(1000).stream(&states);
    let agents: Vec<AgentConfig> = [1e-5, 1e-4, 1e-3]
        .map(|learning_rate| AgentConfig {
            learning_rate,
            hidden_units: 64,
            batch_size: 32,
            ..AgentConfig::default()
        })
        .to_vec();
    group.bench_function("train 3 values for 1,000 steps", |bencher| {
        bencher.iter(|| {
            let curve = CurveRule { windows: 10 };
            train(&stream, 0, &agents, curve, seed, &Silent).expect("trained")
        });
    });
}

criterion_group!(benches, study);
criterion_main!(benches);
