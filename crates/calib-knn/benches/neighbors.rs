//! Tables of all members by each search structure, by dimension and by the structure of the data.
//!
//! `uniform` fills its cube, `plant` has a few slow factors with modes, sensor noise and quantisation, like logs of
//! a plant, `gaussian` has nothing that could be ruled out. In test mode everything is small.

use std::f64::consts::TAU;

use calib_core::{Rng, Seed, Segments, Silent, States, Transitions};
use calib_knn::{Blocks, Exclusion, IndexKind, build_tables};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

fn uniform(rows: usize, columns: usize) -> States {
    let mut rng = Seed::new(1).rng();
    let values = (0..rows * columns).map(|_| rng.unit() as f32).collect();
    States::new(values, rows, columns).expect("valid")
}

fn gaussian(rows: usize, columns: usize) -> States {
    let mut rng = Seed::new(2).rng();
    let values = (0..rows * columns).map(|_| rng.normal() as f32).collect();
    States::new(values, rows, columns).expect("valid")
}

/// Ten slow factors, one with the period of a day, and a mode that shifts every sensor.
fn plant(rows: usize, columns: usize) -> States {
    const FACTORS: usize = 10;
    let mut rng = Seed::new(3).rng();
    let mut normals = |count: usize| -> Vec<f64> { (0..count).map(|_| rng.normal()).collect() };
    let (loadings, shifts) = (normals(FACTORS * columns), normals(3 * columns));
    let mut factors = normals(FACTORS);
    let step = |factors: &mut [f64], row: usize, rng: &mut Rng| {
        for (number, factor) in factors.iter_mut().enumerate().skip(1) {
            let memory = 1.0 - 0.01 / number as f64;
            *factor = memory * *factor + (1.0 - memory * memory).sqrt() * rng.normal();
        }
        factors[0] = 2.0 * (TAU * row as f64 / 8640.0).sin();
    };
    let mut rng = Seed::new(4).rng();
    let mut values = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        step(&mut factors, row, &mut rng);
        let mode = row / 180 % 3;
        for column in 0..columns {
            let mixed: f64 =
                (0..FACTORS).map(|f| factors[f] * loadings[f * columns + column]).sum();
            let value = mixed + 3.0 * shifts[mode * columns + column] + 0.02 * rng.normal();
            values.push(((value * 50.0).round() / 1000.0) as f32);
        }
    }
    States::new(values, rows, columns).expect("valid")
}

fn build(states: &States, kind: IndexKind, exclusion: Exclusion) {
    let transitions = Transitions::new(Segments::from_lengths([states.rows()]).expect("valid"));
    let blocks = Blocks::new(&transitions, 5).expect("valid");
    build_tables(states, &transitions, &blocks, 3, exclusion, kind, &Silent).expect("built");
}

fn testing() -> bool {
    std::env::args().any(|argument| argument == "--test")
}

fn by_dimension(criterion: &mut Criterion) {
    let rows = if testing() { 500 } else { 20_000 };
    let mut group = criterion.benchmark_group("by dimension");
    group.sample_size(10).throughput(Throughput::Elements(rows as u64));
    for columns in [2, 3, 4, 8, 16, 64, 142] {
        for (name, states) in [("uniform", uniform(rows, columns)), ("plant", plant(rows, columns))]
        {
            for kind in [IndexKind::KdTree, IndexKind::Join, IndexKind::Scan] {
                if kind == IndexKind::KdTree && columns > 8 {
                    continue;
                }
                let id = BenchmarkId::new(format!("{name} {kind:?}"), columns);
                group.bench_function(id, |bench| {
                    bench.iter(|| build(&states, kind, Exclusion::default()));
                });
            }
        }
    }
    group.finish();
}

fn by_rows(criterion: &mut Criterion) {
    let sizes: &[usize] = if testing() { &[500] } else { &[25_000, 50_000, 100_000, 200_000] };
    let mut group = criterion.benchmark_group("by rows, 142 columns");
    group.sample_size(10);
    for &rows in sizes {
        group.throughput(Throughput::Elements(rows as u64));
        let states = plant(rows, 142);
        for (name, theiler) in [("plant", 0), ("plant, theiler 60", 60)] {
            let exclusion =
                Exclusion { theiler: theiler.min(rows as u32 / 20), ..Exclusion::default() };
            group.bench_function(BenchmarkId::new(name, rows), |bench| {
                bench.iter(|| build(&states, IndexKind::Auto, exclusion));
            });
        }
        if rows <= 25_000 {
            let states = gaussian(rows, 142);
            group.bench_function(BenchmarkId::new("gaussian", rows), |bench| {
                bench.iter(|| build(&states, IndexKind::Auto, Exclusion::default()));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, by_dimension, by_rows);
criterion_main!(benches);
