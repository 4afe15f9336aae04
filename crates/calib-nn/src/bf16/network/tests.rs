use calib_core::Seed;
use proptest::prelude::*;

use super::*;
use crate::{AdamRule, SgdRule, Workspace};

fn numbers(count: usize, seed: u64) -> Vec<f32> {
    let mut rng = Seed::new(seed).rng();
    (0..count).map(|_| rng.uniform(-1.0, 1.0) as f32).collect()
}

fn positive(count: usize, seed: u64) -> Vec<f32> {
    numbers(count, seed).iter().map(|value| value.abs() + 0.01).collect()
}

/// Returns −1, 0 and 1, mostly 0. The products of a few such layers are small integers, which bfloat16 represents exactly.
fn signs(count: usize, seed: u64) -> Vec<f32> {
    let mut rng = Seed::new(seed).rng();
    (0..count).map(|_| [0.0, 0.0, 1.0, -1.0][rng.below(4)]).collect()
}

/// Returns outputs for all rows and the gradient of the first `learnt`.
fn pass(
    processor: Processor,
    network: &Mlp,
    input: &[f32],
    output_gradient: &[f32],
) -> (Vec<f32>, Vec<f32>) {
    let rows = input.len() / network.inputs();
    let learnt = output_gradient.len();
    let mut batch = Bf16Batch::new(network.inputs(), rows + 2, learnt + 2);
    let mut workspace = Bf16Workspace::new(network, rows + 2, learnt + 2);
    let rounded = Bf16Network::on(processor, network);
    batch.set(input, learnt);
    let outputs = rounded.forward(&batch, 0..rows, &mut workspace).to_vec();
    let gradients = gradients(&rounded, &batch, output_gradient, &mut workspace);
    (outputs, gradients)
}

fn gradients(
    rounded: &Bf16Network,
    batch: &Bf16Batch,
    output_gradient: &[f32],
    workspace: &mut Bf16Workspace,
) -> Vec<f32> {
    let mut gradients = vec![0.0; rounded.output.places.bias.end];
    rounded.backward(batch, output_gradient, workspace, &mut gradients);
    gradients
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Computes the same in single precision.
fn single(network: &Mlp, input: &[f32], output_gradient: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let mut workspace = Workspace::new(network, input.len() / network.inputs());
    let outputs = network.forward(input, &mut workspace).to_vec();
    (outputs, network.backward(input, output_gradient, &mut workspace).to_vec())
}

/// Returns 1 − the cosine of the angle between two vectors.
fn apart(left: &[f32], right: &[f32]) -> f64 {
    1.0 - dot(left, right) / (dot(left, left) * dot(right, right)).sqrt()
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
}

proptest! {
    #[test]
    fn all_processors_give_the_same_bytes(
        inputs in 1_usize..70,
        hidden in prop::collection::vec(1_usize..70, 1..4),
        learnt in 1_usize..40,
        further in 0_usize..40,
    ) {
        let sizes = [vec![inputs], hidden, vec![1]].concat();
        let network = Mlp::new(&sizes, Seed::new(1));
        let (input, output_gradient) = (numbers((learnt + further) * inputs, 2), numbers(learnt, 3));
        let all = Processor::all().into_iter();
        let mut all = all.map(|processor| pass(processor, &network, &input, &output_gradient));
        let first = all.next().expect("a processor");
        for other in all {
            prop_assert_eq!(bits(&other.0), bits(&first.0));
            prop_assert_eq!(bits(&other.1), bits(&first.1));
        }
    }

    #[test]
    fn to_learn_is_to_step_along_the_gradients(
        inputs in 1_usize..70,
        hidden in prop::collection::vec(1_usize..70, 1..4),
        learnt in 1_usize..40,
        descent in any::<bool>(),
    ) {
        let sizes = [vec![inputs], hidden, vec![1]].concat();
        let network = Mlp::new(&sizes, Seed::new(1));
        let optimiser = if descent {
            Optimiser::sgd(SgdRule { learning_rate: 0.1, weight_decay: 0.01 })
        } else {
            let rule = AdamRule { learning_rate: 0.1, weight_decay: 0.01, ..AdamRule::default() };
            Optimiser::adam(rule, network.parameter_count())
        };
        let (input, output_gradient) = (numbers(learnt * inputs, 2), numbers(learnt, 3));
        let mut batch = Bf16Batch::new(inputs, learnt, learnt);
        batch.set(&input, learnt);
        for processor in Processor::all() {
            let mut workspace = Bf16Workspace::new(&network, learnt, learnt);
            let (mut by_parts, mut parts) = (network.clone(), optimiser.clone());
            let (mut at_once, mut whole) = (network.clone(), optimiser.clone());
            let mut rounded = Bf16Network::on(processor, &network);
            // The second step has nonzero moments and newly rounded weights.
            for _ in 0..2 {
                let before = Bf16Network::on(processor, &by_parts);
                let expected = before.forward(&batch, 0..learnt, &mut workspace).to_vec();
                let gradients = gradients(&before, &batch, &output_gradient, &mut workspace);
                parts.step(by_parts.parameters_mut(), &gradients);
                let outputs = rounded.forward(&batch, 0..learnt, &mut workspace);
                prop_assert_eq!(bits(outputs), bits(&expected));
                rounded.learn(&mut at_once, &mut whole, &batch, &output_gradient, &mut workspace);
                prop_assert_eq!(bits(at_once.parameters()), bits(by_parts.parameters()));
            }
            prop_assert_eq!(&whole, &parts);
        }
    }

    #[test]
    fn what_bfloat16_holds_is_computed_exactly(
        inputs in 1_usize..10,
        hidden in prop::collection::vec(1_usize..10, 1..3),
        learnt in 1_usize..12,
        further in 0_usize..9,
    ) {
        let sizes = [vec![inputs], hidden, vec![1]].concat();
        let parameters = signs(Mlp::new(&sizes, Seed::new(1)).parameter_count(), 4);
        let network = Mlp::from_parameters(&sizes, &parameters).expect("as many");
        let (input, output_gradient) = (signs((learnt + further) * inputs, 5), signs(learnt, 6));
        let got = pass(Processor::detect(), &network, &input, &output_gradient);
        prop_assert_eq!(got, single(&network, &input, &output_gradient));
    }
}

/// Maximum relative change by rounding to eight significant bits.
const ROUNDING: f64 = 1.0 / 256.0;

/// Returns the output for `input`, and a bound on its error compared with exact arithmetic. The bound covers rounded operands and
/// single-precision sums, layer by layer.
fn bound(network: &Mlp, input: &[f32]) -> (f64, f64) {
    // Values, and the bounds on their errors.
    let mut values: Vec<(f64, f64)> = input.iter().map(|&value| (f64::from(value), 0.0)).collect();
    for (number, layer) in network.layers().iter().enumerate() {
        let weights = &network.parameters()[layer.weights.clone()];
        let bias = &network.parameters()[layer.bias.clone()];
        let is_hidden = number + 1 < network.layers().len();
        values = (0..layer.outputs)
            .map(|output| {
                let own = weights[output..].iter().step_by(layer.outputs);
                let (value, apart) = sum_bound(&values, own, bias[output]);
                (if is_hidden { value.max(0.0) } else { value }, apart)
            })
            .collect();
    }
    values[0]
}

/// Returns the sum of a bias and weighted values, each with an error bound, and a bound on the error of the result.
fn sum_bound<'a>(
    values: &[(f64, f64)],
    weights: impl Iterator<Item = &'a f32>,
    bias: f32,
) -> (f64, f64) {
    let sums = (values.len() + 2) as f64 * f64::from(f32::EPSILON);
    let bias = f64::from(bias);
    let mut value = bias;
    let mut apart = 0.0;
    let mut size = bias.abs();
    for (&(x, off), &w) in values.iter().zip(weights) {
        let w = f64::from(w);
        let largest = w.abs() * (x.abs() + off) * (1.0 + ROUNDING).powi(2);
        value += w * x;
        apart += largest - (w * x).abs();
        size += largest;
    }
    // Magnitudes below 2⁻⁵⁵ count as 0.
    (value, apart + sums * size + 1e-15 * values.len() as f64)
}

