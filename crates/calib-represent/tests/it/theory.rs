//! Compares learned representations with the theory for a reversible chain.
//!
//! On a chain with symmetric transition matrix P and states drawn uniformly, the ψ that minimises the loss spans
//! eigenvectors of P̄ = Σ P(τ) P^τ. These are the ones whose eigenvalue μ leaves ζ − c(1−μ)/β positive (form A),
//! and that is their second moment.

use calib_core::{Rng, Seed, Segments, Silent, States};
use calib_represent::{
    LaplacianConfig, LossConfig, LossForm, PairSampler, Split, Task, encode, score,
    symmetric_eigenvalues, train,
};

/// A lazy symmetric random walk on a graph, with one-hot states.
struct Chain {
    /// The transition matrix P, `[n, n]`.
    transition: Vec<f64>,
    n: usize,
}

impl Chain {
    /// Creates a walk that takes each edge of a node with probability `hop`, and otherwise stays.
    fn on(n: usize, edges: impl IntoIterator<Item = (usize, usize)>, hop: f64) -> Self {
        let mut transition = vec![0.0; n * n];
        for (a, b) in edges {
            transition[a * n + b] = hop;
            transition[b * n + a] = hop;
        }
        for node in 0..n {
            let away: f64 = transition[node * n..(node + 1) * n].iter().sum();
            transition[node * n + node] = 1.0 - away;
        }
        Self { transition, n }
    }

    fn next(&self, node: usize, rng: &mut Rng) -> usize {
        let mut unit = rng.unit();
        let row = &self.transition[node * self.n..(node + 1) * self.n];
        row.iter()
            .position(|&probability| {
                unit -= probability;
                unit < 0.0
            })
            .unwrap_or(node)
    }

    /// Returns many walks from uniform start nodes, each in its own segment.
    fn walks(&self, walks: usize, steps: usize, seed: Seed) -> (Vec<usize>, Segments) {
        let mut rng = seed.rng();
        let mut nodes = Vec::with_capacity(walks * steps);
        for _ in 0..walks {
            let mut node = rng.below(self.n);
            for _ in 0..steps {
                nodes.push(node);
                node = self.next(node, &mut rng);
            }
        }
        (nodes, Segments::from_lengths(vec![steps; walks]).expect("valid"))
    }

    /// Returns Σ P(τ) P^τ.
    fn averaged(&self, probabilities: &[f64]) -> Vec<f64> {
        let n = self.n;
        let mut power = self.transition.clone();
        let mut sum = vec![0.0; n * n];
        for probability in probabilities {
            for (sum, value) in sum.iter_mut().zip(&power) {
                *sum += probability * value;
            }
            power = product(&power, &self.transition, n);
        }
        sum
    }
}

fn product(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for i in 0..n {
        for k in 0..n {
            for j in 0..n {
                out[i * n + j] += a[i * n + k] * b[k * n + j];
            }
        }
    }
    out
}

fn one_hot(nodes: &[usize], n: usize) -> States {
    let mut values = vec![0.0; nodes.len() * n];
    for (row, node) in nodes.iter().enumerate() {
        values[row * n + node] = 1.0;
    }
    States::new(values, nodes.len(), n).expect("finite")
}

/// ψ of every node, `[n, d]`, in double precision.
struct Learned {
    psi: Vec<f64>,
    n: usize,
    dimension: usize,
    live: usize,
    /// Σ P(τ) P^τ of the training pairs.
    averaged: Vec<f64>,
}

fn learn(chain: &Chain, config: &LaplacianConfig) -> Learned {
    let (nodes, segments) = chain.walks(2_000, 40, Seed::new(5));
    let states = one_hot(&nodes, chain.n);
    let split = Split::in_time(&segments).expect("long enough");
    let seed = Seed::new(6);
    let task = Task { states: &states, segments: &segments, split: &split, seed };
    let trained = train(config, task, None, &Silent).expect("trains");
    assert_eq!(trained.divergence, None);
    let each: Vec<usize> = (0..chain.n).collect();
    let psi = encode(&trained.encoder, &one_hot(&each, chain.n)).expect("finite");
    let all = encode(&trained.encoder, &states).expect("finite");
    let scores = score(&states, &all, &segments, &split.validation, seed);
    let sampler = PairSampler::new(&segments, 0..nodes.len(), config.kappa, config.trajectory);
    Learned {
        psi: psi.as_slice().iter().map(|&value| f64::from(value)).collect(),
        n: chain.n,
        dimension: config.dimension,
        live: scores.live_dimensions,
        averaged: chain.averaged(&sampler.expect("has pairs").probabilities()),
    }
}

impl Learned {
    /// Returns the eigenvalues of E[ψψᵀ] under uniform nodes, largest first.
    fn moments(&self) -> Vec<f64> {
        let d = self.dimension;
        let mut moment = vec![0.0; d * d];
        for psi in self.psi.chunks_exact(d) {
            for i in 0..d {
                for j in 0..d {
                    moment[i * d + j] += psi[i] * psi[j] / self.n as f64;
                }
            }
        }
        symmetric_eigenvalues(&moment, d)
    }

