//! Measures the recursions, the windows and the path in cells per second, in one thread.
//!
//! `cargo bench -p calib-dtw` measures. In test mode each case runs once on short series.

use std::hint::black_box;

use calib_dtw::{Dtw, InstructionSet, PatternSet, Series, Settings, StepPattern, Window};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

/// Returns a smooth wave with deterministic roughness.
fn series(len: usize, phase: f64) -> Vec<f64> {
    (0..len)
        .map(|i| (i as f64 / 50.0 + phase).sin() + 0.1 * (i as f64 * (7.3 + phase)).sin())
        .collect()
}

/// Returns the length of the series. It is short if the benchmarks only run as tests
/// (`cargo test --benches`, `--test`).
fn length() -> usize {
    let measuring = std::env::args().any(|argument| argument == "--bench");
    if measuring { 3000 } else { 100 }
}

fn patterns(criterion: &mut Criterion) {
    let len = length();
    let query = series(len, 0.0);
    let reference = series(len, 0.7);
    let mut group = criterion.benchmark_group("pattern");
    group.throughput(Throughput::Elements((len * len) as u64));
    for name in [
        "symmetric2",
        "asymmetric",
        "symmetricP1",
        "symmetricP05",
        "rabinerJuang:3c",
        "rabinerJuang:4c",
        "rabinerJuang:6c",
        "rabinerJuang:7c",
    ] {
        let dtw = Dtw::new(name.parse().expect(name));
        group.bench_function(name, |bencher| {
            bencher.iter(|| dtw.distance(black_box(&query), &reference));
        });
    }
    group.finish();
}

fn instruction_sets(criterion: &mut Criterion) {
    let len = length();
    let query = series(len, 0.0);
    let reference = series(len, 0.7);
    let mut group = criterion.benchmark_group("instructions");
    group.throughput(Throughput::Elements((len * len) as u64));
    for set in InstructionSet::available() {
        let dtw = Dtw::new(StepPattern::symmetric2());
        let dtw = dtw.instruction_set(set).expect("available");
        group.bench_function(set.name(), |bencher| {
            bencher.iter(|| dtw.distance(black_box(&query), &reference));
        });
    }
    group.finish();
}

fn windows_and_paths(criterion: &mut Criterion) {
    let len = length();
    let query = series(len, 0.0);
    let reference = series(len, 0.7);
    let mut group = criterion.benchmark_group("pair");
    let radius = len / 10;
    for window in [Window::SakoeChiba { radius }, Window::Itakura] {
        let dtw = Dtw::new(StepPattern::symmetric2()).window(window);
        group.bench_function(BenchmarkId::new("window", window), |bencher| {
            bencher.iter(|| dtw.distance(black_box(&query), &reference));
        });
    }
    let dtw = Dtw::new(StepPattern::symmetric2());
    group.bench_function("path", |bencher| {
        bencher.iter(|| dtw.align(black_box(&query), &reference));
    });
    group.finish();
}

fn several(criterion: &mut Criterion) {
    let channels = 4;
    let len = length();
    let query = series(len * channels, 0.0);
    let reference = series(len * channels, 0.7);
    let query = Series::with_channels(&query, channels).expect("whole samples");
    let reference = Series::with_channels(&reference, channels).expect("whole samples");
    let names = ["symmetric2", "asymmetric", "symmetricP1", "rabinerJuang:6c"];
    let patterns = names.map(|name| name.parse().expect(name));
    let set = PatternSet::new(patterns, Settings::default());
    let mut group = criterion.benchmark_group("several");
    group.throughput(Throughput::Elements((names.len() * len * len) as u64));
    group.bench_function("4 patterns, 4 channels", |bencher| {
        bencher.iter(|| set.distances(black_box(query), reference));
    });
    group.finish();
}

criterion_group!(benches, patterns, instruction_sets, windows_and_paths, several);
criterion_main!(benches);