proptest! {
    #[test]
    fn outputs_are_as_near_as_their_operands(
        inputs in 1_usize..80,
        hidden in prop::collection::vec(1_usize..80, 1..4),
        seed in any::<u64>(),
    ) {
        let sizes = [vec![inputs], hidden, vec![1]].concat();
        let network = Mlp::new(&sizes, Seed::new(seed));
        let input = numbers(5 * inputs, seed ^ 2);
        let (outputs, _) = pass(Processor::detect(), &network, &input, &[1.0]);
        for (&output, input) in outputs.iter().zip(input.chunks(inputs)) {
            let (exact, apart) = bound(&network, input);
            prop_assert!((f64::from(output) - exact).abs() <= apart, "{output} {exact} {apart}");
        }
    }

    /// No term cancels, and all units are active. So each value is a sum of products of at most 2L rounded numbers.
    #[test]
    fn gradients_of_positive_numbers_are_as_near_as_their_operands(
        inputs in 1_usize..80,
        hidden in prop::collection::vec(1_usize..80, 1..4),
        learnt in 1_usize..40,
        seed in any::<u64>(),
    ) {
        let sizes = [vec![inputs], hidden, vec![1]].concat();
        let parameters = positive(Mlp::new(&sizes, Seed::new(1)).parameter_count(), seed);
        let network = Mlp::from_parameters(&sizes, &parameters).expect("as many");
        let (input, output_gradient) = (positive(learnt * inputs, seed ^ 5), positive(learnt, seed ^ 6));
        let (outputs, gradients) = pass(Processor::detect(), &network, &input, &output_gradient);
        let (expected, expected_gradients) = single(&network, &input, &output_gradient);
        let layers = network.layers().len() as i32;
        let apart = (1.0 + ROUNDING).powi(2 * layers) - 1.0 + 1e-3;
        let got = outputs.iter().chain(&gradients);
        for (&got, &expected) in got.zip(expected.iter().chain(&expected_gradients)) {
            let ratio = f64::from(got) / f64::from(expected);
            prop_assert!((ratio - 1.0).abs() <= apart, "{got} {expected}");
        }
    }
}