    /// Returns E[ψψᵀ] as an operator on functions of the node, ψψᵀ/n, and its theoretical counterpart: the
    /// positive part of ζI − c(I − P̄)/β. Both are `[n, n]`. If theory holds, they have the same eigenvalues and
    /// live subspace.
    fn operators(&self, loss: &LossConfig, eigenvectors: &[(f64, Vec<f64>)]) -> [Vec<f64>; 2] {
        let n = self.n;
        let d = self.dimension;
        let mut got = vec![0.0; n * n];
        let mut expected = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                let a = &self.psi[i * d..(i + 1) * d];
                let b = &self.psi[j * d..(j + 1) * d];
                got[i * n + j] = a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / n as f64;
            }
        }
        for (correlation, vector) in eigenvectors {
            let moment = stationary_moment(loss, *correlation);
            for i in 0..n {
                for j in 0..n {
                    expected[i * n + j] += moment * vector[i] * vector[j];
                }
            }
        }
        [got, expected]
    }
}

/// Returns orthonormal eigenvectors of a symmetric matrix with their eigenvalues, largest first, by deflated
/// power iteration.
fn eigenvectors(matrix: &[f64], n: usize) -> Vec<(f64, Vec<f64>)> {
    let mut rng = Seed::new(1).rng();
    let mut found: Vec<(f64, Vec<f64>)> = Vec::new();
    for _ in 0..n {
        let mut vector: Vec<f64> = (0..n).map(|_| rng.normal()).collect();
        for _ in 0..3_000 {
            // The matrix is shifted by 1, so that all eigenvalues are positive and the largest comes first.
            let mut image: Vec<f64> = (0..n)
                .map(|i| vector[i] + (0..n).map(|j| matrix[i * n + j] * vector[j]).sum::<f64>())
                .collect();
            for (_, other) in &found {
                let along: f64 = image.iter().zip(other).map(|(a, b)| a * b).sum();
                image.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
            }
            let norm = image.iter().map(|value| value * value).sum::<f64>().sqrt();
            vector = image.into_iter().map(|value| value / norm).collect();
        }
        let value = (0..n)
            .map(|i| vector[i] * (0..n).map(|j| matrix[i * n + j] * vector[j]).sum::<f64>())
            .sum();
        found.push((value, vector));
    }
    found
}

/// Returns the sine of the largest principal angle between the spans of `a` and `b`: ‖(I − AAᵀ)B‖.
fn greatest_sine(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    let residuals: Vec<Vec<f64>> = b
        .iter()
        .map(|vector| {
            let mut rest = vector.clone();
            for basis in a {
                let along: f64 = vector.iter().zip(basis).map(|(x, y)| x * y).sum();
                rest.iter_mut().zip(basis).for_each(|(x, y)| *x -= along * y);
            }
            rest
        })
        .collect();
    let k = residuals.len();
    let mut gram = vec![0.0; k * k];
    for i in 0..k {
        for j in 0..k {
            gram[i * k + j] = residuals[i].iter().zip(&residuals[j]).map(|(x, y)| x * y).sum();
        }
    }
    symmetric_eigenvalues(&gram, k)[0].max(0.0).sqrt()
}

fn config(loss: LossConfig) -> LaplacianConfig {
    LaplacianConfig {
        loss,
        kappa: 0.9,
        trajectory: 6,
        dimension: 10,
        hidden_units: 48,
        hidden_layers: 1,
        learning_rate: 1e-3,
        batch_size: 256,
        steps: 2_500,
    }
}

/// Returns the stationary second moment of ψ along an eigenfunction whose correlation over one drawn pair is
/// `correlation` μ: max(0, ζ − c(1−μ)/β) in form A, and max(0, (ζ − c(1−μ))/β) in form B.
///
/// Derived: with ψ = Σ aₖ fₖ eₖ over orthonormal eigenfunctions, the expected loss is Σ 2c(1−μₖ)aₖ² + q aₖ⁴ − 2l aₖ².
/// Its minimum is aₖ² = (l − c(1−μₖ))/q where that is positive.
fn stationary_moment(loss: &LossConfig, correlation: f64) -> f64 {
    let (quartic, quadratic) = loss.repulsion();
    ((quadratic - loss.attraction * (1.0 - correlation)) / quartic).max(0.0)
}

