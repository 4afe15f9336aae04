use calib_core::Rng;

use super::*;
use crate::Workspace;

/// Computes the same network in f64 by definition: the loss Σ gᵣⱼ outputᵣⱼ for fixed g.
fn reference_loss(network: &Mlp, parameters: &[f64], input: &[f32], gradient: &[f32]) -> f64 {
    let mut loss = 0.0;
    for (row, gradient) in
        input.chunks_exact(network.inputs()).zip(gradient.chunks_exact(network.outputs()))
    {
        let mut values: Vec<f64> = row.iter().map(|&x| f64::from(x)).collect();
        for (index, layer) in network.layers().iter().enumerate() {
            values = (0..layer.outputs)
                .map(|j| {
                    let products = values
                        .iter()
                        .enumerate()
                        .map(|(i, x)| x * parameters[layer.weights.start + i * layer.outputs + j]);
                    let sum = products.sum::<f64>() + parameters[layer.bias.start + j];
                    if index + 1 < network.layers().len() { sum.max(0.0) } else { sum }
                })
                .collect();
        }
        loss += values.iter().zip(gradient).map(|(value, &g)| value * f64::from(g)).sum::<f64>();
    }
    loss
}

fn uniform(rng: &mut Rng, count: usize) -> Vec<f32> {
    (0..count).map(|_| rng.uniform(-1.0, 1.0) as f32).collect()
}

#[test]
fn outputs_and_gradients_agree_with_the_definition_in_f64() {
    for (sizes, rows) in [
        (&[3, 1][..], 1),
        (&[3, 2], 5),
        (&[7, 9, 1], 4),
        (&[7, 20, 17, 4], 33),
        (&[4, 5, 6, 7, 3], 2),
    ] {
        let mut rng = Seed::new(rows as u64).rng();
        let network = Mlp::new(sizes, Seed::new(5));
        let input = uniform(&mut rng, rows * network.inputs());
        let gradient = uniform(&mut rng, rows * network.outputs());
        let mut workspace = Workspace::new(&network, rows + 3);
        let output = network.forward(&input, &mut workspace);
        let loss: f64 =
            output.iter().zip(&gradient).map(|(&o, &g)| f64::from(o) * f64::from(g)).sum();
        let mut parameters: Vec<f64> = network.parameters().iter().map(|&p| f64::from(p)).collect();
        let expected = reference_loss(&network, &parameters, &input, &gradient);
        assert!((loss - expected).abs() < 1e-5, "{sizes:?}: {loss} {expected}");

        let gradients = network.backward(&input, &gradient, &mut workspace).to_vec();
        for (index, got) in gradients.into_iter().enumerate() {
            let at = parameters[index];
            let step = 1e-6;
            parameters[index] = at + step;
            let above = reference_loss(&network, &parameters, &input, &gradient);
            parameters[index] = at - step;
            let below = reference_loss(&network, &parameters, &input, &gradient);
            parameters[index] = at;
            let expected = (above - below) / (2.0 * step);
            assert!(
                (f64::from(got) - expected).abs() < 2e-6 * (1.0 + expected.abs()) * rows as f64,
                "{sizes:?}, parameter {index}: {got} and {expected}"
            );
        }
    }
}

#[test]
fn a_gradient_may_cover_the_first_rows_only() {
    let network = Mlp::new(&[5, 8, 8, 2], Seed::new(1));
    let mut rng = Seed::new(2).rng();
    let input = uniform(&mut rng, 5 * 6);
    let gradient = uniform(&mut rng, 2 * 4);
    let mut workspace = Workspace::new(&network, 6);
    network.forward(&input, &mut workspace);
    let some = network.backward(&input, &gradient, &mut workspace).to_vec();
    let padded = [&gradient[..], &[0.0; 4]].concat();
    network.forward(&input, &mut workspace);
    let all = network.backward(&input, &padded, &mut workspace);
    for (some, all) in some.iter().zip(all) {
        assert!((some - all).abs() < 1e-6, "{some} {all}");
    }
}

#[test]
fn weights_start_inside_pytorchs_bounds_and_depend_on_the_seed() {
    let network = Mlp::new(&[100, 50, 3], Seed::new(1));
    assert_eq!(network.parameter_count(), 100 * 50 + 50 + 50 * 3 + 3);
    assert_eq!((network.inputs(), network.outputs()), (100, 3));
    for layer in network.layers() {
        let bound = 1.0 / (layer.inputs as f32).sqrt();
        let values = &network.parameters()[layer.weights.start..layer.bias.end];
        assert!(values.iter().all(|value| value.abs() <= bound));
        assert!(values.iter().any(|value| value.abs() > 0.9 * bound));
    }
    assert_eq!(network, Mlp::new(&[100, 50, 3], Seed::new(1)));
    assert_ne!(network, Mlp::new(&[100, 50, 3], Seed::new(2)));
}

#[test]
fn parameters_can_be_restored() {
    let network = Mlp::new(&[4, 3, 1], Seed::new(1));
    let copy = Mlp::from_parameters(&[4, 3, 1], network.parameters());
    assert_eq!(copy.as_ref(), Ok(&network));
    let error = Mlp::from_parameters(&[4, 3, 1], &[0.0; 18]).expect_err("one too few");
    assert_eq!(error.to_string(), "a network of layer sizes [4, 3, 1] has 19 parameters, got 18");
}

#[test]
fn a_diverged_network_predicts_nan() {
    let mut network = Mlp::new(&[2, 4, 4, 1], Seed::new(1));
    network.parameters_mut().fill(f32::NAN);
    let mut workspace = Workspace::new(&network, 1);
    assert!(network.forward(&[1.0, 1.0], &mut workspace)[0].is_nan());
}

#[test]
#[should_panic(expected = "the workspace holds 2 rows, got 3")]
fn a_workspace_has_its_capacity() {
    let network = Mlp::new(&[2, 1], Seed::new(1));
    network.forward(&[0.0; 6], &mut Workspace::new(&network, 2));
}
