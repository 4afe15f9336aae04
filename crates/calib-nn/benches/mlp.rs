//! Measures one training step of 142-256-256-1 with batch 256, its parts, and its matrix products alone.
//!
//! `cargo bench -p calib-nn --bench mlp`

use std::hint::black_box;

use calib_core::Seed;
use calib_nn::{
    Adam, AdamRule, Bf16Batch, Bf16Network, Bf16Workspace, Matrix, Mlp, Optimiser, Workspace,
    multiply,
};
use criterion::{Criterion, criterion_group, criterion_main};
use gemm::{Parallelism, gemm};

const SIZES: [usize; 4] = [142, 256, 256, 1];
const BATCH: usize = 256;

fn values(count: usize) -> Vec<f32> {
    let mut rng = Seed::new(1).rng();
    (0..count).map(|_| rng.uniform(-1.0, 1.0) as f32).collect()
}

fn training_step(criterion: &mut Criterion) {
    let mut network = Mlp::new(&SIZES, Seed::new(1));
    let rows = 2 * BATCH + 1;
    let mut workspace = Workspace::new(&network, rows);
    let mut adam = Adam::new(AdamRule::default(), network.parameter_count());
    let input = values(rows * SIZES[0]);
    let gradient = values(BATCH);
    let mut group = criterion.benchmark_group("mlp 142-256-256-1");
    group.bench_function("forward, 513 rows", |bencher| {
        bencher.iter(|| black_box(network.forward(&input, &mut workspace)[0]));
    });
    group.bench_function("backward, 256 rows", |bencher| {
        bencher.iter(|| black_box(network.backward(&input, &gradient, &mut workspace)[0]));
    });
    let gradients = values(network.parameter_count());
    group.bench_function("adam", |bencher| {
        bencher.iter(|| adam.step(network.parameters_mut(), &gradients));
    });
    group.bench_function("forward 513, backward 256, adam", |bencher| {
        bencher.iter(|| {
            network.forward(&input, &mut workspace);
            let gradients = network.backward(&input, &gradient, &mut workspace);
            adam.step(network.parameters_mut(), gradients);
        });
    });
    group.finish();
}

/// Measures the same step with bfloat16 products: with the processor's instruction, if it has one, and
/// without it.
fn rounded_step(criterion: &mut Criterion) {
    let network = Mlp::new(&SIZES, Seed::new(1));
    let rows = 2 * BATCH + 1;
    let mut workspace = Bf16Workspace::new(&network, rows, BATCH);
    let mut batch = Bf16Batch::new(SIZES[0], rows, BATCH);
    let input = values(rows * SIZES[0]);
    let gradient = values(BATCH);
    let mut gradients = values(network.parameter_count());
    let networks = [
        ("bf16 142-256-256-1", Bf16Network::new(&network)),
        ("bf16 142-256-256-1, portable", Bf16Network::portable(&network)),
    ];
    for (name, mut rounded) in networks {
        let mut group = criterion.benchmark_group(name);
        group.bench_function("rounding a batch", |bencher| {
            bencher.iter(|| batch.set(&input, BATCH));
        });
        group.bench_function("forward, 513 rows", |bencher| {
            bencher.iter(|| black_box(rounded.forward(&batch, 0..rows, &mut workspace)[0]));
        });
        group.bench_function("backward, 256 rows", |bencher| {
            bencher.iter(|| {
                rounded.backward(&batch, &gradient, &mut workspace, &mut gradients);
                black_box(gradients[0])
            });
        });
        group.bench_function("rounding parameters", |bencher| {
            bencher.iter(|| rounded.set(&network));
        });
        let mut learning = network.clone();
        let rule = AdamRule::default();
        let mut adam = Optimiser::adam(rule, network.parameter_count());
        group.bench_function("backward, Adam, rounding parameters", |bencher| {
            bencher.iter(|| {
                rounded.learn(&mut learning, &mut adam, &batch, &gradient, &mut workspace);
            });
        });
        group.finish();
    }
}

