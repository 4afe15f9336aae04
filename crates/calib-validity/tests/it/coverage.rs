//! The coverage of bounds and intervals over plants in simulations.

use calib_core::{Rng, Seed};
use calib_validity::{
    Claim, Comparison, Method, MethodSummary, ModelPair, Outcome, Pair, Validity, judge,
};

const STUDIES: usize = 400;

fn normal(rng: &mut Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.unit()).ln()).sqrt();
    let angle = rng.unit();
    radius * (std::f64::consts::TAU * angle).cos()
}

/// A distribution of plants: log-normal regrets of three sensors, which share most of their
/// variation.
#[derive(Clone, Copy)]
struct Plants {
    /// Standard deviation of the logarithm of regrets.
    spread: f64,
    /// Typical ratio of the error of the model's choice to that of log replay's.
    quotient: f64,
}

impl Plants {
    /// Returns the regrets of log replay's choice and of the model's.
    fn plant(self, rng: &mut Rng) -> Vec<[f64; 2]> {
        let own = normal(rng);
        let differs = normal(rng);
        (0..3)
            .map(|_| {
                let replay = 0.02 * (self.spread * (0.8 * own + 0.6 * normal(rng))).exp();
                let differs = self.quotient * (0.03 * differs + 0.01 * normal(rng)).exp();
                let model = ((1.0 + replay) * differs - 1.0).max(0.0);
                [replay.min(10.0), model.min(10.0)]
            })
            .collect()
    }

    fn judged(self, count: usize, rng: &mut Rng) -> Validity {
        let mut pairs = Vec::new();
        for plant in 0..count {
            for (sensor, [replay, model]) in self.plant(rng).into_iter().enumerate() {
                pairs.push(pair(plant, sensor, [replay, model, 1.0]));
            }
        }
        judge(["x", "y", "z"].map(str::to_owned).to_vec(), pairs, &[]).expect("valid")
    }

    /// Returns the true values over many plants: mean and typical regret of log replay, and the
    /// model's ratio.
    fn truth(self) -> [f64; 3] {
        const MANY: usize = 100_000;
        let mut rng = Seed::new(99).rng();
        let mut sums = [0.0; 3];
        for _ in 0..MANY {
            for [replay, model] in self.plant(&mut rng) {
                let quotient = model.ln_1p() - replay.ln_1p();
                for (sum, value) in sums.iter_mut().zip([replay, replay.ln_1p(), quotient]) {
                    *sum += value / (3 * MANY) as f64;
                }
            }
        }
        [sums[0], sums[1].exp_m1(), sums[2].exp()]
    }
}

fn pair(plant: usize, sensor: usize, regrets: [f64; 3]) -> Pair {
    Pair {
        plant: plant.to_string(),
        sensor: sensor.to_string(),
        optimiser: "adam".to_owned(),
        online: vec![0.5; 3],
        skill: Some(0.5),
        regrets: Some(regrets.to_vec()),
        default: Some(2),
        log_replay: Some(0),
        models: vec![ModelPair { model: "a".to_owned(), chosen: 1, ..ModelPair::default() }],
        ..Pair::default()
    }
}

fn replay(validity: &Validity) -> &MethodSummary {
    validity
        .methods
        .iter()
        .find(|summary| summary.method == Method::LogReplay)
        .expect("it is there")
}

fn against_replay(validity: &Validity) -> &Comparison {
    validity
        .comparisons
        .iter()
        .find(|comparison| comparison.against == Method::LogReplay)
        .expect("it is there")
}

#[test]
fn bounds_and_intervals_over_plants_hold_what_other_plants_say() {
    let mut rng = Seed::new(1).rng();
    for (spread, count, least) in [
        (1.0, 8, [0.93, 0.92]),
        (1.0, 29, [0.97, 0.92]),
        (1.5, 8, [0.85, 0.84]),
        (1.5, 29, [0.93, 0.88]),
    ] {
        let plants = Plants { spread, quotient: 1.0 };
        let [mean, typical, quotient] = plants.truth();
        let mut held = [0.0; 3];
        for _ in 0..STUDIES {
            let validity = plants.judged(count, &mut rng);
            let own = replay(&validity);
            let comparison = against_replay(&validity);
            let of_typical = own.typical_interval.expect("plants differ");
            let of_quotient = comparison.error_ratio_interval.expect("plants differ");
            let holds = [
                mean <= own.upper.expect("plants differ"),
                (of_typical.low..=of_typical.high).contains(&typical),
                (of_quotient.low..=of_quotient.high).contains(&quotient),
            ];
            for (held, holds) in held.iter_mut().zip(holds) {
                *held += f64::from(u8::from(holds)) / STUDIES as f64;
            }
        }
        println!(
            "spread {spread}, {count} plants: mean {:.3}, typical {:.3}, quotient {:.3}",
            held[0], held[1], held[2]
        );
        assert!(held[0] >= least[0] && held[1] >= least[1], "{held:?}");
        assert!(held[2] > 0.93, "{held:?}");
    }
}

#[test]
fn no_worse_is_said_of_what_is_worse_by_the_margin_in_one_case_of_forty() {
    let mut rng = Seed::new(2).rng();
    for count in [8, 29] {
        let plants = Plants { spread: 1.0, quotient: 1.01 };
        let said = (0..2 * STUDIES)
            .filter(|_| {
                plants
                    .judged(count, &mut rng)
                    .tests
                    .iter()
                    .any(|test| test.claim == Claim::NoWorse && test.outcome == Outcome::Holds)
            })
            .count() as f64
            / (2 * STUDIES) as f64;
        println!("{count} plants: {said:.4}");
        assert!(said < 0.04, "{count} plants: {said}");
    }
}
