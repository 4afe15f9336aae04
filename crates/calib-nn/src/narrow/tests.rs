use calib_core::Seed;

use crate::{Adam, AdamRule, Mlp, Workspace};

#[test]
fn narrow_networks_are_the_others_to_the_byte() {
    for (sizes, rows) in [
        (&[4, 64, 64, 2][..], 32),
        (&[6, 64, 64, 3], 32),
        (&[2, 64, 64, 5], 33),
        (&[1, 16, 4], 18),
        (&[32, 128, 48, 112, 8], 64),
        (&[9, 32, 7], 10),
    ] {
        let mut rng = Seed::new(rows as u64).rng();
        let mut network = Mlp::new(sizes, Seed::new(5));
        let mut other = network.clone();
        let mut workspace = Workspace::new(&network, rows);
        let mut plain = workspace.clone();
        plain.narrow = None;
        let rule = AdamRule { learning_rate: 0.01, ..AdamRule::default() };
        let mut adam = Adam::new(rule, network.parameter_count());
        let mut other_adam = adam.clone();
        assert!(workspace.narrow.is_some());
        for round in 0..20 {
            let rows = if round % 3 == 0 { rows - 1 } else { rows };
            let input: Vec<f32> =
                (0..rows * sizes[0]).map(|_| rng.uniform(-1.0, 1.0) as f32).collect();
            let outputs = network.forward(&input, &mut workspace).to_vec();
            assert_eq!(outputs, other.forward(&input, &mut plain));
            let gradient: Vec<f32> = outputs
                .iter()
                .map(|_| if rng.unit() < 0.5 { rng.uniform(-0.1, 0.1) as f32 } else { 0.0 })
                .collect();
            let gradients = network.backward(&input, &gradient, &mut workspace).to_vec();
            assert_eq!(gradients, other.backward(&input, &gradient, &mut plain));
            network.learn(&input, &gradient, &mut workspace, &mut adam);
            other.learn(&input, &gradient, &mut plain, &mut other_adam);
            assert_eq!(network, other, "{sizes:?}, round {round}");
            assert_eq!(adam, other_adam);
        }
    }
}

#[test]
fn wide_networks_and_large_batches_are_not_narrow() {
    for (sizes, rows) in [
        (&[4, 64, 64, 2][..], 65),
        (&[4, 64, 50, 2], 32),
        (&[4, 256, 2], 32),
        (&[4, 64, 1], 32),
        (&[33, 64, 2], 32),
        (&[4, 2], 32),
    ] {
        let network = Mlp::new(sizes, Seed::new(1));
        assert!(Workspace::new(&network, rows).narrow.is_none(), "{sizes:?}");
    }
}

#[test]
fn few_rows_learn_as_others_do() {
    let mut network = Mlp::new(&[3, 32, 2], Seed::new(1));
    let mut other = network.clone();
    let mut workspace = Workspace::new(&network, 8);
    let mut plain = workspace.clone();
    plain.narrow = None;
    let mut adam = Adam::new(AdamRule::default(), network.parameter_count());
    let mut other_adam = adam.clone();
    // The errors of eight rows of 32 units are summed in another order. A single row has only one product for each weight.
    for rows in [8, 1, 0] {
        let input = vec![0.5; rows * 3];
        let gradient = vec![0.25; rows * 2];
        network.forward(&input, &mut workspace);
        other.forward(&input, &mut plain);
        network.learn(&input, &gradient, &mut workspace, &mut adam);
        other.learn(&input, &gradient, &mut plain, &mut other_adam);
        assert_eq!(network, other);
    }
}

#[test]
fn a_diverged_network_predicts_nan() {
    let mut network = Mlp::new(&[2, 16, 2], Seed::new(1));
    network.parameters_mut().fill(f32::NAN);
    let mut workspace = Workspace::new(&network, 9);
    assert!(network.forward(&[1.0; 18], &mut workspace).iter().all(|value| value.is_nan()));
}