/// Compares second moments, live dimensions and subspace with theory.
fn check(chain: &Chain, loss: LossConfig) {
    let config = config(loss);
    let learned = learn(chain, &config);
    let vectors = eigenvectors(&learned.averaged, chain.n);
    let expected: Vec<f64> = vectors.iter().map(|(mu, _)| stationary_moment(&loss, *mu)).collect();
    let greatest = expected[0];
    let moments = learned.moments();
    for (at, (got, expected)) in moments.iter().zip(&expected).enumerate() {
        assert!((got - expected).abs() < 0.08 * greatest, "{at}: {moments:?} and {expected:?}");
    }
    // Modes near the threshold may be live or not.
    let sure = expected.iter().filter(|&&moment| moment > 0.1 * greatest).count();
    let possible =
        vectors.iter().filter(|(mu, _)| stationary_moment(&loss, mu + 0.03) > 0.0).count();
    assert!((sure..=possible).contains(&learned.live), "{sure} {} {possible}", learned.live);
    let [got, theory] = learned.operators(&loss, &vectors);
    let difference: Vec<f64> = got.iter().zip(&theory).map(|(a, b)| a - b).collect();
    let norms = symmetric_eigenvalues(&difference, chain.n);
    let norm = norms[0].max(-norms[chain.n - 1]);
    assert!(norm < 0.1 * greatest, "operators differ by {norm}, the greatest is {greatest}");
    // The span of the modes that are clearly live, where a gap in the spectrum separates them.
    let alive: Vec<Vec<f64>> =
        vectors.iter().take(sure).map(|(_, vector)| vector.clone()).collect();
    let own: Vec<Vec<f64>> = eigenvectors(&got, chain.n)
        .into_iter()
        .take(learned.live)
        .map(|(_, vector)| vector)
        .collect();
    let sine = greatest_sine(&own, &alive);
    assert!(sine < 0.2, "a principal angle has the sine {sine}");
}

fn ring(n: usize) -> Chain {
    Chain::on(n, (0..n).map(|node| (node, (node + 1) % n)), 0.3)
}

fn grid(side: usize) -> Chain {
    let across = (0..side).flat_map(|y| (1..side).map(move |x| (y * side + x - 1, y * side + x)));
    let down = (1..side).flat_map(|y| (0..side).map(move |x| ((y - 1) * side + x, y * side + x)));
    Chain::on(side * side, across.chain(down), 0.2)
}

#[test]
fn a_ring_is_learned_in_form_a() {
    check(&ring(12), LossConfig { zeta: 0.1, ..LossConfig::default() });
}

#[test]
fn a_ring_is_learned_in_form_b_and_with_half_the_attraction() {
    let form_b = LossConfig { form: LossForm::B, beta: 3.0, zeta: 0.6, ..LossConfig::default() };
    check(&ring(12), form_b);
    check(&ring(12), LossConfig { attraction: 0.5, zeta: 0.07, ..LossConfig::default() });
}

#[test]
fn a_grid_is_learned() {
    check(&grid(4), LossConfig { zeta: 0.08, ..LossConfig::default() });
}

/// Returns the position of a node in space. The nodes form two corridors, each of `length` places.
fn place(node: usize, length: usize, rng: &mut Rng) -> [f32; 2] {
    let x = node % length;
    let side = node / length;
    // The wall is thinner than the length of a step.
    [x as f32 * 0.2, side as f32 * 0.1 + 0.02 * rng.unit() as f32]
}

/// Returns the squared Euclidean distance between two rows.
fn square_distance(points: &States, a: usize, b: usize) -> f32 {
    points.row(a).iter().zip(points.row(b)).map(|(a, b)| (a - b).powi(2)).sum()
}

#[test]
fn neighbours_respect_a_bottleneck_that_euclidean_ones_cross() {
    // Two corridors of 8 places are side by side and joined at one end only. A walk must go around the wall, but
    // places on both sides of it are as near in space as successive ones.
    let length = 8;
    let along = (1..length).flat_map(|x| [(x - 1, x), (length + x - 1, length + x)]);
    let chain = Chain::on(2 * length, along.chain([(0, length)]), 0.3);
    let (nodes, segments) = chain.walks(1_000, 60, Seed::new(2));
    let mut rng = Seed::new(3).rng();
    let values: Vec<f32> = nodes.iter().flat_map(|&node| place(node, length, &mut rng)).collect();
    let states = States::new(values, nodes.len(), 2).expect("finite");
    let split = Split::in_time(&segments).expect("long enough");
    let loss = LossConfig { zeta: 0.1, ..LossConfig::default() };
    let config = LaplacianConfig { hidden_layers: 2, steps: 4_000, ..config(loss) };
    let task = Task { states: &states, segments: &segments, split: &split, seed: Seed::new(4) };
    let trained = train(&config, task, None, &Silent).expect("trains");
    let psi = encode(&trained.encoder, &states).expect("finite");

    let far = (3_000..6_000).filter(|&row| nodes[row] % length >= 4).take(200);
    let far: Vec<usize> = far.collect();
    // States far from the door, whose nearest state of another place is across the wall.
    let [euclidean, laplacian] = [&states, &psi].map(|points| {
        let crossing = far.iter().filter(|&&row| {
            let other = (0..3_000)
                .filter(|&other| nodes[other] != nodes[row])
                .min_by(|&a, &b| {
                    square_distance(points, row, a).total_cmp(&square_distance(points, row, b))
                })
                .expect("other places");
            nodes[other] / length != nodes[row] / length
        });
        crossing.count()
    });
    assert_eq!(far.len(), 200);
    assert!(euclidean > 190, "{euclidean} of 200 Euclidean neighbours lie across the wall");
    assert!(laplacian < 10, "{laplacian} of 200 Laplacian neighbours lie across the wall");
}
