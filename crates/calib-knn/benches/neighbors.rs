//! Builds the tables of all members with each search structure, by dimension and by the structure of the data.
//!
//! `uniform` fills its cube. `plant` is like the log of a plant: a few slow factors with modes, sensor noise and quantisation.
//! In `gaussian` no source can be ruled out unseen. `by shape` has data that break simple rules: long standstills, copies,
//! constant columns, extreme values, small members, and as many neighbours as there are. In test mode all data are small. The
//! bench `choice` measures the table by which `"auto"` chooses.

mod data;

use calib_core::{Seed, Segments, Silent, States, Transitions};
use calib_knn::{Blocks, Exclusion, IndexKind, build_tables};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use data::{plant, uniform};

fn gaussian(rows: usize, columns: usize) -> States {
    let mut rng = Seed::new(2).rng();
    let values = (0..rows * columns).map(|_| rng.normal() as f32).collect();
    States::new(values, rows, columns).expect("valid")
}

fn build(states: &States, kind: IndexKind, exclusion: Exclusion) {
    build_of(states, (5, 3), kind, exclusion);
}

fn build_of(states: &States, (members, k): (usize, usize), kind: IndexKind, exclusion: Exclusion) {
    let transitions = Transitions::new(Segments::from_lengths([states.rows()]).expect("valid"));
    let blocks = Blocks::new(&transitions, members).expect("valid");
    build_tables(states, &transitions, &blocks, k, exclusion, kind, &Silent).expect("built");
}

/// Returns a copy of `states` after `change` has modified each row. It receives the row number and the values.
fn changed(states: &States, change: impl Fn(usize, &mut [f32])) -> States {
    let mut values = states.as_slice().to_vec();
    for (row, state) in values.chunks_exact_mut(states.columns()).enumerate() {
        change(row, state);
    }
    States::new(values, states.rows(), states.columns()).expect("valid")
}

/// Returns `states` with half of the rows constant.
fn half_still(states: &States) -> States {
    changed(states, |row, state| {
        if row % 1000 < 500 {
            state.fill(0.25);
        }
    })
}

/// Returns `states` with extreme values in one row in 1000.
fn partly_wild(states: &States) -> States {
    changed(states, |row, state| {
        if row % 1000 == 0 {
            state.fill(1e6);
        }
    })
}

fn by_shape(criterion: &mut Criterion) {
    let rows = if testing() { 500 } else { 20_000 };
    let plant = plant(rows, 142);
    let gaussian = gaussian(rows, 142);
    let copies = changed(&plant, |row, state| {
        let from = plant.row(row % (rows / 10));
        state.copy_from_slice(from);
    });
    let constant = changed(&plant, |_, state| state[10..].fill(0.5));
    let shapes = [
        ("plant, half of it one standstill", half_still(&plant), (5, 3)),
        ("gaussian, half of it one standstill", half_still(&gaussian), (5, 3)),
        ("plant, each state ten times", copies, (5, 3)),
        ("plant, 132 of 142 columns constant", constant, (5, 3)),
        ("plant, one row in 1000 wild", partly_wild(&plant), (5, 3)),
        ("gaussian, one row in 1000 wild", partly_wild(&gaussian), (5, 3)),
        ("plant, two members", plant.clone(), (2, 3)),
        ("plant, 50 members", plant.clone(), (50, 3)),
        ("plant, k = 100", plant.clone(), (5, 100)),
    ];
    let mut group = criterion.benchmark_group("by shape, 142 columns");
    group.sample_size(10).throughput(Throughput::Elements(rows as u64));
    for (name, states, members_and_k) in &shapes {
        group.bench_function(*name, |bench| {
            bench.iter(|| build_of(states, *members_and_k, IndexKind::Auto, Exclusion::default()));
        });
    }
    let few = rows / 50;
    let states = States::new(plant.as_slice()[..few * 142].to_vec(), few, 142).expect("valid");
    // There are two members. Each has half of the transitions, less one at the border.
    let all = (few - 1) / 2 - 1;
    group.throughput(Throughput::Elements(few as u64));
    group.bench_function("plant, as many neighbours as a member has", |bench| {
        bench.iter(|| build_of(&states, (2, all), IndexKind::Auto, Exclusion::default()));
    });
    group.finish();
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
                if !kind.supports(columns) {
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

criterion_group!(benches, by_dimension, by_rows, by_shape);
criterion_main!(benches);