#[test]
fn it_is_close_to_single_precision() {
    let network = Mlp::new(&[142, 256, 256, 1], Seed::new(1));
    let input = numbers(513 * 142, 2);
    let output_gradient = numbers(256, 3);
    let (outputs, gradients) = pass(Processor::detect(), &network, &input, &output_gradient);
    let (expected, expected_gradients) = single(&network, &input, &output_gradient);
    for (got, expected) in outputs.iter().zip(&expected) {
        assert!((got - expected).abs() < 4e-3, "{got} {expected}");
    }
    assert!(outputs != expected, "rounded");
    for layer in network.layers() {
        for part in [layer.weights.clone(), layer.bias.clone()] {
            let apart = apart(&gradients[part.clone()], &expected_gradients[part]);
            // If a sum is nearly 0, its unit may be active in only one of the two networks. Then only one of them has its error.
            assert!(apart < 4e-3, "{layer:?}: {apart}");
        }
    }
}

#[test]
fn a_row_does_not_depend_on_its_company() {
    let network = Mlp::new(&[21, 40, 33, 1], Seed::new(1));
    let input = numbers(29 * 21, 2);
    let rounded = Bf16Network::new(&network);
    let mut workspace = Bf16Workspace::new(&network, 29, 29);
    let mut batch = Bf16Batch::new(21, 29, 29);
    batch.set(&input, 11);
    let all = rounded.forward(&batch, 0..29, &mut workspace).to_vec();
    assert_eq!(rounded.forward(&batch, 7..20, &mut workspace), &all[7..20]);
    let gradient = {
        rounded.forward(&batch, 0..29, &mut workspace);
        gradients(&rounded, &batch, &numbers(11, 3), &mut workspace)
    };
    batch.set(&input[..11 * 21], 11);
    assert_eq!(rounded.forward(&batch, 0..11, &mut workspace), &all[..11]);
    assert_eq!(gradients(&rounded, &batch, &numbers(11, 3), &mut workspace), gradient);
    for row in 0..29 {
        batch.set(&input[row * 21..][..21], 0);
        assert_eq!(rounded.forward(&batch, 0..1, &mut workspace), &all[row..=row]);
    }
}

#[test]
fn no_rows_have_no_outputs() {
    let network = Mlp::new(&[3, 40, 1], Seed::new(1));
    let mut batch = Bf16Batch::new(3, 2, 0);
    batch.set(&numbers(6, 2), 0);
    let mut workspace = Bf16Workspace::new(&network, 2, 0);
    for processor in Processor::all() {
        let rounded = Bf16Network::on(processor, &network);
        assert!(rounded.forward(&batch, 1..1, &mut workspace).is_empty());
    }
}

#[test]
fn the_portable_network_is_the_same() {
    let network = Mlp::new(&[21, 40, 33, 1], Seed::new(1));
    let mut batch = Bf16Batch::new(21, 9, 0);
    batch.set(&numbers(9 * 21, 2), 0);
    let mut workspace = Bf16Workspace::new(&network, 9, 0);
    let outputs = Bf16Network::new(&network).forward(&batch, 0..9, &mut workspace).to_vec();
    assert_eq!(Bf16Network::portable(&network).forward(&batch, 0..9, &mut workspace), outputs);
}

#[test]
fn new_parameters_are_taken_over() {
    let [before, after] = [1, 2].map(|seed| Mlp::new(&[5, 36, 7, 1], Seed::new(seed)));
    let mut rounded = Bf16Network::new(&before);
    rounded.set(&after);
    let input = numbers(10, 2);
    let mut batch = Bf16Batch::new(5, 2, 0);
    batch.set(&input, 0);
    let mut workspace = Bf16Workspace::new(&after, 2, 0);
    let got = rounded.forward(&batch, 0..2, &mut workspace).to_vec();
    assert_eq!(got, Bf16Network::new(&after).forward(&batch, 0..2, &mut workspace));
}

#[test]
fn a_diverged_network_predicts_nan() {
    let mut network = Mlp::new(&[2, 4, 4, 1], Seed::new(1));
    network.parameters_mut().fill(f32::NAN);
    for processor in Processor::all() {
        let (outputs, _) = pass(processor, &network, &[1.0, 1.0], &[1.0]);
        assert!(outputs[0].is_nan());
    }
}

#[test]
#[should_panic(expected = "a gradient for each row that is learnt from")]
fn a_gradient_covers_what_is_learnt_from() {
    let network = Mlp::new(&[2, 3, 1], Seed::new(1));
    let rounded = Bf16Network::new(&network);
    let mut batch = Bf16Batch::new(2, 4, 2);
    batch.set(&[0.0; 8], 2);
    gradients(&rounded, &batch, &[0.0; 3], &mut Bf16Workspace::new(&network, 4, 4));
}
