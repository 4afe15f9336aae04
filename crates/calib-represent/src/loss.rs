use calib_nn::{Matrix, multiply};

use crate::LossConfig;

/// The value of the loss on a batch, and its parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// The loss L.
    pub total: f64,
    /// The mean ‖ψ(u) − ψ(v)‖², without its weight.
    pub attraction: f64,
    /// L minus the weighted attraction.
    pub repulsion: f64,
}

/// The buffers of [`laplacian_loss`], allocated once.
#[derive(Clone, Debug)]
pub struct LossBuffers {
    batch: usize,
    dimension: usize,
    /// Σᵢ ψ(xᵢ)ψ(xᵢ)ᵀ, `[d, d]`.
    second_moment: Vec<f32>,
    /// The gradient with respect to the batch's outputs, `[3 batch, d]`.
    gradient: Vec<f32>,
}

impl LossBuffers {
    /// Creates buffers for batches of `batch` pairs in `dimension` dimensions.
    ///
    /// # Panics
    /// If `batch` is below 2: then no two states repel each other.
    pub fn new(batch: usize, dimension: usize) -> Self {
        assert!(batch >= 2, "two states repel each other");
        Self {
            batch,
            dimension,
            second_moment: vec![0.0; dimension * dimension],
            gradient: vec![0.0; 3 * batch * dimension],
        }
    }
}

/// Returns the graph-drawing loss of a mini-batch, and its gradient with respect to `outputs`.
///
/// `outputs` are `[3B, d]`: ψ(u) of `B` pairs, their ψ(v), and ψ(x) of `B` independent states.
///
/// ```text
/// form A: L = c · mean_b ‖ψ(u_b) − ψ(v_b)‖² + β · mean_{i≠j} [ (ψ(x_i)·ψ(x_j))² − ζ‖ψ(x_i)‖² − ζ‖ψ(x_j)‖²]
/// form B: L = c · mean_b ‖ψ(u_b) − ψ(v_b)‖² +     mean_{i≠j} [β(ψ(x_i)·ψ(x_j))² − ζ‖ψ(x_i)‖² − ζ‖ψ(x_j)‖²]
/// ```
///
/// The mean over i ≠ j is an unbiased estimate of the expectation over two independent states. (The form of
/// the loss is that of the public code of the same lab and Wu et al. 2019. Omitting i = j is our choice.)
///
/// With S = Σᵢ ψᵢψᵢᵀ, the pairs need no B × B matrix: Σ_{i≠j} (ψᵢ·ψⱼ)² = ‖S‖² − Σᵢ ‖ψᵢ‖⁴, and Σ_{j≠i}
/// (ψᵢ·ψⱼ)ψⱼ = Sψᵢ − ‖ψᵢ‖²ψᵢ.
///
/// # Panics
/// If `outputs` does not have the shape of the buffers.
pub fn laplacian_loss<'b>(
    config: &LossConfig,
    outputs: &[f32],
    buffers: &'b mut LossBuffers,
) -> (Loss, &'b [f32]) {
    let LossBuffers { batch, dimension, second_moment, gradient } = buffers;
    let batch = *batch;
    let dimension = *dimension;
    let block = batch * dimension;
    assert_eq!(outputs.len(), 3 * block, "a batch has u, v and x");
    let (quartic, quadratic) = config.repulsion();
    let pairs = (batch * (batch - 1)) as f64;

    let x = Matrix::new(&outputs[2 * block..], batch, dimension);
    multiply(second_moment, x.transposed(), x);
    let moment = Matrix::new(second_moment, dimension, dimension);
    multiply(&mut gradient[2 * block..], x, moment);

    let attraction = attract(config.attraction, outputs, gradient, batch, dimension);

    let of_products = 4.0 * quartic / pairs;
    let of_norms = 4.0 * quadratic / batch as f64;
    let mut norms = 0.0;
    let mut fourth_powers = 0.0;
    let rows = outputs[2 * block..].chunks_exact(dimension);
    for (psi, gradient) in rows.zip(gradient[2 * block..].chunks_exact_mut(dimension)) {
        let norm: f64 = psi.iter().map(|&value| f64::from(value * value)).sum();
        norms += norm;
        fourth_powers += norm * norm;
        let scale = of_products as f32;
        let shrink = (of_products * norm + of_norms) as f32;
        for (gradient, psi) in gradient.iter_mut().zip(psi) {
            *gradient = scale * *gradient - shrink * psi;
        }
    }
    let products: f64 = second_moment.iter().map(|&value| f64::from(value).powi(2)).sum();
    let repulsion =
        quartic * (products - fourth_powers) / pairs - 2.0 * quadratic * norms / batch as f64;
    let total = config.attraction * attraction + repulsion;
    (Loss { total, attraction, repulsion }, gradient)
}