/// Measures the first layer of nine networks that share their input: nine products, or one product of nine
/// times the width.
fn shared_input(criterion: &mut Criterion) {
    const NETWORKS: usize = 9;
    let [inputs, units, rows] = [SIZES[0], SIZES[1], 2 * BATCH + 1];
    let input = values(rows * inputs);
    let weights = values(inputs * NETWORKS * units);
    let mut out = vec![0.0; rows * NETWORKS * units];
    let mut group = criterion.benchmark_group("first layer of nine");
    let left = Matrix::new(&input, rows, inputs);
    group.bench_function("f32, one by one", |bencher| {
        bencher.iter(|| {
            let weights = weights.chunks_exact(inputs * units);
            for (out, weights) in out.chunks_exact_mut(rows * units).zip(weights) {
                multiply(out, left, Matrix::new(weights, inputs, units));
            }
        });
    });
    group.bench_function("f32, as one", |bencher| {
        bencher.iter(|| multiply(&mut out, left, Matrix::new(&weights, inputs, NETWORKS * units)));
    });
    let mut batch = Bf16Batch::new(inputs, rows, 0);
    batch.set(&input, 0);
    for (name, count) in [("bf16, one by one", NETWORKS), ("bf16, as one", 1)] {
        let network = Mlp::new(&[inputs, NETWORKS / count * units, 1], Seed::new(1));
        let rounded = vec![Bf16Network::new(&network); count];
        let mut workspace = Bf16Workspace::new(&network, rows, 0);
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                for network in &rounded {
                    black_box(network.forward(&batch, 0..rows, &mut workspace)[0]);
                }
            });
        });
    }
    group.finish();
}

/// Returns a product of `[m, k]` and `[k, n]` values, whose operands may be transposed, into `out`.
fn product_into(
    mut out: Vec<f32>,
    [m, n, k]: [usize; 3],
    [left_is_transposed, right_is_transposed]: [bool; 2],
) -> impl FnMut(&[f32], &[f32]) {
    let left_strides = if left_is_transposed { (1, m) } else { (k, 1) };
    let right_strides = if right_is_transposed { (1, k) } else { (n, 1) };
    move |left: &[f32], right: &[f32]| {
        // SAFETY: the strides address `[m, k]`, `[k, n]` and `[m, n]` values, which the vectors contain.
        unsafe {
            gemm(
                m,
                n,
                k,
                out.as_mut_ptr(),
                1,
                n as isize,
                false,
                left.as_ptr(),
                left_strides.1 as isize,
                left_strides.0 as isize,
                right.as_ptr(),
                right_strides.1 as isize,
                right_strides.0 as isize,
                0.0,
                1.0,
                false,
                false,
                false,
                Parallelism::None,
            );
        }
        black_box(out[0]);
    }
}

/// Measures the large products of a step alone, as a reference for the whole step.
fn bare_products(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("gemm");
    // Rows, columns and inner index, and whether the left and right operands are transposed.
    let shapes = [
        ("forward 1", [513, 256, 142], [false, false]),
        ("forward 2", [513, 256, 256], [false, false]),
        ("weights 1", [142, 256, 256], [true, false]),
        ("weights 2", [256, 256, 256], [true, false]),
        ("deltas 2", [256, 256, 256], [false, true]),
    ];
    let operands = shapes.map(|(_, [m, n, k], _)| [values(m * k), values(k * n)]);
    let mut products = shapes.map(|(_, sizes, transposed)| {
        let [m, n, _] = sizes;
        product_into(values(m * n), sizes, transposed)
    });
    for ((product, [left, right]), (name, ..)) in products.iter_mut().zip(&operands).zip(shapes) {
        group.bench_function(name, |bencher| bencher.iter(|| product(left, right)));
    }
    group.bench_function("all five", |bencher| {
        bencher.iter(|| {
            for (product, [left, right]) in products.iter_mut().zip(&operands) {
                product(left, right);
            }
        });
    });
    group.finish();
}

criterion_group!(benches, training_step, bare_products, rounded_step, shared_input);
criterion_main!(benches);
