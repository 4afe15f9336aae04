//! Measures reading a log: inspecting every channel, and normalising the kept channels into states.

use std::{hint::black_box, time::Duration};

use calib_core::{Seed, Silent, Timestamp};
use calib_data::{DataConfig, PreprocessConfig, inspect, load, table::write_log};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const ROWS: usize = 20_000;
const FILES: usize = 2;
const CHANNELS: usize = 48;

/// Writes a log of random walks; every third channel is constant.
fn write(folder: &std::path::Path) {
    for file in 0..FILES {
        let first = (file * ROWS) as i64;
        let timestamps: Vec<Timestamp> = (first..first + ROWS as i64)
            .map(|second| Timestamp::from_micros(second * 1_000_000))
            .collect();
        let channels: Vec<(String, Vec<f32>)> = (0..CHANNELS)
            .map(|channel| {
                let mut rng = Seed::new(1).number(channel as u64).number(file as u64).rng();
                let mut level = 0.0;
                let values = (0..ROWS).map(|_| {
                    level += if channel % 3 == 0 { 0.0 } else { rng.normal() };
                    level as f32
                });
                (format!("c{channel}"), values.collect())
            })
            .collect();
        let path = folder.join(format!("{file}.parquet"));
        write_log(&path, &timestamps, &channels).expect("written");
    }
}

fn ingest(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path());
    let data = DataConfig::at(folder.path());
    let preprocess = PreprocessConfig::default();
    let mut group = criterion.benchmark_group("ingest");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3))
        .throughput(Throughput::Elements((FILES * ROWS * CHANNELS) as u64));
    group.bench_function("inspect", |bencher| {
        bencher.iter(|| inspect(black_box(&data), &preprocess, &Silent).expect("a log"));
    });
    group.bench_function("load", |bencher| {
        bencher.iter(|| load(black_box(&data), &preprocess, &Silent).expect("a log"));
    });
    group.finish();
}

criterion_group!(benches, ingest);
criterion_main!(benches);