/// Returns mean ‖ψ(u) − ψ(v)‖², and writes c times its gradient to the first two blocks of `gradient`.
fn attract(c: f64, outputs: &[f32], gradient: &mut [f32], batch: usize, dimension: usize) -> f64 {
    let block = batch * dimension;
    let scale = (2.0 * c / batch as f64) as f32;
    let (of_u, rest) = gradient.split_at_mut(block);
    let of_v = &mut rest[..block];
    let u = &outputs[..block];
    let v = &outputs[block..2 * block];
    let mut sum = 0.0;
    for row in 0..batch {
        let at = row * dimension..(row + 1) * dimension;
        let mut squares = 0.0_f32;
        let gradients = of_u[at.clone()].iter_mut().zip(&mut of_v[at.clone()]);
        for ((of_u, of_v), (u, v)) in gradients.zip(u[at.clone()].iter().zip(&v[at])) {
            let difference = u - v;
            squares += difference * difference;
            *of_u = scale * difference;
            *of_v = -*of_u;
        }
        sum += f64::from(squares);
    }
    sum / batch as f64
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;
    use crate::LossForm;

    fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    /// Computes the loss by definition, pair by pair, in double precision.
    fn by_definition(config: &LossConfig, outputs: &[f64], batch: usize, dimension: usize) -> f64 {
        let rows: Vec<&[f64]> = outputs.chunks_exact(dimension).collect();
        let attraction: f64 = (0..batch)
            .map(|b| {
                let pairs = rows[b].iter().zip(rows[batch + b]);
                pairs.map(|(u, v)| (u - v).powi(2)).sum::<f64>()
            })
            .sum();
        let mut repulsion = 0.0;
        for i in 0..batch {
            for j in (0..batch).filter(|&j| j != i) {
                let a = rows[2 * batch + i];
                let b = rows[2 * batch + j];
                let square = dot(a, b).powi(2);
                let norms = config.zeta * (dot(a, a) + dot(b, b));
                repulsion += match config.form {
                    LossForm::A => config.beta * (square - norms),
                    LossForm::B => config.beta * square - norms,
                };
            }
        }
        config.attraction * attraction / batch as f64 + repulsion / (batch * (batch - 1)) as f64
    }

    #[test]
    fn value_and_gradient_follow_the_definition() {
        let batch = 5;
        let dimension = 3;
        for form in [LossForm::A, LossForm::B] {
            let config = LossConfig { form, attraction: 0.5, beta: 5.0, zeta: 0.05 };
            let mut rng = Seed::new(3).rng();
            let outputs: Vec<f32> =
                (0..3 * batch * dimension).map(|_| rng.normal() as f32).collect();
            let mut exact: Vec<f64> = outputs.iter().map(|&value| f64::from(value)).collect();
            let mut buffers = LossBuffers::new(batch, dimension);
            let (loss, gradient) = laplacian_loss(&config, &outputs, &mut buffers);
            let expected = by_definition(&config, &exact, batch, dimension);
            assert!((loss.total - expected).abs() < 1e-5 * expected.abs(), "{loss:?} {expected}");
            for (index, &gradient) in gradient.iter().enumerate() {
                let at = exact[index];
                exact[index] = at + 1e-5;
                let above = by_definition(&config, &exact, batch, dimension);
                exact[index] = at - 1e-5;
                let below = by_definition(&config, &exact, batch, dimension);
                exact[index] = at;
                let slope = (above - below) / 2e-5;
                let error = (f64::from(gradient) - slope).abs();
                assert!(error < 1e-5 * (1.0 + slope.abs()), "{index}: {gradient} and {slope}");
            }
        }
    }
}
